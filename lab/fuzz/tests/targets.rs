//! Every target, with its corpus and with random edits of it.
//!
//! There is no coverage here. Random bytes are hardly ever a file, so the corpus is edited,
//! with the same random numbers in every run, so that failures can be reproduced.
//! `cargo xtask fuzz` continues with coverage.

use std::{env, fs, path::Path};

use proptest::{
    prelude::*,
    test_runner::{Config, RngAlgorithm, TestRng, TestRunner},
};
use softrig_fuzz::TARGETS;

/// Edits of one round.
const CASES: u32 = 100;

/// Rounds of each target; more of them if `SOFTRIG_FUZZ_ROUNDS` says so.
fn rounds() -> u32 {
    let asked = env::var("SOFTRIG_FUZZ_ROUNDS").ok();
    asked.and_then(|text| text.parse().ok()).unwrap_or(100)
}

/// What is done to a seed: where, in shares of its length, and what.
type Edit = (u16, u8, u8);

/// Texts that mean something to one reader or another.
const WORDS: [&str; 24] = [
    "\n",
    ",",
    "\"",
    "'''",
    "-",
    "nan",
    "inf",
    "1e308",
    "-0",
    "0.1",
    "[",
    "]",
    "{",
    "=",
    "#",
    "schema = 1\n",
    "[[segment]]\n",
    "[[effect]]\n",
    "T ",
    "A: 1 ok ",
    " *",
    "\r\n",
    "\u{feff}",
    "é",
];

fn edit(bytes: &mut Vec<u8>, (place, kind, with): Edit) {
    let at = usize::from(place) * bytes.len() / 65_536;
    let word = WORDS[usize::from(with) % WORDS.len()].as_bytes();
    match kind % 5 {
        0 if at < bytes.len() => bytes[at] = with,
        1 if at < bytes.len() => bytes[at] ^= 1 << (with % 8),
        2 => drop(bytes.drain(at..(at + usize::from(with % 16)).min(bytes.len()))),
        3 => drop(bytes.splice(at..at, word.iter().copied())),
        _ => {
            let copied = bytes[at.saturating_sub(usize::from(with))..at].to_vec();
            bytes.splice(at..at, copied);
        }
    }
}

/// The seeds of a target, with their names.
fn seeds(target: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("corpus")
        .join(target);
    let entries = fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("no corpus in {}: {error}", folder.display()));
    let mut seeds: Vec<_> = entries
        .map(|entry| {
            let path = entry.unwrap().path();
            (path.display().to_string(), fs::read(&path).unwrap())
        })
        .collect();
    seeds.sort();
    assert!(seeds.len() >= 3, "{target} has {} seeds", seeds.len());
    seeds
}

#[test]
fn seeds_and_their_edits_break_no_promise() {
    for (name, target) in TARGETS {
        let seeds = seeds(name);
        for (path, bytes) in &seeds {
            println!("{path}");
            target(bytes);
        }
        let edits = prop::collection::vec(any::<Edit>(), 1..5);
        let strategy = (any::<prop::sample::Index>(), edits);
        for round in 0..rounds() {
            // A new one each time: one that has run its cases is done for good.
            let config = Config {
                cases: CASES,
                failure_persistence: None,
                ..Config::default()
            };
            let mut seed = [0; 32];
            seed[..4].copy_from_slice(&round.to_le_bytes());
            let random = TestRng::from_seed(RngAlgorithm::ChaCha, &seed);
            let mut runner = TestRunner::new_with_rng(config, random);
            let outcome = runner.run(&strategy, |(seed, edits)| {
                let mut bytes = seed.get(&seeds).1.clone();
                for &change in &edits {
                    edit(&mut bytes, change);
                }
                target(&bytes);
                Ok(())
            });
            outcome.unwrap_or_else(|problem| panic!("{name}, round {round}: {problem}"));
        }
        let count = rounds() * CASES;
        println!("{name}: {count} edited seeds");
    }
}
