//! The five-field template of the paper, both ways.
//!
//! The template knows an object, a distance and two limits, and no relation, lifetime or exception:
//! going there loses those, coming back fills them with what the fields imply. It is for exchange
//! with the published work; inside the system only [`Rule`] is used.

use geometry::Profile;

use crate::{Relation, Rule, RuleType};

/// A specification in the five fields of the paper, under its keys or those of [`Rule`]; any may be missing.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(deny_unknown_fields))]
pub struct FiveFields {
    /// Exclusion or kinematic; implied by the limits when absent.
    #[cfg_attr(feature = "serde", serde(default, rename = "type", skip_serializing_if = "Option::is_none"))]
    pub rule_type: Option<RuleType>,
    /// The referring phrase; empty for everywhere.
    #[cfg_attr(feature = "serde", serde(default))]
    pub obj: String,
    /// Metres from the object.
    #[cfg_attr(feature = "serde", serde(default, alias = "buffer_m"))]
    pub buffer: f64,
    /// Speed limit, m/s; the robot's own when it is not limited.
    #[cfg_attr(
        feature = "serde",
        serde(default, rename = "vel max", alias = "vel_max", skip_serializing_if = "Option::is_none")
    )]
    pub vel_max: Option<f64>,
    /// Turn rate limit, rad/s; the robot's own when it is not limited.
    #[cfg_attr(
        feature = "serde",
        serde(
            default,
            rename = "angular vel max",
            alias = "ang_vel_max",
            skip_serializing_if = "Option::is_none"
        )
    )]
    pub ang_vel_max: Option<f64>,
}

impl FiveFields {
    /// The five fields of a rule on a robot of this profile.
    #[must_use]
    pub fn from_rule(rule: &Rule, profile: &Profile) -> FiveFields {
        FiveFields {
            rule_type: Some(rule.rule_type),
            obj: rule.phrase().to_owned(),
            buffer: rule.buffer_m,
            vel_max: Some(rule.vel_max.unwrap_or(profile.speed_m_s_max)),
            ang_vel_max: Some(rule.ang_vel_max.unwrap_or(profile.yaw_rate_rad_s_max)),
        }
    }

    /// The rule that the five fields mean; [`Rule::check`] still has to pass it.
    ///
    /// A limit at or above the robot's own limits nothing and is left out, except that a value
    /// above it stays for the check to name. Without a type it is kinematic when a limit is below
    /// the robot's. The relation is `global` without an object, else `near`.
    #[must_use]
    pub fn into_rule(self, profile: &Profile) -> Rule {
        // `!=` keeps NaN and values above the robot's, so that the check refuses them.
        let vel_max = self.vel_max.filter(|v| *v != profile.speed_m_s_max);
        let ang_vel_max = self.ang_vel_max.filter(|w| *w != profile.yaw_rate_rad_s_max);
        let rule_type = self.rule_type.unwrap_or(if vel_max.is_some() || ang_vel_max.is_some() {
            RuleType::Kinematic
        } else {
            RuleType::Exclusion
        });
        let relation = if self.obj.trim().is_empty() { Relation::Global } else { Relation::Near };
        Rule {
            rule_type,
            buffer_m: self.buffer,
            vel_max,
            ang_vel_max,
            ..Rule::kinematic(relation, &self.obj)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_missing_type_follows_from_the_limits_and_a_missing_relation_from_the_object() {
        let profile = Profile::sim();
        let near =
            FiveFields { rule_type: None, obj: "car".into(), buffer: 0.25, vel_max: None, ang_vel_max: None };
        let rule = near.clone().into_rule(&profile);
        assert_eq!((rule.rule_type, rule.relation), (RuleType::Exclusion, Relation::Near));
        let slow = FiveFields { obj: String::new(), vel_max: Some(0.5), ..near }.into_rule(&profile);
        assert_eq!(
            (slow.rule_type, slow.relation, slow.vel_max),
            (RuleType::Kinematic, Relation::Global, Some(0.5))
        );
    }

    #[test]
    fn a_limit_above_the_robots_is_left_for_the_check_to_refuse() {
        let profile = Profile::sim();
        let fast = FiveFields {
            rule_type: None,
            obj: String::new(),
            buffer: 0.0,
            vel_max: Some(9.0),
            ang_vel_max: None,
        };
        assert!(fast.into_rule(&profile).check(&profile).is_err());
    }

    #[cfg(feature = "serde")]
    #[test]
    fn the_keys_are_those_of_the_paper() {
        let text = r#"{"type":"exclusion","obj":"pool","buffer":0.5,"vel max":1.5,"angular vel max":1.0}"#;
        let five: FiveFields = serde_json::from_str(text).unwrap();
        let rule = five.clone().into_rule(&Profile::sim());
        assert_eq!(rule.check(&Profile::sim()), Ok(()));
        assert_eq!(FiveFields::from_rule(&rule, &Profile::sim()), five);
        assert_eq!(serde_json::to_string(&five).unwrap(), text);
    }

    proptest! {
        #[test]
        fn what_the_template_can_hold_survives_the_way_there_and_back(
            buffer_m in 0.0..5.0f64, speed in proptest::option::of(0.0..1.4f64), global in any::<bool>(),
        ) {
            let profile = Profile::sim();
            let rule = match (speed, global) {
                (Some(v), true) => Rule { vel_max: Some(v), ..Rule::kinematic(Relation::Global, "") },
                (Some(v), false) => Rule { vel_max: Some(v), buffer_m, ..Rule::kinematic(Relation::Near, "bed") },
                (None, _) => Rule { buffer_m, ..Rule::exclusion(Relation::Near, "bed") },
            };
            prop_assert_eq!(FiveFields::from_rule(&rule, &profile).into_rule(&profile), rule);
        }
    }
}
