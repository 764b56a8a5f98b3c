//! Counts replies.

use std::collections::BTreeMap;

use serde::Serialize;

use super::answer::{Likeness, is_other_refit};
use super::ask::{Asked, CaseReplies, Reply, likeness};
use super::cases::CaseSet;
use super::known::{Grade, Labels};
use super::ways::Way;

/// How the answers to one way of asking compare with the plain ones.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Cases by how alike both answers are.
    pub by_likeness: BTreeMap<Likeness, usize>,
    /// Cases of which one of the two has no answer.
    pub no_answer: usize,
    /// All of these.
    pub of: usize,
    /// Cases that cannot be asked in this way; they are not among these.
    pub left_out: usize,
    /// Cases with both answers whose refits differ in error by more than 1 %.
    pub other_refit: usize,
}

impl Counts {
    fn of(cases: &[CaseReplies], way: Way) -> Self {
        let mut counts = Self::default();
        for (plain, other) in cases.iter().filter_map(|case| pair(case, way)) {
            if matches!(other.reply, Reply::LeftOut(_)) {
                counts.left_out += 1;
                continue;
            }
            counts.of += 1;
            match likeness(plain, way, other) {
                Some(likeness) => *counts.by_likeness.entry(likeness).or_default() += 1,
                None => counts.no_answer += 1,
            }
            counts.other_refit += usize::from(ratio(plain, other).is_some_and(is_other_refit));
        }
        counts
    }

    /// Cases that are so alike.
    pub fn count(&self, likeness: Likeness) -> usize {
        self.by_likeness.get(&likeness).copied().unwrap_or(0)
    }

    /// A count by the name of its column.
    pub fn named(&self, column: &str) -> Option<usize> {
        let likeness = Likeness::ALL.into_iter().find(|it| it.name() == column);
        match column {
            "no_answer" => Some(self.no_answer),
            "refit" => Some(self.other_refit),
            _ => Some(self.count(likeness?)),
        }
    }
}

/// The plain reply of a case, and the one to a way.
fn pair(case: &CaseReplies, way: Way) -> Option<(&Asked, &Asked)> {
    let (_, other) = case.ways.iter().find(|(it, _)| *it == way)?;
    Some((&case.plain, other))
}

fn ratio(plain: &Asked, other: &Asked) -> Option<f64> {
    Some(other.answer()?.refit_ratio(plain.answer()?))
}

/// What the answers are worth where labels are.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Worth {
    /// Labelled cases by grade.
    pub by_grade: BTreeMap<Grade, usize>,
    /// Labelled cases without an answer.
    pub no_answer: usize,
}

impl Worth {
    fn of<'a>(replies: impl Iterator<Item = (&'a str, &'a Asked)>, labels: &Labels) -> Self {
        let mut worth = Self::default();
        for (case, asked) in replies {
            let Some(known) = labels.get(case).filter(|known| known.accept.is_some()) else {
                continue;
            };
            match (&asked.reply, asked.answer()) {
                (Reply::LeftOut(_), _) => {}
                (_, None) => worth.no_answer += 1,
                (_, Some(answer)) => {
                    if let Some(grade) = known.grade(answer) {
                        *worth.by_grade.entry(grade).or_default() += 1;
                    }
                }
            }
        }
        worth
    }

    /// Cases of a grade.
    pub fn count(&self, grade: Grade) -> usize {
        self.by_grade.get(&grade).copied().unwrap_or(0)
    }
}

/// The times of the plain question.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Times {
    /// The median (s).
    pub median_s: f64,
    /// The longest (s).
    pub worst_s: f64,
    /// The case that took it.
    pub worst: String,
}

impl Times {
    fn of(cases: &[CaseReplies]) -> Option<Self> {
        let worst = cases
            .iter()
            .max_by(|a, b| a.plain.seconds.total_cmp(&b.plain.seconds))?;
        let mut seconds: Vec<f64> = cases.iter().map(|case| case.plain.seconds).collect();
        Some(Self {
            median_s: softrig::statistics::median(&mut seconds),
            worst_s: worst.plain.seconds,
            worst: worst.name.clone(),
        })
    }
}

/// One case in one way, for programs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WayCounts {
    /// The case.
    pub case: String,
    /// The way.
    pub way: &'static str,
    /// The plain answer.
    pub before: String,
    /// The answer to this way.
    pub after: String,
    /// How alike they are.
    pub likeness: Option<Likeness>,
    /// How many times the error of the refit is what it was.
    pub refit_ratio: Option<f64>,
    /// What the answer is worth.
    pub grade: Option<Grade>,
    /// Time of the diagnosis (s).
    pub seconds: f64,
}

/// Cases that were left out of a way for one reason.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct LeftOut {
    /// The way.
    pub way: &'static str,
    /// The reason.
    pub why: String,
    /// The cases.
    pub cases: Vec<String>,
}

/// The figures of a set.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Name of the set.
    pub set: String,
    /// Number of cases.
    pub cases: usize,
    /// The times of the plain question.
    pub times: Option<Times>,
    /// By way.
    pub ways: Vec<(&'static str, Counts)>,
    /// By way, the plain one first.
    pub worth: Vec<(&'static str, Worth)>,
    /// Which cases were left out of which way.
    pub left_out: Vec<LeftOut>,
    /// Each case in each way, the plain one included.
    pub rows: Vec<WayCounts>,
}

impl Figures {
    /// Counts the replies of a set.
    pub fn of(set: &CaseSet, cases: &[CaseReplies], ways: &[Way]) -> Self {
        let all = || {
            cases.iter().flat_map(|case| {
                let plain = std::iter::once((Way::Plain, &case.plain));
                let others = case.ways.iter().map(|(way, asked)| (*way, asked));
                plain
                    .chain(others)
                    .map(move |(way, asked)| (case, way, asked))
            })
        };
        let worth = std::iter::once(Way::Plain)
            .chain(ways.iter().copied())
            .map(|way| {
                let replies = all().filter(|(_, it, _)| *it == way);
                let replies = replies.map(|(case, _, asked)| (case.name.as_str(), asked));
                (way.name(), Worth::of(replies, &set.labels))
            });
        let rows = all().map(|(case, way, asked)| {
            let is_plain = way == Way::Plain;
            let grade = asked
                .answer()
                .and_then(|answer| set.labels.get(&case.name)?.grade(answer));
            WayCounts {
                case: case.name.clone(),
                way: way.name(),
                before: case.plain.in_words(),
                after: asked.in_words(),
                likeness: likeness(&case.plain, way, asked).filter(|_| !is_plain),
                refit_ratio: ratio(&case.plain, asked).filter(|_| !is_plain),
                grade,
                seconds: asked.seconds,
            }
        });
        let mut left_out: BTreeMap<_, Vec<String>> = BTreeMap::new();
        for (case, way, asked) in all() {
            if let Reply::LeftOut(why) = &asked.reply {
                let cases = left_out.entry((way.name(), why)).or_default();
                cases.push(case.name.clone());
            }
        }
        let left_out = left_out.into_iter().map(|((way, why), cases)| LeftOut {
            way,
            why: why.clone(),
            cases,
        });
        Self {
            set: set.name.clone(),
            cases: cases.len(),
            times: Times::of(cases),
            ways: ways
                .iter()
                .map(|&way| (way.name(), Counts::of(cases, way)))
                .collect(),
            worth: worth.collect(),
            left_out: left_out.collect(),
            rows: rows.collect(),
        }
    }
}

/// Limits: at least this share of the cases gets the same answer, at most this share a
/// contradicting one.
#[derive(Clone, Debug, PartialEq)]
pub struct Limits(Vec<(String, f64)>);

impl Limits {
    /// Reads `same=0.9,contradicting=0.02`.
    ///
    /// # Errors
    ///
    /// Says which columns there are.
    pub fn parse(text: &str) -> Result<Self, String> {
        let limit = |part: &str| {
            let (column, share) = part
                .split_once('=')
                .ok_or_else(|| format!("write COLUMN=SHARE for {part:?}, as same=0.9"))?;
            if Counts::default().named(column).is_none() {
                let known: Vec<&str> = Likeness::ALL.into_iter().map(Likeness::name).collect();
                return Err(format!(
                    "{column:?} is none of {}, no_answer and refit",
                    known.join(", ")
                ));
            }
            let share: f64 = share
                .parse()
                .ok()
                .filter(|share| (0.0..=1.0).contains(share))
                .ok_or_else(|| format!("{share:?} is no share from 0 to 1"))?;
            Ok((column.to_owned(), share))
        };
        text.split(',')
            .map(limit)
            .collect::<Result<_, _>>()
            .map(Self)
    }

    /// What is missed, in words.
    pub fn missed(&self, figures: &Figures) -> Vec<String> {
        let mut missed = Vec::new();
        for (way, counts) in figures.ways.iter().filter(|(_, counts)| counts.of > 0) {
            for (column, limit) in &self.0 {
                let count = counts.named(column).unwrap_or(0);
                let share = count as f64 / counts.of as f64;
                let (holds, word) = if column == "same" {
                    (share >= *limit, "least")
                } else {
                    (share <= *limit, "most")
                };
                if !holds {
                    missed.push(format!(
                        "{} {way}: {column} {count} of {}, at {word} {:.1} % are asked for",
                        figures.set,
                        counts.of,
                        100.0 * limit
                    ));
                }
            }
        }
        missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::invariance::answer::Answer;
    use crate::invariance::known::Known;
    use crate::pages::{for_terminal, render};
    use serde_json::json;

    fn asked(kind: &str, refit_deg: f64, seconds: f64) -> Asked {
        let verdict = json!({ "verdict": "effect_found", "effects": [{ "kind": kind }],
                              "rmse_deg": { "refit": refit_deg } });
        Asked::of(Reply::Answered(Answer::of(&verdict).unwrap()), seconds)
    }

    fn figures() -> Figures {
        let case = |name: &str, plain: Asked, seed: Asked, order: Asked| CaseReplies {
            name: name.into(),
            plain,
            ways: vec![(Way::Seed, seed), (Way::Order, order)],
        };
        let left_out = || Asked::of(Reply::LeftOut("one recording has one order".into()), 0.0);
        let cases = [
            case(
                "a",
                asked("gravity", 1.0, 2.0),
                asked("gravity", 1.02, 2.0),
                left_out(),
            ),
            case(
                "b",
                asked("gravity", 1.0, 4.0),
                asked("leak", 1.0, 2.0),
                left_out(),
            ),
            case(
                "c",
                asked("leak", 1.0, 9.0),
                Asked::of(Reply::TooLong, 900.0),
                asked("leak", 1.0, 2.0),
            ),
        ];
        let known =
            |kinds: &[&str]| Known::exactly(kinds.iter().map(|&kind| kind.to_owned()).collect());
        let set = CaseSet {
            name: "set".into(),
            cases: Vec::new(),
            labels: [
                ("a", known(&["gravity"])),
                ("b", known(&["gravity"])),
                ("c", known(&[])),
            ]
            .map(|(name, known)| (name.to_owned(), known))
            .into(),
        };
        Figures::of(&set, &cases, &[Way::Seed, Way::Order])
    }

    #[test]
    fn each_way_is_counted_beside_the_plain_one() {
        let figures = figures();
        let (_, seed) = &figures.ways[0];
        assert_eq!(
            (
                seed.count(Likeness::Same),
                seed.count(Likeness::Contradicting)
            ),
            (1, 1)
        );
        assert_eq!(
            (seed.no_answer, seed.of, seed.left_out, seed.other_refit),
            (1, 3, 0, 1)
        );
        let (_, order) = &figures.ways[1];
        assert_eq!((order.of, order.left_out), (1, 2));
        let (way, plain) = &figures.worth[0];
        assert_eq!((*way, plain.count(Grade::Named)), ("plain", 2));
        assert_eq!(plain.count(Grade::ControlNamed), 1);
        let (_, seed) = &figures.worth[1];
        assert_eq!((seed.count(Grade::Wrong), seed.no_answer), (1, 1));
        let times = figures.times.as_ref().unwrap();
        assert_eq!((times.median_s, times.worst.as_str()), (4.0, "c"));
    }

    #[test]
    fn the_text_has_every_way_and_every_other_answer() {
        let figures = json!({ "benchmark": "invariance", "sets": [figures()] });
        let text = for_terminal(&render(&figures).unwrap());
        for part in [
            "| seed  |    1 |",
            "  seed: b: gravity → leak: contradicting, refit error × 1.000\n",
            "  seed: c: leak → no answer (took too long): no answer\n",
            "  order: one recording has one order: a, b\n",
            "4.0 s in the median, 9.0 s at most (c)",
        ] {
            assert!(text.contains(part), "{part:?} not in\n{text}");
        }
        assert!(!text.contains("seed: a"), "{text}");
        let lines = text.lines().filter(|line| line.starts_with('|'));
        let widths: Vec<usize> = lines.take(4).map(|line| line.chars().count()).collect();
        assert_eq!(widths, [widths[0]; 4]);
    }

    #[test]
    fn limits_are_read_and_missed() {
        let missed = |text: &str| Limits::parse(text).unwrap().missed(&figures());
        assert_eq!(missed("same=0.3,contradicting=0.4"), [""; 0]);
        assert_eq!(
            missed("same=0.9,contradicting=0.02,refit=0.5"),
            [
                "set seed: same 1 of 3, at least 90.0 % are asked for",
                "set seed: contradicting 1 of 3, at most 2.0 % are asked for"
            ]
        );
        assert_eq!(missed("no_answer=0").len(), 1);
        for text in ["", "same", "same=2", "same=x", "named=0.5", "same=0.9,"] {
            assert!(Limits::parse(text).is_err(), "{text}");
        }
    }
}
