//! A functional mock-up unit: the C file behind the functions of FMI 2.0 for co-simulation, with
//! its source and, where there is a C compiler, a library for this machine.
//!
//! Simulink, OpenModelica, Dymola, FMPy and every other tool that knows FMI can then step the
//! model beside others. The input is taken as it is given: held over a step, or in a straight line
//! where the tool says its slope.

use std::io::{Cursor, Write};
use std::process::Command;

use minijinja::context;
use sha2::{Digest, Sha256};
use zip::write::{SimpleFileOptions, ZipWriter};

use super::{ExportError, Source, c, environment};
use softrig::sim::simulate;
use softrig_formats::numbers::exact;
use softrig_formats::terminal::printable_line;

/// The interface, below the C file.
const INTERFACE: &str = include_str!("fmi2.jinja");

/// The description.
const DESCRIPTION: &str = include_str!("model_description.xml");

/// A parameter of the unit.
#[derive(Debug, serde::Serialize)]
struct Parameter {
    name: &'static str,
    about: &'static str,
    unit: &'static str,
    start: String,
}

/// A unit, packed.
#[derive(Clone, Debug)]
pub struct Packed {
    /// The archive.
    pub bytes: Vec<u8>,
    /// Why there is only the source in it; none where there is a library too.
    pub source_only: Option<String>,
}

/// Packs a model.
///
/// # Errors
///
/// Errors of the templates, and of the archive.
pub(super) fn pack(source: &Source) -> Result<Packed, ExportError> {
    let physics = &source.physics;
    let code = c::export(source)?;
    let defaults = source.defaults;
    // Of what it computes: another model is another unit.
    let digest = Sha256::digest(code.as_bytes());
    let bytes = digest.iter().take(16);
    let guid = format!(
        "{:032x}",
        bytes.fold(0u128, |all, &byte| (all << 8) | u128::from(byte))
    );
    let delay = physics.delay.map(|delay| c::expression(source, delay));
    let mut templates = environment()?;
    templates.add_template("fmi2", INTERFACE)?;
    // The name decides that values are escaped.
    templates.add_template("model_description.xml", DESCRIPTION)?;
    let interface = templates.get_template("fmi2")?.render(context! {
        guid => guid.as_str(),
        delay,
        diverged => exact(simulate::DIVERGED),
    })?;
    let model = &source.file.model;
    let rests_at = model.reading(&model.at_rest(0.0, 0.0)).to_degrees();
    let parameters = [
        (
            "start_deg",
            "What the sensor shows at first",
            "deg",
            defaults.start_deg.unwrap_or(rests_at),
        ),
        (
            "start_deg_per_s",
            "Its rate",
            "deg/s",
            defaults.start_deg_per_s,
        ),
        (
            "pressure_zero_kpa",
            "What the pressure sensor shows without pressure",
            "kPa",
            defaults.pressure_zero_kpa,
        ),
        (
            "angle_zero_deg",
            "What the angle sensor shows at 0 degrees",
            "deg",
            defaults.angle_zero_deg,
        ),
        (
            "largest_angle_deg",
            "Steps are fine enough for angles up to this one",
            "deg",
            defaults.largest_angle_deg,
        ),
    ]
    .map(|(name, about, unit, start)| Parameter {
        name,
        about,
        unit,
        start: exact(start),
    });
    let description = templates
        .get_template("model_description.xml")?
        .render(context! {
            title => printable_line(&source.file.name),
            guid => guid.as_str(),
            name => source.name.as_str(),
            version => env!("CARGO_PKG_VERSION"),
            pressure_zero_kpa => exact(defaults.pressure_zero_kpa),
            parameters => minijinja::value::Serde(&parameters),
        })?;
    let code = code + &interface;
    let library = compiled(&code, &source.name);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default();
    let mut add = |path: String, content: &[u8]| -> Result<(), ExportError> {
        archive.start_file(path, options)?;
        archive
            .write_all(content)
            .map_err(|error| ExportError::Archive(error.into()))
    };
    add("modelDescription.xml".to_owned(), description.as_bytes())?;
    add(format!("sources/{}.c", source.name), code.as_bytes())?;
    let source_only = match library {
        Ok(library) => {
            let (folder, extension) = PLATFORM;
            add(
                format!("binaries/{folder}/{}.{extension}", source.name),
                &library,
            )?;
            None
        }
        Err(why) => Some(why),
    };
    Ok(Packed {
        bytes: archive.finish()?.into_inner(),
        source_only,
    })
}

/// The folder and the extension of libraries for this machine.
const PLATFORM: (&str, &str) = if cfg!(windows) {
    ("win64", "dll")
} else if cfg!(target_os = "macos") {
    ("darwin64", "dylib")
} else {
    ("linux64", "so")
};

/// A library for this machine, by its C compiler, or why there is none.
fn compiled(code: &str, name: &str) -> Result<Vec<u8>, String> {
    if cfg!(not(target_arch = "x86_64")) && cfg!(not(target_os = "macos")) {
        return Err("FMI 2.0 has no folder for libraries of this processor".to_owned());
    }
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".to_owned());
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let [from, to] = [format!("{name}.c"), format!("{name}.{}", PLATFORM.1)];
    std::fs::write(folder.path().join(&from), code).map_err(|error| error.to_string())?;
    let output = Command::new(&compiler)
        // Products and sums are rounded as `softrig simulate` rounds them.
        .args(["-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared"])
        .args(["-fvisibility=hidden", "-o", &to, &from, "-lm"])
        .current_dir(folder.path())
        .output()
        .map_err(|error| format!("{compiler} cannot be started: {error}"))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let first = said.lines().next().unwrap_or_default();
        return Err(format!("{compiler} ended with {}: {first}", output.status));
    }
    std::fs::read(folder.path().join(&to)).map_err(|error| error.to_string())
}
