//! Writing an image into a board: STK500 version 2, as the Mega's bootloader speaks it.
//!
//! Opening the port resets the board, and its bootloader listens for a second. Each page is
//! addressed anew, so that one whose answer was lost can be sent again. Nothing is read back: the
//! board computes the checksum of its flash at its next start and says it, which is compared with
//! the one that the build wrote into the image. Source: Atmel AVR068; Arduino's `stk500boot_v2`.

use std::io::{self, Read, Write};
use std::path::Path;
use std::time::Duration;

use ihex::{Reader, Record};
use softrig_formats::error::InputError;
use softrig_formats::instant::Instant;
use wire::stamp::{FLASH_BYTES, MARK, STAMP_BYTES};

use super::board::Board;
use super::client::{Link, Timing};
use super::error::LinkError;
use super::transport::Connector;

/// Bytes of a page, the most that one request writes.
const PAGE_BYTES: usize = 256;
/// What erased flash holds.
const ERASED: u8 = 0xff;
/// The first bytes of an ATmega2560.
const SIGNATURE: [u8; 3] = [0x1e, 0x98, 0x01];

/// How long a bootloader is looked for.
const SEARCH: Duration = Duration::from_secs(6);
/// How long its answer to a greeting is waited for.
const GREETING: Duration = Duration::from_millis(250);
/// How long any other answer is waited for: a page takes 10 ms, and 23 ms on the line.
const ANSWER: Duration = Duration::from_secs(1);
/// How often a request is sent at most.
const ATTEMPTS: u8 = 4;

const START: u8 = 0x1b;
const TOKEN: u8 = 0x0e;
const GOOD: u8 = 0;
const SIGN_ON: u8 = 0x01;
const LOAD_ADDRESS: u8 = 0x06;
const ENTER: u8 = 0x10;
const LEAVE: u8 = 0x11;
const PROGRAM_FLASH: u8 = 0x13;
const READ_SIGNATURE: u8 = 0x1b;

/// A program for the board.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    flash: Vec<u8>,
    checksum: u16,
}

impl Image {
    /// Reads a file in Intel's format.
    ///
    /// # Errors
    ///
    /// Names the file and the line of what is wrong, also if it is whole and not softrig's: the
    /// build has written no checksum into it.
    pub fn read(path: &Path) -> Result<Self, InputError> {
        let bytes = std::fs::read(path).map_err(|error| {
            InputError::new(format!("cannot be read: {error}"), ADVICE).in_file(path)
        })?;
        Self::of(&bytes).map_err(|error| error.in_file(path))
    }

    /// Reads the bytes of such a file.
    ///
    /// # Errors
    ///
    /// As [`Self::read`], without the name.
    pub fn of(bytes: &[u8]) -> Result<Self, InputError> {
        if bytes.starts_with(b"\x7fELF") {
            return Err(InputError::new(
                "is an ELF file, but a board takes Intel hex",
                "give the .hex beside it; `avr-objcopy -O ihex -R .eeprom IMAGE.elf IMAGE.hex` makes one",
            ));
        }
        let text = std::str::from_utf8(bytes)
            .map_err(|_| InputError::new("is not an Intel hex file", ADVICE))?;
        Self::parse(text)
    }

    /// Reads the text of such a file.
    ///
    /// # Errors
    ///
    /// As [`Self::read`], without the name.
    pub fn parse(text: &str) -> Result<Self, InputError> {
        let mut flash = Vec::new();
        let mut base = 0_usize;
        let mut is_ended = false;
        for (number, record) in (1..).zip(Reader::new(text)) {
            let wrong = |what: String| InputError::new(what, ADVICE).at_line(number);
            match record.map_err(|error| wrong(format!("is not an Intel hex record ({error})")))? {
                Record::Data { offset, value } => {
                    let from = base + usize::from(offset);
                    let end = from + value.len();
                    if end > FLASH_BYTES as usize {
                        return Err(wrong(format!(
                            "goes up to byte {end}, and a program has {FLASH_BYTES} beside the bootloader"
                        )));
                    }
                    if flash.len() < end {
                        flash.resize(end, ERASED);
                    }
                    if let Some(place) = flash.get_mut(from..end) {
                        place.copy_from_slice(&value);
                    }
                }
                Record::ExtendedLinearAddress(high) => base = usize::from(high) << 16,
                Record::ExtendedSegmentAddress(segment) => base = usize::from(segment) << 4,
                Record::EndOfFile => is_ended = true,
                Record::StartLinearAddress(_) | Record::StartSegmentAddress { .. } => {}
            }
        }
        if !is_ended {
            return Err(InputError::new("ends in the middle", ADVICE));
        }
        let checksum = checksum_of(&flash)
            .ok_or_else(|| InputError::new("is not a complete softrig firmware", ADVICE))?;
        Ok(Self { flash, checksum })
    }

    /// The checksum that the build wrote into it, which the board has to find.
    pub fn checksum(&self) -> u16 {
        self.checksum
    }

    /// Its length (bytes).
    pub fn len(&self) -> usize {
        self.flash.len()
    }

    /// Whether there is nothing in it: never, as it has a checksum.
    pub fn is_empty(&self) -> bool {
        self.flash.is_empty()
    }
}

/// What helps with every wrong file.
const ADVICE: &str =
    "name the firmware/softrig-mega2560.hex of a release, or what `cargo xtask firmware` builds";

/// The checksum in a flash, if its length is right.
fn checksum_of(flash: &[u8]) -> Option<u16> {
    let at = flash.windows(MARK.len()).position(|it| it == MARK)? + MARK.len();
    let [a, b, c, d, low, high] = *flash.get(at..at + STAMP_BYTES)?.first_chunk()?;
    let length = usize::try_from(u32::from_le_bytes([a, b, c, d])).ok()?;
    (length == flash.len()).then_some(u16::from_le_bytes([low, high]))
}

/// Why an image was not written, or not surely.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FlashError {
    /// The port cannot be opened.
    #[error(transparent)]
    Open(#[from] InputError),
    /// No bootloader answered.
    #[error(
        "{port}: no bootloader answered within {} s; nothing was written. Is it the board's port (`softrig ports`)? Press its reset button while this command waits; a board without bootloader needs one (Arduino IDE: Tools, Burn Bootloader)",
        SEARCH.as_secs()
    )]
    NoBootloader {
        /// The port.
        port: String,
    },
    /// Another processor.
    #[error(
        "{port}: a processor of signature {found:02x?} answered; nothing was written. The firmware is for the ATmega2560 of an Arduino Mega ({SIGNATURE:02x?})"
    )]
    OtherProcessor {
        /// The port.
        port: String,
        /// What it answered.
        found: Vec<u8>,
    },
    /// The bootloader did not do something.
    #[error(
        "{port}: the bootloader did not {what}, asked {ATTEMPTS} times. The board holds an incomplete program, which moves nothing: flash it again, with another cable if it happens twice"
    )]
    NotDone {
        /// The port.
        port: String,
        /// What.
        what: String,
    },
    /// The board has something else in its flash than was written.
    #[error(
        "{port}: the board found the checksum {found} in its flash; flash it again, with another cable if it happens twice"
    )]
    OtherChecksum {
        /// The port.
        port: String,
        /// What it found, instead of what.
        found: String,
    },
    /// The board did not start what was written.
    #[error(transparent)]
    Started(#[from] LinkError),
    /// The port itself failed.
    #[error("{port}: {source}; the cable was pulled? Flash the board again")]
    Port {
        /// The port.
        port: String,
        /// The error of the system.
        source: io::Error,
    },
}

/// What is being done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The bootloader is looked for.
    Searching,
    /// So many bytes of how many are written.
    Writing(usize, usize),
    /// The board starts the program and computes its checksum.
    Starting,
}

/// Writes an image into the board behind a port, and compares the checksum of what the board then
/// has. Returns what the board says it is.
///
/// # Errors
///
/// [`FlashError`].
pub fn flash(
    mut connector: impl Connector + 'static,
    image: &Image,
    mut progress: impl FnMut(Stage),
) -> Result<Board, FlashError> {
    progress(Stage::Searching);
    write(&mut connector, image, |done, total| {
        progress(Stage::Writing(done, total));
    })?;
    progress(Stage::Starting);
    let link = Link::open(connector, Timing::default())?;
    let board = link.board().clone();
    let found = board.image.map(|sum| sum.found);
    if found == Some(image.checksum()) {
        return Ok(board);
    }
    Err(FlashError::OtherChecksum {
        port: link.port().to_owned(),
        found: found.map_or_else(
            || "none".to_owned(),
            |found| format!("{found:04x} instead of {:04x}", image.checksum()),
        ),
    })
}

/// Writes an image; `progress` hears the bytes that are written of how many. The board starts it at
/// the end.
fn write(
    connector: &mut dyn Connector,
    image: &Image,
    mut progress: impl FnMut(usize, usize),
) -> Result<(), FlashError> {
    let channel = connector.open_after_reset()?;
    let mut loader = Loader {
        port: connector.name(),
        reader: channel.reader,
        writer: channel.writer,
        sequence: 0,
        received: Vec::new(),
    };
    loader.greet()?;
    loader.check_signature()?;
    // What a programmer of hardware would need; this bootloader only has to hear it.
    let enter = [ENTER, 200, 100, 25, 32, 0, 0x53, 3, 0xac, 0x53, 0, 0];
    loader.obey("start to be programmed", &[&enter])?;
    let total = image.len();
    progress(0, total);
    for (number, page) in (0_u32..).zip(image.flash.chunks(PAGE_BYTES)) {
        let from = number * 256;
        // In words; the highest bit says that the address needs 24 of them.
        let [high, b, c, d] = (from / 2).to_be_bytes();
        let address = [LOAD_ADDRESS, high | 0x80, b, c, d];
        // A page is whole words.
        let mut data = page.to_vec();
        data.resize(page.len().next_multiple_of(2), ERASED);
        let length = u16::try_from(data.len()).unwrap_or(0).to_be_bytes();
        let [long, short] = length;
        let header = [PROGRAM_FLASH, long, short, 0xc1, 10, 0x40, 0x4c, 0x20, 0, 0];
        loader.obey(
            &format!("write the page at {from:#x}"),
            &[&address, &[&header[..], &data].concat()],
        )?;
        progress((from as usize + page.len()).min(total), total);
    }
    loader.obey("start the program", &[&[LEAVE, 1, 1]])
}

/// A bootloader at the other end.
struct Loader<'p> {
    port: &'p str,
    reader: Box<dyn Read + Send>,
    writer: Box<dyn Write + Send>,
    sequence: u8,
    received: Vec<u8>,
}

impl Loader<'_> {
    fn failed(&self, source: io::Error) -> FlashError {
        FlashError::Port {
            port: self.port.to_owned(),
            source,
        }
    }

    /// Sends a request and takes its answer; none if none came in time.
    fn ask(&mut self, body: &[u8], patience: Duration) -> Result<Option<Vec<u8>>, FlashError> {
        self.sequence = self.sequence.wrapping_add(1);
        let request = seal(self.sequence, body);
        let sent = self
            .writer
            .write_all(&request)
            .and_then(|()| self.writer.flush());
        sent.map_err(|error| self.failed(error))?;
        self.received.clear();
        let until = Instant::now() + patience;
        let mut bytes = [0; 512];
        while Instant::now() < until {
            match self.reader.read(&mut bytes) {
                Ok(count) => self.received.extend(bytes.iter().take(count)),
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::TimedOut
                            | io::ErrorKind::WouldBlock
                            | io::ErrorKind::Interrupted
                    ) => {}
                Err(error) => return Err(self.failed(error)),
            }
            let answer = open(&self.received, self.sequence);
            if let Some(answer) = answer
                && answer.first() == body.first()
            {
                return Ok(Some(answer.to_vec()));
            }
        }
        Ok(None)
    }

    /// Looks for the bootloader until it answers. What the program before it still sends is passed
    /// over.
    fn greet(&mut self) -> Result<(), FlashError> {
        let until = Instant::now() + SEARCH;
        while Instant::now() < until {
            if self.ask(&[SIGN_ON], GREETING)?.is_some() {
                return Ok(());
            }
        }
        Err(FlashError::NoBootloader {
            port: self.port.to_owned(),
        })
    }

    fn check_signature(&mut self) -> Result<(), FlashError> {
        let mut found = Vec::new();
        for index in 0..3 {
            let answer = self.ask(&[READ_SIGNATURE, 4, 0x30, 0, index, 0], ANSWER)?;
            found.extend(answer.and_then(|it| it.get(2).copied()));
        }
        if found == SIGNATURE {
            return Ok(());
        }
        Err(FlashError::OtherProcessor {
            port: self.port.to_owned(),
            found,
        })
    }

    /// Makes requests that belong together, all of them again if one is not answered with good.
    fn obey(&mut self, what: &str, bodies: &[&[u8]]) -> Result<(), FlashError> {
        for _ in 0..ATTEMPTS {
            let mut all = true;
            for body in bodies {
                let answer = self.ask(body, ANSWER)?;
                all &= answer.and_then(|it| it.get(1).copied()) == Some(GOOD);
                if !all {
                    break;
                }
            }
            if all {
                return Ok(());
            }
        }
        Err(FlashError::NotDone {
            port: self.port.to_owned(),
            what: what.to_owned(),
        })
    }
}

fn xor(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// Puts a body into a frame.
///
/// ```text
/// request, answer:  1b  sequence  length (2, big-endian)  0e  body  xor of all before
/// body:             command, then parameters or a status (00 good)
/// ```
fn seal(sequence: u8, body: &[u8]) -> Vec<u8> {
    let [high, low] = u16::try_from(body.len()).unwrap_or(u16::MAX).to_be_bytes();
    let mut frame = vec![START, sequence, high, low, TOKEN];
    frame.extend(body);
    frame.push(xor(&frame));
    frame
}

/// The body of the frame with this number in what was received; none if it is not there as a
/// whole. Bytes around it may be anything.
fn open(received: &[u8], sequence: u8) -> Option<&[u8]> {
    (0..received.len()).find_map(|at| {
        let frame = received.get(at..)?;
        let [START, number, high, low, TOKEN, rest @ ..] = frame else {
            return None;
        };
        let length = usize::from(u16::from_be_bytes([*high, *low]));
        let whole = frame.get(..5 + length + 1)?;
        (*number == sequence && xor(whole) == 0).then(|| rest.get(..length))?
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A line of Intel's format.
    fn line(offset: u16, kind: u8, bytes: &[u8]) -> String {
        let [high, low] = offset.to_be_bytes();
        let count = u8::try_from(bytes.len()).unwrap();
        let all = [&[count, high, low, kind], bytes].concat();
        let sum = all.iter().fold(0_u8, |sum, &byte| sum.wrapping_add(byte));
        let digits: Vec<String> = all.iter().map(|byte| format!("{byte:02X}")).collect();
        format!(":{}{:02X}\n", digits.concat(), sum.wrapping_neg())
    }

    fn stamped(length: u32, checksum: u16) -> Vec<u8> {
        [
            &MARK[..],
            &length.to_le_bytes()[..],
            &checksum.to_le_bytes()[..],
        ]
        .concat()
    }

    const END: &str = ":00000001FF\n";

    #[test]
    fn an_image_has_its_bytes_in_their_places_and_its_checksum() {
        let text = [
            line(0, 0, &stamped(0x1_0002, 0x4f2a)),
            line(0, 4, &[0, 1]),
            line(0, 0, &[7, 8]),
            END.to_owned(),
        ]
        .concat();
        let image = Image::parse(&text).unwrap();
        assert_eq!((image.len(), image.checksum()), (0x1_0002, 0x4f2a));
        assert_eq!(image.flash[0x1_0000..], [7, 8]);
        assert_eq!(image.flash[100], ERASED);
    }

    #[test]
    fn what_is_no_text_is_told_what_is_wanted() {
        let said = |bytes: &[u8]| Image::of(bytes).unwrap_err().to_string();
        assert!(said(b"\x7fELF\x01\x01\x01").contains("give the .hex beside it"));
        assert!(said(b"\xff\xfe").contains("is not an Intel hex file"));
        assert!(said(b"hello").contains("is not an Intel hex record"));
    }

    #[test]
    fn a_wrong_file_is_named_with_its_line() {
        let stamp = line(0, 0, &stamped(16, 1));
        for (text, found) in [
            (String::new(), "ends in the middle"),
            (stamp.clone(), "ends in the middle"),
            (format!("{stamp}:00\n{END}"), "line 2"),
            (
                format!("{stamp}{}{END}", line(0, 0, &[1; 20])),
                "not a complete softrig firmware",
            ),
            (
                format!("{}{END}", line(0, 0, &[1; 20])),
                "complete softrig firmware",
            ),
            (
                format!("{}{}{END}", line(0, 4, &[0, 3]), line(0xe000, 0, &[1])),
                "beside the bootloader",
            ),
        ] {
            let error = Image::parse(&text).unwrap_err();
            let error = error.in_file(Path::new("image.hex")).to_string();
            assert!(error.contains(found), "{error}");
        }
    }

    #[test]
    fn a_frame_is_found_among_other_bytes_and_a_damaged_one_is_not() {
        let frame = seal(7, &[SIGN_ON, GOOD, 8]);
        let among = [b"T 1 2\n", &frame[..], b"x"].concat();
        assert_eq!(open(&among, 7), Some(&[SIGN_ON, GOOD, 8][..]));
        assert_eq!(open(&among, 8), None);
        assert_eq!(open(&frame[..frame.len() - 1], 7), None);
        let mut damaged = frame;
        damaged[6] ^= 1;
        assert_eq!(open(&damaged, 7), None);
    }
}
