//! Taking a line apart without allocation.

/// The fields of a line, separated by single spaces.
#[derive(Clone, Debug)]
pub(crate) struct Fields<'t>(Option<&'t [u8]>);

impl<'t> Fields<'t> {
    pub(crate) fn new(text: &'t [u8]) -> Self {
        Self(Some(text))
    }

    /// The next field as an integer.
    pub(crate) fn number<N: TryFrom<u32> + TryFrom<i32>>(&mut self) -> Option<N> {
        number(self.next()?)
    }

    /// Whether nothing is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_none()
    }

    /// The unread rest of the line.
    pub(crate) fn rest(self) -> &'t [u8] {
        self.0.unwrap_or_default()
    }
}

impl<'t> Iterator for Fields<'t> {
    type Item = &'t [u8];

    fn next(&mut self) -> Option<&'t [u8]> {
        let text = self.0?;
        let mut fields = text.splitn(2, |&byte| byte == b' ');
        let field = fields.next()?;
        self.0 = fields.next();
        Some(field)
    }
}

/// A decimal integer with an optional minus, which only a signed one may have; no plus sign, nothing empty.
///
/// Not by way of a `str`: to find out whether bytes are one, the core library has a table of 256 bytes, which
/// are RAM on the board.
pub(crate) fn number<N: TryFrom<u32> + TryFrom<i32>>(field: &[u8]) -> Option<N> {
    let digits = field.strip_prefix(b"-").unwrap_or(field);
    if digits.is_empty() {
        return None;
    }
    let mut size = 0_u32;
    for &byte in digits {
        let digit = char::from(byte).to_digit(10)?;
        size = size.checked_mul(10)?.checked_add(digit)?;
    }
    if digits.len() == field.len() {
        return N::try_from(size).ok();
    }
    N::try_from(-1).ok()?;
    N::try_from(0_i32.checked_sub_unsigned(size)?).ok()
}

/// Eight hexadecimal digits.
pub(crate) fn word(field: &[u8]) -> Option<u32> {
    hexadecimal(field, 8)
}

/// Four hexadecimal digits.
pub(crate) fn half_word(field: &[u8]) -> Option<u16> {
    u16::try_from(hexadecimal(field, 4)?).ok()
}

fn hexadecimal(field: &[u8], digits: usize) -> Option<u32> {
    if field.len() != digits {
        return None;
    }
    field.iter().try_fold(0, |number, &byte| {
        Some(number << 4 | char::from(byte).to_digit(16)?)
    })
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::{Fields, number, word};
    use std::vec::Vec;

    #[test]
    fn fields_keep_their_order_and_empty_ones_count() {
        let fields: Vec<_> = Fields::new(b"a bc  d").collect();
        assert_eq!(fields, [&b"a"[..], b"bc", b"", b"d"]);
        let mut fields = Fields::new(b"a b c");
        fields.next();
        assert_eq!(fields.rest(), b"b c");
    }

    #[test]
    fn numbers_are_strict() {
        assert_eq!(number::<i32>(b"-12"), Some(-12));
        assert_eq!(number::<i32>(b"-2147483648"), Some(i32::MIN));
        assert_eq!(number::<u32>(b"4294967295"), Some(u32::MAX));
        for field in [
            &b""[..],
            b"-",
            b"+1",
            b"-1",
            b"-0",
            b"--1",
            b"1.5",
            b" 1",
            b"300",
            b"0x1",
            b"a",
            b"\xff",
        ] {
            assert_eq!(number::<u8>(field), None, "{field:?}");
        }
        for field in [
            &b"2147483648"[..],
            b"-2147483649",
            b"4294967296",
            b"99999999999",
        ] {
            assert_eq!(number::<i32>(field), None, "{field:?}");
        }
        assert_eq!(word(b"3f800000"), Some(0x3f80_0000));
        for field in [&b"3f80000"[..], b"+3f80000", b"3f80000g"] {
            assert_eq!(word(field), None);
        }
    }
}
