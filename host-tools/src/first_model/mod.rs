//! A first model, from nothing: what `rig init` writes.
//!
//! Whoever meets softrig has an actuator, perhaps the name of its silicone and a ruler, and
//! with luck one recording. [`from_recordings`] identifies the plain equation of motion from
//! recordings; [`from_geometry`] takes it from the table of materials and the beam formula,
//! and guesses the rest. Either way each number says where it comes from ([`Origin`]),
//! because a guess that looks like a measurement is worse than none.
//!
//! The result is where `rig diagnose` begins, not what it finds: M θ̈ + C θ̇ + K θⁿ = g p and
//! nothing else. It serves any rig of second order with one input, whatever the columns hold:
//! a pendulum under a torque, a motor under a voltage.

mod starts;
pub mod statics;
mod text;

pub use text::short;

use model_core::actuator::{Dynamics, Model, ParameterId};
use model_core::ludwick::{Beam, Ludwick, SecondMoment};
use model_core::material::Material;
use model_core::power::Exact;

use crate::error::InputError;
use crate::estimate::Dataset;
use crate::estimate::fit::{Effort, Fit, Fitter};
use crate::estimate::subsample::excerpt;
use crate::model_file::to_file_units;
use crate::recording::{PASCAL_PER_KPA, Recording};
use crate::statistics::squares_about_mean;
use rayon::prelude::*;

/// Samples beyond which an excerpt is fitted: the answer is wanted in seconds.
const MOST_SAMPLES: usize = 60_000;

/// Exponents that are tried beside those of statics and material: Hooke's law, and what
/// silicones have.
const EXPONENTS: [f64; 4] = [1.0, 1.5, 2.0, 2.5];

/// Exponents that a plateau may suggest.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = 0.4..=5.0;

/// Starts of each exponent that are fitted.
const PROMISING: usize = 2;

/// Steps of a fit that choose among them.
const RACED: Effort = Effort::Steps(6);

/// A fitted exponent has to shrink the RMS error below this share of what a given one
/// leaves.
const PAYS: f64 = 0.95;

/// An exponent whose 95 % interval is wider than this on either side is not determined.
const VAGUE: f64 = 0.5;

/// A model that leaves more than this share of the motion about its mean explains little.
const EXPLAINS_LITTLE: f64 = 0.7;

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
    /// Chosen, for this reason; nothing can determine it.
    Convention(&'static str),
    /// Guessed, in this way.
    Guess(&'static str),
}

/// What is known of the actuator itself.
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
    /// Whether these are an excerpt.
    pub excerpt: bool,
    /// Whether the pressure acts at all.
    pub driven: bool,
}

impl Evidence {
    /// Whether the model leaves most of the motion unexplained.
    pub fn explains_little(&self) -> bool {
        // Also where the error is no number.
        !(self.rms <= EXPLAINS_LITTLE * self.about_mean)
    }
}

/// A first model.
#[derive(Clone, Debug)]
pub struct FirstModel {
    /// The model, without effects.
    pub model: Model<f64>,
    /// Where each base parameter comes from, in the order of [`BASE`].
    pub origins: [Origin; 5],
    /// What a refit may move.
    pub free: Vec<ParameterId>,
    /// What is known of the actuator.
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
    let levels: Vec<_> = recordings.iter().flat_map(statics::plateaus).collect();
    let driven = recordings
        .iter()
        .any(|recording| recording.pressure.iter().any(|pressure| *pressure != 0.0));
    let given = geometry.map(|geometry| geometry.material.exponent::<f64>());
    let identifier = Identifier { data, driven };

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
    let raced: Vec<Raced> = exponents
        .iter()
        .filter_map(|&exponent| identifier.race(&levels, exponent))
        .collect();
    let chosen = identifier.choose(&raced, given).ok_or_else(|| {
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
                "Hooke's law, which follows these recordings as well as any other exponent",
            ),
        },
        if driven {
            Origin::Fitted(None)
        } else {
            Origin::Convention("the input never acts")
        },
    ];
    for (index, &id) in fit.free.iter().enumerate() {
        let place = BASE.iter().position(|base| *base == id).unwrap_or(0);
        let interval = fit
            .interval95(index)
            .filter(|(low, high)| low.is_finite() && high.is_finite() && !fit.at_bound(index));
        let in_file = |value| to_file_units(&fit.model, id, value);
        origins[place] = Origin::Fitted(interval.map(|(low, high)| (in_file(low), in_file(high))));
    }
    let excerpt = data.samples() > MOST_SAMPLES;
    Ok(FirstModel {
        model: fit.model,
        origins,
        evidence: Some(Evidence {
            rms,
            about_mean,
            levels: statics::distinct(&levels),
            samples: fit.samples(),
            excerpt,
            driven,
        }),
        free: fit.free,
        geometry,
    })
}

/// RMS of the angle about its mean in each segment (rad).
fn about_mean(data: &Dataset) -> f64 {
    let squares: f64 = data
        .fitted()
        .map(|segment| squares_about_mean(&segment.recording.angle))
        .sum();
    (squares / data.samples().max(1) as f64).sqrt()
}

/// The best start of an exponent after a few steps.
#[derive(Clone, Debug)]
struct Raced {
    exponent: f64,
    model: Model<f64>,
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

    /// The best of the starts with an exponent.
    fn race(self, levels: &[statics::Level], exponent: f64) -> Option<Raced> {
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
                let part = excerpt(self.data, &start);
                let sse = Fitter::new(&start, &part).predicted_sse(&start, &free);
                let error = sse / part.samples().max(1) as f64;
                error.is_finite().then_some((error, start))
            })
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        ranked
            .into_iter()
            .take(PROMISING)
            .filter_map(|(_, start)| {
                let part = excerpt(self.data, &start);
                let fit = Fitter::new(&start, &part).fit(&start, &free, RACED);
                let error = fit.sse() / fit.samples().max(1) as f64;
                error.is_finite().then_some(Raced {
                    exponent,
                    model: fit.model,
                    error,
                })
            })
            .min_by(|a, b| a.error.total_cmp(&b.error))
    }

    /// Fits with the exponent free, given, and one; prefers a fitted exponent only where
    /// it pays and is determined.
    fn choose(self, raced: &[Raced], given: Option<f64>) -> Option<Chosen> {
        let best = raced.iter().min_by(|a, b| a.error.total_cmp(&b.error))?;
        let of = |wanted: f64| {
            let near = raced.iter().min_by(|a, b| {
                let off = |it: &Raced| (it.exponent - wanted).abs();
                off(a).total_cmp(&off(b))
            })?;
            self.fit(&near.model.with_value(ParameterId::Exponent, wanted), false)
        };
        let hooke = || of(1.0).map(|fit| (fit, Exponent::Hooke));
        let held = match given {
            Some(given) => of(given).map(|fit| (fit, Exponent::Given)),
            None => hooke(),
        };
        let fitted = self.fit(&best.model, true).filter(is_determined);
        match (fitted, held) {
            (Some(fitted), Some((held, _))) if fitted.rmse() < PAYS * held.rmse() => Some(Chosen {
                fit: fitted,
                exponent: Exponent::Fitted,
            }),
            (_, Some((fit, exponent))) => Some(Chosen { fit, exponent }),
            (Some(fit), None) => Some(Chosen {
                fit,
                exponent: Exponent::Fitted,
            }),
            (None, None) => hooke().map(|(fit, exponent)| Chosen { fit, exponent }),
        }
    }

    /// A fit to everything; once more from where it ended if that is the edge of the range
    /// about its start.
    fn fit(self, start: &Model<f64>, with_exponent: bool) -> Option<Fit> {
        /// Each time a tenth or ten times the value before.
        const TIMES: usize = 3;
        let free = self.free(with_exponent);
        let part;
        let data = if self.data.samples() > MOST_SAMPLES {
            part = excerpt(self.data, start);
            &part
        } else {
            self.data
        };
        let mut fit = Fitter::new(start, data).fit(start, &free, Effort::Full);
        for _ in 1..TIMES {
            if !fit.sse().is_finite() || !(0..free.len()).any(|index| fit.at_bound(index)) {
                break;
            }
            let from = fit.model;
            let next = Fitter::new(&from, data).fit(&from, &free, Effort::Full);
            if !(next.sse() < 0.999 * fit.sse()) {
                break;
            }
            fit = next;
        }
        fit.sse().is_finite().then_some(fit)
    }
}

/// Whether the recordings tell the exponent of a fit.
fn is_determined(fit: &Fit) -> bool {
    let Some(index) = fit.free.iter().position(|id| *id == ParameterId::Exponent) else {
        return false;
    };
    let exponent = fit.model.dynamics().exponent;
    !fit.at_bound(index)
        && fit
            .interval95(index)
            .is_some_and(|(low, high)| high - exponent < VAGUE && exponent - low < VAGUE)
}
