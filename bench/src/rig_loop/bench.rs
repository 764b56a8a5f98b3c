//! The whole loop on many random actuators: how much a diagnosis improves the board's
//! prediction.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use clap::Args;
use rayon::prelude::*;

use softrig_tests::process::{root, succeed};
use softrig_tests::rig_loop::{
    Board, Drawn, Folder, Gap, PROTOCOL, Programs, diagnose, gap, record, upload_model,
    upload_repaired,
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

/// What to run.
#[derive(Args, Debug)]
pub struct Options {
    /// One case each: a range with both ends, 201..212, or a list, 1,5,9
    #[arg(long, value_parser = Seeds::parse)]
    seeds: Seeds,
    /// Cases at a time [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Write docs/loop.md
    #[arg(long)]
    docs: bool,
    /// Where the files of the cases go
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/loop",
        overrides_with = "folder"
    )]
    folder: PathBuf,
}

/// Seeds, as they were asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Seeds {
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

/// Runs the loop for each seed.
///
/// # Errors
///
/// If the page cannot be written; a case that does not go through is a row of the table.
pub fn bench(programs: &Programs, options: &Options) -> Result<(), String> {
    let workers = workers(options.jobs)?;
    let case = |&seed: &u64| {
        let row = LoopResult::of(programs, seed, options.folder.join(seed.to_string()));
        println!("{}", row.line());
        row
    };
    let seeds = &options.seeds;
    let mut rows: Vec<LoopResult> =
        workers.install(|| seeds.each.par_iter().with_max_len(1).map(case).collect());
    rows.sort_by_key(|row| row.seed);
    println!("\n{}", Summary::of(&rows).text());
    if options.docs {
        let path = root().join("docs/loop.md");
        fs::write(&path, page(&seeds.asked, &rows))
            .map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        println!("table: docs/loop.md");
    }
    Ok(())
}

/// Threads for so many cases at a time, or for half the cores.
pub(super) fn workers(jobs: Option<u16>) -> Result<rayon::ThreadPool, String> {
    let half = thread::available_parallelism().map_or(1, usize::from) / 2;
    rayon::ThreadPoolBuilder::new()
        .num_threads(jobs.map_or(half.max(1), usize::from))
        .build()
        .map_err(|error| error.to_string())
}

/// Why a case failed, on one line and without what ends a cell of a table.
pub(super) fn in_a_cell(why: &str) -> String {
    let why = why.split_whitespace().collect::<Vec<_>>().join(" ");
    why.replace('|', "/").chars().take(160).collect()
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

/// The outcome of uploading the repaired model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Uploaded {
    /// The board runs it.
    Yes,
    /// The diagnosis does not offer it.
    NotOffered,
    /// The board cannot step it, and keeps the model that it has.
    Refused,
}

impl Uploaded {
    /// The words that the table adds to the score.
    fn words(self) -> &'static str {
        match self {
            Self::Yes => "",
            Self::NotOffered => ", no upload",
            Self::Refused => ", refused by the board",
        }
    }
}

/// The score of an answer against the truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Score {
    /// The hidden effects, and nothing else, are named.
    Named,
    /// It is one of a few answers that are left open.
    Among,
    /// It is one of many.
    AmongMany,
    /// Some of what is hidden is named, and nothing else.
    Partly,
    /// Something is named that is not there.
    Wrong,
    /// Nothing of this.
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

    pub fn words(self) -> &'static str {
        match self {
            Self::Named => "named",
            Self::Among => "in the answer set",
            Self::AmongMany => "in an answer set of more than three",
            Self::Partly => "named in part",
            Self::Wrong => "WRONG NAME",
            Self::Silent => "not named",
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

    /// The cells of the table's row.
    fn cells(&self) -> Vec<String> {
        let hidden = if self.hidden.is_empty() {
            "parameters only".into()
        } else {
            in_words(&self.hidden)
        };
        let mut cells = vec![self.seed.to_string(), hidden];
        match &self.went {
            Ok(done) => {
                let verdict = &done.verdict;
                let answer = if !verdict.effects.is_empty() {
                    in_words(verdict.named())
                } else if verdict.verdict == "cannot_tell" {
                    verdict.sets().collect::<Vec<_>>().join(" / ")
                } else {
                    "–".into()
                };
                let score = Score::of(&self.hidden, verdict);
                let kept = done.uploaded.words();
                cells.extend([
                    verdict.verdict.replace('_', " "),
                    answer,
                    format!("{}{kept}", score.words()),
                    format!("{:.3}", done.gap.before.rms_deg),
                    format!("{:.3}", done.gap.after.rms_deg),
                    format!("{:.2}", done.ratio()),
                    format!("{:.0}", verdict.seconds.unwrap_or(f64::NAN)),
                ]);
            }
            Err(why) => {
                cells.extend(["failed".into(), in_a_cell(why)]);
                cells.extend(std::iter::repeat_n(String::new(), 5));
            }
        }
        cells
    }

    fn line(&self) -> String {
        let cells = self.cells();
        match &self.went {
            Ok(_) => format!(
                "{}: hides {}; {}: {} [{}]; gap {}° to {}°, {} times smaller; diagnosed in {} s",
                cells[0],
                cells[1],
                cells[2],
                cells[3],
                cells[4],
                cells[5],
                cells[6],
                cells[7],
                cells[8]
            ),
            Err(_) => format!("{}: hides {}; failed: {}", cells[0], cells[1], cells[3]),
        }
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

/// The summary of the rows.
#[derive(Clone, Debug, PartialEq)]
struct Summary {
    cases: usize,
    failed: usize,
    named: usize,
    /// Named, or among few answers that are left open.
    answered: usize,
    wrong: usize,
    /// How many times smaller the gap is after the upload, in the median; none
    /// without cases.
    median_ratio: Option<f64>,
    worst_ratio: Option<f64>,
}

impl Summary {
    fn of(rows: &[LoopResult]) -> Self {
        let count = |wanted: &[Score]| {
            let scores = rows.iter().filter_map(LoopResult::score);
            scores.filter(|score| wanted.contains(score)).count()
        };
        let done = || rows.iter().filter_map(|row| row.went.as_ref().ok());
        let mut ratios: Vec<f64> = done().map(Done::ratio).filter(|r| !r.is_nan()).collect();
        ratios.sort_by(f64::total_cmp);
        let middle = ratios.len() / 2;
        Self {
            cases: rows.len(),
            failed: rows.len() - done().count(),
            named: count(&[Score::Named]),
            answered: count(&[Score::Named, Score::Among]),
            wrong: count(&[Score::Wrong]),
            median_ratio: match ratios.len() {
                0 => None,
                n if n.is_multiple_of(2) => Some(f64::midpoint(ratios[middle - 1], ratios[middle])),
                _ => Some(ratios[middle]),
            },
            worst_ratio: ratios.first().copied(),
        }
    }

    fn text(&self) -> String {
        let times = |ratio: Option<f64>| ratio.map_or("–".into(), |ratio| format!("{ratio:.2}"));
        let mut text = format!(
            "{} of {cases} named rightly, {} of {cases} named or among at most {LARGEST_ANSWER} of \
             \"cannot tell\", {} named wrongly. The board's gap became {} times smaller in the \
             median, {} times in the worst case.",
            self.named,
            self.answered,
            self.wrong,
            times(self.median_ratio),
            times(self.worst_ratio),
            cases = self.cases,
        );
        if self.failed > 0 {
            let _ = write!(text, " {} did not go through.", self.failed);
        }
        text
    }
}

/// The page of the documentation.
fn page(asked: &str, rows: &[LoopResult]) -> String {
    let mut text = format!(
        "# The whole loop on drawn actuators\n\n\
         Written by `cargo xtask bench loop --seeds {asked} --docs`.\n\n\
         Each seed draws an actuator with a hidden effect (`virtual-rig serve --hide SEED`). The\n\
         firmware runs in the simulator with the nominal model. The protocol `{PROTOCOL}` is recorded\n\
         through the serial port, `softrig diagnose` looks for what is missing, the repaired model is\n\
         uploaded, and the protocol is recorded again. The gap is the angle that the board predicts\n\
         less the angle that it measures, RMS over all runs. The files of each case are in\n\
         `target/loop/SEED`.\n\n{}\n\n\
         | seed | hidden | verdict | answer | the truth is | gap before (°) | after (°) | times smaller | diagnosis (s) |\n\
         |---:|---|---|---|---|---:|---:|---:|---:|\n",
        Summary::of(rows).text()
    );
    for row in rows {
        let _ = writeln!(text, "| {} |", row.cells().join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
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
    fn options_are_read() {
        #[derive(Debug, clap::Parser)]
        struct Command {
            #[command(flatten)]
            options: Options,
        }
        let parse = |line: &str| {
            let words = std::iter::once("loop").chain(line.split_whitespace());
            Command::try_parse_from(words).map(|command| command.options)
        };
        let options = parse("--docs --seeds 1..3 --jobs 2").unwrap();
        assert_eq!(
            (options.seeds.each.len(), options.jobs, options.docs),
            (3, Some(2), true)
        );
        assert_eq!(parse("--seeds 1,5").unwrap().seeds.asked, "1,5");
        for line in [
            "",
            "--seeds",
            "--seeds 5..1",
            "--jobs 0 --seeds 1",
            "--seeds 1 --job 1",
        ] {
            assert!(parse(line).is_err(), "{line}");
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
        let summary = Summary::of(&rows);
        assert_eq!((summary.cases, summary.failed), (4, 1));
        assert_eq!((summary.named, summary.answered, summary.wrong), (1, 2, 1));
        assert_eq!(summary.median_ratio, Some(3.0));
        assert_eq!(summary.worst_ratio, Some(0.5));
        let page = page("1..4", &rows);
        assert!(
            page.contains("| 4 | parameters only | failed | rig took /too long |"),
            "{page}"
        );
        let columns = |line: &str| line.matches('|').count();
        let table: Vec<&str> = page.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(table.len(), 6);
        assert!(table.iter().all(|line| columns(line) == 10), "{table:?}");
        assert_eq!(Summary::of(&[]).median_ratio, None);
        assert!(rows[1].line().contains("WRONG NAME"));
        assert!(rows[3].line().contains("failed: rig took"));
    }
}
