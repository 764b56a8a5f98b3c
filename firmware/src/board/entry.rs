//! How the interrupts that are written in assembly begin and end.
//!
//! Four interrupts come 460 times in a control period, and the compiler makes each of them save what
//! its rarest path needs. Their usual path is therefore assembly, a few registers long; what is not
//! usual it leaves untouched to a function that can do all of it, see [`otherwise`].
//!
//! The processor enters a handler with interrupts off, and none switches them on: at most one
//! is under way. So what it saves needs no stack. GPIOR1 has no function, and GPIOR2 none once the
//! reset flags were read, before interrupts go on: one cycle each way instead of two, and for the
//! flags one instead of three.

/// Saves r24 and the flags; r24 is free.
macro_rules! enter {
    () => {
        "out {gpior1}, r24
         in r24, {sreg}
         out {gpior2}, r24
        "
    };
}

/// Restores r24 and the flags.
macro_rules! restore {
    () => {
        "in r24, {gpior2}
         out {sreg}, r24
         in r24, {gpior1}
        "
    };
}

/// `global_asm!` with the registers that both need.
macro_rules! handler {
    ($($part:tt)*) => {
        core::arch::global_asm!(
            $($part)*
            sreg = const $crate::board::registers::SREG,
            gpior1 = const $crate::board::registers::GPIOR1,
            gpior2 = const $crate::board::registers::GPIOR2,
        );
    };
}

pub(super) use {enter, handler, restore};
