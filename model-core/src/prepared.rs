//! A model prepared for steps of one length, as the board runs it.
//!
//! [`crate::leapfrog`] steps the base equation. Here the effects of the catalogue are added,
//! with all constants of the step length precomputed, and without copying a state. A force that
//! depends on angle, pressure or time alone comes from the effect itself ([`crate::effects`]), so
//! its equation is in one place. Linear memories are integrated exactly ([`crate::carried`]). A
//! hysteresis loop, a softening and a damping that depends on the angle use short series of their
//! exponentials, and for steps too long for these an unconditionally stable formula.

use core::fmt;

use crate::actuator::{MAX_EFFECTS, Model, State};
use crate::catalogue::{AnyPart, Kind};
use crate::effects::table::Variable;
use crate::effects::{Hidden, Instant, Mechanism};
use crate::glide::{Flow, Glide};
use crate::leapfrog::{COARSEST_PHASE, Leapfrog, PHASE, Pull, substeps};
use crate::part::{Base, Part, Phases, Step};
use crate::power::{Minimax, Power};
use crate::power_table::{EXPONENTS, PowerTable};
use crate::real::Real;

/// Cycles that the steps of one period may take: 12.5 % of a processor of 16 MHz at 100 Hz. The
/// rest of the firmware takes 61 % at full flow of the pump, so no model brings it above 75 %.
pub const BUDGET_CYCLES: u32 = 20_000;

/// Cycles of a step of the base equation, at most, on an ATmega2560. An effect adds its
/// [`Preparation::CYCLES`](crate::part::Preparation::CYCLES).
pub const BASE_CYCLES: u16 = 1_100;

/// The most that a dry friction takes from the rate in a step (rad/s), twice as much where the
/// processor has no time for more.
const KICK: f32 = 0.05;

/// Why a model cannot be stepped beside the rig.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unsteppable {
    /// Its dead times exceed the memory of pressures.
    TooMuchDelay,
    /// It moves too fast for as many steps as the processor has time for.
    TooFast,
    /// Its exponent is outside what a table of the power can hold.
    Exponent,
    /// It has a force by a user's formula ([`crate::effects::custom`]).
    #[cfg(feature = "desktop")]
    Formula,
}

impl fmt::Display for Unsteppable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooMuchDelay => "has more dead time than the board's 0.6 s of memory",
            Self::TooFast => "moves too fast for the steps that the board has time for",
            Self::Exponent => "has an exponent outside the board's 0.25 … 5",
            #[cfg(feature = "desktop")]
            Self::Formula => "has an effect by a formula, which the board cannot compute",
        })
    }
}

impl core::error::Error for Unsteppable {}

/// Where a prepared model is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The step at hand.
    step: Step,
    /// Way of the next drift (rad), the kick at this angle in it.
    way: f32,
    /// That kick (rad).
    kick: f32,
    /// What the effects remember, a slot each.
    memory: [Hidden<f32>; MAX_EFFECTS],
}

impl Motion {
    /// Bending angle (rad).
    pub fn angle(&self) -> f32 {
        self.step.angle
    }

    /// What the angle sensor shows (rad).
    pub fn reading(&self) -> f32 {
        self.step.reading
    }
}

/// A model of three effects, prepared.
///
/// The order of a step:
///
/// 1. drift: damping and [every law of the rate](crate::glide) take their losses;
/// 2. the input path carries the pressure to the chamber;
/// 3. memories (a Maxwell branch, a hysteresis loop, a second mode) are carried along the way
///    that was drifted;
/// 4. kick: `γ·(g·p − factor·K·sign(θ)|θ|ⁿ − Q)` at the new angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prepared {
    base: Base,
    spring: PowerTable,
    glide: Glide,
    /// What its effects do, as many as there are.
    parts: [Option<AnyPart>; MAX_EFFECTS],
    /// Whether a law of the rate takes from the drift.
    glides: bool,
    /// When any of the parts acts.
    phases: Phases,
    /// Slots in use.
    count: u8,
    /// Steps of a period.
    substeps: u8,
    /// Their share of it.
    share: f32,
    is_complete: bool,
}

/// How a period is cut into steps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plan {
    /// Steps of a period.
    pub substeps: u8,
    /// Cycles that they take together, at most.
    pub cycles: u32,
    /// The largest way of a step that a law of the rate has to resolve, as a rate (rad/s).
    farthest_rate: f32,
}

/// Three effects that no others exceed in [`Kind::cycles`]: what a model may cost together.
pub const DEAREST: [Kind; 3] = [
    Kind::BoucWenHysteresis,
    Kind::PeriodicDisturbance,
    Kind::SecondMode,
];

/// What the laws of the rate decelerate (rad/s²) at a rate (rad/s), without what they do
/// at rest.
#[inline(never)]
fn deceleration(model: &Model<f32, Minimax>, rate: f32) -> f32 {
    let at = Instant {
        time: 0.0,
        angle: 0.0,
        rate,
        pressure: 0.0,
    };
    let base = model.dynamics();
    let mut dynamics = *base;
    let mut force = 0.0;
    for slot in model
        .occupied()
        .filter(|slot| slot.rate_law(model).is_some())
    {
        slot.modulate(&at, &[0.0; 2], &mut dynamics);
        force += slot.force(&at, &[0.0; 2], &mut [0.0; 2]);
    }
    if let Some(table) = model.table().filter(|table| table.of() == Variable::Rate) {
        force += table.at(rate) - table.at(0.0);
    }
    (force + (dynamics.damping - base.damping) * rate) / base.inertia
}

/// The most that the laws of the rate decelerate (rad/s²) at this rate (rad/s), either way.
#[inline(never)]
fn jolt(model: &Model<f32, Minimax>, rate: f32) -> f32 {
    let [forth, back] = [rate, -rate].map(|rate| deceleration(model, rate).abs());
    Real::max(forth, back)
}

/// Plans the steps of `interval` seconds for angles up to `farthest` (rad): as many as
/// [`PHASE`] asks for, or as [`BUDGET_CYCLES`] allow, if that still follows the oscillation.
///
/// # Errors
///
/// [`Unsteppable`].
#[inline(never)]
pub fn plan(
    model: &Model<f32, Minimax>,
    farthest: f32,
    interval: f32,
) -> Result<Plan, Unsteppable> {
    #[cfg(feature = "desktop")]
    if model
        .occupied()
        .any(|slot| matches!(slot, crate::catalogue::Effect::Custom(_)))
    {
        return Err(Unsteppable::Formula);
    }
    let mut dynamics = *model.dynamics();
    for slot in model.occupied() {
        slot.enlarge(farthest, &mut dynamics);
    }
    if !EXPONENTS.contains(&exponent(model)) {
        return Err(Unsteppable::Exponent);
    }
    let frequency = Minimax::pow(model.fastest_swing(farthest), 0.5);
    let mut decay = dynamics.damping / dynamics.inertia;
    // Whether something acts on the drift that a step must not outlast.
    let mut brakes = false;
    let mut cost = u32::from(BASE_CYCLES);
    let mut farthest_rate = 0.0_f32;
    for slot in model.occupied() {
        cost += u32::from(slot.kind().cycles());
        if let Some(more) = slot.brakes(&dynamics, farthest) {
            decay += more;
            brakes = true;
        }
        if let Some(law) = slot.rate_law(model) {
            farthest_rate = Real::max(farthest_rate, law.farthest);
        }
    }
    if farthest_rate <= 0.0 {
        farthest_rate = 1.0;
    }
    // What sticks under a load is kicked before it is stopped: it creeps by half of that.
    let jolt = jolt(model, farthest_rate);
    let wanted_decay = Real::max(decay, jolt * (0.5 / KICK));
    let coarse_decay = if jolt > 0.0 || brakes {
        Real::max(decay, jolt * (0.25 / KICK))
    } else {
        // Damping alone is exact however strong.
        0.0
    };
    let affordable = BUDGET_CYCLES.checked_div(cost).unwrap_or(0);
    let wanted = substeps(frequency, wanted_decay, interval, PHASE);
    let substeps = if u32::from(wanted) <= affordable {
        wanted
    } else {
        let needed = substeps(frequency, coarse_decay, interval, COARSEST_PHASE);
        if u32::from(needed) > affordable || !frequency.is_finite() {
            return Err(Unsteppable::TooFast);
        }
        // Below `wanted`, which is one byte.
        #[expect(clippy::cast_possible_truncation)]
        let affordable = affordable as u8;
        affordable
    };
    // What glides down from there in a step must not have come to rest: beyond it the loss
    // stays what it is there.
    let dt = interval / f32::from(substeps);
    Ok(Plan {
        substeps,
        cycles: cost * u32::from(substeps),
        farthest_rate: (farthest_rate + dt * jolt) * 1.15,
    })
}

/// The exponent of the power law with what shifts it.
#[inline(never)]
fn exponent(model: &Model<f32, Minimax>) -> f32 {
    model.shifted_exponent()
}

impl Prepared {
    /// Prepares a model at once, for periods of `interval` seconds.
    pub fn new(model: &Model<f32, Minimax>, plan: Plan, interval: f32) -> Self {
        let mut prepared = Self::empty();
        prepared.restart(model, plan, interval);
        while !prepared.prepare() {}
        prepared
    }

    /// Room for a model: an inertia that nothing acts on, never complete.
    #[inline(always)]
    pub fn empty() -> Self {
        Self {
            base: Base::empty(),
            spring: PowerTable::empty(),
            glide: Glide::empty(),
            parts: [None; MAX_EFFECTS],
            glides: false,
            phases: Phases::NONE,
            count: 0,
            substeps: 0,
            share: 0.0,
            is_complete: false,
        }
    }

    /// Forgets the model: not complete until there is another.
    pub fn clear(&mut self) {
        self.substeps = 0;
        self.is_complete = false;
    }

    /// Begins with another model in place, for a board that has no room for two.
    pub fn restart(&mut self, model: &Model<f32, Minimax>, plan: Plan, interval: f32) {
        let dt = interval / f32::from(plan.substeps);
        let dynamics = *model.dynamics();
        let base = &mut self.base;
        base.model.clone_from(model);
        base.leapfrog = Leapfrog::new(&dynamics, dt);
        base.flow = Flow {
            decay: dynamics.damping / dynamics.inertia,
            dt,
            reach: base.leapfrog.reach(),
            keep: base.leapfrog.kept(1.0),
        };
        base.interval = interval;
        self.substeps = plan.substeps;
        self.share = 1.0 / f32::from(plan.substeps);
        self.is_complete = false;
        self.spring
            .restart(base.leapfrog.pull_scale(), exponent(model));
        self.parts = [None; MAX_EFFECTS];
        self.phases = Phases::NONE;
        self.count = 0;
        self.glides = false;
        let mut sided = false;
        for (part, slot) in self.parts.iter_mut().zip(model.occupied()) {
            let prepared = slot.prepare(&self.base);
            self.phases = self.phases.or(prepared.phases());
            *part = Some(prepared);
            self.count += 1;
            if let Some(law) = slot.rate_law(model) {
                self.glides = true;
                sided |= law.sided;
            }
        }
        if self.glides {
            self.glide
                .restart(self.base.leapfrog.way(plan.farthest_rate), sided);
        }
    }

    /// Computes a little more of the tables, some 30 000 cycles of the board; whether they
    /// are complete.
    pub fn prepare(&mut self) -> bool {
        /// Powers at a time.
        const POWERS: u8 = 5;
        if self.is_complete {
            return true;
        }
        if self.substeps == 0 {
            return false;
        }
        for _ in 0..POWERS {
            if self.spring.prepare() {
                let Base { model, flow, .. } = &self.base;
                self.is_complete =
                    !self.glides || self.glide.prepare(flow, |rate| deceleration(model, rate));
                break;
            }
        }
        self.is_complete
    }

    /// Whether the tables are complete.
    pub fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// The model that is stepped.
    pub fn model(&self) -> &Model<f32, Minimax> {
        &self.base.model
    }

    /// At rest at an angle (rad) under a pressure (Pa), everything settled.
    pub fn at_rest(&self, angle: f32, pressure: f32) -> Motion {
        let mut motion = Motion {
            step: Step {
                angle,
                moved: 0.0,
                chamber: pressure,
                time: 0.0,
                pull: 0.0,
                reading: angle,
            },
            way: 0.0,
            kick: 0.0,
            memory: [[0.0; 2]; MAX_EFFECTS],
        };
        for (part, memory) in self.parts.iter().flatten().zip(&mut motion.memory) {
            *memory = part.at_rest(&mut motion.step);
            part.read(&mut motion.step, memory);
        }
        self.kick(&mut motion);
        motion.way = motion.kick * 0.5;
        motion
    }

    /// The same in motion (rad/s).
    pub fn moving(&self, angle: f32, rate: f32, pressure: f32) -> Motion {
        let mut motion = self.at_rest(angle, pressure);
        motion.way += self.base.leapfrog.way(rate);
        for (slot, memory) in self.base.model.occupied().zip(&mut motion.memory) {
            slot.set_moving(rate, memory);
        }
        motion
    }

    /// Where a state of the model is, under a pressure (Pa): the start of a recording that was
    /// cut out of a longer one. What creeps, softened or drifted goes on from there; the
    /// input path has settled.
    pub fn at(&self, state: &State<f32>, pressure: f32) -> Motion {
        let mut motion = self.moving(state.angle, state.rate, pressure);
        motion.step.time = state.time;
        motion.step.reading = state.angle;
        let memories = motion.memory.iter_mut().zip(&state.hidden);
        for (slot, (memory, hidden)) in self.base.model.occupied().zip(memories) {
            slot.recall(&self.base, &motion.step, *hidden, memory);
            let entering = motion.step.reading;
            motion.step.reading = slot.sensor(entering, state.time, hidden, &mut [0.0; 2]);
        }
        let memory = motion.memory;
        self.kick(&mut motion);
        // It is the kick of these memories, and carries none of them but clocks.
        for (part, (now, before)) in self.parts.iter().zip(motion.memory.iter_mut().zip(memory)) {
            if !part.as_ref().is_some_and(Part::follows_clock) {
                *now = before;
            }
        }
        motion.way = motion.kick * 0.5 + self.base.leapfrog.way(state.rate);
        motion
    }

    /// Lets one period pass, over which the pressure goes from `before` to `after` (Pa) in
    /// a straight line and which ends at `time` (s).
    pub fn advance(&self, motion: &mut Motion, before: f32, after: f32, time: f32) {
        let rise = (after - before) * self.share;
        let mut left = f32::from(self.substeps);
        for _ in 0..self.substeps {
            left -= 1.0;
            self.step(motion, after - left * rise, time - left * self.base.flow.dt);
        }
        self.read(motion, time);
    }

    /// What the angle sensor makes of the angle at the end of a period.
    #[inline]
    pub fn read(&self, motion: &mut Motion, time: f32) {
        motion.step.reading = motion.step.angle;
        if self.phases.reading {
            motion.step.time = time;
            for (part, memory) in self.parts.iter().flatten().zip(&mut motion.memory) {
                part.read(&mut motion.step, memory);
            }
        }
    }

    /// One step, which ends under this pressure (Pa).
    #[inline]
    pub fn step(&self, motion: &mut Motion, pressure: f32, time: f32) {
        if self.glides || self.phases.before || self.phases.after {
            self.step_parts(motion, pressure, time);
        } else {
            motion.step.angle += motion.way;
            motion.step.chamber = pressure;
            motion.kick = self.base.leapfrog.push(pressure) - self.spring.pull(motion.step.angle);
            motion.way = self.base.leapfrog.kept(motion.way) + motion.kick;
        }
    }

    #[inline(never)]
    fn step_parts(&self, motion: &mut Motion, pressure: f32, time: f32) {
        let way = motion.way;
        let mut kept = self.base.leapfrog.kept(way);
        let mut rubbed = 0.0;
        motion.step.moved = way;
        motion.step.chamber = pressure;
        motion.step.time = time;
        if self.glides {
            let [of_way, of_rate] = self.glide.losses(way);
            motion.step.moved = way - of_way;
            rubbed = of_rate;
        }
        if self.phases.before {
            for index in 0..self.count {
                let lost = self.prelude(motion, index);
                if lost != 0.0 {
                    kept -= kept * lost;
                    if self.glides {
                        rubbed -= rubbed * lost * 0.5;
                    }
                }
            }
        }
        motion.step.angle += motion.step.moved;
        self.kick(motion);
        if self.glides {
            kept -= rubbed;
        }
        motion.way = kept + motion.kick;
    }

    /// Carries the memories along the way, and finds what the forces add to the next one.
    #[inline(always)]
    fn kick(&self, motion: &mut Motion) {
        motion.step.pull = self.spring.pull(motion.step.angle);
        let mut kick = self.base.leapfrog.push(motion.step.chamber);
        if self.phases.after {
            for index in 0..self.count {
                let force = self.force(motion, index);
                if force != 0.0 {
                    kick -= force;
                }
            }
        }
        motion.kick = kick - motion.step.pull;
    }

    /// What a part does before the drift.
    #[inline(never)]
    fn prelude(&self, motion: &mut Motion, index: u8) -> f32 {
        let index = usize::from(index);
        match (self.parts.get(index), motion.memory.get_mut(index)) {
            (Some(Some(part)), Some(memory)) => part.before(&mut motion.step, memory),
            _ => 0.0,
        }
    }

    /// What a part does after it.
    #[inline(never)]
    fn force(&self, motion: &mut Motion, index: u8) -> f32 {
        let index = usize::from(index);
        match (self.parts.get(index), motion.memory.get_mut(index)) {
            (Some(Some(part)), Some(memory)) => part.force(&self.base, &mut motion.step, memory),
            _ => 0.0,
        }
    }

    /// The pressure (Pa) at the sensor that gives the actuator this acceleration (rad/s²) where it
    /// is: the inverse of the equation of motion, with what the effects remember. The lags of the
    /// input path are not inverted.
    #[inline(never)]
    pub fn pressure_for(&self, motion: &Motion, acceleration: f32) -> f32 {
        let Base {
            model, leapfrog, ..
        } = &self.base;
        let dynamics = model.dynamics();
        let rate = self.rate(motion);
        let mut force = dynamics.inertia * acceleration + dynamics.damping * rate;
        if self.glides {
            force += dynamics.inertia * deceleration(model, rate);
        }
        // The kick is what all other forces add to the way, that of the present pressure too.
        force -= motion.kick / leapfrog.per_newton();
        let mut pressure = motion.step.chamber + force / dynamics.input_gain;
        for index in (0..usize::from(self.count)).rev() {
            if let (Some(slot), Some(memory)) =
                (model.occupied().nth(index), motion.memory.get(index))
            {
                pressure = slot.pressure_towards(pressure, memory);
            }
        }
        pressure
    }

    /// The rate (rad/s) at the end of a step.
    pub fn rate(&self, motion: &Motion) -> f32 {
        self.base.leapfrog.rate_under(motion.way, motion.kick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Effect;
    use crate::dynamics::Dynamics;
    use crate::effects;
    use crate::effects::table::Table;
    use crate::input::{Held, Input};
    use crate::integrate::{Scheme, step};

    const INTERVAL: f32 = 0.01;
    const FARTHEST: f32 = 2.3;

    const DYNAMICS: Dynamics<f32> = Dynamics {
        inertia: 0.05,
        damping: 0.15,
        stiffness: 0.6,
        exponent: 1.6,
        input_gain: 1e-5,
    };

    /// A pressure (Pa) and its slope (Pa/s).
    struct Line(f64, f64);

    impl Input<f64> for Line {
        fn pressure(&self, offset: f64) -> f64 {
            self.0 + self.1 * offset
        }
    }

    /// Up in steps and down again, with a wave on top (Pa).
    fn pressure(time: f32) -> f32 {
        let stairs: f32 = match time {
            ..0.5 => 0.0,
            ..2.0 => 60_000.0,
            ..4.0 => 110_000.0,
            ..6.0 => 30_000.0,
            _ => 70_000.0,
        };
        stairs + 8_000.0 * (2.5 * time).sin()
    }

    /// The largest gap of the reading (°) to fine steps of Runge–Kutta in `f64`.
    fn gap_deg(effects: &[Effect<f32>]) -> f64 {
        gap_of(DYNAMICS, effects).unwrap()
    }

    /// The same of other dynamics, unless they are refused.
    fn gap_of(dynamics: Dynamics<f32>, effects: &[Effect<f32>]) -> Result<f64, Unsteppable> {
        const FINE: u32 = 250;
        let narrow = Model::new(dynamics, effects).unwrap();
        let plan = plan(&narrow, FARTHEST, INTERVAL)?;
        let prepared = Prepared::new(&narrow, plan, INTERVAL);
        let wide: Vec<_> = effects.iter().map(|effect| effect.map(f64::from)).collect();
        let model: Model<f64> = Model::new(dynamics.map(f64::from), &wide).unwrap();
        let mut motion = prepared.at_rest(0.0, pressure(0.0));
        let mut state: State<f64> = model.at_rest(0.0, f64::from(pressure(0.0)));
        let mut worst = 0.0_f64;
        for sample in 0..800_u16 {
            let [before, after] = [sample, sample + 1].map(|k| pressure(f32::from(k) * INTERVAL));
            let time = f32::from(sample + 1) * INTERVAL;
            prepared.advance(&mut motion, before, after, time);
            let dt = f64::from(INTERVAL) / f64::from(FINE);
            let slope = f64::from(after - before) / f64::from(INTERVAL);
            for k in 0..FINE {
                let line = Line(f64::from(before) + slope * dt * f64::from(k), slope);
                step(Scheme::Rk4, &model, &mut state, &line, dt);
            }
            worst = worst.max((f64::from(motion.reading()) - model.reading(&state)).abs());
        }
        assert!(state.angle.abs() > 0.1, "it moves");
        Ok(worst.to_degrees())
    }

    /// The effect at the values of its trial, if it has any.
    fn strong(kind: Kind) -> Option<Effect<f32>> {
        let values = kind.trial().values;
        (!values.is_empty()).then(|| kind.build(values).expect("as many values as parameters"))
    }

    fn tables() -> [Effect<f32>; 4] {
        let table = |of, nodes: &[f32], forces: &[f32]| {
            Effect::Table(Table::new(of, nodes, forces).unwrap())
        };
        [
            table(Variable::Angle, &[0.1, 0.6, 1.2], &[0.0, 0.2, -0.1]),
            table(
                Variable::Rate,
                &[-2.0, -0.1, 0.1, 3.0],
                &[-0.2, -0.05, 0.1, 0.3],
            ),
            table(Variable::Pressure, &[0.0, 5e4, 9e4], &[0.0, 0.1, -0.1]),
            table(Variable::Time, &[1.0, 7.0], &[0.0, 0.2]),
        ]
    }

    /// Under the pressure for an acceleration the model has that acceleration. A lag lets the
    /// pressure through later, a play at its one side or the other, and a damping by the angle is
    /// not reckoned with.
    #[test]
    fn the_pressure_for_an_acceleration_accelerates_by_it() {
        for &kind in Kind::NAMES {
            let Some(effect) = strong(kind) else { continue };
            if matches!(
                kind,
                Kind::PneumaticLag | Kind::VentAsymmetry | Kind::AngleDependentDamping
            ) {
                continue;
            }
            let narrow: Model<f32> = Model::new(DYNAMICS, &[effect]).unwrap();
            let plan = plan(&narrow, FARTHEST, INTERVAL).unwrap();
            let prepared = Prepared::new(&narrow, plan, INTERVAL);
            let wide: Model<f64> =
                Model::new(DYNAMICS.map(f64::from), &[effect.map(f64::from)]).unwrap();
            for (angle, rate, wanted) in [(0.5, 0.0, 0.0), (0.5, 0.3, 4.0), (0.9, -0.4, -3.0)] {
                let start = 40_000.0;
                let motion = prepared.at(&narrow.moving(angle, rate, start), start);
                let pressure = prepared.pressure_for(&motion, wanted);
                let state: State<f64> = wide.moving(angle.into(), rate.into(), start.into());
                let under = Held(f64::from(pressure));
                let mut reached = wide.derivative(&state, &under, 0.0).acceleration;
                if kind == Kind::PressureStiffening {
                    // By the stiffness at the pressure of before: the loop comes again in 10 ms.
                    let again = prepared.at(&narrow.moving(angle, rate, pressure), pressure);
                    let pressure = Held(f64::from(prepared.pressure_for(&again, wanted)));
                    reached = wide.derivative(&state, &pressure, 0.0).acceleration;
                }
                let gap = (reached - f64::from(wanted)).abs();
                assert!(
                    gap < 0.3,
                    "{kind:?} at {angle}, {rate}: {reached}, not {wanted}"
                );
            }
        }
    }

    /// Whatever rests or moves is where it was, by way of its state.
    #[test]
    fn a_settled_state_is_where_rest_and_motion_begin() {
        for &kind in Kind::NAMES {
            let Some(effect) = strong(kind) else { continue };
            let model: Model<f32> = Model::new(DYNAMICS, &[effect]).unwrap();
            let plan = plan(&model, FARTHEST, INTERVAL).unwrap();
            let prepared = Prepared::new(&model, plan, INTERVAL);
            let (angle, pressure) = (0.4, 20_000.0);
            let begun = prepared.at(&model.at_rest(angle, pressure), pressure);
            let rest = prepared.at_rest(angle, pressure);
            assert_eq!(
                (begun.way, begun.memory),
                (rest.way, rest.memory),
                "{kind:?}"
            );
            let moving = prepared.moving(angle, 0.7, pressure);
            let begun = prepared.at(&model.moving(angle, 0.7, pressure), pressure);
            assert_eq!(
                (begun.way, begun.memory),
                (moving.way, moving.memory),
                "{kind:?}"
            );
        }
    }

    /// A creep that had settled elsewhere, a loop on its curve, a spring that was stretched
    /// farther, a drift by a clock that runs and a disturbance go on as the physics says.
    #[test]
    fn what_has_a_past_goes_on_from_it() {
        for kind in [
            Kind::MaxwellBranch,
            Kind::BoucWenHysteresis,
            Kind::MullinsSoftening,
            Kind::StiffnessDrift,
            Kind::PeriodicDisturbance,
            Kind::SensorDrift,
            Kind::SensorLag,
        ] {
            let effect = strong(kind).unwrap();
            let model: Model<f32> = Model::new(DYNAMICS, &[effect]).unwrap();
            let plan = plan(&model, FARTHEST, INTERVAL).unwrap();
            let prepared = Prepared::new(&model, plan, INTERVAL);
            let wide: Model<f64> = model.map(f64::from);
            let (angle, rate) = (0.3, 0.5);
            let shown = effects::Motion { angle, rate };
            let narrow = State {
                time: 7.3,
                ..model.coming_from(0.8, shown, 60_000.0)
            };
            let mut state = State {
                time: f64::from(narrow.time),
                angle: f64::from(narrow.angle),
                rate: f64::from(narrow.rate),
                hidden: narrow.hidden.map(|slot| slot.map(f64::from)),
            };
            let mut motion = prepared.at(&narrow, 60_000.0);
            let mut worst = (f64::from(motion.reading()) - wide.reading(&state)).abs();
            for period in 1..=200_u16 {
                let time = narrow.time + f32::from(period) * INTERVAL;
                prepared.advance(&mut motion, 60_000.0, 60_000.0, time);
                for _ in 0..100 {
                    step(Scheme::Rk4, &wide, &mut state, &Line(60_000.0, 0.0), 1e-4);
                }
                worst = worst.max((f64::from(motion.reading()) - wide.reading(&state)).abs());
            }
            println!("{}: {:.4}°", kind.name(), worst.to_degrees());
            assert!(
                worst.to_degrees() < 0.02,
                "{kind:?}: {}°",
                worst.to_degrees()
            );
        }
    }

    /// Each effect of the catalogue, in the board's arithmetic and at its steps, beside
    /// the physics in `f64`.
    #[test]
    fn every_effect_is_stepped_as_the_physics_says() {
        assert!(gap_deg(&[]) < 0.01);
        for &kind in Kind::NAMES {
            let Some(effect) = strong(kind) else {
                assert_eq!(kind, Kind::DeadTime, "tested with the memory of pressures");
                continue;
            };
            let gap = gap_deg(&[effect]);
            println!("{}: {gap:.4}°", kind.name());
            assert!(gap < kind.trial().within_deg, "{}: {gap}°", kind.name());
        }
        for table in tables() {
            let gap = gap_deg(&[table]);
            println!("{}: {gap:.4}°", table.parameters().len());
            assert!(gap < Kind::Table.trial().within_deg, "{table:?}: {gap}°");
        }
    }

    #[test]
    fn no_effect_is_dearer_than_the_dearest() {
        let dearest = DEAREST.map(Kind::cycles);
        for &kind in Kind::ALL {
            assert!(
                dearest.iter().all(|&most| most >= kind.cycles()),
                "{kind:?}"
            );
        }
    }

    /// Narrow signs, jumps of a table, light actuators that are braked hard: near the physics,
    /// or refused.
    #[test]
    fn brakes_that_are_sharp_are_resolved_or_refused() {
        let coulomb = |force, width| Kind::CoulombFriction.build(&[force, width]).unwrap();
        let jump = |at: f32| {
            Effect::Table(Table::new(Variable::Rate, &[-at, at], &[-0.15, 0.15]).unwrap())
        };
        let stribeck = |width| Kind::StribeckFriction.build(&[0.08, 0.08, width]).unwrap();
        let drag = |drag| Kind::QuadraticDamping.build(&[drag]).unwrap();
        let slope = |slope| Kind::AngleDependentDamping.build(&[slope]).unwrap();
        let light = |inertia, damping| Dynamics {
            inertia,
            damping,
            ..DYNAMICS
        };
        let gap = |name: &str, dynamics, effect| {
            let gap = gap_of(dynamics, &[effect]);
            println!("{name}: {gap:?}");
            gap
        };
        for (name, dynamics, effect) in [
            ("narrow sign", DYNAMICS, coulomb(0.15, 0.001)),
            ("narrower sign", DYNAMICS, coulomb(0.15, 3e-4)),
            ("jump of a table", DYNAMICS, jump(0.02)),
            ("sharper jump", DYNAMICS, jump(0.005)),
            ("light", light(0.005, 0.03), coulomb(0.15, 0.02)),
            ("drag", light(0.001, 0.01), drag(0.2)),
            ("much drag", light(0.001, 0.01), drag(2.0)),
            ("damping that is lost", light(0.002, 1.0), slope(-1.0)),
            ("damping that grows", light(0.0005, 1.0), slope(0.5)),
        ] {
            if let Ok(gap) = gap(name, dynamics, effect) {
                assert!(gap < 0.5, "{name}: {gap}°");
            }
        }
        // Past its peak a friction drives: what is wrong by little grows.
        assert!(gap("narrow peak", DYNAMICS, stribeck(0.02)).unwrap() < 2.0);
        // Those of ordinary inertia are not refused.
        assert!(gap_of(DYNAMICS, &[coulomb(0.15, 0.001)]).is_ok());
        assert!(gap_of(DYNAMICS, &[jump(0.02)]).is_ok());
        assert_eq!(
            gap_of(light(0.0004, 1.5), &[coulomb(0.3, 0.02)]),
            Err(Unsteppable::TooFast)
        );
    }

    /// What acts on the same drift, on the same input, on the same spring.
    #[test]
    fn effects_that_meet_are_stepped_as_the_physics_says() {
        use Kind::{
            AngleDependentDamping, AsymmetricDamping, CoulombFriction, Leak, MaxwellBranch,
            MullinsSoftening, PneumaticLag, PressureStiffening, PressureThreshold,
            QuadraticDamping, SecondMode, SensorLag, SensorOffset, StiffnessDrift,
        };
        for kinds in [
            [CoulombFriction, QuadraticDamping, AsymmetricDamping],
            [CoulombFriction, AngleDependentDamping, AsymmetricDamping],
            [AngleDependentDamping, QuadraticDamping, MaxwellBranch],
            [PneumaticLag, Leak, PressureThreshold],
            [StiffnessDrift, PressureStiffening, MullinsSoftening],
            [SecondMode, SensorOffset, SensorLag],
        ] {
            let effects = kinds.map(|kind| strong(kind).unwrap());
            let gap = gap_deg(&effects);
            println!("{kinds:?}: {gap:.4}°");
            assert!(gap < 0.05, "{kinds:?}: {gap}°");
        }
    }

    /// Steps half as long have a quarter of the error, whatever is carried along.
    #[test]
    fn order_two_with_every_smooth_effect() {
        for &kind in Kind::NAMES {
            let Some(effect) = strong(kind) else { continue };
            if !kind.trial().smooth {
                continue;
            }
            let model = Model::new(DYNAMICS, &[effect]).unwrap();
            // Long steps, so that single precision does not hide the order.
            let end = |substeps: u8| {
                let plan = Plan {
                    substeps,
                    cycles: 0,
                    farthest_rate: 20.0,
                };
                let prepared = Prepared::new(&model, plan, 0.08);
                let mut motion = prepared.at_rest(0.7, 60_000.0);
                for k in 0..10_u8 {
                    let [before, after] = [k, k + 1].map(|k| 60_000.0 + 3_000.0 * f32::from(k));
                    prepared.advance(&mut motion, before, after, 0.08 * f32::from(k + 1));
                }
                f64::from(motion.angle())
            };
            let truth = end(64);
            let [coarse, fine] = [2, 8].map(|substeps| (end(substeps) - truth).abs());
            println!("{}: {coarse:.1e}, {fine:.1e}", kind.name());
            // A sixteenth, but for what single precision leaves.
            assert!(
                fine < coarse / 9.0 + 1e-5,
                "{}: {coarse} {fine}",
                kind.name()
            );
        }
    }
}
