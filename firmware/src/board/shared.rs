//! What interrupts and the main program share.
//!
//! Single bytes go through the core library's atomics, whose loads and stores
//! are plain instructions here. Larger values need the interrupts off, and the
//! token of a critical section proves that they are.

use core::cell::Cell;

pub use avr_device::interrupt::{CriticalSection, free};

/// A value of several bytes, for interrupts and the main program.
pub struct Shared<T>(avr_device::interrupt::Mutex<Cell<T>>);

impl<T: Copy> Shared<T> {
    /// Creates it.
    pub const fn new(value: T) -> Self {
        Self(avr_device::interrupt::Mutex::new(Cell::new(value)))
    }

    /// The value.
    #[inline(always)]
    pub fn get(&self, section: CriticalSection<'_>) -> T {
        self.0.borrow(section).get()
    }

    /// Replaces the value.
    #[inline(always)]
    pub fn set(&self, section: CriticalSection<'_>, value: T) {
        self.0.borrow(section).set(value);
    }
}

/// The token, inside an interrupt.
///
/// # Safety
///
/// Only for interrupt handlers that leave interrupts off.
#[inline(always)]
pub unsafe fn in_interrupt<'cs>() -> CriticalSection<'cs> {
    // SAFETY: the processor switches interrupts off when it enters a handler.
    unsafe { CriticalSection::new() }
}
