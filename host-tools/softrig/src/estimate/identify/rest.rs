//! Recognises an angle that does not rest at zero.
//!
//! The model's spring pulls towards zero, so a sensor that is mounted at 116°, or a
//! temperature in an absolute scale, cannot be followed at all: the fit then says nothing,
//! and an effect is bent to repair it. Zeros of a few degrees are estimated in every fit
//! ([`crate::estimate::nuisance`]), and an offset of the size of an effect is one
//! (`sensor_offset`). Here is what lies beyond both: plain to the eye, and subtracted.

use model_core::actuator::{Model, ParameterId};
use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;

use super::{Identifier, NO_INPUT_GAIN, is_driven};
use crate::estimate::Dataset;
use crate::estimate::nuisance::rest_at_start;
use crate::estimate::subsample::reduced;
use crate::statistics::{mean, median, swing};

/// Least angle of a rest (rad) that is recognised: 45°, beyond any error of a sensor's zero.
const LEAST: f64 = std::f64::consts::FRAC_PI_4;

/// The same as a share of the swing of the angle.
const LEAST_OF_SWING: f64 = 0.5;

/// Largest share of the squared error that remains: half of the error.
const LEAVES: f64 = 0.25;

/// The angle (rad) without pressure, where it is far from zero and a linear model that
/// knows it leaves at most half of the error; none otherwise.
pub fn resting_angle(data: &Dataset) -> Option<f64> {
    let guess = static_rest(data);
    let recordings = data.recordings(true);
    let swing = recordings
        .iter()
        .map(|recording| swing(&recording.angle))
        .fold(0.0, f64::max);
    let is_far = |angle: f64| angle.abs() > LEAST.max(LEAST_OF_SWING * swing);
    if !is_far(guess) {
        return None;
    }
    let part = reduced(data, super::ENOUGH_TO_FIT);
    // With zeros that may not move: they would take a part of it.
    let held = |data: &Dataset| data.calibrated().calibrated();
    let as_it_is = cost(&held(&part), &[])?.0;
    let (left, more) = cost(&held(&part.shifted(-guess)), &[Kind::SensorOffset])?;
    let rest = first_rest(data)
        .filter(|rest| is_far(*rest))
        .unwrap_or(guess + more);
    (left < LEAVES * as_it_is && is_far(rest)).then_some(rest)
}

/// The angle (rad) at which the sessions rest before anything was done to them, if they begin so:
/// later rests still creep. The median over the sessions.
fn first_rest(data: &Dataset) -> Option<f64> {
    /// The pressure of a rest, as a share of the largest.
    const NO_PRESSURE: f64 = 0.05;
    let mut rests: Vec<f64> = data
        .sessions()
        .iter()
        .filter_map(|session| {
            let recording = session.recording();
            let rest = rest_at_start(recording);
            let pressure = mean(&recording.pressure[..rest]).abs();
            let is_rest = rest > 0 && pressure <= NO_PRESSURE * session.largest_pressure();
            is_rest.then(|| mean(&recording.angle[..rest]))
        })
        .collect();
    (!rests.is_empty()).then(|| median(&mut rests))
}

/// Where the straight line through all samples of pressure and angle meets zero pressure
/// (rad); the mean of the angle where the pressure is constant.
fn static_rest(data: &Dataset) -> f64 {
    let samples = || {
        data.fitted()
            .flat_map(|it| it.recording.pressure.iter().zip(&it.recording.angle))
    };
    let (pressures, angles): (Vec<f64>, Vec<f64>) = samples().map(|(p, a)| (*p, *a)).unzip();
    let (pressure, angle) = (mean(&pressures), mean(&angles));
    let squares: f64 = pressures.iter().map(|p| (p - pressure).powi(2)).sum();
    let products: f64 = samples().map(|(p, a)| (p - pressure) * (a - angle)).sum();
    let slope = products / squares;
    if slope.is_finite() {
        angle - slope * pressure
    } else {
        angle
    }
}

/// The least cost of a linear model with effects (rad²), and the first parameter of the
/// first effect.
fn cost(part: &Dataset, effects: &[Kind]) -> Option<(f64, f64)> {
    let effects: Vec<_> = effects
        .iter()
        .filter_map(|kind| kind.build(&[0.0]))
        .collect();
    let dynamics = Dynamics {
        inertia: 1.0,
        damping: 1.0,
        stiffness: 1.0,
        exponent: 1.0,
        input_gain: NO_INPUT_GAIN,
    };
    let model: Model<f64> = Model::new(dynamics, &effects).ok()?;
    let offset = ParameterId::Effect {
        slot: 0,
        parameter: 0,
    };
    let mut free = vec![ParameterId::Damping, ParameterId::Stiffness];
    free.extend(is_driven(part).then_some(ParameterId::InputGain));
    free.extend((!effects.is_empty()).then_some(offset));
    let identifier = Identifier {
        model: &model,
        free: &free,
        data: part,
    };
    let best = identifier.coarse(part, part, &[]).into_iter().next()?;
    Some((best.cost(), best.model.value(offset).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig_formats::recording::Recording;

    /// A finger of first order that bends against the pressure, by 1° for 1 kPa, and rests
    /// at an angle (°).
    fn finger(rest_deg: f64) -> Dataset {
        let time: Vec<f64> = (0..900).map(|k| f64::from(k) * 0.05).collect();
        let mut angle = 0.0;
        let mut recording = Recording::default();
        for t in time {
            let pressure = if (t / 9.0).fract() < 0.5 { 0.0 } else { 80e3 };
            angle += 0.05 * (-(pressure / 1e3_f64).to_radians() - angle);
            recording.time.push(t);
            recording.pressure.push(pressure);
            recording.angle.push(angle + rest_deg.to_radians());
        }
        Dataset::of(&[recording])
    }

    #[test]
    fn an_angle_that_rests_far_from_zero_is_found() {
        for rest_deg in [116.0, -90.0] {
            let found = resting_angle(&finger(rest_deg)).unwrap().to_degrees();
            assert!((found - rest_deg).abs() < 2.0, "{found}° for {rest_deg}°");
        }
    }

    #[test]
    fn what_a_zero_or_an_effect_explains_is_left_to_them() {
        for rest_deg in [0.0, 5.0, -15.0] {
            assert_eq!(resting_angle(&finger(rest_deg)), None, "{rest_deg}°");
        }
    }

    /// A decay to zero has a mean far from it.
    #[test]
    fn a_decay_rests_at_zero() {
        let time: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.05).collect();
        let decay = Recording {
            angle: time.iter().map(|t| 2.0 * (-t / 20.0).exp()).collect(),
            pressure: vec![0.0; time.len()],
            time,
            ..Recording::default()
        };
        assert_eq!(resting_angle(&Dataset::of(&[decay])), None);
    }
}
