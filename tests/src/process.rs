//! Runs other programs for a limited time, and says why one failed.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// How often a running program is looked at.
pub const LOOK_AGAIN: Duration = Duration::from_millis(10);
/// The longest text of a failure.
const LONGEST_REASON: usize = 160;

/// The folder of the workspace: where cargo runs this from, or a program that cargo runs. A built
/// clone may have been copied or renamed since.
pub fn root() -> PathBuf {
    let here = std::env::var_os("CARGO_MANIFEST_DIR")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    here.ancestors()
        .find(|folder| folder.join("Cargo.lock").is_file())
        .map_or_else(|| here.join(".."), Path::to_owned)
}

/// Runs a command for a limited time; what it prints and complains about goes into a file.
/// None if it took too long.
///
/// # Errors
///
/// If the file cannot be written or the program cannot be run.
pub fn within(
    command: &mut Command,
    limit: Duration,
    log: &Path,
) -> Result<Option<ExitStatus>, String> {
    let cannot = |error| format!("cannot write {}: {error}", log.display());
    if let Some(folder) = log.parent() {
        fs::create_dir_all(folder).map_err(cannot)?;
    }
    let file = File::create(log).map_err(cannot)?;
    let program = command.get_program().to_owned();
    let failed = |error| format!("cannot run {}: {error}", program.display());
    let clock = Instant::now();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(file.try_clone().map_err(cannot)?)
        .stderr(file)
        .spawn()
        .map_err(failed)?;
    loop {
        if let Some(status) = child.try_wait().map_err(failed)? {
            return Ok(Some(status));
        }
        if clock.elapsed() > limit {
            let _ = child.kill();
            child.wait().map_err(failed)?;
            return Ok(None);
        }
        thread::sleep(LOOK_AGAIN);
    }
}

/// Runs a command that has to succeed; see [`within`].
///
/// # Errors
///
/// Why it failed, in one line.
pub fn succeed(command: &mut Command, limit: Duration, log: &Path) -> Result<(), String> {
    match within(command, limit, log)? {
        Some(status) if status.success() => Ok(()),
        Some(status) => Err(reason(log, status)),
        None => Err(format!("took more than {} s", limit.as_secs())),
    }
}

/// Why a program failed: its last complaint, with files by their names alone.
pub fn reason(log: &Path, status: ExitStatus) -> String {
    let text = fs::read_to_string(log).unwrap_or_default();
    let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
    lines.next_back().map_or_else(
        || status.to_string(),
        |line| {
            let words = line.split(' ').map(|word| match word.rsplit_once('/') {
                Some((folder, name)) if folder.starts_with('/') => name,
                _ => word,
            });
            let line = words.collect::<Vec<_>>().join(" ");
            line.chars().take(LONGEST_REASON).collect()
        },
    )
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_told_by_its_reason() {
        let folder = std::env::temp_dir().join(format!("softrig-process-{}", std::process::id()));
        let log = folder.join("log.txt");
        let run = |script: &str, milliseconds| {
            let mut command = Command::new("sh");
            command.args(["-c", script]);
            succeed(&mut command, Duration::from_millis(milliseconds), &log)
        };
        assert_eq!(run("echo printed", 60_000), Ok(()));
        assert_eq!(fs::read_to_string(&log).unwrap(), "printed\n");
        let failed = run(
            "echo a; echo 'error: /a/b/run.csv: is bad' >&2; exit 2",
            60_000,
        );
        assert_eq!(failed, Err("error: run.csv: is bad".into()));
        assert_eq!(run("exit 3", 60_000), Err("exit status: 3".into()));
        assert_eq!(run("sleep 30", 100), Err("took more than 0 s".into()));
        fs::remove_dir_all(folder).unwrap();
    }
}
