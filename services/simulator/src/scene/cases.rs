//! The `cases` of a scene: what is said, and what the ground truth then judges.

use rules::{Relation, RuleType};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use super::node::Node;
use super::{Object, SceneError};

/// Something that may be said in this scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Which sort of instruction it is.
    pub kind: String,
    /// The words.
    pub say: String,
    /// What they mean here; empty when they mean no rule.
    pub rules: Vec<CaseRule>,
    /// Why anybody would say it.
    pub why_it_matters: String,
    /// Keys that this program does not know.
    pub extra: Map<String, Value>,
}

/// One rule that a run is judged by.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseRule {
    /// Exclusion or kinematic.
    pub rule_type: RuleType,
    /// Region around the objects.
    pub relation: Relation,
    /// The class noun.
    pub obj: String,
    /// Ids of the objects that are meant; empty when the rule is global or nothing of the kind is there.
    pub objects: Vec<String>,
    /// Metres between hull and object.
    pub buffer_m: f64,
    /// Speed limit, m/s.
    pub speed_m_s_max: Option<f64>,
    /// Turn rate limit, rad/s.
    pub yaw_rate_rad_s_max: Option<f64>,
    /// The range that a reading of vague words may take, as the file gives it.
    pub accept: Option<Value>,
    /// Keys that this program does not know.
    pub extra: Map<String, Value>,
}

impl CaseRule {
    /// The least buffer that a reading of the words may take, metres.
    #[must_use]
    pub fn least_buffer_m(&self) -> f64 {
        self.accepted("buffer_m", 0).unwrap_or(self.buffer_m)
    }

    /// The highest speed limit that a reading of the words may take, m/s.
    #[must_use]
    pub fn highest_speed_m_s(&self) -> Option<f64> {
        self.accepted("vel_max", 1).or(self.speed_m_s_max)
    }

    /// The highest limit of the turn rate that a reading of the words may take, rad/s.
    #[must_use]
    pub fn highest_yaw_rate_rad_s(&self) -> Option<f64> {
        self.accepted("ang_vel_max", 1).or(self.yaw_rate_rad_s_max)
    }

    /// One end of the range that the case accepts for a number: 0 is the low end, 1 the high one.
    fn accepted(&self, key: &str, end: usize) -> Option<f64> {
        self.accept.as_ref()?.get(key)?.get(end)?.as_f64()
    }
}

/// The cases of a scene.
///
/// # Errors
/// [`SceneError`] names the field; ids of objects that are not in the scene are errors too.
pub(super) fn read(root: &Node<'_>, objects: &[Object]) -> Result<Vec<Case>, SceneError> {
    root.items_of("cases", 1000)?
        .iter()
        .map(|node| {
            let rules = node.items_of("rules", 100)?;
            Ok(Case {
                kind: node.text_or_empty("kind")?,
                say: node.get("say")?.text(rules::rule::TEXT_CHARS_MAX)?,
                rules: rules.iter().map(|rule| read_rule(rule, objects)).collect::<Result<_, _>>()?,
                why_it_matters: node.text_or_empty("why_it_matters")?,
                extra: node.others(&["kind", "say", "rules", "why_it_matters"])?,
            })
        })
        .collect()
}

fn read_rule(node: &Node<'_>, objects: &[Object]) -> Result<CaseRule, SceneError> {
    let limit = |key| node.find(key)?.map(|n: Node<'_>| n.number(0.0, 100.0)).transpose();
    let mut ids = Vec::new();
    for item in node.items_of("objects", super::N_OBJECTS_MAX)? {
        let id = item.name()?;
        if !objects.iter().any(|o| o.id == id) {
            return Err(item.fail(format_args!("is {id:?}, there is no object with this id")));
        }
        ids.push(id);
    }
    Ok(CaseRule {
        rule_type: word(&node.get("type")?)?,
        relation: word(&node.get("relation")?)?,
        obj: node.text_or_empty("obj")?,
        objects: ids,
        buffer_m: limit("buffer_m")?.unwrap_or(0.0),
        speed_m_s_max: limit("vel_max")?,
        yaw_rate_rad_s_max: limit("ang_vel_max")?,
        accept: node.find("accept")?.map(|n| n.value().clone()),
        extra: node.others(&[
            "type",
            "relation",
            "obj",
            "objects",
            "buffer_m",
            "vel_max",
            "ang_vel_max",
            "accept",
        ])?,
    })
}

/// A word of a closed set.
fn word<T: DeserializeOwned>(node: &Node<'_>) -> Result<T, SceneError> {
    T::deserialize(node.value()).map_err(|e| node.fail(e))
}
