//! Shared by tests: a memory whose power fails and whose cells wear out.

extern crate std;
use std::{vec, vec::Vec};

use crate::frame::ERASED;
use crate::store::Eeprom;

/// A memory of which only what stands behind `first` is written.
#[derive(Clone)]
pub struct Memory {
    /// What is in it.
    pub bytes: Vec<u8>,
    /// Bytes that were written.
    pub writes: u32,
    /// The write in which the power fails, counted from 1, and the byte that it leaves.
    pub fails: Option<(u32, u8)>,
    /// A worn-out cell.
    pub worn: Option<u16>,
    first: u16,
}

impl Memory {
    /// An erased one of so many bytes.
    pub fn erased(first: u16, size: u16) -> Self {
        Self {
            bytes: vec![ERASED; usize::from(size)],
            writes: 0,
            fails: None,
            worn: None,
            first,
        }
    }
}

impl Eeprom for Memory {
    fn read(&self, address: u16) -> u8 {
        self.bytes[usize::from(address)]
    }

    fn write(&mut self, address: u16, byte: u8) {
        assert!(address >= self.first, "{address} belongs to somebody else");
        self.writes += 1;
        let (last, in_flight) = self.fails.unwrap_or((u32::MAX, 0));
        if self.writes > last || self.worn == Some(address) {
            return;
        }
        let byte = if self.writes == last { in_flight } else { byte };
        self.bytes[usize::from(address)] = byte;
    }
}
