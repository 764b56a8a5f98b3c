//! Which port the board is at: as the command line says, else the environment, else `softrig.toml`.

use clap::Args;

use softrig_formats::error::InputError;
use softrig_formats::terminal::remark;
use softrig_link::rig_file::{RIG_FILE, RigFile, rig_file};

/// The variable of the environment that names it.
const VARIABLE: &str = "SOFTRIG_PORT";
/// Its name before 0.1.0.
const OLD_VARIABLE: &str = "RIG_PORT";

/// The flag of commands that talk to a board.
#[derive(Clone, Debug, Default, Args)]
pub struct PortArgs {
    /// Serial port of the board; `softrig ports` lists them [default: $SOFTRIG_PORT, else port in
    /// softrig.toml]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
}

impl PortArgs {
    /// The port.
    ///
    /// # Errors
    ///
    /// Where nothing names one, and faults of `softrig.toml`.
    pub(crate) fn find(&self) -> Result<String, InputError> {
        let variable = |name| std::env::var(name).ok().filter(|it| !it.is_empty());
        if let Some(port) = self.port.clone().or_else(|| variable(VARIABLE)) {
            return Ok(port);
        }
        if let Some(port) = variable(OLD_VARIABLE) {
            remark(&format!(
                "Using port {port} from {OLD_VARIABLE}, now named {VARIABLE}."
            ));
            return Ok(port);
        }
        let file = RigFile::find(rig_file())?;
        file.and_then(|file| file.port).ok_or_else(|| {
            InputError::new(
                "no port is named",
                format!("give --port (`softrig ports` lists them), set {VARIABLE}, or write port = \"…\" into {RIG_FILE}"),
            )
        })
    }
}
