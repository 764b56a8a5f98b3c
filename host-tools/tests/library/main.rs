//! The library from outside: searches that end early, exported models, and what the manual says.

mod budget;
mod held_out_repeats;
mod not_for_the_board;
mod sentences;
mod serial_manual;
mod test_runs;
mod tolerance;
mod turned;

use std::path::Path;

use softrig::synth::example::{Hidden, make};
use softrig_formats::model_file::ModelFile;
use softrig_formats::recording::Recording;

/// A model, and so many steps of an actuator that hides this; noise in degrees.
fn steps(hidden: Hidden, noise_deg: f64, count: usize) -> (ModelFile, Vec<Recording>) {
    let example = make(hidden, noise_deg, 5).unwrap();
    let file = ModelFile::parse(&example.model, Path::new("model.toml")).unwrap();
    let recordings = example
        .recordings
        .into_iter()
        .filter(|(name, ..)| name.starts_with("step"))
        .map(|(_, recording, _)| recording)
        .take(count)
        .collect();
    (file, recordings)
}
