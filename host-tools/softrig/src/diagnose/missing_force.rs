//! Initial guesses of effects from the missing force, by algebra.
//!
//! A fit of an effect ends in the minimum next to its start, and no list of starts suits all
//! rigs. The recordings themselves suggest one: the [`super::smoother`] gives the missing
//! force Q of the refit along the measured motion, and an effect with its hidden states can be
//! evaluated along that motion without simulating anything. Then
//!
//! ```text
//! Q = F(effect) + ΔC ω + ΔK sign(θ)|θ|ⁿ − Δg p + c
//! ```
//!
//! is linear in the sizes of the effect's forces and in the changes of the base parameters,
//! which least squares give. The effect's other parameters (an angle, a time constant) are
//! tried over a grid in the scales of the recordings.

use model_core::actuator::Model;
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::effects::{Instant, Mechanism, Parameter, Place, Rest, Unit};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::candidates::{Scales, combinations};
use super::smoother::Smoother;
use crate::estimate::filter::Pace;
use crate::estimate::fit::{Fit, Fitter};
use crate::estimate::nuisance::Nuisance;
use crate::estimate::placement::Placement;

/// Samples of the motion that are enough for a guess.
const ENOUGH: usize = 2_000;

/// Intensity of the missing force's random walk (1/√s), of the largest known force: it
/// follows a corner within a tenth of a second.
const INTENSITY: f64 = 0.1;

/// Multiples of a nominal size that the grid has.
const MULTIPLES: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

/// Shares of the largest angle that it has.
const SHARES_OF_ANGLE: [f64; 6] = [0.05, 0.15, 0.35, 0.55, 0.75, 0.92];

/// Steps of hidden states between two samples.
const STEPS: u8 = 4;

/// Terms of the base: damping, stiffness, input gain, offset.
const BASE: usize = 4;

/// Largest factor by which a guess changes a base parameter.
const LARGEST_CHANGE: f64 = 5.0;

/// The guesses of every effect.
#[derive(Clone, Debug, Default)]
pub struct Guesses {
    each: Vec<(Kind, Vec<Guess>)>,
}

impl Guesses {
    /// From the missing force of a refit; `noise` is that of the angle (rad).
    pub fn of(
        fitter: &Fitter<'_>,
        refit: &Fit,
        noise: f64,
        kinds: &[Kind],
        scales: &Scales,
    ) -> Self {
        let missing = MissingForce::of(
            fitter,
            &refit.model,
            &refit.nuisances,
            noise,
            scales.force(),
        );
        Self {
            each: kinds
                .iter()
                .map(|&kind| (kind, missing.guesses(kind, scales)))
                .collect(),
        }
    }

    /// The same and more: how every effect could stand in for the fitted ones in `others`. What
    /// is missing beside the base parameters of a fit shows better what has to be added to them
    /// than what is missing beside the refit, whose parameters already make up for a part.
    pub fn standing_in<'a>(
        mut self,
        fitter: &Fitter<'_>,
        others: impl IntoIterator<Item = &'a Fit>,
        noise: f64,
        scales: &Scales,
    ) -> Self {
        let own: Vec<_> = fitter.nominal.effects().collect();
        for other in others {
            let Ok(model) = Model::new(*other.model.dynamics(), &own) else {
                continue;
            };
            let missing = MissingForce::of(fitter, &model, &other.nuisances, noise, scales.force());
            for (kind, guesses) in &mut self.each {
                guesses.extend(missing.guesses(*kind, scales));
            }
        }
        self
    }

    /// The guesses of an effect, the best of each missing force first.
    pub fn of_kind(&self, kind: Kind) -> &[Guess] {
        self.each
            .iter()
            .find(|(known, _)| *known == kind)
            .map_or(&[], |(_, guesses)| guesses)
    }
}

/// A sample of the motion.
#[derive(Clone, Copy, Debug)]
struct Sample {
    time: f64,
    angle: f64,
    rate: f64,
    acceleration: f64,
    pressure: f64,
    missing: f64,
}

/// The motion of a session.
#[derive(Clone, Debug)]
struct Motion {
    /// How the rig stood.
    placement: Placement,
    samples: Vec<Sample>,
}

/// The missing force of a model along the motion of each session.
#[derive(Clone, Debug)]
pub struct MissingForce {
    sessions: Vec<Motion>,
    /// Sum of squares of the missing force that the base leaves by itself.
    left_by_base: f64,
    base: Dynamics<f64>,
}

/// An effect as the missing force suggests it, with the base parameters beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    /// The effect.
    pub effect: Effect<f64>,
    /// The base with its changes.
    pub base: Dynamics<f64>,
    /// Share of the missing force's sum of squares that is left.
    pub leaves: f64,
}

impl MissingForce {
    /// Of a model; `noise` is that of the angle (rad).
    pub fn of(
        fitter: &Fitter<'_>,
        model: &Model<f64>,
        nuisances: &[Nuisance],
        noise: f64,
        force: f64,
    ) -> Self {
        let data = fitter.data;
        let smoother = Smoother {
            model,
            noise: noise.max(1e-6),
            force,
            pace: Pace::of(data),
        };
        let stride = data.samples().div_ceil(ENOUGH).max(1);
        let fitted: Vec<_> = data
            .sessions()
            .iter()
            .zip(nuisances)
            .enumerate()
            .filter(|(index, _)| !data.fitted_ranges(*index).is_empty())
            .collect();
        let sessions = fitted
            .into_par_iter()
            .map(|(_, (session, nuisance))| {
                let recording = session.corrected(nuisance);
                let found = smoother.smooth(session, nuisance, INTENSITY * force);
                let samples = (0..recording.len()).step_by(stride).map(|k| Sample {
                    time: recording.time[k],
                    angle: found.angle[k],
                    rate: found.rate[k],
                    acceleration: 0.0,
                    pressure: recording.pressure[k],
                    missing: found.force[k],
                });
                let mut samples: Vec<Sample> =
                    samples.take_while(|it| it.missing.is_finite()).collect();
                for k in 1..samples.len() {
                    let (before, at) = (samples[k - 1], samples[k]);
                    samples[k].acceleration = (at.rate - before.rate) / (at.time - before.time);
                }
                Motion {
                    placement: session.placement(),
                    samples,
                }
            })
            .collect();
        let mut this = Self {
            sessions,
            left_by_base: f64::INFINITY,
            base: *model.dynamics(),
        };
        this.left_by_base = this
            .solved(&[], None)
            .map_or(f64::INFINITY, |(left, _)| left);
        this
    }

    /// The best guesses of an effect, from different cells of the grid; none for an effect
    /// that acts on the sensor, where no force shows it.
    pub fn guesses(&self, kind: Kind, scales: &Scales) -> Vec<Guess> {
        /// Number of guesses.
        const BEST: usize = 2;
        if kind.info().place == Place::Sensor {
            return Vec::new();
        }
        let mut found: Vec<Guess> = combinations(kind, |row| choices(kind, row, scales))
            .into_par_iter()
            .filter_map(|values| self.guess(kind, &values))
            .filter(|guess| guess.leaves.is_finite())
            .collect();
        found.sort_by(|a, b| a.leaves.total_cmp(&b.leaves));
        found.truncate(BEST);
        found
    }

    /// The effect with these parameters, and its forces of the size that the missing force
    /// asks for.
    fn guess(&self, kind: Kind, values: &[f64]) -> Option<Guess> {
        let is_size = |row: &Parameter| row.held.is_none() && row.unit.is_force();
        let sizes: Vec<usize> = (0..values.len())
            .filter(|&place| is_size(&kind.parameters()[place]))
            .collect();
        // One effect for each force, the others without: a force is linear in its size.
        let alone = |size: Option<usize>| {
            let values: Vec<f64> = (0..values.len())
                .map(|place| match size {
                    Some(size) if sizes.contains(&place) && place != size => 0.0,
                    _ => values[place],
                })
                .collect();
            kind.build(&values)
        };
        let of_size_one: Vec<Effect<f64>> =
            sizes.iter().filter_map(|&size| alone(Some(size))).collect();
        let fixed = if sizes.is_empty() {
            Some(alone(None)?)
        } else {
            None
        };
        let (left, solution) = self.solved(&of_size_one, fixed.as_ref())?;
        let mut sized = values.to_vec();
        for (&place, factor) in sizes.iter().zip(solution.iter().skip(BASE)) {
            let row = kind.parameters()[place];
            sized[place] *= factor;
            if !(f64::from(row.lower)..=f64::from(row.upper)).contains(&sized[place]) {
                return None;
            }
        }
        Some(Guess {
            effect: kind.build(&sized)?,
            base: self.changed(solution.as_slice()),
            leaves: left / self.left_by_base,
        })
    }

    /// What is left of the missing force beside an effect of `fixed` size, and the sizes of
    /// the base's terms and of the other effects.
    fn solved(
        &self,
        effects: &[Effect<f64>],
        fixed: Option<&Effect<f64>>,
    ) -> Option<(f64, DVector<f64>)> {
        let (sum, right, normal) = self.products(effects, fixed);
        let solution = normal.cholesky()?.solve(&right);
        let left = sum - right.dot(&solution);
        left.is_finite().then_some((left, solution))
    }

    /// The normal equations: the sum of squares of the missing force less the `fixed` one,
    /// its products with every term, and those of the terms.
    fn products(
        &self,
        effects: &[Effect<f64>],
        fixed: Option<&Effect<f64>>,
    ) -> (f64, DVector<f64>, DMatrix<f64>) {
        /// A term that nothing shows must not make the matrix singular.
        const RIDGE: f64 = 1e-9;
        let terms = BASE + effects.len();
        let mut normal = DMatrix::zeros(terms, terms);
        let mut right = DVector::zeros(terms);
        let mut sum = 0.0;
        let mut row = vec![0.0; terms];
        for session in &self.sessions {
            let of = |effect| forces(&self.base, effect, session);
            let columns: Vec<Vec<f64>> = effects.iter().map(of).collect();
            let known = fixed.map(of);
            for (k, sample) in session.samples.iter().enumerate() {
                let exponent = self.base.exponent;
                row[0] = sample.rate;
                row[1] = libm::pow(sample.angle.abs(), exponent).copysign(sample.angle);
                row[2] = -sample.pressure;
                row[3] = 1.0;
                for (term, column) in row[BASE..].iter_mut().zip(&columns) {
                    *term = column[k];
                }
                let missing = sample.missing - known.as_ref().map_or(0.0, |known| known[k]);
                sum += missing * missing;
                for a in 0..terms {
                    right[a] += row[a] * missing;
                    for b in 0..terms {
                        normal[(a, b)] += row[a] * row[b];
                    }
                }
            }
        }
        for k in 0..terms {
            normal[(k, k)] += RIDGE * normal[(k, k)] + f64::MIN_POSITIVE;
        }
        (sum, right, normal)
    }

    /// The base with changes of its damping, stiffness and gain.
    fn changed(&self, changes: &[f64]) -> Dynamics<f64> {
        let moved = |value: f64, by: f64| {
            let factor = (value + by) / value;
            if factor.is_finite() {
                value * factor.clamp(1.0 / LARGEST_CHANGE, LARGEST_CHANGE)
            } else {
                value
            }
        };
        Dynamics {
            damping: moved(self.base.damping, changes[0]),
            stiffness: moved(self.base.stiffness, changes[1]),
            input_gain: moved(self.base.input_gain, changes[2]),
            ..self.base
        }
    }
}

/// The force (N) that an effect adds against the motion, at each sample.
fn forces(base: &Dynamics<f64>, effect: &Effect<f64>, session: &Motion) -> Vec<f64> {
    let effect = &session.placement.place_effect(*effect);
    let session = session.samples.as_slice();
    let Some(first) = session.first() else {
        return Vec::new();
    };
    let mut hidden = effect.at_rest(&Rest {
        angle: first.angle,
        start: first.angle,
        rate: first.rate,
        pressure: first.pressure,
        reading: first.angle,
    });
    let delay = effect.delay();
    let mut delayed = 0;
    let mut found = Vec::with_capacity(session.len());
    for (k, sample) in session.iter().enumerate() {
        while delayed < k && session[delayed + 1].time <= sample.time - delay {
            delayed += 1;
        }
        let entering = session[delayed].pressure;
        let force = |hidden: &[f64; 2], rates: &mut [f64; 2]| {
            let behind = effect.input(entering, hidden, rates);
            let at = Instant {
                time: sample.time,
                angle: sample.angle,
                rate: sample.rate,
                pressure: behind,
            };
            let mut changed = *base;
            effect.modulate(&at, hidden, &mut changed);
            let added = effect.force(&at, hidden, rates);
            effect.respond(sample.acceleration, hidden, rates);
            added + resistance(&changed, &at) - resistance(base, &at)
                + base.input_gain * (sample.pressure - behind)
                + (base.input_gain - changed.input_gain) * behind
        };
        found.push(force(&hidden, &mut [0.0; 2]));
        if let Some(next) = session.get(k + 1)
            && effect.integrates()
        {
            let step = (next.time - sample.time) / f64::from(STEPS);
            for _ in 0..STEPS {
                let mut rates = [0.0; 2];
                force(&hidden, &mut rates);
                for (state, rate) in hidden.iter_mut().zip(rates) {
                    *state += step * rate;
                }
            }
        }
        if effect.has_memory() {
            effect.note(sample.angle, entering, &mut hidden);
        }
    }
    found
}

/// C ω + K sign(θ)|θ|ⁿ.
fn resistance(dynamics: &Dynamics<f64>, at: &Instant<f64>) -> f64 {
    let spring = libm::pow(at.angle.abs(), dynamics.exponent).copysign(at.angle);
    dynamics.damping * at.rate + dynamics.stiffness * spring
}

/// Values of a parameter over the scales of the recordings. Forces have any size.
fn choices(kind: Kind, row: &Parameter, scales: &Scales) -> Vec<f64> {
    let nominal = scales.starts_of(kind, row);
    if row.held.is_some() || row.unit.is_force() {
        return nominal.into_iter().take(1).collect();
    }
    let mut choices = match row.unit {
        Unit::Hertz => nominal,
        Unit::Radian => {
            let shares = SHARES_OF_ANGLE.map(|share| share * scales.angle());
            nominal.into_iter().chain(shares).collect()
        }
        _ => nominal
            .iter()
            .flat_map(|value| MULTIPLES.map(|multiple| multiple * value))
            .collect(),
    };
    choices.retain(|value| (f64::from(row.lower)..=f64::from(row.upper)).contains(value));
    choices.sort_by(f64::total_cmp);
    // Neighbours that differ by less are one.
    choices.dedup_by(|a, b| (*a - *b).abs() <= 0.2 * b.abs());
    choices
}
