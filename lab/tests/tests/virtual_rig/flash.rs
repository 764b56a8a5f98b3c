//! `softrig flash` against the bootloader of the virtual rig.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use super::common::program;
use super::served::{PORT, VirtualRig, programs};

/// The image in Intel's format; none where none was built.
fn image() -> Option<PathBuf> {
    let (image, _) = programs()?;
    Some(image.with_extension("hex"))
}

/// A board without a program.
fn erased(arguments: &[&str]) -> VirtualRig {
    VirtualRig::erased(arguments).expect("there is an image")
}

fn flash(board: &VirtualRig, image: &Path) -> Output {
    let image = image.to_str().expect("a plain name");
    board.rig(&["flash", "--port", PORT, image])
}

fn said(output: &Output) -> String {
    [&output.stdout[..], &output.stderr]
        .map(|it| String::from_utf8_lossy(it).into_owned())
        .concat()
}

/// The checksum that the build wrote into a file, as four digits.
fn checksum(image: &Path) -> String {
    let output = Command::new(program())
        .args(["flash", "--dry-run", "--port", "none"])
        .arg(image)
        .output()
        .unwrap();
    let text = said(&output);
    let digits = text.split("checksum ").nth(1).expect(&text);
    digits[..4].to_owned()
}

#[test]
fn an_erased_board_gets_the_image_and_says_its_checksum() {
    let Some(image) = image() else {
        return;
    };
    let board = erased(&[]);
    for _ in 0..2 {
        // The second time over a program that runs and talks.
        let output = flash(&board, &image);
        let text = said(&output);
        assert!(output.status.success(), "{text}");
        assert!(text.contains("has the same checksum"), "{text}");
        assert!(text.contains(&checksum(&image)), "{text}");
    }
}

/// One byte of the image is another than at the build: the board finds another checksum.
#[test]
fn an_image_that_is_not_as_it_was_built_is_told() {
    let Some(image) = image() else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(&image).unwrap();
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    // A line of the texts, which nobody executes; its own checksum is right again.
    let at = lines
        .iter()
        .position(|line| line.contains("656D657267656E6379")) // "emergency"
        .unwrap_or(lines.len() / 2);
    let line = &lines[at];
    let mut bytes: Vec<u8> = (1..line.trim_end().len() - 2)
        .step_by(2)
        .map(|place| u8::from_str_radix(&line[place..place + 2], 16).unwrap())
        .collect();
    *bytes.last_mut().unwrap() ^= 1;
    let sum = bytes.iter().fold(0_u8, |sum, &byte| sum.wrapping_add(byte));
    let digits: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    lines[at] = format!(":{}{:02X}", digits.concat(), sum.wrapping_neg());
    let changed = folder.path().join("changed.hex");
    fs::write(&changed, lines.join("\n") + "\n").unwrap();
    let board = erased(&[]);
    let output = flash(&board, &changed);
    let text = said(&output);
    assert!(!output.status.success(), "{text}");
    assert!(
        text.contains(&format!("instead of {}", checksum(&image))),
        "{text}"
    );
}

#[test]
fn a_board_that_does_not_answer_leaves_a_sentence() {
    let Some(image) = image() else {
        return;
    };
    let board = erased(&["--fault", "unplugged@0"]);
    let output = flash(&board, &image);
    let text = said(&output);
    assert!(!output.status.success(), "{text}");
    assert!(text.contains("no bootloader answered"), "{text}");
    assert!(text.contains("nothing was written"), "{text}");
}

/// A file of another program is refused before the port is opened.
#[test]
fn what_is_no_image_is_refused_and_nothing_is_opened() {
    let folder = tempfile::tempdir().unwrap();
    let other = folder.path().join("blink.hex");
    fs::write(&other, ":0400000001020304F2\n:00000001FF\n").unwrap();
    let output = Command::new(program())
        .args(["flash", "--port", "/dev/no-such-port"])
        .arg(&other)
        .output()
        .unwrap();
    let text = said(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(
        text.contains("blink.hex") && text.contains("complete softrig firmware"),
        "{text}"
    );
}

#[test]
fn a_port_that_is_not_there_is_a_wrong_argument() {
    let Some(image) = image() else {
        return;
    };
    let output = Command::new(program())
        .args(["flash", "--port", "/dev/no-such-port"])
        .arg(image)
        .output()
        .unwrap();
    let text = said(&output);
    assert_eq!(output.status.code(), Some(2), "{text}");
    assert!(text.contains("is not there"), "{text}");
}
