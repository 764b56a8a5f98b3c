// SPDX-License-Identifier: GPL-3.0-or-later
//! Simulated hours of protocols and misfortunes; see [`softrig_bench_board::soak`].
#![forbid(unsafe_code)]

use std::{path::PathBuf, process::ExitCode, time::Duration};

use anyhow::{Context, ensure};
use clap::Parser;
use softrig_bench_board::soak;
use virtual_rig::Image;

/// Runs protocols, breaks what can break, and holds what is promised against the truth
///
/// Exit codes: 0 all promises held, 1 one was broken or the image cannot be read,
/// 2 wrong arguments.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    /// The image that `cargo xtask firmware` builds
    image: PathBuf,
    /// Simulated hours
    #[arg(long, value_name = "H", default_value_t = 1.0)]
    hours: f64,
    /// Seed of everything that is drawn
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Between two lines that say how far it is.
const EVERY: Duration = Duration::from_secs(5);

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("soak: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let path = &arguments.image;
    let image = Image::read(path).with_context(|| format!("cannot load {}", path.display()))?;
    ensure!(
        arguments.hours.is_finite() && arguments.hours > 0.0,
        "--hours takes a number above 0"
    );
    let options = soak::Options {
        seed: arguments.seed,
        seconds: arguments.hours * 3600.0,
        every: EVERY,
    };
    match soak::run(&image, &options, |summary| {
        println!("{}", summary.progress());
    }) {
        Ok(summary) => {
            println!("\n{summary}");
            Ok(ExitCode::SUCCESS)
        }
        Err(broken) => {
            let (violation, summary) = *broken;
            println!("\n{summary}");
            eprintln!("soak: a promise was broken: {violation}");
            Ok(ExitCode::FAILURE)
        }
    }
}
