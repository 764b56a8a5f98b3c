//! Lag of the sensor: τ ẏ = θ − y.
//!
//! The reading y (rad) follows the angle θ with the time constant τ (s): a filter in the
//! amplifier or the firmware, a flex sensor in a soft sleeve. In a linear plant a run that starts
//! at rest cannot tell it from a lag of the input, since the two commute; a swing after a release
//! by hand has only this one.

use super::{
    Family, Hidden, Info, Mechanism, Motion, Parameter, Place, Rest, State, Unit, parameters,
};
use crate::carried::Lag;
use crate::dynamics::{Dynamics, Rates};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, Step};
use crate::real::Real;

/// What the catalogue says about it.
pub const INFO: Info = Info {
    name: "sensor_lag",
    title: "lag of the sensor",
    place: Place::Sensor,
    equation: "τ ẏ = θ − y",
    text: "The angle sensor shows where the actuator was a moment ago: a filter in the amplifier \
           or in the firmware, a sensor in a soft sleeve. Every motion arrives late and rounded, \
           also a free swing in which the pressure plays no part.",
    signature: "angular velocity, in free swings as well",
    look_alikes: &["pneumatic_lag"],
    family: Family::SensorPath,
    needs: &[],
    own_variable: None,
    special_case: None,
    imitates: &[],
    told_by: &[],
    doubtful: &[],
    has_slope: true,
    states: &[State {
        key: "shown_rad",
        text: "y, what the sensor shows (rad)",
    }],
};

parameters! {
    /// Lag of the sensor.
    SensorLag {
        /// Time constant τ (s).
        time_constant: Parameter {
            key: "time_constant_s",
            symbol: "τ",
            unit: Unit::Second,
            // 2⁻⁹ s, which f32 and f64 hold alike.
            lower: 0.001_953_125,
            upper: 100.0,
            held: None,
            default: None,
            starts: &[0.05, 0.3],
        },
    }
}

impl<R: Real> Mechanism<R> for SensorLag<R> {
    fn integrates(&self) -> bool {
        true
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        [rest.reading - self.time_constant * rest.rate, R::zero()]
    }

    fn sensor(&self, angle: R, _time: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        rates[0] = (angle - hidden[0]) / self.time_constant;
        hidden[0]
    }

    /// At the start of a recording y is known and θ is not: θ = y + τ ẏ, which is exact, and θ̇ = ẏ,
    /// which is right only as far as the motion is even.
    fn behind(&self, shown: Motion<R>) -> Motion<R> {
        Motion {
            angle: shown.angle + self.time_constant * shown.rate,
            ..shown
        }
    }

    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: R::zero(),
            relaxation: R::one() / self.time_constant,
        }
    }
}

impl Preparation for SensorLag<f32> {
    const CYCLES: u16 = 1_250;
    type Part = SlowSensor;
    #[cfg(test)]
    const TRIAL: Trial = Trial::smooth(&[0.09]);

    fn prepare(&self, base: &Base) -> Self::Part {
        SlowSensor(Lag::new(self.time_constant, base.interval))
    }

    fn set_moving(&self, rate: f32, memory: &mut Hidden<f32>) {
        memory[0] -= self.time_constant * rate;
    }

    fn recall(&self, _base: &Base, step: &Step, hidden: Hidden<f32>, memory: &mut Hidden<f32>) {
        *memory = [hidden[0], step.reading];
    }
}

/// Lags behind the reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowSensor(Lag<f32>);

impl Part for SlowSensor {
    fn phases(&self) -> Phases {
        Phases::READING
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        [step.reading, step.reading]
    }

    fn read(&self, step: &mut Step, memory: &mut Hidden<f32>) {
        step.reading = self.0.follow(memory, step.reading);
    }
}

#[cfg(test)]
mod tests {
    use crate::catalogue::Kind;
    use crate::effects::testing::{run, spring};
    use crate::input::Held;

    /// An even motion is shown late by exactly τ, from the start on.
    #[test]
    fn even_motion_is_late_by_the_time_constant() {
        let lag = Kind::SensorLag.build(&[0.2]).unwrap();
        let model = spring(1.0, 0.0, 0.0, &[lag]);
        for time in [0.1, 1.0] {
            let end = run(&model, model.moving(0.3, 1.5, 0.0), &Held(0.0), time, 500);
            let expected = 0.3 + 1.5 * (time - 0.2);
            assert!((model.reading(&end) - expected).abs() < 1e-12);
        }
    }

    /// From rest, an even acceleration a: y = a[t²/2 − τt + τ²(1 − e^(−t/τ))].
    #[test]
    fn even_acceleration_is_followed_in_closed_form() {
        let tau = 0.3;
        let lag = Kind::SensorLag.build(&[tau]).unwrap();
        let model = spring(0.5, 0.0, 0.0, &[lag]);
        let end = run(&model, model.at_rest(0.0, 0.0), &Held(1.0), 1.1, 2_000);
        let decay = f64::exp(-1.1 / tau);
        let expected = 2.0 * (1.1 * 1.1 / 2.0 - tau * 1.1 + tau * tau * (1.0 - decay));
        assert!((model.reading(&end) - expected).abs() < 1e-11);
    }

    #[test]
    fn start_shows_the_reading_and_the_rate_that_were_asked_for() {
        let lag = Kind::SensorLag.build(&[0.2]).unwrap();
        let model = spring(1.0, 0.3, 2.0, &[lag]);
        let start = model.showing(0.5, 0.8, 0.0);
        assert!((model.reading(&start) - 0.5).abs() < 1e-15);
        let rates = model.derivative(&start, &Held(0.0), 0.0);
        assert!((rates.hidden[0][0] - 0.8).abs() < 1e-14);
    }
}
