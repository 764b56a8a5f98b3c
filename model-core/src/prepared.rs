//! A model prepared for steps of one length, as the board runs it.
//!
//! [`crate::leapfrog`] steps the base equation. Here the effects of the catalogue are added,
//! with all constants of the step length precomputed, and without copying a state. The order
//! of a step:
//!
//! 1. drift: damping and [every law of the rate](crate::glide) take their losses;
//! 2. the input path carries the pressure to the chamber;
//! 3. memories (a Maxwell branch, a hysteresis loop, a second mode) are carried along the
//!    way that was drifted;
//! 4. kick: `γ·(g·p − factor·K·sign(θ)|θ|ⁿ − Q)` at the new angle.
//!
//! A force that depends on angle, pressure or time alone comes from the effect itself
//! ([`crate::effects`]), so its equation is in one place. Linear memories are integrated exactly
//! ([`crate::carried`]). A hysteresis loop, a softening and a damping that depends on the angle use
//! short series of their exponentials, and for steps too long for these an unconditionally stable
//! formula.
//!
//! | | cycles of an ATmega2560 |
//! |---|---|
//! | a step of the base equation, and what an effect adds | [`BASE_CYCLES`], [`cycles`] |
//! | most that a period of 10 ms may spend on steps | [`BUDGET_CYCLES`] |
//!
//! [`plan`] decides how many steps a period is cut into.

use core::f32::consts::{PI, TAU};
use core::fmt;

use crate::actuator::{MAX_EFFECTS, Model, Slot};
use crate::carried::{Branch, Lag};
use crate::catalogue::{Effect, Kind};
use crate::dynamics::Dynamics;
use crate::effects::second_mode::SecondMode;
use crate::effects::table::{Table, Variable};
use crate::effects::{Hidden, Instant, Mechanism};
use crate::elementary::{exp, ln, sin_near};
use crate::glide::{Flow, Glide, decays};
use crate::leapfrog::{COARSEST_PHASE, Leapfrog, PHASE, Pull, substeps};
use crate::power::{Minimax, Power};
use crate::power_table::{EXPONENTS, PowerTable};
use crate::real::Real;

/// Cycles that the steps of one period may take: 12.5 % of a processor of 16 MHz at
/// 100 Hz. The rest of the firmware takes 61 % at full flow of the pump, so that no model
/// brings it above 75.
pub const BUDGET_CYCLES: u32 = 20_000;

/// Cycles of a step of the base equation, at most.
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
    #[cfg(feature = "formula")]
    Formula,
}

impl fmt::Display for Unsteppable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TooMuchDelay => "has more dead time than the board's 0.6 s of memory",
            Self::TooFast => "moves too fast for the steps that the board has time for",
            Self::Exponent => "has an exponent outside the board's 0.25 … 5",
            #[cfg(feature = "formula")]
            Self::Formula => "has an effect by a formula, which the board cannot compute",
        })
    }
}

impl core::error::Error for Unsteppable {}

/// What the effect in a slot does in a step.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    /// Nothing: it is in the exponent, in the memory of pressures, or in the glide.
    None,
    /// What a law of the rate leaves at rest: a force (rad of way).
    AtRest(f32),
    /// Maps the pressure as the effect says.
    Input,
    /// Follows the pressure.
    Tube(Lag<f32>),
    /// Loses the pressure.
    Leak(Lag<f32>),
    /// Follows it up and down at different speeds.
    Vent { fill: Lag<f32>, vent: Lag<f32> },
    /// Multiplies the stiffness as the effect says.
    Factor,
    /// Multiplies the stiffness by 1 − δ(1 − e^(−m/θ_m)), m the largest angle so far.
    Softening { loss: f32, per_angle: f32 },
    /// Damping that changes with the angle, by half of C·c₁·h/M (1/rad); C·h/M; what else
    /// multiplies both on the way back; the share of a small loss that the way has of it; and
    /// the way by which a rate that is not damped would go, of A.
    Damping {
        per_angle: f32,
        decay: f32,
        back: f32,
        share: f32,
        undamped: f32,
    },
    /// Quadratic damping: d/M, what it takes of a way by that way (1/rad).
    Drag { per_way: f32 },
    /// A force as the effect says.
    Force,
    /// A sine whose phase advances by so much a step (rad).
    Turning { force: f32, angle: f32 },
    /// Gravity, with its tilt (rad) and the force of that.
    Gravity {
        weight: f32,
        tilt: f32,
        at_zero: f32,
    },
    /// A Maxwell branch.
    Relaxing(Branch<f32>),
    /// A Bouc–Wen loop: force, 1/D, and the two rates ½ ± B of its exponentials.
    Loop {
        force: f32,
        per_yield: f32,
        onwards: f32,
        back: f32,
    },
    /// A second mode: what a step makes of it, and what a way (rad) does.
    Mode {
        step: [[f32; 2]; 2],
        per_way: [f32; 2],
    },
    /// A table of the angle, the pressure or the time.
    Table(Variable),
    /// Maps the reading as the effect says.
    Sensor,
    /// Lags behind the reading.
    SlowSensor(Lag<f32>),
}

/// Where a prepared model is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Bending angle (rad).
    pub angle: f32,
    /// Way of the next drift (rad), the kick at this angle in it.
    way: f32,
    /// That kick (rad).
    kick: f32,
    /// What the angle sensor shows (rad).
    pub reading: f32,
    /// What the effects remember, a slot each.
    memory: [Hidden<f32>; MAX_EFFECTS],
    /// The step at hand, here because a small processor hands few numbers to a function:
    /// its way (rad),
    moved: f32,
    /// its pressure behind the input path (Pa),
    chamber: f32,
    /// the time at its end (s), and
    time: f32,
    /// the pull of the spring there (rad).
    pull: f32,
}

/// A model of three effects, prepared.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::struct_excessive_bools)] // What a step may leave out, looked up once.
pub struct Prepared {
    model: Model<f32, Minimax>,
    leapfrog: Leapfrog<f32>,
    spring: PowerTable,
    flow: Flow,
    glide: Glide,
    parts: [Part; MAX_EFFECTS],
    /// Whether a law of the rate takes from the drift.
    glides: bool,
    /// Whether a part acts before the drift: on the input path or the damping.
    acts_before: bool,
    /// Whether one acts after it: a memory or a force.
    acts_after: bool,
    /// Whether one acts on the reading.
    reads: bool,
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

/// Cycles that an effect adds to a step on the board, with what several of them share.
///
/// Measured on the simulated board, which the tests compare, and rounded up. Rare steps cost
/// more: one in which a hysteresis loop turns round, or that is long for its exponential.
pub const fn cycles(kind: Kind) -> u16 {
    match kind {
        Kind::DeadTime | Kind::ExponentShift => 0,
        Kind::SensorOffset | Kind::SensorDrift => 450,
        Kind::SensorNonlinearity => 650,
        Kind::PressureThreshold | Kind::MaxwellBranch => 1_000,
        Kind::CoulombFriction
        | Kind::StribeckFriction
        | Kind::AsymmetricDamping
        | Kind::LinearStiffness
        | Kind::PneumaticLag
        | Kind::InputBacklash
        | Kind::SensorLag => 1_250,
        Kind::EndStop | Kind::CubicStiffness | Kind::Leak | Kind::VentAsymmetry => 1_600,
        Kind::StiffnessDrift | Kind::PressureStiffening => 1_900,
        Kind::Gravity | Kind::QuadraticDamping | Kind::Table => 2_200,
        Kind::AngleDependentDamping
        | Kind::BoucWenHysteresis
        | Kind::MullinsSoftening
        | Kind::SecondMode
        | Kind::PeriodicDisturbance => 2_400,
        // Not on the board.
        #[cfg(feature = "formula")]
        Kind::Custom(_) => 0,
    }
}

/// Three effects that no others exceed in [`cycles`]: what a model may cost together.
pub const DEAREST: [Kind; 3] = [
    Kind::BoucWenHysteresis,
    Kind::PeriodicDisturbance,
    Kind::SecondMode,
];

/// Whether an effect is a law of the rate alone, which the glide takes. A damping that
/// differs between the directions is, unless another damping multiplies it.
#[inline(never)]
fn is_of_rate(model: &Model<f32, Minimax>, slot: &Slot<f32>) -> bool {
    match slot {
        Effect::CoulombFriction(_) | Effect::StribeckFriction(_) => true,
        Effect::AsymmetricDamping(_) => !model.occupied().any(is_of_angle),
        Effect::Table(_) => table_of(model) == Some(Variable::Rate),
        _ => false,
    }
}

/// Whether it is a damping that depends on the angle.
fn is_of_angle(slot: &Slot<f32>) -> bool {
    matches!(slot, Effect::AngleDependentDamping(_))
}

fn table_of(model: &Model<f32, Minimax>) -> Option<Variable> {
    model.table().map(Table::of)
}

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
    for slot in model.occupied().filter(|slot| is_of_rate(model, slot)) {
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
    #[cfg(feature = "formula")]
    if model
        .occupied()
        .any(|slot| matches!(slot, Effect::Custom(_)))
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
    let nodes = model.table().map_or(&[][..], Table::nodes);
    for slot in model.occupied() {
        cost += u32::from(cycles(slot.kind()));
        if let Effect::QuadraticDamping(effect) = slot {
            decay += Mechanism::<f32>::fastest_rate(effect, &dynamics, farthest).relaxation;
            brakes = true;
        }
        brakes |= is_of_angle(slot);
        if is_of_rate(model, slot) {
            let needed = match (slot.sign(model.dynamics()), slot) {
                (Some(sign), _) => sign.saturated,
                (None, Effect::Table(_)) => nodes
                    .iter()
                    .fold(0.0, |largest: f32, node| Real::max(largest, node.abs())),
                // A damping is a straight line on either side, however far.
                _ => 0.0,
            };
            farthest_rate = Real::max(farthest_rate, needed);
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
    let mut dynamics = *model.dynamics();
    for slot in model.occupied() {
        if let Effect::ExponentShift(_) = slot {
            slot.enlarge(0.0, &mut dynamics);
        }
    }
    dynamics.exponent
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
            model: Model::inert(),
            leapfrog: Leapfrog::empty(),
            spring: PowerTable::empty(),
            flow: Flow {
                decay: 0.0,
                dt: 0.0,
                reach: 0.0,
                keep: 0.0,
            },
            glide: Glide::empty(),
            parts: [Part::None; MAX_EFFECTS],
            glides: false,
            acts_before: false,
            acts_after: false,
            reads: false,
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
        self.model.clone_from(model);
        self.leapfrog = Leapfrog::new(&dynamics, dt);
        self.flow = Flow {
            decay: dynamics.damping / dynamics.inertia,
            dt,
            reach: self.leapfrog.reach(),
            keep: self.leapfrog.kept(1.0),
        };
        self.substeps = plan.substeps;
        self.share = 1.0 / f32::from(plan.substeps);
        self.is_complete = false;
        self.spring
            .restart(self.leapfrog.pull_scale(), exponent(model));
        self.parts = [Part::None; MAX_EFFECTS];
        self.acts_before = false;
        self.acts_after = false;
        self.reads = false;
        self.count = 0;
        for (part, slot) in self.parts.iter_mut().zip(model.occupied()) {
            *part = part_of(model, slot, &self.leapfrog, dt, interval);
            self.count += 1;
            match part {
                Part::None => {}
                Part::Input
                | Part::Tube(_)
                | Part::Leak(_)
                | Part::Vent { .. }
                | Part::Damping { .. }
                | Part::Drag { .. } => self.acts_before = true,
                Part::Sensor | Part::SlowSensor(_) => self.reads = true,
                Part::Mode { .. } => (self.acts_after, self.reads) = (true, true),
                _ => self.acts_after = true,
            }
        }
        self.glides = model.occupied().any(|slot| is_of_rate(model, slot));
        if self.glides {
            let sided = model
                .occupied()
                .filter(|slot| is_of_rate(model, slot))
                .any(|slot| matches!(slot, Effect::AsymmetricDamping(_) | Effect::Table(_)));
            self.glide
                .restart(self.leapfrog.way(plan.farthest_rate), sided);
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
                let model = &self.model;
                self.is_complete = !self.glides
                    || self
                        .glide
                        .prepare(&self.flow, |rate| deceleration(model, rate));
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
        &self.model
    }

    /// At rest at an angle (rad) under a pressure (Pa), everything settled.
    pub fn at_rest(&self, angle: f32, pressure: f32) -> Motion {
        let mut motion = Motion {
            angle,
            way: 0.0,
            kick: 0.0,
            reading: angle,
            memory: [[0.0; 2]; MAX_EFFECTS],
            moved: 0.0,
            chamber: pressure,
            time: 0.0,
            pull: 0.0,
        };
        let parts = self.parts.iter().zip(self.model.occupied());
        for ((part, slot), memory) in parts.zip(&mut motion.memory) {
            let entering = motion.chamber;
            *memory = match part {
                Part::Tube(_) | Part::Vent { .. } => [entering, entering],
                Part::Leak(_) => [0.0, entering],
                Part::Input => {
                    motion.chamber = slot.input(entering, &[entering, 0.0], &mut [0.0; 2]);
                    [entering, 0.0]
                }
                Part::Softening { per_angle, .. } => {
                    let largest = angle.abs();
                    [largest, exp(-largest * per_angle)]
                }
                Part::SlowSensor(_) => [motion.reading, motion.reading],
                // Before the step that the first kick takes it along.
                Part::Turning { angle, .. } => match slot {
                    Effect::PeriodicDisturbance(effect) => {
                        // Within a turn and a little by its bounds.
                        let turned = if effect.phase > PI {
                            effect.phase - TAU
                        } else {
                            effect.phase
                        };
                        [turned - angle, 0.0]
                    }
                    _ => [0.0; 2],
                },
                _ => [0.0; 2],
            };
            motion.reading = show(part, slot, motion.reading, 0.0, memory);
        }
        self.kick(&mut motion);
        motion.way = motion.kick * 0.5;
        motion
    }

    /// The same in motion (rad/s).
    pub fn moving(&self, angle: f32, rate: f32, pressure: f32) -> Motion {
        let mut motion = self.at_rest(angle, pressure);
        motion.way += self.leapfrog.way(rate);
        for (slot, memory) in self.model.occupied().zip(&mut motion.memory) {
            match slot {
                Effect::SecondMode(effect) => {
                    let frequency = TAU * effect.frequency;
                    memory[1] = effect.coupling * rate / frequency;
                }
                Effect::SensorLag(effect) => memory[0] -= effect.time_constant * rate,
                _ => {}
            }
        }
        motion
    }

    /// Lets one period pass, over which the pressure goes from `before` to `after` (Pa) in
    /// a straight line and which ends at `time` (s).
    pub fn advance(&self, motion: &mut Motion, before: f32, after: f32, time: f32) {
        let rise = (after - before) * self.share;
        let mut left = f32::from(self.substeps);
        for _ in 0..self.substeps {
            left -= 1.0;
            self.step(motion, after - left * rise, time - left * self.flow.dt);
        }
        self.read(motion, time);
    }

    /// What the angle sensor makes of the angle at the end of a period.
    #[inline]
    pub fn read(&self, motion: &mut Motion, time: f32) {
        motion.reading = motion.angle;
        if self.reads {
            let parts = self.parts.iter().zip(self.model.occupied());
            for ((part, slot), memory) in parts.zip(&mut motion.memory) {
                motion.reading = show(part, slot, motion.reading, time, memory);
            }
        }
    }

    /// One step, which ends under this pressure (Pa).
    #[inline]
    pub fn step(&self, motion: &mut Motion, pressure: f32, time: f32) {
        if self.glides || self.acts_before || self.acts_after {
            self.step_parts(motion, pressure, time);
        } else {
            motion.angle += motion.way;
            motion.kick = self.leapfrog.push(pressure) - self.spring.pull(motion.angle);
            motion.way = self.leapfrog.kept(motion.way) + motion.kick;
        }
    }

    #[inline(never)]
    fn step_parts(&self, motion: &mut Motion, pressure: f32, time: f32) {
        let way = motion.way;
        let mut kept = self.leapfrog.kept(way);
        let mut rubbed = 0.0;
        motion.moved = way;
        motion.chamber = pressure;
        motion.time = time;
        if self.glides {
            let [of_way, of_rate] = self.glide.losses(way);
            motion.moved = way - of_way;
            rubbed = of_rate;
        }
        if self.acts_before {
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
        motion.angle += motion.moved;
        self.kick(motion);
        if self.glides {
            kept -= rubbed;
        }
        motion.way = kept + motion.kick;
    }

    /// Carries the memories along the way, and finds what the forces add to the next one.
    #[inline(always)]
    fn kick(&self, motion: &mut Motion) {
        motion.pull = self.spring.pull(motion.angle);
        let mut kick = self.leapfrog.push(motion.chamber);
        if self.acts_after {
            for index in 0..self.count {
                let force = self.force(motion, index);
                if force != 0.0 {
                    kick -= force;
                }
            }
        }
        motion.kick = kick - motion.pull;
    }

    /// What a part does before the drift: it maps the pressure, or returns the share of
    /// the rate that is lost.
    #[inline(never)]
    fn prelude(&self, motion: &mut Motion, index: u8) -> f32 {
        let index = usize::from(index);
        let (Some(part), Some(memory)) = (self.parts.get(index), motion.memory.get_mut(index))
        else {
            return 0.0;
        };
        match part {
            Part::Damping {
                per_angle,
                decay,
                back,
                share,
                undamped,
            } => {
                // In the middle of the way.
                let twice = motion.angle + motion.angle + motion.moved;
                let mut more = twice.abs() * per_angle;
                if per_angle.is_sign_negative() {
                    more = Real::max(more, -*decay);
                }
                if motion.moved.is_sign_negative() && back.to_bits() != 1.0_f32.to_bits() {
                    more = (more + decay) * back - decay;
                }
                let lost = decayed(more);
                if more.abs().to_bits() < MODERATE {
                    motion.moved -= motion.moved * (lost * share);
                } else {
                    motion.moved *= decays(decay + more)[0] * undamped;
                }
                return lost;
            }
            // The flow ẋ = −c·x − (d/M)·x·|x|/A in closed form: what is left is
            // B·x/(1 + u), and the way x·ln(1 + u)/u, with u = (d/M)·|x|.
            Part::Drag { per_way } => {
                let more = motion.moved.abs() * per_way;
                let lost = more / (1.0 + more);
                motion.moved -= motion.moved
                    * if more.to_bits() < SMALL {
                        lost * 0.5
                    } else {
                        1.0 - ln(1.0 + more) / more
                    };
                return lost;
            }
            Part::Tube(lag) => motion.chamber = follow(*lag, memory, motion.chamber),
            Part::Leak(lag) => motion.chamber -= follow(*lag, memory, motion.chamber),
            Part::Vent { fill, vent } => {
                let [here, before] = *memory;
                let falls = before + motion.chamber < here + here;
                motion.chamber = follow(if falls { *vent } else { *fill }, memory, motion.chamber);
            }
            Part::Input => {
                if let Some(slot) = self.model.slot(index) {
                    motion.chamber = slot.input(motion.chamber, memory, &mut [0.0; 2]);
                    // A play is where it was pushed to; what has no memory has no use
                    // for it.
                    memory[0] = motion.chamber;
                }
            }
            _ => {}
        }
        0.0
    }

    /// The force of a part (rad of way), its memory carried along the drift; or it changes
    /// the pull of the spring.
    #[inline(never)]
    fn force(&self, motion: &mut Motion, index: u8) -> f32 {
        let index = usize::from(index);
        let (Some(part), Some(memory)) = (self.parts.get(index), motion.memory.get_mut(index))
        else {
            return 0.0;
        };
        match part {
            Part::Relaxing(branch) => {
                branch.carry(&mut memory[0], motion.moved);
                memory[0]
            }
            Part::Loop {
                force,
                per_yield,
                onwards,
                back,
            } => {
                let way = motion.moved * per_yield;
                memory[0] = wound(memory[0], way, *onwards, *back);
                *force * memory[0]
            }
            Part::Turning { force, angle } => {
                memory[0] += angle;
                if memory[0] > PI {
                    memory[0] -= TAU;
                }
                *force * sin_near(memory[0])
            }
            Part::Gravity {
                weight,
                tilt,
                at_zero,
            } => *weight * sin_near(motion.angle + tilt) - at_zero,
            Part::Mode { step, per_way } => {
                let [z, u] = *memory;
                *memory = [
                    step[0][0] * z + step[0][1] * u + per_way[0] * motion.moved,
                    step[1][0] * z + step[1][1] * u + per_way[1] * motion.moved,
                ];
                0.0
            }
            Part::Softening { loss, per_angle } => {
                let size = motion.angle.abs();
                // Neither is negative.
                if size.to_bits() > memory[0].to_bits() {
                    let more = (size - memory[0]) * per_angle;
                    *memory = [size, memory[1] - memory[1] * decayed(more)];
                }
                motion.pull -= motion.pull * (*loss - *loss * memory[1]);
                0.0
            }
            Part::AtRest(force) => *force,
            Part::Factor | Part::Force | Part::Table(_) => self.as_it_says(part, motion, index),
            _ => 0.0,
        }
    }

    /// A part that is asked of the effect itself.
    #[inline(never)]
    fn as_it_says(&self, part: &Part, motion: &mut Motion, index: usize) -> f32 {
        let at = Instant {
            time: motion.time,
            angle: motion.angle,
            rate: 0.0,
            pressure: motion.chamber,
        };
        let force = match (part, self.model.slot(index), self.model.table()) {
            (Part::Table(of), _, Some(table)) => table.at(of.at(&at)),
            (Part::Force, Some(slot), _) => slot.force(&at, &[0.0; 2], &mut [0.0; 2]),
            (Part::Factor, Some(slot), _) => {
                let mut unit = UNIT;
                slot.modulate(&at, &[0.0; 2], &mut unit);
                motion.pull *= unit.stiffness;
                return 0.0;
            }
            _ => return 0.0,
        };
        force * self.leapfrog.per_newton()
    }

    /// The rate (rad/s) at the end of a step.
    pub fn rate(&self, motion: &Motion) -> f32 {
        self.leapfrog.rate_under(motion.way, motion.kick)
    }
}

/// A base equation of ones, to see what an effect multiplies.
const UNIT: Dynamics<f32> = Dynamics {
    inertia: 1.0,
    damping: 1.0,
    stiffness: 1.0,
    exponent: 1.0,
    input_gain: 1.0,
};

/// Prepares what an effect does.
#[inline(never)]
fn part_of(
    model: &Model<f32, Minimax>,
    slot: &Slot<f32>,
    leapfrog: &Leapfrog<f32>,
    dt: f32,
    interval: f32,
) -> Part {
    let per_newton = leapfrog.per_newton();
    if is_of_rate(model, slot) {
        return match model.table() {
            Some(table) if matches!(slot, Effect::Table(_)) && table.at(0.0) != 0.0 => {
                Part::AtRest(table.at(0.0) * per_newton)
            }
            _ => Part::None,
        };
    }
    match slot {
        Effect::PneumaticLag(effect) => Part::Tube(Lag::new(effect.time_constant, dt)),
        Effect::Leak(effect) => Part::Leak(Lag::new(effect.time_constant, dt)),
        Effect::VentAsymmetry(effect) => Part::Vent {
            fill: Lag::new(effect.fill, dt),
            vent: Lag::new(effect.vent, dt),
        },
        Effect::InputBacklash(_) | Effect::PressureThreshold(_) => Part::Input,
        Effect::StiffnessDrift(_) | Effect::PressureStiffening(_) => Part::Factor,
        Effect::MullinsSoftening(effect) => Part::Softening {
            loss: effect.loss,
            per_angle: 1.0 / effect.angle,
        },
        Effect::AngleDependentDamping(effect) => {
            let mut back = 1.0;
            for slot in model.occupied() {
                if let Effect::AsymmetricDamping(effect) = slot {
                    back *= 1.0 + effect.ratio;
                }
            }
            let decay = model.dynamics().damping * dt / model.dynamics().inertia;
            let [come, mean] = decays(decay);
            Part::Damping {
                per_angle: 0.5 * effect.slope * decay,
                decay,
                back,
                share: 1.0 - mean / come,
                undamped: 1.0 / come,
            }
        }
        Effect::QuadraticDamping(effect) => Part::Drag {
            per_way: effect.drag / model.dynamics().inertia,
        },
        Effect::Gravity(effect) => {
            let weight = effect.weight * per_newton;
            Part::Gravity {
                weight,
                tilt: effect.tilt,
                at_zero: weight * sin_near(effect.tilt),
            }
        }
        Effect::MaxwellBranch(effect) => Part::Relaxing(Branch::new(
            effect.stiffness * per_newton,
            effect.time_constant,
            dt,
        )),
        Effect::BoucWenHysteresis(effect) => Part::Loop {
            force: effect.force * per_newton,
            per_yield: 1.0 / effect.yield_angle,
            onwards: 0.5 + effect.shape,
            back: 0.5 - effect.shape,
        },
        Effect::PeriodicDisturbance(effect) => Part::Turning {
            force: effect.force * per_newton,
            angle: TAU * effect.frequency * dt,
        },
        Effect::SecondMode(effect) => mode(effect, dt),
        Effect::CubicStiffness(_) | Effect::LinearStiffness(_) | Effect::EndStop(_) => Part::Force,
        Effect::Table(_) => table_of(model).map_or(Part::None, Part::Table),
        Effect::SensorOffset(_) | Effect::SensorNonlinearity(_) | Effect::SensorDrift(_) => {
            Part::Sensor
        }
        Effect::SensorLag(effect) => Part::SlowSensor(Lag::new(effect.time_constant, interval)),
        // In the exponent, in the memory of pressures, in the glide or beside another
        // damping.
        Effect::ExponentShift(_)
        | Effect::DeadTime(_)
        | Effect::CoulombFriction(_)
        | Effect::StribeckFriction(_)
        | Effect::AsymmetricDamping(_) => Part::None,
        // Refused by the plan.
        #[cfg(feature = "formula")]
        Effect::Custom(_) => Part::None,
    }
}

/// What the sensor of a part makes of a reading (rad), a period later.
fn show(part: &Part, slot: &Slot<f32>, reading: f32, time: f32, memory: &mut Hidden<f32>) -> f32 {
    match part {
        Part::Sensor => slot.sensor(reading, time, memory, &mut [0.0; 2]),
        Part::SlowSensor(lag) => follow(*lag, memory, reading),
        Part::Mode { .. } => reading + memory[0],
        _ => reading,
    }
}

/// Carries a lag to what it follows now; its memory holds it and what it followed before.
fn follow(lag: Lag<f32>, memory: &mut Hidden<f32>, now: f32) -> f32 {
    let [mut y, before] = *memory;
    lag.carry(&mut y, before, now);
    *memory = [y, now];
    y
}

/// Up to where two terms of the series of an exponential do. A comparison of bits costs
/// a tenth of one of floats.
const SMALL: u32 = (1.0_f32 / 32.0).to_bits();

/// Up to where three do.
const MODERATE: u32 = 0.25_f32.to_bits();

/// 1 − e^(−u): by its series, within 7·10⁻⁴ of itself, or the exponential.
fn decayed(u: f32) -> f32 {
    let size = u.abs().to_bits();
    if size < SMALL {
        u * (1.0 - u * 0.5)
    } else if size < MODERATE {
        u * (1.0 - u * (0.5 - u * (1.0 / 6.0)))
    } else {
        1.0 - exp(-u)
    }
}

/// A Bouc–Wen loop after a way of `sigma` yield angles.
#[inline]
fn wound(w: f32, sigma: f32, onwards: f32, back: f32) -> f32 {
    let against = w.is_sign_negative() != sigma.is_sign_negative();
    let end = loaded(w, sigma, if against { back } else { onwards });
    if against && w.is_sign_negative() != end.is_sign_negative() {
        // What is left of the way beyond zero, along a straight line.
        return loaded(0.0, sigma * (end / (end - w)), onwards);
    }
    end
}

/// w after dw = (1 − c·w·sign σ)·dσ: w + (σ − z·w)·(1 − e^(−z))/z with z = c·|σ|. By its series
/// within 7·10⁻⁴ up to ¼, beyond by a rational approximation of the exponential that is
/// stable for any z (Padé 1/2).
fn loaded(w: f32, sigma: f32, c: f32) -> f32 {
    let z = Real::max(c * sigma.abs(), -1.0);
    let share = if z.abs().to_bits() < MODERATE {
        1.0 - z * (0.5 - z * (1.0 / 6.0))
    } else {
        (6.0 + z) / (6.0 + z * (4.0 + z))
    };
    w + (sigma - z * w) * share
}

/// A second mode over one step: z̈ = −b·ω̇ − ω₂(2ζż + ω₂z) with the rate of the actuator
/// constant in it. The state is z and (ż + b·ω)/ω₂.
#[inline(never)]
fn mode(effect: &SecondMode<f32>, dt: f32) -> Part {
    let turn = TAU * effect.frequency * dt;
    let damping = 2.0 * effect.damping_ratio;
    // e^(turn·[[0, 1], [−1, −2ζ]]): halved until its series converges fast, then squared.
    let mut size = turn * (1.0 + damping);
    let mut halvings = 0;
    let mut part = turn;
    while size > 0.25 {
        size *= 0.5;
        part *= 0.5;
        halvings += 1;
    }
    let generator = [[0.0, part], [-part, -damping * part]];
    let mut step = [[1.0, 0.0], [0.0, 1.0]];
    for order in (1..=5_u8).rev() {
        let mut next = product(&generator, &step);
        let share = 1.0 / f32::from(order);
        for entry in next.as_flattened_mut() {
            *entry *= share;
        }
        next[0][0] += 1.0;
        next[1][1] += 1.0;
        step = next;
    }
    for _ in 0..halvings {
        step = product(&step, &step);
    }
    // A rate ω adds −b·ω to ż and 2ζ·b·ω to the other: over a step F⁻¹(Φ − 1) of that.
    let drive = [-effect.coupling, damping * effect.coupling];
    let [[a, b], [c, d]] = step;
    let over = (a - 1.0) * drive[0] + b * drive[1];
    let under = c * drive[0] + (d - 1.0) * drive[1];
    Part::Mode {
        step,
        per_way: [(-damping * over - under) / turn, over / turn],
    }
}

#[inline(never)]
fn product(a: &[[f32; 2]; 2], b: &[[f32; 2]; 2]) -> [[f32; 2]; 2] {
    let mut product = [[0.0; 2]; 2];
    for (row, [left, right]) in product.iter_mut().zip(a) {
        for (entry, (over, under)) in row.iter_mut().zip(b[0].iter().zip(&b[1])) {
            *entry = left * over + right * under;
        }
    }
    product
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::actuator::State;
    use crate::input::Input;
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
            worst = worst.max((f64::from(motion.reading) - model.reading(&state)).abs());
        }
        assert!(state.angle.abs() > 0.1, "it moves");
        Ok(worst.to_degrees())
    }

    /// Values at which each effect is plain to see.
    fn strong(kind: Kind) -> Option<Effect<f32>> {
        let values: &[f32] = match kind {
            Kind::PneumaticLag => &[0.06],
            Kind::Leak => &[6.0],
            Kind::VentAsymmetry => &[0.05, 0.3],
            Kind::InputBacklash => &[6_000.0],
            Kind::PressureThreshold => &[9_000.0],
            Kind::StiffnessDrift => &[0.05],
            Kind::PressureStiffening => &[4e-6],
            Kind::MullinsSoftening => &[0.4, 0.5],
            Kind::AngleDependentDamping => &[1.2],
            Kind::AsymmetricDamping => &[1.5],
            Kind::QuadraticDamping => &[0.08],
            Kind::CoulombFriction => &[0.15, 0.02],
            Kind::StribeckFriction => &[0.08, 0.08, 0.1],
            Kind::Gravity => &[0.3, 0.4],
            Kind::CubicStiffness => &[0.2],
            Kind::LinearStiffness => &[0.3],
            Kind::EndStop => &[4.0, 1.1],
            Kind::MaxwellBranch => &[0.5, 0.4],
            Kind::BoucWenHysteresis => &[0.2, 0.05, 0.5],
            Kind::PeriodicDisturbance => &[0.1, 0.8, 0.3],
            Kind::SecondMode => &[3.0, 0.1, 0.15],
            Kind::ExponentShift => &[-0.5],
            Kind::SensorOffset => &[0.1],
            Kind::SensorNonlinearity => &[-0.1],
            Kind::SensorDrift => &[0.01],
            Kind::SensorLag => &[0.09],
            _ => return None,
        };
        kind.build(values)
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

    /// Each effect of the catalogue, in the board's arithmetic and at its steps, beside
    /// the physics in `f64`.
    #[test]
    fn every_effect_is_stepped_as_the_physics_says() {
        // Beside dry friction and a play, a tenth of a degree; where no corner is in
        // the way, what the base equation is within.
        let bound = |kind| match kind {
            Kind::StribeckFriction => 0.12,
            Kind::CoulombFriction | Kind::InputBacklash | Kind::Table => 0.05,
            _ => 0.02,
        };
        assert!(gap_deg(&[]) < 0.01);
        for &kind in Kind::NAMES {
            let Some(effect) = strong(kind) else {
                assert_eq!(kind, Kind::DeadTime, "tested with the memory of pressures");
                continue;
            };
            let gap = gap_deg(&[effect]);
            println!("{}: {gap:.4}°", kind.name());
            assert!(gap < bound(kind), "{}: {gap}°", kind.name());
        }
        for table in tables() {
            let gap = gap_deg(&[table]);
            println!("{}: {gap:.4}°", table.parameters().len());
            assert!(gap < bound(Kind::Table), "{table:?}: {gap}°");
        }
    }

    #[test]
    fn no_effect_is_dearer_than_the_dearest() {
        let dearest = DEAREST.map(cycles);
        for &kind in Kind::ALL {
            assert!(dearest.iter().all(|&most| most >= cycles(kind)), "{kind:?}");
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
            let has_corner = matches!(
                kind,
                Kind::InputBacklash
                    | Kind::CoulombFriction
                    | Kind::StribeckFriction
                    | Kind::EndStop
                    | Kind::PressureThreshold
                    | Kind::BoucWenHysteresis
                    | Kind::MullinsSoftening
                    | Kind::VentAsymmetry
            );
            if has_corner {
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
                f64::from(motion.angle)
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
