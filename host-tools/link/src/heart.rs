//! Keeping an armed board alive.
//!
//! The board stops when it receives nothing for a while, by its own clock. A separate thread
//! sends the heartbeats. It reads nothing and writes to no disk and no terminal, so none of
//! these can block it, and it asks the system for priority over ordinary programs.
//!
//! Beats show that the program is alive, not just this thread: they stop when the link has not
//! been used for a while. They also stop when the board is silent, since every byte keeps a
//! board that was reset in its bootloader.

use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use softrig_formats::instant::Instant;

/// Longest time between beats (ms), by the board's clock.
const DEVICE_PACE_MS: u64 = 250;
/// Longest time between beats (ms), by ours.
const WALL_PACE_MS: u64 = 500;
/// A program that has not looked at the link for this long (ms) is not in control. A busy
/// disk or a terminal that was stopped with Ctrl-S for a moment is no reason to stop a rig.
const LEASE_MS: u64 = 30_000;
/// A board that sends nothing for this long (ms) is not armed, whatever it said last: it
/// sends a hundred lines a second.
const SILENT_MS: u64 = 3_000;

/// The state of a link, for the thread that sends the heartbeats.
#[derive(Debug)]
pub(super) struct Heart {
    started: Instant,
    armed: AtomicBool,
    device_ms: AtomicU32,
    patience_ms: AtomicU64,
    /// When the owner last looked.
    looked_ms: AtomicU64,
    /// When the reader last came round, with bytes or without.
    read_ms: AtomicU64,
    /// When it last came round with bytes.
    heard_ms: AtomicU64,
    /// The board's clock at the last beat.
    sent_device_ms: AtomicU32,
    /// Only for whoever beats, and for whoever asks why that did not help: a thread that is
    /// put to sleep with the lock in its hand would hold up the beats.
    pulse: Mutex<Pulse>,
}

impl Heart {
    pub(super) fn new() -> Self {
        Self {
            started: Instant::now(),
            armed: AtomicBool::new(false),
            device_ms: AtomicU32::new(0),
            patience_ms: AtomicU64::new(2_000),
            looked_ms: AtomicU64::new(0),
            read_ms: AtomicU64::new(0),
            heard_ms: AtomicU64::new(0),
            sent_device_ms: AtomicU32::new(0),
            pulse: Mutex::new(Pulse::default()),
        }
    }

    /// The owner has looked at the link.
    pub(super) fn look(&self) {
        self.looked_ms.store(self.now_ms(), Relaxed);
    }

    /// How long the board bears silence.
    pub(super) fn set_patience(&self, patience: Duration) {
        self.patience_ms.store(milliseconds(patience), Relaxed);
    }

    /// A read has ended.
    pub(super) fn read(&self, bytes: usize) {
        let now = self.now_ms();
        // In this order, or a thread that is put to sleep in between looks like a silent board.
        if bytes > 0 {
            self.heard_ms.store(now, Relaxed);
        }
        self.read_ms.store(now, Relaxed);
    }

    /// Whether a read has ended since.
    pub(super) fn has_read_since(&self, then: Instant) -> bool {
        let then = milliseconds(then.saturating_duration_since(self.started));
        self.read_ms.load(Relaxed) > then
    }

    /// Stores the board's state; returns whether a heartbeat may be due by its clock.
    pub(super) fn note(&self, armed: bool, device_ms: u32) {
        self.armed.store(armed, Relaxed);
        self.device_ms.store(device_ms, Relaxed);
    }

    /// Whether to send a beat now, and how long to wait until the next question.
    pub(super) fn turn(&self) -> (bool, Duration) {
        let seen = self.seen();
        let mut pulse = self.pulse();
        let beat = pulse.turn(&seen);
        self.sent_device_ms.store(pulse.sent_device_ms, Relaxed);
        let pace = seen.pace_ms(WALL_PACE_MS);
        let passed = seen.now_ms.saturating_sub(pulse.sent_ms);
        let wait = if pulse.armed {
            pace.saturating_sub(passed).clamp(5, 50)
        } else {
            50
        };
        (beat, Duration::from_millis(wait))
    }

    /// Whether the board's clock alone makes a beat due.
    pub(super) fn is_device_due(&self) -> bool {
        let seen = self.seen();
        let sent_device_ms = self.sent_device_ms.load(Relaxed);
        seen.armed && seen.since_device_ms(sent_device_ms) >= seen.pace_ms(DEVICE_PACE_MS)
    }

    /// How long the board had to wait for a beat since it was armed last.
    pub(super) fn silence(&self) -> Silence {
        self.pulse().silence(&self.seen())
    }

    fn pulse(&self) -> std::sync::MutexGuard<'_, Pulse> {
        self.pulse.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn seen(&self) -> Seen {
        Seen {
            now_ms: self.now_ms(),
            armed: self.armed.load(Relaxed),
            device_ms: self.device_ms.load(Relaxed),
            patience_ms: self.patience_ms.load(Relaxed),
            looked_ms: self.looked_ms.load(Relaxed),
            read_ms: self.read_ms.load(Relaxed),
            heard_ms: self.heard_ms.load(Relaxed),
        }
    }

    fn now_ms(&self) -> u64 {
        milliseconds(self.started.elapsed())
    }
}

fn milliseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_millis()).unwrap_or(u64::MAX)
}

/// Why a board may have taken the computer for lost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Silence {
    /// How long the board bears silence.
    pub patience: Duration,
    /// The longest time between two beats while it was armed; zero if it never was.
    pub longest: Duration,
    /// The same by the board's clock.
    pub by_its_clock: Duration,
    /// How long nobody looked at the link, if that is why no beat was sent.
    pub unattended: Duration,
}

impl std::fmt::Display for Silence {
    /// Cause and advice, to follow "fault 8 (computer lost): ".
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let patience = self.patience.as_secs_f64();
        let longest = self.longest.as_secs_f64();
        // A board counts from the beat's arrival, in control periods.
        let too_long = |time: Duration| time.as_secs_f64() > 0.9 * patience;
        if !self.unattended.is_zero() {
            write!(
                f,
                "softrig was blocked for {:.0} s and sent no heartbeat; check whether the terminal was stopped (Ctrl-Q resumes it) or the disk is slow, and record to a local disk",
                self.unattended.as_secs_f64()
            )
        } else if too_long(self.longest) {
            write!(
                f,
                "this computer did not schedule softrig for {longest:.1} s; the board waits {patience:.1} s; close other programs, start softrig with `sudo` or the right to real-time priority (rtprio in /etc/security/limits.conf), or let the board wait longer (beat.s, with `softrig upload --settings`)"
            )
        } else if too_long(self.by_its_clock) {
            write!(
                f,
                "between two heartbeats {:.1} s passed on the board's clock and {longest:.1} s here; run the simulated rig with `--speed realtime`",
                self.by_its_clock.as_secs_f64()
            )
        } else {
            write!(
                f,
                "softrig sent a heartbeat at least every {longest:.2} s, but none reached the board within {patience:.1} s; check the cable, its hub, and whether the computer was suspended"
            )
        }
    }
}

/// A snapshot of the heart's state; times are by the link's clock (ms).
#[derive(Clone, Copy, Debug)]
struct Seen {
    now_ms: u64,
    armed: bool,
    device_ms: u32,
    patience_ms: u64,
    looked_ms: u64,
    read_ms: u64,
    heard_ms: u64,
}

impl Seen {
    /// Time between beats (ms): four in the board's patience, or more.
    fn pace_ms(&self, longest: u64) -> u64 {
        (self.patience_ms / 4).min(longest)
    }

    /// The board's time (ms) since its clock showed this. Zero after a reset, with which it
    /// starts anew.
    fn since_device_ms(&self, device_ms: u32) -> u64 {
        let passed = self.device_ms.wrapping_sub(device_ms);
        if passed < 1 << 31 {
            u64::from(passed)
        } else {
            0
        }
    }

    fn idle_ms(&self) -> u64 {
        self.now_ms.saturating_sub(self.looked_ms)
    }

    /// Whether the board has been silent, by reads that did take place.
    fn is_silent(&self) -> bool {
        self.read_ms.saturating_sub(self.heard_ms) > SILENT_MS
    }
}

/// When to tell an armed board that we are alive, and how well that went.
///
/// A simulated board's clock can run many times faster than ours, so a beat is due whenever
/// telemetry shows that the board's time has advanced, and at the latest after a time on our
/// clock.
#[derive(Clone, Copy, Debug, Default)]
struct Pulse {
    armed: bool,
    sent_ms: u64,
    sent_device_ms: u32,
    longest_ms: u64,
    longest_device_ms: u64,
    unattended_ms: u64,
}

impl Pulse {
    /// Whether to send a beat now.
    fn turn(&mut self, seen: &Seen) -> bool {
        if !self.armed && !seen.armed {
            return false;
        }
        if !self.armed {
            // What armed it was heard.
            *self = Self {
                armed: true,
                sent_ms: seen.now_ms,
                sent_device_ms: seen.device_ms,
                ..Self::default()
            };
            return false;
        }
        // Also when it has just stopped: perhaps because of this.
        self.measure(seen);
        self.armed = seen.armed;
        let is_due = self.is_device_due(seen)
            || seen.now_ms.saturating_sub(self.sent_ms) >= seen.pace_ms(WALL_PACE_MS);
        if !seen.armed || seen.is_silent() || !is_due {
            return false;
        }
        if seen.idle_ms() >= LEASE_MS {
            self.unattended_ms = self.unattended_ms.max(seen.idle_ms());
            return false;
        }
        self.sent_ms = seen.now_ms;
        self.sent_device_ms = seen.device_ms;
        true
    }

    fn is_device_due(&self, seen: &Seen) -> bool {
        seen.since_device_ms(self.sent_device_ms) >= seen.pace_ms(DEVICE_PACE_MS)
    }

    fn measure(&mut self, seen: &Seen) {
        let passed = seen.now_ms.saturating_sub(self.sent_ms);
        self.longest_ms = self.longest_ms.max(passed);
        self.longest_device_ms = self
            .longest_device_ms
            .max(seen.since_device_ms(self.sent_device_ms));
    }

    fn silence(mut self, seen: &Seen) -> Silence {
        // The board's fault can be known before the next turn.
        if self.armed {
            self.measure(seen);
        }
        Silence {
            patience: Duration::from_millis(seen.patience_ms),
            longest: Duration::from_millis(self.longest_ms),
            by_its_clock: Duration::from_millis(self.longest_device_ms),
            unattended: Duration::from_millis(self.unattended_ms),
        }
    }
}

/// Asks to be run before ordinary programs, as the least of the real-time ones: this thread
/// sleeps but for a few microseconds. Without the right to it (root, or `rtprio` in
/// `/etc/security/limits.conf`) it goes on as it is.
#[cfg(not(target_family = "wasm"))]
pub(super) fn raise_priority() {
    #[cfg(unix)]
    {
        use thread_priority::{
            RealtimeThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy,
            set_thread_priority_and_policy, thread_native_id,
        };
        let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::RoundRobin);
        let _ = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, policy);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Armed at a second, with a beat due from 1.5 s on.
    fn armed() -> (Pulse, Seen) {
        let seen = Seen {
            now_ms: 1_000,
            armed: true,
            device_ms: 5_000,
            patience_ms: 2_000,
            looked_ms: 1_000,
            read_ms: 1_000,
            heard_ms: 1_000,
        };
        let mut pulse = Pulse::default();
        assert!(!pulse.turn(&seen));
        (pulse, seen)
    }

    fn at(seen: Seen, now_ms: u64) -> Seen {
        Seen {
            now_ms,
            looked_ms: now_ms,
            read_ms: now_ms,
            heard_ms: now_ms,
            ..seen
        }
    }

    #[test]
    fn beats_follow_the_boards_clock_when_it_runs_ahead() {
        let (mut pulse, seen) = armed();
        let device_ms = |device_ms| Seen { device_ms, ..seen };
        assert!(!pulse.turn(&device_ms(5_240)));
        // No time of ours has passed.
        assert!(pulse.turn(&device_ms(5_250)));
        assert!(!pulse.turn(&device_ms(5_490)));
        assert!(pulse.turn(&device_ms(5_500)));
    }

    #[test]
    fn beats_follow_our_clock_when_telemetry_stalls() {
        let (mut pulse, seen) = armed();
        assert!(!pulse.turn(&at(seen, 1_490)));
        assert!(pulse.turn(&at(seen, 1_500)));
        // The reader was not run either: that is not the board's silence.
        let stalled = Seen {
            now_ms: 9_000,
            ..at(seen, 2_000)
        };
        assert!(pulse.turn(&stalled));
    }

    #[test]
    fn an_impatient_board_gets_more_beats_and_an_idle_one_none() {
        let (mut pulse, seen) = armed();
        let impatient = Seen {
            patience_ms: 400,
            device_ms: 5_100,
            ..seen
        };
        assert!(pulse.turn(&impatient));
        let idle = Seen {
            armed: false,
            ..at(seen, 9_000)
        };
        assert!(!pulse.turn(&idle));
        assert!(!pulse.turn(&Seen {
            armed: false,
            ..at(seen, 19_000)
        }));
    }

    #[test]
    fn a_board_in_its_bootloader_is_left_in_peace() {
        let (mut pulse, seen) = armed();
        let silent = Seen {
            heard_ms: 5_900,
            ..at(seen, 9_000)
        };
        assert!(!pulse.turn(&silent));
        assert!(pulse.turn(&at(seen, 9_010)));
    }

    #[test]
    fn a_busy_disk_is_borne_and_a_program_that_hangs_is_not() {
        let (mut pulse, seen) = armed();
        let looked = |now_ms| Seen {
            looked_ms: 1_000,
            ..at(seen, now_ms)
        };
        for beat in 1..60 {
            assert!(pulse.turn(&looked(1_000 + 500 * beat)), "{beat}");
        }
        assert!(!pulse.turn(&looked(31_000)));
        let silence = pulse.silence(&looked(33_000));
        assert_eq!(silence.unattended, Duration::from_secs(30));
        assert!(silence.to_string().contains("was blocked for 30 s"));
    }

    #[test]
    fn what_went_wrong_is_told() {
        let said = |pulse: &Pulse, seen: &Seen| pulse.silence(seen).to_string();
        let (mut pulse, seen) = armed();
        assert_eq!(pulse.silence(&seen).longest, Duration::ZERO);
        assert!(pulse.turn(&at(seen, 1_500)));
        assert!(said(&pulse, &at(seen, 1_700)).contains("none reached the board"));
        // Before this thread runs again, and after.
        let late = at(seen, 4_100);
        assert!(said(&pulse, &late).contains("did not schedule softrig for 2.6 s"));
        let stopped = Seen {
            armed: false,
            ..late
        };
        assert!(!pulse.turn(&stopped));
        let later = Seen {
            armed: false,
            ..at(seen, 60_000)
        };
        assert!(said(&pulse, &later).contains("for 2.6 s; the board waits 2.0 s"));
        // It starts anew with the next run.
        assert!(!pulse.turn(&at(seen, 61_000)));
        assert_eq!(pulse.silence(&at(seen, 61_000)).longest, Duration::ZERO);

        let (pulse, seen) = armed();
        let ahead = Seen {
            device_ms: 7_500,
            ..at(seen, 1_200)
        };
        assert!(said(&pulse, &ahead).contains("2.5 s passed on the board's clock"));
    }
}
