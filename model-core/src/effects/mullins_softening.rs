//! Mullins softening: K → K[1 − δ(1 − e^(−θ_max/θ_m))].
//!
//! Filled elastomers soften on their first stretch and remember it (Mullins, Rubber Chem.
//! Technol. 42, 1969; the exponential form is the usual one-parameter damage function). So a
//! share of the stiffness K is lost for good with the largest |θ| so far, θ_max (rad).

use super::{
    Change, Doubtful, Family, Hidden, Info, Instant, Mechanism, Need, Parameter, Place, Rest,
    State, Unit, parameters,
};
use crate::dynamics::Dynamics;
use crate::elementary::{decayed, exp};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "mullins_softening",
    title: "softening by the first stretch (Mullins)",
    place: Place::Force,
    equation: "K → K[1 − δ(1 − e^{−θ_max/θ_m})]",
    text: "The elastomer loses a part of its stiffness where it is stretched further than ever \
           before in the run. The first bend to a new largest angle needs more pressure than all \
           later ones to the same angle; cycling the actuator before a run removes it.",
    signature: "largest angle so far",
    look_alikes: &["stiffness_drift", "maxwell_branch"],
    family: Family::FirstStretch,
    needs: &[Need::Return],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[Change::Rested],
    doubtful: &[Doubtful::LoadedOnce],
    has_slope: true,
    states: &[State {
        key: "largest_rad",
        text: "θ_max, largest angle so far (rad)",
    }],
};

parameters! {
    /// Mullins softening.
    ///
    /// θ_max is a memory of events: after each step it is raised to |θ|, and within a step the larger
    /// of the two counts. The force is continuous; its slope has a corner where a swing passes the
    /// old maximum.
    MullinsSoftening {
        /// Share δ of the stiffness that can be lost.
        loss: Parameter {
            key: "loss",
            symbol: "δ",
            unit: Unit::One,
            lower: 0.0,
            upper: 1.0,
            held: None,
            default: None,
            starts: &[0.1, 0.4],
        },
        /// Angle θ_m (rad) over which it is lost.
        angle: Parameter {
            key: "angle_rad",
            symbol: "θ_m",
            unit: Unit::Radian,
            lower: 0.031_25,
            upper: 8.0,
            held: None,
            default: None,
            starts: &[0.3, 1.0],
        },
    }
}

impl<R: Real> Mechanism<R> for MullinsSoftening<R> {
    /// A session starts with θ_max = |θ|, as if the actuator had never bent further. That is wrong
    /// for the second session of a day, and for a piece that does not say where it was cut from.
    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.angle.abs(), R::zero()]
    }

    fn modulates(&self) -> bool {
        true
    }

    fn modulate(&self, at: &Instant<R>, hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        let largest = hidden[0].max(at.angle.abs());
        let lost = self.loss * (R::one() - (-largest / self.angle).exp());
        dynamics.stiffness = dynamics.stiffness * (R::one() - lost);
    }

    #[cfg(feature = "desktop")]
    fn enlarge(&self, angle: R, dynamics: &mut Dynamics<R>) {
        // The slope n K aⁿ⁻¹ grows with the angle a, what is left of K falls: in each part of the
        // range their product is at most the slope at its end times what is left at its beginning.
        const PARTS: i16 = 8;
        let steepness = (dynamics.exponent - R::one()).max(R::zero());
        let share = |part: i16| R::from_i16(part) / R::from_i16(PARTS);
        if steepness == R::zero() {
            return;
        }
        let most = (0..PARTS).fold(R::zero(), |most, part| {
            let lost = self.loss * (R::one() - (-(angle.abs() * share(part)) / self.angle).exp());
            most.max(share(part + 1).power_of_positive(steepness) * (R::one() - lost))
        });
        dynamics.stiffness = dynamics.stiffness * most;
    }

    fn has_memory(&self) -> bool {
        true
    }

    fn note(&self, angle: R, _pressure: R, hidden: &mut Hidden<R>) {
        hidden[0] = hidden[0].max(angle.abs());
    }
}

impl Preparation for MullinsSoftening<f32> {
    const CYCLES: u16 = 2_400;
    type Part = Softening;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[0.4, 0.5], 0.02);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Softening {
            loss: self.loss,
            per_angle: 1.0 / self.angle,
        }
    }

    fn recall(&self, _base: &Base, _step: &Step, hidden: Hidden<f32>, memory: &mut Hidden<f32>) {
        *memory = [hidden[0], exp(-hidden[0] / self.angle)];
    }
}

/// Multiplies the stiffness by 1 − δ(1 − e^(−m/θ_m)). It remembers m, the largest angle so far,
/// and the exponential, which grows on by the short way that is new.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softening {
    /// δ.
    loss: f32,
    /// 1/θ_m (1/rad).
    per_angle: f32,
}

impl Part for Softening {
    fn phases(&self) -> Phases {
        Phases::AFTER
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        let largest = step.angle.abs();
        [largest, exp(-largest * self.per_angle)]
    }

    #[inline(always)]
    fn force(&self, _base: &Base, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        let size = step.angle.abs();
        // Neither is negative.
        if size.to_bits() > memory[0].to_bits() {
            let more = (size - memory[0]) * self.per_angle;
            *memory = [size, memory[1] - memory[1] * decayed(more)];
        }
        step.pull -= step.pull * (self.loss - self.loss * memory[1]);
        0.0
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// Released from rest at A, the actuator swings in a spring that is softer
    /// by what A cost: the memory does not grow, and the period is that of the
    /// softened spring.
    #[test]
    fn free_swing_has_the_period_of_the_softened_spring() {
        let (inertia, stiffness, loss, scale, amplitude) = (0.4, 3.0, 0.4, 0.5, 0.8);
        let effect = Kind::MullinsSoftening.build(&[loss, scale]).unwrap();
        let model = spring(inertia, 0.0, stiffness, &[effect]);
        let left = stiffness * (1.0 - loss * (1.0 - f64::exp(-amplitude / scale)));
        let period = core::f64::consts::TAU * f64::sqrt(inertia / left);
        let start = model.at_rest(-amplitude, 0.0);
        let end = run(&model, start, &Held(0.0), period, 4_000);
        assert!((end.angle + amplitude).abs() < 1e-10, "{}", end.angle);
        assert!((end.hidden[0][0] - amplitude).abs() < 1e-10);
    }

    /// What steps have to resolve is no less than the slope of the spring anywhere, and where nearly
    /// everything is lost far less than without the loss.
    #[cfg(feature = "desktop")]
    #[test]
    fn the_fastest_swing_is_bounded_by_what_is_left() {
        use crate::actuator::Model;
        use crate::dynamics::Dynamics;
        let (inertia, stiffness, farthest) = (0.4, 3.0, 1.6);
        for (exponent, loss, scale, most) in [
            (2.4, 0.99, 0.04, 0.1),
            (1.3, 0.5, 0.5, 1.0),
            (1.0, 0.9, 0.1, 1.0),
        ] {
            let dynamics = Dynamics {
                inertia,
                damping: 0.1,
                stiffness,
                exponent,
                input_gain: 1e-4,
            };
            let effect = Kind::MullinsSoftening.build(&[loss, scale]).unwrap();
            let model: Model<f64> = Model::new(dynamics, &[effect]).unwrap();
            let bound = inertia * model.fastest_swing(farthest);
            let slope = |angle: f64| stiffness * exponent * f64::powf(angle, exponent - 1.0);
            let left = |angle: f64| 1.0 - loss * (1.0 - f64::exp(-angle / scale));
            let steepest = (1..=1_000)
                .map(|k| farthest * f64::from(k) / 1e3)
                .map(|angle| slope(angle) * left(angle))
                .fold(0.0, f64::max);
            assert!(bound >= steepest, "{bound} {steepest}");
            assert!(bound <= most * slope(farthest) * (1.0 + 1e-12), "{bound}");
        }
    }

    #[test]
    fn largest_angle_of_either_sign_is_remembered() {
        let effect = Kind::MullinsSoftening.build(&[0.4, 0.5]).unwrap();
        let model = spring(0.4, 0.1, 3.0, &[effect]);
        let mut state = model.at_rest(0.2, 0.0);
        for (angle, largest) in [(0.5, 0.5), (-0.9, 0.9), (0.7, 0.9), (0.0, 0.9)] {
            state.angle = angle;
            model.note(&mut state, &Held(0.0), 0.0);
            assert!((state.hidden[0][0] - largest).abs() < 1e-15);
        }
    }
}
