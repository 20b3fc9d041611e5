//! What of an object is above the robot, and what carries it.

use geometry::{Point2, Polygon};

use super::{Closing, Counted, OccupancyError, Part};
use crate::grid::{Cell, Grid, GridError};
use crate::morphology::dilated;
use crate::region::convex_hull;

/// How far outside the seen outline of a top a leg may stand and still be the object's own, metres. The
/// front edge of a top is seen before the rest.
const LEG_OVERHANG_M: f64 = 0.15;
/// A group no broader than this, metres, …
const POST_BREADTH_M: f64 = 0.20;
/// … and at least this tall is a post, which carries something.
const POST_HEIGHT_M: f64 = 0.25;
/// Farthest that a post may stand from the rest of its object, metres: under a table of which only the front
/// edge is seen, the far legs are a table's depth away.
const POST_REACH_M: f64 = 1.0;

/// Outlines of what is above the robot's height, each with its own legs.
///
/// From far, or from the height of the top, a table is its front edge and four legs. Legs that stand alone are
/// given to the nearest thing that is more than a leg, and the hull of both is what they carry.
pub(super) fn beneath(
    counted: &Counted,
    groups: Vec<Vec<Cell>>,
    closing: &Closing,
) -> Result<Vec<Grid<bool>>, OccupancyError> {
    let (posts, tops): (Vec<_>, Vec<_>) = groups.into_iter().partition(|group| is_post(counted, group));
    let mut carried: Vec<Vec<Cell>> = vec![Vec::new(); tops.len()];
    let mut outlines = Vec::new();
    let reach_cells = POST_REACH_M / closing.resolution_m;
    for post in posts {
        let nearest = tops
            .iter()
            .enumerate()
            .filter(|(_, top)| counted.has_high(top))
            .map(|(idx, top)| (idx, nearest_cells(top, &post)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match nearest {
            Some((idx, cells)) if cells <= reach_cells => carried[idx].extend(post),
            _ if counted.has_high(&post) => {
                outlines.push(Part::new(&post, &counted.layout)?.outline(&post, closing)?);
            }
            _ => {}
        }
    }
    for (top, posts) in tops.into_iter().zip(carried) {
        let high: Vec<Cell> = top.iter().copied().filter(|&c| *counted.n_high.get(c) > 0).collect();
        if high.is_empty() {
            continue;
        }
        let whole: Vec<Cell> = top.iter().chain(&posts).copied().collect();
        let part = Part::new(&whole, &counted.layout)?;
        let reach = dilated(&part.outline(&high, closing)?, LEG_OVERHANG_M);
        let legs = top.iter().copied().filter(|&c| *reach.get(part.inside(c)));
        let mut cells: Vec<Cell> = high.iter().copied().chain(legs).collect();
        if !posts.is_empty() {
            cells.extend(posts);
            cells = hull_cells(&cells, &part)?;
        }
        outlines.push(part.outline(&cells, closing)?);
    }
    Ok(outlines)
}

/// Whether a group is tall and thin.
fn is_post(counted: &Counted, group: &[Cell]) -> bool {
    let heights = group.iter().map(|&c| *counted.heights_m.get(c));
    let (low_m, high_m) =
        heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (l, h)| (low.min(l), high.max(h)));
    let cols = group.iter().map(|c| c.col);
    let rows = group.iter().map(|c| c.row);
    let breadth = |low: Option<usize>, high: Option<usize>| {
        (high.unwrap_or(0) + 1).saturating_sub(low.unwrap_or(0)) as f64 * counted.layout.resolution_m
    };
    let n_cols_m = breadth(cols.clone().min(), cols.max());
    let n_rows_m = breadth(rows.clone().min(), rows.max());
    high_m - low_m >= POST_HEIGHT_M && n_cols_m.max(n_rows_m) <= POST_BREADTH_M + 1e-9
}

/// Least distance between cells of two groups, in cells.
fn nearest_cells(a: &[Cell], b: &[Cell]) -> f64 {
    let distance = |a: &Cell, b: &Cell| (a.col as f64 - b.col as f64).hypot(a.row as f64 - b.row as f64);
    a.iter().flat_map(|a| b.iter().map(move |b| distance(a, b))).fold(f64::INFINITY, f64::min)
}

/// The cells whose centres lie in the convex hull of cells' centres; the cells themselves when it has no area.
fn hull_cells(cells: &[Cell], part: &Part) -> Result<Vec<Cell>, GridError> {
    let centre = |cell: &Cell| Point2::new(cell.col as f64 + 0.5, cell.row as f64 + 0.5);
    let Ok(hull) = Polygon::new(convex_hull(cells.iter().map(centre).collect())) else {
        return Ok(cells.to_vec());
    };
    let mut all = cells.to_vec();
    all.extend(
        part.layout
            .cells()
            .map(|c| Cell { col: c.col + part.first.col, row: c.row + part.first.row })
            .filter(|c| hull.contains(centre(c))),
    );
    Ok(all)
}
