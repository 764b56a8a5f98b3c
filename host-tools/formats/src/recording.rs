//! Recordings: reading, checking and writing them.
//!
//! A recording is a table with the columns `time_s`, `pressure_kpa` and `angle_deg`;
//! others are optional and kept. Formats and columns are handled by [`crate`]. Inside,
//! everything is SI and radians. Every problem of a file is reported with its line and
//! column, because a fit to a damaged recording names a wrong cause with great confidence.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use statrs::statistics::{Data, OrderStatistics};

use crate::bounded::{Limits, read_text};
use crate::columns::{Columns, Layout, Quantity};
use crate::error::InputError;
use crate::formats::{self, Samples};
use crate::left_out::{LeftOut, Lines, What};
use crate::measurand::Measurand;
use crate::removed::{Channel, Removed, Why, bridge};
use crate::setup::Setup;

/// Pascals in a kilopascal.
pub const PASCAL_PER_KPA: f64 = 1000.0;

/// A sampling interval this many times the median one is a gap.
pub const GAP_FACTOR: f64 = 3.0;

/// Columns that every recording has.
const REQUIRED: [&str; 3] = ["time_s", "pressure_kpa", "angle_deg"];

/// A recorded run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Recording {
    /// File name without folder and extension.
    pub name: String,
    /// Where it was read from.
    pub path: PathBuf,
    /// Time of each sample (s), strictly increasing.
    pub time: Vec<f64>,
    /// Gauge pressure (Pa).
    pub pressure: Vec<f64>,
    /// Bending angle (rad) as the sensor shows it.
    pub angle: Vec<f64>,
    /// Other columns, as in the file.
    pub extra: Vec<Column>,
    /// The layout of its columns, given by the user or by the file.
    pub columns: Columns,
    /// Its metadata.
    pub meta: Meta,
    /// Samples, in order, at which the clock begins again: a board that was reset, the next run in
    /// the same file. What happened in between is unknown; `time` goes on after
    /// [a pause](pause_s).
    pub breaks: Vec<usize>,
    /// The times as in the file (s), where `time` was reconstructed from them.
    pub stamps: Option<Vec<f64>>,
    /// Where the samples are in the file.
    pub lines: Lines,
    /// What was left out of the file or changed, and is in no warning.
    pub left_out: Vec<LeftOut>,
    /// Samples that are not believed; a straight line replaces them.
    pub removed: Vec<Removed>,
    /// What the output is, where it is not an angle.
    pub measurand: Measurand,
}

/// The pause (s) on the time axis where the clock begins again, for a usual interval (s): longer
/// than any gap across which a motion is followed.
pub fn pause_s(interval: f64) -> f64 {
    const LEAST_S: f64 = 10.0;
    const INTERVALS: f64 = 100.0;
    LEAST_S.max(INTERVALS * interval)
}

/// An optional column, kept as text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Column {
    /// Header.
    pub name: String,
    /// One field a sample.
    pub fields: Vec<String>,
}

/// Metadata from `NAME.meta.toml`. Every field is optional; keys that are not
/// listed here are ignored.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Meta {
    /// Name of the protocol that was run.
    pub protocol: Option<String>,
    /// That protocol, as it was sent to the board.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub segments: Vec<String>,
    /// Number of the repeat of that protocol, from 1.
    #[serde(default, deserialize_with = "whole")]
    pub repeat: Option<u32>,
    /// Set-point of a step test (°).
    pub setpoint_deg: Option<f64>,
    /// Whether the recording was simulated.
    pub simulated: Option<bool>,
    /// When the recording began, or the recording that it was cut from
    /// (RFC 3339, UTC).
    #[serde(default, deserialize_with = "text_or_date")]
    pub started: Option<String>,
    /// The board's own clock at time 0 (s since its reset). In a file that was
    /// cut from a recording: at time 0 of that recording.
    pub uptime_s: Option<f64>,
    /// File name of the recording that this one was cut from.
    pub part_of: Option<String>,
    /// Where this file's time 0 is on the time axis of `part_of` (s).
    pub begins_s: Option<f64>,
    /// The parts of a session that count as runs, in the order of time. They do
    /// not overlap.
    #[serde(default)]
    pub segment: Vec<SegmentMeta>,
    /// The angles between which the angle sensor was calibrated (°).
    pub angle_range_deg: Option<[f64; 2]>,
    /// How well the sensors' zeros are known.
    pub calibration: Option<CalibrationMeta>,
    /// An error of the model below this does not matter (°).
    pub tolerance_deg: Option<f64>,
    /// How the rig stood.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setup: Option<Setup>,
    /// Whether it was recorded to its end.
    pub complete: Option<bool>,
    /// Rows that were written; none while it is recorded.
    #[serde(default, deserialize_with = "whole")]
    pub samples: Option<u64>,
}

/// One run within a session: a rest, what was asked for, and its release.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SegmentMeta {
    /// Time of its first sample (s), on the file's own time axis.
    pub from_s: f64,
    /// Its end (s), on the same axis: samples before it belong to the segment,
    /// a sample at it belongs to the next one.
    pub to_s: f64,
    /// Set-point of a step (°).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setpoint_deg: Option<f64>,
    /// Set-point of a step (kPa).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub setpoint_kpa: Option<f64>,
    /// Which step to this set-point it is, from 1.
    #[serde(
        default,
        deserialize_with = "whole",
        skip_serializing_if = "Option::is_none"
    )]
    pub repeat: Option<u32>,
}

/// How well the zeros of the sensors are known, as standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct CalibrationMeta {
    /// Standard deviation of the pressure sensor's zero (kPa).
    pub pressure_zero_sd_kpa: Option<f64>,
    /// Standard deviation of the angle sensor's zero (°).
    pub angle_zero_sd_deg: Option<f64>,
}

impl Meta {
    /// Parses the text of a file of metadata; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        let meta: Self = toml::from_str(text).map_err(|error| {
            let fault = InputError::new(
                in_words(error.message()),
                "correct the metadata, or delete the file: it is optional",
            )
            .in_file(path);
            match error.span() {
                Some(span) => fault.at_offset(text, span.start),
                None => fault,
            }
        })?;
        if let Some(setup) = &meta.setup {
            setup.check().map_err(|fault| fault.in_file(path))?;
        }
        Ok(meta)
    }

    /// Those beside the recording `path`, or else those in it.
    fn of(beside: Option<&str>, inside: Option<&str>, path: &Path) -> Result<Self, InputError> {
        match (beside, inside) {
            (Some(text), _) => Self::parse(text, &meta_beside(path)),
            (None, Some(text)) => Self::parse(text, path),
            (None, None) => Ok(Self::default()),
        }
    }

    /// When the recording began (s since 1970-01-01, UTC); none where that is not
    /// known or no date in UTC.
    pub fn started_unix_s(&self) -> Option<f64> {
        let started = humantime::parse_rfc3339_weak(self.started.as_deref()?).ok()?;
        let since = started.duration_since(std::time::UNIX_EPOCH).ok()?;
        Some(since.as_secs_f64())
    }

    /// Says when the recording began (s since 1970-01-01, UTC), to the microsecond.
    pub fn set_started(&mut self, unix_s: f64) {
        let since = Duration::try_from_secs_f64(unix_s).ok();
        let started = since.and_then(|it| std::time::UNIX_EPOCH.checked_add(it));
        self.started = started.map(|it| humantime::format_rfc3339_micros(it).to_string());
    }
}

/// A date may be in quotes, as `softrig record` writes it, or as TOML's own.
fn text_or_date<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Ok(match toml::Value::deserialize(from)? {
        toml::Value::String(text) => Some(text),
        toml::Value::Datetime(date) => Some(date.to_string()),
        _ => None,
    })
}

/// Name and unit of the output of recordings: those of the first.
pub fn measurand(recordings: &[Recording]) -> Measurand {
    let first = recordings.first();
    first.map_or_else(Measurand::default, |it| it.measurand.clone())
}

impl Recording {
    /// Reads and checks a recording whose columns hold what their header says. Warnings ask about
    /// what may be meant but is unusual: units, gaps, a last line without an end. What was left out
    /// is not among them: it is in [`Recording::left_out`], and [`Recording::remarks`] has both.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy for anything that is not a
    /// recording.
    pub fn read(path: &Path) -> Result<(Self, Vec<String>), InputError> {
        Self::read_as(path, &Layout::default())
    }

    /// Like [`Recording::read`], for a file with the recording in other columns or units.
    ///
    /// # Errors
    ///
    /// Like [`Recording::read`].
    pub fn read_as(path: &Path, layout: &Layout) -> Result<(Self, Vec<String>), InputError> {
        let (recording, warnings) = Self::assemble(formats::read(path, layout)?, path)?;
        Ok((recording.set_up(layout), warnings))
    }

    /// Like [`Recording::read_as`], for the bytes of a file and the text of the metadata beside it;
    /// `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Like [`Recording::read`].
    pub fn of_file(
        bytes: &[u8],
        meta: Option<&str>,
        path: &Path,
        layout: &Layout,
    ) -> Result<(Self, Vec<String>), InputError> {
        let samples = formats::read_bytes(bytes, path, layout)?;
        let meta = Meta::of(meta, samples.meta.as_deref(), path)?;
        let (recording, warnings) = Self::with_meta(samples, meta, path);
        Ok((recording.set_up(layout), warnings))
    }

    /// How the rig stood, as far as the metadata do not say it, and what its output is called.
    fn set_up(mut self, layout: &Layout) -> Self {
        let column = layout.names.of(Quantity::Angle);
        self.measurand = Measurand::of(column, self.columns.angle);
        if layout.setup != Setup::default() {
            let said = self.meta.setup.take().unwrap_or_default();
            self.meta.setup = Some(said.or(&layout.setup));
        }
        self
    }

    /// Puts the metadata to the samples of a file, and compares them.
    ///
    /// # Errors
    ///
    /// Metadata that cannot be read.
    pub fn assemble(samples: Samples, path: &Path) -> Result<(Self, Vec<String>), InputError> {
        let meta = read_meta(path, samples.meta.as_deref())?;
        Ok(Self::with_meta(samples, meta, path))
    }

    fn with_meta(samples: Samples, meta: Meta, path: &Path) -> (Self, Vec<String>) {
        let (mut recording, mut warnings) = Self::of(samples, path);
        recording.meta = meta;
        warnings.extend(recording.unlike_its_metadata());
        (recording, warnings)
    }

    /// Makes a recording of samples in memory: time, pressure and angle in the units that
    /// `columns` says, which are s, kPa and ° if it says nothing. They are checked as those
    /// of a file are; a fault is named by its place in the array, from 0.
    ///
    /// # Errors
    ///
    /// Names the array, the place in it, and the remedy.
    pub fn of_samples(
        name: &str,
        samples: [&[f64]; 3],
        columns: &Columns,
    ) -> Result<(Self, Vec<String>), InputError> {
        let samples = Samples::of_arrays(name, samples, columns)?;
        let (recording, warnings) = Self::of(samples, Path::new(name));
        let name = name.to_owned();
        Ok((Self { name, ..recording }, warnings))
    }

    /// Parses the text of a recording; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Like [`Recording::read`].
    pub fn parse(text: &str, path: &Path) -> Result<(Self, Vec<String>), InputError> {
        Self::parse_as(text, path, &Layout::default())
    }

    /// Like [`Recording::parse`], for a text with the recording in other columns or units.
    ///
    /// # Errors
    ///
    /// Like [`Recording::read`].
    pub fn parse_as(
        text: &str,
        path: &Path,
        layout: &Layout,
    ) -> Result<(Self, Vec<String>), InputError> {
        Self::parse_from(text.as_bytes(), path, layout, Limits::RECORDING)
    }

    /// Like [`Recording::parse_as`], for a text that is read as far as `limits` allow and never
    /// held whole.
    ///
    /// # Errors
    ///
    /// Like [`Recording::read`], and if there is more than `limits` allow.
    pub fn parse_from(
        text: impl Read,
        path: &Path,
        layout: &Layout,
        limits: Limits,
    ) -> Result<(Self, Vec<String>), InputError> {
        Ok(Self::of(
            formats::text::read(text, path, layout, limits)?,
            path,
        ))
    }

    /// Reads a file in any format from memory; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Like [`Recording::read`].
    pub fn parse_bytes(
        bytes: &[u8],
        path: &Path,
        layout: &Layout,
    ) -> Result<(Self, Vec<String>), InputError> {
        Ok(Self::of(formats::read_bytes(bytes, path, layout)?, path))
    }

    /// Converts samples to SI units, and says where they have gaps.
    fn of(samples: Samples, path: &Path) -> (Self, Vec<String>) {
        let Samples {
            time_s,
            mut pressure_kpa,
            mut angle_deg,
            extra,
            columns,
            mut warnings,
            breaks,
            stamps,
            lines,
            left_out,
            ..
        } = samples;
        for pressure in &mut pressure_kpa {
            *pressure *= PASCAL_PER_KPA;
        }
        for angle in &mut angle_deg {
            *angle = angle.to_radians();
        }
        let recording = Self {
            name: stem(path),
            path: path.to_owned(),
            time: time_s,
            pressure: pressure_kpa,
            angle: angle_deg,
            extra,
            columns,
            meta: Meta::default(),
            breaks,
            stamps,
            lines,
            left_out,
            removed: Vec::new(),
            measurand: Measurand::of(Quantity::Angle.column(), columns.angle),
        };
        if let Some(gap) = recording.describe_gaps() {
            warnings.push(format!("{}: {gap}", path.display()));
        }
        (recording, warnings)
    }

    /// Where the rows and what stands beside them show that a recording was cut off, or
    /// changed since.
    fn unlike_its_metadata(&self) -> Option<String> {
        let path = self.path.display();
        let about = meta_beside(&self.path);
        let about = about.display();
        match (self.meta.complete, self.meta.samples) {
            // Older versions said of these that they had no rows.
            (Some(false), _) => Some(format!(
                "{path}: is incomplete: according to {about} it ended before its protocol or its time; its {} rows are used",
                self.len()
            )),
            (_, Some(samples)) if samples != self.len() as u64 => Some(format!(
                "{path}: has {} rows, and {about} says {samples}: rows were lost or added since it was recorded; copy both files again from where they were recorded",
                self.len()
            )),
            _ => None,
        }
    }

    /// Everything that is to be said about a recording as it was read: what was left out, then
    /// its warnings.
    pub fn remarks(&self, warnings: Vec<String>) -> Vec<String> {
        let left_out = self.left_out.iter().map(ToString::to_string);
        left_out.chain(warnings).collect()
    }

    /// When time 0 was (s since 1970-01-01, UTC), as far as the metadata say it, or the times
    /// themselves, where the file has dates.
    pub fn zero_unix_s(&self) -> Option<f64> {
        /// Times beyond this (s) count from 1970: it is a day of 2001, and no board runs 31 years.
        const DATES_S: f64 = 1e9;
        if self.time.first().is_some_and(|first| *first >= DATES_S) {
            return Some(0.0);
        }
        let cut = self.meta.part_of.as_ref().and(self.meta.begins_s);
        Some(self.meta.started_unix_s()? + cut.unwrap_or(0.0))
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time.len()
    }

    /// Whether there are no samples.
    pub fn is_empty(&self) -> bool {
        self.time.is_empty()
    }

    /// Duration from the first sample to the last (s).
    pub fn duration(&self) -> f64 {
        match (self.time.first(), self.time.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        }
    }

    /// The usual time between samples (s): the median.
    pub fn interval(&self) -> f64 {
        let mut steps: Vec<f64> = self.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        Data::new(&mut steps[..]).median()
    }

    /// A range of the samples, under the same name.
    pub fn slice(&self, range: &Range<usize>) -> Self {
        let samples: Vec<usize> = range.clone().collect();
        let removed = self.removed.iter();
        Self {
            removed: removed.filter_map(|it| it.within(range)).collect(),
            ..self.picked(&samples)
        }
    }

    /// Some of the samples, in order, under the same name; they are taken to be believed.
    pub fn picked(&self, samples: &[usize]) -> Self {
        let pick = |values: &[f64]| samples.iter().map(|&k| values[k]).collect();
        let gone = |at: &usize| samples.partition_point(|k| k < at);
        let mut breaks: Vec<usize> = self.breaks.iter().map(gone).collect();
        breaks.dedup();
        breaks.retain(|&at| 0 < at && at < samples.len());
        Self {
            time: pick(&self.time),
            pressure: pick(&self.pressure),
            angle: pick(&self.angle),
            extra: self
                .extra
                .iter()
                .map(|column| Column {
                    name: column.name.clone(),
                    fields: samples.iter().map(|&k| column.fields[k].clone()).collect(),
                })
                .collect(),
            breaks,
            stamps: self.stamps.as_deref().map(pick),
            lines: self.lines.pick(samples.iter().copied()),
            removed: Vec::new(),
            name: self.name.clone(),
            path: self.path.clone(),
            meta: self.meta.clone(),
            columns: self.columns,
            measurand: self.measurand.clone(),
            left_out: self.left_out.clone(),
        }
    }

    /// The values of a channel, in Pa or rad.
    pub fn channel(&self, channel: Channel) -> &[f64] {
        match channel {
            Channel::Pressure => &self.pressure,
            Channel::Angle => &self.angle,
        }
    }

    /// Takes samples of a channel out: the recorded values are kept in [`Recording::removed`], and
    /// a straight line replaces them.
    pub fn remove(&mut self, channel: Channel, samples: Vec<(Range<usize>, Why)>) {
        if samples.is_empty() {
            return;
        }
        let values = self.channel(channel).to_vec();
        let mut gone = vec![false; values.len()];
        for (range, why) in samples {
            gone[range.clone()].fill(true);
            self.removed.push(Removed {
                channel,
                values: values[range.clone()].to_vec(),
                samples: range,
                why,
            });
        }
        let values = match channel {
            Channel::Pressure => &mut self.pressure,
            Channel::Angle => &mut self.angle,
        };
        bridge(&self.time, values, &gone);
    }

    /// Ranges of samples that were taken out of a channel.
    pub fn removed_from(&self, channel: Channel) -> impl Iterator<Item = &Removed> {
        self.removed.iter().filter(move |it| it.channel == channel)
    }

    /// Times (s) and values (Pa or rad) of the samples of a channel that were measured.
    pub fn measured(&self, channel: Channel) -> (Cow<'_, [f64]>, Cow<'_, [f64]>) {
        let values = self.channel(channel);
        if self.removed_from(channel).next().is_none() {
            return (Cow::Borrowed(&self.time), Cow::Borrowed(values));
        }
        let mut kept = vec![true; values.len()];
        for removed in self.removed_from(channel) {
            kept[removed.samples.clone()].fill(false);
        }
        let pick = |all: &[f64]| -> Vec<f64> {
            let kept = all.iter().zip(&kept).filter(|(_, kept)| **kept);
            kept.map(|(value, _)| *value).collect()
        };
        (Cow::Owned(pick(&self.time)), Cow::Owned(pick(values)))
    }

    /// What was taken out of the channels, a sentence for each channel and kind.
    pub fn what_was_removed(&self) -> Vec<LeftOut> {
        let kinds: BTreeSet<What> = self.removed.iter().map(Removed::what).collect();
        kinds
            .into_iter()
            .map(|what| {
                let places = self
                    .removed
                    .iter()
                    .filter(|it| it.what() == what)
                    .flat_map(|it| it.samples.clone())
                    .map(|sample| self.place(sample));
                let text = match what {
                    What::ImpossiblePressure | What::FrozenPressure => {
                        "replaced by a straight line; check the sensor's cable and the logger"
                    }
                    What::HeldPressure => "the pressure is sampled where it changes",
                    What::HeldAngle => "the angle is fitted where it changes",
                    _ => "not fitted; look at the sensor's cable and the logger",
                };
                LeftOut::new(what, &self.path, places, text)
            })
            .collect()
    }

    /// Where a sample is in the file: `line 123`, or `sample 123` in a format without lines.
    pub fn place(&self, sample: usize) -> String {
        self.lines.place(sample)
    }

    /// Whether the clock begins again at a sample.
    pub fn is_break(&self, sample: usize) -> bool {
        self.breaks.binary_search(&sample).is_ok()
    }

    /// An optional numeric column; samples without a number are NaN.
    pub fn column(&self, name: &str) -> Option<Vec<f64>> {
        let column = self.extra.iter().find(|column| column.name == name)?;
        Some(
            column
                .fields
                .iter()
                .map(|field| field.parse().unwrap_or(f64::NAN))
                .collect(),
        )
    }

    fn describe_gaps(&self) -> Option<String> {
        let usual = self.interval();
        let mut gaps = (1..)
            .zip(self.time.windows(2))
            .filter(|(at, pair)| pair[1] - pair[0] > GAP_FACTOR * usual && !self.is_break(*at))
            .map(|(_, pair)| pair);
        let first = gaps.next()?;
        Some(format!(
            "{} gap(s) in time, the first of {:.3} s after {:.3} s",
            gaps.count() + 1,
            first[1] - first[0],
            first[0]
        ))
    }
}

/// Files that `softrig record` leaves beside a recording and that are not recordings: the end of
/// the name, and what it is. A shell's `*.csv` finds them too.
const SIDE_FILES: [(&str, &str); 2] = [
    (
        FAULTY_ENDING,
        "holds the rows without a reading of a sensor",
    ),
    (BLACK_BOX_ENDING, "holds the second before a fault"),
];

/// The end of the name of the rows without a reading of a sensor.
pub const FAULTY_ENDING: &str = ".faulty.csv";

/// The end of the name of the second before a fault.
pub const BLACK_BOX_ENDING: &str = ".blackbox.csv";

/// Those of several files that are recordings, by their names: of the others it is said that
/// they are left out.
///
/// # Errors
///
/// Where nothing is left.
pub fn recordings_among(
    paths: &[PathBuf],
    mut warn: impl FnMut(&str),
) -> Result<Vec<PathBuf>, InputError> {
    let what = |path: &Path| {
        let name = path.file_name()?.to_str()?;
        let mut known = SIDE_FILES.into_iter();
        known.find_map(|(ending, what)| name.ends_with(ending).then_some(what))
    };
    let left_out: Vec<_> = paths
        .iter()
        .filter_map(|path| Some((path, what(path)?)))
        .collect();
    if let Some((path, what)) = left_out.first()
        && left_out.len() == paths.len()
    {
        return Err(InputError::new(
            format!("{what}, and is no recording"),
            "give the recording it belongs to",
        )
        .in_file(path));
    }
    for (path, what) in left_out {
        warn(&format!("{} {what}, and is left out", path.display()));
    }
    let recordings = paths.iter().filter(|path| what(path).is_none());
    Ok(recordings.cloned().collect())
}

/// Reads several recordings, all with the same layout, and passes on what was left out of them and
/// their warnings; what is only [beside](recordings_among) recordings is left out.
///
/// # Errors
///
/// The first file that is not a recording.
pub fn read_all(
    paths: &[PathBuf],
    layout: &Layout,
    mut warn: impl FnMut(&str),
) -> Result<Vec<Recording>, InputError> {
    read_each(paths, layout, &mut warn, Recording::remarks)
}

/// Like [`read_all`], for a command that shows [what was left out](Recording::left_out) itself.
///
/// # Errors
///
/// Like [`read_all`].
pub fn read_all_to_show(
    paths: &[PathBuf],
    layout: &Layout,
    mut warn: impl FnMut(&str),
) -> Result<Vec<Recording>, InputError> {
    read_each(paths, layout, &mut warn, |_, warnings| warnings)
}

fn read_each(
    paths: &[PathBuf],
    layout: &Layout,
    mut warn: impl FnMut(&str),
    said: impl Fn(&Recording, Vec<String>) -> Vec<String>,
) -> Result<Vec<Recording>, InputError> {
    let paths = recordings_among(paths, &mut warn)?;
    let mut recordings = Vec::with_capacity(paths.len());
    for path in &paths {
        let (recording, warnings) = Recording::read_as(path, layout)?;
        for warning in said(&recording, warnings) {
            warn(&warning);
        }
        recordings.push(recording);
    }
    Ok(recordings)
}

/// Refuses a recording that is given twice: validation on a fitted run proves nothing.
///
/// # Errors
///
/// Names the file.
pub fn check_distinct(fitted: &[PathBuf], held_out: &[PathBuf]) -> Result<(), InputError> {
    let same_file = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
    let mut seen = Vec::new();
    for path in fitted.iter().chain(held_out) {
        let file = same_file(path);
        if seen.contains(&file) {
            return Err(InputError::new(
                "is given twice",
                "name each recording once: to be fitted, or with --holdout for validation",
            )
            .in_file(path));
        }
        seen.push(file);
    }
    Ok(())
}

/// Formats a recording with the three required columns and any others in
/// `columns`, given as header and numbers.
pub fn to_csv(recording: &Recording, columns: &[(&str, &[f64])]) -> String {
    use std::fmt::Write;
    let mut text = REQUIRED.join(",");
    for (name, _) in columns {
        let _ = write!(text, ",{name}");
    }
    text.push('\n');
    for row in 0..recording.len() {
        let _ = write!(
            text,
            "{},{:.4},{:.4}",
            rounded(recording.time[row]),
            recording.pressure[row] / PASCAL_PER_KPA,
            recording.angle[row].to_degrees()
        );
        for (_, values) in columns {
            let _ = write!(text, ",{:.4}", values.get(row).copied().unwrap_or(f64::NAN));
        }
        text.push('\n');
    }
    text
}

/// Time to the microsecond, without trailing zeros.
fn rounded(time: f64) -> f64 {
    (time * 1e6).round() / 1e6
}

/// The extensions of recordings; a packed one has `.gz` appended.
const ENDINGS: [&str; 8] = [
    ".csv", ".tsv", ".txt", ".parquet", ".mat", ".mcap", ".tdms", ".db3",
];

/// The name of a recording: its file's name without folder and ending.
pub fn stem(path: &Path) -> String {
    let name = path
        .file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let mut endings = ENDINGS.into_iter();
    endings
        .find_map(|ending| name.strip_suffix(ending))
        .unwrap_or(name)
        .to_owned()
}

/// The ending of the file with the metadata of a recording.
pub const META_ENDING: &str = ".meta.toml";

/// Where the metadata of a recording are.
pub fn meta_beside(path: &Path) -> PathBuf {
    path.with_file_name(format!("{}{META_ENDING}", stem(path)))
}

/// The metadata beside a recording, or else those in it.
fn read_meta(path: &Path, inside: Option<&str>) -> Result<Meta, InputError> {
    let beside = meta_beside(path);
    let text = if beside.exists() {
        Some(read_text(&beside)?)
    } else {
        None
    };
    Meta::of(text.as_deref(), inside, path)
}

/// A count, also one with a point: other tools write 1200.0.
fn whole<'de, D: serde::Deserializer<'de>, T: TryFrom<u64>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    let value = toml::Value::deserialize(from)?;
    let count = match value {
        toml::Value::Integer(count) => u64::try_from(count).ok(),
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // It is checked.
        toml::Value::Float(count) if (0.0..1e15).contains(&count) && count.fract() == 0.0 => {
            Some(count as u64)
        }
        _ => None,
    };
    match count.and_then(|count| T::try_from(count).ok()) {
        Some(count) => Ok(Some(count)),
        None => Err(serde::de::Error::custom(format!(
            "{value} is not a whole number from 0, as 3 or 3.0"
        ))),
    }
}

/// A TOML parser's message about types, in words for the author of the file.
pub(crate) fn in_words(message: &str) -> String {
    let mut text = message.trim().replace('\n', ", ");
    for (rust, words) in [
        ("expected f64", "expected a number without quotes"),
        (
            "expected a boolean",
            "expected true or false without quotes",
        ),
    ] {
        text = text.replace(rust, words);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<(Recording, Vec<String>), InputError> {
        Recording::parse(text, Path::new("run.csv"))
    }

    fn message(text: &str) -> String {
        parse(text).unwrap_err().to_string()
    }

    const GOOD: &str = "time_s,pressure_kpa,angle_deg,note\n0,0,0,a\n0.01,10,90,b\n";

    /// A folder of another tool's recordings gets a board: what the board records there is read
    /// too, unless somebody says on the command line where the columns are.
    #[test]
    fn what_softrig_records_is_read_in_a_folder_of_other_recordings() {
        let path = Path::new("softrig.toml");
        let text = "[recording]\ncolumns = { time = \"ms\", pressure = \"psi\", angle = \"flex\" }\n\
            units = { time = \"ms\", pressure = \"psi\" }\nflip_angle = true\n";
        let folder = crate::model_file::recording_layout(text, path).unwrap();
        let read = |text: &str, layout: &Layout| {
            Recording::parse_bytes(text.as_bytes(), Path::new("run.csv"), layout)
        };
        let (theirs, said) = read("ms,psi,flex\n0,0,0\n10,1,90\n", &folder).unwrap();
        assert!((theirs.pressure[1] - 6_894.757).abs() < 0.01 && theirs.angle[1] < 0.0);
        assert!(said.is_empty(), "{said:?}");
        let (own, said) = read(GOOD, &folder).unwrap();
        assert!((own.pressure[1] - 10_000.0).abs() < 1e-6 && own.angle[1] > 1.5);
        assert!(said[0].starts_with("run.csv: is read by"), "{said:?}");
        let typed = Layout {
            names: crate::columns::Names::parse("time=ms").unwrap(),
            ..Layout::default()
        };
        let error = read(GOOD, &typed.or(&folder)).unwrap_err().to_string();
        assert!(error.contains("no column ms"), "{error}");
        assert!(error.contains("leave out"), "{error}");
        // Flags that say nothing of columns leave it to the files.
        let strict = Layout {
            strict: true,
            ..Layout::default()
        };
        assert!(read(GOOD, &strict.or(&Layout::default()).or(&folder)).is_ok());
    }

    #[test]
    fn what_only_stands_beside_a_recording_is_left_out_with_a_sentence() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (run, aside) = (path("run.csv"), path("run.blackbox.csv"));
        for it in [&run, &aside] {
            std::fs::write(it, GOOD).unwrap();
        }
        let mut said = Vec::new();
        let all = [aside.clone(), run.clone()];
        let read = read_all(&all, &Layout::default(), |text| said.push(text.to_owned())).unwrap();
        assert_eq!(read.len(), 1);
        assert_eq!(read[0].path, run);
        assert!(
            matches!(&said[..], [one] if one.contains("blackbox") && one.contains("left out")),
            "{said:?}"
        );
        for (name, what) in [("a.faulty.csv", "rows"), ("run.blackbox.csv", "second")] {
            let once = |text: &str| panic!("said twice: {text}");
            let error = read_all(&[path(name)], &Layout::default(), once).unwrap_err();
            let error = error.to_string();
            assert!(error.contains(name) && error.contains(what), "{error}");
        }
        let none = read_all(&[], &Layout::default(), |_| ()).unwrap();
        assert!(none.is_empty());
    }

    /// 10³⁰⁸ kPa are no number of pascals.
    #[test]
    fn numbers_that_overflow_in_another_unit_are_refused() {
        for field in ["1e308", "-1e308", "1e31", "inf", "nan"] {
            let text = GOOD.replacen(",10,", &format!(",{field},"), 1);
            let said = message(&text);
            assert!(
                said.contains("line 3") && said.contains("can be used"),
                "{said}"
            );
        }
        let (large, _) = parse(&GOOD.replacen(",10,", ",1e30,", 1)).unwrap();
        assert!(large.pressure.iter().all(|pa| pa.is_finite()));
    }

    #[test]
    fn units_become_si_and_extra_columns_are_kept() {
        let (recording, warnings) = parse(GOOD).unwrap();
        assert!(warnings.is_empty());
        assert!((recording.pressure[1] - 10_000.0).abs() < 1e-9);
        assert!((recording.angle[1] - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(recording.extra[0].fields, ["a", "b"]);
    }

    #[test]
    fn every_fault_names_its_place() {
        let head = "time_s,pressure_kpa,angle_deg\n";
        for (text, parts) in [
            (String::new(), vec!["run.csv", "empty"]),
            (
                "time_s,pressure_kpa,angle_deg,angle_deg\n0,0,0,0\n".into(),
                vec!["line 1", "more than one column angle_deg"],
            ),
            (
                "time_s,angle_deg\n0,0\n".into(),
                vec!["line 1", "pressure_kpa"],
            ),
            (
                format!("{head}0,0,0\n0.01,0,nan\n"),
                vec!["line 3", "angle_deg", "delete"],
            ),
            (
                format!("{head}0,0,0\n0.01,x,0\n"),
                vec!["line 3", "pressure_kpa", "\"x\""],
            ),
            (
                format!("{head}0,0,0\n0.02,0,0\n0.01,1,0\n0,0,1\n"),
                vec!["line 4", "time_s", "increase"],
            ),
            (
                format!("{head}0,0,0\n0.01,0,0\n0.02,0"),
                vec!["line 4", "cut off"],
            ),
            (
                format!("{head}0,0,0\n0.01,0\n0.02,0,0\n"),
                vec!["line 3", "as many fields"],
            ),
            (format!("{head}0,0,0\n"), vec!["1 samples"]),
        ] {
            let message = message(&text);
            for part in parts {
                assert!(message.contains(part), "{part:?} not in {message:?}");
            }
        }
    }

    /// The same numbers from memory and from a file are the same recording, and the same
    /// faults have the same names.
    #[test]
    fn samples_in_memory_are_checked_as_those_of_a_file() {
        let of = |samples: [&[f64]; 3], columns: &Columns| {
            Recording::of_samples("run", samples, columns)
        };
        let nothing = Columns::default();
        let (recording, warnings) =
            of([&[0.0, 0.01], &[0.0, 10.0], &[0.0, 90.0]], &nothing).unwrap();
        assert_eq!(warnings, [""; 0]);
        let (parsed, _) = parse(GOOD).unwrap();
        assert_eq!(recording.time, parsed.time);
        assert_eq!(recording.pressure, parsed.pressure);
        assert_eq!(recording.angle, parsed.angle);
        let in_bar = Columns {
            pressure: Some(crate::columns::PressureUnit::Bar),
            ..nothing
        };
        let (recording, _) = of([&[0.0, 0.01], &[0.0, 0.1], &[0.0, 90.0]], &in_bar).unwrap();
        assert!((recording.pressure[1] - 10_000.0).abs() < 1e-9);
        let faults: [([&[f64]; 3], &str); 7] = [
            (
                [&[0.0, 1.0], &[0.0, f64::NAN], &[0.0, 0.0]],
                "pressure_kpa[1]: NaN is not a number",
            ),
            (
                [&[0.0, 1.0], &[0.0, 0.0], &[f64::INFINITY, 0.0]],
                "angle_deg[0]: inf is not",
            ),
            ([&[0.0, 1.0], &[0.0, 1e31], &[0.0, 0.0]], "pressure_kpa[1]"),
            (
                [&[0.0, 0.0], &[0.0, 0.0], &[0.0, 0.0]],
                "time_s[1]: time 0 s does not follow 0 s",
            ),
            ([&[0.0], &[0.0], &[0.0]], "has 1 samples"),
            ([&[], &[], &[]], "has 0 samples"),
            (
                [&[0.0, 1.0], &[0.0], &[0.0, 0.0]],
                "2 in time_s, 1 in pressure_kpa, 2 in angle_deg",
            ),
        ];
        for (samples, part) in faults {
            let said = of(samples, &nothing).unwrap_err().to_string();
            assert!(said.contains(part), "{part:?} not in {said:?}");
        }
        let (_, warnings) = of([&[0.0, 1.0], &[0.0, 20_000.0], &[0.0, 0.0]], &nothing).unwrap();
        assert!(
            warnings[0].starts_with("run, pressure_kpa[1]: "),
            "{warnings:?}"
        );
    }

    #[test]
    fn unusual_units_and_gaps_are_asked_about() {
        let (_, warnings) =
            parse("time_s,pressure_kpa,angle_deg\n0,0,800\n0.01,20000,0\n").unwrap();
        assert!(warnings.iter().any(|w| w.contains("in degrees")));
        assert!(warnings.iter().any(|w| w.contains("in kPa")));
        let (_, warnings) =
            parse("time_s,pressure_kpa,angle_deg\n0,0,0\n0.1,0,0\n0.2,0,0\n0.9,0,0\n").unwrap();
        assert!(warnings[0].contains("gap"), "{warnings:?}");
    }

    /// A text without an end, which counts what was asked of it.
    struct Endless<F> {
        next: F,
        read: u64,
    }

    impl<F: FnMut(u64) -> u8> Read for &mut Endless<F> {
        fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
            for byte in &mut *into {
                *byte = (self.next)(self.read);
                self.read += 1;
            }
            Ok(into.len())
        }
    }

    /// How an endless text after a header is refused, and how much of it was read.
    fn refused(limits: Limits, next: impl FnMut(u64) -> u8) -> (String, u64) {
        let mut endless = Endless { next, read: 0 };
        let text = format!("{}\n0,0,0\n", REQUIRED.join(","));
        let error = Recording::parse_from(
            std::io::Cursor::new(text).chain(&mut endless),
            Path::new("bomb.csv.gz"),
            &Layout::default(),
            limits,
        )
        .unwrap_err();
        (error.to_string(), endless.read)
    }

    #[test]
    fn text_without_an_end_is_refused_where_the_limit_is() {
        const BUFFER: u64 = 1 << 16;
        let limits = Limits::RECORDING;
        for next in [
            // Empty lines, a field, a quoted field with lines in it, many empty fields.
            |_| b'\n',
            |_| b'9',
            |at| if at == 0 { b'"' } else { b'\n' },
            |_| b',',
        ] {
            let (said, read) = refused(limits, next);
            assert!(
                said.starts_with("bomb.csv.gz, line ") && said.contains("more than 1 MiB"),
                "{said}"
            );
            assert!(read <= limits.row_bytes + BUFFER, "{read}: {said}");
            assert!(said.len() < 300, "{said}");
        }
    }

    /// Rows of eleven bytes at rising times.
    fn endless_row(at: u64) -> u8 {
        let text = format!("{:06},1,2\n", 1 + at / 11);
        text.as_bytes()[usize::try_from(at % 11).unwrap()]
    }

    #[test]
    fn rows_without_an_end_are_refused_where_the_limit_is() {
        let limits = Limits {
            bytes: 1 << 20,
            row_bytes: 1 << 16,
            rows: 1_000,
            fields: 1 << 20,
        };
        let (said, read) = refused(limits, endless_row);
        assert!(
            said.contains("line 1002: has more than 1000 rows"),
            "{said}"
        );
        assert!(read < (1 << 16) + 11_000, "{read}");
        let (said, _) = refused(
            Limits {
                fields: 600,
                ..limits
            },
            endless_row,
        );
        assert!(
            said.contains("line 202: has more than 600 fields in 3 columns"),
            "{said}"
        );
        let (said, read) = refused(
            Limits {
                rows: u64::MAX,
                fields: u64::MAX,
                ..limits
            },
            endless_row,
        );
        assert!(said.contains("more than 1 MiB, which"), "{said}");
        assert!(read < (1 << 20) + (1 << 16), "{read}");
    }

    #[test]
    fn counts_with_a_point_are_read_and_faults_say_what_to_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.csv");
        std::fs::write(&path, GOOD).unwrap();
        let with = |meta: &str| {
            std::fs::write(folder.path().join("run.meta.toml"), meta).unwrap();
            Recording::read(&path).map_err(|error| error.to_string())
        };
        let (recording, warnings) = with(
            "samples = 2.0\nrepeat = 3.0\n[[segment]]\nfrom_s = 0\nto_s = 0.02\nrepeat = 1.0\n",
        )
        .unwrap();
        assert_eq!(warnings, Vec::<String>::new());
        assert_eq!(recording.meta.samples, Some(2));
        assert_eq!(recording.meta.repeat, Some(3));
        assert_eq!(recording.meta.segment[0].repeat, Some(1));
        for (meta, parts) in [
            (
                "samples = 2.5",
                [
                    "line 1, column 11",
                    "2.5 is not a whole number",
                    "as 3 or 3.0",
                ],
            ),
            (
                "repeat = -1",
                [
                    "line 1, column 10",
                    "-1 is not a whole number",
                    "correct the metadata",
                ],
            ),
            (
                "repeat = 1e12",
                [
                    "line 1, column 10",
                    "is not a whole number",
                    "correct the metadata",
                ],
            ),
            (
                "\ncomplete = 1",
                ["line 2, column 12", "true or false", "correct the metadata"],
            ),
            (
                "setpoint_deg = \"30\"",
                ["line 1, column 16", "a number without quotes", "correct"],
            ),
        ] {
            let said = with(meta).unwrap_err();
            for part in parts {
                assert!(said.contains(part), "{part:?} not in {said:?}");
            }
        }
    }

    proptest! {
        #[test]
        fn any_text_is_an_error_or_a_recording(text in "[0-9a-z,.\\-\n ]{0,200}") {
            let _ = parse(&text);
            let _ = parse(&format!("time_s,pressure_kpa,angle_deg\n{text}"));
        }

        #[test]
        fn written_recordings_read_back(values in prop::collection::vec((-100.0..100.0f64, -90.0..90.0f64), 2..20)) {
            let recording = Recording {
                time: (0..values.len()).map(|k| k as f64 * 0.01).collect(),
                pressure: values.iter().map(|v| v.0 * PASCAL_PER_KPA).collect(),
                angle: values.iter().map(|v| v.1.to_radians()).collect(),
                ..Recording::default()
            };
            let (back, _) = parse(&to_csv(&recording, &[])).unwrap();
            for k in 0..values.len() {
                prop_assert!((back.pressure[k] - recording.pressure[k]).abs() < 0.1);
                prop_assert!((back.angle[k] - recording.angle[k]).abs() < 1e-5);
            }
        }
    }
}
