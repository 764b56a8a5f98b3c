//! The programs of the virtual rig, for whatever runs them.

use std::path::PathBuf;

use crate::{
    python,
    shell::{Outcome, cargo, run, target_dir},
};

/// Builds the simulator's command and returns its path.
pub fn virtual_rig() -> Outcome<PathBuf> {
    built("virtual-rig")
}

/// Builds the soak and returns its path.
pub fn soak() -> Outcome<PathBuf> {
    built("soak")
}

fn built(program: &str) -> Outcome<PathBuf> {
    // With the package alone, its dependencies would be built again with other
    // features than the rest of the workspace asks for.
    run(cargo()
        .args(["build", "-q", "--locked", "--workspace"])
        .args(["--exclude", python::CRATE, "--bin", program]))?;
    Ok(target_dir().join("debug").join(program))
}
