//! The `softrig` command with what it has in the lab: files of other programs, models in other
//! languages, and the pages that describe all of it.

mod claims;
mod documents;
mod export;
mod formats;

use super::bench::common;
