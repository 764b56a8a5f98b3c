//! An open connection with two threads: one reads lines, one keeps an armed board alive.

use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{JoinHandle, Thread};
use std::time::{Duration, Instant};

use wire::command::Request;

use super::{BEAT, FromBoard, Heard, Lines, received};
use crate::heart::{Heart, Silence, raise_priority};
use crate::line::request_text;
use crate::transport::Channel;

/// Time in which the port is read again, if the computer has time.
const SOON: Duration = Duration::from_millis(10);

/// An open connection with its threads.
pub(crate) struct Worker {
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
    pub(crate) fn start(channel_: Channel) -> Self {
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
    pub(crate) fn send(&self, request: &Request) -> io::Result<()> {
        self.shared.send(request)
    }

    /// The next line, if one comes in time.
    pub(crate) fn receive(&self, until: Instant) -> Option<FromBoard> {
        self.shared.heart.look();
        let wait = until.saturating_duration_since(Instant::now());
        self.lines.recv_timeout(wait).ok()
    }

    /// The next line, if one has come in time. On a busy computer it can have, and lie there
    /// unread: nothing has come only if it was looked for after the time was over.
    pub(crate) fn receive_surely(&self, until: Instant) -> Option<FromBoard> {
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
    pub(crate) fn take_heard(&self) -> Heard {
        std::mem::take(&mut *self.shared.heard())
    }

    /// How long the board bears silence.
    pub(crate) fn set_patience(&self, patience: Duration) {
        self.shared.heart.set_patience(patience);
    }

    /// How long the board had to wait for a beat.
    pub(crate) fn silence(&self) -> Silence {
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
            let _ = shared.send(&BEAT);
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
    let mut assembled = Lines::new();
    let mut buffer = [0; 4096];
    while !shared.stop.load(Ordering::Relaxed) {
        let count = match received(reader.read(&mut buffer)) {
            Ok(count) => count,
            Err(reason) => {
                // Without an owner there is nobody to tell.
                let _ = lines.send(FromBoard::Lost(reason));
                return;
            }
        };
        let bytes = buffer.get(..count).unwrap_or_default();
        let came = assembled.take(bytes, &shared.heart, &mut shared.heard());
        if !came.is_empty() && shared.heart.is_device_due() {
            beating.unpark();
        }
        if came.into_iter().any(|line| lines.send(line).is_err()) {
            return;
        }
    }
}
