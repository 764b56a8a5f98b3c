//! Profile likelihoods: what the recordings say of one parameter, whatever the others are.
//!
//! A standard error takes the sum of squares for a parabola, which is wrong where a model is not
//! linear in a parameter, or where two of them can replace each other. So the parameter is held at
//! values beside the best one, all others are fitted again, and the rise of the sum of squares is
//! drawn (Venzon and Moolgavkar 1988; Raue et al. 2009).

use model_core::actuator::ParameterId;
use rayon::prelude::*;

use super::fit::{Effort, Fit, student95};
use super::fitter::Fitter;

/// How far from the best value to look at first and at last, in standard errors.
const STEPS: [f64; 9] = [0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0];

/// The profile of a parameter.
///
/// With S the sum of squares and v̂ the best value,
///
/// ```text
/// Δχ²(v) = (S(v) − S(v̂)) / s²,   s² = SE² / (H⁻¹)ᵢᵢ
/// ```
///
/// H is the curvature JᵀJ at the best value, and SE the standard error of `softrig fit`, which
/// allows for residuals that are not independent; s² gives the profile at its foot the parabola of
/// SE (the adjusted profile of Pace, Salvan and Sartori 2011). Where Δχ² stays below the square of
/// Student's 95 % point, the value agrees with the recordings.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// The parameter.
    pub id: ParameterId,
    /// Its values (SI), in rising order, and Δχ² at each.
    pub points: Vec<(f64, f64)>,
    /// Its standard error (SI): that of the parabola.
    pub standard_error: f64,
    /// Δχ² up to which a value agrees with the recordings, at 95 %.
    pub limit: f64,
    /// The ends of the values that agree; none on a side where all that were tried agree.
    pub interval95: [Option<f64>; 2],
}

impl Profile {
    /// Of the free parameter at `index` of a fit; none where nothing determines it, or it ended at
    /// a bound.
    pub fn of(fitter: &Fitter<'_>, fit: &Fit, index: usize) -> Option<Self> {
        let id = *fit.free.get(index)?;
        let transform = *fit.transforms.get(index)?;
        let best = fit.model.value(id)?;
        let standard_error = *fit.standard_errors.get(index)?;
        if fit.at_bound(index) || !(standard_error > 0.0 && standard_error.is_finite()) {
            return None;
        }
        let slope = transform.slope(*fit.position.get(index)?);
        let inverse = fit.curvature()?.try_inverse()?;
        let square = standard_error * standard_error / (inverse[(index, index)] * slope * slope);
        if !(square > 0.0 && square.is_finite()) {
            return None;
        }
        let limit = student95(fit.information.degrees_of_freedom()).powi(2);
        let others: Vec<ParameterId> = fit.free.iter().copied().filter(|it| *it != id).collect();
        let side = |sign: f64| {
            let mut points: Vec<(f64, f64)> = Vec::new();
            let mut start = fit.model;
            for step in STEPS {
                let wanted = best + sign * step * standard_error;
                let value = transform.to_value(transform.position(wanted));
                let last = points.last().map_or(best, |(last, _)| *last);
                // At a bound.
                if sign * (value - last) <= 0.0 {
                    break;
                }
                let held = fitter.fit(&start.with_value(id, value), &others, Effort::Full);
                let rise = (held.cost() - fit.cost()) / square;
                if !rise.is_finite() {
                    break;
                }
                // From the last solution to the next: the others follow step by step.
                start = held.model;
                // A better minimum than that of the fit is one of a fit that had not converged.
                points.push((value, rise.max(0.0)));
                if rise > 1.5 * limit {
                    break;
                }
            }
            points
        };
        let [below, above]: [Vec<(f64, f64)>; 2] = [-1.0, 1.0]
            .into_par_iter()
            .map(side)
            .collect::<Vec<_>>()
            .try_into()
            .ok()?;
        let interval95 = [&below, &above].map(|side| crossing(best, side, limit));
        let points = below
            .into_iter()
            .rev()
            .chain([(best, 0.0)])
            .chain(above)
            .collect();
        Some(Self {
            id,
            points,
            standard_error,
            limit,
            interval95,
        })
    }
}

/// Where the profile crosses its limit, on the way outwards. Between points its root is taken for
/// a straight line, as that of a parabola is.
fn crossing(best: f64, side: &[(f64, f64)], limit: f64) -> Option<f64> {
    let mut before = (best, 0.0);
    for &(value, rise) in side {
        if rise >= limit {
            let [from, to] = [before.1, rise].map(f64::sqrt);
            let share = (limit.sqrt() - from) / (to - from);
            return Some(before.0 + share * (value - before.0));
        }
        before = (value, rise);
    }
    None
}

#[cfg(test)]
mod tests {
    use model_core::actuator::Model;
    use model_core::dynamics::Dynamics;
    use softrig_formats::recording::Recording;

    use super::*;
    use crate::estimate::{Dataset, Nuisance};

    /// Runs with noise, of a base model.
    fn recordings(model: &Model<f64>, noise: f64) -> Vec<Recording> {
        (0..6u32)
            .map(|run| {
                let time: Vec<f64> = (0..600).map(|k| 0.01 * f64::from(k)).collect();
                let peak = 20_000.0 + 6_000.0 * f64::from(run);
                let pressure = time
                    .iter()
                    .map(|&t| peak * (1.0 - (-3.0 * t).exp()) * (1.2 + t.sin()));
                let recording = Recording {
                    name: format!("run{run}"),
                    pressure: pressure.collect(),
                    angle: vec![0.0; time.len()],
                    time,
                    ..Recording::default()
                };
                let data = Dataset::of(std::slice::from_ref(&recording));
                let clean = data.sessions()[0].simulate(model, &Nuisance::AT_ZERO);
                let mut state = 1u64 + u64::from(run);
                let angle = clean.iter().map(|angle| {
                    // A sum of twelve uniform numbers is normal enough.
                    let sum: f64 = (0..12)
                        .map(|_| {
                            state = state
                                .wrapping_mul(6_364_136_223_846_793_005)
                                .wrapping_add(1);
                            (state >> 11) as f64 / (1u64 << 53) as f64
                        })
                        .sum();
                    angle + noise * (sum - 6.0)
                });
                Recording {
                    angle: angle.collect(),
                    ..recording
                }
            })
            .collect()
    }

    /// With little noise the model is as good as linear in its parameters: the profile is the
    /// parabola of the standard error, its interval that of Student's distribution.
    #[test]
    fn a_well_determined_parameter_has_the_parabola_of_its_standard_error() {
        let dynamics = Dynamics {
            inertia: 0.02,
            damping: 0.15,
            stiffness: 2.0,
            exponent: 1.2,
            input_gain: 6e-5,
        };
        let model = Model::new(dynamics, &[]).unwrap();
        let runs = recordings(&model, 1e-3);
        let data = Dataset::of(&runs);
        let fitter = Fitter::new(&model, &data);
        let free = [ParameterId::Damping, ParameterId::Stiffness];
        let fit = fitter.fit(&model, &free, Effort::Full);
        for (index, id) in free.into_iter().enumerate() {
            let profile = Profile::of(&fitter, &fit, index).unwrap();
            let best = fit.model.value(id).unwrap();
            assert!(profile.points.len() > 8);
            for &(value, rise) in &profile.points {
                let parabola = ((value - best) / profile.standard_error).powi(2);
                assert!(
                    (rise - parabola).abs() < 0.1 * parabola + 0.02,
                    "{rise} {parabola}"
                );
            }
            let (low, high) = fit.interval95(index).unwrap();
            let [below, above] = profile.interval95.map(Option::unwrap);
            assert!((below - low).abs() < 0.05 * (high - low), "{below} {low}");
            assert!((above - high).abs() < 0.05 * (high - low), "{above} {high}");
        }
    }

    /// An inertia that does not show agrees with the recordings down to nothing: no parabola.
    #[test]
    fn a_parameter_that_does_not_show_is_open_on_one_side() {
        let dynamics = Dynamics {
            inertia: 1e-4,
            damping: 0.5,
            stiffness: 2.0,
            exponent: 1.2,
            input_gain: 6e-5,
        };
        let model = Model::new(dynamics, &[]).unwrap();
        let runs = recordings(&model, 5e-3);
        let data = Dataset::of(&runs);
        let start = model.with_value(ParameterId::Inertia, 4e-3);
        let fitter = Fitter::new(&start, &data);
        let free = [
            ParameterId::Inertia,
            ParameterId::Damping,
            ParameterId::Stiffness,
        ];
        let fit = fitter.fit(&start, &free, Effort::Full);
        let profile = Profile::of(&fitter, &fit, 0);
        let open = profile.is_none_or(|profile| profile.interval95[0].is_none());
        assert!(open, "{fit:?}");
    }
}
