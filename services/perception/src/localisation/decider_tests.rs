//! Localisation as it should behave, in a box room with a pillar, under a clock of the test's own.

use std::time::Duration;

use geometry::{Pose2, Profile, Time, Twist};
use proto::{BaseMap, Header, Odometry, PoseEstimate, PoseQuality, Scan};

use super::*;
use crate::localisation::config::PoseBy;

const START_NS: u64 = 1_700_000_000_000_000_000;
const N_BEAMS: usize = 360;
/// Walls of the room, and a pillar, as (low x, low y, high x, high y), metres in the world.
const ROOM: [f64; 4] = [-3.0, -2.0, 5.0, 2.0];
const PILLAR: [f64; 4] = [2.0, 0.5, 2.4, 0.9];

struct Bench {
    decider: Decider,
    now: Time,
    world_from_odom: Pose2,
    world_from_base: Pose2,
    twist: Twist,
    /// Share of the way and radians for each metre that the wheels are off, and where they think they are.
    drift: [f64; 2],
    drifted: Pose2,
    n_odometry: u64,
    n_scans: u64,
    odometry_is_silent: bool,
    /// A scan on its way.
    under_way: Option<Scan>,
    /// Those that are told to be good, and what the others are said to be.
    poses: Vec<PoseEstimate>,
    doubts: Vec<PoseQuality>,
    maps: Vec<(Time, BaseMap)>,
    troubles: Vec<String>,
}

impl Bench {
    fn new(start: [f64; 3]) -> Self {
        Bench::with(Settings { start, ..Settings::default() }, None)
    }

    fn with(settings: Settings, saved: Option<Grid<Occupancy>>) -> Self {
        let world_from_odom = settings.map_from_odom();
        Bench {
            decider: Decider::with_map(settings, &Profile::sim(), saved),
            drift: [0.0; 2],
            drifted: Pose2::IDENTITY,
            now: Time::ZERO,
            world_from_odom,
            world_from_base: world_from_odom,
            twist: Twist::default(),
            n_odometry: 0,
            n_scans: 0,
            odometry_is_silent: false,
            under_way: None,
            poses: Vec::new(),
            doubts: Vec::new(),
            maps: Vec::new(),
            troubles: Vec::new(),
        }
    }

    fn stamp_ns(&self) -> u64 {
        START_NS + self.now.as_nanos()
    }

    fn input(&mut self, input: Input) {
        for output in self.decider.step(self.now, input) {
            match output {
                Output::Pose(pose) if pose.quality == PoseQuality::Good => self.poses.push(pose),
                Output::Pose(pose) => self.doubts.push(pose.quality),
                Output::BaseMap(map) => self.maps.push((self.now, map)),
                Output::Trouble(words) => self.troubles.push(words),
            }
        }
    }

    /// Drives on; odometry at 50 Hz, scans at 10 Hz, each taken between two messages of odometry and
    /// fifty milliseconds on its way.
    fn drive(&mut self, seconds: f64) {
        for _ in 0..(seconds * 100.0).round() as u64 {
            let (speed_m_s, yaw_rate_rad_s) = (self.twist.speed_m_s, self.twist.yaw_rate_rad_s);
            self.world_from_base = self.world_from_base.along_arc(speed_m_s, yaw_rate_rad_s, 0.01);
            let [share, turn_rad_m] = self.drift;
            let turn_rad_s = yaw_rate_rad_s + turn_rad_m * speed_m_s;
            self.drifted = self.drifted.along_arc(speed_m_s * (1.0 + share), turn_rad_s, 0.01);
            self.now = self.now + Duration::from_millis(10);
            let step = self.now.as_nanos() / 10_000_000;
            if step % 10 == 5 {
                self.n_scans += 1;
                self.under_way = Some(self.scan());
            }
            if step.is_multiple_of(10)
                && let Some(scan) = self.under_way.take()
            {
                self.input(Input::Scan(scan));
            }
            if step.is_multiple_of(2) && !self.odometry_is_silent {
                self.n_odometry += 1;
                let header = Header { seq: self.n_odometry, stamp_ns: self.stamp_ns(), echo: 0 };
                let truly = self.world_from_odom.inverse() * self.world_from_base;
                let odom_from_base = if self.drift == [0.0; 2] { truly } else { self.drifted };
                let twist = self.twist;
                self.input(Input::Odometry(Odometry { header, odom_from_base, twist, fault: None }));
            }
            self.input(Input::Tick);
        }
    }

    fn scan(&self) -> Scan {
        let angle_step_rad = std::f64::consts::TAU / N_BEAMS as f64;
        let range = |idx: usize| {
            let angle_rad = self.world_from_base.yaw_rad + idx as f64 * angle_step_rad;
            range_m(self.world_from_base, angle_rad) as f32
        };
        Scan {
            header: Header { seq: self.n_scans, stamp_ns: self.stamp_ns(), echo: 7000 + self.n_scans },
            angle_min_rad: 0.0,
            angle_step_rad,
            duration_s: 0.0,
            range_m_min: 0.1,
            range_m_max: 20.0,
            ranges_m: (0..N_BEAMS).map(range).collect(),
        }
    }
}

/// From inside the room to its walls or the pillar.
fn range_m(from: Pose2, angle_rad: f64) -> f64 {
    let (ray_y, ray_x) = angle_rad.sin_cos();
    let slab = |low: f64, high: f64, at: f64, ray: f64| {
        let (a, b) = ((low - at) / ray, (high - at) / ray);
        (a.min(b), a.max(b))
    };
    let cross = |b: [f64; 4]| {
        let (x, y) = (slab(b[0], b[2], from.x_m, ray_x), slab(b[1], b[3], from.y_m, ray_y));
        (x.0.max(y.0), x.1.min(y.1))
    };
    let walls_m = cross(ROOM).1;
    let (enters_m, leaves_m) = cross(PILLAR);
    if enters_m > 0.0 && enters_m < leaves_m { enters_m.min(walls_m) } else { walls_m }
}

/// Distance from a point inside the room to the nearest wall or side of the pillar, metres.
fn border_m(x: f64, y: f64) -> f64 {
    let walls_m =
        (x - ROOM[0]).abs().min((ROOM[2] - x).abs()).min((y - ROOM[1]).abs()).min((ROOM[3] - y).abs());
    let outside = |low: f64, high: f64, at: f64| (low - at).max(at - high);
    let (dx, dy) = (outside(PILLAR[0], PILLAR[2], x), outside(PILLAR[1], PILLAR[3], y));
    let pillar_m = if dx <= 0.0 && dy <= 0.0 { -dx.max(dy) } else { dx.max(0.0).hypot(dy.max(0.0)) };
    walls_m.min(pillar_m)
}

/// Every occupied cell lies on a wall, every wall is occupied, and what was seen between them is free.
#[track_caller]
fn check_map(map: &BaseMap) {
    let (mut n_occupied, mut n_free) = (0, 0);
    for (idx, cell) in map.cells.iter().enumerate() {
        let layout = map.layout;
        let (col, row) = (idx % layout.n_cols as usize, idx / layout.n_cols as usize);
        let x = layout.origin_map.x + (col as f64 + 0.5) * layout.resolution_m;
        let y = layout.origin_map.y + (row as f64 + 0.5) * layout.resolution_m;
        match cell {
            2 => {
                n_occupied += 1;
                assert!(border_m(x, y) < 0.08, "occupied at ({x:.2}, {y:.2}), nothing stands there");
            }
            1 => {
                n_free += 1;
                let inside =
                    x > ROOM[0] - 0.05 && x < ROOM[2] + 0.05 && y > ROOM[1] - 0.05 && y < ROOM[3] + 0.05;
                assert!(inside, "free at ({x:.2}, {y:.2}), outside the room");
            }
            _ => {}
        }
    }
    // 24 m of wall at 5 cm are 480 cells, and the room has 12 800.
    assert!(n_occupied > 400, "{n_occupied} cells occupied");
    assert!(n_free > 11_000, "{n_free} cells free");
}

#[test]
fn the_base_map_agrees_with_the_room_while_the_robot_drives_and_turns() {
    let mut bench = Bench::new([-1.0, -0.5, 0.3]);
    bench.twist = Twist { speed_m_s: 0.5, yaw_rate_rad_s: 0.8 };
    bench.drive(8.0);
    check_map(&bench.maps.last().unwrap().1);
}

/// How far the pose told last is off the truth, metres and radians.
fn off(bench: &Bench) -> (f64, f64) {
    let odom_from_base = if bench.drift == [0.0; 2] {
        bench.world_from_odom.inverse() * bench.world_from_base
    } else {
        bench.drifted
    };
    let told = bench.poses.last().unwrap().map_from_odom * odom_from_base;
    let off = told.inverse() * bench.world_from_base;
    (off.position().coords.norm(), off.yaw_rad.abs())
}

fn slam(start: [f64; 3]) -> Settings {
    Settings { pose: PoseBy::Slam, start, ..Settings::default() }
}

#[test]
fn wheels_that_drift_lead_odometry_astray_and_not_the_scans() {
    let drive = |pose| {
        let mut bench = Bench::with(Settings { pose, ..slam([-1.0, -0.5, 0.3]) }, None);
        bench.drift = [0.05, 0.035];
        bench.twist = Twist { speed_m_s: 0.5, yaw_rate_rad_s: 0.8 };
        bench.drive(30.0);
        bench
    };
    let (by_scans, by_wheels) = (drive(PoseBy::Slam), drive(PoseBy::Odometry));
    let (off_m, off_rad) = off(&by_scans);
    assert!(off_m < 0.05 && off_rad < 0.02, "{off_m} m, {off_rad} rad off");
    assert!(off(&by_wheels).1 > 0.3, "the drift of this test is none: {:?}", off(&by_wheels));
    check_map(&by_scans.maps.last().unwrap().1);
    assert_eq!(by_scans.poses.len(), 300);
    assert!(by_scans.poses.iter().all(|pose| pose.map_epoch == 1));
}

#[test]
fn a_robot_that_is_carried_off_is_lost_says_so_and_is_found_once_one_place_stands_out() {
    let mut bench = Bench::with(slam([-1.0, -0.5, 0.3]), None);
    bench.twist = Twist { speed_m_s: 0.5, yaw_rate_rad_s: 0.8 };
    bench.drive(8.0);
    bench.twist = Twist::default();
    // The room is nearly the same when turned by half: from here the pillar's side that was mapped is seen.
    let carried = Pose2::new(0.5, 1.2, 2.5);
    // The wheels do not hear of it.
    bench.world_from_odom = carried * bench.world_from_base.inverse() * bench.world_from_odom;
    bench.world_from_base = carried;
    // Two places of the room look alike from where it stands: it goes on looking, and tells none of them.
    bench.drive(10.0);
    let n_told = bench.poses.len();
    assert!(n_told < 90, "{n_told} poses told, and nobody knew where it is");
    assert_eq!(n_told + bench.doubts.len(), 180, "each scan has its word");
    assert_eq!(bench.doubts.last(), Some(&PoseQuality::Lost));
    // Somebody moves it, and one of them no longer fits.
    bench.twist = Twist { speed_m_s: 0.3, yaw_rate_rad_s: 0.5 };
    bench.drive(5.0);
    assert!(bench.troubles.iter().any(|words| words.contains("lost")), "{:?}", bench.troubles);
    let (off_m, off_rad) = off(&bench);
    assert!(off_m < 0.06 && off_rad < 0.02, "{off_m} m, {off_rad} rad off");
    assert_eq!(bench.poses.last().unwrap().map_epoch, 2);
    assert_eq!(bench.troubles.last().unwrap(), "");
}

/// The room as somebody drew it.
fn drawn_room() -> Grid<Occupancy> {
    let shape = mapping::Shape { n_cols: 170, n_rows: 90 };
    let layout = mapping::Layout::new(geometry::Point2::new(-3.25, -2.25), 0.05, shape).unwrap();
    let cell = |cell| {
        let at = layout.centre(cell);
        let is_inside = at.x > ROOM[0] && at.x < ROOM[2] && at.y > ROOM[1] && at.y < ROOM[3];
        let in_pillar = at.x > PILLAR[0] && at.x < PILLAR[2] && at.y > PILLAR[1] && at.y < PILLAR[3];
        if is_inside && !in_pillar { Occupancy::Free } else { Occupancy::Occupied }
    };
    Grid::from_values(layout, layout.cells().map(cell).collect()).unwrap()
}

#[test]
fn in_a_saved_map_the_robot_is_found_and_stays_found_though_wheels_drift() {
    // It was set down half a metre beside where it is said to be.
    let settings = Settings {
        pose: PoseBy::Localise,
        map: Some("room.yaml".into()),
        start: [-1.3, -0.2, 0.1],
        ..Settings::default()
    };
    let mut bench = Bench::with(settings, Some(drawn_room()));
    bench.world_from_base = Pose2::new(-1.0, -0.5, 0.3);
    bench.drift = [0.05, 0.035];
    bench.twist = Twist { speed_m_s: 0.5, yaw_rate_rad_s: 0.8 };
    bench.drive(20.0);
    let (off_m, off_rad) = off(&bench);
    assert!(off_m < 0.06 && off_rad < 0.02, "{off_m} m, {off_rad} rad off");
    assert_eq!(bench.maps.last().unwrap().1.cells, occupancy_bytes(&drawn_room()));
}

#[test]
fn in_a_saved_map_a_robot_that_was_carried_off_tells_no_wrong_pose() {
    let settings =
        Settings { pose: PoseBy::Localise, map: Some("room.yaml".into()), ..slam([-1.0, -0.5, 0.3]) };
    let mut bench = Bench::with(settings, Some(drawn_room()));
    bench.twist = Twist { speed_m_s: 0.5, yaw_rate_rad_s: 0.8 };
    bench.drive(8.0);
    assert_eq!(bench.poses.len(), 80, "{:?}", bench.troubles);
    bench.twist = Twist::default();
    let carried = Pose2::new(0.5, 1.2, 2.5);
    // The wheels do not hear of it.
    bench.world_from_odom = carried * bench.world_from_base.inverse() * bench.world_from_odom;
    bench.world_from_base = carried;
    bench.drive(5.0);
    let is_said = |words: &String| words.contains("uncertain") || words.contains("lost");
    assert!(bench.troubles.iter().any(is_said), "{:?}", bench.troubles);
    assert!(!bench.doubts.is_empty());
    for pose in &bench.poses[80..] {
        let off = pose.map_from_odom.inverse() * bench.world_from_odom;
        let off_m = (pose.map_from_odom.transform(geometry::Point2::origin())
            - bench.world_from_odom.transform(geometry::Point2::origin()))
        .norm();
        assert!(off_m < 0.15 && off.yaw_rad.abs() < 0.03, "told, and {off_m} m, {} rad off", off.yaw_rad);
    }
}

#[test]
fn without_the_saved_map_no_pose_is_told() {
    let settings = Settings { pose: PoseBy::Localise, map: Some("room.yaml".into()), ..Settings::default() };
    let mut bench = Bench::with(settings, None);
    bench.drive(2.0);
    assert_eq!((bench.poses.len(), bench.maps.len()), (0, 0));
    assert!(bench.troubles.last().is_some_and(|words| words.contains("no scan could be used")));
}

#[test]
fn the_pose_is_told_for_every_scan_with_its_stamp_and_echo() {
    let mut bench = Bench::new([1.0, 0.0, 0.5]);
    bench.drive(2.0);
    assert_eq!(bench.poses.len(), 20);
    let pose = &bench.poses[4];
    assert_eq!(pose.header, Header { seq: 5, stamp_ns: START_NS + 450_000_000, echo: 7005 });
    assert_eq!((pose.map_from_odom, pose.quality), (Pose2::new(1.0, 0.0, 0.5), PoseQuality::Good));
    assert!(bench.poses.iter().all(|p| p.map_epoch == 1));
}

#[test]
fn the_map_is_told_at_once_and_then_each_second() {
    let mut bench = Bench::new([0.0; 3]);
    bench.drive(5.0);
    let at_ms: Vec<u64> = bench.maps.iter().map(|(at, _)| at.as_nanos() / 1_000_000).collect();
    assert_eq!(at_ms, [100, 1100, 2100, 3100, 4100]);
    assert!(bench.maps.windows(2).all(|w| w[1].1.header.seq == w[0].1.header.seq + 1));
}

#[test]
fn a_scan_in_a_gap_of_odometry_is_left_out_and_drawn_nowhere() {
    let mut bench = Bench::new([-1.0, 0.0, 0.0]);
    bench.drive(1.0);
    bench.twist = Twist { speed_m_s: 1.0, yaw_rate_rad_s: 1.0 };
    bench.odometry_is_silent = true;
    let n_before = bench.poses.len();
    bench.drive(2.0);
    assert_eq!(bench.poses.len(), n_before);
    assert!(bench.decider.n_left_out() >= 18, "{}", bench.decider.n_left_out());
    assert!(bench.troubles.last().is_some_and(|words| words.contains("odometry")), "{:?}", bench.troubles);
    bench.odometry_is_silent = false;
    bench.drive(2.0);
    assert!(bench.poses.len() >= n_before + 19);
    assert_eq!(bench.troubles.last().unwrap(), "");
    check_map(&bench.maps.last().unwrap().1);
}

#[test]
fn a_base_that_begins_anew_begins_a_new_map() {
    let mut bench = Bench::new([0.0; 3]);
    bench.drive(1.0);
    // It was carried off in between: nobody knows how the new frame lies to the old.
    bench.world_from_base = Pose2::new(1.0, -1.0, 2.0);
    bench.world_from_odom = bench.world_from_base;
    bench.n_odometry = 0;
    bench.drive(2.0);
    assert_eq!(bench.poses.last().unwrap().map_epoch, 2);
    let (_, map) = bench.maps.last().unwrap();
    assert_eq!(map.map_epoch, 2);
    // In the new frame the wall to the left of the room is 4 m behind, turned by two radians.
    let behind = Pose2::new(1.0, -1.0, 2.0).inverse().transform(geometry::Point2::new(-3.0, 0.0));
    let occupied = |dx: f64| {
        let (x, y) = (behind.x + dx * 2.0_f64.cos(), behind.y - dx * 2.0_f64.sin());
        let col = ((x - map.layout.origin_map.x) / map.layout.resolution_m) as usize;
        let row = ((y - map.layout.origin_map.y) / map.layout.resolution_m) as usize;
        map.cells[row * map.layout.n_cols as usize + col]
    };
    assert!([-0.05, 0.0, 0.05].iter().any(|dx| occupied(*dx) == 2));
    assert_eq!(occupied(0.5), 1);
}

#[test]
fn without_scans_there_is_no_map_and_the_trouble_says_so() {
    let mut decider = Decider::new(Settings::default(), &Profile::sim());
    let mut outputs = Vec::new();
    for tick in 0..100 {
        outputs.extend(decider.step(Time::ZERO + Duration::from_millis(50 * tick), Input::Tick));
    }
    assert_eq!(outputs, [Output::Trouble("no scan".into())]);
}
