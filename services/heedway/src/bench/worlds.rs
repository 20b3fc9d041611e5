//! Made-up floors to time searches and transforms on; the same seed gives the same floor.

use geometry::Point2;
use mapping::{Cell, Grid, Layout, Shape};

/// Side of a cell, metres.
pub const CELL_M: f64 = 0.05;

/// Draws numbers (xorshift*): a bench needs no better ones.
pub struct Draws(u64);

impl Draws {
    /// Draws from a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Draws(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// A whole number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) as usize % n.max(1)
    }
}

/// An empty square floor of `n` cells a side.
///
/// # Errors
/// When a grid cannot have that many.
pub fn empty(n: usize) -> anyhow::Result<Grid<bool>> {
    let shape = Shape { n_cols: n, n_rows: n };
    Ok(Grid::filled(Layout::new(Point2::origin(), CELL_M, shape)?, false))
}

/// A floor with walls around it and boxes of up to two metres on it, about a tenth of it covered.
///
/// # Errors
/// When a grid cannot have that many cells.
pub fn cluttered(n: usize, seed: u64) -> anyhow::Result<Grid<bool>> {
    let (mut floor, mut draws) = (empty(n)?, Draws::new(seed));
    let n_boxes = n * n / 4000;
    for _ in 0..n_boxes {
        let (width, depth) = (4 + draws.below(36), 4 + draws.below(36));
        let (col, row) = (draws.below(n), draws.below(n));
        fill(&mut floor, (col, row), (width, depth));
    }
    for border in [((0, 0), (n, 1)), ((0, n - 1), (n, 1)), ((0, 0), (1, n)), ((n - 1, 0), (1, n))] {
        fill(&mut floor, border.0, border.1);
    }
    Ok(floor)
}

/// A maze whose corridors are `corridor` cells wide, walls one cell.
///
/// # Errors
/// When a grid cannot have that many cells.
pub fn maze(n: usize, corridor: usize, seed: u64) -> anyhow::Result<Grid<bool>> {
    let (mut floor, mut draws) = (empty(n)?, Draws::new(seed));
    floor.values_mut().fill(true);
    let pitch = corridor + 1;
    let n_rooms = (n - 1) / pitch;
    let mut is_open = vec![false; n_rooms * n_rooms];
    let mut way = vec![(0_usize, 0_usize)];
    is_open[0] = true;
    clear(&mut floor, (1, 1), (corridor, corridor));
    // Deep first, back where it ends: long and winding.
    while let Some(&(x, y)) = way.last() {
        let next: Vec<(usize, usize)> = [(1, 0), (usize::MAX, 0), (0, 1), (0, usize::MAX)]
            .into_iter()
            .map(|(dx, dy)| (x.wrapping_add(dx), y.wrapping_add(dy)))
            .filter(|(x, y)| *x < n_rooms && *y < n_rooms && !is_open[y * n_rooms + x])
            .collect();
        let Some(&(to_x, to_y)) = next.get(draws.below(next.len())) else {
            way.pop();
            continue;
        };
        is_open[to_y * n_rooms + to_x] = true;
        let (low_x, low_y) = (x.min(to_x), y.min(to_y));
        let size = |a: usize, b: usize| if a == b { corridor } else { 2 * corridor + 1 };
        clear(&mut floor, (1 + low_x * pitch, 1 + low_y * pitch), (size(x, to_x), size(y, to_y)));
        way.push((to_x, to_y));
    }
    Ok(floor)
}

fn fill(floor: &mut Grid<bool>, low: (usize, usize), size: (usize, usize)) {
    set(floor, low, size, true);
}

fn clear(floor: &mut Grid<bool>, low: (usize, usize), size: (usize, usize)) {
    set(floor, low, size, false);
}

fn set(floor: &mut Grid<bool>, low: (usize, usize), size: (usize, usize), value: bool) {
    let Shape { n_cols, n_rows } = floor.layout().shape;
    for row in low.1..(low.1 + size.1).min(n_rows) {
        for col in low.0..(low.0 + size.0).min(n_cols) {
            floor.set(Cell { col, row }, value);
        }
    }
}
