//! Stribeck friction: Q = [T + ΔT e^(−(ω/ω_S)²)] tanh(ω/ω_s).
//!
//! T (N) is the friction at speed, ΔT (N) what is added near standstill, ω_S
//! (rad/s) the rate over which the addition fades, ω the angular rate. The
//! sign is smoothed over ω_s = ω_S/10, a tenth of the width of the peak, so that
//! the peak keeps 96 % of its height. Stribeck (1902), in the form of
//! Armstrong-Hélouvry, Dupont and Canudas de Wit (Automatica 30, 1994). Beyond
//! the peak the friction falls with the rate: a negative damping, which makes
//! slow motions stick and slip.

use super::table::Variable;
use super::{
    Family, Hidden, Info, Instant, Mechanism, Need, Parameter, Place, Sign, Unit, parameters,
};
use crate::actuator::Model;
use crate::catalogue::Kind;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation, RateLaw};
use crate::real::Real;

/// ω_S over ω_s.
const SHARPNESS: i16 = 10;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "stribeck_friction",
    title: "Stribeck friction",
    place: Place::Force,
    equation: "Q = [T + ΔT e^{−(ω/ω_S)²}] tanh(ω/ω_s), ω_s = ω_S/10",
    text: "Dry friction that is larger near standstill than in motion: surfaces that cling, a \
           lubricant that is squeezed out. Slow motions stick and slip instead of creeping, and \
           the last degrees before rest are not reached.",
    signature: "sign of angular velocity, most near standstill",
    look_alikes: &["coulomb_friction"],
    family: Family::DryFriction,
    needs: &[Need::Return],
    own_variable: Some(Variable::Rate),
    special_case: Some(Kind::CoulombFriction),
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: false,
    states: &[],
};

parameters! {
    /// Stribeck friction.
    StribeckFriction {
        /// Friction force T at speed (N).
        force: Parameter {
            key: "force_n",
            symbol: "T",
            unit: Unit::Newton,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.01, 0.1],
        },
        /// What is added near standstill, ΔT (N).
        extra_force: Parameter {
            key: "extra_force_n",
            symbol: "ΔT",
            unit: Unit::Newton,
            lower: 0.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[0.05],
        },
        /// Rate ω_S over which the addition fades (rad/s).
        stribeck: Parameter {
            key: "stribeck_rad_per_s",
            symbol: "ω_S",
            unit: Unit::RadianPerSecond,
            // 2⁻⁹ rad/s, a tenth of a degree a second.
            lower: 0.001_953_125,
            upper: 16.0,
            held: None,
            default: None,
            starts: &[0.05, 0.2],
        },
    }
}

impl<R: Real> Mechanism<R> for StribeckFriction<R> {
    fn force(&self, at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        let rate = at.rate / self.stribeck;
        let size = self.force + self.extra_force * (-(rate * rate)).exp();
        size * (rate * R::from_i16(SHARPNESS)).tanh()
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        let steepest = (self.force + self.extra_force) * R::from_i16(SHARPNESS);
        Rates {
            stiffness: R::zero(),
            relaxation: steepest / (self.stribeck * dynamics.inertia),
        }
    }

    /// Where the extra force falls the motion is unstable and has to be resolved as well:
    /// e⁻⁹ of it is left at 3ω_S.
    fn sign(&self, dynamics: &Dynamics<R>) -> Option<Sign<R>> {
        Some(Sign {
            width: self.stribeck / R::from_i16(SHARPNESS),
            saturated: self.stribeck * R::from_i16(3),
            relaxation: self.fastest_rate(dynamics, R::zero()).relaxation,
        })
    }
}

impl Preparation for StribeckFriction<f32> {
    const CYCLES: u16 = 1_250;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::with_corner(&[0.08, 0.08, 0.1], 0.12);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Nothing
    }

    fn rate_law(&self, model: &Model<f32>) -> Option<RateLaw> {
        RateLaw::of_sign(self, model)
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{force, run, spring};
    use crate::input::Held;

    #[test]
    fn force_is_odd_peaks_near_zero_and_falls_to_that_of_coulomb() {
        let friction = Kind::StribeckFriction.build(&[0.3, 0.2, 0.1]).unwrap();
        let at = |rate| force(&friction, 0.0, rate);
        assert!((at(1.0) - 0.3).abs() < 1e-12 && (at(-1.0) + 0.3).abs() < 1e-12);
        assert!(at(0.0).abs() < 1e-15);
        let expected = (0.3 + 0.2 * f64::exp(-0.25)) * 5f64.tanh();
        assert!((at(0.05) - expected).abs() < 1e-15);
        let peak = (1..400)
            .map(|k| at(f64::from(k) * 1e-3))
            .fold(0.0, f64::max);
        assert!(peak > 0.96 * 0.5 && peak < 0.5, "{peak}");
    }

    /// Fast enough all the time, it is a Coulomb friction: a straight line.
    #[test]
    fn fast_coasting_slows_evenly() {
        let friction = Kind::StribeckFriction.build(&[0.3, 0.2, 0.05]).unwrap();
        let model = spring(0.5, 0.0, 0.0, &[friction]);
        let end = run(&model, model.moving(0.0, 3.0, 0.0), &Held(0.0), 2.0, 1_000);
        assert!((end.rate - (3.0 - 0.3 / 0.5 * 2.0)).abs() < 1e-12);
    }
}
