//! Where the planner may lead the robot's centre, and at what cost.
//!
//! The planner shares its clearance with the filter: a path that the filter would not let the robot follow is
//! no path. Unknown cells are free at a cost here (they may turn out to be floor), while for the filter they
//! are obstacles once they are near. Deliberately not here: the search (`astar`).

use geometry::{Point2, Profile};
use mapping::distance::signed_distance;
use mapping::field::CONSERVATIVE_CELLS;
use mapping::{Cell, DistanceField, Grid, Layout, Occupancy};

mod weights;

pub(crate) use weights::{STEPS, Weights};

/// Hull clearance that planner and filter share, beyond what the field is conservative by, metres. At 0.02
/// less of it 18 of 200 worlds froze in a prototype, with it none.
pub const CLEARANCE_BEYOND_FIELD_M: f64 = 0.03;
/// Extra cost of a metre through unknown cells.
const UNKNOWN_COST: f32 = 2.0;
/// Cost of a metre through an inflated area: the nearest way out wins.
const LEAVING_COST: f32 = 51.0;
/// Up to this clearance of the hull a metre costs more, metres.
const COMFORT_M: f64 = 0.25;
/// Extra cost of a metre at the least clearance.
const DISCOMFORT_COST: f64 = 1.0;

/// Hull clearance for a planner on cells of this size, metres: about 0.05 for 5 cm.
#[must_use]
pub fn planner_clearance_m(resolution_m: f64) -> f64 {
    CONSERVATIVE_CELLS * resolution_m + CLEARANCE_BEYOND_FIELD_M
}

/// What stands in the way of the centre at a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Blocked {
    /// Nothing.
    Free,
    /// A mapped obstacle would be too near.
    Obstacle,
    /// The zone at this position in the list given to [`Costmap::new`].
    Zone(usize),
}

/// Cells that the centre may be in, and the cost of being there.
#[derive(Clone, Debug)]
pub struct Costmap {
    layout: Layout,
    blocked: Vec<Blocked>,
    weights: Weights,
    /// Margin of the hull to all that blocks, metres: free where it is at least `least_m`. Without it (a
    /// zone that yields NaN) nothing is free.
    margin: Option<DistanceField>,
    least_m: f64,
}

impl Costmap {
    /// A costmap of a base map and the zones that a rule keeps the robot out of.
    ///
    /// Each zone comes with the buffer between it and the hull, metres. `clearance_m` is the true distance
    /// to keep between hull and obstacle, see [`planner_clearance_m`].
    #[must_use]
    pub fn new(
        base: &Grid<Occupancy>,
        zones: &[(&DistanceField, f64)],
        clearance_m: f64,
        profile: &Profile,
    ) -> Costmap {
        let layout = *base.layout();
        let occupied = base.map(|value| *value == Occupancy::Occupied);
        let field = signed_distance(&occupied);
        let radius_m = profile.radius_m;
        // What a conservative field of these cells must still show.
        let on_field_m = clearance_m - CONSERVATIVE_CELLS * layout.resolution_m;
        let n_cells = layout.shape.n_cells();
        let (mut blocked_by, mut weights) = (Vec::with_capacity(n_cells), Weights::solid(layout.shape));
        let mut margins_m = Vec::with_capacity(n_cells);
        for (idx, cell) in layout.cells().enumerate() {
            let place = layout.centre(cell);
            let mut hull_m = f64::from(field.values_m()[idx]) - radius_m;
            let mut blocked = if hull_m < on_field_m { Blocked::Obstacle } else { Blocked::Free };
            for (zone_idx, (zone, buffer_m)) in zones.iter().enumerate() {
                let margin_m = zone.sample(place) - radius_m - buffer_m;
                hull_m = hull_m.min(margin_m);
                // What is not a number blocks.
                if blocked == Blocked::Free && (margin_m < on_field_m || margin_m.is_nan()) {
                    blocked = Blocked::Zone(zone_idx);
                }
            }
            blocked_by.push(blocked);
            margins_m.push(hull_m as f32);
            let unknown = if base.values()[idx] == Occupancy::Unknown { UNKNOWN_COST } else { 0.0 };
            let tight = (1.0 - (hull_m - on_field_m) / COMFORT_M).clamp(0.0, 1.0);
            let position = weights.position(cell);
            weights.values[position] = match blocked {
                _ if occupied.values()[idx] => f32::INFINITY,
                Blocked::Free => 1.0 + unknown + (tight * DISCOMFORT_COST) as f32,
                Blocked::Obstacle | Blocked::Zone(_) => -LEAVING_COST,
            };
        }
        let weights = weights.with_steps();
        let margin = DistanceField::from_values(layout, margins_m).ok();
        // The fields are in f32: a border must not be cut by rounding.
        let least_m = on_field_m - 1e-5;
        Costmap { layout, blocked: blocked_by, weights, margin, least_m }
    }

    /// Where the cells lie.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// What stands in the way at a cell of the grid, by its row-major position.
    #[must_use]
    pub fn blocked(&self, idx: usize) -> Blocked {
        self.blocked[idx]
    }

    /// Whether something stands in a cell of the grid itself.
    #[must_use]
    pub fn is_solid(&self, cell: Cell) -> bool {
        self.weight(cell).is_infinite()
    }

    /// Cost of a metre in a cell of the grid: 1 on plain floor, infinite where something stands.
    #[must_use]
    pub fn weight(&self, cell: Cell) -> f32 {
        self.weights.values[self.weights.position(cell)]
    }

    /// What a search goes by.
    pub(crate) fn weights(&self) -> &Weights {
        &self.weights
    }

    /// Whether the centre may be at a place, between cells too; not off the map.
    ///
    /// Cells alone would not do: a place in a free cell can be nearer to the wall than its centre is.
    #[must_use]
    pub fn is_free(&self, place: Point2) -> bool {
        self.layout.cell_at(place).is_some() && self.room_m(place) >= 0.0
    }

    /// Room beyond the least clearance at a place, metres; below 0 where the centre may not be.
    #[must_use]
    pub fn room_m(&self, place: Point2) -> f64 {
        self.margin.as_ref().map_or(f64::NEG_INFINITY, |margin| margin.sample(place) - self.least_m)
    }

    /// Whether the straight line keeps `room_m` beyond the least clearance. A blocked beginning is forgiven
    /// until the first free cell, so that who stands too near something still sees.
    #[must_use]
    pub fn sees(&self, from: Point2, to: Point2, room_m: f64) -> bool {
        let n = ((to - from).norm() / (0.4 * self.layout.resolution_m)).ceil().max(1.0) as usize;
        let mut leaving = !self.is_free(from);
        for k in 0..=n {
            let place = from + (to - from) * (k as f64 / n as f64);
            if self.is_free(place) && (leaving || self.room_m(place) >= room_m) {
                leaving = false;
            } else if !leaving || self.layout.cell_at(place).is_none_or(|c| self.is_solid(c)) {
                return false;
            }
        }
        !leaving
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapping::Shape;

    fn layout(n_cols: usize, n_rows: usize) -> Layout {
        Layout::new(Point2::origin(), 0.05, Shape { n_cols, n_rows }).unwrap()
    }

    #[test]
    fn unknown_cells_are_free_at_a_cost() {
        let mut grid = Grid::filled(layout(40, 40), Occupancy::Free);
        grid.set(Cell { col: 20, row: 20 }, Occupancy::Unknown);
        let map = Costmap::new(&grid, &[], 0.05, &Profile::sim());
        let [unknown, known] = [(20, 20), (30, 20)].map(|(col, row)| Cell { col, row });
        assert_eq!(map.blocked(map.layout().index(unknown)), Blocked::Free);
        assert!(map.weight(unknown) > map.weight(known));
    }

    #[test]
    fn cells_within_hull_and_clearance_of_an_obstacle_are_blocked() {
        let mut grid = Grid::filled(layout(60, 60), Occupancy::Free);
        grid.set(Cell { col: 30, row: 30 }, Occupancy::Occupied);
        let map = Costmap::new(&grid, &[], 0.05, &Profile::sim());
        // The centre of cell 30 + k is (k − ½) cells from the obstacle's square: 0.30 m needs k ≥ 6.5.
        let at = |k: usize| map.blocked(map.layout().index(Cell { col: 30 + k, row: 30 }));
        assert_eq!((at(6), at(7)), (Blocked::Obstacle, Blocked::Free));
    }
}
