//! The command and its libraries from outside, in one program.

#[path = "cli/main.rs"]
mod cli;
#[path = "library/main.rs"]
mod library;
