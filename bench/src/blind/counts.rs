//! Counting: rates with their intervals, of cases that are counted together.
//!
//! Every figure of every set is a rate or a median of such a [`Group`]; what is
//! asked of a case is a question of [`Scored`].

use serde_json::{Value, json};
use statrs::distribution::{ContinuousCDF, Normal};

use super::answer::Collection;
use super::hidden::Hidden;
use super::score::Scored;

/// So many of so many.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Rate {
    /// Counted.
    pub hits: u32,
    /// Of these.
    pub of: u32,
}

impl Rate {
    /// Counts.
    pub fn count(items: impl IntoIterator<Item = bool>) -> Self {
        items.into_iter().fold(Self::default(), |rate, hit| Self {
            hits: rate.hits + u32::from(hit),
            of: rate.of + 1,
        })
    }

    /// The share; none of nothing.
    pub fn share(self) -> Option<f64> {
        (self.of > 0).then(|| f64::from(self.hits) / f64::from(self.of))
    }

    /// 95 % interval of the share.
    pub fn interval(self) -> Option<[f64; 2]> {
        (self.of > 0).then(|| wilson(self.hits.into(), self.of.into(), 0.95))
    }

    /// For a table: the counts, the share and its interval.
    pub fn shown(self) -> Value {
        json!({ "hits": self.hits, "of": self.of, "share": self.share(), "interval95": self.interval() })
    }
}

/// The interval of a share, `hits` of `of`, that covers the true one with this confidence (Wilson 1927).
pub fn wilson(hits: f64, of: f64, confidence: f64) -> [f64; 2] {
    let z = Normal::standard().inverse_cdf(f64::midpoint(1.0, confidence));
    let p = hits / of;
    let middle = p + z * z / (2.0 * of);
    let half = z * (p * (1.0 - p) / of + z * z / (4.0 * of * of)).sqrt();
    let whole = 1.0 + z * z / of;
    [
        ((middle - half) / whole).max(0.0),
        ((middle + half) / whole).min(1.0),
    ]
}

/// Cases that are counted together.
#[derive(Clone, Debug)]
pub struct Group<'a>(Vec<&'a Scored>);

impl<'a> Group<'a> {
    /// The cases of a set.
    pub fn of(collection: Collection, scored: &'a [Scored]) -> Self {
        let cases = scored.iter();
        Self(
            cases
                .filter(|case| case.answer.collection() == collection)
                .collect(),
        )
    }

    /// Those of the cases for which this holds.
    pub fn that(&self, is: impl Fn(&Scored) -> bool) -> Self {
        Self(self.iter().filter(|case| is(case)).collect())
    }

    /// Those of the cases that hide one of these.
    pub fn hiding(&self, hidden: &[Hidden]) -> Self {
        self.that(|case| hidden.contains(&case.secret().hidden))
    }

    /// Those of the cases that hide nothing, or parameters only.
    pub fn quiet(&self) -> Self {
        self.that(|case| case.secret().hidden.is_quiet())
    }

    /// The cases.
    pub fn iter(&self) -> impl Iterator<Item = &'a Scored> + '_ {
        self.0.iter().copied()
    }

    /// How many cases there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no case.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// For how many of them this holds.
    pub fn rate(&self, is: impl Fn(&Scored) -> bool) -> Rate {
        Rate::count(self.iter().map(is))
    }

    /// The median of what cases have of this; none if none has.
    pub fn median(&self, of: impl Fn(&Scored) -> Option<f64>) -> Option<f64> {
        median(self.iter().filter_map(of))
    }

    /// The largest of what cases have of this; none if none has.
    pub fn worst(&self, of: impl Fn(&Scored) -> Option<f64>) -> Option<f64> {
        self.iter().filter_map(of).reduce(f64::max)
    }
}

/// The median; none of nothing.
pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    (!values.is_empty()).then(|| softrig::statistics::median(&mut values))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Figures of Newcombe (1998), table I: 81 of 263, and 0 of 20.
    #[test]
    fn wilson_intervals_are_those_of_the_literature() {
        let [low, high] = Rate { hits: 81, of: 263 }.interval().unwrap();
        assert!((low - 0.2553).abs() < 1e-4 && (high - 0.3662).abs() < 1e-4);
        let [low, high] = Rate { hits: 0, of: 20 }.interval().unwrap();
        assert!(low.abs() < 1e-12 && (high - 0.1611).abs() < 1e-4);
        assert_eq!(Rate::default().interval(), None);
    }
}
