//! Each service is killed with SIGKILL in mid-run: the reaction is the row of `docs/safety.md`, its reason
//! is shown, and the run goes on under the same rules once the service is back.

use std::time::Duration;

use heedway_cli::carry::ServiceName;
use proto::{Grounding, topics};
use system_tests::{Seen, Stage, office_goal_map};

/// Kills `service` while the robot moves; the filter must stop it and name what is missing; restarted,
/// the robot moves again under the same rules.
async fn check_stops(service: ServiceName, reason: &[&str]) {
    let mut stage = Stage::open().await.unwrap();
    let accepted = stage.say("Don't go under the standing desk").await.unwrap();
    let rule_id = accepted.reply.specs[0].id.clone();
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.kill9(service).await.unwrap();
    stage.forget();
    stage.until_stopped_for(reason).await.unwrap();
    stage.until_at_rest().await.unwrap();
    stage.fleet.restart(service).unwrap();
    if service == ServiceName::Navigator {
        // A goal is no rule: a new navigator has none until somebody says again where to go.
        stage.until_alive(service).await.unwrap();
        stage.send_to(office_goal_map()).await.unwrap();
    }
    stage.until_moving().await.unwrap();
    let rules = rules_of_filter(&mut stage).await;
    assert_eq!(rules, [rule_id]);
    assert_eq!(last_truth(&mut stage).await.n_collisions, 0);
}

async fn rules_of_filter(stage: &mut Stage) -> Vec<String> {
    stage
        .until("a status of the filter", |seen| match seen {
            Seen::Filter(status) => Some(status.rules.iter().map(|rule| rule.id.clone()).collect()),
            _ => None,
        })
        .await
        .unwrap()
}

async fn last_truth(stage: &mut Stage) -> proto::Truth {
    stage
        .until("the truth", |seen| match seen {
            Seen::Truth(truth) => Some(truth.clone()),
            _ => None,
        })
        .await
        .unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn without_the_navigator_the_robot_stops_and_goes_on_with_it() {
    check_stops(ServiceName::Navigator, &["nominal"]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_localisation_the_robot_stops_and_goes_on_with_it() {
    check_stops(ServiceName::Localisation, &["pose"]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_the_filter_the_guard_stops_the_robot() {
    let mut stage = Stage::open().await.unwrap();
    let accepted = stage.say("Don't go under the standing desk").await.unwrap();
    let rule_id = accepted.reply.specs[0].id.clone();
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.kill9(ServiceName::Filter).await.unwrap();
    stage.forget();
    let limit = topics::SAFE.age_max.unwrap();
    stage
        .until("the guard stops the robot and names the age", |seen| match seen {
            Seen::Robot(status) if status.stopped => {
                status.reason.contains(&limit.as_millis().to_string()).then_some(())
            }
            _ => None,
        })
        .await
        .unwrap();
    stage.until_at_rest().await.unwrap();
    stage.fleet.restart(ServiceName::Filter).unwrap();
    stage.until_moving().await.unwrap();
    assert_eq!(rules_of_filter(&mut stage).await, [rule_id]);
}

/// The simulator is the robot: with it gone the filter must say that the base is silent; a new one begins
/// at the start pose, so that all that can be asked is that it stands, then drives, and that the rules hold.
#[tokio::test(flavor = "multi_thread")]
async fn without_the_robot_the_filter_says_so_and_a_new_one_is_driven_on() {
    let mut stage = Stage::open().await.unwrap();
    let accepted = stage.say("Don't go under the standing desk").await.unwrap();
    let rule_id = accepted.reply.specs[0].id.clone();
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.kill9(ServiceName::Simulator).await.unwrap();
    stage.forget();
    stage.until_stopped_for(&["odometry"]).await.unwrap();
    stage.fleet.restart(ServiceName::Simulator).unwrap();
    stage.until_moving().await.unwrap();
    assert_eq!(rules_of_filter(&mut stage).await, [rule_id]);
}

#[tokio::test(flavor = "multi_thread")]
async fn without_semantics_the_robot_slows_then_stops_and_a_grounded_region_stays() {
    let mut stage = Stage::open().await.unwrap();
    let accepted = stage.say("Don't go under the standing desk").await.unwrap();
    let rule_id = accepted.reply.specs[0].id.clone();
    stage.until_kept(&rule_id).await.unwrap();
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.kill9(ServiceName::Semantics).await.unwrap();
    stage.forget();
    // Braking ends anywhere within the tolerance of a limit, and may stay there.
    let slow_m_s = heedway_cli::fleet::profile().ungrounded_speed_m_s + control::LIMIT_TOLERANCE;
    let mut last_m_s = f64::INFINITY;
    let stopped = stage
        .until("the robot is slow while semantics is silent, then stops", |seen| match seen {
            Seen::Filter(status) if status.stop_reason.contains("semantics") => Some(status.clone()),
            Seen::Filter(status) if status.words.contains("semantics") => {
                // The cap is reached by braking, not at once: over it, what is sent only falls.
                let sent_m_s = status.sent.speed_m_s;
                assert!(sent_m_s <= last_m_s.max(slow_m_s) + 1e-9, "faster than {last_m_s} m/s: {status:?}");
                last_m_s = sent_m_s;
                None
            }
            _ => None,
        })
        .await
        .unwrap();
    assert!(last_m_s <= slow_m_s + 1e-9, "{last_m_s} m/s just before the stop, the cap is {slow_m_s}");
    assert!(stopped.rules.iter().any(|rule| rule.id == rule_id && rule.grounding.is_usable()), "{stopped:?}");
    stage.until_at_rest().await.unwrap();
    stage.fleet.restart(ServiceName::Semantics).unwrap();
    // The new one has found nothing yet: what it says first must not empty the region.
    stage
        .until("the robot moves", |seen| match seen {
            Seen::Filter(status) => {
                let kept = status.rules.iter().any(|r| r.id == rule_id && r.grounding == Grounding::Grounded);
                assert!(kept || !status.stop_reason.is_empty(), "the region was lost: {status:?}");
                (status.sent.speed_m_s > 0.1).then_some(())
            }
            _ => None,
        })
        .await
        .unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn without_language_the_run_goes_on_under_the_rules_in_force_and_they_outlive_it() {
    let mut stage = Stage::open().await.unwrap();
    let accepted = stage.say("Don't go under the standing desk").await.unwrap();
    let rule_id = accepted.reply.specs[0].id.clone();
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.kill9(ServiceName::Language).await.unwrap();
    stage.until_moving().await.unwrap();
    stage.fleet.restart(ServiceName::Language).unwrap();
    stage.forget();
    let version = stage
        .until("the restarted language service has the rule", |seen| match seen {
            Seen::Rules(set) => set.specs.iter().any(|rule| rule.id == rule_id).then_some(set.version),
            _ => None,
        })
        .await
        .unwrap();
    assert!(version >= accepted.rules_version);
    let next = stage.say("keep 0.3 m away from the filing cabinet").await.unwrap();
    assert!(next.rules_version > version);
    assert!(next.reply.specs.iter().all(|rule| rule.id != rule_id), "an id was used twice");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_filter_without_a_rule_set_does_not_move() {
    let mut stage =
        Stage::open_with(|options| options.services.retain(|name| *name != ServiceName::Language))
            .await
            .unwrap();
    stage.send_to(office_goal_map()).await.unwrap();
    let wanted = stage
        .until("the navigator wants to go and the filter names the rules", |seen| match seen {
            Seen::Filter(status)
                if status.nominal.is_some_and(|n| n.speed_m_s > 0.0 || n.yaw_rate_rad_s != 0.0) =>
            {
                status.stop_reason.contains("rule").then(|| status.clone())
            }
            _ => None,
        })
        .await
        .unwrap();
    assert_eq!(wanted.sent, geometry::Twist::ZERO);
}

/// A paused process is the worst kind of dead: its sockets stay open and nobody is told.
#[tokio::test(flavor = "multi_thread")]
async fn a_filter_that_hangs_is_noticed_by_the_age_of_its_commands() {
    let mut stage = Stage::open().await.unwrap();
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.signal(ServiceName::Filter, HANG).unwrap();
    stage.forget();
    stage
        .until("the guard stops the robot", |seen| match seen {
            Seen::Robot(status) => status.stopped.then_some(()),
            _ => None,
        })
        .await
        .unwrap();
    stage.until_at_rest().await.unwrap();
    stage.fleet.signal(ServiceName::Filter, GO_ON).unwrap();
    stage.until_moving().await.unwrap();
}

/// `SIGSTOP` and `SIGCONT` on Linux.
const HANG: i32 = 19;
const GO_ON: i32 = 18;

/// Not waited for: just long enough that a slow machine has a chance to notice a fault in the test itself.
#[test]
fn patience_is_longer_than_every_limit() {
    let longest = topics::ALL.iter().filter_map(|topic| topic.age_max).max().unwrap_or(Duration::ZERO);
    assert!(system_tests::PATIENCE > longest * 10);
}
