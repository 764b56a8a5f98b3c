//! Recordings of real rigs: the diagnosis, compared with black-box models on the validation
//! recordings.
//!
//! The recordings are not part of the project; see [`shared`].

mod page;
mod results;
mod rigs;

use std::{
    env, fs,
    path::{Path, PathBuf},
    process::Command,
    time::{Duration, Instant},
};

use crate::{
    bench_loop::reason,
    json::Value,
    rig_loop::effect_kinds,
    shell::{Failure, Outcome, cargo, read_within, root, run, target_dir},
    venv,
};
use page::{page, plain_table, summary};
use results::{BlackBox, Diagnosed, Seconds, significant};
use rigs::{RIGS, Rig, Split};

/// The command that writes the page.
const COMMAND: &str = "cargo xtask bench real --docs";
/// How long a diagnosis may take.
const DIAGNOSE_LIMIT: Duration = Duration::from_secs(3_600);
/// How long the black boxes of one rig may take.
const BLACK_BOX_LIMIT: Duration = Duration::from_secs(1_800);
/// How long a fit or a simulation may take.
const SHORT_LIMIT: Duration = Duration::from_secs(180);

/// What to run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// Names of rigs; all if empty.
    only: Vec<String>,
    /// Whether the page in the documentation is written.
    docs: bool,
    /// A `rig` to take instead of building one.
    rig: Option<PathBuf>,
}

impl Options {
    /// Reads them from the command line.
    ///
    /// # Errors
    ///
    /// Says what makes no sense.
    pub fn parse(words: &[&str]) -> Result<Self, String> {
        let mut options = Self::default();
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            if word == "--docs" {
                options.docs = true;
                continue;
            }
            let value = *words
                .next()
                .ok_or_else(|| format!("bench real: {word} needs a value, or is not known"))?;
            match word {
                "--only" => options.only = value.split(',').map(str::to_owned).collect(),
                "--rig" => options.rig = Some(value.into()),
                _ => return Err(format!("bench real: there is no option {word}")),
            }
        }
        for name in &options.only {
            if !RIGS.iter().any(|rig| rig.name == name) {
                let known: Vec<&str> = RIGS.iter().map(|rig| rig.name).collect();
                return Err(format!(
                    "bench real: there is no rig {name:?}; there are {}",
                    known.join(", ")
                ));
            }
        }
        if options.docs && !options.only.is_empty() {
            return Err("bench real: --docs writes a page of all rigs; leave --only out".into());
        }
        Ok(options)
    }

    fn wants(&self, rig: &Rig) -> bool {
        self.only.is_empty() || self.only.iter().any(|name| name == rig.name)
    }
}

/// The folder of real recordings: beside the project, or where `SOFTRIG_SHARED` says. The
/// tests look in the same place.
pub fn shared() -> PathBuf {
    env::var_os("SOFTRIG_SHARED")
        .map_or_else(|| root().join("../shared"), PathBuf::from)
        .join("data/real")
}

/// The results of one rig.
#[derive(Debug)]
struct Row {
    rig: &'static Rig,
    /// The diagnosis with its time, or why there is none.
    diagnosis: Result<(Diagnosed, Seconds), String>,
    /// The black boxes, or why there are none.
    black_boxes: Result<BlackBoxes, String>,
}

/// Both black boxes of one rig.
#[derive(Debug)]
struct BlackBoxes {
    arx: BlackBox,
    narx: BlackBox,
    /// Whether all recordings have one sampling rate.
    sampled_alike: bool,
}

/// Runs diagnosis and black boxes for each rig.
pub fn bench(options: &Options) -> Outcome {
    let data = shared();
    let wanted: Vec<&'static Rig> = RIGS.iter().filter(|rig| options.wants(rig)).collect();
    let (present, missing): (Vec<_>, Vec<_>) = wanted
        .into_iter()
        .partition(|rig| data.join(rig.name).join("model.toml").is_file());
    if let Some(first) = missing.first() {
        let names: Vec<&str> = missing.iter().map(|rig| rig.name).collect();
        let text = format!(
            "no recordings of {} in {}\n\
             They are others' and not part of this repository. docs/real.md says where each is \
             from, docs/formats.md how to convert it; {first} takes model.toml, \
             recordings/*.csv and, for most, holdout/*.csv. SOFTRIG_SHARED names the folder \
             that holds data/real.",
            names.join(", "),
            data.display(),
            first = data.join(first.name).display(),
        );
        if present.is_empty() || options.docs {
            return Err(text.into());
        }
        println!("bench: {text}");
    }
    let bench = Bench::prepare(options, data)?;
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

/// Programs and folders.
struct Bench {
    data: PathBuf,
    rig: PathBuf,
    python: PathBuf,
    script: PathBuf,
    out: PathBuf,
}

impl Bench {
    fn prepare(options: &Options, data: PathBuf) -> Outcome<Self> {
        let rig = if let Some(rig) = &options.rig {
            rig.canonicalize()
                .map_err(|error| format!("--rig {}: {error}", rig.display()))?
        } else {
            run(cargo()
                .args(["build", "-q", "--release", "--locked", "-p", "host-tools"])
                .args(["--bin", "rig"]))?;
            target_dir().join("release/rig")
        };
        let out = target_dir().join("real");
        fs::create_dir_all(&out)
            .map_err(|error| format!("cannot make {}: {error}", out.display()))?;
        let scripts = root().join("tests/black_box");
        let requirements = scripts.join("requirements.txt");
        // An environment of older versions is not the pinned one.
        let imports = format!(
            "import numpy; assert f'numpy=={{numpy.__version__}} ' in open({:?}).read()",
            requirements.display().to_string()
        );
        let python = venv::virtual_environment(
            &out.join("python"),
            &imports,
            &[
                "--require-hashes".into(),
                "-r".into(),
                requirements.into_os_string(),
            ],
        )?;
        let script = scripts.join("black_box.py");
        println!("bench: black boxes find known systems again");
        run(Command::new(&python).arg(&script).arg("--self-check"))?;
        Ok(Self {
            data,
            rig,
            python,
            script,
            out,
        })
    }

    fn row(&self, rig: &'static Rig) -> Row {
        let files = self.files(rig);
        let files = || files.as_ref().map_err(ToString::to_string);
        let why = |failure: Failure| reason(&failure.0);
        Row {
            rig,
            diagnosis: files().and_then(|files| self.diagnose(rig, files).map_err(why)),
            black_boxes: files().and_then(|files| self.black_boxes(rig, files).map_err(why)),
        }
    }

    /// Where the results of a rig are left.
    fn folder(&self, rig: &Rig) -> PathBuf {
        self.out.join(rig.name)
    }

    /// Fitted and validation recordings; the folder of results is made anew.
    fn files(&self, rig: &Rig) -> Outcome<[Vec<PathBuf>; 2]> {
        let folder = self.folder(rig);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
        recordings(&self.data.join(rig.name), &rig.split)
    }

    fn diagnose(
        &self,
        rig: &Rig,
        [fit, holdout]: &[Vec<PathBuf>; 2],
    ) -> Outcome<(Diagnosed, Seconds)> {
        let folder = self.folder(rig);
        let verdict = folder.join("verdict.json");
        let mut command = Command::new(&self.rig);
        command
            .arg("diagnose")
            .arg("--model")
            .arg(self.data.join(rig.name).join("model.toml"))
            .args(fit)
            .arg("--holdout")
            .args(holdout)
            .arg("--json")
            .arg(&verdict)
            .arg("-o")
            .arg(folder.join("repaired.toml"));
        let (said, seconds) = timed(&mut command, DIAGNOSE_LIMIT);
        let said = said?;
        // What a command said is worth keeping and not worth failing for.
        let _ = fs::write(folder.join("diagnose.txt"), said);
        let text = fs::read_to_string(&verdict)
            .map_err(|error| format!("cannot read {}: {error}", verdict.display()))?;
        let diagnosed = Diagnosed::parse(&text)
            .ok_or_else(|| format!("{} is no verdict", verdict.display()))?;
        Ok((diagnosed, seconds))
    }

    fn black_boxes(&self, rig: &Rig, [fit, holdout]: &[Vec<PathBuf>; 2]) -> Outcome<BlackBoxes> {
        let results = self.folder(rig).join("black_boxes.json");
        let mut command = Command::new(&self.python);
        command
            .arg(&self.script)
            .arg("--fit")
            .args(fit)
            .arg("--holdout")
            .args(holdout)
            .arg("--json")
            .arg(&results);
        read_within(&mut command, BLACK_BOX_LIMIT)?;
        let text = fs::read_to_string(&results)
            .map_err(|error| format!("cannot read {}: {error}", results.display()))?;
        Value::parse(&text)
            .and_then(|json| {
                Some(BlackBoxes {
                    arx: BlackBox::parse(&json, "arx")?,
                    narx: BlackBox::parse(&json, "narx")?,
                    sampled_alike: json.get("sampled_alike") == Some(&Value::Bool(true)),
                })
            })
            .ok_or_else(|| format!("{} holds no black boxes", results.display()).into())
    }

    /// Draws the validation run on which the refit misses most.
    fn draw(&self, row: &Row) -> Outcome {
        let Ok((diagnosed, _)) = &row.diagnosis else {
            return Ok(());
        };
        let [fit, holdout] = recordings(&self.data.join(row.rig.name), &row.rig.split)?;
        let folder = self.folder(row.rig);
        let nominal = self.data.join(row.rig.name).join("model.toml");
        let refit = folder.join("refit.toml");
        let repaired = folder.join("repaired.toml");
        let mut command = Command::new(&self.rig);
        command.arg("fit").arg("--model").arg(&nominal).args(&fit);
        read_within(command.arg("-o").arg(&refit), SHORT_LIMIT)?;
        let effects = |path: &Path| fs::read_to_string(path).map(|text| effect_kinds(&text));
        let is_repaired = effects(&repaired).ok() != effects(&nominal).ok();

        run(cargo()
            .args(["build", "-q", "--locked", "-p", "softrig-tests"])
            .args(["--bin", "real_picture"]))?;
        let mut picture = Command::new(target_dir().join("debug/real_picture"));
        picture
            .arg(root().join(format!("docs/images/real_{}.svg", row.rig.name)))
            .args([
                "--title",
                &format!("{}: {}", row.rig.title, diagnosed.heading()),
            ])
            .args(["--subtitle", &subtitle(diagnosed, is_repaired)])
            .args(["--quantity", row.rig.quantity])
            .args(["--command", COMMAND])
            .arg("--refit")
            .args(self.simulated(&refit, "refit", &folder, &holdout)?);
        if is_repaired {
            picture
                .arg("--repaired")
                .args(self.simulated(&repaired, "repaired", &folder, &holdout)?);
        }
        read_within(&mut picture, SHORT_LIMIT).map(drop)
    }

    /// The recordings as a model simulates them.
    fn simulated(
        &self,
        model: &Path,
        label: &str,
        folder: &Path,
        recordings: &[PathBuf],
    ) -> Outcome<Vec<PathBuf>> {
        let folder = folder.join(label);
        fs::create_dir_all(&folder)
            .map_err(|error| format!("cannot make {}: {error}", folder.display()))?;
        let each = recordings.iter().map(|recording| {
            let out = folder.join(recording.file_name().unwrap_or_default());
            let mut command = Command::new(&self.rig);
            command.arg("simulate").arg("--model").arg(model);
            command.arg("--recording").arg(recording);
            read_within(command.arg("-o").arg(&out), SHORT_LIMIT)?;
            Ok(out)
        });
        each.collect()
    }
}

/// The subtitle of a picture.
fn subtitle(diagnosed: &Diagnosed, is_repaired: bool) -> String {
    let number = |value: Option<f64>| value.map_or("–".into(), significant);
    let mut text = format!(
        "RMS error on all validation runs: {} refitted",
        number(diagnosed.refit)
    );
    if is_repaired {
        text += &format!(", {} repaired", number(diagnosed.repaired));
    }
    text
}

/// Fitted and validation recordings of a rig, in the order of their names.
fn recordings(folder: &Path, split: &Split) -> Outcome<[Vec<PathBuf>; 2]> {
    let list = |name: &str, starts: &[&str]| -> Outcome<Vec<PathBuf>> {
        let folder = folder.join(name);
        let entries = fs::read_dir(&folder)
            .map_err(|error| format!("cannot list {}: {error}", folder.display()))?;
        let mut paths: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| {
                let file = path.file_name().unwrap_or_default().to_string_lossy();
                file.ends_with(".csv") && starts.iter().any(|start| file.starts_with(start))
            })
            .collect();
        paths.sort();
        if paths.is_empty() {
            return Err(format!("no recordings in {}", folder.display()).into());
        }
        Ok(paths)
    };
    match split {
        Split::Folders => Ok([list("recordings", &[""])?, list("holdout", &[""])?]),
        Split::Names { fit, holdout } => {
            Ok([list("recordings", fit)?, list("recordings", holdout)?])
        }
    }
}

/// Runs a command, and says how long it took and how much processor time it used.
fn timed(command: &mut Command, limit: Duration) -> (Outcome<String>, Seconds) {
    let (clock, before) = (Instant::now(), children_cpu());
    let said = read_within(command, limit);
    let seconds = Seconds {
        wall: clock.elapsed().as_secs_f64(),
        cpu: children_cpu()
            .zip(before)
            .map(|(after, before)| after - before),
    };
    (said, seconds)
}

/// Processor time (s) of the processes that were started here and have ended; none where
/// the system does not keep it in a file.
fn children_cpu() -> Option<f64> {
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
    use super::*;

    #[test]
    fn options_are_read() {
        let options = Options::parse(&["--only", "pendulum,silverbox", "--rig", "a/rig"]).unwrap();
        assert_eq!(options.only, ["pendulum", "silverbox"]);
        assert_eq!(options.rig.as_deref(), Some(Path::new("a/rig")));
        let wanted = RIGS.iter().filter(|rig| options.wants(rig)).count();
        assert_eq!(wanted, 2);
        assert!(Options::parse(&["--docs"]).unwrap().docs);
        for words in [
            &["--only"][..],
            &["--only", "rocket"],
            &["--docs", "--only", "pendulum"],
            &["--jobs", "1"],
        ] {
            assert!(Options::parse(words).is_err(), "{words:?}");
        }
    }

    #[test]
    fn processor_time_is_read() {
        let stat = "12 (a (b) c) S 1 2 3 4 5 6 7 8 9 10 11 12 250 50 20 0";
        assert_eq!(cpu_of_children(stat), Some(3.0));
        assert_eq!(cpu_of_children("12 a"), None);
        assert_eq!(cpu_of_children("1 (a) S 1"), None);
    }

    #[test]
    fn recordings_are_split_by_folder_or_name() {
        let folder = env::temp_dir().join(format!("softrig-real-{}", std::process::id()));
        for file in [
            "recordings/id_1.csv",
            "recordings/id_0.csv",
            "recordings/v.csv",
            "holdout/h.csv",
            "holdout/h.meta.toml",
        ] {
            let path = folder.join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        let names = |split: &Split| {
            recordings(&folder, split).unwrap().map(|paths| {
                paths
                    .iter()
                    .map(|p| p.file_stem().unwrap().to_string_lossy().into_owned())
                    .collect::<Vec<_>>()
                    .join(" ")
            })
        };
        assert_eq!(names(&Split::Folders), ["id_0 id_1 v", "h"]);
        let named = Split::Names {
            fit: &["id_"],
            holdout: &["v"],
        };
        assert_eq!(names(&named), ["id_0 id_1", "v"]);
        assert!(
            recordings(
                &folder,
                &Split::Names {
                    fit: &["x"],
                    holdout: &[]
                }
            )
            .is_err()
        );
        fs::remove_dir_all(folder).unwrap();
    }
}
