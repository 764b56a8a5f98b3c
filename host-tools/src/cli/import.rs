//! `softrig import`: says once which columns of a laboratory's files are what.
//!
//! A recording is never read because its names look right. Here somebody looks at the first rows
//! and at a picture of each column, agrees with what is guessed or corrects it, and the answers go
//! into `softrig.toml`, where every command finds them.

use std::fmt::Write as _;
use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Parser;
use toml_edit::{DocumentMut, Item};

use super::input::InputArgs;
use softrig_formats::bounded::read_text;
use softrig_formats::columns::{Columns, Layout, Names, UNITS_HELP};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::formats::overview::{Guess, Overview};
use softrig_formats::numbers::short;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording, recordings_among};
use softrig_formats::terminal::{printable_line, remark};
use softrig_link::rig_file::RIG_FILE;

/// Shows a file from another tool, asks what its columns are, and saves the answers.
///
/// It shows the first rows and a small picture of each column, and guesses. Two questions follow:
/// the columns, and their units; Enter accepts. The answers go into `[recording]` of softrig.toml
/// in this folder, which every command that reads recordings uses.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig import run1.csv run2.csv
  softrig import log.txt --yes                                   as it is guessed
  softrig import arm.csv --columns time=#0,pressure=#9,angle=#4 --units 'time=s*50,angle=rad'
                                                                 no time: 50 rows a second
  softrig import counts.csv --scale pressure=101:0,512:100       101 counts are 0 kPa, 512 are 100")]
pub struct Args {
    /// The files, all with the same columns
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Write [recording] into this file: softrig.toml, or a model file
    #[arg(short, long, value_name = "FILE", default_value = RIG_FILE)]
    output: PathBuf,
    /// Do not ask: guess whatever the flags leave open
    #[arg(long)]
    yes: bool,
    #[command(flatten)]
    input: InputArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Files that cannot be read as they are said to be, and an output that cannot be written.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let files = recordings_among(&args.files, super::warn)?;
    let said = args.input.layout();
    let (shown, mut guess) = looked_at(&files[0], &said)?;
    super::print(&shown)?;
    let mut asking = Asking {
        is_silent: args.yes || is_all_said(&said),
    };
    let layout = loop {
        let layout = asking.layout(&guess)?;
        let layout = said.or(&layout);
        match read(&files, &layout) {
            Ok(text) => {
                super::print(&text)?;
                break layout;
            }
            Err(error) if asking.is_silent => return Err(error.into()),
            Err(error) => {
                remark(&error.to_string());
                if let Some(suggestion) = error.suggestion {
                    guess = Guess {
                        columns: suggestion.columns,
                        units: suggestion.units,
                    };
                }
            }
        }
    };
    write(&args.output, &layout)?;
    super::print(&format!(
        "written: {}, [recording]\n",
        args.output.display()
    ))?;
    Ok(())
}

/// Whether the command line says where all three quantities are.
fn is_all_said(layout: &Layout) -> bool {
    use softrig_formats::columns::Quantity;
    Quantity::ALL
        .into_iter()
        .all(|quantity| layout.names.said(quantity).is_some())
}

/// The first rows and a picture of each column, and what they seem to be. A file in another format
/// than text shows its columns, as its reader names them.
fn looked_at(path: &Path, said: &Layout) -> Result<(String, Guess), InputError> {
    let overview = match Overview::read(path) {
        Ok(overview) => overview,
        Err(error) => {
            return match Recording::read_as(path, said) {
                Ok(_) => Ok((
                    String::new(),
                    Guess {
                        columns: String::new(),
                        units: String::new(),
                    },
                )),
                Err(read) => match read.suggestion.clone() {
                    Some(suggestion) => Ok((
                        format!("{read}\n"),
                        Guess {
                            columns: suggestion.columns,
                            units: suggestion.units,
                        },
                    )),
                    None if read.found.starts_with("has no ") => Err(read),
                    None => Err(error),
                },
            };
        }
    };
    Ok((picture(path, &overview), overview.guess()))
}

/// The columns one below the other: number, name, first values, range and course.
fn picture(path: &Path, overview: &Overview) -> String {
    const FIRST: usize = 3;
    const NAME: usize = 28;
    const WIDTH: usize = 32;
    let mut text = format!(
        "{}: {} columns, {} rows\n\n",
        path.display(),
        overview.names.len(),
        overview.rows.len()
    );
    for (at, name) in overview.names.iter().enumerate() {
        let first: Vec<&str> = overview
            .rows
            .iter()
            .take(FIRST)
            .map(|row| row[at].as_str())
            .collect();
        let shown: String = printable_line(name).chars().take(NAME).collect();
        let first = printable_line(&first.join(" "))
            .chars()
            .take(34)
            .collect::<String>();
        let _ = writeln!(
            text,
            "{:>4}  {shown:<NAME$}  {:<WIDTH$}  {first}",
            format!("#{}", at + 1),
            bars(&overview.course(at, WIDTH))
        );
    }
    text.push('\n');
    text
}

/// A course in one line, from the least to the largest.
fn bars(course: &[f64]) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let bar = |height: &f64| {
        if height.is_nan() {
            return ' ';
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // It is from 0 to 7.
        let height = (height * (BARS.len() - 1) as f64).round() as usize;
        BARS[height.min(BARS.len() - 1)]
    };
    course.iter().map(bar).collect()
}

/// The two questions.
struct Asking {
    /// Nobody is asked: the guesses count.
    is_silent: bool,
}

impl Asking {
    fn layout(&mut self, guess: &Guess) -> Result<Layout, InputError> {
        let columns = self.ask(
            "Columns (by name or number; pressure=none without one, time=#0 for none)",
            &guess.columns,
            |text| Names::parse(text).map(drop),
        )?;
        let units = self.ask(&format!("Units ({UNITS_HELP})"), &guess.units, |text| {
            Columns::of_units(text).map(drop)
        })?;
        let refused = |why: String| InputError::new(why, "say it with --columns and --units");
        let mut layout = Layout::default();
        if !columns.is_empty() {
            layout.names = Names::parse(&columns).map_err(refused)?;
        }
        if !units.is_empty() {
            layout.columns = Columns::of_units(&units).map_err(refused)?;
        }
        Ok(layout)
    }

    /// An answer, or the guess where there is none: an empty line, or an end of the input.
    fn ask(
        &mut self,
        question: &str,
        guess: &str,
        check: impl Fn(&str) -> Result<(), String>,
    ) -> Result<String, InputError> {
        loop {
            if self.is_silent {
                return Ok(guess.to_owned());
            }
            remark(&format!("{question}\n  [{}]", printable_line(guess)));
            let mut line = String::new();
            let read = std::io::stdin().lock().read_line(&mut line);
            let read =
                read.map_err(|error| InputError::from_io(Path::new("standard input"), &error))?;
            if read == 0 && !std::io::stdin().is_terminal() {
                self.is_silent = true;
            }
            match line.trim() {
                "" => return Ok(guess.to_owned()),
                answer => match check(answer) {
                    Ok(()) => return Ok(answer.to_owned()),
                    Err(why) => remark(&why),
                },
            }
        }
    }
}

/// Reads all files as they are said to be, and says what they hold.
fn read(files: &[PathBuf], layout: &Layout) -> Result<String, InputError> {
    let mut text = String::new();
    for path in files {
        let (recording, warnings) = Recording::read_as(path, layout)?;
        let range = |values: &[f64], unit: f64| {
            let low = values.iter().copied().fold(f64::INFINITY, f64::min);
            let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            format!("{} to {}", short(low / unit), short(high / unit))
        };
        let _ = writeln!(
            text,
            "{}: {} samples over {} s, pressure {} kPa, {} {}{}",
            path.display(),
            recording.len(),
            short(recording.duration()),
            range(&recording.pressure, PASCAL_PER_KPA),
            recording.measurand.name(),
            range(&recording.angle, 1f64.to_radians()),
            recording.measurand.unit(),
        );
        for remark in recording.remarks(warnings) {
            let _ = writeln!(text, "  {remark}");
        }
    }
    Ok(text)
}

/// Puts the section `[recording]` into a file, and leaves all else as it is.
fn write(path: &Path, layout: &Layout) -> Result<(), InputError> {
    let before = if path.exists() {
        read_text(path)?
    } else {
        "schema = 1\n".to_owned()
    };
    let broken = |error: toml_edit::TomlError| {
        InputError::new(
            error.message(),
            "correct the TOML there, or name another file with -o",
        )
        .in_file(path)
    };
    let mut document: DocumentMut = before.parse().map_err(broken)?;
    let section: DocumentMut = layout.to_toml().parse().map_err(broken)?;
    let section = section.get("recording").cloned();
    document["recording"] = section.unwrap_or_else(|| Item::Table(toml_edit::Table::new()));
    write_atomically(path, document.to_string().as_bytes())
}
