//! `softrig plan`: the run that best separates two explanations.

use std::path::{Path, PathBuf};

use clap::Parser;
use model_core::actuator::Model;
use model_core::catalogue::Kind;
use schemars::JsonSchema;
use serde::Serialize;

use super::input::InputArgs;
use super::json::{JsonArgs, SCHEMA};
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use softrig::diagnose::Job;
use softrig::diagnose::experiment::plan::{Limits, Proposal, proposals, work_min};
use softrig::diagnose::fit::candidates::{Candidate, typical};
use softrig::diagnose::fit::identifiability::{self, NominalRefit};
use softrig::diagnose::fit::structures;
use softrig::diagnose::recordings::noise::NoiseFloor;
use softrig::diagnose::score::grammar::{PREFIX, terms};
use softrig::diagnose::score::scales::Scales;
use softrig::diagnose::work::executor::Executor;
use softrig::estimate::assemble::assemble;
use softrig::estimate::checkpoint::Checkpoint;
use softrig::estimate::fitter::Fitter;
use softrig::estimate::unit_errors;
use softrig::estimate::{Dataset, Nuisance};
use softrig::sim::protocol::{Play, Protocol, play};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::family::names;
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::{evidence, tidy};
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::protocol_file::ProtocolFile;
use softrig_formats::recording::{PASCAL_PER_KPA, Recording, measurand};

/// Finds the run that separates two effects, within the limits of the rig, and
/// writes it as a protocol file that `softrig record` plays.
///
/// Both effects are fitted to the recordings first. Without recordings, steps
/// to 60° and 90° of an actuator with the first effect are simulated instead.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig plan --model m.toml --between coulomb_friction,bouc_wen_hysteresis run.csv -o next.toml
  softrig plan --model m.toml --between gravity,exponent_shift run.csv -o next.csv   a rig of yours
  softrig plan --model m.toml --between gravity,exponent_shift --limits deg=60,kpa=80,s=60
  softrig plan --model m.toml --between term_angle_5,cubic_stiffness run.csv")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// File of your own effects, given by formulas, that --between may name
    #[arg(long, value_name = "EFFECTS.toml")]
    effects: Option<PathBuf>,
    /// The two effects; join effects that act together with +
    #[arg(long, value_name = "A,B")]
    between: String,
    /// Existing recordings
    #[arg(value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Highest set-point (deg), highest pressure (kpa), longest run (s)
    #[arg(long, value_name = "deg=90,kpa=170,s=180")]
    limits: Option<String>,
    /// Noise of the angle (° RMS) [default: from the recordings, or 0.4]
    #[arg(long, value_name = "DEG")]
    noise_deg: Option<f64>,
    /// Write the best run, if it decides: as a protocol file, or as .csv with the pressure over
    /// time, for a rig that softrig does not drive
    #[arg(short, long, value_name = "PROTOCOL.toml|PRESSURE.csv")]
    output: Option<PathBuf>,
    /// Write it even if it does not decide
    #[arg(long, requires = "output")]
    force: bool,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
}

/// What is to be said where no run that is known decides.
pub(super) const NOTHING_DECIDES: &str =
    "no pressure and no known change of the rig separates these effects.
Better calibrated zeros may ([calibration] in the metadata), or a tip load and a tube length in
[setup], from which further runs can be planned.
";

/// Runs that are listed.
const LISTED: usize = 5;

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = args.model.find()?;
    let read = args.recordings.iter().chain([&model]);
    let read = read.chain(&args.effects);
    let kind = match &args.output {
        Some(path) if is_table(path) => FileKind::Recording,
        _ => FileKind::Protocol,
    };
    output::check(
        &[
            Output::of("-o", kind, args.output.as_ref()),
            args.json.output(),
        ],
        read,
    )?;
    let (file, recordings) = super::read(&model, &args.recordings, &args.input)?;
    let measurand = measurand(&recordings);
    let own = match &args.effects {
        Some(path) => Some(OwnEffects::read(path, &file.model)?),
        None => None,
    };
    let limits = limits(args.limits.as_deref())?;
    let (plan, list) = Plan::between(
        &file,
        recordings,
        &args.between,
        own.as_ref(),
        limits,
        args.noise_deg,
    )?;
    let best = &list[0];
    let mut text = format!(
        "To tell {} from {}, with {} of noise:\n\n{:<20} {:>6} {:>12} {:>12}  {}\n",
        plan.between[0].join(" + "),
        plan.between[1].join(" + "),
        measurand.value(plan.noise_deg.to_radians()),
        "protocol",
        "s",
        "work (min)",
        "expected Δχ²",
        "what it is"
    );
    for proposal in list.iter().take(LISTED) {
        text += &format!(
            "{:<20} {:>6.0} {:>12.1} {:>12}  {}{}\n",
            proposal.protocol.name,
            f64::from(proposal.protocol.total_ms()) / 1000.0,
            work_min(&proposal.protocol),
            evidence(proposal.evidence),
            proposal.protocol.setup.instruction(),
            proposal.protocol.title
        );
    }
    text += "\nEach effect is refitted within the limits of the recordings. A Δχ² of 20 is very\nstrong for exact formulas; a run decides if the other effect would also miss by a third\nmore than the noise.\n";
    let decides = best.decides;
    if !decides {
        text += "No run comes close: ";
        text += NOTHING_DECIDES;
    }
    if let Some(path) = args.output.as_ref().filter(|_| decides || args.force) {
        let instruction = best.protocol.setup.instruction();
        if is_table(path) {
            write_atomically(path, pressures(&best.protocol, &file).as_bytes())?;
            text += &format!(
                "Pressure: {}\nNext: {instruction}play it on your rig, and record pressure and angle\n",
                path.display()
            );
        } else {
            write_atomically(path, best.protocol.to_text().as_bytes())?;
            let path = path.display();
            text += &format!(
                "Protocol: {path}\nNext: {instruction}softrig record --port PORT --plan {path} -o next.csv\n",
            );
        }
    }
    args.json.deliver(&plan, &text)?;
    if args.output.is_some() && !decides && !args.force {
        return Err(InputError::new(
            "no protocol is written: none of these runs decides",
            "write the best one anyway with --force",
        )
        .into());
    }
    Ok(())
}

/// Whether a file is to hold the pressure over the time.
fn is_table(path: &Path) -> bool {
    path.extension()
        .is_some_and(|it| it.eq_ignore_ascii_case("csv"))
}

/// The pressure of a protocol over the time as CSV, for rigs that play a table. Set-points in degrees
/// become the pressure that reaches them in the model.
fn pressures(protocol: &ProtocolFile, file: &ModelFile) -> String {
    let Play { time, pressure, .. } =
        play(protocol, &file.model, u32::from(wire::telemetry::RATE_HZ));
    let mut text = "time_s,pressure_kpa\n".to_owned();
    for (time, pressure) in time.iter().zip(pressure) {
        let kpa = tidy(pressure / PASCAL_PER_KPA);
        text += &format!("{time:.3},{kpa}\n");
    }
    text
}

/// What `softrig plan --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Plan {
    /// Version of the layout.
    schema: u32,
    /// The effects of each side.
    between: Vec<Vec<String>>,
    /// Standard deviation of the measured angle (°).
    noise_deg: f64,
    /// Runs, best first.
    runs: Vec<PlannedRun>,
}

impl Plan {
    /// Runs that separate two explanations, best first, with their protocols: at least one. Without
    /// recordings, steps of an actuator with the first are simulated.
    ///
    /// # Errors
    ///
    /// Refuses names that are none, recordings in implausible units, and limits that no protocol
    /// keeps to.
    pub fn between(
        file: &ModelFile,
        recordings: Vec<Recording>,
        pair: &str,
        own: Option<&OwnEffects>,
        limits: Limits,
        noise_deg: Option<f64>,
    ) -> Result<(Self, Vec<Proposal>), InputError> {
        unit_errors::refuse(file, &recordings)?;
        let mut known: Vec<Kind> = own.into_iter().flat_map(|own| own.kinds.clone()).collect();
        if pair.contains(PREFIX) {
            known.extend(grammar(file, &recordings));
        }
        let pair = between(pair, &known)?;
        refuse_what_it_has(file, &pair)?;
        let limits = limits.of_rig(&recordings);
        let noise = match noise_deg {
            Some(noise) if noise > 0.0 && noise.is_finite() => noise.to_radians(),
            Some(noise) => {
                return Err(InputError::new(
                    format!("the noise is {noise}°"),
                    "give an RMS above zero",
                ));
            }
            None if recordings.is_empty() => 0.4f64.to_radians(),
            None => NoiseFloor::of(&recordings).rms,
        };
        let recordings = if recordings.is_empty() {
            made_up(file, &pair[0])?
        } else {
            recordings
        };
        let rivals = fitted(file, &recordings, &pair)?;
        let list = proposals(&file.model, &rivals, noise, &limits);
        if list.is_empty() {
            return Err(InputError::new(
                "no built-in protocol is within these limits",
                "allow a higher set-point, more pressure or a longer run",
            ));
        }
        Ok((Self::of(&pair, noise, &list), list))
    }

    /// Of two explanations, with `noise` (rad).
    fn of(pair: &[Vec<Kind>; 2], noise: f64, list: &[Proposal]) -> Self {
        let side = |side: &Vec<Kind>| names(side).iter().map(ToString::to_string).collect();
        let run = |proposal: &Proposal| PlannedRun {
            protocol: proposal.protocol.name.clone(),
            title: proposal.protocol.title.clone(),
            setup: proposal.protocol.setup.instructions(),
            seconds: f64::from(proposal.protocol.total_ms()) / 1000.0,
            work_min: tidy(work_min(&proposal.protocol)),
            expected_delta_chi2: tidy(proposal.evidence),
            decides: proposal.decides,
        };
        Self {
            schema: SCHEMA,
            between: pair.iter().map(side).collect(),
            noise_deg: tidy(noise.to_degrees()),
            runs: list.iter().map(run).collect(),
        }
    }
}

/// A run that could separate the two.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct PlannedRun {
    /// Name of the protocol.
    protocol: String,
    /// What it is.
    title: String,
    /// What is to be done at the rig before.
    setup: Vec<String>,
    /// How long it takes (s).
    seconds: f64,
    /// Minutes of work and waiting, with the run.
    work_min: f64,
    /// Expected evidence: twice a log-likelihood ratio.
    expected_delta_chi2: f64,
    /// Whether that is expected to be enough.
    decides: bool,
}

/// Refuses a model that has an effect of either side already: both sides would have it.
fn refuse_what_it_has(file: &ModelFile, pair: &[Vec<Kind>; 2]) -> Result<(), InputError> {
    let has = |kind: &&Kind| file.model.effects().any(|effect| effect.kind() == **kind);
    match pair.iter().flatten().find(has) {
        Some(kind) => Err(InputError::new(
            format!(
                "the model has {} already, on both sides of --between",
                kind.name()
            ),
            "give the model without it, as used in the diagnosis",
        )
        .in_file(&file.path)),
        None => Ok(()),
    }
}

/// The terms that a diagnosis finds where no effect of the catalogue explains the recordings, with
/// ranges of their size; without recordings, of the size of nominal steps.
fn grammar(file: &ModelFile, recordings: &[Recording]) -> Vec<Kind> {
    let data = if recordings.is_empty() {
        Dataset::of(&nominal_steps(file))
    } else {
        Dataset::of(recordings)
    };
    let fitter = Fitter::new(&file.model, &data);
    terms(&Scales::of(&fitter, &fitter.compare(&file.model)), &[])
}

/// The two explanations in `--between`: effects of the catalogue, or `known` ones.
fn between(text: &str, known: &[Kind]) -> Result<[Vec<Kind>; 2], InputError> {
    let advice = || {
        let kinds = Kind::NAMES.iter().chain(known);
        let known: Vec<&str> = kinds.map(|kind| kind.name()).collect();
        format!(
            "name two effects with a comma between them, of: {}",
            known.join(", ")
        )
    };
    let sides: Vec<Vec<Kind>> = text
        .split(',')
        .map(|side| {
            side.split('+')
                .map(|name| {
                    OwnEffects::find(known, name.trim()).ok_or_else(|| {
                        InputError::new(format!("there is no effect \"{}\"", name.trim()), advice())
                    })
                })
                .collect()
        })
        .collect::<Result<_, _>>()?;
    match <[Vec<Kind>; 2]>::try_from(sides) {
        Ok(pair) if pair[0] != pair[1] => Ok(pair),
        _ => Err(InputError::new(
            format!("--between {text} does not name two different explanations"),
            advice(),
        )),
    }
}

/// The limits in `--limits`.
///
/// # Errors
///
/// Refuses a part that is none.
pub fn limits(text: Option<&str>) -> Result<Limits, InputError> {
    let mut limits = Limits::default();
    for part in text.into_iter().flat_map(|text| text.split(',')) {
        let fault = || {
            InputError::new(
                format!("--limits has the part \"{part}\""),
                "write it as deg=90,kpa=170,s=180; parts may be left out",
            )
        };
        let (name, value) = part.split_once('=').ok_or_else(fault)?;
        let value: f64 = value.trim().parse().map_err(|_| fault())?;
        if !(value > 0.0 && value.is_finite()) {
            return Err(fault());
        }
        match name.trim() {
            "deg" => limits.highest_deg = value,
            "kpa" => limits.highest_kpa = value,
            "s" => limits.longest_s = value,
            _ => return Err(fault()),
        }
    }
    Ok(limits)
}

/// Steps of the nominal model.
fn nominal_steps(file: &ModelFile) -> Vec<Recording> {
    [60.0, 90.0]
        .into_iter()
        .map(|degrees: f64| {
            let step = Protocol::Step {
                angle: degrees.to_radians(),
                hold: 5.0,
                release: 3.0,
            };
            let (time, setpoint, pressure) = step.pressure(&file.model);
            Recording {
                name: format!("step{degrees}"),
                time,
                pressure,
                angle: setpoint,
                ..Recording::default()
            }
        })
        .collect()
}

/// Simulated steps of an actuator with these effects at a typical size.
fn made_up(file: &ModelFile, kinds: &[Kind]) -> Result<Vec<Recording>, InputError> {
    let runs = nominal_steps(file);
    let driven = Dataset::of(&runs);
    let fitter = Fitter::new(&file.model, &driven);
    let scales = Scales::of(&fitter, &fitter.compare(&file.model));
    let effects: Vec<_> = file
        .model
        .effects()
        .chain(kinds.iter().filter_map(|&kind| typical(kind, &scales)))
        .collect();
    let truth: Model<f64> = Model::new(*file.model.dynamics(), &effects).map_err(|error| {
        InputError::new(
            format!("the model with {} {error}", names(kinds).join(" + ")),
            "give recordings, or another model",
        )
        .in_file(&file.path)
    })?;
    let angles: Vec<Vec<f64>> = driven
        .sessions()
        .iter()
        .map(|session| session.simulate(&truth, &Nuisance::AT_ZERO))
        .collect();
    Ok(runs
        .into_iter()
        .zip(angles)
        .map(|(run, angle)| Recording { angle, ..run })
        .collect())
}

/// Both explanations, fitted.
fn fitted(
    file: &ModelFile,
    recordings: &[Recording],
    pair: &[Vec<Kind>; 2],
) -> Result<Vec<Candidate>, InputError> {
    let data = assemble(recordings, &[])?.data.knowing(&file.within);
    let given = Fitter::new(&file.model, &data);
    let NominalRefit { refit, file, .. } =
        identifiability::refit(file, &given).ok_or_else(|| {
            InputError::new(
                "the model cannot be simulated over these recordings: it diverges",
                "check units and signs of its parameters",
            )
            .in_file(&file.path)
        })?;
    let (job, checkpoint) = (Job::default(), Checkpoint::default());
    let executor = Executor::new(&job, &checkpoint);
    pair.iter()
        .map(|kinds| {
            structures::fit(&file, &data, &refit, kinds, executor).map_err(|_| {
                InputError::new(
                    format!("{} cannot be simulated", names(kinds).join(" + ")),
                    "check the model, or choose other effects",
                )
            })
        })
        .collect()
}
