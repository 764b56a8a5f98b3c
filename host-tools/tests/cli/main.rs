//! The `softrig` command as its users meet it: what it prints, writes and returns.
//!
//! A lab hands over damaged files, swapped columns and slips of the keyboard.
//! Each has to end in one sentence that says where and what to do, in exit
//! code 2, and in a folder that is as it was.

mod arguments;
mod batch;
mod columns;
#[path = "../common/mod.rs"]
mod common;
mod diagnose;
mod hostile;
mod init;
mod machines;
mod measurand;
mod models;
mod outputs;
mod own_simulation;
#[path = "../common/schema.rs"]
mod schema;
mod simulate;
