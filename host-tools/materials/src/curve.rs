//! Tensile curves from files.
//!
//! Tensile tests come as exports of many machines. Two layouts are read: that of the Soft Robotics
//! Materials Database (a dozen lines about the test, then a line that starts with `Time (s)`) and a
//! plain table whose first line names its columns. How a table is written (delimiter, decimal sign,
//! encoding) is found out as for a recording, by [`softrig_formats::table`]. Anything else is refused
//! with the file, the line and the column, since a misread curve would still give an exponent.

use std::path::{Path, PathBuf};

use softrig_formats::bounded::Limits;
use softrig_formats::error::InputError;
use softrig_formats::numbers::counted;
use softrig_formats::table::{Header, Numbers, Row, Rows, Wanted, seems_number};
use strum::{Display, EnumMessage, EnumString, IntoStaticStr, VariantArray};

/// A stress or strain measure.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    schemars::JsonSchema,
    serde::Serialize,
    Display,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
#[strum(serialize_all = "snake_case")]
pub enum Measure {
    /// Per undeformed section or length.
    Engineering,
    /// Per deformed section; the logarithm of the stretch.
    True,
}

/// One sample of a tensile test in both measures.
///
/// A measure that the file does not have is derived, with ε the engineering strain:
/// true strain = ln(1 + ε), true stress = (1 + ε) · engineering stress.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    engineering_strain: f64,
    true_strain: f64,
    engineering_stress_mpa: f64,
    true_stress_mpa: f64,
}

impl Sample {
    /// The strain, without unit.
    pub fn strain(&self, measure: Measure) -> f64 {
        match measure {
            Measure::Engineering => self.engineering_strain,
            Measure::True => self.true_strain,
        }
    }

    /// The stress in MPa.
    pub fn stress_mpa(&self, measure: Measure) -> f64 {
        match measure {
            Measure::Engineering => self.engineering_stress_mpa,
            Measure::True => self.true_stress_mpa,
        }
    }
}

/// A tensile test.
///
/// | column | accepted names |
/// |---|---|
/// | strain | `strain`, `engineering strain`, `true strain`; with `%` or `percent` for percent |
/// | stress | `stress`, `engineering stress`, `true stress`, with `MPa`, `kPa`, `Pa` or `N/mm2` |
/// | time | `time`; checked, not used |
///
/// Case, spaces and punctuation in a name do not matter; a name without a measure means
/// engineering, and a unit may be in a row beneath the names instead of in them.
#[derive(Clone, Debug, PartialEq)]
pub struct TensileCurve {
    /// Where it was read.
    pub path: PathBuf,
    /// What was tested, as the file or else the file's name says.
    pub material: String,
    /// The samples in the order of the file.
    pub samples: Vec<Sample>,
    /// Oddities of the file that do not prevent a fit, as sentences.
    pub notes: Vec<String>,
}

fn quoted(names: &[String]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    quoted.join(", ")
}

/// Strains above this are taken for percent: the longest curve of the database
/// ends at 18.2.
const LARGEST_STRAIN: f64 = 25.0;
/// True stresses above this are taken for another unit: the highest of the
/// database is 51 MPa.
const LARGEST_STRESS_MPA: f64 = 500.0;
/// A test that never reaches this is taken for another unit: the softest
/// material of the database passes it at a strain of 0.07.
const SMALLEST_PEAK_MPA: f64 = 1e-4;

/// Lines about the test that are looked through for the header; the database has 17.
const LINES_ABOVE: usize = 64;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Quantity {
    Strain(Measure),
    Stress(Measure),
    Time,
}

/// What is wrong, and what to do.
type Fault = (&'static str, &'static str);

/// The letters and digits of a name or a unit, in small.
fn plain(text: &str) -> String {
    text.to_lowercase()
        .replace('%', "percent")
        .replace('²', "2")
        .chars()
        .filter(|c| c.is_alphanumeric())
        .collect()
}

impl Quantity {
    /// Understands the name of a column, as far as the unit in it, which is returned
    /// with it; `None` for a column that is not needed.
    fn of(name: &str) -> Option<(Self, String)> {
        let plain = plain(name);
        if plain.starts_with("time") {
            return Some((Self::Time, String::new()));
        }
        let (measure, rest) = [
            ("engineering", Measure::Engineering),
            ("nominal", Measure::Engineering),
            ("eng", Measure::Engineering),
            ("logarithmic", Measure::True),
            ("true", Measure::True),
        ]
        .into_iter()
        .find_map(|(prefix, measure)| plain.strip_prefix(prefix).map(|rest| (measure, rest)))
        .unwrap_or((Measure::Engineering, &plain));
        if let Some(unit) = rest.strip_prefix("strain") {
            let is_rate = matches!(unit, "rate" | "rate1s");
            return (!is_rate).then(|| (Self::Strain(measure), unit.to_owned()));
        }
        let unit = rest.strip_prefix("stress")?;
        Some((Self::Stress(measure), unit.to_owned()))
    }

    /// What its numbers in a unit are multiplied by, to be fractions or MPa.
    fn scale(self, unit: &str) -> Result<f64, Fault> {
        Ok(match (self, unit) {
            (Self::Time, _)
            | (Self::Strain(_), "" | "1" | "mmmm")
            | (Self::Stress(_), "mpa" | "nmm2") => 1.0,
            (Self::Strain(_), "percent" | "pct") => 0.01,
            (Self::Stress(_), "kpa") => 1e-3,
            (Self::Stress(_), "pa") => 1e-6,
            (Self::Strain(_), _) => {
                return Err((
                    "has an unknown unit of strain",
                    "use a fraction, or `strain (%)`",
                ));
            }
            (Self::Stress(_), "") => {
                return Err((
                    "has no unit",
                    "name it `stress_mpa`, `stress_kpa` or `stress_pa`",
                ));
            }
            (Self::Stress(_), _) => {
                return Err(("has an unknown unit of stress", "use MPa, kPa or Pa"));
            }
        })
    }
}

/// Whether names are those of a tensile curve: as the database begins them, or with
/// a strain and a stress among them.
fn are_of_a_curve(names: &[String]) -> bool {
    let quantities: Vec<Quantity> = names
        .iter()
        .filter_map(|name| Quantity::of(name))
        .map(|(quantity, _)| quantity)
        .collect();
    let has = |is: fn(&Quantity) -> bool| quantities.iter().any(is);
    let has_both =
        has(|it| matches!(it, Quantity::Strain(_))) && has(|it| matches!(it, Quantity::Stress(_)));
    let [first, _, ..] = names else {
        return false;
    };
    has_both || first.starts_with("Time (s)")
}

/// Whether a row holds the units of the columns above it: it has no number in it, and
/// one of strain or stress.
fn is_of_units(row: &Row, header: &Header) -> bool {
    let is_unit = |(column, name): (usize, &String)| {
        let unit = plain(&row.field(column));
        !unit.is_empty()
            && Quantity::of(name).is_some_and(|(quantity, _)| {
                quantity != Quantity::Time && quantity.scale(&unit).is_ok()
            })
    };
    row.width() == header.names.len()
        && !(0..row.width()).any(|column| seems_number(&row.field(column)))
        && header.names.iter().enumerate().any(is_unit)
}

/// A column that is used: where it stands and what its numbers mean.
#[derive(Clone, Debug)]
struct Column {
    index: usize,
    name: String,
    scale: f64,
}

#[derive(Clone, Debug, Default)]
struct Columns {
    names: Vec<String>,
    engineering_strain: Option<Column>,
    true_strain: Option<Column>,
    engineering_stress: Option<Column>,
    true_stress: Option<Column>,
    time: Option<Column>,
}

impl Columns {
    /// Finds the columns in a header, with their units in it or in a row beneath it.
    fn of(path: &Path, header: &Header, units: Option<&Row>) -> Result<Self, InputError> {
        let bad = |line, column: &str, (found, advice): Fault| {
            InputError::new(found, advice)
                .in_file(path)
                .at_line(line)
                .in_column(column)
        };
        let mut columns = Self {
            names: header.names.clone(),
            ..Self::default()
        };
        for (index, name) in header.names.iter().enumerate() {
            let Some((quantity, unit)) = Quantity::of(name) else {
                continue;
            };
            let beneath = units.map(|row| (row.line(), plain(&row.field(index))));
            let (line, unit) = match &beneath {
                Some((line, beneath)) if unit.is_empty() => (*line, beneath),
                _ => (header.line, &unit),
            };
            let scale = quantity
                .scale(unit)
                .map_err(|fault| bad(line, name, fault))?;
            if let Some((line, beneath)) = &beneath
                && !beneath.is_empty()
                && quantity
                    .scale(beneath)
                    .is_ok_and(|other| other.total_cmp(&scale).is_ne())
            {
                let fault = (
                    "has another unit beneath its name than in it",
                    "correct one of the two",
                );
                return Err(bad(*line, name, fault));
            }
            let slot = match quantity {
                Quantity::Strain(Measure::Engineering) => &mut columns.engineering_strain,
                Quantity::Strain(Measure::True) => &mut columns.true_strain,
                Quantity::Stress(Measure::Engineering) => &mut columns.engineering_stress,
                Quantity::Stress(Measure::True) => &mut columns.true_stress,
                Quantity::Time => &mut columns.time,
            };
            if slot.is_some() {
                return Err(bad(
                    header.line,
                    name,
                    ("means the same as an earlier column", "keep one of the two"),
                ));
            }
            *slot = Some(Column {
                index,
                name: name.to_owned(),
                scale,
            });
        }
        let missing = |wanted, example| {
            InputError::new(
                format!("no {wanted} column among {}", quoted(&columns.names)),
                format!("name one `{example}`"),
            )
            .in_file(path)
            .at_line(header.line)
        };
        if columns.engineering_strain.is_none() && columns.true_strain.is_none() {
            return Err(missing("strain", "strain"));
        }
        if columns.engineering_stress.is_none() && columns.true_stress.is_none() {
            return Err(missing("stress", "stress_mpa"));
        }
        Ok(columns)
    }
}

impl TensileCurve {
    /// Reads a tensile curve from a file.
    ///
    /// # Errors
    ///
    /// [`InputError`], with the line and the column where there is one.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let bytes = softrig_formats::bounded::read_bytes(path)?;
        Self::parse(path, &bytes)
    }

    /// Reads a tensile curve from the contents of a file; `path` is for messages
    /// and for the name of the material.
    ///
    /// # Errors
    ///
    /// As for [`read`](Self::read).
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self, InputError> {
        let fault = |found: &str, advice: &str| InputError::new(found, advice).in_file(path);
        let wanted = Wanted {
            names: &are_of_a_curve,
            lines_above: LINES_ABOVE,
            skipped: 0,
            is_headless: false,
        };
        let Some((header, rows)) = Rows::open(bytes, path, Limits::TABLE, wanted)? else {
            return Err(fault("is empty", "export the test again"));
        };
        if header.names.first().is_some_and(|name| name == "PARAMETER") {
            return Err(fault(
                "describes a test but no line starts with `Time (s)`",
                "the samples were cut off, fetch the file again",
            ));
        }
        let mut rows = Filled { rows };
        let mut row = Row::default();
        let mut more = rows.next(&mut row)?;
        let mut notes = Vec::new();
        let columns = if more && is_of_units(&row, &header) {
            let columns = Columns::of(path, &header, Some(&row))?;
            notes.push(format!("line {} is taken for a row of units", row.line()));
            more = rows.next(&mut row)?;
            columns
        } else {
            Columns::of(path, &header, None)?
        };
        let mut reader = Reader {
            path,
            columns: &columns,
            numbers: Numbers::default(),
        };
        let mut lines = Vec::new();
        let mut samples = Vec::new();
        let mut time = Time::default();
        let mut peak: f64 = 0.0;
        while more {
            if row.width() != header.names.len() {
                let line = row.line();
                let fields = row.width();
                let is_last = matches!(rows.next(&mut row), Ok(false));
                return Err(reader.wrong_width(line, fields, is_last));
            }
            time.note(reader.time(&row), row.line(), &mut notes);
            let sample = reader.sample(&row)?;
            peak = peak.max(sample.true_stress_mpa.abs());
            samples.push(sample);
            lines.push(row.line());
            more = rows.next(&mut row)?;
        }
        reader
            .numbers
            .check()
            .map_err(|error| error.in_file(path))?;
        let Some(last) = lines.last() else {
            return Err(fault(
                "names columns but holds no sample",
                "export the test again",
            ));
        };
        if peak < SMALLEST_PEAK_MPA {
            let column = columns.engineering_stress.or(columns.true_stress);
            return Err(InputError::new(
                format!("the stress never exceeds {peak:.1e} MPa, so the unit is probably wrong"),
                "correct the column's name",
            )
            .in_file(path)
            .at_line(*last)
            .in_column(column.map(|column| column.name).unwrap_or_default()));
        }
        note_measures(&lines, &samples, &mut notes);
        Ok(Self {
            path: path.to_owned(),
            material: material(&header).unwrap_or_else(|| {
                path.file_stem()
                    .map(|stem| stem.to_string_lossy().into_owned())
                    .unwrap_or_default()
            }),
            samples,
            notes,
        })
    }

    /// The largest strain.
    pub fn largest_strain(&self, measure: Measure) -> f64 {
        self.samples
            .iter()
            .map(|sample| sample.strain(measure))
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

/// The material that the lines above the header name.
fn material(header: &Header) -> Option<String> {
    let lines = header.above.iter().rev();
    let mut named = lines.filter(|line| line.first().is_some_and(|first| first == "Material"));
    let name = named.next()?.get(1)?;
    (!name.is_empty()).then(|| name.clone())
}

/// The rows that hold something: spreadsheets pad tables with lines of separators.
struct Filled<'a> {
    rows: Rows<'a, &'a [u8]>,
}

impl Filled<'_> {
    fn next(&mut self, row: &mut Row) -> Result<bool, InputError> {
        while self.rows.next(row)? {
            if !row.is_blank() {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// Reads the samples of a file.
struct Reader<'a> {
    path: &'a Path,
    columns: &'a Columns,
    numbers: Numbers,
}

impl Reader<'_> {
    fn bad(
        &self,
        line: u64,
        column: &Column,
        found: impl Into<String>,
        advice: &str,
    ) -> InputError {
        InputError::new(found, advice)
            .in_file(self.path)
            .at_line(line)
            .in_column(column.name.as_str())
    }

    /// A row with another number of fields than the header.
    fn wrong_width(&self, line: u64, fields: usize, is_last: bool) -> InputError {
        let expected = self.columns.names.len();
        let advice = if is_last && fields < expected {
            "the file ends in the middle of a line, so delete that line or export again"
        } else {
            "correct the line or delete it"
        };
        InputError::new(
            format!(
                "{} where the header names {expected}",
                counted(fields, "field")
            ),
            advice,
        )
        .in_file(self.path)
        .at_line(line)
    }

    fn number(&mut self, row: &Row, column: Option<&Column>) -> Result<Option<f64>, InputError> {
        let Some(column) = column else {
            return Ok(None);
        };
        let field = row.field(column.index);
        let value = self
            .numbers
            .read(&field, row.line(), &column.name)
            .map_err(|error| error.in_file(self.path))?;
        if !value.is_finite() {
            return Err(self.bad(
                row.line(),
                column,
                format!("`{field}` is not a finite number"),
                "correct it or delete the line",
            ));
        }
        Ok(Some(value * column.scale))
    }

    /// The time of a row, if it is a number: no fit uses it.
    fn time(&mut self, row: &Row) -> Option<f64> {
        let columns = self.columns;
        self.number(row, columns.time.as_ref()).ok().flatten()
    }

    fn sample(&mut self, row: &Row) -> Result<Sample, InputError> {
        let line = row.line();
        let columns = self.columns;
        let mut given = |column: &Option<Column>| self.number(row, column.as_ref());
        let engineering_strain = given(&columns.engineering_strain)?;
        let true_strain = given(&columns.true_strain)?;
        let engineering_stress = given(&columns.engineering_stress)?;
        let true_stress = given(&columns.true_stress)?;

        if let (Some(strain), Some(column)) = (engineering_strain, &columns.engineering_strain) {
            if strain <= -1.0 {
                return Err(self.bad(
                    line,
                    column,
                    format!("a strain of {strain} leaves no material"),
                    "correct it or delete the line",
                ));
            }
            if strain > LARGEST_STRAIN {
                return Err(self.bad(
                    line,
                    column,
                    format!("a strain of {strain} looks like percent"),
                    "name the column `strain (%)` or divide by 100",
                ));
            }
        }
        if let (Some(strain), Some(column)) = (true_strain, &columns.true_strain)
            && strain.abs() > LARGEST_STRAIN.ln_1p()
        {
            return Err(self.bad(
                line,
                column,
                format!("a true strain of {strain} is beyond any elastomer"),
                "it may be percent or an engineering strain, so correct the column's name",
            ));
        }
        let engineering = engineering_strain
            .or_else(|| true_strain.map(f64::exp_m1))
            .unwrap_or_default();
        let stretch = 1.0 + engineering;
        let sample = Sample {
            engineering_strain: engineering,
            true_strain: true_strain.unwrap_or_else(|| engineering.ln_1p()),
            engineering_stress_mpa: engineering_stress
                .or_else(|| true_stress.map(|stress| stress / stretch))
                .unwrap_or_default(),
            true_stress_mpa: true_stress
                .or_else(|| engineering_stress.map(|stress| stress * stretch))
                .unwrap_or_default(),
        };
        let column = columns
            .true_stress
            .as_ref()
            .or(columns.engineering_stress.as_ref());
        if let Some(column) = column
            && sample.true_stress_mpa.abs() > LARGEST_STRESS_MPA
        {
            return Err(self.bad(
                line,
                column,
                format!("a true stress of {:.0} MPa is beyond any elastomer, so the unit is probably wrong", sample.true_stress_mpa), "correct the column's name",
            ));
        }
        Ok(sample)
    }
}

/// The time of the row before.
#[derive(Default)]
struct Time {
    previous: Option<f64>,
    noted: bool,
}

impl Time {
    /// Says, once, if time runs backwards, as in five files of the database.
    fn note(&mut self, now: Option<f64>, line: u64, notes: &mut Vec<String>) {
        if let (Some(before), Some(now), false) = (self.previous, now, self.noted)
            && now < before
        {
            self.noted = true;
            notes.push(format!(
                "time runs backwards at line {line} ({before} s, then {now} s); the fit does \
                 not use it"
            ));
        }
        self.previous = now;
    }
}

/// Says if the two measures of the file contradict each other.
fn note_measures(lines: &[u64], samples: &[Sample], notes: &mut Vec<String>) {
    let apart = |a: f64, b: f64| (a - b).abs() > 1e-4 + 0.01 * a.abs().max(b.abs());
    let mut report = |what: &str, lines: Vec<u64>| {
        if let Some(first) = lines.first() {
            notes.push(format!(
                "{what} disagree on {} of {} lines, first on line {first}; each is used as \
                     it stands",
                lines.len(),
                samples.len()
            ));
        }
    };
    let faulty = |is_faulty: &dyn Fn(&Sample) -> bool| -> Vec<u64> {
        lines
            .iter()
            .zip(samples)
            .filter(|(_, sample)| is_faulty(sample))
            .map(|(line, _)| *line)
            .collect()
    };
    report(
        "true and engineering strain",
        faulty(&|s| apart(s.true_strain, s.engineering_strain.ln_1p())),
    );
    report(
        "true and engineering stress",
        faulty(&|s| {
            apart(
                s.true_stress_mpa,
                s.engineering_stress_mpa * (1.0 + s.engineering_strain),
            )
        }),
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<TensileCurve, InputError> {
        TensileCurve::parse(Path::new("silicone.csv"), text.as_bytes())
    }

    fn message(text: &str) -> String {
        parse(text).unwrap_err().to_string()
    }

    const DATABASE: &str = "PARAMETER;INFO;URL;;\nSpeed (mm/min);450;;;\nMaterial;Dragon Skin 20;;;\n;;;;\n\
        Time (s);True Strain;True Stress (MPa);Engineering Strain;Engineering Stress (MPa)\n\
        0.2;0.0953102;0.011;0.1;0.01\n0.3;0.1823216;0.024;0.2;0.02\n";

    #[test]
    fn the_layout_of_the_database_is_read() {
        for text in [DATABASE.to_owned(), DATABASE.replace('\n', "\r\n")] {
            let curve = parse(&text).unwrap();
            assert_eq!(curve.material, "Dragon Skin 20");
            assert_eq!(curve.samples.len(), 2);
            assert_eq!(curve.notes, Vec::<String>::new());
            let last = curve.samples[1];
            assert!((last.strain(Measure::True) - 0.182_321_6).abs() < 1e-15);
            assert!((last.stress_mpa(Measure::True) - 0.024).abs() < 1e-15);
            assert!((last.strain(Measure::Engineering) - 0.2).abs() < 1e-15);
            assert!((last.stress_mpa(Measure::Engineering) - 0.02).abs() < 1e-15);
        }
    }

    #[test]
    fn a_plain_table_is_read_and_completed() {
        let same = |text: &str| {
            let curve = parse(text).unwrap();
            assert_eq!(curve.material, "silicone");
            let last = *curve.samples.last().unwrap();
            assert!(
                (last.strain(Measure::Engineering) - 0.5).abs() < 1e-12,
                "{text}"
            );
            assert!((last.strain(Measure::True) - 1.5_f64.ln()).abs() < 1e-12);
            assert!((last.stress_mpa(Measure::Engineering) - 0.2).abs() < 1e-12);
            assert!((last.stress_mpa(Measure::True) - 0.3).abs() < 1e-12);
        };
        same("strain,stress_mpa\n0,0\n0.5,0.2\n");
        same("# pulled by hand\n\nStrain (%);Stress (kPa)\n0;0\n50;200\n;\n");
        same("Eng. strain\tTrue stress (Pa)\n0.5\t300000");
        same(
            "\u{feff}True Strain [1], Nominal Stress [N/mm²], remark\n0.4054651081081644,0.2,good\n",
        );
    }

    /// However a test is exported, its samples are the same to the bit.
    #[test]
    fn a_curve_in_another_dialect_is_the_same_curve() {
        let utf16 = |text: &str, bytes: fn(u16) -> [u8; 2]| -> Vec<u8> {
            text.encode_utf16().flat_map(bytes).collect()
        };
        let with_commas = DATABASE.replace('.', ",");
        let marked = format!("\u{feff}{with_commas}");
        let latin_1 = with_commas.replace("450;;", "450;Universit\u{e9};");
        let latin_1 = latin_1.chars().map(|c| u8::try_from(c).unwrap()).collect();
        let table = DATABASE.split_inclusive('\n').skip(4).collect::<String>();
        let beneath = with_commas
            .replace(" (s);", ";")
            .replace(" (MPa)", "")
            .replace("\n0,2;", "\ns;-;MPa;mm/mm;[MPa]\n0,2;");
        let beneath = beneath.split_inclusive('\n').skip(4).collect::<String>();
        let samples = parse(DATABASE).unwrap().samples;
        for (name, bytes) in [
            ("decimal commas", with_commas.clone().into_bytes()),
            ("tabs", with_commas.replace(';', "\t").into_bytes()),
            ("commas between columns", DATABASE.replace(';', ",").into()),
            ("UTF-16LE", utf16(&marked, u16::to_le_bytes)),
            (
                "UTF-16BE without a mark",
                utf16(&with_commas, u16::to_be_bytes),
            ),
            ("Latin-1", latin_1),
            ("a plain table", format!("% by hand\n{table}").into_bytes()),
            ("a comment as header", format!("# {table}").into_bytes()),
            ("a row of units", beneath.into_bytes()),
        ] {
            let curve = TensileCurve::parse(Path::new("Dragon Skin 20.csv"), &bytes)
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(curve.samples, samples, "{name}");
            assert_eq!(curve.material, "Dragon Skin 20", "{name}");
            assert_eq!(curve.notes.len(), usize::from(name == "a row of units"));
        }
        let percent = parse("Strain;Stress\n[%];[kPa]\n50;200\n").unwrap();
        assert_eq!(
            percent.samples,
            parse("strain,stress_mpa\n0.5,0.2\n").unwrap().samples
        );
        assert_eq!(percent.notes, ["line 2 is taken for a row of units"]);
    }

    #[test]
    fn oddities_of_the_database_are_noted() {
        let text = format!("{DATABASE}0.1;0.2623643;-0.039;0.3;0.03\n");
        let notes = parse(&text).unwrap().notes;
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert!(notes[0].starts_with("time runs backwards at line 8 (0.3 s, then 0.1 s)"));
        assert!(notes[1].contains("stress disagree on 1 of 3 lines, first on line 8"));
    }

    /// Parses each text, which has to be refused with the message beside it.
    fn refuse(cases: &[(&str, &str)]) {
        for (text, expected) in cases {
            assert_eq!(&message(text), expected, "for {text:?}");
        }
    }

    #[test]
    fn a_header_is_refused_where_it_stands() {
        refuse(&[
            ("", "silicone.csv: is empty; export the test again"),
            (
                "\n# only a comment\n",
                "silicone.csv: is empty; export the test again",
            ),
            (
                "strain,stress_mpa\n",
                "silicone.csv: names columns but holds no sample; export the test again",
            ),
            (
                "PARAMETER;INFO;URL;;\nMaterial;X;;;\n",
                "silicone.csv: describes a test but no line starts with `Time (s)`; \
                 the samples were cut off, fetch the file again",
            ),
            (
                "force,stress_mpa\n1,2\n",
                "silicone.csv, line 1: no strain column among `force`, `stress_mpa`; name one `strain`",
            ),
            (
                "\nstrain,load_n\n1,2\n",
                "silicone.csv, line 2: no stress column among `strain`, `load_n`; name one `stress_mpa`",
            ),
            (
                "strain,stress\n1,2\n",
                "silicone.csv, line 1, column stress: has no unit; \
                 name it `stress_mpa`, `stress_kpa` or `stress_pa`",
            ),
            (
                "strain,stress_psi\n1,2\n",
                "silicone.csv, line 1, column stress_psi: has an unknown unit of stress; \
                 use MPa, kPa or Pa",
            ),
            (
                "strain,engineering_strain,stress_pa\n1,2,3\n",
                "silicone.csv, line 1, column engineering_strain: \
                 means the same as an earlier column; keep one of the two",
            ),
            (
                "strain;stress\n%;psi\n1;2\n",
                "silicone.csv, line 2, column stress: has an unknown unit of stress; \
                 use MPa, kPa or Pa",
            ),
            (
                "strain;stress (kPa)\n%;MPa\n1;2\n",
                "silicone.csv, line 2, column stress (kPa): \
                 has another unit beneath its name than in it; correct one of the two",
            ),
        ]);
        let binary = TensileCurve::parse(Path::new("a.csv"), b"\x7FELF\x02\x01").unwrap_err();
        assert!(binary.to_string().contains("text file in UTF-8"));
        let missing = TensileCurve::read(Path::new("no such file.csv")).unwrap_err();
        assert!(missing.to_string().contains("check the path"));
    }

    #[test]
    fn a_row_is_refused_where_it_stands() {
        refuse(&[
            (
                "strain,stress_mpa\n0.1,0.2\n0.2,NaN\n",
                "silicone.csv, line 3, column stress_mpa: \
                 `NaN` is not a finite number; correct it or delete the line",
            ),
            (
                "strain,stress_mpa\n0.1,0.2\n\n,0.3\n",
                "silicone.csv, line 4, column strain: is empty; \
                 write numbers with a decimal point and no unit, or delete the row",
            ),
            (
                "strain;stress_mpa\n0.1;0,2\n",
                "silicone.csv, line 2, column stress_mpa: \
                 \"0,2\" has a comma, and numbers above have decimal points; \
                 write all numbers in one way, without separators between thousands",
            ),
            (
                "% pulled by hand\r\nstrain;stress_kpa\r\n\r\n1;2\r\n2;1,234\r\n",
                "silicone.csv, line 5, column stress_kpa: \
                 \"1,234\" may be 1.234 or 1234: nothing in the file tells which; \
                 write numbers with a decimal point, and without separators between thousands",
            ),
            (
                "Time (s);strain;stress_mpa\n1,234;1;2\n",
                "silicone.csv, line 2, column Time (s): \
                 \"1,234\" may be 1.234 or 1234: nothing in the file tells which; \
                 write numbers with a decimal point, and without separators between thousands",
            ),
            (
                "strain,stress_mpa\n0.1,0.2\nx,0.3\n",
                "silicone.csv, line 3, column strain: \
                 \"x\" is not a number; write numbers with a decimal point and no unit, or delete the row",
            ),
            (
                "strain,stress_mpa\n0.1,0.2\n0.3\n0.2,0.3\n",
                "silicone.csv, line 3: 1 field where the header names 2; \
                 correct the line or delete it",
            ),
            (
                "strain,stress_mpa\n0.1,0.2\n0.2",
                "silicone.csv, line 3: 1 field where the header names 2; \
                 the file ends in the middle of a line, so delete that line or export again",
            ),
        ]);
    }

    #[test]
    fn a_value_that_no_elastomer_has_is_refused() {
        refuse(&[
            (
                "strain,stress_mpa\n100,0.2\n",
                "silicone.csv, line 2, column strain: a strain of 100 looks like percent; \
                 name the column `strain (%)` or divide by 100",
            ),
            (
                "strain,stress_mpa\n0.1,20000\n",
                "silicone.csv, line 2, column stress_mpa: a true stress of 22000 MPa is beyond \
                 any elastomer, so the unit is probably wrong; correct the column's name",
            ),
            (
                "strain,stress_pa\n0.1,0.2\n",
                "silicone.csv, line 2, column stress_pa: the stress never exceeds 2.2e-7 MPa, \
                 so the unit is probably wrong; correct the column's name",
            ),
            (
                "true strain,stress_mpa\n5,0.2\n",
                "silicone.csv, line 2, column true strain: a true strain of 5 is beyond any \
                 elastomer; it may be percent or an engineering strain, so correct the column's name",
            ),
            (
                "strain,stress_mpa\n-1,0.2\n",
                "silicone.csv, line 2, column strain: a strain of -1 leaves no material; \
                 correct it or delete the line",
            ),
        ]);
    }

    proptest::proptest! {
        #[test]
        fn no_input_panics(bytes in proptest::collection::vec(proptest::num::u8::ANY, 0..300)) {
            let _ = TensileCurve::parse(Path::new("a.csv"), &bytes);
        }

        #[test]
        fn no_mangled_file_panics(cut in 0..400_usize, at in 0..400_usize, byte in 1..=255_u8) {
            let mut bytes = DATABASE.as_bytes().to_vec();
            bytes.truncate(cut);
            if let Some(place) = bytes.get_mut(at) {
                *place = byte;
            }
            if let Ok(curve) = TensileCurve::parse(Path::new("a.csv"), &bytes) {
                proptest::prop_assert!(!curve.samples.is_empty());
            }
        }
    }
}
