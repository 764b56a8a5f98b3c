//! The whole loop on many random actuators: how much a diagnosis improves the board's
//! prediction.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use clap::Args;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};

use softrig_tests::process::succeed;
use softrig_tests::rig_loop::{
    Board, Drawn, Folder, Gap, Programs, diagnose, gap, record, upload_model, upload_repaired,
};
use softrig_tests::verdict::Kinds;
use softrig_tests::verdict::{Verdict, in_words};

/// The message of `softrig upload` when the board refuses a model.
const REFUSED: &str = "the board still uses its old settings";
/// How long an upload, or the comparison at the end, may take.
const SHORT_LIMIT: Duration = Duration::from_secs(180);
/// How long a recording may take: some 75 s of the board's time, simulated slower
/// than that where cores are shared.
pub(super) const RECORD_LIMIT: Duration = Duration::from_secs(1_200);
/// How long a diagnosis may take.
pub(super) const DIAGNOSE_LIMIT: Duration = Duration::from_secs(1_800);
/// An answer set of more rivals than this does not count as an answer.
const LARGEST_ANSWER: usize = 3;
/// More seeds than anyone waits for: a slip in the range.
const MOST_SEEDS: u64 = 10_000;

/// How much does a diagnosis improve what the board predicts?
///
/// Draws an actuator from each seed, which hides an effect, and runs the demo's loop on it:
/// record, diagnose, upload, record again.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  cargo xtask bench loop --seeds 201..212
  cargo xtask bench loop --seeds 901..924 --docs")]
pub struct Options {
    #[command(flatten)]
    programs: Programs,
    /// One case each: a range with both ends, 201..212, or a list, 1,5,9
    #[arg(long, value_parser = Seeds::parse)]
    seeds: Seeds,
    /// Cases at a time [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Where the files of the cases go [default: loop in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

/// Seeds, as they were asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Seeds {
    pub asked: String,
    pub each: Vec<u64>,
}

impl Seeds {
    pub fn parse(text: &str) -> Result<Self, String> {
        let each = seeds(text).filter(|seeds| !seeds.is_empty());
        Ok(Self {
            asked: text.into(),
            each: each.ok_or("give 201..212 (both included) or 1,5,9")?,
        })
    }
}

/// A range with both ends, or a list.
fn seeds(text: &str) -> Option<Vec<u64>> {
    if let Some((first, last)) = text.split_once("..") {
        let last = last.strip_prefix('=').unwrap_or(last);
        let (first, last): (u64, u64) = (first.parse().ok()?, last.parse().ok()?);
        let count = last.checked_sub(first)?;
        return (count < MOST_SEEDS).then(|| (first..=last).collect());
    }
    text.split(',')
        .map(|seed| seed.trim().parse().ok())
        .collect()
}

impl Options {
    /// Runs the loop for each seed.
    ///
    /// # Errors
    ///
    /// If there are no threads; a case that does not go through is a row of the table.
    pub fn measure(&self, folder: &Path) -> Result<Value, String> {
        let folder = self.folder.as_deref().unwrap_or(folder);
        let workers = workers(self.jobs)?;
        let case = |&seed: &u64| {
            let row = LoopResult::of(&self.programs, seed, folder.join(seed.to_string()));
            eprintln!("{}", row.figures());
            row
        };
        let seeds = &self.seeds;
        let mut rows: Vec<LoopResult> =
            workers.install(|| seeds.each.par_iter().with_max_len(1).map(case).collect());
        rows.sort_by_key(|row| row.seed);
        Ok(figures(&seeds.asked, &rows))
    }
}

/// Threads for so many cases at a time, or for half the cores.
pub(super) fn workers(jobs: Option<u16>) -> Result<rayon::ThreadPool, String> {
    let half = thread::available_parallelism().map_or(1, usize::from) / 2;
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.map_or(half.max(1), usize::from))
        .build()
        .map_err(|error| error.to_string())
}

/// One actuator.
#[derive(Clone, Debug)]
struct LoopResult {
    seed: u64,
    /// The hidden effects; empty where the actuator only has other parameters.
    hidden: Kinds,
    /// How it went, or why it did not.
    went: Result<Done, String>,
}

/// A case that went through.
#[derive(Clone, Debug)]
struct Done {
    verdict: Verdict,
    uploaded: Uploaded,
    /// The board's gap before and after the upload.
    gap: Gap,
}

impl Done {
    /// How many times smaller the gap is after the upload.
    fn ratio(&self) -> f64 {
        self.gap.before.rms_deg / self.gap.after.rms_deg
    }
}

/// The outcome of uploading the repaired model, as the table adds it to the score.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
enum Uploaded {
    /// The board runs it.
    #[serde(rename = "")]
    Yes,
    /// The diagnosis does not offer it.
    #[serde(rename = ", no upload")]
    NotOffered,
    /// The board cannot step it, and keeps the model that it has.
    #[serde(rename = ", refused by the board")]
    Refused,
}

/// The score of an answer against the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(super) enum Score {
    /// The hidden effects, and nothing else, are named.
    #[serde(rename = "named")]
    Named,
    /// It is one of a few answers that are left open.
    #[serde(rename = "in the answer set")]
    Among,
    /// It is one of many.
    #[serde(rename = "in an answer set of more than three")]
    AmongMany,
    /// Some of what is hidden is named, and nothing else.
    #[serde(rename = "named in part")]
    Partly,
    /// Something is named that is not there.
    #[serde(rename = "WRONG NAME")]
    Wrong,
    /// Nothing of this.
    #[serde(rename = "not named")]
    Silent,
}

impl Score {
    pub fn of(hidden: &Kinds, verdict: &Verdict) -> Self {
        let named = verdict.kinds();
        let holds = |kinds: &[String]| kinds.iter().cloned().collect::<Kinds>() == *hidden;
        match verdict.verdict.as_str() {
            "effect_found" if named == *hidden => Self::Named,
            "effect_found" if named.is_subset(hidden) => Self::Partly,
            "effect_found" => Self::Wrong,
            "parameters_only" | "no_discrepancy" if hidden.is_empty() => Self::Named,
            "cannot_tell" if verdict.alternatives.iter().any(|it| holds(&it.kinds)) => {
                if verdict.alternatives.len() <= LARGEST_ANSWER {
                    Self::Among
                } else {
                    Self::AmongMany
                }
            }
            _ => Self::Silent,
        }
    }
}

impl LoopResult {
    fn of(programs: &Programs, seed: u64, folder: PathBuf) -> Self {
        let folder = Folder::clear(folder);
        let went = folder.as_ref().map_err(Clone::clone);
        let went = went.and_then(|folder| case(programs, seed, folder));
        let hidden = folder.ok().and_then(|folder| folder.hidden());
        Self {
            seed,
            hidden: hidden.unwrap_or_default(),
            went,
        }
    }

    fn score(&self) -> Option<Score> {
        let done = self.went.as_ref().ok()?;
        Some(Score::of(&self.hidden, &done.verdict))
    }

    fn figures(&self) -> Value {
        let mut row = json!({ "seed": self.seed, "hidden": in_words(&self.hidden) });
        match &self.went {
            Ok(done) => {
                let verdict = &done.verdict;
                row["verdict"] = verdict.verdict.as_str().into();
                if !verdict.effects.is_empty() || verdict.verdict == "cannot_tell" {
                    row["answer"] = answer(verdict).into();
                }
                row["score"] = json!(Score::of(&self.hidden, verdict));
                row["uploaded"] = json!(done.uploaded);
                row["before_deg"] = done.gap.before.rms_deg.into();
                row["after_deg"] = done.gap.after.rms_deg.into();
                row["ratio"] = done.ratio().into();
                row["diagnosis_s"] = verdict.seconds.into();
            }
            Err(why) => row["failed"] = why.as_str().into(),
        }
        row
    }
}

/// What is named, or left open.
pub(super) fn answer(verdict: &Verdict) -> String {
    if verdict.effects.is_empty() {
        verdict.sets().collect::<Vec<_>>().join(" / ")
    } else {
        in_words(verdict.named())
    }
}

/// A board with the image and a drawn actuator, whose complaints go into the folder.
pub(super) fn board(programs: &Programs, drawn: &Drawn, folder: &Folder) -> Result<Board, String> {
    let complaints =
        fs::File::create(folder.path("simulator.log")).map_or_else(|_| Stdio::null(), Stdio::from);
    let image = Some(programs.image.as_path());
    Board::start(&programs.simulator, drawn, folder, image, complaints)
}

/// Runs a command that has to succeed; what it says goes into a file of the folder.
pub(super) fn logged(
    folder: &Folder,
    name: &str,
    command: &mut Command,
    limit: Duration,
) -> Result<(), String> {
    let said = succeed(command, limit, &folder.path(name));
    said.map_err(|why| format!("{name}: {why}"))
}

/// One pass through the loop.
fn case(programs: &Programs, seed: u64, folder: &Folder) -> Result<Done, String> {
    let board = board(programs, &Drawn { seed, effect: None }, folder)?;
    let log = |name: &str, command: &mut Command, limit| logged(folder, name, command, limit);
    log(
        "1-upload.txt",
        &mut upload_model(programs, &board, folder),
        SHORT_LIMIT,
    )?;
    log(
        "2-record.txt",
        &mut record(programs, &board, folder, "before"),
        RECORD_LIMIT,
    )?;
    log(
        "3-diagnose.txt",
        &mut diagnose(programs, folder),
        DIAGNOSE_LIMIT,
    )?;
    let verdict = folder.verdict()?;
    let uploaded = if verdict.is_for_the_board() {
        let mut upload = upload_repaired(programs, &board, folder);
        match log("4-upload.txt", &mut upload, SHORT_LIMIT) {
            Ok(()) => Uploaded::Yes,
            Err(why) => {
                let said = fs::read_to_string(folder.path("4-upload.txt")).unwrap_or_default();
                if !said.contains(REFUSED) {
                    return Err(why);
                }
                Uploaded::Refused
            }
        }
    } else {
        Uploaded::NotOffered
    };
    log(
        "5-record.txt",
        &mut record(programs, &board, folder, "after"),
        RECORD_LIMIT,
    )?;
    log("6-gap.txt", &mut gap(programs, folder), SHORT_LIMIT)?;
    board.stop()?;
    Ok(Done {
        verdict,
        uploaded,
        gap: folder.gap()?,
    })
}

/// The rows, and how many there are of a kind.
fn figures(seeds: &str, rows: &[LoopResult]) -> Value {
    let count = |wanted: &[Score]| {
        let scores = rows.iter().filter_map(LoopResult::score);
        scores.filter(|score| wanted.contains(score)).count()
    };
    let done = || rows.iter().filter_map(|row| row.went.as_ref().ok());
    let mut ratios: Vec<f64> = done().map(Done::ratio).filter(|r| !r.is_nan()).collect();
    ratios.sort_by(f64::total_cmp);
    let worst = ratios.first().copied();
    json!({
        "benchmark": "loop", "seeds": seeds, "named": count(&[Score::Named]),
        // Named, or among few answers that are left open.
        "answered": count(&[Score::Named, Score::Among]), "largest_answer": LARGEST_ANSWER,
        "wrong": count(&[Score::Wrong]), "failed": rows.len() - done().count(),
        // How many times smaller the gap is after the upload.
        "median_ratio": worst.map(|_| softrig::statistics::median(&mut ratios)), "worst_ratio": worst,
        "cases": rows.iter().map(LoopResult::figures).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::render;
    use softrig_tests::rig_loop::Side;

    fn row(seed: u64, hidden: &[&str], verdict: &str, gaps: (f64, f64)) -> LoopResult {
        LoopResult {
            seed,
            hidden: hidden.iter().map(|&kind| kind.into()).collect(),
            went: Ok(Done {
                uploaded: Uploaded::Yes,
                verdict: Verdict::parse(verdict).unwrap(),
                gap: Gap {
                    before: Side { rms_deg: gaps.0 },
                    after: Side { rms_deg: gaps.1 },
                    sentence: String::new(),
                    tracking: None,
                },
            }),
        }
    }

    const GRAVITY: &str = r#"{"verdict": "effect_found", "effects": [{"kind": "gravity"}]}"#;
    const OPEN: &str = r#"{"verdict": "cannot_tell", "alternatives":
        [{"kinds": ["creep"]}, {"kinds": ["lag", "gravity"]}]}"#;

    #[test]
    fn seeds_are_a_range_with_both_ends_or_a_list() {
        assert_eq!(seeds("201..203"), Some(vec![201, 202, 203]));
        assert_eq!(seeds("201..=203"), Some(vec![201, 202, 203]));
        assert_eq!(seeds("5..5"), Some(vec![5]));
        assert_eq!(seeds("1, 5,9"), Some(vec![1, 5, 9]));
        for text in ["", "5..1", "a..b", "1,,2", "0..18446744073709551615"] {
            assert_eq!(seeds(text), None, "{text}");
        }
    }

    #[test]
    fn answers_are_scored_beside_the_truth() {
        let score = |hidden: &[&str], verdict: &str| row(1, hidden, verdict, (1.0, 1.0)).score();
        assert_eq!(score(&["gravity"], GRAVITY), Some(Score::Named));
        assert_eq!(score(&["creep"], GRAVITY), Some(Score::Wrong));
        assert_eq!(score(&["creep", "gravity"], GRAVITY), Some(Score::Partly));
        assert_eq!(score(&[], GRAVITY), Some(Score::Wrong));
        assert_eq!(score(&["creep"], OPEN), Some(Score::Among));
        assert_eq!(score(&["gravity", "lag"], OPEN), Some(Score::Among));
        assert_eq!(score(&["gravity"], OPEN), Some(Score::Silent));
        let many = OPEN.replace("[{", r#"[{"kinds": ["a"]}, {"kinds": ["b"]}, {"#);
        assert_eq!(score(&["creep"], &many), Some(Score::AmongMany));
        let quiet = r#"{"verdict": "parameters_only"}"#;
        assert_eq!(score(&[], quiet), Some(Score::Named));
        assert_eq!(score(&["creep"], quiet), Some(Score::Silent));
    }

    #[test]
    fn the_summary_counts_what_went_through_and_what_did_not() {
        let rows = [
            row(1, &["gravity"], GRAVITY, (4.0, 1.0)),
            row(2, &["creep"], GRAVITY, (1.0, 2.0)),
            row(3, &["creep"], OPEN, (3.0, 1.0)),
            LoopResult {
                seed: 4,
                hidden: Kinds::new(),
                went: Err("rig took\n|too long".into()),
            },
        ];
        let found = figures("1..4", &rows);
        let count = |name: &str| found[name].as_u64().unwrap();
        assert_eq!(
            (found["cases"].as_array().unwrap().len(), count("failed")),
            (4, 1)
        );
        assert_eq!(
            (count("named"), count("answered"), count("wrong")),
            (1, 2, 1)
        );
        assert_eq!(found["median_ratio"], 3.0);
        assert_eq!(found["worst_ratio"], 0.5);
        let page = render(&found).unwrap();
        assert!(
            page.contains("| 4 | parameters only | failed | rig took /too long |"),
            "{page}"
        );
        let columns = |line: &str| line.matches('|').count();
        let table: Vec<&str> = page.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(table.len(), 6);
        assert!(table.iter().all(|line| columns(line) == 10), "{table:?}");
        assert_eq!(figures("1", &[])["median_ratio"], Value::Null);
        assert_eq!(found["cases"][1]["score"], "WRONG NAME");
    }
}
