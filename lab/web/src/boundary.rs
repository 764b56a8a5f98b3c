//! Question and answer between JavaScript and WebAssembly.
//!
//! A question is written into a [`room`]: its JSON, and after it the bytes of a file if it brings
//! one. [`ask`] answers into another, which [`answer`] finds.
// Names that another language calls, and functions of another language, are what `unsafe` is for.
// Nothing here dereferences a pointer.
#![allow(unsafe_code)]

use std::io::{self, Read, Write};
use std::path::Path;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use serde::Deserialize;
use serde_json::{Value, json};
use softrig::diagnose::Job;
use softrig_formats::error::InputError;
use softrig_formats::instant;
use softrig_link::record::{Shelf, Table};
use softrig_link::{BAUD, Channel, Connector};

use crate::board::{self, Outside};
use crate::desk::{Desk, Request};

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Milliseconds since any fixed moment.
    safe fn now_ms() -> f64;
    /// Milliseconds since 1970.
    safe fn date_ms() -> f64;
    /// Waits.
    safe fn sleep_ms(ms: f64);
    /// Takes note of the progress: JSON at this address, of so many bytes. Whether to go on.
    safe fn go_on(text: *const u8, bytes: usize) -> bool;
    /// Takes note of what a defect said before it ends everything.
    safe fn defect(text: *const u8, bytes: usize);
    /// Shows something at once: JSON.
    safe fn shows(text: *const u8, bytes: usize);
    /// Whether the stop was pressed.
    safe fn has_enough() -> bool;
    /// Whether it was said that something is done, since this was asked last.
    safe fn is_ready() -> bool;
    /// Opens the port that was chosen, and resets the board if it is asked to. How many bytes of
    /// the reason are now in the room for it, where it cannot be opened.
    safe fn port_open(baud: u32, reset: bool, reason: *mut u8, room: usize) -> usize;
    /// Waits for bytes for so many milliseconds at most. How many came; less than none if the port
    /// is gone.
    safe fn port_read(into: *mut u8, room: usize, wait_ms: f64) -> i32;
    /// Sends bytes.
    safe fn port_write(bytes: *const u8, count: usize);
    /// Closes the port.
    safe fn port_close();
    /// Keeps a file: all of it, or more of it.
    safe fn keep(path: *const u8, letters: usize, bytes: *const u8, count: usize, append: bool);
    /// Takes a file away.
    safe fn forget(path: *const u8, letters: usize);
}

/// How often the page hears of progress (ms): as often as it is worth drawing.
const EVERY_MS: f64 = 150.0;

static QUESTION: Mutex<Vec<u8>> = Mutex::new(Vec::new());
static ANSWER: Mutex<String> = Mutex::new(String::new());
static DESK: Mutex<Option<Desk>> = Mutex::new(None);

/// What the page asks: something of a board (`do`), or of the files (`ask`).
#[derive(Deserialize)]
#[serde(untagged)]
enum Question {
    Board(board::Request),
    Desk(Request),
}

fn lock<T>(what: &Mutex<T>) -> MutexGuard<'_, T> {
    what.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes room for a question of so many bytes; null if there is not as much memory.
#[unsafe(no_mangle)]
pub extern "C" fn room(bytes: usize) -> *mut u8 {
    let mut question = lock(&QUESTION);
    *question = Vec::new();
    if question.try_reserve_exact(bytes).is_err() {
        return std::ptr::null_mut();
    }
    question.resize(bytes, 0);
    question.as_mut_ptr()
}

/// Answers the question in the room, whose first bytes are JSON. Returns how many bytes the
/// answer has.
#[unsafe(no_mangle)]
pub extern "C" fn ask(json_bytes: usize) -> usize {
    instant::give(
        || Duration::from_secs_f64(now_ms().max(0.0) / 1e3),
        |time| sleep_ms(time.as_secs_f64() * 1e3),
    );
    std::panic::set_hook(Box::new(|info| {
        let said = info.to_string();
        defect(said.as_ptr(), said.len());
    }));
    let mut question = std::mem::take(&mut *lock(&QUESTION));
    let file = question.split_off(json_bytes.min(question.len()));
    let answered = match serde_json::from_slice(&question) {
        Ok(Question::Board(request)) => board::answer(request, &file, &Browser)
            .map_err(|error| json!({ "text": format!("{error:#}") })),
        Ok(Question::Desk(request)) => lock(&DESK)
            .get_or_insert_with(Desk::default)
            .answer(request, file, &watched())
            .map_err(|fault| fault.to_json()),
        // The page and this program are built together.
        Err(error) => Err(json!({ "text": error.to_string() })),
    };
    let text = match answered {
        Ok(answer) => json!({ "answer": answer }),
        Err(fault) => json!({ "fault": fault }),
    };
    let mut answer = lock(&ANSWER);
    *answer = text.to_string();
    answer.len()
}

/// Where the last answer is.
#[unsafe(no_mangle)]
pub extern "C" fn answer() -> *const u8 {
    lock(&ANSWER).as_ptr()
}

/// A progress that the page hears of, and can end.
fn watched() -> Job {
    let last = Mutex::new((f64::NEG_INFINITY, String::new()));
    Job::default().watched_by(move |job| {
        let now = now_ms();
        let state = job.state();
        let mut last = lock(&last);
        // A stage that is not said may last.
        if now < last.0 + EVERY_MS && state.stage == last.1 {
            return;
        }
        *last = (now, state.stage.clone());
        let text = json!({
            "stage": state.stage,
            "how_far": state.how_far(),
            "best": state.best_so_far(),
            "share": state.share,
        })
        .to_string();
        if !go_on(text.as_ptr(), text.len()) {
            job.allowance.enough();
        }
    })
}

/// How long a read waits for a byte (ms).
const READ_MS: f64 = 20.0;

/// What the page lends.
struct Browser;

impl Outside for Browser {
    fn connector(&self) -> Box<dyn Connector> {
        Box::new(Port)
    }

    fn shelf(&self) -> Box<dyn Shelf> {
        Box::new(Kept)
    }

    fn shows(&self, said: &Value) {
        let text = said.to_string();
        shows(text.as_ptr(), text.len());
    }

    fn has_enough(&self) -> bool {
        has_enough()
    }

    fn is_ready(&self) -> bool {
        is_ready()
    }

    fn now(&self) -> String {
        let since = Duration::from_secs_f64(date_ms().max(0.0) / 1e3);
        humantime::format_rfc3339_seconds(SystemTime::UNIX_EPOCH + since).to_string()
    }
}

/// The port that was chosen.
struct Port;

impl Port {
    fn opened(reset: bool) -> Result<Channel, InputError> {
        let mut reason = vec![0; 1024];
        let said = port_open(BAUD, reset, reason.as_mut_ptr(), reason.len());
        if said > 0 {
            let reason = String::from_utf8_lossy(reason.get(..said).unwrap_or_default());
            return Err(InputError::new(
                format!("the port cannot be opened: {reason}"),
                "close what else has it open (another tab, `softrig`, the Arduino IDE), plug the board in again, and connect anew",
            ));
        }
        Ok(Channel {
            reader: Box::new(Open),
            writer: Box::new(Port),
        })
    }
}

impl Connector for Port {
    fn name(&self) -> &'static str {
        "the board"
    }

    fn is_simulated(&self) -> bool {
        false
    }

    fn open(&mut self) -> Result<Channel, InputError> {
        Self::opened(false)
    }

    fn open_after_reset(&mut self) -> Result<Channel, InputError> {
        Self::opened(true)
    }
}

impl Write for Port {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        port_write(bytes.as_ptr(), bytes.len());
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A port that is closed with this.
struct Open;

impl Read for Open {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match port_read(buffer.as_mut_ptr(), buffer.len(), READ_MS) {
            0 => Err(io::ErrorKind::TimedOut.into()),
            count => usize::try_from(count).map_err(|_| io::ErrorKind::NotConnected.into()),
        }
    }
}

impl Drop for Open {
    fn drop(&mut self) {
        port_close();
    }
}

/// Files that the page keeps.
#[derive(Debug)]
struct Kept;

/// A table that the page keeps.
#[derive(Debug)]
struct KeptTable(String);

fn kept(path: &str, bytes: &[u8], append: bool) {
    keep(
        path.as_ptr(),
        path.len(),
        bytes.as_ptr(),
        bytes.len(),
        append,
    );
}

impl Shelf for Kept {
    fn begin(
        &self,
        (rows, header): (&Path, &[u8]),
        (meta, about): (&Path, &[u8]),
    ) -> Result<Box<dyn Table>, InputError> {
        self.put(meta, about)?;
        self.table(rows, header)
    }

    fn table(&self, path: &Path, header: &[u8]) -> Result<Box<dyn Table>, InputError> {
        self.put(path, header)?;
        Ok(Box::new(KeptTable(path.display().to_string())))
    }

    fn put(&self, path: &Path, bytes: &[u8]) -> Result<(), InputError> {
        kept(&path.display().to_string(), bytes, false);
        Ok(())
    }

    fn remove(&self, path: &Path) {
        let path = path.display().to_string();
        forget(path.as_ptr(), path.len());
    }
}

impl Table for KeptTable {
    fn append(&mut self, lines: &[u8]) -> Result<(), InputError> {
        kept(&self.0, lines, true);
        Ok(())
    }

    fn sync(&mut self) -> Result<(), InputError> {
        Ok(())
    }
}
