//! Identification of the base model M θ̈ + C θ̇ + K sign(θ)|θ|ⁿ = g p.
//!
//! The sum of squares of a simulated angle has many local minima, and which one a single fit
//! ends in is decided by where it starts. The numbers of a model file may be wrong by orders
//! of magnitude, so they are one start among many: [`starts`] takes others from the
//! recordings, over all time scales that these can show, and from their plateaus
//! ([`statics`]). All are ranked on a subsample, a few fitted there, the best fitted to
//! everything. `softrig init`, `softrig fit` and `softrig diagnose` get the same model from it.

mod remarks;
pub(crate) mod rest;
mod starts;
pub(crate) mod statics;

pub use remarks::far_zeros;

use model_core::actuator::{Model, ParameterId};
use model_core::dynamics::Dynamics;
use rayon::prelude::*;

use super::Dataset;
use super::fit::{Effort, Fit};
use super::fitter::Fitter;
use super::subsample::reduced;
use softrig_formats::recording::PASCAL_PER_KPA;

/// Exponents that are tried where it is free: Hooke's law, and what silicones have.
pub const EXPONENTS: [f64; 4] = [1.0, 1.5, 2.0, 2.5];

/// Samples on which starts are ranked, and on which the best are fitted.
const ENOUGH_TO_RANK: usize = 1_500;
const ENOUGH_TO_FIT: usize = 5_000;

/// Steps in which the gain of a start is adjusted before starts are ranked.
const RANKED: Effort = Effort::Steps(2);

/// Starts that are fitted on the subsample.
const CHOSEN: usize = 10;

/// Steps of these fits.
const COARSE: Effort = Effort::Steps(12);

/// Minima that are fitted to their ends.
const FINALISTS: usize = 3;

/// Two fits are one if their curves differ by at most this share of their error.
const SAME: f64 = 0.1;

/// Two starts lead to one minimum if their curves differ by at most this share of their
/// error.
const SAME_START: f64 = 0.3;

/// Exponents nearer than this are one.
const SAME_EXPONENT: f64 = 0.05;

/// Multiple of the least cost after some steps that may still become the least.
const NEAR: f64 = 1.1;

/// Relative cost by which a minimum may exceed the least and still be as good.
const AS_GOOD: f64 = 0.02;

/// Time constants of the inertia (intervals between samples) that are tried where it does not
/// show, the mildest first.
const INVISIBLE_INERTIA: [f64; 3] = [1.0, 0.5, 0.25];

/// Largest time constant of the inertia, in intervals between samples, that may be none.
pub const HARDLY_VISIBLE: f64 = 3.0;

/// χ² that the inertia has to be worth, and the largest share of the cost that this may be.
const WORTH: f64 = 4.0;
const LARGEST_WORTH: f64 = 0.02;

/// How many derivatives of the angle the recordings show.
///
/// A rig whose inertia does not show (most soft actuators: they creep, rather than swing)
/// determines only the ratios of C, K and g. There the damping is held at a value beside which the
/// inertia vanishes ([`Order::First`]), and the others keep their meaning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Order {
    /// The inertia does not show: C θ̇ + K sign(θ)|θ|ⁿ = g p.
    First,
    /// It does, or it was not asked.
    #[default]
    Second,
}

/// The identified base model.
#[derive(Clone, Debug)]
pub struct Identification {
    /// The best fit to all data.
    pub fit: Fit,
    /// The best fit with all of the free parameters, whether or not the inertia shows.
    pub released: Fit,
    /// Whether the inertia shows. Where it does not, the damping is not among the free
    /// parameters of the fit.
    pub order: Order,
    /// Another minimum that is about as good.
    pub twin: Option<Model<f64>>,
}

/// Fits the base parameters in `free` from every start that recordings suggest; `exponents`
/// are tried if the exponent is free. Effects of `model` start where they are. None if the
/// model cannot be simulated over the data.
pub fn identify(
    model: &Model<f64>,
    free: &[ParameterId],
    exponents: &[f64],
    data: &Dataset,
) -> Option<Identification> {
    Identifier { model, free, data }.best(exponents)
}

/// Whether the angle is driven: the pressure is not zero throughout.
pub fn is_driven(data: &Dataset) -> bool {
    data.sessions()
        .iter()
        .any(|session| session.largest_pressure() > 0.0)
}

#[derive(Clone, Copy)]
struct Identifier<'a> {
    model: &'a Model<f64>,
    free: &'a [ParameterId],
    data: &'a Dataset,
}

impl Identifier<'_> {
    fn is_free(self, id: ParameterId) -> bool {
        self.free.contains(&id)
    }

    fn best(self, exponents: &[f64]) -> Option<Identification> {
        let [thin, part] = [ENOUGH_TO_RANK, ENOUGH_TO_FIT].map(|most| reduced(self.data, most));
        let mut minima = self.coarse(&thin, &part, exponents);
        distinct(&mut minima, SAME, FINALISTS);
        let fitted = |starts: Vec<Fit>, data: &Dataset, effort: Effort| -> Vec<Fit> {
            let fitter = Fitter::new(self.model, data);
            let mut fits: Vec<Fit> = starts
                .into_par_iter()
                .map(|start| fitter.fit(&start.model, self.free, effort))
                .filter(|fit| fit.cost().is_finite())
                .collect();
            fits.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
            fits
        };
        // Only what is still near the best after more steps is fitted to everything.
        let mut near = fitted(minima, &part, Effort::Coarse);
        let most = NEAR * near.first()?.cost();
        near.retain(|fit| fit.cost() <= most);
        distinct(&mut near, SAME, FINALISTS);
        let mut fits = fitted(near, self.data, Effort::Full);
        distinct(&mut fits, SAME, FINALISTS);
        let mut fits = fits.into_iter();
        let fit = fits.next()?;
        let twin = fits
            .next()
            .filter(|other| other.cost() < (1.0 + AS_GOOD) * fit.cost())
            .map(|other| other.model);
        Some(match self.first_order(&fit) {
            Some(held) => Identification {
                fit: held,
                released: fit,
                order: Order::First,
                twin: None,
            },
            None => Identification {
                released: fit.clone(),
                fit,
                order: Order::Second,
                twin,
            },
        })
    }

    /// Fits on a subsample, the best first, from starts that are ranked on a thinner one.
    fn coarse(self, thin: &Dataset, part: &Dataset, exponents: &[f64]) -> Vec<Fit> {
        let fitter = Fitter::new(self.model, thin);
        let gain: Vec<ParameterId> = self
            .free
            .iter()
            .copied()
            .filter(|id| *id == ParameterId::InputGain && is_driven(part))
            .collect();
        let mut ranked: Vec<Fit> = self
            .starts(part, exponents)
            .par_iter()
            .map(|start| fitter.fit(start, &gain, RANKED))
            .filter(|fit| fit.cost().is_finite())
            .collect();
        ranked.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        distinct(&mut ranked, SAME_START, CHOSEN);
        let mut chosen: Vec<Model<f64>> = ranked.into_iter().map(|fit| fit.model).collect();
        chosen.push(*self.model);
        let fitter = Fitter::new(self.model, part);
        let mut found: Vec<Fit> = chosen
            .par_iter()
            .map(|start| fitter.fit(start, self.free, COARSE))
            .filter(|fit| fit.cost().is_finite())
            .collect();
        found.sort_by(|a, b| a.cost().total_cmp(&b.cost()));
        found
    }

    /// Starts with the parameters that are not free as they are.
    fn starts(self, part: &Dataset, exponents: &[f64]) -> Vec<Model<f64>> {
        let given = *self.model.dynamics();
        let mut tried = vec![given.exponent];
        if self.is_free(ParameterId::Exponent) {
            tried.extend(exponents);
            tried.sort_by(f64::total_cmp);
            tried.dedup_by(|a, b| (*a - *b).abs() < SAME_EXPONENT);
        }
        let recordings = part.recordings(true);
        let levels: Vec<statics::Level> = recordings.iter().flat_map(statics::plateaus).collect();
        let effects: Vec<_> = self.model.effects().collect();
        tried
            .into_iter()
            .flat_map(|exponent| starts::of(part, &recordings, &levels, exponent))
            .map(|unit| {
                // Starts are of unit inertia: only ratios to it move anything.
                let of = |id, found: f64, given| if self.is_free(id) { found } else { given };
                let inertia = given.inertia;
                Dynamics {
                    inertia,
                    damping: of(ParameterId::Damping, inertia * unit.damping, given.damping),
                    stiffness: of(
                        ParameterId::Stiffness,
                        inertia * unit.stiffness,
                        given.stiffness,
                    ),
                    exponent: unit.exponent,
                    input_gain: of(
                        ParameterId::InputGain,
                        inertia * unit.input_gain,
                        given.input_gain,
                    ),
                }
            })
            .filter_map(|dynamics| Model::new(dynamics, &effects).ok())
            .collect()
    }

    /// The fit with the damping held so large that the inertia does not show; none where that
    /// is worse, or where the scale of the forces is known.
    fn first_order(self, fit: &Fit) -> Option<Fit> {
        let scale = [ParameterId::Damping, ParameterId::Stiffness];
        let is_scalable = scale.iter().all(|id| self.is_free(*id))
            && !self.is_free(ParameterId::Inertia)
            && (self.is_free(ParameterId::InputGain) || !is_driven(self.data))
            && self.model.effects().next().is_none();
        let dynamics = *fit.model.dynamics();
        let interval = self
            .data
            .sessions()
            .iter()
            .map(|session| session.sampled_every())
            .fold(f64::INFINITY, f64::min);
        if !is_scalable || dynamics.inertia > HARDLY_VISIBLE * interval * dynamics.damping {
            return None;
        }
        let free: Vec<ParameterId> = self
            .free
            .iter()
            .copied()
            .filter(|id| *id != ParameterId::Damping)
            .collect();
        let worth = WORTH * fit.correlation_time() / fit.samples().max(1) as f64;
        let most = (1.0 + worth.min(LARGEST_WORTH)) * fit.cost();
        let invisible =
            INVISIBLE_INERTIA.map(|intervals| dynamics.inertia / (intervals * interval));
        // A fast rig may need a faster inertia yet, and the fit has found one.
        let strongest = invisible.into_iter().fold(0.0, f64::max);
        let found = (dynamics.damping > strongest).then_some(dynamics.damping);
        invisible.into_iter().chain(found).find_map(|damping| {
            let times = damping / dynamics.damping;
            let scaled = Dynamics {
                damping,
                stiffness: times * dynamics.stiffness,
                input_gain: times * dynamics.input_gain,
                ..dynamics
            };
            let start = Model::new(scaled, &[]).ok()?;
            let held = Fitter::new(&start, self.data).fit(&start, &free, Effort::Full);
            (held.cost() <= most).then_some(held)
        })
    }
}

/// Keeps up to `most` of the fits, the best first, whose curves differ by more than a share
/// of their error.
fn distinct(fits: &mut Vec<Fit>, share: f64, most: usize) {
    let mut kept: Vec<Fit> = Vec::new();
    for fit in fits.drain(..) {
        if kept.len() < most && !kept.iter().any(|other| is_same(&fit, other, share)) {
            kept.push(fit);
        }
    }
    *fits = kept;
}

fn is_same(a: &Fit, b: &Fit, share: f64) -> bool {
    let pairs = a
        .residuals
        .iter()
        .flatten()
        .zip(b.residuals.iter().flatten());
    let apart: f64 = pairs.map(|(a, b)| (a - b).powi(2)).sum();
    apart <= share * share * a.sse().min(b.sse())
}

/// A gain where the input never acts: any will do.
pub const NO_INPUT_GAIN: f64 = 1.0 / PASCAL_PER_KPA;
