//! Follows a path: the nominal command at 20 Hz.
//!
//! Aims at the farthest point of the path in clear line of sight: following the next point cuts corners into
//! the filter's margin, which was the main cause of deadlock in a prototype. It knows nothing of rules; the
//! filter does. Proportional in heading error, with the turn of the line of sight fed forward.

use geometry::{Point2, Pose2, Profile, Twist, angle::turn};

use crate::costmap::Costmap;

/// How hard the tracker turns and where it stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerGains {
    /// Turn rate per heading error, 1/s.
    pub yaw_per_s: f64,
    /// Share of the line of sight's own turn that is fed forward.
    pub sight: f64,
    /// Heading error above which it turns in place, radians.
    pub turn_in_place_rad: f64,
    /// Share of the top deceleration used to slow towards the goal.
    pub braking_share: f64,
    /// Distance to the goal at which it stops, metres.
    pub goal_tolerance_m: f64,
}

impl Default for TrackerGains {
    /// Chosen: stable at 20 Hz with half a step of delay on both profiles.
    fn default() -> Self {
        TrackerGains {
            yaw_per_s: 3.0,
            sight: 0.5,
            turn_in_place_rad: 0.6,
            braking_share: 0.5,
            goal_tolerance_m: 0.1,
        }
    }
}

/// The tracker of one robot.
#[derive(Clone, Debug)]
pub struct Tracker {
    gains: TrackerGains,
    speed_m_s_max: f64,
    yaw_rate_rad_s_max: f64,
    accel_m_s2_max: f64,
}

impl Tracker {
    /// A tracker within the limits of a profile.
    #[must_use]
    pub fn new(profile: &Profile, gains: TrackerGains) -> Tracker {
        Tracker {
            gains,
            speed_m_s_max: profile.speed_m_s_max,
            yaw_rate_rad_s_max: profile.yaw_rate_rad_s_max,
            accel_m_s2_max: profile.accel_m_s2_max,
        }
    }

    /// The nominal command at a pose in `map` with a forward speed, towards the end of `path`.
    ///
    /// Stops within the goal tolerance, and when the path is empty or the pose not finite.
    #[must_use]
    pub fn step(&self, map_from_base: Pose2, speed_m_s: f64, path: &[Point2], map: &Costmap) -> Twist {
        let place = map_from_base.position();
        let Some(goal) = path.last().filter(|_| map_from_base.is_finite() && speed_m_s.is_finite()) else {
            return Twist::ZERO;
        };
        let goal_m = (goal - place).norm();
        if goal_m <= self.gains.goal_tolerance_m {
            return Twist::ZERO;
        }
        let nearest_idx = nearest(path, place);
        let aim = aim(path, nearest_idx, place, map);
        let sight = aim - place;
        let error_rad = turn(map_from_base.yaw_rad, sight.y.atan2(sight.x));
        let sight_rad_s = speed_m_s * error_rad.sin() / sight.norm().max(0.2);
        let rate_rad_s = (self.gains.yaw_per_s * error_rad + self.gains.sight * sight_rad_s)
            .clamp(-self.yaw_rate_rad_s_max, self.yaw_rate_rad_s_max);
        if error_rad.abs() > self.gains.turn_in_place_rad {
            return Twist::new(0.0, rate_rad_s);
        }
        let braking_m_s2 = self.gains.braking_share * self.accel_m_s2_max;
        let to_stop_m_s = (2.0 * braking_m_s2 * goal_m).sqrt();
        // The path may turn at the aim: arrive there slowly enough to turn.
        let bend_rad = bend_after(path, aim, (sight.x, sight.y));
        let at_aim_m_s = self.speed_m_s_max * bend_rad.cos().max(0.2);
        let to_aim_m_s = (at_aim_m_s.powi(2) + 2.0 * braking_m_s2 * sight.norm()).sqrt();
        let aligned = 1.0 - error_rad.abs() / self.gains.turn_in_place_rad;
        let wanted_m_s = self.speed_m_s_max.min(to_stop_m_s).min(to_aim_m_s) * aligned.max(0.0);
        Twist::new(wanted_m_s, rate_rad_s)
    }
}

/// Position in the path of the point nearest to a place.
fn nearest(path: &[Point2], place: Point2) -> usize {
    let by_distance = |a: &Point2, b: &Point2| (a - place).norm().total_cmp(&(b - place).norm());
    path.iter().enumerate().min_by(|a, b| by_distance(a.1, b.1)).map_or(0, |(idx, _)| idx)
}

/// Up to this room the line of sight keeps as far from things as the path that it cuts short, metres. Chosen:
/// a base that turns late at full speed still has some of it left. Without it the office's narrow passage
/// was taken at the least clearance, and the robot stuck there for seconds.
const SIGHT_ROOM_M: f64 = 0.15;

/// The farthest point of the path in clear line of sight; the next one when none is.
fn aim(path: &[Point2], nearest_idx: usize, place: Point2, map: &Costmap) -> Point2 {
    let ahead = path.get(nearest_idx..).unwrap_or(path);
    // The least room on the way to each point; half a cell is lost between a path of cells and a line.
    let slack_m = 0.5 * map.layout().resolution_m;
    let least_so_far = |least_m: &mut f64, point: &Point2| {
        *least_m = least_m.min(map.room_m(*point) - slack_m);
        Some((*point, least_m.max(0.0)))
    };
    let here_m = (map.room_m(place) - slack_m).clamp(0.0, SIGHT_ROOM_M);
    let rooms: Vec<(Point2, f64)> = ahead.iter().scan(here_m, least_so_far).collect();
    let seen =
        rooms.iter().rev().find(|(point, room_m)| map.sees(place, *point, *room_m)).map(|(point, _)| point);
    // Out of sight of everything: the next point that is not underfoot.
    let next = || ahead.iter().find(|point| (*point - place).norm() > 0.05);
    seen.or_else(next).or(ahead.last()).copied().unwrap_or(place)
}

/// How much the path turns after the aim, against the line of sight, radians.
fn bend_after(path: &[Point2], aim: Point2, (sight_x_m, sight_y_m): (f64, f64)) -> f64 {
    let Some(idx) = path.iter().position(|point| *point == aim) else { return 0.0 };
    let Some(next) = path.get((idx + 4).min(path.len() - 1)).filter(|next| **next != aim) else {
        return 0.0;
    };
    let onward = next - aim;
    turn(sight_y_m.atan2(sight_x_m), onward.y.atan2(onward.x)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::astar::shortest_path;
    use mapping::{Cell, Grid, Layout, Occupancy, Shape};

    /// A room of 5 × 4 m with a wall from below at x = 2.5 m, 2.5 m long.
    fn map() -> Costmap {
        let layout = Layout::new(Point2::origin(), 0.05, Shape { n_cols: 100, n_rows: 80 }).unwrap();
        let mut grid = Grid::filled(layout, Occupancy::Free);
        for row in 0..50 {
            grid.set(Cell { col: 50, row }, Occupancy::Occupied);
        }
        Costmap::new(&grid, &[], 0.05, &Profile::sim())
    }

    fn tracker() -> Tracker {
        Tracker::new(&Profile::sim(), TrackerGains::default())
    }

    #[test]
    fn it_drives_around_the_wall_to_the_goal_and_stops_there() {
        let (map, goal) = (map(), Point2::new(4.0, 1.0));
        for profile in [Profile::sim(), Profile::turtlebot2()] {
            let tracker = Tracker::new(&profile, TrackerGains::default());
            let (mut pose, mut speed_m_s) = (Pose2::new(1.0, 1.0, -2.0), 0.0_f64);
            let path = shortest_path(&map, pose.position(), goal).unwrap();
            for _ in 0..1200 {
                let wanted = tracker.step(pose, speed_m_s, &path, &map);
                let most = profile.accel_m_s2_max * 0.05;
                speed_m_s += (wanted.speed_m_s - speed_m_s).clamp(-most, most);
                pose = pose.along_arc(speed_m_s, wanted.yaw_rate_rad_s, 0.05);
                assert!(map.is_free(pose.position()), "{}: cut the corner at {pose:?}", profile.name);
            }
            assert!((pose.position() - goal).norm() <= 0.12 && speed_m_s == 0.0, "{pose:?} {speed_m_s}");
        }
    }

    #[test]
    fn it_aims_at_the_farthest_point_in_sight_and_not_through_the_wall() {
        let (map, goal) = (map(), Point2::new(4.0, 1.0));
        let start = Point2::new(1.0, 1.0);
        let path = shortest_path(&map, start, goal).unwrap();
        let aimed = aim(&path, 0, start, &map);
        assert!(aimed.y > 2.0 && (aimed - start).norm() > 1.0, "{aimed:?}");
        assert!(map.sees(start, aimed, 0.0) && !map.sees(start, goal, 0.0));
    }

    #[test]
    fn who_came_nearer_to_a_slanting_wall_than_the_path_still_sees_far() {
        let layout = Layout::new(Point2::origin(), 0.05, Shape { n_cols: 100, n_rows: 80 }).unwrap();
        let mut grid = Grid::filled(layout, Occupancy::Free);
        for cell in layout.cells().filter(|cell| cell.row * 7 > 350 + cell.col) {
            grid.set(cell, Occupancy::Occupied);
        }
        let map = Costmap::new(&grid, &[], 0.05, &Profile::sim());
        // Along the wall, 0.1 m farther from it than the robot, whose room is less than the sight's.
        let along = |x: f64, off_m: f64| Point2::new(x, 2.5 + x / 7.0 - 0.39 - off_m);
        let path: Vec<Point2> = (0..60).map(|k| along(1.0 + 0.05 * f64::from(k), 0.1)).collect();
        for k in 0..20 {
            let place = along(1.0 + 0.017 * f64::from(k), 0.0);
            assert!((0.02..SIGHT_ROOM_M).contains(&map.room_m(place)), "{}", map.room_m(place));
            let aimed = aim(&path, nearest(&path, place), place, &map);
            assert!((aimed - place).norm() > 1.5, "from {place:?} at {aimed:?}");
        }
    }

    #[test]
    fn a_large_heading_error_is_turned_off_in_place() {
        let path = [Point2::new(1.0, 3.0), Point2::new(1.0, 3.5)];
        let wanted = tracker().step(Pose2::new(1.0, 1.0, -1.5), 0.0, &path, &map());
        assert_eq!((wanted.speed_m_s, wanted.yaw_rate_rad_s.abs()), (0.0, 1.0));
    }

    #[test]
    fn without_a_path_or_a_pose_it_stands_still() {
        let pose = Pose2::new(1.0, 1.0, 0.0);
        assert_eq!(tracker().step(pose, 0.0, &[], &map()), Twist::ZERO);
        let lost = Pose2 { x_m: f64::NAN, ..pose };
        assert_eq!(tracker().step(lost, 0.0, &[Point2::new(2.0, 2.0)], &map()), Twist::ZERO);
    }
}
