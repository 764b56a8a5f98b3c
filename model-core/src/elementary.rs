//! Elementary functions in `f32`, the same bits on the board and the desktop.
//!
//! The platform's `exp` or `sin` differs from machine to machine in the last place, and
//! micromath's are wrong in the third digit. A prediction that is compared bit for bit needs its
//! own. These use `+ − × ÷`, comparisons and the bits of a number, each of which IEEE 754 fixes:
//! no fused multiply-add, no square root, no `f64`, no table (it would be copied to the ATmega's
//! RAM). NaN gives NaN, with any payload. The tests here hold the bounds of the errors;
//! `cargo run --release -p softrig-bench --example power_error` prints the measured values. The
//! coefficients come from `docs/power_coefficients.py`.

use core::f32::consts::{FRAC_2_PI, FRAC_PI_2, LN_2, LOG2_E, PI, TAU};

/// c₀ + c₁x + c₂x² + …, by Horner's rule and unrolled, so that the coefficients
/// become immediate operands.
///
/// [`exp2`], [`exp`], [`log2`] and [`ln`] are monotone by construction: they never fall from one
/// `f32` to the next. A rounded sum or product of non-negative, non-decreasing terms is
/// non-decreasing, so a Horner scheme with positive coefficients on a positive argument cannot
/// step down, however it rounds. This is why 2ᶠ is approximated on [0, 1] and not on [−½, ½], and
/// why the logarithm uses the odd series in s = (m−1)/(m+1), whose coefficients are all positive.
macro_rules! polynomial {
    ($x:expr; $c:expr) => { $c };
    ($x:expr; $c:expr, $($rest:expr),+) => {
        polynomial!($x; $($rest),+) * $x + $c
    };
}

/// Adding this number rounds to a whole number and leaves that number in the
/// low bits; taking it off again returns the whole number as a float. Two
/// additions cost less on the AVR than a conversion to an integer and back.
const ROUND: f32 = 12_582_912.0; // 1.5·2²³

const MANTISSA_MASK: u32 = 0x007f_ffff;
const SIGN_MASK: u32 = 0x8000_0000;
const INFINITY_BITS: u32 = 0x7f80_0000;
const MIN_POSITIVE_BITS: u32 = 0x0080_0000;
/// √½, where the octaves of the logarithm meet.
const SQRT_HALF_BITS: u32 = 0x3f35_04f3;

/// Computes 2ˣ.
///
/// Relative error ≤ 2·10⁻⁷; exact for whole `x`; non-decreasing. From 128
/// upwards the result is infinite, and below −126 it is 0: results that would
/// be subnormal are flushed.
pub fn exp2(x: f32) -> f32 {
    // One comparison of integers instead of two of floats.
    if x.to_bits() & !SIGN_MASK < 126.0_f32.to_bits() {
        exp2_in_range(x)
    } else {
        exp2_of_special(x)
    }
}

fn exp2_in_range(x: f32) -> f32 {
    let shifted = x + ROUND;
    let mut whole = shifted.to_bits();
    let mut fraction = x - (shifted - ROUND);
    // −0 counts as negative here, and then gives 2¹·2⁻¹.
    if fraction.is_sign_negative() {
        fraction += 1.0;
        whole -= 1;
    }
    let power = polynomial!(fraction;
        1.0, 0.693_151_7, 0.240_159_48, 0.055_818_12, 0.008_991_599, 0.001_879_088_6);
    f32::from_bits(power.to_bits().wrapping_add(exponent_field(whole)))
}

#[cold]
fn exp2_of_special(x: f32) -> f32 {
    if (-126.0..128.0).contains(&x) {
        exp2_in_range(x)
    } else if x >= 128.0 {
        f32::INFINITY
    } else if x < -126.0 {
        0.0
    } else {
        f32::NAN
    }
}

/// Moves the low nine bits of a whole number to where the exponent and the
/// sign of an `f32` are.
///
/// The same as `whole << 23`. The AVR shifts one place at a time; whole bytes
/// cost it nothing.
fn exponent_field(whole: u32) -> u32 {
    let [low, next, ..] = whole.to_le_bytes();
    u32::from(u16::from_le_bytes([low, next]) << 7) << 16
}

/// Computes eˣ.
///
/// Relative error ≤ 2·10⁻⁷ + 7.5·10⁻⁸·|x|, at most 7·10⁻⁷ up to |x| = 10 and 4.5·10⁻⁶
/// anywhere; exp(0) = 1; non-decreasing. From
/// 88.73 upwards the result is infinite, below −87.33 it is 0.
pub fn exp(x: f32) -> f32 {
    exp2(x * LOG2_E)
}

/// Computes the logarithm to base 2.
///
/// Relative error ≤ 3.5·10⁻⁷, also close to 1; exact at the powers of two;
/// non-decreasing. ±0 gives −∞, ∞ gives ∞, negative numbers give NaN.
pub fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    if (MIN_POSITIVE_BITS..INFINITY_BITS).contains(&bits) {
        log2_of_normal(bits)
    } else {
        log2_of_special(x)
    }
}

fn log2_of_normal(bits: u32) -> f32 {
    let offset = bits.wrapping_sub(SQRT_HALF_BITS);
    // `offset >> 23` in two steps: the AVR shifts one place at a time, but whole
    // bytes for nothing.
    let [.., next, high] = offset.to_le_bytes();
    let octave = i16::from_le_bytes([next, high]) >> 7;
    // In [√½, √2), so that nothing cancels when the octave is added.
    let mantissa = f32::from_bits((offset & MANTISSA_MASK) + SQRT_HALF_BITS);
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let z = s * s;
    let fraction = s * polynomial!(z; 2.885_390_5, 0.961_552_9, 0.597_154_44);
    fraction + f32::from(octave)
}

#[cold]
fn log2_of_special(x: f32) -> f32 {
    if x == 0.0 {
        f32::NEG_INFINITY
    } else if x < 0.0 || x.is_nan() {
        f32::NAN
    } else if x == f32::INFINITY {
        x
    } else {
        // A subnormal number, brought to a normal one by 2²³.
        log2_of_normal((x * 8_388_608.0).to_bits()) - 23.0
    }
}

/// Computes the natural logarithm.
///
/// Relative error ≤ 4·10⁻⁷, also close to 1; ln 1 = 0; non-decreasing. ±0
/// gives −∞, ∞ gives ∞, negative numbers give NaN.
pub fn ln(x: f32) -> f32 {
    log2(x) * LN_2
}

/// Computes the hyperbolic tangent.
///
/// Relative error ≤ 3·10⁻⁷; exactly odd; within ±1, which it reaches
/// at 9.1.
pub fn tanh(x: f32) -> f32 {
    let magnitude = x.abs();
    let value = if magnitude < 0.55 {
        let z = magnitude * magnitude;
        let bend = polynomial!(z; -0.333_329_47, 0.133_207_29, -0.052_672_01, 0.016_437_879);
        magnitude + magnitude * (z * bend)
    } else {
        1.0 - 2.0 / (exp(magnitude + magnitude) + 1.0)
    };
    f32::from_bits(value.to_bits() | (x.to_bits() & SIGN_MASK))
}

/// The largest angle of [`sin`] and [`cos`], in radians: 2¹⁵ quarter turns.
///
/// Neighbouring `f32` are 4 mrad apart here, so an angle that is larger still
/// has left the model rather than turned many times.
pub const LARGEST_ANGLE: f32 = 51_471.0;

/// Computes the sine of an angle in radians.
///
/// Absolute error ≤ 1.5·10⁻⁷ up to [`LARGEST_ANGLE`], NaN beyond; relative
/// error ≤ 2·10⁻⁷ for |x| ≤ π/4; exactly odd; within ±1.
pub fn sin(x: f32) -> f32 {
    let (rest, quarters) = reduce(x);
    sin_of_quarter(rest, quarters)
}

/// Computes the sine of an angle in radians that is near zero: a turn or two.
///
/// Absolute error ≤ 7·10⁻⁵ within a turn; exactly odd. A third of the work of [`sin`], for
/// a force that is asked for in every step. Turns are taken off one by one; NaN beyond
/// [`LARGEST_NEAR`].
pub fn sin_near(x: f32) -> f32 {
    // Compared as bits, which costs a processor without floats a tenth.
    let bits = x.to_bits();
    let mut sign = bits & SIGN_MASK;
    let mut t = f32::from_bits(bits & !SIGN_MASK);
    if t.to_bits() > LARGEST_NEAR.to_bits() {
        return f32::NAN;
    }
    while t.is_sign_positive() && t.to_bits() > PI.to_bits() {
        t -= TAU;
    }
    if t.is_sign_negative() {
        sign ^= SIGN_MASK;
        t = -t;
    }
    if t.to_bits() > FRAC_PI_2.to_bits() {
        t = PI - t;
    }
    let z = t * t;
    let sine = t * polynomial!(z; 0.999_696_8, -0.165_673_1, 0.007_514_386);
    f32::from_bits(sine.to_bits() ^ sign)
}

/// The largest angle of [`sin_near`], in radians.
pub const LARGEST_NEAR: f32 = 100.0;

/// Computes the cosine of an angle in radians.
///
/// Absolute error ≤ 1.5·10⁻⁷ up to [`LARGEST_ANGLE`], NaN beyond; exactly
/// even; within ±1; cos 0 = 1.
pub fn cos(x: f32) -> f32 {
    let (rest, quarters) = reduce(x);
    sin_of_quarter(rest, quarters.wrapping_add(1))
}

/// Splits an angle into quarter turns and a rest within ±π/4.
///
/// π/2 is subtracted in three parts. The first two have nine bits each, so
/// that up to 2¹⁵ times them is exact, and so are the two differences.
fn reduce(x: f32) -> (f32, u32) {
    if x.abs() <= LARGEST_ANGLE {
        let shifted = x * FRAC_2_PI + ROUND;
        let turns = shifted - ROUND;
        let rest =
            ((x - turns * 1.570_312_5) - turns * 0.000_483_512_88) - turns * 0.000_000_313_916_47;
        (rest, shifted.to_bits())
    } else {
        (f32::NAN, 0)
    }
}

/// The sine of `rest` plus a number of quarter turns, whose low two bits matter.
fn sin_of_quarter(rest: f32, quarters: u32) -> f32 {
    let z = rest * rest;
    let value = if quarters & 1 == 0 {
        let bend = polynomial!(z; -0.166_666_55, 0.008_332_189, -0.000_195_182_92);
        rest + rest * (z * bend)
    } else {
        1.0 + z * polynomial!(z; -0.499_998_96, 0.041_656_334, -0.001_359_822_3)
    };
    if quarters & 2 == 0 { value } else { -value }
}

/// Up to where two terms of the series of an exponential do. A comparison of bits costs
/// a tenth of one of floats.
pub(crate) const SMALL: u32 = (1.0_f32 / 32.0).to_bits();

/// Up to where three do.
pub(crate) const MODERATE: u32 = 0.25_f32.to_bits();

/// 1 − e^(−u): by its series, within 7·10⁻⁴ of itself, or the exponential.
pub(crate) fn decayed(u: f32) -> f32 {
    let size = u.abs().to_bits();
    if size < SMALL {
        u * (1.0 - u * 0.5)
    } else if size < MODERATE {
        u * (1.0 - u * (0.5 - u * (1.0 / 6.0)))
    } else {
        1.0 - exp(-u)
    }
}

#[cfg(test)]
#[expect(
    clippy::float_cmp,
    reason = "what is exact is promised to the last bit"
)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Every `step`-th `f32` from `low` to `high`, both positive.
    fn positive(low: f32, high: f32, step: u32) -> impl Iterator<Item = f32> {
        (low.to_bits()..=high.to_bits())
            .step_by(usize::try_from(step).expect("a step fits"))
            .map(f32::from_bits)
    }

    fn both_signs(low: f32, high: f32, step: u32) -> impl Iterator<Item = f32> {
        positive(low, high, step).flat_map(|x| [x, -x])
    }

    /// The largest relative error, with `Err` for a result that is not finite.
    fn largest_error(
        arguments: impl Iterator<Item = f32>,
        computed: impl Fn(f32) -> f32,
        exact: impl Fn(f64) -> f64,
        relative: bool,
    ) -> f64 {
        let mut largest = 0.0_f64;
        for x in arguments {
            let (is, should) = (f64::from(computed(x)), exact(f64::from(x)));
            let mut error = (is - should).abs();
            if relative && should != 0.0 {
                error /= should.abs();
            }
            assert!(error.is_finite(), "at {x}: {is} for {should}");
            largest = largest.max(error);
        }
        largest
    }

    fn assert_rises(arguments: impl Iterator<Item = f32>, function: impl Fn(f32) -> f32) {
        let mut before = f32::NEG_INFINITY;
        for x in arguments {
            let here = function(x);
            assert!(here >= before, "at {x}: {before} then {here}");
            before = here;
        }
    }

    /// Both sides: the function is no worse than it says, and what it says is
    /// not so wide that a worse function would pass.
    fn assert_close_to_bound(error: f64, bound: f64) {
        assert!(error <= bound, "error {error:e} above {bound:e}");
        assert!(error >= 0.4 * bound, "error {error:e} far below {bound:e}");
    }

    #[test]
    fn exp2_keeps_its_error() {
        let error = largest_error(both_signs(1e-8, 126.0, 97), exp2, f64::exp2, true);
        assert_close_to_bound(error, 2e-7);
    }

    #[test]
    fn exp_keeps_its_error() {
        let error = largest_error(both_signs(1e-8, 10.0, 97), exp, f64::exp, true);
        assert_close_to_bound(error, 7e-7);
        let error = largest_error(both_signs(10.0, 87.0, 31), exp, f64::exp, true);
        assert_close_to_bound(error, 4.5e-6);
        for x in both_signs(1e-8, 87.0, 1_009) {
            let exact = f64::from(x).exp();
            let error = (f64::from(exp(x)) - exact).abs() / exact;
            assert!(
                error <= 2e-7 + 7.5e-8 * f64::from(x.abs()),
                "exp {x}: {error:e}"
            );
        }
    }

    #[test]
    fn log2_and_ln_keep_their_error_also_close_to_one() {
        let error = largest_error(positive(0.5, 2.0, 7), log2, f64::log2, true);
        assert_close_to_bound(error, 3.5e-7);
        let error = largest_error(positive(0.5, 2.0, 7), ln, f64::ln, true);
        assert_close_to_bound(error, 4e-7);
        for function in [
            (log2 as fn(f32) -> f32, f64::log2 as fn(f64) -> f64),
            (ln, f64::ln),
        ] {
            let error = largest_error(positive(1e-44, 3e38, 997), function.0, function.1, true);
            assert!(error <= 4e-7, "{error:e}");
        }
    }

    #[test]
    fn tanh_keeps_its_error() {
        let error = largest_error(both_signs(1e-30, 0.55, 997), tanh, f64::tanh, true);
        assert!(error <= 1.2e-7, "{error:e}");
        let error = largest_error(both_signs(0.5, 20.0, 31), tanh, f64::tanh, true);
        assert_close_to_bound(error, 3e-7);
    }

    #[test]
    fn sin_and_cos_keep_their_error() {
        let quarter = core::f32::consts::FRAC_PI_4;
        let error = largest_error(both_signs(1e-30, quarter, 997), sin, f64::sin, true);
        assert!(error <= 2e-7, "{error:e}");
        for (low, high) in [(1e-6, 1.0), (1.0, 100.0), (100.0, LARGEST_ANGLE)] {
            let error = largest_error(both_signs(low, high, 53), sin, f64::sin, false);
            assert!(error <= 1.5e-7, "sin to {high}: {error:e}");
            let error = largest_error(both_signs(low, high, 53), cos, f64::cos, false);
            assert_close_to_bound(error, 1.5e-7);
        }
    }

    #[test]
    fn sin_near_keeps_its_error_and_is_odd() {
        let mut worst = 0.0_f64;
        for step in 0..=63_000_i32 {
            let angle = step as f32 * 1e-4;
            let sine = sin_near(angle);
            worst = worst.max((f64::from(sine) - f64::from(angle).sin()).abs());
            assert_eq!(sin_near(-angle), -sine, "{angle}");
        }
        assert_close_to_bound(worst, 7e-5);
        assert!((sin_near(40.0) - sin(40.0)).abs() < 1e-4);
        assert!(sin_near(1e3).is_nan() && sin_near(f32::NAN).is_nan());
    }

    #[test]
    fn sin_and_cos_are_right_next_to_quarter_turns() {
        // Where the reduction cancels: the rest must come from all of π/2.
        for quarters in 1..=32_768_u16 {
            #[expect(clippy::cast_possible_truncation)]
            let x = (f64::from(quarters) * core::f64::consts::FRAC_PI_2) as f32;
            for x in [x.next_down(), x, x.next_up()] {
                if x <= LARGEST_ANGLE {
                    let error = (f64::from(sin(x)) - f64::from(x).sin()).abs();
                    assert!(error <= 1.5e-7, "sin {x}: {error:e}");
                    let error = (f64::from(cos(x)) - f64::from(x).cos()).abs();
                    assert!(error <= 1.5e-7, "cos {x}: {error:e}");
                }
            }
        }
    }

    #[test]
    fn exact_values_are_exact() {
        assert_eq!(exp(0.0).to_bits(), 1.0_f32.to_bits());
        assert_eq!(exp(-0.0).to_bits(), 1.0_f32.to_bits());
        assert_eq!(ln(1.0).to_bits(), 0.0_f32.to_bits());
        assert_eq!(sin(0.0).to_bits(), 0.0_f32.to_bits());
        assert_eq!(cos(0.0).to_bits(), 1.0_f32.to_bits());
        assert_eq!(tanh(0.0).to_bits(), 0.0_f32.to_bits());
        assert_eq!(tanh(-0.0).to_bits(), (-0.0_f32).to_bits());
        for octave in -126_i16..=127 {
            let power = exp2(f32::from(octave));
            assert_eq!(
                power.to_bits(),
                u32::from((octave + 127).cast_unsigned()) << 23
            );
            assert_eq!(log2(power).to_bits(), f32::from(octave).to_bits());
        }
    }

    #[test]
    fn logarithm_never_falls_in_a_whole_octave() {
        // Every f32 of the octave in which the mantissa is reduced, and the
        // seams on both sides: other octaves only add a whole number.
        assert_rises(positive(0.7, 1.5, 1), log2);
        assert_rises(positive(0.7, 1.5, 1), ln);
        for centre in [
            1e-40_f32,
            f32::MIN_POSITIVE,
            0.353_553_4,
            0.5,
            2.828_427,
            4.0,
            1e30,
        ] {
            let bits = centre.to_bits();
            let around = (bits - 5_000..bits + 5_000).map(f32::from_bits);
            assert_rises(around, log2);
        }
    }

    #[test]
    fn exponential_never_falls() {
        // Every f32 of [0.5, 2] crosses a whole number and both halves.
        assert_rises(positive(0.5, 2.0, 1), exp2);
        assert_rises(positive(0.5, 2.0, 1).map(|x| x - 2.0), exp2);
        assert_rises(positive(1e-12, 130.0, 61), exp2);
        assert_rises(positive(1e-12, 130.0, 61).map(|x| 1.0 / -x), exp2);
        assert_rises(positive(1e-12, 90.0, 61), exp);
        for whole in [-126_i16, -125, -1, 1, 7, 126, 127] {
            let bits = f32::from(whole).to_bits();
            let around = (bits - 5_000..bits + 5_000).map(f32::from_bits);
            if whole > 0 {
                assert_rises(around, exp2);
            } else {
                assert_rises(around.map(|x| -x), |x| -exp2(-x));
            }
        }
    }

    #[test]
    fn tanh_never_falls_and_stays_within_one() {
        assert_rises(positive(1e-20, 0.4, 101), tanh);
        assert_rises(positive(0.4, 0.7, 1), tanh);
        assert_rises(positive(0.7, 100.0, 11), tanh);
        assert_eq!(tanh(9.1), 1.0);
        assert!(tanh(8.0) < 1.0);
        for x in [9.1, 30.0, 44.3, 44.4, 100.0, f32::MAX, f32::INFINITY] {
            assert_eq!(tanh(x), 1.0, "tanh {x}");
            assert_eq!(tanh(-x), -1.0, "tanh {x}");
        }
    }

    #[test]
    fn special_values_are_answered() {
        for function in [exp2, exp, log2, ln, tanh, sin, cos] {
            assert!(function(f32::NAN).is_nan());
            assert!(function(f32::from_bits(0x7f80_0155)).is_nan());
        }
        for function in [sin, cos] {
            assert!(function(f32::INFINITY).is_nan());
            assert!(function(f32::NEG_INFINITY).is_nan());
            assert!(function(LARGEST_ANGLE).is_finite());
            assert!(function(-LARGEST_ANGLE).is_finite());
            assert!(function(LARGEST_ANGLE.next_up()).is_nan());
        }
        assert_eq!(exp2(f32::INFINITY), f32::INFINITY);
        assert_eq!(exp2(128.0), f32::INFINITY);
        assert!(exp2(128.0_f32.next_down()).is_finite());
        assert_eq!(exp2(-126.0), f32::MIN_POSITIVE);
        assert_eq!(exp2((-126.0_f32).next_down()), 0.0);
        assert_eq!(exp2(f32::NEG_INFINITY), 0.0);
        assert_eq!(exp(88.73), f32::INFINITY);
        assert!(exp(88.72).is_finite());
        assert!(exp(-87.33) > 0.0);
        assert_eq!(exp(-87.34), 0.0);
        for logarithm in [log2, ln] {
            assert_eq!(logarithm(0.0), f32::NEG_INFINITY);
            assert_eq!(logarithm(-0.0), f32::NEG_INFINITY);
            assert_eq!(logarithm(f32::INFINITY), f32::INFINITY);
            assert!(logarithm(-1e-45).is_nan());
            assert!(logarithm(-1.0).is_nan());
            assert!(logarithm(f32::NEG_INFINITY).is_nan());
        }
        assert_eq!(log2(f32::from_bits(1)), -149.0);
        assert_eq!(sin(1e-45), 1e-45);
    }

    #[test]
    fn the_bits_do_not_change() {
        // A digest of many results, the same on every machine: it changes if a
        // compiler fuses or reorders an operation, or if a coefficient does.
        let digest = |function: fn(f32) -> f32| {
            both_signs(1e-3, 80.0, 100_003)
                .map(function)
                .filter(|y| !y.is_nan())
                .fold(0x811c_9dc5_u32, |sum, y| {
                    (sum ^ y.to_bits()).wrapping_mul(0x0100_0193)
                })
        };
        let digests = [exp2, exp, log2, ln, tanh, sin, cos].map(digest);
        assert_eq!(
            digests,
            [
                0x5fae_e607,
                0xb14b_5364,
                0xad95_e505,
                0x3f2f_c6d1,
                0x52ca_7103,
                0x8939_843d,
                0x3f9a_13fb
            ]
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(10_000))]

        #[test]
        fn tanh_and_sin_are_odd_and_cos_is_even(x in any::<f32>()) {
            for function in [tanh, sin] {
                let (there, back) = (function(x), function(-x));
                prop_assert!(there.is_nan() && back.is_nan() || there == -back);
            }
            let (there, back) = (cos(x), cos(-x));
            prop_assert!(there.is_nan() && back.is_nan() || there == back);
        }

        #[test]
        fn sin_and_cos_stay_on_the_circle(x in -LARGEST_ANGLE..=LARGEST_ANGLE) {
            let (s, c) = (sin(x), cos(x));
            prop_assert!(s.abs() <= 1.0 && c.abs() <= 1.0);
            prop_assert!((s * s + c * c - 1.0).abs() <= 5e-7);
        }

        #[test]
        fn exp_undoes_ln(x in 1e-3_f32..1e3) {
            prop_assert!((exp(ln(x)) - x).abs() <= 2e-6 * x);
        }
    }
}
