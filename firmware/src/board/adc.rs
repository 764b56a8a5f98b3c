//! The converter: sixteen samples of either sensor in every control period.
//!
//! The clock starts one conversion a beat, the sensors in turn. When a conversion
//! is done, its interrupt moves the multiplexer on at once: the input then has two
//! thirds of a beat, 200 µs, to settle before the next sample is taken, and no
//! sample has to be thrown away after a change of channel. At 1/128 of the clock a
//! conversion takes 104 µs, at the 125 kHz that ten bits need.

use avr_device::atmega2560::{ADC as Converter, adc::RegisterBlock};
use firmware::{
    byte::Byte,
    io::Oversampled,
    wiring::{FLEX_CHANNEL, PRESSURE_CHANNEL},
};

use super::{
    periods::{self, BEATS},
    shared::{self, Shared, SharedByte},
};

/// Reference: the supply, to which both sensors are ratiometric.
const REFERENCE: u8 = 0b0100_0000;
const PRESSURE: u8 = REFERENCE | PRESSURE_CHANNEL;
const FLEX: u8 = REFERENCE | FLEX_CHANNEL;

/// The beat whose conversion is under way.
static CONVERTING: SharedByte = SharedByte::new(0);
/// Sums of the period under way.
static PRESSURE_SUM: Shared<u16> = Shared::new(0);
static FLEX_SUM: Shared<u16> = Shared::new(0);
/// Sums of the last whole period.
static READINGS: Shared<[u16; 2]> = Shared::new([0; 2]);

/// Both sensors in one control period.
#[derive(Clone, Copy)]
pub struct Readings {
    /// Pressure sensor.
    pub pressure: Oversampled,
    /// Flex sensor.
    pub flex: Oversampled,
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
        let [pressure, flex] = shared::free(|section| READINGS.get(section));
        Readings {
            pressure: Oversampled(pressure),
            flex: Oversampled(flex),
        }
    }
}

#[inline(always)]
fn select(converter: &RegisterBlock, channel: u8) {
    converter.admux.write(|w| {
        // SAFETY: one of the two constants above.
        unsafe { w.bits(channel) }
    });
}

/// Starts the conversion of a beat.
#[inline(always)]
pub(super) fn start(beat: u8) {
    // SAFETY: the clock's interrupt only sets the start bit; the flag of a
    // conversion that is done was cleared by its interrupt.
    let converter = unsafe { &*Converter::ptr() };
    CONVERTING.set(beat);
    converter.adcsra.modify(|_, w| w.adsc().set_bit());
}

#[avr_device::interrupt(atmega2560)]
fn ADC() {
    // SAFETY: this is an interrupt handler.
    let section = unsafe { shared::in_interrupt() };
    // SAFETY: between conversions nobody else touches the converter.
    let converter = unsafe { &*Converter::ptr() };
    let sample = converter.adc.read().bits();
    let beat = CONVERTING.get();
    if beat % 2 == 0 {
        select(converter, FLEX);
        PRESSURE_SUM.set(section, PRESSURE_SUM.get(section).wrapping_add(sample));
        return;
    }
    select(converter, PRESSURE);
    let flex = FLEX_SUM.get(section).wrapping_add(sample);
    FLEX_SUM.set(section, flex);
    if beat == BEATS - 1 {
        READINGS.set(section, [PRESSURE_SUM.get(section), flex]);
        PRESSURE_SUM.set(section, 0);
        FLEX_SUM.set(section, 0);
        periods::begin();
    }
}
