//! `softrig monitor`: the last half minute of a rig, and its state.
//!
//! [`View`] collects the data, and [`draw`] only draws it, so that screens can be tested
//! without a terminal.

mod screen;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use wire::decimal::Hundredths;
use wire::fault::Fault;
use wire::protocol::Named;
use wire::state::State;
use wire::telemetry::{Setpoint, Telemetry};

pub use screen::draw;

use softrig_formats::terminal::printable_line;
use softrig_link::{Clock, Counters, Event};

/// How far back the chart goes (s).
pub const SPAN_S: f64 = 30.0;

/// Telemetry that is this old no longer counts for the rate.
const RATE_WINDOW: Duration = Duration::from_secs(1);

/// A curve of the charts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trace {
    /// The bending angle that the flex sensor shows.
    Measured,
    /// The angle that the board's model predicts.
    Predicted,
    /// The set-point of the protocol, an angle or a pressure.
    Setpoint,
    /// The pressure.
    Pressure,
}

impl Trace {
    /// Every one, in the order of their keys.
    pub const ALL: [Self; 4] = [
        Self::Measured,
        Self::Predicted,
        Self::Setpoint,
        Self::Pressure,
    ];

    /// The key that shows or hides it.
    pub const fn key(self) -> char {
        match self {
            Self::Measured => '1',
            Self::Predicted => '2',
            Self::Setpoint => '3',
            Self::Pressure => '4',
        }
    }

    /// The curve behind a key.
    pub fn of_key(key: char) -> Option<Self> {
        Self::ALL.into_iter().find(|trace| trace.key() == key)
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Predicted => "predicted",
            Self::Setpoint => "set-point",
            Self::Pressure => "pressure",
        }
    }
}

/// A moment in the charts (° and kPa).
#[derive(Clone, Copy, Debug, PartialEq)]
struct Moment {
    time_s: f64,
    angle: Option<f64>,
    predicted: Option<f64>,
    pressure: Option<f64>,
    setpoint: Setpoint,
}

/// How well the model agrees with the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Agreement {
    /// Prediction and measurement disagreed for too long.
    Mismatch,
    /// There is nothing to compare.
    Unknown,
    /// The board compares during a run alone: at rest an actuator may be bent by hand.
    NoRun,
    /// They agree in this run so far.
    Agrees,
}

/// Everything that is shown.
#[derive(Clone, Debug)]
pub struct View {
    port: String,
    firmware: String,
    clock: Clock,
    history: VecDeque<Moment>,
    hidden: Vec<Trace>,
    arrivals: VecDeque<Instant>,
    now: Instant,
    last: Option<Telemetry>,
    counters: Counters,
    connected: bool,
    paused: bool,
    asking: bool,
    message: String,
}

impl View {
    /// A view of the board at a port, before anything has come.
    pub fn new(port: &str, firmware: &str) -> Self {
        Self {
            port: printable_line(port).into_owned(),
            firmware: printable_line(firmware).into_owned(),
            clock: Clock::default(),
            history: VecDeque::new(),
            hidden: Vec::new(),
            arrivals: VecDeque::new(),
            now: Instant::now(),
            last: None,
            counters: Counters::default(),
            connected: true,
            paused: false,
            asking: false,
            message: String::new(),
        }
    }

    /// Takes what happened on the link.
    pub fn take(&mut self, event: &Event) {
        match event {
            Event::Sample(received) => {
                self.connected = true;
                self.arrivals.push_back(received.arrived);
                let Some(placed) = self.clock.place(received) else {
                    return;
                };
                // Paused, the picture stands still; the state does not.
                self.last = Some(received.sample);
                if self.paused {
                    return;
                }
                let number =
                    |value: Option<Hundredths>| value.map(|value| f64::from(value.0) / 100.0);
                let time_s = placed.time_ms as f64 / 1000.0;
                self.history.push_back(Moment {
                    time_s,
                    angle: number(received.sample.angle_deg),
                    predicted: number(received.sample.predicted_deg),
                    pressure: number(received.sample.pressure_kpa),
                    setpoint: received.sample.setpoint,
                });
                while self
                    .history
                    .front()
                    .is_some_and(|moment| moment.time_s < time_s - SPAN_S)
                {
                    self.history.pop_front();
                }
            }
            Event::Remark(text) => self.say(text),
            Event::Lost(reason) => {
                self.connected = false;
                self.say(&format!(
                    "the connection was lost ({reason}): check the cable; the monitor reconnects by itself"
                ));
            }
            Event::Other(_) | Event::Useless => {}
        }
    }

    /// Takes over what the link counted, and the time.
    pub fn refresh(&mut self, counters: Counters, now: Instant) {
        self.counters = counters;
        self.now = now;
        while self
            .arrivals
            .front()
            .is_some_and(|&arrived| now.saturating_duration_since(arrived) > RATE_WINDOW)
        {
            self.arrivals.pop_front();
        }
    }

    /// Shows a sentence in the last line but one.
    pub fn say(&mut self, message: &str) {
        self.message = printable_line(message).into_owned();
    }

    /// Stops the picture, or lets it go on.
    pub fn toggle_pause(&mut self) {
        self.paused = !self.paused;
        if !self.paused {
            // The time that was not drawn would be a straight line.
            self.history.clear();
        }
    }

    /// Shows a curve, or hides it.
    pub fn toggle(&mut self, trace: Trace) {
        let before = self.hidden.len();
        self.hidden.retain(|&hidden| hidden != trace);
        if self.hidden.len() == before {
            self.hidden.push(trace);
        }
    }

    /// Whether a curve is shown.
    fn shows(&self, trace: Trace) -> bool {
        !self.hidden.contains(&trace)
    }

    /// The model's agreement at the moment; unknown with an open sensor.
    fn agreement(&self) -> Agreement {
        let Some(sample) = self.last else {
            return Agreement::Unknown;
        };
        let has_all = sample.pressure_kpa.is_some()
            && sample.angle_deg.is_some()
            && sample.predicted_deg.is_some();
        if sample.mismatch {
            Agreement::Mismatch
        } else if !has_all || !self.connected {
            Agreement::Unknown
        } else if sample.state == State::Running {
            Agreement::Agrees
        } else {
            Agreement::NoRun
        }
    }

    /// Asks whether the rig shall really move; where the board would refuse, says so instead.
    pub fn ask(&mut self) {
        let refusal = match self.last.map(|sample| sample.state) {
            _ if !self.connected => Some("there is no connection to the board; check the cable"),
            Some(State::Ready) => None,
            None => Some("the board has sent no sample yet; check its power and the port"),
            Some(State::Idle) => Some("the rig is not armed; press a and wait for READY"),
            Some(State::Homing) => Some("the plunger is homing; wait for READY"),
            Some(State::Running) => Some("a protocol is running; press s to stop it"),
            Some(State::Fault) => {
                Some("a fault is latched; remove its cause, press c to clear it, then a to arm")
            }
        };
        self.asking = refusal.is_none();
        self.message = match refusal {
            Some(why) => format!("Cannot run the protocol: {why}."),
            None => format!(
                "Run the protocol \"{}\" ({})? The actuator will move. y: yes, any other key: no",
                Named::Paper.name(),
                Named::Paper.title()
            ),
        };
    }

    /// Whether the question stands; it does not afterwards.
    pub fn take_question(&mut self) -> bool {
        if self.asking {
            self.message.clear();
        }
        std::mem::take(&mut self.asking)
    }

    /// Whether the rig may move, so that it must not be left alone.
    pub fn is_armed(&self) -> bool {
        self.last.is_some_and(|sample| {
            matches!(sample.state, State::Homing | State::Ready | State::Running)
        })
    }

    /// Whether what is shown is no longer what is: nothing has come for a second.
    fn is_stale(&self) -> bool {
        !self.connected || (self.last.is_some() && self.arrivals.is_empty())
    }

    /// Lines a second.
    fn rate(&self) -> usize {
        self.arrivals.len()
    }

    /// The latched fault.
    fn fault(&self) -> Option<Fault> {
        Fault::from_code(self.last?.fault)
    }
}
