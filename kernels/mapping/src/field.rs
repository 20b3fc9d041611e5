//! Signed distance fields, sampled bilinearly and never above the true distance.

use geometry::Point2;

use crate::grid::{GridError, Layout};

/// What is subtracted from a field, in cells, so that its bilinear interpolation never exceeds the true
/// distance. The bound is 0.354 (half a cell's diagonal less half a side); measured in a prototype:
/// without it hulls were penetrated by 1 to 2 mm.
pub const CONSERVATIVE_CELLS: f64 = 0.36;

/// Signed distance to a set, metres, one value a cell centre; negative inside the set.
///
/// Between centres the value is bilinear; outside the grid it is the border's less the distance to the
/// border, a lower bound. The bilinear field is *not* 1-Lipschitz: its constant is √2.
#[derive(Clone, Debug, PartialEq)]
pub struct DistanceField {
    layout: Layout,
    values_m: Vec<f32>,
}

impl DistanceField {
    /// A field from its values at the cells' centres, row-major, metres. `+∞` is allowed: nothing there.
    ///
    /// # Errors
    /// [`GridError`] when the length is wrong or a value is NaN.
    pub fn from_values(layout: Layout, values_m: Vec<f32>) -> Result<Self, GridError> {
        let wanted = layout.shape.n_cells();
        if values_m.len() != wanted {
            return Err(GridError::Length { found: values_m.len(), wanted });
        }
        if let Some(idx) = values_m.iter().position(|v| v.is_nan()) {
            return Err(GridError::NotANumber(idx));
        }
        // Infinity would make NaN in the interpolation; a kilometre says the same.
        let values_m = values_m.into_iter().map(|v| v.clamp(-1000.0, 1000.0)).collect();
        Ok(DistanceField { layout, values_m })
    }

    /// A field from values that are known to be right: one a cell, finite, within ±1000 m.
    pub(crate) fn from_clamped(layout: Layout, values_m: Vec<f32>) -> Self {
        debug_assert_eq!(values_m.len(), layout.shape.n_cells());
        debug_assert!(values_m.iter().all(|v| v.abs() <= 1000.0));
        DistanceField { layout, values_m }
    }

    /// Where the field lies.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The values at the cells' centres, row-major, metres.
    #[must_use]
    pub fn values_m(&self) -> &[f32] {
        &self.values_m
    }

    /// The same, to be written: finite, within ±1000 m.
    pub(crate) fn values_m_mut(&mut self) -> &mut [f32] {
        &mut self.values_m
    }

    /// Signed distance at a point, metres: bilinear inside, a lower bound outside. NaN in, −∞ out.
    #[must_use]
    pub fn sample(&self, point: Point2) -> f64 {
        self.sample_at(&Spot::of(&self.layout, point))
    }

    /// The same at a spot of this field's layout; of another layout's, −∞ or some other value of this field.
    #[must_use]
    #[inline]
    pub fn sample_at(&self, spot: &Spot) -> f64 {
        let Spot { first_idx, next_col, next_row, share_x, share_y, beyond_m } = *spot;
        let value = |idx: usize| self.values_m.get(idx).map_or(f64::NEG_INFINITY, |value| f64::from(*value));
        let (left, right) = (value(first_idx), value(first_idx + next_col));
        let lower = left + share_x * (right - left);
        let (left, right) = (value(first_idx + next_row), value(first_idx + next_row + next_col));
        let upper = left + share_x * (right - left);
        lower + share_y * (upper - lower) - beyond_m
    }
}

/// Where a point lies among the cells of a layout: found once, it serves every field on that layout.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    /// The cell whose centre is to the lower left.
    first_idx: usize,
    /// From it to its right and to its upper neighbour; 0 at the border.
    next_col: usize,
    next_row: usize,
    share_x: f64,
    share_y: f64,
    /// How far outside the grid the point is, metres.
    beyond_m: f64,
}

impl Spot {
    /// The spot of a point; what is no number is infinitely far outside.
    #[must_use]
    #[inline]
    pub fn of(layout: &Layout, point: Point2) -> Spot {
        let Layout { origin, resolution_m, shape } = *layout;
        let x = (point.x - origin.x) / resolution_m - 0.5;
        let y = (point.y - origin.y) / resolution_m - 0.5;
        if x.is_nan() || y.is_nan() {
            let beyond_m = f64::INFINITY;
            return Spot { first_idx: 0, next_col: 0, next_row: 0, share_x: 0.0, share_y: 0.0, beyond_m };
        }
        let (last_col, last_row) = (shape.n_cols - 1, shape.n_rows - 1);
        let (inside_x, inside_y) = (x.clamp(0.0, last_col as f64), y.clamp(0.0, last_row as f64));
        let is_inside = x == inside_x && y == inside_y;
        // Nearly always inside, where the root need not be taken.
        let beyond_m = if is_inside { 0.0 } else { (x - inside_x).hypot(y - inside_y) * resolution_m };
        let (col, row) = (inside_x as usize, inside_y as usize);
        Spot {
            first_idx: row * shape.n_cols + col,
            next_col: usize::from(col < last_col),
            next_row: if row < last_row { shape.n_cols } else { 0 },
            share_x: inside_x - col as f64,
            share_y: inside_y - row as f64,
            beyond_m,
        }
    }
}
