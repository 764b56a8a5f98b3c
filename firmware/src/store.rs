//! Settings that survive a power cut, also one while they are written.
//!
//! A lab board loses its power by someone pulling the cable, at any moment. So there are two
//! slots, and only the one that is not in use is ever written. A slot is a [`Frame`] around
//!
//! ```text
//! version | words | sequence (2) | settings (4 × words)
//! ```
//!
//! with little-endian numbers.

use wire::settings::{COUNT, Settings};

use crate::{
    frame::{self, Frame, is_newer},
    settings::check,
};

pub use crate::frame::Poll;

/// The memory behind the settings and the log of faults, byte by byte.
pub trait Eeprom {
    /// The byte at an address.
    fn read(&self, address: u16) -> u8;
    /// Starts to write a byte, once what was written before is done. On the
    /// board that takes 3.3 ms, and reading waits for it.
    fn write(&mut self, address: u16, byte: u8);
    /// Fills in what a board is shipped with. A constant lies in RAM on the board, so
    /// that it has its own way to read it.
    fn ship(&self, settings: &mut Settings) {
        *settings = Settings::DEFAULT;
    }
}

/// Changes whenever the words change their meaning. A record of another version is
/// [`Loaded::Damaged`]: the words of version 1 have no shape of a Bouc–Wen hysteresis,
/// and the zero in that place would be another loop; those of version 2 have the gains
/// of another angle loop.
const VERSION: u8 = 3;

const WORD_BYTES: u16 = 4;
/// Version, number of words, sequence.
const HEADER: u16 = 4;
const SEQUENCE_AT: u16 = 2;
const CONTENT: u16 = HEADER + WORD_BYTES * COUNT as u16;

/// Version and number of words of the records of version 1. Their second slot lies
/// within the first one of today, so what they leave without a mark in the first
/// one is no sign that nothing was ever stored.
const VERSION_1: (u8, u8) = (1, 57);

/// Bytes that the two slots take, from address zero on.
///
/// The first byte of the memory is left alone: a processor that runs out of
/// supply in the middle of a write is known to spoil that one.
pub const SIZE: u16 = FIRST + 2 * SLOT;
const FIRST: u16 = 16;
const SLOT: u16 = 512;
const _: () = assert!(CONTENT + frame::OVERHEAD <= SLOT, "a slot is too small");

/// One of the two places of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    A,
    B,
}

impl Slot {
    const fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }

    const fn frame(self) -> Frame {
        Frame {
            head: match self {
                Self::A => FIRST,
                Self::B => FIRST + SLOT,
            },
            length: CONTENT,
        }
    }

    fn look(self, eeprom: &impl Eeprom) -> Content {
        let frame = self.frame();
        let found = frame.look(eeprom);
        let layout = (eeprom.read(frame.body(0)), eeprom.read(frame.body(1)));
        if found.erased {
            Content::Erased
        } else if !found.marked && layout != VERSION_1 {
            Content::Unfinished
        } else if found.is_whole() && layout == (VERSION, COUNT) {
            Content::Whole {
                sequence: frame.pair(eeprom, SEQUENCE_AT),
            }
        } else {
            Content::Spoilt
        }
    }

    fn read(self, eeprom: &impl Eeprom, settings: &mut Settings) {
        let mut address = self.frame().body(HEADER);
        for word in settings.words_mut() {
            let mut bytes = [0; WORD_BYTES as usize];
            for byte in &mut bytes {
                *byte = eeprom.read(address);
                address += 1;
            }
            *word = u32::from_le_bytes(bytes);
        }
    }
}

/// What a slot holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    Erased,
    /// Without a mark: something was cut off here.
    Unfinished,
    /// With a mark that does not tell the truth.
    Spoilt,
    Whole {
        sequence: u16,
    },
}

/// The newest whole record of two slots.
fn newest(a: Content, b: Content) -> Option<(Slot, u16)> {
    match (a, b) {
        (Content::Whole { sequence: a }, Content::Whole { sequence: b }) => {
            Some(if is_newer(b, a) {
                (Slot::B, b)
            } else {
                (Slot::A, a)
            })
        }
        (Content::Whole { sequence }, _) => Some((Slot::A, sequence)),
        (_, Content::Whole { sequence }) => Some((Slot::B, sequence)),
        _ => None,
    }
}

/// What was found in the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loaded {
    /// The newest settings, which also pass [`check`].
    Stored,
    /// Nothing was ever stored; what a board is shipped with.
    ///
    /// A cut while the very first record is written gives this too, and is no damage: it leaves one
    /// slot without a mark and the other as it left the factory.
    Shipped,
    /// Something was stored and cannot be trusted any more, or makes no sense to
    /// this firmware; what a board is shipped with.
    Damaged,
}

/// Reads the newest settings into `settings`.
pub fn load(eeprom: &impl Eeprom, settings: &mut Settings) -> Loaded {
    let found = find(eeprom, settings);
    if found != Loaded::Stored {
        eeprom.ship(settings);
    }
    found
}

fn find(eeprom: &impl Eeprom, settings: &mut Settings) -> Loaded {
    let (a, b) = (Slot::A.look(eeprom), Slot::B.look(eeprom));
    match (newest(a, b), a, b) {
        (Some((slot, _)), ..) => {
            slot.read(eeprom, settings);
            if check(settings).is_ok() {
                Loaded::Stored
            } else {
                Loaded::Damaged
            }
        }
        // A first record goes into slot A.
        (None, Content::Erased | Content::Unfinished, Content::Erased) => Loaded::Shipped,
        _ => Loaded::Damaged,
    }
}

/// Writes settings, at most a byte a call, so that a control loop goes on
/// meanwhile: at most 364 writes and 50 further calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Writer {
    record: frame::Writer,
    sequence: u16,
}

impl Writer {
    /// Chooses the slot: the one that is not in use. A damaged record is not
    /// overwritten before there is a whole one, for else a cut would turn
    /// damage into "never stored".
    pub fn new(eeprom: &impl Eeprom) -> Self {
        let (a, b) = (Slot::A.look(eeprom), Slot::B.look(eeprom));
        let (slot, sequence) = match (newest(a, b), a) {
            (Some((slot, sequence)), _) => (slot.other(), sequence.wrapping_add(1)),
            (None, Content::Spoilt) => (Slot::B, 0),
            (None, _) => (Slot::A, 0),
        };
        Self {
            record: frame::Writer::new(slot.frame()),
            sequence,
        }
    }

    /// Goes on writing. The settings must be the same in every call; if they
    /// are not, the record is refused in the end and the call says
    /// [`Poll::Failed`].
    pub fn step(&mut self, settings: &Settings, eeprom: &mut impl Eeprom) -> Poll {
        let sequence = self.sequence;
        self.record
            .step(|place| content(settings, sequence, place), eeprom)
    }
}

/// A byte of a record's content.
fn content(settings: &Settings, sequence: u16, place: u16) -> u8 {
    let pick = |bytes: &[u8], at: u16| bytes.get(usize::from(at)).copied().unwrap_or(0);
    match place {
        0 => VERSION,
        1 => COUNT,
        SEQUENCE_AT..HEADER => pick(&sequence.to_le_bytes(), place - SEQUENCE_AT),
        _ => {
            let at = place - HEADER;
            let word = settings.words().get(usize::from(at / WORD_BYTES));
            pick(&word.copied().unwrap_or(0).to_le_bytes(), at % WORD_BYTES)
        }
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::{Loaded as Found, *};
    use crate::frame::{ERASED, MARK, NO_MARK};
    use proptest::prelude::*;
    use wire::{
        checksum::Crc16,
        settings::{EFFECT_PARAMETERS, Key},
    };

    /// A memory whose power fails.
    #[derive(Clone, PartialEq)]
    struct Memory {
        bytes: [u8; SIZE as usize],
        writes: u32,
        /// After so many more writes the power is gone; the write that it
        /// happens in leaves this byte.
        fails: Option<(u32, u8)>,
        /// A worn-out cell.
        worn: Option<u16>,
    }

    impl Memory {
        fn new() -> Self {
            Self {
                bytes: [ERASED; SIZE as usize],
                writes: 0,
                fails: None,
                worn: None,
            }
        }

        fn is_dead(&self) -> bool {
            self.fails.is_some_and(|(writes, _)| writes == 0)
        }

        /// Writes as the application does, until it is done or the power fails.
        fn save(&mut self, settings: &Settings) -> Poll {
            let mut writer = Writer::new(self);
            for _ in 0..450 {
                let writes = self.writes;
                let poll = writer.step(settings, self);
                assert!(self.writes - writes <= 1, "a byte a call");
                if poll != Poll::Writing || self.is_dead() {
                    return poll;
                }
            }
            unreachable!("the writer never ends")
        }

        /// The power comes back.
        fn restart(&mut self) -> Loaded {
            self.fails = None;
            load(self)
        }
    }

    impl Eeprom for Memory {
        fn read(&self, address: u16) -> u8 {
            self.bytes[usize::from(address)]
        }

        fn write(&mut self, address: u16, byte: u8) {
            assert_ne!(address, 0);
            assert!(!self.is_dead());
            self.writes += 1;
            let mut byte = byte;
            if let Some((left, in_flight)) = &mut self.fails {
                *left -= 1;
                if *left == 0 {
                    byte = *in_flight;
                }
            }
            if self.worn != Some(address) {
                self.bytes[usize::from(address)] = byte;
            }
        }
    }

    /// What was found, with its settings.
    #[derive(Clone, Debug, PartialEq, Eq)]
    #[allow(clippy::large_enum_variant)]
    enum Loaded {
        Stored(Settings),
        Shipped,
        Damaged,
    }

    fn load(memory: &Memory) -> Loaded {
        let mut settings = Settings::from_words([0; COUNT as usize]);
        let found = super::load(memory, &mut settings);
        if found == Found::Stored {
            return Loaded::Stored(settings);
        }
        assert_eq!(settings, Settings::DEFAULT);
        if found == Found::Shipped {
            Loaded::Shipped
        } else {
            Loaded::Damaged
        }
    }

    fn settings(damping: f32) -> Settings {
        let mut settings = Settings::DEFAULT;
        // Differ in many bytes, and stay valid.
        settings.set(Key::Damping, damping.to_bits()).unwrap();
        settings
            .set(Key::Stiffness, (damping * 3.3).to_bits())
            .unwrap();
        for index in 0..EFFECT_PARAMETERS {
            let key = Key::EffectParameter { slot: 1, index };
            settings.set(key, (damping / 7.0).to_bits()).unwrap();
        }
        settings
    }

    #[test]
    fn what_is_saved_is_loaded() {
        let mut memory = Memory::new();
        assert_eq!(load(&memory), Loaded::Shipped);
        for n in 1..20_u8 {
            let settings = settings(f32::from(n) * 0.37);
            assert_eq!(memory.save(&settings), Poll::Done);
            assert_eq!(load(&memory), Loaded::Stored(settings));
        }
    }

    #[test]
    fn bytes_that_are_right_are_not_written() {
        let mut memory = Memory::new();
        memory.save(&settings(1.0));
        assert!((300..=364).contains(&memory.writes), "{}", memory.writes);
        memory.save(&settings(1.0));
        memory.writes = 0;
        memory.save(&settings(1.0));
        // Marks away and back, sequence, checksum.
        assert!(memory.writes <= 8, "{}", memory.writes);
    }

    /// Every place of a cut in every kind of save, and every value of the byte
    /// that was in flight.
    #[test]
    fn a_power_cut_leaves_the_old_or_the_new_record() {
        let mut histories = std::vec![Memory::new()];
        for n in 1..4_u8 {
            let mut memory = histories.last().unwrap().clone();
            memory.save(&settings(f32::from(n)));
            histories.push(memory);
        }
        // The marks alone are put to the test when all else stays as it is.
        let mut same = Memory::new();
        same.save(&settings(9.0));
        same.save(&settings(9.0));
        histories.push(same);

        for start in histories {
            let old = load(&start);
            for new in [settings(9.0), settings(123.4)] {
                let mut whole = start.clone();
                whole.writes = 0;
                whole.save(&new);
                for cut in 1..=whole.writes {
                    for in_flight in 0..=255 {
                        let mut memory = start.clone();
                        memory.fails = Some((cut, in_flight));
                        memory.save(&new);
                        let found = memory.restart();
                        assert!(
                            found == old || found == Loaded::Stored(new.clone()),
                            "cut {cut}, byte {in_flight}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn damage_does_not_become_never_stored_by_a_cut() {
        let mut start = Memory::new();
        start.save(&settings(1.0));
        start.bytes[40] ^= 4;
        assert_eq!(load(&start), Loaded::Damaged);
        for cut in 1..370 {
            let mut memory = start.clone();
            memory.fails = Some((cut, 0x5c));
            let poll = memory.save(&settings(2.0));
            let found = memory.restart();
            if poll == Poll::Done {
                assert_eq!(found, Loaded::Stored(settings(2.0)));
            } else {
                assert!(found == Loaded::Damaged || found == Loaded::Stored(settings(2.0)));
            }
        }
    }

    #[test]
    fn the_sequence_wraps_around() {
        assert!(is_newer(0, 0xffff) && is_newer(5, 0xfff0) && is_newer(3, 2));
        assert!(!is_newer(0xffff, 0) && !is_newer(2, 2) && !is_newer(2, 3));
        let mut memory = Memory::new();
        let mut writer = Writer::new(&memory);
        writer.sequence = 0xfffe;
        while writer.step(&settings(1.0), &mut memory) == Poll::Writing {}
        for n in 2..8_u8 {
            memory.save(&settings(f32::from(n)));
            assert_eq!(load(&memory), Loaded::Stored(settings(f32::from(n))));
        }
    }

    #[test]
    fn a_worn_out_cell_is_noticed_and_the_old_record_stays() {
        for worn in Slot::B.frame().head..=Slot::B.frame().tail() {
            let mut memory = Memory::new();
            memory.save(&settings(1.0));
            memory.worn = Some(worn);
            let poll = memory.save(&settings(2.0));
            let expected = match poll {
                Poll::Done => settings(2.0),
                Poll::Failed => settings(1.0),
                Poll::Writing => unreachable!(),
            };
            assert_eq!(load(&memory), Loaded::Stored(expected), "{worn}");
            // Only where the erased cell happens to be right, or one mark of
            // two is enough, it does not matter.
            let mark = worn == Slot::B.frame().head || worn == Slot::B.frame().tail();
            let right = memory.bytes[usize::from(worn)] == ERASED && poll == Poll::Done;
            assert!(poll == Poll::Failed || mark || right, "{worn}");
        }
    }

    #[test]
    fn settings_that_change_under_way_are_not_stored() {
        for changed in (20..360).step_by(7) {
            let mut memory = Memory::new();
            memory.save(&settings(1.0));
            let mut writer = Writer::new(&memory);
            let mut poll = Poll::Writing;
            let mut calls = 0;
            while poll == Poll::Writing {
                let damping = if calls < changed { 2.0 } else { 5.0 };
                poll = writer.step(&settings(damping), &mut memory);
                calls += 1;
            }
            let stored = load(&memory);
            assert!(
                poll == Poll::Failed && stored == Loaded::Stored(settings(1.0))
                    || poll == Poll::Done && stored != Loaded::Damaged,
                "{changed}: {poll:?}"
            );
        }
    }

    /// A board whose words meant something else asks for settings instead of
    /// running another model.
    #[test]
    fn a_record_of_another_version_is_damaged() {
        let mut memory = Memory::new();
        memory.save(&settings(1.0));
        let version = usize::from(Slot::A.frame().body(0));
        memory.bytes[version] = VERSION + 1;
        let mut crc = Crc16::new();
        for offset in 0..CONTENT {
            crc.update(memory.bytes[usize::from(Slot::A.frame().body(offset))]);
        }
        let at = usize::from(Slot::A.frame().body(CONTENT));
        memory.bytes[at..at + 2].copy_from_slice(&crc.value().to_le_bytes());
        assert_eq!(load(&memory), Loaded::Damaged);
    }

    /// Version 1 had slots of 256 bytes and 57 words.
    #[test]
    fn records_of_version_1_are_damaged_whichever_slot_they_are_in() {
        const OLD_SLOT: usize = 256;
        const OLD_BODY: usize = 4 + 4 * 57 + 2;
        let record = |memory: &mut Memory, slot: usize, mark: u8| {
            let head = usize::from(FIRST) + slot * OLD_SLOT;
            memory.bytes[head..][..=OLD_BODY + 1].fill(0x3f);
            (memory.bytes[head], memory.bytes[head + 1 + OLD_BODY]) = (mark, mark);
            (memory.bytes[head + 1], memory.bytes[head + 2]) = VERSION_1;
        };
        for (a, b) in [
            (Some(MARK), None),
            (Some(MARK), Some(MARK)),
            (Some(NO_MARK), Some(MARK)),
        ] {
            let mut memory = Memory::new();
            for (slot, mark) in [a, b].into_iter().enumerate() {
                if let Some(mark) = mark {
                    record(&mut memory, slot, mark);
                }
            }
            assert_eq!(load(&memory), Loaded::Damaged);
            assert_eq!(memory.save(&settings(1.0)), Poll::Done);
            assert_eq!(load(&memory), Loaded::Stored(settings(1.0)));
        }
    }

    #[test]
    fn settings_without_sense_are_damaged() {
        let mut memory = Memory::new();
        let mut bad = settings(1.0);
        bad.set(Key::EffectKind { slot: 0 }, 1).unwrap();
        assert_eq!(memory.save(&bad), Poll::Done);
        assert_eq!(load(&memory), Loaded::Damaged);
    }

    proptest! {
        /// Any number of saves, each cut off anywhere or not at all.
        #[test]
        fn whatever_was_saved_last_is_there(
            saves in prop::collection::vec((1.0..100.0_f32, prop::option::of((1..380_u32, any::<u8>()))), 1..12),
        ) {
            let mut memory = Memory::new();
            let mut expected = Loaded::Shipped;
            for (damping, fails) in saves {
                let new = Loaded::Stored(settings(damping));
                memory.fails = fails;
                let poll = memory.save(&settings(damping));
                let found = memory.restart();
                if poll == Poll::Done {
                    prop_assert_eq!(&found, &new);
                } else {
                    prop_assert!(found == expected || found == new);
                }
                expected = found;
            }
        }

        /// One spoilt byte of a record: the other one is used, or damage told.
        #[test]
        fn a_spoilt_byte_is_never_taken_for_settings(at in 0..SIZE, byte: u8, twice: bool) {
            let mut memory = Memory::new();
            memory.save(&settings(1.0));
            if twice {
                memory.save(&settings(2.0));
            }
            memory.bytes[usize::from(at)] = byte;
            let found = load(&memory);
            let known = [Loaded::Stored(settings(1.0)), Loaded::Stored(settings(2.0))];
            prop_assert!(found == Loaded::Damaged || known.contains(&found), "{:?}", found);
            prop_assert!(!twice || known.contains(&found));
        }

        #[test]
        fn noise_is_not_settings(bytes in prop::collection::vec(any::<u8>(), SIZE as usize)) {
            let mut memory = Memory::new();
            memory.bytes.copy_from_slice(&bytes);
            prop_assert_eq!(load(&memory), Loaded::Damaged);
            prop_assert_eq!(memory.save(&settings(1.0)), Poll::Done);
            prop_assert_eq!(load(&memory), Loaded::Stored(settings(1.0)));
        }
    }
}
