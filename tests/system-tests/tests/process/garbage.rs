//! Garbage on every key: rejected, counted, with a reason; and nothing stops working.

use std::collections::BTreeSet;

use geometry::Twist;
use proto::codec::Encoding;
use proto::{Header, Message, SafeCommand, keys, topics};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use system_tests::{Seen, Stage, office_goal_map};

/// Random bytes, nothing at all, too much, another version, and a command that is not a number.
fn lies(seed: u64) -> Vec<Vec<u8>> {
    let mut random = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut lies: Vec<Vec<u8>> = (0..20)
        .map(|_| {
            let n_bytes = random.random_range(0..300_usize);
            (0..n_bytes).map(|_| random.random::<u8>()).collect()
        })
        .collect();
    lies.push(vec![]);
    lies.push(vec![b'{'; 70 * 1024]);
    for kind in 0..20 {
        lies.push(vec![b'H', b'W', 99, kind, 0, 0, 0]);
        lies.push(vec![b'H', b'W', proto::WIRE_VERSION, kind]);
    }
    let Encoding::Binary { kind } = SafeCommand::ENCODING else { panic!("the safe command is binary") };
    let mut not_a_number = vec![b'H', b'W', proto::WIRE_VERSION, kind, 1, 1, 1];
    not_a_number.extend(f64::NAN.to_le_bytes());
    not_a_number.extend(0.0_f64.to_le_bytes());
    lies.push(not_a_number);
    lies
}

#[tokio::test(flavor = "multi_thread")]
async fn garbage_on_any_key_is_counted_with_a_reason_and_nothing_stops_working() {
    let seed = 20_261_122;
    let mut stage = Stage::open().await.unwrap();
    let session = stage.fleet.bus().session().clone();
    for topic in topics::ALL {
        let key = keys::key(stage.fleet.robot(), topic).replace('*', "s1");
        for lie in lies(seed) {
            session.put(key.as_str(), lie).await.unwrap();
        }
    }
    // Whoever listens must have counted: at least these keys have a listener in the system.
    let mut missing: BTreeSet<&str> = [
        topics::ODOMETRY.key,
        topics::SCAN.key,
        topics::RGBD.key,
        topics::NOMINAL.key,
        topics::SAFE.key,
        topics::POSE.key,
        topics::BASE_MAP.key,
        topics::OBJECT_MAP.key,
        topics::RULES.key,
        topics::GOAL.key,
        topics::INSTRUCTION.key,
    ]
    .into();
    stage
        .until("every listener has counted the garbage", |seen| {
            if let Seen::Health(health) = seen {
                for rejected in &health.rejected {
                    assert!(!rejected.last_reason.is_empty(), "seed {seed}: {rejected:?}");
                    missing.remove(rejected.key.as_str());
                }
            }
            missing.is_empty().then_some(())
        })
        .await
        .unwrap_or_else(|e| panic!("{missing:?}: {e:#}"));
    let reply = stage.say("Don't go under the standing desk").await.unwrap();
    assert_eq!(reply.reply.specs.len(), 1, "seed {seed}");
    stage.go(office_goal_map()).await.unwrap();
    stage.fleet.check().unwrap();
}

/// A stranger that sends good messages of its own invention: what is finite and in form is believed as far
/// as its age and order allow, and the guard's own limits still hold.
#[tokio::test(flavor = "multi_thread")]
async fn a_forged_safe_command_cannot_exceed_the_envelope() {
    let mut stage = Stage::open().await.unwrap();
    let forged = stage.fleet.bus().publisher::<SafeCommand>(&topics::SAFE).await.unwrap();
    let profile = heedway_cli::fleet::profile();
    for seq in 1..200 {
        let header = Header { seq, stamp_ns: service::Clock::start().stamp_ns(), echo: seq };
        forged.put(&SafeCommand { header, twist: Twist::new(15.0, 40.0) }).unwrap();
    }
    let mut n_seen = 0;
    stage
        .until("twenty truths", |seen| {
            if let Seen::Truth(truth) = seen {
                assert!(truth.twist.speed_m_s <= profile.speed_m_s_max + 1e-6, "{truth:?}");
                assert!(truth.twist.yaw_rate_rad_s.abs() <= profile.yaw_rate_rad_s_max + 1e-6, "{truth:?}");
                n_seen += 1;
            }
            (n_seen >= 20).then_some(())
        })
        .await
        .unwrap();
}
