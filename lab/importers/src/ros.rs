//! Reads one number from a ROS 2 message.
//!
//! A message is a sequence of fields, each aligned to its size (CDR); the log contains the
//! definition with their names and types. To find a field, all fields before it have to be
//! passed.

use std::collections::HashMap;

/// Messages within messages.
const DEEPEST: usize = 16;

/// Definitions that recorders leave out, as everybody has them: those of `std_msgs`,
/// `builtin_interfaces`, `geometry_msgs` and `sensor_msgs` in which a rig's quantities come. Bags
/// from before ROS 2 Iron have no definitions at all.
const STANDARD: [(&str, &str); 43] = [
    (
        "builtin_interfaces/msg/Duration",
        "int32 sec; uint32 nanosec",
    ),
    ("builtin_interfaces/msg/Time", "int32 sec; uint32 nanosec"),
    ("std_msgs/msg/Bool", "bool data"),
    ("std_msgs/msg/Byte", "byte data"),
    ("std_msgs/msg/Float32", "float32 data"),
    (
        "std_msgs/msg/Float32MultiArray",
        "MultiArrayLayout layout; float32[] data",
    ),
    ("std_msgs/msg/Float64", "float64 data"),
    (
        "std_msgs/msg/Float64MultiArray",
        "MultiArrayLayout layout; float64[] data",
    ),
    ("std_msgs/msg/Header", "Time stamp; string frame_id"),
    ("std_msgs/msg/Int16", "int16 data"),
    (
        "std_msgs/msg/Int16MultiArray",
        "MultiArrayLayout layout; int16[] data",
    ),
    ("std_msgs/msg/Int32", "int32 data"),
    (
        "std_msgs/msg/Int32MultiArray",
        "MultiArrayLayout layout; int32[] data",
    ),
    ("std_msgs/msg/Int64", "int64 data"),
    ("std_msgs/msg/Int8", "int8 data"),
    (
        "std_msgs/msg/MultiArrayDimension",
        "string label; uint32 size; uint32 stride",
    ),
    (
        "std_msgs/msg/MultiArrayLayout",
        "MultiArrayDimension[] dim; uint32 data_offset",
    ),
    ("std_msgs/msg/UInt16", "uint16 data"),
    ("std_msgs/msg/UInt32", "uint32 data"),
    ("std_msgs/msg/UInt64", "uint64 data"),
    ("std_msgs/msg/UInt8", "uint8 data"),
    ("geometry_msgs/msg/Point", "float64 x; float64 y; float64 z"),
    (
        "geometry_msgs/msg/PointStamped",
        "Header header; Point point",
    ),
    (
        "geometry_msgs/msg/Pose",
        "Point position; Quaternion orientation",
    ),
    (
        "geometry_msgs/msg/Pose2D",
        "float64 x; float64 y; float64 theta",
    ),
    ("geometry_msgs/msg/PoseStamped", "Header header; Pose pose"),
    (
        "geometry_msgs/msg/Quaternion",
        "float64 x; float64 y; float64 z; float64 w",
    ),
    (
        "geometry_msgs/msg/QuaternionStamped",
        "Header header; Quaternion quaternion",
    ),
    (
        "geometry_msgs/msg/Transform",
        "Vector3 translation; Quaternion rotation",
    ),
    (
        "geometry_msgs/msg/TransformStamped",
        "Header header; string child_frame_id; Transform transform",
    ),
    ("geometry_msgs/msg/Twist", "Vector3 linear; Vector3 angular"),
    (
        "geometry_msgs/msg/TwistStamped",
        "Header header; Twist twist",
    ),
    (
        "geometry_msgs/msg/Vector3",
        "float64 x; float64 y; float64 z",
    ),
    (
        "geometry_msgs/msg/Vector3Stamped",
        "Header header; Vector3 vector",
    ),
    ("geometry_msgs/msg/Wrench", "Vector3 force; Vector3 torque"),
    (
        "geometry_msgs/msg/WrenchStamped",
        "Header header; Wrench wrench",
    ),
    (
        "sensor_msgs/msg/FluidPressure",
        "Header header; float64 fluid_pressure; float64 variance",
    ),
    (
        "sensor_msgs/msg/Illuminance",
        "Header header; float64 illuminance; float64 variance",
    ),
    (
        "sensor_msgs/msg/Imu",
        "Header header; Quaternion orientation; float64[9] orientation_covariance; Vector3 angular_velocity; float64[9] angular_velocity_covariance; Vector3 linear_acceleration; float64[9] linear_acceleration_covariance",
    ),
    (
        "sensor_msgs/msg/JointState",
        "Header header; string[] name; float64[] position; float64[] velocity; float64[] effort",
    ),
    (
        "sensor_msgs/msg/MagneticField",
        "Header header; Vector3 magnetic_field; float64[9] magnetic_field_covariance",
    ),
    (
        "sensor_msgs/msg/RelativeHumidity",
        "Header header; float64 relative_humidity; float64 variance",
    ),
    (
        "sensor_msgs/msg/Temperature",
        "Header header; float64 temperature; float64 variance",
    ),
];

/// How often a type comes in a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Count {
    One,
    Fixed(u32),
    Counted,
}

#[derive(Clone, Debug)]
struct Field {
    name: String,
    of: String,
    count: Count,
}

impl Field {
    /// Reads a line; none without a field in it.
    fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let (of, name) = (words.next()?, words.next()?);
        // A constant has its value behind an equals sign; a bound is no value.
        if line.replace("<=", "").contains('=') {
            return None;
        }
        let (of, count) = match of.split_once('[') {
            None => (of, Count::One),
            Some((of, size)) => match size.trim_end_matches(']').parse() {
                Ok(size) => (of, Count::Fixed(size)),
                Err(_) => (of, Count::Counted),
            },
        };
        Some(Self {
            name: name.to_owned(),
            // A text may be bounded: string<=10.
            of: of.split('<').next().unwrap_or(of).to_owned(),
            count,
        })
    }
}

/// The definition of a message, and those that it is made of.
#[derive(Clone, Debug, Default)]
pub(crate) struct Definition {
    /// By the last part of their names.
    messages: HashMap<String, Vec<Field>>,
    main: String,
}

fn last_part(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or(name)
}

impl Definition {
    /// Reads the definition of a message that is called `name`. What it does not define is taken
    /// from what everybody has.
    pub(crate) fn parse(name: &str, text: &str) -> Self {
        let mut definition = Self {
            main: last_part(name).to_owned(),
            ..Self::default()
        };
        let mut current = definition.main.clone();
        for line in text.lines() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if let Some(name) = line.strip_prefix("MSG:") {
                last_part(name.trim()).clone_into(&mut current);
                definition.messages.insert(current.clone(), Vec::new());
            } else if let Some(field) = Field::parse(line) {
                let fields = definition.messages.entry(current.clone());
                fields.or_default().push(field);
            }
        }
        definition.complete(name);
        definition
    }

    /// Adds a standard type that is not defined, and those that it is made of.
    fn complete(&mut self, name: &str) {
        let part = last_part(name);
        if self.messages.contains_key(part) {
            return;
        }
        let known = |(standard, _): &&(&str, &str)| {
            if name.contains('/') {
                *standard == name
            } else {
                last_part(standard) == name
            }
        };
        let Some((_, text)) = STANDARD.iter().find(known) else {
            return;
        };
        let fields: Vec<Field> = text.split(';').filter_map(Field::parse).collect();
        self.messages.insert(part.to_owned(), fields.clone());
        for field in fields {
            self.complete(&field.of);
        }
    }

    /// The names of its own fields.
    pub(crate) fn fields(&self) -> Vec<&str> {
        let fields = self.messages.get(&self.main).into_iter().flatten();
        fields.map(|field| field.name.as_str()).collect()
    }

    /// The number at the end of a path of fields; none where there is none.
    pub(crate) fn number(&self, message: &[u8], path: &[&str]) -> Option<f64> {
        match self.found(message, path)? {
            Found::Number(number) => Some(number),
            Found::Text(_) => None,
        }
    }

    /// The text at the end of a path of fields; none where there is none.
    pub(crate) fn text(&self, message: &[u8], path: &[&str]) -> Option<String> {
        match self.found(message, path)? {
            Found::Text(text) => Some(text),
            Found::Number(_) => None,
        }
    }

    fn found(&self, message: &[u8], path: &[&str]) -> Option<Found> {
        let mut cursor = Cursor::new(message)?;
        let fields = self.messages.get(&self.main)?;
        self.fields_of(fields, Some(path), &mut cursor, 0).ok()?
    }

    /// Goes through fields, to the one that is looked for or over all of them.
    fn fields_of(
        &self,
        fields: &[Field],
        path: Option<&[&str]>,
        cursor: &mut Cursor<'_>,
        depth: usize,
    ) -> Result<Option<Found>, Ended> {
        for field in fields {
            let inside = path.and_then(|path| match path {
                [first, rest @ ..] if *first == field.name => Some(rest),
                _ => None,
            });
            let count = match field.count {
                Count::One => {
                    let found = self.one(&field.of, inside, cursor, depth)?;
                    if found.is_some() || inside.is_some() {
                        return Ok(found);
                    }
                    continue;
                }
                Count::Fixed(count) => count,
                Count::Counted => cursor.u32()?,
            };
            // Each takes a byte or more.
            if count as usize > cursor.rest().len() {
                return Err(Ended);
            }
            for index in 0..count {
                let inside = inside.and_then(|path| match path {
                    [first, rest @ ..] if first.parse() == Ok(index) => Some(rest),
                    _ => None,
                });
                let found = self.one(&field.of, inside, cursor, depth)?;
                if found.is_some() {
                    return Ok(found);
                }
            }
        }
        Ok(None)
    }

    fn one(
        &self,
        of: &str,
        path: Option<&[&str]>,
        cursor: &mut Cursor<'_>,
        depth: usize,
    ) -> Result<Option<Found>, Ended> {
        let number = match of {
            "bool" | "byte" | "char" | "uint8" => f64::from(u8::from_le_bytes(cursor.take()?)),
            "int8" => f64::from(i8::from_le_bytes(cursor.take()?)),
            "int16" => f64::from(i16::from_le_bytes(cursor.take()?)),
            "uint16" => f64::from(u16::from_le_bytes(cursor.take()?)),
            "int32" => f64::from(i32::from_le_bytes(cursor.take()?)),
            "uint32" => f64::from(cursor.u32()?),
            "int64" => i64::from_le_bytes(cursor.take()?) as f64,
            "uint64" => u64::from_le_bytes(cursor.take()?) as f64,
            "float32" => f64::from(f32::from_le_bytes(cursor.take()?)),
            "float64" => f64::from_le_bytes(cursor.take()?),
            "string" => {
                let length = cursor.u32()? as usize;
                let text = cursor.rest().get(..length);
                let text = path
                    .filter(|path| path.is_empty())
                    .and(text)
                    // It ends with a zero.
                    .map(|text| {
                        String::from_utf8_lossy(text)
                            .trim_end_matches('\0')
                            .to_owned()
                    });
                cursor.skip(length)?;
                return Ok(text.map(Found::Text));
            }
            other => {
                let fields = self.messages.get(last_part(other)).ok_or(Ended)?;
                if depth >= DEEPEST {
                    return Err(Ended);
                }
                return self.fields_of(fields, path, cursor, depth + 1);
            }
        };
        Ok(path
            .filter(|path| path.is_empty())
            .map(|_| Found::Number(number)))
    }
}

/// What stands in a field.
enum Found {
    Number(f64),
    Text(String),
}

/// The message is over, or is not as its definition says.
struct Ended;

/// Where in a message the reader is.
struct Cursor<'a> {
    body: &'a [u8],
    at: usize,
    is_big_endian: bool,
    /// Nothing is aligned to more.
    widest: usize,
}

impl<'a> Cursor<'a> {
    /// The first four bytes say how the others are written.
    fn new(message: &'a [u8]) -> Option<Self> {
        let (head, body) = message.split_at_checked(4)?;
        Some(Self {
            body,
            at: 0,
            is_big_endian: head[1] & 1 == 0,
            widest: if head[1] >= 6 { 4 } else { 8 },
        })
    }

    fn rest(&self) -> &'a [u8] {
        self.body.get(self.at..).unwrap_or_default()
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], Ended> {
        self.at = self.at.next_multiple_of(N.min(self.widest));
        let mut bytes: [u8; N] = self
            .rest()
            .get(..N)
            .and_then(|bytes| bytes.try_into().ok())
            .ok_or(Ended)?;
        self.at += N;
        if self.is_big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, Ended> {
        self.take().map(u32::from_le_bytes)
    }

    fn skip(&mut self, count: usize) -> Result<(), Ended> {
        if self.rest().len() < count {
            return Err(Ended);
        }
        self.at += count;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRESSURE: &str = "\
std_msgs/Header header # when and where
float64 fluid_pressure
float64 variance
uint8 KIND=3
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

    #[test]
    fn a_number_is_found_behind_a_header() {
        let definition = Definition::parse("sensor_msgs/msg/FluidPressure", PRESSURE);
        assert_eq!(
            definition.fields(),
            ["header", "fluid_pressure", "variance"]
        );
        let mut message = vec![0, 1, 0, 0];
        message.extend(7_i32.to_le_bytes());
        message.extend(8_u32.to_le_bytes());
        message.extend(4_u32.to_le_bytes());
        message.extend(b"rig\0");
        message.extend(101.25_f64.to_le_bytes());
        message.extend(0.5_f64.to_le_bytes());
        let number = |path: &[&str]| definition.number(&message, path);
        assert_eq!(number(&["fluid_pressure"]), Some(101.25));
        assert_eq!(number(&["variance"]), Some(0.5));
        assert_eq!(number(&["header", "stamp", "nanosec"]), Some(8.0));
        assert_eq!(number(&["header"]), None);
        assert_eq!(number(&["header", "frame_id"]), None);
        assert_eq!(number(&["KIND"]), None);
        for end in 0..message.len() - 8 {
            assert_eq!(definition.number(&message[..end], &["variance"]), None);
        }
    }

    #[test]
    fn arrays_are_gone_through_and_counted_from_zero() {
        let text = "string[] name\nfloat32[2] pair\nfloat64[] position\nstring<=5 last\n";
        let definition = Definition::parse("a/msg/B", text);
        let mut message = vec![0, 0, 0, 0];
        for part in [
            &2_u32.to_be_bytes()[..],
            &2_u32.to_be_bytes(),
            b"a\0\0\0",
            &2_u32.to_be_bytes(),
            b"b\0\0\0",
            &1.5_f32.to_be_bytes(),
            &2.5_f32.to_be_bytes(),
            &2_u32.to_be_bytes(),
            &3.5_f64.to_be_bytes(),
            &4.5_f64.to_be_bytes(),
        ] {
            message.extend(part);
        }
        let number = |path: &[&str]| definition.number(&message, path);
        assert_eq!(number(&["pair", "1"]), Some(2.5));
        assert_eq!(number(&["position", "1"]), Some(4.5));
        assert_eq!(number(&["position", "2"]), None);
        assert_eq!(number(&["position"]), None);
    }
}
