//! Asks the same question otherwise; `cargo xtask bench invariance` builds and runs it.

use std::process::ExitCode;

use clap::Parser;
use serde_json::json;
use softrig_bench::invariance::ask::ask_all;
use softrig_bench::invariance::cases::Set;
use softrig_bench::invariance::choice::Choice;
use softrig_bench::invariance::tables::{Figures, Limits};
use softrig_bench::invariance::ways::Way;
use softrig_tests::write;

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
Unless sets are named, those of other laboratories are asked: rigs and real.
docs/benchmarks.md says what the columns of the tables mean.

Examples:
  cargo xtask bench invariance
  cargo xtask bench invariance --sets bench --limit 12 --ways seed,order,units
  cargo xtask bench invariance --folder my-rigs --known my-rigs/known.json
  cargo xtask bench invariance --sets rigs,real --at-least same=0.9,contradicting=0.02"
)]
struct Args {
    #[command(flatten)]
    choice: Choice,
    /// In which ways to ask [default: all]
    #[arg(long, value_enum, value_delimiter = ',')]
    ways: Vec<Way>,
    /// Fail unless every way of every set has at least this share of `same`, and at most this
    /// share of any other column: same=0.9,contradicting=0.02
    #[arg(long, visible_alias = "limits", value_name = "LIMITS", value_parser = Limits::parse)]
    at_least: Option<Limits>,
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
    let choice = &args.choice;
    let rig = choice.rig()?;
    let sets = choice.sets(&[Set::Rigs, Set::Real])?;
    let mut ways = args.ways.clone();
    if ways.is_empty() {
        ways = Way::OTHERS.to_vec();
    }
    // It is asked in any case.
    ways.retain(|way| *way != Way::Plain);
    let keep = choice.kept_of(&rig);
    let count: usize = sets.iter().map(|set| set.cases.len()).sum();
    eprintln!(
        "{count} cases in {} ways, {}; answers are kept in {}",
        ways.len() + 1,
        choice.shares(),
        keep.display()
    );
    let replies = ask_all(&rig, &sets, &ways, &keep, choice.jobs)?;
    let figures: Vec<Figures> = sets
        .iter()
        .zip(&replies)
        .map(|(set, cases)| Figures::of(set, cases, &ways))
        .collect();
    for set in &figures {
        println!("{}", set.text());
    }
    if let Some(path) = &choice.json {
        let all = json!({
            "rig": choice.rig, "rig_hash": rig.hash, "jobs": choice.jobs,
            "threads": choice.threads(), "sets": figures,
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
