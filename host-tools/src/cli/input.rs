//! The flags of every command that reads recordings of other tools: which columns
//! hold what, and in which units.

use clap::Args;

use crate::io::columns::{self, AngleUnit, Columns, Layout, Names, PressureUnit, TimeUnit};

/// Where all recordings of a command stand in their files, if not in the columns `time_s`,
/// `pressure_kpa` and `angle_deg`.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "If the columns mean something else")]
pub struct InputArgs {
    /// The columns that hold the recording: time=t,pressure=p_psi,angle=theta. In an MCAP
    /// file topics: pressure=/rig/pressure.data. [recording] in the model file says the
    /// same for good
    #[arg(long, value_name = "WHICH=COLUMN,…", value_parser = Names::parse)]
    columns: Vec<Names>,
    /// Their units: time=ms,pressure=psi,angle=rad. Known are s, ms, us, ns, min; kpa, psi,
    /// bar, mbar, mpa, pa, mmhg; deg, rad
    #[arg(long, value_name = "WHICH=UNIT,…", value_parser = Columns::of_units)]
    units: Vec<Columns>,
    /// Unit of the time, as --units time=UNIT
    #[arg(
        long,
        value_enum,
        value_name = "UNIT",
        hide = true,
        conflicts_with = "units"
    )]
    time_in: Option<TimeUnit>,
    /// Unit of the pressure, as --units pressure=UNIT
    #[arg(
        long,
        value_enum,
        value_name = "UNIT",
        hide = true,
        conflicts_with = "units"
    )]
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
    /// Unit of the angle, as --units angle=UNIT
    #[arg(
        long,
        value_enum,
        value_name = "UNIT",
        hide = true,
        conflicts_with = "units"
    )]
    angle_in: Option<AngleUnit>,
    /// The angle counts the other way round: change its sign
    #[arg(long)]
    flip_angle: bool,
    /// Pressure and angle stand in each other's column
    #[arg(long)]
    exchange_columns: bool,
}

impl InputArgs {
    /// Where the recordings stand, as far as the command line says.
    pub fn layout(&self) -> Layout {
        let said = Columns {
            time: self.time_in,
            pressure: self.pressure_in,
            air_kpa: self.absolute_pressure,
            angle: self.angle_in,
            flip_angle: self.flip_angle,
            exchange: self.exchange_columns,
        };
        Layout {
            // Of two that contradict each other the later counts, as everywhere.
            names: self
                .columns
                .iter()
                .fold(Names::default(), |earlier, later| later.or(&earlier)),
            columns: self
                .units
                .iter()
                .fold(said, |earlier, later| later.or(earlier)),
        }
    }
}

fn air(text: &str) -> Result<f64, String> {
    columns::air(text.parse().unwrap_or(f64::NAN))
}
