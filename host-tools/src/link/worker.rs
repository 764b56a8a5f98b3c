//! The thread that reads the port, and keeps an armed board alive.
//!
//! The board stops when it hears nothing for a while, by its own clock. A
//! simulated board's clock can run many times faster than ours, so a beat is
//! due whenever telemetry shows that the board's time has moved on, and at the
//! latest after some time of ours. Beats say that the program is alive, not just
//! this thread: they cease when nobody has looked at the link for a while.

use std::io::{self, Read, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use wire::assemble::{Assembled, Assembler};
use wire::command::{Command, Request};
use wire::state::State;
use wire::telemetry::Telemetry;

use super::line::{Incoming, MAX_LINE, request_text};
use super::port::Channel;

/// The number of every beat; replies to it are for nobody.
pub(super) const BEAT_ID: u8 = 255;

/// Longest time between beats, by the board's clock.
const DEVICE_PACE: Duration = Duration::from_millis(250);
/// Longest time between beats, by ours.
const WALL_PACE: Duration = Duration::from_millis(500);
/// A program that has not looked at the link for this long is not in control.
const LEASE: Duration = Duration::from_secs(3);

/// What the thread passes on.
#[derive(Debug)]
pub(super) enum FromBoard {
    /// A line and when it arrived.
    Line(Incoming, Instant),
    /// The connection broke.
    Lost(String),
}

/// An open connection with its thread.
pub(super) struct Worker {
    shared: Arc<Shared>,
    lines: Receiver<FromBoard>,
    thread: Option<std::thread::JoinHandle<()>>,
}

struct Shared {
    writer: Mutex<Box<dyn Write + Send>>,
    stop: AtomicBool,
    started: Instant,
    /// When the owner last looked (ms since `started`).
    looked_ms: AtomicU64,
    /// The board's patience (ms).
    patience_ms: AtomicU64,
}

impl Worker {
    /// Starts to read.
    pub(super) fn start(channel_: Channel) -> Self {
        let (sender, lines) = channel();
        let shared = Arc::new(Shared {
            writer: Mutex::new(channel_.writer),
            stop: AtomicBool::new(false),
            started: Instant::now(),
            looked_ms: AtomicU64::new(0),
            patience_ms: AtomicU64::new(2_000),
        });
        let thread = {
            let shared = Arc::clone(&shared);
            let reader = channel_.reader;
            std::thread::spawn(move || read_lines(reader, &shared, &sender))
        };
        Self {
            shared,
            lines,
            thread: Some(thread),
        }
    }

    /// Sends a request.
    pub(super) fn send(&self, request: &Request) -> io::Result<()> {
        self.shared.send(request)
    }

    /// The next line, if one comes in time.
    pub(super) fn receive(&self, until: Instant) -> Option<FromBoard> {
        self.shared.look();
        let wait = until.saturating_duration_since(Instant::now());
        self.lines.recv_timeout(wait).ok()
    }

    /// How long the board bears silence.
    pub(super) fn set_patience(&self, patience: Duration) {
        let ms = u64::try_from(patience.as_millis()).unwrap_or(u64::MAX);
        self.shared.patience_ms.store(ms, Ordering::Relaxed);
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // It stops within one read; what it panicked with, if it did, was
            // printed.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn send(&self, request: &Request) -> io::Result<()> {
        let mut writer = self.writer.lock().unwrap_or_else(PoisonError::into_inner);
        writer.write_all(request_text(request).as_bytes())?;
        writer.flush()
    }

    fn look(&self) {
        self.looked_ms.store(self.now_ms(), Ordering::Relaxed);
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// Whether the owner has looked of late.
    fn is_attended(&self) -> bool {
        let idle = self
            .now_ms()
            .saturating_sub(self.looked_ms.load(Ordering::Relaxed));
        u128::from(idle) < LEASE.as_millis()
    }
}

fn read_lines(mut reader: Box<dyn Read + Send>, shared: &Shared, lines: &Sender<FromBoard>) {
    let mut assembler = Assembler::<MAX_LINE>::new();
    let mut buffer = [0; 4096];
    let mut heart = Heartbeat::new(Instant::now());
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
                heart.note(sample);
            }
            if lines.send(FromBoard::Line(incoming, now)).is_err() {
                return;
            }
        }
        let patience = Duration::from_millis(shared.patience_ms.load(Ordering::Relaxed));
        if heart.is_due(now, patience) && shared.is_attended() {
            heart.sent(now);
            // A broken connection shows at the next read.
            let _ = shared.send(&Request {
                id: BEAT_ID,
                command: Command::Beat,
            });
        }
    }
}

/// When to tell an armed board that we are alive.
#[derive(Debug)]
struct Heartbeat {
    armed: bool,
    device_ms: u32,
    sent_device_ms: u32,
    sent: Instant,
}

impl Heartbeat {
    fn new(now: Instant) -> Self {
        Self {
            armed: false,
            device_ms: 0,
            sent_device_ms: 0,
            sent: now,
        }
    }

    fn note(&mut self, sample: &Telemetry) {
        self.armed = matches!(sample.state, State::Homing | State::Ready | State::Running);
        self.device_ms = sample.time_ms;
    }

    fn is_due(&self, now: Instant, patience: Duration) -> bool {
        let quarter = patience / 4;
        let device = self.device_ms.wrapping_sub(self.sent_device_ms);
        let wall = now.saturating_duration_since(self.sent);
        self.armed
            && (u128::from(device) >= quarter.min(DEVICE_PACE).as_millis()
                || wall >= quarter.min(WALL_PACE))
    }

    fn sent(&mut self, now: Instant) {
        self.sent_device_ms = self.device_ms;
        self.sent = now;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::Setpoint;

    fn sample(time_ms: u32, state: State) -> Telemetry {
        Telemetry {
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
        }
    }

    const PATIENCE: Duration = Duration::from_secs(2);

    #[test]
    fn beats_follow_the_boards_clock_when_it_runs_ahead() {
        let start = Instant::now();
        let mut heart = Heartbeat::new(start);
        heart.note(&sample(1_000, State::Ready));
        heart.sent(start);
        heart.note(&sample(1_240, State::Ready));
        assert!(!heart.is_due(start, PATIENCE));
        // No time of ours has passed.
        heart.note(&sample(1_250, State::Ready));
        assert!(heart.is_due(start, PATIENCE));
    }

    #[test]
    fn beats_follow_our_clock_when_telemetry_stalls() {
        let start = Instant::now();
        let mut heart = Heartbeat::new(start);
        heart.note(&sample(1_000, State::Running));
        heart.sent(start);
        assert!(!heart.is_due(start + Duration::from_millis(490), PATIENCE));
        assert!(heart.is_due(start + Duration::from_millis(500), PATIENCE));
    }

    #[test]
    fn an_impatient_board_gets_more_beats_and_an_idle_one_none() {
        let start = Instant::now();
        let mut heart = Heartbeat::new(start);
        heart.note(&sample(1_000, State::Running));
        heart.sent(start);
        heart.note(&sample(1_100, State::Running));
        assert!(heart.is_due(start, Duration::from_millis(400)));
        for state in [State::Idle, State::Fault] {
            heart.note(&sample(9_000, state));
            assert!(!heart.is_due(start + PATIENCE, PATIENCE));
        }
    }
}
