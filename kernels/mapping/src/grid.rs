//! Where the cells of a 2D grid lie, and occupancy in them.
//!
//! Row-major, x along columns, y along rows, both growing; cell (0, 0) touches the grid's lower left
//! corner. No grid here is rotated against its frame.

use geometry::Point2;

/// Most cells along one side: 8192 cells of 5 cm are 400 m.
pub const N_CELLS_SIDE_MAX: usize = 8192;

/// Number of columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Cells along x.
    pub n_cols: usize,
    /// Cells along y.
    pub n_rows: usize,
}

impl Shape {
    /// Number of cells.
    #[must_use]
    pub const fn n_cells(self) -> usize {
        self.n_cols * self.n_rows
    }

    /// The cell so many columns and rows away, where the grid has it.
    #[must_use]
    pub fn beside(self, cell: Cell, (cols, rows): (isize, isize)) -> Option<Cell> {
        let (col, row) = (cell.col.checked_add_signed(cols)?, cell.row.checked_add_signed(rows)?);
        (col < self.n_cols && row < self.n_rows).then_some(Cell { col, row })
    }
}

/// One cell, by column and row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Cell {
    /// Along x.
    pub col: usize,
    /// Along y.
    pub row: usize,
}

/// Where a grid lies in `map` (or whichever frame its owner names).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// The lower left corner of cell (0, 0), metres.
    pub origin: Point2,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Number of cells.
    pub shape: Shape,
}

/// A grid that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GridError {
    /// A side of zero cells or too many.
    #[error("grid of {n_cols}×{n_rows} cells, each side must be 1 to {N_CELLS_SIDE_MAX}")]
    Shape {
        /// Columns.
        n_cols: usize,
        /// Rows.
        n_rows: usize,
    },
    /// A cell too small, too large or NaN.
    #[error("cell of {0} m, must be 0.005 to 1")]
    Resolution(f64),
    /// An origin that is NaN, infinite or absurdly far.
    #[error("grid origin ({0}, {1}) m, each must be within ±100000")]
    Origin(f64, f64),
    /// The number of values is not the number of cells.
    #[error("{found} values for a grid of {wanted} cells")]
    Length {
        /// Values given.
        found: usize,
        /// Cells of the grid.
        wanted: usize,
    },
    /// A value that is NaN.
    #[error("value {0} of the grid is NaN")]
    NotANumber(usize),
}

impl Layout {
    /// A checked layout.
    ///
    /// # Errors
    /// [`GridError`] names the value and its limit.
    pub fn new(origin: Point2, resolution_m: f64, shape: Shape) -> Result<Self, GridError> {
        let Shape { n_cols, n_rows } = shape;
        if !(1..=N_CELLS_SIDE_MAX).contains(&n_cols) || !(1..=N_CELLS_SIDE_MAX).contains(&n_rows) {
            return Err(GridError::Shape { n_cols, n_rows });
        }
        if !(0.005..=1.0).contains(&resolution_m) {
            return Err(GridError::Resolution(resolution_m));
        }
        if !(origin.x.abs() <= 1e5 && origin.y.abs() <= 1e5) {
            return Err(GridError::Origin(origin.x, origin.y));
        }
        Ok(Layout { origin, resolution_m, shape })
    }

    /// The smallest layout of whole cells, aligned to multiples of `resolution_m`, that covers the box
    /// from `low` to `high`.
    ///
    /// # Errors
    /// [`GridError`] when the box is too large for a grid, inside out or not finite.
    pub fn covering(low: Point2, high: Point2, resolution_m: f64) -> Result<Self, GridError> {
        let first = (low / resolution_m).map(f64::floor);
        let size = (high / resolution_m).map(f64::ceil) - first;
        let shape = Shape { n_cols: size.x.max(0.0) as usize, n_rows: size.y.max(0.0) as usize };
        Layout::new(first * resolution_m, resolution_m, shape)
    }

    /// The cell that holds a point; `None` outside.
    #[must_use]
    pub fn cell_at(&self, point: Point2) -> Option<Cell> {
        let col = ((point.x - self.origin.x) / self.resolution_m).floor();
        let row = ((point.y - self.origin.y) / self.resolution_m).floor();
        let inside =
            col >= 0.0 && row >= 0.0 && col < self.shape.n_cols as f64 && row < self.shape.n_rows as f64;
        inside.then_some(Cell { col: col as usize, row: row as usize })
    }

    /// The centre of a cell.
    #[must_use]
    pub fn centre(&self, cell: Cell) -> Point2 {
        Point2::new(
            self.origin.x + (cell.col as f64 + 0.5) * self.resolution_m,
            self.origin.y + (cell.row as f64 + 0.5) * self.resolution_m,
        )
    }

    /// Position of a cell in row-major order. The cell must lie inside.
    #[must_use]
    pub fn index(&self, cell: Cell) -> usize {
        debug_assert!(cell.col < self.shape.n_cols && cell.row < self.shape.n_rows);
        cell.row * self.shape.n_cols + cell.col
    }

    /// Every cell, in row-major order.
    pub fn cells(&self) -> impl Iterator<Item = Cell> + use<> {
        let Shape { n_cols, n_rows } = self.shape;
        (0..n_rows).flat_map(move |row| (0..n_cols).map(move |col| Cell { col, row }))
    }

    /// The upper right corner, metres.
    #[must_use]
    pub fn far_corner(&self) -> Point2 {
        Point2::new(
            self.origin.x + self.shape.n_cols as f64 * self.resolution_m,
            self.origin.y + self.shape.n_rows as f64 * self.resolution_m,
        )
    }
}

/// What is known of a cell of a base map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(u8)]
pub enum Occupancy {
    /// Never seen. An obstacle for the filter; free, at a cost, for the planner.
    #[default]
    Unknown = 0,
    /// Seen empty.
    Free = 1,
    /// Something stands here.
    Occupied = 2,
}

/// A grid with one value a cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    layout: Layout,
    values: Vec<T>,
}

impl<T: Clone> Grid<T> {
    /// A grid with the same value everywhere.
    #[must_use]
    pub fn filled(layout: Layout, value: T) -> Self {
        Grid { layout, values: vec![value; layout.shape.n_cells()] }
    }
}

impl<T> Grid<T> {
    /// A grid from its values in row-major order.
    ///
    /// # Errors
    /// [`GridError::Length`] when there are not as many values as cells.
    pub fn from_values(layout: Layout, values: Vec<T>) -> Result<Self, GridError> {
        let wanted = layout.shape.n_cells();
        if values.len() != wanted {
            return Err(GridError::Length { found: values.len(), wanted });
        }
        Ok(Grid { layout, values })
    }

    /// A grid of the same layout from its values in row-major order, one for each cell.
    pub(crate) fn with_values<U>(&self, values: Vec<U>) -> Grid<U> {
        debug_assert_eq!(values.len(), self.values.len());
        Grid { layout: self.layout, values }
    }

    /// Where the grid lies.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The values, row-major.
    #[must_use]
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// The values, row-major.
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The value of a cell inside the grid.
    #[must_use]
    pub fn get(&self, cell: Cell) -> &T {
        &self.values[self.layout.index(cell)]
    }

    /// Sets the value of a cell inside the grid.
    pub fn set(&mut self, cell: Cell, value: T) {
        let idx = self.layout.index(cell);
        self.values[idx] = value;
    }

    /// The value of the cell that holds a point; `None` outside.
    #[must_use]
    pub fn at(&self, point: Point2) -> Option<&T> {
        self.layout.cell_at(point).map(|cell| self.get(cell))
    }

    /// The same grid with each value mapped.
    #[must_use]
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Grid<U> {
        Grid { layout: self.layout, values: self.values.iter().map(f).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn layout() -> Layout {
        Layout::new(Point2::new(-1.0, 2.0), 0.05, Shape { n_cols: 40, n_rows: 20 }).unwrap()
    }

    proptest! {
        #[test]
        fn the_centre_of_a_cell_lies_in_it(col in 0..40_usize, row in 0..20_usize) {
            let cell = Cell { col, row };
            prop_assert_eq!(layout().cell_at(layout().centre(cell)), Some(cell));
        }

        #[test]
        fn a_covering_layout_covers(x in -9.0..9.0, y in -9.0..9.0, w in 0.1..5.0, h in 0.1..5.0) {
            let (low, high) = (Point2::new(x, y), Point2::new(x + w, y + h));
            let l = Layout::covering(low, high, 0.05).unwrap();
            prop_assert!(l.origin.x <= low.x + 1e-9 && l.origin.y <= low.y + 1e-9);
            prop_assert!(l.far_corner().x >= high.x - 1e-9 && l.far_corner().y >= high.y - 1e-9);
        }
    }

    #[test]
    fn impossible_grids_are_refused() {
        let shape = Shape { n_cols: 0, n_rows: 3 };
        assert!(matches!(Layout::new(Point2::origin(), 0.05, shape), Err(GridError::Shape { .. })));
        let shape = Shape { n_cols: 3, n_rows: 3 };
        assert!(matches!(Layout::new(Point2::origin(), f64::NAN, shape), Err(GridError::Resolution(_))));
        assert!(matches!(
            Layout::new(Point2::new(f64::INFINITY, 0.0), 0.05, shape),
            Err(GridError::Origin(..))
        ));
        assert!(matches!(Grid::from_values(layout(), vec![0_u8; 3]), Err(GridError::Length { .. })));
        assert_eq!(layout().cell_at(Point2::new(-1.01, 2.5)), None);
        assert_eq!(layout().cell_at(Point2::new(f64::NAN, 2.5)), None);
    }
}
