//! An adaptive Runge–Kutta method of order 5(4) from a library: the judge.
//!
//! It shares no line with the crate under test. Equations are handed to it as
//! closures, written out where they are used. It is restarted at every time
//! that is asked for, so an interpolation between its steps never limits a
//! comparison, and no step crosses a corner of the input that lies on such a
//! time.

use ode_solvers::dop_shared::OutputType;
use ode_solvers::{Dopri5, SVector, System};

/// Angle (rad), rate (rad/s) and two hidden states; unused ones stay zero.
pub type Values = [f64; 4];

/// Relative tolerance of a step. The absolute one is a tenth of it.
pub const TOLERANCE: f64 = 1e-12;

struct Equations<'a, F>(&'a F);

impl<F: Fn(f64, &Values) -> Values> System<f64, SVector<f64, 4>> for Equations<'_, F> {
    fn system(&self, time: f64, at: &SVector<f64, 4>, rates: &mut SVector<f64, 4>) {
        *rates = SVector::from((self.0)(time, &at.data.0[0]));
    }
}

/// The solution at every multiple of `interval` (s), from 0 to `count`.
pub fn solve(
    equations: impl Fn(f64, &Values) -> Values,
    start: Values,
    interval: f64,
    count: u32,
) -> Vec<Values> {
    solve_within(TOLERANCE, equations, start, interval, count)
}

fn solve_within(
    tolerance: f64,
    equations: impl Fn(f64, &Values) -> Values,
    start: Values,
    interval: f64,
    count: u32,
) -> Vec<Values> {
    let mut solution = vec![start];
    let mut at = SVector::from(start);
    for k in 0..count {
        let (begin, end) = (f64::from(k) * interval, f64::from(k + 1) * interval);
        let mut solver = Dopri5::new(
            Equations(&equations),
            begin,
            end,
            interval,
            at,
            tolerance,
            0.1 * tolerance,
        );
        solver.set_output(OutputType::Sparse);
        solver.integrate().expect("the equations are not stiff");
        let (times, values) = solver.results().get();
        let reached = times.last().expect("the solver took a step");
        assert!((reached - end).abs() < 1e-12, "{reached} for {end}");
        at = *values.last().expect("a state for every time");
        solution.push(at.data.0[0]);
    }
    solution
}

/// A judge has to be judged: against a solution in closed form, and against
/// itself with a tolerance a hundred times as wide.
#[test]
fn solver_is_far_more_accurate_than_what_it_judges() {
    let swing = |_: f64, at: &Values| [at[1], -9.0 * at[0], 0.0, 0.0];
    let solution = solve(swing, [1.0, 0.0, 0.0, 0.0], 0.1, 100);
    for (k, at) in (0..).zip(&solution) {
        let time = f64::from(k) * 0.1;
        assert!((at[0] - (3.0 * time).cos()).abs() < 1e-10);
        assert!((at[1] + 3.0 * (3.0 * time).sin()).abs() < 3e-10);
    }

    let ludwick = |_: f64, at: &Values| {
        let spring = 1.5 * at[0].abs().powf(1.3) * at[0].signum();
        [at[1], (1.6 - 0.5 * at[1] - spring) / 0.2, 0.0, 0.0]
    };
    let fine = solve_within(1e-13, ludwick, [0.0; 4], 0.1, 100);
    let coarse = solve_within(1e-10, ludwick, [0.0; 4], 0.1, 100);
    let usual = solve(ludwick, [0.0; 4], 0.1, 100);
    let apart = |a: &[Values], b: &[Values]| {
        a.iter()
            .zip(b)
            .map(|(a, b)| (a[0] - b[0]).abs())
            .fold(0.0, f64::max)
    };
    println!(
        "solver: {:.1e} rad from a tolerance of 1e-13, {:.1e} rad with 1e-10",
        apart(&usual, &fine),
        apart(&coarse, &fine)
    );
    assert!(apart(&usual, &fine) < 1e-11);
    assert!(apart(&coarse, &fine) < 1e-8);
}
