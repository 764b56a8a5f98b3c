//! The verdict in one sentence, and the two or three below it: the evidence, and what to do.

use model_core::catalogue::{Effect, Kind};
use model_core::effects::custom::Custom;

use super::rivals::next_suffices;
use super::words::{combined, either, in_words, listed, titles, with_capital};
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::{Explanation, Finding};
use softrig::diagnose::decide::verdict::Strength;
use softrig::diagnose::score::grammar::is_term;
use softrig::diagnose::search::selection::{FittedStructure, RIVALS_PLANNED};
use softrig::diagnose::work::budget::SearchPart;
use softrig::diagnose::work::policy::Policy;
use softrig_formats::family::Family;
use softrig_formats::numbers::percent;
use softrig_formats::own_effects::with_numbers;

/// The verdict in one sentence.
pub fn sentence(diagnosis: &Diagnosis) -> String {
    if let Some(term) = term(diagnosis) {
        let mut others = diagnosis.finding.named();
        others.retain(|kind| *kind != term.kind());
        let (alone, beside) = if others.is_empty() {
            ("", String::new())
        } else {
            (" alone", format!(", beside {},", titles(&others)))
        };
        return format!(
            "What is missing is not in the catalogue{alone}. {}{beside} {} {} of it: {}.",
            with_capital(term.kind().info().title),
            match diagnosis.finding.strength() {
                Some(Strength::Part) => "comes closest and explains",
                _ => "explains",
            },
            percent(diagnosis.closure.map_or(0.0, |closure| closure.overall)),
            with_numbers(&term)
        );
    }
    match &diagnosis.finding {
        Finding::Quiet {
            immaterial: true, ..
        } => format!(
            "Nothing that matters is missing: {} remain unexplained, less than {}.",
            diagnosis.shown(diagnosis.beyond_noise()),
            diagnosis.shown(diagnosis.tolerance)
        ),
        Finding::Quiet {
            refitted: false, ..
        } => format!(
            "Nothing is missing: the model agrees with the recordings within their noise, {}.",
            noise(diagnosis)
        ),
        Finding::Noisy => format!(
            "These recordings cannot tell whether something is missing: only noise is left, {}, \
             and it hides smaller effects.",
            noise(diagnosis)
        ),
        Finding::Quiet { refitted: true, .. } => {
            "No effect is missing: the structure is right, only the parameters were off.".into()
        }
        Finding::Named { strength, .. } => format!(
            "The model lacks {}{}.",
            titles(&diagnosis.finding.named()),
            of_the_error(*strength)
        ),
        Finding::Shape { of, families, .. } => format!(
            "The model lacks {}: a force of the {} described by a table, but no formula.",
            in_words(families),
            of.name()
        ),
        Finding::Trace {
            explanation,
            strength,
            ..
        } => format!(
            "{} looks like {}, but these recordings do not determine it.",
            match strength {
                Strength::Part => "Part of what is missing",
                Strength::Explains => "What is missing",
            },
            titles(&explanation.kinds)
        ),
        Finding::Rivals {
            rivals,
            families,
            strength,
        } => of_rivals(rivals, families, *strength),
        Finding::OutOfTime { closest } => {
            let closest = closest
                .as_ref()
                .map_or(&diagnosis.repaired.added, |closest| &closest.kinds);
            if closest.is_empty() {
                "Something is missing, but time ran out before it was found.".into()
            } else {
                let closest = with_capital(&titles(closest));
                format!("Something is missing. {closest} came closest before time ran out.")
            }
        }
        Finding::Unexplained { .. } => match closed_most(diagnosis) {
            // "None of them" is not what two thirds of an error look like.
            Some((tried, _, closed)) if closed >= Policy::STANDARD.explains => format!(
                "Something is missing. {} comes closest and explains {}, but it cannot be named.",
                with_capital(&titles(&tried.kinds)),
                percent(closed)
            ),
            _ => "Something is missing, but no known effect explains it.".into(),
        },
    }
}

/// The sentence about several explanations: what they have in common, or the families that they are of.
fn of_rivals(rivals: &[Explanation], families: &[Family], strength: Strength) -> String {
    let common = common(rivals);
    let rest = |rival: &Explanation| -> String {
        let mut kinds = rival.kinds.clone();
        kinds.retain(|kind| !common.contains(kind));
        combined(&kinds)
    };
    let rest: Vec<String> = rivals.iter().map(rest).collect();
    if !common.is_empty() {
        let named: Vec<&String> = rest.iter().filter(|it| !it.is_empty()).collect();
        let perhaps = if named.len() < rest.len() {
            "perhaps "
        } else {
            ""
        };
        return format!(
            "The model lacks {}, and {perhaps}{}{}; these recordings cannot tell which.",
            titles(&common),
            either(&named),
            of_the_error(strength)
        );
    }
    let rivals = listed(&rest);
    if families.is_empty() {
        format!("Something is missing, but these recordings cannot tell apart {rivals}.")
    } else {
        format!(
            "The model lacks {}{}; these recordings cannot tell apart {rivals}.",
            in_words(families),
            of_the_error(strength)
        )
    }
}

/// The effects that all of several explanations have.
fn common(rivals: &[Explanation]) -> Vec<Kind> {
    let Some((first, others)) = rivals
        .split_first()
        .filter(|(_, others)| !others.is_empty())
    else {
        return Vec::new();
    };
    let in_all = |kind: &Kind| others.iter().all(|rival| rival.kinds.contains(kind));
    first.kinds.iter().copied().filter(in_all).collect()
}

/// The named effect, if it is a formula beyond the catalogue.
fn term(diagnosis: &Diagnosis) -> Option<Custom<f64>> {
    let named = diagnosis.finding.named();
    diagnosis.repaired.fit.model.effects().find_map(|effect| {
        let is_named = named.contains(&effect.kind()) && is_term(effect.kind());
        match effect {
            Effect::Custom(term) if is_named => Some(term),
            _ => None,
        }
    })
}

/// The noise floor, and what it rests on.
fn noise(diagnosis: &Diagnosis) -> String {
    let floor = &diagnosis.floor;
    format!("{} ({})", diagnosis.shown(floor.rms), floor.source())
}

/// Adds to a name how much it explains, if not all.
const fn of_the_error(strength: Strength) -> &'static str {
    match strength {
        Strength::Part => ", which explains part of the error",
        Strength::Explains => "",
    }
}

/// The lede: the evidence for the verdict, and what to do.
pub(super) fn lede(diagnosis: &Diagnosis) -> String {
    let held_out = &diagnosis.held_out;
    let [nominal, refit, repaired, floor] = [
        held_out.nominal,
        held_out.refit,
        held_out.repaired_on_board,
        held_out.floor,
    ]
    .map(|error| diagnosis.shown(error));
    match &diagnosis.finding {
        Finding::Quiet {
            immaterial: true, ..
        } => format!(
            "On validation runs, the model as supplied leaves {nominal} and the refitted one \
             {refit}, where noise alone leaves {floor}. No effect that was tried explains the \
             rest, which is below the tolerance of {}.",
            diagnosis.shown(diagnosis.tolerance)
        ),
        Finding::Quiet {
            refitted: false, ..
        } => format!(
            "On validation runs, simulation and measurement differ by {nominal}, where \
             noise alone leaves {floor}. There is nothing to repair: keep the model as it is."
        ),
        Finding::Quiet { refitted: true, .. } => format!(
            "With the parameters refitted, the error on validation runs falls from \
             {nominal} to {refit}, where noise alone leaves {floor}. Use the refitted model; no \
             physics has to be added."
        ),
        Finding::Noisy => format!(
            "On validation runs, the refitted model leaves {refit}, where noise alone leaves \
             {floor}, more than {} of the range of the angle. Look at the sensor, its cable and \
             its supply before you look for physics.",
            percent(Policy::STANDARD.most_noise)
        ),
        Finding::Named { .. } => format!(
            "On validation runs, refitting alone leaves {refit}. With {} it is \
             {repaired}, where noise alone leaves {floor}: {}.",
            match term(diagnosis) {
                Some(_) => "this force added",
                None if diagnosis.repaired.added.len() == 1 => "the effect added",
                None => "the effects added",
            },
            left_over(diagnosis)
        ),
        Finding::OutOfTime { .. } => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. {}",
            if diagnosis.repaired.added.is_empty() {
                "Nothing that was tried until then predicts better.".into()
            } else {
                format!(
                    "Adding {} gives {repaired}, but no diagnosis: untried effects may do better.",
                    titles(&diagnosis.repaired.added)
                )
            }
        ),
        Finding::Shape { .. } => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. Adding the effect and a table gives {repaired}: the missing \
             force depends on that variable by an unknown formula."
        ),
        Finding::Trace { .. } => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. With {} it is {repaired}. But one of its parameters is at a \
             bound or may be zero, or these runs do not distinguish it: treat it as a hint.",
            titles(&diagnosis.repaired.added)
        ),
        Finding::Rivals { rivals, .. } => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. Several explanations close that gap, and these recordings \
             favour none of them clearly. {}",
            what_separates(diagnosis, rivals.len())
        ),
        Finding::Unexplained { .. } => format!(
            "Refitting the parameters leaves {refit} on validation runs, where noise \
             alone leaves {floor}. {}Instead of a name, this page shows the missing force \
             itself: how large it is, and when.",
            why_no_name(diagnosis)
        ),
    }
}

/// The remaining error of the repaired model, as a clause.
pub(super) fn left_over(diagnosis: &Diagnosis) -> &'static str {
    if matches!(
        diagnosis.finding,
        Finding::Quiet {
            immaterial: true,
            ..
        }
    ) {
        "what is left is below the tolerance"
    } else if diagnosis.adequacy.adequate {
        "what is left is noise"
    } else if diagnosis.held_out.at_noise() {
        "what is left is hardly more than noise"
    } else {
        "what is left is still more than noise"
    }
}

/// The structure that closed most of the held-out gap, its error (rad) there,
/// and the share that it closed.
fn closed_most(diagnosis: &Diagnosis) -> Option<(&FittedStructure, f64, f64)> {
    diagnosis
        .tried
        .iter()
        .filter(|tried| !tried.kinds.is_empty())
        .filter_map(|tried| tried.held_out.map(|(error, closed)| (tried, error, closed)))
        .max_by(|a, b| a.2.total_cmp(&b.2))
}

/// The largest share of the held-out gap that anything closed.
pub(super) fn best_closed(diagnosis: &Diagnosis) -> Option<f64> {
    closed_most(diagnosis).map(|(_, _, closed)| closed)
}

/// Why the structure that closed most of the gap is not named, as sentences.
fn why_no_name(diagnosis: &Diagnosis) -> String {
    let Some((_, _, closed)) = closed_most(diagnosis) else {
        return String::new();
    };
    if closed < 0.005 {
        return "No candidate explains any of it. ".into();
    }
    format!(
        "The best candidate explains {} of the error beyond the noise, over three horizons \
         together. {} ",
        percent(closed),
        shortfall(closed)
    )
}

/// Why a structure that closed this share of the gap is not named.
fn shortfall(closed: f64) -> String {
    let needed = Policy::STANDARD.part;
    if closed >= needed {
        "That share would suffice for a name, but the other evidence does not: the gain over \
         simpler explanations could be chance, or is too small on validation runs."
            .into()
    } else {
        format!(
            "That is not enough: a name needs at least {}.",
            percent(needed)
        )
    }
}

/// A sentence about the run that would separate so many rivals.
fn what_separates(diagnosis: &Diagnosis, rivals: usize) -> &'static str {
    if diagnosis
        .ended
        .as_ref()
        .is_some_and(|ended| ended.lacks(SearchPart::Experiment))
    {
        "Time ran out before a run to separate them was planned."
    } else if !next_suffices(diagnosis) {
        "No run that the board can make is expected to separate them: a different measurement \
         is needed."
    } else if rivals > RIVALS_PLANNED {
        "The run proposed below would separate the likeliest of them."
    } else {
        "The run proposed below would separate them."
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_name_needs_depends_on_what_is_left() {
        assert!(shortfall(0.2).contains("25 %"));
        assert!(shortfall(0.5).contains("chance"));
    }
}
