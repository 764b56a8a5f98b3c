//! The command on the virtual rig: commissioning, flashing and the whole loop. In a program of its own: others would take
//! the processor from the board.
#![cfg(unix)]

mod commission;
#[path = "../../../../host-tools/tests/common/mod.rs"]
mod common;
mod flash;
mod page;
mod served;
mod whole_loop;
