//! The `rig` command: parse, run, report.
#![forbid(unsafe_code)]

use std::io;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;
use host_tools::cmd;
use host_tools::error::InputError;

/// Finds where the simulation of a soft pneumatic actuator and its measurements
/// disagree, names the missing effect, and repairs the model.
#[derive(Debug, Parser)]
#[command(
    name = "rig",
    version,
    propagate_version = true,
    after_help = "\
Examples:
  rig example -o demo && rig diagnose --model demo/model.toml demo/recordings/*.csv
  rig diagnose --model m.toml id_*.csv --holdout vad_*.csv -o repaired.toml --plot gap.svg
  rig simulate --model m.toml --protocol step --angle-deg 60 --plot step.svg"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Diagnose(cmd::diagnose::Args),
    Fit(cmd::fit::Args),
    Simulate(cmd::simulate::Args),
    Compare(cmd::compare::Args),
    Materials(cmd::materials::Args),
    Example(cmd::example::Args),
    /// Print the JSON Schema of a verdict
    Schema,
    /// Print a completion script for a shell
    Completions {
        /// The shell
        shell: Shell,
    },
}

fn main() -> ExitCode {
    let cli = Cli::parse();
    match run(cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => report(&error),
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Diagnose(args) => cmd::diagnose::run(&args),
        Command::Fit(args) => cmd::fit::run(&args),
        Command::Simulate(args) => cmd::simulate::run(&args),
        Command::Compare(args) => cmd::compare::run(&args),
        Command::Materials(args) => cmd::materials::run(args),
        Command::Example(args) => cmd::example::run(&args),
        Command::Schema => {
            println!(
                "{}",
                serde_json::to_string_pretty(&host_tools::diagnose::verdict::schema())?
            );
            Ok(())
        }
        Command::Completions { shell } => {
            clap_complete::generate(shell, &mut Cli::command(), "rig", &mut io::stdout());
            Ok(())
        }
    }
}

/// Faults of the input exit with 2, everything else with 1.
fn report(error: &anyhow::Error) -> ExitCode {
    eprintln!("error: {error:#}");
    if error.chain().any(<dyn std::error::Error>::is::<InputError>) {
        ExitCode::from(2)
    } else {
        ExitCode::FAILURE
    }
}
