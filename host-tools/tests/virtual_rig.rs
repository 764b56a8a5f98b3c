//! The command on the virtual rig: commissioning, flashing and the whole loop.
#![cfg(unix)]

mod commission_on_the_virtual_rig;
mod flash_on_the_virtual_rig;
mod loop_on_the_virtual_rig;
#[path = "common/virtual_rig.rs"]
mod served;
