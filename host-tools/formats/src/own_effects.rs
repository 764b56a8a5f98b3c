//! Effects with the user's own formulas: `[[effect]]` with `kind = "custom"`.
//!
//! Such an effect is in a model file, with the values of its parameters, or in a file of
//! effects for `softrig diagnose --effects`, with their initial guesses. The keys are the same
//! (`docs/custom-effects.md`).
//!
//! Each definition is kept until the program ends, once per text, so that the thousands of
//! copies of a model hold only a reference.

use std::collections::BTreeMap;
use std::ops::Range as Span;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use model_core::actuator::Model;
use model_core::catalogue::{Effect, Kind};
use model_core::effects::custom::{
    Custom, Definition, Formula, MAX_MEMORIES, MAX_PARAMETERS, Memory, Origin, Program,
};
use model_core::effects::table::Variable;
use model_core::effects::{Info, Instant, Parameter, Place, State, Unit};
use toml_edit::{InlineTable, Item, Table, TableLike, Value};

use crate::error::InputError;
use crate::family::Family;
use crate::formula::{self, with_values};
use crate::model_file::{ModelFile, SCHEMA, replace_number, twice};
use crate::numbers::tidy;
use crate::recording::PASCAL_PER_KPA;
use crate::toml_reader::Reader;

/// The kind of an effect with a formula, in files.
pub const KIND: &str = "custom";

/// The most effects in a file of effects: each is tried, alone and beside others.
const MOST_EFFECTS: usize = 12;

/// The most definitions that one run of the program keeps, each a kilobyte or two: the terms of a grammar
/// for two hundred sizes of rigs.
const MOST_DEFINITIONS: usize = 32_768;

/// The most characters of a name or a unit.
const LONGEST_NAME: usize = 40;

/// The most characters of a title.
const LONGEST_TITLE: usize = 80;

/// The largest number that a parameter may have, as the forces of other effects.
const LARGEST: f64 = 1e12;

/// The report's text about an effect with a formula.
const TEXT: &str = "An effect by a formula of your own, in which th is the bending angle (rad), \
                    w its rate (rad/s), p the gauge pressure in the chamber (kPa) and t the time \
                    in the session (s).";

/// A file of effects, which `softrig diagnose` tries beside the catalogue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OwnEffects {
    /// Where it was read from.
    pub path: PathBuf,
    /// The effects, in the order of the file.
    pub kinds: Vec<Kind>,
}

impl OwnEffects {
    /// Reads a file of effects that are tried beside those of a model.
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn read(path: &Path, model: &Model<f64>) -> Result<Self, InputError> {
        let own = Self::read_for_any(path)?;
        own.check_beside(model)?;
        Ok(own)
    }

    /// Reads a file of effects for several models, each of which has to pass
    /// [`OwnEffects::check_beside`].
    ///
    /// # Errors
    ///
    /// Names file, line, column and remedy.
    pub fn read_for_any(path: &Path) -> Result<Self, InputError> {
        Self::parse(&crate::bounded::read_text(path)?, path)
    }

    /// Parses the text of a file of effects; `path` is only named in messages.
    ///
    /// # Errors
    ///
    /// Like [`OwnEffects::read`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, InputError> {
        Ok(Self {
            path: path.to_owned(),
            kinds: parse(text, path)?,
        })
    }

    /// The effect of this name, among a user's own or in the catalogue.
    pub fn find(own: &[Kind], name: &str) -> Option<Kind> {
        let mut own = own.iter().copied();
        own.find(|kind| kind.name() == name)
            .or_else(|| Kind::from_name(name).filter(|kind| kind.is_name()))
    }

    /// Refuses an effect that the model has under the same name with another formula.
    ///
    /// # Errors
    ///
    /// Names the effect and both formulas.
    pub fn check_beside(&self, model: &Model<f64>) -> Result<(), InputError> {
        for effect in model.effects() {
            let info = effect.kind().info();
            let other = self
                .kinds
                .iter()
                .map(|kind| kind.info())
                .find(|other| other.name == info.name && other.equation != info.equation);
            if let Some(other) = other {
                return Err(InputError::new(
                    format!(
                        "{} has {} here and {} in the model",
                        info.name, other.equation, info.equation
                    ),
                    "give one of them another name",
                )
                .in_file(&self.path));
            }
        }
        Ok(())
    }
}

fn parse(text: &str, path: &Path) -> Result<Vec<Kind>, InputError> {
    let reader = Reader { text, path };
    let document = reader.document("start it with `schema = 1` and a section [[effect]]")?;
    let root = document.as_table();
    reader.known_keys(root, "a file of effects", &["schema", "effect"])?;
    reader.schema(root, SCHEMA)?;
    let sections = reader.sections(root, "effect")?;
    if sections.is_empty() {
        return Err(reader.fail(
            "has no effect",
            "add a section [[effect]] with kind, name, force and its parameters",
        ));
    }
    if let Some(section) = sections.get(MOST_EFFECTS) {
        return Err(reader.fail_at(
            section.span(),
            format!("has {} effects", sections.len()),
            format!("keep at most {MOST_EFFECTS}: each is tried, alone and with others"),
        ));
    }
    let mut kinds: Vec<Kind> = Vec::new();
    for section in &sections {
        let kind = section.get("kind");
        if kind.and_then(Item::as_str) != Some(KIND) {
            return Err(reader.fail_at(
                kind.and_then(Item::span).or(section.span()),
                "a file of effects is for effects with a formula",
                format!("write kind = \"{KIND}\"; those of the catalogue are tried anyway"),
            ));
        }
        let effect = read_section(&reader, section, Role::Candidate)?;
        let is_this = |other: &Kind| other.name() == effect.kind().name();
        if let Some(first) = kinds.iter().position(is_this) {
            return Err(twice(&reader, &effect, sections[first], section));
        }
        kinds.push(effect.kind());
    }
    Ok(kinds)
}

/// Refuses a model with a formula where the board's arithmetic is asked for.
///
/// # Errors
///
/// Names the effect, and what the board runs in its place.
pub fn refuse_on_board(file: &ModelFile) -> Result<(), InputError> {
    let mut effects = file.model.effects();
    match effects.find(|effect| matches!(effect, Effect::Custom(_))) {
        Some(custom) => Err(InputError::new(
            format!(
                "the model has the effect {} by a formula, which the board cannot compute",
                custom.kind().name()
            ),
            "put a table of its variable in its place ([[effect]] kind = \"table\") and fit its \
             forces ([fit] free = [\"table.forces_n\"]); on the computer formulas run in f64",
        )
        .in_file(&file.path)),
        None => Ok(()),
    }
}

/// The purpose of a section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// A part of a model: its values are those of the model.
    InModel,
    /// A candidate: its values are where fits start.
    Candidate,
}

/// An effect with a formula that is not read from a file, as one of a grammar of formulas.
#[derive(Clone, Debug)]
pub struct Formulated {
    /// Its name in files.
    pub name: String,
    /// Its name in sentences.
    pub title: String,
    /// The force Q (N).
    pub force: String,
    /// Its parameters, with the values at which fits start.
    pub parameters: Vec<DeclaredParameter>,
    /// Its memories.
    pub memories: Vec<DeclaredMemory>,
    /// Its family; its own if none.
    pub family: Option<Family>,
    /// The effect that it becomes at an end of its parameters.
    pub special_case: Option<Kind>,
}

impl Formulated {
    /// The effect, as one that a diagnosis can try; none if the formula or a parameter is not
    /// valid.
    pub fn kind(&self) -> Option<Kind> {
        let formulas = Formulas::parse(&self.force, &self.parameters, &self.memories).ok()?;
        let definition = kept(&Written {
            name: &self.name,
            title: Some(&self.title),
            force: &self.force,
            family: self.family,
            rows: &self.parameters,
            memories: &self.memories,
            role: Role::Candidate,
            origin: Origin::Grammar,
            special_case: self.special_case,
            formulas,
        })?;
        Some(Kind::Custom(Formula(definition)))
    }
}

/// A parameter as it is written in a section.
#[derive(Clone, Debug)]
pub struct DeclaredParameter {
    /// Its name.
    pub key: String,
    /// Its value, or where a fit starts.
    pub value: f64,
    /// Smallest value.
    pub min: Option<f64>,
    /// Largest value.
    pub max: Option<f64>,
    /// Its unit, as shown.
    pub unit: String,
    /// Whether fits leave it as it is.
    pub hold: Hold,
}

/// A memory as it is written in a section: ż = (g − z)/τ.
///
/// A force that depends on what was before has a memory, or two: a hidden state that follows
/// something with a time constant, which is a parameter. After a long rest it is what it follows:
///
/// ```toml
/// force = "c*(th^3 - z)"
///
/// [effect.memory]
/// z = { follows = "th^3", time_constant = "tau" }     # ż = (th³ − z)/tau
/// ```
#[derive(Clone, Debug)]
pub struct DeclaredMemory {
    /// Its name, z.
    pub key: String,
    /// What it follows, g.
    pub follows: String,
    /// The parameter that is its time constant τ (s).
    pub time_constant: String,
}

/// The formulas of an effect, read.
#[derive(Clone)]
struct Formulas {
    force: formula::Formula,
    /// What each memory follows, and the place of its time constant among the parameters.
    memories: Vec<(formula::Formula, usize)>,
}

/// A fault in one of the formulas, and the place of the memory that it belongs to; none for the
/// force.
type FaultIn = (Option<usize>, formula::Fault);

impl DeclaredMemory {
    /// The hidden state that it is, for exported code.
    fn state(&self) -> State {
        State {
            key: leak(self.key.clone()),
            text: leak(format!(
                "{}, which follows {} with the time constant {}",
                self.key, self.follows, self.time_constant
            )),
        }
    }
}

impl Formulas {
    fn parse(
        force: &str,
        rows: &[DeclaredParameter],
        memories: &[DeclaredMemory],
    ) -> Result<Self, FaultIn> {
        let keys: Vec<&str> = rows.iter().map(|row| row.key.as_str()).collect();
        let names: Vec<&str> = memories.iter().map(|it| it.key.as_str()).collect();
        let force =
            formula::Formula::with_memories(force, &keys, &names).map_err(|fault| (None, fault))?;
        let memories = memories.iter().enumerate().map(|(index, memory)| {
            let follows = formula::Formula::parse(&memory.follows, &keys)
                .map_err(|fault| (Some(index), fault))?;
            let place = keys.iter().position(|key| *key == memory.time_constant);
            let place = place.ok_or_else(|| {
                let fault = formula::Fault {
                    at: 0,
                    found: format!("there is no parameter \"{}\"", memory.time_constant),
                    advice: format!("give the time constant one of: {}", keys.join(", ")),
                };
                (Some(index), fault)
            })?;
            Ok((follows, place))
        });
        Ok(Self {
            force,
            memories: memories.collect::<Result<_, FaultIn>>()?,
        })
    }

    /// Whether a parameter occurs in one of them.
    fn use_parameter(&self, index: usize) -> bool {
        let mut memories = self.memories.iter();
        self.force.uses(index)
            || memories.any(|(follows, place)| follows.uses(index) || *place == index)
    }

    /// The variables that occur in one of them.
    fn variables(&self) -> Vec<Variable> {
        let memories = self.memories.iter().map(|(follows, _)| follows);
        let formulas: Vec<_> = memories.chain([&self.force]).collect();
        let stands = |variable: &Variable| {
            let mut formulas = formulas.iter();
            formulas.any(|formula| formula.variables().contains(variable))
        };
        Variable::ALL.into_iter().filter(stands).collect()
    }

    /// Their programs for as long as this one runs.
    fn leaked(self) -> Option<(Program<'static>, &'static [Memory])> {
        let memories: Option<Vec<Memory>> = self
            .memories
            .into_iter()
            .map(|(follows, place)| {
                Some(Memory {
                    follows: follows.leaked()?,
                    time_constant: u8::try_from(place).ok()?,
                })
            })
            .collect();
        Some((
            self.force.leaked()?,
            Box::leak(memories?.into_boxed_slice()),
        ))
    }
}

/// Whether fits move a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// They do.
    Free,
    /// They do not.
    Held,
    /// Not while effects are compared, and at the end if that gains more than it costs.
    UntilNamed,
}

impl DeclaredParameter {
    /// Its bounds in single precision, which is what fits know, rounded inwards.
    fn bounds(&self) -> (f32, f32) {
        let lower = self.min.map_or(f32::NEG_INFINITY, |min| {
            let near = single(min);
            if f64::from(near) < min {
                near.next_up()
            } else {
                near
            }
        });
        let upper = self.max.map_or(f32::INFINITY, |max| {
            let near = single(max);
            if f64::from(near) > max {
                near.next_down()
            } else {
                near
            }
        });
        (lower, upper)
    }

    /// Its value within these bounds.
    fn held_within(&self) -> f64 {
        let (lower, upper) = self.bounds();
        self.value.clamp(f64::from(lower), f64::from(upper))
    }

    /// Where fits start: in the middle of the range, and at the value, which is last as
    /// what to reckon with before anything is known.
    fn starts(&self) -> Vec<f32> {
        let mut starts = Vec::new();
        if let (Some(min), Some(max)) = (self.min, self.max) {
            let middle = if min > 0.0 {
                (min * max).sqrt()
            } else {
                0.5 * (min + max)
            };
            if (middle - self.value).abs() > 0.05 * (max - min) {
                starts.push(single(middle));
            }
        }
        starts.push(single(self.value));
        starts
    }
}

#[allow(clippy::cast_possible_truncation)] // Rounding is the point.
fn single(value: f64) -> f32 {
    value as f32
}

/// Reads a section `[[effect]]` with `kind = "custom"`.
///
/// ```toml
/// [[effect]]
/// kind = "custom"
/// name = "my_friction"
/// title = "my friction"       # how sentences call it; the name without it
/// force = "a*tanh(w/b)"       # Q in N: above zero it pushes towards smaller angles
///
/// [effect.parameters]
/// a = { value = 0.02, min = 0.0, max = 1.0, unit = "N" }
/// b = { value = 0.05, min = 0.001, max = 1.0, unit = "rad/s" }
/// ```
pub(crate) fn read_section(
    reader: &Reader<'_>,
    section: &Table,
    role: Role,
) -> Result<Effect<f64>, InputError> {
    reader.known_keys(
        section,
        "an effect with a formula",
        &[
            "kind",
            "name",
            "title",
            "force",
            "family",
            "memory",
            "parameters",
        ],
    )?;
    let name = name(reader, section)?;
    let title = title(reader, section)?;
    let (force, force_at) = text_of(reader, section, "force", "\"a*tanh(w/b)\", in N")?;
    let family = family(reader, section)?;
    let rows = rows(reader, section)?;
    let (rows, places): (Vec<DeclaredParameter>, Vec<_>) = rows.into_iter().unzip();
    let (memories, texts): (Vec<DeclaredMemory>, Vec<_>) =
        memories(reader, section, &rows)?.into_iter().unzip();
    let formulas = Formulas::parse(force, &rows, &memories).map_err(|(memory, fault)| {
        let (what, text, span) = match memory {
            Some(index) => (
                format!("memory.{}", memories[index].key),
                memories[index].follows.as_str(),
                &texts[index],
            ),
            None => ("force".to_owned(), force, &force_at),
        };
        let at = within(reader.text, span, text, fault.at);
        reader.fail_at(Some(at), format!("{what}: {}", fault.found), fault.advice)
    })?;
    for (index, (row, span)) in rows.iter().zip(places).enumerate() {
        if !formulas.use_parameter(index) {
            return Err(reader.fail_at(
                span,
                format!("the parameter {} is not in the formula", row.key),
                "remove it, or use it in the formula",
            ));
        }
    }
    for (index, memory) in memories.iter().enumerate() {
        if !formulas.force.recalls(index) {
            return Err(reader.fail_at(
                Some(texts[index].clone()),
                format!(
                    "the memory {} is not in the formula of the force",
                    memory.key
                ),
                "remove it, or use it in the formula",
            ));
        }
    }
    if let Some((state, value)) = not_finite(&formulas, &rows) {
        return Err(reader.fail_at(
            Some(force_at),
            format!("the force is {value} at {state}"),
            "write it so that it is a finite number at every angle, rate, pressure and time, as \
             with sqrt(abs(th)), sign(th)*abs(th)^1.5 or log(1 + abs(w)); or bound a parameter",
        ));
    }
    let definition = kept(&Written {
        name,
        title,
        force,
        family,
        rows: &rows,
        memories: &memories,
        role,
        origin: Origin::Written,
        special_case: None,
        formulas,
    })
    .ok_or_else(|| {
        reader.fail_at(
            section.span(),
            format!("more than {MOST_DEFINITIONS} effects with formulas were read"),
            "diagnose fewer models at a time",
        )
    })?;
    let values: Vec<f64> = rows.iter().map(DeclaredParameter::held_within).collect();
    Kind::Custom(Formula(definition))
        .build(&values)
        .ok_or_else(|| reader.fail("has an incomplete effect", "add its parameters"))
}

fn name<'t>(reader: &Reader<'_>, section: &'t Table) -> Result<&'t str, InputError> {
    let (name, span) = text_of(reader, section, "name", "\"my_friction\"")?;
    let fail = |found: String, advice: &str| Err(reader.fail_at(Some(span.clone()), found, advice));
    if !formula::is_name(name) || name.len() > LONGEST_NAME {
        return fail(
            format!("\"{name}\" is no name of an effect"),
            "use up to 40 letters, digits and _, beginning with a letter",
        );
    }
    if Kind::from_name(name).is_some() || name == KIND || name == "none" {
        return fail(
            format!("{name} is an effect of the catalogue"),
            "choose another name, such as my_friction",
        );
    }
    Ok(name)
}

fn title<'t>(reader: &Reader<'_>, section: &'t Table) -> Result<Option<&'t str>, InputError> {
    let Some(item) = section.get("title") else {
        return Ok(None);
    };
    let is_short = |title: &&str| {
        !title.trim().is_empty()
            && title.chars().count() <= LONGEST_TITLE
            && !title.chars().any(char::is_control)
    };
    item.as_str().filter(is_short).map(Some).ok_or_else(|| {
        reader.fail_at(
            item.span(),
            "the title is no short text",
            "write it as title = \"friction of the seal\", in up to 80 characters, or leave it out",
        )
    })
}

fn family(reader: &Reader<'_>, section: &Table) -> Result<Option<Family>, InputError> {
    let Some(item) = section.get("family") else {
        return Ok(None);
    };
    let family = item.as_str().and_then(Family::named);
    family.map(Some).ok_or_else(|| {
        let known: Vec<String> = Family::NAMED
            .iter()
            .map(|family| format!("\"{family}\""))
            .collect();
        reader.fail_at(
            item.span(),
            format!("{} is no family of effects", item.to_string().trim()),
            format!("leave it out, or use one of: {}", known.join(", ")),
        )
    })
}

/// The text of a key that has to be there, and its place.
fn text_of<'t>(
    reader: &Reader<'_>,
    section: &'t Table,
    key: &str,
    example: &str,
) -> Result<(&'t str, Span<usize>), InputError> {
    let item = section.get(key);
    let span = item.and_then(Item::span).or(section.span());
    match item.and_then(Item::as_str) {
        Some(text) => Ok((text, span.unwrap_or_default())),
        None => Err(reader.fail_at(
            span,
            match item {
                Some(_) => format!("{key} is not a text"),
                None => format!("an effect with a formula has no {key}"),
            },
            format!("write {key} = {example}"),
        )),
    }
}

/// Where a byte of a string is in the file, as far as the string is written there as it is.
fn within(file: &str, string: &Span<usize>, text: &str, at: usize) -> Span<usize> {
    let raw = file.get(string.clone()).unwrap_or_default();
    match raw.find(text) {
        Some(begin) => {
            let place = string.start + begin + at;
            place..place
        }
        // With escapes in it.
        None => string.clone(),
    }
}

/// The parameters, each with its place.
#[allow(clippy::type_complexity)] // A parameter and where it stands.
fn rows(
    reader: &Reader<'_>,
    section: &Table,
) -> Result<Vec<(DeclaredParameter, Option<Span<usize>>)>, InputError> {
    const ADVICE: &str = "add [effect.parameters] with a line such as \
                          a = { value = 0.02, min = 0.0, max = 1.0, unit = \"N\" }";
    let item = section.get("parameters");
    let table = item
        .and_then(Item::as_table_like)
        .filter(|table| !table.is_empty());
    let Some(table) = table else {
        return Err(reader.fail_at(
            item.and_then(Item::span).or(section.span()),
            "an effect with a formula has no parameters",
            ADVICE,
        ));
    };
    if table.len() > MAX_PARAMETERS {
        return Err(reader.fail_at(
            item.and_then(Item::span).or(section.span()),
            format!("the effect has {} parameters", table.len()),
            format!("keep at most {MAX_PARAMETERS}: no recording determines more"),
        ));
    }
    table
        .iter()
        .map(|(key, item)| Ok((row(reader, key, item)?, item.span())))
        .collect()
}

/// The memories, each with the place of what it follows.
#[allow(clippy::type_complexity)] // A memory and where it stands.
fn memories(
    reader: &Reader<'_>,
    section: &Table,
    rows: &[DeclaredParameter],
) -> Result<Vec<(DeclaredMemory, Span<usize>)>, InputError> {
    const ADVICE: &str = "write [effect.memory] with a line such as \
                          z = { follows = \"th\", time_constant = \"tau\" }";
    let Some(item) = section.get("memory") else {
        return Ok(Vec::new());
    };
    let table = item.as_table_like().filter(|table| !table.is_empty());
    let Some(table) = table else {
        return Err(reader.fail_at(item.span(), "the memory has no name", ADVICE));
    };
    if table.len() > MAX_MEMORIES {
        return Err(reader.fail_at(
            item.span(),
            format!("the effect has {} memories", table.len()),
            format!("keep at most {MAX_MEMORIES}"),
        ));
    }
    table
        .iter()
        .map(|(key, item)| memory(reader, key, item, rows))
        .collect()
}

fn memory(
    reader: &Reader<'_>,
    key: &str,
    item: &Item,
    rows: &[DeclaredParameter],
) -> Result<(DeclaredMemory, Span<usize>), InputError> {
    let fail = |span: Option<Span<usize>>, found: String, advice: &str| {
        Err(reader.fail_at(span, found, advice.to_owned()))
    };
    if !formula::is_name(key) || key.len() > LONGEST_NAME {
        return fail(
            item.span(),
            format!("\"{key}\" is no name of a memory"),
            "use up to 40 letters, digits and _, beginning with a letter",
        );
    }
    let taken = formula::meaning(key).or_else(|| {
        rows.iter()
            .any(|row| row.key == key)
            .then_some("a parameter")
    });
    if let Some(meaning) = taken {
        return fail(
            item.span(),
            format!("{key} is {meaning} already"),
            "give the memory another name",
        );
    }
    let table = item.as_table_like();
    let text = |name: &str| {
        table
            .and_then(|table| table.get(name))
            .and_then(Item::as_str)
    };
    let known = |name: &str| ["follows", "time_constant"].contains(&name);
    let other = table.and_then(|table| table.iter().find(|(name, _)| !known(name)));
    if let Some((name, entry)) = other {
        return fail(
            entry.span(),
            format!("the memory {key} has no key {name}"),
            "remove it; a memory has follows and time_constant",
        );
    }
    let (Some(follows), Some(time_constant)) = (text("follows"), text("time_constant")) else {
        return fail(
            item.span(),
            format!("the memory {key} lacks follows or time_constant"),
            "write it as { follows = \"th\", time_constant = \"tau\" }, with a parameter tau in s",
        );
    };
    let row = rows.iter().find(|row| row.key == time_constant);
    if row.is_some_and(|row| row.min.unwrap_or(0.0) <= 0.0) {
        return fail(
            item.span(),
            format!("the time constant {time_constant} may become zero"),
            "give that parameter a smallest value above zero, such as min = 0.01",
        );
    }
    let memory = DeclaredMemory {
        key: key.to_owned(),
        follows: follows.to_owned(),
        time_constant: time_constant.to_owned(),
    };
    let span = table
        .and_then(|table| table.get("follows"))
        .and_then(Item::span)
        .or(item.span());
    Ok((memory, span.unwrap_or_default()))
}

fn row(reader: &Reader<'_>, key: &str, item: &Item) -> Result<DeclaredParameter, InputError> {
    let fail = |item: &Item, found: String, advice: &str| {
        Err(reader.fail_at(item.span(), found, advice.to_owned()))
    };
    if !formula::is_name(key) || key.len() > LONGEST_NAME {
        return fail(
            item,
            format!("\"{key}\" is no name of a parameter"),
            "use up to 40 letters, digits and _, beginning with a letter",
        );
    }
    if let Some(meaning) = formula::meaning(key) {
        return fail(
            item,
            format!("{key} is {meaning} in formulas"),
            "give the parameter another name",
        );
    }
    let mut row = DeclaredParameter {
        key: key.to_owned(),
        value: 0.0,
        min: None,
        max: None,
        unit: String::new(),
        hold: Hold::Free,
    };
    let Some(table) = item.as_table_like() else {
        row.value = number(reader, key, item)?;
        return Ok(row);
    };
    let mut value = None;
    for (name, entry) in table.iter() {
        let what = format!("{key}.{name}");
        match name {
            "value" => value = Some(number(reader, &what, entry)?),
            "min" => row.min = Some(number(reader, &what, entry)?),
            "max" => row.max = Some(number(reader, &what, entry)?),
            "unit" => row.unit = unit(reader, entry)?,
            "hold" => match entry.as_bool() {
                Some(true) => row.hold = Hold::Held,
                Some(false) => row.hold = Hold::Free,
                None => {
                    return fail(
                        entry,
                        format!("{what} is not true or false"),
                        "write hold = true to keep fits from moving it",
                    );
                }
            },
            _ => {
                return fail(
                    entry,
                    format!("the parameter {key} has no key {name}"),
                    "remove it, or use one of: value, min, max, unit, hold",
                );
            }
        }
    }
    let Some(value) = value else {
        return fail(
            item,
            format!("the parameter {key} has no value"),
            "add value = …: the number itself, or where a fit starts",
        );
    };
    row.value = value;
    let (min, max) = (
        row.min.unwrap_or(f64::NEG_INFINITY),
        row.max.unwrap_or(f64::INFINITY),
    );
    let (lower, upper) = row.bounds();
    if min >= max || lower >= upper {
        return fail(
            item,
            format!("{key}: min = {min:?} is not below max = {max:?}"),
            "widen the range, or write hold = true to keep the value",
        );
    }
    // What -o writes has seven digits, and may lie on a bound.
    let slack = |bound: f64| 1e-6 * bound.abs();
    if value < min - slack(min) || value > max + slack(max) {
        return fail(
            table.get("value").unwrap_or(item),
            format!("{key} = {value:?} is outside its range from {min:?} to {max:?}"),
            "move the value into the range, or widen the range",
        );
    }
    row.value = value.clamp(min, max);
    Ok(row)
}

fn number(reader: &Reader<'_>, key: &str, item: &Item) -> Result<f64, InputError> {
    let number = item
        .as_float()
        .or_else(|| item.as_integer().map(|whole| whole as f64));
    match number {
        Some(number) if number.abs() <= LARGEST => Ok(number),
        Some(number) => Err(reader.fail_at(
            item.span(),
            format!("{key} = {number:?} is outside its range"),
            format!("give a value from {:e} to {LARGEST:e}", -LARGEST),
        )),
        None => Err(reader.fail_at(
            item.span(),
            format!("{key} is not a number"),
            "write a number without quotes and without a unit",
        )),
    }
}

fn unit(reader: &Reader<'_>, item: &Item) -> Result<String, InputError> {
    item.as_str()
        .filter(|unit| unit.chars().count() <= LONGEST_NAME && !unit.chars().any(char::is_control))
        .map(str::to_owned)
        .ok_or_else(|| {
            reader.fail_at(
                item.span(),
                "the unit is no short text",
                "write it as unit = \"N/rad\"",
            )
        })
}

/// Where within ordinary ranges a force is not a finite number, and what it is there:
/// with the parameters as written, and with each at an end of its range.
fn not_finite(formulas: &Formulas, rows: &[DeclaredParameter]) -> Option<(String, f64)> {
    const ANGLES: [f64; 9] = [0.0, 0.01, -0.01, 0.5, -0.5, 1.6, -1.6, 3.2, -3.2];
    const RATES: [f64; 7] = [0.0, 0.01, -0.01, 1.0, -1.0, 20.0, -20.0];
    // A sensor with noise shows less than no pressure.
    const PRESSURES_KPA: [f64; 4] = [0.0, -2.0, 50.0, 300.0];
    const TIMES: [f64; 3] = [0.0, 1.0, 3_600.0];
    // With the digits that -o writes, so that what was read can be read again.
    let written: Vec<f64> = rows.iter().map(|row| tidy(row.held_within())).collect();
    let mut sets = vec![written.clone()];
    for (index, row) in rows.iter().enumerate() {
        for end in [row.min, row.max].into_iter().flatten() {
            let mut set = written.clone();
            set[index] = end;
            sets.push(set);
        }
    }
    let program = formulas.force.program()?;
    let follows: Vec<Program<'_>> = formulas
        .memories
        .iter()
        .filter_map(|(follows, _)| follows.program())
        .collect();
    let variables = formulas.variables();
    let grid = |variable, values: &'static [f64]| {
        if variables.contains(&variable) {
            values
        } else {
            &[0.0]
        }
    };
    for values in sets {
        for &angle in grid(Variable::Angle, &ANGLES) {
            for &rate in grid(Variable::Rate, &RATES) {
                for &kpa in grid(Variable::Pressure, &PRESSURES_KPA) {
                    for &time in grid(Variable::Time, &TIMES) {
                        let at = Instant {
                            time,
                            angle,
                            rate,
                            pressure: kpa * PASCAL_PER_KPA,
                        };
                        let mut memory = [0.0; MAX_MEMORIES];
                        for (state, follows) in memory.iter_mut().zip(&follows) {
                            *state = follows.at(&values, &at, &[0.0; MAX_MEMORIES]);
                        }
                        let force = program.at(&values, &at, &memory);
                        if force.is_finite() {
                            continue;
                        }
                        let mut state = format!("th = {angle}, w = {rate}, p = {kpa}, t = {time}");
                        for (row, value) in rows.iter().zip(&values) {
                            state += &format!(", {} = {value}", row.key);
                        }
                        return Some((state, force));
                    }
                }
            }
        }
    }
    None
}

/// A section that was read and checked.
struct Written<'a> {
    name: &'a str,
    title: Option<&'a str>,
    force: &'a str,
    family: Option<Family>,
    rows: &'a [DeclaredParameter],
    memories: &'a [DeclaredMemory],
    role: Role,
    origin: Origin,
    special_case: Option<Kind>,
    formulas: Formulas,
}

impl Written<'_> {
    /// The section as a table, with the values only where they are part of what is
    /// defined.
    fn table(&self) -> Table {
        let mut table = Table::new();
        table["kind"] = toml_edit::value(KIND);
        table["name"] = toml_edit::value(self.name);
        if let Some(title) = self.title {
            table["title"] = toml_edit::value(title);
        }
        table["force"] = toml_edit::value(self.force);
        if let Some(family) = self.family {
            table["family"] = toml_edit::value(family.to_string());
        }
        if !self.memories.is_empty() {
            let mut memories = Table::new();
            for memory in self.memories {
                let mut entry = InlineTable::new();
                entry.insert("follows", memory.follows.as_str().into());
                entry.insert("time_constant", memory.time_constant.as_str().into());
                memories[&memory.key] = Item::Value(Value::InlineTable(entry));
            }
            table["memory"] = Item::Table(memories);
        }
        let mut parameters = Table::new();
        for row in self.rows {
            let mut entry = InlineTable::new();
            if self.role == Role::Candidate {
                entry.insert("value", row.value.into());
            }
            for (key, bound) in [("min", row.min), ("max", row.max)] {
                if let Some(bound) = bound {
                    entry.insert(key, bound.into());
                }
            }
            if !row.unit.is_empty() {
                entry.insert("unit", row.unit.as_str().into());
            }
            if row.hold == Hold::Held {
                entry.insert("hold", true.into());
            }
            parameters[&row.key] = Item::Value(Value::InlineTable(entry));
        }
        table["parameters"] = Item::Table(parameters);
        table
    }

    /// Its equations, as a report shows them.
    fn equation(&self) -> String {
        let memories = self.memories.iter().map(|memory| {
            let DeclaredMemory {
                key,
                follows,
                time_constant,
            } = memory;
            format!(", d{key}/dt = ({follows} - {key})/{time_constant}")
        });
        let memories: String = memories.collect();
        format!("Q = {}{memories}", self.force)
    }

    fn definition(self, text: &'static str) -> Option<&'static Definition> {
        let variables: Vec<&str> = self
            .formulas
            .variables()
            .into_iter()
            .map(|variable| match variable {
                Variable::Angle => "angle",
                Variable::Rate => "angular velocity",
                Variable::Pressure => "pressure",
                Variable::Time => "time in the run",
            })
            .collect();
        let signature = match variables.as_slice() {
            [] => "constant".to_owned(),
            all => all.join(", "),
        };
        let candidate = self.role == Role::Candidate;
        let parameters: Vec<Parameter> = self
            .rows
            .iter()
            .map(|row| {
                let (lower, upper) = row.bounds();
                let key: &str = leak(row.key.clone());
                Parameter {
                    key,
                    symbol: key,
                    unit: Unit::Given(leak(row.unit.clone())),
                    lower,
                    upper,
                    held: (candidate && row.hold != Hold::Free).then(|| single(row.value)),
                    default: None,
                    starts: if candidate && row.hold != Hold::Held {
                        Box::leak(row.starts().into_boxed_slice())
                    } else {
                        &[]
                    },
                }
            })
            .collect();
        let name = leak(self.name.to_owned());
        let equation = self.equation();
        let states: Vec<State> = self.memories.iter().map(DeclaredMemory::state).collect();
        let (program, memories) = self.formulas.leaked()?;
        Some(Box::leak(Box::new(Definition {
            info: Info {
                name,
                title: self.title.map_or(name, |title| leak(title.to_owned())),
                place: Place::Force,
                equation: leak(equation),
                text: TEXT,
                signature: leak(signature),
                look_alikes: &[],
                family: self.family.unwrap_or(Family::Own(name)),
                needs: &[],
                own_variable: program.own_variable().filter(|_| memories.is_empty()),
                special_case: self.special_case,
                imitates: &[],
                told_by: &[],
                doubtful: &[],
                has_slope: true,
                states: Box::leak(states.into_boxed_slice()),
            },
            parameters: Box::leak(parameters.into_boxed_slice()),
            program,
            memories,
            origin: self.origin,
            text,
        })))
    }
}

fn leak(text: String) -> &'static str {
    Box::leak(text.into_boxed_str())
}

/// The definition of a text, made once; none if there are too many.
fn kept(written: &Written<'_>) -> Option<&'static Definition> {
    static KNOWN: Mutex<BTreeMap<&'static str, &'static Definition>> = Mutex::new(BTreeMap::new());
    // As a document: a table by itself leaves out the tables in it.
    let text = toml_edit::DocumentMut::from(written.table()).to_string();
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(definition) = known.get(text.as_str()) {
        return Some(definition);
    }
    if known.len() >= MOST_DEFINITIONS {
        return None;
    }
    let text = leak(text);
    let again = Written {
        formulas: written.formulas.clone(),
        ..*written
    };
    let definition = again.definition(text)?;
    known.insert(text, definition);
    Some(definition)
}

/// The equations of an effect with its numbers, in three digits: `Q = 0.012*(th^3 - z) N,
/// dz/dt = (th^3 - z)/2.50`.
pub fn with_numbers(effect: &Custom<f64>) -> String {
    let section = section(effect);
    let keys = effect.formula().0.parameters.iter().map(|row| row.key);
    let values: Vec<(&str, f64)> = keys
        .enumerate()
        .filter_map(|(index, key)| Some((key, effect.value(index)?)))
        .collect();
    let of = |item: Option<&Item>| item.and_then(Item::as_str).unwrap_or_default().to_owned();
    let mut shown = format!("Q = {} N", with_values(&of(section.get("force")), &values));
    let memories = section.get("memory").and_then(Item::as_table_like);
    for (key, item) in memories.into_iter().flat_map(TableLike::iter) {
        let entry = item.as_table_like();
        let text = |name| of(entry.and_then(|entry| entry.get(name)));
        let rate = format!("({} - {key})/{}", text("follows"), text("time_constant"));
        shown += &format!(", d{key}/dt = {}", with_values(&rate, &values));
    }
    shown
}

/// A new section for an effect that a model file does not have.
pub(crate) fn section(effect: &Custom<f64>) -> Table {
    let text = effect.formula().0.text;
    // It was written by this module.
    let document: toml_edit::DocumentMut = text.parse().unwrap_or_default();
    // Copied without the places that its tables have there, by which they would be sorted
    // among those of the model.
    without_places(document.as_table())
}

fn without_places(table: &Table) -> Table {
    let mut copy = Table::new();
    for (key, item) in table {
        let item = match item {
            Item::Table(inner) => Item::Table(without_places(inner)),
            other => other.clone(),
        };
        copy.insert(key, item);
    }
    copy
}

/// Puts the values of an effect into its section.
pub(crate) fn write_values(section: &mut Table, effect: &Custom<f64>) {
    let rows = effect.formula().0.parameters;
    let Some(table) = section
        .get_mut("parameters")
        .and_then(Item::as_table_like_mut)
    else {
        return;
    };
    for (index, row) in rows.iter().enumerate() {
        let (Some(value), Some(item)) = (effect.value(index), table.get_mut(row.key)) else {
            continue;
        };
        match item.as_table_like_mut() {
            Some(entry) => put_value(entry, tidy(value)),
            None => replace_number(item, tidy(value)),
        }
    }
}

fn put_value(entry: &mut dyn TableLike, value: f64) {
    match entry.get_mut("value") {
        Some(item) => replace_number(item, value),
        None => {
            entry.insert("value", toml_edit::value(value));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_core::actuator::ParameterId;
    use model_core::effects::Mechanism;

    const MODEL: &str = r#"schema = 1
name = "m"
# Everything here is from the data sheet.
[dynamics]
inertia_kg_m = 0.36
damping_n_s_per_rad = 0.913
stiffness_n_per_rad_n = 0.127
exponent = 2.365
input_gain_n_per_kpa = 0.0217
[fit]
free = ["damping", "my_friction.a", "my_friction.c"]

[[effect]]
kind = "custom"
name = "my_friction"                  # the sleeve
force = "a*tanh(w/b) + c*th^3"        # N

[effect.parameters]
a = { value = 0.02, min = 0.0, max = 1.0, unit = "N" }   # guessed
b = { value = 0.05, min = 0.001, max = 1.0, unit = "rad/s" }
c = 0
"#;

    const EFFECTS: &str = r#"schema = 1
[[effect]]
kind = "custom"
name = "wave"
force = "a*sin(k*th)"
family = "stiffness shape"
parameters = { a = { value = 0.1, min = 0.0, unit = "N" }, k = { value = 3, min = 1.0, max = 9.0, hold = true } }

[[effect]]
kind = "custom"
name = "pressed"
force = "mu*p*tanh(w/0.05)"
[effect.parameters.mu]
value = 0.001
min = 0.0
max = 0.1
unit = "N/kPa"
"#;

    fn model(text: &str) -> ModelFile {
        ModelFile::parse(text, Path::new("m.toml")).unwrap()
    }

    fn refused(text: &str) -> InputError {
        ModelFile::parse(text, Path::new("m.toml")).unwrap_err()
    }

    /// Where `part` of a text begins, as line and column.
    fn place(text: &str, part: &str, into: usize) -> (Option<u64>, Option<String>) {
        let error = InputError::new("", "").at_offset(text, text.find(part).unwrap() + into);
        (error.line, error.column)
    }

    #[test]
    fn a_model_with_a_formula_is_read_and_written_with_its_comments() {
        let file = model(MODEL);
        let names: Vec<String> = file
            .free
            .iter()
            .map(|id| file.parameter_name(*id))
            .collect();
        assert_eq!(names, ["damping", "my_friction.a", "my_friction.c"]);
        assert_eq!(
            file.text_with(&file.model, ""),
            MODEL.replace("c = 0\n", "c = 0.0\n")
        );
        let id = |parameter| ParameterId::Effect { slot: 0, parameter };
        let changed = file
            .model
            .with_value(id(0), 0.123_456_78)
            .with_value(id(2), -0.5);
        assert_eq!(
            file.text_with(&changed, ""),
            MODEL
                .replace("value = 0.02,", "value = 0.1234568,")
                .replace("c = 0\n", "c = -0.5\n")
        );
        let mut force = [0.0; 2];
        let at = Instant {
            time: 0.0,
            angle: 0.5,
            rate: 1.0,
            pressure: 0.0,
        };
        let effect = changed.effects().next().unwrap();
        let found = effect.force(&at, &[0.0; 2], &mut force);
        assert!((found - (0.123_456_78 * 20.0_f64.tanh() - 0.0625)).abs() < 1e-12);
    }

    #[test]
    fn a_candidate_is_written_into_a_model_that_reads_it_again() {
        let own = OwnEffects::parse(EFFECTS, Path::new("e.toml")).unwrap();
        let [wave, pressed] = own.kinds.as_slice() else {
            panic!("{own:?}")
        };
        assert_eq!(wave.info().equation, "Q = a*sin(k*th)");
        assert_eq!(wave.parameters()[1].held, Some(3.0));
        assert_eq!(wave.parameters()[0].starts, [0.1]);
        assert_eq!(pressed.parameters()[0].starts, [0.05, 0.001]);
        assert_eq!(wave.info().family, Family::StiffnessShape);
        assert_eq!(pressed.info().family, Family::Own("pressed"));

        assert_eq!(OwnEffects::find(&own.kinds, "wave"), Some(*wave));
        assert!(OwnEffects::find(&own.kinds, "gravity").is_some());
        assert!(OwnEffects::find(&[], "wave").is_none());

        let plain = MODEL.split("[fit]").next().unwrap();
        let file = model(plain);
        let effects = [
            wave.build(&[0.2, 3.0]).unwrap(),
            pressed.build(&[0.004]).unwrap(),
        ];
        let more: Model<f64> = Model::new(*file.model.dynamics(), &effects).unwrap();
        let text = file.text_with(&more, "# Added.\n");
        let again = model(&text);
        let shown: Vec<(&str, Vec<f64>)> = again
            .model
            .effects()
            .map(|effect| (effect.kind().name(), effect.values().collect()))
            .collect();
        assert_eq!(shown, [("wave", vec![0.2, 3.0]), ("pressed", vec![0.004])]);
        assert_eq!(again.text_with(&again.model, ""), text);
        assert!(text.contains("family = \"stiffness shape\"") && text.contains("hold = true"));
        // The same effect is not tried beside itself, and another must not have its name.
        assert!(own.check_beside(&again.model).is_ok());
        let other = EFFECTS.replace("a*sin(k*th)", "a*cos(k*th)");
        let other = OwnEffects::parse(&other, Path::new("e.toml")).unwrap();
        assert!(other.check_beside(&again.model).is_err());
    }

    /// A value at a bound that single precision does not hold stays within it.
    #[test]
    fn values_at_bounds_can_be_written_and_read() {
        let text = MODEL.replace(
            "value = 0.02, min = 0.0",
            "value = 0.123456749, min = 0.123456749",
        );
        let file = model(&text);
        let value = file.model.effects().next().unwrap().value(0).unwrap();
        assert!(value >= 0.123_456_749);
        model(&file.text_with(&file.model, ""));
    }

    #[test]
    fn the_place_in_the_formula_is_named() {
        for (from, to, at, found) in [
            ("tanh(w/b)", "tanh(w/b", "tanh(", 4),
            ("tanh(w/b)", "tahn(w/b)", "tahn", 0),
            ("c*th^3", "c*th^^3", "^^3", 1),
            ("c*th^3", "c*phi", "phi", 0),
        ]
        .map(|(from, to, part, into)| (from, to, (part, into), "force: "))
        {
            let text = MODEL.replace(from, to);
            let error = refused(&text);
            assert_eq!(
                (error.line, error.column.clone()),
                place(&text, at.0, at.1),
                "{error}"
            );
            assert!(error.found.starts_with(found), "{error}");
        }
        // In a string of several lines too.
        let text = MODEL.replace(
            "\"a*tanh(w/b) + c*th^3\"",
            "\"\"\"\na*tanh(w/b)\n  + c*phi\"\"\"",
        );
        let error = refused(&text);
        assert_eq!(
            (error.line, error.column.clone()),
            place(&text, "phi", 0),
            "{error}"
        );
    }

    #[test]
    fn what_cannot_be_meant_is_refused() {
        for (from, to, found) in [
            ("name = \"my_friction\"", "", "has no name"),
            (
                "name = \"my_friction\"",
                "name = \"gravity\"",
                "of the catalogue",
            ),
            (
                "name = \"my_friction\"",
                "name = \"custom\"",
                "of the catalogue",
            ),
            (
                "name = \"my_friction\"",
                "name = \"my friction\"",
                "no name of an effect",
            ),
            ("name = \"my_friction\"", "name = 3", "not a text"),
            ("name = \"my_friction\"", "names = 3", "no key names"),
            (
                "name = \"my_friction\"",
                "name = \"my_friction\"\nfamily = \"rust\"",
                "no family",
            ),
            ("c = 0", "c = 0\nd = 1", "d is not in the formula"),
            ("c = 0", "c = \"0\"", "c is not a number"),
            ("c = 0", "c = nan", "outside its range"),
            ("c = 0", "c = 1e13", "outside its range"),
            ("c = 0", "c = {}", "has no value"),
            ("c = 0", "c = { value = 0, most = 1 }", "no key most"),
            ("c = 0", "c = { value = 0, hold = 1 }", "not true or false"),
            ("c = 0", "c = { value = 0, unit = 1 }", "no short text"),
            ("c = 0", "c = 0\nth = 1", "th is a variable"),
            (
                "c = 0",
                "c = 0\nd1 = 1\nd2 = 1\nd3 = 1\nd4 = 1",
                "7 parameters",
            ),
            (
                "value = 0.02",
                "value = -0.02",
                "outside its range from 0.0 to 1.0",
            ),
            ("value = 0.02", "value = 1.02", "outside its range"),
            (
                "min = 0.0, max = 1.0",
                "min = 1.0, max = 0.0",
                "not below max",
            ),
            ("w/b", "w/b + log(th)", "the force is NaN at th = -0.01"),
            ("w/b", "sqrt(w)/b", "the force is NaN at"),
            ("c*th^3", "c/th", "the force is NaN at th = 0"),
            // The value is right, the end of its range is not.
            ("min = 0.001", "min = 0.0", "the force is NaN at"),
        ] {
            let text = MODEL.replace(from, to);
            let error = refused(&text);
            assert!(error.found.contains(found), "{to}: {error}");
            assert!(
                error.line.is_some() && !error.advice.is_empty(),
                "{to}: {error}"
            );
        }
        let none = MODEL.split("[effect.parameters]").next().unwrap();
        assert!(refused(none).found.contains("no parameters"));
        let twice = format!("{MODEL}{}", &MODEL[MODEL.find("[[effect]]").unwrap()..]);
        assert!(
            refused(&twice)
                .found
                .contains("a second effect my_friction; the first is in line")
        );
    }

    #[test]
    fn a_file_of_effects_holds_nothing_else() {
        let parse = |text: &str| OwnEffects::parse(text, Path::new("e.toml"));
        for (text, found) in [
            (String::new(), "is empty"),
            ("schema = 1\n".to_owned(), "has no effect"),
            (EFFECTS.replace("schema = 1", ""), "has no schema"),
            (
                EFFECTS.replace("\"pressed\"", "\"wave\""),
                "a second effect wave; the first is in line 4",
            ),
            (
                EFFECTS.replace("schema = 1", "schema = 1\nname = \"e\""),
                "no key name",
            ),
            (
                EFFECTS.replacen("\"custom\"", "\"gravity\"", 1),
                "effects with a formula",
            ),
            (
                format!("schema = 1\n{}", EFFECTS[10..].repeat(7)),
                "has 14 effects",
            ),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.found.contains(found), "{error}");
        }
    }

    #[test]
    fn the_same_text_is_kept_once() {
        let kind = |file: &ModelFile| file.model.effects().next().unwrap().kind();
        let (one, two) = (
            kind(&model(MODEL)),
            kind(&model(&MODEL.replace("0.02", "0.03"))),
        );
        let (Kind::Custom(one), Kind::Custom(two)) = (one, two) else {
            panic!("{one:?} {two:?}")
        };
        assert!(std::ptr::eq(one.0, two.0));
        let other = kind(&model(
            &MODEL.replace("max = 1.0, unit = \"N\"", "max = 2.0, unit = \"N\""),
        ));
        assert_ne!(other, Kind::Custom(one));
        assert!(
            one.0
                .text
                .contains("a = { min = 0.0, max = 1.0, unit = \"N\" }")
        );
    }

    #[test]
    fn the_board_is_not_given_a_formula() {
        let error = crate::settings_file::from_model(&model(MODEL)).unwrap_err();
        assert!(error.found.contains("my_friction by a formula"), "{error}");
        assert!(error.advice.contains("kind = \"table\""), "{error}");
    }

    const REMEMBERS: &str = r#"schema = 1
[[effect]]
kind = "custom"
name = "set"
force = "c*(th^3 - z)"
memory = { z = { follows = "th^3", time_constant = "tau" } }
parameters = { c = { value = 2.0, unit = "N/rad^3" }, tau = { value = 1.5, min = 0.1, max = 30 } }
"#;

    fn remembers(from: &str, to: &str) -> Result<OwnEffects, InputError> {
        assert!(REMEMBERS.contains(from), "{from}");
        OwnEffects::parse(&REMEMBERS.replace(from, to), Path::new("own.toml"))
    }

    #[test]
    fn a_memory_is_read_written_and_shown() {
        let own = remembers("", "").unwrap();
        let effect: Effect<f64> = own.kinds[0].build(&[2.0, 1.5]).unwrap();
        let at = Instant {
            time: 0.0,
            angle: 2.0,
            rate: 0.0,
            pressure: 0.0,
        };
        let mut rates = [0.0; 2];
        let force: f64 = effect.force(&at, &[5.0, 0.0], &mut rates);
        assert!((force - 6.0).abs() < 1e-12);
        assert!((rates[0] - 2.0).abs() < 1e-12 && rates[1].abs() < 1e-12);
        let info = own.kinds[0].info();
        assert_eq!(info.equation, "Q = c*(th^3 - z), dz/dt = (th^3 - z)/tau");
        assert_eq!(info.states[0].key, "z");
        assert_eq!(info.own_variable, None);
        let Effect::Custom(custom) = effect else {
            panic!("{effect:?}");
        };
        let shown = "Q = 2.00*(th^3 - z) N, dz/dt = (th^3 - z)/1.50";
        assert_eq!(with_numbers(&custom), shown);
        let mut document = toml_edit::DocumentMut::new();
        document["schema"] = toml_edit::value(1);
        let mut sections = toml_edit::ArrayOfTables::new();
        sections.push(section(&custom));
        document["effect"] = Item::ArrayOfTables(sections);
        let written = document.to_string();
        let again = OwnEffects::parse(&written, Path::new("own.toml"));
        assert_eq!(again.unwrap().kinds, own.kinds, "{written}");
    }

    #[test]
    fn a_memory_that_is_none_is_refused_with_its_place() {
        for (from, to, found) in [
            ("follows = \"th^3\"", "follows = \"th^^3\"", "memory.z: "),
            ("follows = \"th^3\"", "follows = \"z\"", "\"z\""),
            (
                "time_constant = \"tau\"",
                "time_constant = \"T\"",
                "parameter \"T\"",
            ),
            ("min = 0.1, ", "", "may become zero"),
            ("min = 0.1, ", "min = 0.0, ", "may become zero"),
            ("(th^3 - z)", "th^3", "the memory z is not in the formula"),
            ("z = {", "p = {", "p is a variable already"),
            ("z = {", "tau = {", "tau is a parameter already"),
            ("time_constant = ", "tau = ", "has no key tau"),
            (
                "{ z = { follows = \"th^3\", time_constant = \"tau\" } }",
                "{}",
                "no name",
            ),
            (
                "{ follows = \"th^3\", time_constant = \"tau\" }",
                "3",
                "lacks follows",
            ),
        ] {
            let error = remembers(from, to).unwrap_err().to_string();
            assert!(error.contains(found), "{to}: {error}");
            assert!(error.contains("own.toml, line"), "{error}");
        }
    }
}
