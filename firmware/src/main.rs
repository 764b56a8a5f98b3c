//! The image for the ATmega2560.
//!
//! Without hardware there is nothing for it to do: on a desktop it only says so,
//! which lets plain cargo commands check the whole workspace.
#![cfg_attr(target_arch = "avr", no_std, no_main)]
#![cfg_attr(not(target_arch = "avr"), forbid(unsafe_code))]
#![deny(unsafe_code)]

#[cfg(target_arch = "avr")]
mod board;

#[cfg(not(target_arch = "avr"))]
fn main() {
    eprintln!("the firmware runs on an ATmega2560; build it with `cargo xtask firmware`");
}

#[cfg(target_arch = "avr")]
#[avr_device::entry]
fn main() -> ! {
    let Some(mut board) = board::Board::take() else {
        // Taken twice: impossible from reset.
        board::halt()
    };
    // The serial port cannot fail: its error type has no values.
    let Ok(()) = firmware::self_test::run(&mut board.serial, &mut board.probe);
    loop {
        board.heartbeat.wait();
        board.led.toggle();
    }
}

#[cfg(target_arch = "avr")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Whatever the message, printing it would cost more flash than the model.
    board::halt()
}
