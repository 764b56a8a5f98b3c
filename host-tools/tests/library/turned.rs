//! A rig that was changed between two sessions: turned, so that a weight shows, or with a load at
//! its tip. Nothing else changes.

use std::path::Path;

use model_core::catalogue::Kind;
use model_core::dynamics::Dynamics;
use model_core::effects::gravity::BENDING;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use softrig::diagnose::decide::verdict::Answer;
use softrig::diagnose::experiment::plan::VERY_STRONG;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::estimate::refit::refit;
use softrig::synth::example::{Hidden, make};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;
use softrig_formats::setup::Setup;

/// RMS noise of the angle (°).
const NOISE_DEG: f64 = 0.3;
const SEED: u64 = 6;

/// How a weight pulls, by the angle and by how much the base was turned (rad).
type Pull = dyn Fn(f64, f64) -> f64;

/// A weight G at the end of a rigid arm, as the formula has it.
fn of_an_arm(weight: f64) -> impl Fn(f64, f64) -> f64 {
    move |angle, turned| weight * (angle + turned).sin()
}

/// The weight of an actuator that bends with constant curvature, part by part along it: what is at
/// the share u of its length turns by u θ. The formula knows only its leading term.
fn of_what_bends(weight: f64) -> impl Fn(f64, f64) -> f64 {
    const PARTS: u32 = 40;
    move |angle, turned| {
        let part = |k: u32| {
            let u = (f64::from(k) + 0.5) / f64::from(PARTS);
            6.0 * u * (1.0 - u) * (u * angle + turned).sin()
        };
        weight * (0..PARTS).map(part).sum::<f64>() / f64::from(PARTS)
    }
}

/// What hangs at the tip of an arc: its force (N) on a base turned by a right angle, and its
/// inertia (kg·m), both at the angle zero.
#[derive(Clone, Copy)]
struct Load {
    force: f64,
    inertia: f64,
}

impl Load {
    const NONE: Self = Self {
        force: 0.0,
        inertia: 0.0,
    };

    /// Slopes of where the tip is aside of and below its base, in halves of the length, as sums
    /// along the arc: what is at the share u of it turns by u θ and moves what is behind it.
    fn slopes(angle: f64) -> [f64; 2] {
        const PARTS: u32 = 60;
        let shares = (0..PARTS).map(|k| (f64::from(k) + 0.5) / f64::from(PARTS));
        let sums = shares.fold([0.0; 2], |sums, u| {
            let (sin, cos) = (u * angle).sin_cos();
            [sums[0] + u * cos, sums[1] - u * sin]
        });
        sums.map(|sum| 2.0 * sum / f64::from(PARTS))
    }

    fn pull(&self, angle: f64, turned: f64) -> f64 {
        let [aside, below] = Self::slopes(angle);
        self.force * (aside * turned.sin() - below * turned.cos())
    }

    fn moved(&self, angle: f64) -> f64 {
        self.inertia * Self::slopes(angle).map(|it| it * it).iter().sum::<f64>()
    }
}

/// The angles (rad) of an actuator with a weight and a load, by an integrator of its own, from
/// where it hangs without pressure.
fn angles(
    dynamics: &Dynamics<f64>,
    pull: &Pull,
    load: Load,
    turned: f64,
    run: &Recording,
) -> Vec<f64> {
    const STEPS: u32 = 8;
    let d = dynamics;
    let acceleration = |pressure: f64, [angle, rate]: [f64; 2]| {
        let spring = d.stiffness * angle.abs().powf(d.exponent).copysign(angle);
        let mut force = d.input_gain * pressure - d.damping * rate - spring - pull(angle, turned);
        if load.force == 0.0 {
            return force / d.inertia;
        }
        let slope = (load.moved(angle + 1e-4) - load.moved(angle - 1e-4)) / 2e-4;
        force -= load.pull(angle, turned) + slope * rate * rate / 2.0;
        force / (d.inertia + load.moved(angle))
    };
    let step = |at: [f64; 2], [before, after]: [f64; 2], dt: f64| {
        let slope =
            |at: [f64; 2], share: f64| [at[1], acceleration(before + share * (after - before), at)];
        let along = |by: [f64; 2], dt: f64| [at[0] + by[0] * dt, at[1] + by[1] * dt];
        let k1 = slope(at, 0.0);
        let k2 = slope(along(k1, dt / 2.0), 0.5);
        let k3 = slope(along(k2, dt / 2.0), 0.5);
        let k4 = slope(along(k3, dt), 1.0);
        let mean = [0, 1].map(|k| (k1[k] + 2.0 * (k2[k] + k3[k]) + k4[k]) / 6.0);
        along(mean, dt)
    };
    let mut at = [0.0; 2];
    for _ in 0..20_000 {
        at = step(at, [0.0; 2], 2e-3);
    }
    let mut found = vec![at[0]];
    for k in 1..run.time.len() {
        let dt = (run.time[k] - run.time[k - 1]) / f64::from(STEPS);
        let pressure = |part: u32| {
            let share = f64::from(part) / f64::from(STEPS);
            run.pressure[k - 1] + share * (run.pressure[k] - run.pressure[k - 1])
        };
        for part in 0..STEPS {
            at = step(at, [pressure(part), pressure(part + 1)], dt);
        }
        found.push(at[0]);
    }
    found
}

/// The recordings made anew on a base turned by so much (°).
fn turned(
    dynamics: &Dynamics<f64>,
    pull: &Pull,
    recordings: &[Recording],
    by_deg: f64,
) -> Vec<Recording> {
    loaded(dynamics, pull, Load::NONE, recordings, by_deg)
}

/// The same with a load at the tip.
fn loaded(
    dynamics: &Dynamics<f64>,
    pull: &Pull,
    load: Load,
    recordings: &[Recording],
    by_deg: f64,
) -> Vec<Recording> {
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    let noise = Normal::new(0.0, NOISE_DEG.to_radians()).unwrap();
    recordings
        .iter()
        .map(|recording| {
            let mut turned = recording.clone();
            turned.angle = angles(dynamics, pull, load, by_deg.to_radians(), recording)
                .into_iter()
                .map(|angle| angle + noise.sample(&mut random))
                .collect();
            turned.name = format!("{}_{by_deg}", recording.name);
            turned.path = format!("{}.csv", turned.name).into();
            turned
        })
        .collect()
}

fn said(recordings: Vec<Recording>, setup: &str) -> Vec<Recording> {
    let setup: Setup = setup.parse().unwrap();
    let with = |mut recording: Recording| {
        recording.meta.setup = Some(setup.clone());
        recording
    };
    recordings.into_iter().map(with).collect()
}

fn diagnosis(file: &ModelFile, recordings: &[Recording]) -> Diagnosis {
    let request = Request::of(file, recordings);
    diagnose(&request, &Job::default()).unwrap()
}

/// The model, the true dynamics and the weight of an example, and its steps.
fn example() -> (ModelFile, Dynamics<f64>, f64, Vec<Recording>) {
    let example = make(Hidden::Effect(Kind::Gravity), NOISE_DEG, SEED).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let truth = ModelFile::parse(&example.truth, Path::new("truth.toml")).unwrap();
    let weight = truth.model.effects().next().unwrap().value(0).unwrap();
    let steps = example
        .recordings
        .into_iter()
        .filter(|(name, ..)| name.starts_with("step"))
        .map(|(_, recording, _)| recording)
        .collect();
    (file, *truth.model.dynamics(), weight, steps)
}

#[test]
fn a_turned_rig_shows_its_weight() {
    let (file, dynamics, weight, steps) = example();
    let pull = of_an_arm(weight);
    let upright = turned(&dynamics, &pull, &steps, 0.0);
    let aside = turned(&dynamics, &pull, &steps, 90.0);
    // A static curve is a weight or a spring, whatever the pressure.
    let before = diagnosis(&file, &upright);
    assert_eq!(before.finding.answer(), Answer::CannotTell);
    let rivals = before.finding.explanations();
    assert!(rivals.iter().any(|it| it.kinds == [Kind::Gravity]));
    // The experiment that decides is to turn it.
    let (best, _) = &before.proposals[0];
    assert_eq!(best.protocol.setup.tilt_deg.map(f64::abs), Some(90.0));
    assert!(best.evidence > VERY_STRONG, "{}", best.evidence);
    let both = [upright, said(aside, "tilt_deg=90")].concat();
    let after = diagnosis(&file, &both);
    assert_eq!(after.finding.answer(), Answer::EffectFound);
    assert_eq!(after.finding.named(), [Kind::Gravity]);
    assert!(after.adequacy.exact_form, "{:?}", after.adequacy);
}

/// One lever explains the force and the inertia of all loads, and nothing else is missing.
#[test]
fn a_load_at_the_tip_is_found_with_its_lever() {
    const FORCE_N_PER_KG: f64 = 12.0;
    const LEVER_M: f64 = 2.0;
    let (file, dynamics, _, steps) = example();
    let steps: Vec<Recording> = steps.into_iter().step_by(2).collect();
    let sessions = [(0.0, 0.0), (50.0, 0.0), (50.0, 90.0), (100.0, 90.0)];
    let recordings = sessions.map(|(grams, tilt_deg)| {
        let force = FORCE_N_PER_KG * grams / 1000.0;
        let load = Load {
            force,
            inertia: force * LEVER_M / 9.806_65,
        };
        let made = loaded(&dynamics, &|_, _| 0.0, load, &steps, tilt_deg);
        let mut made = said(made, &format!("tip_load_g={grams},tilt_deg={tilt_deg}"));
        for recording in &mut made {
            recording.name = format!("{}_{grams}", recording.name);
            recording.path = format!("{}.csv", recording.name).into();
        }
        made
    });
    let mut recordings = recordings.concat();
    let found = refit(&file, &recordings).unwrap().fitted;
    let left = found.rmse().to_degrees();
    assert!(left < 1.1 * NOISE_DEG, "{left}");
    let load = found.model.effects().next().unwrap();
    let values: Vec<f64> = load.values().collect();
    assert!(
        (values[0] / FORCE_N_PER_KG - 1.0).abs() < 0.03,
        "{values:?}"
    );
    assert!((values[1] / LEVER_M - 1.0).abs() < 0.2, "{values:?}");
    // Where nothing is said of it, the recordings are not explained.
    for recording in &mut recordings {
        recording.meta.setup = "tilt_deg=0".parse().ok();
    }
    let unsaid = refit(&file, &recordings).unwrap().fitted;
    assert!(unsaid.rmse() > 2.0 * found.rmse());
}

/// The true weight of a bending actuator, which is not the formula's: it is found, and that it
/// turns by half of the angle.
#[test]
fn the_weight_of_what_bends_is_named_too() {
    let (file, dynamics, weight, steps) = example();
    let weight = 2.5 * weight;
    let pull = of_what_bends(weight);
    let upright = turned(&dynamics, &pull, &steps, 0.0);
    let aside = turned(&dynamics, &pull, &steps, 90.0);
    let both = [upright, said(aside, "tilt_deg=90")].concat();
    let found = diagnosis(&file, &both);
    assert_eq!(found.finding.answer(), Answer::EffectFound);
    assert_eq!(found.finding.named(), [Kind::Gravity]);
    let gravity = found.repaired.fit.model.effects().next().unwrap();
    let values: Vec<f64> = gravity.values().collect();
    assert!((values[0] / weight - 1.0).abs() < 0.02, "{values:?}");
    assert_eq!(values[3].to_bits(), f64::from(BENDING).to_bits());
}
