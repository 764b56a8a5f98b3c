//! Texts for people, kept in flash.
//!
//! A constant string lies in RAM on this processor, and a sentence for every
//! fault would take a sixth of it. So all are joined while compiling, put beside
//! the code, and read from there. They are written down once, in
//! [`wire::fault`] and [`firmware::app`].

use core::arch::asm;

use firmware::app::{HELP, Texts};
use ufmt::uWrite;
use wire::fault::Fault;

/// Lines in flash, each with a line feed behind it.
struct Lines<const N: usize>([u8; N]);

impl<const N: usize> Lines<N> {
    /// Writes a line; whether another follows. `self` must be in flash.
    fn write<W: uWrite + ?Sized>(&'static self, line: u8, out: &mut W) -> Result<bool, W::Error> {
        let start = self.0.as_ptr();
        let mut before = line;
        for place in 0..N {
            // SAFETY: within the bytes, which are in flash; see [`flash_byte`].
            let byte = unsafe { flash_byte(start.wrapping_add(place)) };
            if byte == b'\n' {
                if before == 0 {
                    return Ok(place + 1 < N);
                }
                before -= 1;
            } else if before == 0 {
                out.write_char(char::from(byte))?;
            }
        }
        Ok(false)
    }
}

/// Reads a byte of flash.
///
/// # Safety
///
/// `at` must point to a static in `.progmem`, which the linker puts into the
/// lowest 64 KiB of flash, right behind the interrupt vectors.
pub(super) unsafe fn flash_byte(at: *const u8) -> u8 {
    let byte: u8;
    // SAFETY: reading flash changes nothing.
    unsafe {
        asm!("lpm {byte}, Z", byte = out(reg) byte, in("Z") at,
            options(nostack, preserves_flags, readonly));
    }
    byte
}

/// Bytes of all lines.
const fn length(texts: &[&str]) -> usize {
    let mut length = 0;
    let mut index = 0;
    while index < texts.len() {
        length += texts[index].len() + 1;
        index += 1;
    }
    length
}

const fn joined<const N: usize>(texts: &[&str]) -> Lines<N> {
    let mut bytes = [0; N];
    let mut at = 0;
    let mut index = 0;
    while index < texts.len() {
        let text = texts[index].as_bytes();
        let mut from = 0;
        while from < text.len() {
            assert!(text[from].is_ascii() && text[from] != b'\n');
            bytes[at] = text[from];
            at += 1;
            from += 1;
        }
        bytes[at] = b'\n';
        at += 1;
        index += 1;
    }
    Lines(bytes)
}

/// The sentences in the order of the faults' codes, which start with one.
const SENTENCES: [&str; Fault::ALL.len()] = {
    let mut sentences = [""; Fault::ALL.len()];
    let mut index = 0;
    while index < sentences.len() {
        let fault = Fault::ALL[index];
        assert!(fault.code() as usize == index + 1);
        sentences[index] = fault.sentence();
        index += 1;
    }
    sentences
};

#[unsafe(link_section = ".progmem.data")]
static FAULT_LINES: Lines<{ length(&SENTENCES) }> = joined(&SENTENCES);

#[unsafe(link_section = ".progmem.data")]
static HELP_LINES: Lines<{ length(&HELP) }> = joined(&HELP);

/// The texts of this image.
pub struct FlashTexts;

impl Texts for FlashTexts {
    fn fault<W: uWrite + ?Sized>(&self, fault: Fault, out: &mut W) -> Result<(), W::Error> {
        FAULT_LINES.write(fault.code() - 1, out).map(|_| ())
    }

    fn help<W: uWrite + ?Sized>(&self, line: u8, out: &mut W) -> Result<bool, W::Error> {
        HELP_LINES.write(line, out)
    }
}
