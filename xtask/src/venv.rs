//! Python with packages, in a folder of its own.

use std::{
    ffi::OsString,
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use crate::{
    setup,
    shell::{Outcome, read, run_quietly},
};

const PYTHON_LIMIT: Duration = Duration::from_secs(600);

/// A Python that can do `imports`, in a folder of its own: packages are installed into it
/// by `pip install` with these words, unless they are there.
pub fn virtual_environment(
    folder: &Path,
    imports: &str,
    packages: &[OsString],
) -> Outcome<PathBuf> {
    let python = folder.join("bin/python");
    let works = || read(Command::new(&python).args(["-c", imports])).is_ok();
    if works() {
        return Ok(python);
    }
    setup::python()?;
    println!("installing Python packages into {}", folder.display());
    run_quietly(
        Command::new("python3").args(["-m", "venv"]).arg(folder),
        PYTHON_LIMIT,
    )?;
    run_quietly(
        Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--only-binary", ":all:"])
            .args(packages),
        PYTHON_LIMIT,
    )?;
    if works() {
        Ok(python)
    } else {
        Err(format!(
            "the Python packages were installed, but `{imports}` fails in {}",
            folder.display()
        )
        .into())
    }
}
