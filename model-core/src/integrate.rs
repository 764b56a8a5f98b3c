//! Fixed-step integration, without allocation.
//!
//! Three schemes of order 1, 2 and 4 behind one `step(model, state, input,
//! dt)`. The board takes whichever its time budget allows; fits and references
//! take [`Scheme::Rk4`]. The paper uses an adaptive solver (MATLAB's ode45),
//! which neither runs in bounded time on a board nor gives smooth gradients.

use crate::actuator::{Derivative, Model, State};
use crate::input::Input;
use crate::power::Power;
use crate::real::Real;

/// An integration scheme.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Scheme {
    /// Semi-implicit (symplectic) Euler, order 1: one evaluation a step and no
    /// drift of the energy of an undamped oscillation.
    SemiImplicitEuler,
    /// Heun's method, order 2: two evaluations a step.
    Heun,
    /// The classical Runge–Kutta method, order 4: four evaluations a step.
    #[default]
    Rk4,
}

impl Scheme {
    /// The order of convergence: the error over a run shrinks with `dt^order`.
    pub const fn order(self) -> i32 {
        match self {
            Self::SemiImplicitEuler => 1,
            Self::Heun => 2,
            Self::Rk4 => 4,
        }
    }
}

/// Advances `state` by `dt` seconds.
pub fn step<R: Real, P: Power<R>>(
    scheme: Scheme,
    model: &Model<R, P>,
    state: &mut State<R>,
    input: &impl Input<R>,
    dt: R,
) {
    *state = match scheme {
        Scheme::SemiImplicitEuler => semi_implicit_euler(model, state, input, dt),
        Scheme::Heun => heun(model, state, input, dt),
        Scheme::Rk4 => rk4(model, state, input, dt),
    };
    model.note(state, input, dt);
}

fn semi_implicit_euler<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    input: &impl Input<R>,
    dt: R,
) -> State<R> {
    let mut slope = model.derivative(state, input, R::zero());
    slope.rate = state.rate + slope.acceleration * dt;
    advance(model, state, &slope, dt)
}

fn heun<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    input: &impl Input<R>,
    dt: R,
) -> State<R> {
    let k1 = model.derivative(state, input, R::zero());
    let k2 = model.derivative(&advance(model, state, &k1, dt), input, dt);
    let mut sum = k1;
    add(model, &mut sum, &k2);
    let mut next = advance(model, state, &sum, dt * R::half());
    next.time = state.time + dt;
    next
}

fn rk4<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    input: &impl Input<R>,
    dt: R,
) -> State<R> {
    let half = dt * R::half();
    let k1 = model.derivative(state, input, R::zero());
    let k2 = model.derivative(&advance(model, state, &k1, half), input, half);
    let k3 = model.derivative(&advance(model, state, &k2, half), input, half);
    let k4 = model.derivative(&advance(model, state, &k3, dt), input, dt);
    let mut middle = k2;
    add(model, &mut middle, &k3);
    let mut sum = k1;
    add(model, &mut sum, &middle);
    add(model, &mut sum, &middle);
    add(model, &mut sum, &k4);
    let mut next = advance(model, state, &sum, dt / R::from_i16(6));
    next.time = state.time + dt;
    next
}

fn advance<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    slope: &Derivative<R>,
    dt: R,
) -> State<R> {
    let mut next = *state;
    next.time += dt;
    next.angle += slope.rate * dt;
    next.rate += slope.acceleration * dt;
    if model.integrates() {
        // A memory of events has no rate and stays.
        for ((_, hidden), rates) in model.occupied().zip(&mut next.hidden).zip(&slope.hidden) {
            for (value, rate) in hidden.iter_mut().zip(rates) {
                *value += *rate * dt;
            }
        }
    }
    next
}

fn add<R: Real, P: Power<R>>(model: &Model<R, P>, sum: &mut Derivative<R>, term: &Derivative<R>) {
    sum.rate += term.rate;
    sum.acceleration += term.acceleration;
    if model.integrates() {
        for ((_, sum), term) in model.occupied().zip(&mut sum.hidden).zip(&term.hidden) {
            for (sum, term) in sum.iter_mut().zip(term) {
                *sum += *term;
            }
        }
    }
}
