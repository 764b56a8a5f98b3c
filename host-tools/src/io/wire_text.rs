//! Text in memory that the formatter of the wire can write to.

/// Text that the formatter of the wire can write to.
#[derive(Debug, Default)]
pub struct Text(pub String);

impl ufmt::uWrite for Text {
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
