//! What a phrase does to the draft: the special cases first, then the sense that the context asks for.

use super::choose::choose;
use super::{Before, Scanner};
use crate::item::{Item, Sort};
use crate::lexicon::{GOING, Sense};
use crate::noun::Name;
use crate::quantity::Kind;

impl Scanner<'_> {
    pub(super) fn sense(&mut self, item: &Item) {
        let Sort::Phrase(senses) = item.sort else { return };
        if self.special(item) {
            return;
        }
        let chosen = choose(item, senses, &self.draft, self.peek(0));
        match chosen {
            // "never, never": said twice, meant once.
            Some(Sense::Neg) if self.follows_negation() => {}
            Some(Sense::Neg) => self.draft.n_neg += 1,
            Some(Sense::TimeWords) => self.draft.unobservable = Some(item.text.clone()),
            Some(Sense::Except | Sense::But) => {
                self.before = Before::Except;
                return;
            }
            Some(Sense::Copula) => {
                self.draft.senses.push(Sense::Copula);
                self.before = Before::Copula;
                return;
            }
            Some(Sense::Filler | Sense::Det) | None => {
                // Fillers leave the grammar as it was: "slow, um, down".
                if self.before == Before::Copula {
                    return;
                }
                if !matches!(self.before, Before::Place(_) | Before::Except) && !self.draft.names.is_empty() {
                    self.before = Before::Other;
                }
                return;
            }
            Some(Sense::Statement) if !self.draft.names.is_empty() || self.draft.has(Sense::Subject) => {
                self.draft.senses.push(Sense::Statement);
                self.before = Before::Told;
                return;
            }
            Some(Sense::Careful) if item.text.ends_with("made of") => {
                // "like it is made of glass": of what is no matter.
                self.draft.senses.push(Sense::Careful);
                self.at = self.items.len();
            }
            Some(Sense::AsWell) if self.before == Before::LooseName && item.text == "also" => return,
            Some(sense) => self.draft.senses.push(sense),
        }
        self.before = Before::Other;
    }

    /// Phrases that mean something else in their surroundings; whether this is one.
    fn special(&mut self, item: &Item) -> bool {
        let next_is_deed = self.peek(0).is_some_and(|next| {
            next.is_any(&GOING)
                || next.is_any(&[
                    Sense::VerbWake,
                    Sense::VerbLeave,
                    Sense::Turn,
                    Sense::TurnFast,
                    Sense::Fast,
                ])
        });
        // "avoid going under", "stop bumping into": a negation.
        let gerund_next = next_is_deed
            && self.peek(0).is_some_and(|next| {
                next.text.split(' ').any(|word| word.ends_with("ing"))
                    || (item.is(Sense::Avoid) && next.is_any(&[Sense::TurnFast, Sense::Fast]))
            });
        if (item.is(Sense::Avoid) && item.text.starts_with("avoid")
            || item.text == "stop"
            || item.is(Sense::Away) && item.text == "away from")
            && gerund_next
        {
            self.draft.n_neg += 1;
            self.before = Before::Other;
            return true;
        }
        // "it also splashes"
        if item.text == "also" && self.before == Before::LooseName {
            return true;
        }
        // "the cat does not move": told of the cat.
        if self.before == Before::LooseName
            && matches!(item.text.as_str(), "does not" | "did not")
            && self.draft.senses.is_empty()
        {
            self.draft.senses.push(Sense::Statement);
            self.before = Before::Told;
            return true;
        }
        // "you cannot swim": a deed that we do not know, told.
        if matches!(item.text.as_str(), "can not" | "could not")
            && self.draft.names.is_empty()
            && self.peek(0).is_some_and(Item::is_word)
            && self.peek(1).is_none()
        {
            self.draft.senses.push(Sense::Statement);
            self.before = Before::Told;
            return true;
        }
        // "give me a metre": from me.
        let space_next = self.peek(0).is_some_and(|next| {
            matches!(&next.sort, Sort::Quantity(q) if q.kind == Kind::Distance)
                || next.is_any(&[Sense::Away, Sense::Wide])
        });
        if item.text == "give me" && space_next {
            self.draft.senses.push(Sense::Hold);
            let me = Name { obj: "me".into(), reference: "me".into(), n_words: 1, ..Name::default() };
            self.draft.names.push(me);
            self.before = Before::Other;
            return true;
        }
        false
    }

    /// Whether the item before the one just read was a negation too.
    fn follows_negation(&self) -> bool {
        let before = self.at.checked_sub(2).and_then(|idx| self.items.get(idx));
        before.is_some_and(|item| item.is(Sense::Neg)) && self.draft.n_neg > 0
    }
}
