// SPDX-License-Identifier: GPL-3.0-or-later
//! Steps of the angle in closed loop, on actuators that are stiffer or softer than the
//! board believes.

use model_core::actuator::Model;
use model_core::dynamics::Dynamics;
use virtual_rig::Options;
use wire::{
    command::Command,
    protocol::ControlMode,
    settings::{Key, Settings},
};

use crate::bench::Bench;

/// True stiffness over the board's.
pub const STIFFNESSES: [f64; 3] = [0.7, 1.0, 1.3];

/// What a step came to, in the simulated truth.
pub struct Response {
    pub degrees: f64,
    /// The angle (°) every 10 ms from the command on.
    pub angles_deg: Vec<f64>,
    /// Seconds that the pump at full flow takes for the pressure that holds the angle: no
    /// loop is faster.
    pub pump_s: f64,
}

impl Response {
    /// How far the angle went beyond (% of it).
    pub fn overshoot_percent(&self) -> f64 {
        let highest = self.angles_deg.iter().copied().fold(0.0, f64::max);
        (highest / self.degrees - 1.0).max(0.0) * 100.0
    }

    /// Seconds after which the angle stays within 2 % or 0.5°, whichever is more.
    pub fn settling_s(&self) -> f64 {
        let band = (0.02 * self.degrees).max(0.5);
        let last = self
            .angles_deg
            .iter()
            .rposition(|angle| (angle - self.degrees).abs() > band);
        last.map_or(0.0, |last| (last + 1) as f64 / 100.0)
    }
}

/// Lets the real image step to an angle; none without an image.
pub fn step(degrees: f64, stiffness: f64) -> Option<Response> {
    let believed = *virtual_rig::default_actuator().dynamics();
    let actuator = Model::new(
        Dynamics {
            stiffness: believed.stiffness * stiffness,
            ..believed
        },
        &[],
    )
    .expect("a stiffness is a model");
    let pressure = actuator.holding_pressure(degrees.to_radians());
    let options = Options::with_actuator(actuator);
    let config = options.plant.clone();
    let mut bench = Bench::start(options)?;
    #[expect(clippy::cast_possible_truncation)] // Tens of degrees.
    bench.load(ControlMode::AngleClosedLoop, degrees as f32);
    let air_ul = config.volume_m3(bench.rig.plant().plunger_mm) * 1e9;
    bench.obey(Command::Run(None));
    let angles_deg = (0..1_000)
        .map(|_| {
            bench.run(0.01);
            bench.rig.plant().angle_deg
        })
        .collect();
    assert_eq!(bench.fault(), None);
    let volume_ul = air_ul * pressure / (101_325.0 + pressure);
    Some(Response {
        degrees,
        angles_deg,
        pump_s: volume_ul / f64::from(Settings::DEFAULT.number(Key::MaxFlow)),
    })
}
