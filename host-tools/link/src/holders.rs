//! Finds programs that have a port open.
//!
//! Two programs that read one port each get only part of the bytes, and not every system keeps
//! the second one out: the superuser may always open a port, and `cat` does not lock it. So this
//! is checked before a port is opened. Linux lists the open files of every program in `/proc`,
//! those of other users for the superuser only; on other systems nothing is found.

use std::path::Path;

/// A program that has a port open.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Holder {
    /// Number of the process.
    pub(super) pid: u32,
    /// Its name, as `ps` shows it.
    pub(super) name: String,
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (process {})", self.name, self.pid)
    }
}

/// The other programs that have a port open, the one at its far end not among them.
pub(super) fn holders(port: &Path) -> Vec<Holder> {
    let Ok(device) = port.canonicalize() else {
        return Vec::new();
    };
    let Ok(processes) = std::fs::read_dir("/proc") else {
        return Vec::new();
    };
    processes
        .flatten()
        .filter_map(|process| process.file_name().to_str()?.parse().ok())
        .filter(|&pid| pid != std::process::id())
        .filter(|&pid| has_open(pid, &device))
        .map(|pid| Holder {
            pid,
            name: std::fs::read_to_string(format!("/proc/{pid}/comm"))
                .map_or_else(|_| "a program".into(), |name| name.trim().to_owned()),
        })
        .collect()
}

/// Whether a process has the port open, and is not the simulator that offers it: that one
/// has the multiplexer of pseudo-terminals open too.
fn has_open(pid: u32, device: &Path) -> bool {
    let Ok(files) = std::fs::read_dir(format!("/proc/{pid}/fd")) else {
        return false;
    };
    let targets: Vec<_> = files
        .flatten()
        .filter_map(|file| std::fs::read_link(file.path()).ok())
        .collect();
    let offers =
        |target: &Path| target == Path::new("/dev/ptmx") || target == Path::new("/dev/pts/ptmx");
    targets.iter().any(|target| target == device) && !targets.iter().any(|target| offers(target))
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::process::{Command, Stdio};

    #[test]
    fn who_has_a_file_open_is_found_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("port");
        std::fs::write(&path, "").unwrap();
        assert_eq!(holders(&path), []);
        let file = std::fs::File::open(&path).unwrap();
        let mut child = Command::new("sleep")
            .arg("60")
            .stdin(file)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let until = std::time::Instant::now() + std::time::Duration::from_secs(10);
        let mut found = holders(&path);
        // Before it has become `sleep` it is a copy of this test.
        while found.iter().all(|holder| holder.name != "sleep") && std::time::Instant::now() < until
        {
            found = holders(&path);
        }
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].pid, child.id());
        assert_eq!(
            found[0].to_string(),
            format!("sleep (process {})", child.id())
        );
        assert_eq!(holders(&path), []);
        assert_eq!(holders(Path::new("no such port")), []);
    }
}
