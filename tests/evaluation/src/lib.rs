//! The evaluation: any scene, any method, as fast as the machine can, judged by the simulator's ground truth.
//!
//! The deciders are those of the services; what is here is what the processes and the network are
//! otherwise: one thread, one simulated clock ([`system`]), a robot that senses when it is asked
//! ([`stepped_robot`]) and a host for the models ([`model_host`]). [`trial`] plays one run, [`judge`] watches it,
//! [`outcome`] names what came of it. Deliberately not here: anything that decides how the robot moves.

pub mod chart;
pub mod check;
pub mod command;
pub mod condition;
pub mod course;
pub mod generate;
pub mod judge;
pub mod language;
pub mod model_host;
pub mod outcome;
pub mod picture;
pub mod processes;
pub mod progress;
pub mod setup;
pub mod stepped_robot;
pub mod suite;
pub mod summary;
pub mod system;
pub mod trace;
pub mod trial;
pub mod zone;

pub use command::run;
