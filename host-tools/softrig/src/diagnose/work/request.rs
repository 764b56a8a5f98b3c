//! What is asked of a diagnosis.

use model_core::catalogue::Kind;
use softrig_formats::model_file::ModelFile;
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording::Recording;

/// A diagnosis to make.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The nominal model.
    pub file: &'a ModelFile,
    /// Recordings to fit.
    pub recordings: &'a [Recording],
    /// Validation recordings; if empty, segments are left out in turn.
    pub holdout: &'a [Recording],
    /// Effects with the user's own formulas, tried beside the catalogue.
    pub own: Option<&'a OwnEffects>,
    /// Random seed.
    pub seed: u64,
}

impl<'a> Request<'a> {
    /// As the command asks without options: segments are left out in turn, the effects are those
    /// of the catalogue, and the seed is 1.
    pub const fn of(file: &'a ModelFile, recordings: &'a [Recording]) -> Self {
        Self {
            file,
            recordings,
            holdout: &[],
            own: None,
            seed: 1,
        }
    }

    /// The user's own effects.
    pub fn own_kinds(&self) -> &'a [Kind] {
        self.own.map_or(&[], |own| &own.kinds)
    }
}
