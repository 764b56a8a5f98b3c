//! Runs other programs and reports their times.

use std::{
    env,
    ffi::OsStr,
    fmt,
    path::{Path, PathBuf},
    process::{Command, ExitStatus, Stdio},
    thread,
    time::{Duration, Instant},
};

/// What stops a task: a sentence for the person at the terminal.
#[derive(Debug)]
pub struct Failure(pub String);

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl From<String> for Failure {
    fn from(text: String) -> Self {
        Self(text)
    }
}

impl From<&str> for Failure {
    fn from(text: &str) -> Self {
        Self(text.into())
    }
}

/// The result of a task.
pub type Outcome<T = ()> = Result<T, Failure>;

/// The folder of the workspace: where cargo runs this from. A built clone may have been copied
/// or renamed since, and is not built again for that.
pub fn root() -> PathBuf {
    let here = env::var_os("CARGO_MANIFEST_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    here.parent().map_or_else(|| here.clone(), Path::to_owned)
}

/// The folder that cargo builds into: the one that this program was built into.
pub fn target_dir() -> PathBuf {
    env::current_exe()
        .ok()
        .and_then(|exe| Some(exe.parent()?.parent()?.to_path_buf()))
        .unwrap_or_else(|| root().join("target"))
}

/// The setting by which cargo compiles a crate in many parts, to compile fewer of them the next
/// time. Set to "0": what is built here is measured and tested for minutes, as whole as what
/// users get.
pub const INCREMENTAL: &str = "CARGO_INCREMENTAL";

/// cargo as it was called, from the workspace's root, into the same target folder.
pub fn cargo() -> Command {
    let mut command = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command
        .current_dir(root())
        .env("CARGO_TARGET_DIR", target_dir())
        .env(INCREMENTAL, "0");
    command
}

/// A build with the profile of `cargo rig`, so that what both have in common is compiled once.
pub fn release_build() -> Command {
    let mut command = cargo();
    command.args(["build", "--release", "--locked"]);
    command
}

/// Runs a command with its output shown; its failure is ours.
pub fn run(command: &mut Command) -> Outcome {
    let status = command
        .status()
        .map_err(|error| format!("cannot start {}: {error}", text(command)))?;
    check(command, status)
}

/// Runs a command and returns what it printed, trimmed.
pub fn read(command: &mut Command) -> Outcome<String> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("cannot start {}: {error}", text(command)))?;
    if !output.status.success() {
        return Err(format!(
            "{} failed ({}): {}",
            text(command),
            output.status,
            String::from_utf8_lossy(&output.stderr).trim()
        )
        .into());
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().into())
}

/// Runs a command silently and ends it after `limit`; what it said goes into the
/// failure.
pub fn run_quietly(command: &mut Command, limit: Duration) -> Outcome {
    read_within(command, limit).map(drop)
}

/// Like [`run_quietly`], and returns what it printed.
pub fn read_within(command: &mut Command, limit: Duration) -> Outcome<String> {
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| format!("cannot start {}: {error}", text(command)))?;
    // Both pipes are emptied while waiting, or a talkative child would block.
    let readers = [
        child
            .stdout
            .take()
            .map(|pipe| thread::spawn(|| drain(pipe))),
        child
            .stderr
            .take()
            .map(|pipe| thread::spawn(|| drain(pipe))),
    ];
    let started = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) if started.elapsed() < limit => thread::sleep(Duration::from_millis(20)),
            Ok(None) => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(
                    format!("{} took more than {} s", text(command), limit.as_secs()).into(),
                );
            }
            Err(error) => return Err(format!("cannot wait for {}: {error}", text(command)).into()),
        }
    };
    let [printed, complained] = readers.map(|reader| {
        reader
            .and_then(|reader| reader.join().ok())
            .unwrap_or_default()
    });
    if status.success() {
        return Ok(printed);
    }
    let said = printed + &complained;
    let tail: Vec<&str> = said.lines().rev().take(12).collect();
    let tail: Vec<&str> = tail.into_iter().rev().collect();
    Err(format!("{} failed ({status}):\n{}", text(command), tail.join("\n")).into())
}

fn drain(mut pipe: impl std::io::Read) -> String {
    let mut bytes = Vec::new();
    let _ = pipe.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

fn check(command: &Command, status: ExitStatus) -> Outcome {
    if status.success() {
        Ok(())
    } else {
        Err(format!("{} failed ({status})", text(command)).into())
    }
}

/// The command line as one would type it.
pub fn text(command: &Command) -> String {
    let mut words: Vec<String> = vec![
        Path::new(command.get_program())
            .file_name()
            .unwrap_or(command.get_program())
            .to_string_lossy()
            .into(),
    ];
    words.extend(command.get_args().map(|word| word.to_string_lossy().into()));
    words.join(" ")
}

/// Whether a program of this name is on the search path.
pub fn has_program(name: &str) -> bool {
    find_program(name).is_some()
}

/// Where a program of this name is on the search path.
pub fn find_program(name: impl AsRef<OsStr>) -> Option<PathBuf> {
    env::split_paths(&env::var_os("PATH")?)
        .map(|folder| folder.join(name.as_ref()))
        .find(|path| path.is_file())
}

/// Elapsed time for people.
pub fn seconds(duration: Duration) -> String {
    format!("{:.1} s", duration.as_secs_f64())
}

/// Seconds of a processor that this program and all it waited for have taken; none where the
/// system is not Linux.
fn children_s() -> Option<f64> {
    /// Fields of `/proc/self/stat` behind the name: user and system time of this program and of
    /// its children.
    const TIMES: std::ops::Range<usize> = 11..15;
    /// In which Linux counts there.
    const TICKS_PER_S: f64 = 100.0;
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let (_, fields) = stat.rsplit_once(')')?;
    let ticks: Option<Vec<f64>> = fields
        .split_whitespace()
        .skip(TIMES.start)
        .take(TIMES.len())
        .map(|field| field.parse().ok())
        .collect();
    Some(ticks?.iter().sum::<f64>() / TICKS_PER_S)
}

/// Numbered steps, each with its time.
pub struct Steps {
    started: Instant,
    number: usize,
    total: usize,
    skipped: Vec<&'static str>,
    took: Vec<Took>,
}

/// What a step took (s).
struct Took {
    name: &'static str,
    wall_s: f64,
    /// Of all processors; none where the system does not say.
    processor_s: Option<f64>,
}

impl Steps {
    /// Starts a list of `total` steps.
    pub fn new(total: usize) -> Self {
        Self {
            started: Instant::now(),
            number: 0,
            total,
            skipped: Vec::new(),
            took: Vec::new(),
        }
    }

    /// Runs the next step; a failure names it.
    pub fn step(&mut self, name: &'static str, work: impl FnOnce() -> Outcome) -> Outcome {
        self.number += 1;
        let label = format!("[{}/{}] {name}", self.number, self.total);
        println!("\n{label}");
        let (started, before_s) = (Instant::now(), children_s());
        work().map_err(|failure| {
            format!(
                "{label}: {failure}\n  (after {})",
                seconds(started.elapsed())
            )
        })?;
        println!("{label}: ok, {}", seconds(started.elapsed()));
        self.took.push(Took {
            name,
            wall_s: started.elapsed().as_secs_f64(),
            processor_s: children_s()
                .zip(before_s)
                .map(|(after, before)| after - before),
        });
        Ok(())
    }

    /// Passes over the next step and says why.
    pub fn skip(&mut self, name: &'static str, why: &str) {
        self.number += 1;
        println!("\n[{}/{}] {name}: skipped, {why}", self.number, self.total);
        self.skipped.push(name);
    }

    /// What each step took of the processors (s), where the system says it.
    pub fn took(&self) -> Vec<(&'static str, f64)> {
        self.took
            .iter()
            .filter_map(|step| Some((step.name, step.processor_s?)))
            .collect()
    }

    /// Shows what each step took.
    pub fn table(&self) {
        println!("\n{:<24} {:>8} {:>14}", "step", "minutes", "processor, min");
        for step in &self.took {
            let processor = step
                .processor_s
                .map_or_else(|| "–".into(), |s| format!("{:.1}", s / 60.0));
            println!(
                "{:<24} {:>8.1} {processor:>14}",
                step.name,
                step.wall_s / 60.0
            );
        }
    }

    /// Says in one line how it went.
    pub fn finish(self, what: &str) {
        let done = self.number - self.skipped.len();
        let skipped = if self.skipped.is_empty() {
            String::new()
        } else {
            format!(", skipped: {}", self.skipped.join(", "))
        };
        println!(
            "\n{what}: {done} of {} steps passed in {}{skipped}",
            self.total,
            seconds(self.started.elapsed())
        );
    }
}
