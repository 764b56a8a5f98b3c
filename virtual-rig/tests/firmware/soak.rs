// SPDX-License-Identifier: GPL-3.0-or-later
//! Some minutes of a soak; `cargo xtask soak` runs hours.

use std::time::Duration;

use virtual_rig::soak;

use crate::bench::image;

#[test]
fn four_minutes_of_misfortunes_break_no_promise() {
    let Some(image) = image() else {
        return;
    };
    let options = soak::Options {
        seed: 1,
        seconds: 240.0,
        every: Duration::MAX,
    };
    match soak::run(&image, &options, |_| ()) {
        Ok(summary) => {
            println!("{summary}");
            assert!(summary.arms() > 10 && summary.misfortunes() > 15);
            // A line a period, apart from those that a reset or the cable took.
            assert!(summary.rows() > 22_000, "{} lines", summary.rows());
        }
        Err(broken) => panic!("{}\n{}", broken.0, broken.1),
    }
}
