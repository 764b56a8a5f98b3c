//! How much of the error beyond the noise a model explains on runs that were not fitted.
//!
//! One measure in all that people read: the one by which effects are named
//! ([`measure::closure`]), √(e² − noise²) after over before. An excess that cannot be told
//! from none counts as the least that can; the share is then a lower bound, and says so.

use std::fmt;

use crate::diagnose::measure;
use crate::diagnose::policy::Policy;
use crate::report::numbers::percent;

/// A share of the error beyond the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explained {
    /// The share, at most 1; negative where the error grew.
    pub share: f64,
    /// Whether it may be more: what is left cannot be told from noise.
    pub at_least: bool,
}

impl Explained {
    /// Over whole runs: errors (rad) before and after, and the noise.
    pub fn of_whole_runs(before: f64, after: f64, noise: f64) -> Self {
        let closure = measure::closure(&[before; 3], &[after; 3], noise);
        Self {
            share: closure.full.max(-1.0),
            at_least: is_noise(after, noise),
        }
    }

    /// A share that was measured before, of a model that leaves `after` (rad).
    pub fn known(share: f64, after: f64, noise: f64) -> Self {
        Self {
            share,
            at_least: is_noise(after, noise),
        }
    }
}

impl Explained {
    /// As in a sentence.
    pub fn in_words(&self) -> String {
        let least = if self.is_bound() { "at least " } else { "" };
        format!("{least}{}", percent(self.share))
    }

    /// Nothing explained is no bound worth a word.
    fn is_bound(&self) -> bool {
        self.at_least && self.share > 0.0
    }
}

impl fmt::Display for Explained {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = if self.is_bound() { "≥ " } else { "" };
        write!(formatter, "{sign}{}", percent(self.share))
    }
}

/// Whether the excess of an error over the noise cannot be told from none.
fn is_noise(error: f64, noise: f64) -> bool {
    let least = Policy::STANDARD.noise_share * noise;
    error * error - noise * noise <= least * least
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_leaves_noise_explains_at_least_what_can_be_told() {
        let said = |after| Explained::of_whole_runs(0.527, after, 0.423).to_string();
        assert_eq!(said(0.527), "0 %");
        assert_eq!(said(0.458), "44 %");
        assert_eq!(said(0.415), "≥ 60 %");
        assert_eq!(said(0.8), "−100 %");
    }
}
