//! Writes drawn cases into folders, and says how it goes on.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;
use softrig_formats::error::InputError;

use super::answer::{Answer, Plans};
use super::bench::cases as sessions;
use super::verdicts::remaining;
use super::{cases, laws};

/// Draws the cases that are not there yet, in parallel, writes them into `folder`
/// and hands each answer to `keep`.
///
/// # Errors
///
/// Says what cannot be written, or the first error of `keep`.
pub fn draw(
    plans: &Plans,
    seed: u64,
    folder: &Path,
    is_there: impl Fn(&str) -> bool,
    keep: impl Fn(&Answer) -> Result<(), InputError> + Sync,
) -> Result<(), InputError> {
    let set = plans.collection().name();
    let names = plans.names();
    let all = names.iter().enumerate();
    let open: Vec<(usize, &String)> = all.filter(|(_, name)| !is_there(name)).collect();
    if open.len() < names.len() {
        let there = names.len() - open.len();
        eprintln!("{there} {set} cases are there already");
    }
    let (clock, drawn) = (Instant::now(), AtomicUsize::new(0));
    open.par_iter().try_for_each(|&(number, name)| {
        let folder = folder.join(name);
        let answer = match plans {
            Plans::Runs(_, plans) => {
                let made = cases::make(&plans[number], name, seed);
                made.write(&folder)?;
                Answer::Runs(made.answer)
            }
            Plans::Bench(plans) => {
                let made = sessions::make(&plans[number], seed, number);
                made.write(&folder)?;
                Answer::Session(made.answer)
            }
            Plans::Laws(seeds) => Answer::Law(laws::write(seeds[number], &folder)?),
        };
        keep(&answer)?;
        let drawn = drawn.fetch_add(1, Ordering::Relaxed) + 1;
        if drawn.is_multiple_of(10) || drawn == open.len() {
            let left = remaining(clock.elapsed(), drawn, open.len());
            eprintln!("{drawn:>4} of {} {set} cases drawn, {left}", open.len());
        }
        Ok(())
    })
}
