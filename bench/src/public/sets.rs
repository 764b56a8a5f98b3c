//! The sets of the public tables, from `bench/data/public.json`: splits, rules and published errors.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::invariance::known::read_json;
use softrig_tests::process::root;

/// A public set with its official split.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Set {
    /// Its folder below `data/public`.
    #[serde(skip_deserializing)]
    pub name: String,
    /// Heading of its section.
    pub title: String,
    /// What it is.
    pub about: String,
    /// Authors, and where it is stored.
    pub source: String,
    /// What is known to be missing in a linear model.
    pub known: String,
    /// The same, as a kind of effect.
    pub expected: String,
    /// What a degree stands for.
    pub unit: String,
    /// Column of the input, and its factor.
    pub input: (String, f64),
    /// Column of the output, and its factor into the unit.
    pub output: (String, f64),
    /// Sampling rate (Hz).
    pub rate_hz: f64,
    /// The record to fit.
    pub train: Part,
    /// The records to test.
    pub tests: Vec<Test>,
    /// Options beside those of all sets: what is known of the input.
    pub options: Vec<String>,
    /// The time of the diagnosis, where the record is too long for it: it then reads as many samples as
    /// it can, and the model that it names is fitted to all of them.
    #[serde(default)]
    pub budget: Option<String>,
    /// Published errors in the unit, of each test.
    pub published: Vec<Published>,
}

/// Samples of a file.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Part {
    /// The file below `data/public`.
    pub file: String,
    /// Its first sample.
    #[serde(default)]
    pub from: usize,
    /// How many; all that follow if absent.
    pub count: Option<usize>,
}

/// A record to test.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Test {
    /// Its name in the tables.
    pub name: String,
    /// Its samples.
    #[serde(flatten)]
    pub part: Part,
    /// Where its state comes from, as `--start-from` takes it.
    pub start: String,
    /// The error (unit) that was aimed at.
    pub target: f64,
}

impl Test {
    /// Where it starts, in words.
    pub fn starts(&self) -> String {
        let from = match self.start.as_str() {
            "rest" => "rest".to_owned(),
            "period" => "its own input, played once before".to_owned(),
            count => format!("its first {count} samples"),
        };
        format!("{} from {from}", self.name)
    }
}

/// A published model.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Published {
    /// What it is.
    pub model: String,
    /// Its error (unit) on each test; none where nobody published one.
    pub errors: Vec<Option<f64>>,
}

/// All sets in the order of the file.
///
/// # Errors
///
/// What is wrong with the file of this repository.
pub fn all() -> Result<Vec<Set>, String> {
    let entries: Map<String, Value> = read_json(&root().join("bench/data/public.json"))?;
    let sets = entries.into_iter().map(|(name, entry)| {
        let set: Set = serde_json::from_value(entry).map_err(|error| format!("{name}: {error}"))?;
        Ok(Set { name, ..set })
    });
    sets.collect()
}
