//! Guards against decoders that panic on damaged files.
//!
//! Some decoders check a file's contents by assertions: a negative length ends the program.
//! Here such a panic becomes an error about a damaged file.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Whether this thread is in a decoder.
    static DECODING: Cell<bool> = const { Cell::new(false) };
}

/// Runs a decoder. Where it gives up by a panic, nothing is printed, and the error has what
/// the panic said.
pub(crate) fn guarded<T>(decode: impl FnOnce() -> T) -> Result<T, String> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let others = take_hook();
        set_hook(Box::new(move |info| {
            if !DECODING.get() {
                others(info);
            }
        }));
    });
    let outer = DECODING.replace(true);
    // What it leaves half done is thrown away.
    let result = catch_unwind(AssertUnwindSafe(decode));
    DECODING.set(outer);
    result.map_err(|cause| {
        let text = cause.downcast_ref::<&str>().map(|text| (*text).to_owned());
        text.or_else(|| cause.downcast_ref::<String>().cloned())
            .unwrap_or_else(|| "it cannot be decoded".to_owned())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_and_others_still_are_panics() {
        assert_eq!(guarded(|| 3), Ok(3));
        assert_eq!(
            guarded(|| -> i32 { panic!("at {}", 7) }),
            Err("at 7".into())
        );
        assert!(!DECODING.get());
    }
}
