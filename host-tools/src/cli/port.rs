//! Which port the board is at: as the command line says, else the environment, else `rig.toml`.

use std::path::Path;

use clap::Args;

use softrig_formats::error::InputError;
use softrig_link::rig_file::{RIG_FILE, RigFile};

/// The variable of the environment that names it.
const VARIABLE: &str = "RIG_PORT";

/// The flag of commands that talk to a board.
#[derive(Clone, Debug, Default, Args)]
pub struct PortArgs {
    /// Serial port of the board; `rig ports` lists them [default: RIG_PORT of the environment,
    /// else port in rig.toml]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
}

impl PortArgs {
    /// The port.
    ///
    /// # Errors
    ///
    /// Where nothing names one, and faults of `rig.toml`.
    pub(crate) fn find(&self) -> Result<String, InputError> {
        let variable = std::env::var(VARIABLE).ok().filter(|it| !it.is_empty());
        if let Some(port) = self.port.clone().or(variable) {
            return Ok(port);
        }
        let file = RigFile::find(Path::new(RIG_FILE))?;
        file.and_then(|file| file.port).ok_or_else(|| {
            InputError::new(
                "no port is named",
                format!("give --port (`rig ports` lists them), set {VARIABLE}, or write port = \"…\" into {RIG_FILE}"),
            )
        })
    }
}
