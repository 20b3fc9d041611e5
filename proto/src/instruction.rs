//! What people say to the robot, and what it answers.

use rules::Reply;
use serde::{Deserialize, Serialize};

use crate::codec::{DecodeError, Encoding, Invalid, Message};

/// Longest instruction, bytes, in either form.
pub const N_INSTRUCTION_BYTES_MAX: usize = 8 * 1024;

/// One utterance, as the `instruction` key carries it: plain UTF-8 text, or a JSON object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Instruction {
    /// The words.
    pub text: String,
    /// Who said them.
    #[serde(default)]
    pub speaker: String,
    /// The sender's own handle, given back in the reply; made up by the service when empty.
    #[serde(default)]
    pub id: String,
    /// Id of the question that this answers, if it answers one.
    #[serde(default)]
    pub answers: String,
}

impl Instruction {
    /// Just words.
    #[must_use]
    pub fn plain(text: &str) -> Self {
        Instruction {
            text: text.to_owned(),
            speaker: String::new(),
            id: String::new(),
            answers: String::new(),
        }
    }

    /// The instruction in a payload: JSON when it is a JSON object, else the text itself.
    ///
    /// # Errors
    /// [`DecodeError`] when it is too long, not UTF-8, empty, holds control characters, or is a JSON
    /// object that is no instruction.
    pub fn from_payload(bytes: &[u8]) -> Result<Self, DecodeError> {
        let name = Self::NAME;
        if bytes.len() > N_INSTRUCTION_BYTES_MAX {
            let (n_bytes, n_bytes_max) = (bytes.len(), N_INSTRUCTION_BYTES_MAX);
            return Err(DecodeError::Oversized { name, n_bytes, n_bytes_max });
        }
        let text = std::str::from_utf8(bytes)
            .map_err(|e| DecodeError::Malformed { name, reason: format!("not UTF-8: {e}") })?
            .trim();
        if text.starts_with('{') {
            return crate::codec::decode(text.as_bytes());
        }
        let instruction = Instruction::plain(text);
        instruction.check().map_err(|invalid| DecodeError::Invalid { name, invalid })?;
        Ok(instruction)
    }
}

impl Message for Instruction {
    const NAME: &'static str = "Instruction";
    const ENCODING: Encoding = Encoding::Json;
    const N_BYTES_MAX: usize = N_INSTRUCTION_BYTES_MAX;

    fn check(&self) -> Result<(), Invalid> {
        if self.text.trim().is_empty() {
            return Err(Invalid::new("text", "empty", "at least one word"));
        }
        for (field, value, n_max) in [
            ("text", &self.text, rules::rule::TEXT_CHARS_MAX),
            ("speaker", &self.speaker, 120),
            ("id", &self.id, 120),
            ("answers", &self.answers, 120),
        ] {
            let n_chars = value.chars().count();
            if n_chars > n_max {
                let found = format!("{n_chars} characters");
                return Err(Invalid::new(field, found, format_args!("at most {n_max}")));
            }
            let is_odd = |c: char| c.is_control() && !c.is_whitespace();
            if let Some(odd) = value.chars().find(|c| is_odd(*c)) {
                let found = format!("holding control character U+{:04X}", u32::from(odd));
                return Err(Invalid::new(field, found, "printable"));
            }
        }
        Ok(())
    }
}

/// What the language service made of one instruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstructionReply {
    /// The instruction's id.
    pub id: String,
    /// Who had said it.
    #[serde(default)]
    pub speaker: String,
    /// The words, as understood to have been said.
    pub text: String,
    /// The outcome.
    pub reply: Reply,
    /// Version of the rule set after this reply; rules are durable before this is sent.
    pub rules_version: u64,
}

impl Message for InstructionReply {
    const NAME: &'static str = "InstructionReply";
    const ENCODING: Encoding = Encoding::Json;
    const N_BYTES_MAX: usize = 256 * 1024;

    fn check(&self) -> Result<(), Invalid> {
        self.reply.specs.iter().try_for_each(crate::rule_set::check_rule)
    }
}
