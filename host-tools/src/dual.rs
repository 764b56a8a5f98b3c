//! Numbers that carry exact derivatives through the shared physics.
//!
//! Fits need the derivative of every simulated sample by every parameter. A
//! [`Dual`] is a value with `N` partial derivatives (forward-mode automatic
//! differentiation), so that running the model once on duals gives the
//! simulation and its exact gradient, with no difference step to choose. The
//! arithmetic is that of the crate `num-dual`; this module lets the shared
//! physics run on it.

use std::cmp::Ordering;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use model_core::power::{Exact, Power};
use model_core::real::Real;
use nalgebra::{Const, SVector};
use num_dual::{Derivative, DualNum, DualSVec64};

/// A value and its derivatives by `N` parameters.
#[derive(Clone, Copy, Debug)]
pub struct Dual<const N: usize>(DualSVec64<N>);

impl<const N: usize> Dual<N> {
    /// A number that depends on no parameter.
    pub fn constant(value: f64) -> Self {
        Self(DualSVec64::from_re(value))
    }

    /// A number whose derivative by parameter `index` is `slope`, and zero by
    /// all others.
    pub fn variable(value: f64, index: usize, slope: f64) -> Self {
        let mut partials = SVector::<f64, N>::zeros();
        if let Some(partial) = partials.get_mut(index) {
            *partial = slope;
        }
        Self(DualSVec64::new(value, Derivative::some(partials)))
    }

    /// The same with two of its derivatives replaced, from column `first` on.
    pub fn seeded(mut self, first: usize, slopes: [f64; 2]) -> Self {
        let mut partials = self.0.eps.unwrap_generic(Const::<N>, Const::<1>);
        for (column, slope) in (first..).zip(slopes) {
            if let Some(partial) = partials.get_mut(column) {
                *partial = slope;
            }
        }
        self.0.eps = Derivative::some(partials);
        self
    }

    /// The value.
    pub fn value(&self) -> f64 {
        self.0.re
    }

    /// The partial derivatives.
    pub fn partials(&self) -> [f64; N] {
        self.0.eps.unwrap_generic(Const::<N>, Const::<1>).into()
    }
}

/// Comparisons look at values alone.
impl<const N: usize> PartialEq for Dual<N> {
    fn eq(&self, other: &Self) -> bool {
        self.0.re == other.0.re
    }
}

impl<const N: usize> PartialOrd for Dual<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.0.re.partial_cmp(&other.0.re)
    }
}

macro_rules! operator {
    ($name:ident, $method:ident) => {
        impl<const N: usize> $name for Dual<N> {
            type Output = Self;
            #[inline]
            fn $method(self, other: Self) -> Self {
                Self($name::$method(self.0, other.0))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl<const N: usize> AddAssign for Dual<N> {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.0 += other.0;
    }
}

impl<const N: usize> SubAssign for Dual<N> {
    #[inline]
    fn sub_assign(&mut self, other: Self) {
        self.0 -= other.0;
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl<const N: usize> Real for Dual<N> {
    type DefaultPower = Exact;

    fn from_i16(n: i16) -> Self {
        Self::constant(f64::from(n))
    }
    fn from_f32(x: f32) -> Self {
        Self::constant(f64::from(x))
    }
    fn exp(self) -> Self {
        Self(self.0.exp())
    }
    fn tanh(self) -> Self {
        // The library divides sinh by cosh, which overflow where a friction
        // has long saturated.
        let tanh = self.0.re.tanh();
        Self(DualSVec64::new(tanh, self.0.eps * (1.0 - tanh * tanh)))
    }
    fn sin(self) -> Self {
        Self(self.0.sin())
    }
    fn cos(self) -> Self {
        Self(self.0.cos())
    }
    fn is_finite(self) -> bool {
        self.0.re.is_finite() && self.partials().iter().all(|partial| partial.is_finite())
    }
}

/// At a base of zero the slope is that of the limit, except that an infinite
/// slope (exponent below 1) is given as zero: a fit cannot use infinity.
impl<const N: usize> Power<Dual<N>> for Exact {
    #[expect(clippy::float_cmp, reason = "the limit differs at exactly 1")]
    #[inline]
    fn pow(base: Dual<N>, exponent: Dual<N>) -> Dual<N> {
        let n = exponent.0.re;
        let value = <Self as Power<f64>>::pow(base.0.re, n);
        let by_base = if base.0.re > 0.0 {
            n * value / base.0.re
        } else {
            f64::from(u8::from(n == 1.0))
        };
        let mut partials = base.0.eps * by_base;
        if base.0.re > 0.0 && exponent.0.eps != Derivative::none() {
            partials += exponent.0.eps * (value * base.0.re.ln());
        }
        Dual(DualSVec64::new(value, partials))
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
