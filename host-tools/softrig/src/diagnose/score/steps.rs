//! The gap in the words of a step response: which feature is off, and by how much.
//!
//! An engineer who reads "no known effect" still wants to know where to look. Every step of the
//! pressure in the fitted recordings is read twice, as it was measured and as the refitted model
//! simulates it: where it rests, where it returns to, how fast it rises, how far it overshoots, how
//! fast and how long it swings, how it goes on creeping. What is off the same way in most steps is a
//! sentence, with what it accuses. It illustrates the verdict and does not decide it.

use crate::diagnose::score::localise::edges;
use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::statistics::{mean, median, swing};
use softrig_formats::measurand::Measurand;
use softrig_formats::numbers::short;

/// A feature of a response to a step of the pressure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepFeature {
    /// Angle at which the actuator rests under pressure (°).
    Rest,
    /// Angle to which it returns when the pressure goes (°).
    Return,
    /// Time to nine tenths of a step (s).
    Rise,
    /// Overshoot beyond the rest (% of the step).
    Overshoot,
    /// Period of the swing (s).
    Period,
    /// How much smaller a swing is than the one before (%).
    Decay,
    /// Rate in the second half of the step (°/s).
    Drift,
}

impl StepFeature {
    /// All, in the order of a report.
    pub const ALL: [Self; 7] = [
        Self::Rest,
        Self::Return,
        Self::Rise,
        Self::Overshoot,
        Self::Period,
        Self::Decay,
        Self::Drift,
    ];

    /// Its name in the verdict.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rest => "rest_deg",
            Self::Return => "return_deg",
            Self::Rise => "rise_s",
            Self::Overshoot => "overshoot_percent",
            Self::Period => "period_s",
            Self::Decay => "decay_percent",
            Self::Drift => "drift_deg_per_s",
        }
    }

    fn unit(self, measurand: &Measurand) -> String {
        match self {
            Self::Rest | Self::Return => measurand.unit().to_owned(),
            Self::Rise | Self::Period => " s".to_owned(),
            Self::Overshoot | Self::Decay => " %".to_owned(),
            Self::Drift => format!("{}/s", measurand.unit()),
        }
    }

    /// In a sentence.
    const fn title(self) -> &'static str {
        match self {
            Self::Rest => "the rest under pressure",
            Self::Return => "the return to rest",
            Self::Rise => "the rise to nine tenths",
            Self::Overshoot => "the overshoot",
            Self::Period => "the period",
            Self::Decay => "the decay from swing to swing",
            Self::Drift => "the drift at rest",
        }
    }

    /// What it accuses.
    const fn accuses(self) -> &'static str {
        match self {
            Self::Rest => "the static curve (stiffness, exponent, weight)",
            Self::Return => "what keeps it from coming back (creep, dry friction)",
            Self::Rise => "damping and the way of the air",
            Self::Overshoot | Self::Decay => "damping and friction",
            Self::Period => "inertia and stiffness",
            Self::Drift => "creep and drift",
        }
    }
}

/// A feature that is off.
#[derive(Clone, Debug, PartialEq)]
pub struct StepGap {
    /// Which.
    pub feature: StepFeature,
    /// Median of what was measured, in its unit.
    pub measured: f64,
    /// Median of what the refit simulates in the same steps.
    pub simulated: f64,
    /// Steps in which it could be read.
    pub steps: usize,
    /// Those in which it is off in this direction.
    pub alike: usize,
}

impl StepGap {
    /// A clause: what is simulated for what was measured, in how many steps, and what it accuses.
    pub fn clause(&self, measurand: &Measurand) -> String {
        let unit = self.feature.unit(measurand);
        format!(
            "{} is {}{unit} where {}{unit} were measured (in {} of {} steps), which points to {}",
            self.feature.title(),
            short(self.simulated),
            short(self.measured),
            self.alike,
            self.steps,
            self.feature.accuses()
        )
    }
}

/// The features in which most steps differ in one direction, by more than the noise (rad) hides.
pub fn step_gaps(data: &Dataset, refit: &Fit, noise: f64) -> Vec<StepGap> {
    let mut steps: Vec<[Step; 2]> = Vec::new();
    let least = data.largest_angle() * LEAST_STEP;
    for (segment, residual) in data.fitted().zip(refit.residuals.iter()) {
        let recording = &segment.recording;
        let measured = &recording.angle;
        let simulated: Vec<f64> = measured.iter().zip(residual).map(|(y, e)| y + e).collect();
        let edges = edges(recording);
        let ends = edges.iter().skip(1).copied().chain([measured.len()]);
        // The first is the start of the recording.
        for (from, to) in edges.iter().copied().zip(ends).skip(1) {
            let time = &recording.time[from..to.min(recording.time.len())];
            let of = |series: &[f64]| Step::of(time, series, from, noise, least);
            steps.extend(of(measured).zip(of(&simulated)).map(|(a, b)| [a, b]));
        }
    }
    StepFeature::ALL
        .into_iter()
        .filter_map(|feature| gap(feature, &steps, noise))
        .collect()
}

/// Least step, as a share of the largest angle.
const LEAST_STEP: f64 = 0.1;

/// Most that the last fifth of a step moves, as a share of it: beyond it a step has not come to
/// rest.
const MOVES: f64 = 0.2;

/// Least samples of a step.
const LEAST_SAMPLES: usize = 40;

/// Least share of steps that differ in one direction.
const ALIKE: f64 = 0.75;

/// A step as it was measured, or as it is simulated; none for what cannot be read.
struct Step {
    values: [Option<f64>; StepFeature::ALL.len()],
}

impl Step {
    /// Of a series from the edge on.
    fn of(time: &[f64], series: &[f64], from: usize, noise: f64, least: f64) -> Option<Self> {
        let all = series.get(from..from + time.len())?;
        let count = all.len();
        if count < LEAST_SAMPLES {
            return None;
        }
        let before = mean(&series[from.saturating_sub(5)..=from]);
        let rest = mean(&all[count - count / 5..]);
        let step = rest - before;
        let end = &all[count - count / 5..];
        if step.abs() < least.max(5.0 * noise) || swing(end) > MOVES * step.abs() + 6.0 * noise {
            return None;
        }
        let is_return = rest.abs() < before.abs();
        // Shares of the step, smoothed over five samples.
        let shares: Vec<f64> = all
            .windows(5)
            .map(|window| (mean(window) - before) / step)
            .collect();
        let at = |place: usize| time[place + 2] - time[0];
        let rise = shares.iter().position(|share| *share >= 0.9).map(at);
        let most = shares.iter().copied().fold(0.0, f64::max);
        let swings = Swings::of(&shares, &at, (3.0 * noise / step.abs()).max(0.02));
        let half = &all[count / 2..];
        let mut values = [None; StepFeature::ALL.len()];
        let mut put = |feature: StepFeature, value: Option<f64>| {
            values[feature as usize] = value.filter(|value| value.is_finite());
        };
        let place = if is_return {
            StepFeature::Return
        } else {
            StepFeature::Rest
        };
        put(place, Some(rest.to_degrees()));
        put(StepFeature::Rise, rise);
        put(StepFeature::Overshoot, Some(100.0 * (most - 1.0).max(0.0)));
        put(StepFeature::Period, swings.as_ref().map(|it| it.period));
        put(StepFeature::Decay, swings.map(|it| 100.0 * it.decay));
        put(
            StepFeature::Drift,
            Some(slope(&time[count / 2..], half).to_degrees()),
        );
        Some(Self { values })
    }
}

/// Swings about the rest of a step.
struct Swings {
    period: f64,
    /// Share of an amplitude that the next one lacks.
    decay: f64,
}

impl Swings {
    /// From the first extremes beyond the noise, which is a share of the step.
    fn of(shares: &[f64], at: &dyn Fn(usize) -> f64, noise: f64) -> Option<Self> {
        let mut extremes: Vec<(usize, f64)> = Vec::new();
        let first = shares.iter().position(|share| *share >= 1.0)?;
        for (place, share) in shares.iter().enumerate().skip(first) {
            let off = share - 1.0;
            match extremes.last_mut() {
                Some(last) if last.1.signum() * off.signum() > 0.0 => {
                    let is_farther = off.abs() > last.1.abs();
                    *last = if is_farther { (place, off) } else { *last };
                }
                _ if off.abs() > noise => extremes.push((place, off)),
                _ => {}
            }
        }
        let [a, b, c] = *extremes.get(..3)? else {
            return None;
        };
        Some(Self {
            period: at(c.0) - at(a.0),
            decay: 1.0 - (b.1 / a.1).abs(),
        })
    }
}

/// The slope of a line through a series.
fn slope(time: &[f64], series: &[f64]) -> f64 {
    let (t, y) = (mean(time), mean(series));
    let across: f64 = time.iter().map(|time| (time - t).powi(2)).sum();
    let along: f64 = time
        .iter()
        .zip(series)
        .map(|(time, value)| (time - t) * (value - y))
        .sum();
    along / across.max(f64::MIN_POSITIVE)
}

/// A feature, if most steps differ in one direction, by more than can be read from them.
fn gap(feature: StepFeature, steps: &[[Step; 2]], noise: f64) -> Option<StepGap> {
    let read: Vec<[f64; 2]> = steps
        .iter()
        .filter_map(|[measured, simulated]| {
            let of = |step: &Step| step.values[feature as usize];
            Some([of(measured)?, of(simulated)?])
        })
        .collect();
    let middle = |which: usize| median(&mut read.iter().map(|it| it[which]).collect::<Vec<f64>>());
    if read.len() < 2 {
        return None;
    }
    let (measured, simulated) = (middle(0), middle(1));
    // A rest is a mean of many samples; times and swings are read from single ones.
    let visible = match feature {
        StepFeature::Rest | StepFeature::Return => 0.5 * noise.to_degrees(),
        StepFeature::Drift => 0.2 * noise.to_degrees(),
        StepFeature::Rise | StepFeature::Period => 0.1 * measured,
        StepFeature::Overshoot => 3.0,
        StepFeature::Decay => 10.0,
    };
    let mut differences: Vec<f64> = read.iter().map(|[a, b]| b - a).collect();
    let alike = differences
        .iter()
        .filter(|it| it.abs() > visible && (**it > 0.0) == (simulated > measured))
        .count();
    let typical = median(&mut differences);
    let is_off = typical.abs() > visible && alike as f64 >= ALIKE * read.len() as f64;
    is_off.then_some(StepGap {
        feature,
        measured,
        simulated,
        steps: read.len(),
        alike,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: f64 = 0.01;

    /// A damped swing about its rest after a step at the first sample.
    fn damped(frequency: f64, decay: f64, rest: f64) -> (Vec<f64>, Vec<f64>) {
        let time: Vec<f64> = (0..1600).map(|k| INTERVAL * f64::from(k)).collect();
        let angle = time
            .iter()
            .map(|t| rest * (1.0 - (-decay * t).exp() * (frequency * t).cos()))
            .collect();
        (time, angle)
    }

    fn read(frequency: f64, decay: f64, rest: f64) -> Step {
        let (time, angle) = damped(frequency, decay, rest);
        Step::of(&time, &angle, 0, 1e-4, 0.01).unwrap()
    }

    #[test]
    fn a_swing_is_read_as_a_textbook_does() {
        let (frequency, decay) = (10.0, 1.0);
        let step = read(frequency, decay, 0.5);
        let of = |feature: StepFeature| step.values[feature as usize].unwrap();
        let period = std::f64::consts::TAU / frequency;
        assert!((of(StepFeature::Rest) - 0.5_f64.to_degrees()).abs() < 0.05);
        assert!((of(StepFeature::Period) - period).abs() < 2.0 * INTERVAL);
        // Half a period later an amplitude is e^(−decay·T/2) of the one before.
        let lost = 100.0 * (1.0 - (-decay * 0.5 * period).exp());
        assert!(
            (of(StepFeature::Decay) - lost).abs() < 3.0,
            "{}",
            of(StepFeature::Decay)
        );
        let overshoot = 100.0 * (-decay * 0.5 * period).exp();
        assert!((of(StepFeature::Overshoot) - overshoot).abs() < 2.0);
        assert!(of(StepFeature::Drift).abs() < 0.01);
        assert!(step.values[StepFeature::Return as usize].is_none());
    }

    #[test]
    fn what_does_not_come_to_rest_is_not_read() {
        let (time, angle) = damped(10.0, 0.05, 0.5);
        assert!(Step::of(&time, &angle, 0, 1e-4, 0.01).is_none());
    }

    #[test]
    fn what_is_off_in_most_steps_is_said_and_nothing_else() {
        let pairs: Vec<[Step; 2]> = (0..4)
            .map(|_| [read(10.0, 1.0, 0.5), read(8.0, 1.0, 0.5)])
            .collect();
        let off: Vec<StepFeature> = StepFeature::ALL
            .into_iter()
            .filter(|&feature| gap(feature, &pairs, 1e-3).is_some())
            .collect();
        assert!(off.contains(&StepFeature::Period), "{off:?}");
        assert!(
            !off.contains(&StepFeature::Rest) && !off.contains(&StepFeature::Drift),
            "{off:?}"
        );
        let period = gap(StepFeature::Period, &pairs, 1e-3).unwrap();
        assert_eq!((period.steps, period.alike), (4, 4));
        assert!(period.simulated > period.measured);
        let same: Vec<[Step; 2]> = (0..4)
            .map(|_| [read(10.0, 1.0, 0.5), read(10.0, 1.0, 0.5)])
            .collect();
        assert!(
            StepFeature::ALL
                .into_iter()
                .all(|it| gap(it, &same, 1e-3).is_none())
        );
    }
}
