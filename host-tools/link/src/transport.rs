//! What a board is reached over: a serial port of the computer, or one that a browser lends.

use std::io::{Read, Write};

use softrig_formats::error::InputError;

/// Bits a second.
pub const BAUD: u32 = 115_200;

/// Both directions of an open connection.
pub struct Channel {
    /// From the board; a read returns `TimedOut` after some milliseconds
    /// without a byte.
    pub reader: Box<dyn Read + Send>,
    /// To the board; not buffered, since nobody flushes it.
    pub writer: Box<dyn Write + Send>,
}

impl std::fmt::Debug for Channel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Channel").finish_non_exhaustive()
    }
}

/// Something that can be opened, and opened again after it vanished.
pub trait Connector: Send {
    /// Its name in messages.
    fn name(&self) -> &str;

    /// Whether a simulator is behind it: what is recorded has to say so.
    fn is_simulated(&self) -> bool;

    /// Opens it.
    ///
    /// # Errors
    ///
    /// Says why not and what to do.
    fn open(&mut self) -> Result<Channel, InputError>;

    /// Opens it and pulls the board's reset line, as a programmer does: a board whose port was open
    /// a moment ago has not noticed that it was opened again.
    ///
    /// # Errors
    ///
    /// As [`Connector::open`].
    fn open_after_reset(&mut self) -> Result<Channel, InputError>;
}

impl Connector for Box<dyn Connector> {
    fn name(&self) -> &str {
        self.as_ref().name()
    }

    fn is_simulated(&self) -> bool {
        self.as_ref().is_simulated()
    }

    fn open(&mut self) -> Result<Channel, InputError> {
        self.as_mut().open()
    }

    fn open_after_reset(&mut self) -> Result<Channel, InputError> {
        self.as_mut().open_after_reset()
    }
}
