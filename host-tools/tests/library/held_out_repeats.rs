//! Whether runs that were held out only repeat what was fitted: there, less is
//! believed of an explanation.

use std::path::Path;

use softrig::diagnose::evidence::validation::CrossValidator;
use softrig::estimate::assemble::assemble;
use softrig::estimate::fitter::Fitter;
use softrig::synth::example::{Hidden, make};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;

/// Whether a judge that holds out `held_out`, or else `fitted` in turn, sees only
/// repeats.
fn sees_only_repeats(file: &ModelFile, fitted: &[Recording], held_out: &[Recording]) -> bool {
    let data = assemble(fitted, held_out).unwrap().data;
    let fitter = Fitter::new(&file.model, &data);
    CrossValidator::new(file, &fitter, 0.0).has_only_repeats()
}

#[test]
fn repeats_are_told_from_other_runs() {
    let example = make(Hidden::Nothing, 0.3, 5).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let of = |prefix: &str| -> Vec<Recording> {
        example
            .recordings
            .iter()
            .filter(|(name, ..)| name.starts_with(prefix))
            .map(|(_, recording, _)| recording.clone())
            .collect()
    };
    let (low, high) = (of("step60_"), of("step90_"));
    assert!(low.len() >= 2 && high.len() >= 2);
    let both = [low.clone(), high.clone()].concat();

    // In turn: two amplitudes are too few to leave one out with its repeats.
    assert!(sees_only_repeats(&file, &both, &[]));
    let alone = [low.clone(), high[..1].to_vec()].concat();
    assert!(!sees_only_repeats(&file, &alone, &[]));

    // Given: a repeat of what was fitted, and another amplitude.
    assert!(sees_only_repeats(&file, &low[1..], &low[..1]));
    assert!(!sees_only_repeats(&file, &low, &high));
    let mixed = [low[..1].to_vec(), high].concat();
    assert!(!sees_only_repeats(&file, &low[1..], &mixed));
}
