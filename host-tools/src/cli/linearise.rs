//! `softrig linearise`: a model for small motions about a rest, for the design of a controller.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use clap::Parser;
use schemars::JsonSchema;
use serde::Serialize;

use super::json::{JsonArgs, SCHEMA};
use super::model::ModelArgs;
use super::output::{self, FileKind, Output};
use super::picture::PictureArgs;
use softrig::linear::{Linear, Pole, angle_under};
use softrig_formats::columns::{AngleUnit, Quantity};
use softrig_formats::error::{InputError, write_atomically};
use softrig_formats::measurand::Measurand;
use softrig_formats::model_file::ModelFile;
use softrig_formats::numbers::{exact, short, tidy};
use softrig_formats::recording::PASCAL_PER_KPA;
use softrig_report::plot::{Figure, Panel, Series, Style};

/// Linearises a model at equilibrium: poles, damping, bandwidth, Bode plot, and state space for
/// scipy.signal or MATLAB.
///
/// Input: gauge pressure (kPa); output: reading of the angle sensor (°); both as deviations from
/// equilibrium. Friction and play have no slope: they are left out, and named.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig linearise --model m.toml --at 30deg
  softrig linearise --model m.toml --at 45kpa --plot bode.svg
  softrig linearise --model m.toml --at 30deg -o finger.py    # scipy.signal.StateSpace
  softrig linearise --model m.toml --at 30deg -o finger.m     # ss(A, B, C, D) of MATLAB")]
pub struct Args {
    #[command(flatten)]
    model: ModelArgs,
    /// Equilibrium: an angle (deg, rad), an output in its unit (mm, cm, um, mv) or its pressure
    /// (kpa)
    #[arg(long, value_name = "30deg")]
    at: At,
    /// Draw the Bode plot
    #[arg(long, value_name = "BODE.svg|pdf|png")]
    plot: Option<PathBuf>,
    /// Write the state space: .py for scipy.signal, .m for MATLAB and Octave
    #[arg(short, long, value_name = "SYSTEM.py|SYSTEM.m")]
    output: Option<PathBuf>,
    #[command(flatten)]
    json: JsonArgs,
    #[command(flatten)]
    picture: PictureArgs,
}

/// The first words in the header of every file that it writes as code.
pub(super) const WRITTEN_BY: &str = "Written by `softrig linearise`";

/// The rest as it is asked for, and what the output is by its unit: without one, a bending angle.
#[derive(Clone, Debug, PartialEq)]
struct At {
    rest: Rest,
    measurand: Measurand,
}

/// Where the actuator rests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rest {
    /// At an angle (rad).
    Angle(f64),
    /// Under a pressure (Pa).
    Pressure(f64),
}

impl FromStr for At {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || {
            format!(
                "\"{text}\" has no known unit; give the equilibrium as 30deg, 0.5rad, 12mm or 45kpa"
            )
        };
        let lower = text.trim().to_lowercase().replace('°', "deg");
        let digits = lower.trim_end_matches(char::is_alphabetic);
        let unit = lower[digits.len()..].replace('µ', "u");
        let number = digits
            .trim_end()
            .parse()
            .ok()
            .filter(|it: &f64| it.is_finite());
        let number = number.ok_or_else(wrong)?;
        if unit == "kpa" {
            return Ok(Self {
                rest: Rest::Pressure(number * PASCAL_PER_KPA),
                measurand: Measurand::default(),
            });
        }
        let unit: AngleUnit = unit.parse().map_err(|_| wrong())?;
        let angle = (number * unit.degrees()).to_radians();
        if unit.is_of_angle() && angle.abs() > std::f64::consts::PI {
            return Err("an actuator bends by 180° at most".to_owned());
        }
        Ok(Self {
            rest: Rest::Angle(angle),
            measurand: Measurand::of(Quantity::Angle.column(), Some(unit)),
        })
    }
}

/// What `softrig linearise --json` writes.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Linearised {
    /// Version of the layout.
    schema: u32,
    /// Name of the model.
    model: String,
    /// The angle of the rest (°).
    angle_deg: f64,
    /// What the sensor shows there (°).
    reading_deg: f64,
    /// The pressure that holds it there (kPa).
    pressure_kpa: f64,
    /// Names of the states.
    states: Vec<String>,
    /// The matrix A, row by row.
    a: Vec<Vec<f64>>,
    /// The column B, by the pressure (kPa).
    b: Vec<f64>,
    /// The row C, of the reading (°).
    c: Vec<f64>,
    /// The number D, always zero.
    d: f64,
    /// How late the pressure comes (s).
    delay_s: f64,
    /// The poles, slowest first.
    poles: Vec<PoleOf>,
    /// Whether every small motion dies away.
    stable: bool,
    /// What a lasting change of the pressure changes in the end (°/kPa); absent where it grows.
    #[serde(skip_serializing_if = "Option::is_none")]
    steady_gain_deg_per_kpa: Option<f64>,
    /// From where on the response is 3 dB below that (Hz).
    #[serde(skip_serializing_if = "Option::is_none")]
    bandwidth_hz: Option<f64>,
    /// The highest response beside the steady one; absent where none is higher.
    #[serde(skip_serializing_if = "Option::is_none")]
    resonance: Option<Resonance>,
    /// Effects without a slope, which are left out.
    left_out: Vec<String>,
}

/// A pole.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct PoleOf {
    /// Real part (1/s).
    re_per_s: f64,
    /// Imaginary part (1/s).
    im_per_s: f64,
    /// Natural frequency (Hz).
    natural_frequency_hz: f64,
    /// Damping ratio: 1 without a swing.
    damping_ratio: f64,
}

impl PoleOf {
    fn of(pole: &Pole) -> Self {
        Self {
            re_per_s: tidy(pole.place.re),
            im_per_s: tidy(pole.place.im),
            natural_frequency_hz: tidy(pole.natural_frequency() / TAU),
            damping_ratio: tidy(pole.damping_ratio()),
        }
    }
}

/// The highest response.
#[derive(Clone, Debug, Serialize, JsonSchema)]
struct Resonance {
    /// Where (Hz).
    frequency_hz: f64,
    /// How high beside the steady response (dB).
    peak_db: f64,
}

/// Degrees of the reading by kPa, of radians by Pa.
const SHOWN: f64 = 57.295_779_513_082_32 * PASCAL_PER_KPA;

/// A ratio in decibels.
fn decibels(ratio: f64) -> f64 {
    20.0 * ratio.log10()
}

/// Runs the command.
///
/// # Errors
///
/// Faults of the input, with place and remedy.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let model = args.model.find()?;
    args.picture.check("--plot", args.plot.as_ref())?;
    output::check(
        &[
            Output::of("-o", FileKind::Code, args.output.as_ref()),
            Output::of("--plot", FileKind::Picture, args.plot.as_ref()),
            args.json.output(),
        ],
        [&model],
    )?;
    let language = args.output.as_deref().map(Language::of).transpose()?;
    let file = super::read_model(&model)?;
    let (linear, result) = Linearised::at(&file, args.at.rest)?;
    let measurand = &args.at.measurand;
    let mut text = result.text(measurand);
    if let Some(path) = &args.plot {
        args.picture.write(path, &result.bode(&linear, measurand))?;
        text += &format!("\npicture: {}\n", path.display());
    }
    if let Some((path, language)) = args.output.as_ref().zip(language) {
        write_atomically(path, result.code(language, measurand).as_bytes())?;
        text += &format!("\nwritten: {}\n", path.display());
    }
    args.json.deliver(&result, &text)
}

/// What the state space is written for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Language {
    Python,
    Matlab,
}

impl Language {
    /// By the name of the file.
    fn of(path: &Path) -> Result<Self, InputError> {
        match path.extension().and_then(|it| it.to_str()) {
            Some("py") => Ok(Self::Python),
            Some("m") => Ok(Self::Matlab),
            _ => Err(InputError::new(
                "ends neither with .py nor with .m",
                "name it .py for scipy.signal, .m for MATLAB and Octave, or take the numbers from --json",
            )
            .in_file(path)),
        }
    }
}

impl Linearised {
    /// Of a model at rest.
    ///
    /// # Errors
    ///
    /// Where the pressure holds it nowhere, no pressure holds it there, or its equations have no
    /// slope.
    pub fn at(file: &ModelFile, rest: Rest) -> Result<(Linear, Self), InputError> {
        let angle = match rest {
            Rest::Angle(angle) => angle,
            Rest::Pressure(pressure) => angle_under(&file.model, pressure).ok_or_else(|| {
                InputError::new(
                    format!(
                        "{} kPa: no equilibrium within half a turn",
                        short(pressure / PASCAL_PER_KPA)
                    ),
                    "name another pressure, or an angle",
                )
                .in_file(&file.path)
            })?,
        };
        let linear = Linear::at(&file.model, angle).map_err(|error| {
            InputError::new(error.to_string(), "name another angle").in_file(&file.path)
        })?;
        let this = Self::of(file, &linear);
        Ok((linear, this))
    }

    fn of(file: &ModelFile, linear: &Linear) -> Self {
        let order = linear.states.len();
        let row = |row: usize| (0..order).map(|k| linear.dynamics[(row, k)]).collect();
        Self {
            schema: SCHEMA,
            model: file.name.clone(),
            angle_deg: tidy(linear.angle.to_degrees()),
            reading_deg: tidy(linear.reading.to_degrees()),
            pressure_kpa: tidy(linear.pressure / PASCAL_PER_KPA),
            states: linear.states.clone(),
            a: (0..order).map(row).collect(),
            b: linear.input.iter().map(|it| it * PASCAL_PER_KPA).collect(),
            c: linear.output.iter().map(|it| it.to_degrees()).collect(),
            d: 0.0,
            delay_s: linear.delay,
            poles: linear.poles().iter().map(PoleOf::of).collect(),
            stable: linear.is_stable(),
            steady_gain_deg_per_kpa: linear.steady_gain().map(|gain| tidy(gain * SHOWN)),
            bandwidth_hz: linear.bandwidth().map(|it| tidy(it / TAU)),
            resonance: linear.resonance().map(|(ratio, frequency)| Resonance {
                frequency_hz: tidy(frequency / TAU),
                peak_db: tidy(decibels(ratio)),
            }),
            left_out: linear
                .left_out
                .iter()
                .map(|it| it.name().to_owned())
                .collect(),
        }
    }

    /// Where it rests.
    fn rest(&self, measurand: &Measurand) -> String {
        format!(
            "{} at rest at {}{} under {} kPa",
            self.model,
            short(self.angle_deg),
            measurand.unit(),
            short(self.pressure_kpa)
        )
    }

    fn text(&self, measurand: &Measurand) -> String {
        let mut text = format!(
            "{}; the sensor shows {}{}.\n",
            self.rest(measurand),
            short(self.reading_deg),
            measurand.unit()
        );
        if !self.left_out.is_empty() {
            text += &format!(
                "Left out, since it has no slope: {}. The numbers hold for motions that are large beside it.\n",
                self.left_out.join(", ")
            );
        }
        text += &format!(
            "\n{:>24} {:>12} {:>15} {:>18}\n",
            "pole (1/s)", "f (Hz)", "damping ratio", "time constant (s)"
        );
        for pole in &self.poles {
            // A pair is one row.
            if pole.im_per_s < 0.0 {
                continue;
            }
            let place = if pole.im_per_s == 0.0 {
                short(pole.re_per_s)
            } else {
                format!("{} ± {} i", short(pole.re_per_s), short(pole.im_per_s))
            };
            let lasts = if pole.re_per_s < 0.0 {
                short(-1.0 / pole.re_per_s)
            } else {
                "grows".to_owned()
            };
            text += &format!(
                "{place:>24} {:>12} {:>15} {lasts:>18}\n",
                short(pole.natural_frequency_hz),
                short(pole.damping_ratio),
            );
        }
        text.push('\n');
        if let Some(gain) = self.steady_gain_deg_per_kpa {
            text += &format!("steady gain  {} {}/kPa\n", short(gain), measurand.symbol());
        } else {
            text += "steady gain  none: the model integrates or is unstable\n";
        }
        if let Some(bandwidth) = self.bandwidth_hz {
            text += &format!("bandwidth    {} Hz (−3 dB)\n", short(bandwidth));
        }
        if let Some(it) = &self.resonance {
            text += &format!(
                "resonance    {} Hz, {} dB above the steady gain\n",
                short(it.frequency_hz),
                short(it.peak_db)
            );
        }
        if self.delay_s > 0.0 {
            text += &format!("dead time    {} s\n", short(self.delay_s));
        }
        text
    }

    /// Magnitude and phase over the frequency.
    fn bode(&self, linear: &Linear, measurand: &Measurand) -> Figure {
        let frequencies = Linear::frequencies(linear.span(), 600);
        let [mut places, mut magnitude, mut phase] = [const { Vec::<f64>::new() }; 3];
        let mut turned = 0.0;
        for frequency in frequencies {
            let Some(response) = linear.response(frequency) else {
                continue;
            };
            let now = response.arg().to_degrees() + turned;
            // Without the jumps of a whole turn.
            let jump = phase
                .last()
                .map_or(0.0, |before| 360.0 * ((before - now) / 360.0).round());
            turned += jump;
            places.push((frequency / TAU).log10());
            magnitude.push(decibels(response.norm() * SHOWN));
            phase.push(now + jump);
        }
        let panel = |title: &str, unit: &str, values: &[f64]| {
            Panel::new("frequency (Hz)", unit)
                .with_decades()
                .with_title(title)
                .with_series(Series::new("", &places, values, Style::AFTER))
        };
        let level = format!("magnitude (dB re 1 {}/kPa)", measurand.symbol());
        Figure::new(format!("Small motions of {}", self.model))
            .with_subtitle(format!(
                "{}; from the pressure to what the {} sensor shows",
                self.rest(measurand),
                measurand.name()
            ))
            .with_panel(panel("Magnitude", &level, &magnitude))
            .with_panel(panel("Phase", "phase (°)", &phase))
    }

    /// The state space as a program.
    fn code(&self, language: Language, measurand: &Measurand) -> String {
        let (comment, between) = match language {
            Language::Python => ("#", "],\n              ["),
            Language::Matlab => ("%", ";\n     "),
        };
        let row = |row: &Vec<f64>| {
            row.iter()
                .copied()
                .map(exact)
                .collect::<Vec<_>>()
                .join(", ")
        };
        let a = self.a.iter().map(row).collect::<Vec<_>>().join(between);
        let b: Vec<String> = self.b.iter().copied().map(exact).collect();
        let c = row(&self.c);
        let delay = exact(self.delay_s);
        let about = format!(
            "{comment} {WRITTEN_BY}: {}.\n{comment} Input: gauge pressure (kPa), output: reading of the {} sensor ({}), both as deviations.\n{comment} States: {}.\n",
            self.rest(measurand).replace(['\n', '\r'], " "),
            measurand.name(),
            measurand.suffix(),
            self.states.join(", ")
        );
        match language {
            Language::Python => format!(
                "{about}import numpy as np\nfrom scipy import signal\n\nA = np.array([[{a}]])\nB = np.array([[{}]])\nC = np.array([[{c}]])\nD = np.array([[0.0]])\nsystem = signal.StateSpace(A, B, C, D)\ninput_delay_s = {delay}  # scipy knows no delay: shift the input by it\n",
                b.join("], [")
            ),
            Language::Matlab => format!(
                "{about}A = [{a}];\nB = [{}];\nC = [{c}];\nD = 0;\ninput_delay_s = {delay};\nif exist('ss') % the Control System Toolbox, or the package control of Octave\n  system = ss(A, B, C, D, 'InputDelay', input_delay_s);\nend\n",
                b.join("; ")
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rest_is_read_with_its_unit() {
        let rest = |text: &str| text.parse::<At>().map(|it| (it.rest, it.measurand.label()));
        let angle =
            |degrees: f64, label: &str| Ok((Rest::Angle(degrees.to_radians()), label.to_owned()));
        assert_eq!(rest("30deg"), angle(30.0, "angle (°)"));
        assert_eq!(rest("30 °"), angle(30.0, "angle (°)"));
        assert_eq!(rest("12.5 mm"), angle(12.5, "output (mm)"));
        assert_eq!(rest("900µm"), angle(900.0, "output (µm)"));
        assert_eq!(rest("0.5rad").unwrap().0, Rest::Angle(0.5));
        assert_eq!(rest("45kPa").unwrap().0, Rest::Pressure(45_000.0));
        for wrong in ["30", "", "deg", "nandeg", "infkpa", "1e999kpa", "30psi"] {
            let error = rest(wrong).unwrap_err();
            assert!(error.contains("30deg, 0.5rad, 12mm or 45kpa"), "{error}");
        }
        assert!(rest("900deg").unwrap_err().contains("180°"));
    }
}
