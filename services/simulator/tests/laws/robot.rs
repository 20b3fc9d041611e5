//! The robot as the loop sees it.

use std::sync::Arc;
use std::time::Duration;

use geometry::{CameraIntrinsics, Pose2, Profile, Time, Twist};
use heedway_simulator::config::SimulatorSettings;
use heedway_simulator::kept_frames::KeptFrames;
use heedway_simulator::simulated_robot::{SimulatedRobot, World};
use proto::{Message, ModelImage, RgbdFrame, Scan};
use robot::Robot;
use service::Clock;

use crate::bodies::shipped;

fn profile() -> Profile {
    let mut profile = Profile::sim();
    profile.camera.intrinsics =
        CameraIntrinsics { width: 64, height: 48, fx: 60.0, fy: 60.0, cx: 31.5, cy: 23.5 };
    profile
}

fn settings(more: serde_json::Value) -> SimulatorSettings {
    let mut value = serde_json::json!({"scene": "tiny.json", "seed": 3});
    value.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    serde_json::from_value(value).unwrap()
}

struct Bench {
    robot: SimulatedRobot,
    kept: Arc<KeptFrames>,
    now: Time,
}

impl Bench {
    fn new(settings: &SimulatorSettings) -> Bench {
        let clock = Clock::start();
        let kept = Arc::new(KeptFrames::default());
        let world = World::new(shipped("tiny.json"), &profile(), settings).unwrap();
        let robot = SimulatedRobot::new(&world, &profile(), settings, clock, Arc::clone(&kept)).unwrap();
        Bench { robot, kept, now: clock.now() + Duration::from_millis(1) }
    }

    /// One turn of the loop, 10 ms of simulated time.
    fn turn(&mut self, twist: Twist) -> robot::Senses {
        self.now = self.now + Duration::from_millis(10);
        let senses = self.robot.sense(self.now).unwrap();
        self.robot.actuate(self.now, twist).unwrap();
        senses
    }

    /// Turns until both sensors have delivered; they work on threads of their own, in real time.
    fn until_sensed(&mut self) -> (Scan, RgbdFrame) {
        let (mut scan, mut frame) = (None, None);
        for _ in 0..1_000_000 {
            let senses = self.turn(Twist::ZERO);
            scan = scan.or(senses.scans.into_iter().next());
            frame = frame.or(senses.frames.into_iter().next());
            if scan.is_some() && frame.is_some() {
                break;
            }
            std::thread::yield_now();
        }
        (scan.unwrap(), frame.unwrap())
    }
}

#[test]
fn odometry_scans_and_frames_come_and_keep_the_rules_of_their_messages() {
    let mut bench = Bench::new(&settings(serde_json::json!({})));
    let n_odometry = (0..100).filter(|_| bench.turn(Twist::ZERO).base.is_some()).count();
    // One second at 50 Hz; the first comes at once.
    assert!((50..=51).contains(&n_odometry), "{n_odometry}");
    let (scan, frame) = bench.until_sensed();
    assert!(scan.check().is_ok() && frame.check().is_ok());
    assert_eq!(scan.ranges_m.len(), 360);
    // The wall ahead is 4.3 m away, the one behind 0.7 m.
    assert!((scan.ranges_m[180] - 0.7).abs() < 1e-3);
    let image = ModelImage {
        seq: frame.header.seq,
        stamp_ns: frame.header.stamp_ns,
        width: 64,
        height: 48,
        rgb: frame.rgb.clone(),
    };
    assert!(bench.kept.find(&image).is_ok(), "the frame can be asked about");
}

#[test]
fn what_is_commanded_is_driven_and_the_wheels_agree() {
    let mut bench = Bench::new(&settings(serde_json::json!({})));
    for _ in 0..100 {
        bench.turn(Twist::new(0.5, 0.2));
    }
    let state = *bench.robot.state().lock().unwrap();
    let start = Pose2::new(0.7, 2.0, 0.0);
    assert!((state.map_from_base.position() - start.position()).norm() > 0.35);
    let odometry = (0..3).find_map(|_| bench.turn(Twist::new(0.5, 0.2)).base).unwrap();
    let state = *bench.robot.state().lock().unwrap();
    assert!((odometry.odom_from_base.position() - state.map_from_base.position()).norm() < 0.02);
}

#[test]
fn odometry_may_begin_where_the_robot_starts() {
    let mut bench = Bench::new(&settings(serde_json::json!({"base": {"odometry_origin": "start"}})));
    let odometry = (0..3).find_map(|_| bench.turn(Twist::ZERO).base).unwrap();
    assert_eq!(odometry.odom_from_base, Pose2::IDENTITY);
}

#[test]
fn a_contact_presses_the_bumper() {
    let mut bench = Bench::new(&settings(serde_json::json!({})));
    for _ in 0..150 {
        bench.turn(Twist::new(-1.0, 0.0));
    }
    let base = (0..3).find_map(|_| bench.turn(Twist::ZERO).base).unwrap();
    assert_eq!(base.fault, Some(proto::BaseFault::Bumper));
    assert_eq!(bench.robot.state().lock().unwrap().n_collisions, 1);
}

#[test]
fn the_seed_moves_the_start_within_its_limit_and_nowhere_near_an_obstacle() {
    let start = |seed: u64| {
        let settings = settings(serde_json::json!({"seed": seed, "start_jitter_m": 0.2}));
        World::new(shipped("tiny.json"), &profile(), &settings).unwrap().map_from_start
    };
    assert_eq!(start(1), start(1));
    assert_ne!(start(1), start(2));
    for seed in 0..10 {
        assert!((start(seed).position() - Pose2::new(0.7, 2.0, 0.0).position()).norm() <= 0.2);
    }
}
