//! The integrators and the effects, against theory and against a solver that
//! shares no code with them.
//!
//! A fit believes the simulation, and a diagnosis names an effect because the
//! simulation without it misses. Neither would notice an integrator that is of
//! the wrong order or an effect with a wrong sign: parameters would absorb the
//! one and a different effect would take the place of the other. So the
//! numbers are checked here from outside the crate, where only its public
//! interface can be reached.

mod closed_form;
mod effects;
mod energy;
mod order;
mod pairs;
mod properties;
mod solver;
mod step_responses;
mod support;
mod symmetry;
