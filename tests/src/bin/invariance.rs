//! Asks the same question otherwise; `cargo xtask bench invariance` builds and runs it.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use std::{fs, thread};

use clap::Parser;
use serde_json::json;
use softrig_tests::invariance::ask::{Rig, ask_all};
use softrig_tests::invariance::cases::{CaseSet, Places, Set};
use softrig_tests::invariance::known;
use softrig_tests::invariance::pose::write;
use softrig_tests::invariance::tables::{Figures, Limits};
use softrig_tests::invariance::ways::Way;

/// Does the same question, asked otherwise, get the same answer?
///
/// Diagnoses every case as it is, then with another seed, another order, other units, another
/// first model and so on, and counts how often the answer stays. It needs no labels. Answers
/// are kept: the same command goes on where it was interrupted.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask bench invariance",
    after_help = "\
A case is a folder with model.toml, recordings/*.csv and, where there is one, holdout/*.csv.
docs/benchmarks.md says what the columns of the tables mean.

Examples:
  cargo xtask bench invariance
  cargo xtask bench invariance --sets bench --limit 12 --ways seed,order,units
  cargo xtask bench invariance --folder my-rigs --known my-rigs/known.json
  cargo xtask bench invariance --sets rigs,real --at-least same=0.9,contradicting=0.02"
)]
struct Args {
    /// Which cases [default: rigs,real unless --folder is given]
    #[arg(long, value_enum, value_delimiter = ',')]
    sets: Vec<Set>,
    /// Any folder of cases, also several times
    #[arg(long, value_name = "DIR")]
    folder: Vec<PathBuf>,
    /// In which ways to ask [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    ways: Vec<Way>,
    /// Only cases with these names
    #[arg(long, value_delimiter = ',', value_name = "NAME")]
    only: Vec<String>,
    /// At most so many cases of each set; of the bench sessions, so many are drawn (24)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=10_000))]
    limit: Option<u32>,
    /// Seed of the bench sessions
    #[arg(long, value_name = "N", default_value_t = 1)]
    bench_seed: u64,
    /// Where `cargo xtask bench loop` left its sessions
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/loop",
        overrides_with = "loops"
    )]
    loops: PathBuf,
    /// Diagnoses at a time; they share the cores
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = jobs)]
    jobs: usize,
    /// The program to ask
    #[arg(long, value_name = "PATH", overrides_with = "rig")]
    rig: PathBuf,
    /// Where questions and answers are kept
    #[arg(
        long,
        value_name = "DIR",
        default_value = "target/invariance",
        overrides_with = "keep"
    )]
    keep: PathBuf,
    /// Longest time of a diagnosis, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 900, value_parser = clap::value_parser!(u64).range(1..))]
    timeout: u64,
    /// Labels of cases, beside those that a set has
    #[arg(long, value_name = "FILE")]
    known: Option<PathBuf>,
    /// Write all figures and all answers as JSON
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Fail unless every way of every set has at least this share of `same`, and at most this
    /// share of any other column: same=0.9,contradicting=0.02
    #[arg(long, visible_alias = "limits", value_name = "LIMITS", value_parser = Limits::parse)]
    at_least: Option<Limits>,
}

/// Bench sessions that are drawn unless a number is given: two decks.
const BENCH_SESSIONS: u32 = 24;

fn jobs(text: &str) -> Result<usize, String> {
    let jobs = text.parse().ok().filter(|jobs| (1..=1024).contains(jobs));
    jobs.ok_or_else(|| format!("{text:?} is no number of jobs"))
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(code) => code,
        Err(problem) => {
            eprintln!("invariance: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<ExitCode, String> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let threads = (cores / args.jobs).max(1);
    let rig = Rig::new(&args.rig, threads, Duration::from_secs(args.timeout))?;
    let sets = sets(args)?;
    let mut ways = args.ways.clone();
    if ways.is_empty() {
        ways = Way::OTHERS.to_vec();
    }
    // It is asked in any case.
    ways.retain(|way| *way != Way::Plain);
    let keep = args.keep.join(&rig.hash);
    let count: usize = sets.iter().map(|set| set.cases.len()).sum();
    eprintln!(
        "{count} cases in {} ways, {} at a time on {threads} of {cores} cores each; answers are kept in {}",
        ways.len() + 1,
        args.jobs,
        keep.display()
    );
    let replies = ask_all(&rig, &sets, &ways, &keep, args.jobs)?;
    let figures: Vec<Figures> = sets
        .iter()
        .zip(&replies)
        .map(|(set, cases)| Figures::of(set, cases, &ways))
        .collect();
    for set in &figures {
        println!("{}", set.text());
    }
    if let Some(path) = &args.json {
        let all = json!({
            "rig": args.rig, "rig_hash": rig.hash, "jobs": args.jobs, "threads": threads,
            "sets": figures,
        });
        let text = serde_json::to_string_pretty(&all).map_err(|error| error.to_string())?;
        write(path, &text)?;
    }
    let limits = args.at_least.iter();
    let missed: Vec<String> = limits
        .flat_map(|limits| figures.iter().flat_map(|set| limits.missed(set)))
        .collect();
    for miss in &missed {
        eprintln!("invariance: {miss}");
    }
    Ok(if missed.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// The cases that are asked for, with what is known of them.
fn sets(args: &Args) -> Result<Vec<CaseSet>, String> {
    let places = Places {
        drawn: args.keep.join("drawn"),
        seed: args.bench_seed,
        count: args.limit.unwrap_or(BENCH_SESSIONS),
        loops: args.loops.clone(),
    };
    let mut named = args.sets.clone();
    if named.is_empty() && args.folder.is_empty() {
        named = vec![Set::Rigs, Set::Real];
    }
    let labels = args.known.as_deref().map(known::read).transpose()?;
    let named = named.into_iter().map(|set| CaseSet::named(set, &places));
    let folders = args.folder.iter().map(|path| CaseSet::of_folder(path));
    let mut sets = named.chain(folders).collect::<Result<Vec<_>, _>>()?;
    for set in &mut sets {
        set.labels.extend(labels.clone().unwrap_or_default());
        let wanted = |name: &String| args.only.is_empty() || args.only.contains(name);
        set.cases.retain(|case| wanted(&case.name));
        set.cases
            .truncate(args.limit.map_or(usize::MAX, |limit| limit as usize));
    }
    sets.retain(|set| !set.cases.is_empty());
    if sets.is_empty() {
        return Err("no case has one of these names".into());
    }
    distinct(&sets)?;
    fs::create_dir_all(&args.keep)
        .map_err(|error| format!("cannot make {}: {error}", args.keep.display()))?;
    Ok(sets)
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
