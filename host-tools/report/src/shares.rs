//! The explained share of the error beyond the noise, on held-out runs.
//!
//! Reports use one measure everywhere, the one by which effects are named
//! ([`measure::closure`]): the ratio of √(e² − noise²) after and before. An excess that
//! cannot be distinguished from zero counts as the least that can; the share is then a lower
//! bound, and is shown as one.

use std::fmt;

use softrig::diagnose::evidence::measure;
use softrig::diagnose::work::policy::Policy;
use softrig_formats::numbers::percent;

/// A share of the error beyond the noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Explained {
    /// The share, at most 1; negative where the error grew.
    pub share: f64,
    /// Whether it is a lower bound: what is left cannot be distinguished from noise.
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

    /// A share measured before, of a model with the error `after` (rad).
    pub fn known(share: f64, after: f64, noise: f64) -> Self {
        Self {
            share,
            at_least: is_noise(after, noise),
        }
    }
}

impl Explained {
    /// The share in words.
    pub fn in_words(&self) -> String {
        let least = if self.is_bound() { "at least " } else { "" };
        format!("{least}{}", percent(self.share))
    }

    /// Whether the bound is worth showing: not if nothing is explained.
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

/// Whether the excess of an error over the noise cannot be distinguished from zero.
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
