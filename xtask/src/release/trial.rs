//! Tests the archive on an empty machine.
//!
//! The machine is an empty folder as root: no shell, no library, no device, no variable. A
//! program that runs there needs nothing.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use super::{cannot, make};
use crate::shell::{Outcome, has_program, read, read_within, run, target_dir};

/// How long one command may take.
const LIMIT: Duration = Duration::from_secs(600);

/// Recordings that are diagnosed: few, since what is tried is whether it runs.
const RECORDINGS: [&str; 4] = ["step60_1", "step60_2", "step90_1", "staircase"];

/// Where the archive is tried.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// In a root of its own, as root.
    Root,
    /// In a root of its own, by a user who is root nowhere else.
    UserRoot,
    /// Without variables, which is no proof that nothing of this machine is used.
    Bare,
}

impl Place {
    /// The best place on this machine.
    pub fn here() -> Self {
        let is_root = read(Command::new("id").arg("-u")).is_ok_and(|user| user == "0");
        if is_root && has_program("chroot") {
            return Self::Root;
        }
        let may = read(Command::new("unshare").args(["--map-root-user", "true"])).is_ok();
        if may { Self::UserRoot } else { Self::Bare }
    }

    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Root => "in a root with nothing else in it",
            Self::UserRoot => "in a root with nothing else in it, by a user namespace",
            Self::Bare => "without variables; a root of its own takes root or user namespaces",
        }
    }

    /// `softrig` in the unpacked folder, which is the working directory.
    fn rig(self, folder: &Path) -> Command {
        let mut command = match self {
            Self::Root => {
                let mut command = Command::new("chroot");
                command.arg(folder).arg("/softrig");
                command
            }
            Self::UserRoot => {
                let mut command = Command::new("unshare");
                command.arg("--map-root-user").arg("--root").arg(folder);
                command.arg("/softrig");
                command
            }
            Self::Bare => Command::new(folder.join("softrig")),
        };
        let path = std::env::var_os("PATH");
        command.env_clear().current_dir(folder);
        if let (Self::Root | Self::UserRoot, Some(path)) = (self, path) {
            // To find chroot by; in there it leads nowhere.
            command.env("PATH", path);
        }
        command
    }
}

/// Unpacks an archive and does with it what a newcomer does.
pub fn of(archive: &Path, stem: &str, firmware: bool) -> Outcome {
    let place = Place::here();
    println!("  {}", place.words());
    let ground = target_dir().join("dist-trial");
    let _ = fs::remove_dir_all(&ground);
    make(&ground)?;
    run(Command::new("tar")
        .arg("-xzf")
        .arg(archive)
        .arg("-C")
        .arg(&ground))?;
    let folder = ground.join(stem);
    run(Command::new("sha256sum")
        .args(["--check", "--quiet", super::CHECKSUMS])
        .current_dir(&folder))?;
    if firmware
        && !folder
            .join(format!("firmware/{}.hex", super::IMAGE))
            .is_file()
    {
        return Err("the archive has no image of the board".into());
    }
    let say = |words: &[&str]| -> Outcome<String> {
        let mut command = place.rig(&folder);
        let said = read_within(command.args(words), LIMIT)?;
        println!("  rig {}: {}", words[0], said.lines().next().unwrap_or(""));
        Ok(said)
    };
    if firmware {
        // It finds the image beside itself, and opens no port.
        say(&["flash", "--port", "none", "--dry-run"])?;
    }
    let version = say(&["--version"])?;
    if !version.contains(env!("CARGO_PKG_VERSION")) {
        return Err(format!("the archive's softrig says that it is {}", version.trim()).into());
    }
    say(&["example", "-o", "demo", "--effect", "coulomb_friction"])?;
    let files: Vec<String> = RECORDINGS
        .iter()
        .map(|name| format!("demo/recordings/{name}.csv"))
        .collect();
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    // There and back through zstd, which is not Rust.
    say(&["convert", files[0], "-o", "run.mcap"])?;
    say(&["convert", "run.mcap", "-o", "again.csv"])?;
    let first = [
        &["init", "-o", "first.toml", "--recording"],
        files.as_slice(),
    ]
    .concat();
    say(&first)?;
    let diagnose = [
        &["diagnose", "--model", "demo/model.toml"],
        files.as_slice(),
        &[
            "-o",
            "repaired.toml",
            "--report",
            "report.html",
            "--json",
            "verdict.json",
        ],
    ];
    say(&diagnose.concat())?;
    for file in ["first.toml", "repaired.toml", "report.html", "verdict.json"] {
        let path: PathBuf = folder.join(file);
        let bytes = fs::metadata(&path).map_err(|error| cannot("read", &path, &error))?;
        if bytes.len() == 0 {
            return Err(format!("{file} is empty").into());
        }
    }
    fs::remove_dir_all(&ground).map_err(|error| cannot("remove", &ground, &error).into())
}
