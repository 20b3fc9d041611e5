//! The gap between two objects, where there may be several of each.
//!
//! "Between the chairs and the table" is beside each chair, not the hull of all that is called chair: every thing
//! is joined with the nearest thing of the other name, and with no other.

use geometry::{Point2, Polygon};
use nalgebra::Vector2;

use super::{RegionError, convex_hull};
use crate::grid::{Cell, Grid};
use crate::morphology::groups;
use crate::occupancy::merge_into;
use crate::raster::mark_polygon;

/// Parts of a footprint with no wider gap than this are one thing, metres: a table seen from two sides.
const SAME_M: f64 = 0.25;

/// One thing: the centres of its cells.
type Thing = Vec<Point2>;

/// Marks the hull of each thing and the nearest of the other name, less the things.
///
/// # Errors
/// [`RegionError::Empty`] when nothing of a name was seen.
pub(super) fn mark_between(
    result: &mut Grid<bool>,
    first: &Grid<bool>,
    second: &Grid<bool>,
) -> Result<(), RegionError> {
    let (firsts, seconds) = (things(first), things(second));
    let nearest = |one: &Thing, others: &[Thing]| {
        let gaps = others.iter().map(|other| gap_m(one, other)).enumerate();
        gaps.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(idx, _)| idx).ok_or(RegionError::Empty)
    };
    let mut pairs = Vec::new();
    for (idx, thing) in firsts.iter().enumerate() {
        pairs.push((idx, nearest(thing, &seconds)?));
    }
    for (idx, thing) in seconds.iter().enumerate() {
        pairs.push((nearest(thing, &firsts)?, idx));
    }
    pairs.sort_unstable();
    pairs.dedup();
    let half_m = (first.layout().resolution_m / 2.0, second.layout().resolution_m / 2.0);
    for (one, other) in pairs {
        let corners = corners(&firsts[one], half_m.0).chain(corners(&seconds[other], half_m.1)).collect();
        // Squares have area, and so has the hull of one.
        let hull = Polygon::new(convex_hull(corners)).map_err(|_| RegionError::Empty)?;
        mark_polygon(result, &hull);
    }
    let mut objects = Grid::filled(*result.layout(), false);
    merge_into(&mut objects, first);
    merge_into(&mut objects, second);
    for (marked, is_object) in result.values_mut().iter_mut().zip(objects.values()) {
        *marked &= !is_object;
    }
    Ok(())
}

/// The corners of the cells around `centres`.
fn corners(centres: &[Point2], half_m: f64) -> impl Iterator<Item = Point2> {
    let signs = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
    centres.iter().flat_map(move |centre| signs.map(|(x, y)| centre + Vector2::new(x, y) * half_m))
}

/// Least distance between the cells of two things, metres.
fn gap_m(one: &Thing, other: &Thing) -> f64 {
    let to_other = |p: &Point2| other.iter().map(|q| (p - q).norm_squared()).fold(f64::INFINITY, f64::min);
    one.iter().map(to_other).fold(f64::INFINITY, f64::min).sqrt()
}

/// The things of a footprint. Of each only the cells on its edge, which hull and distance depend on alone.
fn things(footprint: &Grid<bool>) -> Vec<Thing> {
    let layout = footprint.layout();
    let is_inner = |cell: &Cell| {
        let sides = [(1, 0), (-1, 0), (0, 1), (0, -1)].map(|step| layout.shape.beside(*cell, step));
        sides.iter().all(|side| side.is_some_and(|side| *footprint.get(side)))
    };
    let edge =
        |group: Vec<Cell>| group.iter().filter(|cell| !is_inner(cell)).map(|&c| layout.centre(c)).collect();
    groups(footprint, SAME_M).into_iter().map(edge).collect()
}
