//! What scans are matched against: small pieces of surface, the nearest of them for each cell around, and a
//! pyramid of upper bounds of how well a point fits.
//!
//! A cell's *heat* falls from 255 on a surface to nothing at three cells' distance, by the distance of the
//! cell's centre to the point itself, so that nothing is rounded to cells. Level k of the pyramid holds, for
//! each block of 2^k cells, the highest heat in it and its upper right neighbours: the bound for a point that
//! may be shifted by up to 2^k − 1 cells.

use geometry::Pose2;
use nalgebra::{Point2, Vector2};

use super::cloud::{Cloud, CloudPoint};
use super::free::FreeGrid;
use super::placement::{Placement, floor, unit};
use super::pyramid::{self, Bounds, Level, Move};
use super::tiles::{Part, REACH, Spot, Tiles};

/// Levels above the cells themselves; the highest has blocks of 16 cells.
pub const N_LEVELS: usize = 4;
/// The grid grows by whole blocks of the highest level, this many cells at a time.
const CHUNK: i32 = 64;
/// And so many more where it has to grow: 6 m at 5 cm.
const SLACK: i32 = 128;
/// Most cells along a side: beyond, points are left out. 400 m at 5 cm.
const N_SIDE_MAX: usize = 8192;
/// Most pieces of surface: their numbers have 16 bits.
const N_SURFELS_MAX: usize = 65_000;
/// A piece of surface is the mean of at most this many points: it may still move.
const N_MEAN_MAX: f32 = 50.0;
/// A point nearer than this to a piece of surface, cells, belongs to it.
const SAME_CELLS: f32 = 0.6;
/// A point this near to a surface, metres, lies on it.
const ON_SURFACE_M: f32 = 0.1;
/// So many beams of a scan show what is free.
const N_BEAMS_MAX: usize = 180;

/// A piece of surface: the mean of what fell into one cell.
#[derive(Clone, Copy, Debug)]
struct Surfel {
    at: Point2<f32>,
    /// Unit, or zero when not known.
    normal: Vector2<f32>,
    /// Sum of the normals of what fell into it.
    normals: Vector2<f32>,
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
    tiles: Tiles,
    levels: [Level; N_LEVELS],
    surfels: Vec<Surfel>,
    free: FreeGrid,
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
        MatchMap {
            cell_m: cell_m.clamp(0.02, 0.5) as f32,
            origin: [0, 0],
            n_side: [0, 0],
            tiles: Tiles::default(),
            levels: std::array::from_fn(|_| Level::default()),
            surfels: Vec::new(),
            free: FreeGrid::default(),
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
        let point = |s: &Surfel| CloudPoint { at: s.at, normal: s.normal };
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
        for tile in self.tiles.take_changed() {
            if let Some(heats) = self.tiles.heats(tile[0], tile[1]) {
                pyramid::raise(&mut self.levels, heats, tile);
            }
        }
        if let Some(eye) = cloud.eye() {
            let eye = placed.point(eye);
            self.free.make_room(low.inf(&eye), high.sup(&eye));
            for point in points.iter().step_by(points.len().div_ceil(N_BEAMS_MAX)) {
                self.free.pass(eye, point.at);
            }
        }
    }

    fn insert_point(&mut self, point: &CloudPoint) {
        let cell = self.cell_at(point.at);
        let in_cells = point.at / self.cell_m;
        let part = Part::of(in_cells.x - cell[0] as f32, in_cells.y - cell[1] as f32);
        let spot = self.spot(cell);
        if let Some(spot) = spot
            && let Some(surfel) = self.surfels.get_mut(usize::from(spot.surfel))
        {
            let is_same = (surfel.at - point.at).norm_squared() < (SAME_CELLS * self.cell_m).powi(2);
            // The other face of something thin keeps its own place and normal.
            if is_same && surfel.normals.dot(&point.normal) >= 0.0 {
                surfel.n = (surfel.n + 1.0).min(N_MEAN_MAX);
                surfel.at += (point.at - surfel.at) / surfel.n;
                surfel.normals += point.normal;
                surfel.normal = unit(surfel.normals);
            }
            // A piece of surface nearer to the cell's middle speaks for the cell.
            if is_same || spot.heat >= part.heat() {
                return;
            }
        }
        // The grid has room around every cell that was grown to.
        let (col, row) = (cell[0] - self.origin[0], cell[1] - self.origin[1]);
        if self.surfels.len() < N_SURFELS_MAX && col >= REACH && row >= REACH {
            let surfel_idx = self.surfels.len() as u16;
            let CloudPoint { at, normal } = *point;
            self.surfels.push(Surfel { at, normal: unit(normal), normals: normal, n: 1.0 });
            self.tiles.stamp(col as usize, row as usize, part, surfel_idx);
        }
    }

    /// The cell that holds a point.
    #[inline]
    pub(super) fn cell_at(&self, at: Point2<f32>) -> [i32; 2] {
        let inverse = 1.0 / self.cell_m;
        [floor(at.x * inverse), floor(at.y * inverse)]
    }

    /// What is known at a cell.
    #[inline]
    fn spot(&self, cell: [i32; 2]) -> Option<Spot> {
        let (col, row) = (cell[0].wrapping_sub(self.origin[0]), cell[1].wrapping_sub(self.origin[1]));
        let inside = col >= 0 && row >= 0 && col < self.n_side[0] && row < self.n_side[1];
        if inside { self.tiles.spot(col as usize, row as usize) } else { None }
    }

    /// Sums of heat over cells that are all shifted by `off`, by a cell more to the right, above, and both.
    pub(super) fn four_heat_sums(&self, cells: &[[i32; 2]], off: [i32; 2]) -> [u32; 4] {
        let (dx, dy) = (off[0].wrapping_sub(self.origin[0]), off[1].wrapping_sub(self.origin[1]));
        let [n_cols, n_rows] = self.n_side;
        let mut sums = [0_u32; 4];
        for &[x, y] in cells {
            let (col, row) = (x.wrapping_add(dx), y.wrapping_add(dy));
            // The outermost cells are near nothing: the grid has room around all that is.
            if col >= 0 && row >= 0 && col < n_cols - 1 && row < n_rows - 1 {
                for (sum, heat) in sums.iter_mut().zip(self.tiles.four_heats(col as usize, row as usize)) {
                    *sum = sum.wrapping_add(heat.into());
                }
            }
        }
        sums
    }

    /// The bounds of a level, from 1 on; `None` of one there is not.
    pub(super) fn bounds(&self, level: usize) -> Option<Bounds<'_>> {
        Some(self.levels.get(level.checked_sub(1)?)?.bounds(self.origin, level as u32))
    }

    /// The surface nearest to a point; `None` where there is none within reach.
    #[inline]
    pub(super) fn nearest(&self, at: Point2<f32>) -> Option<Nearest> {
        let spot = self.spot(self.cell_at(at))?;
        let surfel = self.surfels.get(usize::from(spot.surfel))?;
        Some(Nearest { at: surfel.at, normal: surfel.normal })
    }

    /// Whether a point lies on a surface, to a tenth of a metre.
    #[must_use]
    pub fn is_on_surface(&self, at: Point2<f32>) -> bool {
        self.nearest(at)
            .is_some_and(|surface| (surface.at - at).norm_squared() <= ON_SURFACE_M * ON_SURFACE_M)
    }

    /// Where beams have passed.
    #[must_use]
    pub fn free(&self) -> &FreeGrid {
        &self.free
    }

    /// Takes over what is known to be free.
    pub fn set_free(&mut self, free: FreeGrid) {
        self.free = free;
    }

    /// Makes the grid hold cells from `low` to `high`, with room to spare.
    fn grow(&mut self, low: [i32; 2], high: [i32; 2]) {
        let old_end = [self.origin[0] + self.n_side[0], self.origin[1] + self.n_side[1]];
        let is_empty = self.n_side[0] == 0;
        let (mut origin, mut n_side) = (self.origin, self.n_side);
        for axis in 0..2 {
            let (mut first, mut end) = (low[axis] - REACH - 1, high[axis] + REACH + 2);
            if !is_empty {
                // Who grows once grows again: each time all is copied.
                first = if first < self.origin[axis] { first - SLACK } else { self.origin[axis] };
                end = if end > old_end[axis] { end + SLACK } else { old_end[axis] };
            }
            origin[axis] = first.div_euclid(CHUNK) * CHUNK;
            n_side[axis] = (end - origin[axis] + CHUNK - 1).div_euclid(CHUNK) * CHUNK;
        }
        if (origin, n_side) == (self.origin, self.n_side) {
            return;
        }
        let off = [self.origin[0] - origin[0], self.origin[1] - origin[1]];
        let moved = Move { from: self.n_side, to: n_side, off };
        self.tiles.grow(&moved);
        (self.origin, self.n_side) = (origin, n_side);
        for (idx, level) in self.levels.iter_mut().enumerate() {
            level.grow(&moved, idx + 1);
        }
    }
}
