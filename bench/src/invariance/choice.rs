//! What both benchmarks on folders of cases let one choose: the cases, and how to ask.

use std::path::PathBuf;
use std::time::Duration;
use std::{fs, thread};

use clap::Args;

use super::ask::Rig;
use super::cases::{CaseSet, Places, Set};
use super::known;

/// Cases that are drawn unless a number is given: two decks of bench sessions.
const DRAWN: u32 = 24;

/// The cases, and how to ask.
#[derive(Debug, Args)]
pub struct Choice {
    /// Which cases
    #[arg(long, value_enum, value_delimiter = ',')]
    pub sets: Vec<Set>,
    /// Any folder of cases, also several times
    #[arg(long, value_name = "DIR")]
    pub folder: Vec<PathBuf>,
    /// Only cases with these names
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    pub only: Vec<String>,
    /// At most so many cases of each set; of the drawn ones, so many are drawn (24)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub limit: Option<u32>,
    /// Seed of the drawn cases
    #[arg(
        long,
        value_name = "N",
        default_value_t = 1,
        visible_alias = "bench-seed"
    )]
    pub draw_seed: u64,
    /// Where `cargo xtask bench loop` left its sessions
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/loop",
        overrides_with = "loops"
    )]
    pub loops: PathBuf,
    /// Diagnoses at a time; they share the cores
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = jobs)]
    pub jobs: usize,
    /// The program to ask
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    pub rig: PathBuf,
    /// Where questions and answers are kept
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/invariance",
        overrides_with = "keep"
    )]
    pub keep: PathBuf,
    /// Longest time of a diagnosis, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 900, value_parser = clap::value_parser!(u64).range(1..))]
    pub timeout: u64,
    /// Labels of cases, beside those that a set has
    #[arg(long, value_name = "FILE")]
    pub known: Option<PathBuf>,
    /// Write all figures and all answers as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

fn jobs(text: &str) -> Result<usize, String> {
    let jobs = text.parse().ok().filter(|jobs| (1..=1024).contains(jobs));
    jobs.ok_or_else(|| format!("{text:?} is no number of jobs"))
}

impl Choice {
    /// The program, with its share of the cores.
    ///
    /// # Errors
    ///
    /// If it cannot be read.
    pub fn rig(&self) -> Result<Rig, String> {
        Rig::new(&self.rig, self.threads(), Duration::from_secs(self.timeout))
    }

    /// Threads of each diagnosis.
    pub fn threads(&self) -> usize {
        (cores() / self.jobs).max(1)
    }

    /// Where the answers of this program are kept.
    pub fn kept_of(&self, rig: &Rig) -> PathBuf {
        self.keep.join(&rig.hash)
    }

    /// How the work is shared, in words.
    pub fn shares(&self) -> String {
        format!(
            "{} at a time on {} of {} cores each",
            self.jobs,
            self.threads(),
            cores()
        )
    }

    /// The chosen cases with what is known of them; `standard` are the sets unless some are
    /// named.
    ///
    /// # Errors
    ///
    /// What is wrong with a set, or that nothing is left.
    pub fn sets(&self, standard: &[Set]) -> Result<Vec<CaseSet>, String> {
        let places = Places {
            drawn: self.keep.join("drawn"),
            seed: self.draw_seed,
            count: self.limit.unwrap_or(DRAWN),
            loops: self.loops.clone(),
        };
        let mut named = self.sets.clone();
        if named.is_empty() && self.folder.is_empty() {
            named = standard.to_vec();
        }
        let labels = self.known.as_deref().map(known::read).transpose()?;
        let named = named.into_iter().map(|set| CaseSet::named(set, &places));
        let folders = self.folder.iter().map(|path| CaseSet::of_folder(path));
        let mut sets = named.chain(folders).collect::<Result<Vec<_>, _>>()?;
        for set in &mut sets {
            set.labels.extend(labels.clone().unwrap_or_default());
            let wanted = |name: &String| self.only.is_empty() || self.only.contains(name);
            set.cases.retain(|case| wanted(&case.name));
            set.cases
                .truncate(self.limit.map_or(usize::MAX, |limit| limit as usize));
        }
        sets.retain(|set| !set.cases.is_empty());
        if sets.is_empty() {
            return Err("no case has one of these names".into());
        }
        distinct(&sets)?;
        fs::create_dir_all(&self.keep)
            .map_err(|error| format!("cannot make {}: {error}", self.keep.display()))?;
        Ok(sets)
    }
}

fn cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Answers are kept by the name of the set: two of one name would be taken for each other.
fn distinct(sets: &[CaseSet]) -> Result<(), String> {
    let mut names: Vec<&str> = sets.iter().map(|set| set.name.as_str()).collect();
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(format!("two sets have the name {}", pair[0])),
        None => Ok(()),
    }
}
