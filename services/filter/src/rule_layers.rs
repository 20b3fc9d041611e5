//! The rules in force and the regions found for them: what the filter must heed besides obstacles.
//!
//! Nothing here lets go of a region because someone went silent or started over. A region goes when its
//! rule is revoked, or when a newer one of the same rule takes its place; what a restarted perception has
//! found so far replaces the old region only once it is about as large.

use std::collections::BTreeMap;

use control::{Demand, RuleLayer};
use geometry::{Point2, Profile, Time};
use proto::rule_set::N_RULES_MAX;
use proto::{Grounding, Invalid, ObjectMap, RuleHeld, RuleSet};
use rules::Rule;

use crate::fields::{FieldCells, FieldJob, FieldReady, FieldTag, LayerId, Zone};
use crate::heard::{Heard, Order, Thread};

/// A new run's region takes over from the old run's once it has this share of its area. Chosen: two views
/// of one object from other sides differ by less, and a few first voxels are far below.
const COVERED_SHARE: f64 = 0.8;
/// Room between the farthest plan and the border of a region's field, metres.
const ROOM_SPARE_M: f64 = 2.0;

/// A zone of one epoch, and what is kept of the run before.
#[derive(Clone, Debug)]
pub(crate) struct Kept {
    pub map_epoch: u64,
    run: u64,
    pub zone: Zone,
    /// The region of a former run of perception, until this one covers it.
    pub inherited: Option<Zone>,
}

impl Kept {
    /// What is kept once `zone` has come: the former run's region too, while the new one is much smaller.
    pub(crate) fn after(kept: Option<Kept>, tag: &FieldTag, zone: Zone) -> Kept {
        let former = kept
            .filter(|old| old.map_epoch == tag.map_epoch)
            .and_then(|old| if old.run == tag.run { old.inherited } else { Some(old.larger()) });
        let inherited = former.filter(|old| zone.area_m2 < COVERED_SHARE * old.area_m2);
        Kept { map_epoch: tag.map_epoch, run: tag.run, zone, inherited }
    }

    /// What is kept once nothing is seen any more: all of it when a new run says so, which has not looked yet.
    pub(crate) fn after_nothing(self, tag: &FieldTag) -> Option<Kept> {
        if self.map_epoch != tag.map_epoch {
            return None;
        }
        if self.run != tag.run {
            return Some(self);
        }
        let map_epoch = self.map_epoch;
        // Run 0 is before every run: what it left is inherited from now on.
        self.inherited.map(|zone| Kept { map_epoch, run: 0, zone, inherited: None })
    }

    fn larger(self) -> Zone {
        match self.inherited {
            Some(inherited) if inherited.area_m2 > self.zone.area_m2 => inherited,
            _ => self.zone,
        }
    }

    /// The zones in force.
    pub(crate) fn zones(&self) -> impl Iterator<Item = &Zone> {
        std::iter::once(&self.zone).chain(&self.inherited)
    }
}

/// What is known of one rule's object.
#[derive(Debug, Default)]
struct Found {
    thread: Thread,
    n_runs: u64,
    kept: Option<Kept>,
    /// What perception said last.
    said: Option<Grounding>,
    remark: String,
}

/// The rules in force, and the regions found.
#[derive(Debug, Default)]
pub(crate) struct RuleLayers {
    set: Option<RuleSet>,
    found: BTreeMap<String, Found>,
    /// Since when rules with objects are in force.
    objects_since: Option<Time>,
}

/// What the rules ask at one tick.
#[derive(Debug, Default)]
pub(crate) struct Asked {
    pub layers: Vec<RuleLayer>,
    /// What the operator should know, a clause each.
    pub notes: Vec<String>,
}

impl RuleLayers {
    /// Takes a rule set in; `true` when it is another one than before.
    ///
    /// # Errors
    /// When its version goes back: the newer set stays in force.
    pub(crate) fn take(&mut self, set: RuleSet, now: Time) -> Result<bool, Invalid> {
        if let Some(held) = &self.set {
            if set.version < held.version {
                return Err(Invalid::new("version", set.version, format_args!("at least {}", held.version)));
            }
            if set.version == held.version {
                return Ok(false);
            }
        }
        self.found.retain(|id, _| set.specs.iter().any(|rule| rule.id == *id));
        self.objects_since =
            if set.specs.iter().any(Rule::needs_grounding) { self.objects_since.or(Some(now)) } else { None };
        self.set = Some(set);
        Ok(true)
    }

    /// Version of the rule set in force.
    pub(crate) fn version(&self) -> Option<u64> {
        self.set.as_ref().map(|set| set.version)
    }

    /// Since when rules with objects are in force; `None` while there are none.
    pub(crate) fn objects_since(&self) -> Option<Time> {
        self.objects_since
    }

    /// Takes an object map in; the field to compute, when it brings a region.
    ///
    /// A map may come before the rule set that it belongs to: it is kept until the next set.
    pub(crate) fn hear(&mut self, heard: Heard<ObjectMap>, reach_m: f64) -> Option<FieldJob> {
        let map = heard.message;
        if !self.found.contains_key(&map.rule_id) && self.found.len() >= N_RULES_MAX {
            return None;
        }
        let found = self.found.entry(map.rule_id.clone()).or_default();
        match found.thread.follow(map.header, heard.at) {
            Order::Old => return None,
            Order::NewRun => found.n_runs += 1,
            Order::Next => {}
        }
        found.remark = map.remark;
        let Some(cells) = map.region.filter(|_| map.grounding.is_usable()) else {
            // Searching again, or lost: a region that was found stays.
            found.said = Some(map.grounding);
            return None;
        };
        let layer = LayerId::Rule(map.rule_id);
        let tag = FieldTag { layer, map_epoch: map.map_epoch, run: found.n_runs, grounding: map.grounding };
        let room_m = reach_m + rules::rule::BUFFER_M_MAX + ROOM_SPARE_M;
        Some(FieldJob { tag, cells: FieldCells::Set(cells), room_m })
    }

    /// Takes a field in.
    ///
    /// # Errors
    /// When it could not be computed; what was known before stays.
    pub(crate) fn ready(&mut self, id: &str, ready: FieldReady) -> Result<(), Invalid> {
        // The rule may be gone by now, and its field with it.
        let Some(found) = self.found.get_mut(id) else { return Ok(()) };
        match ready.zone {
            Ok(Some(zone)) => {
                found.said = Some(ready.tag.grounding);
                found.kept = Some(Kept::after(found.kept.take(), &ready.tag, zone));
                Ok(())
            }
            // Found, and nowhere: that is not found.
            Ok(None) => {
                found.said = Some(Grounding::Searching);
                Ok(())
            }
            Err(reason) => Err(Invalid::new("region", reason, "a grid that can be")),
        }
    }

    /// Each rule, as the filter holds it while the map frame is of `map_epoch`.
    pub(crate) fn held(&self, map_epoch: Option<u64>) -> Vec<RuleHeld> {
        let specs = self.set.iter().flat_map(|set| &set.specs);
        specs
            .map(|rule| RuleHeld { id: rule.id.clone(), grounding: self.grounding(rule, map_epoch) })
            .collect()
    }

    fn grounding(&self, rule: &Rule, map_epoch: Option<u64>) -> Grounding {
        if !rule.needs_grounding() {
            return Grounding::NotNeeded;
        }
        let Some(found) = self.found.get(&rule.id) else { return Grounding::Searching };
        match &found.kept {
            None => Grounding::Searching,
            Some(kept) if Some(kept.map_epoch) != map_epoch => Grounding::Lost,
            Some(_) => match found.said {
                Some(Grounding::Lost) => Grounding::Lost,
                Some(Grounding::Ambiguous) => Grounding::Ambiguous,
                _ => Grounding::Grounded,
            },
        }
    }

    /// What the rules ask of a robot at `place` in a map frame of `map_epoch`.
    pub(crate) fn asked(&self, place: Point2, map_epoch: Option<u64>, profile: &Profile) -> Asked {
        let mut asked = Asked::default();
        for rule in self.set.iter().flat_map(|set| &set.specs) {
            self.ask(rule, place, map_epoch, profile, &mut asked);
        }
        asked
    }

    fn ask(&self, rule: &Rule, place: Point2, map_epoch: Option<u64>, profile: &Profile, asked: &mut Asked) {
        let label = label_of(rule);
        let layer = |demand: Demand| RuleLayer { id: rule.id.clone(), label: label.clone(), demand };
        let found = self.found.get(&rule.id);
        let kept =
            found.and_then(|found| found.kept.as_ref()).filter(|kept| Some(kept.map_epoch) == map_epoch);
        let zones: Vec<Option<&Zone>> = match kept {
            Some(kept) => kept.zones().map(Some).collect(),
            None if rule.needs_grounding() => Vec::new(),
            None => vec![None],
        };
        let is_lost = found.is_some_and(|found| found.said == Some(Grounding::Lost));
        if zones.is_empty() || (rule.needs_grounding() && is_lost) {
            asked.layers.push(layer(Demand::SpeedCap { speed_m_s_max: profile.ungrounded_speed_m_s }));
            let lost = if zones.is_empty() { "" } else { " again, keeping its last place" };
            asked.notes.push(format!("looking for {label}{lost}, going slowly"));
        }
        for zone in zones {
            if zone.is_some_and(|zone| !zone.is_within_reach(place)) {
                continue;
            }
            match Demand::from_rule(rule, zone.map(|zone| zone.field.clone())) {
                Ok(demand) => asked.layers.push(layer(demand)),
                // A rule that cannot be kept while moving is kept by not moving.
                Err(e) => {
                    asked.notes.push(format!("standing still: {e}"));
                    asked.layers.push(layer(Demand::SpeedCap { speed_m_s_max: 0.0 }));
                }
            }
        }
        if let Some(remark) = found.map(|found| &found.remark).filter(|remark| !remark.is_empty()) {
            asked.notes.push(remark.clone());
        }
    }
}

/// The rule's object as the operator reads it: "the crib".
fn label_of(rule: &Rule) -> String {
    const OWN_DETERMINER: [&str; 16] = [
        "the", "a", "an", "any", "all", "every", "each", "my", "your", "our", "his", "her", "their", "this",
        "that", "these",
    ];
    let phrase = rule.phrase();
    let first = phrase.split_whitespace().next().unwrap_or_default();
    if !rule.needs_grounding() {
        "the limit everywhere".to_owned()
    } else if OWN_DETERMINER.contains(&first) {
        phrase.to_owned()
    } else {
        format!("the {phrase}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fields::Fields;
    use geometry::Point2;
    use proto::{CellSet, GridLayout, Header};
    use rules::Relation;

    /// A crib at the origin, half a metre square, found.
    fn with_a_crib() -> RuleLayers {
        let mut layers = RuleLayers::default();
        let rule = Rule { id: "s1".into(), buffer_m: 0.5, ..Rule::exclusion(Relation::Near, "white crib") };
        layers.take(RuleSet { version: 1, specs: vec![rule] }, Time::ZERO).unwrap();
        let layout = GridLayout { origin_map: Point2::origin(), resolution_m: 0.1, n_cols: 5, n_rows: 5 };
        let message = ObjectMap {
            header: Header { seq: 1, stamp_ns: 1, echo: 0 },
            map_epoch: 1,
            rule_id: "s1".into(),
            grounding: Grounding::Grounded,
            region: Some(CellSet::pack(layout, &[true; 25])),
            remark: String::new(),
        };
        let job = layers.hear(Heard { message, at: Time::ZERO, wall_ns: 1 }, 3.0).unwrap();
        layers.ready("s1", Fields::default().compute(job)).unwrap();
        layers
    }

    #[track_caller]
    fn check(x_m: f64, map_epoch: Option<u64>, wanted: &[&str]) {
        let asked = with_a_crib().asked(Point2::new(x_m, 0.0), map_epoch, &Profile::sim());
        let demands: Vec<&str> = asked
            .layers
            .iter()
            .map(|layer| match &layer.demand {
                Demand::Exclusion { .. } => "keep out",
                Demand::Limit { .. } => "limit",
                Demand::SpeedCap { .. } => "go slowly",
            })
            .collect();
        assert_eq!(demands, wanted);
        assert!(asked.layers.iter().all(|layer| layer.label == "the white crib"));
    }

    #[test]
    fn a_region_out_of_reach_asks_nothing_and_one_within_reach_keeps_the_robot_out() {
        check(2.0, Some(1), &["keep out"]);
        check(8.0, Some(1), &["keep out"]);
        check(1000.0, Some(1), &[]);
        check(f64::NAN, Some(1), &["keep out"]);
    }

    #[test]
    fn a_region_of_another_map_frame_or_of_none_is_not_grounded() {
        check(2.0, Some(2), &["go slowly"]);
        check(2.0, None, &["go slowly"]);
    }
}
