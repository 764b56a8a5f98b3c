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
    fn softrig_board_output_len(board: *const Opaque) -> usize;
    fn softrig_board_take_output(board: *mut Opaque, into: *mut u8);
    fn softrig_board_marks_len(board: *const Opaque) -> usize;
    fn softrig_board_take_marks(board: *mut Opaque, ids: *mut u8, cycles: *mut u64);
    fn softrig_board_first_written(board: *const Opaque, from: u16) -> u16;
}

/// How a stretch of simulation ended, in the shim's numbers.
pub(crate) enum Outcome {
    Running,
    Halted,
    Crashed,
    OutOfMemory,
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

    pub(crate) fn cycle(&self) -> u64 {
        // SAFETY: the handle is live until `drop`.
        unsafe { softrig_board_cycle(self.0.as_ptr()) }
    }

    pub(crate) fn run_until(&mut self, cycle: u64) -> Outcome {
        // SAFETY: the handle is live and, through `&mut`, not in use elsewhere.
        match unsafe { softrig_board_run_until(self.0.as_ptr(), cycle) } {
            0 => Outcome::Running,
            1 => Outcome::Halted,
            2 => Outcome::Crashed,
            _ => Outcome::OutOfMemory,
        }
    }

    pub(crate) fn take_output(&mut self) -> Vec<u8> {
        // SAFETY: the handle is live; the buffer has exactly the length that the
        // shim is about to write, and nothing runs in between.
        unsafe {
            let mut bytes = vec![0; softrig_board_output_len(self.0.as_ptr())];
            softrig_board_take_output(self.0.as_ptr(), bytes.as_mut_ptr());
            bytes
        }
    }

    pub(crate) fn first_written(&self, from: u16) -> u16 {
        // SAFETY: the handle is live, and the shim stays within the RAM.
        unsafe { softrig_board_first_written(self.0.as_ptr(), from) }
    }

    pub(crate) fn take_marks(&mut self) -> Vec<(u8, u64)> {
        // SAFETY: as for the output; both buffers have the shim's length.
        unsafe {
            let length = softrig_board_marks_len(self.0.as_ptr());
            let (mut ids, mut cycles) = (vec![0; length], vec![0; length]);
            softrig_board_take_marks(self.0.as_ptr(), ids.as_mut_ptr(), cycles.as_mut_ptr());
            ids.into_iter().zip(cycles).collect()
        }
    }
}

impl Drop for Simavr {
    fn drop(&mut self) {
        // SAFETY: the handle came from `softrig_board_new` and is freed once.
        unsafe { softrig_board_free(self.0.as_ptr()) }
    }
}
