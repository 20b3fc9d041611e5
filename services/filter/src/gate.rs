//! Whether the robot may move at all: the table of inputs that fail safe, row by row.
//!
//! Pure judgement of ages and facts. The order of the rows is that of the reasons: what is most basic is
//! named first. The nominal command is not here: when it is stale, the wish ramps to zero and is filtered
//! like any other.

use std::time::Duration;

use proto::BaseFault;

use crate::ages::AgeLimits;

/// What is known of the inputs at one tick. An age is `None` when the input never came.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// Age of the base feedback.
    pub odometry: Option<Duration>,
    /// What the base says is wrong with it.
    pub fault: Option<BaseFault>,
    /// Age of the oldest command that the base has not taken up yet; zero when it has taken all.
    pub round_trip: Duration,
    /// Age of the LiDAR turn.
    pub scan: Option<Duration>,
    /// Age of the scan that the pose was matched from.
    pub pose: Option<Duration>,
    /// Whether localisation says that it is lost.
    pub is_lost: bool,
    /// The base map.
    pub base_map: BaseMapState,
    /// Whether a rule set was heard since the start.
    pub has_rules: bool,
    /// Age of the semantics' beat while rules with objects are active; zero while there are none.
    pub semantics: Duration,
}

/// Whether the base map can be used with the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BaseMapState {
    /// None was heard since the start, or its field is not computed yet.
    Missing,
    /// It is of another epoch than the pose.
    OtherEpoch {
        /// Epoch of the map.
        map: u64,
        /// Epoch of the pose.
        pose: u64,
    },
    /// It can.
    Usable,
}

/// What the gate says.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The filter decides.
    Go,
    /// The filter decides, at no more than the profile's ungrounded speed.
    Slow(Reason),
    /// Full braking.
    Stop(Reason),
    /// Zero at once: how the robot moves is not known, or it must not move at all.
    Zero(Reason),
}

/// Which input slows or stops the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Reason {
    /// The input.
    pub input: &'static str,
    /// Its age; `None` when it never came, or age is not the matter.
    pub age: Option<Duration>,
    /// In words: "scan 312 ms old, at most 300 ms".
    pub words: String,
}

impl Reason {
    fn new(input: &'static str, words: impl Into<String>) -> Self {
        Reason { input, age: None, words: words.into() }
    }

    /// An input that never came, or is older than its limit; `None` when it is fresh.
    pub(crate) fn of_age(input: &'static str, age: Option<Duration>, limit: Duration) -> Option<Self> {
        match age {
            None => Some(Reason::new(input, format!("no {input} yet"))),
            Some(age) if age > limit => {
                let words = format!("{input} {} ms old, at most {} ms", age.as_millis(), limit.as_millis());
                Some(Reason { input, age: Some(age), words })
            }
            Some(_) => None,
        }
    }
}

/// Judges the inputs of one tick.
#[must_use]
pub fn judge(facts: &Facts, limits: &AgeLimits) -> Verdict {
    if let Some(reason) = Reason::of_age("odometry", facts.odometry, limits.odometry) {
        return Verdict::Zero(reason);
    }
    if let Some(fault) = facts.fault {
        return Verdict::Zero(Reason::new("base", format!("base fault: {fault:?}").to_lowercase()));
    }
    stop(facts, limits).map_or_else(|| slow(facts, limits), Verdict::Stop)
}

fn stop(facts: &Facts, limits: &AgeLimits) -> Option<Reason> {
    if !facts.has_rules {
        return Some(Reason::new("rules", "no rule set since the start"));
    }
    if let Some(reason) = Reason::of_age("scan", facts.scan, limits.scan) {
        return Some(reason);
    }
    if facts.is_lost {
        return Some(Reason::new("pose", "localisation is lost"));
    }
    // Both parts of the pose: the scan it was matched from, and the odometry that carries it on.
    let carried = Reason::of_age("odometry of the pose", facts.odometry, limits.pose_carried);
    if let Some(reason) = Reason::of_age("pose", facts.pose, limits.pose).or(carried) {
        return Some(reason);
    }
    match facts.base_map {
        BaseMapState::Missing => return Some(Reason::new("base map", "no base map since the start")),
        BaseMapState::OtherEpoch { map, pose } => {
            let words = format!("base map of epoch {map}, pose of epoch {pose}");
            return Some(Reason::new("base map", words));
        }
        BaseMapState::Usable => {}
    }
    if facts.round_trip > limits.round_trip {
        let words = format!(
            "the base has not taken up a command {} ms old, at most {} ms",
            facts.round_trip.as_millis(),
            limits.round_trip.as_millis()
        );
        return Some(Reason { input: "echo", age: Some(facts.round_trip), words });
    }
    Reason::of_age("semantics", Some(facts.semantics), limits.semantics_stop)
}

fn slow(facts: &Facts, limits: &AgeLimits) -> Verdict {
    match Reason::of_age("semantics", Some(facts.semantics), limits.semantics_slow) {
        Some(reason) => Verdict::Slow(reason),
        None => Verdict::Go,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FilterSettings;
    use geometry::Profile;

    fn fresh() -> Facts {
        Facts {
            odometry: Some(Duration::ZERO),
            fault: None,
            round_trip: Duration::ZERO,
            scan: Some(Duration::ZERO),
            pose: Some(Duration::ZERO),
            is_lost: false,
            base_map: BaseMapState::Usable,
            has_rules: true,
            semantics: Duration::ZERO,
        }
    }

    fn limits() -> AgeLimits {
        AgeLimits::of(&FilterSettings::for_profile(&Profile::sim()))
    }

    /// What the gate says when one thing is changed from a state in which all is well.
    #[track_caller]
    fn check(change: impl Fn(&mut Facts), wanted: &str) {
        let mut facts = fresh();
        change(&mut facts);
        let said = match judge(&facts, &limits()) {
            Verdict::Go => "go".to_owned(),
            Verdict::Slow(reason) => format!("slow: {}", reason.input),
            Verdict::Stop(reason) => format!("stop: {}", reason.input),
            Verdict::Zero(reason) => format!("zero: {}", reason.input),
        };
        assert_eq!(said, wanted);
    }

    #[test]
    fn each_row_holds_at_its_limit_and_not_a_nanosecond_longer() {
        let ns = Duration::from_nanos(1);
        let limits = limits();
        check(|_| {}, "go");
        check(|f| f.odometry = Some(limits.odometry), "go");
        check(|f| f.odometry = Some(limits.odometry + ns), "zero: odometry");
        check(|f| f.scan = Some(limits.scan), "go");
        check(|f| f.scan = Some(limits.scan + ns), "stop: scan");
        check(|f| f.pose = Some(limits.pose), "go");
        check(|f| f.pose = Some(limits.pose + ns), "stop: pose");
        check(|f| f.round_trip = limits.round_trip, "go");
        check(|f| f.round_trip = limits.round_trip + ns, "stop: echo");
        check(|f| f.semantics = limits.semantics_slow, "go");
        check(|f| f.semantics = limits.semantics_slow + ns, "slow: semantics");
        check(|f| f.semantics = limits.semantics_stop, "slow: semantics");
        check(|f| f.semantics = limits.semantics_stop + ns, "stop: semantics");
    }

    #[test]
    fn what_never_came_is_not_fresh() {
        check(|f| f.odometry = None, "zero: odometry");
        check(|f| f.scan = None, "stop: scan");
        check(|f| f.pose = None, "stop: pose");
        check(|f| f.has_rules = false, "stop: rules");
        check(|f| f.base_map = BaseMapState::Missing, "stop: base map");
        check(|f| f.base_map = BaseMapState::OtherEpoch { map: 1, pose: 2 }, "stop: base map");
        check(|f| f.is_lost = true, "stop: pose");
        check(|f| f.fault = Some(BaseFault::Cliff), "zero: base");
    }

    #[test]
    fn odometry_that_may_be_older_by_itself_may_not_carry_a_pose_for_longer_than_its_limit() {
        let limits = AgeLimits { odometry: Duration::from_secs(1), ..limits() };
        let ns = Duration::from_nanos(1);
        let at = Facts { odometry: Some(limits.pose_carried), ..fresh() };
        assert_eq!(judge(&at, &limits), Verdict::Go);
        let past = Facts { odometry: Some(limits.pose_carried + ns), ..fresh() };
        assert!(
            matches!(judge(&past, &limits), Verdict::Stop(reason) if reason.input == "odometry of the pose")
        );
    }
}
