//! The answer of a search: its rows, the decision from them, and what is written.
//!
//! Every structure that was fitted to all data is a row, whatever led to it. The decision
//! ([`super::decide`]) sees their errors; the repaired model is the best predictor among
//! those that hold what is named.

use model_core::catalogue::Kind;
use model_core::effects::table::Variable;
use rayon::prelude::*;

use super::budget::{SearchPart, tried_sizes};
use super::candidates::{Candidate, FitContext, finished, release, simulated};
use super::decide::{
    Decision, Scored, as_far_as_tried, decide, is_special_case, probabilities, shaped,
};
use super::discrepancy::log_densities;
use super::doubts::Doubt;
use super::draws::Draws;
use super::finding::{Explanation, Finding, NamedKind};
use super::measure::{MeasuredStructure, closed, closure, excess};
use super::noise::NoiseFloor;
use super::policy::Policy;
use super::progress::Stage;
use super::tables;
use super::validation::CrossValidator;
use crate::statistics::swing;
use softrig_formats::recording::Recording;

/// Number of rivals that are shown beside a name.
pub const RIVALS_SHOWN: usize = 3;

/// Number of rivals of an answer set that are shown.
const SET_SHOWN: usize = 5;

/// Number of rivals for which a run is planned.
pub const RIVALS_PLANNED: usize = 3;

/// A structure with a final fit, as shown in the report.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedStructure {
    /// The effects that were added.
    pub kinds: Vec<Kind>,
    /// RMS residual (rad).
    pub rmse: f64,
    /// RMS error on held-out runs (rad), and the share of the error beyond the noise that it
    /// closes there, over three horizons.
    pub held_out: Option<(f64, f64)>,
    /// How much less likely the held-out segments are than under the best of its size:
    /// twice the logarithm of the ratio of the densities.
    pub delta_bic: f64,
    /// Probability among the structures of its size.
    pub probability: f64,
    /// Whether it is rejected against the best of its size.
    pub rejected: bool,
    /// Parameters that ended at a bound of their search range.
    pub at_bound: Vec<String>,
}

/// The selection of a search.
#[derive(Clone, Debug)]
pub struct Selection {
    /// The answer.
    pub finding: Finding,
    /// The model that predicts held-out segments best, named or not; the refit where none
    /// is better.
    pub repaired: Candidate,
    /// Every structure with a final fit.
    pub tried: Vec<FittedStructure>,
    /// Rivals to separate by a further run, best first.
    pub rivals: Vec<Candidate>,
    /// The structure with the smallest residual, named or not.
    pub best: Option<Candidate>,
}

impl Selection {
    /// An answer that names nothing.
    pub fn nothing(finding: Finding, refit: &Candidate) -> Self {
        Self {
            finding,
            repaired: refit.clone(),
            tried: Vec::new(),
            rivals: Vec::new(),
            best: None,
        }
    }
}

/// Structures that were fitted under the same conditions, and the refit that they improve on.
pub struct Fitted {
    /// The refit.
    pub refit: MeasuredStructure,
    /// Structures with effects.
    pub rows: Vec<MeasuredStructure>,
}

/// A row, and the shares of its refit's error beyond the noise that it leaves.
struct Shares {
    row: MeasuredStructure,
    fitted: f64,
    held_out: f64,
    /// The place of that refit.
    refit: usize,
}

/// Rows with what the decision reads of them.
pub struct Rows {
    refit: Candidate,
    /// The first is that refit.
    all: Vec<MeasuredStructure>,
    scored: Vec<Scored>,
    /// The place of the refit that each row improves on.
    refits: Vec<usize>,
}

impl Rows {
    /// Of several fits of one structure, the one that leaves least is kept. The refit of
    /// `first` is the one that all are held against in the draws.
    pub fn of(
        first: Fitted,
        others: Option<Fitted>,
        validator: &CrossValidator<'_>,
        floor: &NoiseFloor,
        seed: u64,
    ) -> Self {
        let policy = &Policy::STANDARD;
        let noise = floor.total();
        let beyond = |error: f64| excess(error, noise, policy);
        let refit = first.refit.candidate.clone();
        let all = merged(std::iter::once(first).chain(others), beyond);
        let data = validator.fitter().data;
        let segments: Vec<Recording> = data.recordings(validator.in_turn());
        let best = all
            .iter()
            .map(|it| &it.row)
            .min_by(|a, b| a.held_out.full.total_cmp(&b.held_out.full));
        let angles: Vec<f64> = segments.iter().flat_map(|it| &it.angle).copied().collect();
        let accuracy = (policy.accuracy * swing(&angles)).max(f64::MIN_POSITIVE);
        let at_noise = policy.at_noise * validator.floor().max(noise);
        let draws = best.map(|best| {
            let residuals = validator.residuals_of(&best.candidate);
            Draws::of(&segments, &residuals, seed)
        });
        let scored = all
            .par_iter()
            .map(|it| {
                let row = &it.row;
                let (density, errors) = draws.as_ref().map_or_else(Default::default, |draws| {
                    let residuals = validator.residuals_of(&row.candidate);
                    draws.sums_and_errors(&log_densities(&residuals), &residuals)
                });
                Scored {
                    kinds: row.candidate.set(),
                    fitted: it.fitted,
                    held_out: it.held_out,
                    doubt: Doubt::of(&row.candidate, data),
                    degenerate: row.candidate.is_degenerate(),
                    rms: row.held_out.full / accuracy,
                    at_noise: row.held_out.full <= at_noise,
                    density,
                    error: errors.into_iter().map(beyond).collect(),
                }
            })
            .collect();
        Self {
            refit,
            refits: all.iter().map(|it| it.refit).collect(),
            all: all.into_iter().map(|it| it.row).collect(),
            scored,
        }
    }

    /// The selection: the named effects, and the model that predicts held-out segments
    /// best.
    pub fn selection(&self, context: &FitContext<'_>, validator: &CrossValidator<'_>) -> Selection {
        let policy = &Policy::STANDARD;
        let tried = tried_sizes(&context.executor.progress().undone());
        let mut decision =
            as_far_as_tried(decide(&self.scored, policy), &self.scored, tried, policy);
        let is_named = matches!(decision, Decision::Named { .. });
        let first = match &decision {
            Decision::Named { structure, .. } => Some(*structure),
            Decision::CannotTell { rivals, .. } => rivals.first().copied(),
            Decision::Unexplained { .. } => None,
        };
        context.executor.progress().stage(Stage::Augmented, 0);
        let Repaired {
            candidate: repaired,
            table_leaves,
        } = self.repaired(context, validator, first, is_named);
        let shape = first
            .filter(|_| repaired.added.len() == 2)
            .and_then(|row| tables::own_variable(*self.scored[row].kinds.first()?))
            .filter(|&own| repaired.fit.model.table().is_some_and(|it| it.of() == own));
        if let Some(left) = table_leaves.filter(|_| shape.is_some()) {
            decision = shaped(decision, &self.scored, left, policy);
        }
        let best = self
            .all
            .iter()
            .min_by(|a, b| a.fitted.full.total_cmp(&b.fitted.full));
        let rivals = match &decision {
            Decision::CannotTell { rivals, .. } => rivals.as_slice(),
            _ => &[],
        };
        Selection {
            tried: self.tried(&decision, validator.floor()),
            best: best.map(|row| row.candidate.clone()),
            rivals: rivals
                .iter()
                .take(RIVALS_PLANNED)
                .map(|&row| self.all[row].candidate.clone())
                .collect(),
            finding: self.finding(decision, shape, &repaired.added),
            repaired,
        }
    }

    /// The decision with the effects in place of rows, those that are named in the order of
    /// the repaired model. `shape` is the variable of its table.
    fn finding(&self, decision: Decision, shape: Option<Variable>, repaired: &[Kind]) -> Finding {
        match decision {
            Decision::Named {
                structure,
                strength,
            } => {
                let kinds = &self.scored[structure].kinds;
                let others = self.of_size(kinds.len());
                let others = others.into_iter().filter(|(row, _)| *row != structure);
                Finding::Named {
                    effects: self.inclusion(
                        repaired
                            .iter()
                            .copied()
                            .filter(|kind| kinds.contains(kind))
                            .collect(),
                    ),
                    strength,
                    rivals: self.explanations(others, RIVALS_SHOWN),
                }
            }
            Decision::CannotTell {
                rivals,
                families,
                strength,
            } => {
                let size = self.scored[rivals[0]].kinds.len();
                let shares = probabilities(&self.scored, size, &Policy::STANDARD);
                let total: f64 = rivals.iter().map(|&row| shares[row]).sum();
                let of_all = |row: usize| shares[row] / total.max(f64::MIN_POSITIVE);
                let rows = rivals.into_iter().map(|row| (row, of_all(row)));
                let mut explanations = self.explanations(rows, SET_SHOWN);
                match shape.filter(|_| explanations.len() == 1) {
                    Some(of) => Finding::Shape {
                        of,
                        formula: explanations.remove(0),
                        families,
                        strength,
                    },
                    None => Finding::undecided(explanations, families, strength),
                }
            }
            Decision::Unexplained { .. } => Finding::Unexplained {
                closest: self.explanations(self.of_size(1), RIVALS_SHOWN),
            },
        }
    }

    /// The structures of a size with their probabilities, the one that leaves least first.
    fn of_size(&self, size: usize) -> Vec<(usize, f64)> {
        let mut rows: Vec<usize> = (0..self.scored.len())
            .filter(|&row| self.scored[row].kinds.len() == size)
            .collect();
        rows.sort_by(|&a, &b| self.scored[a].leaves().total_cmp(&self.scored[b].leaves()));
        let shares = probabilities(&self.scored, size, &Policy::STANDARD);
        rows.into_iter().map(|row| (row, shares[row])).collect()
    }

    /// The probability of each effect: the sum over the structures of that size that hold
    /// it, or an effect of which it is a special case.
    fn inclusion(&self, named: Vec<Kind>) -> Vec<NamedKind> {
        let rows = self.of_size(named.len());
        let stands_for = |own: Kind, kind: Kind| own == kind || own.special_case() == Some(kind);
        named
            .into_iter()
            .map(|kind| NamedKind {
                kind,
                probability: rows
                    .iter()
                    .filter(|(row, _)| {
                        let mut kinds = self.scored[*row].kinds.iter();
                        kinds.any(|&own| stands_for(own, kind))
                    })
                    .map(|(_, share)| share)
                    .sum(),
            })
            .collect()
    }

    /// Rows with their probabilities, as explanations.
    fn explanations(
        &self,
        rows: impl IntoIterator<Item = (usize, f64)>,
        most: usize,
    ) -> Vec<Explanation> {
        rows.into_iter()
            .take(most)
            .map(|(row, probability)| Explanation {
                kinds: self.scored[row].kinds.clone(),
                probability,
                delta_bic: self.behind(row),
            })
            .collect()
    }

    /// Twice the logarithm of how much less likely the held-out segments are than under the
    /// best structure of that size.
    fn behind(&self, row: usize) -> f64 {
        let density =
            |row: &Scored| row.density.iter().sum::<f64>() / row.density.len().max(1) as f64;
        let size = self.scored[row].kinds.len();
        let best = self
            .scored
            .iter()
            .filter(|other| other.kinds.len() == size)
            .map(density)
            .fold(f64::NEG_INFINITY, f64::max);
        2.0 * (best - density(&self.scored[row]))
    }

    /// Every structure, those of one size by what they leave.
    fn tried(&self, decision: &Decision, noise: f64) -> Vec<FittedStructure> {
        let stays = |row: usize| match decision {
            Decision::Named { structure, .. } => *structure == row,
            Decision::CannotTell { rivals, .. } => rivals.contains(&row),
            Decision::Unexplained { .. } => false,
        };
        let largest = self
            .scored
            .iter()
            .map(|row| row.kinds.len())
            .max()
            .unwrap_or(0);
        (1..=largest)
            .flat_map(|size| self.of_size(size))
            .map(|(place, probability)| {
                let row = &self.all[place];
                let before = self.all[self.refits[place]].held_out.values();
                let closes = closure(&before, &row.held_out.values(), noise);
                FittedStructure {
                    kinds: row.candidate.added.clone(),
                    rmse: row.fitted.full,
                    held_out: Some((row.held_out.full, closes.overall)),
                    delta_bic: self.behind(place),
                    probability,
                    rejected: !stays(place),
                    at_bound: row.candidate.at_bound(),
                }
            })
            .collect()
    }

    /// The repaired model: the first structure of the answer, or one that contains it and
    /// leaves clearly less error. Where no effect is named, what it is a special case of will
    /// do; without an answer, the structure with the least error. The refit if none predicts
    /// held-out segments better.
    fn repaired(
        &self,
        context: &FitContext<'_>,
        validator: &CrossValidator<'_>,
        first: Option<usize>,
        is_named: bool,
    ) -> Repaired {
        let policy = &Policy::STANDARD;
        let refit = &self.refit;
        let takes_part = |place: &usize| {
            let row = &self.scored[*place];
            match first.map(|first| &self.scored[first]) {
                Some(named) => {
                    (named.kinds.iter().all(|kind| row.kinds.contains(kind))
                        || !is_named && is_special_case(&named.kinds, &row.kinds))
                        && row.leaves() <= policy.adds_to_repair * named.leaves()
                        && row.held_out <= policy.adds_to_repair * named.held_out
                }
                None => !row.kinds.is_empty() && row.leaves() < 1.0,
            }
        };
        let least = (0..self.scored.len())
            .filter(takes_part)
            .min_by(|&a, &b| self.scored[a].leaves().total_cmp(&self.scored[b].leaves()));
        let error = |candidate: &Candidate| validator.error_of(candidate);
        let most = policy.worth_writing * error(refit);
        let by_name = least
            .into_iter()
            .chain(first)
            .map(|row| everything(context, validator, &self.all[row].candidate))
            .find(|candidate| error(candidate) <= most)
            .unwrap_or_else(|| match first {
                Some(first) => everything(context, validator, &self.all[first].candidate),
                None => refit.clone(),
            });
        let enough = policy.adds_to_repair * error(&by_name);
        let table = (enough > validator.floor()
            && context.executor.progress().may_begin(SearchPart::Table))
        .then(|| tables::with_table(context, &by_name))
        .flatten()
        .filter(|with_table| error(with_table) <= enough)
        // Over whole runs alone it could spoil the prediction one swing ahead.
        .filter(|with_table| {
            let closes = closed(validator, &by_name, with_table);
            closes.overall >= 1.0 - policy.adds_to_repair
        });
        match table {
            Some(candidate) => Repaired {
                table_leaves: Some([
                    candidate.fit.rmse() / by_name.fit.rmse(),
                    error(&candidate) / error(&by_name),
                ]),
                candidate,
            },
            None => Repaired {
                candidate: by_name,
                table_leaves: None,
            },
        }
    }
}

/// All rows with their shares; of several fits of one structure, the one that leaves least.
fn merged(fitted: impl Iterator<Item = Fitted>, beyond: impl Fn(f64) -> f64) -> Vec<Shares> {
    let mut all: Vec<Shares> = Vec::new();
    for Fitted { refit, rows } in fitted {
        let before = [refit.fitted.full, refit.held_out.full].map(&beyond);
        let place = all.len();
        all.push(Shares {
            row: refit,
            fitted: 1.0,
            held_out: 1.0,
            refit: place,
        });
        for row in rows {
            let share = Shares {
                fitted: beyond(row.fitted.full) / before[0],
                held_out: beyond(row.held_out.full) / before[1],
                refit: place,
                row,
            };
            let set = share.row.candidate.set();
            match all.iter_mut().find(|it| it.row.candidate.set() == set) {
                Some(known) if known.fitted * known.held_out <= share.fitted * share.held_out => {}
                Some(known) => *known = share,
                None => all.push(share),
            }
        }
    }
    all
}

/// The repaired model.
struct Repaired {
    candidate: Candidate,
    /// If it has a table, the shares of the formulas' error that are left with the table:
    /// fitted, held out.
    table_leaves: Option<[f64; 2]>,
}

/// A structure as shown and written: by a final output-error fit, or as fitted at a
/// shorter horizon, with the residuals of a simulation.
fn everything(
    context: &FitContext<'_>,
    validator: &CrossValidator<'_>,
    candidate: &Candidate,
) -> Candidate {
    if candidate.level.is_some() {
        return simulated(context, candidate);
    }
    with_released(context, validator, finished(context, candidate))
}

/// Frees parameters that were held at first (the tilt of gravity), if the fit gains more than
/// they cost (Schwarz, Ann. Stat. 6, 1978) and held-out runs do not get worse. Otherwise they
/// stay held, and the intervals of the others allow for their uncertainty.
fn with_released(
    context: &FitContext<'_>,
    validator: &CrossValidator<'_>,
    mut candidate: Candidate,
) -> Candidate {
    let Ok(freed) = release(context, &candidate) else {
        return candidate;
    };
    let (fit, wider) = (&candidate.fit, &freed.fit);
    let more = wider.free.len() - fit.free.len();
    let independent = (wider.samples() as f64 / wider.correlation_time()).max(2.0);
    let gained = independent * libm::log(fit.sse() / wider.sse()) + fit.departure - wider.departure;
    if gained >= more as f64 * libm::log(independent)
        && validator.error_of(&freed) < validator.error_of(&candidate)
    {
        return freed;
    }
    let held = &freed.fit.free[candidate.fit.free.len()..];
    context.fitter.allow_for(&mut candidate.fit, held);
    candidate
}
