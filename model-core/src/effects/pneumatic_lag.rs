//! Pneumatic lag: τ ṗ_c = p − p_c.
//!
//! Tube and fittings fill the chamber through a resistance: the chamber
//! pressure p_c (Pa) follows the measured line pressure p with the time
//! constant τ (s) of that resistance and the chamber's capacity.

use super::{
    Change, Family, Hidden, Info, Mechanism, Parameter, Place, Rest, State, Unit, parameters,
};
use crate::carried::Lag;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "pneumatic_lag",
    title: "pneumatic lag",
    place: Place::Input,
    equation: "τ ṗ_c = p − p_c",
    text: "The pressure sensor sits in the line, the actuator feels the chamber, and the tube \
           between them takes time to fill. The measured angle follows every edge of the pressure \
           late and rounded; slow parts and rest angles are unaffected.",
    signature: "time since the last command edge",
    look_alikes: &["dead_time", "sensor_lag"],
    family: Family::InputPath,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[Change::LongerTube],
    doubtful: &[],
    has_slope: true,
    states: &[State {
        key: "chamber_pa",
        text: "p_c, pressure (Pa)",
    }],
};

parameters! {
    /// Pneumatic lag.
    PneumaticLag {
        /// Time constant τ (s).
        time_constant: Parameter {
            key: "time_constant_s",
            symbol: "τ",
            unit: Unit::Second,
            // 2⁻⁹ s, which f32 and f64 hold alike.
            lower: 0.001_953_125,
            upper: 100.0,
            held: None,
            default: None,
            starts: &[0.05, 0.3],
        },
    }
}

impl<R: Real> Mechanism<R> for PneumaticLag<R> {
    fn lengthen_tube(&mut self, times: R) {
        self.time_constant = self.time_constant * times;
    }

    fn integrates(&self) -> bool {
        true
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.pressure, R::zero()]
    }

    fn input(&self, pressure: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        rates[0] = (pressure - hidden[0]) / self.time_constant;
        hidden[0]
    }

    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: R::zero(),
            relaxation: R::one() / self.time_constant,
        }
    }
}

impl Preparation for PneumaticLag<f32> {
    const CYCLES: u16 = 1_250;
    type Part = Tube;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.06]);

    fn prepare(&self, base: &Base) -> Self::Part {
        Tube(Lag::new(self.time_constant, base.flow.dt))
    }
}

/// Follows the pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tube(Lag<f32>);

impl Part for Tube {
    fn phases(&self) -> Phases {
        Phases::BEFORE
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        [step.chamber, step.chamber]
    }

    #[inline(always)]
    fn before(&self, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        step.chamber = self.0.follow(memory, step.chamber);
        0.0
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::{FromFn, Held};
    use crate::integrate::{Scheme, step};

    /// A free mass under a lagged step: M θ̈ = 1 − e^(−t/τ).
    #[test]
    fn free_mass_integrates_the_lagged_step_twice() {
        let tau = 0.3;
        let lag = Kind::PneumaticLag.build(&[tau]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[lag]);
        let end = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), 2.0, 4_000);
        let decay = f64::exp(-2.0 / tau);
        assert!((end.rate - (2.0 - tau * (1.0 - decay))).abs() < 1e-9);
        assert!((end.angle - (2.0 - 2.0 * tau + tau * tau * (1.0 - decay))).abs() < 1e-9);
    }

    /// A ramp arrives late by exactly τ once the start has died away.
    #[test]
    fn ramp_is_late_by_the_time_constant() {
        let lag = Kind::PneumaticLag.build(&[0.2]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[lag]);
        let mut state = model.at_rest(0.0, 0.0);
        for count in 0..4_000 {
            let start = f64::from(count) * 1e-3;
            let ramp = FromFn(|offset: f64| start + offset);
            step(Scheme::default(), &model, &mut state, &ramp, 1e-3);
        }
        assert!((state.hidden[0][0] - (4.0 - 0.2)).abs() < 1e-6);
    }
}
