// SPDX-License-Identifier: GPL-3.0-or-later
//! The pins of the Arduino Mega 2560.
//!
//! | function | Arduino pin | ATmega2560 | meaning |
//! |---|---|---|---|
//! | pressure sensor | A0 | ADC0 | ratiometric 0.5–4.5 V of 5 V, 0–80 psi |
//! | flex sensor | A1 | ADC1 | divider: flex to 5 V, 47 kΩ to ground |
//! | STEP | 11 | PB5 / OC1A | one microstep each rising edge |
//! | DIR | 22 | PA0 | high pushes the plunger in (compresses) |
//! | ENABLE | 24 | PA2 | low lets the driver step; high or undriven: motor free, does not move |
//! | vent valve | 26 | PA4 | high is energised and closed; low or undriven is open |
//! | end switch, retracted | 2 | PE4 | low is normal, high is pressed or a broken wire |
//! | end switch, pushed in | 3 | PE5 | the same |
//! | emergency stop | 21 | PD0 | the same |
//! | light | 13 | PB7 | high is on |
//!
//! The switches are normally closed to ground, so that a broken wire reads as
//! pressed.

use crate::board::Pin;

/// Analog input of the pressure sensor (A0).
pub const PRESSURE_CHANNEL: u8 = 0;
/// Analog input of the flex sensor (A1).
pub const FLEX_CHANNEL: u8 = 1;
/// STEP of the stepper driver (Arduino pin 11).
pub const STEP: Pin = pin(b'B', 5);
/// DIR of the stepper driver (Arduino pin 22): high pushes the plunger in.
pub const DIRECTION: Pin = pin(b'A', 0);
/// ENABLE of the stepper driver (Arduino pin 24): active low.
pub const ENABLE: Pin = pin(b'A', 2);
/// The vent valve (Arduino pin 26): high is closed.
pub const VENT_VALVE: Pin = pin(b'A', 4);
/// The end switch at the retracted end (Arduino pin 2): high is pressed.
pub const RETRACTED_SWITCH: Pin = pin(b'E', 4);
/// The end switch at the pushed-in end (Arduino pin 3): high is pressed.
pub const PUSHED_IN_SWITCH: Pin = pin(b'E', 5);
/// The emergency stop (Arduino pin 21): high is pressed.
pub const EMERGENCY_STOP: Pin = pin(b'D', 0);
/// The on-board light (Arduino pin 13).
pub const LIGHT: Pin = pin(b'B', 7);

const fn pin(port: u8, bit: u8) -> Pin {
    Pin { port, bit }
}
