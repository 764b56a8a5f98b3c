//! From measurements to an answer: one pure function.
//!
//! Each fitted structure is a row of measurements ([`Scored`]); the constants are the
//! [`Policy`]. Nothing is simulated or fitted here.
//!
//! 1. Within each size, structures whose error is little larger than the least of that
//!    size compete. The one with the most evidence leads, unless its special case has
//!    nearly as much, or the fit ended as the special case. Two effects of one family are
//!    one cause with a better formula: they repair the model but are not named.
//! 2. A larger structure replaces a smaller one if it halves the remaining error and
//!    brings evidence for each further effect.
//! 3. The leader's closure on held-out segments is its strength: it explains the error,
//!    or part of it, or nothing is named. A trace with overwhelming evidence is shown
//!    without a name.
//! 4. If a table of the named effect's own variable leaves much less error, the variable
//!    is right and the formula is not: the family is named ([`shaped`]).
//! 5. Others with nearly as much evidence are rivals. If all rivals are of the leader's
//!    families, the family is the answer. If they differ, the effects common to all of
//!    them are named, if they could be named alone; otherwise the answer is "cannot tell".

use model_core::catalogue::Kind;

use super::policy::Policy;
use super::ranking::is_special_case;
pub use super::verdict::{Closure, Strength};
use crate::family::Family;

/// The measurements of one structure.
#[derive(Clone, Debug, PartialEq)]
pub struct Scored {
    /// Its effects, in the order of the catalogue.
    pub kinds: Vec<Kind>,
    /// Share of the error that it removes.
    pub closure: Closure,
    /// Share of the error that it leaves, fitted and held-out segments together.
    pub leaves: f64,
    /// Evidence against the refit: twice the logarithm of a Bayes factor.
    pub evidence: f64,
    /// Free parameters.
    pub parameters: usize,
    /// Whether an effect ended as its special case.
    pub degenerate: bool,
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
    /// Rivals that cannot be distinguished, best first.
    CannotTell {
        /// The rivals.
        rivals: Vec<usize>,
        /// The families that all rivals share; empty if they differ.
        families: Vec<Family>,
        /// The strength of the best of them.
        strength: Strength,
    },
    /// Nothing is named.
    Unexplained {
        /// The structure that comes nearest, if any has evidence.
        nearest: Option<usize>,
    },
}

/// Decides.
pub fn decide(scored: &[Scored], policy: &Policy) -> Decision {
    let Some(leader) = leader(scored, policy) else {
        return Decision::Unexplained {
            nearest: most_evidence(scored, |row| row.evidence > policy.evidence),
        };
    };
    let closes = scored[leader].closure.overall;
    let is_trace = closes < policy.part;
    if is_trace && (closes < policy.trace || scored[leader].evidence < policy.trace_evidence) {
        return Decision::Unexplained {
            nearest: Some(leader),
        };
    }
    let strength = strength(&scored[leader], policy);
    let rivals = rivals(scored, leader, policy);
    if rivals.len() == 1 && !is_trace {
        return Decision::Named {
            structure: leader,
            strength,
        };
    }
    let families = Family::of_all(&scored[leader].kinds);
    let one = rivals
        .iter()
        .all(|&rival| Family::of_all(&scored[rival].kinds) == families);
    if !one && let Some(structure) = in_all(scored, &rivals, policy) {
        return Decision::Named {
            structure,
            strength: self::strength(&scored[structure], policy),
        };
    }
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

fn strength(row: &Scored, policy: &Policy) -> Strength {
    if row.closure.overall >= policy.explains {
        Strength::Explains
    } else {
        Strength::Part
    }
}

/// The structure of the effects common to all rivals, if it could be named alone: it is
/// missing, although its companion cannot be told.
fn in_all(scored: &[Scored], rivals: &[usize], policy: &Policy) -> Option<usize> {
    let (first, others) = rivals.split_first()?;
    let common: Vec<Kind> = scored[*first]
        .kinds
        .iter()
        .copied()
        .filter(|kind| others.iter().all(|&it| scored[it].kinds.contains(kind)))
        .collect();
    scored.iter().position(|row| {
        row.kinds == common && row.closure.overall >= policy.part && row.evidence >= policy.evidence
    })
}

/// The leading structure; none if no effect has enough evidence.
fn leader(scored: &[Scored], policy: &Policy) -> Option<usize> {
    let largest = scored.iter().map(|row| row.kinds.len()).max()?;
    let mut chosen: Option<usize> = None;
    for size in 1..=largest {
        let Some(best) = best_of_size(scored, size, policy) else {
            continue;
        };
        let (size_before, left, evidence) = chosen.map_or((0, 1.0, 0.0), |index| {
            let row = &scored[index];
            (row.kinds.len(), 1.0 - row.closure.overall, row.evidence)
        });
        let row = &scored[best];
        // At most three.
        let more = (size - size_before) as f64;
        let needed = if size_before == 0 {
            policy.evidence * more
        } else {
            policy.further_evidence * more
        };
        let leaves = 1.0 - row.closure.overall;
        let enough = size == 1 || leaves <= policy.further_leaves * left;
        if row.evidence - evidence >= needed && enough {
            chosen = Some(best);
        }
    }
    chosen
}

/// The structure of a size with the most evidence among those whose error is little
/// larger than the least, or its special case.
fn best_of_size(scored: &[Scored], size: usize, policy: &Policy) -> Option<usize> {
    let of_size = |row: &Scored| {
        row.kinds.len() == size && row.leaves.is_finite() && is_of_distinct_families(&row.kinds)
    };
    let least = scored
        .iter()
        .filter(|row| of_size(row))
        .map(|row| row.leaves)
        .fold(f64::INFINITY, f64::min);
    let takes_part = |row: &Scored| of_size(row) && row.leaves <= policy.comparable * least;
    let best = most_evidence(scored, takes_part)?;
    let special = most_evidence(scored, |row| {
        takes_part(row)
            && is_special_case(&row.kinds, &scored[best].kinds)
            && row.parameters < scored[best].parameters
            && (scored[best].evidence - row.evidence < policy.special_case
                || (scored[best].degenerate
                    && row.leaves <= scored[best].leaves + policy.same_effect))
    });
    special.or(Some(best))
}

/// The leader and the structures of its size that cannot be distinguished from it, most
/// evidence first.
fn rivals(scored: &[Scored], leader: usize, policy: &Policy) -> Vec<usize> {
    let first = &scored[leader];
    let margin = policy.rival_least.max(policy.rival_share * first.evidence);
    let mut rivals: Vec<usize> = scored
        .iter()
        .enumerate()
        .filter(|(index, row)| {
            *index != leader
                && row.kinds.len() == first.kinds.len()
                && is_of_distinct_families(&row.kinds)
                && row.leaves <= policy.comparable * first.leaves
                && row.closure.overall >= policy.part.min(0.5 * first.closure.overall)
                && row.evidence >= first.evidence - margin
                && !is_special_case(&first.kinds, &row.kinds)
        })
        .map(|(index, _)| index)
        .collect();
    rivals.sort_by(|&a, &b| scored[b].evidence.total_cmp(&scored[a].evidence));
    rivals.insert(0, leader);
    rivals
}

fn is_of_distinct_families(kinds: &[Kind]) -> bool {
    let mut families = Family::of_all(kinds);
    families.dedup();
    families.len() == kinds.len()
}

fn most_evidence(scored: &[Scored], takes_part: impl Fn(&Scored) -> bool) -> Option<usize> {
    scored
        .iter()
        .enumerate()
        .filter(|(_, row)| takes_part(row))
        .max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence))
        .map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use Kind::{
        BoucWenHysteresis, CoulombFriction, CubicStiffness, Gravity, MaxwellBranch,
        StribeckFriction,
    };

    const POLICY: Policy = Policy::STANDARD;

    fn row(kinds: &[Kind], closes: f64, evidence: f64) -> Scored {
        Scored {
            kinds: kinds.to_vec(),
            closure: Closure {
                short: closes,
                medium: closes,
                full: closes,
                overall: closes,
            },
            leaves: 1.0 - closes,
            evidence,
            parameters: 3 + kinds.len(),
            degenerate: false,
        }
    }

    fn named(structure: usize, strength: Strength) -> Decision {
        Decision::Named {
            structure,
            strength,
        }
    }

    /// Each rule, with a case on both sides.
    #[test]
    #[expect(clippy::too_many_lines, reason = "a table reads best in one piece")]
    fn table() {
        let g = [Gravity];
        let c = [CubicStiffness];
        let m = [MaxwellBranch];
        let pair = [CoulombFriction, Gravity];
        let cases: Vec<(&str, Vec<Scored>, Decision)> = vec![
            (
                "nothing was fitted",
                vec![],
                Decision::Unexplained { nearest: None },
            ),
            (
                "too little evidence",
                vec![row(&g, 0.9, 99.0)],
                Decision::Unexplained { nearest: None },
            ),
            (
                "just enough",
                vec![row(&g, 0.9, 100.0)],
                named(0, Strength::Explains),
            ),
            (
                "explains part",
                vec![row(&g, 0.66, 500.0)],
                named(0, Strength::Part),
            ),
            (
                "explains too little",
                vec![row(&g, 0.33, 499.0)],
                Decision::Unexplained { nearest: Some(0) },
            ),
            (
                "a trace with overwhelming evidence",
                vec![row(&g, 0.2, 500.0)],
                Decision::CannotTell {
                    rivals: vec![0],
                    families: vec![Family::StiffnessShape],
                    strength: Strength::Part,
                },
            ),
            (
                "a trace with less",
                vec![row(&g, 0.2, 499.0)],
                Decision::Unexplained { nearest: Some(0) },
            ),
            (
                "less than a trace",
                vec![row(&g, 0.14, 5000.0)],
                Decision::Unexplained { nearest: Some(0) },
            ),
            (
                "the more evidence, if it leaves little more",
                vec![row(&g, 0.80, 500.0), row(&m, 0.71, 900.0)],
                named(1, Strength::Explains),
            ),
            (
                "not if it leaves much more",
                vec![row(&g, 0.80, 500.0), row(&m, 0.69, 900.0)],
                named(0, Strength::Explains),
            ),
            (
                "rivals of one family",
                vec![row(&g, 0.9, 1000.0), row(&c, 0.9, 901.0)],
                Decision::CannotTell {
                    rivals: vec![0, 1],
                    families: vec![Family::StiffnessShape],
                    strength: Strength::Explains,
                },
            ),
            (
                "rivals of two families",
                vec![row(&g, 0.9, 1000.0), row(&m, 0.9, 901.0)],
                Decision::CannotTell {
                    rivals: vec![0, 1],
                    families: vec![],
                    strength: Strength::Explains,
                },
            ),
            (
                "far enough behind",
                vec![row(&g, 0.9, 1000.0), row(&m, 0.9, 899.0)],
                named(0, Strength::Explains),
            ),
            (
                "close behind with little evidence",
                vec![row(&g, 0.9, 130.0), row(&m, 0.9, 101.0)],
                Decision::CannotTell {
                    rivals: vec![0, 1],
                    families: vec![],
                    strength: Strength::Explains,
                },
            ),
            (
                "a second effect that halves what remains",
                vec![row(&g, 0.5, 500.0), row(&pair, 0.76, 600.0)],
                named(1, Strength::Explains),
            ),
            (
                "a second effect that does not",
                vec![row(&g, 0.5, 500.0), row(&pair, 0.74, 900.0)],
                named(0, Strength::Part),
            ),
            (
                "a second effect without evidence",
                vec![row(&g, 0.5, 500.0), row(&pair, 0.9, 599.0)],
                named(0, Strength::Part),
            ),
            (
                "two of one family are one cause",
                vec![
                    row(&g, 0.5, 500.0),
                    row(&[CubicStiffness, Gravity], 0.9, 900.0),
                ],
                named(0, Strength::Part),
            ),
            (
                "one effect in all pairs that cannot be told apart",
                vec![
                    row(&g, 0.5, 500.0),
                    row(&[Gravity, MaxwellBranch], 0.8, 800.0),
                    row(&pair, 0.8, 790.0),
                ],
                named(0, Strength::Part),
            ),
            (
                "one effect in all pairs that says too little alone",
                vec![
                    row(&g, 0.3, 500.0),
                    row(&[Gravity, MaxwellBranch], 0.8, 800.0),
                    row(&pair, 0.8, 790.0),
                ],
                Decision::CannotTell {
                    rivals: vec![1, 2],
                    families: vec![],
                    strength: Strength::Explains,
                },
            ),
            (
                "two that help only together",
                vec![row(&g, 0.05, 20.0), row(&pair, 0.8, 300.0)],
                named(1, Strength::Explains),
            ),
            (
                "two that help only together, with the evidence of one",
                vec![row(&g, 0.05, 20.0), row(&pair, 0.8, 199.0)],
                Decision::Unexplained { nearest: Some(1) },
            ),
        ];
        for (what, scored, expected) in cases {
            assert_eq!(decide(&scored, &POLICY), expected, "{what}");
        }
    }

    #[test]
    fn a_special_case_is_preferred_unless_the_general_one_has_evidence() {
        let mut general = row(&[StribeckFriction], 0.9, 1019.0);
        general.parameters += 1;
        let special = row(&[CoulombFriction], 0.9, 1000.0);
        let rows = [general.clone(), special.clone()];
        assert_eq!(decide(&rows, &POLICY), named(1, Strength::Explains));
        general.evidence = 1150.0;
        let mut rows = [general, special];
        assert_eq!(decide(&rows, &POLICY), named(0, Strength::Explains));
        // A peak of no height is none, whatever its width is good for.
        rows[0].degenerate = true;
        assert_eq!(decide(&rows, &POLICY), named(1, Strength::Explains));
        // One that leaves more than another width can is another effect.
        rows[1].leaves = 0.19;
        rows[0].leaves = 0.1;
        assert_eq!(decide(&rows, &POLICY), named(0, Strength::Explains));
    }

    #[test]
    fn a_formula_that_a_table_of_its_variable_beats_is_a_family() {
        let rows = [row(&[CoulombFriction], 0.9, 1000.0)];
        let name = || decide(&rows, &POLICY);
        let family = Decision::CannotTell {
            rivals: vec![0],
            families: vec![Family::DryFriction],
            strength: Strength::Explains,
        };
        assert_eq!(shaped(name(), &rows, [0.85, 0.85], &POLICY), family);
        assert_eq!(shaped(name(), &rows, [0.85, 0.86], &POLICY), name());
        assert_eq!(shaped(name(), &rows, [0.86, 0.85], &POLICY), name());
        let none = Decision::Unexplained { nearest: None };
        assert_eq!(shaped(none.clone(), &rows, [0.1, 0.1], &POLICY), none);
    }

    #[test]
    fn a_name_needs_that_everything_of_its_size_was_tried() {
        let pair = [CoulombFriction, Gravity];
        let rows = [
            row(&[MaxwellBranch], 0.2, 150.0),
            row(&[Gravity], 0.5, 500.0),
            row(&pair, 0.9, 900.0),
        ];
        let after =
            |rows: &[Scored], tried| as_far_as_tried(decide(rows, &POLICY), rows, tried, &POLICY);
        assert_eq!(after(&rows, 2), named(2, Strength::Explains));
        assert_eq!(after(&rows, 1), named(1, Strength::Part));
        let open = |structure| Decision::CannotTell {
            rivals: vec![structure],
            families: vec![],
            strength: Strength::Explains,
        };
        assert_eq!(after(&rows, 0), open(2));
        // What the best single effect is does not stand in the pair.
        let rows = [row(&[MaxwellBranch], 0.5, 500.0), row(&pair, 0.9, 900.0)];
        assert_eq!(after(&rows, 1), open(1));
    }

    /// The order of the rows is that of a search and must not matter.
    #[test]
    fn the_order_of_rows_does_not_matter() {
        let rows = vec![
            row(&[Gravity], 0.9, 1000.0),
            row(&[BoucWenHysteresis], 0.88, 950.0),
            row(&[MaxwellBranch], 0.3, 990.0),
            row(&[CoulombFriction, Gravity], 0.93, 1090.0),
        ];
        let kinds = |rows: &[Scored]| match decide(rows, &POLICY) {
            Decision::CannotTell { rivals, .. } => rivals
                .iter()
                .map(|&k| rows[k].kinds.clone())
                .collect::<Vec<_>>(),
            other => panic!("{other:?}"),
        };
        let mut turned = rows.clone();
        turned.reverse();
        assert_eq!(kinds(&rows), kinds(&turned));
    }
}
