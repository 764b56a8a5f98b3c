//! The virtual rig.
fn main() {}
