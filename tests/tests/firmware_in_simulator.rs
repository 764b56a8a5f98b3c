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

use firmware::self_test::{
    ANGLE_RAD, DONE, DYNAMICS, PRESSURE_PA, RATE_RAD_PER_S, STEP_S, with_effect,
};
use model_core::{
    actuator::{Model, State},
    catalogue::Kind,
    input::Held,
    integrate::{Scheme, step},
    power::{GuardedMicromath, Minimax, Power},
};
use wire::{line, step_report::StepReport};

const IMAGE: &str = "SOFTRIG_FIRMWARE";
const VIRTUAL_RIG: &str = "SOFTRIG_VIRTUAL_RIG";

/// Two simulated seconds; the self-test takes a few hundredths.
const CYCLES: &str = "32000000";

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

fn base<P: Power<f32>>() -> Model<f32, P> {
    Model::new(DYNAMICS, &[]).expect("the self-test's model is valid")
}

fn on_the_desktop<P: Power<f32>>(model: &Model<f32, P>) -> State<f32> {
    let mut state = model.moving(ANGLE_RAD, RATE_RAD_PER_S, PRESSURE_PA);
    step(Scheme::Rk4, model, &mut state, &Held(PRESSURE_PA), STEP_S);
    state
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
    let mut desktop = vec![
        ("minimax", None, on_the_desktop(&base::<Minimax>())),
        (
            "micromath",
            None,
            on_the_desktop(&base::<GuardedMicromath>()),
        ),
    ];
    for (index, &kind) in (0..).zip(Kind::ALL) {
        let model = with_effect(kind).expect("the self-test's effects are valid");
        desktop.push(("minimax", Some(index), on_the_desktop(&model)));
    }
    assert_eq!(reports.len(), desktop.len(), "{said}");

    for (board, (power, effect, desktop)) in reports.iter().zip(desktop) {
        assert_eq!((board.power, board.effect), (power, effect));
        assert_eq!(
            (board.angle_rad.to_bits(), board.rate_rad_per_s.to_bits()),
            (desktop.angle.to_bits(), desktop.rate.to_bits()),
            "board {board:?}, desktop {desktop:?}",
        );
        // A step that does nothing would agree too.
        assert!(board.angle_rad > ANGLE_RAD && (board.angle_rad - ANGLE_RAD) < 1e-2);
    }
    assert!(
        said.lines().any(|text| line::open(text) == Ok(DONE)),
        "{said}"
    );
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
    // Nothing runs without a stack; memory.x reserves 3072 bytes.
    assert!((64..=3072).contains(&stack), "{stack} bytes");
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
