//! What a language model is asked to write, as types, and their JSON Schema for strict output.
//!
//! It is [`Reply`](crate::Reply) less what a model must never set: ids, the text, the parser's name,
//! the anchor, and replies behind options (the service parses the picked label anew). Strict output
//! wants every key required and nothing recursive, so the draft is its own type. Ranges are not in
//! the schema: the model's numbers are parsed first, then [`Rule::check`] judges them.

use schemars::generate::SchemaSettings;
use schemars::transform::RecursiveTransform;

use crate::{Outcome, RefuseReason, Relation, Rule, RuleType};

/// A reply as a language model writes it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DraftReply {
    /// What the utterance led to.
    pub outcome: Outcome,
    /// New rules; at least one when accepted, else none.
    pub specs: Vec<DraftRule>,
    /// Ids of active rules that are replaced or lifted.
    pub revoked: Vec<String>,
    /// The question, when clarifying.
    pub question: Option<String>,
    /// Up to four answers to offer, when clarifying.
    pub options: Vec<DraftOption>,
    /// Why, when refusing.
    pub reason: Option<RefuseReason>,
    /// One or two short sentences to the person.
    pub say: String,
}

/// An answer to offer: its words only.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DraftOption {
    /// What the person reads, worded so that it can be parsed as their answer.
    pub label: String,
}

/// A rule as a language model writes it.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DraftRule {
    /// Where the robot may not be, or how fast it may move.
    #[serde(rename = "type")]
    pub rule_type: RuleType,
    /// Region around the object.
    pub relation: Relation,
    /// Class noun, lower case, singular, no article; empty only when global.
    pub obj: String,
    /// Second landmark; only with between.
    pub obj2: Option<String>,
    /// The whole referring phrase as spoken.
    #[serde(rename = "ref")]
    pub reference: String,
    /// Instances or regions let off the rule.
    pub except: Vec<String>,
    /// Metres from the object's edge.
    pub buffer_m: f64,
    /// Speed limit, m/s.
    pub vel_max: Option<f64>,
    /// Turn rate limit, rad/s.
    pub ang_vel_max: Option<f64>,
    /// Lifetime, whole seconds.
    pub ttl_s: Option<u64>,
    /// Numeric fields that were filled in and not said.
    pub defaults: Vec<String>,
}

impl DraftRule {
    /// The rule, not yet checked, with the words it came from and who parsed it.
    #[must_use]
    pub fn into_rule(self, text: &str, parser: &str) -> Rule {
        let reference = if self.reference.trim().is_empty() { self.obj.clone() } else { self.reference };
        Rule {
            id: String::new(),
            rule_type: self.rule_type,
            relation: self.relation,
            obj: self.obj,
            obj2: self.obj2,
            reference,
            except: self.except,
            buffer_m: self.buffer_m,
            vel_max: self.vel_max,
            ang_vel_max: self.ang_vel_max,
            ttl_s: self.ttl_s,
            defaults: self.defaults,
            anchor: None,
            text: text.to_owned(),
            parser: parser.to_owned(),
        }
    }
}

/// Only what strict output of the common servers takes: plain enums, no number formats or ranges.
fn to_strict(schema: &mut schemars::Schema) {
    for key in ["format", "minimum", "maximum"] {
        schema.remove(key);
    }
    let names = schema.get("oneOf").and_then(|list| {
        list.as_array()?.iter().map(|entry| entry.get("const").cloned()).collect::<Option<Vec<_>>>()
    });
    if let Some(names) = names {
        schema.remove("oneOf");
        schema.insert("type".into(), "string".into());
        schema.insert("enum".into(), names.into());
    }
}

/// The JSON Schema of [`DraftReply`]: all keys required, no other keys, no references.
#[must_use]
pub fn draft_reply_schema() -> schemars::Schema {
    let settings = SchemaSettings::draft2020_12().for_serialize().with(|settings| {
        settings.inline_subschemas = true;
        settings.transforms.push(Box::new(RecursiveTransform(to_strict)));
    });
    settings.into_generator().into_root_schema_for::<DraftReply>()
}
