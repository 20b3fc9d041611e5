//! Durations of one thing done again and again.

use service::Clock;

/// Milliseconds of each time.
#[derive(Default)]
pub struct Times {
    milliseconds: Vec<f64>,
}

impl Times {
    /// Does it once more, timed.
    pub fn time<T>(&mut self, clock: &Clock, work: impl FnOnce() -> T) -> T {
        let begun = clock.now();
        let done = work();
        self.milliseconds.push(clock.now().since(begun).as_secs_f64() * 1e3);
        done
    }

    /// How many times.
    #[must_use]
    pub fn n(&self) -> usize {
        self.milliseconds.len()
    }

    /// The time that half of them stay below, milliseconds; NaN of none.
    #[must_use]
    pub fn median_ms(&self) -> f64 {
        let mut ascending = self.milliseconds.clone();
        ascending.sort_by(f64::total_cmp);
        ascending.get(ascending.len() / 2).copied().unwrap_or(f64::NAN)
    }

    /// The mean, milliseconds; NaN of none.
    #[must_use]
    pub fn mean_ms(&self) -> f64 {
        self.milliseconds.iter().sum::<f64>() / self.milliseconds.len() as f64
    }
}
