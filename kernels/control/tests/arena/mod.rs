//! An arena for the filter: worlds from a seed, polygons as obstacles, and a base that shares no code with the
//! rollout. It integrates set-points at 1 ms with an acceleration limit, a lag and a delay, and judges by the
//! polygons themselves, never by a field.

#![allow(dead_code)]

use std::collections::VecDeque;
use std::sync::Arc;

use control::{BaseLayer, Demand, RuleLayer, State, World};
use geometry::{Point2, Polygon, Profile, Twist};
use mapping::{DistanceField, Grid, Layout, Occupancy, distance::signed_distance};
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

pub const CELL_M: f64 = 0.05;

/// Seed of a run: `HEEDWAY_SEED` overrides the default.
pub fn seed(default: u64) -> u64 {
    std::env::var("HEEDWAY_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

/// A count of a run, by an environment variable.
pub fn count(name: &str, default: usize) -> usize {
    std::env::var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

/// What is true of a world, and what the filter is told of it.
pub struct Arena {
    pub obstacles: Vec<Polygon>,
    pub rules: Vec<TrueRule>,
    pub low: Point2,
    pub high: Point2,
    pub map: Grid<Occupancy>,
    pub world: World,
}

/// A rule as the judge sees it.
#[derive(Clone, Debug)]
pub enum TrueRule {
    Exclusion { zone: Polygon, buffer_m: f64 },
    Limit { zone: Option<Polygon>, buffer_m: f64, speed_m_s_max: f64, rate_rad_s_max: f64 },
}

pub fn chance(seed: u64) -> Xoshiro256PlusPlus {
    Xoshiro256PlusPlus::seed_from_u64(seed)
}

pub fn rectangle(centre: Point2, half: (f64, f64), yaw_rad: f64) -> Polygon {
    let (sin, cos) = yaw_rad.sin_cos();
    let corner = |sx: f64, sy: f64| {
        let (x, y) = (sx * half.0, sy * half.1);
        Point2::new(centre.x + cos * x - sin * y, centre.y + sin * x + cos * y)
    };
    Polygon::new(vec![corner(1.0, 1.0), corner(-1.0, 1.0), corner(-1.0, -1.0), corner(1.0, -1.0)]).unwrap()
}

/// A field of a polygon, built as perception would: every cell it may touch is occupied.
pub fn field_of(layout: Layout, polygons: &[Polygon]) -> DistanceField {
    signed_distance(&raster(layout, polygons))
}

fn raster(layout: Layout, polygons: &[Polygon]) -> Grid<bool> {
    let mut occupied = Grid::filled(layout, false);
    let reach_m = layout.resolution_m * std::f64::consts::FRAC_1_SQRT_2;
    for cell in layout.cells() {
        let centre = layout.centre(cell);
        if polygons.iter().any(|p| p.signed_distance_m(centre) <= reach_m) {
            occupied.set(cell, true);
        }
    }
    occupied
}

impl Arena {
    /// A room with walls, `n_obstacles` blocks, and the rules given.
    pub fn new(size: (f64, f64), blocks: Vec<Polygon>, rules: Vec<TrueRule>) -> Arena {
        let (w, h) = size;
        let mut obstacles = blocks;
        let t = 0.1;
        for (x, y, hx, hy) in [
            (w / 2.0, -t, w / 2.0 + 2.0 * t, t),
            (w / 2.0, h + t, w / 2.0 + 2.0 * t, t),
            (-t, h / 2.0, t, h / 2.0 + 2.0 * t),
            (w + t, h / 2.0, t, h / 2.0 + 2.0 * t),
        ] {
            obstacles.push(rectangle(Point2::new(x, y), (hx, hy), 0.0));
        }
        let (low, high) = (Point2::new(-0.3, -0.3), Point2::new(w + 0.3, h + 0.3));
        let layout = Layout::covering(low, high, CELL_M).unwrap();
        let occupied = raster(layout, &obstacles);
        let map = occupied.map(|o| if *o { Occupancy::Occupied } else { Occupancy::Free });
        let base = vec![BaseLayer { name: "the map".into(), field: Arc::new(signed_distance(&occupied)) }];
        let mut arena =
            Arena { obstacles, rules: vec![], low, high, map, world: World { base, ..World::default() } };
        for rule in rules {
            arena.add(rule);
        }
        arena
    }

    pub fn add(&mut self, rule: TrueRule) {
        let layout = *self.map.layout();
        let field = |zone: &Polygon| Arc::new(field_of(layout, std::slice::from_ref(zone)));
        let demand = match &rule {
            TrueRule::Exclusion { zone, buffer_m } => {
                Demand::Exclusion { zone: field(zone), buffer_m: *buffer_m }
            }
            TrueRule::Limit { zone, buffer_m, speed_m_s_max, rate_rad_s_max } => Demand::Limit {
                zone: zone.as_ref().map(field),
                buffer_m: *buffer_m,
                speed_m_s_max: Some(*speed_m_s_max),
                yaw_rate_rad_s_max: rate_rad_s_max.is_finite().then_some(*rate_rad_s_max),
            },
        };
        let id = format!("s{}", self.rules.len() + 1);
        self.world.rules.push(RuleLayer { label: format!("the thing of {id}"), id, demand });
        self.rules.push(rule);
    }

    /// A furnished room with up to `n_rules` rules of every kind, from a seed.
    pub fn generated(seed: u64, n_rules: usize, profile: &Profile) -> Arena {
        let mut c = chance(seed);
        let size = (c.random_range(4.0..8.0), c.random_range(4.0..8.0));
        let within = |c: &mut Xoshiro256PlusPlus| {
            Point2::new(c.random_range(0.0..size.0), c.random_range(0.0..size.1))
        };
        let n_blocks = c.random_range(2..8);
        let blocks = (0..n_blocks)
            .map(|_| {
                let half = (c.random_range(0.03..0.6), c.random_range(0.03..0.6));
                rectangle(within(&mut c), half, c.random_range(-3.0..3.0))
            })
            .collect();
        let rules = (0..n_rules)
            .map(|_| {
                let half = (c.random_range(0.1..0.7), c.random_range(0.1..0.7));
                let zone = rectangle(within(&mut c), half, c.random_range(-3.0..3.0));
                let buffer_m = c.random_range(0.0..0.5);
                let (v, w) = (profile.speed_m_s_max, profile.yaw_rate_rad_s_max);
                match c.random_range(0..4) {
                    0 | 1 => TrueRule::Exclusion { zone, buffer_m },
                    2 => TrueRule::Limit {
                        zone: Some(zone),
                        buffer_m,
                        speed_m_s_max: c.random_range(0.2..0.8) * v,
                        rate_rad_s_max: if c.random() { f64::INFINITY } else { c.random_range(0.3..0.9) * w },
                    },
                    _ => TrueRule::Limit {
                        zone: None,
                        buffer_m: 0.0,
                        speed_m_s_max: c.random_range(0.3..0.9) * v,
                        rate_rad_s_max: f64::INFINITY,
                    },
                }
            })
            .collect();
        Arena::new(size, blocks, rules)
    }

    /// Distance of the hull to the nearest obstacle, metres; negative in collision.
    pub fn clearance_m(&self, place: Point2, radius_m: f64) -> f64 {
        self.obstacles.iter().map(|p| p.signed_distance_m(place)).fold(f64::INFINITY, f64::min) - radius_m
    }

    /// Distance of the hull to the nearest exclusion's border, metres; negative within.
    pub fn exclusion_m(&self, place: Point2, radius_m: f64) -> f64 {
        let distance = |rule: &TrueRule| match rule {
            TrueRule::Exclusion { zone, buffer_m } => Some(zone.signed_distance_m(place) - buffer_m),
            TrueRule::Limit { zone: Some(zone), buffer_m, speed_m_s_max, .. } if *speed_m_s_max == 0.0 => {
                Some(zone.signed_distance_m(place) - buffer_m)
            }
            TrueRule::Limit { .. } => None,
        };
        self.rules.iter().filter_map(distance).fold(f64::INFINITY, f64::min) - radius_m
    }

    /// By how much speed and turn rate break the limits here, in m/s or rad/s; 0 when they are heeded.
    pub fn over_limit(&self, place: Point2, radius_m: f64, speed_m_s: f64, rate_rad_s: f64) -> f64 {
        let over = |rule: &TrueRule| match rule {
            TrueRule::Limit { zone, buffer_m, speed_m_s_max, rate_rad_s_max } => {
                let inside = zone
                    .as_ref()
                    .is_none_or(|zone| zone.signed_distance_m(place) - radius_m - buffer_m <= 0.0);
                if inside { (speed_m_s - speed_m_s_max).max(rate_rad_s.abs() - rate_rad_s_max) } else { 0.0 }
            }
            TrueRule::Exclusion { .. } => 0.0,
        };
        self.rules.iter().map(over).fold(0.0, f64::max)
    }

    /// A place where the hull has `clearance_m` to everything, from a seed; `None` when none is found.
    pub fn free_place(&self, c: &mut Xoshiro256PlusPlus, radius_m: f64, clearance_m: f64) -> Option<Point2> {
        (0..2000).find_map(|_| {
            let place =
                Point2::new(c.random_range(self.low.x..self.high.x), c.random_range(self.low.y..self.high.y));
            let inside =
                place.x > 0.0 && place.y > 0.0 && place.x < self.high.x - 0.3 && place.y < self.high.y - 0.3;
            (inside
                && self.clearance_m(place, radius_m) > clearance_m
                && self.exclusion_m(place, radius_m) > clearance_m)
                .then_some(place)
        })
    }
}

/// How the true base differs from the model.
#[derive(Clone, Copy, Debug, Default)]
pub struct Plant {
    /// Time constant of the speed, seconds.
    pub lag_s: f64,
    /// Commands act this late, milliseconds.
    pub delay_ms: usize,
    /// Largest error of the measured position, metres.
    pub position_m: f64,
    /// Largest error of the measured heading, radians.
    pub yaw_rad: f64,
    /// Largest error of the measured speed, m/s.
    pub speed_m_s: f64,
}

/// The true base.
pub struct Base {
    pub x: f64,
    pub y: f64,
    pub yaw: f64,
    pub v: f64,
    pub rate: f64,
    accel_max: f64,
    plant: Plant,
    queue: VecDeque<Twist>,
}

impl Base {
    pub fn at(place: Point2, yaw: f64, profile: &Profile, plant: Plant) -> Base {
        let queue = std::iter::repeat_n(Twist::ZERO, plant.delay_ms).collect();
        let accel_max = profile.accel_m_s2_max;
        Base { x: place.x, y: place.y, yaw, v: 0.0, rate: 0.0, accel_max, plant, queue }
    }

    pub fn place(&self) -> Point2 {
        Point2::new(self.x, self.y)
    }

    pub fn state(&self) -> State {
        State { x_m: self.x, y_m: self.y, yaw_rad: self.yaw, speed_m_s: self.v }
    }

    /// The state as measured, with errors within the plant's radii.
    pub fn measured(&self, c: &mut Xoshiro256PlusPlus) -> State {
        let direction = c.random_range(-3.2..3.2_f64);
        let size = self.plant.position_m * c.random_range(0.0..=1.0_f64).sqrt();
        let mut signed = |radius: f64| radius * c.random_range(-1.0..=1.0_f64);
        State {
            x_m: self.x + size * direction.cos(),
            y_m: self.y + size * direction.sin(),
            yaw_rad: self.yaw + signed(self.plant.yaw_rad),
            speed_m_s: (self.v + if self.v > 0.0 { signed(self.plant.speed_m_s) } else { 0.0 }).max(0.0),
        }
    }

    /// One millisecond towards a set-point.
    pub fn millisecond(&mut self, command: Twist) {
        self.queue.push_back(command);
        let set = self.queue.pop_front().unwrap_or(command);
        let dt = 1e-3;
        let most = self.accel_max * dt;
        let gap = set.speed_m_s - self.v;
        let pull = if self.plant.lag_s > 0.0 { gap * dt / self.plant.lag_s } else { gap };
        let before = self.v;
        self.v = (self.v + pull.clamp(-most, most)).max(0.0);
        self.rate = set.yaw_rate_rad_s;
        // An exact arc at the mean speed: chord and mid heading.
        let (length, turn) = ((before + self.v) / 2.0 * dt, self.rate * dt);
        let half = turn / 2.0;
        let chord = if half == 0.0 { length } else { length * half.sin() / half };
        self.x += chord * (self.yaw + half).cos();
        self.y += chord * (self.yaw + half).sin();
        self.yaw += turn;
    }
}
