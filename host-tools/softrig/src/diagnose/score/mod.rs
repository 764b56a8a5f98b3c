//! The score of effects: which of them the recordings ask for, and where their fits begin.
//!
//! A fit of an effect ends in the minimum next to its start, and no list of starts suits all
//! rigs. The base model's own Kalman filter ([`mod@crate::estimate::filter`]) suggests one. It
//! gives the smoothed motion, along which an effect with its hidden states can be evaluated
//! without simulating anything: the force that it adds, and what it changes in the reading of
//! the sensor.
//!
//! Scores rank and start fits. They are no evidence: what is left of the innovations is far from
//! white.

pub mod grammar;
pub mod localise;
pub mod scales;
pub(crate) mod smoother;
pub mod steps;

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::effects::{Instant, Mechanism, Parameter, Rest, Unit};
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use rayon::prelude::*;

use crate::diagnose::score::scales::{Scales, combinations};
use crate::diagnose::score::smoother::Smoother;
use crate::estimate::filter::{self, Level, Pace, levels};
use crate::estimate::fit::{Effort, Fit};
use crate::estimate::fitter::Fitter;
use crate::estimate::identify::statics::signed_power;
use crate::estimate::nuisance::Nuisance;
use crate::estimate::placement::Placement;
use crate::estimate::smooth::motions;
use crate::estimate::{Dataset, Session};
use crate::sim::dual::Dual;
use crate::statistics::{mean, rms, robust_deviation};
use softrig_formats::recording::Recording;

/// Samples that are enough for a score: whole sessions at even distances in the list.
const ENOUGH: usize = 10_000;

/// Samples on which the most likely random force is found.
const ENOUGH_FOR_INTENSITY: usize = 3_000;

/// Least noise of an angle (rad).
const LEAST_NOISE: f64 = 1e-6;

/// Steps of the base model at the most likely random force.
const FITTED: Effort = Effort::Steps(6);

/// Multiples of a nominal size that the grid has.
const MULTIPLES: [f64; 5] = [0.1, 0.3, 1.0, 3.0, 10.0];

/// Shares of the largest angle that it has.
const SHARES_OF_ANGLE: [f64; 6] = [0.05, 0.15, 0.35, 0.55, 0.75, 0.92];

/// Steps of hidden states between two samples.
const STEPS: u8 = 4;

/// Terms of the base: damping, stiffness, input gain, offset, and the zero of the angle.
const BASE: usize = 5;

/// Largest factor by which a guess changes a base parameter.
const LARGEST_CHANGE: f64 = 5.0;

/// First samples of a session, in which the filter finds its way.
const SETTLING: usize = 3;

/// Innovations beyond this many standard deviations count less (Huber).
const OUTLIER: f64 = 3.0;

/// With how much of the most likely random force the innovations are seen, and which samples.
#[derive(Clone, Copy)]
struct View {
    /// Share of the most likely random force.
    share: f64,
    /// Least rate of a sample, as a share of the RMS: where friction holds, the motion says
    /// nothing about the force.
    moving: f64,
}

/// A thousandth sees what is slow; a few hundredths of it, while the angle moves, friction. With all
/// of it the filter follows the motion, so that a size is right however large the effect is.
///
/// At the most likely random force the filter takes up whatever is slow, so the innovations are
/// ranked in two views with less of it.
const VIEWS: [View; 3] = [
    View {
        share: 1e-3,
        moving: 0.0,
    },
    View {
        share: 0.03,
        moving: 0.3,
    },
    View {
        share: 1.0,
        moving: 0.0,
    },
];

/// The views that rank, the first of them. The others start fits.
const RANKING: usize = 2;

/// The guesses of every effect.
///
/// To first order, the force of an effect and its change of the reading move the innovations e by
/// what the filter makes of them, D: a linear recursion over its transitions and gains. Then
///
/// ```text
/// −e = a D(effect) + ΔC D(ω) + ΔK D(sign(θ)|θ|ⁿ) − Δg D(p) + d D(1) + b D(reading)
/// ```
///
/// is linear in the sizes a of the effect, in the changes of the base parameters and in the zeros,
/// which least squares give. The effect's other parameters (an angle, a time constant) are tried
/// over a grid in the scales of the recordings.
#[derive(Clone, Debug, Default)]
pub struct Guesses {
    each: Vec<(Kind, Vec<Guess>)>,
}

/// An effect as the innovations suggest it, with the base parameters beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    /// The effect.
    pub effect: Effect<f64>,
    /// The base with its changes.
    pub base: Dynamics<f64>,
    /// The view that suggests it.
    view: usize,
    /// What it is worth there: twice the logarithm of the likelihood's ratio, less the price of
    /// its sizes.
    gain: f64,
}

impl Guess {
    /// Whether it comes from a view that ranks.
    pub const fn is_ranked(&self) -> bool {
        self.view < RANKING
    }
}

impl Guesses {
    /// From the filter of the nominal structure, as refitted and as supplied; `noise` is that of
    /// the angle (rad).
    pub fn of(
        fitter: &Fitter<'_>,
        [refit, supplied]: [&Fit; 2],
        noise: f64,
        kinds: &[Kind],
        scales: &Scales,
    ) -> Self {
        let free = &refit.free;
        let bases = [&refit.model, &supplied.model].map(|model| {
            let effects: Vec<_> = refit.model.effects().collect();
            let model = Model::new(*model.dynamics(), &effects).unwrap_or(refit.model);
            Basis::fitted(fitter, &model, free, noise)
        });
        let mut bases: Vec<Basis> = bases.into_iter().flatten().collect();
        bases.sort_by(|a, b| a.deviance.total_cmp(&b.deviance));
        bases.dedup_by(|other, likeliest| other.is_like(likeliest));
        let mut bases = bases.into_iter();
        let mut this = Self::about(fitter, bases.next(), noise, kinds, scales);
        for other in bases {
            this.extend(Self::about(fitter, Some(other), noise, kinds, scales));
        }
        this
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
        let kinds: Vec<Kind> = self.each.iter().map(|(kind, _)| *kind).collect();
        for other in others {
            let Ok(model) = Model::new(*other.model.dynamics(), &own) else {
                continue;
            };
            let basis = Basis::of(fitter, &model, &other.nuisances, noise);
            self.extend(Self::about(fitter, basis, noise, &kinds, scales));
        }
        self
    }

    /// From the filter of a structure, as it is fitted.
    pub fn beside(
        fitter: &Fitter<'_>,
        fit: &Fit,
        noise: f64,
        kinds: &[Kind],
        scales: &Scales,
    ) -> Self {
        let basis = Basis::of(fitter, &fit.model, &fit.nuisances, noise);
        Self::about(fitter, basis, noise, kinds, scales)
    }

    fn about(
        fitter: &Fitter<'_>,
        basis: Option<Basis>,
        noise: f64,
        kinds: &[Kind],
        scales: &Scales,
    ) -> Self {
        let tracks = basis.and_then(|basis| Tracks::of(fitter, &basis, noise, scales));
        let of_kind = |&kind: &Kind| {
            let guesses = tracks.as_ref().map(|tracks| tracks.guesses(kind, scales));
            (kind, guesses.unwrap_or_default())
        };
        Self {
            each: kinds.par_iter().map(of_kind).collect(),
        }
    }

    /// Takes more guesses of the same effects.
    fn extend(&mut self, more: Self) {
        for ((_, guesses), (_, more)) in self.each.iter_mut().zip(more.each) {
            guesses.extend(more);
        }
    }

    /// The guesses of an effect, one for each view.
    pub fn of_kind(&self, kind: Kind) -> &[Guess] {
        self.each
            .iter()
            .find(|(known, _)| *known == kind)
            .map_or(&[], |(_, guesses)| guesses)
    }

    /// What an effect is worth in a view that ranks.
    fn gain(&self, kind: Kind, view: usize) -> Option<f64> {
        let mut guesses = self.of_kind(kind).iter();
        guesses.find(|it| it.view == view).map(|it| it.gain)
    }

    /// Whether no view that ranks tells two effects apart: along this motion they push alike.
    pub fn worth_the_same(&self, one: Kind, other: Kind) -> bool {
        /// Far above the rounding of a score, far below what two forces differ by.
        const SAME: f64 = 1e-6;
        (0..RANKING).all(
            |view| match (self.gain(one, view), self.gain(other, view)) {
                (Some(one), Some(other)) => {
                    (one - other).abs() <= SAME * one.abs().max(other.abs())
                }
                (one, other) => one.is_none() && other.is_none(),
            },
        )
    }

    /// The effects by their scores, those of the views in turn.
    pub fn ranked(&self) -> Vec<Kind> {
        let in_view = |view: usize| {
            let mut all: Vec<(f64, Kind)> = self
                .each
                .iter()
                .filter_map(|(kind, _)| Some((self.gain(*kind, view)?, *kind)))
                .collect();
            all.sort_by(|a, b| b.0.total_cmp(&a.0));
            all.into_iter().map(|(_, kind)| kind).collect::<Vec<Kind>>()
        };
        let views: Vec<Vec<Kind>> = (0..RANKING).map(in_view).collect();
        let longest = views.iter().map(Vec::len).max().unwrap_or(0);
        let mut ranked: Vec<Kind> = Vec::new();
        for place in 0..longest {
            for kind in views.iter().filter_map(|view| view.get(place)) {
                if !ranked.contains(kind) {
                    ranked.push(*kind);
                }
            }
        }
        ranked
    }
}

/// The structure without the effects that are scored, at the most likely random force.
struct Basis {
    model: Model<f64>,
    nuisances: Vec<Nuisance>,
    level: Level,
    /// −2 log L there.
    deviance: f64,
}

impl Basis {
    /// A model as it is.
    fn of(
        fitter: &Fitter<'_>,
        model: &Model<f64>,
        nuisances: &[Nuisance],
        noise: f64,
    ) -> Option<Self> {
        let data = fitter.data;
        let part = part(data, ENOUGH_FOR_INTENSITY);
        let pace = Pace::of(data);
        let level = *levels(model, &part, nuisances, noise.max(LEAST_NOISE), pace).first()?;
        let level = Level {
            outlier: None,
            ..level
        };
        let deviance = filter::deviance(model, &part, nuisances, &level);
        deviance.is_finite().then(|| Self {
            model: *model,
            nuisances: nuisances.to_vec(),
            level,
            deviance,
        })
    }

    /// Whether its base is like another's, as far as the start of a fit is concerned.
    fn is_like(&self, other: &Self) -> bool {
        /// Largest ratio of their parameters.
        const ALIKE: f64 = 1.5;
        let of = |it: &Self| {
            let base = *it.model.dynamics();
            [base.damping, base.stiffness, base.input_gain]
        };
        let mut pairs = of(self).into_iter().zip(of(other));
        pairs.all(|(a, b)| (1.0 / ALIKE..=ALIKE).contains(&(a / b)))
    }

    /// A model whose `free` parameters are fitted at the most likely random force, from zeros as
    /// they are expected: a fit that lacks an effect has bent them.
    fn fitted(
        fitter: &Fitter<'_>,
        model: &Model<f64>,
        free: &[ParameterId],
        noise: f64,
    ) -> Option<Self> {
        let data = fitter.data;
        let expected: Vec<Nuisance> = data.expected();
        let start = Self::of(fitter, model, &expected, noise)?;
        let part = part(data, ENOUGH_FOR_INTENSITY).guessing(&expected);
        let of_part = Fitter::new(fitter.nominal, &part).at(Some(&start.level));
        let fit = of_part.fit(model, free, FITTED);
        // What the sessions of the part agree on is a guess for the others.
        let zeros: Vec<f64> = (0..data.sessions().len())
            .filter(|&index| !part.fitted_ranges(index).is_empty())
            .filter_map(|index| Some(fit.nuisances.get(index)?.pressure_zero))
            .collect();
        let nuisances: Vec<Nuisance> = expected
            .into_iter()
            .map(|it| Nuisance {
                pressure_zero: mean(&zeros),
                ..it
            })
            .collect();
        if !fit.sse().is_finite() {
            return Some(start);
        }
        Self::of(fitter, &fit.model, &nuisances, noise)
    }
}

/// A sample of the smoothed motion.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sample {
    time: f64,
    angle: f64,
    rate: f64,
    acceleration: f64,
    pressure: f64,
    /// sign(θ)|θ|ⁿ of the base.
    spring: f64,
}

/// What a filter does at a sample.
#[derive(Clone, Copy, Debug)]
struct Link {
    /// From the sample before.
    transition: Matrix3<f64>,
    gain: Vector3<f64>,
    /// Predicted minus measured angle, over its standard deviation, times the weight.
    innovation: f64,
    /// Weight over the standard deviation; zero where the innovation does not count.
    weight: f64,
}

/// A session: its motion, and the filter at each sample of it in every view.
struct Track {
    /// How the rig stood.
    placement: Placement,
    samples: Vec<Sample>,
    views: Vec<Vec<Link>>,
}

/// The sessions that a score looks at.
struct Tracks {
    sessions: Vec<Track>,
    base: Dynamics<f64>,
    /// Weight of a departure of the angle's zero (rad⁻¹), in units of an innovation.
    zero: f64,
    /// The base's own terms in every view.
    terms: Vec<Terms>,
}

/// What an effect adds at each sample of a session: force (N) and reading (rad).
struct EffectTerms {
    force: Vec<f64>,
    reading: Vec<f64>,
}

/// The base's columns in a view, and the sum of squares that they leave.
struct Terms {
    columns: Vec<Vec<f64>>,
    innovations: Vec<f64>,
    normal: DMatrix<f64>,
    right: DVector<f64>,
    left: f64,
    count: f64,
}

impl Tracks {
    fn of(fitter: &Fitter<'_>, basis: &Basis, noise: f64, scales: &Scales) -> Option<Self> {
        let noise = noise.max(LEAST_NOISE);
        let chosen = part(fitter.data, ENOUGH);
        let smoother = Smoother {
            model: &basis.model,
            noise,
            force: scales.force(),
            pace: basis.level.pace,
        };
        let sessions: Vec<Track> = chosen
            .sessions()
            .par_iter()
            .enumerate()
            .filter(|(index, _)| !chosen.fitted_ranges(*index).is_empty())
            .filter_map(|(index, session)| {
                let nuisance = basis.nuisances.get(index)?;
                Track::of(&smoother, &chosen, index, session, nuisance, &basis.level)
            })
            .collect();
        let deviation = sessions_zero(&chosen);
        let mut this = Self {
            sessions,
            base: *basis.model.dynamics(),
            zero: noise / deviation,
            terms: Vec::new(),
        };
        this.weigh();
        this.terms = (0..VIEWS.len())
            .map(|view| this.terms_of(view))
            .collect::<Option<_>>()?;
        Some(this)
    }

    /// Weighs down outliers, and leaves out what does not move.
    fn weigh(&mut self) {
        let rates: Vec<f64> = self
            .sessions
            .iter()
            .flat_map(|track| track.samples.iter().map(|sample| sample.rate))
            .collect();
        let usual = rms(&rates);
        for (place, view) in VIEWS.iter().enumerate() {
            let all: Vec<f64> = self
                .sessions
                .iter()
                .flat_map(|track| &track.views[place])
                .filter(|link| link.weight > 0.0)
                .map(|link| link.innovation)
                .collect();
            let limit = OUTLIER * robust_deviation(&all);
            for track in &mut self.sessions {
                for (link, sample) in track.views[place].iter_mut().zip(&track.samples) {
                    let weight = if sample.rate.abs() < view.moving * usual {
                        0.0
                    } else {
                        (limit / link.innovation.abs()).min(1.0)
                    };
                    link.innovation *= weight;
                    link.weight *= weight;
                }
            }
        }
    }

    fn terms_of(&self, view: usize) -> Option<Terms> {
        let column = |of: &dyn Fn(&Sample) -> [f64; 2]| -> Vec<f64> {
            let each = |track: &Track| {
                let [force, reading] = [0, 1].map(|which| {
                    let samples = track.samples.iter();
                    samples.map(|sample| of(sample)[which]).collect()
                });
                EffectTerms { force, reading }
            };
            let sessions = self.sessions.iter();
            sessions
                .flat_map(|track| track.response(&each(track), view))
                .collect()
        };
        let columns = vec![
            column(&|it| [it.rate, 0.0]),
            column(&|it| [it.spring, 0.0]),
            column(&|it| [-it.pressure, 0.0]),
            column(&|_| [1.0, 0.0]),
            column(&|_| [0.0, 1.0]),
        ];
        let links = || self.sessions.iter().flat_map(|track| &track.views[view]);
        let innovations: Vec<f64> = links().map(|link| link.innovation).collect();
        let count = links().filter(|link| link.weight > 0.0).count() as f64;
        let mut normal = DMatrix::zeros(BASE, BASE);
        let mut right = DVector::zeros(BASE);
        for (a, column) in columns.iter().enumerate() {
            right[a] = -product(column, &innovations);
            for b in 0..=a {
                normal[(a, b)] = product(column, &columns[b]);
                normal[(b, a)] = normal[(a, b)];
            }
        }
        normal[(BASE - 1, BASE - 1)] += self.zero * self.zero;
        let mut this = Terms {
            columns,
            innovations,
            normal,
            right,
            left: 0.0,
            count,
        };
        let (left, _) = this.solved(&[], None)?;
        this.left = left;
        Some(this)
    }

    /// The best guess of an effect in each view.
    fn guesses(&self, kind: Kind, scales: &Scales) -> Vec<Guess> {
        let of_all = |values: &[f64]| -> Option<Vec<EffectTerms>> {
            let effect = kind.build(values)?;
            let sessions = self.sessions.iter();
            Some(
                sessions
                    .map(|track| track.added(&self.base, &effect))
                    .collect(),
            )
        };
        let sizes = self.sizes(kind, scales);
        let mut best: Vec<Option<Guess>> = vec![None; VIEWS.len()];
        let mut fitting = [f64::INFINITY; VIEWS.len()];
        let grid = combinations(kind, |row| {
            let all = choices(kind, row, scales);
            let is_size = sizes
                .iter()
                .any(|&size| kind.parameters()[size].key == row.key);
            if is_size {
                all.into_iter().take(1).collect()
            } else {
                all
            }
        });
        for values in grid {
            // One effect for each size, the others without: it is linear in each.
            let alone = |size: usize| {
                let only: Vec<f64> = (0..values.len())
                    .map(|place| {
                        let is_other = sizes.contains(&place) && place != size;
                        if is_other { 0.0 } else { values[place] }
                    })
                    .collect();
                of_all(&only)
            };
            let parts: Option<Vec<Vec<EffectTerms>>> = if sizes.is_empty() {
                of_all(&values).map(|part| vec![part])
            } else {
                sizes.iter().map(|&size| alone(size)).collect()
            };
            let Some(parts) = parts else {
                continue;
            };
            for (view, terms) in self.terms.iter().enumerate() {
                let columns: Vec<Vec<f64>> = parts
                    .iter()
                    .map(|part| {
                        let tracks = self.sessions.iter().zip(part);
                        tracks
                            .flat_map(|(track, added)| track.response(added, view))
                            .collect()
                    })
                    .collect();
                let Some((left, solution)) = terms.solved(&columns, None) else {
                    continue;
                };
                let price = libm::log(terms.count) * columns.len() as f64;
                let gain = terms.count * libm::log(terms.left / left) - price;
                // Without a size of its own an effect is there as it is, or not.
                let (shown, solution) = if sizes.is_empty() {
                    match terms.solved(&[], columns.first()) {
                        Some(as_it_is) if solution[BASE] > 0.0 => as_it_is,
                        _ => continue,
                    }
                } else {
                    (left, solution)
                };
                let Some(sized) = sized(kind, &values, &sizes, &solution) else {
                    continue;
                };
                let before = best[view].as_ref().map_or(f64::NEG_INFINITY, |it| it.gain);
                if shown < fitting[view] {
                    fitting[view] = shown;
                    let base = self.changed(solution.as_slice());
                    best[view] = kind.build(&sized).map(|effect| Guess {
                        effect,
                        base,
                        view,
                        gain: before,
                    });
                }
                if let Some(guess) = &mut best[view] {
                    guess.gain = guess.gain.max(gain);
                }
            }
        }
        best.into_iter().flatten().collect()
    }

    /// The free parameters in which an effect is linear: forces, or the one that only says how
    /// much of it there is.
    fn sizes(&self, kind: Kind, scales: &Scales) -> Vec<usize> {
        /// Largest deviation from a line that rounding makes.
        const ROUNDING: f64 = 1e-9;
        let rows = kind.parameters();
        let is_free = |place: &usize| rows[*place].held.is_none();
        let forces: Vec<usize> = (0..rows.len())
            .filter(|place| is_free(place) && rows[*place].unit.is_force())
            .collect();
        if !forces.is_empty() {
            return forces;
        }
        let Some(track) = self.sessions.first() else {
            return Vec::new();
        };
        let values: Vec<f64> = rows
            .iter()
            .map(|row| choices(kind, row, scales).first().copied().unwrap_or(1.0))
            .collect();
        let added = |place: usize, times: f64| {
            let mut values = values.clone();
            values[place] *= times;
            let added = track.added(&self.base, &kind.build(&values)?);
            Some([added.force, added.reading].concat())
        };
        let is_linear = |place: &usize| {
            let Some((half, whole)) = added(*place, 0.5).zip(added(*place, 1.0)) else {
                return false;
            };
            let apart: f64 = half
                .iter()
                .zip(&whole)
                .map(|(half, whole)| (2.0 * half - whole).powi(2))
                .sum();
            let size = product(&whole, &whole);
            size > 0.0 && apart <= ROUNDING * ROUNDING * size
        };
        (0..rows.len())
            .filter(is_free)
            .filter(is_linear)
            .take(1)
            .collect()
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

/// The parameters of an effect with the sizes of a solution; none where a force has a sign that it
/// cannot have. A size that is not a force goes to the edge of its range.
fn sized(kind: Kind, values: &[f64], sizes: &[usize], solution: &DVector<f64>) -> Option<Vec<f64>> {
    let mut sized = values.to_vec();
    for (&place, factor) in sizes.iter().zip(solution.iter().skip(BASE)) {
        let row = kind.parameters()[place];
        let [lower, upper] = [row.lower, row.upper].map(f64::from);
        sized[place] *= factor;
        let is_within = (lower..=upper).contains(&sized[place]);
        if !is_within && row.unit.is_force() {
            return None;
        }
        sized[place] = sized[place].clamp(lower, upper);
    }
    Some(sized)
}

impl Terms {
    /// What the base's terms and `columns` leave of the innovations, to which an effect of size
    /// one may be added before, and their coefficients.
    fn solved(
        &self,
        columns: &[Vec<f64>],
        added: Option<&Vec<f64>>,
    ) -> Option<(f64, DVector<f64>)> {
        /// A term that nothing shows must not make the matrix singular.
        const RIDGE: f64 = 1e-9;
        let terms = BASE + columns.len();
        let mut normal = DMatrix::zeros(terms, terms);
        let mut right = DVector::zeros(terms);
        normal
            .view_mut((0, 0), (BASE, BASE))
            .copy_from(&self.normal);
        right.rows_mut(0, BASE).copy_from(&self.right);
        let mut sum = product(&self.innovations, &self.innovations);
        if let Some(added) = added {
            sum += 2.0 * product(added, &self.innovations) + product(added, added);
            for (a, column) in self.columns.iter().enumerate() {
                right[a] -= product(column, added);
            }
        }
        for (k, column) in columns.iter().enumerate() {
            let place = BASE + k;
            right[place] = -product(column, &self.innovations);
            let before = self.columns.iter().chain(&columns[..=k]);
            for (other, known) in before.enumerate() {
                normal[(place, other)] = product(column, known);
                normal[(other, place)] = normal[(place, other)];
            }
        }
        for k in 0..terms {
            normal[(k, k)] += RIDGE * normal[(k, k)] + f64::MIN_POSITIVE;
        }
        let solution = normal.cholesky()?.solve(&right);
        let left = sum - right.dot(&solution);
        (left.is_finite() && left > 0.0).then_some((left, solution))
    }
}

/// The sum of the products of two lists.
pub(crate) fn product(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Whole sessions at even distances in the list, with about `enough` samples; all stay in their
/// places.
fn part(data: &Dataset, enough: usize) -> Dataset {
    let samples: usize = data.fitted().map(|it| it.recording.len()).sum();
    let stride = samples.div_ceil(enough).max(1);
    let count = data.fitted().count();
    let places: Vec<usize> = (0..count).step_by(stride).collect();
    data.only(&places)
}

/// The usual standard deviation of the angle's zero (rad).
fn sessions_zero(data: &Dataset) -> f64 {
    let sessions = data.sessions().iter();
    let zeros = sessions.map(|session| session.prior().deviation.angle_zero);
    zeros.fold(f64::MIN_POSITIVE, f64::max)
}

impl Track {
    fn of(
        smoother: &Smoother<'_>,
        data: &Dataset,
        index: usize,
        session: &Session,
        nuisance: &Nuisance,
        likeliest: &Level,
    ) -> Option<Self> {
        let recording = session.corrected(nuisance);
        let intensity = likeliest.intensity * smoother.noise;
        let found = smoother.smooth(session, nuisance, intensity);
        let exponent = smoother.model.dynamics().exponent;
        let mut samples: Vec<Sample> = (0..recording.len())
            .map(|k| Sample {
                time: recording.time[k],
                angle: found.angle[k],
                rate: found.rate[k],
                acceleration: 0.0,
                pressure: recording.pressure[k],
                spring: signed_power(found.angle[k], exponent),
            })
            .collect();
        if samples
            .iter()
            .any(|it| !(it.angle.is_finite() && it.rate.is_finite()))
        {
            return None;
        }
        for k in 1..samples.len() {
            let (before, at) = (samples[k - 1], samples[k]);
            samples[k].acceleration = (at.rate - before.rate) / (at.time - before.time);
        }
        let ranges = data.fitted_ranges(index);
        let first = ranges.iter().map(|range| range.start).min().unwrap_or(0);
        let dual: Model<Dual<2>> = smoother.model.map(Dual::constant);
        let zero = Dual::constant(nuisance.pressure_zero);
        let views = VIEWS.iter().map(|view| {
            let level = Level {
                intensity: view.share * likeliest.intensity,
                outlier: None,
                ..*likeliest
            };
            let mut links = Vec::with_capacity(samples.len());
            filter::walk(&dual, session, nuisance, zero, &level, 0, |step| {
                let sample = links.len();
                let spread = step.innovation.variance.sqrt();
                let is_fitted = ranges.iter().any(|range| range.contains(&sample));
                let counts = step.is_measured && is_fitted && sample >= first + SETTLING;
                let weight = if counts { 1.0 / spread } else { 0.0 };
                let gain = if step.is_measured {
                    step.predicted.1.column(0) / step.innovation.variance
                } else {
                    Vector3::zeros()
                };
                links.push(Link {
                    transition: step.transition,
                    gain,
                    innovation: weight * step.innovation.error.value(),
                    weight,
                });
            })?;
            Some(links)
        });
        Some(Self {
            placement: session.placement(),
            views: views.collect::<Option<_>>()?,
            samples,
        })
    }

    /// By how much the innovations of a view change with what is added to the model, to first
    /// order.
    fn response(&self, added: &EffectTerms, view: usize) -> Vec<f64> {
        let mut state = Vector3::zeros();
        let mut before = 0.0;
        let each = self.views[view]
            .iter()
            .zip(&added.force)
            .zip(&added.reading);
        each.enumerate()
            .map(|(k, ((link, &force), &reading))| {
                if k > 0 {
                    state[2] += 0.5 * (before + force);
                    let moved = link.transition * state;
                    state[2] -= 0.5 * (before + force);
                    (state[0], state[1]) = (moved[0], moved[1]);
                }
                before = force;
                let error = state[0] + reading;
                state -= link.gain * error;
                link.weight * error
            })
            .collect()
    }

    /// What an effect adds along the motion.
    fn added(&self, base: &Dynamics<f64>, effect: &Effect<f64>) -> EffectTerms {
        added(base, &self.placement.place_effect(*effect), &self.samples)
    }
}

/// The force (N) that an effect adds against a measured motion, a sample each: one that acts on the
/// sensor alone adds none.
pub(crate) fn force_along(
    base: &Dynamics<f64>,
    effect: &Effect<f64>,
    recording: &Recording,
) -> Vec<f64> {
    added(base, effect, &measured(base, recording)).force
}

/// The rate, the spring sign(θ)|θ|ⁿ and the pressure along a measured motion: what damping,
/// stiffness and input gain of the base change.
pub(crate) fn base_along(base: &Dynamics<f64>, recording: &Recording) -> [Vec<f64>; 3] {
    let samples = measured(base, recording);
    let of = |it: &dyn Fn(&Sample) -> f64| samples.iter().map(it).collect();
    [
        of(&|it| it.rate),
        of(&|it| it.spring),
        of(&|it| it.pressure),
    ]
}

fn measured(base: &Dynamics<f64>, recording: &Recording) -> Vec<Sample> {
    motions(recording)
        .map(|motion| Sample {
            time: recording.time[motion.place],
            angle: motion.angle,
            rate: motion.rate,
            acceleration: motion.acceleration,
            pressure: recording.pressure[motion.place],
            spring: signed_power(motion.angle, base.exponent),
        })
        .collect()
}

/// The force (N) that an effect adds against the motion at each sample, and what it adds to the
/// reading (rad).
fn added(base: &Dynamics<f64>, effect: &Effect<f64>, session: &[Sample]) -> EffectTerms {
    let mut found = EffectTerms {
        force: Vec::with_capacity(session.len()),
        reading: Vec::with_capacity(session.len()),
    };
    let Some(first) = session.first() else {
        return found;
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
    for (k, sample) in session.iter().enumerate() {
        while delayed < k && session[delayed + 1].time <= sample.time - delay {
            delayed += 1;
        }
        let entering = session[delayed].pressure;
        // The instant, the force and the reading, and the rates of the hidden states.
        let acting = |hidden: &[f64; 2], rates: &mut [f64; 2]| {
            let behind = effect.input(entering, hidden, rates);
            let at = Instant {
                time: sample.time,
                angle: sample.angle,
                rate: sample.rate,
                pressure: behind,
            };
            let force = effect.force(&at, hidden, rates);
            effect.respond(sample.acceleration, hidden, rates);
            let reading = effect.sensor(sample.angle, sample.time, hidden, rates);
            (at, force, reading)
        };
        let (at, force, reading) = acting(&hidden, &mut [0.0; 2]);
        let modulated = if effect.modulates() {
            let mut changed = *base;
            effect.modulate(&at, &hidden, &mut changed);
            resistance(&changed, sample, base.exponent) - resistance(base, sample, base.exponent)
                + (base.input_gain - changed.input_gain) * at.pressure
        } else {
            0.0
        };
        let undriven = base.input_gain * (sample.pressure - at.pressure);
        found.force.push(force + modulated + undriven);
        found.reading.push(reading - sample.angle);
        if let Some(next) = session.get(k + 1)
            && effect.integrates()
        {
            let step = (next.time - sample.time) / f64::from(STEPS);
            for _ in 0..STEPS {
                let mut rates = [0.0; 2];
                acting(&hidden, &mut rates);
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

/// C ω + K sign(θ)|θ|ⁿ, with the power where the exponent is not that of the base.
#[expect(clippy::float_cmp, reason = "most effects leave the exponent as it is")]
fn resistance(dynamics: &Dynamics<f64>, sample: &Sample, exponent: f64) -> f64 {
    let spring = if dynamics.exponent == exponent {
        sample.spring
    } else {
        signed_power(sample.angle, dynamics.exponent)
    };
    dynamics.damping * sample.rate + dynamics.stiffness * spring
}

/// Values of a parameter over the scales of the recordings. Forces have any size.
fn choices(kind: Kind, row: &Parameter, scales: &Scales) -> Vec<f64> {
    let nominal = scales.starts_of(kind, row);
    if row.held.is_some() || row.unit.is_force() {
        return nominal.into_iter().take(1).collect();
    }
    let mut choices = match row.unit {
        Unit::Hertz => nominal,
        Unit::Given(unit) if unit != "rad" && row.lower > 0.0 && row.upper.is_finite() => {
            ladder(row).into_iter().chain(nominal).collect()
        }
        Unit::Radian | Unit::Given("rad") => {
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

/// Values from one bound of a parameter of a formula to the other.
fn ladder(row: &Parameter) -> Vec<f64> {
    /// Ratio of neighbours: a wave found from the nearest of them is in step over three periods.
    const RATIO: f64 = std::f64::consts::SQRT_2;
    /// Most steps.
    const STEPS: usize = 12;
    let [lower, upper] = [row.lower, row.upper].map(f64::from);
    let range = libm::log(upper / lower);
    let steps = (1..=STEPS)
        .find(|&steps| steps as f64 * libm::log(RATIO) >= range)
        .unwrap_or(STEPS);
    (0..=steps)
        .map(|step| lower * libm::exp(range * step as f64 / steps as f64))
        .map(|value| value.clamp(lower, upper))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::diagnose::fit::candidates::applicable;
    use crate::synth::example::{Hidden, make};
    use softrig_formats::model_file::ModelFile;

    const NOISE_DEG: f64 = 0.3;

    fn example(hidden: Hidden) -> (ModelFile, Dataset) {
        let example = make(hidden, NOISE_DEG, 7).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example.recordings.into_iter().map(|it| it.1).collect();
        (file, Dataset::of(&recordings))
    }

    /// What the recursion says is what the filter of a model with a little of the effect does, in the
    /// views that rank: with all of the random force little is left of it beside the noise.
    #[test]
    fn a_response_is_the_change_of_the_innovations() {
        let (file, data) = example(Hidden::Nothing);
        let fitter = Fitter::new(&file.model, &data);
        let noise = NOISE_DEG.to_radians();
        let scales = Scales::of(&fitter, &fitter.compare(&file.model));
        let basis = Basis::of(&fitter, &file.model, &data.expected(), noise).unwrap();
        let tracks = Tracks::of(&fitter, &basis, noise, &scales).unwrap();
        let track = &tracks.sessions[0];
        let stiffness = 0.02 * file.model.dynamics().stiffness;
        for (kind, values) in [
            (Kind::CubicStiffness, vec![stiffness]),
            (Kind::MaxwellBranch, vec![stiffness, 1.0, 0.0]),
            (Kind::PneumaticLag, vec![0.004]),
            (Kind::SensorNonlinearity, vec![0.01]),
        ] {
            let effect = kind.build(&values).unwrap();
            let with: Model<f64> = Model::new(*file.model.dynamics(), &[effect]).unwrap();
            let added = track.added(&tracks.base, &effect);
            for (view, links) in track.views.iter().enumerate().take(RANKING) {
                let level = Level {
                    intensity: VIEWS[view].share * basis.level.intensity,
                    ..basis.level
                };
                let dual: Model<Dual<2>> = with.map(Dual::constant);
                let (session, nuisance) = (&data.sessions()[0], &basis.nuisances[0]);
                let zero = Dual::constant(nuisance.pressure_zero);
                let mut errors = Vec::new();
                filter::walk(&dual, session, nuisance, zero, &level, 0, |step| {
                    errors.push(step.innovation.error.value());
                })
                .unwrap();
                let changes: Vec<f64> = errors
                    .iter()
                    .zip(links)
                    .map(|(error, link)| link.weight * error - link.innovation)
                    .collect();
                let response = track.response(&added, view);
                let sizes = product(&changes, &changes) * product(&response, &response);
                let alike = product(&changes, &response) / sizes.sqrt();
                assert!(alike > 0.95, "{kind:?} in view {view}: {alike}");
            }
        }
    }

    /// From the model as supplied, without any fit by simulation.
    #[test]
    fn what_is_hidden_is_fitted_first() {
        for kind in [
            Kind::CoulombFriction,
            Kind::QuadraticDamping,
            Kind::MaxwellBranch,
            Kind::BoucWenHysteresis,
            Kind::Gravity,
            Kind::CubicStiffness,
            Kind::PneumaticLag,
            Kind::Leak,
        ] {
            let (file, data) = example(Hidden::Effect(kind));
            let fitter = Fitter::new(&file.model, &data);
            let supplied = fitter.compare(&file.model);
            let scales = Scales::of(&fitter, &supplied);
            let (kinds, _) = applicable(&file.model, &[], &[], &fitter);
            let noise = NOISE_DEG.to_radians();
            let guesses = Guesses::of(&fitter, [&supplied, &supplied], noise, &kinds, &scales);
            let ranked = guesses.ranked();
            let place = ranked.iter().position(|it| *it == kind);
            assert!(place.is_some_and(|place| place < 8), "{kind:?}: {ranked:?}");
        }
    }
}
