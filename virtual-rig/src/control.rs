// SPDX-License-Identifier: GPL-3.0-or-later
//! Commands on standard input while the rig runs: one line in, one line out.

use std::str::FromStr;

use virtual_rig::{Defect, Fault, ResetCause, VirtualRig};

/// A command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Control {
    /// `fault KIND[=SIZE] on|off`, `press KIND`, `release KIND`
    Fault(Defect, bool),
    /// `bend DEGREES`, `bend off`
    Bend(Option<f64>),
    /// `tilt DEGREES`
    Tilt(f64),
    /// `load GRAMS`
    Load(f64),
    /// `tube MILLIMETRES`
    Tube(f64),
    /// `rest SECONDS`
    Rest(f64),
    /// `supply VOLTS`
    Supply(f64),
    /// `replace actuator`
    Replace,
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

/// What can be hung at the tip (g).
pub const LOADS: std::ops::RangeInclusive<f64> = 0.0..=1_000.0;

/// Lengths of a tube (mm).
pub const TUBES: std::ops::RangeInclusive<f64> = 10.0..=10_000.0;

/// The tube that an actuator is written for (mm).
pub const USUAL_TUBE_MM: f64 = 300.0;

/// How long it can be left alone (s): a day.
const RESTS: std::ops::RangeInclusive<f64> = 0.0..=86_400.0;

/// Supplies with which the processor runs (V).
const SUPPLIES: std::ops::RangeInclusive<f64> = 2.8..=5.5;

const COMMANDS: &str = "fault KIND[=SIZE] on|off, press emergency-stop|end-switch, \
                        release emergency-stop|end-switch, bend DEGREES|off, tilt DEGREES, \
                        load GRAMS, tube MILLIMETRES, rest SECONDS, supply VOLTS, replace actuator, reset, \
                        power-cycle, status, quit";

impl FromStr for Control {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let fault = |name: &str| name.parse::<Defect>().map_err(|error| error.to_string());
        let switch = |name: &str| match fault(name)? {
            it @ Defect {
                fault: Fault::EmergencyStop | Fault::EndSwitch,
                ..
            } => Ok(it),
            Defect { fault, .. } => Err(format!(
                "{fault} cannot be pressed; use emergency-stop or end-switch"
            )),
        };
        let number = |text: &str, range: std::ops::RangeInclusive<f64>, what: &str, unit: &str| {
            let number = text.trim_end_matches('°').parse();
            number.ok().filter(|it| range.contains(it)).ok_or_else(|| {
                let (from, to) = range.into_inner();
                format!("{text} is no {what}; use {from} to {to} {unit}")
            })
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
            ["tilt", text] => number(text, TILTS, "angle of the base", "degrees").map(Self::Tilt),
            ["load", text] => number(text, LOADS, "load", "grams").map(Self::Load),
            ["tube", text] => number(text, TUBES, "length of a tube", "mm").map(Self::Tube),
            ["rest", text] => number(text, RESTS, "rest", "seconds").map(Self::Rest),
            ["supply", text] => number(text, SUPPLIES, "supply", "volts").map(Self::Supply),
            ["replace", "actuator"] => Ok(Self::Replace),
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
        Control::Fault(defect, on) => {
            rig.set_fault(defect, on);
            format!("ok {} {}", defect.fault, if on { "on" } else { "off" })
        }
        Control::Bend(angle_deg) => {
            rig.bend(angle_deg);
            match angle_deg {
                Some(degrees) => format!("ok bent to {degrees} degrees by hand"),
                None => "ok let go".into(),
            }
        }
        Control::Supply(volts) => {
            rig.set_supply(volts);
            format!("ok the supply is {volts} V")
        }
        Control::Tilt(degrees) => {
            rig.change(|placement| placement.turned_rad = degrees.to_radians());
            format!("ok the base is turned by {degrees} degrees")
        }
        Control::Load(grams) => {
            rig.change(|placement| placement.load_kg = grams / 1000.0);
            format!("ok {grams} grams hang at the tip")
        }
        Control::Tube(millimetres) => {
            rig.change(|placement| placement.tube = millimetres / USUAL_TUBE_MM);
            format!("ok the tube has {millimetres} mm")
        }
        Control::Rest(seconds) => {
            rig.rest(seconds);
            format!("ok it rested for {seconds} seconds")
        }
        Control::Replace => {
            rig.replace_actuator();
            "ok another actuator of the same make".into()
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
            Ok(Control::Fault(Fault::Leak.into(), true))
        );
        assert_eq!(
            "fault late=0.7s on".parse(),
            Ok(Control::Fault(Fault::Late.into(), true))
        );
        assert_eq!(
            " release  end-switch ".parse(),
            Ok(Control::Fault(Fault::EndSwitch.into(), false))
        );
        assert_eq!("status".parse(), Ok(Control::Status));
        assert_eq!("bend 30".parse(), Ok(Control::Bend(Some(30.0))));
        assert_eq!("bend off".parse(), Ok(Control::Bend(None)));
        assert_eq!("tilt 90°".parse(), Ok(Control::Tilt(90.0)));
        assert_eq!("load 20".parse(), Ok(Control::Load(20.0)));
        assert_eq!("tube 900".parse(), Ok(Control::Tube(900.0)));
        assert_eq!("rest 600".parse(), Ok(Control::Rest(600.0)));
        assert_eq!("supply 4.4".parse(), Ok(Control::Supply(4.4)));
        assert_eq!("replace actuator".parse(), Ok(Control::Replace));
        for (line, hint) in [
            ("fault flood on", "open-flex"),
            ("fault late=soon on", "late=0.7s"),
            ("press leak", "emergency-stop"),
            ("fault leak", "power-cycle"),
            ("bend up", "140"),
            ("bend nan", "140"),
            ("bend 300", "140"),
            ("tilt over", "360"),
            ("tilt nan", "360"),
            ("load -1", "1000 grams"),
            ("tube 0", "10 to 10000 mm"),
            ("rest long", "86400"),
            ("supply 12", "2.8 to 5.5 volts"),
            ("replace pump", "replace actuator"),
            ("", "status"),
        ] {
            let message = line.parse::<Control>().unwrap_err();
            assert!(message.contains(hint), "{message}");
        }
    }
}
