//! What the page does with a board: flash it, check it, record, upload, and show the gap.
//!
//! The sessions are those of `softrig_link`, which the command uses too. What the page has in place
//! of a computer's port, disk and terminal is [`Outside`].

use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::Deserialize;
use serde_json::{Value, json};
use softrig::diagnose::decide::verdict::zeros_in;
use softrig_formats::error::InputError;
use softrig_formats::model_file::ModelFile;
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::settings_file::{changes, changes_text, from_model};
use softrig_formats::setup::Setup;
use softrig_link::calibrate::{Operator as Bender, Plan as Calibration, calibrate, check_angles};
use softrig_link::commission::session::{
    Answer, Hand, Interrupted, Operator, Plan as Test, Session,
};
use softrig_link::commission::{Outcome, Result as Finding, Step};
use softrig_link::flash::{self, Image, Stage};
use softrig_link::record::session::{Attendant, Plan, record};
use softrig_link::record::{LoggedSample, Shelf};
use softrig_link::rig_file::ClockRate;
use softrig_link::usb::BOARDS;
use softrig_link::{Connector, Link, Timing};
use wire::decimal::Hundredths;
use wire::protocol::Named;
use wire::telemetry::Setpoint;

/// How long a pulled cable is waited for.
const PATIENCE: Duration = Duration::from_secs(30);

/// How often a sample is drawn (ms of the board's time): thirty a second.
const DRAWN_EVERY_MS: i64 = 30;

/// Steps of the acceptance test that need no second person at the rig.
const STEPS: [Step; 8] = [
    Step::Identity,
    Step::SelfTest,
    Step::Telemetry,
    Step::Clock,
    Step::Noise,
    Step::Homing,
    Step::Stroke,
    Step::Pressure,
];

/// What a page has of the world: a port, a place for files, and somebody who looks.
pub trait Outside {
    /// The port that was chosen.
    fn connector(&self) -> Box<dyn Connector>;

    /// Where recordings are kept.
    fn shelf(&self) -> Box<dyn Shelf>;

    /// Shows something at once: a stage, samples, a finding.
    fn shows(&self, said: &Value);

    /// Whether somebody has pressed the stop.
    fn has_enough(&self) -> bool;

    /// Whether somebody has said that it is done, since this was asked last.
    fn is_ready(&self) -> bool;

    /// This moment (RFC 3339, UTC).
    fn now(&self) -> String;
}

/// What is asked of a board.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// Writes the firmware: the text of an image, whose bytes come with the question.
    Flash,
    /// The steps of the acceptance test that need no second person.
    Check {
        /// How long telemetry is watched (s).
        seconds: f64,
        /// Whether those that move something are among them.
        moving: bool,
    },
    /// Calibrates the sensors, with somebody who bends the actuator.
    Calibrate {
        /// Angles to bend to (°).
        points: Vec<f32>,
        /// Whether limits that the table does not reach are lowered.
        lower_limits: bool,
    },
    /// Plays a protocol and records.
    Record {
        /// The name of the recording.
        name: String,
        /// Name of a protocol, or the text of its file.
        protocol: String,
        /// Seconds in one of the board's, where `Check` measured it.
        clock_factor: Option<f64>,
        /// Whether a latched fault is cleared first, if its cause is gone.
        clear: bool,
    },
    /// Writes a model into the board.
    Upload {
        /// The text of its file.
        model: String,
        /// The verdict whose zeros of the sensors correct the calibration.
        verdict: Option<String>,
    },
}

/// The protocols that every board knows.
pub fn protocols() -> Value {
    let known = Named::ALL.iter().map(|&named| {
        let protocol = ProtocolFile::named(named);
        json!({
            "name": protocol.name,
            "title": protocol.title,
            "seconds": f64::from(protocol.total_ms()) / 1000.0,
        })
    });
    known.collect()
}

/// The USB chips behind which a board may be: vendor and product.
pub fn boards() -> Value {
    let chips = BOARDS.iter().flat_map(|(vendor, products)| {
        products.iter().map(move |product| json!([vendor, product]))
    });
    chips.collect()
}

/// Does what is asked; `bytes` are those of the file that comes with it.
///
/// # Errors
///
/// What the session says, with what to do.
pub fn answer(request: Request, bytes: &[u8], outside: &dyn Outside) -> anyhow::Result<Value> {
    match request {
        Request::Flash => written(bytes, outside),
        Request::Check { seconds, moving } => checked(seconds, moving, outside),
        Request::Calibrate {
            points,
            lower_limits,
        } => calibrated(points, lower_limits, outside),
        Request::Record {
            name,
            protocol,
            clock_factor,
            clear,
        } => {
            let plan = Plan {
                output: name.into(),
                clear,
                clock_factor,
                ..plan_of(&protocol, outside.now())?
            };
            recorded(&plan, outside)
        }
        Request::Upload { model, verdict } => uploaded(&model, verdict.as_deref(), outside),
    }
}

fn stage(outside: &dyn Outside, text: &str, share: Option<f64>) {
    outside.shows(&json!({ "stage": text, "share": share }));
}

fn written(image: &[u8], outside: &dyn Outside) -> anyhow::Result<Value> {
    let image = Image::of(image)?;
    let board = flash::flash(outside.connector(), &image, |now| match now {
        Stage::Searching => stage(outside, "waiting for the bootloader", None),
        Stage::Writing(done, total) => stage(
            outside,
            "writing: do not pull the cable",
            Some(done as f64 / total as f64),
        ),
        Stage::Starting => stage(outside, "waiting for the board, which starts it", None),
    })?;
    Ok(json!({
        "sentence": format!(
            "{} bytes written; the board is softrig {} and has the same checksum, {:04x}.",
            image.len(),
            board.firmware,
            image.checksum()
        ),
    }))
}

/// What is played: a protocol by its name, or by the text of its file.
fn plan_of(protocol: &str, started: String) -> Result<Plan, InputError> {
    let mut named = Named::ALL.iter().map(|&named| ProtocolFile::named(named));
    let protocol = match named.find(|it| it.name == protocol) {
        Some(protocol) => protocol,
        None => ProtocolFile::parse(protocol, Path::new("next.toml"))?,
    };
    Ok(Plan {
        output: PathBuf::new(),
        setup: Some(protocol.setup.clone()).filter(|it| *it != Setup::default()),
        protocol: Some(protocol),
        seconds: None,
        split: false,
        clear: false,
        patience: PATIENCE,
        clock_factor: None,
        started,
    })
}

fn recorded(plan: &Plan, outside: &dyn Outside) -> anyhow::Result<Value> {
    let mut visitor = Visitor {
        outside,
        drawn_ms: i64::MIN,
        played: (String::new(), i64::MIN),
    };
    let recorded = record(outside.connector(), plan, outside.shelf(), &mut visitor)?;
    Ok(json!({ "sentence": recorded.text }))
}

/// Who looks at the page while a rig is recorded.
struct Visitor<'o> {
    outside: &'o dyn Outside,
    /// Time of the last sample that was drawn (ms).
    drawn_ms: i64,
    /// What was said last to be played, and when (ms).
    played: (String, i64),
}

impl Attendant for Visitor<'_> {
    fn waits(&mut self, now: &'static str) {
        stage(self.outside, now, None);
    }

    fn plays(&mut self, now: &str, passed_ms: i64, total_ms: i64) {
        let (said, at_ms) = &self.played;
        if said == now && passed_ms < at_ms.saturating_add(DRAWN_EVERY_MS) {
            return;
        }
        self.played = (now.to_owned(), passed_ms);
        let share = passed_ms as f64 / total_ms.max(1) as f64;
        let left_s = (total_ms - passed_ms).max(0) as f64 / 1000.0;
        let text = format!("{now}, {left_s:.0} s left");
        stage(self.outside, &text, Some(share.min(1.0)));
    }

    fn sees(&mut self, row: &LoggedSample) {
        if row.time_ms < self.drawn_ms.saturating_add(DRAWN_EVERY_MS) {
            return;
        }
        self.drawn_ms = row.time_ms;
        let sample = &row.sample;
        let number = |value: Option<Hundredths>| value.map(|it| f64::from(it.to_f32()));
        let asked = match sample.setpoint {
            Setpoint::Angle(level) => Some(f64::from(level.to_f32())),
            Setpoint::None | Setpoint::Pressure(_) => None,
        };
        self.outside.shows(&json!({
            "time_s": row.time_ms as f64 / 1000.0,
            "pressure_kpa": number(sample.pressure_kpa),
            "angle_deg": number(sample.angle_deg),
            "predicted_deg": number(sample.predicted_deg),
            "setpoint_deg": asked,
            "state": sample.state.name(),
        }));
    }

    fn warns(&mut self, text: &str) {
        self.outside.shows(&json!({ "remark": text }));
    }

    fn has_enough(&self) -> bool {
        self.outside.has_enough()
    }
}

fn checked(seconds: f64, moving: bool, outside: &dyn Outside) -> anyhow::Result<Value> {
    stage(outside, "waiting for the board, which restarts", None);
    let link = Link::open(outside.connector(), Timing::default())?;
    let mut operator = Alone { outside };
    let plan = Test {
        steps: STEPS
            .into_iter()
            .filter(|step| moving || step.moves().is_none())
            .collect(),
        watch_s: seconds,
        at_full_speed: false,
    };
    let mut session = Session::new(link, &mut operator, plan);
    let findings = session.run()?;
    let made: Vec<&Finding> = findings
        .iter()
        .filter(|it| it.outcome != Outcome::Skipped)
        .collect();
    let failed: Vec<&str> = made
        .iter()
        .filter(|it| it.outcome == Outcome::Failed)
        .map(|it| it.title)
        .collect();
    let sentence = if failed.is_empty() {
        format!("{} steps made, none failed.", made.len())
    } else {
        format!("Failed: {}.", failed.join(", "))
    };
    Ok(json!({
        "sentence": sentence,
        "steps": findings,
        "clock_factor": session.clock.map(|rate| rate.factor),
    }))
}

/// Somebody at the page, who has agreed to everything by pressing the button, and presses no switch.
struct Alone<'o> {
    outside: &'o dyn Outside,
}

impl Operator for Alone<'_> {
    fn begin(&mut self, step: Step, number: usize, of: usize) -> anyhow::Result<()> {
        let text = format!("{number} of {of}: {}", step.title());
        self.outside
            .shows(&json!({ "stage": text, "purpose": step.purpose(), "moves": step.moves() }));
        Ok(())
    }

    fn agrees(&mut self, _: Step) -> anyhow::Result<()> {
        Ok(())
    }

    fn check(&mut self) -> anyhow::Result<()> {
        if self.outside.has_enough() {
            return Err(Interrupted.into());
        }
        Ok(())
    }

    fn progress(&mut self, passed: f64, total: f64, what: &str) {
        stage(self.outside, what, Some((passed / total).clamp(0.0, 1.0)));
    }

    fn ended(&mut self, finding: &Finding) {
        self.outside.shows(&json!({ "finding": finding }));
    }

    fn has_hands(&self) -> bool {
        false
    }

    fn hand(&mut self, _: Hand) -> anyhow::Result<()> {
        Ok(())
    }

    fn ask(&mut self, _: &str) -> anyhow::Result<()> {
        Ok(())
    }

    fn answer(&mut self) -> anyhow::Result<Option<Answer>> {
        self.check()?;
        Ok(Some(Answer::Yes))
    }

    fn keep_clock(&mut self, rate: ClockRate) -> anyhow::Result<String> {
        Ok(format!(
            "Recordings of this page are corrected by the factor {:.5}.",
            rate.factor
        ))
    }

    fn warn(&mut self, text: &str) {
        self.outside.shows(&json!({ "remark": text }));
    }
}

fn calibrated(
    points: Vec<f32>,
    lower_limits: bool,
    outside: &dyn Outside,
) -> anyhow::Result<Value> {
    check_angles(&points)?;
    stage(outside, "waiting for the board, which restarts", None);
    let mut link = Link::open(outside.connector(), Timing::default())?;
    let plan = Calibration {
        points,
        assumed: None,
        lower_limits,
        dry_run: false,
    };
    let mut hand = Hands {
        outside,
        table: String::new(),
    };
    let sentence = calibrate(&mut link, plan, &mut hand)?;
    Ok(json!({ "sentence": sentence, "table": hand.table }))
}

/// Somebody who bends the actuator.
struct Hands<'o> {
    outside: &'o dyn Outside,
    table: String,
}

impl Bender for Hands<'_> {
    fn asks(&mut self, what: &str) {
        // What was said before is no answer to it.
        self.outside.is_ready();
        self.outside.shows(&json!({ "ask": what }));
    }

    fn sees(&mut self, counts: Option<f32>) {
        let now = match counts {
            Some(counts) => format!("{counts:.1} counts"),
            None => "averaging, hold still".to_owned(),
        };
        self.outside.shows(&json!({ "now": now }));
    }

    fn says(&mut self, text: &str) {
        self.outside.shows(&json!({ "note": text }));
    }

    fn warns(&mut self, text: &str) {
        self.outside.shows(&json!({ "remark": text }));
    }

    fn shows(&mut self, table: &str) -> anyhow::Result<()> {
        table.clone_into(&mut self.table);
        Ok(())
    }

    fn is_ready(&mut self) -> anyhow::Result<bool> {
        self.may_go_on()?;
        Ok(self.outside.is_ready())
    }

    fn may_go_on(&self) -> anyhow::Result<()> {
        if self.outside.has_enough() {
            anyhow::bail!("ended by the operator; nothing was changed");
        }
        Ok(())
    }
}

fn uploaded(model: &str, verdict: Option<&str>, outside: &dyn Outside) -> anyhow::Result<Value> {
    let file = ModelFile::parse(model, Path::new("model.toml"))?;
    let mut wanted = from_model(&file)?;
    let zeros = verdict.map(|text| zeros_in(text, Path::new("verdict.json")));
    stage(outside, "waiting for the board, which restarts", None);
    let mut link = Link::open(outside.connector(), Timing::default())?;
    let share = |done: u64, total: u64| Some(done as f64 / total as f64);
    let settings = link.read_settings(|done, total| {
        stage(outside, "reading the board's settings", share(done, total));
    })?;
    if let Some(zeros) = zeros.transpose()? {
        wanted.extend(zeros.taken_from(&settings, &wanted)?);
    }
    let changes = changes(&settings, wanted);
    let table = changes_text(&settings, &changes);
    if !changes.is_empty() {
        link.change_settings(&changes, |done, total| {
            stage(outside, "writing the settings", share(done, total));
        })?;
    }
    let sentence = match changes.len() {
        0 => "The board has this model already.".to_owned(),
        count => format!("{count} settings written, stored and read back."),
    };
    Ok(json!({ "sentence": sentence, "table": table }))
}
