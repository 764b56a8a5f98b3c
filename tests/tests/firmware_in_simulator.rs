//! The image that is flashed, run instruction by instruction, against the desktop.
//!
//! `cargo xtask test` builds the image and the simulator and says where they are.
//! Without them there is nothing to run, and the test says so: plain `cargo test`
//! must pass on a machine that has neither.

use std::{
    env,
    path::Path,
    process::{Command, Output},
};

use model_core::{catalogue::Kind, prepared::BASE_CYCLES};
use wire::{
    line,
    self_test::{ANGLE_RAD, DONE, expected},
    step_report::StepReport,
};

const IMAGE: &str = "SOFTRIG_FIRMWARE";
const VIRTUAL_RIG: &str = "SOFTRIG_VIRTUAL_RIG";

/// Fifty simulated seconds; the self-test takes ten, most of them for tables.
const CYCLES: &str = "800000000";

/// Runs the image until it has sent `until`; nothing when there is no simulator.
fn run_image(image: Option<&Path>, until: &str) -> Option<Output> {
    let (Some(default), Some(virtual_rig)) = (env::var_os(IMAGE), env::var_os(VIRTUAL_RIG)) else {
        println!(
            "skipped: {IMAGE} and {VIRTUAL_RIG} are not set; `cargo xtask test` builds both and sets them"
        );
        return None;
    };
    let image = image.unwrap_or(Path::new(&default));
    let output = Command::new(virtual_rig)
        .arg("run")
        .arg(image)
        .args(["--cycles", CYCLES, "--send", "selftest", "--until", until])
        .output()
        .expect("the simulator starts");
    Some(output)
}

#[test]
fn the_board_computes_the_same_bits_as_the_desktop() {
    let Some(output) = run_image(None, DONE) else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{output:?}");
    println!("{said}");

    let reports: Vec<StepReport<'_>> = said
        .lines()
        .filter(|text| text.starts_with("step "))
        .map(|text| StepReport::parse(text).expect("a step report"))
        .collect();
    let desktop = expected().expect("the self-test's models are valid");
    assert_eq!(reports.len(), desktop.len(), "{said}");

    for (board, desktop) in reports.iter().zip(desktop) {
        assert!(
            board.is_same_to_the_bit(&desktop),
            "board {board:?}, desktop {desktop:?}",
        );
        // A step that does nothing would agree too.
        assert!(board.angle_rad > ANGLE_RAD - 2e-3 && (board.angle_rad - ANGLE_RAD) < 1e-2);
        assert!(board.angle_rad.to_bits() != ANGLE_RAD.to_bits());
    }
    assert!(
        said.lines().any(|text| line::open(text) == Ok(DONE)),
        "{said}"
    );
}

/// What the plan of a period reckons with is not less than what a step takes.
#[test]
fn steps_take_no_more_cycles_than_they_are_planned_with() {
    let Some(output) = run_image(None, DONE) else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    let measured = |name: &str| -> u16 {
        said.lines()
            .find_map(|text| {
                text.strip_prefix("cycles ")?
                    .strip_prefix(name)?
                    .strip_prefix(' ')
            })
            .and_then(|cycles| cycles.parse().ok())
            .unwrap_or_else(|| panic!("no {name} in:\n{said}"))
    };
    assert!(measured("step_table") <= BASE_CYCLES);
    for &kind in Kind::ALL {
        let name = format!("step_table+{}", kind.name());
        let (step, planned) = (measured(&name), BASE_CYCLES + kind.cycles());
        assert!(step <= planned, "{name}: {step} of {planned}");
    }
}

#[test]
fn the_stack_stays_within_what_the_linker_keeps_free() {
    let Some(output) = run_image(None, DONE) else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    let stack: u32 = said
        .lines()
        .find_map(|text| text.strip_prefix("stack ")?.strip_suffix(" bytes"))
        .and_then(|bytes| bytes.parse().ok())
        .unwrap_or_else(|| panic!("no stack in:\n{said}"));
    // Nothing runs without a stack; memory.x reserves 1984 bytes.
    assert!((64..=1984).contains(&stack), "{stack} bytes");
}

#[test]
fn the_simulator_says_what_is_wrong_with_a_file() {
    let not_an_image = env::current_exe().expect("this test has a path");
    let Some(output) = run_image(Some(&not_an_image), DONE) else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("not a 32-bit ELF file"), "{said}");
}

#[test]
fn the_simulator_says_when_the_text_did_not_come() {
    let Some(output) = run_image(None, "text that no firmware sends") else {
        return;
    };
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("before the board sent"), "{said}");
}
