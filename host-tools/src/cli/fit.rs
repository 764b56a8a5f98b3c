//! `softrig fit`: the parameters of a model from recordings.

use std::path::PathBuf;

use clap::Parser;
use schemars::JsonSchema;
use serde::Serialize;

use super::input::InputArgs;
use super::json::{JsonArgs, Parameter, SCHEMA};
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig::diagnose::decide::verdict::Zeros;
use softrig::estimate::Dataset;
use softrig::estimate::fit::{Fit, rms_each};
use softrig::estimate::fitter::Fitter;
use softrig::estimate::profile::Profile;
use softrig::estimate::refit::{NOT_CONVERGED, Refit, refit};
use softrig_formats::error::write_atomically;
use softrig_formats::model_file::{ModelFile, parameter_name, parameter_unit, to_file_units};
use softrig_formats::numbers::{short, tidy, with_ends};
use softrig_formats::recording::{Recording, measurand};
use softrig_report::plot::{Figure, Panel, Series, Style};

/// Fits the free parameters of a model to recordings.
///
/// The model is simulated over the measured pressure and compared with the
/// measured angle; `[fit] free` in the model file says what may move.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig fit --model m.toml step60_*.csv step90_*.csv -o fitted.toml
  softrig fit --model m.toml step60_*.csv --profile profiles.svg
  softrig fit --model m.toml step60_*.csv --json -")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Recordings
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Write the fitted model
    #[arg(short, long, value_name = "FITTED.toml")]
    output: Option<PathBuf>,
    /// Profile the likelihood of each free parameter, and draw it: how far the parameter can go
    /// while all others follow
    #[arg(long, value_name = "PROFILES.svg|pdf|png")]
    profile: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = args.model.find()?;
    let read = args.recordings.iter().chain([&model]);
    args.picture.check("--profile", args.profile.as_ref())?;
    output::check(
        &[
            Output::of("-o", FileKind::Model, args.output.as_ref()),
            Output::of("--profile", FileKind::Picture, args.profile.as_ref()),
            args.json.output(),
        ],
        read,
    )?;
    let (file, recordings) = super::read(&model, &args.recordings, &args.input)?;
    let found = refit(&file, &recordings)?;
    let mut text = table(&file, &found);
    let Refit {
        data,
        concerns,
        nominal,
        fitted: fit,
    } = found;
    for concern in &concerns {
        super::warn(&concern.to_string());
    }
    if !fit.converged {
        super::warn(NOT_CONVERGED);
    }
    if let Some(path) = &args.output {
        let model = file.text_with(&fit.model, "");
        write_atomically(path, model.as_bytes())?;
        text += &format!("\nwritten: {}\n", path.display());
    }
    let profiles = match &args.profile {
        Some(path) => {
            let profiles = profiled(&file, &data, &fit);
            text += &format!("\n{}", profile_table(&profiles));
            args.picture
                .write(path, &profile_figure(&file.name, &profiles))?;
            text += &format!("\npicture: {}\n", path.display());
            profiles
        }
        None => Vec::new(),
    };
    let warnings = concerns.iter().map(ToString::to_string);
    let not_converged = (!fit.converged).then(|| NOT_CONVERGED.to_owned());
    let result = FitResult {
        schema: SCHEMA,
        model: file.name.clone(),
        parameters: parameters(&file, &fit),
        rmse_deg: Errors::of("all".to_owned(), nominal.rmse(), fit.rmse()),
        recordings: errors(&data.recordings(true), &nominal, &fit),
        nuisance: Zeros::of(&fit, &data),
        profiles,
        converged: fit.converged,
        warnings: warnings.chain(not_converged).collect(),
    };
    args.json.deliver(&result, &text)
}

/// What `softrig fit --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct FitResult {
    /// Version of the layout.
    schema: u32,
    /// Name of the model.
    model: String,
    /// The free parameters, in the units of model files.
    parameters: Vec<Parameter>,
    /// RMS error over all recordings.
    rmse_deg: Errors,
    /// RMS error of each recording.
    recordings: Vec<Errors>,
    /// Zeros of the sensors.
    nuisance: Zeros,
    /// Profile likelihoods of the free parameters; absent where they were not asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    profiles: Vec<Profiled>,
    /// Whether the fit met its tolerance.
    converged: bool,
    /// What was said about recordings and fit.
    warnings: Vec<String>,
}

/// The profile likelihood of a parameter, in the units of model files.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub(crate) struct Profiled {
    /// Its name, as in `[fit] free`.
    name: String,
    /// The unit of its values; empty for a number without one.
    unit: String,
    /// The values at which it was held; empty where nothing determines it, or it ended at a
    /// bound.
    value: Vec<f64>,
    /// Δχ² at each, with all others fitted again.
    delta_chi2: Vec<f64>,
    /// The same of the parabola that the standard error stands for.
    parabola: Vec<f64>,
    /// Δχ² up to which a value agrees with the recordings, at 95 %.
    limit: f64,
    /// The ends of the values that agree; null on a side where all that were tried agree.
    interval95: [Option<f64>; 2],
}

/// The profiles of all free parameters.
fn profiled(file: &ModelFile, data: &Dataset, fit: &Fit) -> Vec<Profiled> {
    let fitter = Fitter::new(&file.model, data);
    let bar = super::spinner();
    let profiles = (0..fit.free.len()).map(|index| {
        let id = fit.free[index];
        let name = parameter_name(&fit.model, id);
        bar.set_message(format!(
            "profile of {name}, {} of {}",
            index + 1,
            fit.free.len()
        ));
        let shown = |value: f64| tidy(to_file_units(&fit.model, id, value));
        let profile = Profile::of(&fitter, fit, index);
        let points = profile.as_ref().map_or(&[][..], |it| &it.points);
        let best = fit.model.value(id).unwrap_or(f64::NAN);
        let error = profile.as_ref().map_or(f64::NAN, |it| it.standard_error);
        Profiled {
            name,
            unit: parameter_unit(&fit.model, id).to_owned(),
            value: points.iter().map(|(value, _)| shown(*value)).collect(),
            delta_chi2: points.iter().map(|(_, rise)| tidy(*rise)).collect(),
            parabola: points
                .iter()
                .map(|(value, _)| tidy(((value - best) / error).powi(2)))
                .collect(),
            limit: profile.as_ref().map_or(0.0, |it| tidy(it.limit)),
            interval95: profile
                .as_ref()
                .map_or([None; 2], |it| it.interval95.map(|end| end.map(shown))),
        }
    });
    let profiles = profiles.collect();
    bar.finish_and_clear();
    profiles
}

impl Profiled {
    /// Its name with its unit.
    fn label(&self) -> String {
        labelled(&self.name, &self.unit)
    }

    /// The interval in words.
    fn interval(&self) -> String {
        if self.value.is_empty() {
            return "not determined by these runs, or at a bound".to_owned();
        }
        let (first, last) = (self.value[0], self.value[self.value.len() - 1]);
        match self.interval95 {
            [Some(low), Some(high)] => format!("{} … {}", short(low), short(high)),
            [None, Some(high)] => format!(
                "… {}, open below (down to {} tried)",
                short(high),
                short(first)
            ),
            [Some(low), None] => {
                format!("{} …, open above (up to {} tried)", short(low), short(last))
            }
            [None, None] => format!("open: {} to {} agree", short(first), short(last)),
        }
    }
}

/// The profiles' intervals.
fn profile_table(profiles: &[Profiled]) -> String {
    let mut text = format!("{:<40}   {}\n", "profile likelihood", "95 % interval");
    for profile in profiles {
        text += &format!("{:<40}   {}\n", profile.label(), profile.interval());
    }
    text
}

/// A panel for each profile.
fn profile_figure(model: &str, profiles: &[Profiled]) -> Figure {
    let drawn = profiles.iter().filter(|it| !it.value.is_empty());
    drawn.fold(
        Figure::new(format!("Profile likelihoods of {model}"))
            .with_subtitle(
                "How much worse the fit becomes where one parameter is held and all others follow; below the level a value agrees with the recordings at 95 %",
            )
            .with_columns(2)
            .with_separate_x(),
        |figure, it| {
            figure.with_panel(
                Panel::new(it.label(), "Δχ²")
                    .with_level(it.limit)
                    .with_series(Series::new(
                        "parabola of the standard error",
                        &it.value,
                        &it.parabola,
                        Style::REFERENCE,
                    ))
                    .with_series(Series::new("profile", &it.value, &it.delta_chi2, Style::AFTER)),
            )
        },
    )
}

/// A parameter's name with its unit.
fn labelled(name: &str, unit: &str) -> String {
    if unit.is_empty() {
        name.to_owned()
    } else {
        format!("{name} ({unit})")
    }
}

/// RMS errors before and after a fit.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct Errors {
    /// The recording, or `all`.
    name: String,
    /// As supplied (°).
    nominal: f64,
    /// As fitted (°).
    fitted: f64,
}

impl Errors {
    fn of(name: String, nominal: f64, fitted: f64) -> Self {
        Self {
            name,
            nominal: tidy(nominal.to_degrees()),
            fitted: tidy(fitted.to_degrees()),
        }
    }
}

fn errors(recordings: &[Recording], before: &Fit, after: &Fit) -> Vec<Errors> {
    let names = recordings.iter().map(|it| it.name.clone());
    let each = rms_each(before).into_iter().zip(rms_each(after));
    names
        .zip(each)
        .map(|(name, (before, after))| Errors::of(name, before, after))
        .collect()
}

/// The free parameters before and after.
fn parameters(file: &ModelFile, fit: &Fit) -> Vec<Parameter> {
    let free = fit.free.iter().enumerate();
    free.map(|(index, &id)| {
        let shown = |value: f64| tidy(to_file_units(&fit.model, id, value));
        let ends = fit.interval95(index);
        let ends = ends.filter(|(low, high)| low.is_finite() && high.is_finite());
        Parameter {
            name: parameter_name(&fit.model, id),
            unit: parameter_unit(&fit.model, id).to_owned(),
            nominal: file.model.value(id).map(shown),
            value: fit.model.value(id).map_or(f64::NAN, shown),
            interval95: ends.map(|(low, high)| [shown(low), shown(high)]),
            from: None,
        }
    })
    .collect()
}

/// What `softrig fit` prints: parameters, errors and zeros.
pub fn table(file: &ModelFile, refit: &Refit) -> String {
    let Refit {
        data,
        nominal,
        fitted,
        ..
    } = refit;
    format!(
        "{}\n{}\n{}\n",
        parameter_table(file, fitted),
        error_table(&data.recordings(true), nominal, fitted),
        Zeros::of(fitted, data).sentence(&data.measurand())
    )
}

/// Free parameters before and after, with their 95 % intervals.
pub(crate) fn parameter_table(file: &ModelFile, fit: &Fit) -> String {
    let mut text = format!(
        "{:<40} {:>11} {:>11}   {:<24}\n",
        "parameter", "nominal", "fitted", "95 % interval"
    );
    for (index, &id) in fit.free.iter().enumerate() {
        let shown = |value: f64| to_file_units(&fit.model, id, value);
        let nominal = file
            .model
            .value(id)
            .map_or_else(|| "–".to_owned(), |value| short(shown(value)));
        let fitted = fit.model.value(id).map_or(f64::NAN, shown);
        let (fitted, interval) = match fit.interval95(index) {
            Some((low, high)) if low.is_finite() && high.is_finite() => {
                let (fitted, [low, high]) = with_ends(fitted, [shown(low), shown(high)]);
                (fitted, format!("{low} … {high}"))
            }
            _ => (short(fitted), "not determined by these runs".to_owned()),
        };
        let label = labelled(
            &parameter_name(&fit.model, id),
            parameter_unit(&fit.model, id),
        );
        text += &format!("{label:<40} {nominal:>11} {fitted:>11}   {interval:<24}\n");
    }
    text
}

/// RMS error of each recording before and after.
fn error_table(recordings: &[Recording], before: &Fit, after: &Fit) -> String {
    let row = |name: &str, before: f64, after: f64| {
        let [before, after] = [before, after].map(|rms| short(rms.to_degrees()));
        format!("{name:<40} {before:>11} {after:>11}\n")
    };
    let mut text = format!(
        "{:<40} {:>11} {:>11}\n",
        measurand(recordings).with_unit("RMS error"),
        "nominal",
        "fitted"
    );
    for ((recording, before), after) in recordings.iter().zip(rms_each(before)).zip(rms_each(after))
    {
        text += &row(&recording.name, before, after);
    }
    text + &row("all", before.rmse(), after.rmse())
}
