//! What a robot is, and the loop that drives hardware and simulation alike.
//!
//! A [`Robot`] senses and actuates; the [`keeper`] holds the last safe command and asks the envelope what
//! the motors may have; [`drive`] runs both against the bus. Whether the robot is real is known to its
//! own type and nobody else.

pub mod drive;
pub mod keeper;
pub mod robot;

pub use drive::{DriveSettings, drive};
pub use keeper::{Keeper, Kept};
pub use robot::{BaseState, Robot, Senses};
