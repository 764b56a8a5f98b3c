//! Set-up, demo, test, flash, bench and ci.
fn main() {}
