//! Digital pins, owned by value: whoever has the pin may drive it, nobody else.
//!
//! Setting a pin is one instruction, `sbi` or `cbi`. That is not only fast: ports
//! are shared between the main program and interrupts, and a read-modify-write of
//! three instructions would now and then undo what an interrupt did in between.

use core::{arch::asm, convert::Infallible};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use firmware::wiring::Pin;

/// An output. `PORT` is the I/O address of the port, `BIT` the bit in it.
pub struct Output<const PORT: u8, const BIT: u8>(());

/// An input with its pull-up on.
pub struct Input<const PORT: u8, const BIT: u8>(());

/// The direction register of a port.
const fn direction(port: u8) -> u8 {
    port - 1
}

/// The input register of a port.
const fn input(port: u8) -> u8 {
    port - 2
}

impl<const PORT: u8, const BIT: u8> Output<PORT, BIT> {
    const CHECKED: () = assert!(PORT >= 2 && PORT < 32 && BIT < 8);

    /// Makes the pin an output, low unless it was set before.
    ///
    /// # Safety
    ///
    /// No other value may own the same pin.
    pub unsafe fn new() -> Self {
        let () = Self::CHECKED;
        // SAFETY: one instruction on the direction bit of a pin that we own.
        unsafe {
            asm!("sbi {register}, {bit}", register = const direction(PORT), bit = const BIT,
                options(nostack, preserves_flags));
        }
        Self(())
    }

    /// Drives the pin high.
    #[inline(always)]
    pub fn high(&mut self) {
        // SAFETY: one instruction on a bit that we own.
        unsafe {
            asm!("sbi {register}, {bit}", register = const PORT, bit = const BIT,
                options(nostack, preserves_flags));
        }
    }

    /// Whether the pin is high, whoever drives it: a timer may. Looking needs no owner.
    #[inline(always)]
    pub fn is_set() -> bool {
        Input::<PORT, BIT>::peek()
    }

    /// Drives the pin low.
    #[inline(always)]
    pub fn low(&mut self) {
        // SAFETY: as above.
        unsafe {
            asm!("cbi {register}, {bit}", register = const PORT, bit = const BIT,
                options(nostack, preserves_flags));
        }
    }
}

impl<const PORT: u8, const BIT: u8> Input<PORT, BIT> {
    /// Makes the pin an input with pull-up.
    ///
    /// # Safety
    ///
    /// No other value may own the same pin.
    pub unsafe fn new() -> Self {
        // SAFETY: one instruction each on bits of a pin that we own.
        unsafe {
            asm!("cbi {direction}, {bit}", "sbi {port}, {bit}",
                direction = const direction(PORT), port = const PORT, bit = const BIT,
                options(nostack, preserves_flags));
        }
        Self(())
    }

    /// The pin beside its owner, to be looked at: that changes nothing.
    #[inline(always)]
    pub const fn beside() -> Self {
        Self(())
    }

    /// Whether the pin is high. Looking needs no owner.
    #[inline(always)]
    pub fn peek() -> bool {
        let levels: u8;
        // SAFETY: reading an input register changes nothing.
        unsafe {
            asm!("in {levels}, {register}", levels = out(reg) levels,
                register = const input(PORT), options(nostack, preserves_flags));
        }
        levels & (1 << BIT) != 0
    }
}

impl<const PORT: u8, const BIT: u8> ErrorType for Output<PORT, BIT> {
    type Error = Infallible;
}

impl<const PORT: u8, const BIT: u8> OutputPin for Output<PORT, BIT> {
    fn set_high(&mut self) -> Result<(), Infallible> {
        self.high();
        Ok(())
    }

    fn set_low(&mut self) -> Result<(), Infallible> {
        self.low();
        Ok(())
    }
}

impl<const PORT: u8, const BIT: u8> ErrorType for Input<PORT, BIT> {
    type Error = Infallible;
}

impl<const PORT: u8, const BIT: u8> InputPin for Input<PORT, BIT> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(Self::peek())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!Self::peek())
    }
}

/// The type of a pin as output or input, from its constant in
/// [`firmware::wiring`].
macro_rules! pin_type {
    ($kind:ident, $pin:ident) => {
        $crate::board::pins::$kind<
            { ::firmware::wiring::$pin.port_address() },
            { ::firmware::wiring::$pin.bit },
        >
    };
}
pub(super) use pin_type;

/// Whether a pin is where a peripheral needs it, for checks at compile time.
pub const fn is_at(pin: Pin, port: u8, bit: u8) -> bool {
    pin.port == port && pin.bit == bit
}
