//! From what was seen of a rule's phrases to the region that its relation names.

use geometry::Point2;
use mapping::morphology::groups;
use mapping::occupancy::{HeightBand, Hidden, OccupancyError, Relation};
use mapping::region::region;
use mapping::{Grid, GridError, Layout, Occupancy};
use nalgebra::Vector2;
use proto::CellSet;
use rules::{Rule, RuleType};

use super::evidence::Evidence;
use super::models::Understood;
use super::object_maps::MapConfig;
use super::places::Places;
use crate::wire::cell_set;

/// The region of one rule, for now.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Its cells, without the buffer.
    pub cells: CellSet,
    /// Whether it cannot be told which one is meant; all are covered then.
    pub is_ambiguous: bool,
    /// What a person should know.
    pub remark: String,
}

/// Why a rule has no region.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Missing {
    /// Its object is nowhere, as far as was seen. In words.
    NotSeen(String),
    /// It was seen, and still the region cannot be told. In words.
    CannotTell(String),
}

/// What is known beside what was seen of the phrases.
#[derive(Clone, Copy, Debug, Default)]
pub struct Known<'a> {
    /// The named places of this map.
    pub places: Option<&'a Places>,
    /// What the LiDAR knows of the floor.
    pub base: Option<&'a Grid<Occupancy>>,
}

/// What is known of one rule.
#[derive(Clone, Debug, PartialEq)]
pub struct Finding {
    /// The rule.
    pub rule_id: String,
    /// Stamp of the newest frame in it.
    pub stamp_ns: u64,
    /// Its region.
    pub region: Result<Region, Missing>,
}

/// The phrases that a rule's region needs: one, or two for `between`; none when it needs no object.
#[must_use]
pub fn phrases(rule: &Rule) -> Vec<&str> {
    if !rule.needs_grounding() {
        return Vec::new();
    }
    match rule.obj2.as_deref().filter(|_| rule.relation == rules::Relation::Between) {
        // The phrase for both ("the sofa and the tv") finds neither alone.
        Some(second) if rule.phrase().contains(second) => vec![&rule.obj, second],
        Some(second) => vec![rule.phrase(), second],
        None => vec![rule.phrase()],
    }
}

/// The rule's relation as maps know it; `None` when it needs no object.
fn relation_of(rule: &Rule) -> Option<Relation> {
    Some(match rule.relation {
        rules::Relation::Near => Relation::Near,
        rules::Relation::On => Relation::On,
        rules::Relation::Beneath => Relation::Beneath,
        rules::Relation::Between => Relation::Between,
        rules::Relation::Beyond => Relation::Beyond,
        rules::Relation::LeftOf => Relation::LeftOf,
        rules::Relation::RightOf => Relation::RightOf,
        rules::Relation::FrontOf => Relation::FrontOf,
        rules::Relation::Behind => Relation::Behind,
        rules::Relation::Global => return None,
    })
}

/// The region of a rule, from what was seen of each of its phrases, in order, or from the place it names.
///
/// # Errors
/// [`Missing`] says why there is none.
pub fn region_of(
    rule: &Rule,
    seen: &[Option<&Evidence>],
    known: Known<'_>,
    band: HeightBand,
    config: &MapConfig,
) -> Result<Region, Missing> {
    let relation = relation_of(rule).ok_or_else(|| Missing::CannotTell("needs no object".to_owned()))?;
    // Where the robot may go, only slower, too large a region costs little.
    let is_passable = rule.rule_type == RuleType::Kinematic && rule.vel_max != Some(0.0);
    let base = known.base.map(|base| (base, if is_passable { Hidden::Around } else { Hidden::Behind }));
    let mut footprints = Vec::new();
    let (mut n_places, mut excepts_honoured) = (0, false);
    for (phrase, evidence) in phrases(rule).into_iter().zip(seen) {
        if phrase.trim().is_empty() {
            return Err(Missing::CannotTell("the rule names no object: its phrase is empty".to_owned()));
        }
        if let Some(found) = known.places.and_then(|places| places.find(rule, phrase)) {
            n_places += 1;
            excepts_honoured |= found.excepts_honoured;
            footprints.push(found.footprint);
            continue;
        }
        let evidence = evidence.ok_or_else(|| Missing::NotSeen(format!("looking for {phrase:?}")))?;
        if let Understood::NotAtAll(words) = &evidence.understood {
            return Err(Missing::NotSeen(words.clone()));
        }
        footprints.push(evidence.footprint(relation, band, config, base).map_err(|e| missing(phrase, &e))?);
    }
    let first = footprints.first().ok_or_else(|| Missing::CannotTell("nothing to look for".to_owned()))?;
    let second = footprints.get(1);
    let layout = layout(relation, &footprints, config).map_err(|e| Missing::CannotTell(e.to_string()))?;
    let cells = region(relation, first, second, rule.map_from_anchor(), layout)
        .map_err(|e| Missing::CannotTell(e.to_string()))?;
    let n_objects = groups(first, config.closing.join_m).len();
    let mut remarks: Vec<String> = seen.iter().flatten().filter_map(|e| more_than_said(e)).collect();
    let is_more = !remarks.is_empty();
    let is_which_unclear = !is_more && n_places == 0 && n_objects > 1 && is_qualified(rule);
    let is_except_unclear = !rule.except.is_empty() && !excepts_honoured;
    let is_ambiguous = is_more || is_which_unclear || is_except_unclear;
    if is_which_unclear {
        let (phrase, obj) = (rule.phrase(), &rule.obj);
        remarks.push(format!(
            "{n_objects} found for {phrase:?}, cannot tell which {obj} is meant: all are covered"
        ));
    }
    if is_except_unclear {
        remarks.push(format!("cannot tell {:?} from the others: all are covered", rule.except.join(", ")));
    }
    if seen.iter().flatten().any(|evidence| evidence.is_full()) {
        remarks.push("no space left to map all of it".to_owned());
    }
    Ok(Region { cells: cell_set(&cells), is_ambiguous, remark: remarks.join("; ") })
}

/// What the models cannot tell of a phrase, in words.
fn more_than_said(evidence: &Evidence) -> Option<String> {
    match &evidence.understood {
        Understood::InPart(words) => Some(words.clone()),
        Understood::Wholly | Understood::NotAtAll(_) => None,
    }
}

fn missing(phrase: &str, error: &OccupancyError) -> Missing {
    match error {
        OccupancyError::Nothing { n_points: 0 } => Missing::NotSeen(format!("looking for {phrase:?}")),
        OccupancyError::Nothing { .. } => {
            Missing::NotSeen(format!("not enough of {phrase:?} seen for this relation"))
        }
        other => Missing::CannotTell(format!("{phrase}: {other}")),
    }
}

/// Where the region lies: the objects, and as far around them as it may reach.
fn layout(relation: Relation, footprints: &[Grid<bool>], config: &MapConfig) -> Result<Layout, GridError> {
    let mut corners = footprints.iter().flat_map(|f| [f.layout().origin, f.layout().far_corner()]);
    let first = corners.next().unwrap_or_else(Point2::origin);
    let (low, high) = corners.fold((first, first), |(low, high), c| (low.inf(&c), high.sup(&c)));
    let reach_m = match relation {
        Relation::Near | Relation::On | Relation::Beneath | Relation::Between => 0.0,
        Relation::Beyond => config.region_reach_m,
        // A side reaches as far as the object is wide, or a metre and a half.
        _ => (high - low).norm().max(2.0 * mapping::region::SIDE_M_MIN),
    };
    let border = Vector2::repeat(reach_m);
    Layout::covering(low - border, high + border, config.closing.resolution_m)
}

/// Whether the phrase says more than the class noun: "red sofa", "chair by the window".
fn is_qualified(rule: &Rule) -> bool {
    const FILLERS: [&str; 14] = [
        "the", "a", "an", "any", "all", "every", "each", "my", "our", "your", "this", "that", "these",
        "those",
    ];
    let words = |text: &str| -> Vec<String> {
        let words = text.split_whitespace().map(str::to_lowercase);
        // "chairs" is no more than "chair".
        words
            .filter(|w| !FILLERS.contains(&w.as_str()))
            .map(|w| w.trim_end_matches("es").trim_end_matches('s').to_owned())
            .collect()
    };
    words(rule.phrase()) != words(&rule.obj)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rule(relation: rules::Relation, obj: &str, reference: &str) -> Rule {
        Rule { reference: reference.to_owned(), ..Rule::exclusion(relation, obj) }
    }

    #[test]
    fn a_phrase_is_qualified_when_it_says_more_than_the_noun() {
        let check = |obj: &str, reference: &str, wanted: bool| {
            assert_eq!(is_qualified(&rule(rules::Relation::Near, obj, reference)), wanted, "{reference:?}");
        };
        check("sofa", "red sofa", true);
        check("sofa", "the sofa", false);
        check("sofa", "", false);
        check("chair", "all Chairs", false);
        check("couch", "couches", false);
        check("standing desk", "the standing desk", false);
        check("desk", "standing desk", true);
        check("chair", "chair by the window", true);
    }

    #[test]
    fn between_looks_for_two_things_and_global_for_none() {
        let between = |reference: &str| Rule {
            obj2: Some("tv".into()),
            ..rule(rules::Relation::Between, "sofa", reference)
        };
        assert_eq!(phrases(&between("red sofa")), ["red sofa", "tv"]);
        assert_eq!(phrases(&between("sofa and tv")), ["sofa", "tv"]);
        assert_eq!(phrases(&rule(rules::Relation::Near, "crib", "baby's crib")), ["baby's crib"]);
        assert!(phrases(&rule(rules::Relation::Global, "", "")).is_empty());
    }
}
