//! Python 3, without packages.

use super::print::{Lines, Syntax, common_name, indented};
use super::trace::Unary;
use super::{ExportError, Source, aligned};

/// The template of a file.
const TEMPLATE: &str = include_str!("python.jinja");

/// How to use the file.
const USE: &[&str] = &[
    "As a program:   python3 FILE.py recording.csv -o simulated.csv",
    "In a program:   from FILE import simulate",
    "                angle_deg = simulate(time_s, pressure_kpa)",
    "Times and pressures are lists, NumPy arrays or anything else that has numbers in it.",
];

struct Python<'a>(&'a Source<'a>);

/// Writes a model.
///
/// # Errors
///
/// Errors of the template.
pub(super) fn export(source: &Source) -> Result<String, ExportError> {
    let header: String = source
        .header(USE)
        .iter()
        .map(|line| format!("# {line}").trim_end().to_owned() + "\n")
        .collect();
    let constants: Vec<[String; 3]> = source
        .physics
        .constants
        .iter()
        .map(|constant| {
            let about = format!("# {}: {}", constant.symbol, constant.about);
            [constant.name.to_uppercase(), constant.text(), about]
        })
        .collect();
    source.filled(
        "python",
        TEMPLATE,
        &Python(source),
        &header,
        &aligned(&constants, "= "),
    )
}

impl Syntax for Python<'_> {
    fn symbol(&self, name: &str) -> String {
        if self.0.is_constant(name) {
            name.to_uppercase()
        } else {
            name.to_owned()
        }
    }
    fn place(&self, state: usize) -> String {
        format!("x[{state}]")
    }
    fn rate_place(&self, state: usize) -> String {
        format!("dx[{state}]")
    }
    fn nan(&self) -> &'static str {
        "math.nan"
    }
    fn name(&self, function: Unary) -> &'static str {
        match function {
            Unary::Log => "math.log",
            Unary::Tanh => "math.tanh",
            other => common_name(other),
        }
    }
    fn select(&self, condition: &str, yes: &str, no: &str) -> Option<String> {
        Some(format!("({yes} if {condition} else {no})"))
    }
    fn define(&self, name: &str, value: &Lines, into: &mut Vec<String>) {
        self.assign(name, value, into);
    }
    fn assign(&self, target: &str, value: &Lines, into: &mut Vec<String>) {
        let text = if value.is_long() {
            format!("{target} = (\n    {}\n)", value.joined(""))
        } else {
            format!("{target} = {}", value.joined(""))
        };
        into.extend(text.lines().map(str::to_owned));
    }
    fn branch(&self, condition: &str, yes: &[String], no: &[String], into: &mut Vec<String>) {
        into.push(format!("if {condition}:"));
        into.extend(indented(yes));
        into.push("else:".to_owned());
        into.extend(indented(no));
    }
}
