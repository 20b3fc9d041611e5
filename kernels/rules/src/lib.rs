//! The closed set of rules, their checks, and canonical English to read back.

pub mod check;
pub mod english;
pub mod reply;
pub mod rule;
#[cfg(feature = "schema")]
pub mod schema;
pub mod template;
pub mod tighten;

pub use check::RuleError;
pub use reply::{Outcome, RefuseReason, Reply, ReplyOption};
pub use rule::{Relation, Rule, RuleType};
pub use template::FiveFields;
