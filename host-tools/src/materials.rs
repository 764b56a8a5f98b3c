//! What is known of a material before an actuator is moulded from it.
//!
//! Three questions are answered here, and `rig materials` prints the answers:
//! what the paper's table says, which exponent a tensile test gives
//! ([`fit`]), and which one a data sheet promises ([`predictor`]). The choices
//! hidden in each answer (stress and strain measure, range, residual, rows of
//! the table) move the exponent by more than its standard error, so each of
//! them is an argument and is printed with the result.

pub mod curve;
pub mod fit;
pub mod predictor;
