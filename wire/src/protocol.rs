//! Test protocols and their playback.
//!
//! A protocol is a short list of segments: step, ramp, multisine, hold, release, repeat.
//! The computer writes it and the board plays it. Both use this [`Playback`], so that the
//! played run is the planned one.

use model_core::elementary;
use ufmt::{uWrite, uwrite};

use crate::{
    decimal::Hundredths,
    fields::{Fields, number},
    keyword::Keyword,
};

/// The most segments in one protocol; every one costs the board RAM.
pub const MAX_SEGMENTS: u8 = 32;

/// The longest duration of a segment (ms).
pub const MAX_DURATION_MS: u32 = 3_600_000;

/// The most repeats.
pub const MAX_REPEATS: u8 = 100;

/// Which quantity a level sets, and which loop tracks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ControlMode {
    /// A gauge pressure (kPa), held by the pressure sensor.
    Pressure,
    /// A bending angle (°), open loop: the model's inverse gives the pressure,
    /// which the pressure sensor holds. This is the paper's step test.
    AngleOpenLoop,
    /// A bending angle (°), closed by the flex sensor.
    AngleClosedLoop,
}

impl ControlMode {
    /// The word in a line.
    pub const fn keyword(self) -> Keyword {
        const PRESSURE: Keyword = Keyword::of("kpa");
        const OPEN: Keyword = Keyword::of("open");
        const CLOSED: Keyword = Keyword::of("deg");
        match self {
            Self::Pressure => PRESSURE,
            Self::AngleOpenLoop => OPEN,
            Self::AngleClosedLoop => CLOSED,
        }
    }

    fn parse(word: &[u8]) -> Option<Self> {
        let word = Keyword::parse(word)?;
        [Self::Pressure, Self::AngleOpenLoop, Self::AngleClosedLoop]
            .into_iter()
            .find(|mode| mode.keyword() == word)
    }
}

/// One part of a protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Segment {
    /// Go to a level at once and stay.
    Step {
        /// The control mode.
        mode: ControlMode,
        /// The level (kPa or °).
        level: Hundredths,
        /// How long (ms).
        duration_ms: u32,
    },
    /// Move to a level at a constant rate.
    Ramp {
        /// The control mode.
        mode: ControlMode,
        /// The level at the end (kPa or °).
        level: Hundredths,
        /// How long (ms).
        duration_ms: u32,
    },
    /// Five sines at 1, 2, 3, 5 and 7 times a base frequency, with phases that
    /// keep the crest low.
    Multisine {
        /// The control mode.
        mode: ControlMode,
        /// The mean (kPa or °).
        centre: Hundredths,
        /// The largest departure from the mean (kPa or °).
        amplitude: Hundredths,
        /// Period of the base frequency (ms).
        period_ms: u32,
        /// How long (ms).
        duration_ms: u32,
    },
    /// Stop the pump, valve closed: what drifts now is the actuator or a leak.
    Hold {
        /// How long (ms).
        duration_ms: u32,
    },
    /// Open the valve and take the plunger back.
    Release {
        /// How long (ms).
        duration_ms: u32,
    },
    /// Play everything since a segment again. Repeats do not nest.
    Repeat {
        /// The segment to go back to.
        from: u8,
        /// How often it is played again.
        times: u8,
    },
}

const STEP: Keyword = Keyword::of("step");
const RAMP: Keyword = Keyword::of("ramp");
const SINES: Keyword = Keyword::of("sines");
const HOLD: Keyword = Keyword::of("hold");
const RELEASE: Keyword = Keyword::of("release");
const REPEAT: Keyword = Keyword::of("repeat");

impl Segment {
    /// How long it lasts (ms); nothing for a repeat.
    pub const fn duration_ms(&self) -> u32 {
        match *self {
            Self::Step { duration_ms, .. }
            | Self::Ramp { duration_ms, .. }
            | Self::Multisine { duration_ms, .. }
            | Self::Hold { duration_ms }
            | Self::Release { duration_ms } => duration_ms,
            Self::Repeat { .. } => 0,
        }
    }

    /// Its control mode; none while nothing is tracked.
    pub const fn mode(&self) -> Option<ControlMode> {
        match *self {
            Self::Step { mode, .. } | Self::Ramp { mode, .. } | Self::Multisine { mode, .. } => {
                Some(mode)
            }
            _ => None,
        }
    }

    /// The highest level (kPa or °) that it asks for.
    pub fn highest(&self) -> Hundredths {
        match *self {
            Self::Step { level, .. } | Self::Ramp { level, .. } => level,
            Self::Multisine {
                centre, amplitude, ..
            } => Hundredths(centre.0.saturating_add(amplitude.0.saturating_abs())),
            _ => Hundredths(0),
        }
    }

    /// Writes it as in a line.
    ///
    /// # Errors
    ///
    /// Errors of the output.
    pub fn write<W: uWrite + ?Sized>(&self, out: &mut W) -> Result<(), W::Error> {
        match *self {
            Self::Step {
                mode,
                level,
                duration_ms,
            } => uwrite!(out, "{} {} {} {}", STEP, mode.keyword(), level, duration_ms),
            Self::Ramp {
                mode,
                level,
                duration_ms,
            } => uwrite!(out, "{} {} {} {}", RAMP, mode.keyword(), level, duration_ms),
            Self::Multisine {
                mode,
                centre,
                amplitude,
                period_ms,
                duration_ms,
            } => uwrite!(
                out,
                "{} {} {} {} {} {}",
                SINES,
                mode.keyword(),
                centre,
                amplitude,
                period_ms,
                duration_ms
            ),
            Self::Hold { duration_ms } => uwrite!(out, "{} {}", HOLD, duration_ms),
            Self::Release { duration_ms } => uwrite!(out, "{} {}", RELEASE, duration_ms),
            Self::Repeat { from, times } => uwrite!(out, "{} {} {}", REPEAT, from, times),
        }
    }

    /// Reads it back; none when it is no segment or its numbers are out of range.
    pub fn parse(text: &[u8]) -> Option<Self> {
        let mut fields = Fields::new(text);
        let segment = match Keyword::parse(fields.next()?)? {
            STEP => Self::Step {
                mode: ControlMode::parse(fields.next()?)?,
                level: Hundredths::parse(fields.next()?)?,
                duration_ms: duration(fields.next()?)?,
            },
            RAMP => Self::Ramp {
                mode: ControlMode::parse(fields.next()?)?,
                level: Hundredths::parse(fields.next()?)?,
                duration_ms: duration(fields.next()?)?,
            },
            SINES => Self::Multisine {
                mode: ControlMode::parse(fields.next()?)?,
                centre: Hundredths::parse(fields.next()?)?,
                amplitude: Hundredths::parse(fields.next()?)?,
                period_ms: duration(fields.next()?)?,
                duration_ms: duration(fields.next()?)?,
            },
            HOLD => Self::Hold {
                duration_ms: duration(fields.next()?)?,
            },
            RELEASE => Self::Release {
                duration_ms: duration(fields.next()?)?,
            },
            REPEAT => Self::Repeat {
                from: fields.number()?,
                times: fields
                    .number()
                    .filter(|times| (1..=MAX_REPEATS).contains(times))?,
            },
            _ => return None,
        };
        fields.is_empty().then_some(segment)
    }
}

fn duration(field: &[u8]) -> Option<u32> {
    number(field).filter(|ms| (1..=MAX_DURATION_MS).contains(ms))
}

/// A list of segments, wherever it is kept.
pub trait Program {
    /// The segment at an index; none beyond the end.
    fn segment(&self, index: u8) -> Option<Segment>;
}

impl Program for [Segment] {
    fn segment(&self, index: u8) -> Option<Segment> {
        self.get(usize::from(index)).copied()
    }
}

/// Why a list of segments is no protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum InvalidProgram {
    /// It has no segment.
    Empty,
    /// It has more than [`MAX_SEGMENTS`].
    TooLong,
    /// A repeat goes forward, to itself, or contains another repeat.
    Repeat {
        /// The segment at fault.
        index: u8,
    },
}

impl core::fmt::Display for InvalidProgram {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Empty => f.write_str("the protocol has no segments"),
            Self::TooLong => write!(f, "the protocol has more than {MAX_SEGMENTS} segments"),
            Self::Repeat { index } => write!(
                f,
                "segment {index}: a repeat must go back, and not over another repeat"
            ),
        }
    }
}

impl core::error::Error for InvalidProgram {}

/// Checks a list of segments as a whole.
///
/// # Errors
///
/// [`InvalidProgram`].
pub fn check(program: &(impl Program + ?Sized)) -> Result<(), InvalidProgram> {
    let mut last_repeat = None;
    let mut index = 0;
    while let Some(segment) = program.segment(index) {
        if index >= MAX_SEGMENTS {
            return Err(InvalidProgram::TooLong);
        }
        if let Segment::Repeat { from, .. } = segment {
            if from >= index || last_repeat.is_some_and(|last| from <= last) {
                return Err(InvalidProgram::Repeat { index });
            }
            last_repeat = Some(index);
        }
        index += 1;
    }
    if index == 0 {
        return Err(InvalidProgram::Empty);
    }
    Ok(())
}

/// How long a protocol takes in all (ms), repeats included; at most some 49 days.
pub fn total_ms(program: &(impl Program + ?Sized)) -> u32 {
    let mut total: u32 = 0;
    let mut index = 0;
    while let Some(segment) = program.segment(index) {
        if let Segment::Repeat { from, times } = segment {
            let body = (from..index)
                .filter_map(|index| program.segment(index))
                .fold(0_u32, |sum, part| sum.saturating_add(part.duration_ms()));
            total = total.saturating_add(body.saturating_mul(u32::from(times)));
        }
        total = total.saturating_add(segment.duration_ms());
        index += 1;
        if index > MAX_SEGMENTS {
            break;
        }
    }
    total
}

/// The reference at an instant: what the controller is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reference {
    /// Track a level.
    Track {
        /// The control mode.
        mode: ControlMode,
        /// The level (kPa or °).
        level: f32,
    },
    /// Stop the pump, valve closed.
    Hold,
    /// Open the valve and take the plunger back.
    Release,
    /// The protocol is over.
    Done,
}

/// The position in a protocol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    index: u8,
    elapsed_ms: u32,
    /// Number of finished repetitions of the current repeat.
    repeats: u8,
    /// Level from which a ramp starts, with its control mode.
    before: Option<(ControlMode, f32)>,
}

impl Default for Playback {
    fn default() -> Self {
        Self::new()
    }
}

impl Playback {
    /// The start of any protocol.
    pub const fn new() -> Self {
        Self {
            index: 0,
            elapsed_ms: 0,
            repeats: 0,
            before: None,
        }
    }

    /// The current segment.
    pub const fn index(&self) -> u8 {
        self.index
    }

    /// Number of earlier repetitions of the current segments.
    pub const fn repeat(&self) -> u8 {
        self.repeats
    }

    /// The reference now.
    pub fn reference(&self, program: &(impl Program + ?Sized)) -> Reference {
        let Some(segment) = program.segment(self.index) else {
            return Reference::Done;
        };
        let (mode, level) = match segment {
            Segment::Step { mode, level, .. } => (mode, level.to_f32()),
            Segment::Ramp {
                mode,
                level,
                duration_ms,
            } => {
                let from = match self.before {
                    Some((of, before)) if of == mode => before,
                    _ => 0.0,
                };
                let share = self.elapsed_ms as f32 / duration_ms as f32;
                (mode, from + (level.to_f32() - from) * share.min(1.0))
            }
            Segment::Multisine {
                mode,
                centre,
                amplitude,
                period_ms,
                ..
            } => {
                // Written so that nothing panics; a period is never zero.
                let within = self.elapsed_ms.checked_rem(period_ms).unwrap_or(0);
                let cycles = within as f32 / period_ms as f32;
                (
                    mode,
                    centre.to_f32() + amplitude.to_f32() * multisine(cycles),
                )
            }
            // A repeat is never rested on: `advance` follows it at once.
            Segment::Hold { .. } | Segment::Repeat { .. } => return Reference::Hold,
            Segment::Release { .. } => return Reference::Release,
        };
        Reference::Track { mode, level }
    }

    /// Lets `ms` milliseconds pass.
    pub fn advance(&mut self, program: &(impl Program + ?Sized), ms: u32) {
        self.elapsed_ms = self.elapsed_ms.saturating_add(ms);
        // Every pass moves on, and a repeat is left after its number of times,
        // which bounds the loop by the length of the protocol.
        while let Some(segment) = program.segment(self.index) {
            if let Segment::Repeat { from, times } = segment {
                if self.repeats < times && from < self.index {
                    self.repeats += 1;
                    self.index = from;
                } else {
                    self.repeats = 0;
                    self.index += 1;
                }
                continue;
            }
            let duration = segment.duration_ms().max(1);
            if self.elapsed_ms < duration {
                break;
            }
            self.elapsed_ms -= duration;
            self.before = match segment {
                Segment::Step { mode, level, .. } | Segment::Ramp { mode, level, .. } => {
                    Some((mode, level.to_f32()))
                }
                Segment::Multisine { mode, centre, .. } => Some((mode, centre.to_f32())),
                Segment::Hold { .. } => self.before,
                _ => None,
            };
            self.index += 1;
        }
    }
}

/// Five sines, scaled to a largest value of one.
fn multisine(cycles: f32) -> f32 {
    use core::f32::consts::TAU;
    const HARMONICS: [f32; 5] = [1.0, 2.0, 3.0, 5.0, 7.0];
    // Phases in turns with a low crest, found by a random search over
    // twentieths; with them the sum peaks at 2.56.
    const PHASES: [f32; 5] = [0.0, 0.85, 0.3, 0.85, 0.8];
    const SCALE: f32 = 0.39;
    let mut sum = 0.0;
    for (harmonic, phase) in HARMONICS.into_iter().zip(PHASES) {
        sum += elementary::sin(TAU * (harmonic * cycles + phase));
    }
    SCALE * sum
}

macro_rules! named {
    ($( $(#[$doc:meta])* $variant:ident, $word:literal, $title:literal, [ $( $index:literal => $segment:expr ),+ $(,)? ]; )+) => {
        /// A protocol that every board knows by name.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        pub enum Named {
            $( $(#[$doc])* $variant, )+
        }

        impl Named {
            /// Every one of them.
            pub const ALL: &'static [Self] = &[$( Self::$variant ),+];

            /// The word in a line and on the command line.
            pub const fn keyword(self) -> Keyword {
                match self {
                    $( Self::$variant => const { Keyword::of($word) }, )+
                }
            }

            /// The word as text.
            pub const fn name(self) -> &'static str {
                match self { $( Self::$variant => $word, )+ }
            }

            /// Its purpose, in one line.
            pub const fn title(self) -> &'static str {
                match self { $( Self::$variant => $title, )+ }
            }
        }

        impl Program for Named {
            fn segment(&self, index: u8) -> Option<Segment> {
                // Code, not a table: constants would be copied to the board's RAM.
                Some(match (self, index) {
                    $( $( (Self::$variant, $index) => $segment, )+ )+
                    _ => return None,
                })
            }
        }
    };
}

const fn step(degrees: i32, duration_ms: u32) -> Segment {
    Segment::Step {
        mode: ControlMode::AngleOpenLoop,
        level: Hundredths(degrees * 100),
        duration_ms,
    }
}

const fn ramp(degrees: i32, duration_ms: u32) -> Segment {
    Segment::Ramp {
        mode: ControlMode::AngleOpenLoop,
        level: Hundredths(degrees * 100),
        duration_ms,
    }
}

const fn follow(degrees: i32, duration_ms: u32) -> Segment {
    Segment::Step {
        mode: ControlMode::AngleClosedLoop,
        level: Hundredths(degrees * 100),
        duration_ms,
    }
}

const fn release(duration_ms: u32) -> Segment {
    Segment::Release { duration_ms }
}

named! {
    /// The paper's: 60° and 90°, seven repeats each.
    Paper, "paper", "steps to 60 and 90 degrees, seven repeats each", [
        0 => step(60, 6_000), 1 => release(4_000), 2 => Segment::Repeat { from: 0, times: 6 },
        3 => step(90, 6_000), 4 => release(4_000), 5 => Segment::Repeat { from: 3, times: 6 },
    ];
    /// Steps that tell more rivals apart than the paper's.
    Steps, "steps", "steps to 10, 30, 60 and 90 degrees, two repeats each", [
        0 => step(10, 5_000), 1 => release(4_000),
        2 => step(30, 5_000), 3 => release(4_000),
        4 => step(60, 5_000), 5 => release(4_000),
        6 => step(90, 5_000), 7 => release(4_000),
        8 => Segment::Repeat { from: 0, times: 1 },
    ];
    /// Up and down in steps of 20°.
    Staircase, "stairs", "up to 80 degrees and down again in steps of 20", [
        0 => step(20, 3_000), 1 => step(40, 3_000), 2 => step(60, 3_000), 3 => step(80, 3_000),
        4 => step(60, 3_000), 5 => step(40, 3_000), 6 => step(20, 3_000), 7 => release(4_000),
    ];
    /// Triangles at three speeds: what changes with speed is viscous.
    Triangles, "triangle", "triangles to 80 degrees at three speeds", [
        0 => ramp(80, 2_000), 1 => ramp(5, 2_000), 2 => Segment::Repeat { from: 0, times: 1 },
        3 => ramp(80, 6_000), 4 => ramp(5, 6_000), 5 => Segment::Repeat { from: 3, times: 1 },
        6 => ramp(80, 18_000), 7 => ramp(5, 18_000), 8 => release(4_000),
    ];
    /// Small reversals about two angles: friction sticks, hysteresis springs.
    Reversals, "small", "small triangles of 2 degrees about 30 and 60 degrees", [
        0 => step(30, 4_000), 1 => ramp(32, 2_000), 2 => ramp(28, 4_000), 3 => ramp(30, 2_000),
        4 => Segment::Repeat { from: 1, times: 2 },
        5 => step(60, 4_000), 6 => ramp(62, 2_000), 7 => ramp(58, 4_000), 8 => ramp(60, 2_000),
        9 => Segment::Repeat { from: 6, times: 2 }, 10 => release(4_000),
    ];
    /// Five frequencies at once about 45°.
    Sines, "sines", "a multisine about 45 degrees", [
        0 => step(45, 4_000),
        1 => Segment::Multisine {
            mode: ControlMode::AngleOpenLoop,
            centre: Hundredths(4_500),
            amplitude: Hundredths(2_500),
            period_ms: 10_000,
            duration_ms: 30_000,
        },
        2 => release(4_000),
    ];
    /// The pump stopped at 60°: creep of the actuator against a leak.
    HoldStill, "hold", "60 degrees, then the pump stopped for 20 seconds", [
        0 => step(60, 4_000), 1 => Segment::Hold { duration_ms: 20_000 }, 2 => release(6_000),
    ];
    /// Up and down in closed loop: how well the rig follows with the model that it has.
    Follow, "follow", "closed loop to 20, 50, 30 and 60 degrees", [
        0 => follow(20, 8_000), 1 => follow(50, 8_000), 2 => follow(30, 8_000),
        3 => follow(60, 8_000), 4 => release(4_000),
    ];
}

impl Named {
    /// Looks a protocol up by its word.
    pub fn parse(word: &[u8]) -> Option<Self> {
        let word = Keyword::parse(word)?;
        Self::ALL
            .iter()
            .copied()
            .find(|named| named.keyword() == word)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use crate::{testing, text::Text};
    use proptest::prelude::*;
    use std::vec::Vec;

    fn segments() -> impl Strategy<Value = Segment> {
        testing::segments(-1_000_000..1_000_000, 1..=MAX_DURATION_MS, 0..32)
    }

    proptest! {
        #[test]
        fn segments_are_read_back(segment in segments()) {
            let mut out = Text::default();
            segment.write(&mut out).unwrap();
            prop_assert_eq!(Segment::parse(out.0.as_bytes()), Some(segment));
        }

        /// Whatever the segments, playing ends, after the time that was promised.
        #[test]
        fn playing_takes_the_promised_time(
            mut program in prop::collection::vec(segments(), 1..8), period in 1..5_000u32,
        ) {
            for segment in &mut program {
                // Short enough to play through.
                match segment {
                    Segment::Step { duration_ms, .. } | Segment::Ramp { duration_ms, .. }
                    | Segment::Multisine { duration_ms, .. } | Segment::Hold { duration_ms }
                    | Segment::Release { duration_ms } => *duration_ms = *duration_ms % 900 + 1,
                    Segment::Repeat { times, .. } => *times = *times % 5 + 1,
                }
            }
            prop_assume!(check(&program[..]).is_ok());
            let total = total_ms(&program[..]);
            let mut playback = Playback::new();
            let mut played = 0;
            playback.advance(&program[..], 0);
            while playback.reference(&program[..]) != Reference::Done {
                playback.advance(&program[..], period);
                played += period;
                prop_assert!(played < total + period);
            }
            prop_assert!(played >= total && total > 0);
        }
    }

    #[test]
    fn every_named_protocol_is_valid_and_found_again() {
        for &named in Named::ALL {
            assert_eq!(check(&named), Ok(()), "{named:?}");
            assert_eq!(Named::parse(named.name().as_bytes()), Some(named));
            let minutes = f64::from(total_ms(&named)) / 60_000.0;
            assert!((0.2..4.0).contains(&minutes), "{named:?}: {minutes} min");
        }
    }

    #[test]
    fn the_papers_protocol_has_seven_steps_to_each_angle() {
        let mut playback = Playback::new();
        let mut levels = Vec::new();
        let mut last = Reference::Release;
        loop {
            let reference = playback.reference(&Named::Paper);
            if reference == Reference::Done {
                break;
            }
            if reference != last {
                if let Reference::Track { level, .. } = reference {
                    levels.push(level);
                }
                last = reference;
            }
            playback.advance(&Named::Paper, 10);
        }
        assert_eq!(levels.len(), 14);
        assert!(levels[..7].iter().all(|level| (level - 60.0).abs() < 1e-4));
        assert!(levels[7..].iter().all(|level| (level - 90.0).abs() < 1e-4));
    }

    #[test]
    fn a_ramp_starts_where_the_last_level_was() {
        let program = [
            Segment::Step {
                mode: ControlMode::Pressure,
                level: Hundredths(1_000),
                duration_ms: 100,
            },
            Segment::Ramp {
                mode: ControlMode::Pressure,
                level: Hundredths(3_000),
                duration_ms: 200,
            },
        ];
        let mut playback = Playback::new();
        playback.advance(&program[..], 200);
        let Reference::Track { level, .. } = playback.reference(&program[..]) else {
            panic!("it tracks")
        };
        assert!((level - 20.0).abs() < 1e-5);
    }

    #[test]
    fn the_multisine_stays_within_its_amplitude_and_uses_most_of_it() {
        let peak = (0..2_000)
            .map(|k| multisine(k as f32 / 2_000.0).abs())
            .fold(0.0, f32::max);
        assert!((0.95..=1.01).contains(&peak), "{peak}");
    }

    #[test]
    fn repeats_must_go_back_and_not_nest() {
        let hold = Segment::Hold { duration_ms: 1 };
        let repeat = |from| Segment::Repeat { from, times: 1 };
        assert_eq!(check(&[][..]), Err(InvalidProgram::Empty));
        assert_eq!(
            check(&[repeat(0)][..]),
            Err(InvalidProgram::Repeat { index: 0 })
        );
        assert_eq!(
            check(&[hold, repeat(0), repeat(0)][..]),
            Err(InvalidProgram::Repeat { index: 2 })
        );
        assert_eq!(check(&[hold; 33][..]), Err(InvalidProgram::TooLong));
        assert_eq!(check(&[hold, repeat(0), hold, repeat(2)][..]), Ok(()));
    }
}
