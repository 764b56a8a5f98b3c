//! Damping that differs between the directions: C → C(1 + a) where ω < 0.
//!
//! C is the viscous damping of the base model (N·s/rad), ω the angular rate
//! (rad/s), a the share by which the damping is larger on the way back. The
//! force C ω is continuous at ω = 0, its slope is not.

use super::table::Variable;
use super::{Family, Hidden, Info, Instant, Mechanism, Need, Parameter, Place, Unit, parameters};
use crate::actuator::Model;
use crate::catalogue::Effect;
use crate::dynamics::Dynamics;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation, RateLaw};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "asymmetric_damping",
    title: "damping that differs between the directions",
    place: Place::Force,
    equation: "C → C(1 + a) where ω < 0",
    text: "Bending and returning are damped differently: the elastomer dissipates differently in \
           loading and unloading, or the air leaves by a different path. Rising and falling edges \
           need different damping; rest angles are not affected.",
    signature: "angular velocity, on one side of zero",
    look_alikes: &["vent_asymmetry"],
    family: Family::RateDamping,
    needs: &[Need::Return],
    own_variable: Some(Variable::Rate),
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Damping that differs between the directions.
    AsymmetricDamping {
        /// Share a by which the damping is larger where ω < 0.
        ratio: Parameter {
            key: "ratio",
            symbol: "a",
            unit: Unit::One,
            lower: -1.0,
            upper: f32::INFINITY,
            held: None,
            default: None,
            starts: &[-0.5, 0.5, 2.0],
        },
    }
}

impl<R: Real> Mechanism<R> for AsymmetricDamping<R> {
    fn modulates(&self) -> bool {
        true
    }

    fn modulate(&self, at: &Instant<R>, _hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        if at.rate < R::zero() {
            dynamics.damping = dynamics.damping * (R::one() + self.ratio);
        }
    }

    fn enlarge(&self, _angle: R, dynamics: &mut Dynamics<R>) {
        let factor = R::one() + self.ratio.max(R::zero());
        dynamics.damping = dynamics.damping * factor;
    }
}

impl Preparation for AsymmetricDamping<f32> {
    const CYCLES: u16 = 1_250;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[1.5]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Nothing
    }

    /// Unless another damping multiplies it, which then has it in its part.
    fn rate_law(&self, model: &Model<f32>) -> Option<RateLaw> {
        let multiplied = model
            .occupied()
            .any(|slot| matches!(slot, Effect::AngleDependentDamping(_)));
        (!multiplied).then_some(RateLaw {
            // A straight line on either side, however far.
            farthest: 0.0,
            sided: true,
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// Without a spring the rate dies away as e^(−Ct/M) one way and as
    /// e^(−C(1+a)t/M) the other.
    #[test]
    fn coasting_dies_away_differently_in_the_two_directions() {
        let (inertia, damping, ratio) = (0.5, 0.3, 1.5);
        let effect = Kind::AsymmetricDamping.build(&[ratio]).unwrap();
        let model = spring(inertia, damping, 0.0, &[effect]);
        for (rate, damping) in [(2.0, damping), (-2.0, damping * (1.0 + ratio))] {
            let end = run(&model, model.moving(0.0, rate, 0.0), &Held(0.0), 0.7, 1_000);
            let expected = rate * f64::exp(-damping / inertia * 0.7);
            assert!((end.rate - expected).abs() < 1e-12, "{rate}");
        }
    }
}
