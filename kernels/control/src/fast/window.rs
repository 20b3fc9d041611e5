//! The layers around the robot, merged tile by tile when a tile is first needed, kept until the maps change.
//!
//! For each cell of the lattice a mask says which layers can be smallest in it: who is not smaller at any of the
//! four corners is not smaller between them, because bilinear values are convex sums of corners. Asking only
//! those gives the smallest margin *exactly*, and whose it is, however many layers there are. Beside the mask a
//! packed word bounds it from above for the sweep. The window wraps around, so nothing moves when the robot does.
//! Layers on another lattice are not merged and always asked. Not here: what a margin is for (`scene`).

use std::cell::{Cell, RefCell};
use std::sync::Arc;

use geometry::Point2;
use mapping::DistanceField;

use super::Isa;
use super::isa::Work;
use super::packed::{FINE_AXIS_MAX, FINE_BASE_MAX, fine};
use super::sweep::Ground;

/// Cells along one side of the window; a power of two.
const N_SIDE: i32 = 256;
/// Cells along one side of a tile.
const N_TILE: i32 = 16;
/// Farthest from the start that a sweep may go, cells: what lies farther shares its place in the window.
pub(crate) const N_REACH_MAX: i32 = N_SIDE / 2 - N_TILE;
/// Most layers: one bit each.
const N_LAYERS_MAX: usize = 64;
/// Layers are taken to be on one lattice when they are off by no more than this, cells.
const ALIGNED: f64 = 1e-6;
/// Two layers that differ by less are both asked, metres: more than what rounding to f32 takes from a kilometre.
const SLACK_M: f32 = 2e-4;
/// A margin is lowered by this before it is rounded down, metres: what rounding to f32 may have added within reach.
const LOWERED_M: f32 = 2e-6;

/// One layer that is held.
#[derive(Clone, Debug)]
struct Held {
    field: Arc<DistanceField>,
    keep_m: f64,
    /// Lattice cell of the field's first.
    first: [i64; 2],
}

/// The merged window of one robot.
#[derive(Debug)]
pub(crate) struct Window {
    isa: Isa,
    held: Vec<Held>,
    origin: Point2,
    resolution_m: f64,
    tiles: RefCell<Tiles>,
    /// Cell asked last, and its mask: a sample is asked about by one rollout after another.
    last: Cell<(i32, i32, u64)>,
}

/// Which tile of the lattice lies where in the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Tag {
    col: i32,
    row: i32,
    turn: u32,
}

#[derive(Debug)]
struct Tiles {
    tags: Vec<Tag>,
    /// For each cell the layers that can be smallest in it.
    masks: Vec<u64>,
    words: Vec<u64>,
    /// Counts the changes of maps: what was built before counts no more.
    turn: u32,
    quantum_m: f32,
    slope_m: f32,
}

impl Window {
    /// A window on nothing.
    pub(crate) fn on(isa: Isa) -> Window {
        let n = (N_SIDE * N_SIDE) as usize;
        let n_tiles = ((N_SIDE / N_TILE) * (N_SIDE / N_TILE)) as usize;
        let tiles = Tiles {
            tags: vec![Tag { col: 0, row: 0, turn: 0 }; n_tiles],
            masks: vec![0; n],
            words: vec![0; n],
            turn: 1,
            quantum_m: 0.0,
            slope_m: 0.0,
        };
        Window {
            isa,
            held: Vec::with_capacity(N_LAYERS_MAX),
            origin: Point2::origin(),
            resolution_m: 0.0,
            tiles: RefCell::new(tiles),
            last: Cell::new((i32::MIN, 0, 0)),
        }
    }

    /// Holds these layers, each with what is subtracted from its distances; `take` is told the number and the bit of
    /// each one that is on the lattice of the first. When they are the same as before, nothing has to be built again.
    pub(crate) fn hold<'w>(
        &mut self,
        layers: impl Iterator<Item = (usize, &'w Arc<DistanceField>, f64)>,
        mut take: impl FnMut(usize, u8),
    ) {
        let (mut n_held, mut is_same) = (0, true);
        for (k, field, keep_m) in layers {
            if n_held == N_LAYERS_MAX {
                break;
            }
            let same = |held: &Held| Arc::ptr_eq(&held.field, field) && held.keep_m == keep_m;
            if is_same && self.held.get(n_held).is_some_and(same) {
                take(k, n_held as u8);
                n_held += 1;
                continue;
            }
            if is_same && self.is_off_lattice(n_held, field) {
                continue;
            }
            is_same = false;
            self.held.truncate(n_held);
            if let Some(first) = self.place_on_lattice(field) {
                self.held.push(Held { field: field.clone(), keep_m, first });
                take(k, n_held as u8);
                n_held += 1;
            }
        }
        if is_same && self.held.len() == n_held {
            return;
        }
        self.held.truncate(n_held);
        self.last.set((i32::MIN, 0, 0));
        let tiles = self.tiles.get_mut();
        // Neighbours of a distance field differ by a cell; steeper ones are found when tiles are built.
        tiles.quantum_m = 0.0;
        tiles.turn_over(self.resolution_m as f32);
    }

    /// Whether a field was left out before and still is.
    fn is_off_lattice(&self, n_held: usize, field: &DistanceField) -> bool {
        n_held > 0 && self.offset(field).is_none()
    }

    /// Where a field begins on the lattice; the first field makes it.
    fn place_on_lattice(&mut self, field: &DistanceField) -> Option<[i64; 2]> {
        if self.held.is_empty() {
            (self.origin, self.resolution_m) = (field.layout().origin, field.layout().resolution_m);
        }
        self.offset(field)
    }

    fn offset(&self, field: &DistanceField) -> Option<[i64; 2]> {
        let layout = field.layout();
        let offset = (layout.origin - self.origin) / self.resolution_m;
        let n_far = layout.shape.n_cols.max(layout.shape.n_rows) as f64;
        let stretch = (layout.resolution_m / self.resolution_m - 1.0).abs() * n_far;
        let whole = |v: f64| (v - v.round()).abs() <= ALIGNED && v.abs() < 1e6;
        (stretch <= ALIGNED && whole(offset.x) && whole(offset.y))
            .then(|| [offset.x.round() as i64, offset.y.round() as i64])
    }

    /// Whether anything is held.
    pub(crate) fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// Side of a cell, metres.
    pub(crate) fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// A place in cells, counted from the centre of the lattice's first.
    fn cells(&self, place: Point2) -> (f64, f64) {
        let from_corner = (place - self.origin) / self.resolution_m;
        (from_corner.x - 0.5, from_corner.y - 0.5)
    }

    /// The held layers that can be smallest at a place, bit by bit; all of them when the place is no place.
    #[inline]
    pub(crate) fn mask(&self, place: Point2) -> u64 {
        let (x, y) = self.cells(place);
        if !(x.abs() < 1e9 && y.abs() < 1e9) {
            return u64::MAX;
        }
        let (col, row) = (x.floor() as i32, y.floor() as i32);
        let (last_col, last_row, mask) = self.last.get();
        if (last_col, last_row) == (col, row) {
            return mask;
        }
        let mut tiles = self.tiles.borrow_mut();
        tiles.ensure(self.isa, &self.held, col.div_euclid(N_TILE), row.div_euclid(N_TILE));
        let mask = tiles.masks[at(col, row)];
        self.last.set((col, row, mask));
        mask
    }

    /// Sweeps over the ground around a start, at most `n_reach` cells from it: `work` gets the ground, the
    /// start's place in its cell, and by how much words may lie below the true margins, metres.
    ///
    /// `None` when the start is no place, or `n_reach` more than [`N_REACH_MAX`].
    pub(crate) fn over<R>(
        &self,
        start: Point2,
        n_reach: i32,
        work: impl for<'g> FnOnce(Ground<'g>, [f32; 2], f32) -> R,
    ) -> Option<R> {
        let (x, y) = self.cells(start);
        if !(x.abs() < 1e9 && y.abs() < 1e9) || n_reach > N_REACH_MAX || self.held.is_empty() {
            return None;
        }
        let (col, row) = (x.floor() as i32, y.floor() as i32);
        let mut tiles = self.tiles.borrow_mut();
        let range = |at: i32| (at - n_reach).div_euclid(N_TILE)..=(at + n_reach).div_euclid(N_TILE);
        loop {
            let turn = tiles.turn;
            for tile_row in range(row) {
                for tile_col in range(col) {
                    tiles.ensure(self.isa, &self.held, tile_col, tile_row);
                }
            }
            // A steeper tile makes all of them coarser.
            if tiles.turn == turn {
                break;
            }
        }
        let reach = n_reach as f32;
        let ground = Ground {
            words: &tiles.words,
            first: [col, row],
            n_cols: N_SIDE,
            low: [-reach; 2],
            high: [reach; 2],
            slope_m: tiles.slope_m,
            quantum_m: [tiles.quantum_m; 2],
            ridges: None,
            points: &[],
            points_keep_m: 0.0,
            cell_m: self.resolution_m as f32,
        };
        let share = [(x - f64::from(col)) as f32, (y - f64::from(row)) as f32];
        Some(work(ground, share, tiles.quantum_m + 2.0 * LOWERED_M))
    }

    /// The highest margin that words can say, metres.
    pub(crate) fn top_m(&self) -> f64 {
        f64::from(self.tiles.borrow().quantum_m) * f64::from(FINE_BASE_MAX)
    }
}

/// Where a cell of the lattice lies in the window.
#[inline]
fn at(col: i32, row: i32) -> usize {
    (((row & (N_SIDE - 1)) << 8) | (col & (N_SIDE - 1))) as usize
}

impl Tiles {
    /// Forgets all tiles; margins change by `step_m` from cell to cell.
    fn turn_over(&mut self, step_m: f32) {
        self.turn = self.turn.wrapping_add(1);
        if self.turn == 0 {
            // After four billion changes an old tile could look new.
            self.tags.fill(Tag { col: 0, row: 0, turn: 0 });
            self.turn = 1;
        }
        self.slope_m = 0.0;
        self.quantum_m = self.quantum_m.max(1.01 * step_m / FINE_AXIS_MAX);
    }

    /// Sees to it that a tile is built.
    #[inline]
    fn ensure(&mut self, isa: Isa, held: &[Held], col: i32, row: i32) {
        const N: i32 = N_SIDE / N_TILE;
        let slot = ((row & (N - 1)) * N + (col & (N - 1))) as usize;
        let tag = Tag { col, row, turn: self.turn };
        if self.tags[slot] != tag {
            self.build(isa, held, tag, slot);
        }
    }

    #[inline(never)]
    fn build(&mut self, isa: Isa, held: &[Held], tag: Tag, slot: usize) {
        let first = at(tag.col * N_TILE, tag.row * N_TILE);
        let steepest = isa.run(Build {
            held,
            col: i64::from(tag.col) * i64::from(N_TILE),
            row: i64::from(tag.row) * i64::from(N_TILE),
            quantum_m: self.quantum_m,
            words: &mut self.words[first..],
            masks: &mut self.masks[first..],
        });
        let [along_x_m, along_y_m, across_m] = steepest;
        self.slope_m = self.slope_m.max(along_x_m.hypot(along_y_m));
        self.tags[slot] = tag;
        let wanted_m = along_x_m.max(along_y_m).max(across_m / 2.0) / FINE_AXIS_MAX;
        if wanted_m > self.quantum_m {
            let slope_m = self.slope_m;
            self.quantum_m = 1.01 * wanted_m;
            self.turn_over(0.0);
            self.slope_m = slope_m;
            // The masks of this tile are right whatever the quantum; its words are built again with all others.
            self.tags[slot] = Tag { turn: self.turn, ..tag };
            self.build(isa, held, Tag { turn: self.turn, ..tag }, slot);
        }
    }
}

/// Builds one tile; the steepest steps along x, along y and across a cell, metres.
struct Build<'a> {
    held: &'a [Held],
    /// Lattice cell of the tile's first.
    col: i64,
    row: i64,
    quantum_m: f32,
    /// From the tile's first cell on.
    words: &'a mut [u64],
    masks: &'a mut [u64],
}

const N: usize = N_TILE as usize;
/// The margins at the corners of a row of cells: lower left, lower right, upper left, upper right.
type Corners = [[f32; N]; 4];

impl Work for Build<'_> {
    type Output = [f32; 3];
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [f32; 3] {
        let Build { held, col, row, quantum_m, words, masks } = self;
        let mut steepest = [0.0_f32; 3];
        let quanta = |margin_m: f32| ((margin_m - LOWERED_M) / quantum_m).floor() as i32;
        for tile_row in 0..N {
            let row = row + tile_row as i64;
            let mut outside = 0_u64;
            let mut first = [[f32::INFINITY; N]; 4];
            let mut least_sum = [f32::INFINITY; N];
            for (bit, layer) in held.iter().enumerate() {
                match corners(layer, col, row) {
                    Some(corners) => choose_smaller(&corners, &mut least_sum, &mut first),
                    // Partly beyond its field, where it is not bilinear: always asked.
                    None => outside |= 1 << bit,
                }
            }
            let mut mask = [outside; N];
            for (bit, layer) in held.iter().enumerate() {
                if let Some(corners) = corners(layer, col, row) {
                    mark_smaller(&corners, &first, 1 << bit, &mut mask);
                }
            }
            let start = tile_row * N_SIDE as usize;
            let (words, masks) = (&mut words[start..start + N], &mut masks[start..start + N]);
            masks.copy_from_slice(&mask);
            let [a, b, c, d] = &first;
            for k in 0..N {
                words[k] = fine([quanta(a[k]), quanta(b[k]), quanta(c[k]), quanta(d[k])]);
            }
            if least_sum[0] < f32::INFINITY {
                note_steepest(&first, &mut steepest);
            }
        }
        steepest
    }
}

/// The margins of a layer at the corners of a row of cells; `None` when part of it lies beyond the field.
#[inline(always)]
fn corners(layer: &Held, col: i64, row: i64) -> Option<Corners> {
    let shape = layer.field.layout().shape;
    let (col, row) =
        (usize::try_from(col - layer.first[0]).ok()?, usize::try_from(row - layer.first[1]).ok()?);
    if col + N >= shape.n_cols || row + 1 >= shape.n_rows {
        return None;
    }
    let values = layer.field.values_m();
    let lower: &[f32; N + 1] = values.get(row * shape.n_cols + col..)?.first_chunk()?;
    let upper: &[f32; N + 1] = values.get((row + 1) * shape.n_cols + col..)?.first_chunk()?;
    let keep_m = layer.keep_m as f32;
    let mut corners = [[0.0; N]; 4];
    for k in 0..N {
        corners[0][k] = lower[k] - keep_m;
        corners[1][k] = lower[k + 1] - keep_m;
        corners[2][k] = upper[k] - keep_m;
        corners[3][k] = upper[k + 1] - keep_m;
    }
    Some(corners)
}

/// Takes a layer's corners where it is smaller in the middle of the cell.
#[inline(always)]
fn choose_smaller(corners: &Corners, least_sum: &mut [f32; N], first: &mut Corners) {
    let [a, b, c, d] = corners;
    let mut is_less = [false; N];
    for k in 0..N {
        let sum = (a[k] + b[k]) + (c[k] + d[k]);
        is_less[k] = sum < least_sum[k];
        least_sum[k] = if is_less[k] { sum } else { least_sum[k] };
    }
    for (first, corners) in first.iter_mut().zip(corners) {
        for k in 0..N {
            first[k] = if is_less[k] { corners[k] } else { first[k] };
        }
    }
}

/// Marks the cells in which a layer may be smaller than the first.
#[inline(always)]
fn mark_smaller(corners: &Corners, first: &Corners, bit: u64, mask: &mut [u64; N]) {
    let mut gap_m = [f32::INFINITY; N];
    for (first, corners) in first.iter().zip(corners) {
        for k in 0..N {
            let here_m = corners[k] - first[k];
            gap_m[k] = if here_m < gap_m[k] { here_m } else { gap_m[k] };
        }
    }
    for k in 0..N {
        mask[k] |= if gap_m[k] < SLACK_M { bit } else { 0 };
    }
}

#[inline(always)]
fn note_steepest([a, b, c, d]: &Corners, steepest: &mut [f32; 3]) {
    let larger = |a: f32, b: f32| if a > b { a } else { b };
    for k in 0..N {
        let (lower, upper) = ((b[k] - a[k]).abs(), (d[k] - c[k]).abs());
        steepest[0] = larger(steepest[0], larger(lower, upper));
        let (left, right) = ((c[k] - a[k]).abs(), (d[k] - b[k]).abs());
        steepest[1] = larger(steepest[1], larger(left, right));
        steepest[2] = larger(steepest[2], (d[k] - a[k]).abs());
    }
}

#[cfg(test)]
mod tests;
