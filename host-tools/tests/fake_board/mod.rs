//! A board behind a pseudo-terminal that does as it is told, also badly.
//!
//! It reads requests with the very code that the firmware uses and plays
//! protocols with the same player; the rig behind it is one line of physics. Its
//! clock can run faster than ours, as a simulator's does.

use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::OwnedFd;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use host_tools::rig::link::line::{Text, command_text};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use ufmt::{uDisplay, uWrite, uwrite};
use wire::answer::{Bits, Counters, Identity, Raw, SettingsId, Status};
use wire::assemble::{Assembled, Assembler};
use wire::command::{Command, MAX_LINE, Request};
use wire::decimal::Hundredths;
use wire::fault::Fault;
use wire::line::Sealed;
use wire::protocol::{ControlMode, Playback, Program, Reference, Segment};
use wire::reply::{self, Refusal};
use wire::settings::{Key, Settings};
use wire::state::State;
use wire::telemetry::{Setpoint, Telemetry};

/// What it calls its settings.
const SETTINGS: SettingsId = SettingsId(0x1d0f);

/// How the board behaves; may be changed while it runs.
#[derive(Clone, Debug)]
#[allow(clippy::struct_excessive_bools)] // Each is one way to misbehave.
pub struct Script {
    /// Milliseconds of its clock in one of ours.
    pub speed: u32,
    /// Says nothing at all.
    pub silent: bool,
    /// Says this, and nothing of softrig's.
    pub babble: Option<&'static str>,
    /// A remark that it makes ten times a second of its clock, and the version of its firmware.
    pub remark: Option<&'static str>,
    /// Version of the protocol that it claims.
    pub version: u8,
    /// First word of what it refuses, and why.
    pub refuse: Vec<(&'static str, Refusal)>,
    /// Requests that it does not hear.
    pub deaf: u32,
    /// Damages every so-manieth telemetry line.
    pub corrupt_every: u32,
    /// Does not send every so-manieth telemetry line.
    pub skip_every: u32,
    /// Says `# saved`.
    pub confirms: bool,
    /// A setting that it does not keep.
    pub forgets: Option<Key>,
    /// The cable is out.
    pub pulled: bool,
    /// Putting the cable back resets it.
    pub resets: bool,
    /// Silent for this long (ms of ours) after a start.
    pub boot_ms: u64,
    /// The flex sensor's wire is off.
    pub no_flex: bool,
    /// What the flex sensor's counts do in a hand that shakes.
    pub shake: u16,
    /// Counts (sums of 16) of the pressure and the flex sensor.
    pub raw: (u16, u16),
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
            silent: false,
            babble: None,
            remark: None,
            version: reply::VERSION,
            refuse: Vec::new(),
            deaf: 0,
            corrupt_every: 0,
            skip_every: 0,
            confirms: true,
            forgets: None,
            pulled: false,
            resets: true,
            boot_ms: 0,
            no_flex: false,
            shake: 0,
            raw: (16 * 102, 16 * 668),
            heard: Vec::new(),
            beats: 0,
            state: State::Idle,
        }
    }
}

/// A running board.
pub struct FakeBoard {
    folder: tempfile::TempDir,
    script: Arc<Mutex<Script>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl FakeBoard {
    /// Starts a board and plugs it in.
    pub fn start(script: Script) -> Self {
        Self::with_settings(script, &patient())
    }

    /// As [`FakeBoard::start`], with these settings.
    pub fn with_settings(script: Script, settings: &Settings) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let port = folder.path().join("port");
        let is_pulled = script.pulled;
        let script = Arc::new(Mutex::new(script));
        let stop = Arc::new(AtomicBool::new(false));
        let thread = {
            let (script, stop) = (Arc::clone(&script), Arc::clone(&stop));
            let (settings, port) = (settings.clone(), port.clone());
            std::thread::spawn(move || Cable::run(&script, &stop, settings, &port))
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
}

impl Drop for FakeBoard {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let outcome = self.thread.take().map(JoinHandle::join);
        if !std::thread::panicking() {
            outcome.unwrap().expect("the fake board does not panic");
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

/// Settings with which a busy computer is not taken for a lost one, and with
/// numbers of their own where a test names them.
pub fn patient() -> Settings {
    let mut settings = Settings::DEFAULT;
    for (key, value) in [
        (Key::HostTimeout, 30.0_f32),
        (Key::Damping, 1.8),
        (Key::Exponent, 2.365),
        (Key::MaxPressure, 180.0),
        (Key::SetpointMax, 110.0),
    ] {
        settings.set(key, value.to_bits()).unwrap();
    }
    settings
}

struct Cable {
    master: File,
    /// Kept open: the system reports a terminal that nobody has open as broken.
    _slave: OwnedFd,
    assembler: Assembler<MAX_LINE>,
    is_read: bool,
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
            _slave: slave,
            assembler: Assembler::new(),
            is_read: true,
        }
    }

    /// What nobody reads is lost, as on a real cable. A reader that is only
    /// slow, because the computer is busy, is waited for once.
    fn write(&mut self, text: &str) {
        let begun = Instant::now();
        let mut rest = text.as_bytes();
        while !rest.is_empty() {
            match self.master.write(rest) {
                Ok(count) => {
                    rest = &rest[count..];
                    self.is_read = true;
                }
                Err(_) if self.is_read && begun.elapsed() < Duration::from_millis(300) => {
                    std::thread::sleep(Duration::from_millis(1));
                }
                Err(_) => {
                    self.is_read = false;
                    return;
                }
            }
        }
    }

    fn run(script: &Mutex<Script>, stop: &AtomicBool, settings: Settings, port: &Path) {
        let mut board = Board::new(settings);
        let mut cable: Option<Self> = None;
        let mut plugged = Instant::now();
        let mut clock = Instant::now();
        let mut owed_ms = 0;
        let mut banner = true;
        while !stop.load(Ordering::Relaxed) {
            let is_pulled = script.lock().unwrap().pulled;
            if is_pulled && cable.take().is_some() {
                std::fs::remove_file(port).unwrap();
            }
            if !is_pulled && cable.is_none() {
                cable = Some(Self::plug_in(port));
                plugged = Instant::now();
                if script.lock().unwrap().resets {
                    board.reset();
                    banner = true;
                }
            }
            let elapsed = clock.elapsed();
            clock += elapsed;
            let Some(cable) = &mut cable else {
                std::thread::sleep(Duration::from_millis(2));
                continue;
            };
            let mut bytes = [0; 512];
            let count = cable.master.read(&mut bytes).unwrap_or_else(|_| {
                std::thread::sleep(Duration::from_millis(1));
                0
            });
            let mut script = script.lock().unwrap();
            if script.silent || plugged.elapsed() < Duration::from_millis(script.boot_ms) {
                continue;
            }
            if let Some(text) = script.babble {
                cable.write(text);
                std::thread::sleep(Duration::from_millis(20));
                continue;
            }
            if std::mem::take(&mut banner) {
                cable.write(&sealed(&format!(
                    "#: softrig 9.9.9 wire {} settings 1d0f",
                    script.version
                )));
            }
            let mut replies = String::new();
            for &byte in &bytes[..count] {
                if let Assembled::Line(line) = cable.assembler.push(byte) {
                    replies += &board.receive(line, &mut script);
                }
            }
            owed_ms += u32::try_from(elapsed.as_micros()).unwrap() * script.speed / 1000;
            let mut lines = String::new();
            while owed_ms >= 10 {
                owed_ms -= 10;
                lines += &board.tick(&mut script);
            }
            script.state = board.state;
            drop(script);
            cable.write(&replies);
            cable.write(&lines);
        }
        if cable.is_some() {
            std::fs::remove_file(port).unwrap();
        }
    }
}

/// A line with its checksum and end.
pub fn sealed(text: &str) -> String {
    let mut out = Text::default();
    let mut line = Sealed::new(&mut out);
    line.write_str(text).unwrap();
    line.finish().unwrap();
    out.0
}

struct Board {
    settings: Settings,
    draft: Settings,
    time_ms: u32,
    sequence: u16,
    state: State,
    fault: u8,
    heard_ms: u32,
    homed_ms: u32,
    saving_ms: Option<u32>,
    memory: Vec<Option<Segment>>,
    program: Vec<Segment>,
    playback: Playback,
    angle: f32,
    lines: u32,
}

impl Board {
    fn new(settings: Settings) -> Self {
        Self {
            draft: settings.clone(),
            settings,
            time_ms: 0,
            sequence: 0,
            state: State::Idle,
            fault: 0,
            heard_ms: 0,
            homed_ms: 0,
            saving_ms: None,
            memory: Vec::new(),
            program: Vec::new(),
            playback: Playback::new(),
            angle: 0.0,
            lines: 0,
        }
    }

    fn reset(&mut self) {
        *self = Self::new(self.settings.clone());
    }

    fn receive(&mut self, line: &[u8], script: &mut Script) -> String {
        let Ok(request) = Request::parse(line) else {
            return String::new();
        };
        if script.deaf > 0 {
            script.deaf -= 1;
            return String::new();
        }
        self.heard_ms = self.time_ms;
        let text = command_text(request.command);
        let word = text.split(' ').next().unwrap_or("");
        let refusal = script
            .refuse
            .iter()
            .find(|(refused, _)| *refused == word)
            .map(|(_, refusal)| *refusal);
        if request.command == Command::Beat {
            script.beats += 1;
        } else {
            script.heard.push(text);
        }
        let outcome = match refusal {
            Some(refusal) => Err(refusal),
            None => self.obey(request.command, script),
        };
        match outcome {
            Ok(text) if text.is_empty() => sealed(&format!("A: {} ok", request.id)),
            Ok(text) => sealed(&format!("A: {} ok {text}", request.id)),
            Err(refusal) => sealed(&format!("A: {} no {}", request.id, refusal.code())),
        }
    }

    fn obey(&mut self, command: Command, script: &Script) -> Result<String, Refusal> {
        let armed = matches!(self.state, State::Homing | State::Ready | State::Running);
        match command {
            Command::Hello => {
                return Ok(text(&Identity {
                    firmware: script.remark.unwrap_or("9.9.9"),
                    wire: script.version,
                    settings: SETTINGS,
                }));
            }
            Command::Status => {
                return Ok(text(&Status {
                    state: self.state,
                    fault: Fault::from_code(self.fault),
                    counters: Counters::default(),
                    settings: SETTINGS,
                    place: None,
                }));
            }
            Command::Get(key) => return Ok(text(&Bits(self.settings.bits(key).unwrap()))),
            Command::Raw => {
                let shake = if self.lines.is_multiple_of(2) {
                    script.shake
                } else {
                    0
                };
                return Ok(text(&Raw {
                    pressure: script.raw.0,
                    flex: script.raw.1 + shake,
                }));
            }
            Command::Arm if self.state == State::Idle => {
                self.state = State::Homing;
                self.homed_ms = self.time_ms + 300;
            }
            Command::Run(named) if self.state == State::Ready => {
                self.program = match named {
                    Some(named) => (0..32).map_while(|index| named.segment(index)).collect(),
                    None => self
                        .memory
                        .iter()
                        .copied()
                        .collect::<Option<Vec<_>>>()
                        .filter(|program| wire::protocol::check(&program[..]).is_ok())
                        .ok_or(Refusal::BadProtocol)?,
                };
                self.playback = Playback::new();
                self.state = State::Running;
            }
            Command::Arm | Command::Run(_) => {
                return Err(if self.fault == 0 {
                    Refusal::NotNow
                } else {
                    Refusal::Faulted
                });
            }
            Command::Stop | Command::Disarm if armed => self.state = State::Idle,
            Command::Clear => {
                self.fault = 0;
                self.state = State::Idle;
            }
            Command::Load(count) => self.memory = vec![None; usize::from(count)],
            Command::Segment { index, segment } => {
                *self
                    .memory
                    .get_mut(usize::from(index))
                    .ok_or(Refusal::BadProtocol)? = Some(segment);
            }
            Command::Set { key, bits } => {
                self.draft
                    .set(key, bits)
                    .map_err(|_| Refusal::OutOfBounds)?;
            }
            Command::Save if armed => return Err(Refusal::NotNow),
            Command::Save => {
                let before = self.settings.clone();
                self.settings = self.draft.clone();
                if let Some(key) = script.forgets {
                    self.settings.set(key, before.bits(key).unwrap()).unwrap();
                }
                self.saving_ms = Some(self.time_ms + 1_000);
            }
            Command::Discard => self.draft = self.settings.clone(),
            _ => {}
        }
        Ok(String::new())
    }

    fn tick(&mut self, script: &mut Script) -> String {
        self.time_ms += 10;
        self.sequence = self.sequence.wrapping_add(1);
        let mut text = String::new();
        if self.saving_ms.is_some_and(|at| self.time_ms >= at) {
            self.saving_ms = None;
            if script.confirms {
                text += &sealed("#: saved");
            }
        }
        if let (Some(remark), true) = (script.remark, self.time_ms.is_multiple_of(100)) {
            text += &sealed(&format!("#: {remark}"));
        }
        let armed = matches!(self.state, State::Homing | State::Ready | State::Running);
        let silence = (self.time_ms - self.heard_ms) as f32 / 1000.0;
        if armed && silence > self.settings.number(Key::HostTimeout) {
            self.state = State::Fault;
            self.fault = Fault::HostLost.code();
        }
        if self.state == State::Homing && self.time_ms >= self.homed_ms {
            self.state = State::Ready;
        }
        let mut setpoint = Setpoint::None;
        let mut target = 0.0;
        if self.state == State::Running {
            match self.playback.reference(&self.program[..]) {
                Reference::Done => self.state = State::Ready,
                Reference::Track { mode, level } => {
                    let level_ = Hundredths::round(level);
                    target = level;
                    setpoint = if mode == ControlMode::Pressure {
                        Setpoint::Pressure(level_)
                    } else {
                        Setpoint::Angle(level_)
                    };
                }
                Reference::Hold => target = self.angle,
                Reference::Release => {}
            }
            self.playback.advance(&self.program[..], 10);
        }
        self.angle += (target - self.angle) / 30.0;
        let angle = Hundredths::round(self.angle);
        let sample = Telemetry {
            sequence: self.sequence,
            time_ms: self.time_ms,
            pressure_kpa: Some(Hundredths(angle.0 * 4 / 5)),
            angle_deg: (!script.no_flex).then_some(angle),
            predicted_deg: Some(angle),
            setpoint,
            volume_ul: angle.0,
            state: self.state,
            fault: self.fault,
            mismatch: false,
        };
        self.lines += 1;
        let every = |count: u32| count > 0 && self.lines.is_multiple_of(count);
        if every(script.skip_every) {
            return text;
        }
        let mut line = Text::default();
        sample.write(&mut line).unwrap();
        if every(script.corrupt_every) {
            line.0 = line.0.replace("angle:", "angle;");
        }
        text + &line.0
    }
}

/// An answer as the board writes it.
fn text(answer: &impl uDisplay) -> String {
    let mut out = Text::default();
    let Ok(()) = uwrite!(out, "{}", answer);
    out.0
}
