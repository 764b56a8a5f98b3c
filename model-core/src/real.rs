//! The scalar that all physics is written in.
//!
//! One source serves three arithmetics: `f32` on the ATmega2560, `f64` on a
//! desktop, and numbers that carry exact derivatives for the fits. [`Real`] has
//! exactly the operations that the physics needs.

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use crate::power::Power;

/// A scalar in which the model can be evaluated.
///
/// Comparisons look at the value alone; a scalar with derivatives keeps the
/// derivatives of the branch that was taken.
pub trait Real:
    Copy
    + Debug
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// The power function that the model uses when none is asked for.
    type DefaultPower: Power<Self>;

    /// Converts a small whole number, exactly.
    fn from_i16(n: i16) -> Self;
    /// Converts a constant that is written in the source; exact for values
    /// that `f32` holds exactly.
    fn from_f32(x: f32) -> Self;

    /// 0.
    fn zero() -> Self {
        Self::from_i16(0)
    }
    /// 1.
    fn one() -> Self {
        Self::from_i16(1)
    }
    /// ½.
    fn half() -> Self {
        Self::from_f32(0.5)
    }
    /// The absolute value.
    fn abs(self) -> Self {
        if self < Self::zero() { -self } else { self }
    }
    /// The larger of two numbers; `self` if they do not compare.
    fn max(self, other: Self) -> Self {
        if other > self { other } else { self }
    }
    /// The exponential function.
    fn exp(self) -> Self;
    /// The hyperbolic tangent.
    fn tanh(self) -> Self;
    /// The sine of an angle in radians.
    fn sin(self) -> Self;
    /// The cosine of an angle in radians.
    fn cos(self) -> Self;
    /// Whether the value is neither infinite nor NaN.
    fn is_finite(self) -> bool;

    /// Converts a number of a user's formula.
    #[cfg(feature = "formula")]
    fn from_double(x: f64) -> Self;
    /// The natural logarithm.
    #[cfg(feature = "formula")]
    fn ln(self) -> Self;
    /// −1, 0 or 1. Its slope is zero everywhere.
    #[cfg(feature = "formula")]
    fn sign(self) -> Self {
        if self > Self::zero() {
            Self::one()
        } else if self < Self::zero() {
            -Self::one()
        } else {
            // Zero, also in its slopes, or not a number.
            self * Self::zero()
        }
    }
    /// The smaller of two numbers; `self` if they do not compare.
    #[cfg(feature = "formula")]
    fn least(self, other: Self) -> Self {
        if other < self { other } else { self }
    }
    /// A power of a number that is not negative; not a number for one that is.
    #[cfg(feature = "formula")]
    fn power_of_positive(self, exponent: Self) -> Self {
        if self < Self::zero() {
            Self::zero() / Self::zero()
        } else {
            <Self::DefaultPower as crate::power::Power<Self>>::pow(self, exponent)
        }
    }
}

impl Real for f32 {
    type DefaultPower = crate::power::Minimax;

    fn from_i16(n: i16) -> Self {
        Self::from(n)
    }
    fn from_f32(x: f32) -> Self {
        x
    }
    // Never the platform's functions: the board and the desktop must agree bit
    // for bit.
    fn exp(self) -> Self {
        crate::elementary::exp(self)
    }
    fn tanh(self) -> Self {
        crate::elementary::tanh(self)
    }
    fn sin(self) -> Self {
        crate::elementary::sin(self)
    }
    fn cos(self) -> Self {
        crate::elementary::cos(self)
    }
    fn is_finite(self) -> bool {
        f32::is_finite(self)
    }
    #[cfg(feature = "formula")]
    #[allow(clippy::cast_possible_truncation)] // Rounding is the point.
    fn from_double(x: f64) -> Self {
        x as f32
    }
    // The platform's, for no board runs a formula.
    #[cfg(feature = "formula")]
    fn ln(self) -> Self {
        f32::ln(self)
    }
}

#[cfg(feature = "std")]
impl Real for f64 {
    type DefaultPower = crate::power::Exact;

    fn from_i16(n: i16) -> Self {
        Self::from(n)
    }
    fn from_f32(x: f32) -> Self {
        Self::from(x)
    }
    fn exp(self) -> Self {
        f64::exp(self)
    }
    fn tanh(self) -> Self {
        f64::tanh(self)
    }
    fn sin(self) -> Self {
        f64::sin(self)
    }
    fn cos(self) -> Self {
        f64::cos(self)
    }
    fn is_finite(self) -> bool {
        f64::is_finite(self)
    }
    #[cfg(feature = "formula")]
    fn from_double(x: f64) -> Self {
        x
    }
    #[cfg(feature = "formula")]
    fn ln(self) -> Self {
        f64::ln(self)
    }
}
