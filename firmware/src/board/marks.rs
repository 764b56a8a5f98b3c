//! Cycle marks of the self-test, and sleep.

use core::arch::asm;

use avr_device::atmega2560::CPU;
use wire::stretch::Probe;

/// GPIOR0, a register without a function, in which an onlooker sees what is being computed.
pub struct Marks(CPU);

impl Marks {
    /// Takes the processor's registers.
    pub fn new(processor: CPU) -> Self {
        // Idle mode: timers, converter and serial port go on.
        processor.smcr.write(|w| w.se().set_bit());
        Self(processor)
    }

    #[inline(always)]
    fn write(&self, value: u8) {
        // SAFETY: the register is general-purpose storage; any value is valid.
        self.0.gpior0.write(|w| unsafe { w.bits(value) });
    }

    /// Sleeps until `has_work` finds a reason not to; it is asked after every interrupt,
    /// of which there are up to 46 000 a second, and nothing else is done meanwhile.
    ///
    /// An interrupt between the look and the sleep would be slept over; hence the
    /// look is with interrupts off, and the processor executes the instruction
    /// after `sei`, the sleep, before it serves any.
    #[inline(always)]
    pub fn idle_until(&mut self, has_work: impl Fn() -> bool) {
        loop {
            avr_device::interrupt::disable();
            if has_work() {
                // SAFETY: they were on before.
                unsafe { avr_device::interrupt::enable() };
                return;
            }
            // SAFETY: interrupts were on before, and one of them ends the sleep.
            unsafe { asm!("sei", "sleep") };
        }
    }
}

/// A measured stretch is not interrupted: what is counted is its own.
///
/// That holds up everything else for milliseconds, and is for the self-test,
/// while nothing moves.
impl Probe for Marks {
    // Inlined, so that a mark costs one instruction.
    #[inline(always)]
    fn open(&mut self, stretch: u8) {
        avr_device::interrupt::disable();
        self.write(stretch);
    }

    #[inline(always)]
    fn close(&mut self) {
        self.write(0);
        // SAFETY: outside of critical sections, where `open` was called.
        unsafe { avr_device::interrupt::enable() };
    }
}
