//! From what a model wrote to a reply that may be given.
//!
//! Everything is held against the words: numbers that were not said, objects that were not named, rules
//! lifted that were not spoken of, all lead to a question. What the robot says is made from the rules,
//! never taken from the model.

use geometry::Profile;
use rules::schema::{DraftReply, DraftRule};
use rules::{Outcome, RefuseReason, Reply, ReplyOption, Rule, english, tighten};

use crate::admission::{clarify, refuse, revocation};
use crate::decider::ModelTask;

/// Most rules of one utterance. Chosen: more cannot be read back in one breath.
const N_RULES_MAX: usize = 8;
/// Longest question taken from a model, characters.
const N_QUESTION_CHARS_MAX: usize = 300;
/// Longest label taken from a model, characters.
const N_LABEL_CHARS_MAX: usize = 80;

/// What was said, with what it may answer.
pub(super) struct Said {
    text: String,
}

impl Said {
    pub(super) fn of(task: &ModelTask) -> Said {
        let before = task.before.as_ref().map(|(said, _)| format!("{said} ")).unwrap_or_default();
        Said { text: format!("{before}{}", task.text) }
    }

    /// The refusal of the gate, if the words ask to loosen the base safety.
    pub(super) fn held_back(&self) -> Option<Reply> {
        utterance::gate::is_unsafe(&self.text).map(|_| refuse(RefuseReason::Unsafe, ""))
    }

    /// Whether every content word of `phrase` was said, or is in the phrase of an active rule.
    fn names(&self, phrase: &str, active: &[Rule]) -> bool {
        let mut known = stems(&self.text);
        for rule in active {
            known.extend(stems(rule.phrase()));
            known.extend(stems(rule.obj2.as_deref().unwrap_or_default()));
        }
        let wanted = stems(phrase);
        !wanted.is_empty() && wanted.iter().all(|word| known.contains(word))
    }
}

/// The draft in a model's message: the object in it, with or without a fence around.
pub(super) fn read(content: &str) -> Result<DraftReply, String> {
    let start = content.find('{').ok_or("no JSON object")?;
    let end = content.rfind('}').filter(|end| *end > start).ok_or("a JSON object without its end")?;
    let object = content.get(start..=end).ok_or("no JSON object")?;
    serde_json::from_str(object).map_err(|reason| format!("against the schema: {reason}"))
}

/// The reply that a draft leads to.
pub(super) fn judge(
    draft: DraftReply,
    said: &Said,
    active: &[Rule],
    profile: &Profile,
    parser: &str,
) -> Reply {
    if let Some(reply) = said.held_back() {
        return reply;
    }
    match draft.outcome {
        Outcome::Accept => accept(draft, said, active, profile, parser),
        Outcome::Revoke => lift(draft.revoked, said, active, profile),
        Outcome::Clarify => question(&draft, active, profile),
        Outcome::Refuse => refuse(draft.reason.unwrap_or(RefuseReason::NotSafety), ""),
    }
}

fn accept(draft: DraftReply, said: &Said, active: &[Rule], profile: &Profile, parser: &str) -> Reply {
    let n_rules = draft.specs.len();
    if !(1..=N_RULES_MAX).contains(&n_rules) {
        return clarify("I could not make that out. What should I heed?", vec![]);
    }
    let specs: Vec<Rule> =
        draft.specs.into_iter().map(|rule| tidied(rule).into_rule(&said.text, parser)).collect();
    if let Err(reason) = specs.iter().try_for_each(|rule| rule.check(profile)) {
        return clarify(&format!("I can't hold that: {reason}. What should it be?"), vec![]);
    }
    if let Err(reason) = utterance::fidelity::check(&said.text, &specs, active, profile) {
        return clarify(
            &format!("I am not sure of the numbers: {reason}. Which number do you mean?"),
            vec![],
        );
    }
    if let Some((field, value)) = specs.iter().find_map(|rule| odd_default(rule, profile)) {
        let question =
            format!("You gave no number, and {field} = {value} is not what I take then. What should it be?");
        return clarify(&question, vec![]);
    }
    let unnamed = specs.iter().flat_map(named_by).find(|phrase| !said.names(phrase, active));
    if let Some(phrase) = unnamed {
        return clarify(&format!("You did not say \u{201c}{phrase}\u{201d}. What do you mean?"), vec![]);
    }
    let mut lines: Vec<String> = vec![english::read_back_all(&specs)];
    lines.extend(specs.iter().filter_map(english::taken_defaults).map(|taken| format!("{taken}.")));
    let replaced = tighten::replaced(active, &specs);
    let reply = Reply { specs, revoked: draft.revoked, say: lines.join(" "), ..Reply::of(Outcome::Accept) };
    let unjustified: Vec<&Rule> = active
        .iter()
        .filter(|rule| reply.revoked.contains(&rule.id) && !replaced.contains(&rule.id))
        .filter(|rule| !is_spoken_of(rule, said, active, profile))
        .collect();
    if unjustified.is_empty() { reply } else { confirm(&unjustified, reply.clone()) }
}

fn lift(revoked: Vec<String>, said: &Said, active: &[Rule], profile: &Profile) -> Reply {
    let gone: Vec<&Rule> = active.iter().filter(|rule| revoked.contains(&rule.id)).collect();
    if gone.is_empty() {
        return revocation(vec![], "There is no such rule.".into());
    }
    let names: Vec<String> = gone.iter().map(|rule| english::status(rule)).collect();
    let ids = gone.iter().map(|rule| rule.id.clone()).collect();
    let reply = revocation(ids, format!("I no longer heed: {}.", english::and_list(&names)));
    let unjustified: Vec<&Rule> =
        gone.into_iter().filter(|rule| !is_spoken_of(rule, said, active, profile)).collect();
    if unjustified.is_empty() { reply } else { confirm(&unjustified, reply) }
}

/// Whether the words name the rule's object, or mean the rule by the offline parser's own reading.
fn is_spoken_of(rule: &Rule, said: &Said, active: &[Rule], profile: &Profile) -> bool {
    let is_named = rule.needs_grounding() && said.names(&rule.obj, &[]);
    is_named || utterance::parse(active, profile, &said.text).revoked.contains(&rule.id)
}

/// A rule is lifted on the person's word only.
fn confirm(rules: &[&Rule], reply: Reply) -> Reply {
    let names: Vec<String> = rules.iter().map(|rule| english::status(rule)).collect();
    let keep = revocation(vec![], "All rules stay.".into());
    clarify(
        &format!("Shall I drop the rule: {}?", english::and_list(&names)),
        vec![
            ReplyOption { label: "yes, drop it".into(), reply },
            ReplyOption { label: "no, keep it".into(), reply: keep },
        ],
    )
}

fn question(draft: &DraftReply, active: &[Rule], profile: &Profile) -> Reply {
    let asked = plain(draft.question.as_deref().unwrap_or_default(), N_QUESTION_CHARS_MAX);
    let asked = if asked.is_empty() || utterance::gate::is_unsafe(&asked).is_some() {
        "What should I heed?".to_owned()
    } else {
        asked
    };
    let options = draft
        .options
        .iter()
        .map(|option| plain(&option.label, N_LABEL_CHARS_MAX))
        .filter(|label| !label.is_empty() && utterance::gate::is_unsafe(label).is_none())
        .take(4)
        .map(|label| {
            let reading = utterance::parse(active, profile, &label);
            let reply = match reading.outcome {
                Outcome::Accept => reading,
                // The label is parsed anew when it is picked.
                _ => clarify("", vec![]),
            };
            ReplyOption { label, reply }
        })
        .collect();
    clarify(&asked, options)
}

/// The first field that was filled in with a number that no vague word stands for.
fn odd_default(rule: &Rule, profile: &Profile) -> Option<(&'static str, f64)> {
    use utterance::vague::{self, ACTIVATION_M, AVOID_M, AWAY_M, DROP_M, QUIET_M, WIDE_M};
    let distances = [AVOID_M, AWAY_M, WIDE_M, ACTIVATION_M, QUIET_M, DROP_M];
    let speeds = [vague::slow_m_s(profile), vague::crawl_m_s(profile), vague::walk_m_s(profile), 0.0];
    let rates = [vague::turn_slow_rad_s(profile), 0.0];
    // Only the regions that have no margin of their own may be filled in with none.
    let may_be_bare = rule.relation != rules::Relation::Near;
    let fields: [(&'static str, Option<f64>, &[f64]); 3] = [
        ("buffer_m", (rule.buffer_m > 0.0 || !may_be_bare).then_some(rule.buffer_m), &distances),
        ("vel_max", rule.vel_max, &speeds),
        ("ang_vel_max", rule.ang_vel_max, &rates),
    ];
    fields.into_iter().find_map(|(field, value, table)| {
        let value = value.filter(|_| rule.defaults.iter().any(|name| name == field))?;
        // As much slack as said numbers have.
        let slack = utterance::fidelity::RELATIVE_SLACK;
        let is_known = table.iter().any(|known| (value - known).abs() <= slack * known);
        (!is_known).then_some((field, value))
    })
}

/// Names in the form the rules want them; nothing that changes their meaning.
fn tidied(mut rule: DraftRule) -> DraftRule {
    for name in [&mut rule.obj, &mut rule.reference] {
        *name = plain(name, usize::MAX).to_lowercase();
    }
    rule.obj2 = rule.obj2.map(|name| plain(&name, usize::MAX).to_lowercase()).filter(|name| !name.is_empty());
    if rule.relation == rules::Relation::Global {
        (rule.obj, rule.reference) = (String::new(), String::new());
    }
    rule
}

fn named_by(rule: &Rule) -> impl Iterator<Item = &str> {
    let names = [rule.obj.as_str(), rule.phrase(), rule.obj2.as_deref().unwrap_or_default()];
    names.into_iter().chain(rule.except.iter().map(String::as_str)).filter(|name| !name.is_empty())
}

/// One line of printable text.
fn plain(text: &str, n_chars_max: usize) -> String {
    let words: Vec<&str> = text.split_whitespace().collect();
    words.join(" ").chars().filter(|c| !c.is_control()).take(n_chars_max).collect()
}

/// The content words of a phrase without their plural endings.
fn stems(phrase: &str) -> Vec<String> {
    const EMPTY: [&str; 12] =
        ["the", "a", "an", "my", "your", "our", "his", "her", "their", "any", "all", "s"];
    phrase
        .to_lowercase()
        .split(|c: char| !c.is_alphanumeric())
        .filter(|word| !word.is_empty() && !EMPTY.contains(word))
        .map(stem)
        .collect()
}

fn stem(word: &str) -> String {
    const IRREGULAR: [(&str, &str); 7] = [
        ("people", "person"),
        ("children", "child"),
        ("men", "man"),
        ("women", "woman"),
        ("shelves", "shelf"),
        ("knives", "knife"),
        ("feet", "foot"),
    ];
    if let Some((_, one)) = IRREGULAR.iter().find(|(many, _)| *many == word) {
        return (*one).to_owned();
    }
    let cut = |ending: &str| word.strip_suffix(ending).filter(|rest| rest.len() > 2);
    if let Some(rest) = cut("ies") {
        return format!("{rest}y");
    }
    let is_es = ["ches", "shes", "sses", "xes", "zes"].iter().any(|ending| word.ends_with(ending));
    let is_s = !["ss", "us", "is"].iter().any(|ending| word.ends_with(ending));
    let rest = if is_es {
        cut("es")
    } else if is_s {
        cut("s")
    } else {
        None
    };
    rest.unwrap_or(word).to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(text: &str, phrase: &str, wanted: bool) {
        assert_eq!(Said { text: text.into() }.names(phrase, &[]), wanted, "{phrase:?} in {text:?}");
    }

    #[test]
    fn an_object_counts_as_said_in_singular_or_plural_and_no_other_way() {
        check("keep away from cars", "car", true);
        check("mind the baby's crib", "crib", true);
        check("mind the baby's crib", "baby's crib", true);
        check("avoid the glass shelves", "glass shelf", true);
        check("watch the babies", "baby", true);
        check("avoid the couch", "sofa", false);
        check("avoid the red sofa", "blue sofa", false);
        check("avoid the carpet", "car", false);
        check("avoid it", "", false);
    }

    #[test]
    fn a_pronoun_may_stand_for_the_object_of_an_active_rule() {
        let rug = Rule::exclusion(rules::Relation::On, "rug");
        assert!(Said { text: "make that one metre".into() }.names("rug", &[rug]));
    }

    #[test]
    fn a_draft_is_found_in_a_fence_and_cut_off_ones_are_not() {
        let draft = r#"{"outcome":"clarify","specs":[],"revoked":[],"question":"What?","options":[],"reason":null,"say":"What?"}"#;
        assert!(read(draft).is_ok());
        assert!(read(&format!("```json\n{draft}\n```")).is_ok());
        assert!(read(&draft[..40]).unwrap_err().contains("without its end"));
        assert!(read("I think so").unwrap_err().contains("no JSON object"));
        let extra = draft.replace("\"say\"", "\"override\":true,\"say\"");
        assert!(read(&extra).unwrap_err().contains("override"));
    }
}
