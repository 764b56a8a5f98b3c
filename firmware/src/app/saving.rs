//! Saves settings to EEPROM, one byte per period.

use wire::settings::Settings;

use crate::store::{Eeprom, Poll, Writer};

/// The progress of saving.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Saving {
    /// Nothing is being saved.
    No,
    /// Accepted; the slot is chosen in the next period.
    Accepted,
    /// Being written.
    Writing(Writer),
    /// Done; the result is still to be reported.
    Over {
        /// Whether the EEPROM has them.
        kept: bool,
    },
}

impl Saving {
    /// Whether the settings must not change yet.
    pub(super) fn is_busy(self) -> bool {
        matches!(self, Self::Accepted | Self::Writing(_))
    }

    /// Writes a byte; whether that was the last.
    pub(super) fn step(&mut self, settings: &Settings, eeprom: &mut impl Eeprom) -> bool {
        match self {
            Self::Accepted => *self = Self::Writing(Writer::new(eeprom)),
            Self::Writing(writer) => match writer.step(settings, eeprom) {
                Poll::Writing => {}
                Poll::Done => {
                    *self = Self::Over { kept: true };
                    return true;
                }
                Poll::Failed => *self = Self::Over { kept: false },
            },
            Self::No | Self::Over { .. } => {}
        }
        false
    }
}
