//! Lines of the cable.

use softrig_link::line::request_text;
use ufmt::uWrite;
use wire::{
    assemble::{Assembled, Assembler},
    command::{Command, MAX_LINE, Rejection, Request},
    line::{LineError, open_bytes},
    reply::{self, Reply},
    telemetry::{Telemetry, TelemetryError},
    text::{Text, sealed},
};

/// Runs a check on the bytes as they are, and on every line of them with a checksum, which no
/// fuzzer finds by trying.
fn as_is_and_sealed(bytes: &[u8], check: impl Fn(&[u8])) {
    check(bytes);
    for line in String::from_utf8_lossy(bytes).lines() {
        check(sealed(line).as_bytes());
    }
}

/// Lines that arrive at the board.
///
/// # Panics
///
/// When a promise is broken: a request that was read and written reads back the same;
/// what has no checksum may only ask or stop; one wrong bit makes a damaged line of a
/// sealed one; whatever came before it, a good line is read, and none is longer than
/// the board's buffer.
pub fn requests(bytes: &[u8]) {
    as_is_and_sealed(bytes, request);
    let stop = request_text(&Request {
        id: 9,
        command: Command::Stop,
    });
    let mut assembler: Assembler<MAX_LINE> = Assembler::new();
    let mut last = Vec::new();
    let end = [b"\n", stop.as_bytes()].concat();
    for &byte in bytes.iter().chain(&end) {
        if let Assembled::Line(line) = assembler.push(byte) {
            assert!(!line.is_empty() && line.len() <= MAX_LINE);
            last = line.to_vec();
        }
    }
    assert_eq!(last, stop.trim_end().as_bytes(), "a line is lost");
}

fn request(line: &[u8]) {
    let is_sealed = open_bytes(line).is_ok();
    match Request::parse(line) {
        Ok(request) => {
            let again = request_text(&request);
            assert_eq!(Request::parse(again.as_bytes()), Ok(request), "{again}");
            if !is_sealed {
                assert!(request.command.is_harmless() && request.id == 0);
            }
            // The board can read whatever a computer can ask.
            assert!(again.trim_end().len() <= MAX_LINE, "{again}");
            if is_sealed {
                one_wrong_bit(line);
            }
        }
        Err(Rejection::Damaged(LineError::NoChecksum) | Rejection::Unsealed) => {
            assert!(!is_sealed);
        }
        Err(_) => {}
    }
}

fn one_wrong_bit(line: &[u8]) {
    for place in 0..line.len() {
        for bit in 0..8 {
            let mut damaged = line.to_vec();
            damaged[place] ^= 1 << bit;
            // A line end is no part of what is sealed.
            if let Ok(request) = Request::parse(&damaged) {
                let is_end = place + 2 >= line.len() && line.ends_with(b"\n");
                assert!(request.command.is_harmless() || is_end, "{place} {bit}");
            }
        }
    }
}

/// Lines of telemetry that arrive at the computer.
///
/// # Panics
///
/// When a sample that was read and written reads back another, or a damaged line is
/// taken for a sample.
pub fn telemetry(bytes: &[u8]) {
    as_is_and_sealed(bytes, |line| match Telemetry::parse(line) {
        Ok(sample) => {
            let mut out = Text::default();
            let Ok(()) = sample.write(&mut out);
            assert_eq!(Telemetry::parse(out.0.as_bytes()), Ok(sample), "{}", out.0);
            assert!(out.0.is_ascii());
        }
        Err(TelemetryError::Line(_)) => assert!(open_bytes(line).is_err()),
        Err(_) => assert!(open_bytes(line).is_ok()),
    });
}

/// Replies that arrive at the computer.
///
/// # Panics
///
/// When a reply that was read and written reads back another, or a damaged line is
/// taken for one.
pub fn replies(bytes: &[u8]) {
    as_is_and_sealed(bytes, |line| {
        let Ok(line) = std::str::from_utf8(line) else {
            return;
        };
        let parsed = Reply::parse(line);
        assert_eq!(parsed.is_err(), open_bytes(line.as_bytes()).is_err());
        let Ok(Some(answer)) = parsed else {
            return;
        };
        let mut out = Text::default();
        match answer.outcome {
            Ok(text) => {
                let Ok(mut line) = reply::ok(&mut out, answer.id);
                if !text.is_empty() {
                    let Ok(()) = line.write_str(" ");
                    let Ok(()) = line.write_str(text);
                }
                let Ok(()) = line.finish();
            }
            Err(refusal) => {
                let Ok(()) = reply::no(&mut out, answer.id, refusal);
            }
        }
        assert_eq!(Reply::parse(&out.0), Ok(Some(answer)), "{}", out.0);
    });
}
