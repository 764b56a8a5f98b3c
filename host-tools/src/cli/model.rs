//! Which model a command is about: as the command line says, else `softrig.toml`.

use std::path::PathBuf;

use clap::Args;

use softrig_formats::error::InputError;
use softrig_formats::terminal::remark;
use softrig_link::rig_file::{RIG_FILE, RigFile, rig_file};

/// The flag of commands that are about one model.
#[derive(Clone, Debug, Default, Args)]
pub struct ModelArgs {
    /// Model file [default: model in softrig.toml]
    #[arg(long, value_name = "MODEL.toml")]
    model: Option<PathBuf>,
}

impl ModelArgs {
    /// The model file.
    ///
    /// # Errors
    ///
    /// Where nothing names one, and faults of `softrig.toml`.
    pub(crate) fn find(&self) -> Result<PathBuf, InputError> {
        self.model.clone().map_or_else(of_rig_file, Ok)
    }
}

/// The model that `softrig.toml` names, which is said where it is taken.
///
/// # Errors
///
/// As for [`ModelArgs::find`].
pub(crate) fn of_rig_file() -> Result<PathBuf, InputError> {
    let file = rig_file();
    let Some(model) = RigFile::find_model(file)? else {
        return Err(InputError::new(
            "no model is named",
            format!(
                "give --model MODEL.toml, or write model = \"MODEL.toml\" into {RIG_FILE}; `softrig init` makes a first one"
            ),
        ));
    };
    remark(&format!(
        "Using model {}, set in {}.",
        model.display(),
        file.display()
    ));
    Ok(model)
}
