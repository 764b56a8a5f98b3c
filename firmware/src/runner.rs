//! Protocols on the board: downloaded or known by name, checked, then played.
//!
//! [`wire::protocol`] defines a protocol over time. Here it is stored in little RAM,
//! checked against the limits, and coupled to the plunger: after a release the next
//! segment waits until the plunger is back at its start, so that repeats are alike.

use wire::{
    decimal::Hundredths,
    protocol::{ControlMode, MAX_SEGMENTS, Named, Playback, Program, Reference, Segment, check},
    settings::{Key, Settings},
};

use crate::design::PERIOD_MS;

/// A segment in eleven bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Packed {
    /// The kind of segment, with the control mode in the lowest two bits. Zero while the
    /// place is empty.
    kind: u8,
    level: [u8; 2],
    amplitude: [u8; 2],
    period_ms: [u8; 3],
    duration_ms: [u8; 3],
}

const STEP: u8 = 1 << 2;
const RAMP: u8 = 2 << 2;
const SINES: u8 = 3 << 2;
const HOLD: u8 = 4 << 2;
const RELEASE: u8 = 5 << 2;
const REPEAT: u8 = 6 << 2;
const MODE: u8 = 0b11;

/// The low 24 bits: durations are at most an hour.
fn short(ms: u32) -> [u8; 3] {
    let [a, b, c, _] = ms.to_le_bytes();
    [a, b, c]
}

fn long([a, b, c]: [u8; 3]) -> u32 {
    u32::from_le_bytes([a, b, c, 0])
}

/// A level in 16 bits; none for one below zero or beyond 655.35, which no limit
/// allows.
fn level(level: Hundredths) -> Option<[u8; 2]> {
    Some(u16::try_from(level.0).ok()?.to_le_bytes())
}

fn unlevel(bytes: [u8; 2]) -> Hundredths {
    Hundredths(i32::from(u16::from_le_bytes(bytes)))
}

const fn mode_bits(mode: ControlMode) -> u8 {
    match mode {
        ControlMode::Pressure => 0,
        ControlMode::AngleOpenLoop => 1,
        ControlMode::AngleClosedLoop => 2,
    }
}

impl Packed {
    /// An empty place.
    const EMPTY: Self = Self {
        kind: 0,
        level: [0; 2],
        amplitude: [0; 2],
        period_ms: [0; 3],
        duration_ms: [0; 3],
    };

    /// Packs a segment; none if a level cannot be one.
    fn pack(segment: &Segment) -> Option<Self> {
        let mode = segment.mode().map_or(0, mode_bits);
        let empty = Self {
            duration_ms: short(segment.duration_ms()),
            ..Self::default()
        };
        Some(match *segment {
            Segment::Step { level: to, .. } => Self {
                kind: STEP | mode,
                level: level(to)?,
                ..empty
            },
            Segment::Ramp { level: to, .. } => Self {
                kind: RAMP | mode,
                level: level(to)?,
                ..empty
            },
            Segment::Multisine {
                centre,
                amplitude,
                period_ms,
                ..
            } => Self {
                kind: SINES | mode,
                level: level(centre)?,
                amplitude: level(amplitude)?,
                period_ms: short(period_ms),
                ..empty
            },
            Segment::Hold { .. } => Self {
                kind: HOLD,
                ..empty
            },
            Segment::Release { .. } => Self {
                kind: RELEASE,
                ..empty
            },
            Segment::Repeat { from, times } => Self {
                kind: REPEAT,
                level: [from, times],
                ..empty
            },
        })
    }

    fn unpack(&self) -> Option<Segment> {
        let duration_ms = long(self.duration_ms);
        let mode = match self.kind & MODE {
            0 => ControlMode::Pressure,
            1 => ControlMode::AngleOpenLoop,
            _ => ControlMode::AngleClosedLoop,
        };
        let level = unlevel(self.level);
        Some(match self.kind & !MODE {
            STEP => Segment::Step {
                mode,
                level,
                duration_ms,
            },
            RAMP => Segment::Ramp {
                mode,
                level,
                duration_ms,
            },
            SINES => Segment::Multisine {
                mode,
                centre: level,
                amplitude: unlevel(self.amplitude),
                // Never zero: a period divides.
                period_ms: long(self.period_ms).max(1),
                duration_ms,
            },
            HOLD => Segment::Hold { duration_ms },
            RELEASE => Segment::Release { duration_ms },
            REPEAT => {
                let [from, times] = self.level;
                Segment::Repeat { from, times }
            }
            _ => return None,
        })
    }
}

/// A protocol that the computer sent: up to [`MAX_SEGMENTS`] in 353 bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Memory {
    segments: [Packed; MAX_SEGMENTS as usize],
    count: u8,
}

impl Memory {
    /// Memory without a protocol.
    pub const fn new() -> Self {
        Self {
            segments: [Packed::EMPTY; MAX_SEGMENTS as usize],
            count: 0,
        }
    }

    /// Clears the memory and expects `count` segments.
    pub fn clear(&mut self, count: u8) {
        // In place: a new one would be on the stack first, and on the deepest path.
        self.segments.fill(Packed::EMPTY);
        self.count = count.min(MAX_SEGMENTS);
    }

    /// Stores a segment; returns whether its place was announced and its levels can be
    /// stored. Storing it twice is the same as once.
    pub fn put(&mut self, index: u8, segment: &Segment) -> bool {
        if index >= self.count {
            return false;
        }
        let packed = Packed::pack(segment);
        match (self.segments.get_mut(usize::from(index)), packed) {
            (Some(place), Some(packed)) => {
                *place = packed;
                true
            }
            _ => false,
        }
    }

    /// Whether every segment that was announced has come.
    pub fn is_complete(&self) -> bool {
        self.count > 0 && (0..self.count).all(|index| self.segment(index).is_some())
    }
}

impl Default for Memory {
    fn default() -> Self {
        Self::new()
    }
}

impl Program for Memory {
    fn segment(&self, index: u8) -> Option<Segment> {
        if index >= self.count {
            return None;
        }
        self.segments.get(usize::from(index))?.unpack()
    }
}

/// Whether everything that a protocol asks for is within the limits.
fn is_within(program: &(impl Program + ?Sized), settings: &Settings) -> bool {
    let hundredths = |key| Hundredths::round(settings.number(key));
    let (degrees, kilopascal) = (
        hundredths(Key::SetpointMax),
        hundredths(Key::SetpointMaxPressure),
    );
    (0..MAX_SEGMENTS)
        .map_while(|index| program.segment(index))
        .all(|segment| {
            let highest = match segment.mode() {
                Some(ControlMode::Pressure) => kilopascal,
                _ => degrees,
            };
            let lowest = match segment {
                Segment::Step { level, .. } | Segment::Ramp { level, .. } => level.0,
                // Below zero there is vacuum, which the valve would let in.
                Segment::Multisine {
                    centre, amplitude, ..
                } => centre.0.saturating_sub(amplitude.0.saturating_abs()),
                _ => 0,
            };
            lowest >= 0 && segment.highest() <= highest
        })
}

/// Which protocol is played: by name, or the one in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Runner {
    named: Option<Named>,
    playback: Playback,
}

impl Runner {
    /// Starts a protocol; none when it is incomplete, is no protocol, or asks
    /// for more than the limits.
    pub fn start(named: Option<Named>, memory: &Memory, settings: &Settings) -> Option<Self> {
        let fits = match named {
            Some(named) => check(&named).is_ok() && is_within(&named, settings),
            None => memory.is_complete() && check(memory).is_ok() && is_within(memory, settings),
        };
        fits.then_some(Self {
            named,
            playback: Playback::new(),
        })
    }

    /// The current segment.
    pub fn index(&self) -> u8 {
        self.playback.index()
    }

    /// How often the segments at hand have been played before.
    pub fn repeat(&self) -> u8 {
        self.playback.repeat()
    }

    /// The reference now.
    pub fn reference(&self, memory: &Memory) -> Reference {
        match self.named {
            Some(named) => self.playback.reference(&named),
            None => self.playback.reference(memory),
        }
    }

    /// Lets one control period pass. A release lasts until the plunger is back,
    /// even beyond its time.
    pub fn advance(&mut self, memory: &Memory, plunger_is_back: bool) {
        let mut next = self.playback;
        match self.named {
            Some(named) => next.advance(&named, u32::from(PERIOD_MS)),
            None => next.advance(memory, u32::from(PERIOD_MS)),
        }
        if next.index() != self.playback.index()
            && !plunger_is_back
            && self.reference(memory) == Reference::Release
        {
            return;
        }
        self.playback = next;
    }
}

#[cfg(test)]
#[allow(clippy::cast_possible_truncation)]
mod tests {
    extern crate std;
    use super::*;
    use crate::wire_testing::segments;
    use proptest::prelude::*;
    use std::vec::Vec;
    use wire::protocol::MAX_DURATION_MS;

    proptest! {
        #[test]
        fn segments_are_kept_as_they_came(
            all in prop::collection::vec(segments(0..65_536, 1..=MAX_DURATION_MS, 0..32), 1..=32),
        ) {
            let mut memory = Memory::new();
            memory.clear(all.len() as u8);
            for (index, segment) in (0..).zip(&all) {
                prop_assert!(!memory.is_complete());
                prop_assert!(memory.put(index, segment));
            }
            prop_assert!(memory.is_complete());
            let kept: Vec<_> = (0..).map_while(|index| memory.segment(index)).collect();
            prop_assert_eq!(kept, all);
        }
    }

    const STEP: Segment = Segment::Step {
        mode: ControlMode::AngleOpenLoop,
        level: Hundredths(6_000),
        duration_ms: 1_000,
    };

    fn memory(segments: &[Segment]) -> Memory {
        let mut memory = Memory::new();
        memory.clear(segments.len() as u8);
        for (index, segment) in (0..).zip(segments) {
            memory.put(index, segment);
        }
        memory
    }

    #[test]
    fn a_protocol_with_a_hole_or_beyond_a_limit_does_not_start() {
        let start = |memory: &Memory| Runner::start(None, memory, &Settings::DEFAULT).is_some();
        assert!(start(&memory(&[STEP])));
        assert!(!start(&Memory::new()));
        let mut hole = Memory::new();
        hole.clear(3);
        assert!(hole.put(0, &STEP) && hole.put(2, &STEP) && !hole.put(3, &STEP));
        assert!(!start(&hole));
        let step = |mode, level| Segment::Step {
            mode,
            level: Hundredths(level),
            duration_ms: 10,
        };
        for (mode, level, fits) in [
            (ControlMode::AngleOpenLoop, 11_000, true),
            (ControlMode::AngleOpenLoop, 11_001, false),
            (ControlMode::AngleClosedLoop, 11_001, false),
            (ControlMode::Pressure, 16_000, true),
            (ControlMode::Pressure, 16_001, false),
            (ControlMode::Pressure, -1, false),
        ] {
            assert_eq!(start(&memory(&[step(mode, level)])), fits, "{level}");
        }
        let sines = |centre, amplitude| Segment::Multisine {
            mode: ControlMode::AngleOpenLoop,
            centre: Hundredths(centre),
            amplitude: Hundredths(amplitude),
            period_ms: 1_000,
            duration_ms: 1_000,
        };
        assert!(start(&memory(&[sines(5_000, 5_000)])));
        assert!(!start(&memory(&[sines(5_000, 5_001)])));
        assert!(!start(&memory(&[sines(9_000, 3_000)])));
        let repeat = Segment::Repeat { from: 0, times: 1 };
        assert!(!start(&memory(&[repeat])));
        for &named in Named::ALL {
            assert!(Runner::start(Some(named), &hole, &Settings::DEFAULT).is_some());
        }
    }

    #[test]
    fn a_release_waits_for_the_plunger() {
        let memory = memory(&[Segment::Release { duration_ms: 50 }, STEP]);
        let mut runner = Runner::start(None, &memory, &Settings::DEFAULT).unwrap();
        for _ in 0..100 {
            runner.advance(&memory, false);
            assert_eq!(runner.reference(&memory), Reference::Release);
        }
        runner.advance(&memory, true);
        assert!(matches!(runner.reference(&memory), Reference::Track { .. }));
        // A release that ends in time is not cut short.
        let mut runner = Runner::start(None, &memory, &Settings::DEFAULT).unwrap();
        for _ in 0..4 {
            runner.advance(&memory, true);
            assert_eq!(runner.reference(&memory), Reference::Release);
        }
    }
}
