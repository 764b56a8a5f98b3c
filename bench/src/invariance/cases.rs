//! The cases: folders with a first model and recordings, in named sets or anywhere.

use std::fs;
use std::path::{Path, PathBuf};

use clap::ValueEnum;

use super::known::{self, Known, Labels};
use super::ways::{columns_of, model_file};
use crate::blind::answer::{Collection, Plans};
use crate::blind::draw::draw;
use crate::blind::experiments::Set as Experiments;
use softrig_tests::shared;
use softrig_tests::text_of;

/// Where a case keeps the recordings to fit: `before` is what `cargo xtask bench loop` writes.
const FITTED: [&str; 2] = ["recordings", "before"];

/// A named set of cases.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Set {
    /// Rigs of other laboratories, in `data/rigs` of the shared folder
    Rigs,
    /// The rigs of docs/real.md and five more, in `data/real` of the shared folder
    Real,
    /// Simulated cases with hidden effects, in `cases` of the shared folder
    Cases,
    /// Cases of the blind benchmark, drawn here
    Drawn,
    /// Bench sessions of the blind benchmark, drawn here
    Bench,
    /// Sessions on virtual rigs that `cargo xtask bench loop` left in target/loop
    Loop,
}

/// A folder with a first model and recordings.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of its folder.
    pub name: String,
    /// The first model.
    pub model: PathBuf,
    /// Recordings to fit.
    pub recordings: Vec<PathBuf>,
    /// Recordings for validation; may be none.
    pub holdout: Vec<PathBuf>,
    /// The names of time, pressure and angle in these recordings.
    pub columns: [String; 3],
}

/// Cases that are counted together.
#[derive(Clone, Debug)]
pub struct CaseSet {
    /// Its name.
    pub name: String,
    /// The cases, in the order of their names.
    pub cases: Vec<Case>,
    /// What is known of them.
    pub labels: Labels,
}

/// What to draw and where to look for what is drawn.
#[derive(Clone, Debug)]
pub struct Places {
    /// Bench sessions are written here.
    pub drawn: PathBuf,
    /// Seed of the bench sessions.
    pub seed: u64,
    /// How many bench sessions.
    pub count: u32,
    /// Where the loop's sessions are.
    pub loops: PathBuf,
}

impl CaseSet {
    /// All cases of a named set.
    ///
    /// # Errors
    ///
    /// Where it should be, and what is wrong with it.
    pub fn named(set: Set, places: &Places) -> Result<Self, String> {
        let name = match set {
            Set::Rigs => "rigs",
            Set::Real => "real",
            Set::Cases => "cases",
            Set::Drawn => "drawn",
            Set::Bench => "bench",
            Set::Loop => "loop",
        };
        let of_others = |folder: &str| {
            shared(folder).ok_or_else(|| {
                "these recordings are others' and not part of this repository; \
                 SOFTRIG_SHARED names the folder that has them"
                    .to_owned()
            })
        };
        match set {
            Set::Rigs => {
                let folder = of_others("data/rigs")?;
                let labels = known::read(&folder.join("known.json"))?;
                Self::below(name, &folder, labels)
            }
            Set::Real => Self::below(name, &of_others("data/real")?, known::real()?),
            Set::Cases => {
                let folder = of_others("cases")?;
                let labels = known::of_answers(&folder.join("answers.json"))?;
                Self::below(name, &folder, labels)
            }
            Set::Drawn => {
                let (folder, labels) = draw_set(Collection::Runs(Experiments::Rich), places)?;
                Self::below(name, &folder, labels)
            }
            Set::Bench => {
                let (folder, labels) = draw_set(Collection::Bench, places)?;
                let mut set = Self::below(name, &folder, labels)?;
                // Those of an earlier and larger draw lie there as well.
                set.cases.truncate(places.count as usize);
                Ok(set)
            }
            Set::Loop if !places.loops.is_dir() => Err(format!(
                "there is no folder {}; `cargo xtask bench loop --seeds 201..212` records the \
                 sessions",
                places.loops.display()
            )),
            Set::Loop => {
                let mut set = Self::below(name, &places.loops, Labels::new())?;
                for case in &set.cases {
                    if let Some(known) = known::of_truth(&case.model) {
                        set.labels.insert(case.name.clone(), known);
                    }
                }
                Ok(set)
            }
        }
    }

    /// The cases in any folder, with the labels of a file `known.json` in it.
    ///
    /// # Errors
    ///
    /// What is wrong with the folder.
    pub fn of_folder(folder: &Path) -> Result<Self, String> {
        let file = folder.join("known.json");
        let labels = if file.exists() {
            known::read(&file)?
        } else {
            Labels::new()
        };
        let name = folder
            .canonicalize()
            .ok()
            .and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
        let name = name.unwrap_or_else(|| folder.display().to_string());
        Self::below(&name, folder, labels)
    }

    fn below(name: &str, folder: &Path, labels: Labels) -> Result<Self, String> {
        let mut cases = Vec::new();
        for path in entries(folder)? {
            if path.join("model.toml").is_file() {
                let name = file_name(&path);
                cases.push(Case::read(&path, labels.get(&name))?);
            }
        }
        if cases.is_empty() {
            return Err(format!(
                "{}: no folder in it has a model.toml",
                folder.display()
            ));
        }
        Ok(Self {
            name: name.to_owned(),
            cases,
            labels,
        })
    }
}

impl Case {
    /// Finds model and recordings in a folder. What validates may be said by its label.
    ///
    /// # Errors
    ///
    /// What is missing.
    pub fn read(folder: &Path, known: Option<&Known>) -> Result<Self, String> {
        let model = folder.join("model.toml");
        let file = model_file(&text_of(&model)?, &model)?;
        let mut recordings = Vec::new();
        for name in FITTED {
            recordings.extend(recordings_in(&folder.join(name))?);
        }
        let mut holdout = recordings_in(&folder.join("holdout"))?;
        if let Some(known) = known.filter(|known| !known.holdout.is_empty()) {
            let starts = |path: &Path, starts: &[String]| {
                let name = file_name(path);
                starts.iter().any(|start| name.starts_with(start.as_str()))
            };
            let held_out = recordings.clone();
            holdout.extend(
                held_out
                    .into_iter()
                    .filter(|path| starts(path, &known.holdout)),
            );
            recordings.retain(|path| starts(path, &known.fit));
        }
        if recordings.is_empty() {
            return Err(format!("{}: has no recordings", folder.display()));
        }
        Ok(Self {
            name: file_name(folder),
            columns: columns_of(&file).map(str::to_owned),
            model,
            recordings,
            holdout,
        })
    }
}

fn file_name(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

/// What is in a folder, by name.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let list = fs::read_dir(folder)
        .map_err(|error| format!("cannot list {}: {error}", folder.display()))?;
    let mut paths: Vec<PathBuf> = list.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    Ok(paths)
}

/// The recordings in a folder, which need not be there.
fn recordings_in(folder: &Path) -> Result<Vec<PathBuf>, String> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let mut paths = entries(folder)?;
    paths.retain(|path| path.extension().is_some_and(|end| end == "csv"));
    Ok(paths)
}

/// Writes the drawn cases of a set that are not there yet; their folder, and what they
/// hide.
fn draw_set(set: Collection, places: &Places) -> Result<(PathBuf, Labels), String> {
    let folder = places
        .drawn
        .join(set.folder(places.count, &[], places.seed));
    let plans = Plans::of(set, places.count, &[], places.seed);
    let is_there = |case: &str| folder.join(case).join("model.toml").exists();
    draw(&plans, places.seed, &folder, is_there, |_| Ok(())).map_err(|error| error.to_string())?;
    let hidden = plans.hidden();
    let known = hidden
        .into_iter()
        .map(|(hidden, laws)| known::of_drawn(hidden, laws));
    let labels = plans.names().into_iter().zip(known);
    let labels = labels.filter_map(|(name, known)| Some((name, known?)));
    Ok((folder, labels.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODEL: &str = "schema = 1\nname = \"a\"\n\n[dynamics]\ninertia_kg_m = 1.0\n\
        damping_n_s_per_rad = 1.0\nstiffness_n_per_rad_n = 1.0\nexponent = 1.0\n\
        input_gain_n_per_kpa = 1.0\n\n[recording]\ncolumns = { angle = \"theta\" }\n";

    #[test]
    fn cases_are_found_with_what_is_fitted_and_what_validates() {
        let folder = std::env::temp_dir().join(format!("softrig-cases-{}", std::process::id()));
        let write = |name: &str, text: &str| {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        };
        write("a/model.toml", MODEL);
        write("a/recordings/fit_1.csv", "");
        write("a/recordings/fit_1.meta.toml", "");
        write("a/recordings/val_1.csv", "");
        write("b/model.toml", MODEL);
        write("b/before/run.csv", "");
        write("b/holdout/other.csv", "");
        write("notes/readme.txt", "");
        write(
            "known.json",
            r#"{"a": {"accept": [["gravity"]], "fit": ["fit_"], "holdout": ["val_"]}}"#,
        );
        let set = CaseSet::of_folder(&folder).unwrap();
        let empty = CaseSet::of_folder(&folder.join("notes")).unwrap_err();
        fs::remove_dir_all(&folder).unwrap();
        let names = |paths: &[PathBuf]| -> Vec<String> {
            paths.iter().map(|path| file_name(path)).collect()
        };
        let [a, b] = set.cases.as_slice() else {
            panic!("{:?}", set.cases)
        };
        assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b"));
        assert_eq!(names(&a.recordings), ["fit_1.csv"]);
        assert_eq!(names(&a.holdout), ["val_1.csv"]);
        assert_eq!(names(&b.recordings), ["run.csv"]);
        assert_eq!(names(&b.holdout), ["other.csv"]);
        assert_eq!(a.columns, ["time_s", "pressure_kpa", "theta"]);
        assert!(empty.contains("model.toml"), "{empty}");
    }
}
