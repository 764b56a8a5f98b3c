//! Measurements of a structure: what [`super::decide`] rests on.
//!
//! *Closure*: how much of the error a structure removes, at three horizons, on segments
//! that were not fitted; of the levels at which it was fitted, the one that leaves least
//! on the fitted segments counts. *Evidence*: how much more likely it makes the data, if
//! what remains is a process of its own ([`super::discrepancy`]), or a random-walk
//! force; the larger of the two counts.

use rayon::prelude::*;

use super::candidates::Candidate;
use super::decide::{Closure, Scored};
use super::discrepancy;
use super::levels::{Estimate, Levels};
use super::policy::Policy;
use super::validation::{CrossValidator, Errors, at_horizons};
use crate::estimate::filter::Pace;
use crate::estimate::fit::{Fit, Fitter};
use crate::estimate::horizon::block_errors;

/// A structure with its measurements and its best fit.
#[derive(Clone, Debug)]
pub struct Measured {
    /// What was measured.
    pub scored: Scored,
    /// The structure as fitted at every level.
    pub estimate: Estimate,
    /// Place of the level that counts.
    pub level: usize,
    /// Share of the error that it leaves on the fitted subsample.
    pub leaves_roughly: f64,
    /// The fit at that level, finished.
    pub candidate: Candidate,
    /// Errors on segments that were not fitted (rad).
    pub held_out: Errors,
}

/// The nominal structure, to which others are compared.
pub struct Baseline {
    estimate: Estimate,
    /// Least error of any level at each horizon (rad): on the subsample, on everything
    /// that is fitted, on what is held out.
    on_excerpt: [f64; 3],
    fitted: [f64; 3],
    held_out: [f64; 3],
    /// Deviance of what output error leaves.
    discrepancy: f64,
    /// Least deviance under a random-walk force.
    random_walk: f64,
}

/// A structure as the subsample shows it.
struct Rough {
    estimate: Estimate,
    level: usize,
    leaves: f64,
    evidence: f64,
}

/// What measurements are made with.
pub struct Ruler<'a> {
    /// The fits.
    pub levels: &'a Levels<'a>,
    /// The subsample, on which levels are chosen.
    pub excerpt: &'a Fitter<'a>,
    /// Everything.
    pub fitter: &'a Fitter<'a>,
    /// Selection by segments that were not fitted.
    pub validator: &'a CrossValidator<'a>,
    /// Noise of the angle (rad).
    pub noise: f64,
    /// The constants.
    pub policy: &'a Policy,
}

impl Ruler<'_> {
    /// Measures the nominal structure; none if there is no time for it.
    pub fn baseline(&self, estimate: Estimate) -> Option<Baseline> {
        let mut fitted = [[f64::INFINITY; 3]; 2];
        let mut held_out = [f64::INFINITY; 3];
        let least = |least: &mut [f64; 3], errors: Errors| {
            for (least, error) in least.iter_mut().zip(errors.values()) {
                *least = least.min(error);
            }
        };
        for (level, fit) in estimate.fits.iter().enumerate() {
            self.levels.has_time_for(&estimate.added)?;
            let candidate = self.levels.candidate(&estimate, level);
            least(
                &mut held_out,
                self.validator.errors_over(&candidate, self.horizons()),
            );
            least(&mut fitted[0], self.fitted_errors(self.excerpt, fit));
            least(
                &mut fitted[1],
                self.fitted_errors(self.fitter, &candidate.fit),
            );
        }
        let [on_excerpt, fitted] = fitted;
        Some(Baseline {
            discrepancy: self.discrepancy(&estimate),
            random_walk: self.random_walk(&estimate),
            estimate,
            on_excerpt,
            fitted,
            held_out,
        })
    }

    /// Measures structures against the nominal one: those with the most evidence, and
    /// those that leave least; of structures that add to others, only those that leave
    /// less than `most` on the subsample.
    pub fn measure(
        &self,
        baseline: &Baseline,
        estimates: Vec<Estimate>,
        most: f64,
    ) -> Vec<Measured> {
        /// As many of each.
        const MEASURED: usize = 5;
        let progress = self.levels.context.progress;
        progress.step("evidence", 0);
        let mut rough: Vec<Rough> = estimates
            .into_par_iter()
            .filter_map(|estimate| self.rough(baseline, estimate))
            .filter(|row| row.leaves <= most)
            .collect();
        rough.sort_by(|a, b| b.evidence.total_cmp(&a.evidence));
        let mut others = rough.split_off(rough.len().min(MEASURED));
        others.sort_by(|a, b| a.leaves.total_cmp(&b.leaves));
        let ahead = rough
            .iter()
            .map(|row| row.leaves)
            .fold(f64::INFINITY, f64::min);
        others.truncate(MEASURED);
        others.retain(|row| row.leaves <= self.policy.comparable * ahead);
        rough.extend(others);
        progress.step("validation", rough.len());
        rough
            .into_par_iter()
            .filter_map(|rough| self.thorough(baseline, rough))
            .inspect(|row| progress.measured(row, baseline.held_out[2]))
            .collect()
    }

    fn rough(&self, baseline: &Baseline, estimate: Estimate) -> Option<Rough> {
        self.levels.has_time_for(&estimate.added)?;
        let (level, leaves) = (0..estimate.fits.len())
            .map(|level| {
                let errors = self.fitted_errors(self.excerpt, &estimate.fits[level]);
                (
                    level,
                    mean_share(&self.shares(&errors, &baseline.on_excerpt)),
                )
            })
            .filter(|(_, left)| left.is_finite())
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let fit = &estimate.fits[level];
        let more = fit.free.len() as f64 - baseline.estimate.fits[0].free.len() as f64;
        let samples = fit.samples().max(2) as f64;
        let gained = (baseline.discrepancy - self.discrepancy(&estimate))
            .max(baseline.random_walk - self.random_walk(&estimate));
        Some(Rough {
            evidence: gained - more * samples.ln(),
            estimate,
            level,
            leaves,
        })
    }

    fn thorough(&self, baseline: &Baseline, rough: Rough) -> Option<Measured> {
        let Rough {
            estimate,
            level,
            evidence,
            leaves: leaves_roughly,
        } = rough;
        self.levels.has_time_for(&estimate.added)?;
        let candidate = self.levels.candidate(&estimate, level);
        let fitted = self.fitted_errors(self.fitter, &candidate.fit);
        let held_out = self.validator.errors_over(&candidate, self.horizons());
        let shares = self.shares(&held_out, &baseline.held_out);
        let left = mean_share(&self.shares(&fitted, &baseline.fitted));
        let left_out = mean_share(&shares);
        (left.is_finite() && left_out.is_finite()).then(|| Measured {
            scored: Scored {
                kinds: estimate.set(),
                closure: of_shares(shares),
                leaves: (left * left_out).sqrt(),
                evidence,
                parameters: candidate.fit.free.len(),
                degenerate: candidate.is_degenerate(),
            },
            estimate,
            level,
            leaves_roughly,
            candidate,
            held_out,
        })
    }

    fn horizons(&self) -> [f64; 2] {
        horizons(&self.levels.pace)
    }

    /// Errors on the fitted segments, zeros and starts as they suit best.
    fn fitted_errors(&self, fitter: &Fitter<'_>, fit: &Fit) -> Errors {
        let model = &fit.model;
        let compared = fitter.compare_near(model, &fit.nuisances);
        let data = fitter.data;
        Errors::of(&at_horizons(
            &compared.residuals,
            self.horizons(),
            |horizon| block_errors(model, data, &compared.nuisances, horizon, true),
        ))
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
                samples * (fit.sse() / samples).ln()
            })
            .fold(f64::INFINITY, f64::min)
    }
}

/// The two shorter horizons (s): a quarter of a swing, and two and a half.
fn horizons(pace: &Pace) -> [f64; 2] {
    const SWINGS: [f64; 2] = [0.25, 2.5];
    SWINGS.map(|swings| swings * pace.period)
}

/// What a structure closes of another's error beyond the noise, on segments that were not
/// fitted.
pub fn closed(validator: &CrossValidator<'_>, before: &Candidate, after: &Candidate) -> Closure {
    let horizons = horizons(&Pace::of(validator.fitter().data));
    let [before, after] = [before, after].map(|it| validator.errors_over(it, horizons).values());
    closure(&before, &after, validator.floor())
}

/// What RMS errors (rad) at three horizons close of those before, beyond the noise.
pub fn closure(before: &[f64; 3], after: &[f64; 3], noise: f64) -> Closure {
    of_shares(shares(before, after, noise, &Policy::STANDARD))
}

/// Shares of the excess error that are left at each horizon.
fn shares(before: &[f64; 3], after: &[f64; 3], noise: f64, policy: &Policy) -> [f64; 3] {
    let least = policy.noise_share * noise;
    let excess = |error: f64| (error * error - noise * noise).max(least * least).sqrt();
    std::array::from_fn(|horizon| excess(after[horizon]) / excess(before[horizon]))
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
    (shares.iter().map(|share| share.ln()).sum::<f64>() / 3.0).exp()
}
