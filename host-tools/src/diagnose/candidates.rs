//! Models with effects added, fitted.
//!
//! A candidate is the nominal structure with one effect more. It is fitted by
//! simulation from several starts: an effect and the base parameters trade off
//! against each other, and a single start often ends in the wrong valley.

use model_core::actuator::{MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::Kind;
use model_core::effects::{Parameter, Place, Unit};
use rayon::prelude::*;

use crate::fit::{Effort, Fit, Fitter};
use crate::model_file::ModelFile;

/// A structure (which effects were added) with its fit.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Effects added to the nominal model, in the order of the model.
    pub added: Vec<Kind>,
    /// The fit.
    pub fit: Fit,
}

impl Candidate {
    /// The added effects in the order of the catalogue: structures that differ
    /// in order alone are the same.
    pub fn set(&self) -> Vec<Kind> {
        let mut set = self.added.clone();
        set.sort_unstable();
        set
    }
}

/// The sizes that forces, angles and rates have in the recordings. Starts and
/// plausibility are relative to them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scales {
    /// Largest angle (rad).
    angle: f64,
    /// Spring force at the largest angle (N).
    force: f64,
    /// Rate of a swing to the largest angle (rad/s).
    rate: f64,
    /// Largest pressure (Pa).
    pressure: f64,
}

impl Scales {
    /// Takes the sizes from the nominal model and the recordings.
    pub fn of(fitter: &Fitter<'_, '_>) -> Self {
        let d = fitter.nominal.dynamics();
        let angle = fitter
            .runs
            .iter()
            .map(crate::fit::Run::reach)
            .fold(1e-3, f64::max);
        let pressure = fitter
            .runs
            .iter()
            .flat_map(|run| &run.recording.pressure)
            .fold(0.0, |largest: f64, p| largest.max(p.abs()));
        let spring = d.stiffness * angle.powf(d.exponent);
        let force = spring
            .max(d.input_gain.abs() * pressure)
            .max(f64::MIN_POSITIVE);
        Self {
            angle,
            force,
            rate: (force * angle / d.inertia).sqrt(),
            pressure,
        }
    }

    /// The natural size of a parameter in SI units: what its starts multiply.
    pub fn size(&self, row: &Parameter) -> f64 {
        match row.unit {
            Unit::Newton => self.force,
            Unit::NewtonPerRad => self.force / self.angle,
            Unit::NewtonPerRad3 => self.force / self.angle.powi(3),
            Unit::NewtonSecond2PerRad2 => self.force / self.rate.powi(2),
            Unit::RadianPerSecond => self.rate,
            Unit::KiloPascal => self.pressure,
            _ => 1.0,
        }
    }
}

/// Why an effect was not tried.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Untried {
    /// The effect.
    pub kind: Kind,
    /// The reason, as a clause.
    pub reason: &'static str,
}

/// The effects that the recordings can speak about, and the others with the
/// reason why not.
pub fn applicable(nominal: &Model<f64>, fitter: &Fitter<'_, '_>) -> (Vec<Kind>, Vec<Untried>) {
    let constant_input = fitter.runs.iter().all(|run| {
        let pressure = &run.recording.pressure;
        let first = pressure.first().copied().unwrap_or(0.0);
        pressure.iter().all(|p| (p - first).abs() < 1.0)
    });
    let mut tried = Vec::new();
    let mut untried = Vec::new();
    for &kind in Kind::ALL {
        if nominal.effects().any(|effect| effect.kind() == kind) {
            untried.push(Untried {
                kind,
                reason: "the model has it already",
            });
        } else if constant_input && kind.info().place == Place::Input {
            untried.push(Untried {
                kind,
                reason: "the pressure never changes in these recordings",
            });
        } else {
            tried.push(kind);
        }
    }
    (tried, untried)
}

/// The free parameters of a structure: those of the nominal model, and those
/// of the added effects that are not held.
pub fn free_parameters(file: &ModelFile, added: &[Kind]) -> Vec<ParameterId> {
    let first = file.model.effects().count();
    let mut free = file.free.clone();
    for (offset, kind) in added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            if row.held.is_none() {
                free.push(ParameterId::Effect {
                    slot: first + offset,
                    parameter,
                });
            }
        }
    }
    free
}

/// Adds one effect to a fitted structure and fits again. None if the model is
/// full, or cannot be simulated with it.
pub fn extend(
    file: &ModelFile,
    fitter: &Fitter<'_, '_>,
    scales: &Scales,
    base: &Candidate,
    kind: Kind,
    effort: Effort,
) -> Option<Candidate> {
    if file.model.effects().count() + base.added.len() >= MAX_EFFECTS {
        return None;
    }
    let mut added = base.added.clone();
    added.push(kind);
    let free = free_parameters(file, &added);
    let starts = starts(file, scales, base, kind);
    let fit = match effort {
        Effort::Full => fitter.fit_from(&starts, &free)?,
        Effort::Glance => starts
            .par_iter()
            .map(|start| fitter.fit(start, &free, Effort::Glance))
            .collect::<Vec<_>>()
            .into_iter()
            .filter(|fit| fit.sse().is_finite())
            .min_by(|a, b| a.sse().total_cmp(&b.sse()))?,
    };
    Some(Candidate { added, fit })
}

/// Fits a candidate on to the end from where it stands.
pub fn finish(file: &ModelFile, fitter: &Fitter<'_, '_>, candidate: &Candidate) -> Candidate {
    let free = free_parameters(file, &candidate.added);
    Candidate {
        added: candidate.added.clone(),
        fit: fitter.fit(&candidate.fit.model, &free, Effort::Full),
    }
}

/// Where fits of `base` with `kind` added start: at every combination of the
/// starts in the catalogue, with the base parameters as fitted without it and
/// as nominal.
fn starts(file: &ModelFile, scales: &Scales, base: &Candidate, kind: Kind) -> Vec<Model<f64>> {
    let mut values: Vec<Vec<f64>> = vec![Vec::new()];
    for row in kind.parameters() {
        let choices: Vec<f64> = match row.held {
            Some(held) => vec![f64::from(held)],
            None => row
                .starts
                .iter()
                .map(|start| f64::from(*start) * scales.size(row))
                .collect(),
        };
        values = values
            .into_iter()
            .flat_map(|head| {
                choices.iter().map(move |choice| {
                    let mut all = head.clone();
                    all.push(*choice);
                    all
                })
            })
            .collect();
    }
    let fitted = *base.fit.model.dynamics();
    let nominal = *file.model.dynamics();
    let mut models = Vec::new();
    for values in &values {
        let Some(effect) = kind.build(values) else {
            continue;
        };
        let effects: Vec<_> = base.fit.model.effects().copied().chain([effect]).collect();
        for dynamics in [fitted, nominal] {
            models.extend(Model::new(dynamics, &effects));
        }
    }
    models
}

/// Frees the held parameters of the added effects that have starts of their
/// own (the tilt of gravity), one variant for each start.
pub fn released(
    file: &ModelFile,
    fitter: &Fitter<'_, '_>,
    candidate: &Candidate,
) -> Option<Candidate> {
    let first = file.model.effects().count();
    let mut free = candidate.fit.free.clone();
    let mut models = Vec::new();
    for (offset, kind) in candidate.added.iter().enumerate() {
        for (parameter, row) in kind.parameters().iter().enumerate() {
            if row.held.is_some() && !row.starts.is_empty() {
                let id = ParameterId::Effect {
                    slot: first + offset,
                    parameter,
                };
                free.push(id);
                models.push(candidate.fit.model);
                models.extend(
                    row.starts
                        .iter()
                        .map(|start| candidate.fit.model.with_value(id, f64::from(*start))),
                );
            }
        }
    }
    let fit = fitter.fit_from(&models, &free)?;
    Some(Candidate {
        added: candidate.added.clone(),
        fit,
    })
}
