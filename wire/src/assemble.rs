//! Assembles lines from received bytes, in a fixed buffer.

/// Collects bytes into lines of at most `N` bytes.
///
/// A longer line is dropped as a whole and counted: its beginning could look
/// like a command.
#[derive(Clone, Debug)]
pub struct Assembler<const N: usize> {
    line: heapless::Vec<u8, N>,
    /// The line was handed out, and the next byte begins another one.
    is_over: bool,
    overlong: bool,
}

/// The result of a byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Assembled<'b> {
    /// The line goes on.
    Pending,
    /// A line without its end; never empty.
    Line(&'b [u8]),
    /// The end of a line that was too long.
    Overlong,
}

impl<const N: usize> Assembler<N> {
    /// Creates an assembler at the start of a line.
    pub const fn new() -> Self {
        Self {
            line: heapless::Vec::new(),
            is_over: false,
            overlong: false,
        }
    }

    /// Takes a byte. A carriage return ends a line as a line feed does, and
    /// empty lines are passed over.
    pub fn push(&mut self, byte: u8) -> Assembled<'_> {
        if core::mem::take(&mut self.is_over) {
            self.line.clear();
        }
        if byte != b'\n' && byte != b'\r' {
            self.overlong |= self.line.push(byte).is_err();
            return Assembled::Pending;
        }
        self.is_over = true;
        if core::mem::take(&mut self.overlong) {
            Assembled::Overlong
        } else if self.line.is_empty() {
            Assembled::Pending
        } else {
            Assembled::Line(&self.line)
        }
    }
}

impl<const N: usize> Default for Assembler<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::{Assembled, Assembler};
    use std::{vec, vec::Vec};

    fn lines(bytes: &[u8]) -> Vec<Option<Vec<u8>>> {
        let mut assembler = Assembler::<4>::new();
        let mut lines = Vec::new();
        for &byte in bytes {
            match assembler.push(byte) {
                Assembled::Pending => {}
                Assembled::Line(line) => lines.push(Some(line.to_vec())),
                Assembled::Overlong => lines.push(None),
            }
        }
        lines
    }

    #[test]
    fn lines_end_in_any_way_and_too_long_ones_are_dropped_whole() {
        assert_eq!(
            lines(b"ab\r\ncd\n\n\rabcd\nabcde\nef\nunfinished"),
            vec![
                Some(b"ab".to_vec()),
                Some(b"cd".to_vec()),
                Some(b"abcd".to_vec()),
                None,
                Some(b"ef".to_vec()),
                None,
            ][..5]
                .to_vec()
        );
    }
}
