// SPDX-License-Identifier: GPL-3.0-or-later
//! Simulated time must pass faster than real time, or nobody can use the port.

use std::time::Instant;

use virtual_rig::{Image, Options, VirtualRig};

#[test]
#[ignore = "a measurement; run it alone: cargo test -p virtual-rig --test rig speed -- --ignored --nocapture"]
fn a_busy_board_and_its_plant_run_faster_than_real_time() {
    let Some(elf) = super::common::compile("busy.c") else {
        return;
    };
    let image = Image::parse(&elf).unwrap();
    let mut rig = VirtualRig::new(&image, Options::default()).unwrap();
    rig.run_for(1.0).unwrap();
    let (edges, begin) = (rig.plant().steps.edges, Instant::now());
    rig.run_for(5.0).unwrap();
    let ratio = 5.0 / begin.elapsed().as_secs_f64();
    println!("{ratio:.2} times real time");
    let edges = rig.plant().steps.edges - edges;
    assert!((79_990..80_010).contains(&edges), "{edges} steps");
    let lines = rig.take_lines().len();
    assert!((590..=600).contains(&lines), "{lines} lines");
    assert!(ratio > 1.5, "{ratio}");
}
