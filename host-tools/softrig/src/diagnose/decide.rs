//! From measurements to an answer: one pure function, whatever the recordings are.
//!
//! Each fitted structure is a row of measurements ([`Scored`]); the constants are the
//! [`Policy`]. Nothing is simulated or fitted here.
//!
//! 1. Of each size, the structure that leaves the least error leads, on fitted and held-out
//!    segments together. A structure with a [`Doubt`] leads only where it leaves much less
//!    than all others. Two effects of one family are one cause with a better formula and are
//!    not an answer.
//! 2. A single effect is taken if it closes a part of the error; a larger structure, if it
//!    leaves much less than the smaller one, fitted and held out. Either must hold in the
//!    draws of a bootstrap, by its density or by its error.
//! 3. Rivals are structures of the same size that these recordings cannot distinguish from
//!    the leader ([`odds`]). Where something is left beyond noise, every formula is wrong a little: one
//!    of the same family is a rival unless it leaves clearly more error. One of another
//!    family is a rival unless it leaves clearly more error or predicts worse in the draws.
//!    Where only noise is left, the draws decide, and no difference counts that is finer than
//!    any angle sensor. An effect that the leader can imitate
//!    (a dead time many lags in a row) stays a rival as long as it explains the error.
//! 4. An effect whose special case predicts as well gives way to it. Beside one that ended as
//!    its special case, that stays a rival if it alone would be taken.
//! 5. One structure without rivals and without a doubt is named. Otherwise the answer is the
//!    set, and the family where all share it.
//! 6. If a table of the named effect's own variable leaves much less error, the variable is
//!    right and the formula is not: the family is the answer ([`shaped`]).

use model_core::catalogue::Kind;

use super::doubts::Doubt;
use super::policy::Policy;
pub use super::verdict::Strength;
use softrig_formats::family::Family;

/// The measurements of one structure.
#[derive(Clone, Debug, PartialEq)]
pub struct Scored {
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

impl Scored {
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

/// The decision from the measurements; structures by their index.
#[derive(Clone, Debug, PartialEq)]
pub enum Decision {
    /// One structure is named.
    Named {
        /// The structure.
        structure: usize,
        /// How strongly.
        strength: Strength,
    },
    /// Structures that cannot be distinguished, or one that cannot be named; the one that
    /// leaves least first.
    CannotTell {
        /// The rivals.
        rivals: Vec<usize>,
        /// The families that all rivals share; empty if they differ.
        families: Vec<Family>,
        /// The strength of the leader.
        strength: Strength,
    },
    /// Nothing is named.
    Unexplained {
        /// The structure that comes nearest.
        nearest: Option<usize>,
    },
}

/// Decides. The refit has no effects; of several, the first counts.
pub fn decide(scored: &[Scored], policy: &Policy) -> Decision {
    let rows: Vec<usize> = (0..scored.len())
        .filter(|&row| takes_part(&scored[row]))
        .collect();
    let refit = scored.iter().find(|row| row.kinds.is_empty());
    let Some(leader) = refit.and_then(|refit| leader(scored, &rows, refit, policy)) else {
        return Decision::Unexplained {
            nearest: least(scored, rows.iter().copied(), Scored::leaves),
        };
    };
    let strength = strength(&scored[leader], policy);
    let rivals = without_general_cases(
        scored,
        &rivals(scored, &rows, leader, policy),
        leader,
        policy,
    );
    if let &[structure] = rivals.as_slice()
        && scored[structure].doubt.is_none()
    {
        return Decision::Named {
            structure,
            strength,
        };
    }
    let families = Family::of_all(&scored[rivals[0]].kinds);
    let one = rivals
        .iter()
        .all(|&rival| Family::of_all(&scored[rival].kinds) == families);
    Decision::CannotTell {
        rivals,
        families: if one { families } else { Vec::new() },
        strength,
    }
}

/// Limits a decision if not all structures of more than `tried` effects were measured: of
/// a larger structure, only a smaller one within it that could be named alone is named.
pub fn as_far_as_tried(
    decision: Decision,
    scored: &[Scored],
    tried: usize,
    policy: &Policy,
) -> Decision {
    match decision {
        Decision::Named {
            structure,
            strength,
        } if scored[structure].kinds.len() > tried => {
            let places: Vec<usize> = (0..scored.len())
                .filter(|&row| scored[row].kinds.len() <= tried)
                .collect();
            let smaller: Vec<Scored> = places.iter().map(|&row| scored[row].clone()).collect();
            let within = |row: &Scored| {
                let mut kinds = row.kinds.iter();
                kinds.all(|kind| scored[structure].kinds.contains(kind))
            };
            match decide(&smaller, policy) {
                Decision::Named {
                    structure: own,
                    strength,
                } if within(&smaller[own]) => Decision::Named {
                    structure: places[own],
                    strength,
                },
                _ => Decision::CannotTell {
                    rivals: vec![structure],
                    families: Vec::new(),
                    strength,
                },
            }
        }
        other => other,
    }
}

/// Revises a decision by a table of the named effect's own variable, added beside the
/// formula, that leaves the shares `left` of its error (fitted, held out). Beside a right
/// formula a table gains nothing. Where it gains, the variable is right and the formula
/// is not, and the family is named.
pub fn shaped(decision: Decision, scored: &[Scored], left: [f64; 2], policy: &Policy) -> Decision {
    match decision {
        Decision::Named {
            structure,
            strength,
        } if left.iter().all(|share| *share <= policy.shape) => Decision::CannotTell {
            rivals: vec![structure],
            families: Family::of_all(&scored[structure].kinds),
            strength,
        },
        other => other,
    }
}

/// The probability of each structure of a size, in the order of `scored`, from its odds
/// against the leader; zero for the others.
pub fn probabilities(scored: &[Scored], size: usize, policy: &Policy) -> Vec<f64> {
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

fn strength(row: &Scored, policy: &Policy) -> Strength {
    if row.leaves() <= 1.0 - policy.explains {
        Strength::Explains
    } else {
        Strength::Part
    }
}

/// What a structure leaves, more where there is a doubt about it: the least of a size leads.
fn weighed(row: &Scored, policy: &Policy) -> f64 {
    let factor = if row.doubt.is_some() {
        policy.doubted
    } else {
        1.0
    };
    factor * row.leaves()
}

/// The leading structure; none if no effect closes a part of the error.
fn leader(scored: &[Scored], rows: &[usize], refit: &Scored, policy: &Policy) -> Option<usize> {
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
        if is_taken(&scored[best], before, policy) {
            before = &scored[best];
            chosen = Some(best);
        }
    }
    chosen
}

/// Whether a structure replaces a smaller one.
fn is_taken(row: &Scored, before: &Scored, policy: &Policy) -> bool {
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
fn rivals(scored: &[Scored], rows: &[usize], leader: usize, policy: &Policy) -> Vec<usize> {
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
pub fn odds(rival: &Scored, first: &Scored, policy: &Policy) -> f64 {
    let odds = measured_odds(rival, first, policy);
    if cannot_be_excluded(rival, first, policy) {
        odds.max(rejected(policy))
    } else {
        odds
    }
}

fn measured_odds(rival: &Scored, first: &Scored, policy: &Policy) -> f64 {
    let ratio = rival.leaves() / first.leaves();
    // A parameter at its bound makes another effect of it, or bends it.
    let is_no_better = rival.doubt == Some(Doubt::AtBound) && ratio >= policy.doubted_leaves;
    let follows_runs = rival.doubt.is_some_and(Doubt::is_of_the_runs) && !first.at_noise;
    let gives_way = first.doubt.is_none() && (is_no_better || follows_runs);
    if rival.kinds.len() != first.kinds.len() || !takes_part(rival) || gives_way {
        return 0.0;
    }
    let is_kin = Family::of_all(&rival.kinds) == Family::of_all(&first.kinds);
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
fn cannot_be_excluded(rival: &Scored, first: &Scored, policy: &Policy) -> bool {
    let ended_there = first.degenerate
        && is_special_case(&rival.kinds, &first.kinds)
        && rival.leaves() <= 1.0 - policy.part;
    let imitated = exchanged(&first.kinds, &rival.kinds)
        .is_some_and(|(own, other)| own.imitates().contains(&other))
        && rival.leaves() <= 1.0 - policy.explains;
    ended_there || imitated
}

/// The rivals without those of which another is a special case that these recordings do not
/// distinguish.
fn without_general_cases(
    scored: &[Scored],
    rivals: &[usize],
    leader: usize,
    policy: &Policy,
) -> Vec<usize> {
    let as_good = |row: usize| {
        row == leader || measured_odds(&scored[row], &scored[leader], policy) >= rejected(policy)
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
    scored: &[Scored],
    rows: impl Iterator<Item = usize>,
    weight: impl Fn(&Scored) -> f64,
) -> Option<usize> {
    rows.min_by(|&a, &b| weight(&scored[a]).total_cmp(&weight(&scored[b])))
}

/// Whether a structure can be an answer: effects of families of their own, and an error that
/// could be measured.
fn takes_part(row: &Scored) -> bool {
    let mut families = Family::of_all(&row.kinds);
    families.dedup();
    !row.kinds.is_empty() && families.len() == row.kinds.len() && row.leaves().is_finite()
}

/// Whether `narrow` is `wide` with one effect replaced by its special case.
pub fn is_special_case(narrow: &[Kind], wide: &[Kind]) -> bool {
    exchanged(wide, narrow)
        .is_some_and(|(general, special)| general.special_case() == Some(special))
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
    use super::*;
    use Kind::{
        CoulombFriction, CubicStiffness, DeadTime, EndStop, Gravity, LinearStiffness,
        MaxwellBranch, PeriodicDisturbance, PneumaticLag, StribeckFriction,
    };

    const POLICY: Policy = Policy::STANDARD;

    /// A structure that leaves this share, and is better than one that leaves more.
    fn row(kinds: &[Kind], leaves: f64) -> Scored {
        Scored {
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
    fn as_likely(kinds: &[Kind], leaves: f64, like: f64) -> Scored {
        Scored {
            density: row(kinds, like).density,
            ..row(kinds, leaves)
        }
    }

    fn doubted(row: Scored) -> Scored {
        Scored {
            doubt: Some(Doubt::AtBound),
            ..row
        }
    }

    fn at_noise(row: Scored) -> Scored {
        Scored {
            at_noise: true,
            ..row
        }
    }

    fn named(structure: usize, strength: Strength) -> Decision {
        Decision::Named {
            structure,
            strength,
        }
    }

    fn cannot_tell(rivals: &[usize], families: &[Family], strength: Strength) -> Decision {
        Decision::CannotTell {
            rivals: rivals.to_vec(),
            families: families.to_vec(),
            strength,
        }
    }

    const NOTHING: Decision = Decision::Unexplained { nearest: None };

    const fn nearest(row: usize) -> Decision {
        Decision::Unexplained { nearest: Some(row) }
    }

    /// Each rule, with a case on both sides. The refit is the first row of every case.
    #[test]
    #[expect(clippy::too_many_lines, reason = "a table reads best in one piece")]
    fn table() {
        use Strength::{Explains, Part};
        let shape = [Family::StiffnessShape];
        let g = [Gravity];
        let c = [CubicStiffness];
        let m = [MaxwellBranch];
        let pair = [CoulombFriction, Gravity];
        let cases: Vec<(&str, Vec<Scored>, Decision)> = vec![
            ("nothing was fitted", vec![], NOTHING),
            ("explains most", vec![row(&g, 0.33)], named(1, Explains)),
            ("explains part", vec![row(&g, 0.34)], named(1, Part)),
            ("closes a quarter", vec![row(&g, 0.75)], named(1, Part)),
            ("closes less", vec![row(&g, 0.76)], nearest(1)),
            (
                "neither its density nor its error holds in the draws",
                vec![Scored {
                    error: vec![2.0; 4],
                    ..as_likely(&g, 0.5, 1.1)
                }],
                nearest(1),
            ),
            (
                "its error holds, its density does not",
                vec![as_likely(&g, 0.5, 1.1)],
                named(1, Part),
            ),
            (
                "a formula of the same family that leaves hardly more",
                vec![row(&g, 0.20), row(&c, 0.25)],
                cannot_tell(&[1, 2], &shape, Explains),
            ),
            (
                "a formula of the same family that leaves clearly more",
                vec![row(&g, 0.20), as_likely(&c, 0.28, 0.2)],
                named(1, Explains),
            ),
            (
                "an effect of another family that predicts as well",
                vec![row(&g, 0.20), as_likely(&m, 0.25, 0.2)],
                cannot_tell(&[1, 2], &[], Explains),
            ),
            (
                "one that predicts worse",
                vec![row(&g, 0.20), row(&m, 0.25)],
                named(1, Explains),
            ),
            (
                "at the noise only the draws decide: as well",
                vec![at_noise(row(&g, 0.02)), as_likely(&m, 0.10, 0.02)],
                cannot_tell(&[1, 2], &[], Explains),
            ),
            (
                "at the noise only the draws decide: worse",
                vec![at_noise(row(&g, 0.02)), row(&c, 0.025)],
                named(1, Explains),
            ),
            (
                "at the noise, formulas that differ by less than a sensor shows",
                vec![
                    Scored {
                        rms: 5.0,
                        ..at_noise(row(&g, 0.02))
                    },
                    Scored {
                        rms: 5.05,
                        ..row(&c, 0.025)
                    },
                ],
                cannot_tell(&[1, 2], &shape, Explains),
            ),
            (
                "an effect that is another one at its bound",
                vec![row(&[LinearStiffness], 0.2), doubted(row(&[EndStop], 0.2))],
                named(1, Explains),
            ),
            (
                "a line of the drive beside a curve",
                vec![
                    row(&g, 0.20),
                    Scored {
                        doubt: Some(Doubt::Drive),
                        ..as_likely(&[PeriodicDisturbance], 0.21, 0.20)
                    },
                ],
                named(1, Explains),
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
                named(2, Explains),
            ),
            (
                "a special case that leaves clearly more",
                vec![
                    row(&[StribeckFriction], 0.20),
                    row(&[CoulombFriction], 0.28),
                ],
                named(1, Explains),
            ),
            (
                "an effect that can imitate another that explains the error",
                vec![at_noise(row(&[DeadTime], 0.05)), row(&[PneumaticLag], 0.30)],
                cannot_tell(&[1, 2], &[Family::InputPath], Explains),
            ),
            (
                "an effect that can imitate another that does not",
                vec![at_noise(row(&[DeadTime], 0.05)), row(&[PneumaticLag], 0.40)],
                named(1, Explains),
            ),
            (
                "an effect that ended as its special case",
                vec![
                    Scored {
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
                named(2, Explains),
            ),
            (
                "a second effect that leaves less",
                vec![row(&g, 0.5), row(&pair, 0.31)],
                named(1, Part),
            ),
            (
                "a second effect that helps only where it was fitted",
                vec![
                    row(&g, 0.5),
                    Scored {
                        fitted: 0.1,
                        held_out: 0.4,
                        ..row(&pair, 0.2)
                    },
                ],
                named(1, Part),
            ),
            (
                "a doubted pair does not replace what can be named",
                vec![row(&g, 0.5), doubted(row(&pair, 0.1))],
                named(1, Part),
            ),
            (
                "two effects of one family are one cause",
                vec![row(&g, 0.5), row(&[CubicStiffness, Gravity], 0.1)],
                named(1, Part),
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
            let rows: Vec<Scored> = std::iter::once(row(&[], 1.0)).chain(rows).collect();
            assert_eq!(decide(&rows, &POLICY), expected, "{about}");
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
        let decision = decide(&rows, &POLICY);
        assert_eq!(decision, named(2, Strength::Explains));
        let limited = as_far_as_tried(decision.clone(), &rows, 1, &POLICY);
        assert_eq!(limited, named(1, Strength::Part));
        assert_eq!(
            as_far_as_tried(decision.clone(), &rows, 2, &POLICY),
            decision
        );
        let without = [rows[0].clone(), rows[2].clone()];
        let limited = as_far_as_tried(decide(&without, &POLICY), &without, 1, &POLICY);
        assert_eq!(limited, cannot_tell(&[1], &[], Strength::Explains));
    }

    /// Beside a right formula a table gains nothing.
    #[test]
    fn a_table_shows_a_wrong_formula() {
        let rows = [row(&[], 1.0), row(&[Gravity], 0.3)];
        let decision = decide(&rows, &POLICY);
        let with = |left| shaped(decision.clone(), &rows, left, &POLICY);
        assert_eq!(with([0.9, 0.5]), decision);
        assert_eq!(
            with([0.8, 0.8]),
            cannot_tell(&[1], &[Family::StiffnessShape], Strength::Explains)
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
}
