//! Takes away what terminal programs put before each line: the time at which it arrived, as the
//! Arduino IDE's `14:02:00.000 -> `.

use std::io::Read;

/// Longest prefix (bytes).
const LONGEST: usize = 24;
/// What ends it.
const ARROW: &[u8] = b" -> ";

/// A text without such prefixes; all others come through as they are.
pub(super) struct Unprefixed<R> {
    inner: R,
    /// What may be a prefix, at the start of a line.
    held: Vec<u8>,
    begins: bool,
    /// What is to be given out.
    ready: Vec<u8>,
    given: usize,
    piece: Vec<u8>,
}

impl<R: Read> Unprefixed<R> {
    pub(super) fn new(inner: R) -> Self {
        Self {
            inner,
            held: Vec::with_capacity(LONGEST),
            begins: true,
            ready: Vec::new(),
            given: 0,
            piece: vec![0; 8192],
        }
    }

    fn take(&mut self, byte: u8) {
        let ends = matches!(byte, b'\n' | b'\r');
        if !self.begins {
            self.ready.push(byte);
            self.begins = ends;
            return;
        }
        self.held.push(byte);
        if self.held.ends_with(ARROW) && is_stamp(&self.held[..self.held.len() - ARROW.len()]) {
            self.held.clear();
            self.begins = false;
        } else if !may_be_prefix(&self.held) {
            self.ready.append(&mut self.held);
            self.begins = ends;
        }
    }
}

/// Whether bytes may go on to a prefix.
fn may_be_prefix(held: &[u8]) -> bool {
    let shown = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b':' | b'.' | b',');
    let stamp = held.iter().take_while(|byte| shown(byte)).count();
    held.len() < LONGEST && stamp > 0 && ARROW.starts_with(&held[stamp..])
}

/// Whether it is a time of the day: two colons between digits.
fn is_stamp(text: &[u8]) -> bool {
    text.split(|byte| *byte == b':').count() == 3 && text.first().is_some_and(u8::is_ascii_digit)
}

impl<R: Read> Read for Unprefixed<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        while self.given == self.ready.len() {
            self.ready.clear();
            self.given = 0;
            let count = self.inner.read(&mut self.piece)?;
            if count == 0 {
                self.ready.append(&mut self.held);
                if self.ready.is_empty() {
                    return Ok(0);
                }
                break;
            }
            for at in 0..count {
                self.take(self.piece[at]);
            }
        }
        let count = into.len().min(self.ready.len() - self.given);
        into[..count].copy_from_slice(&self.ready[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_stamps_before_an_arrow_go() {
        for (text, expected) in [
            (
                "14:02:00.000 -> a,b\r\n14:02:00.020 -> 1,2\r\n",
                "a,b\r\n1,2\r\n",
            ),
            ("12:00:00.5,1,2\n1.5 -> 3\n", "12:00:00.5,1,2\n1.5 -> 3\n"),
            ("1,2,3\n\n4", "1,2,3\n\n4"),
            ("14:02:00.000 -> \n5", "\n5"),
            ("14:02:00", "14:02:00"),
        ] {
            for piece in [1, 3, 100] {
                let mut reader = Unprefixed::new(text.as_bytes());
                let mut found = Vec::new();
                let mut into = vec![0; piece];
                loop {
                    match reader.read(&mut into).unwrap() {
                        0 => break,
                        count => found.extend(&into[..count]),
                    }
                }
                assert_eq!(String::from_utf8(found).unwrap(), expected);
            }
        }
    }
}
