//! Prediction-error fits at a chosen horizon, by a Kalman filter.
//!
//! A free-running simulation integrates every small disturbance: swings drift out of
//! phase, a near-integrator wanders off, and the sum of squares has many local minima.
//! A Kalman filter corrects the simulation as it goes. One number sets how much it
//! corrects, the process-noise intensity λ ([`Level`]). With a large λ the filter
//! forgets within a few samples, and only fast dynamics are compared. With λ = 0 only the
//! initial state is estimated: that is the output error of `problem`.

use model_core::actuator::{Model, State};
use nalgebra::{Matrix3, Vector3};

use super::dataset::{Dataset, Session};
use super::nuisance::Nuisance;
use crate::estimate::smooth::motions;
use crate::sim::dual::Dual;
use crate::sim::fixed_power::{Fixed, FixedPower};
use crate::sim::simulate::{Origin, advance, is_lost, state_at};
use crate::sim::work::Work;
use crate::statistics::{mean, rms, robust_deviation};

/// Time and rate scales of the recorded motion, for the initial covariance of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pace {
    /// Period T₀ = 2π·std(θ)/rms(ω) of a swing of the same size and speed (s).
    pub period: f64,
    /// RMS rate (rad/s).
    pub rate: f64,
}

impl Pace {
    /// Takes the scales from the fitted segments.
    pub fn of(data: &Dataset) -> Self {
        let mut rates = Vec::new();
        let mut spread = Vec::new();
        let mut longest: f64 = 0.0;
        for segment in data.fitted() {
            let recording = &segment.recording;
            rates.extend(motions(recording).map(|motion| motion.rate));
            let middle = mean(&recording.angle);
            spread.extend(recording.angle.iter().map(|angle| angle - middle));
            longest = longest.max(recording.duration());
        }
        let rate = rms(&rates).max(1e-6);
        let period = std::f64::consts::TAU * rms(&spread) / rate;
        Self {
            period: period.clamp(1e-3, longest.max(1e-3)),
            rate,
        }
    }
}

/// A level of the prediction horizon.
///
/// The missing force is a random walk df = σ dW with λ = σ/r, where r is the noise of the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// Process-noise intensity λ = σ/r (N/(rad·√s)), above zero.
    pub intensity: f64,
    /// Noise r of the angle (rad).
    pub noise: f64,
    /// The recorded motion.
    pub pace: Pace,
    /// Threshold of the Huber loss (rad, after division by √S): larger innovations count
    /// linearly (Huber, Ann. Math. Stat. 35, 1964). None: least squares.
    pub outlier: Option<f64>,
}

impl Level {
    /// An innovation after the Huber loss, and its derivative.
    pub fn counted(&self, innovation: f64) -> [f64; 2] {
        match self.outlier {
            Some(limit) if innovation.abs() > limit => {
                let counted = (2.0 * limit * innovation.abs() - limit * limit).sqrt();
                [counted.copysign(innovation), limit / counted]
            }
            _ => [innovation, 1.0],
        }
    }
}

/// One sample of a filter pass.
#[derive(Clone, Copy, Debug)]
pub struct Innovation<const N: usize> {
    /// Predicted minus measured angle e (rad), with its derivatives.
    pub error: Dual<N>,
    /// Its variance S in units of the noise's.
    pub variance: f64,
}

/// Angle θ (rad), its rate ω (rad/s) and the missing force f (N), with their covariance in
/// units of the noise's variance.
pub type Estimate = (Vector3<f64>, Matrix3<f64>);

/// One step of the filter, from the sample before to a sample.
#[derive(Clone, Copy, Debug)]
pub struct Step<const N: usize> {
    /// What the measured angle adds; at a sample without a usable angle it is not used.
    pub innovation: Innovation<N>,
    /// Whether the angle was usable.
    pub is_measured: bool,
    /// The derivative of the estimate by that at the sample before, hidden states held.
    pub transition: Matrix3<f64>,
    /// Before the measurement.
    pub predicted: Estimate,
    /// After it.
    pub corrected: Estimate,
}

/// The innovations of a session, see [`walk`]. None if the simulation diverges.
pub fn pass<const N: usize>(
    model: &Model<Dual<N>>,
    session: &Session,
    nuisance: &Nuisance,
    pressure_zero: Dual<N>,
    level: &Level,
    first: usize,
) -> Option<Vec<Innovation<N>>> {
    let mut found = Vec::with_capacity(session.recording().len());
    let note = |step: &Step<N>| found.push(step.innovation);
    walk(model, session, nuisance, pressure_zero, level, first, note)?;
    Some(found)
}

/// Runs the filter over a session, and shows each step to `note`. Of the `N` partials, those
/// from `first` on belong to the filter: one for the pressure zero if that is a variable, then
/// two for the transition matrix. None if the simulation diverges, after the steps until then.
///
/// The filter estimates θ, ω and f from
///
/// ```text
/// M ω̇ = g·p − C·ω − K·sign(θ)|θ|ⁿ − Q − f,   df = σ dW,   y = h(θ) + v,  v ~ N(0, r²)
/// ```
///
/// in units of r². Hidden states of effects follow the corrected motion and are not corrected
/// themselves. Two partials of the dual numbers give the transition matrix; the others carry the
/// derivatives of every innovation by the parameters. The gains are held constant in these
/// derivatives: they depend on the parameters far less than the innovations do.
pub fn walk<const N: usize>(
    model: &Model<Dual<N>>,
    session: &Session,
    nuisance: &Nuisance,
    pressure_zero: Dual<N>,
    level: &Level,
    first: usize,
    mut note: impl FnMut(&Step<N>),
) -> Option<()> {
    let recording = session.recording();
    let signal = session.signal();
    let plain: Model<f64> = model.map(|value| value.value());
    let stepping = session.stepping(&plain);
    let mut evaluations = 0;
    let inertia = plain.dynamics().inertia;
    let origin = Origin {
        pressure_zero,
        ..session.origin(nuisance)
    };
    let prepared = FixedPower::of(model);
    let model = &session.placed(model);
    let model = &model.with_power(Fixed::new(prepared.as_ref()));
    let mut state = state_at(model, signal, &origin);
    let mut force = Dual::constant(0.0);
    let growth = level.intensity * level.intensity;
    let mut covariance = Matrix3::from_diagonal(&Vector3::new(
        1.0,
        (3.0 * level.pace.rate / level.noise).powi(2),
        growth * level.pace.period,
    ));
    let mut transition = Matrix3::identity();
    let estimate = |state: &State<Dual<N>>, force: Dual<N>| {
        Vector3::new(state.angle.value(), state.rate.value(), force.value())
    };
    for (sample, &is_silent) in session.silence().iter().enumerate() {
        if sample > 0 {
            let interval = recording.time[sample] - recording.time[sample - 1];
            state.angle = state.angle.seeded(first, [1.0, 0.0]);
            state.rate = state.rate.seeded(first, [0.0, 1.0]);
            for hidden in state.hidden.iter_mut().flatten() {
                *hidden = hidden.seeded(first, [0.0, 0.0]);
            }
            evaluations += advance(model, signal, sample, pressure_zero, stepping, &mut state);
            if is_lost(state.angle) {
                Work::count(evaluations, true);
                return None;
            }
            let (by_angle, by_rate) = (state.angle.partials(), state.rate.partials());
            let [coasted, pushed] = response(by_rate[first + 1], interval);
            let (to_angle, to_rate) = (-pushed / inertia, -coasted / inertia);
            transition = Matrix3::new(
                by_angle[first],
                by_angle[first + 1],
                to_angle,
                by_rate[first],
                by_rate[first + 1],
                to_rate,
                0.0,
                0.0,
                1.0,
            );
            covariance = transition * covariance * transition.transpose()
                + Matrix3::new(
                    to_angle * to_angle / 5.0,
                    to_angle * to_rate / 4.0,
                    to_angle / 3.0,
                    to_angle * to_rate / 4.0,
                    to_rate * to_rate / 3.0,
                    to_rate / 2.0,
                    to_angle / 3.0,
                    to_rate / 2.0,
                    1.0,
                ) * (growth * interval);
            state.angle += force * Dual::constant(to_angle);
            state.rate += force * Dual::constant(to_rate);
        }
        let shown = model.reading(&state) + Dual::constant(nuisance.angle_zero);
        let error = shown - Dual::constant(recording.angle[sample]);
        let variance = covariance[(0, 0)] + 1.0;
        let predicted = (estimate(&state, force), covariance);
        if !is_silent {
            let gain = covariance.column(0) / variance;
            state.angle -= error * Dual::constant(gain[0]);
            state.rate -= error * Dual::constant(gain[1]);
            force -= error * Dual::constant(gain[2]);
            covariance -= gain * covariance.row(0);
            covariance = 0.5 * (covariance + covariance.transpose());
        }
        note(&Step {
            innovation: Innovation { error, variance },
            is_measured: !is_silent,
            transition,
            predicted,
            corrected: (estimate(&state, force), covariance),
        });
    }
    Work::count(evaluations, true);
    Some(())
}

/// The change of rate and of angle by a unit acceleration over an interval, at the end of
/// which the share `left` of an initial rate remains. Exact for viscous decay, also where
/// an overdamped actuator reaches its final rate within the interval.
fn response(left: f64, interval: f64) -> [f64; 2] {
    /// Hardly any decay: the limit without damping.
    const ALL: f64 = 0.99;
    if left.is_nan() || left >= ALL {
        return [interval, 0.5 * interval * interval];
    }
    // A rate that reverses within an interval has no decay constant.
    let decay = -libm::log(left.max(1e-9)) / interval;
    let coasted = (1.0 - left.max(1e-9)) / decay;
    [coasted, (interval - coasted) / decay]
}

/// The normalised innovations e/√S (rad) of the fitted samples, one series per segment,
/// and the mean ln S. None if the simulation diverges.
///
/// The objective is −2 log L = N ln(Σ e²/S) + Σ ln S with r profiled out. It equals N ln of the sum
/// of squares of e/√S times the geometric mean of all √S, so it is minimised as a sum of squares.
pub fn normalised(
    model: &Model<f64>,
    data: &Dataset,
    nuisances: &[Nuisance],
    level: &Level,
) -> Option<(Vec<Vec<f64>>, f64)> {
    let dual: Model<Dual<2>> = model.map(Dual::constant);
    let mut series = Vec::new();
    let mut sum = 0.0;
    let mut count = 0;
    for (index, session) in data.sessions().iter().enumerate() {
        let ranges = data.fitted_ranges(index);
        if ranges.is_empty() {
            continue;
        }
        let nuisance = &nuisances[index];
        let zero = Dual::constant(nuisance.pressure_zero);
        let passed = pass(&dual, session, nuisance, zero, level, 0)?;
        let silence = session.silence();
        for range in ranges {
            let measured = || range.clone().filter(|&k| !silence[k]).map(|k| &passed[k]);
            sum += measured().map(|it| libm::log(it.variance)).sum::<f64>();
            count += measured().count();
            let over_spread = |it: &Innovation<2>| it.error.value() / it.variance.sqrt();
            series.push(measured().map(over_spread).collect());
        }
    }
    Some((series, sum / count.max(1) as f64))
}

/// The noise of the angle (rad): the usual size of what the filter of `model` does not foresee at
/// the most likely random force, over so many samples as are enough to know it by a few percent.
///
/// A random force takes up what the model lacks, and a time that is missing or late is no motion
/// to it: unlike differences between neighbours, it holds at any spacing of the samples. `noise`
/// is where the search for that force begins.
pub fn noise_floor(
    model: &Model<f64>,
    data: &Dataset,
    nuisances: &[Nuisance],
    noise: f64,
) -> Option<f64> {
    /// The relative error of a median of so many innovations is 2 %.
    const ENOUGH: usize = 4_000;
    /// First innovations of a segment, in which the filter finds its way.
    const SETTLING: usize = 3;
    let mut samples = 0;
    let places: Vec<usize> = data
        .fitted()
        .take_while(|segment| {
            let takes = samples < ENOUGH;
            samples += segment.recording.len();
            takes
        })
        .enumerate()
        .map(|(place, _)| place)
        .collect();
    let part = data.only(&places);
    let pace = Pace::of(data);
    let level = *levels(model, &part, nuisances, noise, pace).first()?;
    let (series, _) = normalised(model, &part, nuisances, &level)?;
    let settled: Vec<f64> = series
        .iter()
        .flat_map(|series| series.iter().skip(SETTLING).copied())
        .collect();
    Some(robust_deviation(&settled)).filter(|noise| noise.is_finite())
}

/// −2 log L of the measured angles at a level, with the noise profiled out and without the
/// Huber loss; infinite if the simulation diverges.
pub fn deviance(model: &Model<f64>, data: &Dataset, nuisances: &[Nuisance], level: &Level) -> f64 {
    let Some((series, log_variance)) = normalised(model, data, nuisances, level) else {
        return f64::INFINITY;
    };
    let count = series.iter().map(Vec::len).sum::<usize>() as f64;
    let squares: f64 = series
        .iter()
        .flatten()
        .map(|it| level.counted(*it)[0].powi(2))
        .sum();
    count * libm::log(squares / count) + count * log_variance
}

/// The levels at which a structure is fitted: the maximum-likelihood intensity for
/// `model`, a thirtieth and a thousandth of it. Output error is the fourth level. The two
/// shortest horizons use the Huber loss.
pub fn levels(
    model: &Model<f64>,
    data: &Dataset,
    nuisances: &[Nuisance],
    noise: f64,
    pace: Pace,
) -> Vec<Level> {
    /// Largest intensity of the search, in units of the intensity that moves the angle by
    /// its noise within one interval.
    const LARGEST: f64 = 10.0;
    /// Half decades of the search below it.
    const HALF_DECADES: i32 = 14;
    /// Divisors of the maximum-likelihood intensity.
    const PARTS: [f64; 3] = [1.0, 30.0, 1000.0];
    /// Innovations beyond so many standard deviations are outliers.
    const OUTLIER: f64 = 3.0;
    let interval = data
        .sessions()
        .iter()
        .map(|session| session.interval())
        .fold(f64::INFINITY, f64::min);
    // A force that acts for one interval moves the angle by ½fh²/M.
    let largest = LARGEST * 2.0 * model.dynamics().inertia / libm::pow(interval, 2.5);
    let at = |intensity: f64| Level {
        intensity,
        noise,
        pace,
        outlier: None,
    };
    let likeliest = (0..=HALF_DECADES)
        .map(|k| at(largest * libm::pow(10f64, -0.5 * f64::from(k))))
        .map(|level| (deviance(model, data, nuisances, &level), level))
        .filter(|(deviance, _)| deviance.is_finite())
        .min_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, likeliest)) = likeliest else {
        return Vec::new();
    };
    PARTS
        .iter()
        .enumerate()
        .map(|(place, part)| {
            let level = at(likeliest.intensity / part);
            let outlier = (place < 2)
                .then(|| normalised(model, data, nuisances, &level))
                .flatten()
                .map(|(series, _)| OUTLIER * robust_deviation(&series.concat()))
                .filter(|limit| *limit > 0.0);
            Level { outlier, ..level }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use model_core::actuator::ParameterId;
    use model_core::catalogue::Kind;
    use model_core::dynamics::Dynamics;
    use nalgebra::{DMatrix, DVector};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::estimate::fit::Effort;
    use crate::estimate::fitter::Fitter;
    use softrig_formats::recording::Recording;

    const INTERVAL_S: f64 = 0.02;

    fn spring(damping: f64, stiffness: f64) -> Model<f64> {
        let dynamics = Dynamics {
            inertia: 0.5,
            damping,
            stiffness,
            exponent: 1.0,
            input_gain: 1e-4,
        };
        Model::new(dynamics, &[]).unwrap()
    }

    /// A spring under a wandering force of this intensity (N/√s), and the noise of its
    /// sensor (rad).
    fn wandering(
        model: &Model<f64>,
        (intensity, noise): (f64, f64),
        samples: usize,
        seed: u64,
    ) -> Recording {
        const STEPS: u32 = 20;
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(seed);
        let mut draw = || -> f64 { StandardNormal.sample(&mut random) };
        let d = model.dynamics();
        let pressure_at = |time: f64| 8e3 * (1.0 + (0.9 * time).sin());
        let dt = INTERVAL_S / f64::from(STEPS);
        let (mut angle, mut rate, mut force) = (0.4, 0.0, 0.0);
        let mut recording = Recording::default();
        for sample in 0..samples {
            let time = INTERVAL_S * sample as f64;
            recording.time.push(time);
            recording.pressure.push(pressure_at(time));
            recording.angle.push(angle + noise * draw());
            for part in 0..STEPS {
                let now = time + dt * f64::from(part);
                force += intensity * dt.sqrt() * draw();
                let pushed = d.input_gain * pressure_at(now)
                    - d.damping * rate
                    - d.stiffness * angle
                    - force;
                rate += dt * pushed / d.inertia;
                angle += dt * rate;
            }
        }
        recording
    }

    fn level(intensity: f64, noise: f64, data: &Dataset) -> Level {
        Level {
            intensity: intensity / noise,
            noise,
            pace: Pace::of(data),
            outlier: None,
        }
    }

    /// The likelihood of a short linear recording by the covariance of all its samples:
    /// no recursion, no gains.
    #[test]
    fn the_filter_has_the_likelihood_of_the_joint_density() {
        let model = spring(0.7, 3.0);
        let (intensity, noise) = (0.4, 0.01);
        let recording = wandering(&model, (intensity, noise), 24, 11);
        let data = Dataset::of(std::slice::from_ref(&recording));
        let level = level(intensity, noise, &data);
        let nuisance = Nuisance::AT_ZERO;
        let found = deviance(&model, &data, &[nuisance], &level);

        // Angle, rate, force: exact transition of a constant force over an interval, by
        // a series of the matrix exponential.
        let d = model.dynamics();
        let h = INTERVAL_S;
        let system = Matrix3::new(
            0.0,
            1.0,
            0.0,
            -d.stiffness / d.inertia,
            -d.damping / d.inertia,
            -1.0 / d.inertia,
            0.0,
            0.0,
            0.0,
        );
        let mut transition = Matrix3::identity();
        let mut term = Matrix3::identity();
        for k in 1..20 {
            term = term * system * (h / f64::from(k));
            transition += term;
        }
        // The random walk as a hundred small steps.
        let mut process_noise = Matrix3::<f64>::zeros();
        let parts = 100;
        for part in 0..parts {
            let left = h * (f64::from(part) + 0.5) / f64::from(parts);
            let mut propagator = Matrix3::identity();
            let mut term = Matrix3::identity();
            for k in 1..20 {
                term = term * system * (left / f64::from(k));
                propagator += term;
            }
            let column = propagator.column(2).into_owned();
            process_noise +=
                column * column.transpose() * (level.intensity.powi(2) * h / f64::from(parts));
        }
        let start = Matrix3::from_diagonal(&Vector3::new(
            1.0,
            (3.0 * level.pace.rate / noise).powi(2),
            level.intensity.powi(2) * level.pace.period,
        ));
        let count = recording.len();
        let mut covariances = vec![start];
        for _ in 1..count {
            let before = covariances[covariances.len() - 1];
            covariances.push(transition * before * transition.transpose() + process_noise);
        }
        let mut joint = DMatrix::<f64>::identity(count, count);
        for i in 0..count {
            let mut cross = covariances[i];
            for j in i..count {
                joint[(i, j)] += cross[(0, 0)];
                if j > i {
                    joint[(j, i)] = joint[(i, j)];
                }
                cross *= transition.transpose();
            }
        }
        let fitter = Fitter::new(&model, &data);
        let free_run = data.sessions()[0].simulate(&model, &nuisance);
        assert_eq!(fitter.data.samples(), count);
        let error = DVector::from_iterator(
            count,
            free_run.iter().zip(&recording.angle).map(|(a, b)| a - b),
        );
        let factor = joint.cholesky().unwrap();
        let squares = error.dot(&factor.solve(&error));
        let log_determinant: f64 = 2.0 * factor.l().diagonal().iter().map(|v| v.ln()).sum::<f64>();
        let n = count as f64;
        let expected = n * (squares / n).ln() + log_determinant;
        assert!(
            (found - expected).abs() < 0.02 * n,
            "{found}, not {expected}"
        );
    }

    /// Of angle, rate and force, by finite differences of the whole step: what creeps stays
    /// where it is and does not follow the derivative.
    #[test]
    fn the_transition_is_the_derivative_of_a_step() {
        let creep = Kind::MaxwellBranch.build(&[2.0, 0.3, 0.2]).unwrap();
        let model = Model::new(*spring(0.7, 3.0).dynamics(), &[creep]).unwrap();
        let recording = wandering(&model, (0.3, 0.005), 40, 5);
        let data = Dataset::known(recording, Nuisance::AT_ZERO);
        let session = &data.sessions()[0];
        let level = level(0.3, 0.005, &data);
        let dual: Model<Dual<2>> = model.map(Dual::constant);
        let mut steps = Vec::new();
        let zero = Dual::constant(0.0);
        let note = |step: &Step<2>| steps.push(*step);
        walk(&dual, session, &Nuisance::AT_ZERO, zero, &level, 0, note).unwrap();
        // The hidden state, by the same walk in plain numbers.
        let stepping = session.stepping(&model);
        let origin = session.origin(&Nuisance::AT_ZERO);
        let mut state = state_at(&model, session.signal(), &origin);
        for sample in 1..steps.len() {
            let (before, _) = steps[sample - 1].corrected;
            let (found, transition) = (steps[sample].predicted.0, steps[sample].transition);
            let moved = |by: [f64; 2]| {
                let mut end = state;
                (end.angle, end.rate) = (before[0] + by[0], before[1] + by[1]);
                advance(&model, session.signal(), sample, 0.0, stepping, &mut end);
                end
            };
            let h = 1e-5;
            for (column, by) in [[h, 0.0], [0.0, h]].into_iter().enumerate() {
                let (forth, back) = (moved(by), moved(by.map(|by| -by)));
                let by_angle = (forth.angle - back.angle) / (2.0 * h);
                let by_rate = (forth.rate - back.rate) / (2.0 * h);
                assert!(
                    (transition[(0, column)] - by_angle).abs() < 1e-6,
                    "{sample}"
                );
                assert!((transition[(1, column)] - by_rate).abs() < 1e-6, "{sample}");
            }
            let free = moved([0.0, 0.0]);
            let pushed =
                Vector3::new(free.angle, free.rate, 0.0) + transition.column(2) * before[2];
            assert!((found - pushed).norm() < 1e-9, "{sample}: {found} {pushed}");
            state = free;
        }
    }

    /// Where a force wanders, output error takes it for a spring; the likely level does
    /// not, over many such forces.
    #[test]
    fn a_wandering_force_does_not_bend_the_stiffness() {
        let truth = spring(0.7, 3.0);
        let (intensity, noise) = (0.3, 0.005);
        let nominal = spring(1.0, 4.0);
        let free = [ParameterId::Damping, ParameterId::Stiffness];
        let errors: Vec<[f64; 2]> = (0..12)
            .map(|seed| {
                let recording = wandering(&truth, (intensity, noise), 1_500, seed);
                let data = Dataset::of(&[recording]);
                let fitter = Fitter::new(&nominal, &data);
                let refit = fitter.fit(&nominal, &free, Effort::Full);
                let pace = Pace::of(&data);
                let known = fitter.compare(&truth).nuisances;
                let found = levels(&truth, &data, &known, noise, pace);
                let likeliest = found[0].intensity * noise;
                assert!(
                    (0.1..1.0).contains(&likeliest),
                    "the walk of {intensity} N/√s is found as {likeliest}"
                );
                let level = fitter.at(Some(&found[0]));
                let at = level.fit(&refit.model, &free, Effort::Full);
                [refit, at].map(|fit| fit.model.dynamics().stiffness / 3.0 - 1.0)
            })
            .collect();
        let [output_error, level] =
            [0, 1].map(|k| rms(&errors.iter().map(|pair| pair[k]).collect::<Vec<_>>()));
        assert!(level < 0.7 * output_error, "{level}, {output_error}");
    }

    /// A hand on the actuator: half a second of nonsense moves a robust level little.
    #[test]
    fn outliers_count_by_their_size() {
        let level = Level {
            intensity: 1.0,
            noise: 0.01,
            pace: Pace {
                period: 1.0,
                rate: 1.0,
            },
            outlier: Some(2.0),
        };
        let [inside, slope] = level.counted(-1.5);
        assert!((inside + 1.5).abs() < 1e-12 && (slope - 1.0).abs() < 1e-12);
        let [outside, slope] = level.counted(10.0);
        // ρ(e) = 2ce − c².
        assert!((outside.powi(2) - (2.0 * 2.0 * 10.0 - 4.0)).abs() < 1e-12);
        let difference = (level.counted(10.0 + 1e-6)[0] - level.counted(10.0 - 1e-6)[0]) / 2e-6;
        assert!((slope - difference).abs() < 1e-6);
    }

    #[test]
    fn a_push_on_an_overdamped_actuator_reaches_its_final_rate() {
        // e^(−50): rate 1/γ, way h/γ.
        let decay: f64 = 500.0;
        let [coasted, pushed] = response((-decay * 0.04_f64).exp(), 0.04);
        assert!((coasted * decay - 1.0).abs() < 1e-6);
        assert!((pushed / ((0.04 - 1.0 / decay) / decay) - 1.0).abs() < 1e-6);
        let [coasted, pushed] = response(1.0, 0.04);
        assert!((coasted - 0.04).abs() < 1e-12 && (pushed - 0.0008).abs() < 1e-12);
    }
}
