//! How fast the robot may move where: limits and manners out of one order.

use geometry::Profile;
use rules::{Relation, Rule, RuleType};

use crate::draft::{Draft, Place};
use crate::exclusion::{exclude, named, object, said_distance};
use crate::lexicon::Sense;
use crate::limit::{Limit, limit_of};
use crate::noun::{Name, Nouns};
use crate::resolve::Trouble;
use crate::vague;

/// A manner rather than a number.
#[derive(Clone, Copy, PartialEq)]
pub enum Intent {
    /// Slow, and at a distance.
    Careful,
    /// Slow, within hearing.
    Quiet,
}

/// The limits of one order, with where they hold.
///
/// # Errors
/// [`Trouble`] when it is none.
pub fn kinematic(draft: &Draft, profile: &Profile) -> Result<Vec<Rule>, Trouble> {
    let limit = limit_of(draft, profile)?;
    if !draft.names.is_empty() && !draft.regions.is_empty() {
        return Err(Trouble::Ask(format!(
            "I did not understand \"{}\". Where should I go slowly?",
            draft.words
        )));
    }
    if draft.names.is_empty() && draft.regions.is_empty() {
        return Ok(vec![limited(Rule::kinematic(Relation::Global, ""), draft, &limit)]);
    }
    let mut rules = Vec::new();
    for (relation, name, second, buffer_m, said) in activations(draft, vague::ACTIVATION_M)? {
        let mut rule = Rule { buffer_m, ..named(Rule::kinematic(relation, ""), &name) };
        rule.obj2 = second.map(|name| object(&name).0);
        if !said && buffer_m > 0.0 {
            rule.defaults.push("buffer_m".into());
        }
        rules.push(limited(rule, draft, &limit));
    }
    Ok(rules)
}

fn limited(mut rule: Rule, draft: &Draft, limit: &Limit) -> Rule {
    rule.vel_max = limit.vel_max;
    rule.ang_vel_max = limit.ang_vel_max;
    rule.defaults.extend(limit.defaults());
    rule.except = draft.except.iter().map(|name| name.reference.clone()).collect();
    rule
}

type Activation = (Relation, Name, Option<Name>, f64, bool);

/// Where a limit holds: relation, names, activation distance, and whether it was said.
fn activations(draft: &Draft, near_m: f64) -> Result<Vec<Activation>, Trouble> {
    let said = said_distance(draft);
    let near = |name: &Name| (Relation::Near, name.clone(), None, said.unwrap_or(near_m), said.is_some());
    let mut out = Vec::new();
    for name in &draft.names {
        let on = draft.has(Sense::VerbOn)
            || Nouns::get().is_place(&name.obj)
                && !draft.has_any(&[Sense::ForWhom, Sense::Of, Sense::VerbPast, Sense::VerbNear]);
        out.push(if on && said.is_none() {
            (Relation::On, name.clone(), None, 0.0, true)
        } else {
            near(name)
        });
    }
    for region in &draft.regions {
        let relation = match region.place {
            Place::On => Relation::On,
            Place::Under => Relation::Beneath,
            Place::Front => Relation::FrontOf,
            Place::Behind => Relation::Behind,
            Place::Left => Relation::LeftOf,
            Place::Right => Relation::RightOf,
            Place::Between => match region.names.as_slice() {
                [first, second] => {
                    out.push((
                        Relation::Between,
                        first.clone(),
                        Some(second.clone()),
                        said.unwrap_or(0.0),
                        true,
                    ));
                    continue;
                }
                [both] => {
                    out.push((
                        Relation::Between,
                        both.clone(),
                        Some(both.clone()),
                        said.unwrap_or(0.0),
                        true,
                    ));
                    continue;
                }
                _ => return Err(Trouble::Ask("Between what and what?".into())),
            },
            Place::Near | Place::Past | Place::ThisSide | Place::To => {
                out.extend(region.names.iter().map(near));
                continue;
            }
        };
        // "within a metre on the rug" keeps its distance around the area.
        out.extend(region.names.iter().map(|name| (relation, name.clone(), None, said.unwrap_or(0.0), true)));
    }
    if out.is_empty() {
        return Err(Trouble::Ask("Where should I do that?".into()));
    }
    Ok(out)
}

/// One vague word into the two primitives of the paper.
///
/// # Errors
/// [`Trouble`] when it is unclear where.
pub fn intent(draft: &Draft, profile: &Profile, intent: Intent) -> Result<Vec<Rule>, Trouble> {
    let said = limit_of(draft, profile).unwrap_or_else(|_| Limit::default());
    // "quiet near the bed, turn at most 0.3 rad/s" says nothing of the speed: care does.
    let careful = Limit::careful(profile);
    let limit = if said.is_said() { said.with_speed_of(careful) } else { careful };
    if draft.names.is_empty() && draft.regions.is_empty() {
        return Ok(vec![limited(Rule::kinematic(Relation::Global, ""), draft, &limit)]);
    }
    let near_m = if intent == Intent::Quiet { vague::QUIET_M } else { vague::ACTIVATION_M };
    let mut rules = Vec::new();
    for (relation, name, second, buffer_m, said) in activations(draft, near_m)? {
        let mut rule = Rule { buffer_m, ..named(Rule::kinematic(relation, ""), &name) };
        rule.obj2 = second.map(|name| object(&name).0);
        if !said && buffer_m > 0.0 {
            rule.defaults.push("buffer_m".into());
        }
        rules.push(limited(rule, draft, &limit));
        if intent == Intent::Careful && relation == Relation::Near {
            let keep_m = if Nouns::get().is_drop(&name.obj) { vague::DROP_M } else { vague::AVOID_M };
            rules.push(exclude(draft, Relation::Near, &name, None, keep_m.min(buffer_m), false));
        }
    }
    debug_assert!(rules.iter().all(|rule| rule.rule_type == RuleType::Exclusion || rule.vel_max.is_some()));
    Ok(rules)
}
