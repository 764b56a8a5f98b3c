//! Parses lines from bytes.

use wire::line::open_bytes;
use wire::reply::{Refusal, Reply};
use wire::telemetry::{Telemetry, TelemetryError};
use wire::text::Text;

/// The longest line that is read; the board's are far shorter.
pub const MAX_LINE: usize = 256;

/// A line from the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Incoming {
    /// A sample.
    Sample(Telemetry),
    /// A reply to a request.
    Reply {
        /// The number of the request.
        id: u8,
        /// Its text, or why not.
        outcome: Result<String, Refusal>,
    },
    /// A remark for people, without its `# `.
    Remark(String),
    /// A line that arrived whole and that this version does not know.
    Other(String),
    /// A line that was damaged on the way.
    Damaged,
}

impl Incoming {
    /// Reads a line, with or without its end.
    pub fn parse(line: &[u8]) -> Self {
        let Ok(text) = open_bytes(line) else {
            return Self::Damaged;
        };
        match Telemetry::parse(line) {
            Ok(sample) => return Self::Sample(sample),
            Err(TelemetryError::OtherLine) => {}
            Err(_) => return Self::other(text),
        }
        // Up to version 2 without the colon.
        if let Some(remark) = text.strip_prefix(b"#:").or(text.strip_prefix(b"#")) {
            return Self::Remark(String::from_utf8_lossy(remark).trim().to_owned());
        }
        match std::str::from_utf8(line).map(Reply::parse) {
            Ok(Ok(Some(reply))) => Self::Reply {
                id: reply.id,
                outcome: reply.outcome.map(str::to_owned),
            },
            _ => Self::other(text),
        }
    }

    fn other(text: &[u8]) -> Self {
        Self::Other(String::from_utf8_lossy(text).into_owned())
    }

    /// Whether it arrived as it was sent.
    pub fn is_whole(&self) -> bool {
        *self != Self::Damaged
    }
}

/// The line of a request on the wire, with its line end.
pub fn request_text(request: &wire::command::Request) -> String {
    let mut text = Text::default();
    let Ok(()) = request.write(&mut text);
    text.0
}

/// A command as a person would type it: without number and checksum.
pub fn command_text(command: wire::command::Command) -> String {
    let sealed = request_text(&wire::command::Request { id: 0, command });
    sealed
        .strip_prefix("0 ")
        .and_then(|rest| rest.rsplit_once(" *"))
        .map_or_else(|| sealed.clone(), |(text, _)| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::command::Command;

    fn sealed(text: &str) -> Vec<u8> {
        wire::text::sealed(text).into_bytes()
    }

    #[test]
    fn lines_are_told_apart() {
        let sample =
            "T 5 50 pressure:1.00 angle:nan predicted:2.50 setpoint:3.00 volume:-0.007 x9!";
        assert!(matches!(
            Incoming::parse(&sealed(sample)),
            Incoming::Sample(Telemetry {
                sequence: 5,
                angle_deg: None,
                fault: 9,
                mismatch: true,
                ..
            })
        ));
        assert_eq!(
            Incoming::parse(&sealed("A: 7 ok 3f800000")),
            Incoming::Reply {
                id: 7,
                outcome: Ok("3f800000".into())
            }
        );
        assert_eq!(
            Incoming::parse(&sealed("A: 7 no 4")),
            Incoming::Reply {
                id: 7,
                outcome: Err(Refusal::Faulted)
            }
        );
        assert_eq!(
            Incoming::parse(&sealed("#: softrig 0.1.0")),
            Incoming::Remark("softrig 0.1.0".into())
        );
        assert_eq!(
            Incoming::parse(&sealed("T 5 50 p:1.00 a:2.00")),
            Incoming::Other("T 5 50 p:1.00 a:2.00".into())
        );
        let mut damaged = sealed(sample);
        damaged[3] ^= 4;
        assert_eq!(Incoming::parse(&damaged), Incoming::Damaged);
        assert_eq!(Incoming::parse(b"\xff\xfe"), Incoming::Damaged);
    }

    #[test]
    fn commands_are_shown_as_they_would_be_typed() {
        assert_eq!(command_text(Command::Arm), "arm");
        assert_eq!(
            command_text(Command::Run(Some(wire::protocol::Named::Paper))),
            "run paper"
        );
    }
}
