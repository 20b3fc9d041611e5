//! What comes back for an utterance: a change of the rules, a question, or a refusal.

use crate::Rule;

/// What an utterance led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Outcome {
    /// New rules, perhaps in place of others.
    Accept,
    /// A question back; nothing changed.
    Clarify,
    /// Nothing to heed, or something that must not be done; nothing changed.
    Refuse,
    /// Rules lifted.
    Revoke,
}

/// Why an utterance was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum RefuseReason {
    /// A task, chat or question: nothing about safety.
    NotSafety,
    /// It would loosen the base safety.
    Unsafe,
    /// It cannot be said in rules: counting, ordering, history, minimum speeds.
    Unsupported,
}

/// One answer to pick, with what picking it leads to.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct ReplyOption {
    /// What the person reads.
    pub label: String,
    /// The reply that holds once it is picked.
    pub reply: Reply,
}

/// One utterance in, one reply out. It never commands motion and never loosens the base safety.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Reply {
    /// What the utterance led to.
    pub outcome: Outcome,
    /// New rules; at least one when accepted, else none.
    #[cfg_attr(feature = "serde", serde(default))]
    pub specs: Vec<Rule>,
    /// Ids of the rules replaced or lifted.
    #[cfg_attr(feature = "serde", serde(default))]
    pub revoked: Vec<String>,
    /// The question, when clarifying.
    #[cfg_attr(feature = "serde", serde(default))]
    pub question: Option<String>,
    /// Zero to four answers to pick, when clarifying.
    #[cfg_attr(feature = "serde", serde(default))]
    pub options: Vec<ReplyOption>,
    /// Why, when refused.
    #[cfg_attr(feature = "serde", serde(default))]
    pub reason: Option<RefuseReason>,
    /// What the robot says; reads back every number.
    #[cfg_attr(feature = "serde", serde(default))]
    pub say: String,
}

impl Reply {
    /// A reply of this outcome with nothing in it yet.
    #[must_use]
    pub fn of(outcome: Outcome) -> Reply {
        Reply {
            outcome,
            specs: Vec::new(),
            revoked: Vec::new(),
            question: None,
            options: Vec::new(),
            reason: None,
            say: String::new(),
        }
    }
}
