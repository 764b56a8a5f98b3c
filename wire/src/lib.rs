//! What travels over the serial cable, defined once for both ends.
#![no_std]
#![forbid(unsafe_code)]
