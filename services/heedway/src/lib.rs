//! The operator's command, `heedway`: talk to a robot, watch it, and run the demonstration.
//!
//! It also carries every service (`heedway service filter --config …`), so that one build runs the
//! whole system, and [`fleet`] starts that system as separate processes. Deliberately not here: anything
//! that decides how a robot moves or what a rule means; only public topics are used.

pub mod audit;
pub mod bench;
pub mod board;
pub mod carry;
pub mod command;
pub mod connection;
pub mod demo;
pub mod drawing;
pub mod fleet;
pub mod ground;
pub mod hearing;
pub mod models;
pub mod parse;
pub mod record;
pub mod recording;
pub mod rules_file;
pub mod rules_list;
pub mod say;
pub mod slam;
pub mod terminal;
pub mod watch;

pub use command::run;
