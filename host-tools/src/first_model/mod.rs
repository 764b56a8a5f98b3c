//! A first model: `rig init`.
//!
//! A new user has an actuator, perhaps the name of its silicone and its dimensions, and with
//! luck one recording. [`from_recordings`] identifies the equation of motion without effects
//! from recordings. [`from_geometry`] takes it from the table of materials and the beam
//! formula, and guesses the rest. Each number states its source ([`Origin`]), because a guess
//! that looks like a measurement is worse than none.
//!
//! The result is the starting point of `rig diagnose`: M θ̈ + C θ̇ + K θⁿ = g p and nothing
//! else. It works for any second-order rig with one input, whatever the columns hold: a
//! pendulum under a torque, a motor under a voltage.

mod starts;
pub mod statics;
mod text;

pub use text::next_steps;

use model_core::actuator::{Model, ParameterId};
use model_core::dynamics::Dynamics;
use model_core::ludwick::{Beam, Ludwick, SecondMoment};
use model_core::material::Material;
use model_core::power::Exact;

use crate::estimate::Dataset;
use crate::estimate::fit::{Effort, Fit, Fitter};
use crate::estimate::nuisance::FARTHEST;
use crate::estimate::smooth::motions;
use crate::estimate::subsample::subsample;
use crate::io::error::InputError;
use crate::io::model_file::to_file_units;
use crate::io::recording::{PASCAL_PER_KPA, Recording};
use crate::statistics::{moves, squares_about_mean};
use rayon::prelude::*;

/// Samples beyond which a subsample is fitted, to answer within seconds.
const MOST_SAMPLES: usize = 60_000;

/// Exponents that are tried beside those of statics and material: Hooke's law, and what
/// silicones have.
const EXPONENTS: [f64; 4] = [1.0, 1.5, 2.0, 2.5];

/// Exponents that a plateau may suggest.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = 0.4..=5.0;

/// Initial guesses of each exponent that get a coarse fit.
const COARSE_FITS: usize = 3;

/// The number of these that are fitted to the end.
const FINALISTS: usize = 3;

/// Steps of a coarse fit.
const COARSE: Effort = Effort::Steps(6);

/// A fitted exponent has to reduce the RMS error below this share of that with a given
/// exponent.
const WORTHWHILE: f64 = 0.95;

/// The least exponent that is fitted: halfway from Hooke's law to the least of Table I.
const LEAST_OF_A_MATERIAL: f64 = 1.25;

/// A parameter whose 95 % interval reaches further than this share of it to either side is
/// hardly determined.
const VAGUE: f64 = 0.8;

/// A zero that is further from its mean than this, in standard deviations, is none: fits
/// have a wall there.
const BEYOND_ZERO: f64 = 1.1 * FARTHEST;

/// One that is so far has taken the place of the motion.
const FAR_BEYOND_ZERO: f64 = 2.0 * FARTHEST;

/// The slowest time constant, as a share of the time that a rig takes to come to rest.
const SETTLED: f64 = 0.5;

/// Below this share of the largest acceleration a force is none.
const NO_FORCE: f64 = 1e-3;

/// A model that leaves more than this share of the motion about its mean explains little.
const EXPLAINS_LITTLE: f64 = 0.6;

/// The authors' actuator (m): length, width, height.
pub const AUTHORS_DIMENSIONS: [f64; 3] = [0.094, 0.030, 0.024];

/// The material of the authors' actuator.
pub const AUTHORS_MATERIAL: &str = "Dragon Skin 20";

/// Natural frequency (rad/s) and damping ratio that the authors found.
const AUTHORS_FREQUENCY: f64 = 1.812;
const AUTHORS_DAMPING_RATIO: f64 = 0.7;

/// Pressure (Pa) for which their actuator was designed, taken to bend it by 90°.
const DESIGN_PRESSURE: f64 = 150e3;

/// Angle (rad) at which a guessed actuator has that natural frequency.
const MIDDLE_ANGLE: f64 = std::f64::consts::FRAC_PI_4;

/// The base parameters, in the order of the file.
pub const BASE: [ParameterId; 5] = [
    ParameterId::Inertia,
    ParameterId::Damping,
    ParameterId::Stiffness,
    ParameterId::Exponent,
    ParameterId::InputGain,
];

/// Where a number comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// Fitted to the recordings; the 95 % interval in the unit of the file, or none where
    /// they do not determine it.
    Fitted(Option<(f64, f64)>),
    /// The table of materials, by the material's name.
    Table(String),
    /// The beam formula with material and dimensions.
    Beam,
    /// Fitted, and nothing came of it: the recordings show no such force.
    Nothing,
    /// Chosen, for this reason; nothing can determine it.
    Convention(&'static str),
    /// Guessed, in this way.
    Guess(&'static str),
}

/// Geometry and material of the actuator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// A row of the table of materials.
    pub material: &'static Material,
    /// Length, width and height (m), where they are known.
    pub dimensions: Option<[f64; 3]>,
    /// Whether these are the authors' actuator's for want of others.
    pub assumed: bool,
}

/// How well a model follows the recordings that it was fitted to.
#[derive(Clone, Debug, PartialEq)]
pub struct Evidence {
    /// RMS error (rad).
    pub rms: f64,
    /// RMS of the angle about its mean (rad): what a model leaves that knows nothing.
    pub about_mean: f64,
    /// Levels at which both signals stood still.
    pub levels: usize,
    /// Samples that were fitted.
    pub samples: usize,
    /// Whether these are a subsample.
    pub subsample: bool,
    /// Whether the pressure acts at all.
    pub driven: bool,
}

impl Evidence {
    /// Whether the model leaves most of the motion unexplained.
    pub fn explains_little(&self) -> bool {
        self.rms.is_nan() || self.rms > EXPLAINS_LITTLE * self.about_mean
    }
}

/// A first model.
#[derive(Clone, Debug)]
pub struct FirstModel {
    /// The model, without effects.
    pub model: Model<f64>,
    /// Where each base parameter comes from, in the order of [`BASE`].
    pub origins: [Origin; 5],
    /// The parameters that a refit estimates.
    pub free: Vec<ParameterId>,
    /// Geometry and material of the actuator, where known.
    pub geometry: Option<Geometry>,
    /// How well it follows the recordings, if there are any.
    pub evidence: Option<Evidence>,
}

impl FirstModel {
    /// Where a base parameter comes from.
    pub fn origin(&self, id: ParameterId) -> &Origin {
        let place = BASE.iter().position(|base| *base == id).unwrap_or(0);
        &self.origins[place]
    }
}

/// The material and beam of the authors' actuator: where nothing at all is known.
pub fn authors_actuator() -> Option<Geometry> {
    Some(Geometry {
        material: model_core::material::find(AUTHORS_MATERIAL)?,
        dimensions: Some(AUTHORS_DIMENSIONS),
        assumed: true,
    })
}

/// A model from material and dimensions alone.
///
/// Exponent and stiffness are those of a Ludwick beam. The rest is guessed so that the
/// actuator moves as the authors' did: their natural frequency and damping ratio at 45°, and
/// 90° at their design pressure.
///
/// # Errors
///
/// Refuses dimensions that are none.
pub fn from_geometry(geometry: Geometry) -> Result<FirstModel, InputError> {
    let exponent: f64 = geometry.material.exponent();
    let stiffness = beam_stiffness(&geometry).ok_or_else(|| {
        InputError::new("the dimensions are no beam's", "give lengths above zero")
    })?;
    let slope = exponent * stiffness * MIDDLE_ANGLE.powf(exponent - 1.0);
    let inertia = slope / (AUTHORS_FREQUENCY * AUTHORS_FREQUENCY);
    let dynamics = Dynamics {
        inertia,
        damping: 2.0 * AUTHORS_DAMPING_RATIO * AUTHORS_FREQUENCY * inertia,
        stiffness,
        exponent,
        input_gain: stiffness * std::f64::consts::FRAC_PI_2.powf(exponent) / DESIGN_PRESSURE,
    };
    let model = Model::new(dynamics, &[]).map_err(|error| {
        InputError::new(
            format!("the model {error}"),
            "check the dimensions and their unit",
        )
    })?;
    Ok(FirstModel {
        model,
        origins: [
            Origin::Guess("1.812 rad/s at 45°, the natural frequency of the authors' actuator"),
            Origin::Guess("damping ratio 0.7, that of the authors' actuator"),
            Origin::Beam,
            Origin::Table(geometry.material.name.to_owned()),
            Origin::Guess("90° at 150 kPa, the design pressure of the authors' actuator"),
        ],
        free: vec![
            ParameterId::Damping,
            ParameterId::Stiffness,
            ParameterId::InputGain,
        ],
        geometry: Some(geometry),
        evidence: None,
    })
}

/// K (N/radⁿ) of the beam formula; none without dimensions.
pub fn beam_stiffness(geometry: &Geometry) -> Option<f64> {
    let [length, width, height] = geometry.dimensions?;
    let beam = Beam::new(length, width, height).ok()?;
    let modulus = geometry.material.data_sheet::<f64>().modulus_mpa() * 1e6;
    let law = Ludwick::new(modulus, geometry.material.exponent()).ok()?;
    Some(law.stiffness::<Exact>(&beam, SecondMoment::Corrected))
}

/// A model identified from recordings; `geometry` suggests an exponent.
///
/// # Errors
///
/// Refuses recordings of which nothing can be used, or that no plain model can be simulated
/// over.
pub fn from_recordings(
    recordings: &[Recording],
    data: &Dataset,
    geometry: Option<Geometry>,
) -> Result<FirstModel, InputError> {
    let part;
    let (all, data) = (
        data,
        if data.samples() > MOST_SAMPLES {
            part = thinned(data);
            &part
        } else {
            data
        },
    );
    let plateaus: Vec<_> = recordings.iter().map(statics::plateaus).collect();
    let settling = plateaus
        .iter()
        .filter_map(|list| statics::settling(list))
        .reduce(f64::max);
    let levels: Vec<_> = plateaus.into_iter().flatten().map(|it| it.level).collect();
    let driven = recordings
        .iter()
        .any(|recording| recording.pressure.iter().any(|pressure| *pressure != 0.0));
    let given = geometry.map(|geometry| geometry.material.exponent::<f64>());
    let identifier = Identifier {
        data,
        driven,
        settling,
    };

    let mut exponents = EXPONENTS.to_vec();
    exponents.extend(given);
    exponents.extend(statics::exponent(&levels).filter(|n| PLAUSIBLE.contains(n)));
    exponents.sort_by(f64::total_cmp);
    exponents.dedup_by(|a, b| (*a - *b).abs() < 0.05);
    if let Some(given) = given
        && let Some(near) = exponents.iter_mut().find(|n| (**n - given).abs() < 0.05)
    {
        *near = given;
    }
    let coarse_fits: Vec<CoarseFit> = exponents
        .iter()
        .flat_map(|&exponent| identifier.coarse_fits_with(&levels, exponent))
        .collect();
    let chosen = identifier.choose(&coarse_fits, given).ok_or_else(|| {
        InputError::new(
            "no plain model can be simulated over the recording",
            "check time, pressure and angle: see the flags under \"If the columns mean something else\"",
        )
    })?;
    let Chosen { fit, exponent } = chosen;
    let (rms, about_mean) = (fit.rmse(), about_mean(data));
    let mut origins = [
        Origin::Convention("only ratios to it move anything"),
        Origin::Fitted(None),
        Origin::Fitted(None),
        match exponent {
            Exponent::Fitted => Origin::Fitted(None),
            Exponent::Given => {
                Origin::Table(geometry.map_or_else(String::new, |it| it.material.name.to_owned()))
            }
            Exponent::Hooke => Origin::Convention(
                "Hooke's law, since the recordings show no exponent that a material has",
            ),
        },
        if driven {
            Origin::Fitted(None)
        } else {
            Origin::Convention("the input never acts")
        },
    ];
    let mut model = fit.model;
    for (index, &id) in fit.free.iter().enumerate() {
        let place = BASE.iter().position(|base| *base == id).unwrap_or(0);
        if let Some(least) = least_seen(&fit.model, id, data)
            && fit.model.value(id).is_some_and(|value| value < least)
        {
            // A fit from zero would never leave it.
            model = model.with_value(id, least);
            origins[place] = Origin::Nothing;
            continue;
        }
        let value = fit.model.value(id).unwrap_or_default();
        let interval = fit.interval95(index).filter(|(low, high)| {
            (high - low).is_finite()
                && !fit.at_bound(index)
                && (high - low) / 2.0 < VAGUE * value.abs()
        });
        let in_file = |value| to_file_units(&fit.model, id, value);
        origins[place] = Origin::Fitted(interval.map(|(low, high)| (in_file(low), in_file(high))));
    }
    Ok(FirstModel {
        model,
        origins,
        evidence: Some(Evidence {
            rms,
            about_mean,
            levels: statics::distinct(&levels),
            samples: fit.samples(),
            subsample: all.samples() > data.samples(),
            driven,
        }),
        free: fit.free,
        geometry,
    })
}

/// Every so-manieth sample of long recordings, where the answer is wanted in seconds.
fn thinned(data: &Dataset) -> Dataset {
    let stride = data.samples().div_ceil(MOST_SAMPLES);
    let every = |values: &[f64]| values.iter().copied().step_by(stride).collect();
    let recordings: Vec<Recording> = data
        .recordings(true)
        .iter()
        .map(|recording| Recording {
            time: every(&recording.time),
            pressure: every(&recording.pressure),
            angle: every(&recording.angle),
            extra: Vec::new(),
            ..recording.clone()
        })
        .collect();
    Dataset::of(&recordings)
}

/// The least damping or stiffness that recordings show: one whose force is
/// [`NO_FORCE`] of the largest inertial one. None of another parameter.
fn least_seen(model: &Model<f64>, id: ParameterId, data: &Dataset) -> Option<f64> {
    let (mut rate, mut acceleration) = (0.0_f64, 0.0_f64);
    for motion in data
        .fitted()
        .flat_map(|segment| motions(&segment.recording))
    {
        rate = rate.max(motion.rate.abs());
        acceleration = acceleration.max(motion.acceleration.abs());
    }
    let dynamics = model.dynamics();
    let per = match id {
        ParameterId::Damping => rate,
        ParameterId::Stiffness => data.largest_angle().powf(dynamics.exponent),
        _ => return None,
    };
    let least = NO_FORCE * dynamics.inertia * acceleration / per;
    least.is_finite().then_some(least)
}

/// RMS of the angle about its mean in each segment (rad).
fn about_mean(data: &Dataset) -> f64 {
    let squares: f64 = data
        .fitted()
        .map(|segment| squares_about_mean(&segment.recording.angle))
        .sum();
    (squares / data.samples().max(1) as f64).sqrt()
}

/// A fit of a few steps from an initial guess.
#[derive(Clone, Copy, Debug)]
struct CoarseFit {
    exponent: f64,
    model: Model<f64>,
    implausibility: u8,
    /// Mean square error (rad²).
    error: f64,
}

/// Which exponent a fit ended with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exponent {
    Fitted,
    Given,
    Hooke,
}

struct Chosen {
    fit: Fit,
    exponent: Exponent,
}

/// Fits plain models to one set of data.
#[derive(Clone, Copy, Debug)]
struct Identifier<'a> {
    data: &'a Dataset,
    driven: bool,
    /// Longest time (s) between two plateaus.
    settling: Option<f64>,
}

impl Identifier<'_> {
    fn free(self, with_exponent: bool) -> Vec<ParameterId> {
        let mut free = vec![ParameterId::Damping, ParameterId::Stiffness];
        if with_exponent {
            free.push(ParameterId::Exponent);
        }
        if self.driven {
            free.push(ParameterId::InputGain);
        }
        free
    }

    /// Coarse fits from the best initial guesses with an exponent.
    fn coarse_fits_with(self, levels: &[statics::Level], exponent: f64) -> Vec<CoarseFit> {
        let free = self.free(false);
        let starts = starts::of(self.data, levels, exponent);
        let mut ranked: Vec<(f64, Model<f64>)> = starts
            .par_iter()
            .filter_map(|start| {
                let start = if self.driven {
                    *start
                } else {
                    start.with_value(ParameterId::InputGain, 1.0 / PASCAL_PER_KPA)
                };
                let part = subsample(self.data, &start);
                let sse = Fitter::new(&start, &part).predicted_sse(&start, &free);
                let error = sse / part.samples().max(1) as f64;
                (error.is_finite() && self.settles(&start)).then_some((error, start))
            })
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked.truncate(COARSE_FITS);
        ranked
            .into_par_iter()
            .filter_map(|(_, start)| {
                let part = subsample(self.data, &start);
                let fit = Fitter::new(&start, &part).fit(&start, &free, COARSE);
                let error = fit.sse() / fit.samples().max(1) as f64;
                error.is_finite().then(|| CoarseFit {
                    exponent,
                    model: fit.model,
                    implausibility: self.implausibility(&fit, &part),
                    error,
                })
            })
            .collect()
    }

    /// Whether a model settles as fast as the recordings do: a slow one can imitate a
    /// static curve that is not a power law.
    fn settles(self, model: &Model<f64>) -> bool {
        let dynamics = model.dynamics();
        let angles = self.data.fitted().flat_map(|it| &it.recording.angle);
        let (squares, count) = angles.fold((0.0, 0_usize), |(sum, count), angle| {
            (sum + angle * angle, count + 1)
        });
        let typical = (squares / count.max(1) as f64)
            .sqrt()
            .max(f64::MIN_POSITIVE);
        let slope = dynamics.exponent * dynamics.stiffness * typical.powf(dynamics.exponent - 1.0);
        self.settling
            .is_none_or(|settling| dynamics.damping <= SETTLED * settling * slope)
    }

    /// A class from 0, plausible, to 2: sensor zeros far off, or too slow a settling.
    fn implausibility(self, fit: &Fit, data: &Dataset) -> u8 {
        let sessions = data.sessions().iter().zip(&fit.nuisances);
        let farthest = sessions.fold(0.0, |farthest: f64, (session, found)| {
            let [pressure, angle] = [0, 1].map(|k| session.prior().departures(found)[k].abs());
            // An input that never moves has no zero.
            let pressure = if moves(&session.recording().pressure) {
                pressure
            } else {
                0.0
            };
            farthest.max(pressure).max(angle)
        });
        if !self.settles(&fit.model) || farthest > FAR_BEYOND_ZERO {
            2
        } else {
            u8::from(farthest > BEYOND_ZERO)
        }
    }

    /// Fits with the exponent free, given, and one; takes a fitted exponent only where it
    /// reduces the error enough.
    fn choose(self, coarse_fits: &[CoarseFit], given: Option<f64>) -> Option<Chosen> {
        let order = |a: &&CoarseFit, b: &&CoarseFit| {
            a.implausibility
                .cmp(&b.implausibility)
                .then(a.error.total_cmp(&b.error))
        };
        let best = |wanted: Option<f64>| -> Option<Fit> {
            let mut starts: Vec<&CoarseFit> = coarse_fits.iter().collect();
            if let Some(wanted) = wanted {
                let off = |it: &CoarseFit| (it.exponent - wanted).abs();
                let nearest = coarse_fits.iter().map(off).fold(f64::INFINITY, f64::min);
                starts.retain(|it| off(it) <= nearest);
            }
            starts.sort_by(order);
            starts
                .into_iter()
                .take(FINALISTS)
                .filter_map(|start| {
                    let exponent = wanted.unwrap_or(start.exponent);
                    let start = start.model.with_value(ParameterId::Exponent, exponent);
                    let fit = self.fit(&start, wanted.is_none())?;
                    Some((self.implausibility(&fit, self.data), fit))
                })
                .min_by(|a, b| a.0.cmp(&b.0).then(a.1.sse().total_cmp(&b.1.sse())))
                .map(|(_, fit)| fit)
        };
        let held = match given {
            Some(given) => best(Some(given)).map(|fit| (fit, Exponent::Given)),
            None => best(Some(1.0)).map(|fit| (fit, Exponent::Hooke)),
        };
        match (best(None).filter(is_a_materials), held) {
            (Some(fit), Some((held, _)))
                if self.implausibility(&fit, self.data)
                    <= self.implausibility(&held, self.data)
                    && fit.rmse() < WORTHWHILE * held.rmse() =>
            {
                Some((fit, Exponent::Fitted))
            }
            (_, Some(held)) => Some(held),
            (fitted, None) => fitted.map(|fit| (fit, Exponent::Fitted)),
        }
        .map(|(fit, exponent)| Chosen {
            fit: self.tamed(fit),
            exponent,
        })
    }

    /// A fit to all data; repeated from its result if that lies on the edge of the range
    /// about the initial guess.
    fn fit(self, start: &Model<f64>, with_exponent: bool) -> Option<Fit> {
        /// Each time up to ten times the value before.
        const TIMES: usize = 3;
        let free = self.free(with_exponent);
        let mut fit = Fitter::new(start, self.data).fit(start, &free, Effort::Full);
        for _ in 1..TIMES {
            if !fit.sse().is_finite() || !(0..free.len()).any(|index| fit.at_bound(index)) {
                break;
            }
            let from = fit.model;
            let next = Fitter::new(&from, self.data).fit(&from, &free, Effort::Full);
            if next.sse().is_nan() || next.sse() >= 0.999 * fit.sse() {
                break;
            }
            fit = next;
        }
        fit.sse().is_finite().then_some(fit)
    }

    /// A fit without a motion that is faster than the sampling, where that says as much.
    ///
    /// Where the inertia does not show, damping and stiffness can grow together without end.
    /// Simulations of that take for ever.
    fn tamed(self, fit: Fit) -> Fit {
        /// Share by which the sum of squares may grow.
        const GROWS: f64 = 1.05;
        /// Multiples of the sampling's angular frequency.
        const TIMES: [f64; 3] = [1.0, 5.0, 25.0];
        let interval = self
            .data
            .sessions()
            .iter()
            .map(|session| session.interval())
            .fold(f64::INFINITY, f64::min);
        let fastest = std::f64::consts::TAU / interval;
        let dynamics = fit.model.dynamics();
        if dynamics.damping <= fastest || interval.is_nan() {
            return fit;
        }
        for fastest in TIMES.map(|times| times * fastest) {
            let share = fastest / dynamics.damping;
            let slower = Dynamics {
                damping: dynamics.damping * share,
                stiffness: dynamics.stiffness * share,
                input_gain: dynamics.input_gain * share,
                ..*dynamics
            };
            let Some(slower) = Model::new(slower, &[]).ok().filter(|_| share < 1.0) else {
                continue;
            };
            let fitter = Fitter::new(&slower, self.data);
            // A few steps: to the end it would run away again.
            let tamed = fitter.fit(&slower, &fit.free, Effort::Steps(2));
            if tamed.sse() <= GROWS * fit.sse() {
                return fitter.informed(&tamed);
            }
        }
        fit
    }
}

/// Whether a fitted exponent is one that a material may have. Below, a spring that softens
/// is something else, such as gravity's sine, and one that stiffens a little is Hooke's with
/// a cubic part: an exponent between would only hide them from a diagnosis.
fn is_a_materials(fit: &Fit) -> bool {
    let place = fit.free.iter().position(|id| *id == ParameterId::Exponent);
    place.is_none_or(|index| {
        !fit.at_bound(index) && fit.model.dynamics().exponent >= LEAST_OF_A_MATERIAL
    })
}
