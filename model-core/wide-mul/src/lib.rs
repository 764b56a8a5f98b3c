//! The product of two 16-bit numbers in 32 bits.
//!
//! Every table look-up of the model uses such a product. An AVR multiplies bytes in two
//! cycles, and four of these make a product in eighteen cycles; but for
//! `u32::from(a) * u32::from(b)` LLVM calls a function of 75. The instruction sequence that
//! avoids it needs `unsafe`, which the physics forbids, so it has a crate of its own.
//!
//! On other processors it is the plain product. The simulated board is compared with the
//! desktop bit for bit, and so is this.
#![no_std]
#![cfg_attr(target_arch = "avr", feature(asm_experimental_arch))]
#![cfg_attr(not(target_arch = "avr"), forbid(unsafe_code))]

/// a·b.
#[cfg(not(target_arch = "avr"))]
#[inline]
pub fn product(a: u16, b: u16) -> u32 {
    u32::from(a) * u32::from(b)
}

/// a·b.
#[cfg(target_arch = "avr")]
#[inline(always)]
pub fn product(a: u16, b: u16) -> u32 {
    let (low, high): (u16, u16);
    // Two `mov` and no `movw`: the two registers of a `reg_pair` need not be neighbours.
    // SAFETY: arithmetic on registers; r0 is free to use and r1 is zero again at the end,
    // as the calling convention has it.
    unsafe {
        core::arch::asm!(
            "mul {a:l}, {b:l}",
            "mov {low:l}, r0",
            "mov {low:h}, r1",
            "clr {zero}",
            "mul {a:h}, {b:h}",
            "mov {high:l}, r0",
            "mov {high:h}, r1",
            "mul {a:l}, {b:h}",
            "add {low:h}, r0",
            "adc {high:l}, r1",
            "adc {high:h}, {zero}",
            "mul {a:h}, {b:l}",
            "add {low:h}, r0",
            "adc {high:l}, r1",
            "adc {high:h}, {zero}",
            "clr r1",
            a = in(reg_pair) a,
            b = in(reg_pair) b,
            low = out(reg_pair) low,
            high = out(reg_pair) high,
            zero = out(reg) _,
            options(pure, nomem, nostack),
        );
    }
    (u32::from(high) << 16) | u32::from(low)
}

/// The upper half of a·b: what a 65 536th part `b` of `a` is.
#[inline(always)]
pub fn share(a: u16, b: u16) -> u16 {
    let [_, _, low, high] = product(a, b).to_le_bytes();
    u16::from_le_bytes([low, high])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_share_lies_below_its_whole(a in any::<u16>(), b in any::<u16>()) {
            prop_assert!(share(a, b) <= a && share(a, b) <= b);
            prop_assert_eq!(product(a, b), product(b, a));
        }
    }

    #[test]
    fn ends_of_the_range() {
        assert_eq!(product(u16::MAX, u16::MAX), 0xfffe_0001);
        assert_eq!((product(0, 7), share(0x8000, 0x8000)), (0, 0x4000));
    }
}

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
