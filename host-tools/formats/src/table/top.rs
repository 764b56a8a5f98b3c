//! The top of a table: finds the header, and what separates its columns.

use std::ops::Range;

use super::lines::ends_in;
use super::{Header, Wanted, seems_number, text_of};

/// Any number of blanks: what numpy's `savetxt` and Fortran write.
pub(super) const BLANK: u8 = b' ';

/// The delimiters, the likeliest first where the header does not tell.
const DELIMITERS: [u8; 4] = [b'\t', b';', b',', BLANK];

/// Leaves one of several blanks, and none at the start of a line; `before` is the byte before.
/// Returns how many bytes are left.
pub(super) fn single_blanks(bytes: &mut [u8], before: &mut u8) -> usize {
    let mut left = 0;
    for at in 0..bytes.len() {
        let byte = bytes[at];
        if byte != BLANK || !matches!(*before, BLANK | b'\n' | b'\r') {
            bytes[left] = byte;
            left += 1;
        }
        *before = byte;
    }
    left
}

/// The characters that begin a comment above the header.
const COMMENTS: [char; 2] = ['#', '%'];

/// The top of a text, as far as it was looked through for the header.
pub(super) struct Top<'a> {
    wanted: Wanted<'a>,
    seen: Vec<u8>,
    ended: bool,
    /// Where the line begins that is looked at.
    at: usize,
    /// How many lines are before it.
    passed: u64,
    /// Where the last comment above the first line is.
    comment: Option<Range<usize>>,
    /// Lines that are neither empty nor comments.
    lines: Vec<Range<usize>>,
    /// Which of them has the wanted names.
    named: Option<usize>,
    complete: bool,
}

/// A header, and where its rows are.
pub(super) struct Found {
    pub(super) header: Header,
    pub(super) delimiter: u8,
    /// Where the rows begin, and how many lines are above them.
    pub(super) rows_at: usize,
    pub(super) lines_above_rows: u64,
}

impl<'a> Top<'a> {
    pub(super) fn new(wanted: Wanted<'a>) -> Self {
        Self {
            wanted,
            seen: Vec::new(),
            ended: false,
            at: 0,
            passed: 0,
            comment: None,
            lines: Vec::new(),
            named: None,
            complete: false,
        }
    }

    /// Takes more of the text.
    pub(super) fn take(&mut self, piece: &[u8]) {
        self.seen.extend_from_slice(piece);
    }

    /// There is no more of it.
    pub(super) fn end(&mut self) {
        self.ended = true;
    }

    /// What was taken, from a place on.
    pub(super) fn seen_from(mut self, place: usize) -> Vec<u8> {
        self.seen.split_off(place)
    }

    /// The line that was taken last, from 1.
    pub(super) fn last_line(&self) -> u64 {
        self.lines_before(self.seen.len()) + 1
    }

    /// The line ends before a place.
    fn lines_before(&self, place: usize) -> u64 {
        ends_in(&self.seen[..place])
    }

    /// Where the line ends that begins at `self.at`, its line end included. A line end between
    /// quotes does not count; a quote within a field is a sign for inches.
    fn line_end(&self) -> Option<usize> {
        let mut quoted = false;
        let mut begins = true;
        let mut bytes = (self.at..).zip(&self.seen[self.at..]).peekable();
        while let Some((at, byte)) = bytes.next() {
            match byte {
                b'"' => quoted = !quoted && begins,
                b'\n' if !quoted => return Some(at + 1),
                b'\r' if !quoted => match bytes.peek() {
                    Some((_, b'\n')) => {}
                    Some(_) => return Some(at + 1),
                    None => break,
                },
                _ => {}
            }
            // After a blank, too, it means inches.
            begins = *byte != BLANK && DELIMITERS.contains(byte);
        }
        self.ended.then_some(self.seen.len())
    }

    /// Goes on to the header: the first line that is neither empty nor a comment, or one with
    /// the wanted names a few lines beneath.
    pub(super) fn is_complete(&mut self) -> bool {
        while !self.complete {
            let Some(end) = self.line_end() else {
                return false;
            };
            let line = self.at..end;
            let text = String::from_utf8_lossy(&self.seen[line.clone()]);
            let text = text.trim();
            let is_skipped = self.passed < self.wanted.skipped;
            if is_skipped || text.is_empty() {
            } else if text.starts_with(COMMENTS) {
                if self.lines.is_empty() {
                    self.comment = Some(line);
                }
            } else {
                let (names, _) = self.separated(&self.seen[line.clone()]);
                if (self.wanted.names)(&names) {
                    self.named = Some(self.lines.len());
                }
                self.lines.push(line);
                let looked_at = self.lines.len() > self.wanted.lines_above;
                self.complete = self.named.is_some() || looked_at;
            }
            self.at = end;
            self.passed += 1;
            self.complete |= self.ended && end == self.seen.len();
        }
        true
    }

    /// The header, if there is one. Where the first line that is no comment holds numbers, it
    /// is the comment above, as numpy writes it.
    pub(super) fn header(&self) -> Option<Found> {
        let first = self.lines.first()?;
        if let (true, Some(place)) = (self.wanted.is_headless, self.named) {
            return Some(self.headless(&self.lines[place]));
        }
        let place = self.named.unwrap_or_else(|| self.likely());
        if place == 0
            && let Some(found) = self.header_in_comment(first)
        {
            return Some(found);
        }
        let line = &self.lines[place];
        let (names, delimiter) = self.separated(&self.seen[line.clone()]);
        let above = self.lines[..place].iter();
        Some(Found {
            header: Header {
                names,
                line: self.lines_before(line.start) + 1,
                above: above
                    .map(|line| split(&self.seen[line.clone()], delimiter))
                    .collect(),
            },
            delimiter,
            rows_at: line.end,
            lines_above_rows: self.lines_before(line.end),
        })
    }

    /// What looks most like a header where none has the wanted names: the first line of names
    /// with numbers beneath, perhaps behind a row of units; else the first line.
    fn likely(&self) -> usize {
        let is_header = |place: &usize| {
            let (names, delimiter) = self.separated(&self.seen[self.lines[*place].clone()]);
            let are_names =
                names.len() > 1 && names.iter().filter(|it| seems_number(it)).count() == 0;
            let mut beneath = self.lines[place + 1..].iter().take(2);
            are_names
                && beneath.any(|line| {
                    let row = split(&self.seen[line.clone()], delimiter);
                    // The comment at the end of LabVIEW's rows is left out.
                    let width = row.len()..=row.len() + 1;
                    width.contains(&names.len()) && row.iter().all(|field| seems_number(field))
                })
        };
        (0..self.lines.len()).find(is_header).unwrap_or_default()
    }

    /// A table that begins with its first row.
    fn headless(&self, first: &Range<usize>) -> Found {
        let (row, delimiter) = self.separated(&self.seen[first.clone()]);
        Found {
            header: Header {
                names: (1..=row.len()).map(|number| format!("#{number}")).collect(),
                line: self.lines_before(first.start) + 1,
                above: Vec::new(),
            },
            delimiter,
            rows_at: first.start,
            lines_above_rows: self.lines_before(first.start),
        }
    }

    /// The header in the comment above the first line, if there is one.
    fn header_in_comment(&self, first: &Range<usize>) -> Option<Found> {
        let comment = self.comment.as_ref()?;
        let text = &self.seen[comment.clone()];
        let is_mark = |byte: u8| byte.is_ascii_whitespace() || COMMENTS.contains(&byte.into());
        let start = text.iter().position(|&byte| !is_mark(byte));
        let (names, delimiter) = self.separated(&text[start.unwrap_or(0)..]);
        let row = split(&self.seen[first.clone()], delimiter);
        let has_names = (self.wanted.names)(&names) && row.iter().any(|field| seems_number(field));
        let is_header = has_names || row.iter().all(|field| seems_number(field));
        if names.len() != row.len() || !is_header {
            return None;
        }
        Some(Found {
            header: Header {
                names,
                line: self.lines_before(comment.start) + 1,
                above: Vec::new(),
            },
            delimiter,
            rows_at: first.start,
            lines_above_rows: self.lines_before(first.start),
        })
    }

    /// The names in a header, and what separates them: the delimiter between the wanted names.
    /// Where they are not there, the one that separates most will do to say so.
    fn separated(&self, header: &[u8]) -> (Vec<String>, u8) {
        let splits = DELIMITERS.map(|delimiter| (split(header, delimiter), delimiter));
        let fits = splits
            .iter()
            .position(|(names, _)| (self.wanted.names)(names));
        // Names have blanks and commas in them, rarely tabs and semicolons.
        let clear = splits[..2].iter().position(|(names, _)| names.len() > 1);
        let best = fits
            .or(clear)
            .or_else(|| splits.iter().position(|(names, _)| names.len() > 2))
            .or_else(|| splits.iter().position(|(names, _)| names.len() > 1))
            .unwrap_or(DELIMITERS.len() - 2);
        splits.into_iter().nth(best).unwrap_or_default()
    }
}

/// The fields of one line.
fn split(line: &[u8], delimiter: u8) -> Vec<String> {
    let mut blanks = line.to_vec();
    let line = if delimiter == BLANK {
        let count = single_blanks(&mut blanks, &mut b'\n');
        blanks[..count].trim_ascii_end()
    } else {
        line
    };
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
