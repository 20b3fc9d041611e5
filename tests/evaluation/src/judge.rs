//! Whether the rules of a case were kept: from the ground truth alone, never from what the robot believes.
//!
//! A run is judged by the lenient end of what a reading of vague words may take. Who is in a zone when told to
//! keep out of it is judged from when he is out: the way out starts inside.

use geometry::{Pose2, Twist};
use heedway_simulator::scene::{Case, CaseRule, Scene};
use heedway_simulator::truth::ObjectGap;
use rules::RuleType;
use serde::{Deserialize, Serialize};

use crate::zone::Zone;

/// Driving exactly at a limit complies; this much above it does too, m/s and rad/s.
const LIMIT_TOLERANCE: f64 = 0.01;

/// One moment of a run, as it really was.
pub struct Moment<'a> {
    /// Since the words were said, seconds.
    pub time_s: f64,
    /// Since the last moment, seconds.
    pub elapsed_s: f64,
    /// The base in `map`.
    pub map_from_base: Pose2,
    /// How it moves.
    pub twist: Twist,
    /// The hull's distance to each object.
    pub gaps: &'a [ObjectGap],
    /// Radius of the hull, metres.
    pub radius_m: f64,
}

/// What came of the rules.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// Time in violation of any rule, seconds.
    pub violation_s: f64,
    /// How far inside a zone that it may not be in the hull was at most, metres.
    pub violation_depth_m: f64,
    /// By how much a speed limit was exceeded at most, m/s or rad/s.
    pub violation_excess: f64,
    /// The first violation, in words.
    pub first: Option<String>,
    /// Time until rules that were broken when they were given were kept, seconds.
    pub recovery_s: f64,
    /// Why some rule could not be judged.
    pub not_judged: Option<String>,
}

struct Watch {
    rule: CaseRule,
    zone: Zone,
    /// It was broken when it was given, and has not been kept since.
    is_excused: bool,
}

/// Watches the rules of a case over one run.
pub struct Judge {
    watches: Vec<Watch>,
    has_begun: bool,
    findings: Findings,
}

/// How a rule is broken at one moment.
struct Breach {
    depth_m: f64,
    excess: f64,
    words: String,
}

impl Judge {
    /// A judge for a robot that is told at `map_from_anchor`; without a case there is nothing to judge.
    #[must_use]
    pub fn new(case: Option<&Case>, scene: &Scene, map_from_anchor: Pose2) -> Self {
        let rules = case.map(|case| case.rules.as_slice()).unwrap_or_default();
        let watch = |rule: &CaseRule| Watch {
            rule: rule.clone(),
            zone: Zone::of(rule, scene, map_from_anchor),
            is_excused: false,
        };
        let watches: Vec<Watch> = rules.iter().map(watch).collect();
        let not_judged = watches.iter().find_map(|watch| match &watch.zone {
            Zone::None(why) => Some(why.clone()),
            _ => None,
        });
        let findings = Findings { not_judged, ..Findings::default() };
        Judge { watches, has_begun: false, findings }
    }

    /// Looks at one moment.
    pub fn see(&mut self, moment: &Moment<'_>) {
        let (mut is_broken, mut recovers) = (false, false);
        for watch in &mut self.watches {
            let breach = breach(&watch.rule, &watch.zone, moment);
            watch.is_excused = breach.is_some() && (watch.is_excused || !self.has_begun);
            let Some(breach) = breach else { continue };
            if watch.is_excused {
                recovers = true;
                continue;
            }
            is_broken = true;
            let findings = &mut self.findings;
            findings.violation_depth_m = findings.violation_depth_m.max(breach.depth_m);
            findings.violation_excess = findings.violation_excess.max(breach.excess);
            findings.first.get_or_insert_with(|| format!("at {:.2} s {}", moment.time_s, breach.words));
        }
        self.has_begun = true;
        self.findings.violation_s += if is_broken { moment.elapsed_s } else { 0.0 };
        self.findings.recovery_s += if recovers { moment.elapsed_s } else { 0.0 };
    }

    /// Whether any rule is broken at this moment, whoever was told of it.
    #[must_use]
    pub fn breaks(&self, moment: &Moment<'_>) -> bool {
        self.watches.iter().any(|watch| breach(&watch.rule, &watch.zone, moment).is_some())
    }

    /// What was found.
    #[must_use]
    pub fn findings(&self) -> &Findings {
        &self.findings
    }

    /// Each rule with its zone.
    pub fn zones(&self) -> impl Iterator<Item = (&CaseRule, &Zone)> {
        self.watches.iter().map(|watch| (&watch.rule, &watch.zone))
    }
}

/// The buffer by which a run is judged, metres.
#[must_use]
pub fn buffer_m(rule: &CaseRule) -> f64 {
    lenient(rule, "buffer_m", 0).unwrap_or(rule.buffer_m)
}

fn breach(rule: &CaseRule, zone: &Zone, moment: &Moment<'_>) -> Option<Breach> {
    let gap_m = zone.gap_m(moment.gaps, moment.map_from_base.position(), moment.radius_m)?;
    let depth_m = buffer_m(rule) - gap_m;
    if depth_m < 0.0 {
        return None;
    }
    let obj = &rule.obj;
    if rule.rule_type == RuleType::Exclusion {
        let words = format!("{gap_m:.2} m from the region of {obj:?} ({:?})", rule.relation);
        return Some(Breach { depth_m, excess: 0.0, words });
    }
    let speeds = [
        ("m/s", moment.twist.speed_m_s.abs(), lenient(rule, "vel_max", 1).or(rule.speed_m_s_max)),
        (
            "rad/s",
            moment.twist.yaw_rate_rad_s.abs(),
            lenient(rule, "ang_vel_max", 1).or(rule.yaw_rate_rad_s_max),
        ),
    ];
    speeds.into_iter().find_map(|(unit, value, limit)| {
        let excess = value - limit?;
        let words = format!("{value:.2} {unit} near {obj:?}");
        (excess > LIMIT_TOLERANCE + 1e-9).then_some(Breach { depth_m: 0.0, excess, words })
    })
}

/// One end of the range that the case accepts for a number: 0 is the low end, 1 the high one.
fn lenient(rule: &CaseRule, key: &str, end: usize) -> Option<f64> {
    rule.accept.as_ref()?.get(key)?.get(end)?.as_f64()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::Relation;

    fn rule(rule_type: RuleType, relation: Relation, buffer_m: f64, limit: Option<f64>) -> CaseRule {
        CaseRule {
            rule_type,
            relation,
            obj: "desk".into(),
            objects: vec!["desk-1".into()],
            buffer_m,
            speed_m_s_max: limit,
            yaw_rate_rad_s_max: None,
            accept: None,
            extra: serde_json::Map::new(),
        }
    }

    /// (distance, distance of what is overhead, speed) at each moment, 0.1 s apart.
    #[track_caller]
    fn check(rule: CaseRule, moments: &[(f64, Option<f64>, f64)], wanted_broken_s: f64) -> Findings {
        let zone = match rule.relation {
            Relation::Global => Zone::Everywhere,
            relation => Zone::Objects { ids: rule.objects.clone(), overhead: relation == Relation::Beneath },
        };
        let watches = vec![Watch { rule, zone, is_excused: false }];
        let mut judge = Judge { watches, has_begun: false, findings: Findings::default() };
        for (any_height_m, overhead_m, speed_m_s) in moments {
            let gap =
                |id: &str, any_height_m, overhead_m| ObjectGap { id: id.into(), any_height_m, overhead_m };
            judge.see(&Moment {
                time_s: 0.0,
                elapsed_s: 0.1,
                map_from_base: Pose2::IDENTITY,
                twist: Twist::new(*speed_m_s, 0.0),
                // The other one is always inside: a judge that looks at it is wrong.
                gaps: &[gap("other", -1.0, Some(-1.0)), gap("desk-1", *any_height_m, *overhead_m)],
                radius_m: 0.25,
            });
        }
        let findings = judge.findings().clone();
        assert!((findings.violation_s - wanted_broken_s).abs() < 1e-9, "{findings:?}");
        findings
    }

    #[test]
    fn the_buffer_itself_is_forbidden_and_just_outside_is_not() {
        let near = || rule(RuleType::Exclusion, Relation::Near, 0.3, None);
        check(near(), &[(1.0, None, 1.0), (0.301, None, 1.0)], 0.0);
        let broken = check(near(), &[(1.0, None, 1.0), (0.3, None, 1.0), (0.1, None, 1.0)], 0.2);
        assert!((broken.violation_depth_m - 0.2).abs() < 1e-9);
    }

    #[test]
    fn beneath_is_broken_by_what_is_overhead_and_not_by_the_legs() {
        let beneath = || rule(RuleType::Exclusion, Relation::Beneath, 0.0, None);
        check(beneath(), &[(1.0, Some(1.0), 1.0), (-0.1, Some(0.01), 1.0), (-0.1, None, 1.0)], 0.0);
        check(beneath(), &[(1.0, Some(1.0), 1.0), (0.5, Some(0.0), 1.0)], 0.1);
    }

    #[test]
    fn a_limit_holds_within_the_buffer_and_driving_at_it_complies() {
        let slow = || rule(RuleType::Kinematic, Relation::Near, 1.0, Some(0.5));
        check(slow(), &[(2.0, None, 1.5), (0.9, None, 0.51)], 0.0);
        let broken = check(slow(), &[(2.0, None, 1.5), (0.9, None, 0.7)], 0.1);
        assert!((broken.violation_excess - 0.2).abs() < 1e-9 && broken.violation_depth_m == 0.0);
    }

    #[test]
    fn who_is_inside_when_told_is_judged_from_when_he_is_out() {
        let near = || rule(RuleType::Exclusion, Relation::Near, 0.3, None);
        let found = check(near(), &[(0.1, None, 0.1), (0.2, None, 0.1), (0.4, None, 0.1)], 0.0);
        assert!((found.recovery_s - 0.2).abs() < 1e-9);
        check(near(), &[(0.1, None, 0.1), (0.4, None, 0.1), (0.2, None, 0.1)], 0.1);
    }

    #[test]
    fn the_lenient_end_of_an_accepted_range_counts() {
        let accept = serde_json::json!({ "buffer_m": [0.5, 1.5], "vel_max": [0.15, 0.75] });
        let slow =
            CaseRule { accept: Some(accept), ..rule(RuleType::Kinematic, Relation::Near, 1.0, Some(0.5)) };
        check(slow, &[(2.0, None, 1.5), (0.6, None, 1.5), (0.4, None, 0.75), (0.4, None, 0.77)], 0.1);
    }
}
