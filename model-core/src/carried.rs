//! Linear memories, integrated exactly over a step.
//!
//! A tube, a slow sensor and a Maxwell branch each have one exponential memory. For a fixed
//! step length its factors are constants, prepared once: two multiplications integrate a
//! memory with any time constant, where an explicit scheme would need shorter steps.

use crate::real::Real;

/// E and r of a time constant (s) and a step (s), and 1 − E and 1 − r without loss of
/// digits where the step is short.
struct Factors<R> {
    keep: R,
    lost: R,
    mean: R,
    rest: R,
}

impl<R: Real> Factors<R> {
    fn new(time_constant: R, dt: R) -> Self {
        let x = dt / time_constant;
        let (lost, rest) = if x > R::from_f32(0.02) {
            let lost = R::one() - (-x).exp();
            (lost, R::one() - lost / x)
        } else {
            let [third, quarter, fifth] = [3, 4, 5].map(|n| R::one() / R::from_i16(n));
            let series = |first: R, second: R, last: R| {
                R::one() - x * first * (R::one() - x * second * (R::one() - x * last))
            };
            (
                x * series(R::half(), third, quarter),
                x * R::half() * series(third, quarter, fifth),
            )
        };
        Self {
            keep: R::one() - lost,
            lost,
            mean: R::one() - rest,
            rest,
        }
    }
}

/// A first-order lag, τ·ẏ = x − y: a tube that fills a chamber, a slow sensor.
///
/// With E and r of the time constant τ and the step h, and x linear from x₀ to x₁ over it:
///
/// ```text
/// E = e^(−h/τ)     r = (1 − E)·τ/h
/// y₁ = y₀ + (1 − E)(x₀ − y₀) + (1 − r)(x₁ − x₀)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lag<R> {
    /// 1 − E.
    towards: R,
    /// 1 − r.
    along: R,
}

impl<R: Real> Lag<R> {
    /// Prepares steps of `dt` seconds; the time constant (s) is positive.
    #[inline(never)]
    pub fn new(time_constant: R, dt: R) -> Self {
        let factors = Factors::new(time_constant, dt);
        Self {
            towards: factors.lost,
            along: factors.rest,
        }
    }

    /// Carries a lag to what it follows now; its memory holds it and what it followed before.
    pub fn follow(&self, memory: &mut [R; 2], now: R) -> R {
        let [mut y, before] = *memory;
        self.carry(&mut y, before, now);
        *memory = [y, now];
        y
    }

    /// Carries `y` over a step in which what it follows goes from `before` to `after` in a
    /// straight line.
    #[inline]
    pub fn carry(&self, y: &mut R, before: R, after: R) {
        *y += (before - *y) * self.towards + (after - before) * self.along;
    }
}

/// A force that relaxes, k·d with ḋ = ω − d/τ: a Maxwell branch.
///
/// With E and r as for [`Lag`], and a way s in the step h:
///
/// ```text
/// ω = s/h:   d₁ = E·d₀ + r·s
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch<R> {
    keep: R,
    gain: R,
}

impl<R: Real> Branch<R> {
    /// Prepares steps of `dt` seconds; the time constant (s) is positive. `stiffness` k has
    /// the unit of the force, whatever that is, by radian.
    pub fn new(stiffness: R, time_constant: R, dt: R) -> Self {
        let factors = Factors::new(time_constant, dt);
        Self {
            keep: factors.keep,
            gain: stiffness * factors.mean,
        }
    }

    /// Carries the force over a step in which the actuator moves evenly by `moved` (rad).
    #[inline]
    pub fn carry(&self, force: &mut R, moved: R) {
        *force = *force * self.keep + moved * self.gain;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIME_CONSTANTS: [f64; 5] = [0.002, 0.01, 0.3, 7.0, 400.0];

    /// Behind a ramp a lag stays by the slope times τ, after its transient has died.
    #[test]
    fn lag_follows_a_ramp_exactly_whatever_the_step() {
        for tau in TIME_CONSTANTS {
            for (dt, steps) in [(0.001, 400_u32), (0.01, 40), (0.2, 2)] {
                let lag = Lag::new(tau, dt);
                let ramp = |time: f64| 5.0 + 3.0 * time;
                let mut y = 1.0_f64;
                for k in 0..steps {
                    let before = f64::from(k) * dt;
                    lag.carry(&mut y, ramp(before), ramp(before + dt));
                }
                let time = dt * f64::from(steps);
                let transient = (1.0 - 5.0 + 3.0 * tau) * (-time / tau).exp();
                let expected = ramp(time) - 3.0 * tau + transient;
                assert!(
                    (y - expected).abs() < 1e-9 * tau.max(1.0),
                    "{tau} s, {dt} s: {y}"
                );
            }
        }
    }

    /// Under an even motion the force tends to k·τ·ω; at rest it decays.
    #[test]
    fn branch_is_exact_for_an_even_motion_whatever_the_step() {
        let (stiffness, rate) = (2.0_f64, 1.5);
        for tau in TIME_CONSTANTS {
            for (dt, steps) in [(0.001, 400_u32), (0.01, 40), (0.2, 2)] {
                let branch = Branch::new(stiffness, tau, dt);
                let time = dt * f64::from(steps);
                let mut force = 0.0_f64;
                for _ in 0..steps {
                    branch.carry(&mut force, rate * dt);
                }
                let grown = -stiffness * tau * rate * (-time / tau).exp_m1();
                assert!(
                    (force - grown).abs() < 1e-9 * grown.max(1.0),
                    "{tau} s, {dt} s"
                );
                for _ in 0..steps {
                    branch.carry(&mut force, 0.0);
                }
                let left = grown * (-time / tau).exp();
                assert!(
                    (force - left).abs() < 1e-9 * grown.max(1.0),
                    "{tau} s, {dt} s"
                );
            }
        }
    }

    /// In the board's arithmetic a slow memory is not lost in rounding.
    #[test]
    fn single_precision_keeps_slow_memories() {
        for tau in [10.0_f32, 100.0, 1000.0] {
            let lag = Lag::new(tau, 0.01_f32);
            let mut y = 0.0_f32;
            for _ in 0..1000 {
                lag.carry(&mut y, 1.0, 1.0);
            }
            let expected = -(-10.0 / f64::from(tau)).exp_m1();
            assert!((f64::from(y) / expected - 1.0).abs() < 2e-4, "{tau} s: {y}");
        }
    }
}
