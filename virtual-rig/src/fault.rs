// SPDX-License-Identifier: GPL-3.0-or-later
//! Faults of the rig that can be injected, by name.

use std::{fmt, str::FromStr};

/// A fault that the virtual rig can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Fault {
    /// The flex sensor's wire is broken: its input reads 0 V.
    OpenFlex,
    /// The flex sensor is shorted: its input reads 5 V.
    ShortFlex,
    /// The flex sensor repeats its last voltage, without noise.
    StuckFlex,
    /// The pressure sensor's wire is broken: its input reads 0 V.
    OpenPressure,
    /// The pressure sensor's wire touches the supply: its input reads 5 V.
    ShortPressure,
    /// The pressure sensor repeats its last voltage, without noise.
    StuckPressure,
    /// The air leaks with a time constant of 3 s.
    Leak,
    /// The motor stalls: steps do not move the plunger.
    Stall,
    /// Bursts of flipped, lost and inserted bytes on the line, both ways.
    Noise,
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The switch at the pushed-in end reads pressed.
    EndSwitch,
    /// The flex sensor has come off the actuator: it shows zero, with much noise.
    DetachedFlex,
    /// The pressure sensor shows less and less, by 0.5 kPa a second.
    DriftingPressure,
    /// A coil of the motor has no current: it trembles and does not turn.
    LostCoil,
    /// The switch at the retracted end reads pressed.
    RetractedSwitch,
    /// Two wires of a motor coil are swapped: it turns the other way.
    ReversedMotor,
    /// The vent does not open.
    VentShut,
    /// The vent does not close.
    VentOpen,
    /// The supply sags once: a brown-out reset.
    BrownOut,
    /// The firmware's main program hangs until the next reset; interrupts go on.
    Hang,
    /// The firmware hangs with interrupts off until the watchdog resets it.
    Deaf,
    /// The motor has too little torque: nine steps of ten do not move the plunger.
    LostSteps,
    /// The supply is 4.2 V.
    LowSupply,
    /// No power while it lasts.
    PowerCut,
    /// The cable is unplugged: bytes are lost both ways.
    Unplugged,
}

impl Fault {
    /// Every fault.
    pub const ALL: [Self; 25] = [
        Self::OpenFlex,
        Self::ShortFlex,
        Self::StuckFlex,
        Self::OpenPressure,
        Self::ShortPressure,
        Self::StuckPressure,
        Self::Leak,
        Self::Stall,
        Self::Noise,
        Self::EmergencyStop,
        Self::EndSwitch,
        Self::DetachedFlex,
        Self::DriftingPressure,
        Self::LostCoil,
        Self::RetractedSwitch,
        Self::ReversedMotor,
        Self::VentShut,
        Self::VentOpen,
        Self::BrownOut,
        Self::Hang,
        Self::Deaf,
        Self::LostSteps,
        Self::LowSupply,
        Self::PowerCut,
        Self::Unplugged,
    ];

    /// The name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OpenFlex => "open-flex",
            Self::ShortFlex => "short-flex",
            Self::StuckFlex => "stuck-flex",
            Self::OpenPressure => "open-pressure",
            Self::ShortPressure => "short-pressure",
            Self::StuckPressure => "stuck-pressure",
            Self::Leak => "leak",
            Self::Stall => "stall",
            Self::Noise => "noise",
            Self::EmergencyStop => "emergency-stop",
            Self::EndSwitch => "end-switch",
            Self::DetachedFlex => "detached-flex",
            Self::DriftingPressure => "drifting-pressure",
            Self::LostCoil => "lost-coil",
            Self::RetractedSwitch => "retracted-switch",
            Self::ReversedMotor => "reversed-motor",
            Self::VentShut => "vent-shut",
            Self::VentOpen => "vent-open",
            Self::BrownOut => "brown-out",
            Self::Hang => "hang",
            Self::Deaf => "deaf",
            Self::LostSteps => "lost-steps",
            Self::LowSupply => "low-supply",
            Self::PowerCut => "power-cut",
            Self::Unplugged => "unplugged",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Why a text is not a fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FaultError {
    /// There is no such fault.
    #[error("there is no fault `{0}`; use one of {list}", list = names())]
    Unknown(String),
    /// The time is missing or not a number.
    #[error("`{0}` does not say when; write for example leak@12.5 or leak@12.5..20 (seconds)")]
    NoTime(String),
    /// The end is not after the start.
    #[error("`{0}` ends before it starts; write the earlier time first")]
    Backwards(String),
}

fn names() -> String {
    // Where their number is known, the optimiser of a release build unrolls the joining
    // and then takes more than ten minutes to compare the lengths.
    let faults = std::hint::black_box(Fault::ALL.as_slice());
    let names: Vec<_> = faults.iter().map(|fault| fault.name()).collect();
    names.join(", ")
}

impl FromStr for Fault {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        Self::ALL
            .into_iter()
            .find(|fault| fault.name() == text)
            .ok_or_else(|| FaultError::Unknown(text.into()))
    }
}

/// A fault with the time at which it happens: `KIND@SECONDS[..SECONDS]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// The fault.
    pub fault: Fault,
    /// When it starts, in seconds of simulated time.
    pub from_s: f64,
    /// When it ends; never, if there is nothing. A power cut without an end
    /// lasts half a second.
    pub until_s: Option<f64>,
}

impl FromStr for Planned {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let no_time = || FaultError::NoTime(text.into());
        let (fault, times) = text.split_once('@').ok_or_else(no_time)?;
        let fault: Fault = fault.parse()?;
        let seconds = |text: &str| {
            text.parse()
                .ok()
                .filter(|seconds: &f64| seconds.is_finite() && *seconds >= 0.0)
                .ok_or_else(no_time)
        };
        let (from_s, until_s) = match times.split_once("..") {
            Some((from, until)) => (seconds(from)?, Some(seconds(until)?)),
            None => (seconds(times)?, None),
        };
        if until_s.is_some_and(|until| until <= from_s) {
            return Err(FaultError::Backwards(text.into()));
        }
        Ok(Self {
            fault,
            from_s,
            until_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_found_by_its_name() {
        for fault in Fault::ALL {
            assert_eq!(fault.name().parse(), Ok(fault));
        }
    }

    #[test]
    fn times_are_read_and_mistakes_explained() {
        assert_eq!(
            "leak@1.5..4".parse(),
            Ok(Planned {
                fault: Fault::Leak,
                from_s: 1.5,
                until_s: Some(4.0)
            })
        );
        let planned: Planned = "stall@3".parse().unwrap();
        assert_eq!((planned.from_s, planned.until_s), (3.0, None));
        for text in [
            "leak",
            "leak@",
            "leak@-1",
            "leak@x",
            "leak@inf",
            "leak@1..x",
        ] {
            assert_eq!(
                text.parse::<Planned>(),
                Err(FaultError::NoTime(text.into()))
            );
        }
        assert!(matches!(
            "leak@4..1".parse::<Planned>(),
            Err(FaultError::Backwards(_))
        ));
        let message = "flood@1".parse::<Planned>().unwrap_err().to_string();
        assert!(message.contains("flood") && message.contains("open-flex"));
    }
}
