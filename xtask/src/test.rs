//! Everything that must hold before a change goes in, in one command.

use std::{path::PathBuf, process::Command};

use crate::{
    avr,
    setup::{self, Mode},
    shell::{Outcome, Steps, cargo, run, target_dir},
};

/// Which tests to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// All of them.
    Everything,
    /// Those that need neither the AVR compiler nor the simulator.
    Host,
}

const HOST_ONLY: &str = "--host-only was given";

/// Runs the tests; the first failure stops them.
pub fn test(scope: Scope) -> Outcome {
    let mut steps = Steps::new(9);
    let everything = scope == Scope::Everything;

    if everything {
        steps.step("set-up", || setup::setup(Mode::Install))?;
    } else {
        steps.skip("set-up", HOST_ONLY);
    }
    steps.step("format", || {
        run(cargo().args(["fmt", "--all", "--", "--check"]))
    })?;
    steps.step("clippy", || run(&mut clippy(everything)))?;
    steps.step("host tests", || {
        run(cargo().args(["test", "-q", "--locked"]))
    })?;
    steps.step("documentation", || {
        run(cargo()
            .args(["doc", "-q", "--no-deps", "--locked"])
            .env("RUSTDOCFLAGS", "-D warnings"))
    })?;

    if !everything {
        for name in ["firmware", "gates", "firmware tests", "simulator"] {
            steps.skip(name, HOST_ONLY);
        }
        steps.finish("cargo xtask test");
        return Ok(());
    }

    let mut image = PathBuf::new();
    steps.step("firmware", || {
        image = avr::build()?;
        Ok(())
    })?;
    steps.step("gates", || {
        avr::gates(&image)?;
        avr::print_size(&image)
    })?;
    steps.step("firmware tests", || {
        run(cargo().args([
            "test",
            "-q",
            "--locked",
            "-p",
            "firmware",
            "-p",
            "virtual-rig",
        ]))
    })?;
    steps.step("simulator", || {
        let rig = virtual_rig()?;
        run(cargo()
            .args(["test", "-q", "--locked", "--workspace"])
            .args(["--test", "firmware_in_simulator", "--", "--nocapture"])
            .env("SOFTRIG_FIRMWARE", &image)
            .env("SOFTRIG_VIRTUAL_RIG", rig))
    })?;
    steps.finish("cargo xtask test");
    Ok(())
}

fn clippy(everything: bool) -> Command {
    let mut command = cargo();
    command.args(["clippy", "-q", "--locked", "--workspace", "--all-targets"]);
    if !everything {
        // Its build needs the simulator's headers.
        command.args(["--exclude", "virtual-rig"]);
    }
    command.args(["--", "-D", "warnings"]);
    command
}

/// Builds the simulator's command and returns its path.
pub fn virtual_rig() -> Outcome<PathBuf> {
    // With the package alone, its dependencies would be built again with other
    // features than the rest of the workspace asks for.
    run(cargo().args([
        "build",
        "-q",
        "--locked",
        "--workspace",
        "--bin",
        "virtual-rig",
    ]))?;
    Ok(target_dir().join("debug/virtual-rig"))
}
