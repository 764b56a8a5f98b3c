//! Time: the beat that everything else follows.
//!
//! Timer 3 beats 3 200 times a second. Each beat starts a conversion, so that a
//! control period of 10 ms has exactly sixteen of either sensor; every fourth
//! beat the pulses take their next rate and the switches are looked at. The
//! conversions of a period end at the same phase in every period, and the last
//! one begins the next control period: control sees samples that are never older
//! than one conversion, and always equally old.

use avr_device::atmega2560::TC3;
use firmware::{
    byte::Byte,
    design::{CONTROL_HZ, CPU_HZ, PERIOD_MS},
    port::Period,
    stepper::SLOTS,
};

use super::{
    adc,
    entry::{enter, handler, restore},
    periods::{self, BEATS},
    pulses,
    registers::{ADCSRA, ADEN, ADIE, ADIF, ADPS, ADSC},
    shared::{self, SharedByte},
    switches,
};

/// Beats in a slot of the pulse plan.
#[allow(clippy::cast_possible_truncation)]
const BEATS_PER_SLOT: u8 = BEATS / SLOTS as u8;
const _: () = assert!(BEATS_PER_SLOT.is_power_of_two());

/// Processor cycles from beat to beat.
const CYCLES_PER_BEAT: u32 = CPU_HZ / (CONTROL_HZ as u32 * BEATS as u32);
const _: () = assert!(CYCLES_PER_BEAT * CONTROL_HZ as u32 * BEATS as u32 == CPU_HZ);
const _: () = assert!(CYCLES_PER_BEAT <= 0xffff);

/// Beats so far; wraps. A period's are as many as [`BEATS`].
static BEAT: SharedByte = SharedByte::new(0);

/// The clock.
pub struct Clock {
    timer: TC3,
    periods_seen: u8,
    time_ms: u32,
}

impl Clock {
    /// Creates the clock, which stands still until [`Self::start`].
    pub fn new(timer: TC3) -> Self {
        #[allow(clippy::cast_possible_truncation)] // Checked above.
        timer.ocr3a.write(|w| w.bits((CYCLES_PER_BEAT - 1) as u16));
        timer.timsk3.write(|w| w.ocie3a().set_bit());
        Self {
            timer,
            periods_seen: 0,
            time_ms: 0,
        }
    }

    /// Starts the clock: the first beat comes a whole beat from now. To be called
    /// with interrupts off, right before they go on.
    ///
    /// A timer that ran while everything else was set up would have a beat
    /// pending by now. It would be served at once and the next one anywhere
    /// within the beat after it, while the first conversion is still under way:
    /// that conversion would then be counted for the other sensor, and the first
    /// period's reading of the pressure would lack one of its sixteen.
    pub fn start(&mut self) {
        self.timer.tcnt3.write(|w| w.bits(0));
        // Flags are cleared by writing a one.
        self.timer.tifr3.write(|w| w.ocf3a().set_bit());
        // Clear on compare match, no prescaler.
        self.timer
            .tccr3b
            .write(|w| w.wgm3().bits(0b01).cs3().direct());
    }

    /// Whether [`Self::period`] has something to say.
    pub fn is_due(&self) -> bool {
        periods::begun() != self.periods_seen
    }

    /// The control period that began since the last call; none if there is none.
    pub fn period(&mut self) -> Option<Period> {
        let passed = periods::begun().wrapping_sub(self.periods_seen);
        if passed == 0 {
            return None;
        }
        self.periods_seen = self.periods_seen.wrapping_add(passed);
        self.time_ms = self
            .time_ms
            .wrapping_add(u32::from(passed) * u32::from(PERIOD_MS));
        Some(Period {
            time_ms: self.time_ms,
            missed: passed - 1,
        })
    }
}

/// What starts a conversion: everything that [`adc::Adc::new`] sets, and the start bit. A flag would be
/// cleared by writing a one.
const START: u8 = 1 << ADEN | 1 << ADSC | 1 << ADIE | 0b111 << ADPS;
/// A conversion is under way, or one is done and its interrupt pending. That one shall see the
/// multiplexer as it was.
const IS_CONVERTING: u8 = 1 << ADSC | 1 << ADIF;

// A beat: it starts its conversion, unless the converter is busy with the one before. Three of four
// do nothing else.
handler!(
    "
    .section .text.softrig_beat,\"ax\",@progbits
    .global __vector_32
    .type __vector_32,@function
__vector_32:                        ; TIMER3_COMPA
    ",
    enter!(),
    "
    lds  r24, {adcsra}
    andi r24, {is_converting}
    brne 1f
    ldi  r24, {start}
    sts  {adcsra}, r24
1:  lds  r24, {beat}
    inc  r24
    sts  {beat}, r24
    andi r24, {beats_per_slot} - 1
    breq 2f
    ",
    restore!(),
    "
    reti

2:  ",
    restore!(),
    "
    jmp  {slot}
    ",
    adcsra = const ADCSRA,
    is_converting = const IS_CONVERTING,
    start = const START,
    beat = sym BEAT,
    beats_per_slot = const BEATS_PER_SLOT,
    slot = sym slot,
);

// The count wraps at a multiple of them.
const _: () = assert!(BEATS.is_power_of_two());

/// The last beat of a slot has started its conversion; entered as an interrupt.
extern "avr-interrupt" fn slot() {
    // SAFETY: this is an interrupt handler.
    let section = unsafe { shared::in_interrupt() };
    // A new plan begins at the last beat: its conversion begins the next control
    // period, so that the main program had a whole one to make the plan.
    let is_last = BEAT.get() % BEATS == 0;
    if is_last {
        adc::end_period();
    }
    switches::sample();
    pulses::slot(section, is_last);
}
