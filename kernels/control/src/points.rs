//! Exact distance to the nearest of a few hundred points, cheap enough for every sample of a rollout.
//!
//! Rasterising scan hits would cost half a cell of clearance, which narrow passages do not have. Instead a
//! coarse grid around the robot lists, for each cell, the points that can be nearest to any place in it:
//! usually one to three. A cell's list is made when it is first asked for; a tick visits a few hundred.

use std::cell::RefCell;

use geometry::Point2;

/// Side of a cell, metres: small enough for short lists, large enough for few cells.
const CELL_M: f64 = 0.1;
/// Most cells along one side.
const N_SIDE_MAX: usize = 160;

/// The points within reach, with lazily made lists of candidates.
#[derive(Debug)]
pub(crate) struct PointIndex {
    points: Vec<Point2>,
    low: Point2,
    n_side: usize,
    reach_m: f64,
    lists: RefCell<Lists>,
}

#[derive(Debug)]
struct Lists {
    /// For each cell the range of its candidates, `None` until asked for.
    ranges: Vec<Option<(u32, u32)>>,
    candidates: Vec<Point2>,
}

impl PointIndex {
    /// An index of the finite points within `reach_m` of `centre`. `None` when there are none.
    pub(crate) fn around(
        points: impl Iterator<Item = Point2>,
        centre: Point2,
        reach_m: f64,
    ) -> Option<PointIndex> {
        // A point left out is farther than the reach from every place within it, and no distance above the
        // reach is ever reported: none is too large.
        let points: Vec<Point2> = points.filter(|p| (p - centre).norm() <= 2.0 * reach_m).collect();
        if points.is_empty() {
            return None;
        }
        let n_side = ((2.0 * reach_m / CELL_M).ceil() as usize + 1).clamp(1, N_SIDE_MAX);
        let half_m = n_side as f64 * CELL_M / 2.0;
        let ranges = vec![None; n_side * n_side];
        let lists = RefCell::new(Lists { ranges, candidates: Vec::with_capacity(1024) });
        let low = Point2::new(centre.x - half_m, centre.y - half_m);
        Some(PointIndex { points, low, n_side, reach_m, lists })
    }

    /// Distance to the nearest point, metres, at most the reach; exact for places within the reach.
    pub(crate) fn distance_m(&self, place: Point2) -> f64 {
        let (x, y) = ((place.x - self.low.x) / CELL_M, (place.y - self.low.y) / CELL_M);
        let side = self.n_side as f64;
        if !(x >= 0.0 && y >= 0.0 && x < side && y < side) {
            return nearest_m(&self.points, place).min(self.reach_m);
        }
        let (col, row) = (x as usize, y as usize);
        let mut lists = self.lists.borrow_mut();
        let cell_idx = row * self.n_side + col;
        let (from, to) = match lists.ranges[cell_idx] {
            Some(range) => range,
            None => {
                let centre = self.low + Point2::new(col as f64 + 0.5, row as f64 + 0.5).coords * CELL_M;
                let range = lists.fill(&self.points, centre);
                lists.ranges[cell_idx] = Some(range);
                range
            }
        };
        nearest_m(&lists.candidates[from as usize..to as usize], place).min(self.reach_m)
    }
}

impl Lists {
    /// Lists what can be nearest anywhere in the cell around `centre`: a point farther than the nearest by
    /// more than a diagonal cannot.
    fn fill(&mut self, points: &[Point2], centre: Point2) -> (u32, u32) {
        let limit_m = nearest_m(points, centre) + CELL_M * std::f64::consts::SQRT_2 + 1e-9;
        let from = self.candidates.len() as u32;
        self.candidates.extend(points.iter().filter(|p| (*p - centre).norm_squared() <= limit_m * limit_m));
        (from, self.candidates.len() as u32)
    }
}

fn nearest_m(points: &[Point2], place: Point2) -> f64 {
    points.iter().map(|p| (p - place).norm_squared()).fold(f64::INFINITY, f64::min).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_index_agrees_with_looking_at_every_point(
            raw in prop::collection::vec((-5.0..5.0_f64, -5.0..5.0_f64), 1..80),
            places in prop::collection::vec((-4.0..4.0_f64, -4.0..4.0_f64), 1..20),
        ) {
            let points: Vec<Point2> = raw.iter().map(|&(x, y)| Point2::new(x, y)).collect();
            let index = PointIndex::around(points.iter().copied(), Point2::origin(), 10.0).unwrap();
            for (x, y) in places {
                let place = Point2::new(x, y);
                let slow = points.iter().map(|p| (p - place).norm()).fold(f64::INFINITY, f64::min);
                prop_assert!((index.distance_m(place) - slow.min(10.0)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn points_that_are_not_finite_or_far_out_of_reach_are_left_out() {
        let points = [Point2::new(f64::NAN, 0.0), Point2::new(99.0, 0.0)];
        assert!(PointIndex::around(points.into_iter(), Point2::origin(), 3.0).is_none());
    }
}
