// SPDX-License-Identifier: GPL-3.0-or-later
//! The Mega's bootloader: STK500 version 2 over the serial line.
//!
//! It implements the part that `avrdude -c wiring` uses, with the answers of the Mega's `stk500boot`,
//! so that what flashes a board flashes the virtual rig. Source: Atmel AVR068, and the behaviour of a
//! board.
//!
//! A pure state machine: bytes in, bytes out, the memory behind a trait.

/// The memory that the bootloader writes and reads.
pub trait Memory {
    /// Reads flash; the range lies within [`FLASH_BYTES`](crate::image::FLASH_BYTES).
    fn read_flash(&mut self, address: u32, length: u32) -> Vec<u8>;
    /// Replaces flash; the range lies below [`BOOT_SECTION`].
    fn write_flash(&mut self, address: u32, bytes: &[u8]);
    /// Reads EEPROM; the range lies within it.
    fn read_eeprom(&mut self, address: u32, length: u32) -> Vec<u8>;
    /// Replaces EEPROM; the range lies within it.
    fn write_eeprom(&mut self, address: u32, bytes: &[u8]);
}

/// Where the bootloader itself starts (byte address): it does not overwrite
/// itself.
pub const BOOT_SECTION: u32 = 0x3_e000;

/// How long the bootloader waits for the first byte (s).
pub const LISTENS_S: f64 = 1.0;

/// Bytes of a page of flash, the most that one request writes.
pub const PAGE_BYTES: usize = 256;

const START: u8 = 0x1b;
const TOKEN: u8 = 0x0e;
const STATUS_OK: u8 = 0x00;
const STATUS_FAILED: u8 = 0xc0;
const SIGNATURE: [u8; 3] = [0x1e, 0x98, 0x01];
const FUSES: [u8; 3] = [0xff, 0xd8, 0xfd];
const LOCK: u8 = 0xcf;
#[allow(clippy::cast_possible_truncation)] // 256 KiB
const FLASH_END: u32 = crate::image::FLASH_BYTES as u32;
#[allow(clippy::cast_possible_truncation)] // 4 KiB
const EEPROM_END: u32 = crate::board::EEPROM_BYTES as u32;
/// A body is a page, ten bytes of header and some to spare.
const LONGEST_BODY: usize = PAGE_BYTES + 64;

mod command {
    pub const SIGN_ON: u8 = 0x01;
    pub const SET_PARAMETER: u8 = 0x02;
    pub const GET_PARAMETER: u8 = 0x03;
    pub const LOAD_ADDRESS: u8 = 0x06;
    pub const ENTER_PROGMODE: u8 = 0x10;
    pub const LEAVE_PROGMODE: u8 = 0x11;
    pub const CHIP_ERASE: u8 = 0x12;
    pub const PROGRAM_FLASH: u8 = 0x13;
    pub const READ_FLASH: u8 = 0x14;
    pub const PROGRAM_EEPROM: u8 = 0x15;
    pub const READ_EEPROM: u8 = 0x16;
    pub const READ_FUSE: u8 = 0x18;
    pub const READ_LOCK: u8 = 0x1a;
    pub const READ_SIGNATURE: u8 = 0x1b;
    pub const READ_OSCILLATOR: u8 = 0x1c;
    pub const SPI_MULTI: u8 = 0x1d;
}

/// The bootloader's next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// It waits for a first byte, for [`LISTENS_S`].
    Listening,
    /// A programmer talks to it.
    Programming,
    /// The application is to start.
    Leaving,
}

/// A bootloader after a reset.
///
/// Addresses count words of flash but bytes of EEPROM, a chip erase fails (pages are erased as they
/// are written; hence avrdude's `-D`), and a frame with a wrong checksum gets no answer. Writing to
/// the boot section is refused, as by the lock bits of a board.
#[derive(Clone, Debug)]
pub struct Bootloader {
    phase: Phase,
    frame: Vec<u8>,
    /// In words of flash or bytes of EEPROM.
    address: u32,
}

impl Default for Bootloader {
    fn default() -> Self {
        Self::new()
    }
}

impl Bootloader {
    /// A bootloader that has just started.
    pub fn new() -> Self {
        Self {
            phase: Phase::Listening,
            frame: Vec::new(),
            address: 0,
        }
    }

    /// Its next step.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Takes a byte from the line and returns what is answered.
    pub fn receive(&mut self, byte: u8, memory: &mut impl Memory) -> Vec<u8> {
        match self.phase {
            Phase::Listening if byte == START => self.phase = Phase::Programming,
            Phase::Listening => {
                self.phase = Phase::Leaving;
                return Vec::new();
            }
            Phase::Programming => {}
            Phase::Leaving => return Vec::new(),
        }
        self.frame.push(byte);
        let malformed = match self.frame.len() {
            1 => byte != START,
            4 => !(1..=LONGEST_BODY).contains(&self.body_len()),
            5 => byte != TOKEN,
            _ => false,
        };
        if malformed {
            self.frame.clear();
            return Vec::new();
        }
        if self.frame.len() < 5 || self.frame.len() < 5 + self.body_len() + 1 {
            return Vec::new();
        }
        let frame = std::mem::take(&mut self.frame);
        if xor(&frame) != 0 {
            return Vec::new();
        }
        let answer = self.obey(&frame[5..frame.len() - 1], memory);
        seal(frame[1], &answer)
    }

    fn body_len(&self) -> usize {
        usize::from(u16::from_be_bytes([self.frame[2], self.frame[3]]))
    }

    fn obey(&mut self, body: &[u8], memory: &mut impl Memory) -> Vec<u8> {
        let command = body[0];
        let good = |rest: &[u8]| [&[command, STATUS_OK], rest].concat();
        let answer = match *body {
            [command::SIGN_ON] => Some(good(b"\x08AVRISP_2")),
            [command::SET_PARAMETER | command::ENTER_PROGMODE, ..] => Some(good(&[])),
            [command::GET_PARAMETER, parameter] => Some(good(&[parameter_value(parameter)])),
            [command::LOAD_ADDRESS, a, b, c, d] => {
                // The highest bit only says that the address needs 24 bits.
                self.address = u32::from_be_bytes([a & 0x7f, b, c, d]);
                Some(good(&[]))
            }
            [command::LEAVE_PROGMODE, ..] => {
                self.phase = Phase::Leaving;
                Some(good(&[]))
            }
            [
                command::PROGRAM_FLASH,
                high,
                low,
                _,
                _,
                _,
                _,
                _,
                _,
                _,
                ref data @ ..,
            ] if data.len() == length(high, low) && data.len() <= PAGE_BYTES => {
                self.range(2, data.len(), BOOT_SECTION).map(|at| {
                    memory.write_flash(at, data);
                    good(&[])
                })
            }
            [
                command::PROGRAM_EEPROM,
                high,
                low,
                _,
                _,
                _,
                _,
                _,
                _,
                _,
                ref data @ ..,
            ] if data.len() == length(high, low) => {
                self.range(1, data.len(), EEPROM_END).map(|at| {
                    memory.write_eeprom(at, data);
                    good(&[])
                })
            }
            [command::READ_FLASH, high, low, _] if length(high, low) <= PAGE_BYTES => {
                self.range(2, length(high, low), FLASH_END).map(|at| {
                    let mut data =
                        memory.read_flash(at, u32::from(u16::from_be_bytes([high, low])));
                    data.push(STATUS_OK);
                    good(&data)
                })
            }
            [command::READ_EEPROM, high, low, _] if length(high, low) <= PAGE_BYTES => {
                self.range(1, length(high, low), EEPROM_END).map(|at| {
                    let mut data =
                        memory.read_eeprom(at, u32::from(u16::from_be_bytes([high, low])));
                    data.push(STATUS_OK);
                    good(&data)
                })
            }
            [
                command::READ_FUSE
                | command::READ_LOCK
                | command::READ_SIGNATURE
                | command::READ_OSCILLATOR,
                _,
                a,
                b,
                c,
                _,
            ] => Some(good(&[isp(a, b, c), STATUS_OK])),
            [command::SPI_MULTI, _, _, _, a, b, c, _, ..] => {
                Some(good(&[0, a, 0, isp(a, b, c), STATUS_OK]))
            }
            // Fails on a Mega too: see `CHIP_ERASE` in the head of this file.
            [command::CHIP_ERASE, ..] | [..] => None,
        };
        answer.unwrap_or_else(|| vec![command, STATUS_FAILED])
    }

    /// The byte address of `length` bytes from the loaded address, if they end
    /// at or before `end`; the address then moves on behind them.
    fn range(&mut self, unit: u32, length: usize, end: u32) -> Option<u32> {
        let length = u32::try_from(length).ok()?;
        let start = self.address.checked_mul(unit)?;
        let behind = start.checked_add(length)?;
        if length == 0 || behind > end {
            return None;
        }
        self.address = behind.div_ceil(unit);
        Some(start)
    }
}

fn length(high: u8, low: u8) -> usize {
    usize::from(u16::from_be_bytes([high, low]))
}

/// The instructions of serial programming that only read.
fn isp(a: u8, b: u8, c: u8) -> u8 {
    match (a, b) {
        (0x30, _) => SIGNATURE[usize::from(c).min(2)],
        (0x50, 0x00) => FUSES[0],
        (0x58, 0x08) => FUSES[1],
        (0x50, 0x08) => FUSES[2],
        (0x58, 0x00) => LOCK,
        _ => 0,
    }
}

fn parameter_value(parameter: u8) -> u8 {
    match parameter {
        0x90 => 15, // hardware
        0x91 => 2,  // software, major
        0x92 => 10, // software, minor
        _ => 0,
    }
}

fn xor(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// Puts a body into a frame.
///
/// ```text
/// request, answer:  1b  sequence  length (2, big-endian)  0e  body  xor of all before
/// body:             command, then parameters or a status (00 good, c0 failed)
/// ```
pub fn seal(sequence: u8, body: &[u8]) -> Vec<u8> {
    let length = u16::try_from(body.len()).unwrap_or(u16::MAX).to_be_bytes();
    let mut frame = vec![START, sequence, length[0], length[1], TOKEN];
    frame.extend(body);
    frame.push(xor(&frame));
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Fake {
        flash: Vec<u8>,
        eeprom: Vec<u8>,
    }

    impl Memory for Fake {
        fn read_flash(&mut self, address: u32, length: u32) -> Vec<u8> {
            self.flash[address as usize..][..length as usize].to_vec()
        }
        fn write_flash(&mut self, address: u32, bytes: &[u8]) {
            self.flash[address as usize..][..bytes.len()].copy_from_slice(bytes);
        }
        fn read_eeprom(&mut self, address: u32, length: u32) -> Vec<u8> {
            self.eeprom[address as usize..][..length as usize].to_vec()
        }
        fn write_eeprom(&mut self, address: u32, bytes: &[u8]) {
            self.eeprom[address as usize..][..bytes.len()].copy_from_slice(bytes);
        }
    }

    struct Session {
        loader: Bootloader,
        memory: Fake,
        sequence: u8,
    }

    impl Session {
        fn new() -> Self {
            Self {
                loader: Bootloader::new(),
                memory: Fake {
                    flash: vec![0xff; FLASH_END as usize],
                    eeprom: vec![0xff; EEPROM_END as usize],
                },
                sequence: 0,
            }
        }

        fn send(&mut self, bytes: &[u8]) -> Vec<u8> {
            let mut answer = Vec::new();
            for &byte in bytes {
                answer.extend(self.loader.receive(byte, &mut self.memory));
            }
            answer
        }

        /// The body of the answer to a body.
        fn ask(&mut self, body: &[u8]) -> Vec<u8> {
            self.sequence = self.sequence.wrapping_add(1);
            let answer = self.send(&seal(self.sequence, body));
            assert_eq!(answer[..2], [START, self.sequence]);
            assert_eq!(answer[4], TOKEN);
            assert_eq!(xor(&answer), 0);
            assert_eq!(answer.len(), 6 + length(answer[2], answer[3]));
            answer[5..answer.len() - 1].to_vec()
        }

        fn address(&mut self, address: u32) {
            let [a, b, c, d] = address.to_be_bytes();
            assert_eq!(self.ask(&[6, a, b, c, d]), [6, 0]);
        }

        fn program(&mut self, command: u8, data: &[u8]) -> Vec<u8> {
            let [high, low] = u16::try_from(data.len()).unwrap().to_be_bytes();
            let mut body = vec![command, high, low, 0xc1, 10, 0x40, 0x4c, 0x20, 0, 0];
            body.extend(data);
            self.ask(&body)
        }
    }

    #[test]
    fn signs_on_byte_for_byte() {
        let mut session = Session::new();
        let request = [0x1b, 0x01, 0x00, 0x01, 0x0e, 0x01, 0x14];
        assert_eq!(
            session.send(&request),
            *b"\x1b\x01\x00\x0b\x0e\x01\x00\x08AVRISP_2\x74"
        );
        assert_eq!(session.loader.phase(), Phase::Programming);
    }

    #[test]
    fn pages_are_written_one_after_the_other_and_read_back() {
        let mut session = Session::new();
        let page: Vec<u8> = (0..=255).collect();
        session.address(0x8000_0000 | 0x1_0000); // words: byte 0x20000
        assert_eq!(session.program(0x13, &page), [0x13, 0]);
        assert_eq!(session.program(0x13, &page[..100]), [0x13, 0]);
        assert_eq!(session.memory.flash[0x2_0000..][..256], page);
        assert_eq!(session.memory.flash[0x2_0100..][..100], page[..100]);
        session.address(0x1_0000);
        let answer = session.ask(&[0x14, 1, 0, 0x20]);
        assert_eq!(answer, [&[0x14, 0], &page[..], &[0]].concat());
    }

    #[test]
    fn eeprom_addresses_count_bytes() {
        let mut session = Session::new();
        session.address(100);
        assert_eq!(session.program(0x15, &[1, 2, 3]), [0x15, 0]);
        assert_eq!(session.program(0x15, &[4]), [0x15, 0]);
        assert_eq!(session.memory.eeprom[99..105], [0xff, 1, 2, 3, 4, 0xff]);
        session.address(101);
        assert_eq!(session.ask(&[0x16, 0, 2, 0xa0]), [0x16, 0, 2, 3, 0]);
        session.address(4095);
        assert_eq!(session.program(0x15, &[1, 2]), [0x15, 0xc0]);
    }

    #[test]
    fn the_boot_section_is_refused() {
        let mut session = Session::new();
        session.address((BOOT_SECTION - 256) / 2);
        assert_eq!(session.program(0x13, &[0; 256]), [0x13, 0]);
        assert_eq!(session.program(0x13, &[0; 256]), [0x13, 0xc0]);
        session.address((BOOT_SECTION - 128) / 2);
        assert_eq!(session.program(0x13, &[0; 256]), [0x13, 0xc0]);
        assert!(
            session.memory.flash[BOOT_SECTION as usize..]
                .iter()
                .all(|&b| b == 0xff)
        );
        session.address(u32::MAX);
        assert_eq!(session.program(0x13, &[0; 2]), [0x13, 0xc0]);
        assert_eq!(session.ask(&[0x14, 0, 2, 0x20]), [0x14, 0xc0]);
    }

    #[test]
    fn identifies_an_atmega2560() {
        let mut session = Session::new();
        for (index, byte) in (0..).zip(SIGNATURE) {
            assert_eq!(
                session.ask(&[0x1b, 4, 0x30, 0, index, 0]),
                [0x1b, 0, byte, 0]
            );
            assert_eq!(
                session.ask(&[0x1d, 4, 4, 0, 0x30, 0, index, 0]),
                [0x1d, 0, 0, 0x30, 0, byte, 0]
            );
        }
        assert_eq!(session.ask(&[0x18, 4, 0x58, 8, 0, 0]), [0x18, 0, 0xd8, 0]);
        assert_eq!(session.ask(&[0x03, 0x91]), [0x03, 0, 2]);
        assert_eq!(session.ask(&[0x02, 0x9e, 1]), [0x02, 0]);
        assert_eq!(session.ask(&[0x12, 9, 0, 0xac, 0x80, 0, 0]), [0x12, 0xc0]);
        assert_eq!(session.ask(&[0x77]), [0x77, 0xc0]);
    }

    #[test]
    fn damaged_frames_are_ignored_and_the_next_is_understood() {
        let mut session = Session::new();
        let mut wrong = seal(1, &[1]);
        *wrong.last_mut().unwrap() ^= 1;
        assert!(session.send(&wrong).is_empty());
        // No token, no length, far too long, noise in between.
        assert!(session.send(&[0x1b, 1, 0, 1, 0x0f]).is_empty());
        assert!(session.send(&[0x1b, 1, 0, 0]).is_empty());
        assert!(session.send(&[0x1b, 1, 0xff, 0xff]).is_empty());
        assert!(session.send(b"noise").is_empty());
        assert_eq!(session.ask(&[1])[..2], [1, 0]);
    }

    #[test]
    fn truncated_bodies_fail_and_do_not_panic() {
        for command in 0..=255 {
            for length in 0..12 {
                let mut session = Session::new();
                let body = [vec![command], vec![0xff; length]].concat();
                session.ask(&body);
            }
        }
    }

    #[test]
    fn leaves_for_the_application_on_command_and_on_other_bytes() {
        let mut session = Session::new();
        assert_eq!(
            session.ask(&[0x10, 200, 100, 25, 32, 0, 0x53, 3, 0xac, 0x53, 0, 0]),
            [0x10, 0]
        );
        assert_eq!(session.ask(&[0x11, 1, 1]), [0x11, 0]);
        assert_eq!(session.loader.phase(), Phase::Leaving);
        let mut session = Session::new();
        assert!(session.send(b"h").is_empty());
        assert_eq!(session.loader.phase(), Phase::Leaving);
    }
}
