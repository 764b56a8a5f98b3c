//! Tensile curves from files.
//!
//! Tensile tests come as exports of many machines. Two layouts are read: that of
//! the Soft Robotics Materials Database (a dozen lines about the test, then a
//! line that starts with `Time (s)`, separated by semicolons) and a plain table
//! whose first line names its columns. Anything else is refused with the file, the
//! line and the column, since a misread curve would still give an exponent.
//!
//! | column | accepted names |
//! |---|---|
//! | strain | `strain`, `engineering strain`, `true strain`; with `%` or `percent` for percent |
//! | stress | `stress`, `engineering stress`, `true stress`, with `MPa`, `kPa`, `Pa` or `N/mm2` |
//! | time | `time`; checked, not used |
//!
//! Case, spaces and punctuation in a name do not matter; a name without a
//! measure means engineering. A missing measure is derived, with ε the
//! engineering strain: true strain = ln(1 + ε), true stress = (1 + ε) ·
//! engineering stress.

use std::path::{Path, PathBuf};

use softrig_formats::error::InputError;
use strum::{Display, EnumMessage, EnumString, IntoStaticStr, VariantArray};

/// A stress or strain measure.
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
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

fn plural(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
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

#[derive(Clone, Copy, Debug, PartialEq)]
enum Meaning {
    Strain { measure: Measure, scale: f64 },
    Stress { measure: Measure, scale: f64 },
    Time,
}

/// What is wrong, and what to do.
type Fault = (&'static str, &'static str);

/// Understands the name of a column; `None` for a column that is not needed,
/// an error for one that looks needed but cannot be used.
fn meaning(name: &str) -> Result<Option<Meaning>, Fault> {
    let plain: String = name
        .to_lowercase()
        .replace('%', "percent")
        .replace('²', "2")
        .chars()
        .filter(|c| c.is_alphanumeric())
        .collect();
    if plain.starts_with("time") {
        return Ok(Some(Meaning::Time));
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
        let scale = match unit {
            "" | "1" | "mmmm" => 1.0,
            "percent" | "pct" => 0.01,
            "rate" | "rate1s" => return Ok(None),
            _ => {
                return Err((
                    "has an unknown unit of strain",
                    "use a fraction, or `strain (%)`",
                ));
            }
        };
        return Ok(Some(Meaning::Strain { measure, scale }));
    }
    if let Some(unit) = rest.strip_prefix("stress") {
        let scale = match unit {
            "mpa" | "nmm2" => 1.0,
            "kpa" => 1e-3,
            "pa" => 1e-6,
            "" => {
                return Err((
                    "has no unit",
                    "name it `stress_mpa`, `stress_kpa` or `stress_pa`",
                ));
            }
            _ => return Err(("has an unknown unit of stress", "use MPa, kPa or Pa")),
        };
        return Ok(Some(Meaning::Stress { measure, scale }));
    }
    Ok(None)
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
    fn of(path: &Path, line: u64, header: &csv::StringRecord) -> Result<Self, InputError> {
        let bad = |column: &str, (found, advice): Fault| {
            InputError::new(found, advice)
                .in_file(path)
                .at_line(line)
                .in_column(column)
        };
        let mut columns = Self {
            names: header.iter().map(str::to_owned).collect(),
            ..Self::default()
        };
        for (index, name) in header.iter().enumerate() {
            let Some(meaning) = meaning(name).map_err(|fault| bad(name, fault))? else {
                continue;
            };
            let (slot, scale) = match meaning {
                Meaning::Strain { measure, scale } => match measure {
                    Measure::Engineering => (&mut columns.engineering_strain, scale),
                    Measure::True => (&mut columns.true_strain, scale),
                },
                Meaning::Stress { measure, scale } => match measure {
                    Measure::Engineering => (&mut columns.engineering_stress, scale),
                    Measure::True => (&mut columns.true_stress, scale),
                },
                Meaning::Time => (&mut columns.time, 1.0),
            };
            if slot.is_some() {
                return Err(bad(
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
            .at_line(line)
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
        if bytes.contains(&0)
            || bytes.starts_with(&[0xFF, 0xFE])
            || bytes.starts_with(&[0xFE, 0xFF])
        {
            return Err(InputError::new(
                "is not a text file in UTF-8",
                "export the test again as CSV in UTF-8",
            )
            .in_file(path));
        }
        // A stray byte in a comment about the test does no harm, and in a number
        // it is refused where it stands.
        let text = String::from_utf8_lossy(bytes);
        let text = text.trim_start_matches('\u{feff}');
        let head = Head::find(path, text)?;

        let mut reader = csv::ReaderBuilder::new()
            .delimiter(head.delimiter)
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(head.table.as_bytes());
        let mut lines = Lines::new(head.table, head.lines_before);
        let mut records = Vec::new();
        for record in reader.records() {
            // Reading from memory, valid UTF-8 and any number of fields leave
            // the reader nothing to refuse.
            let record = record.map_err(|error| InputError::from_io(path, &error.into()))?;
            let line = lines.of(record.position().map_or(0, csv::Position::byte));
            records.push((line, record));
        }
        let mut records = records.into_iter();
        let Some((line, header)) = records.next() else {
            return Err(InputError::new("is empty", "export the test again").in_file(path));
        };
        let columns = Columns::of(path, line, &header)?;
        let rows: Vec<(u64, csv::StringRecord)> = records
            // Spreadsheets pad tables with lines of separators.
            .filter(|(_, record)| record.iter().any(|field| !field.is_empty()))
            .collect();
        let reader = Rows {
            path,
            columns: &columns,
        };
        let last = rows.len().saturating_sub(1);
        let mut curve = Self {
            path: path.to_owned(),
            material: head.material.unwrap_or_else(|| {
                path.file_stem()
                    .map(|stem| stem.to_string_lossy().into_owned())
                    .unwrap_or_default()
            }),
            samples: Vec::with_capacity(rows.len()),
            notes: Vec::new(),
        };
        let mut peak: f64 = 0.0;
        for (index, (line, record)) in rows.iter().enumerate() {
            let sample = reader.sample(*line, record, index == last)?;
            peak = peak.max(sample.true_stress_mpa.abs());
            curve.samples.push(sample);
        }
        if curve.samples.is_empty() {
            return Err(InputError::new(
                "names columns but holds no sample",
                "export the test again",
            )
            .in_file(path));
        }
        if peak < SMALLEST_PEAK_MPA {
            let column = columns.engineering_stress.or(columns.true_stress);
            return Err(InputError::new(
                format!("the stress never exceeds {peak:.1e} MPa, so the unit is probably wrong"),
                "correct the column's name",
            )
            .in_file(path)
            .at_line(rows[last].0)
            .in_column(column.map(|column| column.name).unwrap_or_default()));
        }
        reader.note_time(&rows, &mut curve.notes);
        note_measures(&rows, &curve.samples, &mut curve.notes);
        Ok(curve)
    }

    /// The largest strain.
    pub fn largest_strain(&self, measure: Measure) -> f64 {
        self.samples
            .iter()
            .map(|sample| sample.strain(measure))
            .fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Numbers the lines of records.
///
/// The CSV reader counts from the end of the previous record, so that blank
/// lines would shift every number after them by one.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    line: u64,
}

impl<'a> Lines<'a> {
    fn new(table: &'a str, lines_before: u64) -> Self {
        Self {
            bytes: table.as_bytes(),
            at: 0,
            line: lines_before + 1,
        }
    }

    /// The line of the record that begins at or after an offset; offsets must
    /// not decrease.
    fn of(&mut self, offset: u64) -> u64 {
        let offset = usize::try_from(offset).unwrap_or(usize::MAX);
        while let Some(byte) = self.bytes.get(self.at)
            && (self.at < offset || matches!(byte, b'\n' | b'\r'))
        {
            self.line += u64::from(*byte == b'\n');
            self.at += 1;
        }
        self.line
    }
}

/// Where the table starts in a file.
struct Head<'a> {
    table: &'a str,
    lines_before: u64,
    delimiter: u8,
    material: Option<String>,
}

impl<'a> Head<'a> {
    fn find(path: &Path, text: &'a str) -> Result<Self, InputError> {
        let mut before = 0;
        let mut material = None;
        let mut rest = text;
        while !rest.is_empty() {
            let line = rest.lines().next().unwrap_or_default();
            if line.starts_with("Time (s)") && line.contains(';') {
                return Ok(Self {
                    table: rest,
                    lines_before: before,
                    delimiter: b';',
                    material,
                });
            }
            if let Some(value) = line.strip_prefix("Material;") {
                let value = value.split(';').next().unwrap_or_default().trim();
                material = (!value.is_empty()).then(|| value.to_owned());
            }
            before += 1;
            rest = rest.split_once('\n').map_or("", |(_, after)| after);
        }
        if text.starts_with("PARAMETER;") {
            return Err(InputError::new(
                "describes a test but no line starts with `Time (s)`",
                "the samples were cut off, fetch the file again",
            )
            .in_file(path));
        }
        // A plain table: the first line that is neither empty nor a comment.
        let mut before = 0;
        let mut rest = text;
        while !rest.is_empty() {
            let line = rest.lines().next().unwrap_or_default().trim();
            if !line.is_empty() && !line.starts_with('#') {
                let count = |delimiter: &u8| line.bytes().filter(|b| b == delimiter).count();
                return Ok(Self {
                    table: rest,
                    lines_before: before,
                    delimiter: *[b',', b';', b'\t']
                        .iter()
                        .max_by_key(|delimiter| count(delimiter))
                        .unwrap_or(&b','),
                    material: None,
                });
            }
            before += 1;
            rest = rest.split_once('\n').map_or("", |(_, after)| after);
        }
        Err(InputError::new("is empty", "export the test again").in_file(path))
    }
}

struct Rows<'a> {
    path: &'a Path,
    columns: &'a Columns,
}

impl Rows<'_> {
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

    fn number(
        &self,
        line: u64,
        record: &csv::StringRecord,
        column: Option<&Column>,
    ) -> Result<Option<f64>, InputError> {
        let Some(column) = column else {
            return Ok(None);
        };
        let field = record.get(column.index).unwrap_or_default();
        if field.is_empty() {
            return Err(self.bad(line, column, "is empty", "fill it in or delete the line"));
        }
        match field.parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Some(value * column.scale)),
            Ok(_) => Err(self.bad(
                line,
                column,
                format!("`{field}` is not a finite number"),
                "correct it or delete the line",
            )),
            Err(_) if field.contains(',') && field.replacen(',', ".", 1).parse::<f64>().is_ok() => {
                Err(self.bad(
                    line,
                    column,
                    format!("`{field}` has a decimal comma"),
                    "export with decimal points",
                ))
            }
            Err(_) => Err(self.bad(
                line,
                column,
                format!("`{field}` is not a number"),
                "correct it or delete the line",
            )),
        }
    }

    fn sample(
        &self,
        line: u64,
        record: &csv::StringRecord,
        is_last: bool,
    ) -> Result<Sample, InputError> {
        let columns = self.columns;
        if record.len() != columns.names.len() {
            let advice = if is_last && record.len() < columns.names.len() {
                "the file ends in the middle of a line, so delete that line or export again"
            } else {
                "correct the line or delete it"
            };
            return Err(InputError::new(
                format!(
                    "{} where the header names {}",
                    plural(record.len(), "field"),
                    columns.names.len()
                ),
                advice,
            )
            .in_file(self.path)
            .at_line(line));
        }
        let given = |column: &Option<Column>| self.number(line, record, column.as_ref());
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

    /// Says if time runs backwards, as in five files of the database.
    fn note_time(&self, rows: &[(u64, csv::StringRecord)], notes: &mut Vec<String>) {
        let Some(column) = &self.columns.time else {
            return;
        };
        let mut previous: Option<f64> = None;
        for (line, record) in rows {
            let time = record
                .get(column.index)
                .and_then(|field| field.parse::<f64>().ok());
            if let (Some(before), Some(now)) = (previous, time)
                && now < before
            {
                notes.push(format!(
                    "time runs backwards at line {line} ({before} s, then {now} s); the fit does \
                     not use it"
                ));
                return;
            }
            previous = time;
        }
    }
}

/// Says if the two measures of the file contradict each other.
fn note_measures(rows: &[(u64, csv::StringRecord)], samples: &[Sample], notes: &mut Vec<String>) {
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
        rows.iter()
            .zip(samples)
            .filter(|(_, sample)| is_faulty(sample))
            .map(|((line, _), _)| *line)
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

    #[test]
    fn oddities_of_the_database_are_noted() {
        let text = format!("{DATABASE}0.1;0.2623643;-0.039;0.3;0.03\n");
        let notes = parse(&text).unwrap().notes;
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert!(notes[0].starts_with("time runs backwards at line 8 (0.3 s, then 0.1 s)"));
        assert!(notes[1].contains("stress disagree on 1 of 3 lines, first on line 8"));
    }

    #[test]
    fn every_refusal_says_where_and_what_to_do() {
        for (text, expected) in [
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
                "strain,stress_mpa\n0.1,0.2\n0.2,NaN\n",
                "silicone.csv, line 3, column stress_mpa: \
                 `NaN` is not a finite number; correct it or delete the line",
            ),
            (
                "strain,stress_mpa\n0.1,0.2\n\n,0.3\n",
                "silicone.csv, line 4, column strain: is empty; fill it in or delete the line",
            ),
            (
                "strain;stress_mpa\n0.1;0,2\n",
                "silicone.csv, line 2, column stress_mpa: \
                 `0,2` has a decimal comma; export with decimal points",
            ),
            (
                "strain,stress_mpa\n0.1,0.2\nx,0.3\n",
                "silicone.csv, line 3, column strain: \
                 `x` is not a number; correct it or delete the line",
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
        ] {
            assert_eq!(message(text), expected, "for {text:?}");
        }
        let binary = TensileCurve::parse(Path::new("a.csv"), b"\xFF\xFEs\0t\0").unwrap_err();
        assert!(binary.to_string().contains("not a text file in UTF-8"));
        let missing = TensileCurve::read(Path::new("no such file.csv")).unwrap_err();
        assert!(missing.to_string().contains("check the path"));
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
