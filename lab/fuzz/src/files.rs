//! Files that people and other programs write.

use std::path::Path;

use softrig_formats::{
    columns::Layout,
    error::InputError,
    model_file::ModelFile,
    protocol_file::ProtocolFile,
    recording::{Recording, to_csv},
};

/// Longer texts make a fuzzer slow and show nothing new.
const LONGEST: usize = 16_384;

fn text(bytes: &[u8]) -> Option<&str> {
    std::str::from_utf8(bytes)
        .ok()
        .filter(|text| text.len() <= LONGEST)
}

/// A message names the file and a place in it.
fn points_into(error: &InputError, path: &Path, text: &str) {
    assert_eq!(error.file.as_deref(), Some(path), "{error}");
    assert!(
        !error.found.is_empty() && !error.advice.is_empty(),
        "{error}"
    );
    let Some(line) = error.line else {
        return;
    };
    // What is missing at the end of a file is missing on the line that would follow.
    let lines = text.split('\n').count() as u64;
    assert!((1..=lines).contains(&line), "{error}: {lines} lines");
    let Some(column) = error.column.as_deref().and_then(|name| name.parse().ok()) else {
        return;
    };
    let index = usize::try_from(line).unwrap_or(usize::MAX) - 1;
    let length = text
        .split('\n')
        .nth(index)
        .map_or(0, |line| line.chars().count());
    let column: usize = column;
    assert!(
        (1..=length + 1).contains(&column),
        "{error}: {length} characters"
    );
}

/// Recordings, in any format that is read.
///
/// # Panics
///
/// When a recording is accepted that is none (times that do not increase, numbers that
/// are none, columns of different length), when one that was read and written reads
/// back with other numbers than four decimals make of them, or when a message points
/// outside the file.
pub fn recording(bytes: &[u8]) {
    softrig_importers::install();
    let path = Path::new("run.csv");
    if bytes.len() > LONGEST {
        return;
    }
    let (read, _) = match Recording::parse_bytes(bytes, path, &Layout::default()) {
        Ok(read) => read,
        Err(error) => {
            assert_eq!(error.file.as_deref(), Some(path), "{error}");
            // Columns of a table have names, so that only the line is looked at; UTF-16 has no
            // fewer such bytes than lines.
            let lines = bytes.split(|byte| b"\n\r".contains(byte)).count() as u64;
            assert!(
                error.line.is_none_or(|line| (1..=lines).contains(&line)),
                "{error}"
            );
            return;
        }
    };
    let count = read.len();
    assert!(count >= 2 && read.pressure.len() == count && read.angle.len() == count);
    assert!(read.extra.iter().all(|column| column.fields.len() == count));
    assert!(read.time.windows(2).all(|pair| pair[0] < pair[1]));
    let numbers = [&read.time, &read.pressure, &read.angle];
    assert!(
        numbers
            .iter()
            .all(|list| list.iter().all(|x| x.is_finite()))
    );
    // Times are written to the microsecond: those of a real recording differ by more.
    let is_coarse = read.time.windows(2).all(|pair| pair[1] - pair[0] > 2e-6);
    let is_small = read.time.iter().all(|time| time.abs() < 1e9);
    if !is_coarse || !is_small {
        return;
    }
    let written = to_csv(&read, &[]);
    let again = match Recording::parse(&written, path) {
        Ok((again, _)) => again,
        Err(error) => panic!("what was written is not read: {error}"),
    };
    assert_eq!(again.len(), count);
    for (before, after, within) in [
        (&read.time, &again.time, 1e-6),
        (&read.pressure, &again.pressure, 0.06),
        (&read.angle, &again.angle, 1e-6),
    ] {
        for (before, after) in before.iter().zip(after) {
            let room = within + 1e-12 * before.abs();
            assert!((before - after).abs() <= room, "{before} became {after}");
        }
    }
    assert_eq!(to_csv(&again, &[]), written);
}

/// Model files.
///
/// # Panics
///
/// When a model that was read and written reads back another, or a message points
/// outside the file.
pub fn model(bytes: &[u8]) {
    let path = Path::new("model.toml");
    let Some(text) = text(bytes) else {
        return;
    };
    let file = match ModelFile::parse(text, path) {
        Ok(file) => file,
        Err(error) => return points_into(&error, path, text),
    };
    // Numbers are written with seven digits, so that the second time nothing changes.
    let written = file.text_with(&file.model, "");
    let again = match ModelFile::parse(&written, path) {
        Ok(again) => again,
        Err(error) => panic!("what was written is not read: {error}\n{written}"),
    };
    assert_eq!(again.text_with(&again.model, ""), written);
    assert_eq!(again.free, file.free);
    assert_eq!(again.actuator, file.actuator);
    let kinds =
        |file: &ModelFile| -> Vec<_> { file.model.effects().map(|effect| effect.kind()).collect() };
    assert_eq!(kinds(&again), kinds(&file));
}

/// Protocol files.
///
/// # Panics
///
/// When a protocol that was read and written reads back another, or a message points
/// outside the file.
pub fn protocol(bytes: &[u8]) {
    let path = Path::new("protocol.toml");
    let Some(text) = text(bytes) else {
        return;
    };
    let file = match ProtocolFile::parse(text, path) {
        Ok(file) => file,
        Err(error) => return points_into(&error, path, text),
    };
    assert!(!file.played().is_empty() && wire::protocol::check(&file.segments[..]).is_ok());
    let written = file.to_text();
    let again = match ProtocolFile::parse(&written, path) {
        Ok(again) => again,
        Err(error) => panic!("what was written is not read: {error}\n{written}"),
    };
    assert_eq!(again.segments, file.segments);
    assert_eq!((&again.name, &again.title), (&file.name, &file.title));
    assert_eq!(again.to_text(), written);
}
