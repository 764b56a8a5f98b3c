//! `softrig residuals`: what a model leaves of recordings, as control engineers look at it.

use std::path::{Path, PathBuf};

use clap::Parser;
use schemars::JsonSchema;
use serde::Serialize;

use super::input::InputArgs;
use super::json::{JsonArgs, SCHEMA};
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig::comparison::check_comparable;
use softrig::estimate::Dataset;
use softrig::estimate::assemble::assemble;
use softrig::estimate::filter::Pace;
use softrig::estimate::fitter::Fitter;
use softrig::prediction::Prediction;
use softrig::residual_analysis::{Ahead, Distribution, errors_ahead};
use softrig::statistics::rms;
use softrig_formats::columns::Layout;
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::{percent, short};
use softrig_formats::recording::{Recording, read_all};
use softrig_report::correlation::{Correlation, Correlations, Level, RunResiduals};
use softrig_report::html::STYLE;
use softrig_report::plot::{Figure, Mark, Panel, Role, Series, Style, to_svg_string};

/// Analyses a model's residuals: whiteness, correlation with the pressure, growth with the
/// prediction horizon, and distribution.
///
/// The model is simulated as given over whole runs; only sensor zeros and initial states are
/// estimated.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig residuals --model m.toml step60_*.csv
  softrig residuals --prediction theta_sim step60_*.csv      what your own simulation leaves
  softrig residuals --model m.toml step60_*.csv --report residuals.html --json residuals.json")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Analyse your own simulation, whose angles are in this column: COLUMN, or COLUMN:rad
    #[arg(long, value_name = "COLUMN[:UNIT]", conflicts_with = "model")]
    prediction: Option<Prediction>,
    /// Recordings
    #[arg(required = true, value_name = "REC.csv")]
    recordings: Vec<PathBuf>,
    /// Write the pictures with their explanation as one HTML page that needs no network
    #[arg(long, value_name = "PAGE.html")]
    report: Option<PathBuf>,
    /// Draw them
    #[arg(long, value_name = "RESIDUALS.svg|pdf|png")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

/// What `softrig residuals --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Analysis {
    /// Version of the layout.
    schema: u32,
    /// Name of the model.
    model: String,
    /// What the output is; its unit is that of all that ends in `_deg`.
    #[serde(skip)]
    measurand: Measurand,
    /// Samples of the residual.
    samples: usize,
    /// RMS of the residual over whole runs (°).
    rmse_deg: f64,
    /// Its correlation with itself a lag earlier.
    with_itself: Lagged,
    /// Its correlation with the pressure a lag earlier; absent if that never changes.
    #[serde(skip_serializing_if = "Option::is_none")]
    with_pressure: Option<Lagged>,
    /// RMS error of predictions over a time ahead, shortest first.
    ahead: Vec<Ahead>,
    /// How the residual is distributed; absent of fewer than ten samples.
    #[serde(skip_serializing_if = "Option::is_none")]
    distribution: Option<Distribution>,
}

/// A correlation over the lag.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct Lagged {
    /// Lags (s).
    lag_s: Vec<f64>,
    /// Correlation at each, −1 to 1.
    correlation: Vec<f64>,
    /// What chance alone stays within at 99 % of the lags.
    band99: f64,
    /// Share of the lags above zero beyond that.
    outside: f64,
    /// Whether chance alone makes that.
    by_chance: bool,
}

impl Lagged {
    fn of(of: &Correlation, by_chance: bool) -> Self {
        Self {
            lag_s: of.lag.clone(),
            correlation: of.value.clone(),
            band99: of.bound(Level::P99),
            outside: of.share_outside(Level::P99),
            by_chance,
        }
    }

    /// A sentence about it.
    fn sentence(&self, with: &str, without: &str, has: &str) -> String {
        let verdict = if self.by_chance { without } else { has };
        format!(
            "Correlation with {with}: {} of the lags lie beyond the 99 % band (±{}; 1 % by chance): {verdict}.",
            percent(self.outside),
            short(self.band99)
        )
    }

    fn panel(&self, title: &str) -> Panel {
        let ends = [self.lag_s.first(), self.lag_s.last()].map(|it| it.copied().unwrap_or(0.0));
        let band = [self.band99; 2];
        Panel::new("lag (s)", "correlation")
            .with_title(title)
            .with_level(0.0)
            .with_series(Series::band(
                "99 %",
                &ends,
                &band.map(|it| -it),
                &band,
                Role::Measured,
            ))
            .with_series(Series::new(
                "",
                &self.lag_s,
                &self.correlation,
                Style::AFTER,
            ))
    }
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = match &args.prediction {
        Some(_) => None,
        None => Some(args.model.find()?),
    };
    let read = args.recordings.iter().chain(&model);
    args.picture.check("--plot", args.plot.as_ref())?;
    output::check(
        &[
            Output::of("--report", FileKind::Page, args.report.as_ref()),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            args.json.output(),
        ],
        read,
    )?;
    let (analysis, warnings) = match (&model, &args.prediction) {
        (None, Some(prediction)) => {
            let layout = args.input.layout_over(&Layout::default())?;
            let recordings = read_all(&args.recordings, &layout, super::warn)?;
            Analysis::of_prediction(prediction, &recordings)?
        }
        (model, _) => {
            let model = model.as_deref().unwrap_or(Path::new(""));
            let (file, recordings) = super::read(model, &args.recordings, &args.input)?;
            Analysis::of(&file, &recordings)?
        }
    };
    for warning in &warnings {
        super::warn(warning);
    }
    let mut text = analysis.text();
    if let Some(path) = &args.plot {
        let figure = Figure {
            title: format!("What {} leaves", analysis.model),
            ..analysis
                .figure()
                .with_subtitle(analysis.sentences().join(" "))
        };
        args.picture.write(path, &figure)?;
        text += &format!("\npicture: {}\n", path.display());
    }
    if let Some(path) = &args.report {
        write_atomically(path, analysis.page()?.as_bytes())?;
        text += &format!("\npage: {}\n", path.display());
    }
    args.json.deliver(&analysis, &text)
}

impl Analysis {
    /// Of what a model leaves of recordings, with what was to be said of them.
    ///
    /// # Errors
    ///
    /// Refuses recordings that cannot be used or that are in implausible units, and a model that
    /// leaves nothing.
    pub fn of(
        file: &ModelFile,
        recordings: &[Recording],
    ) -> Result<(Self, Vec<String>), InputError> {
        let mut warnings = check_comparable([file], recordings)?;
        let assembled = assemble(recordings, &[])?;
        warnings.extend(assembled.concerns.iter().map(ToString::to_string));
        let data = &assembled.data;
        let fit = Fitter::new(&file.model, data).compare(&file.model);
        let ahead = errors_ahead(&fit, data);
        let analysis = Self::of_residuals(&file.name, &fit.residuals, data, ahead)
            .map_err(|error| error.in_file(&file.path))?;
        let rmse_deg = fit.rmse().to_degrees();
        Ok((
            Self {
                rmse_deg,
                ..analysis
            },
            warnings,
        ))
    }

    /// The same of somebody else's predictions, which say nothing about a time ahead.
    ///
    /// # Errors
    ///
    /// Refuses recordings that cannot be used, or that have no such predictions.
    pub fn of_prediction(
        prediction: &Prediction,
        recordings: &[Recording],
    ) -> Result<(Self, Vec<String>), InputError> {
        let assembled = assemble(recordings, &[])?;
        let warnings = assembled.concerns.iter().map(ToString::to_string).collect();
        let data = &assembled.data;
        let residuals: Vec<Vec<f64>> = data
            .fitted()
            .map(|segment| prediction.residual(&segment.recording))
            .collect::<Result<_, _>>()?;
        let analysis = Self::of_residuals(&prediction.column, &residuals, data, Vec::new())?;
        Ok((analysis, warnings))
    }

    /// Of residuals (rad), one series a fitted segment; NaN where there is none.
    fn of_residuals(
        name: &str,
        residuals: &[Vec<f64>],
        data: &Dataset,
        ahead: Vec<Ahead>,
    ) -> Result<Self, InputError> {
        let silences: Vec<Vec<bool>> = data
            .fitted()
            .zip(residuals)
            .map(|(segment, residual)| {
                let silence = &data.sessions()[segment.session].silence()[segment.range.clone()];
                let both = silence.iter().zip(residual);
                both.map(|(silent, it)| *silent || !it.is_finite())
                    .collect()
            })
            .collect();
        let residuals: Vec<Vec<f64>> = residuals
            .iter()
            .map(|run| {
                run.iter()
                    .map(|it| if it.is_finite() { *it } else { 0.0 })
                    .collect()
            })
            .collect();
        let runs: Vec<RunResiduals<'_>> = data
            .fitted()
            .zip(&silences)
            .zip(&residuals)
            .map(|((segment, silent), residual)| RunResiduals {
                time: &segment.recording.time,
                residual,
                input: &segment.recording.pressure,
                silent,
            })
            .collect();
        let correlations = Correlations::of(&runs, Pace::of(data).period).ok_or_else(|| {
            InputError::new(
                "the model reproduces these recordings to the last digit",
                "name recordings that were measured and not simulated with it",
            )
        })?;
        let usable: Vec<f64> = runs
            .iter()
            .flat_map(|run| run.residual.iter().zip(run.silent))
            .filter(|(_, silent)| !**silent)
            .map(|(residual, _)| *residual)
            .collect();
        Ok(Self {
            schema: SCHEMA,
            model: name.to_owned(),
            measurand: data.measurand(),
            samples: usable.len(),
            rmse_deg: rms(&usable).to_degrees(),
            with_itself: Lagged::of(&correlations.own, correlations.own.is_white(Level::P99)),
            with_pressure: correlations
                .with_input
                .as_ref()
                .map(|it| Lagged::of(it, !it.is_beyond_chance())),
            ahead,
            distribution: Distribution::of(&usable),
        })
    }

    /// The findings, a sentence each.
    fn sentences(&self) -> Vec<String> {
        let unit = self.measurand.unit();
        let mut sentences = vec![
            format!(
                "{}: RMS residual {}{unit} over whole runs, {} samples.",
                self.model,
                short(self.rmse_deg),
                self.samples
            ),
            self.with_itself.sentence(
                "itself",
                "the residual is white",
                "the residual is not white, and a better model could predict a part of it",
            ),
        ];
        sentences.push(self.with_pressure.as_ref().map_or_else(
            || "The pressure never changes in these runs.".to_owned(),
            |it| {
                it.sentence(
                    "the pressure before",
                    "within chance for signals this slow",
                    "dynamics between pressure and angle are missing",
                )
            },
        ));
        if let Some(it) = &self.distribution {
            sentences.push(format!(
                "Mean {}{unit}, standard deviation {}{unit}, skewness {}, excess kurtosis {} (0 and 0 for normal errors).",
                short(it.mean_deg),
                short(it.deviation_deg),
                short(it.skewness),
                short(it.excess_kurtosis)
            ));
        }
        sentences
    }

    fn text(&self) -> String {
        let mut text = self.sentences().join("\n") + "\n";
        if self.ahead.is_empty() {
            return text;
        }
        text += &format!(
            "\n{:>10} {:>10} {:>14}\n",
            "k (samples)",
            "s",
            self.measurand.with_unit("RMS error")
        );
        for ahead in &self.ahead {
            text += &format!(
                "{:>11} {:>10} {:>14}\n",
                ahead.samples,
                short(ahead.seconds),
                short(ahead.rmse_deg)
            );
        }
        text
    }

    fn figure(&self) -> Figure {
        let of = |values: fn(&Ahead) -> f64| self.ahead.iter().map(values).collect::<Vec<_>>();
        let mut figure = Figure::new("")
            .with_columns(2)
            .with_separate_x()
            .with_panel(self.with_itself.panel("Autocorrelation"));
        if let Some(with_pressure) = &self.with_pressure {
            figure = figure.with_panel(with_pressure.panel("Residual with the pressure"));
        }
        if !self.ahead.is_empty() {
            figure = figure.with_panel(
                Panel::new("time ahead (s)", self.measurand.with_unit("RMS error"))
                    .with_decades()
                    .with_title("Prediction error over the time ahead")
                    .with_series(Series::new(
                        "",
                        &of(|it| it.seconds.log10()),
                        &of(|it| it.rmse_deg),
                        Style::AFTER,
                    )),
            );
        }
        let Some(it) = &self.distribution else {
            return figure;
        };
        let normal = |x: f64| {
            let z = (x - it.mean_deg) / it.deviation_deg;
            (-0.5 * z * z).exp() / (it.deviation_deg * std::f64::consts::TAU.sqrt())
        };
        let expected: Vec<f64> = it.centre_deg.iter().map(|x| normal(*x)).collect();
        let line: Vec<f64> = it
            .normal
            .iter()
            .map(|z| it.mean_deg + z * it.deviation_deg)
            .collect();
        let [x, y] = steps(&it.centre_deg, &it.density);
        figure
            .with_panel(
                Panel::new(
                    self.measurand.with_unit("residual"),
                    format!("density (1/{})", self.measurand.symbol()),
                )
                .with_title("Histogram")
                .with_series(Series::new("residual", &x, &y, Style::AFTER))
                .with_series(Series::new(
                    "normal",
                    &it.centre_deg,
                    &expected,
                    Style::REFERENCE,
                )),
            )
            .with_panel(
                Panel::new(
                    "normal quantile",
                    self.measurand.with_unit("quantile of the residual"),
                )
                .with_title("Quantiles (QQ)")
                .with_series(Series::new("normal", &it.normal, &line, Style::REFERENCE))
                .with_series(Series::new(
                    "residual",
                    &it.normal,
                    &it.quantile_deg,
                    Style::new(Role::After, Mark::Points),
                )),
            )
    }

    /// One page of HTML.
    fn page(&self) -> Result<String, minijinja::Error> {
        const TEMPLATE: &str = include_str!("residuals.html");
        let mut environment = minijinja::Environment::new();
        // The name decides that values are escaped.
        environment.add_template("residuals.html", TEMPLATE)?;
        environment
            .get_template("residuals.html")?
            .render(minijinja::context! {
                style => STYLE,
                title => format!("What {} leaves", self.model),
                sentences => self.sentences(),
                picture => minijinja::Value::from_safe_string(to_svg_string(&self.figure())),
            })
    }
}

/// The outline of bars of equal width.
fn steps(centres: &[f64], heights: &[f64]) -> [Vec<f64>; 2] {
    let half = centres
        .windows(2)
        .next()
        .map_or(0.5, |it| 0.5 * (it[1] - it[0]));
    let (mut x, mut y) = (Vec::new(), Vec::new());
    for (centre, height) in centres.iter().zip(heights) {
        x.extend([centre - half, centre + half]);
        y.extend([*height; 2]);
    }
    [x, y]
}
