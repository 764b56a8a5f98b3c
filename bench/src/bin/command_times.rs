//! How long each command of `softrig` takes on the recordings of an example; `cargo xtask bench commands`
//! runs it.
//!
//! A machine that others use too is slower at times and never faster, so that the best of several
//! runs is shown, beside the processor time, which others hardly change.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};
use std::{fs, thread};

use clap::Parser;
use softrig_bench::pages::put_section;
use softrig_bench::real::children_cpu;
use softrig_tests::process::succeed;

/// Times each command of `softrig` on the recordings of an example.
#[derive(Debug, Parser)]
#[command(name = "cargo xtask bench commands")]
struct Args {
    /// The program to time
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    rig: PathBuf,
    /// Where the example goes
    #[arg(long, value_name = "DIR", overrides_with = "folder")]
    folder: PathBuf,
    /// Write the table into docs/benchmarks.md
    #[arg(long)]
    docs: bool,
}

/// The example; its recordings are steps to three angles, three times each, a staircase and a triangle.
const EXAMPLE: &str = "example -o demo --hide 2 --effect maxwell_branch";
/// Made of it before: what other lines read.
const BEFORE: &[&str] = &[
    "simulate --model demo/model.toml --recording demo/recordings/step60_1.csv -o before.csv",
    "simulate --model demo/truth.toml --recording demo/recordings/step60_1.csv -o after.csv",
    "convert demo/recordings/step60_1.csv -o run.mcap",
];

/// Where lines write to; it is empty before each run.
const NEW: &str = "new";

/// Command lines. `STEPS` are the steps of the example, `ALL` all of its recordings.
const LINES: &[&str] = &[
    "example -o new/demo --hide 2 --effect maxwell_branch",
    "init --recording demo/recordings/step60_1.csv --dry-run",
    "init --recording STEPS --dry-run",
    "fit --model demo/model.toml STEPS",
    "fit --model demo/model.toml STEPS --profile new/out.svg",
    "simulate --model demo/model.toml --recording demo/recordings/step60_1.csv -o new/out.csv",
    "simulate --model demo/model.toml --recording demo/recordings/step60_1.csv --arithmetic board -o new/out.csv",
    "simulate --model demo/model.toml --protocol steps -o new/out.csv",
    "compare --model demo/model.toml --model demo/truth.toml --linear STEPS",
    "gap before.csv --after after.csv --plot new/out.svg",
    "residuals --model demo/model.toml STEPS",
    "residuals --model demo/model.toml STEPS --report new/out.html",
    "linearise --model demo/model.toml --at 30deg --plot new/out.svg",
    "plan --model demo/model.toml --between gravity,exponent_shift",
    "plan --model demo/model.toml --between maxwell_branch,bouc_wen_hysteresis STEPS",
    "diagnose --model demo/model.toml demo/recordings/step60_1.csv",
    "diagnose --model demo/model.toml ALL",
    "diagnose --model demo/model.toml ALL --report new/out.html --json new/out.json --plot new/out.svg -o new/out.toml",
    "diagnose --batch cases.csv -o new",
    "diagnose --batch cases.csv -o new --jobs 2",
    "export --model demo/truth.toml --to c -o new/out.c",
    "export --model demo/truth.toml --to python -o new/out.py",
    "export --model demo/truth.toml --to matlab -o new/out.m",
    "export --model demo/truth.toml --to modelica -o new/out.mo",
    "export --model demo/truth.toml --to fmu -o new/out.fmu",
    "convert demo/recordings/step60_1.csv -o new/out.parquet",
    "convert demo/recordings/step60_1.csv -o new/out.mcap",
    "convert run.mcap -o new/out.csv",
    "materials list",
    "ports",
    "schema",
    "completions bash",
    "man -o new",
];

/// Commands that have no line, and why.
const LEFT_OUT: &[(&str, &str)] = &[
    ("monitor", "a board"),
    ("log", "a board"),
    ("record", "a board: as long as the run"),
    ("flash", "a board: as long as the cable takes for the image"),
    ("upload", "a board"),
    ("calibrate", "a board, and somebody"),
    ("commission", "a board, and somebody"),
    ("virtual", "runs until it is ended"),
    ("next", "a board; a plan and a diagnosis for each run"),
    ("help", ""),
];

/// Cases of the batch.
const CASES: usize = 8;
/// How often a line is run: at least so often, and on until this much time has gone.
const RUNS: u32 = 3;
const ENOUGH: Duration = Duration::from_secs(5);
const MOST: u32 = 20;
/// How long one run may take.
const LIMIT: Duration = Duration::from_secs(600);

fn main() -> ExitCode {
    match measure(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("commands: {problem}");
            ExitCode::FAILURE
        }
    }
}

/// One line with its best time (s), and the mean of its processor time (s) where the system says it.
struct Timed {
    line: &'static str,
    seconds: f64,
    cpu: Option<f64>,
    runs: u32,
}

fn measure(args: &Args) -> Result<(), String> {
    let rig = fs::canonicalize(&args.rig)
        .map_err(|error| format!("cannot run {}: {error}", args.rig.display()))?;
    let bench = Bench::make(&rig, &args.folder)?;
    bench.every_command_has_a_line()?;
    let load = load();
    println!("{:>8} {:>8} {:>5}  line", "s", "CPU s", "runs");
    let mut found = Vec::new();
    for line in LINES {
        let timed = bench.time(line)?;
        println!(
            "{:>8.3} {:>8.3} {:>5}  rig {}",
            timed.seconds,
            timed.cpu.unwrap_or(f64::NAN),
            timed.runs,
            timed.line
        );
        found.push(timed);
    }
    if args.docs {
        put_section("benchmarks.md", "commands", &section(&found, &load))?;
    }
    Ok(())
}

struct Bench<'a> {
    rig: &'a Path,
    folder: &'a Path,
    steps: Vec<String>,
    all: Vec<String>,
}

impl<'a> Bench<'a> {
    fn make(rig: &'a Path, folder: &'a Path) -> Result<Self, String> {
        let failed = |error: std::io::Error| format!("{}: {error}", folder.display());
        if folder.exists() {
            fs::remove_dir_all(folder).map_err(failed)?;
        }
        fs::create_dir_all(folder).map_err(failed)?;
        let mut bench = Self {
            rig,
            folder,
            steps: Vec::new(),
            all: Vec::new(),
        };
        bench.run(EXAMPLE)?;
        for entry in fs::read_dir(folder.join("demo/recordings")).map_err(failed)? {
            let path = entry.map_err(failed)?.path();
            if path.extension().is_some_and(|kind| kind == "csv") {
                let name = path.file_name().unwrap_or_default().display();
                bench.all.push(format!("demo/recordings/{name}"));
            }
        }
        bench.all.sort();
        bench.steps = bench.all.clone();
        bench.steps.retain(|name| name.contains("/step"));
        for line in BEFORE {
            bench.run(line)?;
        }
        let rows = (0..CASES).map(|case| {
            let run = &bench.steps[case % bench.steps.len()];
            format!("case_{case},demo/model.toml,{run}\n")
        });
        let manifest = format!("case,model,recordings\n{}", rows.collect::<String>());
        fs::write(folder.join("cases.csv"), manifest).map_err(failed)?;
        Ok(bench)
    }

    /// Runs a line in the folder.
    fn run(&self, line: &str) -> Result<(), String> {
        let mut command = Command::new(self.rig);
        command.current_dir(self.folder);
        for word in line.split(' ') {
            match word {
                "STEPS" => command.args(&self.steps),
                "ALL" => command.args(&self.all),
                word => command.arg(word),
            };
        }
        succeed(&mut command, LIMIT, &self.folder.join("log.txt"))
            .map_err(|error| format!("softrig {line}: {error}"))
    }

    fn time(&self, line: &'static str) -> Result<Timed, String> {
        let began = Instant::now();
        let before = children_cpu();
        let (mut best, mut runs) = (f64::INFINITY, 0);
        while runs < RUNS || (began.elapsed() < ENOUGH && runs < MOST) {
            let new = self.folder.join(NEW);
            let _ = fs::remove_dir_all(&new);
            fs::create_dir(&new).map_err(|error| format!("{}: {error}", new.display()))?;
            let clock = Instant::now();
            self.run(line)?;
            best = best.min(clock.elapsed().as_secs_f64());
            runs += 1;
        }
        let cpu = children_cpu().zip(before);
        Ok(Timed {
            line,
            seconds: best,
            cpu: cpu.map(|(after, before)| (after - before) / f64::from(runs)),
            runs,
        })
    }

    /// Whether each command that `softrig --help` lists has a line, or a reason.
    fn every_command_has_a_line(&self) -> Result<(), String> {
        self.run("--help")?;
        let help = fs::read_to_string(self.folder.join("log.txt")).unwrap_or_default();
        let listed = help
            .lines()
            .skip_while(|line| *line != "Commands:")
            .skip(1)
            .take_while(|line| line.starts_with("  "))
            .filter(|line| !line.starts_with("   "))
            .filter_map(|line| line.split_whitespace().next());
        let has_line = |command: &str| {
            LINES
                .iter()
                .any(|line| line.split(' ').next() == Some(command))
        };
        let has_reason = |command: &str| LEFT_OUT.iter().any(|(name, _)| *name == command);
        let forgotten: Vec<&str> = listed
            .filter(|command| !has_line(command) && !has_reason(command))
            .collect();
        if forgotten.is_empty() {
            return Ok(());
        }
        Err(format!("no line for: rig {}", forgotten.join(", rig ")))
    }
}

/// What stands in the page.
fn section(found: &[Timed], load: &str) -> String {
    let mut text = format!(
        "{}{load}. The best of {RUNS} to {MOST} runs each, and the mean of their processor time.\n\n\
         | command | s | CPU s |\n|---|---:|---:|\n",
        machine()
    );
    for timed in found {
        let shown = timed
            .line
            .replace("demo/recordings/", "")
            .replace("new/", "");
        // A string takes whatever is written to it.
        let _ = writeln!(
            text,
            "| `softrig {shown}` | {} | {} |",
            shown_seconds(timed.seconds),
            timed.cpu.map_or("–".into(), shown_seconds)
        );
    }
    text += "\nNot in the table: ";
    let reasons = LEFT_OUT.iter().filter(|(_, why)| !why.is_empty());
    let reasons: Vec<String> = reasons
        .map(|(command, why)| format!("`softrig {command}` ({why})"))
        .collect();
    text + &reasons.join(", ") + "."
}

/// Seconds with the digits that mean something on a busy machine.
fn shown_seconds(seconds: f64) -> String {
    match seconds {
        0.0..0.1 => format!("{seconds:.3}"),
        0.1..10.0 => format!("{seconds:.2}"),
        _ => format!("{seconds:.1}"),
    }
}

/// How many processes wanted a processor in the last minute, where the system says it.
fn load() -> String {
    let text = fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ').next().map_or_else(String::new, |load| {
        format!(", used by others too: {load} processes wanted them when this began")
    })
}

/// The processors of this machine, by their name where the system says it.
fn machine() -> String {
    let text = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(": "))
        .map_or("an unknown processor", |(_, name)| name);
    let count = thread::available_parallelism().map_or(1, usize::from);
    format!("{count} cores of {model}")
}
