//! What is behind an open port: it reads lines, and keeps an armed board alive.
//!
//! [`threads`] has a thread for either. A browser has none to give: [`pump`] does both whenever the
//! program waits for a line.

use std::io;

use softrig_formats::instant::Instant;
use wire::assemble::{Assembled, Assembler};
use wire::command::{Command, Request};
use wire::state::State;

use super::heart::Heart;
use super::line::{Incoming, MAX_LINE};

#[cfg(any(test, target_family = "wasm"))]
mod pump;
#[cfg(not(target_family = "wasm"))]
mod threads;

#[cfg(target_family = "wasm")]
pub(super) use pump::Worker;
#[cfg(not(target_family = "wasm"))]
pub(super) use threads::Worker;

/// The number of every beat; replies to it are for nobody.
pub(super) const BEAT_ID: u8 = 255;

/// The sign of life that the board of an armed rig waits for.
const BEAT: Request = Request {
    id: BEAT_ID,
    command: Command::Beat,
};

/// A message from whoever reads.
#[derive(Debug)]
pub(super) enum FromBoard {
    /// A line and when it arrived.
    Line(Incoming, Instant),
    /// The connection broke.
    Lost(String),
}

/// The bytes that came since the last sample, whatever they were.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Heard {
    /// How many.
    bytes: u64,
    /// The first of them.
    first: Vec<u8>,
    /// The byte that each of them was, as long as all were the same.
    only: Option<u8>,
}

impl Heard {
    /// Bytes that are kept to be shown.
    const SHOWN: usize = 24;

    fn take(&mut self, bytes: &[u8]) {
        let Some(&begins) = bytes.first() else {
            return;
        };
        if self.bytes == 0 {
            self.only = Some(begins);
        }
        if self
            .only
            .is_some_and(|only| bytes.iter().any(|&byte| byte != only))
        {
            self.only = None;
        }
        self.bytes += bytes.len() as u64;
        let missing = Self::SHOWN.saturating_sub(self.first.len());
        self.first.extend(bytes.iter().take(missing));
    }

    /// Whether nothing came.
    pub(super) fn is_nothing(&self) -> bool {
        self.bytes == 0
    }
}

impl std::fmt::Display for Heard {
    /// What came, to follow "PORT: ".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plural = if self.bytes == 1 { "byte" } else { "bytes" };
        match self.only {
            Some(byte) if self.bytes > 1 => write!(
                f,
                "{} {plural} came, each 0x{byte:02x}: a line that is held at one level, or another baud rate",
                self.bytes
            ),
            _ => write!(
                f,
                "{} {plural} came, which begin with \"{}\"",
                self.bytes,
                self.first.escape_ascii()
            ),
        }
    }
}

/// The bytes of a read, of which none is no error; an error means that the port is gone.
fn received(read: io::Result<usize>) -> Result<usize, String> {
    match read {
        Ok(0) => Err(io::Error::from(io::ErrorKind::UnexpectedEof).to_string()),
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted
            ) =>
        {
            Ok(0)
        }
        other => other.map_err(|error| error.to_string()),
    }
}

/// Lines from bytes.
struct Lines {
    assembler: Assembler<MAX_LINE>,
    /// A port is opened in the middle of a line more often than not.
    is_first: bool,
}

impl Lines {
    fn new() -> Self {
        Self {
            assembler: Assembler::new(),
            is_first: true,
        }
    }

    /// The lines that end with these bytes; whether a board is armed goes to its heart, and a
    /// sample ends what was heard instead of one.
    fn take(&mut self, bytes: &[u8], heart: &Heart, heard: &mut Heard) -> Vec<FromBoard> {
        heart.read(bytes.len());
        heard.take(bytes);
        let now = Instant::now();
        let mut lines = Vec::new();
        for &byte in bytes {
            let incoming = match self.assembler.push(byte) {
                Assembled::Pending => continue,
                Assembled::Line(line) => Incoming::parse(line),
                Assembled::Overlong => Incoming::Damaged,
            };
            if std::mem::take(&mut self.is_first) && !incoming.is_whole() {
                continue;
            }
            if let Incoming::Sample(sample) = &incoming {
                *heard = Heard::default();
                let armed = matches!(sample.state, State::Homing | State::Ready | State::Running);
                heart.note(armed, sample.time_ms);
            }
            lines.push(FromBoard::Line(incoming, now));
        }
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(pieces: &[&[u8]]) -> String {
        let mut heard = Heard::default();
        for piece in pieces {
            heard.take(piece);
        }
        heard.to_string()
    }

    #[test]
    fn what_came_is_said_by_its_number_and_its_beginning() {
        assert!(heard(&[b"\0\0", b"", b"\0"]).starts_with("3 bytes came, each 0x00"));
        assert_eq!(
            heard(&[b"Grbl 1.1h\r\n", b"\xff"]),
            "12 bytes came, which begin with \"Grbl 1.1h\\r\\n\\xff\""
        );
        let long = heard(&[&[b'x', b'y'].repeat(10_000)]);
        assert!(
            long.starts_with("20000 bytes") && long.len() < 100,
            "{long}"
        );
        assert!(Heard::default().is_nothing());
    }
}
