//! Models as files of other languages: `softrig export`.
//!
//! An exported model can be used in a controller, in Simulink, in OpenModelica or in the supplement
//! of a paper. It needs nothing from this repository and gives the results of `softrig simulate`.
//!
//! The physics is not written again. [`trace`] runs `model-core` itself on a scalar that records the
//! computation, [`physics`] collects the expressions of a model, and [`print`](mod@print) prints them
//! in the syntax of a language. The integrator is a template for each language, with the constants of
//! [`softrig::sim::simulate`]; tests compare the results of C, Python and MATLAB. A functional mock-up
//! unit is the C file behind another interface.

#![forbid(unsafe_code)]
// A room's first page names its modules, also those that no other crate sees.
#![allow(rustdoc::private_intra_doc_links)]

mod c;
mod fmu;
mod matlab;
mod modelica;
mod physics;
mod print;
mod python;
mod trace;

use model_core::catalogue::Effect;
use serde::Serialize;

pub use self::fmu::Packed;
use self::physics::Physics;
use self::print::{Printer, Syntax};
use self::trace::{Binary, Expression, Id, TooManyBranches, Unary};
use softrig::sim::simulate;
use softrig_formats::model_file::{ModelFile, WRITTEN_BY_EXPORT, node_in_file};
use softrig_formats::numbers::exact;
use softrig_formats::terminal::printable_line;

/// What a model can be written in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Language {
    /// C99: a program, or functions for a controller
    C,
    /// Python 3 without packages
    Python,
    /// A Modelica package
    Modelica,
    /// A MATLAB function, for GNU Octave too
    Matlab,
}

impl Language {
    /// Every language.
    pub const ALL: [Self; 4] = [Self::C, Self::Python, Self::Modelica, Self::Matlab];

    /// The extension of a file.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::C => "c",
            Self::Python => "py",
            Self::Modelica => "mo",
            Self::Matlab => "m",
        }
    }
}

/// Where runs of an exported model start if nothing else is said, and how finely they step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Defaults {
    /// The sensor's first reading (°); none for an actuator at rest at 0.
    pub start_deg: Option<f64>,
    /// Its rate (°/s).
    pub start_deg_per_s: f64,
    /// The zero of the pressure sensor (kPa).
    pub pressure_zero_kpa: f64,
    /// The zero of the angle sensor (°).
    pub angle_zero_deg: f64,
    /// Steps are fine enough for angles up to this one (°).
    pub largest_angle_deg: f64,
}

impl Default for Defaults {
    fn default() -> Self {
        Self {
            start_deg: None,
            start_deg_per_s: 0.0,
            pressure_zero_kpa: 0.0,
            angle_zero_deg: 0.0,
            largest_angle_deg: 180.0,
        }
    }
}

/// Why a model could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// Its effects branch too much.
    #[error("the model {0}")]
    Branches(#[from] TooManyBranches),
    /// The template and what it is filled with do not fit together.
    #[error("cannot fill the template: {0}")]
    Template(#[from] minijinja::Error),
    /// A unit could not be packed.
    #[error("cannot pack the unit: {0}")]
    Archive(#[from] zip::result::ZipError),
}

/// Writes a model as a file of a language, to be called `name`.
///
/// # Errors
///
/// If its effects have too many branches together to be written down.
pub fn export(
    file: &ModelFile,
    language: Language,
    name: &str,
    defaults: Defaults,
) -> Result<String, ExportError> {
    let source = Source::of(file, name, defaults)?;
    match language {
        Language::C => c::export(&source),
        Language::Python => python::export(&source),
        Language::Matlab => matlab::export(&source),
        Language::Modelica => modelica::export(&source),
    }
}

/// Packs a model as a functional mock-up unit for co-simulation (FMI 2.0), to be called `name`.
///
/// # Errors
///
/// As [`export`].
pub fn functional_mockup_unit(
    file: &ModelFile,
    name: &str,
    defaults: Defaults,
) -> Result<Packed, ExportError> {
    fmu::pack(&Source::of(file, name, defaults)?)
}

/// A name that every language takes: letters, digits and underscores.
pub fn identifier(name: &str) -> String {
    let mut found: String = name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() { c } else { '_' })
        .take(48)
        .collect();
    if !found.starts_with(|c: char| c.is_ascii_alphabetic()) {
        found.insert_str(0, "model_");
    }
    found
}

/// The source of an exported file.
struct Source<'a> {
    file: &'a ModelFile,
    physics: Physics,
    /// The name of the function, model or package.
    name: String,
    defaults: Defaults,
}

/// Numbers of the scheme and of the start, as text.
#[derive(Serialize)]
struct Numbers {
    most_substeps: usize,
    angle_a_step: String,
    slow: String,
    longest_gap: String,
    diverged: String,
    start_deg_per_s: String,
    pressure_zero_kpa: String,
    angle_zero_deg: String,
    largest_angle_deg: String,
}

/// The values for the template of a language with steps.
#[derive(Serialize)]
struct Filling<'a> {
    name: &'a str,
    header: &'a str,
    constants: &'a str,
    states: usize,
    state_names: String,
    /// Numbers of the states that have no rate.
    still: Vec<usize>,
    derivative: String,
    reading: String,
    showing: String,
    note: Option<String>,
    fastest: String,
    decay: String,
    /// Code that sets `width`, `saturated` and `signs` of the frictions.
    friction: Option<String>,
    delay: Option<String>,
    shown_at_rest: String,
    start_deg: Option<String>,
    about_defaults: &'static str,
    uses: Uses,
    n: Numbers,
}

/// Which helpers a model needs.
#[derive(Serialize)]
struct Uses {
    signed_power: bool,
    exp: bool,
    sine: bool,
}

impl<'a> Source<'a> {
    fn of(file: &'a ModelFile, name: &str, defaults: Defaults) -> Result<Self, ExportError> {
        Ok(Self {
            file,
            physics: Physics::of(&file.model)?,
            name: identifier(name),
            defaults,
        })
    }

    fn is_constant(&self, name: &str) -> bool {
        let constants = &self.physics.constants;
        constants.iter().any(|constant| constant.name == name)
    }

    /// Names of the states, in their order.
    fn states(&self) -> Vec<&str> {
        let memories = self.physics.memories.iter().map(|memory| &*memory.name);
        [physics::ANGLE, physics::RATE]
            .into_iter()
            .chain(memories)
            .collect()
    }

    /// Names that expressions are of.
    fn names_in(&self, results: &[Id]) -> Vec<String> {
        let tape = &self.physics.tape;
        let reached = tape.reached(results).into_iter();
        reached
            .filter_map(|id| match tape.get(id) {
                Expression::Symbol(symbol) => Some(tape.name(symbol).to_owned()),
                _ => None,
            })
            .collect()
    }

    /// The lines that give each target its value, behind those that give states a name.
    fn body(&self, syntax: &impl Syntax, targets: &[(String, Id)], by_name: bool) -> Vec<String> {
        let results: Vec<Id> = targets.iter().map(|(_, id)| *id).collect();
        let names = self.names_in(&results);
        let mut lines = Vec::new();
        for (place, name) in self.states().into_iter().enumerate() {
            if by_name && names.iter().any(|used| used == name) {
                let value = print::Lines(vec![syntax.place(place)]);
                syntax.define(&syntax.symbol(name), &value, &mut lines);
            }
        }
        lines.extend(Printer::new(&self.physics, syntax).assignments(targets));
        lines
    }

    fn expression(&self, syntax: &impl Syntax, id: Id) -> String {
        Printer::new(&self.physics, syntax).expression(id)
    }

    /// Fills the template of a language that has arrays and steps.
    fn filled(
        &self,
        language: &str,
        template: &str,
        syntax: &impl Syntax,
        header: &str,
        constants: &str,
    ) -> Result<String, ExportError> {
        let physics = &self.physics;
        let tape = &physics.tape;
        let indented = |lines: Vec<String>| {
            let lines: Vec<String> = lines.iter().map(|line| format!("    {line}")).collect();
            lines.join("\n")
        };
        let mut rates = vec![(syntax.rate_place(1), physics.acceleration)];
        let mut start = Vec::new();
        let mut noted = Vec::new();
        for (place, id) in physics.start.into_iter().enumerate() {
            start.push((syntax.place(place), id));
        }
        for (place, memory) in (2..).zip(&physics.memories) {
            rates.extend(memory.rate.map(|id| (syntax.rate_place(place), id)));
            noted.extend(memory.noted.map(|id| (syntax.place(place), id)));
            start.push((syntax.place(place), memory.start));
        }
        let still = (2..)
            .zip(&physics.memories)
            .filter(|(_, memory)| memory.rate.is_none())
            .map(|(place, _)| place)
            .collect();
        let fastest = ["stiffness", "relaxation"]
            .map(str::to_owned)
            .into_iter()
            .zip(physics.fastest)
            .collect::<Vec<_>>();
        let everything: Vec<Id> = [&rates, &start, &noted, &fastest]
            .into_iter()
            .flatten()
            .map(|(_, id)| *id)
            .chain([physics.reading])
            .collect();
        let used = |is: fn(Expression) -> bool| {
            tape.reached(&everything)
                .into_iter()
                .any(|id| is(tape.get(id)))
        };
        let defaults = self.defaults;
        let filling = Filling {
            name: &self.name,
            header,
            constants,
            states: self.states().len(),
            state_names: self.states().join(", "),
            still,
            derivative: indented(self.body(syntax, &rates, true)),
            reading: indented(self.body(syntax, &[("shown".to_owned(), physics.reading)], true)),
            showing: indented(self.body(syntax, &start, false)),
            note: (!noted.is_empty()).then(|| indented(self.body(syntax, &noted, true))),
            fastest: indented(self.body(syntax, &fastest, false)),
            decay: self.expression(syntax, physics.decay),
            friction: physics.friction.map(|friction| {
                let targets = [
                    ("width", friction.width),
                    ("saturated", friction.saturated),
                    ("signs", friction.relaxation),
                ];
                let targets = targets.map(|(name, id)| (name.to_owned(), id));
                indented(self.body(syntax, &targets, false))
            }),
            delay: physics.delay.map(|delay| self.expression(syntax, delay)),
            shown_at_rest: self.expression(syntax, physics.shown_at_rest),
            start_deg: defaults.start_deg.map(exact),
            about_defaults: if defaults.start_deg.is_some() {
                "Initial state and zeros estimated from a recording."
            } else {
                "Starts at rest at zero; sensor zeros are exact."
            },
            uses: Uses {
                signed_power: used(|e| {
                    matches!(
                        e,
                        Expression::Binary(Binary::Power | Binary::SignedPower, ..)
                    )
                }),
                exp: used(|e| matches!(e, Expression::Unary(Unary::Exp, _))),
                sine: used(|e| matches!(e, Expression::Unary(Unary::Sin | Unary::Cos, _))),
            },
            n: Numbers {
                most_substeps: simulate::MOST_SUBSTEPS,
                angle_a_step: exact(simulate::Grain::Fine.angle_a_step()),
                slow: exact(simulate::SLOW),
                longest_gap: exact(simulate::LONGEST_GAP),
                diverged: exact(simulate::DIVERGED),
                start_deg_per_s: exact(defaults.start_deg_per_s),
                pressure_zero_kpa: exact(defaults.pressure_zero_kpa),
                angle_zero_deg: exact(defaults.angle_zero_deg),
                largest_angle_deg: exact(defaults.largest_angle_deg),
            },
        };
        let mut environment = environment()?;
        environment.add_template(language, template)?;
        Ok(environment
            .get_template(language)?
            .render(minijinja::value::Serde(&filling))?)
    }

    /// The comment that a file begins with: what it is, of what, and how to use it. Names
    /// are harmless in a line, not yet in a comment.
    fn header(&self, how: &[&str]) -> Vec<String> {
        let model = &self.file.model;
        let mut lines = vec![
            format!(
                "Model \"{}\" of a soft pneumatic bending actuator.",
                printable_line(&self.file.name)
            ),
            String::new(),
            format!(
                "{WRITTEN_BY_EXPORT} of softrig {}. It needs nothing else.",
                env!("CARGO_PKG_VERSION")
            ),
            String::new(),
            "M θ'' + C θ' + K sign(θ)|θ|ⁿ + Q = F,  F = g·p".to_owned(),
        ];
        for effect in model.effects() {
            let info = effect.kind().info();
            lines.push(format!("{}: {}", info.name, info.equation));
            if let Effect::Table(table) = effect {
                let of = table.of();
                let nodes = table
                    .nodes()
                    .iter()
                    .map(|&node| exact(node_in_file(of, node)));
                let nodes: Vec<String> = nodes.collect();
                lines.push(format!(
                    "    of the {}, nodes at {} {}",
                    of.name(),
                    nodes.join(", "),
                    of.unit().symbol()
                ));
            }
        }
        lines.extend([
            String::new(),
            "θ bending angle (rad), ω = θ' its rate (rad/s), p gauge pressure in the line and p_c".to_owned(),
            "in the chamber (Pa), y what the angle sensor shows (rad), Q and F generalised forces (N).".to_owned(),
            "Pressures go in as kPa, angles come out in degrees; inside, everything is in SI units.".to_owned(),
            String::new(),
        ]);
        lines.extend(how.iter().map(|&line| line.to_owned()));
        lines
    }
}

/// Where templates are filled: lines of instructions leave nothing behind.
fn environment() -> Result<minijinja::Environment<'static>, minijinja::Error> {
    let mut environment = minijinja::Environment::new();
    environment.set_syntax(
        minijinja::syntax::SyntaxConfig::builder()
            .trim_blocks(true)
            .lstrip_blocks(true)
            .keep_trailing_newline(true)
            .build()?,
    );
    environment.set_undefined_behavior(minijinja::UndefinedBehavior::Strict);
    Ok(environment)
}

/// Rows of a name, a value and a comment, each in its column.
fn aligned(rows: &[[String; 3]], equals: &str) -> String {
    let width = |column: usize| rows.iter().map(|row| row[column].chars().count()).max();
    let [names, values] = [0, 1].map(|column| width(column).unwrap_or_default());
    rows.iter()
        .map(|[name, value, about]| format!("{name:names$} {equals}{value:values$}  {about}"))
        .collect::<Vec<_>>()
        .join("\n")
}

/// The example of the README is one that works.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
pub struct Readme;
