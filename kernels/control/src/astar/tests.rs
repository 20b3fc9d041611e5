//! Laws of the planner's search: ways go around what stands, none is cheaper, and what cannot be reached is named.

use super::*;
use crate::costmap::STEPS;
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
    let field = mapping::DistanceField::from_values(*grid.layout(), vec![0.4; grid.values().len()]).unwrap();
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
