//! A board behind a pseudo-terminal: the firmware's own application on a simulated rig, and a
//! cable that can go wrong.
//!
//! What the board does is decided by [`firmware::app::App`], as on the Mega; the rig is the one of
//! the firmware's own tests. Its clock can run faster than ours, as a simulator's does. A
//! [`Script`] says what a board of ours never does: lines get lost or damaged on the way, it is of
//! another version, forgets, babbles or says nothing at all.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use firmware::app::{App, PlainTexts};
use firmware::design::PERIOD_MS;
use firmware::io::ResetCause;
use firmware::past::Past;
use firmware::plant::Plant;
use firmware::store::{Eeprom, Poll, Writer};
use firmware::stroke::SIZE;
use rustix::fs::{Mode, OFlags};
use rustix::io::ioctl_fionread;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use softrig_link::line::command_text;
use wire::assemble::{Assembled, Assembler};
use wire::command::{Command, MAX_LINE, Request};
use wire::line;
use wire::reply::{self, REMARK};
use wire::settings::{Key, Settings};
use wire::state::State;
use wire::stretch::NoProbe;
use wire::text::{Text, sealed};

/// Version of the firmware, which is that of the workspace.
pub const FIRMWARE: &str = env!("CARGO_PKG_VERSION");

/// Air (µl) in front of a retracted plunger: a small syringe, so that steps are short.
const AIR_UL: f64 = 15_000.0;
/// Where the plunger stands (µl) before it is homed.
const PLUNGER_UL: f64 = 300.0;

const PERIOD: Duration = Duration::from_millis(PERIOD_MS as u64);

/// Most control periods without looking at the cable: on a busy computer the board's clock
/// runs slower, and its patience is not used up before it has read what came.
const MOST_AT_ONCE: u32 = 10;

/// Bytes that wait to be read before the board waits: a dozen lines.
const MOST_UNREAD: u64 = 1_200;
/// Longest that a program which reads the cable is not run by a busy computer.
const SLOW_READER: Duration = Duration::from_secs(2);

/// What hangs on the cable, and what goes wrong; may be changed while it runs.
#[allow(clippy::struct_excessive_bools)] // Each is one way to misbehave.
pub struct Script {
    /// Milliseconds of its clock in one of ours.
    pub speed: u32,
    /// The rig, whose sensors can be held in a hand.
    pub plant: Plant,
    /// Says nothing at all.
    pub silent: bool,
    /// Says this, and nothing of softrig's.
    pub babble: Option<&'static str>,
    /// A remark that it makes ten times a second of its clock, and the version of its firmware.
    pub remark: Option<&'static str>,
    /// Version of the protocol that it claims.
    pub version: u8,
    /// Requests that it does not hear.
    pub deaf: u32,
    /// Damages every so-manieth telemetry line.
    pub corrupt_every: u32,
    /// Loses every so-manieth telemetry line.
    pub skip_every: u32,
    /// Says `# saved`.
    pub confirms: bool,
    /// A setting that it does not take.
    pub forgets: Option<Key>,
    /// The cable is out.
    pub pulled: bool,
    /// It has its power from the cable: putting that back resets it.
    pub resets: bool,
    /// Silent for this long (ms of ours) after a start.
    pub boot_ms: u64,
    /// What it heard, without numbers and checksums; beats not among it.
    pub heard: Vec<String>,
    /// Beats that it heard.
    pub beats: u32,
    /// What it is doing.
    pub state: State,
}

impl Default for Script {
    fn default() -> Self {
        Self {
            speed: 20,
            plant: Plant::new(AIR_UL, PLUNGER_UL),
            silent: false,
            babble: None,
            remark: None,
            version: reply::VERSION,
            deaf: 0,
            corrupt_every: 0,
            skip_every: 0,
            confirms: true,
            forgets: None,
            pulled: false,
            resets: true,
            boot_ms: 0,
            heard: Vec::new(),
            beats: 0,
            state: State::Idle,
        }
    }
}

/// A running board.
pub struct Board {
    folder: tempfile::TempDir,
    script: Arc<Mutex<Script>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Board {
    /// Starts a board with [`patient`] settings and plugs it in.
    pub fn start(script: Script) -> Self {
        Self::with_settings(script, &patient())
    }

    /// As [`Board::start`], with these settings.
    pub fn with_settings(script: Script, settings: &Settings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("port");
        let is_pulled = script.pulled;
        let script = Arc::new(Mutex::new(script));
        let stop = Arc::new(AtomicBool::new(false));
        let thread = {
            let (script, stop) = (Arc::clone(&script), Arc::clone(&stop));
            let (board, port) = (Electronics::new(settings), port.clone());
            std::thread::spawn(move || Cable::run(&script, &stop, board, &port))
        };
        let board = Self {
            folder,
            script,
            stop,
            thread: Some(thread),
        };
        wait_until("the port is there", || is_pulled || port.exists());
        board
    }

    /// The port.
    pub fn port(&self) -> PathBuf {
        self.folder.path().join("port")
    }

    /// Its behaviour.
    pub fn script(&self) -> MutexGuard<'_, Script> {
        self.script.lock().unwrap()
    }

    /// Whether it heard this.
    pub fn heard(&self, text: &str) -> bool {
        self.script().heard.iter().any(|heard| heard == text)
    }

    /// Whether it heard something that starts so.
    pub fn heard_any(&self, start: &str) -> bool {
        let script = self.script();
        script.heard.iter().any(|heard| heard.starts_with(start))
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let outcome = self.thread.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            outcome.unwrap().expect("the board does not panic");
        }
    }
}

/// Waits for something that happens soon.
pub fn wait_until(what: &str, mut happened: impl FnMut() -> bool) {
    let until = Instant::now() + Duration::from_secs(30);
    while !happened() {
        assert!(Instant::now() < until, "{what}: did not happen in time");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Settings for a small syringe, with which a busy computer is not taken for a lost one, and
/// a damping that a test can tell from another.
pub fn patient() -> Settings {
    let mut settings = Settings::DEFAULT;
    for (key, value) in [
        (Key::HostTimeout, 30.0_f32),
        (Key::Damping, 1.8),
        (Key::PressureGain, 1_000.0),
    ] {
        settings.set(key, value.to_bits()).unwrap();
    }
    settings
}

struct Cable {
    master: File,
    /// Kept open: the system reports a terminal that nobody has open as broken.
    slave: OwnedFd,
    assembler: Assembler<MAX_LINE>,
    is_read: bool,
    plugged: Instant,
}

impl Cable {
    fn plug_in(port: &Path) -> Self {
        // Closed in programs that the test starts: held open there, the cable
        // could not be pulled.
        let master =
            openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let slave = rustix::fs::open(name.as_c_str(), flags, Mode::empty()).unwrap();
        let mut modes = tcgetattr(&slave).unwrap();
        modes.make_raw();
        tcsetattr(&slave, OptionalActions::Now, &modes).unwrap();
        rustix::fs::fcntl_setfl(&master, OFlags::NONBLOCK).unwrap();
        symlink(name.to_str().unwrap(), port).unwrap();
        Self {
            master: File::from(master),
            slave,
            assembler: Assembler::new(),
            is_read: true,
            plugged: Instant::now(),
        }
    }

    /// What came; waits a moment if nothing did.
    fn read<'a>(&mut self, bytes: &'a mut [u8]) -> &'a [u8] {
        let count = self.master.read(bytes).unwrap_or_else(|_| {
            std::thread::sleep(Duration::from_millis(1));
            0
        });
        &bytes[..count]
    }

    /// What nobody reads is lost, as on a real cable. A reader that is only slow, because the
    /// computer is busy, is waited for once: the board's clock stands meanwhile, so that its
    /// patience is not used up by lines that nobody has seen.
    fn write(&mut self, text: &str, stop: &AtomicBool) {
        let begun = Instant::now();
        let mut rest = text.as_bytes();
        while !rest.is_empty() {
            let is_seen = ioctl_fionread(&self.slave).unwrap() <= MOST_UNREAD;
            if is_seen && let Ok(count) = self.master.write(rest) {
                rest = &rest[count..];
                self.is_read = true;
                continue;
            }
            self.is_read &= begun.elapsed() < SLOW_READER && !stop.load(Ordering::Relaxed);
            if !self.is_read {
                return;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn run(script: &Mutex<Script>, stop: &AtomicBool, mut board: Electronics, port: &Path) {
        let mut cable: Option<Self> = None;
        let mut clock = Instant::now();
        while !stop.load(Ordering::Relaxed) {
            let mut bytes = [0; 512];
            let bytes = if let Some(cable) = &mut cable {
                cable.read(&mut bytes)
            } else {
                std::thread::sleep(Duration::from_millis(1));
                &[]
            };
            let mut script = script.lock().unwrap();
            let elapsed = clock.elapsed();
            clock += elapsed;
            if script.pulled && cable.take().is_some() {
                std::fs::remove_file(port).unwrap();
            }
            if !script.pulled && cable.is_none() {
                cable = Some(Self::plug_in(port));
                if script.resets {
                    board.reset(&mut script);
                }
                continue;
            }
            let Some(cable) = &mut cable else {
                if !script.resets {
                    board.play(elapsed, &mut script);
                }
                continue;
            };
            let boot = Duration::from_millis(script.boot_ms);
            if script.silent || cable.plugged.elapsed() < boot {
                continue;
            }
            if let Some(text) = script.babble {
                cable.write(text, stop);
                std::thread::sleep(Duration::from_millis(20));
                continue;
            }
            let mut said = board.banner(&script);
            for &byte in bytes {
                match cable.assembler.push(byte) {
                    Assembled::Pending => {}
                    Assembled::Line(line) => said += &board.receive(line, &mut script),
                    Assembled::Overlong => board.app.overlong(),
                }
            }
            said += &board.play(elapsed, &mut script);
            script.state = board.app.state();
            drop(script);
            cable.write(&said, stop);
        }
        if cable.is_some() {
            std::fs::remove_file(port).unwrap();
        }
    }
}

struct Memory([u8; SIZE as usize]);

impl Eeprom for Memory {
    fn read(&self, address: u16) -> u8 {
        self.0[usize::from(address)]
    }
    fn write(&mut self, address: u16, byte: u8) {
        self.0[usize::from(address)] = byte;
    }
}

/// The application and its memory, and what a [`Script`] does to its lines.
struct Electronics {
    app: App,
    memory: Memory,
    past: Past,
    /// The banner is still to be said.
    is_new: bool,
    /// Time of its own that has yet to pass.
    owed: Duration,
    /// Telemetry lines so far.
    lines: u32,
}

impl Electronics {
    fn new(settings: &Settings) -> Self {
        let mut memory = Memory([0xff; SIZE as usize]);
        let mut writer = Writer::new(&memory);
        while writer.step(settings, &mut memory) == Poll::Writing {}
        Self {
            app: App::new(&memory, ResetCause::Ordinary),
            memory,
            past: Past::new(),
            is_new: true,
            owed: Duration::ZERO,
            lines: 0,
        }
    }

    fn reset(&mut self, script: &mut Script) {
        self.app = App::new(&self.memory, ResetCause::Ordinary);
        self.is_new = true;
        // Its clock and its counter of steps are zero where they are.
        script.plant.time_ms = 0;
        script.plant.zero = script.plant.plunger;
    }

    fn banner(&mut self, script: &Script) -> String {
        let mut out = Text::default();
        if std::mem::take(&mut self.is_new) {
            let Ok(()) = self.app.banner(&mut out);
        }
        claimed(&out.0, script)
    }

    fn receive(&mut self, line: &[u8], script: &mut Script) -> String {
        let mut out = Text::default();
        if let Ok(request) = Request::parse(line) {
            if script.deaf > 0 {
                script.deaf -= 1;
                return String::new();
            }
            if request.command == Command::Beat {
                script.beats += 1;
            } else {
                script.heard.push(command_text(request.command));
            }
            if matches!(request.command, Command::Set { key, .. } if script.forgets == Some(key)) {
                let Ok(line) = reply::ok(&mut out, request.id);
                let Ok(()) = line.finish();
            }
        }
        if out.0.is_empty() {
            let Ok(()) = self.app.receive(line, &self.memory, &self.past, &mut out);
        }
        claimed(&out.0, script)
    }

    /// Lets some of our time pass.
    fn play(&mut self, elapsed: Duration, script: &mut Script) -> String {
        self.owed = (self.owed + elapsed * script.speed).min(PERIOD * MOST_AT_ONCE);
        let mut said = String::new();
        while self.owed >= PERIOD {
            self.owed -= PERIOD;
            said += &self.tick(script);
        }
        said
    }

    fn tick(&mut self, script: &mut Script) -> String {
        let inputs = script.plant.inputs();
        let outputs = self.app.tick(&inputs, &mut self.memory, &mut self.past);
        script.plant.step(&outputs);
        let mut out = Text::default();
        let Ok(()) = self.app.telemetry().write(&mut out);
        self.lines += 1;
        let every = |count: u32| count > 0 && self.lines.is_multiple_of(count);
        if every(script.skip_every) {
            out.0.clear();
        }
        if every(script.corrupt_every) {
            out.0 = out.0.replace("angle:", "angle;");
        }
        let mut remark = Text::default();
        let Ok(()) = self.app.report(&PlainTexts, &mut remark, &mut NoProbe);
        if script.confirms || !remark.0.contains("saved") {
            out.0 += &remark.0;
        }
        if let (Some(remark), true) = (script.remark, self.lines.is_multiple_of(10)) {
            out.0 += &sealed(&format!("{REMARK}{remark}"));
        }
        out.0
    }
}

/// A line as a board of the versions in the script would say it.
fn claimed(said: &str, script: &Script) -> String {
    let Ok(text) = line::open(said.trim_end()) else {
        return said.to_owned();
    };
    let own = format!("softrig {FIRMWARE} wire {} ", reply::VERSION);
    let firmware = script.remark.unwrap_or(FIRMWARE);
    let claim = format!("softrig {firmware} wire {} ", script.version);
    sealed(&text.replace(&own, &claim))
}
