//! In place of the live stream for Foxglove, in a build without it.

use std::path::PathBuf;

use super::row::Row;
use softrig_formats::error::InputError;
use softrig_formats::formats::binary::WITH_LAB;

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
            format!("{flag}: this softrig was built without it"),
            format!("take one that has it, {WITH_LAB}"),
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
