// SPDX-License-Identifier: GPL-3.0-or-later
//! The actuator: `model_core` in f64, with every effect of the truth.
//!
//! The pressure is linear between two steps, and a dead time uses its history. Steps are
//! divided if the model's own rates require it.
//!
//! What hangs at the tip moves as the tip of an arc does, by its position alone.

use model_core::{
    actuator::{Model, ParameterId, State},
    catalogue::Effect,
    effects::Mechanism,
    input::FromFn,
    integrate::{Scheme, step},
};
use softrig::{estimate::Placement, sim::simulate::substeps};

/// Angles up to which the steps resolve the model (rad).
const RESOLVED_RAD: f64 = 4.0;

/// A bend beyond which the silicone lies on itself (rad).
const FARTHEST_RAD: f64 = 5.0;

/// An actuator's history before power-on: it was held at an angle without
/// pressure, and let go. The default is one that rests straight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LetGo {
    /// Where it was held (rad).
    pub angle_rad: f64,
    /// How long before power-on it was let go (s).
    pub before_s: f64,
}

impl LetGo {
    /// Angle (rad) and rate (rad/s) at power-on.
    pub fn at_power_on(&self, model: &Model<f64>) -> (f64, f64) {
        let state = Actuator::let_go(model, self, INTERVAL_S).state;
        (state.angle, state.rate)
    }
}

/// Steps (s) in which the time before power-on is simulated, whatever the
/// interval after it.
const INTERVAL_S: f64 = 5e-4;

/// How long a rest (s) lets what has warmed up cool down, so that drifts begin anew.
const COOLS_S: f64 = 600.0;

/// What hangs at the tip of an actuator that bends to an arc of constant curvature.
///
/// The tip of an arc of length l is at x = l(1 − cos θ)/θ aside of its base and z = l sin θ/θ below
/// it, so that a mass m has the energy −m g₀ (z cos φ − x sin φ) on a base turned by φ, and the
/// inertia m(x′² + z′²).
#[derive(Clone, Copy, Debug)]
struct Load {
    /// Force (N) at θ = 0 on a base that is turned by a right angle: m·a.
    force: f64,
    /// Inertia (kg·m) at θ = 0.
    inertia: f64,
    /// By how much the base is turned, with the tilt at which its angle was zeroed (rad).
    turned: f64,
}

/// Force (N/kg) and lever (m) of a load where the actuator as it is says nothing of one: what a
/// tenth of a metre of silicone has.
const OF_A_LOAD: [f64; 2] = [10.0, 0.05];

impl Load {
    /// Of `placement`, on an actuator; none where nothing hangs there.
    fn of(model: &Model<f64>, placement: &Placement) -> Option<Self> {
        const STANDARD_GRAVITY: f64 = 9.806_65;
        let [mut force, mut lever] = OF_A_LOAD;
        let mut turned = placement.turned_rad;
        for effect in model.effects() {
            match effect {
                Effect::TipLoad(load) => [force, lever] = [load.force_per_mass, load.lever],
                Effect::Gravity(own) => turned += own.tilt,
                _ => {}
            }
        }
        let force = placement.load_kg * force;
        (placement.load_kg > 0.0).then_some(Self {
            force,
            inertia: force.abs() * lever / STANDARD_GRAVITY,
            turned,
        })
    }

    /// x′ and z′ by the angle (rad), in halves of the length: 1 and 0 at θ = 0.
    fn slopes(angle: f64) -> [f64; 2] {
        /// Below, the series to θ³ is exact to twelve digits.
        const SMALL: f64 = 1e-3;
        let square = angle * angle;
        if angle.abs() < SMALL {
            return [1.0 - square / 4.0, -angle * (2.0 / 3.0)];
        }
        let (sin, cos) = angle.sin_cos();
        [
            2.0 * (angle * sin - 1.0 + cos) / square,
            2.0 * (angle * cos - sin) / square,
        ]
    }

    /// The force (N) against the angle.
    fn force(&self, angle: f64) -> f64 {
        let [aside, below] = Self::slopes(angle);
        self.force * (aside * self.turned.sin() - below * self.turned.cos())
    }

    /// What it adds to the inertia (kg·m).
    fn inertia(&self, angle: f64) -> f64 {
        let [aside, below] = Self::slopes(angle);
        self.inertia * (aside * aside + below * below)
    }

    /// The force (N) against a motion with this rate (rad/s): the inertia changes with the
    /// angle, so that half of its slope by the square of the rate is needed to keep the energy.
    fn force_in_motion(&self, angle: f64, rate: f64) -> f64 {
        /// rad.
        const STEP: f64 = 1e-4;
        let slope = (self.inertia(angle + STEP) - self.inertia(angle - STEP)) / (2.0 * STEP);
        self.force(angle) + slope * rate * rate / 2.0
    }
}

/// An actuator in motion.
#[derive(Clone, Debug)]
pub struct Actuator {
    model: Model<f64>,
    /// The same as its file says, whatever is changed about the rig.
    as_written: Model<f64>,
    load: Option<Load>,
    state: State<f64>,
    interval: f64,
    substeps: usize,
    /// Pressure (Pa) at the ends of past steps in a ring.
    history: Vec<f64>,
    newest: usize,
    /// Where a hand holds it (rad).
    held: Option<f64>,
}

impl Actuator {
    /// An actuator that rests without pressure, for steps of `interval` seconds.
    pub fn at_rest(model: &Model<f64>, interval: f64) -> Self {
        let length = remembered(model, interval);
        Self {
            model: *model,
            as_written: *model,
            load: None,
            state: model.at_rest(0.0, 0.0),
            interval,
            substeps: substeps(model, interval, RESOLVED_RAD),
            history: vec![0.0; length],
            newest: 0,
            held: None,
        }
    }

    /// A hand bends it to an angle (rad) and holds it there, or lets go.
    pub fn hold(&mut self, angle: Option<f64>) {
        self.held = angle;
    }

    /// The rig is changed: its base is turned against where it stood at power-on, so that a
    /// weight pulls another way; something is hung at the tip; the tube is another.
    pub fn stand(&mut self, placement: &Placement) {
        self.load = Load::of(&self.as_written, placement);
        let with_tube = self.as_written.with_tube(placement.tube);
        self.model = with_tube.turned(placement.turned_rad);
        self.substeps = substeps(&self.model, self.interval, RESOLVED_RAD);
        // The pressures so far, the oldest first, behind as many of the oldest as a longer
        // delay reaches back.
        let oldest_at = (self.newest + 1) % self.history.len();
        self.history.rotate_left(oldest_at);
        let oldest = self.history[0];
        let more = remembered(&self.model, self.interval).saturating_sub(self.history.len());
        self.history.splice(0..0, std::iter::repeat_n(oldest, more));
        self.newest = self.history.len() - 1;
    }

    /// It is left alone without pressure for so many seconds.
    pub fn rest(&mut self, seconds: f64) {
        // Hours at most.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let steps = (seconds / self.interval).round() as usize;
        for _ in 0..steps {
            self.step(0.0);
        }
        if seconds >= COOLS_S {
            self.restart_clock();
        }
    }

    /// Another one of the same make takes its place, which was never stretched.
    pub fn replace(&mut self) {
        self.state = self.model.at_rest(0.0, 0.0);
        self.history.fill(0.0);
    }

    /// An actuator that was let go before its time zero, for steps of `interval`
    /// seconds. It moved by its own dynamics since; a run begins at time zero
    /// all the same.
    pub fn let_go(model: &Model<f64>, let_go: &LetGo, interval: f64) -> Self {
        let mut before = Self::at_rest(model, INTERVAL_S);
        before.state = model.at_rest(let_go.angle_rad, 0.0);
        // Some seconds.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let steps = (let_go.before_s / INTERVAL_S).round() as usize;
        for _ in 0..steps {
            before.step(0.0);
        }
        let mut actuator = Self::at_rest(model, interval);
        actuator.state = State {
            time: 0.0,
            ..before.state
        };
        actuator
    }

    /// Advances by one interval, at the end of which the line has `pressure` (Pa).
    pub fn step(&mut self, pressure: f64) {
        self.newest = (self.newest + 1) % self.history.len();
        self.history[self.newest] = pressure;
        let dt = self.interval / self.substeps as f64;
        for part in 0..self.substeps {
            let begin = dt * part as f64;
            let (history, newest, interval) = (&self.history, self.newest, self.interval);
            let input =
                FromFn(|offset: f64| past(history, newest, (interval - begin - offset) / interval));
            match self.load {
                Some(load) => {
                    let inertia = self.model.dynamics().inertia + load.inertia(self.state.angle);
                    let loaded = self.model.with_value(ParameterId::Inertia, inertia);
                    // Half of what the load does before the step and half after it.
                    let kick = |state: &mut State<f64>| {
                        let force = load.force_in_motion(state.angle, state.rate);
                        state.rate -= force / inertia * dt / 2.0;
                    };
                    kick(&mut self.state);
                    step(Scheme::Rk4, &loaded, &mut self.state, &input, dt);
                    kick(&mut self.state);
                }
                None => step(Scheme::Rk4, &self.model, &mut self.state, &input, dt),
            }
        }
        if !self.state.angle.is_finite() {
            self.state = self.model.at_rest(0.0, pressure);
        } else if self.state.angle.abs() > FARTHEST_RAD {
            self.state.angle = FARTHEST_RAD.copysign(self.state.angle);
            self.state.rate = 0.0;
        }
        self.obey_hand();
    }

    /// Where a hand has it, it neither moves nor matters what moves it.
    fn obey_hand(&mut self) {
        if let Some(angle) = self.held {
            self.state.angle = angle;
            self.state.rate = 0.0;
        }
    }

    /// Drifts begin anew.
    pub fn restart_clock(&mut self) {
        self.state.time = 0.0;
    }

    /// The bending angle (rad).
    pub fn angle(&self) -> f64 {
        self.state.angle
    }

    /// The angle through the sensor effects of the truth (rad).
    pub fn reading(&self) -> f64 {
        self.model.reading(&self.state)
    }

    /// Time of one step (s).
    pub fn interval(&self) -> f64 {
        self.interval
    }
}

/// Pressures that a model's delays reach back to, in steps of `interval` seconds.
fn remembered(model: &Model<f64>, interval: f64) -> usize {
    let delay: f64 = model.effects().map(|effect| effect.delay()).sum();
    // Delays are bounded by the effect's table.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let steps = (delay / interval).ceil() as usize;
    steps + 3
}

/// The pressure `back` intervals before the newest entry, on a straight line
/// between entries.
fn past(history: &[f64], newest: usize, back: f64) -> f64 {
    let back = back.clamp(0.0, (history.len() - 2) as f64);
    // Clamped to the history's length.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let whole = back as usize;
    let at = |steps: usize| history[(newest + history.len() - steps) % history.len()];
    let share = back - whole as f64;
    at(whole) + (at(whole + 1) - at(whole)) * share
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::{
        catalogue::Kind,
        dynamics::Dynamics,
        effects::{Parameter, Unit},
    };
    use softrig::sim::simulate::{InitialState, Signal, run};

    const DT: f64 = 5e-4;
    /// Mean of the pressure (Pa) that moves the actuator.
    const PRESSURE: f64 = 60e3;

    fn dynamics() -> Dynamics<f64> {
        Dynamics {
            inertia: 0.25,
            damping: 1.5,
            stiffness: 5.0,
            exponent: 1.727,
            input_gain: 0.1e-3,
        }
    }

    /// A value that changes the motion without stopping it.
    fn noticeable(row: &Parameter) -> f64 {
        let size = match row.unit {
            Unit::KiloPascal => PRESSURE,
            Unit::PerKiloPascal => 1.0 / PRESSURE,
            _ => 1.0,
        };
        (0.2 * size).clamp(f64::from(row.lower), f64::from(row.upper))
    }

    /// Without inertia to speak of, C ω = −K θⁿ: θ^(1−n) grows evenly with time.
    #[test]
    fn what_was_let_go_creeps_back_by_its_own_dynamics() {
        let slow = Dynamics {
            inertia: 1e-3,
            ..dynamics()
        };
        let model: Model<f64> = Model::new(slow, &[]).unwrap();
        let let_go = LetGo {
            angle_rad: 2f64.to_radians(),
            before_s: 3.0,
        };
        let power = 1.0 - slow.exponent;
        let after = |time: f64| {
            let grown = -power * slow.stiffness / slow.damping * time;
            (let_go.angle_rad.powf(power) + grown).powf(1.0 / power)
        };
        let mut actuator = Actuator::let_go(&model, &let_go, DT);
        let (angle, rate) = let_go.at_power_on(&model);
        assert!((angle / after(3.0) - 1.0).abs() < 1e-3, "{angle}");
        let creep = -slow.stiffness * angle.powf(slow.exponent) / slow.damping;
        assert!((rate / creep - 1.0).abs() < 1e-2, "{rate} {creep}");
        for _ in 0..4000 {
            actuator.step(0.0);
        }
        assert!((actuator.angle() / after(5.0) - 1.0).abs() < 1e-3);
    }

    #[test]
    fn what_was_not_let_go_rests() {
        let gravity = Kind::Gravity.build(&[0.5, 0.3, 0.0, 1.0]).unwrap();
        let model: Model<f64> = Model::new(dynamics(), &[gravity]).unwrap();
        let rests = Actuator::at_rest(&model, DT);
        let same = Actuator::let_go(&model, &LetGo::default(), DT);
        assert_eq!(rests.state, same.state);
    }

    /// The energy of what hangs at the tip and of the spring is what it was, with an inertia
    /// that changes by the angle; and at rest it hangs where the forces balance.
    #[test]
    fn a_load_swings_with_its_energy_and_comes_to_rest_where_it_is_held() {
        let linear = Dynamics {
            exponent: 1.0,
            damping: 0.0,
            ..dynamics()
        };
        let model: Model<f64> = Model::new(linear, &[]).unwrap();
        let mut actuator = Actuator::at_rest(&model, DT);
        let placement = Placement {
            turned_rad: 0.6,
            load_kg: 0.3,
            ..Placement::USUAL
        };
        actuator.stand(&placement);
        let load = actuator.load.unwrap();
        let height = |angle: f64| {
            let (aside, below) = ((1.0 - angle.cos()) / angle, angle.sin() / angle);
            2.0 * load.force * (aside * load.turned.sin() - below * load.turned.cos())
        };
        let energy = |actuator: &Actuator| {
            let State { angle, rate, .. } = actuator.state;
            let inertia = linear.inertia + load.inertia(angle);
            inertia * rate * rate / 2.0 + linear.stiffness * angle * angle / 2.0 + height(angle)
        };
        actuator.state = model.at_rest(1.0, 0.0);
        let before = energy(&actuator);
        let mut lost = 0.0f64;
        for _ in 0..1_000 {
            actuator.step(0.0);
            lost = lost.max((energy(&actuator) - before).abs());
        }
        assert!(lost < 1e-3 * before.abs(), "{lost} of {before}");

        let damped: Model<f64> = Model::new(dynamics(), &[]).unwrap();
        let mut actuator = Actuator::at_rest(&damped, DT);
        actuator.stand(&placement);
        actuator.rest(30.0);
        let angle = actuator.angle();
        let spring = -dynamics().stiffness * angle.abs().powf(dynamics().exponent);
        assert!(
            (spring.abs() - load.force(angle).abs()).abs() < 1e-3,
            "{angle}"
        );
        assert!(angle < -0.1, "{angle}");
    }

    #[test]
    fn a_stretch_by_hand_is_remembered_over_a_rest_and_not_by_a_new_actuator() {
        let mullins = Kind::MullinsSoftening.build(&[0.3, 0.5]).unwrap();
        let model: Model<f64> = Model::new(dynamics(), &[mullins]).unwrap();
        let mut actuator = Actuator::at_rest(&model, DT);
        actuator.hold(Some(1.4));
        actuator.rest(1.0);
        actuator.hold(None);
        actuator.rest(20.0);
        assert!(actuator.angle().abs() < 0.05, "{}", actuator.angle());
        assert!((actuator.state.hidden[0][0] - 1.4).abs() < 0.02);
        actuator.replace();
        assert!(actuator.state.hidden[0][0].abs() < 1e-12);
    }

    #[test]
    fn a_longer_tube_is_felt_later() {
        let dead = Kind::DeadTime.build(&[0.1]).unwrap();
        let model: Model<f64> = Model::new(dynamics(), &[dead]).unwrap();
        let mut actuator = Actuator::at_rest(&model, DT);
        actuator.stand(&Placement {
            tube: 3.0,
            ..Placement::USUAL
        });
        let mut moved_at = 0.0;
        for step in 1..2_000 {
            actuator.step(PRESSURE);
            if actuator.angle() > 1e-9 {
                moved_at = f64::from(step) * DT;
                break;
            }
        }
        assert!((moved_at - 0.3).abs() < 3.0 * DT, "{moved_at}");
    }

    #[test]
    fn moves_as_the_simulation_of_the_tools_does_with_every_effect() {
        let pressure = |t: f64| PRESSURE * (1.0 - (2.0 * t).cos());
        for &kind in Kind::NAMES {
            let values: Vec<f64> = kind
                .parameters()
                .iter()
                .map(|row| row.left_out().map_or_else(|| noticeable(row), f64::from))
                .collect();
            let effect = kind.build(&values).unwrap();
            let model: Model<f64> = Model::new(dynamics(), &[effect]).unwrap();
            let count = 4000;
            let time: Vec<f64> = (0..=count).map(|k| f64::from(k) * DT).collect();
            let signal = Signal::new(time.clone(), time.iter().map(|&t| pressure(t)).collect());
            // A drifting sensor shows a rate at rest.
            let rest = model.at_rest(0.0, 0.0);
            let later = State { time: DT, ..rest };
            let start = InitialState {
                angle: model.reading(&rest),
                rate: (model.reading(&later) - model.reading(&rest)) / DT,
            };
            let reference = run(&model, &signal, start, 4);
            let mut actuator = Actuator::at_rest(&model, DT);
            let mut worst = 0.0f64;
            let mut farthest = 0.0f64;
            for k in 1..=count {
                actuator.step(pressure(f64::from(k) * DT));
                let expected = reference.reading[usize::try_from(k).unwrap()];
                worst = worst.max((actuator.reading() - expected).abs());
                farthest = farthest.max(expected.abs());
            }
            assert!(farthest > 0.3, "{kind:?} moves by {farthest} rad");
            assert!(worst < 1e-5, "{kind:?} differs by {worst} rad");
        }
    }
}
