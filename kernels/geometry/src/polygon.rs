//! Simple polygons in the plane: floors, footprints, named places.

use crate::Point2;

/// A simple polygon, at least a triangle; either winding, convex or not, closed implicitly.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize))]
pub struct Polygon {
    corners: Vec<Point2>,
}

/// A list of corners that is no polygon.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PolygonError {
    /// Fewer than three corners, or more than the limit.
    #[error("polygon has {0} corners, must have 3 to 10000")]
    Corners(usize),
    /// A corner that is NaN or infinite.
    #[error("corner {0} of the polygon is not finite")]
    NotFinite(usize),
    /// All corners on one line.
    #[error("polygon has no area")]
    Flat,
}

impl Polygon {
    /// A polygon from its corners, in order.
    ///
    /// # Errors
    /// [`PolygonError`] when the corners enclose nothing or are not finite.
    pub fn new(corners: Vec<Point2>) -> Result<Self, PolygonError> {
        if !(3..=10_000).contains(&corners.len()) {
            return Err(PolygonError::Corners(corners.len()));
        }
        if let Some(idx) = corners.iter().position(|c| !(c.x.is_finite() && c.y.is_finite())) {
            return Err(PolygonError::NotFinite(idx));
        }
        let polygon = Polygon { corners };
        if polygon.signed_area_m2().abs() < 1e-9 {
            return Err(PolygonError::Flat);
        }
        Ok(polygon)
    }

    /// The corners, in order.
    #[must_use]
    pub fn corners(&self) -> &[Point2] {
        &self.corners
    }

    /// The edges as (from, to), the closing one last.
    pub fn edges(&self) -> impl Iterator<Item = (Point2, Point2)> + '_ {
        let following = self.corners.iter().cycle().skip(1);
        self.corners.iter().zip(following).map(|(a, b)| (*a, *b))
    }

    /// Area, m²; positive when the corners run counter-clockwise.
    #[must_use]
    pub fn signed_area_m2(&self) -> f64 {
        self.edges().map(|(a, b)| a.x * b.y - b.x * a.y).sum::<f64>() / 2.0
    }

    /// True inside, by the even-odd rule; a point on an edge may fall either way.
    #[must_use]
    pub fn contains(&self, point: Point2) -> bool {
        let mut inside = false;
        for (a, b) in self.edges() {
            if (a.y > point.y) != (b.y > point.y)
                && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
            {
                inside = !inside;
            }
        }
        inside
    }

    /// Distance to the border, metres: positive outside, negative inside.
    #[must_use]
    pub fn signed_distance_m(&self, point: Point2) -> f64 {
        let border_m =
            self.edges().map(|(a, b)| segment_distance_m(point, a, b)).fold(f64::INFINITY, f64::min);
        if self.contains(point) { -border_m } else { border_m }
    }
}

#[cfg(feature = "serde")]
impl<'de> serde::Deserialize<'de> for Polygon {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(serde::Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Wire {
            corners: Vec<Point2>,
        }
        Polygon::new(Wire::deserialize(deserializer)?.corners).map_err(serde::de::Error::custom)
    }
}

/// Distance from a point to the segment from `a` to `b`, metres.
#[must_use]
pub fn segment_distance_m(point: Point2, a: Point2, b: Point2) -> f64 {
    let along = b - a;
    let share = ((point - a).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
    (point - (a + along * share)).norm()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ell() -> Polygon {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)];
        Polygon::new(corners.iter().map(|&(x, y)| Point2::new(x, y)).collect()).unwrap()
    }

    #[test]
    fn a_polygon_that_is_not_convex_knows_its_inside() {
        assert!(ell().contains(Point2::new(0.5, 1.5)));
        assert!(!ell().contains(Point2::new(1.5, 1.5)));
        assert!((ell().signed_area_m2() - 3.0).abs() < 1e-12);
        assert!((ell().signed_distance_m(Point2::new(1.5, 1.5)) - 0.5).abs() < 1e-12);
        assert!((ell().signed_distance_m(Point2::new(0.5, 0.5)) + 0.5).abs() < 1e-12);
    }

    #[test]
    fn corners_that_enclose_nothing_are_refused() {
        assert_eq!(Polygon::new(vec![Point2::origin(); 2]), Err(PolygonError::Corners(2)));
        assert_eq!(Polygon::new(vec![Point2::origin(); 3]), Err(PolygonError::Flat));
        let nan = vec![Point2::origin(), Point2::new(f64::NAN, 0.0), Point2::new(1.0, 1.0)];
        assert_eq!(Polygon::new(nan), Err(PolygonError::NotFinite(1)));
    }
}
