//! The whole loop, for someone who has no rig yet: set up, build, and start the demo of the
//! tests crate, which flashes, records, diagnoses, uploads and records again.

use std::{
    fs,
    io::{BufRead, BufReader},
    process::{Command, Stdio},
    time::Instant,
};

use crate::{
    avr, cast,
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
            "--seed" | "--effect" | "--cast" => {}
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
        "build the softrig command, the simulator and the firmware",
        || {
            run(release_build()
                .args(["-p", "softrig-cli", "--bin", "softrig"])
                .args(["-p", "virtual-rig", "--bin", "virtual-rig"])
                .args(["-p", "softrig-tests", "--bin", "demo"]))?;
            let image = avr::build()?;
            avr::gates(&image)?;
            avr::print_size(&image)?;
            demo.arg("--image").arg(image);
            Ok(())
        },
    )?;
    demo.arg("--softrig")
        .arg(release.join("softrig"))
        .arg("--simulator")
        .arg(release.join("virtual-rig"));
    let Some(place) = options.iter().position(|option| *option == "--cast") else {
        return run(demo.args(options));
    };
    let rest = [&options[..place], &options[place + 2..]].concat();
    let typed: Vec<&str> = ["cargo", "xtask", "demo"]
        .into_iter()
        .chain(rest.iter().copied())
        .collect();
    filmed(demo.args(rest), &typed.join(" "), options[place + 1])
}

/// Runs the demo, and draws what it prints as a picture that moves.
fn filmed(demo: &mut Command, typed: &str, picture: &str) -> Outcome {
    let fail = |error: std::io::Error| format!("the demo: {error}");
    let clock = Instant::now();
    let mut child = demo.stdout(Stdio::piped()).spawn().map_err(fail)?;
    let out = child.stdout.take().ok_or("the demo has no output")?;
    let mut printed = vec![(clock.elapsed(), "… set-up and build, once".to_owned())];
    for line in BufReader::new(out).lines() {
        let line = line.map_err(fail)?;
        println!("{line}");
        printed.push((clock.elapsed(), line));
    }
    if !child.wait().map_err(fail)?.success() {
        return Err("the demo failed".into());
    }
    fs::write(picture, cast::draw(typed, &printed))
        .map_err(|error| format!("cannot write {picture}: {error}"))?;
    println!("drawn: {picture}");
    Ok(())
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
