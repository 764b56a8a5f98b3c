//! Confidence band of a simulated curve, from the uncertainty of the parameters.
//!
//! Near the fit the curve is linear in the parameters. With their covariance Σ and the
//! derivatives j of a sample by the parameters, the variance of the sample is j Σ jᵀ.
//! Changes that the zeros and initial states of sessions can compensate are projected
//! out. Model error is not included: the band of a wrong formula can be narrow.

use model_core::actuator::ParameterId;

use crate::portable::product;

use super::fit::{Fit, student95};
use super::fitter::Fitter;

/// Why there is no band.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoBand {
    /// No parameter was free.
    NothingFitted,
    /// A parameter ended at a bound of its range, where it can move one way only.
    AtBound(ParameterId),
    /// The recordings do not determine some parameters.
    Undetermined,
}

impl Fitter<'_> {
    /// Half widths (rad) of the 95 % band of the simulated angle, sample by sample, for each
    /// fitted segment. The fit may be to these or to other recordings.
    ///
    /// # Errors
    ///
    /// If the fit has no covariance of its parameters.
    pub fn band95(&self, fit: &Fit) -> Result<Vec<Vec<f64>>, NoBand> {
        if fit.free.is_empty() {
            return Err(NoBand::NothingFitted);
        }
        if let Some(index) = (0..fit.free.len()).find(|&index| fit.at_bound(index)) {
            return Err(NoBand::AtBound(fit.free[index]));
        }
        if fit.information.unknowns() != fit.free.len() {
            return Err(NoBand::Undetermined);
        }
        let covariance = fit.information.covariance().ok_or(NoBand::Undetermined)?;
        let factor = student95(fit.information.degrees_of_freedom());
        let derivatives = self.derivatives(fit);
        let spread = product(&derivatives, &covariance);
        let half: Vec<f64> = spread
            .row_iter()
            .zip(derivatives.row_iter())
            .map(|(spread, row)| factor * spread.dot(&row).max(0.0).sqrt())
            .collect();
        if !half.iter().all(|half| half.is_finite()) {
            return Err(NoBand::Undetermined);
        }
        let mut rest = half.as_slice();
        Ok(self
            .data
            .fitted()
            .map(|segment| {
                let (here, after) = rest.split_at(segment.range.len().min(rest.len()));
                rest = after;
                here.to_vec()
            })
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::Dataset;
    use crate::estimate::fit::Effort;
    use model_core::actuator::Model;
    use model_core::dynamics::Dynamics;
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use softrig_formats::recording::Recording;

    /// An overdamped actuator under steps, measured with noise.
    fn measured(model: &Model<f64>, seed: u64) -> Recording {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let time: Vec<f64> = (0..800).map(|k| f64::from(k) * 0.01).collect();
        let pressure = |t: &f64| if (1.0..5.0).contains(t) { 2e4 } else { 0.0 };
        let mut recording = Recording {
            pressure: time.iter().map(pressure).collect(),
            angle: vec![0.0; time.len()],
            time,
            ..Recording::default()
        };
        let clean = Dataset::of(std::slice::from_ref(&recording));
        let session = &clean.sessions()[0];
        let angle = session.simulate(model, &session.guess());
        for (noisy, angle) in recording.angle.iter_mut().zip(angle) {
            let noise: f64 = StandardNormal.sample(&mut random);
            *noisy = angle + 0.01 * noise;
        }
        recording
    }

    fn truth() -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 0.36,
            damping: 1.6,
            stiffness: 3.8,
            exponent: 1.7,
            input_gain: 1.2e-4,
        };
        Model::new(dynamics, &[]).unwrap()
    }

    #[test]
    fn the_curve_without_noise_lies_within_the_band() {
        let truth = truth();
        let free = [ParameterId::Damping, ParameterId::Stiffness];
        let (mut inside, mut all, mut widest) = (0_u32, 0_u32, 0.0_f64);
        for seed in 0..12 {
            let runs = [measured(&truth, 2 * seed), measured(&truth, 2 * seed + 1)];
            let data = Dataset::of(&runs);
            let fitter = Fitter::new(&truth, &data);
            let fit = fitter.fit(&truth, &free, Effort::Full);
            let band = fitter.band95(&fit).unwrap();
            assert_eq!(band.len(), 2);
            let known = fitter.compare(&truth);
            for (session, half) in band.iter().enumerate() {
                let at = &data.sessions()[session];
                let fitted = at.simulate(&fit.model, &fit.nuisances[session]);
                let right = at.simulate(&truth, &known.nuisances[session]);
                for ((fitted, right), half) in fitted.iter().zip(&right).zip(half) {
                    inside += u32::from((fitted - right).abs() <= *half);
                    all += 1;
                    widest = widest.max(*half);
                }
            }
        }
        let share = f64::from(inside) / f64::from(all);
        assert!((0.85..=1.0).contains(&share), "{share}");
        // Far below the noise of a single sample: 1600 of them were fitted.
        assert!(widest > 1e-5 && widest < 0.01, "{widest}");
    }

    #[test]
    fn there_is_no_band_where_nothing_is_free() {
        let model = truth();
        let data = Dataset::of(&[measured(&model, 1)]);
        let fitter = Fitter::new(&model, &data);
        let fit = fitter.compare(&model);
        assert_eq!(fitter.band95(&fit), Err(NoBand::NothingFitted));
    }
}
