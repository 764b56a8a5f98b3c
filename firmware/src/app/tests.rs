extern crate std;

use std::{
    format,
    string::{String, ToString},
    vec,
    vec::Vec,
};

use proptest::prelude::*;
use wire::{
    answer::{Exact, Machine},
    command::{Command, Request},
    line,
    protocol::{ControlMode, Named, Segment},
    reply::{Refusal, Reply},
    text::{Text, sealed},
};

use super::*;
use crate::wire_testing::{every_command, segments};
use crate::{control::limit, design::PERIOD_S, plant::Plant};
use wire::stretch::NoProbe;

struct Memory {
    bytes: Vec<u8>,
    worn: bool,
}

impl Eeprom for Memory {
    fn read(&self, address: u16) -> u8 {
        self.bytes[usize::from(address)]
    }
    fn write(&mut self, address: u16, byte: u8) {
        self.bytes[usize::from(address)] = if self.worn { byte & 0xf0 } else { byte };
    }
}

/// The firmware's logic on a simulated rig, in accelerated time.
struct Rig {
    app: App,
    plant: Plant,
    eeprom: Memory,
    past: Past,
    id: u8,
    beats: bool,
    remarks: Vec<String>,
    log: Vec<Telemetry>,
}

impl Rig {
    fn new() -> Self {
        let eeprom = Memory {
            bytes: vec![0xff; 4096],
            worn: false,
        };
        Self {
            app: App::new(&eeprom, ResetCause::Ordinary),
            eeprom,
            past: Past::new(),
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
            .receive(text.as_bytes(), &self.eeprom, &self.past, &mut out)
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
        let outputs = self.app.tick(&inputs, &mut self.eeprom, &mut self.past);
        self.plant.step(&outputs);
        self.log.push(self.app.telemetry());
        let mut out = Text::default();
        self.app
            .report(&PlainTexts, &mut out, &mut NoProbe)
            .unwrap();
        for text in out.0.lines() {
            let text = line::open(text).expect("a sealed line");
            self.remarks.push(text.strip_prefix("#: ").unwrap().into());
        }
        if self.beats && self.log.len().is_multiple_of(50) {
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

    fn machine(&mut self) -> Machine {
        Machine::parse(&self.ask(Command::Machine).unwrap()).expect("a machine")
    }

    fn set(&mut self, key: Key, value: f32) {
        let bits = value.to_bits();
        self.ask(Command::Set { key, bits }).unwrap();
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

/// Every word that a request can begin with.
#[test]
fn the_help_names_every_request() {
    // Who asks for help knows the word.
    for command in every_command()
        .into_iter()
        .filter(|it| *it != Command::Help)
    {
        let mut line = Text::default();
        Request { id: 1, command }.write(&mut line).unwrap();
        let word = line.0.split(' ').nth(1).unwrap();
        let mut words = HELP
            .iter()
            .flat_map(|line| line.split([' ', ',', ':', ';']));
        assert!(words.any(|it| it == word), "{word}");
    }
    // A line and telemetry in four periods of the cable.
    assert!(HELP.iter().all(|line| line.len() <= 80));
}

/// The switches of the plant are 57 ml apart, and the smallest syringe has 50.
#[test]
fn no_largest_volume_is_beyond_the_stroke_that_was_measured() {
    let mut rig = Rig::new();
    // Tube and actuator: the last air leaves as quickly as the first.
    rig.plant.volume += 20e3;
    rig.plant.gas += 20e3;
    rig.wait(0.5);
    let unknown = Machine {
        supply_mv: rig.machine().supply_mv,
        ..Machine::default()
    };
    assert_eq!(rig.machine(), unknown);
    rig.set(Key::MaxVolume, 56_000.0);
    assert_eq!(rig.ask(Command::Save), Err(Refusal::BeyondStroke));
    rig.ask(Command::Stroke).unwrap();
    rig.wait_for(State::Homing, 0.1);
    rig.wait_for(State::Ready, 120.0);
    let steps = rig.machine().stroke_steps.expect("it was measured");
    assert!(steps.abs_diff(162_857) < 10, "{steps}");
    rig.ask(Command::Disarm).unwrap();
    rig.wait(1.0);
    rig.ask(Command::Save).unwrap();
    rig.wait(5.0);
    rig.set(Key::MaxVolume, 57_500.0);
    assert_eq!(rig.ask(Command::Save), Err(Refusal::BeyondStroke));
    // It outlives the power.
    rig.app = App::new(&rig.eeprom, ResetCause::Ordinary);
    assert_eq!(rig.machine().stroke_steps, Some(steps));
    assert_eq!(
        rig.app.settings().bits(Key::MaxVolume),
        Some(56_000_f32.to_bits())
    );
}

/// A syringe that is smaller than `max.ul` said before it was measured: the pump stops before the
/// switch, and no run ends there.
#[test]
fn a_stroke_that_is_smaller_than_the_setting_is_the_limit() {
    let mut rig = Rig::new();
    rig.plant.far_switch = 30e3;
    // So much air that no pressure is reached, and little enough for the sensor to see it.
    rig.plant.volume = 300e3;
    rig.plant.gas = rig.plant.volume - rig.plant.plunger;
    rig.wait(0.5);
    rig.ask(Command::Stroke).unwrap();
    rig.wait_for(State::Homing, 0.1);
    rig.wait_for(State::Ready, 120.0);
    rig.ask(Command::Load(1)).unwrap();
    rig.ask(Command::Segment {
        index: 0,
        segment: Segment::Step {
            mode: ControlMode::Pressure,
            level: Hundredths(2_000),
            duration_ms: 60_000,
        },
    })
    .unwrap();
    rig.ask(Command::Run(None)).unwrap();
    let mut farthest = 0.0_f64;
    while rig.app.supervisor.fault().is_none() {
        rig.tick();
        farthest = farthest.max(rig.plant.plunger);
    }
    // The stall watch takes so much air for an open tube, or the loop says that it cannot.
    let fault = rig.app.supervisor.fault();
    assert_ne!(fault, Some(Fault::EndSwitch));
    assert!(farthest < 30e3, "{farthest}");
}

#[test]
fn a_low_supply_arms_nothing() {
    let mut rig = Rig::new();
    rig.plant.supply_v = 4.4;
    rig.wait(0.5);
    assert_eq!(rig.ask(Command::Arm), Err(Refusal::LowSupply));
    assert_eq!(rig.ask(Command::Stroke), Err(Refusal::LowSupply));
    assert!(rig.machine().supply_mv.unwrap().abs_diff(4_400) < 20);
    rig.plant.supply_v = 4.6;
    rig.wait(0.1);
    rig.ask(Command::Arm).unwrap();
    // What a motor that starts takes is the brown-out's business.
    rig.plant.supply_v = 4.45;
    rig.wait_for(State::Ready, 60.0);
    // Readings of a supply that moves farther are worth nothing.
    rig.plant.supply_v = 4.3;
    rig.wait(0.1);
    assert_eq!(rig.app.supervisor.fault(), Some(Fault::Supply));
}

#[test]
fn lost_steps_are_known_after_the_next_home() {
    let mut rig = Rig::armed();
    assert_eq!(rig.machine().lost_steps, None, "nothing to compare with");
    rig.plant.zero -= 0.35 * 812.0;
    rig.ask(Command::Disarm).unwrap();
    rig.wait(1.0);
    rig.ask(Command::Arm).unwrap();
    rig.wait_for(State::Homing, 0.1);
    rig.wait_for(State::Ready, 60.0);
    let lost = rig.machine().lost_steps.unwrap();
    assert!((lost - 812).abs() < 15, "{lost}");
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

/// The cable carries 11 520 bytes a second, and a line of telemetry for which there is no room
/// is dropped: a recording would have a hole just where the fault is.
#[test]
fn a_fault_and_questions_about_it_leave_room_for_telemetry() {
    /// Bytes that the cable carries in a control period.
    const CABLE: usize = 115;
    /// Bytes that wait for it, at most.
    const WAITING: usize = 255;
    for phase in 0..4 {
        let mut rig = Rig::running(Named::Steps);
        rig.wait(5.0);
        rig.plant.flex_counts = Some(0.0);
        let mut waiting = 0_usize;
        for period in 0..400 {
            let remarks = rig.remarks.len();
            rig.tick();
            // More often than `softrig` ever asks.
            if period % 4 == phase {
                waiting += rig.say("status").len();
            }
            // `#: ` before, a checksum and the end of the line behind.
            let of_remarks = rig.remarks[remarks..].iter().map(|text| 3 + text.len() + 7);
            waiting += of_remarks.sum::<usize>();
            let mut telemetry = Text::default();
            rig.log.last().unwrap().write(&mut telemetry).unwrap();
            waiting += telemetry.0.len();
            assert!(
                waiting <= WAITING,
                "{waiting} bytes wait in period {period}"
            );
            waiting = waiting.saturating_sub(CABLE);
        }
        assert_eq!(rig.app.state(), State::Fault);
    }
}

/// Every fault has to lead to this.
fn assert_stopped(rig: &mut Rig, fault: Fault) {
    assert_eq!(rig.app.state(), State::Fault);
    assert_eq!(rig.log.last().unwrap().fault, fault.code());
    for _ in 0..4 {
        let outputs = rig.tick();
        assert_eq!((outputs.pump, outputs.valve), (Pump::Off, Valve::Open));
    }
    assert_eq!(rig.remarks.last().unwrap(), fault.sentence());
    // It is latched: nothing but `clear` leads out.
    assert_eq!(rig.ask(Command::Arm), Err(Refusal::Faulted));
    rig.wait(1.0);
    assert_eq!(rig.app.state(), State::Fault);
}

/// Brings a fault about while the protocol rises to 60°, and lets it go again.
fn inject(fault: Fault, seconds: f32, injure: impl Fn(&mut Rig), heal: impl Fn(&mut Rig)) {
    let mut rig = Rig::running(Named::Paper);
    rig.wait(2.0);
    injure(&mut rig);
    rig.wait_for(State::Fault, seconds);
    assert_stopped(&mut rig, fault);
    heal(&mut rig);
    rig.wait(2.0);
    assert_eq!(rig.ask(Command::Clear), Ok(String::new()), "{fault:?}");
    assert_eq!(rig.app.state(), State::Idle);
    rig.ask(Command::Arm).unwrap();
    rig.wait_for(State::Ready, 60.0);
}

#[test]
fn every_fault_that_can_be_provoked_stops_the_rig() {
    inject(
        Fault::EmergencyStop,
        0.02,
        |rig| rig.plant.emergency_stop = true,
        |rig| rig.plant.emergency_stop = false,
    );
    inject(
        Fault::PressureSensor,
        0.1,
        |rig| rig.plant.pressure_counts = Some(1023.0),
        |rig| rig.plant.pressure_counts = None,
    );
    inject(
        Fault::FlexSensor,
        0.1,
        |rig| rig.plant.flex_counts = Some(0.0),
        |rig| rig.plant.flex_counts = None,
    );
    inject(
        Fault::OverPressure,
        0.03,
        |rig| rig.plant.pressure_counts = Some(400.0),
        |rig| rig.plant.pressure_counts = None,
    );
    inject(
        Fault::OverAngle,
        0.2,
        |rig| rig.plant.flex_counts = Some(300.0),
        |rig| rig.plant.flex_counts = None,
    );
    inject(
        Fault::EndSwitch,
        0.02,
        |rig| rig.plant.pushed_end = true,
        |rig| rig.plant.pushed_end = false,
    );
    inject(
        Fault::Stall,
        6.0,
        |rig| rig.plant.disconnected_tube = true,
        |rig| rig.plant.disconnected_tube = false,
    );
    inject(
        Fault::HostLost,
        2.6,
        |rig| rig.beats = false,
        |rig| rig.beats = true,
    );
    inject(
        Fault::Overrun,
        0.02,
        |rig| rig.plant.overruns = 1,
        |rig| rig.plant.overruns = 0,
    );
}

#[test]
fn a_cause_that_is_still_there_is_not_cleared() {
    let mut rig = Rig::new();
    rig.plant.emergency_stop = true;
    rig.wait(0.5);
    assert_stopped(&mut rig, Fault::EmergencyStop);
    assert_eq!(rig.ask(Command::Clear), Err(Refusal::StillThere));
    rig.plant.emergency_stop = false;
    rig.wait(0.1);
    assert_eq!(rig.ask(Command::Clear), Ok(String::new()));
    assert_eq!(rig.app.state(), State::Idle);
}

#[test]
fn a_stuck_switch_ends_homing_and_nothing_else_goes_on() {
    let mut rig = Rig::new();
    rig.plant.retracted_end = Some(true);
    rig.ask(Command::Arm).unwrap();
    rig.wait_for(State::Fault, 60.0);
    assert_stopped(&mut rig, Fault::RetractedSwitch);
    rig.plant.retracted_end = None;
    assert_eq!(rig.ask(Command::Clear), Ok(String::new()));
}

#[test]
fn an_unusual_reset_is_told_and_has_to_be_seen() {
    for (cause, fault) in [
        (ResetCause::Watchdog, Fault::Watchdog),
        (ResetCause::BrownOut, Fault::BrownOut),
        (ResetCause::WhileArmed, Fault::Restart),
    ] {
        let mut rig = Rig::new();
        rig.app = App::new(&rig.eeprom, cause);
        let mut out = Text::default();
        rig.app.banner(&mut out).unwrap();
        assert!(
            line::open(&out.0).unwrap().ends_with(fault.name()),
            "{}",
            out.0
        );
        rig.wait(0.1);
        assert_stopped(&mut rig, fault);
        assert_eq!(rig.ask(Command::Clear), Ok(String::new()));
        rig.wait(0.1);
        assert_eq!(rig.app.state(), State::Idle);
    }
}

#[test]
fn who_it_is_and_how_it_is_are_machine_readable() {
    let mut rig = Rig::new();
    rig.wait(0.1);
    let crc = SettingsId::of(&Settings::DEFAULT);
    assert_eq!(
        rig.ask(Command::Hello).unwrap(),
        format!("softrig 0.1.0 wire 3 settings {crc}")
    );
    assert_eq!(
        rig.ask(Command::Status).unwrap(),
        format!("i 0 0 0 0 {crc}")
    );
    assert!(rig.say(&sealed("9 fly")).contains("A: 9 no 1"));
    assert!(rig.say("arm").contains("A: 0 no 2"));
    assert_eq!(rig.say("7 arm *0000"), "");
    rig.app.overlong();
    assert_eq!(
        rig.ask(Command::Status).unwrap(),
        format!("i 0 1 1 1 {crc}")
    );
    let raw = rig.ask(Command::Raw).unwrap();
    let inputs = rig.app.inputs;
    assert_eq!(raw, format!("{} {}", inputs.pressure.0, inputs.flex.0));
    assert!(rig.say("status\r\n").contains("A: 0 ok i 0 1 1 1"));
    let before = rig.remarks.len();
    rig.ask(Command::Help).unwrap();
    rig.wait(0.5);
    assert_eq!(rig.remarks[before..], HELP);
    rig.ask(Command::SelfTest).unwrap();
}

/// The log names the fault that stopped the run, and the second before it agrees with telemetry.
#[test]
fn a_fault_is_remembered() {
    let mut rig = Rig::running(Named::Paper);
    rig.wait(3.0);
    assert_eq!(rig.ask(Command::Past(0)), Err(Refusal::Nothing));
    assert_eq!(rig.ask(Command::Log(0)), Err(Refusal::NotNow));
    rig.plant.emergency_stop = true;
    rig.tick();
    assert_eq!(rig.app.state(), State::Fault);
    let at = rig.log.len() - 1;
    rig.wait(0.5);
    let record = FaultRecord::parse(&rig.ask(Command::Log(0)).unwrap()).unwrap();
    let seen = rig.log[at];
    assert_eq!(
        record,
        FaultRecord {
            number: 0,
            fault: Fault::EmergencyStop.code(),
            state: State::Running,
            reset: ResetCause::Ordinary,
            time_ms: seen.time_ms,
            pressure_kpa: seen.pressure_kpa,
            volume_ul: seen.volume_ul,
        }
    );
    assert_eq!(rig.ask(Command::Log(1)), Err(Refusal::Nothing));
    let mut times = Vec::new();
    for back in 0..51 {
        let moment = Moment::parse(&rig.ask(Command::Past(back)).unwrap()).unwrap();
        let telemetry = rig
            .log
            .iter()
            .rfind(|line| line.time_ms == moment.time_ms)
            .expect("its line");
        assert_eq!(moment.pressure_kpa, telemetry.pressure_kpa);
        assert_eq!(moment.angle_deg, telemetry.angle_deg);
        assert_eq!(moment.volume_ul, telemetry.volume_ul);
        assert_eq!((moment.state, moment.segment), (State::Running, Some(0)));
        times.push(seen.time_ms - moment.time_ms);
    }
    assert_eq!(times[0], 0);
    assert!((980..=1_000).contains(&times[50]), "{times:?}");
    assert_eq!(rig.ask(Command::Past(51)), Err(Refusal::Nothing));
    rig.plant.emergency_stop = false;
    rig.wait(0.1);
    rig.ask(Command::Clear).unwrap();
    rig.tick();
    assert_eq!(rig.ask(Command::Past(0)), Err(Refusal::Nothing));
    // The log survives a reset.
    rig.app = App::new(&rig.eeprom, ResetCause::Ordinary);
    let again = rig.ask(Command::Log(0)).unwrap();
    assert_eq!(FaultRecord::parse(&again), Some(record));
}

#[test]
fn a_request_that_comes_twice_does_nothing_twice() {
    let mut rig = Rig::armed();
    assert_eq!(rig.ask(Command::Arm), Err(Refusal::NotNow));
    rig.ask(Command::Run(Some(Named::Paper))).unwrap();
    rig.wait(1.0);
    let before = rig.app.running().copied();
    assert!(before.is_some());
    assert_eq!(
        rig.ask(Command::Run(Some(Named::Paper))),
        Err(Refusal::NotNow)
    );
    assert_eq!(rig.app.running().copied(), before);
    assert_eq!(rig.ask(Command::Load(3)), Err(Refusal::NotNow));
    assert_eq!(rig.ask(Command::SelfTest), Err(Refusal::NotNow));
    for _ in 0..2 {
        assert_eq!(rig.ask(Command::Stop), Ok(String::new()));
        let outputs = rig.tick();
        assert_eq!((outputs.pump, outputs.valve), (Pump::Off, Valve::Open));
        assert_eq!(rig.app.state(), State::Idle);
    }
    assert_eq!(rig.ask(Command::Run(None)), Err(Refusal::NotNow));
}

#[test]
fn a_protocol_of_ones_own_is_checked_and_played() {
    let mut rig = Rig::armed();
    assert_eq!(rig.ask(Command::Run(None)), Err(Refusal::BadProtocol));
    let step = |level, mode| wire::protocol::Segment::Step {
        mode,
        level: Hundredths(level),
        duration_ms: 3_000,
    };
    let put = |rig: &mut Rig, index, segment| rig.ask(Command::Segment { index, segment });
    rig.ask(Command::Load(2)).unwrap();
    put(&mut rig, 0, step(3_000, ControlMode::AngleClosedLoop)).unwrap();
    assert_eq!(rig.ask(Command::Run(None)), Err(Refusal::BadProtocol));
    assert_eq!(
        put(&mut rig, 2, step(3_000, ControlMode::AngleClosedLoop)),
        Err(Refusal::BadProtocol)
    );
    put(&mut rig, 1, step(16_001, ControlMode::Pressure)).unwrap();
    assert_eq!(rig.ask(Command::Run(None)), Err(Refusal::BadProtocol));
    put(&mut rig, 1, step(2_000, ControlMode::Pressure)).unwrap();
    rig.ask(Command::Run(None)).unwrap();
    rig.wait(2.9);
    let angle = rig.log.last().unwrap().angle_deg.unwrap().to_f32();
    assert!((angle - 30.0).abs() < 3.0, "{angle}");
    rig.wait(3.0);
    let sample = rig.log.last().unwrap();
    assert_eq!(sample.setpoint, Setpoint::Pressure(Hundredths(2_000)));
    let pressure = sample.pressure_kpa.unwrap().to_f32();
    assert!((pressure - 20.0).abs() < 1.5, "{pressure}");
    assert!(rig.ask(Command::Status).unwrap().ends_with(" 1 0"));
    rig.wait_for(State::Ready, 10.0);
}

/// A computer that reads the log repeats the prediction to the bit.
#[test]
fn the_prediction_can_be_repeated_from_the_log() {
    let mut rig = Rig::running(Named::Steps);
    rig.wait(20.0);
    let exact = rig.ask(Command::Exact).unwrap();
    let Exact {
        sequence,
        steps,
        angle,
        rate,
        pressure,
    } = Exact::parse(&exact).unwrap();
    let steps = u16::try_from(steps).unwrap();
    let bits = [angle, rate, pressure].map(f32::to_bits);
    let at = |sequence: u16| {
        let sample = rig.log.iter().find(|sample| sample.sequence == sequence);
        // As it came over the cable.
        let mut out = Text::default();
        sample.unwrap().write(&mut out).unwrap();
        Telemetry::parse(out.0.as_bytes()).unwrap()
    };
    let predictor = &rig.app.predictor;
    let first = at(sequence - steps);
    let mut prediction = predictor.start(first.angle_deg.unwrap().0, first.pressure_kpa.unwrap().0);
    for sequence in sequence - steps + 1..=sequence {
        let sample = at(sequence);
        predictor.step(
            &mut prediction,
            sample.pressure_kpa.map(|pressure| pressure.0),
        );
        let predicted = Hundredths::round(prediction.reading() * DEG_PER_RAD);
        assert_eq!(sample.predicted_deg, Some(predicted));
    }
    let angle = prediction.angle();
    let again = [angle, predictor.rate(&prediction), prediction.pressure()].map(f32::to_bits);
    assert_eq!(bits, again);
    assert!(steps > 1_900 && angle > 0.1, "{steps} {angle}");
}

#[test]
fn a_rig_that_differs_from_its_model_raises_the_flag() {
    let mut rig = Rig::new();
    let mut dynamics = crate::plant::dynamics(&Settings::DEFAULT);
    dynamics.stiffness *= 0.6;
    rig.plant.model = model_core::actuator::Model::new(dynamics, &[]).unwrap();
    rig.wait(0.5);
    rig.ask(Command::Arm).unwrap();
    rig.wait_for(State::Ready, 60.0);
    rig.ask(Command::Run(Some(Named::Paper))).unwrap();
    rig.wait(6.0);
    assert!(rig.log.last().unwrap().mismatch);
    rig.ask(Command::Clear).unwrap();
    rig.tick();
    assert!(!rig.log.last().unwrap().mismatch, "cleared by hand");
    rig.wait(8.0);
    assert!(rig.log.last().unwrap().mismatch);
    rig.ask(Command::Stop).unwrap();
    assert_eq!(rig.ask(Command::Arm), Err(Refusal::Pressurised));
    rig.wait(1.0);
    rig.ask(Command::Arm).unwrap();
    rig.wait_for(State::Ready, 60.0);
    assert!(
        rig.log.last().unwrap().mismatch,
        "it stays for who looks later"
    );
    rig.ask(Command::Run(Some(Named::Paper))).unwrap();
    rig.tick();
    assert!(
        !rig.log.last().unwrap().mismatch,
        "a new run starts without it"
    );
}

fn set(rig: &mut Rig, key: Key, value: f32) -> Result<String, Refusal> {
    rig.ask(Command::Set {
        key,
        bits: value.to_bits(),
    })
}

#[test]
fn settings_are_used_when_saved_and_survive_a_reset() {
    let mut rig = Rig::new();
    rig.wait(0.1);
    set(&mut rig, Key::Damping, 2.5).unwrap();
    let get = |rig: &mut Rig| rig.ask(Command::Get(Key::Damping)).unwrap();
    assert_eq!(
        get(&mut rig),
        format!("{:08x}", Settings::DEFAULT.number(Key::Damping).to_bits()),
        "a draft"
    );
    assert_eq!(rig.ask(Command::Save), Ok(String::new()));
    assert_eq!(get(&mut rig), format!("{:08x}", 2.5_f32.to_bits()));
    assert_eq!(rig.ask(Command::Save), Err(Refusal::NotNow));
    assert_eq!(rig.ask(Command::Arm), Err(Refusal::NotNow));
    rig.wait(4.0);
    assert_eq!(rig.remarks, ["saved"]);
    let again = App::new(&rig.eeprom, ResetCause::Ordinary);
    assert!((again.settings().number(Key::Damping) - 2.5).abs() < f32::EPSILON);
    assert_eq!(again.settings(), rig.app.settings());
    rig.ask(Command::Arm).unwrap();
    assert_eq!(rig.ask(Command::Save), Err(Refusal::NotNow));
}

#[test]
fn a_draft_that_makes_no_sense_is_refused_as_a_whole() {
    let mut rig = Rig::new();
    set(&mut rig, Key::Damping, 2.5).unwrap();
    set(&mut rig, Key::SetpointMax, 200.0).unwrap();
    assert_eq!(
        set(&mut rig, Key::Exponent, -1.0),
        Err(Refusal::OutOfBounds)
    );
    assert_eq!(rig.ask(Command::Save), Err(Refusal::BadSettings));
    assert_eq!(rig.app.settings(), &Settings::DEFAULT);
    rig.ask(Command::Discard).unwrap();
    // Too fast for the steps that there is time for.
    set(&mut rig, Key::Stiffness, 1e6).unwrap();
    assert_eq!(rig.ask(Command::Save), Err(Refusal::BadSettings));
    rig.ask(Command::Discard).unwrap();
    rig.ask(Command::Save).unwrap();
    assert_eq!(rig.app.settings(), &Settings::DEFAULT);
}

#[test]
fn a_worn_out_memory_is_told_and_damage_is_a_fault_until_saved() {
    let mut rig = Rig::new();
    rig.eeprom.worn = true;
    rig.ask(Command::Save).unwrap();
    rig.wait(4.0);
    assert_eq!(rig.remarks, ["not saved"]);

    let mut rig = Rig::new();
    rig.ask(Command::Save).unwrap();
    rig.wait(4.0);
    for byte in &mut rig.eeprom.bytes[20..100] {
        *byte ^= 0x10;
    }
    rig.app = App::new(&rig.eeprom, ResetCause::Ordinary);
    rig.wait(0.1);
    assert_stopped(&mut rig, Fault::Settings);
    assert_eq!(rig.ask(Command::Clear), Err(Refusal::StillThere));
    rig.ask(Command::Save).unwrap();
    rig.wait(4.0);
    assert_eq!(rig.ask(Command::Clear), Ok(String::new()));
}

#[test]
fn what_the_sensors_show_at_rest_becomes_zero() {
    let mut rig = Rig::new();
    rig.plant.pressure_counts = Some(105.0);
    rig.wait(0.5);
    assert_eq!(rig.ask(Command::Tare), Err(Refusal::NotAtRest));
    rig.wait(2.0);
    assert_eq!(rig.ask(Command::Tare), Ok(String::new()));
    rig.wait(0.1);
    let pressure = rig.log.last().unwrap().pressure_kpa.unwrap().0;
    assert!(pressure.abs() < 50, "{pressure}");
    rig.ask(Command::Arm).unwrap();
    assert_eq!(rig.ask(Command::Tare), Err(Refusal::NotNow));
}

fn commands() -> impl Strategy<Value = Command> {
    let segment = segments(0..20_000, 1..=5_000, 0..2);
    let named = prop::sample::select(Named::ALL);
    let keys: Vec<Key> = Key::all().collect();
    prop_oneof![
        4 => Just(Command::Arm),
        1 => Just(Command::Stop),
        1 => Just(Command::Disarm),
        1 => Just(Command::Clear),
        1 => Just(Command::Tare),
        1 => Just(Command::Save),
        1 => Just(Command::Discard),
        2 => Just(Command::Run(None)),
        4 => named.prop_map(|named| Command::Run(Some(named))),
        1 => (1..4u8).prop_map(Command::Load),
        4 => (0..4u8, segment).prop_map(|(index, segment)| Command::Segment { index, segment }),
        1 => (prop::sample::select(keys), any::<f32>()).prop_map(|(key, value)| Command::Set {
            key,
            bits: value.to_bits(),
        }),
        1 => Just(Command::Status),
        1 => Just(Command::Exact),
        1 => (0..10_u8).prop_map(Command::Log),
        1 => (0..60_u8).prop_map(Command::Past),
        1 => Just(Command::Switches),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// Whatever is asked and whatever the sensors claim.
    #[test]
    fn outputs_respect_the_limits_always(
        sequence in prop::collection::vec(
            (commands(), 0..400u16, prop::option::weighted(0.1, 0.0..1023.0f64),
             prop::option::weighted(0.1, 0.0..1023.0f64)), 1..40),
    ) {
        let mut rig = Rig::armed();
        for (command, periods, pressure, flex) in sequence {
            let _ = rig.ask(command);
            rig.plant.pressure_counts = pressure;
            rig.plant.flex_counts = flex;
            for _ in 0..periods {
                let before = rig.plant.inputs();
                let outputs = rig.tick();
                let settings = rig.app.settings.clone();
                let armed = !matches!(rig.app.state(), State::Idle | State::Fault);
                if !armed {
                    prop_assert_eq!((outputs.pump, outputs.valve), (Pump::Off, Valve::Open));
                }
                if let Pump::Rate(rate) = outputs.pump {
                    let per_step = settings.number(Key::VolumePerStep);
                    let flow = limit::size(rate) * per_step;
                    prop_assert!(flow <= settings.number(Key::MaxFlow) * 1.001);
                    let volume = before.steps as f32 * per_step;
                    if rig.app.state() == State::Running && rate > 0.0 {
                        prop_assert!(volume <= settings.number(Key::MaxVolume));
                    }
                }
                let most = |key| Hundredths::round(settings.number(key));
                match rig.log.last().unwrap().setpoint {
                    Setpoint::None => {}
                    Setpoint::Angle(angle) => {
                        prop_assert!(angle.0 >= 0 && angle <= most(Key::SetpointMax));
                    }
                    Setpoint::Pressure(pressure) => {
                        prop_assert!(pressure.0 >= 0 && pressure <= most(Key::SetpointMaxPressure));
                    }
                }
                let highest = settings.number(Key::SetpointMaxPressure) * 1_000.0;
                if let Activity::Playing(play) = &rig.app.activity {
                    let setpoint = play.controller().pressure_setpoint();
                    prop_assert!(setpoint <= highest * 1.000_01);
                }
            }
        }
    }
}

/// Bytes that could arrive: noise, and valid lines with a few bytes changed.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let mutated = (
        commands(),
        any::<u8>(),
        prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    )
        .prop_filter_map("the same request", |(command, id, changes)| {
            let mut line = Text::default();
            let request = Request { id, command };
            request.write(&mut line).unwrap();
            let mut bytes = line.0.into_bytes();
            for (place, byte) in changes {
                let place = place.index(bytes.len());
                bytes[place] = if bytes[place] == byte { byte ^ 1 } else { byte };
            }
            // A checksum in capitals is the same checksum.
            let end = bytes
                .iter()
                .position(|&byte| byte == b'\r' || byte == b'\n');
            let line = &bytes[..end.unwrap_or(bytes.len())];
            (Request::parse(line) != Ok(request)).then_some(bytes)
        });
    prop_oneof![
        prop::collection::vec(any::<u8>(), 0..120),
        "[ -~]{0,90}\n".prop_map(String::into_bytes),
        mutated,
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10_000))]
    /// A million strings in all.
    #[test]
    fn noise_on_the_cable_moves_nothing(strings in prop::collection::vec(noise(), 100)) {
        use wire::assemble::{Assembled, Assembler};
        let mut rig = Rig::new();
        let mut assembler = Assembler::<{ wire::command::MAX_LINE }>::new();
        for string in &strings {
            for &byte in string {
                match assembler.push(byte) {
                    Assembled::Pending => {}
                    Assembled::Overlong => rig.app.overlong(),
                    Assembled::Line(line) => {
                        let mut out = Text::default();
                        rig.app.receive(line, &rig.eeprom, &rig.past, &mut out).unwrap();
                    }
                }
            }
        }
        let outputs = rig.tick();
        prop_assert_eq!(rig.app.state(), State::Idle);
        prop_assert_eq!((outputs.pump, outputs.valve), (Pump::Off, Valve::Open));
        prop_assert_eq!(rig.app.settings(), &Settings::DEFAULT);
    }
}
