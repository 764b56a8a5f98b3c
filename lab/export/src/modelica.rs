//! Modelica: equations for the tool's own solver.
//!
//! The other languages repeat the steps of `softrig simulate`. A Modelica tool solves equations
//! with its own scheme and tolerance instead. So an integrated state is an equation, a dead
//! time is the language's `delay`, and an event memory is updated by a clock, as `softrig` does
//! after every step.

use std::cell::RefCell;

use serde::Serialize;

use super::physics::{Constant, Memory, PRESSURE};
use super::print::{Lines, Printer, Syntax};
use super::trace::{Binary, Expression, Id, Relation};
use super::{ExportError, Source, environment};
use softrig_formats::numbers::exact;
use softrig_formats::terminal::printable_line;

/// The template of a file.
const TEMPLATE: &str = include_str!("modelica.jinja");

/// How to use the file.
const USE: &[&str] = &[
    "Open the file and simulate Step, or give Actuator.pressure_kpa a signal. Time is that of",
    "the run: it starts at 0. These are the continuous equations; what comes out is as near",
    "to `softrig simulate` as the solver's tolerance is small and the signal is the same between",
    "the samples of a recording, where softrig has a cubic.",
];

/// The values for the template.
#[derive(Serialize)]
struct Filling<'a> {
    name: &'a str,
    header: String,
    title: String,
    signed_power: bool,
    parameters: Vec<String>,
    start_deg: String,
    start_deg_per_s: String,
    pressure_zero_kpa: String,
    angle_zero_deg: String,
    memories: Vec<String>,
    beginnings: Vec<String>,
    variables: Vec<String>,
    start: Vec<String>,
    equations: Vec<String>,
    notes: Vec<String>,
    delay: Option<String>,
}

struct Modelica<'a> {
    source: &'a Source<'a>,
    /// Definitions of shared subexpressions.
    defined: RefCell<Vec<String>>,
    /// Memories are meant as they were before an event.
    before: bool,
}

/// Whether a memory is kept by a clock. One that is integrated as well is not: what is noted
/// of it only keeps its digits, as whole turns that are taken off.
fn is_noted(memory: &Memory) -> bool {
    memory.noted.is_some() && memory.rate.is_none()
}

/// Writes a model.
///
/// # Errors
///
/// Errors of the template.
pub(super) fn export(source: &Source) -> Result<String, ExportError> {
    let physics = &source.physics;
    let syntax = |before| Modelica {
        source,
        defined: RefCell::default(),
        before,
    };
    let mut targets = vec![("der(rate)".to_owned(), physics.acceleration)];
    let mut start = vec![
        ("angle".to_owned(), physics.start[0]),
        ("rate".to_owned(), physics.start[1]),
    ];
    let mut notes = Vec::new();
    for memory in &physics.memories {
        let name = &memory.name;
        targets.extend(memory.rate.map(|id| (format!("der({name})"), id)));
        if is_noted(memory) {
            notes.extend(memory.noted.map(|id| (name.clone(), id)));
            start.push((format!("pre({name})"), memory.start));
        } else {
            start.push((name.clone(), memory.start));
        }
    }
    targets.push(("shown".to_owned(), physics.reading));
    let now = syntax(false);
    let equations = Printer::new(physics, &now).assignments(&targets);
    let before = syntax(true);
    let notes = Printer::new(physics, &before)
        .in_place()
        .assignments(&notes);
    let at_start = syntax(false);
    let (beginnings, start) = Printer::new(physics, &at_start)
        .apart("begin", &[PRESSURE])
        .assignments(&start)
        .into_iter()
        .partition(|line| line.starts_with("begin"));
    let results: Vec<Id> = targets.iter().map(|(_, id)| *id).collect();
    let signed_power = physics.tape.reached(&results).into_iter().any(|id| {
        matches!(
            physics.tape.get(id),
            Expression::Binary(Binary::SignedPower | Binary::Power, ..)
        )
    });
    let defaults = source.defaults;
    let filling = Filling {
        name: &source.name,
        header: source
            .header(USE)
            .iter()
            .map(|line| format!("// {line}").trim_end().to_owned())
            .collect::<Vec<_>>()
            .join("\n"),
        title: quoted(&source.file.name),
        signed_power,
        parameters: physics.constants.iter().map(parameter).collect(),
        start_deg: defaults.start_deg.map_or_else(
            || {
                let rest = source.expression(&syntax(false), physics.shown_at_rest);
                format!("({rest}) * degrees")
            },
            exact,
        ),
        start_deg_per_s: exact(defaults.start_deg_per_s),
        pressure_zero_kpa: exact(defaults.pressure_zero_kpa),
        angle_zero_deg: exact(defaults.angle_zero_deg),
        memories: physics
            .memories
            .iter()
            .map(|memory| {
                let kind = if is_noted(memory) {
                    "discrete Real"
                } else {
                    "Real"
                };
                format!("{kind} {} {};", memory.name, quoted(&memory.about))
            })
            .collect(),
        beginnings,
        variables: now.defined.take(),
        start,
        equations,
        notes,
        delay: physics
            .delay
            .map(|delay| source.expression(&syntax(false), delay)),
    };
    let mut environment = environment()?;
    environment.add_template("modelica", TEMPLATE)?;
    let template = environment.get_template("modelica")?;
    Ok(template.render(minijinja::value::Serde(&filling))?)
}

/// The line of a parameter.
fn parameter(constant: &Constant) -> String {
    let unit = if constant.unit.is_empty() {
        String::new()
    } else {
        format!("(unit = \"{}\")", constant.unit)
    };
    let about = quoted(&format!("{}: {}", constant.symbol, constant.about));
    let (name, value) = (&constant.name, constant.text());
    format!("parameter Real {name}{unit} = {value} {about};")
}

/// A string of Modelica.
fn quoted(text: &str) -> String {
    let text = printable_line(text)
        .replace('\\', "\\\\")
        .replace('"', "\\\"");
    format!("\"{text}\"")
}

impl Syntax for Modelica<'_> {
    fn symbol(&self, name: &str) -> String {
        let noted = |memory: &Memory| is_noted(memory) && memory.name == name;
        if self.before && self.source.physics.memories.iter().any(noted) {
            format!("pre({name})")
        } else {
            name.to_owned()
        }
    }
    /// Modelica has none: a solver stops at the root of a negative number.
    fn nan(&self) -> &'static str {
        "sqrt(-1.0)"
    }
    fn signed_power(&self, x: &str, y: &str) -> String {
        format!("signedPower({x}, {y})")
    }
    /// Without an event: every force is continuous where its formula changes.
    fn condition(&self, relation: Relation, left: &str, right: &str) -> String {
        let sign = match relation {
            Relation::Less => "<",
            Relation::NotGreater => "<=",
            Relation::Equal => "==",
        };
        format!("noEvent({left} {sign} {right})")
    }
    fn select(&self, condition: &str, yes: &str, no: &str) -> Option<String> {
        Some(format!("(if {condition} then {yes} else {no})"))
    }
    fn has_statements(&self) -> bool {
        false
    }
    fn define(&self, name: &str, value: &Lines, into: &mut Vec<String>) {
        self.defined.borrow_mut().push(name.to_owned());
        self.assign(name, value, into);
    }
    fn assign(&self, target: &str, value: &Lines, into: &mut Vec<String>) {
        into.push(format!(
            "{target} = {};",
            value.0.join(" ").replace("  ", " ")
        ));
    }
}
