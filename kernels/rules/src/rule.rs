//! What a rule is: the closed set of things a robot can be told to heed.
//!
//! On the wire a rule is called *spec*, as in the paper; the field names below are the wire's.

use geometry::Pose2;

/// Largest distance a rule may name, metres.
pub const BUFFER_M_MAX: f64 = 5.0;
/// Most characters in a name or a referring phrase.
pub const NAME_CHARS_MAX: usize = 120;
/// Most characters in the words a rule came from.
pub const TEXT_CHARS_MAX: usize = 2000;

/// Where the robot may not be, or how fast it may move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum RuleType {
    /// The robot may not be in the region.
    Exclusion,
    /// The robot may not be faster than the limits in the region.
    Kinematic,
}

/// Which region around the object a rule speaks of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(rename_all = "snake_case"))]
pub enum Relation {
    /// Within `buffer_m` of the object.
    Near,
    /// Over the object's own footprint or area.
    On,
    /// Under the object.
    Beneath,
    /// In the gap between `obj` and `obj2`.
    Between,
    /// Past the object, seen from the anchor.
    Beyond,
    /// On the object's left, seen from the anchor.
    LeftOf,
    /// On the object's right, seen from the anchor.
    RightOf,
    /// On the near side of the object, seen from the anchor.
    FrontOf,
    /// On the far side of the object, seen from the anchor.
    Behind,
    /// Everywhere; needs no object.
    Global,
}

impl Relation {
    /// Whether the region depends on where the robot stood when the rule was accepted.
    #[must_use]
    pub fn needs_anchor(self) -> bool {
        use Relation::{Behind, Beyond, FrontOf, LeftOf, RightOf};
        matches!(self, Beyond | LeftOf | RightOf | FrontOf | Behind)
    }
}

/// One rule the robot heeds.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct Rule {
    /// Handle to revoke or change it: `s1`, `s2`, …; given by the service, never reused.
    #[cfg_attr(feature = "serde", serde(default))]
    pub id: String,
    /// Exclusion or kinematic.
    #[cfg_attr(feature = "serde", serde(rename = "type"))]
    pub rule_type: RuleType,
    /// Region around the object.
    pub relation: Relation,
    /// Class noun, lower case, singular ("coffee table"); empty only when global.
    #[cfg_attr(feature = "serde", serde(default))]
    pub obj: String,
    /// Second landmark; only with `between`.
    #[cfg_attr(feature = "serde", serde(default))]
    pub obj2: Option<String>,
    /// The whole referring phrase as spoken: what an open-vocabulary detector is asked for.
    #[cfg_attr(feature = "serde", serde(default, rename = "ref"))]
    pub reference: String,
    /// Instances or regions let off the rule.
    #[cfg_attr(feature = "serde", serde(default))]
    pub except: Vec<String>,
    /// Metres between the hull and the object's edge, 0 to 5.
    #[cfg_attr(feature = "serde", serde(default))]
    pub buffer_m: f64,
    /// Speed limit, m/s; none when absent; 0 is to stand still.
    #[cfg_attr(feature = "serde", serde(default))]
    pub vel_max: Option<f64>,
    /// Turn rate limit, rad/s; none when absent.
    #[cfg_attr(feature = "serde", serde(default))]
    pub ang_vel_max: Option<f64>,
    /// Lifetime from acceptance, seconds; until revoked when absent.
    #[cfg_attr(feature = "serde", serde(default))]
    pub ttl_s: Option<u64>,
    /// Numeric fields that were filled in and not said.
    #[cfg_attr(feature = "serde", serde(default))]
    pub defaults: Vec<String>,
    /// The robot's pose in `map` when the rule was accepted, as [x, y, yaw].
    #[cfg_attr(feature = "serde", serde(default))]
    pub anchor: Option<[f64; 3]>,
    /// The words this rule came from.
    #[cfg_attr(feature = "serde", serde(default))]
    pub text: String,
    /// Who parsed it: `offline` or `llm:<model>`.
    #[cfg_attr(feature = "serde", serde(default))]
    pub parser: String,
}

impl Rule {
    /// An exclusion of the region around `obj`, with nothing else said.
    #[must_use]
    pub fn exclusion(relation: Relation, obj: &str) -> Rule {
        Rule {
            id: String::new(),
            rule_type: RuleType::Exclusion,
            relation,
            obj: obj.to_owned(),
            obj2: None,
            reference: obj.to_owned(),
            except: Vec::new(),
            buffer_m: 0.0,
            vel_max: None,
            ang_vel_max: None,
            ttl_s: None,
            defaults: Vec::new(),
            anchor: None,
            text: String::new(),
            parser: String::new(),
        }
    }

    /// A limit in the region around `obj`; invalid until one of the two limits is given.
    #[must_use]
    pub fn kinematic(relation: Relation, obj: &str) -> Rule {
        Rule { rule_type: RuleType::Kinematic, ..Rule::exclusion(relation, obj) }
    }

    /// Whether the rule speaks of an object that has to be found.
    #[must_use]
    pub fn needs_grounding(&self) -> bool {
        self.relation != Relation::Global
    }

    /// The pose of the robot in `map` when the rule was accepted.
    #[must_use]
    pub fn map_from_anchor(&self) -> Option<Pose2> {
        self.anchor.map(|[x_m, y_m, yaw_rad]| Pose2::new(x_m, y_m, yaw_rad))
    }

    /// The phrase to look for: the whole reference, else the class noun.
    #[must_use]
    pub fn phrase(&self) -> &str {
        if self.reference.is_empty() { &self.obj } else { &self.reference }
    }
}
