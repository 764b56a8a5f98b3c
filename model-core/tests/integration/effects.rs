//! Every effect against its equation, written a second time.
//!
//! Nothing here calls the code of an effect to say what it should do: the
//! equations of motion are written out from the papers' formulas and solved by
//! the independent solver. A sign, a factor or a forgotten hidden state shows.

use model_core::actuator::Model;
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::integrate::Scheme;
use model_core::power::{Exact, Minimax, Power};
use model_core::real::Real;

use crate::solver::{Values, solve};
use crate::support::{
    ANGLE_NODES, F32, F64, RATE_NODES, Scalar, effect_of, lively, run, sample_effects,
    sample_values, varied_pressure_pa,
};

const DURATION_S: u32 = 10;
/// Comparisons a second.
const LOOKS: u32 = 20;
const START_RAD: f64 = 0.25;

/// A right-hand side: time (s) and state to rates.
type Equations = Box<dyn Fn(f64, &Values) -> Values>;

/// M θ̈ = g p − C ω − K sign(θ)|θ|ⁿ − Q, solved for θ̈ (rad/s²).
fn acceleration(d: &Dynamics<f64>, chamber_pa: f64, at: &Values, q: f64) -> f64 {
    let spring = d.stiffness * at[0].abs().powf(d.exponent) * at[0].signum();
    (d.input_gain * chamber_pa - d.damping * at[1] - spring - q) / d.inertia
}

/// The right-hand side with the effect of `kind`, from its equation alone.
#[expect(
    clippy::too_many_lines,
    reason = "one arm an effect, its equation in it"
)]
fn equations(kind: Kind, values: &'static [f64]) -> Equations {
    let d = lively();
    let force = move |q: fn(&[f64], &Values) -> f64| -> Equations {
        Box::new(move |time, at| {
            let q = q(values, at);
            [
                at[1],
                acceleration(&d, varied_pressure_pa(time), at, q),
                0.0,
                0.0,
            ]
        })
    };
    match kind {
        // Q = T tanh(ω/ω_s)
        Kind::CoulombFriction => force(|v, at| v[0] * (at[1] / v[1]).tanh()),
        // Q = d ω|ω|
        Kind::QuadraticDamping => force(|v, at| v[0] * at[1] * at[1].abs()),
        // Q = G [sin(θ + θ₀) − sin θ₀]
        Kind::Gravity => force(|v, at| v[0] * ((v[3] * at[0] + v[1] + v[2]).sin() - v[1].sin())),
        // Q = k₃ θ³
        Kind::CubicStiffness => force(|v, at| v[0] * at[0].powi(3)),
        // n → n + Δn
        Kind::ExponentShift => {
            let shifted = Dynamics {
                exponent: d.exponent + values[0],
                ..d
            };
            Box::new(move |time, at| {
                [
                    at[1],
                    acceleration(&shifted, varied_pressure_pa(time), at, 0.0),
                    0.0,
                    0.0,
                ]
            })
        }
        // Q = k₁ [(1 − s)(θ − z) + s(θ − z₂)], ż = (θ − z)/τ, ż₂ = (θ − z₂)/(10 τ)
        Kind::MaxwellBranch => Box::new(move |time, at| {
            let (fast, slow) = (at[0] - at[2], at[0] - at[3]);
            let q = values[0] * ((1.0 - values[2]) * fast + values[2] * slow);
            let acceleration = acceleration(&d, varied_pressure_pa(time), at, q);
            let rates = [fast / values[1], slow / (10.0 * values[1])];
            [at[1], acceleration, rates[0], rates[1]]
        }),
        // τ ṗ_c = p − p_c
        Kind::PneumaticLag => Box::new(move |time, at| {
            let filling = (varied_pressure_pa(time) - at[2]) / values[0];
            [at[1], acceleration(&d, at[2], at, 0.0), filling, 0.0]
        }),
        // p_c(t) = p(t − t_d)
        Kind::DeadTime => Box::new(move |time, at| {
            let late = varied_pressure_pa(time - values[0]);
            [at[1], acceleration(&d, late, at, 0.0), 0.0, 0.0]
        }),
        // y = θ + b, y = θ + c θ², y = θ + r t: nothing moves differently.
        Kind::SensorOffset | Kind::SensorNonlinearity | Kind::SensorDrift => force(|_, _| 0.0),
        // Q = [T + ΔT e^(−(ω/ω_S)²)] tanh(10 ω/ω_S)
        Kind::StribeckFriction => force(|v, at| {
            let peak = v[1] * (-(at[1] / v[2]).powi(2)).exp();
            (v[0] + peak) * (10.0 * at[1] / v[2]).tanh()
        }),
        // C → C(1 + c₁|θ|), and never below zero
        Kind::AngleDependentDamping => {
            force(|v, at| lively().damping * (v[0] * at[0].abs()).max(-1.0) * at[1])
        }
        // C → C(1 + a) where ω < 0
        Kind::AsymmetricDamping => force(|v, at| lively().damping * v[0] * at[1].min(0.0)),
        // Q = k θ
        Kind::LinearStiffness => force(|v, at| v[0] * at[0]),
        // Q = k_s max(θ − θ_s, 0)
        Kind::EndStop => force(|v, at| {
            if at[0] > v[1] {
                v[0] * (at[0] - v[1])
            } else {
                0.0
            }
        }),
        // Q = a w, D ẇ = ω − ½|ω|w − B ω|w|
        Kind::BoucWenHysteresis => Box::new(move |time, at| {
            let acceleration = acceleration(&d, varied_pressure_pa(time), at, values[0] * at[2]);
            let w_rate = at[1] - 0.5 * at[1].abs() * at[2] - values[2] * at[1] * at[2].abs();
            [at[1], acceleration, w_rate / values[1], 0.0]
        }),
        // K → K(1 + ρ t)
        Kind::StiffnessDrift => Box::new(move |time, at| {
            let drifted = Dynamics {
                stiffness: d.stiffness * (1.0 + values[0] * time),
                ..d
            };
            let pressure = varied_pressure_pa(time);
            [at[1], acceleration(&drifted, pressure, at, 0.0), 0.0, 0.0]
        }),
        // K → K[1 − δ(1 − e^(−θ_max/θ_m))]; θ_max grows with |θ| when it is less.
        Kind::MullinsSoftening => Box::new(move |time, at| {
            let largest = at[2].max(at[0].abs());
            let lost = values[0] * (1.0 - (-largest / values[1]).exp());
            let softened = Dynamics {
                stiffness: d.stiffness * (1.0 - lost),
                ..d
            };
            let growing = at[0].abs() >= at[2] && at[0] * at[1] > 0.0;
            let growth = if growing { at[1].abs() } else { 0.0 };
            let pressure = varied_pressure_pa(time);
            [
                at[1],
                acceleration(&softened, pressure, at, 0.0),
                growth,
                0.0,
            ]
        }),
        // K → K(1 + k_p p)
        Kind::PressureStiffening => Box::new(move |time, at| {
            let pressure = varied_pressure_pa(time);
            let stiffened = Dynamics {
                stiffness: d.stiffness * (1.0 + values[0] * pressure),
                ..d
            };
            [at[1], acceleration(&stiffened, pressure, at, 0.0), 0.0, 0.0]
        }),
        // ξ̈ + 2ζ₂ω₂ξ̇ + ω₂²ξ = −b θ̈
        Kind::SecondMode => Box::new(move |time, at| {
            let w = std::f64::consts::TAU * values[0];
            let acceleration = acceleration(&d, varied_pressure_pa(time), at, 0.0);
            let driven = -values[2] * acceleration - 2.0 * values[1] * w * at[3] - w * w * at[2];
            [at[1], acceleration, at[3], driven]
        }),
        // ṗ_c = (p − p_c)/τ, with the τ of the direction
        Kind::VentAsymmetry => Box::new(move |time, at| {
            let missing = varied_pressure_pa(time) - at[2];
            let filling = missing.max(0.0) / values[0] + missing.min(0.0) / values[1];
            [at[1], acceleration(&d, at[2], at, 0.0), filling, 0.0]
        }),
        // F = g max(p − p₀, 0)
        Kind::PressureThreshold => Box::new(move |time, at| {
            let above = (varied_pressure_pa(time) - values[0]).max(0.0);
            [at[1], acceleration(&d, above, at, 0.0), 0.0, 0.0]
        }),
        // p_c stays until p is b away from it.
        Kind::InputBacklash => {
            let play = play(values[0]);
            Box::new(move |time, at| [at[1], acceleration(&d, play(time), at, 0.0), 0.0, 0.0])
        }
        // p_c = p − z, ż = (p − z)/τ_L
        Kind::Leak => Box::new(move |time, at| {
            let chamber = varied_pressure_pa(time) - at[2];
            [
                at[1],
                acceleration(&d, chamber, at, 0.0),
                chamber / values[0],
                0.0,
            ]
        }),
        // τ ẏ = θ − y
        Kind::SensorLag => Box::new(move |time, at| {
            let acceleration = acceleration(&d, varied_pressure_pa(time), at, 0.0);
            [at[1], acceleration, (at[0] - at[2]) / values[0], 0.0]
        }),
        // Q = A sin(2πft + φ)
        Kind::PeriodicDisturbance => Box::new(move |time, at| {
            let q = values[0] * (std::f64::consts::TAU * values[1] * time + values[2]).sin();
            let acceleration = acceleration(&d, varied_pressure_pa(time), at, q);
            [at[1], acceleration, values[1], 0.0]
        }),
        // Straight lines between the nodes.
        Kind::Table if values.len() == 6 => force(|v, at| interpolated(&RATE_NODES, v, at[1])),
        Kind::Table => force(|v, at| interpolated(&ANGLE_NODES, v, at[0])),
        _ => panic!("{}: write its equation here a second time", kind.name()),
    }
}

/// The straight line through the nodes around `x`, the end value beyond them: the
/// sum of what each piece adds.
fn interpolated(nodes: &[f32], forces: &[f64], x: f64) -> f64 {
    let pieces = nodes.windows(2).zip(forces.windows(2));
    let risen = pieces.map(|(ends, at_ends)| {
        let [start, end] = [ends[0], ends[1]].map(f64::from);
        (at_ends[1] - at_ends[0]) * ((x - start) / (end - start)).clamp(0.0, 1.0)
    });
    forces[0] + risen.sum::<f64>()
}

/// The output of a play of half-width `b` (Pa) under the varied pressure: each
/// extreme pushes it on, so all it takes is a fine enough grid to find them.
fn play(b: f64) -> impl Fn(f64) -> f64 {
    const GRID: f64 = 1e-5;
    let mut outputs = vec![varied_pressure_pa(0.0)];
    for k in 1..=DURATION_S * 100_000 {
        let pressure = varied_pressure_pa(f64::from(k) * GRID);
        let before = outputs.last().copied().expect("it has a first");
        outputs.push(f64::clamp(before, pressure - b, pressure + b));
    }
    move |time| {
        let pressure = varied_pressure_pa(time);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let before = (time.max(0.0) / GRID) as usize;
        let before = outputs[before.min(outputs.len() - 1)];
        f64::clamp(before, pressure - b, pressure + b)
    }
}

/// What an effect remembers at the start: dashpots and chamber have settled.
fn hidden_start(kind: Kind) -> [f64; 2] {
    match kind {
        Kind::PneumaticLag | Kind::VentAsymmetry => [varied_pressure_pa(0.0), 0.0],
        Kind::MaxwellBranch => [START_RAD; 2],
        Kind::MullinsSoftening | Kind::SensorLag => [START_RAD, 0.0],
        _ => [0.0; 2],
    }
}

/// What the sensor shows (rad) at a time (s).
fn shown(kind: Kind, values: &[f64], time: f64, at: &Values) -> f64 {
    match kind {
        Kind::SensorOffset => at[0] + values[0],
        Kind::SensorNonlinearity => at[0] + values[0] * at[0] * at[0],
        Kind::SensorDrift => at[0] + values[0] * time,
        Kind::SensorLag => at[2],
        Kind::SecondMode => at[0] + at[2],
        _ => at[0],
    }
}

/// Whether the equations have corners that a run passes, which cost every
/// scheme its order.
fn has_corners(kind: Kind) -> bool {
    matches!(
        kind,
        Kind::AngleDependentDamping
            | Kind::AsymmetricDamping
            | Kind::BoucWenHysteresis
            | Kind::EndStop
            | Kind::MullinsSoftening
            | Kind::Table
            | Kind::VentAsymmetry
            | Kind::PressureThreshold
            | Kind::InputBacklash
    )
}

struct Errors {
    reading_rad: f64,
    /// Of the first hidden state, relative to its largest value.
    hidden: f64,
}

fn errors<R: Real, P: Power<R>>(
    kind: Kind,
    values: &'static [f64],
    solution: &[Values],
    rate_hz: u32,
    scalar: Scalar<R>,
) -> Errors {
    let effect = effect_of(kind, values);
    let model: Model<f64> = Model::new(lively(), &[effect]).expect("within bounds");
    let model: Model<R, P> = model.map(scalar.from_f64);
    let start = model.at_rest(
        (scalar.from_f64)(START_RAD),
        (scalar.from_f64)(varied_pressure_pa(0.0)),
    );
    let remembered: Vec<f64> = match kind {
        Kind::InputBacklash => {
            let play = play(values[0]);
            (0..solution.len()).map(|k| play(look_s(k))).collect()
        }
        // Whole turns are taken off.
        Kind::PeriodicDisturbance => solution.iter().map(|at| at[2].fract()).collect(),
        _ => solution.iter().map(|at| at[2]).collect(),
    };
    let scale = remembered.iter().map(|x| x.abs()).fold(1e-9, f64::max);
    let mut errors = Errors {
        reading_rad: 0.0,
        hidden: 0.0,
    };
    run(
        Scheme::Rk4,
        &model,
        start,
        varied_pressure_pa,
        (1.0 / f64::from(rate_hz), rate_hz * DURATION_S),
        scalar,
        |k, state| {
            let every = rate_hz / LOOKS;
            if k.is_multiple_of(every) {
                let look = usize::try_from(k / every).expect("few looks");
                let reading = (scalar.to_f64)(model.reading(state));
                assert!(reading.is_finite());
                let should = shown(kind, values, look_s(look), &solution[look]);
                let reading = (reading - should).abs();
                let hidden = (scalar.to_f64)(state.hidden[0][0]) - remembered[look];
                let hidden = hidden.abs() / scale;
                errors.reading_rad = errors.reading_rad.max(reading);
                errors.hidden = errors.hidden.max(hidden);
            }
        },
    );
    errors
}

/// The time (s) of a comparison.
fn look_s(look: usize) -> f64 {
    look as f64 / f64::from(LOOKS)
}

fn solution(kind: Kind, values: &'static [f64]) -> Vec<Values> {
    let [first, second] = hidden_start(kind);
    solve(
        equations(kind, values),
        [START_RAD, 0.0, first, second],
        1.0 / f64::from(LOOKS),
        LOOKS * DURATION_S,
    )
}

#[test]
fn effects_are_their_equations() {
    // The offset by nothing: the base model under the same pressure.
    let plain = solution(Kind::SensorOffset, &[0.0]);
    for &kind in Kind::ALL {
        for values in sample_values(kind) {
            let name = kind.name();
            let solution = solution(kind, values);
            let desktop = errors::<f64, Exact>(kind, values, &solution, 1_000, F64);
            let board = errors::<f32, Minimax>(kind, values, &solution, 200, F32);
            println!(
                "{name} {values:?}: f64 {:.1e}° (hidden {:.0e}), f32 at 200 Hz {:.1e}° (hidden {:.0e})",
                desktop.reading_rad.to_degrees(),
                desktop.hidden,
                board.reading_rad.to_degrees(),
                board.hidden
            );
            let (of_desktop, of_board) = if has_corners(kind) {
                ((1e-4, 1e-5), (5e-3, 1e-3))
            } else if matches!(kind, Kind::SensorDrift | Kind::PeriodicDisturbance) {
                // Two thousand steps of 5 ms, each rounded to the last place of
                // the time or the phase in `f32`, add up.
                ((1e-7, 1e-9), (2e-3, 5e-5))
            } else {
                ((1e-7, 1e-9), (5e-4, 1e-5))
            };
            assert!(
                desktop.reading_rad.to_degrees() < of_desktop.0,
                "{name} {values:?}"
            );
            assert!(desktop.hidden < of_desktop.1, "{name} {values:?}");
            assert!(
                board.reading_rad.to_degrees() < of_board.0,
                "{name} {values:?}"
            );
            assert!(board.hidden < of_board.1, "{name} {values:?}");

            // An effect that could not be felt would pass without a test.
            let felt = solution
                .iter()
                .zip(&plain)
                .enumerate()
                .map(|(k, (with, without))| shown(kind, values, look_s(k), with) - without[0])
                .map(f64::abs)
                .fold(0.0, f64::max);
            assert!(felt.to_degrees() > 1.0, "{name} {values:?}: {felt} rad");
        }
    }
}

/// The catalogue limits what a shift can do to the exponent.
#[test]
fn shifted_exponent_stays_a_spring() {
    let shift = Kind::ExponentShift.build(&[-3.0]).unwrap();
    let model: Model<f64> = Model::new(lively(), &[shift]).unwrap();
    let expected = lively().stiffness * 0.5_f64.powf(0.25) / lively().input_gain;
    assert!((model.holding_pressure(0.5) / expected - 1.0).abs() < 1e-12);
}

/// Every effect, in every slot, is the same effect: each slot has hidden
/// states of its own.
#[test]
fn slot_of_an_effect_does_not_matter() {
    let offset = Kind::SensorOffset.build(&[0.0]).unwrap();
    for effect in sample_effects() {
        let end = |effects: &[Effect<f64>]| {
            let model: Model<f64> = Model::new(lively(), effects).expect("within bounds");
            let start = model.at_rest(START_RAD, varied_pressure_pa(0.0));
            let timing = (5e-3, 800);
            run(
                Scheme::Rk4,
                &model,
                start,
                varied_pressure_pa,
                timing,
                F64,
                |_, _| {},
            )
        };
        let alone = end(&[effect]);
        let last = end(&[offset, offset, effect]);
        assert_eq!(alone.angle.to_bits(), last.angle.to_bits(), "{effect:?}");
        assert_eq!(alone.rate.to_bits(), last.rate.to_bits(), "{effect:?}");
        assert_eq!(
            alone.hidden[0].map(f64::to_bits),
            last.hidden[2].map(f64::to_bits),
            "{effect:?}"
        );
        assert_eq!(last.hidden[0].map(f64::to_bits), [0; 2], "{effect:?}");
    }
}
