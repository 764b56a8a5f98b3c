//! The lines on which rows begin.
//!
//! The CSV reader counts from the end of the row before: a blank line between two rows, or the
//! second half of a line end of Windows, would shift the line that a message names.

use std::collections::VecDeque;

/// Notes where lines begin in a text that is read ahead of its rows.
pub(super) struct Lines {
    /// Line ends so far, and one.
    line: u64,
    /// Bytes so far.
    at: u64,
    /// Whether the last byte ended a line, or none was read.
    ended: bool,
    /// Whether it was a carriage return: with a line feed behind it it is one end.
    returned: bool,
    /// Places at which something follows an end of a line, and their lines.
    starts: VecDeque<(u64, u64)>,
}

/// The line ends in a piece of text: of Unix, of Windows, and of old Macs.
pub(super) fn ends_in(text: &[u8]) -> u64 {
    let mut lines = Lines::after(0);
    for byte in text {
        lines.take(std::slice::from_ref(byte));
        lines.starts.clear();
    }
    lines.line - 1
}

impl Lines {
    /// For a text that follows this many lines.
    pub(super) fn after(lines: u64) -> Self {
        Self {
            line: lines + 1,
            at: 0,
            ended: true,
            returned: false,
            starts: VecDeque::new(),
        }
    }

    /// Takes a piece of the text.
    pub(super) fn take(&mut self, piece: &[u8]) {
        for byte in piece {
            let ends = matches!(byte, b'\n' | b'\r');
            if self.ended && !ends {
                self.starts.push_back((self.at, self.line));
            }
            self.ended = ends;
            self.line += u64::from(ends && !(*byte == b'\n' && self.returned));
            self.returned = *byte == b'\r';
            self.at += 1;
        }
    }

    /// The line of the row that was looked for from a byte on; bytes must not decrease.
    pub(super) fn of_row(&mut self, from: u64) -> u64 {
        while self.starts.front().is_some_and(|(at, _)| *at < from) {
            self.starts.pop_front();
        }
        self.starts.front().map_or(self.line, |(_, line)| *line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blank_lines_and_both_line_ends_count() {
        let text = b"\r\na\r\n\r\n\nb\n\"c\nd\"\re";
        let mut lines = Lines::after(2);
        for piece in text.chunks(3) {
            lines.take(piece);
        }
        // The reader looks on from where it found the end of a row.
        let found = [0, 4, 9, 16].map(|from| lines.of_row(from));
        assert_eq!(found, [4, 7, 8, 10]);
        assert_eq!(ends_in(b"a\rb\r\rc\r\n"), 4);
    }
}
