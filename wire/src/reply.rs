//! Replies of the board.
//!
//! ```text
//! A: 17 ok *8492
//! A: 18 no 3 *1b06
//! ```
//!
//! A reply is `A:`, the number of the request, and `ok` with the answer or `no` with the code of a
//! [`Refusal`]. Lines that begin with `#:` are remarks for people. The colons are for the serial
//! plotter of the Arduino IDE, which would draw the numbers of a line without one.

use core::fmt;

use ufmt::{uWrite, uwrite};

use crate::{
    fields::{Fields, number},
    line::{LineError, Sealed, open},
};

/// The version of everything in this crate, including the meaning of the settings; board
/// and computer must agree on it.
pub const VERSION: u8 = 3;

/// How a remark for people begins: the banner after a reset, help, the sentence of a fault.
pub const REMARK: &str = "#: ";

macro_rules! refusals {
    ($( $(#[$doc:meta])* $variant:ident = $code:literal, $sentence:literal; )+) => {
        /// Why a request that arrived whole is not obeyed.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(u8)]
        pub enum Refusal {
            $( $(#[$doc])* $variant = $code, )+
        }

        impl Refusal {
            /// Every one.
            pub const ALL: &'static [Self] = &[$( Self::$variant ),+];

            /// The number in the reply.
            pub const fn code(self) -> u8 {
                self as u8
            }

            /// The refusal behind a number.
            pub const fn from_code(code: u8) -> Option<Self> {
                Some(match code { $( $code => Self::$variant, )+ _ => return None })
            }

            /// Its meaning, and advice.
            pub const fn sentence(self) -> &'static str {
                match self { $( Self::$variant => $sentence, )+ }
            }
        }
    };
}

refusals! {
    /// No such command, or not these arguments.
    Unknown = 1, "the board does not know this command: do the firmware and `softrig` match?";
    /// The line has no checksum and asks for more than a look.
    Unsealed = 2, "commands that move or change something need a checksum: use `softrig`";
    /// Not in this state.
    NotNow = 3, "not in this state: stop what is running first, arm the rig, or wait some seconds after an upload or a reset";
    /// A fault is latched.
    Faulted = 4, "a fault is latched: remove its cause, then clear it";
    /// The cause of the fault is still there.
    StillThere = 5, "the cause of the fault is still there";
    /// A value is outside its bounds.
    OutOfBounds = 6, "the value is outside its bounds";
    /// The draft of the settings does not make sense as a whole.
    BadSettings = 7, "the settings do not fit together: set.kpa and set.deg may not exceed max.kpa and max.deg, nor these the range of the sensors; ul.step is too small for a screw whose stroke takes more than two minutes; max.flow has to be reached within 2 s of max.acc; otherwise look at the model's effects, whether it is too fast for the board, and at the calibration table";
    /// The protocol is incomplete or asks for more than the limits.
    BadProtocol = 8, "the protocol is incomplete or exceeds the board's limits";
    /// The EEPROM did not keep what was written.
    Storage = 9, "the EEPROM did not keep the settings: it may be worn out";
    /// The sensors do not rest.
    NotAtRest = 10, "the sensors do not rest: wait, and try again";
    /// A sensor has no reading.
    NoReading = 11, "a sensor has no valid reading: check its wires";
    /// The valve is open, and the pressure is not near zero.
    Pressurised = 12, "the valve is open and the pressure does not read zero within 5 kPa: wait until the air is out, look for a blocked vent, then tare or calibrate the pressure sensor";
    /// Nothing is remembered under this number.
    Nothing = 13, "nothing is stored under this number";
    /// The largest volume is beyond the stroke that was measured, or beyond the smallest one where
    /// none was.
    BeyondStroke = 14, "max.ul exceeds the stroke between the end switches, or 50 ml as long as it was not measured with this ul.step: ask for less, or measure it with `softrig commission --only stroke`";
    /// The supply is too low to move anything.
    LowSupply = 15, "the board's supply is below 4.5 V: use another cable or port, or give the Mega 7 to 9 V of its own, and nothing else from its 5 V";
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.sentence())
    }
}

impl core::error::Error for Refusal {}

/// A reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reply<'t> {
    /// The number of the request.
    pub id: u8,
    /// The outcome: text, often empty, or the reason of the refusal.
    pub outcome: Result<&'t str, Refusal>,
}

/// Starts a reply that says `ok`; whatever is written next is its text, after a
/// space.
///
/// # Errors
///
/// Errors of the output.
pub fn ok<W: uWrite + ?Sized>(out: &mut W, id: u8) -> Result<Sealed<'_, W>, W::Error> {
    let mut line = Sealed::new(out);
    uwrite!(line, "A: {} ok", id)?;
    Ok(line)
}

/// Writes a reply that says `no`.
///
/// # Errors
///
/// Errors of the output.
pub fn no<W: uWrite + ?Sized>(out: &mut W, id: u8, refusal: Refusal) -> Result<(), W::Error> {
    let mut line = Sealed::new(out);
    uwrite!(line, "A: {} no {}", id, refusal.code())?;
    line.finish()
}

impl<'t> Reply<'t> {
    /// Reads a reply; `Ok(None)` for a sealed line of another kind.
    ///
    /// # Errors
    ///
    /// [`LineError`] for a line that cannot be trusted.
    pub fn parse(line: &'t str) -> Result<Option<Self>, LineError> {
        let text = open(line)?;
        Ok(Self::parse_text(text))
    }

    fn parse_text(text: &'t str) -> Option<Self> {
        // Without the colon, as up to version 2: so what such a board answers to `hello` is
        // understood, and it can be told that it is old.
        let rest = text
            .strip_prefix("A: ")
            .or_else(|| text.strip_prefix("A "))?;
        let mut fields = Fields::new(rest.as_bytes());
        let id = fields.number()?;
        let outcome = match fields.next()? {
            b"ok" => Ok(core::str::from_utf8(fields.rest()).ok()?),
            b"no" => Err(Refusal::from_code(number(fields.rest())?)?),
            _ => return None,
        };
        Some(Self { id, outcome })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::text::{Text, sealed};

    #[test]
    fn replies_are_read_back() {
        let mut out = Text::default();
        let mut line = ok(&mut out, 255).unwrap();
        uwrite!(line, " {} and more", 12).unwrap();
        line.finish().unwrap();
        assert_eq!(
            Reply::parse(&out.0),
            Ok(Some(Reply {
                id: 255,
                outcome: Ok("12 and more")
            }))
        );
        let mut out = Text::default();
        ok(&mut out, 3).unwrap().finish().unwrap();
        assert_eq!(
            Reply::parse(&out.0),
            Ok(Some(Reply {
                id: 3,
                outcome: Ok("")
            }))
        );
        for &refusal in Refusal::ALL {
            let mut out = Text::default();
            no(&mut out, 7, refusal).unwrap();
            assert_eq!(
                Reply::parse(&out.0),
                Ok(Some(Reply {
                    id: 7,
                    outcome: Err(refusal)
                }))
            );
        }
    }

    #[test]
    fn other_lines_are_told_apart() {
        assert_eq!(Reply::parse(&sealed("#: softrig")), Ok(None));
        assert_eq!(Reply::parse(&sealed("A: 1 no 200")), Ok(None));
        assert!(Reply::parse("A: 1 ok").is_err());
    }

    #[test]
    fn a_board_of_an_older_version_can_say_so() {
        let hello = "softrig 0.1.0 wire 2 settings 1a2b";
        assert_eq!(
            Reply::parse(&sealed(&std::format!("A 254 ok {hello}"))),
            Ok(Some(Reply {
                id: 254,
                outcome: Ok(hello)
            }))
        );
    }
}
