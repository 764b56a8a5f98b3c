//! A load at the tip: Q = m·a·sin(κθ + θ₀ + φ), and the inertia m·a·λ/g₀.
//!
//! A weight of known size pulls by a known law, and its inertia by another: both move with one
//! lever, which no damping, lag or spring imitates at two loads. What hangs at the tip, m (kg),
//! belongs to a session and not to the actuator; its metadata (`[setup] tip_load_g`) give it.
//!
//! By itself a load of nothing does nothing: [`crate::actuator::Model::loaded`] puts a weight
//! ([`Gravity`]) and an inertia in its place, and that is what is simulated and what a board gets.

use super::gravity::Gravity;
use super::{Family, Info, Mechanism, Parameter, Place, Unit, parameters};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation};
use crate::real::Real;

/// κ of a load at the tip of an actuator that bends with constant curvature.
pub const BENDING: f32 = 2.0 / 3.0;

/// Standard gravity g₀ (m/s²).
const STANDARD_GRAVITY: f32 = 9.806_65;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "tip_load",
    title: "load at the tip",
    place: Place::Force,
    equation: "Q = m a sin(κθ + θ₀ + φ), M + m a λ/g₀",
    text: "A load at the tip pulls with the sine of the angle and adds inertia. Its mass is given \
           for each recording; the effect of a kilogram is estimated from all of them.",
    signature: "between recordings with different loads",
    look_alikes: &["gravity"],
    family: Family::Other,
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
    /// A load at the tip.
    ///
    /// a (N/kg) is the generalised force by a kilogram, λ (m) the lever of its weight and of its
    /// inertia, θ₀ the tilt of the base at which the angle was zeroed and φ its turn since.
    ///
    /// A rigid arm of length l has a torque m·g₀·l·sin θ and an inertia m·l², so that λ = l. An
    /// actuator of length l that bends with constant curvature has its tip at l(1 − cos θ)/θ aside,
    /// l·sin θ/θ below its base, so that near θ = 0 the torque is (m·g₀·l/2)·sin(⅔θ + φ) and the
    /// inertia m·l²/4: λ = l/2 and κ = ⅔ ([`BENDING`]). The torque is within 3 % of its largest up to
    /// 60°; the inertia is 13 % less at 90°, which is left out.
    TipLoad {
        /// Generalised force a of a kilogram (N/kg).
        force_per_mass: Parameter {
            key: "force_n_per_kg",
            symbol: "a",
            unit: Unit::NewtonPerKilogram,
            lower: -1_000.0,
            upper: 1_000.0,
            held: None,
            default: None,
            starts: &[10.0],
        },
        /// Lever λ (m).
        lever: Parameter {
            key: "lever_m",
            symbol: "λ",
            unit: Unit::Metre,
            lower: 0.0,
            upper: 10.0,
            held: None,
            default: Some(0.05),
            starts: &[0.05],
        },
        /// Share κ of the bending angle by which the load turns.
        angle_share: Parameter {
            key: "angle_share",
            symbol: "κ",
            unit: Unit::One,
            lower: 0.1,
            upper: 1.0,
            held: Some(BENDING),
            default: None,
            starts: &[],
        },
    }
}

impl<R: Real> TipLoad<R> {
    /// The weight of a load of `mass` (kg), on a base whose angle was zeroed at `tilt` (rad).
    #[must_use]
    pub fn weight(&self, mass: R, tilt: R) -> Gravity<R> {
        Gravity {
            weight: mass * self.force_per_mass,
            tilt: R::zero(),
            turned: tilt,
            angle_share: self.angle_share,
        }
    }

    /// What a load of `mass` (kg) adds to the inertia (kg·m).
    #[must_use]
    pub fn inertia(&self, mass: R) -> R {
        mass * self.force_per_mass.abs() * self.lever / R::from_f32(STANDARD_GRAVITY)
    }
}

impl<R: Real> Mechanism<R> for TipLoad<R> {}

impl Preparation for TipLoad<f32> {
    const CYCLES: u16 = 0;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[]);

    fn prepare(&self, _base: &Base) -> Nothing {
        Nothing
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, TAU};

    use super::*;
    use crate::actuator::Model;
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    const MASS_KG: f64 = 0.02;
    /// N/kg.
    const FORCE: f64 = 12.0;
    const LEVER_M: f64 = 0.06;

    fn with_load(share: f64) -> Model<f64> {
        let load = Kind::TipLoad.build(&[FORCE, LEVER_M, share]).unwrap();
        spring(1e-6, 0.0, 0.0, &[load])
    }

    /// Hardly any inertia but that of the load: a pendulum of the length λ, whose period is
    /// 4 √(λ/g₀) K(sin(θ₀/2)), with the complete elliptic integral from the arithmetic–geometric
    /// mean.
    #[test]
    fn a_load_on_a_rigid_arm_is_a_pendulum_of_its_lever() {
        let amplitude = 1.2f64;
        let model = with_load(1.0).loaded(MASS_KG);
        let (mut a, mut b) = (1.0, (amplitude / 2.0).cos());
        for _ in 0..8 {
            (a, b) = (f64::midpoint(a, b), f64::sqrt(a * b));
        }
        let ratio = model.dynamics().inertia / (MASS_KG * FORCE);
        assert!(
            (ratio / (LEVER_M / 9.806_65) - 1.0).abs() < 0.001,
            "{ratio}"
        );
        let period = TAU / a * ratio.sqrt();
        let start = model.at_rest(amplitude, 0.0);
        let end = run(&model, start, &Held(0.0), period, 4_000);
        assert!((end.angle - amplitude).abs() < 1e-8, "{}", end.angle);
    }

    /// Torque and inertia of a point at the tip of an arc, from its position alone.
    #[test]
    fn a_load_on_an_arc_pulls_and_swings_as_its_tip_moves() {
        let tip = |angle: f64| [(1.0 - angle.cos()) / angle, angle.sin() / angle];
        let step = 1e-5;
        let slope = |angle: f64| {
            let (after, before) = (tip(angle + step), tip(angle - step));
            [0, 1].map(|axis| (after[axis] - before[axis]) / (2.0 * step))
        };
        // In units of the length: λ = ½, so that a kilogram pulls with ½ g₀.
        let load = TipLoad {
            force_per_mass: 0.5,
            lever: 0.5,
            angle_share: f64::from(BENDING),
        };
        for tilt in [-FRAC_PI_2, 0.0, 0.7, FRAC_PI_2] {
            for angle in [-1.0, -0.4, 0.2, 0.6, FRAC_PI_3] {
                // The height of the tip in a frame that is turned by the tilt: at none it hangs
                // down, and bending lifts it.
                let [aside, below] = slope(angle);
                let torque = aside * tilt.sin() - below * tilt.cos();
                let weight = load.weight(1.0, tilt);
                let force = weight.weight * (weight.angle_share * angle + weight.turned).sin();
                assert!(
                    (force - torque).abs() < 0.03 * 0.5,
                    "{tilt} {angle}: {force} {torque}"
                );
            }
        }
        let inertia = |angle: f64| slope(angle).map(|it| it * it).iter().sum::<f64>();
        let constant = load.inertia(1.0) * f64::from(STANDARD_GRAVITY);
        assert!((inertia(1e-3) / constant - 1.0).abs() < 1e-4);
        assert!((inertia(FRAC_PI_2) / constant - 0.87).abs() < 0.005);
    }

    #[test]
    fn nothing_at_the_tip_changes_nothing_and_a_turn_turns_the_load() {
        let model = with_load(1.0);
        assert_eq!(model.loaded(0.0), model);
        let turned = model.loaded(MASS_KG).turned(FRAC_PI_2);
        let force = |model: &Model<f64>, angle: f64| {
            let at = model.at_rest(angle, 0.0);
            -model.derivative(&at, &Held(0.0), 0.0).acceleration * model.dynamics().inertia
        };
        assert!((force(&turned, 0.0) - MASS_KG * FORCE).abs() < 1e-12);
        assert!(force(&model.loaded(MASS_KG), 0.0).abs() < 1e-15);
        // Beside a weight whose angle was zeroed on a tilted base.
        let load = Kind::TipLoad.build(&[FORCE, LEVER_M, 1.0]).unwrap();
        let own = Kind::Gravity.build(&[0.3, 0.4, 0.0, 1.0]).unwrap();
        let both = spring(0.1, 0.0, 0.0, &[own, load]).loaded(MASS_KG);
        assert!((force(&both, 0.0) - MASS_KG * FORCE * 0.4f64.sin()).abs() < 1e-12);
    }
}
