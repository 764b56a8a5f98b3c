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

/// Obeys lines as they come, lets a control period pass when one begins, and
/// sleeps in between.
#[cfg(target_arch = "avr")]
#[avr_device::entry]
fn main() -> ! {
    use board::{Board, clock::Period, health::Health, texts::FlashTexts, watchdog::Watchdog};
    use embedded_hal_nb::serial::Read;
    use firmware::io::Inputs;
    use wire::{
        assemble::{Assembled, Assembler},
        command::MAX_LINE,
        settings::Key,
        state::State,
    };

    let Some(mut board) = Board::take() else {
        // Taken twice: impossible from reset.
        board::reset::stop_for_good()
    };
    let app = board.room.start(&board.eeprom, board.reset_cause);
    let mut assembler = Assembler::<{ MAX_LINE }>::new();
    let mut health = Health::new();
    let mut watchdog = Watchdog::start(board.watchdog);
    board::start(&mut board.clock);
    // The serial port cannot fail: its error type has no values.
    let Ok(()) = app.banner(&mut board.serial);

    loop {
        while !board.clock.is_due()
            && let Ok(byte) = board.serial.read()
        {
            match assembler.push(byte) {
                Assembled::Pending => {}
                Assembled::Line(line) => {
                    let Ok(()) = app.receive(line, &board.eeprom, board.past, &mut board.serial);
                }
                Assembled::Overlong => app.overlong(),
            }
        }
        if let Some(Period { time_ms, missed }) = board.clock.period() {
            let readings = board.adc.readings();
            let pressed = board.switches.pressed() | board.pulses.stopped_by();
            // While nothing moves, being late harms nobody: the self-test may
            // take its time.
            let rests = matches!(app.state(), State::Idle | State::Fault);
            let inputs = Inputs {
                time_ms,
                pressure: readings.pressure,
                flex: readings.flex,
                supply: readings.supply,
                retracted_end: pressed.retracted_end(),
                pushed_end: pressed.pushed_end(),
                emergency_stop: pressed.emergency_stop(),
                steps: board.pulses.position(),
                overruns: if rests { 0 } else { missed },
            };
            let outputs = app.tick(&inputs, &mut board.eeprom, board.past);
            if let Some(steps) = outputs.set_steps {
                board.pulses.set_position(steps);
            }
            board::reset::note(!matches!(app.state(), State::Idle | State::Fault));
            board.valve.set(outputs.valve);
            let settings = app.settings();
            let acceleration =
                settings.number(Key::MaxFlowRate) / settings.number(Key::VolumePerStep);
            let is_homed = app.state() != State::Homing;
            board.pulses.obey(outputs.pump, acceleration, is_homed);
            board.light.set(outputs.light);
            let telemetry = app.telemetry();
            board.serial.send_or_drop(|out| {
                let Ok(()) = telemetry.write(out);
            });
            let Ok(()) = app.report(&FlashTexts, &mut board.serial, &mut board.marks);
            if rests && health.look(time_ms, &mut board.serial) {
                board.adc.measure_supply();
            }
            watchdog.feed(!matches!(app.state(), State::Idle | State::Fault));
            if app.hangs() {
                // Interrupts go on: they still send the reply.
                loop {
                    avr_device::asm::nop();
                }
            }
        }
        board
            .marks
            .idle_until(|| board.clock.is_due() || board.serial.has_input());
    }
}

#[cfg(target_arch = "avr")]
#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    // Whatever the message, printing it would cost more flash than the model.
    board::reset::stop_for_good()
}
