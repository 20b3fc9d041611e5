//! The decider under a fake clock, driving a toy robot whose every input can be silenced.

mod bench;
mod fail_safe;
mod laws;
mod restart;
mod ticks;
mod zone;
