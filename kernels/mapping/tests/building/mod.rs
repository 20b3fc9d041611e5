//! Generated buildings, and a LiDAR in them: a corridor that runs around a block, with doorways into rooms, things
//! standing about, glass, and people.
//!
//! The slow, obvious world that mapping is tested against; it shares no code with it.

use std::f64::consts::{PI, TAU};

use geometry::{Point2, Pose2};
use mapping::base_map::Scan;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Width of the corridor, metres.
const CORRIDOR_M: f64 = 2.2;
/// Farthest that the LiDAR sees, metres.
pub const RANGE_MAX_M: f64 = 25.0;

/// A wall from point to point; glass lets most beams through.
#[derive(Clone, Copy)]
struct Wall {
    from: Point2,
    to: Point2,
    is_glass: bool,
}

/// A building, seen from above.
pub struct Building {
    walls: Vec<Wall>,
    /// Middle of the corridor: width and height of the ring, metres.
    ring: [f64; 2],
}

/// What a LiDAR does.
#[derive(Clone, Copy)]
pub struct Lidar {
    pub n_beams: usize,
    pub fov_rad: f64,
    /// Standard deviation of a range, metres.
    pub noise_m: f64,
    /// Share of the beams that see nothing.
    pub dropouts: f64,
    /// People around, as many as this.
    pub n_people: usize,
}

impl Default for Lidar {
    fn default() -> Self {
        Lidar { n_beams: 360, fov_rad: TAU, noise_m: 0.015, dropouts: 0.02, n_people: 0 }
    }
}

impl Lidar {
    pub fn angle_min_rad(&self) -> f64 {
        -self.fov_rad / 2.0
    }

    pub fn angle_step_rad(&self) -> f64 {
        self.fov_rad / self.n_beams as f64
    }
}

impl Building {
    /// A building of its own for each seed.
    pub fn generated(seed: u64) -> Self {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
        let ring = [rng.random_range(12.0..18.0), rng.random_range(9.0..13.0)];
        let mut building = Building { walls: Vec::new(), ring };
        let half = CORRIDOR_M / 2.0;
        let corner = |grow: f64| {
            let (w, h) = (ring[0] + grow, ring[1] + grow);
            [Point2::new(-grow, -grow), Point2::new(w, -grow), Point2::new(w, h), Point2::new(-grow, h)]
        };
        for (corners, outwards) in [(corner(half), 1.0), (corner(-half), -1.0)] {
            for side in 0..4 {
                building.wall_with_rooms(corners[side], corners[(side + 1) % 4], outwards, &mut rng);
            }
        }
        building
    }

    /// A wall with doorways; behind each lies a small room of its own size, with something in it.
    fn wall_with_rooms(&mut self, from: Point2, to: Point2, outwards: f64, rng: &mut Xoshiro256PlusPlus) {
        let length_m = (to - from).norm();
        let along = (to - from) / length_m;
        // To the right of the way around is outside.
        let aside = nalgebra::Vector2::new(along.y, -along.x) * outwards;
        let mut done_m = 0.0;
        loop {
            let door_m = done_m + rng.random_range(0.8..3.5);
            let width_m = rng.random_range(0.8..1.6);
            let depth_m = rng.random_range(0.3..2.5);
            if door_m + width_m + 0.6 > length_m {
                break;
            }
            let at = |along_m: f64, aside_m: f64| from + along * along_m + aside * aside_m;
            let is_glass = rng.random_bool(0.1);
            self.wall(at(done_m, 0.0), at(door_m, 0.0), is_glass);
            self.wall(at(door_m, 0.0), at(door_m, depth_m), false);
            self.wall(at(door_m, depth_m), at(door_m + width_m, depth_m), false);
            self.wall(at(door_m + width_m, depth_m), at(door_m + width_m, 0.0), false);
            let (x, y) = (rng.random_range(0.1..0.9) * width_m, rng.random_range(0.3..0.9) * depth_m);
            self.wall(at(door_m + x, y), at(door_m + x + 0.15, y + 0.1), false);
            done_m = door_m + width_m;
        }
        self.wall(from + along * done_m, to, false);
    }

    fn wall(&mut self, from: Point2, to: Point2, is_glass: bool) {
        self.walls.push(Wall { from, to, is_glass });
    }

    /// Poses along the corridor, around and around, `step_m` apart, swaying a little.
    pub fn way(&self, n: usize, step_m: f64) -> Vec<Pose2> {
        let [w, h] = self.ring;
        let place = |way_m: f64| {
            let way_m = way_m.rem_euclid(2.0 * (w + h));
            match way_m {
                m if m < w => Point2::new(m, 0.0),
                m if m < w + h => Point2::new(w, m - w),
                m if m < 2.0 * w + h => Point2::new(2.0 * w + h - m, h),
                m => Point2::new(0.0, 2.0 * (w + h) - m),
            }
        };
        (0..n)
            .map(|idx| {
                let way_m = idx as f64 * step_m;
                // Corners are cut: the mean of a metre of the way, seen from both ends.
                let mean = |from_m: f64| {
                    let sum: nalgebra::Vector2<f64> =
                        (0..12).map(|k| place(from_m + f64::from(k) * 0.15).coords).sum();
                    Point2::from(sum / 12.0)
                };
                let (here, next) = (mean(way_m), mean(way_m + 0.3));
                let sway = 0.12 * (way_m * 0.7).sin();
                let yaw_rad = (next.y - here.y).atan2(next.x - here.x) + sway;
                Pose2::new(here.x - sway * yaw_rad.sin(), here.y + sway * yaw_rad.cos(), yaw_rad)
            })
            .collect()
    }

    /// One scan, metres; infinite is no return.
    pub fn scan(&self, world_from_lidar: Pose2, lidar: &Lidar, rng: &mut Xoshiro256PlusPlus) -> Vec<f32> {
        let eye = world_from_lidar.position();
        let people: Vec<Point2> = (0..lidar.n_people)
            .map(|_| {
                let (angle_rad, far_m) = (rng.random_range(-PI..PI), rng.random_range(0.8..4.0));
                Point2::new(eye.x + far_m * angle_rad.cos(), eye.y + far_m * angle_rad.sin())
            })
            .collect();
        (0..lidar.n_beams)
            .map(|idx| {
                let angle_rad =
                    world_from_lidar.yaw_rad + lidar.angle_min_rad() + idx as f64 * lidar.angle_step_rad();
                let ray = nalgebra::Vector2::new(angle_rad.cos(), angle_rad.sin());
                let mut range_m = f64::INFINITY;
                for wall in &self.walls {
                    if let Some(hit_m) = crossing_m(eye, ray, wall)
                        && !(wall.is_glass && rng.random_bool(0.7))
                    {
                        range_m = range_m.min(hit_m);
                    }
                }
                for person in &people {
                    let off = person - eye;
                    let (along, across) = (off.dot(&ray), off.x * ray.y - off.y * ray.x);
                    if along > 0.0 && across.abs() < 0.2 {
                        range_m = range_m.min(along - 0.2);
                    }
                }
                let noise: f64 = (0..12).map(|_| rng.random_range(-0.5..0.5)).sum();
                let is_seen = range_m < RANGE_MAX_M && !rng.random_bool(lidar.dropouts);
                if is_seen { (range_m + lidar.noise_m * noise).max(0.05) as f32 } else { f32::INFINITY }
            })
            .collect()
    }
}

/// What a LiDAR says of its ranges.
pub fn scan_of<'a>(ranges_m: &'a [f32], lidar: &Lidar) -> Scan<'a> {
    Scan {
        ranges_m,
        angle_min_rad: lidar.angle_min_rad(),
        angle_increment_rad: lidar.angle_step_rad(),
        range_min_m: 0.05,
        range_max_m: RANGE_MAX_M,
        no_return_is_free: false,
    }
}

/// A motion as wheels tell it that err by a share of the way and by radians for each metre.
pub fn told(truly: Pose2, [share, turn_rad_m]: [f64; 2]) -> Pose2 {
    let way_m = truly.position().coords.norm();
    let scale = 1.0 + share;
    Pose2::new(scale * truly.x_m, scale * truly.y_m, truly.yaw_rad + turn_rad_m * way_m)
}

fn crossing_m(eye: Point2, ray: nalgebra::Vector2<f64>, wall: &Wall) -> Option<f64> {
    let way = wall.to - wall.from;
    let across = ray.x * way.y - ray.y * way.x;
    let off = wall.from - eye;
    let along_m = (off.x * way.y - off.y * way.x) / across;
    let share = (off.x * ray.y - off.y * ray.x) / across;
    (along_m > 0.0 && (0.0..=1.0).contains(&share)).then_some(along_m)
}
