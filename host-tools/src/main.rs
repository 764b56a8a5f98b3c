//! The `rig` command: parse, run, report.
#![forbid(unsafe_code)]
#![warn(clippy::print_stdout, clippy::print_stderr)]

#[cfg(test)]
mod documented;

use std::error::Error;
use std::io;
use std::process::ExitCode;

use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;
use host_tools::cmd;
use host_tools::error::InputError;
use host_tools::link::LinkError;
use host_tools::plot::PlotError;
use host_tools::terminal::{printable, printable_line, remark};

/// Instead of musl's, which gives memory back to the system at every turn.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: dlmalloc::GlobalDlmalloc = dlmalloc::GlobalDlmalloc;

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
  rig simulate --model m.toml --protocol step --angle-deg 60 --plot step.svg
  rig record --port /dev/ttyACM0 --protocol steps -o run.csv"
)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Diagnose(cmd::diagnose::Args),
    Init(cmd::init::Args),
    Fit(cmd::fit::Args),
    Simulate(cmd::simulate::Args),
    Compare(cmd::compare::Args),
    Gap(cmd::gap::Args),
    Convert(cmd::convert::Args),
    Materials(cmd::materials::Args),
    Example(cmd::example::Args),
    Export(cmd::export::Args),
    Ports(cmd::ports::Args),
    Monitor(cmd::monitor::Args),
    Record(cmd::record::Args),
    Upload(cmd::upload::Args),
    Calibrate(cmd::calibrate::Args),
    Virtual(cmd::virtual_rig::Args),
    Plan(cmd::plan::Args),
    /// Print the JSON Schema of a verdict
    #[command(after_help = "Examples:\n  rig schema > verdict.schema.json")]
    Schema,
    /// Print a completion script for a shell
    #[command(
        after_help = "Examples:\n  rig completions bash > ~/.local/share/bash-completion/completions/rig"
    )]
    Completions {
        /// The shell
        shell: Shell,
    },
}

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => harmless(&error).exit(),
    };
    match run(cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => report(&error),
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Diagnose(args) => cmd::diagnose::run(&args),
        Command::Init(args) => cmd::init::run(&args),
        Command::Fit(args) => cmd::fit::run(&args),
        Command::Simulate(args) => cmd::simulate::run(&args),
        Command::Compare(args) => cmd::compare::run(&args),
        Command::Gap(args) => cmd::gap::run(&args),
        Command::Convert(args) => cmd::convert::run(&args),
        Command::Materials(args) => cmd::materials::run(args),
        Command::Example(args) => cmd::example::run(&args),
        Command::Export(args) => cmd::export::run(&args),
        Command::Ports(args) => cmd::ports::run(&args),
        Command::Monitor(args) => cmd::monitor::run(&args),
        Command::Record(args) => cmd::record::run(&args),
        Command::Upload(args) => cmd::upload::run(&args),
        Command::Calibrate(args) => cmd::calibrate::run(&args),
        Command::Virtual(args) => cmd::virtual_rig::run(&args),
        Command::Plan(args) => cmd::plan::run(&args),
        Command::Schema => {
            let schema = host_tools::diagnose::verdict::schema();
            cmd::print(&format!("{}\n", serde_json::to_string_pretty(&schema)?))?;
            Ok(())
        }
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "rig", &mut script);
            cmd::print_own(&String::from_utf8(script)?)?;
            Ok(())
        }
    }
}

/// The error about a command line without the characters in it that a terminal obeys: a name
/// that the shell completed is quoted in it. It keeps the colours, which are made of such
/// characters too, so the arguments are made harmless and not the error.
fn harmless(error: &clap::Error) -> clap::Error {
    let arguments = std::env::args_os()
        .map(|argument| printable_line(&argument.to_string_lossy()).into_owned());
    Cli::try_parse_from(arguments).err().unwrap_or_else(|| {
        // Made harmless they are in order: then without colours.
        clap::Error::raw(error.kind(), printable(&error.render().to_string()))
    })
}

/// Faults of the input exit with 2, everything else with 1. That a reader like
/// `head` has seen enough is no fault.
fn report(error: &anyhow::Error) -> ExitCode {
    let enough = |cause: &(dyn Error + 'static)| {
        cause
            .downcast_ref::<io::Error>()
            .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
    };
    if error.chain().any(enough) {
        return ExitCode::SUCCESS;
    }
    remark(&format!("error: {error:#}"));
    let of_input = |cause: &(dyn Error + 'static)| {
        cause.is::<InputError>()
            || matches!(cause.downcast_ref(), Some(LinkError::Open(_)))
            || matches!(cause.downcast_ref(), Some(PlotError::Write(_)))
    };
    if error.chain().any(of_input) {
        ExitCode::from(2)
    } else {
        ExitCode::FAILURE
    }
}
