//! [`Clock`]: where the time comes from.

use std::time::Duration;

/// A source of time, or none: then all that is measured takes no time. Results do not depend on it.
#[derive(Clone, Copy, Debug)]
pub struct Clock(Option<fn() -> Duration>);

impl Clock {
    /// No time passes.
    pub const NONE: Self = Self(None);

    /// A clock that reads the time since any moment that stays the same.
    pub fn new(read: fn() -> Duration) -> Self {
        Self(Some(read))
    }

    /// The clock of the system. A browser's module `wasm32-unknown-unknown` has none.
    pub fn system() -> Self {
        #[cfg(all(target_family = "wasm", target_os = "unknown"))]
        return Self::NONE;
        #[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
        Self(Some(since_first_read))
    }

    /// The time, if there is a clock.
    pub fn now(self) -> Option<Duration> {
        self.0.map(|read| read())
    }

    /// Time passed since `start`, which [`now`](Self::now) returned.
    pub fn since(self, start: Option<Duration>) -> Duration {
        let passed = start.zip(self.now()).map(|(start, now)| now.saturating_sub(start));
        passed.unwrap_or(Duration::ZERO)
    }
}

impl Default for Clock {
    fn default() -> Self {
        Self::system()
    }
}

#[cfg(not(all(target_family = "wasm", target_os = "unknown")))]
fn since_first_read() -> Duration {
    use std::sync::OnceLock;
    use std::time::Instant;

    static FIRST: OnceLock<Instant> = OnceLock::new();
    FIRST.get_or_init(Instant::now).elapsed()
}
