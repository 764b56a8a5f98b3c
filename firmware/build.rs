//! Links avr-libc's float routines and the memory limits into the board's image.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    if env::var("CARGO_CFG_TARGET_ARCH").as_deref() != Ok("avr") {
        return;
    }
    // avr-libc's assembly replaces the weak, four to seven times slower float
    // helpers of compiler_builtins, with the same bits.
    println!("cargo::rustc-link-lib=m");
    let limits = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../memory.x");
    println!("cargo::rustc-link-arg-bins={}", limits.display());
    println!("cargo::rerun-if-changed={}", limits.display());
}
