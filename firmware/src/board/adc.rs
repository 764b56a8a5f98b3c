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

use avr_device::atmega2560::{ADC as Converter, adc::RegisterBlock};
use firmware::{
    byte::Byte,
    io::Oversampled,
    wiring::{FLEX_CHANNEL, PRESSURE_CHANNEL},
};

use super::{
    periods::{self, BEATS},
    shared::{self, Shared, SharedByte, SharedFlag},
};

/// Reference: the supply, to which both sensors are ratiometric.
const REFERENCE: u8 = 0b0100_0000;
const PRESSURE: u8 = REFERENCE | PRESSURE_CHANNEL;
const FLEX: u8 = REFERENCE | FLEX_CHANNEL;
/// The processor's reference of 1.1 V.
const SUPPLY: u8 = REFERENCE | 0b1_1110;

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

/// Starts the conversion of a beat, unless the converter is busy with the one before.
#[inline(always)]
pub(super) fn start(beat: u8) {
    // SAFETY: the clock's interrupt only sets the start bit, and only while nothing is
    // being converted.
    let converter = unsafe { &*Converter::ptr() };
    if beat == BEATS - 1 {
        ENDS.set(true);
    }
    let now = converter.adcsra.read();
    // One that is done has its interrupt pending. It shall see the multiplexer as it was, and
    // writing the register would clear its flag.
    if now.adsc().bit_is_clear() && now.adif().bit_is_clear() {
        converter.adcsra.modify(|_, w| w.adsc().set_bit());
    }
}

#[avr_device::interrupt(atmega2560)]
fn ADC() {
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
        PRESSURE_SUM.set(section, PRESSURE_SUM.get(section).wrapping_add(sample));
    } else if channel == FLEX {
        select(converter, PRESSURE);
        FLEX_SUM.set(section, FLEX_SUM.get(section).wrapping_add(sample));
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
                Oversampled(PRESSURE_SUM.get(section)),
                Oversampled(FLEX_SUM.get(section)),
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
