//! Exact distance to the nearest of a few hundred points, cheap enough for every sample of a rollout.
//!
//! Rasterising scan hits would cost half a cell of clearance, which narrow passages do not have. Instead a
//! coarse grid around the robot lists, for each cell, the points that can be nearest to any place in it:
//! usually one to three. A cell's list is made when it is first asked for; a tick visits a few hundred.

use std::cell::RefCell;

use geometry::Point2;

use crate::fast::Isa;
use crate::fast::isa::Work;

/// Side of a cell, metres: small enough for short lists, large enough for few cells.
const CELL_M: f64 = 0.1;
/// Most cells along one side.
const N_SIDE_MAX: usize = 160;
/// Points looked at together.
const N_BLOCK: usize = 8;
/// Stands in for no point: farther than any reach.
const NOWHERE_M: f64 = 1e9;

/// The points within reach, with lazily made lists of candidates.
///
/// Used again for another scan it allocates only what it has not needed before.
#[derive(Debug)]
pub(crate) struct PointIndex {
    isa: Isa,
    low: Point2,
    n_side: usize,
    reach_m: f64,
    lists: RefCell<Lists>,
}

#[derive(Debug, Default)]
struct Lists {
    /// Places of the points, padded with [`NOWHERE_M`] to whole blocks.
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    /// Squared distances to the centre of the cell under work.
    square_m2: Vec<f64>,
    /// Which use of the index a range is of.
    turn: u32,
    /// For each cell when it was made and the range of its candidates.
    ranges: Vec<(u32, u32, u32)>,
    /// Candidates of all cells, each cell's padded to whole blocks.
    candidate_x_m: Vec<f64>,
    candidate_y_m: Vec<f64>,
}

impl Default for PointIndex {
    fn default() -> Self {
        PointIndex::on(Isa::detect())
    }
}

impl PointIndex {
    /// An index of nothing.
    pub(crate) fn on(isa: Isa) -> PointIndex {
        PointIndex { isa, low: Point2::origin(), n_side: 0, reach_m: 0.0, lists: RefCell::default() }
    }

    /// Makes it an index of the finite points within `reach_m` of `centre`; `false` when there are none.
    pub(crate) fn fill(
        &mut self,
        points: impl Iterator<Item = Point2>,
        centre: Point2,
        reach_m: f64,
    ) -> bool {
        let lists = self.lists.get_mut();
        lists.x_m.clear();
        lists.y_m.clear();
        // A point left out is farther than the reach from every place within it, and no distance above the
        // reach is ever reported: none is too large.
        for point in points.filter(|p| (p - centre).norm_squared() <= 4.0 * reach_m * reach_m) {
            lists.x_m.push(point.x);
            lists.y_m.push(point.y);
        }
        if lists.x_m.is_empty() {
            return false;
        }
        let n_padded = lists.x_m.len().next_multiple_of(N_BLOCK);
        for of in [&mut lists.x_m, &mut lists.y_m, &mut lists.square_m2] {
            of.resize(n_padded, NOWHERE_M);
        }
        self.n_side = ((2.0 * reach_m / CELL_M).ceil() as usize + 1).clamp(1, N_SIDE_MAX);
        let half_m = self.n_side as f64 * CELL_M / 2.0;
        self.low = Point2::new(centre.x - half_m, centre.y - half_m);
        self.reach_m = reach_m;
        lists.candidate_x_m.clear();
        lists.candidate_y_m.clear();
        lists.turn = lists.turn.wrapping_add(1);
        if lists.turn == 0 {
            // After four billion uses an old range could look new.
            lists.ranges.clear();
            lists.turn = 1;
        }
        lists.ranges.resize(self.n_side * self.n_side, (0, 0, 0));
        true
    }

    /// Distance to the nearest point, metres, at most the reach; exact for places within the reach.
    pub(crate) fn distance_m(&self, place: Point2) -> f64 {
        let (x, y) = ((place.x - self.low.x) / CELL_M, (place.y - self.low.y) / CELL_M);
        let side = self.n_side as f64;
        let mut lists = self.lists.borrow_mut();
        if !(x >= 0.0 && y >= 0.0 && x < side && y < side) {
            return lists.distances_from(self.isa, place).sqrt().min(self.reach_m);
        }
        let (col, row) = (x as usize, y as usize);
        let cell_idx = row * self.n_side + col;
        let (made, mut from, mut to) = lists.ranges[cell_idx];
        if made != lists.turn {
            let centre = self.low + Point2::new(col as f64 + 0.5, row as f64 + 0.5).coords * CELL_M;
            (from, to) = lists.list(self.isa, centre);
            lists.ranges[cell_idx] = (lists.turn, from, to);
        }
        let Lists { candidate_x_m, candidate_y_m, square_m2, .. } = &mut *lists;
        let range = from as usize..to as usize;
        let (x_m, y_m) = (&candidate_x_m[range.clone()], &candidate_y_m[range]);
        self.isa.run(Distances { x_m, y_m, square_m2, place }).sqrt().min(self.reach_m)
    }
}

impl Lists {
    /// Lists what can be nearest anywhere in the cell around `centre`: a point farther than the nearest by
    /// more than a diagonal cannot.
    fn list(&mut self, isa: Isa, centre: Point2) -> (u32, u32) {
        let nearest_m = self.distances_from(isa, centre).sqrt();
        let limit_m = nearest_m + CELL_M * std::f64::consts::SQRT_2 + 1e-9;
        let limit_m2 = limit_m * limit_m;
        let from = self.candidate_x_m.len() as u32;
        for (block, square_m2) in self.square_m2.chunks_exact(N_BLOCK).enumerate() {
            if square_m2.iter().fold(0, |any, d| any | u32::from(*d <= limit_m2)) == 0 {
                continue;
            }
            for (k, _) in square_m2.iter().enumerate().filter(|(_, d)| **d <= limit_m2) {
                let at = block * N_BLOCK + k;
                self.candidate_x_m.push(self.x_m[at]);
                self.candidate_y_m.push(self.y_m[at]);
            }
        }
        let n_padded = self.candidate_x_m.len().next_multiple_of(N_BLOCK);
        self.candidate_x_m.resize(n_padded, NOWHERE_M);
        self.candidate_y_m.resize(n_padded, NOWHERE_M);
        (from, n_padded as u32)
    }

    /// Notes the squared distance of every point from a place; the smallest, m².
    fn distances_from(&mut self, isa: Isa, place: Point2) -> f64 {
        isa.run(Distances { x_m: &self.x_m, y_m: &self.y_m, square_m2: &mut self.square_m2, place })
    }
}

/// The squared distances of all points from a place, and the smallest.
struct Distances<'a> {
    x_m: &'a [f64],
    y_m: &'a [f64],
    square_m2: &'a mut [f64],
    place: Point2,
}

impl Work for Distances<'_> {
    type Output = f64;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f64 {
        let mut least_m2 = [f64::INFINITY; N_BLOCK];
        let points = self.x_m.chunks_exact(N_BLOCK).zip(self.y_m.chunks_exact(N_BLOCK));
        for ((x_m, y_m), square_m2) in points.zip(self.square_m2.chunks_exact_mut(N_BLOCK)) {
            for k in 0..N_BLOCK {
                let (dx, dy) = (x_m[k] - self.place.x, y_m[k] - self.place.y);
                let square = dx * dx + dy * dy;
                square_m2[k] = square;
                least_m2[k] = if square < least_m2[k] { square } else { least_m2[k] };
            }
        }
        least_m2.into_iter().fold(f64::INFINITY, f64::min)
    }
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
            let mut index = PointIndex::default();
            // What a former scan left must not count.
            index.fill(places.iter().map(|&(x, y)| Point2::new(x, y)), Point2::origin(), 10.0);
            index.distance_m(Point2::new(places[0].0, places[0].1));
            assert!(index.fill(points.iter().copied(), Point2::origin(), 10.0));
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
        assert!(!PointIndex::default().fill(points.into_iter(), Point2::origin(), 3.0));
    }
}
