//! The files that somebody has put on the page, and what can be asked about them.

use std::path::{Path, PathBuf};

use model_core::catalogue::Kind;
use model_core::material::TABLE_I;
use serde::Deserialize;
use serde_json::{Map, Value, json};
use softrig::board_gap::{BoardGap, predicted_runs};
use softrig::diagnose::{Job, Request as Asked, diagnose};
use softrig::estimate::assemble::assemble;
use softrig::estimate::placement::with_tip_load;
use softrig::first_model::{Evidence, Geometry, from_nothing, from_recordings};
use softrig::synth::example::{Hidden, NOISE_DEG, make};
use softrig_formats::bounded::not_text;
use softrig_formats::columns::{self, Columns, Layout, Names, Quantity};
use softrig_formats::error::{InputError, UNKNOWN_COLUMN};
use softrig_formats::formats::overview::Overview;
use softrig_formats::instant::Instant;
use softrig_formats::material_name::named;
use softrig_formats::model_file::{ModelFile, recording_layout};
use softrig_formats::numbers::short;
use softrig_formats::own_effects::OwnEffects;
use softrig_formats::recording::{META_ENDING, Recording, meta_beside, recordings_among, to_csv};
use softrig_formats::terminal::quoted;
use softrig_report::Outputs;
use softrig_report::content::Content;
use softrig_report::gap::gap_figure;
use softrig_report::html::page;
use softrig_report::pictures::recording_figure;
use softrig_report::plot::to_inline_svg;
use softrig_report::provenance::{EFFECTS, FITTED, HELD_OUT, METADATA, MODEL, Provenance, Source};
use softrig_report::terminal::summary;

use crate::board::{boards, protocols};

/// The file of a folder, whose section `[recording]` says where its recordings stand.
const FOLDER_FILE: &str = "softrig.toml";

/// Pieces of the picture of a column.
const PIECES: usize = 64;

/// Rows of a table that are shown.
const FIRST_ROWS: usize = 3;

/// The file of a model that was made here.
const MODEL_FILE: &str = "model.toml";

/// What the page asks.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "ask", rename_all = "snake_case", deny_unknown_fields)]
pub enum Request {
    /// What can be chosen: units, materials, effects of an example.
    Choices,
    /// Takes a file, whose bytes come with the question.
    Put {
        /// Its name, without a folder.
        name: String,
    },
    /// Puts a file away.
    Remove {
        /// Its name.
        name: String,
    },
    /// Puts everything away.
    Clear,
    /// Reads what is there.
    Read {
        /// Which columns the recordings have.
        layout: Said,
    },
    /// Shows the columns of a table as they are, and guesses what they are.
    Look {
        /// The name of the file.
        name: String,
    },
    /// Makes a first model: of the recordings, of material and dimensions, or of both.
    FirstModel {
        /// Which columns the recordings have.
        layout: Said,
        /// Whether the recordings are looked at.
        recordings: bool,
        /// A material of the table; empty if none is known.
        material: String,
        /// Length, width and height (mm), where they are known.
        dimensions_mm: Option<[f64; 3]>,
    },
    /// Diagnoses the model against the recordings.
    Diagnose {
        /// Which columns the recordings have.
        layout: Said,
        /// Recordings that are kept for validation.
        holdout: Vec<String>,
        /// What a model may be off without it mattering (°).
        tolerance_deg: Option<f64>,
        /// Random seed.
        seed: u64,
        /// This day (2026-05-31).
        #[serde(default)]
        date: String,
    },
    /// How far the board's own prediction is off, in recordings before and after an upload.
    Gap {
        /// Recordings made before it.
        before: Vec<String>,
        /// Recordings made after it.
        after: Vec<String>,
    },
    /// Makes the files of an example.
    Example {
        /// Random seed.
        seed: u64,
        /// The hidden effect; drawn if none is named.
        effect: Option<String>,
    },
}

/// What was said about columns and units, as the page's fields have it; empty where nothing was.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Said {
    columns: [String; 3],
    units: [String; 3],
    air_kpa: Option<f64>,
    angle_zero_deg: Option<f64>,
    flip_angle: bool,
    exchange: bool,
}

impl Said {
    fn layout(&self) -> Result<Layout, InputError> {
        let refused = |why| InputError::new(why, "correct it among the columns and units");
        let mut names = Names::default();
        let mut columns = Columns {
            angle_zero_deg: self.angle_zero_deg,
            flip_angle: self.flip_angle,
            exchange: self.exchange,
            ..Columns::default()
        };
        for (quantity, (column, unit)) in Quantity::ALL
            .into_iter()
            .zip(self.columns.iter().zip(&self.units))
        {
            if !column.trim().is_empty() {
                names.set(quantity.key(), column.trim()).map_err(refused)?;
            }
            if !unit.is_empty() {
                columns.say_unit(quantity.key(), unit).map_err(refused)?;
            }
        }
        if let Some(air) = self.air_kpa {
            columns.air_kpa = Some(columns::air(air).map_err(refused)?);
        }
        Ok(Layout {
            names,
            columns,
            ..Layout::default()
        })
    }
}

/// The flags of `softrig` that say the same.
fn flags(layout: &Layout) -> String {
    let named: Vec<String> = Quantity::ALL
        .into_iter()
        .filter_map(|it| Some(format!("{}={}", it.key(), layout.names.said(it)?)))
        .collect();
    let mut flags = String::new();
    if !named.is_empty() {
        flags += &format!(" --columns {}", quoted(&named.join(",")));
    }
    let units = layout.columns.flags();
    if !units.is_empty() {
        flags += &format!(" {units}");
    }
    flags
}

/// A file.
#[derive(Clone, Debug)]
struct Held {
    path: PathBuf,
    bytes: Vec<u8>,
}

impl Held {
    fn name(&self) -> String {
        self.path.display().to_string()
    }

    fn text(&self) -> Result<&str, InputError> {
        std::str::from_utf8(&self.bytes).map_err(|_| not_text(&self.path))
    }

    fn source(&self, role: &'static str) -> Source {
        Source::of(role, self.name(), &self.bytes)
    }
}

/// A fault, as the page shows it.
#[derive(Debug)]
pub struct Fault(Box<InputError>);

impl From<InputError> for Fault {
    fn from(error: InputError) -> Self {
        Self(Box::new(error))
    }
}

impl Fault {
    /// Its sentence, its place, and how the columns would be read if their names mean what they
    /// seem to.
    pub fn to_json(&self) -> Value {
        let Self(error) = self;
        json!({
            "text": error.to_string(),
            "file": error.file,
            "line": error.line,
            "column": error.column,
            "found": error.found,
            "advice": error.advice,
            "suggestion": error.suggestion.as_ref().and_then(|it| fields(&it.columns, &it.units)),
        })
    }
}

/// What the page's fields would have for these flags.
fn fields(columns: &str, units: &str) -> Option<Value> {
    let names = Names::parse(columns).ok()?;
    let units = Columns::of_units(units).unwrap_or_default();
    let columns = Quantity::ALL.map(|of| names.said(of).unwrap_or_default().to_owned());
    // What nothing in the header looks like, nobody but the user knows.
    let is_whole = columns.iter().all(|column| column != UNKNOWN_COLUMN);
    is_whole.then(|| json!({ "columns": columns, "units": units_of(&units) }))
}

/// Units as the page's fields have them; empty where none is said.
fn units_of(columns: &Columns) -> [String; 3] {
    Quantity::ALL.map(|of| columns.written(of))
}

/// What a file on the desk is: told by its name, and of two texts in TOML by what is in them.
fn is_of_effects(text: &str, path: &Path) -> bool {
    ModelFile::parse(text, path).is_err() && OwnEffects::parse(text, path).is_ok()
}

/// The files, and the answers.
#[derive(Clone, Debug, Default)]
pub struct Desk {
    model: Option<Held>,
    folder: Option<Held>,
    effects: Option<Held>,
    recordings: Vec<Held>,
    meta: Vec<Held>,
}

/// The model, and the recordings in the layout that was said or that it gives.
struct Everything {
    file: ModelFile,
    fitted: Vec<Recording>,
    held_out: Vec<Recording>,
}

impl Desk {
    /// Answers a question; `bytes` are those of the file that it brings.
    ///
    /// # Errors
    ///
    /// Faults of the files, with place and remedy, as the command names them.
    pub fn answer(&mut self, request: Request, bytes: Vec<u8>, job: &Job) -> Result<Value, Fault> {
        softrig_importers::install();
        Ok(match request {
            Request::Choices => choices(),
            Request::Put { name } => {
                let path = PathBuf::from(name);
                self.put(Held { path, bytes });
                Value::Null
            }
            Request::Remove { name } => {
                self.remove(Path::new(&name));
                Value::Null
            }
            Request::Clear => {
                *self = Self::default();
                Value::Null
            }
            Request::Read { layout } => self.read(&layout.layout()?)?,
            Request::Look { name } => self.look(Path::new(&name)),
            Request::FirstModel {
                layout,
                recordings,
                material,
                dimensions_mm,
            } => self.first_model(&layout.layout()?, recordings, &material, dimensions_mm)?,
            Request::Diagnose {
                layout,
                holdout,
                tolerance_deg,
                seed,
                date,
            } => self.diagnose(
                &layout.layout()?,
                &holdout,
                tolerance_deg,
                (seed, date),
                job,
            )?,
            Request::Gap { before, after } => self.gap(&before, &after)?,
            Request::Example { seed, effect } => example(seed, effect.as_deref())?,
        })
    }

    fn put(&mut self, held: Held) {
        let name = held.name();
        self.remove(&held.path);
        if name.ends_with(META_ENDING) {
            self.meta.push(held);
        } else if name == FOLDER_FILE {
            self.folder = Some(held);
        } else if Path::new(&name).extension().is_some_and(|it| it == "toml") {
            match held.text().map(|text| is_of_effects(text, &held.path)) {
                Ok(true) => self.effects = Some(held),
                _ => self.model = Some(held),
            }
        } else {
            self.recordings.push(held);
        }
    }

    fn remove(&mut self, path: &Path) {
        let is_other = |held: &Held| held.path != path;
        self.recordings.retain(is_other);
        self.meta.retain(is_other);
        self.model = self.model.take().filter(is_other);
        self.folder = self.folder.take().filter(is_other);
        self.effects = self.effects.take().filter(is_other);
    }

    fn meta_of(&self, recording: &Held) -> Option<&Held> {
        let beside = meta_beside(&recording.path);
        self.meta.iter().find(|held| held.path == beside)
    }

    fn recording(
        &self,
        held: &Held,
        layout: &Layout,
    ) -> Result<(Recording, Vec<String>), InputError> {
        recordings_among(std::slice::from_ref(&held.path), |_| ())?;
        let meta = self.meta_of(held).map(Held::text).transpose()?;
        let (recording, warnings) = Recording::of_file(&held.bytes, meta, &held.path, layout)?;
        let warnings = recording.remarks(warnings);
        Ok((recording, warnings))
    }

    fn file(&self) -> Result<Option<ModelFile>, InputError> {
        let parse = |held: &Held| ModelFile::parse(held.text()?, &held.path);
        self.model.as_ref().map(parse).transpose()
    }

    /// Where the recordings stand in their files: as was said, then as the model has it, then as
    /// the folder's file has it.
    fn layout(&self, said: &Layout, model: Option<&ModelFile>) -> Result<Layout, InputError> {
        let layout = model.map_or_else(|| said.clone(), |file| said.or(&file.recording));
        Ok(match &self.folder {
            Some(held) => layout.or(&recording_layout(held.text()?, &held.path)?),
            None => layout,
        })
    }

    /// The columns of a table, with pictures, and a guess; nothing of a file that is none.
    fn look(&self, path: &Path) -> Value {
        let held = self.recordings.iter().find(|held| held.path == path);
        let Some(Ok(all)) = held.map(|held| Overview::of_file(&held.bytes, path)) else {
            return Value::Null;
        };
        let column = |at: usize| {
            let first = all.rows.iter().take(FIRST_ROWS);
            json!({
                "called": all.called(at),
                "name": all.names[at],
                "first": first.map(|row| row[at].as_str()).collect::<Vec<_>>(),
                "course": all.course(at, PIECES),
            })
        };
        let guess = all.guess();
        json!({
            "name": path.display().to_string(),
            "columns": (0..all.names.len()).map(column).collect::<Vec<_>>(),
            "guess": fields(&guess.columns, &guess.units),
        })
    }

    /// Everything that is there, with its faults: one broken file does not hide the others.
    fn read(&self, layout: &Layout) -> Result<Value, InputError> {
        let model = self.model.as_ref().map(|held| {
            let mut about = Map::from_iter([("name".to_owned(), json!(held.name()))]);
            match self.file() {
                Ok(Some(file)) => {
                    about.insert("title".into(), json!(file.name));
                    about.insert("warnings".into(), json!(file.warnings));
                    about.insert("text".into(), json!(file.text()));
                }
                Ok(None) => {}
                Err(error) => {
                    about.insert("fault".into(), Fault::from(error).to_json());
                }
            }
            Value::Object(about)
        });
        let effects = self.effects.as_ref().map(|held| {
            let own = held
                .text()
                .and_then(|text| OwnEffects::parse(text, &held.path));
            json!({
                "name": held.name(),
                "kinds": own.map(|own| own.kinds.iter().map(|it| it.name()).collect::<Vec<_>>())
                    .unwrap_or_default(),
            })
        });
        let of_model = self.file().ok().flatten();
        let layout = self.layout(layout, of_model.as_ref())?;
        let recordings: Vec<Value> = self
            .recordings
            .iter()
            .map(|held| match self.recording(held, &layout) {
                Ok((recording, warnings)) => shown(held, &recording, &warnings, &layout),
                Err(error) => {
                    json!({ "name": held.name(), "fault": Fault::from(error).to_json() })
                }
            })
            .collect();
        let has_recording = |meta: &Held| {
            let mut paths = self.recordings.iter();
            paths.any(|it| meta_beside(&it.path) == meta.path)
        };
        let alone = self.meta.iter().filter(|meta| !has_recording(meta));
        Ok(json!({
            "model": model,
            "folder": self.folder.as_ref().map(Held::name),
            "section": layout.to_toml(),
            "effects": effects,
            "recordings": recordings,
            "meta": self.meta.iter().map(Held::name).collect::<Vec<_>>(),
            "meta_alone": alone.map(Held::name).collect::<Vec<_>>(),
        }))
    }

    fn gap(&self, before: &[String], after: &[String]) -> Result<Value, InputError> {
        let runs = |names: &[String]| {
            let held = self.recordings.iter();
            let named = held.filter(|held| names.contains(&held.name()));
            let read = named.map(|held| Ok(self.recording(held, &Layout::default())?.0));
            let read: Vec<Recording> = read.collect::<Result<_, InputError>>()?;
            predicted_runs(&read).map(|(runs, _)| runs)
        };
        let (before, after) = (runs(before)?, runs(after)?);
        let gap = BoardGap::of(&before, &after);
        let figure = gap_figure(&before, &after, &gap);
        Ok(json!({
            "sentence": gap.sentence,
            "tracking": gap.tracking,
            "before_deg": gap.before.rms_deg,
            "after_deg": gap.after.map(|it| it.rms_deg),
            "figure": to_inline_svg(&figure, "The gap before and after the upload"),
        }))
    }

    fn first_model(
        &self,
        layout: &Layout,
        recordings: bool,
        material: &str,
        dimensions_mm: Option<[f64; 3]>,
    ) -> Result<Value, InputError> {
        let geometry = named(material).map(|material| Geometry {
            material,
            dimensions: dimensions_mm.map(|all| all.map(|mm| mm / 1e3)),
            assumed: false,
        });
        let layout = &self.layout(layout, None)?;
        let held: &[Held] = if recordings { &self.recordings } else { &[] };
        let paths: Vec<&Path> = held.iter().map(|held| held.path.as_path()).collect();
        let mut warnings = Vec::new();
        let first = if held.is_empty() {
            from_nothing(geometry)?
        } else {
            let read = held.iter().map(|held| self.recording(held, layout));
            let read: Vec<Recording> = read
                .map(|it| Ok(it?.0))
                .collect::<Result<_, InputError>>()?;
            let assembled = assemble(&read, &[])?;
            warnings.extend(assembled.concerns.iter().map(ToString::to_string));
            from_recordings(&assembled.data, geometry)?
        };
        let path = Path::new(MODEL_FILE);
        let text = first.text("model", &paths, layout, path);
        // What is handed out is read again before it is.
        ModelFile::parse(&text, path)?;
        warnings.extend(first.unused_material());
        Ok(json!({
            "model": text,
            "warnings": warnings,
            "rmse": first.evidence.as_ref().map(|it| it.measurand.value(it.rms)),
            "explains_little": first.evidence.as_ref().is_some_and(Evidence::explains_little),
        }))
    }

    fn everything(
        &self,
        layout: &Layout,
        holdout: &[String],
        tolerance_deg: Option<f64>,
    ) -> Result<Everything, InputError> {
        let file = self.file()?.ok_or_else(|| {
            InputError::new("there is no model", "make a first one, or add a model file")
        })?;
        let layout = self.layout(layout, Some(&file))?;
        let (mut fitted, mut held_out) = (Vec::new(), Vec::new());
        for held in &self.recordings {
            let (mut recording, _) = self.recording(held, &layout)?;
            if tolerance_deg.is_some() {
                recording.meta.tolerance_deg = tolerance_deg;
            }
            let is_held_out = holdout.contains(&held.name());
            if is_held_out {
                &mut held_out
            } else {
                &mut fitted
            }
            .push(recording);
        }
        Ok(Everything {
            file: with_tip_load(file, &fitted),
            fitted,
            held_out,
        })
    }

    fn diagnose(
        &self,
        layout: &Layout,
        holdout: &[String],
        tolerance_deg: Option<f64>,
        (seed, date): (u64, String),
        job: &Job,
    ) -> Result<Value, InputError> {
        let clock = Instant::now();
        let Everything {
            file,
            fitted,
            held_out,
        } = self.everything(layout, holdout, tolerance_deg)?;
        let own = match &self.effects {
            Some(held) => {
                let own = OwnEffects::parse(held.text()?, &held.path)?;
                own.check_beside(&file.model)?;
                Some(own)
            }
            None => None,
        };
        let request = Asked {
            file: &file,
            recordings: &fitted,
            holdout: &held_out,
            start_from: &[],
            own: own.as_ref(),
            formulas: true,
            without: &[],
            seed,
        };
        let diagnosis = diagnose(&request, job)?;
        let seconds = clock.elapsed().as_secs_f64();
        let content = Content::of(&request, &diagnosis);
        let provenance = Provenance {
            date,
            ..self.provenance(layout, holdout, tolerance_deg, seed)
        };
        let defect = |error: &dyn std::fmt::Display| {
            InputError::new(error.to_string(), "report this as a defect of softrig")
        };
        let report = page(&request, &diagnosis, &content, &provenance, seconds)
            .map_err(|error| defect(&error))?;
        let verdict = serde_json::to_string_pretty(&diagnosis.verdict(&request, seconds))
            .map_err(|error| defect(&error))?;
        let next = diagnosis.proposals.first().map(|(run, _)| {
            json!({
                "title": run.protocol.title,
                "setup": run.protocol.setup.instructions(),
                "seconds": f64::from(run.protocol.total_ms()) / 1000.0,
                "decides": run.decides,
                "protocol": run.protocol.to_text(),
            })
        });
        Ok(json!({
            "answer": content.answer,
            "sentence": content.sentence,
            "summary": summary(&content, &Outputs::default(), seed, seconds),
            "verdict": verdict + "\n",
            "report": report,
            "model": diagnosis.model_text(&file),
            "next": next,
        }))
    }

    /// How the report was made: the command that does the same, and the hashes of the files.
    fn provenance(
        &self,
        layout: &Layout,
        holdout: &[String],
        tolerance_deg: Option<f64>,
        seed: u64,
    ) -> Provenance {
        let is_held_out = |held: &&Held| holdout.contains(&held.name());
        let (held_out, fitted): (Vec<&Held>, Vec<&Held>) =
            self.recordings.iter().partition(is_held_out);
        let model = self.model.iter().map(|held| held.source(MODEL));
        let effects = self.effects.iter().map(|held| held.source(EFFECTS));
        let of = |role, all: &[&Held]| -> Vec<Source> {
            let with_meta = |held: &&Held| {
                let meta = self.meta_of(held).map(|meta| meta.source(METADATA));
                [held.source(role)].into_iter().chain(meta)
            };
            all.iter().flat_map(with_meta).collect()
        };
        let files = model.chain(effects);
        let files = files
            .chain(of(FITTED, &fitted))
            .chain(of(HELD_OUT, &held_out));
        let names = |all: &[&Held]| -> String {
            let names = all.iter().map(|held| quoted(&held.name()));
            names.fold(String::new(), |before, name| before + " " + &name)
        };
        let mut command = "softrig diagnose".to_owned();
        for (flag, held) in [("--model", &self.model), ("--effects", &self.effects)] {
            if let Some(held) = held {
                command += &format!(" {flag} {}", quoted(&held.name()));
            }
        }
        command += &names(&fitted);
        if !held_out.is_empty() {
            command += &format!(" --holdout{}", names(&held_out));
        }
        command += &flags(layout);
        if let Some(tolerance) = tolerance_deg {
            command += &format!(" --tolerance {tolerance}");
        }
        Provenance {
            command: format!("{command} --seed {seed} --report report.html"),
            version: env!("CARGO_PKG_VERSION"),
            date: String::new(),
            files: files.collect(),
        }
    }
}

/// The files of an example, and what it hides.
fn example(seed: u64, effect: Option<&str>) -> Result<Value, InputError> {
    let example = make(Hidden::named(effect)?, NOISE_DEG, seed)?;
    let mut files = vec![json!({ "name": MODEL_FILE, "text": example.model })];
    for (file, recording, meta) in &example.recordings {
        let beside = meta_beside(Path::new(file));
        files.push(json!({ "name": file, "text": to_csv(recording, &[]) }));
        files.push(json!({ "name": beside, "text": meta }));
    }
    let truth = ModelFile::parse(&example.truth, Path::new("truth.toml"))?;
    let hidden: Vec<&str> = truth.model.effects().map(|it| it.kind().name()).collect();
    Ok(json!({ "files": files, "hidden": hidden }))
}

/// What the page shows of a recording.
fn shown(held: &Held, recording: &Recording, warnings: &[String], layout: &Layout) -> Value {
    let name = held.name();
    let columns = Quantity::ALL.map(|of| layout.names.of(of));
    json!({
        "name": name,
        "samples": recording.len(),
        "seconds": short(recording.duration()),
        "interval_ms": short(1e3 * recording.interval()),
        "columns": columns,
        "units": units_of(&recording.columns),
        "others": recording.extra.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(),
        "runs": recording.meta.segment.len(),
        "simulated": recording.meta.simulated,
        "warnings": warnings,
        "picture": to_inline_svg(&recording_figure(recording), &format!("{name}: angle and pressure over time")),
    })
}

fn choices() -> Value {
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "boards": boards(),
        "protocols": protocols(),
        "quantities": Quantity::ALL.map(|of| json!({
            "key": of.key(),
            "column": of.column(),
            "units": of.units().split(", ").collect::<Vec<_>>(),
        })),
        "atmosphere_kpa": columns::ATMOSPHERE_KPA,
        "materials": TABLE_I.iter().map(|it| it.name).collect::<Vec<_>>(),
        "effects": Kind::NAMES.iter().map(|kind| kind.name()).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(desk: &mut Desk, question: &Value) -> Result<Value, Value> {
        let request = serde_json::from_value(question.clone()).unwrap();
        desk.answer(request, Vec::new(), &Job::default())
            .map_err(|fault| fault.to_json())
    }

    fn put(desk: &mut Desk, name: &str, text: &str) {
        let name = name.to_owned();
        desk.answer(Request::Put { name }, text.into(), &Job::default())
            .unwrap();
    }

    /// The desk with some files of an example that hides friction.
    fn with_example(wanted: &[&str]) -> Desk {
        let mut desk = Desk::default();
        let made = json!({ "ask": "example", "seed": 4, "effect": "coulomb_friction" });
        let made = asked(&mut desk, &made).unwrap();
        assert_eq!(made["hidden"], json!(["coulomb_friction"]));
        for file in made["files"].as_array().unwrap() {
            let name = file["name"].as_str().unwrap();
            if wanted.iter().any(|it| name.starts_with(it)) {
                put(&mut desk, name, file["text"].as_str().unwrap());
            }
        }
        desk
    }

    #[test]
    fn a_file_is_what_is_in_it() {
        let mut desk = with_example(&["model", "step60_1"]);
        put(
            &mut desk,
            "mine.toml",
            "schema = 1\n[[effect]]\nkind = \"custom\"\nname = \"lift\"\nforce = \"a*th\"\n[effect.parameters]\na = { value = 0.9, min = 0.0, max = 5.0, unit = \"N\" }\n",
        );
        put(&mut desk, "lost.meta.toml", "");
        let read = asked(&mut desk, &json!({ "ask": "read", "layout": {} })).unwrap();
        assert_eq!(read["model"]["name"], "model.toml");
        assert_eq!(read["effects"]["name"], "mine.toml", "{read}");
        assert_eq!(read["recordings"][0]["name"], "step60_1.csv");
        assert_eq!(read["recordings"][0]["simulated"], true);
        assert_eq!(read["meta_alone"], json!(["lost.meta.toml"]));
        asked(&mut desk, &json!({ "ask": "remove", "name": "model.toml" })).unwrap();
        let read = asked(&mut desk, &json!({ "ask": "read", "layout": {} })).unwrap();
        assert_eq!(read["model"], Value::Null);
        assert_eq!(read["effects"]["name"], "mine.toml");
    }

    #[test]
    fn columns_are_suggested_and_units_are_as_they_are_said() {
        let mut desk = Desk::default();
        put(
            &mut desk,
            "run.csv",
            "t_ms,p_psi,theta\n0,1,2\n10,2,3\n20,3,4\n",
        );
        put(
            &mut desk,
            "broken.csv",
            "time_s,pressure_kpa,angle_deg\n0,1,2\n0.01,x,2\n",
        );
        let read = asked(&mut desk, &json!({ "ask": "read", "layout": {} })).unwrap();
        let [run, broken] = [0, 1].map(|at| &read["recordings"][at]["fault"]);
        assert_eq!(
            run["suggestion"],
            json!({ "columns": ["t_ms", "p_psi", "theta"], "units": ["ms", "psi", ""] })
        );
        let look = asked(&mut desk, &json!({ "ask": "look", "name": "run.csv" })).unwrap();
        assert_eq!(look["guess"], run["suggestion"]);
        assert_eq!(look["columns"][1]["first"], json!(["1", "2", "3"]));
        assert_eq!(look["columns"][1]["course"], json!([0.0, 0.5, 1.0]));
        assert_eq!(broken["line"], 3);
        assert_eq!(broken["column"], "pressure_kpa");
        let layout =
            json!({ "columns": ["t_ms", "p_psi", "theta"], "units": ["ms", "bar", "rad"] });
        let read = asked(&mut desk, &json!({ "ask": "read", "layout": layout })).unwrap();
        assert_eq!(read["recordings"][0]["units"], json!(["ms", "bar", "rad"]));
        assert_eq!(read["recordings"][0]["interval_ms"], "10.0");
        let wrong = json!({ "ask": "read", "layout": { "air_kpa": 700.0 } });
        let fault = asked(&mut desk, &wrong).unwrap_err();
        assert!(
            fault["text"].as_str().unwrap().contains("110 kPa"),
            "{fault}"
        );
    }

    #[test]
    fn a_table_without_names_is_read_as_it_is_said_and_by_the_file_of_its_folder() {
        let mut desk = Desk::default();
        let row = |k: u32| format!("{}\t{}\n", 100 * k, k % 7);
        put(&mut desk, "log.txt", &(0..50).map(row).collect::<String>());
        let look = asked(&mut desk, &json!({ "ask": "look", "name": "log.txt" })).unwrap();
        assert_eq!(look["guess"]["columns"], json!(["#1", "none", "#2"]));
        let layout = json!({ "columns": ["#0", "#1", "#2"], "units": ["s*50", "kpa*100", ""] });
        let read = asked(&mut desk, &json!({ "ask": "read", "layout": layout })).unwrap();
        let run = &read["recordings"][0];
        assert_eq!(run["interval_ms"], "20.0", "{run}");
        assert_eq!(run["units"], json!(["s*50", "kpa*100", ""]));
        // What was said is saved, and a desk with that file needs no more.
        let section = format!("schema = 1\n{}", read["section"].as_str().unwrap());
        put(&mut desk, FOLDER_FILE, &section);
        let again = asked(&mut desk, &json!({ "ask": "read", "layout": {} })).unwrap();
        assert_eq!(again["folder"], FOLDER_FILE);
        assert_eq!(&again["recordings"][0], run);
        put(&mut desk, "picture.parquet", "PAR1");
        let look = json!({ "ask": "look", "name": "picture.parquet" });
        assert_eq!(asked(&mut desk, &look).unwrap(), Value::Null);
    }

    #[test]
    fn a_first_model_needs_no_recording_and_says_what_it_follows() {
        let beam = |recordings| {
            json!({
                "ask": "first_model", "layout": {}, "recordings": recordings,
                "material": "Dragon Skin 20", "dimensions_mm": [94.0, 30.0, 24.0],
            })
        };
        let first = asked(&mut Desk::default(), &beam(false)).unwrap();
        assert_eq!(first["rmse"], Value::Null);
        let mut desk = with_example(&["step60_1", "step90_1"]);
        let first = asked(&mut desk, &beam(true)).unwrap();
        let rmse = first["rmse"].as_str().unwrap();
        let rmse: f64 = rmse.trim_end_matches('°').parse().unwrap();
        assert!((0.1..5.0).contains(&rmse), "{rmse}");
        assert!(first["model"].as_str().unwrap().contains("step90_1.csv"));
    }

    #[test]
    fn a_diagnosis_that_is_stopped_says_what_it_is_as_far_as_it_was_tried() {
        let mut desk = with_example(&["model", "step30_1", "step60_1", "step90_1"]);
        let job = Job::default().watched_by(|job| {
            if job.state().fits > 0 {
                job.allowance.enough();
            }
        });
        let question = json!({
            "ask": "diagnose", "layout": { "units": ["", "kpa", ""] },
            "holdout": ["step60_1.csv"], "tolerance_deg": 0.25, "seed": 7,
        });
        let request = serde_json::from_value(question).unwrap();
        let answer = desk.answer(request, Vec::new(), &job).unwrap();
        let verdict: Value = serde_json::from_str(answer["verdict"].as_str().unwrap()).unwrap();
        assert_eq!(verdict["ended"], "budget");
        assert_eq!(verdict["recordings"][2], "step60_1.csv");
        let report = answer["report"].as_str().unwrap();
        assert!(report.contains(
            "softrig diagnose --model model.toml step30_1.csv step90_1.csv --holdout step60_1.csv \
             --units pressure=kpa --tolerance 0.25 --seed 7 --report report.html"
        ));
    }
}
