//! Question and answer between JavaScript and WebAssembly.
//!
//! A question is written into a [`room`]: its JSON, and after it the bytes of a file if it brings
//! one. [`ask`] answers into another, which [`answer`] finds.
// Names that another language calls, and functions of another language, are what `unsafe` is for.
// Nothing here dereferences a pointer.
#![allow(unsafe_code)]

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use serde_json::json;
use softrig::clock;
use softrig::diagnose::Job;

use crate::desk::{Desk, Request};

#[link(wasm_import_module = "page")]
unsafe extern "C" {
    /// Milliseconds since any fixed moment.
    safe fn now_ms() -> f64;
    /// Takes note of the progress: JSON at this address, of so many bytes. Whether it is enough.
    safe fn go_on(text: *const u8, bytes: usize) -> bool;
    /// Takes note of what a defect said before it ends everything.
    safe fn defect(text: *const u8, bytes: usize);
}

/// How often the page hears of progress (ms): as often as it is worth drawing.
const EVERY_MS: f64 = 150.0;

static QUESTION: Mutex<Vec<u8>> = Mutex::new(Vec::new());
static ANSWER: Mutex<String> = Mutex::new(String::new());
static DESK: Mutex<Option<Desk>> = Mutex::new(None);

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
    clock::give(|| Duration::from_secs_f64(now_ms().max(0.0) / 1e3));
    std::panic::set_hook(Box::new(|info| {
        let said = info.to_string();
        defect(said.as_ptr(), said.len());
    }));
    let mut question = std::mem::take(&mut *lock(&QUESTION));
    let file = question.split_off(json_bytes.min(question.len()));
    let request = serde_json::from_slice::<Request>(&question);
    let mut desk = lock(&DESK);
    let answered = match request {
        Ok(request) => desk
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
