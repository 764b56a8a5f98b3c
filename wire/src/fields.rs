//! Taking a line apart without allocation.

/// The fields of a line, separated by single spaces.
#[derive(Clone, Debug)]
pub(crate) struct Fields<'t>(Option<&'t [u8]>);

impl<'t> Fields<'t> {
    pub(crate) fn new(text: &'t [u8]) -> Self {
        Self(Some(text))
    }

    /// The next field as an integer.
    pub(crate) fn number<N: core::str::FromStr>(&mut self) -> Option<N> {
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

/// A decimal integer with an optional minus; no plus sign, nothing empty.
pub(crate) fn number<N: core::str::FromStr>(field: &[u8]) -> Option<N> {
    if field.first() == Some(&b'+') {
        return None;
    }
    core::str::from_utf8(field).ok()?.parse().ok()
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
    if field.len() != digits || !field.iter().all(u8::is_ascii_hexdigit) {
        return None;
    }
    u32::from_str_radix(core::str::from_utf8(field).ok()?, 16).ok()
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
        for field in [&b""[..], b"+1", b"1.5", b" 1", b"300", b"0x1"] {
            assert_eq!(number::<u8>(field), None);
        }
        assert_eq!(word(b"3f800000"), Some(0x3f80_0000));
        for field in [&b"3f80000"[..], b"+3f80000", b"3f80000g"] {
            assert_eq!(word(field), None);
        }
    }
}
