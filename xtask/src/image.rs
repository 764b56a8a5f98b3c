//! Writes into an image how long it is and what its checksum is, so that the board knows whether
//! it was uploaded as a whole (`firmware/src/board/image.rs`).

use std::{fs, path::Path, process::Command};

use crate::shell::{Outcome, run};

#[allow(dead_code)] // All that the board needs of it.
#[path = "../../wire/src/checksum.rs"]
mod checksum;

#[path = "../../wire/src/stamp.rs"]
pub mod stamp;

use checksum::Crc16;
use stamp::{MARK, STAMP_BYTES};

/// Stamps the image. What is stamped already gets the same again.
pub fn stamp(image: &Path) -> Outcome {
    let cannot =
        |what: &str, path: &Path, error| format!("cannot {what} {}: {error}", path.display());
    let flash_path = image.with_extension("bin");
    run(Command::new("avr-objcopy")
        .args(["-O", "binary", "-R", ".eeprom", "--gap-fill", "0xff"])
        .args([image, flash_path.as_path()]))?;
    let flash = fs::read(&flash_path).map_err(|error| cannot("read", &flash_path, error))?;
    let mut file = fs::read(image).map_err(|error| cannot("read", image, error))?;
    let stamp = stamp_of(&flash)?;
    let at = place(&file)?;
    if file[at..at + STAMP_BYTES] == stamp {
        return Ok(());
    }
    file[at..at + STAMP_BYTES].copy_from_slice(&stamp);
    // In place: cargo keeps a second link to the file.
    fs::write(image, file).map_err(|error| cannot("write", image, error).into())
}

/// The stamp of the flash of an image. It covers all but itself.
fn stamp_of(flash: &[u8]) -> Outcome<[u8; STAMP_BYTES]> {
    let at = place(flash)?;
    let mut crc = Crc16::new();
    for &byte in flash[..at].iter().chain(&flash[at + STAMP_BYTES..]) {
        crc.update(byte);
    }
    let length = u32::try_from(flash.len()).map_err(|_| "the image is too long")?;
    let mut stamp = [0; STAMP_BYTES];
    stamp[..4].copy_from_slice(&length.to_le_bytes());
    stamp[4..].copy_from_slice(&crc.value().to_le_bytes());
    Ok(stamp)
}

/// Where the stamp is.
fn place(bytes: &[u8]) -> Outcome<usize> {
    let mut found = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(&MARK));
    match (found.next(), found.next()) {
        (Some(at), None) if at + MARK.len() + STAMP_BYTES <= bytes.len() => Ok(at + MARK.len()),
        _ => Err(
            "the image has no place for its checksum, or several: see firmware/src/board/image.rs"
                .into(),
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_covers_all_but_itself() {
        let image = |code: u8, stamp: [u8; STAMP_BYTES]| {
            [&[code; 3], &MARK[..], &stamp[..], &[7; 4]].concat()
        };
        let stamp = stamp_of(&image(1, [0xff; STAMP_BYTES])).unwrap();
        assert_eq!(stamp_of(&image(1, stamp)).unwrap(), stamp);
        assert_eq!(stamp[..4], 23_u32.to_le_bytes());
        assert_ne!(stamp_of(&image(2, stamp)).unwrap(), stamp);
        assert!(stamp_of(b"softrigCRC").is_err());
        assert!(stamp_of(&[image(1, stamp), image(1, stamp)].concat()).is_err());
    }
}
