//! The catalogue of effects: one line per effect.
//!
//! Files, fits and reports reach effects through [`Kind`]; the integrator runs
//! them through [`Effect`], and the board through [`AnyPart`]. To add one, write its file in `effects/` and name
//! it in the list at the end of this file. A [`Table`] is not in that list, since
//! it has no fixed list of parameters.

use crate::actuator::Model;
use crate::dynamics::{Dynamics, Rates};
use crate::effects::table::{self, InModel, Table};
use crate::effects::{Hidden, Info, Instant, Mechanism, Motion, Parameter, Rest, Sign};
#[cfg(feature = "desktop")]
use crate::effects::{custom, tip_load};
#[cfg(test)]
use crate::part::Trial;
use crate::part::{Base, Part, Phases, Preparation, RateLaw, Step};
use crate::real::Real;

macro_rules! catalogue {
    ($( $module:ident::$name:ident ),+ $(,)?) => {
        use crate::effects::{$( $module ),+};

        /// The effects that are known.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[non_exhaustive]
        pub enum Kind {
            $(
                #[doc = concat!("See [`crate::effects::", stringify!($module), "`].")]
                $name,
            )+
            /// See [`crate::effects::table`].
            Table,
            /// See [`crate::effects::tip_load`].
            #[cfg(feature = "desktop")]
            TipLoad,
            /// See [`crate::effects::custom`].
            #[cfg(feature = "desktop")]
            Custom(custom::Formula),
        }

        /// An effect with its parameters.
        ///
        /// `T` represents a table: the table itself, or [`table::InModel`] where a model keeps it
        /// beside its slots.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[non_exhaustive]
        pub enum Effect<R, T = Table<R>> {
            $(
                #[doc = concat!("See [`crate::effects::", stringify!($module), "`].")]
                $name($module::$name<R>),
            )+
            /// See [`crate::effects::table`].
            Table(T),
            /// See [`crate::effects::tip_load`].
            #[cfg(feature = "desktop")]
            TipLoad(tip_load::TipLoad<R>),
            /// See [`crate::effects::custom`].
            #[cfg(feature = "desktop")]
            Custom(custom::Custom<R>),
        }

        /// What an effect does in a step, whichever it is.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[non_exhaustive]
        pub enum AnyPart {
            $(
                #[doc = concat!("See [`crate::effects::", stringify!($module), "`].")]
                $name(<$module::$name<f32> as Preparation>::Part),
            )+
            /// See [`crate::effects::table`].
            Table(table::OfTable),
            /// See [`crate::effects::tip_load`].
            #[cfg(feature = "desktop")]
            TipLoad(<tip_load::TipLoad<f32> as Preparation>::Part),
            /// See [`crate::effects::custom`].
            #[cfg(feature = "desktop")]
            Custom(<custom::Custom<f32> as Preparation>::Part),
        }

        /// One expression for whichever effect it is: `each!(self, effect => effect.delay())`.
        macro_rules! each {
            ($matched:expr, $effect:ident => $result:expr) => {
                each!($matched, $effect => $result, table $effect => $result)
            };
            // With another expression for a table.
            ($matched:expr, $effect:ident => $result:expr, table $table:pat => $other:expr) => {
                match $matched {
                    $( Self::$name($effect) => $result, )+
                    Self::Table($table) => $other,
                    #[cfg(feature = "desktop")]
                    Self::TipLoad($effect) => $result,
                    #[cfg(feature = "desktop")]
                    Self::Custom($effect) => $result,
                }
            };
        }

        /// One expression for the type of whichever effect a kind is, which is known by its
        /// `table`; what a table and a formula have instead comes last.
        macro_rules! each_kind {
            (
                $matched:expr,
                $effect:ident => $result:expr,
                table => $other:expr,
                $formula:ident => $given:expr
            ) => {
                match $matched {
                    $( Self::$name => { type $effect<R> = $module::$name<R>; $result } )+
                    Self::Table => $other,
                    #[cfg(feature = "desktop")]
                    Self::TipLoad => { type $effect<R> = tip_load::TipLoad<R>; $result }
                    #[cfg(feature = "desktop")]
                    Self::Custom($formula) => $given,
                }
            };
        }

        impl Kind {
            /// Every effect, in the order of the catalogue. Those that a user writes
            /// are in no list.
            pub const ALL: &'static [Self] = &[$( Self::$name, )+ Self::Table];

            /// Every effect that names a cause, in the order of the catalogue: what
            /// a search for causes goes through. See [`Self::is_name`].
            pub const NAMES: &'static [Self] = &[$( Self::$name ),+];

            /// [`Self::build`], for a slot of a model.
            pub fn build_slot<R: Copy, T>(self, values: &[R]) -> Option<Effect<R, T>> {
                Some(match self {
                    $( Self::$name => Effect::$name($module::$name::from_values(values)?), )+
                    Self::Table => return None,
                    #[cfg(feature = "desktop")]
                    Self::TipLoad => Effect::TipLoad(tip_load::TipLoad::from_values(values)?),
                    #[cfg(feature = "desktop")]
                    Self::Custom(formula) => {
                        Effect::Custom(custom::Custom::from_values(formula, values)?)
                    }
                })
            }
        }

        impl<R: Copy, T> Effect<R, T> {
            /// Which effect it is.
            pub const fn kind(&self) -> Kind {
                match self {
                    $( Self::$name(_) => Kind::$name, )+
                    Self::Table(_) => Kind::Table,
                    #[cfg(feature = "desktop")]
                    Self::TipLoad(_) => Kind::TipLoad,
                    #[cfg(feature = "desktop")]
                    Self::Custom(effect) => Kind::Custom(effect.formula()),
                }
            }

            /// Converts every parameter with `f`, and puts `table` in place of a
            /// table; none where there is no `table`.
            pub(crate) fn convert<S, U>(
                &self,
                f: impl FnMut(R) -> S,
                table: Option<U>,
            ) -> Option<Effect<S, U>> {
                Some(match self {
                    $( Self::$name(effect) => Effect::$name(effect.map(f)), )+
                    Self::Table(_) => Effect::Table(table?),
                    #[cfg(feature = "desktop")]
                    Self::TipLoad(effect) => Effect::TipLoad(effect.map(f)),
                    #[cfg(feature = "desktop")]
                    Self::Custom(effect) => Effect::Custom(effect.map(f)),
                })
            }
        }

        impl Effect<f32, InModel> {
            /// Prepares what it does in a step.
            #[inline(never)]
            pub(crate) fn prepare(&self, base: &Base) -> AnyPart {
                match self {
                    $( Self::$name(effect) => AnyPart::$name(effect.prepare(base)), )+
                    Self::Table(effect) => AnyPart::Table(effect.prepare(base)),
                    #[cfg(feature = "desktop")]
                    Self::TipLoad(effect) => AnyPart::TipLoad(effect.prepare(base)),
                    #[cfg(feature = "desktop")]
                    Self::Custom(effect) => AnyPart::Custom(effect.prepare(base)),
                }
            }
        }

        impl<R: Copy> Effect<R> {
            /// Converts every parameter with `f`.
            pub fn map<S>(&self, f: impl FnMut(R) -> S) -> Effect<S> {
                match self {
                    $( Self::$name(effect) => Effect::$name(effect.map(f)), )+
                    Self::Table(table) => Effect::Table(table.map(f)),
                    #[cfg(feature = "desktop")]
                    Self::TipLoad(effect) => Effect::TipLoad(effect.map(f)),
                    #[cfg(feature = "desktop")]
                    Self::Custom(effect) => Effect::Custom(effect.map(f)),
                }
            }
        }
    };
}

/// Hands the list of all effects, as `module::Type`, to a macro: all but the table,
/// which is no list of parameters.
///
/// For code outside of this crate that needs a constant for each effect and
/// must not forget one.
#[macro_export]
macro_rules! for_each_effect {
    ($callback:ident) => {
        $callback![
            coulomb_friction::CoulombFriction,
            stribeck_friction::StribeckFriction,
            quadratic_damping::QuadraticDamping,
            angle_dependent_damping::AngleDependentDamping,
            asymmetric_damping::AsymmetricDamping,
            maxwell_branch::MaxwellBranch,
            bouc_wen_hysteresis::BoucWenHysteresis,
            gravity::Gravity,
            exponent_shift::ExponentShift,
            cubic_stiffness::CubicStiffness,
            linear_stiffness::LinearStiffness,
            end_stop::EndStop,
            stiffness_drift::StiffnessDrift,
            mullins_softening::MullinsSoftening,
            second_mode::SecondMode,
            pneumatic_lag::PneumaticLag,
            dead_time::DeadTime,
            vent_asymmetry::VentAsymmetry,
            pressure_threshold::PressureThreshold,
            pressure_stiffening::PressureStiffening,
            input_backlash::InputBacklash,
            leak::Leak,
            sensor_lag::SensorLag,
            sensor_offset::SensorOffset,
            sensor_nonlinearity::SensorNonlinearity,
            sensor_drift::SensorDrift,
            periodic_disturbance::PeriodicDisturbance,
        ];
    };
}

for_each_effect!(catalogue);

impl Kind {
    /// Name, equation and texts.
    pub const fn info(self) -> &'static Info {
        each_kind!(
            self,
            Named => Named::<()>::INFO,
            table => &table::INFO,
            formula => &formula.0.info
        )
    }

    /// The parameter table.
    pub const fn parameters(self) -> &'static [Parameter] {
        each_kind!(
            self,
            Named => Named::<()>::PARAMETERS,
            table => table::PARAMETERS,
            formula => formula.0.parameters
        )
    }

    /// Rows of the parameter table, without the table: see [`Self::bounds`]. Of a [`Table`]
    /// the most that it can have.
    pub const fn parameter_count(self) -> usize {
        each_kind!(
            self,
            Named => Named::<()>::COUNT,
            table => table::MAX_NODES,
            formula => formula.0.parameters.len()
        )
    }

    /// Smallest and largest value of the parameter at `index` of the table, in SI units;
    /// none beyond it.
    ///
    /// The same numbers as in [`Self::parameters`], as code: a processor that keeps its
    /// constants in RAM pays for the texts and tables of the catalogue only where it asks for
    /// them.
    pub const fn bounds(self, index: usize) -> Option<(f32, f32)> {
        each_kind!(
            self,
            Named => Named::<()>::bounds(index),
            table => table::bounds(index),
            formula => formula.bounds(index)
        )
    }

    /// Cycles that it adds to a step on the board: see [`Preparation::CYCLES`].
    pub const fn cycles(self) -> u16 {
        each_kind!(
            self,
            Named => <Named<f32> as Preparation>::CYCLES,
            table => InModel::CYCLES,
            _formula => <custom::Custom<f32> as Preparation>::CYCLES
        )
    }

    /// How the steps of it are tested.
    #[cfg(test)]
    pub(crate) const fn trial(self) -> Trial {
        each_kind!(
            self,
            Named => <Named<f32> as Preparation>::TRIAL,
            table => InModel::TRIAL,
            _formula => <custom::Custom<f32> as Preparation>::TRIAL
        )
    }

    /// Creates the effect from values in SI units, in the order of the table; none if their
    /// number differs, and none for a [`Table`], which needs nodes ([`Table::new`]). Bounds
    /// are checked when a model is made of it.
    pub fn build<R: Copy>(self, values: &[R]) -> Option<Effect<R>> {
        self.build_slot(values)
    }
}

impl<R: Copy, T> Effect<R, T> {
    /// The value at `index` of the parameter table; none for a table.
    pub(crate) fn slot_value(&self, index: usize) -> Option<R> {
        each!(self, effect => effect.value(index), table _ => None)
    }

    /// Replaces the value at `index`; nothing for a table.
    pub(crate) fn set_slot_value(&mut self, index: usize, value: R) {
        each!(self, effect => effect.set_value(index, value), table _ => {});
    }
}

impl<R: Copy> Effect<R> {
    /// The value at `index` of the parameter table, in SI units.
    pub fn value(&self, index: usize) -> Option<R> {
        each!(self, effect => effect.value(index))
    }

    /// Replaces the value at `index`, in SI units; ignores an index beyond the table.
    pub fn set_value(&mut self, index: usize, value: R) {
        each!(self, effect => effect.set_value(index, value));
    }
}

impl Effect<f32, InModel> {
    /// See [`Preparation::rate_law`].
    #[inline(never)]
    pub(crate) fn rate_law(&self, model: &Model<f32>) -> Option<RateLaw> {
        each!(self, effect => effect.rate_law(model))
    }

    /// See [`Preparation::brakes`].
    pub(crate) fn brakes(&self, dynamics: &Dynamics<f32>, farthest: f32) -> Option<f32> {
        each!(self, effect => effect.brakes(dynamics, farthest))
    }

    /// See [`Preparation::set_moving`].
    pub(crate) fn set_moving(&self, rate: f32, memory: &mut Hidden<f32>) {
        each!(self, effect => effect.set_moving(rate, memory));
    }

    /// See [`Preparation::recall`].
    pub(crate) fn recall(
        &self,
        base: &Base,
        step: &Step,
        hidden: Hidden<f32>,
        memory: &mut Hidden<f32>,
    ) {
        each!(self, effect => effect.recall(base, step, hidden, memory));
    }
}

impl Part for AnyPart {
    fn phases(&self) -> Phases {
        each!(self, part => part.phases())
    }

    fn at_rest(&self, step: &mut Step) -> Hidden<f32> {
        each!(self, part => part.at_rest(step))
    }

    #[inline]
    fn before(&self, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        each!(self, part => part.before(step, memory))
    }

    #[inline]
    fn force(&self, base: &Base, step: &mut Step, memory: &mut Hidden<f32>) -> f32 {
        each!(self, part => part.force(base, step, memory))
    }

    fn follows_clock(&self) -> bool {
        each!(self, part => part.follows_clock())
    }

    #[inline]
    fn read(&self, step: &mut Step, memory: &mut Hidden<f32>) {
        each!(self, part => part.read(step, memory));
    }
}

impl<R: Real, T: Mechanism<R>> Mechanism<R> for Effect<R, T> {
    fn integrates(&self) -> bool {
        each!(self, effect => Mechanism::<R>::integrates(effect))
    }

    fn at_rest(&self, rest: &Rest<R>) -> Hidden<R> {
        each!(self, effect => effect.at_rest(rest))
    }

    fn delay(&self) -> R {
        each!(self, effect => effect.delay())
    }

    fn input(&self, pressure: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        each!(self, effect => effect.input(pressure, hidden, rates))
    }

    fn modulates(&self) -> bool {
        each!(self, effect => Mechanism::<R>::modulates(effect))
    }

    fn modulate(&self, at: &Instant<R>, hidden: &Hidden<R>, dynamics: &mut Dynamics<R>) {
        each!(self, effect => effect.modulate(at, hidden, dynamics));
    }

    fn enlarge(&self, angle: R, dynamics: &mut Dynamics<R>) {
        each!(self, effect => effect.enlarge(angle, dynamics));
    }

    fn force(&self, at: &Instant<R>, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        each!(self, effect => effect.force(at, hidden, rates))
    }

    fn respond(&self, acceleration: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) {
        each!(self, effect => effect.respond(acceleration, hidden, rates));
    }

    // Inlined, because LLVM for the AVR otherwise passes some of it on the
    // stack and loses the pointer on the way (llvm#163015).
    #[inline(always)]
    fn sensor(&self, angle: R, time: R, hidden: &Hidden<R>, rates: &mut Hidden<R>) -> R {
        each!(self, effect => effect.sensor(angle, time, hidden, rates))
    }

    fn pressure_behind(&self, pressure: R) -> R {
        each!(self, effect => Mechanism::<R>::pressure_behind(effect, pressure))
    }

    fn pressure_towards(&self, pressure: R, hidden: &Hidden<R>) -> R {
        each!(self, effect => Mechanism::<R>::pressure_towards(effect, pressure, hidden))
    }

    fn behind(&self, shown: Motion<R>) -> Motion<R> {
        each!(self, effect => effect.behind(shown))
    }

    fn stiffens(&self) -> bool {
        each!(self, effect => Mechanism::<R>::stiffens(effect))
    }

    fn has_memory(&self) -> bool {
        each!(self, effect => Mechanism::<R>::has_memory(effect))
    }

    fn note(&self, angle: R, pressure: R, hidden: &mut Hidden<R>) {
        each!(self, effect => effect.note(angle, pressure, hidden));
    }

    fn sign(&self, dynamics: &Dynamics<R>) -> Option<Sign<R>> {
        each!(self, effect => effect.sign(dynamics))
    }

    fn swings_beside(&self) -> bool {
        each!(self, effect => Mechanism::<R>::swings_beside(effect))
    }

    fn winds(&self, angle: R) -> Option<[R; 2]> {
        each!(self, effect => effect.winds(angle))
    }

    fn fastest_rate(&self, dynamics: &Dynamics<R>, angle: R) -> Rates<R> {
        each!(self, effect => effect.fastest_rate(dynamics, angle))
    }
}

impl Kind {
    /// The name in model files and verdicts.
    pub const fn name(self) -> &'static str {
        self.info().name
    }

    /// Whether it names a cause. A table does not: it repairs a model and says what
    /// the missing force depends on.
    pub const fn is_name(self) -> bool {
        #[cfg(feature = "desktop")]
        if matches!(self, Self::TipLoad) {
            return false;
        }
        !matches!(self, Self::Table)
    }

    /// What a model file can have beside what the board has: a load at the tip, which becomes
    /// a weight and an inertia there.
    #[cfg(feature = "desktop")]
    pub const ON_DESKTOP: &'static [Self] = &[Self::TipLoad];

    /// See [`Self::ON_DESKTOP`].
    #[cfg(not(feature = "desktop"))]
    pub const ON_DESKTOP: &'static [Self] = &[];

    /// Looks an effect up by the name that it has in files.
    pub fn from_name(name: &str) -> Option<Self> {
        let all = Self::ALL.iter().chain(Self::ON_DESKTOP);
        all.copied().find(|kind| kind.name() == name)
    }
}

impl<R: Copy> Effect<R> {
    /// The parameter table of its kind; of a table as many rows as it has nodes.
    pub fn parameters(&self) -> &'static [Parameter] {
        match self {
            Self::Table(table) => table.parameters(),
            _ => self.kind().parameters(),
        }
    }

    /// The values in the order of the table, in SI units.
    pub fn values(&self) -> impl Iterator<Item = R> {
        (0..self.kind().parameter_count()).filter_map(|index| self.value(index))
    }
}

impl<R: Real, T> Effect<R, T> {
    /// The same effect on a base that has been turned further by `by` (rad).
    #[must_use]
    pub fn turned(mut self, by: R) -> Self {
        each!(&mut self, effect => effect.turn(by), table _ => ());
        self
    }

    /// The same effect with a tube to the actuator `times` as long. The flow through a tube is
    /// laminar (Hagen and Poiseuille: R = 128 μ l/(π d⁴)), so that its lag R·C into the actuator's
    /// capacity C is proportional to its length l, and so is the time l/c that sound takes.
    #[must_use]
    pub fn with_tube(mut self, times: R) -> Self {
        each!(&mut self, effect => effect.lengthen_tube(times), table _ => ());
        self
    }
}

impl<R: Real> Effect<R> {
    /// The same effect in another shape with as many parameters to find, which a fit can take
    /// instead: a creep over decades, the weight of what bends; none if it has but one.
    pub fn other_shape(self) -> Option<Self> {
        match self {
            Self::MaxwellBranch(branch) => Some(Self::MaxwellBranch(branch.over_decades())),
            Self::Gravity(gravity) => Some(Self::Gravity(gravity.bending())),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Change;

    #[test]
    fn names_are_unique_and_found_again() {
        for &kind in Kind::ALL.iter().chain(Kind::ON_DESKTOP) {
            assert_eq!(Kind::from_name(kind.name()), Some(kind));
        }
        assert_eq!(Kind::from_name("warp_drive"), None);
    }

    /// A state without a name would be lost where a model is exported.
    #[test]
    fn what_has_a_state_names_it() {
        for &kind in Kind::NAMES {
            let effect = kind.build(&[0.5; 8][..kind.parameter_count()]).unwrap();
            let has_state = Mechanism::<f64>::integrates(&effect) || effect.has_memory();
            assert_eq!(has_state, !kind.info().states.is_empty(), "{kind:?}");
        }
    }

    #[test]
    fn what_a_longer_tube_slows_down_is_said_to_be_slower() {
        for &kind in Kind::NAMES {
            let effect = kind.build(&[0.5; 8][..kind.parameter_count()]).unwrap();
            let changes = effect.with_tube(2.0) != effect;
            let said = kind.info().told_by.contains(&Change::LongerTube);
            assert_eq!(changes, said, "{kind:?}");
        }
    }

    #[test]
    fn all_but_the_table_are_names() {
        let names = Kind::ALL.iter().copied().filter(|kind| kind.is_name());
        assert!(names.eq(Kind::NAMES.iter().copied()));
        assert_eq!(Kind::ALL.len(), Kind::NAMES.len() + 1);
        assert_eq!(Kind::Table.build(&[1.0; table::MAX_NODES]), None);
    }

    #[test]
    fn tables_are_consistent() {
        for &kind in Kind::ALL.iter().chain(Kind::ON_DESKTOP) {
            let rows = kind.parameters();
            assert!(rows.iter().any(|row| row.held.is_none()), "{kind:?}");
            for row in rows {
                assert!(row.lower < row.upper, "{kind:?} {}", row.key);
                assert!(
                    row.held.is_some() || !row.starts.is_empty(),
                    "{kind:?} {} has nowhere to start",
                    row.key
                );
            }
            assert_eq!(kind.parameter_count(), rows.len());
            for (index, row) in rows.iter().enumerate() {
                assert_eq!(kind.bounds(index), Some((row.lower, row.upper)));
            }
            assert_eq!(kind.bounds(rows.len()), None);
            for name in kind.info().look_alikes {
                assert!(
                    Kind::from_name(name).is_some_and(|other| other != kind),
                    "{name}"
                );
            }
            if kind == Kind::Table {
                continue;
            }
            let ones = [1.0; 8];
            let effect = kind.build(&ones[..rows.len()]).unwrap();
            assert_eq!(effect.values().count(), rows.len());
            assert_eq!(kind.build(&ones[..rows.len() - 1]), None);
        }
    }
}
