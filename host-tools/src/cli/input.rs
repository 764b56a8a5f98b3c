//! Flags of all commands that read recordings: which columns hold what, and in which units.

use clap::Args;

use super::choice::choice;
use softrig_formats::bounded::read_text;
use softrig_formats::columns::{self, AngleUnit, Columns, Layout, Names, PressureUnit, TimeUnit};
use softrig_formats::error::InputError;
use softrig_formats::model_file::recording_layout;
use softrig_link::rig_file::rig_file;

/// The layout of all recordings of a command, if their columns are not `time_s`,
/// `pressure_kpa` and `angle_deg`.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "If the columns mean something else")]
#[allow(clippy::struct_excessive_bools)] // Flags, each with a name of its own.
pub struct InputArgs {
    /// The columns of the recording: time=t,pressure=p_psi,angle=theta; by their numbers, time=#1,
    /// where there is no header. For MCAP files, topics: pressure=/rig/pressure.data,
    /// angle=/joint_states.position[0]. The section [recording] of the model file sets
    /// the same permanently
    #[arg(long, value_name = "WHICH=COLUMN,…", value_parser = Names::parse)]
    columns: Vec<Names>,
    /// Units of these columns: time=ms,pressure=psi,angle=rad. Time: s, ms, us, ns, min, day;
    /// pressure: kpa, psi, bar, mbar, mpa, pa, mmhg; angle: deg, rad, or
    /// mm, cm, um, mv of an output that is no angle
    #[arg(long, value_name = "WHICH=UNIT,…", value_parser = Columns::of_units)]
    units: Vec<Columns>,
    /// Linear scale by two points, FILE:VALUE: pressure=101:0,512:100; for a plain factor write
    /// --units 'pressure=psi*100', for values times 100
    #[arg(long, value_name = "WHICH=POINTS", value_parser = Columns::of_scale)]
    scale: Vec<Columns>,
    /// Unit of the time, as --units time=UNIT
    #[arg(
        long,
        value_parser = choice::<TimeUnit>(),
        value_name = "UNIT",
        hide = true,
        conflicts_with = "units"
    )]
    time_in: Option<TimeUnit>,
    /// Unit of the pressure, as --units pressure=UNIT
    #[arg(
        long,
        value_parser = choice::<PressureUnit>(),
        value_name = "UNIT",
        hide = true,
        conflicts_with = "units"
    )]
    pressure_in: Option<PressureUnit>,
    /// The pressure is absolute: subtract air pressure [default: 101.325 kPa]
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
        value_parser = choice::<AngleUnit>(),
        value_name = "UNIT",
        hide = true,
        conflicts_with = "units"
    )]
    angle_in: Option<AngleUnit>,
    /// Angle at rest, in degrees: subtracted before any sign change
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = finite)]
    angle_zero: Option<f64>,
    /// Change the sign of the angle
    #[arg(long)]
    flip_angle: bool,
    /// Skip this many lines at the start of a text table; not needed for lines above a header with
    /// the required names
    #[arg(long, value_name = "N")]
    skip_rows: Option<u64>,
    /// Refuse a file with malformed lines; otherwise up to 5 % of lines are left out and counted
    #[arg(long)]
    strict: bool,
    /// Exchange the columns of pressure and angle
    #[arg(long)]
    exchange_columns: bool,
    /// The pressure is band-limited to half the sampling rate, such as a multisine through a
    /// reconstruction filter: interpolate it exactly, not by a smooth curve
    #[arg(long)]
    band_limited: bool,
}

/// The layout of the recordings of a folder: the section `[recording]` of its `softrig.toml`.
///
/// # Errors
///
/// Names file, line, column and remedy.
pub fn layout_of_folder() -> Result<Layout, InputError> {
    let path = rig_file();
    if path.is_file() {
        recording_layout(&read_text(path)?, path)
    } else {
        Ok(Layout::default())
    }
}

impl InputArgs {
    /// How every command reads its recordings: as the command line says, then as the model file
    /// does (`model`; the default without one), then as the folder does.
    ///
    /// # Errors
    ///
    /// Faults of `softrig.toml`.
    pub fn layout_over(&self, model: &Layout) -> Result<Layout, InputError> {
        Ok(self.layout().or(model).or(&layout_of_folder()?))
    }

    /// The layout of the recordings given on the command line.
    pub fn layout(&self) -> Layout {
        let said = Columns {
            time: self.time_in,
            pressure: self.pressure_in,
            air_kpa: self.absolute_pressure,
            angle: self.angle_in,
            angle_zero_deg: self.angle_zero,
            flip_angle: self.flip_angle,
            exchange: self.exchange_columns,
            band_limited: self.band_limited,
            ..Columns::default()
        };
        Layout {
            // Of contradicting flags the later counts, as everywhere.
            names: self
                .columns
                .iter()
                .fold(Names::default(), |earlier, later| later.or(&earlier)),
            columns: self
                .units
                .iter()
                .chain(&self.scale)
                .fold(said, |earlier, later| later.or(earlier)),
            skip_rows: self.skip_rows,
            strict: self.strict,
            ..Layout::default()
        }
    }
}

fn finite(text: &str) -> Result<f64, String> {
    let number: Result<f64, _> = text.trim().parse();
    number
        .ok()
        .filter(|number| number.is_finite())
        .ok_or_else(|| "give a number of degrees".into())
}

fn air(text: &str) -> Result<f64, String> {
    columns::air(text.parse().unwrap_or(f64::NAN))
}
