//! How much was simulated: the same on every computer, unlike the time that it took.
//!
//! Tests hold a diagnosis to it, so that time does not creep back.

use std::ops::Sub;
use std::sync::atomic::{AtomicU64, Ordering};

static PLAIN: AtomicU64 = AtomicU64::new(0);
static WITH_DERIVATIVES: AtomicU64 = AtomicU64::new(0);

/// Evaluations of a model, counted in this process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// On numbers.
    pub plain: u64,
    /// On dual numbers.
    pub with_derivatives: u64,
}

impl Work {
    /// What was done so far.
    pub fn so_far() -> Self {
        Self {
            plain: PLAIN.load(Ordering::Relaxed),
            with_derivatives: WITH_DERIVATIVES.load(Ordering::Relaxed),
        }
    }

    /// Counts evaluations.
    pub(crate) fn count(evaluations: usize, has_derivatives: bool) {
        let counter = if has_derivatives {
            &WITH_DERIVATIVES
        } else {
            &PLAIN
        };
        counter.fetch_add(evaluations as u64, Ordering::Relaxed);
    }
}

impl Sub for Work {
    type Output = Self;
    fn sub(self, before: Self) -> Self {
        Self {
            plain: self.plain - before.plain,
            with_derivatives: self.with_derivatives - before.with_derivatives,
        }
    }
}
