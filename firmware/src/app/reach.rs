//! Can anything that is said to the board start a run on a rig that is not ready?
//!
//! A search through all sequences of at most [`LINES`] lines from [`lines`], with a pause of
//! none, one or many periods before each, in any one [`World`]. The firmware's real [`App`] is
//! asked; beside it stands an oracle that knows what was said, where the plunger really was, and
//! for how long which wire was broken.
//!
//! Situations count as the same if [`Situation`] is. It leaves out the clock, how far a filter
//! has come, and where exactly the plunger stands; the search is exhaustive up to these.

extern crate std;

use std::{
    borrow::ToOwned,
    collections::HashSet,
    format,
    hash::{DefaultHasher, Hash, Hasher},
    string::String,
    vec,
    vec::Vec,
};

use wire::{
    command::{Command, MAX_LINE, Request},
    protocol::Segment,
    reply::Reply,
    text::Text,
};

use super::*;
use crate::io::Oversampled;
use wire::stretch::NoProbe;

/// The longest sequence.
const LINES: usize = 6;

/// Periods of a long pause: homing takes 9 s here, saving 4.2 s.
const LONG: u16 = 1_000;

/// Air behind the plunger (µl).
const AIR_UL: f32 = 60_000.0;

/// Periods for which a wire has to be broken before the board must know.
const KNOWN: u16 = 7;

/// Periods after which a pressure that is off shows in the filtered reading.
const FILTERED: u16 = 60;

/// The condition of the rig around the board: broken wires, a pressure that is not zero, a
/// pressed switch.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum World {
    Well,
    OpenFlex,
    OpenPressure,
    /// 10 kPa with the valve open.
    Pressurised,
    EmergencyStop,
    PushedEnd,
    RetractedEnd,
}

const WORLDS: [World; 7] = [
    World::Well,
    World::OpenFlex,
    World::OpenPressure,
    World::Pressurised,
    World::EmergencyStop,
    World::PushedEnd,
    World::RetractedEnd,
];

/// The time that passes before a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Pause {
    None,
    One(World),
    /// The computer says that it is there.
    Long(World),
    /// It does not.
    Silent(World),
}

#[derive(Clone)]
struct Memory([u8; crate::stroke::SIZE as usize]);

impl Eeprom for Memory {
    fn read(&self, address: u16) -> u8 {
        self.0[usize::from(address)]
    }
    fn write(&mut self, address: u16, byte: u8) {
        self.0[usize::from(address)] = byte;
    }
}

fn sealed(command: Command) -> String {
    let mut out = Text::default();
    Request { id: 1, command }.write(&mut out).unwrap();
    out.0.trim_end().to_owned()
}

/// Every kind of command, with arguments that lead to different answers, and lines
/// that must have no effect: unsealed, damaged or out of bounds.
fn lines() -> Vec<String> {
    let set = |key, value: f32| Command::Set {
        key,
        bits: value.to_bits(),
    };
    let hold = Segment::Hold { duration_ms: 1_000 };
    let mut lines: Vec<String> = [
        Command::Hello,
        Command::Beat,
        Command::Help,
        Command::Status,
        Command::SelfTest,
        Command::Arm,
        Command::Disarm,
        Command::Run(None),
        Command::Run(Some(wire::protocol::Named::Paper)),
        Command::Stop,
        Command::Clear,
        Command::Tare,
        Command::Load(1),
        Command::Segment {
            index: 0,
            segment: hold,
        },
        // A zero that is 12 kPa off, and one that no sensor has.
        set(Key::PressureZero, 120.0),
        set(Key::PressureZero, 300.0),
        // An effect that this firmware does not know.
        Command::Set {
            key: Key::EffectKind { slot: 0 },
            bits: 99,
        },
        Command::Get(Key::Damping),
        Command::Save,
        Command::Discard,
        Command::Raw,
        Command::Exact,
        Command::Switches,
        Command::Machine,
        Command::Stroke,
    ]
    .map(sealed)
    .into();
    let run = sealed(Command::Run(None));
    lines.extend(["arm".to_owned(), "run".to_owned(), "run paper".to_owned()]);
    lines.push(format!("{}0000", &run[..run.len() - 4]));
    lines.push(run.replace("run", "ruo"));
    lines.push("~".repeat(MAX_LINE));
    lines
}

/// The knowledge of an observer from outside.
#[derive(Clone, Debug)]
struct Oracle {
    /// `arm` was obeyed, and the rig was not at rest since.
    armed: bool,
    /// The plunger came to its switch and left it, and the counter was set, since then.
    homed: bool,
    touched: bool,
    /// Periods for which the wire of each sensor has been broken.
    open_flex: u16,
    open_pressure: u16,
    /// Periods for which the pressure has not been zero.
    pressurised: u16,
    /// Periods for which a switch has been pressed that must not be.
    emergency_stop: u16,
}

/// The board, the rig and the onlooker.
#[derive(Clone)]
struct Bench {
    app: App,
    eeprom: Memory,
    past: Past,
    time_ms: u32,
    plunger_ul: f32,
    /// Where the plunger was when the valve was closed; none while it is open.
    closed_ul: Option<f32>,
    zero_ul: f32,
    world: World,
    oracle: Oracle,
}

/// The fields in which equal situations agree: the states of everything that decides anything.
#[derive(Hash)]
#[allow(clippy::struct_excessive_bools)] // That much is two-valued.
struct Situation {
    state: State,
    cause: Option<Fault>,
    latched: u32,
    conditions: u32,
    pressurised: bool,
    saving: bool,
    self_test: bool,
    is_homing: bool,
    measures: bool,
    running: Option<u8>,
    can_start: bool,
    draft: [u32; 2],
    in_use: u32,
    calibrated: bool,
    predicts: bool,
    oracle: (bool, bool, bool, [u16; 4]),
}

/// Of some hundred thousand situations, two with the same number are one in a billion.
fn hash(situation: &Situation) -> u64 {
    let mut hasher = DefaultHasher::new();
    situation.hash(&mut hasher);
    hasher.finish()
}

impl Bench {
    fn new(eeprom: Memory, reset: ResetCause) -> Self {
        Self {
            app: App::new(&eeprom, reset),
            eeprom,
            past: Past::new(),
            time_ms: 0,
            plunger_ul: 300.0,
            closed_ul: None,
            zero_ul: 0.0,
            world: World::Well,
            oracle: Oracle {
                armed: false,
                homed: false,
                touched: false,
                open_flex: 0,
                open_pressure: 0,
                pressurised: 0,
                emergency_stop: 0,
            },
        }
    }

    fn situation(&self) -> u64 {
        let app = &self.app;
        let word = |settings: &Settings, key| settings.bits(key).unwrap();
        let kind = Key::EffectKind { slot: 0 };
        let limit = |periods: u16| match periods {
            0 => 0,
            // Six single periods are too few to count.
            _ if periods < KNOWN => 1,
            _ if periods < FILTERED => KNOWN,
            _ => FILTERED,
        };
        let bits = |holds: &dyn Fn(Fault) -> bool| {
            let bit = |&fault: &Fault| u32::from(holds(fault)) << fault.code();
            Fault::ALL.iter().map(bit).sum()
        };
        let oracle = &self.oracle;
        hash(&Situation {
            state: app.state(),
            cause: app.supervisor.fault(),
            latched: bits(&|fault| app.supervisor.is_latched(fault)),
            conditions: bits(&|fault| app.conditions.holds(fault)),
            pressurised: app.conditions.pressurised,
            saving: app.saving.is_busy(),
            self_test: app.self_test.is_some(),
            is_homing: matches!(app.activity, Activity::Homing(_)),
            measures: matches!(&app.activity, Activity::Homing(it) if it.measures()),
            running: app.running().map(Runner::index),
            can_start: Runner::start(None, &app.memory, &app.settings).is_some(),
            // No line of the alphabet changes another word.
            draft: [Key::PressureZero, kind].map(|key| word(&app.draft, key)),
            in_use: word(&app.settings, Key::PressureZero),
            calibrated: app.calibration.is_some(),
            predicts: app.predictor.is_complete(),
            oracle: (
                oracle.armed,
                oracle.homed,
                oracle.touched,
                [
                    limit(oracle.open_flex),
                    limit(oracle.open_pressure),
                    limit(oracle.pressurised),
                    limit(oracle.emergency_stop),
                ],
            ),
        })
    }

    /// Counts of a ten-bit converter: pressure and flex.
    fn counts(&self) -> (f32, f32) {
        const FLAT: f32 = 668.444;
        const KPA: f32 = 1.0 / 0.673_316;
        let pushed = self.closed_ul.map_or(0.0, |from| self.plunger_ul - from);
        let zero = 102.4 + 101.325 * pushed / (AIR_UL - pushed) * KPA;
        match self.world {
            World::OpenFlex => (zero, 0.0),
            World::OpenPressure => (0.0, FLAT),
            World::Pressurised => (zero + 10.0 * KPA, FLAT),
            _ => (zero, FLAT),
        }
    }

    fn period(&mut self) -> Result<(), String> {
        self.time_ms += 10;
        let (pressure, flex) = self.counts();
        let per_step = Settings::DEFAULT.number(Key::VolumePerStep);
        let at_switch = self.plunger_ul <= 0.0;
        let inputs = Inputs {
            time_ms: self.time_ms,
            pressure: Oversampled((pressure * 16.0) as u16),
            flex: Oversampled((flex * 16.0) as u16),
            supply: crate::plant::supply(5.0),
            retracted_end: at_switch || self.world == World::RetractedEnd,
            pushed_end: self.world == World::PushedEnd,
            emergency_stop: self.world == World::EmergencyStop,
            steps: ((self.plunger_ul - self.zero_ul) / per_step) as i32,
            overruns: 0,
        };
        let count = |periods: &mut u16, holds: bool| {
            *periods = if holds { periods.saturating_add(1) } else { 0 };
        };
        let zero = self.app.settings.number(Key::PressureZero);
        let span = self.app.settings.number(Key::PressureSpan);
        let reads_kpa = (pressure - zero) * span;
        let oracle = &mut self.oracle;
        count(&mut oracle.open_flex, self.world == World::OpenFlex);
        count(&mut oracle.open_pressure, self.world == World::OpenPressure);
        count(
            &mut oracle.pressurised,
            self.world != World::OpenPressure && reads_kpa.abs() > 5.5,
        );
        count(
            &mut oracle.emergency_stop,
            self.world == World::EmergencyStop,
        );

        let before = self.app.state();
        let outputs = self.app.tick(&inputs, &mut self.eeprom, &mut self.past);
        self.closed_ul = match outputs.valve {
            Valve::Open => None,
            Valve::Closed => self.closed_ul.or(Some(self.plunger_ul)),
        };
        if let Pump::Rate(rate) = outputs.pump {
            self.plunger_ul = (self.plunger_ul + rate * 0.01 * per_step).max(-50.0);
        }
        if before == State::Homing {
            self.oracle.touched |= inputs.retracted_end;
            if let Some(steps) = outputs.set_steps {
                self.zero_ul = self.plunger_ul - steps as f32 * per_step;
                self.oracle.homed = self.oracle.touched && !inputs.retracted_end;
            }
        }
        let mut out = Text::default();
        self.app
            .report(&PlainTexts, &mut out, &mut NoProbe)
            .unwrap();
        self.judge(before, None)
    }

    fn pause(&mut self, pause: Pause) -> Result<(), String> {
        let (world, periods, beats) = match pause {
            Pause::None => return Ok(()),
            Pause::One(world) => (world, 1, false),
            Pause::Long(world) => (world, LONG, true),
            Pause::Silent(world) => (world, 250, false),
        };
        self.world = world;
        let beat = sealed(Command::Beat);
        let mut settled = 0;
        for period in 0..periods {
            let before = self.app.state();
            self.period()?;
            if beats && period % 50 == 0 {
                let mut out = Text::default();
                self.app
                    .receive(beat.as_bytes(), &self.eeprom, &self.past, &mut out)
                    .unwrap();
            }
            // At rest nothing happens any more once the filters are there; while the
            // rig is armed, everything does.
            let rests = matches!(before, State::Idle | State::Fault)
                && before == self.app.state()
                && !self.app.is_busy()
                && self.app.predictor.is_complete();
            settled = if rests { settled + 1 } else { 0 };
            if settled > FILTERED + 5 {
                break;
            }
        }
        Ok(())
    }

    /// Says a line; whether it was obeyed.
    fn say(&mut self, line: &str) -> Result<bool, String> {
        let before = self.app.state();
        let busy = self.app.is_busy();
        let mut out = Text::default();
        self.app
            .receive(line.as_bytes(), &self.eeprom, &self.past, &mut out)
            .unwrap();
        let obeyed = matches!(
            Reply::parse(out.0.lines().next().unwrap_or_default()),
            Ok(Some(Reply { outcome: Ok(_), .. }))
        );
        self.judge(before, Some((line, obeyed, busy)))?;
        Ok(obeyed)
    }

    /// Holds a change of state against what an onlooker knows.
    fn judge(&mut self, before: State, said: Option<(&str, bool, bool)>) -> Result<(), String> {
        let after = self.app.state();
        let oracle = &mut self.oracle;
        let is_said = |word: &str| {
            said.is_some_and(|(line, obeyed, _)| obeyed && line.starts_with(&format!("1 {word}")))
        };
        if before != State::Homing && after == State::Homing {
            if !is_said("arm") && !is_said("stroke") {
                return Err("homing without `arm`".to_owned());
            }
            if before != State::Idle {
                return Err(format!("armed from {before:?}"));
            }
            if said.is_some_and(|(_, _, busy)| busy) {
                return Err("armed while saving or testing".to_owned());
            }
            let zero = self.app.settings.number(Key::PressureZero);
            for (broken, row) in [
                (oracle.open_flex >= KNOWN, "a flex sensor without a reading"),
                (
                    oracle.open_pressure >= KNOWN,
                    "a pressure sensor without a reading",
                ),
                (
                    oracle.pressurised >= FILTERED,
                    "a pressure that is not zero",
                ),
                (oracle.emergency_stop >= 1, "a pressed emergency stop"),
                (!(51.2..=153.6).contains(&zero), "a zero that no sensor has"),
                (self.app.calibration.is_none(), "no calibration"),
            ] {
                if broken {
                    return Err(format!("armed with {row}"));
                }
            }
            (oracle.armed, oracle.homed, oracle.touched) = (true, false, false);
        }
        if matches!(after, State::Idle | State::Fault) {
            (oracle.armed, oracle.homed, oracle.touched) = (false, false, false);
        }
        if matches!(after, State::Ready | State::Running) && !(oracle.armed && oracle.homed) {
            return Err(format!(
                "{after:?}, armed: {}, homed: {}",
                oracle.armed, oracle.homed
            ));
        }
        if before != State::Running && after == State::Running {
            if before != State::Ready || !is_said("run") {
                return Err(format!("running from {before:?}"));
            }
            if !self.app.predictor.is_complete() {
                return Err("running without a prediction".to_owned());
            }
        }
        // A period after it is known, nothing that is broken is armed any more.
        let known = [oracle.open_flex, oracle.open_pressure]
            .iter()
            .any(|&periods| periods > KNOWN);
        let armed = matches!(after, State::Homing | State::Ready | State::Running);
        if armed && (known || oracle.emergency_stop > 1) {
            return Err(format!("{after:?} with {:?}", self.world));
        }
        Ok(())
    }
}

/// The results of a search.
#[derive(Debug, Default)]
struct Found {
    /// How many there are.
    situations: usize,
    transitions: usize,
    runs: usize,
    /// The fewest lines before a run.
    shortest: Option<usize>,
    states: HashSet<State>,
}

/// How a situation was reached.
type Path = Vec<(Pause, usize)>;

fn search(depth: usize) -> Result<Found, String> {
    let lines = lines();
    let mut pauses = vec![Pause::None];
    for world in WORLDS {
        pauses.extend([Pause::One(world), Pause::Long(world), Pause::Silent(world)]);
    }
    let erased = Memory([0xff; crate::stroke::SIZE as usize]);
    let damaged = Memory([0x3f; crate::stroke::SIZE as usize]);
    let mut layer: Vec<(Bench, Path)> = vec![
        (
            Bench::new(erased.clone(), ResetCause::Ordinary),
            Path::new(),
        ),
        (
            Bench::new(erased.clone(), ResetCause::Watchdog),
            Path::new(),
        ),
        (Bench::new(erased, ResetCause::BrownOut), Path::new()),
        (Bench::new(damaged, ResetCause::Ordinary), Path::new()),
    ];
    let mut seen: HashSet<(bool, u64)> = HashSet::new();
    let mut found = Found::default();
    for length in 1..=depth {
        let mut next: Vec<(Bench, Path)> = Vec::new();
        for (start, path) in layer {
            for &pause in &pauses {
                let mut paused = start.clone();
                let told = |line: Option<usize>, problem: String| {
                    let mut way: Vec<String> = path
                        .iter()
                        .map(|(pause, line)| format!("{pause:?}, {:?}", lines[*line]))
                        .collect();
                    way.push(format!("{pause:?}, {:?}", line.map(|line| &lines[line])));
                    format!("{problem} after\n  {}", way.join("\n  "))
                };
                paused.pause(pause).map_err(|problem| told(None, problem))?;
                if !seen.insert((true, paused.situation())) {
                    continue;
                }
                for (index, line) in lines.iter().enumerate() {
                    found.transitions += 1;
                    let mut bench = paused.clone();
                    bench
                        .say(line)
                        .map_err(|problem| told(Some(index), problem))?;
                    found.states.insert(bench.app.state());
                    if bench.app.state() == State::Running && paused.app.state() != State::Running {
                        found.runs += 1;
                        found.shortest = found.shortest.or(Some(length));
                    }
                    if seen.insert((false, bench.situation())) {
                        let mut path = path.clone();
                        path.push((pause, index));
                        next.push((bench, path));
                    }
                }
            }
        }
        layer = next;
        std::println!("{length} lines: {} new situations", layer.len());
    }
    found.situations = seen.len();
    Ok(found)
}

#[test]
fn no_six_lines_start_a_run_on_a_rig_that_is_not_ready() {
    let found = search(LINES).unwrap_or_else(|problem| panic!("{problem}"));
    std::println!("{found:?}");
    // It searched where there is something to find.
    assert_eq!(found.shortest, Some(2), "`arm` and `run`");
    assert_eq!(found.states.len(), State::ALL.len());
    assert!(found.runs > 10 && found.situations > 1_000);
}
