//! Dead time: p_c(t) = p(t − t_d).
//!
//! A pure transport delay t_d (s) between the measured pressure and the one
//! that the chamber feels: sound in a long tube, a valve that opens late, or a
//! recorder whose two channels are not sampled at the same time.

use super::{Change, Family, Info, Mechanism, Parameter, Place, Unit, parameters};
use crate::catalogue::Kind;
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Nothing, Preparation};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "dead_time",
    title: "dead time",
    place: Place::Input,
    equation: "p_c(t) = p(t − t_d)",
    text: "Nothing happens for a while after an edge of the pressure, then everything happens as \
           simulated: a long tube, a valve that opens late, or two channels that were not sampled \
           at the same time.",
    signature: "time since the last command edge",
    look_alikes: &["pneumatic_lag", "sensor_lag"],
    family: Family::InputPath,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[Kind::PneumaticLag, Kind::SensorLag],
    told_by: &[Change::LongerTube],
    doubtful: &[],
    has_slope: true,
    states: &[],
};

parameters! {
    /// Dead time.
    DeadTime {
        /// Delay t_d (s).
        delay: Parameter {
            key: "delay_s",
            symbol: "t_d",
            unit: Unit::Second,
            lower: 0.0,
            upper: 5.0,
            held: None,
            default: None,
            starts: &[0.05, 0.25],
        },
    }
}

impl<R: Real> Mechanism<R> for DeadTime<R> {
    fn lengthen_tube(&mut self, times: R) {
        self.delay = self.delay * times;
    }

    fn delay(&self) -> R {
        self.delay
    }
}

impl Preparation for DeadTime<f32> {
    const CYCLES: u16 = 0;
    type Part = Nothing;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[]);

    fn prepare(&self, _base: &Base) -> Self::Part {
        Nothing
    }
}

#[cfg(test)]
mod tests {
    use crate::actuator::Model;
    use crate::catalogue::{Effect, Kind};
    use crate::effects::testing::spring;
    use crate::input::FromFn;
    use crate::integrate::{Scheme, step};

    fn swing(effects: &[Effect<f64>], steps: i32) -> Vec<f64> {
        let model: Model<f64> = spring(0.4, 0.6, 3.0, effects);
        let mut state = model.at_rest(0.0, 0.0);
        (0..steps)
            .map(|count| {
                let start = f64::from(count) * 1e-3;
                let input = FromFn(|offset: f64| {
                    let time: f64 = start + offset;
                    if time > 0.0 { (2.0 * time).sin() } else { 0.0 }
                });
                step(Scheme::default(), &model, &mut state, &input, 1e-3);
                state.angle
            })
            .collect()
    }

    #[test]
    fn delayed_run_is_the_run_shifted_by_the_delay() {
        let plain = swing(&[], 3_000);
        let delayed = swing(&[Kind::DeadTime.build(&[0.25]).unwrap()], 3_250);
        for (step, angle) in plain.iter().enumerate() {
            assert!((delayed[step + 250] - angle).abs() < 1e-9, "step {step}");
        }
        assert!(delayed[..250].iter().all(|angle| angle.abs() < 1e-12));
    }
}
