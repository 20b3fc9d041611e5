//! Whether rules carry the numbers that were said: no number lost, none invented.
//!
//! Meant for rules that another parser wrote. Exactness is not asked for: a model may round two
//! feet to 0.61 m, within [`RELATIVE_SLACK`].

use geometry::Profile;
use rules::Rule;

use crate::quantity::{Kind, Quantity, extract};

/// Relative difference at which a number still counts as the one said. Chosen: rounding to two digits.
pub const RELATIVE_SLACK: f64 = 0.02;

/// A number that was said and is in no rule, or is in a rule and was not said.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Unfaithful {
    /// Said, but in no rule.
    #[error("\"{said}\" was said and is in no rule")]
    Lost {
        /// The words.
        said: String,
    },
    /// In a rule, but not said, not marked as filled in, and not in any active rule.
    #[error("{field} = {value} was not said")]
    Invented {
        /// Field on the wire.
        field: &'static str,
        /// The value.
        value: f64,
    },
}

/// Whether `rules`, accepted for `text`, carry exactly the numbers that were said.
///
/// Numbers of `active` rules may be carried over. "double" and its like scale them, so any multiple
/// by 2, 1.5, 0.75 and 0.5 counts as carried over.
///
/// # Errors
/// [`Unfaithful`] names the first number lost or invented.
pub fn check(text: &str, rules: &[Rule], active: &[Rule], profile: &Profile) -> Result<(), Unfaithful> {
    let said = extract(text);
    let held: Vec<(&'static str, f64, bool)> = rules.iter().flat_map(fields).collect();
    for quantity in &said {
        let found = held.iter().any(|(field, value, _)| means(quantity, field, *value, profile));
        // A bare number may be a name or a count ("room 3"); it only has to be found when nothing else is.
        if !found && quantity.kind != Kind::Bare {
            return Err(Unfaithful::Lost { said: quantity.said.clone() });
        }
    }
    let old: Vec<f64> = active.iter().flat_map(fields).map(|(_, value, _)| value).collect();
    for (field, value, filled_in) in held {
        let carried =
            old.iter().any(|old| [1.0, 2.0, 1.5, 0.75, 0.5].iter().any(|factor| close(old * factor, value)));
        let stopping = field != "buffer_m" && value == 0.0;
        let named = said.iter().any(|quantity| means(quantity, field, value, profile));
        if !(filled_in || carried || named || stopping || field == "buffer_m" && value == 0.0) {
            return Err(Unfaithful::Invented { field, value });
        }
    }
    Ok(())
}

/// The numbers of a rule: field, value, and whether it was filled in.
fn fields(rule: &Rule) -> Vec<(&'static str, f64, bool)> {
    let values = [
        ("buffer_m", Some(rule.buffer_m)),
        ("vel_max", rule.vel_max),
        ("ang_vel_max", rule.ang_vel_max),
        ("ttl_s", rule.ttl_s.map(|seconds| seconds as f64)),
    ];
    let filled_in = |field: &str| rule.defaults.iter().any(|name| name == field);
    values
        .into_iter()
        .filter_map(|(field, value)| value.map(|value| (field, value, filled_in(field))))
        .collect()
}

fn means(quantity: &Quantity, field: &str, value: f64, profile: &Profile) -> bool {
    let share = if quantity.by { 1.0 - quantity.value } else { quantity.value };
    match (quantity.kind, field) {
        (Kind::Distance, "buffer_m")
        | (Kind::Speed, "vel_max")
        | (Kind::TurnRate, "ang_vel_max")
        | (Kind::Duration, "ttl_s")
        | (Kind::Bare, _) => close(quantity.value, value),
        (Kind::Fraction, "vel_max") => close(share * profile.speed_m_s_max, value),
        (Kind::Fraction, "ang_vel_max") => close(share * profile.yaw_rate_rad_s_max, value),
        _ => false,
    }
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= RELATIVE_SLACK * a.abs().max(b.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rules::Relation;

    #[track_caller]
    fn check_text(text: &str, rule: Rule, faithful: bool) {
        let found = check(text, &[rule], &[], &Profile::sim());
        assert_eq!(found.is_ok(), faithful, "{text}: {found:?}");
    }

    fn rug(buffer_m: f64) -> Rule {
        Rule { buffer_m, ..Rule::exclusion(Relation::Near, "rug") }
    }

    #[test]
    fn numbers_are_compared_in_si_units() {
        check_text("keep two feet from the rug", rug(0.61), true);
        check_text("keep two feet from the rug", rug(2.0), false);
        check_text("keep two feet from the rug", rug(0.5), false);
    }

    #[test]
    fn an_unsaid_number_must_be_marked_as_filled_in() {
        check_text("avoid the rug", rug(0.3), false);
        check_text("avoid the rug", Rule { defaults: vec!["buffer_m".into()], ..rug(0.3) }, true);
    }

    #[test]
    fn shares_are_of_the_robots_top_speed() {
        let half = Rule { vel_max: Some(0.75), ..Rule::kinematic(Relation::Global, "") };
        check_text("half speed please", half.clone(), true);
        check_text("quarter speed please", half, false);
    }

    #[test]
    fn a_lifetime_may_not_be_lost() {
        check_text(
            "avoid the rug for ten minutes",
            Rule { defaults: vec!["buffer_m".into()], ..rug(0.3) },
            false,
        );
    }
}
