//! The reader of all TOML files: sections, keys and numbers, with the place of errors.
//!
//! Models, protocols, settings and the user's effects are files that people write by hand. Every
//! error in them has file, line, column and advice.

use std::path::Path;

use toml_edit::{Document, Item, Table};

use super::error::InputError;
use super::recording::in_words;
use super::setup::Setup;

/// Reads sections of a TOML file and names the place of what is wrong with them.
pub(crate) struct Reader<'a> {
    /// The text of the file.
    pub(crate) text: &'a str,
    /// Its path, for messages.
    pub(crate) path: &'a Path,
}

impl Reader<'_> {
    /// A fault of the file as a whole.
    pub(crate) fn fail(&self, found: impl Into<String>, advice: impl Into<String>) -> InputError {
        InputError::new(found, advice).in_file(self.path)
    }

    /// A fault at a place.
    pub(crate) fn fail_at(
        &self,
        span: Option<std::ops::Range<usize>>,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> InputError {
        let error = self.fail(found, advice);
        match span {
            Some(span) => error.at_offset(self.text, span.start),
            None => error,
        }
    }

    /// The parsed file; what to do if it is empty.
    pub(crate) fn document(&self, start: &str) -> Result<Document<String>, InputError> {
        if self.text.trim().is_empty() {
            return Err(self.fail("is empty", start));
        }
        self.parse()
    }

    /// The parsed file, which may be empty.
    pub(crate) fn parse(&self) -> Result<Document<String>, InputError> {
        Document::parse(self.text.to_owned()).map_err(|error| {
            self.fail_at(
                error.span(),
                error.message().trim().replace('\n', ", "),
                "correct the TOML there",
            )
        })
    }

    /// Whether the file is of the version that is read.
    pub(crate) fn schema(&self, root: &Table, version: i64) -> Result<(), InputError> {
        let item = root.get("schema").ok_or_else(|| {
            self.fail(
                "has no schema number",
                format!("start it with `schema = {version}`"),
            )
        })?;
        if item.as_integer() == Some(version) {
            return Ok(());
        }
        Err(self.fail_at(
            item.span(),
            format!("schema is {}", item.to_string().trim()),
            format!("this version of softrig reads schema {version}: use the version that wrote the file, or correct the number"),
        ))
    }

    /// A section, if it is there.
    pub(crate) fn table<'t>(
        &self,
        root: &'t Table,
        key: &str,
    ) -> Result<Option<&'t Table>, InputError> {
        match root.get(key) {
            None => Ok(None),
            Some(Item::Table(table)) => Ok(Some(table)),
            Some(other) => Err(self.fail_at(
                other.span(),
                format!("{key} is not a section"),
                format!("write it as [{key}] with a key on each line below"),
            )),
        }
    }

    /// The sections of a list, in their order.
    pub(crate) fn sections<'t>(
        &self,
        root: &'t Table,
        key: &str,
    ) -> Result<Vec<&'t Table>, InputError> {
        match root.get(key) {
            None => Ok(Vec::new()),
            Some(Item::ArrayOfTables(tables)) => Ok(tables.iter().collect()),
            Some(other) => Err(self.fail_at(
                other.span(),
                format!("{key} is not a list of sections"),
                format!("write each {key} as a section [[{key}]] with a kind"),
            )),
        }
    }

    /// Refuses unknown keys: most are typing errors. `place` is the section in messages.
    pub(crate) fn known_keys(
        &self,
        table: &Table,
        place: &str,
        known: &[&str],
    ) -> Result<(), InputError> {
        for (key, item) in table {
            if !known.contains(&key) {
                let span = table
                    .key(key)
                    .and_then(toml_edit::Key::span)
                    .or(item.span());
                return Err(self.fail_at(
                    span,
                    format!("{place} has no key {key}"),
                    format!("remove it, or use one of: {}", known.join(", ")),
                ));
            }
        }
        Ok(())
    }

    /// A number, if it is there.
    pub(crate) fn number(&self, table: &Table, key: &str) -> Result<Option<f64>, InputError> {
        let Some(item) = table.get(key) else {
            return Ok(None);
        };
        let number = item
            .as_float()
            .or_else(|| item.as_integer().map(|whole| whole as f64));
        number.map(Some).ok_or_else(|| {
            self.fail_at(
                item.span(),
                format!("{key} is not a number"),
                "write a number without quotes and without a unit",
            )
        })
    }

    /// A number that has to be there.
    pub(crate) fn required(
        &self,
        table: &Table,
        section: &str,
        key: &str,
    ) -> Result<f64, InputError> {
        self.number(table, key)?.ok_or_else(|| {
            self.fail_at(
                table.span(),
                format!("[{section}] has no {key}"),
                format!("add `{key} = …` to that section"),
            )
        })
    }

    /// How the rig stood, if a section says it.
    pub(crate) fn setup(&self, root: &Table) -> Result<Option<Setup>, InputError> {
        let Some(table) = self.table(root, "setup")? else {
            return Ok(None);
        };
        let read: Result<Setup, _> = toml::from_str(&table.to_string());
        let setup = read.map_err(|error| {
            self.fail_at(
                table.span(),
                format!("[setup]: {}", in_words(error.message())),
                Setup::KNOWN,
            )
        })?;
        let refused = setup.check();
        refused.map_err(|fault| self.fail_at(table.span(), fault.found, fault.advice))?;
        Ok(Some(setup))
    }

    /// A text, if it is there.
    pub(crate) fn string(&self, table: &Table, key: &str) -> Result<Option<String>, InputError> {
        let Some(item) = table.get(key) else {
            return Ok(None);
        };
        item.as_str()
            .map(|text| Some(text.to_owned()))
            .ok_or_else(|| {
                self.fail_at(
                    item.span(),
                    format!("{key} is not a text"),
                    "write it in double quotes",
                )
            })
    }
}
