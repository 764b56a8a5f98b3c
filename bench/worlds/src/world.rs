//! A world: a base model with what is missing in it, moved by an integrator of
//! the benchmark's own (RK4 at 2 kHz), and what acts on it from outside.
//!
//! M θ̈ + C θ̇ + K sign(θ)|θ|ⁿ + Q = g p_c; the symbols and what the effects do are
//! in [`law`](super::law). Where nothing is asked for, a world starts at rest, is
//! driven by a pressure alone and is shown 100 times a second.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::law::{EFFECTS, Effect, Law, MEMORY, Moment, STATES};

/// Integration steps per second of the truth.
pub const RATE_HZ: u32 = 2000;

/// Samples per second of a recording.
pub const SAMPLES_HZ: u32 = 100;

/// Angle, rate, and the states of the effects.
const ALL_STATES: usize = 2 + EFFECTS * STATES;

type States = [f64; ALL_STATES];
type Memory = [[f64; MEMORY]; EFFECTS];

/// Points of a coloured force per second. Its correlation time is 0.3 s or more.
const COLOURED_HZ: f64 = 200.0;

/// The base parameters.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Base {
    /// M (kg·m).
    pub inertia: f64,
    /// C (N·s/rad).
    pub damping: f64,
    /// K (N/radⁿ).
    pub stiffness: f64,
    /// n.
    pub exponent: f64,
    /// g (N/Pa).
    pub input_gain: f64,
}

impl Base {
    /// Pressure (Pa) that holds an angle (rad).
    pub fn holding_pressure(&self, angle: f64) -> f64 {
        self.stiffness * power(angle, self.exponent) / self.input_gain
    }
}

/// sign(θ)|θ|ⁿ.
pub(super) fn power(angle: f64, exponent: f64) -> f64 {
    angle.abs().powf(exponent).copysign(angle)
}

/// Pressure in the line over time, on an even grid, as a smooth curve through
/// its samples (Catmull–Rom), held beyond both ends.
#[derive(Clone, Debug)]
pub struct Line {
    interval: f64,
    values: Vec<f64>,
}

impl Line {
    /// A curve through values (Pa) that are `interval` seconds apart.
    pub fn new(interval: f64, values: Vec<f64>) -> Self {
        Self { interval, values }
    }

    /// Pressure (Pa) at a time (s).
    pub fn at(&self, time: f64) -> f64 {
        let position = time / self.interval;
        let last = self.values.len() - 1;
        if position <= 0.0 {
            return self.values[0];
        }
        // Not negative and below the number of samples.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let k = position.floor() as usize;
        if k >= last {
            return self.values[last];
        }
        let u = position - k as f64;
        let (a, b) = (self.values[k], self.values[k + 1]);
        let before = self.values[k.saturating_sub(1)];
        let after = self.values[(k + 2).min(last)];
        let (left, right) = (0.5 * (b - before), 0.5 * (after - a));
        let rise = b - a;
        a + u * (left + u * (3.0 * rise - 2.0 * left - right + u * (left + right - 2.0 * rise)))
    }

    /// Duration (s).
    pub fn duration(&self) -> f64 {
        (self.values.len() - 1) as f64 * self.interval
    }
}

/// What acts on a world from outside, and where it starts.
#[derive(Clone, Copy, Debug)]
pub struct Outside<'a> {
    /// Pressure in the line.
    pub line: &'a Line,
    /// What is added to it (Pa).
    pub shift: f64,
    /// A force (N) that pushes the angle up.
    pub force: Option<&'a Line>,
    /// Angle (rad) and rate (rad/s) at time 0.
    pub start: [f64; 2],
    /// Number of the run, for what is another one in every run.
    pub run: u32,
}

impl<'a> Outside<'a> {
    /// A line, and nothing else.
    pub fn at_rest(line: &'a Line) -> Self {
        Self {
            line,
            shift: 0.0,
            force: None,
            start: [0.0; 2],
            run: 0,
        }
    }
}

/// When a world is looked at.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    /// Time between two samples (s).
    pub interval: f64,
    /// Integration steps of a sample.
    pub steps: u32,
    /// Of so many samples one is shown.
    pub every: u32,
}

impl Grid {
    /// So many integration steps a second, of which every `every`-th is shown.
    pub fn of_steps(rate_hz: u32, every: u32) -> Self {
        Self {
            interval: 1.0 / f64::from(rate_hz),
            steps: 1,
            every,
        }
    }
}

/// A base model with what is missing in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct World {
    /// The base parameters.
    pub base: Base,
    /// At most two effects.
    pub effects: Vec<Effect>,
}

fn own(slot: usize) -> std::ops::Range<usize> {
    2 + slot * STATES..2 + (slot + 1) * STATES
}

/// What one evaluation of the equations gives beside the rates.
struct Evaluated {
    reading: f64,
    /// Pressure before each effect, for what remembers it.
    pressures: [f64; EFFECTS],
}

impl World {
    /// A base model that nothing is missing in.
    pub const fn of(base: Base) -> Self {
        Self {
            base,
            effects: Vec::new(),
        }
    }

    /// Number of states that move; those beyond are neither read nor written.
    fn used(&self) -> usize {
        2 + self.effects.len() * STATES
    }

    /// Evaluates the equations at a time (s), with this pressure (Pa) in the line. The rates of
    /// the states that move are written into `rates`.
    fn evaluate(
        &self,
        outside: &Outside<'_>,
        (time, pressure): (f64, f64),
        states: &States,
        memory: &Memory,
        rates: &mut States,
    ) -> Evaluated {
        rates[..self.used()].fill(0.0);
        let mut pressures = [0.0; EFFECTS];
        let mut at = Moment {
            time,
            angle: states[0],
            rate: states[1],
            pressure,
            run: outside.run,
        };
        for (slot, effect) in self.effects.iter().enumerate() {
            pressures[slot] = at.pressure;
            let (x, dx) = (&states[own(slot)], &mut rates[own(slot)]);
            at.pressure = effect.input(outside.line, at, x, &memory[slot], dx);
        }
        let mut base = self.base;
        for (slot, effect) in self.effects.iter().enumerate() {
            effect.modulate(at, &states[own(slot)], &memory[slot], &mut base);
        }
        let mut force = base.input_gain * at.pressure
            - base.damping * at.rate
            - base.stiffness * power(at.angle, base.exponent)
            + outside.force.map_or(0.0, |line| line.at(time));
        for (slot, effect) in self.effects.iter().enumerate() {
            let (x, dx) = (&states[own(slot)], &mut rates[own(slot)]);
            force -= effect.force(at, base.inertia, x, &memory[slot], dx);
        }
        let acceleration = force / base.inertia;
        rates[0] = at.rate;
        rates[1] = acceleration;
        let mut reading = at.angle;
        for (slot, effect) in self.effects.iter().enumerate() {
            let (x, dx) = (&states[own(slot)], &mut rates[own(slot)]);
            reading = effect.sensor(at, acceleration, reading, x, dx);
        }
        Evaluated { reading, pressures }
    }

    /// What a perfect sensor would show (rad), [`SAMPLES_HZ`] times a second, from
    /// rest, with `steps` integration steps a sample. `run` numbers the runs of a
    /// case, for what differs between them.
    ///
    /// A run that leaves all bounds ends in NaN.
    pub fn simulate(&self, line: &Line, run: u32, steps: u32) -> Vec<f64> {
        let outside = Outside {
            run,
            ..Outside::at_rest(line)
        };
        let grid = Grid {
            steps,
            ..Grid::of_steps(SAMPLES_HZ, 1)
        };
        self.show(&outside, grid)
    }

    /// What a perfect sensor would show (rad) over the whole line, on a grid (RK4).
    ///
    /// A world that leaves all bounds ends in NaN.
    pub fn show(&self, outside: &Outside<'_>, grid: Grid) -> Vec<f64> {
        let Grid {
            interval,
            steps,
            every,
        } = grid;
        let h = interval / f64::from(steps);
        // Some hundred thousand samples.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let last = (outside.line.duration() / interval).round() as u32;
        let mut states = [0.0; ALL_STATES];
        states[..2].copy_from_slice(&outside.start);
        let mut memory = [[0.0; MEMORY]; EFFECTS];
        let shown = (last / every + 1) as usize;
        let mut reading = Vec::with_capacity(shown);
        for sample in 0..=last {
            let start = f64::from(sample) * interval;
            for step in 0..steps {
                let time = start + f64::from(step) * h;
                let first = self.step(outside, time, h, &mut states, &mut memory);
                if step == 0 && sample.is_multiple_of(every) {
                    reading.push(first);
                }
            }
            if states[0].is_nan() || states[0].abs() > 50.0 {
                reading.resize(shown, f64::NAN);
                break;
            }
        }
        reading
    }

    /// Goes one step (RK4); the reading at its begin.
    fn step(
        &self,
        outside: &Outside<'_>,
        time: f64,
        h: f64,
        states: &mut States,
        memory: &mut Memory,
    ) -> f64 {
        let used = self.used();
        let at = |time: f64| (time, outside.line.at(time) + outside.shift);
        let middle = at(time + 0.5 * h);
        let [mut k1, mut k2, mut k3, mut k4] = [[0.0; ALL_STATES]; 4];
        let mut moved = [0.0; ALL_STATES];
        let go = |moved: &mut States, by: f64, rates: &States, from: &States| {
            for k in 0..used {
                moved[k] = from[k] + by * rates[k];
            }
        };
        let first = self.evaluate(outside, at(time), states, memory, &mut k1);
        go(&mut moved, 0.5 * h, &k1, states);
        self.evaluate(outside, middle, &moved, memory, &mut k2);
        go(&mut moved, 0.5 * h, &k2, states);
        self.evaluate(outside, middle, &moved, memory, &mut k3);
        go(&mut moved, h, &k3, states);
        let end = self.evaluate(outside, at(time + h), &moved, memory, &mut k4);
        for k in 0..used {
            states[k] += h / 6.0 * (k1[k] + 2.0 * (k2[k] + k3[k]) + k4[k]);
        }
        for (slot, effect) in self.effects.iter().enumerate() {
            let at = Moment {
                time: time + h,
                angle: states[0],
                rate: states[1],
                pressure: end.pressures[slot],
                run: outside.run,
            };
            effect.remember(at, &states[own(slot)], &mut memory[slot]);
        }
        first.reading
    }

    /// With transitions of friction wide enough for the step of 1/[`RATE_HZ`] s:
    /// close to rest a smooth sign function is a damper of T/ω_s.
    pub fn resolved(mut self) -> Self {
        let stiffest = self.base.inertia * f64::from(RATE_HZ);
        for effect in &mut self.effects {
            let values = &mut effect.values;
            match effect.law {
                Law::CoulombTanh | Law::CoulombRoot => {
                    values[1] = values[1].max(values[0] / stiffest);
                }
                Law::StribeckGauss | Law::StribeckExponential => {
                    values[3] = values[3].max((values[0] + values[1]) / stiffest);
                }
                _ => {}
            }
        }
        self
    }
}

/// A force without any rule: an Ornstein–Uhlenbeck process of this standard
/// deviation (N) and correlation time (s), sampled exactly.
pub fn coloured(deviation: f64, time: f64, seconds: f64, seed: u64) -> Line {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
    let kept = (-1.0 / (COLOURED_HZ * time)).exp();
    let fresh = (1.0 - kept * kept).sqrt();
    let mut value = normal();
    // Some ten thousand points.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let points = (seconds * COLOURED_HZ).ceil() as usize + 2;
    let values = (0..points)
        .map(|_| {
            let now = value;
            value = kept * value + fresh * normal();
            deviation * now
        })
        .collect();
    Line::new(1.0 / COLOURED_HZ, values)
}
