//! Drift of the stiffness: K → K(1 + ρ t).
//!
//! ρ (1/s) is the share of the stiffness K that is gained each second, t (s) the
//! time since the start of the run: an elastomer that warms up, cures on or
//! fatigues. The factor is kept at zero or above; there it has a corner. In a
//! piece that was cut out of a longer run the drift starts anew, which is where
//! this is weak.

use super::{Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::actuator::Dynamics;
use crate::real::Real;

/// The time (s) up to which a step length is to resolve the stiffness.
const LONG_RUN: i16 = 60;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "stiffness_drift",
    title: "drift of the stiffness",
    place: Place::Force,
    equation: "K → K(1 + ρ t)",
    text: "The actuator becomes softer or stiffer during the run: it warms up, cures on, or \
           fatigues. The same step reaches another angle an hour later, in proportion to the \
           spring's force: at rest at zero there is no gap.",
    signature: "time in the run",
    look_alikes: &["maxwell_branch", "sensor_drift"],
};

parameters! {
    /// Drift of the stiffness.
    StiffnessDrift {
        /// Share ρ gained each second (1/s).
        rate: Parameter {
            key: "rate_per_s",
            symbol: "ρ",
            unit: Unit::PerSecond,
            lower: -0.125,
            upper: 0.125,
            held: None,
            starts: &[-0.3, 0.3],
        },
    }
}

impl<R: Real> Mechanism<R> for StiffnessDrift<R> {
    fn modulate(&self, at: &Instant<R>, _hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        let factor = (R::one() + self.rate * at.time).max(R::zero());
        dynamics.stiffness = dynamics.stiffness * factor;
    }

    fn enlarge(&self, _angle: R, dynamics: &mut Dynamics<R>) {
        let gained = self.rate.max(R::zero()) * R::from_i16(LONG_RUN);
        dynamics.stiffness = dynamics.stiffness * (R::one() + gained);
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// Heavily damped under a held force, the angle is F/K(1 + ρt), late by
    /// about C/K.
    #[test]
    fn slow_creep_is_the_inverse_of_the_stiffness() {
        let rate = -0.02;
        let drift = Kind::StiffnessDrift.build(&[rate]).unwrap();
        let model = spring(1e-3, 0.05, 2.0, &[drift]);
        let mut state = model.at_rest(0.5, 1.0);
        for count in 1..=5 {
            state = run(&model, state, &Held(1.0), 4.0, 20_000);
            let left = 1.0 + rate * 4.0 * f64::from(count);
            let late = 0.05 / (2.0 * left) * rate / left;
            let expected = 0.5 / left * (1.0 + late);
            assert!((state.angle - expected).abs() < 1e-5, "{}", state.angle);
        }
    }

    #[test]
    fn stiffness_never_turns_round() {
        let drift = Kind::StiffnessDrift.build(&[-0.1]).unwrap();
        let model = spring(1.0, 0.0, 3.0, &[drift]);
        let mut state = model.at_rest(0.5, 0.0);
        state.time = 50.0;
        assert!(model.derivative(&state, &Held(0.0), 0.0).acceleration.abs() < 1e-15);
    }
}
