//! What scans are matched against: small pieces of surface, the nearest of them for each cell around, and a
//! pyramid of upper bounds of how well a point fits.
//!
//! A cell's *heat* falls from 255 on a surface to nothing at three cells' distance, by the distance of the
//! cell's centre to the point itself, so that nothing is rounded to cells. Level k of the pyramid holds, for
//! each block of 2^k cells, no less than any heat in it and its upper right neighbours: the bound for a
//! point that may be shifted by up to 2^k − 1 cells.

use geometry::{Point2 as Point2D, Pose2};
use nalgebra::{Point2, Vector2};

use super::cloud::{Cloud, CloudPoint};

/// Levels above the cells themselves; the highest has blocks of 64 cells.
pub const N_LEVELS: usize = 6;
/// The grid grows by whole blocks of the highest level, at least this many cells at a time.
const CHUNK: i32 = 128;
/// Most cells along a side: beyond, points are left out. 400 m at 5 cm.
const N_SIDE_MAX: usize = 8192;
/// Heat reaches this many cells.
const REACH: i32 = 3;
/// Standard deviation of the heat, cells.
const SIGMA_CELLS: f32 = 1.4;
/// A piece of surface is the mean of at most this many points: it may still move.
const N_MEAN_MAX: f32 = 50.0;
/// From this level on a bound is 255 wherever heat reaches: exact ones are not worth their time.
const ROUGH_LEVEL: usize = 3;
/// A point this near to a surface, metres, lies on it.
const ON_SURFACE_M: f64 = 0.1;
const NO_SURFEL: u32 = u32::MAX;

/// A piece of surface: the mean of what fell into one cell.
#[derive(Clone, Copy, Debug)]
struct Surfel {
    at: Point2<f32>,
    normal: Vector2<f32>,
    n: f32,
}

/// Surfaces in the frame of the map, ready to be matched against.
#[derive(Clone, Debug)]
pub struct MatchMap {
    cell_m: f32,
    /// Cell (column, row) of the low corner, multiples of [`CHUNK`].
    origin: [i32; 2],
    /// Columns and rows, multiples of [`CHUNK`].
    n_side: [i32; 2],
    heat: Vec<u8>,
    nearest: Vec<u32>,
    /// Whose surfel lies in the cell itself.
    own: Vec<u32>,
    levels: [Vec<u8>; N_LEVELS],
    surfels: Vec<Surfel>,
    /// Heat by squared distance, in quarters of a cell squared.
    falloff: Vec<u8>,
}

/// The nearest surface to a point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    pub(super) at: Point2<f32>,
    /// Unit, or zero when not known.
    pub(super) normal: Vector2<f32>,
}

impl MatchMap {
    /// An empty map with cells of `cell_m` metres (taken as 0.02 to 0.5).
    #[must_use]
    pub fn new(cell_m: f64) -> Self {
        let n_entries = 4 * 2 * ((REACH + 1) * (REACH + 1)) as usize;
        let falloff = (0..n_entries).map(|quarters| {
            let squared = quarters as f32 / 4.0;
            let heat = 255.0 * (-squared / (2.0 * SIGMA_CELLS * SIGMA_CELLS)).exp();
            heat.round() as u8
        });
        MatchMap {
            cell_m: cell_m.clamp(0.02, 0.5) as f32,
            origin: [0, 0],
            n_side: [0, 0],
            heat: Vec::new(),
            nearest: Vec::new(),
            own: Vec::new(),
            levels: std::array::from_fn(|_| Vec::new()),
            surfels: Vec::new(),
            falloff: falloff.collect(),
        }
    }

    /// Side of a cell, metres.
    #[must_use]
    pub fn cell_m(&self) -> f64 {
        f64::from(self.cell_m)
    }

    /// Number of pieces of surface.
    #[must_use]
    pub fn n_surfels(&self) -> usize {
        self.surfels.len()
    }

    /// The pieces of surface as points with normals.
    #[must_use]
    pub fn to_cloud(&self) -> Cloud {
        let point = |s: &Surfel| CloudPoint { at: s.at, normal: unit(s.normal) };
        Cloud::from_points(self.surfels.iter().map(point).collect())
    }

    /// Adds a cloud that was seen from `map_from_scan`. Points too far away for any grid are left out.
    pub fn insert(&mut self, cloud: &Cloud, map_from_scan: Pose2) {
        let placed = Placement::new(map_from_scan);
        let reach_m = self.cell_m * (N_SIDE_MAX / 2) as f32;
        let points: Vec<CloudPoint> = cloud
            .points()
            .iter()
            .map(|p| CloudPoint { at: placed.point(p.at), normal: placed.direction(p.normal) })
            .filter(|p| p.at.x.abs() < reach_m && p.at.y.abs() < reach_m)
            .collect();
        let Some(first) = points.first() else { return };
        let (mut low, mut high) = (first.at, first.at);
        for point in &points {
            low = low.inf(&point.at);
            high = high.sup(&point.at);
        }
        self.grow(self.cell_at(low), self.cell_at(high));
        for point in &points {
            self.insert_point(point);
        }
    }

    fn insert_point(&mut self, point: &CloudPoint) {
        let cell = self.cell_at(point.at);
        let Some(idx) = self.index(cell[0], cell[1]) else { return };
        if self.own[idx] != NO_SURFEL {
            let surfel = &mut self.surfels[self.own[idx] as usize];
            surfel.n = (surfel.n + 1.0).min(N_MEAN_MAX);
            surfel.at += (point.at - surfel.at) / surfel.n;
            // The other face of something thin keeps its own normal.
            if surfel.normal.dot(&point.normal) >= 0.0 {
                surfel.normal += point.normal;
            }
            return;
        }
        let surfel_idx = self.surfels.len() as u32;
        self.surfels.push(Surfel { at: point.at, normal: point.normal, n: 1.0 });
        self.own[idx] = surfel_idx;
        self.stamp(surfel_idx, point.at, cell);
    }

    /// Tells the cells around a new surfel of it. The grid has room around every cell that was grown to.
    fn stamp(&mut self, surfel_idx: u32, at: Point2<f32>, cell: [i32; 2]) {
        let in_cells = at / self.cell_m;
        for row in cell[1] - REACH..=cell[1] + REACH {
            for col in cell[0] - REACH..=cell[0] + REACH {
                let Some(idx) = self.index(col, row) else { continue };
                let (dx, dy) = (col as f32 + 0.5 - in_cells.x, row as f32 + 0.5 - in_cells.y);
                let heat = self.falloff[((dx * dx + dy * dy) * 4.0) as usize];
                if heat > self.heat[idx] {
                    self.heat[idx] = heat;
                    self.nearest[idx] = surfel_idx;
                    for level in 1..ROUGH_LEVEL {
                        self.raise(level, [col, row], [col, row], heat);
                    }
                }
            }
        }
        for level in ROUGH_LEVEL..=N_LEVELS {
            self.raise(level, cell.map(|c| c - REACH), cell.map(|c| c + REACH), u8::MAX);
        }
    }

    /// Raises the bounds of every block of a level that covers any of the cells from `low` to `high`.
    fn raise(&mut self, level: usize, low: [i32; 2], high: [i32; 2], heat: u8) {
        let n = self.n_side.map(|n| n >> level);
        let first = |axis: usize| (((low[axis] - self.origin[axis]) >> level) - 1).max(0);
        let last = |axis: usize| ((high[axis] - self.origin[axis]) >> level).min(n[axis] - 1);
        let (cols, rows) = (first(0)..=last(0), first(1)..=last(1));
        let bounds = &mut self.levels[level - 1];
        for row in rows {
            for col in cols.clone() {
                let bound = &mut bounds[(row * n[0] + col) as usize];
                *bound = (*bound).max(heat);
            }
        }
    }

    /// The cell that holds a point.
    #[inline]
    pub(super) fn cell_at(&self, at: Point2<f32>) -> [i32; 2] {
        [(at.x / self.cell_m).floor() as i32, (at.y / self.cell_m).floor() as i32]
    }

    #[inline]
    fn index(&self, col: i32, row: i32) -> Option<usize> {
        let (x, y) = (col - self.origin[0], row - self.origin[1]);
        let inside = x >= 0 && y >= 0 && x < self.n_side[0] && y < self.n_side[1];
        inside.then_some((y * self.n_side[0] + x) as usize)
    }

    /// The grid of bounds of a level; level 0 is the heat itself.
    pub(super) fn bounds(&self, level: usize) -> Bounds<'_> {
        let values = if level == 0 { &self.heat } else { &self.levels[level - 1] };
        Bounds {
            values,
            origin: self.origin,
            n_side: self.n_side.map(|n| (n >> level) as u32),
            level: level as u32,
        }
    }

    /// The surface nearest to a point; `None` where there is none within reach.
    #[inline]
    pub(super) fn nearest(&self, at: Point2<f32>) -> Option<Nearest> {
        let cell = self.cell_at(at);
        let surfel_idx = self.nearest[self.index(cell[0], cell[1])?];
        let surfel = self.surfels.get(surfel_idx as usize)?;
        Some(Nearest { at: surfel.at, normal: unit(surfel.normal) })
    }

    /// Whether a point lies on a surface, to a tenth of a metre.
    #[must_use]
    pub fn is_on_surface(&self, at: Point2D) -> bool {
        self.is_near_surface(at, ON_SURFACE_M)
    }

    /// Whether a surface is within `near_m` metres of a point. Surfaces farther than three cells from the point
    /// are found by the coarse levels alone, give or take their blocks.
    #[must_use]
    pub fn is_near_surface(&self, at: Point2D, near_m: f64) -> bool {
        let at = at.cast::<f32>();
        if self.nearest(at).is_some_and(|surface| f64::from((surface.at - at).norm()) <= near_m) {
            return true;
        }
        if near_m <= f64::from(self.cell_m * REACH as f32) {
            return false;
        }
        let reach = (near_m as f32 / self.cell_m) as i32;
        let cell = self.cell_at(at);
        let level = ROUGH_LEVEL;
        let n = self.n_side.map(|n| n >> level);
        let block = |axis: usize, off: i32| (cell[axis] + off - self.origin[axis]) >> level;
        (block(1, -reach)..=block(1, reach)).any(|row| {
            (block(0, -reach)..=block(0, reach)).any(|col| {
                let inside = col >= 0 && row >= 0 && col < n[0] && row < n[1];
                inside && self.levels[level - 1][(row * n[0] + col) as usize] > 0
            })
        })
    }

    /// Makes the grid hold cells from `low` to `high`, with room to spare.
    fn grow(&mut self, low: [i32; 2], high: [i32; 2]) {
        let old_end = [self.origin[0] + self.n_side[0], self.origin[1] + self.n_side[1]];
        let is_empty = self.n_side[0] == 0;
        let (mut origin, mut n_side) = (self.origin, self.n_side);
        for axis in 0..2 {
            let (mut first, mut end) = (low[axis] - REACH - 1, high[axis] + REACH + 2);
            if !is_empty {
                first = first.min(self.origin[axis]);
                end = end.max(old_end[axis]);
            }
            origin[axis] = first.div_euclid(CHUNK) * CHUNK;
            n_side[axis] = (end - origin[axis] + CHUNK - 1).div_euclid(CHUNK) * CHUNK;
        }
        if (origin, n_side) == (self.origin, self.n_side) {
            return;
        }
        let off = [self.origin[0] - origin[0], self.origin[1] - origin[1]];
        let moved = Move { from: self.n_side, to: n_side, off };
        self.heat = moved.apply(&self.heat, 0, 0);
        self.nearest = moved.apply(&self.nearest, NO_SURFEL, 0);
        self.own = moved.apply(&self.own, NO_SURFEL, 0);
        for (idx, level) in self.levels.iter_mut().enumerate() {
            *level = moved.apply(level, 0, idx + 1);
        }
        (self.origin, self.n_side) = (origin, n_side);
        // Blocks left and below of the old grid have it for a neighbour now.
        if !is_empty && off != [0, 0] {
            self.raise_along_old_edge(off, moved.from);
        }
    }

    /// Lets the blocks just outside the old grid's low edges cover what lies inside.
    fn raise_along_old_edge(&mut self, off: [i32; 2], n_old: [i32; 2]) {
        for level in 1..=N_LEVELS {
            let n = self.n_side.map(|n| n >> level);
            let low = off.map(|o| o >> level);
            let n_old = n_old.map(|n| n >> level);
            let bounds = &mut self.levels[level - 1];
            // What is inside is not told apart here: a bound too high costs time, one too low a match.
            if low[0] > 0 {
                for row in (low[1] - 1).max(0)..low[1] + n_old[1] {
                    bounds[(row * n[0] + low[0] - 1) as usize] = u8::MAX;
                }
            }
            if low[1] > 0 {
                for col in (low[0] - 1).max(0)..low[0] + n_old[0] {
                    bounds[((low[1] - 1) * n[0] + col) as usize] = u8::MAX;
                }
            }
        }
    }
}

/// One level, to be looked up.
#[derive(Clone, Copy)]
pub(super) struct Bounds<'a> {
    values: &'a [u8],
    origin: [i32; 2],
    n_side: [u32; 2],
    level: u32,
}

impl Bounds<'_> {
    /// Sum of bounds over cells that are all shifted by `off`.
    #[inline]
    pub(super) fn sum(&self, cells: &[[i32; 2]], off: [i32; 2]) -> u32 {
        let (dx, dy) = (off[0] - self.origin[0], off[1] - self.origin[1]);
        let mut sum = 0;
        for &[x, y] in cells {
            // Negative positions become huge.
            let (col, row) = (((x + dx) >> self.level) as u32, ((y + dy) >> self.level) as u32);
            if col < self.n_side[0] && row < self.n_side[1] {
                sum += u32::from(self.values[(row * self.n_side[0] + col) as usize]);
            }
        }
        sum
    }
}

/// A grid's contents going into a larger one, in cells.
struct Move {
    from: [i32; 2],
    to: [i32; 2],
    off: [i32; 2],
}

impl Move {
    fn apply<T: Copy>(&self, old: &[T], empty: T, level: usize) -> Vec<T> {
        let [from, to, off] = [self.from, self.to, self.off].map(|pair| pair.map(|n| (n >> level) as usize));
        let mut moved = vec![empty; to[0] * to[1]];
        for (row, values) in old.chunks_exact(from[0].max(1)).enumerate() {
            let begin = (row + off[1]) * to[0] + off[0];
            moved[begin..begin + from[0]].copy_from_slice(values);
        }
        moved
    }
}

/// A pose in single precision, with its sine and cosine.
#[derive(Clone, Copy)]
pub(super) struct Placement {
    shift: Vector2<f32>,
    sin: f32,
    cos: f32,
}

impl Placement {
    pub(super) fn new(pose: Pose2) -> Self {
        let (sin, cos) = pose.yaw_rad.sin_cos();
        Placement { shift: Vector2::new(pose.x_m as f32, pose.y_m as f32), sin: sin as f32, cos: cos as f32 }
    }

    #[inline]
    pub(super) fn point(&self, at: Point2<f32>) -> Point2<f32> {
        Point2::from(self.direction(at.coords) + self.shift)
    }

    #[inline]
    pub(super) fn direction(&self, v: Vector2<f32>) -> Vector2<f32> {
        Vector2::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y)
    }
}

/// A sum of unit normals made unit again; zero stays zero.
fn unit(normal: Vector2<f32>) -> Vector2<f32> {
    let norm = normal.norm();
    if norm > 1e-3 { normal / norm } else { Vector2::zeros() }
}
