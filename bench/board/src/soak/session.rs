// SPDX-License-Identifier: GPL-3.0-or-later
//! One rig with a simulated computer, and the checks on both.

use std::collections::VecDeque;

use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use softrig_link::line::request_text;
use wire::{
    command::{Command, Request},
    fault::Fault as Latched,
    reply::{Refusal, Reply},
    settings::{Key, Settings},
    state::State,
    telemetry::Telemetry,
};

use super::{
    Violation,
    draw::{Deadline, Misfortune},
    ledger::Ledger,
    summary::Summary,
};
use virtual_rig::{
    Bench, VirtualRig,
    board::CLOCK_HZ,
    fault::Fault,
    image::Image,
    plant::PlantConfig,
    rig::{self, PLANT_CYCLES},
};

/// Cycles between two looks: 2.5 ms.
const SLICE: u64 = 5 * PLANT_CYCLES;

/// How far above `max.kpa` the true pressure may get: the firmware looks twice, the
/// sensor has a zero of its own, and the pump takes a while to stop.
const PRESSURE_SHARE: f64 = 1.1;

/// How far the plunger may go on while the pressure sensor is stuck, in `max.ul`: two
/// windows of the stall watch, the first of which may have begun with a rise, and a
/// tenth for the way until the pump stands.
pub const STUCK_TRAVEL: f64 = 2.0 * 0.08 * 1.1;

/// Lines that are kept for a report.
const KEPT: usize = 60;

/// The computer says so often that it is there (s).
const BEAT_S: f64 = 0.5;

/// A pump that stepped within this time before something broke was moving (s).
const MOVING_S: f64 = 0.005;

/// Two lines of telemetry, one of them on its way (s).
const SHOWN_S: f64 = 0.030;

pub(super) type Outcome<T = ()> = Result<T, Box<Violation>>;

/// A pump that has to stand.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stop {
    kind: Misfortune,
    /// From when the deadline runs (s); with [`Deadline::InMotion`], from the first
    /// step on.
    from_s: Option<f64>,
    within_s: f64,
}

/// Where the plunger and the air were when a stuck sensor began to matter.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stuck {
    lowest_mm: f64,
    /// Absolute pressure times volume (kPa m³).
    air: f64,
}

pub(super) struct Session<'s> {
    pub(super) rig: VirtualRig,
    pub(super) random: Pcg64Mcg,
    pub(super) summary: &'s mut Summary,
    tell: &'s mut dyn FnMut(&Summary),
    seed: u64,
    plant: PlantConfig,
    /// The random draw of the round, for a report.
    pub(super) round: String,
    ledger: Ledger,
    lines: VecDeque<String>,
    pub(super) now: Option<Telemetry>,
    heard_s: f64,
    replies: Vec<(u8, Result<String, Refusal>)>,
    id: u8,
    beat_at_s: f64,
    /// When the last line ended that an unbroken cable carried (s).
    last_line_s: f64,
    /// Lasting faults, and since when (s).
    lasting: Vec<(Misfortune, f64)>,
    /// Events since the rig was last known to be healthy.
    recent: Vec<Misfortune>,
    stops: Vec<Stop>,
    last_edge_s: f64,
    stuck: Option<Stuck>,
    armed_at_s: f64,
}

/// Runs rounds for `seconds`, and the one that the end falls into to its end.
pub(super) fn run(
    image: &Image,
    seed: u64,
    seconds: f64,
    summary: &mut Summary,
    tell: &mut dyn FnMut(&Summary),
) -> Outcome {
    let mut plant = PlantConfig::new(rig::default_actuator());
    Bench::draw(seed).apply(&mut plant);
    let options = rig::Options {
        plant: plant.clone(),
        seed,
        ..rig::Options::default()
    };
    let mut rig = VirtualRig::new(image, options).map_err(|error| {
        Box::new(Violation {
            seed,
            time_s: 0.0,
            what: error.to_string(),
            round: String::new(),
            truth: String::new(),
            lines: Vec::new(),
        })
    })?;
    rig.trace_steps(true);
    let mut session = Session {
        rig,
        // Not the numbers that the rig draws from this seed.
        random: Pcg64Mcg::seed_from_u64(seed ^ 0x736f_616b),
        summary,
        tell,
        seed,
        plant,
        round: "power-on".into(),
        ledger: Ledger::default(),
        lines: VecDeque::new(),
        now: None,
        heard_s: 0.0,
        replies: Vec::new(),
        id: 0,
        beat_at_s: 0.0,
        last_line_s: 0.0,
        lasting: Vec::new(),
        recent: Vec::new(),
        stops: Vec::new(),
        last_edge_s: f64::NEG_INFINITY,
        stuck: None,
        armed_at_s: f64::NEG_INFINITY,
    };
    session.summary.sessions += 1;
    let outcome = session.rounds(seconds);
    summary.before_s += summary.session_s;
    summary.session_s = 0.0;
    outcome
}

fn seconds_of(cycle: u64) -> f64 {
    cycle as f64 / f64::from(CLOCK_HZ)
}

impl Session<'_> {
    fn rounds(&mut self, seconds: f64) -> Outcome {
        self.until(3.0, "the first sample", |session| session.now.is_some())?;
        while self.rig.time_s() < seconds {
            self.play_round()?;
            self.summary.rounds += 1;
        }
        Ok(())
    }

    pub(super) fn violation<T>(&self, what: impl Into<String>) -> Outcome<T> {
        Err(Box::new(Violation {
            seed: self.seed,
            time_s: self.rig.time_s(),
            what: what.into(),
            round: self.round.clone(),
            truth: format!(
                "{:?}; lasting {:?}; recent {:?}",
                self.rig.plant(),
                self.lasting,
                self.recent
            ),
            lines: self.lines.iter().cloned().collect(),
        }))
    }

    // ------------------------------------------------------------------ time

    /// Lets time pass.
    pub(super) fn pass(&mut self, seconds: f64) -> Outcome {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Seconds.
        let end = self.rig.cycle() + (seconds * f64::from(CLOCK_HZ)) as u64;
        while self.rig.cycle() < end {
            self.slice(SLICE.min(end - self.rig.cycle()))?;
        }
        Ok(())
    }

    /// Lets time pass until something holds, and says so if it does not.
    pub(super) fn until(
        &mut self,
        seconds: f64,
        what: &str,
        holds: impl Fn(&Self) -> bool,
    ) -> Outcome {
        let end_s = self.rig.time_s() + seconds;
        while !holds(self) {
            if self.rig.time_s() > end_s {
                return self.violation(format!("{what} did not come within {seconds} s"));
            }
            self.slice(SLICE)?;
        }
        Ok(())
    }

    fn slice(&mut self, cycles: u64) -> Outcome {
        let (noisy, unplugged) = (self.suffers(Fault::Noise), self.suffers(Fault::Unplugged));
        self.ledger.line_is(noisy, unplugged);
        if let Err(error) = self.rig.run_cycles(cycles) {
            return self.violation(format!("the processor left its program: {error}"));
        }
        let now_s = self.rig.time_s();
        self.summary.session_s = now_s;
        self.hear()?;
        self.look_at_steps()?;
        self.look_at_pressure()?;
        self.look_at_rest()?;
        // Nobody speaks to a bootloader that waits for a programmer.
        if now_s >= self.beat_at_s && !self.rig.in_bootloader() {
            self.beat_at_s = now_s + BEAT_S;
            self.send(Command::Beat);
        }
        (self.tell)(self.summary);
        Ok(())
    }

    // ----------------------------------------------------------------- lines

    fn keep(&mut self, direction: char, line: &str) {
        if self.lines.len() == KEPT {
            self.lines.pop_front();
        }
        self.lines.push_back(format!(
            "{:10.4} {direction} {}",
            self.rig.time_s(),
            line.escape_debug()
        ));
    }

    /// Sends a request and returns its number.
    pub(super) fn send(&mut self, command: Command) -> u8 {
        self.id = self.id.wrapping_add(1);
        let id = self.id;
        let line = request_text(&Request { id, command });
        self.keep('>', line.trim_end());
        if command == Command::Arm {
            self.armed_at_s = self.rig.time_s();
        }
        let is_plugged = !self.suffers(Fault::Unplugged);
        // It fails for want of memory only, and then nothing is kept.
        let _ = self.rig.send(line.as_bytes());
        if is_plugged {
            // Ten bits a byte at the line's pace.
            self.last_line_s = self.rig.time_s() + 90e-6 * self.rig.unsent() as f64;
        }
        id
    }

    /// Sends a request and returns the answer.
    pub(super) fn ask(&mut self, command: Command) -> Outcome<Result<String, Refusal>> {
        self.replies.clear();
        let id = self.send(command);
        self.until(2.0, &format!("an answer to {command:?}"), |session| {
            session.replies.iter().any(|(reply, _)| *reply == id)
        })?;
        let index = self.replies.iter().position(|(reply, _)| *reply == id);
        match index {
            Some(index) => Ok(self.replies.swap_remove(index).1),
            None => self.violation("an answer got lost"),
        }
    }

    /// Sends a request that has to be obeyed.
    pub(super) fn obey(&mut self, command: Command) -> Outcome<String> {
        match self.ask(command)? {
            Ok(text) => Ok(text),
            Err(refusal) => self.violation(format!("{command:?} was refused: {refusal}")),
        }
    }

    fn hear(&mut self) -> Outcome {
        for line in self.rig.take_lines() {
            self.keep('<', &line);
            let resets = self.rig.resets();
            let now_s = self.rig.time_s();
            if let Ok(sample) = Telemetry::parse(line.as_bytes()) {
                let entry = self.ledger.sample(&sample, now_s, resets, self.summary);
                if let Err(what) = entry {
                    return self.violation(what);
                }
                self.take(sample)?;
            } else if let Ok(Some(reply)) = Reply::parse(&line) {
                self.replies
                    .push((reply.id, reply.outcome.map(str::to_owned)));
                if self.replies.len() > 100 {
                    let _ = self.replies.remove(0);
                }
            } else if wire::line::open(&line).is_err()
                && let Err(what) = self.ledger.garbage(resets, self.summary)
            {
                return self.violation(what);
            }
        }
        Ok(())
    }

    /// A new state, a new fault: was there a reason?
    fn take(&mut self, sample: Telemetry) -> Outcome {
        let before = self.now.replace(sample);
        self.heard_s = self.rig.time_s();
        let was = |state| before.is_some_and(|before| before.state == state);
        if sample.fault != 0 && before.is_none_or(|before| before.fault != sample.fault) {
            let explains = |kind: &&Misfortune| kind.explains(sample.fault);
            let Some(culprit) = self.recent.iter().find(explains).copied() else {
                return self.violation(format!(
                    "fault {} ({}) although nothing that leads to it was broken",
                    sample.fault,
                    Latched::from_code(sample.fault).map_or("unknown here", Latched::name)
                ));
            };
            if before.is_none_or(|before| before.fault == 0) {
                self.summary.kinds.entry(culprit).or_default().latched += 1;
            }
        }
        let armed = matches!(sample.state, State::Ready | State::Running);
        if armed && !was(State::Ready) && !was(State::Running) {
            let now_s = self.rig.time_s();
            let broken = self
                .lasting
                .iter()
                .find(|&&(kind, from_s)| kind.forbids_arming() && now_s - from_s > 0.070 + SHOWN_S);
            if let Some((kind, _)) = broken {
                return self.violation(format!("armed in spite of: {}", kind.name()));
            }
        }
        if sample.state == State::Ready && was(State::Homing) {
            self.summary.arms += 1;
        }
        Ok(())
    }

    pub(super) fn state(&self) -> State {
        self.now.map_or(State::Idle, |sample| sample.state)
    }

    // ----------------------------------------------------------------- truth

    fn look_at_steps(&mut self) -> Outcome {
        for edge in self.rig.step_edges() {
            let at_s = seconds_of(edge);
            self.last_edge_s = at_s;
            for index in 0..self.stops.len() {
                let stop = &mut self.stops[index];
                let from_s = *stop.from_s.get_or_insert(at_s);
                let after_s = at_s - from_s;
                if after_s <= 0.0 {
                    continue;
                }
                let (kind, within_s) = (stop.kind, stop.within_s);
                if after_s > within_s {
                    return self.violation(format!(
                        "a step {:.2} ms after {}; {:.0} ms are allowed",
                        1e3 * after_s,
                        kind.name(),
                        1e3 * within_s
                    ));
                }
                let tally = self.summary.kinds.entry(kind).or_default();
                tally.latest_stop_s = tally.latest_stop_s.max(after_s);
            }
        }
        Ok(())
    }

    fn look_at_pressure(&mut self) -> Outcome {
        const ATMOSPHERE_KPA: f64 = 101.325;
        let truth = self.rig.plant();
        let kpa = truth.pressure_kpa;
        self.summary.largest_deg = self.summary.largest_deg.max(truth.angle_deg);
        let limit = PRESSURE_SHARE * f64::from(Settings::DEFAULT.number(Key::MaxPressure));
        let lasts = self.suffers(Fault::StuckPressure);
        let air = (kpa + ATMOSPHERE_KPA) * self.plant.volume_m3(truth.plunger_mm);
        if lasts && (truth.valve_open || self.stuck.is_none()) {
            self.stuck = Some(Stuck {
                lowest_mm: truth.plunger_mm,
                air,
            });
        }
        let Some(stuck) = &mut self.stuck else {
            self.summary.largest_kpa = self.summary.largest_kpa.max(kpa);
            if kpa > limit {
                return self.violation(format!("{kpa:.1} kPa are above {limit:.1} kPa"));
            }
            return Ok(());
        };
        stuck.lowest_mm = stuck.lowest_mm.min(truth.plunger_mm);
        let allowed_ul = STUCK_TRAVEL * f64::from(Settings::DEFAULT.number(Key::MaxVolume));
        let area = self.plant.syringe.area_m2();
        let travel_ul = (truth.plunger_mm - stuck.lowest_mm) * 1e-3 * area * 1e9;
        let smallest = self.plant.volume_m3(stuck.lowest_mm) - allowed_ul * 1e-9;
        // A tenth for air that was still on its way through the tube.
        let highest = 1.1 * (stuck.air / smallest - ATMOSPHERE_KPA).max(limit / 1.1);
        if lasts {
            self.summary.stuck_travel_ul = self.summary.stuck_travel_ul.max(travel_ul);
        }
        self.summary.largest_stuck_kpa = self.summary.largest_stuck_kpa.max(kpa);
        if lasts && travel_ul > allowed_ul {
            return self.violation(format!(
                "{travel_ul:.0} ul pushed in behind a stuck pressure sensor; {allowed_ul:.0} ul are allowed"
            ));
        }
        if kpa > highest {
            return self.violation(format!(
                "{kpa:.1} kPa behind a stuck pressure sensor; {highest:.1} kPa can be explained"
            ));
        }
        if !lasts && kpa <= limit {
            self.stuck = None;
        }
        Ok(())
    }

    /// In idle and in a fault nothing moves and nothing is shut.
    fn look_at_rest(&mut self) -> Outcome {
        let now_s = self.rig.time_s();
        let rests = matches!(self.state(), State::Idle | State::Fault);
        let is_fresh = now_s - self.heard_s < SHOWN_S && self.now.is_some();
        if !rests || !is_fresh || now_s - self.armed_at_s < SHOWN_S {
            return Ok(());
        }
        let truth = self.rig.plant();
        if truth.driver_enabled || !(truth.valve_open || self.suffers(Fault::VentShut)) {
            return self.violation(format!("{:?}, but pump or valve are not", self.state()));
        }
        Ok(())
    }

    // ----------------------------------------------------------- misfortunes

    /// Lets something happen now.
    pub(super) fn strike(&mut self, kind: Misfortune, alone: bool) {
        let now_s = self.rig.time_s();
        let is_moving = now_s - self.last_edge_s < MOVING_S;
        self.keep('!', kind.name());
        self.recent.push(kind);
        let tally = self.summary.kinds.entry(kind).or_default();
        tally.drawn += 1;
        tally.moving += u64::from(is_moving);
        if let Some((from_s, within_s)) = self.deadline(kind, alone, is_moving) {
            let tally = self.summary.kinds.entry(kind).or_default();
            tally.deadline_s = tally.deadline_s.max(within_s);
            self.stops.push(Stop {
                kind,
                from_s,
                within_s,
            });
        }
        match kind {
            Misfortune::Broken(fault) => {
                self.rig.set_fault(fault, true);
                self.lasting.push((kind, now_s));
            }
            Misfortune::PortOpened => self.rig.open_port(),
            Misfortune::ResetButton => self.rig.reset(super::draw::BUTTON),
            Misfortune::Stop | Misfortune::Disarm => {
                let command = if kind == Misfortune::Stop {
                    Command::Stop
                } else {
                    Command::Disarm
                };
                self.send(command);
                // From when the line is there.
                let end_s = self.last_line_s;
                if let Some(stop) = self.stops.last_mut().filter(|stop| stop.kind == kind) {
                    stop.from_s = Some(end_s);
                }
            }
        }
    }

    /// From when (s) and how long (s) the pump may go on.
    fn deadline(
        &self,
        kind: Misfortune,
        alone: bool,
        is_moving: bool,
    ) -> Option<(Option<f64>, f64)> {
        let now_s = self.rig.time_s();
        let armed = matches!(self.state(), State::Ready | State::Running);
        match kind.deadline() {
            // On a broken line, or with another fault, a command need not arrive.
            Deadline::After(_)
                if !alone && matches!(kind, Misfortune::Stop | Misfortune::Disarm) =>
            {
                None
            }
            Deadline::After(within_s) => Some((Some(now_s), within_s)),
            Deadline::InMotion(within_s) if armed => Some((is_moving.then_some(now_s), within_s)),
            Deadline::AfterLastLine(within_s) => Some((Some(self.last_line_s), within_s)),
            Deadline::InMotion(_) | Deadline::None => None,
        }
    }

    /// Mends something. What lasted too short a time to count has no consequence.
    pub(super) fn mend(&mut self, kind: Misfortune) {
        let now_s = self.rig.time_s();
        if let Misfortune::Broken(fault) = kind {
            self.keep('!', &format!("{} mended", kind.name()));
            self.rig.set_fault(fault, false);
            self.lasting.retain(|&(other, _)| other != kind);
            self.stops.retain(|stop| {
                let is_over = stop
                    .from_s
                    .is_some_and(|from_s| now_s > from_s + stop.within_s);
                stop.kind != kind || kind.resets() || is_over
            });
        }
    }

    /// Whether something is broken now.
    fn suffers(&self, fault: Fault) -> bool {
        let broken = Misfortune::Broken(fault);
        self.lasting.iter().any(|&(kind, _)| kind == broken)
    }

    /// What is lasting.
    pub(super) fn lasting(&self) -> Vec<Misfortune> {
        self.lasting.iter().map(|&(kind, _)| kind).collect()
    }

    /// Whether the board started anew since the rig was last known to be well.
    pub(super) fn was_reset(&self) -> bool {
        self.recent.iter().any(|kind| kind.resets())
    }

    /// The rig is well again, or is about to be used as if it were.
    pub(super) fn forget(&mut self) {
        self.stops.clear();
        self.recent.clear();
    }

    /// Somebody cleared by hand: an end switch is excused again until motion.
    pub(super) fn excuse_end_switch(&mut self) {
        self.stops
            .retain(|stop| stop.kind != Misfortune::Broken(Fault::EndSwitch));
    }

    /// Whether the last sample is as new as it can be.
    pub(super) fn is_heard(&self, since_s: f64) -> bool {
        self.heard_s > since_s
    }
}
