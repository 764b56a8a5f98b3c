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
    /// Whether formulas are tried where no effect is enough ([`mod@crate::diagnose::score::grammar`]).
    pub formulas: bool,
    /// Effects of the catalogue that are not tried.
    pub without: &'a [String],
    /// Random seed.
    pub seed: u64,
}

impl<'a> Request<'a> {
    /// As the command asks without options: segments are left out in turn, the effects are those
    /// of the catalogue, formulas where these are not enough, and the seed is 1.
    pub const fn of(file: &'a ModelFile, recordings: &'a [Recording]) -> Self {
        Self {
            file,
            recordings,
            holdout: &[],
            own: None,
            formulas: true,
            without: &[],
            seed: 1,
        }
    }

    /// The user's own effects.
    pub fn own_kinds(&self) -> &'a [Kind] {
        self.own.map_or(&[], |own| &own.kinds)
    }
}
