//! Recordings of real rigs: the diagnosis, compared with black-box models on the validation
//! recordings.
//!
//! The recordings are not part of the project; see [`shared_folder`].
//! [`rigs`] says what they are and what is known of them, [`results`] reads what was found.

pub mod results;
pub mod rigs;
pub mod validation;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Value, json};

use crate::invariance::cases::Case;
use crate::processor::{self, Of};
use results::{BlackBox, BlackBoxes, Seconds};
use rigs::Rig;
use softrig_tests::process::{root, succeed};
use softrig_tests::rig_loop::effects;
use softrig_tests::shared_folder;
use softrig_tests::verdict::Verdict;
use validation::Validation;

/// How long a diagnosis may take.
const DIAGNOSE_LIMIT: Duration = Duration::from_secs(3_600);
/// How long the black boxes of one rig may take.
const BLACK_BOX_LIMIT: Duration = Duration::from_secs(1_800);
/// How long a fit or a simulation may take.
const SHORT_LIMIT: Duration = Duration::from_secs(180);

/// Does the diagnosis find in others' rigs what its authors report?
///
/// Diagnoses the recordings of eight real rigs, and compares the repaired models with
/// black-box models on the validation recordings.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  cargo xtask bench real --only pendulum,silverbox
  cargo xtask bench real --docs")]
pub struct Options {
    /// Only these rigs
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "NAME",
        conflicts_with = "docs"
    )]
    only: Vec<String>,
    /// The program to ask
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    rig: PathBuf,
    /// A Python with what bench/black_box needs
    #[arg(long, value_name = "PATH")]
    python: PathBuf,
    /// Where the results of each rig go [default: real in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
}

impl Options {
    /// The rigs that are asked for.
    fn rigs(&self) -> Result<Vec<Rig>, String> {
        let mut rigs = rigs::all()?;
        for name in &self.only {
            if !rigs.iter().any(|rig| rig.name == *name) {
                let known: Vec<&str> = rigs.iter().map(|rig| rig.name.as_str()).collect();
                return Err(format!(
                    "there is no rig {name:?}; there are {}",
                    known.join(", ")
                ));
            }
        }
        rigs.retain(|rig| self.only.is_empty() || self.only.contains(&rig.name));
        Ok(rigs)
    }

    /// Runs diagnosis and black boxes for each rig.
    ///
    /// # Errors
    ///
    /// If there are no recordings, for the documentation if any rig has none, or a validation run cannot be simulated; a
    /// rig that cannot be diagnosed is a row of the table.
    pub fn measure(&self, folder: &Path, docs: bool) -> Result<Value, String> {
        let data = shared_folder().join("data/real");
        let (present, missing): (Vec<_>, Vec<_>) = self
            .rigs()?
            .into_iter()
            .partition(|rig| data.join(&rig.name).join("model.toml").is_file());
        if let Some(first) = missing.first() {
            let names: Vec<&str> = missing.iter().map(|rig| rig.name.as_str()).collect();
            let text = format!(
                "no recordings of {} in {}\n\
                 They are others' and not part of this repository. docs/real.md says where each is \
                 from, docs/formats.md how to convert it; {first} takes model.toml, \
                 recordings/*.csv and, for most, holdout/*.csv. SOFTRIG_SHARED names the folder \
                 that holds data/real.",
                names.join(", "),
                data.display(),
                first = data.join(&first.name).display(),
            );
            if present.is_empty() || docs {
                return Err(text);
            }
            eprintln!("bench: {text}");
        }
        let bench = Bench {
            data,
            rig: absolute(&self.rig)?,
            python: &self.python,
            folder: self.folder.as_deref().unwrap_or(folder),
        };
        let rows = present.into_iter().map(|rig| {
            eprintln!("bench: {}", rig.name);
            bench.row(rig)
        });
        Ok(figures(&rows.collect::<Result<Vec<_>, _>>()?))
    }
}

/// The results of one rig.
#[derive(Debug)]
struct RigResult {
    rig: Rig,
    /// The diagnosis with its time, or why there is none.
    diagnosis: Result<(Verdict, Seconds), String>,
    /// The black boxes, or why there are none.
    black_boxes: Result<BlackBoxes, String>,
    /// The validation run that is shown, where there is a diagnosis.
    validation: Option<Validation>,
}

impl RigResult {
    fn figures(&self) -> Value {
        let diagnosis = match &self.diagnosis {
            Ok((diagnosed, seconds)) => json!({
                "answer": diagnosed.in_a_cell(), "heading": diagnosed.heading(),
                "report": diagnosed.report(), "closure": diagnosed.closed(),
                "nominal": diagnosed.holdout_rmse_deg.nominal,
                "refit": diagnosed.holdout_rmse_deg.refit,
                "repaired": diagnosed.holdout_rmse_deg.repaired,
                "ratio": diagnosed.ratio(), "seconds": seconds,
            }),
            Err(why) => json!({ "failed": why }),
        };
        let black_boxes = match &self.black_boxes {
            Ok(boxes) => json!(boxes),
            Err(why) => json!({ "failed": why }),
        };
        json!({
            "name": self.rig.name, "control": self.rig.known.control, "page": self.rig.page,
            "diagnosis": diagnosis, "black_boxes": black_boxes, "validation": self.validation,
        })
    }
}

/// The results of all rigs, and how many there are of a kind.
fn figures(rows: &[RigResult]) -> Value {
    let count = |control: bool, holds: fn(&Verdict) -> bool| {
        let rows = rows.iter().filter(|row| row.rig.known.control == control);
        let rows = rows.filter_map(|row| row.diagnosis.as_ref().ok());
        rows.filter(|(diagnosed, _)| holds(diagnosed)).count()
    };
    // Repaired model and best black box that is allowed as much.
    let pairs: Vec<(f64, f64)> = rows
        .iter()
        .filter_map(|row| {
            let repaired = row.diagnosis.as_ref().ok()?.0.holdout_rmse_deg.repaired?;
            let BlackBoxes { arx, narx, .. } = row.black_boxes.as_ref().ok()?;
            let errors = |model: &BlackBox| [model.rms(), model.with_freedom];
            let errors = [errors(arx), errors(narx)].concat().into_iter().flatten();
            Some((repaired, errors.fold(f64::INFINITY, f64::min)))
        })
        .collect();
    json!({
        "benchmark": "real",
        "controls": rows.iter().filter(|row| row.rig.known.control).count(),
        "named": count(false, Verdict::names_something),
        "controls_named": count(true, Verdict::names_something),
        "controls_lacking_nothing": count(true, Verdict::lacks_nothing),
        "compared": pairs.len(),
        "better": pairs.iter().filter(|(ours, theirs)| ours <= theirs).count(),
        "rigs": rows.iter().map(RigResult::figures).collect::<Vec<_>>(),
    })
}

fn absolute(path: &Path) -> Result<PathBuf, String> {
    path.canonicalize()
        .map_err(|error| format!("{}: {error}", path.display()))
}

/// Programs and folders.
struct Bench<'a> {
    data: PathBuf,
    rig: PathBuf,
    python: &'a Path,
    folder: &'a Path,
}

impl Bench<'_> {
    fn row(&self, rig: Rig) -> Result<RigResult, String> {
        let folder = self.folder.join(&rig.name);
        // Results of an earlier run would be taken for those of this one.
        let _ = fs::remove_dir_all(&folder);
        let made = fs::create_dir_all(&folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()));
        let case = made.and_then(|()| self.case(&rig));
        let case = case.as_ref();
        let diagnosis = case
            .map_err(Clone::clone)
            .and_then(|case| self.diagnose(case, &folder));
        let validation = match (&diagnosis, case) {
            (Ok(_), Ok(case)) => Some(self.validation(case, &folder)?),
            _ => None,
        };
        Ok(RigResult {
            diagnosis,
            black_boxes: case
                .map_err(Clone::clone)
                .and_then(|case| self.black_boxes(case, &folder)),
            validation,
            rig,
        })
    }

    /// Model and recordings of a rig.
    fn case(&self, rig: &Rig) -> Result<Case, String> {
        let case = Case::read(&self.data.join(&rig.name), Some(&rig.known))?;
        if case.holdout.is_empty() {
            return Err(format!("{} has no recordings for validation", rig.name));
        }
        Ok(case)
    }

    fn diagnose(&self, case: &Case, folder: &Path) -> Result<(Verdict, Seconds), String> {
        let verdict = folder.join("verdict.json");
        let mut command = Command::new(&self.rig);
        command
            .arg("diagnose")
            .arg("--model")
            .arg(&case.model)
            .args(&case.recordings)
            .arg("--holdout")
            .args(&case.holdout)
            .arg("--json")
            .arg(&verdict)
            .arg("-o")
            .arg(folder.join("repaired.toml"));
        let (clock, before) = (Instant::now(), processor::seconds(Of::Children));
        succeed(&mut command, DIAGNOSE_LIMIT, &folder.join("diagnose.txt"))?;
        let seconds = Seconds {
            wall: clock.elapsed().as_secs_f64(),
            cpu: processor::seconds(Of::Children)
                .zip(before)
                .map(|(after, before)| after - before),
        };
        Ok((Verdict::read(&verdict)?, seconds))
    }

    fn black_boxes(&self, case: &Case, folder: &Path) -> Result<BlackBoxes, String> {
        let results = folder.join("black_boxes.json");
        let mut command = Command::new(self.python);
        command
            .arg(root().join("bench/black_box/black_box.py"))
            .arg("--fit")
            .args(&case.recordings)
            .arg("--holdout")
            .args(&case.holdout)
            .arg("--json")
            .arg(&results);
        let log = folder.join("black_boxes.txt");
        succeed(&mut command, BLACK_BOX_LIMIT, &log)?;
        BlackBoxes::read(&results)
    }

    /// The validation run on which the refit misses most.
    fn validation(&self, case: &Case, folder: &Path) -> Result<Validation, String> {
        let refit = folder.join("refit.toml");
        let repaired = folder.join("repaired.toml");
        let mut command = Command::new(&self.rig);
        command.arg("fit").arg("--model").arg(&case.model);
        command.args(&case.recordings).arg("-o").arg(&refit);
        succeed(&mut command, SHORT_LIMIT, &folder.join("fit.txt"))?;
        let is_repaired = effects(&repaired)? != effects(&case.model)?;
        let refit = self.simulated(&refit, "refit", folder, &case.holdout)?;
        let repaired = if is_repaired {
            self.simulated(&repaired, "repaired", folder, &case.holdout)?
        } else {
            Vec::new()
        };
        Validation::of(&refit, &repaired)
    }

    /// The recordings as a model simulates them.
    fn simulated(
        &self,
        model: &Path,
        label: &str,
        folder: &Path,
        recordings: &[PathBuf],
    ) -> Result<Vec<PathBuf>, String> {
        let folder = folder.join(label);
        let each = recordings.iter().map(|recording| {
            let out = folder.join(recording.file_name().unwrap_or_default());
            let mut command = Command::new(&self.rig);
            command.arg("simulate").arg("--model").arg(model);
            command
                .arg("--recording")
                .arg(recording)
                .arg("-o")
                .arg(&out);
            succeed(&mut command, SHORT_LIMIT, &folder.join("simulate.txt"))?;
            Ok(out)
        });
        each.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::{for_terminal, render};
    use crate::real::rigs::all;

    fn rows() -> Vec<RigResult> {
        let mut rigs = all().unwrap();
        let verdict = r#"{"verdict": "effect_found", "effects": [{"kind": "gravity"}],
            "adequacy": {"holdout_gap_closed": 0.955},
            "holdout_rmse_deg": {"nominal": 4.0, "refit": 2.5, "repaired": 0.25}}"#;
        let seconds = Seconds {
            wall: 3.25,
            cpu: Some(6.0),
        };
        let black_box = |rms: Option<f64>, with_freedom: Option<f64>| -> BlackBox {
            serde_json::from_value(serde_json::json!({
                "diverges": rms.is_none(), "rms_deg": rms, "rms_with_freedom_deg": with_freedom,
                "output_lags": [1, 2], "input_lags": [0], "terms": 7, "degree": 3,
                "rate_hz": 50.0, "wall_s": 1.0,
            }))
            .unwrap()
        };
        vec![
            RigResult {
                rig: rigs.remove(0),
                diagnosis: Ok((Verdict::parse(verdict).unwrap(), seconds)),
                black_boxes: Ok(BlackBoxes {
                    arx: black_box(None, None),
                    narx: black_box(Some(0.5), Some(0.3)),
                    sampled_alike: false,
                }),
                validation: None,
            },
            RigResult {
                rig: rigs.remove(6),
                diagnosis: Err("rig | took\ntoo long".into()),
                black_boxes: Err("no numpy".into()),
                validation: None,
            },
        ]
    }

    fn cells(line: &str) -> Vec<&str> {
        line.trim_matches('|').split('|').map(str::trim).collect()
    }

    #[test]
    fn the_table_shows_what_there_is() {
        let text = render(&figures(&rows())).unwrap();
        let table: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        assert_eq!(table.len(), 4);
        assert!(
            table.iter().all(|line| cells(line).len() == 13),
            "{table:?}"
        );
        assert_eq!(
            cells(table[2])[2..],
            [
                "gravity",
                "96 %",
                "4.00",
                "2.50",
                "0.250",
                "0.100",
                "diverges",
                "0.500",
                "0.300",
                "3.2 (6.0)",
                "1.0 (–) + 1.0 (–)"
            ]
        );
        let cells = cells(table[3]);
        assert_eq!(
            cells[0],
            "[falling_bowling_ball](#falling-bowling-ball) (control)"
        );
        assert_eq!(cells[2], "failed: rig / took too long");
        assert_eq!(cells[8], "failed: no numpy");
        assert!(table[2].starts_with("| [pendulum](#pendulum) |"));
        assert!(text.contains("](images/real_pendulum.svg)"));
        assert!(!text.contains("](images/real_falling_bowling_ball.svg)"));
        assert!(
            text.contains(" ARX: past outputs 2, inputs 1, terms 7 (degree 3), at 50.0 Hz; NARX: ")
        );
        let columns = |line: &str| line.find("gravity");
        assert_eq!(for_terminal(&text).lines().filter_map(columns).count(), 2);
    }

    #[test]
    fn rigs_are_chosen_by_name() {
        let named = |only: &str| Options {
            only: only.split(',').map(str::to_owned).collect(),
            rig: PathBuf::new(),
            python: PathBuf::new(),
            folder: None,
        };
        assert_eq!(named("pendulum,silverbox").rigs().unwrap().len(), 2);
        let unknown = named("rocket").rigs().unwrap_err();
        assert!(unknown.contains("there are pendulum"), "{unknown}");
    }

    #[test]
    fn the_summary_counts_names_and_wins() {
        let text = render(&figures(&rows())).unwrap();
        assert!(
            text.contains("for 1 of 1 rigs with something known and for 0 of 1 controls"),
            "{text}"
        );
        assert!(text.contains("on 1 of 1.\n"), "{text}");
    }
}
