//! Effects act independently of the order in which a model lists them.
//!
//! Forces add, factors of a parameter multiply, lag and dead time commute
//! because both are linear and do not change with time, offsets add. Only
//! rounding may tell one order from the other. Two effects on the same path do
//! not commute where one bends what the other delays: there the order of the
//! model is the order of the path.

use model_core::actuator::Model;
use model_core::catalogue::{Effect, Kind};
use model_core::effects::Place;
use model_core::input::Held;
use model_core::integrate::Scheme;

use crate::support::{F64, lively, run, sample_effects, sample_values, varied_pressure_pa};

const DT_S: f64 = 2e-3;
const STEPS: u32 = 2_500;
/// Of all pairs of effects in two sizes each, which ones are tried: odd, so that
/// both sizes come up.
const PAIR_STRIDE: usize = 3;

fn model(effects: &[Effect<f64>]) -> Model<f64> {
    Model::new(lively(), effects).expect("within bounds")
}

/// Readings of a run that starts at rest in balance with its first pressure.
fn readings(model: &Model<f64>, pressure_pa: impl Fn(f64) -> f64, steps: u32) -> Vec<f64> {
    let start = model.at_rest(0.25, pressure_pa(0.0));
    let mut readings = Vec::new();
    run(
        Scheme::Rk4,
        model,
        start,
        pressure_pa,
        (DT_S, steps),
        F64,
        |_, state| {
            readings.push(model.reading(state));
        },
    );
    readings
}

/// Whether two effects on the same path act alike in either order.
fn commute(first: Kind, second: Kind) -> bool {
    use Kind::{
        DeadTime, InputBacklash, Leak, PneumaticLag, PressureThreshold, SecondMode, SensorDrift,
        SensorLag, SensorNonlinearity, VentAsymmetry,
    };
    // A leak is linear, but starts with nothing lost.
    let bends_input = |kind| {
        matches!(
            kind,
            VentAsymmetry | PressureThreshold | InputBacklash | Leak
        )
    };
    let adds_to_reading = |kind| matches!(kind, SecondMode | SensorDrift);
    let same_path = first.info().place == second.info().place;
    let either = |is: fn(Kind) -> bool| is(first) || is(second);
    if !same_path || either(|kind| kind == DeadTime) {
        return true;
    }
    match first.info().place {
        Place::Input => {
            !(bends_input(first) || bends_input(second)) || {
                // Lags alone are left, and they commute.
                matches!((first, second), (PneumaticLag, PneumaticLag))
            }
        }
        Place::Force => true,
        Place::Sensor => {
            !either(|kind| kind == SensorNonlinearity)
                && !(either(|kind| kind == SensorLag)
                    && (adds_to_reading(first) || adds_to_reading(second)))
        }
    }
}

/// A model has room for one.
fn are_two_tables(first: Effect<f64>, second: Effect<f64>) -> bool {
    [first, second].map(|effect| effect.kind()) == [Kind::Table; 2]
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    // A NaN must not hide.
    differences.fold(0.0, |largest, x| if x <= largest { largest } else { x })
}

#[test]
fn order_of_two_effects_does_not_matter() {
    let mut worst = (0.0, String::new());
    let alone: Vec<_> = sample_effects()
        .map(|effect| {
            (
                effect,
                readings(&model(&[effect]), varied_pressure_pa, STEPS),
            )
        })
        .collect();
    for (k, (first, alone_first)) in alone.iter().enumerate() {
        for (second, alone_second) in alone.iter().skip(k + 1).step_by(PAIR_STRIDE) {
            let (first, second) = (*first, *second);
            if are_two_tables(first, second) {
                continue;
            }
            let there = readings(&model(&[first, second]), varied_pressure_pa, STEPS);
            let back = readings(&model(&[second, first]), varied_pressure_pa, STEPS);
            let apart = largest_difference(&there, &back);
            let names = format!("{} and {}", first.kind().name(), second.kind().name());
            let commute = commute(first.kind(), second.kind());
            assert!(apart < 1e-12 || !commute, "{names}: {apart} rad");
            if commute && apart >= worst.0 {
                worst = (apart, names);
            }

            // Neither is left out when there are two.
            for alone in [alone_first, alone_second] {
                assert!(
                    largest_difference(&there, alone) > 1e-3,
                    "{first:?}, {second:?}"
                );
            }
        }
    }
    println!(
        "order of two effects: {:.1e} rad apart, {}",
        worst.0, worst.1
    );
}

#[test]
fn forces_of_two_effects_add() {
    let forces: Vec<_> = sample_effects()
        .filter(|effect| effect.kind().info().place == Place::Force)
        // What changes a parameter multiplies instead.
        .filter(|effect| {
            !matches!(
                effect.kind(),
                Kind::ExponentShift
                    | Kind::AngleDependentDamping
                    | Kind::AsymmetricDamping
                    | Kind::StiffnessDrift
                    | Kind::MullinsSoftening
                    | Kind::PressureStiffening
            )
        })
        .collect();
    let acceleration = |effects: &[Effect<f64>]| {
        let model = model(effects);
        // Moving, and with hidden states that have not relaxed.
        let mut state = model.moving(0.8, -0.6, 40_000.0);
        state.angle = 0.6;
        for hidden in &mut state.hidden {
            hidden[0] += 0.1;
        }
        model.derivative(&state, &Held(40_000.0), 0.0).acceleration
    };
    let none = acceleration(&[]);
    for &first in &forces {
        assert!((acceleration(&[first]) - none).abs() > 1e-3, "{first:?}");
        for &second in &forces {
            if are_two_tables(first, second) {
                continue;
            }
            let sum = acceleration(&[first]) + acceleration(&[second]) - none;
            assert!((acceleration(&[first, second]) - sum).abs() < 1e-12);
        }
    }
}

/// In a linear plant at rest, a dead time may be moved from the input to the
/// output: behind the lag or before it, the run is the lagged one, shifted.
#[test]
fn lag_and_dead_time_commute_in_a_linear_plant() {
    let linear = |effects: &[Effect<f64>]| {
        let mut dynamics = lively();
        dynamics.exponent = 1.0;
        Model::new(dynamics, effects).expect("within bounds")
    };
    // A smooth start from zero, so that no corner depends on the grid.
    let pressure_pa = |time: f64| {
        if time > 0.0 {
            40_000.0 * (1.0 - (-time * time).exp()) * (2.0 * time).cos()
        } else {
            0.0
        }
    };
    let from_zero = |model: &Model<f64>, steps: u32| {
        let mut angles = Vec::new();
        let start = model.at_rest(0.0, 0.0);
        run(
            Scheme::Rk4,
            model,
            start,
            pressure_pa,
            (DT_S, steps),
            F64,
            |_, state| {
                angles.push(state.angle);
            },
        );
        angles
    };
    let lag = Kind::PneumaticLag.build(&[0.15]).unwrap();
    let late_steps = 125;
    let dead = Kind::DeadTime
        .build(&[DT_S * f64::from(late_steps)])
        .unwrap();

    let lagged = from_zero(&linear(&[lag]), STEPS);
    for effects in [[lag, dead], [dead, lag]] {
        let both = from_zero(&linear(&effects), STEPS + late_steps);
        let (before, after) = both.split_at(usize::try_from(late_steps).expect("few steps"));
        assert!(before.iter().all(|angle| angle.abs() < 1e-15));
        let apart = largest_difference(after, &lagged);
        assert!(apart < 1e-10, "{effects:?}: {apart} rad");
    }
}

/// Two of a kind: shifts, delays, offsets and forces add up.
#[test]
fn two_of_a_kind_are_one_with_the_sum() {
    for (kind, first, second, sum) in [
        (Kind::QuadraticDamping, &[0.4][..], &[0.3][..], &[0.7][..]),
        (
            Kind::Gravity,
            &[0.8, 0.3, 0.1, 0.5],
            &[-0.2, 0.3, 0.1, 0.5],
            &[0.6, 0.3, 0.1, 0.5],
        ),
        (Kind::CubicStiffness, &[0.5], &[-0.2], &[0.3]),
        (Kind::ExponentShift, &[0.4], &[-0.7], &[-0.3]),
        (
            Kind::MaxwellBranch,
            &[0.5, 0.7, 0.3],
            &[0.4, 0.7, 0.3],
            &[0.9, 0.7, 0.3],
        ),
        (Kind::DeadTime, &[0.1], &[0.25], &[0.35]),
        (Kind::SensorOffset, &[0.1], &[-0.25], &[-0.15]),
        (Kind::SensorDrift, &[0.01], &[-0.03], &[-0.02]),
        (Kind::LinearStiffness, &[0.3], &[0.5], &[0.8]),
        (Kind::EndStop, &[2.0, 0.5], &[1.0, 0.5], &[3.0, 0.5]),
        (
            Kind::BoucWenHysteresis,
            &[0.2, 0.1, 0.2],
            &[0.1, 0.1, 0.2],
            &[0.3, 0.1, 0.2],
        ),
        (Kind::PressureThreshold, &[4e3], &[7e3], &[11e3]),
        (Kind::InputBacklash, &[4e3], &[3e3], &[7e3]),
    ] {
        assert_eq!(first.len(), sample_values(kind)[0].len());
        let of = |values: &[f64]| kind.build(values).expect("as many as in the table");
        let two = readings(&model(&[of(first), of(second)]), varied_pressure_pa, STEPS);
        let one = readings(&model(&[of(sum)]), varied_pressure_pa, STEPS);
        let apart = largest_difference(&two, &one);
        assert!(apart < 1e-12, "{kind:?}: {apart} rad");
    }
}
