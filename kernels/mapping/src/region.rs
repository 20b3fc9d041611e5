//! The region that a relation names, from the footprint of its object.
//!
//! Sides are the object's as seen from the anchor, where the robot stood when the rule was accepted. Nothing
//! is guessed: a side without an anchor, or a gap without a second object, is an error.

use geometry::{Point2, Pose2};
use nalgebra::Vector2;

use crate::grid::{Grid, Layout};
use crate::occupancy::{Relation, merge_into};
use between::mark_between;

/// Least reach and breadth of a side, metres.
pub const SIDE_M_MIN: f64 = 1.5;

/// A region that cannot be told.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RegionError {
    /// A side or `beyond` without the pose it is seen from.
    #[error("{0:?} needs the pose at which the rule was accepted")]
    Anchor(Relation),
    /// `between` with one object.
    #[error("between needs a second object")]
    Second,
    /// A footprint without an occupied cell.
    #[error("footprint of the object is empty")]
    Empty,
}

/// The cells of `layout` in the region of `relation` around `footprint`.
///
/// `near`, `on` and `beneath` are the footprint itself (which is already of its relation); `between` is the hull of
/// each thing and the nearest of the other name, less the things; `beyond` is everything past the object's line; a side reaches as far as
/// the object is wide, at least [`SIDE_M_MIN`], and is as broad as the object, at least the same. All in
/// `map`; what lies outside `layout` is left out.
///
/// # Errors
/// [`RegionError`] when a footprint is empty, or the anchor (finite) or second object is missing.
pub fn region(
    relation: Relation,
    footprint: &Grid<bool>,
    footprint2: Option<&Grid<bool>>,
    map_from_anchor: Option<Pose2>,
    layout: Layout,
) -> Result<Grid<bool>, RegionError> {
    let cells = centres(footprint);
    if cells.is_empty() {
        return Err(RegionError::Empty);
    }
    let mut result = Grid::filled(layout, false);
    let anchor = map_from_anchor.filter(Pose2::is_finite).ok_or(RegionError::Anchor(relation));
    match relation {
        Relation::Near | Relation::On | Relation::Beneath => merge_into(&mut result, footprint),
        Relation::Between => {
            let second = footprint2.ok_or(RegionError::Second)?;
            mark_between(&mut result, footprint, second)?;
        }
        Relation::Beyond => mark_beyond(&mut result, &cells, anchor?),
        Relation::LeftOf | Relation::RightOf | Relation::FrontOf | Relation::Behind => {
            Side::new(relation, &cells, anchor?, footprint.layout().resolution_m).mark(&mut result);
        }
    }
    Ok(result)
}

fn centres(grid: &Grid<bool>) -> Vec<Point2> {
    grid.layout().cells().filter(|&c| *grid.get(c)).map(|c| grid.layout().centre(c)).collect()
}

fn mean(points: &[Point2]) -> Point2 {
    let sum = points.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords);
    Point2::from(sum / points.len().max(1) as f64)
}

/// Unit vector from the anchor to a point; the anchor's heading when it stands on it.
fn direction(map_from_anchor: Pose2, to: Point2) -> Vector2<f64> {
    let heading = Vector2::new(map_from_anchor.yaw_rad.cos(), map_from_anchor.yaw_rad.sin());
    (to - map_from_anchor.position()).try_normalize(0.01).unwrap_or(heading)
}

fn left_of(direction: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-direction.y, direction.x)
}

/// Corners of the convex hull, counter-clockwise (Andrew's monotone chain).
pub(crate) fn convex_hull(mut points: Vec<Point2>) -> Vec<Point2> {
    points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let turn = |a: Point2, b: Point2, c: Point2| (b - a).perp(&(c - a));
    let chain = |points: &mut dyn Iterator<Item = Point2>| {
        let mut hull: Vec<Point2> = Vec::new();
        for point in points {
            while let [.., a, b] = hull[..] {
                if turn(a, b, point) > 1e-12 {
                    break;
                }
                hull.pop();
            }
            hull.push(point);
        }
        hull.pop();
        hull
    };
    let mut hull = chain(&mut points.iter().copied());
    hull.extend(chain(&mut points.iter().rev().copied()));
    hull
}

/// How much longer than broad (as standard deviations) an object must be to have a line of its own.
const ELONGATION_MIN: f64 = 2.0;
/// Least sine between that line and the view: a line seen end on has no far side.
const LINE_SINE_MIN: f64 = 0.5;

/// Marks what lies past the line through the object's middle: along the object if it is long and lies across
/// the view (a tape, a doorway, a row of cones), else square to the view.
fn mark_beyond(result: &mut Grid<bool>, cells: &[Point2], map_from_anchor: Pose2) {
    let middle = mean(cells);
    let view = direction(map_from_anchor, middle);
    let spread: nalgebra::Matrix2<f64> = cells.iter().map(|p| (p - middle) * (p - middle).transpose()).sum();
    let axes = spread.symmetric_eigen();
    let (long, short) = if axes.eigenvalues[0] >= axes.eigenvalues[1] { (0, 1) } else { (1, 0) };
    let line: Vector2<f64> = axes.eigenvectors.column(long).into_owned();
    let is_long = axes.eigenvalues[long] > ELONGATION_MIN.powi(2) * axes.eigenvalues[short].max(1e-9);
    let past = if is_long && line.perp(&view).abs() > LINE_SINE_MIN {
        let across = left_of(line);
        if across.dot(&view) > 0.0 { across } else { -across }
    } else {
        view
    };
    let layout = *result.layout();
    let slack_m = layout.resolution_m / 2.0;
    for cell in layout.cells() {
        if (layout.centre(cell) - middle).dot(&past) >= -slack_m {
            result.set(cell, true);
        }
    }
}

/// One side of an object: a strip that begins at the object and leads outward.
struct Side {
    middle: Point2,
    /// Unit vector away from the object.
    outward: Vector2<f64>,
    /// Unit vector along the side.
    along: Vector2<f64>,
    /// Where the side begins and ends along it, metres from the middle.
    along_m: (f64, f64),
    /// Where the object ends outward, for each step along, metres from the middle.
    begins_m: Vec<f64>,
    step_m: f64,
    /// Where the side ends outward, metres from the middle.
    ends_m: f64,
}

impl Side {
    fn new(relation: Relation, cells: &[Point2], map_from_anchor: Pose2, resolution_m: f64) -> Self {
        let middle = mean(cells);
        let view = direction(map_from_anchor, middle);
        let (outward, along) = match relation {
            Relation::LeftOf => (left_of(view), view),
            Relation::RightOf => (-left_of(view), view),
            Relation::FrontOf => (-view, left_of(view)),
            _ => (view, left_of(view)),
        };
        let half_m = resolution_m / 2.0;
        let extent = |axis: Vector2<f64>| {
            let all = cells.iter().map(|p| (p - middle).dot(&axis));
            let (low, high) = all.fold((0.0_f64, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
            (low - half_m, high + half_m)
        };
        let across_m = extent(left_of(view));
        let reach_m = (across_m.1 - across_m.0).max(SIDE_M_MIN);
        let object_m = extent(along);
        let wider_m = (SIDE_M_MIN - (object_m.1 - object_m.0)).max(0.0) / 2.0;
        let along_m = (object_m.0 - wider_m, object_m.1 + wider_m);
        let edge_m = extent(outward).1;
        // The object's own edge, step by step: beside a table that stands askew no wedge is left out.
        let n_steps = ((along_m.1 - along_m.0) / resolution_m).ceil() as usize + 1;
        let mut begins_m = vec![f64::NEG_INFINITY; n_steps];
        for cell in cells {
            let off = cell - middle;
            let step = ((off.dot(&along) - along_m.0) / resolution_m) as usize;
            // A rotated cell reaches into the neighbouring steps.
            for begin_m in &mut begins_m[step.saturating_sub(1)..(step + 2).min(n_steps)] {
                *begin_m = begin_m.max(off.dot(&outward) - half_m);
            }
        }
        for begin_m in &mut begins_m {
            if begin_m.is_infinite() {
                *begin_m = edge_m;
            }
        }
        let ends_m = edge_m + reach_m;
        Side { middle, outward, along, along_m, begins_m, step_m: resolution_m, ends_m }
    }

    fn mark(&self, result: &mut Grid<bool>) {
        let layout = *result.layout();
        let slack_m = layout.resolution_m / 2.0;
        for cell in layout.cells() {
            let off = layout.centre(cell) - self.middle;
            let (along_m, outward_m) = (off.dot(&self.along), off.dot(&self.outward));
            if along_m < self.along_m.0 - slack_m || along_m > self.along_m.1 + slack_m {
                continue;
            }
            let step = ((along_m - self.along_m.0).max(0.0) / self.step_m) as usize;
            let begin_m = self.begins_m[step.min(self.begins_m.len() - 1)];
            if outward_m >= begin_m && outward_m <= self.ends_m + slack_m {
                result.set(cell, true);
            }
        }
    }
}

mod between;
#[cfg(test)]
mod tests;
