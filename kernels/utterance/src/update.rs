//! Changing a rule in force: "make that 1 m", "slower", "double it".

use geometry::Profile;
use rules::{Relation, Rule, RuleType};

use crate::clause::is_limit;
use crate::dialogue::{Change, is_on};
use crate::draft::Draft;
use crate::lexicon::Sense;
use crate::noun::Name;
use crate::quantity::{Bound, Kind, Quantity, round_safe};
use crate::resolve::Trouble;
use crate::vague;

/// The rule an utterance changes, with its new number; none when it is an order of its own.
///
/// # Errors
/// [`Trouble`] when there is no such rule or no such number.
pub fn update(
    draft: &Draft,
    active: &[Rule],
    fresh: &[Rule],
    profile: &Profile,
) -> Result<Option<Change>, Trouble> {
    let scales = scale(draft);
    let named: Vec<&Name> = draft.all_names().filter(|name| !name.is_pronoun).collect();
    let on_named: Vec<&Rule> =
        active.iter().filter(|rule| named.iter().any(|name| is_on(rule, name))).collect();
    let numbers_only = !draft.quantities.is_empty()
        && draft.senses.iter().all(|sense| {
            matches!(
                sense,
                Sense::Make
                    | Sense::OpenEnded
                    | Sense::AsWell
                    | Sense::RuleNoun
                    | Sense::Last
                    | Sense::Copula
                    | Sense::Hold
                    | Sense::Away
                    | Sense::SpeedNoun
            )
        });
    let limit_order =
        draft.quantities.iter().any(|q| matches!(q.kind, Kind::Speed | Kind::TurnRate | Kind::Fraction))
            && draft.has(Sense::SpeedNoun)
            && !draft.has(Sense::Make);
    let own_order = limit_order || is_own_order(draft, &named, &on_named);
    let asks = draft.has(Sense::Make)
        || scales.is_some()
        || numbers_only && (named.is_empty() || !on_named.is_empty()) && !limit_order
        || draft.ttl_s.is_some()
            && draft.senses.iter().all(|sense| matches!(sense, Sense::Make))
            && named.is_empty();
    if !asks || own_order || !fresh.is_empty() && !draft.has(Sense::Make) {
        return Ok(None);
    }
    if active.is_empty() || !named.is_empty() && on_named.is_empty() {
        // With nothing to change, "slower" is an order by itself; "make it 1 m" is not.
        let stands_alone = draft.has_any(&[
            Sense::Slower,
            Sense::Slow,
            Sense::SpeedNoun,
            Sense::Motion,
            Sense::Away,
            Sense::From,
        ]) || is_limit(draft)
            || draft.has(Sense::Wider) && !named.is_empty()
            || !named.is_empty() && draft.quantities.iter().any(|q| q.bound == Bound::Lower);
        return if stands_alone && !draft.has(Sense::Faster) {
            Ok(None)
        } else if draft.has(Sense::Faster) {
            Err(Trouble::Unsupported("promise to be fast".into()))
        } else {
            Err(Trouble::Ask("Which rule should I change? There is none like that in force.".into()))
        };
    }
    let pool: Vec<&Rule> = if on_named.is_empty() { active.iter().collect() } else { on_named };
    // "make both a metre", "make them all a metre"
    let all = named.is_empty()
        && pool.len() > 1
        && draft.all_names().any(|name| matches!(name.reference.as_str(), "both" | "they both" | "they all"))
        || draft.words.contains("them all")
        || draft.words.contains("all of them");
    if !all {
        return change(draft, &pool, scales, profile);
    }
    let mut sum = Change::default();
    for rule in &pool {
        if let Some(one) = change(draft, &[rule], scales, profile)? {
            sum.lifted.extend(one.lifted);
            sum.added.extend(one.added);
        }
    }
    Ok(Some(sum))
}

/// Whether the words order by themselves, whatever is in force.
fn is_own_order(draft: &Draft, named: &[&Name], on_named: &[&Rule]) -> bool {
    draft.has_any(&[Sense::Avoid, Sense::StayOff, Sense::Careful, Sense::Quiet, Sense::Crawl, Sense::Halt])
        || (draft.has(Sense::Away) || draft.has(Sense::From)) && !named.is_empty() && on_named.is_empty()
        || !draft.regions.is_empty() && on_named.is_empty()
        || draft.n_neg > 0 && !draft.has_any(&[Sense::Faster, Sense::Closer])
}

#[derive(Clone, Copy, PartialEq)]
enum Field {
    Buffer,
    Speed,
    TurnRate,
}

/// What a comparative does to which field.
fn scale(draft: &Draft) -> Option<(Option<Field>, f64)> {
    let by = draft
        .quantity(Kind::Fraction)
        .filter(|q| q.by || draft.has_any(&[Sense::Slower, Sense::Faster]))
        .map(|q| q.value);
    if draft.has(Sense::Slower) {
        return Some((Some(Field::Speed), 1.0 - by.unwrap_or(0.5)));
    }
    if draft.has(Sense::Faster) {
        return Some((Some(Field::Speed), 1.0 + by.unwrap_or(0.5)));
    }
    if draft.has(Sense::Double) {
        return Some((None, 2.0));
    }
    if draft.has(Sense::Halve) {
        return Some((None, 0.5));
    }
    if draft.has(Sense::Wider) {
        return Some((Some(Field::Buffer), 1.0 + by.unwrap_or(0.5)));
    }
    if draft.has(Sense::Closer) && draft.n_neg == 0 {
        return Some((Some(Field::Buffer), 1.0 - by.unwrap_or(0.5)));
    }
    None
}

fn holds(rule: &Rule, field: Field) -> bool {
    match field {
        Field::Buffer => {
            rule.relation != Relation::Global
                && (rule.rule_type == RuleType::Exclusion || rule.buffer_m > 0.0)
        }
        Field::Speed => rule.vel_max.is_some(),
        Field::TurnRate => rule.ang_vel_max.is_some(),
    }
}

fn field_of(quantity: &Quantity, newest: &Rule, draft: &Draft) -> Field {
    match quantity.kind {
        Kind::Distance => Field::Buffer,
        Kind::Speed | Kind::Fraction => Field::Speed,
        Kind::TurnRate => Field::TurnRate,
        Kind::Bare | Kind::Duration if draft.has_any(&[Sense::SpeedNoun, Sense::Slow, Sense::Slower]) => {
            Field::Speed
        }
        Kind::Bare | Kind::Duration => match newest.rule_type {
            RuleType::Exclusion => Field::Buffer,
            RuleType::Kinematic if newest.vel_max.is_some() => Field::Speed,
            RuleType::Kinematic => Field::TurnRate,
        },
    }
}

fn change(
    draft: &Draft,
    pool: &[&Rule],
    scales: Option<(Option<Field>, f64)>,
    profile: &Profile,
) -> Result<Option<Change>, Trouble> {
    let Some(newest) = pool.last().copied() else {
        return Err(Trouble::Ask("There are no rules in force. What should I heed?".into()));
    };
    let number = draft.quantities.iter().find(|q| !(q.kind == Kind::Fraction && scales.is_some()));
    let field = match (number, scales) {
        (Some(quantity), _) => field_of(quantity, newest, draft),
        (None, Some((field, _))) => field.unwrap_or(if newest.rule_type == RuleType::Exclusion {
            Field::Buffer
        } else {
            Field::Speed
        }),
        (None, None) if draft.ttl_s.is_some() => {
            let target = pool.iter().rev().find(|rule| rule.ttl_s.is_some()).unwrap_or(&newest);
            return Ok(Some(replaced(target, Rule { ttl_s: draft.ttl_s, ..(*target).clone() }, "ttl_s")));
        }
        (None, None) => return Err(Trouble::Ask("Change it to what?".into())),
    };
    let Some(target) = pool.iter().rev().copied().find(|rule| holds(rule, field)) else {
        // "slower" where only distances are ruled is an order of its own.
        return if field == Field::Speed {
            Ok(None)
        } else {
            Err(Trouble::Ask("Which rule should I change?".into()))
        };
    };
    let factor = if number.is_some() { None } else { scales.map(|(_, factor)| factor) };
    let mut rule = target.clone();
    rule.ttl_s = draft.ttl_s.or(rule.ttl_s);
    let value = |old: f64| match (factor, number) {
        (Some(factor), _) => old * factor,
        (None, Some(quantity)) if quantity.by && quantity.kind == Kind::Distance => {
            if draft.has_any(&[Sense::Closer]) { old - quantity.value } else { old + quantity.value }
        }
        (None, Some(quantity)) if quantity.kind == Kind::Fraction => quantity.value * profile.speed_m_s_max,
        (None, Some(quantity))
            if ["another", "an extra"].iter().any(|more| quantity.said.starts_with(more)) =>
        {
            old + quantity.value
        }
        (None, Some(quantity)) => quantity.value,
        (None, None) => old,
    };
    let name = match field {
        Field::Buffer => {
            rule.buffer_m = round_safe(Kind::Distance, value(rule.buffer_m));
            "buffer_m"
        }
        Field::Speed => {
            rule.vel_max = rule.vel_max.map(|old| vague::floor(value(old)));
            // A comparative stays within the robot; a number beyond it is asked about by the check.
            if factor.is_some() {
                rule.vel_max = rule.vel_max.map(|speed| speed.min(profile.speed_m_s_max));
            }
            "vel_max"
        }
        Field::TurnRate => {
            rule.ang_vel_max = rule.ang_vel_max.map(|old| vague::floor(value(old)));
            "ang_vel_max"
        }
    };
    if field == Field::Buffer && rule.buffer_m <= 0.0 {
        return Err(Trouble::Ask("That would leave no distance at all. How far should it be?".into()));
    }
    Ok(Some(replaced(target, rule, name)))
}

fn replaced(old: &Rule, mut new: Rule, said: &str) -> Change {
    new.id = String::new();
    new.defaults.retain(|field| field != said);
    Change { lifted: vec![old.id.clone()], added: vec![new], is_revoke: false }
}
