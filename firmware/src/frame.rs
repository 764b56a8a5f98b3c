//! A record in EEPROM that a power cut leaves whole or unmarked.
//!
//! ```text
//! head mark | content | CRC-16 of the content (2) | tail mark
//! ```
//!
//! A record counts only with a mark, and while anything between the marks is incomplete, both
//! have been taken away and neither has been put back: a torn record is never taken for a whole
//! one, and chance has no part in this.

use wire::checksum::Crc16;

use crate::store::Eeprom;

/// What a record's ends say when it is whole.
pub const MARK: u8 = 0xa5;
/// A mark that has been taken away.
pub const NO_MARK: u8 = 0;
/// What cells hold that were never written.
pub const ERASED: u8 = 0xff;

/// Bytes of a record beside its content: the marks and the checksum.
pub const OVERHEAD: u16 = 4;

/// The place of a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame {
    /// Address of the head mark.
    pub head: u16,
    /// Bytes of the content.
    pub length: u16,
}

/// What a place holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// No cell was ever written.
    pub erased: bool,
    /// At least one mark is there.
    pub marked: bool,
    /// The checksum is that of the content.
    pub right: bool,
}

impl Found {
    /// Whether the content can be trusted.
    ///
    /// One of two marks and the right checksum are enough, since that is what a cut between two marks
    /// leaves, before as after the change: the content is whole.
    ///
    /// The checksum alone would accept one torn record in 65 536. It is here for cells that lose their
    /// charge, and for those one in 65 536 is enough.
    pub const fn is_whole(self) -> bool {
        self.marked && self.right
    }
}

impl Frame {
    /// Address of a byte between the marks.
    pub const fn body(self, offset: u16) -> u16 {
        self.head + 1 + offset
    }

    /// Everything between the marks.
    const fn body_length(self) -> u16 {
        self.length + 2
    }

    /// Address of the tail mark.
    pub const fn tail(self) -> u16 {
        self.body(self.body_length())
    }

    /// Looks whether there is a record.
    pub fn look(self, eeprom: &impl Eeprom) -> Found {
        let (head, tail) = (eeprom.read(self.head), eeprom.read(self.tail()));
        let mut erased = head == ERASED && tail == ERASED;
        let mut crc = Crc16::new();
        for offset in 0..self.body_length() {
            let byte = eeprom.read(self.body(offset));
            erased &= byte == ERASED;
            if offset < self.length {
                crc.update(byte);
            }
        }
        Found {
            erased,
            marked: head == MARK || tail == MARK,
            right: self.pair(eeprom, self.length) == crc.value(),
        }
    }

    /// Two bytes of the content, little-endian.
    pub fn pair(self, eeprom: &impl Eeprom, offset: u16) -> u16 {
        u16::from_le_bytes([
            eeprom.read(self.body(offset)),
            eeprom.read(self.body(offset + 1)),
        ])
    }
}

/// Whether a record was written after another one; the numbers wrap around, and
/// those that are compared are never more than a few apart.
pub const fn is_newer(sequence: u16, than: u16) -> bool {
    let ahead = sequence.wrapping_sub(than);
    ahead != 0 && ahead < 0x8000
}

/// How far the writing of a record is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Poll {
    /// Call again.
    Writing,
    /// The record is stored.
    Done,
    /// The memory did not keep what was written; the other records are still there.
    Failed,
}

/// What is written next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    /// Both marks away, the tail first.
    Unmark,
    /// The bytes between them.
    Fill,
    /// Are they what they should be?
    Compare,
    /// The marks.
    Mark,
    End(Poll),
}

/// Bytes that one call reads at most: about 0.1 ms.
const READS: u8 = 16;

/// Writes a record, at most a byte a call, so that a control loop goes on meanwhile.
///
/// The order of writing: both marks away, then everything between them, compared with what was
/// meant, then both marks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Writer {
    frame: Frame,
    stage: Stage,
    /// Place in the stage.
    place: u16,
    crc: Crc16,
}

impl Writer {
    /// Begins a record in a place, whatever is there.
    pub const fn new(frame: Frame) -> Self {
        Self {
            frame,
            stage: Stage::Unmark,
            place: 0,
            crc: Crc16::new(),
        }
    }

    /// Goes on writing. `content` gives the byte at an offset, the same in every call; if it does
    /// not, the record is refused in the end and the call says [`Poll::Failed`].
    #[inline(always)] // Two records, each with its own content.
    pub fn step(&mut self, content: impl Fn(u16) -> u8, eeprom: &mut impl Eeprom) -> Poll {
        // Bytes that are right already cost no time and no wear.
        for _ in 0..READS {
            let (address, byte) = match self.stage {
                Stage::End(poll) => return poll,
                Stage::Unmark => (self.mark_address(), NO_MARK),
                Stage::Mark => (self.mark_address(), MARK),
                Stage::Fill | Stage::Compare => {
                    let byte = match self.place.checked_sub(self.frame.length) {
                        None => content(self.place),
                        Some(0) => self.crc.value().to_le_bytes()[0],
                        Some(_) => self.crc.value().to_le_bytes()[1],
                    };
                    (self.frame.body(self.place), byte)
                }
            };
            let found = eeprom.read(address);
            // What is no mark needs no taking away; writing there could make it
            // one if the power failed in the middle.
            let right = found == byte || (self.stage == Stage::Unmark && found != MARK);
            if !right && self.stage == Stage::Compare {
                self.stage = Stage::End(Poll::Failed);
                continue;
            }
            if !right {
                eeprom.write(address, byte);
            }
            self.advance(byte);
            if !right {
                break;
            }
        }
        match self.stage {
            Stage::End(poll) => poll,
            _ => Poll::Writing,
        }
    }

    /// Tail first when they go and when they come: any order would do.
    const fn mark_address(self) -> u16 {
        match self.place {
            0 => self.frame.tail(),
            _ => self.frame.head,
        }
    }

    /// Takes note that `byte` is in its place.
    fn advance(&mut self, byte: u8) {
        let in_body = matches!(self.stage, Stage::Fill | Stage::Compare);
        if in_body && self.place < self.frame.length {
            self.crc.update(byte);
        }
        self.place += 1;
        let length = if in_body { self.frame.body_length() } else { 2 };
        if self.place < length {
            return;
        }
        self.place = 0;
        self.crc = Crc16::new();
        self.stage = match self.stage {
            Stage::Unmark => Stage::Fill,
            Stage::Fill => Stage::Compare,
            Stage::Compare => Stage::Mark,
            Stage::Mark | Stage::End(_) => Stage::End(Poll::Done),
        };
    }
}
