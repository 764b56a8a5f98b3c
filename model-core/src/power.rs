//! |θ|ⁿ, the one expensive function of the model.
//!
//! Ludwick's law puts the bending angle to a real power n (Eq. 13 of the paper) in every step.
//! Nothing else in the model costs as much on the ATmega2560, and micromath's `powf` is wrong by
//! up to 30 % below 1 rad, where an actuator spends its life. So the function is a type parameter
//! of the model: [`Minimax`], the default, [`GuardedMicromath`] to compare with a result obtained
//! on micromath, and [`Exact`]. The board steps with a table of the power instead
//! ([`crate::power_table`]); its self-test steps both `f32` functions, for their accuracy and
//! cycles beside the table's, and so does `softrig simulate --arithmetic`. The decision and its
//! numbers: `docs/decisions/0003-power-function.md`; measured errors: `docs/power.md`.

use micromath::F32Ext;

use crate::elementary;
pub use crate::real::Power;
use crate::real::Real;

/// Computes sign(θ)·|θ|ⁿ, the odd continuation of θⁿ to negative angles.
///
/// `angle` is in radians, `exponent` is positive; both are pure numbers, so the result has no
/// unit. The paper's θⁿ (Eq. 13) is
/// undefined for θ < 0; an actuator bends both ways and is as stiff in one
/// direction as in the other.
///
/// # Examples
///
/// ```
/// use model_core::power::{Minimax, signed_power};
///
/// let there = signed_power::<f32, Minimax>(0.5, 2.0);
/// let back = signed_power::<f32, Minimax>(-0.5, 2.0);
/// assert_eq!(there, 0.25);
/// assert_eq!(back, -there);
/// ```
// n = 1 is not singled out here but in the implementations: with numbers that
// carry derivatives, returning θ would lose ∂θⁿ/∂n = θⁿ ln θ.
pub fn signed_power<R: Real, P: Power<R>>(angle: R, exponent: R) -> R {
    if angle < R::zero() {
        -P::pow(-angle, exponent)
    } else {
        P::pow(angle, exponent)
    }
}

/// `f32` power from minimax polynomials: 2^(n·log₂θ).
///
/// Works for every base ≥ 0 and finite exponent. The relative error is at most
/// [`Minimax::LARGEST_ERROR`] where an actuator moves, and
/// 4·10⁻⁷ + 2.7·10⁻⁷·|n·log₂θ| elsewhere (2.60·10⁻⁷ is the most over every base from ½ to 2).
/// Results below 2⁻¹²⁶ are flushed to 0, results above the largest `f32` are infinite.
///
/// 4 300 cycles on the board. Guarantees, which [`GuardedMicromath`] gives too:
///
/// - 0ⁿ = 0 and 1ⁿ = 1, exactly; n = 1 returns the base itself, because that is Hooke's law and
///   must not depend on an approximation.
/// - Never falling in the base, from one `f32` to the next. A dip in the restoring moment would be
///   a second equilibrium.
/// - NaN in either argument gives NaN, and so does a negative base (unless n = 1);
///   [`signed_power`] is the way to negative angles.
/// - The same bits on the board and the desktop.
///
/// # Error budget
///
/// With y = n·log₂θ, the relative error of 2ʸ is ln 2 times the absolute error of y. At θ = 10⁻⁴,
/// n = 3, |y| is 40, and half a unit in the last place of such a number is 1.9·10⁻⁶: the rounding
/// of y alone makes 1.3·10⁻⁶, that of log₂θ, tripled by n, another 1.0·10⁻⁶, and both polynomials
/// together 0.4·10⁻⁶. A better polynomial would therefore gain nothing; between 0.1 and π rad the
/// error is below 10⁻⁶.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Minimax;

/// micromath's `powf` on bases above 1, its reciprocal below, made monotone.
///
/// The relative error is at most [`GuardedMicromath::LARGEST_ERROR`] where an
/// actuator moves. micromath 2.1 is left as it is; the guards are for four
/// faults of it:
///
/// - its `ln` below 1 uses a bit-trick reciprocal (up to 30 % in the power), hence
///   the exact division here;
/// - its `ln` and the seams of its `exp` fall back between neighbouring `f32`,
///   by up to 2·10⁻³ of the power, hence a base cut to twenty bits of
///   mantissa, which turns the power into stairs of 2·10⁻⁶;
/// - its `exp` answers 1 with the number e, 9·10⁻⁶ above what it answers on
///   both sides;
/// - NaN and ∞ come out as finite numbers or the wrong way round.
///
/// What remains is a jump upwards of 6·10⁻⁵·n at 1 rad and of 7.5·10⁻⁴
/// wherever the power passes a power of two.
///
/// 8 800 cycles on the board. What it guarantees is listed at [`Minimax`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct GuardedMicromath;

/// The `f64` power function of the crate `libm`, for desktops only: within one unit in the last
/// place, and of the same bits on all of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Exact;

impl Minimax {
    /// A bound of the relative error for θ ∈ [10⁻⁴, π] rad and n ∈ [1, 3].
    pub const LARGEST_ERROR: f32 = 3e-6;
}

impl GuardedMicromath {
    /// A bound of the relative error for θ ∈ [10⁻⁴, π] rad and n ∈ [1, 3].
    pub const LARGEST_ERROR: f32 = 1e-3;
}

/// Whether θⁿ is θ. A neighbour of 1 is not 1: it takes the general way.
fn is_linear(exponent: f32) -> bool {
    exponent.to_bits() == 1.0_f32.to_bits()
}

impl Power<f32> for Minimax {
    fn pow(base: f32, exponent: f32) -> f32 {
        if is_linear(exponent) {
            return base;
        }
        // No case for base 0: its logarithm is −∞, and 2^−∞ is 0.
        elementary::exp2(exponent * elementary::log2(base))
    }
}

impl Power<f32> for GuardedMicromath {
    fn pow(base: f32, exponent: f32) -> f32 {
        if is_linear(exponent) {
            return base;
        }
        if base >= 1.0 && exponent > 0.0 {
            micromath_above_one(base, exponent)
        } else if base > 0.0 && exponent > 0.0 {
            1.0 / micromath_above_one(1.0 / base, exponent)
        } else if base == 0.0 && exponent > 0.0 {
            0.0
        } else {
            f32::NAN
        }
    }
}

/// micromath's `powf` for bases from 1 upwards, which is exp(n·ln θ), without
/// the places where it falls.
fn micromath_above_one(base: f32, exponent: f32) -> f32 {
    // Three bits are enough for a logarithm that rises at every step; the
    // fourth is for safety.
    const COARSE: u32 = !0xf;
    // ln of the largest f32 is 88.723; micromath's exp makes NaN of what is a
    // little larger.
    const LARGEST: f32 = 88.72;

    if base == f32::INFINITY {
        return base;
    }
    let mut y = exponent * F32Ext::ln(f32::from_bits(base.to_bits() & COARSE));
    if y > LARGEST {
        return f32::INFINITY;
    }
    if (y - 1.0).abs() < f32::EPSILON {
        y = 1.0 - f32::EPSILON;
    }
    F32Ext::exp(y)
}

#[cfg(feature = "std")]
impl Power<f64> for Exact {
    #[expect(clippy::float_cmp, reason = "only exactly 1 is Hooke's law")]
    fn pow(base: f64, exponent: f64) -> f64 {
        // The same result without the cost: linear models are common.
        if exponent == 1.0 {
            base
        } else {
            libm::pow(base, exponent)
        }
    }
}

#[cfg(test)]
#[expect(
    clippy::float_cmp,
    reason = "what is exact is promised to the last bit"
)]
mod tests {
    use core::f32::consts::PI;

    use proptest::prelude::*;

    use super::*;

    /// Exponents of the sweeps: both ends of the range, ordinary materials,
    /// whole numbers and a neighbour of Hooke's law.
    const EXPONENTS: [f32; 9] = [1.000_1, 1.1, 1.5, 1.75, 2.0, 2.365, 2.5, 2.9, 3.0];

    fn relative_error(computed: f32, base: f32, exponent: f32) -> f64 {
        let exact = f64::from(base).powf(f64::from(exponent));
        (f64::from(computed) - exact).abs() / exact
    }

    /// Bases from 10⁻⁴ to π, evenly spread in their bits and so nearly in
    /// their logarithm.
    fn bases(step: u32) -> impl Iterator<Item = f32> {
        (1e-4_f32.to_bits()..=PI.to_bits())
            .step_by(usize::try_from(step).expect("a step fits"))
            .map(f32::from_bits)
    }

    fn largest_error<P: Power<f32>>(step: u32) -> f64 {
        let mut largest = 0.0_f64;
        for exponent in EXPONENTS {
            for base in bases(step) {
                let error = relative_error(P::pow(base, exponent), base, exponent);
                assert!(error.is_finite(), "{base}^{exponent}");
                largest = largest.max(error);
            }
        }
        largest
    }

    /// Checks that nothing falls between neighbouring `f32` around `centre`.
    fn rises_around<P: Power<f32>>(centre: f32, neighbours: u32, exponent: f32) {
        let first = centre.to_bits() - neighbours;
        let mut before = P::pow(f32::from_bits(first), exponent);
        for bits in first + 1..=centre.to_bits() + neighbours {
            let base = f32::from_bits(bits);
            let here = P::pow(base, exponent);
            assert!(here >= before, "{base}^{exponent}: {before} then {here}");
            before = here;
        }
    }

    fn rises_everywhere<P: Power<f32>>() {
        for exponent in EXPONENTS {
            // Where an octave, the reciprocal or the range begins or ends, and
            // where the power itself passes 1/8, ½, 2, 4 and e.
            let mut centres = vec![1e-4, 0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, PI];
            for power in [0.125_f64, 0.5, 2.0, 4.0, core::f64::consts::E] {
                #[expect(clippy::cast_possible_truncation)]
                centres.push(power.powf(1.0 / f64::from(exponent)) as f32);
            }
            for half_octave in [0.707_106_77, core::f32::consts::SQRT_2] {
                centres.push(half_octave);
            }
            for centre in centres {
                rises_around::<P>(centre, 1 << 12, exponent);
            }
            let mut before = 0.0;
            for base in bases(331) {
                let here = P::pow(base, exponent);
                assert!(here >= before, "{base}^{exponent}: {before} then {here}");
                before = here;
            }
        }
    }

    fn exact_values<P: Power<f32>>() {
        for exponent in EXPONENTS {
            assert_eq!(P::pow(0.0, exponent).to_bits(), 0.0_f32.to_bits());
            assert_eq!(P::pow(-0.0, exponent), 0.0);
            assert_eq!(P::pow(1.0, exponent).to_bits(), 1.0_f32.to_bits());
        }
        for base in bases(9_973).chain([0.0, f32::MIN_POSITIVE, 1e-45, 1e30]) {
            assert_eq!(P::pow(base, 1.0).to_bits(), base.to_bits());
            let (there, back) = (
                signed_power::<f32, P>(base, 1.0),
                signed_power::<f32, P>(-base, 1.0),
            );
            assert_eq!(there, base);
            assert_eq!(back, -base);
        }
    }

    fn special_values<P: Power<f32>>() {
        assert!(P::pow(f32::NAN, 2.0).is_nan());
        assert!(P::pow(f32::NAN, 1.0).is_nan());
        assert!(P::pow(0.5, f32::NAN).is_nan());
        assert!(P::pow(2.0, f32::NAN).is_nan());
        assert!(P::pow(0.0, f32::NAN).is_nan());
        assert!(P::pow(-0.5, 2.0).is_nan());
        assert!(P::pow(f32::NEG_INFINITY, 2.0).is_nan());
        assert!(signed_power::<f32, P>(f32::NAN, 2.0).is_nan());
        assert_eq!(P::pow(f32::INFINITY, 1.5), f32::INFINITY);
        assert_eq!(
            signed_power::<f32, P>(f32::NEG_INFINITY, 1.5),
            f32::NEG_INFINITY
        );
        assert_eq!(P::pow(1e30, 2.0), f32::INFINITY);
        assert_eq!(P::pow(f32::MAX, 3.0), f32::INFINITY);
        // Subnormal bases and results: no garbage, no fall below 0.
        for base in [1e-45, 1e-42, 1e-39, f32::MIN_POSITIVE] {
            for exponent in [1.000_1, 2.0, 3.0] {
                let power = P::pow(base, exponent);
                assert!((0.0..=2.0 * base).contains(&power), "{base}^{exponent}");
            }
        }
        // The edge of overflow belongs to neither NaN nor a wrong sign.
        for base in [1.8e19_f32, 1.84e19, 1.844e19, 1.845e19, 1.85e19] {
            let power = P::pow(base, 2.0);
            assert!(power > 3e38, "{base}^2 = {power}");
        }
    }

    #[test]
    fn minimax_stays_within_its_published_error() {
        let largest = largest_error::<Minimax>(1_009);
        assert!(
            largest <= f64::from(Minimax::LARGEST_ERROR),
            "largest relative error {largest:e}"
        );
        // A bound that is far too wide would not notice a worse function.
        assert!(
            largest >= 0.5 * f64::from(Minimax::LARGEST_ERROR),
            "{largest:e}"
        );
    }

    #[test]
    fn minimax_is_better_still_at_ordinary_angles() {
        for exponent in EXPONENTS {
            for base in bases(1_009).filter(|base| *base >= 0.1) {
                let error = relative_error(Minimax::pow(base, exponent), base, exponent);
                assert!(error <= 1e-6, "{base}^{exponent}: {error:e}");
            }
        }
    }

    #[test]
    fn guarded_micromath_stays_within_its_published_error() {
        let largest = largest_error::<GuardedMicromath>(1_009);
        assert!(
            largest <= f64::from(GuardedMicromath::LARGEST_ERROR),
            "largest relative error {largest:e}"
        );
        assert!(
            largest >= 0.5 * f64::from(GuardedMicromath::LARGEST_ERROR),
            "{largest:e}"
        );
    }

    #[test]
    fn micromath_still_needs_the_guard() {
        // Should a later micromath be right here, the guard can go.
        let unguarded = F32Ext::powf(0.8371_f32, 2.365);
        assert!(relative_error(unguarded, 0.8371, 2.365) > 0.2);
    }

    #[test]
    fn zero_one_and_the_first_power_are_exact() {
        exact_values::<Minimax>();
        exact_values::<GuardedMicromath>();
    }

    #[test]
    fn minimax_is_exact_at_powers_of_two() {
        for octave in -10_i16..=10 {
            let base = f32::from(octave).exp2();
            assert_eq!(Minimax::pow(base, 2.0), base * base);
            assert_eq!(Minimax::pow(base, 3.0), base * base * base);
        }
    }

    #[test]
    fn neither_falls_between_neighbours() {
        rises_everywhere::<Minimax>();
        rises_everywhere::<GuardedMicromath>();
    }

    #[test]
    fn micromaths_logarithm_rises_on_the_coarse_mantissas() {
        // All of one octave: with rounding being monotone, this is the proof
        // that the guarded power rises everywhere.
        let mut before = F32Ext::ln(1.0_f32);
        for mantissa in (0x10..0x0080_0000_u32).step_by(0x10) {
            let x = f32::from_bits(1.0_f32.to_bits() + mantissa);
            let here = F32Ext::ln(x);
            assert!(here >= before, "ln {x}");
            before = here;
        }
        assert!(F32Ext::ln(2.0_f32) >= before);
    }

    #[test]
    fn special_values_are_answered() {
        special_values::<Minimax>();
        special_values::<GuardedMicromath>();
    }

    #[test]
    fn the_bits_do_not_change() {
        // A digest of many results, the same on every machine: it changes if a
        // compiler fuses or reorders an operation, or if a coefficient does.
        fn digest<P: Power<f32>>() -> u32 {
            let mut sum = 0x811c_9dc5_u32;
            for exponent in EXPONENTS {
                for base in bases(1_000_003) {
                    sum = (sum ^ P::pow(base, exponent).to_bits()).wrapping_mul(0x0100_0193);
                }
            }
            sum
        }
        assert_eq!(digest::<Minimax>(), 0xf6ce_a295);
        assert_eq!(digest::<GuardedMicromath>(), 0x05d8_a8ae);
    }

    /// The worst base of all from ½ to 2.
    #[test]
    fn minimax_keeps_its_error_at_the_worst_base() {
        let (base, exponent) = (1.015_823_5_f32, -3_986.802_2_f32);
        let error = relative_error(Minimax::pow(base, exponent), base, exponent);
        let power = f64::from(exponent) * f64::from(base).log2();
        let bound = 4e-7 + 2.7e-7 * power.abs();
        assert!(
            error <= bound && error > 0.9 * bound,
            "{error:e} of {bound:e}"
        );
    }

    #[cfg(feature = "std")]
    #[test]
    fn exact_is_within_a_unit_in_the_last_place_of_the_platforms() {
        for base in [1e-4, 0.3, 0.999_999, 1.7, 3.1] {
            for exponent in [0.4, 1.1, 2.365, 2.9] {
                let [one, other] = [Exact::pow(base, exponent), f64::powf(base, exponent)];
                let apart = one.to_bits().abs_diff(other.to_bits());
                assert!(apart <= 1, "{base}^{exponent}: {one:e}, {other:e}");
            }
        }
        assert_eq!(signed_power::<f64, Exact>(-2.0, 3.0), -8.0);
        assert_eq!(signed_power::<f64, Exact>(-0.7, 1.0), -0.7);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn random_arguments_stay_within_the_error(
            logarithm in 1e-4_f64.ln()..core::f64::consts::PI.ln(),
            exponent in 1.0_f32..=3.0,
        ) {
            #[expect(clippy::cast_possible_truncation)]
            let base = logarithm.exp() as f32;
            let minimax = relative_error(Minimax::pow(base, exponent), base, exponent);
            let guarded = relative_error(GuardedMicromath::pow(base, exponent), base, exponent);
            prop_assert!(minimax <= f64::from(Minimax::LARGEST_ERROR), "{:e}", minimax);
            prop_assert!(guarded <= f64::from(GuardedMicromath::LARGEST_ERROR), "{:e}", guarded);
        }

        #[test]
        fn minimax_keeps_its_error_elsewhere_too(
            logarithm in -40.0_f32..40.0,
            result in -120.0_f32..120.0,
        ) {
            let base = logarithm.exp2();
            let exponent = (result / logarithm).clamp(-1e6, 1e6);
            let error = relative_error(Minimax::pow(base, exponent), base, exponent);
            let bound = 4e-7 + 2.7e-7 * f64::from(result.abs());
            prop_assert!(error <= bound, "{:e} above {:e}", error, bound);
        }

        #[test]
        fn powers_of_one_base_multiply(
            base in 1e-3_f32..=PI,
            first in 1.0_f32..=1.5,
            second in 1.0_f32..=1.5,
        ) {
            fn mismatch<P: Power<f32>>(base: f32, first: f32, second: f32) -> f32 {
                let whole = P::pow(base, first + second);
                (P::pow(base, first) * P::pow(base, second) - whole).abs() / whole
            }
            prop_assert!(mismatch::<Minimax>(base, first, second) <= 3.0 * Minimax::LARGEST_ERROR);
            prop_assert!(
                mismatch::<GuardedMicromath>(base, first, second)
                    <= 3.0 * GuardedMicromath::LARGEST_ERROR
            );
        }

        #[test]
        fn signed_power_is_odd_and_keeps_the_sign(
            angle in 0.0_f32..=PI,
            exponent in 1.0_f32..=3.0,
        ) {
            fn check<P: Power<f32>>(angle: f32, exponent: f32) -> bool {
                let there = signed_power::<f32, P>(angle, exponent);
                let back = signed_power::<f32, P>(-angle, exponent);
                there == -back && there >= 0.0
            }
            prop_assert!(check::<Minimax>(angle, exponent));
            prop_assert!(check::<GuardedMicromath>(angle, exponent));
        }

        #[test]
        fn a_larger_angle_never_has_a_smaller_power(
            first in 0.0_f32..=PI,
            second in 0.0_f32..=PI,
            exponent in 1.0_f32..=3.0,
        ) {
            let (low, high) = if first < second { (first, second) } else { (second, first) };
            prop_assert!(Minimax::pow(low, exponent) <= Minimax::pow(high, exponent));
            prop_assert!(
                GuardedMicromath::pow(low, exponent) <= GuardedMicromath::pow(high, exponent)
            );
        }
    }
}
