// SPDX-License-Identifier: GPL-3.0-or-later
//! The first second after a reset: whatever starts there (a prediction, a tare,
//! a recording) starts from it.

use virtual_rig::{Image, Options, ResetCause};
use wire::{
    answer::Identity, command::Command, decimal::Hundredths, fault::Fault, reply::Refusal,
    state::State, telemetry::Telemetry,
};

use crate::bench::{Bench, elf, healthy};

/// Noise of a line's pressure (kPa rms): 0.25 kPa and the rounding of a count
/// of 0.67 kPa, over sixteen conversions.
const PRESSURE_NOISE_KPA: f32 = 0.08;
/// Noise of a line's angle (° rms): 0.4° and the rounding of a count of 0.36°,
/// over sixteen conversions.
const ANGLE_NOISE_DEG: f32 = 0.105;
/// In how many standard deviations none of some thousand lines is.
const NEVER: f32 = 5.0;
/// Lines in a second.
const LINES: usize = 100;

fn mean(lines: &[Telemetry], of: impl Fn(&Telemetry) -> f32) -> f32 {
    lines.iter().map(of).sum::<f32>() / lines.len() as f32
}

fn pressure(line: &Telemetry) -> f32 {
    line.pressure_kpa.expect("a pressure").to_f32()
}

fn angle(line: &Telemetry) -> f32 {
    line.angle_deg.expect("an angle").to_f32()
}

/// A second of a rig at rest, straight and without pressure: every line within
/// the noise, the first like the others, and no bias.
#[track_caller]
fn is_right(lines: &[Telemetry], what: &str) {
    let lines = &lines[..LINES];
    for line in lines {
        let (kpa, degrees) = (pressure(line), angle(line));
        assert!(
            kpa.abs() < NEVER * PRESSURE_NOISE_KPA,
            "{what}, {} ms: {kpa} kPa",
            line.time_ms
        );
        assert!(
            degrees.abs() < NEVER * ANGLE_NOISE_DEG,
            "{what}, {} ms: {degrees} degrees",
            line.time_ms
        );
        let predicted = line.predicted_deg.expect("a prediction").to_f32();
        assert!(
            predicted.abs() < NEVER * ANGLE_NOISE_DEG,
            "{what}, {} ms: {predicted} degrees predicted",
            line.time_ms
        );
    }
    // What rounding leaves under this noise is 0.02 counts; see the converter's
    // test.
    let (kpa, degrees) = (mean(lines, pressure), mean(lines, angle));
    assert!(
        kpa.abs() < NEVER * PRESSURE_NOISE_KPA / 10.0 + 0.015,
        "{what}: {kpa} kPa in the mean"
    );
    assert!(
        degrees.abs() < NEVER * ANGLE_NOISE_DEG / 10.0 + 0.01,
        "{what}: {degrees} degrees in the mean"
    );
}

#[test]
fn the_first_second_after_a_reset_is_right_from_its_first_line() {
    for seed in 1..=10 {
        let options = Options { seed, ..healthy() };
        let Some(mut bench) = Bench::start(options) else {
            return;
        };
        bench.run(1.1);
        assert_eq!(bench.samples[0].time_ms, 10, "the first line is missing");
        is_right(&bench.samples, &format!("seed {seed}, power-on"));

        bench.samples.clear();
        bench.rig.reset(ResetCause::External);
        bench.run(1.5);
        let first = bench
            .samples
            .iter()
            .position(|line| line.time_ms == 10)
            .expect("the first line after a reset");
        is_right(&bench.samples[first..], &format!("seed {seed}, reset"));
    }
}

/// A tare averages the last second. The one right after a reset averages the
/// first lines there are.
#[test]
fn a_tare_after_a_second_is_as_good_as_a_later_one() {
    for seed in 1..=5 {
        let Some(mut bench) = Bench::start(Options { seed, ..healthy() }) else {
            return;
        };
        bench.until(1.5, "a second", |bench| bench.samples.len() > LINES);
        bench.obey(Command::Tare);
        bench.samples.clear();
        bench.run(4.1);
        // The mean of a second as zero, and the mean of four against it.
        let spread = 0.1_f32.hypot(0.05) * NEVER;
        let lines = &bench.samples[5..];
        let (kpa, degrees) = (mean(lines, pressure), mean(lines, angle));
        assert!(
            kpa.abs() < spread * PRESSURE_NOISE_KPA + 0.01,
            "{seed}: {kpa} kPa"
        );
        assert!(
            degrees.abs() < spread * ANGLE_NOISE_DEG,
            "{seed}: {degrees} degrees"
        );
    }
}

/// A step of the self-test holds the interrupts off for milliseconds. The conversions that are
/// missed meanwhile do not go to the other sensor.
#[test]
fn the_self_test_moves_no_reading() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    bench.run(1.0);
    bench.samples.clear();
    bench.obey(Command::SelfTest);
    bench.run(8.0);
    assert!(bench.garbage > 20, "a line for each model");
    let farthest = |read: fn(&Telemetry) -> Option<Hundredths>| {
        bench
            .samples
            .iter()
            .map(|sample| read(sample).map_or(f32::INFINITY, |value| value.to_f32().abs()))
            .fold(0.0, f32::max)
    };
    let kpa = farthest(|sample| sample.pressure_kpa);
    let degrees = farthest(|sample| sample.angle_deg);
    println!("{} samples: {kpa} kPa, {degrees} deg", bench.samples.len());
    assert!(kpa < 1.0 && degrees < 2.0, "{kpa} kPa, {degrees} deg");
}

fn identity(text: &str) -> Identity<'_> {
    Identity::parse(text).expect("an identity")
}

#[test]
fn an_image_says_that_it_is_whole_and_does_so_in_time() {
    let Some(mut bench) = Bench::start(healthy()) else {
        return;
    };
    let first_s = bench.rig.time_s();
    let banner = bench.remarks.first().expect("a banner").clone();
    let image = identity(&banner).image.expect("the build has stamped it");
    assert!(image.is_whole(), "{banner}");
    let answer = bench.obey(Command::Hello);
    assert_eq!(identity(&answer).image, Some(image));
    println!("the first sample came before {first_s:.2} s");
    assert!(first_s < 0.4);
}

/// The tail of an upload that was cut off is what was there before. A letter of a text that
/// nobody reads stands for it: the board has to find out by the sum alone.
#[test]
fn an_image_that_is_not_whole_is_a_fault_that_stays() {
    let Some(mut elf) = elf() else {
        return;
    };
    let text = b"exact, get KEY";
    let at = elf
        .windows(text.len())
        .position(|bytes| bytes == text)
        .expect("a line of the help");
    elf[at] ^= 1;
    let damaged = Image::parse(&elf).expect("an image all the same");
    let mut bench = Bench::of(&damaged, healthy());
    let banner = bench.remarks.first().expect("a banner").clone();
    let image = identity(&banner).image.expect("a stamp");
    assert!(!image.is_whole() && banner.contains(" built "), "{banner}");
    bench.run(0.1);
    assert_eq!(
        (bench.state(), bench.fault()),
        (State::Fault, Some(Fault::Image))
    );
    assert_eq!(bench.ask(Command::Clear), Err(Refusal::StillThere));
    assert_eq!(bench.ask(Command::Arm), Err(Refusal::Faulted));
    assert!(bench.is_safe());
}
