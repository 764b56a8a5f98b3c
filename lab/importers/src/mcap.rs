//! MCAP: the logs of ROS 2 and Foxglove, in which every sensor has a topic and a clock.
//!
//! [`topics`](crate::topics) makes columns of them. Files of `softrig convert` have all columns at the
//! same times, and are read back unchanged.

use std::collections::{BTreeMap, HashMap};
use std::io::{Cursor, Read};
use std::path::Path;

use mcap::records::{MessageHeader, Metadata, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{Compression, McapError};
use serde_json::{Value, json};

use crate::guard::guarded;
use crate::topics::{Datum, Encoding, Topics, values};
use softrig_formats::bounded::Limits;
use softrig_formats::columns::{Layout, Quantity};
use softrig_formats::error::InputError;
use softrig_formats::formats::write::Kept;
use softrig_formats::formats::{Decimals, Samples, Sheet, Values, damaged};
use softrig_formats::recording::Meta;

/// Bytes of one record: an image of a camera beside the rig is one.
const LARGEST_RECORD: usize = 256 << 20;

/// Bytes of all records, unpacked. They are not kept, but take their time.
const LARGEST_FILE: u64 = 64 << 30;

/// The record of metadata that `softrig convert` writes, and its entries besides those of
/// [`Kept`].
const OWN: &str = "softrig";
const COLUMNS: &str = "columns";
const BEGIN: &str = "begin_ns";

/// Reads a log.
///
/// # Errors
///
/// Names the file and what is wrong with it, or the topics that it has.
pub(crate) fn read(
    whole: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let mut topics = Topics::of(layout);
    let sheet = match read_log(&mut topics, whole, path, limits)? {
        Some(own) => own.sheet(&mut topics, layout),
        None => topics.sheet(path, layout)?,
    };
    sheet.samples(path, layout, limits, "topic")
}

/// Takes the messages of a file that is one of several of a bag.
///
/// # Errors
///
/// Names the file and what is wrong with it.
pub(crate) fn read_into(
    topics: &mut Topics,
    whole: impl Read,
    path: &Path,
    limits: Limits,
) -> Result<(), InputError> {
    read_log(topics, whole, path, limits).map(drop)
}

fn read_log(
    topics: &mut Topics,
    whole: impl Read,
    path: &Path,
    limits: Limits,
) -> Result<Option<Own>, InputError> {
    topics.next_file();
    let mut log = Log {
        own: None,
        topics,
        schemas: HashMap::new(),
        limits,
    };
    guarded(|| log.read(whole, path)).map_err(|said| damaged(path, "MCAP", &said))??;
    Ok(log.own)
}

/// The contents of a file that `softrig convert` wrote.
#[derive(Debug)]
struct Own {
    kept: Kept,
    begin_ns: u64,
}

impl Own {
    /// The columns of a file that `softrig convert` wrote: all at the times of the first.
    fn sheet(&self, topics: &mut Topics, layout: &Layout) -> Sheet {
        let angle = Quantity::Angle.column();
        let base = topics.wanted().position(|name| name == angle);
        let times = base.map_or_else(Vec::new, |base| topics.series[base].times.clone());
        let time_name = layout.names.of(Quantity::Time).to_owned();
        let mut sheet = Sheet {
            meta: self.kept.meta.clone(),
            ..Sheet::default()
        };
        let seconds = times
            .iter()
            .map(|&time| (i128::from(time) - i128::from(self.begin_ns)) as f64 / 1e9)
            .collect();
        let known = |name: &str| {
            self.kept
                .decimals(name)
                .map_or(Decimals::Various, Decimals::All)
        };
        let decimals = known(Quantity::Time.column());
        sheet
            .columns
            .push((time_name, Values::Numbers(seconds, decimals)));
        let all = std::mem::take(&mut topics.series);
        for (name, series) in topics.wanted().zip(all) {
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
                name.to_owned()
            };
            let values = values(&cells, known(name.trim_start_matches('/')));
            sheet.columns.push((name, values));
        }
        sheet
    }
}

struct Log<'a> {
    own: Option<Own>,
    topics: &'a mut Topics,
    schemas: HashMap<u16, (String, Vec<u8>)>,
    limits: Limits,
}

impl Log<'_> {
    fn read(&mut self, mut whole: impl Read, path: &Path) -> Result<(), InputError> {
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
                        return Err(softrig_formats::bounded::too_large(LARGEST_FILE).in_file(path));
                    }
                    if !is_read(opcode) {
                        continue;
                    }
                    let record =
                        mcap::parse_record(opcode, data).map_err(|error| fault(path, &error))?;
                    self.take(record).map_err(|error| error.in_file(path))?;
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
                self.schemas
                    .insert(header.id, (header.name, data.into_owned()));
            }
            // They may come again, in every chunk and at the end.
            Record::Channel(channel) => {
                let encoding = || encoding(&channel, &self.schemas);
                self.topics
                    .note(channel.id.into(), &channel.topic, encoding)?;
            }
            Record::Message { header, data } => {
                let topic = header.channel_id.into();
                self.topics
                    .take(topic, header.log_time, &data, self.limits)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes over what a file of `softrig convert` says of itself, before its messages.
    fn recognise(&mut self, entries: &BTreeMap<String, String>) {
        let columns: Option<Vec<String>> = entries
            .get(COLUMNS)
            .and_then(|text| serde_json::from_str(text).ok());
        let begin = entries.get(BEGIN).and_then(|text| text.parse().ok());
        if let (Some(columns), Some(begin_ns)) = (columns, begin)
            && self.topics.are_new()
        {
            self.own = Some(Own {
                kept: Kept::of(|key| entries.get(key).cloned()),
                begin_ns,
            });
            let named = |name: String| (name.clone(), name);
            self.topics.want(columns.into_iter().map(named).collect());
        }
    }
}

/// How the messages of a channel are written.
fn encoding(
    channel: &mcap::records::Channel,
    schemas: &HashMap<u16, (String, Vec<u8>)>,
) -> Result<Encoding, InputError> {
    let topic = &channel.topic;
    match channel.message_encoding.as_str() {
        "json" => Ok(Encoding::Json),
        "cdr" => {
            let none = (String::new(), Vec::new());
            let (kind, text) = schemas.get(&channel.schema_id).unwrap_or(&none);
            Encoding::of_ros(topic, kind, &String::from_utf8_lossy(text))
        }
        other => Err(InputError::new(
            format!("topic {topic} is encoded as \"{other}\""),
            "messages in JSON and those of ROS 2 (cdr) are read: convert the log, or export the topic as CSV",
        )),
    }
}

/// Whether there is anything to read in a record.
fn is_read(opcode: u8) -> bool {
    use mcap::records::op;
    [op::SCHEMA, op::CHANNEL, op::MESSAGE, op::METADATA].contains(&opcode)
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
            softrig_formats::bounded::too_large(LARGEST_RECORD as u64).in_file(path)
        }
        // The cause of a failed parse is a page long.
        McapError::Parse(_) => damaged(path, "MCAP", &"a record cannot be read"),
        other => damaged(path, "MCAP", other),
    }
}

/// How the schemas of [`topic`] are written.
pub const SCHEMA_ENCODING: &str = "jsonschema";
/// How each [`message`] is.
pub const MESSAGE_ENCODING: &str = "json";

/// The topic of a column of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Topic {
    /// Its name, `/angle_deg`.
    pub name: String,
    /// The name of its type.
    pub schema_name: String,
    /// The JSON Schema of its messages.
    pub schema: String,
}

/// The topic of a column, whose messages are numbers or texts.
pub fn topic(column: &str, is_text: bool) -> Topic {
    let kind = if is_text { "string" } else { "number" };
    let schema = json!({
        "type": "object",
        "title": column,
        "properties": { "value": { "type": kind, "description": described(column) } },
        "required": ["value"],
    });
    Topic {
        name: format!("/{column}"),
        schema_name: format!("softrig.{column}"),
        schema: schema.to_string(),
    }
}

/// A message on a [`topic`].
pub fn message(value: impl Into<Value>) -> String {
    json!({ "value": value.into() }).to_string()
}

/// The record of metadata by which a log with these columns is read as a recording again: its name
/// and its entries. It stands before the messages; `begin_ns` is when time 0 was (ns since 1970).
pub fn about(columns: &[&str], begin_ns: u64) -> (String, BTreeMap<String, String>) {
    let columns = Value::from(columns).to_string();
    let entries = [(COLUMNS, columns), (BEGIN, begin_ns.to_string())];
    let entries = entries.map(|(key, value)| (key.to_owned(), value));
    (OWN.to_owned(), BTreeMap::from(entries))
}

/// A recording as a log: a topic a column, in JSON.
///
/// # Errors
///
/// Errors of the library; times less than a nanosecond apart.
pub(crate) fn write(sheet: &Sheet, meta: &Meta) -> anyhow::Result<Vec<u8>> {
    let Some((_, Values::Numbers(seconds, _))) = sheet.columns.first() else {
        anyhow::bail!("there is no time");
    };
    let begin_ns = begin_of(seconds, meta);
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
    let (name, own) = about(&names, begin_ns);
    writer.write_metadata(&Metadata {
        name,
        metadata: Kept::of_sheet(sheet)
            .entries()
            .into_iter()
            .chain(own)
            .collect(),
    })?;
    let mut channels = Vec::new();
    for (name, values) in columns {
        let topic = topic(name, matches!(values, Values::Texts(_)));
        let schema =
            writer.add_schema(&topic.schema_name, SCHEMA_ENCODING, topic.schema.as_bytes())?;
        channels.push(writer.add_channel(
            schema,
            &topic.name,
            MESSAGE_ENCODING,
            &BTreeMap::new(),
        )?);
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
            writer.write_to_known_channel(&header, message(value).as_bytes())?;
        }
    }
    writer.finish()?;
    Ok(writer.into_inner().into_inner())
}

/// When time 0 was (ns since 1970), or a time before the first sample if that is not known.
fn begin_of(seconds: &[f64], meta: &Meta) -> u64 {
    let started = meta.started_unix_s().unwrap_or(0.0) + meta.begins_s.unwrap_or(0.0);
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
