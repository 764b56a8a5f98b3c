//! What the application needs of a board, and the control period that goes on between the two.
//!
//! A port to another processor implements [`Board`]; everything else is here, and a test drives it
//! on a desktop. `docs/hardware/porting.md` says what a port takes.

use core::convert::Infallible;

use embedded_hal_nb::serial::Read;
use ufmt::uWrite;
use wire::{
    assemble::{Assembled, Assembler},
    command::MAX_LINE,
    state::State,
    stretch::Probe,
    telemetry::Telemetry,
};

use crate::{
    app::{App, Texts},
    design::PERIOD_MS,
    io::{Inputs, Outputs, Pump},
    past::Past,
    store::Eeprom,
};

/// A control period that has begun.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Period {
    /// Time since reset (ms).
    pub time_ms: u32,
    /// Periods that began before it and were never seen.
    pub missed: u8,
}

/// What the pump has to know besides its command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Fastest change of the rate (microsteps/s²).
    pub acceleration: f32,
    /// The plunger stands clear of both end switches: either of them stops it. Else only the one
    /// that it moves towards does.
    pub is_homed: bool,
}

/// A board.
///
/// What it must do without the application, since the main program may hang: stop the pulses within
/// 5 ms of an emergency stop or an end switch that the plunger runs into, and within four control
/// periods of the last [`Board::apply`]; open the valve and disable the driver after a reset.
pub trait Board {
    /// The cable to the computer. Reading and writing cannot fail; writing waits for room.
    type Serial: Read<u8, Error = Infallible> + uWrite<Error = Infallible>;
    /// The memory of settings, faults and stroke.
    type Memory: Eeprom;
    /// What counts the cycles of a section.
    type Probe: Probe;
    /// Sentences and help.
    type Texts: Texts;

    /// What the application uses itself.
    fn parts(&mut self) -> Parts<'_, Self>;

    /// Whether [`Self::period`] has something to say.
    fn is_due(&self) -> bool;

    /// The control period that began since the last call: [`CONTROL_HZ`](crate::design::CONTROL_HZ)
    /// of them a second.
    fn period(&mut self) -> Option<Period>;

    /// The rig at the start of a period; [`Inputs::time_ms`] and [`Inputs::overruns`] are not looked
    /// at.
    fn inputs(&mut self) -> Inputs;

    /// Applies the outputs, of a rig that `is_armed` or not.
    fn apply(&mut self, outputs: &Outputs, motion: Motion, is_armed: bool);

    /// Sends the line whole, or drops it if there is no room for it now.
    fn send(&mut self, telemetry: &Telemetry);

    /// Looks after itself, once in a period while the rig rests: this may take some milliseconds.
    fn look(&mut self, time_ms: u32);

    /// Measures the supply in one of the next periods, in which the sensors' readings are those of the
    /// period before.
    fn measure_supply(&mut self);

    /// A period was completed; whether the rig is armed. A watchdog wants to hear it.
    fn completed(&mut self, is_armed: bool);
}

/// Parts of a board, to be used at once.
#[derive(Debug)]
pub struct Parts<'b, B: Board + ?Sized> {
    /// The cable to the computer.
    pub serial: &'b mut B::Serial,
    /// The memory of settings, faults and stroke.
    pub eeprom: &'b mut B::Memory,
    /// The second before a fault: beside the application, which is made on the stack.
    pub past: &'b mut Past,
    /// What counts cycles.
    pub probe: &'b mut B::Probe,
    /// Sentences and help.
    pub texts: B::Texts,
}

impl App {
    /// Obeys lines as they have come until a control period begins, and lets that one pass. With
    /// neither it returns at once, and the board may sleep until there is something.
    #[inline(always)] // Once, in `main`.
    pub fn period<B: Board>(&mut self, board: &mut B, assembler: &mut Assembler<MAX_LINE>) {
        while !board.is_due()
            && let Ok(byte) = board.parts().serial.read()
        {
            match assembler.push(byte) {
                Assembled::Pending => {}
                Assembled::Line(line) => {
                    let Parts {
                        serial,
                        eeprom,
                        past,
                        ..
                    } = board.parts();
                    let Ok(()) = self.receive(line, eeprom, past, serial);
                }
                Assembled::Overlong => self.overlong(),
            }
        }
        let Some(Period { time_ms, missed }) = board.period() else {
            return;
        };
        // While nothing moves, being late harms nobody: the self-test may take its time.
        let rests = self.rests();
        let inputs = Inputs {
            time_ms,
            overruns: if rests { 0 } else { missed },
            ..board.inputs()
        };
        let Parts { eeprom, past, .. } = board.parts();
        let outputs = self.tick(&inputs, eeprom, past);
        let is_armed = !self.rests();
        let motion = Motion {
            acceleration: self.acceleration(),
            is_homed: self.state() != State::Homing,
        };
        board.apply(&outputs, motion, is_armed);
        board.send(&self.telemetry());
        let Parts {
            serial,
            probe,
            texts,
            ..
        } = board.parts();
        let Ok(()) = self.report(&texts, serial, probe);
        if rests {
            board.look(time_ms);
        } else if self.state() != State::Homing && is_supply_due(time_ms, &outputs) {
            board.measure_supply();
        }
        board.completed(is_armed);
    }

    /// Whether nothing moves.
    fn rests(&self) -> bool {
        matches!(self.state(), State::Idle | State::Fault)
    }
}

/// Whether the supply of a rig that is homed is to be measured: each second if the pump rests, when a reading that
/// is repeated harms least, and each eighth in any case. Powers of two, since a division takes 500 cycles.
fn is_supply_due(time_ms: u32, outputs: &Outputs) -> bool {
    let rests = match outputs.pump {
        Pump::Off | Pump::Brake => true,
        Pump::Rate(rate) => rate == 0.0,
    };
    let every_ms = if rests { 1_024 } else { 8_192 };
    time_ms % every_ms < u32::from(PERIOD_MS)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::{collections::VecDeque, string::String, vec, vec::Vec};

    use embedded_hal_nb::nb;
    use wire::{
        command::{Command, Request},
        fault::Fault,
        stretch::NoProbe,
        text::Text,
    };

    use super::*;
    use crate::{
        app::PlainTexts,
        io::{Pump, ResetCause, Valve},
        plant::Plant,
    };

    struct Cable {
        to_board: VecDeque<u8>,
        said: String,
    }

    impl embedded_hal_nb::serial::ErrorType for Cable {
        type Error = Infallible;
    }

    impl Read<u8> for Cable {
        fn read(&mut self) -> nb::Result<u8, Infallible> {
            self.to_board.pop_front().ok_or(nb::Error::WouldBlock)
        }
    }

    impl uWrite for Cable {
        type Error = Infallible;
        fn write_str(&mut self, text: &str) -> Result<(), Infallible> {
            self.said.push_str(text);
            Ok(())
        }
    }

    struct Memory(Vec<u8>);

    impl Eeprom for Memory {
        fn read(&self, address: u16) -> u8 {
            self.0[usize::from(address)]
        }
        fn write(&mut self, address: u16, byte: u8) {
            self.0[usize::from(address)] = byte;
        }
    }

    /// A board without a processor: a rig of equations behind it, and a note of every call.
    struct Desktop {
        cable: Cable,
        memory: Memory,
        past: Past,
        probe: NoProbe,
        plant: Plant,
        /// Periods that have begun and were not seen.
        due: u8,
        time_ms: u32,
        outputs: Outputs,
        /// Whether the rig was armed, each time that a period was completed.
        completed: Vec<bool>,
        samples: Vec<Telemetry>,
        /// How often the supply was to be measured.
        measured: u32,
        looked: usize,
    }

    impl Board for Desktop {
        type Serial = Cable;
        type Memory = Memory;
        type Probe = NoProbe;
        type Texts = PlainTexts;

        fn parts(&mut self) -> Parts<'_, Self> {
            Parts {
                serial: &mut self.cable,
                eeprom: &mut self.memory,
                past: &mut self.past,
                probe: &mut self.probe,
                texts: PlainTexts,
            }
        }

        fn is_due(&self) -> bool {
            self.due > 0
        }

        fn period(&mut self) -> Option<Period> {
            let missed = core::mem::take(&mut self.due).checked_sub(1)?;
            self.time_ms += 10 * (u32::from(missed) + 1);
            Some(Period {
                time_ms: self.time_ms,
                missed,
            })
        }

        fn inputs(&mut self) -> Inputs {
            self.plant.inputs()
        }

        fn apply(&mut self, outputs: &Outputs, motion: Motion, is_armed: bool) {
            assert!(motion.acceleration > 0.0);
            assert!(is_armed || matches!(outputs.pump, Pump::Off));
            self.outputs = *outputs;
            self.plant.step(outputs);
        }

        fn send(&mut self, telemetry: &Telemetry) {
            self.samples.push(*telemetry);
        }

        fn look(&mut self, _: u32) {
            self.looked += 1;
        }

        fn measure_supply(&mut self) {
            self.measured += 1;
        }

        fn completed(&mut self, is_armed: bool) {
            self.completed.push(is_armed);
        }
    }

    struct Rig {
        app: App,
        board: Desktop,
        assembler: Assembler<MAX_LINE>,
    }

    impl Rig {
        fn new() -> Self {
            let memory = Memory(vec![0xff; usize::from(crate::stroke::SIZE)]);
            Self {
                app: App::new(&memory, ResetCause::Ordinary),
                board: Desktop {
                    cable: Cable {
                        to_board: VecDeque::new(),
                        said: String::new(),
                    },
                    memory,
                    past: Past::new(),
                    probe: NoProbe,
                    plant: Plant::new(60e3, 8e3),
                    due: 0,
                    time_ms: 0,
                    outputs: Outputs::default(),
                    completed: Vec::new(),
                    samples: Vec::new(),
                    looked: 0,
                    measured: 0,
                },
                assembler: Assembler::new(),
            }
        }

        fn say(&mut self, command: Command) {
            let mut line = Text::default();
            Request { id: 1, command }.write(&mut line).unwrap();
            self.board.cable.to_board.extend(line.0.bytes());
        }

        /// What `main` does: between two beginnings of a period and at them.
        fn periods(&mut self, count: usize) {
            for _ in 0..count {
                self.app.period(&mut self.board, &mut self.assembler);
                self.board.due += 1;
                self.app.period(&mut self.board, &mut self.assembler);
            }
        }

        fn until(&mut self, state: State) {
            for _ in 0..60 {
                if self.app.state() == state {
                    return;
                }
                self.say(Command::Beat);
                self.periods(50);
            }
            panic!("{:?}", self.app.state());
        }
    }

    #[test]
    fn a_board_is_armed_and_completes_every_period() {
        let mut rig = Rig::new();
        rig.periods(50);
        rig.say(Command::Arm);
        rig.periods(1);
        assert!(
            rig.board.cable.said.starts_with("A: 1 ok"),
            "{}",
            rig.board.cable.said
        );
        rig.until(State::Ready);
        assert_eq!(rig.board.outputs.valve, Valve::Closed);
        assert!((rig.board.plant.plunger - 500.0).abs() < 10.0);
        // A line and a completed period each; at rest the board looked after itself.
        let (completed, samples) = (&rig.board.completed, &rig.board.samples);
        assert_eq!(completed.len(), samples.len());
        let armed = completed.iter().filter(|it| **it).count();
        assert_eq!(rig.board.looked, completed.len() - armed);
        let states = samples.iter().map(|it| it.state);
        assert!(
            states
                .zip(completed)
                .all(|(state, &armed)| armed == !matches!(state, State::Idle | State::Fault))
        );
    }

    /// A line that comes while a period is due waits for it: control goes first.
    #[test]
    fn a_period_that_is_due_goes_before_lines() {
        let mut rig = Rig::new();
        rig.say(Command::Status);
        rig.board.due = 1;
        rig.app.period(&mut rig.board, &mut rig.assembler);
        assert_eq!(
            (rig.board.cable.said.as_str(), rig.board.samples.len()),
            ("", 1)
        );
        rig.app.period(&mut rig.board, &mut rig.assembler);
        assert!(rig.board.cable.said.contains("ok i 0"));
        assert_eq!(rig.board.samples.len(), 1);
    }

    /// Late at rest is no fault, late while armed is.
    #[test]
    fn a_missed_period_stops_an_armed_rig_only() {
        let mut rig = Rig::new();
        rig.periods(20);
        rig.board.due = 2;
        rig.periods(1);
        assert_eq!(rig.app.state(), State::Idle);
        rig.periods(30);
        rig.say(Command::Arm);
        rig.until(State::Ready);
        rig.board.due = 2;
        rig.periods(1);
        assert_eq!(
            rig.board.samples.last().unwrap().fault,
            Fault::Overrun.code()
        );
        assert_eq!(
            (rig.board.outputs.pump, rig.board.outputs.valve),
            (Pump::Off, Valve::Open)
        );
        assert_eq!(rig.board.completed.last(), Some(&false));
    }

    #[test]
    fn an_overlong_line_is_counted() {
        let mut rig = Rig::new();
        rig.board.cable.to_board.extend([b'x'; MAX_LINE + 1]);
        rig.board.cable.to_board.extend(b"\nstatus\n");
        rig.periods(20);
        assert!(
            rig.board.cable.said.contains("ok i 0 0 0 1 "),
            "{}",
            rig.board.cable.said
        );
    }
}
