//! Tables of text, with their encoding, delimiter and number format.
//!
//! Spreadsheets, oscilloscopes and scripts all write different "CSV": commas, semicolons or
//! tabs, decimal points or commas, UTF-8, UTF-16 or Latin-1, comments above the header, a row
//! of units beneath it. All of that can be recognised and needs no flag. Ambiguous files are
//! refused: `1,234` is 1.234 in one country and 1234 in another.

use std::borrow::Cow;
use std::io::{Cursor, Read};
use std::ops::Range;
use std::path::Path;

use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::{DecodeReaderBytes, DecodeReaderBytesBuilder};

use super::{LARGEST_NUMBER, Samples, names, not_usable, optional_name};
use crate::bounded::{self, Bounded, Limits};
use crate::columns::{Columns, Layout, Quantity, Unit};
use crate::error::InputError;
use crate::recording::Column;

/// The delimiters, the likeliest first where the header does not tell.
const DELIMITERS: [u8; 3] = [b'\t', b';', b','];

/// The characters that begin a comment above the header.
const COMMENTS: [char; 2] = ['#', '%'];

/// Bytes that are looked at in one go for the header.
const PIECE: usize = 8192;

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
    let mut rows = Rows::new(text, path, layout, limits)?;
    let header = std::mem::take(&mut rows.header);
    let places = names::find(&header, layout, "column")
        .map_err(|error| error.in_file(path).at_line(rows.header_line))?;
    let other: Vec<usize> = (0..header.len())
        .filter(|column| !places.contains(column))
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
    let mut record = csv::ByteRecord::new();
    let mut first = true;
    while let Some(line) = rows.next(&mut record)? {
        // What is known to stand elsewhere stays there.
        let place = |error: InputError| match error.line {
            Some(_) => error.in_file(path),
            None => error.in_file(path).at_line(line),
        };
        if record.len() != header.len() {
            let last = matches!(rows.next(&mut csv::ByteRecord::new()), Ok(None));
            return Err(place(wrong_length(record.len(), header.len(), last)));
        }
        let fields = places.map(|column| text_of(&record[column]));
        if std::mem::take(&mut first) {
            let said = units_row(&fields, layout).map_err(place)?;
            if let Some((said, remark)) = said {
                samples.columns = layout.columns.or(said);
                let path = path.display();
                samples
                    .warnings
                    .push(format!("{path}, line {line}: is a row of units: {remark}"));
                samples.check_units_in_names(layout).map_err(place)?;
                continue;
            }
            samples
                .check_units_in_names(layout)
                .map_err(|error| error.in_file(path).at_line(rows.header_line))?;
        }
        let mut row = [0.0; 3];
        for ((number, field), quantity) in row.iter_mut().zip(&fields).zip(Quantity::ALL) {
            let column = layout.names.of(quantity);
            *number = numbers.read(field, line, column).map_err(place)?;
            samples.decimals[quantity as usize].count(field);
        }
        if let Some((of, question)) = samples.push(row, layout).map_err(place)? {
            let (path, column) = (path.display(), layout.names.of(of));
            samples
                .warnings
                .push(format!("{path}, line {line}, column {column}: {question}"));
        }
        for (kept, &column) in samples.extra.iter_mut().zip(&other) {
            kept.fields.push(text_of(&record[column]).into_owned());
        }
    }
    numbers.check().map_err(|error| error.in_file(path))?;
    if numbers.sign == Some(Sign::Comma) {
        let fields = samples.extra.iter_mut().flat_map(|it| &mut it.fields);
        for field in fields.filter(|field| is_with_comma(field)) {
            *field = field.replace(',', ".");
        }
    }
    samples.forget_converted_decimals();
    samples
        .check_length()
        .map_err(|error| error.in_file(path))?;
    if !rows.end_with_line() {
        samples.warnings.push(format!(
            "{}: the last line has no line end; if the recording was cut off there, its last value may be wrong",
            path.display()
        ));
    }
    Ok(samples)
}

/// A field as text: UTF-8, or what Windows wrote before it. Numbers are the same in both.
fn text_of(field: &[u8]) -> Cow<'_, str> {
    if let Ok(text) = std::str::from_utf8(field) {
        return Cow::Borrowed(text.trim());
    }
    let (text, _) = WINDOWS_1252.decode_without_bom_handling(field);
    Cow::Owned(text.trim().to_owned())
}

/// UTF-16 without a mark at its start: every other byte of its first letters is zero.
fn encoding_of(start: &[u8]) -> Option<&'static Encoding> {
    match start {
        [a, 0, b, 0, ..] if *a != 0 && *b != 0 => Some(UTF_16LE),
        [0, a, 0, b, ..] if *a != 0 && *b != 0 => Some(UTF_16BE),
        _ => None,
    }
}

type Decoded<R> = DecodeReaderBytes<std::io::Chain<Cursor<Vec<u8>>, R>, Vec<u8>>;

/// A text of which the beginning was looked at.
struct Begun<R: Read> {
    seen: Cursor<Vec<u8>>,
    rest: Bounded<Decoded<R>>,
}

impl<R: Read> Read for Begun<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        match self.seen.read(into)? {
            0 => self.rest.read(into),
            count => Ok(count),
        }
    }
}

/// The rows of a table, one after the other.
struct Rows<'a, R: Read> {
    reader: csv::Reader<Begun<R>>,
    path: &'a Path,
    limits: Limits,
    header: Vec<String>,
    header_line: u64,
    /// Lines above the first row that the reader sees.
    above: u64,
    count: u64,
}

impl<'a, R: Read> Rows<'a, R> {
    /// Finds the header, and what separates its columns.
    fn new(
        mut text: R,
        path: &'a Path,
        layout: &Layout,
        limits: Limits,
    ) -> Result<Self, InputError> {
        let start =
            super::start_of(&mut text).map_err(|error| InputError::from_io(path, &error))?;
        let decoded = DecodeReaderBytesBuilder::new()
            .encoding(encoding_of(&start))
            .utf8_passthru(true)
            .strip_bom(true)
            .build_with_buffer(Cursor::new(start).chain(text), vec![0; PIECE])
            .map_err(|error| InputError::from_io(path, &error))?;
        let mut bounded = Bounded::new(decoded, limits);
        let mut top = Top::default();
        while !top.is_complete() {
            let mut piece = [0; PIECE];
            match bounded.read(&mut piece) {
                Ok(0) => top.ended = true,
                Ok(count) => top.take(&piece[..count]),
                Err(error) => {
                    let line = top.lines(top.seen.len()) + 1;
                    return Err(match bounded.fault() {
                        Some(fault) => fault.in_file(path).at_line(line),
                        None => InputError::from_io(path, &error),
                    });
                }
            }
        }
        let Some(header) = top.header(layout) else {
            return Err(InputError::new(
                "is empty",
                "record it again, or leave it out of the command",
            )
            .in_file(path));
        };
        // A name may go over two lines.
        let is_odd = |c: char| c.is_control() && !c.is_ascii_whitespace();
        if header.names.iter().any(|name| name.contains(is_odd)) {
            return Err(bounded::not_text(path).at_line(header.line));
        }
        let begun = Begun {
            seen: Cursor::new(top.seen.split_off(header.rows_at)),
            rest: bounded,
        };
        Ok(Self {
            reader: csv::ReaderBuilder::new()
                .delimiter(header.delimiter)
                .trim(csv::Trim::All)
                .flexible(true)
                .has_headers(false)
                .from_reader(begun),
            path,
            limits,
            header: header.names,
            header_line: header.line,
            above: header.above,
            count: 0,
        })
    }

    /// The line of the next row, which is read into `record`; none at the end.
    fn next(&mut self, record: &mut csv::ByteRecord) -> Result<Option<u64>, InputError> {
        match self.reader.read_byte_record(record) {
            Ok(true) => {}
            Ok(false) => return Ok(None),
            Err(error) => return Err(self.fault(error)),
        }
        self.reader.get_mut().rest.found_row();
        self.count += 1;
        let line = self.above + record.position().map_or(0, csv::Position::line);
        self.limits
            .check(self.count, record.len().max(1))
            .map_err(|error| error.in_file(self.path).at_line(line))?;
        Ok(Some(line))
    }

    fn end_with_line(&self) -> bool {
        self.reader.get_ref().rest.ends_with_line()
    }

    /// The cause of a failed read: a limit, the disk, or the text.
    fn fault(&self, error: csv::Error) -> InputError {
        let line = self.above + self.reader.position().line();
        if let Some(fault) = self.reader.get_ref().rest.fault() {
            return fault.in_file(self.path).at_line(line);
        }
        match error.into_kind() {
            csv::ErrorKind::Io(error) => InputError::from_io(self.path, &error),
            other => InputError::new(format!("is not a CSV table: {other:?}"), "export it again")
                .in_file(self.path)
                .at_line(line),
        }
    }
}

/// The top of a text, up to the first line that is neither empty nor a comment.
#[derive(Default)]
struct Top {
    seen: Vec<u8>,
    ended: bool,
    /// Where the line begins that is looked at.
    at: usize,
    /// Where the last comment stands.
    comment: Option<Range<usize>>,
    complete: bool,
}

/// The header of a table.
struct Header {
    names: Vec<String>,
    delimiter: u8,
    /// Its line, from 1.
    line: u64,
    /// Where the rows begin, and how many lines are above them.
    rows_at: usize,
    above: u64,
}

impl Top {
    fn take(&mut self, piece: &[u8]) {
        self.seen.extend_from_slice(piece);
    }

    /// The line ends before a place.
    fn lines(&self, before: usize) -> u64 {
        let lines = self.seen[..before].split(|&byte| byte == b'\n');
        lines.count() as u64 - 1
    }

    /// Where the line ends that begins at `self.at`, its line end included. A line end
    /// between quotes is none.
    fn line_end(&self) -> Option<usize> {
        let mut quoted = false;
        let mut bytes = (self.at..).zip(&self.seen[self.at..]).peekable();
        while let Some((at, byte)) = bytes.next() {
            match byte {
                b'"' => quoted = !quoted,
                b'\n' if !quoted => return Some(at + 1),
                b'\r' if !quoted => match bytes.peek() {
                    Some((_, b'\n')) => {}
                    Some(_) => return Some(at + 1),
                    None => break,
                },
                _ => {}
            }
        }
        self.ended.then_some(self.seen.len())
    }

    /// Goes on to the first line that is neither empty nor a comment.
    fn is_complete(&mut self) -> bool {
        while !self.complete {
            let Some(end) = self.line_end() else {
                return false;
            };
            let line = self.at..end;
            let text = String::from_utf8_lossy(&self.seen[line.clone()]);
            let text = text.trim();
            if !text.is_empty() && !text.starts_with(COMMENTS) {
                self.complete = true;
                break;
            }
            if !text.is_empty() {
                self.comment = Some(line);
            }
            self.at = end;
            self.complete = self.ended && end == self.seen.len();
        }
        true
    }

    /// The header, if there is one: the first line that is no comment. Where that holds
    /// numbers, it is the comment above, as numpy writes it.
    fn header(&self, layout: &Layout) -> Option<Header> {
        let end = self.line_end()?;
        let first = &self.seen[self.at..end];
        if first.iter().all(u8::is_ascii_whitespace) {
            return None;
        }
        if let Some(comment) = &self.comment {
            let text = &self.seen[comment.clone()];
            let is_mark = |byte: u8| byte.is_ascii_whitespace() || COMMENTS.contains(&byte.into());
            let start = text.iter().position(|&byte| !is_mark(byte));
            let (names, delimiter) = separated(&text[start.unwrap_or(0)..], layout);
            let row = split(first, delimiter);
            let has_names = has_all(&names, layout) && row.iter().any(|field| seems_number(field));
            let is_header = has_names || row.iter().all(|field| seems_number(field));
            if names.len() == row.len() && is_header {
                return Some(Header {
                    names,
                    delimiter,
                    line: self.lines(comment.start) + 1,
                    rows_at: self.at,
                    above: self.lines(self.at),
                });
            }
        }
        let (names, delimiter) = separated(first, layout);
        Some(Header {
            names,
            delimiter,
            line: self.lines(self.at) + 1,
            rows_at: end,
            above: self.lines(end),
        })
    }
}

/// Whether a field would be a number in one country or another.
fn seems_number(field: &str) -> bool {
    field.replace(',', ".").parse::<f64>().is_ok()
}

/// The names in a header, and what separates them: that between which the wanted names
/// stand. Where they do not stand there, what separates most will do to say so.
fn separated(header: &[u8], layout: &Layout) -> (Vec<String>, u8) {
    let splits = DELIMITERS.map(|delimiter| (split(header, delimiter), delimiter));
    let fits = splits.iter().position(|(names, _)| has_all(names, layout));
    let best = fits
        .or_else(|| splits.iter().position(|(names, _)| names.len() > 2))
        .or_else(|| splits.iter().position(|(names, _)| names.len() > 1))
        .unwrap_or(DELIMITERS.len() - 1);
    let [a, b, c] = splits;
    match best {
        0 => a,
        1 => b,
        _ => c,
    }
}

/// Whether all three wanted names are among those of a header.
fn has_all(names: &[String], layout: &Layout) -> bool {
    let wanted = Quantity::ALL.map(|quantity| layout.names.of(quantity));
    wanted.iter().all(|name| names.iter().any(|it| it == name))
}

/// The fields of one line.
fn split(line: &[u8], delimiter: u8) -> Vec<String> {
    let mut record = csv::ByteRecord::new();
    let mut reader = csv::ReaderBuilder::new()
        .delimiter(delimiter)
        .trim(csv::Trim::All)
        .has_headers(false)
        .from_reader(line);
    // One line in memory cannot fail.
    let _ = reader.read_byte_record(&mut record);
    record
        .iter()
        .map(|field| text_of(field).into_owned())
        .collect()
}

/// The units in a row beneath the header, with a sentence about them; none if the row is no
/// such row: if one of its fields is a number, or none of them a unit.
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
            (_, Some(unit)) => remarks.push(format!(
                "{} is read in {}, as you said",
                quantity.key(),
                unit.name()
            )),
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

/// The decimal sign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sign {
    Point,
    Comma,
}

/// How the numbers of a file are written, as far as those tell that were read.
#[derive(Debug, Default)]
struct Numbers {
    sign: Option<Sign>,
    /// The first number with a comma that may be one before decimals or between thousands:
    /// its line, its column and itself.
    doubt: Option<(u64, String, String)>,
}

impl Numbers {
    /// Reads a number; an error names the column, and the line if it is another.
    fn read(&mut self, field: &str, line: u64, column: &str) -> Result<f64, InputError> {
        self.number(field, line, column)
            .map_err(|error| match error.column {
                Some(_) => error,
                None => error.in_column(column),
            })
    }

    fn number(&mut self, field: &str, line: u64, column: &str) -> Result<f64, InputError> {
        let points = field.matches('.').count();
        let commas = field.matches(',').count();
        let sign = match (points, commas) {
            (0, 0) => None,
            (1, 0) => Some(Sign::Point),
            (0, 1) if is_with_comma(field) => {
                if is_ambiguous(field) {
                    if self.sign.is_none() && self.doubt.is_none() {
                        self.doubt = Some((line, column.to_owned(), field.to_owned()));
                    }
                    None
                } else {
                    Some(Sign::Comma)
                }
            }
            (_, 0) => return number(field),
            _ => {
                return Err(InputError::new(
                    format!(
                        "\"{field}\" is not a number that is sure: thousands may be separated in it"
                    ),
                    "write numbers without separators between thousands",
                ));
            }
        };
        if let Some(sign) = sign {
            if *self.sign.get_or_insert(sign) != sign {
                return Err(Self::mixed(field));
            }
            if sign == Sign::Point && self.doubt.is_some() {
                return self.check().map(|()| f64::NAN);
            }
        }
        if commas == 1 {
            if self.sign == Some(Sign::Point) {
                return Err(Self::mixed(field));
            }
            return number(&field.replace(',', "."));
        }
        number(field)
    }

    fn mixed(field: &str) -> InputError {
        let (this, other) = if field.contains(',') {
            ("comma", "points")
        } else {
            ("point", "commas")
        };
        InputError::new(
            format!("\"{field}\" has a {this}, and numbers above have decimal {other}"),
            "write all numbers in one way, without separators between thousands",
        )
    }

    /// Refuses a file in which nothing told what a comma means.
    fn check(&self) -> Result<(), InputError> {
        match &self.doubt {
            Some((line, column, field)) if self.sign != Some(Sign::Comma) => Err(InputError::new(
                format!(
                    "\"{field}\" may be {} or {}: nothing in the file tells which",
                    field.replace(',', "."),
                    field.replace(',', "")
                ),
                "write numbers with a decimal point, and without separators between thousands",
            )
            .at_line(*line)
            .in_column(column.clone())),
            _ => Ok(()),
        }
    }
}

/// Whether a text is a number with one comma in place of a decimal point.
fn is_with_comma(field: &str) -> bool {
    field.matches(',').count() == 1
        && !field.contains('.')
        && field.bytes().any(|byte| byte.is_ascii_digit())
        && field.replace(',', ".").parse::<f64>().is_ok()
}

/// Whether the comma in a number may be one between thousands: three digits behind it and
/// up to three before it, the first of them no zero.
fn is_ambiguous(field: &str) -> bool {
    let Some((before, behind)) = field.split_once(',') else {
        return false;
    };
    let before = before.trim_start_matches(['+', '-']);
    (1..=3).contains(&before.len())
        && !before.starts_with('0')
        && behind.len() == 3
        && behind.bytes().all(|byte| byte.is_ascii_digit())
}

fn number(field: &str) -> Result<f64, InputError> {
    match field.parse::<f64>() {
        Ok(value) if value.abs() <= LARGEST_NUMBER => Ok(value),
        Ok(_) => Err(not_usable(field)),
        Err(_) => Err(InputError::new(
            if field.is_empty() {
                "is empty".to_owned()
            } else {
                format!("\"{field}\" is not a number")
            },
            "write numbers with a decimal point and no unit, or delete the row",
        )),
    }
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

    #[test]
    fn latin_1_is_read_where_it_is_no_utf_8() {
        let layout = Layout {
            names: Names::parse("time=Zeit,pressure=Druck,angle=Winkel [\u{b0}]").unwrap(),
            columns: Columns::default(),
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
            columns: Columns::default(),
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
            columns: Columns::default(),
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
