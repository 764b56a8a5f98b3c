//! Dual numbers: exact derivatives through the shared physics.
//!
//! Fits need the derivative of every simulated sample by every parameter. A
//! [`Dual`] is a value with `N` partial derivatives (forward-mode automatic
//! differentiation), so that running the model once on duals gives the
//! simulation and its exact gradient, with no difference step to choose.
//!
//! The library `num-dual` has the same arithmetic. But it keeps the derivatives of a
//! constant as an `Option`, whose branches prevent vectorisation.

use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use model_core::power::{Exact, Power};
use model_core::real::Real;

/// A value and its derivatives by `N` parameters.
#[derive(Clone, Copy, Debug)]
pub struct Dual<const N: usize> {
    value: f64,
    partials: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A number that depends on no parameter.
    #[inline]
    pub fn constant(value: f64) -> Self {
        Self {
            value,
            partials: [0.0; N],
        }
    }

    /// A number whose derivative by parameter `index` is `slope`, and zero by
    /// all others.
    pub fn variable(value: f64, index: usize, slope: f64) -> Self {
        let mut this = Self::constant(value);
        if let Some(partial) = this.partials.get_mut(index) {
            *partial = slope;
        }
        this
    }

    /// The same with two of its derivatives replaced, from column `first` on.
    pub fn seeded(mut self, first: usize, slopes: [f64; 2]) -> Self {
        for (column, slope) in (first..).zip(slopes) {
            if let Some(partial) = self.partials.get_mut(column) {
                *partial = slope;
            }
        }
        self
    }

    /// The value.
    #[inline]
    pub const fn value(&self) -> f64 {
        self.value
    }

    /// The partial derivatives.
    #[inline]
    pub const fn partials(&self) -> [f64; N] {
        self.partials
    }

    /// A function of this number, by its value and its slope there (the chain rule).
    #[inline]
    pub fn chain(self, value: f64, slope: f64) -> Self {
        Self {
            value,
            partials: self.partials.map(|partial| slope * partial),
        }
    }

    /// This number to a power whose value is known, as is its own logarithm.
    #[expect(clippy::float_cmp, reason = "the limit differs at exactly 1")]
    #[inline]
    pub fn to_the_power(self, exponent: &Self, value: f64, ln: impl FnOnce() -> f64) -> Self {
        let n = exponent.value;
        let by_base = if self.value > 0.0 {
            n * value / self.value
        } else {
            f64::from(u8::from(n == 1.0))
        };
        let is_free = exponent.partials.iter().any(|partial| *partial != 0.0);
        if self.value > 0.0 && is_free {
            let by_exponent = value * ln();
            self.both(exponent, value, |a, b| by_base * a + by_exponent * b)
        } else {
            self.chain(value, by_base)
        }
    }

    /// The partials of a number from those of two.
    #[inline]
    fn both(self, other: &Self, value: f64, partial: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            value,
            partials: std::array::from_fn(|k| partial(self.partials[k], other.partials[k])),
        }
    }
}

/// Comparisons look at values alone.
impl<const N: usize> PartialEq for Dual<N> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<const N: usize> PartialOrd for Dual<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.both(&other, self.value + other.value, |a, b| a + b)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self.both(&other, self.value - other.value, |a, b| a - b)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
    #[inline]
    fn mul(self, other: Self) -> Self {
        let (x, y) = (self.value, other.value);
        self.both(&other, x * y, |a, b| a * y + x * b)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    #[inline]
    fn div(self, other: Self) -> Self {
        let inverse = 1.0 / other.value;
        let quotient = self.value * inverse;
        self.both(&other, quotient, |a, b| (a - quotient * b) * inverse)
    }
}

impl<const N: usize> AddAssign for Dual<N> {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<const N: usize> SubAssign for Dual<N> {
    #[inline]
    fn sub_assign(&mut self, other: Self) {
        *self = *self - other;
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

    #[inline]
    fn from_i16(n: i16) -> Self {
        Self::constant(f64::from(n))
    }
    #[inline]
    fn from_f32(x: f32) -> Self {
        Self::constant(f64::from(x))
    }
    fn exp(self) -> Self {
        let exp = libm::exp(self.value);
        self.chain(exp, exp)
    }
    fn tanh(self) -> Self {
        let tanh = libm::tanh(self.value);
        self.chain(tanh, 1.0 - tanh * tanh)
    }
    fn sin(self) -> Self {
        let (sin, cos) = libm::sincos(self.value);
        self.chain(sin, cos)
    }
    fn cos(self) -> Self {
        let (sin, cos) = libm::sincos(self.value);
        self.chain(cos, -sin)
    }
    fn is_finite(self) -> bool {
        self.value.is_finite() && self.partials.iter().all(|partial| partial.is_finite())
    }
    #[inline]
    fn from_double(x: f64) -> Self {
        Self::constant(x)
    }
    fn ln(self) -> Self {
        self.chain(libm::log(self.value), 1.0 / self.value)
    }
}

/// At a base of zero the slope is that of the limit, except that an infinite
/// slope (exponent below 1) is given as zero: a fit cannot use infinity.
impl<const N: usize> Power<Dual<N>> for Exact {
    #[inline]
    fn pow(base: Dual<N>, exponent: Dual<N>) -> Dual<N> {
        let value = <Self as Power<f64>>::pow(base.value, exponent.value);
        base.to_the_power(&exponent, value, || libm::log(base.value))
    }
}

/// Scalars that recorded numbers can become.
pub trait FromF64: Real {
    /// Converts a recorded number.
    fn from_f64(value: f64) -> Self;
    /// The value, without derivatives.
    fn to_f64(self) -> f64;
    /// A function of this number, by its value and its slope there (the chain rule).
    fn chain(self, value: f64, slope: f64) -> Self;
    /// Whether numbers of this kind carry derivatives.
    const HAS_DERIVATIVES: bool = false;
}

impl FromF64 for f64 {
    fn from_f64(value: f64) -> Self {
        value
    }
    fn to_f64(self) -> f64 {
        self
    }
    fn chain(self, value: f64, _slope: f64) -> Self {
        value
    }
}

impl FromF64 for f32 {
    #[allow(clippy::cast_possible_truncation)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[allow(clippy::cast_possible_truncation)]
    fn chain(self, value: f64, _slope: f64) -> Self {
        value as f32
    }
}

impl<const N: usize> FromF64 for Dual<N> {
    fn from_f64(value: f64) -> Self {
        Self::constant(value)
    }
    fn to_f64(self) -> f64 {
        self.value()
    }
    fn chain(self, value: f64, slope: f64) -> Self {
        Self::chain(self, value, slope)
    }
    const HAS_DERIVATIVES: bool = true;
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
        let numeric = difference(|x| f(Dual::constant(x)).value(), x);
        assert_eq!(exact.partials()[0], 0.0);
        let scale = numeric.abs().max(1.0);
        assert!(
            (exact.partials()[1] - numeric).abs() < 1e-7 * scale,
            "{} against {numeric} at {x}",
            exact.partials()[1]
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
    fn saturated_friction_stays_finite() {
        let far = Dual::<1>::variable(800.0, 0, 1.0).tanh();
        assert_eq!((far.value(), far.partials()[0]), (1.0, 0.0));
    }

    #[test]
    fn power_at_zero_has_the_slope_of_its_limit() {
        let zero = Dual::<1>::variable(0.0, 0, 1.0);
        let slope = |n| Exact::pow(zero, Dual::constant(n)).partials()[0];
        assert_eq!(slope(1.0), 1.0);
        assert_eq!(slope(2.3), 0.0);
        assert_eq!(slope(0.5), 0.0);
    }

    proptest! {
        /// By a force at a node, and by the place within a piece.
        #[test]
        fn tables_have_exact_derivatives(
            forces in proptest::array::uniform4(-2.0..2.0_f64),
            share in 0.1..0.9_f64,
            piece in 0..3_usize,
            node in 0..4_usize,
        ) {
            use model_core::effects::table::{Table, Variable};
            let nodes = [-1.0_f32, -0.25, 0.5, 2.0];
            let [start, end] = [nodes[piece], nodes[piece + 1]].map(f64::from);
            let x = start + share * (end - start);
            let at = |forces: [Dual<2>; 4], x| {
                Table::new(Variable::Angle, &nodes, &forces).unwrap().at(x)
            };
            let constant = forces.map(Dual::constant);
            agrees(|force| {
                let mut forces = constant;
                forces[node] = force;
                at(forces, Dual::constant(x))
            }, forces[node]);
            let slope = at(constant, Dual::variable(x, 0, 1.0)).partials()[0];
            let expected = (forces[piece + 1] - forces[piece]) / (end - start);
            prop_assert!((slope - expected).abs() < 1e-12 * (1.0 + expected.abs()));
        }
    }
}
