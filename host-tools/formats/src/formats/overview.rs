//! A look at a table of text whose columns are not named yet, and what they seem to be.

use std::path::Path;

use super::names::{factor_in, likeness, unit_in};
use super::stamps;
use crate::bounded::{Limits, read_bytes};
use crate::columns::{NOTHING, Quantity, ROW, Unit};
use crate::error::InputError;
use crate::table::{Row, Rows, Wanted, seems_number};

/// Lines above a header that are looked at.
const LINES_ABOVE: usize = 200;
/// Rows that are looked at.
const MOST_ROWS: usize = 50_000;
/// Share of the rows that make a column one of numbers, or one that increases.
const MOST: f64 = 0.9;

/// Words in the names of inputs that are not pressures.
const INPUTS: [&str; 9] = [
    "pwm", "volt", "current", "strom", "input", "valve", "pump", "command", "eingang",
];

/// The beginning of a table.
pub struct Overview {
    /// The names of its columns; `#1`, `#2`, … where it has no header.
    pub names: Vec<String>,
    /// The rows, as text.
    pub rows: Vec<Vec<String>>,
}

/// What the columns of a table seem to be.
pub struct Guess {
    /// Their names, as `--columns` takes them.
    pub columns: String,
    /// Their units, as `--units` takes them; empty if they are those of a recording.
    pub units: String,
}

impl Overview {
    /// Looks at a file.
    ///
    /// # Errors
    ///
    /// Names the file that cannot be read, or is not a table.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        Self::of_file(&read_bytes(path)?, path)
    }

    /// Looks at the bytes of a file; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Names the file that is not a table.
    pub fn of_file(bytes: &[u8], path: &Path) -> Result<Self, InputError> {
        let named = Self::open(bytes, path, false)?;
        let is_header =
            |all: &Self| all.names.len() > 1 && !all.names.iter().any(|name| seems_number(name));
        if let Some(all) = named.filter(|all| is_header(all) && !all.rows.is_empty()) {
            return Ok(all);
        }
        let headless = Self::open(bytes, path, true)?;
        headless.filter(|all| !all.rows.is_empty()).ok_or_else(|| {
            InputError::new(
                "is no table: no line has two numbers or more, nor names above such lines",
                "export it with one row a line and the columns apart by commas, semicolons or tabs",
            )
            .in_file(path)
        })
    }

    fn open(bytes: &[u8], path: &Path, is_headless: bool) -> Result<Option<Self>, InputError> {
        let numbers =
            |fields: &[String]| fields.len() > 1 && fields.iter().all(|field| seems_number(field));
        let nothing = |_: &[String]| false;
        let wanted = Wanted {
            names: if is_headless { &numbers } else { &nothing },
            lines_above: LINES_ABOVE,
            skipped: 0,
            is_headless,
        };
        let Some((header, mut rows)) = Rows::open(bytes, path, Limits::RECORDING, wanted)? else {
            return Ok(None);
        };
        let mut all = Self {
            names: header.names,
            rows: Vec::new(),
        };
        let mut row = Row::default();
        while all.rows.len() < MOST_ROWS && rows.next(&mut row)? {
            if row.width() == all.names.len() {
                let fields = (0..row.width()).map(|at| row.field(at).into_owned());
                all.rows.push(fields.collect());
            }
        }
        Ok(Some(all))
    }

    /// The numbers of a column, NaN where there is none; times as seconds.
    pub fn numbers(&self, column: usize) -> Vec<f64> {
        let number = |row: &Vec<String>| {
            let field = &row[column];
            let number = field.replace(',', ".").parse().ok();
            number
                .or_else(|| stamps::read(field).map(|stamp| stamp.seconds))
                .unwrap_or(f64::NAN)
        };
        self.rows.iter().map(number).collect()
    }

    /// The course of a column, from 0 at its least number to 1 at its largest, as means over at
    /// most `pieces` pieces; NaN where a piece has no number.
    pub fn course(&self, column: usize, pieces: usize) -> Vec<f64> {
        let numbers = self.numbers(column);
        let finite = || numbers.iter().copied().filter(|it| it.is_finite());
        let low = finite().fold(f64::INFINITY, f64::min);
        let high = finite().fold(f64::NEG_INFINITY, f64::max);
        let height = |piece: &[f64]| {
            let there: Vec<f64> = piece.iter().copied().filter(|it| it.is_finite()).collect();
            let mean = there.iter().sum::<f64>() / there.len() as f64;
            if high > low || there.is_empty() {
                (mean - low) / (high - low)
            } else {
                0.0
            }
        };
        let size = numbers.len().div_ceil(pieces.max(1)).max(1);
        numbers.chunks(size).map(height).collect()
    }

    /// What a column is called in `--columns`: by its name, or its number where that is not clear.
    pub fn called(&self, column: usize) -> String {
        let name = &self.names[column];
        let same = self.names.iter().filter(|it| *it == name).count();
        if name.is_empty() || same > 1 {
            format!("#{}", column + 1)
        } else {
            name.clone()
        }
    }

    /// What the columns seem to be: by their names, and then by their numbers.
    pub fn guess(&self) -> Guess {
        let numbers: Vec<Vec<f64>> = (0..self.names.len()).map(|at| self.numbers(at)).collect();
        let is_of_numbers = |at: &usize| {
            let there = numbers[*at].iter().filter(|it| it.is_finite()).count();
            there as f64 >= MOST * self.rows.len() as f64
        };
        let moves = |at: &usize| {
            let mut there = numbers[*at].iter().filter(|it| it.is_finite());
            let first = there.next();
            there.any(|it| Some(it) != first)
        };
        let usable: Vec<usize> = (0..self.names.len()).filter(is_of_numbers).collect();
        let mut found: [Option<usize>; 3] = [None; 3];
        for quantity in Quantity::ALL {
            let free = usable.iter().filter(|at| !found.contains(&Some(**at)));
            let best = free
                .map(|at| (likeness(quantity, &self.names[*at]), *at))
                .filter(|(likeness, _)| *likeness > 0)
                .rev()
                .max_by_key(|(likeness, _)| *likeness);
            found[quantity as usize] = best.map(|(_, at)| at);
        }
        if found[0].is_none() {
            let mut free = usable.iter().filter(|at| !found.contains(&Some(**at)));
            found[0] = free.find(|at| increases(&numbers[**at])).copied();
        }
        let free: Vec<usize> = usable
            .iter()
            .copied()
            .filter(|at| !found.contains(&Some(*at)) && moves(at))
            .filter(|at| !self.names[*at].is_empty())
            .collect();
        let is_input = |at: &&usize| {
            let name = self.names[**at].to_lowercase();
            INPUTS.iter().any(|word| name.contains(word))
        };
        match (found[1], found[2]) {
            (None, None) if free.len() > 1 => {
                let input = free.iter().find(is_input).copied().unwrap_or(free[0]);
                found[1] = Some(input);
                found[2] = free.iter().copied().find(|at| *at != input);
            }
            (None, None) => found[2] = free.first().copied(),
            (None, Some(_)) => found[1] = free.iter().find(is_input).copied(),
            (Some(_), None) => {
                let output = free.iter().find(|at| !is_input(at));
                found[2] = output.or(free.last()).copied();
            }
            (Some(_), Some(_)) => {}
        }
        self.written(found, &numbers)
    }

    fn written(&self, found: [Option<usize>; 3], numbers: &[Vec<f64>]) -> Guess {
        let mut columns = Vec::new();
        let mut units = Vec::new();
        for quantity in Quantity::ALL {
            let key = quantity.key();
            let promised = ["s", "kpa", "deg"][quantity as usize];
            let Some(at) = found[quantity as usize] else {
                match quantity {
                    Quantity::Time => {
                        columns.push(format!("{key}={ROW}"));
                        units.push(format!("{key}=s*1"));
                    }
                    Quantity::Pressure => columns.push(format!("{key}={NOTHING}")),
                    Quantity::Angle => columns.push(format!("{key}=#{}", self.names.len())),
                }
                continue;
            };
            columns.push(format!("{key}={}", self.called(at)));
            let name = &self.names[at];
            // A row of units beneath the header is read by itself, as far as it says units.
            let beneath = self.rows.first().map_or("", |row| row[at].as_str());
            let is_units_row = !beneath.is_empty() && numbers[at][0].is_nan();
            let known = Unit::of(quantity, beneath);
            let by_name = unit_in(quantity, name);
            let unit = by_name.map_or(promised, Unit::name);
            match factor_in(name) {
                Some(factor) => units.push(format!("{key}={unit}*{factor}")),
                None if is_units_row && known.is_some() => {}
                None if is_units_row || by_name.is_some_and(|unit| !unit.is_promised()) => {
                    units.push(format!("{key}={unit}"));
                }
                None if quantity == Quantity::Time && by_name.is_none() => {
                    if let Some(unit) = counted_in(&numbers[at]) {
                        units.push(format!("{key}={unit}"));
                    }
                }
                None => {}
            }
        }
        Guess {
            columns: columns.join(","),
            units: units.join(","),
        }
    }
}

/// Whether numbers increase, except for a few.
fn increases(numbers: &[f64]) -> bool {
    let up = numbers.windows(2).filter(|pair| pair[1] > pair[0]).count();
    numbers.len() > 1 && up as f64 >= MOST * (numbers.len() - 1) as f64
}

/// The unit of times that are whole numbers, as milliseconds and microseconds of a board are.
fn counted_in(times: &[f64]) -> Option<&'static str> {
    let steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let whole = steps.iter().filter(|step| step.fract() == 0.0).count();
    let mut up: Vec<f64> = steps.iter().copied().filter(|step| *step > 0.0).collect();
    up.sort_by(f64::total_cmp);
    let usual = *up.get(up.len() / 2)?;
    if (whole as f64) < MOST * steps.len() as f64 {
        return None;
    }
    match usual {
        2.0..1000.0 => Some("ms"),
        1000.0..1e7 => Some("us"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guess(text: &str) -> [String; 2] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lab.csv");
        std::fs::write(&path, text).unwrap();
        let guess = Overview::read(&path).unwrap().guess();
        [guess.columns, guess.units]
    }

    #[test]
    fn columns_are_guessed_by_names_and_by_numbers() {
        let rows = |header: &str, row: &dyn Fn(u32) -> String| {
            let rows: Vec<String> = (0..40).map(row).collect();
            format!("{header}\n{}\n", rows.join("\n"))
        };
        for (text, columns, units) in [
            (
                rows("time;angle;pressure;set_point", &|k| {
                    format!("0.{k:02};{k}.1;5.{k};0")
                }),
                "time=time,pressure=pressure,angle=angle",
                "",
            ),
            (
                rows("Zeit / ms\tDruck / bar\tWinkel / rad", &|k| {
                    format!("{}\t1,{k}\t0,{k}", 20 * k)
                }),
                "time=Zeit / ms,pressure=Druck / bar,angle=Winkel / rad",
                "time=ms,pressure=bar,angle=rad",
            ),
            (
                rows("t / s\t&b_A1 / rad", &|k| format!("0,{k}\t-2,{k}")),
                "time=t / s,pressure=none,angle=&b_A1 / rad",
                "angle=rad",
            ),
            (
                rows("Frequenz;Kanal A;Kanal B\n(ms);(V);(V)\n", &|k| {
                    format!("{k},5;1,{k};2,{k}")
                }),
                "time=Frequenz,pressure=Kanal A,angle=Kanal B",
                "pressure=kpa,angle=deg",
            ),
            (
                rows("Temps (ms),Consigne,Pression (mbar),Angle", &|k| {
                    format!("{},1,{k}.5,{k}", 10 * k)
                }),
                "time=Temps (ms),pressure=Pression (mbar),angle=Angle",
                "time=ms,pressure=mbar",
            ),
            (
                rows(
                    "unixTime,referencePressure,measuredPressure * 100,force * 100",
                    &|k| format!("17{k:02}.5,20,20{k},{k}"),
                ),
                "time=unixTime,pressure=measuredPressure * 100,angle=force * 100",
                "pressure=kpa*100,angle=deg*100",
            ),
            (
                rows("12.4", &|k| format!("{}\t1{k}.4", 690 + k)),
                "time=#1,pressure=none,angle=#2",
                "",
            ),
        ] {
            assert_eq!(guess(&text), [columns, units], "{text}");
        }
    }
}
