//! How much a diagnosis simulates, so that time does not creep back. Evaluations of the model are
//! counted, which are the same on every computer; alone in its process, since all are counted.

use std::path::Path;

use model_core::catalogue::Kind;
use softrig::diagnose::{Job, Request, diagnose};
use softrig::sim::work::Work;
use softrig::synth::example::{Hidden, make};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;

/// What is hidden, and millions of evaluations that its diagnosis may take: on numbers, and with
/// derivatives. A tenth more than it takes.
const MOST: [(Hidden, f64, f64); 4] = [
    (Hidden::Nothing, 1.5, 6.5),
    (Hidden::Effect(Kind::QuadraticDamping), 4.2, 14.3),
    (Hidden::Effect(Kind::MaxwellBranch), 3.3, 14.0),
    (Hidden::Effect(Kind::BoucWenHysteresis), 4.3, 21.6),
];

#[test]
fn a_diagnosis_simulates_no_more_than_it_did() {
    let mut found = Vec::new();
    let mut is_more = false;
    for (hidden, plain, with_derivatives) in MOST {
        let example = make(hidden, 0.3, 5).unwrap();
        let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
        let recordings: Vec<Recording> = example.recordings.into_iter().map(|it| it.1).collect();
        let request = Request::of(&file, &recordings);
        let before = Work::so_far();
        diagnose(&request, &Job::default()).unwrap();
        let work = Work::so_far() - before;
        let millions = |count: u64| count as f64 / 1e6;
        is_more |= millions(work.plain) > plain;
        is_more |= millions(work.with_derivatives) > with_derivatives;
        found.push((
            hidden,
            millions(work.plain),
            millions(work.with_derivatives),
        ));
    }
    assert!(!is_more, "{found:#?}");
}
