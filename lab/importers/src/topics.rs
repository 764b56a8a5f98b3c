//! Topics: how the logs of robots have what others have in columns.
//!
//! Topics take the place of columns: `pressure=/rig/pressure.data` is the field `data` of the
//! messages on `/rig/pressure`, and `/joint_states.position[0]` the first of an array. JSON and ROS 2
//! (CDR) messages are read.
//!
//! Separate topics are not sampled together, so there is one row per angle, and the others are taken
//! to its times ([`Topics::sheet`]).

use std::collections::HashMap;
use std::path::Path;

use serde_json::Value;
use statrs::statistics::{Data, OrderStatistics};

use crate::ros::Definition;
use softrig_formats::bounded::Limits;
use softrig_formats::columns::{Layout, OPTIONAL, Quantity};
use softrig_formats::error::InputError;
use softrig_formats::formats::{Decimals, Sheet, Values, names};
use softrig_formats::recording::GAP_FACTOR;

/// Fields that hold the number of a message with one.
const USUAL_FIELDS: [&str; 2] = ["value", "data"];

/// The samples of a topic.
#[derive(Debug, Default)]
pub(crate) struct Series {
    /// When, in nanoseconds on the clock of the log.
    pub times: Vec<u64>,
    pub values: Vec<Datum>,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Datum {
    Number(f64),
    Text(String),
}

/// A field of a topic whose messages are read.
struct Source {
    /// The place among the columns.
    column: usize,
    /// The fields that lead to the number; none if there is only one.
    path: Vec<String>,
    topic: String,
    encoding: Encoding,
    /// The name of the value in an array, where the messages name them, and where it stood.
    joint: Option<(String, usize)>,
    /// Whether it has moved.
    has_moved: bool,
}

/// Arrays of a message whose values have names in the array `name` beside them.
const NAMED: [&str; 3] = ["position", "velocity", "effort"];

/// Most names of a message that are looked at.
const MOST_NAMES: usize = 256;

/// How the messages of a topic are written.
#[derive(Clone, Debug)]
pub(crate) enum Encoding {
    Json,
    Ros(Definition),
}

impl Encoding {
    /// That of a topic whose messages are of a type of ROS 2, with its definition as far as the log
    /// has it.
    ///
    /// # Errors
    ///
    /// A type that the log does not define, and not everybody has.
    pub(crate) fn of_ros(topic: &str, kind: &str, text: &str) -> Result<Self, InputError> {
        let definition = Definition::parse(kind, text);
        if definition.fields().is_empty() {
            return Err(InputError::new(
                format!(
                    "has messages of the type {kind} on {topic}, and no definition of that type"
                ),
                "convert it where ROS 2 has the type, which puts the definition into the file: ros2 bag convert",
            ));
        }
        Ok(Self::Ros(definition))
    }
}

/// The topics of a log, and what is wanted of them.
pub(crate) struct Topics {
    /// The columns that are wanted: their names here, and how they are called in the file.
    wanted: Vec<(String, String)>,
    /// What was found of each.
    pub series: Vec<Series>,
    /// By the numbers that messages name them by.
    sources: HashMap<u64, Vec<Source>>,
    names: Vec<String>,
    values: u64,
}

impl Topics {
    /// Pressure, angle and the optional columns, as the layout calls them.
    pub(crate) fn of(layout: &Layout) -> Self {
        let mut wanted: Vec<(String, String)> = [Quantity::Pressure, Quantity::Angle]
            .map(|it| layout.names.of(it).to_owned())
            .map(|name| (name.clone(), name))
            .into();
        wanted.extend(OPTIONAL.iter().map(|&name| {
            let said = layout.names.optional.iter().find(|(it, _)| it == name);
            let topic = said.map_or(name, |(_, topic)| topic);
            (name.to_owned(), topic.to_owned())
        }));
        let mut topics = Self {
            wanted: Vec::new(),
            series: Vec::new(),
            sources: HashMap::new(),
            names: Vec::new(),
            values: 0,
        };
        topics.want(wanted);
        topics
    }

    /// Says which columns are wanted, before anything was read.
    pub(crate) fn want(&mut self, wanted: Vec<(String, String)>) {
        self.series = wanted.iter().map(|_| Series::default()).collect();
        self.wanted = wanted;
    }

    /// The names of the columns.
    pub(crate) fn wanted(&self) -> impl Iterator<Item = &str> {
        self.wanted.iter().map(|(name, _)| name.as_str())
    }

    /// Whether no topic was noted yet.
    pub(crate) fn are_new(&self) -> bool {
        self.names.is_empty()
    }

    /// Another file of the same log begins, which counts its topics anew.
    pub(crate) fn next_file(&mut self) {
        self.sources.clear();
    }

    /// Notes a topic, which may come more than once; whether it is read. Its encoding is asked for
    /// only then.
    ///
    /// # Errors
    ///
    /// Those of the encoding.
    pub(crate) fn note(
        &mut self,
        number: u64,
        topic: &str,
        encoding: impl FnOnce() -> Result<Encoding, InputError>,
    ) -> Result<bool, InputError> {
        if !self.names.iter().any(|it| it == topic) {
            self.names.push(topic.to_owned());
        }
        if let Some(known) = self.sources.get(&number) {
            return Ok(!known.is_empty());
        }
        let paths: Vec<(usize, Vec<String>)> = self
            .wanted
            .iter()
            .enumerate()
            .filter_map(|(column, (_, called))| Some((column, path_in(topic, called)?)))
            .collect();
        let is_read = !paths.is_empty();
        let mut sources = Vec::new();
        if is_read {
            let encoding = encoding()?;
            sources.extend(paths.into_iter().map(|(column, path)| Source {
                column,
                path,
                topic: topic.to_owned(),
                encoding: encoding.clone(),
                joint: None,
                has_moved: false,
            }));
        }
        self.sources.insert(number, sources);
        Ok(is_read)
    }

    /// Takes a message on the topic of a number.
    ///
    /// # Errors
    ///
    /// A message without the number that is wanted of it, and more than the limits.
    pub(crate) fn take(
        &mut self,
        number: u64,
        time_ns: u64,
        message: &[u8],
        limits: Limits,
    ) -> Result<(), InputError> {
        for source in self.sources.get_mut(&number).into_iter().flatten() {
            let datum = if source.is_named() {
                source.named_datum(message)?
            } else {
                datum(source, message)?
            };
            let series = &mut self.series[source.column];
            series.times.push(time_ns);
            series.values.push(datum);
            self.values += 1;
            limits.check(series.times.len() as u64, 1)?;
            limits.check(1, usize::try_from(self.values).unwrap_or(usize::MAX))?;
        }
        Ok(())
    }

    /// The columns of any log, at the times of the angle.
    ///
    /// The times of a topic are the log times of its messages, from the first sample on. The pressure is
    /// interpolated between the two messages around an angle, since a held pressure would lag by half an
    /// interval and shift every time constant. Set-points and states are held, since they jump. Where
    /// the pressure is missing for longer than a few of its intervals, or has not begun, there are no
    /// rows.
    ///
    /// # Errors
    ///
    /// Names the topics that there are.
    pub(crate) fn sheet(&mut self, path: &Path, layout: &Layout) -> Result<Sheet, InputError> {
        let mut sheet = Sheet::default();
        for source in self.sources.values().flatten().filter(|it| it.has_moved) {
            let name = source.joint.as_ref().map_or("", |(name, _)| name);
            sheet.warnings.push(format!(
                "{}: the order of the names on {} changes; {} is read by its name, {name}",
                path.display(),
                source.topic,
                source.path.join(".")
            ));
        }
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
        header.extend(self.names.iter().cloned());
        let silent = (0..2).find(|&at| {
            self.series[at].times.is_empty()
                && self
                    .names
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

impl Source {
    /// Whether it is a value of an array that has names beside it.
    ///
    /// A message like JointState names the values of its arrays, in any order: `position[0]` is the
    /// joint that comes first in the first message, by its name from then on, and `position[finger]` the
    /// one that is called so.
    fn is_named(&self) -> bool {
        let [.., array, _] = self.path.as_slice() else {
            return false;
        };
        NAMED.contains(&array.as_str())
    }

    /// The names beside the array; none if the message has none.
    fn names(&self, message: &[u8]) -> Vec<String> {
        let above = &self.path[..self.path.len() - 2];
        match &self.encoding {
            Encoding::Ros(definition) => {
                let path = |index: &str| -> Vec<String> {
                    above
                        .iter()
                        .cloned()
                        .chain(["name".to_owned(), index.to_owned()])
                        .collect()
                };
                (0..MOST_NAMES)
                    .map_while(|index| {
                        let path = path(&index.to_string());
                        let path: Vec<&str> = path.iter().map(String::as_str).collect();
                        definition.text(message, &path)
                    })
                    .collect()
            }
            Encoding::Json => {
                let message: Value = serde_json::from_slice(message).unwrap_or_default();
                let object = above.iter().try_fold(&message, |at, field| at.get(field));
                let names = object
                    .and_then(|it| it.get("name"))
                    .and_then(Value::as_array);
                let names = names.into_iter().flatten();
                names
                    .map_while(|name| name.as_str().map(str::to_owned))
                    .collect()
            }
        }
    }

    /// The value by its name.
    fn named_datum(&mut self, message: &[u8]) -> Result<Datum, InputError> {
        let names = self.names(message);
        if names.is_empty() {
            return datum(self, message);
        }
        let last = self.path.len() - 1;
        let called = match &self.joint {
            Some((name, _)) => name.clone(),
            None => match self.path[last].parse::<usize>() {
                Ok(index) => match names.get(index) {
                    Some(name) => name.clone(),
                    None => return datum(self, message),
                },
                Err(_) => self.path[last].clone(),
            },
        };
        let Some(place) = names.iter().position(|name| *name == called) else {
            return Err(InputError::new(
                format!(
                    "a message on {} has no joint {called} (it has {})",
                    self.topic,
                    names.join(", ")
                ),
                format!(
                    "name another, as {}.{}[JOINT]",
                    self.topic,
                    self.path[last - 1]
                ),
            ));
        };
        let before = self.joint.get_or_insert((called, place)).1;
        self.has_moved |= before != place;
        let asked = std::mem::replace(&mut self.path[last], place.to_string());
        let read = datum(self, message);
        self.path[last] = asked;
        read
    }
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
pub(crate) fn values(cells: &[Option<Datum>], decimals: Decimals) -> Values {
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
