// SPDX-License-Identifier: GPL-3.0-or-later
//! `virtual-rig serve`: the rig behind a pseudo-terminal.

use std::{
    fs,
    io::{self, BufRead, Write},
    ops::RangeInclusive,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
        mpsc::{self, Receiver},
    },
    thread,
    time::{Duration, Instant},
};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use model_core::catalogue::Kind;
use softrig::{estimate::Placement, synth::example::rig_models};
use softrig_formats::model_file::ModelFile;
use virtual_rig::{Bench, Image, Options, Planned, VirtualRig, board::EEPROM_BYTES};

use crate::{
    control::{self, Control, LOADS, TILTS, TUBES, USUAL_TUBE_MM},
    pty::{Change, Port},
};

/// The rig behind a pseudo-terminal: opens like the board's serial port
///
/// Prints one line `port PATH` when it is ready, and runs until Ctrl-C. Opening
/// the port resets the board, as on a real Mega; its bootloader then listens for
/// a second, so that avrdude can write an image.
#[derive(Args, Debug)]
#[command(after_help = "\
Faults, as KIND[=SIZE] from the start, KIND[=SIZE]@SECONDS or KIND[=SIZE]@SECONDS..SECONDS of
simulated time:
  open-flex, short-flex, stuck-flex              flex sensor at 0 V, at 5 V, frozen
  open-pressure, short-pressure, stuck-pressure  the same for the pressure sensor
  leak             the air escapes with a time constant of 3 s
  stall            steps do not move the plunger
  noise            bursts of damaged bytes on the line, both ways
  emergency-stop   the button is pressed
  end-switch       the switch at the pushed-in end reads pressed
  detached-flex    the flex sensor has come off: zero, with much noise
  drifting-pressure=-0.5kPa/s  the pressure sensor shows less and less
  late=0.7s        the tube to the pressure sensor is clogged: it shows the pressure late
  branch           a kink takes the pressure sensor and the vent, on one branch, away
  reference=-1%/s  every count of the converter shrinks, that of its 1.1 V too
  ground=-10mV/s   the sensors' ground drifts: both voltages change alike
  mains=50Hz,60mV  a sine on both sensors' voltages
  lost-coil        a coil of the motor has no current: it trembles
  retracted-switch the switch at the retracted end reads pressed
  reversed-motor   two wires of a motor coil are swapped
  vent-shut        the vent does not open
  vent-open        the vent does not close
  brown-out        one reset by a sagging supply
  hang             the firmware's main program hangs until the next reset
  deaf             the same with interrupts off
  lost-steps       nine steps of ten do not move the plunger
  low-supply       the supply is 4.2 V
  power-cut        no power, for 0.5 s unless an end is given
  unplugged        bytes are lost both ways

Examples:
  virtual-rig serve --image firmware.elf --link rig-port
  virtual-rig serve --image firmware.elf --hide 7 --model-out model.toml
  virtual-rig serve --image firmware.elf --hide 7 --effect gravity
  virtual-rig serve --image firmware.elf --bench-seed 3
  virtual-rig serve --image firmware.elf --fault leak@12.5 --fault noise@3..5
  virtual-rig serve --image firmware.elf --fault late=0.4s
  virtual-rig serve --link rig-port       (empty board: flash it with avrdude)
  virtual-rig serve --image firmware.elf --speed max --duration 30")]
pub struct ServeArgs {
    /// The image in the flash (ELF); without one the board waits in its
    /// bootloader to be flashed
    #[arg(long, value_name = "ELF")]
    image: Option<PathBuf>,
    /// The actuator as it is: a model file, effects included
    #[arg(long, value_name = "TOML", conflicts_with = "hide")]
    actuator: Option<PathBuf>,
    /// Draw an actuator with one hidden effect from this seed, without saying
    /// which
    #[arg(long, value_name = "SEED")]
    hide: Option<u64>,
    /// Hide this effect in the drawn actuator instead of one drawn from the seed
    #[arg(long, value_name = "KIND", requires = "hide", value_parser = kind)]
    effect: Option<Kind>,
    /// Seed of the bench's small errors: zeros of the sensors, an actuator that
    /// is not quite at rest; the seed of --hide unless given, and without both
    /// the bench is ideal
    #[arg(long, value_name = "N")]
    bench_seed: Option<u64>,
    /// Write the nominal model of the drawn actuator here
    #[arg(long, value_name = "TOML", requires = "hide")]
    model_out: Option<PathBuf>,
    /// Write the answer, the drawn actuator as it is, here
    #[arg(long, value_name = "TOML", requires = "hide")]
    truth_out: Option<PathBuf>,
    /// Make a symbolic link to the port here; removed at exit
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// How fast simulated time passes; `max` waits for the client to read
    #[arg(long, value_enum, default_value_t = Speed::Realtime)]
    speed: Speed,
    /// Seed of the noise, of the plunger's start and of torn EEPROM bytes
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// EEPROM image of 4096 bytes: read at the start if it exists, kept up to
    /// date
    #[arg(long, value_name = "FILE")]
    eeprom: Option<PathBuf>,
    /// Something that goes wrong, at a time in seconds; repeatable
    #[arg(long = "fault", value_name = "KIND[=SIZE][@SECONDS[..SECONDS]]")]
    faults: Vec<Planned>,
    /// Turn the base by so many degrees: a weight pulls another way
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, value_parser = within(TILTS, "degrees"), allow_hyphen_values = true)]
    tilt_deg: f64,
    /// Hang so many grams at the tip
    #[arg(long, value_name = "GRAMS", default_value_t = 0.0, value_parser = within(LOADS, "grams"))]
    tip_load_g: f64,
    /// Length of the tube between pressure sensor and actuator; the actuator is written for the
    /// default
    #[arg(long, value_name = "MM", default_value_t = USUAL_TUBE_MM, value_parser = within(TUBES, "mm"))]
    tube_mm: f64,
    /// The board's second is longer by so many percent: the Mega's ceramic resonator is off by
    /// up to 0.5
    #[arg(long, value_name = "PERCENT", default_value_t = 0.0, value_parser = within(CLOCK_ERRORS, "percent"), allow_hyphen_values = true)]
    clock_error: f64,
    /// Stop after so many seconds of simulated time
    #[arg(long, value_name = "SECONDS", value_parser = positive)]
    duration: Option<f64>,
    /// Read commands from standard input, one a line, and answer each with one
    /// line: fault KIND[=SIZE] on|off, press KIND, release KIND, bend DEGREES|off,
    /// tilt DEGREES, load GRAMS, tube MILLIMETRES, rest SECONDS, replace actuator,
    /// reset, power-cycle, status, quit
    #[arg(long)]
    control: bool,
}

/// Errors of the board's clock (%): with larger ones the serial line would not work.
const CLOCK_ERRORS: RangeInclusive<f64> = -2.0..=2.0;

/// Reads a number in a range.
fn within(
    range: RangeInclusive<f64>,
    unit: &'static str,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        let number = text.parse().ok().filter(|it| range.contains(it));
        number.ok_or_else(|| format!("give {} to {} {unit}", range.start(), range.end()))
    }
}

/// How fast simulated time passes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Speed {
    /// As fast as on a real rig
    Realtime,
    /// As fast as the computer can
    Max,
}

/// Processor cycles between two looks at the port: a millisecond.
const SLICE: u64 = 16_000;
/// Bytes that may wait for the board before the client has to.
const MOST_UNSENT: usize = 4096;
/// Bytes that may wait for a client that does not read, in real time.
const MOST_UNREAD: usize = 1 << 16;
/// How far real time may run ahead before the rig gives up catching up.
const MOST_BEHIND: Duration = Duration::from_secs(1);
/// Simulated time (s) for which a client may be silent before the board goes no faster
/// than real time: half of what the board waits for a sign of life. On a busy computer
/// a tenth of a second without a turn is several simulated ones.
const PATIENCE_S: f64 = 1.0;
/// Simulated time between two looks at the EEPROM (s).
const EEPROM_EVERY_S: f64 = 0.25;

const PORT_FAILED: &str = "the pseudo-terminal failed";

fn positive(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|seconds: &f64| seconds.is_finite() && *seconds > 0.0)
        .ok_or_else(|| "give a number of seconds above zero".into())
}

fn kind(text: &str) -> Result<Kind, String> {
    let kind = Kind::from_name(text).filter(|kind| kind.is_name());
    kind.ok_or_else(|| {
        let known: Vec<&str> = Kind::NAMES.iter().map(|kind| kind.name()).collect();
        format!("use one of: {}", known.join(", "))
    })
}

/// Runs the command.
pub fn run(args: &ServeArgs) -> anyhow::Result<()> {
    let image = match &args.image {
        Some(path) => {
            Image::read(path).with_context(|| format!("cannot load {}", path.display()))?
        }
        None => Image::erased(),
    };
    let options = options(args)?;
    let stored = options.eeprom.clone();
    let mut rig = VirtualRig::new(&image, options)?;
    rig.change(|placement| {
        *placement = Placement {
            turned_rad: args.tilt_deg.to_radians(),
            load_kg: args.tip_load_g / 1000.0,
            tube: args.tube_mm / USUAL_TUBE_MM,
            ..Placement::USUAL
        };
    });

    let stop = Arc::new(AtomicBool::new(false));
    for signal in [
        signal_hook::consts::SIGINT,
        signal_hook::consts::SIGTERM,
        signal_hook::consts::SIGHUP,
    ] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .context("cannot watch for Ctrl-C")?;
    }
    let port = Port::new().context("cannot make a pseudo-terminal")?;
    let link = args
        .link
        .as_deref()
        .map(|link| Link::new(link, port.path()))
        .transpose()?;
    announce(args, port.path(), link.as_ref())?;

    let mut server = Server {
        rig,
        port,
        stop,
        commands: args.control.then(read_commands),
        unread: Vec::new(),
        speed: args.speed,
        heard_s: 0.0,
        eeprom: args.eeprom.clone().map(|path| Eeprom {
            path,
            stored: stored.unwrap_or_default(),
            look_at_s: EEPROM_EVERY_S,
        }),
        warned_slow: false,
        warned_unread: false,
    };
    let started = Instant::now();
    let outcome = server.run(args.duration);
    let saved = server.store_eeprom();
    let (simulated, real) = (server.rig.time_s(), started.elapsed().as_secs_f64());
    eprintln!(
        "virtual-rig: simulated {simulated:.1} s in {real:.1} s, {:.2} times real time",
        simulated / real
    );
    outcome.and(saved)
}

fn options(args: &ServeArgs) -> anyhow::Result<Options> {
    let bench = args.bench_seed.or(args.hide).map(Bench::draw);
    let mut options = Options::default();
    if let Some(path) = &args.actuator {
        options = Options::with_actuator(ModelFile::read(path)?.model);
    }
    if let Some(seed) = args.hide {
        let models = rig_models(seed, args.effect)?;
        let truth = ModelFile::parse(&models.truth, Path::new("the drawn actuator"))?;
        let bench = bench.map(|bench| bench.comments(&truth.model));
        let answer = models.truth + &bench.unwrap_or_default();
        for (path, text) in [(&args.model_out, &models.model), (&args.truth_out, &answer)] {
            if let Some(path) = path {
                softrig_formats::error::write_atomically(path, text.as_bytes())?;
            }
        }
        options = Options::with_actuator(truth.model);
    }
    if let Some(bench) = bench {
        bench.apply(&mut options.plant);
    }
    options.seed = args.seed;
    options.clock_factor = 1.0 + args.clock_error / 100.0;
    options.faults.clone_from(&args.faults);
    if let Some(path) = &args.eeprom {
        options.eeprom = match fs::read(path) {
            Ok(bytes) if bytes.len() == EEPROM_BYTES => Some(bytes),
            Ok(bytes) => bail!(
                "{} has {} bytes; an EEPROM image has {EEPROM_BYTES}: delete it to start with an \
                 erased one",
                path.display(),
                bytes.len()
            ),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => {
                return Err(error).with_context(|| format!("cannot read {}", path.display()));
            }
        };
    }
    Ok(options)
}

fn announce(args: &ServeArgs, port: &Path, link: Option<&Link>) -> anyhow::Result<()> {
    let path = link.map_or(port, |link| &link.path);
    let what = match &args.image {
        Some(image) => format!("running {}", image.display()),
        None => "an empty board in its bootloader".into(),
    };
    eprintln!(
        "virtual-rig: {what}; a simulated actuator is behind {}. Ctrl-C ends it.",
        path.display()
    );
    let mut stdout = io::stdout().lock();
    writeln!(stdout, "port {}", path.display())
        .and_then(|()| stdout.flush())
        .context("cannot say where the port is")
}

/// Reads commands in the background: standard input cannot be asked whether
/// there is a line.
fn read_commands() -> Receiver<String> {
    let (sender, receiver) = mpsc::channel();
    thread::spawn(move || {
        for line in io::stdin().lock().lines() {
            let Ok(line) = line else { return };
            if sender.send(line).is_err() {
                return;
            }
        }
    });
    receiver
}

struct Server {
    rig: VirtualRig,
    port: Port,
    stop: Arc<AtomicBool>,
    commands: Option<Receiver<String>>,
    /// Bytes that the client has not read.
    unread: Vec<u8>,
    speed: Speed,
    /// Simulated time when the client last sent something (s).
    heard_s: f64,
    eeprom: Option<Eeprom>,
    warned_slow: bool,
    warned_unread: bool,
}

struct Eeprom {
    path: PathBuf,
    stored: Vec<u8>,
    look_at_s: f64,
}

impl Server {
    fn run(&mut self, duration: Option<f64>) -> anyhow::Result<()> {
        // Real time at which simulated time was zero, if it never fell behind.
        let mut epoch = Instant::now();
        while !self.stopped() && duration.is_none_or(|end| self.rig.time_s() < end) {
            self.obey_commands()?;
            self.listen().context(PORT_FAILED)?;
            let ran = self.rig.run_cycles(SLICE);
            self.speak()?;
            ran?;
            self.look_at_eeprom()?;
            match self.speed {
                Speed::Realtime => self.keep_pace(&mut epoch),
                Speed::Max => self.wait_for_client()?,
            }
        }
        Ok(())
    }

    fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn obey_commands(&mut self) -> anyhow::Result<()> {
        while let Some(line) = self
            .commands
            .as_ref()
            .and_then(|lines| lines.try_recv().ok())
        {
            let reply = match line.parse() {
                Ok(control) => {
                    if control == Control::Quit {
                        self.stop.store(true, Ordering::Relaxed);
                    }
                    control::obey(control, &mut self.rig, self.port.connected())
                }
                Err(message) => format!("error {message}"),
            };
            let mut stdout = io::stdout().lock();
            writeln!(stdout, "{reply}")
                .and_then(|()| stdout.flush())
                .context("cannot answer a command")?;
        }
        Ok(())
    }

    /// Passes on what the client sent.
    fn listen(&mut self) -> io::Result<()> {
        let change = self.port.look()?;
        if matches!(change, Change::Opened | Change::Reopened) {
            self.unread.clear();
            self.rig.take_output();
            self.rig.open_port();
            self.heard_s = self.rig.time_s();
        }
        if self.rig.unsent() < MOST_UNSENT {
            let bytes = self.port.read()?;
            if !bytes.is_empty() {
                self.heard_s = self.rig.time_s();
                self.rig.send(&bytes).map_err(io::Error::other)?;
            }
        }
        if change == Change::Closed {
            self.unread.clear();
            self.rig.close_port();
        }
        Ok(())
    }

    /// Passes on what the board sent. Without a client it is lost, as on a real
    /// board.
    fn speak(&mut self) -> anyhow::Result<()> {
        let output = self.rig.take_output();
        if !self.port.connected() {
            return Ok(());
        }
        self.unread.extend(output);
        self.pass_on()?;
        match self.speed {
            Speed::Realtime => {
                if self.unread.len() > MOST_UNREAD {
                    self.unread.clear();
                    if !self.warned_unread {
                        self.warned_unread = true;
                        eprintln!("virtual-rig: the client does not read; output is lost");
                    }
                }
            }
            Speed::Max => {
                while !self.unread.is_empty() && !self.stopped() {
                    self.obey_commands()?;
                    self.port
                        .wait_for_room(Duration::from_millis(50))
                        .context(PORT_FAILED)?;
                    self.pass_on()?;
                    match self.port.look().context(PORT_FAILED)? {
                        Change::None => {}
                        Change::Closed => {
                            self.unread.clear();
                            self.rig.close_port();
                        }
                        Change::Opened | Change::Reopened => {
                            self.unread.clear();
                            self.rig.open_port();
                        }
                    }
                }
            }
        }
        Ok(())
    }

    fn pass_on(&mut self) -> anyhow::Result<()> {
        self.port.write(&mut self.unread).context(PORT_FAILED)
    }

    /// Gives a client that has been silent for long the time of its turn.
    fn wait_for_client(&mut self) -> anyhow::Result<()> {
        if self.port.connected() && self.rig.time_s() - self.heard_s > PATIENCE_S {
            self.port
                .wait_for_bytes(Duration::from_millis(1))
                .context(PORT_FAILED)?;
        }
        Ok(())
    }

    /// Sleeps while simulated time is ahead of real time.
    fn keep_pace(&mut self, epoch: &mut Instant) {
        let due = *epoch + Duration::from_secs_f64(self.rig.time_s());
        let now = Instant::now();
        if let Some(ahead) = due.checked_duration_since(now) {
            thread::sleep(ahead);
        } else if now - due > MOST_BEHIND {
            if !self.warned_slow {
                self.warned_slow = true;
                eprintln!(
                    "virtual-rig: this computer is too slow for real time; simulated time passes \
                     more slowly (a release build, or fewer other programs, may help)"
                );
            }
            *epoch += now - due;
        }
    }

    fn look_at_eeprom(&mut self) -> anyhow::Result<()> {
        let now = self.rig.time_s();
        match &mut self.eeprom {
            Some(eeprom) if now >= eeprom.look_at_s => eeprom.look_at_s = now + EEPROM_EVERY_S,
            _ => return Ok(()),
        }
        self.store_eeprom()
    }

    /// Writes the EEPROM to its file if it has changed.
    fn store_eeprom(&mut self) -> anyhow::Result<()> {
        let Some(eeprom) = &mut self.eeprom else {
            return Ok(());
        };
        let bytes = self.rig.eeprom();
        if bytes != eeprom.stored {
            softrig_formats::error::write_atomically(&eeprom.path, &bytes)?;
            eeprom.stored = bytes;
        }
        Ok(())
    }
}

/// A symbolic link that goes when it is dropped.
struct Link {
    path: PathBuf,
    target: PathBuf,
}

impl Link {
    fn new(path: &Path, target: &Path) -> anyhow::Result<Self> {
        match fs::symlink_metadata(path) {
            // Left by a rig that was killed.
            Ok(found) if found.file_type().is_symlink() => fs::remove_file(path)
                .with_context(|| format!("cannot replace the link {}", path.display()))?,
            Ok(_) => bail!(
                "{} exists and is no link: choose another name for --link",
                path.display()
            ),
            Err(_) => {}
        }
        std::os::unix::fs::symlink(target, path)
            .with_context(|| format!("cannot make the link {}", path.display()))?;
        Ok(Self {
            path: path.into(),
            target: target.into(),
        })
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        // Another rig may have taken the name over.
        if fs::read_link(&self.path).is_ok_and(|target| target == self.target) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Arguments {
        #[command(flatten)]
        serve: ServeArgs,
    }

    fn plant(words: &[&str]) -> virtual_rig::PlantConfig {
        let arguments = Arguments::try_parse_from([&["serve"], words].concat());
        options(&arguments.unwrap_or_else(|error| panic!("{error}")).serve)
            .expect("a rig")
            .plant
    }

    fn refusal(words: &[&str]) -> String {
        let Err(error) = Arguments::try_parse_from([&["serve"], words].concat()) else {
            panic!("{words:?} is accepted");
        };
        error.to_string()
    }

    #[test]
    fn a_bench_is_ideal_unless_it_or_the_actuator_is_drawn() {
        let bits = |words: &[&str]| plant(words).pressure_sensor.offset_millivolts.to_bits();
        let mut drawn = virtual_rig::PlantConfig::new(virtual_rig::default_actuator());
        assert_eq!(bits(&[]), drawn.pressure_sensor.offset_millivolts.to_bits());
        Bench::draw(7).apply(&mut drawn);
        let wanted = drawn.pressure_sensor.offset_millivolts;
        assert!(wanted.abs() > 0.1, "{wanted} mV");
        assert_eq!(bits(&["--hide", "7"]), wanted.to_bits());
        assert_eq!(bits(&["--bench-seed", "7"]), wanted.to_bits());
        assert_eq!(
            bits(&["--hide", "3", "--bench-seed", "7"]),
            wanted.to_bits()
        );
    }

    /// The file alone describes the rig: the actuator, and in the
    /// comments the bench.
    #[test]
    fn the_answer_tells_the_bench_and_is_still_a_model_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.toml");
        let plant = plant(&["--hide", "7", "--truth-out", path.to_str().unwrap()]);
        let truth = ModelFile::read(&path).unwrap();
        assert_eq!(truth.model, plant.actuator);
        let text = fs::read_to_string(&path).unwrap();
        let is_told = |name: &str, value: f64| {
            let line = text.lines().find_map(|line| line.strip_prefix(name));
            let word = line.and_then(|line| line.split_whitespace().next());
            let told: f64 = word
                .unwrap_or_else(|| panic!("no {name:?} in {text}"))
                .parse()
                .unwrap();
            assert!((told - value).abs() < 0.006, "{name}{told}, not {value}");
        };
        let bench = Bench::draw(7);
        is_told("# pressure zero: ", bench.pressure_zero_kpa);
        is_told("# angle zero: ", bench.angle_zero_deg);
        let (angle, rate) = plant.let_go.at_power_on(&plant.actuator);
        is_told("# angle at power-on: ", angle.to_degrees());
        is_told("# rate at power-on: ", rate.to_degrees());
    }

    #[test]
    fn an_effect_can_be_asked_for_and_an_unknown_one_names_the_others() {
        let drawn = plant(&["--hide", "7", "--effect", "gravity"]);
        let kinds: Vec<Kind> = drawn
            .actuator
            .effects()
            .map(|effect| effect.kind())
            .collect();
        assert_eq!(kinds, [Kind::Gravity]);
        let refused = refusal(&["--hide", "7", "--effect", "warp_drive"]);
        assert!(
            refused.contains("gravity") && refused.contains("leak"),
            "{refused}"
        );
        assert!(refusal(&["--effect", "gravity"]).contains("--hide"));
    }
}
