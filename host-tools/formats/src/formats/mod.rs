//! File formats of recordings.
//!
//! Laboratories have tables of spreadsheets, MATLAB files, Parquet and logs of robots. One
//! reader for each format returns the same [`Samples`], and none guesses: a [`Layout`] has to
//! give everything that the file's header or types do not. Other modules do not depend on the
//! format.

mod arrays;
mod bad_lines;
pub mod binary;
mod json_lines;
pub mod names;
pub mod overview;
pub mod stamps;
pub(crate) mod text;
pub mod write;

use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

use crate::bounded::{self, Limits};
use crate::clock;
use crate::columns::{Columns, Layout, Quantity, ROW, TimeUnit, Unit};
use crate::error::InputError;
use crate::left_out::{LeftOut, Lines};
use crate::recording::Column;
use bad_lines::BadLines;
use binary::{Binary, Source};

/// An angle beyond this is taken for a slip of units (°).
const SUSPICIOUS_ANGLE_DEG: f64 = 720.0;
/// A pressure beyond this is taken for a slip of units (kPa): more than the sensors and the
/// silicone of such rigs withstand.
const SUSPICIOUS_PRESSURE_KPA: f64 = 600.0;
/// No sensor shows more, in whatever unit, and its square and a thousand times as much are
/// numbers too.
pub const LARGEST_NUMBER: f64 = 1e30;

/// Bytes that tell the formats apart.
const START: usize = 16;
const GZIP: &[u8] = &[0x1f, 0x8b];
const MATLAB: &[u8] = b"MATLAB";

/// Formats that are not read, by their first bytes, and how they are converted; `FILE` is the
/// file.
const FOREIGN: [(&[u8], &str, &str); 8] = [
    (
        b"TDSh",
        "the index of a TDMS file",
        "name the file with the ending .tdms, which has the values",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "compressed with zstd",
        "unpack it: zstd -d FILE",
    ),
    (
        b"#ROSBAG V",
        "a bag of ROS 1",
        "convert it: mcap convert FILE run.mcap",
    ),
    (
        b"ARROW1",
        "a Feather file of Arrow",
        "convert it: python3 -c \"import pandas; pandas.read_feather('FILE').to_parquet('run.parquet')\"",
    ),
    (
        b"\xd0\xcf\x11\xe0",
        "a spreadsheet of an old Excel",
        "export the sheet as CSV",
    ),
    (b"ULog\x01", "a log of PX4", "convert it: ulog2csv FILE"),
    (
        b"\x80\x04\x95",
        "a pickle of Python",
        "convert it where you trust it: python3 -c \"import pandas; pandas.read_pickle('FILE').to_csv('run.csv', index=False)\"",
    ),
    (b"BZh", "compressed with bzip2", "unpack it: bunzip2 FILE"),
];

/// A recording as it was read, in the units of its header: s, kPa (gauge) and °.
#[derive(Clone, Debug, Default)]
pub struct Samples {
    /// Time of each sample (s), strictly increasing.
    pub time_s: Vec<f64>,
    /// Gauge pressure (kPa).
    pub pressure_kpa: Vec<f64>,
    /// Bending angle (°).
    pub angle_deg: Vec<f64>,
    /// How many decimals each of the three has in the file, if all its numbers have as many
    /// and are not converted.
    pub decimals: [Decimals; 3],
    /// Other columns, as text.
    pub extra: Vec<Column>,
    /// Units and meaning of the columns, as the user or the file gives them.
    pub columns: Columns,
    /// Metadata that the file holds itself, as TOML.
    pub meta: Option<String>,
    /// Warnings about unusual contents.
    pub warnings: Vec<String>,
    /// Samples at which the clock begins again.
    pub breaks: Vec<usize>,
    /// The times as in the file (s), where they were reconstructed.
    pub stamps: Option<Vec<f64>>,
    /// Where the samples are in the file.
    pub lines: Lines,
    /// What was left out or changed.
    pub left_out: Vec<LeftOut>,
    /// Rows of the file so far, also those that are left out.
    rows: u64,
    /// Whether the times are times of a day.
    is_time_of_day: bool,
    angle_asked: bool,
    pressure_asked: bool,
}

/// How many decimals the numbers of a column have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Decimals {
    /// There is no number yet.
    #[default]
    None,
    /// All have this many.
    All(usize),
    /// They differ, or have exponents.
    Various,
}

impl Decimals {
    /// Counts those of another number.
    pub fn count(&mut self, number: &str) {
        let counted = match number.split_once(['.', ',']) {
            None if number.bytes().all(|c| c.is_ascii_digit() || c == b'-') => Self::All(0),
            Some((_, decimals)) if decimals.bytes().all(|c| c.is_ascii_digit()) => {
                Self::All(decimals.len())
            }
            _ => Self::Various,
        };
        *self = match *self {
            Self::None => counted,
            same if same == counted => same,
            _ => Self::Various,
        };
    }

    /// A number with this many decimals; if they differ, with as few as distinguish it from others.
    pub fn show(self, number: f64) -> String {
        match self {
            _ if number.is_nan() => String::new(),
            Self::All(decimals) => format!("{number:.decimals$}"),
            _ => format!("{number:?}").trim_end_matches(".0").to_owned(),
        }
    }
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Takes a row of the file: converts it, and asks about what is unusual. A question comes
    /// with what it is about. Times are looked at once all are there.
    fn push(&mut self, row: [f64; 3]) -> Option<(Quantity, String)> {
        let [time, pressure, angle] = self.columns.read(row);
        self.time_s.push(time);
        self.pressure_kpa.push(pressure);
        self.angle_deg.push(angle);
        self.question(pressure, angle)
    }

    /// Asks about values that look like another unit, once for each column.
    fn question(&mut self, pressure: f64, angle: f64) -> Option<(Quantity, String)> {
        if angle.abs() > SUSPICIOUS_ANGLE_DEG && !self.angle_asked {
            self.angle_asked = true;
            return Some((
                Quantity::Angle,
                format!(
                    "{angle} is more than two turns; is the column in degrees, or are pressure and angle exchanged (--exchange-columns)?"
                ),
            ));
        }
        if pressure.abs() > SUSPICIOUS_PRESSURE_KPA && !self.pressure_asked {
            self.pressure_asked = true;
            return Some((
                Quantity::Pressure,
                format!(
                    "{pressure} kPa would burst a soft actuator; is the column in kPa (--units pressure=UNIT), or are pressure and angle exchanged (--exchange-columns)?"
                ),
            ));
        }
        None
    }

    /// Refuses a column whose own name contradicts how it is read.
    fn check_units_in_names(&self, layout: &Layout) -> Result<(), InputError> {
        for quantity in Quantity::ALL {
            let name = layout.names.of(quantity);
            if let (Some(factor), None) = (
                names::factor_in(name),
                &self.columns.scales[quantity as usize],
            ) {
                let unit = self
                    .columns
                    .unit(quantity)
                    .or(names::unit_in(quantity, name));
                let unit = unit.map_or(["s", "kpa", "deg"][quantity as usize], Unit::name);
                return Err(InputError::new(
                    format!("the name of {name} says that its values are {factor} times the {}, but no scale is set", quantity.key()),
                    format!("add --units {0}={unit}*{factor}, or --units {0}={unit}*1 if the name is wrong", quantity.key()),
                )
                .in_column(name));
            }
            let Some(unit) = names::unit_in(quantity, name) else {
                continue;
            };
            if self.columns.unit(quantity).is_none() && !unit.is_promised() {
                return Err(InputError::new(
                    format!("{name} has an unexpected unit in its name, and no unit was given"),
                    format!(
                        "add --units {0}={1}, or --units {0}={2} if the name is wrong",
                        quantity.key(),
                        unit.name(),
                        ["s", "kpa", "deg"][quantity as usize],
                    ),
                )
                .in_column(name));
            }
        }
        Ok(())
    }
}

/// Reads the samples of any file that holds a recording.
///
/// # Errors
///
/// Names file, place and remedy for anything that is not a recording, or larger than any.
pub fn read(path: &Path, layout: &Layout) -> Result<Samples, InputError> {
    as_said_or_recorded(path, layout, |layout| read_file(path, layout))
}

/// Reads as `layout` says; what softrig has recorded itself needs no file to say where its columns
/// are, and is read also where one says it of other recordings.
fn as_said_or_recorded(
    path: &Path,
    layout: &Layout,
    read: impl Fn(&Layout) -> Result<Samples, InputError>,
) -> Result<Samples, InputError> {
    read(layout).or_else(|error| {
        let own = layout.as_recorded().and_then(|own| read(&own).ok());
        let mut samples = own.ok_or(error)?;
        samples.warnings.push(format!(
            "{}: is read by the columns that softrig records; [recording] names others",
            path.display()
        ));
        Ok(samples)
    })
}

fn read_file(path: &Path, layout: &Layout) -> Result<Samples, InputError> {
    let fail = |error: std::io::Error| InputError::from_io(path, &error);
    bounded::refuse_pipe(path)?;
    if path.is_dir() {
        return binary::read_folder(path, layout);
    }
    let mut file = File::open(path).map_err(fail)?;
    let start = start_of(&mut file).map_err(fail)?;
    let limits = Limits::RECORDING;
    if let Some(format) = Binary::of(&start)
        && path.is_file()
    {
        let source = Source::File(binary::rewound(file, path)?);
        return binary::read(format, source, path, layout, limits);
    }
    let whole = Cursor::new(start.clone()).chain(file);
    read_unpacked(&start, whole, path, layout, limits)
}

/// Like [`read`], for bytes in memory; `path` is only named in messages.
///
/// # Errors
///
/// Like [`read`].
pub fn read_bytes(bytes: &[u8], path: &Path, layout: &Layout) -> Result<Samples, InputError> {
    as_said_or_recorded(path, layout, |layout| {
        read_unpacked(bytes, bytes, path, layout, Limits::RECORDING)
    })
}

/// Reads what may be packed with gzip.
fn read_unpacked(
    start: &[u8],
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    if path.extension().is_some_and(|it| it == "gz") || start.starts_with(GZIP) {
        // Files that were appended to have several members.
        let mut unpacked = flate2::bufread::MultiGzDecoder::new(BufReader::new(whole));
        let start = start_of(&mut unpacked).map_err(|error| InputError::from_io(path, &error))?;
        let whole = Cursor::new(start.clone()).chain(unpacked);
        return read_from(&start, whole, path, layout, limits);
    }
    read_from(start, whole, path, layout, limits)
}

fn read_from(
    start: &[u8],
    mut whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    refuse_foreign(start, path)?;
    if let Some(format) = Binary::of(start) {
        binary::read(format, Source::Stream(&mut whole), path, layout, limits)
    } else if is_json(start) {
        json_lines::read(whole, path, layout, limits)
    } else {
        text::read(whole, path, layout, limits)
    }
}

/// Whether a text begins with an object of JSON, or an array of them.
fn is_json(start: &[u8]) -> bool {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let start = start.trim_ascii_start();
    start.starts_with(b"{")
        || start.strip_prefix(b"[").is_some_and(|rest| {
            let rest = rest.trim_ascii_start();
            rest.is_empty() || rest.starts_with(b"{")
        })
}

/// Names a format that is not read, and what to do.
///
/// # Errors
///
/// Names the file, its format and how it is converted.
pub fn refuse_foreign(start: &[u8], path: &Path) -> Result<(), InputError> {
    let Some((_, what, advice)) = FOREIGN.iter().find(|(magic, ..)| start.starts_with(magic))
    else {
        return Ok(());
    };
    let advice = advice.replace("FILE", &path.display().to_string());
    Err(InputError::new(format!("is {what}, which is not read"), advice).in_file(path))
}

/// Whether a file that starts so is a recording in a binary format or a packed table: nothing else
/// that is read or written here is either. What HDF5 holds is not known.
pub fn is_binary_recording(start: &[u8]) -> bool {
    match Binary::of(start) {
        Some(Binary::Hdf5) => start.starts_with(MATLAB),
        Some(Binary::Packed | Binary::Sqlite) => false,
        Some(_) => true,
        None => start.starts_with(GZIP) || start.starts_with(MATLAB),
    }
}

/// The first bytes of a file or a pipe, which gives them in pieces.
///
/// # Errors
///
/// Those of reading it.
pub fn start_of(file: &mut impl Read) -> std::io::Result<Vec<u8>> {
    let mut start = Vec::with_capacity(START);
    file.take(START as u64).read_to_end(&mut start)?;
    Ok(start)
}

/// Columns that a format holds one after the other.
#[derive(Clone, Debug, Default)]
pub struct Sheet {
    /// Names and values, all of the same number.
    pub columns: Vec<(String, Values)>,
    /// Metadata that the file holds, as TOML.
    pub meta: Option<String>,
    /// Warnings about unusual contents.
    pub warnings: Vec<String>,
    /// Units that the columns' types imply.
    pub columns_say: Columns,
    /// What is in the file and is not read: its name, and what it is: `a cell array`.
    pub unread: Vec<(String, String)>,
}

/// The values of a column.
#[derive(Clone, Debug)]
pub enum Values {
    /// Numbers, NaN where there is none, and how many decimals they are shown with.
    Numbers(Vec<f64>, Decimals),
    /// Texts, empty where there is none.
    Texts(Vec<String>),
}

impl Values {
    /// How many there are.
    pub fn len(&self) -> usize {
        match self {
            Self::Numbers(values, _) => values.len(),
            Self::Texts(values) => values.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Those of some rows, as in a file.
    fn shown(self, rows: &[usize]) -> Vec<String> {
        match self {
            Self::Texts(texts) if rows.len() == texts.len() => texts,
            Self::Texts(texts) => rows.iter().map(|row| texts[*row].clone()).collect(),
            Self::Numbers(values, decimals) => {
                rows.iter().map(|row| decimals.show(values[*row])).collect()
            }
        }
    }
}

impl Sheet {
    /// The names of the columns.
    pub fn names(&self) -> Vec<String> {
        self.columns.iter().map(|(name, _)| name.clone()).collect()
    }

    /// How many values each of three columns has.
    fn same_length(
        &self,
        places: [usize; 3],
        layout: &Layout,
        what: &str,
    ) -> Result<usize, InputError> {
        let count = self.columns[places[0]].1.len();
        for (quantity, place) in Quantity::ALL.into_iter().zip(places) {
            let (name, found) = (&self.columns[place].0, self.columns[place].1.len());
            if found != count {
                return Err(InputError::new(
                    format!(
                        "{what} {name} has {found} values, and {} has {count}",
                        layout.names.of(Quantity::Time)
                    ),
                    "give them one value a sample each, taken at the same times",
                )
                .in_column(layout.names.of(quantity)));
            }
        }
        Ok(count)
    }

    /// Makes the columns that were not recorded, which are behind the last: a pressure of zero, and
    /// the number of the row.
    fn make_columns(&mut self, mut places: [usize; 3], layout: &Layout) -> [usize; 3] {
        let width = self.columns.len();
        let mut recorded = places.iter().filter(|place| **place < width);
        let rows = recorded
            .next()
            .map_or(0, |place| self.columns[*place].1.len());
        for (quantity, place) in Quantity::ALL.into_iter().zip(&mut places) {
            if *place < width {
                continue;
            }
            let name = layout.names.of(quantity);
            let value = |row: usize| if name == ROW { row as f64 } else { 0.0 };
            *place = self.columns.len();
            let numbers = Values::Numbers((0..rows).map(value).collect(), Decimals::Various);
            self.columns.push((name.to_owned(), numbers));
        }
        places
    }

    /// Refuses a column that is there and cannot be read, by its name and type.
    fn check_unread(
        &self,
        header: &[String],
        layout: &Layout,
        what: &str,
    ) -> Result<(), InputError> {
        for wanted in Quantity::ALL.map(|it| layout.names.of(it)) {
            if header.iter().any(|name| name == wanted) {
                continue;
            }
            let is_it = |name: &str| {
                let rest = wanted.strip_prefix(name);
                rest.is_some_and(|rest| {
                    rest.is_empty() || rest.starts_with(['(', '{', '.', '[', '/'])
                })
            };
            let Some((name, is)) = self.unread.iter().find(|(name, _)| is_it(name)) else {
                continue;
            };
            return Err(InputError::new(
                format!("{what} {name} is {is}, which is not read"),
                "save it as numbers, one array a quantity, or export the table as CSV",
            )
            .in_column(wanted));
        }
        Ok(())
    }

    /// Names what is there as well, and what it is.
    fn with_unread(&self, mut error: InputError) -> InputError {
        /// Most that are named.
        const MOST: usize = 20;
        if error.found.starts_with("has no ") && !self.unread.is_empty() {
            let all = self.unread.iter().take(MOST);
            let all: Vec<String> = all.map(|(name, is)| format!("{name}: {is}")).collect();
            error.found += &format!("; not read are {}", all.join(", "));
        }
        error
    }

    /// Makes samples of it. `what` a column is called in this format: a column, a variable.
    ///
    /// # Errors
    ///
    /// Names the file, the column and what is wrong with it.
    pub fn samples(
        mut self,
        path: &Path,
        layout: &Layout,
        limits: Limits,
        what: &str,
    ) -> Result<Samples, InputError> {
        let header = self.names();
        let places = self
            .check_unread(&header, layout, what)
            .and_then(|()| names::find(&header, layout, what))
            .map_err(|error| self.with_unread(error).in_file(path))?;
        let places = self.make_columns(places, layout);
        let count = self
            .same_length(places, layout, what)
            .map_err(|error| error.in_file(path))?;
        limits
            .check(count as u64, self.columns.len())
            .map_err(|error| error.in_file(path))?;
        let mut samples = Samples {
            columns: layout.columns.or(self.columns_say),
            meta: self.meta.take(),
            warnings: std::mem::take(&mut self.warnings),
            ..Samples::default()
        };
        samples
            .check_units_in_names(layout)
            .map_err(|error| error.in_file(path))?;
        let mut numbers: [Vec<f64>; 3] = Default::default();
        for ((quantity, place), into) in Quantity::ALL.into_iter().zip(places).zip(&mut numbers) {
            let name = layout.names.of(quantity);
            if let (Quantity::Time, Values::Texts(texts)) = (quantity, &self.columns[place].1)
                && let Some(read) = stamps::all(texts)
            {
                samples.is_time_of_day = read.is_of_day;
                *into = read.seconds;
                samples.columns.time = Some(TimeUnit::S);
                samples.decimals[quantity as usize] = Decimals::Various;
                continue;
            }
            let Values::Numbers(values, decimals) = &mut self.columns[place].1 else {
                let Values::Texts(texts) = &self.columns[place].1 else {
                    continue;
                };
                let error = match texts.iter().find(|text| !text.is_empty()) {
                    Some(text) if quantity == Quantity::Time => stamps::no_form(text),
                    _ => InputError::new(format!("{what} {name} holds text"), "give it numbers"),
                };
                return Err(error.in_file(path).in_column(name));
            };
            *into = std::mem::take(values);
            samples.decimals[quantity as usize] = *decimals;
        }
        let [times, pressures, angles] = numbers;
        let mut bad = BadLines::default();
        let mut kept = Vec::with_capacity(count);
        for (row, ((time, pressure), angle)) in
            (1..).zip(times.into_iter().zip(pressures).zip(angles))
        {
            let place = |error: InputError| InputError {
                found: format!("row {row}: {}", error.found),
                ..error.in_file(path)
            };
            let values = [time, pressure, angle];
            if let Some((quantity, error)) = unusable(values) {
                bad.take(
                    row as u64,
                    place(error).in_column(layout.names.of(quantity)),
                );
                continue;
            }
            kept.push(row - 1);
            if let Some((of, question)) = samples.push(values) {
                let (path, column) = (path.display(), layout.names.of(of));
                samples
                    .warnings
                    .push(format!("{path}, row {row}, column {column}: {question}"));
            }
        }
        if kept.len() < count {
            samples.lines = samples.lines.pick(kept.iter().copied());
        }
        bad.finish(&mut samples, path, layout)?;
        for (place, (name, values)) in self.columns.into_iter().enumerate() {
            if !places.contains(&place) && values.len() == count {
                samples.extra.push(Column {
                    name: optional_name(&name, layout),
                    fields: values.shown(&kept),
                });
            }
        }
        samples.forget_converted_decimals();
        samples
            .finish(path, layout, |error, row| InputError {
                found: format!("row {row}: {}", error.found),
                ..error
            })
            .map_err(|error| error.in_file(path))?;
        Ok(samples)
    }
}

impl Samples {
    /// Forgets the decimals of converted columns: they differ from the file's.
    fn forget_converted_decimals(&mut self) {
        let said = self.columns;
        for quantity in Quantity::ALL {
            let converted = self
                .columns
                .unit(quantity)
                .is_some_and(|it| !it.is_promised())
                || said.exchange
                || said.scales[quantity as usize].is_some()
                || (quantity == Quantity::Pressure && said.air_kpa.is_some())
                || (quantity == Quantity::Angle && said.angle_zero_deg.is_some());
            if converted {
                self.decimals[quantity as usize] = Decimals::Various;
            }
        }
    }

    /// Mends the clock, once all rows are there; what was done is said. `at` puts the number of
    /// a row, from 1, or its line into an error.
    ///
    /// # Errors
    ///
    /// Names the line of a time that does not follow, in a file that has no order.
    fn finish(
        &mut self,
        path: &Path,
        layout: &Layout,
        at: impl Fn(InputError, u64) -> InputError,
    ) -> Result<(), InputError> {
        let counter = self
            .extra
            .iter()
            .find(|column| clock::is_counter(&column.name))
            .and_then(|column| {
                let numbers = column.fields.iter().map(|field| field.parse::<f64>().ok());
                numbers.collect::<Option<Vec<f64>>>()
            });
        let same = |a: usize, b: usize| {
            #[allow(clippy::float_cmp)] // A copy is a copy to the last bit.
            let numbers = self.pressure_kpa[a] == self.pressure_kpa[b]
                && self.angle_deg[a] == self.angle_deg[b];
            let mut columns = self.extra.iter();
            numbers && columns.all(|column| column.fields[a] == column.fields[b])
        };
        let mended = clock::mend(&clock::Rows {
            time: &self.time_s,
            angle: &self.angle_deg,
            same: &same,
            counter: counter.as_deref(),
            unit_s: self.columns.time.map_or(1.0, TimeUnit::seconds),
            of_day: self.is_time_of_day,
        })
        .map_err(|clock::Disorder(row)| {
            let before = row.checked_sub(1).map_or(f64::NAN, |row| self.time_s[row]);
            let error = InputError::new(
                format!("time {} s does not follow {before} s", self.time_s[row]),
                "times must increase: sort the rows or split the file where the clock restarts",
            );
            let error = error.in_column(layout.names.of(Quantity::Time));
            at(error, self.lines.number(row))
        })?;
        if let Some(mended) = mended {
            self.take_mended(mended, path);
        }
        self.check_length()?;
        self.check_speed(layout)
    }

    fn take_mended(&mut self, mended: clock::Mended, path: &Path) {
        /// Decimals of mended times: microseconds.
        const DECIMALS: usize = 6;
        for clock::Said { what, rows, text } in mended.said {
            let places = rows.iter().map(|row| self.lines.place(*row));
            self.left_out.push(LeftOut::new(what, path, places, text));
        }
        let rows = &mended.rows;
        let pick = |values: &[f64]| -> Vec<f64> { rows.iter().map(|row| values[*row]).collect() };
        self.pressure_kpa = pick(&self.pressure_kpa);
        self.angle_deg = pick(&self.angle_deg);
        for column in &mut self.extra {
            column.fields = rows.iter().map(|row| column.fields[*row].clone()).collect();
        }
        self.lines = self.lines.pick(rows.iter().copied());
        self.time_s = mended.time;
        self.stamps = mended.stamps;
        self.breaks = mended.breaks;
        if self.stamps.is_some() || !self.breaks.is_empty() {
            self.decimals[Quantity::Time as usize] = Decimals::All(DECIMALS);
        }
    }

    /// Refuses times that no rig is sampled at: they are in another unit.
    fn check_speed(&self, layout: &Layout) -> Result<(), InputError> {
        /// Shortest interval (s).
        const SHORTEST_S: f64 = 2e-6;
        /// Days since 1900 in Excel, and since the year 0 in MATLAB, of this century.
        const EXCEL: std::ops::Range<f64> = 36_000.0..80_000.0;
        const DATENUM: std::ops::Range<f64> = 730_000.0..770_000.0;
        let (first, last) = (self.time_s[0], self.time_s[self.len() - 1]);
        if (last - first) / (self.len() - 1) as f64 >= SHORTEST_S {
            return Ok(());
        }
        let written = self.columns.time.map_or(1.0, TimeUnit::seconds);
        let in_days = match first / written {
            days if EXCEL.contains(&days) => {
                ", and look like days since 1900, as Excel counts them"
            }
            days if DATENUM.contains(&days) => {
                ", and look like MATLAB's datenum, days since the year 0"
            }
            _ => "",
        };
        let unit = if in_days.is_empty() { "UNIT" } else { "day" };
        Err(InputError::new(
            format!(
                "{} samples in {} s: these times are in another unit than {}{in_days}",
                self.len(),
                crate::numbers::short(last - first),
                self.columns.time.map_or("s", Into::into),
            ),
            format!("say in which with --units time={unit}, or write seconds"),
        )
        .in_column(layout.names.of(Quantity::Time)))
    }

    fn check_length(&self) -> Result<(), InputError> {
        if self.len() < 2 {
            return Err(InputError::new(
                format!("has {} samples", self.len()),
                "a recording needs at least two; record it again",
            ));
        }
        Ok(())
    }
}

/// The name of an optional column, if the user says that the file has it under another.
fn optional_name(found: &str, layout: &Layout) -> String {
    let optional = layout.names.optional.iter();
    optional
        .filter(|(_, column)| column == found)
        .map(|(name, _)| name.clone())
        .next()
        .unwrap_or_else(|| found.to_owned())
}

/// The first of three values that is not a number, or that no sensor shows.
fn unusable(values: [f64; 3]) -> Option<(Quantity, InputError)> {
    let mut all = Quantity::ALL.into_iter().zip(values);
    let is_not = |value: f64| value.is_nan() || value.abs() > LARGEST_NUMBER;
    let (quantity, value) = all.find(|(_, value)| is_not(*value))?;
    Some((quantity, not_usable(&value.to_string())))
}

/// A value that is not a number, or that no sensor shows.
fn not_usable(written: &str) -> InputError {
    InputError::new(
        format!("{written} is not a number that can be used"),
        "delete the rows without a reading; gaps in time are allowed",
    )
}

/// Says what a library found in a damaged file.
pub fn damaged(path: &Path, format: &str, error: &dyn std::fmt::Display) -> InputError {
    InputError::new(
        format!("is a damaged {format} file: {error}"),
        "copy it again from where it was written, or export it again",
    )
    .in_file(path)
}

/// Reads a whole stream, as far as it may be.
///
/// # Errors
///
/// Names the file that cannot be read, or is too large.
pub fn read_whole(whole: impl Read, path: &Path, limits: Limits) -> Result<Vec<u8>, InputError> {
    let mut bytes = Vec::new();
    whole
        .take(limits.bytes + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| InputError::from_io(path, &error))?;
    if bytes.len() as u64 > limits.bytes {
        return Err(bounded::too_large(limits.bytes).in_file(path));
    }
    Ok(bytes)
}
