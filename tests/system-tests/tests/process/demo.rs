//! The demonstration, as a newcomer runs it; and the filter alone, with a planner that knows no rules.

use std::process::Command;

use heedway_cli::fleet::Planner;
use system_tests::{Seen, Stage, office_goal_map};

#[test]
fn the_demonstration_does_what_it_promises() {
    let _alone = system_tests::alone().blocking_lock();
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(system_tests::program().unwrap())
        .args(["demo", "--headless", "--seed", "3", "--out"])
        .arg(folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}\n{}", String::from_utf8_lossy(&output.stderr));
    assert!(said.contains("both runs did what they should"), "{said}");
    let picture = std::fs::read(folder.path().join("heedway-demo.png")).unwrap();
    assert!(picture.starts_with(b"\x89PNG"), "the picture is no PNG");
}

/// The planner sees the base map only and leads under the desk: it is the filter that keeps the rule. The
/// goal may then be out of reach, which is the planner's to mend.
#[tokio::test(flavor = "multi_thread")]
async fn with_a_planner_that_knows_no_rules_the_filter_keeps_the_robot_from_under_the_desk() {
    let mut stage = Stage::open_with(|options| options.planner = Planner::Base).await.unwrap();
    let reply = stage.say("Don't go under the standing desk").await.unwrap();
    stage.until_kept(&reply.reply.specs[0].id).await.unwrap();
    stage.go(office_goal_map()).await.unwrap();
    let (mut n_seen, mut nearest_m) = (0, f64::INFINITY);
    stage
        .until("ten seconds of truth", |seen| {
            let Seen::Truth(truth) = seen else { return None };
            let desk = truth.objects.iter().find(|object| object.id == "standing-desk");
            let overhead_m = desk.and_then(|desk| desk.overhead_m).expect("the scene has a standing desk");
            assert!(overhead_m > 0.0, "under the desk: {truth:?}");
            assert_eq!(truth.n_collisions, 0, "{truth:?}");
            nearest_m = nearest_m.min(overhead_m);
            n_seen += 1;
            (n_seen >= 200).then_some(())
        })
        .await
        .unwrap();
    assert!(nearest_m < 1.5, "the robot never came near: {nearest_m} m");
}
