// SPDX-License-Identifier: GPL-3.0-or-later
//! A rig with the real image, and someone at the computer's end of the cable.

use std::env;

use model_core::{actuator::Model, catalogue::Effect};
use softrig_link::line::request_text;
use virtual_rig::{Image, Options, VirtualRig};
use wire::{
    command::{Command, Request},
    decimal::Hundredths,
    fault::Fault,
    protocol::{ControlMode, Segment},
    reply::{Refusal, Reply},
    settings::Key,
    state::State,
    telemetry::{Setpoint, Telemetry},
};

const IMAGE: &str = "SOFTRIG_FIRMWARE";

/// The image, or nothing where none was built.
pub fn image() -> Option<Image> {
    let elf = elf()?;
    Some(Image::parse(&elf).expect("the file is an image"))
}

/// The file of the image, or nothing where none was built.
pub fn elf() -> Option<Vec<u8>> {
    let Some(path) = env::var_os(IMAGE) else {
        println!("skipped: {IMAGE} is not set; `cargo xtask test` builds the image and sets it");
        return None;
    };
    Some(std::fs::read(path).expect("the image can be read"))
}

/// The actuator that the firmware believes in when it is shipped, with effects
/// that it does not know of.
pub fn actuator(effects: &[Effect<f64>]) -> Model<f64> {
    let dynamics = *virtual_rig::default_actuator().dynamics();
    Model::new(dynamics, effects).expect("the effects are valid")
}

/// A healthy rig around that actuator.
pub fn healthy() -> Options {
    Options::with_actuator(actuator(&[]))
}

/// A rig and what was heard from it.
pub struct Bench {
    pub rig: VirtualRig,
    /// Every sample since the start.
    pub samples: Vec<Telemetry>,
    /// Every remark since the start, without `# ` and checksum.
    pub remarks: Vec<String>,
    /// Lines that made no sense.
    pub garbage: usize,
    /// Whether the computer says now and then that it is there.
    pub beating: bool,
    /// The highest true pressure (kPa) since it was last set.
    pub highest_kpa: f64,
    id: u8,
    replies: Vec<(u8, Result<String, Refusal>)>,
    beat_at_s: f64,
}

impl Bench {
    /// Switches a rig on and waits for its first sample.
    pub fn start(options: Options) -> Option<Self> {
        Some(Self::of(&image()?, options))
    }

    /// As [`Self::start`], with another image.
    pub fn of(image: &Image, options: Options) -> Self {
        let mut bench = Self {
            rig: VirtualRig::new(image, options).expect("a rig"),
            samples: Vec::new(),
            remarks: Vec::new(),
            garbage: 0,
            beating: true,
            highest_kpa: 0.0,
            id: 0,
            replies: Vec::new(),
            beat_at_s: 0.0,
        };
        bench.until(3.0, "the first sample", |bench| !bench.samples.is_empty());
        bench
    }

    /// Lets time pass.
    pub fn run(&mut self, seconds: f64) {
        let end = self.rig.time_s() + seconds;
        while self.rig.time_s() < end - 1e-9 {
            let slice = (end - self.rig.time_s()).min(0.01);
            self.rig.run_for(slice).expect("the board runs");
            self.highest_kpa = self.highest_kpa.max(self.rig.plant().pressure_kpa);
            self.hear();
            if self.beating && self.rig.time_s() >= self.beat_at_s {
                self.beat_at_s = self.rig.time_s() + 0.5;
                self.send(Command::Beat);
            }
        }
    }

    /// Lets time pass until something holds.
    #[track_caller]
    pub fn until(&mut self, seconds: f64, what: &str, holds: impl Fn(&Self) -> bool) {
        let end = self.rig.time_s() + seconds;
        while !holds(self) {
            assert!(
                self.rig.time_s() < end,
                "{what} did not come within {seconds} s; last: {:?}, {:?}, plant {:?}",
                self.samples.last(),
                self.remarks.last(),
                self.rig.plant()
            );
            self.run(0.05);
        }
    }

    fn hear(&mut self) {
        for line in self.rig.take_lines() {
            if let Ok(sample) = Telemetry::parse(line.as_bytes()) {
                self.samples.push(sample);
            } else if let Ok(Some(reply)) = Reply::parse(&line) {
                self.replies
                    .push((reply.id, reply.outcome.map(str::to_owned)));
            } else if let Some(remark) = wire::line::open(&line)
                .ok()
                .and_then(|text| text.strip_prefix("#: "))
            {
                self.remarks.push(remark.to_owned());
            } else {
                self.garbage += 1;
            }
        }
    }

    /// Sends a request and returns its number.
    pub fn send(&mut self, command: Command) -> u8 {
        self.id = self.id.wrapping_add(1);
        let id = self.id;
        self.rig
            .send(request_text(&Request { id, command }).as_bytes())
            .expect("bytes are queued");
        id
    }

    /// Sends a request and returns the answer.
    #[track_caller]
    pub fn ask(&mut self, command: Command) -> Result<String, Refusal> {
        self.replies.clear();
        let id = self.send(command);
        self.until(2.0, "a reply", |bench| {
            bench.replies.iter().any(|(reply, _)| *reply == id)
        });
        let index = self
            .replies
            .iter()
            .position(|(reply, _)| *reply == id)
            .expect("it was waited for");
        self.replies.swap_remove(index).1
    }

    /// Sends a request that has to be obeyed.
    #[track_caller]
    pub fn obey(&mut self, command: Command) -> String {
        self.ask(command)
            .unwrap_or_else(|refusal| panic!("{command:?}: {refusal}"))
    }

    /// The newest sample.
    #[track_caller]
    pub fn now(&self) -> Telemetry {
        *self.samples.last().expect("a sample")
    }

    /// The state of the newest sample.
    pub fn state(&self) -> State {
        self.now().state
    }

    /// The latched fault of the newest sample.
    pub fn fault(&self) -> Option<Fault> {
        Fault::from_code(self.now().fault)
    }

    /// Homes the plunger and waits until the rig is ready.
    #[track_caller]
    pub fn arm(&mut self) {
        self.obey(Command::Arm);
        self.until(40.0, "ready", |bench| bench.state() == State::Ready);
    }

    /// Loads one step and makes the rig ready for it.
    #[track_caller]
    pub fn load(&mut self, mode: ControlMode, level: f32) {
        assert!(self.prepare(mode, level), "{:?}", self.samples.last());
    }

    /// Loads one step and arms the rig for it; whether that is ready, and not in a fault.
    #[track_caller]
    pub fn prepare(&mut self, mode: ControlMode, level: f32) -> bool {
        self.obey(Command::Load(1));
        let segment = Segment::Step {
            mode,
            level: Hundredths::round(level),
            duration_ms: 200_000,
        };
        self.obey(Command::Segment { index: 0, segment });
        if self.ask(Command::Arm).is_err() {
            return false;
        }
        let is_over = |bench: &Self| matches!(bench.state(), State::Ready | State::Fault);
        self.until(40.0, "ready or a fault", is_over);
        self.state() == State::Ready
    }

    /// Changes a setting in the draft.
    #[track_caller]
    pub fn set(&mut self, key: Key, value: f32) {
        self.obey(Command::Set {
            key,
            bits: value.to_bits(),
        });
    }

    /// Uses the draft and waits until it is in EEPROM.
    #[track_caller]
    pub fn save(&mut self) {
        let saved = |bench: &Self| {
            bench
                .remarks
                .iter()
                .filter(|remark| remark.starts_with("saved"))
                .count()
        };
        let before = saved(self);
        self.obey(Command::Save);
        self.until(5.0, "saved", |bench| saved(bench) > before);
    }

    /// Whether pump and valve are as a fault wants them.
    pub fn is_safe(&self) -> bool {
        let plant = self.rig.plant();
        !plant.driver_enabled && plant.valve_open
    }

    /// Waits until a fault is latched and the rig is safe, and checks which.
    #[track_caller]
    pub fn expect_fault(&mut self, fault: Fault, within_s: f64) {
        self.until(within_s, fault.name(), |bench| bench.now().fault != 0);
        assert_eq!(self.fault(), Some(fault));
        self.run(0.02);
        assert_eq!(self.state(), State::Fault);
        assert!(self.is_safe(), "{:?}", self.rig.plant());
        let steps = self.rig.plant().steps;
        self.run(1.0);
        assert_eq!(self.rig.plant().steps, steps, "the pump still moves");
        assert_eq!(self.fault(), Some(fault), "the fault was not latched");
        // It does not go away by asking for something else.
        assert_eq!(self.ask(Command::Arm), Err(Refusal::Faulted));
        assert!(self.ask(Command::Run(None)).is_err());
    }

    /// Angles (°) that were asked for during half a second or more, in order; on
    /// the way there the set-point's rate is limited.
    pub fn angles_held_deg(&self) -> Vec<f32> {
        let mut held = Vec::new();
        let mut last = (Setpoint::None, 0);
        for sample in &self.samples {
            if sample.setpoint == last.0 {
                last.1 += 1;
            } else {
                last = (sample.setpoint, 1);
            }
            if let (Setpoint::Angle(level), 50) = last {
                held.push(level.to_f32());
            }
        }
        held
    }
}
