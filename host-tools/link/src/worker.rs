//! The threads behind an open port: one reads lines, one keeps an armed board alive.

use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

use wire::assemble::{Assembled, Assembler};
use wire::command::{Command, Request};
use wire::state::State;

use super::heart::{Heart, Silence, raise_priority};
use super::line::{Incoming, MAX_LINE, request_text};
use super::port::Channel;

/// The number of every beat; replies to it are for nobody.
pub(super) const BEAT_ID: u8 = 255;

/// Time in which the port is read again, if the computer has time.
const SOON: Duration = Duration::from_millis(10);

/// A message from the reading thread.
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

/// An open connection with its threads.
pub(super) struct Worker {
    shared: Arc<Shared>,
    lines: Receiver<FromBoard>,
    threads: Vec<JoinHandle<()>>,
}

struct Shared {
    /// Not buffered: what is written is on its way.
    writer: Mutex<Box<dyn Write + Send>>,
    stop: AtomicBool,
    heart: Heart,
    heard: Mutex<Heard>,
}

impl Worker {
    /// Starts to read.
    pub(super) fn start(channel_: Channel) -> Self {
        let (sender, lines) = channel();
        let shared = Arc::new(Shared {
            writer: Mutex::new(channel_.writer),
            stop: AtomicBool::new(false),
            heart: Heart::new(),
            heard: Mutex::default(),
        });
        let beating = {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || beat(&shared))
        };
        let reading = {
            let (shared, beating) = (Arc::clone(&shared), beating.thread().clone());
            let reader = channel_.reader;
            std::thread::spawn(move || read_lines(reader, &shared, &beating, &sender))
        };
        Self {
            shared,
            lines,
            threads: vec![reading, beating],
        }
    }

    /// Sends a request.
    pub(super) fn send(&self, request: &Request) -> io::Result<()> {
        self.shared.send(request)
    }

    /// The next line, if one comes in time.
    pub(super) fn receive(&self, until: Instant) -> Option<FromBoard> {
        self.shared.heart.look();
        let wait = until.saturating_duration_since(Instant::now());
        self.lines.recv_timeout(wait).ok()
    }

    /// The next line, if one has come in time. On a busy computer it can have, and lie there
    /// unread: nothing has come only if it was looked for after the time was over.
    pub(super) fn receive_surely(&self, until: Instant) -> Option<FromBoard> {
        loop {
            let was_read = self.shared.heart.has_read_since(until);
            let soon = Instant::now() + SOON;
            match self.receive(if was_read { until } else { until.max(soon) }) {
                Some(line) => return Some(line),
                None if was_read || self.threads.iter().any(JoinHandle::is_finished) => {
                    return None;
                }
                None => {}
            }
        }
    }

    /// What has come since the last sample, and since this was asked last.
    pub(super) fn take_heard(&self) -> Heard {
        std::mem::take(&mut *self.shared.heard())
    }

    /// How long the board bears silence.
    pub(super) fn set_patience(&self, patience: Duration) {
        self.shared.heart.set_patience(patience);
    }

    /// How long the board had to wait for a beat.
    pub(super) fn silence(&self) -> Silence {
        self.shared.heart.silence()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            thread.thread().unpark();
            // It stops within one read; what it panicked with, if it did, was
            // printed.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn heard(&self) -> std::sync::MutexGuard<'_, Heard> {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn send(&self, request: &Request) -> io::Result<()> {
        let text = request_text(request);
        let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
        writer.write_all(text.as_bytes())
    }
}

/// Sends beats whenever they are due.
fn beat(shared: &Shared) {
    raise_priority();
    while !shared.stop.load(Ordering::Relaxed) {
        let (is_due, wait) = shared.heart.turn();
        if is_due {
            // A broken connection shows at the next read.
            let _ = shared.send(&Request {
                id: BEAT_ID,
                command: Command::Beat,
            });
        }
        std::thread::park_timeout(wait);
    }
}

fn read_lines(
    mut reader: Box<dyn Read + Send>,
    shared: &Shared,
    beating: &Thread,
    lines: &Sender<FromBoard>,
) {
    let mut assembler = Assembler::<MAX_LINE>::new();
    let mut buffer = [0; 4096];
    // A port is opened in the middle of a line more often than not.
    let mut first = true;
    while !shared.stop.load(Ordering::Relaxed) {
        let received = match reader.read(&mut buffer) {
            Ok(0) => Err(io::Error::from(io::ErrorKind::UnexpectedEof)),
            Err(error)
                if matches!(
                    error.kind(),
                    io::ErrorKind::TimedOut
                        | io::ErrorKind::WouldBlock
                        | io::ErrorKind::Interrupted
                ) =>
            {
                Ok(0)
            }
            other => other,
        };
        let count = match received {
            Ok(count) => count,
            Err(error) => {
                // Without an owner there is nobody to tell.
                let _ = lines.send(FromBoard::Lost(error.to_string()));
                return;
            }
        };
        shared.heart.read(count);
        shared.heard().take(&buffer[..count]);
        let now = Instant::now();
        for &byte in &buffer[..count] {
            let incoming = match assembler.push(byte) {
                Assembled::Pending => continue,
                Assembled::Line(line) => Incoming::parse(line),
                Assembled::Overlong => Incoming::Damaged,
            };
            if std::mem::take(&mut first) && !incoming.is_whole() {
                continue;
            }
            if let Incoming::Sample(sample) = &incoming {
                *shared.heard() = Heard::default();
                let armed = matches!(sample.state, State::Homing | State::Ready | State::Running);
                shared.heart.note(armed, sample.time_ms);
                if shared.heart.is_device_due() {
                    beating.unpark();
                }
            }
            if lines.send(FromBoard::Line(incoming, now)).is_err() {
                return;
            }
        }
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
