// SPDX-License-Identifier: GPL-3.0-or-later
//! Steps of the angle in closed loop with the real image: a table and a picture.
//!
//! `cargo xtask bench control` runs it.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Parser;
use softrig_formats::error::write_atomically;
use softrig_report::plot::{Figure, Panel, Series, Style, to_svg_string};

#[path = "../../../../virtual-rig/tests/firmware/bench.rs"]
#[allow(dead_code)] // The tests use more of it.
mod bench;
#[path = "../../../../virtual-rig/tests/firmware/steps.rs"]
mod steps;

/// The angles (°) that are asked for.
const ANGLES_DEG: [f64; 4] = [10.0, 30.0, 60.0, 90.0];

/// Lets the firmware step to angles on actuators that are softer and stiffer than its model.
#[derive(Debug, Parser)]
#[command(name = "closed_loop_steps")]
struct Args {
    /// Draw the steps
    #[arg(long, value_name = "OUT.svg")]
    picture: Option<PathBuf>,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    println!(
        "| step | true stiffness over the model's | overshoot | settled to 2 % or 0.5° | the pump alone |"
    );
    println!("|---:|---:|---:|---:|---:|");
    let mut figure = Figure::new("Steps of the angle in closed loop")
        .with_subtitle(
            "The firmware in the simulator; actuators of 0.7, 1 and 1.3 times the model's \
         stiffness K. Drawn by cargo xtask bench control --docs.",
        )
        .with_columns(2);
    for degrees in ANGLES_DEG {
        let mut panel = Panel::new("time (s)", "angle (°)")
            .with_y_range(-2.0, 1.15 * degrees)
            .with_level(degrees);
        for stiffness in steps::STIFFNESSES {
            let response = steps::step(degrees, stiffness)
                .context("SOFTRIG_FIRMWARE is not set to an image")?;
            println!(
                "| {degrees}° | {stiffness} | {:.1} % | {:.2} s | {:.2} s |",
                response.overshoot_percent(),
                response.settling_s(),
                response.pump_s
            );
            let shown = &response.angles_deg[..800];
            let times: Vec<f64> = (0..shown.len()).map(|k| k as f64 / 100.0).collect();
            let style = if stiffness < 1.0 {
                Style::BEFORE
            } else if stiffness > 1.0 {
                Style::NOMINAL
            } else {
                Style::EMPHASIS
            };
            panel = panel.with_series(Series::new(
                format!("K × {stiffness}"),
                &times,
                shown,
                style,
            ));
        }
        figure = figure.with_panel(panel);
    }
    if let Some(path) = &args.picture {
        let svg = to_svg_string(&figure);
        write_atomically(path, svg.as_bytes()).context("the picture")?;
    }
    Ok(())
}
