//! The EEPROM, a byte at a time.
//!
//! A write takes 1.8 ms when bits only have to be cleared or only set, 3.3 ms
//! when both, and goes on by itself: nothing waits unless it comes too early. A
//! byte that already has its value is not written at all.

use core::arch::asm;

use avr_device::atmega2560::EEPROM;
use firmware::store;

/// Erases and writes.
const BOTH: u8 = 0b00 << 4;
/// Sets every bit.
const ERASE_ONLY: u8 = 0b01 << 4;
/// Clears bits.
const WRITE_ONLY: u8 = 0b10 << 4;

/// The settings' memory.
pub struct Eeprom(EEPROM);

impl Eeprom {
    /// Takes the EEPROM.
    pub const fn new(eeprom: EEPROM) -> Self {
        Self(eeprom)
    }

    fn wait(&self) {
        while self.0.eecr().read().eepe().bit_is_set() {}
    }
}

impl store::Eeprom for Eeprom {
    fn read(&self, address: u16) -> u8 {
        self.wait();
        self.0.eear().write(|w| w.set(address));
        self.0.eecr().write(|w| w.eere().set_bit());
        self.0.eedr().read().bits()
    }

    fn write(&mut self, address: u16, byte: u8) {
        let found = self.read(address);
        if found == byte {
            return;
        }
        let mode = if byte == 0xff {
            ERASE_ONLY
        } else if found & byte == byte {
            WRITE_ONLY
        } else {
            BOTH
        };
        self.0.eedr().write(|w| w.set(byte));
        // SAFETY: the mode is one of the three above, and nothing is being
        // written. The second instruction must follow within four cycles.
        avr_device::interrupt::free(|_| unsafe {
            self.0.eecr().write(|w| w.bits(mode));
            asm!(
                "sbi 0x1f, 2",
                "sbi 0x1f, 1",
                options(nostack, preserves_flags)
            ); // EECR: EEMPE, EEPE
        });
    }
}
