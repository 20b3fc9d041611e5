//! The shortest path over a costmap: A* on eight neighbours, in arrays.
//!
//! A start within an inflated area may leave it, over cells with nothing in them, at a high cost; nothing
//! else may enter one. Diagonals do not cut corners. Deliberately not here: following the path (`tracker`).

use std::cmp::Reverse;
use std::collections::BinaryHeap;

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
    let parents = search(map, start_cell, goal_cell).ok_or(NoPath::Closed)?;
    let mut path = vec![goal];
    let mut idx = parents[goal_idx] as usize;
    while idx != start_idx && goal_idx != start_idx {
        path.push(layout.centre(cell_of(map, idx)));
        idx = parents[idx] as usize;
    }
    path.push(start);
    path.reverse();
    Ok(path)
}

/// Fills the parent of each cell reached, by row-major position; `None` when the goal is not.
fn search(map: &Costmap, start: Cell, goal: Cell) -> Option<Vec<u32>> {
    let layout = map.layout();
    let n_cells = layout.shape.n_cells();
    let mut costs = vec![f32::INFINITY; n_cells];
    let mut parents = vec![u32::MAX; n_cells];
    let mut queue = BinaryHeap::with_capacity(1024);
    let (start_idx, goal_idx) = (layout.index(start), layout.index(goal));
    costs[start_idx] = 0.0;
    parents[start_idx] = start_idx as u32;
    queue.push((Reverse(0), start_idx as u32));
    while let Some((Reverse(rank), idx)) = queue.pop() {
        let idx = idx as usize;
        if idx == goal_idx {
            return Some(parents);
        }
        let cell = cell_of(map, idx);
        if rank > rank_of(costs[idx] + octile(cell, goal)) {
            continue;
        }
        for (next, length) in neighbours(map, cell) {
            let next_idx = layout.index(next);
            let is_free = map.blocked(next_idx) == Blocked::Free;
            // Out of an inflated area, never into one.
            if map.is_solid(next_idx) || (!is_free && map.blocked(idx) == Blocked::Free) {
                continue;
            }
            let weight = 1.0 + if is_free { map.extra_cost(next_idx) } else { LEAVING_COST };
            let cost = costs[idx] + length * weight;
            if cost < costs[next_idx] {
                costs[next_idx] = cost;
                parents[next_idx] = idx as u32;
                queue.push((Reverse(rank_of(cost + octile(next, goal))), next_idx as u32));
            }
        }
    }
    None
}

/// Whole numbers have an order; a thousandth of a cell is fine enough.
fn rank_of(cost_cells: f32) -> u64 {
    (f64::from(cost_cells) * 1000.0) as u64
}

/// Length of the shortest way over eight neighbours, cells.
fn octile(a: Cell, b: Cell) -> f32 {
    let (dx, dy) = (a.col.abs_diff(b.col) as f32, a.row.abs_diff(b.row) as f32);
    dx.max(dy) + (std::f32::consts::SQRT_2 - 1.0) * dx.min(dy)
}

fn cell_of(map: &Costmap, idx: usize) -> Cell {
    let n_cols = map.layout().shape.n_cols;
    Cell { col: idx % n_cols, row: idx / n_cols }
}

/// The neighbours inside the grid with their distance in cells; diagonals only between two that are passable.
fn neighbours(map: &Costmap, cell: Cell) -> impl Iterator<Item = (Cell, f32)> + '_ {
    const DIRECTIONS: [(isize, isize); 8] =
        [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)];
    let here_is_free = map.blocked(map.layout().index(cell)) == Blocked::Free;
    let at = move |dx: isize, dy: isize| {
        let shape = map.layout().shape;
        let col = cell.col.checked_add_signed(dx).filter(|col| *col < shape.n_cols)?;
        let row = cell.row.checked_add_signed(dy).filter(|row| *row < shape.n_rows)?;
        Some(Cell { col, row })
    };
    let passable = move |side: Option<Cell>| {
        side.is_some_and(|side| {
            let idx = map.layout().index(side);
            if here_is_free { map.blocked(idx) == Blocked::Free } else { !map.is_solid(idx) }
        })
    };
    DIRECTIONS.into_iter().filter_map(move |(dx, dy)| {
        let next = at(dx, dy)?;
        let straight = dx == 0 || dy == 0;
        let open = straight || (passable(at(dx, 0)) && passable(at(0, dy)));
        open.then_some((next, if straight { 1.0 } else { std::f32::consts::SQRT_2 }))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::Profile;
    use mapping::{Grid, Layout, Occupancy, Shape};

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
}
