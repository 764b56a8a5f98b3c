//! The `softrig` program.
#![forbid(unsafe_code)]

use std::ffi::OsString;
use std::process::ExitCode;

/// Instead of musl's, which gives memory back to the system at every turn.
#[cfg(target_env = "musl")]
#[global_allocator]
static ALLOCATOR: dlmalloc::GlobalDlmalloc = dlmalloc::GlobalDlmalloc;

fn main() -> ExitCode {
    let arguments: Vec<OsString> = std::env::args_os().collect();
    ExitCode::from(softrig_cli::command::main(&arguments))
}
