//! Numbers and manners that complete the order before them.

use super::{Joiner, Last};
use crate::clause::{Clause, TALK, is_limit};
use crate::draft::Draft;
use crate::lexicon::Sense;
use crate::quantity::{Bound, Kind};
use crate::segment::Join;

impl Joiner {
    /// "slow down near the bed, no more than 0.2 m/s": numbers that complete the order before.
    pub(super) fn joined_to_last(&mut self, clause: &Clause) -> bool {
        let new = &clause.draft;
        let same_sentence =
            matches!(new.join, Some(Join::Comma | Join::And | Join::Bare | Join::So | Join::Start));
        let Some(last) = self.out.orders.last_mut().filter(|_| same_sentence && self.last == Last::Order)
        else {
            return false;
        };
        let old = &mut last.draft;
        let bare_new = new.regions.is_empty()
            && new.names.is_empty()
            && new.ttl_s.is_none()
            && !new.has(Sense::Everywhere)
            && !new.has_any(&TALK);
        let numbers_only = bare_new
            && new.senses.iter().all(|sense| {
                matches!(
                    sense,
                    Sense::SpeedNoun
                        | Sense::Motion
                        | Sense::Away
                        | Sense::Hold
                        | Sense::From
                        | Sense::Turn
                        | Sense::Dampen
                        | Sense::OpenEnded
                )
            })
            && !new.quantities.is_empty();
        let n_distances = new.quantities.iter().filter(|q| q.kind == Kind::Distance).count();
        // "slower still, say 0.2"
        let bare_speed =
            new.quantities.iter().all(|q| q.kind == Kind::Bare) && new.senses.is_empty() && is_limit(old);
        let limits_both = is_limit(old) && (is_limit(new) || bare_speed) && n_distances == 0;
        let distance_for = n_distances == 1
            && new.quantities.len() == 1
            && old.quantity(Kind::Distance).is_none()
            && !is_limit(new);
        let same_slot = old.quantities.iter().any(|q| new.quantities.iter().any(|n| n.kind == q.kind));
        if numbers_only && !same_slot && (limits_both || distance_for) && new.n_neg + old.n_neg.min(1) <= 2 {
            let negated_number = new.is_negated();
            for quantity in &new.quantities {
                let mut quantity = quantity.clone();
                if negated_number && quantity.bound == Bound::Over {
                    quantity.bound = Bound::Upper;
                }
                old.quantities.push(quantity);
            }
            old.words = format!("{} {}", old.words, new.words);
            return true;
        }
        share_with_old(old, new);
        false
    }
}

/// A bare manner takes the place of the one that follows it.
fn share_with_old(old: &mut Draft, new: &Draft) {
    // "drive slowly and turn slowly near the piano": both near the piano.
    let turn = |draft: &Draft| {
        draft.has_any(&[Sense::TurnSlow, Sense::Turn, Sense::TurnFast])
            || draft.quantity(Kind::TurnRate).is_some()
    };
    let bare_old = old.regions.is_empty() && old.names.is_empty() && !old.has(Sense::Everywhere);
    // "slowly and quietly past room 4": one manner.
    const MANNERS: [&str; 12] = [
        "quiet",
        "quietly",
        "gentle",
        "gently",
        "careful",
        "carefully",
        "slow",
        "slowly",
        "steady",
        "calm",
        "calmly",
        "cautiously",
    ];
    let one_manner = bare_old
        && matches!(new.join, Some(Join::And))
        && old.quantities.is_empty()
        && is_limit(old)
        && is_limit(new)
        && new.words.split(' ').next().is_some_and(|word| MANNERS.contains(&word));
    if one_manner {
        old.regions.clone_from(&new.regions);
        old.names.clone_from(&new.names);
        old.ttl_s = old.ttl_s.or(new.ttl_s);
    }
    if bare_old
        && matches!(new.join, Some(Join::And))
        && is_limit(old)
        && is_limit(new)
        && turn(old) != turn(new)
    {
        old.regions.clone_from(&new.regions);
        old.names.clone_from(&new.names);
        old.ttl_s = old.ttl_s.or(new.ttl_s);
    }
}
