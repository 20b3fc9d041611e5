//! The whole system as real processes on real zenoh: killed, restarted, lied to, and spoken to.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

mod process {
    mod demo;
    mod garbage;
    mod kill;
    mod words;
}
