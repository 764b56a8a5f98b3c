//! The commands that speak to a board, with the firmware behind the cable.
#![cfg(unix)]

mod bench;
mod calibrate;
mod interrupted;
mod link;
mod record;
mod simulator;
mod upload;

use bench::{Bench, Said, TWO_STEPS, board};
use softrig_formats::recording::Recording;

fn assert_increasing(recording: &Recording) {
    assert!(recording.time.windows(2).all(|pair| pair[1] > pair[0]));
}
