// SPDX-License-Identifier: GPL-3.0-or-later
//! The model on the board, beside the actuator.

use model_core::{
    actuator::Model,
    catalogue::{Effect, Kind},
    dynamics::Dynamics,
    effects::table::{Table, Variable},
    power::Minimax,
    predictor::Predictor,
};
use virtual_rig::Options;
use wire::{
    answer::Exact,
    command::Command,
    protocol::Named,
    settings::{Key, Settings, effect_id},
};

use crate::bench::{Bench, actuator, healthy};

const FARTHEST_RAD: f32 = 2.3;

fn shipped(effects: &[Effect<f32>]) -> Model<f32, Minimax> {
    let number = |key| Settings::DEFAULT.number(key);
    let dynamics = Dynamics {
        inertia: number(Key::Inertia),
        damping: number(Key::Damping),
        stiffness: number(Key::Stiffness),
        exponent: number(Key::Exponent),
        input_gain: number(Key::InputGain),
    };
    Model::new(dynamics, effects).expect("a valid model")
}

/// Uploads an effect into the first slot.
fn upload(bench: &mut Bench, kind: Kind, values: &[f32]) {
    bench.obey(Command::Set {
        key: Key::EffectKind { slot: 0 },
        bits: u32::from(effect_id(kind.name())),
    });
    for (index, value) in (0..).zip(values) {
        bench.set(Key::EffectParameter { slot: 0, index }, *value);
    }
    bench.save();
}

/// Repeats the board's prediction from the log, and compares the bits of its
/// state at the end.
fn repeats_to_the_bit(bench: &mut Bench, model: &Model<f32, Minimax>) {
    bench.arm();
    bench.obey(Command::Run(Some(Named::Reversals)));
    bench.run(9.0);
    let exact = bench.obey(Command::Exact);
    bench.run(0.1);
    let exact = Exact::parse(&exact).expect("the prediction to the bit");
    let newest = exact.sequence;
    let steps = u16::try_from(exact.steps).expect("a run of less than ten minutes");
    let bits = [exact.angle, exact.rate, exact.pressure].map(f32::to_bits);

    let at = |sequence: u16| {
        bench
            .samples
            .iter()
            .rposition(|sample| sample.sequence == sequence)
            .expect("no line was lost")
    };
    let (first, last) = (at(newest.wrapping_sub(steps)), at(newest));
    let start = bench.samples[first];
    let predictor = Predictor::new(model, FARTHEST_RAD).expect("a model that can be stepped");
    let mut prediction = predictor.start(
        start.angle_deg.expect("an angle").0,
        start.pressure_kpa.expect("a pressure").0,
    );
    for sample in &bench.samples[first + 1..=last] {
        predictor.step(
            &mut prediction,
            sample.pressure_kpa.map(|pressure| pressure.0),
        );
    }
    let desktop = [
        prediction.angle(),
        predictor.rate(&prediction),
        prediction.pressure(),
    ];
    assert_eq!(
        bits,
        desktop.map(f32::to_bits),
        "{exact:?}; the desktop has {desktop:?}"
    );
    assert!(steps > 500, "{steps} steps prove little");
}

#[test]
fn the_plain_model_is_repeated_to_the_bit() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    repeats_to_the_bit(&mut bench, &shipped(&[]));
}

#[test]
fn a_model_with_memory_is_repeated_to_the_bit() {
    for (kind, values) in [
        (Kind::MaxwellBranch, &[1.0_f32, 4.0, 0.387][..]),
        (Kind::DeadTime, &[0.12]),
        (Kind::CoulombFriction, &[0.4, 0.02]),
        (Kind::BoucWenHysteresis, &[0.3, 0.05, 0.4]),
        (Kind::SecondMode, &[3.0, 0.1, 0.2]),
        (Kind::SensorLag, &[0.08]),
    ] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        upload(&mut bench, kind, values);
        let effect = kind.build(values).expect("an effect");
        repeats_to_the_bit(&mut bench, &shipped(&[effect]));
    }
}

/// The numbers of a table have settings of their own.
fn upload_table(bench: &mut Bench, table: &Table<f32>) {
    let of = Variable::ALL.iter().position(|&of| of == table.of());
    #[allow(clippy::cast_precision_loss)] // A few.
    let head = [of.expect("in the list") as f32, table.nodes().len() as f32];
    for (index, (node, force)) in (0..).zip(table.nodes().iter().zip(table.forces())) {
        bench.set(Key::TableNode(index), *node);
        bench.set(Key::TableForce(index), *force);
    }
    upload(bench, Kind::Table, &head);
}

#[test]
fn tables_of_everything_are_repeated_to_the_bit() {
    let sixteen: [f32; 16] = std::array::from_fn(|k| 0.1 * (k as f32 - 2.0));
    let wave = sixteen.map(|angle| 0.4 * (3.0 * angle).sin());
    for (of, nodes, forces) in [
        (Variable::Angle, &sixteen[..], &wave[..]),
        (
            Variable::Rate,
            &[-2.0, -0.5, -0.02, 0.02, 0.5, 2.0],
            &[-0.2, -0.15, -0.1, 0.1, 0.15, 0.2],
        ),
        (Variable::Pressure, &[0.0, 2e4, 9e4], &[0.0, 0.3, -0.2]),
        (Variable::Time, &[0.5, 8.0], &[0.5, -0.5]),
    ] {
        let Some(mut bench) = Bench::start(healthy()) else {
            return;
        };
        let table = Table::new(of, nodes, forces).expect("a table");
        upload_table(&mut bench, &table);
        repeats_to_the_bit(&mut bench, &shipped(&[Effect::Table(table)]));
    }
}

/// Saved and read back after a reset, with the plain effects around it.
#[test]
fn a_table_survives_a_reset() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    let table = Table::new(Variable::Angle, &[0.1, 0.7, 1.1], &[0.0, 0.2, -0.1]).expect("a table");
    upload_table(&mut bench, &table);
    let mut options = healthy();
    options.eeprom = Some(bench.rig.eeprom());
    let Some(mut bench) = Bench::start(options) else {
        return;
    };
    assert_eq!(bench.fault(), None);
    repeats_to_the_bit(&mut bench, &shipped(&[Effect::Table(table)]));
}

/// Friction that the model does not know raises the flag, and the repaired model
/// lowers it.
#[test]
fn the_mismatch_flag_rises_and_an_upload_lowers_it() {
    let friction = Kind::CoulombFriction;
    let values = [2.5_f32, 0.05];
    let hidden = friction.build(&values.map(f64::from)).expect("an effect");
    let rig = || Options::with_actuator(actuator(&[hidden]));
    let Some(mut bench) = Bench::start(rig()) else {
        return;
    };
    bench.arm();
    bench.obey(Command::Run(Some(Named::Steps)));
    bench.run(30.0);
    assert!(bench.samples.iter().any(|sample| sample.mismatch));
    assert!(bench.now().mismatch, "the flag is latched");
    assert_eq!(bench.fault(), None, "a wrong model is no danger");

    let Some(mut bench) = Bench::start(rig()) else {
        return;
    };
    upload(&mut bench, friction, &values);
    bench.arm();
    bench.obey(Command::Run(Some(Named::Steps)));
    bench.run(30.0);
    assert!(bench.samples.iter().all(|sample| !sample.mismatch));
}
