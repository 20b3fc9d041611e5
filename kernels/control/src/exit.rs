//! The way out of a zone: distance to its exit along floor that the robot fits on.
//!
//! Straight-line distance to the border deadlocks between walls; a flood from every place outside, over the
//! cells that the hull fits on, does not. Local, around the robot, and kept for some ticks by its owner.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use geometry::Point2;

use crate::scene::Scene;

/// Cells along one side of the flood.
const N_SIDE: usize = 161;
/// Sides of a cell tried, metres: the second when no exit lies within the first's 4 m.
const CELLS_M: [f64; 2] = [0.05, 0.1];
/// How far outside every zone a place must be to count as an exit, metres.
const CLEAR_M: f64 = 0.02;

/// Distance to the nearest exit, metres, for every cell around the robot.
#[derive(Clone, Debug)]
pub(crate) struct ExitMap {
    low: Point2,
    cell_m: f64,
    distance_m: Vec<f32>,
}

impl ExitMap {
    /// Floods from the exits around the start of a scene; `None` when none can be reached from there.
    ///
    /// Zones that the robot is not in are walls, unless the scene calls them soft.
    pub(crate) fn around(scene: &Scene<'_>) -> Option<ExitMap> {
        CELLS_M.into_iter().find_map(|cell_m| {
            let map = ExitMap::flood(scene, cell_m);
            map.distance_m(scene.start.position()).is_finite().then_some(map)
        })
    }

    fn flood(scene: &Scene<'_>, cell_m: f64) -> ExitMap {
        let centre = scene.start.position();
        let half_m = N_SIDE as f64 * cell_m / 2.0;
        let low = Point2::new(centre.x - half_m, centre.y - half_m);
        let position_m = scene.assumptions.disturbance.position_m;
        let mut free = vec![false; N_SIDE * N_SIDE];
        let mut distance_m = vec![f32::INFINITY; N_SIDE * N_SIDE];
        let mut queue = BinaryHeap::new();
        for (idx, free) in free.iter_mut().enumerate() {
            let place =
                low + Point2::new((idx % N_SIDE) as f64 + 0.5, (idx / N_SIDE) as f64 + 0.5).coords * cell_m;
            let mut soft_m = f64::INFINITY;
            *free = scene.spatial.iter().all(|layer| {
                let margin_m = layer.margin_m(place, 0.0);
                if layer.soft {
                    soft_m = soft_m.min(margin_m);
                    return true;
                }
                margin_m > position_m
            });
            if *free && soft_m > position_m + CLEAR_M {
                distance_m[idx] = 0.0;
                queue.push((Reverse(0), idx));
            }
        }
        // Dijkstra in micrometres: whole numbers have an order.
        while let Some((Reverse(micro), idx)) = queue.pop() {
            if micro as f32 > distance_m[idx] * 1e6 + 1.0 {
                continue;
            }
            for (next, step) in neighbours(idx) {
                let there = micro + (step * cell_m * 1e6) as u64;
                if free[next] && (there as f32) < distance_m[next] * 1e6 {
                    distance_m[next] = there as f32 * 1e-6;
                    queue.push((Reverse(there), next));
                }
            }
        }
        ExitMap { low, cell_m, distance_m }
    }

    /// Distance to the exit from a place, metres; infinite when there is no way or the place is off the map.
    pub(crate) fn distance_m(&self, place: Point2) -> f64 {
        let (x, y) = ((place.x - self.low.x) / self.cell_m - 0.5, (place.y - self.low.y) / self.cell_m - 0.5);
        let side = N_SIDE as f64;
        if !(x > -1.0 && y > -1.0 && x < side && y < side) {
            return f64::INFINITY;
        }
        let mut nearest_m = f64::INFINITY;
        // The robot may stand in a cell that is not free by a hair: look around it.
        for row in (y.floor() as i64 - 1)..=(y.floor() as i64 + 2) {
            for col in (x.floor() as i64 - 1)..=(x.floor() as i64 + 2) {
                if (0..N_SIDE as i64).contains(&row) && (0..N_SIDE as i64).contains(&col) {
                    let there_m = f64::from(self.distance_m[row as usize * N_SIDE + col as usize]);
                    let here_m = (x - col as f64).hypot(y - row as f64) * self.cell_m;
                    nearest_m = nearest_m.min(there_m + here_m);
                }
            }
        }
        nearest_m
    }

    /// The place reached after `length_m` of the shortest way out from a place; the exit when it is nearer.
    pub(crate) fn along_way_out(&self, from: Point2, length_m: f64) -> Option<Point2> {
        let (x, y) = ((from.x - self.low.x) / self.cell_m, (from.y - self.low.y) / self.cell_m);
        let side = N_SIDE as f64;
        if !(x >= 1.0 && y >= 1.0 && x < side - 1.0 && y < side - 1.0) {
            return None;
        }
        let cell_idx = y as usize * N_SIDE + x as usize;
        let around = neighbours(cell_idx).map(|(idx, _)| idx).chain([cell_idx]);
        let mut idx = around.min_by(|a, b| self.distance_m[*a].total_cmp(&self.distance_m[*b]))?;
        let end_m = f64::from(self.distance_m[idx]) - length_m;
        while f64::from(self.distance_m[idx]) > end_m.max(0.0) {
            let down = neighbours(idx).map(|(next, _)| next);
            let next = down.min_by(|a, b| self.distance_m[*a].total_cmp(&self.distance_m[*b]))?;
            if self.distance_m[next] >= self.distance_m[idx] {
                break;
            }
            idx = next;
        }
        let cell = Point2::new((idx % N_SIDE) as f64 + 0.5, (idx / N_SIDE) as f64 + 0.5);
        Some(self.low + cell.coords * self.cell_m)
    }
}

fn neighbours(idx: usize) -> impl Iterator<Item = (usize, f64)> {
    let (col, row) = ((idx % N_SIDE) as i64, (idx / N_SIDE) as i64);
    let diagonal = std::f64::consts::SQRT_2;
    [(1, 0, 1.0), (-1, 0, 1.0), (0, 1, 1.0), (0, -1, 1.0)]
        .into_iter()
        .chain([(1, 1, diagonal), (1, -1, diagonal), (-1, 1, diagonal), (-1, -1, diagonal)])
        .filter_map(move |(dx, dy, step)| {
            let (x, y) = (col + dx, row + dy);
            let inside = (0..N_SIDE as i64).contains(&x) && (0..N_SIDE as i64).contains(&y);
            inside.then(|| (y as usize * N_SIDE + x as usize, step))
        })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use geometry::Profile;
    use mapping::{DistanceField, Layout, Shape};

    use super::*;
    use crate::config::Disturbance;
    use crate::dynamics::{Limits, State};
    use crate::margin::{BaseLayer, Demand, RuleLayer, World};
    use crate::scene::Assumptions;

    fn field(distance_m: impl Fn(Point2) -> f64) -> Arc<DistanceField> {
        let layout = Layout::new(Point2::new(-5.0, -5.0), 0.05, Shape { n_cols: 200, n_rows: 200 }).unwrap();
        let values = layout.cells().map(|cell| distance_m(layout.centre(cell)) as f32).collect();
        Arc::new(DistanceField::from_values(layout, values).unwrap())
    }

    /// Distance to the box around (x, y) with half sides (hx, hy).
    fn to_box(place: Point2, (x, y): (f64, f64), (hx, hy): (f64, f64)) -> f64 {
        let (dx, dy) = ((place.x - x).abs() - hx, (place.y - y).abs() - hy);
        dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0)
    }

    fn around(world: &World) -> Option<ExitMap> {
        let disturbance = Disturbance { position_m: 0.0, yaw_rad: 0.0, speed_m_s: 0.0, delay_s: 0.0 };
        let limits = Limits::of(&Profile::sim());
        let assumptions = Assumptions {
            limits,
            radius_m: 0.25,
            step_s: 0.05,
            disturbance,
            closing_speed_m_s: 0.0,
            braking_tail: true,
        };
        ExitMap::around(&Scene::of(world, State::default(), assumptions, &|_| false))
    }

    fn world(walls: impl Fn(Point2) -> f64, zones: &[(f64, f64, f64)]) -> World {
        let rules = zones.iter().map(|&(x, y, half)| RuleLayer {
            id: "s1".into(),
            label: "it".into(),
            demand: Demand::Exclusion {
                zone: field(move |p| to_box(p, (x, y), (half, half))),
                buffer_m: 0.0,
            },
        });
        let base = vec![BaseLayer { name: "the map".into(), field: field(walls) }];
        World { base, points: vec![], rules: rules.collect() }
    }

    #[test]
    fn in_the_open_the_exit_is_straight_ahead() {
        let map = around(&world(|_| 9.0, &[(0.3, 0.0, 0.8)])).unwrap();
        // From 0 to the border at -0.5, and the hull beyond it.
        assert!((map.distance_m(Point2::origin()) - 0.77).abs() < 0.08);
        let ahead = map.along_way_out(Point2::origin(), 0.4).unwrap();
        assert!((ahead.x + 0.4).abs() < 0.1 && ahead.y.abs() < 0.1, "{ahead:?}");
    }

    #[test]
    fn between_walls_the_way_out_goes_around_them() {
        // A wall beside the nearest border: the way leads over its end.
        let walls = |p: Point2| to_box(p, (-0.5, 0.0), (0.1, 0.8));
        let map = around(&world(walls, &[(0.0, 0.0, 1.0)])).unwrap();
        assert!(map.distance_m(Point2::origin()) > 1.2);
        assert!(map.distance_m(Point2::new(-2.0, 0.0)) < 0.1, "outside the zone is the exit");
    }

    #[test]
    fn who_is_walled_in_has_no_exit() {
        let walls = |p: Point2| -to_box(p, (0.0, 0.0), (0.6, 0.6));
        assert!(around(&world(walls, &[(0.0, 0.0, 1.0)])).is_none());
    }

    #[test]
    fn a_zone_that_the_robot_is_not_in_is_no_way_out() {
        // The second zone begins where the hull's margin to it is still positive.
        let both = world(|_| 9.0, &[(0.0, 0.0, 0.5), (-1.1, 0.0, 0.8)]);
        let open = world(|_| 9.0, &[(0.0, 0.0, 0.5)]);
        let west = Point2::new(-0.75, 0.0);
        assert!(around(&open).unwrap().distance_m(west) < 0.1);
        assert!(around(&both).unwrap().distance_m(west) > 0.3);
    }
}
