//! The `softrig` command: parse, run, report. A program of its own, and the command that the Python
//! package installs, call [`main`].

#[cfg(test)]
mod documented;

use std::error::Error;
use std::ffi::OsString;
use std::io;
use std::path::PathBuf;

use crate::cli;
use anyhow::Context;
use clap::{CommandFactory, Parser, Subcommand};
use clap_complete::Shell;
use softrig_formats::error::InputError;
use softrig_formats::terminal::{printable, printable_line, remark};
use softrig_link::LinkError;
use softrig_link::flash::FlashError;

/// Finds where the simulation of a soft pneumatic actuator and its measurements
/// disagree, names the missing effect, and repairs the model.
#[derive(Debug, Parser)]
#[command(
    name = "softrig",
    version,
    propagate_version = true,
    after_help = "\
Examples:
  softrig example -o demo && softrig diagnose --model demo/model.toml demo/recordings/*.csv
  softrig diagnose --model m.toml id_*.csv --holdout vad_*.csv -o repaired.toml --plot gap.svg
  softrig simulate --model m.toml --protocol step --angle-deg 60 --plot step.svg
  softrig record --port /dev/ttyACM0 --protocol steps -o run.csv
  softrig --cite",
    override_usage = "softrig <COMMAND>",
    arg_required_else_help = true,
    args_conflicts_with_subcommands = true
)]
struct Cli {
    /// Print how to cite softrig, as BibTeX
    #[arg(long)]
    cite: bool,
    #[command(subcommand)]
    command: Option<Command>,
}

/// How softrig is cited. CITATION.cff says the same.
const BIBTEX: &str = concat!(
    "@software{softrig,\n",
    "  title   = {softrig: the physical effect that a simulation of a soft pneumatic actuator lacks},\n",
    "  author  = {{The softrig authors}},\n",
    "  version = {",
    env!("CARGO_PKG_VERSION"),
    "},\n",
    "  year    = {2026}\n",
    "}\n"
);

#[derive(Debug, Subcommand)]
enum Command {
    Diagnose(Box<cli::diagnose::Args>),
    Import(cli::import::Args),
    Init(cli::init::Args),
    Fit(cli::fit::Args),
    Simulate(cli::simulate::Args),
    Compare(cli::compare::Args),
    Gap(cli::gap::Args),
    Residuals(cli::residuals::Args),
    Linearise(cli::linearise::Args),
    Convert(cli::convert::Args),
    Materials(cli::materials::Args),
    Example(cli::example::Args),
    Export(cli::export::Args),
    Ports(cli::ports::Args),
    Monitor(cli::monitor::Args),
    Log(cli::log::Args),
    Record(cli::record::Args),
    Flash(cli::flash::Args),
    Upload(cli::upload::Args),
    Calibrate(cli::calibrate::Args),
    Commission(cli::commission::Args),
    Virtual(cli::virtual_rig::Args),
    Plan(cli::plan::Args),
    Next(cli::next::Args),
    Schema(cli::schema::Args),
    /// Print a completion script for a shell
    #[command(
        after_help = "Examples:\n  softrig completions bash > ~/.local/share/bash-completion/completions/softrig"
    )]
    Completions {
        /// The shell
        shell: Shell,
    },
    /// Write the manual pages of softrig and its commands
    #[command(
        after_help = "Examples:\n  softrig man -o ~/.local/share/man/man1 && man softrig-diagnose"
    )]
    Man {
        /// Folder for the pages, which is made where there is none
        #[arg(short, long, value_name = "FOLDER")]
        output: PathBuf,
    },
}

/// Runs the command of these arguments, of which the first is the name of the program, and returns
/// the exit code: 0 where all went well, 2 for faults of the input, 1 for all others.
pub fn main(arguments: &[OsString]) -> u8 {
    #[cfg(feature = "lab")]
    softrig_importers::install();
    #[cfg(feature = "print")]
    softrig_print::install();
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        Err(error) => {
            let error = harmless(&error, arguments);
            // What cannot be said cannot be said elsewhere either.
            let _ = error.print();
            return u8::try_from(error.exit_code()).unwrap_or(WRONG_INPUT);
        }
    };
    let outcome = check_threads().and_then(|()| match cli.command {
        Some(command) => run(command),
        None => Ok(cli::print_own(BIBTEX)?),
    });
    match outcome {
        Ok(()) => 0,
        Err(error) => report(&error),
    }
}

/// The exit code of faults of the input.
const WRONG_INPUT: u8 = 2;

/// Refuses a number of threads that no machine has: starting them fails in the middle of a fit.
fn check_threads() -> anyhow::Result<()> {
    const NAME: &str = "RAYON_NUM_THREADS";
    const MOST: usize = 1024;
    let wanted: Option<usize> = std::env::var(NAME).ok().and_then(|text| text.parse().ok());
    match wanted {
        Some(count) if count > MOST => Err(InputError::new(
            format!("{NAME} asks for {count} threads, and at most {MOST} are started"),
            "leave it unset for one thread a processor, or give their number",
        )
        .into()),
        _ => Ok(()),
    }
}

fn run(command: Command) -> anyhow::Result<()> {
    match command {
        Command::Diagnose(args) => cli::diagnose::run(&args),
        Command::Import(args) => cli::import::run(&args),
        Command::Init(args) => cli::init::run(&args),
        Command::Fit(args) => cli::fit::run(&args),
        Command::Simulate(args) => cli::simulate::run(&args),
        Command::Compare(args) => cli::compare::run(&args),
        Command::Gap(args) => cli::gap::run(&args),
        Command::Residuals(args) => cli::residuals::run(&args),
        Command::Linearise(args) => cli::linearise::run(&args),
        Command::Convert(args) => cli::convert::run(&args),
        Command::Materials(args) => cli::materials::run(args),
        Command::Example(args) => cli::example::run(&args),
        Command::Export(args) => cli::export::run(&args),
        Command::Ports(args) => cli::ports::run(&args),
        Command::Monitor(args) => cli::monitor::run(&args),
        Command::Log(args) => cli::log::run(&args),
        Command::Record(args) => cli::record::run(&args),
        Command::Flash(args) => cli::flash::run(&args),
        Command::Upload(args) => cli::upload::run(&args),
        Command::Calibrate(args) => cli::calibrate::run(&args),
        Command::Commission(args) => cli::commission::run(&args),
        Command::Virtual(args) => cli::virtual_rig::run(&args),
        Command::Plan(args) => cli::plan::run(&args),
        Command::Next(args) => cli::next::run(&args),
        Command::Schema(args) => cli::schema::run(&args),
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(shell, &mut Cli::command(), "softrig", &mut script);
            cli::print_own(&String::from_utf8(script)?)?;
            Ok(())
        }
        Command::Man { output } => {
            let written = std::fs::create_dir_all(&output)
                .and_then(|()| clap_mangen::generate_to(Cli::command(), &output));
            written.with_context(|| output.display().to_string())?;
            cli::print(&format!(
                "written: {}\n",
                output.join("softrig*.1").display()
            ))?;
            Ok(())
        }
    }
}

/// The error about a command line without the characters in it that a terminal obeys: a name
/// that the shell completed is quoted in it. It keeps the colours, which are made of such
/// characters too, so the arguments are made harmless and not the error.
fn harmless(error: &clap::Error, arguments: &[OsString]) -> clap::Error {
    let arguments = arguments
        .iter()
        .map(|argument| printable_line(&argument.to_string_lossy()).into_owned());
    Cli::try_parse_from(arguments).err().unwrap_or_else(|| {
        // Made harmless they are in order: then without colours.
        clap::Error::raw(error.kind(), printable(&error.render().to_string()))
    })
}

/// Says an error and returns its exit code. That a reader like `head` has seen enough is no fault.
fn report(error: &anyhow::Error) -> u8 {
    let enough = |cause: &(dyn Error + 'static)| {
        cause
            .downcast_ref::<io::Error>()
            .is_some_and(|error| error.kind() == io::ErrorKind::BrokenPipe)
    };
    if error.chain().any(enough) {
        return 0;
    }
    remark(&format!("error: {error:#}"));
    let of_input = |cause: &(dyn Error + 'static)| {
        cause.is::<InputError>()
            || matches!(cause.downcast_ref(), Some(LinkError::Open(_)))
            || matches!(cause.downcast_ref(), Some(FlashError::Open(_)))
    };
    if error.chain().any(of_input) {
        WRONG_INPUT
    } else {
        1
    }
}
