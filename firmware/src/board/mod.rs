//! The Arduino Mega 2560's hardware: the one place with registers.
//!
//! | what | pin on the board | register |
//! |---|---|---|
//! | serial to the computer | USB (0 RX, 1 TX) | USART0 |
//! | on-board LED | 13 | PORTB bit 7 |
//! | heartbeat | – | timer 1 |
//! | cycle marks | – | GPIOR0 |
#![allow(unsafe_code)]

use avr_device::atmega2560::{CPU, PORTB, Peripherals, TC1, USART0};
use core::convert::Infallible;
use firmware::probe::Probe;
use ufmt::uWrite;

// avr-libc's assembly replaces the weak, four to seven times slower float
// routines of compiler_builtins, with the same bits, and its larger and slower
// memcpy. It must be asked for here in the binary: a library's request comes
// after compiler_builtins on the linker's command line, and changes nothing.
// `cargo xtask test` checks which one won.
// SAFETY: nothing is declared; the compiler's own calls keep its conventions.
#[link(name = "m")]
#[link(name = "c")]
unsafe extern "C" {}

/// The processor clock in hertz.
const CLOCK_HZ: u32 = 16_000_000;

/// Serial speed in baud. At 16 MHz it is 2.1 % fast, within what a receiver
/// forgives; the bootloader uses it too.
const BAUD: u32 = 115_200;

/// The divisor for [`BAUD`] with eight samples a bit, rounded to the nearest.
#[allow(clippy::cast_possible_truncation)]
const BAUD_DIVISOR: u16 = ((CLOCK_HZ + 4 * BAUD) / (8 * BAUD) - 1) as u16;

/// Ticks of the heartbeat timer, which counts at 1/256 of the clock: 0.25 s.
#[allow(clippy::cast_possible_truncation)]
const HEARTBEAT_TICKS: u16 = (CLOCK_HZ / 256 / 4 - 1) as u16;

/// Everything on the board that the firmware uses.
pub struct Board {
    /// The cable to the computer.
    pub serial: Serial,
    /// The on-board light.
    pub led: Led,
    /// Four ticks a second.
    pub heartbeat: Heartbeat,
    /// Cycle marks for the simulator.
    pub probe: Gpior0,
}

impl Board {
    /// Takes the hardware and sets it up, the first time.
    pub fn take() -> Option<Self> {
        let hardware = Peripherals::take()?;
        Some(Self {
            serial: Serial::new(hardware.USART0),
            led: Led::new(hardware.PORTB),
            heartbeat: Heartbeat::new(hardware.TC1),
            probe: Gpior0(hardware.CPU),
        })
    }
}

/// UART0 at 115 200 baud, eight bits, no parity, one stop bit.
pub struct Serial(USART0);

impl Serial {
    fn new(usart: USART0) -> Self {
        usart.ubrr0().write(|w| w.set(BAUD_DIVISOR));
        usart.ucsr0a().write(|w| w.u2x0().set_bit());
        usart.ucsr0c().write(|w| w.ucsz0().chr8());
        usart.ucsr0b().write(|w| w.txen0().set_bit());
        Self(usart)
    }
}

impl uWrite for Serial {
    type Error = Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Infallible> {
        for byte in text.bytes() {
            while self.0.ucsr0a().read().udre0().bit_is_clear() {}
            self.0.udr0().write(|w| w.set(byte));
        }
        Ok(())
    }
}

/// The on-board light.
pub struct Led(PORTB);

impl Led {
    fn new(port: PORTB) -> Self {
        port.ddrb().modify(|_, w| w.pb7().set_bit());
        Self(port)
    }

    /// Switches the light over.
    pub fn toggle(&mut self) {
        // Writing a one to PIN toggles the port.
        self.0.pinb().write(|w| w.pb7().set_bit());
    }
}

/// Timer 1, cleared on compare match.
pub struct Heartbeat(TC1);

impl Heartbeat {
    fn new(timer: TC1) -> Self {
        timer.ocr1a().write(|w| w.set(HEARTBEAT_TICKS));
        timer
            .tccr1b()
            .write(|w| w.wgm1().set(0b01).cs1().prescale_256());
        Self(timer)
    }

    /// Waits for the next tick.
    pub fn wait(&mut self) {
        while self.0.tifr1().read().ocf1a().bit_is_clear() {}
        // Writing a one clears the flag.
        self.0.tifr1().write(|w| w.ocf1a().set_bit());
    }
}

/// A register without a function; the simulator watches it.
pub struct Gpior0(CPU);

impl Probe for Gpior0 {
    // Inlined, so that a mark costs one instruction.
    #[inline(always)]
    fn open(&mut self, stretch: u8) {
        self.write(stretch);
    }

    #[inline(always)]
    fn close(&mut self) {
        self.write(0);
    }
}

impl Gpior0 {
    #[inline(always)]
    fn write(&self, value: u8) {
        // SAFETY: the register is general-purpose storage; any value is valid.
        self.0.gpior0().write(|w| unsafe { w.bits(value) });
    }
}

/// Stops for good: interrupts off, asleep, until a reset.
pub fn halt() -> ! {
    avr_device::interrupt::disable();
    // SAFETY: nothing else runs any more, so no one else owns the registers.
    let hardware = unsafe { Peripherals::steal() };
    hardware.CPU.smcr().write(|w| w.se().set_bit());
    loop {
        avr_device::asm::sleep();
    }
}
