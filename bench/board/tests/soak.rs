// SPDX-License-Identifier: GPL-3.0-or-later
//! Some minutes of a soak; `cargo xtask soak` runs hours.

use std::time::Duration;

use softrig_bench_board::soak;

#[path = "../../../virtual-rig/tests/firmware/bench.rs"]
#[allow(dead_code)] // Its own tests use more of it.
mod bench;

use bench::image;

#[test]
fn three_minutes_of_misfortunes_break_no_promise() {
    let Some(image) = image() else {
        return;
    };
    let options = soak::Options {
        seed: 1,
        seconds: 230.0,
        every: Duration::MAX,
    };
    match soak::run(&image, &options, |_| ()) {
        Ok(summary) => {
            println!("{summary}");
            assert!(summary.arms() >= 8 && summary.misfortunes() >= 12);
            // A line a period, apart from those that a reset or the cable took.
            assert!(summary.rows() > 16_000, "{} lines", summary.rows());
        }
        Err(broken) => panic!("{}\n{}", broken.0, broken.1),
    }
}
