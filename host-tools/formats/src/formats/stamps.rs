//! Times that are written as a clock shows them.
//!
//! Spreadsheets, loggers and data-frame libraries each write a time in their own form. All of them
//! become seconds here ([`read`]).

use crate::error::InputError;

/// A time that was read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamp {
    /// The time (s since 1970 in UTC, or since midnight).
    pub seconds: f64,
    /// Whether it has no date.
    pub is_of_day: bool,
}

/// The times of a whole column.
pub struct Stamps {
    /// The times (s).
    pub seconds: Vec<f64>,
    /// Whether one of them has no date.
    pub is_of_day: bool,
}

/// Reads all fields; none if one of them is not a time.
pub fn all(fields: &[String]) -> Option<Stamps> {
    let read: Option<Vec<Stamp>> = fields.iter().map(|field| read(field)).collect();
    let read = read?;
    Some(Stamps {
        is_of_day: read.iter().any(|stamp| stamp.is_of_day),
        seconds: read.iter().map(|stamp| stamp.seconds).collect(),
    })
}

/// Reads a time; none if the field is something else, such as a number.
///
/// | form | |
/// |---|---|
/// | `2024-05-01T12:00:00.020Z` | ISO 8601, with a blank for the T, without the Z or with an offset |
/// | `2024-05-01 12:00:00.020 PM`, `12:00:00.020 PM` | of twelve hours |
/// | `01.05.2024 12:00:00,020` | the German form |
/// | `12:00:00.020` | a time of the day |
/// | `5/1/2024 12:00:00` | a time of the day: whether the month comes first nobody knows |
/// | `00:12.5` | minutes and seconds, as Excel shows them |
/// | `0 days 00:00:00.020` | a duration of pandas |
pub fn read(field: &str) -> Option<Stamp> {
    let field = field.trim();
    if !field.is_ascii() || !field.contains(':') {
        return None;
    }
    let (field, half) = match field.len().checked_sub(2).map(|at| field.split_at(at)) {
        Some((rest, mark)) if mark.eq_ignore_ascii_case("am") => (rest.trim_end(), Some(0.0)),
        Some((rest, mark)) if mark.eq_ignore_ascii_case("pm") => (rest.trim_end(), Some(12.0)),
        _ => (field, None),
    };
    if let Some(seconds) = iso_seconds(field) {
        let seconds = match half {
            Some(half) => {
                // Twelve is the first hour of each half.
                let hour = (seconds.rem_euclid(86_400.0) / 3600.0).floor();
                seconds + 3600.0 * (half - if hour >= 12.0 { 12.0 } else { 0.0 })
            }
            None => seconds,
        };
        return Some(Stamp {
            seconds,
            is_of_day: false,
        });
    }
    if let Some((days, rest)) = field.split_once("day") {
        let days: f64 = days.trim().parse().ok()?;
        let rest = rest.trim_start_matches('s').trim_start_matches(',').trim();
        return Some(Stamp {
            seconds: 86_400.0 * days + of_day(rest, None)?,
            is_of_day: false,
        });
    }
    let (date, time) = field.rsplit_once([' ', 'T']).unwrap_or(("", field));
    let time = of_day(time, half)?;
    let numbers: Vec<u32> = date
        .split(['.', '/', '-'])
        .filter_map(|part| part.parse().ok())
        .collect();
    match (date, numbers.as_slice()) {
        ("", _) => Some(Stamp {
            seconds: time,
            is_of_day: true,
        }),
        (date, [day, month, year]) if date.contains('.') && *year > 31 => {
            let year = if *year < 100 { year + 2000 } else { *year };
            let midnight = iso_seconds(&format!("{year:04}-{month:02}-{day:02}T00:00:00"))?;
            Some(Stamp {
                seconds: midnight + time,
                is_of_day: false,
            })
        }
        (_, [_, _, _]) => Some(Stamp {
            seconds: time,
            is_of_day: true,
        }),
        _ => None,
    }
}

/// Seconds since midnight of `12:00:00.020`, also with a comma or a third colon; of `00:12.5`,
/// which has minutes. `half`: the first hour of the half of the day.
fn of_day(text: &str, half: Option<f64>) -> Option<f64> {
    let text = text.replace(',', ".");
    let mut parts: Vec<String> = text.split(':').map(str::to_owned).collect();
    if parts.len() == 4 {
        let thousandths = parts.pop()?;
        parts[2] = format!("{}.{thousandths}", parts[2]);
    }
    let is_number = |part: &String| {
        !part.is_empty() && part.bytes().all(|it| it.is_ascii_digit() || it == b'.')
    };
    if !parts.iter().all(is_number) {
        return None;
    }
    let numbers: Vec<f64> = parts.iter().filter_map(|part| part.parse().ok()).collect();
    match *numbers.as_slice() {
        [hour, minute, second] if minute < 60.0 && second < 61.0 => {
            let hour = match half {
                Some(half) => hour.rem_euclid(12.0) + half,
                None => hour,
            };
            Some(3600.0 * hour + 60.0 * minute + second)
        }
        [minute, second] if text.contains('.') && second < 60.0 => Some(60.0 * minute + second),
        _ => None,
    }
}

/// Whether a text that is not a number looks like a time.
pub fn is_like_one(field: &str) -> bool {
    let has_digit = field.bytes().any(|byte| byte.is_ascii_digit());
    let numbers = field
        .split(['-', '/', '.', ' '])
        .filter(|part| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit()));
    has_digit
        && (field.contains(':') || field.starts_with("PT") || numbers.count() >= 3)
        && field.replace(',', ".").parse::<f64>().is_err()
}

/// Refuses a time in a form that cannot be read.
pub fn no_form(field: &str) -> InputError {
    InputError::new(
        format!("\"{field}\" is a time in a form that is not read"),
        "write seconds, or the forms 2024-05-01T12:00:00.020 (ISO 8601) or 12:00:00.020",
    )
}

/// The time (s since 1970) of a time stamp as ISO 8601 has it, `2024-05-01T12:00:00.01Z`, with a
/// blank for the T, without the Z or with an offset from UTC in its place; none if the field is
/// something else.
fn iso_seconds(field: &str) -> Option<f64> {
    let is_date = field.is_ascii() && field.len() >= 19 && field.as_bytes()[4] == b'-';
    if !is_date {
        return None;
    }
    let (date, offset) = field.split_at(19);
    let (fraction, offset) = match offset.find(['Z', 'z', '+', '-']) {
        Some(at) => offset.split_at(at),
        None => (offset, ""),
    };
    let east_s = match offset {
        "" | "Z" | "z" => 0.0,
        offset => {
            let digits: String = offset[1..].chars().filter(|it| *it != ':').collect();
            let number: u32 = digits.parse().ok().filter(|_| digits.len() == 4)?;
            let seconds = f64::from(number / 100 * 3600 + number % 100 * 60);
            if offset.starts_with('-') {
                -seconds
            } else {
                seconds
            }
        }
    };
    let text = format!("{date}{}", fraction.replace(',', ".")).replace(' ', "T");
    let time = humantime::parse_rfc3339_weak(&text).ok()?;
    let since = time.duration_since(std::time::UNIX_EPOCH).ok()?;
    Some(since.as_secs_f64() - east_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_of_clocks_are_read() {
        let midnight = 1_714_521_600.0;
        for (text, seconds, is_of_day) in [
            ("2024-05-01T12:00:00.5Z", midnight + 43_200.5, false),
            ("2024-05-01 01:00:00 PM", midnight + 46_800.0, false),
            ("2024-05-01 12:30:00 PM", midnight + 45_000.0, false),
            ("2024-05-01 12:30:00 am", midnight + 1_800.0, false),
            ("01.05.2024 00:00:01,25", midnight + 1.25, false),
            ("12:59:59.5 PM", 46_799.5, true),
            ("1:00:00 PM", 46_800.0, true),
            ("23:59:58.020", 86_398.02, true),
            ("23:59:58:020", 86_398.02, true),
            ("5/1/2024 0:00:02", 2.0, true),
            ("59:58.5", 3598.5, true),
            ("0 days 00:00:00.02", 0.02, false),
            ("1 day, 0:00:01", 86_401.0, false),
        ] {
            let read = read(text).unwrap_or_else(|| panic!("{text}"));
            assert!((read.seconds - seconds).abs() < 1e-6, "{text}: {read:?}");
            assert_eq!(read.is_of_day, is_of_day, "{text}");
        }
        for text in [
            "",
            "1.5",
            "12:00",
            "a:b:c",
            "12:61:00",
            "noon",
            "\u{e9}1:00:00",
        ] {
            assert_eq!(read(text), None, "{text}");
        }
        for text in ["Mon May 1 12:00 2024", "PT0.02S", "2024-05-01", "12h:3"] {
            assert!(is_like_one(text), "{text}");
            assert!(no_form(text).to_string().contains("ISO"));
        }
        for text in ["x", "1,5", "-0.5e-3", "nan", ""] {
            assert!(!is_like_one(text), "{text}");
        }
    }
}
