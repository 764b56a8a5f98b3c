//! The 95 % confidence band of the repaired or refitted curves.

use softrig::diagnose::decide::finding::Finding;
use softrig::diagnose::{Diagnosis, Request};
use softrig::estimate::band::NoBand;
use softrig::estimate::fit::Effort;
use softrig::estimate::fitter::Fitter;
use softrig_formats::model_file::parameter_name;

use super::pictures::{REFITTED, REPAIRED};

/// Bands of all runs, or why there are none.
#[derive(Clone, Debug)]
pub struct Confidence {
    /// The curve that they belong to, by its label.
    pub label: &'static str,
    /// Half widths (°), one series per run, fitted runs first; or a clause that says why
    /// there are none.
    pub half_widths: Result<Vec<Vec<f64>>, String>,
}

impl Confidence {
    /// The bands of the repaired curves, or of the refitted ones if that is the answer; none
    /// if the answer has no curve.
    pub fn of(request: &Request<'_>, diagnosis: &Diagnosis) -> Option<Self> {
        let label = match &diagnosis.finding {
            Finding::Named { .. } => REPAIRED,
            Finding::Unexplained { .. } if !diagnosis.repaired.added.is_empty() => REPAIRED,
            Finding::Quiet { refitted: true, .. } => REFITTED,
            _ => return None,
        };
        let fit = &diagnosis.repaired.fit;
        let half_widths = bands(request, diagnosis).map_err(|reason| match reason {
            NoBand::NothingFitted => "no parameter was fitted".to_owned(),
            NoBand::AtBound(id) => format!(
                "{} is at the edge of its range",
                parameter_name(&fit.model, id)
            ),
            NoBand::Undetermined => "these runs leave some parameters open".to_owned(),
        });
        Some(Self { label, half_widths })
    }

    /// Sentences that explain the band, or say why there is none.
    pub fn text(&self) -> String {
        let label = self.label;
        match &self.half_widths {
            Ok(_) => format!(
                "The faint band is the pointwise 95 % confidence band of the {label} curve from \
                 its parameter uncertainty: simulation sensitivities times the fit covariance. It \
                 excludes sensor noise and model error."
            ),
            Err(reason) => format!("The {label} curves have no confidence band, for {reason}."),
        }
    }

    /// The half widths (°) of one run.
    pub fn of_run(&self, place: usize) -> Option<&[f64]> {
        let all = self.half_widths.as_ref().ok()?;
        all.get(place).map(Vec::as_slice)
    }
}

/// Half widths (°) of each run, fitted ones first.
fn bands(request: &Request<'_>, diagnosis: &Diagnosis) -> Result<Vec<Vec<f64>>, NoBand> {
    let fit = &diagnosis.repaired.fit;
    let [fitted, held_out] = [true, false].map(|which| diagnosis.data.indices(which));
    let data = diagnosis.data.all_fitted();
    let fitter = Fitter::new(&request.file.model, &data);
    let half_widths = if held_out.is_empty() {
        fitter.band95(fit)?
    } else {
        // A fit has the zeros and initial states of its own sessions.
        let mut placed = fit.clone();
        placed.nuisances = fitter.fit(&fit.model, &[], Effort::Coarse).nuisances;
        fitter.band95(&placed)?
    };
    let in_degrees = |index: usize| -> Vec<f64> {
        let half = half_widths.get(index).map_or(&[][..], Vec::as_slice);
        half.iter().map(|half| half.to_degrees()).collect()
    };
    Ok(fitted.into_iter().chain(held_out).map(in_degrees).collect())
}
