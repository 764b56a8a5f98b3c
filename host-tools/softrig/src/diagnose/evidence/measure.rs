//! Measures structures: their errors on fitted and on held-out segments.
//!
//! *Closure* is the share of the error that a structure removes on held-out segments, at
//! three horizons. Of the levels at which it was fitted, the one with the least error on
//! the fitted segments counts. *Evidence* decides which structures are worth a final fit: the
//! log-likelihood ratio under a model of the remaining error, a discrepancy process
//! ([`crate::diagnose::evidence::discrepancy`]) or a random-walk force, whichever gives more.

use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;

use crate::diagnose::evidence::discrepancy;
use crate::diagnose::evidence::validation::{CrossValidator, Errors, at_horizons};
use crate::diagnose::fit::candidates::Candidate;
use crate::diagnose::fit::levels::{Estimate, Levels};
use crate::diagnose::work::budget::SearchPart;
use crate::diagnose::work::executor::NoFit;
use crate::diagnose::work::policy::{Policy, Search};
use crate::diagnose::work::progress::Best;
use crate::estimate::filter::Pace;
use crate::estimate::fit::Fit;
use crate::estimate::fitter::Fitter;
use crate::estimate::horizon::block_errors;

/// Share of the error beyond the noise that is removed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Closure {
    /// Over a quarter of a swing period.
    pub short: f64,
    /// Over two and a half swing periods.
    pub medium: f64,
    /// Over whole runs.
    pub full: f64,
    /// One minus the geometric mean of the remaining shares at the three horizons.
    pub overall: f64,
}

/// A structure as fitted, and how it does.
#[derive(Clone, Debug)]
pub struct MeasuredStructure {
    /// The structure.
    pub candidate: Candidate,
    /// RMS errors on fitted segments (rad).
    pub fitted: Errors,
    /// RMS errors on held-out segments (rad).
    pub held_out: Errors,
}

impl MeasuredStructure {
    /// Measures a structure on all data of a validator.
    pub fn of(validator: &CrossValidator<'_>, candidate: Candidate) -> Self {
        let fitter = validator.fitter();
        let horizons = horizons(&Pace::of(fitter.data));
        Self {
            fitted: fitted_errors(fitter, &candidate.fit, horizons),
            held_out: validator.predicted(&candidate, horizons),
            candidate,
        }
    }
}

/// A structure of the search, with its best fit.
#[derive(Clone, Debug)]
pub struct StructureFit {
    /// The structure as fitted at every level.
    pub estimate: Estimate,
    /// Index of the level that counts.
    pub level: usize,
    /// Share of the error that it leaves on the fitted subsample.
    pub leaves_on_subsample: f64,
    /// Share of the error that it leaves over three horizons, fitted and held-out segments
    /// together.
    pub leaves: f64,
    /// Evidence against the refit: twice the logarithm of a Bayes factor.
    pub evidence: f64,
    /// Share of the error that it removes on held-out segments.
    pub closure: Closure,
    /// The final fit at that level.
    pub row: MeasuredStructure,
}

impl StructureFit {
    /// As it is shown while the search goes on, beside the RMS error (rad) of the refit on held-out
    /// segments.
    fn so_far(&self, refit: f64) -> Best {
        Best {
            kinds: self.estimate.set(),
            leaves: self.row.held_out.full,
            of: Some(refit),
            explains: Some(self.closure.overall),
        }
    }
}

/// The nominal structure, with which others are compared.
pub struct Reference {
    estimate: Estimate,
    /// Least error of any level at each horizon (rad): on the subsample, on all fitted
    /// segments, on held-out segments.
    on_subsample: [f64; 3],
    fitted: [f64; 3],
    held_out: [f64; 3],
    /// Deviance of the output-error residual.
    discrepancy: f64,
    /// Least deviance under a random-walk force.
    random_walk: f64,
}

/// A structure measured on the subsample.
struct CoarseMeasure {
    estimate: Estimate,
    level: usize,
    leaves: f64,
    evidence: f64,
}

/// The context of measurements.
pub struct MeasureContext<'a> {
    /// The fits.
    pub levels: &'a Levels<'a>,
    /// The subsample, on which levels are chosen.
    pub subsample: &'a Fitter<'a>,
    /// Cross-validation on held-out segments.
    pub validator: &'a CrossValidator<'a>,
    /// Noise of the angle (rad).
    pub noise: f64,
    /// The constants.
    pub policy: &'a Policy,
}

impl MeasureContext<'_> {
    /// Measures the nominal structure.
    ///
    /// # Errors
    ///
    /// If the time was up.
    pub fn baseline(&self, estimate: Estimate) -> Result<Reference, NoFit> {
        let mut fitted = [[f64::INFINITY; 3]; 2];
        let mut held_out = [f64::INFINITY; 3];
        let least = |least: &mut [f64; 3], errors: Errors| {
            for (least, error) in least.iter_mut().zip(errors.values()) {
                *least = least.min(error);
            }
        };
        for (level, fit) in estimate.fits.iter().enumerate() {
            let candidate = self.levels.candidate(&estimate, level)?;
            least(
                &mut held_out,
                self.validator.predicted(&candidate, self.horizons()),
            );
            let horizons = self.horizons();
            least(&mut fitted[0], fitted_errors(self.subsample, fit, horizons));
            least(
                &mut fitted[1],
                fitted_errors(self.validator.fitter(), &candidate.fit, horizons),
            );
        }
        let [on_subsample, fitted] = fitted;
        Ok(Reference {
            discrepancy: self.discrepancy(&estimate),
            random_walk: self.random_walk(&estimate),
            estimate,
            on_subsample,
            fitted,
            held_out,
        })
    }

    /// Measures structures against the nominal one: those with the most evidence and those
    /// with the least error. Of structures that extend others, only those that leave less
    /// than `most` on the subsample.
    pub fn measure(
        &self,
        baseline: &Reference,
        estimates: Vec<Estimate>,
        most: f64,
    ) -> Vec<StructureFit> {
        /// Number of each.
        const MEASURED: usize = 5;
        let executor = self.levels.executor();
        let job = executor.job();
        job.progress.step("evidence", 0);
        let mut coarse: Vec<CoarseMeasure> = estimates
            .into_par_iter()
            .filter_map(|estimate| {
                let part = SearchPart::of(&estimate.added);
                executor.reached(part, self.coarse(baseline, estimate))
            })
            .filter(|row| row.leaves <= most)
            .collect();
        coarse.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut others = coarse.split_off(coarse.len().min(MEASURED));
        others.sort_by(|a, b| a.leaves.total_cmp(&b.leaves));
        let ahead = coarse
            .iter()
            .map(|row| row.leaves)
            .fold(f64::INFINITY, f64::min);
        others.truncate(MEASURED);
        others.retain(|row| row.leaves <= Search::STANDARD.worth_measuring * ahead);
        coarse.extend(others);
        job.progress.step("validation", coarse.len());
        coarse
            .into_par_iter()
            .filter_map(|coarse| {
                let part = SearchPart::of(&coarse.estimate.added);
                executor.reached(part, self.measured(baseline, coarse))
            })
            .inspect(|row| job.progress.offer(row.so_far(baseline.held_out[2])))
            .collect()
    }

    fn coarse(&self, baseline: &Reference, estimate: Estimate) -> Result<CoarseMeasure, NoFit> {
        self.levels.executor().check()?;
        let (level, leaves) = (0..estimate.fits.len())
            .map(|level| {
                let fit = &estimate.fits[level];
                let errors = fitted_errors(self.subsample, fit, self.horizons());
                (
                    level,
                    mean_share(&self.shares(&errors, &baseline.on_subsample)),
                )
            })
            .filter(|(_, left)| left.is_finite())
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .ok_or(NoFit::Diverged)?;
        let fit = &estimate.fits[level];
        let more = fit.free.len() as f64 - baseline.estimate.fits[0].free.len() as f64;
        let samples = fit.samples().max(2) as f64;
        let gained = (baseline.discrepancy - self.discrepancy(&estimate))
            .max(baseline.random_walk - self.random_walk(&estimate));
        Ok(CoarseMeasure {
            evidence: gained - more * libm::log(samples),
            estimate,
            level,
            leaves,
        })
    }

    fn measured(&self, baseline: &Reference, coarse: CoarseMeasure) -> Result<StructureFit, NoFit> {
        let CoarseMeasure {
            estimate,
            level,
            evidence,
            leaves: leaves_on_subsample,
        } = coarse;
        let candidate = self.levels.candidate(&estimate, level)?;
        let row = MeasuredStructure::of(self.validator, candidate);
        let shares = self.shares(&row.held_out, &baseline.held_out);
        let left = mean_share(&self.shares(&row.fitted, &baseline.fitted));
        let left_out = mean_share(&shares);
        if !(left.is_finite() && left_out.is_finite()) {
            return Err(NoFit::Diverged);
        }
        Ok(StructureFit {
            closure: of_shares(shares),
            leaves: (left * left_out).sqrt(),
            evidence,
            estimate,
            level,
            leaves_on_subsample,
            row,
        })
    }

    fn horizons(&self) -> [f64; 2] {
        horizons(&self.levels.pace)
    }

    fn shares(&self, errors: &Errors, before: &[f64; 3]) -> [f64; 3] {
        shares(before, &errors.values(), self.noise, self.policy)
    }

    fn discrepancy(&self, estimate: &Estimate) -> f64 {
        let fit = &estimate.fits[self.levels.output_error()];
        discrepancy::deviance(&fit.residuals) + fit.departure
    }

    fn random_walk(&self, estimate: &Estimate) -> f64 {
        estimate.fits[..self.levels.output_error()]
            .iter()
            .map(|fit| {
                let samples = fit.samples().max(1) as f64;
                samples * libm::log(fit.sse() / samples)
            })
            .fold(f64::INFINITY, f64::min)
    }
}

/// Errors on the fitted segments, with zeros and initial states refitted.
fn fitted_errors(fitter: &Fitter<'_>, fit: &Fit, horizons: [f64; 2]) -> Errors {
    let model = &fit.model;
    let compared = fitter.compare_near(model, &fit.nuisances);
    let data = fitter.data;
    Errors::of(&at_horizons(&compared.residuals, horizons, |horizon| {
        block_errors(model, data, &compared.nuisances, horizon, true)
    }))
}

/// The two shorter horizons (s): a quarter of a swing, and two and a half.
fn horizons(pace: &Pace) -> [f64; 2] {
    const SWINGS: [f64; 2] = [0.25, 2.5];
    SWINGS.map(|swings| swings * pace.period)
}

/// The share of one structure's error beyond the noise that another removes, on held-out
/// segments.
pub fn closed(validator: &CrossValidator<'_>, before: &Candidate, after: &Candidate) -> Closure {
    let horizons = horizons(&Pace::of(validator.fitter().data));
    let [before, after] = [before, after].map(|it| validator.predicted(it, horizons).values());
    closure(&before, &after, validator.floor())
}

/// Closure from RMS errors (rad) before and after, at three horizons, beyond the noise.
pub fn closure(before: &[f64; 3], after: &[f64; 3], noise: f64) -> Closure {
    of_shares(shares(before, after, noise, &Policy::STANDARD))
}

/// The remaining share of the excess error at each horizon.
fn shares(before: &[f64; 3], after: &[f64; 3], noise: f64, policy: &Policy) -> [f64; 3] {
    std::array::from_fn(|horizon| {
        excess(after[horizon], noise, policy) / excess(before[horizon], noise, policy)
    })
}

/// An error beyond the noise (rad); what cannot be distinguished from none counts as the
/// least that could be.
pub fn excess(error: f64, noise: f64, policy: &Policy) -> f64 {
    let least = policy.noise_share * noise;
    (error * error - noise * noise).max(least * least).sqrt()
}

/// What a structure leaves beyond the noise (rad), on fitted segments or on held-out ones, whichever is
/// more.
pub fn leaves_beyond(errors: [f64; 2], noise: f64) -> f64 {
    let beyond = errors.map(|error| excess(error, noise, &Policy::STANDARD));
    beyond[0].max(beyond[1])
}

fn of_shares(shares: [f64; 3]) -> Closure {
    let [short, medium, full] = shares.map(|share| 1.0 - share);
    Closure {
        short,
        medium,
        full,
        overall: 1.0 - mean_share(&shares),
    }
}

/// The geometric mean.
fn mean_share(shares: &[f64; 3]) -> f64 {
    libm::exp(shares.iter().map(|share| libm::log(*share)).sum::<f64>() / 3.0)
}
