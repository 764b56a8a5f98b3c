//! Runs a model over the pressure of a recording.
//!
//! Between its samples the pressure is interpolated, never held: a recorder
//! samples a continuous signal, and holding each sample until the next delays
//! the input by half an interval. On the Silverbox oscillator (a public
//! benchmark with a band-limited input) even the right model has an error of 13 mV
//! with held samples, and a small part of that with interpolated ones.

use std::sync::OnceLock;

use model_core::actuator::{Model, State};
use model_core::dynamics::Rates;
use model_core::effects::Motion;
use model_core::input::Input;
use model_core::integrate::{Scheme, step, step_about};
use model_core::power::Power;
use model_core::real::Real;

use super::band_limited::{derivatives, quintic};
use super::dual::FromF64;
use super::fixed_power::{Fixed, FixedPower};
use super::work::Work;
use softrig_formats::recording::Recording;

/// An angle (rad) at which a run counts as diverged: no actuator bends this
/// far, and going on would only produce infinities.
pub const DIVERGED: f64 = 200.0;

/// The most integration steps in one sampling interval.
pub const MOST_SUBSTEPS: usize = 64;

/// Share of the slow time constant C/K in an exponential step.
pub const SLOW: f64 = 0.1;

/// The most integration steps across a gap.
pub const LONGEST_GAP: f64 = 1e6;

/// Pressure of a recording as a continuous signal: a cubic Hermite spline
/// through the samples with slopes from their neighbours (Catmull–Rom on an
/// even grid), constant beyond both ends.
#[derive(Clone, Debug)]
pub struct Signal {
    time: Vec<f64>,
    value: Vec<f64>,
    /// Slope at each sample (Pa/s).
    slope: Vec<f64>,
    /// Curvature at each sample (Pa/s²) of a signal without anything beyond half the sampling rate,
    /// which is a quintic between its samples.
    curvature: Option<Vec<f64>>,
    /// The median time between samples (s).
    interval: f64,
    /// See [`straight`]; found where a step first may span samples.
    straight: OnceLock<Vec<u8>>,
}

impl Signal {
    /// Creates the signal of a recording's pressure.
    pub fn pressure(recording: &Recording) -> Self {
        Self::new(recording.time.clone(), recording.pressure.clone())
    }

    /// Creates a signal through samples at increasing times.
    pub fn new(time: Vec<f64>, value: Vec<f64>) -> Self {
        let slope = slopes(&time, &value);
        let mut steps: Vec<f64> = time.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let interval = crate::statistics::median(&mut steps);
        Self {
            straight: OnceLock::new(),
            interval,
            time,
            value,
            slope,
            curvature: None,
        }
    }

    /// The same signal if nothing of it is beyond half the sampling rate: then its samples say what
    /// it is between them ([`crate::sim::band_limited`]). As it was where they are not even.
    #[must_use]
    pub fn band_limited(self) -> Self {
        match derivatives(&self.time, &self.value) {
            Some([slope, curvature]) => Self {
                slope,
                curvature: Some(curvature),
                ..self
            },
            None => self,
        }
    }

    /// The signal at its samples.
    pub fn values(&self) -> &[f64] {
        &self.value
    }

    /// The times of its samples (s).
    pub fn times(&self) -> &[f64] {
        &self.time
    }

    /// The value at a time (s) after the first sample, searched from sample `hint`, and a
    /// sample from which to search the next.
    pub(crate) fn since_start(&self, time: f64, hint: usize) -> (f64, usize) {
        let start = self.time.first().map_or(time, |first| first + time);
        let sample = self.interval(start, hint);
        let offset = self.time.get(sample).map_or(0.0, |at| start - at);
        (self.at(sample, offset), sample)
    }

    /// The longest window from a sample on in which the signal is a straight line, in intervals.
    fn straight_from(&self, sample: usize) -> usize {
        let find = || straight(&self.time, &self.value, self.interval);
        1 << self.straight.get_or_init(find)[sample]
    }

    /// The usual time between samples (s): the median.
    fn usual_interval(&self) -> f64 {
        self.interval
    }

    /// The interval that holds `time`, searched from `hint`: neighbouring
    /// calls ask for neighbouring times.
    fn interval(&self, time: f64, hint: usize) -> usize {
        let last = self.time.len().saturating_sub(2);
        let mut k = hint.min(last);
        while k > 0 && self.time[k] > time {
            k -= 1;
        }
        while k < last && self.time[k + 1] <= time {
            k += 1;
        }
        k
    }

    /// The signal around the instant `begin` seconds after sample `start`: the
    /// input of an integration step that begins there.
    pub fn around<R: Real + FromF64>(&self, start: usize, begin: R) -> impl Input<R> {
        Around {
            signal: self,
            start,
            begin,
            zero: R::zero(),
        }
    }

    /// The value `offset` seconds after sample `start`.
    fn at<R: Real + FromF64>(&self, start: usize, offset: R) -> R {
        let first = self.time[0] - self.time[start];
        let last = self.time[self.time.len() - 1] - self.time[start];
        let position = offset.to_f64();
        if position <= first {
            return R::from_f64(self.value[0]);
        }
        if position >= last {
            return R::from_f64(self.value[self.value.len() - 1]);
        }
        let k = self.interval(self.time[start] + position, start);
        let width = self.time[k + 1] - self.time[k];
        let begin = self.time[k] - self.time[start];
        let u = (position - begin) / width;
        if let Some(curvature) = &self.curvature {
            let ends = [k, k + 1].map(|k| [self.value[k], self.slope[k], curvature[k]]);
            let [value, slope] = quintic(ends, width, u);
            return offset.chain(value, slope);
        }
        let rise = self.value[k + 1] - self.value[k];
        let (m0, m1) = (self.slope[k] * width, self.slope[k + 1] * width);
        let (c2, c3) = (3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise);
        let value = self.value[k] + u * (m0 + u * (c2 + u * c3));
        offset.chain(value, (m0 + u * (2.0 * c2 + 3.0 * u * c3)) / width)
    }
}

/// Slopes of a cubic Hermite spline: the derivative of the parabola through
/// each sample and its two neighbours.
fn slopes(time: &[f64], value: &[f64]) -> Vec<f64> {
    let count = time.len();
    let secant = |k: usize| (value[k + 1] - value[k]) / (time[k + 1] - time[k]);
    (0..count)
        .map(|k| {
            if count < 2 {
                0.0
            } else if k == 0 {
                secant(0)
            } else if k == count - 1 {
                secant(count - 2)
            } else {
                let (before, after) = (time[k] - time[k - 1], time[k + 1] - time[k]);
                (after * secant(k - 1) + before * secant(k)) / (before + after)
            }
        })
        .collect()
}

/// A straight line over a window of samples that has their integral and their first moment.
#[derive(Clone, Copy, Debug)]
struct Line {
    /// Value at the beginning of the window (Pa).
    begin: f64,
    /// Slope (Pa/s).
    slope: f64,
}

impl Line {
    fn through(time: &[f64], value: &[f64]) -> Self {
        let weight = |k: usize| {
            let before = time[k.saturating_sub(1)];
            0.5 * (time[(k + 1).min(time.len() - 1)] - before)
        };
        let mean = |of: &dyn Fn(usize) -> f64| -> f64 {
            (0..time.len()).map(|k| weight(k) * of(k)).sum::<f64>()
                / (time[time.len() - 1] - time[0])
        };
        let (at, level) = (mean(&|k| time[k] - time[0]), mean(&|k| value[k]));
        let apart = |k: usize| time[k] - time[0] - at;
        let slope = mean(&|k| apart(k) * (value[k] - level)) / mean(&|k| apart(k) * apart(k));
        Self {
            begin: level - slope * at,
            slope,
        }
    }

    fn at(self, offset: f64) -> f64 {
        self.begin + self.slope * offset
    }
}

/// Longest window (binary logarithm of its intervals) that one step may span.
const LONGEST_WINDOW: u8 = 6;

/// For each sample, the longest window that begins there in which a signal is a straight line, to
/// half a percent of its range and its noise: the binary logarithm of its intervals. Windows of 2ᵏ
/// intervals begin at multiples of 2ᵏ, and none has a gap.
fn straight(time: &[f64], value: &[f64], interval: f64) -> Vec<u8> {
    /// Largest distance from the line, as a share of the range. An actuator that a step resolves
    /// follows a force of this share, of no mean and no first moment, by a thirtieth of it.
    const SHARE: f64 = 0.005;
    /// Largest distance from the line, in standard deviations of the noise.
    const DEVIATIONS: f64 = 3.0;
    let range = crate::statistics::swing(value);
    let within = (SHARE * range).max(DEVIATIONS * crate::statistics::noise(time, value));
    let mut longest = vec![0; value.len()];
    for power in 1..=LONGEST_WINDOW {
        let span = 1 << power;
        for begin in (0..value.len().saturating_sub(span)).step_by(span) {
            // What holds a bend or a gap in its halves has it as a whole.
            let half = span / 2;
            if longest[begin] + 1 < power || longest[begin + half] + 1 < power {
                continue;
            }
            let window = begin..=begin + span;
            let (time, value) = (&time[window.clone()], &value[window]);
            let is_even = time
                .windows(2)
                .all(|pair| pair[1] - pair[0] <= 1.5 * interval);
            let line = Line::through(time, value);
            let mut each = time.iter().zip(value);
            if is_even && each.all(|(t, p)| (line.at(t - time[0]) - p).abs() <= within) {
                longest[begin] = power;
            }
        }
    }
    longest
}

/// The pressure around one integration step.
struct Around<'a, R> {
    signal: &'a Signal,
    start: usize,
    /// Time from the sample to the start of the step (s).
    begin: R,
    /// The zero of the pressure sensor (Pa).
    zero: R,
}

impl<R: Real + FromF64> Input<R> for Around<'_, R> {
    fn pressure(&self, offset: R) -> R {
        self.signal.at(self.start, self.begin + offset) - self.zero
    }
}

/// The pressure of a window that is a straight line.
struct Along<R> {
    line: Line,
    /// Time from the begin of the window to the start of the step (s).
    begin: R,
    /// The zero of the pressure sensor (Pa).
    zero: R,
}

impl<R: Real + FromF64> Input<R> for Along<R> {
    fn pressure(&self, offset: R) -> R {
        let offset = self.begin + offset;
        offset.chain(self.line.at(offset.to_f64()), self.line.slope) - self.zero
    }
}

/// Where a run starts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct InitialState<R> {
    /// The sensor's reading (rad).
    pub angle: R,
    /// Rate of what the sensor shows (rad/s).
    pub rate: R,
}

/// Initial state and zero of a simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Origin<R> {
    /// Where it starts.
    pub start: InitialState<R>,
    /// Where what creeps had settled before, from the angle at the start (rad).
    pub past: R,
    /// How far it was bent before (rad).
    pub stretched: f64,
    /// The zero of the pressure sensor (Pa).
    pub pressure_zero: R,
    /// Time on the rig's clock at the first sample (s): drifts run by it.
    pub clock: R,
}

/// A simulated run, one entry a sample of the recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory<R> {
    /// The sensor's reading (rad).
    pub reading: Vec<R>,
    /// Whether the run left all bounds; the rest is then held.
    pub diverged: bool,
}

/// How an interval between samples is integrated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepping {
    /// The scheme.
    pub scheme: Scheme,
    /// Integration steps in a usual interval.
    pub substeps: usize,
    /// Where fewer do.
    pub friction: Option<Friction>,
    /// How many fewer do where the motion is slow.
    pub winding: Option<Winding>,
    /// Where steps follow the motion.
    needs: Option<Needs>,
}

/// Parts of the range of angles in which the steps differ.
const PARTS: usize = 8;

/// Steps that a usual interval needs at angles up to the end of each part of the range. Below one,
/// a step may span several intervals in which the pressure is a straight line.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Needs {
    /// Largest angle (rad).
    angle: f64,
    /// All that the model does.
    all: [f64; PARTS],
    /// Without what a friction does at rest, and a loop that is wound.
    smooth: [f64; PARTS],
}

impl Needs {
    /// The part of the range to which an angle (rad) belongs.
    fn part(&self, angle: f64) -> usize {
        let part = (angle.abs() / self.angle * PARTS as f64).ceil();
        // What is not a number is 0, and what is beyond the last part is clamped.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let part = part as usize;
        part.clamp(1, PARTS) - 1
    }
}

/// A hysteresis relaxes as fast as it is wound, so that its steps follow the rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Winding {
    /// Integration steps that a usual interval needs at rest.
    still: f64,
    /// Steps that its relaxation needs for each rad/s.
    per_rate: f64,
}

impl Winding {
    /// Steps that its relaxation needs in a usual interval which begins at a rate (rad/s), which
    /// half as much again does not make wrong.
    fn needs(self, rate: f64) -> f64 {
        1.5 * self.per_rate * rate.abs()
    }
}

/// The steep slope of a friction's smoothed sign has to be resolved only where the motion
/// turns: beyond it slides, and well within it sticks, which is a viscous damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Rate (rad/s) up to which every friction sticks.
    sticks: f64,
    /// Exponential steps that a usual interval needs there.
    sticking: f64,
    /// Rate (rad/s) from which all of them slide.
    slides: f64,
    /// Integration steps that a usual interval needs there.
    sliding: f64,
}

impl Friction {
    /// Slope at a rate (rad/s) relative to that at rest: of the sign, and of what falls where it is
    /// saturated, which is a tenth as steep at most.
    fn steepness(self, rate: f64) -> f64 {
        /// Multiple of the rate below which the sign is one of a viscous damping.
        const STICKS: f64 = 0.5;
        const FALLING: f64 = 0.1;
        let fast = libm::exp(-2.0 * rate.abs() * STICKS / self.sticks);
        (4.0 * fast / (1.0 + fast).powi(2)).max(FALLING)
    }
}

/// Steps of a friction that turns are so many times as short as those of a decay that nobody sees:
/// where a stage of one leaps over the rest, the motion creeps on at a rate of its own.
const SHORTER: f64 = 4.0;

/// Exponential steps in which a friction that sticks follows a pressure that changes.
const STICKING: usize = 4;

/// How finely an oscillation is resolved. RK4 loses phase as (ωh)⁴/120.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Grain {
    /// A fifth of a radian a step: the phase is kept within 2·10⁻⁵.
    #[default]
    Fine,
    /// Two fifths: within 2·10⁻⁴. That is a frequency which a later fit shifts, and good
    /// enough on the way to an end with fine steps. A step spans several samples where the
    /// pressure is a straight line, and is as long as the motion there allows.
    Coarse,
}

impl Grain {
    /// Largest angle ωh of an oscillation that a step spans (rad).
    pub const fn angle_a_step(self) -> f64 {
        match self {
            Self::Fine => 0.2,
            Self::Coarse => 0.4,
        }
    }
}

impl Stepping {
    /// Most evaluations of the model in a usual interval.
    pub const fn evaluations(self) -> usize {
        self.substeps * evaluations_of(self.scheme)
    }

    /// A fixed number of Runge–Kutta steps in every interval.
    pub const fn runge_kutta(substeps: usize) -> Self {
        Self {
            scheme: Scheme::Rk4,
            substeps,
            friction: None,
            winding: None,
            needs: None,
        }
    }

    /// Runge–Kutta steps for an interval of `interval` seconds and angles up to `angle`
    /// (rad), see [`substeps`]; or exponential ones where the damping is so strong that
    /// those would be too many. An exponential step carries the damping exactly and has
    /// to resolve only the slow motion K/C of an overdamped actuator.
    pub fn of<R: FromF64, P: Power<R>>(
        model: &Model<R, P>,
        interval: f64,
        angle: f64,
        grain: Grain,
    ) -> Self {
        let damping = damping_rate(model);
        let rates_at = |angle: f64| upper(model.fastest_rate(R::from_f64(angle)));
        let rates = rates_at(angle);
        let stepping = Self::resolving(damping, rates, interval, grain);
        let needed = |rates| match stepping.scheme {
            Scheme::ExponentialHeun => exponential(damping, rates, interval),
            _ => runge_kutta(rates, interval, grain),
        };
        let lower = |[stiffness, all]: [f64; 2], by: R| [stiffness, (all - by.to_f64()).max(0.0)];
        let without = |relaxation: R| needed(lower(rates, relaxation));
        let signs = model.signs();
        let winding = model.winding(R::from_f64(angle));
        let needs = (grain == Grain::Coarse).then(|| {
            let each =
                std::array::from_fn(|part| rates_at(angle * (part + 1) as f64 / PARTS as f64));
            let sudden = match (&signs, winding) {
                (Some(sign), _) => sign.relaxation,
                (None, Some([_, together])) => together,
                (None, None) => R::zero(),
            };
            Needs {
                angle,
                all: each.map(needed),
                smooth: each.map(|rates| needed(lower(rates, sudden))),
            }
        });
        Self {
            needs,
            friction: signs.map(|sign| Friction {
                sticks: 0.5 * sign.width.to_f64(),
                sticking: exponential(damping + sign.relaxation.to_f64(), rates, interval),
                slides: sign.saturated.to_f64(),
                sliding: without(sign.relaxation),
            }),
            winding: winding.map(|[each, together]| {
                let steps_each = match stepping.scheme {
                    Scheme::ExponentialHeun => 2.0,
                    _ => 0.5,
                };
                Winding {
                    still: without(together),
                    per_rate: steps_each * interval * each.to_f64(),
                }
            }),
            ..stepping
        }
    }

    /// The steps that the swing of a model and its damping need, without what an effect does
    /// faster: how finely its motion shows.
    pub fn of_motion(model: &Model<f64>, interval: f64, angle: f64, grain: Grain) -> Self {
        let damping = damping_rate(model);
        let rates = [model.fastest_swing(angle).max(0.0), damping];
        Self::resolving(damping, rates, interval, grain)
    }

    fn resolving(damping: f64, rates: [f64; 2], interval: f64, grain: Grain) -> Self {
        let short_needed = runge_kutta(rates, interval, grain);
        let long_needed = exponential(damping, rates, interval);
        let (short, long) = (count(short_needed), count(long_needed));
        // Two evaluations a step instead of four.
        let is_cheaper = if grain == Grain::Coarse {
            long_needed < 2.0 * short_needed
        } else {
            long < short && short > 2
        };
        let is_exponential = damping * damping > 4.0 * rates[0] && is_cheaper;
        let (scheme, needed) = if is_exponential {
            (Scheme::ExponentialHeun, long_needed)
        } else {
            (Scheme::Rk4, short_needed)
        };
        Self {
            scheme,
            substeps: count(needed),
            friction: None,
            winding: None,
            needs: None,
        }
    }
}

/// Evaluations of the model in a step.
const fn evaluations_of(scheme: Scheme) -> usize {
    match scheme {
        Scheme::SemiImplicitEuler => 1,
        Scheme::Heun | Scheme::ExponentialHeun => 2,
        Scheme::Rk4 => 4,
    }
}

/// Damping over inertia (1/s).
fn damping_rate<R: FromF64, P: Power<R>>(model: &Model<R, P>) -> f64 {
    (model.dynamics().damping / model.dynamics().inertia).to_f64()
}

/// Stiffness over inertia (1/s²) and relaxation (1/s), neither below zero.
fn upper<R: FromF64>(rates: Rates<R>) -> [f64; 2] {
    [rates.stiffness, rates.relaxation].map(|rate| rate.to_f64().max(0.0))
}

/// Runge–Kutta steps for each sampling interval of `interval` seconds that
/// resolve the model's own rates over angles up to `angle` (rad).
///
/// RK4 is stable to λh = 2.78: λh ≤ 2 keeps fast decays stable and gone
/// within a few steps; nobody sees their course.
pub fn substeps<R: FromF64, P: Power<R>>(model: &Model<R, P>, interval: f64, angle: f64) -> usize {
    let rates = upper(model.fastest_rate(R::from_f64(angle)));
    count(runge_kutta(rates, interval, Grain::Fine))
}

/// Exponential steps about a decay (1/s) that resolve the slow motion and the other rates.
fn exponential(decay: f64, [stiffness, relaxation]: [f64; 2], interval: f64) -> f64 {
    let others = (relaxation - decay).max(0.0);
    (stiffness / decay * interval / SLOW).max(2.0 * others * interval)
}

/// Runge–Kutta steps.
fn runge_kutta([stiffness, relaxation]: [f64; 2], interval: f64, grain: Grain) -> f64 {
    let oscillation = stiffness.sqrt() * interval / grain.angle_a_step();
    oscillation.max(relaxation * interval / 2.0)
}

/// This many steps, at least one and at most [`MOST_SUBSTEPS`].
fn count(needed: f64) -> usize {
    if needed.is_finite() {
        // Both ends of the clamp fit in a usize.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let steps = needed.ceil().clamp(1.0, MOST_SUBSTEPS as f64) as usize;
        steps
    } else {
        MOST_SUBSTEPS
    }
}

/// Integration steps for an interval between samples that is usually divided
/// into `substeps`: a gap is crossed in steps of the same length.
fn across(interval: f64, usual: f64, substeps: usize) -> usize {
    if interval <= 1.5 * usual {
        return substeps;
    }
    // Clamped before.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let more = (substeps as f64 * interval / usual)
        .ceil()
        .clamp(1.0, LONGEST_GAP) as usize;
    more
}

/// Why an interval may be crossed in few steps.
#[derive(Clone, Copy)]
enum Why<R> {
    /// Nothing sudden is in the model.
    Even,
    /// All frictions slide, in the direction of this sign.
    Sliding(f64),
    /// All frictions stick, which is a decay of the rate (1/s).
    Sticking(R),
    /// What winds up does so slowly.
    Winding,
    /// A friction goes from this rate (rad/s) on where it is less steep than at rest.
    Turning(f64),
}

/// The course of an interval that is crossed in few steps.
#[derive(Clone, Copy)]
struct Course<R> {
    why: Why<R>,
    /// Steps that a usual interval needs.
    needed: f64,
    /// The part of the range of angles that it stays in.
    part: usize,
}

impl<R: FromF64> Course<R> {
    /// The course from a state on for a time (s); none if it takes the small steps.
    fn of<P: Power<R>>(
        model: &Model<R, P>,
        stepping: &Stepping,
        state: &State<R>,
        time: f64,
    ) -> Option<Self> {
        let [angle, rate] = [state.angle, state.rate].map(R::to_f64);
        let farthest = angle.abs().max((angle + rate * time).abs());
        let part = stepping.needs.map_or(PARTS - 1, |it| it.part(farthest));
        let smooth = |whole| stepping.needs.map_or(whole, |it| it.smooth[part]);
        let course = |why, needed| Some(Self { why, needed, part });
        if let Some(friction) = stepping.friction {
            if rate.abs() > friction.slides {
                return course(Why::Sliding(rate.signum()), smooth(friction.sliding));
            }
            if rate.abs() < friction.sticks {
                let sign = model.signs()?;
                let damping = model.dynamics().damping / model.dynamics().inertia;
                return course(Why::Sticking(damping + sign.relaxation), friction.sticking);
            }
            let needs = stepping.needs?;
            let needed = SHORTER * needs.all[part] * friction.steepness(rate);
            return course(Why::Turning(rate), needed.max(needs.smooth[part]));
        }
        match (stepping.winding, stepping.needs) {
            (Some(winding), _) => {
                course(Why::Winding, smooth(winding.still).max(winding.needs(rate)))
            }
            (None, Some(needs)) => course(Why::Even, needs.all[part]),
            (None, None) => None,
        }
    }

    /// Whether it was one still where it arrived.
    fn holds(&self, stepping: &Stepping, arrived: &State<R>) -> bool {
        let rate = arrived.rate.to_f64();
        let of_friction = |holds: fn(Friction, f64) -> bool, value| {
            stepping.friction.is_some_and(|it| holds(it, value))
        };
        let angle = arrived.angle.to_f64();
        stepping.needs.is_none_or(|it| it.part(angle) <= self.part)
            && match self.why {
                Why::Even => true,
                Why::Sliding(sign) => of_friction(|it, rate| rate > it.slides, sign * rate),
                Why::Sticking(_) => of_friction(|it, rate| rate < it.sticks, rate.abs()),
                // A stage of a step must not see it turned.
                Why::Turning(before) => rate / before > 0.5,
                Why::Winding => stepping.winding.is_some_and(|winding| {
                    count(winding.still.max(winding.needs(rate))) <= 2 * count(self.needed)
                }),
            }
    }

    /// Fewest steps.
    const fn least(&self) -> usize {
        match self.why {
            Why::Sticking(_) => STICKING,
            _ => 1,
        }
    }

    fn how(&self, stepping: &Stepping) -> How<R> {
        match self.why {
            Why::Sticking(decay) => How::About(decay),
            _ => How::By(stepping.scheme),
        }
    }
}

/// Advances `state` from the sample before `sample` to it; how many evaluations of the model that
/// took.
pub fn advance<R: FromF64, P: Power<R>>(
    model: &Model<R, P>,
    signal: &Signal,
    sample: usize,
    zero: R,
    stepping: Stepping,
    state: &mut State<R>,
) -> usize {
    let interval = signal.time[sample] - signal.time[sample - 1];
    let around = |begin: f64| Around {
        signal,
        start: sample - 1,
        begin: R::from_f64(begin),
        zero,
    };
    let cross = |how, usual_steps: usize, state: &mut State<R>| {
        let steps = across(interval, signal.usual_interval(), usual_steps);
        crossed(model, how, (interval, steps), &around, state)
    };
    let mut evaluations = 0;
    if let Some(course) = Course::of(model, &stepping, state, interval) {
        let few = count(course.needed).max(course.least());
        if few < stepping.substeps {
            let mut arrived = *state;
            evaluations += cross(course.how(&stepping), few, &mut arrived);
            if course.holds(&stepping, &arrived) {
                *state = arrived;
                return evaluations;
            }
        }
    }
    // It turned, broke loose or got going, or nothing needs fewer.
    evaluations + cross(How::By(stepping.scheme), stepping.substeps, state)
}

/// How a step is taken.
#[derive(Clone, Copy)]
enum How<R> {
    By(Scheme),
    /// Exponentially, about a decay of the rate (1/s).
    About(R),
}

/// Advances `state` by an interval (s) in so many steps, under what acts from an instant on.
fn crossed<R: FromF64, P: Power<R>, I: Input<R>>(
    model: &Model<R, P>,
    how: How<R>,
    (interval, steps): (f64, usize),
    acting: &impl Fn(f64) -> I,
    state: &mut State<R>,
) -> usize {
    let dt = R::from_f64(interval / steps as f64);
    for part in 0..steps {
        let input = acting(interval * part as f64 / steps as f64);
        match how {
            How::By(scheme) => step(scheme, model, state, &input, dt),
            How::About(decay) => step_about(decay, model, state, &input, dt),
        }
    }
    steps
        * match how {
            How::By(scheme) => evaluations_of(scheme),
            How::About(_) => evaluations_of(Scheme::ExponentialHeun),
        }
}

/// Whether steps of a model may span several samples: not under a delayed pressure, whose bends
/// lie elsewhere, and not where the reading has states of its own, which nothing interpolates.
fn spans<R: FromF64, P: Power<R>>(model: &Model<R, P>, state: &State<R>) -> bool {
    let moved = State {
        hidden: state.hidden.map(|slot| slot.map(|value| value + R::one())),
        ..*state
    };
    let reading = |state| model.reading(state).to_f64();
    crate::statistics::same(reading(state), reading(&moved))
        && crate::statistics::same(model.delay().to_f64(), 0.0)
}

/// Advances `state` over as many samples from `from` on as few steps may span, and what the sensor
/// shows at each; none, with the evaluations in vain, where small steps are needed.
fn glide<R: FromF64, P: Power<R>>(
    model: &Model<R, P>,
    signal: &Signal,
    from: usize,
    zero: R,
    stepping: &Stepping,
    state: &mut State<R>,
    reading: &mut Vec<R>,
) -> usize {
    let longest = signal.straight_from(from);
    let spanning = |span: usize| {
        let whole = signal.time[from + span] - signal.time[from];
        Course::of(model, stepping, state, whole)
            .filter(|course| !matches!(course.why, Why::Turning(_)))
            .filter(|course| span as f64 * course.needed <= course.least() as f64)
            .map(|course| (span, course))
    };
    let spans = (1..)
        .map(|power| 1 << power)
        .take_while(|&span| span <= longest);
    let Some((span, course)) = spans.map_while(spanning).last() else {
        return 0;
    };
    let window = from..=from + span;
    let time = &signal.time[window.clone()];
    let line = Line::through(time, &signal.value[window]);
    let along = |begin: f64| Along {
        line,
        begin: R::from_f64(begin),
        zero,
    };
    let whole = time[span] - time[0];
    let mut arrived = *state;
    let how = course.how(stepping);
    let evaluations = crossed(model, how, (whole, course.least()), &along, &mut arrived);
    if !course.holds(stepping, &arrived) || is_lost(arrived.angle) {
        return evaluations;
    }
    let mut between = *state;
    for at in &time[1..span] {
        // The cubic through both angles with both rates.
        let u = (at - time[0]) / whole;
        let v = 1.0 - u;
        let times = |value: R, factor: f64| value.chain(value.to_f64() * factor, factor);
        between.time = state.time + R::from_f64(at - time[0]);
        between.angle = times(state.angle, v * v * (1.0 + 2.0 * u))
            + times(state.rate, whole * u * v * v)
            + times(arrived.angle, u * u * (1.0 + 2.0 * v))
            + times(arrived.rate, -whole * u * u * v);
        reading.push(model.reading(&between));
    }
    reading.push(model.reading(&arrived));
    *state = arrived;
    evaluations
}

/// Whether an angle (rad) has left all bounds.
pub fn is_lost<R: FromF64>(angle: R) -> bool {
    !angle.is_finite() || angle.to_f64().abs() > DIVERGED
}

/// The state of a model that shows what `origin` says when the pressure is first
/// sampled.
pub fn state_at<R: FromF64, P: Power<R>>(
    model: &Model<R, P>,
    signal: &Signal,
    origin: &Origin<R>,
) -> State<R> {
    let Origin {
        start,
        past,
        stretched,
        pressure_zero: zero,
        clock,
    } = *origin;
    let pressure = R::from_f64(signal.value[0]) - zero;
    let shown = Motion {
        angle: start.angle,
        rate: start.rate,
    };
    let mut state: State<R> = model.showing_after(past, shown, pressure);
    if stretched > 0.0 {
        state = model.stretched(state, R::from_f64(stretched));
    }
    if clock.to_f64() != 0.0 {
        // What has drifted by then is in the reading already.
        state.time = clock;
        let drifted = start.angle - model.reading(&state);
        state.angle += drifted;
    }
    state
}

/// Simulates `model` over the pressure in `signal`, from `start`, with
/// `substeps` RK4 steps between samples.
pub fn run<R: FromF64>(
    model: &Model<R>,
    signal: &Signal,
    start: InitialState<R>,
    substeps: usize,
) -> Trajectory<R>
where
    for<'a> Fixed<'a>: Power<R>,
{
    let stepping = Stepping::runge_kutta(substeps);
    let origin = Origin {
        start,
        past: R::zero(),
        stretched: 0.0,
        pressure_zero: R::zero(),
        clock: R::zero(),
    };
    run_from(model, signal, origin, stepping)
}

/// Like [`run`], with a zero of the pressure sensor and a clock.
pub fn run_from<R: FromF64>(
    model: &Model<R>,
    signal: &Signal,
    origin: Origin<R>,
    stepping: Stepping,
) -> Trajectory<R>
where
    for<'a> Fixed<'a>: Power<R>,
{
    let prepared = FixedPower::of(model);
    let model = model.with_power(Fixed::new(prepared.as_ref()));
    run_as_it_is(&model, signal, origin, stepping)
}

/// Like [`run_from`], by the model's own power function.
pub fn run_as_it_is<R: FromF64, P: Power<R>>(
    model: &Model<R, P>,
    signal: &Signal,
    origin: Origin<R>,
    stepping: Stepping,
) -> Trajectory<R> {
    let mut state = state_at(model, signal, &origin);
    let mut reading = Vec::with_capacity(signal.time.len());
    reading.push(model.reading(&state));
    let mut diverged = false;
    let mut evaluations = 0;
    let zero = origin.pressure_zero;
    let spans = stepping.needs.is_some() && spans(model, &state);
    while reading.len() < signal.time.len() {
        let sample = reading.len();
        if !diverged {
            if spans {
                let from = sample - 1;
                evaluations += glide(
                    model,
                    signal,
                    from,
                    zero,
                    &stepping,
                    &mut state,
                    &mut reading,
                );
                if reading.len() > sample {
                    continue;
                }
            }
            evaluations += advance(model, signal, sample, zero, stepping, &mut state);
            diverged = is_lost(state.angle);
        }
        reading.push(if diverged {
            R::from_f64(DIVERGED)
        } else {
            model.reading(&state)
        });
    }
    Work::count(evaluations, R::HAS_DERIVATIVES);
    Trajectory { reading, diverged }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::dynamics::Dynamics;

    fn oscillator() -> Model<f64> {
        Model::new(
            Dynamics {
                inertia: 1.0,
                damping: 0.4,
                stiffness: 9.0,
                exponent: 1.0,
                input_gain: 1.0,
            },
            &[],
        )
        .unwrap()
    }

    /// The exact response of a damped oscillator to sin(ωt), sampled coarsely:
    /// interpolation has to beat a hold by an order of magnitude.
    #[test]
    fn coarse_samples_of_a_sine_give_the_exact_forced_response() {
        let omega = 4.0;
        let interval = 0.08;
        let time: Vec<f64> = (0..400).map(|k| f64::from(k) * interval).collect();
        let pressure: Vec<f64> = time.iter().map(|t| (omega * t).sin()).collect();
        let signal = Signal::new(time.clone(), pressure);
        let model = oscillator();
        let end = run(
            &model,
            &signal,
            InitialState {
                angle: 0.0,
                rate: 0.0,
            },
            4,
        );
        let (real, imaginary) = (9.0 - omega * omega, 0.4 * omega);
        let power = real * real + imaginary * imaginary;
        let worst = (350..400)
            .map(|k| {
                let phase = omega * time[k];
                let exact = (real * phase.sin() - imaginary * phase.cos()) / power;
                (end.reading[k] - exact).abs()
            })
            .fold(0.0, f64::max);
        // A hold would be late by half an interval: ω·0.04 s of the amplitude.
        let hold = omega * interval / 2.0 / power.sqrt();
        assert!(worst < 0.1 * hold, "{worst} against {hold}");
    }

    #[test]
    fn uneven_samples_and_gaps_are_integrated_in_time() {
        let model = oscillator();
        let even = Signal::new(
            (0..=100).map(|k| f64::from(k) * 0.02).collect(),
            vec![2.0; 101],
        );
        let uneven = Signal::new(vec![0.0, 0.01, 0.02, 1.0, 1.98, 2.0], vec![2.0; 6]);
        let start = InitialState {
            angle: 0.1,
            rate: 0.0,
        };
        let a = run(&model, &even, start, 4);
        let b = run(&model, &uneven, start, 64);
        assert!((a.reading[100] - b.reading[5]).abs() < 1e-6);
    }

    /// Long steps where a friction sticks or slides lead where short ones everywhere do:
    /// a thousandth of a degree beside what those err themselves.
    #[test]
    fn frictions_need_short_steps_only_where_the_motion_turns() {
        use model_core::catalogue::Kind;
        let time: Vec<f64> = (0..1_000).map(|k| f64::from(k) * 0.02).collect();
        let pressure = |t: &f64| 6e4 * (0.5 - 0.5 * (0.9 * t).cos()) * f64::from(t % 7.0 < 4.0);
        let signal = Signal::new(time.clone(), time.iter().map(pressure).collect());
        let dynamics = Dynamics {
            inertia: 0.03,
            damping: 0.6,
            stiffness: 4.0,
            exponent: 1.3,
            input_gain: 1e-4,
        };
        for friction in [
            Kind::CoulombFriction.build(&[0.8, 0.02]),
            Kind::StribeckFriction.build(&[0.5, 0.4, 0.1]),
        ] {
            let model: Model<f64> = Model::new(dynamics, &[friction.unwrap()]).unwrap();
            let origin = Origin {
                start: InitialState {
                    angle: 0.3,
                    rate: 0.0,
                },
                past: 0.0,
                stretched: 0.0,
                pressure_zero: 0.0,
                clock: 0.0,
            };
            let stepping = Stepping::of(&model, 0.02, 3.0, Grain::Fine);
            let friction = stepping.friction.unwrap();
            let sticking = count(friction.sticking).max(STICKING);
            assert!(stepping.substeps > 2 * sticking.max(count(friction.sliding)));
            let reference = run_from(&model, &signal, origin, Stepping::runge_kutta(512));
            let error_deg = |stepping| {
                run_from(&model, &signal, origin, stepping)
                    .reading
                    .iter()
                    .zip(&reference.reading)
                    .fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()))
                    .to_degrees()
            };
            let short = error_deg(Stepping {
                friction: None,
                ..stepping
            });
            let found = error_deg(stepping);
            assert!(
                found < 2.0 * short + 1e-3,
                "{found}° for {short}° {stepping:?}"
            );
        }
    }

    fn at_rest() -> Origin<f64> {
        Origin {
            start: InitialState {
                angle: 0.0,
                rate: 0.0,
            },
            past: 0.0,
            stretched: 0.0,
            pressure_zero: 0.0,
            clock: 0.0,
        }
    }

    /// Steps and a ramp (Pa) at 100 Hz, with a gap.
    fn steps_and_a_ramp() -> Signal {
        let time = (0..1_500).map(|k| 0.01 * f64::from(k) + f64::from(u8::from(k > 700)));
        let pressure = |t: &f64| match *t {
            t if t < 0.5 => 0.0,
            t if t < 4.0 => 6e4,
            t if t < 6.0 => 2e4,
            t if t < 12.0 => 1e4 * (t - 6.0),
            _ => 0.0,
        };
        let time: Vec<f64> = time.collect();
        Signal::new(time.clone(), time.iter().map(pressure).collect())
    }

    #[test]
    fn a_line_has_the_integral_and_the_first_moment_of_its_samples() {
        let time = [1.0, 1.01, 1.03, 1.04, 1.06];
        let value = [3.0, 5.0, 4.0, 9.0, 7.0];
        let line = Line::through(&time, &value);
        let moment = |of: &dyn Fn(usize) -> f64, power: i32| -> f64 {
            (0..4)
                .map(|k| {
                    let at = |k: usize| of(k) * (time[k] - 1.0).powi(power);
                    0.5 * (time[k + 1] - time[k]) * (at(k) + at(k + 1))
                })
                .sum()
        };
        for power in [0, 1] {
            let (of_line, of_samples) = (
                moment(&|k| line.at(time[k] - 1.0), power),
                moment(&|k| value[k], power),
            );
            assert!((of_line - of_samples).abs() < 1e-12, "{power}");
        }
        let straight = Line::through(&time, &time.map(|t| 2.0 - 3.0 * (t - 1.0)));
        assert!((straight.begin - 2.0).abs() < 1e-12 && (straight.slope + 3.0).abs() < 1e-12);
    }

    #[test]
    fn no_window_holds_an_edge_or_a_gap() {
        let signal = steps_and_a_ramp();
        for begin in 0..signal.value.len() {
            let span = signal.straight_from(begin);
            if span == 1 {
                continue;
            }
            let window = begin..=begin + span;
            let rises = |k: usize| signal.value[k + 1] - signal.value[k];
            let first = rises(begin);
            for k in window.clone().take(span) {
                assert!((rises(k) - first).abs() < 1e3, "{k} of {window:?}");
                assert!(signal.time[k + 1] - signal.time[k] < 0.02, "{window:?}");
            }
        }
        // A rest is one window after the other.
        let longest = (0..signal.value.len()).map(|begin| signal.straight_from(begin));
        assert_eq!(longest.max(), Some(1 << LONGEST_WINDOW));
    }

    /// What a fit sees on its way, of every effect of typical size: within two thousandths of the
    /// motion of what short steps give, at every sample.
    #[test]
    fn long_steps_lead_where_short_ones_do() {
        use crate::synth::example::{Hidden, make};
        use model_core::catalogue::Kind;
        use softrig_formats::model_file::ModelFile;

        let signal = steps_and_a_ramp();
        for &kind in Kind::NAMES {
            let example = make(Hidden::Effect(kind), 0.0, 5).unwrap();
            let path = std::path::Path::new("truth.toml");
            let model = ModelFile::parse(&example.truth, path).unwrap().model;
            let run = |grain, reach| {
                let stepping = Stepping::of(&model, 0.01, reach, grain);
                run_from(&model, &signal, at_rest(), stepping).reading
            };
            let short = run(Grain::Fine, 1.5);
            let largest = short.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            let long = run(Grain::Coarse, largest);
            assert_eq!(long.len(), short.len());
            let worst = long
                .iter()
                .zip(&short)
                .fold(0.0, |worst: f64, (a, b)| worst.max((a - b).abs()));
            assert!(worst < 2e-3 * largest, "{kind:?}: {worst} rad of {largest}");
        }
    }

    /// Every fit relies on this: dual numbers give the slope of the simulation
    /// by each parameter of each effect, also across the corners of those that
    /// have some.
    #[test]
    fn derivatives_by_all_parameters_of_effects_agree_with_differences() {
        use crate::sim::dual::Dual;
        use crate::synth::example::{Hidden, make};
        use model_core::actuator::ParameterId;
        use model_core::catalogue::Kind;
        use softrig_formats::model_file::ModelFile;

        let time: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01).collect();
        let pressure = |t: &f64| 6e4 * (0.4 - 0.5 * (1.7 * t).cos() + 0.3 * (4.1 * t).sin());
        let signal = Signal::new(time.clone(), time.iter().map(pressure).collect());
        let readings = |model: &Model<f64>| {
            let start = InitialState {
                angle: 0.3,
                rate: 0.4,
            };
            run(model, &signal, start, 2).reading
        };
        for &kind in Kind::NAMES {
            let example = make(Hidden::Effect(kind), 0.0, 5).unwrap();
            let path = std::path::Path::new("truth.toml");
            let model = ModelFile::parse(&example.truth, path).unwrap().model;
            for (parameter, row) in kind.parameters().iter().enumerate() {
                let id = ParameterId::Effect { slot: 0, parameter };
                let value = model.value(id).unwrap();
                let dual: Model<Dual<1>> = model.map(Dual::constant);
                let dual = dual.with_value(id, Dual::variable(value, 0, 1.0));
                let start = InitialState {
                    angle: Dual::constant(0.3),
                    rate: Dual::constant(0.4),
                };
                let exact: Vec<f64> = run(&dual, &signal, start, 2)
                    .reading
                    .iter()
                    .map(|reading| reading.partials()[0])
                    .collect();
                let h = 1e-5 * if value == 0.0 { 1.0 } else { value.abs() };
                let above = readings(&model.with_value(id, value + h));
                let below = readings(&model.with_value(id, value - h));
                let size = exact.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
                assert!(
                    size * value.abs().max(0.1) > 1e-5,
                    "{kind:?} {}: {size}",
                    row.key
                );
                for (k, exact) in exact.iter().enumerate() {
                    let difference = (above[k] - below[k]) / (2.0 * h);
                    assert!(
                        (exact - difference).abs() < 1e-3 * size,
                        "{kind:?} {} at {k}: {exact} against {difference} of {size}",
                        row.key
                    );
                }
            }
        }
    }

    #[test]
    fn divergence_is_reported_and_finite() {
        let model: Model<f64> = Model::new(
            Dynamics {
                inertia: 1e-6,
                damping: 1.0,
                stiffness: 1e6,
                exponent: 3.0,
                input_gain: 1.0,
            },
            &[],
        )
        .unwrap();
        let signal = Signal::new((0..50).map(|k| f64::from(k) * 0.1).collect(), vec![1e9; 50]);
        let end = run(
            &model,
            &signal,
            InitialState {
                angle: 0.0,
                rate: 0.0,
            },
            1,
        );
        assert!(end.diverged);
        assert!(end.reading.iter().all(|angle| angle.is_finite()));
    }
}
