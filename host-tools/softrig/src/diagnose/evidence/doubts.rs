//! What keeps a fitted structure from being named, however well it predicts.
//!
//! A formula whose parameter ran into the end of its range, or whose size may as well be zero, has
//! been bent to follow something else. A line at a multiple of the drive's own frequency is the
//! curve of the characteristic, and two or three swings of a sine are a curve in time. Such a
//! structure stays in an answer set: what it approximates is real.

use model_core::actuator::ParameterId;
use model_core::catalogue::Kind;
use model_core::effects::{Doubtful, Unit};

use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::fit::numbers::FARTHEST;
use crate::diagnose::recordings::needs::is_loaded_again;
use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::statistics::moves;
use softrig_formats::recording::Recording;

/// Fewest periods in the longest session that show a disturbance of its own frequency.
const PERIODS: f64 = 5.0;

/// Correlation of a pressure with itself, one period on, from which a drive repeats.
const REPEATS: f64 = 0.95;

/// Highest multiple of the drive's frequency that is compared.
const HARMONICS: usize = 5;

/// Why a structure is not named.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Doubt {
    /// A parameter of an effect ended at a bound of its range.
    AtBound,
    /// The interval of an effect's size holds zero.
    Undetermined,
    /// The recordings hold few periods of it.
    FewPeriods,
    /// Softening by the largest stretch so far, and no session loads a second time: then it is
    /// a difference between loading and unloading, which friction, creep and lag make as well.
    LoadedOnce,
    /// Its line is a multiple of the drive's own frequency, and few periods were recorded without
    /// that drive.
    Drive,
    /// An offset of the sensor beside an actuator that creeps: the rest that it was taken from
    /// still moved.
    CreepingRest,
    /// It takes back what the spring has grown by ([`Doubtful::TakesBack`]).
    TakesBack,
}

impl Doubt {
    /// Whether it follows the shape of the recorded runs, and is not a rival of an effect that can
    /// be named.
    pub const fn is_of_the_runs(self) -> bool {
        matches!(self, Self::FewPeriods | Self::Drive)
    }

    /// The first that applies to a structure that extends `refit`.
    pub fn of(candidate: &Candidate, refit: &Candidate, data: &Dataset) -> Option<Self> {
        let effects = Effects { candidate };
        if effects.any_at_bound() {
            Some(Self::AtBound)
        } else if !effects.are_determined() {
            Some(Self::Undetermined)
        } else if effects.any_doubtful(Doubtful::LoadedOnce) && !is_loaded_again(data) {
            Some(Self::LoadedOnce)
        } else if effects.stand_beside_a_cause() {
            Some(Self::CreepingRest)
        } else if effects.any_doubtful(Doubtful::TakesBack)
            && spring(&candidate.fit, data) > FARTHEST * spring(&refit.fit, data)
        {
            Some(Self::TakesBack)
        } else {
            effects
                .frequencies()
                .find_map(|(kind, frequency)| of_line(kind, frequency, data))
        }
    }
}

/// The restoring force at the largest angle, by the gain of the input: where the inertia does not
/// show, all forces can grow together.
fn spring(fit: &Fit, data: &Dataset) -> f64 {
    let value = |id| fit.model.value(id).unwrap_or(1.0);
    let bent = libm::pow(data.largest_angle(), value(ParameterId::Exponent));
    value(ParameterId::Stiffness) * bent / value(ParameterId::InputGain)
}

/// The added effects of a structure.
struct Effects<'a> {
    candidate: &'a Candidate,
}

impl Effects<'_> {
    /// The free parameters of the added effects: place among the free ones, effect, row.
    fn parameters(&self) -> impl Iterator<Item = (usize, usize, &'static str, Unit)> {
        let Candidate { added, fit, .. } = self.candidate;
        let first = fit.model.effects().count() - added.len();
        fit.free.iter().enumerate().filter_map(move |(place, &id)| {
            let ParameterId::Effect { slot, parameter } = id else {
                return None;
            };
            let effect = slot.checked_sub(first)?;
            let row = added.get(effect)?.parameters().get(parameter)?;
            Some((place, effect, row.key, row.unit))
        })
    }

    fn any_doubtful(&self, when: Doubtful) -> bool {
        let mut added = self.candidate.added.iter();
        added.any(|kind| kind.info().doubtful.contains(&when))
    }

    /// Whether one of the effects must not be named beside another.
    fn stand_beside_a_cause(&self) -> bool {
        let mut added = self.candidate.added.iter();
        added.any(|&kind| self.any_doubtful(Doubtful::Beside(kind)))
    }

    fn any_at_bound(&self) -> bool {
        self.parameters()
            .any(|(place, ..)| self.candidate.fit.at_bound(place))
    }

    /// Whether the size at a place among the free parameters is not zero: its interval, or that
    /// of its ratio to the stiffness or the input gain, excludes zero.
    fn excludes_zero(&self, place: usize, unit: Unit) -> bool {
        let fit = &self.candidate.fit;
        let alone = fit.interval95(place);
        if alone.is_some_and(|(low, high)| low > 0.0 || high < 0.0) {
            return true;
        }
        let is_force = |id| matches!(id, ParameterId::Stiffness | ParameterId::InputGain);
        unit.is_force()
            && fit.free.iter().enumerate().any(|(other, &id)| {
                is_force(id)
                    && !fit.at_bound(other)
                    && fit.ratio_within95(place, other).is_some_and(|it| it < 1.0)
            })
    }

    /// Whether every effect with free parameters has a size that is not zero.
    fn are_determined(&self) -> bool {
        (0..self.candidate.added.len()).all(|effect| {
            let own = || self.parameters().filter(move |it| it.1 == effect);
            let sizes = || own().filter(|(_, _, key, unit)| is_size(key, *unit));
            let excludes_zero =
                |(place, .., unit): (usize, usize, &str, Unit)| self.excludes_zero(place, unit);
            if sizes().next().is_some() {
                sizes().any(excludes_zero)
            } else {
                own().next().is_none() || own().any(excludes_zero)
            }
        })
    }

    /// The frequencies (Hz) of effects that swing.
    fn frequencies(&self) -> impl Iterator<Item = (Kind, f64)> {
        let Candidate { added, fit, .. } = self.candidate;
        self.parameters()
            .filter(|(_, _, _, unit)| *unit == Unit::Hertz)
            .filter_map(move |(place, effect, ..)| {
                let value = fit.model.value(*fit.free.get(place)?)?;
                Some((*added.get(effect)?, value))
            })
    }
}

/// Whether an effect is absent where this parameter is zero.
fn is_size(key: &str, unit: Unit) -> bool {
    let is_shape = matches!(key, "damping_ratio" | "shape");
    let is_place = matches!(
        unit,
        Unit::Hertz | Unit::Second | Unit::Radian | Unit::RadianPerSecond
    );
    !is_place && !is_shape
}

/// The doubt about a line of this frequency (Hz). Its drive makes one at its own multiples, but not
/// in the sessions that it does not drive.
fn of_line(kind: Kind, frequency: f64, data: &Dataset) -> Option<Doubt> {
    let drives = |recording: &Recording| {
        let samples = 1.0 / (frequency * recording.interval());
        moves(&recording.time, &recording.pressure)
            && (1..=HARMONICS)
                .any(|multiple| repeats(&recording.pressure, multiple as f64 * samples))
    };
    let recordings = data.sessions().iter().map(|it| it.recording());
    let (driven, undriven): (Vec<&Recording>, Vec<&Recording>) =
        recordings.partition(|it| drives(it));
    let periods = |of: &[&Recording]| {
        let longest = of.iter().map(|it| it.duration()).fold(0.0, f64::max);
        frequency * longest
    };
    let is_a_curve = kind.info().doubtful.contains(&Doubtful::FewPeriods);
    if is_a_curve && periods(&driven).max(periods(&undriven)) < PERIODS {
        return Some(Doubt::FewPeriods);
    }
    (!driven.is_empty() && periods(&undriven) < PERIODS).then_some(Doubt::Drive)
}

/// Whether a series repeats after this many samples, and not after a part of them.
fn repeats(series: &[f64], period: f64) -> bool {
    /// A period divided by one of these is shorter; other parts are parts of those.
    const PARTS: [f64; 3] = [2.0, 3.0, 5.0];
    // A few thousand samples.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let lag = |samples: f64| samples.round().max(1.0) as usize;
    let repeats = |samples: f64| {
        2 * lag(samples) <= series.len() && correlation(series, lag(samples)) >= REPEATS
    };
    repeats(period) && !PARTS.iter().any(|part| repeats(period / part))
}

/// Correlation of a series with itself, `lag` samples on.
fn correlation(series: &[f64], lag: usize) -> f64 {
    let (early, late) = (&series[..series.len() - lag], &series[lag..]);
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (a, b) = (mean(early), mean(late));
    let (mut both, mut first, mut second) = (0.0, 0.0, 0.0);
    for (x, y) in early.iter().zip(late) {
        both += (x - a) * (y - b);
        first += (x - a) * (x - a);
        second += (y - b) * (y - b);
    }
    if first > 0.0 && second > 0.0 {
        both / (first * second).sqrt()
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::estimate::fitter::Fitter;
    use softrig_formats::model_file::ModelFile;

    fn driven(pressure: impl Fn(f64) -> f64) -> Dataset {
        let time: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k)).collect();
        let pressure: Vec<f64> = time.iter().map(|&t| pressure(t)).collect();
        let angle = pressure.iter().map(|p| 1e-5 * p).collect();
        Dataset::of(&[Recording {
            path: "a.csv".into(),
            time,
            pressure,
            angle,
            ..Recording::default()
        }])
    }

    /// A sine of 0.4 Hz makes lines at its multiples; a stair has none of its own.
    #[test]
    fn a_line_at_a_multiple_of_the_drive_is_the_drives() {
        let sine = driven(|t| 2e4 * (1.0 + (std::f64::consts::TAU * 0.4 * t).sin()));
        let of = |frequency| of_line(Kind::SecondMode, frequency, &sine);
        assert_eq!([0.4, 0.8, 1.2].map(of), [Some(Doubt::Drive); 3]);
        assert_eq!([0.53, 0.9, 1.37].map(of), [None; 3]);
        let stair = driven(|t| 1e4 * (t / 4.0).floor());
        assert_eq!(of_line(Kind::SecondMode, 1.2, &stair), None);
        // In the stair's twenty seconds nothing drives it.
        let both = [&sine, &stair].map(|it| it.sessions()[0].recording().clone());
        let both = Dataset::of(&both);
        assert_eq!(of_line(Kind::SecondMode, 0.8, &both), None);
    }

    /// A spring that has grown eightfold and a sine that takes it back are a cubic; a sine in a
    /// spring's place is a pendulum.
    #[test]
    fn gravity_beside_a_spring_that_has_grown_fivefold_is_doubted() {
        let data = driven(|t| 2e4 * (1.0 + (std::f64::consts::TAU * 0.4 * t).sin()));
        let candidate = |stiffness: f64, effect: &str| {
            let text = format!(
                "schema = 1\n[dynamics]\ninertia_kg_m = 0.3\ndamping_n_s_per_rad = 1.5\n\
                 stiffness_n_per_rad_n = {stiffness}\nexponent = 1.0\n\
                 input_gain_n_per_kpa = 0.12\n{effect}"
            );
            let model = ModelFile::parse(&text, Path::new("m.toml")).unwrap().model;
            let fit = Fitter::new(&model, &data).compare(&model);
            Candidate::of(usize::from(!effect.is_empty()), fit)
        };
        let refit = candidate(5.0, "");
        for (stiffness, force, doubt) in [
            (40.0, -35.0, Some(Doubt::TakesBack)),
            (20.0, -15.0, None),
            (0.5, 4.5, None),
        ] {
            let effect =
                format!("[[effect]]\nkind = \"gravity\"\nforce_n = {force}\ntilt_rad = 0.0\n");
            let found = Doubt::of(&candidate(stiffness, &effect), &refit, &data);
            assert_eq!(found, doubt, "{stiffness} {force}");
        }
        // What softens with the pressure begins with a stiffer spring.
        let softens = "[[effect]]\nkind = \"pressure_stiffening\"\nper_kpa = -0.018\n";
        assert_eq!(Doubt::of(&candidate(40.0, softens), &refit, &data), None);
    }

    /// Twenty seconds hold two periods of a tenth of a hertz, and eight of four tenths.
    #[test]
    fn a_few_swings_are_a_curve() {
        let stair = driven(|t| 1e4 * (t / 4.0).floor());
        let of = |frequency| of_line(Kind::PeriodicDisturbance, frequency, &stair);
        assert_eq!(of(0.1), Some(Doubt::FewPeriods));
        assert_eq!(of(0.4), None);
        assert_eq!(of_line(Kind::SecondMode, 0.15, &stair), None);
    }
}
