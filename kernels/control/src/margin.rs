//! What the filter must heed: the layers of the base margin, and the demands of the rules.
//!
//! A margin is a signed slack: metres from the hull for the spatial ones, m/s and rad/s below a limit for
//! the kinematic ones. The set is violated where a margin is at or below zero. Fields hold distances to
//! *obstacles*: the radius is subtracted here, once. Deliberately not here: where fields come from.

use std::sync::Arc;

use geometry::Point2;
use mapping::DistanceField;
use rules::{Relation, Rule, RuleType};

/// Everything the filter heeds at one tick, in `map`.
#[derive(Clone, Debug, Default)]
pub struct World {
    /// Obstacles as fields: the base map, obstacles seen in depth.
    pub base: Vec<BaseLayer>,
    /// Hits of the live scan, each an obstacle of its own; a few hundred.
    pub points: Vec<Point2>,
    /// The rules in force; their order does not matter.
    pub rules: Vec<RuleLayer>,
}

/// One layer of obstacles.
#[derive(Clone, Debug)]
pub struct BaseLayer {
    /// What the operator reads: "the map", "seen in depth".
    pub name: String,
    /// Signed distance to the obstacles, never above the true one; no radius subtracted.
    pub field: Arc<DistanceField>,
}

/// One rule, grounded.
#[derive(Clone, Debug)]
pub struct RuleLayer {
    /// The rule's id: `s1`.
    pub id: String,
    /// The object as the operator reads it: "the crib".
    pub label: String,
    /// What the rule asks.
    pub demand: Demand,
}

/// What a rule asks of the motion.
#[derive(Clone, Debug)]
pub enum Demand {
    /// Keep the hull farther than `buffer_m` from the zone.
    Exclusion {
        /// Signed distance to the zone, never above the true one.
        zone: Arc<DistanceField>,
        /// Distance to keep between hull and zone, metres.
        buffer_m: f64,
    },
    /// Keep within the limits while the hull is within `buffer_m` of the zone, or everywhere.
    ///
    /// A speed limit of exactly 0 in a zone means: do not go in. Who is in when told stands still.
    Limit {
        /// Signed distance to the zone; everywhere when `None`.
        zone: Option<Arc<DistanceField>>,
        /// How near the hull counts as in the zone, metres.
        buffer_m: f64,
        /// Largest speed, m/s.
        speed_m_s_max: Option<f64>,
        /// Largest turn rate either way, rad/s.
        yaw_rate_rad_s_max: Option<f64>,
    },
    /// The cap while a rule's object has not been found yet: "looking for the crib, going slowly".
    SpeedCap {
        /// Largest speed anywhere, m/s.
        speed_m_s_max: f64,
    },
}

/// A rule that makes no demand on motion.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DemandError {
    /// The rule speaks of a region, and none was given: the rule is not grounded.
    #[error("rule {0} has no grounded zone")]
    NotGrounded(String),
    /// An exclusion from everywhere.
    #[error("rule {0} excludes everywhere")]
    ExcludesEverywhere(String),
    /// A kinematic rule without a limit.
    #[error("rule {0} is kinematic and limits neither speed nor turn rate")]
    NoLimit(String),
    /// A number outside its range.
    #[error("rule {id}: {key} = {value}, must be finite and at least 0")]
    Range {
        /// The rule.
        id: String,
        /// The field.
        key: &'static str,
        /// The value found.
        value: f64,
    },
}

impl Demand {
    /// What a rule asks, with `zone` the field of its region (for `near`, of the object itself).
    ///
    /// # Errors
    /// [`DemandError`] when the rule needs a zone and there is none, or its numbers make no sense.
    pub fn from_rule(rule: &Rule, zone: Option<Arc<DistanceField>>) -> Result<Demand, DemandError> {
        let numbers =
            [("buffer_m", Some(rule.buffer_m)), ("vel_max", rule.vel_max), ("ang_vel_max", rule.ang_vel_max)];
        for (key, value) in numbers {
            if let Some(value) = value.filter(|v| !(v.is_finite() && *v >= 0.0)) {
                return Err(DemandError::Range { id: rule.id.clone(), key, value });
            }
        }
        let global = rule.relation == Relation::Global;
        if !global && zone.is_none() {
            return Err(DemandError::NotGrounded(rule.id.clone()));
        }
        match (rule.rule_type, zone) {
            (RuleType::Exclusion, Some(zone)) if !global => {
                Ok(Demand::Exclusion { zone, buffer_m: rule.buffer_m })
            }
            (RuleType::Exclusion, _) => Err(DemandError::ExcludesEverywhere(rule.id.clone())),
            (RuleType::Kinematic, zone) => {
                if rule.vel_max.is_none() && rule.ang_vel_max.is_none() {
                    return Err(DemandError::NoLimit(rule.id.clone()));
                }
                Ok(Demand::Limit {
                    zone: zone.filter(|_| !global),
                    buffer_m: if global { 0.0 } else { rule.buffer_m },
                    speed_m_s_max: rule.vel_max,
                    yaw_rate_rad_s_max: rule.ang_vel_max,
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapping::{Layout, Shape};

    fn zone() -> Arc<DistanceField> {
        let shape = Shape { n_cols: 2, n_rows: 2 };
        let layout = Layout::new(Point2::origin(), 0.05, shape).unwrap();
        Arc::new(DistanceField::from_values(layout, vec![1.0; 4]).unwrap())
    }

    fn rule(rule_type: RuleType, relation: Relation, vel_max: Option<f64>) -> Rule {
        Rule {
            id: "s1".into(),
            rule_type,
            relation,
            obj: "crib".into(),
            obj2: None,
            reference: String::new(),
            except: vec![],
            buffer_m: 0.5,
            vel_max,
            ang_vel_max: None,
            ttl_s: None,
            defaults: vec![],
            anchor: None,
            text: String::new(),
            parser: String::new(),
        }
    }

    #[test]
    fn each_kind_of_rule_becomes_its_demand() {
        let avoid = rule(RuleType::Exclusion, Relation::Near, None);
        assert!(matches!(
            Demand::from_rule(&avoid, Some(zone())),
            Ok(Demand::Exclusion { buffer_m: 0.5, .. })
        ));
        let slow = rule(RuleType::Kinematic, Relation::Near, Some(0.2));
        assert!(matches!(
            Demand::from_rule(&slow, Some(zone())),
            Ok(Demand::Limit { zone: Some(_), buffer_m: 0.5, speed_m_s_max: Some(0.2), .. })
        ));
        let everywhere = rule(RuleType::Kinematic, Relation::Global, Some(0.2));
        assert!(matches!(
            Demand::from_rule(&everywhere, None),
            Ok(Demand::Limit { zone: None, buffer_m: 0.0, .. })
        ));
    }

    #[test]
    fn a_rule_without_its_zone_is_not_grounded_and_never_empty() {
        let avoid = rule(RuleType::Exclusion, Relation::Beneath, None);
        let error = Demand::from_rule(&avoid, None).unwrap_err();
        assert_eq!(error, DemandError::NotGrounded("s1".into()));
    }

    #[test]
    fn rules_that_make_no_sense_are_refused() {
        let nan = rule(RuleType::Kinematic, Relation::Near, Some(f64::NAN));
        assert!(matches!(
            Demand::from_rule(&nan, Some(zone())),
            Err(DemandError::Range { key: "vel_max", .. })
        ));
        let none = rule(RuleType::Kinematic, Relation::Global, None);
        assert!(matches!(Demand::from_rule(&none, None), Err(DemandError::NoLimit(_))));
        let all = rule(RuleType::Exclusion, Relation::Global, None);
        assert!(matches!(Demand::from_rule(&all, None), Err(DemandError::ExcludesEverywhere(_))));
    }
}
