//! What holds of the simulator as a whole, told from outside: its world, its plant, its senses, its truth.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

mod bodies;
mod office;
mod oracle;
mod plant;
mod rays;
mod robot;
mod scene;
mod truth;
