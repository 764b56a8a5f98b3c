//! Makes a clock that can be trusted of the times in a file.
//!
//! A model is integrated along the times, so a wrong clock is a wrong model. Yet what a file holds
//! is often not when a sample was taken: a computer stamps rows when they arrive, and a serial
//! buffer delivers ten at once; a logger stamps whole seconds; a counter of 32 or 16 bits begins
//! again; a board is reset; a buffer is written twice. Each of these leaves a pattern that no
//! sampling leaves, and only where that pattern is there the times are changed ([`mend`]). Times
//! that are uneven in another way are left alone: they may be exact.

use std::collections::HashMap;
use std::ops::Range;

use statrs::statistics::{Data, OrderStatistics};

use crate::left_out::What;
use crate::recording::pause_s;

/// A time that goes on after an overflow, or follows a lost row, is later by at most this many
/// usual intervals.
const FOLLOWS: f64 = 10.0;
/// Rows up to this far from where they belong are out of order; farther, it is another run.
const UNSORTED: usize = 100;
/// Fewest samples a run, on average, of a file in which the clock begins again: shorter runs show
/// no motion.
const FEWEST_A_RUN: usize = 20;
/// Largest share of rows whose time fits nowhere.
const MISFITS: f64 = 0.05;

/// Steps below this share of the mean one are rows that arrive together.
const TOGETHER: f64 = 0.2;
/// Share of such steps from which rows arrive in bursts.
const MOST_TOGETHER: f64 = 0.5;
/// Fewest bursts that show a pattern.
const FEWEST_BURSTS: usize = 8;
/// Longest time between bursts (s): what computers buffer. Longer pauses are pauses.
const LONGEST_BUFFERED_S: f64 = 5.0;
/// Between bursts a motion goes on as within them; in pauses it goes farther, by at least this
/// factor.
const FARTHER: f64 = 2.0;
/// Share of steps without any time from which the stamps are coarser than the sampling.
const COARSE: f64 = 0.01;
/// Rows with the same time, on average, from which equal rows are a sensor at rest, not copies.
const MANY_AT_A_TIME: f64 = 4.0;

/// Share of rows with the time of the row before that may differ from it where rows are copied.
const DIFFERENT: f64 = 0.05;

/// Fewest samples that show whether stamps scatter about an even clock.
const FEWEST_STAMPS: usize = 100;
/// Samples over which the interval of that clock is taken, and how often it is refined.
const WINDOW: usize = 40;
const PASSES: usize = 4;
/// Standard deviation of such stamps, in intervals: below it does not matter, above it rows
/// cannot be told apart.
const SCATTER: Range<f64> = 0.05..0.45;
/// Correlation of successive intervals: −0.5 where each stamp is off by itself.
const ALTERNATES: Range<f64> = -0.75..-0.3;
/// Correlation of successive stamps' errors: none where each stamp is off by itself.
const INDEPENDENT: f64 = 0.3;
/// How sure it is that the motion is smoother along the even clock, in standard deviations.
const SURE: f64 = 5.0;

/// Columns that count samples, in lower case.
const COUNTERS: [&str; 12] = [
    "seq",
    "sample",
    "samples",
    "index",
    "idx",
    "count",
    "counter",
    "n",
    "nr",
    "no",
    "sample_id",
    "packet",
];

/// Whether a column is called as one that counts the samples.
pub(crate) fn is_counter(name: &str) -> bool {
    COUNTERS.contains(&name.trim().to_lowercase().as_str())
}

/// The rows of a file, before their times are examined.
pub(crate) struct Rows<'a> {
    /// Times (s).
    pub time: &'a [f64],
    /// The measured motion, in any unit.
    pub angle: &'a [f64],
    /// Whether two rows hold the same in all columns.
    pub same: &'a dyn Fn(usize, usize) -> bool,
    /// The column that counts the samples.
    pub counter: Option<&'a [f64]>,
    /// The unit of the times (s).
    pub unit_s: f64,
    /// Whether the times are times of the day.
    pub of_day: bool,
}

/// What is said about some rows.
pub(crate) struct Said {
    pub what: What,
    pub rows: Vec<usize>,
    pub text: String,
}

/// Rows with a clock that can be trusted.
pub(crate) struct Mended {
    /// The rows that are kept, in their order.
    pub rows: Vec<usize>,
    /// Their times (s), strictly increasing.
    pub time: Vec<f64>,
    /// Their times as in the file (s), if those were reconstructed.
    pub stamps: Option<Vec<f64>>,
    /// Places among them at which the clock begins again.
    pub breaks: Vec<usize>,
    /// What was done.
    pub said: Vec<Said>,
}

/// A row whose time does not follow, in a file that has no order.
pub(crate) struct Disorder(pub usize);

/// Looks for the patterns, and mends the clock; none where there is nothing to mend.
///
/// | pattern | what becomes of it |
/// |---|---|
/// | rows that repeat rows before them, also whole blocks | left out |
/// | one row whose time fits to neither neighbour | left out |
/// | rows a few places from where they belong | sorted |
/// | time falls by 2¹⁶ or 2³² of a unit, or by a day | unwrapped |
/// | time falls otherwise | a [break](crate::recording::Recording::breaks) |
/// | most rows arrive together with others | line through the last stamp of each burst |
/// | many rows have the same time | line through the first row of each time |
/// | stamps scatter about an even clock, and the motion is smoother along that clock | that clock |
///
/// The last pattern would also fit to a timer whose late samples are stamped right, so there the
/// motion decides.
pub(crate) fn mend(rows: &Rows) -> Result<Option<Mended>, Disorder> {
    let usual = usual_step(rows.time);
    if usual <= 0.0 && rows.time.len() > 1 {
        return Err(Disorder(1));
    }
    let mut ordered = Ordered::of(rows, usual)?;
    let mut rebuilt = Rebuilt::default();
    let ends = ordered.breaks.iter().copied().chain([ordered.rows.len()]);
    let mut begin = 0;
    let mut time = ordered.time.clone();
    for end in ends {
        rebuilt.session(rows, &ordered, begin..end, &mut time);
        begin = end;
    }
    if ordered.said.is_empty() && rebuilt.is_empty() {
        return Ok(None);
    }
    let is_rebuilt = !rebuilt.is_empty();
    ordered.said.extend(rebuilt.said(&ordered.rows));
    strictly(&mut time, usual);
    Ok(Some(Mended {
        stamps: is_rebuilt.then_some(ordered.time),
        rows: ordered.rows,
        time,
        breaks: ordered.breaks,
        said: ordered.said,
    }))
}

/// Keeps times apart that a line brought together.
fn strictly(time: &mut [f64], usual: f64) {
    let least = (1e-3 * usual).max(1e-9);
    for k in 1..time.len() {
        if time[k] <= time[k - 1] {
            time[k] = time[k - 1] + least;
        }
    }
}

/// The median of some numbers; zero if there are none.
fn median(values: Vec<f64>) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    Data::new(values).median()
}

/// The median step forwards.
fn usual_step(time: &[f64]) -> f64 {
    let steps = time.windows(2).map(|pair| pair[1] - pair[0]);
    median(steps.filter(|step| *step > 0.0).collect())
}

/// Rows whose times do not decrease.
struct Ordered {
    rows: Vec<usize>,
    time: Vec<f64>,
    breaks: Vec<usize>,
    said: Vec<Said>,
}

/// What was found row by row.
#[derive(Default)]
struct Finds {
    copies: Vec<usize>,
    misfits: Vec<usize>,
    unsorted: Vec<usize>,
    wraps: HashMap<&'static str, Vec<usize>>,
    restarts: Vec<usize>,
}

impl Ordered {
    fn of(rows: &Rows, usual: f64) -> Result<Self, Disorder> {
        let raw = rows.time;
        let periods = periods(rows, usual);
        let has_copies = has_copies(rows);
        let mut all = Self {
            rows: Vec::with_capacity(raw.len()),
            time: Vec::with_capacity(raw.len()),
            breaks: Vec::new(),
            said: Vec::new(),
        };
        let mut finds = Finds::default();
        let (mut offset, mut begin, mut at) = (0.0, 0, 0);
        while at < raw.len() {
            let now = raw[at] + offset;
            let next = raw.get(at + 1).map(|next| next + offset);
            let Some(&last) = all.time.last() else {
                all.push(at, now);
                at += 1;
                continue;
            };
            let near = |time: f64| time > last && time - last <= FOLLOWS * usual;
            if now > last {
                // One that is far ahead, while the next row is not.
                if now - last > FOLLOWS * usual && next.is_some_and(|next| next < now && near(next))
                {
                    finds.misfits.push(at);
                } else {
                    all.push(at, now);
                }
                at += 1;
                continue;
            }
            let back = raw[at..].iter().take_while(|raw| **raw + offset <= last);
            let back = at..at + back.count();
            if has_copies
                && back
                    .clone()
                    .all(|row| all.holds(begin, row, raw[row] + offset, rows))
            {
                finds.copies.extend(back.clone());
                at = back.end;
            } else if now >= last {
                all.push(at, now);
                at += 1;
            } else if let Some((period, name)) = periods.iter().find(|(period, _)| {
                let passed = raw[at] + period - (last - offset);
                let follows = passed > 0.0 && passed <= FOLLOWS * usual;
                follows && (rows.of_day || begins_again(raw[at], *period, usual))
            }) {
                finds.wraps.entry(name).or_default().push(at);
                offset += period;
                all.push(at, raw[at] + offset);
                at += 1;
            } else if all.sort_in(begin, raw, back.clone(), offset, usual) {
                finds.unsorted.extend(back.clone());
                at = back.end;
            } else if next.is_some_and(near) {
                finds.misfits.push(at);
                at += 1;
            } else {
                finds.restarts.push(at);
                offset = last + pause_s(usual) - raw[at];
                begin = all.rows.len();
                all.breaks.push(begin);
                all.push(at, raw[at] + offset);
                at += 1;
            }
        }
        finds.check(raw.len())?;
        all.said = finds.said();
        Ok(all)
    }

    fn push(&mut self, row: usize, time: f64) {
        self.rows.push(row);
        self.time.push(time);
    }

    /// Whether a kept row of this run has the same time and holds the same.
    fn holds(&self, begin: usize, row: usize, time: f64, rows: &Rows) -> bool {
        let known = &self.time[begin..];
        let from = begin + known.partition_point(|known| *known < time);
        let equal = self.time[from..].iter().take_while(|known| **known <= time);
        (from..from + equal.count()).any(|at| (rows.same)(self.rows[at], row))
    }

    /// Puts rows where they belong, if that is near and leaves the clock even.
    fn sort_in(
        &mut self,
        begin: usize,
        raw: &[f64],
        back: Range<usize>,
        offset: f64,
        usual: f64,
    ) -> bool {
        let is_last = back.end == raw.len();
        let catches_up = raw
            .get(back.end)
            .is_some_and(|raw| raw + offset - self.time[self.time.len() - 1] <= FOLLOWS * usual);
        let first = back
            .clone()
            .map(|row| raw[row] + offset)
            .fold(f64::INFINITY, f64::min);
        let from = begin + self.time[begin..].partition_point(|known| *known < first);
        let displaced = self.time.len() - from;
        if !(is_last || catches_up) || from == begin || displaced + back.len() > UNSORTED {
            return false;
        }
        let mut merged: Vec<(f64, usize)> = self.time[from - 1..]
            .iter()
            .copied()
            .zip(self.rows[from - 1..].iter().copied())
            .chain(back.clone().map(|row| (raw[row] + offset, row)))
            .collect();
        merged.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Two runs, one in the other, leave no even clock, nor does a wrong time between two rows
        // that follow each other.
        let least = if back.len() == 1 { 0.7 } else { 0.4 };
        let even = |pair: &[(f64, usize)]| pair[1].0 - pair[0].0 > least * usual;
        if !merged.windows(2).all(even) {
            return false;
        }
        self.time.truncate(from - 1);
        self.rows.truncate(from - 1);
        for (time, row) in merged {
            self.push(row, time);
        }
        true
    }
}

impl Finds {
    /// Refuses what has no order.
    fn check(&self, count: usize) -> Result<(), Disorder> {
        let lost = (self.misfits.len() + self.unsorted.len()) as f64;
        let runs = self.restarts.len() + 1;
        if let (Some(&first), true) = (
            self.misfits.iter().chain(&self.unsorted).min(),
            lost > MISFITS * count as f64,
        ) {
            return Err(Disorder(first));
        }
        match self.restarts.first() {
            Some(&first) if count < FEWEST_A_RUN * runs => Err(Disorder(first)),
            _ => Ok(()),
        }
    }

    fn said(self) -> Vec<Said> {
        let mut said: Vec<Said> = self
            .wraps
            .into_iter()
            .map(|(name, rows)| Said {
                what: What::Wrap,
                rows,
                text: format!("{name}; the time goes on across it"),
            })
            .collect();
        let kinds = [
            (
                What::DuplicateRow,
                self.copies,
                "identical in all columns, and left out",
            ),
            (
                What::MisplacedTime,
                self.misfits,
                "left out; the rows before and after follow each other",
            ),
            (What::Unsorted, self.unsorted, "sorted by their time"),
            (
                What::Restart,
                self.restarts,
                "as after a board reset; the rest is a separate run with its own initial state",
            ),
        ];
        for (what, rows, text) in kinds {
            if !rows.is_empty() {
                let text = text.to_owned();
                said.push(Said { what, rows, text });
            }
        }
        said
    }
}

/// Whether equal rows are copies: not where a sensor at rest is read many times in the same tick
/// of a coarse clock, nor where other rows with the same time differ.
fn has_copies(rows: &Rows) -> bool {
    let ticks = rows.time.chunk_by(|a, b| a.total_cmp(b).is_eq());
    let shared: Vec<usize> = ticks.map(<[f64]>::len).filter(|count| *count > 1).collect();
    let total: usize = shared.iter().sum();
    let repeats = total - shared.len();
    let differ = (1..rows.time.len())
        .filter(|k| rows.time[*k].total_cmp(&rows.time[*k - 1]).is_eq())
        .filter(|k| !(rows.same)(*k - 1, *k))
        .count();
    (total as f64) < MANY_AT_A_TIME * shared.len().max(1) as f64
        && differ as f64 <= DIFFERENT * repeats as f64
}

/// The periods (s) after which a counter that holds the time begins again.
fn periods(rows: &Rows, usual: f64) -> Vec<(f64, &'static str)> {
    let (long, short) = (2f64.powi(32), 2f64.powi(16));
    let mut periods = vec![
        (
            long * 1e-6,
            "micros() holds 32 bits and begins again after 71.6 min (2^32 µs)",
        ),
        (
            long * 1e-3,
            "millis() holds 32 bits and begins again after 49.7 days (2^32 ms)",
        ),
        (long * rows.unit_s, "the counter has 32 bits"),
        (short * 1e-3, "the counter has 16 bits (2^16 ms)"),
        (short * rows.unit_s, "the counter has 16 bits"),
        (short * 1e-6, "the counter has 16 bits (2^16 µs)"),
        (86_400.0, "the time of the day passes midnight"),
    ];
    if rows.of_day {
        periods.push((43_200.0, "the clock shows twelve hours"));
        periods.push((3_600.0, "the clock shows minutes and no hours"));
    }
    // Within a few samples nothing tells an overflow from anything else.
    periods.retain(|(period, _)| *period > 2.0 * FOLLOWS * usual);
    periods
}

/// Whether a counter with this period may have begun at a time.
fn begins_again(now: f64, period: f64, usual: f64) -> bool {
    // One without a sign begins at zero, one with a sign at minus half the period.
    [0.0, -period / 2.0]
        .iter()
        .any(|begin| (now - begin).rem_euclid(period) <= FOLLOWS * usual)
}

/// The times that are reconstructed.
#[derive(Default)]
struct Rebuilt {
    bursts: Pattern,
    coarse: Pattern,
    scattered: Pattern,
    ties: Vec<usize>,
}

/// Samples whose times follow the same pattern, and the interval (s) and group that it has.
#[derive(Default)]
struct Pattern {
    samples: Vec<usize>,
    interval: f64,
    together: f64,
}

impl Rebuilt {
    fn is_empty(&self) -> bool {
        let patterns = [&self.bursts, &self.coarse, &self.scattered];
        patterns.iter().all(|pattern| pattern.samples.is_empty()) && self.ties.is_empty()
    }

    /// Looks at one run, and replaces its times.
    fn session(&mut self, rows: &Rows, ordered: &Ordered, range: Range<usize>, time: &mut [f64]) {
        let stamps = &ordered.time[range.clone()];
        let angle: Vec<f64> = ordered.rows[range.clone()]
            .iter()
            .map(|row| rows.angle[*row])
            .collect();
        let counter: Option<Vec<f64>> = rows.counter.and_then(|counter| {
            let counts: Vec<f64> = ordered.rows[range.clone()]
                .iter()
                .map(|row| counter[*row])
                .collect();
            counts.windows(2).all(|it| it[1] > it[0]).then_some(counts)
        });
        let place = counter.unwrap_or_else(|| (0..stamps.len()).map(|k| k as f64).collect());
        let shares_tick = stamps.windows(2).filter(|pair| pair[1] <= pair[0]).count();
        let (pattern, found) = if shares_tick as f64 > COARSE * stamps.len() as f64 {
            (&mut self.coarse, of_ticks(stamps, &place))
        } else if let Some(found) = of_bursts(stamps, &place, &angle) {
            (&mut self.bursts, Some(found))
        } else {
            (&mut self.scattered, of_scatter(stamps, &angle))
        };
        if let Some(line) = found {
            pattern.samples.extend(range.clone());
            pattern.interval = line.interval;
            pattern.together = line.together;
            time[range].copy_from_slice(&line.time);
            return;
        }
        // A few rows with the time of the one before them.
        for k in range.start + 1..range.end {
            if ordered.time[k] <= time[k - 1] {
                let first = k - 1;
                let next = ordered.time[k..range.end]
                    .iter()
                    .position(|time| *time > ordered.time[first])
                    .map_or(range.end, |ahead| k + ahead);
                let until = ordered
                    .time
                    .get(next)
                    .filter(|_| next < range.end)
                    .copied()
                    .unwrap_or(time[first] + (next - first) as f64 * usual_step(stamps));
                let step = (until - time[first]) / (next - first) as f64;
                time[k] = time[first] + step;
                self.ties.push(k);
            }
        }
    }

    fn said(&self, rows: &[usize]) -> Vec<Said> {
        let one = |samples: &[usize], text: String| Said {
            what: What::RebuiltClock,
            rows: samples.iter().map(|sample| rows[*sample]).collect(),
            text,
        };
        let even = |interval: f64| {
            format!(
                "the samples are taken to be {} ms apart, and the recorded times are kept",
                crate::numbers::short(1e3 * interval)
            )
        };
        let mut said = Vec::new();
        let Self {
            bursts,
            coarse,
            scattered,
            ..
        } = self;
        for (pattern, how) in [
            (
                bursts,
                format!("rows arrive in bursts of about {:.0}", bursts.together),
            ),
            (
                coarse,
                format!(
                    "the clock is coarser than the sampling, with {} rows at the same time",
                    crate::numbers::short(coarse.together)
                ),
            ),
            (
                scattered,
                format!(
                    "they jitter about an even clock by {:.0} % of its interval, and the motion is smoother on that clock",
                    100.0 * scattered.together
                ),
            ),
        ] {
            if !pattern.samples.is_empty() {
                let text = format!("{how}; {}", even(pattern.interval));
                said.push(one(&pattern.samples, text));
            }
        }
        if !self.ties.is_empty() {
            said.push(one(
                &self.ties,
                "equal to the previous one, with other values; placed between neighbours"
                    .to_owned(),
            ));
        }
        said
    }
}

/// Times along a line, its interval (s), and what the pattern has: rows together, or the standard
/// deviation of the stamps in intervals.
struct Line {
    time: Vec<f64>,
    interval: f64,
    together: f64,
}

/// Stamps of a clock that is coarser than the sampling: the first row of each tick is just behind
/// it.
fn of_ticks(stamps: &[f64], place: &[f64]) -> Option<Line> {
    let firsts: Vec<usize> = (1..stamps.len())
        .filter(|k| stamps[*k] > stamps[*k - 1])
        .collect();
    let together = stamps.len() as f64 / (firsts.len() + 1) as f64;
    along(stamps, place, &firsts, together)
}

/// Stamps of rows that arrive together: the last row of each burst is the freshest.
fn of_bursts(stamps: &[f64], place: &[f64], angle: &[f64]) -> Option<Line> {
    let count = stamps.len();
    if count < 2 * FEWEST_BURSTS {
        return None;
    }
    // A mean that pauses do not lift.
    let steps: Vec<f64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let step_of = |steps: &[f64]| steps.iter().sum::<f64>() / steps.len().max(1) as f64;
    let mean = {
        let cap = FOLLOWS * step_of(&steps);
        step_of(&steps.iter().map(|step| step.min(cap)).collect::<Vec<_>>())
    };
    let is_together = |step: &f64| *step < TOGETHER * mean;
    let together = steps.iter().filter(|step| is_together(step)).count();
    if (together as f64) < MOST_TOGETHER * steps.len() as f64 {
        return None;
    }
    let lasts: Vec<usize> = (0..count)
        .filter(|k| steps.get(*k).is_none_or(|step| !is_together(step)))
        .collect();
    if lasts.len() < FEWEST_BURSTS {
        return None;
    }
    let cycles = lasts
        .windows(2)
        .map(|pair| stamps[pair[1]] - stamps[pair[0]]);
    let cycle = median(cycles.collect());
    let lengths = lasts
        .windows(2)
        .map(|pair| stamps[pair[1]] - stamps[pair[0] + 1]);
    if cycle > LONGEST_BUFFERED_S || median(lengths.collect()) > 0.3 * cycle {
        return None;
    }
    // How far the motion goes from row to row, within bursts and between them.
    let moves = |is_within: bool| {
        let steps = steps.iter().zip(angle.windows(2));
        let all: Vec<f64> = steps
            .filter(|(step, _)| is_together(step) == is_within)
            .map(|(_, pair)| (pair[1] - pair[0]).abs())
            .collect();
        // One impossible value is no motion.
        let most = FOLLOWS * median(all.clone()).max(step_of(&all) / FOLLOWS);
        step_of(&all.iter().map(|it| it.min(most)).collect::<Vec<_>>())
    };
    if moves(false) > FARTHER * moves(true) {
        return None;
    }
    along(stamps, place, &lasts, count as f64 / lasts.len() as f64)
}

/// Even times through some of the stamps, anew where rows are missing.
fn along(stamps: &[f64], place: &[f64], anchors: &[usize], together: f64) -> Option<Line> {
    if anchors.len() < 2 {
        return None;
    }
    let slope = |a: usize, b: usize| (stamps[b] - stamps[a]) / (place[b] - place[a]);
    let pairs = || anchors.windows(2).map(|pair| (pair[0], pair[1]));
    let first_guess = median(pairs().map(|(a, b)| slope(a, b)).collect());
    let cycle = median(pairs().map(|(a, b)| stamps[b] - stamps[a]).collect());
    let is_gap = |a: usize, b: usize| {
        stamps[b] - stamps[a] - first_guess * (place[b] - place[a]) > 1.5 * cycle
    };
    let parts: Vec<&[usize]> = anchors.chunk_by(|a, b| !is_gap(*a, *b)).collect();
    // The slope over half of a part does not see how the single stamps scatter.
    let slopes: Vec<f64> = parts
        .iter()
        .flat_map(|part| {
            let half = (part.len() / 2).max(1);
            (half..part.len()).map(move |k| slope(part[k - half], part[k]))
        })
        .collect();
    let interval = match median(slopes) {
        slope if slope > 0.0 => slope,
        _ => first_guess,
    };
    if interval <= 0.0 {
        return None;
    }
    let mut time = vec![0.0; stamps.len()];
    let mut begin = 0;
    for (number, part) in parts.iter().enumerate() {
        // Rows between two parts belong to the later one: what is missing is missing before them.
        let end = match parts.get(number + 1) {
            Some(_) => part[part.len() - 1] + 1,
            None => stamps.len(),
        };
        let offset = |k: usize| stamps[k] - interval * place[k];
        let residuals: Vec<f64> = part.iter().map(|k| offset(*k)).collect();
        let level = median(residuals.clone());
        let off = median(residuals.iter().map(|it| (it - level).abs()).collect());
        if off <= cycle {
            for k in begin..end {
                time[k] = level + interval * place[k];
            }
        } else {
            // No single line: from anchor to anchor.
            let mut next = 0;
            for k in begin..end {
                while next + 2 < part.len() && part[next + 1] < k {
                    next += 1;
                }
                let (a, b) = match part {
                    [one] => (*one, *one),
                    _ => (part[next], part[next + 1]),
                };
                let rate = if a == b { interval } else { slope(a, b) };
                time[k] = stamps[a] + rate * (place[k] - place[a]);
            }
        }
        begin = end;
    }
    Some(Line {
        time,
        interval,
        together,
    })
}

/// Stamps that scatter about an even clock along which the motion is smoother.
fn of_scatter(stamps: &[f64], angle: &[f64]) -> Option<Line> {
    let count = stamps.len();
    if count < FEWEST_STAMPS {
        return None;
    }
    // Missing rows lengthen the usual step a little; what the places tell does not.
    let mut interval = usual_step(stamps);
    let mut places = vec![0.0; count];
    for _ in 0..PASSES {
        follow(stamps, interval, &mut places);
        let slopes = (WINDOW..count).map(|k| {
            let before = k - WINDOW;
            (stamps[k] - stamps[before]) / (places[k] - places[before])
        });
        interval = median(slopes.collect());
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_place, mean_stamp) = (mean(&places), mean(stamps));
    let products = places.iter().zip(stamps);
    let covariance: f64 = products
        .map(|(place, stamp)| (place - mean_place) * (stamp - mean_stamp))
        .sum();
    let variance: f64 = places.iter().map(|it| (it - mean_place).powi(2)).sum();
    let interval = covariance / variance;
    let time: Vec<f64> = places
        .iter()
        .map(|place| mean_stamp + interval * (place - mean_place))
        .collect();
    let errors: Vec<f64> = stamps.iter().zip(&time).map(|(a, b)| a - b).collect();
    let scatter = (mean(&errors.iter().map(|it| it * it).collect::<Vec<_>>())).sqrt() / interval;
    let next_to = |values: &[f64]| {
        let product: f64 = values.windows(2).map(|it| it[0] * it[1]).sum();
        product / values.iter().map(|it| it * it).sum::<f64>()
    };
    let uneven: Vec<f64> = errors.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let is_pattern = SCATTER.contains(&scatter)
        && ALTERNATES.contains(&next_to(&uneven))
        && next_to(&errors).abs() < INDEPENDENT;
    (is_pattern && is_smoother(angle, &time, stamps)).then_some(Line {
        time,
        interval,
        together: scatter,
    })
}

/// The place of each stamp on an even clock, followed as it drifts.
fn follow(stamps: &[f64], interval: f64, places: &mut [f64]) {
    /// Share of each error by which the clock is corrected.
    const CORRECTED: f64 = 0.05;
    let (mut expected, mut place) = (stamps[0], 0.0);
    for (stamp, at) in stamps.iter().zip(places).skip(1) {
        let ahead = ((stamp - expected) / interval).round().max(1.0);
        place += ahead;
        *at = place;
        expected += ahead * interval;
        expected += CORRECTED * (stamp - expected);
    }
}

/// Whether a motion is smoother along one clock than along another: where it is fast, the samples
/// beside a sample tell it better.
fn is_smoother(values: &[f64], clock: &[f64], other: &[f64]) -> bool {
    let missed = |clock: &[f64], k: usize| {
        let at = [k - 2, k - 1, k + 1, k + 2];
        let told: f64 = at
            .iter()
            .map(|i| {
                let rest = at.iter().filter(|j| *j != i);
                let weight: f64 = rest
                    .map(|j| (clock[k] - clock[*j]) / (clock[*i] - clock[*j]))
                    .product();
                weight * values[*i]
            })
            .sum();
        (values[k] - told).abs()
    };
    let speed = |k: usize| (values[k + 2] - values[k - 2]).abs();
    let places = 2..values.len() - 2;
    let fast = Data::new(places.clone().map(speed).collect::<Vec<_>>()).upper_quartile();
    let compared: Vec<bool> = places
        .filter(|k| speed(*k) >= fast && fast > 0.0)
        .map(|k| (missed(clock, k), missed(other, k)))
        .filter(|(a, b)| a.is_finite() && b.is_finite() && (a - b).abs() > 0.0)
        .map(|(a, b)| a < b)
        .collect();
    let count = compared.len() as f64;
    let better = compared.iter().filter(|it| **it).count() as f64;
    better - count / 2.0 > SURE * (count / 4.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 0 to 1 that look random.
    fn random(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / 2f64.powi(53)
        }
    }

    /// A swinging motion (°) at some times, as a sensor with a little noise sees it.
    fn motion(time: &[f64]) -> Vec<f64> {
        let mut noise = random(3);
        let angle = |t: &f64| 30.0 * (2.0 * t).sin() + 0.05 * (noise() - 0.5);
        time.iter().map(angle).collect()
    }

    fn even(count: usize, interval: f64) -> Vec<f64> {
        (0..count).map(|k| interval * k as f64).collect()
    }

    fn mended(time: &[f64], angle: &[f64], unit_s: f64, of_day: bool) -> Option<Mended> {
        let same = |a: usize, b: usize| angle[a].total_cmp(&angle[b]).is_eq();
        let rows = Rows {
            time,
            angle,
            same: &same,
            counter: None,
            unit_s,
            of_day,
        };
        mend(&rows).ok().flatten()
    }

    fn kinds(mended: &Mended) -> Vec<What> {
        mended.said.iter().map(|said| said.what).collect()
    }

    /// The largest distance of two clocks, which may be apart by a constant.
    fn apart(found: &[f64], truth: &[f64]) -> f64 {
        let off: Vec<f64> = found.iter().zip(truth).map(|(a, b)| a - b).collect();
        let level = median(off.clone());
        off.iter().map(|it| (it - level).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn clocks_without_a_pattern_are_left_alone() {
        let mut draw = random(1);
        let mut sum = 0.0;
        let walk: Vec<f64> = (0..2_000)
            .map(|_| {
                sum += 0.01 * (0.7 + 0.6 * draw());
                sum
            })
            .collect();
        let mut poisson = even(2_000, 0.01);
        poisson.retain(|_| draw() > 0.33);
        // A timer whose late samples are stamped right.
        let timer: Vec<f64> = even(2_000, 0.01)
            .iter()
            .map(|t| t + 0.004 * draw())
            .collect();
        // Fifty samples, then a pause.
        let pauses: Vec<f64> = (0..2_000)
            .map(|k| 0.01 * f64::from(k) + 3.0 * f64::from(k / 50))
            .collect();
        // Small steps where a solver has to work.
        let mut solver = vec![0.0];
        for k in 0..2_000 {
            let last: f64 = solver[k];
            solver.push(last + if last.fract() < 0.1 { 2e-4 } else { 0.02 });
        }
        for (name, time) in [
            ("even", even(2_000, 0.01)),
            ("walk", walk),
            ("missing", poisson),
            ("timer", timer),
            ("pauses", pauses),
            ("solver", solver),
        ] {
            let found = mended(&time, &motion(&time), 1.0, false);
            assert!(found.is_none(), "{name}: {:?}", found.map(|it| kinds(&it)));
        }
    }

    #[test]
    fn copies_of_rows_and_blocks_are_left_out() {
        let truth = even(500, 0.02);
        let angle = motion(&truth);
        let rows: Vec<usize> = (0..60)
            .chain(50..60)
            .chain(60..200)
            .chain([199])
            .chain(200..500)
            .collect();
        let pick = |values: &[f64]| -> Vec<f64> { rows.iter().map(|row| values[*row]).collect() };
        let found = mended(&pick(&truth), &pick(&angle), 1.0, false).unwrap();
        assert_eq!(kinds(&found), [What::DuplicateRow]);
        assert_eq!(found.said[0].rows.len(), 11);
        assert_eq!(found.time, truth);
        assert!(found.stamps.is_none() && found.breaks.is_empty());
    }

    #[test]
    fn counters_and_days_that_begin_again_are_unwrapped() {
        for (period, start, unit, of_day) in [
            (2f64.powi(32) * 1e-6, 0.0, 1e-6, false),
            (2f64.powi(32) * 1e-6, 0.0, 1.0, false),
            (2f64.powi(32) * 1e-6, -2f64.powi(31) * 1e-6, 1e-6, false),
            (2f64.powi(32) * 1e-3, 0.0, 1e-3, false),
            (65.536, 0.0, 1e-3, false),
            (65.536, -32.768, 1e-3, false),
            (86_400.0, 0.0, 1.0, true),
            (43_200.0, 3_600.0, 1.0, true),
        ] {
            let truth: Vec<f64> = even(8_000, 0.02)
                .iter()
                .map(|t| start + period - 5.0 + t)
                .collect();
            let written: Vec<f64> = truth
                .iter()
                .map(|t| start + (t - start).rem_euclid(period))
                .collect();
            let found = mended(&written, &motion(&truth), unit, of_day).unwrap();
            assert!(kinds(&found).iter().all(|what| *what == What::Wrap));
            assert!(apart(&found.time, &truth) < 1e-6, "{period}");
            assert!(found.breaks.is_empty());
        }
    }

    #[test]
    fn a_clock_that_begins_again_is_another_run() {
        let mut time = even(400, 0.02);
        time.extend(even(300, 0.02).iter().map(|t| t + 0.35));
        let found = mended(&time, &motion(&time), 1.0, false).unwrap();
        assert_eq!(kinds(&found), [What::Restart]);
        assert_eq!(found.breaks, [400]);
        assert!(found.time.windows(2).all(|pair| pair[1] > pair[0]));
        let pause = found.time[400] - found.time[399];
        assert!((pause - pause_s(0.02)).abs() < 1e-9, "{pause}");
    }

    #[test]
    fn a_row_that_fits_nowhere_goes_and_neighbours_are_sorted() {
        let truth = even(400, 0.02);
        for wrong in [0.0, 1e5, 0.51] {
            let mut time = truth.clone();
            time[100] = wrong;
            let found = mended(&time, &motion(&truth), 1.0, false).unwrap();
            assert_eq!(kinds(&found), [What::MisplacedTime], "{wrong}");
            assert_eq!(found.said[0].rows, [100]);
            assert_eq!(found.rows.len(), 399);
        }
        // Five rows late, one row late by some, and neighbours exchanged.
        for (moved, by) in [(10, 5), (2, 1), (3, 1), (16, 1)] {
            let mut rows: Vec<usize> = (0..400).collect();
            rows[100..100 + moved].rotate_left(by);
            let time: Vec<f64> = rows.iter().map(|row| truth[*row]).collect();
            let found = mended(&time, &motion(&time), 1.0, false).unwrap();
            assert_eq!(kinds(&found), [What::Unsorted], "{moved} {by}");
            assert_eq!(found.time, truth);
        }
    }

    #[test]
    fn what_has_no_order_is_refused() {
        let mut draw = random(5);
        let time: Vec<f64> = (0..300).map(|_| draw()).collect();
        let angle = motion(&time);
        let same = |_: usize, _: usize| false;
        let rows = Rows {
            time: &time,
            angle: &angle,
            same: &same,
            counter: None,
            unit_s: 1.0,
            of_day: false,
        };
        assert!(mend(&rows).is_err());
    }

    #[test]
    fn bursts_become_even_also_across_gaps() {
        for (seed, together) in [(3, 3_usize), (5, 5), (40, 40)] {
            let mut draw = random(seed);
            let mut truth = even(2_000, 0.01);
            for time in &mut truth[1_200..] {
                *time += 7.0;
            }
            let stamp = |k: usize, late: f64| {
                let last = (k / together * together + together - 1).min(1_999);
                // A burst is delivered once its last row is there.
                truth[last] + 0.002 * late + 1e-4 * (k % together) as f64 * 0.1
            };
            let mut late = 0.0;
            let stamps: Vec<f64> = (0..2_000)
                .map(|k| {
                    if k % together == 0 {
                        late = draw();
                    }
                    stamp(k, late)
                })
                .collect();
            let found = mended(&stamps, &motion(&truth), 1.0, false).unwrap();
            assert_eq!(kinds(&found), [What::RebuiltClock]);
            let first = apart(
                &found.time[..1_200 / together * together],
                &truth[..1_200 / together * together],
            );
            assert!(first < 0.005, "{together}: {first}");
            assert_eq!(found.stamps.as_deref(), Some(&stamps[..]));
            let interval = usual_step(&found.time);
            assert!((interval / 0.01 - 1.0).abs() < 0.01, "{interval}");
        }
    }

    #[test]
    fn whole_seconds_become_even_and_a_sensor_at_rest_stays() {
        for tick in [1.0, 0.1, 0.012] {
            let truth: Vec<f64> = even(3_000, 0.01).iter().map(|t| t + 0.0037).collect();
            let stamps: Vec<f64> = truth.iter().map(|t| (t / tick).floor() * tick).collect();
            let mut angle = motion(&truth);
            angle[..1_500].fill(0.0);
            let found = mended(&stamps, &angle, 1.0, false).unwrap();
            assert_eq!(kinds(&found), [What::RebuiltClock], "{tick}");
            assert_eq!(found.rows.len(), 3_000);
            let apart = apart(&found.time, &truth);
            assert!(apart < 0.011, "{tick}: {apart}");
        }
    }

    #[test]
    fn stamps_that_scatter_are_put_right_where_the_motion_shows_it() {
        let truth = even(3_000, 0.02);
        let mut draw = random(9);
        let stamps: Vec<f64> = truth
            .iter()
            .map(|t| t + 0.02 * 0.6 * (draw() - 0.5))
            .collect();
        let found = mended(&stamps, &motion(&truth), 1.0, false).unwrap();
        assert_eq!(kinds(&found), [What::RebuiltClock]);
        assert!(apart(&found.time, &truth) < 0.001);
        // With values lost the places are still told.
        let kept: Vec<usize> = (0..3_000).filter(|_| draw() > 0.1).collect();
        let pick = |values: &[f64]| -> Vec<f64> { kept.iter().map(|k| values[*k]).collect() };
        let found = mended(&pick(&stamps), &pick(&motion(&truth)), 1.0, false).unwrap();
        assert!(apart(&found.time, &pick(&truth)) < 0.001);
    }

    #[test]
    fn a_counter_tells_which_rows_are_missing() {
        let mut draw = random(4);
        let kept: Vec<usize> = (0..2_000).filter(|_| draw() > 0.2).collect();
        let truth: Vec<f64> = kept.iter().map(|k| 0.01 * *k as f64).collect();
        let stamps: Vec<f64> = truth.iter().map(|t| t.floor()).collect();
        let counter: Vec<f64> = kept.iter().map(|k| *k as f64).collect();
        let angle = motion(&truth);
        let same = |_: usize, _: usize| false;
        let rows = Rows {
            time: &stamps,
            angle: &angle,
            same: &same,
            counter: Some(&counter),
            unit_s: 1.0,
            of_day: false,
        };
        let found = mend(&rows).ok().flatten().unwrap();
        assert!(apart(&found.time, &truth) < 0.011);
    }
}
