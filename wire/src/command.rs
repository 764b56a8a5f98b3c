//! Requests of the computer to the board.
//!
//! ```text
//! 17 set damping 3fe66666 *9c41
//! ```
//!
//! A line has a number that the reply repeats, a word, its arguments, and the checksum. A
//! person at a serial monitor cannot compute a checksum, so lines without one are read too,
//! but they can only query or stop: `status`, `stop`, `help`. A command that moves the pump
//! or changes a setting must be sealed by a checksum.

use ufmt::{uWrite, uwrite};

use crate::{
    decimal::Word,
    fields::{Fields, word},
    keyword::Keyword,
    line::{LineError, Sealed, open_bytes, trimmed},
    protocol::{MAX_SEGMENTS, Named, Segment},
    settings::Key,
};

/// The longest line that the board reads, without its end.
pub const MAX_LINE: usize = 64;

/// A command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Who are you? Answered by the version handshake.
    Hello,
    /// The computer is alive.
    Beat,
    /// List the commands that can be typed.
    Help,
    /// State, fault with its sentence, counters.
    Status,
    /// Model steps and their bits; only while idle.
    SelfTest,
    /// Home the plunger, close the valve, be ready.
    Arm,
    /// Back to idle.
    Disarm,
    /// Play the protocol that was loaded, or one that the board knows.
    Run(Option<Named>),
    /// Pump off, valve open, now.
    Stop,
    /// Leave the fault state, if its cause is gone.
    Clear,
    /// Make the sensors' present readings zero.
    Tare,
    /// A protocol of so many segments follows.
    Load(u8),
    /// One of them.
    Segment {
        /// Its place.
        index: u8,
        /// The segment.
        segment: Segment,
    },
    /// Change a setting in the draft.
    Set {
        /// Which.
        key: Key,
        /// Its bits.
        bits: u32,
    },
    /// The bits of a setting in use.
    Get(Key),
    /// Check the draft, use it, and write it to EEPROM.
    Save,
    /// Drop the draft.
    Discard,
    /// The sensors in counts.
    Raw,
    /// The predictor's state to the bit.
    Exact,
    /// A fault of the log: 0 for the latest; see [`crate::history::FaultRecord`]. Only at rest.
    Log(u8),
    /// The second before the latched fault: 0 for the fault, then back in time; see
    /// [`crate::history::Moment`].
    Past(u8),
    /// The switches, open or closed.
    Switches,
    /// Home, measure the stroke between the end switches, home again, be ready.
    Stroke,
    /// What the board found out about its pump and its supply; see [`crate::answer::Machine`].
    Machine,
}

const HELLO: Keyword = Keyword::of("hello");
const BEAT: Keyword = Keyword::of("beat");
const HELP: Keyword = Keyword::of("help");
const STATUS: Keyword = Keyword::of("status");
const SELF_TEST: Keyword = Keyword::of("selftest");
const ARM: Keyword = Keyword::of("arm");
const DISARM: Keyword = Keyword::of("disarm");
const RUN: Keyword = Keyword::of("run");
const STOP: Keyword = Keyword::of("stop");
const CLEAR: Keyword = Keyword::of("clear");
const TARE: Keyword = Keyword::of("tare");
const LOAD: Keyword = Keyword::of("load");
const SEGMENT: Keyword = Keyword::of("seg");
const SET: Keyword = Keyword::of("set");
const GET: Keyword = Keyword::of("get");
const SAVE: Keyword = Keyword::of("save");
const DISCARD: Keyword = Keyword::of("discard");
const RAW: Keyword = Keyword::of("raw");
const EXACT: Keyword = Keyword::of("exact");
const LOG: Keyword = Keyword::of("log");
const PAST: Keyword = Keyword::of("past");
const SWITCHES: Keyword = Keyword::of("switches");
const STROKE: Keyword = Keyword::of("stroke");
const MACHINE: Keyword = Keyword::of("machine");

/// A command and the number that its reply repeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Request {
    /// The number; zero for a line without one.
    pub id: u8,
    /// The command.
    pub command: Command,
}

/// Why a received line is rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Rejection {
    /// It was damaged on the way. No reply: its number cannot be trusted.
    Damaged(LineError),
    /// No such command, or not these arguments.
    Unknown {
        /// The number of the request.
        id: u8,
    },
    /// It needs a checksum and has none.
    Unsealed,
}

impl Command {
    /// Whether it is accepted without a checksum, because it only queries or stops.
    pub const fn is_harmless(&self) -> bool {
        matches!(
            self,
            Self::Hello
                | Self::Help
                | Self::Status
                | Self::SelfTest
                | Self::Stop
                | Self::Disarm
                | Self::Get(_)
                | Self::Raw
                | Self::Exact
                | Self::Log(_)
                | Self::Past(_)
                | Self::Switches
                | Self::Machine
        )
    }

    fn parse(text: &[u8]) -> Option<Self> {
        let mut fields = Fields::new(text);
        let command = match Keyword::parse(fields.next()?)? {
            HELLO => Self::Hello,
            BEAT => Self::Beat,
            HELP => Self::Help,
            STATUS => Self::Status,
            SELF_TEST => Self::SelfTest,
            ARM => Self::Arm,
            DISARM => Self::Disarm,
            RUN => Self::Run(match fields.next() {
                None => None,
                Some(name) => Some(Named::parse(name)?),
            }),
            STOP => Self::Stop,
            CLEAR => Self::Clear,
            TARE => Self::Tare,
            LOAD => Self::Load(
                fields
                    .number()
                    .filter(|count| (1..=MAX_SEGMENTS).contains(count))?,
            ),
            SEGMENT => {
                let index = fields.number().filter(|&index| index < MAX_SEGMENTS)?;
                let segment = Segment::parse(fields.rest())?;
                return Some(Self::Segment { index, segment });
            }
            SET => Self::Set {
                key: Key::parse(fields.next()?)?,
                bits: word(fields.next()?)?,
            },
            GET => Self::Get(Key::parse(fields.next()?)?),
            SAVE => Self::Save,
            DISCARD => Self::Discard,
            RAW => Self::Raw,
            EXACT => Self::Exact,
            LOG => Self::Log(fields.number()?),
            PAST => Self::Past(fields.number()?),
            SWITCHES => Self::Switches,
            STROKE => Self::Stroke,
            MACHINE => Self::Machine,
            _ => return None,
        };
        fields.is_empty().then_some(command)
    }
}

impl Request {
    /// Writes the request as one sealed line.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn write<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        let mut line = Sealed::new(out);
        uwrite!(line, "{} ", self.id)?;
        let simple = match self.command {
            Command::Hello => HELLO,
            Command::Beat => BEAT,
            Command::Help => HELP,
            Command::Status => STATUS,
            Command::SelfTest => SELF_TEST,
            Command::Arm => ARM,
            Command::Disarm => DISARM,
            Command::Run(None) => RUN,
            Command::Stop => STOP,
            Command::Clear => CLEAR,
            Command::Tare => TARE,
            Command::Save => SAVE,
            Command::Discard => DISCARD,
            Command::Raw => RAW,
            Command::Exact => EXACT,
            Command::Switches => SWITCHES,
            Command::Stroke => STROKE,
            Command::Machine => MACHINE,
            Command::Run(Some(named)) => {
                uwrite!(line, "{} {}", RUN, named.keyword())?;
                return line.finish();
            }
            Command::Load(number) | Command::Log(number) | Command::Past(number) => {
                let word = match self.command {
                    Command::Log(_) => LOG,
                    Command::Past(_) => PAST,
                    _ => LOAD,
                };
                uwrite!(line, "{} {}", word, number)?;
                return line.finish();
            }
            Command::Segment { index, segment } => {
                uwrite!(line, "{} {} ", SEGMENT, index)?;
                segment.write(&mut line)?;
                return line.finish();
            }
            Command::Set { key, bits } => {
                uwrite!(line, "{} ", SET)?;
                key.write(&mut line)?;
                uwrite!(line, " {}", Word(bits))?;
                return line.finish();
            }
            Command::Get(key) => {
                uwrite!(line, "{} ", GET)?;
                key.write(&mut line)?;
                return line.finish();
            }
        };
        uwrite!(line, "{}", simple)?;
        line.finish()
    }

    /// Reads a line that arrived at the board.
    ///
    /// # Errors
    ///
    /// [`Rejection`]; such a line changes nothing.
    pub fn parse(line: &[u8]) -> Result<Self, Rejection> {
        let text = match open_bytes(line) {
            Ok(text) => text,
            Err(LineError::NoChecksum) => {
                let text = trimmed(line);
                return match Command::parse(text) {
                    Some(command) if command.is_harmless() => Ok(Self { id: 0, command }),
                    Some(_) => Err(Rejection::Unsealed),
                    None => Err(Rejection::Unknown { id: 0 }),
                };
            }
            Err(error) => return Err(Rejection::Damaged(error)),
        };
        let mut fields = Fields::new(text);
        let id = fields.number().ok_or(Rejection::Unknown { id: 0 })?;
        match Command::parse(fields.rest()) {
            Some(command) => Ok(Self { id, command }),
            None => Err(Rejection::Unknown { id }),
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::testing::every_command;
    use crate::text::{Text, sealed};
    use proptest::prelude::*;
    use std::string::String;

    fn line(request: &Request) -> String {
        let mut out = Text::default();
        request.write(&mut out).unwrap();
        out.0
    }

    #[test]
    fn every_command_is_read_back_and_fits_a_line() {
        for (id, command) in (0..=255).cycle().zip(every_command()) {
            let request = Request { id, command };
            let text = line(&request);
            assert_eq!(Request::parse(text.as_bytes()), Ok(request), "{text}");
            assert!(text.trim_end().len() <= MAX_LINE, "{text}");
        }
    }

    #[test]
    fn without_a_checksum_one_may_only_ask_or_stop() {
        for text in ["status", "stop", "help\r\n", "get damping", "disarm"] {
            assert!(Request::parse(text.as_bytes()).is_ok(), "{text}");
        }
        for text in [
            "arm",
            "run",
            "run paper",
            "set damping 3f800000",
            "save",
            "clear",
            "beat",
            "stroke",
        ] {
            assert_eq!(
                Request::parse(text.as_bytes()),
                Err(Rejection::Unsealed),
                "{text}"
            );
        }
        // A number does not make it a sealed line.
        assert!(Request::parse(b"3 arm").is_err());
    }

    #[test]
    fn a_damaged_line_has_no_number_to_reply_to() {
        let mut bytes = line(&Request {
            id: 9,
            command: Command::Arm,
        })
        .into_bytes();
        bytes[2] ^= 1;
        assert!(matches!(
            Request::parse(&bytes),
            Err(Rejection::Damaged(LineError::WrongChecksum { .. }))
        ));
        // Nor can any request stop the main program.
        for text in ["9 fly away", "9 hang"] {
            assert_eq!(
                Request::parse(sealed(text).as_bytes()),
                Err(Rejection::Unknown { id: 9 })
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn no_bytes_are_a_panic_and_none_by_chance_a_motion(bytes in prop::collection::vec(any::<u8>(), 0..80)) {
            if let Ok(request) = Request::parse(&bytes) {
                prop_assert!(request.command.is_harmless());
            }
        }

        #[test]
        fn one_wrong_bit_is_never_another_command(
            which in 0..every_command().len(), place: prop::sample::Index, bit in 0..8u8,
        ) {
            let request = Request { id: 77, command: every_command()[which] };
            let mut bytes = line(&request).trim_end().as_bytes().to_vec();
            let place = place.index(bytes.len());
            bytes[place] ^= 1 << bit;
            prop_assert!(Request::parse(&bytes).is_err());
        }
    }
}
