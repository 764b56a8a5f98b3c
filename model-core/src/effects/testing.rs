//! What the reference tests of the effects share.

use super::{Instant, Mechanism};
use crate::actuator::{Model, State};
use crate::catalogue::Effect;
use crate::dynamics::Dynamics;
use crate::input::Input;
use crate::integrate::{Scheme, step};

/// A linear spring with unit input gain and the given effects.
pub fn spring(inertia: f64, damping: f64, stiffness: f64, effects: &[Effect<f64>]) -> Model<f64> {
    let dynamics = Dynamics {
        inertia,
        damping,
        stiffness,
        exponent: 1.0,
        input_gain: 1.0,
    };
    Model::new(dynamics, effects).expect("test parameters are valid")
}

/// Runs RK4 for `duration` seconds in `steps` steps.
pub fn run(
    model: &Model<f64>,
    mut state: State<f64>,
    input: &impl Input<f64>,
    duration: f64,
    steps: u32,
) -> State<f64> {
    let dt = duration / f64::from(steps);
    for _ in 0..steps {
        step(Scheme::Rk4, model, &mut state, input, dt);
    }
    state
}

/// The force of an effect without hidden states.
pub fn force(effect: &Effect<f64>, angle: f64, rate: f64) -> f64 {
    let at = Instant {
        time: 0.0,
        angle,
        rate,
        pressure: 0.0,
    };
    effect.force(&at, &[0.0; 2], &mut [0.0; 2])
}
