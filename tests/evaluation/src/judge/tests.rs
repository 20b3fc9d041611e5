//! The judge over short stories of distances and speeds.

use super::*;
use rules::Relation;

fn rule(rule_type: RuleType, relation: Relation, buffer_m: f64, limit: Option<f64>) -> CaseRule {
    CaseRule {
        rule_type,
        relation,
        obj: "desk".into(),
        objects: vec!["desk-1".into()],
        buffer_m,
        speed_m_s_max: limit,
        yaw_rate_rad_s_max: None,
        accept: None,
        extra: serde_json::Map::new(),
    }
}

/// (distance, distance of what is overhead, speed) at each moment, 0.1 s apart.
#[track_caller]
fn check(rule: CaseRule, moments: &[(f64, Option<f64>, f64)], wanted_broken_s: f64) -> Findings {
    check_told(0.0, rule, moments, wanted_broken_s)
}

/// The same, told when the robot needs so far to stand.
#[track_caller]
fn check_told(
    stopping_m: f64,
    rule: CaseRule,
    moments: &[(f64, Option<f64>, f64)],
    wanted_broken_s: f64,
) -> Findings {
    let zone = match rule.relation {
        Relation::Global => Zone::Everywhere,
        relation => Zone::Objects { ids: rule.objects.clone(), overhead: relation == Relation::Beneath },
    };
    let watches = vec![Watch { rule, zone, is_excused: false, is_too_late: false }];
    let findings = Findings::default();
    let mut judge = Judge { watches, has_begun: false, stopping_m, began_s: 0.0, findings };
    for (k, (any_height_m, overhead_m, speed_m_s)) in moments.iter().enumerate() {
        let gap = |id: &str, any_height_m, overhead_m| ObjectGap { id: id.into(), any_height_m, overhead_m };
        judge.see(&Moment {
            time_s: 0.1 * k as f64,
            elapsed_s: 0.1,
            map_from_base: Pose2::IDENTITY,
            twist: Twist::new(*speed_m_s, 0.0),
            // The other one is always inside: a judge that looks at it is wrong.
            gaps: &[gap("other", -1.0, Some(-1.0)), gap("desk-1", *any_height_m, *overhead_m)],
            radius_m: 0.25,
        });
    }
    let findings = judge.findings().clone();
    assert!((findings.violation_s - wanted_broken_s).abs() < 1e-9, "{findings:?}");
    findings
}

#[test]
fn the_buffer_itself_is_forbidden_and_just_outside_is_not() {
    let near = || rule(RuleType::Exclusion, Relation::Near, 0.3, None);
    check(near(), &[(1.0, None, 1.0), (0.301, None, 1.0)], 0.0);
    let broken = check(near(), &[(1.0, None, 1.0), (0.3, None, 1.0), (0.1, None, 1.0)], 0.2);
    assert!((broken.violation_depth_m - 0.2).abs() < 1e-9);
}

#[test]
fn beneath_is_broken_by_what_is_overhead_and_not_by_the_legs() {
    let beneath = || rule(RuleType::Exclusion, Relation::Beneath, 0.0, None);
    check(beneath(), &[(1.0, Some(1.0), 1.0), (-0.1, Some(0.01), 1.0), (-0.1, None, 1.0)], 0.0);
    check(beneath(), &[(1.0, Some(1.0), 1.0), (0.5, Some(0.0), 1.0)], 0.1);
}

#[test]
fn a_limit_holds_within_the_buffer_and_driving_at_it_complies() {
    let slow = || rule(RuleType::Kinematic, Relation::Near, 1.0, Some(0.5));
    check(slow(), &[(2.0, None, 1.5), (0.9, None, 0.51)], 0.0);
    let broken = check(slow(), &[(2.0, None, 1.5), (0.9, None, 0.7)], 0.1);
    assert!((broken.violation_excess - 0.2).abs() < 1e-9 && broken.violation_depth_m == 0.0);
}

#[test]
fn who_is_inside_when_told_is_judged_from_when_he_is_out() {
    let near = || rule(RuleType::Exclusion, Relation::Near, 0.3, None);
    let found = check(near(), &[(0.1, None, 0.1), (0.2, None, 0.1), (0.4, None, 0.1)], 0.0);
    assert!((found.recovery_s - 0.2).abs() < 1e-9);
    check(near(), &[(0.1, None, 0.1), (0.4, None, 0.1), (0.2, None, 0.1)], 0.1);
}

#[test]
fn who_could_not_stop_any_more_is_judged_from_when_he_is_out() {
    let near = || rule(RuleType::Exclusion, Relation::Near, 0.3, None);
    let passing = [(0.8, None, 1.5), (0.5, None, 1.2), (0.25, None, 0.5), (0.2, None, 0.0)];
    let found = check_told(0.8, near(), &passing, 0.0);
    assert!((found.recovery_s - 0.2).abs() < 1e-9);
    // Told a little earlier he could have, and so could who went in much later.
    check_told(0.4, near(), &passing, 0.2);
    let late = [vec![(0.8, None, 0.1); 20], vec![(0.2, None, 0.1)]].concat();
    check_told(0.8, near(), &late, 0.1);
}

#[test]
fn the_lenient_end_of_an_accepted_range_counts() {
    let accept = serde_json::json!({ "buffer_m": [0.5, 1.5], "vel_max": [0.15, 0.75] });
    let slow = CaseRule { accept: Some(accept), ..rule(RuleType::Kinematic, Relation::Near, 1.0, Some(0.5)) };
    check(slow, &[(2.0, None, 1.5), (0.6, None, 1.5), (0.4, None, 0.75), (0.4, None, 0.77)], 0.1);
}
