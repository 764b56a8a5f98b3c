//! A board's settings as text, and a model as settings.
//!
//! The board keeps named 32-bit words ([`wire::settings`]). A settings file is TOML in
//! the units of the board. A model file is translated: kilopascals become pascals, and
//! effects become their numbers.

use std::fmt::Write;
use std::path::Path;

use model_core::actuator::Model;
use model_core::catalogue::{Effect, Kind};
use model_core::effects::Unit;
use model_core::effects::table::Variable;
use toml_edit::{Item, Value};
use wire::settings::{EFFECT_PARAMETERS, EFFECTS, Key, Settings, effect_id};
use wire::text::Text;

use crate::error::InputError;
use crate::model_file::ModelFile;
use crate::own_effects::refuse_on_board;
use crate::toml_reader::Reader;

/// The largest share of a number that rounding may change: ten times what it changes of
/// a number that single precision can hold.
const MOST_ROUNDED: f64 = 6e-7;

/// A setting and its bits.
pub type Assignment = (Key, u32);

/// The settings that make the board's model that of a file; slots that it does
/// not use are emptied.
///
/// # Errors
///
/// Names what the board cannot hold: more parameters than it has room for, a
/// number beyond single precision or beyond its bounds.
pub fn from_model(file: &ModelFile) -> Result<Vec<Assignment>, InputError> {
    let fail = |found: String, advice: String| InputError::new(found, advice).in_file(&file.path);
    let dynamics = file.model.dynamics();
    let mut wanted: Vec<(Key, f64)> = vec![
        (Key::Inertia, dynamics.inertia),
        (Key::Damping, dynamics.damping),
        (Key::Stiffness, dynamics.stiffness),
        (Key::Exponent, dynamics.exponent),
        (Key::InputGain, dynamics.input_gain),
    ];
    let mut kinds = Vec::new();
    // A load of nothing: one that hangs there has become a weight and an inertia.
    let on_board = |effect: &Effect<f64>| effect.kind() != Kind::TipLoad;
    let effects: Vec<_> = file.model.effects().filter(on_board).collect();
    if effects.len() > usize::from(EFFECTS) {
        return Err(fail(
            format!(
                "the model has {} effects, and the board has room for {EFFECTS}",
                effects.len()
            ),
            "keep the ones that matter most".into(),
        ));
    }
    refuse_on_board(file)?;
    for slot in 0..EFFECTS {
        let effect = effects.get(usize::from(slot));
        let id = effect.map_or(0, |effect| effect_id(effect.kind().name()));
        kinds.push((Key::EffectKind { slot }, u32::from(id)));
        let values: Vec<f64> = match effect {
            None => Vec::new(),
            Some(Effect::Table(table)) => {
                let pairs = table.nodes().iter().zip(table.forces());
                for (index, (&node, &force)) in (0..).zip(pairs) {
                    wanted.push((Key::TableNode(index), f64::from(node)));
                    wanted.push((Key::TableForce(index), force));
                }
                let of = Variable::ALL.iter().position(|&of| of == table.of());
                // What it is of, and how many nodes: a few.
                vec![of.unwrap_or(0) as f64, table.nodes().len() as f64]
            }
            Some(effect) => effect.values().collect(),
        };
        if let Some(effect) = effect
            && values.len() > usize::from(EFFECT_PARAMETERS)
        {
            return Err(fail(
                format!(
                    "the effect {} has {} parameters, and the board has room for {EFFECT_PARAMETERS}",
                    effect.kind().name(),
                    values.len()
                ),
                "leave it out".into(),
            ));
        }
        for index in 0..EFFECT_PARAMETERS {
            let value = values.get(usize::from(index)).copied().unwrap_or(0.0);
            wanted.push((Key::EffectParameter { slot, index }, value));
        }
    }
    let mut scratch = Settings::DEFAULT;
    let mut assignments = Vec::new();
    for (key, value) in wanted {
        #[allow(clippy::cast_possible_truncation)] // Rounding is the point.
        let bits = (value as f32).to_bits();
        if scratch.set(key, bits).is_err() {
            let (low, high) = key.bounds();
            return Err(fail(
                format!("{} would be {value} on the board", key_text(key)),
                format!(
                    "it takes {low} to {high} {} for \"{}\"",
                    key.unit(),
                    key.title()
                ),
            ));
        }
        let rounded = f64::from(f32::from_bits(bits));
        if (rounded - value).abs() > MOST_ROUNDED * value.abs() {
            return Err(fail(
                format!(
                    "{} is {value:e} and would be {rounded:e} in the board's single precision",
                    key_text(key)
                ),
                "choose a value that is larger or zero, or leave the effect out".into(),
            ));
        }
        assignments.push((key, bits));
    }
    #[allow(clippy::cast_possible_truncation)]
    let board = Model::<f32>::new(
        dynamics.map(|value| value as f32),
        &effects
            .iter()
            .map(|effect| effect.map(|value| value as f32))
            .collect::<Vec<_>>(),
    );
    if let Err(error) = board {
        return Err(fail(
            format!("a parameter {error} in the board's single precision"),
            "choose a value that seven digits can hold".into(),
        ));
    }
    assignments.extend(kinds);
    Ok(assignments)
}

/// Zeros of a board's sensors, from a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zeros {
    /// The zero of the pressure sensor (kPa).
    pub pressure_kpa: f64,
    /// The zero of the angle sensor (°).
    pub angle_deg: f64,
}

impl Zeros {
    /// The settings with which a board that has `settings` shows zero at zero.
    /// Zeros that `wanted` sets already are corrected further.
    ///
    /// # Errors
    ///
    /// Names what would leave its bounds.
    pub fn taken_from(
        self,
        settings: &Settings,
        wanted: &[Assignment],
    ) -> Result<Vec<Assignment>, InputError> {
        let mut draft = settings.clone();
        for &(key, bits) in wanted {
            // What is out of bounds is told where it was read.
            let _ = draft.set(key, bits);
        }
        let number = |key| f64::from(draft.number(key));
        let mut moved = vec![(
            Key::PressureZero,
            number(Key::PressureZero) + self.pressure_kpa / number(Key::PressureSpan),
        )];
        for point in 0..wire::settings::FLEX_POINTS {
            if f64::from(point) < number(Key::FlexPoints) {
                let key = Key::FlexAngle(point);
                moved.push((key, number(key) - self.angle_deg));
            }
        }
        moved
            .into_iter()
            .map(|(key, value)| {
                #[allow(clippy::cast_possible_truncation)] // Rounding is the point.
                let bits = (value as f32).to_bits();
                draft.clone().set(key, bits).map_err(|_| {
                    let (low, high) = key.bounds();
                    InputError::new(
                        format!("{} would be {value}", key_text(key)),
                        format!(
                            "the board takes {low} to {high} {}: calibrate the sensor anew with `softrig calibrate`",
                            key.unit()
                        ),
                    )
                })?;
                Ok((key, bits))
            })
            .collect()
    }
}

/// Reads a file of settings.
///
/// # Errors
///
/// Names file, line, column and remedy.
pub fn read(path: &Path) -> Result<Vec<Assignment>, InputError> {
    let text = crate::bounded::read_text(path)?;
    parse(&text, path)
}

/// Parses the text of a file of settings; `path` names it in messages.
///
/// # Errors
///
/// Like [`read`].
pub fn parse(text: &str, path: &Path) -> Result<Vec<Assignment>, InputError> {
    let toml = Reader { text, path };
    let document = toml.parse()?;
    let mut assignments = Vec::new();
    collect("", document.as_item(), &mut |name, item| {
        let fault = |found: String, advice: String| toml.fail_at(item.span(), found, advice);
        let key = Key::parse(name.as_bytes()).ok_or_else(|| {
            fault(
                format!("there is no setting {name}"),
                "`softrig upload --read` prints all that there are".into(),
            )
        })?;
        assignments.push((key, bits_of(key, name, item, fault)?));
        Ok(())
    })?;
    if assignments.is_empty() {
        return Err(toml.fail(
            "has no settings",
            "write lines like max.kpa = 150.0; `softrig upload --read` prints all",
        ));
    }
    Ok(assignments)
}

fn bits_of(
    key: Key,
    name: &str,
    item: &Item,
    fault: impl Fn(String, String) -> InputError,
) -> Result<u32, InputError> {
    if matches!(key, Key::EffectKind { .. }) {
        return match item.as_str() {
            Some("none") => Ok(0),
            Some(text) if Kind::from_name(text).is_some() => Ok(u32::from(effect_id(text))),
            _ => {
                let known: Vec<&str> = Kind::ALL.iter().map(|kind| kind.name()).collect();
                Err(fault(
                    format!("{} is not an effect", item.to_string().trim()),
                    format!("use \"none\" or one of: {}", known.join(", ")),
                ))
            }
        };
    }
    let number = item
        .as_float()
        .or_else(|| item.as_integer().map(|whole| whole as f64))
        .ok_or_else(|| {
            fault(
                format!("{name} is not a number"),
                "write a number without quotes and without a unit".into(),
            )
        })?;
    #[allow(clippy::cast_possible_truncation)] // The board's precision.
    let bits = (number as f32).to_bits();
    if Settings::DEFAULT.clone().set(key, bits).is_err() {
        let (low, high) = key.bounds();
        return Err(fault(
            format!("{name} is {number}"),
            format!("give a value from {low} to {high} {}", key.unit()),
        ));
    }
    Ok(bits)
}

/// Dotted keys are tables within tables.
fn collect(
    prefix: &str,
    item: &Item,
    take: &mut dyn FnMut(&str, &Item) -> Result<(), InputError>,
) -> Result<(), InputError> {
    let Some(table) = item.as_table_like() else {
        return take(prefix, item);
    };
    for (key, inner) in table.iter() {
        let name = if prefix.is_empty() {
            key.to_owned()
        } else {
            format!("{prefix}.{key}")
        };
        collect(&name, inner, take)?;
    }
    Ok(())
}

/// A value for people: a number, or the name of an effect.
pub fn shown(key: Key, bits: u32) -> String {
    if !matches!(key, Key::EffectKind { .. }) {
        return f32::from_bits(bits).to_string();
    }
    if bits == 0 {
        return "none".into();
    }
    Kind::ALL
        .iter()
        .find(|kind| u32::from(effect_id(kind.name())) == bits)
        .map_or_else(
            || format!("unknown effect {bits:08x}"),
            |kind| kind.name().to_owned(),
        )
}

/// The unit of a setting of a board that has `settings`: a parameter of an effect has the unit of
/// that effect. Without an effect in the slot there is none.
pub fn unit(settings: &Settings, key: Key) -> &'static str {
    let kind = |slot| {
        let id = settings.bits(Key::EffectKind { slot })?;
        Kind::ALL
            .iter()
            .find(|kind| u32::from(effect_id(kind.name())) == id)
    };
    match key {
        Key::EffectParameter { slot, index } => match kind(slot) {
            Some(Kind::Table) | None => "",
            Some(kind) => kind
                .parameters()
                .get(usize::from(index))
                .map_or("", |parameter| si_symbol(parameter.unit)),
        },
        Key::TableNode(_) => (0..EFFECTS)
            .find(|&slot| kind(slot) == Some(&Kind::Table))
            .and_then(|slot| {
                let index = wire::settings::TABLE_OF;
                // One of four.
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
                let of = settings.number(Key::EffectParameter { slot, index }) as usize;
                Variable::ALL.get(of)
            })
            .map_or("", |of| match of {
                Variable::Angle => "rad",
                Variable::Rate => "rad/s",
                Variable::Pressure => "Pa",
                Variable::Time => "s",
            }),
        key => match key.unit() {
            "1" | "identifier" => "",
            unit => unit,
        },
    }
}

/// The unit of a parameter on the board, which has pascals where files have kilopascals.
const fn si_symbol(unit: Unit) -> &'static str {
    match unit {
        Unit::KiloPascal => "Pa",
        Unit::PerKiloPascal => "1/Pa",
        unit => unit.symbol(),
    }
}

/// All settings as a file that reads back to the same bits.
pub fn to_text(settings: &Settings, about: &str) -> String {
    let mut text = format!("# {about}\n");
    for key in Key::all() {
        let bits = settings.bits(key).unwrap_or(0);
        let value = if matches!(key, Key::EffectKind { .. }) {
            Value::from(shown(key, bits)).to_string().trim().to_owned()
        } else {
            // The fewest digits that lead back to the same bits.
            format!("{:?}", f32::from_bits(bits))
        };
        let _ = writeln!(
            text,
            "{:<10} = {value:<12} # {}{}",
            key_text(key),
            key.title(),
            match unit(settings, key) {
                "" => String::new(),
                unit => format!(" ({unit})"),
            }
        );
    }
    text
}

/// The word of a setting.
pub fn key_text(key: Key) -> String {
    let mut text = Text::default();
    let Ok(()) = key.write(&mut text);
    text.0
}

/// Those of the wanted settings that a board with `settings` does not have yet.
pub fn changes(settings: &Settings, wanted: Vec<Assignment>) -> Vec<Assignment> {
    wanted
        .into_iter()
        .filter(|&(key, bits)| settings.bits(key) != Some(bits))
        .collect()
}

/// A table of changes: names, old and new values, units.
pub fn changes_text(settings: &Settings, changes: &[Assignment]) -> String {
    let mut after = settings.clone();
    for &(key, bits) in changes {
        // What is out of bounds is told before.
        let _ = after.set(key, bits);
    }
    let rows: Vec<[String; 4]> = changes
        .iter()
        .map(|&(key, bits)| {
            [
                key_text(key),
                shown(key, settings.bits(key).unwrap_or(0)),
                shown(key, bits),
                // A removed effect still gives the unit.
                [&after, settings]
                    .map(|settings| unit(settings, key))
                    .into_iter()
                    .find(|unit| !unit.is_empty())
                    .unwrap_or_default()
                    .to_owned(),
            ]
        })
        .collect();
    let width = |column: usize| {
        rows.iter()
            .map(|row| row[column].chars().count())
            .max()
            .unwrap_or(0)
    };
    let (names, old, new) = (width(0), width(1), width(2));
    rows.iter()
        .fold(String::new(), |text, [name, from, to, unit]| {
            let line = format!("{name:<names$}  {from:>old$} → {to:<new$}  {unit}");
            text + line.trim_end() + "\n"
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::settings::{TABLE_COUNT, TABLE_OF};

    #[test]
    fn zeros_move_the_calibration_by_what_the_sensors_show() {
        let zeros = Zeros {
            pressure_kpa: 0.35,
            angle_deg: -1.5,
        };
        let settings = Settings::DEFAULT;
        let mut moved = settings.clone();
        for (key, bits) in zeros.taken_from(&settings, &[]).unwrap() {
            moved.set(key, bits).unwrap();
        }
        let pressure = |settings: &Settings, counts: f32| {
            (counts - settings.number(Key::PressureZero)) * settings.number(Key::PressureSpan)
        };
        // What read 0.35 kPa reads nothing now.
        let counts = 102.4 + 0.35 / settings.number(Key::PressureSpan);
        assert!((pressure(&settings, counts) - 0.35).abs() < 1e-4);
        assert!(pressure(&moved, counts).abs() < 1e-4);
        let angle = |settings: &Settings| settings.number(Key::FlexAngle(1));
        assert!((angle(&moved) - angle(&settings) - 1.5).abs() < 1e-4);
        let far = Zeros {
            pressure_kpa: 1e4,
            angle_deg: 0.0,
        };
        let message = far.taken_from(&settings, &[]).unwrap_err().to_string();
        assert!(
            message.contains("p.zero") && message.contains("calibrate"),
            "{message}"
        );
    }

    #[test]
    fn settings_survive_their_file_to_the_bit() {
        let mut settings = Settings::DEFAULT;
        settings.set(Key::Damping, 0.1_f32.to_bits()).unwrap();
        settings
            .set(Key::EffectKind { slot: 1 }, u32::from(effect_id("gravity")))
            .unwrap();
        let text = to_text(&settings, "a board");
        let mut back = Settings::from_words([0; wire::settings::COUNT as usize]);
        for (key, bits) in parse(&text, Path::new("s.toml")).unwrap() {
            back.set(key, bits).unwrap();
        }
        assert_eq!(back, settings);
    }

    #[test]
    fn faults_name_line_and_column() {
        for (text, parts) in [
            (
                "max.kpa = 900\n",
                vec!["line 1, column 11", "900", "400 kPa"],
            ),
            ("\nwarp = 9\n", vec!["line 2, column 8", "warp", "--read"]),
            ("max.kpa = \"9\"\n", vec!["line 1", "not a number"]),
            ("e0.kind = \"magic\"\n", vec!["line 1", "magic", "gravity"]),
            ("", vec!["no settings"]),
            ("a = \n", vec!["line 1"]),
        ] {
            let message = parse(text, Path::new("s.toml")).unwrap_err().to_string();
            for part in parts {
                assert!(message.contains(part), "{part:?} not in {message:?}");
            }
        }
    }

    const MODEL: &str = "schema = 1\nname = \"m\"\n[dynamics]\ninertia_kg_m = 0.36\ndamping_n_s_per_rad = 0.9\nstiffness_n_per_rad_n = 4.2\nexponent = 1.727\ninput_gain_n_per_kpa = 0.12\n[[effect]]\nkind = \"coulomb_friction\"\nforce_n = 0.02\n";

    #[test]
    fn a_model_becomes_si_settings_and_empties_the_other_slots() {
        let file = ModelFile::parse(MODEL, Path::new("m.toml")).unwrap();
        let assignments = from_model(&file).unwrap();
        let bits = |key| {
            assignments
                .iter()
                .find(|(assigned, _)| *assigned == key)
                .unwrap()
                .1
        };
        assert_eq!(bits(Key::InputGain), 1.2e-4_f32.to_bits());
        assert_eq!(
            bits(Key::EffectKind { slot: 0 }),
            u32::from(effect_id("coulomb_friction"))
        );
        assert_eq!(
            bits(Key::EffectParameter { slot: 0, index: 0 }),
            0.02_f32.to_bits()
        );
        assert_eq!(bits(Key::EffectKind { slot: 2 }), 0);
        assert_eq!(bits(Key::EffectParameter { slot: 2, index: 3 }), 0);
        // Calibration and limits are not the model's.
        assert_eq!(assignments.len(), 5 + 3 * 5);
    }

    #[test]
    fn a_table_becomes_settings_of_its_own() {
        let text = MODEL.to_owned()
            + "[[effect]]\nkind = \"table\"\nof = \"pressure\"\nnodes = [0, 12.5, 40]\nforces_n = [0.1, 0.2, -0.3]\n";
        let file = ModelFile::parse(&text, Path::new("m.toml")).unwrap();
        let mut settings = Settings::DEFAULT;
        for (key, bits) in from_model(&file).unwrap() {
            settings.set(key, bits).unwrap();
        }
        let id = settings.bits(Key::EffectKind { slot: 1 });
        assert_eq!(id, Some(u32::from(effect_id("table"))));
        let bits = |index| settings.bits(Key::EffectParameter { slot: 1, index });
        let whole = [2.0, 3.0].map(|whole: f32| Some(whole.to_bits()));
        assert_eq!([bits(TABLE_OF), bits(TABLE_COUNT)], whole);
        let table: Vec<(f32, f32)> = settings.table().take(4).collect();
        assert_eq!(
            table,
            [(0.0, 0.1), (12_500.0, 0.2), (40_000.0, -0.3), (0.0, 0.0)]
        );
        assert!(to_text(&settings, "a board").contains("t.x1       = 12500.0"));
    }

    #[test]
    fn what_the_board_cannot_hold_is_refused() {
        for (from, to, part) in [
            ("inertia_kg_m = 0.36", "inertia_kg_m = 1e-8", "inertia"),
            ("n_per_kpa = 0.12", "n_per_kpa = 5000.0", "gain would be 5"),
            (
                "exponent = 1.727",
                "exponent = 12.0",
                "exponent would be 12",
            ),
        ] {
            let text = MODEL.replace(from, to);
            let file = ModelFile::parse(&text, Path::new("m.toml")).unwrap();
            let message = from_model(&file).unwrap_err().to_string();
            assert!(
                message.starts_with("m.toml: ") && message.contains(part),
                "{message}"
            );
        }
    }

    #[test]
    fn the_table_shows_both_values_and_the_unit() {
        let changes = [
            (Key::Damping, 0.9_f32.to_bits()),
            (
                Key::EffectKind { slot: 0 },
                u32::from(wire::settings::effect_id("gravity")),
            ),
        ];
        let mut settings = Settings::DEFAULT;
        settings.set(Key::Damping, 1.8_f32.to_bits()).unwrap();
        assert_eq!(
            changes_text(&settings, &changes),
            "damping   1.8 → 0.9      N s/rad\ne0.kind  none → gravity\n"
        );
    }

    #[test]
    fn parameters_of_effects_have_the_units_of_their_effects() {
        let kind = Key::EffectKind { slot: 1 };
        let parameter = Key::EffectParameter { slot: 1, index: 0 };
        let friction = u32::from(wire::settings::effect_id("coulomb_friction"));
        let changes = [(kind, friction), (parameter, 0.02_f32.to_bits())];
        let text = changes_text(&Settings::DEFAULT, &changes);
        assert!(
            text.lines()
                .any(|line| line.ends_with("0.02              N")),
            "{text}"
        );
        // It goes again.
        let mut settings = Settings::DEFAULT;
        for (key, bits) in changes {
            settings.set(key, bits).unwrap();
        }
        let text = changes_text(&settings, &[(kind, 0), (parameter, 0)]);
        assert!(text.lines().any(|line| line.ends_with(" N")), "{text}");
        assert!(!text.contains("SI"), "{text}");
    }
}
