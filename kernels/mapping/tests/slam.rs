//! Mapping by scans alone and with wheels that drift, in generated buildings.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

mod building;

use std::f64::consts::PI;

use building::{Building, Lidar, scan_of, told};
use geometry::Pose2;
use mapping::base_map::Scan;
use mapping::slam::{Slam, SlamConfig, Standing};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// A drive through a building.
struct Drive {
    slam: Slam,
    truth: Vec<Pose2>,
    /// When all was seen.
    found: Vec<Pose2>,
    /// When each scan came.
    found_then: Vec<Pose2>,
    n_not_good: usize,
}

fn drive(seed: u64, n: usize, step_m: f64, lidar: Lidar, drift: Option<[f64; 2]>) -> Drive {
    let wheels = |truly: Pose2, _: &mut Xoshiro256PlusPlus| drift.map(|drift| told(truly, drift));
    drive_with(seed, n, step_m, lidar, wheels)
}

/// The same with odometry of any kind.
fn drive_with(
    seed: u64,
    n: usize,
    step_m: f64,
    lidar: Lidar,
    wheels: impl Fn(Pose2, &mut Xoshiro256PlusPlus) -> Option<Pose2>,
) -> Drive {
    let building = Building::generated(seed);
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let truth = building.way(n, step_m);
    let mut slam = Slam::new(SlamConfig::default(), truth[0]).unwrap();
    let (mut anchors, mut found_then, mut n_not_good) = (Vec::new(), Vec::new(), 0);
    for (idx, pose) in truth.iter().enumerate() {
        let truly = idx.checked_sub(1).map(|last| truth[last].inverse() * *pose);
        let ranges_m = building.scan(*pose, &lidar, &mut rng);
        let odometry = truly.and_then(|truly| wheels(truly, &mut rng));
        let located = slam.step(&scan_of(&ranges_m, &lidar), odometry).unwrap();
        n_not_good += usize::from(located.standing != Standing::Good);
        anchors.push(located.anchor);
        found_then.push(located.map_from_base);
    }
    slam.finish();
    let found = anchors.iter().map(|anchor| slam.pose(anchor)).collect();
    Drive { slam, truth, found, found_then, n_not_good }
}

impl Drive {
    /// The median error of places over stretches of so many scans, metres.
    fn median_m(&self, n_scans: usize) -> f64 {
        let off = |begin: usize| {
            let truly = self.truth[begin].inverse() * self.truth[begin + n_scans];
            let found = self.found[begin].inverse() * self.found[begin + n_scans];
            (truly.inverse() * found).position().coords.norm()
        };
        let mut all: Vec<f64> = (0..self.truth.len().saturating_sub(n_scans)).map(off).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    }

    /// The mean error of places over stretches of so many scans, metres, of a way that was found.
    fn mean_m(&self, found: &[Pose2], n_scans: usize) -> f64 {
        let off = |begin: usize| {
            let truly = self.truth[begin].inverse() * self.truth[begin + n_scans];
            let off = truly.inverse() * (found[begin].inverse() * found[begin + n_scans]);
            off.position().coords.norm()
        };
        let n = self.truth.len() - n_scans;
        (0..n).map(off).sum::<f64>() / n as f64
    }

    /// The largest error over stretches of so many scans: metres, radians.
    fn worst_over(&self, n_scans: usize) -> (f64, f64) {
        let off = |begin: usize| {
            let end = begin + n_scans;
            let truly = self.truth[begin].inverse() * self.truth[end];
            let off = truly.inverse() * (self.found[begin].inverse() * self.found[end]);
            (off.position().coords.norm(), off.yaw_rad.abs())
        };
        let stretches = 0..self.truth.len().saturating_sub(n_scans);
        stretches.map(off).fold((0.0, 0.0), |worst, off| (worst.0.max(off.0), worst.1.max(off.1)))
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn around_a_building_the_motion_is_found_however_the_wheels_drift(
        seed in any::<u64>(), share in -0.05..0.05_f64, turn_deg_m in -2.0..2.0_f64, n_people in 0..3_usize,
    ) {
        let lidar = Lidar { n_people, ..Lidar::default() };
        let driven = drive(seed, 260, 0.25, lidar, Some([share, turn_deg_m.to_radians()]));
        let (one, ten) = (driven.worst_over(4), driven.worst_over(40));
        prop_assert!(one.0 < 0.05 && one.1 < 1.0_f64.to_radians(), "{one:?} off over a metre");
        prop_assert!(ten.0 < 0.15 && ten.1 < 2.0_f64.to_radians(), "{ten:?} off over ten");
        prop_assert!(driven.n_not_good == 0 && driven.slam.n_torn() == 0);
    }

    #[test]
    fn around_a_building_the_motion_is_found_by_scans_alone(seed in any::<u64>()) {
        let driven = drive(seed, 330, 0.2, Lidar::default(), None);
        // Along a wall without features nothing but scans tells how far it went: the worst stretch may be off by much,
        // the middle one is not.
        let (one, ten) = (driven.median_m(5), driven.median_m(50));
        prop_assert!(one < 0.05, "{one} m off over a metre");
        prop_assert!(ten < 0.3, "{ten} m off over ten");
    }

    #[test]
    fn half_a_circle_of_180_beams_is_enough_with_wheels(seed in any::<u64>()) {
        let lidar = Lidar { n_beams: 180, fov_rad: PI, ..Lidar::default() };
        let driven = drive(seed, 150, 0.5, lidar, Some([0.05, 2.0_f64.to_radians()]));
        let ten = driven.worst_over(20);
        prop_assert!(ten.0 < 0.2 && ten.1 < 2.0_f64.to_radians(), "{ten:?} off over ten metres");
    }

    #[test]
    fn what_is_seen_later_tells_better_where_a_scan_was_taken(seed in any::<u64>()) {
        // Wheels that slip by another 5 % and 2° each metre.
        let slipping = |truly: Pose2, rng: &mut Xoshiro256PlusPlus| {
            let mut normal = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>();
            Some(told(truly, [0.05 * normal(), 2.0_f64.to_radians() * normal()]))
        };
        let lidar = Lidar { n_beams: 180, fov_rad: PI, ..Lidar::default() };
        let driven = drive_with(seed, 150, 0.9, lidar, slipping);
        let (then, now) = (driven.mean_m(&driven.found_then, 1), driven.mean_m(&driven.found, 1));
        prop_assert!(now < then, "{now} m off over a metre when all was seen, {then} m before");
        // By loops alone, 0.03 to 0.064 m.
        let ten = driven.mean_m(&driven.found, 11);
        prop_assert!(ten < 0.035, "{ten} m off over ten");
    }

    #[test]
    fn no_scan_and_no_odometry_crashes_the_mapping(
        ranges in prop::collection::vec(
            prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1.0_f32), Just(0.0_f32), 0.0..40.0_f32], 0..400,
        ),
        jump in prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e9), -50.0..50.0_f64],
        turn in -1e3..1e3_f64,
    ) {
        let building = Building::generated(7);
        let lidar = Lidar::default();
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(7);
        let mut slam = Slam::new(SlamConfig::default(), Pose2::IDENTITY).unwrap();
        for nth in 0..6 {
            let seen = building.scan(building.way(1, 0.1)[0], &lidar, &mut rng);
            let odd = Lidar { n_beams: ranges.len().max(1), ..lidar };
            let (scan, odometry) = if nth % 2 == 0 {
                (scan_of(&seen, &lidar), Some(Pose2::IDENTITY))
            } else {
                (scan_of(&ranges, &odd), Some(Pose2 { x_m: jump, y_m: 0.0, yaw_rad: turn }))
            };
            if let Ok(located) = slam.step(&scan, odometry) {
                prop_assert!(located.map_from_base.is_finite());
            }
        }
        slam.finish();
    }
}

#[test]
fn where_scans_stop_fitting_a_new_piece_begins_and_is_found_in_the_old_when_it_can_be() {
    let building = Building::generated(3);
    let lidar = Lidar::default();
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
    let way = building.way(120, 0.2);
    let mut slam = Slam::new(SlamConfig::default(), way[0]).unwrap();
    let mut anchors = Vec::new();
    for (idx, pose) in way.iter().enumerate() {
        let ranges_m = building.scan(*pose, &lidar, &mut rng);
        let scan = scan_of(&ranges_m, &lidar);
        let located = slam.step(&scan, None).unwrap();
        // Once, the scan is given up though it fits.
        let located = if idx == 60 { slam.begin_anew(&scan).unwrap() } else { located };
        anchors.push(located.anchor);
    }
    slam.finish();
    assert_eq!(slam.n_torn(), 0, "the new piece was not found in the old");
    let off = way[119].inverse() * slam.pose(&anchors[119]);
    assert!(off.position().coords.norm() < 0.3 && off.yaw_rad.abs() < 0.05, "{off:?} off");
}

#[test]
fn a_scan_that_cannot_be_is_refused_by_name_and_changes_nothing() {
    let mut slam = Slam::new(SlamConfig::default(), Pose2::IDENTITY).unwrap();
    let lidar = Lidar::default();
    let scan = Scan { angle_increment_rad: f64::NAN, ..scan_of(&[1.0; 4], &lidar) };
    assert!(slam.step(&scan, None).unwrap_err().to_string().contains("NaN"));
    assert_eq!(slam.map_from_base(), Pose2::IDENTITY);
}
