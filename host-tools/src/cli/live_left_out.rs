//! In place of the live stream for Foxglove, in a build without it.

use std::path::PathBuf;

use super::row::Row;
use softrig_formats::error::InputError;

/// Nobody.
pub(super) enum Live {}

impl Live {
    /// Says that this build has it not, if it is asked for.
    ///
    /// # Errors
    ///
    /// Names the flag, and where to get a build that has it.
    pub(super) fn of(
        address: Option<&str>,
        file: Option<&PathBuf>,
    ) -> Result<Option<Self>, InputError> {
        let flag = match (address, file) {
            (None, None) => return Ok(None),
            (Some(_), _) => "--foxglove",
            (None, Some(_)) => "--mcap",
        };
        Err(InputError::new(
            format!("{flag}: this rig was built without it"),
            "take one that has it, of a release or of `cargo build --release -p softrig-cli`",
        ))
    }

    pub(super) fn invitation(&self) -> Option<String> {
        match *self {}
    }

    pub(super) fn take(&mut self, _: &Row) -> Result<(), InputError> {
        match *self {}
    }

    pub(super) fn end(self) -> Result<(), InputError> {
        match self {}
    }
}
