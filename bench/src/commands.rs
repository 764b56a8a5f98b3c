//! How long each command of `softrig` takes on the recordings of an example.
//!
//! A machine that others use too is slower at times and never faster, so that the best of several
//! runs is shown, beside the processor time, which others hardly change.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use std::{fs, thread};

use serde::Serialize;
use serde_json::{Value, json};
use softrig_tests::process::succeed;

use crate::asked::Asked;
use crate::processor::{self, Of};

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

/// The manifest of the batch.
const CASES_FILE: &str = "cases.csv";
/// Its cases.
const CASES: usize = 8;
/// How often a line is run: at least so often, and on until this much time has gone.
const RUNS: u32 = 3;
const ENOUGH: Duration = Duration::from_secs(5);
const MOST: u32 = 20;
/// How long one run may take.
const LIMIT: Duration = Duration::from_secs(600);

/// One line.
#[derive(Serialize)]
struct Timed {
    line: &'static str,
    /// The best time (s).
    seconds: f64,
    /// The mean of its processor time (s), where the system says it.
    cpu_seconds: Option<f64>,
    runs: u32,
}

/// Times every line.
///
/// # Errors
///
/// If a line fails, or a command has none.
pub fn measure(asked: &Asked, folder: &Path) -> Result<Value, String> {
    let rig = fs::canonicalize(&asked.rig)
        .map_err(|error| format!("cannot run {}: {error}", asked.rig.display()))?;
    let folder = asked.folder(folder);
    let bench = Bench::make(&rig, folder)?;
    bench.every_command_has_a_line()?;
    let machine = machine();
    let mut lines = Vec::new();
    for line in LINES {
        eprintln!("softrig {line}");
        lines.push(bench.time(line)?);
    }
    Ok(figures(&machine, &lines))
}

fn figures(machine: &Value, lines: &[Timed]) -> Value {
    let left_out = LEFT_OUT.iter().filter(|(_, why)| !why.is_empty());
    let left_out = left_out.map(|(command, why)| json!({ "command": command, "why": why }));
    json!({
        "benchmark": "commands", "machine": machine, "runs": [RUNS, MOST], "lines": lines,
        "left_out": left_out.collect::<Vec<_>>(),
    })
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
            // Nothing is removed that was not made here.
            if !folder.join(CASES_FILE).exists() {
                return Err(format!("{}: choose a new folder", folder.display()));
            }
            fs::remove_dir_all(folder).map_err(failed)?;
        }
        fs::create_dir_all(folder).map_err(failed)?;
        let mut bench = Self {
            rig,
            folder,
            steps: Vec::new(),
            all: Vec::new(),
        };
        fs::write(folder.join(CASES_FILE), "").map_err(failed)?;
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
        fs::write(folder.join(CASES_FILE), manifest).map_err(failed)?;
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
        let before = processor::seconds(Of::Children);
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
        let cpu = processor::seconds(Of::Children).zip(before);
        Ok(Timed {
            line,
            seconds: best,
            cpu_seconds: cpu.map(|(after, before)| (after - before) / f64::from(runs)),
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
        Err(format!(
            "no line for: softrig {}",
            forgotten.join(", softrig ")
        ))
    }
}

/// The processors of this machine with their name, and how many processes wanted one in the last minute, where the
/// system says it.
fn machine() -> Value {
    let text = |path| fs::read_to_string(path).unwrap_or_default();
    let processors = text("/proc/cpuinfo");
    let processor = processors
        .lines()
        .find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    json!({
        "cores": thread::available_parallelism().map_or(1, usize::from),
        "processor": processor.map_or("an unknown processor", |(_, name)| name),
        "load": text("/proc/loadavg").split_once(' ').map(|(load, _)| load),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pages::render;

    #[test]
    fn every_line_is_a_row() {
        let of = |line, seconds, cpu_seconds| Timed {
            line,
            seconds,
            cpu_seconds,
            runs: 3,
        };
        let machine = json!({ "cores": 2, "processor": "AMD EPYC", "load": "1.50" });
        let lines = [
            of(LINES[1], 0.0123, Some(0.1234)),
            of(LINES[5], 12.34, None),
        ];
        let text = render(&figures(&machine, &lines)).unwrap();
        for part in [
            "\n2 cores of AMD EPYC, used by others too: 1.50 processes wanted them when this began. The best of 3 to 20 runs",
            "\n| `softrig init --recording step60_1.csv --dry-run` | 0.012 | 0.12 |\n",
            "_1.csv -o out.csv` | 12.3 | – |\n\nNot in the table: `softrig monitor` (a board), ",
            "`softrig next` (a board; a plan and a diagnosis for each run).\n",
        ] {
            assert!(text.contains(part), "{part:?} not in\n{text}");
        }
    }
}
