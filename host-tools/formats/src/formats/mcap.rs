//! MCAP: the logs of ROS 2 and Foxglove, in which every sensor has a topic and a clock.
//!
//! Topics take the place of columns: `pressure=/rig/pressure.data` is the field `data` of the
//! messages on `/rig/pressure`. JSON and ROS 2 (CDR) messages are read. The times of a topic are
//! the log times of its messages, from the first sample on.
//!
//! Separate topics are not sampled together, so there is one row per angle. The pressure is
//! interpolated between the two messages around it, since a held pressure would lag by half an
//! interval and shift every time constant. Set-points and states are held, since they jump.
//! Where the pressure is missing for longer than a few of its intervals, or has not begun, there
//! are no rows.
//!
//! Files of `rig convert` have all columns at the same times, and are read back unchanged.

use std::collections::{BTreeMap, HashMap};
use std::io::{Cursor, Read};
use std::path::Path;

use mcap::records::{MessageHeader, Metadata, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Compression, McapError};
use serde_json::{Value, json};
use statrs::statistics::{Data, OrderStatistics};

use super::guard::guarded;
use super::ros::Definition;
use super::write::Kept;
use super::{Decimals, Samples, Sheet, Values, damaged, names};
use crate::bounded::Limits;
use crate::columns::{Layout, OPTIONAL, Quantity};
use crate::error::InputError;
use crate::recording::{GAP_FACTOR, Meta};

/// Bytes of one record: an image of a camera beside the rig is one.
const LARGEST_RECORD: usize = 256 << 20;

/// Bytes of all records, unpacked. They are not kept, but take their time.
const LARGEST_FILE: u64 = 64 << 30;

/// Fields that hold the number of a message with one.
const USUAL_FIELDS: [&str; 2] = ["value", "data"];

/// The record of metadata that `rig convert` writes, and its entries besides those of
/// [`Kept`].
const OWN: &str = "softrig";
const COLUMNS: &str = "columns";
const BEGIN: &str = "begin_ns";

/// Reads a log.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the topics that it has.
pub fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let mut log = Log::new(layout);
    guarded(|| log.read(whole, path, limits)).map_err(|said| damaged(path, "MCAP", &said))??;
    let sheet = match &log.own {
        Some(_) => log.sheet_of_our_own(layout),
        None => log.sheet(path, layout)?,
    };
    sheet.samples(path, layout, limits, "topic")
}

/// The samples of a topic.
#[derive(Debug, Default)]
struct Series {
    /// When, in nanoseconds on the clock of the log.
    times: Vec<u64>,
    values: Vec<Datum>,
}

#[derive(Clone, Debug, PartialEq)]
enum Datum {
    Number(f64),
    Text(String),
}

/// A channel whose messages are read.
struct Source {
    /// The place among the columns.
    column: usize,
    /// The fields that lead to the number; none if there is only one.
    path: Vec<String>,
    topic: String,
    encoding: Encoding,
}

enum Encoding {
    Json,
    Ros(Definition),
}

/// The contents of a file that `rig convert` wrote.
#[derive(Debug)]
struct Own {
    kept: Kept,
    begin_ns: u64,
}

struct Log {
    own: Option<Own>,
    /// The columns that are wanted: their names here, and how they are called in the file.
    wanted: Vec<(String, String)>,
    series: Vec<Series>,
    schemas: HashMap<u16, (String, String, Vec<u8>)>,
    sources: HashMap<u16, Vec<Source>>,
    topics: Vec<String>,
    values: u64,
}

impl Log {
    fn new(layout: &Layout) -> Self {
        let mut wanted: Vec<(String, String)> = [Quantity::Pressure, Quantity::Angle]
            .map(|it| layout.names.of(it).to_owned())
            .map(|name| (name.clone(), name))
            .into();
        wanted.extend(OPTIONAL.iter().map(|&name| {
            let said = layout.names.optional.iter().find(|(it, _)| it == name);
            let topic = said.map_or(name, |(_, topic)| topic);
            (name.to_owned(), topic.to_owned())
        }));
        let mut log = Self {
            own: None,
            wanted: Vec::new(),
            series: Vec::new(),
            schemas: HashMap::new(),
            sources: HashMap::new(),
            topics: Vec::new(),
            values: 0,
        };
        log.want(wanted);
        log
    }

    fn want(&mut self, wanted: Vec<(String, String)>) {
        self.series = wanted.iter().map(|_| Series::default()).collect();
        self.wanted = wanted;
    }

    fn read(
        &mut self,
        mut whole: impl Read,
        path: &Path,
        limits: Limits,
    ) -> Result<(), InputError> {
        let mut reader = LinearReader::new_with_options(
            LinearReaderOptions::default()
                .with_validate_chunk_crcs(true)
                .with_record_length_limit(LARGEST_RECORD),
        );
        let mut bytes = 0_u64;
        while let Some(event) = reader.next_event() {
            match event.map_err(|error| fault(path, &error))? {
                LinearReadEvent::ReadRequest(need) => {
                    let into = reader.insert(need.min(LARGEST_RECORD));
                    let count = whole
                        .read(into)
                        .map_err(|error| InputError::from_io(path, &error))?;
                    reader.notify_read(count);
                }
                LinearReadEvent::Record { data, opcode } => {
                    bytes += data.len() as u64;
                    if bytes > LARGEST_FILE {
                        return Err(crate::bounded::too_large(LARGEST_FILE).in_file(path));
                    }
                    if !is_read(opcode) {
                        continue;
                    }
                    let record =
                        mcap::parse_record(opcode, data).map_err(|error| fault(path, &error))?;
                    self.take(record).map_err(|error| error.in_file(path))?;
                    let longest = self.series.iter().map(|it| it.times.len()).max();
                    limits
                        .check(longest.unwrap_or(0) as u64, 1)
                        .and_then(|()| {
                            limits.check(1, usize::try_from(self.values).unwrap_or(usize::MAX))
                        })
                        .map_err(|error| error.in_file(path))?;
                }
            }
        }
        Ok(())
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), InputError> {
        match record {
            Record::Metadata(Metadata { name, metadata }) if name == OWN => {
                self.recognise(&metadata);
            }
            Record::Schema { header, data } => {
                let schema = (header.name, header.encoding, data.into_owned());
                self.schemas.insert(header.id, schema);
            }
            Record::Channel(channel) => {
                // They may come again, in every chunk and at the end.
                if !self.topics.contains(&channel.topic) {
                    self.topics.push(channel.topic.clone());
                }
                if !self.sources.contains_key(&channel.id) {
                    let sources = self.sources_in(&channel)?;
                    self.sources.insert(channel.id, sources);
                }
            }
            Record::Message { header, data } => {
                for source in self.sources.get(&header.channel_id).into_iter().flatten() {
                    let datum = datum(source, &data)?;
                    let series = &mut self.series[source.column];
                    series.times.push(header.log_time);
                    series.values.push(datum);
                    self.values += 1;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes over what a file of `rig convert` says of itself, before its messages.
    fn recognise(&mut self, entries: &BTreeMap<String, String>) {
        let columns: Option<Vec<String>> = entries
            .get(COLUMNS)
            .and_then(|text| serde_json::from_str(text).ok());
        let begin = entries.get(BEGIN).and_then(|text| text.parse().ok());
        if let (Some(columns), Some(begin_ns)) = (columns, begin)
            && self.sources.is_empty()
        {
            self.own = Some(Own {
                kept: Kept::of(|key| entries.get(key).cloned()),
                begin_ns,
            });
            let named = |name: String| (name.clone(), name);
            self.want(columns.into_iter().map(named).collect());
        }
    }

    /// The columns that a channel provides.
    fn sources_in(&self, channel: &mcap::records::Channel) -> Result<Vec<Source>, InputError> {
        let mut sources = Vec::new();
        for (column, (_, called)) in self.wanted.iter().enumerate() {
            let Some(path) = path_in(&channel.topic, called) else {
                continue;
            };
            let encoding = match channel.message_encoding.as_str() {
                "json" => Encoding::Json,
                "cdr" => {
                    let none = (String::new(), String::new(), Vec::new());
                    let (name, _, text) = self.schemas.get(&channel.schema_id).unwrap_or(&none);
                    Encoding::Ros(Definition::parse(name, &String::from_utf8_lossy(text)))
                }
                other => {
                    return Err(InputError::new(
                        format!("topic {} is encoded as \"{other}\"", channel.topic),
                        "messages in JSON and those of ROS 2 (cdr) are read: convert the log, or export the topic as CSV",
                    ));
                }
            };
            sources.push(Source {
                column,
                path,
                topic: channel.topic.clone(),
                encoding,
            });
        }
        Ok(sources)
    }

    /// The columns of a file that `rig convert` wrote: all at the times of the first.
    fn sheet_of_our_own(&mut self, layout: &Layout) -> Sheet {
        let Some(own) = self.own.take() else {
            return Sheet::default();
        };
        let angle = Quantity::Angle.column();
        let base = self.wanted.iter().position(|(name, _)| name == angle);
        let times = base.map_or_else(Vec::new, |base| self.series[base].times.clone());
        let time_name = layout.names.of(Quantity::Time).to_owned();
        let mut sheet = Sheet {
            meta: own.kept.meta.clone(),
            ..Sheet::default()
        };
        let seconds = times
            .iter()
            .map(|&time| (i128::from(time) - i128::from(own.begin_ns)) as f64 / 1e9)
            .collect();
        let known = |name: &str| {
            own.kept
                .decimals(name)
                .map_or(Decimals::Various, Decimals::All)
        };
        let decimals = known(Quantity::Time.column());
        sheet
            .columns
            .push((time_name, Values::Numbers(seconds, decimals)));
        for ((name, _), series) in self.wanted.iter().zip(std::mem::take(&mut self.series)) {
            let mut at = 0;
            let cells: Vec<Option<Datum>> = times
                .iter()
                .map(|&time| {
                    while series.times.get(at).is_some_and(|&it| it < time) {
                        at += 1;
                    }
                    let here = series.times.get(at) == Some(&time);
                    here.then(|| series.values[at].clone())
                })
                .collect();
            // A layout may name them by their topics.
            let slashed = format!("/{name}");
            let mut said = Quantity::ALL.into_iter().map(|it| layout.names.of(it));
            let name = if said.any(|said| said == slashed) {
                slashed
            } else {
                name.clone()
            };
            let values = values(&cells, known(name.trim_start_matches('/')));
            sheet.columns.push((name, values));
        }
        sheet
    }

    /// The columns of any log, at the times of the angle.
    fn sheet(&mut self, path: &Path, layout: &Layout) -> Result<Sheet, InputError> {
        let mut sheet = Sheet::default();
        let missing = |at: usize| self.series[at].times.is_empty();
        if missing(0) || missing(1) {
            return Err(self.without(path, layout));
        }
        let mut left_out = 0;
        for series in &mut self.series {
            left_out += sorted(series);
        }
        if left_out > 0 {
            sheet.warnings.push(format!(
                "{}: {left_out} messages have the time of another on their topic; the first of each counts",
                path.display()
            ));
        }
        let [pressure, angle, optional @ ..] = self.series.as_slice() else {
            return Ok(sheet);
        };
        let usual = usual_interval(&pressure.times);
        let mut rows: Vec<(u64, f64, f64)> = Vec::new();
        for (&time, value) in angle.times.iter().zip(&angle.values) {
            let (Datum::Number(angle), Some(pressure)) =
                (value, interpolated(pressure, time, usual))
            else {
                continue;
            };
            rows.push((time, pressure, *angle));
        }
        let without = angle.times.len() - rows.len();
        if without > 0 {
            sheet.warnings.push(format!(
                "{}: {without} of {} angles were logged where the pressure was not; they are left out",
                path.display(),
                angle.times.len()
            ));
        }
        let first = rows.first().map_or(0, |row| row.0);
        let names = Quantity::ALL.map(|it| layout.names.of(it).to_owned());
        let [time_name, pressure_name, angle_name] = names;
        let numbers = |of: &dyn Fn(&(u64, f64, f64)) -> f64| {
            Values::Numbers(rows.iter().map(of).collect(), Decimals::Various)
        };
        sheet
            .columns
            .push((time_name, numbers(&|row| (row.0 - first) as f64 / 1e9)));
        sheet.columns.push((pressure_name, numbers(&|row| row.1)));
        sheet.columns.push((angle_name, numbers(&|row| row.2)));
        for ((name, _), series) in self.wanted[2..].iter().zip(optional) {
            if series.times.is_empty() {
                continue;
            }
            let cells: Vec<Option<Datum>> = rows
                .iter()
                .map(|&(time, ..)| {
                    let after = series.times.partition_point(|&it| it <= time);
                    after.checked_sub(1).map(|at| series.values[at].clone())
                })
                .collect();
            sheet
                .columns
                .push((name.clone(), values(&cells, Decimals::Various)));
        }
        Ok(sheet)
    }

    /// Says which topics there are.
    fn without(&self, path: &Path, layout: &Layout) -> InputError {
        // Their messages have the time: that is one that is there.
        let mut header = vec![layout.names.of(Quantity::Time).to_owned()];
        header.extend(self.topics.iter().cloned());
        let silent = (0..2).find(|&at| {
            self.series[at].times.is_empty()
                && self
                    .topics
                    .iter()
                    .any(|topic| path_in(topic, &self.wanted[at].1).is_some())
        });
        let error = match (silent, names::find(&header, layout, "topic")) {
            (Some(at), _) => InputError::new(
                format!("topic {} has no messages", self.wanted[at].1),
                "record it again, or name another topic with --columns",
            ),
            (None, Err(error)) => InputError {
                found: error
                    .found
                    .replace(&format!("(it has {}, ", header[0]), "(it has "),
                ..error
            },
            (None, Ok(_)) => InputError::new("has no samples", "record it again"),
        };
        error.in_file(path)
    }
}

/// Whether there is anything to read in a record.
fn is_read(opcode: u8) -> bool {
    use mcap::records::op;
    [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::METADATA].contains(&opcode)
}

/// The way to a field, if a column that is called so is on a topic: `/topic.field.field`,
/// with or without the slash.
fn path_in(topic: &str, called: &str) -> Option<Vec<String>> {
    let [topic, called] = [topic, called].map(|name| name.trim_start_matches('/'));
    let rest = called.strip_prefix(topic)?;
    if rest.is_empty() {
        return Some(Vec::new());
    }
    let fields = rest.strip_prefix('.')?;
    // `position[0]` is the field 0 of `position`.
    let fields = fields.replace('[', ".").replace(']', "");
    Some(fields.split('.').map(str::to_owned).collect())
}

/// The value in a message.
fn datum(source: &Source, data: &[u8]) -> Result<Datum, InputError> {
    let fields = |fields: &[&str]| {
        let shown = if fields.is_empty() {
            "nothing".to_owned()
        } else {
            fields.join(", ")
        };
        let topic = &source.topic;
        InputError::new(
            format!(
                "a message on {topic} has no number in its field {} (it has {shown})",
                if source.path.is_empty() {
                    USUAL_FIELDS.join(" or ")
                } else {
                    source.path.join(".")
                }
            ),
            format!("name the field behind the topic, as {topic}.FIELD"),
        )
    };
    match &source.encoding {
        Encoding::Ros(definition) => {
            let path: Vec<&str> = source.path.iter().map(String::as_str).collect();
            let found = if path.is_empty() {
                let mut usual = USUAL_FIELDS.iter();
                usual.find_map(|&field| definition.number(data, &[field]))
            } else {
                definition.number(data, &path)
            };
            found
                .map(Datum::Number)
                .ok_or_else(|| fields(&definition.fields()))
        }
        Encoding::Json => {
            let message: Value = serde_json::from_slice(data).map_err(|error| {
                InputError::new(
                    format!("a message on {} is no JSON: {error}", source.topic),
                    "record it again, or name another topic with --columns",
                )
            })?;
            let found = if source.path.is_empty() {
                let mut usual = USUAL_FIELDS.iter().filter_map(|&field| message.get(field));
                usual.next().unwrap_or(&message)
            } else {
                let step = |at: &'_ Value, field: &String| match field.parse::<usize>() {
                    Ok(index) if at.is_array() => at.get(index).cloned(),
                    _ => at.get(field).cloned(),
                };
                let end = source
                    .path
                    .iter()
                    .try_fold(message.clone(), |at, field| step(&at, field));
                return match end {
                    Some(value) => json_datum(&value),
                    None => None,
                }
                .ok_or_else(|| fields(&names_in(&message)));
            };
            json_datum(found).ok_or_else(|| fields(&names_in(&message)))
        }
    }
}

fn names_in(message: &Value) -> Vec<&str> {
    let object = message.as_object().into_iter().flatten();
    object.map(|(name, _)| name.as_str()).collect()
}

fn json_datum(value: &Value) -> Option<Datum> {
    match value {
        Value::Number(number) => number.as_f64().map(Datum::Number),
        Value::Bool(flag) => Some(Datum::Number(f64::from(u8::from(*flag)))),
        Value::String(text) => Some(Datum::Text(text.clone())),
        _ => None,
    }
}

/// A column of numbers, or of texts if one of them is one.
fn values(cells: &[Option<Datum>], decimals: Decimals) -> Values {
    let is_number = |cell: &Option<Datum>| !matches!(cell, Some(Datum::Text(_)));
    if cells.iter().all(is_number) && cells.iter().any(Option::is_some) {
        let number = |cell: &Option<Datum>| match cell {
            Some(Datum::Number(number)) => *number,
            _ => f64::NAN,
        };
        return Values::Numbers(cells.iter().map(number).collect(), decimals);
    }
    let text = |cell: &Option<Datum>| match cell {
        Some(Datum::Text(text)) => text.clone(),
        Some(Datum::Number(number)) => decimals.show(*number),
        None => String::new(),
    };
    Values::Texts(cells.iter().map(text).collect())
}

/// Puts messages in the order of time, and leaves out those at the time of another. Says
/// how many those are.
fn sorted(series: &mut Series) -> usize {
    let before = series.times.len();
    if series.times.windows(2).any(|pair| pair[0] >= pair[1]) {
        let mut order: Vec<usize> = (0..before).collect();
        order.sort_by_key(|&at| series.times[at]);
        order.dedup_by_key(|at| series.times[*at]);
        series.values = order.iter().map(|&at| series.values[at].clone()).collect();
        series.times = order.iter().map(|&at| series.times[at]).collect();
    }
    before - series.times.len()
}

/// The median time between messages (ns).
fn usual_interval(times: &[u64]) -> f64 {
    let mut steps: Vec<f64> = times
        .windows(2)
        .map(|pair| (pair[1] - pair[0]) as f64)
        .collect();
    Data::new(&mut steps[..]).median()
}

/// The value at a time, from the messages around it; none outside and in gaps.
fn interpolated(series: &Series, time: u64, usual: f64) -> Option<f64> {
    let number = |at: usize| match series.values.get(at)? {
        Datum::Number(number) => Some(*number),
        Datum::Text(_) => None,
    };
    let after = series.times.partition_point(|&it| it < time);
    let right = *series.times.get(after)?;
    if right == time {
        return number(after);
    }
    let before = after.checked_sub(1)?;
    let left = series.times[before];
    let interval = (right - left) as f64;
    if interval > GAP_FACTOR * usual {
        return None;
    }
    let share = (time - left) as f64 / interval;
    Some(number(before)? * (1.0 - share) + number(after)? * share)
}

fn fault(path: &Path, error: &McapError) -> InputError {
    match error {
        McapError::UnexpectedEof | McapError::UnexpectedEoc => InputError::new(
            "is an MCAP file that ends in the middle",
            "copy it again; `mcap recover` makes a whole file of what is there",
        )
        .in_file(path),
        McapError::UnsupportedCompression(name) => InputError::new(
            format!("is packed with {name}, which is not read"),
            "pack it with zstd: `mcap compress --compression zstd`",
        )
        .in_file(path),
        McapError::RecordTooLarge { .. } | McapError::ChunkTooLarge(_) => {
            crate::bounded::too_large(LARGEST_RECORD as u64).in_file(path)
        }
        // The cause of a failed parse is a page long.
        McapError::Parse(_) => damaged(path, "MCAP", &"a record cannot be read"),
        other => damaged(path, "MCAP", other),
    }
}

/// A recording as a log: a topic a column, in JSON.
///
/// # Errors
///
/// Errors of the library; times less than a nanosecond apart.
pub(super) fn write(sheet: &Sheet, about: &Meta) -> anyhow::Result<Vec<u8>> {
    let Some((_, Values::Numbers(seconds, _))) = sheet.columns.first() else {
        anyhow::bail!("there is no time");
    };
    let begin_ns = begin_of(seconds, about);
    let times: Vec<u64> = seconds.iter().map(|&time| at_ns(begin_ns, time)).collect();
    anyhow::ensure!(
        times.windows(2).all(|pair| pair[0] < pair[1]),
        "samples are less than a nanosecond apart, which MCAP cannot tell from one"
    );
    let columns = &sheet.columns[1..];
    let mut writer = mcap::WriteOptions::new()
        .compression(Some(Compression::Zstd))
        .library(concat!("softrig/", env!("CARGO_PKG_VERSION")))
        .create(Cursor::new(Vec::new()))?;
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    let own = [
        (COLUMNS.to_owned(), serde_json::to_string(&names)?),
        (BEGIN.to_owned(), begin_ns.to_string()),
    ];
    writer.write_metadata(&Metadata {
        name: OWN.into(),
        metadata: Kept::of_sheet(sheet)
            .entries()
            .into_iter()
            .chain(own)
            .collect(),
    })?;
    let mut channels = Vec::new();
    for (name, values) in columns {
        let kind = match values {
            Values::Numbers(..) => "number",
            Values::Texts(_) => "string",
        };
        let schema = json!({
            "type": "object",
            "title": name,
            "properties": { "value": { "type": kind, "description": described(name) } },
            "required": ["value"],
        });
        let schema = writer.add_schema(
            &format!("softrig.{name}"),
            "jsonschema",
            schema.to_string().as_bytes(),
        )?;
        channels.push(writer.add_channel(schema, &format!("/{name}"), "json", &BTreeMap::new())?);
    }
    for (row, &log_time) in times.iter().enumerate() {
        for (&channel_id, (_, values)) in channels.iter().zip(columns) {
            let value = match values {
                Values::Numbers(numbers, _) if numbers[row].is_nan() => continue,
                Values::Numbers(numbers, _) => json!(numbers[row]),
                Values::Texts(texts) if texts[row].is_empty() => continue,
                Values::Texts(texts) => json!(texts[row]),
            };
            #[allow(clippy::cast_possible_truncation)] // Limited to four million.
            let header = MessageHeader {
                channel_id,
                sequence: row as u32,
                log_time,
                publish_time: log_time,
            };
            writer.write_to_known_channel(
                &header,
                json!({ "value": value }).to_string().as_bytes(),
            )?;
        }
    }
    writer.finish()?;
    Ok(writer.into_inner().into_inner())
}

/// When time 0 was (ns since 1970), or a time before the first sample if that is not known.
fn begin_of(seconds: &[f64], about: &Meta) -> u64 {
    let started = about.started_unix_s().unwrap_or(0.0) + about.begins_s.unwrap_or(0.0);
    let earliest = seconds.first().copied().unwrap_or(0.0).min(0.0);
    // A number of milliseconds is one of nanoseconds, and none before 1970.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let milliseconds = (started.max(-earliest) * 1e3).ceil().clamp(0.0, 9e12) as u64;
    milliseconds * 1_000_000
}

fn at_ns(begin_ns: u64, seconds: f64) -> u64 {
    #[allow(clippy::cast_possible_truncation)] // It saturates.
    let since = (seconds * 1e9).round() as i64;
    begin_ns.saturating_add_signed(since)
}

/// The description of a column in the schema.
fn described(name: &str) -> &'static str {
    match name {
        "pressure_kpa" => "gauge pressure (kPa)",
        "angle_deg" => "bending angle as the sensor shows it (°)",
        "setpoint_deg" => "set-point of the angle (°)",
        "setpoint_kpa" => "set-point of the pressure (kPa)",
        "pump_ul" => "volume that the pump has moved (µl)",
        "predicted_deg" => "angle that the model on the board predicts (°)",
        "state" => "state of the firmware",
        "fault" => "number of the fault, 0 for none",
        "seq" => "number of the line of telemetry",
        _ => "as it was recorded",
    }
}
