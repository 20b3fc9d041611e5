//! What one stretch of words holds, before anyone decides what it means.
//!
//! The scanner fills slots in any order, since people do not speak in sentence patterns. Every word
//! lands in a slot, is a filler, or is left over; left-over words later become a question.

use crate::lexicon::Sense;
use crate::noun::Name;
use crate::quantity::{Kind, Quantity};
use crate::segment::Join;

/// A region word as spoken, not yet a relation: what it means depends on the order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs)] // Each is the preposition it is named after.
pub enum Place {
    Near,
    On,
    Under,
    Between,
    Past,
    Front,
    Behind,
    Left,
    Right,
    ThisSide,
    To,
}

/// A place word with the names it governs.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The place word.
    pub place: Place,
    /// What it governs; two for between.
    pub names: Vec<Name>,
}

/// The slots of one stretch.
#[derive(Clone, Debug, Default)]
pub struct Draft {
    /// How it is tied to the one before; none for one made up while joining.
    pub join: Option<Join>,
    /// Whether a connector or a mark stood before its own.
    pub is_fresh: bool,
    /// The connector's own words: "when you see".
    pub lead: String,
    /// Negations.
    pub n_neg: usize,
    /// Senses met, in order, less glue.
    pub senses: Vec<Sense>,
    /// Names that no place word governs.
    pub names: Vec<Name>,
    /// Place words with their names.
    pub regions: Vec<Region>,
    /// Measured numbers; durations that are lifetimes are in `ttl_s`.
    pub quantities: Vec<Quantity>,
    /// Lifetime, seconds.
    pub ttl_s: Option<u64>,
    /// Places that only describe where a name is: "the patient in corridor B"; what "there" may mean.
    pub whereabouts: Vec<Name>,
    /// Instances let off.
    pub except: Vec<Name>,
    /// Names behind the verb of a story: "someone left a ladder there".
    pub told: Vec<Name>,
    /// Words after "is" that mean nothing to us.
    pub predicate: Vec<String>,
    /// A condition or a time the robot cannot observe, in words.
    pub unobservable: Option<String>,
    /// Words that nothing consumed.
    pub leftover: Vec<String>,
    /// Two names side by side with nothing that joins them: one of them was not understood.
    pub is_crowded: bool,
    /// All its words.
    pub words: String,
}

impl Draft {
    /// Whether a sense was met.
    #[must_use]
    pub fn has(&self, sense: Sense) -> bool {
        crate::steps::step();
        self.senses.contains(&sense)
    }

    /// Whether any of these was met.
    #[must_use]
    pub fn has_any(&self, senses: &[Sense]) -> bool {
        senses.iter().any(|sense| self.has(*sense))
    }

    /// Whether an odd number of negations was met.
    #[must_use]
    pub fn is_negated(&self) -> bool {
        self.n_neg % 2 == 1
    }

    /// The first quantity of a kind.
    #[must_use]
    pub fn quantity(&self, kind: Kind) -> Option<&Quantity> {
        self.quantities.iter().find(|quantity| quantity.kind == kind)
    }

    /// Every name in it, loose ones first.
    pub fn all_names(&self) -> impl Iterator<Item = &Name> {
        self.names.iter().chain(self.regions.iter().flat_map(|region| region.names.iter()))
    }
}
