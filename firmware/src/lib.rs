//! What the board does, as plain functions that a desktop can test.
//!
//! The binary beside this library owns the registers; everything that decides
//! anything is here, without hardware, without allocation and without panics.
#![no_std]
#![forbid(unsafe_code)]

pub mod io;
pub mod probe;
pub mod safety;
pub mod self_test;
