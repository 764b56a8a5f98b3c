//! The stroke between the end switches: measured once, and kept in EEPROM behind the log of faults.
//!
//! It is counted in microsteps and holds for the volume of a step with which it was measured: who
//! changes `ul.step` may have changed the driver's microsteps, and then the count means another
//! length. A power cut while it is written costs the measurement: without one the smallest syringe
//! is assumed.

use wire::settings::{Key, Settings};

use crate::{
    faults,
    frame::{Frame, OVERHEAD, Poll, Writer},
    store::Eeprom,
};

/// Changes whenever the bytes change their meaning.
const VERSION: u8 = 1;

/// Version, microsteps (4), the bits of the volume of one (4).
const CONTENT: usize = 9;

#[allow(clippy::cast_possible_truncation)] // A few bytes.
const FRAME: Frame = Frame {
    head: faults::SIZE,
    length: CONTENT as u16,
};

/// Bytes of EEPROM that settings, log and stroke take, from address zero on.
pub const SIZE: u16 = FRAME.head + FRAME.length + OVERHEAD;

/// The largest volume (µl) of the smallest syringe of `docs/hardware`, which is assumed as long as
/// nothing was measured.
pub const SMALLEST_UL: f32 = 50_000.0;

/// Share of the stroke that is used: a plunger that goes to its largest volume stays clear of the
/// switch, whose place is known to a few microsteps.
const USED: f32 = 0.995;

/// A stroke, and the volume of a step that it holds for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Measured {
    steps: u32,
    per_step: u32,
}

impl Measured {
    fn bytes(self) -> [u8; CONTENT] {
        let [s0, s1, s2, s3] = self.steps.to_le_bytes();
        let [v0, v1, v2, v3] = self.per_step.to_le_bytes();
        [VERSION, s0, s1, s2, s3, v0, v1, v2, v3]
    }

    fn of(bytes: [u8; CONTENT]) -> Option<Self> {
        let [VERSION, s0, s1, s2, s3, v0, v1, v2, v3] = bytes else {
            return None;
        };
        Some(Self {
            steps: u32::from_le_bytes([s0, s1, s2, s3]),
            per_step: u32::from_le_bytes([v0, v1, v2, v3]),
        })
    }
}

/// What is known of the stroke, and whether it is still to be written.
#[derive(Clone, Debug)]
pub struct Stroke {
    measured: Option<Measured>,
    writer: Option<Writer>,
}

impl Stroke {
    /// A stroke that is not known.
    pub const fn new() -> Self {
        Self {
            measured: None,
            writer: None,
        }
    }

    /// Reads what was stored.
    pub fn load(&mut self, eeprom: &impl Eeprom) {
        self.measured = None;
        if !FRAME.look(eeprom).is_whole() {
            return;
        }
        let mut bytes = [0; CONTENT];
        for (at, byte) in (0..).zip(&mut bytes) {
            *byte = eeprom.read(FRAME.body(at));
        }
        self.measured = Measured::of(bytes);
    }

    /// Takes a new measurement (microsteps), made with these settings; [`Self::step`] writes it.
    pub fn note(&mut self, steps: u32, settings: &Settings) {
        self.measured = settings
            .bits(Key::VolumePerStep)
            .map(|per_step| Measured { steps, per_step });
        self.writer = Some(Writer::new(FRAME));
    }

    /// Writes at most a byte. A memory that does not keep it costs the measurement at the next
    /// start.
    pub fn step(&mut self, eeprom: &mut impl Eeprom) {
        let (Some(writer), Some(measured)) = (&mut self.writer, self.measured) else {
            return;
        };
        let bytes = measured.bytes();
        let byte = |at: u16| bytes.get(usize::from(at)).copied().unwrap_or(0);
        if writer.step(byte, eeprom) != Poll::Writing {
            self.writer = None;
        }
    }

    /// The stroke in microsteps, if it was measured with the volume of a step that these settings
    /// have.
    pub fn steps(&self, settings: &Settings) -> Option<u32> {
        let per_step = settings.bits(Key::VolumePerStep);
        self.measured
            .filter(|it| Some(it.per_step) == per_step)
            .map(|it| it.steps)
    }

    /// The stroke as a volume (µl), that of the smallest syringe if it is not known.
    fn volume(&self, settings: &Settings) -> Option<f32> {
        let steps = self.steps(settings)?;
        Some(steps as f32 * settings.number(Key::VolumePerStep))
    }

    /// Whether the largest volume of these settings is within the stroke.
    pub fn allows(&self, settings: &Settings) -> bool {
        settings.number(Key::MaxVolume) <= self.volume(settings).unwrap_or(SMALLEST_UL)
    }

    /// The most that the pump may displace (µl): the setting, within the stroke.
    pub fn largest(&self, settings: &Settings) -> f32 {
        let most = self
            .volume(settings)
            .map_or(SMALLEST_UL, |stroke| stroke * USED);
        settings.number(Key::MaxVolume).min(most)
    }
}

impl Default for Stroke {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Memory;

    fn with(changes: &[(Key, f32)]) -> Settings {
        let mut settings = Settings::DEFAULT;
        for &(key, value) in changes {
            settings.set(key, value.to_bits()).unwrap();
        }
        settings
    }

    fn write(memory: &mut Memory, steps: u32) {
        let mut stroke = Stroke::new();
        stroke.note(steps, &Settings::DEFAULT);
        for _ in 0..40 {
            let before = memory.writes;
            stroke.step(memory);
            assert!(memory.writes <= before + 1, "a byte a call");
        }
    }

    fn loaded(memory: &Memory) -> Option<u32> {
        let mut stroke = Stroke::new();
        stroke.load(memory);
        stroke.steps(&Settings::DEFAULT)
    }

    /// Every place of a cut, and every value of the byte that was in flight: the old stroke, the
    /// new one, or none.
    #[test]
    fn a_power_cut_leaves_no_stroke_that_was_not_measured() {
        let mut start = Memory::erased(faults::SIZE, SIZE);
        assert_eq!(loaded(&start), None);
        write(&mut start, 152_003);
        assert_eq!(loaded(&start), Some(152_003));
        let mut whole = start.clone();
        whole.writes = 0;
        write(&mut whole, 98_765);
        assert_eq!(loaded(&whole), Some(98_765));
        for cut in 1..=whole.writes {
            for in_flight in 0..=255 {
                let mut memory = start.clone();
                memory.writes = 0;
                memory.fails = Some((cut, in_flight));
                write(&mut memory, 98_765);
                assert!(
                    matches!(loaded(&memory), None | Some(152_003 | 98_765)),
                    "{cut}, {in_flight}"
                );
            }
        }
    }

    #[test]
    #[allow(clippy::float_cmp)] // Settings and constants, to the bit.
    fn the_largest_volume_is_within_the_stroke_or_that_of_the_smallest_syringe() {
        let mut stroke = Stroke::new();
        let (usual, large) = (Settings::DEFAULT, with(&[(Key::MaxVolume, 80_000.0)]));
        assert!(stroke.allows(&usual) && !stroke.allows(&large));
        assert_eq!([&usual, &large].map(|it| stroke.largest(it)), [50e3; 2]);
        // 90 ml.
        stroke.note(257_143, &usual);
        assert!(stroke.allows(&large));
        assert_eq!([&usual, &large].map(|it| stroke.largest(it)), [50e3, 80e3]);
        // 35 ml: a syringe that is smaller than what was set before it was measured.
        stroke.note(100_000, &usual);
        assert!(!stroke.allows(&usual));
        assert!((34_800.0..35_000.0).contains(&stroke.largest(&usual)));
        // With other microsteps the count is another length.
        let halves = with(&[(Key::VolumePerStep, 0.7)]);
        assert_eq!(stroke.steps(&halves), None);
        assert_eq!(stroke.largest(&halves), SMALLEST_UL);
    }
}
