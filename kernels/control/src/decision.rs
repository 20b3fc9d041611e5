//! What the filter decided at one tick, and how it says so.

use std::fmt::Write;

use geometry::{Point2, Twist};

use crate::certificate::Breach;
use crate::margin::{Demand, World};
use crate::scene::Source;

/// What was sent, in one word.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Action {
    /// The nominal command, as it came or as near as the limits of acceleration allow.
    Passed,
    /// The primitive closest to the nominal command that the certificate and the score allow.
    Blended,
    /// The safest control found.
    Backup,
    /// The rest of the last certified plan: nothing new was certified.
    Resting,
    /// A rule is broken already: on the way back to compliance.
    Recovering {
        /// The rule's id; `None` when it is an obstacle that is too near.
        rule: Option<String>,
    },
    /// The nominal command was stuck: a certified turn and short drive to where there is room.
    Unfreezing,
    /// Nothing is certified, and the stored plan is broken: the plan of least harm.
    LeastHarm,
    /// Full braking: an input is missing, stale or not finite.
    Braking,
}

/// Whether what was sent begins a plan that passes the certificate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Certified {
    /// It does.
    Yes,
    /// It does not.
    No {
        /// What is in the way, lower case.
        why: &'static str,
    },
}

/// Unit of a margin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MarginUnit {
    /// Metres between hull and obstacle or zone.
    Metres,
    /// Metres a second below a limit.
    MetresPerSecond,
    /// Radians a second below a limit.
    RadiansPerSecond,
}

/// The thing that held the nominal command back, or is nearest to doing so.
#[derive(Clone, Debug, PartialEq)]
pub struct Binding {
    /// The rule's id, or the name of the base layer.
    pub id: String,
    /// As the operator reads it: "the crib".
    pub label: String,
    /// Whether it is a rule, and not an obstacle.
    pub is_rule: bool,
    /// The present margin: hull to object for what is spatial (buffer not subtracted), else below the limit.
    pub margin: f64,
    /// Its unit.
    pub unit: MarginUnit,
    /// True when the rule's object has not been found yet, and the cap for that binds.
    pub is_ungrounded: bool,
}

/// What the filter decided at one tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Decision {
    /// What to send to the base.
    pub command: Twist,
    /// What was sent, in one word.
    pub action: Action,
    /// The largest margin that a certified plan from here was found to keep, metres; the paper's V.
    pub v_safe_m: f64,
    /// The margin that the plan behind the sent command keeps, metres.
    pub v_sent_m: f64,
    /// What held the nominal command back; `None` when nothing did.
    pub binding: Option<Binding>,
    /// Whether the command begins a certified plan.
    pub certified: Certified,
    /// Distance of the sent from the nominal control, each part scaled by its limit; 0 when passed.
    pub deviation: f64,
    /// What the operator reads: "slowed: 0.4 m from the crib".
    pub words: String,
}

/// Texts of a decision that was read: room for those of another.
#[derive(Debug, Default)]
pub(crate) struct Texts {
    id: String,
    label: String,
    words: String,
    rule: String,
}

impl Texts {
    /// Takes the texts of a decision that nobody reads any more.
    pub(crate) fn take_back(&mut self, decision: Decision) {
        self.words = decision.words;
        if let Action::Recovering { rule: Some(rule) } = decision.action {
            self.rule = rule;
        }
        if let Some(binding) = decision.binding {
            (self.id, self.label) = (binding.id, binding.label);
        }
    }
}

/// The rule that a robot is on its way back to, when it is a rule that binds.
pub(crate) fn recovered_rule(texts: &mut Texts, binding: &Binding) -> Option<String> {
    binding.is_rule.then(|| written(&mut texts.rule, &binding.id))
}

/// A text in the room of another.
fn written(room: &mut String, text: &str) -> String {
    let mut room = std::mem::take(room);
    room.clear();
    room.push_str(text);
    room
}

/// The binding thing of a breach or of the nearest margin, seen from `place`.
pub(crate) fn binding(
    texts: &mut Texts,
    world: &World,
    source: Source,
    breach: Option<Breach>,
    place: Point2,
    radius_m: f64,
) -> Option<Binding> {
    let mut is_ungrounded = false;
    let (id, label, is_rule, field) = match source {
        Source::Base(idx) => {
            let layer = world.base.get(idx)?;
            (&*layer.name, &*layer.name, false, Some(&layer.field))
        }
        Source::Points => ("scan", "an obstacle in the scan", false, None),
        Source::Rule(idx) => {
            let rule = world.rules.get(idx)?;
            let field = match &rule.demand {
                Demand::Exclusion { zone, .. } => Some(zone),
                Demand::Limit { zone, .. } => zone.as_ref(),
                Demand::SpeedCap { .. } => {
                    is_ungrounded = true;
                    None
                }
            };
            (&*rule.id, &*rule.label, true, field)
        }
    };
    let (margin, unit) = match (breach, field) {
        (Some(Breach::Fast(_, over)), _) => (-over, MarginUnit::MetresPerSecond),
        (Some(Breach::Turning(_, over)), _) => (-over, MarginUnit::RadiansPerSecond),
        (_, Some(field)) => (field.sample(place) - radius_m, MarginUnit::Metres),
        (Some(Breach::Near(_, margin_m)), None) if source != Source::Points => (margin_m, MarginUnit::Metres),
        (_, None) => {
            let nearest = world.points.iter().map(|p| (p - place).norm()).fold(f64::INFINITY, f64::min);
            (nearest - radius_m, MarginUnit::Metres)
        }
    };
    let (id, label) = (written(&mut texts.id, id), written(&mut texts.label, label));
    Some(Binding { id, label, is_rule, margin, unit, is_ungrounded })
}

/// What the operator reads when an input cannot be used.
pub(crate) fn braking_words(texts: &mut Texts, why: &str) -> String {
    let mut words = written(&mut texts.words, "braking: ");
    words.push_str(why);
    words
}

/// What the operator reads.
pub(crate) fn words(
    texts: &mut Texts,
    action: &Action,
    sent: Twist,
    nominal: Twist,
    binding: Option<&Binding>,
) -> String {
    let mut words = written(&mut texts.words, "");
    if let Some(b) = binding.filter(|b| b.is_ungrounded && *action != Action::Passed) {
        words.extend(["looking for ", &b.label, ", going slowly"]);
        return words;
    }
    words.push_str(match action {
        Action::Passed => "as asked",
        Action::Recovering { rule: Some(_) } => "recovering",
        Action::Recovering { rule: None } => "moving clear",
        Action::Unfreezing => "stuck, turning to where there is room",
        Action::LeastHarm => "no safe plan, least harm",
        Action::Braking => "braking",
        Action::Blended | Action::Backup | Action::Resting => {
            if sent.speed_m_s <= 1e-3 && sent.yaw_rate_rad_s.abs() <= 1e-3 {
                "stopped"
            } else if sent.speed_m_s < nominal.speed_m_s - 1e-6 {
                "slowed"
            } else {
                "steered"
            }
        }
    });
    if let Some(b) = binding.filter(|_| *action != Action::Passed) {
        let (margin, label) = (b.margin, &b.label);
        let near = match b.unit {
            MarginUnit::Metres if margin >= 0.1 => write!(words, ": {margin:.1} m from {label}"),
            MarginUnit::Metres if margin > 0.0 => write!(words, ": {:.0} cm from {label}", 100.0 * margin),
            MarginUnit::Metres => write!(words, ": at {label}"),
            _ => write!(words, ": limit for {label}"),
        };
        debug_assert!(near.is_ok(), "a string takes every text");
    }
    words
}
