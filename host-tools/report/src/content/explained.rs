//! How much of the error the repaired model explains.

use super::sentences::left_over;
use super::words::titles;
use crate::shares::Explained;
use softrig::diagnose::Diagnosis;
use softrig::diagnose::decide::finding::are_the_same;
use softrig::diagnose::evidence::measure::Closure;
use softrig_formats::numbers::{percent, short};

/// The share of the error beyond the noise that the repaired model explains at each
/// horizon, and what remains.
pub(super) fn explained(diagnosis: &Diagnosis, closure: &Closure) -> String {
    let remaining = diagnosis.remaining();
    let measurand = diagnosis.data.measurand();
    let goes_with = remaining.goes_with.map_or_else(String::new, |feature| {
        format!(" and go with the {}", measurand.named(&feature, "").0)
    });
    let share = |share: f64| percent(share.max(0.0));
    let (what, alone) = named_alone(diagnosis).map_or_else(
        || ("it", String::new()),
        |alone| {
            let named = titles(&diagnosis.finding.named());
            (
                "the repaired model",
                format!("; {named} alone {}", share(alone)),
            )
        },
    );
    format!(
        "On validation runs {what} explains {} of the error beyond the noise ({} over \
         a quarter of a swing, {} over two and a half, {} over whole runs{alone}); {} remain, {} \
         times the noise{goes_with}: {}.",
        at_horizons(diagnosis, closure).in_words(),
        share(closure.short),
        share(closure.medium),
        share(closure.full),
        diagnosis.shown(remaining.rmse_deg.to_radians()),
        short(remaining.times_noise),
        left_over(diagnosis)
    )
}

/// The closure of the named effects alone, if the repaired model has more.
fn named_alone(diagnosis: &Diagnosis) -> Option<f64> {
    let named = diagnosis.finding.named();
    if named.is_empty() || named.len() == diagnosis.repaired.added.len() {
        return None;
    }
    let mut tried = diagnosis.tried.iter();
    let alone = tried.find(|tried| are_the_same(&tried.kinds, &named))?;
    alone.held_out.map(|(_, closed)| closed)
}

/// The share that the repaired model explains over the three horizons together.
pub(super) fn at_horizons(diagnosis: &Diagnosis, closure: &Closure) -> Explained {
    let held_out = &diagnosis.held_out;
    let share = closure.overall.max(0.0);
    Explained::known(share, held_out.repaired_on_board, held_out.floor)
}

/// The share of the refit's error that an error (rad) on held-out runs explains.
pub(super) fn of_the_refit(diagnosis: &Diagnosis, error: f64) -> Explained {
    let held_out = &diagnosis.held_out;
    Explained::of_whole_runs(held_out.refit, error, held_out.floor)
}
