// SPDX-License-Identifier: GPL-3.0-or-later
//! What an image takes of the processor, in closed loop.
//!
//! The figures are for budgets and a golden file, so they are of fixed work: ten
//! seconds at rest, where nothing but the default rates is at work; then the
//! commands with the deepest calls, and a run, where pulses and control add up.

use std::path::Path;

use anyhow::{Context, ensure};
use virtual_rig::{Image, Options, VirtualRig};
use wire::{
    command::{Command, Request},
    protocol::Named,
    settings::{Key, TABLE_COUNT, effect_id},
};

/// Longer than settings take to be in EEPROM.
const SAVING_S: f64 = 5.0;

struct Text(String);

impl ufmt::uWrite for Text {
    type Error = std::convert::Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
        self.0.push_str(text);
        Ok(())
    }
}

/// Measures and prints one `NAME VALUE` a line.
pub fn run(path: &Path) -> anyhow::Result<()> {
    let image = Image::read(path).with_context(|| format!("cannot load {}", path.display()))?;
    let mut rig = VirtualRig::new(&image, Options::default())?;
    rig.run_for(1.0)?;
    rig.take_lines();
    let at_rest = busy(&mut rig, 10.0)?;
    let lines = rig.take_lines();
    let telemetry = lines.iter().filter(|line| line.starts_with("T ")).count();

    for command in [Command::Help, Command::Status, Command::SelfTest] {
        send(&mut rig, command)?;
        rig.run_for(1.0)?;
    }
    // A model with a table is the largest that can be saved; and away with it.
    for kind in [effect_id("table"), 0] {
        let number = f32::to_bits;
        let slot = 0;
        for (key, bits) in [
            (Key::EffectKind { slot }, u32::from(kind)),
            (
                Key::EffectParameter {
                    slot,
                    index: TABLE_COUNT,
                },
                number(2.0),
            ),
            (Key::TableNode(1), number(1.0)),
        ] {
            send(&mut rig, Command::Set { key, bits })?;
            rig.run_for(0.1)?;
        }
        send(&mut rig, Command::Save)?;
        rig.run_for(SAVING_S)?;
        let lines = rig.take_lines();
        ensure!(
            lines.iter().any(|line| line.contains("saved")),
            "the settings were not saved:\n{}",
            lines.join("\n")
        );
    }
    send(&mut rig, Command::Arm)?;
    let limit = 60;
    let mut waited = 0;
    while !rig.take_lines().iter().any(|line| line.contains(" r0")) {
        ensure!(waited < limit, "the rig is not ready after {limit} s");
        send(&mut rig, Command::Beat)?;
        rig.run_for(1.0)?;
        waited += 1;
    }
    send(&mut rig, Command::Run(Some(Named::Paper)))?;
    rig.trace_steps(true);
    let mut running: f64 = 0.0;
    for _ in 0..10 {
        send(&mut rig, Command::Beat)?;
        running = running.max(busy(&mut rig, 1.0)?);
    }
    println!("telemetry_lines_in_10_s {telemetry}");
    println!("cpu_at_rest_percent {at_rest:.1}");
    println!("cpu_in_a_run_percent {running:.1}");
    println!("stack_bytes {}", rig.stack_bytes());
    println!("steps {}", rig.step_edges().len());
    println!("resets {}", rig.resets());
    Ok(())
}

/// Lets time pass; returns how much of it (%) the processor was awake.
fn busy(rig: &mut VirtualRig, seconds: f64) -> anyhow::Result<f64> {
    let (cycle, slept) = (rig.cycle(), rig.slept_cycles());
    rig.run_for(seconds)?;
    let asleep = (rig.slept_cycles() - slept) as f64 / (rig.cycle() - cycle) as f64;
    Ok(100.0 * (1.0 - asleep))
}

fn send(rig: &mut VirtualRig, command: Command) -> anyhow::Result<()> {
    let mut line = Text(String::new());
    let Ok(()) = Request { id: 1, command }.write(&mut line);
    rig.send(line.0.as_bytes())?;
    Ok(())
}
