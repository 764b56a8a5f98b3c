//! The watchdog: what ends the firmware's worst case.
//!
//! Only a completed control period feeds it. After two seconds without one, its
//! interrupt makes the outputs safe, if interrupts still work; after four it
//! resets the processor, which makes them safe in any case. Stock bootloaders
//! hold the processor for one second, and old ones forget to stop the watchdog.

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
            // at two seconds.
            unsafe {
                watchdog.wdtcsr().write(|w| w.bits(0b0001_1000));
                watchdog.wdtcsr().write(|w| w.bits(0b0100_1111));
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
