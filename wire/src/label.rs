//! Labels of telemetry, packed into the code.
//!
//! A constant string would be in the board's scarce RAM, and be fetched from there letter by
//! letter. So four letters of a label are packed into one number at compile time.

use ufmt::uWrite;

use crate::line::Sealed;

/// Four letters of a text, zeros behind its end.
///
/// # Panics
///
/// When the text is not ASCII or longer than sixteen letters; in a constant that is an
/// error of the compiler.
pub(crate) const fn packed(text: &str, group: usize) -> u32 {
    let text = text.as_bytes();
    assert!(text.is_ascii() && text.len() <= 16);
    let mut packed = 0;
    let mut index = 4 * group;
    while index < 4 * group + 4 {
        let letter = if index < text.len() { text[index] } else { 0 };
        packed = packed << 8 | letter as u32;
        index += 1;
    }
    packed
}

/// Writes what [`packed`] has packed.
#[inline(never)]
pub(crate) fn letters<W: uWrite + ?Sized>(
    line: &mut Sealed<'_, W>,
    packed: u32,
) -> Result<(), W::Error> {
    let [first, second, third, fourth] = packed.to_be_bytes();
    line.put(first)?;
    if second == 0 {
        return Ok(());
    }
    line.put(second)?;
    if third == 0 {
        return Ok(());
    }
    line.put(third)?;
    if fourth == 0 {
        return Ok(());
    }
    line.put(fourth)
}

/// Writes a text of one to sixteen letters into a [`Sealed`] line.
macro_rules! label {
    ($line:expr, $text:literal) => {{
        $crate::label::letters($line, const { $crate::label::packed($text, 0) })?;
        $crate::label::label!(@ $line, $text, 1);
        $crate::label::label!(@ $line, $text, 2);
        $crate::label::label!(@ $line, $text, 3);
    }};
    (@ $line:expr, $text:literal, $group:literal) => {
        if const { $text.len() > 4 * $group } {
            $crate::label::letters($line, const { $crate::label::packed($text, $group) })?;
        }
    };
}

pub(crate) use label;
