//! The blind benchmark; `cargo xtask bench blind` builds and runs it.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Parser, ValueEnum};
use softrig_formats::error::{InputError, write_atomically};
use softrig_tests::blind::bench;
use softrig_tests::blind::cases::{Answer, plan, stable_hash};
use softrig_tests::blind::draw;
use softrig_tests::blind::experiments::Set;
use softrig_tests::blind::gate::Gate;
use softrig_tests::blind::score::score;
use softrig_tests::blind::verdicts::{diagnose_all, tool_hash};
use softrig_tests::blind::{GENERATOR, tables};

/// How often does the diagnosis name what is missing?
///
/// Draws truths with a simulator of its own, hides the answers, diagnoses, and
/// counts. Interrupting loses nothing: the same command goes on.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench blind")]
struct Args {
    /// Cases in each set
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..))]
    cases: u32,
    /// Which experiments
    #[arg(long, value_enum, default_value_t = Which::Rich)]
    set: Which,
    /// Seed of truths, experiments and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only these kinds, each alone
    #[arg(long, value_delimiter = ',')]
    kinds: Vec<String>,
    /// Cases that are diagnosed at the same time; each uses all cores
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// A few cases, held against tests/blind_gate.toml
    #[arg(long, conflicts_with_all = ["cases", "set", "seed", "kinds", "docs"])]
    fast: bool,
    /// Write docs/blind.md and its pictures
    #[arg(long)]
    docs: bool,
    /// Where cases, answers and verdicts go
    #[arg(long, default_value = "target/blind", overrides_with = "folder")]
    folder: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
    Rich,
    Paper,
    /// Rich and paper
    Both,
    /// Whole sessions, as on a bench
    Bench,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("blind: {error}");
            ExitCode::FAILURE
        }
    }
}

/// A benchmark: its sets, number of cases, seed.
struct Bench {
    sets: Vec<Set>,
    cases: u32,
    seed: u64,
    folder: PathBuf,
}

fn run(args: &Args) -> Result<ExitCode, InputError> {
    let gate = args.fast.then(Gate::committed).transpose()?;
    for kind in &args.kinds {
        if !softrig_tests::blind::truth::kinds().contains(&kind.as_str()) {
            return Err(InputError::new(
                format!("there is no kind {kind}"),
                "use names of the catalogue of effects",
            ));
        }
    }
    let (cases, seed) = gate
        .as_ref()
        .map_or((args.cases, args.seed), |gate| (gate.cases, gate.seed));
    let sets = match args.set {
        Which::Rich => vec![Set::Rich],
        Which::Paper => vec![Set::Paper],
        Which::Both => vec![Set::Rich, Set::Paper],
        Which::Bench => return run_bench(args),
    };
    let name = folder_name(&format!("seed{seed}_{cases}"), &args.kinds, GENERATOR);
    let bench = Bench {
        sets,
        cases,
        seed,
        folder: args.folder.join(name),
    };
    let tool = tool_hash();
    let verdicts = bench.folder.join(format!("verdicts_{tool}"));
    println!("blind: {}", bench.folder.display());

    let names = bench.make(&args.kinds)?;
    diagnose_all(&bench.folder.join("cases"), &verdicts, &names, args.jobs)?;

    let answers = bench.answers()?;
    eprintln!("scoring; the first time, the oracle's refits take a second or two a case");
    let scored = score(&answers, &verdicts, &bench.sealed());
    let text = tables::terminal(&scored);
    print!("{text}");
    let write = |path: &Path, text: &str| write_atomically(path, text.as_bytes());
    write(&verdicts.join("score.txt"), &text)?;
    write(&verdicts.join("cases.csv"), &tables::csv(&scored))?;
    let command = format!("cargo xtask bench blind {}", arguments(args));
    let page = tables::markdown(&scored, command.trim(), &tool);
    write(&verdicts.join("blind.md"), &page)?;
    let docs = softrig_tests::process::root().join("docs");
    if args.docs {
        let path = docs.join("blind.md");
        let before = std::fs::read_to_string(&path).unwrap_or_default();
        // The section of the set `bench` is written by another command.
        let page = match bench::tables::own_section(&before) {
            Some(section) => bench::tables::with_section(&page, section),
            None => page,
        };
        write(&path, &page)?;
    }
    for &set in &bench.sets {
        let picture = tables::picture(set, &scored);
        let file = format!("blind_{}.svg", set.name());
        write(&verdicts.join(&file), &picture)?;
        if args.docs {
            write(&docs.join("images").join(&file), &picture)?;
        }
    }
    println!("\nevery case: {}", verdicts.join("cases.csv").display());
    if let Some(gate) = gate {
        let failures = gate.check(&scored);
        for failure in &failures {
            eprintln!("blind gate: {failure}");
        }
        if !failures.is_empty() {
            return Ok(ExitCode::FAILURE);
        }
        println!("blind gate: passed");
    }
    Ok(ExitCode::SUCCESS)
}

/// Cases of another generator are other cases.
fn folder_name(start: &str, kinds: &[String], generator: &str) -> String {
    let hash = stable_hash(generator.as_bytes()) >> 32;
    let words: Vec<&str> = std::iter::once(start)
        .chain(kinds.iter().map(String::as_str))
        .collect();
    format!("{}_{hash:08x}", words.join("_"))
}

/// The set `bench`: its cases do not depend on how many there are, so all of a
/// seed share a folder.
fn run_bench(args: &Args) -> Result<ExitCode, InputError> {
    let start = format!("bench_seed{}", args.seed);
    let folder = args
        .folder
        .join(folder_name(&start, &args.kinds, bench::GENERATOR));
    let tool = tool_hash();
    let verdicts = folder.join(format!("verdicts_{tool}"));
    println!("blind: {}", folder.display());

    let plans = bench::cases::plan(args.cases, &args.kinds, args.seed);
    let names = draw_bench(&folder, &plans, args.seed)?;
    diagnose_all(&folder.join("cases"), &verdicts, &names, args.jobs)?;

    let mut answers = Vec::new();
    for name in &names {
        let path = folder.join("sealed").join(format!("{name}.json"));
        let text =
            std::fs::read_to_string(&path).map_err(|error| InputError::from_io(&path, &error))?;
        answers.push(serde_json::from_str(&text).map_err(|error| {
            InputError::new(
                format!("is damaged: {error}"),
                "delete the folder and run the command again",
            )
            .in_file(&path)
        })?);
    }
    let scored = bench::score::score(&answers, &verdicts);
    let text = bench::tables::terminal(&scored);
    print!("{text}");
    let write = |path: &Path, text: &str| write_atomically(path, text.as_bytes());
    write(&verdicts.join("score.txt"), &text)?;
    write(&verdicts.join("cases.csv"), &bench::tables::csv(&scored))?;
    let command = format!("cargo xtask bench blind {}", arguments(args));
    let section = bench::tables::section(&scored, command.trim(), &tool);
    write(&verdicts.join("blind.md"), &section)?;
    if args.docs {
        let path = softrig_tests::process::root().join("docs/blind.md");
        let page =
            std::fs::read_to_string(&path).map_err(|error| InputError::from_io(&path, &error))?;
        write(&path, &bench::tables::with_section(&page, &section))?;
    }
    println!("\nevery case: {}", verdicts.join("cases.csv").display());
    Ok(ExitCode::SUCCESS)
}

/// Writes the cases that are not there yet, each answer into a file of its own;
/// their names.
fn draw_bench(
    folder: &Path,
    plans: &[bench::cases::Plan],
    seed: u64,
) -> Result<Vec<String>, InputError> {
    let sealed = folder.join("sealed");
    std::fs::create_dir_all(&sealed).map_err(|error| InputError::from_io(&sealed, &error))?;
    let answer_of = |name: &str| sealed.join(format!("{name}.json"));
    let is_there = |name: &str| answer_of(name).exists();
    draw::bench(plans, seed, &folder.join("cases"), is_there, |answer| {
        let text = serde_json::to_string_pretty(answer).map_err(|error| {
            InputError::new(format!("the answer cannot be written: {error}"), "")
        })?;
        write_atomically(&answer_of(&answer.case), text.as_bytes())
    })?;
    Ok((0..plans.len()).map(bench::cases::case_name).collect())
}

/// The options as they would be typed, without those that change no figure.
fn arguments(args: &Args) -> String {
    let set = match args.set {
        Which::Rich => "rich",
        Which::Paper => "paper",
        Which::Both => "both",
        Which::Bench => "bench",
    };
    let mut text = format!("--set {set} --cases {} --seed {}", args.cases, args.seed);
    if !args.kinds.is_empty() {
        text += &format!(" --kinds {}", args.kinds.join(","));
    }
    text
}

impl Bench {
    fn sealed(&self) -> PathBuf {
        self.folder.join("sealed")
    }

    /// Writes the cases that are not there yet; their names.
    fn make(&self, kinds: &[String]) -> Result<Vec<String>, InputError> {
        let sealed = self.sealed();
        std::fs::create_dir_all(&sealed).map_err(|error| InputError::from_io(&sealed, &error))?;
        let mut names = Vec::new();
        for &set in &self.sets {
            let plans = plan(set, self.cases, kinds, self.seed);
            names.extend((0..plans.len()).map(|index| format!("{}_{index:03}", set.name())));
            let path = self.answers_path(set);
            if path.exists() {
                eprintln!("the {} cases are there already", set.name());
                continue;
            }
            let answers = draw::runs(&plans, self.seed, &self.folder.join("cases"))?;
            let text = serde_json::to_string_pretty(&answers).map_err(|error| {
                InputError::new(format!("the answers cannot be written: {error}"), "")
            })?;
            write_atomically(&path, text.as_bytes())?;
        }
        Ok(names)
    }

    fn answers_path(&self, set: Set) -> PathBuf {
        self.sealed().join(format!("answers_{}.json", set.name()))
    }

    /// Opens the answers. Only now: every verdict is written.
    fn answers(&self) -> Result<Vec<Answer>, InputError> {
        let mut all = Vec::new();
        for &set in &self.sets {
            let path = self.answers_path(set);
            let text = std::fs::read_to_string(&path)
                .map_err(|error| InputError::from_io(&path, &error))?;
            let answers: Vec<Answer> = serde_json::from_str(&text).map_err(|error| {
                InputError::new(
                    format!("is damaged: {error}"),
                    "delete the folder and run the command again",
                )
                .in_file(&path)
            })?;
            all.extend(answers);
        }
        Ok(all)
    }
}
