//! Each run before and after: what was measured and what each model makes of
//! it.
//!
//! Fitted and held-out runs come out of a diagnosis in different places. The
//! pictures and the table want them in one list.

use crate::diagnose::{Diagnosis, Request};
use crate::fit::{Fit, Fitter, Run};
use crate::recording::Recording;
use crate::statistics::rms;

/// One run with what each model misses of it, in degrees.
#[derive(Clone, Debug)]
pub struct RunView<'a> {
    /// The recording.
    pub recording: &'a Recording,
    /// Whether it was kept out of the fit.
    pub held_out: bool,
    /// Index among the fitted runs, or among those held out.
    pub index: usize,
    /// The measured angle.
    pub measured: Vec<f64>,
    /// Simulated minus measured angle of the model as supplied.
    pub nominal: Vec<f64>,
    /// The same of the refitted model.
    pub refit: Vec<f64>,
    /// The same of the repaired model.
    pub repaired: Vec<f64>,
    /// The same of each rival that remains.
    pub rivals: Vec<Vec<f64>>,
    /// RMS errors of the three while the run was not fitted; none for a run
    /// that always was.
    pub not_fitted: Option<[f64; 3]>,
}

impl RunView<'_> {
    /// RMS errors of nominal, refitted and repaired model as drawn.
    pub fn rms(&self) -> [f64; 3] {
        [&self.nominal, &self.refit, &self.repaired].map(|residual| rms(residual))
    }

    /// The angle that a model with this residual has.
    pub fn angle(&self, residual: &[f64]) -> Vec<f64> {
        residual
            .iter()
            .zip(&self.measured)
            .map(|(residual, measured)| residual + measured)
            .collect()
    }
}

/// The runs of a diagnosis, fitted ones first, without one that was left out.
pub fn runs<'a>(request: &Request<'a>, diagnosis: &Diagnosis) -> Vec<RunView<'a>> {
    let fitted: Vec<&Recording> = request
        .recordings
        .iter()
        .enumerate()
        .filter(|(index, _)| Some(*index) != diagnosis.left_out)
        .map(|(_, recording)| recording)
        .collect();
    let degrees = |values: &[f64]| values.iter().map(|value| value.to_degrees()).collect();
    let errors = |index: usize| {
        let run = diagnosis.held_out.runs.get(index)?;
        Some([run.nominal, run.refit, run.repaired_on_board].map(f64::to_degrees))
    };
    let views =
        |recordings: Vec<&'a Recording>, fits: [&Fit; 3], rivals: &[&Fit], held_out: bool| {
            recordings
                .into_iter()
                .enumerate()
                .map(|(index, recording)| {
                    let residual = |fit: &Fit| {
                        fit.residuals
                            .get(index)
                            .map_or_else(Vec::new, |r| degrees(r))
                    };
                    let [nominal, refit, repaired] = fits.map(residual);
                    RunView {
                        recording,
                        held_out,
                        index,
                        measured: degrees(&recording.angle),
                        nominal,
                        refit,
                        repaired,
                        rivals: rivals.iter().map(|fit| residual(fit)).collect(),
                        not_fitted: if held_out || diagnosis.held_out.in_turn {
                            errors(index)
                        } else {
                            None
                        },
                    }
                })
                .collect::<Vec<_>>()
        };
    let mut all = views(
        fitted,
        [
            &diagnosis.nominal,
            &diagnosis.refit,
            &diagnosis.repaired.fit,
        ],
        &diagnosis
            .rivals
            .iter()
            .map(|rival| &rival.fit)
            .collect::<Vec<_>>(),
        false,
    );
    if !request.holdout.is_empty() {
        let held_out = Run::all(request.holdout);
        let fitter = Fitter {
            nominal: &request.file.model,
            runs: &held_out,
        };
        let fits = [
            &request.file.model,
            &diagnosis.refit.model,
            &diagnosis.repaired.fit.model,
        ]
        .map(|model| fitter.compare(model));
        let rivals: Vec<Fit> = diagnosis
            .rivals
            .iter()
            .map(|rival| fitter.compare(&rival.fit.model))
            .collect();
        all.extend(views(
            request.holdout.iter().collect(),
            [&fits[0], &fits[1], &fits[2]],
            &rivals.iter().collect::<Vec<_>>(),
            true,
        ));
    }
    all
}
