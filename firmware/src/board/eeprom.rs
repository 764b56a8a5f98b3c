//! The EEPROM, a byte at a time.
//!
//! A write takes 1.8 ms when bits only have to be cleared or only set, 3.3 ms
//! when both, and goes on by itself: nothing waits unless it comes too early. A
//! byte that already has its value is not written at all.

use core::arch::asm;

use avr_device::atmega2560::EEPROM;
use firmware::store;
use wire::settings::{SHIPPED_COUNT, Settings};

use super::{
    registers::{EECR, EEMPE, EEPE, EEPM},
    texts::flash_byte,
};

/// Erases and writes.
const BOTH: u8 = 0b00 << EEPM;
/// Sets every bit.
const ERASE_ONLY: u8 = 0b01 << EEPM;
/// Clears bits.
const WRITE_ONLY: u8 = 0b10 << EEPM;

/// The settings' memory.
pub struct Eeprom(EEPROM);

impl Eeprom {
    /// Takes the EEPROM.
    pub const fn new(eeprom: EEPROM) -> Self {
        Self(eeprom)
    }

    fn wait(&self) {
        while self.0.eecr.read().eepe().bit_is_set() {}
    }
}

/// What a board is shipped with, up to the table, which is empty.
#[unsafe(link_section = ".progmem.data")]
static SHIPPED: [u32; SHIPPED_COUNT as usize] = {
    let mut words = [0; SHIPPED_COUNT as usize];
    let mut index = 0;
    while index < words.len() {
        words[index] = Settings::DEFAULT.words()[index];
        index += 1;
    }
    words
};

impl store::Eeprom for Eeprom {
    fn ship(&self, settings: &mut Settings) {
        let mut at = SHIPPED.as_ptr().cast::<u8>();
        for (index, word) in settings.words_mut().iter_mut().enumerate() {
            let mut bytes = [0; 4];
            if index >= SHIPPED.len() {
                *word = 0;
                continue;
            }
            for byte in &mut bytes {
                // SAFETY: within the words, which are in flash.
                *byte = unsafe { flash_byte(at) };
                at = at.wrapping_add(1);
            }
            *word = u32::from_le_bytes(bytes);
        }
    }

    fn read(&self, address: u16) -> u8 {
        self.wait();
        self.0.eear.write(|w| w.bits(address));
        self.0.eecr.write(|w| w.eere().set_bit());
        self.0.eedr.read().bits()
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
        self.0.eedr.write(|w| w.bits(byte));
        // SAFETY: the mode is one of the three above, and nothing is being
        // written. The second instruction must follow within four cycles.
        avr_device::interrupt::free(|_| unsafe {
            self.0.eecr.write(|w| w.bits(mode));
            asm!(
                "sbi {eecr}, {eempe}",
                "sbi {eecr}, {eepe}",
                eecr = const EECR,
                eempe = const EEMPE,
                eepe = const EEPE,
                options(nostack, preserves_flags)
            );
        });
    }
}
