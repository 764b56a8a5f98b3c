//! |θ|ⁿ, the one expensive function of the model.

use crate::real::Real;

/// A power function on non-negative bases.
pub trait Power<R>: Copy + core::fmt::Debug + Default {
    /// Computes `base^exponent` for `base ≥ 0` and `exponent > 0`.
    fn pow(base: R, exponent: R) -> R;
}

/// sign(θ)·|θ|ⁿ, the odd continuation of θⁿ to negative angles.
///
/// The paper's θⁿ (Eq. 13) is undefined for θ < 0.
pub fn signed_power<R: Real, P: Power<R>>(angle: R, exponent: R) -> R {
    if angle < R::ZERO {
        -P::pow(-angle, exponent)
    } else {
        P::pow(angle, exponent)
    }
}

/// `f32` power from minimax polynomials.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Minimax;

/// micromath's `powf` on bases above 1, its reciprocal below.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GuardedMicromath;

/// The platform's own `f64` power function.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exact;

impl Power<f32> for Minimax {
    fn pow(base: f32, exponent: f32) -> f32 {
        crate::elementary::exp(exponent * crate::elementary::ln(base))
    }
}

impl Power<f32> for GuardedMicromath {
    fn pow(base: f32, exponent: f32) -> f32 {
        use micromath::F32Ext;
        if base < 1.0 {
            1.0 / (1.0 / base).powf(exponent)
        } else {
            base.powf(exponent)
        }
    }
}

#[cfg(feature = "std")]
impl Power<f64> for Exact {
    fn pow(base: f64, exponent: f64) -> f64 {
        base.powf(exponent)
    }
}
