//! The loop from a rig to a repaired model: what the demo and `bench loop` share.
//!
//! Nothing in it is staged: the simulator executes the image that a board would get, and
//! every number comes over the serial port or from `softrig`. The benchmarks run it for many
//! actuators, and make the experiments that a diagnosis proposes.

use std::fs;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use clap::Args;
use serde::Deserialize;

use crate::process::root;
use crate::text_of;
use crate::verdict::{Kinds, Verdict};

/// What is recorded to be diagnosed, by the name that the board knows.
pub const PROTOCOL: &str = "steps";
/// What shows how well a model controls.
pub const CLOSED_LOOP: &str = "follow";

/// How long the simulator may take to offer its port.
const PORT_LIMIT: Duration = Duration::from_secs(120);

/// The programs of the loop.
#[derive(Args, Clone, Debug)]
pub struct Programs {
    /// The command `softrig`
    #[arg(long = "softrig", value_name = "PATH", overrides_with = "rig")]
    pub rig: PathBuf,
    /// The simulator
    #[arg(long, value_name = "PATH")]
    pub simulator: PathBuf,
    /// The firmware
    #[arg(long, value_name = "ELF")]
    pub image: PathBuf,
}

impl Programs {
    /// `softrig`, run in the workspace's root, so that the paths it prints are short.
    pub fn rig(&self) -> Command {
        command(&self.rig)
    }
}

fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.current_dir(root());
    command
}

/// Which actuator the simulator draws.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drawn {
    /// The seed of the actuator and of the rig's noise.
    pub seed: u64,
    /// The kind of effect that it hides; by the seed where none is named.
    pub effect: Option<String>,
}

/// Where one pass through the loop leaves its files: below the workspace's root, or anywhere.
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder anew: recordings of an earlier pass would be taken for
    /// ones of this pass.
    ///
    /// # Errors
    ///
    /// Which folder cannot be cleared or made.
    pub fn clear(path: PathBuf) -> Result<Self, String> {
        match fs::remove_dir_all(root().join(&path)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(format!("cannot clear {}: {error}", path.display()));
            }
            _ => {}
        }
        for folder in ["before", "after"] {
            let folder = root().join(&path).join(folder);
            fs::create_dir_all(&folder)
                .map_err(|error| format!("cannot create {}: {error}", folder.display()))?;
        }
        Ok(Self(path))
    }

    /// A file in it, as commands in the workspace's root name it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// A file in it, from anywhere.
    pub fn path(&self, name: &str) -> PathBuf {
        root().join(self.file(name))
    }

    /// What the simulated actuator has and the owner's model has not; none if nobody wrote
    /// down what it has.
    pub fn hidden(&self) -> Option<Kinds> {
        added(&self.path("model.toml"))
    }

    /// What the diagnosis said.
    ///
    /// # Errors
    ///
    /// What is wrong with the verdict.
    pub fn verdict(&self) -> Result<Verdict, String> {
        Verdict::read(&self.path("verdict.json"))
    }

    /// The gap before and after.
    ///
    /// # Errors
    ///
    /// What is wrong with the file.
    pub fn gap(&self) -> Result<Gap, String> {
        self.gap_in("gap.json")
    }

    /// How set-points were followed before and after, in a sentence.
    ///
    /// # Errors
    ///
    /// What is wrong with the file.
    pub fn tracking(&self) -> Result<String, String> {
        let tracking = self.gap_in("follow.json")?.tracking;
        tracking.ok_or_else(|| "nothing followed set-points in degrees".into())
    }

    fn gap_in(&self, name: &str) -> Result<Gap, String> {
        let path = self.path(name);
        serde_json::from_str(&text_of(&path)?)
            .map_err(|error| format!("{}: {error}", path.display()))
    }
}

/// The kinds of a model file's effects, in their order.
///
/// # Errors
///
/// If it cannot be read or is no TOML.
pub fn effects(model: &Path) -> Result<Vec<String>, String> {
    #[derive(Deserialize)]
    struct Effect {
        kind: String,
    }
    #[derive(Deserialize)]
    struct Model {
        #[serde(default)]
        effect: Vec<Effect>,
    }
    let read: Model = toml::from_str(&text_of(model)?)
        .map_err(|error| format!("{}: {error}", model.display()))?;
    Ok(read.effect.into_iter().map(|effect| effect.kind).collect())
}

/// The effects of `truth.toml` that `model.toml` beside it lacks; none if one of them is not there.
pub fn added(model: &Path) -> Option<Kinds> {
    let kinds = |path: &Path| -> Option<Kinds> { Some(effects(path).ok()?.into_iter().collect()) };
    Some(&kinds(&model.with_file_name("truth.toml"))? - &kinds(model)?)
}

/// What `softrig gap --json` writes of an upload.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Gap {
    /// All runs before the upload.
    pub before: Side,
    /// All runs after it.
    pub after: Side,
    /// Both, in a sentence.
    pub sentence: String,
    /// How set-points were followed, in a sentence; none without set-points in degrees.
    pub tracking: Option<String>,
}

/// The error of the board's prediction over some runs.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
pub struct Side {
    /// RMS (°).
    pub rms_deg: f64,
}

/// The simulated board behind its serial port.
#[derive(Debug)]
pub struct Board {
    process: Child,
    /// The port.
    pub port: String,
}

impl Board {
    /// Starts it with a drawn actuator, whose models go into the folder, and with
    /// an image, or empty.
    ///
    /// # Errors
    ///
    /// If it does not start.
    pub fn start(
        simulator: &Path,
        drawn: &Drawn,
        folder: &Folder,
        image: Option<&Path>,
        complaints: Stdio,
    ) -> Result<Self, String> {
        let seed = drawn.seed.to_string();
        let mut command = command(simulator);
        command.args(["serve", "--hide", &seed, "--seed", &seed, "--speed", "max"]);
        if let Some(effect) = &drawn.effect {
            command.args(["--effect", effect]);
        }
        if let Some(image) = image {
            command.arg("--image").arg(image);
        }
        command
            .arg("--model-out")
            .arg(folder.file("model.toml"))
            .arg("--truth-out")
            .arg(folder.file("truth.toml"));
        let mut process = command
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(complaints)
            .spawn()
            .map_err(|error| format!("cannot start the virtual rig: {error}"))?;
        let stdout = process.stdout.take();
        let (send, receive) = mpsc::channel();
        thread::spawn(move || {
            for line in stdout
                .into_iter()
                .flat_map(|pipe| BufReader::new(pipe).lines())
            {
                let Ok(line) = line else { break };
                if let Some(port) = line.strip_prefix("port ") {
                    let _ = send.send(port.to_owned());
                }
            }
        });
        let mut started = Self {
            process,
            port: String::new(),
        };
        started.port = receive
            .recv_timeout(PORT_LIMIT)
            .map_err(|_| "the virtual rig did not offer a serial port".to_owned())?;
        Ok(started)
    }

    /// Stops it.
    ///
    /// # Errors
    ///
    /// If it is gone already.
    pub fn stop(mut self) -> Result<(), String> {
        self.process
            .kill()
            .map_err(|error| format!("cannot stop the virtual rig: {error}"))
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        // A failed step must not leave it running.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Uploads the nominal model, which lacks what the actuator hides.
pub fn upload_model(programs: &Programs, board: &Board, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .args(["upload", "--port", &board.port, "--model"])
        .arg(folder.file("model.toml"));
    command
}

/// Uploads the repaired model, with the zeros of the sensors as the diagnosis
/// estimated them.
pub fn upload_repaired(programs: &Programs, board: &Board, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .args(["upload", "--port", &board.port, "--model"])
        .arg(folder.file("repaired.toml"))
        .arg("--zeros")
        .arg(folder.file("verdict.json"));
    command
}

/// Plays a protocol into a file of `before` or `after`.
fn played(programs: &Programs, board: &Board, protocol: &str, file: &Path) -> Command {
    let mut command = programs.rig();
    command
        .args(["record", "--port", &board.port, "--protocol", protocol])
        .arg("-o")
        .arg(file);
    command
}

/// Records a session into `before/run.csv` or `after/run.csv`.
pub fn record(programs: &Programs, board: &Board, folder: &Folder, when: &str) -> Command {
    played(
        programs,
        board,
        PROTOCOL,
        &folder.file(when).join("run.csv"),
    )
}

/// Lets the board follow set-points in closed loop, into `before/follow.csv` or `after/follow.csv`.
pub fn follow(programs: &Programs, board: &Board, folder: &Folder, when: &str) -> Command {
    let file = folder.file(when).join("follow.csv");
    let mut command = played(programs, board, CLOSED_LOOP, &file);
    command.arg("--clear");
    command
}

/// Diagnoses the session that was recorded before the repair.
pub fn diagnose(programs: &Programs, folder: &Folder) -> Command {
    let mut command = programs.rig();
    command
        .args(["diagnose", "--model"])
        .arg(folder.file("model.toml"))
        .arg(folder.file("before/run.csv"))
        .arg("--json")
        .arg(folder.file("verdict.json"))
        .arg("-o")
        .arg(folder.file("repaired.toml"));
    command
}

/// `softrig gap` of two recordings of one name, into a JSON of `name`.
fn compared(programs: &Programs, folder: &Folder, recording: &str, name: &str) -> Command {
    let mut command = programs.rig();
    command
        .arg("gap")
        .arg(folder.file("before").join(recording))
        .arg("--after")
        .arg(folder.file("after").join(recording))
        .arg("--json")
        .arg(folder.file(name));
    command
}

/// Compares what the board predicted before and after with what it measured.
pub fn gap(programs: &Programs, folder: &Folder) -> Command {
    compared(programs, folder, "run.csv", "gap.json")
}

/// Compares how the board followed set-points before and after.
pub fn tracking(programs: &Programs, folder: &Folder) -> Command {
    compared(programs, folder, "follow.csv", "follow.json")
}
