// SPDX-License-Identifier: GPL-3.0-or-later
//! Everything that can break, broken while a protocol runs.

use std::cell::Cell;

use model_core::{actuator::Model, dynamics::Dynamics};
use virtual_rig::{Defect, Fault as Broken, Options, Planned, ResetCause, Size};
use wire::{
    command::Command,
    decimal::Hundredths,
    fault::Fault,
    protocol::{ControlMode, Named, Segment},
    reply::Refusal,
    settings::{Key, Settings},
    state::State,
};

use crate::bench::{Bench, healthy};

/// A rig a second into the first step to 60°.
fn running() -> Option<Bench> {
    let mut bench = Bench::start(healthy())?;
    bench.arm();
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.run(1.0);
    assert_eq!((bench.state(), bench.fault()), (State::Running, None));
    Some(bench)
}

/// The highest true pressure (kPa) until a fault.
#[track_caller]
fn highest_until_a_fault(bench: &mut Bench, within_s: f64) -> f64 {
    let highest_kpa = Cell::new(0.0_f64);
    bench.until(within_s, "a fault", |bench| {
        // The valve opens with the fault.
        let kpa = bench.rig.plant().pressure_kpa;
        highest_kpa.set(highest_kpa.get().max(kpa));
        bench.fault().is_some()
    });
    highest_kpa.get()
}

/// Breaks something, expects the fault, mends it and clears.
fn breaks(broken: Broken, fault: Fault, within_s: f64) {
    let Some(mut bench) = running() else {
        return;
    };
    bench.rig.set_fault(broken, true);
    bench.expect_fault(fault, within_s);
    bench.rig.set_fault(broken, false);
    bench.run(0.3);
    assert_eq!(bench.fault(), Some(fault), "mending does not clear");
    bench.obey(Command::Clear);
    bench.run(0.1);
    assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
    bench.arm();
}

/// As [`breaks`], for what can be seen while it lasts.
fn holds_while_it_lasts(broken: Broken, fault: Fault) {
    let Some(mut bench) = running() else {
        return;
    };
    bench.rig.set_fault(broken, true);
    bench.expect_fault(fault, 0.5);
    assert_eq!(bench.ask(Command::Clear), Err(Refusal::StillThere));
    assert!(bench.is_safe());
}

#[test]
fn a_broken_wire_of_the_flex_sensor() {
    breaks(Broken::OpenFlex, Fault::FlexSensor, 0.3);
    holds_while_it_lasts(Broken::OpenFlex, Fault::FlexSensor);
}

#[test]
fn a_shorted_flex_sensor() {
    breaks(Broken::ShortFlex, Fault::FlexSensor, 0.3);
}

#[test]
fn a_flex_sensor_that_is_stuck() {
    breaks(Broken::StuckFlex, Fault::FlexSensor, 6.0);
}

#[test]
fn a_broken_wire_of_the_pressure_sensor() {
    breaks(Broken::OpenPressure, Fault::PressureSensor, 0.3);
    holds_while_it_lasts(Broken::OpenPressure, Fault::PressureSensor);
}

#[test]
fn a_shorted_pressure_sensor() {
    breaks(Broken::ShortPressure, Fault::PressureSensor, 0.3);
}

/// A pressure that does not move with the pump is stuck or the pump is: either
/// name is true, and either way the rig stops.
#[test]
fn a_pressure_sensor_that_is_stuck() {
    let Some(mut bench) = running() else {
        return;
    };
    bench.rig.set_fault(Broken::StuckPressure, true);
    bench.until(10.0, "a fault", |bench| bench.now().fault != 0);
    let fault = bench.fault();
    assert!(
        matches!(fault, Some(Fault::PressureSensor | Fault::Stall)),
        "{fault:?}"
    );
    bench.run(0.05);
    assert!(bench.is_safe());
}

/// `max.ul` beyond the syringe's volume is refused, so that the watch never waits for a stroke that
/// the syringe does not have.
#[test]
fn a_pressure_sensor_that_is_stuck_at_zero_and_a_volume_that_is_set_too_large() {
    for largest_ul in [100_000.0_f32, 500_000.0] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        let (key, bits) = (Key::MaxVolume, largest_ul.to_bits());
        if bench.ask(Command::Set { key, bits }).is_err() {
            continue;
        }
        assert_eq!(bench.ask(Command::Save), Err(Refusal::BeyondStroke));
        bench.obey(Command::Discard);
        bench.load(ControlMode::Pressure, 100.0);
        bench.rig.set_fault(Broken::StuckPressure, true);
        bench.obey(Command::Run(None));
        let highest_kpa = highest_until_a_fault(&mut bench, 20.0);
        assert!(highest_kpa < 20.0, "{largest_ul} ul: {highest_kpa} kPa");
        assert_eq!(bench.fault(), Some(Fault::Stall));
    }
}

#[test]
fn a_stalled_motor() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.arm();
    bench.rig.set_fault(Broken::Stall, true);
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.expect_fault(Fault::Stall, 6.0);
}

#[test]
fn a_motor_that_never_reaches_its_switch() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.rig.set_fault(Broken::Stall, true);
    bench.obey(Command::Arm);
    bench.expect_fault(Fault::Stall, 60.0);
}

/// Edges while the plunger stood at a stop, until homing gave up.
fn homes_in_vain(broken: Broken, fault: Fault) -> u64 {
    let Some(mut bench) = Bench::start(healthy()) else {
        return 0;
    };
    bench.rig.set_fault(broken, true);
    bench.obey(Command::Arm);
    bench.expect_fault(fault, 60.0);
    bench.rig.plant().steps.lost
}

#[test]
fn a_retracted_switch_that_is_stuck() {
    assert_eq!(
        homes_in_vain(Broken::RetractedSwitch, Fault::RetractedSwitch),
        0
    );
}

/// A wire beside a motor's catches a spike: the plunger is homed where it would be without.
#[test]
fn a_spike_on_the_retracted_switch_while_homing() {
    for after_s in [0.05, 0.6, 1.5] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        bench.arm();
        let home_mm = bench.rig.plant().plunger_mm;
        bench.obey(Command::Run(Some(Named::Paper)));
        bench.run(4.0);
        bench.obey(Command::Stop);
        bench.run(4.0);
        let from_s = bench.rig.time_s() + after_s;
        bench.rig.plan_fault(Planned {
            defect: Broken::RetractedSwitch.into(),
            from_s,
            until_s: Some(from_s + 0.003),
        });
        bench.arm();
        let away_mm = bench.rig.plant().plunger_mm - home_mm;
        assert!(away_mm.abs() < 0.05, "{after_s} s: {away_mm} mm");
    }
}

#[test]
fn a_motor_that_has_lost_a_coil() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.rig.set_fault(Broken::LostCoil, true);
    bench.obey(Command::Arm);
    // As if it had no supply: it trembles, and no switch comes.
    bench.expect_fault(Fault::Stall, 30.0);
    bench.rig.set_fault(Broken::LostCoil, false);
    bench.obey(Command::Clear);
    bench.arm();
    bench.rig.set_fault(Broken::LostCoil, true);
    bench.obey(Command::Run(Some(Named::Paper)));
    bench.expect_fault(Fault::Stall, 3.0);
}

#[test]
fn a_motor_that_turns_the_other_way() {
    // Found at the switch, which stands before the stop.
    assert_eq!(
        homes_in_vain(Broken::ReversedMotor, Fault::MotorReversed),
        0
    );
}

/// A rig in a run, whose vent will not open; stopped in some way.
fn stopped_with_a_vent_that_is_shut(stop: impl Fn(&mut Bench)) -> Option<Bench> {
    let mut bench = running()?;
    bench.run(3.0);
    bench.rig.set_fault(Broken::VentShut, true);
    stop(&mut bench);
    bench.run(5.0);
    assert!(bench.rig.plant().pressure_kpa > 20.0);
    Some(bench)
}

/// The air of a run that was stopped stays: that is a fault although the rig is idle, which
/// cannot be cleared while it lasts.
#[test]
fn a_vent_that_does_not_open() {
    let stop = |bench: &mut Bench| {
        bench.obey(Command::Stop);
    };
    let Some(mut bench) = stopped_with_a_vent_that_is_shut(stop) else {
        return;
    };
    assert_eq!(
        (bench.state(), bench.fault()),
        (State::Fault, Some(Fault::Vent))
    );
    assert!(
        bench
            .remarks
            .iter()
            .any(|said| said == Fault::Vent.sentence())
    );
    assert_eq!(bench.ask(Command::Clear), Err(Refusal::StillThere));
    assert_eq!(bench.ask(Command::Arm), Err(Refusal::Faulted));
    bench.rig.set_fault(Broken::VentShut, false);
    bench.run(1.0);
    bench.obey(Command::Clear);
    bench.arm();
}

/// What had stopped the rig stays on the display; that there is pressure is said too.
#[test]
fn a_vent_that_does_not_open_after_another_fault() {
    let presses = |bench: &mut Bench| {
        bench.rig.set_fault(Broken::EmergencyStop, true);
        bench.run(0.1);
        bench.rig.set_fault(Broken::EmergencyStop, false);
    };
    let pulls = |bench: &mut Bench| bench.beating = false;
    for (stop, fault) in [
        (&presses as &dyn Fn(&mut Bench), Fault::EmergencyStop),
        (&pulls, Fault::HostLost),
    ] {
        let Some(mut bench) = stopped_with_a_vent_that_is_shut(stop) else {
            return;
        };
        bench.run(2.0);
        assert_eq!(bench.fault(), Some(fault));
        assert!(
            bench
                .remarks
                .iter()
                .any(|said| said == Fault::Vent.sentence())
        );
        bench.beating = true;
        assert_eq!(bench.ask(Command::Clear), Err(Refusal::StillThere));
        bench.rig.set_fault(Broken::VentShut, false);
        bench.run(1.0);
        bench.obey(Command::Clear);
        bench.arm();
    }
}

/// Without pressure at first, nothing shows before the plunger goes back and sucks.
#[test]
fn a_vent_that_is_shut_while_homing() {
    let Some(mut bench) = running() else {
        return;
    };
    bench.run(3.0);
    bench.obey(Command::Stop);
    bench.run(4.0);
    bench.rig.set_fault(Broken::VentShut, true);
    bench.obey(Command::Arm);
    bench.until(10.0, "the fault", |bench| {
        bench.fault() == Some(Fault::Vent)
    });
    bench.run(0.05);
    assert!(!bench.rig.plant().driver_enabled);
    assert!(
        bench.rig.plant().pressure_kpa > -15.0,
        "{:?}",
        bench.rig.plant()
    );
}

/// A rig that holds a pressure (kPa) for long.
fn holding(level: f32, limits: &[(Key, f32)]) -> Option<Bench> {
    let mut bench = Bench::start(healthy())?;
    for &(key, value) in limits {
        bench.set(key, value);
    }
    bench.save();
    bench.load(ControlMode::Pressure, level);
    bench.obey(Command::Run(None));
    bench.run(6.0);
    let shown = bench.now().pressure_kpa.expect("a pressure").to_f32();
    assert!((shown - level).abs() < 1.0, "{shown}");
    Some(bench)
}

/// The pump makes up for a leak until too much of the air seems lost. With V the air and τ = 3 s
/// the leak's time constant, holding 20 kPa takes V p/(p₀ τ), some 3 ml/s.
#[test]
fn a_burst_tube() {
    let Some(mut bench) = holding(20.0, &[]) else {
        return;
    };
    bench.rig.set_fault(Broken::Leak, true);
    bench.expect_fault(Fault::GasLaw, 4.0);
    assert_eq!(bench.rig.plant().steps.lost, 0, "the plunger hit its stop");
}

#[test]
fn a_pressure_beyond_the_stroke() {
    let Some(mut bench) = holding(20.0, &[(Key::MaxVolume, 15_000.0)]) else {
        return;
    };
    bench.obey(Command::Stop);
    bench.run(3.0);
    bench.load(ControlMode::Pressure, 100.0);
    bench.obey(Command::Run(None));
    // 3 s for the stroke, 1 s at its end.
    bench.expect_fault(Fault::Reach, 6.0);
    assert_eq!(bench.rig.plant().steps.lost, 0);
}

/// A stuck reading shows at once, a slow drift does not: the pump follows it until too much of the
/// air seems lost. By then the true pressure is still one that may be asked for.
#[test]
fn a_pressure_sensor_that_drifts_down() {
    let Some(mut bench) = holding(100.0, &[]) else {
        return;
    };
    bench.rig.set_fault(Broken::DriftingPressure, true);
    let highest_kpa = highest_until_a_fault(&mut bench, 120.0);
    assert_eq!(bench.fault(), Some(Fault::GasLaw));
    let most_kpa = f64::from(Settings::DEFAULT.number(Key::SetpointMaxPressure));
    assert!(highest_kpa < most_kpa, "{highest_kpa} kPa");
    // Mended, it stays a fault until somebody has looked.
    bench.rig.set_fault(Broken::DriftingPressure, false);
    bench.run(1.0);
    bench.obey(Command::Clear);
    bench.arm();
}

/// Without a release, and with a set-point that goes to and fro, no compression is long enough
/// for the stall watch, and a stiff actuator shows no angle that would be too large. The plunger's
/// volume tells. A soft one may be bent too far before.
#[test]
fn a_pressure_sensor_that_drifts_while_the_set_point_moves() {
    let believed = *virtual_rig::default_actuator().dynamics();
    for (stiffer, kpa_per_s, begins_s) in [
        (4.0, 0.5, 5.0),
        (4.0, 1.0, 0.0),
        (4.0, 1.0, 15.0),
        (4.0, 4.0, 15.0),
        (0.25, 1.0, 0.0),
        (0.25, 4.0, 15.0),
    ] {
        let actuator = Model::new(
            Dynamics {
                stiffness: stiffer * believed.stiffness,
                ..believed
            },
            &[],
        )
        .expect("a stiffness is a model");
        let Some(mut bench) = Bench::start(Options::with_actuator(actuator)) else {
            return;
        };
        bench.obey(Command::Load(1));
        // A quarter as stiff, 90° need a quarter of the pressure.
        let centre = if stiffer < 1.0 { 2_000 } else { 10_000 };
        let segment = Segment::Multisine {
            mode: ControlMode::Pressure,
            centre: Hundredths(centre),
            amplitude: Hundredths(centre * 3 / 10),
            period_ms: 4_000,
            duration_ms: 400_000,
        };
        bench.obey(Command::Segment { index: 0, segment });
        bench.arm();
        bench.obey(Command::Run(None));
        bench.run(begins_s);
        assert_eq!(bench.fault(), None);
        let drifts = Defect {
            fault: Broken::DriftingPressure,
            size: Size::Drift(-kpa_per_s),
        };
        bench.rig.set_fault(drifts, true);
        let highest_kpa = highest_until_a_fault(&mut bench, 400.0);
        let fault = bench.fault();
        println!(
            "{stiffer} times as stiff, {kpa_per_s} kPa/s from {begins_s} s: {fault:?}, {highest_kpa:.0} kPa"
        );
        assert!(highest_kpa < 200.0, "{highest_kpa} kPa");
        let is_soft = stiffer < 1.0;
        assert!(
            fault == Some(Fault::GasLaw) || is_soft && fault == Some(Fault::OverAngle),
            "{fault:?}"
        );
    }
}

/// In closed loop a sensor that shows nothing asks for more and more.
#[test]
fn a_flex_sensor_that_has_come_off() {
    for level in [40.0, 60.0, 90.0] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        bench.rig.set_fault(Broken::DetachedFlex, true);
        bench.load(ControlMode::AngleClosedLoop, level);
        bench.obey(Command::Run(None));
        bench.until(10.0, "a fault", |bench| bench.fault().is_some());
        assert_eq!(bench.fault(), Some(Fault::Disagreement));
        let truth = bench.rig.plant();
        assert!(truth.angle_deg < level.into(), "{truth:?}");
        bench.run(0.1);
        assert!(bench.is_safe());
    }
}

#[test]
fn the_emergency_stop() {
    breaks(Broken::EmergencyStop, Fault::EmergencyStop, 0.05);
    holds_while_it_lasts(Broken::EmergencyStop, Fault::EmergencyStop);
    // Pressed in idle, the rig cannot be armed.
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.rig.set_fault(Broken::EmergencyStop, true);
    bench.expect_fault(Fault::EmergencyStop, 0.1);
}

#[test]
fn an_end_switch_in_motion() {
    breaks(Broken::EndSwitch, Fault::EndSwitch, 2.0);
}

/// A zero that is off lets the pressure rise as far above its limit: the rig is not armed.
#[test]
fn a_pressure_sensor_with_a_wrong_zero() {
    // −240 mV is −34 kPa, +50 mV is 7 kPa.
    for off_millivolts in [-240.0, -50.0, 50.0, 240.0] {
        let mut options = healthy();
        options.plant.pressure_sensor.offset_millivolts += off_millivolts;
        let Some(mut bench) = Bench::start(options) else {
            return;
        };
        bench.run(1.5);
        assert_eq!(
            bench.ask(Command::Arm),
            Err(Refusal::Pressurised),
            "{off_millivolts} mV"
        );
        assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
        // 7 kPa are more than a tare takes, and nothing else lets it pass.
        assert_eq!(bench.ask(Command::Tare), Err(Refusal::OutOfBounds));
        assert_eq!(bench.ask(Command::Arm), Err(Refusal::Pressurised));
    }
    // Nor is a zero accepted that no such sensor has.
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    for counts in [0.0_f32, 51.0, 154.0, 300.0] {
        let set = Command::Set {
            key: Key::PressureZero,
            bits: counts.to_bits(),
        };
        assert_eq!(bench.ask(set), Err(Refusal::OutOfBounds), "{counts}");
    }
    // Within those bounds it is seen before the rig is armed, and soon shown.
    bench.set(Key::PressureZero, 120.0);
    bench.save();
    bench.until(10.0, "the fault", |bench| bench.now().fault != 0);
    assert_eq!(bench.fault(), Some(Fault::Vent));
    assert_eq!(bench.ask(Command::Arm), Err(Refusal::Faulted));
}

/// Seconds for which the pump went on stepping after something broke.
fn steps_on(bench: &mut Bench, broken: Broken) -> f64 {
    const HERTZ: f64 = 16e6;
    bench.rig.trace_steps(true);
    bench.run(0.5);
    assert!(bench.rig.step_edges().len() > 100, "the pump moves");
    let begin = bench.rig.time_s();
    bench.rig.set_fault(broken, true);
    bench.run(0.2);
    let last = bench.rig.step_edges().last().copied();
    last.map_or(0.0, |cycle| cycle as f64 / HERTZ - begin)
}

/// The pulses need no main program: left alone, they would repeat its last rate until the
/// watchdog bites.
#[test]
fn a_main_program_that_hangs() {
    let Some(mut bench) = running() else {
        return;
    };
    let steps_on = steps_on(&mut bench, Broken::Hang);
    assert!(steps_on > 0.0 && steps_on <= 0.040, "{steps_on} s");
    // Then the watchdog opens the valve, and starts the board again.
    bench.rig.run_for(0.1).expect("the board runs");
    assert!(bench.is_safe(), "{:?}", bench.rig.plant());
    bench.samples.clear();
    bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
    assert_eq!(bench.fault(), Some(Fault::Watchdog));
    bench.obey(Command::Clear);
    bench.arm();
}

/// At rest the watchdog leaves the self-test its time.
#[test]
fn a_main_program_that_hangs_at_rest() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    let begin = bench.rig.time_s();
    bench.rig.set_fault(Broken::Hang, true);
    while bench.rig.resets() == 0 {
        bench.run(0.01);
        assert!(bench.rig.time_s() - begin < 1.0, "no watchdog");
    }
    let after = bench.rig.time_s() - begin;
    assert!((0.45..=0.6).contains(&after), "{after} s");
    bench.samples.clear();
    bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
    assert_eq!(bench.fault(), Some(Fault::Watchdog));
    bench.obey(Command::Clear);
    bench.arm();
}

#[test]
fn switches_stop_the_pump_before_the_control_loop_looks() {
    for broken in [Broken::EmergencyStop, Broken::EndSwitch] {
        let Some(mut bench) = running() else {
            return;
        };
        let steps_on = steps_on(&mut bench, broken);
        assert!(
            steps_on > 0.0 && steps_on <= 0.005,
            "{broken}: {steps_on} s"
        );
        assert!(bench.is_safe());
    }
}

#[test]
fn a_computer_that_falls_silent() {
    let Some(mut bench) = running() else {
        return;
    };
    bench.beating = false;
    bench.until(4.0, "a fault", |bench| bench.now().fault != 0);
    assert_eq!(bench.fault(), Some(Fault::HostLost));
    bench.run(0.05);
    assert!(bench.is_safe());
    // It came back: the fault waits to be cleared.
    bench.beating = true;
    bench.run(1.0);
    assert_eq!(bench.fault(), Some(Fault::HostLost));
    bench.obey(Command::Clear);
}

#[test]
fn silence_is_no_fault_while_nothing_can_move() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.beating = false;
    bench.run(6.0);
    assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
}

/// The sensor drifted, the pump followed, and then the sensor shows the truth again.
#[test]
fn too_much_pressure() {
    let limits = [(Key::SetpointMaxPressure, 29.0), (Key::MaxPressure, 30.0)];
    let Some(mut bench) = holding(28.0, &limits) else {
        return;
    };
    bench.rig.set_fault(Broken::DriftingPressure, true);
    bench.run(6.0);
    assert_eq!(bench.fault(), None);
    let truth = bench.rig.plant().pressure_kpa;
    assert!((30.5..32.0).contains(&truth), "{truth} kPa");
    bench.rig.set_fault(Broken::DriftingPressure, false);
    // Two readings in a row, and what the converter takes for them.
    bench.expect_fault(Fault::OverPressure, 0.05);
    bench.run(1.0);
    assert!(bench.rig.plant().pressure_kpa < 0.5);
}

#[test]
fn too_large_an_angle() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    // The model is wrong by a factor of two: 60° asked for become far more.
    bench.set(Key::InputGain, 0.5e-4);
    bench.set(Key::MaxAngle, 70.0);
    bench.set(Key::SetpointMax, 65.0);
    bench.save();
    bench.arm();
    bench.set(Key::SetpointMax, 65.0);
    let ran = bench.ask(Command::Run(Some(Named::Reversals)));
    assert!(ran.is_ok(), "{ran:?}");
    bench.expect_fault(Fault::OverAngle, 45.0);
}

/// With a bootloader that leaves the flags alone the cause is known, with Arduino's at least that
/// the rig was armed.
#[test]
fn resets_that_nobody_asked_for_are_told_apart() {
    for (keeps_reset_flags, cause, fault) in [
        (true, ResetCause::Watchdog, Some(Fault::Watchdog)),
        (true, ResetCause::BrownOut, Some(Fault::BrownOut)),
        (true, ResetCause::External, Some(Fault::Restart)),
        (true, ResetCause::PowerOn, None),
        (false, ResetCause::Watchdog, Some(Fault::Restart)),
        (false, ResetCause::BrownOut, Some(Fault::Restart)),
        (false, ResetCause::External, Some(Fault::Restart)),
        (false, ResetCause::PowerOn, None),
    ] {
        let Some(mut bench) = Bench::start(Options {
            keeps_reset_flags,
            ..healthy()
        }) else {
            return;
        };
        // At rest a reset is nothing to tell.
        if !keeps_reset_flags {
            bench.rig.reset(cause);
            bench.run(1.0);
            assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
        }
        bench.arm();
        bench.obey(Command::Run(Some(Named::Paper)));
        bench.run(1.0);
        bench.rig.reset(cause);
        bench.rig.run_for(0.001).expect("the board runs");
        assert!(bench.is_safe(), "{cause:?}: {:?}", bench.rig.plant());
        bench.samples.clear();
        bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
        assert_eq!(bench.fault(), fault, "{cause:?}");
        if fault.is_some() {
            bench.obey(Command::Clear);
        }
        bench.run(0.1);
        assert_eq!(bench.state(), State::Idle, "{cause:?}");
    }
}

#[test]
fn a_power_cut_in_motion_leaves_the_air_out() {
    let Some(mut bench) = running() else {
        return;
    };
    bench.rig.power_cut();
    bench.rig.run_for(1.0).expect("time passes");
    assert!(bench.rig.plant().pressure_kpa < 1.0);
    bench.rig.power_on();
    bench.samples.clear();
    bench.until(3.0, "a sample", |bench| !bench.samples.is_empty());
    assert_eq!((bench.state(), bench.fault()), (State::Idle, None));
}

/// With interrupts off nothing but the watchdog ends the pulses: the timer goes on to make an edge
/// each time that its counter turns.
#[test]
fn a_main_program_that_hangs_with_interrupts_off_stops_stepping_soon() {
    /// Twice 64 ms, of a clock that is as good as the simulator's.
    const WITHIN_S: f64 = 0.130;
    for delay_s in [0.0, 0.0037, 0.0071] {
        let Some(mut bench) = running() else {
            return;
        };
        bench.run(delay_s);
        bench.rig.trace_steps(true);
        bench.rig.step_edges();
        let resets = bench.rig.resets();
        let hung = bench.rig.cycle();
        bench.rig.set_fault(Broken::Deaf, true);
        bench.rig.run_for(1.0).expect("the board runs");
        let edges = bench.rig.step_edges();
        let last_s = edges.last().map_or(0.0, |&edge| {
            edge.saturating_sub(hung) as f64 / f64::from(virtual_rig::board::CLOCK_HZ)
        });
        println!("{} steps, the last after {last_s:.3} s", edges.len());
        assert!(last_s < WITHIN_S, "{last_s} s");
        assert_eq!(bench.rig.resets(), resets + 1);
        assert!(bench.is_safe());
        // The bootloader has cleared the processor's flags.
        bench.until(3.0, "restart", |bench| {
            bench.fault() == Some(Fault::Restart)
        });
    }
}

/// Not armed below 4.5 V, and armed when the supply is back.
#[test]
fn a_low_supply_arms_nothing() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    let supply = |bench: &mut Bench| {
        let machine = wire::answer::Machine::parse(&bench.obey(Command::Machine));
        f64::from(machine.unwrap().supply_mv.unwrap_or(0)) / 1000.0
    };
    for volts in [5.0, 4.6, 5.3] {
        bench.rig.set_supply(volts);
        bench.run(1.5);
        let measured = supply(&mut bench);
        println!("{volts} V: {measured}");
        assert!((measured / volts - 1.0).abs() < 0.005, "{measured}");
        // The sensors are ratiometric, as the converter is.
        assert!(bench.now().pressure_kpa.unwrap().to_f32().abs() < 0.5);
    }
    for broken in [false, true] {
        bench.rig.set_supply(if broken { 5.0 } else { 4.4 });
        bench.rig.set_fault(Broken::LowSupply, broken);
        bench.run(1.5);
        assert_eq!(bench.ask(Command::Arm), Err(Refusal::LowSupply));
        assert_eq!(bench.state(), State::Idle);
    }
    bench.rig.set_fault(Broken::LowSupply, false);
    bench.run(1.5);
    bench.arm();
}

/// The period in which the supply is measured has the sensors' readings of the one before.
#[test]
fn measuring_the_supply_costs_no_reading() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.run(0.5);
    let from = bench.samples.len();
    bench.run(5.0);
    let readings = bench.samples[from..].iter().map(|it| it.pressure_kpa);
    assert!(readings.clone().all(|it| it.is_some()));
    let spread = readings.flatten().map(Hundredths::to_f32);
    let most = spread.clone().fold(f32::NEG_INFINITY, f32::max);
    let least = spread.fold(f32::INFINITY, f32::min);
    assert!(most - least < 1.0, "{least} to {most} kPa");
}
