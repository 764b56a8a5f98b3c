//! The command with all it has, reports, and both in a browser, in one program.

#![cfg(unix)]

#[path = "../../../host-tools/tests/serial/bench.rs"]
#[allow(dead_code)] // The tests of the command use more of it.
mod bench;
mod command;
mod live;
mod page_in_browser;
mod report;
mod report_in_browser;
