//! The board's settings in EEPROM.

use firmware::{
    settings::check,
    store::{Eeprom, Loaded, Poll, SIZE, Writer, load},
};
use wire::settings::{COUNT, EFFECT_PARAMETERS, Key, Settings};

/// More calls than any save takes.
const CALLS: u16 = 1_000;

/// A memory whose power fails.
#[derive(Clone)]
struct Memory {
    bytes: [u8; SIZE as usize],
    /// After so many more writes the power is gone; the last of them leaves this byte.
    fails: Option<(u32, u8)>,
}

impl Memory {
    fn is_dead(&self) -> bool {
        matches!(self.fails, Some((0, _)))
    }

    /// Saves, until it is done or the power fails.
    fn save(&mut self, settings: &Settings) -> Poll {
        let mut writer = Writer::new(self);
        for _ in 0..CALLS {
            let poll = writer.step(settings, self);
            if poll != Poll::Writing || self.is_dead() {
                return poll;
            }
        }
        panic!("a save never ends")
    }

    fn load(&self) -> (Loaded, Settings) {
        let mut settings = Settings::from_words([0x5555_5555; COUNT as usize]);
        let found = load(self, &mut settings);
        match found {
            Loaded::Stored => assert!(check(&settings).is_ok(), "settings without sense"),
            Loaded::Shipped | Loaded::Damaged => assert_eq!(settings, Settings::DEFAULT),
        }
        (found, settings)
    }
}

impl Eeprom for Memory {
    fn read(&self, address: u16) -> u8 {
        self.bytes[usize::from(address)]
    }

    fn write(&mut self, address: u16, byte: u8) {
        assert_ne!(address, 0, "the first byte is left alone");
        assert!(!self.is_dead(), "written without power");
        let mut byte = byte;
        if let Some((left, in_flight)) = &mut self.fails {
            *left -= 1;
            if *left == 0 {
                byte = *in_flight;
            }
        }
        self.bytes[usize::from(address)] = byte;
    }
}

/// Valid settings that differ in many bytes.
fn settings(number: u8) -> Settings {
    let mut settings = Settings::DEFAULT;
    let damping = 0.1 + f32::from(number) * 0.37;
    let mut set = |key, value: f32| assert_eq!(settings.set(key, value.to_bits()), Ok(()));
    set(Key::Damping, damping);
    set(Key::Stiffness, damping * 3.3);
    for index in 0..EFFECT_PARAMETERS {
        set(Key::EffectParameter { slot: 1, index }, damping / 7.0);
    }
    settings
}

/// A memory with any content.
///
/// # Panics
///
/// When settings are loaded that make no sense, when what is not stored is not what a
/// board is shipped with, or when settings that were saved over it are not there.
pub fn image(bytes: &[u8]) {
    let mut memory = Memory {
        bytes: [0xff; SIZE as usize],
        fails: None,
    };
    for (place, &byte) in memory.bytes.iter_mut().zip(bytes) {
        *place = byte;
    }
    let (found, before) = memory.load();
    let new = settings(bytes.first().copied().unwrap_or(1));
    // First a save that fails, at a place that the bytes say.
    let cut = 1 + bytes.iter().map(|&byte| u32::from(byte)).sum::<u32>() % 400;
    let mut torn = memory.clone();
    torn.fails = Some((cut, 0x5a));
    torn.save(&new);
    torn.fails = None;
    let (after, there) = torn.load();
    assert!(there == before || there == new, "a mix of old and new");
    // Damage stays damage, until there is something whole.
    assert!(
        after == found || after == Loaded::Stored,
        "{found:?} became {after:?}"
    );
    assert_eq!(memory.save(&new), Poll::Done);
    assert_eq!(memory.load(), (Loaded::Stored, new));
}

/// Saves that are cut off: three bytes each say what is saved, after how many writes
/// the power fails (beyond 370 it does not), and what the last write leaves.
///
/// # Panics
///
/// When what is there after a cut is neither what was there before nor what was to be
/// saved, or when a save that was finished is not there.
pub fn cuts(bytes: &[u8]) {
    const MOST: usize = 40;
    let mut memory = Memory {
        bytes: [0xff; SIZE as usize],
        fails: None,
    };
    let mut expected = (Loaded::Shipped, Settings::DEFAULT);
    for save in bytes.chunks_exact(3).take(MOST) {
        let new = settings(save[0] % 8);
        // Finer at both ends, where the marks are written.
        let cut = match save[1] {
            low @ 0..100 => 1 + u32::from(low),
            middle @ 100..200 => 101 + 2 * (u32::from(middle) - 100),
            high => 301 + 2 * (u32::from(high) - 200),
        };
        memory.fails = (cut <= 370).then_some((cut, save[2]));
        let poll = memory.save(&new);
        memory.fails = None;
        let there = memory.load();
        let saved = (Loaded::Stored, new);
        if poll == Poll::Done {
            assert_eq!(there, saved, "a save that was finished is not there");
        } else {
            assert!(there == expected || there == saved, "a mix of old and new");
        }
        expected = there;
    }
}
