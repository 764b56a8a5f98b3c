//! End stop: Q = k_s max(θ − θ_s, 0).
//!
//! Beyond the angle θ_s (rad) the actuator leans on something of stiffness k_s
//! (N/rad): its own folds, the table, a strain-limiting layer that has become
//! taut. One-sided and elastic; a slope with a corner at θ_s.

use super::table::Variable;
use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Forced, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "end_stop",
    title: "end stop",
    place: Place::Force,
    equation: "Q = k_s max(θ − θ_s, 0)",
    text: "Beyond a certain angle the actuator leans on something: the folds touch, a layer \
           becomes taut, the tip meets the table. Below that angle nothing is different; above \
           it every further degree costs more pressure, and the stop is there however slowly it \
           is approached.",
    signature: "large angles, on one side",
    look_alikes: &["cubic_stiffness"],
    family: Family::StiffnessShape,
    needs: &[],
    own_variable: Some(Variable::Angle),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// End stop.
    EndStop {
        /// Stiffness k_s of the stop (N/rad).
        stiffness: Parameter {
            key: "stiffness_n_per_rad",
            symbol: "k_s",
            unit: Unit::NewtonPerRad,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.5, 4.0],
        },
        /// Angle θ_s at which it begins (rad).
        angle: Parameter {
            key: "angle_rad",
            symbol: "θ_s",
            unit: Unit::Radian,
            lower: 0.0,
            upper: 4.0,
            held: None,
            default: None,
            starts: &[0.6, 1.0, 1.4],
        },
    }
}

impl<R: Real> Mechanism<R> for EndStop<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        self.stiffness * (at.angle - self.angle).max(R::zero())
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: self.stiffness / dynamics.inertia,
            relaxation: R::zero(),
        }
    }
}

impl Preparation for EndStop<f32> {
    const CYCLES: u16 = 1_600;
    type Part = Forced<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[4.0, 1.1], 0.02);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Forced(*self)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// A free mass that meets the stop swings half a period of the stop's own
    /// frequency and leaves with the rate turned round.
    #[test]
    fn free_mass_bounces_with_half_a_period_of_contact() {
        let (inertia, stiffness, angle, rate) = (0.4, 25.0, 0.5, 2.0);
        let stop = Kind::EndStop.build(&[stiffness, angle]).unwrap();
        let model = spring(inertia, 0.0, 0.0, &[stop]);
        let start = model.moving(angle, rate, 0.0);
        let quarter = core::f64::consts::FRAC_PI_2 * f64::sqrt(inertia / stiffness);
        let turn = run(&model, start, &Held(0.0), quarter, 1_000);
        let depth = rate * f64::sqrt(inertia / stiffness);
        assert!((turn.angle - angle - depth).abs() < 1e-11);
        assert!(turn.rate.abs() < 1e-10);
        let end = run(&model, turn, &Held(0.0), quarter, 1_000);
        assert!((end.angle - angle).abs() < 1e-10);
        assert!((end.rate + rate).abs() < 1e-9);
    }

    #[test]
    fn nothing_happens_below_the_stop() {
        let stop = Kind::EndStop.build(&[25.0, 0.5]).unwrap();
        let force = |angle| crate::effects::testing::force(&stop, angle, 0.0);
        assert!(force(0.49).abs() < 1e-15 && force(-2.0).abs() < 1e-15);
        assert!((force(0.7) - 5.0).abs() < 1e-12);
    }
}
