//! The command with all it has, reports, and both in a browser, in one program.

mod command;
mod live;
#[cfg(feature = "browser")]
mod page_in_browser;
mod report;
#[cfg(feature = "browser")]
mod report_in_browser;
