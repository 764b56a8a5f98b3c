//! How numbers are written, by who reads them.
//!
//! Sentences, tables, plots and the report have three significant digits ([`short`],
//! [`with_ends`]): further ones mean nothing, and one error with three digits here and four there
//! looks like two. Progress and budgets are [`duration`] and [`spelled`]; a proposed model file has
//! [`four_digits`]; a fitted one and the verdict's JSON are [`tidy`]; limits in errors and documents
//! are [`bound`]; exported programs need [`exact`] numbers.

use std::time::Duration;

/// A number of things: one run, two runs.
pub fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// A share in whole percent.
pub fn percent(share: f64) -> String {
    /// Shares below this round to 0 %.
    const HALF: f64 = 0.005;
    if !share.is_finite() {
        return "–".into();
    }
    if 0.0 < share && share < HALF {
        return "< 1 %".into();
    }
    // None is not below zero.
    let share = if share.abs() < HALF { 0.0 } else { share };
    format!("{:.0} %", 100.0 * share).replace('-', "−")
}

/// Evidence (ΔBIC, Δχ²): whole numbers with three significant digits.
pub fn evidence(value: f64) -> String {
    if value.abs() < 100.0 {
        let whole = if value.abs() < 0.5 { 0.0 } else { value };
        format!("{whole:.0}").replace('-', "−")
    } else {
        short(value)
    }
}

/// The normalised RMS fit of system identification, 1 − ‖y − ŷ‖/‖y − ȳ‖, from two RMS values. Whole
/// percent; tenths above 90 %, where models differ by less than 1 %.
pub fn fit(error: f64, spread: f64) -> String {
    let share = 1.0 - error / spread;
    if !share.is_finite() {
        return "–".into();
    }
    let decimals = usize::from(share > 0.9);
    format!("{:.decimals$} %", 100.0 * share).replace('-', "−")
}

/// Three significant digits.
pub fn short(value: f64) -> String {
    digits(value, 3)
}

/// A value and the ends of its interval: three digits, and more only where the ends
/// agree in those.
pub fn with_ends(value: f64, [low, high]: [f64; 2]) -> (String, [String; 2]) {
    /// Relative width that three digits can show.
    const SHOWN: f64 = 0.01;
    /// Beyond these digits an interval has no width.
    const MOST: i32 = 7;
    let largest = low.abs().max(high.abs());
    if !(largest.is_normal() && high - low < SHOWN * largest) {
        return (short(value), [short(low), short(high)]);
    }
    let magnitude = magnitude(largest);
    let at = |value: f64, count: i32| rounded(value, magnitude, count);
    let count = (3..MOST)
        .find(|&count| at(low, count) != at(high, count))
        .unwrap_or(3);
    (at(value, count), [at(low, count), at(high, count)])
}

/// This number of significant digits.
fn digits(value: f64, count: i32) -> String {
    if !value.is_finite() {
        return "–".into();
    }
    if value == 0.0 {
        return "0".into();
    }
    rounded(value, magnitude(value.abs()), count)
}

/// The decimal exponent once three digits are rounded: 0.009 999 9 is 0.0100.
fn magnitude(value: f64) -> i32 {
    let text = format!("{value:.2e}");
    let exponent = text.split_once('e').map(|(_, exponent)| exponent.parse());
    exponent.and_then(Result::ok).unwrap_or(0)
}

/// Rounds a number of this magnitude to `count` significant digits, with a power of ten for
/// very large or small numbers.
#[allow(clippy::cast_sign_loss)] // not below zero where it is cast
fn rounded(value: f64, magnitude: i32, count: i32) -> String {
    let decimals = count - 1 - magnitude;
    let text = if !(-4..6).contains(&magnitude) {
        let mantissa = value / 10f64.powi(magnitude);
        format!("{mantissa:.*}e{magnitude}", (count - 1).max(0) as usize)
    } else if decimals >= 0 {
        format!("{value:.*}", decimals as usize)
    } else {
        let unit = 10f64.powi(-decimals);
        format!("{:.0}", (value / unit).round() * unit)
    };
    text.replace('-', "−")
}

/// Four significant digits, without zeros at the end.
pub fn four_digits(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    let size = rounded.abs();
    if rounded != 0.0 && !(1e-4..1e6).contains(&size) {
        format!("{rounded:e}")
    } else {
        rounded.to_string()
    }
}

/// The number at seven significant digits: more than any fit supports, as many as the
/// board can hold.
pub fn tidy(value: f64) -> f64 {
    format!("{value:.6e}").parse().unwrap_or(value)
}

/// All digits, with a power of ten instead of rows of zeros.
pub fn bound(number: f64) -> String {
    let size = number.abs();
    if size >= 1e5 || (size > 0.0 && size < 1e-3) {
        format!("{number:e}")
    } else {
        number.to_string()
    }
}

/// As many digits as tell the number from all others.
pub fn exact(value: f64) -> String {
    format!("{value:?}")
}

/// Whole seconds, with minutes and hours where there are any: 42 s, 3 min 20 s.
pub fn duration(time: Duration) -> String {
    let seconds = time.as_secs();
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

/// A time as a user gives it: 1 ms, 0.5 s, 30 s, 2 min.
pub fn spelled(time: Duration) -> String {
    if time < Duration::from_millis(100) {
        format!("{} ms", time.as_secs_f64() * 1e3)
    } else if time < Duration::from_secs(60) {
        format!("{} s", time.as_secs_f64())
    } else {
        let text = duration(time);
        let text = text.trim_end_matches(" 0 s");
        text.trim_end_matches(" 0 min").to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_no_plural() {
        assert_eq!(counted(1, "run"), "1 run");
        assert_eq!(counted(0, "structure"), "0 structures");
    }

    #[test]
    fn three_digits_and_no_more() {
        for (value, text) in [
            (0.0, "0"),
            (0.486_71, "0.487"),
            (-27.93, "−27.9"),
            (0.009_999_99, "0.0100"),
            (999.7, "1000"),
            (27_934.0, "27900"),
            (209_872.0, "210000"),
            (2.174e-5, "2.17e−5"),
            (0.000_217_4, "0.000217"),
            (3.2e7, "3.20e7"),
            (f64::NAN, "–"),
        ] {
            assert_eq!(short(value), text);
        }
        assert_eq!(percent(f64::NAN), "–");
        assert_eq!(percent(-0.12), "−12 %");
        assert_eq!(percent(0.0), "0 %");
        assert_eq!(percent(0.002), "< 1 %");
        assert_eq!(percent(-0.002), "0 %");
        for (value, text) in [(0.0, "0"), (-0.3, "0"), (7.6, "8"), (1509.4, "1510")] {
            assert_eq!(evidence(value), text);
        }
    }

    #[test]
    fn a_fit_is_100_without_error_and_0_for_the_mean() {
        assert_eq!(fit(0.0, 2.0), "100.0 %");
        assert_eq!(fit(2.0, 2.0), "0 %");
        assert_eq!(fit(0.034, 2.0), "98.3 %");
        assert_eq!(fit(3.0, 2.0), "−50 %");
        assert_eq!(fit(0.0, 0.0), "–", "nothing moved");
    }

    #[test]
    fn the_ends_of_an_interval_can_be_told_apart() {
        let said = |value, ends| {
            let (value, [low, high]) = with_ends(value, ends);
            format!("{value} {low} {high}")
        };
        assert_eq!(said(0.2751, [0.2383, 0.3119]), "0.275 0.238 0.312");
        assert_eq!(said(1.2534, [1.2491, 1.2582]), "1.25 1.25 1.26");
        assert_eq!(said(1.0002, [0.9999, 1.0005]), "1.0002 0.9999 1.0005");
        assert_eq!(said(0.01, [0.0, 0.02]), "0.0100 0 0.0200");
    }

    #[test]
    fn proposed_numbers_have_four_digits() {
        for (value, text) in [
            (0.0, "0"),
            (0.123_456, "0.1235"),
            (209_872.4, "209900"),
            (2.17e-5, "2.17e-5"),
            (-63.4, "-63.4"),
        ] {
            assert_eq!(four_digits(value), text);
        }
    }

    #[test]
    fn a_budget_is_spelled_as_it_was_given() {
        for (time, text) in [
            (Duration::from_millis(1), "1 ms"),
            (Duration::from_millis(500), "0.5 s"),
            (Duration::from_secs(30), "30 s"),
            (Duration::from_secs(120), "2 min"),
            (Duration::from_secs(90), "1 min 30 s"),
            (Duration::from_secs(7200), "2 h"),
        ] {
            assert_eq!(spelled(time), text);
        }
    }
}
