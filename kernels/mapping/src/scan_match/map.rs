//! What scans are matched against: small pieces of surface, the nearest of them for each cell around, and a
//! pyramid of upper bounds of how well a point fits.
//!
//! A cell's *heat* falls from 255 on a surface to nothing at three cells' distance, by the distance of the
//! cell's centre to the point itself, so that nothing is rounded to cells. Level k of the pyramid holds, for
//! each block of 2^k cells, the highest heat in it and its upper right neighbours: the bound for a point that
//! may be shifted by up to 2^k − 1 cells.

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
const N_STAMP: usize = 2 * REACH as usize + 1;
/// Standard deviation of the heat, cells.
const SIGMA_CELLS: f32 = 1.4;
/// Most pieces of surface: their numbers have 16 bits.
const N_SURFELS_MAX: usize = 65_000;
/// A piece of surface is the mean of at most this many points: it may still move.
const N_MEAN_MAX: f32 = 50.0;
/// A point nearer than this to a piece of surface, cells, belongs to it.
const SAME_CELLS: f32 = 0.6;
/// The level whose blocks tell what is near: 8 cells.
const NEAR_LEVEL: usize = 3;
/// A point this near to a surface, metres, lies on it.
const ON_SURFACE_M: f64 = 0.1;
const NO_SURFEL: u16 = u16::MAX;

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
    nearest: Vec<u16>,
    levels: [Level; N_LEVELS],
    surfels: Vec<Surfel>,
    /// Heat by squared distance, in quarters of a cell squared.
    falloff: Vec<u8>,
}

/// One level of the pyramid.
#[derive(Clone, Debug, Default)]
struct Level {
    /// Highest heat of each block.
    blocks: Vec<u8>,
    /// Highest heat of each block and its neighbours to the right, above, and both.
    bounds: Vec<u8>,
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
            levels: std::array::from_fn(|_| Level::default()),
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
        if let Some(surfel) = self.surfels.get_mut(usize::from(self.nearest[idx])) {
            let is_same = (surfel.at - point.at).norm_squared() < (SAME_CELLS * self.cell_m).powi(2);
            // The other face of something thin keeps its own place and normal.
            if is_same && surfel.normal.dot(&point.normal) >= 0.0 {
                surfel.n = (surfel.n + 1.0).min(N_MEAN_MAX);
                surfel.at += (point.at - surfel.at) / surfel.n;
                surfel.normal += point.normal;
            }
            // A piece of surface nearer to the cell's middle speaks for the cell.
            if is_same || self.heat[idx] >= self.heat_at(point.at, cell) {
                return;
            }
        }
        if self.surfels.len() < N_SURFELS_MAX {
            let surfel_idx = self.surfels.len() as u16;
            self.surfels.push(Surfel { at: point.at, normal: point.normal, n: 1.0 });
            self.stamp(surfel_idx, point.at, cell);
        }
    }

    /// Heat of a cell's middle by a point.
    #[inline]
    fn heat_at(&self, at: Point2<f32>, cell: [i32; 2]) -> u8 {
        let inverse = 1.0 / self.cell_m;
        let dx = cell[0] as f32 + 0.5 - at.x * inverse;
        let dy = cell[1] as f32 + 0.5 - at.y * inverse;
        self.falloff.get(((dx * dx + dy * dy) * 4.0) as usize).copied().unwrap_or(0)
    }

    /// Tells the cells around a new surfel of it. The grid has room around every cell that was grown to.
    fn stamp(&mut self, surfel_idx: u16, at: Point2<f32>, cell: [i32; 2]) {
        let inverse = 1.0 / self.cell_m;
        let (x, y) = (at.x * inverse - 0.5, at.y * inverse - 0.5);
        let (first_col, first_row) = (cell[0] - REACH, cell[1] - REACH);
        let Some(corner) = self.index(first_col, first_row) else { return };
        for above in 0..N_STAMP {
            let dy = (first_row + above as i32) as f32 - y;
            for beside in 0..N_STAMP {
                let dx = (first_col + beside as i32) as f32 - x;
                let idx = corner + above * self.n_side[0] as usize + beside;
                let heat = self.falloff.get(((dx * dx + dy * dy) * 4.0) as usize).copied().unwrap_or(0);
                if heat > self.heat[idx] {
                    self.heat[idx] = heat;
                    self.nearest[idx] = surfel_idx;
                    let (col, row) = (first_col + beside as i32, first_row + above as i32);
                    self.raise([col - self.origin[0], row - self.origin[1]], heat);
                }
            }
        }
    }

    /// Raises the pyramid over a cell (counted from the grid's corner).
    fn raise(&mut self, cell: [i32; 2], heat: u8) {
        for (above, level) in self.levels.iter_mut().enumerate() {
            let [col, row] = cell.map(|c| (c >> (above + 1)) as usize);
            let n_cols = (self.n_side[0] >> (above + 1)) as usize;
            let block = &mut level.blocks[row * n_cols + col];
            if *block >= heat {
                // Blocks nest: all above hold no less.
                return;
            }
            *block = heat;
            for row in row.saturating_sub(1)..=row {
                for col in col.saturating_sub(1)..=col {
                    let bound = &mut level.bounds[row * n_cols + col];
                    *bound = (*bound).max(heat);
                }
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
        let values = if level == 0 { &self.heat } else { &self.levels[level - 1].bounds };
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
        let surfel = self.surfels.get(usize::from(surfel_idx))?;
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
        let level = NEAR_LEVEL;
        let n = self.n_side.map(|n| n >> level);
        let block = |axis: usize, off: i32| (cell[axis] + off - self.origin[axis]) >> level;
        (block(1, -reach)..=block(1, reach)).any(|row| {
            (block(0, -reach)..=block(0, reach)).any(|col| {
                let inside = col >= 0 && row >= 0 && col < n[0] && row < n[1];
                inside && self.levels[level - 1].blocks[(row * n[0] + col) as usize] > 0
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
        (self.origin, self.n_side) = (origin, n_side);
        for (idx, level) in self.levels.iter_mut().enumerate() {
            level.blocks = moved.apply(&level.blocks, 0, idx + 1);
            level.bounds = bounds_of(&level.blocks, (n_side[0] >> (idx + 1)) as usize);
        }
    }
}

/// The highest of each block and its neighbours to the right, above, and both.
fn bounds_of(blocks: &[u8], n_cols: usize) -> Vec<u8> {
    let mut bounds = blocks.to_vec();
    for row in bounds.chunks_exact_mut(n_cols.max(1)) {
        for col in 1..n_cols {
            row[col - 1] = row[col - 1].max(row[col]);
        }
    }
    for idx in n_cols..bounds.len() {
        bounds[idx - n_cols] = bounds[idx - n_cols].max(bounds[idx]);
    }
    bounds
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
        let (dx, dy) = (off[0].wrapping_sub(self.origin[0]), off[1].wrapping_sub(self.origin[1]));
        let [n_cols, n_rows] = self.n_side;
        let mut sum = 0_u32;
        for &[x, y] in cells {
            // Negative positions become huge. Wrapping: nothing here comes near an integer's end, and checks
            // would cost as much as the sum.
            let (col, row) =
                ((x.wrapping_add(dx) >> self.level) as u32, (y.wrapping_add(dy) >> self.level) as u32);
            if col < n_cols && row < n_rows {
                let idx = row.wrapping_mul(n_cols).wrapping_add(col) as usize;
                sum = sum.wrapping_add(self.values.get(idx).map_or(0, |v| u32::from(*v)));
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
