//! The meaning of the settings: the model, the calibration, the limits.
//!
//! On the wire and in EEPROM settings are a list of words. Here they become the validated
//! types of the firmware, and here a list is checked as a whole. Each word was checked
//! against its own bounds before, by [`Settings::set`].

use model_core::{
    actuator::{InvalidModel, MAX_EFFECTS, Model, Slot},
    catalogue::{Effect, Kind},
    dynamics::Dynamics,
    effects::table::{InModel, InvalidTable, MAX_NODES, Table, Variable},
    power::Minimax,
};
use wire::{
    reply::Refusal,
    settings::{
        EFFECT_PARAMETERS, EFFECTS, FLEX_POINTS, Key, Settings, TABLE_COUNT, TABLE_NODES, TABLE_OF,
        effect_id,
    },
};

use crate::{
    sensing::{Calibration, flex, flex::Flex, pressure::Pressure},
    stepper,
};

const _: () = assert!(
    FLEX_POINTS == flex::MOST_POINTS
        && EFFECTS as usize == MAX_EFFECTS
        && TABLE_NODES as usize == MAX_NODES
);

/// Longest time (s) from the retracted end to the largest volume with the fastest pulses. A screw that takes
/// longer is none for this board: more likely `ul.step` is not of this screw.
const LONGEST_STROKE_S: f32 = 120.0;

/// Most microsteps over that way. A single-precision number counts seven times as many.
const MOST_STEPS: f32 = LONGEST_STROKE_S * stepper::FASTEST;

/// Longest time (s) from standstill to the fastest flow. A plunger approaches its place with that
/// time constant: from 50 ml to a microstep it takes eleven of them.
const SLOWEST_RAMP_S: f32 = 2.0;

/// Why settings do not make sense as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Flaw {
    /// A setting is infinite or not a number.
    NotFinite,
    /// The catalogue has no effect of this identifier.
    UnknownEffect {
        /// Its slot.
        slot: u8,
    },
    /// The parameters are not those of a model.
    Model(InvalidModel),
    /// The numbers of the table are not a table.
    Table(InvalidTable),
    /// The flex sensor's table does not rise or fall strictly; see
    /// [`Flex::new`].
    FlexTable,
    /// A set-point may exceed the limit that stops the rig.
    SetpointBeyondLimit,
    /// A limit is beyond what its sensor can show, so that it would never stop
    /// the rig.
    LimitBeyondSensor,
    /// The pump needs longer than `SLOWEST_RAMP_S` to its fastest flow, and ten times that to
    /// come to rest at a place.
    SlowRamp,
    /// The largest volume has more microsteps than are counted.
    TooManySteps,
}

macro_rules! kinds {
    ($( $module:ident::$name:ident ),+ $(,)?) => {
        /// The effect of an identifier.
        ///
        /// The identifiers are computed while compiling: names of effects take
        /// no memory on the board.
        fn kind(id: u16) -> Option<Kind> {
            $(
                if id == const { effect_id(Kind::$name.name()) } {
                    return Some(Kind::$name);
                }
            )+
            (id == const { effect_id(Kind::Table.name()) }).then_some(Kind::Table)
        }

        const _: () = {
            $( assert!(
                Kind::$name.parameter_count() <= EFFECT_PARAMETERS as usize,
                "an effect has more parameters than the settings hold"
            ); )+
        };
    };
}
model_core::for_each_effect!(kinds);

/// The effect in a slot, a table without its numbers; none for an empty one.
#[inline(never)] // Three slots, one copy.
fn effect(settings: &Settings, slot: u8) -> Result<Option<Slot<f32>>, Flaw> {
    let unknown = Flaw::UnknownEffect { slot };
    let id = settings.bits(Key::EffectKind { slot }).unwrap_or(0);
    if id == 0 {
        return Ok(None);
    }
    let kind = u16::try_from(id).ok().and_then(kind).ok_or(unknown)?;
    if kind == Kind::Table {
        return Ok(Some(Effect::Table(InModel)));
    }
    let mut values = [0.0; EFFECT_PARAMETERS as usize];
    for (value, index) in values.iter_mut().zip(0..) {
        *value = settings.number(Key::EffectParameter { slot, index });
    }
    values
        .get(..kind.parameter_count())
        .and_then(|values| kind.build_slot(values))
        .map(Some)
        .ok_or(unknown)
}

/// The table whose slot is `slot`.
#[inline(never)]
fn table(settings: &Settings, slot: u8) -> Result<Table<f32>, Flaw> {
    let whole = |index| {
        let value = settings.number(Key::EffectParameter { slot, index });
        // The conversion saturates; what is not a whole number differs after it.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let whole = value as u8;
        #[allow(clippy::float_cmp)] // Whole numbers are exact.
        (f32::from(whole) == value).then_some(whole)
    };
    let of = match whole(TABLE_OF) {
        Some(0) => Variable::Angle,
        Some(1) => Variable::Rate,
        Some(2) => Variable::Pressure,
        Some(3) => Variable::Time,
        _ => return Err(Flaw::UnknownEffect { slot }),
    };
    let count = whole(TABLE_COUNT).ok_or(Flaw::Table(InvalidTable::NodeCount))?;
    if count > TABLE_NODES {
        return Err(Flaw::Table(InvalidTable::NodeCount));
    }
    Table::of_pairs(of, settings.table().take(usize::from(count))).map_err(Flaw::Table)
}

/// The model of the settings; empty slots between effects do not matter.
///
/// # Errors
///
/// [`Flaw::UnknownEffect`], [`Flaw::Table`] or [`Flaw::Model`].
pub fn model(settings: &Settings) -> Result<Model<f32, Minimax>, Flaw> {
    let dynamics = Dynamics {
        inertia: settings.number(Key::Inertia),
        damping: settings.number(Key::Damping),
        stiffness: settings.number(Key::Stiffness),
        exponent: settings.number(Key::Exponent),
        input_gain: settings.number(Key::InputGain),
    };
    let mut effects = [None; EFFECTS as usize];
    let mut places = effects.iter_mut();
    let mut numbers = None;
    for slot in 0..EFFECTS {
        let Some(found) = effect(settings, slot)? else {
            continue;
        };
        if let Effect::Table(_) = found {
            numbers = Some(table(settings, slot)?);
        }
        if let Some(place) = places.next() {
            *place = Some(found);
        }
    }
    Model::of_slots(dynamics, effects, numbers).map_err(Flaw::Model)
}

/// The sensors' calibration.
///
/// # Errors
///
/// [`Flaw::FlexTable`].
pub fn calibration(settings: &Settings) -> Result<Calibration, Flaw> {
    let zero = settings.number(Key::PressureZero);
    let pressure = Pressure::new(zero, settings.number(Key::PressureSpan));
    let points = settings.number(Key::FlexPoints);
    // The conversion saturates; what is not a whole number differs after it.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    let whole = points as u8;
    let flex = Flex::new(whole, |point| flex_point(settings, point));
    match flex {
        #[allow(clippy::float_cmp)] // Whole numbers are exact.
        Some(flex) if f32::from(whole) == points => Ok(Calibration { pressure, flex }),
        _ => Err(Flaw::FlexTable),
    }
}

/// A point of the flex sensor's table: counts and degrees.
#[inline(never)] // One copy of five.
fn flex_point(settings: &Settings, point: u8) -> (f32, f32) {
    (
        settings.number(Key::FlexCounts(point)),
        settings.number(Key::FlexAngle(point)),
    )
}

/// Where the rig is stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Gauge pressure (Pa) above which the rig is stopped.
    pub pressure_pa: f32,
    /// Bending angle (rad) above which the rig is stopped.
    pub angle_rad: f32,
    /// Silence of the computer (ms) that stops an armed rig.
    pub host_timeout_ms: u32,
}

impl Limits {
    /// Reads the limits.
    pub fn of(settings: &Settings) -> Self {
        Self {
            pressure_pa: settings.number(Key::MaxPressure) * 1_000.0,
            angle_rad: settings.number(Key::MaxAngle).to_radians(),
            // At most a minute.
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            host_timeout_ms: (settings.number(Key::HostTimeout) * 1_000.0) as u32,
        }
    }
}

/// Looks for what is wrong with settings as a whole.
///
/// # Errors
///
/// The first [`Flaw`] found.
pub fn examine(settings: &Settings) -> Result<(), Flaw> {
    // Identifiers of effects are integers below 2¹⁶, which as bits of a number
    // are finite too.
    if !settings
        .words()
        .iter()
        .all(|&word| f32::from_bits(word).is_finite())
    {
        return Err(Flaw::NotFinite);
    }
    model(settings)?;
    let calibration = calibration(settings)?;
    let limits = Limits::of(settings);

    let number = |key| settings.number(key);
    if number(Key::SetpointMax) > number(Key::MaxAngle)
        || number(Key::SetpointMaxPressure) > number(Key::MaxPressure)
    {
        return Err(Flaw::SetpointBeyondLimit);
    }
    if limits.pressure_pa > calibration.pressure.largest()
        || limits.angle_rad > calibration.flex.largest()
    {
        return Err(Flaw::LimitBeyondSensor);
    }
    if number(Key::MaxFlow) > number(Key::MaxFlowRate) * SLOWEST_RAMP_S {
        return Err(Flaw::SlowRamp);
    }
    if number(Key::MaxVolume) > number(Key::VolumePerStep) * MOST_STEPS {
        return Err(Flaw::TooManySteps);
    }
    Ok(())
}

/// Whether a draft of settings may be used.
///
/// # Errors
///
/// [`Refusal::BadSettings`] where [`examine`] finds a flaw.
pub fn check(settings: &Settings) -> Result<(), Refusal> {
    examine(settings).map_err(|_| Refusal::BadSettings)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::{io::Oversampled, sensing::SensorFault};
    use model_core::actuator::ParameterId;
    use proptest::prelude::*;

    fn with(changes: &[(Key, f32)]) -> Settings {
        let mut settings = Settings::DEFAULT;
        for &(key, value) in changes {
            settings.set(key, value.to_bits()).unwrap();
        }
        settings
    }

    fn put(settings: &mut Settings, slot: u8, kind: Kind, values: &[f32]) {
        let id = u32::from(effect_id(kind.name()));
        settings.set(Key::EffectKind { slot }, id).unwrap();
        for (index, value) in (0..).zip(values) {
            settings
                .set(Key::EffectParameter { slot, index }, value.to_bits())
                .unwrap();
        }
    }

    #[test]
    fn what_is_shipped_is_without_flaw() {
        assert_eq!(check(&Settings::DEFAULT), Ok(()));
        let model = model(&Settings::DEFAULT).unwrap();
        assert_eq!(model.effects().count(), 0);
        assert_eq!(
            model.value(ParameterId::InputGain),
            Some(Settings::DEFAULT.number(Key::InputGain))
        );
    }

    #[test]
    fn every_effect_of_the_catalogue_is_found_by_its_identifier() {
        for &kind in Kind::NAMES {
            let mut values = std::vec![0.0; kind.parameter_count()];
            for (index, value) in values.iter_mut().enumerate() {
                let (lower, upper) = kind.bounds(index).unwrap();
                *value = 0.05_f32.clamp(lower, upper);
            }
            let mut settings = Settings::DEFAULT;
            put(&mut settings, 1, kind, &values);
            assert_eq!(check(&settings), Ok(()), "{kind:?}");
            let model = model(&settings).unwrap();
            let effects: std::vec::Vec<_> = model.effects().collect();
            assert_eq!(effects, [kind.build(&values).unwrap()]);
        }
    }

    fn put_table(settings: &mut Settings, slot: u8, of: f32, nodes: &[f32], forces: &[f32]) {
        #[allow(clippy::cast_precision_loss)]
        put(settings, slot, Kind::Table, &[of, nodes.len() as f32]);
        for (index, (node, force)) in (0..).zip(nodes.iter().zip(forces)) {
            settings.set(Key::TableNode(index), node.to_bits()).unwrap();
            settings
                .set(Key::TableForce(index), force.to_bits())
                .unwrap();
        }
    }

    #[test]
    fn a_table_is_read_whatever_it_is_of() {
        let (nodes, forces) = ([-0.5, 0.0, 0.7], [0.1, 0.0, -0.3]);
        for (index, of) in (0_u8..).zip(Variable::ALL) {
            let mut settings = Settings::DEFAULT;
            put(&mut settings, 0, Kind::QuadraticDamping, &[0.1]);
            put_table(&mut settings, 2, f32::from(index), &nodes, &forces);
            assert_eq!(check(&settings), Ok(()), "{of:?}");
            let expected = Table::new(of, &nodes, &forces).unwrap();
            let model = model(&settings).unwrap();
            assert_eq!(model.table(), Some(&expected));
            assert_eq!(model.effects().last(), Some(Effect::Table(expected)));
        }
    }

    #[test]
    fn flaws_of_a_table_are_found() {
        let nodes: std::vec::Vec<f32> = (0..16_u8).map(f32::from).collect();
        let forces = [0.1; 16];
        let with = |slot, of: f32, change: &[(Key, f32)]| {
            let mut settings = Settings::DEFAULT;
            put_table(&mut settings, slot, of, &nodes, &forces);
            for &(key, value) in change {
                settings.set(key, value.to_bits()).unwrap();
            }
            examine(&settings)
        };
        assert_eq!(with(1, 1.0, &[]), Ok(()));
        for of in [4.0, 0.5, -1.0] {
            assert_eq!(with(1, of, &[]), Err(Flaw::UnknownEffect { slot: 1 }));
        }
        let count = Key::EffectParameter {
            slot: 1,
            index: TABLE_COUNT,
        };
        for bad in [0.0, 1.0, 2.5, 17.0, -3.0] {
            let flaw = Flaw::Table(InvalidTable::NodeCount);
            assert_eq!(with(1, 1.0, &[(count, bad)]), Err(flaw), "{bad}");
        }
        assert_eq!(
            with(1, 1.0, &[(Key::TableNode(7), 6.0)]),
            Err(Flaw::Table(InvalidTable::NotIncreasing(7)))
        );
        // What lies beyond the nodes in use does not matter.
        assert_eq!(
            with(1, 1.0, &[(count, 7.0), (Key::TableNode(7), 6.0)]),
            Ok(())
        );

        let mut two = Settings::DEFAULT;
        put_table(&mut two, 0, 0.0, &nodes, &forces);
        put_table(&mut two, 1, 1.0, &nodes, &forces);
        assert_eq!(examine(&two), Err(Flaw::Model(InvalidModel::NotOneTable)));
    }

    #[test]
    fn effects_keep_their_order_and_gaps_do_not_matter() {
        let mut settings = Settings::DEFAULT;
        put(&mut settings, 0, Kind::QuadraticDamping, &[0.1]);
        put(&mut settings, 2, Kind::CoulombFriction, &[0.02, 0.05]);
        let model = model(&settings).unwrap();
        let kinds: std::vec::Vec<_> = model.effects().map(|effect| effect.kind()).collect();
        assert_eq!(kinds, [Kind::QuadraticDamping, Kind::CoulombFriction]);
    }

    #[test]
    fn flaws_of_the_model_are_found() {
        let mut settings = Settings::DEFAULT;
        for id in [
            1,
            0xffff,
            0x1_0000 | u32::from(effect_id(Kind::Gravity.name())),
        ] {
            settings.set(Key::EffectKind { slot: 2 }, id).unwrap();
            assert_eq!(examine(&settings), Err(Flaw::UnknownEffect { slot: 2 }));
        }
        put(&mut settings, 2, Kind::CoulombFriction, &[-0.1, 0.05]);
        assert_eq!(
            examine(&settings),
            Err(Flaw::Model(InvalidModel::OutOfBounds(
                ParameterId::Effect {
                    slot: 0,
                    parameter: 0
                }
            )))
        );
        assert_eq!(check(&settings), Err(Refusal::BadSettings));
    }

    #[test]
    fn flaws_of_the_calibration_are_found() {
        for (change, flaw) in [
            ((Key::FlexCounts(3), 100.0), Flaw::FlexTable),
            ((Key::FlexAngle(3), 0.0), Flaw::FlexTable),
            ((Key::FlexPoints, 2.5), Flaw::FlexTable),
            // Three points end at 20 degrees.
            ((Key::FlexPoints, 3.0), Flaw::LimitBeyondSensor),
            ((Key::PressureSpan, 0.1), Flaw::LimitBeyondSensor),
            ((Key::SetpointMax, 140.0), Flaw::SetpointBeyondLimit),
            ((Key::SetpointMaxPressure, 190.0), Flaw::SetpointBeyondLimit),
            ((Key::VolumePerStep, 0.02), Flaw::TooManySteps),
        ] {
            assert_eq!(examine(&with(&[change])), Err(flaw), "{change:?}");
        }
        // What lies beyond the points in use does not matter.
        let unused = with(&[
            (Key::FlexPoints, 7.0),
            (Key::FlexAngle(7), 0.0),
            (Key::MaxAngle, 110.0),
        ]);
        assert_eq!(examine(&unused), Ok(()));
    }

    #[test]
    fn the_calibration_reads_the_shipped_sensors() {
        let calibration = calibration(&Settings::DEFAULT).unwrap();
        // 60° are 497.887 counts, 2.5 V are 40 psi.
        let angle = calibration.flex.angle(Oversampled(7_966)).unwrap();
        assert!((angle.to_degrees() - 60.0).abs() < 0.02);
        let pressure = calibration.pressure.pressure(Oversampled(8_192)).unwrap();
        assert!((pressure - 275_790.0).abs() < 50.0);
        assert_eq!(
            calibration.flex.angle(Oversampled(0)),
            Err(SensorFault::Low)
        );
        let limits = Limits::of(&Settings::DEFAULT);
        assert!((limits.pressure_pa - 180_000.0).abs() < 0.1);
        assert!((limits.angle_rad - 2.268_928).abs() < 1e-5);
        assert_eq!(limits.host_timeout_ms, 2_000);
    }

    proptest! {
        #[test]
        fn no_words_are_a_panic_and_none_pass_that_are_no_numbers(
            words in prop::collection::vec((0..usize::from(wire::settings::COUNT), any::<u32>()), 1..5),
        ) {
            let mut all = *Settings::DEFAULT.words();
            for (place, word) in words {
                all[place] = word;
            }
            let settings = Settings::from_words(all);
            if check(&settings).is_ok() {
                prop_assert!(all.iter().all(|&word| f32::from_bits(word).is_finite()));
                prop_assert!(model(&settings).is_ok() && calibration(&settings).is_ok());
            }
        }
    }
}
