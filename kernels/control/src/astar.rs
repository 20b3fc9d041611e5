//! The shortest path over a costmap: A* on eight neighbours, in arrays, a row of neighbours at a time.
//!
//! A start within an inflated area may leave it, over cells with nothing in them, at a high cost; nothing
//! else may enter one. Diagonals do not cut corners. What is open waits in buckets of nearly equal cost, which need no
//! order within (Dial, CACM 12, 1969): a cell that a cheaper way reaches later is looked at again. Deliberately not
//! here: following the path (`tracker`).

use std::f32::consts::SQRT_2;

use geometry::Point2;
use wide::f32x4;

use crate::costmap::{Blocked, Costmap, Weights};

/// Why there is no path.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum NoPath {
    /// The start is not on the map, or something stands on it.
    #[error("start ({x_m:.2}, {y_m:.2}) m is off the map or inside an obstacle")]
    Start {
        /// Position in `map`, metres.
        x_m: f64,
        /// Position in `map`, metres.
        y_m: f64,
    },
    /// The goal is not on the map.
    #[error("goal ({x_m:.2}, {y_m:.2}) m is off the map")]
    GoalOffMap {
        /// Position in `map`, metres.
        x_m: f64,
        /// Position in `map`, metres.
        y_m: f64,
    },
    /// The robot does not fit at the goal.
    #[error("goal is too near an obstacle")]
    GoalAtObstacle,
    /// A rule keeps the robot from the goal.
    #[error("goal lies within zone {zone_idx}, which a rule keeps the robot out of")]
    GoalInZone {
        /// Position in the list that the costmap was made with.
        zone_idx: usize,
    },
    /// Both ends are free, and nothing connects them.
    #[error("no way leads to the goal")]
    Closed,
}

/// The cheapest path from start to goal, as points in `map`: the start itself, cell centres, the goal itself.
///
/// # Errors
/// [`NoPath`] names which end is wrong and why, or that nothing connects them.
pub fn shortest_path(map: &Costmap, start: Point2, goal: Point2) -> Result<Vec<Point2>, NoPath> {
    let layout = map.layout();
    let off_start = NoPath::Start { x_m: start.x, y_m: start.y };
    let start_cell = layout.cell_at(start).ok_or(off_start.clone())?;
    let goal_cell = layout.cell_at(goal).ok_or(NoPath::GoalOffMap { x_m: goal.x, y_m: goal.y })?;
    if map.is_solid(start_cell) {
        return Err(off_start);
    }
    match map.blocked(layout.index(goal_cell)) {
        Blocked::Free => {}
        Blocked::Obstacle => return Err(NoPath::GoalAtObstacle),
        Blocked::Zone(zone_idx) => return Err(NoPath::GoalInZone { zone_idx }),
    }
    let weights = map.weights();
    let mut search = Search::new(weights);
    let [from, to] = [start_cell, goal_cell].map(|cell| weights.position(cell));
    search.run(from, to);
    let mut path = vec![goal];
    let (mut here, mut step) = (to, 0);
    while here != from {
        (here, step) = search.before(here, step).ok_or(NoPath::Closed)?;
        if here != from {
            path.push(layout.centre(weights.cell(here)));
        }
    }
    path.push(start);
    path.reverse();
    Ok(path)
}

/// The eight steps, as columns and rows, by row and column.
const STEPS: [(i32, i32); 8] = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
/// Their lengths, cells.
const LENGTHS: [f32; 8] = [SQRT_2, 1.0, SQRT_2, 1.0, 1.0, SQRT_2, 1.0, SQRT_2];
/// By which of the eight cells around may be stepped on, as bits: which steps do not cut a corner of the others.
static CLEAR_OF_CORNERS: [u8; 256] = clear_of_corners();

const fn clear_of_corners() -> [u8; 256] {
    let mut table = [0; 256];
    let mut open = 0;
    while open < table.len() {
        let (below, left, right, above) = (open >> 1 & 1, open >> 3 & 1, open >> 4 & 1, open >> 6 & 1);
        let diagonals = (below & left) | (below & right) << 2 | (above & left) << 5 | (above & right) << 7;
        table[open] = (open & (0b0101_1010 | diagonals)) as u8;
        open += 1;
    }
    table
}

/// What a search knows of each cell. It looks at the cells around one row by row, each row at once.
struct Search<'a> {
    weights: &'a Weights,
    /// Cost of the cheapest way known, cells; below zero once the ways on from there are known.
    costs: Vec<f32>,
    /// From a cell to the eight around it.
    ways: [isize; 8],
}

impl<'a> Search<'a> {
    fn new(weights: &'a Weights) -> Self {
        let stride = weights.stride as isize;
        let ways = STEPS.map(|(dx, dy)| dy as isize * stride + dx as isize);
        Search { weights, costs: vec![f32::INFINITY; weights.values.len()], ways }
    }

    /// Finds the cheapest way to the goal, if there is one.
    fn run(&mut self, start: usize, goal: usize) {
        let stride = self.weights.stride;
        let place =
            |position: usize| Place { col: (position % stride) as u16, row: (position / stride) as u16 };
        let goal_place = place(goal);
        let mut open = Buckets::new();
        self.costs[start] = 0.0;
        open.push(0.0, place(start));
        while let Some(place) = open.pop(self.costs[goal].abs()) {
            let here = usize::from(place.row) * stride + usize::from(place.col);
            let cost = self.costs[here];
            if cost.is_sign_negative() {
                continue;
            }
            self.costs[here] = -cost;
            let mut found = self.look_around(here, cost);
            while found.steps != 0 {
                let step = found.steps.trailing_zeros() as usize;
                found.steps &= found.steps - 1;
                let (cost, next) = (found.costs[step], place.after(STEPS[step]));
                self.costs[here.wrapping_add_signed(self.ways[step])] = cost;
                open.push(cost + next.octile(goal_place), next);
            }
        }
    }

    /// Which steps lead cheaper to a cell around than what is known, and at what cost.
    #[inline(always)]
    fn look_around(&self, here: usize, cost: f32) -> Around {
        const AT_SIDES: f32x4 = f32x4::new([SQRT_2, 1.0, SQRT_2, 0.0]);
        const BESIDE: f32x4 = f32x4::new([1.0, 0.0, 1.0, 0.0]);
        let row = |first: usize, lengths: f32x4| {
            let costs = f32x4::splat(cost) + lengths * four(&self.weights.values, first).abs();
            (costs.simd_lt(four(&self.costs, first).abs()).to_bitmask(), costs.to_array())
        };
        let stride = self.weights.stride;
        let (below, [c0, c1, c2, _]) = row(here - stride - 1, AT_SIDES);
        let (beside, [c3, _, c4, _]) = row(here - 1, BESIDE);
        let (above, [c5, c6, c7, _]) = row(here + stride - 1, AT_SIDES);
        let steps = bits([below, beside, above]) & self.allowed(here);
        Around { steps, costs: [c0, c1, c2, c3, c4, c5, c6, c7] }
    }

    /// Which steps are allowed: out of an inflated area, never into one, and around corners.
    #[inline(always)]
    fn allowed(&self, here: usize) -> u8 {
        let stride = self.weights.stride;
        let is_free = self.weights.values[here] > 0.0;
        let rows = [here - stride - 1, here - 1, here + stride - 1].map(|first| {
            let weights = four(&self.weights.values, first);
            let there = if is_free { weights } else { weights.abs() };
            (there.simd_gt(f32x4::ZERO) & there.simd_lt(f32x4::splat(f32::INFINITY))).to_bitmask()
        });
        CLEAR_OF_CORNERS[usize::from(bits(rows))]
    }

    /// The cell before one on the cheapest way to it, and the step from there; `None` when no way leads there. Of
    /// ways that cost the same it is the one that goes straight on by `step`.
    fn before(&self, here: usize, step: usize) -> Option<(usize, usize)> {
        let (cost, weight) = (self.costs[here].abs(), self.weights.values[here].abs());
        if cost == f32::INFINITY {
            return None;
        }
        let others = (0..STEPS.len()).filter(|other| *other != step);
        let mut befores = std::iter::once(step).chain(others).filter_map(|step| {
            let from = here.checked_add_signed(-self.ways[step])?;
            let is_before = self.costs[from].abs() + LENGTHS[step] * weight <= cost;
            (is_before && self.allowed(from) >> step & 1 == 1).then_some((from, step))
        });
        befores.next()
    }
}

/// Four values in a row; past the end nothing is cheap.
#[inline(always)]
fn four(values: &[f32], first: usize) -> f32x4 {
    f32x4::new(values[first..].first_chunk::<4>().copied().unwrap_or([f32::INFINITY; 4]))
}

/// Bits of the cells around one, by those of the three rows.
#[inline(always)]
fn bits([below, beside, above]: [u32; 3]) -> u8 {
    ((below & 7) | (beside & 1) << 3 | (beside & 4) << 2 | (above & 7) << 5) as u8
}

/// Steps that are worth it, as bits, and what each would cost.
struct Around {
    steps: u8,
    costs: [f32; 8],
}

/// A cell to be looked at, on the map with its border.
#[derive(Clone, Copy)]
struct Place {
    col: u16,
    row: u16,
}

impl Place {
    #[inline(always)]
    fn after(self, (dx, dy): (i32, i32)) -> Place {
        Place { col: self.col.wrapping_add_signed(dx as i16), row: self.row.wrapping_add_signed(dy as i16) }
    }

    /// Length of the shortest way over eight neighbours, cells.
    #[inline(always)]
    fn octile(self, other: Place) -> f32 {
        let off_col = f32::from(self.col.abs_diff(other.col));
        let off_row = f32::from(self.row.abs_diff(other.row));
        off_col.max(off_row) + (SQRT_2 - 1.0) * off_col.min(off_row)
    }
}

/// Buckets for each cell's length.
const BUCKETS_PER_CELL: f32 = 8.0;
/// So many buckets are ahead of the present one: more than the dearest step adds, out of an inflated area.
const N_BUCKETS: usize = 1024;

/// Cells that are open, by the cost of the whole way over them, in a ring of chains.
struct Buckets {
    /// Of each bucket, the place of its last entry.
    last: Vec<u32>,
    /// Every entry there ever was, and the place of the one before it in its bucket.
    entries: Vec<(Place, u32)>,
    /// The present bucket, counted from cost 0.
    at: usize,
    n_open: usize,
}

/// The place of no entry.
const NO_ENTRY: u32 = u32::MAX;

impl Buckets {
    fn new() -> Self {
        Buckets { last: vec![NO_ENTRY; N_BUCKETS], entries: Vec::with_capacity(4096), at: 0, n_open: 0 }
    }

    #[inline(always)]
    fn push(&mut self, whole_cost: f32, place: Place) {
        // Too early is only looked at too early.
        let bucket =
            ((whole_cost * BUCKETS_PER_CELL) as i32 as usize).clamp(self.at, self.at + N_BUCKETS - 1);
        let last = &mut self.last[bucket % N_BUCKETS];
        self.entries.push((place, std::mem::replace(last, self.entries.len() as u32)));
        self.n_open += 1;
    }

    /// One of the cheapest; `None` when no way over any could be cheaper than `enough`.
    #[inline(always)]
    fn pop(&mut self, enough: f32) -> Option<Place> {
        while self.n_open > 0 && (self.at as f32) < enough * BUCKETS_PER_CELL {
            let last = &mut self.last[self.at % N_BUCKETS];
            if let Some((place, before)) = self.entries.get(*last as usize) {
                *last = *before;
                self.n_open -= 1;
                return Some(*place);
            }
            self.at += 1;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;
    use mapping::{Cell, Grid, Layout, Occupancy, Shape};
    use proptest::prelude::*;

    fn room() -> Grid<Occupancy> {
        let shape = Shape { n_cols: 100, n_rows: 80 };
        let layout = Layout::new(Point2::origin(), 0.05, shape).unwrap();
        Grid::filled(layout, Occupancy::Free)
    }

    fn wall(grid: &mut Grid<Occupancy>, col: usize, rows: std::ops::Range<usize>) {
        for row in rows {
            grid.set(Cell { col, row }, Occupancy::Occupied);
        }
    }

    fn map(grid: &Grid<Occupancy>) -> Costmap {
        Costmap::new(grid, &[], 0.05, &Profile::sim())
    }

    const WEST: Point2 = Point2::new(1.0, 1.0);
    const EAST: Point2 = Point2::new(4.0, 1.0);

    fn length_m(path: &[Point2]) -> f64 {
        path.windows(2).map(|w| (w[1] - w[0]).norm()).sum()
    }

    #[test]
    fn an_open_room_is_crossed_straight() {
        let path = shortest_path(&map(&room()), WEST, EAST).unwrap();
        assert_eq!((path[0], path[path.len() - 1]), (WEST, EAST));
        assert!(length_m(&path) < 3.1);
    }

    #[test]
    fn a_wall_is_gone_around_with_hull_and_clearance() {
        let mut grid = room();
        wall(&mut grid, 50, 0..50);
        let path = shortest_path(&map(&grid), WEST, EAST).unwrap();
        assert!(length_m(&path) > 4.0);
        let end_of_wall = Point2::new(2.525, 2.475);
        assert!(path.iter().all(|p| (p - end_of_wall).norm() > 0.3 - 0.05));
    }

    #[test]
    fn a_wall_across_the_room_leaves_no_way() {
        let mut grid = room();
        wall(&mut grid, 50, 0..80);
        assert_eq!(shortest_path(&map(&grid), WEST, EAST), Err(NoPath::Closed));
    }

    #[test]
    fn a_start_too_near_a_wall_gets_out() {
        let mut grid = room();
        wall(&mut grid, 15, 0..60);
        let path = shortest_path(&map(&grid), Point2::new(0.95, 1.0), EAST).unwrap();
        assert!(length_m(&path) < 3.3);
    }

    #[test]
    fn a_goal_that_is_blocked_is_named() {
        let mut grid = room();
        wall(&mut grid, 80, 20..21);
        let near_post = Point2::new(4.0, 1.2);
        assert_eq!(shortest_path(&map(&grid), WEST, near_post), Err(NoPath::GoalAtObstacle));
        let off = Point2::new(9.0, 1.0);
        assert!(matches!(shortest_path(&map(&grid), WEST, off), Err(NoPath::GoalOffMap { .. })));
        assert!(matches!(shortest_path(&map(&grid), off, WEST), Err(NoPath::Start { .. })));
        let field =
            mapping::DistanceField::from_values(*grid.layout(), vec![0.4; grid.values().len()]).unwrap();
        let zoned = Costmap::new(&room(), &[(&field, 0.2)], 0.05, &Profile::sim());
        assert_eq!(shortest_path(&zoned, WEST, EAST), Err(NoPath::GoalInZone { zone_idx: 0 }));
    }

    #[test]
    fn start_and_goal_in_one_cell_is_a_path() {
        let path = shortest_path(&map(&room()), WEST, Point2::new(1.01, 1.01)).unwrap();
        assert_eq!(path, vec![WEST, Point2::new(1.01, 1.01)]);
    }

    /// Costs from a cell to all others, by looking at all cells until none gets cheaper.
    fn slow_costs(map: &Costmap, start: Cell) -> Vec<f32> {
        let layout = *map.layout();
        let mut costs = vec![f32::INFINITY; layout.shape.n_cells()];
        costs[layout.index(start)] = 0.0;
        loop {
            let before = costs.clone();
            for cell in layout.cells() {
                for step in STEPS {
                    if let Some((next, cost)) = step_cost(map, cell, step) {
                        let reached = costs[layout.index(cell)] + cost;
                        let known = &mut costs[layout.index(next)];
                        *known = known.min(reached);
                    }
                }
            }
            if costs == before {
                return costs;
            }
        }
    }

    /// Where a step leads, and its cost; `None` where it is not allowed.
    fn step_cost(map: &Costmap, cell: Cell, (dx, dy): (i32, i32)) -> Option<(Cell, f32)> {
        let layout = map.layout();
        let at = |dx: i32, dy: i32| {
            let col = cell.col.checked_add_signed(dx as isize).filter(|col| *col < layout.shape.n_cols)?;
            let row = cell.row.checked_add_signed(dy as isize).filter(|row| *row < layout.shape.n_rows)?;
            Some(Cell { col, row })
        };
        let is_free = |cell: Cell| map.blocked(layout.index(cell)) == Blocked::Free;
        let is_open = |side: Option<Cell>| {
            side.is_some_and(|side| !map.is_solid(side) && (!is_free(cell) || is_free(side)))
        };
        let next = at(dx, dy).filter(|_| is_open(at(dx, dy)))?;
        if dx != 0 && dy != 0 && !(is_open(at(dx, 0)) && is_open(at(0, dy))) {
            return None;
        }
        let weight = map.weight(next);
        Some((next, weight * if dx != 0 && dy != 0 { std::f32::consts::SQRT_2 } else { 1.0 }))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn no_way_is_cheaper_and_there_is_none_where_none_is_found(
            posts in prop::collection::vec((0..60_usize, 0..50_usize, 1..14_usize, any::<bool>()), 0..14),
            unknown in prop::collection::vec((0..60_usize, 0..50_usize), 0..3),
            start in (0..60_usize, 0..50_usize), goal in (0..60_usize, 0..50_usize),
        ) {
            let layout = Layout::new(Point2::origin(), 0.05, Shape { n_cols: 60, n_rows: 50 }).unwrap();
            let mut grid = Grid::filled(layout, Occupancy::Free);
            for (col, row) in unknown {
                for cell in layout.cells().filter(|c| c.col.abs_diff(col) < 9 && c.row.abs_diff(row) < 9) {
                    grid.set(cell, Occupancy::Unknown);
                }
            }
            for (col, row, length, is_across) in posts {
                for off in 0..length {
                    let (col, row) = if is_across { (col + off, row) } else { (col, row + off) };
                    grid.set(Cell { col: col.min(59), row: row.min(49) }, Occupancy::Occupied);
                }
            }
            let map = map(&grid);
            let (from, to) = (Cell { col: start.0, row: start.1 }, Cell { col: goal.0, row: goal.1 });
            let found = shortest_path(&map, layout.centre(from), layout.centre(to));
            let least = slow_costs(&map, from)[layout.index(to)];
            match found {
                Ok(path) => {
                    let cells: Vec<Cell> = path.iter().map(|p| layout.cell_at(*p).unwrap()).collect();
                    let mut cost = 0.0;
                    for pair in cells.windows(2) {
                        let step = STEPS.into_iter().filter_map(|step| step_cost(&map, pair[0], step));
                        cost += step.filter(|(next, _)| *next == pair[1]).map(|(_, cost)| cost).sum::<f32>();
                    }
                    prop_assert!((cost - least).abs() <= 1e-4 * least.max(1.0), "{cost}, and {least} would do");
                }
                Err(NoPath::Closed) => prop_assert_eq!(least, f32::INFINITY),
                Err(_) => {}
            }
        }
    }
}
