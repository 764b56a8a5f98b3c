//! Tables of text, whatever program wrote them.
//!
//! Spreadsheets, oscilloscopes and tensile testers all write different "CSV": commas, semicolons
//! or tabs, UTF-8, UTF-16 or Latin-1, comments and lines about the test above the header. All of
//! that can be recognised and needs no flag, once it is known which names the header has to have.
//! Recordings and tensile curves are read with [`Rows`] and [`Numbers`], so that both take the
//! same files, within limits, and name the same lines.

mod lines;
mod numbers;
mod prefix;
mod top;

use std::borrow::Cow;
use std::io::{Cursor, Read};
use std::path::Path;

use encoding_rs::{Encoding, UTF_16BE, UTF_16LE, WINDOWS_1252};
use encoding_rs_io::{DecodeReaderBytes, DecodeReaderBytesBuilder};

use crate::bounded::{self, Bounded, Limits};
use crate::error::InputError;
use lines::Lines;
pub(crate) use numbers::is_with_comma;
pub use numbers::{Numbers, seems_number};
use prefix::Unprefixed;
use top::Top;

/// Bytes that are looked at in one go for the header.
const PIECE: usize = 8192;

/// Bytes that tell UTF-16 from other text.
const START: u64 = 64;

/// What tells the header of a table from the lines above it.
#[derive(Clone, Copy)]
pub struct Wanted<'a> {
    /// Whether names are those of the header. It is asked for every delimiter, so that it also
    /// tells what separates the columns.
    pub names: &'a dyn Fn(&[String]) -> bool,
    /// How many lines about the table may be above its header, besides empty lines and comments.
    /// Where none of these lines has the wanted names, nor the one beneath them, the first line is
    /// the header, for the caller to refuse.
    pub lines_above: usize,
    /// How many lines at the start of the text are not looked at, whatever they hold.
    pub skipped: u64,
    /// Whether the table has no header: [`names`](Self::names) tells its first row, and the
    /// columns are called `#1`, `#2`, ….
    pub is_headless: bool,
}

/// The header of a table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Header {
    /// The names of the columns.
    pub names: Vec<String>,
    /// Its line, from 1.
    pub line: u64,
    /// The fields of the lines above it that are neither empty nor comments.
    pub above: Vec<Vec<String>>,
}

/// A row of a table.
#[derive(Clone, Debug, Default)]
pub struct Row {
    fields: csv::ByteRecord,
    line: u64,
}

impl Row {
    /// The line in the file, from 1, on which it begins.
    pub fn line(&self) -> u64 {
        self.line
    }

    /// Number of fields.
    pub fn width(&self) -> usize {
        self.fields.len()
    }

    /// Whether no field holds anything: spreadsheets pad tables with such rows.
    pub fn is_blank(&self) -> bool {
        self.fields.iter().all(<[u8]>::is_empty)
    }

    /// A field without the blanks around it; empty if the row ends before it.
    pub fn field(&self, column: usize) -> Cow<'_, str> {
        text_of(self.fields.get(column).unwrap_or_default())
    }
}

/// A field as text: UTF-8, or what Windows wrote before it. Numbers are the same in both.
fn text_of(field: &[u8]) -> Cow<'_, str> {
    if let Ok(text) = std::str::from_utf8(field) {
        return Cow::Borrowed(text.trim());
    }
    let (text, _) = WINDOWS_1252.decode_without_bom_handling(field);
    Cow::Owned(text.trim().to_owned())
}

/// Whether a text only begins as UTF-16 with a mark does, by what a board says while it starts: every
/// other byte of letters would be zero.
fn only_looks_marked(start: &[u8]) -> bool {
    let high = match start {
        [0xff, 0xfe, ..] => 1,
        [0xfe, 0xff, ..] => 0,
        _ => return false,
    };
    let units = start[2..].chunks_exact(2);
    let count = units.len();
    let letters = units.filter(|unit| unit[high] == 0).count();
    count > 4 && letters < count / 4
}

/// UTF-16 without a mark at its start: every other byte of its first letters is zero.
fn encoding_of(start: &[u8]) -> Option<&'static Encoding> {
    match start {
        [a, 0, b, 0, ..] if *a != 0 && *b != 0 => Some(UTF_16LE),
        [0, a, 0, b, ..] if *a != 0 && *b != 0 => Some(UTF_16BE),
        _ => None,
    }
}

type Decoded<R> = Unprefixed<DecodeReaderBytes<std::io::Chain<Cursor<Vec<u8>>, R>, Vec<u8>>>;

/// A text whose beginning was examined.
struct Begun<R: Read> {
    seen: Cursor<Vec<u8>>,
    rest: Bounded<Decoded<R>>,
    /// Where blanks separate: the byte before, so that several count as one.
    blanks: Option<u8>,
    lines: Lines,
}

impl<R: Read> Read for Begun<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        loop {
            let read = match self.seen.read(into)? {
                0 => self.rest.read(into)?,
                count => count,
            };
            let count = match &mut self.blanks {
                Some(before) => top::single_blanks(&mut into[..read], before),
                None => read,
            };
            if count > 0 || read == 0 {
                self.lines.take(&into[..count]);
                return Ok(count);
            }
        }
    }
}

/// The rows of a table, one after the other; the table is never held whole.
pub struct Rows<'a, R: Read> {
    reader: csv::Reader<Begun<R>>,
    path: &'a Path,
    limits: Limits,
    /// Lines above the first row that the reader sees.
    above: u64,
    count: u64,
}

impl<'a, R: Read> Rows<'a, R> {
    /// Finds the header, and what separates its columns; none if the text is empty, or all
    /// comments. `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Names file and line where the text cannot be read, is not text, or goes beyond `limits`.
    pub fn open(
        mut text: R,
        path: &'a Path,
        limits: Limits,
        wanted: Wanted<'_>,
    ) -> Result<Option<(Header, Self)>, InputError> {
        let fail = |error: std::io::Error| InputError::from_io(path, &error);
        let mut start = Vec::new();
        text.by_ref()
            .take(START)
            .read_to_end(&mut start)
            .map_err(fail)?;
        let decoded = DecodeReaderBytesBuilder::new()
            .encoding(encoding_of(&start))
            .utf8_passthru(true)
            .strip_bom(true)
            .bom_sniffing(!only_looks_marked(&start))
            .build_with_buffer(Cursor::new(start).chain(text), vec![0; PIECE])
            .map_err(fail)?;
        let mut bounded = Bounded::new(Unprefixed::new(decoded), limits);
        let mut top = Top::new(wanted);
        while !top.is_complete() {
            let mut piece = [0; PIECE];
            match bounded.read(&mut piece) {
                Ok(0) => top.end(),
                Ok(count) => top.take(&piece[..count]),
                Err(error) => {
                    return Err(match bounded.fault() {
                        Some(fault) => fault.in_file(path).at_line(top.last_line()),
                        None => fail(error),
                    });
                }
            }
        }
        let Some(found) = top.header() else {
            return Ok(None);
        };
        // A name may go over two lines.
        let is_odd = |c: char| c.is_control() && !c.is_ascii_whitespace();
        let mut names = found.header.names.iter();
        if names.any(|name| name.contains(is_odd)) {
            return Err(bounded::not_text(path).at_line(found.header.line));
        }
        let begun = Begun {
            seen: Cursor::new(top.seen_from(found.rows_at)),
            rest: bounded,
            blanks: (found.delimiter == top::BLANK).then_some(b'\n'),
            lines: Lines::after(found.lines_above_rows),
        };
        let rows = Self {
            reader: csv::ReaderBuilder::new()
                .delimiter(found.delimiter)
                .trim(csv::Trim::All)
                .flexible(true)
                .has_headers(false)
                .from_reader(begun),
            path,
            limits,
            above: found.lines_above_rows,
            count: 0,
        };
        Ok(Some((found.header, rows)))
    }

    /// Reads the next row; `false` at the end. Empty lines are not rows.
    ///
    /// # Errors
    ///
    /// Names file and line where the text cannot be read, or goes beyond the limits.
    pub fn next(&mut self, row: &mut Row) -> Result<bool, InputError> {
        match self.reader.read_byte_record(&mut row.fields) {
            Ok(true) => {}
            Ok(false) => return Ok(false),
            Err(error) => return Err(self.fault(error)),
        }
        let begun = self.reader.get_mut();
        begun.rest.found_row();
        let from = row.fields.position().map_or(0, csv::Position::byte);
        row.line = begun.lines.of_row(from);
        self.count += 1;
        self.limits
            .check(self.count, row.width().max(1))
            .map_err(|error| error.in_file(self.path).at_line(row.line))?;
        Ok(true)
    }

    /// Whether the text, as far as it was read, ends with a line: one that was cut off does not.
    pub fn end_with_line(&self) -> bool {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The header of a text in which columns `a` and `b` are wanted, and its rows with their
    /// lines.
    fn table(text: &str, lines_above: usize) -> Option<(Header, Vec<(u64, String)>)> {
        let wanted = Wanted {
            names: &|names| {
                ["a", "b"]
                    .iter()
                    .all(|it| names.iter().any(|name| name == it))
            },
            lines_above,
            skipped: 0,
            is_headless: false,
        };
        let path = Path::new("t.csv");
        let (header, mut rows) =
            Rows::open(text.as_bytes(), path, Limits::TABLE, wanted).unwrap()?;
        let mut row = Row::default();
        let mut read = Vec::new();
        while rows.next(&mut row).unwrap() {
            let fields: Vec<_> = (0..row.width()).map(|column| row.field(column)).collect();
            read.push((row.line(), fields.join("|")));
        }
        Some((header, read))
    }

    #[test]
    fn lines_about_the_table_stand_above_its_header() {
        let text = "Lab;Annecy\r\n\r\nWidth;3\" at \"A\"\r\n# by hand\r\na;b\r\n\r\n1;2\r\n";
        let (header, rows) = table(text, 2).unwrap();
        assert_eq!(header.names, ["a", "b"]);
        assert_eq!(header.line, 5);
        assert_eq!(header.above, [["Lab", "Annecy"], ["Width", "3\" at \"A\""]]);
        assert_eq!(rows, [(7, "1|2".to_owned())]);
        // Where the names do not come so soon, the first line is all there is to refuse.
        let (header, rows) = table(text, 1).unwrap();
        assert_eq!((header.names[0].as_str(), header.line), ("Lab", 1));
        assert_eq!(rows.len(), 4);
    }

    #[test]
    fn the_wanted_names_tell_the_delimiter() {
        for text in [
            "a\tb\tx,y,z,w\n1\t2\t3\n",
            "\n%a;b\n3;4\n",
            "\"a\" ,\"b\"\n1,\"2\n3\"\n",
        ] {
            let (header, rows) = table(text, 9).unwrap();
            assert!(header.names.iter().any(|name| name == "a"), "{header:?}");
            assert_eq!(rows.len(), 1, "{rows:?}");
        }
        assert_eq!(table("\n# a,b\n", 9), None);
    }
}
