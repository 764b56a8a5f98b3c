//! Choices of the libraries as words of a command line.
//!
//! The libraries do not know command lines: they spell their choices, and say in the
//! documentation of each what `--help` shows.

use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use strum::{EnumMessage, VariantArray};

/// Reads one of the words of `T`.
pub(crate) fn choice<T>() -> impl TypedValueParser<Value = T>
where
    T: Clone + Copy + EnumMessage + FromStr + Into<&'static str> + Send + Sync + VariantArray,
    T::Err: std::error::Error + Send + Sync + 'static,
{
    let words = T::VARIANTS.iter().map(|choice| {
        let about = choice.get_documentation().unwrap_or_default();
        let name: &'static str = (*choice).into();
        let others = choice.get_serializations().iter().copied();
        PossibleValue::new(name)
            .aliases(others.filter(move |other| *other != name))
            .help(about.trim_end_matches('.'))
    });
    PossibleValuesParser::new(words).try_map(|word| word.parse())
}
