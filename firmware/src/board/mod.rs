//! The Arduino Mega 2560's hardware: the one place with registers.
//!
//! A peripheral has a file, owns its registers, and starts in its constructor;
//! pins come from [`firmware::wiring`]. The shapes are those of arduino-hal and
//! the traits those of embedded-hal, so that the way there stays short.
//!
//! | what | register | file |
//! |---|---|---|
//! | beat of 3 200 Hz, control period | timer 3 | [`clock`] |
//! | pressure and flex sensor | ADC | [`adc`] |
//! | step pulses | timer 1, OC1A | [`pulses`] |
//! | switches, valve, light | ports | [`switches`], [`valve`], [`light`] |
//! | serial to the computer | USART0 | [`serial`] |
//! | settings | EEPROM | [`eeprom`] |
//! | checksum of the program | flash, RAMPZ | [`image`] |
//! | watchdog, reset flags | WDT, MCUSR, GPIOR2 | [`watchdog`], [`reset`] |
//! | cycle marks | GPIOR0 | [`marks`] |
//! | stack depth, counters | – | [`stack`], [`health`] |
//!
//! Interrupts move bytes, samples and edges; none of them calls a float routine
//! or lasts longer than the time between two step edges.
#![allow(unsafe_code)]

pub mod adc;
pub mod clock;
pub mod eeprom;
pub mod health;
pub mod image;
pub mod light;
pub mod marks;
mod periods;
mod pins;
mod place;
pub mod pulses;
pub mod reset;
pub mod serial;
mod shared;
pub mod stack;
pub mod switches;
pub mod texts;
pub mod valve;
pub mod watchdog;

use avr_device::atmega2560::Peripherals;
use firmware::{app::App, io::ResetCause, past::Past};

use self::{
    adc::Adc, clock::Clock, eeprom::Eeprom, light::Light, marks::Marks, pulses::Pulses,
    serial::Serial, switches::Switches, valve::Valve,
};

// avr-libc's assembly replaces the weak, four to seven times slower float
// routines of compiler_builtins, with the same bits, and its larger and slower
// memcpy. It must be asked for here in the binary: a library's request comes
// after compiler_builtins on the linker's command line, and changes nothing.
// `cargo xtask test` checks which one won.
// SAFETY: nothing is declared; the compiler's own calls keep its conventions.
#[link(name = "m")]
#[link(name = "c")]
unsafe extern "C" {}

/// Everything on the board that the firmware uses.
pub struct Board {
    /// The cable to the computer.
    pub serial: Serial,
    /// The beat.
    pub clock: Clock,
    /// The sensors.
    pub adc: Adc,
    /// The pump's motor.
    pub pulses: Pulses,
    /// End switches and emergency stop.
    pub switches: Switches,
    /// The vent valve.
    pub valve: Valve,
    /// The on-board light.
    pub light: Light,
    /// The settings' memory.
    pub eeprom: Eeprom,
    /// The second before a fault.
    pub past: &'static mut Past,
    /// Cycle marks for the simulator.
    pub marks: Marks,
    /// Why the processor started.
    pub reset_cause: ResetCause,
    /// Where the application goes.
    pub room: Room,
    /// The watchdog, not yet started.
    pub watchdog: avr_device::atmega2560::WDT,
}

impl Board {
    /// Takes the hardware and sets it up, the first time. Outputs are safe;
    /// everything works once [`start`] has been called.
    pub fn take() -> Option<Self> {
        let hardware = Peripherals::take()?;
        // SAFETY: the peripherals were taken just now, so this happens once,
        // and no two of the pins are the same.
        let (valve, pulses, switches, light) = unsafe {
            (
                Valve::new(),
                Pulses::new(hardware.TC1),
                Switches::new(),
                Light::new(),
            )
        };
        // Made by the linker: put there at run time it would first be on the stack of `main`.
        static mut PAST: Past = Past::new();
        // SAFETY: the peripherals are taken once, so this happens once.
        let past = unsafe { &mut *(&raw mut PAST) };
        Some(Self {
            past,
            serial: Serial::new(hardware.USART0),
            clock: Clock::new(hardware.TC3),
            adc: Adc::new(hardware.ADC),
            pulses,
            switches,
            valve,
            light,
            eeprom: Eeprom::new(hardware.EEPROM),
            reset_cause: reset::cause(&hardware.CPU),
            marks: Marks::new(hardware.CPU),
            room: Room(()),
            watchdog: hardware.WDT,
        })
    }
}

/// The application's room in memory; there is one.
pub struct Room(());

impl Room {
    /// Makes the application, puts it there, and loads what is stored.
    ///
    /// Not inlined: what loading needs of the stack shall not stay there as part of `main`.
    #[inline(never)]
    pub fn start(self, eeprom: &Eeprom, cause: ResetCause) -> &'static mut App {
        let app = Self::put(cause);
        app.load(eeprom);
        app
    }

    /// Not inlined: while it is made there are two of it, and the one on the stack shall not
    /// stay there while the settings are loaded.
    #[inline(never)]
    fn put(cause: ResetCause) -> &'static mut App {
        static APP: place::Place<App> = place::Place::new();
        // SAFETY: `Board::take` makes one room, and it is used up here.
        unsafe { APP.put(App::empty(cause, image::sum())) }
    }
}

/// Starts the clock and switches the interrupts on, in this order: no beat is
/// pending then, and the first control period is as long as every other.
pub fn start(clock: &mut Clock) {
    clock.start();
    // SAFETY: called outside of critical sections, with everything set up.
    unsafe { avr_device::interrupt::enable() };
}
