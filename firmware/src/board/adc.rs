//! The converter: sixteen samples of either sensor in every control period.
//!
//! The clock starts one conversion a beat, the sensors in turn. When a conversion
//! is done, its interrupt moves the multiplexer on at once: the input then has two
//! thirds of a beat, 200 µs, to settle before the next sample is taken, and no
//! sample has to be thrown away after a change of channel. At 1/128 of the clock a
//! conversion takes 104 µs, at the 125 kHz that ten bits need.
//!
//! While the self-test holds interrupts off, a beat comes late and the next one may find the
//! converter busy: it has no conversion then. Which sensor a conversion is of is therefore read from
//! the multiplexer and not told by the beat, conversions are counted, and a period that lacks
//! one has no reading.
//!
//! The supply is measured by the processor's reference of 1.1 V, whose source is weak: it needs
//! longer than the time between two conversions. So it takes a period of the sensors, of which the
//! second half counts, and only at rest: that period shows the sensors' readings of the one before.

use core::mem::size_of;

use avr_device::atmega2560::{ADC as Converter, adc::RegisterBlock};
use firmware::{
    byte::Byte,
    io::Oversampled,
    wiring::{FLEX_CHANNEL, PRESSURE_CHANNEL},
};

use super::{
    entry::{enter, handler, restore},
    periods::{self, BEATS},
    registers::{ADC_DATA, ADMUX, MUX, REFS},
    shared::{self, Shared, SharedByte, SharedFlag},
};

/// Reference: the supply, to which both sensors are ratiometric.
const REFERENCE: u8 = 0b01 << REFS;
const PRESSURE: u8 = REFERENCE | PRESSURE_CHANNEL << MUX;
const FLEX: u8 = REFERENCE | FLEX_CHANNEL << MUX;
/// The processor's reference of 1.1 V.
const SUPPLY: u8 = REFERENCE | 0b1_1110 << MUX;

/// Whether the next period is the supply's; so is the first one.
static IS_SUPPLY_WANTED: SharedFlag = SharedFlag::new(true);
/// Sum of the last period that was the supply's.
static SUPPLY_SUM: Shared<Oversampled> = Shared::new(Oversampled::NOT_MEASURED);

/// Whether the period ends with the conversion that is under way.
static ENDS: SharedFlag = SharedFlag::new(false);
/// Sums of the period under way.
static PRESSURE_SUM: Shared<u16> = Shared::new(0);
static FLEX_SUM: Shared<u16> = Shared::new(0);
/// Conversions in both.
static COUNT: SharedByte = SharedByte::new(0);
/// Sums of the last whole period.
static READINGS: Shared<[Oversampled; 2]> = Shared::new([Oversampled::NOT_MEASURED; 2]);

/// A conversion below this (counts), 0.16 V, is of a wire without contact, for however short a time. In
/// a mean of sixteen that would only look like less pressure. A power of two: see the assembly.
const NO_CONTACT: u16 = 32;

/// Marks a sum with such a conversion; sixteen of ten bits leave it free.
const GAP: u16 = 0x8000;

/// Adds the conversion to a sum, with r24 and r25. Its lower byte is read first: that holds the upper
/// one. And, or, loads and stores leave the carry alone.
macro_rules! add_sample {
    ($sum:literal) => {
        concat!(
            "lds r24, {data}
             lds r25, {",
            $sum,
            "}
             add r25, r24
             sts {",
            $sum,
            "}, r25
             lds r25, {data}+1
             andi r24, {contact}
             or  r24, r25                    ; zero below NO_CONTACT
             lds r24, {",
            $sum,
            "}+1
             brne 4f
             ori r24, {gap}
4:           adc r24, r25
             sts {",
            $sum,
            "}+1, r24
            "
        )
    };
}

/// Both sensors in one control period.
#[derive(Clone, Copy)]
pub struct Readings {
    /// Pressure sensor.
    pub pressure: Oversampled,
    /// Flex sensor.
    pub flex: Oversampled,
    /// The processor's reference, by the supply.
    pub supply: Oversampled,
}

/// The converter, once it is set up.
pub struct Adc(Converter);

impl Adc {
    /// Creates the converter; the clock starts its conversions.
    ///
    /// Takes 0.2 ms: a first conversion is made and thrown away. It lasts twice
    /// as long as the others, because the converter warms up in it, and the data
    /// sheet warns that the first one after a change of reference may be wrong.
    pub fn new(converter: Converter) -> Self {
        // The digital inputs of both pins would only cost power.
        converter.didr0.write(|w| {
            // SAFETY: every bit of the register switches an input off.
            unsafe { w.bits(1 << PRESSURE_CHANNEL | 1 << FLEX_CHANNEL) }
        });
        select(&converter, PRESSURE);
        converter.adcsra.write(|w| {
            w.aden().set_bit();
            w.adsc().set_bit();
            w.adps().prescaler_128()
        });
        while converter.adcsra.read().adsc().bit_is_set() {}
        // That conversion's flag is cleared by writing a one, so that nothing is
        // pending when interrupts go on.
        converter.adcsra.write(|w| {
            w.aden().set_bit();
            w.adif().set_bit();
            w.adie().set_bit();
            w.adps().prescaler_128()
        });
        Self(converter)
    }

    /// What the sensors said in the last whole period.
    pub fn readings(&self) -> Readings {
        shared::free(|section| {
            let [pressure, flex] = READINGS.get(section);
            Readings {
                pressure,
                flex,
                supply: SUPPLY_SUM.get(section),
            }
        })
    }

    /// Lets the period after the next be the supply's.
    pub fn measure_supply(&mut self) {
        IS_SUPPLY_WANTED.set(true);
    }
}

#[inline(always)]
fn select(converter: &RegisterBlock, channel: u8) {
    converter.admux.write(|w| {
        // SAFETY: one of the constants above.
        unsafe { w.bits(channel) }
    });
}

/// The conversion that the beat has started ends the period.
#[inline(always)]
pub(super) fn end_period() {
    ENDS.set(true);
}

// A conversion is done. The usual one adds to its sum and moves the multiplexer on; the last of a period
// and those of the supply it leaves untouched to `converted` below.
handler!(
    "
    .section .text.softrig_converted,\"ax\",@progbits
    .global __vector_29
    .type __vector_29,@function
__vector_29:                        ; ADC
    ",
    enter!(),
    "
    push r25
    lds  r24, {ends}
    tst  r24
    brne 3f
    lds  r24, {admux}
    cpi  r24, {pressure}
    brne 1f
    ",
    add_sample!("pressure_sum"),
    "
    ldi  r24, {flex}
    rjmp 2f
1:  cpi  r24, {flex}
    brne 3f                         ; the supply
    ",
    add_sample!("flex_sum"),
    "
    ldi  r24, {pressure}
2:  sts  {admux}, r24               ; after the sample, as below
    lds  r24, {count}
    inc  r24
    sts  {count}, r24
    pop  r25
    ",
    restore!(),
    "
    reti

3:  pop  r25
    ",
    restore!(),
    "
    jmp  {converted}
    ",
    data = const ADC_DATA,
    admux = const ADMUX,
    ends = sym ENDS,
    pressure = const PRESSURE,
    flex = const FLEX,
    pressure_sum = sym PRESSURE_SUM,
    flex_sum = sym FLEX_SUM,
    count = sym COUNT,
    contact = const 0x100 - NO_CONTACT,
    gap = const GAP >> 8,
    converted = sym converted,
);

// What the assembly takes for granted: the sums lie at their statics' addresses, and a mask finds what
// is below a power of two.
const _: () = assert!(size_of::<Shared<u16>>() == 2);
const _: () = assert!(NO_CONTACT.is_power_of_two() && NO_CONTACT < 0x100);

/// Adds a conversion to a sum.
fn add(sum: u16, sample: u16) -> u16 {
    let gap = if sample < NO_CONTACT { GAP } else { 0 };
    sum.wrapping_add(sample) | gap
}

/// The reading of a sum: one with a gap is that of a broken wire, which is bridged while it is short.
fn reading(sum: u16) -> Oversampled {
    Oversampled(if sum & GAP == 0 { sum } else { 0 })
}

/// A conversion is done, in full; entered as an interrupt.
extern "avr-interrupt" fn converted() {
    // SAFETY: this is an interrupt handler.
    let section = unsafe { shared::in_interrupt() };
    // SAFETY: between conversions nobody else touches the converter.
    let converter = unsafe { &*Converter::ptr() };
    let sample = converter.adc.read().bits();
    let count = COUNT.get().wrapping_add(1);
    // Only this interrupt selects a channel, so it is still the one that was converted.
    let channel = converter.admux.read().bits();
    if channel == PRESSURE {
        select(converter, FLEX);
        PRESSURE_SUM.set(section, add(PRESSURE_SUM.get(section), sample));
    } else if channel == FLEX {
        select(converter, PRESSURE);
        FLEX_SUM.set(section, add(FLEX_SUM.get(section), sample));
    } else if count > BEATS / 2 {
        FLEX_SUM.set(section, FLEX_SUM.get(section).wrapping_add(sample));
    }
    if !ENDS.get() {
        COUNT.set(count);
        return;
    }
    ENDS.set(false);
    // They alternate: as many as there are beats are half of either sensor.
    let is_whole = count == BEATS;
    if channel == SUPPLY {
        if is_whole {
            SUPPLY_SUM.set(section, Oversampled(FLEX_SUM.get(section)));
        }
        select(converter, PRESSURE);
    } else {
        let readings = if is_whole {
            [
                reading(PRESSURE_SUM.get(section)),
                reading(FLEX_SUM.get(section)),
            ]
        } else {
            [Oversampled::NOT_MEASURED; 2]
        };
        READINGS.set(section, readings);
        if IS_SUPPLY_WANTED.get() {
            IS_SUPPLY_WANTED.set(false);
            select(converter, SUPPLY);
        }
    }
    PRESSURE_SUM.set(section, 0);
    FLEX_SUM.set(section, 0);
    COUNT.set(0);
    periods::begin();
}
