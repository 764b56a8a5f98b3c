//! The settings of a board, by name.
//!
//! The model with its effects, the calibration and the limits are one flat list of 32-bit
//! words. That keeps the record in EEPROM, the lines that change it and the comparison
//! after an upload simple and exact; [`Key`] defines the words.

use crate::keyword::Keyword;

/// Effects that the board's model can have.
pub const EFFECTS: u8 = 3;
/// The most parameters of one effect.
pub const EFFECT_PARAMETERS: u8 = 4;
/// The most nodes of the table that the model can have.
pub const TABLE_NODES: u8 = 16;
/// The most points of the flex sensor's calibration table.
pub const FLEX_POINTS: u8 = 8;

macro_rules! scalars {
    ($( $variant:ident = $index:literal, $word:literal, $default:expr, $lower:expr, $upper:expr, $unit:literal, $doc:literal; )+) => {
        /// One setting.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Key {
            $( #[doc = concat!($doc, " (", $unit, ").")] $variant, )+
            /// Which effect is in a slot: its [`effect_id`], zero for none. An
            /// integer, all other settings are floating-point numbers.
            EffectKind {
                /// The slot, below [`EFFECTS`].
                slot: u8,
            },
            /// A parameter of the effect in a slot, SI units, in the order of
            /// the effect's table.
            EffectParameter {
                /// The slot, below [`EFFECTS`].
                slot: u8,
                /// The parameter, below [`EFFECT_PARAMETERS`].
                index: u8,
            },
            /// A node of the model's table (SI units). What it is a table of and how
            /// many nodes it has are the first two parameters of its slot.
            TableNode(u8),
            /// The force at a node of the model's table (N).
            TableForce(u8),
            /// The flex sensor's reading at a calibration point (counts of a
            /// ten-bit converter, with fractions).
            FlexCounts(u8),
            /// The bending angle at a calibration point (°).
            FlexAngle(u8),
        }

        impl Key {
            /// The settings that are not lists.
            pub const SCALARS: &'static [Self] = &[$( Self::$variant ),+];

            const fn scalar_index(self) -> Option<u8> {
                Some(match self {
                    $( Self::$variant => $index, )+
                    _ => return None,
                })
            }

            fn parse_scalar(word: Keyword) -> Option<Self> {
                $(
                    if word == const { Keyword::of($word) } {
                        return Some(Self::$variant);
                    }
                )+
                None
            }

            const fn scalar_keyword(self) -> Option<Keyword> {
                Some(match self {
                    $( Self::$variant => const { Keyword::of($word) }, )+
                    _ => return None,
                })
            }

            /// Smallest and largest value allowed, in the setting's unit.
            pub const fn bounds(self) -> (f32, f32) {
                match self {
                    $( Self::$variant => ($lower, $upper), )+
                    // An identifier; any value may be stored, and an unknown
                    // one is refused when a model is made of it.
                    Self::EffectKind { .. } => (f32::NEG_INFINITY, f32::INFINITY),
                    Self::EffectParameter { .. } | Self::TableNode(_) | Self::TableForce(_) => {
                        (-1e9, 1e9)
                    }
                    Self::FlexCounts(_) => (0.0, 1023.0),
                    Self::FlexAngle(_) => (-180.0, 360.0),
                }
            }

            /// Unit, for people.
            pub const fn unit(self) -> &'static str {
                match self {
                    $( Self::$variant => $unit, )+
                    Self::EffectKind { .. } => "identifier",
                    Self::EffectParameter { .. } | Self::TableNode(_) => "SI",
                    Self::TableForce(_) => "N",
                    Self::FlexCounts(_) => "counts",
                    Self::FlexAngle(_) => "deg",
                }
            }

            /// Its description for people.
            pub const fn title(self) -> &'static str {
                match self {
                    $( Self::$variant => $doc, )+
                    Self::EffectKind { .. } => "Effect in a slot of the model",
                    Self::EffectParameter { .. } => "Parameter of an effect",
                    Self::TableNode(_) => "Node of the model's table",
                    Self::TableForce(_) => "Force at a node of the model's table",
                    Self::FlexCounts(_) => "Flex sensor's reading at a calibration point",
                    Self::FlexAngle(_) => "Bending angle at a calibration point",
                }
            }
        }

        #[allow(clippy::cast_possible_truncation)] // A few dozen.
        const SCALAR_COUNT: u8 = [$( $index as u8 ),+].len() as u8;

        const fn scalar_defaults() -> [f32; SCALAR_COUNT as usize] {
            let mut defaults = [f32::NAN; SCALAR_COUNT as usize];
            $( defaults[$index] = $default; )+
            defaults
        }
    };
}

scalars! {
    Inertia = 0, "inertia", 0.25, 1e-6, 1e6, "kg m", "Effective inertia M";
    Damping = 1, "damping", 1.5, 0.0, 1e6, "N s/rad", "Viscous damping C";
    Stiffness = 2, "stiff", 4.0, 0.0, 1e6, "N/rad^n", "Stiffness K";
    Exponent = 3, "exponent", 1.727, 0.05, 10.0, "1", "Exponent n of Ludwick's law";
    InputGain = 4, "gain", 1e-4, 1e-9, 1.0, "N/Pa", "Input gain g";
    FlexPoints = 5, "f.n", 8.0, 2.0, 8.0, "1", "Points of the flex sensor's table in use";
    PressureZero = 6, "p.zero", 102.4, 51.2, 153.6, "counts", "Pressure sensor's reading at gauge zero, 0.25 to 0.75 V";
    PressureSpan = 7, "p.span", 0.673_316, 0.05, 5.0, "kPa/count", "Pressure per count, of sensors to 40 kPa up to 4 MPa";
    MaxPressure = 8, "max.kpa", 180.0, 1.0, 400.0, "kPa", "Pressure at which the rig is stopped";
    MaxAngle = 9, "max.deg", 130.0, 1.0, 330.0, "deg", "Bending angle at which the rig is stopped";
    MaxVolume = 10, "max.ul", 50_000.0, 100.0, 100_000.0, "ul", "Largest volume that the pump may displace";
    MaxFlow = 11, "max.flow", 5_000.0, 10.0, 20_000.0, "ul/s", "Fastest flow of the pump";
    MaxFlowRate = 12, "max.acc", 40_000.0, 100.0, 500_000.0, "ul/s^2", "Fastest change of the flow";
    SetpointMax = 13, "set.deg", 110.0, 1.0, 330.0, "deg", "Largest angle that may be asked for";
    SetpointMaxPressure = 14, "set.kpa", 160.0, 1.0, 400.0, "kPa", "Largest pressure that may be asked for";
    SetpointRate = 15, "set.rate", 720.0, 1.0, 10_000.0, "deg/s", "Fastest change of an angle set-point";
    SetpointPressureRate = 16, "set.prat", 2_000.0, 1.0, 50_000.0, "kPa/s", "Fastest change of a pressure set-point";
    VolumePerStep = 17, "ul.step", 0.35, 1e-4, 1e3, "ul", "Volume of one microstep";
    PressureGain = 18, "kp.kpa", 4_000.0, 0.0, 1e5, "ul/s per kPa", "Proportional gain of the pressure loop at rest; less above, by the gas law";
    PressureIntegral = 19, "ki.kpa", 500.0, 0.0, 1e5, "ul/s^2 per kPa", "Integral gain of the pressure loop";
    AngleBandwidth = 20, "w.deg", 4.0, 0.1, 50.0, "rad/s", "Bandwidth of the angle loop";
    AngleSmoothing = 21, "tau.deg", 0.2, 0.02, 10.0, "s", "Smoothing of the model's error in the angle loop";
    AngleLead = 22, "lead.deg", 0.5, 0.0, 10.0, "s", "Lead of the model's error in the angle loop";
    MismatchBand = 23, "band.deg", 5.0, 0.1, 360.0, "deg", "Gap between prediction and measurement that counts as mismatch";
    MismatchTime = 24, "band.s", 0.5, 0.01, 60.0, "s", "Time outside the band after which the mismatch flag is set";
    HostTimeout = 25, "beat.s", 2.0, 0.2, 60.0, "s", "Silence of the computer that stops an armed rig";
}

/// Words in the settings.
pub const COUNT: u8 = FIRST_TABLE + 2 * TABLE_NODES;

/// Words that are not zero in what a board is shipped with, and all before them.
pub const SHIPPED_COUNT: u8 = FIRST_TABLE;

const FIRST_FLEX: u8 = SCALAR_COUNT + EFFECTS * (1 + EFFECT_PARAMETERS);
const FIRST_TABLE: u8 = FIRST_FLEX + 2 * FLEX_POINTS;

/// The parameter of a table's slot that says what it is a table of, as a whole
/// number: the place in `Variable::ALL` of model-core.
pub const TABLE_OF: u8 = 0;
/// The parameter of a table's slot that says how many nodes it has.
pub const TABLE_COUNT: u8 = 1;

/// The flex sensor's table as shipped: a divider of a sensor with
/// 25 kΩ (70/25)^(θ/90°) to 5 V and 47 kΩ to ground.
const FLEX: [(f32, f32); FLEX_POINTS as usize] = [
    (707.163, -15.0),
    (668.444, 0.0),
    (613.663, 20.0),
    (556.346, 40.0),
    (497.887, 60.0),
    (439.794, 80.0),
    (369.918, 105.0),
    (305.341, 130.0),
];

impl Key {
    /// The place in the list; none for an index beyond a list's end.
    #[inline(always)]
    pub const fn index(self) -> Option<u8> {
        let after_scalars = SCALAR_COUNT;
        match self {
            Self::EffectKind { slot } if slot < EFFECTS => {
                Some(after_scalars + slot * (1 + EFFECT_PARAMETERS))
            }
            Self::EffectParameter { slot, index }
                if slot < EFFECTS && index < EFFECT_PARAMETERS =>
            {
                Some(after_scalars + slot * (1 + EFFECT_PARAMETERS) + 1 + index)
            }
            Self::TableNode(node) if node < TABLE_NODES => Some(FIRST_TABLE + node),
            Self::TableForce(node) if node < TABLE_NODES => Some(FIRST_TABLE + TABLE_NODES + node),
            Self::FlexCounts(point) if point < FLEX_POINTS => Some(FIRST_FLEX + point),
            Self::FlexAngle(point) if point < FLEX_POINTS => Some(FIRST_FLEX + FLEX_POINTS + point),
            _ => self.scalar_index(),
        }
    }

    /// Every key, in the order of the list.
    pub fn all() -> impl Iterator<Item = Self> {
        let effects = (0..EFFECTS).flat_map(|slot| {
            core::iter::once(Self::EffectKind { slot }).chain(
                (0..EFFECT_PARAMETERS).map(move |index| Self::EffectParameter { slot, index }),
            )
        });
        Self::SCALARS
            .iter()
            .copied()
            .chain(effects)
            .chain((0..FLEX_POINTS).map(Self::FlexCounts))
            .chain((0..FLEX_POINTS).map(Self::FlexAngle))
            .chain((0..TABLE_NODES).map(Self::TableNode))
            .chain((0..TABLE_NODES).map(Self::TableForce))
    }

    /// Reads the word of a line.
    pub fn parse(word: &[u8]) -> Option<Self> {
        let digit = |byte: &u8, count: u8| byte.checked_sub(b'0').filter(|&value| value < count);
        match word {
            [b'e', slot, b'.', b'k', b'i', b'n', b'd'] => Some(Self::EffectKind {
                slot: digit(slot, EFFECTS)?,
            }),
            [b'e', slot, b'.', b'p', index] => Some(Self::EffectParameter {
                slot: digit(slot, EFFECTS)?,
                index: digit(index, EFFECT_PARAMETERS)?,
            }),
            [b't', b'.', b'x', node] => Some(Self::TableNode(hexadecimal(*node)?)),
            [b't', b'.', b'q', node] => Some(Self::TableForce(hexadecimal(*node)?)),
            [b'f', b'.', b'c', point] => Some(Self::FlexCounts(digit(point, FLEX_POINTS)?)),
            [b'f', b'.', b'a', point] => Some(Self::FlexAngle(digit(point, FLEX_POINTS)?)),
            _ => Self::parse_scalar(Keyword::parse(word)?),
        }
    }

    /// Writes the word of a line.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn write<W: ufmt::uWrite + ?Sized>(self, out: &mut W) -> Result<(), W::Error> {
        use ufmt::uwrite;
        match self {
            Self::EffectKind { slot } => uwrite!(out, "e{}.kind", slot),
            Self::EffectParameter { slot, index } => uwrite!(out, "e{}.p{}", slot, index),
            Self::TableNode(node) => uwrite!(out, "t.x{:x}", node),
            Self::TableForce(node) => uwrite!(out, "t.q{:x}", node),
            Self::FlexCounts(point) => uwrite!(out, "f.c{}", point),
            Self::FlexAngle(point) => uwrite!(out, "f.a{}", point),
            scalar => match scalar.scalar_keyword() {
                Some(word) => uwrite!(out, "{}", word),
                None => Ok(()),
            },
        }
    }
}

/// All settings of a board.
///
/// Equality is that of the bits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Settings([u32; COUNT as usize]);

/// The node of a table, 0 to f.
const fn hexadecimal(byte: u8) -> Option<u8> {
    match byte {
        b'0'..=b'9' => Some(byte - b'0'),
        b'a'..=b'f' => Some(byte - b'a' + 10),
        _ => None,
    }
}

/// Why a setting cannot have a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InvalidSetting {
    /// There is no such setting.
    NoSuchKey,
    /// The value is not a number or outside [`Key::bounds`].
    OutOfBounds,
}

impl Settings {
    /// The settings of a new board.
    pub const DEFAULT: Self = Self::shipped();

    /// All words zero: no settings yet.
    pub const EMPTY: Self = Self([0; COUNT as usize]);

    const fn shipped() -> Self {
        let mut words = [0; COUNT as usize];
        let scalars = scalar_defaults();
        let mut index = 0;
        while index < scalars.len() {
            words[index] = scalars[index].to_bits();
            index += 1;
        }
        let counts = FIRST_FLEX as usize;
        let angles = counts + FLEX_POINTS as usize;
        let mut point = 0;
        while point < FLEX.len() {
            words[counts + point] = FLEX[point].0.to_bits();
            words[angles + point] = FLEX[point].1.to_bits();
            point += 1;
        }
        Self(words)
    }

    /// Makes settings of stored words, unchecked.
    pub const fn from_words(words: [u32; COUNT as usize]) -> Self {
        Self(words)
    }

    /// The words, to be filled in unchecked: in place, since a copy is large for a
    /// board's stack.
    pub const fn words_mut(&mut self) -> &mut [u32; COUNT as usize] {
        &mut self.0
    }

    /// The words, as they are stored.
    pub const fn words(&self) -> &[u32; COUNT as usize] {
        &self.0
    }

    /// The bits of a setting; none for an index beyond a list's end.
    #[inline(always)]
    pub fn bits(&self, key: Key) -> Option<u32> {
        self.0.get(usize::from(key.index()?)).copied()
    }

    /// A setting as a number; not-a-number for an index beyond a list's end.
    #[inline(always)] // Of a key that is known, the place is a constant.
    pub fn number(&self, key: Key) -> f32 {
        self.bits(key).map_or(f32::NAN, f32::from_bits)
    }

    /// The nodes of the table (SI units) with the forces at them (N), also those that
    /// are not in use.
    pub fn table(&self) -> impl Iterator<Item = (f32, f32)> {
        let (_, words) = self.0.split_at(FIRST_TABLE as usize);
        let (nodes, forces) = words.split_at(TABLE_NODES as usize);
        let pairs = nodes.iter().zip(forces);
        pairs.map(|(&node, &force)| (f32::from_bits(node), f32::from_bits(force)))
    }

    /// Changes a setting.
    ///
    /// # Errors
    ///
    /// [`InvalidSetting`]; nothing is changed then.
    pub fn set(&mut self, key: Key, bits: u32) -> Result<(), InvalidSetting> {
        if !matches!(key, Key::EffectKind { .. }) {
            let (lower, upper) = key.bounds();
            // Written so that not-a-number fails.
            if !(lower..=upper).contains(&f32::from_bits(bits)) {
                return Err(InvalidSetting::OutOfBounds);
            }
        }
        let place = key
            .index()
            .and_then(|index| self.0.get_mut(usize::from(index)))
            .ok_or(InvalidSetting::NoSuchKey)?;
        *place = bits;
        Ok(())
    }
}

/// The number under which an effect is stored: the checksum of its name, which
/// stays the same when the catalogue grows. Zero is kept for "no effect".
pub const fn effect_id(name: &str) -> u16 {
    let mut crc = crate::checksum::Crc16::new();
    let mut rest = name.as_bytes();
    while let [byte, tail @ ..] = rest {
        crc.update(*byte);
        rest = tail;
    }
    match crc.value() {
        0 => 1,
        id => id,
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::text::Text;
    use std::vec::Vec;

    #[test]
    fn keys_fill_the_list_once_and_their_words_lead_back() {
        let mut indices: Vec<u8> = Vec::new();
        for key in Key::all() {
            indices.push(key.index().unwrap());
            let mut out = Text::default();
            key.write(&mut out).unwrap();
            assert_eq!(Key::parse(out.0.as_bytes()), Some(key), "{}", out.0);
        }
        indices.sort_unstable();
        assert_eq!(indices, (0..COUNT).collect::<Vec<_>>());
    }

    #[test]
    fn what_is_shipped_has_no_table() {
        let (_, table) = Settings::DEFAULT
            .words()
            .split_at(usize::from(SHIPPED_COUNT));
        assert!(table.len() == 2 * usize::from(TABLE_NODES) && table.iter().all(|&word| word == 0));
    }

    #[test]
    fn what_is_shipped_is_allowed() {
        let mut settings = Settings::DEFAULT;
        for key in Key::all() {
            let bits = settings.bits(key).unwrap();
            assert_eq!(settings.set(key, bits), Ok(()), "{key:?}");
        }
        assert_eq!(settings, Settings::DEFAULT);
    }

    #[test]
    fn nonsense_is_refused_and_changes_nothing() {
        let mut settings = Settings::DEFAULT;
        for bits in [f32::NAN, f32::INFINITY, -1.0, 1e9].map(f32::to_bits) {
            assert_eq!(
                settings.set(Key::Exponent, bits),
                Err(InvalidSetting::OutOfBounds)
            );
        }
        assert_eq!(
            settings.set(Key::FlexCounts(8), 1.0_f32.to_bits()),
            Err(InvalidSetting::NoSuchKey)
        );
        assert_eq!(settings, Settings::DEFAULT);
        for word in [
            &b""[..],
            b"e3.kind",
            b"e0.p4",
            b"t.xg",
            b"t.q",
            b"t.x10",
            b"f.c8",
            b"f.c",
            b"warp",
        ] {
            assert_eq!(Key::parse(word), None);
        }
    }

    #[test]
    fn the_shipped_flex_table_is_the_dividers_curve() {
        for point in 0..FLEX_POINTS {
            let counts = f64::from(Settings::DEFAULT.number(Key::FlexCounts(point)));
            let angle = f64::from(Settings::DEFAULT.number(Key::FlexAngle(point)));
            let kilohm = 25.0 * (70.0_f64 / 25.0).powf(angle / 90.0);
            let expected = 1024.0 * 47.0 / (47.0 + kilohm);
            assert!(
                (counts - expected).abs() < 0.01,
                "{angle}: {counts}, {expected}"
            );
        }
    }
}
