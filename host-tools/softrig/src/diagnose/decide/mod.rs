//! From measurements to an answer: one pure function, whatever the recordings are.
//!
//! Each fitted structure is a row of measurements ([`StructureScore`]); the constants are the
//! [`Policy`]. Nothing is simulated or fitted here.
//!
//! [`rank`] finds what remains of the structures, after which a table can be fitted beside the
//! leader; [`decide`] gives the answer, once in a diagnosis and nowhere else.

pub mod finding;
pub mod verdict;

use std::collections::BTreeSet;

use model_core::catalogue::Kind;
use model_core::effects::table::Variable;

use crate::diagnose::decide::finding::{Explanation, Finding, NamedKind};
use crate::diagnose::decide::verdict::Strength;
use crate::diagnose::evidence::doubts::Doubt;
use crate::diagnose::score::grammar::is_term;
use crate::diagnose::work::budget::{SearchPart, is_open, tried_sizes};
use crate::diagnose::work::policy::Policy;
use softrig_formats::family;

/// The measurements of one structure.
#[derive(Clone, Debug, PartialEq)]
pub struct StructureScore {
    /// Its effects, in the order of the catalogue; none for the refit.
    pub kinds: Vec<Kind>,
    /// Share of the error beyond the noise that it leaves on fitted segments.
    pub fitted: f64,
    /// The same on held-out segments.
    pub held_out: f64,
    /// Why it could not be named.
    pub doubt: Option<Doubt>,
    /// Whether an effect ended as its special case.
    pub degenerate: bool,
    /// RMS error on held-out segments, in units of what the best angle sensors are good for
    /// ([`Policy::accuracy`] of the range).
    pub rms: f64,
    /// Whether only noise is left on held-out segments.
    pub at_noise: bool,
    /// Log density of the held-out segments, in every draw.
    pub density: Vec<f64>,
    /// Error on held-out segments beyond the noise (rad), in every draw.
    pub error: Vec<f64>,
}

impl StructureScore {
    /// Whether it has a term of the grammar.
    pub fn is_term(&self) -> bool {
        self.kinds.iter().any(|kind| is_term(*kind))
    }

    /// Share of the error that it leaves, fitted and held out together.
    pub fn leaves(&self) -> f64 {
        (self.fitted * self.held_out).sqrt()
    }

    /// The probability that it predicts better than another.
    fn is_better(&self, other: &Self) -> f64 {
        let draws = self.density.iter().zip(&other.density);
        mean(draws.map(|(own, other)| 1.0 / (1.0 + libm::exp(other - own))))
    }

    /// The probability that it leaves at most this share of another's error.
    fn leaves_at_most(&self, share: f64, other: &Self) -> f64 {
        let draws = self.error.iter().zip(&other.error);
        mean(draws.map(|(own, other)| if *own <= share * other { 1.0 } else { 0.0 }))
    }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    values.sum::<f64>() / count
}

/// Number of rivals that are shown beside a name.
pub const RIVALS_SHOWN: usize = 3;

/// Number of rivals of an answer set that are shown.
const SET_SHOWN: usize = 5;

/// What these recordings leave of the structures; structures by their index.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranking {
    /// Those that cannot be distinguished, the one that leaves least first; none where no effect
    /// closes a part of the error.
    pub rivals: Vec<usize>,
    /// The one that they are held against; it may give way to its special case.
    pub leader: Option<usize>,
    /// Whether the only one of them may be named.
    pub is_firm: bool,
}

impl Ranking {
    /// The first of the structures that remain.
    pub fn first(&self) -> Option<usize> {
        self.rivals.first().copied()
    }
}

/// What a model leaves before any effect is added to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Remains {
    /// Only noise.
    Noise {
        /// Whether the parameters of the supplied model were off.
        refitted: bool,
    },
    /// More, and less than matters.
    Little {
        /// The same.
        refitted: bool,
    },
    /// More than that.
    #[default]
    More,
}

/// A table of its own variable beside the structure that leads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beside {
    /// The variable.
    pub of: Variable,
    /// The shares of the formula's error that are left with it, and with other effects of the same
    /// variable: fitted, held out.
    pub leaves: [f64; 2],
}

/// All that an answer rests on.
#[derive(Clone, Copy, Debug)]
pub struct Evidence<'a> {
    /// What is left without any effect.
    pub remains: Remains,
    /// Whether the noise is so large that an effect may hide below it.
    pub is_noisy: bool,
    /// Every structure that was fitted to all data.
    pub scored: &'a [StructureScore],
    /// What remains of them.
    pub ranking: &'a Ranking,
    /// A table beside the first of these.
    pub beside: Option<Beside>,
    /// The effects of the repaired model, in its order.
    pub repaired: &'a [Kind],
    /// What the time was not enough for.
    pub undone: &'a BTreeSet<SearchPart>,
}

/// The answer.
///
/// If a table of the leader's own variable, added beside its formula, leaves much less error, the
/// variable is right and the formula is not.
///
/// One structure without rivals and without a doubt is named. Otherwise the answer is the set, and
/// the family where all share it; of what was not tried to the end, that the time was up. Where only
/// noise is left, or less than matters and nothing explains it, nothing is missing.
pub fn decide(evidence: &Evidence<'_>, policy: &Policy) -> Finding {
    match evidence.remains {
        Remains::Noise { refitted } => return evidence.quiet(refitted, false),
        Remains::Little { refitted } if evidence.ranking.rivals.is_empty() => {
            return evidence.quiet(refitted, true);
        }
        Remains::Little { .. } | Remains::More => {}
    }
    match *evidence.ranking.rivals.as_slice() {
        [] if is_open(evidence.undone) => Finding::OutOfTime { closest: None },
        [] => Finding::Unexplained {
            closest: evidence.explanations(of_size(evidence.scored, 1, policy), RIVALS_SHOWN),
        },
        [only] => evidence.alone(only, policy),
        ref rivals => evidence.open(rivals, policy),
    }
}

impl Evidence<'_> {
    /// Nothing is missing, as far as the noise lets one see and the search went.
    fn quiet(&self, refitted: bool, immaterial: bool) -> Finding {
        if self.is_noisy {
            Finding::Noisy
        } else if refitted && is_open(self.undone) {
            Finding::OutOfTime { closest: None }
        } else {
            Finding::Quiet {
                refitted,
                immaterial,
            }
        }
    }

    /// One structure without rivals.
    fn alone(&self, row: usize, policy: &Policy) -> Finding {
        let kinds = &self.scored[row].kinds;
        let strength = self.strength(row, policy);
        let is_wrong = |it: &Beside| it.leaves.iter().all(|share| *share <= policy.shape);
        let is_named = self.ranking.is_firm && !self.beside.as_ref().is_some_and(is_wrong);
        let families = family::of_all(kinds);
        let chances = probabilities(self.scored, kinds.len(), policy);
        let (tried, open) = (tried_sizes(self.undone), is_open(self.undone));
        let out_of_time = if is_named { kinds.len() > tried } else { open };
        let this = |probability| self.explanation(row, probability);
        match self.beside {
            Some(Beside { of, .. }) if !is_named => Finding::Shape {
                of,
                formula: this(1.0),
                families,
                strength,
            },
            _ if out_of_time => Finding::OutOfTime {
                closest: Some(this(chances[row])),
            },
            _ if is_named => {
                let others = of_size(self.scored, kinds.len(), policy);
                let others = others.into_iter().filter(|(other, _)| *other != row);
                let order = self.repaired.iter().copied();
                Finding::Named {
                    effects: self.inclusions(order.filter(|kind| kinds.contains(kind)), policy),
                    strength,
                    rivals: self.explanations(others, RIVALS_SHOWN),
                }
            }
            _ => Finding::Trace {
                explanation: this(1.0),
                families,
                strength,
            },
        }
    }

    /// Structures that cannot be told apart.
    fn open(&self, rivals: &[usize], policy: &Policy) -> Finding {
        let first = &self.scored[rivals[0]];
        let families = family::of_all(&first.kinds);
        let are_one = rivals
            .iter()
            .all(|&row| family::of_all(&self.scored[row].kinds) == families);
        let chances = probabilities(self.scored, first.kinds.len(), policy);
        let total: f64 = rivals.iter().map(|&row| chances[row]).sum();
        let of_all = |row: usize| chances[row] / total.max(f64::MIN_POSITIVE);
        let rows = rivals.iter().map(|&row| (row, of_all(row)));
        Finding::Rivals {
            rivals: self.explanations(rows, SET_SHOWN),
            families: if are_one { families } else { Vec::new() },
            strength: self.strength(rivals[0], policy),
        }
    }

    /// How much of the error the leader explains, or `row` without one. A term was found among
    /// many, and has no history: it is the whole only if it leaves nothing but noise.
    fn strength(&self, row: usize, policy: &Policy) -> Strength {
        let leader = &self.scored[self.ranking.leader.unwrap_or(row)];
        let is_whole = leader.at_noise || !leader.is_term();
        if is_whole && leader.leaves() <= 1.0 - policy.explains {
            Strength::Explains
        } else {
            Strength::Part
        }
    }

    /// The probability of each effect: the sum over the structures of that size that hold it, or an
    /// effect that it is a special case of.
    fn inclusions(&self, named: impl Iterator<Item = Kind>, policy: &Policy) -> Vec<NamedKind> {
        let named: Vec<Kind> = named.collect();
        let rows = of_size(self.scored, named.len(), policy);
        let stands_for =
            |own: Kind, kind: Kind| own == kind || own.info().special_case == Some(kind);
        let holds = |row: usize, kind: Kind| {
            let mut kinds = self.scored[row].kinds.iter();
            kinds.any(|&own| stands_for(own, kind))
        };
        let sum_of = |kind: Kind| rows.iter().filter(move |(row, _)| holds(*row, kind));
        named
            .iter()
            .map(|&kind| NamedKind {
                kind,
                probability: sum_of(kind).map(|(_, share)| share).sum(),
            })
            .collect()
    }

    fn explanations(
        &self,
        rows: impl IntoIterator<Item = (usize, f64)>,
        most: usize,
    ) -> Vec<Explanation> {
        let rows = rows.into_iter().take(most);
        rows.map(|(row, probability)| self.explanation(row, probability))
            .collect()
    }

    fn explanation(&self, row: usize, probability: f64) -> Explanation {
        Explanation {
            kinds: self.scored[row].kinds.clone(),
            probability,
            delta_bic: behind(self.scored, row),
        }
    }
}

/// What remains of the structures. The refit has no effects; of several, the first counts. If not
/// all structures of more than `tried` effects were measured, a larger one that could be named
/// gives way to a smaller one within it that could be named alone.
///
/// 1. Of each size, the structure that leaves the least error leads, on fitted and held-out
///    segments together. A structure with a [`Doubt`] leads only where it leaves much less
///    than all others. Two effects of one family are one cause with a better formula and are
///    not an answer.
/// 2. A single effect is taken if it closes a part of the error; a larger structure, if it
///    leaves much less than the smaller one, fitted and held out, and than each of its effects
///    alone. Either must hold in the draws of a bootstrap, by its density or by its error.
/// 3. Rivals are structures of the same size that these recordings cannot distinguish from
///    the leader ([`odds`]). Where something is left beyond noise, every formula is wrong a
///    little: one of the same family is a rival unless it leaves clearly more error. One of
///    another family is a rival unless it leaves clearly more error or predicts worse in the
///    draws. Where only noise is left, the draws decide, and no difference counts that is finer
///    than any angle sensor. An effect that the leader can imitate (a dead time many lags in a
///    row) stays a rival as long as it explains the error.
/// 4. An effect whose special case predicts as well gives way to it. Beside one that ended as
///    its special case, that stays a rival if it alone would be taken.
pub fn rank(scored: &[StructureScore], tried: usize, policy: &Policy) -> Ranking {
    let ranking = ranked(scored, policy);
    let Some(first) = ranking.first().filter(|_| ranking.is_firm) else {
        return ranking;
    };
    let size = |row: usize| scored[row].kinds.len();
    if size(first) <= tried {
        return ranking;
    }
    let places: Vec<usize> = (0..scored.len())
        .filter(|&row| size(row) <= tried)
        .collect();
    let smaller: Vec<StructureScore> = places.iter().map(|&row| scored[row].clone()).collect();
    let within = ranked(&smaller, policy);
    let own = within.first().map(|row| places[row]);
    let is_within = |own: &usize| {
        let mut kinds = scored[*own].kinds.iter();
        kinds.all(|kind| scored[first].kinds.contains(kind))
    };
    match own.filter(|own| within.is_firm && is_within(own)) {
        Some(own) => Ranking {
            rivals: vec![own],
            leader: within.leader.map(|row| places[row]),
            is_firm: true,
        },
        None => Ranking {
            is_firm: false,
            ..ranking
        },
    }
}

/// Whether terms of the grammar take part. Where one of them leaves only noise: it leaves less than
/// every single effect, fitted and held out, by more than another formula would, and no more than the
/// combination that explains the recordings without any. Where it leaves more: nothing that has a
/// name explains a part of the error, and it leaves half of what every single effect does. A term is
/// one of many, and has no history; what has a name goes before it.
pub fn offers_terms(scored: &[StructureScore], policy: &Policy) -> bool {
    let (terms, effects): (Vec<usize>, Vec<usize>) = (0..scored.len())
        .filter(|&row| takes_part(&scored[row]))
        .partition(|&row| scored[row].is_term());
    let firm = terms.into_iter().filter(|&row| scored[row].doubt.is_none());
    let (Some(term), Some(refit)) = (
        least(scored, firm, StructureScore::leaves),
        scored.iter().find(|row| row.kinds.is_empty()),
    ) else {
        return false;
    };
    let term = &scored[term];
    let far = if term.at_noise {
        policy.comparable
    } else {
        1.0 / policy.term_leaves
    };
    let is_far = |single: &StructureScore| {
        single.fitted >= far * term.fitted && single.held_out >= far * term.held_out
    };
    let singles = effects.iter().map(|&row| &scored[row]);
    let mut singles = singles.filter(|row| row.kinds.len() == 1);
    let known = leader(scored, &effects, refit, policy).map(|row| &scored[row]);
    let goes_first = |known: &StructureScore| {
        !term.at_noise || known.kinds.len() > 1 && term.leaves() > known.leaves()
    };
    singles.all(is_far) && !known.is_some_and(goes_first)
}

/// Whether a term has a memory for which another without one makes up: it leaves about as much.
pub fn remembers_in_vain(row: &StructureScore, others: &[StructureScore], policy: &Policy) -> bool {
    let remembers = |row: &StructureScore| {
        let mut terms = row.kinds.iter().filter(|kind| is_term(**kind));
        terms.any(|kind| !kind.info().states.is_empty())
    };
    remembers(row)
        && others.iter().any(|other| {
            other.is_term()
                && !remembers(other)
                && other.kinds.len() <= row.kinds.len()
                && other.leaves() <= policy.comparable * row.leaves()
        })
}

fn ranked(scored: &[StructureScore], policy: &Policy) -> Ranking {
    let rows: Vec<usize> = (0..scored.len())
        .filter(|&row| takes_part(&scored[row]))
        .collect();
    let refit = scored.iter().find(|row| row.kinds.is_empty());
    let Some(leader) = refit.and_then(|refit| leader(scored, &rows, refit, policy)) else {
        return Ranking::default();
    };
    let rivals = rivals(scored, &rows, leader, policy);
    let rivals = without_general_cases(scored, &rivals, leader, policy);
    Ranking {
        leader: Some(leader),
        is_firm: matches!(*rivals.as_slice(), [only] if scored[only].doubt.is_none()),
        rivals,
    }
}

/// The structures of a size with their probabilities, the one that leaves least first.
pub fn of_size(scored: &[StructureScore], size: usize, policy: &Policy) -> Vec<(usize, f64)> {
    let mut rows: Vec<usize> = (0..scored.len())
        .filter(|&row| scored[row].kinds.len() == size)
        .collect();
    rows.sort_by(|&a, &b| scored[a].leaves().total_cmp(&scored[b].leaves()));
    let shares = probabilities(scored, size, policy);
    rows.into_iter().map(|row| (row, shares[row])).collect()
}

/// Twice the logarithm of how much less likely the held-out segments are than under the
/// best structure of that size.
pub fn behind(scored: &[StructureScore], row: usize) -> f64 {
    let density =
        |row: &StructureScore| row.density.iter().sum::<f64>() / row.density.len().max(1) as f64;
    let size = scored[row].kinds.len();
    let best = scored
        .iter()
        .filter(|other| other.kinds.len() == size)
        .map(density)
        .fold(f64::NEG_INFINITY, f64::max);
    2.0 * (best - density(&scored[row]))
}

/// The probability of each structure of a size, in the order of `scored`, from its odds
/// against the leader; zero for the others.
fn probabilities(scored: &[StructureScore], size: usize, policy: &Policy) -> Vec<f64> {
    let of_size = (0..scored.len()).filter(|&row| scored[row].kinds.len() == size);
    let Some(first) = least(scored, of_size, |row| weighed(row, policy)) else {
        return vec![0.0; scored.len()];
    };
    // Odds beyond these are not known from a thousand draws.
    let most = 1.0 / rejected(policy);
    let odds: Vec<f64> = scored
        .iter()
        .map(|row| odds(row, &scored[first], policy).min(most))
        .collect();
    let total: f64 = odds.iter().sum();
    odds.into_iter()
        .map(|odds| if total > 0.0 { odds / total } else { 0.0 })
        .collect()
}

/// What a structure leaves, more where there is a doubt about it: the least of a size leads.
fn weighed(row: &StructureScore, policy: &Policy) -> f64 {
    let factor = if row.doubt.is_some() {
        policy.doubted
    } else {
        1.0
    };
    factor * row.leaves()
}

/// The leading structure; none if no effect closes a part of the error.
fn leader(
    scored: &[StructureScore],
    rows: &[usize],
    refit: &StructureScore,
    policy: &Policy,
) -> Option<usize> {
    let mut before = refit;
    let mut chosen = None;
    let largest = rows.iter().map(|&row| scored[row].kinds.len()).max()?;
    for size in 1..=largest {
        let of_size = rows
            .iter()
            .copied()
            .filter(|&row| scored[row].kinds.len() == size);
        let Some(best) = least(scored, of_size, |row| weighed(row, policy)) else {
            continue;
        };
        if is_taken(&scored[best], before, policy) && carries_each(scored, best, policy) {
            before = &scored[best];
            chosen = Some(best);
        }
    }
    chosen
}

/// Whether a structure leaves much less than every one within it that could be named: each of its
/// effects has a part in what it explains.
fn carries_each(scored: &[StructureScore], row: usize, policy: &Policy) -> bool {
    let row = &scored[row];
    let within = scored.iter().filter(|other| {
        let mut kinds = other.kinds.iter();
        takes_part(other)
            && other.doubt.is_none()
            && other.kinds.len() < row.kinds.len()
            && kinds.all(|kind| row.kinds.contains(kind))
    });
    let mut within = within.map(|other| other.leaves().min(1.0));
    within.all(|leaves| row.leaves() <= policy.further_leaves * leaves)
}

/// Whether a structure replaces a smaller one.
fn is_taken(row: &StructureScore, before: &StructureScore, policy: &Policy) -> bool {
    let (most, each) = if before.kinds.is_empty() {
        (1.0 - policy.part, 1.0)
    } else {
        (policy.further_leaves, policy.further_leaves_each)
    };
    let explains = row.leaves() <= most * before.leaves()
        && row.fitted <= each * before.fitted
        && row.held_out <= each * before.held_out;
    // A doubt is no progress over a structure that can be named.
    let is_firm = row.doubt.is_none() || before.doubt.is_some() || before.kinds.is_empty();
    let chance = row
        .is_better(before)
        .max(row.leaves_at_most(policy.sure_leaves, before));
    explains && is_firm && chance >= policy.sure
}

/// The leader and the structures that cannot be distinguished from it, the one that leaves
/// least first.
fn rivals(scored: &[StructureScore], rows: &[usize], leader: usize, policy: &Policy) -> Vec<usize> {
    let mut rivals: Vec<usize> = rows
        .iter()
        .copied()
        .filter(|&row| {
            row == leader || odds(&scored[row], &scored[leader], policy) >= rejected(policy)
        })
        .collect();
    rivals.sort_by(|&a, &b| scored[a].leaves().total_cmp(&scored[b].leaves()));
    rivals
}

/// The odds of a structure that is rejected.
fn rejected(policy: &Policy) -> f64 {
    policy.rejected / (1.0 - policy.rejected)
}

/// The odds of a structure against the leader of its size; zero for one of another size.
///
/// By the errors, one that leaves [`Policy::comparable`] times as much is on the verge of
/// rejection. By the draws, the odds are those of the better prediction. Where something is
/// left beyond noise, errors alone count within a family, and the less favourable of both
/// between families. What these recordings cannot exclude stays on the verge.
pub fn odds(rival: &StructureScore, first: &StructureScore, policy: &Policy) -> f64 {
    let odds = measured_odds(rival, first, policy);
    if cannot_be_excluded(rival, first, policy) {
        odds.max(rejected(policy))
    } else {
        odds
    }
}

fn measured_odds(rival: &StructureScore, first: &StructureScore, policy: &Policy) -> f64 {
    let ratio = rival.leaves() / first.leaves();
    // A parameter at its bound makes another effect of it, or bends it.
    let is_no_better = rival.doubt == Some(Doubt::AtBound) && ratio >= policy.doubted_leaves;
    let follows_runs = rival.doubt.is_some_and(Doubt::is_of_the_runs) && !first.at_noise;
    let takes_back = rival.doubt == Some(Doubt::TakesBack);
    let gives_way = first.doubt.is_none() && (is_no_better || follows_runs || takes_back);
    if rival.kinds.len() != first.kinds.len() || !takes_part(rival) || gives_way {
        return 0.0;
    }
    let is_kin = family::of_all(&rival.kinds) == family::of_all(&first.kinds);
    let by_error = libm::pow(
        rejected(policy),
        libm::log(ratio) / libm::log(policy.comparable),
    );
    let by_draws = {
        let better = rival.is_better(first);
        better / (1.0 - better).max(f64::MIN_POSITIVE)
    };
    if first.at_noise {
        let as_accurate = is_kin && rival.rms.powi(2) - first.rms.powi(2) <= 1.0;
        by_draws.max(if as_accurate { rejected(policy) } else { 0.0 })
    } else if is_kin {
        by_error
    } else {
        by_error.min(by_draws)
    }
}

/// Whether a structure stays a rival whatever its odds: the leader ended as this special case,
/// which alone is taken, or it can imitate this effect, which explains the error.
fn cannot_be_excluded(rival: &StructureScore, first: &StructureScore, policy: &Policy) -> bool {
    let ended_there = first.degenerate
        && is_special_case(&rival.kinds, &first.kinds)
        && rival.leaves() <= 1.0 - policy.part;
    let imitated = exchanged(&first.kinds, &rival.kinds)
        .is_some_and(|(own, other)| own.info().imitates.contains(&other))
        && rival.leaves() <= 1.0 - policy.explains;
    ended_there || imitated
}

/// The rivals, except those that these recordings do not distinguish from another one that is their
/// special case.
fn without_general_cases(
    scored: &[StructureScore],
    rivals: &[usize],
    leader: usize,
    policy: &Policy,
) -> Vec<usize> {
    // One that would not be taken alone replaces nothing.
    let as_good = |row: usize| {
        row == leader
            || scored[row].leaves() <= 1.0 - policy.part
                && measured_odds(&scored[row], &scored[leader], policy) >= rejected(policy)
    };
    let has_special = |general: &usize| {
        let mut all = rivals.iter().filter(|&&it| as_good(it));
        all.any(|&it| is_special_case(&scored[it].kinds, &scored[*general].kinds))
    };
    rivals
        .iter()
        .copied()
        .filter(|row| !has_special(row))
        .collect()
}

fn least(
    scored: &[StructureScore],
    rows: impl Iterator<Item = usize>,
    weight: impl Fn(&StructureScore) -> f64,
) -> Option<usize> {
    rows.min_by(|&a, &b| weight(&scored[a]).total_cmp(&weight(&scored[b])))
}

/// Whether a structure can be an answer: effects of families of their own, and an error that
/// could be measured.
fn takes_part(row: &StructureScore) -> bool {
    let mut families = family::of_all(&row.kinds);
    families.dedup();
    !row.kinds.is_empty() && families.len() == row.kinds.len() && row.leaves().is_finite()
}

/// Whether `narrow` is `wide` with one effect replaced by its special case.
pub fn is_special_case(narrow: &[Kind], wide: &[Kind]) -> bool {
    exchanged(wide, narrow)
        .is_some_and(|(general, special)| general.info().special_case == Some(special))
}

/// The one effect in which two structures differ, and the one in its place; none if they
/// do not differ in exactly one.
fn exchanged(from: &[Kind], to: &[Kind]) -> Option<(Kind, Kind)> {
    let only = |these: &[Kind], those: &[Kind]| -> Vec<Kind> {
        let own = these.iter().filter(|kind| !those.contains(kind));
        own.copied().collect()
    };
    match (only(from, to).as_slice(), only(to, from).as_slice()) {
        (&[out], &[into]) => Some((out, into)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use model_core::effects::Family;
    use proptest::prelude::*;

    use super::*;
    use crate::diagnose::decide::verdict::Answer;
    use Kind::{
        CoulombFriction, CubicStiffness, DeadTime, EndStop, Gravity, LinearStiffness,
        MaxwellBranch, PeriodicDisturbance, PneumaticLag, StribeckFriction,
    };
    use softrig_formats::own_effects::{DeclaredMemory, DeclaredParameter, Formulated, Hold};

    const POLICY: Policy = Policy::STANDARD;

    /// A structure that leaves this share, and is better than one that leaves more.
    fn row(kinds: &[Kind], leaves: f64) -> StructureScore {
        StructureScore {
            kinds: kinds.to_vec(),
            fitted: leaves,
            held_out: leaves,
            doubt: None,
            degenerate: false,
            rms: 100.0 * leaves,
            at_noise: false,
            density: vec![-1000.0 * leaves; 4],
            error: vec![leaves; 4],
        }
    }

    /// The same, as likely as one that leaves the share `like`.
    fn as_likely(kinds: &[Kind], leaves: f64, like: f64) -> StructureScore {
        StructureScore {
            density: row(kinds, like).density,
            ..row(kinds, leaves)
        }
    }

    fn doubted(row: StructureScore) -> StructureScore {
        StructureScore {
            doubt: Some(Doubt::AtBound),
            ..row
        }
    }

    fn at_noise(row: StructureScore) -> StructureScore {
        StructureScore {
            at_noise: true,
            ..row
        }
    }

    /// An answer by the places of its rows.
    #[derive(Debug, PartialEq)]
    enum Said {
        Named(usize, Strength),
        Cannot(Vec<usize>, Vec<Family>, Strength),
        Shape(usize),
        /// What came closest until then.
        OutOfTime(Vec<Kind>),
        /// Nothing is named; what comes closest.
        Unexplained(Vec<Kind>),
        Quiet,
        Noisy,
    }

    fn cannot_tell(rivals: &[usize], families: &[Family], strength: Strength) -> Said {
        Said::Cannot(rivals.to_vec(), families.to_vec(), strength)
    }

    fn nearest(kind: Kind) -> Said {
        Said::Unexplained(vec![kind])
    }

    /// What is said of rows where more than noise is left, and of what `change` makes of that.
    fn said(
        rows: &[StructureScore],
        undone: &[SearchPart],
        change: impl FnOnce(&mut Evidence<'_>),
    ) -> Said {
        let undone = undone.iter().copied().collect();
        let ranking = rank(rows, tried_sizes(&undone), &POLICY);
        let repaired: Vec<Kind> = rows.iter().flat_map(|row| row.kinds.clone()).collect();
        let mut evidence = Evidence {
            remains: Remains::More,
            is_noisy: false,
            scored: rows,
            ranking: &ranking,
            beside: None,
            repaired: &repaired,
            undone: &undone,
        };
        change(&mut evidence);
        let found = decide(&evidence, &POLICY);
        let rivals = ranking.rivals.clone();
        match found {
            Finding::Named { strength, .. } => Said::Named(rivals[0], strength),
            Finding::Rivals {
                families, strength, ..
            }
            | Finding::Trace {
                families, strength, ..
            } => Said::Cannot(rivals, families, strength),
            Finding::Shape { .. } => Said::Shape(rivals[0]),
            Finding::OutOfTime { closest } => {
                Said::OutOfTime(closest.map_or_else(Vec::new, |it| it.kinds))
            }
            Finding::Unexplained { closest } => {
                Said::Unexplained(closest.into_iter().flat_map(|it| it.kinds).collect())
            }
            Finding::Quiet { .. } => Said::Quiet,
            Finding::Noisy => Said::Noisy,
        }
    }

    /// Each rule, with a case on both sides. The refit is the first row of every case.
    #[test]
    #[expect(clippy::too_many_lines, reason = "a table reads best in one piece")]
    fn table() {
        use Said::Named;
        use Strength::{Explains, Part};
        let shape = [Family::StiffnessShape];
        let g = [Gravity];
        let c = [CubicStiffness];
        let m = [MaxwellBranch];
        let pair = [CoulombFriction, Gravity];
        let cases: Vec<(&str, Vec<StructureScore>, Said)> = vec![
            ("nothing was fitted", vec![], Said::Unexplained(vec![])),
            ("explains most", vec![row(&g, 0.33)], Named(1, Explains)),
            ("explains part", vec![row(&g, 0.34)], Named(1, Part)),
            ("closes a quarter", vec![row(&g, 0.75)], Named(1, Part)),
            ("closes less", vec![row(&g, 0.76)], nearest(Gravity)),
            (
                "neither its density nor its error holds in the draws",
                vec![StructureScore {
                    error: vec![2.0; 4],
                    ..as_likely(&g, 0.5, 1.1)
                }],
                nearest(Gravity),
            ),
            (
                "its error holds, its density does not",
                vec![as_likely(&g, 0.5, 1.1)],
                Named(1, Part),
            ),
            (
                "a formula of the same family that leaves hardly more",
                vec![row(&g, 0.20), row(&c, 0.25)],
                cannot_tell(&[1, 2], &shape, Explains),
            ),
            (
                "a formula of the same family that leaves clearly more",
                vec![row(&g, 0.20), as_likely(&c, 0.28, 0.2)],
                Named(1, Explains),
            ),
            (
                "an effect of another family that predicts as well",
                vec![row(&g, 0.20), as_likely(&m, 0.25, 0.2)],
                cannot_tell(&[1, 2], &[], Explains),
            ),
            (
                "one that predicts worse",
                vec![row(&g, 0.20), row(&m, 0.25)],
                Named(1, Explains),
            ),
            (
                "at the noise only the draws decide: as well",
                vec![at_noise(row(&g, 0.02)), as_likely(&m, 0.10, 0.02)],
                cannot_tell(&[1, 2], &[], Explains),
            ),
            (
                "at the noise only the draws decide: worse",
                vec![at_noise(row(&g, 0.02)), row(&c, 0.025)],
                Named(1, Explains),
            ),
            (
                "at the noise, formulas that differ by less than a sensor shows",
                vec![
                    StructureScore {
                        rms: 5.0,
                        ..at_noise(row(&g, 0.02))
                    },
                    StructureScore {
                        rms: 5.05,
                        ..row(&c, 0.025)
                    },
                ],
                cannot_tell(&[1, 2], &shape, Explains),
            ),
            (
                "an effect that is another one at its bound",
                vec![row(&[LinearStiffness], 0.2), doubted(row(&[EndStop], 0.2))],
                Named(1, Explains),
            ),
            (
                "a line of the drive beside a curve",
                vec![
                    row(&g, 0.20),
                    StructureScore {
                        doubt: Some(Doubt::Drive),
                        ..as_likely(&[PeriodicDisturbance], 0.21, 0.20)
                    },
                ],
                Named(1, Explains),
            ),
            (
                "a sine that takes back a spring, beside a curve",
                vec![
                    row(&c, 0.20),
                    StructureScore {
                        doubt: Some(Doubt::TakesBack),
                        ..as_likely(&g, 0.21, 0.20)
                    },
                ],
                Named(1, Explains),
            ),
            (
                "a doubt keeps from a name",
                vec![doubted(row(&g, 0.2))],
                cannot_tell(&[1], &shape, Explains),
            ),
            (
                "a doubted structure leads if it leaves much less",
                vec![doubted(row(&g, 0.2)), row(&m, 0.31)],
                cannot_tell(&[1], &shape, Explains),
            ),
            (
                "and otherwise gives way, but stays a rival",
                vec![doubted(as_likely(&g, 0.2, 0.29)), row(&m, 0.29)],
                cannot_tell(&[1, 2], &[], Explains),
            ),
            (
                "a special case as likely as its general effect",
                vec![
                    row(&[StribeckFriction], 0.20),
                    row(&[CoulombFriction], 0.25),
                ],
                Named(2, Explains),
            ),
            (
                "a special case that leaves clearly more",
                vec![
                    row(&[StribeckFriction], 0.20),
                    row(&[CoulombFriction], 0.28),
                ],
                Named(1, Explains),
            ),
            (
                "an effect that can imitate another that explains the error",
                vec![at_noise(row(&[DeadTime], 0.05)), row(&[PneumaticLag], 0.30)],
                cannot_tell(&[1, 2], &[Family::InputPath], Explains),
            ),
            (
                "an effect that can imitate another that does not",
                vec![at_noise(row(&[DeadTime], 0.05)), row(&[PneumaticLag], 0.40)],
                Named(1, Explains),
            ),
            (
                "an effect that ended as its special case",
                vec![
                    StructureScore {
                        degenerate: true,
                        ..row(&[StribeckFriction], 0.20)
                    },
                    row(&[CoulombFriction], 0.60),
                ],
                cannot_tell(&[1, 2], &[Family::DryFriction], Explains),
            ),
            (
                "a second effect that leaves much less",
                vec![row(&g, 0.5), row(&pair, 0.30)],
                Named(2, Explains),
            ),
            (
                "a second effect that leaves less",
                vec![row(&g, 0.5), row(&pair, 0.31)],
                Named(1, Part),
            ),
            (
                "a second effect that helps only where it was fitted",
                vec![
                    row(&g, 0.5),
                    StructureScore {
                        fitted: 0.1,
                        held_out: 0.4,
                        ..row(&pair, 0.2)
                    },
                ],
                Named(1, Part),
            ),
            (
                "a doubted pair does not replace what can be named",
                vec![row(&g, 0.5), doubted(row(&pair, 0.1))],
                Named(1, Part),
            ),
            (
                "two effects of one family are one cause",
                vec![row(&g, 0.5), row(&[CubicStiffness, Gravity], 0.1)],
                Named(1, Part),
            ),
            (
                "pairs of the same families",
                vec![
                    row(&g, 0.8),
                    row(&pair, 0.2),
                    row(&[CoulombFriction, CubicStiffness], 0.22),
                ],
                cannot_tell(
                    &[2, 3],
                    &[Family::DryFriction, Family::StiffnessShape],
                    Explains,
                ),
            ),
            (
                "pairs of different families",
                vec![
                    row(&pair, 0.2),
                    as_likely(&[PneumaticLag, Gravity], 0.22, 0.2),
                ],
                cannot_tell(&[1, 2], &[], Explains),
            ),
        ];
        for (about, rows, expected) in cases {
            let rows: Vec<StructureScore> = std::iter::once(row(&[], 1.0)).chain(rows).collect();
            assert_eq!(said(&rows, &[], |_| ()), expected, "{about}");
        }
    }

    /// A structure that was not measured far enough is not named.
    #[test]
    fn a_budget_limits_the_name() {
        let rows = [
            row(&[], 1.0),
            row(&[Gravity], 0.5),
            row(&[CoulombFriction, Gravity], 0.1),
        ];
        let without = |undone: &[SearchPart]| said(&rows, undone, |_| ());
        assert_eq!(without(&[]), Said::Named(2, Strength::Explains));
        assert_eq!(without(&[SearchPart::Table]), without(&[]));
        let combinations = [SearchPart::Combinations];
        assert_eq!(without(&combinations), Said::Named(1, Strength::Part));
        let single = [SearchPart::Alone(Kind::Leak)];
        let one = &rows[..2];
        let alone = |undone: &[SearchPart]| said(one, undone, |_| ());
        assert_eq!(alone(&combinations), Said::Named(1, Strength::Part));
        // What came closest until the time was up is not lost, and is no name.
        assert_eq!(alone(&single), Said::OutOfTime(vec![Gravity]));
        assert_eq!(without(&single), Said::OutOfTime(rows[2].kinds.clone()));
        let pair = [rows[0].clone(), rows[2].clone()];
        assert_eq!(
            said(&pair, &combinations, |_| ()),
            Said::OutOfTime(pair[1].kinds.clone())
        );
        let nothing = [rows[0].clone()];
        let unexplained = Said::Unexplained(vec![]);
        assert_eq!(
            said(&nothing, &[SearchPart::Horizons], |_| ()),
            Said::OutOfTime(vec![])
        );
        assert_eq!(
            said(&nothing, &[SearchPart::Experiment], |_| ()),
            unexplained
        );
    }

    /// One explanation without a name is a trace, several are rivals; neither is told from more.
    #[test]
    fn one_explanation_is_a_trace_and_several_are_rivals() {
        let creep = [MaxwellBranch];
        let one = found(&[row(&[], 1.0), doubted(row(&creep, 0.2))], &[]);
        assert!(matches!(one, Finding::Trace { .. }), "{one:?}");
        let leak = as_likely(&[Kind::Leak], 0.25, 0.2);
        let two = found(&[row(&[], 1.0), row(&creep, 0.2), leak], &[]);
        assert!(matches!(two, Finding::Rivals { .. }), "{two:?}");
        for it in [&one, &two] {
            assert_eq!(it.answer(), Answer::CannotTell);
            assert_eq!(it.named(), []);
            assert_eq!(it.families(), [Family::Creep]);
        }
        assert_eq!([one, two].map(|it| it.explanations().len()), [1, 2]);
    }

    /// Beside a right formula a table gains nothing.
    #[test]
    fn a_table_shows_a_wrong_formula() {
        let rows = [row(&[], 1.0), row(&[Gravity], 0.3)];
        let of = Variable::Angle;
        let with = |rows: &[StructureScore], leaves| {
            said(rows, &[], |it| it.beside = Some(Beside { of, leaves }))
        };
        assert_eq!(with(&rows, [0.9, 0.5]), Said::Named(1, Strength::Explains));
        assert_eq!(with(&rows, [0.8, 0.8]), Said::Shape(1));
        // One that cannot be named anyway has at least its shape.
        let rows = [row(&[], 1.0), doubted(row(&[Gravity], 0.3))];
        assert_eq!(with(&rows, [0.9, 0.5]), Said::Shape(1));
    }

    /// Where only noise is left nothing is missing, whatever was fitted; where little is left, if
    /// nothing explains it; and only as far as the noise lets one see.
    #[test]
    fn what_is_left_without_an_effect_decides_first() {
        let rows = [row(&[], 1.0), row(&[Gravity], 0.3)];
        let refit = &rows[..1];
        let left = |rows: &[StructureScore], remains, is_noisy, undone: &[SearchPart]| {
            said(rows, undone, |it| {
                it.remains = remains;
                it.is_noisy = is_noisy;
            })
        };
        let [off, right] = [true, false].map(|refitted| Remains::Noise { refitted });
        let little = Remains::Little { refitted: true };
        assert_eq!(left(&rows, off, false, &[]), Said::Quiet);
        assert_eq!(left(&rows, off, true, &[]), Said::Noisy);
        assert_eq!(left(refit, little, false, &[]), Said::Quiet);
        let named = Said::Named(1, Strength::Explains);
        assert_eq!(left(&rows, little, true, &[]), named);
        // What agrees within its noise does so whatever else was not tried.
        let calibrated = [SearchPart::Calibrated];
        assert_eq!(left(&rows, right, false, &calibrated), Said::Quiet);
        assert_eq!(
            left(&rows, off, false, &calibrated),
            Said::OutOfTime(vec![])
        );
    }

    /// Probabilities of a size add up; a formula that is on the verge of rejection has one in
    /// twenty, and one that predicts worse none.
    #[test]
    fn probabilities_add_up() {
        let rows = [
            row(&[Gravity], 0.2),
            row(&[CubicStiffness], 0.26),
            row(&[MaxwellBranch], 0.3),
            row(&[CoulombFriction, Gravity], 0.1),
        ];
        let found = probabilities(&rows, 1, &POLICY);
        assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((found[1] - 0.05).abs() < 1e-9, "{found:?}");
        assert!(found[2] < 1e-9 && found[3] == 0.0, "{found:?}");
    }

    #[test]
    fn special_cases_replace_one_effect_and_keep_the_others() {
        use Kind::Leak;
        assert!(is_special_case(&[CoulombFriction], &[StribeckFriction]));
        assert!(!is_special_case(&[StribeckFriction], &[CoulombFriction]));
        assert!(is_special_case(
            &[Gravity, CoulombFriction],
            &[StribeckFriction, Gravity]
        ));
        assert!(!is_special_case(
            &[Leak, CoulombFriction],
            &[StribeckFriction, Gravity]
        ));
        assert!(!is_special_case(&[Gravity], &[StribeckFriction, Gravity]));
    }

    /// Structures of one and of two effects, of families of their own.
    const SETS: [&[Kind]; 8] = [
        &[Gravity],
        &[CubicStiffness],
        &[MaxwellBranch],
        &[CoulombFriction],
        &[StribeckFriction],
        &[PneumaticLag],
        &[CoulombFriction, Gravity],
        &[MaxwellBranch, Gravity],
    ];

    /// Measurements as they might be: errors in eight draws about their mean, and a density.
    fn drawn() -> impl Strategy<Value = Vec<StructureScore>> {
        let doubt = prop_oneof![3 => Just(None), 1 => Just(Some(Doubt::AtBound))];
        let draws = || proptest::collection::vec(0.8..1.25, 8);
        let row = (0.02..1.3, 0.9..1.1, doubt, draws(), draws(), any::<bool>());
        proptest::collection::vec(proptest::option::weighted(0.7, row), SETS.len()).prop_map(
            |rows| {
                let rows = SETS.iter().zip(rows).filter_map(|(kinds, row)| {
                    let (leaves, apart, doubt, errors, densities, is_quiet) = row?;
                    Some(StructureScore {
                        kinds: kinds.to_vec(),
                        fitted: leaves * apart,
                        held_out: leaves / apart,
                        doubt,
                        at_noise: is_quiet && leaves < 0.1,
                        density: densities.iter().map(|it| -100.0 * leaves * it).collect(),
                        error: errors.iter().map(|it| leaves * it).collect(),
                        ..self::row(kinds, leaves)
                    })
                });
                let refit = StructureScore {
                    density: vec![-100.0; 8],
                    error: vec![1.0; 8],
                    ..self::row(&[], 1.0)
                };
                std::iter::once(refit).chain(rows).collect()
            },
        )
    }

    fn found(rows: &[StructureScore], undone: &[SearchPart]) -> Finding {
        let undone = undone.iter().copied().collect();
        let ranking = rank(rows, tried_sizes(&undone), &POLICY);
        let repaired = ranking.first().map_or(&[][..], |row| &rows[row].kinds);
        decide(
            &Evidence {
                remains: Remains::More,
                is_noisy: false,
                scored: rows,
                ranking: &ranking,
                beside: None,
                repaired,
                undone: &undone,
            },
            &POLICY,
        )
    }

    fn row_of<'a>(rows: &'a [StructureScore], kinds: &[Kind]) -> &'a StructureScore {
        rows.iter().find(|row| row.kinds == kinds).unwrap()
    }

    fn term(force: &str) -> Kind {
        remembering(force, None)
    }

    /// A term, with a memory of this.
    fn remembering(force: &str, follows: Option<&str>) -> Kind {
        let parameter = |key: &str, min| DeclaredParameter {
            key: key.into(),
            value: 1.0,
            min,
            max: None,
            unit: "N".into(),
            hold: Hold::Free,
        };
        let time = follows.map(|_| parameter("tau", Some(0.1)));
        let parameters = [parameter("c", None)].into_iter().chain(time).collect();
        let memories = follows.map(|follows| DeclaredMemory {
            key: "z".into(),
            follows: follows.into(),
            time_constant: "tau".into(),
        });
        let formulated = Formulated {
            name: "term_of_a_test".into(),
            title: "a force of a test".into(),
            force: format!("c*{force}"),
            parameters,
            memories: memories.into_iter().collect(),
            family: None,
            special_case: None,
        };
        formulated.kind().unwrap()
    }

    #[test]
    fn a_term_takes_part_only_where_no_name_comes_near() {
        let term = term("th^5");
        let refit = row(&[], 1.0);
        let rows = |effect: f64, of_term: f64| {
            [
                refit.clone(),
                row(&[CoulombFriction], effect),
                row(&[term], of_term),
            ]
        };
        // Where more than noise is left: half, and no name explains a part.
        let half = POLICY.term_leaves;
        assert!(offers_terms(&rows(0.9, 0.899 * half), &POLICY));
        assert!(!offers_terms(&rows(0.9, 0.901 * half), &POLICY));
        assert!(!offers_terms(&rows(0.5, 0.1), &POLICY));
        let at_noise = |effect: f64| {
            let mut rows = rows(effect, 0.2);
            rows[2].at_noise = true;
            offers_terms(&rows, &POLICY)
        };
        let comparable = POLICY.comparable;
        assert!(at_noise(0.2 * comparable) && !at_noise(0.199 * comparable));
        assert!(!offers_terms(&rows(0.5, 0.2)[..2], &POLICY));
        // Better on held-out runs alone is not enough.
        let mut fits_worse = rows(0.9, 0.1);
        fits_worse[1].fitted = 0.09;
        assert!(!offers_terms(&fits_worse, &POLICY));
        // A term in doubt offers nothing.
        let mut doubtful = rows(0.9, 0.1);
        doubtful[2].doubt = Some(Doubt::AtBound);
        assert!(!offers_terms(&doubtful, &POLICY));
        // What a combination of names explains as well needs no formula.
        let pair = |leaves: f64| {
            let mut rows = rows(0.6, 0.2).to_vec();
            rows[2].at_noise = true;
            rows.push(row(&[CoulombFriction, Gravity], leaves));
            offers_terms(&rows, &POLICY)
        };
        assert!(pair(0.21) && !pair(0.19));
    }

    #[test]
    fn a_memory_has_to_show() {
        let (plain, memory) = (term("th^3"), remembering("(th^3 - z)", Some("th^3")));
        let rows = |of_plain: f64| [row(&[plain], of_plain), row(&[memory], 0.1)];
        let limit = 0.1 * POLICY.comparable;
        let near = rows(0.99 * limit);
        assert!(remembers_in_vain(&near[1], &near, &POLICY));
        assert!(!remembers_in_vain(&near[0], &near, &POLICY));
        let far = rows(1.01 * limit);
        assert!(!remembers_in_vain(&far[1], &far, &POLICY));
        // A pair has to be better than it, not the other way round.
        let pair = [row(&[CoulombFriction, plain], 0.05), row(&[memory], 0.1)];
        assert!(!remembers_in_vain(&pair[1], &pair, &POLICY));
    }

    proptest! {
        /// What is named closes a part of the gap, each effect of it.
        #[test]
        fn a_name_carries_the_gap(rows in drawn()) {
            let found = found(&rows, &[]);
            let named = found.named();
            if named.is_empty() {
                return Ok(());
            }
            let own = row_of(&rows, &named);
            prop_assert!(own.leaves() <= 1.0 - POLICY.part);
            for kind in named.iter().filter(|_| named.len() > 1) {
                let without: Vec<Kind> = named.iter().copied().filter(|it| it != kind).collect();
                let alone = rows.iter().find(|row| row.kinds == without);
                let alone = alone.filter(|row| row.doubt.is_none());
                if let Some(alone) = alone {
                    prop_assert!(own.leaves() <= POLICY.further_leaves * alone.leaves().min(1.0));
                }
            }
        }

        /// A structure that leaves clearly more and predicts worse in every draw changes no name.
        #[test]
        fn a_worse_structure_changes_no_name(rows in drawn(), worse in 1.31..3.0) {
            let named = found(&rows, &[]).named();
            if named.is_empty() {
                return Ok(());
            }
            let own = row_of(&rows, &named);
            let kinds: &[Kind] = if named.len() == 1 {
                &[Kind::Leak]
            } else {
                &[Kind::Leak, PneumaticLag]
            };
            let scaled = |values: &[f64]| values.iter().map(|it| worse * it).collect();
            let mut more = rows.clone();
            more.push(StructureScore {
                kinds: kinds.to_vec(),
                fitted: worse * own.fitted,
                held_out: worse * own.held_out,
                doubt: None,
                degenerate: false,
                rms: worse * own.rms,
                at_noise: false,
                density: own.density.iter().map(|it| it - 20.0).collect(),
                error: scaled(&own.error),
            });
            prop_assert_eq!(found(&more, &[]).named(), named);
        }

        /// A rival that predicts better makes no name more certain.
        #[test]
        fn a_better_rival_makes_no_name_more_certain(rows in drawn(), by in 0.0..30.0) {
            let before = found(&rows, &[]);
            let named = before.named();
            if named.is_empty() {
                return Ok(());
            }
            for place in 1..rows.len() {
                if rows[place].kinds.len() != named.len() || rows[place].kinds == named {
                    continue;
                }
                let mut better = rows.clone();
                for density in &mut better[place].density {
                    *density += by;
                }
                let after = found(&better, &[]);
                if after.named() == named {
                    for kind in &named {
                        let [a, b] = [&after, &before].map(|it| it.probability_of(*kind).unwrap());
                        // What is a special case of the rival is part of it.
                        let kinds = &rows[place].kinds;
                        let is_kin = kinds.iter().any(|it| {
                            it == kind || it.info().special_case == Some(*kind)
                        });
                        prop_assert!(is_kin || a <= b + 1e-9, "{a} after {b}");
                    }
                }
            }
        }

        /// Fewer finished fits never say more.
        #[test]
        fn what_was_not_tried_adds_nothing(rows in drawn()) {
            let whole = found(&rows, &[]).named();
            for part in [
                SearchPart::Alone(Gravity),
                SearchPart::Horizons,
                SearchPart::Combinations,
                SearchPart::Calibrated,
                SearchPart::Table,
            ] {
                let named = found(&rows, &[part]).named();
                prop_assert!(named.iter().all(|kind| whole.contains(kind)), "{part:?}: {named:?}");
            }
        }
    }
}
