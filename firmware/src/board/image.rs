//! The checksum of the program in flash: whether an upload was cut off.
//!
//! The build writes into the image how long it is and what its checksum is
//! (`xtask/src/image.rs`). The board reads its flash once, before its clock starts: 107 KiB take
//! 0.2 s, in which the outputs are those of a reset.

use core::arch::asm;
use core::ops::Range;

use wire::{
    answer::ImageSum,
    checksum::Crc16,
    stamp::{FLASH_BYTES, MARK, STAMP_BYTES},
};

use super::registers::RAMPZ;

#[unsafe(link_section = ".progmem.data")]
#[used]
static STAMPED: [u8; MARK.len() + STAMP_BYTES] = {
    let mut bytes = [0xff; MARK.len() + STAMP_BYTES];
    let mut index = 0;
    while index < MARK.len() {
        bytes[index] = MARK[index];
        index += 1;
    }
    bytes
};

/// Adds the bytes of a range of flash to a checksum.
fn add(crc: &mut Crc16, range: Range<u32>) {
    let mut at = range.start;
    while at < range.end {
        // Within 64 KiB sixteen bits count, which is half of what a byte would take.
        let next = ((at | 0xffff) + 1).min(range.end);
        let [.., page, _] = at.to_le_bytes();
        let (mut z, end) = (at as u16, next as u16);
        loop {
            crc.update(byte_of(page, z));
            z = z.wrapping_add(1);
            if z == end {
                break;
            }
        }
        at = next;
    }
}

/// Reads a byte of flash from its 64 KiB.
fn byte_of(page: u8, at: u16) -> u8 {
    let byte: u8;
    // SAFETY: reading flash changes nothing; RAMPZ is used here only, before interrupts are on.
    unsafe {
        asm!("out {rampz}, {page}", "elpm {byte}, Z", rampz = const RAMPZ,
            page = in(reg) page, byte = out(reg) byte, in("Z") at, options(nostack, preserves_flags, readonly));
    }
    byte
}

/// The checksums of the program; none if its build wrote none.
#[inline(never)]
pub fn sum() -> Option<ImageSum> {
    // Texts are in the lowest 64 KiB.
    let stamp = STAMPED.as_ptr().addr() as u32 + MARK.len() as u32;
    let after = stamp + STAMP_BYTES as u32;
    let mut bytes = [0; STAMP_BYTES];
    for (at, byte) in (stamp as u16..after as u16).zip(&mut bytes) {
        *byte = byte_of(0, at);
    }
    let [a, b, c, d, low, high] = bytes;
    let end = u32::from_le_bytes([a, b, c, d]);
    if end > FLASH_BYTES {
        return None;
    }
    let mut crc = Crc16::new();
    add(&mut crc, 0..stamp);
    add(&mut crc, after..end);
    Some(ImageSum {
        found: crc.value(),
        built: u16::from_le_bytes([low, high]),
    })
}
