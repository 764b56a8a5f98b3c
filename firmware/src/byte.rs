//! A byte that an interrupt and the main program share.
//!
//! On the board a load and a store of a byte are one instruction each, which no interrupt can
//! divide; only the compiler could move other accesses across them. The core library's atomics
//! ask for more than that: the AVR backend switches the interrupts off around each of them, which
//! took 5 of 57 points of processor time at full flow and held up step edges by 116 cycles. So
//! the board has a type of its own, whose unsafe code lies with the registers, and a desktop
//! has the core library's, for which tools know what may be reordered.

use core::sync::atomic::{
    AtomicU8,
    Ordering::{Acquire, Relaxed, Release},
};

/// A byte of which one side is read or written at a time, never both in one access: there is
/// no operation here that reads, changes and writes.
pub trait Byte {
    /// A byte that is zero.
    const ZERO: Self;

    /// Its value; says nothing about other memory.
    fn get(&self) -> u8;

    /// Replaces it; says nothing about other memory.
    fn set(&self, value: u8);

    /// Its value. What the other side wrote before it released this value can be read after.
    fn acquire(&self) -> u8;

    /// Replaces it. What was written before can be read by who acquires this value.
    fn release(&self, value: u8);
}

impl Byte for AtomicU8 {
    // Copied wherever it is used, which is what is wanted of an initial value.
    #[allow(clippy::declare_interior_mutable_const)]
    const ZERO: Self = Self::new(0);

    fn get(&self) -> u8 {
        self.load(Relaxed)
    }

    fn set(&self, value: u8) {
        self.store(value, Relaxed);
    }

    fn acquire(&self) -> u8 {
        self.load(Acquire)
    }

    fn release(&self, value: u8) {
        self.store(value, Release);
    }
}
