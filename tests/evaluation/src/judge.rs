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
/// Who is told while driving may take so long to understand and to find the object, seconds.
const REACTION_S: f64 = 0.3;
/// Who could not stop any more is inside a zone so soon after being told, or has no excuse, seconds.
const TOO_LATE_S: f64 = 1.5;

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
    /// When it was given nothing could keep the robot from breaking it.
    is_too_late: bool,
}

/// Watches the rules of a case over one run.
pub struct Judge {
    watches: Vec<Watch>,
    has_begun: bool,
    /// How far the robot goes from when it is told until it stands, metres.
    stopping_m: f64,
    /// When it was told, seconds of the run.
    began_s: f64,
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
            is_too_late: false,
        };
        let watches: Vec<Watch> = rules.iter().map(watch).collect();
        let not_judged = watches.iter().find_map(|watch| match &watch.zone {
            Zone::None(why) => Some(why.clone()),
            _ => None,
        });
        let findings = Findings { not_judged, ..Findings::default() };
        Judge { watches, has_begun: false, stopping_m: 0.0, began_s: 0.0, findings }
    }

    /// For a robot that is told at this speed, m/s, and brakes with this, m/s².
    #[must_use]
    pub fn told_at_speed(mut self, speed_m_s: f64, brake_m_s2: f64) -> Self {
        let speed_m_s = speed_m_s.abs();
        self.stopping_m = speed_m_s * REACTION_S + speed_m_s.powi(2) / (2.0 * brake_m_s2.max(0.01));
        self
    }

    /// Looks at one moment.
    pub fn see(&mut self, moment: &Moment<'_>) {
        let (mut is_broken, mut recovers) = (false, false);
        for watch in &mut self.watches {
            let breach = breach(&watch.rule, &watch.zone, moment);
            if !self.has_begun {
                self.began_s = moment.time_s;
                watch.is_too_late =
                    room_m(watch, moment).is_some_and(|room_m| room_m > 0.0 && room_m <= self.stopping_m);
            }
            let is_too_late = watch.is_too_late && moment.time_s - self.began_s <= TOO_LATE_S;
            watch.is_excused = breach.is_some() && (watch.is_excused || !self.has_begun || is_too_late);
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

    /// How far the hull is from where any rule holds, metres, not above 0 inside; `None` when all hold everywhere.
    #[must_use]
    pub fn room_m(&self, moment: &Moment<'_>) -> Option<f64> {
        self.watches.iter().filter_map(|watch| room_m(watch, moment)).min_by(f64::total_cmp)
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

/// How far the hull is from where a rule holds, metres; `None` when it holds everywhere or nowhere.
fn room_m(watch: &Watch, moment: &Moment<'_>) -> Option<f64> {
    let gap_m = watch.zone.gap_m(moment.gaps, moment.map_from_base.position(), moment.radius_m)?;
    gap_m.is_finite().then(|| gap_m - watch.rule.least_buffer_m())
}

fn breach(rule: &CaseRule, zone: &Zone, moment: &Moment<'_>) -> Option<Breach> {
    let gap_m = zone.gap_m(moment.gaps, moment.map_from_base.position(), moment.radius_m)?;
    let depth_m = rule.least_buffer_m() - gap_m;
    if depth_m < 0.0 {
        return None;
    }
    let obj = &rule.obj;
    if rule.rule_type == RuleType::Exclusion {
        let words = format!("{gap_m:.2} m from the region of {obj:?} ({:?})", rule.relation);
        return Some(Breach { depth_m, excess: 0.0, words });
    }
    let speeds = [
        ("m/s", moment.twist.speed_m_s.abs(), rule.highest_speed_m_s()),
        ("rad/s", moment.twist.yaw_rate_rad_s.abs(), rule.highest_yaw_rate_rad_s()),
    ];
    speeds.into_iter().find_map(|(unit, value, limit)| {
        let excess = value - limit?;
        let words = format!("{value:.2} {unit} near {obj:?}");
        (excess > LIMIT_TOLERANCE + 1e-9).then_some(Breach { depth_m: 0.0, excess, words })
    })
}

#[cfg(test)]
mod tests;
