//! Everything that must hold before a change goes in, in one command.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use crate::{
    avr, bench, book, python,
    setup::{self, Mode, Purpose},
    shell::{Outcome, Steps, cargo, run},
    simulator,
    size::{self, Golden},
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
    let mut steps = Steps::new(13);
    let everything = scope == Scope::Everything;

    if everything {
        steps.step("set-up", || setup::setup(Purpose::Tests, Mode::Install))?;
    } else {
        steps.skip("set-up", HOST_ONLY);
    }
    steps.step("format", || {
        run(cargo().args(["fmt", "--all", "--", "--check"]))
    })?;
    steps.step("clippy", || run(&mut clippy(everything)))?;
    steps.step("host tests", || {
        let mut tests = cargo();
        tests.args(["test", "--locked", "--", "-q"]);
        if everything {
            // What runs exported models is there: see the set-up.
            tests.env("SOFTRIG_EXPORT_TOOLS", "required");
        }
        run(&mut tests)
    })?;
    steps.step("firmware logic on the host", || {
        run(cargo().args(["test", "--locked", "-p", "firmware", "--", "-q"]))
    })?;
    steps.step("documentation", || {
        run(cargo()
            .args(["doc", "--no-deps", "--locked"])
            .env("RUSTDOCFLAGS", "-D warnings"))
    })?;

    // Links and commands in it are among the host tests.
    if everything {
        steps.step("book", || book::book().map(drop))?;
    } else {
        steps.skip("book", HOST_ONLY);
    }

    if everything {
        steps.step("blind gate", || {
            bench::start("blind", &["--fast"]).ok_or("there is no benchmark blind")?
        })?;
    } else {
        steps.skip("blind gate", HOST_ONLY);
    }

    if everything {
        steps.step("report in a browser", browser)?;
    } else {
        steps.skip("report in a browser", HOST_ONLY);
    }

    if everything {
        steps.step("Python package", python::test)?;
    } else {
        steps.skip("Python package", HOST_ONLY);
    }

    if everything {
        let mut image = PathBuf::new();
        steps.step("firmware", || {
            image = avr::build()?;
            Ok(())
        })?;
        steps.step("gates", || {
            avr::gates(&image)?;
            size::size(&image, Golden::Check)
        })?;
        steps.step("simulator", || in_simulator(&image))?;
    } else {
        for name in ["firmware", "gates", "simulator"] {
            steps.skip(name, HOST_ONLY);
        }
    }
    steps.finish("cargo xtask test");
    Ok(())
}

/// The report in headless Chromium.
fn browser() -> Outcome {
    let chromium = setup::chromium().ok_or("Chromium is not on the search path")?;
    run(cargo()
        .args(["test", "--locked", "-p", "softrig-tests"])
        .args(["--features", "browser", "--test", "report_in_browser"])
        .args(["--", "--nocapture"])
        .env("SOFTRIG_CHROMIUM", chromium))
}

/// The simulator's own tests and the image on the simulated rig, then the image
/// against the desktop, and the loop against the truth.
fn in_simulator(image: &Path) -> Outcome {
    let rig = simulator::virtual_rig()?;
    run(cargo()
        .args(["test", "--locked", "-p", "virtual-rig", "--", "-q"])
        .env("SOFTRIG_FIRMWARE", image))?;
    run(cargo()
        .args(["test", "--locked", "--workspace"])
        .args(["--exclude", python::CRATE])
        .args(["--test", "firmware_in_simulator"])
        .args(["--test", "loop_on_the_virtual_rig", "--", "--nocapture"])
        .env("SOFTRIG_FIRMWARE", image)
        .env("SOFTRIG_VIRTUAL_RIG", rig))
}

fn clippy(everything: bool) -> Command {
    let mut command = cargo();
    command.args(["clippy", "--locked", "--workspace", "--all-targets"]);
    if everything {
        command.args(["--features", "softrig-tests/browser"]);
    } else {
        // Its build needs the simulator's headers.
        command.args(["--exclude", "virtual-rig"]);
    }
    command.args(["--", "-D", "warnings"]);
    command
}
