//! Finds the usable samples of a recording, without a model.
//!
//! A sensor at its end, a reset or a gap in time says nothing about the actuator, and a model fitted
//! to it would be wrong. Unusable samples are left out and reported; the rest of the recording is
//! used.

use std::cell::LazyCell;
use std::ops::Range;

use super::let_go::{HandRelease, handled};
use crate::statistics::{
    clipped, median, noise, quantisation_step, rms, same, standard_deviation, swing,
};
use softrig_formats::error::InputError;
use softrig_formats::left_out::LeftOut;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};
use softrig_formats::removed::{Channel, Why};

/// Fewest samples that show a motion. A block with fewer is dropped, and a
/// recording with fewer usable samples is refused.
pub const FEWEST_SAMPLES: usize = 20;

/// Shortest block (s). A shorter one is less than a swing, and its estimated initial
/// state alone would explain it under any model.
const SHORTEST_BLOCK_S: f64 = 0.5;

/// Saturation of the pressure of this length (s) or longer cuts the recording: an
/// actuator settles in about that time at the unknown pressure.
const LONG_SATURATION_S: f64 = 0.5;

/// A measured pressure needs at least this time (s) to rise through half its range:
/// lines and chambers fill in tenths of a second. A recorded command is faster.
const FASTEST_RISE_S: f64 = 0.05;

/// Share of samples with a saturated pressure from which the recording is cut at each
/// saturation, however short: so frequent an error of the drive affects the rest.
const SATURATED_SHARE: f64 = 0.05;

/// Time (s) after a saturation of the pressure during which the angle is not fitted: the
/// effect of the wrong drive has died away by then.
const RECOVERY_S: f64 = 1.0;

/// Longest gap in time (s) across which the pressure is interpolated: such
/// actuators and their valves do little in less.
const BRIDGED_S: f64 = 0.25;

/// The same in nominal intervals, for slow sampling: two samples lost in a row.
const BRIDGED_INTERVALS: f64 = 3.0;

/// A longer gap is bridged as well if a straight line across it misses the pressure by no more than
/// this share of its range beyond its noise, in the mean: half of what a model may be off without
/// it mattering.
const FOLLOWED: f64 = 0.005;

/// … in this share of the windows of the recording that are as long and change as much.
const FOLLOWED_IN: f64 = 0.95;

/// Windows change as much if their ends differ by as much, within this share of the range.
const ALIKE: f64 = 0.05;

/// Fewest such windows that say what the pressure does in so long a time.
const FEWEST_WINDOWS: usize = 20;

/// Most windows that are looked at for a gap.
const MOST_WINDOWS: usize = 1_000;

/// An interval longer than so many nominal ones counts as missing samples, if the clock
/// is even.
const MISSING: f64 = 1.5;

/// The same for a clock that jitters, in standard deviations of its interval.
const MISSING_DEVIATIONS: f64 = 4.0;

/// Relative standard deviation of the intervals from which jitter is reported.
const JITTER: f64 = 0.1;

/// Most wrong samples after a reset: the filters of the board start from their first
/// reading.
const RESET_SAMPLES: usize = 3;

/// Number of following samples that show where the actuator really rests.
const RESET_COMPARED: usize = 20;

/// A sample counts as wrong from so many standard deviations of those.
const RESET_SCATTERS: f64 = 8.0;

/// Longest duration (s) of the samples after a reset. In a longer time an actuator can
/// really move and come to rest.
const RESET_LASTS_S: f64 = 0.1;

/// Least standard deviation (Pa) that counts: a quantised pressure can be constant.
const LEAST_PRESSURE_SCATTER: f64 = 50.0;

/// Least standard deviation (rad) that counts, a twentieth of a degree.
const LEAST_ANGLE_SCATTER: f64 = 8.7e-4;

/// The subject of a concern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Matter {
    /// No run was repeated.
    NoRepeats,
    /// The runs are too short to see slow effects.
    ShortRuns,
    /// A fitted time constant is longer than the runs can show.
    TimeConstant,
    /// The pressure of a recording never changes.
    ConstantPressure,
    /// The angle of a recording never changes.
    NoMotion,
    /// The angle rests far from zero.
    FarFromZero,
    /// The fitted gain has the other sign than the model file's.
    OppositeGain,
    /// Recordings begin while the actuator moves.
    InMotion,
    /// The actuator moves although the pressure stays.
    HandRelease,
    /// Another minimum of the fit is as good.
    TwoMinima,
    /// The zero of a sensor ends farther away than a calibration leaves it.
    FarZero,
    /// A parameter of the refit is farther from the model's than anybody misjudges it.
    FarNumber,
    /// The angle sensor is at the end of its range.
    SaturatedAngle,
    /// The pressure sensor is at the end of its range.
    SaturatedPressure,
    /// Samples are missing, and the pressure is interpolated.
    DroppedSamples,
    /// Missing samples, so many that the recording is cut there.
    LongGap,
    /// Samples are not evenly spaced.
    Jitter,
    /// The first samples are off, as after a reset of the board.
    Reset,
    /// A block between cuts is too short.
    ShortStretch,
    /// A recording seems to be of another actuator.
    OtherActuator,
    /// A session behaves as if the base had been turned otherwise than it is said.
    Turned,
    /// The time is too short for all samples.
    TooManySamples,
    /// A session was given beside files that were cut from it.
    SegmentFiles,
    /// Samples that are not believed.
    LeftOut,
}

/// A problem of the recordings, and how it is handled.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Concern {
    /// Its subject.
    pub matter: Matter,
    /// The recording; none if it is about all of them.
    pub recording: Option<String>,
    /// The finding, and how it is handled.
    pub text: String,
    /// Advice for the user.
    pub advice: String,
}

impl std::fmt::Display for Concern {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(recording) = &self.recording {
            write!(f, "{recording}: ")?;
        }
        write!(f, "{}; {}", self.text, self.advice)
    }
}

impl Concern {
    /// What was left out of a recording.
    pub(crate) fn left_out(recording: &Recording, left_out: &LeftOut) -> Self {
        Self {
            matter: Matter::LeftOut,
            recording: Some(recording.name.clone()),
            text: left_out.found(),
            advice: left_out.text.clone(),
        }
    }

    pub(crate) fn of(
        matter: Matter,
        recording: Option<&Recording>,
        text: String,
        advice: &str,
    ) -> Self {
        Self {
            matter,
            recording: recording.map(|recording| recording.name.clone()),
            text,
            advice: advice.to_owned(),
        }
    }
}

/// The usable samples of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Usable {
    /// Blocks that are simulated whole, in order, as ranges of samples. A block ends
    /// where the motion cannot be followed further (a long gap in time, a saturated
    /// pressure); the next has an initial state of its own.
    pub blocks: Vec<Range<usize>>,
    /// Samples whose angle is not usable (sensor at the end of its range, or an unknown
    /// pressure just before): simulated, not fitted. Ranges in order, separate from each
    /// other, each within a block.
    pub unfitted: Vec<Range<usize>>,
    /// The findings, and how they are handled.
    pub concerns: Vec<Concern>,
}

/// Finds the usable samples of a recording.
///
/// | problem | handling |
/// |---|---|
/// | first samples after a reset of the board | left out: the first block begins after them |
/// | angle at the end of its range | simulated, not fitted |
/// | recorded command at its limit (it jumps there) | used: it is known |
/// | pressure at the end of its range, shortly | simulated as recorded; the angle is not fitted until a second after |
/// | pressure at the end of its range, longer | cut: a new block begins after it |
/// | short gap in time | the pressure is interpolated |
/// | longer gap in time, and the pressure is a straight line over so long a time where it is known | the pressure is interpolated |
/// | longer gap in time | cut: a new block begins after it |
/// | clock that begins again | cut: a new block begins there |
/// | clock that jitters | reported; the model is integrated with the recorded times |
/// | block too short to show a motion | left out |
/// | nothing left | refused |
///
/// # Errors
///
/// Refuses a recording of which fewer than [`FEWEST_SAMPLES`] samples are usable, and
/// says why the others are not.
pub fn usable(recording: &Recording) -> Result<Usable, InputError> {
    let mut concerns = Vec::new();
    let first = after_reset(recording, &mut concerns).max(let_go(recording, &mut concerns));
    let clock = Clock::of(recording);
    clock.describe(recording, &mut concerns);
    let pressure = saturated_pressure(recording, &mut concerns);
    let at_end = clipped(&recording.time, &recording.angle);
    describe_clipped_angle(recording, &at_end, &mut concerns);
    let beyond = beyond_table(recording, &mut concerns);

    // What lies between two cuts.
    let mut blocks = Vec::new();
    let mut begin = first;
    let gaps = clock.cuts.iter().chain(&recording.breaks).map(|&k| k..k);
    let unknown = unknown_pressure(recording);
    let mut cuts: Vec<Range<usize>> = gaps.chain(pressure.cut).chain(unknown).collect();
    cuts.sort_unstable_by_key(|cut| cut.start);
    let end = recording.len()..recording.len();
    for cut in cuts.into_iter().chain([end]) {
        if begin < cut.start {
            blocks.push(begin..cut.start);
        }
        begin = begin.max(cut.end);
    }
    drop_short(recording, &mut blocks, &mut concerns);

    let removed = recording.removed_from(Channel::Angle);
    let removed = removed.map(|it| it.samples.clone());
    let unfitted = within(
        &blocks,
        &union(
            at_end
                .into_iter()
                .chain(beyond)
                .chain(pressure.unfitted)
                .chain(removed),
        ),
    );
    let usable = Usable {
        blocks,
        unfitted,
        concerns,
    };
    let left = count(&usable.blocks) - count(&usable.unfitted);
    if left < FEWEST_SAMPLES {
        return Err(nothing_left(recording, &usable.concerns, left));
    }
    Ok(usable)
}

fn count(ranges: &[Range<usize>]) -> usize {
    ranges.iter().map(ExactSizeIterator::len).sum()
}

/// Ranges in order, with those joined that touch or overlap.
fn union(ranges: impl Iterator<Item = Range<usize>>) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = ranges.filter(|range| !range.is_empty()).collect();
    ranges.sort_unstable_by_key(|range| range.start);
    let mut joined: Vec<Range<usize>> = Vec::with_capacity(ranges.len());
    for range in ranges {
        match joined.last_mut() {
            Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
            _ => joined.push(range),
        }
    }
    joined
}

/// The parts of `ranges` that lie within the blocks.
fn within(blocks: &[Range<usize>], ranges: &[Range<usize>]) -> Vec<Range<usize>> {
    let mut parts = Vec::with_capacity(ranges.len());
    for block in blocks {
        for range in ranges {
            let part = range.start.max(block.start)..range.end.min(block.end);
            if !part.is_empty() {
                parts.push(part);
            }
        }
    }
    parts
}

/// Time from the first to the last sample of a range (s).
fn lasts(recording: &Recording, range: &Range<usize>) -> f64 {
    match recording.time.get(range.clone()) {
        Some([first, .., last]) => last - first,
        _ => 0.0,
    }
}

/// The first sample that is not affected by a reset of the board.
fn after_reset(recording: &Recording, concerns: &mut Vec<Concern>) -> usize {
    let off = |values: &[f64], count: usize, least: f64| {
        let mut following = values[count..count + RESET_COMPARED].to_vec();
        let limit = RESET_SCATTERS * standard_deviation(&following).max(least);
        let rest = median(&mut following);
        values[..count]
            .iter()
            .all(|value| (value - rest).abs() > limit)
    };
    let found = (1..=RESET_SAMPLES).rev().find(|&count| {
        recording.len() >= count + RESET_COMPARED
            && recording.time[count] - recording.time[0] <= RESET_LASTS_S
            && off(&recording.pressure, count, LEAST_PRESSURE_SCATTER)
            && off(&recording.angle, count, LEAST_ANGLE_SCATTER)
    });
    let Some(count) = found else {
        return 0;
    };
    concerns.push(Concern::of(
        Matter::Reset,
        Some(recording),
        format!(
            "the first {} far from those that follow, in pressure ({:.1} kPa) and in {} ({:.1}{}), as after a reset of the board; left out",
            if count == 1 {
                "sample is".to_owned()
            } else {
                format!("{count} samples are")
            },
            recording.pressure[0] / PASCAL_PER_KPA,
            recording.measurand.name(),
            recording.angle[0].to_degrees(),
            recording.measurand.unit()
        ),
        "record with the present firmware, or delete those rows",
    ));
    count
}

/// The first sample after a hand has let go of the actuator, if one moved it.
fn let_go(recording: &Recording, concerns: &mut Vec<Concern>) -> usize {
    let Some(HandRelease { taken, released }) = handled(recording) else {
        return 0;
    };
    let since = |sample: usize| recording.time[sample] - recording.time[0];
    concerns.push(Concern::of(
        Matter::HandRelease,
        Some(recording),
        format!(
            "the actuator rests for {:.2} s and then moves although the pressure stays, as if by hand; used from {:.2} s on",
            since(taken),
            since(released)
        ),
        "begin a recording after the release, or record the force; if no hand did it, check the pressure sensor",
    ));
    released
}

/// How a logger that writes a row only when a value changes shows its rests.
struct Rests {
    /// The steps of the converters (Pa, rad), if rows are written on change.
    steps: Option<[f64; 2]>,
}

impl Rests {
    /// Rows are written on change if no two that follow each other are equal although both
    /// channels have steps.
    fn of(recording: &Recording) -> Self {
        let equal = (1..recording.len()).any(|k| {
            same(recording.pressure[k], recording.pressure[k - 1])
                && same(recording.angle[k], recording.angle[k - 1])
        });
        let steps = [&recording.pressure, &recording.angle].map(|it| quantisation_step(it));
        let is_on_change = !equal && steps.iter().all(|step| *step > 0.0);
        Self {
            steps: is_on_change.then_some(steps),
        }
    }

    /// Whether nothing changed before a sample: it differs from the one before by one step.
    fn before(&self, recording: &Recording, sample: usize) -> bool {
        let change = |values: &[f64]| (values[sample] - values[sample - 1]).abs();
        self.steps.is_some_and(|[pressure, angle]| {
            change(&recording.pressure) < 1.5 * pressure && change(&recording.angle) < 1.5 * angle
        })
    }
}

/// Whether the pressure across the gap before a sample is known although nobody recorded it: in
/// windows of the recording that are as long and change as much, a straight line from end to end is as
/// good as what was recorded. Windows have no gap that is not `bridged` (s).
fn is_followed(recording: &Recording, sample: usize, bridged: f64, within: &Within) -> bool {
    let (time, pressure) = (&recording.time, &recording.pressure);
    let length = time[sample] - time[sample - 1];
    let change = pressure[sample] - pressure[sample - 1];
    let every = recording.len().div_ceil(MOST_WINDOWS).max(1);
    let mut missed: Vec<f64> = (0..recording.len())
        .step_by(every)
        .filter_map(|first| {
            let last = first + time[first..].partition_point(|t| t - time[first] < length);
            let ends = [*pressure.get(first)?, *pressure.get(last)?];
            let is_whole = (first + 1..=last)
                .all(|k| time[k] - time[k - 1] <= bridged && !recording.is_break(k));
            let is_alike = (ends[1] - ends[0] - change).abs() <= within.alike;
            (is_whole && is_alike && last > first + 1).then(|| {
                let slope = (ends[1] - ends[0]) / (time[last] - time[first]);
                let line = |k: usize| ends[0] + slope * (time[k] - time[first]);
                let inner = first + 1..last;
                let count = inner.len() as f64;
                inner.map(|k| pressure[k] - line(k)).sum::<f64>().abs() / count
            })
        })
        .collect();
    missed.sort_unstable_by(f64::total_cmp);
    // The place of the quantile, a count of windows.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let place = (FOLLOWED_IN * missed.len() as f64) as usize;
    missed.len() >= FEWEST_WINDOWS && missed.get(place).is_some_and(|it| *it <= within.followed)
}

/// Within what a pressure (Pa) counts as the same, in a recording.
struct Within {
    /// A change from end to end.
    alike: f64,
    /// A mean.
    followed: f64,
}

impl Within {
    fn of(recording: &Recording) -> Self {
        let range = swing(&recording.pressure);
        let noise = noise(&recording.time, &recording.pressure);
        Self {
            alike: ALIKE * range,
            // Both ends of a line have noise: of its mean, two standard deviations are at most twice that.
            followed: libm::hypot(FOLLOWED * range, 2.0 * noise),
        }
    }
}

/// The sampling of a recording.
struct Clock {
    /// Samples after gaps that are too long to interpolate.
    cuts: Vec<usize>,
    /// Number of missing samples, about, in gaps that are interpolated.
    missing: f64,
    /// The longest gap (s).
    longest_s: f64,
    /// RMS of the intervals without gaps about the usual one, relative to it.
    jitter: f64,
}

impl Clock {
    fn of(recording: &Recording) -> Self {
        let usual = recording.interval();
        let rests = Rests::of(recording);
        // The pause where the clock begins again has no length.
        let steps = || {
            (1..)
                .zip(recording.time.windows(2))
                .filter(|(k, _)| !recording.is_break(*k))
                .map(|(k, pair)| (k, pair[1] - pair[0]))
                .filter(|(k, step)| *step <= 2.0 * usual || !rests.before(recording, *k))
        };
        // The median does not see the gaps, of which there are few.
        let mut deviations: Vec<f64> = steps()
            .map(|(_, step)| (step / usual - 1.0).abs())
            .collect();
        // Of normal deviations the median is 0.6745 standard deviations.
        let standard_deviation = median(&mut deviations) / 0.6745;
        let even = 1.0 + (MISSING - 1.0).max(MISSING_DEVIATIONS * standard_deviation);
        let bridged = BRIDGED_S.max(BRIDGED_INTERVALS * usual);
        let is_gap = |step: f64| step > even * usual;
        // A limit of exactly three intervals is met up to rounding.
        let bridged = bridged * (1.0 + 1e-6);
        let within = LazyCell::new(|| Within::of(recording));
        let cuts: Vec<usize> = steps()
            .filter(|(k, step)| *step > bridged && !is_followed(recording, *k, bridged, &within))
            .map(|(k, _)| k)
            .collect();
        let is_cut = |k: usize| cuts.binary_search(&k).is_ok();
        let without_gaps: Vec<f64> = steps()
            .filter(|(k, step)| !is_gap(*step) && !is_cut(*k))
            .map(|(_, step)| step / usual - 1.0)
            .collect();
        Self {
            missing: steps()
                .filter(|(k, step)| is_gap(*step) && !is_cut(*k))
                .map(|(_, step)| (step / usual).round() - 1.0)
                .sum(),
            longest_s: steps().map(|(_, step)| step).fold(0.0, f64::max),
            jitter: rms(&without_gaps),
            cuts,
        }
    }

    fn describe(&self, recording: &Recording, concerns: &mut Vec<Concern>) {
        let advice = "look for lost lines on the serial port, or sample more slowly";
        if let Some(&first) = self.cuts.first() {
            concerns.push(Concern::of(
                Matter::LongGap,
                Some(recording),
                format!(
                    "{}, the first at {:.2} s, the longest of {:.2} s: too long to follow the motion across, so each part is simulated from an initial state of its own",
                    match self.cuts.len() {
                        1 => "a gap in time".to_owned(),
                        count => format!("{count} gaps in time"),
                    },
                    recording.time[first - 1],
                    self.longest_s
                ),
                advice,
            ));
        }
        if self.missing > 0.0 {
            let share = self.missing / (self.missing + recording.len() as f64);
            concerns.push(Concern::of(
                Matter::DroppedSamples,
                Some(recording),
                format!(
                    "{:.0} samples are missing ({:.1} %); the pressure is interpolated across the gaps",
                    self.missing,
                    100.0 * share
                ),
                advice,
            ));
        }
        if self.jitter > JITTER {
            concerns.push(Concern::of(
                Matter::Jitter,
                Some(recording),
                format!(
                    "the time between samples varies by {:.0} %; the model is integrated with the recorded times",
                    100.0 * self.jitter
                ),
                "let a timer pace the sampling",
            ));
        }
    }
}

/// How a saturated pressure is handled.
#[derive(Default)]
struct SaturatedPressure {
    /// Samples that are left out.
    cut: Vec<Range<usize>>,
    /// Samples that are simulated and not fitted.
    unfitted: Vec<Range<usize>>,
}

fn saturated_pressure(recording: &Recording, concerns: &mut Vec<Concern>) -> SaturatedPressure {
    let pressure = &recording.pressure;
    let highest = pressure.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let ranges: Vec<Range<usize>> = clipped(&recording.time, pressure)
        .into_iter()
        // A zero that is cut off from below is a tare.
        .filter(|range| pressure[range.start] >= highest)
        .collect();
    let samples = count(&ranges);
    if samples == 0 || holds_still_elsewhere(pressure) || jumps_to(&ranges, recording) {
        return SaturatedPressure::default();
    }
    let often = samples as f64 >= SATURATED_SHARE * recording.len() as f64;
    let (cut, through): (Vec<_>, Vec<_>) = ranges
        .into_iter()
        .partition(|range| often || lasts(recording, range) >= LONG_SATURATION_S);
    let unfitted: Vec<Range<usize>> = through
        .into_iter()
        .map(|range| {
            let until = recording.time[range.end - 1] + RECOVERY_S;
            range.start..recording.time.partition_point(|time| *time <= until)
        })
        .collect();
    let handled = match (cut.is_empty(), unfitted.is_empty()) {
        (true, _) => format!(
            "they are simulated as recorded, and the angle is not fitted from there until {RECOVERY_S} s after"
        ),
        (_, true) => {
            "the pressure is not known there, so the recording is cut: each part is simulated from an initial state of its own".to_owned()
        }
        _ => format!(
            "the recording is cut where that lasts {LONG_SATURATION_S} s or longer, and each part simulated from an initial state of its own; elsewhere the angle is not fitted until {RECOVERY_S} s after"
        ),
    };
    concerns.push(Concern::of(
        Matter::SaturatedPressure,
        Some(recording),
        format!(
            "the pressure sensor is at the end of its range, {:.1} kPa, in {samples} of {} samples; {handled}",
            highest / PASCAL_PER_KPA,
            recording.len()
        ),
        "use less pressure, or another sensor",
    ));
    SaturatedPressure { cut, unfitted }
}

/// Whether a signal is also exactly constant between its extremes: then it has no noise
/// (a set-point, a simulation), and a constant highest value is no saturation.
fn holds_still_elsewhere(values: &[f64]) -> bool {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    values
        .chunk_by(|a, b| (a - b).abs() <= 1e-9 * (high - low))
        .any(|same| {
            same.len() >= FEWEST_SAMPLES
                && same[0] > low + 0.01 * (high - low)
                && same[0] < high - 0.01 * (high - low)
        })
}

/// Whether a pressure jumps to its highest values faster than air flows: then it is a
/// recorded command (the drive of a pump), which may stay at its limit and is known there.
fn jumps_to(ranges: &[Range<usize>], recording: &Recording) -> bool {
    let pressure = &recording.pressure;
    let low = pressure.iter().copied().fold(f64::INFINITY, f64::min);
    ranges.iter().any(|range| {
        let Some(before) = range.start.checked_sub(1) else {
            return false;
        };
        let rise = pressure[range.start] - pressure[before];
        let time = recording.time[range.start] - recording.time[before];
        time <= FASTEST_RISE_S && rise > 0.5 * (pressure[range.start] - low)
    })
}

/// Where the pressure was taken out for longer than it can be bridged.
fn unknown_pressure(recording: &Recording) -> impl Iterator<Item = Range<usize>> {
    recording
        .removed_from(Channel::Pressure)
        .filter(|it| it.why != Why::Held)
        .map(|it| it.samples.clone())
        .filter(|samples| lasts(recording, samples) > BRIDGED_S)
}

fn describe_clipped_angle(
    recording: &Recording,
    at_end: &[Range<usize>],
    concerns: &mut Vec<Concern>,
) {
    if at_end.is_empty() {
        return;
    }
    concerns.push(Concern::of(
        Matter::SaturatedAngle,
        Some(recording),
        format!(
            "the angle sensor is at the end of its range in {} of {} samples, which are not fitted",
            count(at_end),
            recording.len()
        ),
        "bend less far, or calibrate the sensor over its whole range",
    ));
}

/// Samples beyond the ends of the angle sensor's table, if the metadata says where those
/// are: there the board extrapolates, or the sensor is at its end.
fn beyond_table(recording: &Recording, concerns: &mut Vec<Concern>) -> Vec<Range<usize>> {
    let Some([low, high]) = recording.meta.angle_range_deg else {
        return Vec::new();
    };
    let range = low.to_radians()..=high.to_radians();
    let beyond: Vec<Range<usize>> = recording
        .angle
        .iter()
        .enumerate()
        .filter(|(_, angle)| !range.contains(angle))
        .map(|(k, _)| k..k + 1)
        .collect();
    let beyond = union(beyond.into_iter());
    if !beyond.is_empty() {
        concerns.push(Concern::of(
            Matter::SaturatedAngle,
            Some(recording),
            format!(
                "{} of {} samples lie beyond the angle sensor's table ({low:.0} to {high:.0}{}) and are not fitted",
                count(&beyond),
                recording.len(),
                recording.measurand.unit()
            ),
            "calibrate the sensor over the whole motion",
        ));
    }
    beyond
}

/// Drops the blocks that are too short to show a motion.
fn drop_short(recording: &Recording, blocks: &mut Vec<Range<usize>>, concerns: &mut Vec<Concern>) {
    let before = count(blocks);
    let pieces = blocks.len();
    blocks.retain(|block| {
        block.len() >= FEWEST_SAMPLES && lasts(recording, block) >= SHORTEST_BLOCK_S
    });
    let dropped = pieces - blocks.len();
    if dropped == 0 {
        return;
    }
    concerns.push(Concern::of(
        Matter::ShortStretch,
        Some(recording),
        format!(
            "{dropped} of {pieces} parts {} shorter than {SHORTEST_BLOCK_S} s or {FEWEST_SAMPLES} samples and left out, {} samples in all",
            if dropped == 1 { "is" } else { "are" },
            before - count(blocks)
        ),
        "record longer without interruption",
    ));
}

fn nothing_left(recording: &Recording, concerns: &[Concern], left: usize) -> InputError {
    let reasons: Vec<&str> = concerns
        .iter()
        .filter(|concern| concern.matter != Matter::Jitter)
        .map(|concern| concern.text.as_str())
        .collect();
    let advice: Vec<&str> = concerns
        .iter()
        .filter(|concern| concern.matter != Matter::Jitter)
        .map(|concern| concern.advice.as_str())
        .collect();
    let found = format!("{left} of {} samples can be used", recording.len());
    let (found, advice) = if reasons.is_empty() {
        (found, "a step that is held for a second or more".to_owned())
    } else {
        (
            format!("{found}: {}", reasons.join("; ")),
            advice.join(", "),
        )
    };
    InputError::new(
        found,
        format!("leave it out, and record it again: {advice}"),
    )
    .in_file(&recording.path)
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Thirty seconds at 100 Hz: slow swings of pressure and angle, both noisy.
    fn recording() -> Recording {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(7);
        let mut noise = |size: f64| random.random_range(-size..size);
        let swing = |time: f64| 0.5 - 0.5 * (time - 0.5).max(0.0).cos();
        let time: Vec<f64> = (0..3_000).map(|k| f64::from(k) * 0.01).collect();
        Recording {
            name: "run".into(),
            pressure: time
                .iter()
                .map(|t| 60e3 * swing(*t) + noise(500.0))
                .collect(),
            angle: time.iter().map(|t| swing(*t) + noise(0.01)).collect(),
            time,
            ..Recording::default()
        }
    }

    /// The recording without the samples that do not pass.
    fn keep(recording: &Recording, passes: impl Fn(usize) -> bool) -> Recording {
        let pick = |values: &[f64]| -> Vec<f64> {
            let kept = values.iter().enumerate().filter(|(k, _)| passes(*k));
            kept.map(|(_, value)| *value).collect()
        };
        Recording {
            time: pick(&recording.time),
            pressure: pick(&recording.pressure),
            angle: pick(&recording.angle),
            ..recording.clone()
        }
    }

    /// One stretch.
    fn whole_from(first: usize, end: usize) -> Vec<Range<usize>> {
        std::iter::once(first..end).collect()
    }

    fn matters(usable: &Usable) -> Vec<Matter> {
        usable.concerns.iter().map(|it| it.matter).collect()
    }

    #[test]
    fn samples_beyond_the_sensors_table_are_not_fitted() {
        let mut recording = recording();
        recording.meta.angle_range_deg = Some([-15.0, 50.0]);
        let usable_ones = usable(&recording).unwrap();
        assert_eq!(matters(&usable_ones), [Matter::SaturatedAngle]);
        let unfitted = |k: usize| usable_ones.unfitted.iter().any(|range| range.contains(&k));
        for (k, angle) in recording.angle.iter().enumerate() {
            assert_eq!(unfitted(k), angle.to_degrees() > 50.0, "sample {k}");
        }
        recording.meta.angle_range_deg = Some([-15.0, 130.0]);
        assert!(usable(&recording).unwrap().concerns.is_empty());
    }

    #[test]
    fn a_good_recording_is_used_whole() {
        let found = usable(&recording()).unwrap();
        assert_eq!(found.blocks, whole_from(0, 3_000));
        assert!(found.unfitted.is_empty());
        assert_eq!(found.concerns, []);
    }

    #[test]
    fn an_angle_at_the_end_of_its_range_is_not_fitted() {
        let mut recording = recording();
        for angle in &mut recording.angle {
            *angle = angle.min(0.9);
        }
        let found = usable(&recording).unwrap();
        assert_eq!(found.blocks, whole_from(0, 3_000));
        assert_eq!(matters(&found), [Matter::SaturatedAngle]);
        assert!(!found.unfitted.is_empty());
        for range in &found.unfitted {
            assert!(recording.angle[range.clone()].iter().all(|a| *a >= 0.9));
        }
    }

    /// Cuts the pressure off at its highest value in a range of samples.
    fn saturate(recording: &mut Recording, range: Range<usize>) {
        recording.pressure[range].fill(65e3);
    }

    #[test]
    fn a_pressure_that_is_cut_off_shortly_is_simulated_through() {
        let mut recording = recording();
        saturate(&mut recording, 350..382);
        let found = usable(&recording).unwrap();
        assert_eq!(found.blocks, whole_from(0, 3_000));
        assert_eq!(matters(&found), [Matter::SaturatedPressure]);
        // A second after the last of them.
        assert_eq!(found.unfitted.len(), 1);
        assert_eq!(found.unfitted[0].start, 350);
        assert!(found.unfitted[0].end.abs_diff(482) <= 1, "{found:?}");
    }

    #[test]
    fn a_pressure_that_is_cut_off_for_long_cuts_the_recording() {
        let mut recording = recording();
        saturate(&mut recording, 350..382);
        saturate(&mut recording, 950..1_010);
        let found = usable(&recording).unwrap();
        assert_eq!(found.blocks, [0..950, 1_010..3_000]);
        assert_eq!(matters(&found), [Matter::SaturatedPressure]);
        assert_eq!(found.unfitted.len(), 1);
    }

    #[test]
    fn a_pressure_that_is_cut_off_often_cuts_the_recording() {
        let mut recording = recording();
        // Where the pressure is highest.
        for start in [350, 978, 1_606, 2_235] {
            saturate(&mut recording, start..start + 40);
        }
        let found = usable(&recording).unwrap();
        let (first, last) = (&found.blocks[0], &found.blocks[4]);
        assert_eq!((first.clone(), last.clone()), (0..350, 2_275..3_000));
        assert!(found.unfitted.is_empty());
    }

    #[test]
    fn a_zero_that_is_cut_off_and_a_noiseless_hold_are_no_saturation() {
        let mut tare = recording();
        for pressure in &mut tare.pressure {
            *pressure = pressure.max(0.0);
        }
        assert_eq!(usable(&tare).unwrap().concerns, []);
        // A staircase of set-points between which the valve is noisy.
        let mut held = recording();
        held.pressure[1_000..1_100].fill(30e3);
        saturate(&mut held, 1_200..1_300);
        assert_eq!(usable(&held).unwrap().concerns, []);
    }

    #[test]
    fn a_command_at_its_limit_is_no_saturation() {
        let mut command = recording();
        saturate(&mut command, 350..450);
        assert_eq!(usable(&command).unwrap().blocks.len(), 2);
        command.pressure[349] = 0.0;
        let found = usable(&command).unwrap();
        assert_eq!(found.concerns, []);
    }

    #[test]
    fn short_gaps_are_bridged_and_long_ones_cut() {
        let whole = recording();
        let lossy = keep(&whole, |k| k % 10 < 6 && !(1_000..1_019).contains(&k));
        let found = usable(&lossy).unwrap();
        assert_eq!(found.blocks, whole_from(0, lossy.len()));
        assert_eq!(matters(&found), [Matter::DroppedSamples]);

        let cut = keep(&whole, |k| !(1_000..1_100).contains(&k));
        let found = usable(&cut).unwrap();
        assert_eq!(found.blocks, [0..1_000, 1_000..2_900]);
        assert_eq!(matters(&found), [Matter::LongGap]);

        // Three intervals of slow sampling are bridged, four are not.
        let slow = keep(&whole, |k| k % 20 == 0);
        let lost_two = keep(&slow, |k| k != 70 && k != 71);
        assert_eq!(usable(&lost_two).unwrap().blocks.len(), 1);
        let lost_three = keep(&slow, |k| !(70..73).contains(&k));
        assert_eq!(usable(&lost_three).unwrap().blocks.len(), 2);
    }

    /// What the pressure does in a gap is known from what it does in as long a time elsewhere.
    #[test]
    fn a_longer_gap_is_bridged_where_nothing_happens_in_so_long_a_time() {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(9);
        let mut driven = |pressure: &dyn Fn(f64) -> f64| {
            let mut recording = recording();
            for (pa, time) in recording.pressure.iter_mut().zip(&recording.time) {
                *pa = pressure(*time) + random.random_range(-300.0..300.0);
            }
            recording
        };
        let without = |range: Range<usize>, recording: &Recording| {
            usable(&keep(recording, |k| !range.contains(&k)))
                .unwrap()
                .blocks
                .len()
        };
        // Steps of ten seconds, and pulses of one.
        let steps = driven(&|t| 20e3 * (t / 10.0).floor());
        let pulses = driven(&|t| 20e3 * t.floor().rem_euclid(2.0));
        let gap = 1_400..1_580;
        assert_eq!(without(gap.clone(), &steps), 1);
        assert_eq!(without(gap, &pulses), 2);
        // Where a step was in the gap, nobody knows when.
        assert_eq!(without(1_900..2_080, &steps), 2);
        // A third of slow samples is missing, four in a row at times.
        let slow = keep(&steps, |k| k % 20 == 0);
        let chance: Vec<bool> = (0..slow.len()).map(|_| random.random_bool(0.67)).collect();
        let lossy = keep(&slow, |k| chance[k]);
        let longest = lossy.time.windows(2).map(|pair| pair[1] - pair[0]);
        assert!(longest.fold(0.0, f64::max) > 0.7, "no long gap was drawn");
        assert_eq!(usable(&lossy).unwrap().blocks.len(), 1);
    }

    #[test]
    fn a_clock_that_jitters_is_said() {
        let mut recording = recording();
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(8);
        let mut now = 0.0;
        for time in &mut recording.time {
            *time = now;
            // Evenly distributed intervals scatter by 1/√3 of their half width.
            now += random.random_range(0.005..0.015);
        }
        let found = usable(&recording).unwrap();
        assert_eq!(found.blocks, whole_from(0, 3_000));
        assert_eq!(matters(&found), [Matter::Jitter]);
        assert!(found.concerns[0].text.contains("29 %"), "{found:?}");
    }

    #[test]
    fn short_stretches_are_dropped() {
        let whole = recording();
        let lossy = keep(&whole, |k| {
            !(1_000..1_100).contains(&k) && !(1_130..1_200).contains(&k)
        });
        let found = usable(&lossy).unwrap();
        assert_eq!(found.blocks, [0..1_000, 1_030..2_830]);
        assert_eq!(matters(&found), [Matter::LongGap, Matter::ShortStretch]);
        assert!(found.concerns[1].text.contains("30 samples"), "{found:?}");
    }

    #[test]
    fn the_first_samples_after_a_reset_are_left_out() {
        for count in 1..=3 {
            let mut recording = recording();
            recording.pressure[..count].fill(-4.6e3);
            recording.angle[..count].fill(12f64.to_radians());
            let found = usable(&recording).unwrap();
            assert_eq!(found.blocks, whole_from(count, 3_000));
            assert_eq!(matters(&found), [Matter::Reset]);
        }
        // One of the two alone is no reset, and neither is a fourth sample.
        let mut angle_alone = recording();
        angle_alone.angle[0] = 0.5;
        assert_eq!(usable(&angle_alone).unwrap().blocks, whole_from(0, 3_000));
        let mut four = recording();
        four.pressure[..4].fill(-4.6e3);
        four.angle[..4].fill(0.2);
        assert_eq!(usable(&four).unwrap().blocks, whole_from(0, 3_000));
        // In slow sampling a step looks the same.
        let mut slow = recording();
        slow.pressure[0] = -4.6e3;
        slow.angle[0] = 0.2;
        for time in &mut slow.time {
            *time *= 20.0;
        }
        assert_eq!(usable(&slow).unwrap().blocks, whole_from(0, 3_000));
    }

    #[test]
    fn a_recording_of_which_nothing_is_left_is_refused() {
        let short = keep(&recording(), |k| k < 40);
        let refused = usable(&short).unwrap_err().to_string();
        assert!(
            refused.contains("0 of 40 samples") && refused.contains("record longer"),
            "{refused}"
        );
        // A sample every ten seconds or so, among bursts of a few.
        let bursts = keep(&recording(), |k| k % 100 < 15);
        let refused = usable(&bursts).unwrap_err().to_string();
        assert!(
            refused.contains("30 gaps") || refused.contains("29 gaps"),
            "{refused}"
        );
    }

    #[test]
    fn a_block_ends_where_the_clock_begins_again() {
        let mut recording = recording();
        for time in &mut recording.time[1_200..] {
            *time += 600.0;
        }
        recording.breaks = vec![1_200];
        let found = usable(&recording).unwrap();
        assert_eq!(found.blocks, [0..1_200, 1_200..3_000]);
        assert_eq!(found.concerns, [], "the pause is no gap");
    }
}
