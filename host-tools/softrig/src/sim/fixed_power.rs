//! |θ|ⁿ for the one exponent of a simulation.
//!
//! A simulation raises tens of thousands of angles to the same power, and half of its time goes
//! into `pow`, which knows nothing of that. [`FixedPower`] is prepared for the exponent once. It is
//! within 10⁻¹⁴ of `pow`, relatively, in half of its time, and has the logarithm that a derivative
//! by the exponent needs from the same nodes.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::LazyLock;

use model_core::actuator::Model;
use model_core::power::{Exact, Power};

use super::dual::{Dual, FromF64};

/// Nodes of the mantissa.
const NODES: usize = 256;
/// Bits of the mantissa that number them.
const NODE_BITS: u32 = NODES.trailing_zeros();
/// Bits of a mantissa.
const MANTISSA_BITS: u32 = f64::MANTISSA_DIGITS - 1;
const MANTISSA: u64 = (1 << MANTISSA_BITS) - 1;
/// The bits of 1.
const ONE: u64 = 1.0_f64.to_bits();

/// Octaves 2ᵏ of the table, k from [`LOWEST_OCTAVE`] on: angles down to 10⁻²⁴ rad.
const OCTAVES: usize = 96;
const LOWEST_OCTAVE: i32 = -80;

/// Largest exponent: beyond it six terms of the binomial series are not enough.
const LARGEST: f64 = 8.0;

/// Terms of the Taylor polynomials. With a distance of 2⁻⁹ from a node the next one is 2⁻⁵⁴.
const TERMS: usize = 6;

/// In two lines of the cache: where one begins is a shift and no multiplication.
type Polynomial = [f64; TERMS.next_power_of_two()];

/// xⁿ for one n.
///
/// With x = 2ᵏ m, m from 1 to 2, it is xⁿ = 2^(kn) mⁿ, a table over k times a Taylor polynomial
/// around the nearest of 256 nodes.
///
/// Outside of the table, and for another exponent (a user's formula may change it on the way), it
/// is `pow` itself. The angle decides which, never what was computed before, so that results do not
/// depend on the order of the work.
#[derive(Debug)]
pub struct FixedPower {
    exponent: f64,
    octaves: [f64; OCTAVES],
    nodes: Box<[Polynomial; NODES]>,
}

/// A [`FixedPower`] as the power function of a model; without one it is [`Exact`].
#[derive(Clone, Copy, Debug, Default)]
pub struct Fixed<'a>(Option<&'a FixedPower>);

/// ln m around the nodes.
static LOGARITHMS: LazyLock<Box<[Polynomial; NODES]>> = LazyLock::new(|| {
    let around = |node: f64| {
        let mut terms = Polynomial::default();
        terms[0] = libm::log(node);
        let mut power = 1.0;
        for (k, term) in terms.iter_mut().enumerate().take(TERMS).skip(1) {
            power /= -node;
            *term = -power / k as f64;
        }
        terms
    };
    Box::new(std::array::from_fn(|place| around(node(place))))
});

/// The node in the middle of its part of the mantissa.
fn node(place: usize) -> f64 {
    1.0 + (place as f64 + 0.5) / NODES as f64
}

/// A number as octave, node and distance from it.
#[derive(Clone, Copy)]
struct Split {
    octave: usize,
    node: usize,
    distance: f64,
}

impl Split {
    /// None for what is no positive number of the table's octaves.
    #[inline]
    fn of(x: f64) -> Option<Self> {
        const FIRST: u64 = (f64::MAX_EXP - 1 + LOWEST_OCTAVE) as u64;
        const REST: u64 = MANTISSA >> NODE_BITS;
        let bits = x.to_bits();
        // The sign is above the exponent: a negative number is beyond all octaves.
        let octave = (bits >> MANTISSA_BITS).wrapping_sub(FIRST);
        if octave >= OCTAVES as u64 {
            return None;
        }
        let mantissa = bits & MANTISSA;
        let middle = (mantissa & !REST) | (REST / 2 + 1);
        // Below 96 and 256.
        #[allow(clippy::cast_possible_truncation)]
        let (octave, node) = (
            octave as usize,
            (mantissa >> (MANTISSA_BITS - NODE_BITS)) as usize,
        );
        Some(Self {
            octave,
            node,
            distance: f64::from_bits(ONE | mantissa) - f64::from_bits(ONE | middle),
        })
    }

    /// A multiple of a polynomial around the node, in an order that leaves the processor
    /// little to wait for: the next step of a simulation begins with the result.
    #[inline]
    fn times(self, factor: f64, terms: &Polynomial) -> f64 {
        let d = self.distance;
        let square = d * d;
        let rest = (terms[2] + terms[3] * d) + square * (terms[4] + terms[5] * d);
        factor * (terms[0] + terms[1] * d) + (factor * square) * rest
    }
}

impl FixedPower {
    /// Prepares xⁿ; none for an exponent that is not worth it (1) or too large.
    pub fn new(exponent: f64) -> Option<Self> {
        #[expect(clippy::float_cmp, reason = "only exactly 1 is Hooke's law")]
        let is_trivial = exponent == 1.0;
        if is_trivial || !(exponent > 0.0 && exponent <= LARGEST) {
            return None;
        }
        let mut octaves = [0.0; OCTAVES];
        for (octave, power) in (LOWEST_OCTAVE..).zip(&mut octaves) {
            *power = libm::pow(libm::exp2(f64::from(octave)), exponent);
        }
        let around = |node: f64| {
            let mut terms = Polynomial::default();
            terms[0] = libm::pow(node, exponent);
            for k in 1..TERMS {
                let before = (k - 1) as f64;
                terms[k] = terms[k - 1] * (exponent - before) / (k as f64 * node);
            }
            terms
        };
        Some(Self {
            exponent,
            octaves,
            nodes: Box::new(std::array::from_fn(|place| around(node(place)))),
        })
    }

    /// The power prepared for the exponent of a model. The last one of each thread is kept:
    /// a fit simulates many sessions with one model.
    pub fn of<R: FromF64, P: Power<R>>(model: &Model<R, P>) -> Option<Rc<Self>> {
        thread_local! {
            static LAST: RefCell<Option<Rc<FixedPower>>> = const { RefCell::new(None) };
        }
        let exponent = model.shifted_exponent().to_f64();
        LAST.with_borrow_mut(|last| {
            let is_it = |last: &Rc<Self>| last.exponent.to_bits() == exponent.to_bits();
            if !last.as_ref().is_some_and(is_it) {
                *last = Self::new(exponent).map(Rc::new);
            }
            last.clone()
        })
    }

    #[inline]
    fn at(&self, split: Split) -> f64 {
        split.times(self.octaves[split.octave], &self.nodes[split.node])
    }
}

/// ln x.
#[inline]
fn logarithm(split: Split) -> f64 {
    // Below 96.
    #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap)]
    let octave = f64::from(split.octave as i32 + LOWEST_OCTAVE);
    octave * std::f64::consts::LN_2 + split.times(1.0, &LOGARITHMS[split.node])
}

impl<'a> Fixed<'a> {
    /// The power function of a model; [`Exact`] where nothing is prepared.
    pub fn new(prepared: Option<&'a Rc<FixedPower>>) -> Self {
        Self(prepared.map(Rc::as_ref))
    }

    #[inline]
    fn split(self, base: f64, exponent: f64) -> Option<(&'a FixedPower, Split)> {
        let prepared = self
            .0
            .filter(|it| it.exponent.to_bits() == exponent.to_bits())?;
        Some((prepared, Split::of(base)?))
    }
}

impl Power<f64> for Fixed<'_> {
    fn pow(base: f64, exponent: f64) -> f64 {
        Exact::pow(base, exponent)
    }

    #[inline]
    fn raise(&self, base: f64, exponent: f64) -> f64 {
        match self.split(base, exponent) {
            Some((prepared, split)) => prepared.at(split),
            None => Exact::pow(base, exponent),
        }
    }
}

impl<const N: usize> Power<Dual<N>> for Fixed<'_> {
    fn pow(base: Dual<N>, exponent: Dual<N>) -> Dual<N> {
        Exact::pow(base, exponent)
    }

    #[inline]
    fn raise(&self, base: Dual<N>, exponent: Dual<N>) -> Dual<N> {
        match self.split(base.value(), exponent.value()) {
            Some((prepared, split)) => {
                base.to_the_power(&exponent, prepared.at(split), || logarithm(split))
            }
            None => Exact::pow(base, exponent),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Over 48 octaves and more exponents than materials have.
        #[test]
        fn it_is_the_platforms_power(exponent in 0.05..LARGEST, log2 in -40.0..8.0_f64) {
            let x = log2.exp2();
            let prepared = Rc::new(FixedPower::new(exponent).unwrap());
            let fixed = Fixed::new(Some(&prepared));
            let (found, exact) = (fixed.raise(x, exponent), x.powf(exponent));
            prop_assert!((found / exact - 1.0).abs() < 1e-14, "{} for {}", found, exact);
            let [base, n] = [x, exponent].map(|it| Dual::<2>::variable(it, 0, 0.7));
            let (found, exact) = (fixed.raise(base, n), Exact::pow(base, n));
            prop_assert!((found.value() / exact.value() - 1.0).abs() < 1e-14);
            let size = exact.value() * (exponent / x + x.ln().abs());
            let apart = found.partials()[0] - exact.partials()[0];
            prop_assert!(apart.abs() < 1e-13 * size, "{} of {}", apart, size);
        }

        /// No step at the seams: a dip in the restoring force would be a second equilibrium.
        #[test]
        fn seams_are_smooth(exponent in 0.1..4.0_f64, place in 0..NODES) {
            let prepared = Rc::new(FixedPower::new(exponent).unwrap());
            let fixed = Fixed::new(Some(&prepared));
            let seam = 1.0 + place as f64 / NODES as f64;
            let [below, above] = [seam.next_down(), seam].map(|x| fixed.raise(x, exponent));
            prop_assert!((above / below - 1.0).abs() < 2e-15, "{} to {}", below, above);
        }
    }

    #[test]
    fn what_is_not_in_the_table_is_the_platforms() {
        let prepared = Rc::new(FixedPower::new(0.7).unwrap());
        let fixed = Fixed::new(Some(&prepared));
        for base in [0.0, -0.0, 1e-30, 1e9, f64::INFINITY] {
            assert_eq!(
                fixed.raise(base, 0.7).to_bits(),
                Exact::pow(base, 0.7).to_bits(),
                "{base}"
            );
        }
        for base in [-1.0, f64::NAN] {
            assert!(fixed.raise(base, 0.7).is_nan(), "{base}");
        }
        assert_eq!(
            fixed.raise(0.3, 0.8).to_bits(),
            Exact::pow(0.3, 0.8).to_bits()
        );
        for exponent in [1.0, 0.0, -1.0, 20.0, f64::NAN] {
            assert!(FixedPower::new(exponent).is_none(), "{exponent}");
        }
    }
}
