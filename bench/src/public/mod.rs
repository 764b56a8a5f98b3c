//! Public sets under the rules of their tables.
//!
//! Each set is one `softrig init` on its training record and one `softrig diagnose` with
//! `--start-from`: the whole training record at its full rate chooses structure and parameters, and
//! the test records are simulated once, from where the rules allow. They are not part of the
//! project; see [`shared_folder`]. [`sets`] says what they are.

pub mod sets;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use clap::Args;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::asked::Asked;
use crate::invariance::known::read_json;
use crate::processor::{self, Of};
use crate::real::results::Seconds;
use sets::{Part, Set};
use softrig::statistics::{rms, swing};
use softrig_formats::columns::{Columns, Layout, Names};
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};
use softrig_tests::process::succeed;
use softrig_tests::verdict::Verdict;
use softrig_tests::{shared_folder, text_of, write};

/// How long one command may take.
const LIMIT: Duration = Duration::from_secs(3_600);

/// Options of every diagnosis. Forces that only know the time of their record cannot be told from
/// a trajectory, and say nothing of another record; a name is asked for, and no formula.
const OPTIONS: [&str; 5] = [
    "--without",
    "periodic_disturbance,stiffness_drift,sensor_drift",
    "--no-formulas",
    "--tolerance",
    "0.1",
];

/// `softrig init` thins longer records, which a fast input does not stand.
const FIRST_SAMPLES: usize = 55_000;

/// Public sets under the rules of their tables: our row beside the published ones.
///
/// Fits the whole training record, and simulates the test records from their first samples only.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  cargo xtask bench public
  cargo xtask bench public --only silverbox
  cargo xtask bench public --docs")]
pub struct Options {
    /// Only these sets
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "NAME",
        conflicts_with = "docs"
    )]
    only: Vec<String>,
    #[command(flatten)]
    asked: Asked,
}

impl Options {
    /// Diagnoses each set.
    ///
    /// # Errors
    ///
    /// If there are no records, or a command fails.
    pub fn measure(&self, folder: &Path) -> Result<Value, String> {
        let data = shared_folder().join("data/public");
        let mut sets = sets::all()?;
        for name in &self.only {
            if !sets.iter().any(|set| set.name == *name) {
                let known: Vec<&str> = sets.iter().map(|set| set.name.as_str()).collect();
                let known = known.join(", ");
                return Err(format!("there is no set {name:?}; there are {known}"));
            }
        }
        sets.retain(|set| self.only.is_empty() || self.only.contains(&set.name));
        if !data.is_dir() {
            return Err(format!(
                "there is no folder {}\nThe records are others' and not part of this repository. \
                 docs/public.md says where each is from; SOFTRIG_SHARED names the folder that \
                 holds data/public.",
                data.display()
            ));
        }
        let rig = &self.asked.rig;
        let bench = Bench {
            data,
            rig: rig
                .canonicalize()
                .map_err(|error| format!("{}: {error}", rig.display()))?,
            folder: self.asked.folder(folder),
        };
        let rows = sets.into_iter().map(|set| {
            eprintln!("bench: {}", set.name);
            bench.row(&set)
        });
        let rows = rows.collect::<Result<Vec<Value>, String>>()?;
        Ok(json!({ "benchmark": "public", "options": OPTIONS.join(" "), "sets": rows }))
    }
}

/// The error on a test record over its time, thinned to the ends of what each part of the picture
/// shows.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
pub struct Course {
    /// The record.
    pub name: String,
    /// Times (s).
    pub time_s: Vec<f64>,
    /// What was measured.
    pub measured: Vec<f64>,
    /// Simulated minus measured.
    pub error: Vec<f64>,
}

impl Course {
    /// Parts of the picture.
    const PARTS: usize = 500;

    fn of(name: &str, time: &[f64], measured: &[f64], error: &[f64]) -> Self {
        let mut course = Self {
            name: name.to_owned(),
            ..Self::default()
        };
        let part = time.len().div_ceil(Self::PARTS).max(1);
        for first in (0..time.len()).step_by(part) {
            let range = first..(first + part).min(time.len());
            let by_error = |a: &usize, b: &usize| error[*a].total_cmp(&error[*b]);
            let ends = [range.clone().min_by(by_error), range.max_by(by_error)];
            let mut ends: Vec<usize> = ends.into_iter().flatten().collect();
            ends.sort_unstable();
            ends.dedup();
            for at in ends {
                course.time_s.push(time[at]);
                course.measured.push(measured[at]);
                course.error.push(error[at]);
            }
        }
        course
    }
}

/// What the benchmark reads of a verdict beside its answer.
#[derive(Debug, Deserialize)]
struct Written {
    rmse_deg: Errors,
    test: Vec<Errors>,
}

/// RMS errors.
#[derive(Debug, Deserialize)]
struct Errors {
    refit: f64,
    repaired: f64,
}

/// What the benchmark reads of a fit.
#[derive(Debug, Deserialize)]
struct Fitted {
    rmse_deg: FittedErrors,
}

/// RMS error of a fit.
#[derive(Debug, Deserialize)]
struct FittedErrors {
    fitted: f64,
}

/// A final model that was fitted to the whole record.
struct Refit {
    /// Its RMS error there.
    rmse: f64,
    /// The file with the zeros that it has.
    zeros: PathBuf,
}

/// Programs and folders.
struct Bench<'a> {
    data: PathBuf,
    rig: PathBuf,
    folder: &'a Path,
}

impl Bench<'_> {
    fn row(&self, set: &Set) -> Result<Value, String> {
        let folder = self.folder.join(&set.name);
        // Results of an earlier run would be taken for those of this one.
        let _ = fs::remove_dir_all(&folder);
        let train = self.written(set, &set.train, "train", &folder)?;
        let head = Part {
            count: Some(set.train.count.unwrap_or(usize::MAX).min(FIRST_SAMPLES)),
            ..set.train.clone()
        };
        let head = self.written(set, &head, "first", &folder)?;
        let tests = set.tests.iter();
        let tests = tests
            .map(|test| self.written(set, &test.part, &test.name, &folder))
            .collect::<Result<Vec<PathBuf>, String>>()?;
        zero_is_unknown(&train)?;
        let [first, last] = ["first.toml", "final.toml"].map(|name| folder.join(name));
        let verdict = folder.join("verdict.json");
        let mut init = Command::new(&self.rig);
        init.arg("init").arg("--recording").arg(&head);
        init.args(&set.options).arg("-o").arg(&first);
        let starts: Vec<&str> = set.tests.iter().map(|test| test.start.as_str()).collect();
        let mut diagnose = Command::new(&self.rig);
        diagnose.arg("diagnose").arg("--model").arg(&first);
        diagnose.arg(&train).arg("--holdout").args(&tests);
        diagnose.arg("--start-from").arg(starts.join(","));
        diagnose.args(OPTIONS).args(&set.options);
        if let Some(budget) = &set.budget {
            diagnose.arg("--budget").arg(budget);
        }
        diagnose.arg("--json").arg(&verdict).arg("-o").arg(&last);
        let (clock, before) = (Instant::now(), processor::seconds(Of::Children));
        succeed(&mut init, LIMIT, &folder.join("init.txt"))?;
        succeed(&mut diagnose, LIMIT, &folder.join("diagnose.txt"))?;
        let refit = match &set.budget {
            Some(_) => Some(self.refit(set, &train, &folder)?),
            None => None,
        };
        let cpu = processor::seconds(Of::Children).zip(before);
        let seconds = Seconds {
            wall: clock.elapsed().as_secs_f64(),
            cpu: cpu.map(|(after, before)| after - before),
        };
        let answer = Verdict::read(&verdict)?;
        let written: Written = read_json(&verdict)?;
        let zeros = refit.as_ref().map_or(verdict.as_path(), |it| &it.zeros);
        let mut courses = Vec::new();
        let mut errors: Vec<f64> = written.test.iter().map(|it| it.repaired).collect();
        for (place, (test, path)) in set.tests.iter().zip(&tests).enumerate() {
            let (course, rms) = self.course(set, &test.start, (path, zeros), &folder)?;
            courses.push(course);
            // The verdict knows the model that it has fitted itself.
            if refit.is_some() {
                errors[place] = rms;
            }
        }
        let reached = set.tests.iter().zip(&errors);
        let reached = reached.map(|(test, error)| *error <= test.target);
        Ok(json!({
            "set": set, "name": set.name,
            "starts": set.tests.iter().map(sets::Test::starts).collect::<Vec<String>>(),
            "answer": answer.in_a_cell(), "heading": answer.heading(),
            "is_named": answer.named().contains(&set.expected.as_str()),
            "reached": reached.collect::<Vec<bool>>(),
            "train": refit.map_or(written.rmse_deg.repaired, |it| it.rmse), "train_refit": written.rmse_deg.refit,
            "tests": errors,
            "tests_refit": written.test.iter().map(|it| it.refit).collect::<Vec<f64>>(),
            "parameters": parameters_of(&last)?, "seconds": seconds,
            "courses": courses,
        }))
    }

    /// Fits the final model, with what its effects have in it free, to the whole record.
    fn refit(&self, set: &Set, train: &Path, folder: &Path) -> Result<Refit, String> {
        let [last, free] = ["final.toml", "free.toml"].map(|name| folder.join(name));
        write(&free, &freed(&text_of(&last)?)?)?;
        let zeros = folder.join("fit.json");
        let mut fit = Command::new(&self.rig);
        fit.arg("fit").arg("--model").arg(&free).arg(train);
        fit.args(&set.options).arg("--json").arg(&zeros);
        fit.arg("-o").arg(&last);
        succeed(&mut fit, LIMIT, &folder.join("fit.txt"))?;
        let fitted: Fitted = read_json(&zeros)?;
        Ok(Refit {
            rmse: fitted.rmse_deg.fitted,
            zeros,
        })
    }

    /// Samples of a file as a recording with the columns of `softrig`.
    fn written(
        &self,
        set: &Set,
        part: &Part,
        name: &str,
        folder: &Path,
    ) -> Result<PathBuf, String> {
        let names = format!(
            "time=time_s,pressure={},angle={}",
            set.input.0, set.output.0
        );
        let layout = Layout {
            names: Names::parse(&names)?,
            columns: Columns::default(),
            ..Layout::default()
        };
        let path = self.data.join(&part.file);
        let (all, _) = Recording::read_as(&path, &layout).map_err(|error| error.to_string())?;
        let end = part
            .count
            .map_or(all.len(), |count| part.from.saturating_add(count));
        let mut text = String::from("time_s,pressure_kpa,angle_deg\n");
        for (row, at) in (part.from..end.min(all.len())).enumerate() {
            // The times of the files are rounded.
            text += &format!(
                "{:.7},{:.9e},{:.9e}\n",
                row as f64 / set.rate_hz,
                set.input.1 * all.pressure[at] / PASCAL_PER_KPA,
                set.output.1 * all.angle[at].to_degrees(),
            );
        }
        let path = folder.join(format!("{name}.csv"));
        write(&path, &text)?;
        Ok(path)
    }

    /// The error of the final model on a test record: its course, and its RMS but for the samples
    /// that gave the start.
    fn course(
        &self,
        set: &Set,
        start: &str,
        (test, zeros): (&Path, &Path),
        folder: &Path,
    ) -> Result<(Course, f64), String> {
        let name = test.file_stem().unwrap_or_default().to_string_lossy();
        let out = folder.join(format!("simulated_{name}.csv"));
        let mut command = Command::new(&self.rig);
        command.arg("simulate").arg("--model");
        command.arg(folder.join("final.toml"));
        command.arg("--recording").arg(test);
        command.arg("--start-from").arg(start);
        command.arg("--zeros").arg(zeros);
        command.args(&set.options).arg("-o").arg(&out);
        succeed(&mut command, LIMIT, &folder.join("simulate.txt"))?;
        let (run, _) = Recording::read(&out).map_err(|error| error.to_string())?;
        let predicted = run
            .column("predicted_deg")
            .ok_or_else(|| format!("{}: no column predicted_deg", out.display()))?;
        let measured: Vec<f64> = run.angle.iter().map(|it| it.to_degrees()).collect();
        let pairs = predicted.iter().zip(&measured);
        let error: Vec<f64> = pairs.map(|(ours, measured)| ours - measured).collect();
        let judged = error.get(start.parse().unwrap_or(0)..).unwrap_or_default();
        let course = Course::of(&name, &run.time, &measured, &error);
        Ok((course, rms(judged)))
    }
}

/// The text of a model in which all numbers of its effects are free.
fn freed(text: &str) -> Result<String, String> {
    let mut file: toml_edit::DocumentMut = text
        .parse()
        .map_err(|error: toml_edit::TomlError| error.to_string())?;
    let effects = file
        .get("effect")
        .and_then(toml_edit::Item::as_array_of_tables);
    let names: Vec<String> = effects
        .into_iter()
        .flatten()
        .flat_map(|effect| {
            let kind = effect.get("kind").and_then(toml_edit::Item::as_str);
            let numbers = effect
                .iter()
                .filter(|(_, value)| value.is_float() || value.is_integer());
            let names = numbers.map(|(key, _)| format!("{}.{key}", kind.unwrap_or_default()));
            names.collect::<Vec<_>>()
        })
        .collect();
    let free = file["fit"]["free"].as_array_mut().ok_or("no [fit] free")?;
    free.extend(names);
    Ok(file.to_string())
}

/// Says in the metadata of a record that the zero of its input is not known: a tenth of its range.
fn zero_is_unknown(record: &Path) -> Result<(), String> {
    const SHARE: f64 = 0.1;
    let (recording, _) = Recording::read(record).map_err(|error| error.to_string())?;
    let sd = SHARE * swing(&recording.pressure) / PASCAL_PER_KPA;
    let text = format!("[calibration]\npressure_zero_sd_kpa = {sd:.3}\n");
    write(&record.with_extension("meta.toml"), &text)
}

/// Parameters of a model file: those that were free, all of its effects, and the zeros of input and
/// output. The inertia only sets a scale; initial states are not counted.
fn parameters_of(path: &Path) -> Result<usize, String> {
    let text = text_of(path)?;
    let file: toml::Table =
        toml::from_str(&text).map_err(|error| format!("{}: {error}", path.display()))?;
    let free = file.get("fit").and_then(|fit| fit.get("free"));
    let free = free.and_then(toml::Value::as_array).into_iter().flatten();
    // Those of effects are counted with their effects.
    let of_base = |name: &&toml::Value| name.as_str().is_some_and(|it| !it.contains('.'));
    let free = free.filter(of_base).count();
    let effects = file.get("effect").and_then(toml::Value::as_array);
    let of_effect = |effect: &toml::Value| -> usize {
        let values = effect.as_table().into_iter().flat_map(|it| it.values());
        values
            .map(|value| match value {
                toml::Value::Float(_) | toml::Value::Integer(_) => 1,
                toml::Value::Array(all) => all.len(),
                _ => 0,
            })
            .sum()
    };
    let effects: usize = effects.into_iter().flatten().map(of_effect).sum();
    Ok(free + effects + 2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::render;

    #[test]
    fn the_sets_are_those_of_the_page() {
        let sets = sets::all().unwrap();
        let names: Vec<&str> = sets.iter().map(|set| set.name.as_str()).collect();
        assert_eq!(names, ["emps", "silverbox", "bouc_wen"]);
        for set in &sets {
            let tests = set.tests.len();
            assert!(set.published.iter().all(|it| it.errors.len() == tests));
            let starts = set.tests.iter().map(|it| it.start.parse());
            for start in starts {
                let _: softrig::estimate::start_from::StartFrom = start.unwrap();
            }
        }
    }

    #[test]
    fn parameters_are_counted_with_zeros() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.toml");
        let text =
            "[fit]\nfree = [\"damping\", \"x.force_n\"]\n[[effect]]\nkind = \"x\"\nforce_n = 1.0\n";
        fs::write(&path, text).unwrap();
        assert_eq!(parameters_of(&path).unwrap(), 4);
    }

    #[test]
    fn the_numbers_of_effects_are_set_free() {
        let text = "[fit]\nfree = [\"damping\"]\n[[effect]]\nkind = \"cubic_stiffness\"\nstiffness_n_per_rad3 = 1.0\n";
        let freed = freed(text).unwrap();
        assert!(
            freed.contains("free = [\"damping\", \"cubic_stiffness.stiffness_n_per_rad3\"]"),
            "{freed}"
        );
    }

    #[test]
    fn a_picture_keeps_the_largest_errors() {
        let time: Vec<f64> = (0..5_000).map(f64::from).collect();
        let mut error = vec![0.0; 5_000];
        error[1_234] = 7.0;
        let course = Course::of("test", &time, &error, &error);
        assert!(course.time_s.len() <= 2 * Course::PARTS);
        assert!(course.error.iter().any(|it| (it - 7.0).abs() < 1e-12));
    }

    #[test]
    fn the_table_has_our_row_beside_the_published_ones() {
        let set = sets::all().unwrap().remove(1);
        let figures = json!({ "benchmark": "public", "options": "--no-formulas", "sets": [{
            "set": set, "name": "silverbox", "starts": ["arrow from rest"], "answer": "cubic stiffness (explains)",
            "heading": "cubic stiffness", "is_named": true, "reached": [true, false],
            "train": 0.35, "train_refit": 6.0, "tests": [0.36, 0.52], "tests_refit": [6.0, 9.0],
            "parameters": 6, "seconds": Seconds { wall: 10.0, cpu: Some(15.0) }, "courses": [],
        }]});
        let text = render(&figures).unwrap();
        assert!(text.contains("**softrig, cubic stiffness**"), "{text}");
        assert!(text.contains("| LSTM |"), "{text}");
        assert!(text.contains("0.360 / 0.520"), "{text}");
    }
}
