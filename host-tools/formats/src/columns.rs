//! The columns and units of a recording in a file.
//!
//! By its header a recording has seconds, gauge pressure in kPa and degrees. Files of other
//! tools have other headers, or other units under the same header. The layout is applied where
//! the file is read, so that all other code works in one set of units.

use serde::{Deserialize, Serialize};
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};
use toml_edit::Value;

use crate::recording::PASCAL_PER_KPA;
use crate::setup::Setup;

/// What may be written as units, for a prompt.
pub const UNITS_HELP: &str = "as time=ms,pressure=psi,angle=rad; pressure=psi*100 for values times 100, time=s*50 for 50 rows a second";

/// Pressure of the air at sea level (kPa), the standard atmosphere.
pub const ATMOSPHERE_KPA: f64 = 101.325;

/// Checks the pressure of the air (kPa); zero says that the column is gauge pressure.
///
/// # Errors
///
/// Says which pressures there are.
pub fn air(kpa: f64) -> Result<f64, String> {
    /// Beyond what the weather does at sea level.
    const MOST: f64 = 110.0;
    if (0.0..=MOST).contains(&kpa) {
        return Ok(kpa);
    }
    Err(format!(
        "give the pressure of the air, from 0 to {MOST} kPa; at sea level it is {ATMOSPHERE_KPA}"
    ))
}

/// A quantity that every recording has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// When a sample was taken.
    Time,
    /// The gauge pressure in the actuator.
    Pressure,
    /// The bending angle.
    Angle,
}

impl Quantity {
    /// All three, in the order of [`Columns::read`].
    pub const ALL: [Self; 3] = [Self::Time, Self::Pressure, Self::Angle];

    /// Its name in `--columns` and `--units`.
    pub fn key(self) -> &'static str {
        ["time", "pressure", "angle"][self as usize]
    }

    /// The column that holds it, unless another is named.
    pub fn column(self) -> &'static str {
        ["time_s", "pressure_kpa", "angle_deg"][self as usize]
    }

    fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|it| it.key() == key)
    }

    /// The units that are known, as `--units` takes them.
    pub fn units(self) -> String {
        fn words<T: VariantArray + Copy + Into<&'static str>>() -> String {
            let words: Vec<&str> = T::VARIANTS.iter().map(|&unit| unit.into()).collect();
            words.join(", ")
        }
        match self {
            Self::Time => words::<TimeUnit>(),
            Self::Pressure => words::<PressureUnit>(),
            Self::Angle => words::<AngleUnit>(),
        }
    }
}

/// Unit of the times.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
    Serialize,
    Deserialize,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum TimeUnit {
    /// Seconds
    S,
    /// Milliseconds
    Ms,
    /// Microseconds
    Us,
    /// Nanoseconds
    Ns,
    /// Minutes
    Min,
    /// Days
    Day,
}

impl TimeUnit {
    /// Seconds in the unit.
    pub fn seconds(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e-3,
            Self::Us => 1e-6,
            Self::Ns => 1e-9,
            Self::Min => 60.0,
            Self::Day => 86_400.0,
        }
    }
}

/// Unit of the pressure.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
    Serialize,
    Deserialize,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum PressureUnit {
    /// Kilopascals
    Kpa,
    /// Pounds-force per square inch
    Psi,
    /// Bars
    Bar,
    /// Millibars, which are hectopascals
    Mbar,
    /// Megapascals
    Mpa,
    /// Pascals
    Pa,
    /// Millimetres of mercury
    Mmhg,
}

impl PressureUnit {
    /// Kilopascals in the unit.
    pub fn kilopascals(self) -> f64 {
        match self {
            Self::Kpa => 1.0,
            Self::Psi => 6.894_757,
            Self::Bar => 100.0,
            Self::Mbar => 0.1,
            Self::Mpa => 1e3,
            Self::Pa => 1e-3,
            Self::Mmhg => 0.133_322_4,
        }
    }

    /// The symbol of the unit.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Kpa => "kPa",
            Self::Psi => "psi",
            Self::Bar => "bar",
            Self::Mbar => "mbar",
            Self::Mpa => "MPa",
            Self::Pa => "Pa",
            Self::Mmhg => "mmHg",
        }
    }
}

/// Unit of the angle.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
    Default,
    Serialize,
    Deserialize,
)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum AngleUnit {
    /// Degrees
    #[default]
    Deg,
    /// Radians
    Rad,
    /// Millimetres, of an output that is no angle: 1 mm is taken as 1 degree
    Mm,
    /// Centimetres, likewise
    Cm,
    /// Micrometres, likewise
    Um,
    /// Millivolts, likewise
    Mv,
}

impl AngleUnit {
    /// Degrees in the unit, or what is taken as that many.
    pub fn degrees(self) -> f64 {
        match self {
            Self::Rad => 1f64.to_degrees(),
            Self::Deg | Self::Mm | Self::Cm | Self::Um | Self::Mv => 1.0,
        }
    }

    /// Whether it is one of an angle.
    pub fn is_of_angle(self) -> bool {
        matches!(self, Self::Deg | Self::Rad)
    }
}

/// A unit of any of the three.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Unit of the time.
    Time(TimeUnit),
    /// Unit of the pressure.
    Pressure(PressureUnit),
    /// Unit of the angle.
    Angle(AngleUnit),
}

impl Unit {
    /// The unit of a quantity by a name that people write: `kPa`, `sec`, `°`, `[psi]`.
    pub fn of(quantity: Quantity, written: &str) -> Option<Self> {
        let written = written
            .trim()
            .trim_matches(['[', ']', '(', ')'])
            .trim()
            .to_lowercase();
        Some(match (quantity, written.as_str()) {
            (Quantity::Time, name) => Self::Time(match name {
                "s" | "sec" | "secs" | "second" | "seconds" => TimeUnit::S,
                "ms" | "msec" | "millis" | "millisecond" | "milliseconds" => TimeUnit::Ms,
                "us" | "\u{b5}s" | "\u{3bc}s" | "usec" | "micros" | "microseconds" => TimeUnit::Us,
                "ns" | "nsec" | "nanos" | "nanoseconds" => TimeUnit::Ns,
                "min" | "mins" | "minute" | "minutes" => TimeUnit::Min,
                "d" | "day" | "days" => TimeUnit::Day,
                _ => return None,
            }),
            (Quantity::Pressure, name) => Self::Pressure(match name {
                "kpa" | "kpag" => PressureUnit::Kpa,
                "psi" | "psig" => PressureUnit::Psi,
                "bar" | "barg" => PressureUnit::Bar,
                "mbar" | "hpa" => PressureUnit::Mbar,
                "mpa" => PressureUnit::Mpa,
                "pa" => PressureUnit::Pa,
                "mmhg" | "torr" => PressureUnit::Mmhg,
                _ => return None,
            }),
            (Quantity::Angle, name) => Self::Angle(match name {
                "deg" | "\u{b0}" | "degree" | "degrees" => AngleUnit::Deg,
                "rad" | "radian" | "radians" => AngleUnit::Rad,
                "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => AngleUnit::Mm,
                "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => AngleUnit::Cm,
                "um" | "\u{b5}m" | "\u{3bc}m" | "micrometre" | "micrometres" => AngleUnit::Um,
                "mv" | "millivolt" | "millivolts" => AngleUnit::Mv,
                _ => return None,
            }),
        })
    }

    /// The unit as `--units` takes it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Time(unit) => unit.into(),
            Self::Pressure(unit) => unit.into(),
            Self::Angle(unit) => unit.into(),
        }
    }

    /// Whether it is what the header of a recording promises.
    pub fn is_promised(self) -> bool {
        matches!(
            self,
            Self::Time(TimeUnit::S)
                | Self::Pressure(PressureUnit::Kpa)
                | Self::Angle(AngleUnit::Deg)
        )
    }
}

/// How the numbers of a column become those of its unit: two of them, and what they mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scale {
    /// Two numbers of the file, each with what it is in the unit.
    pub points: [[f64; 2]; 2],
}

impl Scale {
    /// For values times a factor, as a header says it: `psi * 100`.
    pub fn times(factor: f64) -> Option<Self> {
        Self::through([[0.0, 0.0], [factor, 1.0]])
    }

    /// The factor, if it is [of one](Self::times).
    fn factor(&self) -> Option<f64> {
        let [_, [factor, _]] = self.points;
        (Self::times(factor) == Some(*self)).then_some(factor)
    }

    /// Through two points; none if they do not tell a scale.
    pub fn through(points: [[f64; 2]; 2]) -> Option<Self> {
        let [[a, x], [b, y]] = points;
        let all = [a, x, b, y].iter().all(|it| it.is_finite());
        let apart = (a - b).abs() > 0.0 && (x - y).abs() > 0.0;
        (all && apart).then_some(Self { points })
    }

    /// Reads `101:0,512:100`: a number of the file and what it is, twice.
    ///
    /// # Errors
    ///
    /// Says how to write it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text
            .split([':', ','])
            .map(|part| part.trim().parse().ok())
            .collect();
        match numbers.as_deref() {
            Some(&[a, x, b, y]) => Self::through([[a, x], [b, y]]),
            _ => None,
        }
        .ok_or_else(|| {
            format!(
                "write two points for \"{text}\", number of the file and what it is: 101:0,512:100"
            )
        })
    }

    /// What a number of the file is.
    pub fn read(&self, number: f64) -> f64 {
        let [[a, x], [b, y]] = self.points;
        x + (number - a) * (y - x) / (b - a)
    }
}

impl std::fmt::Display for Scale {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [[a, x], [b, y]] = self.points;
        write!(f, "{a}:{x},{b}:{y}")
    }
}

/// What the columns hold. A field that is `None` or false was not said: then the
/// header counts, and may be doubted. What was said is not doubted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Columns {
    /// Unit of the times.
    pub time: Option<TimeUnit>,
    /// Unit of the pressure.
    pub pressure: Option<PressureUnit>,
    /// The pressure is absolute, and this is the pressure of the air (kPa).
    pub air_kpa: Option<f64>,
    /// Unit of the angle.
    pub angle: Option<AngleUnit>,
    /// Scales of time, pressure and angle, by which numbers of the file come into their units.
    pub scales: [Option<Scale>; 3],
    /// The angle at rest (°), which is subtracted.
    pub angle_zero_deg: Option<f64>,
    /// The angle counts the other way round.
    pub flip_angle: bool,
    /// Pressure and angle are in each other's column.
    pub exchange: bool,
    /// Nothing of the pressure is beyond half the sampling rate.
    pub band_limited: bool,
}

impl Columns {
    /// Time (s), gauge pressure (kPa) and angle (°) of a row of the file.
    pub fn read(&self, [time, mut pressure, mut angle]: [f64; 3]) -> [f64; 3] {
        if self.exchange {
            (pressure, angle) = (angle, pressure);
        }
        let scaled = |of: Quantity, number: f64| match &self.scales[of as usize] {
            Some(scale) => scale.read(number),
            None => number,
        };
        let time = scaled(Quantity::Time, time);
        let pressure = scaled(Quantity::Pressure, pressure);
        let angle = scaled(Quantity::Angle, angle);
        let time = time * self.time.map_or(1.0, TimeUnit::seconds);
        let pressure = pressure * self.pressure.map_or(1.0, PressureUnit::kilopascals)
            - self.air_kpa.unwrap_or(0.0);
        let angle =
            angle * self.angle.map_or(1.0, AngleUnit::degrees) - self.angle_zero_deg.unwrap_or(0.0);
        [time, pressure, if self.flip_angle { -angle } else { angle }]
    }

    /// A sample (s, Pa, rad) of a recording that was read as its header says, as
    /// it would have been read with these columns.
    pub fn read_again(&self, [time, pressure, angle]: [f64; 3]) -> [f64; 3] {
        let [time, pressure, angle] =
            self.read([time, pressure / PASCAL_PER_KPA, angle.to_degrees()]);
        [time, pressure * PASCAL_PER_KPA, angle.to_radians()]
    }

    /// The unit that was said of a quantity.
    pub fn unit(&self, of: Quantity) -> Option<Unit> {
        match of {
            Quantity::Time => self.time.map(Unit::Time),
            Quantity::Pressure => self.pressure.map(Unit::Pressure),
            Quantity::Angle => self.angle.map(Unit::Angle),
        }
    }

    /// The unit of a quantity as `--units` takes it, with the factor of its scale if it has one;
    /// empty where nothing was said.
    pub fn written(&self, of: Quantity) -> String {
        let Some(unit) = self.unit(of).map(Unit::name) else {
            return String::new();
        };
        match self.scales[of as usize].and_then(|scale| scale.factor()) {
            Some(factor) => format!("{unit}*{factor}"),
            None => unit.to_owned(),
        }
    }

    /// Says a unit.
    pub fn set(&mut self, unit: Unit) {
        match unit {
            Unit::Time(unit) => self.time = Some(unit),
            Unit::Pressure(unit) => self.pressure = Some(unit),
            Unit::Angle(unit) => self.angle = Some(unit),
        }
    }

    /// These settings; `other` fills in what is missing.
    pub fn or(self, other: Self) -> Self {
        Self {
            time: self.time.or(other.time),
            pressure: self.pressure.or(other.pressure),
            air_kpa: self.air_kpa.or(other.air_kpa),
            angle: self.angle.or(other.angle),
            scales: std::array::from_fn(|at| self.scales[at].or(other.scales[at])),
            angle_zero_deg: self.angle_zero_deg.or(other.angle_zero_deg),
            flip_angle: self.flip_angle || other.flip_angle,
            exchange: self.exchange || other.exchange,
            band_limited: self.band_limited || other.band_limited,
        }
    }

    /// The flags of the command line that say so.
    pub fn flags(&self) -> String {
        let mut flags = Vec::new();
        let units: Vec<String> = Quantity::ALL
            .into_iter()
            .filter_map(|it| Some(format!("{}={}", it.key(), self.unit(it)?.name())))
            .collect();
        if !units.is_empty() {
            flags.push(format!("--units {}", units.join(",")));
        }
        for quantity in Quantity::ALL {
            if let Some(scale) = self.scales[quantity as usize] {
                flags.push(format!("--scale {}={scale}", quantity.key()));
            }
        }
        if let Some(air) = self.air_kpa {
            flags.push(if (air - ATMOSPHERE_KPA).abs() < 1e-9 {
                "--absolute-pressure".to_owned()
            } else {
                format!("--absolute-pressure={air}")
            });
        }
        if let Some(zero) = self.angle_zero_deg {
            flags.push(format!("--angle-zero={zero}"));
        }
        if self.flip_angle {
            flags.push("--flip-angle".to_owned());
        }
        if self.exchange {
            flags.push("--exchange-columns".to_owned());
        }
        if self.band_limited {
            flags.push("--band-limited".to_owned());
        }
        flags.join(" ")
    }

    /// Reads `pressure=psi,angle=rad,time=ms`.
    ///
    /// # Errors
    ///
    /// Says which quantities and which units there are.
    pub fn of_units(text: &str) -> Result<Self, String> {
        let mut columns = Self::default();
        for part in text.split(',') {
            let (key, unit) = part
                .split_once('=')
                .ok_or_else(|| format!("write QUANTITY=UNIT for \"{part}\", as pressure=psi"))?;
            columns.say_unit(key.trim(), unit)?;
        }
        Ok(columns)
    }

    /// Says a unit as it is written, `psi` or `psi * 100`: the file has its values times 100.
    ///
    /// # Errors
    ///
    /// Says which quantities and which units there are.
    pub fn say_unit(&mut self, key: &str, written: &str) -> Result<(), String> {
        let (unit, factor) = match written.split_once('*') {
            Some((unit, factor)) => (unit, Some(factor)),
            None => (written, None),
        };
        let unit = unit_of(key, unit)?;
        self.set(unit);
        if let (Some(factor), Some(quantity)) = (factor, Quantity::of_key(key)) {
            let scale = factor.trim().parse().ok().and_then(Scale::times);
            self.scales[quantity as usize] =
                Some(scale.ok_or_else(|| format!("\"{}\" is no factor", factor.trim()))?);
        }
        Ok(())
    }

    /// Says a scale, as `--scale` has it: `pressure=101:0,512:100`.
    ///
    /// # Errors
    ///
    /// Says how to write it.
    pub fn of_scale(text: &str) -> Result<Self, String> {
        let (key, points) = text.split_once('=').ok_or_else(|| {
            format!("write QUANTITY=POINTS for \"{text}\", as pressure=101:0,512:100")
        })?;
        let mut columns = Self::default();
        columns.say_scale(key.trim(), Scale::parse(points)?)?;
        Ok(columns)
    }

    /// Says the scale of a quantity.
    ///
    /// # Errors
    ///
    /// Says which quantities there are.
    pub fn say_scale(&mut self, key: &str, scale: Scale) -> Result<(), String> {
        let quantity = Quantity::of_key(key)
            .ok_or_else(|| format!("\"{key}\" is none of time, pressure and angle"))?;
        self.scales[quantity as usize] = Some(scale);
        Ok(())
    }
}

/// The unit of a quantity, both as they are written.
///
/// # Errors
///
/// Says which there are.
fn unit_of(key: &str, unit: &str) -> Result<Unit, String> {
    let quantity = Quantity::of_key(key)
        .ok_or_else(|| format!("\"{key}\" is none of time, pressure and angle"))?;
    Unit::of(quantity, unit).ok_or_else(|| {
        format!(
            "\"{}\" is no unit of {key} that is known: {}",
            unit.trim(),
            quantity.units()
        )
    })
}

/// Optional columns that mean something to a reader.
pub const OPTIONAL: [&str; 8] = [
    "setpoint_deg",
    "setpoint_kpa",
    "pump_ul",
    "predicted_deg",
    "state",
    "fault",
    "seq",
    "mismatch",
];

/// The names of the columns, where they are not those of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Names {
    required: [Option<String>; 3],
    /// Names of optional columns, and the columns of the file that hold them.
    pub optional: Vec<(String, String)>,
}

impl Names {
    /// The column of the file that holds a quantity.
    pub fn of(&self, quantity: Quantity) -> &str {
        self.said(quantity).unwrap_or(quantity.column())
    }

    /// The same, if it was said.
    pub fn said(&self, quantity: Quantity) -> Option<&str> {
        self.required[quantity as usize].as_deref()
    }

    /// Whether time, pressure and angle are all called by their numbers, as in a table without a
    /// header.
    pub fn are_positions(&self) -> bool {
        let all = Quantity::ALL.map(|quantity| self.of(quantity));
        let is_somewhere = |name: &str| position(name).is_some();
        all.iter().any(|name| is_somewhere(name))
            && all.iter().all(|name| is_somewhere(name) || is_made(name))
    }

    /// Says which column holds a quantity (`pressure`) or an optional column
    /// (`setpoint_deg`).
    ///
    /// # Errors
    ///
    /// Says which there are.
    pub fn set(&mut self, key: &str, column: &str) -> Result<(), String> {
        if column.is_empty() {
            return Err(format!(
                "name the column that holds the {key}: {key}=COLUMN"
            ));
        }
        match Quantity::of_key(key) {
            Some(quantity) => self.required[quantity as usize] = Some(column.to_owned()),
            None if OPTIONAL.contains(&key) => {
                self.optional.retain(|(name, _)| name != key);
                self.optional.push((key.to_owned(), column.to_owned()));
            }
            None => {
                return Err(format!(
                    "\"{key}\" is none of time, pressure, angle, {}",
                    OPTIONAL.join(", ")
                ));
            }
        }
        Ok(())
    }

    /// Reads `time=t,pressure=p_psi,angle=theta`. A comma belongs to the name of a column
    /// unless what follows it is another assignment.
    ///
    /// # Errors
    ///
    /// Says what can be named.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut names = Self::default();
        let mut parts: Vec<String> = Vec::new();
        for part in text.split(',') {
            let key = part.split_once('=').map_or("", |(key, _)| key.trim());
            let begins = Quantity::of_key(key).is_some() || OPTIONAL.contains(&key);
            match parts.last_mut() {
                Some(last) if !begins => *last += &format!(",{part}"),
                _ => parts.push(part.to_owned()),
            }
        }
        for part in &parts {
            let (key, column) = part
                .split_once('=')
                .ok_or_else(|| format!("write WHICH=COLUMN for \"{part}\", as time=t"))?;
            names.set(key.trim(), column.trim())?;
        }
        Ok(names)
    }

    /// These settings; `other` fills in what is missing.
    pub fn or(&self, other: &Self) -> Self {
        let mut both = other.clone();
        for (mine, theirs) in self.required.iter().zip(&mut both.required) {
            if mine.is_some() {
                theirs.clone_from(mine);
            }
        }
        for (name, column) in &self.optional {
            both.optional.retain(|(theirs, _)| theirs != name);
            both.optional.push((name.clone(), column.clone()));
        }
        both
    }
}

/// Where a recording is in a file: in which columns, and in which units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layout {
    /// The names of the columns.
    pub names: Names,
    /// Their units and meaning.
    pub columns: Columns,
    /// How the rig stood, as far as the metadata of a recording do not say it.
    pub setup: Setup,
    /// Lines at the start of a table of text that are not read; none where the header is to be
    /// found.
    pub skip_rows: Option<u64>,
    /// Whether lines that are not rows are refused, however few.
    pub strict: bool,
    /// Whether this layout comes from a file about the recordings of other tools, not from a person
    /// about this one: a recording of softrig is then read as such.
    pub of_a_file: bool,
}

/// The name of a pressure that was not recorded: it is zero throughout.
pub const NOTHING: &str = "none";

/// The name of a time that is told by the number of the row, from 0.
pub const ROW: &str = "#0";

/// Whether a column is not in the file, and made.
pub fn is_made(name: &str) -> bool {
    name == NOTHING || name == ROW
}

/// The place, from 0, of a column that is called by its number: `#1` is the first.
pub fn position(name: &str) -> Option<usize> {
    let number: usize = name.strip_prefix('#')?.parse().ok()?;
    number.checked_sub(1)
}

impl Layout {
    /// These settings; `other` fills in what is missing.
    pub fn or(&self, other: &Self) -> Self {
        Self {
            names: self.names.or(&other.names),
            columns: self.columns.or(other.columns),
            setup: self.setup.or(&other.setup),
            skip_rows: self.skip_rows.or(other.skip_rows),
            strict: self.strict || other.strict,
            of_a_file: if self.is_silent() {
                other.of_a_file
            } else {
                self.of_a_file
            },
        }
    }

    /// Whether nothing is said of columns.
    fn is_silent(&self) -> bool {
        self.names == Names::default()
            && self.columns == Columns::default()
            && self.skip_rows.is_none()
    }

    /// The layout of what softrig records itself, with what else is said here; none if a person
    /// says where the columns are, or if nothing is said.
    pub fn as_recorded(&self) -> Option<Self> {
        (self.of_a_file && self.names != Names::default()).then(|| Self {
            setup: self.setup.clone(),
            strict: self.strict,
            ..Self::default()
        })
    }
}

impl Layout {
    /// The section `[recording]` of a model file that says the same; empty if nothing is said.
    pub fn to_toml(&self) -> String {
        let texts = |entries: Vec<(&str, &str)>| -> String {
            let entries = entries.into_iter();
            let entries = entries.map(|(key, text)| format!("{key} = {}", Value::from(text)));
            format!("{{ {} }}", entries.collect::<Vec<_>>().join(", "))
        };
        let mut lines: Vec<String> = Vec::new();
        let required = Quantity::ALL.into_iter().filter_map(|quantity| {
            let column = self.names.said(quantity)?;
            Some((quantity.key(), column))
        });
        let optional = self.names.optional.iter();
        let named: Vec<(&str, &str)> = required
            .chain(optional.map(|(name, column)| (name.as_str(), column.as_str())))
            .collect();
        if !named.is_empty() {
            lines.push(format!("columns = {}", texts(named)));
        }
        let units: Vec<(&str, &str)> = Quantity::ALL
            .into_iter()
            .filter_map(|quantity| Some((quantity.key(), self.columns.unit(quantity)?.name())))
            .collect();
        if !units.is_empty() {
            lines.push(format!("units = {}", texts(units)));
        }
        let scales: Vec<String> = Quantity::ALL
            .into_iter()
            .filter_map(|quantity| {
                let [[a, x], [b, y]] = self.columns.scales[quantity as usize]?.points;
                Some(format!("{} = [[{a}, {x}], [{b}, {y}]]", quantity.key()))
            })
            .collect();
        if !scales.is_empty() {
            lines.push(format!("scale = {{ {} }}", scales.join(", ")));
        }
        for (key, number) in [
            ("absolute_pressure_kpa", self.columns.air_kpa),
            ("angle_zero_deg", self.columns.angle_zero_deg),
        ] {
            lines.extend(number.map(|number| format!("{key} = {}", Value::from(number))));
        }
        if self.columns.flip_angle {
            lines.push("flip_angle = true".to_owned());
        }
        lines.extend(self.skip_rows.map(|count| format!("skip_rows = {count}")));
        if self.columns.exchange {
            lines.push(
                "# The columns are exchanged: every command needs --exchange-columns.".into(),
            );
        }
        if lines.is_empty() {
            return String::new();
        }
        format!("[recording]\n{}\n", lines.join("\n"))
    }
}

impl From<Columns> for Layout {
    fn from(columns: Columns) -> Self {
        Self {
            columns,
            ..Self::default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: [f64; 3], expected: [f64; 3]) {
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{found} is not {expected}");
        }
    }

    #[test]
    fn every_unit_is_converted() {
        let nothing = Columns::default();
        assert_near(nothing.read([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        for (unit, kpa) in [
            (PressureUnit::Kpa, 1.0),
            (PressureUnit::Psi, 6.894_757),
            (PressureUnit::Bar, 100.0),
            (PressureUnit::Mpa, 1_000.0),
            (PressureUnit::Pa, 0.001),
        ] {
            let columns = Columns {
                pressure: Some(unit),
                ..nothing
            };
            assert_near(columns.read([0.0, 1.0, 0.0]), [0.0, kpa, 0.0]);
        }
        let columns = Columns {
            time: Some(TimeUnit::Ms),
            angle: Some(AngleUnit::Rad),
            flip_angle: true,
            ..nothing
        };
        assert_near(columns.read([1_500.0, 0.0, 1.0]), [1.5, 0.0, -57.29578]);
    }

    #[test]
    fn the_air_is_taken_off_in_kilopascals_and_columns_are_exchanged_first() {
        let columns = Columns {
            pressure: Some(PressureUnit::Psi),
            air_kpa: Some(ATMOSPHERE_KPA),
            exchange: true,
            ..Columns::default()
        };
        // 14.696 psi is the standard atmosphere.
        assert_near(columns.read([0.0, 30.0, 14.69595]), [0.0, 0.0, 30.0]);
        assert_eq!(
            columns.flags(),
            "--units pressure=psi --absolute-pressure --exchange-columns"
        );
    }

    #[test]
    fn names_and_units_are_read_as_people_write_them() {
        let names = Names::parse("time=t, pressure=Pressure, gauge [psi],angle = \u{3b8}").unwrap();
        assert_eq!(
            Quantity::ALL.map(|it| names.of(it)),
            ["t", "Pressure, gauge [psi]", "\u{3b8}"]
        );
        let names = Names::parse("setpoint_deg=/target.data").unwrap();
        assert_eq!(names.of(Quantity::Time), "time_s");
        assert_eq!(names.optional.len(), 1);
        for wrong in ["", "t", "temperature=T", "time=", "=t"] {
            assert!(Names::parse(wrong).is_err(), "{wrong}");
        }
        let columns = Columns::of_units("pressure=psig,angle=rad,time=ms").unwrap();
        assert_eq!(columns.flags(), "--units time=ms,pressure=psi,angle=rad");
        for (wrong, said) in [
            ("pressure=volt", "kpa, psi"),
            ("pressure", "pressure=psi"),
            ("mass=kg", "none of"),
            ("time=rad", "s, ms"),
        ] {
            let error = Columns::of_units(wrong).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
    }

    #[test]
    fn what_is_said_first_wins_and_the_rest_is_kept() {
        let flags = Layout {
            names: Names::parse("pressure=p").unwrap(),
            columns: Columns::of_units("pressure=bar").unwrap(),
            ..Layout::default()
        };
        let model = Layout {
            names: Names::parse("time=t,pressure=druck").unwrap(),
            columns: Columns::of_units("pressure=psi,angle=rad").unwrap(),
            ..Layout::default()
        };
        let both = flags.or(&model);
        assert_eq!(
            Quantity::ALL.map(|it| both.names.of(it)),
            ["t", "p", "angle_deg"]
        );
        assert_eq!(both.columns.flags(), "--units pressure=bar,angle=rad");
    }
}
