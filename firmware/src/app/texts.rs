//! Texts for people: the sentences of faults, and the help.

use ufmt::uWrite;
use wire::fault::Fault;

/// Long texts for people, which the board keeps in flash: a constant string
/// would lie in its RAM.
pub trait Texts {
    /// Writes what a fault means and what to do.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    fn fault<W: uWrite + ?Sized>(&self, fault: Fault, out: &mut W) -> Result<(), W::Error>;

    /// Writes a line of the help, without a line end; whether another follows.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    fn help<W: uWrite + ?Sized>(&self, line: u8, out: &mut W) -> Result<bool, W::Error>;
}

/// The help, line by line.
pub const HELP: [&str; 7] = [
    "status, raw, switches, exact, get KEY: look; stop, disarm: all off",
    "machine: pump and supply; log N: faults, 0 the latest; past N: before it",
    "arm: home; run [paper|steps|stairs|triangle|small|sines|hold|follow]",
    "load N, seg I step|ramp|sines|hold|release|repeat ...: a protocol of your own",
    "set KEY BITS, save, discard: settings; tare: zero the sensors; clear: a fault",
    "stroke: measure the pump; selftest: model steps to the bit",
    "hello, beat: for programs; what moves or changes needs a checksum: use softrig",
];

/// The texts where RAM does not matter.
#[derive(Clone, Copy, Debug, Default)]
pub struct PlainTexts;

impl Texts for PlainTexts {
    fn fault<W: uWrite + ?Sized>(&self, fault: Fault, out: &mut W) -> Result<(), W::Error> {
        out.write_str(fault.sentence())
    }

    fn help<W: uWrite + ?Sized>(&self, line: u8, out: &mut W) -> Result<bool, W::Error> {
        if let Some(text) = HELP.get(usize::from(line)) {
            out.write_str(text)?;
        }
        Ok(usize::from(line) + 1 < HELP.len())
    }
}
