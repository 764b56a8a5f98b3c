//! A simple rig for tests: a syringe, a tube, an actuator, two sensors.

extern crate std;

use model_core::{
    actuator::{Model, State},
    dynamics::Dynamics,
    input::Held,
    integrate::{Scheme, step},
};
use wire::settings::{Key, Settings};

use crate::{
    design::{OVERSAMPLING, PERIOD_MS, PERIOD_S},
    io::{Inputs, Outputs, Oversampled, Pump, Valve},
};

const ATMOSPHERE_PA: f64 = 101_325.0;

/// Substeps of a control period.
const PARTS: u16 = 10;

/// The rig.
#[allow(clippy::struct_excessive_bools)] // What may be broken.
pub struct Plant {
    pub settings: Settings,
    pub model: Model<f64>,
    pub state: State<f64>,
    /// Gas in the chamber: its volume (µl) at atmospheric pressure.
    pub gas: f64,
    /// Volume (µl) of everything with the plunger retracted.
    pub volume: f64,
    /// Plunger (µl) from the switch.
    pub plunger: f64,
    pub flow: f64,
    /// Position (µl) that the counter calls zero.
    pub zero: f64,
    pub pressure: f64,
    pub time_ms: u32,
    /// Faults to inject.
    pub disconnected_tube: bool,
    pub emergency_stop: bool,
    /// The board's supply (V).
    pub supply_v: f64,
    pub pushed_end: bool,
    /// Where the pushed-in switch closes (µl).
    pub far_switch: f64,
    pub pressure_counts: Option<f64>,
    pub flex_counts: Option<f64>,
    pub blocked_motor: bool,
    pub retracted_end: Option<bool>,
    pub overruns: u8,
    pub outputs: Outputs,
    /// A small generator of noise.
    pub noise_counts: f64,
    seed: u32,
}

pub fn dynamics(settings: &Settings) -> Dynamics<f64> {
    Dynamics {
        inertia: settings.number(Key::Inertia),
        damping: settings.number(Key::Damping),
        stiffness: settings.number(Key::Stiffness),
        exponent: settings.number(Key::Exponent),
        input_gain: settings.number(Key::InputGain),
    }
    .map(f64::from)
}

/// Sixteen conversions of the processor's reference by a supply (V).
pub fn supply(volts: f64) -> Oversampled {
    Oversampled((1.1 / volts * 1024.0).round() as u16 * OVERSAMPLING)
}

impl Plant {
    pub fn new(volume_ul: f64, plunger_ul: f64) -> Self {
        let settings = Settings::DEFAULT;
        let model = Model::new(dynamics(&settings), &[]).unwrap();
        Self {
            state: model.at_rest(0.0, 0.0),
            model,
            settings,
            gas: volume_ul - plunger_ul,
            volume: volume_ul,
            plunger: plunger_ul,
            flow: 0.0,
            zero: 0.0,
            pressure: 0.0,
            time_ms: 0,
            disconnected_tube: false,
            emergency_stop: false,
            supply_v: 5.0,
            pushed_end: false,
            far_switch: 57_000.0,
            pressure_counts: None,
            flex_counts: None,
            blocked_motor: false,
            retracted_end: None,
            overruns: 0,
            outputs: Outputs::default(),
            noise_counts: 0.5,
            seed: 1,
        }
    }

    fn setting(&self, key: Key) -> f64 {
        f64::from(self.settings.number(key))
    }

    /// Lets a control period pass under `outputs`.
    pub fn step(&mut self, outputs: &Outputs) {
        self.outputs = *outputs;
        let per_step = self.setting(Key::VolumePerStep);
        if let Some(steps) = outputs.set_steps {
            self.zero = self.plunger - f64::from(steps) * per_step;
        }
        let dt = f64::from(PERIOD_S) / f64::from(PARTS);
        for _ in 0..PARTS {
            let wanted = match outputs.pump {
                Pump::Off | Pump::Brake => {
                    self.flow = 0.0;
                    0.0
                }
                Pump::Rate(rate) => f64::from(rate) * per_step,
            };
            let change = self.setting(Key::MaxFlowRate) * dt;
            self.flow += (wanted - self.flow).clamp(-change, change);
            if !self.blocked_motor {
                self.plunger = (self.plunger + self.flow * dt).clamp(-1_000.0, 58_000.0);
            }
            let volume = self.volume - self.plunger;
            if outputs.valve == Valve::Open || self.disconnected_tube {
                self.gas += (volume - self.gas) * (dt / 0.1).min(1.0);
            }
            self.pressure = ATMOSPHERE_PA * (self.gas / volume - 1.0);
            step(
                Scheme::Rk4,
                &self.model,
                &mut self.state,
                &Held(self.pressure),
                dt,
            );
        }
        self.time_ms += u32::from(PERIOD_MS);
    }

    fn noise(&mut self) -> f64 {
        self.seed = self
            .seed
            .wrapping_mul(1_664_525)
            .wrapping_add(1_013_904_223);
        f64::from(self.seed >> 8) / f64::from(1_u32 << 24) - 0.5
    }

    /// Sixteen conversions with noise, summed.
    fn convert(&mut self, counts: f64) -> Oversampled {
        let mut sum = 0;
        for _ in 0..OVERSAMPLING {
            let noise = 2.0 * self.noise_counts * self.noise();
            sum += (counts + noise).round().clamp(0.0, 1023.0) as u16;
        }
        Oversampled(sum)
    }

    /// The board's inputs at the start of the next period.
    pub fn inputs(&mut self) -> Inputs {
        let pressure = self.pressure_counts.unwrap_or(
            self.setting(Key::PressureZero)
                + self.pressure / 1_000.0 / self.setting(Key::PressureSpan),
        );
        let degrees = self.model.reading(&self.state).to_degrees();
        let kilohm = 25.0 * (70.0_f64 / 25.0).powf(degrees / 90.0);
        let flex = self.flex_counts.unwrap_or(1024.0 * 47.0 / (47.0 + kilohm));
        let moved = (self.plunger - self.zero) / self.setting(Key::VolumePerStep);
        Inputs {
            time_ms: self.time_ms,
            pressure: self.convert(pressure),
            flex: self.convert(flex),
            supply: supply(self.supply_v),
            retracted_end: self.retracted_end.unwrap_or(self.plunger <= 0.0),
            pushed_end: self.pushed_end || self.plunger >= self.far_switch,
            emergency_stop: self.emergency_stop,
            steps: moved.round() as i32,
            overruns: self.overruns,
        }
    }
}
