//! Simple polygons, convex or not, to triangles, by cutting ears.
//!
//! Quadratic, which is enough for outlines of some hundred corners. Not for polygons with holes.

use geometry::{Point2, Point3};

/// The corners do not bound a simple polygon.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("outline of {n_corners} corners crosses itself or has no area")]
pub struct NotSimple {
    /// Number of corners.
    pub n_corners: usize,
}

fn cross(a: Point2, b: Point2, c: Point2) -> f64 {
    (b - a).perp(&(c - a))
}

/// Twice the signed area, m²; positive when the corners run counter-clockwise.
fn doubled_area_m2(corners: &[Point2]) -> f64 {
    let following = corners.iter().cycle().skip(1);
    corners.iter().zip(following).map(|(a, b)| a.x * b.y - b.x * a.y).sum()
}

/// Triangles that cover a simple polygon, as indices into `corners`, counter-clockwise.
///
/// Either winding of `corners` is taken; corners on a straight line are allowed.
///
/// # Errors
/// [`NotSimple`] when no ear is left to cut.
pub fn outline(corners: &[Point2]) -> Result<Vec<[u32; 3]>, NotSimple> {
    let not_simple = NotSimple { n_corners: corners.len() };
    let area_m2 = doubled_area_m2(corners);
    if corners.len() < 3 || area_m2.abs() < 1e-12 {
        return Err(not_simple);
    }
    let mut left: Vec<usize> = (0..corners.len()).collect();
    if area_m2 < 0.0 {
        left.reverse();
    }
    // A flat corner is an ear without area: it is dropped and makes no triangle.
    let tiny_m2 = area_m2.abs() * 1e-12;
    let mut triangles = Vec::with_capacity(corners.len() - 2);
    while left.len() > 3 {
        let Some((at, flat)) = next_ear(corners, &left, tiny_m2) else { return Err(not_simple) };
        if !flat {
            triangles.push(corner_triple(&left, at));
        }
        left.remove(at);
    }
    triangles.push(corner_triple(&left, 1));
    let covered_m2: f64 = triangles.iter().map(|t| triangle_area_m2(corners, *t)).sum();
    if (covered_m2 - area_m2.abs()).abs() > 1e-6 * area_m2.abs() {
        return Err(not_simple);
    }
    Ok(triangles)
}

fn triangle_area_m2(corners: &[Point2], triangle: [u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|idx| corners.get(idx as usize).copied().unwrap_or_default());
    cross(a, b, c).abs()
}

fn corner_triple(left: &[usize], at: usize) -> [u32; 3] {
    let n = left.len();
    [left[(at + n - 1) % n] as u32, left[at] as u32, left[(at + 1) % n] as u32]
}

/// Position in `left` of a corner that can be cut off, and whether it is flat.
fn next_ear(corners: &[Point2], left: &[usize], tiny_m2: f64) -> Option<(usize, bool)> {
    let n = left.len();
    (0..n).find_map(|at| {
        let [a, b, c] = corner_triple(left, at).map(|idx| corners[idx as usize]);
        let turn_m2 = cross(a, b, c);
        if turn_m2.abs() <= tiny_m2 {
            return Some((at, true));
        }
        let blocks = |idx: &usize| {
            let p = corners[*idx];
            p != a
                && p != b
                && p != c
                && cross(a, b, p) >= 0.0
                && cross(b, c, p) >= 0.0
                && cross(c, a, p) >= 0.0
        };
        (turn_m2 > 0.0 && !left.iter().any(blocks)).then_some((at, false))
    })
}

/// Triangles of a flat face in space, as indices into `corners`; a face that is not simple becomes a fan.
#[must_use]
pub fn face(corners: &[Point3]) -> Vec<[u32; 3]> {
    let n = corners.len() as u32;
    let fan = || (1..n.saturating_sub(1)).map(|idx| [0, idx, idx + 1]).collect();
    if n <= 3 {
        return fan();
    }
    // Newell's normal; the face is laid flat by dropping its longest part.
    let following = corners.iter().cycle().skip(1);
    let normal = corners.iter().zip(following).fold(nalgebra::Vector3::zeros(), |sum, (a, b)| {
        sum + nalgebra::Vector3::new(
            (a.y - b.y) * (a.z + b.z),
            (a.z - b.z) * (a.x + b.x),
            (a.x - b.x) * (a.y + b.y),
        )
    });
    let flat: Vec<Point2> = match normal.iamax() {
        0 => corners.iter().map(|p| Point2::new(p.y, p.z)).collect(),
        1 => corners.iter().map(|p| Point2::new(p.z, p.x)).collect(),
        _ => corners.iter().map(|p| Point2::new(p.x, p.y)).collect(),
    };
    outline(&flat).unwrap_or_else(|_| fan())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(list: &[(f64, f64)]) -> Vec<Point2> {
        list.iter().map(|&(x, y)| Point2::new(x, y)).collect()
    }

    #[track_caller]
    fn check_covers(corners: &[Point2]) {
        let triangles = outline(corners).unwrap();
        let covered: f64 = triangles.iter().map(|t| triangle_area_m2(corners, *t)).sum();
        assert!((covered - doubled_area_m2(corners).abs()).abs() < 1e-9);
    }

    #[test]
    fn shapes_that_are_not_convex_are_covered_without_overlap_in_either_winding() {
        let ell = points(&[(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)]);
        check_covers(&ell);
        check_covers(&ell.into_iter().rev().collect::<Vec<_>>());
        check_covers(&points(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 2.0), (1.0, 0.5), (0.0, 2.0)]));
    }

    #[test]
    fn an_outline_that_crosses_itself_or_is_flat_is_refused() {
        assert!(outline(&points(&[(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 1.0)])).is_err());
        assert!(outline(&points(&[(0.0, 0.0), (1.0, 1.0), (2.0, 2.0)])).is_err());
        assert!(outline(&points(&[(0.0, 0.0), (1.0, 1.0)])).is_err());
    }

    proptest! {
        #[test]
        fn star_shaped_outlines_are_covered(radii in prop::collection::vec(0.2..3.0_f64, 3..40)) {
            let n = radii.len() as f64;
            let at = |(k, r): (usize, &f64)| {
                let angle = k as f64 / n * std::f64::consts::TAU;
                Point2::new(r * angle.cos(), r * angle.sin())
            };
            check_covers(&radii.iter().enumerate().map(at).collect::<Vec<_>>());
        }
    }
}
