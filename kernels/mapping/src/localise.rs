//! Where the robot is in a map that is given and does not change.
//!
//! Each scan is matched against the map's occupied cells, starting from where odometry says it should lie.
//! Things that stand where the map is free count against a match; several scans that do not fit, and the robot
//! is lost: it is then looked for all over the map, a part with each scan, and found when one place stands out
//! among all. A robot that fits worse than it used to is looked for in the same way, while it is followed where it
//! seems to be: until all of the map was looked at and no place fits better, its pose is uncertain.

use geometry::Pose2;
use nalgebra::Vector2;

use crate::base_map::{BaseMapError, Scan};
use crate::grid::{Cell, Grid, Occupancy};
use crate::scan_match::{self, Candidate, Cloud, CloudPoint, Evidence, FreeGrid, MatchMap, Prior, Window};
use crate::slam::{
    Doubt, Judge, MotionConfig, MotionModel, Place, Standing, Sweep, Verdict, agrees_surely, follow,
    is_motion,
};

/// So many places of each square are compared.
const N_PLACES: usize = 12;
/// When all squares have been looked at, the robot has moved on: so far the place may be off.
const NEAR: Window = Window { shift_m: 0.5, turn_rad: 0.3 };
/// With fewer points no place is told from another.
const N_POINTS_MIN: usize = 40;
/// A lost robot is looked for in squares of this half side, metres, one with each scan.
const SQUARE_M: f64 = 5.0;
/// A pose that was found anew this far from the foreseen one has jumped: metres.
const JUMP_M: f64 = 0.3;
/// How far off it may have been set down, metres and radians: one deviation.
const START_SHIFT_M: f64 = 0.35;
const START_TURN_RAD: f64 = 0.2;
/// The direction of a wall is taken from occupied cells this near, cells.
const NORMAL_REACH: isize = 3;

/// What one scan told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The pose in the map.
    pub map_from_base: Pose2,
    /// How well it is known.
    pub standing: Standing,
    /// It is elsewhere than the scans before had it.
    pub has_jumped: bool,
}

/// Localisation in a given map.
pub struct Localiser {
    base_from_lidar: Pose2,
    range_used_m: f64,
    map: MatchMap,
    occupancy: Grid<Occupancy>,
    motion: MotionModel,
    judge: Judge,
    map_from_base: Pose2,
    is_first: bool,
    doubt: Doubt,
    sweep: Sweep,
}

impl Localiser {
    /// A robot somewhere near `map_from_base` in a map.
    #[must_use]
    pub fn new(
        occupancy: Grid<Occupancy>,
        base_from_lidar: Pose2,
        range_used_m: f64,
        motion: MotionConfig,
        map_from_base: Pose2,
    ) -> Self {
        let mut map = MatchMap::new(occupancy.layout().resolution_m);
        map.insert(&surfaces(&occupancy), Pose2::IDENTITY);
        map.set_free(free_of(&occupancy));
        Localiser {
            base_from_lidar,
            range_used_m,
            map,
            occupancy,
            motion: MotionModel::new(motion),
            judge: Judge::default(),
            map_from_base,
            is_first: true,
            doubt: Doubt::default(),
            sweep: Sweep::default(),
        }
    }

    /// The map.
    #[must_use]
    pub fn occupancy(&self) -> &Grid<Occupancy> {
        &self.occupancy
    }

    /// Takes in one scan; `last_from_now` as in [`crate::slam::Slam::step`].
    ///
    /// # Errors
    /// [`BaseMapError::Scan`] when the scan cannot be.
    pub fn step(&mut self, scan: &Scan<'_>, last_from_now: Option<Pose2>) -> Result<Found, BaseMapError> {
        scan.check()?;
        let last_from_now = last_from_now.filter(is_motion);
        let cloud = Cloud::of_scan(scan, self.base_from_lidar, self.range_used_m);
        let last = self.map_from_base;
        if self.judge.standing() == Standing::Lost {
            let last_from_now = last_from_now.unwrap_or_default();
            self.map_from_base = last * last_from_now;
            let has_jumped = self.look_everywhere(&cloud, last_from_now);
            return Ok(self.found(has_jumped));
        }
        let foreseen = self.motion.foresee(last_from_now).after_misses(self.judge.n_bad());
        // Where it was set down is known roughly.
        let foreseen =
            if self.is_first { foreseen.no_surer_than(START_SHIFT_M, START_TURN_RAD) } else { foreseen };
        self.sweep.carry(foreseen.last_from_now);
        let followed = follow(&self.map, &cloud, &last, &foreseen, foreseen.window());
        self.judge.hear(followed.is_some_and(|f| f.is_good));
        let Some(followed) = followed.filter(|f| f.is_good) else {
            self.motion.forget();
            self.map_from_base = last * foreseen.last_from_now;
            return Ok(self.found(false));
        };
        self.motion.learn(&last, &followed.pose, &foreseen, followed.variance);
        self.map_from_base = followed.pose;
        self.is_first = false;
        let was_open = self.doubt.is_open();
        // A map that is given holds all there is.
        self.doubt.hear(followed.share, 0.0);
        let has_jumped = match (was_open, self.doubt.is_open()) {
            (true, true) => self.look_for_better(&cloud, followed.share),
            (true, false) => {
                self.sweep = Sweep::default();
                false
            }
            // The first one may be a passer-by.
            (false, _) => false,
        };
        Ok(self.found(has_jumped))
    }

    fn found(&self, has_jumped: bool) -> Found {
        let standing = match self.judge.standing() {
            Standing::Good if self.doubt.is_open() => Standing::Uncertain,
            standing => standing,
        };
        Found { map_from_base: self.map_from_base, standing, has_jumped }
    }

    /// Looks into one square of the map for a robot that fits worse than it used to; true when all have been
    /// looked at and it is elsewhere.
    fn look_for_better(&mut self, cloud: &Cloud, share: f64) -> bool {
        if cloud.points().len() < N_POINTS_MIN {
            return false;
        }
        let score = Evidence::of(&self.map, cloud, self.map_from_base).score();
        let here = Place { map_from_base: self.map_from_base, score, part: 0 };
        match self.sweep.compare(&here, self.n_squares()) {
            Verdict::NotYet => self.look_into_next_square(cloud),
            Verdict::Here => self.doubt.dismiss(share),
            Verdict::There(place) if self.settle_at(place.map_from_base, cloud) => return true,
            Verdict::There(_) | Verdict::Unknown => self.judge.lose(),
        }
        false
    }

    /// Looks into one square of the map at any heading; true when all have been looked at, one place stands out,
    /// and it is far from where the robot was thought to be.
    fn look_everywhere(&mut self, cloud: &Cloud, last_from_now: Pose2) -> bool {
        self.sweep.carry(last_from_now);
        if cloud.points().len() < N_POINTS_MIN {
            return false;
        }
        if let Some(place) = self.sweep.decide(self.n_squares()) {
            return self.settle_at(place.map_from_base, cloud);
        }
        self.look_into_next_square(cloud);
        false
    }

    /// Squares that the map is looked into by, along x and along y.
    fn squares(&self) -> [usize; 2] {
        let (low, high) = (self.occupancy.layout().origin, self.occupancy.layout().far_corner());
        let n_side = ((high - low) / (2.0 * SQUARE_M)).map(|n| n.ceil().max(1.0) as usize);
        [n_side.x, n_side.y]
    }

    fn n_squares(&self) -> usize {
        let [n_cols, n_rows] = self.squares();
        n_cols * n_rows
    }

    fn look_into_next_square(&mut self, cloud: &Cloud) {
        let low = self.occupancy.layout().origin;
        let nth = self.sweep.next_part(self.n_squares());
        let [n_cols, _] = self.squares();
        let at = |axis_low: f64, idx: usize| axis_low + (2 * idx + 1) as f64 * SQUARE_M;
        let middle = Pose2::new(at(low.x, nth % n_cols), at(low.y, nth / n_cols), 0.0);
        let anywhere = Prior { map_from_scan: middle, shift_m: 100.0, turn_rad: 10.0 };
        let window = Window { shift_m: SQUARE_M, turn_rad: std::f64::consts::PI };
        let places = scan_match::candidates(&self.map, cloud, &anywhere, window, N_PLACES);
        self.sweep.look(nth, Pose2::IDENTITY, &places);
    }

    /// Goes on at a place, if the scan fits there.
    fn settle_at(&mut self, map_from_base: Pose2, cloud: &Cloud) -> bool {
        let expected = Prior { map_from_scan: map_from_base, shift_m: NEAR.shift_m, turn_rad: NEAR.turn_rad };
        let places = scan_match::candidates(&self.map, cloud, &expected, NEAR, 1);
        let is_sure = |c: &&Candidate| agrees_surely(&c.evidence);
        let Some(found) = places.first().filter(is_sure).map(|c| c.found) else { return false };
        let off_m = (found.map_from_scan.position() - self.map_from_base.position()).norm();
        self.map_from_base = found.map_from_scan;
        self.judge.found();
        self.doubt.close();
        off_m > JUMP_M
    }
}

/// The free cells.
fn free_of(occupancy: &Grid<Occupancy>) -> FreeGrid {
    let layout = occupancy.layout();
    let mut free = FreeGrid::default();
    free.make_room(layout.origin.cast(), layout.far_corner().cast());
    for cell in layout.cells().filter(|cell| *occupancy.get(*cell) == Occupancy::Free) {
        free.free(layout.centre(cell));
    }
    free
}

/// The occupied cells that border free ones, with the direction of what they are part of, towards the free side.
fn surfaces(occupancy: &Grid<Occupancy>) -> Cloud {
    let layout = occupancy.layout();
    let beside = |cell: Cell, dx: isize, dy: isize| {
        layout.shape.beside(cell, (dx, dy)).map(|cell| *occupancy.get(cell))
    };
    let around = || {
        (-NORMAL_REACH..=NORMAL_REACH).flat_map(|dy| (-NORMAL_REACH..=NORMAL_REACH).map(move |dx| (dx, dy)))
    };
    let mut points = Vec::new();
    for cell in layout.cells().filter(|cell| *occupancy.get(*cell) == Occupancy::Occupied) {
        let is_border = [(1, 0), (-1, 0), (0, 1), (0, -1)]
            .into_iter()
            .any(|(dx, dy)| beside(cell, dx, dy) == Some(Occupancy::Free));
        if !is_border {
            continue;
        }
        let (mut n, mut sum, mut squares, mut to_free) = (0.0, [0.0; 2], [0.0; 3], Vector2::zeros());
        for (dx, dy) in around() {
            let (x, y) = (dx as f32, dy as f32);
            match beside(cell, dx, dy) {
                Some(Occupancy::Occupied) => {
                    n += 1.0;
                    sum = [sum[0] + x, sum[1] + y];
                    squares = [squares[0] + x * x, squares[1] + x * y, squares[2] + y * y];
                }
                Some(Occupancy::Free) => to_free += Vector2::new(x, y),
                _ => {}
            }
        }
        let mean = sum.map(|s| s / n);
        let (xx, xy, yy) = (
            squares[0] / n - mean[0] * mean[0],
            squares[1] / n - mean[0] * mean[1],
            squares[2] / n - mean[1] * mean[1],
        );
        let half = ((xx - yy) / 2.0).hypot(xy);
        let is_line = n >= 3.0 && (xx + yy) / 2.0 - half < 0.3 * ((xx + yy) / 2.0 + half);
        let along_rad = 0.5 * (2.0 * xy).atan2(xx - yy);
        let mut normal = Vector2::new(-along_rad.sin(), along_rad.cos());
        if normal.dot(&to_free) < 0.0 {
            normal = -normal;
        }
        let normal = if is_line { normal } else { Vector2::zeros() };
        points.push(CloudPoint { at: layout.centre(cell).cast(), normal });
    }
    Cloud::from_points(points)
}
