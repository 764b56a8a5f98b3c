//! Lag that differs between filling and venting: ṗ_c = (p − p_c)/τ, with τ_fill
//! where p > p_c and τ_vent where p < p_c.
//!
//! p is the measured line pressure and p_c the chamber's (Pa); the two time
//! constants (s) differ where air flows in through a pump or a valve and out
//! through another opening. The flow p − p_c is continuous at zero, its slope is
//! not.

use super::{
    Change, Family, Hidden, Info, Mechanism, Need, Parameter, Place, Rest, State, Unit, parameters,
};
use crate::carried::Lag;
use crate::catalogue::Kind;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "vent_asymmetry",
    title: "lag that differs between filling and venting",
    place: Place::Input,
    equation: "τ ṗ_c = p − p_c, τ = τ_fill where p > p_c, else τ_vent",
    text: "The chamber fills at one speed and empties at another: a pump pushes the air in, and \
           it leaves through a narrow vent. Rising and falling edges have different delays; slow \
           parts and rest angles are not affected.",
    signature: "time since the last command edge, up and down apart",
    look_alikes: &["asymmetric_damping"],
    family: Family::InputPath,
    needs: &[Need::Return],
    own_variable: None,
    special_case: Some(Kind::PneumaticLag),
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
    /// Lag that differs between filling and venting.
    VentAsymmetry {
        /// Time constant τ_fill of filling (s).
        fill: Parameter {
            key: "fill_s",
            symbol: "τ_fill",
            unit: Unit::Second,
            // 2⁻⁹ s, which f32 and f64 hold alike.
            lower: 0.001_953_125,
            upper: 100.0,
            held: None,
            default: None,
            starts: &[0.1],
        },
        /// Time constant τ_vent of venting (s).
        vent: Parameter {
            key: "vent_s",
            symbol: "τ_vent",
            unit: Unit::Second,
            lower: 0.001_953_125,
            upper: 100.0,
            held: None,
            default: None,
            starts: &[0.1, 0.5],
        },
    }
}

impl<R: Real> Mechanism<R> for VentAsymmetry<R> {
    fn lengthen_tube(&mut self, times: R) {
        self.fill = self.fill * times;
        self.vent = self.vent * times;
    }

    fn integrates(&self) -> bool {
        true
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.pressure, R::zero()]
    }

    fn input(&self, pressure: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        let [chamber, _] = *hidden;
        let time_constant = if pressure < chamber {
            self.vent
        } else {
            self.fill
        };
        rates[0] = (pressure - chamber) / time_constant;
        chamber
    }

    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: R::zero(),
            relaxation: (R::one() / self.fill).max(R::one() / self.vent),
        }
    }
}

impl Preparation for VentAsymmetry<f32> {
    const CYCLES: u16 = 1_600;
    type Part = Vent;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[0.05, 0.3], 0.02);

    fn prepare(&self, base: &Base) -> Self::Part {
        Vent {
            fill: Lag::new(self.fill, base.flow.dt),
            vent: Lag::new(self.vent, base.flow.dt),
        }
    }
}

/// Follows the pressure up and down at different speeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vent {
    fill: Lag<f32>,
    vent: Lag<f32>,
}

impl Part for Vent {
    fn phases(&self) -> Phases {
        Phases::BEFORE
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        [step.chamber, step.chamber]
    }

    #[inline(always)]
    fn before(&self, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        let [here, before] = *memory;
        let falls = before + step.chamber < here + here;
        let lag = if falls { self.vent } else { self.fill };
        step.chamber = lag.follow(memory, step.chamber);
        0.0
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    #[test]
    fn chamber_fills_and_empties_with_its_own_time_constants() {
        let (fill, vent) = (0.2, 0.7);
        let lag = Kind::VentAsymmetry.build(&[fill, vent]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[lag]);
        let full = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), 0.5, 1_000);
        let filled = 1.0 - f64::exp(-0.5 / fill);
        assert!((full.hidden[0][0] - filled).abs() < 1e-12);
        let empty = run(&model, full, &Held(0.0), 0.5, 1_000);
        let left = filled * f64::exp(-0.5 / vent);
        assert!((empty.hidden[0][0] - left).abs() < 1e-12);
    }
}
