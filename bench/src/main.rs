//! The benchmarks of `softrig`, which `cargo xtask bench` builds and starts.
//!
//! Each writes its figures as one JSON file, from which the pages can be written again: `pages FILE --docs`.
#![forbid(unsafe_code)]

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Parser, Subcommand};
use serde_json::Value;
use softrig_bench::asked::Asked;
use softrig_bench::invariance::ways::Way;
use softrig_bench::invariance::{calibration, known, run as invariance};
use softrig_bench::rig_loop::{bench as rig_loop, decide};
use softrig_bench::{
    blind, catalogue, commands, diagnosis, many, pages, pictures, public, real, search, simulate,
};
use softrig_tests::{process::root, write};

#[derive(Debug, Parser)]
#[command(
    name = "cargo xtask bench",
    bin_name = "cargo xtask bench",
    disable_help_subcommand = true
)]
struct Args {
    #[command(subcommand)]
    benchmark: Benchmark,
    /// Write tables and pictures into docs/
    #[arg(long, global = true)]
    docs: bool,
    /// Write all figures as JSON [default: bench/NAME.json in the folder that cargo builds into]
    #[arg(long, global = true, value_name = "FILE")]
    json: Option<PathBuf>,
    /// The folder that cargo builds into
    #[arg(
        long,
        global = true,
        value_name = "DIR",
        default_value = "target",
        hide = true
    )]
    target: PathBuf,
}

#[derive(Debug, Subcommand)]
enum Benchmark {
    Blind(blind::run::Options),
    Calibration(calibration::Options),
    /// What pages show of the code: the effects, and the constants of the diagnosis
    Catalogue,
    /// Times each command of `softrig` on the recordings of an example
    Commands(Asked),
    Decide(decide::Options),
    /// Times a whole diagnosis: of the real pendulum where its recordings are at hand, else of a
    /// simulated example
    Diagnosis(Asked),
    /// The same question, with recordings that cables, sensors and loggers made dirty
    Dirt(invariance::Options),
    Invariance(invariance::Options),
    Loop(rig_loop::Options),
    /// Diagnoses more and more recordings of 10 s and times each diagnosis
    Many(Asked),
    Public(public::Options),
    Real(real::Options),
    Search(search::Options),
    /// Times the simulation that every fit and diagnosis is made of
    Simulate,
    /// Shows the figures that a benchmark wrote as JSON
    Pages {
        file: PathBuf,
    },
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(missed) if missed.is_empty() => ExitCode::SUCCESS,
        Ok(missed) => {
            for miss in missed {
                eprintln!("bench: {miss}");
            }
            ExitCode::FAILURE
        }
        Err(problem) => {
            eprintln!("bench: {problem}");
            ExitCode::FAILURE
        }
    }
}

/// Which limits were missed, a sentence each.
fn run(args: &Args) -> Result<Vec<String>, String> {
    let target = &args.target;
    let without_a_page = matches!(
        args.benchmark,
        Benchmark::Diagnosis(_)
            | Benchmark::Dirt(_)
            | Benchmark::Invariance(_)
            | Benchmark::Simulate
    );
    if args.docs && without_a_page {
        return Err("docs/ has nothing of this benchmark: leave out --docs".into());
    }
    let figures = match &args.benchmark {
        Benchmark::Blind(options) => options.measure(&target.join("blind")),
        Benchmark::Calibration(options) => options.measure(target),
        Benchmark::Catalogue => Ok(catalogue::figures()),
        Benchmark::Commands(asked) => commands::measure(asked, &target.join("bench/commands")),
        Benchmark::Decide(options) => options.measure(&target.join("decide")),
        Benchmark::Diagnosis(asked) => diagnosis::measure(asked, &target.join("bench/example")),
        Benchmark::Dirt(options) => options.measure(target, "dirt", &Way::DIRTY),
        Benchmark::Invariance(options) => options.measure(target, "invariance", &Way::OTHERS),
        Benchmark::Loop(options) => options.measure(&target.join("loop")),
        Benchmark::Many(asked) => many::measure(asked, &target.join("bench/many")),
        Benchmark::Public(options) => options.measure(&target.join("public")),
        Benchmark::Real(options) => options.measure(&target.join("real"), args.docs),
        Benchmark::Search(options) => Ok(options.measure(&target.join("search"))),
        Benchmark::Simulate => simulate::measure(),
        Benchmark::Pages { file } => known::read_json(file),
    }?;
    if !matches!(args.benchmark, Benchmark::Pages { .. }) {
        let name = format!("bench/{}.json", pages::name_of(&figures)?);
        let text = serde_json::to_string_pretty(&figures).map_err(|error| error.to_string())?;
        let path = args.json.clone().unwrap_or_else(|| target.join(name));
        write(&path, &text)?;
        eprintln!("all figures: {}", path.display());
    }
    let text = pages::render(&figures)?;
    print!("{}", pages::for_terminal(&text));
    if args.docs {
        let docs = root().join("docs");
        pages::write_into(&docs, &figures, &text)?;
        for (name, svg) in pictures::of(&figures)? {
            write(&docs.join("images").join(name), &svg)?;
        }
    }
    let missed = figures["missed"].as_array().into_iter().flatten();
    Ok(missed
        .filter_map(Value::as_str)
        .map(str::to_owned)
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Args, clap::Error> {
        Args::try_parse_from(std::iter::once("bench").chain(line.split_whitespace()))
    }

    #[test]
    fn command_lines_are_read() {
        const REAL: &str = "real --python python --softrig a/rig";
        const LOOP: &str = "loop --softrig a/rig --simulator virtual-rig --image firmware.elf";
        assert!(parse(&format!("{REAL} --docs")).unwrap().docs);
        for line in [
            format!("{REAL} --only pendulum,silverbox --softrig b/rig"),
            format!("{LOOP} --docs --seeds 1..3 --jobs 2"),
            "public --softrig a/rig --only emps".into(),
            "blind --fast --target target".into(),
            "blind --set laws,paper --cases 3 --docs".into(),
            "search --sets example,bench --only gravity,leak --seeds 1..2 --docs".into(),
            "pages target/bench/loop.json --docs".into(),
        ] {
            parse(&line).unwrap_or_else(|error| panic!("{line}: {error}"));
        }
        for line in [
            format!("{REAL} --only"),
            format!("{REAL} --docs --only pendulum"),
            format!("{REAL} --jobs 1"),
            LOOP.into(),
            format!("{LOOP} --seeds"),
            format!("{LOOP} --seeds 5..1"),
            format!("{LOOP} --jobs 0 --seeds 1"),
            format!("{LOOP} --seeds 1 --job 1"),
            "blind --fast --docs".into(),
            "blind --set rigs".into(),
            "search --only none".into(),
        ] {
            assert!(parse(&line).is_err(), "{line}");
        }
    }
}
