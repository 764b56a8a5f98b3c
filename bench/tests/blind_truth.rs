//! The simulator behind the blind benchmark: against closed forms, against
//! energy, against itself at other steps, and that it is nobody else's.

use model_core::catalogue::Kind;
use model_core::effects::Parameter;
use softrig_bench::blind::cases::{Plan, make, plan, stable_hash};
use softrig_bench::blind::experiments::{Experiment, Pump, Set};
use softrig_bench::blind::hidden::Hidden;
use softrig_bench::blind::law::{Effect, Law, kinds};
use softrig_bench::blind::sizes::typical_effect;
use softrig_bench::blind::world::{Base, Line, RATE_HZ, SAMPLES_HZ, World};

const STEPS: u32 = RATE_HZ / SAMPLES_HZ;

const LINEAR: Base = Base {
    inertia: 0.3,
    damping: 0.9,
    stiffness: 6.0,
    exponent: 1.0,
    input_gain: 1e-4,
};

const SOFT: Base = Base {
    inertia: 0.25,
    damping: 1.5,
    stiffness: 5.0,
    exponent: 2.0,
    input_gain: 1.2e-4,
};

const PUMP: Pump = Pump {
    lag: 0.08,
    fastest: 300e3,
};

fn truth(base: Base, effects: &[(Law, [f64; 4])]) -> World {
    World {
        base,
        effects: effects
            .iter()
            .map(|&(law, values)| Effect { law, values })
            .collect(),
    }
}

/// Constant pressure (Pa) for so many seconds.
fn constant(pressure: f64, seconds: f64) -> Line {
    Line::new(seconds, vec![pressure; 2])
}

/// Largest difference of two series (°).
fn apart(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs().to_degrees())
        .fold(0.0, f64::max)
}

fn last(series: &[f64]) -> f64 {
    series[series.len() - 1]
}

#[test]
fn a_linear_actuator_rings_as_the_textbook_says() {
    let reading = truth(LINEAR, &[]).simulate(&constant(50e3, 5.0), 0, STEPS);
    let decay = LINEAR.damping / (2.0 * LINEAR.inertia);
    let ringing = (LINEAR.stiffness / LINEAR.inertia - decay * decay).sqrt();
    let end = LINEAR.input_gain * 50e3 / LINEAR.stiffness;
    let exact: Vec<f64> = (0..reading.len())
        .map(|k| {
            let t = k as f64 * 0.01;
            let swing = (ringing * t).cos() + decay / ringing * (ringing * t).sin();
            end * (1.0 - (-decay * t).exp() * swing)
        })
        .collect();
    assert!(apart(&reading, &exact) < 1e-6);
}

#[test]
fn at_rest_forces_balance() {
    // Weight on top of the elastic law.
    let (force, tilt) = (1.5, 0.4f64);
    let gravity = truth(SOFT, &[(Law::Gravity, [force, tilt, 0.0, 0.0])]);
    let angle = last(&gravity.simulate(&constant(60e3, 20.0), 0, STEPS));
    let left = SOFT.input_gain * 60e3
        - SOFT.stiffness * angle.powi(2)
        - force * ((angle + tilt).sin() - tilt.sin());
    assert!(left.abs() < 1e-6, "{left} N");

    // A Maxwell branch lets go in the end, a spring does not.
    let creep = truth(LINEAR, &[(Law::MaxwellOne, [2.0, 0.5, 0.0, 0.0])]);
    let angle = last(&creep.simulate(&constant(50e3, 20.0), 0, STEPS));
    assert!((angle - 5.0 / 6.0).abs() < 1e-6);
    let spring = truth(LINEAR, &[(Law::LinearStiffness, [2.0, 0.0, 0.0, 0.0])]);
    let angle = last(&spring.simulate(&constant(50e3, 20.0), 0, STEPS));
    assert!((angle - 5.0 / 8.0).abs() < 1e-6);
}

#[test]
fn creep_has_the_time_constant_of_a_standard_solid() {
    // With little inertia and damping: θ = F/K [1 − k/(K + k) e^{−t/τ'}],
    // τ' = τ (K + k)/K.
    let light = Base {
        inertia: 1e-3,
        damping: 0.05,
        ..LINEAR
    };
    let (k, tau) = (3.0, 2.0);
    let creep = truth(light, &[(Law::MaxwellOne, [k, tau, 0.0, 0.0])]);
    let reading = creep.simulate(&constant(60e3, 8.0), 0, STEPS);
    let slow = tau * (6.0 + k) / 6.0;
    for sample in [100, 300, 700] {
        let t = f64::from(sample) * 0.01;
        let exact = 1.0 - k / (6.0 + k) * (-t / slow).exp();
        let found = reading[usize::try_from(sample).unwrap()];
        assert!((found - exact).abs() < 4e-3, "{t} s: {found}, {exact}");
    }
}

#[test]
fn what_delays_delays_by_what_it_says() {
    // A slow ramp of the pressure, long after its start: everything is late by
    // its own delay, whatever its formula.
    let ramp = Line::new(0.5, (0..=40).map(|k| 2e3 * f64::from(k)).collect());
    let plain = truth(LINEAR, &[]).simulate(&ramp, 0, STEPS);
    let slope = (plain[1900] - plain[1800]) / 1.0;
    for (formula, second) in [
        (Law::Lag, 0.0),
        (Law::LagSecondOrder, 0.9),
        (Law::LagDistributed, 0.0),
        (Law::DeadTime, 0.0),
        (Law::DeadTimeDispersed, 0.0),
        (Law::SensorLag, 0.0),
        (Law::SensorLagSecondOrder, 0.9),
    ] {
        let late = truth(LINEAR, &[(formula, [0.25, second, 0.0, 0.0])]);
        let reading = late.simulate(&ramp, 0, STEPS);
        let delay = (plain[1800] - reading[1800]) / slope;
        assert!((delay - 0.25).abs() < 2e-3, "{formula:?}: {delay} s");
    }
}

#[test]
fn a_leaking_chamber_empties_behind_its_sensor() {
    // θ follows g p e^{−t/τ}/K where it is slow against the actuator.
    let leak = truth(LINEAR, &[(Law::Leak, [8.0, 0.0, 0.0, 0.0])]);
    let mut pressure = vec![0.0, 0.0];
    pressure.extend(vec![60e3; 30]);
    let reading = leak.simulate(&Line::new(0.5, pressure), 0, STEPS);
    let ratio = reading[1400] / reading[900];
    assert!((ratio - (-5.0f64 / 8.0).exp()).abs() < 2e-3, "{ratio}");
}

#[test]
fn sensors_show_functions_of_the_angle() {
    let line = PUMP.drive(&Experiment::Triangle(1.0), &SOFT);
    let angle = truth(SOFT, &[]).simulate(&line, 0, STEPS);
    let of = |formula, values: [f64; 4], exact: &dyn Fn(f64, f64) -> f64| {
        let reading = truth(SOFT, &[(formula, values)]).simulate(&line, 0, STEPS);
        let exact: Vec<f64> = angle
            .iter()
            .enumerate()
            .map(|(k, angle)| exact(*angle, k as f64 * 0.01))
            .collect();
        assert!(apart(&reading, &exact) < 1e-9, "{formula:?}");
    };
    of(Law::SensorOffset, [0.1, 0.0, 0.0, 0.0], &|x, _| x + 0.1);
    of(Law::SensorNonlinearity, [0.1, 0.0, 0.0, 0.0], &|x, _| {
        x + 0.1 * x * x
    });
    of(Law::SensorDrift, [0.01, 0.0, 0.0, 0.0], &|x, t| {
        x + 0.01 * t
    });
    of(Law::SensorDeadZone, [0.1, 0.6, 0.0, 0.0], &|x, _| {
        if x < 0.5 {
            x
        } else if x > 0.7 {
            x - 0.2
        } else {
            0.5
        }
    });
}

#[test]
fn hysteresis_does_not_ask_how_fast() {
    // The loop of force over angle, from quasi-static triangles at two speeds,
    // for the actuator's inverse: the same pressure at the same angle.
    let stops = truth(SOFT, &[(Law::HysteresisStops, [1.5, 0.3, 0.0, 0.0])]);
    let width = |ramp: f64| {
        let line = PUMP.drive(&Experiment::Triangle(ramp), &SOFT);
        let reading = stops.simulate(&line, 0, STEPS);
        // Angle at the same pressure, half-way up and half-way down.
        let at = |t: f64| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let sample = ((0.6 + t) * 100.0).round() as usize;
            reading[sample]
        };
        at(1.6 * ramp) - at(0.4 * ramp)
    };
    let (slow, slower) = (width(30.0), width(60.0));
    assert!(slow > 0.05, "there is no loop: {slow}");
    assert!((slow / slower - 1.0).abs() < 0.05, "{slow} {slower}");
}

#[test]
fn friction_and_damping_only_take_energy() {
    let line = PUMP.drive(&Experiment::Multisine([0.3; 8]), &SOFT);
    for formula in Law::of_every_set().filter(|formula| {
        matches!(
            formula.row().kind,
            Some("coulomb_friction" | "stribeck_friction" | "quadratic_damping")
        ) || matches!(
            formula,
            Law::BoucWen | Law::HysteresisDahl | Law::HysteresisStops
        )
    }) {
        let effect = typical_effect(formula, &SOFT, 1);
        let truth = World {
            base: SOFT,
            effects: vec![effect],
        };
        let angle = truth.simulate(&line, 0, STEPS);
        let rate = |k: usize| (angle[k + 1] - angle[k - 1]) / 0.02;
        let (mut work, mut lost) = (0.0, 0.0);
        let mut least = f64::INFINITY;
        for (k, &here) in angle.iter().enumerate().take(angle.len() - 1).skip(1) {
            work += SOFT.input_gain * line.at(k as f64 * 0.01) * rate(k) * 0.01;
            lost += SOFT.damping * rate(k).powi(2) * 0.01;
            let stored = 0.5 * SOFT.inertia * rate(k).powi(2) + SOFT.stiffness * here.powi(3) / 3.0;
            least = least.min(work - lost - stored);
        }
        assert!(least > -0.02 * work, "{formula:?} gives {least} of {work}");
        let rate = rate(angle.len() - 2);
        let stored = 0.5 * SOFT.inertia * rate * rate + SOFT.stiffness * last(&angle).powi(3) / 3.0;
        let taken = work - lost - stored;
        assert!(taken > 0.02 * work, "{formula:?} takes {taken} of {work}");
    }
}

#[test]
fn other_formulas_are_the_same_phenomenon() {
    // A bristle that hardly yields is Coulomb friction; a fine dispersion is a
    // delay; a sharp corner is a threshold.
    let line = PUMP.drive(&Experiment::Triangle(1.0), &SOFT);
    let pressure = 30e3;
    for ((formula, values), (other, values_of_other)) in [
        (
            (Law::CoulombTanh, [0.8, 0.01, 0.0, 0.0]),
            (Law::CoulombLugre, [0.8, 0.003, 0.0, 0.0]),
        ),
        (
            (Law::DeadTime, [0.2, 0.0, 0.0, 0.0]),
            (Law::DeadTimeDispersed, [0.2, 0.0, 0.0, 0.0]),
        ),
        (
            (Law::Threshold, [pressure, 0.0, 0.0, 0.0]),
            (Law::ThresholdSmooth, [pressure, 500.0, 0.0, 0.0]),
        ),
        (
            (Law::Backlash, [4e3, 0.0, 0.0, 0.0]),
            (Law::BacklashPlays, [4e3, 0.0, 0.0, 0.0]),
        ),
    ] {
        let none = truth(SOFT, &[]).simulate(&line, 0, STEPS);
        let one = truth(SOFT, &[(formula, values)]).simulate(&line, 0, STEPS);
        let two = truth(SOFT, &[(other, values_of_other)]).simulate(&line, 0, STEPS);
        let (differ, matter) = (apart(&one, &two), apart(&one, &none));
        assert!(matter > 1.0, "{formula:?} does nothing: {matter}°");
        assert!(differ < 0.4 * matter, "{other:?}: {differ}° of {matter}°");
    }
}

#[test]
fn every_formula_is_resolved_by_the_step() {
    let line = PUMP.drive(&Experiment::Step(1.7), &SOFT);
    let none = truth(SOFT, &[]).simulate(&line, 1, STEPS);
    for formula in Law::of_every_set() {
        let truth = World {
            base: SOFT,
            effects: vec![typical_effect(formula, &SOFT, 2)],
        };
        let coarse = truth.simulate(&line, 1, STEPS);
        let fine = truth.simulate(&line, 1, 4 * STEPS);
        let off = apart(&coarse, &fine);
        assert!(off < 0.02, "{formula:?}: {off}°");
        assert!(apart(&coarse, &none) > 0.1, "{formula:?} does nothing");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let plan = Plan {
        set: Set::Paper,
        hidden: Hidden::One,
        laws: vec![Law::Lag],
        replicate: 3,
    };
    let bytes = |seed| {
        let made = make(&plan, "case", seed);
        let mut text = serde_json::to_string(&made.answer).unwrap();
        for (planned, recording) in &made.runs {
            text += &planned.name();
            text += &softrig_formats::recording::to_csv(recording, &[]);
        }
        (
            stable_hash(text.as_bytes()),
            made.answer.secret.misfit_over_noise,
        )
    };
    let (first, ratio) = bytes(11);
    assert_eq!(first, bytes(11).0);
    assert_ne!(first, bytes(12).0);
    assert!((1.5..=8.0).contains(&ratio), "{ratio}");

    // What is handed over tells nothing of what is hidden.
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("blind_case");
    make(&plan, "paper_007", 11).write(&folder).unwrap();
    let model = std::fs::read_to_string(folder.join("model.toml")).unwrap();
    softrig_formats::model_file::ModelFile::parse(&model, &folder).unwrap();
    assert!(
        !model.contains("effect") && !model.contains("lag"),
        "{model}"
    );
    let files = std::fs::read_dir(folder.join("recordings")).unwrap();
    let mut metas = 0;
    for path in files.map(|entry| entry.unwrap().path()) {
        if path.extension().is_some_and(|end| end == "toml") {
            let meta = std::fs::read_to_string(&path).unwrap();
            assert!(!meta.contains("lag") && meta.contains("repeat"), "{meta}");
            metas += 1;
        }
    }
    assert_eq!(metas, 14);
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn plans_hold_every_kind_and_every_class() {
    let list = plan(Set::Rich, 300, &[], 1);
    assert_eq!(list.len(), 300);
    for hidden in [
        Hidden::Nothing,
        Hidden::Parameters,
        Hidden::One,
        Hidden::Two,
        Hidden::Outside,
    ] {
        assert!(list.iter().filter(|plan| plan.hidden == hidden).count() >= 20);
    }
    for kind in kinds() {
        let of: Vec<&Plan> = list
            .iter()
            .filter(|plan| plan.hidden == Hidden::One && plan.laws[0].row().kind == Some(kind))
            .collect();
        assert!(of.len() >= 5, "{kind}");
        let all_same = of.iter().all(|plan| plan.laws[0].row().same);
        assert_eq!(all_same, Law::of_kind(kind).len() == 1, "{kind}");
    }
    let only = plan(Set::Rich, 7, &["gravity".to_owned()], 1);
    assert_eq!(only.len(), 7);
    assert!(
        only.iter()
            .all(|plan| plan.laws[0].row().kind == Some("gravity"))
    );
}

#[test]
fn the_catalogue_is_complete_and_the_tool_knows_no_other_kind() {
    let kinds = kinds();
    assert_eq!(kinds.len(), 27);
    assert!(Law::outside().len() >= 6);
    for kind in Kind::NAMES {
        assert!(kinds.contains(&kind.name()), "{}", kind.name());
    }
    // Keys of equal formulas are those of model files, in this order.
    for &kind in Kind::NAMES {
        let formula = Law::of_kind(kind.name())[0];
        assert!(formula.row().same);
        let keys: Vec<&str> = formula.row().quantities.iter().map(|q| q.key).collect();
        // What files may leave out and no fit frees, the formula may have built in.
        let is_free = |row: &&Parameter| match row.held {
            Some(_) => !row.starts.is_empty(),
            None => row.default.is_none(),
        };
        for row in kind.parameters().iter().filter(is_free) {
            assert!(
                keys.contains(&row.key),
                "{} has no {}",
                kind.name(),
                row.key
            );
        }
    }
}

/// What is hidden under the name of an effect is in the tool's catalogue.
#[test]
fn every_kind_is_one_of_the_catalogue() {
    for kind in kinds() {
        assert!(Kind::from_name(kind).is_some(), "{kind}");
    }
}

/// The truth must not come from the code that is tested with it.
#[test]
fn the_simulator_shares_no_code_with_the_tool() {
    for (name, text) in [
        ("law.rs", include_str!("../worlds/src/law.rs")),
        ("world.rs", include_str!("../worlds/src/world.rs")),
        ("sizes.rs", include_str!("../worlds/src/sizes.rs")),
        (
            "experiments.rs",
            include_str!("../worlds/src/experiments.rs"),
        ),
        ("refit.rs", include_str!("../worlds/src/refit.rs")),
    ] {
        for crate_name in ["model_core", "softrig_cli", "softrig", "firmware", "wire::"] {
            assert!(!text.contains(crate_name), "{name} mentions {crate_name}");
        }
    }
    // Drawing and recording use the formats of files and nothing else.
    for text in [
        include_str!("../worlds/src/cases.rs"),
        include_str!("../worlds/src/sensors.rs"),
    ] {
        assert!(!text.contains("model_core") && !text.contains("softrig_cli"));
        for line in text.lines().filter(|line| line.contains("softrig")) {
            assert!(
                line.contains("softrig_formats::error")
                    || line.contains("softrig_formats::recording"),
                "{line}"
            );
        }
    }
}
