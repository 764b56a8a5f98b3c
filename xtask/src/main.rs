//! Set-up, demo, test, book, page, flash, bench, soak, fuzz, ci and release.
//!
//! Everything that takes more than one plain cargo command is a task here, in
//! Rust on the standard library alone: it compiles in a second on a machine that
//! has nothing yet, and runs the same everywhere.
#![forbid(unsafe_code)]

mod avr;
mod bench;
mod book;
mod cast;
mod changes;
mod demo;
mod deny;
mod flash;
mod image;
mod machines;
#[cfg(test)]
#[path = "../../host-tools/tests/common/pages.rs"]
mod pages;
mod python;
mod release;
mod setup;
mod shell;
mod simulator;
mod size;
mod stack;
mod test;
mod venv;
mod web;

use std::{env, process::ExitCode};

use machines::{Fuzz, Soak};
use python::Ray;
use shell::Outcome;
use size::Golden;

const HELP: &str = "\
Tasks of the softrig workspace

Usage: cargo xtask <TASK> [OPTIONS]

Tasks:
  setup [--for PURPOSE] [--dry-run]
                         install what is missing for the demo or for the tests
                         (the default): demo, tests
  demo [--seed N] [--effect KIND] [--cast FILE.svg]
                         simulate, diagnose, repair; says where the picture is;
                         --cast draws the terminal as a picture that moves
  test [SET…] [--all] [--only STEP,…]
                         everything that must hold before a change goes in; of
                         sets alone: lint, core, board, lab, bench. --all adds
                         what takes long, and repeats what did not change
  ci                     the same, as continuous integration runs it
  book                   build the book from docs/; says where it is
  web                    build the page for a browser, web/dist/softrig.html
  wheel [--test [--ray]] build the Python package for this system and say where it is;
                         --test builds one quickly and tests it, --ray also with
                         Ray, which takes minutes to install
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
  bench commands [--docs]
                         how long each subcommand of `softrig` takes on recordings of
                         an example; --docs writes it into docs/benchmarks.md
  bench blind [--fast | OPTIONS]
                         what is missing, hidden in recordings of another simulator;
                         --set bench: in whole sessions, as on a bench;
                         --set laws: forces that no catalogue has
  bench loop --seeds A..B [--jobs N] [--docs]
                         the demo's loop for many actuators, drawn from seeds A
                         to B (both included) or a list 1,5,9; --jobs at a time
                         (half the cores); --docs writes docs/loop.md
  bench decide --seeds A..B [--only KIND,…] [--jobs N] [--docs]
                         for every effect: one session, then the experiments
                         that `softrig next` makes; --docs writes docs/decide.md
  bench invariance [OPTIONS]
                         the same question asked otherwise (another seed, order,
                         first model, …): is the answer the same? Needs no labels;
                         --help lists the options
  bench dirt [OPTIONS]   the same with recordings that cables, sensors and loggers
                         made dirty in fourteen ways
  bench calibration [OPTIONS]
                         of what is stated with 95 %, how much is right? On
                         drawn cases; --docs writes it into docs/diagnosis.md
  bench public [--only NAME,…] [--docs]
                         three public sets under the rules of their tables;
                         --docs writes docs/public.md
  bench real [--only NAME,…] [--docs] [--softrig PROGRAM]
                         recordings of eight real rigs: the diagnosis beside
                         black boxes; --docs writes docs/real.md; --softrig takes
                         another `softrig` than the one of this source
  bench search [--seeds A..B] [--sets SET,…] [--only KIND,…] [--minutes M] [--docs]
                         does the search find the fit that there is? Beside fits
                         that start at drawn truths; --docs writes docs/search.md
  bench catalogue --docs the tables of effects and constants in docs/, from
                         the code
  bench pages FILE [--docs]
                         show the figures that a benchmark left in
                         target/bench/NAME.json, or write them into docs/ again
  soak [--hours H] [--seed N]
                         the image on the simulated rig at full speed: random
                         protocols, faults, pulled cables and resets; what is
                         promised is held against the simulated truth
  fuzz [--minutes N]     every parser and the settings store, guided by
                         coverage; all targets share the time
  miri                   the wire and the settings store in the interpreter
                         that finds undefined behaviour; installs a nightly
  flash [--port PORT] [--no-console] [--dry-run]
                         put the image on a board and show what it says
  release [--target TRIPLE] [--with FILE] [--no-firmware] [--no-web]
       [--no-wheel] [--dry-run]
                         a release in target/dist: static `softrig`, the image,
                         completions, manual pages, licences and checksums in one archive,
                         tried where there is nothing else; beside it the wheel
                         of the Python package, the page, the image, what --with names,
                         and index.html, which says which of them one needs

Examples:
  cargo xtask setup --dry-run
  cargo xtask test lint core
  cargo xtask bench board
  cargo xtask bench loop --seeds 201..212
  cargo xtask bench invariance --sets rigs,real --ways seed,init
  cargo xtask bench real --only pendulum,silverbox
  cargo xtask soak --hours 8 --seed 7
  cargo xtask fuzz --minutes 30
  cargo xtask flash --port /dev/ttyACM0
  cargo xtask release --dry-run
";

/// Exit code for a command line that makes no sense.
const USAGE: u8 = 2;

fn main() -> ExitCode {
    let words: Vec<String> = env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    if let ["help" | "-h" | "--help"] | [_, "-h" | "--help"] = words.as_slice() {
        print!("{HELP}");
        return ExitCode::SUCCESS;
    }
    match task(&words).map(|task| task()) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(failure)) => {
            eprintln!("xtask: {failure}");
            ExitCode::FAILURE
        }
        Err(problem) => {
            eprintln!("xtask: {problem}\n\n{HELP}");
            ExitCode::from(USAGE)
        }
    }
}

/// Something to do, when its command line has been understood.
type Task<'a> = Box<dyn FnOnce() -> Outcome + 'a>;

/// Reads a command line.
///
/// # Errors
///
/// Says what makes no sense.
fn task<'a>(words: &'a [&'a str]) -> Result<Task<'a>, String> {
    Ok(match words {
        [] => return Err("no task was given".into()),
        ["setup", words @ ..] => {
            let (purpose, mode) = setup::parse(words)?;
            Box::new(move || setup::setup(purpose, mode))
        }
        ["demo", words @ ..] => {
            demo::check(words)?;
            Box::new(|| demo::demo(words))
        }
        ["test" | "ci", words @ ..] => {
            let choice = test::Choice::parse(words)?;
            Box::new(move || test::test(&choice))
        }
        ["book"] => Box::new(|| book::book().map(|page| println!("  {}", page.display()))),
        ["web"] => Box::new(|| web::web().map(drop)),
        ["wheel"] => Box::new(|| python::wheel().map(drop)),
        ["wheel", "--test"] => Box::new(|| python::test(Ray::Skipped)),
        ["wheel", "--test", "--ray"] => Box::new(|| python::test(Ray::Installed)),
        ["firmware"] => Box::new(firmware),
        ["size"] => Box::new(|| image_size(Golden::Check)),
        ["size", "--accept"] => Box::new(|| image_size(Golden::Accept)),
        ["bench"] => Box::new(|| {
            bench::start("diagnosis", &[])?;
            bench::host()?;
            bench::board()
        }),
        ["bench", "host"] => Box::new(bench::host),
        ["bench", "board"] => Box::new(bench::board),
        ["bench", "control"] => Box::new(|| bench::control(false)),
        ["bench", "control", "--docs"] => Box::new(|| bench::control(true)),
        ["bench", name, options @ ..] if bench::is_known(name) => {
            Box::new(|| bench::start(name, options))
        }
        ["bench", name, ..] => {
            return Err(format!("bench {name} is not known, or takes no options"));
        }
        ["soak", words @ ..] => {
            let options = Soak::parse(words)?;
            Box::new(move || machines::soak(&options))
        }
        ["fuzz", words @ ..] => {
            let options = Fuzz::parse(words)?;
            Box::new(move || machines::fuzz(options))
        }
        ["miri"] => Box::new(machines::miri),
        ["flash", words @ ..] => {
            let options = flash::Options::parse(words)?;
            Box::new(move || flash::flash(options))
        }
        ["release", words @ ..] => {
            let options = release::Options::parse(words)?;
            Box::new(move || release::release(&options))
        }
        [task, ..]
            if ["book", "web", "wheel", "firmware", "size", "bench", "miri"].contains(task) =>
        {
            return Err(format!("{task} does not take these options"));
        }
        [task, ..] => return Err(format!("there is no task {task:?}")),
    })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documented_tasks_are_accepted() {
        let mut count = 0;
        for page in pages::pages() {
            let text = std::fs::read_to_string(&page).unwrap();
            for block in pages::blocks(&text) {
                assert!(!block.info.contains('`'), "{}", page.display());
                for line in pages::command_lines(block.text, "xtask") {
                    let words = pages::words(&line.command);
                    let words: Vec<&str> = words[1..].iter().map(String::as_str).collect();
                    assert!(
                        line.shown.is_empty(),
                        "nobody compares this: {}",
                        line.shown
                    );
                    if let Err(problem) = task(&words) {
                        panic!("{}: {}: {problem}", page.display(), line.command);
                    }
                    count += 1;
                }
            }
        }
        assert!(count > 15, "only {count} tasks were found");
        assert!(task(&["tset"]).is_err() && task(&["size", "--acept"]).is_err());
    }
}
