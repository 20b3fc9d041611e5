//! What is only told beside a rule: "the boards are new and creak a bit, keep off them".
//!
//! Asked only when the plain reading ends in a question. A stretch is background when it declares how some third
//! thing is, and neither forbids, allows, limits, measures nor speaks to the robot; its verb need not be known. What
//! it names stays what "it" and "there" may mean. It never decides whether there is a rule.

use crate::draft::Draft;
use crate::item::{Item, Sort};
use crate::lexicon::Sense;
use crate::segment::Join;
use crate::speech::{Speech, speech};

/// Senses that make a stretch more than background.
const TELLING: [Sense; 24] = [
    Sense::Neg,
    Sense::Avoid,
    Sense::Wide,
    Sense::StayOff,
    Sense::Contain,
    Sense::Slow,
    Sense::Slower,
    Sense::Faster,
    Sense::Wider,
    Sense::Closer,
    Sense::Crawl,
    Sense::WalkPace,
    Sense::Halt,
    Sense::TurnSlow,
    Sense::SpeedNoun,
    Sense::OffLimits,
    Sense::Careful,
    Sense::Quiet,
    Sense::Revoke,
    Sense::Allow,
    Sense::Fine,
    Sense::Question,
    Sense::Except,
    Sense::SelfRef,
];

/// The drafts with those that are only background made stories.
#[must_use]
pub fn told(drafts: Vec<(Draft, &[Item])>) -> Vec<Draft> {
    let mut after_story = false;
    let mut out = Vec::with_capacity(drafts.len());
    // "the painters finished the door, keep off it": which of the two?
    let n_named = |draft: &Draft| draft.all_names().filter(|name| !name.is_pronoun).count();
    let plain: Vec<Draft> = drafts.iter().map(|(draft, _)| draft.clone()).collect();
    let (mut points_back, mut is_ambiguous) = (false, false);
    for (draft, items) in drafts {
        let goes_on =
            after_story && matches!(draft.join, Some(Join::And | Join::But | Join::If | Join::Because));
        let is_story = is_background(items, goes_on, !matches!(draft.join, Some(Join::And | Join::But)))
            && (goes_on || may_open(&draft));
        after_story = is_story;
        is_ambiguous |= is_story && n_named(&draft) + draft.told.len() + draft.whereabouts.len() > 1;
        points_back |= !is_story && draft.all_names().any(|name| name.is_pronoun);
        out.push(if is_story { as_story(draft) } else { draft });
    }
    if points_back && is_ambiguous { plain } else { out }
}

fn may_open(draft: &Draft) -> bool {
    matches!(
        draft.join,
        None | Some(Join::Start | Join::Comma | Join::Because | Join::And | Join::But | Join::Or)
    )
}

fn is_background(items: &[Item], goes_on: bool, is_tied: bool) -> bool {
    let plain = |item: &Item| item.is(Sense::Filler);
    let Some(first) = items.iter().find(|item| !plain(item) || item.is(Sense::Copula)) else { return false };
    let declares = |item: &Item| {
        item.is_any(&[Sense::Copula, Sense::ThereIs, Sense::Statement])
            || item.is_word() && matches!(speech(&item.text), Speech::Verb | Speech::Participle)
    };
    let opens = first.is_any(&[Sense::Det, Sense::Pronoun, Sense::Subject, Sense::ThereIs])
        || first.is_word() && speech(&first.text) != Speech::Verb;
    let n_told = items.iter().skip(1).filter(|item| declares(item)).count();
    let by_pronoun = first.is_any(&[Sense::Subject, Sense::ThereIs])
        || first.is(Sense::Pronoun)
            && items.get(1).is_some_and(|item| item.is_word() && item.text.ends_with('s'));
    let harmless = items.iter().all(|item| !item.is_any(&TELLING) && !matches!(item.sort, Sort::Quantity(_)));
    let goes_on = goes_on && (is_tied || items.iter().any(declares));
    harmless && (goes_on || opens && (n_told > 0 || by_pronoun))
}

/// Only what it names, and that it tells.
fn as_story(draft: Draft) -> Draft {
    let governed = draft.regions.into_iter().flat_map(|region| region.names);
    Draft {
        join: draft.join.map(|join| if join == Join::If { Join::Because } else { join }),
        is_fresh: draft.is_fresh,
        senses: vec![Sense::Statement],
        names: draft.names,
        told: draft.told,
        whereabouts: draft.whereabouts.into_iter().chain(governed).collect(),
        words: draft.words,
        ..Draft::default()
    }
}
