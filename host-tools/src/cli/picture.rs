//! The look of a picture, as the flags beside `--plot` say it.

use std::path::PathBuf;

use clap::Args;
use softrig_formats::error::InputError;
use softrig_report::plot::{self, Colours, Figure, Length, Look};

/// How a picture looks that is written beside the results.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Picture, as .svg, .pdf or .png")]
pub struct PictureArgs {
    /// Width, such as 89mm, 3.5in, 252pt or 800px; the layout adapts
    #[arg(long, value_name = "WIDTH")]
    width: Option<Length>,
    /// Size of its labels, in points [default: 8 with --width]
    #[arg(long, value_name = "PT", value_parser = Look::font_size)]
    font_size: Option<f64>,
    /// Include a heading [default: yes; no in a PDF]
    #[arg(long, value_name = "yes|no", value_parser = yes_or_no)]
    headline: Option<bool>,
    /// Draw only these panels: numbers from the top left, or words from headings and labels
    #[arg(long, value_name = "PANEL,…", value_delimiter = ',')]
    panels: Vec<String>,
    /// Colours: screen, or print, distinct in grey too [default: screen; print in a PDF]
    #[arg(long, value_name = "screen|print")]
    colours: Option<Colours>,
}

/// Reads yes or no.
fn yes_or_no(text: &str) -> Result<bool, String> {
    match text {
        "yes" => Ok(true),
        "no" => Ok(false),
        _ => Err("give yes or no".to_owned()),
    }
}

impl PictureArgs {
    fn look(&self) -> Look {
        Look {
            width: self.width,
            font_pt: self.font_size,
            headline: self.headline,
            panels: self.panels.clone(),
            colours: self.colours,
        }
    }

    /// Refuses a look without a picture; `flag` is the one that asks for it.
    ///
    /// # Errors
    ///
    /// Names that flag.
    pub(crate) fn check(&self, flag: &str, path: Option<&PathBuf>) -> Result<(), InputError> {
        if path.is_some() || self.look().is_default() {
            return Ok(());
        }
        Err(InputError::new(
            "picture options were given, but no picture file",
            format!("add {flag} picture.pdf"),
        ))
    }

    /// Draws a figure as asked for.
    ///
    /// # Errors
    ///
    /// If it has no such panels, or the file cannot be written.
    pub(crate) fn write(&self, path: &std::path::Path, figure: &Figure) -> Result<(), InputError> {
        if let Some(height_mm) = plot::write(path, figure, &self.look())? {
            super::warn(&format!(
                "{}: is {height_mm:.0} mm high, more than a page; reduce it with --panels or, if available, --runs",
                path.display()
            ));
        }
        Ok(())
    }
}
