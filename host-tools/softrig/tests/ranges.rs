//! Models at the ends of the ranges of `softrig_formats` are read and can be simulated; beyond
//! them nothing is read.

use std::path::Path;

use model_core::catalogue::Kind;
use softrig::sim::simulate::{InitialState, Signal, run, substeps};
use softrig_formats::model_file::ModelFile;
use softrig_formats::ranges::{KEYS, Range};
use softrig_formats::recording::{PASCAL_PER_KPA, Recording};

/// A model with one number in it, and the place of that number.
fn model(dynamics: &[(&str, f64)], effect: &str) -> String {
    let mut text = "schema = 1\n[dynamics]\n".to_owned();
    for (key, usual) in [
        ("inertia_kg_m", 0.36),
        ("damping_n_s_per_rad", 0.9),
        ("stiffness_n_per_rad_n", 4.2),
        ("exponent", 1.7),
        ("input_gain_n_per_kpa", 0.12),
    ] {
        let given = dynamics.iter().find(|(of, _)| *of == key);
        text += &format!("{key} = {:e}\n", given.map_or(usual, |(_, number)| *number));
    }
    text + effect
}

/// Every number of a model at an end of its range, and beyond.
fn ends() -> Vec<(String, &'static str, Range, f64)> {
    let mut list = Vec::new();
    for range in KEYS.iter().skip(3) {
        for end in [range.least, range.most] {
            list.push((model(&[(range.of, end)], ""), range.of, *range, end));
        }
    }
    for kind in Kind::ALL.iter().filter(|kind| **kind != Kind::Table) {
        for row in kind.parameters() {
            let range = Range::of_parameter(row);
            for end in [range.least, range.most] {
                let mut effect = format!("[[effect]]\nkind = \"{}\"\n", kind.name());
                for other in kind.parameters() {
                    let range = Range::of_parameter(other);
                    let number = if other.key == row.key {
                        end
                    } else {
                        1.0_f64.clamp(range.least, range.most)
                    };
                    effect += &format!("{} = {number:e}\n", other.key);
                }
                list.push((model(&[], &effect), row.key, range, end));
            }
        }
    }
    list
}

/// A second of a step.
fn step() -> Recording {
    Recording {
        time: (0..100).map(|k| f64::from(k) * 0.01).collect(),
        pressure: vec![30.0 * PASCAL_PER_KPA; 100],
        angle: vec![0.5; 100],
        ..Recording::default()
    }
}

#[test]
fn models_at_the_ends_of_the_ranges_are_read_and_simulated_to_numbers_or_are_lost() {
    let recording = step();
    let signal = Signal::pressure(&recording);
    for (text, _, range, end) in ends() {
        let file = ModelFile::parse(&text, Path::new("m.toml"));
        let model = file
            .unwrap_or_else(|error| panic!("{range:?} {end}: {error}\n{text}"))
            .model;
        let start = InitialState {
            angle: 0.5,
            rate: 0.0,
        };
        let steps = substeps(&model, 0.01, 1.0);
        let found = run(&model, &signal, start, steps);
        assert!(
            found.reading.iter().all(|angle| angle.is_finite()),
            "{range:?} {end}: {:?}",
            found.reading
        );
    }
}

#[test]
fn beyond_the_ends_nothing_is_read() {
    for (text, key, range, end) in ends() {
        let beyond = if end < range.most {
            end - 0.5 * end.abs().max(1e-6)
        } else {
            end * 1.5 + 1e-6
        };
        for wrong in [beyond, 1e308, -1e308] {
            let text = text.replace(
                &format!("\n{key} = {end:e}\n"),
                &format!("\n{key} = {wrong:e}\n"),
            );
            let said = ModelFile::parse(&text, Path::new("m.toml"))
                .unwrap_err()
                .to_string();
            assert!(
                said.contains("m.toml, line ") && said.contains(", column "),
                "{said}"
            );
            assert!(said.contains(&range.advice()), "{said}\n{text}");
        }
    }
}
