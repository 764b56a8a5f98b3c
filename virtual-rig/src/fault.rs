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
    /// A loose contact of the pressure sensor: its input reads 0 V for a moment, again and again.
    FlickeringPressure,
    /// The pressure sensor shows less and less, by 0.5 kPa a second.
    DriftingPressure,
    /// The tube to the pressure sensor is half clogged: it shows the pressure late, as of first order.
    Late,
    /// One kink in a common branch takes the pressure sensor and the vent away from the actuator.
    Branch,
    /// The converter's reference drifts away from the sensors' supply: every count shrinks, that of
    /// the processor's 1.1 V too.
    Reference,
    /// The sensors' ground drifts: the voltages of both change alike.
    Ground,
    /// The mains couples into both sensors' wires.
    Mains,
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
    pub const ALL: [Self; 31] = [
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
        Self::FlickeringPressure,
        Self::DriftingPressure,
        Self::Late,
        Self::Branch,
        Self::Reference,
        Self::Ground,
        Self::Mains,
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
            Self::FlickeringPressure => "flickering-pressure",
            Self::DriftingPressure => "drifting-pressure",
            Self::Late => "late",
            Self::Branch => "branch",
            Self::Reference => "reference",
            Self::Ground => "ground",
            Self::Mains => "mains",
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

    /// How large it is where nothing else is said.
    pub const fn size(self) -> Size {
        match self {
            Self::DriftingPressure => Size::Drift(-0.5),
            Self::FlickeringPressure => Size::Gaps {
                every_ms: 60.0,
                open_ms: 30.0,
            },
            Self::Late => Size::Time(0.7),
            Self::Reference => Size::Share(-0.01),
            Self::Ground => Size::Shift(-10.0),
            Self::Mains => Size::Wave {
                hertz: 50.0,
                millivolts: 60.0,
            },
            _ => Size::Fixed,
        }
    }
}

/// How large a fault is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Size {
    /// There is one size.
    Fixed,
    /// A time constant (s).
    Time(f64),
    /// How often, and for how long.
    Gaps {
        /// From one to the next (ms).
        every_ms: f64,
        /// How long each is (ms).
        open_ms: f64,
    },
    /// What a reading gains in a second (kPa/s).
    Drift(f64),
    /// The share by which a reading changes in a second (1/s).
    Share(f64),
    /// What a voltage gains in a second (mV/s).
    Shift(f64),
    /// A sine on a voltage.
    Wave {
        /// Its frequency (Hz).
        hertz: f64,
        /// Its amplitude (mV).
        millivolts: f64,
    },
}

impl Size {
    /// How it is written.
    const fn example(self) -> &'static str {
        match self {
            Self::Fixed => "nothing",
            Self::Time(_) => "0.7s",
            Self::Gaps { .. } => "60ms,30ms",
            Self::Drift(_) => "-0.5kPa/s",
            Self::Share(_) => "-1%/s",
            Self::Shift(_) => "-10mV/s",
            Self::Wave { .. } => "50Hz,60mV",
        }
    }

    /// Reads one of the same kind.
    fn read(self, text: &str) -> Option<Self> {
        let number = |text: &str, unit: &str| {
            let number = text.strip_suffix(unit)?.trim().parse().ok();
            number.filter(|number: &f64| number.is_finite())
        };
        Some(match self {
            Self::Fixed => return None,
            Self::Time(_) => Self::Time(number(text, "s").filter(|&time| time > 0.0)?),
            Self::Gaps { .. } => {
                let (every, open) = text.split_once(',')?;
                let open_ms = number(open, "ms").filter(|&open| open > 0.0)?;
                Self::Gaps {
                    every_ms: number(every, "ms").filter(|&every| every > open_ms)?,
                    open_ms,
                }
            }
            Self::Drift(_) => Self::Drift(number(text, "kPa/s")?),
            Self::Share(_) => Self::Share(number(text, "%/s")? / 100.0),
            Self::Shift(_) => Self::Shift(number(text, "mV/s")?),
            Self::Wave { .. } => {
                let (hertz, millivolts) = text.split_once(',')?;
                Self::Wave {
                    hertz: number(hertz, "Hz").filter(|&hertz| hertz > 0.0)?,
                    millivolts: number(millivolts, "mV")?,
                }
            }
        })
    }
}

/// A fault with its size: `KIND` or `KIND=SIZE`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defect {
    /// The fault.
    pub fault: Fault,
    /// Its size.
    pub size: Size,
}

impl From<Fault> for Defect {
    fn from(fault: Fault) -> Self {
        Self {
            fault,
            size: fault.size(),
        }
    }
}

impl FromStr for Defect {
    type Err = FaultError;

    fn from_str(text: &str) -> Result<Self, FaultError> {
        let Some((name, size)) = text.split_once('=') else {
            return text.parse().map(Fault::into);
        };
        let fault: Fault = name.parse()?;
        let size = fault.size().read(size).ok_or(FaultError::Size {
            fault,
            size: size.into(),
        })?;
        Ok(Self { fault, size })
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
    /// Its size is none.
    #[error("`{size}` is no size of {fault}: {}", advice(*fault))]
    Size {
        /// The fault.
        fault: Fault,
        /// What is no size.
        size: String,
    },
    /// A time is not a number.
    #[error("`{0}` does not say when; write for example leak@12.5 or leak@12.5..20 (seconds)")]
    NoTime(String),
    /// The end is not after the start.
    #[error("`{0}` ends before it starts; write the earlier time first")]
    Backwards(String),
}

fn advice(fault: Fault) -> String {
    match fault.size() {
        Size::Fixed => format!("it has one size; write {fault}"),
        size => format!("write for example {fault}={}", size.example()),
    }
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

/// A fault with the time at which it happens: `KIND[=SIZE][@SECONDS[..SECONDS]]`, without a time from
/// the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Planned {
    /// The fault.
    pub defect: Defect,
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
        let Some((defect, times)) = text.split_once('@') else {
            return Ok(Self {
                defect: text.parse()?,
                from_s: 0.0,
                until_s: None,
            });
        };
        let defect = defect.parse()?;
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
            defect,
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
    fn every_fault_is_on_the_pages_and_in_the_table_of_what_finds_it() {
        for (page, heading) in [
            (include_str!("../../docs/virtual-rig.md"), "## Faults"),
            (
                include_str!("../../docs/hardware/commissioning.md"),
                "## What finds what",
            ),
        ] {
            let table = page.split_once(heading).expect("a heading").1;
            let rows = table.lines().filter(|line| line.starts_with("| `"));
            let first_columns = rows.filter_map(|row| row.split('|').nth(1));
            let quoted = first_columns.flat_map(|cell| cell.split('`').skip(1).step_by(2));
            let named: Vec<_> = quoted
                .filter_map(|word| word.split('=').next())
                .filter_map(|word| word.parse::<Fault>().ok())
                .collect();
            for fault in Fault::ALL {
                let count = named.iter().filter(|&&it| it == fault).count();
                assert_eq!(count, 1, "{fault} below {heading}");
            }
        }
    }

    #[test]
    fn times_are_read_and_mistakes_explained() {
        assert_eq!(
            "leak@1.5..4".parse(),
            Ok(Planned {
                defect: Fault::Leak.into(),
                from_s: 1.5,
                until_s: Some(4.0)
            })
        );
        let from_the_start: Planned = "branch".parse().unwrap();
        assert_eq!((from_the_start.from_s, from_the_start.until_s), (0.0, None));
        let planned: Planned = "stall@3".parse().unwrap();
        assert_eq!((planned.from_s, planned.until_s), (3.0, None));
        for text in ["leak@", "leak@-1", "leak@x", "leak@inf", "leak@1..x"] {
            assert_eq!(
                text.parse::<Planned>(),
                Err(FaultError::NoTime(text.into()))
            );
        }
        assert!(matches!(
            "leak@4..1".parse::<Planned>(),
            Err(FaultError::Backwards(_))
        ));
        for (text, fault, size) in [
            ("late=0.3s", Fault::Late, Size::Time(0.3)),
            ("reference=-3%/s", Fault::Reference, Size::Share(-0.03)),
            ("ground=+10mV/s", Fault::Ground, Size::Shift(10.0)),
            (
                "drifting-pressure=-2kPa/s",
                Fault::DriftingPressure,
                Size::Drift(-2.0),
            ),
            (
                "mains=60Hz,30mV",
                Fault::Mains,
                Size::Wave {
                    hertz: 60.0,
                    millivolts: 30.0,
                },
            ),
        ] {
            let planned: Planned = format!("{text}@2").parse().unwrap();
            assert_eq!(planned.defect, Defect { fault, size }, "{text}");
        }
        for (text, advice) in [
            ("late=fast", "late=0.7s"),
            ("late=-1s", "late=0.7s"),
            (
                "flickering-pressure=30ms,60ms",
                "flickering-pressure=60ms,30ms",
            ),
            ("late=1", "late=0.7s"),
            ("mains=50Hz", "mains=50Hz,60mV"),
            ("ground=nan mV/s", "ground=-10mV/s"),
            ("leak=3s", "write leak"),
        ] {
            let message = text.parse::<Planned>().unwrap_err().to_string();
            assert!(message.contains(advice), "{message}");
        }
        // Every size is read as its advice writes it.
        for fault in Fault::ALL {
            let size = fault.size();
            assert_eq!(size.read(size.example()).is_none(), size == Size::Fixed);
        }
        let message = "flood@1".parse::<Planned>().unwrap_err().to_string();
        assert!(message.contains("flood") && message.contains("open-flex"));
    }
}
