//! Answers to queries: the text after the `ok` of a [`reply`](crate::reply).
//!
//! The board writes these types, the computer and the tests read them. The reply to a command
//! is only `ok` or `no`, so it needs no type here.

use core::fmt;

use ufmt::{Formatter, uDisplay, uWrite, uwrite};

use crate::{
    checksum::Crc16,
    decimal::{Count, HalfWord, Whole, Word},
    fault::Fault,
    fields::{self, Fields},
    keyword::Keyword,
    reply::VERSION,
    settings::Settings,
    state::State,
};

/// Number of ADC conversions that a reading of a sensor sums up.
pub const OVERSAMPLING: u16 = 16;

/// Checksum of the settings in use, which identifies them in recordings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct SettingsId(pub u16);

impl SettingsId {
    /// Checksum of these settings.
    pub fn of(settings: &Settings) -> Self {
        let mut crc = Crc16::new();
        for word in settings.words() {
            for byte in word.to_le_bytes() {
                crc.update(byte);
            }
        }
        Self(crc.value())
    }

    fn parse(field: &[u8]) -> Option<Self> {
        fields::half_word(field).map(Self)
    }
}

impl uDisplay for SettingsId {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        uDisplay::fmt(&HalfWord(self.0), f)
    }
}

impl fmt::Display for SettingsId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04x}", self.0)
    }
}

/// Checksums ([`Crc16`]) of the board's program: what is in its flash, and what the build put
/// there. They differ after an upload that was cut off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImageSum {
    /// Of the flash, computed by the board at its start.
    pub found: u16,
    /// Of the image that was built, as the build wrote it into the image.
    pub built: u16,
}

impl ImageSum {
    /// Whether the flash holds the image that was built.
    pub const fn is_whole(self) -> bool {
        self.found == self.built
    }
}

/// The answer to `hello`, and the first remark after a reset: who the board is.
///
/// ```text
/// softrig 0.1.0 wire 3 settings 1d0f image 4f2a
/// ```
///
/// An image that is not whole says `image 91c3 built 4f2a`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity<'t> {
    /// Version of the firmware.
    pub firmware: &'t str,
    /// [`VERSION`] of the board.
    pub wire: u8,
    /// The settings in use.
    pub settings: SettingsId,
    /// The program in flash; none for one whose build wrote no checksum.
    pub image: Option<ImageSum>,
}

impl<'t> Identity<'t> {
    /// The identity of a board that speaks this version.
    pub const fn new(firmware: &'t str, settings: SettingsId, image: Option<ImageSum>) -> Self {
        Self {
            firmware,
            wire: VERSION,
            settings,
            image,
        }
    }

    /// Reads it. What later versions may add behind is not looked at.
    pub fn parse(text: &'t str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        let mut named = |name: &[u8]| (fields.next()? == name).then(|| fields.next())?;
        let firmware = core::str::from_utf8(named(b"softrig")?).ok()?;
        let wire = fields::number(named(b"wire")?)?;
        let settings = SettingsId::parse(named(b"settings")?)?;
        let image = named(b"image").and_then(fields::half_word).map(|found| {
            let built = named(b"built").and_then(fields::half_word);
            ImageSum {
                found,
                built: built.unwrap_or(found),
            }
        });
        Some(Self {
            firmware,
            wire,
            settings,
            image,
        })
    }
}

impl uDisplay for Identity<'_> {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        let Self {
            firmware,
            wire,
            settings,
            image,
        } = self;
        uwrite!(
            f,
            "softrig {} wire {} settings {}",
            firmware,
            wire,
            settings
        )?;
        let Some(image) = image else { return Ok(()) };
        uwrite!(f, " image {}", HalfWord(image.found))?;
        if !image.is_whole() {
            uwrite!(f, " built {}", HalfWord(image.built))?;
        }
        Ok(())
    }
}

/// Counters of rejected lines since reset; they saturate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// No such command.
    pub unknown: u16,
    /// Checksum wrong.
    pub damaged: u16,
    /// Too long for a line.
    pub overlong: u16,
}

/// The position in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the segment, from 0.
    pub segment: u8,
    /// Number of its repeat, from 0.
    pub repeat: u8,
}

/// The answer to `status`: state, fault, three counters, the settings, and the place in a run.
///
/// ```text
/// x 0 1 0 0 1d0f 4 2
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Status {
    /// The board's state.
    pub state: State,
    /// The latched fault.
    pub fault: Option<Fault>,
    /// Counters of lines that it did not obey.
    pub counters: Counters,
    /// The settings in use.
    pub settings: SettingsId,
    /// Where in a run it is.
    pub place: Option<Place>,
}

impl Status {
    /// Reads it.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        let state = match fields.next()? {
            [letter] => State::from_letter(*letter)?,
            _ => return None,
        };
        let fault = match fields.number()? {
            0 => None,
            code => Some(Fault::from_code(code)?),
        };
        let counters = Counters {
            unknown: fields.number()?,
            damaged: fields.number()?,
            overlong: fields.number()?,
        };
        let settings = SettingsId::parse(fields.next()?)?;
        let place = if fields.is_empty() {
            None
        } else {
            Some(Place {
                segment: fields.number()?,
                repeat: fields.number()?,
            })
        };
        Some(Self {
            state,
            fault,
            counters,
            settings,
            place,
        })
    }
}

impl uDisplay for Status {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        let Counters {
            unknown,
            damaged,
            overlong,
        } = self.counters;
        f.write_char(char::from(self.state.letter()))?;
        let fault = self.fault.map_or(0, Fault::code);
        uwrite!(f, " {} {} {} {}", fault, unknown, damaged, overlong)?;
        uwrite!(f, " {}", self.settings)?;
        if let Some(Place { segment, repeat }) = self.place {
            uwrite!(f, " {} {}", segment, repeat)?;
        }
        Ok(())
    }
}

/// The answer to `raw`: sums of [`OVERSAMPLING`] conversions of the ADC, each conversion
/// 0 to 1023.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Raw {
    /// Value of the pressure sensor.
    pub pressure: u16,
    /// Value of the flex sensor.
    pub flex: u16,
}

impl Raw {
    /// Reads it.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        Some(Self {
            pressure: fields.number()?,
            flex: fields.number()?,
        })
    }

    /// The means of the conversions, in counts of 0 to 1023: pressure, flex.
    pub fn counts(self) -> [f32; 2] {
        [self.pressure, self.flex].map(|sum| f32::from(sum) / f32::from(OVERSAMPLING))
    }
}

impl uDisplay for Raw {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        uwrite!(f, "{} {}", self.pressure, self.flex)
    }
}

/// The answer to `switches`: which circuits are open, in this order. An open one is pressed, or
/// its wire is broken.
///
/// ```text
/// 0 0 1
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Switches {
    /// The end switch at the retracted end.
    pub retracted: bool,
    /// The end switch at the pushed-in end.
    pub pushed: bool,
    /// The emergency stop.
    pub emergency_stop: bool,
}

impl Switches {
    /// Reads it. What later versions may add behind is not looked at.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        let mut open = || match fields.next()? {
            b"0" => Some(false),
            b"1" => Some(true),
            _ => None,
        };
        Some(Self {
            retracted: open()?,
            pushed: open()?,
            emergency_stop: open()?,
        })
    }
}

impl uDisplay for Switches {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        let [retracted, pushed, emergency_stop] =
            [self.retracted, self.pushed, self.emergency_stop].map(u8::from);
        uwrite!(f, "{} {} {}", retracted, pushed, emergency_stop)
    }
}

/// The answer to `machine`: what the board found out about its pump and its supply. A number that is not known is
/// `nan`.
///
/// ```text
/// 152003 -4 4980
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Machine {
    /// Microsteps between the places where the end switches let go; none unless they were measured
    /// with the present volume of a step.
    pub stroke_steps: Option<u32>,
    /// Microsteps that were lost between the last two homings: how far the counter was off when the
    /// retracted switch let go. Positive if the plunger went less far in than it was told. None
    /// before the second homing since the reset.
    pub lost_steps: Option<i32>,
    /// The board's supply (mV), nominally 5 V, by the processor's own reference, which is good for a
    /// tenth. Measured once a second at rest; none before, and from firmware that did not measure it.
    pub supply_mv: Option<u16>,
    /// How late the pressure sensor is (ms), the vent's own time included, as the last arming found; none
    /// before.
    pub delay_ms: Option<u16>,
    /// Air behind the plunger at its start (µl), likewise.
    pub air_ul: Option<u32>,
}

impl Machine {
    /// Reads it. What later versions may add behind is not looked at.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        Some(Self {
            stroke_steps: known(fields.next()?)?,
            lost_steps: known(fields.next()?)?,
            supply_mv: fields.next().map_or(Some(None), known)?,
            delay_ms: fields.next().map_or(Some(None), known)?,
            air_ul: fields.next().map_or(Some(None), known)?,
        })
    }
}

impl uDisplay for Machine {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        or_nan(f, self.stroke_steps.map(Count))?;
        f.write_char(' ')?;
        or_nan(f, self.lost_steps.map(Whole))?;
        f.write_char(' ')?;
        or_nan(f, self.supply_mv.map(|supply| Count(u32::from(supply))))?;
        f.write_char(' ')?;
        or_nan(f, self.delay_ms.map(|delay| Count(u32::from(delay))))?;
        f.write_char(' ')?;
        or_nan(f, self.air_ul.map(Count))
    }
}

/// Writes a number, or `nan` where it is not known: a keyword, since a string would lie in RAM.
fn or_nan<W: uWrite + ?Sized>(
    f: &mut Formatter<'_, W>,
    number: Option<impl uDisplay>,
) -> Result<(), W::Error> {
    match number {
        Some(number) => number.fmt(f),
        None => const { Keyword::of("nan") }.fmt(f),
    }
}

/// A number, or `nan` where it is not known; the outer option is none when it is neither.
#[allow(clippy::option_option)]
fn known<N: TryFrom<u32> + TryFrom<i32>>(field: &[u8]) -> Option<Option<N>> {
    match field {
        b"nan" => Some(None),
        number => fields::number(number).map(Some),
    }
}

/// The answer to `exact`: the prediction to the last bit.
///
/// It belongs to the telemetry line of this number, and started this number of steps before.
/// Repeating the steps from the telemetry gives the same bits.
///
/// ```text
/// 812 311 3f490fdb 3dcccccd 461c4000
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Exact {
    /// Number of the line of telemetry.
    pub sequence: u16,
    /// Steps since the prediction started.
    pub steps: u32,
    /// Bending angle (rad).
    pub angle: f32,
    /// Its rate (rad/s).
    pub rate: f32,
    /// The newest pressure (Pa).
    pub pressure: f32,
}

impl Exact {
    /// Reads it.
    pub fn parse(text: &str) -> Option<Self> {
        let mut fields = Fields::new(text.as_bytes());
        let sequence = fields.number()?;
        let steps = fields.number()?;
        let mut float = || fields.next().and_then(fields::word).map(f32::from_bits);
        Some(Self {
            sequence,
            steps,
            angle: float()?,
            rate: float()?,
            pressure: float()?,
        })
    }
}

impl uDisplay for Exact {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        uwrite!(f, "{} {}", self.sequence, self.steps)?;
        for value in [self.angle, self.rate, self.pressure] {
            uwrite!(f, " {}", Word(value.to_bits()))?;
        }
        Ok(())
    }
}

/// The answer to `get`: the bits of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bits(pub u32);

impl Bits {
    /// Reads it.
    pub fn parse(text: &str) -> Option<Self> {
        fields::word(text.as_bytes()).map(Self)
    }
}

impl uDisplay for Bits {
    fn fmt<W: uWrite + ?Sized>(&self, f: &mut Formatter<'_, W>) -> Result<(), W::Error> {
        uDisplay::fmt(&Word(self.0), f)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::string::String;

    use proptest::prelude::*;

    use super::*;
    use crate::text::Text;

    fn text(answer: &impl uDisplay) -> String {
        let mut out = Text::default();
        let Ok(()) = uwrite!(out, "{}", answer);
        out.0
    }

    fn states() -> impl Strategy<Value = State> {
        proptest::sample::select(&State::ALL[..])
    }

    fn faults() -> impl Strategy<Value = Option<Fault>> {
        proptest::option::of(proptest::sample::select(Fault::ALL))
    }

    proptest! {
        #[test]
        fn answers_are_read_back(
            state in states(),
            fault in faults(),
            words in any::<[u16; 6]>(),
            long in any::<u32>(),
            place in proptest::option::of(any::<[u8; 2]>()),
            bits in any::<[u32; 3]>(),
            image in proptest::option::of(any::<[u16; 2]>()),
            firmware in "[0-9]{1,3}\\.[0-9]{1,3}\\.[0-9a-z-]{1,9}",
        ) {
            let settings = SettingsId(words[0]);
            let image = image.map(|[found, built]| ImageSum { found, built });
            let identity = Identity::new(&firmware, settings, image);
            let line = text(&identity);
            prop_assert_eq!(Identity::parse(&line), Some(identity));
            let status = Status {
                state,
                fault,
                counters: Counters { unknown: words[1], damaged: words[2], overlong: words[3] },
                settings,
                place: place.map(|[segment, repeat]| Place { segment, repeat }),
            };
            prop_assert_eq!(Status::parse(&text(&status)), Some(status));
            let raw = Raw { pressure: words[4], flex: words[5] };
            prop_assert_eq!(Raw::parse(&text(&raw)), Some(raw));
            let switches = Switches {
                retracted: words[4] & 1 != 0,
                pushed: words[4] & 2 != 0,
                emergency_stop: words[4] & 4 != 0,
            };
            prop_assert_eq!(Switches::parse(&text(&switches)), Some(switches));
            let machine = Machine {
                stroke_steps: place.map(|_| long),
                lost_steps: image.map(|_| bits[0].cast_signed()),
                supply_mv: place.map(|_| words[5]),
                delay_ms: image.map(|_| words[0]),
                air_ul: place.map(|_| long),
            };
            prop_assert_eq!(Machine::parse(&text(&machine)), Some(machine));
            let [angle, rate, pressure] = bits.map(f32::from_bits);
            let exact = Exact { sequence: words[1], steps: long, angle, rate, pressure };
            let read = Exact::parse(&text(&exact)).unwrap();
            prop_assert_eq!((read.sequence, read.steps), (words[1], long));
            prop_assert_eq!([read.angle, read.rate, read.pressure].map(f32::to_bits), bits);
            prop_assert_eq!(Bits::parse(&text(&Bits(long))), Some(Bits(long)));
        }

        #[test]
        fn any_text_is_read_or_refused(text in "\\PC{0,60}") {
            let _ = (Identity::parse(&text), Status::parse(&text), Raw::parse(&text));
            let _ = (Exact::parse(&text), Bits::parse(&text));
        }
    }

    #[test]
    fn the_text_is_that_of_version_3() {
        let identity = |image| text(&Identity::new("0.1.0", SettingsId(0x1d0f), image));
        assert_eq!(identity(None), "softrig 0.1.0 wire 3 settings 1d0f");
        let image = |found| ImageSum {
            found,
            built: 0x4f2a,
        };
        assert_eq!(
            identity(Some(image(0x4f2a))),
            "softrig 0.1.0 wire 3 settings 1d0f image 4f2a"
        );
        assert_eq!(
            identity(Some(image(0x91c3))),
            "softrig 0.1.0 wire 3 settings 1d0f image 91c3 built 4f2a"
        );
        let status = Status {
            state: State::Fault,
            fault: Some(Fault::HostLost),
            counters: Counters {
                unknown: 1,
                damaged: 2,
                overlong: 3,
            },
            settings: SettingsId(0xf),
            place: None,
        };
        assert_eq!(text(&status), "f 8 1 2 3 000f");
        assert_eq!(
            text(&Raw {
                pressure: 102,
                flex: 16_368
            }),
            "102 16368"
        );
    }

    #[test]
    fn other_answers_are_refused() {
        for text in [
            "",
            "softrig",
            "marlin 2 wire 1 settings 1d0f",
            "softrig 1 wire x settings 0",
        ] {
            assert_eq!(Identity::parse(text), None, "{text}");
        }
        for text in [
            "idle 0 0 0 0 1d0f",
            "i 200 0 0 0 1d0f",
            "i 0 0 0 0",
            "i 0 0 0 0 1d0f 4",
        ] {
            assert_eq!(Status::parse(text), None, "{text}");
        }
        assert_eq!(Raw::parse("12"), None);
        assert_eq!(Switches::parse("0 1"), None);
        assert_eq!(Switches::parse("0 1 2"), None);
        for text in ["", "152003", "-1 0", "152003 1.5", "none 3", "1 2 4.98"] {
            assert_eq!(Machine::parse(text), None, "{text}");
        }
        assert_eq!(Exact::parse("1 2 3f490fdb 3dcccccd"), None);
        assert_eq!(Bits::parse("3f80000"), None);
    }
}
