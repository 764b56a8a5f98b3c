//! Spreadsheets of Excel (`.xlsx`): the first sheet that holds a recording.
//!
//! A sheet becomes a table of text, which is read like any other: its header is found below what
//! stands above it, units beneath it count. Dates are written out, so that no day is taken for a
//! second.

use std::io::Cursor;
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

use calamine::{Data, Range, Reader, Xlsx};

use crate::guard::guarded;
use softrig_formats::bounded::{Limits, too_large};
use softrig_formats::columns::Layout;
use softrig_formats::error::InputError;
use softrig_formats::formats::{Samples, damaged, read_bytes};

/// Days from Excel's day 0 to 1970.
const DAY_OF_1970: f64 = 25_569.0;
const DAY_S: f64 = 86_400.0;

/// Reads a spreadsheet.
///
/// # Errors
///
/// Names the file and what is wrong with the first sheet that holds anything.
pub(crate) fn read(
    bytes: Vec<u8>,
    path: &Path,
    layout: &Layout,
    limits: Limits,
) -> Result<Samples, InputError> {
    let sheets = guarded(|| {
        let mut book = Xlsx::new(Cursor::new(bytes))?;
        let names = book.sheet_names();
        let mut sheets = Vec::new();
        for name in names {
            sheets.push(book.worksheet_range(&name)?);
        }
        Ok(sheets)
    });
    let sheets = sheets
        .map_err(|said| damaged(path, "Excel", &said))?
        .map_err(|error: calamine::XlsxError| damaged(path, "Excel", &error))?;
    let mut first = None;
    for sheet in sheets.iter().filter(|sheet| !sheet.is_empty()) {
        limits
            .check(sheet.height() as u64, sheet.width())
            .map_err(|error| error.in_file(path))?;
        let text = table(sheet);
        if text.len() as u64 > limits.bytes {
            return Err(too_large(limits.bytes).in_file(path));
        }
        match read_bytes(text.as_bytes(), Path::new("sheet.tsv"), layout) {
            Ok(mut samples) => {
                for warning in &mut samples.warnings {
                    *warning = warning.replace("sheet.tsv", &path.display().to_string());
                }
                for left_out in &mut samples.left_out {
                    left_out.file = path.display().to_string();
                }
                return Ok(samples);
            }
            Err(error) => {
                first.get_or_insert(error.in_file(path));
            }
        }
    }
    Err(first.unwrap_or_else(|| {
        InputError::new("has no sheet with anything in it", "save it again").in_file(path)
    }))
}

/// A sheet as a table with tabs, in the rows of the sheet.
fn table(sheet: &Range<Data>) -> String {
    let above = sheet.start().map_or(0, |(row, _)| row as usize);
    let mut text = "\n".repeat(above);
    for row in sheet.rows() {
        let cells: Vec<String> = row.iter().map(shown).collect();
        // What was formatted and never filled is no column.
        let width = cells
            .iter()
            .rposition(|cell| !cell.is_empty())
            .map_or(0, |at| at + 1);
        text += &cells[..width].join("\t");
        text.push('\n');
    }
    text
}

/// A cell as text.
fn shown(cell: &Data) -> String {
    match cell {
        Data::Empty | Data::Error(_) => String::new(),
        Data::Float(number) => format!("{number}"),
        Data::Int(number) => number.to_string(),
        Data::Bool(it) => u8::from(*it).to_string(),
        Data::DateTime(date) => {
            let days = date.as_f64();
            if date.is_duration() || days < 1.0 {
                return duration(days);
            }
            let since = (days - DAY_OF_1970) * DAY_S;
            match Duration::try_from_secs_f64((since * 1e6).round() / 1e6) {
                Ok(since) => humantime::format_rfc3339_micros(UNIX_EPOCH + since).to_string(),
                Err(_) => format!("{days}"),
            }
        }
        Data::String(text) | Data::DateTimeIso(text) | Data::DurationIso(text) => {
            text.replace(['\t', '\n', '\r', '"'], " ").trim().to_owned()
        }
    }
}

/// A duration of so many days, or a time of the day.
fn duration(days: f64) -> String {
    let whole = days.floor();
    let seconds = ((days - whole) * DAY_S * 1e6).round() / 1e6;
    let (hours, rest) = ((seconds / 3600.0).floor(), seconds.rem_euclid(3600.0));
    let (minutes, seconds) = ((rest / 60.0).floor(), rest.rem_euclid(60.0));
    format!("{whole} days {hours:02}:{minutes:02}:{seconds:09.6}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write as _;

    /// A book with one sheet, as programs write it.
    fn book(rows: &str) -> Vec<u8> {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let sheet = format!(
            "<?xml version=\"1.0\"?><worksheet xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\"><sheetData>{rows}</sheetData></worksheet>"
        );
        for (name, text) in [
            ("[Content_Types].xml", "<?xml version=\"1.0\"?><Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\"><Default Extension=\"xml\" ContentType=\"application/xml\"/></Types>".to_owned()),
            ("_rels/.rels", "<?xml version=\"1.0\"?><Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Id=\"rId1\" Type=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships/officeDocument\" Target=\"xl/workbook.xml\"/></Relationships>".to_owned()),
            ("xl/workbook.xml", "<?xml version=\"1.0\"?><workbook xmlns=\"http://schemas.openxmlformats.org/spreadsheetml/2006/main\" xmlns:r=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships\"><sheets><sheet name=\"S\" sheetId=\"1\" r:id=\"rId1\"/></sheets></workbook>".to_owned()),
            ("xl/_rels/workbook.xml.rels", "<?xml version=\"1.0\"?><Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\"><Relationship Id=\"rId1\" Type=\"http://schemas.openxmlformats.org/officeDocument/2006/relationships/worksheet\" Target=\"worksheets/sheet1.xml\"/></Relationships>".to_owned()),
            ("xl/worksheets/sheet1.xml", sheet),
        ] {
            zip.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
            zip.write_all(text.as_bytes()).unwrap();
        }
        zip.finish().unwrap().into_inner()
    }

    #[test]
    fn the_first_sheet_with_a_recording_is_read() {
        let text = |cells: &[&str]| -> String {
            let cells: Vec<String> = cells
                .iter()
                .map(|cell| match cell.parse::<f64>() {
                    Ok(_) => format!("<c><v>{cell}</v></c>"),
                    Err(_) => format!("<c t=\"inlineStr\"><is><t>{cell}</t></is></c>"),
                })
                .collect();
            format!("<row>{}</row>", cells.concat())
        };
        let rows = [
            text(&["Rig 3, Monday"]),
            text(&["time_s", "pressure_kpa", "angle_deg"]),
            text(&["0", "1.5", "2"]),
            text(&["0.5", "2.5", "3"]),
        ];
        let path = Path::new("lab.xlsx");
        let samples = crate::read_bytes(&book(&rows.concat()), path, &Layout::default()).unwrap();
        assert_eq!(samples.time_s, [0.0, 0.5]);
        assert_eq!(samples.pressure_kpa, [1.5, 2.5]);
        let error = crate::read_bytes(&book(&rows[2..].concat()), path, &Layout::default());
        let said = error.unwrap_err().to_string();
        assert!(said.starts_with("lab.xlsx, line 1"), "{said}");
    }

    #[test]
    fn days_are_written_out() {
        assert_eq!(duration(0.5 + 1.25 / DAY_S), "0 days 12:00:01.250000");
        assert_eq!(duration(2.0), "2 days 00:00:00.000000");
    }
}
