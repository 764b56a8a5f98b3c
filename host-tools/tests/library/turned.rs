//! A rig that was turned between two sessions: the weight shows, and nothing else changes.

use std::path::Path;

use model_core::actuator::Model;
use model_core::catalogue::Kind;
use rand::SeedableRng;
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64Mcg;
use softrig::diagnose::plan::VERY_STRONG;
use softrig::diagnose::verdict::Answer;
use softrig::diagnose::{Diagnosis, Progress, Request, diagnose};
use softrig::sim::simulate::{InitialState, Signal, run};
use softrig::synth::example::{Hidden, make};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;
use softrig_formats::setup::Setup;

/// RMS noise of the angle (°).
const NOISE_DEG: f64 = 0.3;
const SEED: u64 = 6;

/// Where the actuator hangs without pressure (rad), on a base turned by so much.
fn sag(truth: &Model<f64>) -> f64 {
    let time: Vec<f64> = (0..3000).map(|k| f64::from(k) * 0.01).collect();
    let signal = Signal::new(time.clone(), vec![0.0; time.len()]);
    let start = InitialState {
        angle: 0.0,
        rate: 0.0,
    };
    *run(truth, &signal, start, 4).reading.last().unwrap()
}

/// The recordings of an actuator with a weight, made anew on a base turned by so much (°).
fn turned(truth: &Model<f64>, recordings: &[Recording], by_deg: f64) -> Vec<Recording> {
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    let noise = Normal::new(0.0, NOISE_DEG.to_radians()).unwrap();
    let truth = truth.turned(by_deg.to_radians());
    let start = InitialState {
        angle: sag(&truth),
        rate: 0.0,
    };
    recordings
        .iter()
        .map(|recording| {
            let signal = Signal::new(recording.time.clone(), recording.pressure.clone());
            let mut turned = recording.clone();
            turned.angle = run(&truth, &signal, start, 4)
                .reading
                .iter()
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
    let request = Request {
        file,
        recordings,
        holdout: &[],
        own: None,
        seed: 1,
    };
    diagnose(&request, &Progress::default()).unwrap()
}

#[test]
fn a_turned_rig_shows_its_weight() {
    let example = make(Hidden::Effect(Kind::Gravity), NOISE_DEG, SEED).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let truth = ModelFile::parse(&example.truth, Path::new("truth.toml")).unwrap();
    let truth = truth.model;
    let steps: Vec<Recording> = example
        .recordings
        .iter()
        .filter(|(name, ..)| name.starts_with("step"))
        .map(|(_, recording, _)| recording.clone())
        .collect();
    let upright = turned(&truth, &steps, 0.0);
    let aside = turned(&truth, &steps, 90.0);
    // A static curve is a weight or a spring, whatever the pressure.
    let before = diagnosis(&file, &upright);
    assert_eq!(before.finding.answer(), Answer::CannotTell);
    let rivals = before.finding.explanations();
    assert!(rivals.iter().any(|it| it.kinds == [Kind::Gravity]));
    // The experiment that decides is to turn it.
    let (best, _) = &before.proposals[0];
    assert_eq!(best.setup.tilt_deg, Some(90.0));
    assert!(best.evidence > VERY_STRONG, "{}", best.evidence);
    let both = [upright, said(aside, "tilt_deg=90")].concat();
    let after = diagnosis(&file, &both);
    assert_eq!(after.finding.answer(), Answer::EffectFound);
    assert_eq!(after.finding.named(), [Kind::Gravity]);
    assert!(after.adequacy.exact_form, "{:?}", after.adequacy);
}
