//! An open connection without threads, for a browser: whoever waits for a line reads the port
//! meanwhile, and keeps an armed board alive.
//!
//! What does not wait, does not beat: a board that is armed stops by itself after its patience, as
//! it does when the page is closed.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::time::Duration;

use softrig_formats::instant::Instant;
use wire::command::Request;

use super::{BEAT, FromBoard, Heard, Lines, received};
use crate::heart::{Heart, Silence};
use crate::line::request_text;
use crate::transport::Channel;

/// An open connection.
pub(crate) struct Worker {
    heart: Heart,
    port: RefCell<Port>,
}

struct Port {
    reader: Box<dyn Read + Send>,
    writer: Box<dyn Write + Send>,
    lines: Lines,
    heard: Heard,
    came: VecDeque<FromBoard>,
    is_lost: bool,
}

impl Worker {
    /// Starts to read.
    pub(crate) fn start(channel: Channel) -> Self {
        Self {
            heart: Heart::new(),
            port: RefCell::new(Port {
                reader: channel.reader,
                writer: channel.writer,
                lines: Lines::new(),
                heard: Heard::default(),
                came: VecDeque::new(),
                is_lost: false,
            }),
        }
    }

    /// Sends a request.
    pub(crate) fn send(&self, request: &Request) -> io::Result<()> {
        self.port.borrow_mut().send(request)
    }

    /// The next line, if one comes in time. The port is read once at least.
    pub(crate) fn receive(&self, until: Instant) -> Option<FromBoard> {
        self.heart.look();
        let mut port = self.port.borrow_mut();
        loop {
            if self.heart.turn().0 {
                // A broken connection shows at the next read.
                let _ = port.send(&BEAT);
            }
            if let Some(line) = port.came.pop_front() {
                return Some(line);
            }
            if port.is_lost {
                return None;
            }
            port.read(&self.heart);
            if port.came.is_empty() && Instant::now() >= until {
                return None;
            }
        }
    }

    /// As [`receive`](Self::receive): what has come was read.
    pub(crate) fn receive_surely(&self, until: Instant) -> Option<FromBoard> {
        self.receive(until)
    }

    /// What has come since the last sample, and since this was asked last.
    pub(crate) fn take_heard(&self) -> Heard {
        std::mem::take(&mut self.port.borrow_mut().heard)
    }

    /// How long the board bears silence.
    pub(crate) fn set_patience(&self, patience: Duration) {
        self.heart.set_patience(patience);
    }

    /// How long the board had to wait for a beat.
    pub(crate) fn silence(&self) -> Silence {
        self.heart.silence()
    }
}

impl Port {
    fn send(&mut self, request: &Request) -> io::Result<()> {
        self.writer.write_all(request_text(request).as_bytes())
    }

    fn read(&mut self, heart: &Heart) {
        let mut buffer = [0; 4096];
        match received(self.reader.read(&mut buffer)) {
            Ok(count) => {
                let bytes = buffer.get(..count).unwrap_or_default();
                self.came
                    .extend(self.lines.take(bytes, heart, &mut self.heard));
            }
            Err(reason) => {
                self.is_lost = true;
                self.came.push_back(FromBoard::Lost(reason));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use wire::command::Command;
    use wire::state::State;
    use wire::telemetry::{Setpoint, Telemetry};
    use wire::text::{Text, sealed};

    use super::*;
    use crate::line::Incoming;

    /// A port that gives what it is told to, piece by piece, and keeps what is sent.
    #[derive(Clone, Default)]
    struct Script {
        pieces: Arc<Mutex<VecDeque<Vec<u8>>>>,
        sent: Arc<Mutex<Vec<u8>>>,
    }

    impl Read for Script {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let Some(piece) = self.pieces.lock().unwrap().pop_front() else {
                std::thread::sleep(Duration::from_millis(1));
                return Err(io::ErrorKind::TimedOut.into());
            };
            buffer[..piece.len()].copy_from_slice(&piece);
            Ok(piece.len())
        }
    }

    impl Write for Script {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.sent.lock().unwrap().extend(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn started(pieces: &[&str]) -> (Worker, Script) {
        let script = Script::default();
        let bytes = pieces.iter().map(|piece| piece.as_bytes().to_vec());
        script.pieces.lock().unwrap().extend(bytes);
        let worker = Worker::start(Channel {
            reader: Box::new(script.clone()),
            writer: Box::new(script.clone()),
        });
        (worker, script)
    }

    fn soon() -> Instant {
        Instant::now() + Duration::from_millis(50)
    }

    /// The line of a sample, at a time of the board's.
    fn sample(state: State, time_ms: u32) -> String {
        let mut text = Text::default();
        let sample = Telemetry {
            sequence: 0,
            time_ms,
            pressure_kpa: None,
            angle_deg: None,
            predicted_deg: None,
            setpoint: Setpoint::None,
            volume_ul: 0,
            state,
            fault: 0,
            mismatch: false,
        };
        let Ok(()) = sample.write(&mut text);
        text.0
    }

    #[test]
    fn lines_come_in_their_order_whatever_pieces_they_come_in() {
        let (first, second) = (sealed("#: one"), sealed("#: two"));
        let (head, tail) = second.split_at(3);
        let (worker, _) = started(&["rn of a line\n", &format!("{first}{head}"), tail]);
        let next = || match worker.receive(soon()) {
            Some(FromBoard::Line(Incoming::Remark(text), _)) => text,
            other => panic!("{other:?}"),
        };
        assert_eq!([next(), next()], ["one", "two"]);
        assert!(worker.receive(soon()).is_none());
    }

    #[test]
    fn a_port_that_is_gone_is_told_once() {
        let (worker, _) = started(&[""]);
        assert!(matches!(worker.receive(soon()), Some(FromBoard::Lost(_))));
        assert!(worker.receive(soon()).is_none());
    }

    #[test]
    fn an_armed_board_hears_a_beat_and_an_idle_one_none() {
        let beats = |state, patience_ms| {
            let lines = [0, 300, 600, 900].map(|time_ms| sample(state, time_ms));
            let (worker, script) = started(&lines.each_ref().map(String::as_str));
            worker.set_patience(Duration::from_millis(patience_ms));
            let hello = Request {
                id: 1,
                command: Command::Hello,
            };
            worker.send(&hello).unwrap();
            while worker.receive_surely(soon()).is_some() {}
            let patience = worker.silence().patience;
            assert_eq!(patience, Duration::from_millis(patience_ms));
            assert!(worker.take_heard().is_nothing());
            let sent = script.sent.lock().unwrap().clone();
            let sent = String::from_utf8(sent).unwrap();
            assert_eq!(sent.matches("hello").count(), 1, "{sent}");
            sent.matches("beat").count()
        };
        // One as soon as a quarter of a second of the board's has passed, each time.
        assert_eq!(beats(State::Running, 2_000), 3);
        assert_eq!(beats(State::Idle, 2_000), 0);
    }
}
