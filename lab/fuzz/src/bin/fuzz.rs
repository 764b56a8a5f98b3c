//! Runs a target under libFuzzer; `cargo xtask fuzz` builds it with the required
//! instrumentation, and names the target in the environment.
//!
//! Without instrumentation it runs targets on given files, to examine an input that was
//! found.
#![cfg_attr(fuzzing, no_main)]

use softrig_fuzz::{TARGETS, Target};

/// Where the name of the target is.
const NAME: &str = "SOFTRIG_FUZZ_TARGET";

fn target() -> Target {
    let wanted = std::env::var(NAME).unwrap_or_default();
    let found = TARGETS.iter().find(|(name, _)| *name == wanted);
    let names = TARGETS.map(|(name, _)| name).join(", ");
    found
        .unwrap_or_else(|| panic!("{NAME} is {wanted:?}, not one of: {names}"))
        .1
}

#[cfg(fuzzing)]
libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    static FOUND: std::sync::OnceLock<Target> = std::sync::OnceLock::new();
    FOUND.get_or_init(target)(bytes);
});

#[cfg(not(fuzzing))]
fn main() {
    let target = target();
    for path in std::env::args_os().skip(1) {
        let path = std::path::PathBuf::from(path);
        match std::fs::read(&path) {
            Ok(bytes) => {
                target(&bytes);
                println!("{}: no promise is broken", path.display());
            }
            Err(error) => eprintln!("cannot read {}: {error}", path.display()),
        }
    }
}
