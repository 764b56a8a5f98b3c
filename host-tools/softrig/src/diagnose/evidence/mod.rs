//! What speaks for a structure and against it: errors on segments that it was not fitted to, how sure
//! their difference is, and what keeps it from being a name.

pub mod alike;
pub(crate) mod discrepancy;
pub(crate) mod doubts;
pub(crate) mod draws;
pub mod free_run;
pub mod measure;
pub mod validation;
