//! The acceptance test of a board and its rig: what each step is for, what it measures, and what
//! it is held to.
//!
//! What is computed from what a board sent is tested without a port; [`session`] sends the commands
//! and hears the answers.

mod clock;
mod lines;
mod motion;
mod noise;
pub mod session;

use schemars::JsonSchema;
use serde::Serialize;

pub use clock::rate;
pub use lines::{Arrivals, Watched};
pub use motion::{Hold, Stop, curves};
pub use noise::{Noise, RATE_HZ, spectrum};

/// A step of the acceptance test, in the order in which they are made: what moves nothing first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Step {
    /// Firmware, settings, latched faults.
    Identity,
    /// Model steps on the board and here, bit for bit.
    SelfTest,
    /// Telemetry for a minute.
    Telemetry,
    /// The board's clock against the computer's.
    Clock,
    /// The sensors' noise at rest.
    Noise,
    /// Each switch, pressed and with its wire pulled.
    Switches,
    /// The plunger's home, twice.
    Homing,
    /// The stroke between the end switches, twice.
    Stroke,
    /// The emergency stop in a slow run.
    EmergencyStop,
    /// A held pressure and its release.
    Pressure,
    /// The mechanical relief valve.
    Relief,
}

impl Step {
    /// Every step.
    pub const ALL: [Self; 11] = [
        Self::Identity,
        Self::SelfTest,
        Self::Telemetry,
        Self::Clock,
        Self::Noise,
        Self::Switches,
        Self::Homing,
        Self::Stroke,
        Self::EmergencyStop,
        Self::Pressure,
        Self::Relief,
    ];

    /// The word on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Identity => "identity",
            Self::SelfTest => "self-test",
            Self::Telemetry => "telemetry",
            Self::Clock => "clock",
            Self::Noise => "noise",
            Self::Switches => "switches",
            Self::Homing => "homing",
            Self::Stroke => "stroke",
            Self::EmergencyStop => "emergency-stop",
            Self::Pressure => "pressure",
            Self::Relief => "relief",
        }
    }

    /// Its heading.
    pub const fn title(self) -> &'static str {
        match self {
            Self::Identity => "Firmware and settings",
            Self::SelfTest => "Arithmetic",
            Self::Telemetry => "Telemetry",
            Self::Clock => "Clock",
            Self::Noise => "Sensors at rest",
            Self::Switches => "Switches and their wires",
            Self::Homing => "Home of the plunger",
            Self::Stroke => "Stroke of the pump",
            Self::EmergencyStop => "Emergency stop",
            Self::Pressure => "Pressure, leak and vent",
            Self::Relief => "Relief valve",
        }
    }

    /// What it is for.
    pub const fn purpose(self) -> &'static str {
        match self {
            Self::Identity => {
                "The firmware matches this softrig, its settings are read back as stored, and no fault is latched from before."
            }
            Self::SelfTest => {
                "Board and computer both step the model with every effect of the catalogue: unless they agree to the last bit, the board's predictions mean nothing."
            }
            Self::Telemetry => {
                "A line every 10 ms, none lost or damaged: gaps and late periods would look like dynamics."
            }
            Self::Clock => {
                "A Mega has a ceramic resonator: 0.5 % of time is 1 % of inertia. The measured factor corrects the times of later recordings."
            }
            Self::Noise => {
                "The diagnosis takes the sensors' noise for white and their zeros for constant. Mains hum, drift and coarse steps are seen best while nothing moves."
            }
            Self::Switches => {
                "Each switch opens when pressed and when its wire is pulled, and no other does: otherwise it could not stop the pump."
            }
            Self::Homing => {
                "The plunger finds the retracted switch twice at the same place: no lost steps, no loose switch."
            }
            Self::Stroke => {
                "The board measures and stores the stroke between its end switches: no setting lets the pump exceed it. Two equal strokes also show that no steps are lost."
            }
            Self::EmergencyStop => {
                "The button stops a moving pump, opens the vent and takes the 12 V away, whatever the firmware does."
            }
            Self::Pressure => {
                "The pump reaches a pressure, the rig holds it with the pump off, and the vent lets it out; sensor and actuator follow."
            }
            Self::Relief => {
                "The mechanical valve is the one limit that needs neither sensor nor firmware."
            }
        }
    }

    /// What moves, for those who stand beside it; nothing where nothing does.
    pub const fn moves(self) -> Option<&'static str> {
        match self {
            Self::Homing => Some("the plunger moves to the retracted switch, with the vent open"),
            Self::Stroke => {
                Some("the plunger moves through its whole stroke, twice, with the vent open")
            }
            Self::EmergencyStop => Some(
                "the plunger homes, then moves slowly in with the vent closed, to at most 30 kPa",
            ),
            Self::Pressure => {
                Some("the plunger moves, and the actuator bends at 40 kPa for ten seconds")
            }
            _ => None,
        }
    }

    /// What to do where it fails.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::Identity => {
                "Flash the firmware of this version, remove what the fault names, and press the board's reset button."
            }
            Self::SelfTest => {
                "Flash the firmware again; if it stays, build firmware and rig from the same checkout."
            }
            Self::Telemetry => {
                "Use another cable, at most 1 m and shielded, directly at the computer and away from the motor's wires; close other programs; give the Mega a supply that holds 5 V."
            }
            Self::Clock => {
                "Look whether the board has a 16 MHz resonator or crystal, and repeat the step on a computer that is not busy."
            }
            Self::Noise => {
                "Look at the sensor's plug and 5 V, at 100 nF between A0, A1 and GND, at the ground wire (motor current must not return through the Mega), and keep sensor wires from mains and motor."
            }
            Self::Switches => {
                "Compare pins 2, 3 and 21 with the wiring table: normally closed, to GND. A switch that reads open untouched has a broken wire, is wired as normally open, or the plunger stands at it."
            }
            Self::Homing => {
                "Look whether the 12 V are on, the motor turns, and in the right direction (else swap the two wires of one coil); tighten the coupling and the switch."
            }
            Self::Stroke => {
                "Look whether the plunger moves freely over its whole way, whether the switches sit firmly, and at the driver's current: lost steps differ from time to time. If only max.ul is too large, lower it: `softrig upload --settings`."
            }
            Self::EmergencyStop => {
                "Do not go on: one contact of the button goes to pin 21, the other interrupts the 12 V of motor driver and vent."
            }
            Self::Pressure => {
                "Listen for leaks at fittings and actuator (soapy water), look for a tube that is bent or blocked, at the vent valve and its transistor, and at the pressure sensor's plug."
            }
            Self::Relief => {
                "Set the valve 10 to 20 % above max.kpa, below the actuator's limit, or replace it; no pressure without it."
            }
        }
    }
}

/// What a quantity is held to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Limit {
    /// Nothing: it is told.
    None,
    /// At most this.
    AtMost(f64),
    /// At least this.
    AtLeast(f64),
    /// From the first to the second.
    Within(f64, f64),
}

/// A quantity that a step measured.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Measurement {
    /// Its name.
    pub name: String,
    /// Its value; none where it could not be measured.
    pub value: Option<f64>,
    /// Its unit.
    pub unit: &'static str,
    /// The least that passes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub least: Option<f64>,
    /// The most that passes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub most: Option<f64>,
    /// Whether it is within its limits; always where it has none.
    pub passed: bool,
}

impl Measurement {
    /// Holds a value to a limit. What is not a number passes none.
    pub fn new(name: impl Into<String>, value: f64, unit: &'static str, limit: Limit) -> Self {
        let (least, most) = match limit {
            Limit::None => (None, None),
            Limit::AtMost(most) => (None, Some(most)),
            Limit::AtLeast(least) => (Some(least), None),
            Limit::Within(least, most) => (Some(least), Some(most)),
        };
        // Written so that not-a-number fails.
        let passed = limit == Limit::None
            || (least.is_none_or(|least| value >= least) && most.is_none_or(|most| value <= most));
        Self {
            name: name.into(),
            value: value.is_finite().then_some(value),
            unit,
            least,
            most,
            passed,
        }
    }

    /// Something that holds or does not.
    pub fn flag(name: impl Into<String>, holds: bool) -> Self {
        Self {
            value: Some(f64::from(u8::from(holds))),
            passed: holds,
            ..Self::new(name, 0.0, "", Limit::AtLeast(1.0))
        }
    }

    /// Whether it is a [`flag`](Self::flag).
    pub fn is_flag(&self) -> bool {
        self.unit.is_empty() && self.least == Some(1.0) && self.most.is_none()
    }
}

/// How a step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// Everything within its limits.
    Passed,
    /// Something is not.
    Failed,
    /// Not made, or not to its end: nobody was there, or it was not asked for.
    Skipped,
}

/// Curves to be drawn above each other's axis of time (s).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Quantity and unit of the abscissa.
    pub x_label: &'static str,
    /// Quantity and unit of the ordinate.
    pub y_label: &'static str,
    /// Abscissae and ordinates.
    pub points: Vec<(f64, f64)>,
}

/// A step that was made, or was not.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "Step")]
pub struct Result {
    /// Its name.
    pub step: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// What it is for.
    pub purpose: &'static str,
    /// How it ended.
    pub outcome: Outcome,
    /// In a sentence.
    pub sentence: String,
    /// What was measured.
    pub measured: Vec<Measurement>,
    /// What to do, where it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<&'static str>,
    /// What was recorded.
    #[serde(skip)]
    pub curves: Vec<Curve>,
}

impl Result {
    fn of(step: Step, outcome: Outcome, sentence: String, measured: Vec<Measurement>) -> Self {
        Self {
            step: step.name(),
            title: step.title(),
            purpose: step.purpose(),
            outcome,
            sentence,
            measured,
            advice: (outcome == Outcome::Failed).then(|| step.advice()),
            curves: Vec::new(),
        }
    }

    /// Judges what was measured: `said` where all is within its limits.
    pub fn judge(step: Step, measured: Vec<Measurement>, said: impl Into<String>) -> Self {
        let failed: Vec<&str> = measured
            .iter()
            .filter(|it| !it.passed)
            .map(|it| it.name.as_str())
            .collect();
        if failed.is_empty() {
            return Self::of(step, Outcome::Passed, said.into(), measured);
        }
        let sentence = format!("Outside limits: {}.", failed.join("; "));
        Self::of(step, Outcome::Failed, sentence, measured)
    }

    /// A step that ended before it could measure.
    pub fn failed(step: Step, why: impl Into<String>, measured: Vec<Measurement>) -> Self {
        Self::of(step, Outcome::Failed, why.into(), measured)
    }

    /// A step that was not made.
    pub fn skipped(step: Step, why: impl Into<String>) -> Self {
        Self::of(step, Outcome::Skipped, why.into(), Vec::new())
    }

    /// Adds curves.
    pub fn with_curves(self, curves: Vec<Curve>) -> Self {
        Self { curves, ..self }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn limits_are_kept_at_their_edge_and_nan_passes_none() {
        for (value, limit, passes) in [
            (10.0, Limit::AtMost(10.0), true),
            (10.1, Limit::AtMost(10.0), false),
            (1.0, Limit::AtLeast(1.0), true),
            (0.9, Limit::Within(1.0, 2.0), false),
            (2.1, Limit::Within(1.0, 2.0), false),
            (f64::NAN, Limit::AtMost(10.0), false),
            (f64::NAN, Limit::None, true),
        ] {
            let measured = Measurement::new("x", value, "s", limit);
            assert_eq!(measured.passed, passes, "{value} {limit:?}");
            assert!(!measured.is_flag());
        }
        assert!(
            Measurement::flag("closed", true).passed && Measurement::flag("closed", true).is_flag()
        );
        assert!(!Measurement::flag("closed", false).passed);
    }

    #[test]
    fn a_result_names_what_is_out_of_its_limits() {
        let fine = Measurement::new("gaps", 0.0, "", Limit::AtMost(0.0));
        let result = Result::judge(Step::Telemetry, vec![fine.clone()], "All well.");
        assert_eq!((result.outcome, result.advice), (Outcome::Passed, None));
        let lost = Measurement::new("lost lines", 3.0, "", Limit::AtMost(0.0));
        let result = Result::judge(Step::Telemetry, vec![fine, lost], "All well.");
        assert_eq!(result.outcome, Outcome::Failed);
        assert!(result.sentence.contains("lost lines") && !result.sentence.contains("gaps"));
        assert!(result.advice.is_some());
    }

    #[test]
    fn names_lead_to_one_step_each() {
        for (index, step) in Step::ALL.iter().enumerate() {
            assert!(Step::ALL[..index].iter().all(|it| it.name() != step.name()));
        }
    }

    #[test]
    fn the_order_of_assembly_has_every_step_that_the_pages_name() {
        let names = |page: &'static str, heading: &str| -> BTreeSet<&'static str> {
            let section = page.split_once(heading).expect("the page has a table").1;
            let rows = section
                .lines()
                .skip_while(|line| !line.starts_with('|'))
                .take_while(|line| line.starts_with('|'))
                .skip(2);
            let quoted = rows.flat_map(|row| row.split('`').skip(1).step_by(2));
            let all = Step::ALL.map(Step::name);
            quoted.filter(|word| all.contains(word)).collect()
        };
        let steps: BTreeSet<&str> = Step::ALL.iter().map(|step| step.name()).collect();
        let parts = include_str!("../../../../docs/hardware/parts.md");
        assert_eq!(names(parts, "## Order of assembly"), steps);
        let commissioning = include_str!("../../../../docs/hardware/commissioning.md");
        assert_eq!(names(commissioning, "\ncould not be run"), steps);
    }
}
