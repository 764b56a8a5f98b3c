//! Keywords of the line protocol, packed into one number.
//!
//! On this processor every constant is in the scarce RAM, and so would be a table of
//! words. Packed into 64 bits, a word is part of the code.

use ufmt::{Formatter, uDisplay, uWrite};

/// A word of one to eight printable characters.
///
/// # Examples
///
/// ```
/// use wire::keyword::Keyword;
///
/// const STOP: Keyword = Keyword::of("stop");
/// assert_eq!(Keyword::parse(b"stop"), Some(STOP));
/// assert_eq!(Keyword::parse(b"much too long"), None);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Keyword(u64);

impl Keyword {
    /// Packs a word at compile time.
    ///
    /// # Panics
    ///
    /// When the word is empty or longer than eight bytes; in a constant that is
    /// an error of the compiler.
    pub const fn of(word: &str) -> Self {
        match Self::parse(word.as_bytes()) {
            Some(keyword) => keyword,
            None => panic!("a keyword has one to eight printable characters"),
        }
    }

    /// Packs a word that arrived; none if it cannot be a keyword.
    pub const fn parse(word: &[u8]) -> Option<Self> {
        if word.is_empty() || word.len() > 8 {
            return None;
        }
        let mut packed = 0;
        let mut rest = word;
        while let [byte, tail @ ..] = rest {
            if !byte.is_ascii_graphic() {
                return None;
            }
            packed = packed << 8 | *byte as u64;
            rest = tail;
        }
        Some(Self(packed))
    }
}

impl uDisplay for Keyword {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        for byte in self.0.to_be_bytes() {
            if byte != 0 {
                f.write_char(byte as char)?;
            }
        }
        Ok(())
    }
}

impl core::fmt::Display for Keyword {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        use core::fmt::Write;
        for byte in self.0.to_be_bytes() {
            if byte != 0 {
                f.write_char(byte as char)?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::Keyword;
    use std::string::ToString;

    #[test]
    fn different_words_are_different_numbers() {
        let words = ["a", "aa", "stop", "start", "status", "selftest"];
        for (i, a) in words.iter().enumerate() {
            assert_eq!(Keyword::of(a).to_string(), *a);
            for b in &words[i + 1..] {
                assert_ne!(Keyword::of(a), Keyword::of(b));
            }
        }
    }

    #[test]
    fn what_is_no_word_is_refused() {
        for word in [&b""[..], b"ninechars", b"a b", b"\x00", b"\xff"] {
            assert_eq!(Keyword::parse(word), None);
        }
    }
}
