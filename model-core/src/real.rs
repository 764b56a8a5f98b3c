//! The scalar that all physics is written in, and the power that goes with it.
//!
//! One source serves three arithmetics: `f32` on the ATmega2560, `f64` on a
//! desktop, and numbers that carry exact derivatives for the fits. [`Real`] has
//! exactly the operations that the physics needs, and [`Power`] the one that
//! Ludwick's law needs besides. `scalars` implements `Real` for `f32` and `f64`;
//! the power functions are in [`crate::power`].

use core::fmt::Debug;
use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

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
    #[cfg(feature = "desktop")]
    fn from_double(x: f64) -> Self;
    /// The natural logarithm.
    #[cfg(feature = "desktop")]
    fn ln(self) -> Self;
    /// −1, 0 or 1. Its slope is zero everywhere.
    #[cfg(feature = "desktop")]
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
    #[cfg(feature = "desktop")]
    fn least(self, other: Self) -> Self {
        if other < self { other } else { self }
    }
    /// A power of a number that is not negative; not a number for one that is.
    #[cfg(feature = "desktop")]
    fn power_of_positive(self, exponent: Self) -> Self {
        if self < Self::zero() {
            Self::zero() / Self::zero()
        } else {
            <Self::DefaultPower as Power<Self>>::pow(self, exponent)
        }
    }
}

/// A power function on non-negative bases.
pub trait Power<R>: Copy + core::fmt::Debug + Default {
    /// Computes `base^exponent` for `base ≥ 0` and `exponent > 0`.
    ///
    /// Both are pure numbers; angles are in radians. Other arguments are
    /// outside the model, and an implementation may answer them with NaN.
    fn pow(base: R, exponent: R) -> R;

    /// The same by a function that a model carries, which can be prepared for its exponent.
    #[inline]
    fn raise(&self, base: R, exponent: R) -> R {
        Self::pow(base, exponent)
    }
}
