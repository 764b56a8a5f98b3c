//! Damping that depends on the angle: C → C(1 + c₁|θ|).
//!
//! C is the viscous damping of the base model (N·s/rad), θ the bending angle
//! (rad), c₁ (1/rad) the share by which the damping grows per radian. The wall
//! of a bent chamber shears more for the same rate, and its folds rub. The
//! factor is kept at zero or above: a damping that drives would be an engine.
//! |θ| has a corner at θ = 0.

use super::{Family, Hidden, Info, Instant, Mechanism, Parameter, Place, Unit, parameters};
use crate::catalogue::Effect;
use crate::dynamics::{Dynamics, Rates};
use crate::elementary::{MODERATE, decayed};
use crate::glide::decays;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "angle_dependent_damping",
    title: "damping that depends on the angle",
    place: Place::Force,
    equation: "C → C(1 + c₁|θ|)",
    text: "A bent actuator is damped differently from a straight one: its wall is strained, its \
           folds rub, its tube is squeezed. Swings of the same size about 60° and 90° decay at \
           different rates, whatever their amplitude.",
    signature: "angular velocity, more at some angles than at others",
    look_alikes: &["quadratic_damping", "maxwell_branch"],
    family: Family::RateDamping,
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
    /// Damping that depends on the angle.
    AngleDependentDamping {
        /// Growth c₁ of the damping (1/rad).
        slope: Parameter {
            key: "slope_per_rad",
            symbol: "c₁",
            unit: Unit::PerRadian,
            lower: -1.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[-0.4, 0.5, 2.0],
        },
    }
}

impl<R: Real> AngleDependentDamping<R> {
    fn factor(&self, angle: R) -> R {
        (R::one() + self.slope * angle.abs()).max(R::zero())
    }
}

impl<R: Real> Mechanism<R> for AngleDependentDamping<R> {
    fn modulates(&self) -> bool {
        true
    }

    fn modulate(&self, at: &Instant<R>, _hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        dynamics.damping = dynamics.damping * self.factor(at.angle);
    }

    fn enlarge(&self, angle: R, dynamics: &mut Dynamics<R>) {
        let factor = self.factor(angle).max(R::one());
        dynamics.damping = dynamics.damping * factor;
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        // While it moves, the force also has a slope along the angle. `dynamics`
        // holds the largest damping, so this is more than enough.
        let swing = (angle + R::one()) * R::half();
        Rates {
            stiffness: dynamics.damping * self.slope.abs() * swing / dynamics.inertia,
            relaxation: R::zero(),
        }
    }
}

impl Preparation for AngleDependentDamping<f32> {
    const CYCLES: u16 = 2_400;
    type Part = Damping;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[1.2]);

    fn prepare(&self, base: &Base) -> Self::Part {
        let dynamics = base.model.dynamics();
        let mut back = 1.0;
        for slot in base.model.occupied() {
            if let Effect::AsymmetricDamping(effect) = slot {
                back *= 1.0 + effect.ratio;
            }
        }
        let decay = dynamics.damping * base.flow.dt / dynamics.inertia;
        let [come, mean] = decays(decay);
        Damping {
            per_angle: 0.5 * self.slope * decay,
            decay,
            back,
            share: 1.0 - mean / come,
            undamped: 1.0 / come,
        }
    }

    fn brakes(&self, _dynamics: &Dynamics<f32>, _farthest: f32) -> Option<f32> {
        // It enlarges the damping itself.
        Some(0.0)
    }
}

/// The damping in the middle of a drift, constant in it: the exponential of its decay by a short
/// series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Half of C·c₁·h/M (1/rad).
    per_angle: f32,
    /// C·h/M.
    decay: f32,
    /// What else multiplies both on the way back.
    back: f32,
    /// The share of a small loss that the way has of it.
    share: f32,
    /// The way by which a rate that is not damped would go, of A.
    undamped: f32,
}

impl Part for Damping {
    fn phases(&self) -> Phases {
        Phases::BEFORE
    }

    #[inline(always)]
    fn before(&self, step: &mut Step, _memory: &mut Hidden<f32>) -> f32 {
        // In the middle of the way.
        let twice = step.angle + step.angle + step.moved;
        let mut more = twice.abs() * self.per_angle;
        if self.per_angle.is_sign_negative() {
            more = Real::max(more, -self.decay);
        }
        if step.moved.is_sign_negative() && self.back.to_bits() != 1.0_f32.to_bits() {
            more = (more + self.decay) * self.back - self.decay;
        }
        let lost = decayed(more);
        if more.abs().to_bits() < MODERATE {
            step.moved -= step.moved * (lost * self.share);
        } else {
            step.moved *= decays(self.decay + more)[0] * self.undamped;
        }
        lost
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// Without a spring, M dω/dθ = −C(1 + c₁θ): the rate falls by
    /// (C/M)(θ + c₁θ²/2) over the way θ.
    #[test]
    fn coasting_loses_rate_along_a_parabola_of_the_way() {
        let (inertia, damping, slope, rate) = (0.5, 0.3, 0.8, 2.0);
        let effect = Kind::AngleDependentDamping.build(&[slope]).unwrap();
        let model = spring(inertia, damping, 0.0, &[effect]);
        for duration in [0.3, 1.0, 3.0] {
            let start = model.moving(0.0, rate, 0.0);
            let end = run(&model, start, &Held(0.0), duration, 2_000);
            let way = end.angle + slope * end.angle * end.angle / 2.0;
            let expected = rate - damping / inertia * way;
            assert!((end.rate - expected).abs() < 1e-10, "{duration} s");
        }
    }

    #[test]
    fn damping_never_drives() {
        let effect = Kind::AngleDependentDamping.build(&[-1.0]).unwrap();
        let model = spring(1.0, 0.5, 0.0, &[effect]);
        let end = run(&model, model.moving(1.5, 0.7, 0.0), &Held(0.0), 1.0, 100);
        assert!((end.rate - 0.7).abs() < 1e-15, "{}", end.rate);
    }
}
