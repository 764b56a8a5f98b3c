// SPDX-License-Identifier: GPL-3.0-or-later
//! Steps of the angle in closed loop with the real image, as JSON.
//!
//! `cargo xtask bench control` runs it.

use anyhow::Context as _;
use serde_json::json;

#[path = "../../../../virtual-rig/tests/firmware/bench.rs"]
#[allow(dead_code)] // The tests use more of it.
mod bench;
#[path = "../../../../virtual-rig/tests/firmware/steps.rs"]
mod steps;

/// The angles (°) that are asked for.
const ANGLES_DEG: [f64; 4] = [10.0, 30.0, 60.0, 90.0];

/// Samples of a step that are shown, a hundred a second.
const SHOWN: usize = 800;

/// Lets the firmware step to angles on actuators that are softer and stiffer than its model.
fn main() -> anyhow::Result<()> {
    let mut steps = Vec::new();
    for degrees in ANGLES_DEG {
        let mut responses = Vec::new();
        for stiffness in steps::STIFFNESSES {
            let response = steps::step(degrees, stiffness)
                .context("SOFTRIG_FIRMWARE is not set to an image")?;
            responses.push(json!({
                "stiffness": stiffness, "overshoot_percent": response.overshoot_percent(),
                "settling_s": response.settling_s(), "pump_s": response.pump_s,
                "angles_deg": response.angles_deg[..SHOWN],
            }));
        }
        steps.push(json!({ "angle_deg": degrees, "responses": responses }));
    }
    println!("{}", json!({ "benchmark": "control", "steps": steps }));
    Ok(())
}
