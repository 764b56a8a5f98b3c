//! Set-up, demo, test, book, flash, bench, soak, fuzz, ci and dist.
//!
//! Everything that takes more than one plain cargo command is a task here, in
//! Rust on the standard library alone: it compiles in a second on a machine that
//! has nothing yet, and runs the same everywhere.
#![forbid(unsafe_code)]

mod avr;
mod bench;
mod book;
mod demo;
mod dist;
mod flash;
mod image;
mod machines;
mod python;
mod setup;
mod shell;
mod simulator;
mod size;
mod stack;
mod test;
mod venv;

use std::{env, process::ExitCode};

use machines::{Fuzz, Soak};
use shell::Outcome;
use size::Golden;
use test::Scope;

const HELP: &str = "\
Tasks of the softrig workspace

Usage: cargo xtask <TASK> [OPTIONS]

Tasks:
  setup [--for PURPOSE] [--dry-run]
                         install what is missing for the demo, the tests (the
                         default) or `cargo run` in firmware/: demo, tests,
                         cargo-run
  demo [--seed N] [--effect KIND]
                         simulate, diagnose, repair; says where the picture is
  test [--host-only]     everything that must hold before a change goes in
  ci                     the same, as continuous integration runs it
  book                   build the book from docs/; says where it is
  wheel [--test]         build the Python package for this system and say where it is;
                         --test builds one quickly and tests it
  firmware               build the image, check it, print its size
  size [--accept]        memory and processor time against budgets and last time
  bench [diagnosis | host | board]
                         a whole diagnosis; our solver beside SciPy's and
                         Numba's; cycles on the board
  bench control [--docs] steps of the angle in closed loop with the real image:
                         overshoot and settling; --docs draws
                         docs/images/closed_loop_steps.svg
  bench many [--docs]    one diagnosis of 10 to 1000 recordings: time and
                         memory; --docs draws docs/images/many_recordings.svg
  bench blind [--fast | OPTIONS]
                         effects hidden in recordings of another simulator;
                         --set bench: in whole sessions, as on a bench
  bench loop --seeds A..B [--jobs N] [--docs]
                         the demo's loop for many actuators, drawn from seeds A
                         to B (both included) or a list 1,5,9; --jobs at a time
                         (half the cores); --docs writes docs/loop.md
  bench decide --seeds A..B [--only KIND,…] [--jobs N] [--docs]
                         for every effect: one session, then the experiments
                         that `rig next` makes; --docs writes docs/decide.md
  bench invariance [OPTIONS]
                         the same question asked otherwise (another seed, order,
                         first model, …): is the answer the same? Needs no labels;
                         --help lists the options
  bench calibration [OPTIONS]
                         of what is stated with 95 %, how much is right? On
                         drawn cases; --docs writes it into docs/diagnosis.md
  bench real [--only NAME,…] [--docs] [--rig PROGRAM]
                         recordings of eight real rigs: the diagnosis beside
                         black boxes; --docs writes docs/real.md; --rig takes
                         another `rig` than the one of this source
  soak [--hours H] [--seed N]
                         the image on the simulated rig at full speed: random
                         protocols, faults, pulled cables and resets; what is
                         promised is held against the simulated truth
  fuzz [--minutes N]     every parser and the settings store, guided by
                         coverage; all targets share the time
  miri                   the wire and the settings store in the interpreter
                         that finds undefined behaviour; installs a nightly
  flash --port PORT [--no-console] [--dry-run]
                         put the image on a board and show what it says
  dist [--target TRIPLE] [--with FILE] [--no-firmware] [--no-wheel] [--dry-run]
                         a release in target/dist: static `rig`, the image,
                         completions, manual pages, licences and checksums in one archive,
                         tried where there is nothing else; beside it the wheel
                         of the Python package, and what --with names

Examples:
  cargo xtask setup --dry-run
  cargo xtask test --host-only
  cargo xtask bench board
  cargo xtask bench loop --seeds 201..212
  cargo xtask bench invariance --sets rigs,real --ways seed,init
  cargo xtask bench real --only pendulum,silverbox
  cargo xtask soak --hours 8 --seed 7
  cargo xtask fuzz --minutes 30
  cargo xtask flash --port /dev/ttyACM0
  cargo xtask dist --dry-run
";

/// Exit code for a command line that makes no sense.
const USAGE: u8 = 2;

fn main() -> ExitCode {
    let words: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let result = match words.as_slice() {
        [] => return usage("no task was given"),
        ["help" | "-h" | "--help"] | [_, "-h" | "--help"] => {
            print!("{HELP}");
            return ExitCode::SUCCESS;
        }
        ["setup", words @ ..] => match setup::parse(words) {
            Ok((purpose, mode)) => setup::setup(purpose, mode),
            Err(problem) => return usage(&problem),
        },
        ["demo", words @ ..] => match demo::check(words) {
            Ok(()) => demo::demo(words),
            Err(problem) => return usage(&problem),
        },
        ["test" | "ci"] => test::test(Scope::Everything),
        ["test", "--host-only"] => test::test(Scope::Host),
        ["book"] => book::book().map(|page| println!("  {}", page.display())),
        ["wheel"] => python::wheel().map(drop),
        ["wheel", "--test"] => python::test(),
        ["firmware"] => firmware(),
        ["size"] => image_size(Golden::Check),
        ["size", "--accept"] => image_size(Golden::Accept),
        ["bench"] => bench::start("diagnosis", &[])
            .unwrap_or(Ok(()))
            .and_then(|()| bench::host())
            .and_then(|()| bench::board()),
        ["bench", "host"] => bench::host(),
        ["bench", "board"] => bench::board(),
        ["bench", "control"] => bench::control(false),
        ["bench", "control", "--docs"] => bench::control(true),
        ["bench", name, options @ ..] => match bench::start(name, options) {
            Some(outcome) => outcome,
            None => return usage(&format!("bench {name} is not known, or takes no options")),
        },
        ["soak", words @ ..] => match Soak::parse(words) {
            Ok(options) => machines::soak(&options),
            Err(problem) => return usage(&problem),
        },
        ["fuzz", words @ ..] => match Fuzz::parse(words) {
            Ok(options) => machines::fuzz(options),
            Err(problem) => return usage(&problem),
        },
        ["miri"] => machines::miri(),
        ["flash", words @ ..] => match flash::Options::parse(words) {
            Ok(options) => flash::flash(options),
            Err(problem) => return usage(&problem),
        },
        ["dist", words @ ..] => match dist::Options::parse(words) {
            Ok(options) => dist::dist(&options),
            Err(problem) => return usage(&problem),
        },
        [task, ..]
            if [
                "test", "ci", "book", "wheel", "firmware", "size", "bench", "miri",
            ]
            .contains(task) =>
        {
            return usage(&format!("{task} does not take these options"));
        }
        [task, ..] => return usage(&format!("there is no task {task:?}")),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("xtask: {failure}");
            ExitCode::FAILURE
        }
    }
}

fn usage(problem: &str) -> ExitCode {
    eprintln!("xtask: {problem}\n\n{HELP}");
    ExitCode::from(USAGE)
}

fn image_size(golden: Golden) -> Outcome {
    let image = avr::build()?;
    size::size(&image, golden, &simulator::virtual_rig()?)
}

fn firmware() -> Outcome {
    let image = avr::build()?;
    avr::gates(&image)?;
    avr::print_size(&image)?;
    println!("  {}", image.display());
    Ok(())
}
