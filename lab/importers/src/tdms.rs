//! TDMS: the measurement files of LabVIEW.
//!
//! A file is a list of segments. Each has the channels that it changes, and their raw values: one
//! channel after the other or, interleaved, one value of each in turn, in either order of bytes.
//! The source is National Instruments' "TDMS File Format Internal Structure".
//!
//! This reader exists because there is no library that is kept up and reads interleaved and
//! big-endian values from memory: docs/decisions/0076.

use std::collections::HashMap;
use std::io::Read;
use std::path::Path;

use softrig_formats::bounded::Limits;
use softrig_formats::columns::{Layout, Quantity, TimeUnit, Unit};
use softrig_formats::error::InputError;
use softrig_formats::formats::{Decimals, Samples, Sheet, Values, damaged, read_whole};

/// Bytes before a segment's metadata.
const LEAD_IN: usize = 28;
const BEGIN: &[u8] = b"TDSm";

/// What a segment has, in its table of contents.
mod contents {
    pub const METADATA: u32 = 1 << 1;
    pub const NEW_LIST: u32 = 1 << 2;
    pub const RAW: u32 = 1 << 3;
    pub const INTERLEAVED: u32 = 1 << 5;
    pub const BIG_ENDIAN: u32 = 1 << 6;
    pub const DAQMX: u32 = 1 << 7;
}

/// In place of the length of an index: no values in this segment, values as in the segment before,
/// and the two kinds of DAQmx.
const NO_VALUES: u32 = u32::MAX;
const AS_BEFORE: u32 = 0;
const DAQMX: [u32; 2] = [0x1269, 0x126a];

/// In place of where the next segment begins: LabVIEW ended before it wrote that.
const NEVER_CLOSED: u64 = u64::MAX;

/// Seconds from 1904, where LabVIEW's clock begins, to 1970.
const FROM_1904_TO_1970_S: i64 = 2_082_844_800;

/// Shares of an interval by which the first samples of two channels may differ.
const SAME_START: f64 = 0.01;

/// More channels than any rig has.
const MOST_CHANNELS: usize = 10_000;

/// How a file that is not read here is converted.
pub(crate) const CONVERT: &str = "convert it: python3 -c \"from nptdms import TdmsFile; TdmsFile.read('FILE').as_dataframe().to_csv('run.csv', index=False)\"";

/// Reads a TDMS file.
///
/// Numbers, time stamps and texts are read; raw values of DAQmx and values with a scale that is
/// still to be applied are refused with the line that converts them.
///
/// A channel is called by its name, `GROUP/CHANNEL` where two groups have it. If no channel is the
/// time, the waveform's own counts: `wf_start_offset` and `wf_increment` of the pressure, which have
/// to be those of the angle. Time stamps are seconds since 1970. A unit in `unit_string` is that of
/// the channel.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the channels that it has.
pub fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let bytes = read_whole(whole, path, limits)?;
    let mut file = File {
        channels: Vec::new(),
        places: HashMap::new(),
        listed: Vec::new(),
        values: limits.fields,
        visits: limits.fields,
        was_cut: false,
    };
    let sheet = file
        .segments(&bytes)
        .and_then(|()| file.sheet(path, layout))
        .map_err(|fault| match fault {
            Fault::Damaged(what) => damaged(path, "TDMS", &what),
            Fault::EndsEarly => InputError::new(
                "is a TDMS file that ends in the middle",
                "copy it again from where it was written",
            )
            .in_file(path),
            Fault::TooLarge => softrig_formats::bounded::too_large(limits.bytes).in_file(path),
            Fault::NotRead(what) => {
                let advice = CONVERT.replace("FILE", &path.display().to_string());
                InputError::new(what, advice).in_file(path)
            }
            Fault::Times(error) => error.in_file(path),
        })?;
    sheet.samples(path, layout, limits, "channel")
}

/// Why a file is not read.
enum Fault {
    Damaged(&'static str),
    EndsEarly,
    TooLarge,
    NotRead(String),
    Times(InputError),
}

/// What the values of a channel, or of a property, are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32,
    F64,
    Bool,
    Stamp,
    Text,
    /// Complex numbers, of so many bytes.
    Complex(usize),
}

impl Kind {
    fn of(code: u32) -> Option<Self> {
        Some(match code {
            0x01 => Self::I8,
            0x02 => Self::I16,
            0x03 => Self::I32,
            0x04 => Self::I64,
            0x05 => Self::U8,
            0x06 => Self::U16,
            0x07 => Self::U32,
            0x08 => Self::U64,
            // With a unit too, which is a property.
            0x09 | 0x19 => Self::F32,
            0x0a | 0x1a => Self::F64,
            0x20 => Self::Text,
            0x21 => Self::Bool,
            0x44 => Self::Stamp,
            0x0008_000c => Self::Complex(8),
            0x0010_000d => Self::Complex(16),
            _ => return None,
        })
    }

    /// Bytes of one; none of a text.
    fn size(self) -> Option<usize> {
        Some(match self {
            Self::I8 | Self::U8 | Self::Bool => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
            Self::Stamp => 16,
            Self::Complex(size) => size,
            Self::Text => return None,
        })
    }
}

/// What a segment says of the values of a channel.
#[derive(Clone, Copy, Debug)]
struct Index {
    kind: Kind,
    /// Values of a chunk.
    count: usize,
    /// Their bytes.
    bytes: usize,
}

#[derive(Debug, Default)]
struct Channel {
    group: String,
    name: String,
    index: Option<Index>,
    is_listed: bool,
    has_values: bool,
    numbers: Vec<f64>,
    texts: Vec<String>,
    is_stamp: bool,
    increment_s: Option<f64>,
    /// Time of the first sample after the waveform's own start (s).
    offset_s: f64,
    /// The waveform's start (s since 1970).
    start_s: Option<f64>,
    unit: Option<String>,
    scales: f64,
    scaling_status: Option<String>,
}

impl Channel {
    fn begins_s(&self) -> f64 {
        self.start_s.unwrap_or(0.0) + self.offset_s
    }

    fn path(&self) -> String {
        format!("{}/{}", self.group, self.name)
    }

    fn has_scale_to_apply(&self) -> bool {
        self.scales > 0.0 && self.scaling_status.as_deref() != Some("scaled")
    }

    fn len(&self) -> usize {
        self.numbers.len().max(self.texts.len())
    }
}

/// The value of a property.
enum Property {
    Number(f64),
    Text(String),
    Other,
}

/// Bytes in one of two orders.
#[derive(Clone)]
struct Reader<'a> {
    bytes: &'a [u8],
    is_big_endian: bool,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Fault> {
        let (taken, rest) = self.bytes.split_at_checked(count).ok_or(Fault::EndsEarly)?;
        self.bytes = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let mut array: [u8; N] = self.take(N)?.try_into().map_err(|_| Fault::EndsEarly)?;
        if self.is_big_endian {
            array.reverse();
        }
        Ok(array)
    }

    fn u32(&mut self) -> Result<u32, Fault> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, Fault> {
        self.array().map(u64::from_le_bytes)
    }

    /// A number in memory: one that no memory holds is larger than the file.
    fn length(&mut self) -> Result<usize, Fault> {
        let length = self.u64()?;
        usize::try_from(length).map_err(|_| Fault::EndsEarly)
    }

    fn text(&mut self) -> Result<String, Fault> {
        let length = self.u32()? as usize;
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    /// A value as a number; of a time stamp its seconds since 1970.
    fn number(&mut self, kind: Kind) -> Result<f64, Fault> {
        #[allow(clippy::cast_precision_loss)] // f64 is what all else is in.
        Ok(match kind {
            Kind::I8 => f64::from(i8::from_le_bytes(self.array()?)),
            Kind::I16 => f64::from(i16::from_le_bytes(self.array()?)),
            Kind::I32 => f64::from(i32::from_le_bytes(self.array()?)),
            Kind::I64 => i64::from_le_bytes(self.array()?) as f64,
            Kind::U8 | Kind::Bool => f64::from(u8::from_le_bytes(self.array()?)),
            Kind::U16 => f64::from(u16::from_le_bytes(self.array()?)),
            Kind::U32 => f64::from(self.u32()?),
            Kind::U64 => self.u64()? as f64,
            Kind::F32 => f64::from(f32::from_le_bytes(self.array()?)),
            Kind::F64 => f64::from_le_bytes(self.array()?),
            Kind::Stamp => {
                // As one number of 128 bits, whose upper half counts seconds.
                let stamp = i128::from_le_bytes(self.array()?);
                #[allow(clippy::cast_possible_truncation)] // Half of the bits are left.
                let seconds = (stamp >> 64) as i64;
                let fraction = (stamp & i128::from(u64::MAX)) as f64 / 2_f64.powi(64);
                seconds.saturating_sub(FROM_1904_TO_1970_S) as f64 + fraction
            }
            Kind::Text | Kind::Complex(_) => {
                self.take(kind.size().unwrap_or(0))?;
                f64::NAN
            }
        })
    }

    fn property(&mut self) -> Result<Property, Fault> {
        let kind = Kind::of(self.u32()?).ok_or(Fault::Damaged("a property has no known type"))?;
        Ok(match kind {
            Kind::Text => Property::Text(self.text()?),
            Kind::Complex(size) => {
                self.take(size)?;
                Property::Other
            }
            kind => Property::Number(self.number(kind)?),
        })
    }
}

/// The group and the channel of a path, `/'group'/'channel'` with a quote in a name doubled; none
/// of the file's own path and of a group's.
fn channel_of(path: &str) -> Option<(String, String)> {
    let mut names = Vec::new();
    let mut rest = path;
    while let Some(quoted) = rest.strip_prefix("/'") {
        let mut name = String::new();
        let mut characters = quoted.char_indices().peekable();
        let mut end = quoted.len();
        while let Some((at, character)) = characters.next() {
            let is_quote = character == '\'';
            if is_quote && characters.next_if(|&(_, next)| next == '\'').is_none() {
                end = at + 1;
                break;
            }
            name.push(character);
        }
        names.push(name);
        rest = &quoted[end..];
    }
    match <[String; 2]>::try_from(names) {
        Ok([group, name]) => Some((group, name)),
        Err(_) => None,
    }
}

/// The state of the reader.
struct File {
    channels: Vec<Channel>,
    /// Where the channels are, by their paths.
    places: HashMap<String, usize>,
    /// The channels of the segment, in the order of their values.
    listed: Vec<usize>,
    /// Values that may still be kept.
    values: u64,
    /// Entries of segments that may still be looked at: a short file may repeat a long list.
    visits: u64,
    /// Whether the last segment was never closed.
    was_cut: bool,
}

impl File {
    fn segments(&mut self, bytes: &[u8]) -> Result<(), Fault> {
        let mut rest = bytes;
        while !rest.is_empty() {
            let mut lead_in = Reader {
                bytes: rest,
                is_big_endian: false,
            };
            if lead_in.take(BEGIN.len())? != BEGIN {
                return Err(Fault::Damaged(
                    "no segment begins where the one before it ends",
                ));
            }
            let has = lead_in.u32()?;
            lead_in.is_big_endian = has & contents::BIG_ENDIAN != 0;
            let _version = lead_in.u32()?;
            let next = lead_in.u64()?;
            let raw = lead_in.length()?;
            self.was_cut = next == NEVER_CLOSED;
            let end = if self.was_cut {
                rest.len()
            } else {
                usize::try_from(next)
                    .ok()
                    .and_then(|next| next.checked_add(LEAD_IN))
                    .filter(|&end| end <= rest.len())
                    .ok_or(Fault::EndsEarly)?
            };
            let Some((metadata, values)) = rest[LEAD_IN..end].split_at_checked(raw) else {
                if self.was_cut {
                    return Ok(());
                }
                return Err(Fault::Damaged("a segment is shorter than its metadata"));
            };
            let in_order = |bytes| Reader {
                bytes,
                is_big_endian: lead_in.is_big_endian,
            };
            if has & contents::METADATA != 0 {
                self.metadata(in_order(metadata), has & contents::NEW_LIST != 0)?;
            }
            if has & contents::RAW != 0 {
                if has & contents::DAQMX != 0 {
                    return Err(not_scaled("it"));
                }
                if has & contents::INTERLEAVED != 0 {
                    self.interleaved(&in_order(values))?;
                } else {
                    self.one_after_the_other(in_order(values))?;
                }
            }
            rest = &rest[end..];
        }
        Ok(())
    }

    fn visit(&mut self, entries: usize) -> Result<(), Fault> {
        let left = self.visits.checked_sub(entries as u64);
        self.visits = left.ok_or(Fault::TooLarge)?;
        Ok(())
    }

    fn metadata(&mut self, mut reader: Reader<'_>, is_new_list: bool) -> Result<(), Fault> {
        if is_new_list {
            for place in self.listed.drain(..) {
                self.channels[place].is_listed = false;
            }
        }
        for _ in 0..reader.u32()? {
            self.visit(1)?;
            let path = reader.text()?;
            // The file and its groups have properties, and no values.
            let mut nobody = Channel::default();
            let place = channel_of(&path).map(|(group, name)| {
                *self.places.entry(path).or_insert_with(|| {
                    self.channels.push(Channel {
                        group,
                        name,
                        ..Channel::default()
                    });
                    self.channels.len() - 1
                })
            });
            if place.is_some_and(|place| place >= MOST_CHANNELS) {
                return Err(Fault::NotRead(format!(
                    "has more than {MOST_CHANNELS} channels"
                )));
            }
            let channel = match place {
                Some(place) => &mut self.channels[place],
                None => &mut nobody,
            };
            match reader.u32()? {
                NO_VALUES => channel.has_values = false,
                AS_BEFORE if channel.index.is_none() => {
                    return Err(Fault::Damaged(
                        "a channel is as in a segment before, and there is none",
                    ));
                }
                AS_BEFORE => channel.has_values = true,
                kind if DAQMX.contains(&kind) => return Err(not_scaled(&channel.path())),
                _ => {
                    channel.index = Some(index(&mut reader, channel)?);
                    channel.has_values = true;
                }
            }
            if let Some(place) = place
                && channel.has_values
                && !channel.is_listed
            {
                channel.is_listed = true;
                self.listed.push(place);
            }
            for _ in 0..reader.u32()? {
                let name = reader.text()?;
                let value = reader.property()?;
                keep(channel, &name, value);
            }
        }
        Ok(())
    }

    /// The channels of a segment that have values, and how they are stored.
    fn active(&mut self) -> Result<Vec<(usize, Index)>, Fault> {
        self.visit(self.listed.len())?;
        let with_values = self.listed.iter().filter_map(|&place| {
            let channel = &self.channels[place];
            let index = channel.index.filter(|index| index.count > 0)?;
            channel.has_values.then_some((place, index))
        });
        Ok(with_values.collect())
    }

    /// Keeps a value of a channel.
    fn push(&mut self, place: usize, kind: Kind, reader: &mut Reader<'_>) -> Result<(), Fault> {
        let value = reader.number(kind)?;
        if !matches!(kind, Kind::Complex(_)) {
            self.channels[place].numbers.push(value);
        }
        Ok(())
    }

    fn account(&mut self, values: usize) -> Result<(), Fault> {
        let left = self.values.checked_sub(values as u64);
        self.values = left.ok_or(Fault::TooLarge)?;
        Ok(())
    }

    fn one_after_the_other(&mut self, mut reader: Reader<'_>) -> Result<(), Fault> {
        let active = self.active()?;
        let chunk = active
            .iter()
            .try_fold(0_usize, |sum, (_, index)| sum.checked_add(index.bytes))
            .ok_or(Fault::EndsEarly)?;
        while chunk > 0 && !reader.bytes.is_empty() {
            if reader.bytes.len() < chunk {
                return self.incomplete();
            }
            for &(place, index) in &active {
                let mut values = Reader {
                    bytes: reader.take(index.bytes)?,
                    ..reader
                };
                self.account(index.count)?;
                if index.kind == Kind::Text {
                    self.texts(place, index, values)?;
                    continue;
                }
                for _ in 0..index.count {
                    self.push(place, index.kind, &mut values)?;
                }
            }
        }
        Ok(())
    }

    /// Texts: where each ends, and then all of them.
    fn texts(&mut self, place: usize, index: Index, mut reader: Reader<'_>) -> Result<(), Fault> {
        const WRONG: Fault = Fault::Damaged("a text ends before it begins");
        let mut ends = Reader {
            bytes: reader.take(index.count.checked_mul(4).ok_or(WRONG)?)?,
            ..reader
        };
        let mut begin = 0;
        for _ in 0..index.count {
            let end = ends.u32()? as usize;
            let text = reader.bytes.get(begin..end).ok_or(WRONG)?;
            let text = String::from_utf8_lossy(text).into_owned();
            self.channels[place].texts.push(text);
            begin = end;
        }
        Ok(())
    }

    fn interleaved(&mut self, reader: &Reader<'_>) -> Result<(), Fault> {
        let active = self.active()?;
        let sizes: Option<Vec<usize>> = active.iter().map(|(_, index)| index.kind.size()).collect();
        let sizes = sizes.ok_or(Fault::Damaged("texts are interleaved"))?;
        let row: usize = sizes.iter().sum();
        if row == 0 {
            return Ok(());
        }
        let mut rows = reader.bytes.chunks_exact(row);
        self.account(rows.len().saturating_mul(active.len()))?;
        for bytes in &mut rows {
            let mut values = Reader { bytes, ..*reader };
            for &(place, index) in &active {
                self.push(place, index.kind, &mut values)?;
            }
        }
        if rows.remainder().is_empty() {
            Ok(())
        } else {
            self.incomplete()
        }
    }

    /// The last values of a segment are not all there.
    fn incomplete(&self) -> Result<(), Fault> {
        if self.was_cut {
            return Ok(());
        }
        Err(Fault::Damaged(
            "the values of a segment end in the middle of one",
        ))
    }

    /// The channels as columns.
    fn sheet(&mut self, path: &Path, layout: &Layout) -> Result<Sheet, Fault> {
        let mut sheet = Sheet::default();
        if self.was_cut {
            sheet.warnings.push(format!(
                "{}: was not closed where it was recorded; what its last segment has in part is left out",
                path.display()
            ));
        }
        let channels: Vec<Channel> = std::mem::take(&mut self.channels)
            .into_iter()
            .filter(|channel| channel.len() > 0)
            .collect();
        let names = called(&channels, layout);
        let place = |quantity| {
            let name = layout.names.of(quantity);
            names.iter().position(|it| it == name)
        };
        for quantity in Quantity::ALL {
            let Some(channel) = place(quantity).map(|at| &channels[at]) else {
                continue;
            };
            if channel.has_scale_to_apply() {
                return Err(not_scaled(&channel.path()));
            }
            if channel.is_stamp && quantity == Quantity::Time {
                sheet.columns_say.time = Some(TimeUnit::S);
            }
            let Some(written) = &channel.unit else {
                continue;
            };
            match Unit::of(quantity, written) {
                Some(unit) => sheet.columns_say.set(unit),
                None if layout.columns.unit(quantity).is_none() => sheet.warnings.push(format!(
                    "{}: channel {} says that its unit is {written}, which is none of {}; it is read as {}",
                    path.display(),
                    layout.names.of(quantity),
                    quantity.units(),
                    ["seconds", "kPa", "degrees"][quantity as usize],
                )),
                None => {}
            }
        }
        if layout.names.said(Quantity::Time).is_none() && place(Quantity::Time).is_none() {
            let measured = [Quantity::Pressure, Quantity::Angle].map(place);
            if let Some(times) = waveform_times(&channels, measured).map_err(Fault::Times)? {
                let name = layout.names.of(Quantity::Time).to_owned();
                let times = Values::Numbers(times, Decimals::Various);
                sheet.columns.push((name, times));
                sheet.columns_say.time = Some(TimeUnit::S);
            }
        }
        for (name, channel) in names.into_iter().zip(channels) {
            // As an optional column it would be in no unit.
            if channel.has_scale_to_apply() {
                continue;
            }
            let values = if channel.texts.is_empty() {
                Values::Numbers(channel.numbers, Decimals::Various)
            } else {
                Values::Texts(channel.texts)
            };
            sheet.columns.push((name, values));
        }
        Ok(sheet)
    }
}

/// Says that values are not those that were measured until something is done with them.
fn not_scaled(channel: &str) -> Fault {
    let whose = match channel {
        "it" => "holds".to_owned(),
        channel => format!("has in channel {channel}"),
    };
    Fault::NotRead(format!(
        "{whose} raw values of DAQmx, whose scales are not applied here"
    ))
}

fn index(reader: &mut Reader<'_>, channel: &mut Channel) -> Result<Index, Fault> {
    let code = reader.u32()?;
    let kind = Kind::of(code).ok_or_else(|| {
        let path = channel.path();
        Fault::NotRead(format!(
            "has in channel {path} values of the type {code:#x}, which is not read"
        ))
    })?;
    if reader.u32()? != 1 {
        return Err(Fault::Damaged("a channel has more than one dimension"));
    }
    let count = reader.length()?;
    let bytes = match kind.size() {
        Some(size) => count.checked_mul(size).ok_or(Fault::EndsEarly)?,
        None => reader.length()?,
    };
    if channel.index.is_some_and(|before| {
        channel.len() > 0 && (before.kind == Kind::Text) != (kind == Kind::Text)
    }) {
        return Err(Fault::Damaged("a channel has numbers and texts"));
    }
    channel.is_stamp = kind == Kind::Stamp;
    Ok(Index { kind, count, bytes })
}

/// Keeps the properties that matter.
fn keep(channel: &mut Channel, name: &str, value: Property) {
    match (name, value) {
        ("wf_increment", Property::Number(increment)) => channel.increment_s = Some(increment),
        ("wf_start_offset", Property::Number(offset)) => channel.offset_s = offset,
        ("wf_start_time", Property::Number(start)) => {
            // Later segments may repeat it with their own.
            channel.start_s.get_or_insert(start);
        }
        ("unit_string", Property::Text(unit)) if !unit.trim().is_empty() => {
            channel.unit = Some(unit);
        }
        ("NI_Number_Of_Scales", Property::Number(scales)) => channel.scales = scales,
        ("NI_Scaling_Status", Property::Text(status)) => {
            channel.scaling_status = Some(status);
        }
        _ => {}
    }
}

/// What the channels are called: by their names, or by their paths where the layout does so or
/// the name is that of another too.
fn called(channels: &[Channel], layout: &Layout) -> Vec<String> {
    let mut counts: HashMap<&str, usize> = HashMap::new();
    for channel in channels {
        *counts.entry(&channel.name).or_default() += 1;
    }
    let is_wanted = |path: &str| {
        let mut optional = layout.names.optional.iter();
        Quantity::ALL.iter().any(|&it| layout.names.of(it) == path)
            || optional.any(|(_, column)| column == path)
    };
    let names = channels.iter().map(|channel| {
        let path = channel.path();
        if counts[channel.name.as_str()] > 1 || is_wanted(&path) {
            path
        } else {
            channel.name.clone()
        }
    });
    names.collect()
}

/// The times of the samples (s) as the waveform of pressure and angle has them; none where no
/// channel is a waveform.
fn waveform_times(
    channels: &[Channel],
    measured: [Option<usize>; 2],
) -> Result<Option<Vec<f64>>, InputError> {
    let found: Vec<&Channel> = measured
        .into_iter()
        .flatten()
        .map(|at| &channels[at])
        .collect();
    let mut bases = found.iter().copied().chain(channels);
    let Some((base, increment)) = bases.find_map(|it| Some((it, it.increment_s?))) else {
        return Ok(None);
    };
    let unlike = |what: String| {
        InputError::new(
            what,
            "record both in one task, or resample one and give the times in a channel: --columns time=CHANNEL",
        )
    };
    if !(increment.is_finite() && increment > 0.0 && base.offset_s.is_finite()) {
        return Err(unlike(format!(
            "channel {} says that {increment} s are between its samples",
            base.path()
        )));
    }
    for other in found {
        let theirs = other.increment_s.unwrap_or(increment);
        #[allow(clippy::float_cmp)] // One task writes one number.
        if theirs != increment {
            return Err(unlike(format!(
                "channel {} has {increment} s between its samples, and {} has {theirs} s",
                base.path(),
                other.path()
            )));
        }
        let later = other.begins_s() - base.begins_s();
        let is_together = later.abs() < SAME_START * increment;
        if other.increment_s.is_some() && !is_together {
            return Err(unlike(format!(
                "channel {} begins {later} s after {}",
                other.path(),
                base.path()
            )));
        }
    }
    let times = (0..base.len()).map(|row| base.offset_s + row as f64 * increment);
    Ok(Some(times.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use softrig_formats::columns::Names;

    fn text(value: &str) -> Vec<u8> {
        let length = u32::try_from(value.len()).unwrap();
        [&length.to_le_bytes(), value.as_bytes()].concat()
    }

    fn property(name: &str, code: u32, value: &[u8]) -> Vec<u8> {
        [&text(name), &code.to_le_bytes()[..], value].concat()
    }

    /// What a segment says of a channel.
    fn object(path: &str, index: &[u8], properties: &[Vec<u8>]) -> Vec<u8> {
        let count = u32::try_from(properties.len()).unwrap();
        let mut bytes = text(path);
        bytes.extend(index);
        bytes.extend(count.to_le_bytes());
        bytes.extend(properties.concat());
        bytes
    }

    fn values_of(code: u32, count: u64) -> Vec<u8> {
        let mut index = 20_u32.to_le_bytes().to_vec();
        index.extend(code.to_le_bytes());
        index.extend(1_u32.to_le_bytes());
        index.extend(count.to_le_bytes());
        index
    }

    fn segment(has: u32, objects: &[Vec<u8>], values: &[u8], is_closed: bool) -> Vec<u8> {
        let mut metadata = u32::try_from(objects.len()).unwrap().to_le_bytes().to_vec();
        metadata.extend(objects.concat());
        let length = metadata.len() as u64;
        let next = if is_closed {
            length + values.len() as u64
        } else {
            NEVER_CLOSED
        };
        let mut bytes = BEGIN.to_vec();
        bytes.extend(has.to_le_bytes());
        bytes.extend(4713_u32.to_le_bytes());
        bytes.extend(next.to_le_bytes());
        bytes.extend(length.to_le_bytes());
        bytes.extend(metadata);
        bytes.extend(values);
        bytes
    }

    const FIRST: u32 = contents::METADATA | contents::NEW_LIST | contents::RAW;
    const DOUBLE: u32 = 10;

    fn doubles(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|it| it.to_le_bytes()).collect()
    }

    /// A pressure and an angle with a waveform each.
    fn waves(increments: [f64; 2], starts: [f64; 2], more: &[Vec<u8>]) -> Vec<Vec<u8>> {
        let waves = ["/'rig'/'pressure_kpa'", "/'rig'/'angle_deg'"].into_iter();
        waves
            .zip(increments.into_iter().zip(starts))
            .map(|(path, (increment, start))| {
                let mut properties = vec![
                    property("wf_increment", DOUBLE, &increment.to_le_bytes()),
                    property("wf_start_offset", DOUBLE, &start.to_le_bytes()),
                ];
                properties.extend(more.to_vec());
                object(path, &values_of(DOUBLE, 2), &properties)
            })
            .collect()
    }

    fn good(is_closed: bool, more: &[f64]) -> Vec<u8> {
        let objects = waves([0.5; 2], [1.0; 2], &[]);
        let mut bytes = segment(FIRST, &objects, &doubles(&[1.0, 2.0, 10.0, 20.0]), true);
        // The same channels again, in two chunks.
        let values = [&[3.0, 4.0, 30.0, 40.0, 5.0, 6.0, 50.0, 60.0], more].concat();
        bytes.extend(segment(contents::RAW, &[], &doubles(&values), is_closed));
        bytes
    }

    fn read_as(bytes: &[u8], columns: &str) -> Result<Samples, InputError> {
        let names = match columns {
            "" => Names::default(),
            columns => Names::parse(columns).unwrap(),
        };
        let layout = Layout {
            names,
            ..Layout::default()
        };
        crate::read_bytes(bytes, Path::new("lab.tdms"), &layout)
    }

    #[test]
    fn chunks_and_segments_follow_each_other() {
        let samples = read_as(&good(true, &[]), "").unwrap();
        assert_eq!(samples.time_s, [1.0, 1.5, 2.0, 2.5, 3.0, 3.5]);
        assert_eq!(samples.pressure_kpa, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        assert_eq!(samples.angle_deg, [10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
        assert!(samples.warnings.is_empty());
    }

    #[test]
    fn a_file_that_was_never_closed_is_read_to_its_last_whole_chunk() {
        let samples = read_as(&good(false, &[7.0, 8.0, 70.0]), "").unwrap();
        assert_eq!(samples.pressure_kpa.last(), Some(&6.0));
        assert_eq!(samples.len(), 6);
        assert!(
            samples.warnings[0].contains("lab.tdms: was not closed"),
            "{:?}",
            samples.warnings
        );
    }

    #[test]
    fn a_list_of_channels_is_changed_by_those_that_are_named() {
        let mut bytes = good(true, &[]);
        // The angle is quiet, and a third channel follows the pressure.
        let objects = [
            object("/'rig'/'angle_deg'", &NO_VALUES.to_le_bytes(), &[]),
            object("/'rig'/'pump'", &values_of(3, 1), &[]),
        ];
        let values = [doubles(&[7.0, 8.0]), 9_i32.to_le_bytes().to_vec()].concat();
        let has = contents::METADATA | contents::RAW;
        bytes.extend(segment(has, &objects, &values, true));
        let again = [object("/'rig'/'angle_deg'", &AS_BEFORE.to_le_bytes(), &[])];
        let has = contents::METADATA | contents::NEW_LIST | contents::RAW;
        bytes.extend(segment(has, &again, &doubles(&[70.0, 80.0]), true));
        let samples = read_as(&bytes, "").unwrap();
        assert_eq!(samples.pressure_kpa[6..], [7.0, 8.0]);
        assert_eq!(samples.angle_deg[6..], [70.0, 80.0]);
    }

    #[test]
    fn what_is_wrong_is_said_with_what_to_do() {
        let four = doubles(&[1.0, 2.0, 10.0, 20.0]);
        let of = |objects: &[Vec<u8>], values: &[u8]| segment(FIRST, objects, values, true);
        let scaled = [
            property("NI_Number_Of_Scales", 7, &1_u32.to_le_bytes()),
            property("NI_Scaling_Status", 0x20, &text("unscaled")),
        ];
        let volts = [property("unit_string", 0x20, &text("Volts"))];
        let daqmx = object("/'rig'/'angle_deg'", &DAQMX[0].to_le_bytes(), &[]);
        let extended = object("/'rig'/'angle_deg'", &values_of(0x0b, 2), &[]);
        for (bytes, parts) in [
            (
                of(&waves([0.5, 0.1], [0.0; 2], &[]), &four),
                [
                    "rig/pressure_kpa has 0.5 s between its samples, and rig/angle_deg has 0.1 s",
                    "resample one",
                ],
            ),
            (
                of(&waves([0.5; 2], [0.0, 0.2], &[]), &four),
                [
                    "rig/angle_deg begins 0.2 s after rig/pressure_kpa",
                    "resample",
                ],
            ),
            (
                of(&waves([f64::NAN; 2], [0.0; 2], &[]), &four),
                ["NaN s are between its samples", "time=CHANNEL"],
            ),
            (
                of(&waves([0.5; 2], [0.0; 2], &scaled), &four),
                ["raw values of DAQmx", "nptdms"],
            ),
            (
                of(&[daqmx], &[]),
                [
                    "rig/angle_deg raw values of DAQmx",
                    "TdmsFile.read('lab.tdms')",
                ],
            ),
            (of(&[extended], &[]), ["of the type 0xb", "nptdms"]),
            (
                of(
                    &waves([0.5; 2], [0.0; 2], &[]),
                    &doubles(&[1.0, 2.0, f64::NAN, 1.0]),
                ),
                ["column angle_deg: row 1: NaN", "delete the rows"],
            ),
            (
                of(&waves([0.5; 2], [0.0; 2], &[])[..1], &four[..16]),
                [
                    "has no channel angle_deg (it has time_s, pressure_kpa)",
                    "--columns",
                ],
            ),
            (
                of(&waves([0.5; 2], [0.0; 2], &[]), &four[..24]),
                ["end in the middle of one", "copy it again"],
            ),
            (
                [good(true, &[]), b"TDSx".to_vec()].concat(),
                ["no segment begins", "copy it again"],
            ),
            (
                of(&[object("/'rig'/'a'", &AS_BEFORE.to_le_bytes(), &[])], &[]),
                ["there is none", "copy it again"],
            ),
        ] {
            let said = read_as(&bytes, "").unwrap_err().to_string();
            assert!(said.starts_with("lab.tdms"), "{said}");
            for part in parts {
                assert!(said.contains(part), "{part:?} not in {said:?}");
            }
        }
        let samples = read_as(&of(&waves([0.5; 2], [0.0; 2], &volts), &four), "").unwrap();
        assert!(
            samples.warnings[0].contains("pressure_kpa says that its unit is Volts"),
            "{:?}",
            samples.warnings
        );
    }

    #[test]
    fn names_may_have_quotes_and_slashes() {
        let of = |path: &str| channel_of(path).map(|(group, name)| format!("{group}|{name}"));
        assert_eq!(of("/'a'/'b'").as_deref(), Some("a|b"));
        assert_eq!(of("/'it''s'/'p/q'").as_deref(), Some("it's|p/q"));
        for none in ["/", "/'a'", "", "/'a", "/'a'/'b'/'c'"] {
            assert_eq!(of(none), None, "{none}");
        }
    }

    /// Cut at every byte: an error with advice, or, between two segments, the samples before.
    #[test]
    fn a_file_that_is_cut_off_is_refused_or_shorter() {
        let bytes = good(true, &[]);
        let mut shorter = 0;
        for end in 4..bytes.len() {
            match read_as(&bytes[..end], "") {
                Ok(samples) => {
                    assert_eq!(samples.pressure_kpa, [1.0, 2.0], "{end}");
                    shorter += 1;
                }
                Err(error) => {
                    let said = error.to_string();
                    assert!(
                        said.starts_with(
                            "lab.tdms: is a TDMS file that ends in the middle; copy it"
                        ),
                        "{end}: {said}"
                    );
                }
            }
        }
        assert_eq!(shorter, 1);
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_reader_panic(
            places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
            end in any::<prop::sample::Index>(),
        ) {
            let mut bytes = good(true, &[]);
            for (place, byte) in places {
                let at = place.index(bytes.len());
                bytes[at] = byte;
            }
            bytes.truncate(end.index(bytes.len()));
            let _ = read_as(&bytes, "");
        }
    }
}
