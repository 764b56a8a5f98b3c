//! Finds virtual rigs that run on this computer.
//!
//! A simulator offers the far end of a pseudo-terminal, which no list of serial ports has. Linux
//! says in `/proc` which pseudo-terminal a multiplexer that is open belongs to; of programs of
//! other users it says so to the superuser only. On other systems nothing is found.

use std::path::{Path, PathBuf};

/// The simulator's command, as `ps` shows it.
const SIMULATOR: &str = "virtual-rig";

/// A virtual rig that runs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct VirtualRig {
    /// Its port: the link that it was given, or the pseudo-terminal.
    pub(super) port: PathBuf,
    /// Number of its process.
    pub(super) pid: u32,
}

/// The virtual rigs that run, by their ports.
pub(super) fn virtual_rigs() -> Vec<VirtualRig> {
    let Ok(processes) = std::fs::read_dir("/proc") else {
        return Vec::new();
    };
    let mut found: Vec<VirtualRig> = processes
        .flatten()
        .filter_map(|process| {
            let pid = process.file_name().to_str()?.parse().ok()?;
            let name = std::fs::read_to_string(process.path().join("comm")).ok()?;
            let terminal = (name.trim() == SIMULATOR).then(|| terminal(&process.path()))??;
            let port = link(&process.path(), &terminal).unwrap_or(terminal);
            Some(VirtualRig { port, pid })
        })
        .collect();
    found.sort_by(|a, b| a.port.cmp(&b.port));
    found
}

/// The pseudo-terminal whose multiplexer a process has open.
fn terminal(process: &Path) -> Option<PathBuf> {
    let infos = std::fs::read_dir(process.join("fdinfo")).ok()?;
    infos.flatten().find_map(|info| {
        let text = std::fs::read_to_string(info.path()).ok()?;
        let index = text
            .lines()
            .find_map(|line| line.strip_prefix("tty-index:"))?;
        let terminal = Path::new("/dev/pts").join(index.trim());
        terminal.exists().then_some(terminal)
    })
}

/// The name that a process was told to give its port, if it leads there.
fn link(process: &Path, terminal: &Path) -> Option<PathBuf> {
    let words = std::fs::read_to_string(process.join("cmdline")).ok()?;
    let mut words = words.split('\0').skip_while(|word| *word != "--link");
    let folder = std::fs::read_link(process.join("cwd")).ok()?;
    let link = folder.join(words.nth(1)?);
    let leads_there = link.canonicalize().ok()?.as_path() == terminal;
    leads_there.then_some(link)
}
