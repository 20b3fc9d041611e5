//! What the operator reads of one tick, in numbers and in words.

use control::{Action, Certified, Decision, MarginUnit};
use geometry::{Pose2, Twist};
use proto::{Binding, FilterStatus, InputAge, RuleHeld};

/// What every tick tells, whatever was decided.
#[derive(Debug, Default)]
pub(crate) struct Around {
    pub tick: u64,
    pub map_from_base: Option<Pose2>,
    pub nominal: Option<Twist>,
    pub rules_version: Option<u64>,
    pub rules: Vec<RuleHeld>,
    pub n_late: u64,
    pub ages_ms: Vec<InputAge>,
}

/// The status of a tick whose command the filter decided; `notes` are clauses that the operator must read.
pub(crate) fn decided(around: Around, decision: &Decision, notes: &[String]) -> FilterStatus {
    let is_at_rest = decision.command == Twist::ZERO;
    let action = match &decision.action {
        Action::Passed => "passed",
        Action::Blended => "blended",
        Action::Backup | Action::LeastHarm => "backup",
        Action::Resting => "resting",
        Action::Recovering { .. } => "recovering",
        Action::Unfreezing => "unfreezing",
        Action::Braking => "stopped",
    };
    let mut words = decision.words.clone();
    for note in notes.iter().filter(|note| !decision.words.contains(note.as_str())) {
        if words == "as asked" && !is_at_rest {
            words = format!("as asked; {note}");
        } else {
            words = format!("{words}; {note}");
        }
    }
    let finite = |value: f64| value.is_finite().then_some(value);
    let (certified, uncertified_reason) = match &decision.certified {
        Certified::Yes => (true, String::new()),
        Certified::No { why } => (false, (*why).to_owned()),
    };
    FilterStatus {
        action: action.to_owned(),
        words,
        sent: decision.command,
        v_safe_m: finite(decision.v_safe_m),
        v_sent_m: finite(decision.v_sent_m),
        binding: decision.binding.as_ref().and_then(binding),
        certified,
        uncertified_reason,
        deviation: finite(decision.deviation).unwrap_or(0.0),
        ..blank(around)
    }
}

/// The status of a tick in which the filter was not asked.
pub(crate) fn stopped(around: Around, sent: Twist, reason: &str) -> FilterStatus {
    let verb = if sent == Twist::ZERO { "stopped" } else { "stopping" };
    FilterStatus {
        action: "stopped".to_owned(),
        words: format!("{verb}: {reason}"),
        stop_reason: reason.to_owned(),
        sent,
        uncertified_reason: reason.to_owned(),
        ..blank(around)
    }
}

/// The status of a tick that came too late to decide anything.
pub(crate) fn rested(around: Around, sent: Twist, late_ms: u128) -> FilterStatus {
    FilterStatus {
        action: "resting".to_owned(),
        words: format!("tick {late_ms} ms late, following the last plan to its end"),
        sent,
        certified: true,
        ..blank(around)
    }
}

fn blank(around: Around) -> FilterStatus {
    let Around { tick, map_from_base, nominal, rules_version, rules, n_late, ages_ms } = around;
    FilterStatus {
        tick,
        action: String::new(),
        words: String::new(),
        stop_reason: String::new(),
        map_from_base,
        nominal,
        sent: Twist::ZERO,
        v_safe_m: None,
        v_sent_m: None,
        binding: None,
        certified: false,
        uncertified_reason: String::new(),
        deviation: 0.0,
        rules_version,
        rules,
        used_us: 0,
        n_late,
        ages_ms,
    }
}

fn binding(found: &control::Binding) -> Option<Binding> {
    let unit = match found.unit {
        MarginUnit::Metres => "m",
        MarginUnit::MetresPerSecond => "m/s",
        MarginUnit::RadiansPerSecond => "rad/s",
    };
    // Infinity has no JSON: nothing binds then.
    found.margin.is_finite().then(|| Binding {
        id: found.id.clone(),
        label: found.label.clone(),
        margin: found.margin,
        unit: unit.to_owned(),
    })
}
