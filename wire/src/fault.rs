//! Faults: why the board stopped by itself.
//!
//! A fault has a code (in every telemetry line), a name, and a sentence for the
//! operator that says what to do. The texts are `const`, so that the board can
//! keep them in flash and the computer can print them without asking.

macro_rules! faults {
    ($( $(#[$doc:meta])* $variant:ident = $code:literal, $name:literal, $sentence:literal; )+) => {
        /// A latched fault. Whatever it is: pump off, valve open.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum Fault {
            $( $(#[$doc])* $variant = $code, )+
        }

        impl Fault {
            /// Every fault, in the order of the codes.
            pub const ALL: &'static [Self] = &[$( Self::$variant ),+];

            /// The number in telemetry; zero means no fault.
            pub const fn code(self) -> u8 {
                self as u8
            }

            /// The fault behind a code.
            pub const fn from_code(code: u8) -> Option<Self> {
                Some(match code {
                    $( $code => Self::$variant, )+
                    _ => return None,
                })
            }

            /// A short name for recordings and screens.
            pub const fn name(self) -> &'static str {
                match self { $( Self::$variant => $name, )+ }
            }

            /// Cause and advice, for the operator.
            pub const fn sentence(self) -> &'static str {
                match self { $( Self::$variant => $sentence, )+ }
            }
        }
    };
}

faults! {
    /// The emergency-stop circuit is open.
    EmergencyStop = 1, "emergency stop",
        "The emergency stop was pressed or its wire is broken: release it, look at the rig, then clear.";
    /// The pressure is above its limit.
    OverPressure = 2, "over-pressure",
        "The pressure exceeded its limit: look for a blocked tube, or raise the limit if the actuator stands it.";
    /// The bending angle is above its limit.
    OverAngle = 3, "over-angle",
        "The bending angle exceeded its limit: check the flex sensor's calibration and the model's gain.";
    /// The pressure sensor is open, shorted or stuck.
    PressureSensor = 4, "pressure sensor",
        "The pressure sensor's voltage is impossible: check its three wires and its 5 V supply.";
    /// The flex sensor is open, shorted or stuck.
    FlexSensor = 5, "flex sensor",
        "The flex sensor's voltage is impossible or frozen: check its wires and the 47 kOhm resistor.";
    /// The pump moves and the pressure does not follow, or homing finds no switch.
    Stall = 6, "stall",
        "The pump turned but nothing followed: check motor, driver supply, syringe, and the tube for a leak.";
    /// An end switch opened while the plunger moved towards it.
    EndSwitch = 7, "end switch",
        "The plunger ran into an end switch: home it again, and ask for less volume.";
    /// Nothing was heard from the computer while the rig was armed.
    HostLost = 8, "computer lost",
        "The computer fell silent while the rig was armed: check the cable, then start the run again.";
    /// The watchdog reset the board.
    Watchdog = 9, "watchdog",
        "The firmware hung and the watchdog restarted it: note what you did and report it.";
    /// The supply voltage dipped.
    BrownOut = 10, "brown-out",
        "The supply voltage dipped: give the motor driver a supply of its own.";
    /// No valid settings were found.
    Settings = 11, "settings",
        "The stored settings are damaged and defaults are in use: upload model and calibration, then clear.";
    /// A control period took longer than it may.
    Overrun = 12, "overrun",
        "A control period took too long: the model has more effects than this processor can step.";
    /// The firmware reached a state that it excludes.
    Internal = 13, "internal",
        "The firmware found itself in an impossible state and stopped: report it.";
    /// Homing leaves the retracted switch, and it stays pressed.
    RetractedSwitch = 14, "retracted switch",
        "The retracted switch does not let go of the plunger: it is stuck, its wire is broken, or the motor does not turn, or the other way.";
    /// Homing looks for the retracted switch and comes to the other one.
    MotorReversed = 15, "motor direction",
        "The plunger came to the wrong end: swap the two wires of one motor coil, and look whether it turns at all.";
    /// The pressure is not near zero long after the valve was opened.
    Vent = 16, "vent",
        "The valve is open and the pressure stays: look for a blocked vent or a moved zero of the sensor before touching the actuator.";
    /// The pump is at the end of its stroke and far from the pressure set-point.
    Reach = 17, "out of reach",
        "The pump is at the end of its stroke and the pressure was not reached: look for a leak, or ask for less.";
    /// In closed loop, the sensor shows less than half or more than twice of the prediction.
    Disagreement = 18, "disagreement",
        "The flex sensor and the model show different angles, so the loop would drive blindly: check the sensor, or upload a model that fits.";
    /// The volume pushed in allows a pressure above the limit, and the sensor shows less.
    GasLaw = 19, "gas law",
        "By the volume pushed in, the pressure may be higher than the sensor shows: look for a leak, or check the pressure sensor's zero.";
    /// The board was armed when it restarted, and nothing says why it did.
    Restart = 20, "restart",
        "The board restarted while the rig was armed: look at the supply and the cable, then home it again.";
    /// The checksum of the flash is not that of the image that was built.
    Image = 21, "image",
        "The firmware in the board's flash is damaged or only half uploaded: upload it again.";
    /// Volume was pushed in with the valve closed, and the pressure sensor did not show it.
    Blind = 22, "blind",
        "Air was pushed in and the pressure sensor did not show it: look for a kinked tube to sensor or vent, a vent that stays open, a leak.";
    /// The pressure sensor shows the pressure later than the pump's speed allows.
    Late = 23, "late sensor",
        "The pressure sensor is too late for this pump: look for a clogged or long tube to it, or lower max.flow.";
    /// The converter's reference moved while the rig was armed.
    Supply = 24, "supply",
        "The 5 V of the board moved while the rig was armed: look at the USB cable, and at what else hangs on 5 V.";
    /// Both sensors moved alike while nothing was pushed.
    Ground = 25, "ground",
        "Both sensors moved alike while nothing was pushed: look at their common ground and 5 V wires.";
}

#[cfg(test)]
mod tests {
    use super::Fault;

    #[test]
    fn codes_lead_back_and_none_is_zero() {
        for &fault in Fault::ALL {
            assert_eq!(Fault::from_code(fault.code()), Some(fault));
            assert_ne!(fault.code(), 0);
        }
        assert_eq!(Fault::from_code(0), None);
    }

    #[test]
    fn texts_are_plain_and_different() {
        for (i, &fault) in Fault::ALL.iter().enumerate() {
            assert!(fault.name().is_ascii() && fault.sentence().is_ascii());
            assert!(fault.sentence().contains(": ") && fault.sentence().ends_with('.'));
            for &other in &Fault::ALL[i + 1..] {
                assert_ne!(fault.name(), other.name());
                assert_ne!(fault.sentence(), other.sentence());
            }
        }
    }
}
