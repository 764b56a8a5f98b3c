//! `softrig schema`: JSON Schemas of what commands write, and of files that people write.

use clap::Parser;
use schemars::{Schema, schema_for};
use serde_json::Value;
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantArray};

use super::choice::choice;
use super::{compare, fit, init, linearise, materials, plan, record, residuals, simulate};
use crate::commission::Report;
use softrig::board_gap::BoardGap;
use softrig_formats::{model_schema, protocol_schema};

/// Prints a JSON Schema: of what a command writes with --json, or of a model or protocol file.
#[derive(Debug, Parser)]
#[command(after_help = "\
Examples:
  softrig schema > verdict.schema.json
  softrig schema fit > fit.schema.json
  softrig schema model > model.schema.json     for an editor that checks TOML")]
pub struct Args {
    /// The command, or the file
    #[arg(value_parser = choice::<Of>(), default_value_t = Of::Diagnose)]
    of: Of,
}

/// What has a schema.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantArray,
    strum::Display,
)]
#[strum(serialize_all = "lowercase")]
pub enum Of {
    /// The verdict of softrig diagnose and softrig next
    #[default]
    Diagnose,
    /// What softrig fit --json writes
    Fit,
    /// What softrig compare --json writes
    Compare,
    /// What softrig gap --json writes
    Gap,
    /// What softrig residuals --json writes
    Residuals,
    /// What softrig linearise --json writes
    Linearise,
    /// What softrig materials --json writes
    Materials,
    /// What softrig plan --json writes
    Plan,
    /// What softrig simulate --json writes
    Simulate,
    /// What softrig init --json writes
    Init,
    /// What softrig record --list --json writes
    Record,
    /// What softrig commission --json writes
    Commission,
    /// A model file
    Model,
    /// A protocol file
    Protocol,
}

/// Runs the command.
///
/// # Errors
///
/// That the reader has seen enough.
pub fn run(args: &Args) -> anyhow::Result<()> {
    let of_command = |schema: Schema| -> Value { schema.into() };
    let schema = match args.of {
        Of::Diagnose => softrig::diagnose::decide::verdict::schema(),
        Of::Fit => of_command(schema_for!(fit::FitResult)),
        Of::Compare => of_command(schema_for!(compare::Errors)),
        Of::Gap => of_command(schema_for!(BoardGap)),
        Of::Residuals => of_command(schema_for!(residuals::Analysis)),
        Of::Linearise => of_command(schema_for!(linearise::Linearised)),
        Of::Materials => of_command(materials::json::schema()),
        Of::Plan => of_command(schema_for!(plan::Plan)),
        Of::Simulate => of_command(schema_for!(simulate::Simulated)),
        Of::Init => of_command(schema_for!(init::FirstResult)),
        Of::Record => of_command(schema_for!(record::Protocols)),
        Of::Commission => of_command(schema_for!(Report)),
        Of::Model => model_schema::schema(),
        Of::Protocol => protocol_schema::schema(),
    };
    Ok(super::print(&super::json::text_of(&schema)?)?)
}
