//! Grids of `mapping` as the network carries them.

use mapping::{Grid, GridError, Layout, Occupancy, Shape};
use proto::{BaseMap, CellSet, GridLayout};

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

/// The grid of a base map; bytes that stand for nothing are unknown.
///
/// # Errors
/// [`GridError`] when layout and cells do not go together.
pub fn base_grid(map: &BaseMap) -> Result<Grid<Occupancy>, GridError> {
    let GridLayout { origin_map, resolution_m, n_cols, n_rows } = map.layout;
    let shape = Shape { n_cols: n_cols as usize, n_rows: n_rows as usize };
    let cells = map.cells.iter().map(|byte| match byte {
        1 => Occupancy::Free,
        2 => Occupancy::Occupied,
        _ => Occupancy::Unknown,
    });
    Grid::from_values(Layout::new(origin_map, resolution_m, shape)?, cells.collect())
}
