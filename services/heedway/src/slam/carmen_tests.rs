//! Logs as they are and as they should not be.

use super::*;

fn flaser(ranges: &[&str]) -> String {
    format!("FLASER {} {} 1 2 0.5 1.1 2 0.5 12.25 host 12.5\n", ranges.len(), ranges.join(" "))
}

fn scan(line: &LaserLine) -> &LaserScan {
    match line {
        LaserLine::Scan(scan) => scan,
        LaserLine::Bad { reason, .. } => panic!("{reason}"),
    }
}

#[test]
fn a_flaser_line_gives_ranges_poses_and_stamp() {
    let log = flaser(&["1.0", "2.5", "nan", "0", "3.0"]);
    let lines = read(log.as_bytes(), None).unwrap();
    let scan = scan(&lines[0]);
    assert_eq!((scan.stamp.as_str(), scan.ranges_m[1]), ("12.25", 2.5));
    assert!(scan.ranges_m[2].is_nan());
    assert_eq!(
        (scan.laser, scan.odometry),
        (Some(Pose2::new(1.0, 2.0, 0.5)), Some(Pose2::new(1.1, 2.0, 0.5)))
    );
    // Five beams over half a circle.
    assert!((scan.angle_min_rad + FRAC_PI_2).abs() < 1e-12 && (scan.angle_step_rad - PI / 4.0).abs() < 1e-12);
}

#[test]
fn a_robotlaser_line_says_its_own_angles_and_range() {
    let log = "ROBOTLASER1 0 -3.0 6.0 0.9 30 0.1 0 4 1 30 2 3 2 7 8 0.2 0 0 0 0 0 0 0.1 0.2 0 0 99.5 h 1\n";
    let lines = read(log.as_bytes(), None).unwrap();
    let scan = scan(&lines[0]);
    assert_eq!((scan.angle_min_rad, scan.angle_step_rad), (-3.0, 0.9));
    assert!(scan.range_max_m < 30.0 && scan.range_max_m > 29.0, "{}", scan.range_max_m);
    assert_eq!((scan.stamp.as_str(), scan.laser), ("99.5", Some(Pose2::new(0.2, 0.0, 0.0))));
}

#[test]
fn beams_that_close_a_circle_cover_one() {
    let closed = flaser(&["1.0", "2.0", "3.0", "1.02"]).repeat(5);
    assert!((scan(&read(closed.as_bytes(), None).unwrap()[0]).angle_step_rad - TAU / 4.0).abs() < 1e-12);
    let told = read(closed.as_bytes(), Some(180.0)).unwrap();
    assert!((scan(&told[0]).angle_step_rad - PI / 4.0).abs() < 1e-12);
}

#[test]
fn the_largest_value_again_and_again_is_no_return() {
    let log = flaser(&["1.0", "81.91", "81.91", "81.91"]).repeat(3);
    assert!(scan(&read(log.as_bytes(), None).unwrap()[0]).range_max_m < 81.9);
}

#[test]
fn a_line_that_cannot_be_read_is_named_and_those_after_it_are_read() {
    let log = format!("ODOM 1 2 3\nFLASER 3 1.0 x\nFLASER 99999999 1\nFLASER 2 1.0\n{}", flaser(&["1", "2"]));
    let lines = read(log.as_bytes(), None).unwrap();
    let bad: Vec<usize> = lines
        .iter()
        .filter_map(|l| if let LaserLine::Bad { number, .. } = l { Some(*number) } else { None })
        .collect();
    assert_eq!((lines.len(), bad), (4, vec![2, 3, 4]));
    assert!(matches!(&lines[0], LaserLine::Bad { reason, .. } if reason.contains("\"x\"")));
    assert!(read(&b"ODOM 1 2 3\n"[..], None).is_err());
}
