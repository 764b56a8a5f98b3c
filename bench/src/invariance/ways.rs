//! The ways to ask, and what each does to a model, to a recording and to its metadata.
//!
//! All of them work on the text of a file, so that what a way does not concern keeps its
//! last digit.

use std::path::Path;

use clap::ValueEnum;
use model_core::actuator::ParameterId;
use softrig_formats::columns::{AngleUnit, Columns, PressureUnit, Quantity, TimeUnit, Unit};
use softrig_formats::model_file::ModelFile;
use toml_edit::{DocumentMut, Item, Value};

use super::dirt::{Rows, soil};

/// The share of a recording that is cut off.
const CUT: f64 = 0.05;
/// How wrong the first model is made.
const WRONG_BY: f64 = 3.0;
/// Optional columns that are angles.
const OTHER_ANGLES: [&str; 2] = ["setpoint_deg", "predicted_deg"];

/// A way to ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, ValueEnum)]
#[value(rename_all = "snake_case")]
pub enum Way {
    /// As the case is: every other way is compared with it
    Plain,
    /// With `--seed 2` instead of 1
    Seed,
    /// With the recordings in reverse order
    Order,
    /// With recordings in psi, rad and ms, and the flag that says so
    Units,
    /// With the first model that `softrig init` makes of the same recordings
    Init,
    /// With a first model that is wrong: damping and gain three times, stiffness a third
    Times3,
    /// With a first model that is wrong the other way round
    Third,
    /// With the sign of the angle turned, and that of the input gain
    Mirror,
    /// With every second sample
    Half,
    /// Without the first 5 % of each recording
    CutStart,
    /// Without the last 5 % of each recording
    CutEnd,
    /// With a constant added to the input: 1 % of its range
    Offset,
    /// With the inertia free instead of the input gain, or the other way round
    Free,
    /// One angle far beyond all others
    Spike,
    /// One in five hundred angles is the same impossible value
    Sentinel,
    /// Three angles are zero
    Zeros,
    /// One pressure far beyond all others
    WildPressure,
    /// A third of the rows is missing
    Dropped,
    /// Time stamps of a host: late by up to a third of the interval
    Jitter,
    /// Five rows arrive at once
    Bursts,
    /// A logger twice as fast as its sensors
    Held,
    /// A converter of ten bits, of which the signals use a tenth
    Coarse,
    /// The angle stays at one value for a while
    Frozen,
    /// A fortieth of the rows is missing in one place
    Gap,
    /// One in a hundred rows stands there twice
    Twice,
    /// The board restarted: its clock begins again
    Restart,
}

impl Way {
    /// All but [`Way::Plain`], in the order of the tables.
    pub const OTHERS: [Self; 12] = [
        Self::Seed,
        Self::Order,
        Self::Units,
        Self::Init,
        Self::Times3,
        Self::Third,
        Self::Mirror,
        Self::Half,
        Self::CutStart,
        Self::CutEnd,
        Self::Offset,
        Self::Free,
    ];

    /// Those that make recordings dirty.
    pub const DIRTY: [Self; 14] = [
        Self::Spike,
        Self::Sentinel,
        Self::Zeros,
        Self::WildPressure,
        Self::Dropped,
        Self::Jitter,
        Self::Bursts,
        Self::Held,
        Self::Coarse,
        Self::Offset,
        Self::Frozen,
        Self::Gap,
        Self::Twice,
        Self::Restart,
    ];

    /// Its name on the command line, in tables and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Plain => "plain",
            Self::Seed => "seed",
            Self::Order => "order",
            Self::Units => "units",
            Self::Init => "init",
            Self::Times3 => "times3",
            Self::Third => "third",
            Self::Mirror => "mirror",
            Self::Half => "half",
            Self::CutStart => "cut_start",
            Self::CutEnd => "cut_end",
            Self::Free => "free",
            Self::Spike => "spike",
            Self::Sentinel => "sentinel",
            Self::Zeros => "zeros",
            Self::WildPressure => "wild_pressure",
            Self::Dropped => "dropped",
            Self::Jitter => "jitter",
            Self::Bursts => "bursts",
            Self::Held => "held",
            Self::Coarse => "coarse",
            Self::Offset => "offset",
            Self::Frozen => "frozen",
            Self::Gap => "gap",
            Self::Twice => "twice",
            Self::Restart => "restart",
        }
    }

    /// Whether the first model has other numbers. What was right before may then need new
    /// parameters, so "nothing is missing" and "only the parameters were off" are one answer.
    pub fn changes_first_model(self) -> bool {
        matches!(self, Self::Init | Self::Times3 | Self::Third | Self::Free)
    }

    /// Whether recordings are written anew.
    pub fn changes_recordings(self) -> bool {
        Self::DIRTY.contains(&self)
            || matches!(
                self,
                Self::Units | Self::Mirror | Self::Half | Self::CutStart | Self::CutEnd
            )
    }

    /// The random seed.
    pub fn seed(self) -> u64 {
        if self == Self::Seed { 2 } else { 1 }
    }

    /// The units of the recordings; none where they are as the case has them.
    pub fn units(self) -> Option<Columns> {
        (self == Self::Units).then(|| Columns {
            time: Some(TimeUnit::Ms),
            pressure: Some(PressureUnit::Psi),
            angle: Some(AngleUnit::Rad),
            ..Columns::default()
        })
    }

    /// The text of the first model.
    ///
    /// # Errors
    ///
    /// Why this way does not apply to it.
    pub fn model(self, file: &ModelFile) -> Result<String, String> {
        if self == Self::Free {
            return otherwise_free(parsed(file.text())?);
        }
        let factors: &[(ParameterId, &str, f64)] = match self {
            Self::Times3 => &wrong_by(WRONG_BY),
            Self::Third => &wrong_by(1.0 / WRONG_BY),
            Self::Mirror if file.model.effects().next().is_some() => {
                return Err("its model has an effect, which may have a sign of its own".into());
            }
            Self::Mirror => &[(ParameterId::InputGain, "input_gain_n_per_kpa", -1.0)],
            _ => return Ok(file.text().to_owned()),
        };
        let mut document = parsed(file.text())?;
        let mut changed = false;
        for &(id, key, factor) in factors {
            if self == Self::Mirror || file.free.contains(&id) {
                let number = &mut document["dynamics"][key];
                scale(number, factor).ok_or_else(|| format!("its model has no number {key}"))?;
                changed = true;
            }
        }
        if changed {
            Ok(document.to_string())
        } else {
            Err("its model frees none of damping, stiffness and input gain".into())
        }
    }

    /// The text of a recording, and its number of samples. `columns` are the names of time,
    /// pressure and angle in the file.
    ///
    /// # Errors
    ///
    /// What is not a table with these columns.
    pub fn recording(self, text: &str, columns: [&str; 3]) -> Result<(String, usize), String> {
        let mut table = Table::parse(text)?;
        match self {
            Self::Units => table.change_units(columns)?,
            Self::Mirror => {
                table.each(columns[2], turned)?;
                for column in OTHER_ANGLES {
                    if table.place(column).is_ok() {
                        table.each(column, turned)?;
                    }
                }
            }
            Self::Half => {
                let mut keep = false;
                table.rows.retain(|_| {
                    keep = !keep;
                    keep
                });
            }
            Self::CutStart => {
                table.rows.drain(..cut(table.rows.len()));
            }
            Self::CutEnd => {
                let left = table.rows.len() - cut(table.rows.len());
                table.rows.truncate(left);
            }
            _ if Self::DIRTY.contains(&self) => table.soil(self, columns)?,
            _ => {}
        }
        Ok((table.text()?, table.rows.len()))
    }

    /// The text of a recording's metadata; it then has `samples` rows.
    ///
    /// # Errors
    ///
    /// What is wrong with the text.
    pub fn meta(self, text: &str, samples: usize) -> Result<String, String> {
        let mut document = parsed(text)?;
        if document.contains_key("samples") {
            document["samples"] = toml_edit::value(i64::try_from(samples).unwrap_or(i64::MAX));
        }
        if self == Self::Mirror {
            if let Some(level) = document.get_mut("setpoint_deg") {
                scale(level, -1.0);
            }
            if let Some(range) = document
                .get_mut("angle_range_deg")
                .and_then(Item::as_array_mut)
            {
                let mut turned: Vec<f64> = range.iter().filter_map(number).collect();
                turned.reverse();
                *range = turned.into_iter().map(|angle| -angle).collect();
            }
            let segments = document
                .get_mut("segment")
                .and_then(Item::as_array_of_tables_mut);
            for segment in segments.into_iter().flat_map(|list| list.iter_mut()) {
                if let Some(level) = segment.get_mut("setpoint_deg") {
                    scale(level, -1.0);
                }
            }
        }
        Ok(document.to_string())
    }
}

/// The text of a model with the inertia free instead of the gain, or the other way round: only
/// the ratios of inertia, damping, stiffness and gain show in a motion.
fn otherwise_free(mut document: DocumentMut) -> Result<String, String> {
    const EITHER: [&str; 2] = ["input_gain", "inertia"];
    let free = document["fit"]["free"].as_array_mut();
    let free = free.ok_or("its model frees nothing")?;
    let has = |name: &str| free.iter().any(|value| value.as_str() == Some(name));
    let [gives, takes] = match EITHER.map(has) {
        [true, false] => EITHER,
        [false, true] => [EITHER[1], EITHER[0]],
        _ => return Err("its model does not free one of input gain and inertia".into()),
    };
    free.retain(|value| value.as_str() != Some(gives));
    free.push(takes);
    Ok(document.to_string())
}

/// Damping and gain that many times, and the stiffness that part.
const fn wrong_by(factor: f64) -> [(ParameterId, &'static str, f64); 3] {
    [
        (ParameterId::Damping, "damping_n_s_per_rad", factor),
        (
            ParameterId::Stiffness,
            "stiffness_n_per_rad_n",
            1.0 / factor,
        ),
        (ParameterId::InputGain, "input_gain_n_per_kpa", factor),
    ]
}

fn parsed(text: &str) -> Result<DocumentMut, String> {
    text.parse()
        .map_err(|error: toml_edit::TomlError| error.message().replace('\n', ", "))
}

fn number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// Multiplies a number of a document in its place; none if it is no number.
fn scale(item: &mut Item, factor: f64) -> Option<()> {
    let value = item.as_value_mut()?;
    let decor = value.decor().clone();
    *value = Value::from(number(value)? * factor);
    *value.decor_mut() = decor;
    Some(())
}

/// The samples that are cut off a recording of so many.
fn cut(samples: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // Of a count.
    let cut = (samples as f64 * CUT).round() as usize;
    cut
}

/// A number with the other sign, and the same digits.
fn turned(field: &str) -> Option<String> {
    let field = field.trim();
    field.parse::<f64>().ok()?;
    Some(match field.strip_prefix('-') {
        Some(digits) => digits.to_owned(),
        None => format!("-{}", field.strip_prefix('+').unwrap_or(field)),
    })
}

/// The number that is read as `value` where `read` stands between file and reader; where
/// rounding leaves none, the nearest.
fn unread(value: f64, guess: f64, read: impl Fn(f64) -> f64) -> f64 {
    const NEIGHBOURS: usize = 4;
    let mut candidates = vec![guess];
    let (mut below, mut above) = (guess, guess);
    for _ in 0..NEIGHBOURS {
        below = below.next_down();
        above = above.next_up();
        candidates.extend([below, above]);
    }
    let miss = |&candidate: &f64| (read(candidate) - value).abs();
    candidates
        .into_iter()
        .min_by(|a, b| miss(a).total_cmp(&miss(b)))
        .unwrap_or(guess)
}

/// A recording as a table of texts.
struct Table {
    header: csv::StringRecord,
    rows: Vec<csv::StringRecord>,
}

impl Table {
    fn parse(text: &str) -> Result<Self, String> {
        let mut reader = csv::ReaderBuilder::new()
            .comment(Some(b'#'))
            .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
        let header = reader.headers().map_err(|error| error.to_string())?.clone();
        let rows = reader
            .records()
            .collect::<Result<_, _>>()
            .map_err(|error| error.to_string())?;
        Ok(Self { header, rows })
    }

    fn text(&self) -> Result<String, String> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        for row in std::iter::once(&self.header).chain(&self.rows) {
            writer
                .write_record(row)
                .map_err(|error| error.to_string())?;
        }
        let bytes = writer.into_inner().map_err(|error| error.to_string())?;
        String::from_utf8(bytes).map_err(|error| error.to_string())
    }

    fn place(&self, column: &str) -> Result<usize, String> {
        let mut names = self.header.iter();
        names
            .position(|name| name.trim() == column)
            .ok_or_else(|| format!("has no column {column}"))
    }

    /// Replaces each field of a column that is a number.
    fn each(
        &mut self,
        column: &str,
        change: impl Fn(&str) -> Option<String>,
    ) -> Result<(), String> {
        let place = self.place(column)?;
        for row in &mut self.rows {
            let fields = row.iter().enumerate().map(|(index, field)| {
                let changed = (index == place).then(|| change(field)).flatten();
                changed.unwrap_or_else(|| field.to_owned())
            });
            *row = fields.collect();
        }
        Ok(())
    }

    /// Makes time, pressure and angle dirty; other columns go with their rows.
    fn soil(&mut self, way: Way, columns: [&str; 3]) -> Result<(), String> {
        let places = [
            self.place(columns[0])?,
            self.place(columns[1])?,
            self.place(columns[2])?,
        ];
        let number = |row: &csv::StringRecord, place: usize| -> Result<f64, String> {
            let field = row.get(place).unwrap_or_default();
            let read = field.trim().parse();
            read.map_err(|_| format!("{field} in column {} is no number", &self.header[place]))
        };
        let column = |place: usize| -> Result<Vec<f64>, String> {
            self.rows.iter().map(|row| number(row, place)).collect()
        };
        let numbers = [column(places[0])?, column(places[1])?, column(places[2])?];
        let mut rows = Rows::new(numbers);
        soil(way, &mut rows);
        self.rows = rows
            .of
            .iter()
            .enumerate()
            .map(|(row, &of)| {
                let clean = self.rows[of].iter().enumerate();
                let fields = clean.map(|(place, field)| {
                    let quantity = places.iter().position(|it| *it == place);
                    let value = match quantity {
                        Some(0) => rows.time[row],
                        Some(1) => rows.pressure[row],
                        Some(_) => rows.angle[row],
                        None => return field.to_owned(),
                    };
                    // What was not touched keeps its last digit.
                    if field.trim().parse() == Ok(value) {
                        field.to_owned()
                    } else {
                        format!("{value:.9}")
                    }
                });
                fields.collect()
            })
            .collect();
        Ok(())
    }

    /// Writes time, pressure and angle in the units of [`Way::Units`], so that they are read
    /// as they were.
    fn change_units(&mut self, columns: [&str; 3]) -> Result<(), String> {
        let units = Way::Units.units().unwrap_or_default();
        for (quantity, column) in Quantity::ALL.into_iter().zip(columns) {
            let per_unit = match units.unit(quantity) {
                Some(Unit::Time(unit)) => unit.seconds(),
                Some(Unit::Pressure(unit)) => unit.kilopascals(),
                Some(Unit::Angle(unit)) => unit.degrees(),
                None => continue,
            };
            self.each(column, |field| {
                let value: f64 = field.trim().parse().ok()?;
                let read = |written: f64| {
                    let mut row = [0.0; 3];
                    row[quantity as usize] = written;
                    units.read(row)[quantity as usize]
                };
                Some(unread(value, value / per_unit, read).to_string())
            })?;
        }
        Ok(())
    }
}

/// The names of time, pressure and angle in the files that a model is for.
pub fn columns_of(file: &ModelFile) -> [&str; 3] {
    let mut columns = Quantity::ALL.map(|quantity| file.recording.names.of(quantity));
    if file.recording.columns.exchange {
        columns.swap(1, 2);
    }
    columns
}

/// Reads the text of a model.
///
/// # Errors
///
/// What is wrong with it.
pub fn model_file(text: &str, path: &Path) -> Result<ModelFile, String> {
    ModelFile::parse(text, path).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_formats::columns::Layout;
    use softrig_formats::recording::{Meta, Recording};

    const COLUMNS: [&str; 3] = ["time_s", "pressure_kpa", "angle_deg"];

    const MODEL: &str = "\
schema = 1
name = \"a rig\"

[dynamics]
inertia_kg_m = 1.0
damping_n_s_per_rad = 0.3 # a guess
stiffness_n_per_rad_n = 6
exponent = 1.0
input_gain_n_per_kpa = 0.7

[fit]
free = [\"damping\", \"stiffness\"]
";

    fn model(text: &str) -> ModelFile {
        model_file(text, Path::new("model.toml")).unwrap()
    }

    /// Samples with digits that are no round binary numbers.
    fn recording() -> String {
        let mut text = String::from("time_s,pressure_kpa,angle_deg,setpoint_deg,note\n");
        for k in 0..1000_u32 {
            let x = f64::from(k);
            text += &format!(
                "{},{:.4},{:.6},30,a\n",
                x / 100.0,
                60.0 * (0.013 * x).sin(),
                75.0 * (0.011 * x).cos() - 12.3
            );
        }
        text
    }

    fn read(text: &str, columns: Columns) -> Recording {
        let layout = Layout::from(columns);
        let (recording, _) = Recording::parse_as(text, Path::new("a.csv"), &layout).unwrap();
        recording
    }

    /// The way from s, kPa and ° to ms, psi and rad and back loses nothing that a number can
    /// hold.
    #[test]
    fn other_units_are_read_as_the_same_numbers() {
        const LAST_BITS: f64 = 4e-16;
        let before = read(&recording(), Columns::default());
        let (text, samples) = Way::Units.recording(&recording(), COLUMNS).unwrap();
        assert_eq!(samples, 1000);
        let after = read(&text, Way::Units.units().unwrap());
        let mut exact = 0;
        for (one, other) in [
            (&before.time, &after.time),
            (&before.pressure, &after.pressure),
            (&before.angle, &after.angle),
        ] {
            for (one, other) in one.iter().zip(other) {
                assert!(
                    (one - other).abs() <= LAST_BITS * one.abs(),
                    "{one} {other}"
                );
                exact += usize::from(one.to_bits() == other.to_bits());
            }
        }
        // Not every product with a factor is a number: the rest is off by the last bit.
        assert!(exact > 2_400, "{exact} of 3000");
        // They are not the old numbers under another name.
        let wrong = read(&text, Columns::default());
        assert!((wrong.time[1] - 10.0).abs() < 1e-9);
    }

    #[test]
    fn a_mirrored_mirror_shows_the_same() {
        let once = Way::Mirror.recording(&recording(), COLUMNS).unwrap().0;
        assert_ne!(once, recording());
        let (before, after) = (
            read(&recording(), Columns::default()),
            read(&once, Columns::default()),
        );
        let negative: Vec<f64> = before.angle.iter().map(|angle| -angle).collect();
        assert_eq!(after.angle, negative);
        assert_eq!(
            (&after.pressure, &after.time),
            (&before.pressure, &before.time)
        );
        assert_eq!(
            after.column("setpoint_deg").unwrap()[0].to_bits(),
            (-30.0_f64).to_bits()
        );
        let twice = Way::Mirror.recording(&once, COLUMNS).unwrap().0;
        assert_eq!(twice, recording());

        let once = Way::Mirror.model(&model(MODEL)).unwrap();
        assert!(once.contains("input_gain_n_per_kpa = -0.7"), "{once}");
        assert_eq!(Way::Mirror.model(&model(&once)).unwrap(), MODEL);

        let meta = "setpoint_deg = 30.0\nangle_range_deg = [-15.0, 50.0]\nsamples = 5\n\n[[segment]]\nfrom_s = 0.0\nto_s = 1.0\nsetpoint_deg = 20.0\n";
        let once = Way::Mirror.meta(meta, 5).unwrap();
        let read = Meta::parse(&once, Path::new("a.meta.toml")).unwrap();
        assert_eq!(read.setpoint_deg, Some(-30.0));
        assert_eq!(read.angle_range_deg, Some([-50.0, 15.0]));
        assert_eq!(read.segment[0].setpoint_deg, Some(-20.0));
        assert_eq!(Way::Mirror.meta(&once, 5).unwrap(), meta);
    }

    #[test]
    fn five_in_a_hundred_are_cut_off_and_every_second_is_kept() {
        let before = read(&recording(), Columns::default());
        let of = |way: Way| {
            let (text, samples) = way.recording(&recording(), COLUMNS).unwrap();
            let after = read(&text, Columns::default());
            assert_eq!(after.len(), samples);
            after
        };
        let start = of(Way::CutStart);
        assert_eq!(start.angle, before.angle[50..]);
        assert_eq!(start.time, before.time[50..]);
        assert_eq!(of(Way::CutEnd).angle, before.angle[..950]);
        let half = of(Way::Half);
        assert_eq!(half.len(), 500);
        assert_eq!(half.angle[1].to_bits(), before.angle[2].to_bits());
        assert_eq!([0, 9, 10, 37].map(cut), [0, 0, 1, 2]);
        assert_eq!(
            Way::Half.meta("samples = 1000\nprotocol = \"steps\"\n", 500),
            Ok("samples = 500\nprotocol = \"steps\"\n".into())
        );
    }

    #[test]
    fn a_wrong_first_model_is_wrong_in_what_is_free() {
        let text = Way::Times3.model(&model(MODEL)).unwrap();
        let wrong = model(&text);
        let value = |file: &ModelFile, id| file.model.value(id).unwrap();
        assert!((value(&wrong, ParameterId::Damping) - 0.9).abs() < 1e-12);
        assert!((value(&wrong, ParameterId::Stiffness) - 2.0).abs() < 1e-12);
        // The gain is not free.
        assert!(text.contains("input_gain_n_per_kpa = 0.7"));
        assert!(text.contains("# a guess"));
        let back = model(&Way::Third.model(&wrong).unwrap());
        assert!((value(&back, ParameterId::Damping) - 0.3).abs() < 1e-12);
        assert!((value(&back, ParameterId::Stiffness) - 6.0).abs() < 1e-12);
        let fixed = MODEL.replace("\"damping\", \"stiffness\"", "\"exponent\"");
        assert!(Way::Third.model(&model(&fixed)).is_err());
        assert_eq!(Way::Seed.model(&model(MODEL)).unwrap(), MODEL);
    }

    #[test]
    fn what_cannot_be_changed_is_said() {
        let effect = format!(
            "{MODEL}\n[[effect]]\nkind = \"coulomb_friction\"\nforce_n = 0.02\nsmoothing_rad_per_s = 0.02\n"
        );
        let said = Way::Mirror.model(&model(&effect)).unwrap_err();
        assert!(said.contains("effect"), "{said}");
        let said = Way::Mirror.recording("t;p\n1;2\n", COLUMNS).unwrap_err();
        assert!(said.contains("angle_deg"), "{said}");
        assert!(Way::Mirror.meta("samples = ", 1).is_err());
    }

    #[test]
    fn names_are_those_of_the_command_line() {
        for way in std::iter::once(Way::Plain).chain(Way::OTHERS) {
            assert_eq!(way.to_possible_value().unwrap().get_name(), way.name());
        }
    }
}
