//! Cells near surfaces, in tiles of 16 × 16: most of a building's ground is near none, and costs one number a
//! tile.

use std::sync::LazyLock;

use super::pyramid::Move;

/// Cells along the side of a tile, as a power of two.
pub(super) const SIDE_LOG2: usize = 4;
const N_SIDE: usize = 1 << SIDE_LOG2;
/// Heat reaches this many cells.
pub(super) const REACH: i32 = 3;
/// Standard deviation of the heat, cells.
const SIGMA_CELLS: f32 = 1.4;
const NO_TILE: u32 = u32::MAX;
/// No piece of surface is near.
pub(super) const NO_SURFEL: u16 = u16::MAX;
/// A piece of surface lies in one of so many parts of its cell, along each side: what it makes hot is known
/// beforehand for each of them.
const N_PARTS: usize = 8;
/// Cells along the side of what a piece of surface makes hot.
const N_STAMP: usize = 2 * REACH as usize + 1;

/// Cells of a tile's row that a stamp is put on at once, at least as many as it is wide.
const N_AT_ONCE: usize = 8;
/// Columns without heat on either side of a stamp, so that whatever lies on a tile of it is put there at once.
const N_PAD: usize = N_AT_ONCE;

/// Heat around a piece of surface, by rows.
type Stamp = [[u8; N_STAMP + 2 * N_PAD]; N_STAMP];

/// Stamps by the part of the cell that the piece of surface lies in.
static STAMPS: LazyLock<Vec<Stamp>> = LazyLock::new(|| {
    let middle = |part: usize| REACH as f32 + (part as f32 + 0.5) / N_PARTS as f32;
    let heat = |dx: f32, dy: f32| {
        // In quarters: of pieces of surface that are about as near, the one that was there first stays.
        let squared = (4.0 * (dx * dx + dy * dy)).floor() / 4.0;
        (255.0 * (-squared / (2.0 * SIGMA_CELLS * SIGMA_CELLS)).exp()).round() as u8
    };
    let stamp = |part: usize| -> Stamp {
        let (x, y) = (middle(part % N_PARTS), middle(part / N_PARTS));
        let mut stamp = [[0; N_STAMP + 2 * N_PAD]; N_STAMP];
        for (row, heats) in stamp.iter_mut().enumerate() {
            for (col, cell) in heats[N_PAD..N_PAD + N_STAMP].iter_mut().enumerate() {
                *cell = heat(col as f32 + 0.5 - x, row as f32 + 0.5 - y);
            }
        }
        stamp
    };
    (0..N_PARTS * N_PARTS).map(stamp).collect()
});

/// Which stamp is that of a piece of surface at such shares of its cell.
#[derive(Clone, Copy)]
pub(super) struct Part(usize);

impl Part {
    #[inline]
    pub(super) fn of(x: f32, y: f32) -> Self {
        let part = |share: f32| ((share * N_PARTS as f32) as usize).min(N_PARTS - 1);
        Part(part(y) * N_PARTS + part(x))
    }

    /// How hot it makes the middle of its own cell.
    #[inline]
    pub(super) fn heat(self) -> u8 {
        STAMPS.get(self.0).map_or(0, |stamp| stamp[REACH as usize][N_PAD + REACH as usize])
    }
}

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
    /// The pyramid above does not know of all of its heat.
    is_changed: bool,
}

/// Tiles by place. Cells are counted from the low corner.
#[derive(Clone, Debug, Default)]
pub(super) struct Tiles {
    table: Vec<u32>,
    n_cols: usize,
    tiles: Vec<Tile>,
    /// Columns and rows of tiles that have changed.
    changed: Vec<[usize; 2]>,
}

/// Puts heat on some cells: those that it is more than what they have take the piece of surface; whether any did.
#[inline]
fn put(heats: &mut [u8], surfels: &mut [u16], stamped: &[u8], surfel: u16) -> bool {
    let (Some(heats), Some(surfels), Some(stamped)) = (
        heats.first_chunk_mut::<N_AT_ONCE>(),
        surfels.first_chunk_mut::<N_AT_ONCE>(),
        stamped.first_chunk::<N_AT_ONCE>(),
    ) else {
        return false;
    };
    let before = *heats;
    for ((heat, nearest), &stamped) in heats.iter_mut().zip(surfels).zip(stamped) {
        *nearest = if stamped > *heat { surfel } else { *nearest };
        *heat = stamped.max(*heat);
    }
    *heats != before
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

    /// The heat of a cell and of those to the right, above, and both.
    #[inline]
    pub(super) fn four_heats(&self, col: usize, row: usize) -> [u8; 4] {
        if col % N_SIDE + 1 < N_SIDE && row % N_SIDE + 1 < N_SIDE {
            let heats = self.tile(col, row).and_then(|tile| tile.heat.get(within(col, row)..));
            let Some(heats) = heats.and_then(|heats| heats.first_chunk::<{ N_SIDE + 2 }>()) else {
                return [0; 4];
            };
            return [heats[0], heats[1], heats[N_SIDE], heats[N_SIDE + 1]];
        }
        [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[right, up]| {
            let (col, row) = (col + right, row + up);
            self.tile(col, row).map_or(0, |tile| tile.heat[within(col, row)])
        })
    }

    /// Tells the cells around a cell of a piece of surface in it: those that have none nearer take it. The grid has
    /// room around the cell.
    pub(super) fn stamp(&mut self, col: usize, row: usize, part: Part, surfel: u16) {
        let Some(stamp) = STAMPS.get(part.0) else { return };
        let reach = REACH as usize;
        let (low, high) = ([col - reach, row - reach], [col + reach, row + reach]);
        for tile_row in low[1] >> SIDE_LOG2..=high[1] >> SIDE_LOG2 {
            for tile_col in low[0] >> SIDE_LOG2..=high[0] >> SIDE_LOG2 {
                let corner = [tile_col << SIDE_LOG2, tile_row << SIDE_LOG2];
                // The part of the stamp that lies on this tile: rows of it, and so many columns of it at once.
                let rows =
                    low[1].max(corner[1]) - corner[1]..(high[1] + 1).min(corner[1] + N_SIDE) - corner[1];
                let first_col = low[0].max(corner[0]).min(corner[0] + N_SIDE - N_AT_ONCE) - corner[0];
                let from = N_PAD + corner[0] + first_col - low[0];
                let Some(tile) = self.tile_mut(tile_col, tile_row) else { continue };
                let mut is_changed = false;
                for row in rows {
                    let cells = row * N_SIDE + first_col..row * N_SIDE + first_col + N_AT_ONCE;
                    let stamped = &stamp[corner[1] + row - low[1]][from..from + N_AT_ONCE];
                    is_changed |=
                        put(&mut tile.heat[cells.clone()], &mut tile.surfels[cells], stamped, surfel);
                }
                if is_changed && !std::mem::replace(&mut tile.is_changed, true) {
                    self.changed.push([tile_col, tile_row]);
                }
            }
        }
    }

    /// The tiles that have changed since this was asked for, by column and row, with their heat.
    pub(super) fn take_changed(&mut self) -> Vec<[usize; 2]> {
        for [col, row] in self.changed.clone() {
            if let Some(tile) = self.tile_mut(col, row) {
                tile.is_changed = false;
            }
        }
        std::mem::take(&mut self.changed)
    }

    /// The heat of all cells of a tile, row by row.
    pub(super) fn heats(&self, tile_col: usize, tile_row: usize) -> Option<&[u8]> {
        self.tile(tile_col << SIDE_LOG2, tile_row << SIDE_LOG2).map(|tile| tile.heat.as_slice())
    }

    /// Follows the grid into a larger one; sides and offsets are multiples of a tile's.
    pub(super) fn grow(&mut self, moved: &Move) {
        self.table = moved.apply(&self.table, NO_TILE, SIDE_LOG2, 0);
        self.n_cols = moved.to[0] as usize >> SIDE_LOG2;
    }

    #[inline]
    fn tile(&self, col: usize, row: usize) -> Option<&Tile> {
        let place = (row >> SIDE_LOG2).wrapping_mul(self.n_cols).wrapping_add(col >> SIDE_LOG2);
        self.tiles.get(*self.table.get(place)? as usize)
    }

    /// A tile by its column and row, made if there is none yet.
    #[inline]
    fn tile_mut(&mut self, tile_col: usize, tile_row: usize) -> Option<&mut Tile> {
        let entry = self.table.get_mut(tile_row * self.n_cols + tile_col)?;
        if *entry == NO_TILE {
            *entry = self.tiles.len() as u32;
            self.tiles.push(Tile {
                heat: [0; N_SIDE * N_SIDE],
                surfels: [NO_SURFEL; N_SIDE * N_SIDE],
                is_changed: false,
            });
        }
        self.tiles.get_mut(*entry as usize)
    }
}
