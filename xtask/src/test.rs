//! Everything that must hold before a change goes in, in one command.
//!
//! The steps are a table: what each is called, what it costs, whose it is and when it runs.
//! CONTRIBUTING.md shows it, and a test compares. The run ends with what each step took, the
//! slowest tests, and a remark where a step costs half as much again as the table says.

use std::{
    collections::BTreeSet,
    io::{BufRead, BufReader},
    path::PathBuf,
    process::{Command, Stdio},
    time::Duration,
};

use crate::{
    avr, bench, book,
    changes::Passed,
    deny, python,
    setup::{self, Mode, Purpose},
    shell::{Failure, Outcome, Steps, cargo, has_program, root, run, run_quietly, target_dir},
    size::{self, Golden},
    web,
};

/// What a step belongs to, as jobs of continuous integration run them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Set {
    /// Form, lints, licences and documentation.
    Lint,
    /// What stock Rust builds and tests without anything else.
    Core,
    /// The firmware and its simulator.
    Board,
    /// Binary formats, other languages, Python and the page.
    Lab,
    /// The benchmarks.
    Bench,
}

impl Set {
    const ALL: [Self; 5] = [Self::Lint, Self::Core, Self::Board, Self::Lab, Self::Bench];

    fn name(self) -> &'static str {
        match self {
            Self::Lint => "lint",
            Self::Core => "core",
            Self::Board => "board",
            Self::Lab => "lab",
            Self::Bench => "bench",
        }
    }
}

/// When a step runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum When {
    /// Each time.
    Always,
    /// If something in these folders changed since it last passed for this user.
    Changed(&'static [&'static str]),
    /// With `--all`.
    All,
}

/// A step of the test.
struct Step {
    name: &'static str,
    sets: &'static [Set],
    when: When,
    /// Seconds of a processor from an empty target folder, on the machine of the table.
    processor_s: f64,
    run: fn(&Choice) -> Outcome,
}

impl Step {
    /// The file that it makes for those after it.
    fn makes(&self) -> Option<PathBuf> {
        (self.name == "page").then(web::page)
    }
}

/// What the page and the Python package are made of.
const OF_THE_PAGE: &[&str] = &[
    "Cargo.lock",
    "Cargo.toml",
    "firmware",
    "host-tools",
    "lab/importers",
    "lab/web",
    "model-core",
    "wire",
    "xtask/src/web.rs",
];
const OF_PYTHON: &[&str] = &[
    "Cargo.lock",
    "Cargo.toml",
    "docs",
    "host-tools",
    "lab/export",
    "lab/importers",
    "lab/print",
    "lab/python",
    "model-core",
    "wire",
    "xtask/src/python.rs",
];

use Set::{Bench, Board, Core, Lab, Lint};

/// The steps in their order.
static STEPS: [Step; 14] = [
    step("set-up", &[Board, Lab, Bench], When::Always, 70.0, |_| {
        setup::setup(Purpose::Tests, Mode::Install)
    }),
    step("format", &[Lint, Core], When::Always, 5.0, |_| {
        run(cargo().args(["fmt", "--all", "--", "--check"]))
    }),
    step("licences", &[Lint], When::Always, 5.0, |_| deny::check()),
    step("firmware", &[Board], When::Always, 45.0, |_| {
        avr::gates(&avr::build()?)
    }),
    step("page", &[Lab], When::Changed(OF_THE_PAGE), 630.0, |_| {
        web::web().map(drop)
    }),
    step("clippy", &[Lint, Core], When::Always, 200.0, |choice| {
        run(choice
            .packages("clippy")
            .arg("--all-targets")
            .args(["--", "-D", "warnings"]))
    }),
    step("tests", &[Core, Board, Lab], When::Always, 2900.0, tests),
    step(
        "examples in the text",
        &[Core],
        When::Always,
        30.0,
        |choice| run(choice.packages("test").args(["--doc", "--", "-q"])),
    ),
    step("size", &[Board], When::Always, 10.0, |_| {
        size::size(&avr::build()?, Golden::Check, &virtual_rig())
    }),
    step(
        "documentation",
        &[Lint, Core],
        When::Always,
        60.0,
        |choice| {
            run(choice
                .packages("doc")
                .arg("--no-deps")
                .env("RUSTDOCFLAGS", "-D warnings"))
        },
    ),
    // Links and commands in it are among the tests.
    step("book", &[Lint], When::Always, 5.0, |_| {
        book::book().map(drop)
    }),
    step("blind gate", &[Bench], When::Always, 425.0, |_| {
        bench::gate()
    }),
    step(
        "Python package",
        &[Lab],
        When::Changed(OF_PYTHON),
        370.0,
        |_| python::test(python::Ray::Skipped),
    ),
    step("benchmark gates", &[Bench], When::All, 3000.0, |_| {
        bench::gates()
    }),
];

const fn step(
    name: &'static str,
    sets: &'static [Set],
    when: When,
    processor_s: f64,
    run: fn(&Choice) -> Outcome,
) -> Step {
    Step {
        name,
        sets,
        when,
        processor_s,
        run,
    }
}

/// A step that takes so many times what the table says is worth a remark.
const REMARKABLE: f64 = 1.5;
/// Steps below this (s of a processor) are not compared: a slow disk decides there.
const SHORT_S: f64 = 30.0;
/// How many of the slowest tests are shown.
const SLOWEST: usize = 10;

/// Longest time that one small package from the network takes.
const NPM_LIMIT: Duration = Duration::from_secs(120);

/// Set for tests that are longer with `--all`.
const EVERYTHING: &str = "SOFTRIG_ALL_TESTS";

/// What is to be run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Choice {
    /// Steps of these sets; all where none is named.
    sets: Vec<Set>,
    /// These steps alone, by name.
    only: Vec<String>,
    /// Also what takes long, and what did not change.
    all: bool,
}

impl Choice {
    /// Reads the words after `test`.
    ///
    /// # Errors
    ///
    /// Says what makes no sense.
    pub fn parse(words: &[&str]) -> Result<Self, String> {
        let mut choice = Self {
            sets: Vec::new(),
            only: Vec::new(),
            all: false,
        };
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            match word {
                "--all" => choice.all = true,
                "--host-only" => choice.sets.push(Core),
                "--only" => {
                    let names = words.next().ok_or("test: --only needs names of steps")?;
                    choice.only.extend(names.split(',').map(str::to_owned));
                }
                word => match Set::ALL.into_iter().find(|set| set.name() == word) {
                    Some(set) => choice.sets.push(set),
                    None => return Err(format!("test does not know {word:?}")),
                },
            }
        }
        let unknown = |name: &&String| STEPS.iter().all(|step| step.name != **name);
        if let Some(name) = choice.only.iter().find(unknown) {
            let names: Vec<&str> = STEPS.iter().map(|step| step.name).collect();
            return Err(format!(
                "test has no step {name:?}; its steps are {}",
                names.join(", ")
            ));
        }
        Ok(choice)
    }

    /// Whether it is all of the workspace.
    fn is_whole(&self) -> bool {
        self.sets.is_empty()
    }

    /// Why a step does not run; none if it does.
    fn leaves_out(&self, step: &Step) -> Option<String> {
        if !self.only.is_empty() {
            // Whoever names a step wants to see it run.
            let is_named = self.only.iter().any(|name| name == step.name);
            return (!is_named).then(|| "not asked for".into());
        }
        if !self.is_whole() && !step.sets.iter().any(|set| self.sets.contains(set)) {
            return Some("not asked for".into());
        }
        match step.when {
            When::All if !self.all => Some("only with --all".into()),
            When::Changed(inputs)
                if !self.all && Passed::of(step.name, inputs).is_known(step.makes().as_deref()) =>
            {
                Some("nothing that it stands on changed since it passed; --all runs it".into())
            }
            _ => None,
        }
    }

    /// cargo on what is to be run. On all crates at once: of some of them alone it would ask their
    /// dependencies for fewer features, and compile most of them once more, docs/decisions/history.md (58).
    fn packages(&self, command: &str) -> Command {
        let mut cargo = cargo();
        cargo.args([command, "--locked"]);
        if self.is_whole() {
            cargo.arg("--workspace");
            return cargo;
        }
        for (set, packages) in [(Core, CORE), (Board, BOARD), (Lab, LAB), (Bench, BENCH)] {
            if self.sets.contains(&set) || self.sets == [Lint] {
                cargo.args(packages.iter().flat_map(|name| ["-p", name]));
            }
        }
        cargo
    }
}

const CORE: &[&str] = &[
    "model-core",
    "wide-mul",
    "softrig-wire",
    "softrig-cli",
    "softrig-formats",
    "softrig-link",
    "softrig-materials",
    "softrig-report",
    "softrig",
    "softrig-tests",
    "xtask",
];
const BOARD: &[&str] = &["firmware", "virtual-rig", "softrig-bench-board"];
const LAB: &[&str] = &[
    "softrig-cli",
    "softrig-export",
    "softrig-fuzz",
    "softrig-importers",
    "softrig-lab-tests",
    "softrig-print",
    "softrig-web",
];
const BENCH: &[&str] = &["softrig-bench", "softrig-worlds"];

/// Runs the tests; the first failure stops them.
pub fn test(choice: &Choice) -> Outcome {
    let mut steps = Steps::new(STEPS.len());
    for step in &STEPS {
        if let Some(why) = choice.leaves_out(step) {
            steps.skip(step.name, &why);
            continue;
        }
        steps.step(step.name, || (step.run)(choice))?;
        if let When::Changed(inputs) = step.when {
            Passed::of(step.name, inputs).keep(step.makes().as_deref());
        }
    }
    steps.table();
    for remark in remarks(&steps.took()) {
        println!("{remark}");
    }
    steps.finish("cargo xtask test");
    Ok(())
}

/// What is said of steps that cost more than the table says.
fn remarks(took: &[(&'static str, f64)]) -> Vec<String> {
    let entry = |name: &str| STEPS.iter().find(|step| step.name == name);
    took.iter()
        .filter_map(|(name, took_s)| {
            let expected_s = entry(name)?.processor_s;
            (*took_s > SHORT_S && *took_s > REMARKABLE * expected_s).then(|| {
                format!(
                    "remark: {name} took {took_s:.0} s of a processor, {:.1} times the {expected_s:.0} of its entry in xtask/src/test.rs",
                    took_s / expected_s
                )
            })
        })
        .collect()
}

/// The tests of all crates: on the host, with the image on the simulated rig, and with the
/// report and the page in headless Chromium. Without the board and the browser, theirs say that they are
/// skipped.
fn tests(choice: &Choice) -> Outcome {
    let mut tests = choice.packages("test");
    // Examples in the text are not programs, and cannot be timed.
    tests.args(["--tests", "--no-fail-fast"]);
    let has = |set| choice.is_whole() || choice.sets.contains(&set);
    if has(Board) || has(Lab) {
        second_processor();
        tests
            .env("SOFTRIG_FIRMWARE", avr::build()?)
            .env("SOFTRIG_VIRTUAL_RIG", virtual_rig());
        if !choice.is_whole() {
            // The simulator is built with the tests of its crate, or by itself.
            run(cargo().args(["build", "-q", "--locked", "-p", "virtual-rig"]))?;
        }
    }
    if has(Lab) {
        let chromium = setup::chromium().ok_or("Chromium is not on the search path")?;
        tests
            .env("SOFTRIG_CHROMIUM", chromium)
            .env("SOFTRIG_PAGE", web::page())
            // What runs exported models is there: see the set-up.
            .env("SOFTRIG_EXPORT_TOOLS", "required");
    }
    if choice.all {
        tests.env(EVERYTHING, "1");
    }
    timed(&mut tests)
}

/// Runs test programs, shows what is not an ordinary success, and then the slowest of them.
fn timed(tests: &mut Command) -> Outcome {
    // Times of tests are an unstable option of the test programs, which this variable lets stock
    // Rust use; the compiler does not see it.
    let host = env!("SOFTRIG_HOST").replace('-', "_").to_uppercase();
    tests
        .env(
            format!("CARGO_TARGET_{host}_RUNNER"),
            "env RUSTC_BOOTSTRAP=1",
        )
        // Some wait for a board's time, not for a processor.
        .args(["--", "-Zunstable-options", "--report-time"])
        .stdout(Stdio::piped());
    let cannot = |error: std::io::Error| Failure(format!("the tests: {error}"));
    let mut child = tests.spawn().map_err(cannot)?;
    let out = child.stdout.take().ok_or("the tests have no output")?;
    let mut slowest: BTreeSet<(Duration, String)> = BTreeSet::new();
    for line in BufReader::new(out).lines() {
        let line = line.map_err(cannot)?;
        match of_test(&line) {
            Some((name, took)) => {
                slowest.insert((took, name.to_owned()));
                if slowest.len() > SLOWEST {
                    slowest.pop_first();
                }
            }
            None if !line.is_empty() => println!("{line}"),
            None => {}
        }
    }
    println!("the slowest tests:");
    for (took, name) in slowest.iter().rev() {
        println!("  {:>6.1} s  {name}", took.as_secs_f64());
    }
    if child.wait().map_err(cannot)?.success() {
        Ok(())
    } else {
        Err("a test failed".into())
    }
}

/// The name of a test that passed, and its time, in a line like `test a::b ... ok <1.234s>`.
fn of_test(line: &str) -> Option<(&str, Duration)> {
    let (name, time) = line.strip_prefix("test ")?.split_once(" ... ok <")?;
    let seconds: f64 = time.strip_suffix("s>")?.parse().ok()?;
    Some((name, Duration::try_from_secs_f64(seconds).ok()?))
}

/// avr8js, on which the image runs beside simavr. Where npm is not to be had or finds nothing, the
/// test says that it is skipped.
fn second_processor() {
    let folder = root().join("tests/second_processor");
    if folder.join("node_modules/avr8js").exists() || !has_program("npm") {
        return;
    }
    let mut npm = Command::new("npm");
    npm.args(["ci", "--no-audit", "--no-fund"])
        .current_dir(folder);
    if let Err(why) = run_quietly(&mut npm, NPM_LIMIT) {
        println!("avr8js was not installed, so the image runs on simavr alone: {why}");
    }
}

/// The simulator's command, which is built with the tests of its crate.
fn virtual_rig() -> PathBuf {
    target_dir().join("debug/virtual-rig")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_and_steps_choose_what_runs() {
        let names = |words: &[&str]| -> Vec<&str> {
            let choice = Choice::parse(words).unwrap();
            STEPS
                .iter()
                .filter(|step| choice.leaves_out(step).is_none())
                .map(|step| step.name)
                .collect()
        };
        assert_eq!(names(&["--all"]).len(), STEPS.len());
        assert!(!names(&["bench"]).contains(&"benchmark gates"));
        assert_eq!(names(&["--only", "format,book"]), ["format", "book"]);
        assert!(!names(&["core"]).contains(&"firmware"));
        assert!(Choice::parse(&["--only", "fromat"]).is_err());
        assert!(Choice::parse(&["everything"]).is_err());
    }

    #[test]
    fn times_of_tests_are_read() {
        assert_eq!(
            of_test("test a::b ... ok <1.234s>"),
            Some(("a::b", Duration::from_millis(1234)))
        );
        for line in [
            "test a ... FAILED <1.2s>",
            "test a ... ok",
            "running 3 tests",
        ] {
            assert_eq!(of_test(line), None, "{line}");
        }
    }

    #[test]
    fn a_step_that_costs_more_than_its_entry_is_remarked() {
        assert!(remarks(&[("firmware", 46.0), ("book", 29.0)]).is_empty());
        let [remark] = remarks(&[("firmware", 130.0)]).try_into().unwrap();
        assert!(remark.contains("firmware took 130 s") && remark.contains("2.9 times"));
    }

    /// CONTRIBUTING.md has the table of the steps.
    #[test]
    fn the_table_of_the_page_is_that_of_the_code() {
        let page = std::fs::read_to_string(root().join("CONTRIBUTING.md")).unwrap();
        for step in &STEPS {
            let sets: Vec<&str> = step.sets.iter().map(|set| set.name()).collect();
            let when = match step.when {
                When::Always => "always",
                When::Changed(_) => "if what it stands on changed, and with `--all`",
                When::All => "`--all`",
            };
            let row = format!(
                "| {} | {} | {when} | {:.0} |",
                step.name,
                sets.join(", "),
                step.processor_s
            );
            assert!(page.contains(&row), "CONTRIBUTING.md lacks the row {row}");
        }
    }
}
