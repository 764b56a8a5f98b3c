//! The clock by which work counts its time.
//!
//! Everywhere but in WebAssembly that is the computer's. WebAssembly has none of its own: whoever
//! runs the program gives it one, and without one no time passes.

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
pub use given::{Instant, give};
#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
pub use std::time::Instant;

#[cfg(any(test, all(target_family = "wasm", target_os = "unknown")))]
mod given {
    use std::sync::OnceLock;
    use std::time::Duration;

    static CLOCK: OnceLock<fn() -> Duration> = OnceLock::new();

    /// Gives the clock: the time since any fixed moment. The first one counts.
    pub fn give(clock: fn() -> Duration) {
        let _ = CLOCK.set(clock);
    }

    /// A moment, as [`std::time::Instant`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub struct Instant(Duration);

    impl Instant {
        /// This moment.
        pub fn now() -> Self {
            Self(CLOCK.get().map_or(Duration::ZERO, |clock| clock()))
        }

        /// The time since then; zero if the clock was set back.
        pub fn elapsed(&self) -> Duration {
            Self::now().0.saturating_sub(self.0)
        }
    }

    #[cfg(test)]
    mod tests {
        use std::sync::atomic::{AtomicU64, Ordering};

        use super::*;

        #[test]
        fn time_passes_as_the_clock_that_was_given_says_and_never_backwards() {
            static SECONDS: AtomicU64 = AtomicU64::new(5);
            assert_eq!(Instant::now().elapsed(), Duration::ZERO);
            give(|| Duration::from_secs(SECONDS.load(Ordering::Relaxed)));
            give(|| Duration::from_secs(1000));
            let begun = Instant::now();
            SECONDS.store(8, Ordering::Relaxed);
            assert_eq!(begun.elapsed(), Duration::from_secs(3));
            SECONDS.store(2, Ordering::Relaxed);
            assert_eq!(begun.elapsed(), Duration::ZERO);
        }
    }
}
