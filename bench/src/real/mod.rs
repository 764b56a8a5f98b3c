//! Recordings of real rigs: the diagnosis, compared with black-box models on the validation
//! recordings.
//!
//! The recordings are not part of the project; see [`shared_folder`].
//! [`rigs`] says what they are and what is known of them, [`results`] reads what was found;
//! the page and [`picture`] show it.

mod page;
pub mod picture;
pub mod results;
pub mod rigs;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use clap::Args;

use crate::invariance::cases::Case;
use page::{page, plain_table, summary};
use picture::Picture;
use results::{BlackBoxes, Seconds};
use rigs::Rig;
use softrig_tests::process::{root, succeed};
use softrig_tests::rig_loop::effects;
use softrig_tests::shared_folder;
use softrig_tests::verdict::{Verdict, significant};

/// The command that writes the page.
const COMMAND: &str = "cargo xtask bench real --docs";
/// How long a diagnosis may take.
const DIAGNOSE_LIMIT: Duration = Duration::from_secs(3_600);
/// How long the black boxes of one rig may take.
const BLACK_BOX_LIMIT: Duration = Duration::from_secs(1_800);
/// How long a fit or a simulation may take.
const SHORT_LIMIT: Duration = Duration::from_secs(180);

/// What to run.
#[derive(Args, Debug)]
pub struct Options {
    /// Only these rigs
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    only: Vec<String>,
    /// Write docs/real.md and its pictures
    #[arg(long, conflicts_with = "only")]
    docs: bool,
    /// The program to ask
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    rig: PathBuf,
    /// A Python with what bench/black_box needs
    #[arg(long, value_name = "PATH")]
    python: PathBuf,
    /// Where the results of each rig go
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/real",
        overrides_with = "folder"
    )]
    folder: PathBuf,
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
}

/// The results of one rig.
#[derive(Debug)]
struct RigResult {
    rig: Rig,
    /// The diagnosis with its time, or why there is none.
    diagnosis: Result<(Verdict, Seconds), String>,
    /// The black boxes, or why there are none.
    black_boxes: Result<BlackBoxes, String>,
}

/// Runs diagnosis and black boxes for each rig.
///
/// # Errors
///
/// If there are no recordings, or a file cannot be written; a rig that cannot be diagnosed is a
/// row of the table.
pub fn bench(options: &Options) -> Result<(), String> {
    let data = shared_folder().join("data/real");
    let (present, missing): (Vec<_>, Vec<_>) = options
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
        if present.is_empty() || options.docs {
            return Err(text);
        }
        println!("bench: {text}");
    }
    let bench = Bench {
        data,
        rig: absolute(&options.rig)?,
        options,
    };
    let mut rows = Vec::new();
    for rig in present {
        println!("bench: {}", rig.name);
        let row = bench.row(rig);
        let problems = [row.diagnosis.as_ref().err(), row.black_boxes.as_ref().err()];
        for problem in problems.into_iter().flatten() {
            println!("  {problem}");
        }
        rows.push(row);
    }
    println!("\n{}\n{}", plain_table(&rows), summary(&rows));
    if options.docs {
        for row in &rows {
            bench.draw(row)?;
        }
        let path = root().join("docs/real.md");
        fs::write(&path, page(&rows))
            .map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        println!("table and pictures: docs/real.md");
    }
    Ok(())
}

fn absolute(path: &Path) -> Result<PathBuf, String> {
    path.canonicalize()
        .map_err(|error| format!("{}: {error}", path.display()))
}

/// Programs and folders.
struct Bench<'a> {
    data: PathBuf,
    rig: PathBuf,
    options: &'a Options,
}

impl Bench<'_> {
    fn row(&self, rig: Rig) -> RigResult {
        let folder = self.folder(&rig);
        // Results of an earlier run would be taken for those of this one.
        let _ = fs::remove_dir_all(&folder);
        let made = fs::create_dir_all(&folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()));
        let case = made.and_then(|()| self.case(&rig));
        let case = || case.as_ref().map_err(Clone::clone);
        RigResult {
            diagnosis: case().and_then(|case| self.diagnose(case, &folder)),
            black_boxes: case().and_then(|case| self.black_boxes(case, &folder)),
            rig,
        }
    }

    /// Where the results of a rig are left.
    fn folder(&self, rig: &Rig) -> PathBuf {
        self.options.folder.join(&rig.name)
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
        let (clock, before) = (Instant::now(), children_cpu());
        succeed(&mut command, DIAGNOSE_LIMIT, &folder.join("diagnose.txt"))?;
        let seconds = Seconds {
            wall: clock.elapsed().as_secs_f64(),
            cpu: children_cpu()
                .zip(before)
                .map(|(after, before)| after - before),
        };
        Ok((Verdict::read(&verdict)?, seconds))
    }

    fn black_boxes(&self, case: &Case, folder: &Path) -> Result<BlackBoxes, String> {
        let results = folder.join("black_boxes.json");
        let mut command = Command::new(&self.options.python);
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

    /// Draws the validation run on which the refit misses most.
    fn draw(&self, row: &RigResult) -> Result<(), String> {
        let Ok((verdict, _)) = &row.diagnosis else {
            return Ok(());
        };
        let rig = &row.rig;
        let case = self.case(rig)?;
        let folder = self.folder(rig);
        let refit = folder.join("refit.toml");
        let repaired = folder.join("repaired.toml");
        let mut command = Command::new(&self.rig);
        command.arg("fit").arg("--model").arg(&case.model);
        command.args(&case.recordings).arg("-o").arg(&refit);
        succeed(&mut command, SHORT_LIMIT, &folder.join("fit.txt"))?;
        let is_repaired = effects(&repaired)? != effects(&case.model)?;
        let picture = Picture {
            title: format!("{}: {}", rig.page.title, verdict.heading()),
            subtitle: subtitle(verdict, is_repaired),
            quantity: &rig.page.quantity,
            command: COMMAND,
            refit: self.simulated(&refit, "refit", &folder, &case.holdout)?,
            repaired: if is_repaired {
                self.simulated(&repaired, "repaired", &folder, &case.holdout)?
            } else {
                Vec::new()
            },
        };
        picture.draw(&root().join(format!("docs/images/real_{}.svg", rig.name)))
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

/// The subtitle of a picture.
fn subtitle(verdict: &Verdict, is_repaired: bool) -> String {
    let number = |value: Option<f64>| value.map_or("–".into(), significant);
    let held_out = &verdict.holdout_rmse_deg;
    let mut text = format!(
        "RMS error on all validation runs: {} refitted",
        number(held_out.refit)
    );
    if is_repaired {
        text += &format!(", {} repaired", number(held_out.repaired));
    }
    text
}

/// Processor time (s) of the processes that were started here and have ended; none where
/// the system does not keep it in a file.
pub fn children_cpu() -> Option<f64> {
    cpu_of_children(&fs::read_to_string("/proc/self/stat").ok()?)
}

/// From the text of Linux's `/proc/self/stat` (proc(5)): fields 16 and 17, counted after
/// the name in parentheses, in hundredths of a second.
fn cpu_of_children(stat: &str) -> Option<f64> {
    const TICKS_PER_SECOND: f64 = 100.0;
    const USER: usize = 13;
    let (_, fields) = stat.rsplit_once(')')?;
    let mut fields = fields.split_whitespace().skip(USER);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some((ticks()? + ticks()?) / TICKS_PER_SECOND)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[test]
    fn options_are_read() {
        #[derive(Debug, clap::Parser)]
        struct Line {
            #[command(flatten)]
            options: Options,
        }
        let parse = |line: &str| {
            let line = format!("real --softrig a/rig --python python {line}");
            Line::try_parse_from(line.split_whitespace()).map(|line| line.options)
        };
        let options = parse("--only pendulum,silverbox --softrig b/rig").unwrap();
        assert_eq!(options.rigs().unwrap().len(), 2);
        assert_eq!(options.rig, Path::new("b/rig"));
        assert!(parse("--docs").unwrap().docs);
        for line in ["--only", "--docs --only pendulum", "--jobs 1"] {
            assert!(parse(line).is_err(), "{line}");
        }
        let unknown = parse("--only rocket").unwrap().rigs().unwrap_err();
        assert!(unknown.contains("there are pendulum"), "{unknown}");
    }

    #[test]
    fn processor_time_is_read() {
        let stat = "12 (a (b) c) S 1 2 3 4 5 6 7 8 9 10 11 12 250 50 20 0";
        assert_eq!(cpu_of_children(stat), Some(3.0));
        assert_eq!(cpu_of_children("12 a"), None);
        assert_eq!(cpu_of_children("1 (a) S 1"), None);
    }
}
