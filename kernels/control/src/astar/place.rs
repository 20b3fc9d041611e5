//! A cell on the map with its border, in four bytes.
//!
//! Deliberately not here: what lies there (`costmap`), and what a search knows of it (`search`).

use mapping::Cell;

/// Row and column, counted with the border.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Place(u32);

/// Lanes of three rows of four around a place, and of one that is not used.
pub(super) const N_LANES: usize = 16;
/// The place by one row more. A column more is 1.
const ROW: u32 = 1 << 16;

impl Place {
    /// The place of a cell of the map.
    pub(super) fn of(cell: Cell) -> Place {
        Place(cell.row as u32 * ROW + cell.col as u32 + ROW + 1)
    }

    /// The cell of the map at a place that is not on the border.
    pub(super) fn cell(self) -> Cell {
        let [col, row] = self.col_and_row();
        Cell { col: col as usize - 1, row: row as usize - 1 }
    }

    /// Where it lies among the values of a map.
    #[inline(always)]
    pub(super) fn position(self, stride: usize) -> usize {
        let [col, row] = self.col_and_row();
        (row as usize).wrapping_mul(stride).wrapping_add(col as usize)
    }

    /// The place that a lane of the cells around leads to.
    #[inline(always)]
    pub(super) fn after(self, lane: usize) -> Place {
        Place(self.0.wrapping_add(WAYS[lane]))
    }

    /// The place that a lane leads from.
    #[inline(always)]
    pub(super) fn before(self, lane: usize) -> Place {
        Place(self.0.wrapping_sub(WAYS[lane]))
    }

    /// How many columns and rows it lies off another place.
    #[inline(always)]
    pub(super) fn off(self, other: Place) -> [f32; 2] {
        let ([col, row], [other_col, other_row]) = (self.col_and_row(), other.col_and_row());
        [col.wrapping_sub(other_col) as f32, row.wrapping_sub(other_row) as f32]
    }

    #[inline(always)]
    fn col_and_row(self) -> [i32; 2] {
        [(self.0 % ROW) as i32, (self.0 / ROW) as i32]
    }
}

/// By lane, from a place to those around it.
static WAYS: [u32; N_LANES] = ways();

const fn ways() -> [u32; N_LANES] {
    let mut ways = [0; N_LANES];
    let mut lane = 0;
    while lane < N_LANES {
        let (row, col) = ((lane / 4) as u32, (lane % 4) as u32);
        ways[lane] = (row * ROW + col).wrapping_sub(ROW + 1);
        lane += 1;
    }
    ways
}
