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

#[cfg(target_arch = "avr")]
#[avr_device::entry]
fn main() -> ! {
    use embedded_hal_nb::serial::Read;
    use firmware::io;
    use wire::{decimal::Hundredths, state::State, telemetry::{Setpoint, Telemetry}};
    let Some(mut board) = board::Board::take() else {
        // Taken twice: impossible from reset.
        board::reset::stop_for_good()
    };
    let mut watchdog = board::watchdog::Watchdog::start(board.watchdog);
    board::start();
    let mut sequence = 0;
    let mut hz = 0.0_f32;
    loop {
        while let Ok(byte) = board.serial.read() {
            hz = match byte {
                b'a' => 1.0,
                b'b' => 20.0,
                b'c' => 150.0,
                b'd' => 1_000.0,
                b'e' => 14_000.0,
                b'f' => 20_000.0,
                b'g' => -20_000.0,
                b'h' => loop {},
                _ => 0.0,
            };
        }
        if let Some(period) = board.clock.period() {
            let readings = board.adc.readings();
            let pressed = board.switches.pressed();
            board.pulses.obey(io::Pump::Rate(hz), 114_000.0);
            board.valve.set(io::Valve::Closed);
            board.light.set(hz > 0.0);
            let steps = board.pulses.position();
            let line = Telemetry {
                sequence,
                time_ms: period.time_ms,
                pressure_kpa: Some(Hundredths(i32::from(readings.pressure.0))),
                angle_deg: Some(Hundredths(i32::from(readings.flex.0))),
                predicted_deg: Some(Hundredths(1234)),
                setpoint: Setpoint::Angle(Hundredths(
                    i32::from(pressed.retracted_end())
                        + 10 * i32::from(pressed.pushed_end())
                        + 100 * i32::from(pressed.emergency_stop()),
                )),
                volume_ul: steps,
                state: State::Idle,
                fault: board.reset_cause as u8,
                mismatch: period.missed > 0,
            };
            sequence = sequence.wrapping_add(1);
            board.serial.send_or_drop(|out| {
                let Ok(()) = line.write(out);
            });
            watchdog.feed();
        }
        board.marks.idle_unless(|| board.clock.is_due() || board.serial.has_input());
    }
}

#[cfg(target_arch = "avr")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Whatever the message, printing it would cost more flash than the model.
    board::reset::stop_for_good()
}
