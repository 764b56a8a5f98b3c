// SPDX-License-Identifier: GPL-3.0-or-later
//! Processor load and stack of an image, in closed loop.
//!
//! The figures are for budgets and a golden file, so the work is fixed: ten seconds at
//! rest with the default rates only, then the commands with the deepest calls, starts with
//! what was saved, and runs with pulses and control.

use std::path::Path;

use anyhow::{Context, ensure};
use model_core::prepared::DEAREST;
use softrig_link::line::request_text;
use virtual_rig::{Image, Options, ResetCause, VirtualRig};
use wire::{
    command::{Command, Request},
    protocol::Named,
    settings::{Key, TABLE_COUNT, effect_id},
};

/// Longer than settings take to be in EEPROM.
const SAVING_S: f64 = 5.0;

/// Longer than the self-test takes.
const SELF_TEST_S: u32 = 30;

/// Measures and prints one `NAME VALUE` a line.
pub fn run(path: &Path) -> anyhow::Result<()> {
    let image = Image::read(path).with_context(|| format!("cannot load {}", path.display()))?;
    let mut rig = VirtualRig::new(&image, Options::default())?;
    rig.run_for(1.0)?;
    rig.take_lines();
    let at_rest = busy(&mut rig, 10.0)?;
    let lines = rig.take_lines();
    let telemetry = lines.iter().filter(|line| line.starts_with("T ")).count();

    for command in [Command::Help, Command::Status] {
        send(&mut rig, command)?;
        rig.run_for(1.0)?;
    }
    send(&mut rig, Command::SelfTest)?;
    wait(&mut rig, "self-test: done", SELF_TEST_S)?;
    // A model with a table is the largest that can be saved; and away with it.
    let slot = 0;
    let number = f32::to_bits;
    let (mut stack, mut restarts) = (0, 0);
    let count = Key::EffectParameter {
        slot,
        index: TABLE_COUNT,
    };
    for kind in [effect_id("table"), 0] {
        save(
            &mut rig,
            &[
                (Key::EffectKind { slot }, u32::from(kind)),
                (count, number(2.0)),
                (Key::TableNode(1), number(1.0)),
            ],
        )?;
        // A start with stored settings goes other ways than one with an empty memory. It paints
        // the memory anew, so what was used before is noted.
        stack = stack.max(rig.stack_bytes());
        rig.reset(ResetCause::External);
        rig.run_for(2.0)?;
        restarts += 1;
    }
    let running = in_a_run(&mut rig)?;
    let steps = rig.step_edges().len();
    send(&mut rig, Command::Stop)?;
    // The dearest three effects, on a spring that needs as many steps as there may be.
    let mut dearest = vec![(Key::Stiffness, number(40.0))];
    for (slot, kind) in (0..).zip(DEAREST) {
        dearest.push((Key::EffectKind { slot }, u32::from(effect_id(kind.name()))));
        for (index, parameter) in (0..).zip(0..kind.parameter_count()) {
            let (lower, upper) = kind.bounds(parameter).context("a parameter")?;
            let value = 0.05_f32.max(lower).min(upper);
            dearest.push((Key::EffectParameter { slot, index }, number(value)));
        }
    }
    save(&mut rig, &dearest)?;
    let dearest = in_a_run(&mut rig)?;
    println!("telemetry_lines_in_10_s {telemetry}");
    println!("cpu_at_rest_percent {at_rest:.1}");
    println!("cpu_in_a_run_percent {running:.1}");
    println!("cpu_in_a_run_with_the_dearest_model_percent {dearest:.1}");
    println!("stack_bytes {}", stack.max(rig.stack_bytes()));
    println!("steps {steps}");
    println!("resets {}", rig.resets() - restarts);
    Ok(())
}

/// Changes settings and saves them.
fn save(rig: &mut VirtualRig, changes: &[(Key, u32)]) -> anyhow::Result<()> {
    for &(key, bits) in changes {
        send(rig, Command::Set { key, bits })?;
        rig.run_for(0.1)?;
    }
    send(rig, Command::Save)?;
    rig.run_for(SAVING_S)?;
    let lines = rig.take_lines();
    ensure!(
        lines.iter().any(|line| line.starts_with("#: saved")),
        "the settings were not saved:\n{}",
        lines.join("\n")
    );
    Ok(())
}

/// The busiest second (%) of the first ten of a run, where the pump is at full flow.
fn in_a_run(rig: &mut VirtualRig) -> anyhow::Result<f64> {
    send(rig, Command::Arm)?;
    let limit = 60;
    let mut waited = 0;
    while !rig.take_lines().iter().any(|line| line.contains(" r0")) {
        ensure!(waited < limit, "the rig is not ready after {limit} s");
        send(rig, Command::Beat)?;
        rig.run_for(1.0)?;
        waited += 1;
    }
    send(rig, Command::Run(Some(Named::Paper)))?;
    rig.trace_steps(true);
    let mut running: f64 = 0.0;
    for _ in 0..10 {
        send(rig, Command::Beat)?;
        running = running.max(busy(rig, 1.0)?);
    }
    Ok(running)
}

/// Lets time pass until the board has sent a text.
fn wait(rig: &mut VirtualRig, text: &str, limit_s: u32) -> anyhow::Result<()> {
    for _ in 0..limit_s {
        rig.run_for(1.0)?;
        if rig.take_lines().iter().any(|line| line.contains(text)) {
            return Ok(());
        }
    }
    anyhow::bail!("no {text:?} within {limit_s} s")
}

/// Lets time pass; returns how much of it (%) the processor was awake.
fn busy(rig: &mut VirtualRig, seconds: f64) -> anyhow::Result<f64> {
    let (cycle, slept) = (rig.cycle(), rig.slept_cycles());
    rig.run_for(seconds)?;
    let asleep = (rig.slept_cycles() - slept) as f64 / (rig.cycle() - cycle) as f64;
    Ok(100.0 * (1.0 - asleep))
}

fn send(rig: &mut VirtualRig, command: Command) -> anyhow::Result<()> {
    rig.send(request_text(&Request { id: 1, command }).as_bytes())?;
    Ok(())
}
