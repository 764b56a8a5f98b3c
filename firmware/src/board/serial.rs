//! The cable to the computer: UART0 at 115 200 baud, with a ring either way.
//!
//! Telemetry must never hold up control, so a line of it goes out whole or not at
//! all, and what was dropped is counted. Replies are asked for, and wait for
//! their turn.

use core::convert::Infallible;

use avr_device::atmega2560::USART0;
use embedded_hal_nb::serial::{ErrorType, Read, Write};
use firmware::{
    byte::Byte,
    design::CPU_HZ,
    ring::{self, Ring},
};
use ufmt::uWrite;

use super::{
    entry::{enter, handler, restore},
    registers::{UCSR0B, UDR0, UDRIE0},
    shared::SharedByte,
    wake,
};

/// Serial speed in baud. At 16 MHz it is 2.1 % fast, within what a receiver
/// forgives; the bootloader uses it too.
const BAUD: u32 = 115_200;

/// The divisor for [`BAUD`] with eight samples a bit, rounded to the nearest.
#[allow(clippy::cast_possible_truncation)]
const BAUD_DIVISOR: u16 = ((CPU_HZ + 4 * BAUD) / (8 * BAUD) - 1) as u16;

static RECEIVED: Ring<SharedByte> = Ring::new();
static TO_SEND: Ring<SharedByte> = Ring::new();
/// Bytes that arrived and found no place; stays at 255.
static LOST: SharedByte = SharedByte::new(0);

/// The serial port.
pub struct Serial {
    usart: USART0,
    dropped: u16,
}

impl Serial {
    /// Creates the port; it works once interrupts are on.
    pub fn new(usart: USART0) -> Self {
        usart.ucsr0a.write(|w| w.u2x0().set_bit());
        usart.ubrr0.write(|w| w.bits(BAUD_DIVISOR));
        usart.ucsr0c.write(|w| w.ucsz0().chr8());
        usart.ucsr0b.write(|w| {
            w.rxcie0().set_bit();
            w.rxen0().set_bit();
            w.txen0().set_bit()
        });
        Self { usart, dropped: 0 }
    }

    /// Whether a byte has arrived.
    pub fn has_input(&self) -> bool {
        !RECEIVED.is_empty()
    }

    /// Bytes that arrived and were lost, at most 255.
    pub fn lost_bytes(&self) -> u8 {
        LOST.get()
    }

    /// Lines that were dropped for want of room.
    pub fn dropped_lines(&self) -> u16 {
        self.dropped
    }

    /// Sends what `write` writes if all of it fits now, else nothing.
    pub fn send_or_drop(&mut self, write: impl FnOnce(&mut Draft)) {
        let mut draft = Draft(TO_SEND.draft());
        write(&mut draft);
        if draft.0.commit() {
            self.start();
        } else {
            self.dropped = self.dropped.saturating_add(1);
        }
    }

    /// The interrupt makes room: a byte takes 85 µs.
    fn wait_and_push(&mut self, byte: u8) {
        while self.write(byte).is_err() {}
    }

    /// Sees to it that the interrupt sends what there is.
    #[inline(always)]
    fn start(&mut self) {
        // One byte, and no interrupt changes the other bits; but the one that
        // finds the ring empty clears this one.
        super::shared::free(|_| self.usart.ucsr0b.modify(|_, w| w.udrie0().set_bit()));
    }
}

/// Text behind the end of the ring that is not sent unless all of it fits.
pub struct Draft(ring::Draft<'static, SharedByte>);

impl uWrite for Draft {
    type Error = Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Infallible> {
        for byte in text.bytes() {
            self.0.push(byte);
        }
        Ok(())
    }

    #[inline(always)] // Where the character is known to be a byte.
    fn write_char(&mut self, character: char) -> Result<(), Infallible> {
        // All that is sent is ASCII.
        self.0.push(character as u8);
        Ok(())
    }
}

impl ErrorType for Serial {
    type Error = Infallible;
}

impl Read for Serial {
    fn read(&mut self) -> nb::Result<u8, Infallible> {
        RECEIVED.pop().ok_or(nb::Error::WouldBlock)
    }
}

impl Write for Serial {
    fn write(&mut self, byte: u8) -> nb::Result<(), Infallible> {
        TO_SEND.push(byte).ok_or(nb::Error::WouldBlock)?;
        self.start();
        Ok(())
    }

    fn flush(&mut self) -> nb::Result<(), Infallible> {
        if TO_SEND.is_empty() {
            Ok(())
        } else {
            Err(nb::Error::WouldBlock)
        }
    }
}

impl uWrite for Serial {
    type Error = Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Infallible> {
        for byte in text.bytes() {
            self.wait_and_push(byte);
        }
        Ok(())
    }

    fn write_char(&mut self, character: char) -> Result<(), Infallible> {
        // All that is sent is ASCII.
        self.wait_and_push(character as u8);
        Ok(())
    }
}

#[avr_device::interrupt(atmega2560)]
fn USART0_RX() {
    // SAFETY: only this interrupt reads the data register.
    let usart = unsafe { &*USART0::ptr() };
    let byte = usart.udr0.read().bits();
    if RECEIVED.push(byte).is_none() {
        LOST.set(LOST.get().saturating_add(1));
    }
    wake::call();
}

// The transmitter takes another byte: the oldest, as `Ring::pop` does; without one this interrupt is
// switched off. It comes 10 000 times a second.
handler!(
    "
    .section .text.softrig_send,\"ax\",@progbits
    .global __vector_26
    .type __vector_26,@function
__vector_26:                        ; USART0_UDRE
    ",
    enter!(),
    "
    push r30
    lds  r30, {ring}+{tail}
    lds  r24, {ring}+{head}
    cp   r24, r30
    breq 1f
    push r31
    mov  r24, r30
    inc  r24
    sts  {ring}+{tail}, r24
    ldi  r31, 0
    subi r30, lo8(-({ring}))
    sbci r31, hi8(-({ring}))
    ld   r24, Z
    sts  {udr0}, r24
    pop  r31
    pop  r30
    ",
    restore!(),
    "
    reti

1:  lds  r24, {ucsr0b}              ; which the main program changes with interrupts off
    andi r24, {not_udrie}
    sts  {ucsr0b}, r24
    pop  r30
    ",
    restore!(),
    "
    reti
    ",
    udr0 = const UDR0,
    ucsr0b = const UCSR0B,
    ring = sym TO_SEND,
    head = const Ring::<SharedByte>::HEAD,
    tail = const Ring::<SharedByte>::TAIL,
    not_udrie = const !(1_u8 << UDRIE0),
);
