//! Fixed-step integration, without allocation.
//!
//! Three schemes of order 1, 2 and 4 behind one `step(model, state, input,
//! dt)`. The board takes whichever its time budget allows; fits and references
//! take [`Scheme::Rk4`]. The paper uses an adaptive solver (MATLAB's ode45),
//! which neither runs in bounded time on a board nor gives smooth gradients.

use crate::actuator::{Derivative, Model, State};
use crate::effects::Instant;
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
    /// Heun's method about the exact decay e^(−Ct/M) of the rate, order 2: two evaluations a step,
    /// however strong the damping is (exponential time differencing, Cox and Matthews, J. Comput.
    /// Phys. 176, 2002, Eqs. 20–22). Needs a damping above zero; for overdamped actuators, where
    /// the other schemes would have to resolve a decay that does not show.
    ExponentialHeun,
}

impl Scheme {
    /// The order of convergence: the error over a run shrinks with `dt^order`.
    pub const fn order(self) -> i32 {
        match self {
            Self::SemiImplicitEuler => 1,
            Self::Heun | Self::ExponentialHeun => 2,
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
        Scheme::Rk4 => {
            if model.integrates() {
                rk4(model, state, input, dt);
            } else {
                rk4_of_motion(model, state, input, dt);
            }
            model.note(state, input, dt);
            return;
        }
        Scheme::ExponentialHeun => {
            let decay = model.dynamics().damping / model.dynamics().inertia;
            return step_about(decay, model, state, input, dt);
        }
    };
    model.note(state, input, dt);
}

/// As [`step`] with [`Scheme::ExponentialHeun`], about a decay (1/s) of the rate by more than the
/// damping: a friction that sticks adds a strong one.
pub fn step_about<R: Real, P: Power<R>>(
    decay: R,
    model: &Model<R, P>,
    state: &mut State<R>,
    input: &impl Input<R>,
    dt: R,
) {
    if model.integrates() {
        *state = exponential_heun(model, state, input, dt, decay);
    } else {
        exponential_heun_of_motion(model, state, input, dt, decay);
    }
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

fn exponential_heun<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    input: &impl Input<R>,
    dt: R,
    decay: R,
) -> State<R> {
    let time_constant = R::one() / decay;
    // The ways of a unit rate that decays freely and of a unit acceleration.
    let coasting = (R::one() - (-(decay * dt)).exp()) * time_constant;
    let pushed = (dt - coasting) * time_constant;

    let k1 = model.derivative(state, input, R::zero());
    let push = k1.acceleration + decay * state.rate;
    let mut predicted = advance(model, state, &k1, dt);
    predicted.rate = state.rate + (push - decay * state.rate) * coasting;
    predicted.angle = state.angle + state.rate * coasting + push * pushed;

    // The push changes linearly with time.
    let k2 = model.derivative(&predicted, input, dt);
    let growth = (k2.acceleration + decay * predicted.rate - push) / dt;
    let mut sum = k1;
    add(model, &mut sum, &k2);
    let mut next = advance(model, state, &sum, dt * R::half());
    next.time = state.time + dt;
    next.rate = predicted.rate + growth * pushed;
    next.angle = predicted.angle + growth * (dt * dt * R::half() - pushed) * time_constant;
    next
}

fn rk4<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &mut State<R>,
    input: &impl Input<R>,
    dt: R,
) {
    let half = dt * R::half();
    // In place: with derivatives a state and a rate of change are a kilobyte each.
    let mut sum = Derivative::zero();
    model.derive(state, input, R::zero(), &mut sum);
    let mut stage = *state;
    move_on(model, state, &sum, half, &mut stage);
    let mut middle = Derivative::zero();
    model.derive(&stage, input, half, &mut middle);
    move_on(model, state, &middle, half, &mut stage);
    let mut last = Derivative::zero();
    model.derive(&stage, input, half, &mut last);
    move_on(model, state, &last, dt, &mut stage);
    add(model, &mut middle, &last);
    model.derive(&stage, input, dt, &mut last);
    add(model, &mut sum, &middle);
    add(model, &mut sum, &middle);
    add(model, &mut sum, &last);
    move_on(model, state, &sum, dt / R::from_i16(6), &mut stage);
    stage.time = state.time + dt;
    *state = stage;
}

/// θ̈ at an angle and a rate, `offset` seconds into a step, where no hidden state is
/// integrated.
#[inline]
fn acceleration<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    [angle, rate]: [R; 2],
    input: &impl Input<R>,
    offset: R,
) -> R {
    let at = Instant {
        time: state.time + offset,
        angle,
        rate,
        pressure: input.pressure(offset - model.delay()),
    };
    model.acceleration(&at, &state.hidden)
}

/// [`rk4`] where no hidden state is integrated, to the same bits: with derivatives a state
/// is a kilobyte, and copying six hidden ones that do not change took half of the time.
fn rk4_of_motion<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &mut State<R>,
    input: &impl Input<R>,
    dt: R,
) {
    let half = dt * R::half();
    let [x, v] = [state.angle, state.rate];
    let a1 = acceleration(model, state, [x, v], input, R::zero());
    let v2 = v + a1 * half;
    let a2 = acceleration(model, state, [x + v * half, v2], input, half);
    let v3 = v + a2 * half;
    let a3 = acceleration(model, state, [x + v2 * half, v3], input, half);
    let v4 = v + a3 * dt;
    let a4 = acceleration(model, state, [x + v3 * dt, v4], input, dt);
    let sixth = dt / R::from_i16(6);
    let [middle_v, middle_a] = [v2 + v3, a2 + a3];
    state.angle += (v + middle_v + middle_v + v4) * sixth;
    state.rate += (a1 + middle_a + middle_a + a4) * sixth;
    state.time += dt;
}

/// [`exponential_heun`] where no hidden state is integrated, to the same bits.
fn exponential_heun_of_motion<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &mut State<R>,
    input: &impl Input<R>,
    dt: R,
    decay: R,
) {
    let time_constant = R::one() / decay;
    let coasting = (R::one() - (-(decay * dt)).exp()) * time_constant;
    let pushed = (dt - coasting) * time_constant;

    let [x, v] = [state.angle, state.rate];
    let push = acceleration(model, state, [x, v], input, R::zero()) + decay * v;
    let predicted_v = v + (push - decay * v) * coasting;
    let predicted_x = x + v * coasting + push * pushed;
    let later = acceleration(model, state, [predicted_x, predicted_v], input, dt);
    let growth = (later + decay * predicted_v - push) / dt;
    state.rate = predicted_v + growth * pushed;
    state.angle = predicted_x + growth * (dt * dt * R::half() - pushed) * time_constant;
    state.time += dt;
}

fn advance<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    slope: &Derivative<R>,
    dt: R,
) -> State<R> {
    let mut next = *state;
    move_on(model, state, slope, dt, &mut next);
    next
}

/// Makes of `next` where `state` comes to in `dt` seconds along a slope. What `next` has of
/// slots without an effect stays.
fn move_on<R: Real, P: Power<R>>(
    model: &Model<R, P>,
    state: &State<R>,
    slope: &Derivative<R>,
    dt: R,
    next: &mut State<R>,
) {
    next.time = state.time + dt;
    next.angle = state.angle + slope.rate * dt;
    next.rate = state.rate + slope.acceleration * dt;
    if model.integrates() {
        // A memory of events has no rate and stays.
        let slots = model.occupied().zip(&mut next.hidden);
        for ((_, next), (hidden, rates)) in slots.zip(state.hidden.iter().zip(&slope.hidden)) {
            for (next, (value, rate)) in next.iter_mut().zip(hidden.iter().zip(rates)) {
                *next = *value + *rate * dt;
            }
        }
    }
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
