//! A place in static memory for something that is made at start-up.
//!
//! The application is large. As a local variable of `main` it would hide in the
//! stack, where neither the linker's budget nor `avr-size` sees it, and most of
//! it out of reach of the processor's short addressing.

use core::{cell::UnsafeCell, mem::MaybeUninit};

/// Room for a `T`.
pub struct Place<T>(UnsafeCell<MaybeUninit<T>>);

// SAFETY: the only access is through [`Place::put`], whose caller promises to be
// alone.
unsafe impl<T> Sync for Place<T> {}

impl<T> Place<T> {
    /// An empty place.
    pub const fn new() -> Self {
        Self(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Puts a value there, for good.
    ///
    /// # Safety
    ///
    /// Only once.
    #[inline(always)]
    pub unsafe fn put(&'static self, value: T) -> &'static mut T {
        // SAFETY: called once, so nobody else has a reference.
        unsafe { (*self.0.get()).write(value) }
    }
}
