//! The watchdog: what ends the firmware's worst case.
//!
//! Only a completed control period feeds it. After 64 ms without one while the rig is armed, its
//! interrupt makes the outputs safe, if interrupts still work; after as long again it resets
//! the processor, which makes them safe in any case. At rest, where the self-test takes its time,
//! both are a quarter of a second. 64 ms is the shortest time that no late period takes: with
//! interrupts the pump has stopped after 40, see [`super::pulses`]. Without them the timer
//! goes on to make an edge a turn, 122 steps a second, until the reset. Once the watchdog has bitten, the processor
//! itself sets it to its shortest time, whatever is chosen here; bootloaders that do
//! not stop it reset for ever, with the outputs safe.

use core::arch::asm;

use avr_device::atmega2560::WDT;

use super::{
    registers::{WDCE, WDE, WDIE, WDPL, WDTCSR},
    reset,
};

/// The next write counts.
const CHANGE: u8 = 1 << WDCE | 1 << WDE;
/// Interrupt and reset mode, a quarter of a second each.
const AT_REST: u8 = 1 << WDIE | 1 << WDE | 0b100 << WDPL;
/// The same, 64 ms each.
const ARMED: u8 = 1 << WDIE | 1 << WDE | 0b010 << WDPL;

/// The watchdog.
pub struct Watchdog {
    _watchdog: WDT,
    is_armed: bool,
}

impl Watchdog {
    /// Takes the watchdog, which does not watch yet.
    pub const fn new(watchdog: WDT) -> Self {
        Self {
            _watchdog: watchdog,
            is_armed: false,
        }
    }

    /// Starts it, for a rig at rest.
    pub fn start(&mut self) {
        self.set(AT_REST);
    }

    /// Changes its times.
    fn set(&mut self, mode: u8) {
        // SAFETY: with interrupts off, the owner of the register writes WDCE and WDE, and within
        // four cycles the mode. The compiler would put the choice of the mode in between.
        avr_device::interrupt::free(|_| unsafe {
            asm!(
                "wdr",
                "sts {wdtcsr}, {change}",
                "sts {wdtcsr}, {mode}",
                wdtcsr = const WDTCSR,
                change = in(reg) CHANGE,
                mode = in(reg) mode,
                options(nostack, preserves_flags)
            );
        });
    }

    /// A control period was completed, of a rig that `is_armed`.
    pub fn feed(&mut self, is_armed: bool) {
        avr_device::asm::wdr();
        if is_armed != self.is_armed {
            self.is_armed = is_armed;
            self.set(if is_armed { ARMED } else { AT_REST });
        }
    }
}

#[avr_device::interrupt(atmega2560)]
fn WDT() {
    reset::stop_for_good()
}
