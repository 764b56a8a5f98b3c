// SPDX-License-Identifier: GPL-3.0-or-later
//! The virtual rig's command line.
#![forbid(unsafe_code)]

mod control;
mod measure;
mod pty;
mod script;
mod serve;

use std::{
    io::{self, Write},
    path::{Path, PathBuf},
    process::ExitCode,
};

use anyhow::Context;
use clap::{Parser, Subcommand};
use model_core::catalogue::Kind;
use virtual_rig::{Board, Image, State};
use wire::stretch;

/// The firmware image in a simulated ATmega2560
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Runs an image: serial output to stdout, measured cycles and stack to stderr
    ///
    /// Exit codes: 0 as asked, 1 bad image or crashed processor, 2 wrong
    /// arguments, 3 the text of --until did not come.
    Run {
        /// The image that `cargo xtask firmware` builds
        image: PathBuf,
        /// Processor cycles to run at most; 16 million are a second
        #[arg(long, value_name = "N", default_value_t = 320_000_000)]
        cycles: u64,
        /// Stop after the first line that contains this text
        #[arg(long, value_name = "TEXT")]
        until: Option<String>,
        /// Send this line once the board listens
        #[arg(long, value_name = "TEXT")]
        send: Option<String>,
        /// Run the board alone through a script instead: lines of seconds and `send LINE`,
        /// `counts CHANNEL N`, `pin PORTBIT 0|1` or `end`. Marks and steps go to stderr
        #[arg(long, value_name = "FILE", conflicts_with_all = ["cycles", "until", "send"])]
        script: Option<PathBuf>,
    },
    /// Runs an image on a healthy rig, through everything that costs most, and
    /// prints what it took
    Measure {
        /// The image that `cargo xtask firmware` builds
        image: PathBuf,
    },
    Serve(serve::ServeArgs),
}

/// Cycles between looks at the output: a millisecond.
const LOOK_EVERY: u64 = 16_000;

/// Stretches of one kind that are shown one by one; a loop marks thousands.
const MARKS_SHOWN: u64 = 20;

const TEXT_DID_NOT_COME: u8 = 3;

fn main() -> ExitCode {
    let outcome = match Arguments::parse().command {
        Command::Run {
            image,
            cycles,
            until,
            send,
            script: None,
        } => run(&image, cycles, until.as_deref(), send.as_deref()),
        Command::Run {
            image,
            script: Some(script),
            ..
        } => script::run(&image, &script).map(|()| ExitCode::SUCCESS),
        Command::Measure { image } => measure::run(&image).map(|()| ExitCode::SUCCESS),
        Command::Serve(args) => serve::run(&args).map(|()| ExitCode::SUCCESS),
    };
    match outcome {
        Ok(code) => code,
        Err(error) => {
            eprintln!("virtual-rig: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(
    path: &Path,
    cycles: u64,
    until: Option<&str>,
    send: Option<&str>,
) -> anyhow::Result<ExitCode> {
    let image = Image::read(path).with_context(|| format!("cannot load {}", path.display()))?;
    let mut board = Board::new(&image)?;
    if let Some(line) = send {
        board.send(format!("{line}\n").as_bytes())?;
    }
    let code = watch(&mut board, cycles, until)?;
    for id in 1..=u8::MAX {
        let total = board.mark_total(id);
        if total.count > MARKS_SHOWN {
            eprintln!(
                "total {} {} cycles, {} times, longest {}",
                name(id),
                total.cycles,
                total.count,
                total.longest
            );
        }
    }
    eprintln!("stack {} bytes", board.stack_bytes());
    Ok(code)
}

/// Passes on what the board says until it is time to stop.
fn watch(board: &mut Board, cycles: u64, until: Option<&str>) -> anyhow::Result<ExitCode> {
    let mut stdout = io::stdout().lock();
    let mut seen = Vec::new();
    let mut marks = [0; 256];
    loop {
        let outcome = board.run(LOOK_EVERY.min(cycles.saturating_sub(board.cycle())));
        let output = board.take_output();
        match stdout.write_all(&output).and_then(|()| stdout.flush()) {
            // Whoever read the output has seen enough.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => {
                return Ok(ExitCode::SUCCESS);
            }
            result => result.context("cannot write the board's output")?,
        }
        for mark in board.take_marks() {
            let count = &mut marks[usize::from(mark.id)];
            *count += 1;
            if *count <= MARKS_SHOWN {
                eprintln!("cycles {} {}", name(mark.id), mark.cycles);
            }
        }
        let state = outcome?;
        if let Some(text) = until {
            seen.extend(output);
            while let Some(end) = seen.iter().position(|&byte| byte == b'\n') {
                let line: Vec<u8> = seen.drain(..=end).collect();
                if contains(&line, text.as_bytes()) {
                    return Ok(ExitCode::SUCCESS);
                }
            }
        }
        if state == State::Halted || board.cycle() >= cycles {
            let why = match state {
                State::Halted => "the processor halted",
                State::Running => "the last cycle was reached",
            };
            return Ok(match until {
                None => ExitCode::SUCCESS,
                Some(text) => {
                    eprintln!(
                        "virtual-rig: {why} at cycle {} before the board sent {text:?}",
                        board.cycle()
                    );
                    ExitCode::from(TEXT_DID_NOT_COME)
                }
            });
        }
    }
}

/// The name of a measured stretch, without spaces.
fn name(stretch: u8) -> String {
    if let Some(name) = stretch::name(stretch) {
        return name.into();
    }
    let effect = stretch::effect_index(stretch).and_then(|index| Kind::ALL.get(index));
    match effect {
        Some(kind) => format!("step_table+{}", kind.name()),
        None => format!("stretch_{stretch}"),
    }
}

fn contains(haystack: &[u8], needle: &[u8]) -> bool {
    needle.is_empty()
        || haystack
            .windows(needle.len())
            .any(|window| window == needle)
}
