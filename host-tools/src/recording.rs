//! Recordings: reading, checking and writing them.
//!
//! A recording is a CSV file (plain or gzip-compressed) with a header row and
//! the columns `time_s`, `pressure_kpa` and `angle_deg`; others are optional
//! and kept. Inside, everything is SI and radians. Whatever is wrong with a
//! file is reported with its line and column, because a fit on a damaged
//! recording gives a wrong cause with great confidence.

use std::io::Read;
use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::bounded::{self, Bounded, Limits, read_text};
use crate::columns::Columns;
use crate::error::InputError;

/// Pascals in a kilopascal.
pub const PASCAL_PER_KPA: f64 = 1000.0;

/// An angle beyond this is taken for a slip of units (°).
const SUSPICIOUS_ANGLE_DEG: f64 = 720.0;
/// A pressure beyond this is taken for a slip of units (kPa): more than the
/// sensors and the silicone of such rigs stand.
const SUSPICIOUS_PRESSURE_KPA: f64 = 600.0;
/// A sampling interval this many times the median one is a gap.
const GAP_FACTOR: f64 = 3.0;

/// Columns that every recording has.
const REQUIRED: [&str; 3] = ["time_s", "pressure_kpa", "angle_deg"];

/// A recorded run.
#[derive(Clone, Debug, Default)]
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
    /// Other columns, as they stand in the file.
    pub extra: Vec<Column>,
    /// What was said of its columns when it was read.
    pub columns: Columns,
    /// What the file beside it says.
    pub meta: Meta,
}

/// An optional column, kept as text.
#[derive(Clone, Debug, PartialEq, Eq)]
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
    /// Number of the repeat of that protocol, from 1.
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
    /// Whether it was recorded to its end.
    pub complete: Option<bool>,
    /// Rows that were written; none while it is recorded.
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
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeat: Option<u32>,
}

/// How well the zeros of the sensors are known, as standard deviations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct CalibrationMeta {
    /// Of the pressure sensor's zero (kPa).
    pub pressure_zero_sd_kpa: Option<f64>,
    /// Of the angle sensor's zero (°).
    pub angle_zero_sd_deg: Option<f64>,
}

impl Meta {
    /// Parses the text of a file of metadata; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        toml::from_str(text).map_err(|error| {
            let fault = InputError::new(
                error.message().trim().replace('\n', ", "),
                "correct the metadata, or delete the file: it is optional",
            )
            .in_file(path);
            match error.span() {
                Some(span) => fault.at_offset(text, span.start),
                None => fault,
            }
        })
    }

    /// When the recording began (s since 1970-01-01, UTC); none where that is not
    /// known or no date in UTC.
    pub fn started_unix_s(&self) -> Option<f64> {
        let started = humantime::parse_rfc3339_weak(self.started.as_deref()?).ok()?;
        let since = started.duration_since(std::time::UNIX_EPOCH).ok()?;
        Some(since.as_secs_f64())
    }
}

/// A date may stand in quotes, as `rig record` writes it, or as TOML's own.
fn text_or_date<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Ok(match toml::Value::deserialize(from)? {
        toml::Value::String(text) => Some(text),
        toml::Value::Datetime(date) => Some(date.to_string()),
        _ => None,
    })
}

impl Recording {
    /// Reads and checks a recording whose columns hold what their header says.
    /// Warnings ask about what may be meant but is unusual: units, gaps, a last
    /// line without an end.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy for anything that is not a
    /// recording.
    pub fn read(path: &Path) -> Result<(Self, Vec<String>), InputError> {
        Self::read_as(path, &Columns::default())
    }

    /// As [`Recording::read`], of a file whose columns hold something else.
    ///
    /// # Errors
    ///
    /// As [`Recording::read`].
    pub fn read_as(path: &Path, columns: &Columns) -> Result<(Self, Vec<String>), InputError> {
        let table = bounded::open(path)?;
        let (mut recording, mut warnings) =
            Self::parse_from(table, path, columns, Limits::RECORDING)?;
        recording.meta = read_meta(path)?;
        warnings.extend(recording.unlike_its_metadata());
        Ok((recording, warnings))
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
        let rows = same_length(samples)?;
        Limits::RECORDING.check(rows as u64, REQUIRED.len())?;
        let mut recording = Self {
            name: name.to_owned(),
            path: PathBuf::from(name),
            columns: *columns,
            ..Self::default()
        };
        let mut units = UnitCheck::default();
        let mut warnings = Vec::new();
        for row in 0..rows {
            let mut read = samples.map(|values| values[row]);
            for (value, array) in read.iter_mut().zip(REQUIRED) {
                *value = usable_number(*value).map_err(|error| in_array(error, array, row))?;
            }
            let [time, pressure, angle] = recording
                .follows(columns.read(read))
                .map_err(|error| in_array(error, REQUIRED[0], row))?;
            let questions = units.question(pressure, angle);
            warnings.extend(
                questions.map(|(array, question)| format!("{name}, {array}[{row}]: {question}")),
            );
            recording.push([time, pressure, angle]);
        }
        recording.long_enough()?;
        warnings.extend(
            recording
                .describe_gaps()
                .map(|gap| format!("{name}: {gap}")),
        );
        Ok((recording, warnings))
    }

    /// Parses the text of a recording; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// As [`Recording::read`].
    pub fn parse(text: &str, path: &Path) -> Result<(Self, Vec<String>), InputError> {
        Self::parse_as(text, path, &Columns::default())
    }

    /// As [`Recording::parse`], of a text whose columns hold something else.
    ///
    /// # Errors
    ///
    /// As [`Recording::read`].
    pub fn parse_as(
        text: &str,
        path: &Path,
        columns: &Columns,
    ) -> Result<(Self, Vec<String>), InputError> {
        Self::parse_from(text.as_bytes(), path, columns, Limits::RECORDING)
    }

    /// As [`Recording::parse_as`], of a text that is read as far as `limits` allow and never
    /// held whole.
    ///
    /// # Errors
    ///
    /// As [`Recording::read`], and if there is more than `limits` allow.
    pub fn parse_from(
        text: impl Read,
        path: &Path,
        columns: &Columns,
        limits: Limits,
    ) -> Result<(Self, Vec<String>), InputError> {
        let mut rows = Rows::new(text, path, limits);
        let header = rows.header()?;
        let required = required_columns(&header).map_err(|error| error.in_file(path))?;
        let other: Vec<usize> = (0..header.len())
            .filter(|column| !required.contains(column))
            .collect();
        let mut recording = Self {
            name: stem(path),
            path: path.to_owned(),
            extra: other
                .iter()
                .map(|&column| Column {
                    name: header[column].to_owned(),
                    fields: Vec::new(),
                })
                .collect(),
            columns: *columns,
            ..Self::default()
        };
        let mut units = UnitCheck::default();
        let mut warnings = Vec::new();
        let mut record = csv::StringRecord::new();
        while let Some(line) = rows.next(&mut record)? {
            if record.len() != header.len() {
                let last = matches!(rows.next(&mut csv::StringRecord::new()), Ok(None));
                return Err(wrong_length(&record, &header, last)
                    .in_file(path)
                    .at_line(line));
            }
            let [time, pressure, angle] = row(&record, &required, line)
                .and_then(|row| {
                    let follows = recording.follows(columns.read(row));
                    follows.map_err(|error| error.at_line(line).in_column(REQUIRED[0]))
                })
                .map_err(|error| error.in_file(path))?;
            warnings.extend(units.question(pressure, angle).map(|(column, question)| {
                format!(
                    "{}, line {line}, column {column}: {question}",
                    path.display()
                )
            }));
            recording.push([time, pressure, angle]);
            for (kept, &column) in recording.extra.iter_mut().zip(&other) {
                kept.fields.push(record[column].to_owned());
            }
        }
        recording
            .long_enough()
            .map_err(|error| error.in_file(path))?;
        if !rows.end_with_line() {
            warnings.push(format!(
                "{}: the last line has no line end; if the recording was cut off there, its last value may be wrong",
                path.display()
            ));
        }
        if let Some(gap) = recording.describe_gaps() {
            warnings.push(format!("{}: {gap}", path.display()));
        }
        Ok((recording, warnings))
    }

    /// Where the rows and what stands beside them show that a recording was cut off, or
    /// changed since.
    fn unlike_its_metadata(&self) -> Option<String> {
        let path = self.path.display();
        let about = meta_beside(&self.path);
        let about = about.display();
        match (self.meta.complete, self.meta.samples) {
            // Of these older versions said that they had no rows.
            (Some(false), _) => Some(format!(
                "{path}: is not complete: {about} says that it ended before its protocol or its time did; its {} rows are used, and what would have come after is missing",
                self.len()
            )),
            (_, Some(samples)) if samples != self.len() as u64 => Some(format!(
                "{path}: has {} rows, and {about} says {samples}: rows were lost or added since it was recorded; copy both files again from where they were recorded",
                self.len()
            )),
            _ => None,
        }
    }

    /// Checks that a row's time follows those before.
    fn follows(&self, row: [f64; 3]) -> Result<[f64; 3], InputError> {
        match self.time.last() {
            Some(&before) if row[0] <= before => Err(InputError::new(
                format!("time {} s does not follow {before} s", row[0]),
                "times must increase: sort the rows or split the file where the clock restarts",
            )),
            _ => Ok(row),
        }
    }

    /// Adds a sample: time (s), pressure (kPa) and angle (°).
    fn push(&mut self, [time, pressure, angle]: [f64; 3]) {
        self.time.push(time);
        self.pressure.push(pressure * PASCAL_PER_KPA);
        self.angle.push(angle.to_radians());
    }

    /// Refuses what is too short to be a recording.
    fn long_enough(&self) -> Result<(), InputError> {
        if self.len() < 2 {
            return Err(InputError::new(
                format!("has {} samples", self.len()),
                "a recording needs at least two; record it again",
            ));
        }
        Ok(())
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
        crate::statistics::median(&mut steps)
    }

    /// A range of the samples, under the same name.
    pub fn slice(&self, range: &Range<usize>) -> Self {
        let pick = |values: &[f64]| values[range.clone()].to_vec();
        Self {
            time: pick(&self.time),
            pressure: pick(&self.pressure),
            angle: pick(&self.angle),
            extra: self
                .extra
                .iter()
                .map(|column| Column {
                    name: column.name.clone(),
                    fields: column.fields[range.clone()].to_vec(),
                })
                .collect(),
            name: self.name.clone(),
            path: self.path.clone(),
            meta: self.meta.clone(),
            columns: self.columns,
        }
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
        let mut gaps = self
            .time
            .windows(2)
            .filter(|pair| pair[1] - pair[0] > GAP_FACTOR * usual);
        let first = gaps.next()?;
        Some(format!(
            "{} gap(s) in time, the first of {:.3} s after {:.3} s",
            gaps.count() + 1,
            first[1] - first[0],
            first[0]
        ))
    }
}

/// Reads several recordings, all with the same columns, and passes their
/// warnings on.
///
/// # Errors
///
/// The first file that is not a recording.
pub fn read_all(
    paths: &[PathBuf],
    columns: &Columns,
    mut warn: impl FnMut(&str),
) -> Result<Vec<Recording>, InputError> {
    let mut recordings = Vec::with_capacity(paths.len());
    for path in paths {
        let (recording, warnings) = Recording::read_as(path, columns)?;
        for warning in &warnings {
            warn(warning);
        }
        recordings.push(recording);
    }
    Ok(recordings)
}

/// Refuses a recording that is given twice: a run that is fitted and judged by
/// proves nothing.
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
                "name each recording once: to be fitted, or with --holdout to judge by",
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

/// The rows of a table, one after the other.
struct Rows<'a, R> {
    reader: csv::Reader<Bounded<R>>,
    path: &'a Path,
    limits: Limits,
    columns: usize,
    count: u64,
}

impl<'a, R: Read> Rows<'a, R> {
    fn new(text: R, path: &'a Path, limits: Limits) -> Self {
        Self {
            reader: csv::ReaderBuilder::new()
                .trim(csv::Trim::All)
                .flexible(true)
                .from_reader(Bounded::new(text, limits)),
            path,
            limits,
            columns: 0,
            count: 0,
        }
    }

    fn header(&mut self) -> Result<csv::StringRecord, InputError> {
        let header = match self.reader.headers() {
            Ok(header) => header.clone(),
            Err(error) => return Err(self.fault(error)),
        };
        self.reader.get_mut().found_row();
        self.columns = header.len();
        if header.iter().all(str::is_empty) && self.next(&mut csv::StringRecord::new())?.is_none() {
            return Err(InputError::new(
                "is empty",
                "record it again, or leave it out of the command",
            )
            .in_file(self.path));
        }
        Ok(header)
    }

    /// The line of the next row, which is read into `record`; none at the end.
    fn next(&mut self, record: &mut csv::StringRecord) -> Result<Option<u64>, InputError> {
        match self.reader.read_record(record) {
            Ok(true) => {}
            Ok(false) => return Ok(None),
            Err(error) => return Err(self.fault(error)),
        }
        self.reader.get_mut().found_row();
        self.count += 1;
        let line = record.position().map_or(0, csv::Position::line);
        self.limits
            .check(self.count, self.columns)
            .map_err(|error| error.in_file(self.path).at_line(line))?;
        Ok(Some(line))
    }

    fn end_with_line(&self) -> bool {
        self.reader.get_ref().ends_with_line()
    }

    /// What a failure to read comes from: a limit, the disk, or the text.
    fn fault(&self, error: csv::Error) -> InputError {
        let line = self.reader.position().line();
        if let Some(fault) = self.reader.get_ref().fault() {
            return fault.in_file(self.path).at_line(line);
        }
        match error.into_kind() {
            csv::ErrorKind::Io(error) => InputError::from_io(self.path, &error),
            csv::ErrorKind::Utf8 { .. } => bounded::not_text(self.path).at_line(line),
            other => InputError::new(format!("is not a CSV table: {other:?}"), "export it again")
                .in_file(self.path)
                .at_line(line),
        }
    }
}

fn stem(path: &Path) -> String {
    let name = path
        .file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    name.strip_suffix(".csv").unwrap_or(name).to_owned()
}

fn meta_beside(path: &Path) -> PathBuf {
    path.with_file_name(format!("{}.meta.toml", stem(path)))
}

fn read_meta(path: &Path) -> Result<Meta, InputError> {
    let beside = meta_beside(path);
    if !beside.exists() {
        return Ok(Meta::default());
    }
    Meta::parse(&read_text(&beside)?, &beside)
}

/// The positions of the required columns.
fn required_columns(header: &csv::StringRecord) -> Result<[usize; 3], InputError> {
    let mut index = [0; 3];
    for (place, name) in index.iter_mut().zip(REQUIRED) {
        *place = header
            .iter()
            .position(|column| column == name)
            .ok_or_else(|| {
                let found: Vec<&str> = header.iter().collect();
                InputError::new(
                    format!("has no column {name} (it has {})", found.join(", ")),
                    format!(
                        "add it, or rename the column that holds it: a recording needs {}",
                        REQUIRED.join(", ")
                    ),
                )
                .at_line(1)
                .in_column(name)
            })?;
        if header.iter().filter(|column| *column == name).count() > 1 {
            return Err(InputError::new(
                format!("has more than one column {name}"),
                "remove or rename all but the one that is meant",
            )
            .at_line(1)
            .in_column(name));
        }
    }
    Ok(index)
}

/// The required numbers of a row.
fn row(
    record: &csv::StringRecord,
    required: &[usize; 3],
    line: u64,
) -> Result<[f64; 3], InputError> {
    let mut row = [0.0; 3];
    for ((number, &column), name) in row.iter_mut().zip(required).zip(REQUIRED) {
        *number = parse_number(record.get(column).unwrap_or(""))
            .map_err(|error| error.at_line(line).in_column(name))?;
    }
    Ok(row)
}

/// A row with another number of fields than the header.
fn wrong_length(record: &csv::StringRecord, header: &csv::StringRecord, last: bool) -> InputError {
    let advice = if last && record.len() < header.len() {
        "the recording was cut off while it was written: delete this line to use the rest"
    } else {
        "give every row as many fields as the header has"
    };
    InputError::new(
        format!("has {} of {} fields", record.len(), header.len()),
        advice,
    )
    .in_column((record.len().min(header.len()) + 1).to_string())
}

/// Asks about values that look like another unit, once for each column.
#[derive(Debug, Default)]
struct UnitCheck {
    angle_asked: bool,
    pressure_asked: bool,
}

impl UnitCheck {
    /// A column and a question about its unit, if a value (kPa, °) raises one.
    fn question(&mut self, pressure_kpa: f64, angle_deg: f64) -> Option<(&'static str, String)> {
        if angle_deg.abs() > SUSPICIOUS_ANGLE_DEG && !self.angle_asked {
            self.angle_asked = true;
            return Some((
                "angle_deg",
                format!(
                    "{angle_deg} is more than two turns; is the column in degrees, or are pressure and angle exchanged (--exchange-columns)?"
                ),
            ));
        }
        if pressure_kpa.abs() > SUSPICIOUS_PRESSURE_KPA && !self.pressure_asked {
            self.pressure_asked = true;
            return Some((
                "pressure_kpa",
                format!(
                    "{pressure_kpa} kPa would burst a soft actuator; is the column in kPa (--pressure-in), or are pressure and angle exchanged (--exchange-columns)?"
                ),
            ));
        }
        None
    }
}

/// No sensor shows more, in whatever unit, and its square and a thousand times as much are
/// numbers too.
const LARGEST_NUMBER: f64 = 1e30;

/// A number as it stands in memory, if a sensor can have shown it.
fn usable_number(value: f64) -> Result<f64, InputError> {
    if value.abs() <= LARGEST_NUMBER {
        Ok(value)
    } else {
        Err(unusable(value))
    }
}

fn unusable(number: impl std::fmt::Display) -> InputError {
    InputError::new(
        format!("{number} is not a number that can be used"),
        "delete the rows in which the sensor gave nothing; gaps in time are allowed",
    )
}

/// The number of samples in three arrays.
fn same_length(samples: [&[f64]; 3]) -> Result<usize, InputError> {
    let lengths = samples.map(<[f64]>::len);
    if lengths.iter().any(|&length| length != lengths[0]) {
        let each: Vec<String> = REQUIRED
            .iter()
            .zip(lengths)
            .map(|(array, length)| format!("{length} in {array}"))
            .collect();
        return Err(InputError::new(
            format!("the arrays have different lengths: {}", each.join(", ")),
            "give one value a sample in each of them",
        ));
    }
    Ok(lengths[0])
}

/// Names the place of a fault in an array.
fn in_array(error: InputError, array: &str, row: usize) -> InputError {
    InputError::new(format!("{array}[{row}]: {}", error.found), error.advice)
}

fn parse_number(field: &str) -> Result<f64, InputError> {
    match field.parse::<f64>() {
        Ok(value) if value.abs() <= LARGEST_NUMBER => Ok(value),
        Ok(_) => Err(unusable(field)),
        Err(_) => Err(InputError::new(
            if field.is_empty() {
                "is empty".to_owned()
            } else {
                format!("\"{field}\" is not a number")
            },
            "write numbers with a decimal point and no unit, or delete the row",
        )),
    }
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
                format!("{head}0,0,0\n0.01,0,0\n0.01,0,0\n"),
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
            &Columns::default(),
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
        assert!(said.contains("more than 1 MiB of text"), "{said}");
        assert!(read < (1 << 20) + (1 << 16), "{read}");
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
