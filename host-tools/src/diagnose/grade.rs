//! Grades structures by what they explain, where some model error always remains.
//!
//! On a real rig no structure leaves only noise. Structures are fitted at several
//! horizons and measured, and what they explain decides: single effects first, then the
//! best of them with each other effect.

use std::collections::BTreeSet;

use model_core::catalogue::Kind;
use rayon::prelude::*;

use super::Progress;
use super::budget::{Part, tried_sizes};
use super::candidates::{Candidate, FitContext, coarse_fit, final_fit};
use super::decide::{Decision, Scored, as_far_as_tried, decide, shaped};
use super::levels::{Estimate, Levels};
use super::measure::{Baseline, MeasureContext, Measured, closed};
use super::noise::NoiseFloor;
use super::pairs;
use super::policy::{Exact, Policy};
use super::selection::{FittedStructure, RIVALS_PLANNED, RIVALS_SHOWN, Selection, names};
use super::tables;
use super::validation::CrossValidator;
use super::verdict::{Alternative, Answer};
use crate::estimate::fit::Fit;

/// Number of structures of each size to which another effect is added.
const LEADS: usize = 2;

/// The graded structures and the decision.
pub struct Graded {
    /// The decision.
    pub decision: Decision,
    /// Every structure that was measured.
    pub measured: Vec<Measured>,
}

/// The repaired model.
struct Repaired {
    candidate: Candidate,
    /// If it has a table, the shares of the formulas' error that are left with the table:
    /// fitted, held out.
    table_leaves: Option<[f64; 2]>,
}

/// Number of pairs that are fitted for their predicted SSE: some effects help only together.
const JOINED: usize = 4;

/// Folds of the cross-validation while structures are measured.
const FOLDS: usize = 4;

/// Number of combinations with a final fit by output error, in case one leaves only
/// noise.
const FINISHED: usize = 3;

impl Graded {
    /// Whether any structure may leave only noise after its final fit: then the exact
    /// formulas decide.
    pub fn may_leave_noise(&self, floor: &NoiseFloor) -> bool {
        let Some(best) = self.nearest() else {
            return true;
        };
        let floor = floor.clone().with_repeats(&best.candidate.fit.residuals);
        let left = best.estimate.fits.last().map_or(0.0, Fit::rmse);
        left <= Exact::STANDARD.may_leave * floor.rms.hypot(floor.input)
    }

    /// The structure with the least output error.
    fn nearest(&self) -> Option<&Measured> {
        let left = |row: &Measured| row.estimate.fits.last().map_or(f64::INFINITY, Fit::sse);
        self.measured
            .iter()
            .min_by(|a, b| left(a).total_cmp(&left(b)))
    }

    /// The same structure, if its residuals are those of a simulation.
    pub fn simulated(&self) -> Option<&Candidate> {
        self.nearest()
            .map(|row| &row.candidate)
            .filter(|candidate| candidate.level.is_none())
    }

    /// The combinations with the least output error, by final fits.
    pub fn finished(&self, context: &FitContext<'_>) -> Vec<Candidate> {
        let mut rows: Vec<(f64, &Measured)> = self
            .measured
            .iter()
            .filter(|row| row.scored.kinds.len() > 1)
            .filter_map(|row| Some((row.estimate.fits.last()?.sse(), row)))
            .collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        rows.truncate(FINISHED);
        context
            .progress
            .stage("final fits of the best combinations", rows.len());
        rows.par_iter()
            .filter(|_| context.progress.has_time_for(Part::Combinations))
            .filter_map(|(_, row)| {
                let fit = row.estimate.fits.last()?.clone();
                Some(final_fit(
                    context,
                    &Candidate::of(row.estimate.added.clone(), fit),
                ))
            })
            .collect()
    }

    /// The selection: the named effects, and the model that predicts held-out segments
    /// best.
    pub fn selection(
        mut self,
        context: &FitContext<'_>,
        validator: &CrossValidator<'_>,
        refit: &Candidate,
    ) -> Selection {
        let first = match &self.decision {
            Decision::Named { structure, .. } => Some(*structure),
            Decision::CannotTell { rivals, .. } => rivals.first().copied(),
            Decision::Unexplained { .. } => None,
        };
        context
            .progress
            .stage("validation of the augmented model", 0);
        // Of rivals, the best predictor is written.
        let representative = match &self.decision {
            Decision::CannotTell { rivals, .. } => {
                let leaves = |row: &usize| self.measured[*row].scored.leaves;
                let best = rivals.iter().min_by(|a, b| leaves(a).total_cmp(&leaves(b)));
                best.copied()
            }
            _ => first,
        };
        let Repaired {
            candidate: repaired,
            table_leaves,
        } = self.repaired(context, validator, refit, representative);
        let shape = first
            .filter(|_| repaired.added.len() == 2)
            .and_then(|row| tables::own_variable(*self.measured[row].scored.kinds.first()?))
            .filter(|&own| repaired.fit.model.table().is_some_and(|it| it.of() == own));
        if let Some(left) = table_leaves.filter(|_| shape.is_some()) {
            let scored: Vec<Scored> = self.measured.iter().map(|row| row.scored.clone()).collect();
            self.decision = shaped(self.decision, &scored, left, &Policy::STANDARD);
        }
        let shown = first.map_or(1, |row| self.measured[row].scored.kinds.len());
        let (tried, alternatives) = self.standings(first, shown);
        let base = Selection {
            tried,
            best: self.nearest().map(|row| row.candidate.clone()),
            ..Selection::nothing(Answer::Unexplained, &repaired)
        };
        match &self.decision {
            Decision::Named {
                structure,
                strength,
            } => {
                let named = self.measured[*structure].scored.kinds.clone();
                let alternatives = alternatives
                    .into_iter()
                    .filter(|(row, _)| row != structure)
                    .map(|(_, alternative)| alternative)
                    .take(RIVALS_SHOWN)
                    .collect();
                Selection {
                    answer: Answer::EffectFound,
                    probability: vec![1.0; named.len()],
                    named,
                    strength: Some(*strength),
                    alternatives,
                    ..base
                }
            }
            Decision::CannotTell {
                rivals,
                families,
                strength,
            } => Selection {
                shape: shape.filter(|_| rivals.len() == 1),
                answer: Answer::CannotTell,
                strength: Some(*strength),
                families: families.clone(),
                rivals: rivals
                    .iter()
                    .take(RIVALS_PLANNED)
                    .map(|&row| self.measured[row].candidate.clone())
                    .collect(),
                alternatives: alternatives
                    .into_iter()
                    .filter(|(row, _)| rivals.contains(row))
                    .map(|(_, alternative)| alternative)
                    .take(RIVALS_SHOWN)
                    .collect(),
                ..base
            },
            Decision::Unexplained { .. } => Selection {
                alternatives: alternatives
                    .into_iter()
                    .map(|(_, alternative)| alternative)
                    .take(RIVALS_SHOWN)
                    .collect(),
                ..base
            },
        }
    }

    /// The repaired model: the first structure of the answer, or a larger one that contains
    /// it and leaves clearly less error. If nothing is named, the structure with the least
    /// error. The refit if none predicts held-out segments better.
    fn repaired(
        &self,
        context: &FitContext<'_>,
        validator: &CrossValidator<'_>,
        refit: &Candidate,
        first: Option<usize>,
    ) -> Repaired {
        let policy = &Policy::STANDARD;
        let first = first.map(|row| &self.measured[row]);
        let takes_part = |row: &&Measured| match first {
            Some(first) => {
                let named = &first.scored.kinds;
                named.iter().all(|kind| row.scored.kinds.contains(kind))
                    && row.scored.leaves <= policy.adds_to_repair * first.scored.leaves
                    && row.held_out.full <= policy.adds_to_repair * first.held_out.full
            }
            None => row.scored.evidence > 0.0,
        };
        let least = self
            .measured
            .iter()
            .filter(takes_part)
            .min_by(|a, b| a.scored.leaves.total_cmp(&b.scored.leaves));
        let error = |candidate: &Candidate| validator.error_of(candidate);
        let most = policy.worth_writing * error(refit);
        let by_name = least
            .into_iter()
            .chain(first)
            .map(|row| everything(context, row))
            .find(|candidate| error(candidate) <= most)
            .unwrap_or_else(|| match first {
                Some(first) => everything(context, first),
                None => refit.clone(),
            });
        let enough = policy.adds_to_repair * error(&by_name);
        let table = (enough > validator.floor() && context.progress.has_time_for(Part::Table))
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

    /// Every measured structure, and those of the leader's size as alternatives by
    /// evidence.
    fn standings(
        &self,
        first: Option<usize>,
        size: usize,
    ) -> (Vec<FittedStructure>, Vec<(usize, Alternative)>) {
        let policy = &Policy::STANDARD;
        let best = |size: usize| {
            self.measured
                .iter()
                .filter(|row| row.scored.kinds.len() == size)
                .map(|row| row.scored.evidence)
                .fold(f64::NEG_INFINITY, f64::max)
        };
        let weight = |row: &Measured| {
            let size = row.scored.kinds.len();
            let most = match first {
                Some(first) if self.measured[first].scored.kinds.len() == size => {
                    self.measured[first].scored.evidence
                }
                _ => best(size),
            };
            let margin = policy.rival_least.max(policy.rival_share * most);
            // At the limit a rival is a twentieth as probable.
            let behind = (most - row.scored.evidence).max(0.0);
            (behind, (-behind / margin * 20f64.ln()).exp())
        };
        let total = |size: usize| -> f64 {
            self.measured
                .iter()
                .filter(|row| row.scored.kinds.len() == size)
                .map(|row| weight(row).1)
                .sum()
        };
        let totals = [1, 2, 3].map(total);
        let rivals: &[usize] = match &self.decision {
            Decision::CannotTell { rivals, .. } => rivals,
            _ => &[],
        };
        let mut tried = Vec::new();
        let mut alternatives = Vec::new();
        for (index, row) in self.measured.iter().enumerate() {
            let kinds = &row.scored.kinds;
            let (behind, weight) = weight(row);
            let probability = weight / totals[kinds.len() - 1];
            tried.push(FittedStructure {
                kinds: row.estimate.added.clone(),
                rmse: row.estimate.fits.last().map_or(f64::INFINITY, Fit::rmse),
                held_out: Some((row.held_out.full, row.scored.closure.overall)),
                delta_bic: behind,
                vuong_statistic: 0.0,
                probability,
                rejected: first != Some(index) && !rivals.contains(&index),
                at_bound: row.candidate.at_bound(),
            });
            if kinds.len() == size {
                let alternative = Alternative {
                    kinds: names(kinds),
                    probability,
                    delta_bic: behind,
                };
                alternatives.push((index, alternative));
            }
        }
        tried.sort_by(|a, b| {
            (a.kinds.len(), a.delta_bic)
                .partial_cmp(&(b.kinds.len(), b.delta_bic))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        alternatives.sort_by(|a, b| b.1.probability.total_cmp(&a.1.probability));
        (tried, alternatives)
    }
}

/// A structure as shown and written: by a final output-error fit, or as fitted at a
/// shorter horizon, with the residuals of a simulation.
fn everything(context: &FitContext<'_>, row: &Measured) -> Candidate {
    let mut candidate = row.candidate.clone();
    if candidate.level.is_none() {
        return final_fit(context, &candidate);
    }
    let simulated = context.fitter.compare(&candidate.fit.model);
    candidate.fit.residuals = simulated.residuals;
    candidate.fit.nuisances = simulated.nuisances;
    candidate
}

/// Measures single effects and combinations, and decides; none if nothing could be
/// measured.
pub fn graded(
    context: &FitContext<'_>,
    validator: &CrossValidator<'_>,
    floor: &NoiseFloor,
    kinds: &[Kind],
    refit: &Candidate,
    coarse: &[Candidate],
    progress: &Progress,
) -> Option<Graded> {
    let policy = &Policy::STANDARD;
    let noise = floor.rms.hypot(floor.input);
    let levels = Levels::of(*context, refit, noise);
    progress.stage("nominal structure at several horizons", 0);
    let base = levels.base(refit)?;
    let in_turn = validator
        .in_turn()
        .then(|| CrossValidator::with_folds(context.file, context.fitter, floor.input, FOLDS));
    let measuring = MeasureContext {
        levels: &levels,
        subsample: context.subsample,
        fitter: context.fitter,
        validator: in_turn.as_ref().unwrap_or(validator),
        noise,
        policy,
    };
    progress.step("validation", base.fits.len());
    let baseline = measuring.baseline(base.clone())?;
    let screened = vec![0, levels.output_error().saturating_sub(1)];
    let mut search = Search {
        levels: &levels,
        measuring: &measuring,
        baseline: &baseline,
        kinds,
        measured: Vec::new(),
    };
    progress.stage(format!("{} effects at several horizons", kinds.len()), 0);
    search.extend(&[(&base, screened)], coarse);
    if !search.leaves_noise(1, noise) && progress.has_time_for(Part::Combinations) {
        progress.stage("combinations of 2 effects at several horizons", 0);
        let leads = search.leads(1);
        let leads: Vec<(&Estimate, Vec<usize>)> = leads
            .iter()
            .map(|(estimate, at)| (estimate, at.clone()))
            .collect();
        progress.step("pair screening", JOINED);
        let joined: Vec<Candidate> = pairs::ranked(context, refit, kinds)
            .par_iter()
            .take(JOINED)
            .filter(|_| progress.has_time_for(Part::Combinations))
            .filter_map(|predicted| coarse_fit(context, predicted))
            .collect();
        search.extend(&leads, &joined);
    }
    let measured = search.measured;
    let scored: Vec<Scored> = measured.iter().map(|row| row.scored.clone()).collect();
    let tried = tried_sizes(&progress.undone());
    (!measured.is_empty()).then(|| Graded {
        decision: as_far_as_tried(decide(&scored, policy), &scored, tried, policy),
        measured,
    })
}

/// A search under way.
struct Search<'a> {
    levels: &'a Levels<'a>,
    measuring: &'a MeasureContext<'a>,
    baseline: &'a Baseline,
    kinds: &'a [Kind],
    measured: Vec<Measured>,
}

impl Search<'_> {
    /// Extends each base by one further effect.
    fn extend(&mut self, bases: &[(&Estimate, Vec<usize>)], coarse: &[Candidate]) {
        let known: BTreeSet<Vec<Kind>> = self
            .measured
            .iter()
            .map(|row| row.scored.kinds.clone())
            .collect();
        let found = self.levels.extended(bases, self.kinds, coarse, &known);
        // A structure hardly better than a single effect is neither named nor a repair.
        let single = self
            .measured
            .iter()
            .map(|row| row.leaves_on_subsample)
            .fold(f64::INFINITY, f64::min);
        let most = self.measuring.policy.worth_writing * single;
        let measured = self.measuring.measure(self.baseline, found, most);
        self.measured.extend(measured);
    }

    fn of_size(&self, size: usize) -> Vec<&Measured> {
        let mut rows: Vec<&Measured> = self
            .measured
            .iter()
            .filter(|row| row.scored.kinds.len() == size)
            .collect();
        rows.sort_by(|a, b| a.scored.leaves.total_cmp(&b.scored.leaves));
        rows
    }

    /// The structures of a size with the least error, and the one with the most evidence,
    /// with the levels at which further effects are screened.
    fn leads(&self, size: usize) -> Vec<(Estimate, Vec<usize>)> {
        let rows = self.of_size(size);
        let mut leads: Vec<&Measured> = rows.iter().take(LEADS).copied().collect();
        let evidence = rows
            .iter()
            .max_by(|a, b| a.scored.evidence.total_cmp(&b.scored.evidence));
        if let Some(row) = evidence
            && leads
                .iter()
                .all(|lead| lead.scored.kinds != row.scored.kinds)
        {
            leads.push(row);
        }
        leads
            .into_iter()
            .map(|row| {
                let mut at = vec![row.level, self.levels.output_error()];
                at.dedup();
                (row.estimate.clone(), at)
            })
            .collect()
    }

    /// Whether the best structure of a size leaves hardly more than the noise.
    fn leaves_noise(&self, size: usize, noise: f64) -> bool {
        /// Multiple of the noise.
        const HARDLY_MORE: f64 = 1.1;
        self.of_size(size)
            .first()
            .is_some_and(|row| row.held_out.full <= HARDLY_MORE * noise)
    }
}
