//! The three phases, one after another.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::Value;
use softrig_formats::error::{InputError, write_atomically};

use super::answer::{Answer, Collection, Plans};
use super::draw::draw;
use super::gate::Gate;
use super::law::kinds;
use super::score::{Scored, score};
use super::tables;
use super::verdicts::{diagnose_all, tool_hash};

/// How often does the diagnosis name what is missing?
///
/// Draws truths, hides the answers, diagnoses, and counts. Interrupting loses
/// nothing: the same command goes on.
#[derive(Args, Debug)]
pub struct Options {
    /// Cases in each set
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    cases: u32,
    /// Which sets: rich, paper, bench (whole sessions), laws (forces that no catalogue has)
    #[arg(long = "set", value_name = "SET,…", value_delimiter = ',', value_parser = Collection::named)]
    #[arg(default_value = "rich,laws")]
    sets: Vec<Collection>,
    /// Seed of truths, experiments and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only these kinds, each alone
    #[arg(long, value_delimiter = ',')]
    kinds: Vec<String>,
    /// Cases that are diagnosed at the same time; each uses all cores
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// A few cases, held against bench/blind_gate.toml
    #[arg(long, conflicts_with_all = ["cases", "sets", "seed", "kinds", "docs"])]
    fast: bool,
    /// Where cases, answers and verdicts go [default: blind in the folder that cargo builds into]
    #[arg(long)]
    folder: Option<PathBuf>,
}

/// The cases of a set, in a folder.
struct Bench {
    plans: Plans,
    seed: u64,
    folder: PathBuf,
}

impl Options {
    /// Draws, diagnoses and counts.
    ///
    /// # Errors
    ///
    /// If a kind is not known, or a file cannot be read or written.
    pub fn measure(&self, folder: &Path) -> Result<Value, String> {
        self.figures(self.folder.as_deref().unwrap_or(folder))
            .map_err(|error| error.to_string())
    }

    fn figures(&self, folder: &Path) -> Result<Value, InputError> {
        let gate = self.fast.then(Gate::committed).transpose()?;
        for kind in &self.kinds {
            if !kinds().contains(&kind.as_str()) {
                return Err(InputError::new(
                    format!("there is no kind {kind}"),
                    "use names of the catalogue of effects",
                ));
            }
        }
        let tool = tool_hash();
        let mut scored = Vec::new();
        for &set in &self.sets {
            let (cases, seed) = gate
                .as_ref()
                .map_or((self.cases, self.seed), |gate| gate.drawn(set));
            let bench = Bench {
                plans: Plans::of(set, cases, &self.kinds, seed),
                seed,
                folder: folder.join(set.folder(cases, &self.kinds, seed)),
            };
            scored.extend(bench.scored(&tool, self.jobs)?);
        }
        let mut figures = tables::figures(&scored);
        figures["command"] = format!("cargo xtask bench blind {}", arguments(self)).into();
        figures["tool"] = tool.into();
        let missed = gate.map_or_else(Vec::new, |gate| gate.check(&scored));
        figures["missed"] = missed.into();
        Ok(figures)
    }
}

/// The options as they would be typed, without those that change no figure.
fn arguments(args: &Options) -> String {
    let sets: Vec<&str> = args.sets.iter().map(|set| set.name()).collect();
    let (sets, cases, seed) = (sets.join(","), args.cases, args.seed);
    let mut text = format!("--set {sets} --cases {cases} --seed {seed}");
    if !args.kinds.is_empty() {
        text += &format!(" --kinds {}", args.kinds.join(","));
    }
    text
}

impl Bench {
    /// The three phases.
    fn scored(&self, tool: &str, jobs: usize) -> Result<Vec<Scored>, InputError> {
        let verdicts = self.folder.join(format!("verdicts_{tool}"));
        eprintln!("blind: {}", self.folder.display());
        self.draw()?;
        let names = self.plans.names();
        diagnose_all(&self.folder.join("cases"), &verdicts, &names, jobs)?;
        let answers = self.answers(&names)?;
        eprintln!("scoring; the first time, refits of an oracle take a second or two a case");
        Ok(score(&answers, &verdicts, &self.sealed()))
    }

    fn sealed(&self) -> PathBuf {
        self.folder.join("sealed")
    }

    fn answer_path(&self, case: &str) -> PathBuf {
        self.sealed().join(format!("{case}.json"))
    }

    /// Writes the cases that are not there yet, each answer into a file of its own.
    fn draw(&self) -> Result<(), InputError> {
        let sealed = self.sealed();
        std::fs::create_dir_all(&sealed).map_err(|error| InputError::from_io(&sealed, &error))?;
        let cases = self.folder.join("cases");
        let is_there = |case: &str| self.answer_path(case).exists();
        draw(&self.plans, self.seed, &cases, is_there, |answer| {
            let text = serde_json::to_string_pretty(answer).map_err(|error| {
                InputError::new(format!("the answer cannot be written: {error}"), "")
            })?;
            write_atomically(&self.answer_path(&answer.secret().case), text.as_bytes())
        })
    }

    /// Opens the answers. Only now: every verdict is written.
    fn answers(&self, names: &[String]) -> Result<Vec<Answer>, InputError> {
        let open = |name: &String| {
            let path = self.answer_path(name);
            let text = std::fs::read_to_string(&path)
                .map_err(|error| InputError::from_io(&path, &error))?;
            serde_json::from_str(&text).map_err(|error| {
                InputError::new(
                    format!("is damaged: {error}"),
                    "delete the folder and run the command again",
                )
                .in_file(&path)
            })
        };
        names.iter().map(open).collect()
    }
}
