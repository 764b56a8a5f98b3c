//! The vent valve: open unless it is held closed.

use firmware::io;

use super::pins::pin_type;

type Pin = pin_type!(Output, VALVE);

/// The valve's transistor.
pub struct Valve(Pin);

impl Valve {
    /// Creates the valve, open.
    ///
    /// # Safety
    ///
    /// Only once: the pin has one owner.
    pub unsafe fn new() -> Self {
        // SAFETY: passed on.
        let mut pin = unsafe { Pin::new() };
        pin.low();
        Self(pin)
    }

    /// Moves the valve.
    pub fn set(&mut self, valve: io::Valve) {
        match valve {
            io::Valve::Open => self.0.low(),
            io::Valve::Closed => self.0.high(),
        }
    }
}
