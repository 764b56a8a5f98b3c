//! The equation of motion: parameters, state, and the rate of change.
//!
//! ```text
//! M θ̈ + C θ̇ + K sign(θ)|θ|ⁿ + Q = F,   F = g·p        (paper, Eq. 13)
//! ```
//!
//! [`Model`] is the configuration, validated once; [`State`] is what changes.

use core::fmt;

use crate::catalogue::Effect;
use crate::dynamics::{Dynamics, Rates};
use crate::effects::table::{InModel, Table, Variable};
use crate::effects::{Hidden, Instant, Mechanism, Motion, Parameter, Rest, Sign};
use crate::input::Input;
use crate::power::Power;
use crate::real::Real;

/// The largest number of effects in one model.
///
/// Three is as many as recordings of angle and pressure have ever supported;
/// every slot costs RAM on the board.
pub const MAX_EFFECTS: usize = 3;

/// Names one parameter of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ParameterId {
    /// Effective inertia M.
    Inertia,
    /// Viscous damping C.
    Damping,
    /// Stiffness K.
    Stiffness,
    /// Exponent n.
    Exponent,
    /// Input gain g.
    InputGain,
    /// A parameter of an effect.
    Effect {
        /// Position of the effect in the model.
        slot: usize,
        /// Position of the parameter in the effect's table.
        parameter: usize,
    },
}

impl ParameterId {
    /// The parameters of the base equation, in the order of [`Dynamics`].
    pub const BASE: [Self; 5] = [
        Self::Inertia,
        Self::Damping,
        Self::Stiffness,
        Self::Exponent,
        Self::InputGain,
    ];

    /// The place of a base parameter in [`Dynamics`]; none for one of an effect.
    pub const fn in_base(self) -> Option<usize> {
        Some(match self {
            Self::Inertia => 0,
            Self::Damping => 1,
            Self::Stiffness => 2,
            Self::Exponent => 3,
            Self::InputGain => 4,
            Self::Effect { .. } => return None,
        })
    }

    /// The name of a base parameter in `[fit]`; none for one of an effect.
    pub fn base_name(self) -> Option<&'static str> {
        Some(Dynamics::<()>::FIELDS[self.in_base()?])
    }
}

/// Checks every parameter of a model. Apart from the model, so that the board has it
/// once for all power functions.
#[inline(never)]
fn validate<R: Real>(
    d: &Dynamics<R>,
    effects: &[Option<Slot<R>>; MAX_EFFECTS],
    table: Option<&Table<R>>,
) -> Result<(), InvalidModel> {
    use ParameterId::{Damping, Exponent, Inertia, InputGain, Stiffness};
    // Each by its name: a table of them would stand in the board's RAM.
    for (value, id) in [
        (d.inertia, Inertia),
        (d.damping, Damping),
        (d.stiffness, Stiffness),
        (d.exponent, Exponent),
        (d.input_gain, InputGain),
    ] {
        if !value.is_finite() {
            return Err(InvalidModel::NotFinite(id));
        }
    }
    for (value, id) in [(d.inertia, Inertia), (d.exponent, Exponent)] {
        if value <= R::zero() {
            return Err(InvalidModel::NotPositive(id));
        }
    }
    for (value, id) in [(d.damping, Damping), (d.stiffness, Stiffness)] {
        if value < R::zero() {
            return Err(InvalidModel::Negative(id));
        }
    }
    let mut tables = 0_u8;
    for (slot, effect) in effects.iter().map_while(Option::as_ref).enumerate() {
        for parameter in 0..effect.kind().parameter_count() {
            let value = match effect {
                Effect::Table(_) => table.and_then(|table| table.value(parameter)),
                effect => effect.slot_value(parameter),
            };
            let Some(value) = value else { break };
            let id = ParameterId::Effect { slot, parameter };
            if !value.is_finite() {
                return Err(InvalidModel::NotFinite(id));
            }
            let within = effect
                .kind()
                .bounds(parameter)
                .is_some_and(|(lower, upper)| {
                    (R::from_f32(lower)..=R::from_f32(upper)).contains(&value)
                });
            if !within {
                return Err(InvalidModel::OutOfBounds(id));
            }
        }
        tables += u8::from(matches!(effect, Effect::Table(_)));
    }
    if tables == u8::from(table.is_some()) {
        Ok(())
    } else {
        Err(InvalidModel::NotOneTable)
    }
}

/// Why a set of parameters is not a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InvalidModel {
    /// A parameter is infinite or NaN.
    NotFinite(ParameterId),
    /// A parameter must be above zero.
    NotPositive(ParameterId),
    /// A parameter must not be below zero.
    Negative(ParameterId),
    /// An effect's parameter is outside the bounds of its table.
    OutOfBounds(ParameterId),
    /// More effects than [`MAX_EFFECTS`].
    TooManyEffects,
    /// More than one effect is a table, or the numbers of the one are missing.
    NotOneTable,
}

impl fmt::Display for InvalidModel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite(_) => "must be a finite number",
            Self::NotPositive(_) => "must be above zero",
            Self::Negative(_) => "must not be negative",
            Self::OutOfBounds(_) => "is outside the bounds of its effect",
            Self::TooManyEffects => "has more effects than a model can hold",
            Self::NotOneTable => "has more than one table",
        })
    }
}

impl core::error::Error for InvalidModel {}

/// An effect in a model.
pub type Slot<R> = Effect<R, InModel>;

/// A validated model: the base equation and its effects.
///
/// `P` is the power function; see [`crate::power`].
///
/// ```text
/// M θ̈ + C θ̇ + K sign(θ)|θ|ⁿ + Q = F,   F = g·p        (paper, Eq. 13)
/// ```
///
/// θ is the bending angle (rad), p the gauge pressure (Pa), Q the sum of the forces of the
/// effects (N); the others are in [`Dynamics`]. θⁿ is read as sign(θ)|θ|ⁿ, since θⁿ is
/// undefined for θ < 0.
///
/// The paper writes M in kg, which does not close dimensionally beside a force and an angle:
/// M is an *effective* inertia in kg·m. From angle and pressure alone only the ratios to M can
/// be identified, so M is held unless told otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Model<R: Real, P = <R as Real>::DefaultPower> {
    dynamics: Dynamics<R>,
    effects: [Option<Slot<R>>; MAX_EFFECTS],
    /// The numbers of the table effect, kept once beside the slots: in each slot it would need
    /// eight times the RAM of any other effect.
    table: Option<Table<R>>,
    /// Whether any of them has a hidden state that is integrated, looked up once.
    integrates: bool,
    /// Whether any of them changes parameters, looked up once.
    modulates: bool,
    power: P,
}

/// Where the actuator is, and what its effects remember.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<R> {
    /// Time since the start of the run (s).
    pub time: R,
    /// Bending angle θ (rad).
    pub angle: R,
    /// Angular rate θ̇ (rad/s).
    pub rate: R,
    /// Hidden states of the effects, a slot each.
    pub hidden: [Hidden<R>; MAX_EFFECTS],
}

/// The rate of change of a [`State`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Derivative<R> {
    /// θ̇ (rad/s).
    pub rate: R,
    /// θ̈ (rad/s²).
    pub acceleration: R,
    /// Rates of the hidden states.
    pub hidden: [Hidden<R>; MAX_EFFECTS],
}

impl<R: Real> Derivative<R> {
    /// Nothing changes.
    pub(crate) fn zero() -> Self {
        Self {
            rate: R::zero(),
            acceleration: R::zero(),
            hidden: [[R::zero(); 2]; MAX_EFFECTS],
        }
    }
}

impl<R: Real, P: Power<R>> Model<R, P> {
    /// An inertia of one that nothing acts on: a placeholder until there is a model.
    pub fn inert() -> Self {
        Self {
            dynamics: Dynamics {
                inertia: R::one(),
                damping: R::zero(),
                stiffness: R::zero(),
                exponent: R::one(),
                input_gain: R::zero(),
            },
            effects: [None; MAX_EFFECTS],
            table: None,
            integrates: false,
            modulates: false,
            power: P::default(),
        }
    }

    /// Creates a model after checking every parameter.
    ///
    /// # Errors
    ///
    /// Names the first parameter that is not finite, not positive where it
    /// must be, or outside the bounds of its effect; or reports that there are
    /// too many effects.
    pub fn new(dynamics: Dynamics<R>, effects: &[Effect<R>]) -> Result<Self, InvalidModel> {
        Self::of_effects(dynamics, effects.iter().copied())
    }

    /// [`Model::new`] for effects that do not lie side by side in memory.
    ///
    /// # Errors
    ///
    /// Those of [`Model::new`].
    pub fn of_effects(
        dynamics: Dynamics<R>,
        effects: impl IntoIterator<Item = Effect<R>>,
    ) -> Result<Self, InvalidModel> {
        let mut slots = [None; MAX_EFFECTS];
        let mut table = None;
        for (slot, effect) in effects.into_iter().enumerate() {
            let place = slots.get_mut(slot).ok_or(InvalidModel::TooManyEffects)?;
            if let Effect::Table(numbers) = effect {
                table = Some(numbers);
            }
            *place = effect.convert(|value| value, Some(InModel));
        }
        Self::of_slots(dynamics, slots, table)
    }

    /// [`Model::new`] for effects and their table apart: a board has no room for a table in every
    /// effect. Effects behind an empty slot are not part of the model.
    ///
    /// # Errors
    ///
    /// Those of [`Model::new`].
    pub fn of_slots(
        dynamics: Dynamics<R>,
        effects: [Option<Slot<R>>; MAX_EFFECTS],
        table: Option<Table<R>>,
    ) -> Result<Self, InvalidModel> {
        validate(&dynamics, &effects, table.as_ref())?;
        Ok(Self {
            dynamics,
            effects,
            table,
            integrates: effects.iter().flatten().any(Mechanism::<R>::integrates),
            modulates: effects.iter().flatten().any(Mechanism::<R>::modulates),
            power: P::default(),
        })
    }

    /// The base equation's parameters.
    pub fn dynamics(&self) -> &Dynamics<R> {
        &self.dynamics
    }

    /// The effects, in the order in which they act.
    pub fn effects(&self) -> impl Iterator<Item = Effect<R>> {
        self.occupied()
            .filter_map(|slot| slot.convert(|value| value, self.table))
    }

    /// The effects without their table.
    pub(crate) fn occupied(&self) -> impl Iterator<Item = &Slot<R>> {
        // The slots are filled from the first on.
        self.effects.iter().map_while(Option::as_ref)
    }

    /// The table of the effect that is one.
    pub fn table(&self) -> Option<&Table<R>> {
        self.table.as_ref()
    }

    /// The value of a parameter, in SI units; none if the model has no such
    /// effect or parameter.
    pub fn value(&self, id: ParameterId) -> Option<R> {
        match id {
            ParameterId::Effect { slot, parameter } => match self.effects.get(slot)?.as_ref()? {
                Effect::Table(_) => self.table.as_ref()?.value(parameter),
                effect => effect.slot_value(parameter),
            },
            base => self.dynamics.value(base.in_base()?),
        }
    }

    /// What files, fits and reports know of a parameter; none if the model has no such
    /// effect or parameter.
    pub fn row(&self, id: ParameterId) -> Option<&'static Parameter> {
        match id {
            ParameterId::Effect { slot, parameter } => {
                self.effects().nth(slot)?.parameters().get(parameter)
            }
            base => Dynamics::<()>::PARAMETERS.get(base.in_base()?),
        }
    }

    /// Replaces one parameter without checking it again: a fit that keeps its
    /// parameters within bounds does this thousands of times. A parameter that
    /// the model does not have is left alone.
    pub fn with_value(mut self, id: ParameterId, value: R) -> Self {
        match id {
            ParameterId::Effect { slot, parameter } => {
                match (self.effects.get_mut(slot), &mut self.table) {
                    (Some(Some(Effect::Table(_))), Some(table)) => {
                        table.set_value(parameter, value);
                    }
                    (Some(Some(effect)), _) => effect.set_slot_value(parameter, value),
                    _ => {}
                }
            }
            base => {
                if let Some(place) = base.in_base() {
                    self.dynamics.set_value(place, value);
                }
            }
        }
        self
    }

    /// Converts the model to another scalar and power function.
    pub fn map<S: Real, Q: Power<S>>(&self, mut f: impl FnMut(R) -> S) -> Model<S, Q> {
        let mut effects = [None; MAX_EFFECTS];
        for (to, from) in effects.iter_mut().zip(&self.effects) {
            *to = from
                .as_ref()
                .and_then(|effect| effect.convert(&mut f, Some(InModel)));
        }
        Model {
            dynamics: self.dynamics.map(&mut f),
            effects,
            table: self.table.as_ref().map(|table| table.map(&mut f)),
            integrates: self.integrates,
            modulates: self.modulates,
            power: Q::default(),
        }
    }

    /// The same actuator on a base that has been turned further by `by` (rad).
    #[must_use]
    pub fn turned(mut self, by: R) -> Self {
        self.effects = self
            .effects
            .map(|slot| slot.map(|effect| effect.turned(by)));
        self
    }

    /// The same actuator with a tube `times` as long: see [`Effect::with_tube`].
    #[must_use]
    pub fn with_tube(mut self, times: R) -> Self {
        self.effects = self
            .effects
            .map(|slot| slot.map(|effect| effect.with_tube(times)));
        self
    }

    /// The same actuator with `mass` (kg) hung at its tip: a weight and an inertia take the
    /// place of its [`crate::effects::tip_load`]. Without one, or without a mass, nothing
    /// changes.
    #[cfg(feature = "desktop")]
    #[must_use]
    pub fn loaded(mut self, mass: R) -> Self {
        if mass == R::zero() {
            return self;
        }
        let tilt = self.occupied().find_map(|slot| match slot {
            Effect::Gravity(own) => Some(own.tilt),
            _ => None,
        });
        for slot in self.effects.iter_mut().flatten() {
            if let Effect::TipLoad(load) = slot {
                self.dynamics.inertia += load.inertia(mass);
                *slot = Effect::Gravity(load.weight(mass, tilt.unwrap_or(R::zero())));
            }
        }
        self
    }

    /// The same model with this power function.
    pub fn with_power<Q: Power<R>>(&self, power: Q) -> Model<R, Q> {
        Model {
            dynamics: self.dynamics,
            effects: self.effects,
            table: self.table,
            integrates: self.integrates,
            modulates: self.modulates,
            power,
        }
    }

    /// The exponent n of the power law with what shifts it.
    pub fn shifted_exponent(&self) -> R {
        let mut dynamics = self.dynamics;
        for effect in self.occupied() {
            effect.enlarge(R::zero(), &mut dynamics);
        }
        dynamics.exponent
    }

    /// The state of an actuator that has been resting at `angle` (rad) under
    /// `pressure` (Pa): hidden states have settled, time is zero.
    pub fn at_rest(&self, angle: R, pressure: R) -> State<R> {
        self.moving(angle, R::zero(), pressure)
    }

    /// The state of an actuator that passes `angle` (rad) with `rate` (rad/s)
    /// and whose hidden states have settled there: the start of a recording
    /// that was cut out of a longer one.
    ///
    /// What happened before the start is not known: an effect with a past (a
    /// creep, a largest angle, a play) begins as if it had rested here, and only
    /// a sensor's lag takes the rate into account.
    pub fn moving(&self, angle: R, rate: R, pressure: R) -> State<R> {
        self.coming_from(angle, Motion { angle, rate }, pressure)
    }

    /// Like [`Model::moving`], but what has a past (a creep, a largest angle) has settled at
    /// the angle `settled` (rad).
    pub fn coming_from(&self, settled: R, motion: Motion<R>, pressure: R) -> State<R> {
        let Motion { angle, rate } = motion;
        let mut rest = Rest {
            angle: settled,
            start: angle,
            rate,
            pressure,
            reading: angle,
        };
        let mut hidden = [[R::zero(); 2]; MAX_EFFECTS];
        let mut unused = [R::zero(); 2];
        for (slot, effect) in hidden.iter_mut().zip(self.occupied()) {
            *slot = effect.at_rest(&rest);
            rest.pressure = effect.input(rest.pressure, slot, &mut unused);
            rest.reading = effect.sensor(rest.reading, R::zero(), slot, &mut unused);
        }
        State {
            time: R::zero(),
            angle,
            rate,
            hidden,
        }
    }

    /// The rate of change of `state`, `offset` seconds into the current step.
    pub fn derivative(&self, state: &State<R>, input: &impl Input<R>, offset: R) -> Derivative<R> {
        let mut derivative = Derivative::zero();
        self.derive(state, input, offset, &mut derivative);
        derivative
    }

    /// [`Model::derivative`] in place: with derivatives it is a kilobyte. What it has of
    /// slots without an effect stays.
    pub(crate) fn derive(
        &self,
        state: &State<R>,
        input: &impl Input<R>,
        offset: R,
        into: &mut Derivative<R>,
    ) {
        let late = if self.effects[0].is_none() {
            offset
        } else {
            offset - self.delay()
        };
        self.derive_under(state, input.pressure(late), into);
    }

    /// [`Model::derive`] under `pressure` (Pa), which the delays have let through by now.
    fn derive_under(&self, state: &State<R>, mut pressure: R, into: &mut Derivative<R>) {
        into.rate = state.rate;
        if self.effects[0].is_none() {
            into.acceleration = self.base_acceleration(state.angle, state.rate, pressure);
            return;
        }
        let rates = &mut into.hidden;
        for ((effect, hidden), rates) in self.slots(&state.hidden, rates) {
            *rates = [R::zero(); 2];
            pressure = effect.input(pressure, hidden, rates);
        }
        let at = Instant {
            time: state.time,
            angle: state.angle,
            rate: state.rate,
            pressure,
        };
        let force = self.force(&at, &state.hidden, Some(&mut *rates));
        let acceleration = force / self.dynamics.inertia;

        let mut reading = state.angle;
        for ((effect, hidden), rates) in self.slots(&state.hidden, rates) {
            effect.respond(acceleration, hidden, rates);
            reading = effect.sensor(reading, state.time, hidden, rates);
        }
        into.acceleration = acceleration;
    }

    /// The sum of the delays (s) on the input path.
    #[inline]
    pub fn delay(&self) -> R {
        let mut delay = R::zero();
        for effect in self.occupied() {
            delay += effect.delay();
        }
        delay
    }

    /// θ̈ (rad/s²) at an instant, under the pressure (Pa) that the delays have let through by then.
    /// For models whose hidden states are not integrated, so their rates are not computed.
    #[inline]
    pub(crate) fn acceleration(&self, at: &Instant<R>, hidden: &[Hidden<R>; MAX_EFFECTS]) -> R {
        if self.effects[0].is_none() {
            return self.base_acceleration(at.angle, at.rate, at.pressure);
        }
        let mut unused = [R::zero(); 2];
        let mut within = *at;
        for (effect, hidden) in self.occupied().zip(hidden) {
            within.pressure = effect.input(within.pressure, hidden, &mut unused);
        }
        self.force(&within, hidden, None) / self.dynamics.inertia
    }

    /// sign(θ)|θ|ⁿ by the model's own power function, see [`crate::power::signed_power`].
    #[inline]
    fn spring_power(&self, angle: R, exponent: R) -> R {
        if angle < R::zero() {
            -self.power.raise(-angle, exponent)
        } else {
            self.power.raise(angle, exponent)
        }
    }

    /// θ̈ (rad/s²) of the base model alone. Half of all steps need only this, and loops over
    /// effects would cost a tenth of it on a desktop.
    #[inline]
    fn base_acceleration(&self, angle: R, rate: R, pressure: R) -> R {
        let d = &self.dynamics;
        let force = d.input_gain * pressure
            - d.damping * rate
            - d.stiffness * self.spring_power(angle, d.exponent);
        force / d.inertia
    }

    /// F − C ω − K sign(θ)|θ|ⁿ − Q (N) at an instant, with the pressure (Pa) in the chamber,
    /// and the rates of the hidden states of the forces, where they are asked for.
    #[inline]
    fn force(
        &self,
        at: &Instant<R>,
        hidden: &[Hidden<R>; MAX_EFFECTS],
        mut rates: Option<&mut [Hidden<R>; MAX_EFFECTS]>,
    ) -> R {
        let mut changed;
        let mut d = &self.dynamics;
        if self.modulates {
            changed = self.dynamics;
            for (effect, hidden) in self.occupied().zip(hidden) {
                effect.modulate(at, hidden, &mut changed);
            }
            d = &changed;
        }
        let mut force = d.input_gain * at.pressure
            - d.damping * at.rate
            - d.stiffness * self.spring_power(at.angle, d.exponent);
        let mut unused = [R::zero(); 2];
        for (slot, (effect, hidden)) in self.occupied().zip(hidden).enumerate() {
            let rates = rates.as_deref_mut().and_then(|rates| rates.get_mut(slot));
            force -= effect.force(at, hidden, rates.unwrap_or(&mut unused));
        }
        if let Some(table) = &self.table {
            force -= table.at(table.of().at(at));
        }
        force
    }

    /// What the angle sensor shows (rad): the angle through the sensor effects.
    pub fn reading(&self, state: &State<R>) -> R {
        let mut unused = [[R::zero(); 2]; MAX_EFFECTS];
        let mut reading = state.angle;
        for ((effect, hidden), rates) in self.slots(&state.hidden, &mut unused) {
            reading = effect.sensor(reading, state.time, hidden, rates);
        }
        reading
    }

    /// The angle (rad) at rest behind what the sensor shows (rad): the inverse
    /// of [`Model::reading`] once the sensor has settled.
    pub fn angle_behind(&self, reading: R) -> R {
        let rate = R::zero();
        let effects = self.effects.iter().flatten();
        effects.rev().fold(reading, |angle, effect| {
            effect.behind(Motion { angle, rate }).angle
        })
    }

    /// The motion behind what the sensor shows at the start of a run: exact for
    /// what only bends the reading, and for a lag as far as the motion is even.
    fn motion_behind(&self, shown: Motion<R>) -> Motion<R> {
        let effects = self.effects.iter().flatten();
        effects
            .rev()
            .fold(shown, |motion, effect| effect.behind(motion))
    }

    /// The state of an actuator whose sensor shows `reading` (rad), changing at
    /// `rate` (rad/s): like [`Model::moving`], from the other side of the sensor.
    pub fn showing(&self, reading: R, rate: R, pressure: R) -> State<R> {
        let angle = reading;
        self.showing_after(R::zero(), Motion { angle, rate }, pressure)
    }

    /// Like [`Model::showing`], but what has a past has settled `past` (rad) from the angle.
    pub fn showing_after(&self, past: R, shown: Motion<R>, pressure: R) -> State<R> {
        let motion = self.motion_behind(shown);
        self.coming_from(motion.angle + past, motion, pressure)
    }

    /// The state of an actuator that was bent as far as `farthest` (rad) before: what is lost by
    /// the first stretch stays lost, however long it rests.
    #[cfg(feature = "desktop")]
    #[must_use]
    pub fn stretched(&self, mut state: State<R>, farthest: R) -> State<R> {
        for (effect, hidden) in self.occupied().zip(&mut state.hidden) {
            if matches!(effect, Effect::MullinsSoftening(_)) {
                hidden[0] = hidden[0].max(farthest);
            }
        }
        state
    }

    /// Lets the effects with a memory of events (a largest angle, a play)
    /// take note of the state that a step arrived at, `offset` seconds after its
    /// start.
    pub fn note(&self, state: &mut State<R>, input: &impl Input<R>, offset: R) {
        if self.occupied().any(Mechanism::<R>::has_memory) {
            self.note_events(state, input.pressure(offset - self.delay()));
        }
    }

    fn note_events(&self, state: &mut State<R>, mut pressure: R) {
        let mut unused = [R::zero(); 2];
        for (effect, hidden) in self.occupied().zip(&mut state.hidden) {
            let entering = pressure;
            pressure = effect.input(entering, hidden, &mut unused);
            effect.note(state.angle, entering, hidden);
        }
    }

    /// The pressure (Pa) that holds the actuator at `angle` (rad) once
    /// everything has settled: `p = (K sign(θ)|θ|ⁿ + Q)/g`.
    ///
    /// No pressure holds against a leak; it is treated as not begun. Not finite if the input gain
    /// is zero, or if the stiffness grows faster with the pressure than the force does, so that no
    /// pressure holds. A table of the pressure is balanced as if some stiffness were left.
    #[inline(never)] // Once on the board, which asks in several places.
    pub fn holding_pressure(&self, angle: R) -> R {
        let state = self.at_rest(angle, R::zero());
        let of_pressure = self
            .table
            .as_ref()
            .filter(|table| table.of() == Variable::Pressure);
        // A table of the pressure is taken out: the rest is a straight line.
        let missing = |pressure| {
            let at = Instant {
                time: state.time,
                angle,
                rate: R::zero(),
                pressure,
            };
            let missing = -self.force(&at, &state.hidden, None);
            of_pressure.map_or(missing, |table| missing - table.at(pressure))
        };
        let unforced = missing(R::zero());
        let mut gain = self.dynamics.input_gain;
        let mut chamber = unforced / gain;
        if self.occupied().any(Mechanism::<R>::stiffens) {
            // Here too the force is a straight line over the pressure, and another one beyond the
            // pressure that takes all stiffness away. The bounds of the parameters keep that
            // pressure farther from zero than this step. The second slope begins at the first
            // result, where rounding matters less and where the other line may apply.
            let slope =
                |from: R, step: R| ((missing(from) - missing(from + step)) / step).max(R::zero());
            gain = slope(R::zero(), R::from_i16(16_384));
            chamber = unforced / gain;
            if chamber.is_finite() && chamber.abs() > R::one() {
                chamber = chamber + missing(chamber) / slope(chamber, chamber);
            }
        }
        if let Some(table) = of_pressure
            && gain != R::zero()
        {
            chamber = table.balance(unforced, gain);
        }
        let effects = self.effects.iter().flatten();
        effects
            .rev()
            .fold(chamber, |pressure, effect| effect.pressure_behind(pressure))
    }

    /// An upper estimate of the fastest rate of the equations (1/s) for
    /// angles up to `angle` (rad): what a step length has to resolve.
    pub fn fastest_rate(&self, angle: R) -> Rates<R> {
        self.fastest_rate_of(angle, |_| true)
    }

    /// The square of the frequency (rad²/s²) at which the actuator itself swings at most,
    /// for angles up to `angle` (rad), without what swings beside it.
    pub fn fastest_swing(&self, angle: R) -> R {
        self.fastest_rate_of(angle, |slot| !Mechanism::<R>::swings_beside(slot))
            .stiffness
    }

    fn fastest_rate_of(&self, angle: R, counts: impl Fn(&Slot<R>) -> bool) -> Rates<R> {
        let mut d = self.dynamics;
        for effect in self.occupied() {
            effect.enlarge(angle, &mut d);
        }
        // The slope of the power law at the end of the range, where it is
        // steepest for n ≥ 1.
        let beyond_linear = (d.exponent - R::one()).max(R::zero());
        let slope = d.stiffness * d.exponent * P::pow(angle.abs(), beyond_linear);
        let mut rates = Rates {
            stiffness: slope / d.inertia,
            relaxation: d.damping / d.inertia,
        };
        for effect in self.occupied().filter(|slot| counts(slot)) {
            let more = effect.fastest_rate(&d, angle);
            rates.stiffness += more.stiffness;
            rates.relaxation += more.relaxation;
        }
        if let Some(table) = &self.table {
            let more = table.fastest_rate(&d, angle);
            rates.stiffness += more.stiffness;
            rates.relaxation += more.relaxation;
        }
        rates
    }

    /// The signs of all frictions as one: the least width, the last to saturate, and what
    /// they add to the fastest rate together. None without a friction.
    pub fn signs(&self) -> Option<Sign<R>> {
        self.occupied()
            .filter_map(|effect| effect.sign(&self.dynamics))
            .reduce(|all, sign| Sign {
                width: if sign.width < all.width {
                    sign.width
                } else {
                    all.width
                },
                saturated: all.saturated.max(sign.saturated),
                relaxation: all.relaxation + sign.relaxation,
            })
    }

    /// The relaxation (1/s) per rad/s of the hidden states that wind up with the motion, and what
    /// all of them together add to the fastest rate; none without such a state.
    pub fn winding(&self, angle: R) -> Option<[R; 2]> {
        self.occupied()
            .filter_map(|effect| effect.winds(angle))
            .map(|[rate, relaxation]| [relaxation / rate, relaxation])
            .reduce(|[a, all], [b, more]| [a + b, all + more])
    }

    /// Whether any hidden state is integrated with the motion.
    pub(crate) fn integrates(&self) -> bool {
        self.integrates
    }

    fn slots<'a>(
        &'a self,
        hidden: &'a [Hidden<R>; MAX_EFFECTS],
        rates: &'a mut [Hidden<R>; MAX_EFFECTS],
    ) -> impl Iterator<Item = ((&'a Slot<R>, &'a Hidden<R>), &'a mut Hidden<R>)> {
        self.occupied().zip(hidden).zip(rates)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::catalogue::Kind;

    fn paper() -> Dynamics<f64> {
        Dynamics {
            inertia: 0.36,
            damping: 0.913,
            stiffness: 0.127,
            exponent: 2.365,
            input_gain: 2.17e-5,
        }
    }

    #[test]
    fn effects_that_change_parameters_are_known() {
        let dynamics = Dynamics {
            inertia: 1.0,
            damping: 2.0,
            stiffness: 3.0,
            exponent: 1.5,
            input_gain: 0.1,
        };
        let at = Instant {
            time: 3.0,
            angle: 0.8,
            rate: -0.4,
            pressure: 5e4,
        };
        for &kind in Kind::NAMES {
            let values: Vec<f64> = (0..kind.parameter_count())
                .map(|index| {
                    let (lower, upper) = kind.bounds(index).unwrap();
                    0.05_f64.clamp(f64::from(lower), f64::from(upper))
                })
                .collect();
            let effect: Slot<f64> = kind.build_slot(&values).unwrap();
            let mut changed = dynamics;
            effect.modulate(&at, &[0.3, 0.0], &mut changed);
            assert_eq!(
                changed != dynamics,
                Mechanism::<f64>::modulates(&effect),
                "{kind:?}"
            );
        }
    }

    #[test]
    fn holding_pressure_balances_the_forces() {
        let model: Model<f64> = Model::new(
            paper(),
            &[Kind::Gravity.build(&[0.05, 0.4, 0.0, 1.0]).unwrap()],
        )
        .unwrap();
        let pressure = model.holding_pressure(1.2);
        let state = model.at_rest(1.2, pressure);
        let rates = model.derivative(&state, &crate::input::Held(pressure), 0.0);
        assert!(rates.acceleration.abs() < 1e-12);
    }

    #[test]
    fn bad_parameters_are_named() {
        let reject = |change: fn(&mut Dynamics<f64>)| {
            let mut dynamics = paper();
            change(&mut dynamics);
            Model::<f64>::new(dynamics, &[]).unwrap_err()
        };
        assert_eq!(
            reject(|d| d.stiffness = -1.0),
            InvalidModel::Negative(ParameterId::Stiffness)
        );
        assert_eq!(
            reject(|d| d.exponent = 0.0),
            InvalidModel::NotPositive(ParameterId::Exponent)
        );
        assert_eq!(
            reject(|d| d.damping = f64::NAN),
            InvalidModel::NotFinite(ParameterId::Damping)
        );
        let friction = Kind::CoulombFriction.build(&[-0.1, 0.02]).unwrap();
        assert_eq!(
            Model::<f64>::new(paper(), &[friction]).unwrap_err(),
            InvalidModel::OutOfBounds(ParameterId::Effect {
                slot: 0,
                parameter: 0
            })
        );
    }

    #[test]
    fn values_can_be_read_back_by_name() {
        let drag = Kind::QuadraticDamping.build(&[0.3]).unwrap();
        let model: Model<f64> = Model::new(paper(), &[drag]).unwrap();
        let id = ParameterId::Effect {
            slot: 0,
            parameter: 0,
        };
        assert_eq!(model.value(id), Some(0.3));
        assert_eq!(model.with_value(id, 0.7).value(id), Some(0.7));
        let absent = ParameterId::Effect {
            slot: 1,
            parameter: 0,
        };
        assert_eq!(model.value(absent), None);
        assert_eq!(model.with_value(absent, 1.0), model);
    }
}
