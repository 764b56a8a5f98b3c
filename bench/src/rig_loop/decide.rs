//! Do the experiments that `softrig` proposes decide?
//!
//! For every effect of the catalogue an actuator is drawn that hides it, one session is recorded
//! on the virtual rig, and diagnosed. Where that cannot tell, `softrig next` makes the experiments
//! that it proposes, two at most, on the same actuator. Counted is what stands in the answer after
//! one session and after the last.

use std::path::{Path, PathBuf};
use std::process::Command;

use clap::Args;
use model_core::catalogue::Kind;
use rayon::prelude::*;
use serde_json::{Value, json};

use super::bench::{DIAGNOSE_LIMIT, RECORD_LIMIT, Score, Seeds, answer, board, logged, workers};
use softrig_tests::rig_loop::{Drawn, Folder, Programs, diagnose, record};
use softrig_tests::verdict::{Kinds, Verdict};

/// Experiments at most.
const MOST: u32 = 2;

/// What is stated with at least this should be right.
const SURE: f64 = 0.95;

/// Do the experiments that `softrig` proposes decide what one session cannot tell?
///
/// For each effect an actuator is drawn that hides it. One session is recorded on the virtual
/// rig and diagnosed; where it cannot tell, `softrig next` makes the experiments, two at most.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  cargo xtask bench decide --seeds 1 --only gravity,end_stop
  cargo xtask bench decide --seeds 5301..5302 --docs")]
pub struct Options {
    #[command(flatten)]
    programs: Programs,
    /// Seeds of each effect: a range with both ends, 5301..5302, or a list, 1,5,9
    #[arg(long, value_parser = Seeds::parse)]
    seeds: Seeds,
    /// Only these effects, with commas
    #[arg(long, value_name = "KIND,…", value_delimiter = ',')]
    only: Vec<String>,
    /// Cases at a time [default: half the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Where the files of the cases go [default: decide in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

impl Options {
    /// Runs every effect with each seed.
    ///
    /// # Errors
    ///
    /// If an effect is not known; a case that does not go through is a row of the table.
    pub fn measure(&self, folder: &Path) -> Result<Value, String> {
        let folder = self.folder.as_deref().unwrap_or(folder);
        let known: Vec<&str> = Kind::NAMES.iter().map(|kind| kind.name()).collect();
        if let Some(other) = self.only.iter().find(|it| !known.contains(&it.as_str())) {
            return Err(format!(
                "there is no effect {other}; known are {}",
                known.join(", ")
            ));
        }
        let cases: Vec<(&str, u64)> = known
            .into_iter()
            .filter(|kind| self.only.is_empty() || self.only.iter().any(|it| it == kind))
            .flat_map(|kind| self.seeds.each.iter().map(move |&seed| (kind, seed)))
            .collect();
        let case = |&(kind, seed): &(&str, u64)| {
            let row = Decided::of(&self.programs, kind, seed, folder);
            eprintln!("{}", row.figures());
            row
        };
        let workers = workers(self.jobs)?;
        let rows: Vec<Decided> =
            workers.install(|| cases.par_iter().with_max_len(1).map(case).collect());
        Ok(figures(&self.seeds.asked, &rows))
    }
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
    fn of(programs: &Programs, kind: &str, seed: u64, folder: &Path) -> Self {
        let folder = Folder::clear(folder.join(format!("{kind}_{seed}")));
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

    fn figures(&self) -> Value {
        let mut row = json!({ "hidden": self.kind.replace('_', " "), "seed": self.seed });
        match &self.went {
            Ok(went) => {
                row["first"] = json!(Score::of(&self.hidden(), &went.first));
                row["experiments"] = went.experiments.into();
                row["last"] = json!(Score::of(&self.hidden(), &went.last));
                row["answer"] = answer(&went.last).into();
                row["probability"] = went.last.probability().into();
            }
            Err(why) => row["failed"] = why.as_str().into(),
        }
        row
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

/// The rows, and how many there are of a kind.
fn figures(seeds: &str, rows: &[Decided]) -> Value {
    let scores: Vec<[Score; 2]> = rows.iter().filter_map(Decided::scores).collect();
    let counts = [0, 1].map(|when| {
        let count = |wanted: &[Score]| {
            let of = scores.iter().filter(|it| wanted.contains(&it[when]));
            of.count()
        };
        json!({
            "named": count(&[Score::Named]), "answered": count(&[Score::Named, Score::Among]),
            "wrong": count(&[Score::Wrong]),
        })
    });
    let [first, last] = counts;
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
    json!({
        "benchmark": "decide", "seeds": seeds, "first": first, "last": last, "open": open,
        "decided": decided.count(), "surely_wrong": surely_wrong.count(), "sure": SURE,
        "failed": rows.len() - scores.len(),
        "cases": rows.iter().map(Decided::figures).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::render;

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
        let said = render(&figures("1..2", &rows)).unwrap();
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
        let page = said;
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
