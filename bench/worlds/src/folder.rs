//! A case as a lab would hand it over: a folder with a model file and recordings.

use std::path::Path;

use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::recording::{Recording, to_csv};

use super::world::Base;

/// A recording of a case.
#[derive(Clone, Debug)]
pub struct File {
    /// Its name without extension.
    pub name: String,
    /// What was recorded.
    pub recording: Recording,
    /// The text of its metadata, if there is any.
    pub meta: Option<String>,
}

/// Writes `model.toml` and the recordings with their metadata into a folder.
/// Nothing in it tells what is hidden. `free` are the parameters that the model
/// frees in a fit.
///
/// # Errors
///
/// Says what cannot be written.
pub fn write(
    folder: &Path,
    case: &str,
    nominal: &Base,
    free: &[&str],
    files: &[File],
) -> Result<(), InputError> {
    let recordings = folder.join("recordings");
    std::fs::create_dir_all(&recordings)
        .map_err(|error| InputError::from_io(&recordings, &error))?;
    for file in files {
        let path = recordings.join(format!("{}.csv", file.name));
        if let Some(meta) = &file.meta {
            write_atomically(&path.with_extension("meta.toml"), meta.as_bytes())?;
        }
        write_atomically(&path, to_csv(&file.recording, &[]).as_bytes())?;
    }
    let model = format!(
        "schema = 1\nname = \"{case}\"\n\n[dynamics]\ninertia_kg_m = {:.6}\ndamping_n_s_per_rad = {:.6}\nstiffness_n_per_rad_n = {:.6}\nexponent = {}\ninput_gain_n_per_kpa = {:.6}\n\n[fit]\nfree = [\"{}\"]\n",
        nominal.inertia,
        nominal.damping,
        nominal.stiffness,
        nominal.exponent,
        nominal.input_gain * 1e3,
        free.join("\", \""),
    );
    // Last, so that a folder with a model is complete.
    write_atomically(&folder.join("model.toml"), model.as_bytes())
}
