//! The Arduino Mega 2560's hardware: the one place with registers.
//!
//! A peripheral has a file, owns its registers, and starts in its constructor;
//! pins come from [`firmware::wiring`], their traits are those of embedded-hal.
//! [`Board`] is what [`firmware::port`] asks for; the loop is there.
//!
//! | what | register | file |
//! |---|---|---|
//! | beat of 3 200 Hz, control period | timer 3 | [`clock`] |
//! | pressure and flex sensor | ADC | [`adc`] |
//! | step pulses | timer 1, OC1A | [`pulses`] |
//! | switches, valve, light | ports | [`switches`], `pins` |
//! | serial to the computer | USART0 | [`serial`] |
//! | settings | EEPROM | [`eeprom`] |
//! | checksum of the program | flash, RAMPZ | [`image`] |
//! | watchdog, reset flags | WDT, MCUSR, GPIOR2 | [`watchdog`], [`reset`] |
//! | what interrupts save | GPIOR1, GPIOR2 | `entry` |
//! | addresses for assembly | all | `registers` |
//! | cycle marks | GPIOR0 | [`marks`] |
//! | stack depth, counters | – | [`stack`], [`health`] |
//!
//! Interrupts move bytes, samples and edges; none of them calls a float routine
//! or lasts longer than the time between two step edges.
#![allow(unsafe_code)]

pub mod adc;
pub mod clock;
pub mod eeprom;
mod entry;
pub mod health;
pub mod image;
pub mod marks;
mod periods;
mod pins;
mod place;
pub mod pulses;
mod registers;
pub mod reset;
pub mod serial;
mod shared;
pub mod stack;
pub mod switches;
pub mod texts;
mod wake;
pub mod watchdog;

use avr_device::atmega2560::Peripherals;
use firmware::{
    app::App,
    io::{Inputs, Outputs, ResetCause},
    past::Past,
    pins::{Light, Valve},
    port::{self, Motion, Parts, Period},
};
use wire::telemetry::Telemetry;

use self::{
    adc::{Adc, Readings},
    clock::Clock,
    eeprom::Eeprom,
    health::Health,
    marks::Marks,
    pins::pin_type,
    pulses::Pulses,
    serial::Serial,
    switches::Switches,
    texts::FlashTexts,
    watchdog::Watchdog,
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
    /// The settings' memory.
    pub eeprom: Eeprom,
    /// Why the processor started.
    pub reset_cause: ResetCause,
    /// The beat.
    clock: Clock,
    /// The sensors.
    adc: Adc,
    /// The pump's motor.
    pulses: Pulses,
    /// End switches and emergency stop.
    switches: Switches,
    /// The vent valve.
    valve: Valve<pin_type!(Output, VALVE)>,
    /// The on-board light.
    light: Light<pin_type!(Output, LIGHT)>,
    /// The second before a fault.
    past: &'static mut Past,
    /// Cycle marks of the self-test.
    marks: Marks,
    health: Health,
    watchdog: Watchdog,
}

impl Board {
    /// Takes the hardware and sets it up, the first time, with the application's room. Outputs are safe;
    /// everything works once [`Self::start`] has been called.
    pub fn take() -> Option<(Self, Room)> {
        let hardware = Peripherals::take()?;
        // SAFETY: the peripherals were taken just now, so this happens once,
        // and no two of the pins are the same.
        let (valve, pulses, switches, light) = unsafe {
            (
                Valve::new(<pin_type!(Output, VALVE)>::new()),
                Pulses::new(hardware.TC1),
                Switches::new(),
                Light::new(<pin_type!(Output, LIGHT)>::new()),
            )
        };
        // Made by the linker: put there at run time it would first be on the stack of `main`.
        static mut PAST: Past = Past::new();
        // SAFETY: the peripherals are taken once, so this happens once.
        let past = unsafe { &mut *(&raw mut PAST) };
        let board = Self {
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
            health: Health::new(),
            watchdog: Watchdog::new(hardware.WDT),
        };
        Some((board, Room(())))
    }

    /// Starts watchdog and clock and switches the interrupts on, in this order: no beat is
    /// pending then, and the first control period is as long as every other.
    pub fn start(&mut self) {
        self.watchdog.start();
        self.clock.start();
        // SAFETY: called outside of critical sections, with everything set up.
        unsafe { avr_device::interrupt::enable() };
    }

    /// Sleeps until a period begins or a byte comes.
    #[inline(always)]
    pub fn sleep(&mut self) {
        let Self {
            marks,
            clock,
            serial,
            ..
        } = self;
        // In this order: what comes after the look wakes it.
        wake::forget();
        if !clock.is_due() && !serial.has_input() {
            marks.idle_until(wake::is_called);
        }
    }
}

impl port::Board for Board {
    type Serial = Serial;
    type Memory = Eeprom;
    type Probe = Marks;
    type Texts = FlashTexts;

    #[inline(always)]
    fn parts(&mut self) -> Parts<'_, Self> {
        Parts {
            serial: &mut self.serial,
            eeprom: &mut self.eeprom,
            past: self.past,
            probe: &mut self.marks,
            texts: FlashTexts,
        }
    }

    #[inline(always)]
    fn is_due(&self) -> bool {
        self.clock.is_due()
    }

    #[inline(always)]
    fn period(&mut self) -> Option<Period> {
        self.clock.period()
    }

    #[inline(always)]
    fn inputs(&mut self) -> Inputs {
        let Readings {
            pressure,
            flex,
            supply,
        } = self.adc.readings();
        let pressed = self.switches.pressed() | self.pulses.stopped_by();
        Inputs {
            pressure,
            flex,
            supply,
            retracted_end: pressed.retracted_end(),
            pushed_end: pressed.pushed_end(),
            emergency_stop: pressed.emergency_stop(),
            steps: self.pulses.position(),
            ..Inputs::default()
        }
    }

    #[inline(always)]
    fn apply(&mut self, outputs: &Outputs, motion: Motion, is_armed: bool) {
        if let Some(steps) = outputs.set_steps {
            self.pulses.set_position(steps);
        }
        reset::note(is_armed);
        self.valve.set(outputs.valve);
        self.pulses
            .obey(outputs.pump, motion.acceleration, motion.is_homed);
        self.light.set(outputs.light);
    }

    #[inline(always)]
    fn send(&mut self, telemetry: &Telemetry) {
        self.serial.send_or_drop(|out| {
            let Ok(()) = telemetry.write(out);
        });
    }

    #[inline(always)]
    fn look(&mut self, time_ms: u32) {
        if self.health.look(time_ms, &mut self.serial) {
            self.adc.measure_supply();
        }
    }

    #[inline(always)]
    fn measure_supply(&mut self) {
        self.adc.measure_supply();
    }

    #[inline(always)]
    fn completed(&mut self, is_armed: bool) {
        self.watchdog.feed(is_armed);
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
