//! How a process lives. A service is one function: `async fn serve(life: Life, settings: S) -> Result`.
//!
//! ```text
//! fn main() -> ExitCode { service::run("heedway-filter", heedway_filter::serve) }
//! ```
//!
//! [`run`] reads the configuration, starts the logs, opens the session, declares liveliness, serves until
//! SIGTERM or SIGINT, drains, and gives the exit code. Deliberately not here: anything a service decides.

pub mod bus;
pub mod clock;
pub mod config;
pub mod health;
pub mod inbox;
pub mod life;
pub mod priority;
pub mod realtime;
pub mod session;

pub use bus::{Bus, PeerChange, Publisher, Question, Received};
pub use clock::Clock;
pub use config::{ConfigError, Settings};
pub use health::Counters;
pub use inbox::{Inbox, Slot};
pub use life::{Life, run, run_with};
