//! A model in a neutral form: expressions over named constants and states.
//!
//! Everything here is traced from `model-core` itself ([`super::trace`]): the equation of
//! motion with its effects, the sensor, the initial state, the update of event memory after a
//! step, and the rates of the equations. Only the names are added.

use std::cell::{Cell, RefCell};

use model_core::actuator::{MAX_EFFECTS, Model, ParameterId, State};
use model_core::catalogue::Kind;
use model_core::effects::{Hidden, Instant, Mechanism, State as Named, Unit};
use model_core::input::{FromFn, Held};
use model_core::real::Real;

use super::trace::{Binary, Expression, Id, Tape, TooManyBranches, Traced, Written};
use softrig_formats::model_file::{parameter_name, parameter_unit};
use softrig_formats::numbers::exact;
use softrig_formats::recording::PASCAL_PER_KPA;

/// A parameter of the model.
#[derive(Clone, Debug)]
pub struct Constant {
    /// Its name, with its SI unit, in small letters.
    pub name: String,
    /// The number in the unit of the model file.
    pub in_file: f64,
    /// The factor or divisor of the number for SI units.
    pub scale: Scale,
    /// Its symbol in the equation.
    pub symbol: &'static str,
    /// Name and unit in the model file.
    pub about: String,
    /// The SI unit as Modelica writes it.
    pub unit: &'static str,
}

/// From the unit of model files to the SI unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The same.
    Same,
    /// kPa to Pa.
    Times1000,
    /// 1/kPa to 1/Pa.
    Over1000,
}

impl Scale {
    fn apply(self, value: f64) -> f64 {
        match self {
            Self::Same => value,
            Self::Times1000 => value * PASCAL_PER_KPA,
            Self::Over1000 => value / PASCAL_PER_KPA,
        }
    }
}

impl Constant {
    /// The number in SI units.
    #[cfg(test)]
    fn value(&self) -> f64 {
        self.scale.apply(self.in_file)
    }

    /// The same as an expression with the number of the model file in it.
    pub fn text(&self) -> String {
        let in_file = exact(self.in_file);
        match self.scale {
            Scale::Same => in_file,
            Scale::Times1000 => format!("{in_file} * 1000.0"),
            Scale::Over1000 => format!("{in_file} / 1000.0"),
        }
    }
}

/// A hidden state of an effect.
#[derive(Clone, Debug)]
pub struct Memory {
    /// Its name.
    pub name: String,
    /// A description, with the effect's name.
    pub about: String,
    /// Its rate; none for a memory of events.
    pub rate: Option<Id>,
    /// Its update after a step; none for a memory without updates.
    pub noted: Option<Id>,
    /// Its initial value in a run.
    pub start: Id,
}

/// What the frictions of a model require of the step length.
#[derive(Clone, Copy, Debug)]
pub struct Friction {
    /// The width of the smoothed sign (rad/s).
    pub width: Id,
    /// The rate from which all of them slide (rad/s).
    pub saturated: Id,
    /// Their contribution to the fastest rate (1/s).
    pub relaxation: Id,
}

/// A model as expressions.
#[derive(Debug)]
pub struct Physics {
    /// On which they stand.
    pub tape: Tape,
    /// The parameters.
    pub constants: Vec<Constant>,
    /// The hidden states of the effects.
    pub memories: Vec<Memory>,
    /// θ̈ (rad/s²), of [`TIME`], [`ANGLE`], [`RATE`], [`PRESSURE`] and the memories.
    pub acceleration: Id,
    /// The sensor's reading (rad), of the same variables without the pressure.
    pub reading: Id,
    /// Angle and rate behind what the sensor shows first: of [`START_ANGLE`],
    /// [`START_RATE`] and [`PRESSURE`].
    pub start: [Id; 2],
    /// The sensor's reading (rad) for an actuator that has rested at 0 rad.
    pub shown_at_rest: Id,
    /// Stiffness over inertia (1/s²) and relaxation (1/s) for angles up to [`ANGLE`].
    pub fastest: [Id; 2],
    /// Damping over inertia (1/s).
    pub decay: Id,
    /// Requirements of the frictions, if there are any.
    pub friction: Option<Friction>,
    /// By how much the pressure comes late (s), if it does.
    pub delay: Option<Id>,
    /// Names for parts of the expressions.
    pub labels: Vec<(Id, String)>,
}

/// Time since the start of the run (s).
pub const TIME: &str = "time";
/// The bending angle θ (rad).
pub const ANGLE: &str = "angle";
/// Its rate ω (rad/s).
pub const RATE: &str = "rate";
/// The gauge pressure p (Pa), late by the dead time.
pub const PRESSURE: &str = "pressure";
/// The sensor's reading at the start (rad).
pub const START_ANGLE: &str = "start_angle";
/// Its rate (rad/s).
pub const START_RATE: &str = "start_rate";

type TracedModel<'t> = Model<Traced<'t>, Written>;

/// Hidden states of a model: two an effect.
const PLACES: usize = 2 * MAX_EFFECTS;

impl Physics {
    /// Traces a model.
    ///
    /// # Errors
    ///
    /// If its effects have too many branches together.
    pub fn of(model: &Model<f64>) -> Result<Self, TooManyBranches> {
        let tape = Tape::default();
        let constants = constants(model);
        let names = memory_names(model, used_places(model)?);
        let traced = named(&tape, model, &constants);
        let at = state(&tape, |place| {
            names[place].as_ref().map(|(name, _)| name.clone())
        });
        let pressure = tape.symbol(PRESSURE);
        let traces = Traces::of(&tape, &traced, &at, pressure)?;
        let labels = labels(&tape, &traced, &at, pressure, traces.acceleration)?;
        let memories = names
            .into_iter()
            .enumerate()
            .filter_map(|(place, names)| {
                let (name, about) = names?;
                let [rate, before, noted, start] =
                    [&traces.rates, &traces.before, &traces.noted, &traces.start]
                        .map(|ids| ids[place]);
                Some(Memory {
                    name,
                    about,
                    rate: (!is_zero(&tape, rate)).then_some(rate),
                    noted: (noted != before).then_some(noted),
                    start,
                })
            })
            .collect();
        let friction = tape.explore(|| {
            let sign = traced.signs();
            sign.map_or(vec![], |s| vec![s.width, s.saturated, s.relaxation])
        })?;
        let zero = Traced::zero();
        let shown_at_rest = tape.single(|| traced.reading(&traced.at_rest(zero, zero)))?;
        let decay = tape.single(|| traced.dynamics().damping / traced.dynamics().inertia)?;
        let fastest = [
            tape.single(|| traced.fastest_rate(at.angle).stiffness)?,
            tape.single(|| traced.fastest_rate(at.angle).relaxation)?,
        ];
        Ok(Self {
            constants,
            memories,
            acceleration: traces.acceleration,
            reading: traces.reading,
            start: traces.motion,
            shown_at_rest,
            fastest,
            decay,
            friction: match friction[..] {
                [width, saturated, relaxation] => Some(Friction {
                    width,
                    saturated,
                    relaxation,
                }),
                _ => None,
            },
            delay: traces.delay,
            labels,
            tape,
        })
    }
}

/// The expressions of a model, of a state and a pressure.
struct Traces {
    acceleration: Id,
    /// The rates of the hidden states.
    rates: Vec<Id>,
    /// The hidden states before and after a step is noted.
    before: Vec<Id>,
    noted: Vec<Id>,
    /// Where a run starts: angle and rate, then the hidden states.
    motion: [Id; 2],
    start: Vec<Id>,
    reading: Id,
    delay: Option<Id>,
}

impl Traces {
    fn of<'t>(
        tape: &'t Tape,
        model: &TracedModel<'t>,
        at: &State<Traced<'t>>,
        pressure: Traced<'t>,
    ) -> Result<Self, TooManyBranches> {
        // The model asks for the pressure of a dead time ago.
        let asked = Cell::new(Traced::zero());
        let input = FromFn(|offset| {
            asked.set(offset);
            pressure
        });
        let mut rates = tape.explore(|| {
            let derivative = model.derivative(at, &input, Traced::zero());
            let mut all = flat(&derivative.hidden);
            all.push(derivative.acceleration);
            all
        })?;
        let delay = -asked.get();
        let delay = (!delay.is_zero()).then(|| tape.single(|| delay));
        let before = tape.explore(|| flat(&at.hidden))?;
        let noted = tape.explore(|| {
            let mut after = *at;
            model.note(&mut after, &Held(pressure), Traced::zero());
            flat(&after.hidden)
        })?;
        let [angle, rate] = [START_ANGLE, START_RATE].map(|name| tape.symbol(name));
        let mut start = tape.explore(|| {
            let start = model.showing(angle, rate, pressure);
            let mut all = flat(&start.hidden);
            all.extend([start.angle, start.rate]);
            all
        })?;
        let reading = tape.single(|| model.reading(at))?;
        Ok(Self {
            acceleration: rates.split_off(PLACES)[0],
            rates,
            before,
            noted,
            motion: start
                .split_off(PLACES)
                .try_into()
                .expect("an angle and a rate were pushed"),
            start,
            reading,
            delay: delay.transpose()?,
        })
    }
}

fn flat<'t>(hidden: &[Hidden<Traced<'t>>; MAX_EFFECTS]) -> Vec<Traced<'t>> {
    hidden.iter().flatten().copied().collect()
}

fn is_zero(tape: &Tape, id: Id) -> bool {
    tape.get(id) == Expression::Literal(0.0_f64.to_bits())
}

/// The state that expressions are of. Hidden states without a name are zero.
fn state(tape: &Tape, name: impl Fn(usize) -> Option<String>) -> State<Traced<'_>> {
    let place = |place| name(place).map_or(Traced::zero(), |name| tape.symbol(&name));
    State {
        time: tape.symbol(TIME),
        angle: tape.symbol(ANGLE),
        rate: tape.symbol(RATE),
        hidden: std::array::from_fn(|slot| [place(2 * slot), place(2 * slot + 1)]),
    }
}

/// The model with names in place of its numbers.
fn named<'t>(tape: &'t Tape, model: &Model<f64>, constants: &[Constant]) -> TracedModel<'t> {
    let numbers: TracedModel = model.map(Traced::Literal);
    parameters(model)
        .zip(constants)
        .fold(numbers, |model, (id, constant)| {
            model.with_value(id, tape.symbol(&constant.name))
        })
}

/// Every parameter of a model.
fn parameters(model: &Model<f64>) -> impl Iterator<Item = ParameterId> {
    let counts: Vec<usize> = model.effects().map(|e| e.parameters().len()).collect();
    let of_effects = counts.into_iter().enumerate().flat_map(|(slot, count)| {
        (0..count).map(move |parameter| ParameterId::Effect { slot, parameter })
    });
    ParameterId::BASE.into_iter().chain(of_effects)
}

/// The parameters with names that tell two effects of a kind apart.
fn constants(model: &Model<f64>) -> Vec<Constant> {
    parameters(model)
        .map(|id| {
            let about = parameter_name(model, id);
            let shown_unit = parameter_unit(model, id);
            let (key, symbol, unit) = model
                .row(id)
                .map_or(("", "", Unit::One), |row| (row.key, row.symbol, row.unit));
            let key = key.replace('[', "_").replace(']', "");
            let scale = match unit {
                Unit::KiloPascal => Scale::Times1000,
                Unit::PerKiloPascal | Unit::NewtonPerKiloPascal => Scale::Over1000,
                _ => Scale::Same,
            };
            let key = match scale {
                // A formula's own parameters are as they are written.
                Scale::Same => key,
                _ => key.replace("kpa", "pa"),
            };
            let name = match id {
                ParameterId::Effect { slot, .. } => {
                    format!("{}_{key}", effect_name(model, slot))
                }
                _ => key,
            };
            let value = model.value(id).unwrap_or_default();
            Constant {
                name,
                in_file: shortest(value, scale),
                scale,
                symbol,
                about: if scale == Scale::Same {
                    about
                } else {
                    format!("{about}, {shown_unit} in the model file")
                },
                unit: si_symbol(unit),
            }
        })
        .collect()
}

/// The kind of an effect, numbered from the second of a kind on.
fn effect_name(model: &Model<f64>, slot: usize) -> String {
    let kinds: Vec<Kind> = model.effects().map(|effect| effect.kind()).collect();
    let kind = kinds[slot];
    match kinds[..slot].iter().filter(|other| **other == kind).count() {
        0 => kind.name().to_owned(),
        before => format!("{}_{}", kind.name(), before + 1),
    }
}

/// The number with the fewest digits that stands for this value in SI units.
fn shortest(value: f64, scale: Scale) -> f64 {
    let in_file = match scale {
        Scale::Same => return value,
        Scale::Times1000 => value / PASCAL_PER_KPA,
        Scale::Over1000 => value * PASCAL_PER_KPA,
    };
    #[expect(clippy::float_cmp, reason = "to the bit is the point")]
    let shown = (0..17)
        .filter_map(|digits| format!("{in_file:.digits$e}").parse().ok())
        .find(|&shown| scale.apply(shown) == value);
    shown.unwrap_or(in_file)
}

/// A unit as Modelica writes it.
fn si_symbol(unit: Unit) -> &'static str {
    match unit {
        Unit::KilogramMetre => "kg.m",
        Unit::NewtonSecondPerRad => "N.s/rad",
        // No unit of its own: it depends on the exponent.
        Unit::NewtonPerRadToTheN => "",
        Unit::NewtonPerKiloPascal => "N/Pa",
        Unit::Newton => "N",
        Unit::NewtonPerRad => "N/rad",
        Unit::NewtonPerRad3 => "N/rad3",
        Unit::NewtonSecond2PerRad2 => "N.s2/rad2",
        Unit::Radian => "rad",
        Unit::RadianPerSecond => "rad/s",
        Unit::Second => "s",
        Unit::PerSecond => "1/s",
        Unit::Hertz => "Hz",
        Unit::PerRadian => "1/rad",
        Unit::PerKiloPascal => "1/Pa",
        Unit::KiloPascal => "Pa",
        Unit::NewtonPerKilogram => "N/kg",
        Unit::Metre => "m",
        _ => "1",
    }
}

/// Which hidden states a model makes use of.
fn used_places(model: &Model<f64>) -> Result<[bool; PLACES], TooManyBranches> {
    let tape = Tape::default();
    let traced = named(&tape, model, &constants(model));
    let at = state(&tape, |place| Some(format!("hidden {place}")));
    let traces = Traces::of(&tape, &traced, &at, tape.symbol(PRESSURE))?;
    Ok(std::array::from_fn(|place| {
        !is_zero(&tape, traces.rates[place])
            || traces.noted[place] != traces.before[place]
            || !is_zero(&tape, traces.start[place])
    }))
}

/// Names of the hidden states that a model makes use of, and what they are.
fn memory_names(model: &Model<f64>, used: [bool; PLACES]) -> [Option<(String, String)>; PLACES] {
    let kinds: Vec<Kind> = model.effects().map(|effect| effect.kind()).collect();
    let mut taken: Vec<&str> = Vec::new();
    std::array::from_fn(|place| {
        let kind = *kinds.get(place / 2).filter(|_| used[place])?;
        let Named {
            key: name,
            text: what,
        } = *kind.info().states.get(place % 2)?;
        let before = taken.iter().filter(|other| **other == name).count();
        taken.push(name);
        let name = match before {
            0 => name.to_owned(),
            before => format!("{name}_{}", before + 1),
        };
        Some((name, format!("{what}: {}", effect_name(model, place / 2))))
    })
}

/// Names for parts of the acceleration: the pressure in the chamber, parameters that effects
/// have changed, and each force. A part that is not met in it keeps none.
fn labels<'t>(
    tape: &'t Tape,
    model: &TracedModel<'t>,
    at: &State<Traced<'t>>,
    pressure: Traced<'t>,
    acceleration: Id,
) -> Result<Vec<(Id, String)>, TooManyBranches> {
    let names = RefCell::new(Vec::new());
    let parts = tape.explore(|| {
        let mut named = vec!["chamber_pressure".to_owned()];
        let mut unused = [Traced::zero(); 2];
        let mut instant = Instant {
            time: at.time,
            angle: at.angle,
            rate: at.rate,
            pressure,
        };
        let effects = || model.effects().zip(&at.hidden);
        for (effect, hidden) in effects() {
            instant.pressure = effect.input(instant.pressure, hidden, &mut unused);
        }
        let mut parts = vec![instant.pressure];
        let mut changed = *model.dynamics();
        for (effect, hidden) in effects() {
            effect.modulate(&instant, hidden, &mut changed);
        }
        for (name, part) in [
            ("changed_damping", changed.damping),
            ("changed_stiffness", changed.stiffness),
            ("changed_exponent", changed.exponent),
        ] {
            named.push(name.to_owned());
            parts.push(part);
        }
        for (slot, (effect, hidden)) in effects().enumerate() {
            let kinds = model
                .effects()
                .take(slot)
                .filter(|other| other.kind() == effect.kind());
            named.push(match kinds.count() {
                0 => effect.kind().name().to_owned(),
                before => format!("{}_{}", effect.kind().name(), before + 1),
            });
            parts.push(effect.force(&instant, hidden, &mut unused));
        }
        names.replace(named);
        parts
    })?;
    let mut labels: Vec<(Id, String)> = parts.into_iter().zip(names.into_inner()).collect();
    if let Expression::Binary(Binary::Divide, force, _) = tape.get(acceleration) {
        labels.push((force, "force".to_owned()));
    }
    labels.push((acceleration, "acceleration".to_owned()));
    labels.retain(|(id, _)| !tape.get(*id).is_leaf());
    Ok(labels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use softrig::synth::example::rig_models;
    use softrig_formats::model_file::ModelFile;
    use std::path::Path;
    use std::sync::LazyLock;

    /// A model with an effect, as `softrig example` draws it.
    fn model(kind: Kind) -> Model<f64> {
        static MODELS: LazyLock<Vec<Model<f64>>> = LazyLock::new(|| {
            let truth = |&kind: &Kind| rig_models(5, Some(kind)).unwrap().truth;
            let texts = Kind::NAMES.iter().map(truth);
            texts
                .map(|text| ModelFile::parse(&text, Path::new("m.toml")).unwrap().model)
                .collect()
        });
        let place = Kind::NAMES.iter().position(|known| *known == kind);
        MODELS[place.unwrap()]
    }

    /// Three effects of the catalogue, the later ones as their examples have them.
    fn together(kinds: [Kind; 3]) -> Model<f64> {
        let first = model(kinds[0]);
        let effects: Vec<_> = kinds
            .into_iter()
            .filter_map(|kind| model(kind).effects().next())
            .collect();
        Model::new(*first.dynamics(), &effects).unwrap()
    }

    /// Every expression against the model itself, at states in all directions.
    fn agrees(model: &Model<f64>) {
        let physics = Physics::of(model).unwrap();
        for trial in 0..40 {
            // Numbers from −1 to 1 that repeat nothing.
            let spread = |k: usize| (17.3 * (k + 1) as f64 * (f64::from(trial) + 0.37)).sin();
            let pressure = 6e4 * spread(0);
            let mut state = State {
                time: 3.0 + 3.0 * spread(1),
                angle: 2.0 * spread(2),
                rate: spread(3) * if trial % 2 == 0 { 3.0 } else { 0.03 },
                hidden: [[0.0; 2]; MAX_EFFECTS],
            };
            let places = used_places(model).unwrap();
            let used = (0..PLACES).filter(|place| places[*place]);
            for (place, memory) in used.clone().zip(&physics.memories) {
                let scale = if memory.name.contains("_pa") {
                    6e4
                } else {
                    1.2
                };
                state.hidden[place / 2][place % 2] = scale * spread(4 + place);
            }
            let (start_angle, start_rate) = (1.5 * spread(20), 2.0 * spread(21));
            let of = |name: &str| match name {
                TIME => state.time,
                ANGLE => state.angle,
                RATE => state.rate,
                PRESSURE => pressure,
                START_ANGLE => start_angle,
                START_RATE => start_rate,
                name => {
                    let place = physics.memories.iter().position(|m| m.name == name);
                    if let Some(place) = place {
                        let place = used.clone().nth(place).unwrap();
                        return state.hidden[place / 2][place % 2];
                    }
                    let constant = physics.constants.iter().find(|c| c.name == name);
                    constant
                        .unwrap_or_else(|| panic!("{name} is not known"))
                        .value()
                }
            };
            let values = physics.tape.values(of);
            let same = |what: &str, id: Id, expected: f64| {
                let found = id.of(&values);
                let error = (found - expected).abs() / expected.abs().max(1.0);
                assert!(error < 1e-12, "{what}: {found} for {expected}");
            };
            let derivative = model.derivative(&state, &Held(pressure), 0.0);
            let mut after = state;
            model.note(&mut after, &Held(pressure), 0.0);
            let start = model.showing(start_angle, start_rate, pressure);
            same(
                "acceleration",
                physics.acceleration,
                derivative.acceleration,
            );
            same("reading", physics.reading, model.reading(&state));
            same("angle at the start", physics.start[0], start.angle);
            same("rate at the start", physics.start[1], start.rate);
            for (place, memory) in used.clone().zip(&physics.memories) {
                let of = |hidden: &[Hidden<f64>; MAX_EFFECTS]| hidden[place / 2][place % 2];
                same(&memory.name, memory.start, of(&start.hidden));
                match memory.rate {
                    Some(rate) => same(&memory.name, rate, of(&derivative.hidden)),
                    None => assert!(of(&derivative.hidden).abs() < f64::MIN_POSITIVE),
                }
                match memory.noted {
                    Some(noted) => same(&memory.name, noted, of(&after.hidden)),
                    None => assert!((of(&after.hidden) - of(&state.hidden)).abs() < 1e-300),
                }
            }
            let rates = model.fastest_rate(state.angle);
            same("stiffness", physics.fastest[0], rates.stiffness);
            same("relaxation", physics.fastest[1], rates.relaxation);
            let sign = model.signs();
            assert_eq!(sign.is_some(), physics.friction.is_some());
            if let (Some(sign), Some(friction)) = (sign, physics.friction) {
                same("width", friction.width, sign.width);
                same("saturated", friction.saturated, sign.saturated);
                same("signs", friction.relaxation, sign.relaxation);
            }
            let delay: f64 = model.effects().map(|effect| effect.delay()).sum();
            match physics.delay {
                Some(id) => same("delay", id, delay),
                None => assert!(delay.abs() < f64::MIN_POSITIVE),
            }
        }
    }

    #[test]
    fn every_effect_is_traced_as_it_is_computed() {
        for &kind in Kind::NAMES {
            agrees(&model(kind));
        }
    }

    #[test]
    fn effects_are_traced_together() {
        let all = Kind::NAMES;
        for first in 0..all.len() {
            // Each beside others, which come before and behind it.
            let [second, third] = [5, 11].map(|step| (first + step) % all.len());
            agrees(&together([all[first], all[second], all[third]]));
        }
        agrees(&together([
            Kind::PneumaticLag,
            Kind::VentAsymmetry,
            Kind::PneumaticLag,
        ]));
        agrees(&together([
            Kind::SecondMode,
            Kind::SecondMode,
            Kind::SecondMode,
        ]));
    }

    /// Modelica relies on this: the only update of an integrated memory takes whole
    /// turns off.
    #[test]
    fn only_turns_are_integrated_and_noted() {
        for &kind in Kind::NAMES {
            let physics = Physics::of(&model(kind)).unwrap();
            for memory in physics.memories {
                let both = memory.rate.is_some() && memory.noted.is_some();
                assert_eq!(both, memory.name == "turns", "{kind:?}");
            }
        }
    }

    #[test]
    fn constants_are_those_of_the_model_to_the_bit() {
        let model = model(Kind::PressureStiffening);
        for (id, constant) in parameters(&model).zip(constants(&model)) {
            let value = model.value(id).unwrap();
            assert_eq!(value.to_bits(), constant.value().to_bits(), "{constant:?}");
        }
    }
}
