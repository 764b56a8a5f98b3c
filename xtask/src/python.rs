//! The Python package: built as a wheel, and tested as its users get it.
//!
//! Python's dependencies are installed below the target folder, in the versions pinned in
//! `lab/python/requirements`.

use std::{
    ffi::OsString,
    fs,
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use crate::{
    shell::{INCREMENTAL, Outcome, cargo, root, run, run_quietly, target_dir},
    venv,
};

/// The package whose dependencies ask for more features than the rest of the workspace, so
/// that with it everything would be compiled once more.
pub const CRATE: &str = "softrig-python";

/// How long a package manager may take.
const INSTALL_LIMIT: Duration = Duration::from_secs(600);

/// A user's first steps, on a machine with nothing but NumPy, on recordings of which a fit
/// has nothing to warn.
const FIRST_STEPS: &str = "\
import softrig
made = softrig.example(1, effect='none')
softrig.fit(made.model, made.recordings[:2])
try:
    made.recordings[0].to_pandas()
except ImportError as error:
    assert 'pip install pandas' in str(error), error
else:
    raise SystemExit('pandas is here, although nothing asked for it')
";

/// How the code is compiled.
#[derive(Clone, Copy)]
enum Profile {
    /// Quickly.
    Dev,
    /// For users.
    Release,
}

/// Builds the wheel for users, says where it is, and returns its path.
pub fn wheel() -> Outcome<PathBuf> {
    let wheel = build(Profile::Release, &target_dir().join("wheels"))?;
    println!("wheel: {}", wheel.display());
    Ok(wheel)
}

/// Whether Ray is installed for the tests of the recipes: minutes, for a test of a few seconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ray {
    /// It is, and its test runs.
    Installed,
    /// Its test says that it is skipped.
    Skipped,
}

/// Builds a wheel, installs it where there was nothing, and tests it: its behaviour, its
/// types, the notebook of the documentation, and the recipes for schedulers.
pub fn test(ray: Ray) -> Outcome {
    let folder = target_dir().join("python");
    let wheel = build(Profile::Dev, &folder.join("wheels"))?;
    bare(&folder.join("bare"), &wheel)?;

    // With the features of the wheel: its libraries are compiled already.
    run(cargo()
        .args(["build", "-q", "--locked", "-p", "softrig-python"])
        .args(["-p", "softrig-cli"]))?;
    let python = environment(&folder.join("tests"), &requirements("tests.txt"))?;
    install(&python, &wheel, &["--force-reinstall", "--no-deps"])?;
    if ray == Ray::Installed {
        run_quietly(
            Command::new(&python)
                .args(["-m", "pip", "install", "--quiet", "--only-binary", ":all:"])
                .arg("--requirement")
                .arg(requirements("ray.txt")),
            INSTALL_LIMIT,
        )?;
    }
    let tool = |module: &str| {
        let mut command = Command::new(&python);
        command
            .current_dir(root().join("lab/python"))
            .env("SOFTRIG_COMMAND", target_dir().join("debug/softrig"))
            // Nothing is left among the sources.
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .args(["-m", module]);
        command
    };
    run(tool("pytest").args(["-p", "no:cacheprovider"]))?;
    run(tool("mypy")
        .arg("--cache-dir")
        .arg(folder.join("mypy"))
        .arg("tests"))
}

/// Builds a wheel into a folder and returns its path.
fn build(profile: Profile, out: &Path) -> Outcome<PathBuf> {
    let folder = target_dir().join("python/build");
    let python = environment(&folder, &requirements("build.txt"))?;
    for old in wheels(out) {
        fs::remove_file(&old)
            .map_err(|error| format!("cannot remove {}: {error}", old.display()))?;
    }
    let mut command = Command::new(&python);
    command
        .current_dir(root())
        .env("CARGO_TARGET_DIR", target_dir())
        .env(INCREMENTAL, "0")
        .args(["-m", "maturin", "build", "--locked"])
        .args(["--manifest-path", "lab/python/Cargo.toml", "--interpreter"])
        .arg(&python)
        .arg("--out")
        .arg(out);
    match profile {
        // Minutes of compiling: whoever waits for a wheel sees how far it is.
        Profile::Dev => command.args(["--quiet", "--profile", "dev"]),
        Profile::Release => command.args(["--release", "--strip"]),
    };
    run(&mut command)?;
    match wheels(out).as_slice() {
        [wheel] => Ok(wheel.clone()),
        _ => Err(format!("maturin left no wheel in {}", out.display()).into()),
    }
}

/// The wheels in a folder.
fn wheels(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|kind| kind == "whl"))
        .collect()
}

/// Installs the wheel with nothing but what it asks for, and takes the first steps.
fn bare(folder: &Path, wheel: &Path) -> Outcome {
    let _ = fs::remove_dir_all(folder);
    let constraints = requirements("tests.txt").into_os_string();
    let packages = ["--constraint".into(), constraints, wheel.into()];
    let python = venv::virtual_environment(folder, "import softrig", &packages)?;
    run_quietly(
        Command::new(python).args(["-W", "error", "-c", FIRST_STEPS]),
        INSTALL_LIMIT,
    )
}

/// An environment with the packages of a file; one that has them is kept.
fn environment(folder: &Path, requirements: &Path) -> Outcome<PathBuf> {
    let has_them = format!(
        "from importlib.metadata import version\n\
         for line in open({:?}):\n \
             name, _, pinned = line.strip().partition('==')\n \
             assert not pinned or version(name) == pinned, name",
        requirements.display().to_string()
    );
    let packages: [OsString; 2] = ["--requirement".into(), requirements.into()];
    venv::virtual_environment(folder, &has_them, &packages)
}

fn install(python: &Path, wheel: &Path, options: &[&str]) -> Outcome {
    run_quietly(
        Command::new(python)
            .args(["-m", "pip", "install", "--quiet"])
            .args(options)
            .arg(wheel),
        INSTALL_LIMIT,
    )
}

/// A file of pinned versions.
fn requirements(name: &str) -> PathBuf {
    root().join("lab/python/requirements").join(name)
}
