//! The numbers of the board and of the desktop as scalars of the model.
//!
//! What a scalar has to do is said in [`crate::real`]; numbers that carry
//! derivatives live beside the fits that need them.

use crate::elementary;
#[cfg(feature = "std")]
use crate::power::Exact;
use crate::power::Minimax;
use crate::real::Real;

impl Real for f32 {
    type DefaultPower = Minimax;

    fn from_i16(n: i16) -> Self {
        Self::from(n)
    }
    fn from_f32(x: f32) -> Self {
        x
    }
    // Never the platform's functions: the board and the desktop must agree bit
    // for bit.
    fn exp(self) -> Self {
        elementary::exp(self)
    }
    fn tanh(self) -> Self {
        elementary::tanh(self)
    }
    fn sin(self) -> Self {
        elementary::sin(self)
    }
    fn cos(self) -> Self {
        elementary::cos(self)
    }
    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }
    #[cfg(feature = "desktop")]
    #[allow(clippy::cast_possible_truncation)] // Rounding is the point.
    fn from_double(x: f64) -> Self {
        x as f32
    }
    #[cfg(feature = "desktop")]
    fn ln(self) -> Self {
        libm::logf(self)
    }
}

#[cfg(feature = "std")]
impl Real for f64 {
    type DefaultPower = Exact;

    fn from_i16(n: i16) -> Self {
        Self::from(n)
    }
    fn from_f32(x: f32) -> Self {
        Self::from(x)
    }
    // Here neither: another computer, or a browser, must not come to another diagnosis.
    fn exp(self) -> Self {
        libm::exp(self)
    }
    fn tanh(self) -> Self {
        libm::tanh(self)
    }
    fn sin(self) -> Self {
        libm::sin(self)
    }
    fn cos(self) -> Self {
        libm::cos(self)
    }
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
    #[cfg(feature = "desktop")]
    fn from_double(x: f64) -> Self {
        x
    }
    #[cfg(feature = "desktop")]
    fn ln(self) -> Self {
        libm::log(self)
    }
}
