//! Writes drawn cases into folders, and says how it goes on.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use softrig_formats::error::InputError;

use super::bench::cases as sessions;
use super::cases;
use super::verdicts::remaining;

/// Counts cases that are drawn.
struct ProgressPlot<'a> {
    what: &'a str,
    of: usize,
    drawn: AtomicUsize,
    clock: Instant,
}

impl<'a> ProgressPlot<'a> {
    fn new(what: &'a str, of: usize) -> Self {
        Self {
            what,
            of,
            drawn: AtomicUsize::new(0),
            clock: Instant::now(),
        }
    }

    fn one_more(&self) {
        let (drawn, of) = (self.drawn.fetch_add(1, Ordering::Relaxed) + 1, self.of);
        if drawn.is_multiple_of(10) || drawn == of {
            let left = remaining(self.clock.elapsed(), drawn, of);
            eprintln!("{drawn:>4} of {of} {} cases drawn, {left}", self.what);
        }
    }
}

/// Draws all cases of a set, which depend on how many there are, and writes them into `folder`;
/// their answers.
///
/// # Errors
///
/// Says what cannot be written.
pub fn runs(
    plans: &[cases::Plan],
    seed: u64,
    folder: &Path,
) -> Result<Vec<cases::Answer>, InputError> {
    let set = plans.first().map_or("", |plan| plan.set.name());
    let progress = ProgressPlot::new(set, plans.len());
    cases::make_all(plans, seed, |made| {
        made.write(&folder.join(&made.answer.case))?;
        progress.one_more();
        Ok(made.answer)
    })
}

/// Draws the bench sessions that are not there yet, writes them into `folder` and hands each
/// answer to `keep`.
///
/// # Errors
///
/// Says what cannot be written, or the first error of `keep`.
pub fn bench(
    plans: &[sessions::Plan],
    seed: u64,
    folder: &Path,
    is_there: impl Fn(&str) -> bool,
    keep: impl Fn(&sessions::Answer) -> Result<(), InputError> + Sync,
) -> Result<(), InputError> {
    let open: Vec<usize> = (0..plans.len())
        .filter(|&number| !is_there(&sessions::case_name(number)))
        .collect();
    if open.len() < plans.len() {
        eprintln!("{} cases are there already", plans.len() - open.len());
    }
    let progress = ProgressPlot::new("bench", open.len());
    sessions::make_all(plans, &open, seed, |made| {
        made.write(&folder.join(&made.answer.case))?;
        keep(&made.answer)?;
        progress.one_more();
        Ok(())
    })
}
