//! Long automatic tests: the soak test on the simulated rig, fuzzing, and Miri, which finds
//! undefined behaviour.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Instant,
};

use crate::{
    avr,
    shell::{self, Outcome, cargo, has_program, read, root, run, seconds, target_dir},
    simulator,
};

/// Simulated hours of protocols and misfortunes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Soak {
    /// Simulated hours.
    pub hours: f64,
    /// Random seed.
    pub seed: u64,
}

impl Soak {
    /// Reads the words after `soak`.
    ///
    /// # Errors
    ///
    /// Says which word makes no sense.
    pub fn parse(words: &[&str]) -> Result<Self, String> {
        let mut soak = Self {
            hours: 1.0,
            seed: 1,
        };
        let mut words = words.iter();
        while let Some(&word) = words.next() {
            let value = words.next().ok_or(format!("{word} needs a value"))?;
            match word {
                "--hours" => soak.hours = positive(word, value)?,
                "--seed" => {
                    soak.seed = value
                        .parse()
                        .map_err(|_| format!("--seed takes a whole number, not {value:?}"))?;
                }
                _ => return Err(format!("soak has no option {word:?}")),
            }
        }
        Ok(soak)
    }
}

/// Minutes of fuzzing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fuzz {
    /// For all targets together.
    pub minutes: f64,
}

impl Fuzz {
    /// Reads the words after `fuzz`.
    ///
    /// # Errors
    ///
    /// Says which word makes no sense.
    pub fn parse(words: &[&str]) -> Result<Self, String> {
        match words {
            [] => Ok(Self { minutes: 10.0 }),
            ["--minutes", value] => Ok(Self {
                minutes: positive("--minutes", value)?,
            }),
            _ => Err(format!("fuzz takes --minutes N, not {}", words.join(" "))),
        }
    }
}

fn positive(option: &str, value: &str) -> Result<f64, String> {
    value
        .parse()
        .ok()
        .filter(|number: &f64| number.is_finite() && *number > 0.0)
        .ok_or(format!("{option} takes a number above 0, not {value:?}"))
}

/// Builds the image and lets the simulated rig suffer.
pub fn soak(options: &Soak) -> Outcome {
    let image = avr::build()?;
    run(Command::new(simulator::soak()?)
        .arg(image)
        .args(["--hours", &options.hours.to_string()])
        .args(["--seed", &options.seed.to_string()]))
}

/// Flags with which the compiler counts edges and shows libFuzzer all comparisons. All
/// exist on stable; only sanitizers do not, and code without `unsafe` has little
/// for them to find.
const COVERAGE: &str = "--cfg fuzzing -Cpasses=sancov-module \
    -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
    -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares";

/// An input that takes longer is a finding too (s).
const SLOWEST_INPUT_S: u32 = 20;

/// Fuzzes every target, each for its share of the time.
pub fn fuzz(options: Fuzz) -> Outcome {
    if !has_program("c++") {
        return Err("libFuzzer is compiled here, which takes a C++ compiler: \
             on Debian, apt-get install g++"
            .into());
    }
    let rustc = read(Command::new("rustc").arg("-vV"))?;
    let host = rustc
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .ok_or("rustc does not say what it runs on")?;
    // Apart from everything else, which is built without coverage.
    let folder = target_dir().join("fuzz");
    println!("fuzz: building with coverage");
    run(cargo()
        .args(["build", "-q", "--locked", "-p", "softrig-fuzz"])
        // With a target, programs that only build are left without coverage.
        .args(["--bin", "fuzz", "--target", host])
        .env("CARGO_TARGET_DIR", &folder)
        .env("RUSTFLAGS", COVERAGE))?;
    let program = folder.join(host).join("debug/fuzz");

    let seeds = root().join("lab/fuzz/corpus");
    let mut targets: Vec<String> = fs::read_dir(&seeds)
        .map_err(|error| format!("cannot list {}: {error}", seeds.display()))?
        .filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()))
        .collect();
    targets.sort();
    let began = Instant::now();
    let share_s = (options.minutes * 60.0 / targets.len() as f64).ceil();
    for (index, target) in targets.iter().enumerate() {
        println!(
            "\nfuzz: {}/{} {target}, for {share_s} s",
            index + 1,
            targets.len()
        );
        fuzz_one(&program, &folder, &seeds.join(target), target, share_s)?;
    }
    println!(
        "\nfuzz: {} targets, {}, nothing found",
        targets.len(),
        seconds(began.elapsed())
    );
    Ok(())
}

fn fuzz_one(program: &Path, folder: &Path, seeds: &Path, target: &str, share_s: f64) -> Outcome {
    let make = |name: &str| -> Outcome<PathBuf> {
        let path = folder.join(name).join(target);
        fs::create_dir_all(&path)
            .map_err(|error| format!("cannot make {}: {error}", path.display()))?;
        Ok(path)
    };
    let (corpus, found) = (make("corpus")?, make("found")?);
    let mut command = Command::new(program);
    command
        // What is new goes into the first folder; the second is the repository's.
        .args([&corpus, seeds])
        .arg(format!("-max_total_time={share_s}"))
        .arg(format!("-timeout={SLOWEST_INPUT_S}"))
        .arg(format!("-artifact_prefix={}/", found.display()))
        .args(["-max_len=4096", "-print_final_stats=1", "-verbosity=1"])
        .env("SOFTRIG_FUZZ_TARGET", target);
    run(&mut command).map_err(|_| {
        format!(
            "{target}: an input was found, see above; it lies in {}\n  \
             again: SOFTRIG_FUZZ_TARGET={target} cargo run -p softrig-fuzz --bin fuzz -- {}/*",
            found.display(),
            found.display()
        )
        .into()
    })
}

/// The interpreter that finds undefined behaviour comes with nightly compilers only;
/// this one was tried.
const MIRI_TOOLCHAIN: &str = "nightly-2026-05-20";

/// Runs tests under Miri: those of the wire, and of the store.
pub fn miri() -> Outcome {
    let began = Instant::now();
    let with = |word: &str| {
        let mut command = Command::new("cargo");
        command
            .arg(format!("+{MIRI_TOOLCHAIN}"))
            .args(["miri", word])
            .current_dir(root())
            // cargo as it was called would be another toolchain's.
            .env_remove("CARGO")
            .env_remove("RUSTUP_TOOLCHAIN")
            .env("CARGO_TARGET_DIR", target_dir().join("miri"));
        command
    };
    if read(with("--version").arg("-q")).is_err() && read(&mut with("--version")).is_err() {
        if !has_program("rustup") {
            return Err(format!("Miri comes with {MIRI_TOOLCHAIN}, through rustup").into());
        }
        println!("miri: installing {MIRI_TOOLCHAIN}");
        run(Command::new("rustup")
            .args(["toolchain", "install", MIRI_TOOLCHAIN, "--no-self-update"])
            .args(["--profile", "minimal", "-c", "miri", "-c", "rust-src"]))?;
    }
    for (package, filter) in [
        ("wire", ""),
        ("firmware", "store::"),
        ("firmware", "ring::"),
    ] {
        let mut command = with("test");
        command
            .args(["--locked", "-p", package, "--lib", "--", filter])
            // Interpreted, a case takes as long as hundreds of compiled ones.
            .env("PROPTEST_CASES", MIRI_CASES)
            // proptest looks for its file of failures, which isolation forbids.
            .env("MIRIFLAGS", "-Zmiri-disable-isolation");
        for slow in MIRI_SKIPS {
            command.args(["--skip", slow]);
        }
        println!("\nmiri: {}", shell::text(&command));
        run(&mut command)?;
    }
    println!(
        "\nmiri: no undefined behaviour, {}",
        seconds(began.elapsed())
    );
    Ok(())
}

/// Cases of each property under Miri.
const MIRI_CASES: &str = "4";

/// Tests that save hundreds of times or more: long under Miri. Shorter ones call the
/// same code.
const MIRI_SKIPS: [&str; 4] = [
    "a_power_cut_leaves_the_old_or_the_new_record",
    "damage_does_not_become_never_stored_by_a_cut",
    "a_worn_out_cell_is_noticed_and_the_old_record_stays",
    "settings_that_change_under_way_are_not_stored",
];
