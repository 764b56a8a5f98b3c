//! Do the experiments that `softrig` proposes decide?
//!
//! For every effect of the catalogue an actuator is drawn that hides it, one session is recorded
//! on the virtual rig, and diagnosed. Where that cannot tell, `softrig next` makes the experiments
//! that it proposes, two at most, on the same actuator. Counted is what stands in the answer after
//! one session and after the last.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;
use std::process::Command;

use clap::Args;
use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::bench::{DIAGNOSE_LIMIT, RECORD_LIMIT, Score, Seeds, board, in_a_cell, logged, workers};
use softrig_tests::process::root;
use softrig_tests::rig_loop::{Drawn, Folder, Programs, diagnose, record};
use softrig_tests::verdict::Kinds;
use softrig_tests::verdict::{Verdict, in_words};

/// Experiments at most.
const MOST: u32 = 2;

/// What is stated with at least this should be right.
const SURE: f64 = 0.95;

/// What to run.
#[derive(Args, Debug)]
pub struct Options {
    /// Seeds of each effect: a range with both ends, 5301..5302, or a list, 1,5,9
    #[arg(long, value_parser = Seeds::parse)]
    seeds: Seeds,
    /// Only these effects, with commas
    #[arg(long, value_name = "KIND,…", value_delimiter = ',')]
    only: Vec<String>,
    /// Cases at a time [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Write docs/decide.md
    #[arg(long)]
    docs: bool,
    /// Where the files of the cases go
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/decide",
        overrides_with = "folder"
    )]
    folder: PathBuf,
}

/// Runs every effect with each seed.
///
/// # Errors
///
/// If an effect is not known or the page cannot be written; a case that does not go through is a
/// row of the table.
pub fn bench(programs: &Programs, options: &Options) -> Result<(), String> {
    let known: Vec<&str> = Kind::NAMES.iter().map(|kind| kind.name()).collect();
    if let Some(other) = options.only.iter().find(|it| !known.contains(&it.as_str())) {
        return Err(format!(
            "there is no effect {other}; known are {}",
            known.join(", ")
        ));
    }
    let cases: Vec<(&str, u64)> = known
        .into_iter()
        .filter(|kind| options.only.is_empty() || options.only.iter().any(|it| it == kind))
        .flat_map(|kind| options.seeds.each.iter().map(move |&seed| (kind, seed)))
        .collect();
    let case = |&(kind, seed): &(&str, u64)| {
        let row = Decided::of(programs, kind, seed, options);
        println!("{}", row.line());
        row
    };
    let rows: Vec<Decided> =
        workers(options.jobs)?.install(|| cases.par_iter().with_max_len(1).map(case).collect());
    println!("\n{}", summary(&rows));
    if options.docs {
        let path = root().join("docs/decide.md");
        fs::write(&path, page(&options.seeds.asked, &rows))
            .map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        println!("table: docs/decide.md");
    }
    Ok(())
}

/// One actuator.
struct Decided {
    kind: String,
    seed: u64,
    /// How it went, or why it did not.
    went: Result<Answers, String>,
}

/// What was said of an actuator.
struct Answers {
    /// After one session.
    first: Verdict,
    /// After the last experiment; none were made where the first answer was no "cannot tell", or
    /// nothing was expected to decide.
    last: Verdict,
    /// The experiments that were made.
    experiments: usize,
}

impl Decided {
    fn of(programs: &Programs, kind: &str, seed: u64, options: &Options) -> Self {
        let folder = Folder::clear(options.folder.join(format!("{kind}_{seed}")));
        Self {
            kind: kind.into(),
            seed,
            went: folder.and_then(|folder| answers(programs, kind, seed, &folder)),
        }
    }

    fn hidden(&self) -> Kinds {
        Kinds::from([self.kind.clone()])
    }

    fn scores(&self) -> Option<[Score; 2]> {
        let went = self.went.as_ref().ok()?;
        Some([&went.first, &went.last].map(|it| Score::of(&self.hidden(), it)))
    }

    /// The cells of the table's row.
    fn cells(&self) -> Vec<String> {
        let mut cells = vec![self.kind.replace('_', " "), self.seed.to_string()];
        match &self.went {
            Ok(went) => {
                let last = &went.last;
                let said = if last.effects.is_empty() {
                    last.sets().collect::<Vec<_>>().join(" / ")
                } else {
                    in_words(last.named())
                };
                let [first, after] = [&went.first, last].map(|it| Score::of(&self.hidden(), it));
                cells.extend([
                    first.words().into(),
                    went.experiments.to_string(),
                    after.words().into(),
                    said,
                    last.probability()
                        .map_or("–".into(), |it| format!("{it:.3}")),
                ]);
            }
            Err(why) => {
                cells.extend(["failed".into(), String::new(), in_a_cell(why)]);
                cells.extend(std::iter::repeat_n(String::new(), 2));
            }
        }
        cells
    }

    fn line(&self) -> String {
        self.cells().join("; ")
    }
}

/// One session, its diagnosis, and the experiments that it proposes.
fn answers(programs: &Programs, kind: &str, seed: u64, folder: &Folder) -> Result<Answers, String> {
    let drawn = Drawn {
        seed,
        effect: Some(kind.into()),
    };
    let board = board(programs, &drawn, folder)?;
    let log = |name: &str, command: &mut Command, limit| logged(folder, name, command, limit);
    let mut recorded = record(programs, &board, folder, "before");
    // What a tape measure says of the virtual rig.
    recorded.args(["--setup", "tube_mm=300"]);
    log("1-record.txt", &mut recorded, RECORD_LIMIT)?;
    board.stop()?;
    log(
        "2-diagnose.txt",
        &mut diagnose(programs, folder),
        DIAGNOSE_LIMIT,
    )?;
    let first = folder.verdict()?;
    if first.verdict != "cannot_tell" {
        return Ok(Answers {
            last: first.clone(),
            first,
            experiments: 0,
        });
    }
    let mut next = programs.rig();
    next.env("SOFTRIG_VIRTUAL_RIG", &programs.simulator)
        .env("SOFTRIG_FIRMWARE", &programs.image)
        .args(["next", "--most", &MOST.to_string(), "--virtual"])
        .arg(folder.file("truth.toml"))
        .arg("--model")
        .arg(folder.file("model.toml"))
        .arg(folder.file("before/run.csv"))
        .arg("--json")
        .arg(folder.file("decided.json"))
        .arg("-o")
        .arg(folder.file("after"));
    log("3-next.txt", &mut next, RECORD_LIMIT + DIAGNOSE_LIMIT)?;
    let made = |number: &u32| folder.path(&format!("after/next{number}.csv")).exists();
    Ok(Answers {
        first,
        last: Verdict::read(&folder.path("decided.json"))?,
        experiments: (1..=MOST).filter(made).count(),
    })
}

/// How many of the rows are so and so, in a sentence.
fn summary(rows: &[Decided]) -> String {
    let scores: Vec<[Score; 2]> = rows.iter().filter_map(Decided::scores).collect();
    let count = |when: usize, wanted: &[Score]| {
        let of = scores.iter().filter(|it| wanted.contains(&it[when]));
        of.count()
    };
    let cases = rows.len();
    let tell = |when: usize, after: &str| {
        format!(
            "After {after}: {} of {cases} named rightly, {} named or in a small answer, {} wrongly. ",
            count(when, &[Score::Named]),
            count(when, &[Score::Named, Score::Among]),
            count(when, &[Score::Wrong]),
        )
    };
    let mut text = tell(0, "one session") + &tell(1, "the experiments");
    let done = || {
        rows.iter()
            .filter_map(|row| Some((row, row.went.as_ref().ok()?)))
    };
    let open = done()
        .filter(|(_, went)| went.first.verdict == "cannot_tell")
        .count();
    let decided = done().filter(|(_, went)| {
        went.first.verdict == "cannot_tell" && went.last.verdict != "cannot_tell"
    });
    let surely_wrong = done().filter(|(row, went)| {
        Score::of(&row.hidden(), &went.last) == Score::Wrong
            && went.last.probability().is_some_and(|it| it >= SURE)
    });
    let _ = write!(
        text,
        "Of {open} that one session could not tell, {} were decided. {} were wrong at a stated \
         probability of {SURE} or more. {} did not go through.",
        decided.count(),
        surely_wrong.count(),
        cases - scores.len()
    );
    text
}

/// The page of the documentation.
fn page(asked: &str, rows: &[Decided]) -> String {
    let mut text = format!(
        "# Do the proposed experiments decide?\n\n\
         Written by `cargo xtask bench decide --seeds {asked} --docs`.\n\n\
         For each effect an actuator is drawn that hides it (`virtual-rig serve --hide SEED --effect KIND`).\n\
         One session of `steps` is recorded and diagnosed. Where that cannot tell, `softrig next` records what it\n\
         proposes on the same actuator, two runs at most, and diagnoses all of it. Nobody looked at these\n\
         seeds before. The files of each case are in `target/decide`.\n\n{}\n\n\
         | hidden | seed | after one session | experiments | after them | answer | stated probability |\n\
         |---|---:|---|---:|---|---|---:|\n",
        summary(rows)
    );
    for row in rows {
        let _ = writeln!(text, "| {} |", row.cells().join(" | "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: &str = r#"{"verdict": "cannot_tell", "alternatives":
        [{"kinds": ["gravity"]}, {"kinds": ["end_stop"]}]}"#;

    fn row(kind: &str, first: &str, last: &str, experiments: usize) -> Decided {
        Decided {
            kind: kind.into(),
            seed: 1,
            went: Ok(Answers {
                first: Verdict::parse(first).unwrap(),
                last: Verdict::parse(last).unwrap(),
                experiments,
            }),
        }
    }

    #[test]
    fn what_is_decided_is_counted_and_what_is_decided_wrongly() {
        let named = |kind: &str, probability: f64| {
            format!(
                r#"{{"verdict": "effect_found",
                    "effects": [{{"kind": "{kind}", "probability": {probability}}}]}}"#
            )
        };
        let failed = Decided {
            kind: "leak".into(),
            seed: 2,
            went: Err("rig took\n|too long".into()),
        };
        let rows = [
            row("gravity", OPEN, &named("gravity", 0.99), 1),
            row("end_stop", OPEN, &named("gravity", 0.97), 2),
            row("end_stop", OPEN, OPEN, 0),
            row("leak", &named("leak", 1.0), &named("leak", 1.0), 0),
            failed,
        ];
        let said = summary(&rows);
        assert!(
            said.contains(
                "After one session: 1 of 5 named rightly, 4 named or in a small answer, 0"
            ),
            "{said}"
        );
        assert!(
            said.contains(
                "After the experiments: 2 of 5 named rightly, 3 named or in a small answer, 1"
            ),
            "{said}"
        );
        assert!(
            said.contains("Of 3 that one session could not tell, 2 were decided. 1 were wrong"),
            "{said}"
        );
        assert!(said.contains("1 did not go through"), "{said}");
        let page = page("1..2", &rows);
        let table: Vec<&str> = page.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(table.len(), 7);
        assert!(
            table.iter().all(|line| line.matches('|').count() == 8),
            "{table:?}"
        );
        assert!(
            page.contains(
                "| end stop | 1 | in the answer set | 2 | WRONG NAME | gravity | 0.970 |"
            ),
            "{page}"
        );
    }
}
