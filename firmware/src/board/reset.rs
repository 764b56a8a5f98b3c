//! From reset to `main`, and why there was a reset.
//!
//! Before anything else the outputs are made safe: the very first instructions
//! release the valve and disable the driver, ahead of the stack, of static data,
//! of everything that takes time or can go wrong. Until then the pins are inputs,
//! and the driver's pull-up and the valve's spring say the same.
//!
//! The reset flags are kept in GPIOR2 and cleared, because the watchdog cannot be
//! stopped while its flag stands. Stock bootloaders clear the flags themselves
//! before they start us, and every reset looks ordinary then: a dip of the supply, a program that hung with
//! interrupts off. What the firmware knows it therefore also leaves in a word of memory that a reset
//! does not clear: that it ended itself, or that the rig is armed. Who finds the latter was
//! interrupted, whatever by.

use core::arch::global_asm;

use avr_device::atmega2560::CPU;
use firmware::{
    io::ResetCause,
    wiring::{DIRECTION, ENABLE, VALVE},
};

use super::registers::{BORF, GPIOR2, MCUSR, PORF, WDCE, WDE, WDRF, WDTCSR};

const _: () = assert!(
    DIRECTION.port == ENABLE.port && VALVE.port == ENABLE.port,
    "the first instructions set one port"
);

global_asm!(
    r#"
    .section .init1,"ax",@progbits
    ldi r24, {enable}
    out {port}, r24
    ldi r24, {outputs}
    out {ddr}, r24

    in r24, {mcusr}
    out {gpior2}, r24
    ldi r24, 0
    out {mcusr}, r24
    wdr
    ldi r24, {change}
    sts {wdtcsr}, r24
    ldi r24, 0
    sts {wdtcsr}, r24

    .section .noinit,"aw",@nobits
    .global softrig_last_words
softrig_last_words:
    .skip 2
    "#,
    mcusr = const MCUSR,
    gpior2 = const GPIOR2,
    wdtcsr = const WDTCSR,
    change = const 1 << WDCE | 1 << WDE,
    port = const ENABLE.port_address(),
    ddr = const ENABLE.port_address() - 1,
    enable = const 1 << ENABLE.bit,
    outputs = const 1 << ENABLE.bit | 1 << VALVE.bit | 1 << DIRECTION.bit,
);

// SAFETY: the word is defined above; only the functions below touch it.
unsafe extern "C" {
    #[link_name = "softrig_last_words"]
    static mut LAST_WORDS: u16;
}

/// Says that the firmware stopped itself. Memory at power-on is random; that it
/// says this by chance is one in 65 536, and then costs a `clear`.
const STOPPED_ITSELF: u16 = 0x5ca1;

/// Says that the rig was armed. Far from the other in bits, so that a dip of the supply that
/// turns some of them does not make one of the other.
const ARMED: u16 = 0xa35e;

const POWER_ON: u8 = 1 << PORF;
const BROWN_OUT: u8 = 1 << BORF;
const WATCHDOG: u8 = 1 << WDRF;

/// Why the processor started. To be asked once.
pub fn cause(processor: &CPU) -> ResetCause {
    // SAFETY: before interrupts are on, nobody else touches the word.
    let last_words = unsafe {
        let word = (&raw const LAST_WORDS).read_volatile();
        (&raw mut LAST_WORDS).write_volatile(0);
        word
    };
    let flags = processor.gpior2.read().bits();
    // At power-on the supply rises through the brown-out level.
    if flags & POWER_ON != 0 {
        ResetCause::Ordinary
    } else if flags & WATCHDOG != 0 || last_words == STOPPED_ITSELF {
        ResetCause::Watchdog
    } else if flags & BROWN_OUT != 0 {
        ResetCause::BrownOut
    } else if last_words == ARMED {
        ResetCause::WhileArmed
    } else {
        ResetCause::Ordinary
    }
}

/// Leaves a word whether the rig is armed; once in a control period, before the outputs are set.
pub fn note(is_armed: bool) {
    // SAFETY: the watchdog's interrupt writes it too, and then nothing else runs any more.
    unsafe { (&raw mut LAST_WORDS).write_volatile(if is_armed { ARMED } else { 0 }) }
}

/// Makes the outputs safe and waits for the watchdog, whatever else is broken.
pub fn stop_for_good() -> ! {
    avr_device::interrupt::disable();
    // SAFETY: nothing else runs any more; constants written to the port make
    // its outputs safe, as after a reset.
    unsafe {
        core::arch::asm!(
            "out {port}, {safe}",
            port = const ENABLE.port_address(),
            safe = in(reg_upper) 1_u8 << ENABLE.bit,
            options(nostack, preserves_flags),
        );
        (&raw mut LAST_WORDS).write_volatile(STOPPED_ITSELF);
    }
    loop {
        // The step timer may still move its pin: the driver is off.
        core::hint::spin_loop();
    }
}
