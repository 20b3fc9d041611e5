//! Cells near surfaces, in tiles of 16 × 16: most of a building's ground is near none, and costs one number a
//! tile.

use super::pyramid::Move;

/// Cells along the side of a tile, as a power of two.
const SIDE_LOG2: usize = 4;
const N_SIDE: usize = 1 << SIDE_LOG2;
/// Heat reaches this many cells.
pub(super) const REACH: i32 = 3;
/// Standard deviation of the heat, cells.
const SIGMA_CELLS: f32 = 1.4;
const NO_TILE: u32 = u32::MAX;
/// No piece of surface is near.
pub(super) const NO_SURFEL: u16 = u16::MAX;

/// What is known at one cell.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spot {
    /// How near a surface is, 255 to 0.
    pub(super) heat: u8,
    /// The piece of surface that is nearest.
    pub(super) surfel: u16,
}

#[derive(Clone, Debug)]
struct Tile {
    heat: [u8; N_SIDE * N_SIDE],
    surfels: [u16; N_SIDE * N_SIDE],
}

/// Tiles by place. Cells are counted from the low corner.
#[derive(Clone, Debug, Default)]
pub(super) struct Tiles {
    table: Vec<u32>,
    n_cols: usize,
    tiles: Vec<Tile>,
}

#[inline]
fn within(col: usize, row: usize) -> usize {
    (row % N_SIDE) * N_SIDE + col % N_SIDE
}

impl Tiles {
    /// What is known at a cell; `None` near nothing. Beyond the grid's right border lies whatever else: callers
    /// know the border.
    #[inline]
    pub(super) fn spot(&self, col: usize, row: usize) -> Option<Spot> {
        let tile = self.tile(col, row)?;
        let idx = within(col, row);
        Some(Spot { heat: tile.heat[idx], surfel: tile.surfels[idx] })
    }

    /// The heat of a cell.
    #[inline]
    pub(super) fn heat(&self, col: usize, row: usize) -> u8 {
        self.tile(col, row).map_or(0, |tile| tile.heat[within(col, row)])
    }

    /// Puts a piece of surface at a cell if it is nearer than what is there; true when it is.
    #[inline]
    pub(super) fn raise(&mut self, col: usize, row: usize, spot: Spot) -> bool {
        let place = (row >> SIDE_LOG2) * self.n_cols + (col >> SIDE_LOG2);
        let Some(entry) = self.table.get_mut(place) else { return false };
        if *entry == NO_TILE {
            *entry = self.tiles.len() as u32;
            self.tiles.push(Tile { heat: [0; N_SIDE * N_SIDE], surfels: [NO_SURFEL; N_SIDE * N_SIDE] });
        }
        let Some(tile) = self.tiles.get_mut(*entry as usize) else { return false };
        let idx = within(col, row);
        let is_nearer = spot.heat > tile.heat[idx];
        if is_nearer {
            (tile.heat[idx], tile.surfels[idx]) = (spot.heat, spot.surfel);
        }
        is_nearer
    }

    /// Follows the grid into a larger one; sides and offsets are multiples of a tile's.
    pub(super) fn grow(&mut self, moved: &Move) {
        self.table = moved.apply(&self.table, NO_TILE, SIDE_LOG2);
        self.n_cols = moved.to[0] as usize >> SIDE_LOG2;
    }

    #[inline]
    fn tile(&self, col: usize, row: usize) -> Option<&Tile> {
        let place = (row >> SIDE_LOG2).wrapping_mul(self.n_cols).wrapping_add(col >> SIDE_LOG2);
        self.tiles.get(*self.table.get(place)? as usize)
    }
}

/// Heat by squared distance, in quarters of a cell squared.
pub(super) fn falloff() -> Vec<u8> {
    let n_entries = 4 * 2 * (REACH + 1) * (REACH + 1);
    let heat = |quarters: i32| {
        let squared = quarters as f32 / 4.0;
        (255.0 * (-squared / (2.0 * SIGMA_CELLS * SIGMA_CELLS)).exp()).round() as u8
    };
    (0..n_entries).map(heat).collect()
}
