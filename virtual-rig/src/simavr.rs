// SPDX-License-Identifier: GPL-3.0-or-later
//! The only unsafe code of this crate: calls into `shim.c`, owned and checked.
#![allow(unsafe_code)]

use std::{
    ffi::{CStr, c_char, c_int},
    marker::{PhantomData, PhantomPinned},
    ptr::NonNull,
};

#[repr(C)]
struct Opaque {
    _data: [u8; 0],
    _neither_send_nor_sync: PhantomData<(*mut u8, PhantomPinned)>,
}

/// Numbers in the shim's table of converter noise.
pub(crate) const NOISE_TABLE: usize = 4096;

/// Analog inputs that the shim drives.
pub(crate) const CHANNELS: u8 = 8;

// SAFETY: the signatures are those of `shim.c`, which this crate compiles.
unsafe extern "C" {
    fn softrig_board_new(
        processor: *const c_char,
        hertz: u32,
        supply_millivolts: u32,
        flash: *const u8,
        flash_len: u32,
    ) -> *mut Opaque;
    fn softrig_board_free(board: *mut Opaque);
    fn softrig_board_cycle(board: *const Opaque) -> u64;
    fn softrig_board_run_until(board: *mut Opaque, cycle: u64) -> c_int;
    fn softrig_board_skip_to(board: *mut Opaque, cycle: u64);
    fn softrig_board_send(board: *mut Opaque, bytes: *const u8, len: usize) -> c_int;
    fn softrig_board_unsent(board: *const Opaque) -> usize;
    fn softrig_board_overruns(board: *const Opaque) -> u64;
    fn softrig_board_output_len(board: *const Opaque) -> usize;
    fn softrig_board_take_output(board: *mut Opaque, into: *mut u8);
    fn softrig_board_marks_len(board: *const Opaque) -> usize;
    fn softrig_board_take_marks(board: *mut Opaque, ids: *mut u8, cycles: *mut u64);
    fn softrig_board_mark_total(
        board: *const Opaque,
        id: u8,
        cycles: *mut u64,
        longest: *mut u64,
        count: *mut u64,
    );
    fn softrig_board_slept(board: *const Opaque) -> u64;
    fn softrig_board_eeprom_len(board: *const Opaque) -> u32;
    fn softrig_board_eeprom_get(board: *mut Opaque, into: *mut u8);
    fn softrig_board_eeprom_set(board: *mut Opaque, from: *const u8);
    fn softrig_board_eeprom_writing(board: *mut Opaque) -> i32;
    fn softrig_board_eeprom_tear(board: *mut Opaque, value: u8);
    fn softrig_board_eeprom_writes(board: *mut Opaque) -> u64;
    fn softrig_board_driven(board: *const Opaque, port: c_char, bit: u8) -> c_int;
    fn softrig_board_set_input(board: *mut Opaque, port: c_char, bit: u8, level: c_int);
    fn softrig_board_wire_stepper(
        board: *mut Opaque,
        ports: *const c_char,
        bits: *const u8,
        position: i64,
        lowest: i64,
        highest: i64,
    );
    fn softrig_board_stall(board: *mut Opaque, stalled: c_int);
    fn softrig_board_reverse(board: *mut Opaque, reversed: c_int);
    fn softrig_board_tremble(board: *mut Opaque, trembles: c_int);
    fn softrig_board_skip(board: *mut Opaque, skips: c_int);
    fn softrig_board_hang(board: *mut Opaque, deaf: c_int);
    fn softrig_board_set_supply(board: *mut Opaque, millivolts: u32);
    fn softrig_board_stepper(
        board: *const Opaque,
        position: *mut i64,
        edges: *mut u64,
        lost: *mut u64,
    );
    fn softrig_board_trace_steps(board: *mut Opaque, on: c_int);
    fn softrig_board_step_cycles_len(board: *const Opaque) -> usize;
    fn softrig_board_take_step_cycles(board: *mut Opaque, into: *mut u64);
    fn softrig_board_set_analog(board: *mut Opaque, channel: u8, millivolts: f64, noise: f64);
    fn softrig_board_seed_noise(board: *mut Opaque, table: *const f32, seed: u64);
    fn softrig_board_reset(board: *mut Opaque, flags: u8, power_on: c_int);
    fn softrig_board_resets(board: *const Opaque) -> u64;
    fn softrig_board_clear_flags(board: *mut Opaque, clears: c_int);
    fn softrig_board_reset_flags(board: *const Opaque) -> u8;
    fn softrig_board_first_written(board: *const Opaque, from: u16) -> u16;
    fn softrig_board_flash_get(board: *const Opaque, address: u32, into: *mut u8, len: u32);
    fn softrig_board_flash_set(board: *mut Opaque, address: u32, from: *const u8, len: u32);
    fn softrig_board_data_get(board: *const Opaque, address: u16) -> u8;
    fn softrig_board_take_peripherals(board: *mut Opaque);
    fn softrig_board_enter(
        board: *mut Opaque,
        data: *mut u8,
        at: u32,
        through: u32,
        limit: u32,
        passed: *mut c_int,
    ) -> u32;
    fn softrig_board_writes_len(board: *const Opaque) -> usize;
    fn softrig_board_get_writes(board: *const Opaque, addresses: *mut u16, values: *mut u8);
}

/// Registers and memory of an ATmega2560.
pub(crate) const DATA_BYTES: usize = 0x2200;

/// How a stretch of simulation ended, in the shim's numbers.
pub(crate) enum Outcome {
    Running,
    Halted,
    Crashed,
    OutOfMemory,
}

/// Microsteps as the shim counts them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stepper {
    pub(crate) position: i64,
    pub(crate) edges: u64,
    pub(crate) lost: u64,
}

/// An owned simavr board.
pub(crate) struct Simavr(NonNull<Opaque>);

impl Simavr {
    /// Creates a board with its flash loaded, or nothing if simavr refuses.
    pub(crate) fn new(
        processor: &CStr,
        hertz: u32,
        supply_millivolts: u32,
        flash: &[u8],
    ) -> Option<Self> {
        let length = u32::try_from(flash.len()).ok()?;
        // SAFETY: both pointers are valid for the stated lengths during the
        // call, and the shim copies what it keeps.
        let board = unsafe {
            softrig_board_new(
                processor.as_ptr(),
                hertz,
                supply_millivolts,
                flash.as_ptr(),
                length,
            )
        };
        NonNull::new(board).map(Self)
    }

    fn get(&self) -> *const Opaque {
        self.0.as_ptr()
    }

    fn get_mut(&mut self) -> *mut Opaque {
        self.0.as_ptr()
    }

    pub(crate) fn cycle(&self) -> u64 {
        // SAFETY: the handle is live until `drop`.
        unsafe { softrig_board_cycle(self.get()) }
    }

    pub(crate) fn run_until(&mut self, cycle: u64) -> Outcome {
        // SAFETY: the handle is live and, through `&mut`, not in use elsewhere.
        match unsafe { softrig_board_run_until(self.get_mut(), cycle) } {
            0 => Outcome::Running,
            1 => Outcome::Halted,
            2 => Outcome::Crashed,
            _ => Outcome::OutOfMemory,
        }
    }

    pub(crate) fn skip_to(&mut self, cycle: u64) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_skip_to(self.get_mut(), cycle) }
    }

    /// Queues bytes for the receiver; false when memory is short.
    pub(crate) fn send(&mut self, bytes: &[u8]) -> bool {
        // SAFETY: the handle is live; the shim copies `len` bytes.
        unsafe { softrig_board_send(self.get_mut(), bytes.as_ptr(), bytes.len()) != 0 }
    }

    pub(crate) fn unsent(&self) -> usize {
        // SAFETY: the handle is live.
        unsafe { softrig_board_unsent(self.get()) }
    }

    pub(crate) fn overruns(&self) -> u64 {
        // SAFETY: the handle is live.
        unsafe { softrig_board_overruns(self.get()) }
    }

    pub(crate) fn take_output(&mut self) -> Vec<u8> {
        // SAFETY: the handle is live; the buffer has exactly the length that the
        // shim is about to write, and nothing runs in between.
        unsafe {
            let mut bytes = vec![0; softrig_board_output_len(self.get())];
            softrig_board_take_output(self.get_mut(), bytes.as_mut_ptr());
            bytes
        }
    }

    pub(crate) fn first_written(&self, from: u16) -> u16 {
        // SAFETY: the handle is live, and the shim stays within the RAM.
        unsafe { softrig_board_first_written(self.get(), from) }
    }

    pub(crate) fn take_marks(&mut self) -> Vec<(u8, u64)> {
        // SAFETY: as for the output; both buffers have the shim's length.
        unsafe {
            let length = softrig_board_marks_len(self.get());
            let (mut ids, mut cycles) = (vec![0; length], vec![0; length]);
            softrig_board_take_marks(self.get_mut(), ids.as_mut_ptr(), cycles.as_mut_ptr());
            ids.into_iter().zip(cycles).collect()
        }
    }

    /// Sum, longest and number of the stretches with this mark.
    pub(crate) fn mark_total(&self, id: u8) -> (u64, u64, u64) {
        let (mut cycles, mut longest, mut count) = (0, 0, 0);
        // SAFETY: the handle is live, the pointers are to live integers, and the
        // table has a row for every `u8`.
        unsafe {
            softrig_board_mark_total(
                self.get(),
                id,
                &raw mut cycles,
                &raw mut longest,
                &raw mut count,
            );
        }
        (cycles, longest, count)
    }

    pub(crate) fn slept(&self) -> u64 {
        // SAFETY: the handle is live.
        unsafe { softrig_board_slept(self.get()) }
    }

    fn eeprom_len(&self) -> usize {
        // SAFETY: the handle is live.
        unsafe { softrig_board_eeprom_len(self.get()) as usize }
    }

    pub(crate) fn eeprom(&mut self) -> Vec<u8> {
        let mut bytes = vec![0; self.eeprom_len()];
        // SAFETY: the buffer has the EEPROM's length.
        unsafe { softrig_board_eeprom_get(self.get_mut(), bytes.as_mut_ptr()) }
        bytes
    }

    /// Replaces the whole EEPROM; false when the length is not its own.
    pub(crate) fn set_eeprom(&mut self, bytes: &[u8]) -> bool {
        if bytes.len() != self.eeprom_len() {
            return false;
        }
        // SAFETY: the buffer has the EEPROM's length.
        unsafe { softrig_board_eeprom_set(self.get_mut(), bytes.as_ptr()) }
        true
    }

    pub(crate) fn eeprom_writing(&mut self) -> Option<u16> {
        // SAFETY: the handle is live and not in use elsewhere.
        u16::try_from(unsafe { softrig_board_eeprom_writing(self.get_mut()) }).ok()
    }

    pub(crate) fn tear_eeprom(&mut self, value: u8) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_eeprom_tear(self.get_mut(), value) }
    }

    pub(crate) fn eeprom_writes(&mut self) -> u64 {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_eeprom_writes(self.get_mut()) }
    }

    /// The level that the board drives, or nothing for an input. `port` is a
    /// letter from A to L, `bit` below 8.
    pub(crate) fn driven(&self, port: u8, bit: u8) -> Option<bool> {
        // SAFETY: the handle is live; every such port has registers in range.
        match unsafe { softrig_board_driven(self.get(), letter(port), bit) } {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }

    pub(crate) fn set_input(&mut self, port: u8, bit: u8, level: bool) {
        // SAFETY: the handle is live, and the shim has a slot for every port.
        unsafe { softrig_board_set_input(self.get_mut(), letter(port), bit, level.into()) }
    }

    pub(crate) fn wire_stepper(
        &mut self,
        pins: [(u8, u8); 3],
        position: i64,
        lowest: i64,
        highest: i64,
    ) {
        let ports = pins.map(|(port, _)| letter(port));
        let bits = pins.map(|(_, bit)| bit);
        // SAFETY: the handle is live, and both arrays have three items.
        unsafe {
            softrig_board_wire_stepper(
                self.get_mut(),
                ports.as_ptr(),
                bits.as_ptr(),
                position,
                lowest,
                highest,
            );
        }
    }

    pub(crate) fn reverse(&mut self, reversed: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_reverse(self.get_mut(), reversed.into()) }
    }

    pub(crate) fn tremble(&mut self, trembles: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_tremble(self.get_mut(), trembles.into()) }
    }

    pub(crate) fn skip_steps(&mut self, skips: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_skip(self.get_mut(), skips.into()) }
    }

    pub(crate) fn hang(&mut self, deaf: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_hang(self.get_mut(), deaf.into()) }
    }

    pub(crate) fn set_supply(&mut self, millivolts: u32) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_set_supply(self.get_mut(), millivolts) }
    }

    pub(crate) fn stall(&mut self, stalled: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_stall(self.get_mut(), stalled.into()) }
    }

    pub(crate) fn stepper(&self) -> Stepper {
        let mut stepper = Stepper::default();
        // SAFETY: the handle is live, and the pointers are to live integers.
        unsafe {
            softrig_board_stepper(
                self.get(),
                &raw mut stepper.position,
                &raw mut stepper.edges,
                &raw mut stepper.lost,
            );
        }
        stepper
    }

    pub(crate) fn trace_steps(&mut self, on: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_trace_steps(self.get_mut(), on.into()) }
    }

    pub(crate) fn take_step_cycles(&mut self) -> Vec<u64> {
        // SAFETY: as for the output.
        unsafe {
            let mut cycles = vec![0; softrig_board_step_cycles_len(self.get())];
            softrig_board_take_step_cycles(self.get_mut(), cycles.as_mut_ptr());
            cycles
        }
    }

    pub(crate) fn set_analog(&mut self, channel: u8, millivolts: f64, noise: f64) {
        // SAFETY: the handle is live, and the shim checks the channel.
        unsafe { softrig_board_set_analog(self.get_mut(), channel, millivolts, noise) }
    }

    pub(crate) fn seed_noise(&mut self, table: &[f32; NOISE_TABLE], seed: u64) {
        // SAFETY: the handle is live, and the table has the length of the shim's.
        unsafe { softrig_board_seed_noise(self.get_mut(), table.as_ptr(), seed) }
    }

    pub(crate) fn reset(&mut self, flags: u8, power_on: bool) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_reset(self.get_mut(), flags, power_on.into()) }
    }

    pub(crate) fn resets(&self) -> u64 {
        // SAFETY: the handle is live.
        unsafe { softrig_board_resets(self.get()) }
    }

    pub(crate) fn clear_flags(&mut self, clears: bool) {
        // SAFETY: the handle is live.
        unsafe { softrig_board_clear_flags(self.get_mut(), c_int::from(clears)) }
    }

    pub(crate) fn reset_flags(&self) -> u8 {
        // SAFETY: the handle is live.
        unsafe { softrig_board_reset_flags(self.get()) }
    }

    /// Copies flash; the caller keeps the range within it.
    pub(crate) fn flash(&self, address: u32, len: u32) -> Vec<u8> {
        assert!(in_flash(address, len));
        let mut bytes = vec![0; len as usize];
        // SAFETY: the buffer has `len` bytes, and the range lies in the flash.
        unsafe { softrig_board_flash_get(self.get(), address, bytes.as_mut_ptr(), len) }
        bytes
    }

    /// Replaces flash; the caller keeps the range within it.
    pub(crate) fn set_flash(&mut self, address: u32, bytes: &[u8]) {
        let len = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        assert!(in_flash(address, len));
        // SAFETY: the range lies in the flash, and the shim copies.
        unsafe { softrig_board_flash_set(self.get_mut(), address, bytes.as_ptr(), len) }
    }

    pub(crate) fn data(&self, address: u16) -> u8 {
        // SAFETY: the handle is live, and the shim checks the address.
        unsafe { softrig_board_data_get(self.get(), address) }
    }

    pub(crate) fn take_peripherals(&mut self) {
        // SAFETY: the handle is live and not in use elsewhere.
        unsafe { softrig_board_take_peripherals(self.get_mut()) }
    }

    /// Whether a handler passed through an address; nothing if it did not return.
    pub(crate) fn enter(
        &mut self,
        data: &mut [u8; DATA_BYTES],
        at: u32,
        through: u32,
        limit: u32,
    ) -> Option<bool> {
        let mut passed = 0;
        // SAFETY: the handle is live, and `data` has the length of the processor's data space.
        let taken = unsafe {
            let data = data.as_mut_ptr();
            softrig_board_enter(self.get_mut(), data, at, through, limit, &raw mut passed)
        };
        (taken > 0).then_some(passed != 0)
    }

    pub(crate) fn writes(&self) -> Vec<(u16, u8)> {
        // SAFETY: the handle is live; both buffers have the shim's length.
        unsafe {
            let length = softrig_board_writes_len(self.get());
            let (mut addresses, mut values) = (vec![0; length], vec![0; length]);
            softrig_board_get_writes(self.get(), addresses.as_mut_ptr(), values.as_mut_ptr());
            addresses.into_iter().zip(values).collect()
        }
    }
}

fn in_flash(address: u32, len: u32) -> bool {
    u64::from(address) + u64::from(len) <= crate::image::FLASH_BYTES as u64
}

fn letter(port: u8) -> c_char {
    debug_assert!(matches!(port, b'A'..=b'H' | b'J'..=b'L'));
    port.cast_signed() as c_char
}

impl Drop for Simavr {
    fn drop(&mut self) {
        // SAFETY: the handle came from `softrig_board_new` and is freed once.
        unsafe { softrig_board_free(self.0.as_ptr()) }
    }
}
