//! What these recordings leave open.

use model_core::catalogue::Kind;

use super::sentences::left_over;
use super::tried::judged_size;
use super::words::{listed, with_capital};
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::search::selection::FittedStructure;

/// Sentences about what these recordings leave open.
pub(super) fn open(diagnosis: &Diagnosis) -> Vec<String> {
    let mut open: Vec<String> = diagnosis.identifiability[0]
        .text
        .iter()
        .map(|text| format!("{}.", with_capital(text)))
        .collect();
    match &diagnosis.finding {
        Finding::Quiet { .. } => open.push(format!(
            "An effect that moves the angle by less than the noise of {} does not show in these \
             runs; nor does one that they do not excite, such as creep in short runs.",
            diagnosis.shown(diagnosis.held_out.floor)
        )),
        Finding::Noisy => open.push(
            "Whether something is missing: record with less noise, or larger motions.".into(),
        ),
        Finding::Named { .. } => {
            open.extend(look_alikes(diagnosis));
            if !diagnosis.adequacy.exact_form {
                open.push(format!(
                    "Whether the formula is exact or only the kind of effect right: {}.",
                    left_over(diagnosis)
                ));
            }
        }
        Finding::OutOfTime { .. } => {
            open.push("What is missing: the search was ended before everything was tried.".into());
        }
        Finding::Shape { .. } => open.push(
            "Which formula it follows. The table predicts within the range of these runs, and not \
             beyond."
                .into(),
        ),
        Finding::Trace { .. } => open.push(
            "Whether this is the cause. Record runs that show it more strongly before you upload \
             the model: it may not hold on others."
                .into(),
        ),
        Finding::Rivals { .. } => open.push("Which of the explanations is the right one.".into()),
        Finding::Unexplained { .. } => open.push(
            "What the missing force is. Where the picture repeats from run to run it is physics \
             that no known formula describes; where it does not, look at the rig first."
                .into(),
        ),
    }
    open.push(
        "The angle sensor's gain is confounded with stiffness, damping and input gain, and the \
         scale of the inertia is not identifiable: neither is fitted."
            .into(),
    );
    open
}

/// The standing of a look-alike of a named effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Alike {
    /// It is rejected.
    ToldApart,
    /// It is not rejected.
    NotSeparated,
    /// It generalises the named effect, and leaves no less.
    MoreGeneral,
    /// It had no final fit in place of the named one.
    NotTried,
}

impl Alike {
    const ALL: [Self; 4] = [
        Self::ToldApart,
        Self::NotSeparated,
        Self::MoreGeneral,
        Self::NotTried,
    ];

    /// The text about all of them.
    fn text(self) -> &'static str {
        match self {
            Self::ToldApart => "Look-alikes that these recordings rule out",
            Self::NotSeparated => "Look-alikes that these recordings do not separate from it",
            Self::MoreGeneral => "More general effects that include it and improve nothing",
            Self::NotTried => "Look-alikes without a final fit",
        }
    }
}

/// Sentences about the look-alikes of the named effects.
fn look_alikes(diagnosis: &Diagnosis) -> Vec<String> {
    let added = &diagnosis.repaired.added;
    let size = judged_size(diagnosis);
    let fates: Vec<(&str, Alike)> = added
        .iter()
        .flat_map(|&named| {
            let others = named.info().look_alikes.iter();
            let others = others.filter_map(|name| Kind::from_name(name));
            others
                .filter(|other| !added.contains(other))
                .map(move |other| {
                    (
                        other.info().title,
                        fate(named, other, size, &diagnosis.tried),
                    )
                })
        })
        .collect();
    Alike::ALL
        .iter()
        .filter_map(|&wanted| {
            let mut titles: Vec<&str> = fates
                .iter()
                .filter(|(_, fate)| *fate == wanted)
                .map(|(title, _)| *title)
                .collect();
            titles.sort_unstable();
            titles.dedup();
            let text = wanted.text();
            (!titles.is_empty()).then(|| format!("{text}: {}.", listed(&titles)))
        })
        .collect()
}

/// The standing of `other`, a look-alike of `named`, among structures of `size` effects:
/// that of the best structure that has it instead.
fn fate(named: Kind, other: Kind, size: usize, tried: &[FittedStructure]) -> Alike {
    let best = tried
        .iter()
        .filter(|tried| tried.kinds.len() == size)
        .filter(|tried| tried.kinds.contains(&other) && !tried.kinds.contains(&named))
        .max_by(|a, b| a.probability.total_cmp(&b.probability));
    match best {
        None => Alike::NotTried,
        Some(best) if !best.rejected => Alike::NotSeparated,
        // Its probability was given to the special case.
        Some(_) if other.info().special_case == Some(named) => Alike::MoreGeneral,
        Some(_) => Alike::ToldApart,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_alikes_are_told_apart_only_where_they_were_rejected() {
        use Kind::{BoucWenHysteresis, CoulombFriction, InputBacklash};
        let tried = |kinds: &[Kind], probability| FittedStructure {
            kinds: kinds.to_vec(),
            rmse: 0.01,
            held_out: None,
            delta_bic: 0.0,
            probability,
            rejected: probability < 0.05,
            at_bound: Vec::new(),
        };
        let all = [
            tried(&[CoulombFriction], 0.9),
            tried(&[InputBacklash], 0.01),
            tried(&[BoucWenHysteresis], 0.0),
            tried(&[CoulombFriction, InputBacklash], 0.5),
            tried(&[InputBacklash, BoucWenHysteresis], 0.3),
        ];
        let fate = |other, size| fate(CoulombFriction, other, size, &all);
        assert_eq!(fate(InputBacklash, 1), Alike::ToldApart);
        assert_eq!(fate(BoucWenHysteresis, 1), Alike::MoreGeneral);
        assert_eq!(fate(Kind::Gravity, 1), Alike::NotTried);
        assert_eq!(fate(InputBacklash, 2), Alike::NotSeparated);
    }
}
