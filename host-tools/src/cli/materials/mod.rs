//! `softrig materials`: the paper's table, exponents from tensile curves, exponents
//! from data sheets.

pub(super) mod json;
mod pictures;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand};
use model_core::material::{DataSheet, Material, TABLE_I};
use serde::Serialize;

use super::choice::choice;
use super::json::{is_stdout, text_of};
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig_formats::error::{InputError, write_atomically};
use softrig_materials::curve::{Measure, TensileCurve};
use softrig_materials::fit::{self, Choice, CurveFit, Estimate, Modulus, Residual};
use softrig_materials::predictor::{LeaveOneOut, PredictorFit, eight_rows, leave_one_out};
use softrig_materials::table_row;

/// Materials: the paper's table, exponents from tensile curves and data sheets.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig materials list
  softrig materials fit-curve tensile.csv --plot curve.svg
  softrig materials fit-curve *.csv --plot curves.svg            several in one picture
  softrig materials predict --modulus-mpa 0.338 --viscosity-cps 20000 --tensile-mpa 3.79")]
pub struct Args {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Shows the paper's Table I and the predictor fitted to it
    List(ListArgs),
    /// Fits Ludwick's law σ = E εⁿ to a tensile curve
    FitCurve(FitCurveArgs),
    /// Predicts the exponent from three figures of a data sheet
    Predict(PredictArgs),
}

#[derive(Debug, Default, clap::Args)]
#[command(after_help = "\
Examples:
  softrig materials list --json table.json
  softrig materials list --plot predictor.svg")]
struct ListArgs {
    /// Draw the exponents against the data-sheet figures, with the predictor
    #[arg(long, value_name = "FILE.svg|pdf|png")]
    plot: Option<PathBuf>,
    /// Print JSON, to a file if one is named
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArgs,
}

/// Fits Ludwick's law σ = E εⁿ, and Hooke's for comparison, to tensile curves.
///
/// The exponent depends on several choices, which are printed with the result. By
/// default engineering stress is fitted against engineering strain, over the whole
/// curve, with the modulus free and the misfit measured in stress. That pair is
/// consistent, and the beam formulas integrate it (over the undeformed section,
/// ε = κy). The other consistent pair is true stress against true strain. `--paper`
/// mixes the two, because only that mixture gives the exponents of the paper's
/// Table I.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  softrig materials fit-curve tensile.csv --range 0,1 --plot curve.svg
  softrig materials fit-curve \"Dragon Skin 20.csv\" \"Ecoflex 00-30.csv\" --plot curves.svg
  softrig materials fit-curve \"Dragon Skin 20.csv\" --paper")]
struct FitCurveArgs {
    /// Tensile curves: files of the Soft Robotics Materials Database, or CSVs
    /// with the columns `strain` and `stress_mpa`
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Stress measure [default: that of the strain, else engineering]
    #[arg(long, value_parser = choice::<Measure>())]
    stress: Option<Measure>,
    /// Strain measure [default: that of the stress, else engineering]
    #[arg(long, value_parser = choice::<Measure>())]
    strain: Option<Measure>,
    /// Smallest and largest fitted strain, in the chosen measure [default: the
    /// whole curve]
    #[arg(long, value_name = "LO,HI", value_parser = parse_range, allow_hyphen_values = true)]
    range: Option<(f64, f64)>,
    /// Hold the modulus at this value, or `free` to fit it [default: free]
    #[arg(long, value_name = "MPA|free", value_parser = parse_modulus, allow_hyphen_values = true)]
    modulus_mpa: Option<ModulusArg>,
    /// Direction in which the misfit is measured [default: stress]
    #[arg(long, value_parser = choice::<Residual>())]
    residual: Option<Residual>,
    /// The recipe behind Table I: true stress against engineering strain up to
    /// 6, misfit in strain, modulus from the table (or --modulus-mpa)
    #[arg(long, conflicts_with_all = ["stress", "strain", "range", "residual"])]
    paper: bool,
    /// Draw curve, laws and residuals; of several curves, all in one picture
    #[arg(long, value_name = "FILE.svg|pdf|png")]
    plot: Option<PathBuf>,
    /// Write the result as JSON; `-` prints it instead of the text
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    #[command(flatten)]
    picture: PictureArgs,
}

#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  softrig materials predict --modulus-mpa 0.338 --viscosity-cps 20000 --tensile-mpa 3.79")]
struct PredictArgs {
    /// Modulus at 100 % strain, in MPa
    #[arg(long, value_name = "MPA", allow_hyphen_values = true)]
    modulus_mpa: f64,
    /// Viscosity of the mixed silicone, in centipoise
    #[arg(long, value_name = "CPS", allow_hyphen_values = true)]
    viscosity_cps: f64,
    /// Tensile strength, in MPa
    #[arg(long, value_name = "MPA", allow_hyphen_values = true)]
    tensile_mpa: f64,
    /// Fit the predictor to all ten rows of Table I instead of the paper's eight
    #[arg(long)]
    all_rows: bool,
    /// Print JSON, to a file if one is named
    #[arg(long, value_name = "FILE", num_args = 0..=1, default_missing_value = "-")]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct ModulusArg(Modulus);

fn parse_modulus(text: &str) -> Result<ModulusArg, String> {
    if text.eq_ignore_ascii_case("free") {
        return Ok(ModulusArg(Modulus::Free));
    }
    match text.parse::<f64>() {
        Ok(mpa) if mpa.is_finite() && mpa > 0.0 => Ok(ModulusArg(Modulus::Fixed(mpa))),
        _ => Err("give a number of MPa above zero, or `free`".to_owned()),
    }
}

fn parse_range(text: &str) -> Result<(f64, f64), String> {
    let advice = || "give two strains, the smaller first, such as `0,0.5`".to_owned();
    let (low, high) = text.split_once(',').ok_or_else(advice)?;
    match (low.trim().parse::<f64>(), high.trim().parse::<f64>()) {
        (Ok(low), Ok(high)) if low.is_finite() && high.is_finite() && low < high => Ok((low, high)),
        _ => Err(advice()),
    }
}

/// Runs `softrig materials`.
///
/// # Errors
///
/// [`InputError`] where an argument or a file is at fault, else what the
/// operating system says.
pub fn run(args: Args) -> anyhow::Result<()> {
    let mut said = Vec::new();
    let outcome = execute(args, &mut said);
    super::print(&String::from_utf8_lossy(&said))?;
    outcome
}

fn execute(args: Args, out: &mut dyn Write) -> anyhow::Result<()> {
    if let Some(command) = &args.command {
        check_outputs(command)?;
    }
    match args.command {
        None => list(&ListArgs::default(), out),
        Some(Command::List(args)) => list(&args, out),
        Some(Command::FitCurve(args)) => fit_curve(&args, out),
        Some(Command::Predict(args)) => predict(&args, out),
    }
}

fn check_outputs(command: &Command) -> Result<(), InputError> {
    let (json, plot, picture, read) = match command {
        Command::List(args) => (&args.json, &args.plot, Some(&args.picture), &[][..]),
        Command::FitCurve(args) => {
            let read = args.files.as_slice();
            (&args.json, &args.plot, Some(&args.picture), read)
        }
        Command::Predict(args) => (&args.json, &None, None, &[][..]),
    };
    if let Some(picture) = picture {
        picture.check("--plot", plot.as_ref())?;
    }
    let json = json.as_ref().filter(|path| !is_stdout(path));
    output::check(
        &[
            Output::of("--json", FileKind::Json, json),
            Output::of("--plot", FileKind::Picture, plot.as_ref()),
        ],
        read,
    )
}

/// Writes a result as JSON if asked to; returns whether the text is still wanted.
fn deliver_json(
    to: Option<&Path>,
    value: &impl Serialize,
    out: &mut dyn Write,
) -> anyhow::Result<bool> {
    let Some(path) = to else {
        return Ok(true);
    };
    let text = text_of(value)?;
    if is_stdout(path) {
        out.write_all(text.as_bytes())?;
        return Ok(false);
    }
    write_atomically(path, text.as_bytes())?;
    Ok(true)
}

fn percent_off(value: f64, truth: f64) -> f64 {
    100.0 * (value - truth) / truth
}

const SOURCE: &str = "Yang, Stuart, Kurkcu and Tomizuka, arXiv 2311.02527";

fn list(args: &ListArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let predictor = PredictorFit::new(&eight_rows())?;
    let all_rows = PredictorFit::new(&TABLE_I)?;
    let unseen = leave_one_out(&TABLE_I)?;
    if let Some(path) = &args.plot {
        args.picture
            .write(path, &pictures::predictor_figure(&predictor, &unseen))?;
    }
    let source = format!("{SOURCE}, Tables I and II");
    let value = json::List::new(source, &predictor, &all_rows, unseen);
    if !deliver_json(args.json.as_deref(), &value, out)? {
        return Ok(());
    }
    write_table_i(out)?;
    writeln!(out)?;
    writeln!(
        out,
        "Predictor n = x1 E/MPa + x2 √(MV/50000 cps) + x3 √(TS/10 MPa) (Eq. 8), eight rows:"
    )?;
    for (index, name) in ["x1", "x2", "x3"].into_iter().enumerate() {
        writeln!(
            out,
            "  {name} = {:>9.6} ± {:.3}   t = {:>5.2}{}",
            predictor.coefficients[index],
            predictor.standard_errors[index],
            predictor.t_values[index],
            if predictor.t_values[index].abs() > predictor.critical_t() {
                "   significant at 95 %"
            } else {
                ""
            },
        )?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "{:<20} {:>10} {:>9} {:>11}   error against Table II (Table I)",
        "", "eight rows", "all ten", "the paper's"
    )?;
    for material in TABLE_I.iter().rev() {
        let Some(held_out) = material.held_out else {
            continue;
        };
        let ours = predictor.predict(&material.data_sheet()).exponent;
        let all = all_rows.predict(&material.data_sheet()).exponent;
        let theirs = held_out.published_estimate::<f64>();
        let off = |value: f64| {
            format!(
                "{:+.1} % ({:+.1} %)",
                percent_off(value, held_out.exponent()),
                percent_off(value, material.exponent())
            )
        };
        writeln!(
            out,
            "{:<20} {ours:>10.4} {all:>9.4} {theirs:>11.3}   ours {}, the paper's {}",
            material.name,
            off(ours),
            off(theirs),
        )?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "The paper states an error under 10 %; its own estimate of Dragon Skin FX-Pro is +12.3 % \
         off.\nDragon Skin 20 is 2.500 in Table I and 2.174 in Table II. No plain variant of the \
         fit gives\nthe paper's two estimates to three decimals."
    )?;
    writeln!(out, "{}", sentence_on_unseen(&unseen))?;
    if let Some(path) = &args.plot {
        writeln!(out, "picture: {}", path.display())?;
    }
    Ok(())
}

/// Table I, with the two that the predictor's fit leaves out marked.
fn write_table_i(out: &mut dyn Write) -> std::io::Result<()> {
    writeln!(out, "Table I of {SOURCE}")?;
    writeln!(out)?;
    writeln!(
        out,
        "{:<23} {:>6} {:>9} {:>22} {:>23}",
        "material", "n", "E (MPa)", "mixed viscosity (cps)", "tensile strength (MPa)"
    )?;
    for material in &TABLE_I {
        let sheet = material.data_sheet::<f64>();
        let mark = if material.held_out.is_some() {
            " *"
        } else {
            ""
        };
        writeln!(
            out,
            "{:<23} {:>6.3} {:>9.2} {:>22.0} {:>23.2}",
            format!("{}{mark}", material.name),
            material.exponent::<f64>(),
            sheet.modulus_mpa(),
            sheet.mixed_viscosity_cps(),
            sheet.tensile_strength_mpa(),
        )?;
    }
    writeln!(
        out,
        "* held out of the predictor's fit; Table II estimates them"
    )
}

fn sentence_on_unseen(unseen: &LeaveOneOut) -> String {
    format!(
        "Leaving out one of the ten at a time, the predictor misses by {:.3} (RMS), the mean of \
         the\nothers by {:.3}: a measured curve is worth more than a prediction.",
        unseen.predictor_rms, unseen.mean_rms
    )
}

fn predict(args: &PredictArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let sheet = DataSheet::new(args.modulus_mpa, args.viscosity_cps, args.tensile_mpa).map_err(
        |error| InputError::new(error.to_string(), "take the figure from the data sheet"),
    )?;
    let rows = if args.all_rows {
        TABLE_I.to_vec()
    } else {
        eight_rows()
    };
    let fit = PredictorFit::new(&rows)?;
    let unseen = leave_one_out(&TABLE_I)?;
    let prediction = fit.predict(&sheet);
    let value = json::Predicted::new(&prediction, &sheet, rows.len(), &fit, unseen);
    if !deliver_json(args.json.as_deref(), &value, out)? {
        return Ok(());
    }
    writeln!(
        out,
        "n = {:.3} ± {:.3} (standard error), 95 % interval {:.2} to {:.2}",
        prediction.exponent,
        prediction.standard_error,
        prediction.interval95[0],
        prediction.interval95[1]
    )?;
    let [x1, x2, x3] = fit.coefficients;
    writeln!(
        out,
        "  = {x1:.6} · {} + {x2:.6} · √({}/50000) + {x3:.6} · √({}/10), fitted to {} rows of Table I",
        sheet.modulus_mpa(),
        sheet.mixed_viscosity_cps(),
        sheet.tensile_strength_mpa(),
        rows.len(),
    )?;
    for warning in &prediction.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    writeln!(out, "{}", sentence_on_unseen(&unseen))?;
    Ok(())
}

fn choice_of(args: &FitCurveArgs, curve: &TensileCurve) -> Result<Choice, InputError> {
    if args.paper {
        let modulus = match args.modulus_mpa {
            Some(ModulusArg(Modulus::Fixed(mpa))) => mpa,
            Some(ModulusArg(Modulus::Free)) => {
                return Err(InputError::new(
                    "--paper holds the modulus and --modulus-mpa frees it",
                    "leave out one of the two",
                ));
            }
            None => table_row(curve)
                .map(|material| material.data_sheet::<f64>().modulus_mpa())
                .ok_or_else(|| {
                    InputError::new(
                        format!("`{}` is not in Table I", curve.material),
                        "give its modulus with --modulus-mpa",
                    )
                    .in_file(&curve.path)
                })?,
        };
        return Ok(Choice::paper(modulus));
    }
    // A measure that is not given follows the other one, so that a mixed pair is never
    // chosen by default.
    let default = Choice::default();
    Ok(Choice {
        stress: args.stress.or(args.strain).unwrap_or(default.stress),
        strain: args.strain.or(args.stress).unwrap_or(default.strain),
        range: args.range,
        modulus: args.modulus_mpa.map_or(default.modulus, |arg| arg.0),
        residual: args.residual.unwrap_or(default.residual),
    })
}

fn fit_curve(args: &FitCurveArgs, out: &mut dyn Write) -> anyhow::Result<()> {
    let mut fitted = Vec::new();
    for path in &args.files {
        let curve = TensileCurve::read(path)?;
        let choice = choice_of(args, &curve)?;
        let fit = fit::fit(&curve, &choice)?;
        fitted.push((curve, fit));
    }
    match fitted.as_slice() {
        [(curve, fit)] => fit_one(args, curve, fit, out),
        all => fit_several(args, all, out),
    }
}

/// A row a curve, and all of them in one picture.
fn fit_several(
    args: &FitCurveArgs,
    fitted: &[(TensileCurve, CurveFit)],
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let Some((_, first)) = fitted.first() else {
        return Ok(());
    };
    let alike = fitted.iter().all(|(_, fit)| fit.choice == first.choice);
    let choice = if alike {
        first.choice_sentence()
    } else {
        // The paper's recipe holds each modulus where the table has it.
        first.choice_but("modulus held as in Table I")
    };
    if let Some(path) = &args.plot {
        args.picture.write(
            path,
            &pictures::curves_figure(fitted, &with_capital(&choice)),
        )?;
    }
    let value = json::Curves::new(args.paper, fitted);
    if !deliver_json(args.json.as_deref(), &value, out)? {
        return Ok(());
    }
    writeln!(out, "Ludwick's law; {choice}")?;
    writeln!(out)?;
    writeln!(
        out,
        "{:<23} {:>7} {:>15} {:>18} {:>20} {:>9} {:>10}",
        "material", "samples", "strain", "n", "E (MPa)", "R²", "Table I: n"
    )?;
    for (curve, fit) in fitted {
        let table = table_row(curve).map(Material::exponent::<f64>);
        writeln!(
            out,
            "{:<23} {:>7} {:>15} {:>18} {:>20} {:>9.5} {:>10}",
            pictures::name(curve),
            fit.points,
            format!("{:.3} to {:.3}", fit.strains.0, fit.strains.1),
            with_error(fit.ludwick.exponent),
            with_error(fit.ludwick.modulus_mpa),
            fit.ludwick.r_squared,
            table.map_or_else(|| "–".to_owned(), |exponent| format!("{exponent:.3}")),
        )?;
    }
    let of_each: Vec<Vec<String>> = fitted.iter().map(|(curve, fit)| fit.notes(curve)).collect();
    let (of_all, others): (Vec<&String>, Vec<&String>) = of_each
        .iter()
        .flatten()
        .partition(|note| of_each.iter().all(|notes| notes.contains(note)));
    writeln!(out)?;
    for note in &of_all[..of_all.len() / fitted.len()] {
        writeln!(out, "note: {note}")?;
    }
    if !others.is_empty() {
        writeln!(
            out,
            "{} notes on single curves: fit one curve alone to read them, or use --json",
            others.len()
        )?;
    }
    if let Some(path) = &args.plot {
        writeln!(out, "picture: {}", path.display())?;
    }
    Ok(())
}

fn fit_one(
    args: &FitCurveArgs,
    curve: &TensileCurve,
    fit: &CurveFit,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let choice = &fit.choice;
    let notes = fit.notes(curve);
    if let Some(path) = &args.plot {
        let sentence = with_capital(&fit.choice_sentence());
        args.picture
            .write(path, &pictures::curve_figure(curve, fit, &sentence))?;
    }
    let value = json::Curve::new(args.paper, curve, fit);
    if !deliver_json(args.json.as_deref(), &value, out)? {
        return Ok(());
    }
    writeln!(out, "{} ({})", curve.material, curve.path.display())?;
    writeln!(
        out,
        "{} samples, strain {:.4} to {:.4}",
        fit.points, fit.strains.0, fit.strains.1
    )?;
    writeln!(out, "{}", fit.choice_sentence())?;
    writeln!(out)?;
    writeln!(
        out,
        "{:<9} {:>18} {:>20} {:>12} {:>9}",
        "law",
        "n",
        "E (MPa)",
        match choice.residual {
            Residual::Stress => "RMS (MPa)",
            Residual::Strain => "RMS (1)",
        },
        "R²"
    )?;
    for (name, law) in [("Ludwick", &fit.ludwick), ("Hooke", &fit.hooke)] {
        writeln!(
            out,
            "{name:<9} {:>18} {:>20} {:>12.5} {:>9.5}",
            with_error(law.exponent),
            with_error(law.modulus_mpa),
            law.rms,
            law.r_squared
        )?;
    }
    if let Some(material) = table_row(curve) {
        writeln!(
            out,
            "{:<9} {:>18} {:>20}",
            "Table I",
            format!("{:.3}", material.exponent::<f64>()),
            format!("{:.2}", material.data_sheet::<f64>().modulus_mpa())
        )?;
    }
    if !notes.is_empty() {
        writeln!(out)?;
    }
    for note in &notes {
        writeln!(out, "note: {note}")?;
    }
    if let Some(path) = &args.plot {
        writeln!(out, "picture: {}", path.display())?;
    }
    Ok(())
}

fn with_error(estimate: Estimate) -> String {
    match estimate.standard_error {
        Some(error) => format!("{:.4} ± {error:.4}", estimate.value),
        None => format!("{:.4} (held)", estimate.value),
    }
}

fn with_capital(sentence: &str) -> String {
    let mut letters = sentence.chars();
    let first = letters.next().into_iter().flat_map(char::to_uppercase);
    first.chain(letters).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn rig(arguments: &[&str]) -> Result<String, String> {
        let words = std::iter::once("materials").chain(arguments.iter().copied());
        let args = Args::try_parse_from(words).map_err(|error| error.to_string())?;
        let mut out = Vec::new();
        execute(args, &mut out).map_err(|error| error.to_string())?;
        Ok(String::from_utf8(out).unwrap())
    }

    fn curve_file(folder: &Path) -> String {
        use std::fmt::Write as _;
        let mut text = "strain,stress_mpa\n".to_owned();
        for i in 0..=100 {
            let strain = f64::from(i) * 0.05;
            writeln!(text, "{strain},{}", 0.3 * strain.powf(1.5)).unwrap();
        }
        let path = folder.join("rubber.csv");
        std::fs::write(&path, text).unwrap();
        path.display().to_string()
    }

    #[test]
    fn list_shows_table_predictor_and_defects() {
        let text = rig(&[]).unwrap();
        assert_eq!(text, rig(&["list"]).unwrap());
        for expected in [
            "Dragon Skin 20 *         2.500      0.34                  20000                    3.79",
            "x1 = -0.748293",
            "x3 =  3.825142",
            "Dragon Skin 20           2.3726    2.3729       2.365",
            "Dragon Skin FX-Pro       1.7700    1.7321       1.727   ours +15.1 % (+15.1 %), the paper's +12.3 % (+12.3 %)",
            "2.500 in Table I and 2.174 in Table II",
            "misses by 0.293 (RMS)",
        ] {
            assert!(text.contains(expected), "{expected} in\n{text}");
        }
        assert_eq!(text.matches("significant").count(), 1);
        let value: Value = serde_json::from_str(&rig(&["list", "--json"]).unwrap()).unwrap();
        assert_eq!(value["materials"].as_array().unwrap().len(), 10);
        assert_eq!(value["materials"][2]["table_ii"]["exponent"], 2.174);
    }

    #[test]
    fn predict_gives_an_error_bar_and_warns_outside_the_table() {
        let inside = rig(&[
            "predict",
            "--modulus-mpa",
            "0.34",
            "--viscosity-cps",
            "20000",
            "--tensile-mpa",
            "3.79",
        ])
        .unwrap();
        assert!(inside.starts_with("n = 2.373 ± "), "{inside}");
        assert!(!inside.contains("warning"));
        let outside = [
            "predict",
            "--modulus-mpa",
            "1.5",
            "--viscosity-cps",
            "20000",
            "--tensile-mpa",
            "3.79",
        ];
        assert!(
            rig(&outside)
                .unwrap()
                .contains("warning: the modulus of 1.5 MPa is outside")
        );
        let json = [&outside[..], &["--json", "--all-rows"]].concat();
        let value: Value = serde_json::from_str(&rig(&json).unwrap()).unwrap();
        assert_eq!(value["rows"], 10);
        assert_eq!(value["warnings"].as_array().unwrap().len(), 1);
        let refused = rig(&[
            "predict",
            "--modulus-mpa",
            "-1",
            "--viscosity-cps",
            "20000",
            "--tensile-mpa",
            "3.79",
        ]);
        assert_eq!(
            refused.unwrap_err(),
            "the modulus must be greater than zero; take the figure from the data sheet"
        );
    }

    #[test]
    fn fit_curve_prints_writes_and_draws() {
        let folder = tempfile::tempdir().unwrap();
        let file = curve_file(folder.path());
        let (svg, json) = (folder.path().join("a.svg"), folder.path().join("a.json"));
        let (svg_path, json_path) = (svg.display().to_string(), json.display().to_string());
        let text = rig(&[
            "fit-curve",
            &file,
            "--plot",
            &svg_path,
            "--json",
            &json_path,
            "--range",
            "0,4",
        ])
        .unwrap();
        assert!(text.contains("engineering stress against engineering strain, range 0 to 4, modulus free, misfit in stress"));
        assert!(text.contains("1.5000 ± 0.0000"), "{text}");
        let value: Value = serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap();
        assert!((value["ludwick"]["exponent"]["value"].as_f64().unwrap() - 1.5).abs() < 1e-9);
        assert_eq!(value["points"], 81);
        assert_eq!(value["choice"]["range"], json!([0.0, 4.0]));
        assert!(
            std::fs::read_to_string(&svg)
                .unwrap()
                .contains("not fitted")
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3);
        let value: Value =
            serde_json::from_str(&rig(&["fit-curve", &file, "--json", "-"]).unwrap()).unwrap();
        assert_eq!(value["choice"]["modulus_mpa"], "free");
    }

    #[test]
    fn several_curves_make_a_table_and_one_picture() {
        let folder = tempfile::tempdir().unwrap();
        let file = curve_file(folder.path());
        let other = folder.path().join("Ecoflex 00-30.csv");
        std::fs::copy(&file, &other).unwrap();
        let other = other.display().to_string();
        let svg = folder.path().join("both.svg").display().to_string();
        let text = rig(&["fit-curve", &file, &other, "--plot", &svg]).unwrap();
        assert!(
            text.starts_with("Ludwick's law; engineering stress against"),
            "{text}"
        );
        let row = text.lines().find(|line| line.starts_with("Ecoflex 00-30"));
        assert!(row.is_some_and(|row| row.ends_with("1.613")), "{text}");
        assert_eq!(text.matches("1.5000 ± 0.0000").count(), 2);
        let picture = std::fs::read_to_string(&svg).unwrap();
        assert!(picture.contains("Ecoflex 00-30: n = 1.50, E = 0.300 MPa"));
        let value: Value =
            serde_json::from_str(&rig(&["fit-curve", &file, &other, "--json", "-"]).unwrap())
                .unwrap();
        assert_eq!(value["curves"].as_array().unwrap().len(), 2);
        assert_eq!(value["curves"][1]["points"], 101);
        let list = rig(&["list", "--plot", &svg]).unwrap();
        assert!(list.ends_with("both.svg\n"), "{list}");
        assert!(
            std::fs::read_to_string(&svg)
                .unwrap()
                .contains("modulus E (MPa)")
        );
    }

    #[test]
    fn a_measure_left_out_follows_the_other() {
        let folder = tempfile::tempdir().unwrap();
        let file = curve_file(folder.path());
        let choice = |more: &[&str]| {
            let arguments = [&["fit-curve", &file, "--json", "-"], more].concat();
            let value: Value = serde_json::from_str(&rig(&arguments).unwrap()).unwrap();
            let notes = value["notes"].to_string();
            (
                value["choice"].clone(),
                notes.contains("not a consistent pair"),
            )
        };
        let (followed, mixed) = choice(&["--stress", "true"]);
        assert_eq!((&followed["strain"], mixed), (&json!("true"), false));
        let (followed, _) = choice(&["--strain", "true"]);
        assert_eq!(followed["stress"], "true");
        let (_, mixed) = choice(&["--stress", "true", "--strain", "engineering"]);
        assert!(mixed);
        let (paper, mixed) = choice(&["--paper", "--modulus-mpa", "0.3"]);
        assert_eq!(paper["residual"], "strain");
        assert_eq!((&paper["modulus_mpa"], mixed), (&json!(0.3), true));
    }

    #[test]
    fn wrong_arguments_are_refused_with_advice() {
        let folder = tempfile::tempdir().unwrap();
        let file = curve_file(folder.path());
        let refused = |more: &[&str]| rig(&[&["fit-curve", &file], more].concat()).unwrap_err();
        assert!(refused(&["--paper"]).ends_with(
            "rubber.csv: `rubber` is not in Table I; give its modulus with --modulus-mpa"
        ));
        assert!(refused(&["--paper", "--modulus-mpa", "free"]).contains("leave out one"));
        assert!(refused(&["--paper", "--stress", "true"]).contains("cannot be used with"));
        assert!(refused(&["--range", "3"]).contains("such as `0,0.5`"));
        assert!(refused(&["--range", "3,1"]).contains("the smaller first"));
        assert!(refused(&["--modulus-mpa", "-3"]).contains("--modulus-mpa"));
        assert!(refused(&["--modulus-mpa", "soft"]).contains("or `free`"));
        assert!(refused(&["--plot", "/nonexistent/a.svg"]).contains("create it first"));
    }
}
