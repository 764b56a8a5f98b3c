//! Samples that no motion can reach.
//!
//! A loose contact, a torn line, a converter with all bits set or a filter that holds its last
//! value write numbers that the actuator never had. One of them is worth more to a sum of squares
//! than a thousand good samples: the noise looks large, and every missing effect hides below it.
//! They are found before anything else looks at a recording, by marks each of which asks for more
//! than a fast motion can give ([`cleaned`]).
//!
//! Nothing is repaired silently: what is found stays in the recording's list of removed samples
//! with the recorded values.

use std::collections::BTreeSet;
use std::ops::Range;

use crate::statistics::{median, quantisation_step, same};
use softrig_formats::error::InputError;
use softrig_formats::left_out::{LeftOut, What};
use softrig_formats::recording::Recording;
use softrig_formats::removed::{Channel, Why};

/// A sample is far from its neighbours from so many usual distances: of 10⁵ samples with
/// normal noise none is.
const FAR: f64 = 8.0;

/// The distance is larger than what the neighbours differ by, so many times.
const APART: f64 = 3.0;

/// Share of the range that counts as usual distance at least.
const LEAST_SHARE: f64 = 2e-3;

/// A value is out of reach beyond the range of the others by so many ranges.
const OUT_OF_REACH: f64 = 2.0;

/// Most samples in a row that can be isolated.
const ISOLATED: usize = 3;

/// A command jumps by so large a share of the range.
const JUMP: f64 = 0.1;

/// Coarsest step of a converter, as a share of the range.
const COARSEST: f64 = 0.02;

/// Passes of the search: an impossible sample may hide behind another.
const PASSES: usize = 3;

/// Largest share of impossible samples in a channel; with more the channel is not believed.
const MOST: f64 = 0.05;

/// Share of equal successive samples from which a channel has too little noise to tell a frozen
/// value from a rest.
const QUIET: f64 = 0.3;

/// Fewest equal samples that can be a frozen value.
const FROZEN: usize = 10;

/// Share of runs of equal samples that have the usual length where a channel is held; others are
/// longer because noise repeated a value.
const HELD: f64 = 0.8;

/// Largest share of runs that are shorter, and of rows at which another channel changes.
const SHORTER: f64 = 0.02;

/// Fewest samples with which anything can be said.
const FEWEST: usize = 20;

/// The recording without what no motion can reach, and the list of it.
///
/// | mark | what shows it |
/// |---|---|
/// | isolated | one sample far from two neighbours on both sides, which agree with each other |
/// | out of reach | samples beyond the range of the others by more than twice that range, entered and left in one step |
/// | repeated | a value that comes back to its last digit, each time entered and left in one step |
/// | frozen | a channel with noise that stays at one value to the last digit |
///
/// And a channel that is slower than its rows is *held*: sampled where it changes.
///
/// A straight line replaces what is removed, so that sums over a recording keep their sense; the
/// angle there is not fitted, and the pressure is bridged.
///
/// # Errors
///
/// Refuses a recording with too many impossible samples, by file, channel and the first lines.
pub fn cleaned(recording: &Recording) -> Result<Recording, InputError> {
    if recording.len() < FEWEST || !recording.removed.is_empty() {
        return Ok(recording.clone());
    }
    let mut clean = recording.clone();
    if let Some(sampled) = sampled_together(recording) {
        clean = recording.picked(&sampled);
        let places = (0..recording.len())
            .filter(|k| sampled.binary_search(k).is_err())
            .map(|k| recording.place(k));
        clean.left_out.push(LeftOut::new(
            What::HeldRow,
            &recording.path,
            places,
            "left out; both channels are sampled where they change",
        ));
    }
    let recording = &clean.clone();
    let pressure = Signal::of(recording, Channel::Pressure);
    let of_pressure = pressure.impossible(&|_| false);
    let pulses = pressure.pulses(&of_pressure);
    let answers_a_pulse = |sample: usize| {
        pulses
            .iter()
            .any(|pulse| (*pulse..*pulse + 3).contains(&sample))
    };
    let of_angle = Signal::of(recording, Channel::Angle).impossible(&answers_a_pulse);
    for (channel, mut found) in [(Channel::Pressure, of_pressure), (Channel::Angle, of_angle)] {
        found.extend(held(recording, channel));
        clean.remove(channel, found);
    }
    refuse_unbelievable(&clean)?;
    let removed = clean.what_was_removed();
    clean.left_out.extend(removed);
    Ok(clean)
}

/// Refuses a recording of which too much is impossible.
fn refuse_unbelievable(recording: &Recording) -> Result<(), InputError> {
    for channel in [Channel::Pressure, Channel::Angle] {
        let all = || {
            recording
                .removed_from(channel)
                .filter(|it| it.why.is_fault())
        };
        let count: usize = all().map(|it| it.samples.len()).sum();
        if count as f64 > MOST * recording.len() as f64 {
            let first: Vec<String> = all()
                .take(3)
                .map(|it| recording.place(it.samples.start))
                .collect();
            return Err(InputError::new(
                format!(
                    "{count} of {} samples of the {channel} are impossible ({:.0} %), the first at {}: the {channel} cannot be trusted",
                    recording.len(),
                    100.0 * count as f64 / recording.len() as f64,
                    first.join(", ")
                ),
                "look at the sensor's cable and at the logger, and record it again; or delete those rows, if the others are right",
            )
            .in_file(&recording.path));
        }
    }
    Ok(())
}

/// A stretch of samples that are not believed.
type Found = (Range<usize>, Why);

/// A channel, with what is usual in it.
///
/// How far is far is measured by the recording itself: the usual distance of a sample from its
/// neighbours (a median, which wild samples do not move), a five-hundredth of its range, and the
/// step of its converter. A pulse of a recorded command is no fault of a sensor, and an angle that
/// answers a pulse of the pressure is none either.
struct Signal<'a> {
    channel: Channel,
    values: &'a [f64],
    /// Lowest and highest value of nearly all samples.
    range: [f64; 2],
    /// Usual distance of a sample from its neighbours.
    usual: f64,
    /// Whether it is a recorded command: it stands still to the last digit, and jumps.
    is_command: bool,
}

impl<'a> Signal<'a> {
    fn of(recording: &'a Recording, channel: Channel) -> Self {
        let values = recording.channel(channel);
        let sorted = sorted(values.iter().copied());
        let range = [part_of(&sorted, 0.01), part_of(&sorted, 0.99)];
        let size = range[1] - range[0];
        // Coarser levels are those of a command.
        let step = quantisation_step(values).min(COARSEST * size);
        let mut distances: Vec<f64> = values
            .windows(5)
            .map(|w| (w[2] - Around::of([w[0], w[1], w[3], w[4]]).middle).abs())
            .collect();
        let usual = (1.4826 * median(&mut distances))
            .max(LEAST_SHARE * size)
            .max(0.5 * step)
            .max(f64::MIN_POSITIVE);
        let changes = || values.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        let lasting = values
            .windows(3)
            .filter(|w| (w[2] - w[0]).abs() > 0.5 * (w[1] - w[0]).abs())
            .map(|w| (w[1] - w[0]).abs())
            .fold(0.0, f64::max);
        let still = changes().filter(|change| *change == 0.0).count();
        let stands_still = still as f64 > QUIET * values.len() as f64;
        Self {
            channel,
            values,
            range,
            usual,
            is_command: channel == Channel::Pressure && stands_still && lasting > JUMP * size,
        }
    }

    /// Whether a value lies beyond the others' range by more than that range twice.
    fn is_out_of_reach(&self, value: f64) -> bool {
        let beyond = (self.range[0] - value).max(value - self.range[1]);
        beyond > OUT_OF_REACH * self.size()
    }

    /// The range of nearly all samples.
    fn size(&self) -> f64 {
        (self.range[1] - self.range[0]).max(self.usual)
    }

    /// All that is not believed in this channel, in order; what is `excused` has a cause.
    fn impossible(&self, excused: &dyn Fn(usize) -> bool) -> Vec<Found> {
        let mut bad = vec![None; self.values.len()];
        let mark = |bad: &mut Vec<Option<Why>>, samples: &[usize], why: Why| {
            for &sample in samples {
                bad[sample].get_or_insert(why);
            }
        };
        let kept_of = |bad: &[Option<Why>]| -> Vec<usize> {
            (0..bad.len()).filter(|&k| bad[k].is_none()).collect()
        };
        for (run, why) in self.out_of_reach() {
            mark(&mut bad, &run.collect::<Vec<_>>(), why);
        }
        for _ in 0..PASSES {
            let kept = kept_of(&bad);
            let found: Vec<usize> = self
                .standing_out(&kept)
                .chain(self.at_the_ends(&kept))
                .filter(|&k| {
                    self.is_out_of_reach(self.values[k]) || !(self.is_command || excused(k))
                })
                .collect();
            if found.is_empty() {
                break;
            }
            mark(&mut bad, &found, Why::Isolated);
        }
        // The shortest first: what lies between two of them is not one.
        loop {
            let found = self.shortest_stuck(&kept_of(&bad), excused);
            if found.is_empty() {
                break;
            }
            for (samples, why) in found {
                mark(&mut bad, &samples, why);
            }
        }
        stretches(&bad)
    }

    /// What nearly all changes from one of the `kept` samples to the next stay below. The two largest
    /// do not count: a run that is asked about makes two, which are many in a short recording.
    fn change(&self, kept: &[usize]) -> f64 {
        let changes = kept.windows(2);
        let changes = changes.map(|pair| (self.values[pair[1]] - self.values[pair[0]]).abs());
        let mut changes = sorted(changes);
        changes.truncate(changes.len().saturating_sub(2));
        part_of(&changes, 0.99)
    }

    /// Up to [`ISOLATED`] of the `kept` samples in a row that stand out from two on both sides,
    /// which agree with each other.
    fn standing_out(&self, kept: &[usize]) -> impl Iterator<Item = usize> {
        let change = self.change(kept);
        (1..=ISOLATED).flat_map(move |run| {
            kept.windows(4 + run)
                .flat_map(move |w| {
                    let at = |k: usize| self.values[w[k]];
                    let around = Around::of([at(0), at(1), at(2 + run), at(3 + run)]);
                    let least = (2..2 + run)
                        .map(|k| at(k) - around.middle)
                        .reduce(nearer_to_zero)
                        .unwrap_or(0.0);
                    // More than one sample may be a motion, if there are others as fast.
                    let others = if run > 1 { change } else { 0.0 };
                    let stands_out = least.abs() > FAR * self.usual
                        && least.abs() > APART * around.apart.max(others);
                    w[2..2 + run].iter().copied().filter(move |_| stands_out)
                })
                .collect::<Vec<_>>()
        })
    }

    /// The first two and the last two of the `kept` samples, where they stand out from the next
    /// ones by more than any two others do.
    fn at_the_ends(&self, kept: &[usize]) -> Vec<usize> {
        // A recording may begin or end with a step of its pressure.
        let kept = if self.channel == Channel::Angle {
            kept
        } else {
            &[]
        };
        let change = |pair: &[usize]| (self.values[pair[1]] - self.values[pair[0]]).abs();
        let inner = kept.get(2..kept.len().saturating_sub(2)).unwrap_or(&[]);
        let largest = inner
            .windows(2)
            .map(change)
            .fold(FAR * self.usual, f64::max);
        let (first, last) = (inner.first().copied(), inner.last().copied());
        let far = |sample: usize, from: usize| {
            (self.values[sample] - self.values[from]).abs() > 2.0 * APART * largest
        };
        let begin = kept.iter().take(2).copied().zip(first.into_iter().cycle());
        let end = kept
            .iter()
            .rev()
            .take(2)
            .copied()
            .zip(last.into_iter().cycle());
        begin
            .chain(end)
            .filter(|(sample, from)| far(*sample, *from))
            .map(|(sample, _)| sample)
            .collect()
    }

    /// Samples far beyond the others, entered and left in one step from among them. A recording of
    /// a pressure may begin or end far from most of it.
    fn out_of_reach(&self) -> Vec<Found> {
        let is_out: Vec<Option<Why>> = self
            .values
            .iter()
            .map(|value| self.is_out_of_reach(*value).then_some(Why::OutOfReach))
            .collect();
        let is_step = |from: usize, to: usize| match (self.values.get(from), self.values.get(to)) {
            (Some(from), Some(to)) => (to - from).abs() > OUT_OF_REACH * self.size(),
            _ => self.channel == Channel::Angle,
        };
        let mut found = stretches(&is_out);
        found.retain(|(run, _)| {
            is_step(run.start.wrapping_sub(1), run.start) && is_step(run.end - 1, run.end)
        });
        found
    }

    /// The shortest runs of one value among the `kept` samples that are not believed: all of the
    /// same length, so that a long file with many is not read once for each.
    fn shortest_stuck(
        &self,
        kept: &[usize],
        excused: &dyn Fn(usize) -> bool,
    ) -> Vec<(Vec<usize>, Why)> {
        let values: Vec<f64> = kept.iter().map(|&k| self.values[k]).collect();
        let runs: Vec<Range<usize>> = equal_runs(&values).collect();
        let longest_by_chance = Self::longest_by_chance(&runs, values.len());
        // The step from one sample to the next that no motion makes.
        let limit = (FAR * self.usual).max(APART * self.change(kept));
        let is_stuck = |run: &Range<usize>| -> Option<(Range<usize>, Why)> {
            let value = values[run.start];
            let left = values.get(run.end)? - value;
            let entered = run.start.checked_sub(1).map(|k| value - values[k]);
            if left.abs() <= limit {
                return None;
            }
            if entered.is_some_and(|entered| self.goes_and_comes(entered, left, limit))
                && !run.clone().any(|k| excused(kept[k]))
            {
                return Some((run.clone(), Why::Repeated));
            }
            // The first of them was measured.
            let is_long = longest_by_chance.is_some_and(|most| run.len() as f64 > most);
            is_long.then(|| (run.start + 1..run.end, Why::Frozen))
        };
        let runs = runs.iter().filter(|run| run.len() >= 2);
        let mut stuck: Vec<(Range<usize>, Why)> = runs.filter_map(is_stuck).collect();
        let shortest = stuck.iter().map(|(run, _)| run.len()).min();
        stuck.retain(|(run, _)| Some(run.len()) == shortest);
        stuck
            .into_iter()
            .map(|(run, why)| (kept[run].to_vec(), why))
            .collect()
    }

    /// Whether a value was entered and left by steps that no other sample makes, there and back.
    fn goes_and_comes(&self, entered: f64, left: f64, limit: f64) -> bool {
        let [larger, smaller] = [entered.abs().max(left.abs()), entered.abs().min(left.abs())];
        !self.is_command
            && entered * left < 0.0
            && smaller > limit
            && larger - smaller < 0.5 * larger
    }

    /// How long a run of one value can be in a channel with noise, at least [`FROZEN`]; none where
    /// it rests to the last digit elsewhere, and may rest there.
    fn longest_by_chance(runs: &[Range<usize>], samples: usize) -> Option<f64> {
        let short = || runs.iter().filter(|run| run.len() < FROZEN);
        let in_short: usize = short().map(ExactSizeIterator::len).sum();
        let share = (in_short - short().count()) as f64 / in_short.max(1) as f64;
        let by_chance = libm::log(samples as f64) / -libm::log(share.max(1e-3));
        let is_noisy = share <= QUIET && 2 * in_short >= samples;
        is_noisy.then(|| (APART * (by_chance + 1.0)).max(FROZEN as f64 - 1.0))
    }

    /// Samples that stand out and are believed: pulses that happened.
    fn pulses(&self, removed: &[Found]) -> Vec<usize> {
        let all: Vec<usize> = (0..self.values.len()).collect();
        self.standing_out(&all)
            .filter(|sample| !removed.iter().any(|(run, _)| run.contains(sample)))
            .collect()
    }
}

/// What the neighbours of a sample agree on.
struct Around {
    /// Their median.
    middle: f64,
    /// Their largest distance from it.
    apart: f64,
}

impl Around {
    fn of(mut neighbours: [f64; 4]) -> Self {
        let middle = median(&mut neighbours);
        let apart = neighbours
            .iter()
            .map(|it| (it - middle).abs())
            .fold(0.0, f64::max);
        Self { middle, apart }
    }
}

/// The smaller of two distances on the same side; zero for two sides.
fn nearer_to_zero(a: f64, b: f64) -> f64 {
    if a * b <= 0.0 {
        0.0
    } else if a.abs() < b.abs() {
        a
    } else {
        b
    }
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_unstable_by(f64::total_cmp);
    sorted
}

/// The value below which a share of the sorted ones lies.
fn part_of(sorted: &[f64], share: f64) -> f64 {
    // A share of the last index.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let index = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(index).copied().unwrap_or(0.0)
}

/// Ranges of successive samples with the same value.
fn equal_runs(values: &[f64]) -> impl Iterator<Item = Range<usize>> {
    values.chunk_by(|a, b| same(*a, *b)).scan(0, |start, run| {
        let range = *start..*start + run.len();
        *start = range.end;
        Some(range)
    })
}

/// Ranges of samples with the same mark.
fn stretches(marks: &[Option<Why>]) -> Vec<Found> {
    let mut start = 0;
    let mut found = Vec::new();
    for run in marks.chunk_by(|a, b| a == b) {
        if let Some(why) = run[0] {
            found.push((start..start + run.len(), why));
        }
        start += run.len();
    }
    found
}

/// For how many rows a channel keeps each value, if it is slower than the rows: nearly all runs of
/// equal samples are whole multiples of that length. Or, where the rates have no common step, most
/// runs have that length or one more and hardly any is shorter, noise would not repeat a value, and
/// the steps between them are neither those of a converter nor those of a command.
fn held_for(recording: &Recording, channel: Channel) -> Option<usize> {
    let values = recording.channel(channel);
    let runs: Vec<Range<usize>> = equal_runs(values).collect();
    // The first and the last may be cut.
    let inner = runs.get(1..runs.len().checked_sub(1)?)?;
    if inner.len() < FEWEST {
        return None;
    }
    let share = |holds: &dyn Fn(usize) -> bool| {
        inner.iter().filter(|run| holds(run.len())).count() as f64 / inner.len() as f64
    };
    let mut lengths: Vec<f64> = inner.iter().map(|run| run.len() as f64).collect();
    // Lengths of runs.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let middle = median(&mut lengths) as usize;
    // A coarse converter repeats values more often than not, but whole samples of them.
    let in_step = (2..=middle.max(2)).rev().find(|&length| {
        let whole = share(&|it| it.is_multiple_of(length)) >= 1.0 - SHORTER;
        whole && inner.iter().filter(|run| run.len() == length).count() >= FEWEST
    });
    if channel == Channel::Angle && in_step.is_some() {
        return in_step;
    }
    let length = [middle, middle.saturating_sub(1)]
        .into_iter()
        .find(|&length| {
            length > 0
                && share(&|it| it == length || it == length + 1) >= HELD
                && share(&|it| it < length) <= SHORTER
        })?;
    if share(&|it| it == 1) > 0.5 {
        return None;
    }
    let levels: Vec<f64> = inner.iter().map(|run| values[run.start]).collect();
    let middle = |sizes: Vec<f64>| median(&mut { sizes });
    let step = middle(levels.windows(2).map(|w| (w[1] - w[0]).abs()).collect());
    let bend = middle(
        levels
            .windows(3)
            .map(|w| (0.5 * (w[0] + w[2]) - w[1]).abs())
            .collect(),
    );
    let is_smooth = channel == Channel::Angle || bend < 0.5 * step;
    (is_smooth && step > 1.5 * quantisation_step(values)).then_some(length)
}

/// Where a channel that keeps each value for so many rows was sampled. A value that the next
/// sample repeated stands for longer.
fn samples_of(values: &[f64], held: usize) -> impl Iterator<Item = usize> {
    equal_runs(values).flat_map(move |run| {
        let count = (run.len() / held).max(1);
        (0..count).map(move |sample| run.start + sample * held)
    })
}

/// The rows at which both channels are sampled, if the angle is slower than the rows and the
/// pressure changes nowhere else.
fn sampled_together(recording: &Recording) -> Option<Vec<usize>> {
    let held = held_for(recording, Channel::Angle)?;
    let angle: BTreeSet<usize> = samples_of(&recording.angle, held).collect();
    let mut both = angle.clone();
    both.extend(equal_runs(&recording.pressure).map(|run| run.start));
    ((1.0 - SHORTER) * both.len() as f64 <= angle.len() as f64).then(|| both.into_iter().collect())
}

/// The repeats of a held channel.
fn held(recording: &Recording, channel: Channel) -> Vec<Found> {
    let Some(held) = held_for(recording, channel) else {
        return Vec::new();
    };
    let values = recording.channel(channel);
    let mut repeats = vec![Some(Why::Held); values.len()];
    for sample in samples_of(values, held) {
        repeats[sample] = None;
    }
    stretches(&repeats)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use softrig_formats::recording::Recording;

    /// Thirty seconds at 100 Hz of steps of the pressure and of an angle that follows, both with
    /// noise.
    fn steps(noise: f64) -> Recording {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(3);
        let mut draw = || random.random_range(-1.0..1.0) * noise;
        let time: Vec<f64> = (0..3_000).map(|k| f64::from(k) * 0.01).collect();
        let mut angle = 0.0;
        let (mut pressures, mut angles) = (Vec::new(), Vec::new());
        for t in &time {
            let pressure = if (t / 10.0).fract() < 0.5 { 0.0 } else { 50e3 };
            angle += 0.02 * (pressure / 50e3 - angle);
            pressures.push(pressure + 1e4 * draw());
            angles.push(angle + draw());
        }
        Recording {
            time,
            pressure: pressures,
            angle: angles,
            ..Recording::default()
        }
    }

    fn found(recording: &Recording, channel: Channel) -> Vec<(usize, usize)> {
        let clean = cleaned(recording).unwrap();
        let of_channel = clean.removed_from(channel);
        of_channel
            .map(|it| (it.samples.start, it.samples.len()))
            .collect()
    }

    #[test]
    fn nothing_is_found_where_nothing_is_wrong() {
        for noise in [0.0, 1e-4, 0.01, 0.2] {
            let clean = cleaned(&steps(noise)).unwrap();
            assert_eq!(clean.removed, [], "{noise}");
            assert_eq!(clean.left_out, []);
        }
    }

    /// Whatever the value, wherever it lies, in both channels.
    #[test]
    fn single_wild_samples_are_found_with_their_value() {
        for (sample, value) in [
            (0, 9.0),
            (40, 0.5),
            (777, -8.0),
            (1_300, 655.35),
            (2_999, -3.0),
        ] {
            let mut wild = steps(0.01);
            wild.angle[sample] = value;
            let clean = cleaned(&wild).unwrap();
            assert_eq!(clean.removed.len(), 1, "{sample}");
            assert_eq!(clean.removed[0].values, [value]);
            assert_eq!(clean.removed[0].samples, sample..sample + 1);
            assert!((clean.angle[sample] - steps(0.01).angle[sample]).abs() < 0.05);
            assert_eq!(clean.angle.len(), 3_000);
        }
        let mut wild = steps(0.01);
        wild.pressure[900] = 9e6;
        assert_eq!(found(&wild, Channel::Pressure), [(900, 1)]);
        assert_eq!(found(&wild, Channel::Angle), []);
    }

    #[test]
    fn a_value_that_comes_back_is_found_inside_the_range_and_in_runs() {
        let mut wild = steps(0.01);
        for (start, count) in [(620, 1), (700, 2), (1_700, 30), (2_800, 4)] {
            wild.angle[start..start + count].fill(0.0);
        }
        // By then the angle is above 0.3.
        assert_eq!(
            found(&wild, Channel::Angle),
            [(620, 1), (700, 2), (1_700, 30), (2_800, 4)]
        );
        for sample in (0..3_000).step_by(500) {
            wild.angle[sample + 30] = -9_999.0;
            wild.angle[sample + 31] = -9_999.0;
        }
        assert_eq!(found(&wild, Channel::Angle).len(), 10);
    }

    /// Two wild samples in a row make one in fifty of the changes of a short recording.
    #[test]
    fn runs_are_found_in_short_recordings() {
        let whole = steps(0.01);
        for run in [1, 2, 3] {
            let mut short = whole.slice(&(600..750));
            short.angle[80..80 + run].fill(0.0);
            short.angle[120] = 0.0;
            assert_eq!(
                found(&short, Channel::Angle),
                [(80, run), (120, 1)],
                "{run} in a row"
            );
        }
        assert_eq!(found(&whole.slice(&(600..750)), Channel::Angle), []);
    }

    /// A rest of a converter without noise lies between them.
    #[test]
    fn what_lies_between_two_dropouts_is_believed() {
        let mut rest = steps(0.0);
        for angle in &mut rest.angle {
            *angle = (*angle / 0.02).round() * 0.02;
        }
        rest.angle[850] = 0.0;
        rest.angle[900..905].fill(0.0);
        assert_eq!(found(&rest, Channel::Angle), [(850, 1), (900, 5)]);
    }

    #[test]
    fn a_pulse_of_the_command_and_its_answer_are_believed() {
        let mut pulsed = steps(0.0);
        pulsed.pressure[1_200] = 50e3;
        assert_eq!(found(&pulsed, Channel::Pressure), []);
        let mut answered = steps(0.001);
        answered.pressure = steps(0.0).pressure;
        answered.pressure[1_200] = 50e3;
        answered.angle[1_201] += 0.2;
        assert_eq!(found(&answered, Channel::Angle), []);
        answered.angle[2_400] += 0.2;
        assert_eq!(found(&answered, Channel::Angle), [(2_400, 1)]);
    }

    #[test]
    fn a_frozen_value_is_found_by_its_missing_noise() {
        let mut frozen = steps(0.01);
        let value = frozen.angle[1_000];
        frozen.angle[1_000..1_080].fill(value);
        assert_eq!(found(&frozen, Channel::Angle), [(1_001, 79)]);
        // A rest that ends without a step is a rest.
        let mut rest = steps(0.01);
        let value = rest.angle[999];
        rest.angle[920..999].fill(value);
        assert_eq!(found(&rest, Channel::Angle), []);
        // So is one of a converter that does not show the noise.
        let mut coarse = steps(0.001);
        for angle in &mut coarse.angle {
            *angle = (*angle / 0.02).round() * 0.02;
        }
        assert_eq!(found(&coarse, Channel::Angle), []);
    }

    #[test]
    fn a_channel_slower_than_its_rows_is_sampled_where_it_changes() {
        let even = |values: &[f64], held: usize| -> Vec<f64> {
            (0..values.len()).map(|k| values[k / held * held]).collect()
        };
        let mut held = steps(0.01);
        held.pressure = even(&held.pressure, 2);
        held.angle = even(&held.angle, 2);
        let clean = cleaned(&held).unwrap();
        assert_eq!((clean.len(), clean.removed.len()), (1_500, 0));
        assert_eq!(clean.left_out[0].count, 1_500);
        // A converter repeats values, and the logger each of them.
        let mut coarse = steps(0.01);
        coarse.angle = coarse
            .angle
            .iter()
            .map(|it| (it / 0.01).round() * 0.01)
            .collect();
        for channel in [&mut coarse.pressure, &mut coarse.angle] {
            *channel = even(channel, 2);
        }
        assert_eq!(cleaned(&coarse).unwrap().len(), 1_500);
        let mut slow = steps(0.01);
        slow.angle = even(&slow.angle, 5);
        let clean = cleaned(&slow).unwrap();
        assert_eq!(clean.measured(Channel::Angle).0.len(), 600);
        assert_eq!(clean.measured(Channel::Pressure).0.len(), 3_000);
    }

    #[test]
    fn a_channel_that_is_mostly_impossible_is_refused_with_its_lines() {
        let mut wild = steps(0.01);
        for sample in (1..3_000).step_by(15) {
            wild.angle[sample] = 99.0;
        }
        let refused = cleaned(&wild).unwrap_err().to_string();
        assert!(
            refused.contains("200 of 3000 samples of the angle"),
            "{refused}"
        );
        assert!(refused.contains("sample 2"), "{refused}");
    }
}
