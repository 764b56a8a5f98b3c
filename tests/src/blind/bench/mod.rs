//! The set `bench`: cases that look like a bench rather than like a simulator.
//!
//! The other sets start every run at rest, hide one effect and end in white
//! noise. Here a case is a whole session: protocols in a drawn order without
//! rest between them, zeros of the sensors that are off, a small coloured force
//! that nothing explains, a clock that jitters, an angle that is cut off at the
//! top. Some cases are of other rigs than an actuator on a pump, and some hide
//! what no catalogue holds.
//!
//! [`world`] is the physics, [`session`] what is played, [`instruments`] what
//! reaches the file, [`sizing`] how large an effect has to be to matter,
//! [`cases`] the drawing, [`score`] the counting and [`tables`] the pages.

pub mod cases;
pub mod instruments;
pub mod score;
pub mod session;
pub mod sizing;
pub mod tables;
pub mod world;

/// The sources that decide what the cases of this set are.
pub const GENERATOR: &str = concat!(
    include_str!("cases.rs"),
    include_str!("instruments.rs"),
    include_str!("session.rs"),
    include_str!("sizing.rs"),
    include_str!("world.rs"),
    include_str!("../cases.rs"),
    include_str!("../kinds.rs"),
    include_str!("../refit.rs"),
    include_str!("../truth.rs"),
);
