//! Limits, ticks and the numbers beside them.
//!
//! Readers interpolate between ticks, so these sit on round numbers, and a
//! power of ten is taken out where the digits would be many. Values that no
//! axis can hold are told apart here as well.

use super::text::{TICK_PX, Weight, text_width};

/// A value that can be drawn: finite, and far enough from the ends of `f64`
/// that differences and paddings stay finite too.
pub(super) fn drawable(value: f64) -> bool {
    value.abs() < 1e150
}

/// One axis: limits, tick positions, and how their numbers are written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    pub(super) low: f64,
    pub(super) high: f64,
    pub(super) ticks: Vec<f64>,
    pub(super) labels: Vec<String>,
    /// Power of ten taken out of the labels.
    pub(super) power: i32,
}

impl Axis {
    /// Lays an axis over the given values, with about one tick per
    /// `spacing_px`.
    pub(super) fn over(
        values: impl Iterator<Item = f64>,
        fixed: Option<(f64, f64)>,
        padding: f64,
        length_px: f64,
        spacing_px: f64,
    ) -> Self {
        let usable = fixed.filter(|&(low, high)| drawable(low) && drawable(high) && low < high);
        let (low, high) = usable.unwrap_or_else(|| {
            let (low, high) = values
                .filter(|v| drawable(*v))
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                    (low.min(v), high.max(v))
                });
            if low > high {
                return (0.0, 1.0);
            }
            let span = high - low;
            // A constant series still needs an axis, and one that does not
            // magnify rounding.
            let smallest = 1e-9 * low.abs().max(high.abs());
            if span <= smallest {
                let half = if high == 0.0 { 0.5 } else { 0.05 * high.abs() };
                (low - half, high + half)
            } else {
                (low - padding * span, high + padding * span)
            }
        });
        let count = (length_px / spacing_px).clamp(2.0, 12.0);
        let step = nice_step((high - low) / count);
        let first = (low / step - 1e-9).ceil();
        let ticks: Vec<f64> = (0..40)
            .map(|i| (first + f64::from(i)) * step)
            .take_while(|tick| *tick <= high + 1e-9 * step)
            // −0 and remainders such as 1e-17 would be labelled oddly.
            .map(|tick| if tick.abs() < 1e-6 * step { 0.0 } else { tick })
            .collect();
        let largest = low.abs().max(high.abs());
        let power = if (1e-2..1e5).contains(&largest) {
            0
        } else {
            order_of(largest).div_euclid(3) * 3
        };
        let unit = 10f64.powi(power);
        let decimals = decimals_of(step / unit);
        let labels = ticks
            .iter()
            .map(|tick| {
                let number = format!("{:.*}", decimals, (tick / unit).abs());
                if *tick < 0.0 {
                    format!("\u{2212}{number}")
                } else {
                    number
                }
            })
            .collect();
        Self {
            low,
            high,
            ticks,
            labels,
            power,
        }
    }

    /// The same over decimal logarithms, labelled with the numbers themselves: a power of ten
    /// each, between few of them also twice and five times that.
    pub(super) fn of_decades(self) -> Self {
        let [first, last] = [self.low.floor(), self.high.ceil()];
        let parts: &[f64] = if self.high - self.low < 3.0 {
            &[1.0, 2.0, 5.0]
        } else {
            &[1.0]
        };
        let decades = (0..=400).map(|k| first + f64::from(k));
        let numbers: Vec<f64> = decades
            .take_while(|decade| *decade <= last)
            .flat_map(|decade| parts.iter().map(move |part| part * 10f64.powf(decade)))
            .filter(|number| (self.low - 1e-9..=self.high + 1e-9).contains(&number.log10()))
            .collect();
        // So many that they do not run into each other.
        let every = numbers.len().div_ceil(10).max(1);
        let numbers: Vec<f64> = numbers.into_iter().step_by(every).collect();
        if numbers.len() < 2 {
            return self;
        }
        Self {
            ticks: numbers.iter().map(|number| number.log10()).collect(),
            labels: numbers.iter().map(|&number| decimal(number)).collect(),
            power: 0,
            ..self
        }
    }

    /// Position of a value along the axis: 0 at the lower limit, 1 at the upper.
    pub(super) fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    pub(super) fn label_width(&self) -> f64 {
        self.labels
            .iter()
            .map(|label| text_width(label, TICK_PX, Weight::Regular))
            .fold(0.0, f64::max)
    }

    /// The axis label with the power of ten that was taken out of the numbers.
    pub(super) fn power_note(&self) -> Option<String> {
        (self.power != 0).then(|| {
            let digits: String = self
                .power
                .to_string()
                .chars()
                .map(|c| match c {
                    '0' => '⁰',
                    '1' => '¹',
                    '2' => '²',
                    '3' => '³',
                    '4' => '⁴',
                    '5' => '⁵',
                    '6' => '⁶',
                    '7' => '⁷',
                    '8' => '⁸',
                    '9' => '⁹',
                    _ => '⁻',
                })
                .collect();
            format!("×10{digits}")
        })
    }
}

/// A number with one digit that counts, as a person writes it.
fn decimal(number: f64) -> String {
    let order = order_of(number * (1.0 + 1e-9));
    let decimals = usize::try_from(-order).unwrap_or(0);
    if (-4..6).contains(&order) {
        format!("{number:.decimals$}")
    } else {
        format!("{number:.0e}")
    }
}

#[allow(clippy::cast_possible_truncation)] // a decimal exponent of f64 is below 400
fn order_of(value: f64) -> i32 {
    if value > 0.0 {
        value.log10().floor() as i32
    } else {
        0
    }
}

/// The smallest of 1, 2, 2.5, 5 times a power of ten that is not far below
/// `rough`; far enough that a short axis still gets more than two numbers.
fn nice_step(rough: f64) -> f64 {
    let magnitude = 10f64.powi(order_of(rough));
    [1.0, 2.0, 2.5, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * magnitude)
        .find(|step| *step >= 0.7 * rough)
        .unwrap_or(magnitude)
}

fn decimals_of(step: f64) -> usize {
    (0..9)
        .find(|decimals| {
            let scaled = step * 10f64.powi(*decimals);
            (scaled - scaled.round()).abs() < 1e-6 * scaled
        })
        .and_then(|decimals| usize::try_from(decimals).ok())
        .unwrap_or(9)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decades_are_labelled_with_their_numbers() {
        let axis = |low: f64, high: f64| {
            Axis::over([low, high].into_iter(), None, 0.0, 700.0, 80.0)
                .of_decades()
                .labels
        };
        assert_eq!(axis(-3.2, 1.1), ["0.001", "0.01", "0.1", "1", "10"]);
        assert_eq!(axis(-1.1, 0.4), ["0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(axis(4.9, 8.0), ["100000", "1e6", "1e7", "1e8"]);
        // Not even two of them: as numbers are otherwise.
        assert!(axis(0.01, 0.02).len() > 1);
    }

    #[test]
    fn ticks_are_round_numbers_inside_the_limits() {
        let axis =
            |low: f64, high: f64| Axis::over([low, high].into_iter(), None, 0.0, 400.0, 80.0);
        assert_eq!(
            axis(0.0, 10.0).labels,
            ["0", "2", "4", "6", "8", "10"].map(str::to_owned)
        );
        assert_eq!(
            axis(-0.3, 0.31).labels,
            [
                "\u{2212}0.3",
                "\u{2212}0.2",
                "\u{2212}0.1",
                "0.0",
                "0.1",
                "0.2",
                "0.3"
            ]
            .map(str::to_owned)
        );
        let tiny = axis(0.0, 4.2e-6);
        assert_eq!(tiny.power_note().as_deref(), Some("×10⁻⁶"));
        assert_eq!(tiny.labels, ["0", "1", "2", "3", "4"].map(str::to_owned));
        let large = axis(0.0, 2.0e6);
        assert_eq!(large.power_note().as_deref(), Some("×10⁶"));
        for (low, high) in [(0.0, 1.0), (-7.3, 91.2), (1e-9, 3e-9), (99.0, 99.5)] {
            let axis = axis(low, high);
            assert!(axis.ticks.len() >= 2, "{low} {high}");
            assert!(
                axis.ticks
                    .iter()
                    .all(|tick| *tick >= low - 1e-12 && *tick <= high + 1e-12)
            );
        }
    }
}
