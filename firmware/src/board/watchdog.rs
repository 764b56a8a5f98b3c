//! The watchdog: what ends the firmware's worst case.
//!
//! Only a completed control period feeds it. After a quarter of a second without one,
//! its interrupt makes the outputs safe, if interrupts still work; after half a second
//! it resets the processor, which makes them safe in any case. The pump has stopped
//! long before: see [`super::pulses`]. Once the watchdog has bitten, the processor
//! itself sets it to its shortest time, whatever is chosen here; bootloaders that do
//! not stop it reset for ever, with the outputs safe.

use avr_device::atmega2560::WDT;

use super::reset;

/// The watchdog, once it watches.
pub struct Watchdog(());

impl Watchdog {
    /// Starts the watchdog.
    #[allow(clippy::needless_pass_by_value)] // Owned from here on.
    pub fn start(watchdog: WDT) -> Self {
        avr_device::interrupt::free(|_| {
            avr_device::asm::wdr();
            // SAFETY: the second write must follow within four cycles; both are
            // stores of constants. WDCE and WDE, then interrupt and reset mode
            // at a quarter of a second each.
            unsafe {
                watchdog.wdtcsr.write(|w| w.bits(0b0001_1000));
                watchdog.wdtcsr.write(|w| w.bits(0b0100_1100));
            }
        });
        Self(())
    }

    /// A control period was completed.
    pub fn feed(&mut self) {
        avr_device::asm::wdr();
    }
}

#[avr_device::interrupt(atmega2560)]
fn WDT() {
    reset::stop_for_good()
}
