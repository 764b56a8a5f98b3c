//! Everything behind the `rig` command: recordings and models in, fits,
//! pictures and verdicts out.
#![forbid(unsafe_code)]

pub mod dual;
pub mod error;
pub mod fit;
pub mod materials;
pub mod model_file;
pub mod plot;
pub mod recording;
pub mod simulate;
pub mod statistics;
