//! Drift of the stiffness: K → K(1 + ρ t).
//!
//! An elastomer that warms up, cures on or fatigues: its stiffness K gains the share ρ (1/s) each
//! second. t (s) is the time on the rig's clock, which begins with the first recording after a
//! reset. In a piece of a session that does not say where it was cut from, the drift wrongly
//! starts anew.

use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::dynamics::Dynamics;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Preparation, Stiffened};
use crate::real::Real;

/// The time (s) up to which a step length is to resolve the stiffness.
const LONG_RUN: i16 = 60;

/// The least share of its stiffness that an actuator keeps.
const LEAST: f32 = 0.25;

/// The most that its stiffness grows to, in multiples of what it was.
const MOST: f32 = 4.0;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "stiffness_drift",
    title: "drift of the stiffness",
    place: Place::Force,
    equation: "K → K(1 + ρ t)",
    text: "The actuator becomes softer or stiffer during the run: it warms up, cures on, or \
           fatigues. The same step reaches another angle an hour later, in proportion to the \
           spring's force: at rest at zero there is no gap. The stiffness stays between a \
           quarter of its value and four times it.",
    signature: "time in the run",
    look_alikes: &["maxwell_branch", "sensor_drift"],
    family: Family::Drift,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
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
            default: None,
            starts: &[-0.3, 0.3],
        },
    }
}

impl<R: Real> StiffnessDrift<R> {
    /// The stiffness after `time` (s), in multiples of what it was.
    ///
    /// A straight line in time does not go on for ever. The factor 1 + ρ t stays between ¼ and 4:
    /// beyond them it is another actuator, one that has torn or has set, and no drift. Within them
    /// the line is exact; at them the factor has a corner, beyond which it no longer depends on ρ.
    fn factor(&self, time: R) -> R {
        let line = R::one() + self.rate * time;
        let most = R::from_f32(MOST);
        if line > most {
            return most;
        }
        line.max(R::from_f32(LEAST))
    }
}

impl<R: Real> Mechanism<R> for StiffnessDrift<R> {
    fn modulates(&self) -> bool {
        true
    }

    fn modulate(&self, at: &Instant<R>, _hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        dynamics.stiffness = dynamics.stiffness * self.factor(at.time);
    }

    fn enlarge(&self, _angle: R, dynamics: &mut Dynamics<R>) {
        let largest = self.factor(R::from_i16(LONG_RUN)).max(R::one());
        dynamics.stiffness = dynamics.stiffness * largest;
    }
}

impl Preparation for StiffnessDrift<f32> {
    const CYCLES: u16 = 1_900;
    type Part = Stiffened<Self>;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.05]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Stiffened(*self)
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

    /// The force of the spring at half a radian, over that without drift.
    fn factor(rate: f64, time: f64) -> f64 {
        let drift = Kind::StiffnessDrift.build(&[rate]).unwrap();
        let model = spring(1.0, 0.0, 3.0, &[drift]);
        let mut state = model.at_rest(0.5, 0.0);
        state.time = time;
        model.derivative(&state, &Held(0.0), 0.0).acceleration / (-3.0 * 0.5)
    }

    /// Beyond its limits an actuator is another one: it neither turns round nor
    /// grows without end. Before them the drift is a straight line.
    #[test]
    fn stiffness_stays_between_a_quarter_and_four_times_its_value() {
        for (rate, time, expected) in [
            (-0.01, 74.0, 0.26),
            (-0.01, 76.0, 0.25),
            (-0.1, 500.0, 0.25),
            (0.03, 99.0, 3.97),
            (0.03, 101.0, 4.0),
            (0.1, 500.0, 4.0),
        ] {
            let reached = factor(rate, time);
            assert!(
                (reached - expected).abs() < 1e-6,
                "{rate} {time}: {reached}"
            );
        }
    }

    /// A fit that has run into a limit still gets finite derivatives.
    #[test]
    fn derivatives_by_the_rate_are_finite_on_both_sides_of_a_limit() {
        let step = 1e-6;
        let slope = |rate: f64| (factor(rate + step, 100.0) - factor(rate, 100.0)) / step;
        assert!((slope(0.02) - 100.0).abs() < 1e-3);
        assert!(slope(0.04).abs() < 1e-3 && slope(-0.02).abs() < 1e-3);
    }
}
