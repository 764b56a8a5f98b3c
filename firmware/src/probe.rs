//! Marks measured sections of the program for the simulator.

/// Marks sections of the program; the numbers are those of [`wire::stretch`].
pub trait Probe {
    /// Marks the start of a section.
    fn open(&mut self, stretch: u8);
    /// Marks its end.
    fn close(&mut self);
}

/// A probe that marks nothing: on a desktop there are no cycles to count.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProbe;

impl Probe for NoProbe {
    fn open(&mut self, _stretch: u8) {}
    fn close(&mut self) {}
}
