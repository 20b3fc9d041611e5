//! Whether a rule was kept: judged from the ground truth alone, never from what the robot believes.
//!
//! A run is judged by the lenient end of what a reading of vague words may take.

use heedway_simulator::scene::{Case, CaseRule};
use proto::Truth;
use rules::{Relation, RuleType};

/// Driving exactly at a limit complies; this much above it does too, m/s and rad/s.
const LIMIT_TOLERANCE: f64 = 0.01;

/// Watches the rules of a case over one run.
#[derive(Clone, Debug, Default)]
pub struct Judge {
    watches: Vec<Watch>,
}

#[derive(Clone, Debug)]
struct Watch {
    rule: CaseRule,
    /// When and how it was broken first.
    broken: Option<String>,
}

/// What the judge found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finding {
    /// Every rule was kept.
    Kept,
    /// At least one was broken: when and how, first.
    Broken(String),
    /// There is nothing to judge by, and why.
    NotJudged(String),
}

impl Judge {
    /// A judge of the rules of a case; without a case nothing can be judged.
    #[must_use]
    pub fn new(case: Option<&Case>) -> Self {
        let rules = case.map(|case| case.rules.as_slice()).unwrap_or_default();
        Judge { watches: rules.iter().map(|rule| Watch { rule: rule.clone(), broken: None }).collect() }
    }

    /// Looks at one moment of the run, `time_s` after its start.
    pub fn see(&mut self, time_s: f64, truth: &Truth) {
        for watch in &mut self.watches {
            if watch.broken.is_none() {
                watch.broken = violation(&watch.rule, truth).map(|how| format!("at {time_s:.1} s {how}"));
            }
        }
    }

    /// What was found so far.
    #[must_use]
    pub fn finding(&self) -> Finding {
        if let Some(how) = self.watches.iter().find_map(|watch| watch.broken.clone()) {
            return Finding::Broken(how);
        }
        if self.watches.is_empty() {
            return Finding::NotJudged("no case of the scene says what these words mean".to_owned());
        }
        match self.watches.iter().find_map(|watch| why_not_judged(&watch.rule)) {
            Some(why) => Finding::NotJudged(why),
            None => Finding::Kept,
        }
    }
}

/// Why distances to objects do not tell whether this rule is kept.
fn why_not_judged(rule: &CaseRule) -> Option<String> {
    match rule.relation {
        Relation::Near | Relation::On | Relation::Beneath if rule.objects.is_empty() => {
            Some("the case names no object".to_owned())
        }
        Relation::Near | Relation::On | Relation::Beneath | Relation::Global => None,
        other => Some(format!("the truth tells distances, not who is {other:?} what")),
    }
}

/// How the rule is violated at this moment.
fn violation(rule: &CaseRule, truth: &Truth) -> Option<String> {
    if why_not_judged(rule).is_some() {
        return None;
    }
    let (object, distance_m) = nearest(rule, truth)?;
    if distance_m > rule.least_buffer_m() {
        return None;
    }
    if rule.rule_type == RuleType::Exclusion {
        return Some(match rule.relation {
            _ if distance_m > 0.0 => format!("{distance_m:.2} m from {object}"),
            Relation::Beneath => format!("under {object}"),
            Relation::On => format!("on {object}"),
            _ => format!("touching {object}"),
        });
    }
    let place = if rule.relation == Relation::Global { String::new() } else { format!(" near {object}") };
    let speed_m_s = truth.twist.speed_m_s.abs();
    if let Some(limit) = rule.highest_speed_m_s()
        && speed_m_s > limit + LIMIT_TOLERANCE
    {
        return Some(format!("{speed_m_s:.2} m/s{place}"));
    }
    let yaw_rate_rad_s = truth.twist.yaw_rate_rad_s.abs();
    if let Some(limit) = rule.highest_yaw_rate_rad_s()
        && yaw_rate_rad_s > limit + LIMIT_TOLERANCE
    {
        return Some(format!("{yaw_rate_rad_s:.2} rad/s{place}"));
    }
    None
}

/// The nearest of the rule's objects and the hull's distance to it, metres; everywhere is at 0 m.
fn nearest(rule: &CaseRule, truth: &Truth) -> Option<(String, f64)> {
    if rule.relation == Relation::Global {
        return Some((String::new(), 0.0_f64.min(rule.buffer_m)));
    }
    let distances =
        truth.objects.iter().filter(|object| rule.objects.contains(&object.id)).filter_map(|object| {
            let distance_m =
                if rule.relation == Relation::Beneath { object.overhead_m? } else { object.any_height_m };
            Some((object.id.clone(), distance_m))
        });
    distances.min_by(|(_, a), (_, b)| a.total_cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{Pose2, Twist};
    use proto::ObjectDistance;

    fn rule(rule_type: RuleType, relation: Relation, buffer_m: f64) -> CaseRule {
        CaseRule {
            rule_type,
            relation,
            obj: "desk".into(),
            objects: vec!["desk-1".into()],
            buffer_m,
            speed_m_s_max: None,
            yaw_rate_rad_s_max: None,
            accept: None,
            extra: serde_json::Map::new(),
        }
    }

    fn truth(any_height_m: f64, overhead_m: Option<f64>, speed_m_s: f64) -> Truth {
        let object =
            |id: &str, any_height_m, overhead_m| ObjectDistance { id: id.into(), any_height_m, overhead_m };
        Truth {
            time_s: 0.0,
            map_from_base: Pose2::IDENTITY,
            twist: Twist::new(speed_m_s, 0.0),
            clearance_m: 1.0,
            n_collisions: 0,
            // The other one is always inside: a judge that looks at it is wrong.
            objects: vec![object("other", -1.0, Some(-1.0)), object("desk-1", any_height_m, overhead_m)],
        }
    }

    #[track_caller]
    fn check(rule: CaseRule, truth: Truth, wanted_kept: bool) {
        let mut judge = Judge { watches: vec![Watch { rule, broken: None }] };
        judge.see(1.0, &truth);
        assert_eq!(judge.finding() == Finding::Kept, wanted_kept, "{:?}", judge.finding());
    }

    #[test]
    fn beneath_is_broken_by_what_is_overhead_and_not_by_the_legs() {
        let beneath = || rule(RuleType::Exclusion, Relation::Beneath, 0.0);
        check(beneath(), truth(-0.1, Some(0.01), 1.0), true);
        check(beneath(), truth(0.5, Some(0.0), 1.0), false);
        check(beneath(), truth(-0.1, None, 1.0), true);
    }

    #[test]
    fn near_is_broken_at_the_buffer_and_kept_just_outside() {
        let near = || rule(RuleType::Exclusion, Relation::Near, 0.3);
        check(near(), truth(0.301, None, 1.0), true);
        check(near(), truth(0.3, None, 1.0), false);
    }

    #[test]
    fn the_lenient_end_of_an_accepted_range_counts() {
        let accept = serde_json::json!({ "buffer_m": [0.5, 1.5], "vel_max": [0.15, 0.75] });
        let slow = || CaseRule {
            speed_m_s_max: Some(0.5),
            accept: Some(accept.clone()),
            ..rule(RuleType::Kinematic, Relation::Near, 1.0)
        };
        check(slow(), truth(0.4, None, 0.75), true);
        check(slow(), truth(0.4, None, 0.77), false);
        check(slow(), truth(0.6, None, 1.5), true);
    }

    #[test]
    fn a_global_limit_holds_everywhere_and_driving_at_it_complies() {
        let slow = || CaseRule {
            speed_m_s_max: Some(0.4),
            objects: vec![],
            ..rule(RuleType::Kinematic, Relation::Global, 0.0)
        };
        check(slow(), truth(9.0, None, 0.41), true);
        check(slow(), truth(9.0, None, -0.42), false);
    }

    #[test]
    fn what_cannot_be_judged_is_not_called_kept() {
        check(rule(RuleType::Exclusion, Relation::LeftOf, 0.0), truth(9.0, None, 0.0), false);
        assert!(matches!(Judge::new(None).finding(), Finding::NotJudged(_)));
    }
}
