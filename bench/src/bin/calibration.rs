//! Is what is stated as likely right as often? `cargo xtask bench calibration` runs it.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;
use serde_json::json;
use softrig_bench::invariance::ask::ask_all;
use softrig_bench::invariance::calibration::Calibration;
use softrig_bench::invariance::cases::Set;
use softrig_bench::invariance::choice::Choice;
use softrig_bench::pages::put_section;
use softrig_tests::write;

/// Is what is stated with a probability right as often as it says?
///
/// Diagnoses cases with a known answer, and counts what was stated with which probability
/// against what is right. Answers are kept: the same command goes on where it was interrupted.
#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask bench calibration",
    after_help = "\
Unless sets are named, drawn cases and bench sessions are asked. Rivals count where exactly
one set of effects is right; of rigs of other laboratories, names alone do.

Examples:
  cargo xtask bench calibration --limit 48 --draw-seed 7
  cargo xtask bench calibration --sets drawn,bench,loop,rigs,real --json calibration.json"
)]
struct Args {
    #[command(flatten)]
    choice: Choice,
    /// Write the table into docs/diagnosis.md, and docs/images/calibration.svg
    #[arg(long)]
    docs: bool,
    /// Draw the picture
    #[arg(long, value_name = "OUT.svg")]
    plot: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("calibration: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(args: &Args) -> Result<(), String> {
    let choice = &args.choice;
    let rig = choice.rig()?;
    let sets = choice.sets(&[Set::Drawn, Set::Bench])?;
    let keep = choice.kept_of(&rig);
    let count: usize = sets.iter().map(|set| set.cases.len()).sum();
    eprintln!(
        "{count} cases, {}; answers are kept in {}",
        choice.shares(),
        keep.display()
    );
    let replies = ask_all(&rig, &sets, &[], &keep, choice.jobs)?;
    let each: Vec<Calibration> = sets
        .iter()
        .zip(&replies)
        .map(|(set, cases)| Calibration::of(set, cases))
        .collect();
    for (set, calibration) in sets.iter().zip(&each) {
        println!(
            "{}: {}\n{}",
            set.name,
            calibration.summary(),
            calibration.table()
        );
    }
    let all = Calibration::joined(&each);
    let words: Vec<String> = sets
        .iter()
        .map(|set| format!("{} cases of the set {}", set.cases.len(), set.name))
        .collect();
    let subtitle = format!("{}; seed {}", words.join(", "), choice.draw_seed);
    if sets.len() > 1 {
        println!("all: {}\n{}", all.summary(), all.table());
    }
    if let Some(path) = &choice.json {
        let value = json!({
            "rig_hash": rig.hash, "expected_error": all.expected_error(),
            "log_loss": all.log_loss(), "sure_names": all.sure_names(),
            "bins": all.bins(), "statements": all.statements,
        });
        let text = serde_json::to_string_pretty(&value).map_err(|error| error.to_string())?;
        write(path, &text)?;
    }
    if let Some(path) = &args.plot {
        write(path, &all.picture(&subtitle))?;
    }
    if args.docs {
        let docs = softrig_tests::process::root().join("docs");
        write(
            &docs.join("images/calibration.svg"),
            &all.picture(&subtitle),
        )?;
        let section = format!(
            "Measured on {subtitle}. {}\n\n{}",
            all.summary(),
            all.table()
        );
        put_section("diagnosis.md", "calibration", &section)?;
    }
    Ok(())
}
