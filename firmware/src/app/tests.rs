extern crate std;

use std::{
    format,
    string::{String, ToString},
    vec::Vec,
};

use wire::{line, protocol::Named, reply::Reply};

use super::*;
use crate::{io::PERIOD_S, plant::Plant, probe::NoProbe};

#[derive(Default)]
struct Text(String);

impl uWrite for Text {
    type Error = core::convert::Infallible;
    fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
        self.0.push_str(text);
        Ok(())
    }
}

/// The firmware's logic on a simulated rig, in accelerated time.
struct Rig {
    app: App,
    plant: Plant,
    id: u8,
    beats: bool,
    remarks: Vec<String>,
    log: Vec<Telemetry>,
}

impl Rig {
    fn new() -> Self {
        Self {
            app: App::new(&Settings::DEFAULT, ResetCause::Ordinary),
            plant: Plant::new(60e3, 8e3),
            id: 0,
            beats: true,
            remarks: Vec::new(),
            log: Vec::new(),
        }
    }

    fn say(&mut self, text: &str) -> String {
        let mut out = Text::default();
        self.app
            .receive(text.as_bytes(), &mut out, &mut NoProbe)
            .unwrap();
        out.0
    }

    /// The text of the reply, or the refusal.
    fn ask(&mut self, command: Command) -> Result<String, Refusal> {
        self.id = self.id.wrapping_add(1);
        let request = Request {
            id: self.id,
            command,
        };
        let mut line = Text::default();
        request.write(&mut line).unwrap();
        let said = self.say(line.0.trim_end());
        let reply = Reply::parse(said.lines().next().expect("a reply"))
            .expect("an undamaged line")
            .expect("a reply");
        assert_eq!(reply.id, self.id);
        reply.outcome.map(ToString::to_string)
    }

    fn tick(&mut self) -> Outputs {
        let inputs = self.plant.inputs();
        let outputs = self.app.tick(&inputs);
        self.plant.step(&outputs);
        self.log.push(self.app.telemetry());
        let mut out = Text::default();
        self.app.report(&PlainTexts, &mut out).unwrap();
        for text in out.0.lines() {
            let text = line::open(text).expect("a sealed line");
            self.remarks.push(text.strip_prefix("# ").unwrap().into());
        }
        if self.beats && self.log.len() % 50 == 0 {
            assert_eq!(self.ask(Command::Beat), Ok(String::new()));
        }
        outputs
    }

    fn wait(&mut self, seconds: f32) {
        for _ in 0..(seconds / PERIOD_S) as usize {
            self.tick();
        }
    }

    fn wait_for(&mut self, state: State, seconds: f32) {
        for _ in 0..(seconds / PERIOD_S) as usize {
            if self.app.state() == state {
                return;
            }
            self.tick();
        }
        panic!(
            "{:?}, fault {:?}",
            self.app.state(),
            self.app.supervisor.fault()
        );
    }

    fn armed() -> Self {
        let mut rig = Self::new();
        rig.wait(0.5);
        rig.ask(Command::Arm).unwrap();
        rig.wait_for(State::Ready, 60.0);
        rig
    }

    fn running(named: Named) -> Self {
        let mut rig = Self::armed();
        rig.ask(Command::Run(Some(named))).unwrap();
        rig
    }
}

#[test]
fn the_papers_protocol_is_played_to_its_end() {
    let mut rig = Rig::running(Named::Paper);
    let start = rig.log.len();
    rig.wait_for(State::Ready, 300.0);
    let log = &rig.log[start..];
    let mut steps = Vec::new();
    for (k, sample) in log.iter().enumerate() {
        assert_eq!(sample.fault, 0);
        assert!(!sample.mismatch, "at {k}");
        let next = log.get(k + 1).map(|next| next.setpoint);
        if let (Setpoint::Angle(level), Some(Setpoint::None)) = (sample.setpoint, next) {
            steps.push((level.to_f32(), sample.angle_deg.unwrap().to_f32()));
        }
    }
    std::println!("{steps:?} in {} s", log.len() / 100);
    assert_eq!(steps.len(), 14);
    for (k, (level, reached)) in steps.iter().enumerate() {
        let asked = if k < 7 { 60.0 } else { 90.0 };
        assert!((level - asked).abs() < 0.01);
        assert!((reached - asked).abs() < 2.0, "{k}: {reached}");
    }
    assert!((rig.plant.plunger - 500.0).abs() < 10.0);
}
