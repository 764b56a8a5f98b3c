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

/// The last `N` pressure samples at a fixed interval, for a board that cannot
/// look ahead: linear between samples, constant beyond both ends.
///
/// Holds `(N − 1)·interval` seconds of the past, which bounds the dead time
/// that a board can simulate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct History<R, const N: usize> {
    interval: R,
    /// Samples in a ring; `newest` is the index of the latest.
    samples: [R; N],
    newest: usize,
}

impl<R: Real, const N: usize> History<R, N> {
    /// Creates a history that has seen nothing but `pressure` (Pa), sampled
    /// every `interval` seconds.
    pub fn at_rest(pressure: R, interval: R) -> Self {
        Self {
            interval,
            samples: [pressure; N],
            newest: 0,
        }
    }

    /// Appends the pressure (Pa) at the start of the step that comes next.
    pub fn push(&mut self, pressure: R) {
        self.newest = if self.newest + 1 < N {
            self.newest + 1
        } else {
            0
        };
        if let Some(slot) = self.samples.get_mut(self.newest) {
            *slot = pressure;
        }
    }

    fn back(&self, steps: usize) -> R {
        let steps = if steps < N { steps } else { N - 1 };
        let index = if self.newest >= steps {
            self.newest - steps
        } else {
            self.newest + N - steps
        };
        self.samples.get(index).copied().unwrap_or(R::zero())
    }
}

impl<R: Real, const N: usize> Input<R> for History<R, N> {
    fn pressure(&self, offset: R) -> R {
        let mut remaining = -offset;
        if remaining < R::zero() {
            return self.back(0);
        }
        let mut steps = 0;
        while remaining >= self.interval && steps + 1 < N {
            remaining -= self.interval;
            steps += 1;
        }
        let newer = self.back(steps);
        let older = self.back(steps + 1);
        newer + (older - newer) * (remaining / self.interval)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn history_interpolates_between_samples_and_clamps_at_both_ends() {
        let mut history = History::<f64, 4>::at_rest(1.0, 0.1);
        for pressure in [2.0, 4.0, 8.0] {
            history.push(pressure);
        }
        let close = |offset: f64, expected: f64| {
            let got = history.pressure(offset);
            assert!((got - expected).abs() < 1e-12, "{offset}: {got}");
        };
        close(0.0, 8.0);
        close(0.05, 8.0);
        close(-0.05, 6.0);
        close(-0.15, 3.0);
        close(-0.25, 1.5);
        close(-5.0, 1.0);
    }

    #[test]
    fn history_wraps_round_its_ring() {
        let mut history = History::<f64, 3>::at_rest(0.0, 1.0);
        for k in 0..17 {
            history.push(f64::from(k));
        }
        assert!((history.pressure(-1.5) - 14.5).abs() < 1e-12);
    }
}
