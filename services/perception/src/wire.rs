//! Grids of `mapping` as the network carries them.

use mapping::{Grid, Layout, Occupancy};
use proto::{CellSet, GridLayout};

/// A layout for the network.
#[must_use]
pub fn grid_layout(layout: &Layout) -> GridLayout {
    // A layout has at most 8192 cells a side; it was checked when it was made.
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    GridLayout {
        origin_map: layout.origin,
        resolution_m: layout.resolution_m,
        n_cols: side(layout.shape.n_cols),
        n_rows: side(layout.shape.n_rows),
    }
}

/// The set cells of a grid, for the network.
#[must_use]
pub fn cell_set(grid: &Grid<bool>) -> CellSet {
    CellSet::pack(grid_layout(grid.layout()), grid.values())
}

/// Occupancy as one byte a cell: 0 unknown, 1 free, 2 occupied.
#[must_use]
pub fn occupancy_bytes(grid: &Grid<Occupancy>) -> Vec<u8> {
    grid.values().iter().map(|cell| *cell as u8).collect()
}
