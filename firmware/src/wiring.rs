//! The pins of the board.
//!
//! The board layer takes its pins from these constants, and a test compares them with the
//! wiring table of `docs/hardware/wiring.md`, so that nobody solders by a wrong table.

/// A digital pin of the ATmega2560 and what is printed beside it on the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// The number printed on the Arduino Mega 2560.
    pub arduino: u8,
    /// The port's letter.
    pub port: u8,
    /// The bit in the port.
    pub bit: u8,
}

const fn pin(arduino: u8, port: u8, bit: u8) -> Pin {
    Pin { arduino, port, bit }
}

impl Pin {
    /// The address of the port's output register in the I/O space.
    ///
    /// Direction and input registers are the two addresses below. Ports A to G
    /// are all within reach of the one-instruction bit operations, which need no
    /// protection against interrupts.
    pub const fn port_address(self) -> u8 {
        3 * (self.port - b'A') + 2
    }
}

/// Step pulses: the driver makes a microstep on each rising edge. The pin is
/// that of compare unit A of timer 1, which moves it without the processor.
pub const STEP: Pin = pin(11, b'B', 5);
/// Direction: high pushes the plunger in (compresses).
pub const DIRECTION: Pin = pin(22, b'A', 0);
/// Enables the motor driver; active low, so that a board without power does not.
pub const ENABLE: Pin = pin(24, b'A', 2);
/// The vent valve's transistor: high closes the valve.
pub const VALVE: Pin = pin(26, b'A', 4);
/// The end switch at the retracted end: high is pressed or a broken wire.
pub const RETRACTED_END: Pin = pin(2, b'E', 4);
/// The end switch at the pushed-in end: high is pressed or a broken wire.
pub const PUSHED_END: Pin = pin(3, b'E', 5);
/// The emergency stop: high is pressed or a broken wire.
pub const EMERGENCY_STOP: Pin = pin(21, b'D', 0);
/// The on-board light.
pub const LIGHT: Pin = pin(13, b'B', 7);

/// Converter channel of the pressure sensor, which is also the number after the
/// A on the board.
pub const PRESSURE_CHANNEL: u8 = 0;
/// Converter channel of the flex sensor.
pub const FLEX_CHANNEL: u8 = 1;

/// Every digital pin in use, with its name in the wiring table.
pub const PINS: [(&str, Pin); 8] = [
    ("STEP", STEP),
    ("DIR", DIRECTION),
    ("ENABLE", ENABLE),
    ("vent valve", VALVE),
    ("end switch, retracted", RETRACTED_END),
    ("end switch, pushed in", PUSHED_END),
    ("emergency stop", EMERGENCY_STOP),
    ("light", LIGHT),
];

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;

    #[test]
    fn no_two_functions_share_a_pin() {
        for (i, (_, a)) in PINS.iter().enumerate() {
            for (_, b) in &PINS[i + 1..] {
                assert_ne!(a.arduino, b.arduino);
                assert_ne!((a.port, a.bit), (b.port, b.bit));
            }
        }
    }

    #[test]
    fn the_table_that_people_solder_by_says_the_same() {
        let page = include_str!("../../docs/hardware/wiring.md");
        for (name, pin) in PINS {
            let port = char::from(pin.port);
            let row = std::format!("| {name} | {} | P{port}{} |", pin.arduino, pin.bit);
            assert!(page.contains(&row), "{row}");
        }
        for (name, channel) in [
            ("pressure sensor", PRESSURE_CHANNEL),
            ("flex sensor", FLEX_CHANNEL),
        ] {
            let row = std::format!("| {name} | A{channel} | PF{channel} |");
            assert!(page.contains(&row), "{row}");
        }
    }

    #[test]
    fn addresses_are_those_of_the_data_sheet() {
        assert_eq!(DIRECTION.port_address(), 0x02);
        assert_eq!(STEP.port_address(), 0x05);
        assert_eq!(EMERGENCY_STOP.port_address(), 0x0b);
        assert_eq!(RETRACTED_END.port_address(), 0x0e);
        assert!(PINS.iter().all(|(_, pin)| pin.port <= b'G' && pin.bit < 8));
    }
}
