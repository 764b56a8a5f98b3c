//! All runs of a diagnosis in one list, with the residuals of each model, for pictures and
//! tables.

use softrig::diagnose::Diagnosis;
use softrig::estimate::Segment;
use softrig::statistics::rms;
use softrig_formats::recording::Recording;

/// One run with the residual of each model, in degrees.
#[derive(Clone, Debug)]
pub struct RunView<'a> {
    /// The recording.
    pub recording: &'a Recording,
    /// Whether it is held out.
    pub held_out: bool,
    /// Index among the fitted runs, or among those held out.
    pub index: usize,
    /// When time 0 was (s since 1970, UTC), if that is known.
    pub zero_unix_s: Option<f64>,
    /// The measured angle.
    pub measured: Vec<f64>,
    /// The measured pressure in kPa, its zero still in it.
    pub pressure: Vec<f64>,
    /// For each sample, whether the measured angle is not usable.
    pub silent: Vec<bool>,
    /// Simulated minus measured angle of the model as supplied.
    pub nominal: Vec<f64>,
    /// The same of the refitted model.
    pub refit: Vec<f64>,
    /// The same of the repaired model.
    pub repaired: Vec<f64>,
    /// The same of each rival that remains.
    pub rivals: Vec<Vec<f64>>,
    /// RMS errors of the three while the run was left out; none for a run that never was.
    pub not_fitted: Option<[f64; 3]>,
}

impl RunView<'_> {
    /// RMS errors of nominal, refitted and repaired model as drawn.
    pub fn rms(&self) -> [f64; 3] {
        [&self.nominal, &self.refit, &self.repaired].map(|residual| rms(residual))
    }

    /// RMS errors of the three for the verdict: of a held-out run, in the board's
    /// arithmetic.
    pub fn errors(&self) -> [f64; 3] {
        match self.not_fitted {
            Some(errors) if self.held_out => errors,
            _ => self.rms(),
        }
    }

    /// The simulated angle of a model with this residual.
    pub fn angle(&self, residual: &[f64]) -> Vec<f64> {
        residual
            .iter()
            .zip(&self.measured)
            .map(|(residual, measured)| residual + measured)
            .collect()
    }
}

/// Simulated minus measured angles (rad) of the models, one series per run.
struct Residuals<'a> {
    nominal: &'a [Vec<f64>],
    refit: &'a [Vec<f64>],
    repaired: &'a [Vec<f64>],
    rivals: Vec<&'a [Vec<f64>]>,
}

/// The runs of a diagnosis, fitted ones first: the segments of its sessions.
pub fn runs<'d>(diagnosis: &'d Diagnosis) -> Vec<RunView<'d>> {
    let degrees = |values: &[f64]| values.iter().map(|value| value.to_degrees()).collect();
    let errors = |index: usize| {
        let run = diagnosis.held_out.runs.get(index)?;
        Some([run.nominal, run.refit, run.repaired_on_board].map(f64::to_degrees))
    };
    let silent = |segment: &Segment| {
        let session = diagnosis.data.sessions().get(segment.session);
        let silence = session.map(|session| session.silence()).unwrap_or_default();
        silence
            .get(segment.range.clone())
            .map_or_else(|| vec![false; segment.recording.len()], <[bool]>::to_vec)
    };
    let view = |segment: &'d Segment, index: usize, held_out: bool, series: &Residuals<'_>| {
        let residual = |all: &[Vec<f64>]| all.get(index).map_or_else(Vec::new, |r| degrees(r));
        RunView {
            held_out,
            index,
            zero_unix_s: diagnosis.data.zero_unix_s(segment),
            measured: degrees(&segment.recording.angle),
            pressure: segment
                .recording
                .pressure
                .iter()
                .map(|pa| pa / 1e3)
                .collect(),
            silent: silent(segment),
            nominal: residual(series.nominal),
            refit: residual(series.refit),
            repaired: residual(series.repaired),
            rivals: series.rivals.iter().map(|rival| residual(rival)).collect(),
            not_fitted: if held_out || diagnosis.held_out.in_turn {
                errors(index)
            } else {
                None
            },
            recording: &segment.recording,
        }
    };
    let fitted = Residuals {
        nominal: &diagnosis.nominal.residuals,
        refit: &diagnosis.refit.residuals,
        repaired: &diagnosis.repaired.fit.residuals,
        rivals: diagnosis
            .rivals
            .iter()
            .map(|rival| &*rival.fit.residuals)
            .collect(),
    };
    let validation = &diagnosis.validation;
    let held_out = Residuals {
        nominal: &validation.nominal,
        refit: &validation.refit,
        repaired: &validation.repaired,
        rivals: validation.rivals.iter().map(Vec::as_slice).collect(),
    };
    let data = &diagnosis.data;
    let of_fitted = data
        .fitted()
        .enumerate()
        .map(|(index, segment)| view(segment, index, false, &fitted));
    let of_held_out = data
        .held_out()
        .enumerate()
        .map(|(index, segment)| view(segment, index, true, &held_out));
    of_fitted.chain(of_held_out).collect()
}
