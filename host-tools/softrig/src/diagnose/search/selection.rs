//! What a search leaves for the answer: its rows, and the model that is written.
//!
//! Every structure that was fitted to all data is a row, whatever led to it. The ranking
//! ([`mod@crate::diagnose::decide`]) sees their errors; the repaired model is the best predictor among
//! those that hold what remains.

use model_core::catalogue::Kind;
use model_core::effects::table::Variable;
use rayon::prelude::*;

use crate::diagnose::decide::{
    Beside, Ranking, StructureScore, behind, is_special_case, of_size, offers_terms, rank,
    remembers_in_vain,
};
use crate::diagnose::evidence::alike::push_alike;
use crate::diagnose::evidence::discrepancy::log_densities;
use crate::diagnose::evidence::doubts::Doubt;
use crate::diagnose::evidence::draws::Draws;
use crate::diagnose::evidence::measure::{MeasuredStructure, closed, closure, excess};
use crate::diagnose::evidence::validation::CrossValidator;
use crate::diagnose::fit::candidates::{Candidate, FitContext, finished, release, simulated};
use crate::diagnose::fit::tables;
use crate::diagnose::recordings::noise::NoiseFloor;
use crate::diagnose::score::grammar::is_term;
use crate::diagnose::work::budget::{SearchPart, tried_sizes};
use crate::diagnose::work::policy::Policy;
use crate::diagnose::work::progress::Stage;
use crate::estimate::Dataset;
use crate::statistics::swing;
use softrig_formats::recording::Recording;

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

/// What a search leaves for the answer.
pub struct Selection {
    /// Every structure that was fitted to all data; none where nothing is missing.
    pub rows: Rows,
    /// What remains of them.
    pub ranking: Ranking,
    /// The model that predicts held-out segments best, named or not; the refit where none
    /// is better.
    pub repaired: Candidate,
    /// If that has a table of the own variable of the first of what remains, what it leaves.
    pub beside: Option<Beside>,
}

impl Selection {
    /// Without any structure but the refit, or with structures of which none explains what little
    /// that leaves.
    pub fn nothing(rows: Rows, refit: &Candidate) -> Self {
        Self {
            rows,
            ranking: Ranking::default(),
            repaired: refit.clone(),
            beside: None,
        }
    }

    /// The structures that remain, to be separated by a further run, best first.
    pub fn rivals(&self) -> Vec<Candidate> {
        let rivals = self.ranking.rivals.iter().take(RIVALS_PLANNED);
        rivals
            .map(|&row| self.rows.all[row].candidate.clone())
            .collect()
    }

    /// The structure with the smallest residual, named or not.
    pub fn best(&self) -> Option<&Candidate> {
        let rows = self.rows.all.iter();
        rows.min_by(|a, b| a.fitted.full.total_cmp(&b.fitted.full))
            .map(|row| &row.candidate)
    }

    /// Every structure as shown, those of one size by what they leave, beside this noise (rad) of
    /// the held-out segments.
    pub fn tried(&self, noise: f64) -> Vec<FittedStructure> {
        let Rows {
            all,
            scored,
            refits,
            ..
        } = &self.rows;
        let largest = scored.iter().map(|row| row.kinds.len()).max().unwrap_or(0);
        (1..=largest)
            .flat_map(|size| of_size(scored, size, &Policy::STANDARD))
            .map(|(place, probability)| {
                let row = &all[place];
                let before = all[refits[place]].held_out.values();
                let closes = closure(&before, &row.held_out.values(), noise);
                FittedStructure {
                    kinds: row.candidate.added.clone(),
                    rmse: row.fitted.full,
                    held_out: Some((row.held_out.full, closes.overall)),
                    delta_bic: behind(scored, place),
                    probability,
                    rejected: !self.ranking.rivals.contains(&place),
                    at_bound: row.candidate.at_bound(),
                }
            })
            .collect()
    }
}

/// Structures that were fitted under the same conditions, and the refit that they improve on.
pub struct FittedStructures {
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
#[derive(Default)]
pub struct Rows {
    /// The first is the refit that all are held against in the draws.
    all: Vec<MeasuredStructure>,
    /// What the decision reads of them.
    pub scored: Vec<StructureScore>,
    /// The place of the refit that each row improves on.
    refits: Vec<usize>,
    /// Terms that push like one of the rows: that one, and they.
    pub alike: Vec<[Kind; 2]>,
}

impl Rows {
    /// Of several fits of one structure, the one that leaves least is kept. The refit of
    /// `first` is the one that all are held against in the draws.
    pub fn of(
        first: FittedStructures,
        others: Option<FittedStructures>,
        validator: &CrossValidator<'_>,
        floor: &NoiseFloor,
        seed: u64,
    ) -> Self {
        let policy = &Policy::STANDARD;
        let noise = floor.total();
        let beyond = |error: f64| excess(error, noise, policy);
        let all = merged(std::iter::once(first).chain(others), beyond);
        let data = validator.fitter().data;
        let segments: Vec<Recording> = data.recordings(validator.in_turn());
        let is_known = |it: &&MeasuredStructure| !it.candidate.added.iter().any(|it| is_term(*it));
        let best = all
            .iter()
            .map(|it| &it.row)
            .filter(is_known)
            .min_by(|a, b| a.held_out.full.total_cmp(&b.held_out.full));
        let angles: Vec<f64> = segments.iter().flat_map(|it| &it.angle).copied().collect();
        let accuracy = (policy.accuracy * swing(&angles)).max(f64::MIN_POSITIVE);
        let at_noise = policy.at_noise * validator.floor().max(noise);
        let draws = best.map(|best| {
            let residuals = validator.residuals_of(&best.candidate);
            Draws::of(&segments, &residuals, seed)
        });
        let scored: Vec<StructureScore> = all
            .par_iter()
            .map(|it| {
                let row = &it.row;
                let (density, errors) = draws.as_ref().map_or_else(Default::default, |draws| {
                    let residuals = validator.residuals_of(&row.candidate);
                    draws.sums_and_errors(&log_densities(&residuals), &residuals)
                });
                StructureScore {
                    kinds: row.candidate.set(),
                    fitted: it.fitted,
                    held_out: it.held_out,
                    doubt: Doubt::of(&row.candidate, &all[it.refit].row.candidate, data),
                    degenerate: row.candidate.is_degenerate(),
                    rms: row.held_out.full / accuracy,
                    at_noise: row.held_out.full <= at_noise,
                    density,
                    error: errors.into_iter().map(beyond).collect(),
                }
            })
            .collect();
        let offers = offers_terms(&scored, policy);
        let (terms, effects): (Vec<_>, Vec<_>) = all
            .into_iter()
            .zip(scored)
            .partition(|(_, scored)| scored.is_term());
        let mut rows = Self::default();
        for (share, scored) in effects {
            rows.push(share, scored);
        }
        if offers {
            rows.take_terms(terms, data);
        }
        rows
    }

    fn push(&mut self, share: Shares, scored: StructureScore) {
        self.refits.push(share.refit);
        self.all.push(share.row);
        self.scored.push(scored);
    }

    /// Takes terms, the one that leaves least of those that push alike. They come after the effects,
    /// so that the places of the refits stay.
    fn take_terms(&mut self, mut terms: Vec<(Shares, StructureScore)>, data: &Dataset) {
        // A further parameter has to leave clearly less.
        let weighed = |(share, scored): &(Shares, StructureScore)| {
            let parameters = share.row.candidate.fit.free.len() as f64;
            scored.leaves() / libm::pow(Policy::STANDARD.sure_leaves, parameters)
        };
        let all: Vec<StructureScore> = terms.iter().map(|(_, scored)| scored.clone()).collect();
        terms.retain(|(_, scored)| !remembers_in_vain(scored, &all, &Policy::STANDARD));
        terms.sort_by(|a, b| weighed(a).total_cmp(&weighed(b)));
        let first = self.all.len();
        for (share, scored) in terms {
            let own = &share.row.candidate;
            let mut known = self.all[first..]
                .iter()
                .map(|row| &row.candidate)
                .filter(|known| known.added.len() == 1 && own.added.len() == 1);
            match known.find(|known| push_alike(own, known, data)) {
                Some(known) => {
                    let pair = [known, own].map(|it| it.added.last().copied());
                    if let [Some(known), Some(own)] = pair {
                        self.alike.push([known, own]);
                    }
                }
                None => self.push(share, scored),
            }
        }
    }

    /// What remains of the structures.
    pub fn ranking(&self, context: &FitContext<'_>) -> Ranking {
        let tried = tried_sizes(&context.executor.job().allowance.undone());
        rank(&self.scored, tried, &Policy::STANDARD)
    }

    /// What is written of a ranking.
    pub fn selection(
        self,
        ranking: Ranking,
        context: &FitContext<'_>,
        validator: &CrossValidator<'_>,
    ) -> Selection {
        context.executor.job().progress.stage(Stage::Augmented, 0);
        let RepairedModel {
            candidate: repaired,
            table_leaves,
        } = self.repaired(context, validator, &ranking);
        let of = ranking
            .first()
            .and_then(|row| all_of_one_variable(&self.scored[row].kinds, &repaired));
        Selection {
            beside: of
                .zip(table_leaves)
                .map(|(of, leaves)| Beside { of, leaves }),
            rows: self,
            ranking,
            repaired,
        }
    }

    /// The repaired model: the first structure of the answer, or one that contains it and
    /// leaves clearly less error. Where no effect is named, what it is a special case of will
    /// do; without an answer, the structure with the least error. The refit if none predicts
    /// held-out segments better.
    fn repaired(
        &self,
        context: &FitContext<'_>,
        validator: &CrossValidator<'_>,
        ranking: &Ranking,
    ) -> RepairedModel {
        let policy = &Policy::STANDARD;
        let first = ranking.first();
        let refit = &self.all[0].candidate;
        let takes_part = |place: &usize| {
            let row = &self.scored[*place];
            match first.map(|first| &self.scored[first]) {
                Some(named) => {
                    (named.kinds.iter().all(|kind| row.kinds.contains(kind))
                        || !ranking.is_firm && is_special_case(&named.kinds, &row.kinds))
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
            && context.executor.job().may_begin(SearchPart::Table))
        .then(|| tables::with_table(context, &by_name))
        .flatten()
        .filter(|with_table| error(with_table) <= enough)
        // Over whole runs alone it could spoil the prediction one swing ahead.
        .filter(|with_table| {
            let closes = closed(validator, &by_name, with_table);
            closes.overall >= 1.0 - policy.adds_to_repair
        });
        match table {
            Some(candidate) => {
                // Effects of its variable that help it are parts of its shape.
                let alone = first
                    .filter(|_| by_name.added.len() > 1)
                    .filter(|&row| {
                        all_of_one_variable(&self.scored[row].kinds, &candidate).is_some()
                    })
                    .map(|row| everything(context, validator, &self.all[row].candidate));
                let formula = alone.as_ref().unwrap_or(&by_name);
                RepairedModel {
                    table_leaves: Some([
                        candidate.fit.rmse() / formula.fit.rmse(),
                        error(&candidate) / error(formula),
                    ]),
                    candidate,
                }
            }
            None => RepairedModel {
                candidate: by_name,
                table_leaves: None,
            },
        }
    }
}

/// The variable of an effect by itself, if the repaired model has a table of it and nothing else
/// beside the effect that is no function of it.
fn all_of_one_variable(named: &[Kind], repaired: &Candidate) -> Option<Variable> {
    let [named] = named else { return None };
    let own = named.info().own_variable?;
    let table = repaired.fit.model.table()?;
    let is_of_it = |kind: &Kind| *kind == Kind::Table || kind.info().own_variable == Some(own);
    (table.of() == own && repaired.added.iter().all(is_of_it)).then_some(own)
}

/// All rows with their shares; of several fits of one structure, the one that leaves least.
fn merged(
    fitted: impl Iterator<Item = FittedStructures>,
    beyond: impl Fn(f64) -> f64,
) -> Vec<Shares> {
    let mut all: Vec<Shares> = Vec::new();
    for FittedStructures { refit, rows } in fitted {
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
struct RepairedModel {
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
