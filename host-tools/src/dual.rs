//! Numbers that carry exact derivatives through the shared physics.
//!
//! Fits need the derivative of every simulated sample by every parameter. A
//! [`Dual`] is a value with `N` partial derivatives (forward-mode automatic
//! differentiation), so that running the model once on duals gives the
//! simulation and its exact gradient, with no difference step to choose. The
//! array is of fixed size so that the compiler turns it into vector
//! instructions; docs/decisions holds the comparison with a library.

use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use model_core::power::{Exact, Power};
use model_core::real::Real;

/// A value and its derivatives by `N` parameters.
#[derive(Clone, Copy, Debug)]
pub struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// Partial derivatives.
    pub partials: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A number that depends on no parameter.
    pub const fn constant(value: f64) -> Self {
        Self {
            value,
            partials: [0.0; N],
        }
    }

    /// A number whose derivative by parameter `index` is `slope`, and zero by
    /// all others.
    pub fn variable(value: f64, index: usize, slope: f64) -> Self {
        let mut number = Self::constant(value);
        if let Some(partial) = number.partials.get_mut(index) {
            *partial = slope;
        }
        number
    }

    /// Applies a function with the given value and slope here.
    #[inline]
    fn chain(mut self, value: f64, slope: f64) -> Self {
        self.value = value;
        for partial in &mut self.partials {
            *partial *= slope;
        }
        self
    }

    /// `a·self + b·other` in the derivatives.
    #[inline]
    fn combine(mut self, other: &Self, value: f64, a: f64, b: f64) -> Self {
        self.value = value;
        for (mine, theirs) in self.partials.iter_mut().zip(&other.partials) {
            *mine = a * *mine + b * *theirs;
        }
        self
    }
}

/// Comparisons look at values alone.
impl<const N: usize> PartialEq for Dual<N> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<const N: usize> PartialOrd for Dual<N> {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(mut self, other: Self) -> Self {
        self -= other;
        self
    }
}

impl<const N: usize> AddAssign for Dual<N> {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.value += other.value;
        for (mine, theirs) in self.partials.iter_mut().zip(&other.partials) {
            *mine += *theirs;
        }
    }
}

impl<const N: usize> SubAssign for Dual<N> {
    #[inline]
    fn sub_assign(&mut self, other: Self) {
        self.value -= other.value;
        for (mine, theirs) in self.partials.iter_mut().zip(&other.partials) {
            *mine -= *theirs;
        }
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        self.combine(&other, self.value * other.value, other.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        let inverse = 1.0 / other.value;
        self.combine(&other, quotient, inverse, -quotient * inverse)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Real for Dual<N> {
    type DefaultPower = Exact;

    const ZERO: Self = Self::constant(0.0);
    const ONE: Self = Self::constant(1.0);
    const HALF: Self = Self::constant(0.5);

    fn from_i16(n: i16) -> Self {
        Self::constant(f64::from(n))
    }
    fn from_f32(x: f32) -> Self {
        Self::constant(f64::from(x))
    }
    fn exp(self) -> Self {
        let value = self.value.exp();
        self.chain(value, value)
    }
    fn tanh(self) -> Self {
        let value = self.value.tanh();
        self.chain(value, 1.0 - value * value)
    }
    fn sin(self) -> Self {
        let (sin, cos) = self.value.sin_cos();
        self.chain(sin, cos)
    }
    fn cos(self) -> Self {
        let (sin, cos) = self.value.sin_cos();
        self.chain(cos, -sin)
    }
    fn is_finite(self) -> bool {
        self.value.is_finite() && self.partials.iter().all(|partial| partial.is_finite())
    }
}

/// At a base of zero the slope is that of the limit, except that an infinite
/// slope (exponent below 1) is given as zero: a fit cannot use infinity.
impl<const N: usize> Power<Dual<N>> for Exact {
    #[expect(clippy::float_cmp, reason = "the limit differs at exactly 1")]
    fn pow(base: Dual<N>, exponent: Dual<N>) -> Dual<N> {
        let value = <Self as Power<f64>>::pow(base.value, exponent.value);
        if base.value > 0.0 {
            let slope = exponent.value * value / base.value;
            if exponent.partials.iter().all(|partial| *partial == 0.0) {
                return base.chain(value, slope);
            }
            base.combine(&exponent, value, slope, value * base.value.ln())
        } else {
            let slope = if exponent.value == 1.0 { 1.0 } else { 0.0 };
            base.chain(value, slope)
        }
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "these derivatives are exact")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sixth-order central difference, an independent derivative.
    fn difference(f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let h = 1e-3 * x.abs().max(1e-2);
        let d = |k: f64| f(x + k * h) - f(x - k * h);
        (45.0 * d(1.0) - 9.0 * d(2.0) + d(3.0)) / (60.0 * h)
    }

    fn agrees(f: impl Fn(Dual<2>) -> Dual<2>, x: f64) {
        let exact = f(Dual::variable(x, 1, 1.0));
        let numeric = difference(|x| f(Dual::constant(x)).value, x);
        assert_eq!(exact.partials[0], 0.0);
        let scale = numeric.abs().max(1.0);
        assert!(
            (exact.partials[1] - numeric).abs() < 1e-7 * scale,
            "{} against {numeric} at {x}",
            exact.partials[1]
        );
    }

    proptest! {
        #[test]
        fn derivatives_agree_with_differences(x in 0.05..3.0f64, c in 0.3..3.0f64) {
            let c = Dual::constant(c);
            agrees(|x| x * x * c - x / (c + x), x);
            agrees(|x| (-(x * c)).exp() + x.tanh(), x);
            agrees(|x| x.sin() * (x * c).cos(), x);
            agrees(|x| Exact::pow(x, c), x);
            agrees(|x| Exact::pow(c, x), x);
        }
    }

    #[test]
    fn power_at_zero_has_the_slope_of_its_limit() {
        let zero = Dual::<1>::variable(0.0, 0, 1.0);
        let slope = |n| Exact::pow(zero, Dual::constant(n)).partials[0];
        assert_eq!(slope(1.0), 1.0);
        assert_eq!(slope(2.3), 0.0);
        assert_eq!(slope(0.5), 0.0);
    }
}
