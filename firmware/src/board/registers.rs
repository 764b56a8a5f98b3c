//! Addresses and bits for assembly, as avr-device publishes them. A wrong one does not compile into
//! anything: none is written by hand but [`SREG`], which belongs to no peripheral and is not in the crate.

use core::mem::{offset_of, transmute};

use avr_device::atmega2560::{
    ADC, CPU, EEPROM, PORTA, PORTB, PORTD, PORTE, TC1, USART0, WDT, adc, cpu, eeprom, porta, portb,
    portd, porte, tc1, usart0, wdt,
};
use firmware::wiring::PINS;

/// An address in memory, for `lds` and `sts`; of two bytes the lower one's.
macro_rules! memory {
    ($peripheral:ident, $block:ident, $register:ident) => {{
        // SAFETY: the address is a number, which every pattern of bits is.
        #[allow(clippy::transmutes_expressible_as_ptr_casts)] // Not in a constant.
        let block: u16 = unsafe { transmute($peripheral::PTR) };
        block + offset_of!($block::RegisterBlock, $register) as u16
    }};
}

/// An address among the ports, for `in` and `out`; below 0x20 for `sbi` and `cbi` too.
macro_rules! port {
    ($peripheral:ident, $block:ident, $register:ident) => {{
        let address = memory!($peripheral, $block, $register) - 0x20;
        assert!(address < 0x40);
        address as u8
    }};
}

/// The place of a field in its register, which is in the type of what writes it.
macro_rules! bit {
    ($block:ident, $register:ident, $field:ident, $writer:ident) => {{
        use avr_device::atmega2560::$block::$register::{W, $writer};
        const fn place<const PLACE: u8>(_: for<'a> fn(&'a mut W) -> $writer<'a, PLACE>) -> u8 {
            PLACE
        }
        place(W::$field)
    }};
}

pub const SREG: u8 = 0x3f;
pub const GPIOR1: u8 = port!(CPU, cpu, gpior1);
pub const GPIOR2: u8 = port!(CPU, cpu, gpior2);
pub const RAMPZ: u8 = port!(CPU, cpu, rampz);

pub const MCUSR: u8 = port!(CPU, cpu, mcusr);
pub const PORF: u8 = bit!(cpu, mcusr, porf, PORF_W);
pub const BORF: u8 = bit!(cpu, mcusr, borf, BORF_W);
pub const WDRF: u8 = bit!(cpu, mcusr, wdrf, WDRF_W);

pub const WDTCSR: u16 = memory!(WDT, wdt, wdtcsr);
pub const WDE: u8 = bit!(wdt, wdtcsr, wde, WDE_W);
pub const WDCE: u8 = bit!(wdt, wdtcsr, wdce, WDCE_W);
pub const WDIE: u8 = bit!(wdt, wdtcsr, wdie, WDIE_W);
pub const WDPL: u8 = bit!(wdt, wdtcsr, wdpl, WDPL_W);

pub const EECR: u8 = port!(EEPROM, eeprom, eecr);
pub const EEPE: u8 = bit!(eeprom, eecr, eepe, EEPE_W);
pub const EEMPE: u8 = bit!(eeprom, eecr, eempe, EEMPE_W);
pub const EEPM: u8 = bit!(eeprom, eecr, eepm, EEPM_W);

pub const ADC_DATA: u16 = memory!(ADC, adc, adc);
pub const ADMUX: u16 = memory!(ADC, adc, admux);
pub const REFS: u8 = bit!(adc, admux, refs, REFS_W);
pub const MUX: u8 = bit!(adc, admux, mux, MUX_W);
pub const ADCSRA: u16 = memory!(ADC, adc, adcsra);
pub const ADEN: u8 = bit!(adc, adcsra, aden, ADEN_W);
pub const ADSC: u8 = bit!(adc, adcsra, adsc, ADSC_W);
pub const ADIF: u8 = bit!(adc, adcsra, adif, ADIF_W);
pub const ADIE: u8 = bit!(adc, adcsra, adie, ADIE_W);
pub const ADPS: u8 = bit!(adc, adcsra, adps, ADPS_W);

pub const TCNT1: u16 = memory!(TC1, tc1, tcnt1);
pub const OCR1A: u16 = memory!(TC1, tc1, ocr1a);

pub const UDR0: u16 = memory!(USART0, usart0, udr0);
pub const UCSR0B: u16 = memory!(USART0, usart0, ucsr0b);
pub const UDRIE0: u8 = bit!(usart0, ucsr0b, udrie0, UDRIE0_W);

// Pins compute their registers from the port's letter: input, direction and output, one after the other.
const _: () = {
    let ports = [
        (
            b'A',
            port!(PORTA, porta, porta),
            port!(PORTA, porta, ddra),
            port!(PORTA, porta, pina),
        ),
        (
            b'B',
            port!(PORTB, portb, portb),
            port!(PORTB, portb, ddrb),
            port!(PORTB, portb, pinb),
        ),
        (
            b'D',
            port!(PORTD, portd, portd),
            port!(PORTD, portd, ddrd),
            port!(PORTD, portd, pind),
        ),
        (
            b'E',
            port!(PORTE, porte, porte),
            port!(PORTE, porte, ddre),
            port!(PORTE, porte, pine),
        ),
    ];
    let mut pin = 0;
    while pin < PINS.len() {
        let (_, wired) = PINS[pin];
        let mut port = 0;
        // Past the end for a port that is not in the list.
        while ports[port].0 != wired.port {
            port += 1;
        }
        let (_, output, direction, input) = ports[port];
        let computed = wired.port_address();
        assert!(computed == output && computed - 1 == direction && computed - 2 == input);
        pin += 1;
    }
};
