//! Files of test protocols for the board, written by users and `softrig plan`.
//!
//! A file lists segments as in [`wire::protocol::Segment`], with units in the names
//! of the keys. Errors are reported with line and column before anything is sent to a
//! board.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use toml_edit::{Item, Table};
use wire::decimal::Hundredths;
use wire::protocol::{
    ControlMode, InvalidProgram, MAX_DURATION_MS, MAX_REPEATS, MAX_SEGMENTS, Named, Program,
    Segment, check, total_ms,
};

use crate::error::{InputError, line_of};
use crate::setup::Setup;
use crate::toml_reader::Reader;

/// The schema number that this version reads and writes.
const SCHEMA: i64 = 1;

/// A protocol with its name.
#[derive(Clone, Debug, PartialEq)]
pub struct ProtocolFile {
    /// Name for recordings.
    pub name: String,
    /// Its purpose, in one line; may be empty.
    pub title: String,
    /// The protocol that the board knows by name, if it is one.
    pub named: Option<Named>,
    /// The setup in which it is played; unchanged where nothing is said.
    pub setup: Setup,
    /// Its segments, in order.
    pub segments: Vec<Segment>,
    /// Where it was read from.
    pub path: Option<PathBuf>,
    /// Line of each segment in the file, from 1.
    lines: Vec<u64>,
}

/// A segment as played, with repeats expanded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Played {
    /// Its place in the protocol, from 0.
    pub index: usize,
    /// When it begins (ms).
    pub start_ms: u32,
    /// The segment; never a repeat.
    pub segment: Segment,
}

impl ProtocolFile {
    /// A protocol that no board knows by name.
    pub fn new(name: String, title: String, segments: Vec<Segment>) -> Self {
        Self {
            name,
            title,
            named: None,
            setup: Setup::default(),
            lines: vec![0; segments.len()],
            segments,
            path: None,
        }
    }

    /// A protocol that every board knows.
    pub fn named(named: Named) -> Self {
        let segments: Vec<Segment> = (0..MAX_SEGMENTS)
            .map_while(|index| named.segment(index))
            .collect();
        Self {
            name: named.name().to_owned(),
            title: named.title().to_owned(),
            named: Some(named),
            setup: Setup::default(),
            lines: vec![0; segments.len()],
            segments,
            path: None,
        }
    }

    /// Finds a protocol: the name of one that every board knows, or a file.
    ///
    /// # Errors
    ///
    /// Names the protocols that exist, or the fault in the file.
    pub fn find(name_or_path: &str) -> Result<Self, InputError> {
        if let Some(named) = Named::parse(name_or_path.as_bytes()) {
            return Ok(Self::named(named));
        }
        let path = Path::new(name_or_path);
        let is_file = path.exists() || path.extension().is_some() || path.components().count() > 1;
        if is_file {
            return Self::read(path);
        }
        let names: Vec<&str> = Named::ALL.iter().map(|named| named.name()).collect();
        Err(InputError::new(
            format!("there is no protocol \"{name_or_path}\""),
            format!("name a file (.toml) or one of: {}", names.join(", ")),
        ))
    }

    /// Reads and checks a file.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = crate::bounded::read_text(path)?;
        Self::parse(&text, path)
    }

    /// Parses the text of a file; `path` names it in messages.
    ///
    /// # Errors
    ///
    /// Like [`ProtocolFile::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        ProtocolReader {
            toml: Reader { text, path },
        }
        .read()
    }

    /// The text of a file that reads back as this protocol.
    pub fn to_text(&self) -> String {
        let mut text = format!("schema = {SCHEMA}\nname = {}\n", quoted(&self.name));
        if !self.title.is_empty() {
            let _ = writeln!(text, "title = {}", quoted(&self.title));
        }
        let setup = self.setup.to_toml();
        if !setup.is_empty() {
            let _ = write!(text, "\n[setup]\n{setup}");
        }
        for segment in &self.segments {
            text += "\n[[segment]]\n";
            write_segment(&mut text, segment);
        }
        text
    }

    /// The same for a rig in this setup.
    #[must_use]
    pub fn standing(self, setup: Setup) -> Self {
        Self { setup, ..self }
    }

    /// How long it takes (ms).
    pub fn total_ms(&self) -> u32 {
        total_ms(&self.segments[..])
    }

    /// The played segments with their times, repeats expanded.
    pub fn played(&self) -> Vec<Played> {
        let mut played: Vec<Played> = Vec::new();
        let mut start_ms = 0u32;
        let mut push = |index: usize, segment: Segment| {
            played.push(Played {
                index,
                start_ms,
                segment,
            });
            start_ms = start_ms.saturating_add(segment.duration_ms());
        };
        for (index, &segment) in self.segments.iter().enumerate() {
            if let Segment::Repeat { from, times } = segment {
                for _ in 0..times {
                    for (offset, &again) in
                        self.segments[usize::from(from)..index].iter().enumerate()
                    {
                        push(usize::from(from) + offset, again);
                    }
                }
            } else {
                push(index, segment);
            }
        }
        played
    }

    /// An error about a segment, with its line if it is in a file.
    pub fn fault_at(
        &self,
        index: usize,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> InputError {
        let found = format!("segment {}: {}", index + 1, found.into());
        match &self.path {
            Some(path) => InputError::new(found, advice)
                .in_file(path)
                .at_line(self.lines.get(index).copied().unwrap_or(1)),
            None => InputError::new(format!("protocol {}, {found}", self.name), advice),
        }
    }
}

/// One line about a segment, for people.
pub fn describe(segment: &Segment) -> String {
    let seconds = |ms: u32| f64::from(ms) / 1000.0;
    let level = |mode: ControlMode, level: Hundredths| {
        let value = f64::from(level.0) / 100.0;
        match mode {
            ControlMode::Pressure => format!("{value} kPa"),
            ControlMode::AngleOpenLoop => format!("{value}° open loop"),
            ControlMode::AngleClosedLoop => format!("{value}° closed loop"),
        }
    };
    match *segment {
        Segment::Step {
            mode,
            level: to,
            duration_ms,
        } => format!("step to {}, {} s", level(mode, to), seconds(duration_ms)),
        Segment::Ramp {
            mode,
            level: to,
            duration_ms,
        } => format!("ramp to {} in {} s", level(mode, to), seconds(duration_ms)),
        Segment::Multisine {
            mode,
            centre,
            amplitude,
            period_ms,
            duration_ms,
        } => format!(
            "multisine about {} by up to {}, base period {} s, {} s",
            level(mode, centre),
            f64::from(amplitude.0) / 100.0,
            seconds(period_ms),
            seconds(duration_ms)
        ),
        Segment::Hold { duration_ms } => format!("pump stopped, {} s", seconds(duration_ms)),
        Segment::Release { duration_ms } => format!("release, {} s", seconds(duration_ms)),
        Segment::Repeat { from, times } => {
            format!("again from segment {}, {times} times", from + 1)
        }
    }
}

fn quoted(text: &str) -> String {
    toml_edit::Value::from(text).to_string().trim().to_owned()
}

/// Exact: the board's hundredths and milliseconds are written as decimals.
fn write_segment(text: &mut String, segment: &Segment) {
    let number = |value: i64, per_unit: i64, digits: usize| {
        let sign = if value < 0 { "-" } else { "" };
        let (whole, rest) = (value.abs() / per_unit, value.abs() % per_unit);
        let fraction = format!("{rest:0digits$}");
        let fraction = fraction.trim_end_matches('0');
        format!(
            "{sign}{whole}.{}",
            if fraction.is_empty() { "0" } else { fraction }
        )
    };
    let hundredths = |value: Hundredths| number(i64::from(value.0), 100, 2);
    let seconds = |ms: u32| number(i64::from(ms), 1000, 3);
    let (kind, duration_ms) = match segment {
        Segment::Step { duration_ms, .. } => ("step", Some(*duration_ms)),
        Segment::Ramp { duration_ms, .. } => ("ramp", Some(*duration_ms)),
        Segment::Multisine { duration_ms, .. } => ("multisine", Some(*duration_ms)),
        Segment::Hold { duration_ms } => ("hold", Some(*duration_ms)),
        Segment::Release { duration_ms } => ("release", Some(*duration_ms)),
        Segment::Repeat { .. } => ("repeat", None),
    };
    let _ = writeln!(text, "kind = \"{kind}\"");
    if let Some(mode) = segment.mode() {
        let _ = writeln!(text, "track = \"{}\"", mode_name(mode));
    }
    match *segment {
        Segment::Step { mode, level, .. } | Segment::Ramp { mode, level, .. } => {
            let _ = writeln!(text, "level_{} = {}", unit(mode), hundredths(level));
        }
        Segment::Multisine {
            mode,
            centre,
            amplitude,
            period_ms,
            ..
        } => {
            let unit = unit(mode);
            let _ = writeln!(text, "centre_{unit} = {}", hundredths(centre));
            let _ = writeln!(text, "amplitude_{unit} = {}", hundredths(amplitude));
            let _ = writeln!(text, "period_s = {}", seconds(period_ms));
        }
        Segment::Repeat { from, times } => {
            let _ = writeln!(text, "from = {}\ntimes = {times}", from + 1);
        }
        Segment::Hold { .. } | Segment::Release { .. } => {}
    }
    if let Some(duration_ms) = duration_ms {
        let _ = writeln!(text, "duration_s = {}", seconds(duration_ms));
    }
}

pub(crate) const CONTROL_MODES: [(ControlMode, &str); 3] = [
    (ControlMode::Pressure, "pressure"),
    (ControlMode::AngleOpenLoop, "angle_open_loop"),
    (ControlMode::AngleClosedLoop, "angle_closed_loop"),
];

const KINDS: [&str; 6] = ["step", "ramp", "multisine", "hold", "release", "repeat"];

fn mode_name(mode: ControlMode) -> &'static str {
    CONTROL_MODES
        .iter()
        .find(|(known, _)| *known == mode)
        .map_or("", |(_, name)| name)
}

pub(crate) fn unit(mode: ControlMode) -> &'static str {
    match mode {
        ControlMode::Pressure => "kpa",
        ControlMode::AngleOpenLoop | ControlMode::AngleClosedLoop => "deg",
    }
}

struct ProtocolReader<'a> {
    toml: Reader<'a>,
}

impl ProtocolReader<'_> {
    fn read(&self) -> Result<ProtocolFile, InputError> {
        let document = self.toml.parse()?;
        let root = document.as_table();
        self.toml.known_keys(
            root,
            "the protocol",
            &["schema", "name", "title", "setup", "segment"],
        )?;
        self.toml.schema(root, SCHEMA)?;
        let stem = self
            .toml
            .path
            .file_stem()
            .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        let name = self.toml.string(root, "name")?.unwrap_or(stem);
        let title = self.toml.string(root, "title")?.unwrap_or_default();
        let tables = self.toml.sections(root, "segment")?;
        // Nothing else that is wrong with thousands of them would help.
        if let Some(first) = tables.get(usize::from(MAX_SEGMENTS)) {
            return Err(self.toml.fail_at(
                first.span(),
                InvalidProgram::TooLong.to_string(),
                "shorten it with a repeat, or split it into two protocols",
            ));
        }
        let segments = tables
            .iter()
            .map(|table| self.segment(table))
            .collect::<Result<Vec<_>, _>>()?;
        let lines = tables
            .iter()
            .map(|table| {
                let start = table.span().map_or(0, |span| span.start);
                line_of(self.toml.text, start)
            })
            .collect();
        check(&segments[..]).map_err(|error| {
            let (span, advice) = match error {
                InvalidProgram::Repeat { index } => (
                    tables
                        .get(usize::from(index))
                        .and_then(|table| table.get("from"))
                        .and_then(Item::span),
                    "let `from` name an earlier segment, counted from 1, behind any other repeat",
                ),
                _ => (None, "add a section [[segment]] with kind = \"step\""),
            };
            let found = match error {
                InvalidProgram::Repeat { index } => format!(
                    "segment {}: a repeat must go back, and not over another repeat",
                    index + 1
                ),
                other => other.to_string(),
            };
            self.toml.fail_at(span, found, advice)
        })?;
        Ok(ProtocolFile {
            name,
            title,
            named: None,
            setup: self.toml.setup(root)?.unwrap_or_default(),
            segments,
            path: Some(self.toml.path.to_owned()),
            lines,
        })
    }

    fn segment(&self, table: &Table) -> Result<Segment, InputError> {
        let kind = self.toml.string(table, "kind")?.ok_or_else(|| {
            self.toml.fail_at(
                table.span(),
                "[[segment]] has no kind",
                format!("add kind = \"…\", one of: {}", KINDS.join(", ")),
            )
        })?;
        if !KINDS.contains(&kind.as_str()) {
            return Err(self.toml.fail_at(
                table.get("kind").and_then(Item::span),
                format!("\"{kind}\" is not a kind of segment"),
                format!("use one of: {}", KINDS.join(", ")),
            ));
        }
        let mode = match kind.as_str() {
            "step" | "ramp" | "multisine" => Some(self.mode(table)?),
            _ => None,
        };
        let keys: Vec<String> = match (kind.as_str(), mode.map(unit)) {
            ("multisine", Some(unit)) => vec![
                "kind".into(),
                "track".into(),
                format!("centre_{unit}"),
                format!("amplitude_{unit}"),
                "period_s".into(),
                "duration_s".into(),
            ],
            (_, Some(unit)) => vec![
                "kind".into(),
                "track".into(),
                format!("level_{unit}"),
                "duration_s".into(),
            ],
            ("repeat", _) => vec!["kind".into(), "from".into(), "times".into()],
            _ => vec!["kind".into(), "duration_s".into()],
        };
        let keys: Vec<&str> = keys.iter().map(String::as_str).collect();
        self.toml.known_keys(table, &format!("a {kind}"), &keys)?;
        let level = |name: &str| {
            let unit = mode.map_or("", unit);
            self.level(table, &format!("{name}_{unit}"))
        };
        let duration = || self.duration(table, "duration_s");
        Ok(match (kind.as_str(), mode) {
            ("step", Some(mode)) => Segment::Step {
                mode,
                level: level("level")?,
                duration_ms: duration()?,
            },
            ("ramp", Some(mode)) => Segment::Ramp {
                mode,
                level: level("level")?,
                duration_ms: duration()?,
            },
            ("multisine", Some(mode)) => Segment::Multisine {
                mode,
                centre: level("centre")?,
                amplitude: level("amplitude")?,
                period_ms: self.duration(table, "period_s")?,
                duration_ms: duration()?,
            },
            ("hold", _) => Segment::Hold {
                duration_ms: duration()?,
            },
            ("release", _) => Segment::Release {
                duration_ms: duration()?,
            },
            _ => Segment::Repeat {
                from: self.whole(table, "from", 1, MAX_SEGMENTS)? - 1,
                times: self.whole(table, "times", 1, MAX_REPEATS)?,
            },
        })
    }

    fn mode(&self, table: &Table) -> Result<ControlMode, InputError> {
        let names: Vec<&str> = CONTROL_MODES.iter().map(|(_, name)| *name).collect();
        let item = table.get("track").ok_or_else(|| {
            self.toml.fail_at(
                table.span(),
                "the segment does not say what is tracked",
                format!("add track = \"…\", one of: {}", names.join(", ")),
            )
        })?;
        CONTROL_MODES
            .iter()
            .find(|(_, name)| item.as_str() == Some(name))
            .map(|(mode, _)| *mode)
            .ok_or_else(|| {
                self.toml.fail_at(
                    item.span(),
                    format!("{} cannot be tracked", item.to_string().trim()),
                    format!("use one of: {}", names.join(", ")),
                )
            })
    }

    fn number(&self, table: &Table, key: &str) -> Result<f64, InputError> {
        self.toml.number(table, key)?.ok_or_else(|| {
            self.toml.fail_at(
                table.span(),
                format!("the segment has no {key}"),
                format!("add `{key} = …` to it"),
            )
        })
    }

    fn level(&self, table: &Table, key: &str) -> Result<Hundredths, InputError> {
        let value = self.number(table, key)?;
        if (-1000.0..=1000.0).contains(&value) {
            #[allow(clippy::cast_possible_truncation)] // Within 100 000.
            return Ok(Hundredths((value * 100.0).round() as i32));
        }
        Err(self.toml.fail_at(
            table.get(key).and_then(Item::span),
            format!("{key} is {value}"),
            "give a level from -1000 to 1000; the board's own limits are narrower",
        ))
    }

    fn duration(&self, table: &Table, key: &str) -> Result<u32, InputError> {
        let value = self.number(table, key)?;
        let ms = (value * 1000.0).round();
        if (1.0..=f64::from(MAX_DURATION_MS)).contains(&ms) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Checked.
            return Ok(ms as u32);
        }
        Err(self.toml.fail_at(
            table.get(key).and_then(Item::span),
            format!("{key} is {value}"),
            "give a time from 0.001 to 3600 seconds",
        ))
    }

    fn whole(&self, table: &Table, key: &str, low: u8, high: u8) -> Result<u8, InputError> {
        let value = self.number(table, key)?;
        if value.fract() == 0.0 && (f64::from(low)..=f64::from(high)).contains(&value) {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Checked.
            return Ok(value as u8);
        }
        Err(self.toml.fail_at(
            table.get(key).and_then(Item::span),
            format!("{key} is {value}"),
            format!("give a whole number from {low} to {high}"),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<ProtocolFile, InputError> {
        ProtocolFile::parse(text, Path::new("p.toml"))
    }

    #[test]
    fn every_named_protocol_survives_its_file() {
        for &named in Named::ALL {
            let protocol = ProtocolFile::named(named);
            let back = parse(&protocol.to_text()).unwrap();
            assert_eq!(back.segments, protocol.segments);
            assert_eq!(back.name, protocol.name);
            assert_eq!(back.title, protocol.title);
        }
    }

    #[test]
    fn the_played_list_agrees_with_the_boards_playback() {
        use wire::protocol::{Playback, Reference};
        for &named in Named::ALL {
            let protocol = ProtocolFile::named(named);
            let played = protocol.played();
            let last = played.last().unwrap();
            assert_eq!(
                last.start_ms + last.segment.duration_ms(),
                protocol.total_ms()
            );
            let mut playback = Playback::new();
            let mut time = 0;
            while playback.reference(&named) != Reference::Done {
                let now = played
                    .iter()
                    .rev()
                    .find(|part| part.start_ms <= time)
                    .unwrap();
                assert_eq!(
                    now.index,
                    usize::from(playback.index()),
                    "{named:?} at {time}"
                );
                playback.advance(&named, 50);
                time += 50;
            }
        }
    }

    #[test]
    fn faults_name_line_and_column() {
        let head = "schema = 1\n[[segment]]\nkind = \"step\"\ntrack = \"pressure\"\n";
        for (text, parts) in [
            ("schema = 1\n".to_owned(), vec!["p.toml", "no segments"]),
            (
                "schema = 2\n".into(),
                vec!["line 1, column 10", "schema is 2"],
            ),
            ("schema = \n".into(), vec!["line 1"]),
            (
                format!("{head}level_deg = 3\nduration_s = 1\n"),
                vec!["line 5, column 1", "level_deg", "level_kpa"],
            ),
            (
                format!("{head}level_kpa = \"3\"\nduration_s = 1\n"),
                vec!["line 5, column 13", "level_kpa is not a number"],
            ),
            (
                format!("{head}level_kpa = 3\nduration_s = 0\n"),
                vec!["line 6, column 14", "duration_s is 0"],
            ),
            (
                format!("{head}level_kpa = 3\n"),
                vec!["line 2", "no duration_s"],
            ),
            (
                format!("{head}level_kpa = 3\nduration_s = 1\n[[segment]]\nkind = \"jump\"\n"),
                vec!["line 8, column 8", "\"jump\"", "multisine"],
            ),
            (
                format!(
                    "{head}level_kpa = 3\nduration_s = 1\n[[segment]]\nkind = \"repeat\"\nfrom = 2\ntimes = 1\n"
                ),
                vec!["line 9, column 8", "segment 2", "must go back"],
            ),
            (
                format!("{head}level_kpa = 3\nduration_s = 1\n[setup]\ntilt = 3\n"),
                vec!["line 7", "tilt", "known are tilt_deg"],
            ),
            (
                format!("{head}level_kpa = 3\nduration_s = 1\n[setup]\ntip_load_g = -3\n"),
                vec!["line 7", "tip_load_g = -3 g"],
            ),
            (
                "schema = 1\n[[segment]]\nkind = \"step\"\ntrack = \"angle\"\n".into(),
                vec!["line 4, column 9", "angle_open_loop"],
            ),
        ] {
            let message = parse(&text).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{part:?} not in {message:?}");
            }
        }
    }

    #[test]
    fn a_protocol_that_is_neither_name_nor_file_lists_the_names() {
        let message = ProtocolFile::find("papre").unwrap_err().to_string();
        assert!(
            message.contains("papre") && message.contains("paper, steps"),
            "{message}"
        );
    }

    proptest! {
        #[test]
        fn any_segments_survive_their_file(
            level in -100_000..=100_000i32, amplitude in 0..=100_000i32,
            duration_ms in 1..=MAX_DURATION_MS, period_ms in 1..=MAX_DURATION_MS, times in 1..=MAX_REPEATS,
            tilt in prop::option::of(-360.0..360.0),
            mode in prop::sample::select(&[ControlMode::Pressure, ControlMode::AngleOpenLoop, ControlMode::AngleClosedLoop][..]),
        ) {
            let level = Hundredths(level);
            let segments = vec![
                Segment::Step { mode, level, duration_ms },
                Segment::Ramp { mode, level, duration_ms },
                Segment::Multisine { mode, centre: level, amplitude: Hundredths(amplitude), period_ms, duration_ms },
                Segment::Hold { duration_ms },
                Segment::Release { duration_ms },
                Segment::Repeat { from: 1, times },
            ];
            let protocol = ProtocolFile {
                name: "a \"name\"".into(), title: String::new(), named: None,
                setup: Setup { tilt_deg: tilt, ..Setup::default() },
                lines: Vec::new(), path: None, segments: segments.clone(),
            };
            let back = parse(&protocol.to_text()).unwrap();
            prop_assert_eq!(back.segments, segments);
            prop_assert_eq!(back.setup, protocol.setup);
        }

        #[test]
        fn any_text_is_an_error_or_a_protocol(text in "[a-z0-9=\\[\\]\" \n._-]{0,120}") {
            let _ = parse(&text);
            let _ = parse(&format!("schema = 1\n[[segment]]\n{text}"));
        }
    }
}
