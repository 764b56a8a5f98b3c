//! Recordings that a cable, a sensor or a logger made dirty get the answer of the clean ones, and
//! what was left out of them is said.

use std::path::Path;

use model_core::catalogue::Kind;
use softrig::diagnose::{Diagnosis, Job, Request, diagnose};
use softrig::synth::example::{Hidden, make};
use softrig_bench::invariance::ways::Way;
use softrig_formats::left_out::What;
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::{Recording, to_csv};

const COLUMNS: [&str; 3] = ["time_s", "pressure_kpa", "angle_deg"];

/// As many runs as a diagnosis needs to name the effect.
const RUNS: usize = 6;

fn asked(way: Way) -> Diagnosis {
    let example = make(Hidden::Effect(Kind::CoulombFriction), 0.3, 5).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let recordings: Vec<Recording> = example.recordings[..RUNS]
        .iter()
        .map(|(name, recording, _)| {
            let (text, _) = way.recording(&to_csv(recording, &[]), COLUMNS).unwrap();
            Recording::parse(&text, Path::new(name)).unwrap().0
        })
        .collect();
    let request = Request::of(&file, &recordings);
    diagnose(&request, &Job::default()).unwrap()
}

/// One of each kind: a channel, rows, the clock.
#[test]
fn dirt_does_not_change_the_answer_and_is_said() {
    let plain = asked(Way::Plain);
    assert_eq!(plain.finding.named(), [Kind::CoulombFriction]);
    assert_eq!(plain.not_used, []);
    for (way, what) in [
        (Way::Spike, What::ImpossibleAngle),
        (Way::WildPressure, What::ImpossiblePressure),
        (Way::Held, What::HeldRow),
        (Way::Bursts, What::RebuiltClock),
    ] {
        let dirty = asked(way);
        assert_eq!(dirty.finding.named(), plain.finding.named(), "{way:?}");
        let said: Vec<What> = dirty.not_used.iter().map(|it| it.what).collect();
        assert_eq!(said, [what; RUNS], "{way:?}");
        let floor = dirty.floor.rms / plain.floor.rms;
        assert!(
            (0.8..1.25).contains(&floor),
            "{way:?}: the floor is {floor} times as high"
        );
    }
}
