//! What lies behind the seen side of a thing and is not known to be free.
//!
//! From in front nobody can tell how deep a cupboard is. Until something else has looked behind it (the LiDAR sees
//! all around, the camera only ahead), the ground next to its far side counts as its own: a limit near it then holds
//! along its whole depth, and what turns out to be free floor falls away again. Not here: what is seen of the thing
//! itself, and regions that begin at its far edge.

use geometry::Point2;
use nalgebra::Vector2;

use crate::grid::{Cell, Grid, GridError, Layout, Occupancy};
use crate::morphology::groups;

/// Farthest that a thing is thought to reach behind what is seen of it, metres: a bed or a crib seen from its end is
/// deeper, but then the LiDAR sees its sides. Chosen: beyond it a wall seen from one side would be half a room deep.
const DEPTH_M_MAX: f64 = 1.2;
/// The map and what was seen of the thing may be so many cells apart.
const N_GRACE: usize = 2;
/// This many times as long as broad (as standard deviations), and it is a face: its depth lies square to it.
const ELONGATION_MIN: f64 = 3.0;

/// Where the unseen part of a thing is looked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hidden {
    /// Straight behind what was seen, from its front as deep as that is broad: a vase is not a cupboard.
    Behind,
    /// Beside it too, wherever nobody has looked yet: something nearer may hide a part of it. Too much for a region
    /// that the robot has to get past, and right for one in which it is only slower.
    Around,
}

/// The footprint, and what of `base` behind it is not known to be free, up to 1.2 m.
///
/// `base` is the LiDAR's grid; `seen_from_map` where the footprint was seen from; cells with gaps up to `join_m` are of
/// one thing. Cells outside `base` count as free: nothing is known of them, and nobody can go there either.
/// All in `map`. The result has the footprint's resolution and lies on multiples of it.
///
/// # Errors
/// [`GridError`] when the result were too large for a grid.
pub fn with_hidden(
    footprint: &Grid<bool>,
    base: &Grid<Occupancy>,
    seen_from_map: Point2,
    join_m: f64,
    hidden: Hidden,
) -> Result<Grid<bool>, GridError> {
    let layout = *footprint.layout();
    let reach = Vector2::repeat(DEPTH_M_MAX + layout.resolution_m);
    let wide = Layout::covering(layout.origin - reach, layout.far_corner() + reach, layout.resolution_m)?;
    let mut result = Grid::filled(wide, false);
    for cell in layout.cells().filter(|&cell| *footprint.get(cell)) {
        mark(&mut result, layout.centre(cell));
    }
    for group in groups(footprint, join_m) {
        let cells: Vec<Point2> = group.iter().map(|&cell: &Cell| layout.centre(cell)).collect();
        let Some(away) = direction(&cells, seen_from_map) else { continue };
        let depth_m = match hidden {
            Hidden::Behind => breadth_m(&cells, away).min(DEPTH_M_MAX),
            Hidden::Around => DEPTH_M_MAX,
        };
        // From the front: what is seen of a round or slanting thing is a part of its depth already.
        let along = |cell: &Point2| cell.coords.dot(&away);
        let front_m = cells.iter().map(along).fold(f64::INFINITY, f64::min);
        for cell in &cells {
            let seen_m = if hidden == Hidden::Behind { along(cell) - front_m } else { 0.0 };
            mark_behind(&mut result, base, *cell, away * (depth_m - seen_m).max(0.0));
        }
    }
    if hidden == Hidden::Around {
        mark_unseen_around(&mut result, base);
    }
    Ok(result)
}

/// Marks cells that were never seen and that a chain of such cells joins to marked ones, up to the same distance.
fn mark_unseen_around(result: &mut Grid<bool>, base: &Grid<Occupancy>) {
    let layout = *result.layout();
    let is_unseen = |cell: Cell| {
        base.layout().cell_at(layout.centre(cell)).is_some_and(|c| *base.get(c) == Occupancy::Unknown)
    };
    let mut border: Vec<Cell> = layout.cells().filter(|&cell| *result.get(cell)).collect();
    for _ in 0..(DEPTH_M_MAX / layout.resolution_m) as usize {
        let mut next = Vec::new();
        for cell in border {
            for step in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                let Some(cell) = layout.shape.beside(cell, step) else { continue };
                if !*result.get(cell) && is_unseen(cell) {
                    result.set(cell, true);
                    next.push(cell);
                }
            }
        }
        border = next;
    }
}

fn mark(grid: &mut Grid<bool>, at: Point2) {
    if let Some(cell) = grid.layout().cell_at(at) {
        grid.set(cell, true);
    }
}

/// How broad cells are across a direction, metres.
fn breadth_m(cells: &[Point2], along: Vector2<f64>) -> f64 {
    let across = cells.iter().map(|p| p.coords.perp(&along));
    let (low, high) = across.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), m| (l.min(m), h.max(m)));
    (high - low).max(0.0)
}

/// Marks from a seen cell on, over all of `depth`, until floor that is known to be free.
fn mark_behind(result: &mut Grid<bool>, base: &Grid<Occupancy>, seen: Point2, depth: Vector2<f64>) {
    // Half a cell at a time, so that a slanting line leaves no cell out.
    let n_steps = (2.0 * depth.norm() / result.layout().resolution_m) as usize;
    for k in 1..=n_steps {
        let at = seen + depth * (k as f64 / n_steps as f64);
        let is_hidden = base.layout().cell_at(at).is_some_and(|cell| *base.get(cell) != Occupancy::Free);
        if is_hidden {
            mark(result, at);
        } else if k > 2 * N_GRACE {
            return;
        }
    }
}

/// Unit vector from the viewer through a thing: square to it if it is a face, else from its middle on.
fn direction(cells: &[Point2], seen_from: Point2) -> Option<Vector2<f64>> {
    let sum = cells.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords);
    let middle = Point2::from(sum / cells.len().max(1) as f64);
    let view = (middle - seen_from).try_normalize(0.01)?;
    let spread: nalgebra::Matrix2<f64> = cells.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
    let axes = spread.symmetric_eigen();
    let (long, short) = if axes.eigenvalues[0] >= axes.eigenvalues[1] { (0, 1) } else { (1, 0) };
    if axes.eigenvalues[long] <= ELONGATION_MIN.powi(2) * axes.eigenvalues[short].max(1e-9) {
        return Some(view);
    }
    let across: Vector2<f64> = axes.eigenvectors.column(short).into_owned();
    Some(if across.dot(&view) >= 0.0 { across } else { -across })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CELL_M: f64 = 0.05;

    fn grid<T: Clone>(low: Point2, high: Point2, value: impl Fn(Point2) -> T) -> Grid<T> {
        let layout = Layout::covering(low, high, CELL_M).unwrap();
        Grid::from_values(layout, layout.cells().map(|cell| value(layout.centre(cell))).collect()).unwrap()
    }

    /// A box of this depth, its face from (0, -0.6) to (0, 0.6) seen from (-2, 0), on a floor that the LiDAR knows.
    fn found(depth_m: f64, hidden: Hidden, is_known: impl Fn(Point2) -> bool) -> Grid<bool> {
        let face = grid(Point2::new(-0.2, -0.8), Point2::new(0.2, 0.8), |p| {
            (0.0..0.05).contains(&p.x) && p.y.abs() < 0.6
        });
        let base = grid(Point2::new(-3.0, -3.0), Point2::new(4.0, 3.0), |p| {
            let is_inside = (0.0..depth_m).contains(&p.x) && p.y.abs() < 0.6;
            if is_inside || !is_known(p) { Occupancy::Unknown } else { Occupancy::Free }
        });
        with_hidden(&face, &base, Point2::new(-2.0, 0.0), 0.25, hidden).unwrap()
    }

    fn holds(grid: &Grid<bool>, x: f64, y: f64) -> bool {
        grid.layout().cell_at(Point2::new(x, y)).is_some_and(|cell| *grid.get(cell))
    }

    proptest! {
        #[test]
        fn a_thing_is_as_deep_as_the_ground_behind_its_face_is_unknown(
            depth_m in 0.3..1.1_f64, y in -0.5..0.5_f64, is_around in any::<bool>(),
        ) {
            let hidden = if is_around { Hidden::Around } else { Hidden::Behind };
            let found = found(depth_m, hidden, |_| true);
            prop_assert!(holds(&found, 0.01, y) && holds(&found, depth_m - 0.08, y));
            prop_assert!(!holds(&found, depth_m + 0.08, y), "beyond its far side");
        }

        #[test]
        fn what_is_known_to_be_free_is_never_marked(
            depth_m in 0.0..1.1_f64, x in -0.9..2.0_f64, y in -1.5..1.5_f64, is_around in any::<bool>(),
        ) {
            let hidden = if is_around { Hidden::Around } else { Hidden::Behind };
            let found = found(depth_m, hidden, |_| true);
            let is_free = x < -0.08 || x > depth_m.max(0.06) + 0.08 || y.abs() > 0.68;
            prop_assert!(!(is_free && holds(&found, x, y)));
        }
    }

    #[test]
    fn where_nothing_is_known_the_depth_is_limited_and_no_wider_than_the_face() {
        let found = found(0.5, Hidden::Behind, |p| p.x < 0.0);
        assert!(holds(&found, 1.1, 0.0) && !holds(&found, 1.35, 0.0));
        assert!(!holds(&found, 0.5, 0.75) && !holds(&found, -0.15, 0.0));
    }

    #[test]
    fn what_something_nearer_hides_may_be_a_part_of_the_thing() {
        // Nobody has seen the ground beyond y = 0.5.
        let beside = |hidden| holds(&found(0.5, hidden, |p| p.y < 0.5), 0.02, 1.2);
        assert!(beside(Hidden::Around) && !beside(Hidden::Behind));
    }

    #[test]
    fn nothing_hides_behind_what_the_lidar_sees_through() {
        // A table top: the scan passes between its legs.
        let seen = found(0.0, Hidden::Around, |_| true);
        let n = seen.values().iter().filter(|on| **on).count();
        assert_eq!(n, 24, "the face itself: 1.2 m of 5 cm cells");
    }
}
