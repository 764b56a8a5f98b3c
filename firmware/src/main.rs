//! The firmware.
#![cfg_attr(target_arch = "avr", no_std, no_main)]
#[cfg(not(target_arch = "avr"))]
fn main() {}
#[cfg(target_arch = "avr")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! { loop {} }
#[cfg(target_arch = "avr")]
#[avr_device::entry]
fn main() -> ! { let _p = avr_device::atmega2560::Peripherals::take(); loop {} }
