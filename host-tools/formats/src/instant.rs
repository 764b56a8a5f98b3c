//! The moment by which work counts its time, and waiting.
//!
//! Everywhere but in WebAssembly both are the computer's. WebAssembly has neither: the program's
//! host gives them, and without them no time passes.

#[cfg(all(target_family = "wasm", target_os = "unknown"))]
pub use given::{Instant, give, sleep};
#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
pub use std::{thread::sleep, time::Instant};

#[cfg(any(test, all(target_family = "wasm", target_os = "unknown")))]
mod given {
    use std::ops::Add;
    use std::sync::OnceLock;
    use std::time::Duration;

    /// A clock, and how to wait by it.
    struct Given {
        now: fn() -> Duration,
        sleep: fn(Duration),
    }

    static GIVEN: OnceLock<Given> = OnceLock::new();

    /// Gives the clock, the time since any fixed moment, and what waits. The first ones count.
    pub fn give(now: fn() -> Duration, sleep: fn(Duration)) {
        let _ = GIVEN.set(Given { now, sleep });
    }

    /// Waits, as [`std::thread::sleep`].
    pub fn sleep(time: Duration) {
        if let Some(given) = GIVEN.get() {
            (given.sleep)(time);
        }
    }

    /// A moment, as [`std::time::Instant`].
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
    pub struct Instant(Duration);

    impl Instant {
        /// This moment.
        pub fn now() -> Self {
            Self(GIVEN.get().map_or(Duration::ZERO, |given| (given.now)()))
        }

        /// The time since then; zero if the clock was set back.
        pub fn elapsed(&self) -> Duration {
            Self::now().saturating_duration_since(*self)
        }

        /// The time from an earlier moment to this one; zero if it is a later one.
        pub fn saturating_duration_since(&self, earlier: Self) -> Duration {
            self.0.saturating_sub(earlier.0)
        }
    }

    impl Add<Duration> for Instant {
        type Output = Self;

        fn add(self, time: Duration) -> Self {
            Self(self.0.saturating_add(time))
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
            sleep(Duration::from_secs(1000));
            give(
                || Duration::from_secs(SECONDS.load(Ordering::Relaxed)),
                |time| {
                    SECONDS.fetch_add(time.as_secs(), Ordering::Relaxed);
                },
            );
            give(|| Duration::from_secs(1000), |_| ());
            let begun = Instant::now();
            sleep(Duration::from_secs(3));
            assert_eq!(begun.elapsed(), Duration::from_secs(3));
            assert_eq!(Instant::now(), begun + Duration::from_secs(3));
            SECONDS.store(2, Ordering::Relaxed);
            assert_eq!(begun.elapsed(), Duration::ZERO);
        }
    }
}
