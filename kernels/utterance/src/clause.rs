//! Clauses, and the signs by which a stretch of words is an order, a task or a story.

use crate::draft::{Draft, Place};
use crate::lexicon::{GOING, Sense};
use crate::noun::Name;
use crate::quantity::{Bound, Kind};

/// One order, with what was said around it.
#[derive(Clone, Debug, Default)]
pub struct Clause {
    /// The order.
    pub draft: Draft,
    /// Names mentioned before it, the likeliest last; what a pronoun may mean.
    pub antecedents: Vec<Name>,
    /// Names mentioned before it as places; what "there" and "on it" may mean.
    pub places: Vec<Name>,
    /// Names mentioned before it as where something is; what "there" means.
    pub spots: Vec<Name>,
    /// Names told of together before it: what "them" and "both" mean.
    pub group: Vec<Name>,
    /// Whether what was mentioned last is a gap or a side, which "there" and "it" then mean.
    pub follows_side: bool,
    /// Whether its place came from a condition said before it.
    pub is_conditioned: bool,
    /// Conditions the robot cannot observe, as said.
    pub notes: Vec<String>,
}

/// The clauses of an utterance, and what was told or asked besides.
#[derive(Clone, Debug, Default)]
pub struct Clauses {
    /// Orders, in their order.
    pub orders: Vec<Clause>,
    /// Statements without an order: what they are about, and whether a reason word led them.
    pub stories: Vec<Draft>,
    /// Tasks, chat and questions.
    pub others: Vec<Draft>,
    /// Names that nobody claimed.
    pub unclaimed: Vec<Name>,
    /// Words that nobody claimed.
    pub leftover: Vec<String>,
}

const LIMITS: [Sense; 9] = [
    Sense::Slow,
    Sense::Slower,
    Sense::Crawl,
    Sense::WalkPace,
    Sense::Halt,
    Sense::TurnSlow,
    Sense::SpeedNoun,
    Sense::Careful,
    Sense::Quiet,
];
/// Senses that keep the robot off or away; the first four by themselves.
pub const EXCLUSIONS: [Sense; 9] = [
    Sense::Avoid,
    Sense::Away,
    Sense::Wide,
    Sense::StayOff,
    Sense::OffLimits,
    Sense::Fragile,
    Sense::Sleeping,
    Sense::NeedsSpace,
    Sense::Closed,
];
/// Deeds besides going somewhere.
const DEEDS: [Sense; 7] = [
    Sense::VerbWake,
    Sense::VerbLeave,
    Sense::Fast,
    Sense::Turn,
    Sense::TurnFast,
    Sense::SelfRef,
    Sense::Contain,
];
/// Senses that talk about rules.
pub const TALK: [Sense; 13] = [
    Sense::Revoke,
    Sense::Lift,
    Sense::Allow,
    Sense::Make,
    Sense::Same,
    Sense::NormalSpeed,
    Sense::AsNormal,
    Sense::Faster,
    Sense::Wider,
    Sense::Closer,
    Sense::Double,
    Sense::Halve,
    Sense::Fine,
];

/// Whether the draft limits speed, turning or manner.
#[must_use]
pub fn is_limit(draft: &Draft) -> bool {
    draft.has_any(&LIMITS)
        || draft.quantities.iter().any(|q| match q.kind {
            Kind::Speed | Kind::TurnRate | Kind::Fraction => true,
            Kind::Bare => ["faster", "slower", "quicker"].iter().any(|word| q.said.contains(word)),
            Kind::Distance | Kind::Duration => false,
        })
        || draft.has_any(&[Sense::Fast, Sense::TurnFast])
        || (draft.is_negated() && draft.has(Sense::VerbWake))
}

/// Whether the draft says by itself what to do.
#[must_use]
pub fn is_order(draft: &Draft) -> bool {
    let positive_side = draft.has_any(&[Sense::Hold, Sense::Contain, Sense::VerbPast])
        && (draft.has_any(&[Sense::SelfLeft, Sense::SelfRight, Sense::SideLeft, Sense::SideRight])
            || draft.regions.iter().any(|region| {
                matches!(
                    region.place,
                    Place::Left | Place::Right | Place::Behind | Place::Front | Place::ThisSide
                )
            }));
    is_limit(draft)
        || draft.has_any(&EXCLUSIONS)
        || draft.has_any(&TALK)
        || draft.has(Sense::Contain)
        || (draft.n_neg > 0
            && (draft.has_any(&GOING)
                || draft.has_any(&DEEDS)
                || (!draft.has_any(&[Sense::Copula, Sense::Statement])
                    && draft.all_names().next().is_some())))
        || (draft.quantity(Kind::Distance).is_some() && draft.has(Sense::From))
        || (draft.has(Sense::Hold) && !draft.quantities.is_empty())
        || (draft.senses.first() == Some(&Sense::Hold)
            && draft.n_neg == 0
            && ["stay", "keep", "remain"].iter().any(|verb| draft.words.starts_with(verb))
            && draft.regions.iter().any(|region| region.place == Place::Near))
        || positive_side
        || draft.has_any(&[Sense::History, Sense::MinSpeed, Sense::StartOver])
        || draft.quantities.iter().any(|q| q.kind == Kind::Distance && q.bound == Bound::Lower)
            && !draft.regions.is_empty()
}

/// Whether it is a task, chat, question or plain motion.
#[must_use]
pub fn is_other(draft: &Draft) -> bool {
    draft.has_any(&[Sense::Task, Sense::Chat, Sense::Question])
        || draft.has_any(&[Sense::Motion, Sense::VerbOn, Sense::VerbPast, Sense::VerbNear])
            && !draft.is_negated()
}

/// Whether it tells rather than orders.
#[must_use]
pub fn is_story(draft: &Draft) -> bool {
    draft.has_any(&[Sense::Copula, Sense::ThereIs, Sense::Statement, Sense::Subject])
}

/// Whether it orders even beside words of a task.
#[must_use]
pub fn has_strong_order(draft: &Draft) -> bool {
    draft.n_neg > 0
        || draft.has_any(&EXCLUSIONS[..4])
        || draft.has_any(&[
            Sense::Careful,
            Sense::Quiet,
            Sense::Slow,
            Sense::Slower,
            Sense::Crawl,
            Sense::TurnSlow,
            Sense::Revoke,
            Sense::History,
            Sense::MinSpeed,
        ])
        || draft.quantities.iter().any(|q| matches!(q.kind, Kind::Speed | Kind::TurnRate))
}
