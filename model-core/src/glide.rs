//! Losses of dry friction and other laws of the rate during a drift.
//!
//! Between two kicks an actuator drifts: `M·ω̇ = −C·ω − f(ω)`, where f is everything that
//! depends on the rate alone: dry friction, drag, a two-sided damping. As with the damping
//! itself ([`crate::leapfrog`]), the flow over one step depends only on the initial rate. So
//! it is tabulated once, at nodes, and a step looks up two numbers.
//!
//! Where a friction sticks, the actuator creeps about as slowly as the smoothed sign allows, and
//! an explicit scheme would oscillate.

use crate::elementary::ln;

/// Chords of one direction, where both are alike.
const CHORDS: usize = 64;

const OCTAVES: u8 = 8;

/// Nodes: one more than chords in either direction.
const NODES: usize = CHORDS + 2;

/// Where the second direction begins, where they differ.
const SECOND: usize = NODES / 2;

/// The largest number of units in a node.
const FULL: f32 = 16_000.0;

/// Parts of a unit that are looked up.
const PART: f32 = 256.0;

/// The base equation between two kicks, and how long that is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flow {
    /// C/M (1/s).
    pub decay: f32,
    /// Length of a step (s).
    pub dt: f32,
    /// A: way of a rate of one (s).
    pub reach: f32,
    /// B: what damping leaves of a rate.
    pub keep: f32,
}

/// The two losses a(x) and b(x) of a drift.
///
/// ```text
/// x = A·ω                           way of the drift by damping alone (rad)
/// θ ← θ + x − a(x)                  a: what f takes from the way
/// x ← B·x − b(x) + kick             b: what f takes from the next one
/// ```
///
/// A friction that stops the actuator within a step takes exactly the remaining rate. Where it
/// sticks, the creep is approximate, because the kick comes before the stop, so a step must not
/// take much of the rate ([`crate::prepared::plan`]).
///
/// Nodes lie as an `f32` does, eight octaves with eight chords each (four where the two
/// directions differ), a chord through zero below them and the last chord beyond them. Two
/// numbers of sixteen bits a node: 264 bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glide {
    /// Losses of way and of rate at each node, in units; while they are prepared, the bits
    /// of the deceleration there.
    nodes: [[i16; 2]; NODES],
    /// Losses below the lowest node, of what there is to lose: a row a direction.
    sticking: [[f32; 2]; 2],
    /// Worth of a 256th of a unit (rad).
    unit: f32,
    /// The biased exponent of the lowest octave.
    lowest: u8,
    /// Whether the directions differ.
    sided: bool,
    stage: Stage,
    /// The next node.
    node: u8,
    march: March,
}

/// How far the preparation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Forces,
    Losses,
    Complete,
}

/// A glide on its way from a node downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
struct March {
    /// The node that it has come to.
    at: u8,
    /// Time that is left (s).
    time: f32,
    /// ∫x dt so far (rad·s).
    area: f32,
}

impl Glide {
    /// Room for a table. No constant, which a board would keep in its memory beside it.
    #[inline(always)]
    pub fn empty() -> Self {
        Self {
            nodes: [[0; 2]; NODES],
            sticking: [[0.0; 2]; 2],
            unit: 0.0,
            lowest: 1,
            sided: false,
            stage: Stage::Complete,
            node: 0,
            march: March {
                at: 0,
                time: 0.0,
                area: 0.0,
            },
        }
    }

    /// Begins a table for ways up to `farthest` (rad), with one row for both directions
    /// unless they are `sided`.
    pub fn restart(&mut self, farthest: f32, sided: bool) {
        let [_, _, b2, b3] = farthest.to_bits().to_le_bytes();
        let top = (b3 << 1) | (b2 >> 7);
        self.lowest = top.saturating_sub(OCTAVES - 1).max(1);
        self.sided = sided;
        self.stage = Stage::Forces;
        self.node = 0;
        self.unit = 0.0;
    }

    /// Chords of an octave.
    fn fineness(&self) -> u8 {
        if self.sided { 4 } else { 8 }
    }

    /// Nodes of one direction.
    fn length(&self) -> u8 {
        OCTAVES * self.fineness() + 1
    }

    /// The way (rad) at a node of a direction.
    #[inline(never)]
    fn way(&self, node: u8) -> f32 {
        let (octave, chord, shift) = if self.sided {
            (node >> 2, node & 3, 21)
        } else {
            (node >> 3, node & 7, 20)
        };
        let exponent = u32::from(self.lowest) + u32::from(octave);
        f32::from_bits((exponent << 23) | (u32::from(chord) << shift))
    }

    /// Computes a little more, some 30 000 cycles of the board; whether the table is
    /// complete. `deceleration` is f(ω)/M (rad/s²) at a rate (rad/s), zero at rest.
    pub fn prepare(&mut self, flow: &Flow, deceleration: impl FnOnce(f32) -> f32) -> bool {
        /// Chords that a march crosses at a time.
        const CROSSED: u8 = 8;
        match self.stage {
            Stage::Forces => self.force(flow, deceleration),
            Stage::Losses => {
                for _ in 0..CROSSED {
                    if self.cross(flow) {
                        break;
                    }
                }
            }
            Stage::Complete => {}
        }
        self.stage == Stage::Complete
    }

    /// The place and the direction of the node at an index.
    fn place(&self, index: u8) -> (u8, bool) {
        if self.sided && index >= self.length() {
            (index - self.length(), true)
        } else {
            (index, false)
        }
    }

    fn count(&self) -> u8 {
        if self.sided {
            2 * self.length()
        } else {
            self.length()
        }
    }

    /// Notes the deceleration at the next node, both in units of the way.
    #[inline(never)]
    fn force(&mut self, flow: &Flow, deceleration: impl FnOnce(f32) -> f32) {
        let (node, back) = self.place(self.node);
        let way = self.way(node);
        let rate = way / flow.reach;
        let extra = if back {
            -deceleration(-rate)
        } else {
            deceleration(rate)
        } * flow.reach;
        self.note(self.node, extra + flow.decay * way);
        // What is lost in a step is at most what the largest force takes in it.
        let lost = extra.abs() * flow.dt;
        self.unit = if lost > self.unit { lost } else { self.unit };
        self.node += 1;
        if self.node >= self.count() {
            // Never zero, since it divides.
            let largest = self.unit.max(f32::MIN_POSITIVE * FULL * PART);
            self.unit = largest / (FULL * PART);
            self.stage = Stage::Losses;
            self.turn(flow);
        }
    }

    /// Marches on from the next node, from the last one downwards: what lies above is
    /// not needed any more.
    fn turn(&mut self, flow: &Flow) {
        if self.node == 0 {
            self.stage = Stage::Complete;
            return;
        }
        self.node -= 1;
        self.march = March {
            at: self.node,
            time: flow.dt,
            area: 0.0,
        };
    }

    fn note(&mut self, index: u8, deceleration: f32) {
        let [b0, b1, b2, b3] = deceleration.to_bits().to_le_bytes();
        if let Some(node) = self.nodes.get_mut(usize::from(index)) {
            *node = [i16::from_le_bytes([b0, b1]), i16::from_le_bytes([b2, b3])];
        }
    }

    #[inline(never)]
    fn noted(&self, index: u8) -> f32 {
        let [low, high] = self
            .nodes
            .get(usize::from(index))
            .map_or([0; 2], |&node| node);
        let ([b0, b1], [b2, b3]) = (low.to_le_bytes(), high.to_le_bytes());
        f32::from_bits(u32::from_le_bytes([b0, b1, b2, b3]))
    }

    /// Lets a march cross one chord; whether the table is complete.
    #[inline(never)]
    fn cross(&mut self, flow: &Flow) -> bool {
        let March { at, time, area } = self.march;
        let (node, back) = self.place(at);
        let (x, g) = (self.way(node), self.noted(at));
        let (below, g_below) = if node == 0 {
            (0.0, 0.0)
        } else {
            (self.way(node - 1), self.noted(at - 1))
        };
        let width = x - below;
        // Both decelerate: it may cross the whole chord.
        if g > 0.0 && g_below > 0.0 {
            let (needed, covered) = passage(x, g, below, g_below);
            if needed < time {
                self.march = March {
                    at: at - 1,
                    time: time - needed,
                    area: area + covered,
                };
                return false;
            }
        }
        // It ends on this chord, along which the way decays exponentially.
        let z = (g - g_below) / width * time;
        let [decayed, mean] = decays(z);
        let end = (x - g * time * decayed).max(0.0);
        let area = area + (x - g * time * mean) * time;
        let from = self.way(self.place(self.node).0);
        let losses = [from - area / flow.reach, from * flow.keep - end];
        let whole = self.unit * PART;
        // Saturates, which the size of a unit rules out.
        #[expect(clippy::cast_possible_truncation)]
        let units = losses.map(|loss| {
            let units = loss / whole;
            (if units < 0.0 {
                units - 0.5
            } else {
                units + 0.5
            }) as i16
        });
        if let Some(place) = self.nodes.get_mut(usize::from(self.node)) {
            *place = units;
        }
        if self.place(self.node).0 == 0
            && let Some(row) = self.sticking.get_mut(usize::from(back))
        {
            *row = losses.map(|loss| loss / from);
        }
        self.turn(flow);
        self.stage == Stage::Complete
    }

    /// What is taken from the way of a drift and from the next one (rad).
    #[inline]
    pub fn losses(&self, way: f32) -> [f32; 2] {
        let [b0, b1, b2, b3] = way.to_bits().to_le_bytes();
        let octave = ((b3 << 1) | (b2 >> 7)).wrapping_sub(self.lowest);
        if octave >= OCTAVES {
            return self.outside(way);
        }
        let fraction = u16::from_le_bytes([b1, b2]);
        let (index, along) = if self.sided {
            let back = if b3 & 0x80 == 0 { 0 } else { SECOND };
            let chord = usize::from((b2 >> 5) & 3);
            (
                back + usize::from(octave) * 4 + chord,
                (fraction << 3) | u16::from(b0 >> 5),
            )
        } else {
            let chord = usize::from((b2 >> 4) & 7);
            (
                usize::from(octave) * 8 + chord,
                (fraction << 4) | u16::from(b0 >> 4),
            )
        };
        let (Some(from), Some(to)) = (self.nodes.get(index), self.nodes.get(index + 1)) else {
            return [0.0; 2];
        };
        let unit = if b3 & 0x80 == 0 {
            self.unit
        } else {
            -self.unit
        };
        [
            between(from[0], to[0], along) as f32 * unit,
            between(from[1], to[1], along) as f32 * unit,
        ]
    }

    /// Below the nodes and beyond them.
    #[inline(never)]
    fn outside(&self, way: f32) -> [f32; 2] {
        let back = self.sided && way < 0.0;
        let size = if way < 0.0 { -way } else { way };
        if size < self.way(0) {
            let [row, other] = self.sticking;
            let [a, b] = if back { other } else { row };
            return [a * way, b * way];
        }
        let last = self.length() - 1;
        let (top, before) = (self.way(last), self.way(last - 1));
        let part = (size - top) / (top - before);
        let index = usize::from(last) + if back { SECOND } else { 0 };
        let (Some(at), Some(under)) = (self.nodes.get(index), self.nodes.get(index - 1)) else {
            return [0.0; 2];
        };
        let unit = self.unit * if way < 0.0 { -PART } else { PART };
        let beyond = |at: i16, under: i16| {
            let at = f32::from(at);
            (at + (at - f32::from(under)) * part) * unit
        };
        [beyond(at[0], under[0]), beyond(at[1], under[1])]
    }
}

/// 256 times the value at a 65 536th `along` from `from` to `to`.
#[inline]
fn between(from: i16, to: i16, along: u16) -> i32 {
    // At most 32 000 apart, by the size of a unit.
    let rise = to.wrapping_sub(from);
    // Below 2²³.
    #[expect(clippy::cast_possible_wrap)]
    let part = (wide_mul::product(rise.unsigned_abs(), along) >> 8) as i32;
    (i32::from(from) << 8) + if rise < 0 { -part } else { part }
}

/// How long a glide takes from `x` down to `below`, whose decelerations are on a straight
/// line, and ∫x dt over it.
///
/// The flow between neighbouring nodes takes the force as a straight line and is then exact to
/// Simpson's rule, so that preparing needs one evaluation of f a node and no small steps.
#[inline(never)]
fn passage(x: f32, g: f32, below: f32, g_below: f32) -> (f32, f32) {
    let width = x - below;
    if g < 2.0 * g_below && g_below < 2.0 * g {
        let middle = 0.5 * (x + below);
        let [first, mean, last] = [1.0 / g, 8.0 / (g + g_below), 1.0 / g_below];
        let sixth = width / 6.0;
        (
            sixth * (first + mean + last),
            sixth * (x * first + middle * mean + below * last),
        )
    } else {
        let slope = (g - g_below) / width;
        let time = ln(g / g_below) / slope;
        (time, below * time + (width - g_below * time) / slope)
    }
}

/// (1 − e^(−z))/z and (z − 1 + e^(−z))/z²: how far a decay has come, at its end and in
/// the mean. A growth, z < 0, goes no further than e.
#[inline(never)]
pub(crate) fn decays(z: f32) -> [f32; 2] {
    let z = z.max(-1.0);
    if z.abs() < 0.2 {
        let fourth = 1.0 - 0.2 * z;
        let third = 1.0 - 0.25 * z * fourth;
        let second = 1.0 - z * third / 3.0;
        [1.0 - 0.5 * z * second, 0.5 * second]
    } else {
        let decayed = (1.0 - crate::elementary::exp(-z)) / z;
        [decayed, (1.0 - decayed) / z]
    }
}

#[cfg(test)]
#[expect(
    clippy::cast_possible_truncation,
    clippy::float_cmp,
    reason = "the board's arithmetic beside `f64`, and what is exact"
)]
mod tests {
    use super::*;

    const DT: f32 = 0.01;

    fn flow(decay: f32) -> Flow {
        let keep = (-decay * DT).exp();
        let reach = if decay > 0.0 {
            (1.0 - keep) / decay
        } else {
            DT
        };
        Flow {
            decay,
            dt: DT,
            reach,
            keep,
        }
    }

    fn table(flow: &Flow, farthest_rate: f32, sided: bool, f: impl Fn(f32) -> f32) -> Glide {
        let mut glide = Glide::empty();
        glide.restart(farthest_rate * flow.reach, sided);
        while !glide.prepare(flow, &f) {}
        glide
    }

    /// Way and rate (rad, rad/s) after a glide, by ten thousand small steps in `f64`.
    fn reference(flow: &Flow, rate: f64, f: impl Fn(f64) -> f64) -> [f64; 2] {
        const STEPS: u32 = 20_000;
        let h = f64::from(flow.dt) / f64::from(STEPS);
        let slope = |rate: f64| -f64::from(flow.decay) * rate - f(rate);
        let (mut way, mut rate) = (0.0, rate);
        for _ in 0..STEPS {
            let middle = rate + 0.5 * h * slope(rate);
            rate += h * slope(middle);
            way += h * middle;
        }
        [way, rate]
    }

    /// The largest errors of way (of A times the farthest rate) and of rate, of what the
    /// law takes at most.
    fn worst(flow: &Flow, farthest: f32, sided: bool, f: impl Fn(f64) -> f64) -> [f64; 2] {
        let glide = table(flow, farthest, sided, |rate| {
            let [rate] = [f64::from(rate)];
            f(rate) as f32
        });
        let mut rows = Vec::new();
        let mut rate = farthest / 700.0;
        while rate < 1.5 * farthest {
            for rate in [rate, -rate] {
                let x = rate * flow.reach;
                let [a, b] = glide.losses(x);
                let moved = f64::from(x - a);
                let left = f64::from((x * flow.keep - b) / flow.reach);
                let [way, after] = reference(flow, f64::from(rate), &f);
                rows.push([
                    moved - way,
                    left - after,
                    f64::from(x) - way,
                    f64::from(rate) - after,
                ]);
            }
            rate *= 1.17;
        }
        let largest = |k: usize| {
            rows.iter()
                .fold(0.0_f64, |largest, row| largest.max(row[k].abs()))
        };
        [largest(0) / largest(2), largest(1) / largest(3)]
    }

    /// Dry friction from one that hardly slows a step to one that stops it in a
    /// fiftieth of its length.
    #[test]
    fn dry_friction_is_taken_as_a_fine_integration_takes_it() {
        let (width, decay) = (0.02, 2.0);
        for strength in [0.01, 0.1, 1.0, 10.0, 100.0] {
            let f = |rate: f64| strength * (rate / width).tanh();
            let [way, rate] = worst(&flow(decay), 0.12, false, f);
            println!("{strength} rad/s²: {way:.1e} {rate:.1e}");
            assert!(way < 4e-3 && rate < 4e-3, "{strength}: {way} {rate}");
        }
    }

    /// A friction with a peak, one with two sides, a drag.
    #[test]
    fn other_laws_of_the_rate_too() {
        let stribeck =
            |rate: f64| (0.5 + (-(rate / 0.1).powi(2)).exp()) * (10.0 * rate / 0.1).tanh();
        let [way, rate] = worst(&flow(1.0), 0.3, false, stribeck);
        assert!(way < 1e-2 && rate < 1e-2, "Stribeck: {way} {rate}");
        let sided = |rate: f64| if rate < 0.0 { 3.0 * rate } else { 0.0 };
        let [way, rate] = worst(&flow(1.0), 8.0, true, sided);
        assert!(way < 1e-3 && rate < 1e-3, "sided: {way} {rate}");
        let drag = |rate: f64| 0.8 * rate * rate.abs();
        let [way, rate] = worst(&flow(0.0), 8.0, false, drag);
        assert!(way < 4e-3 && rate < 4e-3, "drag: {way} {rate}");
    }

    /// Where friction sticks, nothing turns round, and what is left decays.
    #[test]
    fn friction_stops_and_never_reverses() {
        let flow = flow(0.5);
        let glide = table(&flow, 0.1, false, |rate| 50.0 * (rate / 0.02).tanh());
        let mut x = 0.2 * flow.reach;
        for _ in 0..40 {
            let [_, b] = glide.losses(x);
            let left = x * flow.keep - b;
            // Half a unit may be left over.
            let rounding = glide.unit * PART;
            assert!(left >= -rounding && left <= x + rounding, "{x} {left}");
            x *= 0.8;
        }
        for x in [0.0, 1e-9, 1e-7] {
            let [a, b] = glide.losses(x);
            assert!(a <= x && b <= x, "{x}: {a} {b}");
        }
    }

    #[test]
    fn odd_where_the_law_is_odd_and_zero_at_rest() {
        let flow = flow(0.5);
        let glide = table(&flow, 0.1, false, |rate| 2.0 * (rate / 0.02).tanh());
        for x in [0.0, 1e-8, 1e-5, 3e-4, 0.001, 0.1] {
            let [a, b] = glide.losses(x);
            assert_eq!(glide.losses(-x), [-a, -b], "{x}");
        }
        assert_eq!(glide.losses(0.0), [0.0; 2]);
        assert!(glide.losses(f32::NAN)[0].is_nan());
    }

    /// A law that drives, and one that balances the damping at some rate.
    #[test]
    fn a_law_that_drives_stays_finite() {
        let flow = flow(1.0);
        for strength in [0.1_f32, 5.0, 80.0] {
            let glide = table(&flow, 3.0, false, |rate| {
                -strength * rate / (0.5 + rate.abs())
            });
            let mut x = 0.01 * flow.reach;
            for _ in 0..500 {
                let [_, b] = glide.losses(x);
                x = x * flow.keep - b;
                assert!(x.is_finite() && x > 0.0, "{strength}: {x}");
            }
        }
    }
}
