//! The stamp in an image, by which a board and its programmer know whether it was written whole.
//!
//! The build writes it, the board compares it with its flash, and `softrig flash` compares it with what
//! the board then says. This file stands alone: the build takes it as it is.

/// How the place of the stamp is found: what stands before it.
pub const MARK: [u8; 10] = *b"softrigCRC";

/// Bytes of the stamp: length of the flash (4) and checksum of all but the stamp (2), little-endian.
/// All ones until the build has written it.
pub const STAMP_BYTES: usize = 6;

/// Flash of an ATmega2560 that the Mega's bootloader leaves to a program (bytes).
pub const FLASH_BYTES: u32 = 0x3_e000;
