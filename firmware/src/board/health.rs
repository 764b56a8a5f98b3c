//! How the board itself is doing, said when it changes.
//!
//! Memory that runs short and lines that do not fit are nobody's fault and stop
//! nothing, but who records with this rig should hear of them.

use ufmt::uwrite;
use wire::{decimal::Count, line::Sealed};

use super::{serial::Serial, stack};

use firmware::design::PERIOD_MS;

/// Milliseconds between looks: a power of two, since a division takes 500 cycles.
const LOOKS_MS: u32 = 1_024;

/// What was said last.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Health {
    never_used: u16,
    lost_bytes: u8,
    dropped_lines: u16,
}

impl Health {
    /// Nothing was said yet.
    pub const fn new() -> Self {
        Self {
            never_used: 0,
            lost_bytes: 0,
            dropped_lines: 0,
        }
    }

    /// Looks about once a second, in the first period of each 1.024 s, and writes `#: free BYTES lost BYTES dropped LINES` if
    /// that changed: RAM that was never used, received bytes and lines to send
    /// that found no place. Looking takes 2 ms, so it is for times of rest. Whether it looked.
    pub fn look(&mut self, time_ms: u32, serial: &mut Serial) -> bool {
        if time_ms % LOOKS_MS >= u32::from(PERIOD_MS) {
            return false;
        }
        let now = Self {
            never_used: stack::never_used(),
            lost_bytes: serial.lost_bytes(),
            dropped_lines: serial.dropped_lines(),
        };
        if now == *self {
            return true;
        }
        *self = now;
        serial.send_or_drop(|out| {
            let mut line = Sealed::new(out);
            let Ok(()) = uwrite!(
                line,
                "#: free {} lost {} dropped {}",
                Count(u32::from(now.never_used)),
                Count(u32::from(now.lost_bytes)),
                Count(u32::from(now.dropped_lines)),
            );
            let Ok(()) = line.finish();
        });
        true
    }
}
