// SPDX-License-Identifier: GPL-3.0-or-later
//! Reading an image from an ELF file, checked.
//!
//! simavr's own loader ends the whole process on a bad file, so the flash
//! contents are gathered here and handed over ready.

use std::{fs, io, path::Path};

use object::{
    Endianness,
    elf::{EM_AVR, FileHeader32, PT_LOAD},
    read::elf::{FileHeader, ProgramHeader},
};

/// Flash of the ATmega2560 in bytes.
pub const FLASH_BYTES: usize = 256 * 1024;

/// Load addresses from here on are data space, EEPROM or fuses, not flash.
const FLASH_ADDRESS_END: u32 = 0x0080_0000;

/// Load addresses of the data space carry this; EEPROM starts at the next.
const DATA_ADDRESSES: std::ops::Range<u32> = FLASH_ADDRESS_END..0x0081_0000;

/// Why a file is not an image for the board.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImageError {
    /// The file cannot be read.
    #[error("cannot read it; `cargo xtask firmware` builds one")]
    Unreadable(#[source] io::Error),
    /// The bytes are no ELF file, or a damaged one.
    #[error(
        "not a 32-bit ELF file ({0}); expected the firmware.elf that `cargo xtask firmware` builds"
    )]
    NotElf(object::read::Error),
    /// The file is for another processor.
    #[error("an ELF file for another processor (machine {0}); expected AVR (83)")]
    OtherProcessor(u16),
    /// A part lies outside the flash.
    #[error("{bytes} bytes at {address:#x} do not fit into 256 KiB of flash")]
    TooLarge {
        /// Load address in flash.
        address: u32,
        /// Length.
        bytes: usize,
    },
    /// There is nothing to run.
    #[error("the file holds no code")]
    Empty,
}

/// Flash contents, known to fit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    flash: Vec<u8>,
    static_data_end: u16,
}

impl Image {
    /// Reads the ELF file at `path`.
    ///
    /// # Errors
    ///
    /// [`ImageError`] says what is wrong with the file.
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let bytes = fs::read(path).map_err(ImageError::Unreadable)?;
        Self::parse(&bytes)
    }

    /// Gathers the flash contents from the bytes of an ELF file.
    ///
    /// # Errors
    ///
    /// [`ImageError`] says what is wrong with the file.
    pub fn parse(bytes: &[u8]) -> Result<Self, ImageError> {
        let header = FileHeader32::<Endianness>::parse(bytes).map_err(ImageError::NotElf)?;
        let endian = header.endian().map_err(ImageError::NotElf)?;
        let machine = header.e_machine(endian);
        if machine != EM_AVR {
            return Err(ImageError::OtherProcessor(machine));
        }
        let mut flash = Vec::new();
        let mut static_data_end = 0;
        for segment in header
            .program_headers(endian, bytes)
            .map_err(ImageError::NotElf)?
        {
            let address = segment.p_paddr(endian);
            if segment.p_type(endian) != PT_LOAD {
                continue;
            }
            let runs_at = segment.p_vaddr(endian);
            if DATA_ADDRESSES.contains(&runs_at) {
                let end = (runs_at - DATA_ADDRESSES.start).saturating_add(segment.p_memsz(endian));
                static_data_end = static_data_end.max(u16::try_from(end).unwrap_or(u16::MAX));
            }
            if address >= FLASH_ADDRESS_END {
                continue;
            }
            let data = segment
                .data(endian, bytes)
                .map_err(|()| ImageError::Empty)?;
            if data.is_empty() {
                continue;
            }
            let too_large = ImageError::TooLarge {
                address,
                bytes: data.len(),
            };
            let Some((start, end)) = usize::try_from(address)
                .ok()
                .and_then(|start| Some((start, start.checked_add(data.len())?)))
                .filter(|&(_, end)| end <= FLASH_BYTES)
            else {
                return Err(too_large);
            };
            if flash.len() < end {
                // Erased flash reads as ones.
                flash.resize(end, 0xff);
            }
            flash[start..end].copy_from_slice(data);
        }
        if flash.is_empty() {
            return Err(ImageError::Empty);
        }
        Ok(Self {
            flash,
            static_data_end,
        })
    }

    /// An erased flash: a new board, with nothing but its bootloader.
    pub fn erased() -> Self {
        Self {
            flash: Vec::new(),
            static_data_end: 0,
        }
    }

    /// The address in RAM behind the last variable, where the stack may grow to.
    pub fn static_data_end(&self) -> u16 {
        self.static_data_end
    }

    /// The flash from address 0 to the last used byte.
    pub fn flash(&self) -> &[u8] {
        &self.flash
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A minimal ELF file with one segment.
    fn elf(machine: u16, address: u32, data: &[u8]) -> Vec<u8> {
        elf_at(machine, address, address, data)
    }

    fn elf_at(machine: u16, runs_at: u32, address: u32, data: &[u8]) -> Vec<u8> {
        let mut file = vec![0x7f, b'E', b'L', b'F', 1, 1, 1, 0];
        file.resize(16, 0);
        for half in [2u16, machine] {
            file.extend(half.to_le_bytes());
        }
        for word in [1u32, 0, 52, 0, 0] {
            file.extend(word.to_le_bytes());
        }
        for half in [52u16, 32, 1, 0, 0, 0] {
            file.extend(half.to_le_bytes());
        }
        let length = u32::try_from(data.len()).unwrap();
        for word in [1u32, 84, runs_at, address, length, length, 5, 1] {
            file.extend(word.to_le_bytes());
        }
        file.extend(data);
        file
    }

    #[test]
    fn gathers_the_flash_and_fills_gaps_with_ones() {
        let image = Image::parse(&elf(83, 4, &[1, 2, 3])).unwrap();
        assert_eq!(image.flash(), [0xff, 0xff, 0xff, 0xff, 1, 2, 3]);
    }

    #[test]
    fn knows_where_variables_end() {
        let initial_values = elf_at(83, 0x0080_0200, 100, &[1, 2, 3]);
        let image = Image::parse(&initial_values).unwrap();
        assert_eq!(image.static_data_end(), 0x203);
        assert_eq!(image.flash().len(), 103);
        assert_eq!(
            Image::parse(&elf(83, 0, &[1])).unwrap().static_data_end(),
            0
        );
    }

    #[test]
    fn refuses_what_is_not_for_the_board() {
        assert!(matches!(
            Image::parse(b"#!/bin/sh"),
            Err(ImageError::NotElf(_))
        ));
        assert!(matches!(
            Image::parse(&elf(40, 0, &[1])),
            Err(ImageError::OtherProcessor(40))
        ));
        assert!(matches!(
            Image::parse(&elf(83, 0x3_ffff, &[1, 2])),
            Err(ImageError::TooLarge { bytes: 2, .. })
        ));
        assert!(matches!(
            Image::parse(&elf(83, 0x0081_0000, &[1])),
            Err(ImageError::Empty)
        ));
    }

    #[test]
    fn refuses_a_truncated_file() {
        let whole = elf(83, 0, &[1, 2, 3, 4]);
        for length in 0..whole.len() {
            assert!(Image::parse(&whole[..length]).is_err(), "{length} bytes");
        }
    }
}
