//! Everything that must hold before a change goes in, in one command.

use std::{
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use crate::{
    avr, bench, book, python,
    setup::{self, Mode, Purpose},
    shell::{Outcome, Steps, cargo, has_program, root, run, run_quietly, target_dir},
    size::{self, Golden},
    web,
};

/// Which tests to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// All of them.
    Everything,
    /// Those that need neither the AVR compiler nor the simulator.
    Host,
}

/// Longest time that one small package from the network takes.
const NPM_LIMIT: Duration = Duration::from_secs(120);

const HOST_ONLY: &str = "--host-only was given";

/// Runs the tests; the first failure stops them.
pub fn test(scope: Scope) -> Outcome {
    let mut steps = Steps::new(11);
    let everything = scope == Scope::Everything;
    let (mut image, mut page) = (PathBuf::new(), PathBuf::new());

    if everything {
        steps.step("set-up", || setup::setup(Purpose::Tests, Mode::Install))?;
    } else {
        steps.skip("set-up", HOST_ONLY);
    }
    steps.step("format", || {
        run(cargo().args(["fmt", "--all", "--", "--check"]))
    })?;
    if everything {
        steps.step("firmware", || {
            image = avr::build()?;
            avr::gates(&image)
        })?;
    } else {
        steps.skip("firmware", HOST_ONLY);
    }
    if everything {
        steps.step("page", || {
            page = web::web()?;
            Ok(())
        })?;
    } else {
        steps.skip("page", HOST_ONLY);
    }
    steps.step("clippy", || {
        run(workspace("clippy", scope)
            .arg("--all-targets")
            .args(["--", "-D", "warnings"]))
    })?;
    steps.step("tests", || tests(scope, &image, &page))?;
    if everything {
        steps.step("size", || size::size(&image, Golden::Check, &virtual_rig()))?;
    } else {
        steps.skip("size", HOST_ONLY);
    }
    steps.step("documentation", || {
        run(workspace("doc", scope)
            .arg("--no-deps")
            .env("RUSTDOCFLAGS", "-D warnings"))
    })?;

    // Links and commands in it are among the tests.
    if everything {
        steps.step("book", || book::book().map(drop))?;
        steps.step("blind gate", bench::gate)?;
        steps.step("Python package", || python::test(python::Ray::Skipped))?;
    } else {
        for name in ["book", "blind gate", "Python package"] {
            steps.skip(name, HOST_ONLY);
        }
    }
    steps.finish("cargo xtask test");
    Ok(())
}

/// The tests of all crates: on the host, with the image on the simulated rig, and with the
/// report and the page in headless Chromium. Without the board and the browser, theirs say that they are
/// skipped.
fn tests(scope: Scope, image: &Path, page: &Path) -> Outcome {
    let mut tests = workspace("test", scope);
    if scope == Scope::Everything {
        second_processor();
        let chromium = setup::chromium().ok_or("Chromium is not on the search path")?;
        tests
            .env("SOFTRIG_CHROMIUM", chromium)
            .env("SOFTRIG_FIRMWARE", image)
            .env("SOFTRIG_PAGE", page)
            .env("SOFTRIG_VIRTUAL_RIG", virtual_rig())
            // What runs exported models is there: see the set-up.
            .env("SOFTRIG_EXPORT_TOOLS", "required");
    }
    run(tests.args(["--", "-q"]))
}

/// avr8js, on which the image runs beside simavr. Where npm is not to be had or finds nothing, the
/// test says that it is skipped.
fn second_processor() {
    let folder = root().join("tests/second_processor");
    if folder.join("node_modules/avr8js").exists() || !has_program("npm") {
        return;
    }
    let mut npm = Command::new("npm");
    npm.args(["ci", "--no-audit", "--no-fund"])
        .current_dir(folder);
    if let Err(why) = run_quietly(&mut npm, NPM_LIMIT) {
        println!("avr8js was not installed, so the image runs on simavr alone: {why}");
    }
}

/// The simulator's command, which is built with the tests of its crate.
fn virtual_rig() -> PathBuf {
    target_dir().join("debug/virtual-rig")
}

/// cargo on all crates at once. Of some of them alone it would ask their dependencies for
/// fewer features, and compile most of them once more: docs/decisions/0058.
fn workspace(command: &str, scope: Scope) -> Command {
    let mut cargo = cargo();
    cargo.args([command, "--locked", "--workspace"]);
    match scope {
        Scope::Everything => cargo.args(["--features", "softrig-tests/browser"]),
        // Its build needs the simulator's headers.
        Scope::Host => cargo.args(["--exclude", "virtual-rig"]),
    };
    cargo
}
