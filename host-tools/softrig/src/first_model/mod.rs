//! A first model: `softrig init`.
//!
//! A new user has an actuator, perhaps the name of its silicone and its dimensions, and with luck
//! one recording. [`from_recordings`] identifies the equation of motion without effects;
//! [`from_geometry`] takes it from the table of materials and the beam formula, and guesses the
//! rest. Each number states its source ([`Origin`]), because a guess that looks like a measurement
//! is worse than none. The result is the starting point of `softrig diagnose`: M θ̈ + C θ̇ + K θⁿ = g p
//! and nothing else. It works for any second-order rig with one input, whatever the columns hold: a
//! pendulum under a torque, a motor under a voltage.

mod text;

pub use text::next_steps;

use model_core::actuator::{Model, ParameterId};
use model_core::dynamics::Dynamics;
use model_core::ludwick::{Beam, Ludwick, SecondMoment};
use model_core::material::Material;
use model_core::power::Exact;

use crate::estimate::Dataset;
use crate::estimate::fit::Fit;
use crate::estimate::identify::{
    EXPONENTS, Identification, NO_INPUT_GAIN, Order, identify, is_driven, statics,
};
use crate::estimate::smooth::motions;
use crate::statistics::squares_about_mean;
use softrig_formats::error::InputError;
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::to_file_units;
use softrig_formats::recording::Recording;

/// Samples beyond which a subsample is fitted, to answer within seconds.
const MOST_SAMPLES: usize = 60_000;

/// Exponents that a plateau may suggest.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = 0.4..=5.0;

/// A fitted exponent has to reduce the RMS error below this share of that with a given
/// exponent.
const WORTHWHILE: f64 = 0.95;

/// The least exponent that is fitted: halfway from Hooke's law to the least of Table I.
const LEAST_OF_A_MATERIAL: f64 = 1.25;

/// A parameter whose 95 % interval reaches further than this share of it to either side is
/// hardly determined.
const VAGUE: f64 = 0.8;

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
    /// What the output is.
    pub measurand: Measurand,
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
    /// Whether the inertia shows.
    pub order: Order,
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
    /// Where each base parameter comes from, in the order of [`ParameterId::BASE`].
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
        let place = id.in_base().unwrap_or(0);
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
    let slope = exponent * stiffness * libm::pow(MIDDLE_ANGLE, exponent - 1.0);
    let inertia = slope / (AUTHORS_FREQUENCY * AUTHORS_FREQUENCY);
    let dynamics = Dynamics {
        inertia,
        damping: 2.0 * AUTHORS_DAMPING_RATIO * AUTHORS_FREQUENCY * inertia,
        stiffness,
        exponent,
        input_gain: stiffness * libm::pow(std::f64::consts::FRAC_PI_2, exponent) / DESIGN_PRESSURE,
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

/// A model without any recording: what is missing is the authors'.
///
/// # Errors
///
/// Like [`from_geometry`].
pub fn from_nothing(geometry: Option<Geometry>) -> Result<FirstModel, InputError> {
    let authors = || {
        authors_actuator().ok_or_else(|| {
            InputError::new(
                "the authors' material is not in the table",
                "give a material",
            )
        })
    };
    let geometry = match geometry {
        None => authors()?,
        Some(geometry) if geometry.dimensions.is_none() => Geometry {
            dimensions: authors()?.dimensions,
            assumed: true,
            ..geometry
        },
        Some(geometry) => geometry,
    };
    from_geometry(geometry)
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
    let levels: Vec<_> = all
        .recordings(true)
        .iter()
        .flat_map(statics::plateaus)
        .collect();
    let given = geometry.map(|geometry| geometry.material.exponent::<f64>());
    let ExponentChoice {
        identified,
        exponent,
    } = ExponentChoice::of(data, &levels, given).ok_or_else(|| {
        InputError::new(
            "no plain model can be simulated over the recording",
            "check time, pressure and angle: see the flags under \"If the columns mean something else\"",
        )
    })?;
    let (fit, driven) = (identified.fit, is_driven(data));
    let mut origins = [
        Origin::Convention("only ratios to it move anything"),
        Origin::Convention(
            "the motion is of first order, and with this damping the inertia does not show",
        ),
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
        Origin::Convention("the input never acts"),
    ];
    for (index, &id) in fit.free.iter().enumerate() {
        let place = id.in_base().unwrap_or(0);
        let value = fit.model.value(id).unwrap_or_default();
        origins[place] = if least_seen(&fit.model, id, data).is_some_and(|least| value < least) {
            Origin::Nothing
        } else {
            let interval = fit.interval95(index).filter(|(low, high)| {
                (high - low).is_finite()
                    && !fit.at_bound(index)
                    && (high - low) / 2.0 < VAGUE * value.abs()
            });
            let in_file = |value| to_file_units(&fit.model, id, value);
            Origin::Fitted(interval.map(|(low, high)| (in_file(low), in_file(high))))
        };
    }
    Ok(FirstModel {
        model: fit.model,
        origins,
        evidence: Some(Evidence {
            measurand: data.measurand(),
            rms: fit.rmse(),
            about_mean: about_mean(data),
            levels: statics::distinct(&levels),
            samples: fit.samples(),
            subsample: all.samples() > data.samples(),
            driven,
            order: identified.order,
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
        ParameterId::Stiffness => libm::pow(data.largest_angle(), dynamics.exponent),
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

/// Which exponent a fit ended with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Exponent {
    Fitted,
    Given,
    Hooke,
}

/// A model with the exponent that was chosen for it.
struct ExponentChoice {
    identified: Identification,
    exponent: Exponent,
}

impl ExponentChoice {
    /// Identifies the model with the exponent held, at the `given` one or at one, and with
    /// the exponent free. Takes a fitted exponent only where it reduces the error enough.
    fn of(data: &Dataset, levels: &[statics::Level], given: Option<f64>) -> Option<Self> {
        let start = |exponent: f64| {
            let dynamics = Dynamics {
                inertia: 1.0,
                damping: 1.0,
                stiffness: 1.0,
                exponent,
                input_gain: NO_INPUT_GAIN,
            };
            Model::new(dynamics, &[]).ok()
        };
        let mut free = vec![ParameterId::Damping, ParameterId::Stiffness];
        if is_driven(data) {
            free.push(ParameterId::InputGain);
        }
        let held = identify(&start(given.unwrap_or(1.0))?, &free, &[], data);
        free.insert(2, ParameterId::Exponent);
        let suggested = statics::exponent(levels).filter(|n| PLAUSIBLE.contains(n));
        let exponents: Vec<f64> = EXPONENTS.into_iter().chain(suggested).collect();
        let fitted = identify(&start(given.unwrap_or(1.0))?, &free, &exponents, data)
            .filter(|identified| is_a_materials(&identified.fit));
        let held_as = given.map_or(Exponent::Hooke, |_| Exponent::Given);
        let (identified, exponent) = match (fitted, held) {
            (Some(fitted), Some(held)) if fitted.fit.rmse() < WORTHWHILE * held.fit.rmse() => {
                (fitted, Exponent::Fitted)
            }
            (_, Some(held)) => (held, held_as),
            (fitted, None) => (fitted?, Exponent::Fitted),
        };
        Some(Self {
            identified,
            exponent,
        })
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
