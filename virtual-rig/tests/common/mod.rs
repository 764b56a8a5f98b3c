// SPDX-License-Identifier: GPL-3.0-or-later
//! A small program for the board, compiled when there is a compiler.

use std::{path::Path, process::Command, sync::OnceLock};

use virtual_rig::{Image, Options, VirtualRig};

/// The ELF file of `obey.c`, or nothing where there is no avr-gcc.
#[allow(dead_code)]
pub fn obey_elf() -> Option<&'static [u8]> {
    static ELF: OnceLock<Option<Vec<u8>>> = OnceLock::new();
    ELF.get_or_init(|| compile("obey.c")).as_deref()
}

/// The ELF file of a program in this folder.
pub fn compile(name: &str) -> Option<Vec<u8>> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/common")
        .join(name);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let elf = folder.path().join("program.elf");
    let compiled = Command::new("avr-gcc")
        .args(["-mmcu=atmega2560", "-Os", "-std=gnu11", "-o"])
        .arg(&elf)
        .arg(source)
        .arg("-lm")
        .status();
    match compiled {
        Ok(status) if status.success() => Some(std::fs::read(elf).expect("the ELF file")),
        Ok(status) => panic!("avr-gcc failed: {status}"),
        Err(_) => {
            eprintln!("skipped: there is no avr-gcc; `cargo xtask setup` installs it");
            None
        }
    }
}

/// A rig that runs `obey.c` and has said that it is ready.
#[allow(dead_code)]
pub fn obeying(options: Options) -> Option<VirtualRig> {
    let image = Image::parse(obey_elf()?).expect("an image");
    let mut rig = VirtualRig::new(&image, options).expect("a rig");
    wait(&mut rig, "ready");
    Some(rig)
}

/// The rest of the next line that starts with `start`.
#[allow(dead_code)]
pub fn wait(rig: &mut VirtualRig, start: &str) -> String {
    rig.run_until_line(5.0, |line| line.starts_with(start))
        .expect("the board runs")
        .unwrap_or_else(|| panic!("no line starts with {start:?}"))[start.len()..]
        .trim()
        .into()
}

/// Sends letters and lets the board obey.
#[allow(dead_code)]
pub fn tell(rig: &mut VirtualRig, letters: &str) {
    rig.send(letters.as_bytes()).expect("bytes are queued");
    rig.run_for(0.002 + 1e-4 * letters.len() as f64)
        .expect("the board runs");
}

/// Sends a letter and returns the number in the answer.
#[allow(dead_code)]
pub fn ask(rig: &mut VirtualRig, letter: &str, name: &str) -> i64 {
    rig.take_output();
    rig.send(letter.as_bytes()).expect("bytes are queued");
    wait(rig, name).parse().expect("a number")
}
