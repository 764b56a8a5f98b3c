// SPDX-License-Identifier: GPL-3.0-or-later
//! Commands on standard input while the rig runs: one line in, one line out.

use std::str::FromStr;

use virtual_rig::{Fault, ResetCause, VirtualRig};

/// A command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Control {
    /// `fault KIND on|off`, `press KIND`, `release KIND`
    Fault(Fault, bool),
    /// `bend DEGREES`, `bend off`
    Bend(Option<f64>),
    /// `tilt DEGREES`
    Tilt(f64),
    /// `reset`
    Reset,
    /// `power-cycle`
    PowerCycle,
    /// `status`
    Status,
    /// `quit`
    Quit,
}

/// Bending angles (°) over which the flex sensor is one.
const BENDS: std::ops::RangeInclusive<f64> = -20.0..=140.0;

/// Angles (°) by which the base can be turned.
pub const TILTS: std::ops::RangeInclusive<f64> = -360.0..=360.0;

const COMMANDS: &str = "fault KIND on|off, press emergency-stop|end-switch, \
                        release emergency-stop|end-switch, bend DEGREES|off, tilt DEGREES, reset, \
                        power-cycle, status, quit";

impl FromStr for Control {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let fault = |name: &str| name.parse::<Fault>().map_err(|error| error.to_string());
        let switch = |name: &str| match fault(name)? {
            fault @ (Fault::EmergencyStop | Fault::EndSwitch) => Ok(fault),
            other => Err(format!(
                "{other} cannot be pressed; use emergency-stop or end-switch"
            )),
        };
        match words[..] {
            ["fault", name, "on"] => Ok(Self::Fault(fault(name)?, true)),
            ["fault", name, "off"] => Ok(Self::Fault(fault(name)?, false)),
            ["press", name] => Ok(Self::Fault(switch(name)?, true)),
            ["release", name] => Ok(Self::Fault(switch(name)?, false)),
            ["bend", "off"] => Ok(Self::Bend(None)),
            ["bend", degrees] => match degrees.trim_end_matches('°').parse() {
                Ok(degrees) if BENDS.contains(&degrees) => Ok(Self::Bend(Some(degrees))),
                _ => Err(format!(
                    "{degrees} is no bending angle; use -20 to 140 degrees, or off to let go"
                )),
            },
            ["tilt", degrees] => match degrees.trim_end_matches('°').parse() {
                Ok(degrees) if TILTS.contains(&degrees) => Ok(Self::Tilt(degrees)),
                _ => Err(format!(
                    "{degrees} is no angle of the base; use -360 to 360 degrees"
                )),
            },
            ["reset"] => Ok(Self::Reset),
            ["power-cycle"] => Ok(Self::PowerCycle),
            ["status"] => Ok(Self::Status),
            ["quit"] => Ok(Self::Quit),
            _ => Err(format!("not a command: {line}; use one of: {COMMANDS}")),
        }
    }
}

/// Does what a command asks and returns the reply.
pub fn obey(control: Control, rig: &mut VirtualRig, connected: bool) -> String {
    match control {
        Control::Fault(fault, on) => {
            rig.set_fault(fault, on);
            format!("ok {fault} {}", if on { "on" } else { "off" })
        }
        Control::Bend(angle_deg) => {
            rig.bend(angle_deg);
            match angle_deg {
                Some(degrees) => format!("ok bent to {degrees} degrees by hand"),
                None => "ok let go".into(),
            }
        }
        Control::Tilt(degrees) => {
            rig.turn_base(degrees);
            format!("ok the base is turned by {degrees} degrees")
        }
        Control::Reset => {
            rig.reset(ResetCause::External);
            "ok reset".into()
        }
        Control::PowerCycle => {
            rig.power_cut();
            rig.power_on_after(virtual_rig::rig::POWER_CUT_S);
            "ok power-cycle".into()
        }
        Control::Status => status(rig, connected),
        Control::Quit => "ok quit".into(),
    }
}

fn status(rig: &VirtualRig, connected: bool) -> String {
    let truth = rig.plant();
    let pick = |condition, yes, no| if condition { yes } else { no };
    let faults: Vec<&str> = rig.faults().map(Fault::name).collect();
    format!(
        "ok time_s={:.3} angle_deg={:.2} pressure_kpa={:.2} plunger_mm={:.3} valve={} driver={} \
         light={} power={} client={} bootloader={} resets={} faults={}",
        truth.time_s,
        truth.angle_deg,
        truth.pressure_kpa,
        truth.plunger_mm,
        pick(truth.valve_open, "open", "closed"),
        pick(truth.driver_enabled, "on", "off"),
        pick(truth.light_on, "on", "off"),
        pick(truth.powered, "on", "off"),
        pick(connected, "yes", "no"),
        pick(rig.in_bootloader(), "yes", "no"),
        rig.resets(),
        if faults.is_empty() {
            "none".into()
        } else {
            faults.join(",")
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn commands_are_read_and_mistakes_explained() {
        assert_eq!(
            "fault leak on".parse(),
            Ok(Control::Fault(Fault::Leak, true))
        );
        assert_eq!(
            " release  end-switch ".parse(),
            Ok(Control::Fault(Fault::EndSwitch, false))
        );
        assert_eq!("status".parse(), Ok(Control::Status));
        assert_eq!("bend 30".parse(), Ok(Control::Bend(Some(30.0))));
        assert_eq!("bend off".parse(), Ok(Control::Bend(None)));
        assert_eq!("tilt 90°".parse(), Ok(Control::Tilt(90.0)));
        for (line, hint) in [
            ("fault flood on", "open-flex"),
            ("press leak", "emergency-stop"),
            ("fault leak", "power-cycle"),
            ("bend up", "140"),
            ("bend nan", "140"),
            ("bend 300", "140"),
            ("tilt over", "360"),
            ("tilt nan", "360"),
            ("", "status"),
        ] {
            let message = line.parse::<Control>().unwrap_err();
            assert!(message.contains(hint), "{message}");
        }
    }
}
