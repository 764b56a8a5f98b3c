//! What a recording has not in common with its file: left-out lines, a mended clock.
//!
//! Nothing is repaired silently. Each thing that was done is one [`LeftOut`], which terminal,
//! report and JSON show alike: how many, in which file, the first places, and how it is handled.

use std::fmt;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How many places of a kind are named.
pub const NAMED: usize = 3;

/// The kind of what was left out or changed.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum What {
    /// Lines that are no rows of the table.
    BadLine,
    /// Lines that repeat the header.
    RepeatedHeader,
    /// Rows that are there already.
    DuplicateRow,
    /// Places at which the clock begins again.
    Restart,
    /// Overflows of a counter that holds the time.
    Wrap,
    /// Rows whose time fits to no neighbour.
    MisplacedTime,
    /// Rows that do not stand in the order of time.
    Unsorted,
    /// Times that are not those at which the samples were taken.
    RebuiltClock,
    /// Pressures that cannot be.
    ImpossiblePressure,
    /// Angles that no motion reaches.
    ImpossibleAngle,
    /// Pressures that stay at one value to the last digit, without the noise of the others.
    FrozenPressure,
    /// Angles that do.
    FrozenAngle,
    /// Rows that only repeat the last one, because the sensors are slower than the rows.
    HeldRow,
    /// Pressures that only repeat the last one, because the sensor is slower than the rows.
    HeldPressure,
    /// Angles that do.
    HeldAngle,
}

impl What {
    /// One of it and several, as the subject of a sentence.
    fn words(self) -> [&'static str; 2] {
        match self {
            Self::BadLine => ["line is malformed", "lines are malformed"],
            Self::RepeatedHeader => ["line repeats the header", "lines repeat the header"],
            Self::DuplicateRow => ["row is there twice", "rows are there twice"],
            Self::Restart => [
                "time the clock begins again",
                "times the clock begins again",
            ],
            Self::Wrap => ["time the clock overflows", "times the clock overflows"],
            Self::MisplacedTime => [
                "row has an implausible time",
                "rows have an implausible time",
            ],
            Self::Unsorted => ["row is out of order", "rows are out of order"],
            Self::RebuiltClock => [
                "time does not match the sampling",
                "times do not match the sampling",
            ],
            Self::ImpossiblePressure => ["pressure is impossible", "pressures are impossible"],
            Self::ImpossibleAngle => ["angle is impossible", "angles are impossible"],
            Self::FrozenPressure => ["pressure is frozen", "pressures are frozen"],
            Self::FrozenAngle => ["angle is frozen", "angles are frozen"],
            Self::HeldRow => [
                "row only repeats the values of the last",
                "rows only repeat the values of the last",
            ],
            Self::HeldPressure => [
                "pressure only repeats the last",
                "pressures only repeat the last",
            ],
            Self::HeldAngle => ["angle only repeats the last", "angles only repeat the last"],
        }
    }
}

/// What was left out of a recording, or changed in it, by the same rule.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct LeftOut {
    /// Its kind.
    pub what: What,
    /// The file.
    pub file: String,
    /// How many.
    pub count: usize,
    /// The first of them, at most [`NAMED`]: `line 12`, `sample 12`.
    pub places: Vec<String>,
    /// How it is handled, and what the user may do: the end of the sentence.
    pub text: String,
}

impl LeftOut {
    /// Creates an entry for all `places` of a kind; it names the first of them.
    pub fn new(
        what: What,
        file: &Path,
        places: impl IntoIterator<Item = String>,
        text: impl Into<String>,
    ) -> Self {
        let mut places = places.into_iter();
        let named: Vec<String> = places.by_ref().take(NAMED).collect();
        Self {
            what,
            file: file.display().to_string(),
            count: named.len() + places.count(),
            places: named,
            text: text.into(),
        }
    }

    /// How many of what, and the first places.
    pub fn found(&self) -> String {
        let [one, several] = self.what.words();
        let words = if self.count == 1 { one } else { several };
        let rest = if self.count > self.places.len() {
            ", …"
        } else {
            ""
        };
        match self.places.as_slice() {
            [] => format!("{} {words}", self.count),
            places => format!("{} {words} ({}{rest})", self.count, places.join(", ")),
        }
    }
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}", self.file, self.found(), self.text)
    }
}

/// Where each sample stands in its file: the lines of a table of text, or numbers of samples.
///
/// Samples mostly stand on lines that follow each other, so only the beginnings of such runs are
/// kept.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Lines {
    /// First samples of runs, and their numbers in the file. In order, the first of sample 0;
    /// empty where sample `k` has number `k + 1`.
    runs: Vec<(usize, u64)>,
    is_text: bool,
}

impl Lines {
    /// The lines of a table of text.
    pub fn of(lines: impl IntoIterator<Item = u64>) -> Self {
        let mut all = Self {
            runs: Vec::new(),
            is_text: true,
        };
        for (sample, line) in lines.into_iter().enumerate() {
            all.push(sample, line);
        }
        all
    }

    /// The next sample's line.
    pub(crate) fn push(&mut self, sample: usize, line: u64) {
        self.is_text = true;
        let follows = self
            .runs
            .last()
            .is_some_and(|(first, number)| number + (sample - first) as u64 == line);
        if !follows {
            self.runs.push((sample, line));
        }
    }

    /// The number in the file of a sample, from 1.
    pub fn number(&self, sample: usize) -> u64 {
        let after = self.runs.partition_point(|(first, _)| *first <= sample);
        match after.checked_sub(1).map(|run| self.runs[run]) {
            Some((first, number)) => number + (sample - first) as u64,
            None => sample as u64 + 1,
        }
    }

    /// Whether they are lines of a text.
    pub fn is_text(&self) -> bool {
        self.is_text
    }

    /// The place of a sample, in words.
    pub fn place(&self, sample: usize) -> String {
        let what = if self.is_text { "line" } else { "sample" };
        format!("{what} {}", self.number(sample))
    }

    /// Those of the samples at these places, which are in order.
    pub fn pick(&self, samples: impl IntoIterator<Item = usize>) -> Self {
        let mut picked = Self::default();
        for (at, sample) in samples.into_iter().enumerate() {
            picked.push(at, self.number(sample));
        }
        Self {
            is_text: self.is_text,
            ..picked
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_survive_cuts() {
        let text = Lines::of([2, 3, 4, 7, 8, 12]);
        let lines = |lines: &Lines, count: usize| -> Vec<u64> {
            (0..count).map(|k| lines.number(k)).collect()
        };
        assert_eq!(lines(&text, 6), [2, 3, 4, 7, 8, 12]);
        assert_eq!(text.place(3), "line 7");
        let cut = text.pick(2..5);
        assert_eq!(lines(&cut, 3), [4, 7, 8]);
        assert_eq!(lines(&cut.pick(1..3), 2), [7, 8]);
        assert_eq!(lines(&text.pick([0, 3, 5]), 3), [2, 7, 12]);
        let samples = Lines::default();
        assert_eq!(samples.place(0), "sample 1");
        assert_eq!(samples.pick(10..20).place(2), "sample 13");
        assert_eq!(samples.pick([4, 6]).place(1), "sample 7");
    }

    #[test]
    fn a_thing_is_said_in_one_sentence() {
        let places = (5..9).map(|line| format!("line {line}"));
        let four = LeftOut::new(What::BadLine, Path::new("a.csv"), places, "left out");
        assert_eq!(
            four.to_string(),
            "a.csv: 4 lines are malformed (line 5, line 6, line 7, …): left out"
        );
        let one = LeftOut::new(What::Restart, Path::new("a.csv"), ["line 5".into()], "cut");
        assert_eq!(
            one.to_string(),
            "a.csv: 1 time the clock begins again (line 5): cut"
        );
        let json = serde_json::to_value(&four).unwrap();
        assert_eq!(json["what"], "bad_line");
        assert_eq!(json["count"], 4);
    }
}
