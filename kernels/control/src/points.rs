//! Exact distance to the nearest of a few hundred points, cheap enough for every sample of a rollout.
//!
//! Rasterising scan hits would cost half a cell of clearance, which narrow passages do not have. Instead a
//! grid around the robot lists, for each cell, the points that can be nearest to any place in it: a few. A
//! cell's list is made when it is first asked for, from that of the coarse cell around it; a tick visits a
//! few hundred.

use std::cell::RefCell;
use std::ops::Range;

use geometry::Point2;

use crate::fast::Isa;

mod nearest;

use nearest::{Apart, Candidates, N_BLOCK, Nearest, least};

/// Side of a cell, metres: small enough for short lists, large enough for few cells.
const CELL_M: f64 = 0.1;
/// Cells along one side of a coarse cell.
const N_COARSE: usize = 4;
/// Most cells along one side.
const N_SIDE_MAX: usize = 160;
/// Cells and coarse cells along one side that lists are kept of: who lies so far apart shares its place.
const N_KEPT: [usize; 2] = [64, 16];
/// So many places in lists there is room for from the beginning.
const N_LISTED: usize = 2048;
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
    /// Apart, so that a scene moves little.
    lists: Box<RefCell<Lists>>,
}

/// Points in whole blocks, filled up with [`NOWHERE_M`]: first all of them, then one list after the other.
#[derive(Debug, Default)]
struct Lists {
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    /// Where the lists begin.
    n_all: usize,
    /// Squared distances to the centre of the cell under work, and who is a candidate.
    square_m2: Vec<f64>,
    is_candidate: Vec<u8>,
    /// Which use of the index a list is of.
    turn: u32,
    fine: Vec<Kept>,
    coarse: Vec<Kept>,
}

/// Where the list of a cell is kept, and which cell's it is.
#[derive(Clone, Copy, Debug, Default)]
struct Kept {
    turn: u32,
    cell: [u16; 2],
    from: u32,
    to: u32,
}

impl Default for PointIndex {
    fn default() -> Self {
        PointIndex::on(Isa::detect())
    }
}

impl PointIndex {
    /// An index of nothing, with room for some hundred points and their lists.
    pub(crate) fn on(isa: Isa) -> PointIndex {
        let mut lists = Lists::default();
        lists.make_room();
        PointIndex { isa, low: Point2::origin(), n_side: 0, reach_m: 0.0, lists: Box::new(lists.into()) }
    }

    /// Makes it an index of those finite points within `reach_m` of `centre` that belong to it; `false` when
    /// there are none.
    pub(crate) fn fill(
        &mut self,
        points: &[Point2],
        belongs: impl Fn(&Point2) -> bool,
        centre: Point2,
        reach_m: f64,
    ) -> bool {
        let lists = self.lists.get_mut();
        // A point left out is farther than the reach from every place within it, and no distance above the
        // reach is ever reported: none is too large.
        if lists.take(self.isa, points, belongs, centre, 2.0 * reach_m) == 0 {
            return false;
        }
        self.n_side = ((2.0 * reach_m / CELL_M).ceil() as usize + 1).clamp(1, N_SIDE_MAX);
        let half_m = self.n_side as f64 * CELL_M / 2.0;
        self.low = Point2::new(centre.x - half_m, centre.y - half_m);
        self.reach_m = reach_m;
        lists.begin();
        true
    }

    /// Distance to the nearest point, metres, at most the reach; exact for places within the reach.
    #[inline]
    pub(crate) fn distance_m(&self, place: Point2) -> f64 {
        let mut lists = self.lists.borrow_mut();
        let range = self.cell(place).map_or(0..lists.n_all, |cell| lists.of_cell(self.isa, self.low, cell));
        self.least_m(&lists, range, place)
    }

    /// The same by looking at every point: cheaper where no other place nearby is asked for.
    pub(crate) fn distance_by_all_m(&self, place: Point2) -> f64 {
        let lists = self.lists.borrow();
        self.least_m(&lists, 0..lists.n_all, place)
    }

    #[inline]
    fn least_m(&self, lists: &Lists, range: Range<usize>, place: Point2) -> f64 {
        let (x_m, y_m) = (&lists.x_m[range.clone()], &lists.y_m[range]);
        least(self.isa.run(Nearest { x_m, y_m, place }).sqrt(), self.reach_m)
    }

    /// Calls `take` with points around a place, about `n` of them and evenly out of those that can be nearest
    /// there.
    pub(crate) fn for_each_near(&self, place: Point2, n: usize, mut take: impl FnMut(Point2)) {
        let mut lists = self.lists.borrow_mut();
        let Some(cell) = self.cell(place) else { return };
        let range = lists.of_cell(self.isa, self.low, cell);
        let every = range.len().div_ceil(n.max(1)).max(1);
        for at in range.step_by(every).filter(|at| lists.x_m[*at] < NOWHERE_M) {
            take(Point2::new(lists.x_m[at], lists.y_m[at]));
        }
    }

    /// Column and row of a place's cell.
    #[inline]
    fn cell(&self, place: Point2) -> Option<[usize; 2]> {
        let (x, y) = ((place.x - self.low.x) / CELL_M, (place.y - self.low.y) / CELL_M);
        let side = self.n_side as f64;
        (x >= 0.0 && y >= 0.0 && x < side && y < side).then_some([x as usize, y as usize])
    }
}

impl Lists {
    /// Takes those points within `far_m` of a centre that belong; how many.
    fn take(
        &mut self,
        isa: Isa,
        points: &[Point2],
        belongs: impl Fn(&Point2) -> bool,
        centre: Point2,
        far_m: f64,
    ) -> usize {
        self.x_m.resize(points.len(), NOWHERE_M);
        self.y_m.resize(points.len(), NOWHERE_M);
        let (x_m, y_m) = (&mut self.x_m[..points.len()], &mut self.y_m[..points.len()]);
        let square_m2 = far_m * far_m;
        // Nearly always all are near, and belong.
        let all_near = isa.run(Apart { points, x_m, y_m, centre, square_m2 });
        if all_near && points.iter().all(&belongs) {
            return points.len();
        }
        let is_taken = |point: &Point2| (point - centre).norm_squared() <= square_m2 && belongs(point);
        let mut n = 0;
        for point in points.iter().filter(|point| is_taken(point)) {
            (x_m[n], y_m[n]) = (point.x, point.y);
            n += 1;
        }
        self.x_m.truncate(n);
        self.y_m.truncate(n);
        n
    }

    /// Begins another use, on the points that are there.
    fn begin(&mut self) {
        self.fill_up();
        self.n_all = self.x_m.len();
        self.square_m2.resize(self.n_all, 0.0);
        self.is_candidate.resize(self.n_all, 0);
        self.turn = self.turn.wrapping_add(1);
        if self.turn == 0 {
            // After four billion uses an old list could look new.
            self.fine.clear();
            self.coarse.clear();
            self.turn = 1;
        }
        self.make_room();
    }

    fn make_room(&mut self) {
        self.fine.resize(N_KEPT[0] * N_KEPT[0], Kept::default());
        self.coarse.resize(N_KEPT[1] * N_KEPT[1], Kept::default());
        for list in [&mut self.x_m, &mut self.y_m] {
            list.reserve(N_LISTED.saturating_sub(list.len()));
        }
    }

    /// What can be nearest in a cell, by its column and row.
    #[inline]
    fn of_cell(&mut self, isa: Isa, low: Point2, [col, row]: [usize; 2]) -> Range<usize> {
        let slot = (row % N_KEPT[0]) * N_KEPT[0] + col % N_KEPT[0];
        let cell = [col as u16, row as u16];
        match self.fine.get(slot) {
            Some(kept) if kept.turn == self.turn && kept.cell == cell => kept.from as usize..kept.to as usize,
            _ => self.list_cell(isa, low, [col, row]),
        }
    }

    #[inline(never)]
    fn list_cell(&mut self, isa: Isa, low: Point2, [col, row]: [usize; 2]) -> Range<usize> {
        let [coarse_col, coarse_row] = [col / N_COARSE, row / N_COARSE];
        let slot = (coarse_row % N_KEPT[1]) * N_KEPT[1] + coarse_col % N_KEPT[1];
        let cell = [coarse_col as u16, coarse_row as u16];
        let kept = self.coarse[slot];
        let around = if kept.turn == self.turn && kept.cell == cell {
            kept.from as usize..kept.to as usize
        } else {
            let side_m = CELL_M * N_COARSE as f64;
            let range = self.list(isa, 0..self.n_all, centre(low, [coarse_col, coarse_row], side_m), side_m);
            self.coarse[slot] =
                Kept { turn: self.turn, cell, from: range.start as u32, to: range.end as u32 };
            range
        };
        let range = self.list(isa, around, centre(low, [col, row], CELL_M), CELL_M);
        let slot = (row % N_KEPT[0]) * N_KEPT[0] + col % N_KEPT[0];
        let cell = [col as u16, row as u16];
        self.fine[slot] = Kept { turn: self.turn, cell, from: range.start as u32, to: range.end as u32 };
        range
    }

    /// Lists which of some points can be nearest anywhere in the square of `side_m` around `centre`.
    fn list(&mut self, isa: Isa, of: Range<usize>, centre: Point2, side_m: f64) -> Range<usize> {
        let n = of.len();
        let (square_m2, is_candidate) = (&mut self.square_m2[..n], &mut self.is_candidate[..n]);
        let (x_m, y_m) = (&self.x_m[of.clone()], &self.y_m[of.clone()]);
        let n_candidates = isa.run(Candidates { x_m, y_m, square_m2, is_candidate, centre, side_m });
        let (from, mut to) = (self.x_m.len(), self.x_m.len());
        // Room for one more: who is written and is no candidate is written over.
        self.x_m.resize(from + n_candidates + 1, NOWHERE_M);
        self.y_m.resize(from + n_candidates + 1, NOWHERE_M);
        for (block, flags) in self.is_candidate[..n].as_chunks::<N_BLOCK>().0.iter().enumerate() {
            if u64::from_ne_bytes(*flags) == 0 {
                continue;
            }
            for (at, flag) in (of.start + block * N_BLOCK..).zip(flags) {
                (self.x_m[to], self.y_m[to]) = (self.x_m[at], self.y_m[at]);
                to += usize::from(*flag);
            }
        }
        self.x_m.truncate(to);
        self.y_m.truncate(to);
        self.fill_up();
        from..self.x_m.len()
    }

    /// Fills the last block up.
    fn fill_up(&mut self) {
        let n_padded = self.x_m.len().next_multiple_of(N_BLOCK);
        self.x_m.resize(n_padded, NOWHERE_M);
        self.y_m.resize(n_padded, NOWHERE_M);
    }
}

fn centre(low: Point2, [col, row]: [usize; 2], side_m: f64) -> Point2 {
    Point2::new(low.x + (col as f64 + 0.5) * side_m, low.y + (row as f64 + 0.5) * side_m)
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
            let places: Vec<Point2> = places.into_iter().map(|(x, y)| Point2::new(x, y)).collect();
            index.fill(&places, |_| true, Point2::origin(), 10.0);
            index.distance_m(places[0]);
            assert!(index.fill(&points, |_| true, Point2::origin(), 10.0));
            for place in places {
                let slow = points.iter().map(|p| (p - place).norm()).fold(f64::INFINITY, f64::min);
                prop_assert!((index.distance_m(place) - slow.min(10.0)).abs() < 1e-12);
                prop_assert_eq!(index.distance_m(place), index.distance_by_all_m(place));
            }
        }
    }

    #[test]
    fn points_that_are_not_finite_or_far_out_of_reach_are_left_out() {
        let points = [Point2::new(f64::NAN, 0.0), Point2::new(99.0, 0.0)];
        assert!(!PointIndex::default().fill(&points, |_| true, Point2::origin(), 3.0));
    }
}
