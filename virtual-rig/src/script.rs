// SPDX-License-Identifier: GPL-3.0-or-later
//! `virtual-rig run --script`: a board alone, with stimuli at given times.
//!
//! Nothing around the board answers to what it does, so that another simulator can be given the
//! same stimuli and has to show the same behaviour.

use std::io::Write;
use std::path::Path;
use std::{fs, io};

use anyhow::{Context, bail};
use virtual_rig::board::{CLOCK_HZ, Pin, SUPPLY_MILLIVOLTS, StepperWiring};
use virtual_rig::{Board, Image, wiring};

/// Codes of the converter.
const CODES: f64 = 1024.0;

/// Microsteps beyond which no script goes.
const FAR: i64 = 1_000_000;

/// A stimulus.
#[derive(Clone, Debug, PartialEq)]
enum Stimulus {
    Send(String),
    Counts(u8, u16),
    Level(Pin, bool),
    End,
}

/// Plays a script; what the board says goes to standard output, its marks and its steps to
/// standard error.
pub fn run(image: &Path, script: &Path) -> anyhow::Result<()> {
    let image = Image::read(image).with_context(|| format!("cannot load {}", image.display()))?;
    let text =
        fs::read_to_string(script).with_context(|| format!("cannot read {}", script.display()))?;
    let mut board = Board::new(&image)?;
    board.wire_stepper(StepperWiring {
        step: wiring::STEP,
        direction: wiring::DIRECTION,
        enable: wiring::ENABLE,
        position: 0,
        lowest: -FAR,
        highest: FAR,
    });
    for (number, line) in (1..).zip(text.lines()) {
        if line.trim().is_empty() || line.starts_with('#') {
            continue;
        }
        let (seconds, stimulus) =
            parse(line).with_context(|| format!("{}, line {number}", script.display()))?;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Of some minutes.
        let at = (seconds * f64::from(CLOCK_HZ)).round() as u64;
        board.run(at.saturating_sub(board.cycle()))?;
        match stimulus {
            Stimulus::Send(line) => board.send(format!("{line}\n").as_bytes())?,
            Stimulus::Counts(channel, counts) => {
                let millivolts = f64::from(counts) * f64::from(SUPPLY_MILLIVOLTS) / CODES;
                board.set_analog(channel, millivolts, 0.0);
            }
            Stimulus::Level(pin, level) => board.set_input(pin, level),
            Stimulus::End => break,
        }
    }
    io::stdout().lock().write_all(&board.take_output())?;
    let mut marks = io::stderr().lock();
    for mark in board.take_marks() {
        writeln!(marks, "mark {} {}", mark.id, mark.cycles)?;
    }
    writeln!(marks, "position {}", board.stepper().position)?;
    Ok(())
}

fn parse(line: &str) -> anyhow::Result<(f64, Stimulus)> {
    let mut words = line.splitn(3, ' ');
    let (Some(seconds), Some(what)) = (words.next(), words.next()) else {
        bail!("`{line}` has no time and stimulus, as in `0.5 send hello`");
    };
    let seconds: f64 = seconds
        .parse()
        .with_context(|| format!("`{seconds}` is no number of seconds"))?;
    let rest = words.next().unwrap_or_default();
    let stimulus = match (what, rest.split_once(' ')) {
        ("send", _) => Stimulus::Send(rest.to_owned()),
        ("counts", Some((channel, counts))) => Stimulus::Counts(channel.parse()?, counts.parse()?),
        ("pin", Some((pin, level))) => match pin.as_bytes() {
            [port, bit @ b'0'..=b'7'] => {
                let bit = bit - b'0';
                Stimulus::Level(Pin { port: *port, bit }, level == "1")
            }
            _ => bail!("`{pin}` is no pin, such as E4"),
        },
        ("end", None) => Stimulus::End,
        _ => bail!("`{line}`: use send LINE, counts CHANNEL N, pin PORTBIT 0|1 or end"),
    };
    Ok((seconds, stimulus))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scripts_are_read_and_mistakes_explained() {
        assert_eq!(
            parse("0.5 send get damping").unwrap(),
            (0.5, Stimulus::Send("get damping".into()))
        );
        assert_eq!(parse("0 counts 1 668").unwrap().1, Stimulus::Counts(1, 668));
        let pin = Pin { port: b'E', bit: 4 };
        assert_eq!(parse("3 pin E4 1").unwrap().1, Stimulus::Level(pin, true));
        assert_eq!(parse("9 end").unwrap().1, Stimulus::End);
        for (line, hint) in [
            ("hello", "0.5 send"),
            ("x end", "seconds"),
            ("1 pin 4 1", "E4"),
            ("1 jump", "counts"),
        ] {
            let error = format!("{:#}", parse(line).unwrap_err());
            assert!(error.contains(hint), "{error}");
        }
    }
}
