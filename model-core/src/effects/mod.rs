//! What an effect is, and one file for each.
//!
//! An effect is a piece of physics that a real rig adds to the base equation. [`Mechanism`]
//! says what it does in each of the four places where it can act.
//!
//! To add an effect, write a file here and name it in [`crate::catalogue`]; tests say what else
//! must know. `docs/effects.md` is written from what the files here say.

use crate::dynamics::{Dynamics, Rates};
use crate::real::Real;
pub use info::{Change, Doubtful, Family, Info, Need, Place, State};

pub mod angle_dependent_damping;
pub mod asymmetric_damping;
pub mod bouc_wen_hysteresis;
pub mod coulomb_friction;
pub mod cubic_stiffness;
#[cfg(feature = "desktop")]
pub mod custom;
pub mod dead_time;
pub mod end_stop;
pub mod exponent_shift;
pub mod gravity;
mod info;
pub mod input_backlash;
pub mod leak;
pub mod linear_stiffness;
pub mod maxwell_branch;
pub mod mullins_softening;
pub mod periodic_disturbance;
pub mod pneumatic_lag;
pub mod pressure_stiffening;
pub mod pressure_threshold;
pub mod quadratic_damping;
pub mod second_mode;
pub mod sensor_drift;
pub mod sensor_lag;
pub mod sensor_nonlinearity;
pub mod sensor_offset;
pub mod stiffness_drift;
pub mod stribeck_friction;
pub mod table;
#[cfg(feature = "desktop")]
pub mod tip_load;
pub mod vent_asymmetry;

/// Hidden states of one effect; unused ones stay zero.
pub type Hidden<R> = [R; 2];

/// What an effect can see at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instant<R> {
    /// Time since the start of the run (s).
    pub time: R,
    /// Bending angle θ (rad).
    pub angle: R,
    /// Angular rate θ̇ (rad/s).
    pub rate: R,
    /// Gauge pressure in the chamber (Pa), behind the input path.
    pub pressure: R,
}

/// Where a run starts: what hidden states settle to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest<R> {
    /// Bending angle θ (rad) at which what has a past has settled.
    pub angle: R,
    /// Bending angle θ (rad) at which the run starts: the same unless the run was cut out of a
    /// longer one.
    pub start: R,
    /// Angular rate θ̇ (rad/s); zero unless the run starts in motion.
    pub rate: R,
    /// Gauge pressure (Pa) that enters the effect.
    pub pressure: R,
    /// Angle (rad) that the effect's sensor sees, behind the effects before it.
    pub reading: R,
}

/// An angle and its rate, on either side of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<R> {
    /// Angle (rad).
    pub angle: R,
    /// Its rate (rad/s).
    pub rate: R,
}

/// The sign of the rate in a friction, smoothed as tanh(ω/w).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sign<R> {
    /// The width w (rad/s): within half of it the sign is a viscous damping.
    pub width: R,
    /// The rate (rad/s) beyond which the friction does not depend on the rate any more, to
    /// 10⁻⁴ of it.
    pub saturated: R,
    /// What its slope at rest adds to the fastest rate of the equations (1/s).
    pub relaxation: R,
}

/// What an effect does. Every method defaults to doing nothing.
///
/// | place | method | example |
/// |---|---|---|
/// | input path | [`Mechanism::delay`], [`Mechanism::input`] | lag of the tube |
/// | parameters | [`Mechanism::modulate`] | exponent, drift of the stiffness |
/// | force | [`Mechanism::force`] | friction, gravity |
/// | sensor path | [`Mechanism::sensor`] | lag of the sensor |
///
/// Several effects form a chain on the input path and another on the sensor path, in the order
/// of the model: each sees what the one before it leaves.
///
/// Hidden states are integrated with the motion if [`Mechanism::integrates`] says so and they
/// have a rate. One without a rate is a memory of events that [`Mechanism::note`] updates after a
/// step, such as the largest angle so far.
pub trait Mechanism<R: Real> {
    /// Whether hidden states are integrated with the motion.
    fn integrates(&self) -> bool {
        false
    }
    /// Hidden states after a long rest.
    fn at_rest(&self, _rest: &Rest<R>) -> Hidden<R> {
        [R::zero(); 2]
    }
    /// Time (s) by which the pressure reaches the chamber late.
    fn delay(&self) -> R {
        R::zero()
    }
    /// Maps the pressure (Pa) that enters to the pressure that leaves, and
    /// sets the rates of the hidden states.
    fn input(&self, pressure: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        pressure
    }
    /// Whether [`Mechanism::modulate`] does anything. With derivatives a set of parameters is
    /// half a kilobyte, which most models need not copy.
    fn modulates(&self) -> bool {
        false
    }
    /// Changes the parameters of the base equation at an instant.
    fn modulate(&self, _at: &Instant<R>, _hidden: &Hidden<R>, _dynamics: &mut Dynamics<R>) {}
    /// Changes the parameters of the base equation to the largest that they
    /// become for angles up to `angle` (rad): what [`Mechanism::fastest_rate`]
    /// and a step length have to reckon with.
    fn enlarge(&self, _angle: R, _dynamics: &mut Dynamics<R>) {}
    /// The force Q (N) against the motion, and the rates of the hidden states.
    fn force(&self, _at: &Instant<R>, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        R::zero()
    }
    /// Sets the rates of hidden states that answer to the acceleration
    /// (rad/s²).
    fn respond(&self, _acceleration: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) {}
    /// Maps the angle (rad) that the sensor sees to the one that it shows, and
    /// sets the rates of the hidden states.
    fn sensor(&self, angle: R, _time: R, _hidden: &Hidden<R>, _rates: &mut Hidden<R>) -> R {
        angle
    }
    /// The pressure (Pa) that enters at rest when this one leaves: the inverse
    /// of [`Mechanism::input`].
    fn pressure_behind(&self, pressure: R) -> R {
        pressure
    }
    /// The pressure (Pa) that has to enter from now on for this one to leave: of a play, on the
    /// side to which the chamber moves; of a leak, with what it has lost. A lag passes
    /// everything on sooner or later.
    fn pressure_towards(&self, pressure: R, _hidden: &Hidden<R>) -> R {
        self.pressure_behind(pressure)
    }
    /// The motion that enters the sensor at the start of a run when this one
    /// leaves: the inverse of [`Mechanism::sensor`].
    fn behind(&self, shown: Motion<R>) -> Motion<R> {
        shown
    }
    /// Turns the base of the actuator further, by an angle (rad).
    fn turn(&mut self, _by: R) {}
    /// Lengthens the tube to the actuator by a factor.
    fn lengthen_tube(&mut self, _times: R) {}
    /// Whether the stiffness depends on the pressure.
    fn stiffens(&self) -> bool {
        false
    }
    /// Whether [`Mechanism::note`] does anything.
    fn has_memory(&self) -> bool {
        false
    }
    /// Updates a memory of events after a step that arrived at `angle` (rad)
    /// and at the pressure (Pa) that enters the effect.
    fn note(&self, _angle: R, _pressure: R, _hidden: &mut Hidden<R>) {}
    /// The smoothed sign of a friction; none for an effect without one.
    fn sign(&self, _dynamics: &Dynamics<R>) -> Option<Sign<R>> {
        None
    }
    /// Whether what it adds to the fastest rate swings beside the actuator and not with it.
    fn swings_beside(&self) -> bool {
        false
    }
    /// The rate (rad/s) on which [`Mechanism::fastest_rate`] counts where its relaxation is in
    /// proportion to the rate, and that relaxation (1/s): at rest there is none of it.
    fn winds(&self, _angle: R) -> Option<[R; 2]> {
        None
    }
    /// How much the effect adds to the fastest rate of the equations, for
    /// angles up to `angle` (rad).
    fn fastest_rate(&self, _dynamics: &Dynamics<R>, _angle: R) -> Rates<R> {
        Rates {
            stiffness: R::zero(),
            relaxation: R::zero(),
        }
    }
}

/// 2π. In two parts, since a constant in the source is an `f32`: wider scalars
/// get sixteen digits of it.
pub(crate) fn full_turn<R: Real>() -> R {
    R::from_f32(core::f32::consts::TAU) - R::from_f32(1.748_455_6e-7)
}

/// The unit of a parameter in files. Inside, everything is SI and radians; the unit also tells a
/// fit the natural size of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Unit {
    /// Dimensionless.
    One,
    /// N, a generalised force.
    Newton,
    /// kg·m, an effective inertia.
    KilogramMetre,
    /// N·s/rad.
    NewtonSecondPerRad,
    /// N/radⁿ, n the exponent of Ludwick's law.
    NewtonPerRadToTheN,
    /// N/kPa in files, N/Pa inside.
    NewtonPerKiloPascal,
    /// N/rad.
    NewtonPerRad,
    /// N/rad³.
    NewtonPerRad3,
    /// N·s²/rad².
    NewtonSecond2PerRad2,
    /// rad.
    Radian,
    /// rad/s.
    RadianPerSecond,
    /// s.
    Second,
    /// 1/s.
    PerSecond,
    /// Hz.
    Hertz,
    /// 1/rad.
    PerRadian,
    /// 1/kPa in files, 1/Pa inside.
    PerKiloPascal,
    /// kPa in files, Pa inside.
    KiloPascal,
    /// N/kg, a generalised force by a mass.
    #[cfg(feature = "desktop")]
    NewtonPerKilogram,
    /// m.
    #[cfg(feature = "desktop")]
    Metre,
    /// What a user says of a parameter of a formula, which is taken as it is.
    #[cfg(feature = "desktop")]
    Given(&'static str),
}

impl Unit {
    /// The unit's symbol as it is printed.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::One => "",
            Self::Newton => "N",
            Self::KilogramMetre => "kg·m",
            Self::NewtonSecondPerRad => "N·s/rad",
            Self::NewtonPerRadToTheN => "N/radⁿ",
            Self::NewtonPerKiloPascal => "N/kPa",
            Self::NewtonPerRad => "N/rad",
            Self::NewtonPerRad3 => "N/rad³",
            Self::NewtonSecond2PerRad2 => "N·s²/rad²",
            Self::Radian => "rad",
            Self::RadianPerSecond => "rad/s",
            Self::Second => "s",
            Self::PerSecond => "1/s",
            Self::Hertz => "Hz",
            Self::PerRadian => "1/rad",
            Self::PerKiloPascal => "1/kPa",
            Self::KiloPascal => "kPa",
            #[cfg(feature = "desktop")]
            Self::NewtonPerKilogram => "N/kg",
            #[cfg(feature = "desktop")]
            Self::Metre => "m",
            #[cfg(feature = "desktop")]
            Self::Given(symbol) => symbol,
        }
    }

    /// Whether it measures a force, or a force per something: twice the value makes the effect
    /// twice as strong.
    pub const fn is_force(self) -> bool {
        #[cfg(feature = "desktop")]
        if let Self::Given(symbol) = self {
            // N, or N per something.
            return matches!(
                symbol.as_bytes(),
                [b'N'] | [b'N', b'/' | b'*' | b' ', ..] | [b'N', 0xC2, 0xB7, ..]
            );
        }
        #[cfg(feature = "desktop")]
        if matches!(self, Self::NewtonPerKilogram) {
            return true;
        }
        matches!(
            self,
            Self::Newton | Self::NewtonPerRad | Self::NewtonPerRad3 | Self::NewtonSecond2PerRad2
        )
    }

    /// Converts a value from a file to SI units.
    pub fn to_si<R: Real>(self, value: R) -> R {
        match self {
            Self::KiloPascal => value * R::from_i16(1000),
            Self::PerKiloPascal | Self::NewtonPerKiloPascal => value / R::from_i16(1000),
            _ => value,
        }
    }

    /// Converts a value in SI units to the unit of files.
    pub fn from_si<R: Real>(self, value: R) -> R {
        match self {
            Self::KiloPascal => value / R::from_i16(1000),
            Self::PerKiloPascal | Self::NewtonPerKiloPascal => value * R::from_i16(1000),
            _ => value,
        }
    }
}

/// One row of a parameter table: of an effect, or of the base equation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Key in model files and verdicts, with its unit.
    pub key: &'static str,
    /// Symbol in the equation.
    pub symbol: &'static str,
    /// Unit in files.
    pub unit: Unit,
    /// Smallest value allowed, in SI units.
    pub lower: f32,
    /// Largest value allowed, in SI units.
    pub upper: f32,
    /// Value that a file may leave out and that a first fit holds; none for a
    /// parameter that has to be found.
    pub held: Option<f32>,
    /// Value that a file may leave out of a parameter that is fitted all the same.
    pub default: Option<f32>,
    /// Where fits start: seconds, hertz, radians and dimensionless numbers as
    /// they are, other units relative to the size that the recordings suggest. A
    /// held parameter without starts is never fitted.
    pub starts: &'static [f32],
}

impl Parameter {
    /// The value of a file that leaves the parameter out; none if it must be
    /// there.
    pub const fn left_out(&self) -> Option<f32> {
        match self.held {
            Some(held) => Some(held),
            None => self.default,
        }
    }
}

/// Declares the parameters of an effect once: as the fields of a struct and as the table that
/// files, fits and reports read. With `@table` in front, those of a struct that is not an effect.
macro_rules! parameters {
    (
        $(#[$outer:meta])*
        $name:ident { $($rows:tt)+ }
    ) => {
        $crate::effects::parameters! { @table $(#[$outer])* $name { $($rows)+ } }

        impl $name<()> {
            /// What the catalogue says about it.
            pub const INFO: &'static $crate::effects::Info = &INFO;
        }
    };
    (
        @table
        $(#[$outer:meta])*
        $name:ident {
            $( $(#[$inner:meta])* $field:ident: $row:expr ),+ $(,)?
        }
    ) => {
        $(#[$outer])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name<R> {
            $( $(#[$inner])* pub $field: R, )+
        }

        impl $name<()> {
            /// The parameter table, in the order of the fields.
            pub const PARAMETERS: &'static [$crate::effects::Parameter] = &[$( $row ),+];

            /// The names of the fields, in the order of the table.
            pub const FIELDS: &'static [&'static str] = &[$( stringify!($field) ),+];

            /// Rows of the table. Like [`Self::bounds`] this is code, not data, so that a board can
            /// ask without holding the table in RAM.
            pub const COUNT: usize = [$( stringify!($field) ),+].len();

            /// Smallest and largest value of the parameter at `index`, in SI
            /// units; none beyond the table.
            pub const fn bounds(index: usize) -> Option<(f32, f32)> {
                // Counted down instead of matched, since the rows of a
                // repetition have no numbers. Each bound is a constant of its
                // own: a constant pair would be copied from memory.
                let mut rows_before = index;
                $(
                    if rows_before == 0 {
                        return Some((const { ($row).lower }, const { ($row).upper }));
                    }
                    rows_before = rows_before.wrapping_sub(1);
                )+
                let _ = rows_before;
                None
            }
        }

        impl<R: Copy> $name<R> {
            /// Creates it from values in the order of the table; none if their
            /// number differs.
            pub fn from_values(values: &[R]) -> Option<Self> {
                let [$( $field ),+] = *values else { return None };
                Some(Self { $( $field ),+ })
            }

            /// Converts every parameter with `f`.
            pub fn map<S>(&self, mut f: impl FnMut(R) -> S) -> $name<S> {
                $name { $( $field: f(self.$field) ),+ }
            }

            /// The parameter at `index` of the table.
            pub fn value(&self, index: usize) -> Option<R> {
                [$( self.$field ),+].get(index).copied()
            }

            /// Replaces the parameter at `index`; ignores an index beyond the
            /// table.
            pub fn set_value(&mut self, index: usize, value: R) {
                if let Some(place) = [$( &mut self.$field ),+].into_iter().nth(index) {
                    *place = value;
                }
            }
        }
    };
}
pub(crate) use parameters;

#[cfg(test)]
pub(crate) mod testing;
