//! How the rig stood while a recording was made: `[setup]` of its metadata.
//!
//! A static curve cannot be split into a weight, an exponent and a linear spring by any pressure. A
//! person would turn the rig over, hang a weight on it, or wait an hour. What was changed is said
//! beside the recording, and the model of that session is changed with it: see `Session::placed` of
//! the library. Keys that are missing are unknown, and the same for all recordings of a sitting.

use std::fmt::{self, Write as _};
use std::ops::RangeInclusive;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::InputError;
use crate::recording::in_words;

/// How the rig stood.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// By how much the base was turned against gravity since the angle was zeroed (°), positive
    /// in the direction in which the actuator bends.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<f64>,
    /// What hung at the tip (g).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tip_load_g: Option<f64>,
    /// Length of the tube between the pressure sensor and the actuator (mm).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tube_mm: Option<f64>,
    /// Temperature of the actuator (°C).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// How long the actuator had rested without pressure before (s).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rested_s: Option<f64>,
    /// What was new since the recording before.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub new_part: Option<NewPart>,
}

/// A part that has been replaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NewPart {
    /// Another actuator of the same kind, never stretched before.
    Actuator,
    /// Another angle sensor.
    Sensor,
}

/// What is done to turn the base by an angle (°).
fn turn(tilt_deg: f64) -> String {
    let direction = if tilt_deg < 0.0 { "against" } else { "in" };
    format!(
        "turn the base by {}° {direction} the bending direction",
        tilt_deg.abs()
    )
}

/// A number of the setup, its unit and what it may be.
pub(crate) type Bounded = (&'static str, &'static str, RangeInclusive<f64>);

/// The numbers, in the order of the fields.
pub(crate) const NUMBERS: [Bounded; 5] = [
    ("tilt_deg", "°", -360.0..=360.0),
    ("tip_load_g", "g", 0.0..=100_000.0),
    ("tube_mm", "mm", 0.0..=100_000.0),
    ("temperature_c", "°C", -100.0..=300.0),
    ("rested_s", "s", 0.0..=1e9),
];

impl Setup {
    /// The advice for an unknown key.
    pub(crate) const KNOWN: &str = "known are tilt_deg, tip_load_g, tube_mm, temperature_c, \
        rested_s, and new_part, which is actuator or sensor";

    fn numbers(&self) -> [Option<f64>; NUMBERS.len()] {
        [
            self.tilt_deg,
            self.tip_load_g,
            self.tube_mm,
            self.temperature_c,
            self.rested_s,
        ]
    }

    /// What is said here; `other` fills in what is missing.
    #[must_use]
    pub fn or(&self, other: &Self) -> Self {
        Self {
            tilt_deg: self.tilt_deg.or(other.tilt_deg),
            tip_load_g: self.tip_load_g.or(other.tip_load_g),
            tube_mm: self.tube_mm.or(other.tube_mm),
            temperature_c: self.temperature_c.or(other.temperature_c),
            rested_s: self.rested_s.or(other.rested_s),
            new_part: self.new_part.or(other.new_part),
        }
    }

    /// What is to be done at the rig before it is recorded, each thing in a few words as a
    /// command; none where it stays as it is.
    pub fn instructions(&self) -> Vec<String> {
        let numbers = [
            self.tilt_deg.map(turn),
            self.tip_load_g.map(|it| format!("hang {it} g at the tip")),
            self.tube_mm
                .map(|it| format!("use a tube of {it} mm between sensor and actuator")),
            self.temperature_c
                .map(|it| format!("bring the actuator to {it} °C")),
            self.rested_s
                .map(|it| format!("let it rest without pressure for {it} s")),
        ];
        let part = self.new_part.map(|part| match part {
            NewPart::Actuator => "put in an actuator that was never stretched".to_owned(),
            NewPart::Sensor => "put in another angle sensor".to_owned(),
        });
        numbers.into_iter().chain([part]).flatten().collect()
    }

    /// What is to be done at the rig, as a sentence begins; empty where it stays as it is.
    pub fn instruction(&self) -> String {
        match self.instructions()[..] {
            [] => String::new(),
            ref steps => format!("{}, then ", steps.join(", ")),
        }
    }

    /// The option of `softrig record` that says it, with a blank before; empty where there is
    /// nothing to say.
    pub fn option(&self) -> String {
        match self.to_string().as_str() {
            "" => String::new(),
            text => format!(" --setup {text}"),
        }
    }

    /// The lines of a section that reads back as this.
    pub(crate) fn to_toml(&self) -> String {
        // Numbers and words always can be written.
        toml::to_string(self).unwrap_or_default()
    }

    /// By how much the base was turned (rad); not at all where nothing is said.
    pub fn turned_rad(&self) -> f64 {
        self.tilt_deg.map_or(0.0, f64::to_radians)
    }

    /// Whether a person says that the actuator was left without pressure before.
    pub fn has_rested(&self) -> bool {
        self.rested_s.is_some()
    }

    /// Refuses numbers that no bench has.
    ///
    /// # Errors
    ///
    /// Names the key, its value and the range.
    pub fn check(&self) -> Result<(), InputError> {
        for (value, (key, unit, range)) in self.numbers().into_iter().zip(&NUMBERS) {
            match value {
                Some(value) if !range.contains(&value) => {
                    return Err(InputError::new(
                        format!("{key} = {value} {unit} in [setup]"),
                        format!(
                            "give a number from {} to {} {unit}",
                            range.start(),
                            range.end()
                        ),
                    ));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// `tilt_deg=90,tip_load_g=20`, which reads back as the same.
impl fmt::Display for Setup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let numbers = self.numbers().into_iter().zip(&NUMBERS);
        let mut all: Vec<String> = numbers
            .filter_map(|(value, (key, ..))| Some(format!("{key}={}", value?)))
            .collect();
        all.extend(self.new_part.map(|part| {
            let name = match part {
                NewPart::Actuator => "actuator",
                NewPart::Sensor => "sensor",
            };
            format!("new_part={name}")
        }));
        f.write_str(&all.join(","))
    }
}

/// `tilt_deg=90,tip_load_g=20`, as a command line has it.
impl FromStr for Setup {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        let mut lines = String::new();
        for assignment in text.split(',').map(str::trim).filter(|it| !it.is_empty()) {
            let (key, value) = assignment.split_once('=').ok_or_else(|| {
                InputError::new(
                    format!("\"{assignment}\" in a setup says no value"),
                    "write KEY=VALUE, several with commas: tilt_deg=90,tip_load_g=20",
                )
            })?;
            let value = value.trim();
            // A word is in quotation marks in a file.
            let quote = if value.parse::<f64>().is_ok() {
                ""
            } else {
                "\""
            };
            let _ = writeln!(lines, "{} = {quote}{value}{quote}", key.trim());
        }
        let setup: Self = toml::from_str(&lines).map_err(|error| {
            InputError::new(
                format!("the setup \"{text}\": {}", in_words(error.message())),
                Self::KNOWN,
            )
        })?;
        setup.check()?;
        Ok(setup)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn assignments_and_a_file_say_the_same() {
        let given: Setup = "tilt_deg=90, tip_load_g = 20,new_part=sensor"
            .parse()
            .unwrap();
        let file: Setup =
            toml::from_str("tilt_deg = 90.0\ntip_load_g = 20\nnew_part = \"sensor\"").unwrap();
        assert_eq!(given, file);
        assert_eq!(given.tilt_deg, Some(90.0));
        let again: Setup = toml::from_str(&toml::to_string(&given).unwrap()).unwrap();
        assert_eq!(again, given);
        assert_eq!("".parse::<Setup>().unwrap(), Setup::default());
        assert_eq!(given.to_string().parse::<Setup>().unwrap(), given);
        assert_eq!(Setup::default().instruction(), "");
        assert_eq!(
            given.instruction(),
            "turn the base by 90° in the bending direction, hang 20 g at the tip, put \
             in another angle sensor, then "
        );
    }

    #[test]
    fn what_is_said_here_goes_before_what_is_said_elsewhere() {
        let here: Setup = "tilt_deg=90".parse().unwrap();
        let elsewhere: Setup = "tilt_deg=45,tube_mm=300".parse().unwrap();
        let both: Setup = "tilt_deg=90,tube_mm=300".parse().unwrap();
        assert_eq!(here.or(&elsewhere), both);
        assert_eq!(Setup::default().or(&elsewhere), elsewhere);
    }

    #[test]
    fn what_no_bench_has_is_refused_with_the_reason() {
        for (text, word) in [
            ("tilt=90", "tilt"),
            ("tilt_deg", "no value"),
            ("tilt_deg=steep", "tilt_deg"),
            ("tilt_deg=nan", "tilt_deg"),
            ("tip_load_g=-1", "tip_load_g = -1 g"),
            ("new_part=pump", "pump"),
            ("tilt_deg=1,tilt_deg=2", "tilt_deg"),
        ] {
            let error = text.parse::<Setup>().unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
