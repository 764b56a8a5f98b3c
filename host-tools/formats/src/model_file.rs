//! Model files: reading, checking, and writing back without losing a comment.
//!
//! A model is a TOML file that people edit by hand, so every fault is reported
//! with its line and column, and a repaired model is the user's own file with
//! the numbers changed and the effect added at the end.

use std::path::{Path, PathBuf};

use model_core::actuator::{InvalidModel, MAX_EFFECTS, Model, ParameterId};
use model_core::catalogue::{Effect, Kind};
use model_core::dynamics::Dynamics;
use model_core::effects::table::{self, MAX_NODES, MIN_NODES, Variable};
use model_core::effects::{Parameter, Unit};
use model_core::ludwick::{Beam, Ludwick, SecondMoment};
use model_core::power::Exact;
use toml_edit::{Array, ArrayOfTables, DocumentMut, Item, Table, Value};

use crate::columns::{self, Layout, Scale};
use crate::error::{InputError, line_of};
use crate::material_name::{like, named};
use crate::numbers::tidy;
use crate::own_effects::{self, Role};
use crate::ranges::Range;
use crate::toml_reader::Reader;

/// The schema number that this version reads and writes.
pub(crate) const SCHEMA: i64 = 1;

/// The first words in the header of every file that `softrig export` writes: a model in another
/// language, which it may write again.
pub const WRITTEN_BY_EXPORT: &str = "Written by `softrig export`";

/// The free parameters of a refit if the file names none.
const FREE_BY_DEFAULT: [ParameterId; 3] = [
    ParameterId::Damping,
    ParameterId::Stiffness,
    ParameterId::InputGain,
];

/// The base parameters with their rows.
pub(crate) fn base() -> impl Iterator<Item = (ParameterId, &'static Parameter)> {
    ParameterId::BASE
        .into_iter()
        .zip(Dynamics::<()>::PARAMETERS)
}

/// A model with what its file says around it.
#[derive(Clone, Debug)]
pub struct ModelFile {
    /// Name for reports.
    pub name: String,
    /// Where it was read from.
    pub path: PathBuf,
    /// The validated model, in SI units.
    pub model: Model<f64>,
    /// The free parameters of a refit.
    pub free: Vec<ParameterId>,
    /// Ranges (SI units) of the free base parameters whose accuracy the file gives; the others may
    /// have any value.
    pub within: Vec<KnownRange>,
    /// The material section, if there is one.
    pub actuator: Option<ActuatorSection>,
    /// The layout of this rig's recordings.
    pub recording: Layout,
    /// Warnings that change no number, each with its place and advice.
    pub warnings: Vec<String>,
    text: String,
}

/// The range in which a base parameter is known to lie, in SI units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownRange {
    /// The parameter.
    pub id: ParameterId,
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
}

/// Material and dimensions of the actuator.
#[derive(Clone, Debug, PartialEq)]
pub struct ActuatorSection {
    /// Name of the material as in `softrig materials list`.
    pub material: String,
    /// Length of the bending part (m).
    pub length_m: f64,
    /// Width of the section (m).
    pub width_m: f64,
    /// Height of the section (m).
    pub height_m: f64,
}

impl ModelFile {
    /// Reads and validates a model.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let text = crate::bounded::read_text(path)?;
        Self::parse(&text, path)
    }

    /// Parses the text of a model file; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Like [`ModelFile::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        ModelReader {
            toml: Reader { text, path },
        }
        .read()
    }

    /// The name of a parameter as `[fit] free` and reports spell it.
    pub fn parameter_name(&self, id: ParameterId) -> String {
        parameter_name(&self.model, id)
    }

    /// The text as it was read.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// The text of the file with `model` in place of its own: numbers are
    /// replaced, effects that the file lacks are appended, everything else
    /// stays as it was written.
    pub fn text_with(&self, model: &Model<f64>, comment: &str) -> String {
        // The text parsed once already.
        let mut document: DocumentMut = self.text.parse().unwrap_or_default();
        let dynamics = document["dynamics"].or_insert(Item::Table(Table::new()));
        let mut is_moved = false;
        for (id, row) in base() {
            let shown = |of: &Model<f64>| Some(tidy(row.unit.from_si(of.value(id)?)));
            if let Some(value) = shown(model) {
                if shown(&self.model) != Some(value) {
                    forget_origin(dynamics, row.key);
                    is_moved = true;
                }
                replace_number(&mut dynamics[row.key], value);
            }
        }
        if is_moved {
            forget_first_fit(dynamics);
        }
        let list = document["effect"].or_insert(Item::ArrayOfTables(ArrayOfTables::new()));
        if let Some(tables) = list.as_array_of_tables_mut() {
            for (slot, effect) in model.effects().enumerate() {
                if slot >= tables.len() {
                    let mut table = match &effect {
                        Effect::Custom(custom) => own_effects::section(custom),
                        _ => Table::new(),
                    };
                    table.decor_mut().set_prefix(format!("\n{comment}"));
                    if !table.contains_key("kind") {
                        table["kind"] = toml_edit::value(effect.kind().name());
                    }
                    tables.push(table);
                }
                let Some(table) = tables.get_mut(slot) else {
                    continue;
                };
                match &effect {
                    Effect::Table(numbers) => write_table(table, numbers),
                    Effect::Custom(custom) => own_effects::write_values(table, custom),
                    _ => {
                        for (row, value) in effect.parameters().iter().zip(effect.values()) {
                            replace_number(&mut table[row.key], tidy(row.unit.from_si(value)));
                        }
                    }
                }
            }
        }
        if model.effects().next().is_none() {
            document.remove("effect");
        }
        document.to_string()
    }
}

/// Writes a table into its section: the forces anew; what is right already stays as it is.
fn write_table(section: &mut Table, numbers: &table::Table<f64>) {
    let of = numbers.of();
    if section.get("of").and_then(Item::as_str) != Some(of.name()) {
        section["of"] = toml_edit::value(of.name());
    }
    let si =
        |item: &Item| item_numbers(item).map(|list| list.iter().map(|x| node_si(of, *x)).collect());
    let nodes: Option<Vec<f32>> = section.get("nodes").and_then(si);
    if nodes.as_deref() != Some(numbers.nodes()) {
        let shown = numbers.nodes().iter().map(|&node| node_in_file(of, node));
        let mut value = Value::from(shown.collect::<Array>());
        value
            .decor_mut()
            .set_suffix(format!("   # {}", of.unit().symbol()));
        section["nodes"] = Item::Value(value);
    }
    let forces = numbers.forces().iter().map(|&force| tidy(force));
    let present = section.get_mut("forces_n").and_then(Item::as_array_mut);
    match present {
        Some(list) if list.len() == numbers.forces().len() => {
            for (value, force) in list.iter_mut().zip(forces) {
                let decor = value.decor().clone();
                *value = Value::from(force);
                *value.decor_mut() = decor;
            }
        }
        _ => section["forces_n"] = toml_edit::value(forces.collect::<Array>()),
    }
}

/// The numbers of a list; none if it is anything else.
/// The layout of recordings in the section `[recording]` of any TOML file, empty where it has
/// none; `path` is only named in messages.
///
/// # Errors
///
/// Names file, line, column and remedy.
pub fn recording_layout(text: &str, path: &Path) -> Result<Layout, InputError> {
    let reader = ModelReader {
        toml: Reader { text, path },
    };
    let document = reader.toml.parse()?;
    reader.recording(document.as_table())
}

/// Scales by their quantities, each of two points.
fn scales(item: &Item) -> Option<Vec<(String, Scale)>> {
    let table = item.as_table_like()?;
    table
        .iter()
        .map(|(key, points)| {
            let points = points.as_array()?;
            let point = |at: usize| -> Option<[f64; 2]> {
                let point = points.get(at)?.as_array()?;
                Some([value_number(point.get(0)?)?, value_number(point.get(1)?)?])
            };
            let scale = Scale::through([point(0)?, point(1)?])?;
            (points.len() == 2).then(|| (key.to_owned(), scale))
        })
        .collect()
}

fn item_numbers(item: &Item) -> Option<Vec<f64>> {
    item.as_array()?.iter().map(value_number).collect()
}

fn value_number(value: &Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// A node in the unit of files in the board's single precision and SI units.
fn node_si(of: Variable, node: f64) -> f32 {
    #[allow(clippy::cast_possible_truncation)] // Rounding is the point.
    let node = of.unit().to_si(node) as f32;
    node
}

/// The number with the fewest digits that is read as this node.
pub fn node_in_file(of: Variable, node: f32) -> f64 {
    let value = of.unit().from_si(f64::from(node));
    #[allow(clippy::float_cmp)] // To the bit is the point.
    let shown = (0..17)
        .filter_map(|digits| format!("{value:.digits$e}").parse().ok())
        .find(|&shown| node_si(of, shown) == node);
    shown.unwrap_or(value)
}

/// The name of a parameter as `[fit] free` and reports spell it.
pub fn parameter_name(model: &Model<f64>, id: ParameterId) -> String {
    match id {
        ParameterId::Effect { slot, .. } => model
            .effects()
            .nth(slot)
            .zip(model.row(id))
            .map_or_else(String::new, |(effect, row)| {
                format!("{}.{}", effect.kind().name(), row.key)
            }),
        base => base.base_name().unwrap_or_default().to_owned(),
    }
}

/// All parameters of a model with their keys in files, those of an effect after its kind:
/// `stiffness_n_per_rad_n`, `coulomb_friction.force_n`.
pub fn parameters(model: &Model<f64>) -> Vec<(ParameterId, String)> {
    let base = base().map(|(id, row)| (id, row.key.to_owned()));
    let effects = model.effects().enumerate().flat_map(|(slot, effect)| {
        let rows = effect.parameters().iter().enumerate();
        rows.map(move |(parameter, _)| ParameterId::Effect { slot, parameter })
            .collect::<Vec<_>>()
    });
    base.chain(effects.map(|id| (id, parameter_name(model, id))))
        .collect()
}

/// Converts a parameter from the unit of files to SI units.
pub fn from_file_units(model: &Model<f64>, id: ParameterId, value: f64) -> f64 {
    model.row(id).map_or(value, |row| row.unit.to_si(value))
}

/// The unit in which a parameter is shown.
pub fn parameter_unit(model: &Model<f64>, id: ParameterId) -> &'static str {
    model.row(id).map_or("", |row| row.unit.symbol())
}

/// Converts a parameter from SI units to the unit of files.
pub fn to_file_units(model: &Model<f64>, id: ParameterId, value: f64) -> f64 {
    model.row(id).map_or(value, |row| row.unit.from_si(value))
}

/// How the comment above a number of a first model begins to say that it was not measured.
pub const BY_CONVENTION: &str = "by convention: ";

/// How other comments begin that `softrig init` writes after the name of a number.
const ORIGINS: [&str; 5] = [
    "fitted; ",
    "fitted, but ",
    "table of materials, ",
    "beam formula with ",
    "GUESS: ",
];

/// Says of a number, in the comment above it, that it was fitted since: where it came from before is
/// not true of it any more.
fn forget_origin(section: &mut Item, key: &str) {
    let Some(mut key) = section.as_table_mut().and_then(|it| it.key_mut(key)) else {
        return;
    };
    let decor = key.leaf_decor_mut();
    let above = decor.prefix().and_then(|it| it.as_str());
    let mut origins = std::iter::once(&BY_CONVENTION).chain(&ORIGINS);
    let name = above.and_then(|above| {
        origins.find_map(|it| Some(above.split_once(&format!("; {it}"))?.0.to_owned()))
    });
    if let Some(name) = name {
        decor.set_prefix(format!("{name}; fitted since this model was made\n"));
    }
}

/// Takes the error of the first fit out of the comment above the parameters.
fn forget_first_fit(section: &mut Item) {
    let Some(decor) = section.as_table_mut().map(Table::decor_mut) else {
        return;
    };
    let above = decor.prefix().and_then(|it| it.as_str()).unwrap_or("");
    let is_first_fit = |line: &&str| line.starts_with("# Fitted to ") && line.contains("RMS error");
    if above.lines().any(|line| is_first_fit(&line)) {
        let kept = above
            .split_inclusive('\n')
            .filter(|line| !is_first_fit(line));
        // Of the empty lines around it one stays.
        let kept: String = kept.collect();
        let kept = kept.replace("\n\n\n", "\n\n");
        let first = kept.trim_start_matches('\n');
        decor.set_prefix(format!("\n{first}"));
    }
}

/// Replaces a number and keeps the comment beside it.
pub(crate) fn replace_number(item: &mut Item, number: f64) {
    let decor = item.as_value().map(|value| value.decor().clone());
    let mut value = Value::from(number);
    if let Some(decor) = decor {
        *value.decor_mut() = decor;
    }
    *item = Item::Value(value);
}

/// Refuses a second effect with the name of the first: `[fit]` and verdicts identify effects
/// by name.
pub(crate) fn twice(
    toml: &Reader<'_>,
    effect: &Effect<f64>,
    first: &Table,
    second: &Table,
) -> InputError {
    let name = effect.kind().name();
    let (key, advice) = match effect {
        Effect::Custom(_) => ("name", "give each a name of its own"),
        Effect::Table(_) => (
            "kind",
            "keep one: a model, like a board, has room for the numbers of one table",
        ),
        _ => (
            "kind",
            "keep one: [fit] and verdicts name parameters by the kind of their effect",
        ),
    };
    let span = |table: &Table| table.get(key).and_then(Item::span).or(table.span());
    let begins = span(first).map_or(0, |span| span.start);
    toml.fail_at(
        span(second),
        format!(
            "there is a second effect {name}; the first is in line {}",
            line_of(toml.text, begins)
        ),
        advice,
    )
}

struct ModelReader<'a> {
    toml: Reader<'a>,
}

impl ModelReader<'_> {
    fn read(&self) -> Result<ModelFile, InputError> {
        let document = self
            .toml
            .document("let `softrig init` write a first model")?;
        let root = document.as_table();
        self.toml.known_keys(
            root,
            "the model",
            &[
                "schema",
                "name",
                "actuator",
                "dynamics",
                "fit",
                "effect",
                "recording",
            ],
        )?;
        self.toml.schema(root, SCHEMA)?;
        let name = root
            .get("name")
            .and_then(Item::as_str)
            .map_or_else(|| self.toml.path.display().to_string(), str::to_owned);
        let actuator = self.actuator(root)?;
        let dynamics_table = self.toml.table(root, "dynamics")?.ok_or_else(|| {
            self.toml.fail(
                "has no [dynamics] section",
                "add one with inertia_kg_m, damping_n_s_per_rad, stiffness_n_per_rad_n, exponent and input_gain_n_per_kpa",
            )
        })?;
        let dynamics = self.dynamics(root, dynamics_table, actuator.as_ref())?;
        let effect_tables = self.toml.sections(root, "effect")?;
        let effects = effect_tables
            .iter()
            .map(|table| self.effect(table))
            .collect::<Result<Vec<_>, _>>()?;
        for (index, effect) in effects.iter().enumerate() {
            let is_this = |other: &Effect<f64>| other.kind().name() == effect.kind().name();
            if let Some(first) = effects[..index].iter().position(is_this) {
                return Err(twice(
                    &self.toml,
                    effect,
                    effect_tables[first],
                    effect_tables[index],
                ));
            }
        }
        let model = Model::new(dynamics, &effects)
            .map_err(|error| self.invalid(error, dynamics_table, &effect_tables))?;
        self.check_ranges(&model, dynamics_table, &effect_tables)?;
        let free = self.free(root, &model)?;
        let within = self.within(root, &model)?;
        let warnings = self.unknown_material(root, actuator.as_ref());
        Ok(ModelFile {
            name,
            path: self.toml.path.to_owned(),
            model,
            free,
            within,
            actuator,
            recording: self.recording(root)?,
            warnings: warnings.into_iter().collect(),
            text: self.toml.text.to_owned(),
        })
    }

    fn actuator(&self, root: &Table) -> Result<Option<ActuatorSection>, InputError> {
        let Some(table) = self.toml.table(root, "actuator")? else {
            return Ok(None);
        };
        self.toml.known_keys(
            table,
            "[actuator]",
            &["material", "length_m", "width_m", "height_m"],
        )?;
        let material = match table.get("material") {
            None => "",
            Some(item) => item.as_str().ok_or_else(|| {
                self.toml.fail_at(
                    item.span(),
                    format!("material = {} is no name", item.to_string().trim()),
                    "write the name of the material in quotes",
                )
            })?,
        };
        let dimension = |key: &str| {
            let value = self.toml.required(table, "actuator", key)?;
            self.check_range(table, key, value, Range::of_key(key))?;
            Ok(value)
        };
        Ok(Some(ActuatorSection {
            material: material.to_owned(),
            length_m: dimension("length_m")?,
            width_m: dimension("width_m")?,
            height_m: dimension("height_m")?,
        }))
    }

    /// Warns about a material that is not in the table although stiffness and exponent are
    /// given: it may be the name of a measured silicone, or a typing error.
    fn unknown_material(&self, root: &Table, actuator: Option<&ActuatorSection>) -> Option<String> {
        let name = &actuator?.material;
        if name.is_empty() || named(name).is_some() {
            return None;
        }
        let found = format!(
            "the material \"{name}\" is not in the table, and nothing is taken from it: stiffness \
             and exponent are those in [dynamics]"
        );
        let advice = format!(
            "{}, or leave the line out and say it in a comment",
            material_to_write(name)
        );
        let said = self.toml.fail_at(material_span(root), found, advice);
        Some(said.to_string())
    }

    /// The layout of recordings.
    fn recording(&self, root: &Table) -> Result<Layout, InputError> {
        let mut layout = Layout::default();
        let Some(table) = self.toml.table(root, "recording")? else {
            return Ok(layout);
        };
        self.toml.known_keys(
            table,
            "[recording]",
            &[
                "columns",
                "units",
                "scale",
                "absolute_pressure_kpa",
                "angle_zero_deg",
                "flip_angle",
                "skip_rows",
                "setup",
            ],
        )?;
        layout.of_a_file = true;
        layout.setup = self.toml.setup(table)?.unwrap_or_default();
        self.entries(table, "columns", "pressure = \"p_psi\"", |key, column| {
            layout.names.set(key, column)
        })?;
        self.entries(table, "units", "pressure = \"psi\"", |key, unit| {
            layout.columns.say_unit(key, unit)
        })?;
        if let Some(item) = table.get("scale") {
            let scales = scales(item).and_then(|scales| {
                let mut said = scales.into_iter();
                said.try_for_each(|(key, scale)| layout.columns.say_scale(&key, scale).ok())
            });
            scales.ok_or_else(|| {
                self.toml.fail_at(
                    item.span(),
                    "scale does not give two points",
                    "write a number of the file and what it is in the unit, twice, as scale = { pressure = [[101, 0], [512, 100]] }",
                )
            })?;
        }
        if let Some(kpa) = self.toml.number(table, "absolute_pressure_kpa")? {
            let kpa = columns::air(kpa).map_err(|advice| {
                let span = table.get("absolute_pressure_kpa").and_then(Item::span);
                self.toml
                    .fail_at(span, format!("absolute_pressure_kpa is {kpa}"), advice)
            })?;
            layout.columns.air_kpa = Some(kpa);
        }
        layout.columns.angle_zero_deg = self.toml.number(table, "angle_zero_deg")?;
        if let Some(item) = table.get("skip_rows") {
            let count = item.as_integer().and_then(|it| u64::try_from(it).ok());
            layout.skip_rows = Some(count.ok_or_else(|| {
                self.toml.fail_at(
                    item.span(),
                    "skip_rows is no number of lines",
                    "write how many lines stand above the header, as `skip_rows = 22`",
                )
            })?);
        }
        if let Some(item) = table.get("flip_angle") {
            layout.columns.flip_angle = item.as_bool().ok_or_else(|| {
                self.toml.fail_at(
                    item.span(),
                    "flip_angle is neither true nor false",
                    "write `flip_angle = true` if the angle counts the other way round",
                )
            })?;
        }
        Ok(layout)
    }

    /// Hands over the entries of a table of texts, if it is there.
    fn entries(
        &self,
        table: &Table,
        key: &str,
        example: &str,
        mut take: impl FnMut(&str, &str) -> Result<(), String>,
    ) -> Result<(), InputError> {
        let Some(item) = table.get(key) else {
            return Ok(());
        };
        let advice = format!("write it as {key} = {{ {example} }}");
        let entries = item.as_table_like().ok_or_else(|| {
            self.toml
                .fail_at(item.span(), format!("{key} is no table"), advice.clone())
        })?;
        for (name, item) in entries.iter() {
            item.as_str()
                .ok_or_else(|| format!("{name} is not in quotes"))
                .and_then(|text| take(name, text))
                .map_err(|found| self.toml.fail_at(item.span(), found, advice.clone()))?;
        }
        Ok(())
    }

    fn dynamics(
        &self,
        root: &Table,
        table: &Table,
        actuator: Option<&ActuatorSection>,
    ) -> Result<Dynamics<f64>, InputError> {
        let keys: Vec<&str> = base().map(|(_, row)| row.key).collect();
        self.toml.known_keys(table, "[dynamics]", &keys)?;
        let required = |key: &str| self.toml.required(table, "dynamics", key);
        let derived = |key: &str, derive: fn(&ActuatorSection) -> Option<f64>| {
            if let Some(value) = self.toml.number(table, key)? {
                return Ok(value);
            }
            match actuator {
                Some(actuator) if !actuator.material.is_empty() => {
                    derive(actuator).ok_or_else(|| {
                        let found = format!(
                            "[dynamics] has no {key}, and the material \"{}\" is not in the table",
                            actuator.material
                        );
                        let advice = format!(
                            "{}, or give `{key} = …` in [dynamics]",
                            material_to_write(&actuator.material)
                        );
                        self.toml
                            .fail_at(material_span(root).or(table.span()), found, advice)
                    })
                }
                _ => required(key),
            }
        };
        let mut dynamics = *Model::<f64>::inert().dynamics();
        for (place, (id, row)) in base().enumerate() {
            let value = match id {
                ParameterId::Stiffness => derived(row.key, derived_stiffness)?,
                ParameterId::Exponent => derived(row.key, derived_exponent)?,
                _ => required(row.key)?,
            };
            dynamics.set_value(place, row.unit.to_si(value));
        }
        Ok(dynamics)
    }

    /// Checks that the numbers of a complete model are within their ranges.
    fn check_ranges(
        &self,
        model: &Model<f64>,
        dynamics: &Table,
        effects: &[&Table],
    ) -> Result<(), InputError> {
        for (id, row) in base() {
            // As it is used: stiffness and exponent may come from the material.
            let value = model.value(id).map(|value| row.unit.from_si(value));
            let range = Range::of_key(row.key);
            self.check_range(dynamics, row.key, value.unwrap_or_default(), range)?;
        }
        for table in effects {
            let kind = table
                .get("kind")
                .and_then(Item::as_str)
                .and_then(Kind::from_name);
            // A table's numbers are in lists, which are checked as they are read.
            for row in kind.map_or(&[][..], Kind::parameters) {
                if let Some(value) = self.toml.number(table, row.key)? {
                    let range = Some(Range::of_parameter(row));
                    self.check_range(table, row.key, value, range)?;
                }
            }
        }
        Ok(())
    }

    /// Checks the number of a key, and names its place, or that of its section.
    fn check_range(
        &self,
        table: &Table,
        key: &str,
        value: f64,
        range: Option<Range>,
    ) -> Result<(), InputError> {
        match range {
            Some(range) if !range.contains(value) => Err(self.toml.fail_at(
                table.get(key).and_then(Item::span).or(table.span()),
                format!("{key} = {value:?} is outside its range"),
                range.advice(),
            )),
            _ => Ok(()),
        }
    }

    fn effect(&self, table: &Table) -> Result<Effect<f64>, InputError> {
        let known = Kind::ALL.iter().chain(Kind::ON_DESKTOP);
        let known = known.map(|kind| kind.name());
        let known: Vec<&str> = known.chain([own_effects::KIND]).collect();
        let item = table.get("kind").ok_or_else(|| {
            self.toml.fail_at(
                table.span(),
                "[[effect]] has no kind",
                format!("add kind = \"…\", one of: {}", known.join(", ")),
            )
        })?;
        if item.as_str() == Some(own_effects::KIND) {
            return own_effects::read_section(&self.toml, table, Role::InModel);
        }
        let kind = item.as_str().and_then(Kind::from_name).ok_or_else(|| {
            self.toml.fail_at(
                item.span(),
                format!("{} is not a known kind of effect", item.to_string().trim()),
                format!("use one of: {}", known.join(", ")),
            )
        })?;
        if kind == Kind::Table {
            return self.numbers_of_table(table).map(Effect::Table);
        }
        let mut keys = vec!["kind"];
        keys.extend(kind.parameters().iter().map(|row| row.key));
        self.toml
            .known_keys(table, &format!("the effect {}", kind.name()), &keys)?;
        let values = kind
            .parameters()
            .iter()
            .map(
                |row| match (self.toml.number(table, row.key)?, row.left_out()) {
                    (Some(value), _) => Ok(row.unit.to_si(value)),
                    (None, Some(value)) => Ok(f64::from(value)),
                    (None, None) => self.toml.required(table, "[effect]", row.key),
                },
            )
            .collect::<Result<Vec<f64>, InputError>>()?;
        kind.build(&values).ok_or_else(|| {
            self.toml
                .fail("has an incomplete effect", "add its parameters")
        })
    }

    fn numbers_of_table(&self, section: &Table) -> Result<table::Table<f64>, InputError> {
        let name = "the effect table";
        self.toml
            .known_keys(section, name, &["kind", "of", "nodes", "forces_n"])?;
        let variables = Variable::ALL
            .map(|of| format!("\"{}\"", of.name()))
            .join(", ");
        let advice = format!("write of = one of: {variables}");
        let item = section.get("of").ok_or_else(|| {
            self.toml.fail_at(
                section.span(),
                format!("{name} has no variable (of)"),
                advice.clone(),
            )
        })?;
        let of = Variable::ALL
            .into_iter()
            .find(|of| item.as_str() == Some(of.name()))
            .ok_or_else(|| {
                let shown = item.to_string();
                self.toml.fail_at(
                    item.span(),
                    format!("of = {} is not a variable of a table", shown.trim()),
                    advice,
                )
            })?;
        let nodes = self.list(section, "nodes", of.unit())?;
        let forces = self.list(section, "forces_n", Unit::Newton)?;
        if !(MIN_NODES..=MAX_NODES).contains(&nodes.len()) {
            return Err(self.toml.fail_at(
                section.get("nodes").and_then(Item::span),
                format!("the table has {} nodes", nodes.len()),
                format!("give {MIN_NODES} to {MAX_NODES}"),
            ));
        }
        if nodes.len() != forces.len() {
            return Err(self.toml.fail_at(
                section.get("forces_n").and_then(Item::span),
                format!(
                    "the table has {} nodes and {} forces",
                    nodes.len(),
                    forces.len()
                ),
                "give a force for each node",
            ));
        }
        let unit = of.unit().symbol();
        let mut before = None;
        for (node, span) in &nodes {
            if before.is_some_and(|before| node_si(of, *node) <= node_si(of, before)) {
                return Err(self.toml.fail_at(
                    span.clone(),
                    format!("the node {node} {unit} is not above the one before it"),
                    "write the nodes in rising order, apart by what seven digits can tell",
                ));
            }
            before = Some(*node);
        }
        let (nodes, forces): (Vec<f32>, Vec<f64>) = nodes
            .iter()
            .zip(&forces)
            .map(|((node, _), (force, _))| (node_si(of, *node), *force))
            .unzip();
        table::Table::new(of, &nodes, &forces).map_err(|error| {
            self.toml.fail_at(
                section.get("nodes").and_then(Item::span),
                format!("the table {error}"),
                "give nodes in rising order, and a finite force for each",
            )
        })
    }

    /// A list of finite numbers, with their places.
    #[allow(clippy::type_complexity)] // A number and where it stands.
    fn list(
        &self,
        section: &Table,
        key: &str,
        unit: Unit,
    ) -> Result<Vec<(f64, Option<std::ops::Range<usize>>)>, InputError> {
        let range = Range::of_unit(unit);
        let item = section.get(key).ok_or_else(|| {
            self.toml.fail_at(
                section.span(),
                format!("the table has no {key}"),
                format!("add `{key} = […]`, a list of numbers"),
            )
        })?;
        let list = item.as_array().ok_or_else(|| {
            self.toml.fail_at(
                item.span(),
                format!("{key} is not a list"),
                format!("write it as {key} = [-1.0, 0.0, 1.0]"),
            )
        })?;
        list.iter()
            .map(|value| match value_number(value) {
                Some(number) if range.contains(number) => Ok((number, value.span())),
                Some(number) if number.is_finite() => Err(self.toml.fail_at(
                    value.span(),
                    format!("{number:?} in {key} is outside its range"),
                    range.advice(),
                )),
                _ => Err(self.toml.fail_at(
                    value.span(),
                    format!(
                        "{} in {key} is not a finite number",
                        value.to_string().trim()
                    ),
                    "write numbers without quotes and without a unit",
                )),
            })
            .collect()
    }

    fn invalid(&self, error: InvalidModel, dynamics: &Table, effects: &[&Table]) -> InputError {
        let (InvalidModel::NotFinite(id)
        | InvalidModel::NotPositive(id)
        | InvalidModel::Negative(id)
        | InvalidModel::OutOfBounds(id)) = error
        else {
            return self.toml.fail_at(
                effects.get(MAX_EFFECTS).and_then(|table| table.span()),
                format!("has {} effects", effects.len()),
                format!("keep at most {MAX_EFFECTS}"),
            );
        };
        let (table, key, range) = match id {
            ParameterId::Effect { slot, parameter } => {
                let table = effects.get(slot).copied().unwrap_or(dynamics);
                let row = table
                    .get("kind")
                    .and_then(Item::as_str)
                    .and_then(Kind::from_name)
                    .and_then(|kind| kind.parameters().get(parameter));
                let range = row.map(Range::of_parameter);
                (table, row.map_or("", |row| row.key), range)
            }
            base => {
                let key = base
                    .in_base()
                    .map_or("", |place| Dynamics::<()>::PARAMETERS[place].key);
                (dynamics, key, Range::of_key(key))
            }
        };
        let item = table.get(key);
        let shown = item.map_or_else(String::new, |item| item.to_string().trim().to_owned());
        self.toml.fail_at(
            item.and_then(Item::span),
            format!("{key} = {shown} {error}"),
            range.map_or_else(String::new, |range| range.advice()),
        )
    }

    /// What `[fit] within` says of base parameters: tolerances relative to their values.
    fn within(&self, root: &Table, model: &Model<f64>) -> Result<Vec<KnownRange>, InputError> {
        const ADVICE: &str = "write how far a parameter may be from its value: within = { stiffness = 0.3 } for 30 %";
        let mut known = Vec::new();
        let Some(item) = self
            .toml
            .table(root, "fit")?
            .and_then(|it| it.get("within"))
        else {
            return Ok(known);
        };
        let table = item.as_table_like().ok_or_else(|| {
            self.toml
                .fail_at(item.span(), "within is not a table", ADVICE)
        })?;
        for (name, item) in table.iter() {
            let id = ParameterId::BASE
                .into_iter()
                .find(|id| id.base_name() == Some(name))
                .ok_or_else(|| {
                    let names = Dynamics::<()>::FIELDS;
                    self.toml.fail_at(
                        item.span(),
                        format!("within names {name}, which is no base parameter"),
                        format!("use any of: {}", names.join(", ")),
                    )
                })?;
            let tolerance = item
                .as_float()
                .or_else(|| item.as_integer().map(|whole| whole as f64))
                .filter(|it| *it > 0.0 && it.is_finite())
                .ok_or_else(|| {
                    self.toml.fail_at(
                        item.span(),
                        format!("the tolerance of {name} is not above zero"),
                        ADVICE,
                    )
                })?;
            let value = model.value(id).unwrap_or_default();
            let by = tolerance * value.abs();
            known.push(KnownRange {
                id,
                lower: value - by,
                upper: value + by,
            });
        }
        Ok(known)
    }

    fn free(&self, root: &Table, model: &Model<f64>) -> Result<Vec<ParameterId>, InputError> {
        let Some(table) = self.toml.table(root, "fit")? else {
            return Ok(FREE_BY_DEFAULT.to_vec());
        };
        self.toml.known_keys(table, "[fit]", &["free", "within"])?;
        let Some(item) = table.get("free") else {
            return Ok(FREE_BY_DEFAULT.to_vec());
        };
        let list = item.as_array().ok_or_else(|| {
            self.toml.fail_at(
                item.span(),
                "free is not a list",
                "write it as free = [\"damping\", \"stiffness\"]",
            )
        })?;
        let mut known: Vec<(String, Vec<ParameterId>)> = ParameterId::BASE
            .into_iter()
            .map(|id| (id.base_name().unwrap_or_default().to_owned(), vec![id]))
            .collect();
        for (slot, effect) in model.effects().enumerate() {
            let ids = (0..effect.parameters().len())
                .map(|parameter| ParameterId::Effect { slot, parameter });
            if effect.kind() == Kind::Table {
                // All of them, in a word.
                known.push((
                    format!("{}.forces_n", Kind::Table.name()),
                    ids.clone().collect(),
                ));
            }
            known.extend(ids.map(|id| (parameter_name(model, id), vec![id])));
        }
        let mut free = Vec::new();
        for value in list {
            let name = value.as_str().unwrap_or("");
            let (_, ids) = known
                .iter()
                .find(|(known, _)| known == name)
                .ok_or_else(|| {
                    let names: Vec<&str> = known.iter().map(|(name, _)| name.as_str()).collect();
                    self.toml.fail_at(
                        value.span(),
                        format!(
                            "free names {}, which the model does not have",
                            value.to_string().trim()
                        ),
                        format!("use any of: {}", names.join(", ")),
                    )
                })?;
            for id in ids {
                if !free.contains(id) {
                    free.push(*id);
                }
            }
        }
        Ok(free)
    }
}

/// Kₙ (N/radⁿ) from the material's modulus and exponent and the actuator's
/// dimensions, with the corrected second moment (paper, Eq. 11).
fn derived_stiffness(actuator: &ActuatorSection) -> Option<f64> {
    let material = named(&actuator.material)?;
    let beam = Beam::new(actuator.length_m, actuator.width_m, actuator.height_m).ok()?;
    let modulus_pa = 1e6 * material.data_sheet::<f64>().modulus_mpa();
    let law = Ludwick::new(modulus_pa, material.exponent::<f64>()).ok()?;
    Some(law.stiffness::<Exact>(&beam, SecondMoment::Corrected))
}

/// The material's exponent as printed in the paper's Table I.
fn derived_exponent(actuator: &ActuatorSection) -> Option<f64> {
    Some(named(&actuator.material)?.exponent())
}

/// Where the material is.
fn material_span(root: &Table) -> Option<std::ops::Range<usize>> {
    root.get("actuator")?.get("material")?.span()
}

/// Advice for a material that is not in the table.
fn material_to_write(name: &str) -> String {
    let near = like(name);
    if near.is_empty() {
        return "write a name of `softrig materials list`".to_owned();
    }
    let names: Vec<String> = near.iter().map(|it| format!("\"{}\"", it.name)).collect();
    format!("write {} if that is meant", names.join(" or "))
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"schema = 1
name = "bench actuator"   # the one with the blue tube

[dynamics]
inertia_kg_m = 0.36
damping_n_s_per_rad = 0.913   # from ring-down
stiffness_n_per_rad_n = 0.127
exponent = 2.365
input_gain_n_per_kpa = 0.0217

[fit]
free = ["damping", "stiffness"]

[[effect]]
kind = "coulomb_friction"
force_n = 0.02
"#;

    fn parse(text: &str) -> Result<ModelFile, InputError> {
        ModelFile::parse(text, Path::new("m.toml"))
    }

    #[test]
    fn a_number_that_was_chosen_and_is_fitted_now_says_so() {
        let text = "schema = 1\n[dynamics]\n# effective inertia M; by convention: it shows in ratios\ninertia_kg_m = 1.0\n# damping C; by convention: it does not show\ndamping_n_s_per_rad = 50.0\nstiffness_n_per_rad_n = 1.0\nexponent = 1.0\ninput_gain_n_per_kpa = 1.0\n";
        let file = ModelFile::parse(text, Path::new("m.toml")).unwrap();
        assert_eq!(file.text_with(&file.model, ""), text);
        let damping = ParameterId::BASE[1];
        let moved = file.text_with(&file.model.with_value(damping, 5.0), "");
        assert!(
            moved.contains(
                "\n# damping C; fitted since this model was made\ndamping_n_s_per_rad = 5.0\n"
            ),
            "{moved}"
        );
        assert!(moved.contains("by convention: it shows in ratios\ninertia_kg_m = 1.0"));
    }

    #[test]
    fn what_was_true_of_the_first_fit_goes_with_it() {
        let text = "schema = 1\n\n# Fitted to 9 recordings: 7659 samples, RMS error 2.046°, of 27° about the mean.\n\n[dynamics]\n# effective inertia M; by convention: it shows in ratios\ninertia_kg_m = 1.0\n# damping C; fitted; 95 % interval 3.2 to 3.7 N·s/rad\ndamping_n_s_per_rad = 3.5\n# mine; fitted by hand\nstiffness_n_per_rad_n = 1.0\nexponent = 1.0\ninput_gain_n_per_kpa = 1.0\n";
        let file = ModelFile::parse(text, Path::new("m.toml")).unwrap();
        assert_eq!(file.text_with(&file.model, ""), text);
        let [damping, stiffness] = [ParameterId::BASE[1], ParameterId::BASE[2]];
        let model = file
            .model
            .with_value(damping, 5.0)
            .with_value(stiffness, 2.0);
        let moved = file.text_with(&model, "");
        assert!(
            !moved.contains("3.2 to 3.7") && !moved.contains("2.046"),
            "{moved}"
        );
        assert!(moved.contains("schema = 1\n\n[dynamics]"), "{moved}");
        assert!(
            moved.contains("# damping C; fitted since this model was made\n"),
            "{moved}"
        );
        assert!(
            moved.contains("# mine; fitted by hand\nstiffness"),
            "{moved}"
        );
    }

    #[test]
    fn a_model_is_read_into_si_units() {
        let file = parse(GOOD).unwrap();
        assert!((file.model.dynamics().input_gain - 2.17e-5).abs() < 1e-15);
        assert_eq!(file.free, [ParameterId::Damping, ParameterId::Stiffness]);
        let friction = file.model.effects().next().unwrap();
        assert_eq!(friction.kind(), Kind::CoulombFriction);
        // Smoothing was left out and takes its default.
        assert!((friction.value(1).unwrap() - 0.02).abs() < 1e-8);
    }

    #[test]
    fn every_fault_names_line_column_and_remedy() {
        for (from, to, parts) in [
            (
                "schema = 1",
                "schema = 7",
                vec!["line 1, column 10", "schema is 7"],
            ),
            ("schema = 1", "schema = ", vec!["line 1"]),
            (
                "= 0.127",
                "= -0.127",
                vec![
                    "line 7, column 25",
                    "stiffness_n_per_rad_n = -0.127 must not be negative",
                ],
            ),
            (
                "= 2.365",
                "= 0",
                vec!["line 8, column 12", "exponent = 0 must be above zero"],
            ),
            ("= 2.365", "= nan", vec!["line 8", "finite"]),
            (
                "= 2.365",
                "= 90",
                vec![
                    "line 8, column 12",
                    "exponent = 90.0 is outside its range",
                    "from 0.01 to 20",
                ],
            ),
            (
                "= 2.365",
                "= \"two\"",
                vec!["line 8", "exponent is not a number"],
            ),
            (
                "exponent",
                "exponnent",
                vec!["line 8, column 1", "no key exponnent"],
            ),
            ("exponent = 2.365\n", "", vec!["line 4", "has no exponent"]),
            (
                "\"stiffness\"]",
                "\"stifness\"]",
                vec!["line 12", "\"stifness\"", "use any of: inertia"],
            ),
            (
                "coulomb_friction",
                "colomb_friction",
                vec!["line 15, column 8", "colomb_friction", "quadratic_damping"],
            ),
            (
                "force_n = 0.02",
                "force_n = -0.02",
                vec!["line 16", "outside the bounds"],
            ),
            ("force_n = 0.02", "", vec!["line 14", "has no force_n"]),
            (
                "force_n = 0.02",
                "force = 0.02",
                vec!["line 16, column 1", "no key force"],
            ),
        ] {
            let text = GOOD.replace(from, to);
            let message = parse(&text).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{part:?} not in {message:?}");
            }
        }
    }

    const TABLE: &str = r#"
[[effect]]
kind = "table"
of = "pressure"
nodes = [-10, 0.1, 12.5, 80.0]   # where it was measured
forces_n = [
  -0.2, # below
  0.0,
  0.15,
  0.2,
]
"#;

    fn with_table() -> String {
        GOOD.to_owned() + TABLE
    }

    #[test]
    fn a_table_is_read_into_si_units_and_its_forces_can_be_freed() {
        let text = with_table().replace(
            "\"stiffness\"]",
            "\"table.forces_n[2]\", \"table.forces_n\"]",
        );
        let file = parse(&text).unwrap();
        let table = file.model.table().unwrap();
        assert_eq!(table.of(), Variable::Pressure);
        assert_eq!(table.nodes(), [-1e4, 100.0, 12_500.0, 8e4]);
        assert_eq!(table.forces(), [-0.2, 0.0, 0.15, 0.2]);
        let force = |parameter| ParameterId::Effect { slot: 1, parameter };
        let forces = [2, 0, 1, 3].map(force);
        assert_eq!(file.free[0], ParameterId::Damping);
        assert_eq!(file.free[1..], forces);
        assert_eq!(file.parameter_name(force(2)), "table.forces_n[2]");
        assert_eq!(parameter_unit(&file.model, force(2)), "N");
        let message = parse(&with_table().replace("\"stiffness\"]", "\"table.forces_n[4]\"]"))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("line 12") && message.contains("table.forces_n[3]"),
            "{message}"
        );
    }

    #[test]
    fn faults_of_a_table_name_line_column_and_remedy() {
        for (from, to, parts) in [
            (
                "\"pressure\"",
                "\"voltage\"",
                vec!["line 20, column 6", "\"voltage\"", "\"rate\""],
            ),
            (
                "of = \"pressure\"\n",
                "",
                vec!["line 18", "no variable (of)", "\"angle\""],
            ),
            (
                "  0.15,\n",
                "",
                vec!["line 22, column 12", "4 nodes and 3 forces"],
            ),
            (
                "12.5",
                "0.1",
                vec!["line 21, column 20", "0.1 kPa is not above", "rising"],
            ),
            ("12.5", "0.100000001", vec!["line 21", "seven digits"]),
            (
                "12.5",
                "nan",
                vec!["line 21, column 20", "nan in nodes", "number"],
            ),
            ("0.15", "inf", vec!["line 25, column 3", "inf in forces_n"]),
            ("0.15", "\"much\"", vec!["line 25", "not a finite number"]),
            (
                "0.15",
                "1e99",
                vec!["line 25, column 3", "outside its range", "to 1e12 N"],
            ),
            (
                "[-10, 0.1, 12.5, 80.0]",
                "-10",
                vec!["line 21, column 9", "not a list"],
            ),
            (
                "[-10, 0.1, 12.5, 80.0]",
                "[1]",
                vec!["line 21", "1 nodes", "2 to 16"],
            ),
            (
                "[-10, ",
                "[-30, -29, -28, -27, -26, -25, -24, -23, -22, -21, -20, -19, -18, -17, ",
                vec!["line 21", "17 nodes", "2 to 16"],
            ),
            (
                "nodes =",
                "knots =",
                vec!["line 21, column 1", "no key knots", "forces_n"],
            ),
        ] {
            let text = with_table().replace(from, to);
            let message = parse(&text).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{part:?} not in {message:?}");
            }
        }
        let two = with_table() + TABLE;
        let message = parse(&two).unwrap_err().to_string();
        assert!(
            message.contains(
                "line 30, column 8: there is a second effect table; the first is in line 19"
            ) && message.contains("one table"),
            "{message}"
        );
    }

    #[test]
    fn a_table_is_written_back_and_appended() {
        let file = parse(&with_table()).unwrap();
        let id = ParameterId::Effect {
            slot: 1,
            parameter: 2,
        };
        let text = file.text_with(&file.model.with_value(id, 0.175), "");
        // The friction's smoothing is written out.
        let expected = with_table().replace("0.15", "0.175").replace(
            "force_n = 0.02\n",
            "force_n = 0.02\nsmoothing_rad_per_s = 0.02\n",
        );
        assert_eq!(text, expected);

        let file = parse(GOOD).unwrap();
        for (of, nodes) in [
            (Variable::Pressure, [-33.3_f32, 12_345.678, 70_000.1]),
            (Variable::Angle, [-0.1, 1.0 / 3.0, 1.2]),
            (Variable::Rate, [-0.02, 0.02, 3.0]),
            (Variable::Time, [0.0, 1234.5678, 1e5]),
        ] {
            let table = table::Table::new(of, &nodes, &[-0.25, 0.0, 1.0]).unwrap();
            let effects: Vec<_> = file.model.effects().chain([Effect::Table(table)]).collect();
            let model = Model::new(*file.model.dynamics(), &effects).unwrap();
            let text = file.text_with(&model, "# added\n");
            let back = parse(&text).unwrap();
            assert_eq!(back.model.table(), Some(&table), "{text}");
            let unit = format!("]   # {}", of.unit().symbol());
            assert!(
                text.contains(&unit) && text.contains("forces_n = [-0.25, 0.0, 1.0]"),
                "{text}"
            );
        }
    }

    #[test]
    fn stiffness_and_exponent_come_from_the_material_if_left_out() {
        let derived = GOOD
            .replace("stiffness_n_per_rad_n = 0.127\nexponent = 2.365\n", "")
            .replace(
                "[dynamics]",
                "[actuator]\nmaterial = \"Dragon Skin 20\"\nlength_m = 0.094\nwidth_m = 0.030\nheight_m = 0.024\n\n[dynamics]",
            );
        let file = parse(&derived).unwrap();
        assert!((file.model.dynamics().exponent - 2.5).abs() < 1e-12);
        // The authors' dimensions with the corrected second moment.
        assert!((file.model.dynamics().stiffness - 0.094).abs() < 5e-4);
        // Spaces and hyphens are written differently everywhere.
        let other = parse(&derived.replace("Dragon Skin 20", "ecoflex 0030")).unwrap();
        assert!((other.model.dynamics().exponent - 1.613).abs() < 1e-12);
        for (name, advice) in [
            ("Play-Doh", "softrig materials list"),
            ("Dragon Skn 20", "write \"Dragon Skin 20\""),
        ] {
            let message = parse(&derived.replace("Dragon Skin 20", name))
                .unwrap_err()
                .to_string();
            for part in [
                "line 5, column 12",
                name,
                advice,
                "stiffness_n_per_rad_n = …",
            ] {
                assert!(message.contains(part), "{part:?} not in {message:?}");
            }
        }
        // Nothing to derive from: the key is what is missing.
        let message = parse(&derived.replace("material = \"Dragon Skin 20\"\n", ""))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("has no stiffness_n_per_rad_n"),
            "{message}"
        );
    }

    #[test]
    fn a_material_that_is_not_in_the_table_is_warned_of() {
        let section = "[actuator]\nmaterial = \"Ecoflex 0031\"\nlength_m = 0.094\nwidth_m = 0.030\nheight_m = 0.024\n\n[dynamics]";
        let text = GOOD.replace("[dynamics]", section);
        let file = parse(&text).unwrap();
        let [warning] = &file.warnings[..] else {
            panic!("{:?}", file.warnings);
        };
        for part in [
            "m.toml, line 5, column 12",
            "\"Ecoflex 0031\" is not in the table",
            "or \"Ecoflex 00-30\"",
        ] {
            assert!(warning.contains(part), "{part:?} not in {warning:?}");
        }
        let silent = |text: &str| parse(text).unwrap().warnings.is_empty();
        assert!(silent(GOOD) && silent(&text.replace("0031", "00-30")));
        assert!(silent(&text.replace("material = \"Ecoflex 0031\"\n", "")));
        let message = parse(&text.replace("\"Ecoflex 0031\"", "20"))
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("line 5, column 12: material = 20 is no name"),
            "{message}"
        );
    }

    #[test]
    fn a_second_effect_of_a_kind_is_refused() {
        let friction = &GOOD[GOOD.find("[[effect]]").unwrap()..];
        let drag = "\n[[effect]]\nkind = \"quadratic_damping\"\ndamping_n_s2_per_rad2 = 0.5\n";
        let message = parse(&format!("{GOOD}{drag}\n{friction}"))
            .unwrap_err()
            .to_string();
        for part in [
            "m.toml, line 23, column 8",
            "a second effect coulomb_friction; the first is in line 15",
            "keep one",
        ] {
            assert!(message.contains(part), "{part:?} not in {message:?}");
        }
    }

    #[test]
    fn writing_back_keeps_comments_and_appends_effects() {
        let file = parse(GOOD).unwrap();
        let drag = Kind::QuadraticDamping.build(&[0.5]).unwrap();
        let effects: Vec<_> = file.model.effects().chain([drag]).collect();
        let model = Model::new(*file.model.dynamics(), &effects)
            .unwrap()
            .with_value(ParameterId::Damping, 0.5);
        let text = file.text_with(&model, "# added\n");
        for part in [
            "# the one with the blue tube",
            "damping_n_s_per_rad = 0.5   # from ring-down",
            "# added\n[[effect]]\nkind = \"quadratic_damping\"\ndamping_n_s2_per_rad2 = 0.5",
        ] {
            assert!(text.contains(part), "{part:?} not in {text}");
        }
        let back = parse(&text).unwrap();
        assert_eq!(back.model.effects().count(), 2);
        let id = ParameterId::Effect {
            slot: 1,
            parameter: 0,
        };
        assert_eq!(
            back.parameter_name(id),
            "quadratic_damping.damping_n_s2_per_rad2"
        );
    }
}
