//! One plan: from maps and regions to a path. Slow work, done beside the loop.

use std::sync::Arc;

use control::{Costmap, NoPath, shortest_path};
use geometry::{Point2, Profile};
use mapping::{Cell, DistanceField, Grid, GridError, Layout, Occupancy, Shape, signed_distance};
use proto::{BaseMap, CellSet, GridLayout};

/// A region that the path keeps out of.
#[derive(Clone, Debug)]
pub struct KeepOut {
    /// As the operator reads it: "the crib".
    pub label: String,
    /// The region's cells.
    pub region: Arc<CellSet>,
    /// Distance between hull and region, metres.
    pub buffer_m: f64,
}

/// One plan to make.
#[derive(Clone, Debug)]
pub struct PlanJob {
    /// Which goal it is for, by count.
    pub goal_count: u64,
    /// The base map.
    pub base: Arc<BaseMap>,
    /// What the camera saw, if anything.
    pub depth: Option<Arc<CellSet>>,
    /// Regions to keep out of.
    pub keep_out: Vec<KeepOut>,
    /// Where the robot is, in `map`.
    pub start_map: Point2,
    /// Where it wants to be, in `map`.
    pub goal_map: Point2,
    /// Distance to keep between hull and obstacle, metres.
    pub clearance_m: f64,
}

/// A plan that was made.
#[derive(Clone, Debug)]
pub struct PlanReady {
    /// Which goal it is for.
    pub goal_count: u64,
    /// Epoch of the map that it was made on.
    pub map_epoch: u64,
    /// The path and the map it lies on, or why there is none, in words.
    pub path: Result<Path, String>,
}

/// A path, and the map it was planned on.
#[derive(Clone, Debug)]
pub struct Path {
    /// From the robot to the goal, in `map`.
    pub points_map: Vec<Point2>,
    /// Where the robot may be.
    pub costmap: Arc<Costmap>,
}

/// A way under way is kept while it is at most so many times as long as the best one. Chosen: more than what cells make
/// of one and the same way, less than a detour that anybody would notice.
const KEPT_RATIO: f64 = 1.15;

impl Path {
    /// What is left of an older path from `place` on, when it is free on this path's map and hardly longer.
    #[must_use]
    pub fn kept_way(&self, older_map: &[Point2], place: Point2) -> Option<Vec<Point2>> {
        let off_m = |w: &[Point2]| match w {
            [from, to] => geometry::polygon::segment_distance_m(place, *from, *to),
            _ => f64::INFINITY,
        };
        let nearest = older_map.windows(2).enumerate().min_by(|a, b| off_m(a.1).total_cmp(&off_m(b.1)))?;
        let rest = older_map.get(nearest.0 + 1..)?;
        let left: Vec<Point2> = std::iter::once(place).chain(rest.iter().copied()).collect();
        let length_m = |points: &[Point2]| -> f64 {
            points.windows(2).map(|w| if let [from, to] = w { (to - from).norm() } else { 0.0 }).sum()
        };
        let is_free = || {
            left.windows(2)
                .all(|w| if let [from, to] = w { self.costmap.sees(*from, *to, 0.0) } else { false })
        };
        (length_m(&left) <= KEPT_RATIO * length_m(&self.points_map) && is_free()).then_some(left)
    }
}

/// Makes a plan. A few tens of milliseconds for a house.
#[must_use]
pub fn make(job: &PlanJob, profile: &Profile) -> PlanReady {
    PlanReady {
        goal_count: job.goal_count,
        map_epoch: job.base.map_epoch,
        path: costmap(job, profile).map_err(|e| e.to_string()).and_then(|costmap| {
            let found = shortest_path(&costmap, job.start_map, job.goal_map);
            found
                .map(|points_map| Path { points_map, costmap: Arc::new(costmap) })
                .map_err(|no_path| in_words(&no_path, &job.keep_out))
        }),
    }
}

fn in_words(no_path: &NoPath, keep_out: &[KeepOut]) -> String {
    match no_path {
        NoPath::GoalInZone { zone_idx } => {
            let label = keep_out.get(*zone_idx).map_or("a region", |zone| zone.label.as_str());
            format!("a rule keeps the robot from the goal: {label}")
        }
        other => other.to_string(),
    }
}

fn costmap(job: &PlanJob, profile: &Profile) -> Result<Costmap, GridError> {
    let known = layout_of(&job.base.layout)?;
    let (layout, shift) = with_goal(&known, job.goal_map)?;
    let mut base = Grid::filled(layout, Occupancy::Unknown);
    for (cell, value) in known.cells().zip(&job.base.cells) {
        let value = match value {
            1 => Occupancy::Free,
            2 => Occupancy::Occupied,
            _ => Occupancy::Unknown,
        };
        base.set(Cell { col: cell.col + shift.col, row: cell.row + shift.row }, value);
    }
    if let Some(depth) = &job.depth {
        mark(depth, &layout, |cell| base.set(cell, Occupancy::Occupied));
    }
    let fields: Vec<DistanceField> = job.keep_out.iter().map(|zone| field_of(zone, layout)).collect();
    let zones: Vec<(&DistanceField, f64)> =
        fields.iter().zip(&job.keep_out).map(|(field, zone)| (field, zone.buffer_m)).collect();
    Ok(Costmap::new(&base, &zones, job.clearance_m, profile))
}

/// Room around a goal that lies off the map, metres: the hull's way around whatever stands just before it.
const AROUND_GOAL_M: f64 = 1.0;
/// A goal farther off the map than this is not planned to, metres: the grid would be too large for a plan in time.
const OFF_MAP_M_MAX: f64 = 50.0;

/// The map's layout, grown to the goal, and where the map's first cell lies in it: what was never seen may well be
/// floor, and a goal in the next room must not have to wait for the map to get there.
fn with_goal(known: &Layout, goal_map: Point2) -> Result<(Layout, Cell), GridError> {
    let (low, high) = (known.origin, known.far_corner());
    let beyond_m = |low_m: f64, high_m: f64, goal_m: f64| {
        let is_near = goal_m >= low_m - OFF_MAP_M_MAX && goal_m <= high_m + OFF_MAP_M_MAX;
        let grow_m = |m: f64| if is_near && m > 0.0 { m + AROUND_GOAL_M } else { 0.0 };
        (grow_m(low_m - goal_m), grow_m(goal_m - high_m))
    };
    let n_cells = |m: f64| (m / known.resolution_m).ceil() as usize;
    let (left_m, right_m) = beyond_m(low.x, high.x, goal_map.x);
    let (below_m, above_m) = beyond_m(low.y, high.y, goal_map.y);
    let shift = Cell { col: n_cells(left_m), row: n_cells(below_m) };
    let to_map = Point2::new(shift.col as f64, shift.row as f64).coords * known.resolution_m;
    let shape = Shape {
        n_cols: known.shape.n_cols + shift.col + n_cells(right_m),
        n_rows: known.shape.n_rows + shift.row + n_cells(above_m),
    };
    Ok((Layout::new(low - to_map, known.resolution_m, shape)?, shift))
}

/// Distance to a region, on the grid that is planned on.
fn field_of(zone: &KeepOut, layout: Layout) -> DistanceField {
    let mut cells = Grid::filled(layout, false);
    mark(&zone.region, &layout, |cell| cells.set(cell, true));
    signed_distance(&cells)
}

fn layout_of(wire: &GridLayout) -> Result<Layout, GridError> {
    let shape = Shape { n_cols: wire.n_cols as usize, n_rows: wire.n_rows as usize };
    Layout::new(wire.origin_map, wire.resolution_m, shape)
}

/// Calls `touch` for every cell of `layout` that a cell of the set overlaps.
fn mark(set: &CellSet, layout: &Layout, mut touch: impl FnMut(Cell)) {
    let side_m = set.layout.resolution_m;
    let n_cols = set.layout.n_cols as usize;
    // Cells that only share a border do not overlap.
    let range = |low_m: f64, n_max: usize| {
        let first = (low_m / layout.resolution_m + 1e-6).floor();
        let last = ((low_m + side_m) / layout.resolution_m - 1e-6).floor();
        let is_inside = last >= 0.0 && first < n_max as f64;
        let (first, last) = (first.max(0.0) as usize, last.max(0.0) as usize);
        if is_inside { first..(last + 1).min(n_max) } else { 0..0 }
    };
    for (idx, _) in set.unpack().iter().enumerate().filter(|(_, on)| **on) {
        let low_map = set.layout.origin_map.coords
            + Point2::new((idx % n_cols) as f64, (idx / n_cols) as f64).coords * side_m;
        let low = low_map - layout.origin.coords;
        for row in range(low.y, layout.shape.n_rows) {
            for col in range(low.x, layout.shape.n_cols) {
                touch(Cell { col, row });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_under_way_is_kept_while_it_is_free_and_hardly_longer() {
        let layout = Layout::new(Point2::origin(), 0.05, Shape { n_cols: 100, n_rows: 80 }).unwrap();
        let floor = |wall: bool| {
            let mut grid = Grid::filled(layout, Occupancy::Free);
            for row in 50..70 {
                grid.set(Cell { col: 50, row }, if wall { Occupancy::Occupied } else { Occupancy::Free });
            }
            Arc::new(Costmap::new(&grid, &[], 0.05, &Profile::sim()))
        };
        let point = Point2::new;
        let straight = vec![point(1.0, 2.0), point(4.0, 2.0)];
        let bent = [point(1.0, 2.0), point(2.5, 2.8), point(4.0, 2.0)];
        let check = |wall: bool, older: &[Point2], wanted: bool| {
            let new = Path { points_map: straight.clone(), costmap: floor(wall) };
            assert_eq!(new.kept_way(older, point(1.0, 2.0)).is_some(), wanted);
        };
        check(false, &bent, true);
        check(true, &bent, false);
        check(false, &[point(1.0, 2.0), point(2.5, 3.4), point(4.0, 2.0)], false);
    }

    #[test]
    fn a_goal_off_the_map_is_planned_to_through_what_was_never_seen() {
        let shape = Shape { n_cols: 60, n_rows: 40 };
        let known = Layout::new(Point2::new(-1.0, -1.0), 0.05, shape).unwrap();
        let (wide, shift) = with_goal(&known, Point2::new(4.0, -2.0)).unwrap();
        assert!(wide.cell_at(Point2::new(4.0, -2.0)).is_some());
        let kept =
            wide.centre(Cell { col: shift.col, row: shift.row }) - known.centre(Cell { col: 0, row: 0 });
        assert!(kept.norm() < 1e-9);
        let layout = wire(&known);
        let job = PlanJob {
            goal_count: 1,
            base: Arc::new(BaseMap {
                header: Default::default(),
                map_epoch: 1,
                layout,
                cells: vec![1; 2400],
            }),
            depth: None,
            keep_out: Vec::new(),
            start_map: Point2::origin(),
            goal_map: Point2::new(4.0, -2.0),
            clearance_m: 0.05,
        };
        let path = make(&job, &Profile::sim()).path.unwrap();
        assert!((path.points_map.last().unwrap() - job.goal_map).norm() < 0.05);
        let far = PlanJob { goal_map: Point2::new(400.0, 0.0), ..job };
        assert!(make(&far, &Profile::sim()).path.unwrap_err().contains("off the map"));
    }

    fn wire(layout: &Layout) -> GridLayout {
        GridLayout {
            origin_map: layout.origin,
            resolution_m: layout.resolution_m,
            n_cols: layout.shape.n_cols as u32,
            n_rows: layout.shape.n_rows as u32,
        }
    }

    #[track_caller]
    fn check(origin_x_m: f64, resolution_m: f64, wanted_cols: &[usize]) {
        let origin_map = Point2::new(origin_x_m, 0.0);
        let layout = GridLayout { origin_map, resolution_m, n_cols: 1, n_rows: 1 };
        let set = CellSet::pack(layout, &[true]);
        let shape = Shape { n_cols: 10, n_rows: 1 };
        let mut cols = Vec::new();
        mark(&set, &Layout::new(Point2::origin(), 0.1, shape).unwrap(), |cell| cols.push(cell.col));
        assert_eq!(cols, wanted_cols);
    }

    #[test]
    fn every_cell_that_is_overlapped_is_marked_and_no_neighbour() {
        check(0.2, 0.1, &[2]);
        check(0.25, 0.1, &[2, 3]);
        check(0.25, 0.02, &[2]);
        check(0.2, 0.3, &[2, 3, 4]);
        check(-0.05, 0.1, &[0]);
        check(-0.2, 0.1, &[]);
        check(1.0, 0.1, &[]);
        check(0.95, 0.3, &[9]);
    }
}
