//! The library from outside: searches that end early, exported models, and what the manual says.

mod budget;
mod exported;
mod held_out_repeats;
mod serial_manual;
mod tolerance;
