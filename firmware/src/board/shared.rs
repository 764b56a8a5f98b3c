//! What interrupts and the main program share.
//!
//! A single byte is loaded and stored by one instruction, which no interrupt can divide. Larger
//! values need the interrupts off, and the token of a critical section proves that they are.

use core::{
    cell::{Cell, UnsafeCell},
    sync::atomic::{Ordering::SeqCst, compiler_fence},
};

use firmware::byte::Byte;

pub use avr_device::interrupt::{CriticalSection, free};

/// A byte for interrupts and the main program: one `lds` or `ld`, one `sts` or `st`.
///
/// The core library's `AtomicU8` does the same between `in SREG`, `cli` and `out SREG`.
/// [`firmware::byte`] says what that costs.
pub struct SharedByte(UnsafeCell<u8>);

// SAFETY: there is one core, every access below is a single volatile instruction, and nothing
// hands out a reference to what is inside.
unsafe impl Sync for SharedByte {}

impl SharedByte {
    /// Creates it.
    pub const fn new(value: u8) -> Self {
        Self(UnsafeCell::new(value))
    }
}

impl Byte for SharedByte {
    #[allow(clippy::declare_interior_mutable_const)] // An initial value is meant to be copied.
    const ZERO: Self = Self::new(0);

    #[inline(always)]
    fn get(&self) -> u8 {
        // SAFETY: a valid byte; volatile, so it is loaded once, and here.
        unsafe { self.0.get().read_volatile() }
    }

    #[inline(always)]
    fn set(&self, value: u8) {
        // SAFETY: a valid byte; volatile, so it is stored once, and here.
        unsafe { self.0.get().write_volatile(value) }
    }

    #[inline(always)]
    fn acquire(&self) -> u8 {
        let value = self.get();
        // An instruction to the compiler, not to the processor: one core has one order.
        compiler_fence(SeqCst);
        value
    }

    #[inline(always)]
    fn release(&self, value: u8) {
        compiler_fence(SeqCst);
        self.set(value);
    }
}

/// A flag for interrupts and the main program.
pub struct SharedFlag(SharedByte);

impl SharedFlag {
    /// Creates it.
    pub const fn new(value: bool) -> Self {
        Self(SharedByte::new(value as u8))
    }

    /// Its value; see [`Byte::get`].
    #[inline(always)]
    pub fn get(&self) -> bool {
        self.0.get() != 0
    }

    /// Replaces it; see [`Byte::set`].
    #[inline(always)]
    pub fn set(&self, value: bool) {
        self.0.set(u8::from(value));
    }

    /// Its value; see [`Byte::acquire`].
    #[inline(always)]
    pub fn acquire(&self) -> bool {
        self.0.acquire() != 0
    }

    /// Replaces it; see [`Byte::release`].
    #[inline(always)]
    pub fn release(&self, value: bool) {
        self.0.release(u8::from(value));
    }
}

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
