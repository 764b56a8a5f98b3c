//! The log of the last faults, in EEPROM behind the settings.
//!
//! A ring of places, one more than there are faults to be kept: the place that is written holds
//! the oldest record, so that a power cut costs none of the others. Each is a [`Frame`]; one that
//! is torn or damaged is skipped.

use wire::{
    decimal::Hundredths,
    history::{FaultRecord, LOGGED, ResetCause},
    state::State,
};

use crate::{
    frame::{Frame, OVERHEAD, Poll, Writer, is_newer},
    store::{self, Eeprom},
};

/// Changes whenever the bytes change their meaning.
const VERSION: u8 = 1;

/// Version, number (2), fault, state, reset, time (4), pressure (4), volume (4).
const CONTENT: usize = 18;
const NUMBER_AT: u16 = 1;

/// Places of the ring.
const PLACES: u8 = LOGGED + 1;

/// Bytes from place to place.
const STRIDE: u16 = 24;
#[allow(clippy::cast_possible_truncation)] // A few bytes.
const LENGTH: u16 = CONTENT as u16;
const _: () = assert!(LENGTH + OVERHEAD <= STRIDE, "a place is too small");

/// Bytes of EEPROM that settings and log take, from address zero on.
pub const SIZE: u16 = store::SIZE + PLACES as u16 * STRIDE;

/// Says that a pressure sensor had no reading.
const NO_READING: i32 = i32::MIN;

const fn frame(place: u8) -> Frame {
    Frame {
        head: store::SIZE + place as u16 * STRIDE,
        length: LENGTH,
    }
}

const fn next(place: u8) -> u8 {
    if place + 1 < PLACES { place + 1 } else { 0 }
}

fn bytes(record: &FaultRecord) -> [u8; CONTENT] {
    let [n0, n1] = record.number.to_le_bytes();
    let [t0, t1, t2, t3] = record.time_ms.to_le_bytes();
    let pressure = record.pressure_kpa.map_or(NO_READING, |value| value.0);
    let [p0, p1, p2, p3] = pressure.to_le_bytes();
    let [v0, v1, v2, v3] = record.volume_ul.to_le_bytes();
    let (state, reset) = (record.state.letter(), record.reset.code());
    [
        VERSION,
        n0,
        n1,
        record.fault,
        state,
        reset,
        t0,
        t1,
        t2,
        t3,
        p0,
        p1,
        p2,
        p3,
        v0,
        v1,
        v2,
        v3,
    ]
}

fn record(bytes: [u8; CONTENT]) -> Option<FaultRecord> {
    let [
        VERSION,
        n0,
        n1,
        fault,
        state,
        reset,
        t0,
        t1,
        t2,
        t3,
        p0,
        p1,
        p2,
        p3,
        v0,
        v1,
        v2,
        v3,
    ] = bytes
    else {
        return None;
    };
    let pressure = i32::from_le_bytes([p0, p1, p2, p3]);
    Some(FaultRecord {
        number: u16::from_le_bytes([n0, n1]),
        fault,
        state: State::from_letter(state)?,
        reset: ResetCause::from_code(reset)?,
        time_ms: u32::from_le_bytes([t0, t1, t2, t3]),
        pressure_kpa: (pressure != NO_READING).then_some(Hundredths(pressure)),
        volume_ul: i32::from_le_bytes([v0, v1, v2, v3]),
    })
}

/// The log, and what is still to be written to it.
#[derive(Clone, Debug)]
pub struct Log {
    /// The place of the next record.
    place: u8,
    /// The number of the next fault.
    number: u16,
    /// Written when the one before is.
    waiting: Option<FaultRecord>,
    writing: Option<(FaultRecord, Writer)>,
    /// Places that did not keep the record.
    worn: u8,
}

impl Log {
    /// A log that was not looked at yet.
    pub const fn new() -> Self {
        Self {
            place: 0,
            number: 0,
            waiting: None,
            writing: None,
            worn: 0,
        }
    }

    /// Finds the newest record.
    pub fn load(&mut self, eeprom: &impl Eeprom) {
        let mut newest: Option<(u8, u16)> = None;
        for place in 0..PLACES {
            let frame = frame(place);
            if !frame.look(eeprom).is_whole() {
                continue;
            }
            let number = frame.pair(eeprom, NUMBER_AT);
            if newest.is_none_or(|(_, newest)| is_newer(number, newest)) {
                newest = Some((place, number));
            }
        }
        if let Some((place, number)) = newest {
            self.place = next(place);
            self.number = number.wrapping_add(1);
        }
    }

    /// Notes a fault; its number is given here. A third one within the half second that two need
    /// replaces the second.
    pub fn note(&mut self, record: FaultRecord) {
        let number = self.number;
        self.number = number.wrapping_add(1);
        self.waiting = Some(FaultRecord { number, ..record });
    }

    /// Whether something is still to be written.
    pub const fn is_busy(&self) -> bool {
        self.waiting.is_some() || self.writing.is_some()
    }

    /// Writes at most a byte.
    pub fn step(&mut self, eeprom: &mut impl Eeprom) {
        let Some((record, writer)) = &mut self.writing else {
            if let Some(record) = self.waiting.take() {
                self.worn = 0;
                self.writing = Some((record, Writer::new(frame(self.place))));
            }
            return;
        };
        let bytes = bytes(record);
        let byte = |at: u16| bytes.get(usize::from(at)).copied().unwrap_or(0);
        match writer.step(byte, eeprom) {
            Poll::Writing => {}
            Poll::Done => {
                self.place = next(self.place);
                self.writing = None;
            }
            Poll::Failed => {
                self.place = next(self.place);
                self.worn += 1;
                let record = *record;
                self.writing =
                    (self.worn < PLACES).then(|| (record, Writer::new(frame(self.place))));
            }
        }
    }

    /// The record of a fault, 0 for the latest; none if there is none, or if it is damaged.
    pub fn read(&self, eeprom: &impl Eeprom, back: u8) -> Option<FaultRecord> {
        if back >= LOGGED {
            return None;
        }
        let place = (self.place + PLACES - 1 - back) % PLACES;
        let frame = frame(place);
        if !frame.look(eeprom).is_whole() {
            return None;
        }
        let mut bytes = [0; CONTENT];
        for (at, byte) in (0..).zip(&mut bytes) {
            *byte = eeprom.read(frame.body(at));
        }
        record(bytes)
    }
}

impl Default for Log {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::testing::Memory;

    fn fault(time_ms: u32) -> FaultRecord {
        FaultRecord {
            number: 0,
            fault: (time_ms % 21) as u8 + 1,
            state: State::Running,
            reset: ResetCause::BrownOut,
            time_ms,
            pressure_kpa: (!time_ms.is_multiple_of(3)).then_some(Hundredths(18_120)),
            volume_ul: -350,
        }
    }

    fn write(log: &mut Log, record: FaultRecord, memory: &mut Memory) {
        log.note(record);
        for _ in 0..400 {
            let writes = memory.writes;
            log.step(memory);
            assert!(memory.writes <= writes + 1, "a byte a call");
            if !log.is_busy() {
                return;
            }
        }
        panic!("the writer never ends")
    }

    fn loaded(memory: &Memory) -> Log {
        let mut log = Log::new();
        log.load(memory);
        log
    }

    /// The times of all records, newest first.
    fn times(memory: &Memory) -> Vec<u32> {
        let log = loaded(memory);
        let records = (0..LOGGED).filter_map(|back| log.read(memory, back));
        records.map(|record| record.time_ms).collect()
    }

    fn after(faults: u32) -> Memory {
        let mut memory = Memory::erased(store::SIZE, SIZE);
        for time_ms in 1..=faults {
            write(&mut loaded(&memory), fault(time_ms), &mut memory);
        }
        memory
    }

    #[test]
    fn the_last_eight_are_kept_with_their_numbers() {
        for faults in 0..30 {
            let memory = after(faults);
            let expected: Vec<u32> = (1..=faults).rev().take(8).collect();
            assert_eq!(times(&memory), expected);
            if let Some(newest) = loaded(&memory).read(&memory, 0) {
                let number = u16::try_from(faults - 1).unwrap();
                assert_eq!(
                    newest,
                    FaultRecord {
                        number,
                        ..fault(faults)
                    }
                );
            }
        }
    }

    /// Every place of a cut, and every value of the byte that was in flight: the eight faults
    /// before are there, and the new one is whole or not there.
    #[test]
    fn a_power_cut_costs_no_fault_that_was_there() {
        for before in [0, 1, 8, 9, 17] {
            let start = after(before);
            let old = times(&start);
            let mut whole = start.clone();
            whole.writes = 0;
            write(&mut loaded(&whole), fault(99), &mut whole);
            let new: Vec<u32> = [99].into_iter().chain(old.clone()).take(8).collect();
            assert_eq!(times(&whole), new);
            for cut in 1..=whole.writes {
                for in_flight in 0..=255 {
                    let mut memory = start.clone();
                    memory.writes = 0;
                    memory.fails = Some((cut, in_flight));
                    let mut log = loaded(&memory);
                    log.note(fault(99));
                    for _ in 0..60 {
                        log.step(&mut memory);
                    }
                    memory.fails = None;
                    let found = times(&memory);
                    assert!(found == old || found == new, "{before}, {cut}: {found:?}");
                }
            }
        }
    }

    #[test]
    fn two_faults_at_once_are_both_kept() {
        let mut memory = Memory::erased(store::SIZE, SIZE);
        let mut log = loaded(&memory);
        log.note(fault(1));
        log.step(&mut memory);
        log.note(fault(2));
        for _ in 0..60 {
            log.step(&mut memory);
        }
        assert_eq!(times(&memory), [2, 1]);
    }

    #[test]
    fn a_worn_place_is_passed_over() {
        let worn = frame(1).body(7);
        let mut memory = Memory::erased(store::SIZE, SIZE);
        memory.worn = Some(worn);
        for time_ms in 1..=5 {
            let mut log = loaded(&memory);
            write(&mut log, fault(time_ms), &mut memory);
            assert_eq!(loaded(&memory).number, u16::try_from(time_ms).unwrap());
        }
        assert_eq!(times(&memory), [5, 4, 3, 2, 1]);
    }

    proptest! {
        #[test]
        fn a_damaged_record_is_skipped(
            at in store::SIZE..SIZE, flip in 1..=255_u8, faults in 1..20_u32,
        ) {
            let mut memory = after(faults);
            let expected = times(&memory);
            memory.bytes[usize::from(at)] ^= flip;
            let found = times(&memory);
            let missing = expected.iter().filter(|time| !found.contains(time)).count();
            prop_assert!(missing <= 1 && found.iter().all(|time| expected.contains(time)
                || *time + 8 == expected[0]), "{:?} of {:?}", found, expected);
        }

        #[test]
        fn noise_is_no_fault(noise in prop::collection::vec(any::<u8>(), SIZE as usize)) {
            let mut memory = Memory::erased(store::SIZE, SIZE);
            memory.bytes = noise;
            prop_assert_eq!(times(&memory), Vec::<u32>::new());
            write(&mut loaded(&memory), fault(7), &mut memory);
            prop_assert_eq!(times(&memory), [7]);
        }
    }
}
