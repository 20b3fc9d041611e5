//! The shortest path over a costmap: A* on eight neighbours, in arrays.
//!
//! A start within an inflated area may leave it, over cells with nothing in them, at a high cost; nothing
//! else may enter one. Diagonals do not cut corners. What is open waits in buckets of nearly equal cost, which need no
//! order within (Dial, CACM 12, 1969): a cell that a cheaper way reaches later is looked at again. Deliberately not
//! here: following the path (`tracker`).

use geometry::Point2;
use mapping::Cell;

use crate::costmap::{Blocked, Costmap};

/// Cost of a metre through an inflated area: the nearest way out wins.
const LEAVING_COST: f32 = 50.0;

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
    let (start_idx, goal_idx) = (layout.index(start_cell), layout.index(goal_cell));
    if map.is_solid(start_idx) {
        return Err(off_start);
    }
    match map.blocked(goal_idx) {
        Blocked::Free => {}
        Blocked::Obstacle => return Err(NoPath::GoalAtObstacle),
        Blocked::Zone(zone_idx) => return Err(NoPath::GoalInZone { zone_idx }),
    }
    let mut field = Field::new(map, goal_cell);
    field.search(start_cell).ok_or(NoPath::Closed)?;
    let mut path = vec![goal];
    let mut cell = field.before(goal_cell);
    while cell != start_cell && goal_cell != start_cell {
        path.push(layout.centre(cell));
        cell = field.before(cell);
    }
    path.push(start);
    path.reverse();
    Ok(path)
}

/// The eight steps, as columns and rows: straight ones first, each diagonal after the two that it lies between.
const STEPS: [(isize, isize); 8] = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];
/// Of each diagonal, the two straight steps beside it.
const BESIDE: [[usize; 2]; 4] = [[0, 2], [0, 3], [1, 2], [1, 3]];
/// No way leads to a cell yet.
const NO_STEP: u8 = u8::MAX;

/// What a search knows of each cell. With a border of solid cells around the map, so that every cell has eight
/// neighbours.
struct Field {
    /// Cells of a row, the border's with it.
    stride: usize,
    /// Cost of a cell's length in each: below 0 in inflated areas, which are only ever left; infinite where solid.
    weights: Vec<f32>,
    /// Cost of the cheapest way known, cells.
    costs: Vec<f32>,
    /// The last step of it.
    steps: Vec<u8>,
    goal: usize,
}

impl Field {
    fn new(map: &Costmap, goal: Cell) -> Self {
        let shape = map.layout().shape;
        let stride = shape.n_cols + 2;
        let n_cells = stride * (shape.n_rows + 2);
        let mut weights = vec![f32::INFINITY; n_cells];
        for row in 0..shape.n_rows {
            let (first, begin) = (row * shape.n_cols, (row + 1) * stride + 1);
            for (idx, weight) in (first..).zip(&mut weights[begin..begin + shape.n_cols]) {
                *weight = match map.blocked(idx) {
                    _ if map.is_solid(idx) => f32::INFINITY,
                    Blocked::Free => 1.0 + map.extra_cost(idx),
                    Blocked::Obstacle | Blocked::Zone(_) => -(1.0 + LEAVING_COST),
                };
            }
        }
        let (costs, steps) = (vec![f32::INFINITY; n_cells], vec![NO_STEP; n_cells]);
        let goal = (goal.row + 1) * stride + goal.col + 1;
        Field { stride, weights, costs, steps, goal }
    }

    fn position(&self, cell: Cell) -> usize {
        (cell.row + 1) * self.stride + cell.col + 1
    }

    /// The cell before one on the cheapest way to it; itself at the beginning.
    fn before(&self, cell: Cell) -> Cell {
        match STEPS.get(usize::from(self.steps[self.position(cell)])) {
            Some((dx, dy)) => {
                Cell { col: cell.col.wrapping_add_signed(-dx), row: cell.row.wrapping_add_signed(-dy) }
            }
            None => cell,
        }
    }

    /// Finds the cheapest way to the goal; `None` when there is none.
    fn search(&mut self, start: Cell) -> Option<()> {
        let stride = self.stride as u32;
        let ways = STEPS.map(|(dx, dy)| dy * self.stride as isize + dx);
        let goal = [(self.goal % self.stride) as f32, (self.goal / self.stride) as f32];
        let mut open = Buckets::new();
        let start = self.position(start);
        self.costs[start] = 0.0;
        open.push(0.0, Open { position: start as u32, cost: 0.0 });
        while let Some(Open { position, cost }) = open.pop(self.costs[self.goal]) {
            let here = position as usize;
            if cost > self.costs[here] {
                continue;
            }
            let is_free = self.weights[here] > 0.0;
            let (mut around, mut is_way) = ([0.0_f32; 8], [false; 8]);
            for ((weight, is_way), way) in around.iter_mut().zip(&mut is_way).zip(ways) {
                *weight = self.weights[here.wrapping_add_signed(way)];
                // Out of an inflated area, never into one.
                *is_way = (weight.abs() < f32::INFINITY) & (!is_free | (*weight > 0.0));
            }
            let (col, row) = (position % stride, position / stride);
            for (nth, way) in ways.into_iter().enumerate() {
                let is_diagonal = nth >= 4;
                let length = if is_diagonal { std::f32::consts::SQRT_2 } else { 1.0 };
                let next = here.wrapping_add_signed(way);
                let cost = cost + length * around[nth].abs();
                // Most are reached as cheaply already.
                if cost >= self.costs[next] || !is_way[nth] {
                    continue;
                }
                if !is_diagonal || BESIDE[nth - 4].into_iter().all(|beside| is_way[beside]) {
                    self.costs[next] = cost;
                    self.steps[next] = nth as u8;
                    let (dx, dy) = STEPS[nth];
                    let off_col = ((col as i32 + dx as i32) as f32 - goal[0]).abs();
                    let off_row = ((row as i32 + dy as i32) as f32 - goal[1]).abs();
                    open.push(cost + octile(off_col, off_row), Open { position: next as u32, cost });
                }
            }
        }
        self.costs[self.goal].is_finite().then_some(())
    }
}

/// Length of the shortest way over eight neighbours to a cell so many columns and rows off, cells.
fn octile(off_col: f32, off_row: f32) -> f32 {
    off_col.max(off_row) + (std::f32::consts::SQRT_2 - 1.0) * off_col.min(off_row)
}

/// A cell to be looked at, and what the way to it cost.
#[derive(Clone, Copy)]
struct Open {
    position: u32,
    cost: f32,
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
    entries: Vec<(Open, u32)>,
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

    fn push(&mut self, whole_cost: f32, open: Open) {
        // Too early is only looked at too early.
        let bucket = ((whole_cost * BUCKETS_PER_CELL) as usize).clamp(self.at, self.at + N_BUCKETS - 1);
        let last = &mut self.last[bucket % N_BUCKETS];
        self.entries.push((open, std::mem::replace(last, self.entries.len() as u32)));
        self.n_open += 1;
    }

    /// One of the cheapest; `None` when no way over any could be cheaper than `enough`.
    fn pop(&mut self, enough: f32) -> Option<Open> {
        while self.n_open > 0 && self.at as f32 / BUCKETS_PER_CELL < enough {
            let last = &mut self.last[self.at % N_BUCKETS];
            if let Some((open, before)) = self.entries.get(*last as usize) {
                *last = *before;
                self.n_open -= 1;
                return Some(*open);
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
    use mapping::{Grid, Layout, Occupancy, Shape};
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
                for (dx, dy) in STEPS {
                    if let Some((next, cost)) = step_cost(map, cell, (dx, dy)) {
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
    fn step_cost(map: &Costmap, cell: Cell, (dx, dy): (isize, isize)) -> Option<(Cell, f32)> {
        let layout = map.layout();
        let at = |dx: isize, dy: isize| {
            let col = cell.col.checked_add_signed(dx).filter(|col| *col < layout.shape.n_cols)?;
            let row = cell.row.checked_add_signed(dy).filter(|row| *row < layout.shape.n_rows)?;
            Some(Cell { col, row })
        };
        let is_free = |cell: Cell| map.blocked(layout.index(cell)) == Blocked::Free;
        let is_open = |side: Option<Cell>| {
            side.is_some_and(|side| !map.is_solid(layout.index(side)) && (!is_free(cell) || is_free(side)))
        };
        let next = at(dx, dy).filter(|_| is_open(at(dx, dy)))?;
        if dx != 0 && dy != 0 && !(is_open(at(dx, 0)) && is_open(at(0, dy))) {
            return None;
        }
        let weight = 1.0 + if is_free(next) { map.extra_cost(layout.index(next)) } else { LEAVING_COST };
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
