//! `softrig init`: the first model file.

use std::io::IsTerminal;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Parser;
use dialoguer::{Input, Select};
use model_core::actuator::ParameterId;
use model_core::material::{Material, TABLE_I};
use schemars::JsonSchema;
use serde::Serialize;

use super::input::InputArgs;
use super::json::{JsonArgs, Parameter, SCHEMA};
use super::output::{self, FileKind, Output};
use softrig::estimate::assemble::assemble;
use softrig::estimate::identify::Order;
use softrig::first_model::{
    FirstModel, Geometry, Origin, from_nothing, from_recordings, next_steps,
};
use softrig_formats::columns::{Columns, Layout, Names};
use softrig_formats::error::{InputError, is_stream, write_atomically};
use softrig_formats::material_name::{like, named};
use softrig_formats::model_file::{ModelFile, parameter_name, parameter_unit, to_file_units};
use softrig_formats::numbers::{short, tidy};
use softrig_formats::ranges::Range;
use softrig_formats::recording::{Recording, check_distinct, read_all};
use softrig_formats::terminal::{printable_line, remark};

/// Writes a first model from a recording, or from material and dimensions.
///
/// From a recording (a step with its release, or better several levels) it identifies
/// stiffness, exponent, damping and input gain in seconds. Without a recording, stiffness and
/// exponent come from the material and the dimensions of a beam, and the rest is guessed.
/// Comments in the file say where each number comes from. Without flags, on a terminal, it
/// asks questions.
///
/// It works for any second-order rig with one input. A pendulum or a motor may have a
/// torque, a voltage or a current in the column `pressure_kpa`; the input gain is then per
/// unit of that.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig init
  softrig init --recording step.csv
  softrig init --recording step60.csv step90.csv --material \"Dragon Skin 20\" -o model.toml
  softrig init --material \"Ecoflex 00-30\" --length-mm 94 --width-mm 30 --height-mm 24 --dry-run
  softrig init --recording motor.csv --units time=ms --name \"motor, V to degrees\"")]
pub struct Args {
    /// Recordings to identify the parameters from
    #[arg(long, value_name = "REC.csv", num_args = 1..)]
    recording: Vec<PathBuf>,
    /// Material: a name from `softrig materials list`, or none
    #[arg(long, value_name = "NAME")]
    material: Option<String>,
    /// Length of the bending part, in millimetres
    #[arg(long, value_name = "MM", conflicts_with = "length_m", value_parser = millimetres)]
    length_mm: Option<f64>,
    /// Width of the section, in millimetres
    #[arg(long, value_name = "MM", conflicts_with = "width_m", value_parser = millimetres)]
    width_mm: Option<f64>,
    /// Height of the section, in the direction of bending, in millimetres
    #[arg(long, value_name = "MM", conflicts_with = "height_m", value_parser = millimetres)]
    height_mm: Option<f64>,
    /// The length, in metres
    #[arg(long, value_name = "M", value_parser = metres)]
    length_m: Option<f64>,
    /// The width, in metres
    #[arg(long, value_name = "M", value_parser = metres)]
    width_m: Option<f64>,
    /// The height, in metres
    #[arg(long, value_name = "M", value_parser = metres)]
    height_m: Option<f64>,
    /// Name of the model in reports [default: the name of the file]
    #[arg(long, value_name = "TEXT")]
    name: Option<String>,
    /// Write the model to this file, which must not exist
    #[arg(short, long, value_name = "MODEL.toml", default_value = "model.toml")]
    output: PathBuf,
    /// Print the file and write nothing
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
}

fn millimetres(text: &str) -> Result<f64, String> {
    length(text, 1e-3, "mm")
}

fn metres(text: &str) -> Result<f64, String> {
    length(text, 1.0, "m")
}

/// A length in metres.
fn length(text: &str, unit_m: f64, unit: &str) -> Result<f64, String> {
    /// A length, a width and a height have the same range.
    const KEY: &str = "length_m";
    let range = Range::of_key(KEY).ok_or("it has no range")?;
    // A product would turn 94 mm into 0.09400000000000001 m.
    let metres = text
        .trim()
        .parse::<f64>()
        .map(|number| number / (1.0 / unit_m).round());
    metres
        .ok()
        .filter(|metres| range.contains(*metres))
        .ok_or_else(|| {
            format!(
                "give a length from {} to {} {unit}",
                range.least / unit_m,
                range.most / unit_m
            )
        })
}

/// Longer than it takes to handle Ctrl-C.
const HANDLED: Duration = Duration::from_millis(300);

/// What is known about a rig.
#[derive(Clone, Debug)]
struct Known {
    geometry: Option<Geometry>,
    recordings: Vec<PathBuf>,
    /// Which columns they have.
    layout: Layout,
    output: PathBuf,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the arguments and of the recordings, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let known = if args.says_something() {
        args.known()?
    } else if std::io::stdin().is_terminal() && std::io::stderr().is_terminal() {
        match ask(args) {
            Ok(Some(known)) => known,
            Ok(None) => return Ok(()),
            Err(error) => {
                // After Ctrl-C the handler ends the program, a moment later.
                std::thread::sleep(HANDLED);
                return Err(error);
            }
        }
    } else {
        return Err(InputError::new(
            "softrig init has no information about the rig, and no terminal to ask on",
            "give a recording, as in `softrig init --recording step.csv`, or material and dimensions, as in `softrig init --material \"Dragon Skin 20\" --length-mm 94 --width-mm 30 --height-mm 24`",
        )
        .into());
    };
    if !args.dry_run {
        refuse_existing(&known.output)?;
    }
    output::check(
        &[
            Output::of("-o", FileKind::Model, Some(&known.output)).unless(args.dry_run),
            args.json.output(),
        ],
        &known.recordings,
    )?;
    let first = identify(&known)?;
    let name = args.name.clone().unwrap_or_else(|| {
        let stem = known.output.file_stem().unwrap_or_default();
        stem.to_string_lossy().into_owned()
    });
    let text = first.text(&name, &known.recordings, &known.layout, &known.output);
    // What is written is read again before it is.
    ModelFile::parse(&text, &known.output)?;
    let summary = summary(&first);
    let result = FirstResult::of(&first);
    if args.dry_run {
        remark(summary.trim_end());
        return args.json.deliver(&result, &text);
    }
    write_atomically(&known.output, text.as_bytes())?;
    let next = next_steps(&known.recordings, &known.output);
    let text = format!(
        "{summary}\nwritten: {}\n\n{}\n",
        known.output.display(),
        next.join("\n")
    );
    args.json.deliver(&result, &text)
}

/// What `softrig init --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct FirstResult {
    /// Version of the layout.
    schema: u32,
    /// The base parameters, in the units of model files.
    parameters: Vec<Parameter>,
    /// What later fits may move.
    free: Vec<String>,
    /// RMS error (°); absent without a recording.
    #[serde(skip_serializing_if = "Option::is_none")]
    rmse_deg: Option<f64>,
    /// Why a material that was given is not used.
    #[serde(skip_serializing_if = "Option::is_none")]
    unused_material: Option<String>,
}

impl FirstResult {
    fn of(first: &FirstModel) -> Self {
        let parameter = |id: ParameterId| {
            let value = first.model.value(id).unwrap_or_default();
            let origin = first.origin(id);
            Parameter {
                name: parameter_name(&first.model, id),
                unit: parameter_unit(&first.model, id).to_owned(),
                nominal: None,
                value: tidy(to_file_units(&first.model, id, value)),
                interval95: match origin {
                    Origin::Fitted(Some((low, high))) => Some([tidy(*low), tidy(*high)]),
                    _ => None,
                },
                from: Some(origin.word().to_owned()),
            }
        };
        Self {
            schema: SCHEMA,
            parameters: ParameterId::BASE.into_iter().map(parameter).collect(),
            free: first
                .free
                .iter()
                .map(|id| parameter_name(&first.model, *id))
                .collect(),
            rmse_deg: first.evidence.as_ref().map(|it| tidy(it.rms.to_degrees())),
            unused_material: first.unused_material(),
        }
    }
}

impl Args {
    fn says_something(&self) -> bool {
        self.material.is_some()
            || !self.recording.is_empty()
            || self.dimensions().iter().any(Option::is_some)
    }

    /// Length, width and height (m).
    fn dimensions(&self) -> [Option<f64>; 3] {
        [
            self.length_mm.or(self.length_m),
            self.width_mm.or(self.width_m),
            self.height_mm.or(self.height_m),
        ]
    }

    fn known(&self) -> Result<Known, InputError> {
        let material = match self.material.as_deref() {
            None => None,
            Some(name) if name.eq_ignore_ascii_case("none") => None,
            Some(name) => Some(material(name)?),
        };
        let given = self.dimensions();
        let dimensions = match given {
            [Some(length), Some(width), Some(height)] => Some([length, width, height]),
            [None, None, None] => None,
            _ => {
                let names = ["--length-mm", "--width-mm", "--height-mm"];
                let missing: Vec<&str> = names
                    .into_iter()
                    .zip(given)
                    .filter(|(_, value)| value.is_none())
                    .map(|(name, _)| name)
                    .collect();
                return Err(InputError::new(
                    format!("{} is missing", missing.join(" and ")),
                    "a beam has a length, a width and a height: give all three, or none",
                ));
            }
        };
        let Some(material) = material else {
            if dimensions.is_some() {
                return Err(InputError::new(
                    "dimensions need a material",
                    "add --material with a name of `softrig materials list`, or leave the dimensions out",
                ));
            }
            return Ok(Known {
                geometry: None,
                recordings: self.recording.clone(),
                layout: self.input.layout_over(&Layout::default())?,
                output: self.output.clone(),
            });
        };
        Ok(Known {
            geometry: Some(Geometry {
                material,
                dimensions,
                assumed: false,
            }),
            recordings: self.recording.clone(),
            layout: self.input.layout_over(&Layout::default())?,
            output: self.output.clone(),
        })
    }
}

fn material(name: &str) -> Result<&'static Material, InputError> {
    named(name).ok_or_else(|| {
        let quoted = |list: Vec<&'static Material>| -> String {
            let names: Vec<String> = list
                .iter()
                .map(|material| format!("\"{}\"", material.name))
                .collect();
            names.join(", ")
        };
        let near = like(name);
        let advice = if near.is_empty() {
            format!(
                "give one of {}; for another material use `softrig materials predict`, or --material none",
                quoted(TABLE_I.iter().collect())
            )
        } else {
            format!("did you mean {}? `softrig materials list` shows all", quoted(near))
        };
        InputError::new(format!("{name} is not in the table of materials"), advice)
    })
}

/// A first model is written once: whatever has its name since then is somebody's work.
fn refuse_existing(path: &Path) -> Result<(), InputError> {
    if !path.exists() || is_stream(path) {
        return Ok(());
    }
    Err(InputError::new(
        "already exists, and softrig init never overwrites",
        "choose another name with -o, or see what would be written with --dry-run",
    )
    .in_file(path))
}

fn identify(known: &Known) -> anyhow::Result<FirstModel> {
    if known.recordings.is_empty() {
        return from_nothing(known.geometry).map_err(Into::into);
    }
    check_distinct(&known.recordings, &[])?;
    let recordings = read_all(&known.recordings, &known.layout, super::warn)?;
    if known.layout.columns.time.is_none() {
        ask_about_time(&recordings);
    }
    let assembled = assemble(&recordings, &[])?;
    for concern in &assembled.concerns {
        super::warn(&concern.to_string());
    }
    let spinner = super::spinner();
    spinner.set_message("identifying the parameters");
    let first = from_recordings(&assembled.data, known.geometry);
    spinner.finish_and_clear();
    Ok(first?)
}

/// Warns about times in milliseconds, which only the interval between samples can show: any
/// other wrong unit is absorbed by a parameter.
fn ask_about_time(recordings: &[Recording]) {
    /// Longest plausible interval between samples (s).
    const SLOW_S: f64 = 1.0;
    if let Some(slow) = recordings.iter().find(|it| it.interval() >= SLOW_S) {
        super::warn(&format!(
            "{}: there are {} s between samples; if the times are milliseconds, add --units time=ms",
            slow.path.display(),
            short(slow.interval())
        ));
    }
}

/// The parameters with their sources, and warnings.
fn summary(first: &FirstModel) -> String {
    let mut text = format!("{:<32} {:>11}   from\n", "parameter", "value");
    for id in ParameterId::BASE {
        let unit = parameter_unit(&first.model, id);
        let name = parameter_name(&first.model, id);
        let label = if unit.is_empty() {
            name
        } else {
            format!("{name} ({unit})")
        };
        let value = first.model.value(id).unwrap_or_default();
        text += &format!(
            "{label:<32} {:>11}   {}\n",
            short(to_file_units(&first.model, id, value)),
            first.origin(id).word()
        );
    }
    if let Some(unused) = first.unused_material() {
        text += &format!("\n{unused}\n");
    }
    let Some(evidence) = &first.evidence else {
        text += "\nNone of this was measured on your rig: guesses are marked in the file.\n";
        return text;
    };
    let unit = evidence.measurand.unit();
    text += &format!(
        "\nRMS error {}{unit}, of {}{unit} about the mean.\n",
        short(evidence.rms.to_degrees()),
        short(evidence.about_mean.to_degrees())
    );
    if evidence.order == Order::First {
        text += "The motion is first-order: the inertia is not identifiable, only the ratios of damping, stiffness and gain are.\n";
    }
    if evidence.explains_little() {
        super::warn(
            "this model explains little of the motion: a large effect is missing (run `softrig diagnose`), the columns hold something else (see the flags under \"If the columns mean something else\"), or this is not a second-order rig with one input",
        );
    }
    if !evidence.driven {
        super::warn("the input is zero all the time: the input gain stays 1, and is not fitted");
    }
    if !first.free.contains(&ParameterId::Exponent) && evidence.driven && evidence.levels < 3 {
        text += "The recordings do not determine the exponent: record steps to two or more levels for that.\n";
    }
    text
}

/// Asks for what the flags would have said; none if the user gives up.
fn ask(args: &Args) -> anyhow::Result<Option<Known>> {
    // The list of choices hides the cursor.
    super::on_interrupt(|| {
        /// 128 and the number of the signal, as shells have it.
        const INTERRUPTED: i32 = 130;
        let _ = dialoguer::console::Term::stderr().show_cursor();
        remark("\nnothing was written");
        std::process::exit(INTERRUPTED);
    })?;
    remark(
        "A first model of your rig. Leave unknowns empty; Escape or Ctrl-C quits without writing.",
    );
    let mut choices: Vec<&str> = TABLE_I.iter().map(|material| material.name).collect();
    choices.push("another material, or none");
    let Some(chosen) = Select::new()
        .with_prompt("Material")
        .items(&choices)
        .default(choices.len() - 1)
        .interact_opt()?
    else {
        remark("nothing was written");
        return Ok(None);
    };
    let geometry = match TABLE_I.get(chosen) {
        None => None,
        Some(material) => Some(Geometry {
            material,
            dimensions: ask_dimensions()?,
            assumed: false,
        }),
    };
    let (recordings, layout) = ask_recordings(args.input.layout_over(&Layout::default())?)?;
    let output: String = Input::new()
        .with_prompt("Write the model to")
        .default(args.output.display().to_string())
        .validate_with(|text: &String| {
            refuse_existing(Path::new(text.trim())).map_err(|error| error.to_string())
        })
        .interact_text()?;
    Ok(Some(Known {
        geometry,
        recordings,
        layout,
        output: output.trim().into(),
    }))
}

/// The names in a line, with `;` between them.
fn paths_in(text: &str) -> Vec<PathBuf> {
    let names = text.split(';').map(str::trim);
    names
        .filter(|name| !name.is_empty())
        .map(PathBuf::from)
        .collect()
}

/// The recordings, read at once, and their columns: asked for as long as they are not known.
fn ask_recordings(mut layout: Layout) -> anyhow::Result<(Vec<PathBuf>, Layout)> {
    loop {
        let text: String = Input::new()
            .with_prompt("Recordings of steps (with ; between them; empty for none)")
            .allow_empty(true)
            .validate_with(|text: &String| {
                match paths_in(text).into_iter().find(|path| !path.exists()) {
                    None => Ok(()),
                    Some(path) => Err(format!(
                        "there is no file {}",
                        printable_line(&path.to_string_lossy())
                    )),
                }
            })
            .interact_text()?;
        let paths = paths_in(&text);
        while let Err(error) = read_all(&paths, &layout, |_| ()) {
            remark(&error.to_string());
            let Some(suggestion) = error.suggestion else {
                break;
            };
            let columns: String = Input::new()
                .with_prompt("Columns (empty for other recordings)")
                .with_initial_text(suggestion.columns)
                .allow_empty(true)
                .validate_with(|text: &String| match text.trim() {
                    "" => Ok(()),
                    text => Names::parse(text).map(drop),
                })
                .interact_text()?;
            if columns.trim().is_empty() {
                break;
            }
            let units: String = Input::new()
                .with_prompt("Units (empty for s, kPa and °)")
                .with_initial_text(suggestion.units)
                .allow_empty(true)
                .validate_with(|text: &String| match text.trim() {
                    "" => Ok(()),
                    text => Columns::of_units(text).map(drop),
                })
                .interact_text()?;
            let said = Layout {
                names: Names::parse(columns.trim()).unwrap_or_default(),
                columns: Columns::of_units(units.trim()).unwrap_or_default(),
                ..Layout::default()
            };
            layout = said.or(&layout);
        }
        if read_all(&paths, &layout, |_| ()).is_ok() {
            return Ok((paths, layout));
        }
    }
}

/// Length, width and height (m), if all are known.
fn ask_dimensions() -> anyhow::Result<Option<[f64; 3]>> {
    let mut dimensions = [0.0; 3];
    for (dimension, prompt) in dimensions.iter_mut().zip([
        "Length of the bending part (mm; empty if unknown)",
        "Width of its section (mm)",
        "Height of its section, in the direction of bending (mm)",
    ]) {
        let text: String = Input::new()
            .with_prompt(prompt)
            .allow_empty(true)
            .validate_with(|text: &String| {
                if text.trim().is_empty() {
                    Ok(())
                } else {
                    millimetres(text).map(drop)
                }
            })
            .interact_text()?;
        match millimetres(&text) {
            Ok(metres) => *dimension = metres,
            // Two of three are none.
            Err(_) => return Ok(None),
        }
    }
    Ok(Some(dimensions))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_keep_their_digits() {
        assert_eq!(millimetres("94"), Ok(0.094));
        assert_eq!(millimetres(" 1.5 "), Ok(0.0015));
        assert_eq!(metres("0.094"), Ok(0.094));
        for wrong in ["", "0", "-3", "nan", "inf", "94mm", "1e9"] {
            let said = millimetres(wrong).unwrap_err();
            assert_eq!(said, "give a length from 0.01 to 1000000 mm", "{wrong}");
        }
    }
}
