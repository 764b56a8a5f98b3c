//! The physics of a bench: the formulas of [`truth`](super::super::truth), some
//! that only benches have, a force from outside, and a start that need not be
//! at rest.
//!
//! | law | equation | numbers |
//! |---|---|---|
//! | Bouc–Wen with a shape | Q = a w, D ẇ = ω − ½\|ω\|w − B ω\|w\| | a, D, B |
//! | dwell-time stiction | a bristle holds up to F_s = F_c + ΔF (1 − e^{−t/τ}) after a rest of t; once it slips, F_c | F_c, ΔF, τ, s |
//! | pulsating stiffness | K → K (1 + a sin(2πft + φ)) | a, f, φ |
//! | random force | Ornstein–Uhlenbeck: its path is drawn, see [`coloured`] | sd, τ |
//!
//! Bouc–Wen: Wen 1976, with β = ½ and γ = B. Stiction that grows with the time
//! at rest: Armstrong-Hélouvry et al. 1994, section 2.2.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;
use serde::{Deserialize, Serialize};

use super::super::truth::{
    Base, EFFECTS as PARTS, Effect, Formula, Line, MEMORY, Moment, RATE_HZ, STATES, Truth, VALUES,
    power,
};

/// Angle, rate, and the states of the parts.
const ALL_STATES: usize = 2 + PARTS * STATES;

type States = [f64; ALL_STATES];
type Memory = [[f64; MEMORY]; PARTS];

/// Below this rate (rad/s) a sliding contact comes to rest.
const RESTS_BELOW: f64 = 0.02;

/// Points of a coloured force per second. Its correlation time is 0.3 s or more.
const COLOURED_HZ: f64 = 200.0;

/// What a case of this set can hide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Law {
    /// A formula that the other sets have as well.
    Known(Formula),
    /// Bouc–Wen's hysteresis with a coefficient of shape.
    BoucWenShape,
    /// Outside the catalogue: stiction that grows with the time at rest.
    DwellStiction,
    /// Outside the catalogue: a stiffness that pulsates.
    PulsatingStiffness,
    /// Outside the catalogue: a large coloured force.
    RandomForce,
}

impl Law {
    /// Name in answers.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Known(formula) => formula.row().name,
            Self::BoucWenShape => "bouc_wen_shape",
            Self::DwellStiction => "dwell_stiction",
            Self::PulsatingStiffness => "pulsating_stiffness",
            Self::RandomForce => "random_force",
        }
    }

    /// The kind of the catalogue that it is a case of; none if it is outside.
    pub const fn kind(self) -> Option<&'static str> {
        match self {
            Self::Known(formula) => formula.row().kind,
            Self::BoucWenShape => Some("bouc_wen_hysteresis"),
            _ => None,
        }
    }

    /// How many numbers it has.
    pub const fn numbers(self) -> usize {
        match self {
            Self::Known(formula) => formula.row().quantities.len(),
            Self::BoucWenShape | Self::PulsatingStiffness => 3,
            Self::DwellStiction => 4,
            Self::RandomForce => 2,
        }
    }
}

/// A law with its numbers in SI units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// The law.
    pub law: Law,
    /// Its numbers; unused ones are zero.
    pub values: [f64; VALUES],
}

impl Part {
    /// The part made larger by a factor.
    pub fn scaled(mut self, factor: f64) -> Self {
        match self.law {
            Law::Known(formula) => {
                let values = self.values;
                self.values = Effect { formula, values }.scaled(factor).values;
            }
            Law::DwellStiction => {
                self.values[0] *= factor;
                self.values[1] *= factor;
            }
            _ => self.values[0] *= factor,
        }
        self
    }

    fn known(&self) -> Option<Effect> {
        match self.law {
            Law::Known(formula) => Some(Effect {
                formula,
                values: self.values,
            }),
            _ => None,
        }
    }

    fn modulate(&self, at: Moment, states: &[f64], memory: &[f64; MEMORY], base: &mut Base) {
        if let Some(effect) = self.known() {
            effect.modulate(at, states, memory, base);
        } else if self.law == Law::PulsatingStiffness {
            let [ratio, frequency, phase, _] = self.values;
            base.stiffness *=
                1.0 + ratio * (std::f64::consts::TAU * frequency * at.time + phase).sin();
        }
    }

    /// Q (N).
    fn force(
        &self,
        at: Moment,
        inertia: f64,
        states: &[f64],
        memory: &[f64; MEMORY],
        rates: &mut [f64],
    ) -> f64 {
        if let Some(effect) = self.known() {
            return effect.force(at, inertia, states, memory, rates);
        }
        let [a, b, c, d] = self.values;
        let (rate, state) = (at.rate, states[0]);
        match self.law {
            Law::BoucWenShape => {
                rates[0] = (rate - 0.5 * rate.abs() * state - c * rate * state.abs()) / b;
                a * state
            }
            Law::DwellStiction => {
                let stiffness = (a + b) / d;
                rates[0] = if Contact::of(memory).slides {
                    rate - rate.abs() * stiffness * state / a
                } else {
                    rate
                };
                stiffness * state + 0.3 * (stiffness * inertia).sqrt() * rates[0]
            }
            _ => 0.0,
        }
    }

    /// Brings what is remembered up to the end of a step.
    fn remember(&self, at: Moment, states: &[f64], memory: &mut [f64; MEMORY]) {
        if let Some(effect) = self.known() {
            effect.remember(at, memory);
        } else if self.law == Law::DwellStiction {
            let [sliding, extra, time, presliding] = self.values;
            let contact = Contact::of(memory);
            let rested = at.time - contact.since;
            let held = (sliding + extra) / presliding * states[0].abs();
            let next = if contact.slides {
                // A bristle that is bent further than sliding bends it still slips.
                Contact {
                    slides: at.rate.abs() > RESTS_BELOW || held > sliding,
                    since: at.time,
                }
            } else {
                Contact {
                    slides: held > break_away(sliding, extra, time, rested),
                    ..contact
                }
            };
            memory[0] = f64::from(u8::from(next.slides));
            memory[1] = next.since;
        }
    }
}

/// Force (N) up to which a contact holds after a rest (s).
pub fn break_away(sliding: f64, extra: f64, time: f64, rested: f64) -> f64 {
    sliding + extra * (1.0 - (-rested / time).exp())
}

/// The state of a contact with dwell-time stiction.
#[derive(Clone, Copy)]
struct Contact {
    slides: bool,
    /// Since when it rests (s).
    since: f64,
}

impl Contact {
    fn of(memory: &[f64; MEMORY]) -> Self {
        Self {
            slides: memory[0] > 0.5,
            since: memory[1],
        }
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

/// A base model with what is missing in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct World {
    /// The base parameters.
    pub base: Base,
    /// At most two parts.
    pub parts: Vec<Part>,
}

impl From<&Truth> for World {
    fn from(truth: &Truth) -> Self {
        let part = |effect: &Effect| Part {
            law: Law::Known(effect.formula),
            values: effect.values,
        };
        Self {
            base: truth.base,
            parts: truth.effects.iter().map(part).collect(),
        }
    }
}

fn own(slot: usize) -> std::ops::Range<usize> {
    2 + slot * STATES..2 + (slot + 1) * STATES
}

/// What one evaluation of the equations gives.
struct Evaluated {
    rates: States,
    reading: f64,
    /// Pressure before each part, for what remembers it.
    pressures: [f64; PARTS],
}

impl World {
    fn evaluate(
        &self,
        outside: &Outside<'_>,
        time: f64,
        states: &States,
        memory: &Memory,
    ) -> Evaluated {
        let mut rates = [0.0; ALL_STATES];
        let mut pressures = [0.0; PARTS];
        let mut at = Moment {
            time,
            angle: states[0],
            rate: states[1],
            pressure: outside.line.at(time) + outside.shift,
            run: outside.run,
        };
        for (slot, part) in self.parts.iter().enumerate() {
            pressures[slot] = at.pressure;
            if let Some(effect) = part.known() {
                let (x, dx) = (&states[own(slot)], &mut rates[own(slot)]);
                at.pressure = effect.input(outside.line, at, x, &memory[slot], dx);
            }
        }
        let mut base = self.base;
        for (slot, part) in self.parts.iter().enumerate() {
            part.modulate(at, &states[own(slot)], &memory[slot], &mut base);
        }
        let mut force = base.input_gain * at.pressure
            - base.damping * at.rate
            - base.stiffness * power(at.angle, base.exponent)
            + outside.force.map_or(0.0, |line| line.at(time));
        for (slot, part) in self.parts.iter().enumerate() {
            let (x, dx) = (&states[own(slot)], &mut rates[own(slot)]);
            force -= part.force(at, base.inertia, x, &memory[slot], dx);
        }
        let acceleration = force / base.inertia;
        rates[0] = at.rate;
        rates[1] = acceleration;
        let mut reading = at.angle;
        for (slot, part) in self.parts.iter().enumerate() {
            if let Some(effect) = part.known() {
                let (x, dx) = (&states[own(slot)], &mut rates[own(slot)]);
                reading = effect.sensor(at, acceleration, reading, x, dx);
            }
        }
        Evaluated {
            rates,
            reading,
            pressures,
        }
    }

    /// What a perfect sensor would show (rad) over the whole line, with `rate_hz`
    /// integration steps (RK4) per second, at every `every`-th of them.
    ///
    /// A world that leaves all bounds ends in NaN.
    pub fn simulate(&self, outside: &Outside<'_>, rate_hz: u32, every: u32) -> Vec<f64> {
        self.show(
            outside,
            Grid {
                interval: 1.0 / f64::from(rate_hz),
                steps: 1,
                every,
            },
        )
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
        let mut memory = [[0.0; MEMORY]; PARTS];
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
        let used = 2 + self.parts.len() * STATES;
        let from = *states;
        let moved = |by: f64, rates: &States| {
            let mut next = from;
            for k in 0..used {
                next[k] += by * rates[k];
            }
            next
        };
        let first = self.evaluate(outside, time, &from, memory);
        let middle = time + 0.5 * h;
        let k1 = first.rates;
        let k2 = self.evaluate(outside, middle, &moved(0.5 * h, &k1), memory);
        let k3 = self.evaluate(outside, middle, &moved(0.5 * h, &k2.rates), memory);
        let end = self.evaluate(outside, time + h, &moved(h, &k3.rates), memory);
        for k in 0..used {
            states[k] += h / 6.0 * (k1[k] + 2.0 * (k2.rates[k] + k3.rates[k]) + end.rates[k]);
        }
        for (slot, part) in self.parts.iter().enumerate() {
            let at = Moment {
                time: time + h,
                angle: states[0],
                rate: states[1],
                pressure: end.pressures[slot],
                run: outside.run,
            };
            part.remember(at, &states[own(slot)], &mut memory[slot]);
        }
        first.reading
    }

    /// With transitions of friction wide enough for the step of 1/[`RATE_HZ`] s:
    /// close to rest a smooth sign function is a damper of T/ω_s.
    pub fn resolved(mut self) -> Self {
        let stiffest = self.base.inertia * f64::from(RATE_HZ);
        for part in &mut self.parts {
            let values = &mut part.values;
            match part.law {
                Law::Known(Formula::CoulombTanh | Formula::CoulombRoot) => {
                    values[1] = values[1].max(values[0] / stiffest);
                }
                Law::Known(Formula::StribeckGauss | Formula::StribeckExponential) => {
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
