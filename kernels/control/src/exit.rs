//! The way out of a zone: distance to its exit along floor that the robot fits on.
//!
//! Straight-line distance to the border deadlocks between walls; a flood over the cells that the hull fits on
//! does not. Local, around the robot, no wider than the exit is far, and kept for some ticks by its owner.

use geometry::Point2;

use crate::scene::Scene;

/// Cells along one side of the flood.
const N_SIDE: usize = 161;
/// Sides of a cell tried, metres: the second when no exit lies within the first's 4 m.
const CELLS_M: [f64; 2] = [0.05, 0.1];
/// How far outside every zone a place must be to count as an exit, metres.
const CLEAR_M: f64 = 0.02;
/// How much farther than the nearest exit is looked, metres: ways that are a little longer may be faster.
const BEYOND_M: f64 = 0.5;

/// What is known of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cell {
    Unseen,
    Blocked,
    Inside,
    Exit,
}

/// Distance to the nearest exit, metres, for every cell around the robot.
#[derive(Debug, Default)]
pub(crate) struct ExitMap {
    low: Point2,
    cell_m: f64,
    distance_m: Vec<f32>,
    // Room to find it in, kept so that finding it again allocates nothing.
    cells: Vec<Cell>,
    exits: Vec<usize>,
    flood: Flood,
}

impl ExitMap {
    /// Floods around the start of a scene, in place of what it was; whether an exit can be reached from there. If not,
    /// it is a map of nothing.
    ///
    /// Zones that the robot is not in are walls, unless the scene calls them soft.
    pub(crate) fn find(&mut self, scene: &Scene<'_>) -> bool {
        CELLS_M.into_iter().any(|cell_m| self.find_by(scene, cell_m))
    }

    fn find_by(&mut self, scene: &Scene<'_>, cell_m: f64) -> bool {
        let centre = scene.start.position();
        let half_m = N_SIDE as f64 * cell_m / 2.0;
        (self.low, self.cell_m) = (Point2::new(centre.x - half_m, centre.y - half_m), cell_m);
        self.spread_from_start(scene);
        self.spread_from_exits();
        let metres = |fifths: &u32| match *fifths {
            NEVER => f32::INFINITY,
            fifths => fifths as f32 * (cell_m / f64::from(STEPS[0])) as f32,
        };
        self.distance_m.clear();
        self.distance_m.extend(self.flood.length.iter().map(metres));
        !self.exits.is_empty()
    }

    /// Outwards from the robot: only cells that it can reach are asked for, up to a little beyond the nearest exit.
    fn spread_from_start(&mut self, scene: &Scene<'_>) {
        let ExitMap { low, cell_m, cells, exits, flood, .. } = self;
        let place_of = |idx: usize| {
            *low + Point2::new((idx % N_SIDE) as f64 + 0.5, (idx / N_SIDE) as f64 + 0.5).coords * *cell_m
        };
        cells.clear();
        cells.resize(N_SIDE * N_SIDE, Cell::Unseen);
        exits.clear();
        flood.clear();
        // It may stand in a cell that is not free by a hair: its neighbours are begun from as well.
        let middle = (N_SIDE / 2) * N_SIDE + N_SIDE / 2;
        flood.begin(middle, 0);
        for (idx, step) in neighbours(middle) {
            flood.begin(idx, step);
        }
        let beyond = (BEYOND_M / *cell_m) as u32 * STEPS[0];
        let mut far = NEVER;
        while let Some((idx, here)) = flood.next(far) {
            if cells[idx] == Cell::Unseen {
                cells[idx] = look(scene, place_of(idx));
            }
            match cells[idx] {
                Cell::Exit => {
                    exits.push(idx);
                    far = far.min(here + beyond);
                }
                Cell::Inside => {}
                Cell::Blocked | Cell::Unseen => continue,
            }
            flood.spread(idx, here, |_| true);
        }
    }

    /// Back from the exits, over what was reached.
    fn spread_from_exits(&mut self) {
        let ExitMap { cells, exits, flood, .. } = self;
        flood.clear();
        for idx in exits.iter() {
            flood.begin(*idx, 0);
        }
        while let Some((idx, here)) = flood.next(NEVER) {
            flood.spread(idx, here, |next| matches!(cells[next], Cell::Inside | Cell::Exit));
        }
    }

    /// Distance to the exit from a place, metres; infinite when there is no way, the place is off the map, or it
    /// is much farther than the nearest exit.
    pub(crate) fn distance_m(&self, place: Point2) -> f64 {
        let (x, y) = ((place.x - self.low.x) / self.cell_m - 0.5, (place.y - self.low.y) / self.cell_m - 0.5);
        let side = N_SIDE as f64;
        if !(x > -1.0 && y > -1.0 && x < side && y < side) {
            return f64::INFINITY;
        }
        let mut nearest_m = f64::INFINITY;
        // The robot may stand in a cell that is not free by a hair: look around it.
        for row in (y.floor() as i64 - 1)..=(y.floor() as i64 + 2) {
            for col in (x.floor() as i64 - 1)..=(x.floor() as i64 + 2) {
                if (0..N_SIDE as i64).contains(&row) && (0..N_SIDE as i64).contains(&col) {
                    let there_m = f64::from(self.distance_m[row as usize * N_SIDE + col as usize]);
                    let here_m = (x - col as f64).hypot(y - row as f64) * self.cell_m;
                    nearest_m = nearest_m.min(there_m + here_m);
                }
            }
        }
        nearest_m
    }

    /// The place reached after `length_m` of the shortest way out from a place; the exit when it is nearer.
    pub(crate) fn along_way_out(&self, from: Point2, length_m: f64) -> Option<Point2> {
        let (x, y) = ((from.x - self.low.x) / self.cell_m, (from.y - self.low.y) / self.cell_m);
        let side = N_SIDE as f64;
        if !(x >= 1.0 && y >= 1.0 && x < side - 1.0 && y < side - 1.0) {
            return None;
        }
        let cell_idx = y as usize * N_SIDE + x as usize;
        let around = neighbours(cell_idx).map(|(idx, _)| idx).chain([cell_idx]);
        let mut idx = around.min_by(|a, b| self.distance_m[*a].total_cmp(&self.distance_m[*b]))?;
        let end_m = f64::from(self.distance_m[idx]) - length_m;
        while f64::from(self.distance_m[idx]) > end_m.max(0.0) {
            let down = neighbours(idx).map(|(next, _)| next);
            let next = down.min_by(|a, b| self.distance_m[*a].total_cmp(&self.distance_m[*b]))?;
            if self.distance_m[next] >= self.distance_m[idx] {
                break;
            }
            idx = next;
        }
        let cell = Point2::new((idx % N_SIDE) as f64 + 0.5, (idx / N_SIDE) as f64 + 0.5);
        Some(self.low + cell.coords * self.cell_m)
    }
}

/// What a place is to somebody who wants out of the zones.
fn look(scene: &Scene<'_>, place: Point2) -> Cell {
    let position_m = scene.assumptions.disturbance.position_m;
    let mut soft_m = f64::INFINITY;
    for layer in &scene.spatial {
        let margin_m = layer.margin_m(place, 0.0);
        if layer.soft {
            soft_m = soft_m.min(margin_m);
        } else if margin_m <= position_m {
            return Cell::Blocked;
        }
    }
    if soft_m > position_m + CLEAR_M { Cell::Exit } else { Cell::Inside }
}

/// Whether a place is outside every zone and clear of everything else: an exit by itself.
pub(crate) fn is_outside(scene: &Scene<'_>, place: Point2) -> bool {
    look(scene, place) == Cell::Exit
}

/// Lengths of a step to the side and of a diagonal one, in fifths of a cell: a hundredth short of √2.
const STEPS: [u32; 2] = [5, 7];
/// More than the longest step: cells whose length differs by less than this never share a bucket.
const N_BUCKETS: usize = 8;
/// Not reached.
const NEVER: u32 = u32::MAX;

/// Dijkstra over the cells, with a ring of buckets for a queue: steps are short whole numbers.
#[derive(Debug, Default)]
struct Flood {
    /// Length of the way to each cell, in fifths of a cell.
    length: Vec<u32>,
    buckets: [Vec<u32>; N_BUCKETS],
    now: u32,
}

impl Flood {
    fn clear(&mut self) {
        self.length.clear();
        self.length.resize(N_SIDE * N_SIDE, NEVER);
        self.buckets.iter_mut().for_each(Vec::clear);
        self.now = 0;
    }

    fn begin(&mut self, idx: usize, length: u32) {
        if length < self.length[idx] {
            self.length[idx] = length;
            self.buckets[length as usize % N_BUCKETS].push(idx as u32);
        }
    }

    /// The nearest cell that was not given yet, and its length; `None` beyond `far` and at the end.
    fn next(&mut self, far: u32) -> Option<(usize, u32)> {
        let mut n_empty = 0;
        while n_empty < N_BUCKETS && self.now <= far {
            match self.buckets[self.now as usize % N_BUCKETS].pop() {
                // Found again on a shorter way since: given already.
                Some(idx) if self.length[idx as usize] != self.now => {}
                Some(idx) => return Some((idx as usize, self.now)),
                None => {
                    self.now += 1;
                    n_empty += 1;
                }
            }
        }
        None
    }

    fn spread(&mut self, idx: usize, here: u32, may: impl Fn(usize) -> bool) {
        for (next, step) in neighbours(idx) {
            if may(next) {
                self.begin(next, here + step);
            }
        }
    }
}

/// The cells around one that are on the map, and the lengths of the steps there.
fn neighbours(idx: usize) -> impl Iterator<Item = (usize, u32)> {
    let (col, row) = ((idx % N_SIDE) as i64, (idx / N_SIDE) as i64);
    let [side, diagonal] = STEPS;
    [(1, 0, side), (-1, 0, side), (0, 1, side), (0, -1, side)]
        .into_iter()
        .chain([(1, 1, diagonal), (1, -1, diagonal), (-1, 1, diagonal), (-1, -1, diagonal)])
        .filter_map(move |(dx, dy, step)| {
            let (x, y) = (col + dx, row + dy);
            let inside = (0..N_SIDE as i64).contains(&x) && (0..N_SIDE as i64).contains(&y);
            inside.then(|| (y as usize * N_SIDE + x as usize, step))
        })
}

#[cfg(test)]
mod tests;
