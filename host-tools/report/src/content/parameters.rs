//! The added effects and the parameters, with their intervals in the units of files.

use model_core::actuator::ParameterId;
use model_core::catalogue::Kind;
use model_core::effects::Place;
use serde::Serialize;

use super::words::{listed, probability};
use softrig::diagnose::{Diagnosis, Request};
use softrig::estimate::fit::Fit;
use softrig_formats::model_file::{parameter_name, parameter_unit, to_file_units};
use softrig_formats::numbers::{short, with_ends};

/// An effect that was added.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Effect {
    /// Name in files.
    pub kind: &'static str,
    /// Name in sentences.
    pub title: &'static str,
    /// Its equation.
    pub equation: String,
    /// Its description.
    pub text: &'static str,
    /// Where it acts.
    pub place: &'static str,
    /// Probability among the tried explanations; none for an effect that repairs the model
    /// and is not named.
    pub probability: Option<String>,
    /// A sentence about other formulas that push alike in these recordings, if there are any.
    pub alike: Option<String>,
    /// Its parameters.
    pub parameters: Vec<ParameterRow>,
}

impl Effect {
    /// How certain its name is.
    pub fn standing(&self) -> String {
        self.probability.as_ref().map_or_else(
            || "lowers the error, not named".into(),
            |probability| format!("probability {probability}"),
        )
    }
}

/// A parameter with its interval, in the unit of files.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ParameterRow {
    /// Name in files.
    pub name: String,
    /// Symbol in the equation.
    pub symbol: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// The value as supplied; none for an added effect.
    pub nominal: Option<String>,
    /// The value now.
    pub value: String,
    /// Whether it was fitted.
    pub free: bool,
    /// The ends of the 95 % interval, if there is one.
    pub interval: Option<[String; 2]>,
    /// Why there is none.
    pub unknown: &'static str,
    /// Whether it was fitted, or moved with those that were.
    pub changed: bool,
}

impl ParameterRow {
    /// The interval, or why there is none.
    pub fn certainty(&self) -> String {
        match &self.interval {
            Some([low, high]) => format!("95 %: {low} … {high}"),
            None => self.unknown.to_owned(),
        }
    }
}

/// A sentence about the formulas that push like this one.
fn alike(diagnosis: &Diagnosis, kind: Kind) -> Option<String> {
    let others: Vec<&str> = diagnosis
        .alike_to(kind)
        .map(|other| other.info().equation)
        .collect();
    (!others.is_empty())
        .then(|| format!("In these recordings {} would push alike.", listed(&others)))
}

/// Equation and parameters of each named effect.
pub(super) fn effects(diagnosis: &Diagnosis) -> Vec<Effect> {
    let fit = &diagnosis.repaired.fit;
    let first = effects_before(diagnosis);
    diagnosis
        .repaired
        .added
        .iter()
        .enumerate()
        .map(|(offset, kind)| {
            let info = kind.info();
            Effect {
                kind: info.name,
                title: info.title,
                equation: match fit.model.table().filter(|_| *kind == Kind::Table) {
                    Some(table) => format!("Q = piecewise linear in {}", table.of().symbol()),
                    None => info.equation.to_owned(),
                },
                text: info.text,
                place: match info.place {
                    Place::Input => "between the pressure sensor and the chamber",
                    Place::Force => "in the balance of forces",
                    Place::Sensor => "between the angle and what its sensor shows",
                },
                probability: diagnosis.finding.probability_of(*kind).map(probability),
                alike: alike(diagnosis, *kind),
                parameters: (0..kind.parameters().len())
                    .map(|parameter| ParameterId::Effect {
                        slot: first + offset,
                        parameter,
                    })
                    // Unused nodes of a table are not shown.
                    .filter(|&id| fit.model.value(id).is_some())
                    .map(|id| parameter_row(fit, id, None))
                    .collect(),
            }
        })
        .collect()
}

/// Number of effects that the model had before.
fn effects_before(diagnosis: &Diagnosis) -> usize {
    let all = diagnosis.repaired.fit.model.effects().count();
    all - diagnosis.repaired.added.len()
}

/// The parameters that the model had before: its five, and those of its
/// effects that were free.
pub(super) fn base(request: &Request<'_>, diagnosis: &Diagnosis) -> Vec<ParameterRow> {
    let fit = &diagnosis.repaired.fit;
    let first = effects_before(diagnosis);
    let of_effects = fit
        .free
        .iter()
        .copied()
        .filter(|id| matches!(id, ParameterId::Effect { slot, .. } if *slot < first));
    ParameterId::BASE
        .into_iter()
        .chain(of_effects)
        .map(|id| parameter_row(fit, id, request.file.model.value(id)))
        .collect()
}

fn parameter_row(fit: &Fit, id: ParameterId, nominal: Option<f64>) -> ParameterRow {
    let in_file = |value: f64| to_file_units(&fit.model, id, value);
    let name = parameter_name(&fit.model, id);
    let position = fit.free.iter().position(|&free| free == id);
    let ends = position
        .and_then(|index| fit.interval95(index))
        .filter(|(low, high)| (high - low).is_finite())
        .map(|(low, high)| [in_file(low), in_file(high)]);
    let value = fit.model.value(id).map(in_file);
    let (value, interval) = match (value, ends) {
        (Some(value), Some(ends)) => {
            let (value, ends) = with_ends(value, ends);
            (value, Some(ends))
        }
        (Some(value), None) => (short(value), None),
        (None, _) => (String::new(), None),
    };
    let nominal = nominal.map(|value| short(in_file(value)));
    let free = position.is_some();
    let moved = nominal.as_ref().is_some_and(|it| *it != value);
    ParameterRow {
        name: name.rsplit('.').next().unwrap_or(&name).to_owned(),
        symbol: fit.model.row(id).map_or("", |row| row.symbol),
        unit: parameter_unit(&fit.model, id),
        unknown: match (free, moved) {
            (true, _) => "not determined by these runs",
            (false, true) => "fixed: only ratios to it matter",
            (false, false) => "held",
        },
        changed: free || moved,
        nominal,
        value,
        free,
        interval,
    }
}
