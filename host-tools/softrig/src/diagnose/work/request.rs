//! What is asked of a diagnosis.

use model_core::catalogue::Kind;

use crate::estimate::start_from::StartFrom;
use softrig_formats::error::InputError;
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
    /// Where the validation recordings start: as every recording, by a fit to the whole of it, if
    /// this is empty; else one start for all of them or one for each. Then they are a test: they
    /// choose nothing, and are simulated with the final model.
    pub start_from: &'a [StartFrom],
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
            start_from: &[],
            own: None,
            formulas: true,
            without: &[],
            seed: 1,
        }
    }

    /// The test recordings, each with where it starts; none if they are validation recordings.
    ///
    /// # Errors
    ///
    /// Refuses a number of starts that differs from the number of recordings, and a recording with
    /// nothing left to be scored.
    pub fn tests(&self) -> Result<Vec<(&'a Recording, StartFrom)>, InputError> {
        let starts = self.start_from;
        if ![0, 1, self.holdout.len()].contains(&starts.len()) {
            return Err(InputError::new(
                format!(
                    "there are {} starts for {} validation recordings",
                    starts.len(),
                    self.holdout.len()
                ),
                "give --start-from one start for all of them, or one for each in their order",
            ));
        }
        let each = starts.iter().cycle().take(match starts.len() {
            0 => 0,
            _ => self.holdout.len(),
        });
        let tests = self.holdout.iter().zip(each.copied());
        tests
            .map(|(recording, start)| start.check(recording).map(|()| (recording, start)))
            .collect()
    }

    /// The user's own effects.
    pub fn own_kinds(&self) -> &'a [Kind] {
        self.own.map_or(&[], |own| &own.kinds)
    }
}
