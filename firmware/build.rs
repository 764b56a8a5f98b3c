//! Gives the linker the memory limits of the board.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_ARCH").as_deref() != Ok("avr") {
        return;
    }
    let limits = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../memory.x");
    println!("cargo::rustc-link-arg-bins={}", limits.display());
    println!("cargo::rerun-if-changed={}", limits.display());
}
