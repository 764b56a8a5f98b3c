//! The parameters of the base equation, and its rates.
//!
//! They are separate from effects and from the model: effects change the parameters and add to
//! the rates, and a model consists of both.

use crate::real::Real;

/// Parameters of the base equation, in SI units and radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dynamics<R> {
    /// Effective inertia M (kg·m), positive.
    pub inertia: R,
    /// Viscous damping C (N·s/rad), not negative.
    pub damping: R,
    /// Stiffness K (N/radⁿ), not negative.
    pub stiffness: R,
    /// Exponent n of Ludwick's law, positive; 1 is Hooke's law.
    pub exponent: R,
    /// Input gain g (N/Pa).
    pub input_gain: R,
}

impl<R: Real> Dynamics<R> {
    /// Converts every parameter with `f`.
    pub fn map<S>(&self, mut f: impl FnMut(R) -> S) -> Dynamics<S> {
        Dynamics {
            inertia: f(self.inertia),
            damping: f(self.damping),
            stiffness: f(self.stiffness),
            exponent: f(self.exponent),
            input_gain: f(self.input_gain),
        }
    }
}

/// How fast the equations move: what a step length has to resolve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates<R> {
    /// Stiffness over inertia, the square of an angular frequency (1/s²).
    pub stiffness: R,
    /// Damping over inertia or 1/τ (1/s).
    pub relaxation: R,
}
