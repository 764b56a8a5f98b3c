//! The pressure that drives a step, as a function of time within the step.
//!
//! A recording knows the pressure between its samples, a board knows only the
//! past, and a dead time asks for the pressure of a while ago. [`Input`] hides
//! the difference: time is counted from the start of the current step, so that
//! `f32` keeps its resolution however long the run lasts.

use crate::real::Real;

/// Gauge pressure around the current integration step.
pub trait Input<R> {
    /// Returns the gauge pressure (Pa) `offset` seconds after the start of the
    /// step. A negative offset asks for the past.
    fn pressure(&self, offset: R) -> R;
}

/// The same pressure (Pa) at all times: a step test.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Held<R>(
    /// Gauge pressure (Pa).
    pub R,
);

impl<R: Real> Input<R> for Held<R> {
    fn pressure(&self, _offset: R) -> R {
        self.0
    }
}

/// Pressure from a function of the offset: closed-form inputs in tests.
#[derive(Clone, Copy, Debug)]
pub struct FromFn<F>(
    /// Maps the offset (s) to gauge pressure (Pa).
    pub F,
);

impl<R, F: Fn(R) -> R> Input<R> for FromFn<F> {
    fn pressure(&self, offset: R) -> R {
        (self.0)(offset)
    }
}
