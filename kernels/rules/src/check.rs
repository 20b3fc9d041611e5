//! The door of the rule set: what may be enforced at all.
//!
//! Whoever wrote a rule (the offline parser, a language model, a file, the bus), it is enforced
//! only after [`Rule::check`]. Nothing is repaired here: a value outside its range is an error with
//! the field, the value and the limit, and the caller asks the person again.

use geometry::Profile;

use crate::rule::{BUFFER_M_MAX, NAME_CHARS_MAX, TEXT_CHARS_MAX};
use crate::{Relation, Rule, RuleType};

/// Longest lifetime of a rule, seconds: one year. Chosen: longer is "until revoked".
pub const TTL_S_MAX: u64 = 366 * 86_400;
/// Most exceptions in one rule. Chosen: more cannot be read back in one breath.
pub const EXCEPT_MAX: usize = 16;
/// The numeric fields that may have been filled in; what `defaults` may name.
pub const NUMERIC_FIELDS: [&str; 4] = ["buffer_m", "vel_max", "ang_vel_max", "ttl_s"];

/// Slack on the upper limits, relative: a limit that went through text must still be the limit.
const RELATIVE_SLACK: f64 = 1e-9;

/// A rule that must not be enforced.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RuleError {
    /// A number that is outside its range or not a number.
    #[error("{field} = {value}, must be within {low} to {high}")]
    Range {
        /// The field's name on the wire.
        field: &'static str,
        /// The value found.
        value: f64,
        /// Smallest value allowed.
        low: f64,
        /// Largest value allowed.
        high: f64,
    },
    /// A text with too many characters.
    #[error("{field} has {n_chars} characters, limit is {n_chars_max}")]
    TooLong {
        /// The field's name on the wire.
        field: &'static str,
        /// Characters found.
        n_chars: usize,
        /// Most characters allowed.
        n_chars_max: usize,
    },
    /// A list with too many entries.
    #[error("{field} has {n} entries, limit is {n_max}")]
    TooMany {
        /// The field's name on the wire.
        field: &'static str,
        /// Entries found.
        n: usize,
        /// Most entries allowed.
        n_max: usize,
    },
    /// A field that this kind of rule needs is empty.
    #[error("{field} is empty, a rule that is {kind} needs it")]
    Missing {
        /// The field's name on the wire.
        field: &'static str,
        /// Type and relation of the rule, in words.
        kind: &'static str,
    },
    /// A field that this kind of rule has no meaning for.
    #[error("{field} = {value:?}, a rule that is {kind} cannot have it")]
    Misplaced {
        /// The field's name on the wire.
        field: &'static str,
        /// The value found.
        value: String,
        /// Type and relation of the rule, in words.
        kind: &'static str,
    },
}

impl Rule {
    /// Whether this rule may be enforced on a robot of this profile.
    ///
    /// Ranges include both ends; NaN and infinities are out of every range.
    ///
    /// # Errors
    /// [`RuleError`] names the first field that is wrong, its value and the limit.
    pub fn check(&self, profile: &Profile) -> Result<(), RuleError> {
        self.check_texts()?;
        within("buffer_m", self.buffer_m, 0.0, BUFFER_M_MAX)?;
        if let Some(speed_m_s) = self.vel_max {
            within("vel_max", speed_m_s, 0.0, profile.speed_m_s_max)?;
        }
        if let Some(rate_rad_s) = self.ang_vel_max {
            within("ang_vel_max", rate_rad_s, 0.0, profile.yaw_rate_rad_s_max)?;
        }
        if let Some(ttl_s) = self.ttl_s {
            within("ttl_s", ttl_s as f64, 1.0, TTL_S_MAX as f64)?;
        }
        for coordinate in self.anchor.iter().flatten() {
            within("anchor", *coordinate, -1e6, 1e6)?;
        }
        self.check_type()?;
        self.check_objects()
    }

    fn check_texts(&self) -> Result<(), RuleError> {
        for (field, text, n_chars_max) in [
            ("id", &self.id, NAME_CHARS_MAX),
            ("obj", &self.obj, NAME_CHARS_MAX),
            ("ref", &self.reference, NAME_CHARS_MAX),
            ("parser", &self.parser, NAME_CHARS_MAX),
            ("text", &self.text, TEXT_CHARS_MAX),
        ] {
            short(field, text, n_chars_max)?;
        }
        if let Some(second) = &self.obj2 {
            short("obj2", second, NAME_CHARS_MAX)?;
        }
        for (field, list, n_max) in
            [("except", &self.except, EXCEPT_MAX), ("defaults", &self.defaults, NUMERIC_FIELDS.len())]
        {
            if list.len() > n_max {
                return Err(RuleError::TooMany { field, n: list.len(), n_max });
            }
            for entry in list {
                short(field, entry, NAME_CHARS_MAX)?;
            }
        }
        match self.defaults.iter().find(|name| !NUMERIC_FIELDS.contains(&name.as_str())) {
            Some(name) => Err(RuleError::Misplaced {
                field: "defaults",
                value: name.clone(),
                kind: "made of buffer_m, vel_max, ang_vel_max and ttl_s",
            }),
            None => Ok(()),
        }
    }

    fn check_type(&self) -> Result<(), RuleError> {
        let misplaced = |field, value: String, kind| Err(RuleError::Misplaced { field, value, kind });
        match self.rule_type {
            RuleType::Exclusion => {
                if self.relation == Relation::Global {
                    return misplaced("relation", "global".into(), "an exclusion");
                }
                // A limit inside a region nobody may enter would be dropped in silence.
                if let Some(speed_m_s) = self.vel_max {
                    return misplaced("vel_max", speed_m_s.to_string(), "an exclusion");
                }
                if let Some(rate_rad_s) = self.ang_vel_max {
                    return misplaced("ang_vel_max", rate_rad_s.to_string(), "an exclusion");
                }
            }
            RuleType::Kinematic => {
                if self.relation == Relation::Beyond {
                    return misplaced("relation", "beyond".into(), "kinematic");
                }
                if self.vel_max.is_none() && self.ang_vel_max.is_none() {
                    return Err(RuleError::Missing {
                        field: "vel_max",
                        kind: "kinematic without ang_vel_max",
                    });
                }
            }
        }
        Ok(())
    }

    fn check_objects(&self) -> Result<(), RuleError> {
        if self.relation != Relation::Global && self.obj.trim().is_empty() {
            return Err(RuleError::Missing { field: "obj", kind: "not global" });
        }
        let second = self.obj2.as_deref().map(str::trim).filter(|name| !name.is_empty());
        match (self.relation == Relation::Between, second) {
            (true, None) => Err(RuleError::Missing { field: "obj2", kind: "between" }),
            (false, Some(name)) => {
                Err(RuleError::Misplaced { field: "obj2", value: name.to_owned(), kind: "not between" })
            }
            _ => Ok(()),
        }
    }
}

fn within(field: &'static str, value: f64, low: f64, high: f64) -> Result<(), RuleError> {
    // Written so that NaN fails.
    if (low..=high * (1.0 + RELATIVE_SLACK)).contains(&value) {
        Ok(())
    } else {
        Err(RuleError::Range { field, value, low, high })
    }
}

fn short(field: &'static str, text: &str, n_chars_max: usize) -> Result<(), RuleError> {
    let n_chars = text.chars().count();
    if n_chars <= n_chars_max { Ok(()) } else { Err(RuleError::TooLong { field, n_chars, n_chars_max }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[track_caller]
    fn check(rule: &Rule, wrong_field: Option<&str>) {
        let found = rule.check(&Profile::sim());
        let field = found.as_ref().err().map(|error| match error {
            RuleError::Range { field, .. }
            | RuleError::TooLong { field, .. }
            | RuleError::TooMany { field, .. }
            | RuleError::Missing { field, .. }
            | RuleError::Misplaced { field, .. } => *field,
        });
        assert_eq!(field, wrong_field, "{found:?}");
    }

    fn rug() -> Rule {
        Rule { buffer_m: 0.5, ..Rule::exclusion(Relation::Near, "rug") }
    }

    fn slow() -> Rule {
        Rule { vel_max: Some(0.5), ..Rule::kinematic(Relation::Global, "") }
    }

    #[test]
    fn both_types_pass_at_the_ends_of_their_ranges() {
        check(&rug(), None);
        check(&Rule { buffer_m: 0.0, ..rug() }, None);
        check(&Rule { buffer_m: 5.0, ..rug() }, None);
        check(&Rule { vel_max: Some(0.0), ..slow() }, None);
        check(&Rule { vel_max: Some(1.5), ang_vel_max: Some(1.0), ttl_s: Some(1), ..slow() }, None);
    }

    #[test]
    fn one_past_the_range_names_its_field() {
        check(&Rule { buffer_m: 5.001, ..rug() }, Some("buffer_m"));
        check(&Rule { buffer_m: -0.001, ..rug() }, Some("buffer_m"));
        check(&Rule { buffer_m: f64::NAN, ..rug() }, Some("buffer_m"));
        check(&Rule { vel_max: Some(1.501), ..slow() }, Some("vel_max"));
        check(&Rule { vel_max: Some(f64::NAN), ..slow() }, Some("vel_max"));
        check(&Rule { ang_vel_max: Some(-0.1), ..slow() }, Some("ang_vel_max"));
        check(&Rule { ttl_s: Some(0), ..slow() }, Some("ttl_s"));
        check(&Rule { ttl_s: Some(u64::MAX), ..slow() }, Some("ttl_s"));
        check(&Rule { anchor: Some([0.0, f64::INFINITY, 0.0]), ..rug() }, Some("anchor"));
    }

    #[test]
    fn a_rule_without_meaning_is_an_error() {
        check(&Rule { relation: Relation::Global, ..rug() }, Some("relation"));
        check(&Rule { vel_max: Some(0.2), ..rug() }, Some("vel_max"));
        check(&Rule { vel_max: None, ..slow() }, Some("vel_max"));
        check(&Rule { relation: Relation::Between, ..rug() }, Some("obj2"));
        check(&Rule { obj2: Some("sofa".into()), ..rug() }, Some("obj2"));
        check(&Rule { relation: Relation::Between, obj2: Some("sofa".into()), ..rug() }, None);
        check(&Rule { obj: "  ".into(), ..rug() }, Some("obj"));
        check(&Rule { relation: Relation::Near, ..slow() }, Some("obj"));
        check(&Rule { relation: Relation::Beyond, obj: "door".into(), ..slow() }, Some("relation"));
    }

    #[test]
    fn long_texts_and_lists_are_errors() {
        check(&Rule { obj: "x".repeat(121), ..rug() }, Some("obj"));
        check(&Rule { reference: "é".repeat(120), ..rug() }, None);
        check(&Rule { text: "x".repeat(2001), ..rug() }, Some("text"));
        check(&Rule { except: vec!["a".into(); 17], ..rug() }, Some("except"));
        check(&Rule { defaults: vec!["speed".into()], ..rug() }, Some("defaults"));
    }

    #[test]
    fn the_message_carries_field_value_and_limit() {
        let error = Rule { buffer_m: 7.0, ..rug() }.check(&Profile::sim()).unwrap_err();
        assert_eq!(error.to_string(), "buffer_m = 7, must be within 0 to 5");
    }

    proptest! {
        #[test]
        fn whatever_passes_is_finite_and_within_the_robot(
            buffer_m in any::<f64>(), speed in any::<Option<f64>>(), rate in any::<Option<f64>>(),
        ) {
            let rule = Rule { buffer_m, vel_max: speed, ang_vel_max: rate, ..slow() };
            if rule.check(&Profile::sim()).is_ok() {
                prop_assert!((0.0..=5.0001).contains(&buffer_m));
                prop_assert!(speed.is_none_or(|v| (0.0..=1.50001).contains(&v)));
                prop_assert!(rate.is_none_or(|w| (0.0..=1.00001).contains(&w)));
            }
        }
    }
}
