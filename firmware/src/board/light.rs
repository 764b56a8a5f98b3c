//! The on-board light.

use super::pins::pin_type;

type Pin = pin_type!(Output, LIGHT);

/// The light beside pin 13.
pub struct Light(Pin);

impl Light {
    /// Creates the light, dark.
    ///
    /// # Safety
    ///
    /// Only once: the pin has one owner.
    pub unsafe fn new() -> Self {
        // SAFETY: passed on.
        Self(unsafe { Pin::new() })
    }

    /// Switches it.
    pub fn set(&mut self, on: bool) {
        if on { self.0.high() } else { self.0.low() }
    }
}
