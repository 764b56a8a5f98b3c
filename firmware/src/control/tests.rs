extern crate std;
use std::vec::Vec;

use super::*;
use crate::{
    io::{Outputs, Pump, Valve},
    plant::{Plant, dynamics},
};
use proptest::prelude::*;

fn base(settings: &Settings) -> Model<f32> {
    Model::new(dynamics(settings).map(|value| value as f32), &[]).unwrap()
}

struct Run {
    plant: Plant,
    controller: Controller,
    config: Config,
    model: Model<f32>,
    /// True pressure (kPa) and angle (°) in every period.
    log: Vec<(f64, f64)>,
    flows: Vec<f32>,
}

impl Run {
    fn new(volume_ul: f64) -> Self {
        let plant = Plant::new(volume_ul, 500.0);
        Self {
            config: Config::of(&plant.settings),
            model: base(&plant.settings),
            controller: Controller::new(),
            plant,
            log: Vec::new(),
            flows: Vec::new(),
        }
    }

    fn track(&mut self, demand: (Track, f32), seconds: f64) {
        for _ in 0..(seconds * 100.0) as usize {
            let inputs = self.plant.inputs();
            let settings = &self.plant.settings;
            let measured = Measured {
                pressure: (inputs.pressure.counts() - settings.number(Key::PressureZero))
                    * settings.number(Key::PressureSpan)
                    * PA_PER_KPA,
                angle: self.plant.state.angle as f32,
                volume: inputs.steps as f32 * settings.number(Key::VolumePerStep),
            };
            let flow = self
                .controller
                .track(&self.config, &self.model, demand, &measured);
            self.flows.push(flow);
            self.plant.step(&Outputs {
                pump: Pump::Rate(flow / settings.number(Key::VolumePerStep)),
                valve: Valve::Closed,
                ..Outputs::default()
            });
            self.log.push((
                self.plant.pressure / 1_000.0,
                self.plant.state.angle.to_degrees(),
            ));
        }
    }

    /// Seconds until the pressure has come nine tenths of the way.
    fn rise(&self, pressure: f64) -> f64 {
        let reached = self.log.iter().position(|log| log.0 > 0.9 * pressure);
        reached.unwrap_or(usize::MAX) as f64 / 100.0
    }

    fn highest(&self) -> f64 {
        self.log.iter().map(|log| log.0).fold(0.0, f64::max)
    }
}

#[test]
fn an_angle_step_rises_in_time_and_does_not_overshoot() {
    for volume in [40e3, 50e3, 60e3] {
        for degrees in [10.0, 30.0, 60.0, 90.0] {
            let mut run = Run::new(volume);
            run.track((Track::AngleOpenLoop, degrees), 12.0);
            let pressure = f64::from(run.model.holding_pressure(degrees * RAD_PER_DEG)) / 1e3;
            let (rise, highest) = (run.rise(pressure), run.highest());
            std::println!(
                "{volume} {degrees}: {pressure:.1} kPa, rise {rise} s, highest {highest:.2}"
            );
            assert!(
                highest < pressure * 1.05 + 0.2,
                "{volume} {degrees}: {highest}"
            );
            let last = run.log.last().unwrap().0;
            assert!((last - pressure).abs() < 0.5, "{volume} {degrees}: {last}");
            if degrees == 60.0 {
                assert!((1.0..4.0).contains(&rise), "{volume}: {rise}");
            }
        }
    }
}

#[test]
fn the_pump_rests_at_the_set_point() {
    let mut run = Run::new(50e3);
    run.track((Track::Pressure, 40.0), 10.0);
    let moving = run.flows[700..].iter().filter(|&&flow| flow != 0.0).count();
    assert!(moving < 10, "{moving} of 300 periods");
}

#[test]
fn a_ramp_is_followed() {
    let mut run = Run::new(50e3);
    for k in 0..600 {
        run.track((Track::Pressure, k as f32 * 0.06), 0.01);
        let gap = f64::from(k) * 0.06 - run.plant.pressure / 1_000.0;
        // A lag at first, which the integral then takes away.
        let allowed = if k < 300 { 3.0 } else { 1.0 };
        assert!(gap.abs() < allowed, "{k}: {gap}");
    }
}

#[test]
fn closed_loop_reaches_an_angle_that_the_model_misses() {
    for stiffer in [0.7, 1.0, 1.3] {
        let mut run = Run::new(50e3);
        run.plant.model = {
            let mut dynamics = dynamics(&run.plant.settings);
            dynamics.stiffness *= stiffer;
            Model::new(dynamics, &[]).unwrap()
        };
        run.track((Track::AngleClosedLoop, 60.0), 15.0);
        let highest = run.log.iter().map(|log| log.1).fold(0.0, f64::max);
        let last = run.log.last().unwrap().1;
        std::println!("{stiffer}: last {last:.2}, highest {highest:.2}");
        assert!((last - 60.0).abs() < 1.0, "{stiffer}: {last}");
        assert!(
            highest < 60.0 * (if stiffer < 1.0 { 1.25 } else { 1.08 }),
            "{stiffer}: {highest}"
        );
    }
}

#[test]
fn nothing_winds_up_at_a_limit() {
    // 90° is out of reach. However long it was asked for, 20° comes as soon.
    let settled = |asked: f64| {
        let mut run = Run::new(50e3);
        run.plant.model = {
            let mut dynamics = dynamics(&run.plant.settings);
            dynamics.stiffness *= 6.0;
            Model::new(dynamics, &[]).unwrap()
        };
        run.track((Track::AngleClosedLoop, 90.0), asked);
        assert!(run.controller.pressure_setpoint() <= run.config.pressure_range.highest);
        let start = run.log.len();
        run.track((Track::AngleClosedLoop, 20.0), 20.0);
        run.log[start..]
            .iter()
            .rposition(|log| (log.1 - 20.0).abs() > 2.0)
            .unwrap()
    };
    let (short, long) = (settled(15.0), settled(90.0));
    assert!(long < short + 20, "{short} {long}");
    assert!(long < 1_300, "{long}");
}

#[test]
fn the_stroke_ends_before_the_syringe_does() {
    // So much air that the pressure is never reached.
    let mut run = Run::new(1e6);
    run.track((Track::Pressure, 150.0), 30.0);
    assert!(run.plant.plunger < 50_010.0, "{}", run.plant.plunger);
    run.track((Track::Pressure, 0.0), 30.0);
    assert!(run.plant.plunger > -10.0, "{}", run.plant.plunger);
}

proptest! {
    #[test]
    fn no_demand_and_no_reading_passes_a_limit(
        demands in prop::collection::vec((0..3usize, any::<f32>(), any::<f32>(), any::<f32>(), -1e5..1e5f32), 1..60),
    ) {
        let settings = Settings::DEFAULT;
        let (config, model) = (Config::of(&settings), base(&settings));
        let mut controller = Controller::new();
        let tracks = [Track::Pressure, Track::AngleOpenLoop, Track::AngleClosedLoop];
        for (track, level, pressure, angle, volume) in demands {
            let before = controller.pressure_setpoint();
            let measured = Measured { pressure, angle, volume };
            let flow = controller.track(&config, &model, (tracks[track], level), &measured);
            prop_assert!(limit::size(flow) <= config.pressure.max_flow, "{flow}");
            let setpoint = controller.pressure_setpoint();
            prop_assert!((0.0..=160_000.0).contains(&setpoint), "{setpoint}");
            prop_assert!(limit::size(setpoint - before) <= 20_001.0);
            let angle = controller.angle_setpoint();
            prop_assert!((0.0..=110.01 * RAD_PER_DEG).contains(&angle), "{angle}");
        }
    }
}
