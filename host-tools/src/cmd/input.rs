//! The flags of every command that reads recordings of other tools: what their
//! columns hold.

use clap::Args;

use crate::columns::{self, AngleUnit, Columns, PressureUnit, TimeUnit};

/// What the columns of all recordings hold, if not what their header says.
#[derive(Clone, Copy, Debug, Default, Args)]
#[command(next_help_heading = "If the columns mean something else")]
pub struct InputArgs {
    /// Unit of the column time_s
    #[arg(long, value_enum, value_name = "UNIT")]
    time_in: Option<TimeUnit>,
    /// Unit of the column pressure_kpa
    #[arg(long, value_enum, value_name = "UNIT")]
    pressure_in: Option<PressureUnit>,
    /// The pressure is absolute: take off that of the air, 101.325 kPa if no
    /// other is given
    #[arg(
        long,
        value_name = "KPA",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "101.325",
        value_parser = air
    )]
    absolute_pressure: Option<f64>,
    /// Unit of the column angle_deg
    #[arg(long, value_enum, value_name = "UNIT")]
    angle_in: Option<AngleUnit>,
    /// The angle counts the other way round: change its sign
    #[arg(long)]
    flip_angle: bool,
    /// Pressure and angle stand in each other's column
    #[arg(long)]
    exchange_columns: bool,
}

impl InputArgs {
    /// What the columns hold.
    pub fn columns(&self) -> Columns {
        Columns {
            time: self.time_in,
            pressure: self.pressure_in,
            air_kpa: self.absolute_pressure,
            angle: self.angle_in,
            flip_angle: self.flip_angle,
            exchange: self.exchange_columns,
        }
    }
}

fn air(text: &str) -> Result<f64, String> {
    columns::air(text.parse().unwrap_or(f64::NAN))
}
