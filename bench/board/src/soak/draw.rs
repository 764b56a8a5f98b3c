// SPDX-License-Identifier: GPL-3.0-or-later
//! Draws faults and protocols.

use rand::{RngExt, seq::IndexedRandom};
use rand_pcg::Pcg64Mcg;
use wire::{
    decimal::Hundredths,
    fault::Fault as Latched,
    protocol::{ControlMode, Named, Segment},
};

use virtual_rig::{board::ResetCause, fault::Fault};

/// Something that happens to a rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Misfortune {
    /// Something breaks, and is mended later.
    Broken(Fault),
    /// The port is opened a second time: the board starts anew through its
    /// bootloader.
    PortOpened,
    /// Somebody presses the reset button.
    ResetButton,
    /// The operator thinks better of it: `stop`.
    Stop,
    /// The computer is done: `disarm`.
    Disarm,
}

/// When the pump has to have made its last step after something broke (s).
///
/// The times are those of `docs/safety.md`; where a reading has to be wrong for a
/// while before it counts, that while is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Deadline {
    /// So long after it broke, whatever the rig was doing.
    After(f64),
    /// So long after it broke, or after the first step from then on, unless the
    /// plunger is homing: then it may leave that end.
    InMotion(f64),
    /// So long after the last line that the board can have heard.
    AfterLastLine(f64),
    /// It may go on.
    None,
}

/// The emergency stop and the end switches stop the pulses themselves.
const SWITCH_S: f64 = 0.005;
/// Pulses outlive a main program by so much.
const HANG_S: f64 = 0.040;
/// With interrupts off, the watchdog ends them; its clock may be a tenth slow.
const DEAF_S: f64 = 0.150;
/// Two control periods: one may have begun just before.
const PERIODS_S: f64 = 0.020;
/// A sensor's voltage has to be impossible for so long.
const DEBOUNCE_S: f64 = 0.050;
/// `beat.s` as shipped.
const SILENCE_S: f64 = 2.0;

impl Misfortune {
    /// The name in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Broken(fault) => fault.name(),
            Self::PortOpened => "port opened",
            Self::ResetButton => "reset button",
            Self::Stop => "stop",
            Self::Disarm => "disarm",
        }
    }

    /// When the pump has to have stopped.
    pub const fn deadline(self) -> Deadline {
        match self {
            Self::Broken(Fault::EmergencyStop) => Deadline::After(SWITCH_S),
            Self::Broken(Fault::EndSwitch | Fault::RetractedSwitch) => Deadline::InMotion(SWITCH_S),
            Self::Broken(Fault::Hang) => Deadline::After(HANG_S),
            Self::Broken(Fault::Deaf) => Deadline::After(DEAF_S),
            Self::Broken(
                Fault::OpenFlex | Fault::ShortFlex | Fault::OpenPressure | Fault::ShortPressure,
            ) => Deadline::After(PERIODS_S + DEBOUNCE_S),
            Self::Broken(Fault::Unplugged) => Deadline::AfterLastLine(SILENCE_S + PERIODS_S),
            Self::Broken(Fault::BrownOut | Fault::PowerCut)
            | Self::PortOpened
            | Self::ResetButton
            | Self::Stop
            | Self::Disarm => Deadline::After(PERIODS_S),
            // What is stuck, leaks or slips shows only after a while of pumping, and
            // noise is nothing to stop for.
            Self::Broken(_) => Deadline::None,
        }
    }

    /// Whether a rig on which it lasts must not be armed.
    pub const fn forbids_arming(self) -> bool {
        matches!(
            self,
            Self::Broken(
                Fault::EmergencyStop
                    | Fault::EndSwitch
                    | Fault::OpenFlex
                    | Fault::ShortFlex
                    | Fault::OpenPressure
                    | Fault::ShortPressure
            )
        )
    }

    /// Whether a latched fault, by its code, can come of it.
    pub fn explains(self, code: u8) -> bool {
        use Latched as L;
        let fault = match self {
            Self::Broken(fault) => fault,
            Self::PortOpened | Self::ResetButton => return code == L::Restart.code(),
            Self::Stop | Self::Disarm => return false,
        };
        let known: &[L] = match fault {
            // A flex sensor that lies lets the loop push until another limit.
            Fault::OpenFlex | Fault::ShortFlex => &[L::FlexSensor, L::OverAngle],
            Fault::StuckFlex | Fault::DetachedFlex => &[
                L::FlexSensor,
                L::OverAngle,
                L::OverPressure,
                L::EndSwitch,
                L::Stall,
                L::Reach,
                L::Disagreement,
            ],
            Fault::OpenPressure | Fault::ShortPressure => {
                &[L::PressureSensor, L::OverPressure, L::Stall]
            }
            // One that shows less than there is lets the pump push on; mended, it shows
            // what there is.
            Fault::StuckPressure
            | Fault::FlickeringPressure
            | Fault::DriftingPressure
            | Fault::Late
            | Fault::Branch
            | Fault::Reference
            | Fault::Ground => &[
                L::PressureSensor,
                L::OverPressure,
                L::OverAngle,
                L::FlexSensor,
                L::EndSwitch,
                L::Stall,
                L::Vent,
                L::Reach,
                L::Disagreement,
                L::GasLaw,
                L::Blind,
                L::Late,
                L::Supply,
                L::Ground,
            ],
            // Lost steps make the counted place wrong until the next homing.
            Fault::Leak | Fault::VentOpen => {
                &[L::EndSwitch, L::Stall, L::Reach, L::GasLaw, L::Blind]
            }
            Fault::Stall | Fault::LostCoil | Fault::LostSteps => &[
                L::EndSwitch,
                L::Stall,
                L::RetractedSwitch,
                L::MotorReversed,
                L::Vent,
                L::Reach,
                L::GasLaw,
                L::Blind,
            ],
            // Reversed within a run, it pushes where it should let go.
            Fault::ReversedMotor => &[
                L::EndSwitch,
                L::Stall,
                L::RetractedSwitch,
                L::MotorReversed,
                L::Vent,
                L::Reach,
                L::OverPressure,
                L::OverAngle,
                L::Disagreement,
                L::Blind,
                // Air that is let go while the count says that it is pushed in seems lost.
                L::GasLaw,
            ],
            Fault::EndSwitch => &[L::EndSwitch, L::Stall, L::MotorReversed],
            Fault::RetractedSwitch => &[L::EndSwitch, L::RetractedSwitch, L::Stall, L::Reach],
            Fault::VentShut => &[L::Vent, L::Stall, L::OverPressure],
            Fault::Noise | Fault::Unplugged => &[L::HostLost],
            Fault::EmergencyStop => &[L::EmergencyStop],
            Fault::BrownOut => &[L::BrownOut, L::Restart],
            Fault::Hang => &[L::Watchdog],
            Fault::Deaf => &[L::Watchdog, L::Restart],
            Fault::LowSupply => &[L::Supply],
            Fault::Mains | Fault::PowerCut => &[],
        };
        known.iter().any(|fault| fault.code() == code)
    }

    /// Whether it starts the board anew.
    pub const fn resets(self) -> bool {
        matches!(
            self,
            Self::PortOpened
                | Self::ResetButton
                | Self::Broken(Fault::BrownOut | Fault::Hang | Fault::Deaf | Fault::PowerCut)
        )
    }

    /// Draws one: a fault, all kinds alike, or now and then something else.
    pub(super) fn draw(random: &mut Pcg64Mcg) -> Self {
        const OTHERS: [Misfortune; 4] = [
            Misfortune::PortOpened,
            Misfortune::ResetButton,
            Misfortune::Stop,
            Misfortune::Disarm,
        ];
        let all = Fault::ALL.len() + OTHERS.len();
        match random.random_range(0..all).checked_sub(Fault::ALL.len()) {
            Some(other) => OTHERS[other],
            None => Self::Broken(*Fault::ALL.choose(random).unwrap_or(&Fault::EmergencyStop)),
        }
    }
}

/// The reset that a button makes.
pub(super) const BUTTON: ResetCause = ResetCause::External;

/// Where in a round something happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Idle,
    Homing,
    Ready,
    Running,
}

/// A round's misfortunes.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Plan {
    pub phase: Phase,
    /// How long after the phase began (s).
    pub after_s: f64,
    /// One or two, or none: what happens, how long after the one before (s), and how
    /// long it lasts (s).
    pub misfortunes: Vec<(Misfortune, f64, f64)>,
    pub protocol: Protocol,
}

/// What is played.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Protocol {
    Named(Named),
    Own(Vec<Segment>),
}

/// Times are drawn evenly in their logarithm: a glitch, or half a minute.
fn log_even(random: &mut Pcg64Mcg, from_s: f64, to_s: f64) -> f64 {
    from_s * (to_s / from_s).powf(random.random())
}

impl Plan {
    pub(super) fn draw(random: &mut Pcg64Mcg) -> Self {
        let phase = match random.random_range(0..10) {
            0 => Phase::Idle,
            1 => Phase::Ready,
            2 | 3 => Phase::Homing,
            _ => Phase::Running,
        };
        let longest = match phase {
            Phase::Idle | Phase::Ready => 1.0,
            Phase::Homing => 6.0,
            Phase::Running => 15.0,
        };
        let count = match random.random_range(0..10) {
            0 => 0,
            1..8 => 1,
            _ => 2,
        };
        let misfortunes = (0..count)
            .map(|_| {
                (
                    Misfortune::draw(random),
                    random.random_range(0.0..0.5),
                    log_even(random, 0.004, 8.0),
                )
            })
            .collect();
        Self {
            phase,
            after_s: random.random_range(0.0..longest),
            misfortunes,
            protocol: Protocol::draw(random),
        }
    }
}

impl Protocol {
    fn draw(random: &mut Pcg64Mcg) -> Self {
        if random.random_bool(0.3)
            && let Some(&named) = Named::ALL.choose(random)
        {
            return Self::Named(named);
        }
        let count = random.random_range(1..=6);
        Self::Own((0..count).map(|index| segment(random, index)).collect())
    }
}

/// A segment within the shipped limits: 110° and 160 kPa may be asked for.
fn segment(random: &mut Pcg64Mcg, index: u8) -> Segment {
    let mode = [
        ControlMode::Pressure,
        ControlMode::AngleOpenLoop,
        ControlMode::AngleClosedLoop,
    ][random.random_range(0..3)];
    // An actuator of this stiffness is at 90° with 87 kPa: beyond 115 kPa the angle
    // would be the limit, which is a fault with a cause of its own.
    let highest = if mode == ControlMode::Pressure {
        11_000
    } else {
        10_500
    };
    let level = random.random_range(0..highest);
    let duration_ms = random.random_range(20..5_000);
    match random.random_range(0..12) {
        0..4 => Segment::Step {
            mode,
            level: Hundredths(level),
            duration_ms,
        },
        4..7 => Segment::Ramp {
            mode,
            level: Hundredths(level),
            duration_ms,
        },
        7 | 8 => Segment::Multisine {
            mode,
            centre: Hundredths(level),
            amplitude: Hundredths(random.random_range(0..=level.min(highest - level))),
            period_ms: random.random_range(500..8_000),
            duration_ms,
        },
        9 => Segment::Hold { duration_ms },
        10 if index > 0 => Segment::Repeat {
            from: index - 1,
            times: 1,
        },
        _ => Segment::Release { duration_ms },
    }
}
