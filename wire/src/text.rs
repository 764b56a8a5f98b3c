//! Text in memory, for computers: the board writes to its serial port.

extern crate std;
use std::string::String;

use ufmt::uWrite;

use crate::line::Sealed;

/// Text in memory.
#[derive(Debug, Default)]
pub struct Text(pub String);

impl uWrite for Text {
    type Error = core::convert::Infallible;

    fn write_str(&mut self, text: &str) -> Result<(), Self::Error> {
        self.0.push_str(text);
        Ok(())
    }

    // The one of the trait takes the address of memory that was never set.
    fn write_char(&mut self, character: char) -> Result<(), Self::Error> {
        self.0.push(character);
        Ok(())
    }
}

/// The text with its checksum and the end of a line.
pub fn sealed(text: &str) -> String {
    let mut out = Text::default();
    let mut line = Sealed::new(&mut out);
    let Ok(()) = line.write_str(text);
    let Ok(()) = line.finish();
    out.0
}
