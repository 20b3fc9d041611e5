//! How long this host has been up, and since which start: a clock that nobody can set.

use serde::{Deserialize, Serialize};

/// The steps of [`BootClock::read`], milliseconds.
pub const STEP_MS: u64 = 10;

/// A moment by the host's own clock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BootClock {
    /// Names this start of the host; another after each.
    pub boot_id: String,
    /// Since that start, sleep included, milliseconds.
    pub uptime_ms: u64,
}

impl BootClock {
    /// Now; none on a host that does not tell.
    #[must_use]
    pub fn read() -> Option<BootClock> {
        let boot_id = std::fs::read_to_string("/proc/sys/kernel/random/boot_id").ok()?;
        let uptime = std::fs::read_to_string("/proc/uptime").ok()?;
        BootClock::of(&boot_id, &uptime)
    }

    fn of(boot_id: &str, uptime: &str) -> Option<BootClock> {
        let uptime_s: f64 = uptime.split_whitespace().next()?.parse().ok()?;
        let boot_id = boot_id.trim();
        let is_sound = !boot_id.is_empty() && boot_id.len() <= 64 && (0.0..1e12).contains(&uptime_s);
        is_sound
            .then(|| BootClock { boot_id: boot_id.to_owned(), uptime_ms: (uptime_s * 1e3).round() as u64 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_of_the_kernel_are_read_and_odd_ones_are_none() {
        let found = BootClock::of("b7a1\n", "350735.47 234388.90\n").unwrap();
        assert_eq!((found.boot_id.as_str(), found.uptime_ms), ("b7a1", 350_735_470));
        for (boot_id, uptime) in [("", "1.0 1.0"), ("b7a1", ""), ("b7a1", "nan"), ("b7a1", "-3.0 1")] {
            assert_eq!(BootClock::of(boot_id, uptime), None, "{boot_id:?} {uptime:?}");
        }
    }
}
