//! The three phases, one after another.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::Value;
use softrig_formats::error::{InputError, write_atomically};

use super::GENERATOR;
use super::answer::{Answer, Collection, Plans};
use super::cases::stable_hash;
use super::draw::draw;
use super::experiments::Set;
use super::gate::Gate;
use super::law::kinds;
use super::score::score;
use super::tables;
use super::verdicts::{diagnose_all, tool_hash};

/// How often does the diagnosis name what is missing?
///
/// Draws truths with a simulator of its own, hides the answers, diagnoses, and
/// counts. Interrupting loses nothing: the same command goes on.
#[derive(Args, Debug)]
pub struct Options {
    /// Cases in each set
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    cases: u32,
    /// Which experiments
    #[arg(long, value_enum, default_value_t = Which::Rich)]
    set: Which,
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
    #[arg(long, conflicts_with_all = ["cases", "set", "seed", "kinds", "docs"])]
    fast: bool,
    /// Where cases, answers and verdicts go [default: blind in the folder that cargo builds into]
    #[arg(long)]
    folder: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
    Rich,
    Paper,
    /// Rich and paper
    Both,
    /// Whole sessions, as on a bench
    Bench,
}

impl Which {
    const fn collections(self) -> &'static [Collection] {
        match self {
            Self::Rich => &[Collection::Runs(Set::Rich)],
            Self::Paper => &[Collection::Runs(Set::Paper)],
            Self::Both => &[Collection::Runs(Set::Rich), Collection::Runs(Set::Paper)],
            Self::Bench => &[Collection::Bench],
        }
    }
}

/// The cases of a run of this program, in a folder.
struct Bench {
    plans: Vec<Plans>,
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
        let (cases, seed) = gate
            .as_ref()
            .map_or((self.cases, self.seed), |gate| (gate.cases, gate.seed));
        let plans = self.set.collections().iter();
        let bench = Bench {
            plans: plans
                .map(|&set| Plans::of(set, cases, &self.kinds, seed))
                .collect(),
            seed,
            folder: folder.join(folder_name(self, cases, seed)),
        };
        let tool = tool_hash();
        let verdicts = bench.folder.join(format!("verdicts_{tool}"));
        eprintln!("blind: {}", bench.folder.display());

        bench.draw()?;
        let names: Vec<String> = bench.plans.iter().flat_map(Plans::names).collect();
        diagnose_all(&bench.folder.join("cases"), &verdicts, &names, self.jobs)?;

        let answers = bench.answers(&names)?;
        eprintln!("scoring; the first time, refits of an oracle take a second or two a case");
        let scored = score(&answers, &verdicts, &bench.sealed());
        let mut figures = tables::figures(&scored);
        figures["command"] = format!("cargo xtask bench blind {}", arguments(self)).into();
        figures["tool"] = tool.into();
        let missed = gate.map_or_else(Vec::new, |gate| gate.check(&scored));
        figures["missed"] = missed.into();
        Ok(figures)
    }
}

fn write(path: &Path, text: &str) -> Result<(), InputError> {
    write_atomically(path, text.as_bytes())
}

/// Cases of another generator are other cases, and runs are others where there are
/// more of them; sessions of a seed share a folder.
fn folder_name(args: &Options, cases: u32, seed: u64) -> String {
    let mut name = match args.set {
        Which::Bench => format!("bench_seed{seed}"),
        _ => format!("seed{seed}_{cases}"),
    };
    for kind in &args.kinds {
        name += &format!("_{kind}");
    }
    let hash = stable_hash(GENERATOR.as_bytes()) >> 32;
    format!("{name}_{hash:08x}")
}

/// The options as they would be typed, without those that change no figure.
fn arguments(args: &Options) -> String {
    let set = match args.set {
        Which::Rich => "rich",
        Which::Paper => "paper",
        Which::Both => "both",
        Which::Bench => "bench",
    };
    let mut text = format!("--set {set} --cases {} --seed {}", args.cases, args.seed);
    if !args.kinds.is_empty() {
        text += &format!(" --kinds {}", args.kinds.join(","));
    }
    text
}

impl Bench {
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
        for plans in &self.plans {
            draw(plans, self.seed, &cases, is_there, |answer| {
                let text = serde_json::to_string_pretty(answer).map_err(|error| {
                    InputError::new(format!("the answer cannot be written: {error}"), "")
                })?;
                write(&self.answer_path(&answer.secret().case), &text)
            })?;
        }
        Ok(())
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
