//! What both benchmarks on folders of cases let one choose: the cases, and how to ask.

use std::path::{Path, PathBuf};
use std::time::Duration;
use std::{fs, thread};

use clap::Args;

use super::ask::{CaseReplies, Rig, ask_all};
use super::cases::{CaseSet, Places, Set};
use super::known;
use super::ways::Way;

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
    /// Where `cargo xtask bench loop` left its sessions [default: loop in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    pub loops: Option<PathBuf>,
    /// Diagnoses at a time; they share the cores
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = jobs)]
    pub jobs: usize,
    /// The program to ask
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    pub rig: PathBuf,
    /// Where questions and answers are kept [default: invariance in the folder that cargo builds into]
    #[arg(long, value_name = "DIR")]
    pub keep: Option<PathBuf>,
    /// Longest time of a diagnosis, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 900, value_parser = clap::value_parser!(u64).range(1..))]
    pub timeout: u64,
    /// Labels of cases, beside those that a set has
    #[arg(long, value_name = "FILE")]
    pub known: Option<PathBuf>,
}

/// The cases of a set, and what was replied to each.
pub type Replies = (CaseSet, Vec<CaseReplies>);

fn jobs(text: &str) -> Result<usize, String> {
    let jobs = text.parse().ok().filter(|jobs| (1..=1024).contains(jobs));
    jobs.ok_or_else(|| format!("{text:?} is no number of jobs"))
}

impl Choice {
    /// Asks the chosen cases as they are and in these ways: the program with its share of the cores, the cases with what
    /// is known of them, and the replies. `standard` are the sets unless some are named.
    ///
    /// # Errors
    ///
    /// What is wrong with the program or a set, that nothing is left, or the first run that cannot be made.
    pub fn ask(
        &self,
        target: &Path,
        standard: &[Set],
        ways: &[Way],
    ) -> Result<(Rig, Vec<Replies>), String> {
        let rig = Rig::new(&self.rig, self.threads(), Duration::from_secs(self.timeout))?;
        let keep = self.keep.clone();
        let keep = keep.unwrap_or_else(|| target.join("invariance"));
        let sets = self.sets(target, &keep, standard)?;
        let kept = keep.join(&rig.hash);
        eprintln!(
            "{} cases in {} ways, {} at a time on {} of {} cores each; answers are kept in {}",
            sets.iter().map(|set| set.cases.len()).sum::<usize>(),
            ways.len() + 1,
            self.jobs,
            self.threads(),
            cores(),
            kept.display()
        );
        let replies = ask_all(&rig, &sets, ways, &kept, self.jobs)?;
        Ok((rig, sets.into_iter().zip(replies).collect()))
    }

    /// Threads of each diagnosis.
    pub fn threads(&self) -> usize {
        (cores() / self.jobs).max(1)
    }

    fn sets(&self, target: &Path, keep: &Path, standard: &[Set]) -> Result<Vec<CaseSet>, String> {
        let places = Places {
            drawn: keep.join("drawn"),
            seed: self.draw_seed,
            count: self.limit.unwrap_or(DRAWN),
            loops: self.loops.clone().unwrap_or_else(|| target.join("loop")),
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
        fs::create_dir_all(keep)
            .map_err(|error| format!("cannot make {}: {error}", keep.display()))?;
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
