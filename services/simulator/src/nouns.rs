//! Which labels a spoken phrase may mean: head nouns, plurals and synonyms, as an open-vocabulary model
//! would match them, only coarser.
//!
//! "The baby's crib by the window" has the head noun "crib". A phrase whose words are exactly some label
//! of the scene means those only ("standing desk"); any other means every label with its head noun. A
//! qualifier that no label carries ("red desk") is beyond this matcher, as it is beyond most models.

/// Words for the same thing, one group a line.
const SYNONYMS: &str = include_str!("synonyms.txt");

/// Words that stand before a noun and name no kind.
const PASSED_OVER: &[&str] = &[
    "the", "a", "an", "this", "that", "these", "those", "my", "our", "your", "his", "her", "their", "any",
    "all", "every", "each", "some",
];
/// Words after which a phrase only tells where the thing is.
const PLACE_WORDS: &[&str] = &[
    "by",
    "near",
    "beside",
    "next",
    "in",
    "on",
    "at",
    "under",
    "underneath",
    "beneath",
    "behind",
    "with",
    "of",
    "to",
    "from",
    "between",
    "over",
    "above",
    "against",
    "that",
    "which",
    "who",
    "where",
];

/// For each label, whether the phrase may mean it.
#[must_use]
pub fn meant(phrase: &str, labels: &[&str]) -> Vec<bool> {
    let said = words(phrase);
    let exact: Vec<bool> = labels.iter().map(|label| words(label) == said && !said.is_empty()).collect();
    // A bare noun never narrows: "desk" means the standing desk too.
    if said.len() > 1 && exact.contains(&true) {
        return exact;
    }
    let Some(head) = said.last() else { return vec![false; labels.len()] };
    labels.iter().map(|label| words(label).last().is_some_and(|noun| same_kind(noun, head))).collect()
}

/// The words that name the thing, in the singular and in lower case; the head noun last.
fn words(phrase: &str) -> Vec<String> {
    let lower = phrase.to_lowercase().replace("'s ", " ").replace("’s ", " ");
    let mut named = Vec::new();
    for word in lower.split(|c: char| !c.is_alphanumeric()).filter(|w| !w.is_empty()) {
        if PASSED_OVER.contains(&word) && named.is_empty() {
            continue;
        }
        if PLACE_WORDS.contains(&word) && !named.is_empty() {
            break;
        }
        named.push(singular(word));
    }
    named
}

fn same_kind(noun: &str, other: &str) -> bool {
    noun == other
        || SYNONYMS.lines().filter(|line| !line.starts_with('#')).any(|line| {
            let has = |wanted: &str| line.split(',').any(|word| singular(word.trim()) == wanted);
            has(noun) && has(other)
        })
}

/// The singular of an English noun, well enough for furniture.
fn singular(word: &str) -> String {
    match word {
        "shelves" | "bookshelves" => return word.replace("ves", "f"),
        "knives" => return "knife".into(),
        "people" => return "person".into(),
        "men" => return "man".into(),
        "women" => return "woman".into(),
        "children" => return "child".into(),
        "mice" => return "mouse".into(),
        // Not plurals.
        "glass" | "canvas" | "bus" | "gas" | "cactus" | "stairs" => return word.into(),
        _ => {}
    }
    let cut = |n: usize| word.get(..word.len().saturating_sub(n)).unwrap_or(word);
    let hisses = ["ches", "shes", "sses", "xes", "zes"].iter().any(|end| word.ends_with(end));
    if word.len() > 4 && word.ends_with("ies") {
        format!("{}y", cut(3))
    } else if hisses {
        cut(2).into()
    } else if word.len() > 3 && word.ends_with('s') && !word.ends_with("ss") && !word.ends_with("us") {
        cut(1).into()
    } else if word == "tvs" {
        "tv".into()
    } else {
        word.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LABELS: &[&str] =
        &["standing desk", "desk", "office chair", "couch", "bookshelf", "television", "wall", "floor"];

    #[track_caller]
    fn check(phrase: &str, wanted: &[&str]) {
        let meant = meant(phrase, LABELS);
        let found: Vec<&str> = LABELS.iter().zip(meant).filter(|(_, m)| *m).map(|(l, _)| *l).collect();
        assert_eq!(found, wanted, "{phrase}");
    }

    #[test]
    fn a_qualified_phrase_means_the_labels_that_say_the_same_and_else_the_whole_kind() {
        check("standing desk", &["standing desk"]);
        check("the Standing Desks", &["standing desk"]);
        check("desk", &["standing desk", "desk"]);
        check("desks", &["standing desk", "desk"]);
        check("wooden desk", &["standing desk", "desk"]);
    }

    #[test]
    fn synonyms_plurals_and_owners_are_understood() {
        check("sofa", &["couch"]);
        check("sofas", &["couch"]);
        check("TV", &["television"]);
        check("shelves", &["bookshelf"]);
        check("grandma's chairs", &["office chair"]);
        check("armchair", &["office chair"]);
    }

    #[test]
    fn where_a_thing_is_does_not_change_what_it_is() {
        check("chair by the standing desk", &["office chair"]);
        check("the couch next to the wall", &["couch"]);
    }

    #[test]
    fn what_is_not_there_is_not_found() {
        check("piano", &[]);
        check("", &[]);
        check("the", &[]);
        check("chairman", &[]);
    }
}
