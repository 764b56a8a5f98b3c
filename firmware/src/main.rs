//! The image for the ATmega2560.
//!
//! Without hardware there is nothing for it to do: on a desktop it only says so,
//! which lets plain cargo commands check the whole workspace.
#![cfg_attr(target_arch = "avr", no_std, no_main)]
#![cfg_attr(target_arch = "avr", feature(abi_avr_interrupt, asm_experimental_arch))]
#![cfg_attr(not(target_arch = "avr"), forbid(unsafe_code))]
#![deny(unsafe_code)]

#[cfg(target_arch = "avr")]
mod board;

#[cfg(not(target_arch = "avr"))]
fn main() {
    eprintln!("the firmware runs on an ATmega2560; build it with `cargo xtask firmware`");
}

/// Lets the application do its periods, and sleeps in between.
#[cfg(target_arch = "avr")]
#[avr_device::entry]
fn main() -> ! {
    use board::Board;
    use wire::{assemble::Assembler, command::MAX_LINE};

    let Some((mut board, room)) = Board::take() else {
        // Taken twice: impossible from reset.
        board::reset::stop_for_good()
    };
    let app = room.start(&board.eeprom, board.reset_cause);
    let mut assembler = Assembler::<{ MAX_LINE }>::new();
    board.start();
    // The serial port cannot fail: its error type has no values.
    let Ok(()) = app.banner(&mut board.serial);
    loop {
        app.period(&mut board, &mut assembler);
        board.sleep();
    }
}

#[cfg(target_arch = "avr")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Whatever the message, printing it would cost more flash than the model.
    board::reset::stop_for_good()
}
