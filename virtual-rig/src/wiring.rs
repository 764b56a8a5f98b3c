// SPDX-License-Identifier: GPL-3.0-or-later
//! The pins of the Arduino Mega 2560.
//!
//! The switches are normally closed to ground, so that a broken wire reads as pressed. Undriven
//! outputs are safe: the motor is free, and the vent valve open.

use crate::board::Pin;

/// Analog input of the pressure sensor (A0): ratiometric, 0.5–4.5 V of 5 V for 0–80 psi.
pub const PRESSURE_CHANNEL: u8 = 0;
/// Analog input of the flex sensor (A1), a divider: flex to 5 V, 47 kΩ to ground.
pub const FLEX_CHANNEL: u8 = 1;
/// STEP of the stepper driver (Arduino pin 11, OC1A): one microstep each rising edge.
pub const STEP: Pin = pin(b'B', 5);
/// DIR of the stepper driver (Arduino pin 22): high pushes the plunger in (compresses).
pub const DIRECTION: Pin = pin(b'A', 0);
/// ENABLE of the stepper driver (Arduino pin 24): low lets it step. High or undriven: the motor is
/// free and does not move.
pub const ENABLE: Pin = pin(b'A', 2);
/// The vent valve (Arduino pin 26): high is energised and closed, low or undriven is open.
pub const VENT_VALVE: Pin = pin(b'A', 4);
/// The end switch at the retracted end (Arduino pin 2): low is normal, high is pressed or a broken
/// wire.
pub const RETRACTED_SWITCH: Pin = pin(b'E', 4);
/// The end switch at the pushed-in end (Arduino pin 3): low is normal, high is pressed or a broken
/// wire.
pub const PUSHED_IN_SWITCH: Pin = pin(b'E', 5);
/// The emergency stop (Arduino pin 21): low is normal, high is pressed or a broken wire.
pub const EMERGENCY_STOP: Pin = pin(b'D', 0);
/// The on-board light (Arduino pin 13): high is on.
pub const LIGHT: Pin = pin(b'B', 7);

const fn pin(port: u8, bit: u8) -> Pin {
    Pin { port, bit }
}
