//! What the columns of a file hold, where that is not what their header says.
//!
//! The header of a recording promises seconds, gauge pressure in kPa and degrees.
//! Files of other tools keep the header and break the promise. Said once, where
//! the file is read, everything behind works in one set of units.

use clap::ValueEnum;

use crate::recording::PASCAL_PER_KPA;

/// Pressure of the air at sea level (kPa), the standard atmosphere.
pub const ATMOSPHERE_KPA: f64 = 101.325;

/// Checks the pressure of the air (kPa); zero says that the column is gauge pressure.
///
/// # Errors
///
/// Says what it can be.
pub fn air(kpa: f64) -> Result<f64, String> {
    /// Beyond what the weather does at sea level.
    const MOST: f64 = 110.0;
    if (0.0..=MOST).contains(&kpa) {
        Ok(kpa)
    } else {
        Err(format!(
            "give the pressure of the air, from 0 to {MOST} kPa; at sea level it is {ATMOSPHERE_KPA}"
        ))
    }
}

/// Unit of the column `time_s`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TimeUnit {
    /// Seconds
    S,
    /// Milliseconds
    Ms,
}

impl TimeUnit {
    /// Seconds in the unit.
    pub fn seconds(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e-3,
        }
    }
}

/// Unit of the column `pressure_kpa`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PressureUnit {
    /// Kilopascals
    Kpa,
    /// Pounds-force per square inch
    Psi,
    /// Bars
    Bar,
    /// Megapascals
    Mpa,
    /// Pascals
    Pa,
}

impl PressureUnit {
    /// Kilopascals in the unit.
    pub fn kilopascals(self) -> f64 {
        match self {
            Self::Kpa => 1.0,
            Self::Psi => 6.894_757,
            Self::Bar => 100.0,
            Self::Mpa => 1e3,
            Self::Pa => 1e-3,
        }
    }

    /// The symbol of the unit.
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Kpa => "kPa",
            Self::Psi => "psi",
            Self::Bar => "bar",
            Self::Mpa => "MPa",
            Self::Pa => "Pa",
        }
    }

    /// The unit as `--pressure-in` takes it.
    pub fn flag(self) -> &'static str {
        match self {
            Self::Kpa => "kpa",
            Self::Psi => "psi",
            Self::Bar => "bar",
            Self::Mpa => "mpa",
            Self::Pa => "pa",
        }
    }
}

/// Unit of the column `angle_deg`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum AngleUnit {
    /// Degrees
    Deg,
    /// Radians
    Rad,
}

impl AngleUnit {
    /// Degrees in the unit.
    pub fn degrees(self) -> f64 {
        match self {
            Self::Deg => 1.0,
            Self::Rad => 1f64.to_degrees(),
        }
    }
}

/// What the columns hold. A field that is `None` or false was not said: then the
/// header counts, and may be doubted. What was said is not doubted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Columns {
    /// Unit of the times.
    pub time: Option<TimeUnit>,
    /// Unit of the pressure.
    pub pressure: Option<PressureUnit>,
    /// The pressure is absolute, and that of the air is this (kPa).
    pub air_kpa: Option<f64>,
    /// Unit of the angle.
    pub angle: Option<AngleUnit>,
    /// The angle counts the other way round.
    pub flip_angle: bool,
    /// Pressure and angle stand in each other's column.
    pub exchange: bool,
}

impl Columns {
    /// Time (s), gauge pressure (kPa) and angle (°) of a row of the file.
    pub fn read(&self, [time, mut pressure, mut angle]: [f64; 3]) -> [f64; 3] {
        if self.exchange {
            (pressure, angle) = (angle, pressure);
        }
        let time = time * self.time.map_or(1.0, TimeUnit::seconds);
        let pressure = pressure * self.pressure.map_or(1.0, PressureUnit::kilopascals)
            - self.air_kpa.unwrap_or(0.0);
        let angle = angle * self.angle.map_or(1.0, AngleUnit::degrees);
        [time, pressure, if self.flip_angle { -angle } else { angle }]
    }

    /// A sample (s, Pa, rad) of a recording that was read as its header says, as
    /// it would have been read with these columns.
    pub fn read_again(&self, [time, pressure, angle]: [f64; 3]) -> [f64; 3] {
        let [time, pressure, angle] =
            self.read([time, pressure / PASCAL_PER_KPA, angle.to_degrees()]);
        [time, pressure * PASCAL_PER_KPA, angle.to_radians()]
    }

    /// The flags of the command line that say so.
    pub fn flags(&self) -> String {
        let mut flags = Vec::new();
        match self.time {
            Some(TimeUnit::S) => flags.push("--time-in s".to_owned()),
            Some(TimeUnit::Ms) => flags.push("--time-in ms".to_owned()),
            None => {}
        }
        if let Some(unit) = self.pressure {
            flags.push(format!("--pressure-in {}", unit.flag()));
        }
        if let Some(air) = self.air_kpa {
            flags.push(if (air - ATMOSPHERE_KPA).abs() < 1e-9 {
                "--absolute-pressure".to_owned()
            } else {
                format!("--absolute-pressure={air}")
            });
        }
        match self.angle {
            Some(AngleUnit::Deg) => flags.push("--angle-in deg".to_owned()),
            Some(AngleUnit::Rad) => flags.push("--angle-in rad".to_owned()),
            None => {}
        }
        if self.flip_angle {
            flags.push("--flip-angle".to_owned());
        }
        if self.exchange {
            flags.push("--exchange-columns".to_owned());
        }
        flags.join(" ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: [f64; 3], expected: [f64; 3]) {
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4, "{found} is not {expected}");
        }
    }

    #[test]
    fn every_unit_is_converted() {
        let nothing = Columns::default();
        assert_near(nothing.read([1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        for (unit, kpa) in [
            (PressureUnit::Kpa, 1.0),
            (PressureUnit::Psi, 6.894_757),
            (PressureUnit::Bar, 100.0),
            (PressureUnit::Mpa, 1_000.0),
            (PressureUnit::Pa, 0.001),
        ] {
            let columns = Columns {
                pressure: Some(unit),
                ..nothing
            };
            assert_near(columns.read([0.0, 1.0, 0.0]), [0.0, kpa, 0.0]);
        }
        let columns = Columns {
            time: Some(TimeUnit::Ms),
            angle: Some(AngleUnit::Rad),
            flip_angle: true,
            ..nothing
        };
        assert_near(columns.read([1_500.0, 0.0, 1.0]), [1.5, 0.0, -57.29578]);
    }

    #[test]
    fn the_air_is_taken_off_in_kilopascals_and_columns_are_exchanged_first() {
        let columns = Columns {
            pressure: Some(PressureUnit::Psi),
            air_kpa: Some(ATMOSPHERE_KPA),
            exchange: true,
            ..Columns::default()
        };
        // 14.696 psi is the standard atmosphere.
        assert_near(columns.read([0.0, 30.0, 14.69595]), [0.0, 0.0, 30.0]);
        assert_eq!(
            columns.flags(),
            "--pressure-in psi --absolute-pressure --exchange-columns"
        );
    }
}
