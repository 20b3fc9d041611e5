//! What two faces of a box say of its far side.
//!
//! Of a cupboard or a crib only the faces towards the robot are ever seen, and a region that ends at them lets
//! a limit go too early. Two faces at a right angle whose edge points at the viewer are the near half of a box:
//! the rest of its rectangle belongs to it. Not here: things of which one face is seen (their depth is
//! anybody's guess), round things wider than 1.2 m (the square around a smaller one is hardly larger), and corners seen from within, as of shelves along two walls.

use geometry::Point2;
use nalgebra::{Unit, Vector2};

/// Directions tried for the faces, over a quarter turn: a degree apart, 3 cm on a side of 2 m.
const N_DIRECTIONS: usize = 90;
/// Points within so many cells of a side are on it: the width of a surface in a TSDF.
const ON_SIDE_CELLS: f64 = 1.5;
/// At least this share of the points must be on the sides.
const SHARE_ON_SIDES: f64 = 0.85;
/// Farther from all sides than so many cells is far.
const FAR_OFF_CELLS: f64 = 4.0;
/// A side is seen when points are on this share of it; of a half circle's it is less.
const SHARE_OF_SIDE: f64 = 0.75;
/// Sides of a box, metres: shorter ones closing fills, longer ones are of more than one thing.
const SIDE_M: std::ops::RangeInclusive<f64> = 0.2..=4.0;

/// The upright rectangle of a box, turned about the vertical.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rectangle {
    along: Unit<Vector2<f64>>,
    /// Ends along `along` and across it (to the left), metres from the origin of `map`.
    low: Vector2<f64>,
    high: Vector2<f64>,
}

impl Rectangle {
    /// The box whose two near faces these points are, seen from `seen_from`; `None` when they are not.
    ///
    /// Points are centres of the cells of one object, `resolution_m` apart. Costs 90 looks at each point.
    pub(super) fn behind(points: &[Point2], seen_from: Point2, resolution_m: f64) -> Option<Rectangle> {
        let on_side_m = ON_SIDE_CELLS * resolution_m;
        // The direction in which the points lie nearest to the sides; what is far off says nothing more.
        let nearest_m = |rectangle: &Rectangle, p: &Point2| {
            rectangle.gaps_m(*p).into_iter().fold(FAR_OFF_CELLS * resolution_m, f64::min)
        };
        let (rectangle, _) = (0..N_DIRECTIONS)
            .filter_map(|k| {
                let angle_rad = std::f64::consts::FRAC_PI_2 * k as f64 / N_DIRECTIONS as f64;
                let rectangle = Rectangle::around(points, angle_rad)?;
                Some((rectangle, points.iter().map(|p| nearest_m(&rectangle, p)).sum::<f64>()))
            })
            .min_by(|(_, a), (_, b)| a.total_cmp(b))?;
        let n_on = points.iter().filter(|p| nearest_m(&rectangle, p) <= on_side_m).count();
        let sides = rectangle.high - rectangle.low;
        let is_box = sides.iter().all(|side| SIDE_M.contains(side))
            && n_on as f64 >= SHARE_ON_SIDES * points.len() as f64;
        if !is_box || rectangle.holds(seen_from) {
            return None;
        }
        let seen = rectangle.sides_seen(points, on_side_m, resolution_m);
        let corners = rectangle.corners();
        // Corner k lies between sides k and k + 1, in the order of `gaps_m`.
        let points_at_viewer = |k: &usize| {
            let opposite = corners[(k + 2) % 4];
            (corners[*k] - seen_from).norm() < (opposite - seen_from).norm()
        };
        (0..4).filter(|k| seen[*k] && seen[(k + 1) % 4]).find(points_at_viewer).map(|_| {
            // Points are centres: their cells reach half a cell farther.
            let half = Vector2::repeat(resolution_m / 2.0);
            Rectangle { low: rectangle.low - half, high: rectangle.high + half, ..rectangle }
        })
    }

    fn around(points: &[Point2], angle_rad: f64) -> Option<Rectangle> {
        let along = Unit::new_unchecked(Vector2::new(angle_rad.cos(), angle_rad.sin()));
        let mut rectangle = Rectangle { along, low: Vector2::zeros(), high: Vector2::zeros() };
        let first = rectangle.place(*points.first()?);
        (rectangle.low, rectangle.high) = (first, first);
        for point in points {
            let place = rectangle.place(*point);
            (rectangle.low, rectangle.high) = (rectangle.low.inf(&place), rectangle.high.sup(&place));
        }
        Some(rectangle)
    }

    /// A point along and across.
    fn place(&self, point: Point2) -> Vector2<f64> {
        let (x, y) = (self.along.x, self.along.y);
        Vector2::new(point.x * x + point.y * y, point.y * x - point.x * y)
    }

    /// Distances of a point inside to the lines of the four sides, counter-clockwise from the low end across.
    fn gaps_m(&self, point: Point2) -> [f64; 4] {
        let place = self.place(point);
        let (from, to) = (place - self.low, self.high - place);
        [from.y, to.x, to.y, from.x]
    }

    /// The corners: the k-th lies between the sides k and k + 1 of `gaps_m`.
    pub(super) fn corners(&self) -> [Point2; 4] {
        let (low, high) = (self.low, self.high);
        let corner = |a: f64, b: f64| {
            let (x, y) = (self.along.x, self.along.y);
            Point2::new(a * x - b * y, a * y + b * x)
        };
        [corner(high.x, low.y), corner(high.x, high.y), corner(low.x, high.y), corner(low.x, low.y)]
    }

    /// Whether a point lies in it, border included.
    pub(super) fn holds(&self, point: Point2) -> bool {
        self.gaps_m(point).into_iter().all(|gap| gap >= 0.0)
    }

    fn sides_seen(&self, points: &[Point2], on_side_m: f64, resolution_m: f64) -> [bool; 4] {
        let sides = self.high - self.low;
        let n_bins = |length_m: f64| (length_m / (2.0 * resolution_m)).ceil().max(1.0) as usize;
        let mut bins = [sides.x, sides.y, sides.x, sides.y].map(|length_m| vec![false; n_bins(length_m)]);
        for point in points {
            let along = self.place(*point) - self.low;
            for (k, gap_m) in self.gaps_m(*point).into_iter().enumerate() {
                let (at_m, length_m) = if k % 2 == 0 { (along.x, sides.x) } else { (along.y, sides.y) };
                let n = bins[k].len();
                let bin = ((at_m / length_m * n as f64) as usize).min(n - 1);
                bins[k][bin] |= gap_m <= on_side_m;
            }
        }
        bins.map(|side| side.iter().filter(|seen| **seen).count() as f64 >= SHARE_OF_SIDE * side.len() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CELL_M: f64 = 0.05;

    /// The centres of the cells that a path of straight lines touches.
    fn cells(path: &[Point2]) -> Vec<Point2> {
        let mut found: Vec<(i64, i64)> = path
            .windows(2)
            .flat_map(|ends| (0..=400).map(|k| ends[0] + (ends[1] - ends[0]) * f64::from(k) / 400.0))
            .map(|p| ((p.x / CELL_M).floor() as i64, (p.y / CELL_M).floor() as i64))
            .collect();
        found.sort_unstable();
        found.dedup();
        found.iter().map(|(x, y)| Point2::new(*x as f64 + 0.5, *y as f64 + 0.5) * CELL_M).collect()
    }

    fn turned(point: Point2, yaw_rad: f64) -> Point2 {
        nalgebra::Rotation2::new(yaw_rad) * point
    }

    proptest! {
        #[test]
        fn two_near_faces_tell_the_whole_box_and_the_same_corner_from_within_nothing(
            length_m in 0.4..2.5_f64, width_m in 0.4..1.5_f64, yaw_rad in -3.0..3.0_f64,
            (away_x, away_y) in (0.3..3.0_f64, 0.3..3.0_f64),
        ) {
            let corner = |x: f64, y: f64| turned(Point2::new(x, y), yaw_rad);
            let faces = cells(&[corner(length_m, 0.0), corner(0.0, 0.0), corner(0.0, width_m)]);
            let found = Rectangle::behind(&faces, corner(-away_x, -away_y), CELL_M);
            prop_assert!(found.is_some(), "not found");
            let found = found.unwrap();
            for (k, l) in (0..20).flat_map(|k| (0..20).map(move |l| (k, l))) {
                let share = |k: i32, side_m: f64| 0.15 + (side_m - 0.3) * f64::from(k) / 19.0;
                prop_assert!(found.holds(corner(share(k, length_m), share(l, width_m))));
            }
            let area_m2 = (found.high - found.low).product();
            prop_assert!(area_m2 < (length_m + 0.2) * (width_m + 0.2), "{area_m2} m²");
            prop_assert!(Rectangle::behind(&faces, corner(length_m / 2.0, width_m / 2.0), CELL_M).is_none());
            prop_assert!(Rectangle::behind(&faces, corner(length_m + away_x, width_m + away_y), CELL_M).is_none());
        }

        #[test]
        fn one_face_and_half_a_wide_column_are_no_box(radius_m in 0.6..1.2_f64, yaw_rad in -3.0..3.0_f64) {
            let eye = turned(Point2::new(-4.0, 0.3), yaw_rad);
            let face = [Point2::new(0.0, -radius_m), Point2::new(0.0, radius_m)];
            prop_assert!(Rectangle::behind(&cells(&face.map(|p| turned(p, yaw_rad))), eye, CELL_M).is_none());
            let arc: Vec<Point2> = (0..=60)
                .map(|k| std::f64::consts::FRAC_PI_2 + std::f64::consts::PI * f64::from(k) / 60.0)
                .map(|a| turned(Point2::new(radius_m * a.cos(), radius_m * a.sin()), yaw_rad))
                .collect();
            prop_assert!(Rectangle::behind(&cells(&arc), eye, CELL_M).is_none());
        }
    }

    #[test]
    fn no_points_are_no_box() {
        assert!(Rectangle::behind(&[], Point2::origin(), CELL_M).is_none());
    }
}
