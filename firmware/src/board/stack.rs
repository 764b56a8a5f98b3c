//! How deep the stack has been.
//!
//! Before `main`, all memory above the static data is painted; what is still
//! painted later was never used. The colour is the simulator's, so that it and
//! the board agree on what was used.

use core::arch::global_asm;

const PAINT: u8 = 0xc5;

global_asm!(
    r#"
    .section .init3,"ax",@progbits
    ldi r30, lo8(__heap_start)
    ldi r31, hi8(__heap_start)
    ldi r24, {paint}
    ldi r25, hi8(__stack + 1)
1:  st Z+, r24
    cpi r30, lo8(__stack + 1)
    cpc r31, r25
    brne 1b
    "#,
    paint = const PAINT,
);

// SAFETY: symbols of the linker's script; only their addresses are used.
unsafe extern "C" {
    static __heap_start: u8;
    static __stack: u8;
}

/// Bytes between the static data and the deepest that the stack has been.
pub fn never_used() -> u16 {
    let end = &raw const __stack;
    let mut at = &raw const __heap_start;
    let mut count = 0;
    // SAFETY: reads memory between two addresses that the linker gave.
    while at < end && unsafe { at.read_volatile() } == PAINT {
        at = at.wrapping_add(1);
        count += 1;
    }
    count
}
