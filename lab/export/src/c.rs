//! C99, for a workstation or a microcontroller.

use super::print::{Lines, Syntax, common_name, indented};
use super::trace::{Id, Unary};
use super::{ExportError, Source, aligned};

/// The template of a file.
const TEMPLATE: &str = include_str!("c.jinja");

struct C<'a>(&'a Source<'a>);

/// Writes a model.
///
/// # Errors
///
/// Errors of the template.
pub(super) fn export(source: &Source) -> Result<String, ExportError> {
    let syntax = C(source);
    let comment = source
        .header(USE)
        .iter()
        .map(|line| format!(" * {}", harmless(line)).trim_end().to_owned() + "\n")
        .collect::<String>();
    let constants: Vec<[String; 3]> = source
        .physics
        .constants
        .iter()
        .map(|constant| {
            let name = format!("static const double {}", constant.name.to_uppercase());
            let about = format!("/* {}: {} */", constant.symbol, constant.about);
            [name, format!("{};", constant.text()), about]
        })
        .collect();
    source.filled(
        "c",
        TEMPLATE,
        &syntax,
        &format!("/*\n{comment} */\n"),
        &aligned(&constants, "= "),
    )
}

/// An expression in C.
pub(super) fn expression(source: &Source, id: Id) -> String {
    source.expression(&C(source), id)
}

/// How to use the file.
const USE: &[&str] = &[
    "As a program:      cc -std=c99 -O2 -DSOFTRIG_MAIN FILE.c -lm -o model",
    "                   ./model recording.csv > simulated.csv",
    "In a program:      #include this file, then call softrig_run for a whole recording, or",
    "                   softrig_init once and softrig_step after every interval.",
    "It allocates nothing. Where a double has four bytes, as on an 8-bit Arduino, it",
    "computes in single precision.",
];

/// A line that does not end the comment that it is in.
fn harmless(line: &str) -> String {
    line.replace("*/", "* /")
        .replace("/*", "/ *")
        .replace("??/", "? ?/")
}

impl Syntax for C<'_> {
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
        "NAN"
    }
    fn name(&self, function: Unary) -> &'static str {
        match function {
            Unary::Absolute => "fabs",
            other => common_name(other),
        }
    }
    fn max(&self, x: &str, y: &str) -> String {
        format!("fmax({x}, {y})")
    }
    fn power(&self, x: &str, y: &str) -> String {
        format!("pow({x}, {y})")
    }
    fn select(&self, condition: &str, yes: &str, no: &str) -> Option<String> {
        Some(format!("({condition} ? {yes} : {no})"))
    }
    fn define(&self, name: &str, value: &Lines, into: &mut Vec<String>) {
        self.assign(&format!("const double {name}"), value, into);
    }
    fn assign(&self, target: &str, value: &Lines, into: &mut Vec<String>) {
        let text = format!("{target} = {};", value.joined(""));
        into.extend(text.lines().map(str::to_owned));
    }
    fn declare(&self, name: &str, into: &mut Vec<String>) {
        into.push(format!("double {name};"));
    }
    fn branch(&self, condition: &str, yes: &[String], no: &[String], into: &mut Vec<String>) {
        into.push(format!("if ({condition}) {{"));
        into.extend(indented(yes));
        into.push("} else {".to_owned());
        into.extend(indented(no));
        into.push("}".to_owned());
    }
}
