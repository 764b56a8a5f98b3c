//! `softrig virtual`: starts the simulated rig.
//!
//! The simulator has another licence, so it runs as a separate program: its output is
//! passed on, and it is told to end when this program is.

use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::{Parser, ValueEnum};

use super::Interrupt;
use softrig_formats::error::InputError;
use softrig_formats::setup::{NewPart, Setup};

/// Runs the real firmware image in a simulator, behind a serial port.
///
/// It speaks the protocol of a real board, and runs until Ctrl-C.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig virtual --link /tmp/softrig
  softrig virtual --hide 7 --model-out model.toml --truth-out truth.toml
  softrig virtual --hide 7 --effect gravity --truth-out truth.toml
  softrig virtual --actuator truth.toml --speed max --duration 120
  softrig virtual --link /tmp/softrig --clock-error 0.4

Then, in another terminal:
  softrig monitor --port /tmp/softrig

While it runs, lines can be typed into its terminal: `bend 30` bends the actuator
by hand to 30 degrees, as `softrig calibrate` asks for, and `bend off` lets it go;
`fault leak on`, `press emergency-stop`, `status` and more: docs/virtual-rig.md.

The simulator is a program of its own, virtual-rig, and the image is what
`cargo xtask firmware` builds; `cargo xtask setup` installs what both need.")]
pub struct Args {
    /// Model file of the simulated actuator
    #[arg(long, value_name = "TRUTH.toml", conflicts_with = "hide")]
    actuator: Option<PathBuf>,
    /// Draw an actuator that hides an effect from this seed
    #[arg(long, value_name = "SEED")]
    hide: Option<u64>,
    /// Hide this effect instead of one drawn from the seed
    #[arg(long, value_name = "KIND", requires = "hide")]
    effect: Option<String>,
    /// Seed of the bench's small errors: sensor zeros, and an actuator not quite at
    /// rest [default: the seed of --hide; without both the bench is ideal]
    #[arg(long, value_name = "N")]
    bench_seed: Option<u64>,
    /// Write the nominal model, without the hidden effect
    #[arg(long, value_name = "MODEL.toml", requires = "hide")]
    model_out: Option<PathBuf>,
    /// Write the answer
    #[arg(long, value_name = "TRUTH.toml", requires = "hide")]
    truth_out: Option<PathBuf>,
    /// Name to give the serial port
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Speed: of a real rig, or as fast as this computer can
    #[arg(long, value_enum, default_value_t = Speed::Realtime)]
    speed: Speed,
    /// Seed of the sensors' noise
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Make the board's second longer by this many percent, -2 to 2: the resonator of a Mega
    /// is off by up to 0.5
    #[arg(long, value_name = "PERCENT", allow_hyphen_values = true)]
    clock_error: Option<f64>,
    /// Keep the board's EEPROM in this file
    #[arg(long, value_name = "FILE")]
    eeprom: Option<PathBuf>,
    /// Inject a fault over an interval, in seconds of the rig's time
    #[arg(long, value_name = "KIND[=SIZE][@S[..S]]")]
    fault: Vec<String>,
    /// End after this time, in seconds of the rig's time
    #[arg(long, value_name = "S")]
    duration: Option<f64>,
    /// Image of the firmware
    #[arg(long, value_name = "FIRMWARE.elf", env = IMAGE)]
    image: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Speed {
    /// One second takes one second
    Realtime,
    /// As fast as possible
    Max,
}

/// The variable that names an image of the firmware.
const IMAGE: &str = "SOFTRIG_FIRMWARE";

/// The simulator's file name.
const PROGRAM: &str = if cfg!(windows) {
    "virtual-rig.exe"
} else {
    "virtual-rig"
};

/// How the simulator ends where its arguments make no sense: as this program does.
const WRONG_ARGUMENTS: i32 = 2;

/// Runs the command.
///
/// # Errors
///
/// Missing programs, with how to build them; then errors of the simulator.
pub fn run(args: &Args) -> anyhow::Result<()> {
    if let Some(path) = &args.actuator {
        // Errors in it are reported here, with line and column.
        super::read_model(path)?;
    }
    let program = find_program()?;
    let image = find_image(args.image.as_deref())?;
    let interrupt = Interrupt::listen()?;
    let mut child = command(args, &program, &image)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .with_context(|| format!("{} cannot be started", program.display()))?;
    let lines = lines_of(&mut child);
    let _typed = child.stdin.take().map(pass_on);
    let status = follow(args, &interrupt, &mut child, &lines)?;
    if interrupt.requested() || status.success() {
        return Ok(());
    }
    if status.code() == Some(WRONG_ARGUMENTS) {
        let found = "the virtual rig did not start";
        return Err(InputError::new(found, "correct what is named above").into());
    }
    Err(anyhow::anyhow!(
        "the simulator ended with {status}; see its output above"
    ))
}

/// A virtual rig that another command uses for as long as it runs.
pub(crate) struct Companion {
    child: Child,
    control: ChildStdin,
    port: String,
    /// What it answers; it ends when nobody reads it.
    said: Receiver<String>,
}

/// How far a hand can bend it (°).
const FARTHEST_BEND_DEG: f64 = 140.0;

impl Companion {
    /// Starts it, as fast as this computer can, with the actuator of a model file, or the usual
    /// one; `seed` draws its sensors' noise and where its plunger stands.
    ///
    /// # Errors
    ///
    /// Missing programs, or a simulator that does not start.
    pub(crate) fn start(actuator: Option<&Path>, seed: Option<u64>) -> anyhow::Result<Self> {
        /// It has to read an image and open a port.
        const STARTS: Duration = Duration::from_secs(30);
        let program = find_program()?;
        let image = std::env::var_os(IMAGE).map(PathBuf::from);
        let mut command = Command::new(&program);
        command
            .args(["serve", "--control", "--speed", "max", "--image"])
            .arg(find_image(image.as_deref())?);
        if let Some(actuator) = actuator {
            command.arg("--actuator").arg(actuator);
        }
        if let Some(seed) = seed {
            command.arg("--seed").arg(seed.to_string());
        }
        let mut child = command
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .with_context(|| format!("{} cannot be started", program.display()))?;
        let said = lines_of(&mut child);
        let until = Instant::now() + STARTS;
        let port = loop {
            let line = said.recv_timeout(until.saturating_duration_since(Instant::now()));
            match line.context("the simulator did not start; see its output above")? {
                line if line.starts_with("port ") => break line["port ".len()..].to_owned(),
                _ => {}
            }
        };
        let control = child.stdin.take().context("it takes no lines")?;
        Ok(Self {
            child,
            control,
            port,
            said,
        })
    }

    /// Its serial port.
    pub(crate) fn port(&self) -> &str {
        &self.port
    }

    /// Does what a line of its control asks, and waits until it is done.
    ///
    /// # Errors
    ///
    /// What it says against it.
    pub(crate) fn obey(&mut self, line: &str) -> anyhow::Result<()> {
        const ANSWERS: Duration = Duration::from_secs(10);
        // Answers that nobody waited for.
        while self.said.try_recv().is_ok() {}
        writeln!(self.control, "{line}").context("the simulator has ended")?;
        let answer = self.said.recv_timeout(ANSWERS);
        let answer = answer.context("the simulator does not answer")?;
        match answer.strip_prefix("error ") {
            Some(why) => Err(InputError::new(
                format!("the virtual rig does not obey `{line}`: {why}"),
                "see docs/virtual-rig.md",
            )
            .into()),
            None => Ok(()),
        }
    }

    /// Changes it as a plan asks: what the plan does not say is as at its start. Where it is to
    /// rest, it has been bent before as far as `bent_rad`, as the recorded one was.
    pub(crate) fn set_up(&mut self, setup: &Setup, bent_rad: f64) -> anyhow::Result<()> {
        let bent = bent_rad.to_degrees().min(FARTHEST_BEND_DEG);
        let mut lines = format!(
            "tilt {}\nload {}\n",
            setup.tilt_deg.unwrap_or(0.0),
            setup.tip_load_g.unwrap_or(0.0)
        );
        let others = [
            setup.tube_mm.map(|it| format!("tube {it}\n")),
            setup
                .rested_s
                .map(|it| format!("bend {bent}\nrest 1\nbend off\nrest {it}\n")),
            (setup.new_part == Some(NewPart::Actuator)).then(|| "replace actuator\n".to_owned()),
        ];
        lines.extend(others.into_iter().flatten());
        self.control
            .write_all(lines.as_bytes())
            .context("the simulator has ended")
    }
}

impl Drop for Companion {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn command(args: &Args, program: &Path, image: &Path) -> Command {
    let mut command = Command::new(program);
    command.args(["serve", "--control", "--image"]).arg(image);
    let mut path = |flag: &str, value: &Option<PathBuf>| {
        if let Some(value) = value {
            command.arg(flag).arg(value);
        }
    };
    path("--actuator", &args.actuator);
    path("--model-out", &args.model_out);
    path("--truth-out", &args.truth_out);
    path("--link", &args.link);
    path("--eeprom", &args.eeprom);
    if let Some(seed) = args.hide {
        command.arg("--hide").arg(seed.to_string());
    }
    if let Some(kind) = &args.effect {
        command.arg("--effect").arg(kind);
    }
    if let Some(seed) = args.bench_seed {
        command.arg("--bench-seed").arg(seed.to_string());
    }
    if let Some(seed) = args.seed {
        command.arg("--seed").arg(seed.to_string());
    }
    if let Some(percent) = args.clock_error {
        command.arg("--clock-error").arg(percent.to_string());
    }
    if let Some(seconds) = args.duration {
        command.arg("--duration").arg(seconds.to_string());
    }
    for fault in &args.fault {
        command.arg("--fault").arg(fault);
    }
    command.arg("--speed").arg(match args.speed {
        Speed::Realtime => "realtime",
        Speed::Max => "max",
    });
    command
}

/// Passes typed lines on to the simulator. In the background of a shell nothing is read: the
/// system would stop a program that tries to.
fn pass_on(simulator: ChildStdin) -> Arc<Mutex<ChildStdin>> {
    // The pipe closes with its last owner; the simulator then receives no more commands.
    let simulator = Arc::new(Mutex::new(simulator));
    if is_in_front() {
        let simulator = Arc::clone(&simulator);
        std::thread::spawn(move || {
            for line in std::io::stdin().lock().lines() {
                let Ok(line) = line else { return };
                if line.trim().is_empty() {
                    continue;
                }
                let mut simulator = simulator.lock().unwrap_or_else(PoisonError::into_inner);
                if writeln!(simulator, "{line}").is_err() {
                    return;
                }
            }
        });
    }
    simulator
}

/// Whether what is typed is for this program; a pipe always is.
#[cfg(unix)]
fn is_in_front() -> bool {
    use std::io::IsTerminal;
    !std::io::stdin().is_terminal()
        || rustix::termios::tcgetpgrp(std::io::stdin())
            .is_ok_and(|front| front == rustix::process::getpgrp())
}

#[cfg(not(unix))]
fn is_in_front() -> bool {
    true
}

fn lines_of(child: &mut Child) -> Receiver<String> {
    let (sender, lines) = channel();
    if let Some(stdout) = child.stdout.take() {
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                let Ok(line) = line else { return };
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
    }
    lines
}

/// Passes on the simulator's output until it ends.
fn follow(
    args: &Args,
    interrupt: &Interrupt,
    child: &mut Child,
    lines: &Receiver<String>,
) -> anyhow::Result<std::process::ExitStatus> {
    let mut asked: Option<Instant> = None;
    loop {
        match lines.recv_timeout(Duration::from_millis(50)) {
            Ok(line) => match line.strip_prefix("port ") {
                Some(port) => super::print(&next_steps(args, port))?,
                None => super::print(&format!("{line}\n"))?,
            },
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => std::thread::sleep(Duration::from_millis(20)),
        }
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if interrupt.requested() {
            // It has a moment to remove its link before it is ended.
            let asked = *asked.get_or_insert_with(|| {
                ask_to_end(child);
                Instant::now()
            });
            if asked.elapsed() > Duration::from_secs(2) {
                child.kill()?;
                remove_link(args);
                return Ok(child.wait()?);
            }
        }
    }
}

/// Passes a signal on: a terminal's Ctrl-C reaches the simulator by itself, a signal sent
/// to this program does not.
#[cfg(unix)]
fn ask_to_end(child: &Child) {
    // It may have ended by itself meanwhile.
    let _ = rustix::process::kill_process(
        rustix::process::Pid::from_child(child),
        rustix::process::Signal::TERM,
    );
}

#[cfg(not(unix))]
fn ask_to_end(_child: &Child) {}

/// The simulator removes its link when it ends; one that was killed cannot.
fn remove_link(args: &Args) {
    if let Some(link) = &args.link
        && link.is_symlink()
        && !link.exists()
    {
        let _ = std::fs::remove_file(link);
    }
}

fn next_steps(args: &Args, port: &str) -> String {
    let model = args.model_out.as_ref().map_or_else(
        || "MODEL.toml".to_owned(),
        |path| path.display().to_string(),
    );
    format!(
        "The simulated rig is at {port}. In another terminal:\n\
         \x20 softrig monitor --port {port}\n\
         \x20 softrig upload --port {port} --model {model}\n\
         \x20 softrig record --port {port} --protocol steps -o run.csv\n\
         \x20 softrig diagnose --model {model} run.csv\n\
         For `softrig calibrate`, type `bend 30` here to bend the actuator to 30 degrees, and `bend off` to let go.\n\
         Ctrl-C ends it.\n"
    )
}

/// Beside this program, in the folders that cargo builds into, or where the
/// environment says.
fn find_program() -> Result<PathBuf, InputError> {
    if let Some(path) = std::env::var_os("SOFTRIG_VIRTUAL_RIG") {
        let path = PathBuf::from(path);
        return if path.is_file() {
            Ok(path)
        } else {
            Err(InputError::new(
                "is not there, and SOFTRIG_VIRTUAL_RIG names it",
                "correct the variable, or unset it",
            )
            .in_file(&path))
        };
    }
    let folders = near_folders();
    let candidates = folders.iter().flat_map(|folder| {
        [
            folder.join(PROGRAM),
            folder.join("release").join(PROGRAM),
            folder.join("debug").join(PROGRAM),
        ]
    });
    first_file(candidates).ok_or_else(|| {
        InputError::new(
            format!("the simulator {PROGRAM} is not built"),
            "run `cargo xtask setup` once, then `cargo build --release -p virtual-rig`, or name it in SOFTRIG_VIRTUAL_RIG",
        )
    })
}

fn find_image(given: Option<&Path>) -> Result<PathBuf, InputError> {
    if let Some(path) = given {
        return if path.is_file() {
            Ok(path.to_owned())
        } else {
            Err(InputError::new(
                "is not there",
                "build it with `cargo xtask firmware`, which prints its path",
            )
            .in_file(path))
        };
    }
    let folders = near_folders();
    let candidates = folders
        .iter()
        .map(|folder| folder.join("avr-none").join("release").join("firmware.elf"));
    first_file(candidates).ok_or_else(|| {
        InputError::new(
            "the firmware is not built",
            "run `cargo xtask setup` once, then `cargo xtask firmware`, or name an image with --image",
        )
    })
}

/// The folder of this program, those above it that cargo builds into, and the
/// usual one of the folder we are in.
fn near_folders() -> Vec<PathBuf> {
    let mut folders = Vec::new();
    if let Ok(program) = std::env::current_exe() {
        // target/release/softrig, or target/debug/deps/… of a test.
        folders.extend(program.ancestors().skip(1).take(3).map(Path::to_owned));
    }
    folders.push(PathBuf::from("target"));
    folders
}

fn first_file(mut candidates: impl Iterator<Item = PathBuf>) -> Option<PathBuf> {
    candidates.find(|path| path.is_file())
}
