//! The acceptance test of a board and its rig, step by step over a link.
//!
//! Commands are sent here and what comes back is collected; what a step is for and what it is held
//! to is one module up. Who stands at the rig is an [`Operator`]: a person at a terminal or at a
//! page, or a virtual rig that presses its own switches.

use std::time::Duration;

use super::{
    Curve, Hold, Limit, Measurement, Noise, Outcome, Result as Finding, Step, Stop, Watched,
    curves, rate, spectrum,
};
use crate::rig_file::{ClockRate, FARTHEST_RATE};
use crate::{Counters, Event, Link, LinkError, Received};
use softrig_formats::instant::{Instant, sleep};
use softrig_formats::settings_file::key_text;
use wire::answer::{SettingsId, Switches};
use wire::command::Command;
use wire::decimal::Hundredths;
use wire::fault::Fault;
use wire::protocol::{ControlMode, Segment};
use wire::reply::Refusal;
use wire::self_test::{DONE, expected};
use wire::settings::{Key, Settings};
use wire::state::State;
use wire::step_report::StepReport;

/// Silence of a board that sends a hundred lines a second, after which it is not there (s).
const SILENT: Duration = Duration::from_secs(5);
/// How long a person is waited for at a switch.
const PATIENCE: Duration = Duration::from_secs(90);
/// How long a virtual hand takes at most.
const VIRTUAL_PATIENCE: Duration = Duration::from_secs(5);
/// How long a pulled cable is waited for.
const RECONNECT: Duration = Duration::from_secs(6);
/// Time (s) of the board's within which the self-test ends.
const SELF_TEST_S: f64 = 40.0;
/// Samples of a sensor below which its noise is not judged.
const LEAST_SAMPLES: usize = 300;
/// Noise at rest, rms, and drift a minute above which it is worth looking for the cause: three
/// to five times what a sensor of the parts list has at this converter.
const PRESSURE_LIMITS_KPA: (f64, f64) = (0.3, 1.0);
/// The same for the angle.
const ANGLE_LIMITS_DEG: (f64, f64) = (0.3, 2.0);
/// Reading of a gauge sensor without pressure (kPa); the board is not armed beyond 5.
const ZERO_KPA: f64 = 3.0;
/// Microsteps by which two homes may differ, beside what the plunger moves between two looks of
/// the board at its switch.
const HOME_STEPS: f64 = 10.0;
/// Microsteps by which two measurements of the stroke may differ: its edges are sought slowly.
const STROKE_STEPS: f64 = 10.0;
/// Supply (V) below which the board is not armed.
const LEAST_SUPPLY_V: f64 = 4.5;
/// Time (s) between these looks, and the share of `max.flow` at which the edge is sought.
const LOOK: (f64, f64) = (0.01, 0.05);
/// Pressure that is held (kPa), and the share of what may be asked for that it never exceeds.
const HELD_KPA: (f64, f64) = (40.0, 0.8);
/// Slow run of the emergency stop: levels (kPa) and times (ms) of its two ramps. The button is
/// asked for during the second, when there is pressure to let out.
const SLOW_RUN: [(f64, u32); 2] = [(15.0, 8_000), (30.0, 90_000)];
/// Time (s) at which it is asked for.
const ASKED_S: f64 = 9.0;
/// Times (ms) of the held pressure: with the pump, without it, and of its release.
const HELD_MS: [u32; 3] = [8_000, 10_500, 4_000];

/// How a link homes: it hands every event on, as long as that wants to.
type Homing = fn(&mut Link, &mut dyn FnMut(Event) -> bool) -> Result<bool, LinkError>;

/// A switch of the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Switch {
    /// The end switch behind the plunger.
    Retracted,
    /// The end switch in front of it.
    Pushed,
    /// The emergency stop.
    EmergencyStop,
}

impl Switch {
    const ALL: [Self; 3] = [Self::Retracted, Self::Pushed, Self::EmergencyStop];

    /// Its name, as it is spoken of.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Retracted => "end switch, retracted",
            Self::Pushed => "end switch, pushed in",
            Self::EmergencyStop => "emergency stop",
        }
    }

    const fn is_open(self, switches: Switches) -> bool {
        match self {
            Self::Retracted => switches.retracted,
            Self::Pushed => switches.pushed,
            Self::EmergencyStop => switches.emergency_stop,
        }
    }
}

/// Something to do at the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hand {
    /// Press it.
    Press(Switch),
    /// Let it go.
    Release(Switch),
    /// Pull one of its wires.
    Pull(Switch),
    /// Plug the wire in again.
    Plug(Switch),
}

/// What a person said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    /// It is so, or may be.
    Yes,
    /// It is not so.
    No,
    /// Leave it out.
    Skip,
}

/// Who stands at the rig. An error of any method ends the test; [`Interrupted`] is that of somebody
/// who wants that.
#[allow(clippy::missing_errors_doc)]
pub trait Operator {
    /// A step begins.
    fn begin(&mut self, step: Step, number: usize, of: usize) -> anyhow::Result<()>;
    /// Whether it may begin: asked where something moves or restarts.
    fn agrees(&mut self, step: Step) -> anyhow::Result<()>;
    /// Whether the work may go on: an error after Ctrl-C.
    fn check(&mut self) -> anyhow::Result<()>;
    /// How far it is.
    fn progress(&mut self, passed: f64, total: f64, what: &str);
    /// It has ended.
    fn ended(&mut self, finding: &Finding);
    /// Whether anybody can press a switch.
    fn has_hands(&self) -> bool;
    /// Does it, or asks for it.
    fn hand(&mut self, hand: Hand) -> anyhow::Result<()>;
    /// Asks something that [`answer`](Self::answer) then answers.
    fn ask(&mut self, question: &str) -> anyhow::Result<()>;
    /// What was answered, if something was.
    fn answer(&mut self) -> anyhow::Result<Option<Answer>>;
    /// Keeps the board's clock, by which later recordings are corrected; a sentence on where.
    fn keep_clock(&mut self, rate: ClockRate) -> anyhow::Result<String>;
    /// Something to know after the last step.
    fn warn(&mut self, text: &str);
}

/// Ctrl-C, or `q`.
#[derive(Debug, thiserror::Error)]
#[error("stopped by the operator")]
pub struct Interrupted;

/// What is to be done.
#[derive(Debug)]
pub struct Plan {
    /// The steps, in any order.
    pub steps: Vec<Step>,
    /// How long telemetry is watched (s of the board's time).
    pub watch_s: f64,
    /// Whether simulated time passes as fast as the computer can, so that clocks say nothing.
    pub at_full_speed: bool,
}

/// A run through the steps.
pub struct Session<'o> {
    link: Link,
    operator: &'o mut dyn Operator,
    plan: Plan,
    is_simulated: bool,
    /// Since the last [`clear`](Vec::clear).
    samples: Vec<Received>,
    remarks: Vec<String>,
    others: Vec<String>,
    settings: Settings,
    has_settings: bool,
    watched: Option<Watched>,
    /// The clock that was measured.
    pub clock: Option<ClockRate>,
    heard: Instant,
    /// The board's time (s) at which a simulator was last told that somebody is there.
    told_s: f64,
    /// Why nothing more can be done.
    lost: Option<String>,
}

impl<'o> Session<'o> {
    /// A run that begins with [`run`](Self::run).
    pub fn new(link: Link, operator: &'o mut dyn Operator, plan: Plan) -> Self {
        Self {
            is_simulated: link.is_simulated(),
            link,
            operator,
            plan,
            samples: Vec::new(),
            remarks: Vec::new(),
            others: Vec::new(),
            settings: Settings::DEFAULT,
            has_settings: false,
            watched: None,
            clock: None,
            heard: Instant::now(),
            told_s: 0.0,
            lost: None,
        }
    }

    /// The connection.
    pub fn link(&self) -> &Link {
        &self.link
    }

    /// Makes every step of the plan. Leaves the rig stopped and vented, also after an error.
    ///
    /// # Errors
    ///
    /// [`Interrupted`]; what goes wrong otherwise is in the findings.
    pub fn run(&mut self) -> anyhow::Result<Vec<Finding>> {
        let outcome = self.steps();
        self.leave();
        outcome
    }

    fn steps(&mut self) -> anyhow::Result<Vec<Finding>> {
        let asked = self.plan.steps.clone();
        let of = asked.len();
        let mut number = 0;
        let mut findings = Vec::new();
        for step in Step::ALL {
            let finding = if asked.contains(&step) {
                number += 1;
                self.operator.begin(step, number, of)?;
                let finding = self.step(step)?;
                self.operator.ended(&finding);
                finding
            } else {
                Finding::skipped(step, "Not selected.")
            };
            findings.push(finding);
        }
        Ok(findings)
    }

    /// Makes a step. Only an interruption is an error: what goes wrong belongs to the finding.
    fn step(&mut self, step: Step) -> anyhow::Result<Finding> {
        if let Some(why) = &self.lost {
            return Ok(Finding::failed(step, why.clone(), Vec::new()));
        }
        let outcome = self.prepare(step).and_then(|ready| match ready {
            Some(finding) => Ok(finding),
            None => self.make(step),
        });
        let finding = match outcome {
            Ok(finding) => finding,
            Err(error) if error.is::<Interrupted>() => return Err(error),
            Err(error) => Finding::failed(step, sentence(&format!("{error:#}")), Vec::new()),
        };
        self.settle()?;
        Ok(finding)
    }

    /// Whether a step can begin; else what it is instead.
    fn prepare(&mut self, step: Step) -> anyhow::Result<Option<Finding>> {
        self.samples.clear();
        let needs_hands = matches!(step, Step::EmergencyStop | Step::Relief);
        if needs_hands && !self.operator.has_hands() {
            return Ok(Some(Finding::skipped(
                step,
                "This step needs a person: run it at a terminal.",
            )));
        }
        if step == Step::Relief && self.is_simulated {
            return Ok(Some(Finding::skipped(
                step,
                "The virtual rig has no relief valve.",
            )));
        }
        if step.moves().is_some() {
            let status = self.status()?;
            if let Some(fault) = status.fault {
                let why = format!("Nothing was moved: {}", latched(fault));
                let blocked = Finding::failed(step, why, Vec::new());
                // What to do is in the sentence.
                return Ok(Some(Finding {
                    advice: None,
                    ..blocked
                }));
            }
        }
        if step.moves().is_some() || step == Step::Relief {
            self.operator.agrees(step)?;
            if self.answered()? == Answer::Skip {
                return Ok(Some(Finding::skipped(step, "Skipped by the operator.")));
            }
        }
        Ok(None)
    }

    fn make(&mut self, step: Step) -> anyhow::Result<Finding> {
        match step {
            Step::Identity => self.identity(),
            Step::SelfTest => self.self_test(),
            Step::Telemetry => self.telemetry(),
            Step::Clock => self.clock(),
            Step::Noise => self.noise(),
            Step::Switches => self.switches(),
            Step::Homing => self.homing(),
            Step::Stroke => self.stroke(),
            Step::EmergencyStop => self.emergency_stop(),
            Step::Pressure => self.pressure(),
            Step::Relief => self.relief(),
        }
    }

    // ------------------------------------------------------------- the steps

    /// Who the board is, and whether its flash holds the whole image.
    fn identity(&mut self) -> anyhow::Result<Finding> {
        let settings = self.settings()?.clone();
        let status = self.status()?;
        let board = self.link.board().clone();
        let changed: Vec<String> = Key::all()
            .filter(|&key| settings.bits(key) != Settings::DEFAULT.bits(key))
            .map(key_text)
            .collect();
        let version = env!("CARGO_PKG_VERSION");
        let image = match board.image {
            None => Measurement::flag("the image carries no checksum of its own".to_owned(), true),
            Some(sum) => Measurement::flag(
                format!(
                    "the flash holds the whole image, checksum {:04x} of {:04x}",
                    sum.found, sum.built
                ),
                sum.is_whole(),
            ),
        };
        let measured = vec![
            Measurement::flag(
                format!("firmware {} is that of this rig, {version}", board.firmware),
                board.firmware == version,
            ),
            image,
            Measurement::flag(
                format!(
                    "settings arrive as the board checks them, {}",
                    board.settings
                ),
                SettingsId::of(&settings) == board.settings,
            ),
            Measurement::flag(
                match status.fault {
                    None => "no fault is latched".to_owned(),
                    Some(fault) => format!("no fault is latched ({})", fault.name()),
                },
                status.fault.is_none(),
            ),
            Measurement::new(
                "settings that are not as shipped",
                changed.len() as f64,
                "",
                Limit::None,
            ),
            limit_of(&settings, Key::MaxPressure, "limit of the pressure", "kPa"),
            limit_of(&settings, Key::MaxAngle, "limit of the angle", "°"),
        ];
        let said = match (changed.len(), status.fault) {
            (0, _) => "All settings are as shipped: calibrate before you measure.".to_owned(),
            (count, _) if count > 6 => format!("{count} settings are not as shipped."),
            _ => format!("Not as shipped: {}.", changed.join(", ")),
        };
        Ok(Finding::judge(Step::Identity, measured, said))
    }

    fn self_test(&mut self) -> anyhow::Result<Finding> {
        let expected = expected()
            .map_err(|error| anyhow::anyhow!("this rig cannot make the self-test: {error:?}"))?;
        self.others.clear();
        self.request(Command::SelfTest)?;
        let total = expected.len() as f64;
        let done = self.until(SELF_TEST_S, |session| {
            let said = session.others.len() as f64;
            session
                .operator
                .progress(said, total + 2.0, "stepping every effect");
            Ok(session.others.iter().any(|text| text == DONE))
        })?;
        let lines: Vec<String> = self
            .others
            .iter()
            .map(|it| wire::text::sealed(it))
            .collect();
        let steps: Vec<StepReport<'_>> = lines
            .iter()
            .filter_map(|line| StepReport::parse(line).ok())
            .collect();
        let same = |step: &&StepReport<'_>| expected.iter().any(|it| step.is_same_to_the_bit(it));
        let equal = steps.iter().filter(same).count();
        let measured = vec![
            Measurement::flag("the board came to the end of its self-test", done),
            Measurement::new(
                "model steps that the board made",
                steps.len() as f64,
                "",
                Limit::AtLeast(total),
            ),
            Measurement::new(
                "steps that differ from this computer's",
                (steps.len() - equal) as f64,
                "",
                Limit::AtMost(0.0),
            ),
        ];
        let said = format!("{equal} steps, equal to the last bit.");
        Ok(Finding::judge(Step::SelfTest, measured, said))
    }

    fn telemetry(&mut self) -> anyhow::Result<Finding> {
        let watched = self.watch()?.clone();
        let in_real_time = self.is_in_real_time();
        let mut measured = watched.measure(in_real_time);
        let fault = watched
            .samples
            .iter()
            .find_map(|it| Fault::from_code(it.sample.fault));
        measured.push(Measurement::flag(
            fault.map_or_else(
                || "no fault meanwhile".to_owned(),
                |fault| format!("no fault meanwhile ({})", fault.name()),
            ),
            fault.is_none(),
        ));
        // A firmware that does not measure it does not know the question.
        let supply = self.link.machine().ok().and_then(|it| it.supply_mv);
        if let Some(mv) = supply {
            measured.push(Measurement::new(
                "supply of the board",
                f64::from(mv) / 1000.0,
                "V",
                Limit::AtLeast(LEAST_SUPPLY_V),
            ));
        }
        let seconds = self.plan.watch_s;
        let said = format!(
            "{} lines in {seconds:.0} s, none lost. The processor has time for every period.",
            watched.samples.len()
        );
        Ok(Finding::judge(Step::Telemetry, measured, said))
    }

    fn clock(&mut self) -> anyhow::Result<Finding> {
        let watched = self.watch()?;
        let Some(rate) = rate(&watched.samples) else {
            return Ok(Finding::failed(
                Step::Clock,
                "The board restarted or was watched for too short a time.",
                Vec::new(),
            ));
        };
        if self.is_simulated && !self.is_in_real_time() {
            let times = 1.0 / rate.factor;
            return Ok(Finding::skipped(
                Step::Clock,
                format!("Simulated time runs {times:.1} times as fast as real time: not compared."),
            ));
        }
        let measured = vec![
            Measurement::new(
                "the board's second is longer by",
                (rate.factor - 1.0) * 100.0,
                "%",
                Limit::Within(-1.0, 1.0),
            ),
            Measurement::new(
                "standard error",
                rate.standard_error * 100.0,
                "%",
                Limit::AtMost(0.02),
            ),
        ];
        let mut finding = Finding::judge(Step::Clock, measured, String::new());
        if finding.outcome == Outcome::Passed {
            self.clock = Some(rate);
            finding.sentence = self.operator.keep_clock(rate)?;
        }
        Ok(finding)
    }

    fn noise(&mut self) -> anyhow::Result<Finding> {
        let watched = self.watch()?.clone();
        let count = watched.samples.len();
        let mut measured = Vec::new();
        let mut drawn = curves(&watched.samples);
        let sensors = [
            ("pressure", "kPa", "kPa/min", PRESSURE_LIMITS_KPA),
            ("angle", "°", "°/min", ANGLE_LIMITS_DEG),
        ];
        let mut sentences = Vec::new();
        for (index, (name, unit, per_minute, (deviation, drift))) in sensors.into_iter().enumerate()
        {
            let values: Vec<f64> = watched
                .samples
                .iter()
                .filter_map(|it| match index {
                    0 => it.sample.pressure_kpa,
                    _ => it.sample.angle_deg,
                })
                .map(|it| f64::from(it.to_f32()))
                .collect();
            measured.push(Measurement::new(
                format!("{name}: samples without a reading"),
                (count - values.len()) as f64,
                "",
                Limit::AtMost(0.0),
            ));
            if values.len() < LEAST_SAMPLES {
                measured.push(Measurement::flag(format!("{name}: enough readings"), false));
                continue;
            }
            if index == 0 {
                let mean = values.iter().sum::<f64>() / values.len() as f64;
                let limit = Limit::Within(-ZERO_KPA, ZERO_KPA);
                measured.push(Measurement::new(
                    "pressure reading at rest",
                    mean,
                    unit,
                    limit,
                ));
            }
            let noise = Noise::of(&values);
            measured.extend(noise.measure(name, unit, per_minute, deviation, drift));
            if noise.levels <= 8 {
                sentences.push(format!(
                    "The {name} shows only {} different readings: its noise is below one converter count, or it is stuck; the `pressure` step decides.",
                    noise.levels
                ));
            }
            drawn.push(Curve {
                x_label: "frequency (Hz)",
                y_label: if index == 0 {
                    "spectrum of the pressure (dB)"
                } else {
                    "spectrum of the angle (dB)"
                },
                points: decibels(&spectrum(&values)),
            });
        }
        if sentences.is_empty() {
            sentences.push("White noise without drift, as the models assume.".to_owned());
        }
        Ok(Finding::judge(Step::Noise, measured, sentences.join(" ")).with_curves(drawn))
    }

    fn switches(&mut self) -> anyhow::Result<Finding> {
        let now = match self.link.switches() {
            Err(LinkError::Refused {
                refusal: Refusal::Unknown,
                ..
            }) => {
                return Ok(Finding::failed(
                    Step::Switches,
                    "This firmware does not report its switches: flash the matching version.",
                    Vec::new(),
                ));
            }
            other => other?,
        };
        let mut measured: Vec<Measurement> = Switch::ALL
            .iter()
            .map(|it| {
                let name = format!("{}: closed while untouched", it.name());
                Measurement::flag(name, !it.is_open(now))
            })
            .collect();
        if measured.iter().any(|it| !it.passed) {
            return Ok(Finding::judge(Step::Switches, measured, ""));
        }
        if !self.operator.has_hands() {
            return Ok(Finding::skipped(
                Step::Switches,
                "All are closed when untouched. To test them pressed, run this step at a terminal.",
            ));
        }
        for switch in Switch::ALL {
            let ways = [
                (Hand::Press(switch), Hand::Release(switch), "pressed"),
                (Hand::Pull(switch), Hand::Plug(switch), "without its wire"),
            ];
            for (open, close, when) in ways {
                self.operator.hand(open)?;
                let Some(opened) = self.wait_for(switch, true)? else {
                    return Ok(Finding::skipped(Step::Switches, "Skipped by the operator."));
                };
                let now = self.link.switches()?;
                let others = Switch::ALL
                    .iter()
                    .any(|&it| it != switch && it.is_open(now));
                self.operator.hand(close)?;
                let Some(closed) = self.wait_for(switch, false)? else {
                    return Ok(Finding::skipped(Step::Switches, "Skipped by the operator."));
                };
                let name = switch.name();
                let what = match (opened, closed) {
                    (true, false) => format!("{name}: open {when}, and closed again"),
                    _ => format!("{name}: open {when}"),
                };
                measured.push(Measurement::flag(what, opened && closed));
                if others {
                    let name = format!("{name}: no other opens with it");
                    measured.push(Measurement::flag(name, false));
                }
            }
        }
        Ok(Finding::judge(
            Step::Switches,
            measured,
            "Each opens alone, pressed and without its wire.",
        ))
    }

    fn homing(&mut self) -> anyhow::Result<Finding> {
        let settings = self.settings()?;
        let per_step = f64::from(settings.number(Key::VolumePerStep));
        let look_steps = LOOK.0 * LOOK.1 * f64::from(settings.number(Key::MaxFlow)) / per_step;
        let within = (HOME_STEPS + look_steps).round();
        self.operator.progress(0.0, 2.0, "homing");
        let first_s = self.arm()?;
        self.disarm()?;
        self.operator.progress(1.0, 2.0, "homing again");
        let second_s = self.arm()?;
        let machine = self.link.machine()?;
        let steps = machine.lost_steps.map_or(f64::NAN, f64::from);
        let mut measured = vec![
            Measurement::new("first homing", first_s, "s", Limit::AtMost(60.0)),
            Measurement::new("second homing", second_s, "s", Limit::AtMost(60.0)),
            Measurement::new(
                "shift of the second home",
                steps,
                "microsteps",
                Limit::Within(-within, within),
            ),
        ];
        // The board refuses what is later than its speed allows; firmware from before measures nothing.
        if let (Some(delay_ms), Some(air_ul)) = (machine.delay_ms, machine.air_ul) {
            let (delay, air) = (f64::from(delay_ms), f64::from(air_ul) / 1000.0);
            measured.push(Measurement::new(
                "pressure sensor's delay, with the vent's",
                delay,
                "ms",
                Limit::None,
            ));
            measured.push(Measurement::new(
                "air behind the plunger",
                air,
                "ml",
                Limit::None,
            ));
        }
        Ok(Finding::judge(
            Step::Homing,
            measured,
            "The switch was found twice at the same place.",
        ))
    }

    fn stroke(&mut self) -> anyhow::Result<Finding> {
        let settings = self.settings()?;
        let per_step = f64::from(settings.number(Key::VolumePerStep));
        let largest_ml = f64::from(settings.number(Key::MaxVolume)) / 1000.0;
        let mut found = Vec::new();
        let mut seconds = 0.0;
        for (done, what) in [(0.0, "measuring the stroke"), (1.0, "measuring it again")] {
            self.operator.progress(done, 2.0, what);
            seconds += self.measure_stroke()?;
            let steps = self.link.machine()?.stroke_steps;
            found.push(steps.map_or(f64::NAN, f64::from));
            self.disarm()?;
        }
        let [first, second] = found[..] else {
            anyhow::bail!("the stroke was not measured twice");
        };
        let stroke_ml = second * per_step / 1000.0;
        let measured = vec![
            Measurement::new("stroke", first, "microsteps", Limit::AtLeast(1.0)),
            Measurement::new(
                "change of the second stroke",
                second - first,
                "microsteps",
                Limit::Within(-STROKE_STEPS, STROKE_STEPS),
            ),
            Measurement::new(
                "largest volume, max.ul",
                largest_ml,
                "ml",
                Limit::AtMost(stroke_ml),
            ),
            Measurement::new("time for both", seconds, "s", Limit::None),
        ];
        let said = format!("{stroke_ml:.1} ml between the switches, and the board keeps it.");
        Ok(Finding::judge(Step::Stroke, measured, said))
    }

    fn emergency_stop(&mut self) -> anyhow::Result<Finding> {
        let per_step = f64::from(self.settings()?.number(Key::VolumePerStep));
        self.arm()?;
        let highest_kpa = self.highest_kpa();
        self.play(&SLOW_RUN.map(|(level_kpa, duration_ms)| Segment::Ramp {
            mode: ControlMode::Pressure,
            level: hundredths(level_kpa.min(highest_kpa)),
            duration_ms,
        }))?;
        let moves = |state| matches!(state, Some(State::Ready | State::Running));
        self.until(ASKED_S, |session| Ok(!moves(session.state())))?;
        if let Some(sample) = self.link.last().filter(|it| it.state == State::Fault) {
            return Err(self.link.faulted(sample.fault).into());
        }
        self.operator.hand(Hand::Press(Switch::EmergencyStop))?;
        let [_, (_, most_ms)] = SLOW_RUN;
        self.until(f64::from(most_ms) / 1000.0, |session| {
            Ok(matches!(session.state(), Some(State::Fault | State::Ready)))
        })?;
        let code = self.link.last().map_or(0, |sample| sample.fault);
        self.pass(3.0)?;
        let mut measured = vec![Measurement::flag(
            match Fault::from_code(code) {
                Some(fault) => format!("the board stopped for it ({})", fault.name()),
                None => "the board stopped for it".to_owned(),
            },
            code == Fault::EmergencyStop.code(),
        )];
        if let Some(stop) = Stop::of(&self.samples) {
            measured.extend(stop.measure(per_step));
        }
        if self.state() != Some(State::Fault) {
            self.request(Command::Stop)?;
        }
        let drawn = curves(&self.samples);
        self.operator
            .ask("Is the 12 V gone: the driver's light off, and the motor free to turn by hand?")?;
        let gone = self.answered()? == Answer::Yes;
        measured.push(Measurement::flag(
            "the 12 V are gone, as seen at the rig",
            gone,
        ));
        self.operator.hand(Hand::Release(Switch::EmergencyStop))?;
        self.wait_for(Switch::EmergencyStop, false)?;
        Ok(Finding::judge(
            Step::EmergencyStop,
            measured,
            "Pump off, vent open, 12 V gone.",
        )
        .with_curves(drawn))
    }

    fn pressure(&mut self) -> anyhow::Result<Finding> {
        let (held_kpa, share) = HELD_KPA;
        self.settings()?;
        let level_kpa = held_kpa.min(share * self.highest_kpa()).round();
        let [pump_ms, hold_ms, release_ms] = HELD_MS;
        self.arm()?;
        self.pass(1.0)?;
        self.play(&[
            Segment::Step {
                mode: ControlMode::Pressure,
                level: hundredths(level_kpa),
                duration_ms: pump_ms,
            },
            Segment::Hold {
                duration_ms: hold_ms,
            },
            Segment::Release {
                duration_ms: release_ms,
            },
        ])?;
        let total_s = f64::from(pump_ms + hold_ms + release_ms) / 1000.0;
        let mut began = None;
        let ended = self.until(3.0 * total_s + 20.0, |session| {
            let now_s = session.now_s();
            match session.state() {
                Some(State::Running) => {
                    let began_s = *began.get_or_insert(now_s);
                    session
                        .operator
                        .progress(now_s - began_s, total_s, "pressure");
                    Ok(false)
                }
                state => Ok(state == Some(State::Fault) || began.is_some()),
            }
        })?;
        self.pass(1.0)?;
        let seconds = |ms: u32| f64::from(ms) / 1000.0;
        let hold = Hold::of(
            &self.samples,
            level_kpa,
            seconds(pump_ms),
            seconds(pump_ms + hold_ms),
        );
        let fault = self.link.last().and_then(|it| Fault::from_code(it.fault));
        let mut measured = vec![Measurement::flag(
            match fault {
                Some(fault) => format!(
                    "the run came to its end (fault {}, {})",
                    fault.code(),
                    fault.name()
                ),
                None => "the run came to its end".to_owned(),
            },
            ended && fault.is_none(),
        )];
        measured.extend(hold.measure());
        if let Some(fault) = fault {
            let why = format!("Cut off: {}", latched(fault));
            let cut = Finding::failed(Step::Pressure, why, measured);
            return Ok(cut.with_curves(curves(&self.samples)));
        }
        Ok(Finding::judge(
            Step::Pressure,
            measured,
            "Tight, vented, and the actuator bends.",
        )
        .with_curves(curves(&self.samples)))
    }

    fn relief(&mut self) -> anyhow::Result<Finding> {
        self.operator.ask(
            "12 V off. Pinch the tube to the actuator, and the one between relief valve and vent; push the syringe in by hand. Does the relief valve open before the actuator's limit?",
        )?;
        let opened = self.answered()? == Answer::Yes;
        let highest = self
            .samples
            .iter()
            .filter_map(|it| it.sample.pressure_kpa)
            .map(|it| f64::from(it.to_f32()))
            .fold(f64::NAN, f64::max);
        let measured = vec![
            Measurement::flag("the relief valve opened, as heard at the rig", opened),
            Measurement::new(
                "highest pressure at the sensor",
                highest,
                "kPa",
                Limit::None,
            ),
        ];
        Ok(Finding::judge(Step::Relief, measured, "It opens."))
    }

    // ------------------------------------------------------------- the board

    /// Telemetry while nothing happens: watched once, for several steps.
    fn watch(&mut self) -> anyhow::Result<&Watched> {
        if self.watched.is_none() {
            let before = self.link.counters();
            // What is left of the boot or the self-test is no part of it.
            self.pass(1.0)?;
            self.samples.clear();
            let total_s = self.plan.watch_s;
            let begun = self.now_s();
            let mut passed_s = 0.0;
            let mut last_s = begun;
            while passed_s < total_s {
                self.pump()?;
                let now_s = self.now_s();
                // A restart begins at zero.
                passed_s += (now_s - last_s).max(0.0);
                last_s = now_s;
                self.operator
                    .progress(passed_s, total_s, "watching, nothing moves");
            }
            let free = self.remarks.iter().rev().find_map(|text| {
                let mut words = text.strip_prefix("free ")?.split(' ');
                words.next()?.parse().ok()
            });
            self.watched = Some(Watched {
                samples: self.samples.clone(),
                counters: since(self.link.counters(), before),
                free_bytes: free,
            });
        }
        self.watched
            .as_ref()
            .ok_or_else(|| anyhow::anyhow!("nothing was watched"))
    }

    /// Whether the board's time passes as ours does: always, but in a simulation.
    fn is_in_real_time(&self) -> bool {
        let rate = self.watched.as_ref().and_then(|it| rate(&it.samples));
        let rate = rate.filter(|_| !self.plan.at_full_speed);
        !self.is_simulated || rate.is_some_and(|it| (it.factor - 1.0).abs() < FARTHEST_RATE)
    }

    fn settings(&mut self) -> anyhow::Result<&Settings> {
        if !self.has_settings {
            let operator = &mut self.operator;
            self.settings = self.link.read_settings(|done, total| {
                operator.progress(done as f64, total as f64, "reading the settings");
            })?;
            self.link.learn_patience()?;
            self.has_settings = true;
        }
        Ok(&self.settings)
    }

    /// The highest pressure (kPa) that may be asked for.
    fn highest_kpa(&self) -> f64 {
        f64::from(self.settings.number(Key::SetpointMaxPressure))
    }

    fn state(&self) -> Option<State> {
        self.link.last().map(|sample| sample.state)
    }

    /// The board's time (s).
    fn now_s(&self) -> f64 {
        self.link
            .last()
            .map_or(0.0, |sample| f64::from(sample.time_ms) / 1000.0)
    }

    fn status(&mut self) -> Result<wire::answer::Status, LinkError> {
        self.link.status()
    }

    fn request(&mut self, command: Command) -> Result<String, LinkError> {
        let mut events = Vec::new();
        let reply = self
            .link
            .request_with(command, &mut |event| events.push(event));
        for event in events {
            self.take(event);
        }
        reply
    }

    fn take(&mut self, event: Event) {
        self.heard = Instant::now();
        match event {
            Event::Sample(received) => self.samples.push(received),
            Event::Remark(text) => self.remarks.push(text),
            Event::Other(text) => self.others.push(text),
            Event::Useless | Event::Lost(_) => {}
        }
    }

    /// Takes what comes in a short time.
    fn pump(&mut self) -> anyhow::Result<()> {
        self.operator.check()?;
        self.stay_fast()?;
        match self.link.next_event(Duration::from_millis(20)) {
            Some(event) => {
                self.take(event);
                // What has come already costs no wait.
                while let Some(event) = self.link.next_event(Duration::ZERO) {
                    self.take(event);
                }
            }
            None if !self.link.is_connected() => self.reconnect()?,
            None if self.heard.elapsed() > SILENT => {
                self.lost = Some("The board fell silent.".to_owned());
                return Err(self
                    .link
                    .late(
                        "no line came for 5 s",
                        "check the cable and the board's power",
                    )
                    .into());
            }
            None => {}
        }
        Ok(())
    }

    /// A simulator at full speed waits for a client that is silent for a second of its time.
    fn stay_fast(&mut self) -> anyhow::Result<()> {
        const OFTEN_S: f64 = 0.5;
        let now_s = self.now_s();
        if self.plan.at_full_speed && (now_s - self.told_s).abs() > OFTEN_S {
            self.told_s = now_s;
            self.request(Command::Beat)?;
        }
        Ok(())
    }

    fn reconnect(&mut self) -> anyhow::Result<()> {
        let until = Instant::now() + RECONNECT;
        while Instant::now() < until {
            if self.link.reconnect().is_ok() {
                self.heard = Instant::now();
                return Ok(());
            }
            sleep(Duration::from_millis(200));
        }
        self.lost = Some("The connection was lost and did not come back.".to_owned());
        Err(self
            .link
            .late(
                "the connection was lost",
                "check the cable and the board's power",
            )
            .into())
    }

    /// Waits by the board's clock until something holds; whether it does.
    fn until(
        &mut self,
        seconds: f64,
        mut holds: impl FnMut(&mut Self) -> anyhow::Result<bool>,
    ) -> anyhow::Result<bool> {
        let (mut passed_s, mut last_s) = (0.0, self.now_s());
        self.heard = Instant::now();
        loop {
            if holds(self)? {
                return Ok(true);
            }
            if passed_s >= seconds {
                return Ok(false);
            }
            self.pump()?;
            let now_s = self.now_s();
            passed_s += (now_s - last_s).max(0.0);
            last_s = now_s;
        }
    }

    /// Lets time pass, by the board's clock (s).
    fn pass(&mut self, seconds: f64) -> anyhow::Result<()> {
        self.until(seconds, |_| Ok(false)).map(drop)
    }

    /// Homes; how long it took, by the board's clock (s).
    fn arm(&mut self) -> anyhow::Result<f64> {
        self.home(Link::arm)
    }

    /// Measures the stroke; how long it took, by the board's clock (s).
    fn measure_stroke(&mut self) -> anyhow::Result<f64> {
        self.home(Link::measure_stroke)
    }

    fn home(&mut self, how: Homing) -> anyhow::Result<f64> {
        let mut events = Vec::new();
        let mut stopped = None;
        let Self { link, operator, .. } = self;
        let armed = how(link, &mut |event| {
            events.push(event);
            stopped = operator.check().err();
            stopped.is_none()
        });
        let times: Vec<f64> = events
            .iter()
            .filter_map(|event| match event {
                Event::Sample(it) => Some(f64::from(it.sample.time_ms) / 1000.0),
                _ => None,
            })
            .collect();
        for event in events {
            self.take(event);
        }
        if let Some(error) = stopped {
            return Err(error);
        }
        armed?;
        Ok(match (times.first(), times.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        })
    }

    fn disarm(&mut self) -> anyhow::Result<()> {
        self.request(Command::Disarm)?;
        self.until(5.0, |session| Ok(session.state() == Some(State::Idle)))?;
        self.pass(1.0)
    }

    /// Loads a protocol and starts it.
    fn play(&mut self, segments: &[Segment]) -> anyhow::Result<()> {
        // A handful.
        let count = u8::try_from(segments.len()).unwrap_or(u8::MAX);
        self.request(Command::Load(count))?;
        for (index, &segment) in (0..count).zip(segments) {
            self.request(Command::Segment { index, segment })?;
        }
        self.request(Command::Run(None))?;
        Ok(())
    }

    /// Waits until a switch is open or closed: whether it came to that, or nothing if the operator
    /// skips.
    fn wait_for(&mut self, switch: Switch, open: bool) -> anyhow::Result<Option<bool>> {
        let patience = if self.is_simulated {
            VIRTUAL_PATIENCE
        } else {
            PATIENCE
        };
        let until = Instant::now() + patience;
        while Instant::now() < until {
            if switch.is_open(self.link.switches()?) == open {
                return Ok(Some(true));
            }
            if self.operator.answer()? == Some(Answer::Skip) {
                return Ok(None);
            }
            self.heard = Instant::now();
            self.pump()?;
        }
        Ok(Some(false))
    }

    /// Waits for what was asked to be answered.
    fn answered(&mut self) -> anyhow::Result<Answer> {
        loop {
            if let Some(answer) = self.operator.answer()? {
                return Ok(answer);
            }
            self.pump()?;
        }
    }

    /// After a step: at rest, and what was latched cleared if its cause is gone.
    fn settle(&mut self) -> anyhow::Result<()> {
        if self.lost.is_some() || !self.link.is_connected() {
            return Ok(());
        }
        if !matches!(self.state(), Some(State::Idle | State::Fault) | None) {
            // What follows says so if it was not obeyed.
            let _ = self.request(Command::Stop);
            self.pass(0.5)?;
        }
        if self.status().is_ok_and(|status| status.fault.is_some()) {
            let _ = self.request(Command::Clear);
            self.pass(0.2)?;
        }
        Ok(())
    }

    /// Leaves the rig stopped and vented.
    fn leave(&mut self) {
        if self.link.is_connected() && self.link.request(Command::Stop).is_err() {
            self.operator
                .warn("the board could not be told to stop; it stops by itself within seconds");
        }
    }
}

fn latched(fault: Fault) -> String {
    format!(
        "fault {} ({}) is latched. {}",
        fault.code(),
        fault.name(),
        fault.sentence()
    )
}

fn limit_of(settings: &Settings, key: Key, name: &str, unit: &'static str) -> Measurement {
    Measurement::new(name, f64::from(settings.number(key)), unit, Limit::None)
}

fn hundredths(value: f64) -> Hundredths {
    #[allow(clippy::cast_possible_truncation)] // At most some hundred.
    let value = (value * 100.0).round() as i32;
    Hundredths(value)
}

fn since(now: Counters, before: Counters) -> Counters {
    Counters {
        samples: now.samples - before.samples,
        dropped: now.dropped - before.dropped,
        damaged: now.damaged - before.damaged,
        unknown: now.unknown - before.unknown,
        restarts: now.restarts - before.restarts,
        lost: now.lost - before.lost,
    }
}

fn decibels(spectrum: &[(f64, f64)]) -> Vec<(f64, f64)> {
    spectrum
        .iter()
        .filter(|(_, height)| *height > 0.0)
        .map(|&(hertz, height)| (hertz, 10.0 * height.log10()))
        .collect()
}

/// With a capital letter and a full stop.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|it| it.to_uppercase().to_string());
    let text = first.unwrap_or_default() + letters.as_str();
    if text.ends_with('.') {
        text
    } else {
        text + "."
    }
}
