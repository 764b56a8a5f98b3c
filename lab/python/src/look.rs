//! Pictures as files, and their look by keyword arguments that are named as the flags of `softrig`.

use std::path::Path;

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use softrig_formats::error::InputError as Fault;
use softrig_report::plot::{Figure, Look, write};

use crate::fault::OrRaise;

/// The look that the keyword arguments say.
fn look(given: Option<&Bound<'_, PyDict>>) -> PyResult<Look> {
    let mut look = Look::default();
    for (key, value) in given.into_iter().flatten() {
        if value.is_none() {
            continue;
        }
        let key: String = key.extract()?;
        let said = || -> PyResult<String> { Ok(value.str()?.to_string()) };
        match key.as_str() {
            "width" => look.width = Some(read(said()?.parse())?),
            "font_size" => look.font_pt = Some(read(Look::font_size(&said()?))?),
            "headline" => look.headline = Some(value.extract()?),
            "panels" => look.panels = words(&value)?,
            "colours" => look.colours = Some(read(said()?.parse())?),
            _ => {
                return Err(PyTypeError::new_err(format!(
                    "unexpected keyword argument {key:?}; a picture has width, font_size, headline, panels, runs and colours"
                )));
            }
        }
    }
    Ok(look)
}

fn read<T>(said: Result<T, String>) -> PyResult<T> {
    said.map_err(PyValueError::new_err)
}

/// Words or numbers, several or one.
pub fn words(given: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
    if given.is_instance_of::<PyString>() {
        return Ok(vec![given.extract()?]);
    }
    given
        .try_iter()?
        .map(|word| Ok(word?.str()?.to_string()))
        .collect()
}

/// Refuses a look without a file that would have it: matplotlib's axes have their own.
pub fn refuse(py: Python<'_>, given: Option<&Bound<'_, PyDict>>) -> PyResult<()> {
    if look(given)?.is_default() {
        return Ok(());
    }
    Err(Fault::new(
        "picture options were given, but no file",
        "add a path, as plot(\"picture.pdf\", width=\"89mm\"), or change matplotlib's axes",
    ))
    .or_raise(py)
}

/// Draws a figure into a file, SVG, PDF or PNG by its extension.
pub fn draw(
    py: Python<'_>,
    path: &Path,
    figure: &Figure,
    given: Option<&Bound<'_, PyDict>>,
) -> PyResult<()> {
    let look = look(given)?;
    // How high it is on paper, whoever draws it sees.
    py.detach(|| write(path, figure, &look))
        .or_raise(py)
        .map(drop)
}
