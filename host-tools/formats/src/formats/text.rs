//! Recordings in tables of text.
//!
//! What is special about a recording in such a table: its three columns by their names, a row
//! of units beneath them, other columns that are kept as text, and an end that may have been cut
//! off. Everything else is that of any [`table`](crate::table).

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use super::bad_lines::BadLines;
use super::{Decimals, LARGEST_NUMBER, Samples, names, not_usable, optional_name, stamps};
use crate::bounded::Limits;
use crate::columns::{Columns, Layout, Quantity, ROW, TimeUnit, Unit, is_made, position};
use crate::error::InputError;
use crate::recording::Column;
use crate::table::{Header, Numbers, Row, Rows, Wanted, is_with_comma, seems_number};

/// Reads a table, as far as `limits` allow; it is never held whole.
///
/// # Errors
///
/// Names file, line, column and remedy for anything that is not a recording.
pub fn read(
    text: impl Read,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let Some((header, mut rows)) = open(text, path, layout, limits)? else {
        return Err(InputError::new(
            "is empty",
            "record it again, or leave it out of the command",
        )
        .in_file(path));
    };
    let header_line = header.line;
    let mut header = header.names;
    let mut beside = BesideEachOther::of(&mut header, layout);
    let places = names::find(&header, layout, "column")
        .map_err(|error| error.in_file(path).at_line(header_line))?;
    let other: Vec<usize> = (0..header.len())
        .filter(|column| !places.contains(column) && !beside.has(*column))
        .collect();
    let mut samples = Samples {
        extra: other
            .iter()
            .map(|&column| Column {
                name: optional_name(&header[column], layout),
                fields: Vec::new(),
            })
            .collect(),
        columns: layout.columns,
        ..Samples::default()
    };
    let mut numbers = Numbers::default();
    let mut record = Row::default();
    let mut first = true;
    // LabVIEW leaves the comment at the end of its rows away.
    let is_lvm = header.first().is_some_and(|name| name == "X_Value")
        && header.last().is_some_and(|name| name == "Comment");
    let mut bad = BadLines::default();
    let mut short = ShortRows::default();
    while rows.next(&mut record)? {
        let line = record.line();
        // An error with a line of its own keeps its place.
        let place = |error: InputError| match error.line {
            Some(_) => error.in_file(path),
            None => error.in_file(path).at_line(line),
        };
        if !samples.is_empty() && is_header_again(&record, &header) {
            bad.headers.push(line);
            continue;
        }
        let is_without_comment = is_lvm && record.width() + 1 == header.len();
        let goes_on = short.goes_on(record.width(), header.len(), places);
        if record.width() != header.len() && !is_without_comment && !goes_on {
            let of = |last| place(wrong_length(record.width(), header.len(), last));
            bad.take(line, of(false));
            bad.at_end = Some(of(true));
            continue;
        }
        bad.at_end = None;
        let fields = places.map(|column| record.field(column));
        if std::mem::take(&mut first)
            && samples.is_row_of_units(&fields, layout, path, [header_line, line])?
        {
            continue;
        }
        let made = places.map(|place| place >= header.len());
        beside.take(&record, &mut numbers, &samples.columns)?;
        if beside.is_over(&fields) {
            continue;
        }
        let row = match samples.numbers_in(&fields, made, &mut numbers, line, layout) {
            Ok(row) => row,
            Err(error) if (0..3).any(|at| !made[at] && is_no_number(&fields[at])) => {
                bad.take(line, place(error));
                continue;
            }
            Err(error) => return Err(place(error)),
        };
        if let Some((of, question)) = samples.push(row) {
            let (path, column) = (path.display(), layout.names.of(of));
            samples
                .warnings
                .push(format!("{path}, line {line}, column {column}: {question}"));
        }
        samples.lines.push(samples.len() - 1, line);
        for (kept, &column) in samples.extra.iter_mut().zip(&other) {
            kept.fields.push(record.field(column).into_owned());
        }
    }
    bad.finish(&mut samples, path, layout)?;
    beside.append(&mut samples, path);
    if !is_lvm {
        short.say(&mut samples, path);
    }
    numbers.check().map_err(|error| error.in_file(path))?;
    if numbers.have_commas() {
        samples.write_points();
    }
    samples.forget_converted_decimals();
    samples
        .finish(path, layout, InputError::at_line)
        .map_err(|error| error.in_file(path))?;
    if !rows.end_with_line() {
        samples.warnings.push(not_ended(path));
    }
    Ok(samples)
}

/// Finds the header of a recording in a table.
fn open<'a, R: Read>(
    text: R,
    path: &'a Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Option<(Header, Rows<'a, R>)>, InputError> {
    let wanted = Wanted {
        names: &|names| has_all(names, layout),
        // What is skipped is said to end above the header.
        lines_above: if layout.skip_rows.is_some() {
            0
        } else {
            LINES_ABOVE
        },
        skipped: layout.skip_rows.unwrap_or_default(),
        is_headless: layout.names.are_positions(),
    };
    Rows::open(text, path, limits, wanted)
}

impl Samples {
    /// Takes the units of the first row, if it is one of units; the lines are those of the header
    /// and of the row.
    fn is_row_of_units(
        &mut self,
        fields: &[Cow<'_, str>; 3],
        layout: &Layout,
        path: &Path,
        [header, line]: [u64; 2],
    ) -> Result<bool, InputError> {
        let at = |line: u64| move |error: InputError| error.in_file(path).at_line(line);
        let Some((said, remark)) = units_row(fields, layout).map_err(at(line))? else {
            self.check_units_in_names(layout).map_err(at(header))?;
            return Ok(false);
        };
        self.columns = layout.columns.or(said);
        self.warnings.push(format!(
            "{}, line {line}: is a row of units: {remark}",
            path.display()
        ));
        self.check_units_in_names(layout).map_err(at(line))?;
        Ok(true)
    }

    /// Writes the numbers of optional columns with decimal points.
    fn write_points(&mut self) {
        let fields = self.extra.iter_mut().flat_map(|it| &mut it.fields);
        for field in fields.filter(|field| is_with_comma(field)) {
            *field = field.replace(',', ".");
        }
    }

    /// The three numbers in the fields of a row.
    fn numbers_in(
        &mut self,
        fields: &[Cow<'_, str>; 3],
        made: [bool; 3],
        numbers: &mut Numbers,
        line: u64,
        layout: &Layout,
    ) -> Result<[f64; 3], InputError> {
        let mut row = [0.0; 3];
        let count = self.rows as f64;
        self.rows += 1;
        for ((number, field), quantity) in row.iter_mut().zip(fields).zip(Quantity::ALL) {
            let column = layout.names.of(quantity);
            if made[quantity as usize] {
                *number = if column == ROW { count } else { 0.0 };
                self.decimals[quantity as usize] = Decimals::Various;
                continue;
            }
            let stamp = match quantity {
                Quantity::Time => stamps::read(field),
                _ => None,
            };
            *number = match stamp {
                Some(stamp) => {
                    self.columns.time = Some(TimeUnit::S);
                    self.is_time_of_day |= stamp.is_of_day;
                    stamp.seconds
                }
                None if quantity == Quantity::Time && stamps::is_like_one(field) => {
                    return Err(stamps::no_form(field).in_column(column));
                }
                None => numbers.read(field, line, column)?,
            };
            if number.is_nan() || number.abs() > LARGEST_NUMBER {
                return Err(not_usable(field).in_column(column));
            }
            self.decimals[quantity as usize].count(field);
        }
        Ok(row)
    }
}

/// Says that the last line has no end.
fn not_ended(path: &Path) -> String {
    format!(
        "{}: the last line has no line end; if the recording was cut off there, its last value may be wrong",
        path.display()
    )
}

/// Consecutive rows that lack columns which are not wanted: they are not damaged.
#[derive(Default)]
struct ShortRows {
    /// The width of the row before.
    width: usize,
    count: u64,
}

impl ShortRows {
    /// Whether a row is as short as the one before it, and has what is wanted.
    fn goes_on(&mut self, width: usize, full: usize, places: [usize; 3]) -> bool {
        let has_wanted = places.iter().all(|place| *place < width || *place >= full);
        let goes_on = width < full && has_wanted && self.width == width;
        self.width = width;
        self.count += u64::from(goes_on);
        goes_on
    }

    fn say(&self, samples: &mut Samples, path: &Path) {
        if self.count > 0 {
            samples.warnings.push(format!(
                "{}: {} rows have fewer fields than the header; what is wanted is in them",
                path.display(),
                self.count
            ));
        }
    }
}

/// Runs side by side, with the same names above each.
#[derive(Default)]
struct BesideEachOther {
    /// Where time, pressure and angle of the second run are, and of those that follow.
    places: Vec<[usize; 3]>,
    /// Their samples (s, kPa, °), with their lines.
    runs: Vec<Vec<(u64, [f64; 3])>>,
}

impl BesideEachOther {
    /// Finds them, and gives their columns other names than those of the first run.
    fn of(header: &mut [String], layout: &Layout) -> Self {
        let all = Quantity::ALL.map(|quantity| {
            let name = layout.names.of(quantity);
            let found = (0..header.len()).filter(|at| header[*at] == name);
            found.collect::<Vec<usize>>()
        });
        let count = all[0].len();
        if count < 2 || all.iter().any(|found| found.len() != count) {
            return Self::default();
        }
        for found in &all {
            for (number, at) in found.iter().enumerate().skip(1) {
                header[*at] += &format!(" ({})", number + 1);
            }
        }
        Self {
            places: (1..count)
                .map(|run| [0, 1, 2].map(|at: usize| all[at][run]))
                .collect(),
            runs: vec![Vec::new(); count - 1],
        }
    }

    /// Takes what a row has of them. A run that is over has empty fields, and a field that is no
    /// number is none.
    fn take(
        &mut self,
        record: &Row,
        numbers: &mut Numbers,
        columns: &Columns,
    ) -> Result<(), InputError> {
        for (places, run) in self.places.iter().zip(&mut self.runs) {
            let fields = places.map(|place| record.field(place));
            if fields.iter().any(|field| is_no_number(field)) {
                continue;
            }
            let mut row = [0.0; 3];
            for (number, field) in row.iter_mut().zip(&fields) {
                *number = numbers.read(field, record.line(), "")?;
            }
            run.push((record.line(), columns.read(row)));
        }
        Ok(())
    }

    /// Whether a column is of one of them.
    fn has(&self, column: usize) -> bool {
        self.places.iter().flatten().any(|place| *place == column)
    }

    /// Whether the first run is over, and another goes on.
    fn is_over(&self, fields: &[Cow<'_, str>; 3]) -> bool {
        !self.places.is_empty() && fields.iter().all(|field| field.is_empty())
    }

    /// Puts them behind the first run.
    fn append(self, samples: &mut Samples, path: &Path) {
        let count = self.runs.len() + 1;
        for run in self.runs {
            for (line, [time, pressure, angle]) in run {
                samples.time_s.push(time);
                samples.pressure_kpa.push(pressure);
                samples.angle_deg.push(angle);
                samples.lines.push(samples.time_s.len() - 1, line);
                for column in &mut samples.extra {
                    column.fields.push(String::new());
                }
            }
        }
        if count > 1 {
            samples.warnings.push(format!(
                "{}: {count} runs stand side by side, and are read one after the other",
                path.display()
            ));
        }
    }
}

fn is_header_again(row: &Row, header: &[String]) -> bool {
    row.width() == header.len()
        && header
            .iter()
            .enumerate()
            .all(|(at, name)| row.field(at) == name.as_str())
}

/// Whether a field is not a number in any notation: a number that is written differently from the
/// rest is not damage.
fn is_no_number(field: &str) -> bool {
    if let Ok(number) = field.replace(',', ".").parse::<f64>() {
        return number.is_nan() || number.abs() > LARGEST_NUMBER;
    }
    let is_of_number = |c: char| c.is_ascii_digit() || "+-.,".contains(c);
    let is_dialect = field.contains(',') && field.chars().all(is_of_number);
    !(is_dialect || stamps::is_like_one(field))
}

/// Most lines above the header: those of LabVIEW and of loggers are some dozens.
const LINES_ABOVE: usize = 200;

/// Whether all three wanted names are among those of a header; of a table without one, whether
/// all three are numbers in a row.
fn has_all(names: &[String], layout: &Layout) -> bool {
    if layout.names.are_positions() {
        return Quantity::ALL.into_iter().all(|quantity| {
            if is_made(layout.names.of(quantity)) {
                return true;
            }
            let place = position(layout.names.of(quantity));
            let field = place.and_then(|place| names.get(place));
            field.is_some_and(|field| {
                seems_number(field) || (quantity == Quantity::Time && stamps::read(field).is_some())
            })
        });
    }
    let wanted = Quantity::ALL.map(|quantity| layout.names.of(quantity));
    let is_there = |name: &&str| names.iter().any(|it| it == name) || is_made(name);
    wanted.iter().all(is_there)
}

/// The units in a row beneath the header, with a sentence about them; none if it is not such a row:
/// if one of its fields is a number, or none of them a unit.
fn units_row(
    fields: &[Cow<'_, str>; 3],
    layout: &Layout,
) -> Result<Option<(Columns, String)>, InputError> {
    let units: [Option<Unit>; 3] =
        std::array::from_fn(|at| Unit::of(Quantity::ALL[at], &fields[at]));
    let has_number = fields.iter().any(|field| seems_number(field));
    if has_number || units.iter().all(Option::is_none) {
        return Ok(None);
    }
    let mut said = Columns::default();
    let mut remarks = Vec::new();
    for ((quantity, unit), field) in Quantity::ALL.into_iter().zip(units).zip(fields) {
        let by_user = layout.columns.unit(quantity);
        let bare = field.trim_matches(['[', ']', '(', ')', '-', ' ']);
        match (unit, by_user) {
            (written, Some(unit)) => {
                let other = written.filter(|written| *written != unit);
                let although = other.map_or_else(String::new, |written| {
                    format!(", although this row says {}", written.name())
                });
                remarks.push(format!(
                    "{} is read in {}, as you said{although}",
                    quantity.key(),
                    unit.name()
                ));
            }
            (Some(unit), None) => {
                said.set(unit);
                remarks.push(format!("{} in {}", quantity.key(), unit.name()));
            }
            (None, None) if bare.is_empty() => {}
            (None, None) => {
                return Err(InputError::new(
                    format!(
                        "is a row of units, and \"{field}\" is no unit of {} that is known: {}",
                        quantity.key(),
                        quantity.units()
                    ),
                    format!(
                        "say in which unit it is with --units {}=UNIT, or convert the column",
                        quantity.key()
                    ),
                )
                .in_column(layout.names.of(quantity)));
            }
        }
    }
    Ok(Some((said, remarks.join(", "))))
}

/// A row with another number of fields than the header.
fn wrong_length(found: usize, expected: usize, last: bool) -> InputError {
    let advice = if last && found < expected {
        "the recording was cut off while it was written: delete this line to use the rest"
    } else {
        "give every row as many fields as the header has"
    };
    InputError::new(format!("has {found} of {expected} fields"), advice)
        .in_column((found.min(expected) + 1).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::columns::Names;
    use crate::left_out::What;
    use proptest::prelude::*;

    fn read_as(bytes: &[u8], layout: &Layout) -> Result<Samples, InputError> {
        read(bytes, Path::new("lab.csv"), layout, Limits::RECORDING)
    }

    fn refused(text: &str) -> String {
        let error = read_as(text.as_bytes(), &Layout::default()).unwrap_err();
        error.to_string()
    }

    fn numbers(samples: &Samples) -> Vec<[f64; 3]> {
        (0..samples.len())
            .map(|row| {
                [
                    samples.time_s[row],
                    samples.pressure_kpa[row],
                    samples.angle_deg[row],
                ]
            })
            .collect()
    }

    const EXPECTED: [[f64; 3]; 2] = [[0.0, 1.5, -30.25], [0.01, 1.25, 7.0]];

    fn utf16(text: &str, bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
        text.encode_utf16().flat_map(bytes).collect()
    }

    /// The same two samples, as ten programs write them.
    #[test]
    fn dialects_are_read_without_a_flag() {
        let plain = "time_s,pressure_kpa,angle_deg,note\n0.00,1.5,-30.25,a\n0.01,1.25,7,b\n";
        let german = "time_s;pressure_kpa;angle_deg;note\n0,00;1,5;-30,25;a\n0,01;1,25;7;b\n";
        let files: [(&str, Vec<u8>); 14] = [
            ("plain", plain.into()),
            ("tabs", plain.replace(',', "\t").into()),
            ("semicolons", plain.replace(',', ";").into()),
            ("decimal commas", german.into()),
            ("tabs and commas", german.replace(';', "\t").into()),
            ("quoted commas", "\"time_s\",\"pressure_kpa\",\"angle_deg\",\"note\"\n\"0,00\",\"1,5\",\"-30,25\",a\n\"0,01\",\"1,25\",7,b\n".into()),
            ("UTF-8 with a mark", format!("\u{feff}{plain}").into()),
            ("UTF-16LE", utf16(&format!("\u{feff}{german}"), u16::to_le_bytes)),
            ("UTF-16BE", utf16(&format!("\u{feff}{plain}"), u16::to_be_bytes)),
            ("UTF-16LE without a mark", utf16(plain, u16::to_le_bytes)),
            ("UTF-16BE without a mark", utf16(plain, u16::to_be_bytes)),
            ("comments", format!("# rig 3, Monday\n%\n\n{plain}").into()),
            ("numpy", format!("# of numpy\n# {plain}").into()),
            ("Windows line ends", plain.replace('\n', "\r\n").into()),
        ];
        for (name, bytes) in files {
            let samples = read_as(&bytes, &Layout::default())
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(numbers(&samples), EXPECTED, "{name}");
            assert_eq!(samples.extra[0].fields, ["a", "b"], "{name}");
            assert_eq!(samples.warnings, Vec::<String>::new(), "{name}");
        }
    }

    /// A log as a terminal program keeps it: a banner, a torn line, garbage, a reset.
    #[test]
    fn logs_of_boards_are_read_and_bad_lines_are_counted() {
        let row = |k: u32| format!("{},{}.5,{}", 20 * k, k % 7, k % 90);
        let mut lines: Vec<String> = (0..400).map(row).collect();
        lines[100] = "\u{fffd}\u{fffd}30,1,2".into();
        lines[150] = "1.5,2".into();
        for (place, line) in [(200, "time_s,pressure_kpa,angle_deg"), (200, "sensor ok")] {
            lines.insert(place, line.into());
        }
        let head = "logger v0.3 (off)\nsensor init ... OK\ntime_s,pressure_kpa,angle_deg\n";
        for (prefix, end) in [("", "\n"), ("14:02:00.000 -> ", "\r\n"), ("", "\r")] {
            let whole: Vec<String> = head
                .lines()
                .map(str::to_owned)
                .chain(lines.clone())
                .map(|line| format!("{prefix}{line}{end}"))
                .collect();
            let text = whole.concat();
            let layout = Layout::from(Columns::of_units("time=ms").unwrap());
            let samples = read_as(text.as_bytes(), &layout).unwrap();
            assert_eq!(samples.len(), 398, "{prefix:?} {end:?}");
            let said: Vec<(What, usize, &str)> = samples
                .left_out
                .iter()
                .map(|it| (it.what, it.count, it.places[0].as_str()))
                .collect();
            assert_eq!(
                said,
                [
                    (What::BadLine, 3, "line 104"),
                    (What::RepeatedHeader, 1, "line 205")
                ]
            );
            assert_eq!(samples.lines.place(198), "line 206");
            let strict = Layout {
                strict: true,
                ..layout
            };
            let said = read_as(text.as_bytes(), &strict).unwrap_err().to_string();
            assert!(
                said.contains("line 104") && said.contains("2 more"),
                "{said}"
            );
        }
        let mostly = "time_s,pressure_kpa,angle_deg\n0,1,2\nx,1,2\n1,1,2\n2,1,2\n";
        assert!(refused(mostly).contains("line 3"));
    }

    #[test]
    fn scales_rows_and_missing_inputs_are_said() {
        let layout = |columns: &str, units: &str| Layout {
            names: Names::parse(columns).unwrap(),
            ..Layout::from(Columns::of_units(units).unwrap())
        };
        let free = layout("time=t / s,pressure=none,angle=&b_A1 / rad", "angle=rad");
        let samples = read_as(b"t / s\t&b_A1 / rad\n0,0\t-2,5\n0,1\t1,0\n", &free).unwrap();
        assert_eq!(samples.pressure_kpa, [0.0, 0.0]);
        assert!((samples.angle_deg[1] - 57.295_78).abs() < 1e-4);
        let mut rows = layout("time=#0,pressure=#2,angle=#3", "time=s*50");
        rows.columns = rows
            .columns
            .or(Columns::of_scale("pressure=100:0,600:50").unwrap());
        let samples = read_as(b"1 , 100 , 3\n1 , 200 , 4\n1 , 350 , 5\n", &rows).unwrap();
        assert_eq!(samples.time_s, [0.0, 0.02, 0.04]);
        assert_eq!(samples.pressure_kpa, [0.0, 10.0, 25.0]);
        let text = b"t,p * 100,a\n0,200,1\n1,300,2\n";
        let named = |units: &str| layout("time=t,pressure=p * 100,angle=a", units);
        let said = read_as(text, &named("time=s")).unwrap_err().to_string();
        assert!(said.contains("--units pressure=kpa*100"), "{said}");
        let samples = read_as(text, &named("pressure=bar*100")).unwrap();
        assert_eq!(samples.pressure_kpa, [200.0, 300.0]);
        let again = crate::model_file::recording_layout(&rows.to_toml(), Path::new("m.toml"));
        let in_a_file = Layout {
            of_a_file: true,
            ..rows
        };
        assert_eq!(again.unwrap(), in_a_file);
    }

    #[test]
    fn runs_side_by_side_are_read_one_after_the_other() {
        let mut text = "time_s,pressure_kpa,angle_deg,time_s,pressure_kpa,angle_deg\n".to_owned();
        for k in 0..40 {
            let first = if k < 30 {
                format!("{k},1,{k}")
            } else {
                ",,".into()
            };
            text += &format!("{first},{k},2,{}\n", 100 + k);
        }
        let samples = read_as(text.as_bytes(), &Layout::default()).unwrap();
        assert_eq!(samples.len(), 70);
        assert_eq!(samples.breaks, [30]);
        assert_eq!(samples.pressure_kpa[29..31], [1.0, 2.0]);
        assert_eq!(samples.lines.place(30), "line 2");
        assert!(
            samples.warnings[0].contains("2 runs"),
            "{:?}",
            samples.warnings
        );
    }

    #[test]
    fn what_a_board_says_while_it_starts_is_no_utf_16() {
        let text = b"\xff\xfe\x00rst:0x1\r\nSD card online\r\ntime_s,pressure_kpa,angle_deg\r\n0,1,2\r\n1,1,2\r\n";
        assert_eq!(read_as(text, &Layout::default()).unwrap().len(), 2);
    }

    #[test]
    fn latin_1_is_read_where_it_is_no_utf_8() {
        let layout = Layout {
            names: Names::parse("time=Zeit,pressure=Druck,angle=Winkel [\u{b0}]").unwrap(),
            ..Layout::default()
        };
        let bytes = b"Zeit;Druck;Winkel [\xb0];Pr\xfcfer\n0,5;1;2;J\xfcrgen\n0,75;1;2;J\xfcrgen\n";
        let samples = read_as(bytes, &layout).unwrap();
        assert_eq!(samples.extra[0].name, "Pr\u{fc}fer");
        assert_eq!(samples.extra[0].fields[1], "J\u{fc}rgen");
        assert_eq!(samples.time_s, [0.5, 0.75]);
    }

    #[test]
    fn a_row_of_units_counts_where_no_flag_does() {
        for units in ["ms,bar,rad", "[ms],[bar],[rad]", "(ms),(bar),(rad)"] {
            let text = format!("time_s,pressure_kpa,angle_deg\n{units}\n0,1,1\n500,2,-1\n");
            let samples = read_as(text.as_bytes(), &Layout::default()).unwrap();
            assert_eq!(samples.time_s, [0.0, 0.5]);
            assert_eq!(samples.pressure_kpa, [100.0, 200.0]);
            assert!((samples.angle_deg[1] + 57.295_78).abs() < 1e-5);
            assert_eq!(
                samples.warnings,
                ["lab.csv, line 2: is a row of units: time in ms, pressure in bar, angle in rad"]
            );
            let layout = Layout::from(Columns::of_units("pressure=psi").unwrap());
            let samples = read_as(text.as_bytes(), &layout).unwrap();
            assert!((samples.pressure_kpa[0] - 6.894_757).abs() < 1e-9);
            assert!(samples.warnings[0].contains("pressure is read in psi, as you said"));
        }
        let said = refused("time_s,pressure_kpa,angle_deg\ns,V,deg\n0,1,1\n1,2,2\n");
        assert!(
            said.contains("lab.csv, line 2, column pressure_kpa")
                && said.contains("--units pressure=UNIT"),
            "{said}"
        );
        let said = refused("time_s,pressure_kpa,angle_deg\nx,y,z\n0,1,1\n1,2,2\n");
        assert!(
            said.contains("line 2, column time_s: \"x\" is not a number"),
            "{said}"
        );
    }

    #[test]
    fn lines_are_those_of_the_file() {
        let said = refused("# a\n\n# b\ntime_s;pressure_kpa;angle_deg\ns;kPa;deg\n0;1;1\n1;x;1\n");
        assert!(
            said.starts_with("lab.csv, line 7, column pressure_kpa"),
            "{said}"
        );
        let said = refused("# a\n# b\nt;p;theta\n0;1;1\n1;1;1\n");
        assert!(said.starts_with("lab.csv, line 3, column time_s"), "{said}");
        assert!(
            said.contains("--columns time=t,pressure=p,angle=theta"),
            "{said}"
        );
    }

    #[test]
    fn blank_lines_and_windows_line_ends_shift_no_line() {
        let table = "time_s,pressure_kpa,angle_deg\n\n0,1,1\n\n\n1,x,1\n";
        for text in [table.to_owned(), table.replace('\n', "\r\n")] {
            let said = refused(&text);
            assert!(
                said.starts_with("lab.csv, line 6, column pressure_kpa"),
                "{text:?}: {said}"
            );
        }
    }

    /// A number is never read as a thousand times another.
    #[test]
    fn commas_that_may_mean_two_things_are_refused() {
        let table = |rows: &str| format!("time_s;pressure_kpa;angle_deg\n{rows}");
        for (rows, place, part) in [
            // Nothing tells.
            (
                "0;1,234;5\n1;2,345;6\n",
                "line 2, column pressure_kpa",
                "may be 1.234 or 1234",
            ),
            // A point elsewhere tells that commas are none before decimals.
            (
                "0;1,234;5\n1;2;6.5\n",
                "line 2, column pressure_kpa",
                "may be 1.234 or 1234",
            ),
            (
                "0;1;6.5\n1;1,234;6.5\n",
                "line 3, column pressure_kpa",
                "has a comma",
            ),
            (
                "0;1,5;5\n1;1.5;6\n",
                "line 3, column pressure_kpa",
                "has a point",
            ),
            ("0;1,234.5;5\n", "line 2, column pressure_kpa", "thousands"),
            ("0;1.234,5;5\n", "line 2, column pressure_kpa", "thousands"),
            (
                "0;1,234,567;5\n",
                "line 2, column pressure_kpa",
                "thousands",
            ),
        ] {
            let said = refused(&table(rows));
            assert!(
                said.contains(place) && said.contains(part),
                "{rows}: {said}"
            );
        }
        // One number that can only have decimals tells of all.
        for rows in ["0;1,234;5\n1;2,345;6,5\n", "0,001;1,234;5\n1,001;2,345;6\n"] {
            let samples = read_as(table(rows).as_bytes(), &Layout::default()).unwrap();
            assert_eq!(samples.pressure_kpa, [1.234, 2.345]);
        }
    }

    #[test]
    fn a_column_whose_name_has_another_unit_needs_to_be_told() {
        let text = "t,p_psi,theta\n0,1,2\n1,1,2\n";
        let mut layout = Layout {
            names: Names::parse("time=t,pressure=p_psi,angle=theta").unwrap(),
            ..Layout::default()
        };
        let said = read_as(text.as_bytes(), &layout).unwrap_err().to_string();
        assert!(
            said.contains("line 1, column p_psi") && said.contains("--units pressure=psi"),
            "{said}"
        );
        layout.columns = Columns::of_units("pressure=psi").unwrap();
        let samples = read_as(text.as_bytes(), &layout).unwrap();
        assert!((samples.pressure_kpa[0] - 6.894_757).abs() < 1e-9);
    }

    #[test]
    fn optional_columns_keep_what_they_hold_and_take_their_names() {
        let layout = Layout {
            names: Names::parse("setpoint_deg=soll").unwrap(),
            ..Layout::default()
        };
        let text = "time_s;pressure_kpa;angle_deg;soll;note\n0,0;1;2;60,5;a, b\n0,5;1;2;;1,2,3\n";
        let samples = read_as(text.as_bytes(), &layout).unwrap();
        assert_eq!(samples.extra[0].name, "setpoint_deg");
        assert_eq!(samples.extra[0].fields, ["60.5", ""]);
        assert_eq!(samples.extra[1].fields, ["a, b", "1,2,3"]);
    }

    #[test]
    fn what_is_no_text_is_no_table() {
        for bytes in [
            &b"\xff\xd8\xff\xe0\x00\x10JFIF\x00\x01"[..],
            b"\x7fELF\x02\x01\x01\x00\x00",
        ] {
            let said = read_as(bytes, &Layout::default()).unwrap_err().to_string();
            assert!(said.contains("UTF-8"), "{said}");
        }
        for text in ["", "\n\n", "# only\n# comments", "\u{feff}"] {
            assert!(refused(text).contains("is empty"), "{text:?}");
        }
    }

    proptest! {
        #[allow(clippy::float_cmp)] // To the bit is the point.
        /// However a table is written, the numbers in it are the same or it is refused.
        #[test]
        fn a_dialect_never_changes_a_number(
            rows in prop::collection::vec((-999.0..999.0f64, -999.0..999.0f64), 2..12),
            decimals in 0..6usize,
            delimiter in prop::sample::select(vec![',', ';', '\t']),
            comma in any::<bool>(),
        ) {
            let shown = |number: f64| {
                let text = format!("{number:.decimals$}");
                if comma { format!("\"{}\"", text.replace('.', ",")) } else { text }
            };
            let mut text = format!("time_s{delimiter}pressure_kpa{delimiter}angle_deg\n");
            for (row, (pressure, angle)) in rows.iter().enumerate() {
                text += &format!("{row}{delimiter}{}{delimiter}{}\n", shown(*pressure), shown(*angle));
            }
            match read_as(text.as_bytes(), &Layout::default()) {
                Ok(samples) => for (row, (pressure, angle)) in rows.iter().enumerate() {
                    let expected: f64 = format!("{pressure:.decimals$}").parse().unwrap();
                    prop_assert_eq!(samples.pressure_kpa[row], expected);
                    let expected: f64 = format!("{angle:.decimals$}").parse().unwrap();
                    prop_assert_eq!(samples.angle_deg[row], expected);
                },
                Err(error) => {
                    prop_assert!(comma && decimals == 3, "{}", error);
                }
            }
        }
    }
}
