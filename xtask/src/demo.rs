//! The whole loop, for someone who has no rig yet: set up, build, and start the demo of the
//! tests crate, which flashes, records, diagnoses, uploads and records again.

use std::{env, process::Command};

use crate::{
    avr,
    setup::{self, Mode, Purpose},
    shell::{Outcome, Steps, release_build, run, target_dir},
};

/// Steps of the whole demo; those that are not here are numbered by the demo itself.
const STEPS: usize = 8;

/// Checks the options of the demo, which are handed on: a slip should not be found after
/// minutes of compiling.
///
/// # Errors
///
/// Says what makes no sense.
pub fn check(words: &[&str]) -> Result<(), String> {
    let mut words = words.iter();
    while let Some(&word) = words.next() {
        let value = words
            .next()
            .ok_or_else(|| format!("demo: {word} needs a value, or is not known"))?;
        match word {
            "--seed" if value.parse::<u64>().is_err() => {
                return Err(format!("demo: {value:?} is no seed; give a whole number"));
            }
            "--seed" | "--effect" => {}
            _ => return Err(format!("demo: there is no option {word}")),
        }
    }
    Ok(())
}

/// Closes the loop on the virtual rig.
pub fn demo(options: &[&str]) -> Outcome {
    let release = target_dir().join("release");
    let mut steps = Steps::new(STEPS);
    steps.step("set-up", || setup::setup(Purpose::Demo, Mode::Install))?;
    let mut demo = Command::new(release.join("demo"));
    steps.step(
        "build the rig command, the simulator and the firmware",
        || {
            run(release_build()
                .args(["-p", "host-tools", "--bin", "rig"])
                .args(["-p", "virtual-rig", "--bin", "virtual-rig"])
                .args(["-p", "softrig-tests", "--bin", "demo"]))?;
            let image = avr::build()?;
            avr::gates(&image)?;
            avr::print_size(&image)?;
            demo.arg("--image").arg(image);
            Ok(())
        },
    )?;
    let xtask = env::current_exe().map_err(|error| format!("cannot find xtask: {error}"))?;
    run(demo
        .arg("--rig")
        .arg(release.join("rig"))
        .arg("--simulator")
        .arg(release.join("virtual-rig"))
        .arg("--xtask")
        .arg(xtask)
        .args(options))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_choose_the_actuator() {
        for words in [
            &[][..],
            &["--seed", "7"],
            &["--effect", "gravity", "--seed", "7"],
        ] {
            assert_eq!(check(words), Ok(()), "{words:?}");
        }
        for words in [&["--seed"][..], &["--seed", "x"], &["--sed", "1"]] {
            assert!(check(words).is_err(), "{words:?}");
        }
    }
}
