//! The set `bench`: cases that look like a bench rather than like a simulator.
//!
//! The other sets start every run at rest, hide one effect and end in white
//! noise. Here a case is a whole session: protocols in a drawn order without
//! rest between them, sensors with zero errors, a small coloured force
//! that nothing explains, a clock that jitters, an angle that is cut off at the
//! top. Some cases are of other rigs than an actuator on a pump, and some hide
//! what no catalogue holds. [`session`] is what is played, [`instruments`] what
//! reaches the file, [`sizing`] how much of an effect a refit leaves.

pub mod cases;
pub mod instruments;
pub mod session;
pub mod sizing;
