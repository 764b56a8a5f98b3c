//! The file of a first model: its numbers, and a comment for each.

use std::path::Path;

use model_core::actuator::ParameterId;
use toml_edit::Value;

use super::{Evidence, FirstModel, Geometry, Origin, beam_stiffness};
use softrig_formats::columns::Layout;
use softrig_formats::model_file::{BY_CONVENTION, parameter_name, parameter_unit, to_file_units};
use softrig_formats::numbers::{four_digits, tidy};
use softrig_formats::terminal::printable_line;

/// The schema that editors look for beside a model.
const SCHEMA_FILE: &str = "model.schema.json";

/// What the base parameters are, in the order of [`ParameterId::BASE`].
const WHAT: [&str; 5] = [
    "effective inertia M",
    "damping C",
    "stiffness K",
    "exponent n of Ludwick's law, 1 for a linear spring",
    "input gain g, per unit of the column pressure_kpa",
];

impl Origin {
    /// In words; `unit` is that of the number.
    pub fn sentence(&self, unit: &str) -> String {
        match self {
            Self::Fitted(Some((low, high))) => {
                let range = format!("{} to {} {unit}", four_digits(*low), four_digits(*high));
                format!("fitted; 95 % interval {}", range.trim())
            }
            Self::Fitted(None) => "fitted, but hardly determined by the recordings".into(),
            Self::Nothing => {
                "fitted; next to nothing: the recordings hardly show such a force".into()
            }
            Self::Table(material) => format!(
                "table of materials, {}: measured on strips, good to about 0.3",
                printable_line(material)
            ),
            Self::Beam => {
                "beam formula with material and dimensions: good to a factor of two at best".into()
            }
            Self::Convention(why) => format!("{BY_CONVENTION}{why}"),
            Self::Guess(how) => format!("GUESS: {how}"),
        }
    }

    /// In a word or two, for a table.
    pub fn word(&self) -> &'static str {
        match self {
            Self::Fitted(Some(_)) => "fitted",
            Self::Fitted(None) => "fitted, hardly determined",
            Self::Nothing => "hardly any seen in the recordings",
            Self::Table(_) => "table of materials",
            Self::Beam => "beam formula",
            Self::Convention(_) => "convention",
            Self::Guess(_) => "guess",
        }
    }
}

impl FirstModel {
    /// Why the material that was given is not used, in a sentence; none if it is, or none was
    /// given.
    pub fn unused_material(&self) -> Option<String> {
        let geometry = self.geometry.filter(|it| !it.assumed)?;
        let name = geometry.material.name;
        if matches!(self.origin(ParameterId::Exponent), Origin::Table(_)) {
            return None;
        }
        let table: f64 = geometry.material.exponent();
        let fitted = self.model.value(ParameterId::Exponent).unwrap_or(f64::NAN);
        let why = format!(
            "the recordings give the exponent {}, the table {}",
            four_digits(fitted),
            four_digits(table)
        );
        Some(match geometry.dimensions {
            Some(_) => format!("The exponent of {name} is not used: {why}."),
            None => format!(
                "The material {name} is not used: {why}. Without length, width and height there is no beam to compute either."
            ),
        })
    }

    /// The text of a model file. `recordings` are named as the user named them and have the
    /// columns of `layout`; `path` is where the file will stand.
    pub fn text(
        &self,
        name: &str,
        recordings: &[impl AsRef<Path>],
        layout: &Layout,
        path: &Path,
    ) -> String {
        let version = env!("CARGO_PKG_VERSION");
        let mut text = format!(
            "#:schema {SCHEMA_FILE}\n\
             # (softrig schema model > {SCHEMA_FILE}: then editors complete and check this file.)\n\
             # A first model, written by softrig init {version}.\n\
             #     M θ'' + C θ' + K sign(θ)|θ|^n = g p\n\
             # It serves any rig of second order with one input. What the columns pressure_kpa and\n\
             # angle_deg hold is up to you: the numbers below are in their units.\n#\n"
        );
        for line in next_steps(recordings, path) {
            text += &format!("# {line}\n");
        }
        text += &format!("\nschema = 1\nname = {}\n", Value::from(name));
        if let Some(evidence) = &self.evidence {
            text += &format!("\n# {}\n", fitted_to(evidence, recordings));
            if evidence.explains_little() {
                text += "# It explains little of the motion: see softrig init output.\n";
            }
        }
        if let Some(unused) = self.unused_material() {
            text += &format!("# {}\n", unused.replace(". ", ".\n# "));
        }
        if let Some(geometry) = self.geometry {
            text += &actuator(&geometry, self.evidence.is_some());
        }
        text += "\n[dynamics]\n";
        for (id, what) in ParameterId::BASE.into_iter().zip(WHAT) {
            let key = self.model.row(id).map_or("", |row| row.key);
            let value = self.model.value(id).unwrap_or_default();
            let value = tidy(to_file_units(&self.model, id, value));
            let origin = self.origin(id).sentence(parameter_unit(&self.model, id));
            text += &format!("# {what}; {origin}\n{key} = {}\n", Value::from(value));
        }
        let free: Vec<String> = self
            .free
            .iter()
            .map(|id| format!("\"{}\"", parameter_name(&self.model, *id)))
            .collect();
        text += &format!(
            "\n[fit]\n# What softrig fit and softrig diagnose may move.{}\nfree = [{}]\n",
            if self.free.contains(&ParameterId::Exponent) {
                " Take \"exponent\" out if you know it better."
            } else {
                ""
            },
            free.join(", ")
        );
        let recording = layout.to_toml();
        if !recording.is_empty() {
            text += &format!(
                "\n# The columns of these recordings; flags take precedence.\n{recording}"
            );
        }
        text
    }
}

/// The next steps with the model, a line each.
pub fn next_steps(recordings: &[impl AsRef<Path>], path: &Path) -> Vec<String> {
    let model = word(path);
    let files: Vec<String> = recordings.iter().map(|it| word(it.as_ref())).collect();
    if files.is_empty() {
        vec![
            "Nothing here was measured on your rig. With it on the board, record steps to two or"
                .into(),
            "more levels, and identify the model from those:".into(),
            format!("    softrig upload --port PORT --model {model}"),
            "    softrig record --port PORT --protocol steps -o steps.csv".into(),
            "    softrig init --recording steps.csv -o identified.toml".into(),
        ]
    } else {
        vec![
            "Next, with these recordings or better with more of them:".into(),
            format!(
                "    softrig diagnose --model {model} {} -o repaired.toml --report report.html",
                files.join(" ")
            ),
        ]
    }
}

/// A path as a shell reads it.
fn word(path: &Path) -> String {
    let text = printable_line(&path.display().to_string()).into_owned();
    let plain = |c: char| c.is_alphanumeric() || "/._-+,:@%".contains(c);
    if !text.is_empty() && text.chars().all(plain) {
        text
    } else {
        format!("'{}'", text.replace('\'', r"'\''"))
    }
}

/// To what a model was fitted, and how well it follows.
fn fitted_to(evidence: &Evidence, recordings: &[impl AsRef<Path>]) -> String {
    let of = match recordings {
        [one] => word(one.as_ref()),
        all => format!("{} recordings", all.len()),
    };
    let part = if evidence.subsample {
        "a subsample of "
    } else {
        ""
    };
    let unit = evidence.measurand.unit();
    format!(
        "Fitted to {part}{of}: {} samples, RMS error {}{unit}, of {}{unit} about the mean.",
        evidence.samples,
        four_digits(evidence.rms.to_degrees()),
        four_digits(evidence.about_mean.to_degrees())
    )
}

fn actuator(geometry: &Geometry, fitted: bool) -> String {
    let Some([length, width, height]) = geometry.dimensions else {
        return String::new();
    };
    let mut text = String::from("\n[actuator]\n");
    if geometry.assumed {
        text += "# GUESS: value of the authors' actuator\n";
    }
    if let Some(beam) = beam_stiffness(geometry).filter(|_| fitted) {
        text += &format!(
            "# The beam formula gives {} N/rad^n. The stiffness below is per unit of the inertia\n\
             # that is there by convention, so that the two cannot be compared.\n",
            four_digits(beam)
        );
    }
    text + &format!(
        "material = {}\nlength_m = {}\nwidth_m = {}\nheight_m = {}\n",
        Value::from(geometry.material.name),
        Value::from(length),
        Value::from(width),
        Value::from(height)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::first_model::{authors_actuator, from_geometry};
    use softrig_formats::model_file::ModelFile;

    #[test]
    fn the_text_is_a_model_file_whatever_the_names() {
        let first = from_geometry(authors_actuator().unwrap()).unwrap();
        let path = Path::new("my 'best'\n[dynamics]/m.toml");
        let text = first.text(
            "a \"b\"\n\u{1b}",
            &[Path::new("x\ny = 1\n.csv")],
            &Layout::default(),
            path,
        );
        let file = ModelFile::parse(&text, path).unwrap_or_else(|error| panic!("{error}\n{text}"));
        assert_eq!(file.name, "a \"b\"\n\u{1b}");
        assert_eq!(file.free, first.free);
        assert!((file.model.dynamics().stiffness / 0.094 - 1.0).abs() < 0.01);
        // What is guessed says so.
        assert_eq!(text.matches("GUESS").count(), 4, "{text}");
    }
}
