//! The checksum of the program in flash: whether an upload was cut off.
//!
//! The build writes into the image how long it is and what its checksum is
//! (`xtask/src/image.rs`). The board reads its flash once, before its clock starts: 107 KiB take
//! 0.2 s, in which the outputs are those of a reset.

use core::arch::asm;

use wire::{
    answer::ImageSum,
    checksum::Crc16,
    stamp::{FLASH_BYTES, MARK, STAMP_BYTES},
};

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

/// Reads a byte anywhere in flash.
fn far_byte(at: u32) -> u8 {
    let [low, high, page, _] = at.to_le_bytes();
    let byte: u8;
    // SAFETY: reading flash changes nothing; RAMPZ (0x3b) is used here only, before interrupts
    // are on.
    unsafe {
        asm!("out 0x3b, {page}", "elpm {byte}, Z", page = in(reg) page, byte = out(reg) byte,
            in("Z") u16::from_le_bytes([low, high]), options(nostack, preserves_flags, readonly));
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
    for (at, byte) in (stamp..after).zip(&mut bytes) {
        *byte = far_byte(at);
    }
    let [a, b, c, d, low, high] = bytes;
    let end = u32::from_le_bytes([a, b, c, d]);
    if end > FLASH_BYTES {
        return None;
    }
    let mut crc = Crc16::new();
    for range in [0..stamp, after..end] {
        for at in range {
            crc.update(far_byte(at));
        }
    }
    Some(ImageSum {
        found: crc.value(),
        built: u16::from_le_bytes([low, high]),
    })
}
