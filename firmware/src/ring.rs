//! A queue of bytes between the main program and an interrupt.
//!
//! One side writes and the other reads. Each changes only its own index: bytes are stored
//! before the writer's index is released, and read before the reader's index is. On the board,
//! with one core and byte-wide loads and stores, that only orders instructions and costs
//! nothing; see [`Byte`].
//!
//! heapless' queue counts in words of the address width, whose loads an interrupt can tear here,
//! so it would need critical sections from portable-atomic around every one of them.

use crate::byte::Byte;

/// A queue of 255 bytes with one writer and one reader.
///
/// In C's order: a reader in assembly finds it by [`Ring::HEAD`] and [`Ring::TAIL`].
///
/// With 256 bytes the byte-wide indices wrap by themselves, so a push is a dozen instructions in an
/// interrupt that runs 11 000 times a second. The bytes are shared ones too, so no unsafe code is
/// needed: two writers at once would only lose and mix up bytes.
#[derive(Debug)]
#[repr(C)]
pub struct Ring<B> {
    bytes: [B; 256],
    /// Where the next byte goes; only the writer changes it.
    head: B,
    /// Where the next byte comes from; only the reader changes it.
    tail: B,
}

impl<B: Byte> Default for Ring<B> {
    fn default() -> Self {
        Self::new()
    }
}

impl<B: Byte> Ring<B> {
    /// Where, in bytes from its beginning, it has the place of the next byte to write. The bytes
    /// themselves are at its beginning.
    pub const HEAD: usize = core::mem::offset_of!(Self, head);
    /// Where it has the place of the next byte to read.
    pub const TAIL: usize = core::mem::offset_of!(Self, tail);

    /// An empty queue.
    pub const fn new() -> Self {
        Self {
            bytes: [const { B::ZERO }; 256],
            head: B::ZERO,
            tail: B::ZERO,
        }
    }

    /// Whether there is nothing to read.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.head.acquire() == self.tail.get()
    }

    /// Adds a byte; none if there is no room.
    #[inline(always)]
    pub fn push(&self, byte: u8) -> Option<()> {
        let mut draft = self.draft();
        draft.push(byte);
        draft.commit().then_some(())
    }

    /// Takes the oldest byte.
    #[inline(always)]
    pub fn pop(&self) -> Option<u8> {
        let tail = self.tail.get();
        if tail == self.head.acquire() {
            return None;
        }
        let byte = self.at(tail).get();
        self.tail.release(tail.wrapping_add(1));
        Some(byte)
    }

    /// Bytes behind the end that are read only once all of them are there.
    #[inline(always)]
    pub fn draft(&self) -> Draft<'_, B> {
        let head = self.head.get();
        let tail = self.tail.acquire();
        Draft {
            ring: self,
            head,
            // One place stays free, or a full ring would look empty.
            room: tail.wrapping_sub(head).wrapping_sub(1),
            fits: true,
        }
    }

    #[inline(always)]
    fn at(&self, place: u8) -> &B {
        &self.bytes[usize::from(place)]
    }
}

/// Bytes that are added all or none; see [`Ring::draft`].
#[derive(Debug)]
pub struct Draft<'ring, B> {
    ring: &'ring Ring<B>,
    head: u8,
    /// Free places when it was begun; meanwhile they can only become more.
    room: u8,
    fits: bool,
}

impl<B: Byte> Draft<'_, B> {
    /// Adds a byte, if there is room for it and all before it.
    #[inline(always)]
    pub fn push(&mut self, byte: u8) {
        if self.room == 0 {
            self.fits = false;
            return;
        }
        self.ring.at(self.head).set(byte);
        self.head = self.head.wrapping_add(1);
        self.room -= 1;
    }

    /// Hands the bytes over if all of them fitted; whether they did.
    #[inline(always)]
    pub fn commit(self) -> bool {
        if self.fits {
            self.ring.head.release(self.head);
        }
        self.fits
    }
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use core::sync::atomic::AtomicU8;
    use proptest::prelude::*;
    use std::{collections::VecDeque, thread, vec::Vec};

    proptest! {
        #[test]
        fn it_is_a_queue_of_255_bytes(
            turns in prop::collection::vec((any::<bool>(), 0..300_usize), 1..60),
        ) {
            let (ring, mut model) = (Ring::<AtomicU8>::new(), VecDeque::new());
            for (writes, count) in turns {
                for byte in (0..count).map(|index| (index * 7 % 251) as u8) {
                    if writes {
                        let room = model.len() < 255;
                        prop_assert_eq!(ring.push(byte).is_some(), room);
                        if room {
                            model.push_back(byte);
                        }
                    } else {
                        prop_assert_eq!(ring.pop(), model.pop_front());
                    }
                }
                prop_assert_eq!(ring.is_empty(), model.is_empty());
            }
        }

        #[test]
        fn a_draft_goes_whole_or_not_at_all(lines in prop::collection::vec(0..300_usize, 1..20)) {
            let ring = Ring::<AtomicU8>::new();
            for length in lines {
                let mut draft = ring.draft();
                for byte in 0..length {
                    draft.push(byte as u8);
                    prop_assert!(ring.is_empty(), "nothing before the end");
                }
                prop_assert_eq!(draft.commit(), length <= 255);
                let read: Vec<u8> = core::iter::from_fn(|| ring.pop()).collect();
                prop_assert_eq!(read.len(), if length <= 255 { length } else { 0 });
                prop_assert!(read.iter().enumerate().all(|(index, &byte)| byte == index as u8));
            }
        }
    }

    /// With a thread in the interrupt's place, so that a tool that knows the memory model
    /// (Miri) sees whether the indices hand the bytes over.
    #[test]
    fn every_byte_arrives_once_and_in_order() {
        const BYTES: u32 = if cfg!(miri) { 600 } else { 1_000_000 };
        let ring = Ring::<AtomicU8>::new();
        thread::scope(|scope| {
            scope.spawn(|| {
                for count in 0..BYTES {
                    while ring.push(count as u8).is_none() {
                        thread::yield_now();
                    }
                }
            });
            for count in 0..BYTES {
                let byte = loop {
                    match ring.pop() {
                        Some(byte) => break byte,
                        None => thread::yield_now(),
                    }
                };
                assert_eq!(byte, count as u8, "byte {count}");
            }
        });
        assert!(ring.is_empty());
    }
}
