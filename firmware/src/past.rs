//! The second before a fault, in RAM: a black box.
//!
//! Telemetry that was lost, because the cable was pulled or its buffer was full, is lost when it
//! is needed most. The board keeps its own, at half the rate, until the fault is cleared.

use wire::{
    decimal::Hundredths,
    history::{MOMENTS, Moment},
    state::State,
};

/// A [`Moment`] in fourteen bytes.
#[derive(Clone, Copy, Debug)]
struct Kept {
    /// The low bits of the time.
    time_ms: u16,
    pressure: i32,
    angle: i16,
    volume_ul: i32,
    state: State,
    segment: u8,
}

/// No reading of the pressure (hundredths of a kPa).
const NO_PRESSURE: i32 = i32::MIN;
/// No reading of the angle (hundredths of a degree).
const NO_ANGLE: i16 = i16::MIN;
/// No protocol is played: one has at most 32 segments.
const NO_SEGMENT: u8 = u8::MAX;

/// The last second, and whether it ends with a fault.
#[derive(Clone, Debug)]
pub struct Past {
    moments: [Kept; MOMENTS as usize],
    /// Where the next one goes.
    next: u8,
    count: u8,
    /// When the fault was (ms); from then on nothing is added.
    ended_ms: Option<u32>,
}

impl Past {
    /// Nothing was seen yet.
    pub const fn new() -> Self {
        Self {
            moments: [Kept {
                time_ms: 0,
                pressure: 0,
                angle: 0,
                volume_ul: 0,
                state: State::Idle,
                segment: 0,
            }; MOMENTS as usize],
            next: 0,
            count: 0,
            ended_ms: None,
        }
    }

    /// Adds a moment, unless a fault has ended the second.
    pub fn note(&mut self, moment: &Moment) {
        if self.ended_ms.is_some() {
            return;
        }
        let Some(place) = self.moments.get_mut(usize::from(self.next)) else {
            return;
        };
        #[allow(clippy::cast_possible_truncation)] // Its low bits; saturated.
        let (time_ms, angle) = (moment.time_ms as u16, |angle: Hundredths| {
            angle.0.clamp(i32::from(NO_ANGLE) + 1, i32::from(i16::MAX)) as i16
        });
        *place = Kept {
            time_ms,
            pressure: moment.pressure_kpa.map_or(NO_PRESSURE, |value| value.0),
            angle: moment.angle_deg.map_or(NO_ANGLE, angle),
            volume_ul: moment.volume_ul,
            state: moment.state,
            segment: moment.segment.unwrap_or(NO_SEGMENT),
        };
        self.next = if self.next + 1 < MOMENTS {
            self.next + 1
        } else {
            0
        };
        self.count = MOMENTS.min(self.count + 1);
    }

    /// The fault: what was noted last belongs to it.
    pub fn end(&mut self, time_ms: u32) {
        self.ended_ms.get_or_insert(time_ms);
    }

    /// Begins again if a fault had ended it, which was cleared.
    pub fn clear_if_ended(&mut self) {
        if self.ended_ms.is_some() {
            (self.next, self.count, self.ended_ms) = (0, 0, None);
        }
    }

    /// A moment of the second before the fault, 0 for the fault itself; none without a fault.
    pub fn get(&self, back: u8) -> Option<Moment> {
        let ended_ms = self.ended_ms?;
        if back >= self.count {
            return None;
        }
        let place = (self.next + MOMENTS - 1 - back) % MOMENTS;
        let kept = self.moments.get(usize::from(place))?;
        #[allow(clippy::cast_possible_truncation)] // Its low bits.
        let age_ms = (ended_ms as u16).wrapping_sub(kept.time_ms);
        Some(Moment {
            time_ms: ended_ms.wrapping_sub(age_ms.into()),
            pressure_kpa: (kept.pressure != NO_PRESSURE).then_some(Hundredths(kept.pressure)),
            angle_deg: (kept.angle != NO_ANGLE).then_some(Hundredths(kept.angle.into())),
            volume_ul: kept.volume_ul,
            state: kept.state,
            segment: (kept.segment != NO_SEGMENT).then_some(kept.segment),
        })
    }
}

impl Default for Past {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(time_ms: u32) -> Moment {
        #[allow(clippy::cast_possible_wrap)]
        let number = time_ms as i32 % 1_000;
        Moment {
            time_ms,
            pressure_kpa: (number % 3 != 0).then_some(Hundredths(400_000 + number)),
            angle_deg: (number % 7 != 0).then_some(Hundredths(-number)),
            volume_ul: 99_000 + number,
            state: State::Running,
            segment: (number % 2 == 0).then_some(31),
        }
    }

    #[test]
    fn the_second_before_a_fault_is_kept_until_it_is_cleared() {
        // The clock's low bits wrap within it.
        for first in [0, 0xff_f000, u32::MAX - 700] {
            let mut past = Past::new();
            let time = |number: u32| first.wrapping_add(20 * number);
            for number in 0..200 {
                past.note(&moment(time(number)));
                assert_eq!(past.get(0), None, "no fault yet");
            }
            past.end(time(199));
            past.note(&moment(5));
            past.end(7);
            for back in 0..MOMENTS {
                assert_eq!(past.get(back), Some(moment(time(199 - u32::from(back)))));
            }
            assert_eq!(past.get(MOMENTS), None);
            past.clear_if_ended();
            assert_eq!(past.get(0), None);
            past.note(&moment(40));
            past.end(40);
            assert_eq!((past.get(0), past.get(1)), (Some(moment(40)), None));
        }
    }
}
