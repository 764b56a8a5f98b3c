//! A MATLAB function, which GNU Octave runs as well.

use super::print::{Lines, Syntax, common_name, indented};
use super::trace::Unary;
use super::{ExportError, Source, aligned};

/// The template of a file.
const TEMPLATE: &str = include_str!("matlab.jinja");

struct Matlab<'a>(&'a Source<'a>);

/// Writes a model.
///
/// # Errors
///
/// Errors of the template.
pub(super) fn export(source: &Source) -> Result<String, ExportError> {
    let name = &source.name;
    let how = [
        format!("  angle_deg = {name}(time_s, pressure_kpa)"),
        format!("  angle_deg = {name}(time_s, pressure_kpa, struct('start_deg', 10))"),
        "Options: start_deg and start_deg_per_s, what the sensor shows at the first sample;"
            .to_owned(),
        "pressure_zero_kpa and angle_zero_deg, what the sensors show without pressure and at 0;"
            .to_owned(),
        "largest_angle_deg, up to which steps are fine enough.".to_owned(),
    ];
    let how: Vec<&str> = how.iter().map(String::as_str).collect();
    let mut header = vec![format!(
        "    %{} Simulates what the angle sensor shows.",
        name.to_uppercase()
    )];
    let comment = source.header(&how);
    header.extend(
        comment
            .iter()
            .map(|line| format!("    % {line}").trim_end().to_owned()),
    );
    let constants: Vec<[String; 3]> = source
        .physics
        .constants
        .iter()
        .map(|constant| {
            let about = format!("% {}: {}", constant.symbol, constant.about);
            let name = format!("    p.{}", constant.name);
            [name, format!("{};", constant.text()), about]
        })
        .collect();
    source.filled(
        "matlab",
        TEMPLATE,
        &Matlab(source),
        &(header.join("\n") + "\n"),
        &aligned(&constants, "= "),
    )
}

impl Syntax for Matlab<'_> {
    fn symbol(&self, name: &str) -> String {
        if self.0.is_constant(name) {
            format!("p.{name}")
        } else {
            name.to_owned()
        }
    }
    fn place(&self, state: usize) -> String {
        format!("x({})", state + 1)
    }
    fn rate_place(&self, state: usize) -> String {
        format!("dx({})", state + 1)
    }
    fn nan(&self) -> &'static str {
        "NaN"
    }
    fn name(&self, function: Unary) -> &'static str {
        match function {
            // Elsewhere a number of two parts.
            Unary::Log => "reallog",
            other => common_name(other),
        }
    }
    fn select(&self, _condition: &str, _yes: &str, _no: &str) -> Option<String> {
        None
    }
    fn define(&self, name: &str, value: &Lines, into: &mut Vec<String>) {
        self.assign(name, value, into);
    }
    fn assign(&self, target: &str, value: &Lines, into: &mut Vec<String>) {
        let text = format!("{target} = {};", value.joined(" ..."));
        into.extend(text.lines().map(str::to_owned));
    }
    fn branch(&self, condition: &str, yes: &[String], no: &[String], into: &mut Vec<String>) {
        into.push(format!("if {condition}"));
        into.extend(indented(yes));
        into.push("else".to_owned());
        into.extend(indented(no));
        into.push("end".to_owned());
    }
}
