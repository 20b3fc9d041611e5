//! The decider under a fake clock, driving a toy robot to its goal.

mod bench;
mod driving;
mod waiting;
