//! The meanings that a phrase may have.

/// One meaning of a phrase; documented where `lexicon.toml` lists its phrases.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs)] // Each name is a heading of lexicon.toml, which holds its meaning by example.
pub enum Sense {
    Neg,
    Allow,
    Again,
    Lift,
    Motion,
    SelfRef,
    Fast,
    Turn,
    TurnFast,
    VerbOn,
    VerbNear,
    VerbTouch,
    VerbPast,
    VerbBlock,
    VerbWake,
    VerbLeave,
    Avoid,
    Attention,
    Away,
    Wide,
    StayOff,
    Hold,
    Contain,
    Slow,
    Slower,
    Faster,
    Wider,
    Closer,
    Double,
    Halve,
    Crawl,
    WalkPace,
    Halt,
    TurnSlow,
    Careful,
    Quiet,
    SpeedNoun,
    Dampen,
    OffLimits,
    Closed,
    Fragile,
    Sleeping,
    NeedsSpace,
    Fine,
    PrepNear,
    PrepOn,
    PrepUnder,
    PrepBetween,
    PrepPast,
    PrepFront,
    PrepBehind,
    PrepLeft,
    PrepRight,
    ThisSide,
    SelfLeft,
    SelfRight,
    SideLeft,
    SideRight,
    From,
    Of,
    To,
    ForWhom,
    Everywhere,
    IfWhen,
    Until,
    OpenEnded,
    TimeWords,
    And,
    Or,
    But,
    Also,
    So,
    Because,
    Except,
    Det,
    Pronoun,
    Subject,
    Copula,
    ThereIs,
    Statement,
    Filler,
    Task,
    Chat,
    Question,
    History,
    MinSpeed,
    Revoke,
    StartOver,
    Last,
    AllRules,
    OneOf,
    RuleNoun,
    Make,
    Same,
    AsWell,
    NormalSpeed,
    AsNormal,
}

impl Sense {
    /// Whether it is said of a thing after "is".
    #[must_use]
    pub fn is_state(self) -> bool {
        matches!(
            self,
            Sense::OffLimits
                | Sense::Closed
                | Sense::Fragile
                | Sense::Sleeping
                | Sense::NeedsSpace
                | Sense::Fine
        )
    }
}

/// Senses that move the robot somewhere: into, near, past, against or before a thing.
pub const GOING: [Sense; 6] =
    [Sense::Motion, Sense::VerbOn, Sense::VerbNear, Sense::VerbTouch, Sense::VerbPast, Sense::VerbBlock];
