//! Finds the columns of a recording, and suggests flags for an unknown header.
//!
//! A file is read by the given names only. If a column is missing, the error suggests the flags
//! that would read the file, judging by its header. That is only a suggestion: no column is
//! read because its name looks right.

use crate::columns::{Layout, Quantity, Unit, is_made, position};
use crate::error::{InputError, Suggestion, UNKNOWN_COLUMN};
use crate::table::seems_number;
use crate::terminal::quoted;

/// Whole names, and words in longer ones.
const WORDS: [&[&str]; 3] = [
    &[
        "t",
        "time",
        "timestamp",
        "times",
        "zeit",
        "temps",
        "uhrzeit",
        "zeitstempel",
        "horodatage",
        "heure",
        "tiempo",
        "sec",
        "seconds",
        "elapsed",
        "clock",
        "datetime",
        "date",
    ],
    &[
        "p",
        "press",
        "pressure",
        "druck",
        "pression",
        "presion",
        "pres",
        "gauge",
        "\u{fc}berdruck",
        "ueberdruck",
        "innendruck",
    ],
    &[
        "theta",
        "\u{3b8}",
        "angle",
        "ang",
        "bend",
        "bending",
        "phi",
        "\u{3c6}",
        "alpha",
        "winkel",
        "curvature",
        "flex",
        "angulo",
        "neigung",
        "inclinaison",
        "rotation",
        "drehwinkel",
        "ausschlag",
        "q",
    ],
];

/// Words of columns that are about the same quantity and are not measured.
const NOT_MEASURED: [&str; 17] = [
    "sollwert",
    "consigne",
    "vorgabe",
    "f\u{fc}hrungsgr\u{f6}\u{df}e",
    "set",
    "setpoint",
    "target",
    "ref",
    "reference",
    "desired",
    "cmd",
    "command",
    "predicted",
    "sim",
    "simulated",
    "model",
    "soll",
];

/// The places of time, pressure and angle in a header. `what` a column is called there. One that
/// is [made](is_made) is behind the last.
///
/// # Errors
///
/// Names the column that is not there, and those that are.
pub fn find(header: &[String], layout: &Layout, what: &str) -> Result<[usize; 3], InputError> {
    let mut places = [0; 3];
    for (quantity, place) in Quantity::ALL.into_iter().zip(&mut places) {
        let name = layout.names.of(quantity);
        if is_made(name) && !header.iter().any(|it| it == name) {
            *place = header.len();
            continue;
        }
        if let Some(at) = position(name).filter(|&at| at < header.len()) {
            *place = at;
            continue;
        }
        let mut found = (0..header.len()).filter(|&at| header[at] == name);
        *place = found.next().ok_or_else(|| {
            let found = format!("has no {what} {name} (it has {})", header.join(", "));
            InputError {
                suggestion: suggested(header, layout).map(Box::new),
                ..InputError::new(found, advice(header, layout, what)).in_column(name)
            }
        })?;
        if found.next().is_some() {
            return Err(InputError::new(
                format!("has more than one {what} {name}"),
                "remove or rename all but the one that is meant",
            )
            .in_column(name));
        }
    }
    Ok(places)
}

/// How the file would be read, or what it needs.
fn advice(header: &[String], layout: &Layout, what: &str) -> String {
    if header.len() >= Quantity::ALL.len() && header.iter().all(|it| seems_number(it)) {
        return "the table has no header: say which column is which by its number, --columns time=#1,pressure=#2,angle=#3, with the units if they are not s, kPa and deg".to_owned();
    }
    if header.len() < Quantity::ALL.len() && what == "column" {
        return format!(
            "separate the columns by commas, semicolons, tabs or blanks, and give them names in the first row: a recording needs {}",
            Quantity::ALL.map(Quantity::column).join(", ")
        );
    }
    if Quantity::ALL
        .iter()
        .all(|it| header.iter().any(|name| name == it.column()))
    {
        return format!(
            "leave out what names other {what}s: it has those of a recording, {}",
            Quantity::ALL.map(Quantity::column).join(", ")
        );
    }
    match suggestion(header, layout) {
        Some(flags) => format!(
            "if its names mean what they seem to, add {flags}, or say so once in [recording] of the model file; or rename the {what}s"
        ),
        None => format!(
            "name the {what}s that hold them with --columns time=…,pressure=…,angle=…, or rename them to {}",
            Quantity::ALL.map(Quantity::column).join(", ")
        ),
    }
}

/// The flags with which a header would be read; none if no name in it means anything.
fn suggestion(header: &[String], layout: &Layout) -> Option<String> {
    let Suggestion { columns, units } = suggested(header, layout)?;
    let mut flags = format!("--columns {}", quoted(&columns));
    if !units.is_empty() {
        flags += &format!(" --units {units}");
    }
    Some(flags)
}

/// The columns and units with which a header would be read; none if no name in it means anything.
fn suggested(header: &[String], layout: &Layout) -> Option<Suggestion> {
    let mut names: Vec<String> = Vec::new();
    let mut units: Vec<String> = Vec::new();
    let mut taken: Vec<&str> = Vec::new();
    let mut guessed = false;
    for quantity in Quantity::ALL {
        let wanted = layout.names.of(quantity);
        let name = if header.iter().any(|name| name == wanted) {
            Some(wanted)
        } else {
            let best = header
                .iter()
                .map(|name| (likeness(quantity, name), name.as_str()))
                .filter(|(likeness, name)| *likeness > 0 && !taken.contains(name))
                // Of equals the first.
                .rev()
                .max_by_key(|(likeness, _)| *likeness);
            guessed |= best.is_some();
            best.map(|(_, name)| name)
        };
        taken.extend(name);
        if name != Some(quantity.column()) {
            names.push(format!(
                "{}={}",
                quantity.key(),
                name.unwrap_or(UNKNOWN_COLUMN)
            ));
        }
        let unit = name.and_then(|name| unit_in(quantity, name));
        let factor = name.and_then(factor_in);
        let promised = ["s", "kpa", "deg"][quantity as usize];
        let called = unit.map_or(promised, Unit::name);
        match factor {
            Some(factor) => units.push(format!("{}={called}*{factor}", quantity.key())),
            None if unit.is_some_and(|unit| !unit.is_promised()) => {
                units.push(format!("{}={called}", quantity.key()));
            }
            None => {}
        }
    }
    if !guessed {
        return None;
    }
    Some(Suggestion {
        columns: names.join(","),
        units: units.join(","),
    })
}

/// The unit that the name of a column has in it: `p_psi`, `Pressure [psi]`, `Zeit/ms`.
pub fn unit_in(quantity: Quantity, name: &str) -> Option<Unit> {
    Unit::of(quantity, split(without_factor(name)).1?)
}

/// A name without its unit, and the unit as it is written: what is in brackets, or the last word.
fn split(name: &str) -> (&str, Option<&str>) {
    let name = name.trim();
    if let Some(open) = name.rfind(['[', '(']) {
        return (&name[..open], Some(&name[open..]));
    }
    if let Some(at) = name.rfind(|c: char| "_/. ,-".contains(c)) {
        return (&name[..at], Some(&name[at + 1..]));
    }
    let is_unit = Quantity::ALL
        .into_iter()
        .any(|quantity| Unit::of(quantity, name).is_some());
    if is_unit {
        ("", Some(name))
    } else {
        (name, None)
    }
}

/// How much a name looks like that of a quantity; not at all is 0.
pub fn likeness(quantity: Quantity, name: &str) -> u32 {
    // LabVIEW's measurement files.
    if quantity == Quantity::Time && name == "X_Value" {
        return 6;
    }
    let name = without_factor(name);
    let (stem, unit) = split(name);
    let has_unit = |of: Quantity| unit.is_some_and(|unit| Unit::of(of, unit).is_some());
    let known = WORDS[quantity as usize];
    let all = words(name);
    if all.iter().any(|word| NOT_MEASURED.contains(&word.as_str())) {
        return 0;
    }
    let stem_words = words(if has_unit(quantity) { stem } else { name });
    let whole = stem_words.len() == 1 && known.contains(&stem_words[0].as_str());
    let part = stem_words.iter().any(|word| known.contains(&word.as_str()));
    let inside = stem_words.iter().any(|word| {
        let mut long = known.iter().filter(|known| known.len() > 3);
        long.any(|known| word.contains(known))
    });
    let of_another = Quantity::ALL
        .into_iter()
        .any(|other| other != quantity && has_unit(other));
    let by_name = match (whole, part, inside) {
        (true, ..) => 6,
        (_, true, _) => 4,
        (_, _, true) => 2,
        _ => 0,
    };
    match (by_name, has_unit(quantity)) {
        (0, false) => 0,
        _ if of_another && by_name < 6 => 0,
        (score, true) => score + 1,
        (score, false) => score,
    }
}

/// The words in a name, in lower case: those of `measuredPressure` are two.
fn words(text: &str) -> Vec<String> {
    let mut parted = String::with_capacity(text.len() + 8);
    let mut before = ' ';
    for c in text.chars() {
        if before.is_lowercase() && c.is_uppercase() {
            parted.push(' ');
        }
        parted.push(c);
        before = c;
    }
    parted
        .split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty())
        .map(str::to_lowercase)
        .collect()
}

/// The factor that the name of a column has in it: the values of `pressure * 100` are a hundred
/// times the pressure.
pub fn factor_in(name: &str) -> Option<f64> {
    let (_, factor) = name.rsplit_once(['*', '\u{d7}'])?;
    let digits = factor.trim().trim_end_matches([')', ']']);
    digits.parse().ok().filter(|factor: &f64| *factor > 0.0)
}

/// A name without the factor in it.
fn without_factor(name: &str) -> &str {
    match (factor_in(name), name.rfind(['*', '\u{d7}'])) {
        (Some(_), Some(at)) => name[..at].trim_end(),
        _ => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn suggested(header: &[&str]) -> String {
        let header: Vec<String> = header.iter().map(|name| (*name).to_owned()).collect();
        suggestion(&header, &Layout::default()).unwrap_or_default()
    }

    #[test]
    fn headers_of_other_tools_are_understood() {
        for (header, flags) in [
            (
                &["t", "p_psi", "theta"][..],
                "--columns time=t,pressure=p_psi,angle=theta --units pressure=psi",
            ),
            (
                &["Time (ms)", "Pressure [psi]", "Angle (rad)"],
                "--columns 'time=Time (ms),pressure=Pressure [psi],angle=Angle (rad)' --units time=ms,pressure=psi,angle=rad",
            ),
            (
                &["Zeit/s", "Druck/bar", "Winkel/\u{b0}"],
                "--columns 'time=Zeit/s,pressure=Druck/bar,angle=Winkel/\u{b0}' --units pressure=bar",
            ),
            (
                &["timestamp", "target_pressure", "pressure_2", "bend_angle"],
                "--columns time=timestamp,pressure=pressure_2,angle=bend_angle",
            ),
            (
                &["time_s", "pressure_psi", "angle_deg"],
                "--columns pressure=pressure_psi --units pressure=psi",
            ),
            (
                &["s", "kPa", "deg"],
                "--columns time=s,pressure=kPa,angle=deg",
            ),
            (
                &["time", "valve", "angle"],
                "--columns time=time,pressure=COLUMN,angle=angle",
            ),
            (&["a", "b", "c"], ""),
            (&[], ""),
        ] {
            assert_eq!(suggested(header), flags, "{header:?}");
        }
    }

    #[test]
    fn a_unit_in_a_name_is_one_of_its_quantity() {
        assert!(unit_in(Quantity::Pressure, "p_psi").is_some());
        assert!(unit_in(Quantity::Angle, "p_psi").is_none());
        assert!(
            unit_in(Quantity::Pressure, "pressure_kpa")
                .unwrap()
                .is_promised()
        );
        assert!(unit_in(Quantity::Time, "t").is_none());
        assert!(unit_in(Quantity::Pressure, "p_volt").is_none());
    }
}
