//! Where an object is on the floor: from points of its surface to a closed footprint.
//!
//! Only surfaces are seen, and only from some sides: a table top at a grazing angle is a few stripes. So
//! points are grouped into objects, each is closed and filled on its own, and what is too little to be
//! anything is dropped. Several objects of one rule stay several footprints.

mod beneath;
mod faces;
mod hidden;

use beneath::beneath;
use faces::Rectangle;
use geometry::{Point2, Point3};
pub use hidden::{Hidden, with_hidden};

use crate::floor_area::FLOOR_HEIGHT_M;
use crate::grid::{Cell, Grid, GridError, Layout, Shape};
use crate::morphology::{closed, groups, without_holes};
use crate::raster::mark_box;

/// Which region around an object is asked for. (The tie to rules and their words lies with the caller.)
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Relation {
    /// The object itself; how near is near is a matter of the distance to it.
    Near,
    /// Over the object's own footprint.
    On,
    /// Under the parts that the robot fits under.
    Beneath,
    /// The gap to a second object.
    Between,
    /// Past the object's line, seen from the anchor.
    Beyond,
    /// The object's left, seen from the anchor.
    LeftOf,
    /// The object's right, seen from the anchor.
    RightOf,
    /// The near side, seen from the anchor.
    FrontOf,
    /// The far side, seen from the anchor.
    Behind,
}

/// What counts as above the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeightBand {
    /// Height of the robot, metres above the floor.
    pub robot_height_m: f64,
}

/// How an outline is closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Closing {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Points with a gap up to this between them are of one object, metres.
    pub join_m: f64,
    /// Within one object, bays and holes narrower than twice this are filled, metres. Other holes are
    /// filled when the outline runs all around them.
    pub fill_radius_m: f64,
    /// An object of fewer points is a speck and left out.
    pub n_points_min: usize,
}

impl Default for Closing {
    /// 5 cm cells; objects 0.25 m apart are two; bays up to 0.8 m wide are filled, as between two legs on one
    /// side of a table; three points or fewer are a speck.
    fn default() -> Self {
        Closing { resolution_m: 0.05, join_m: 0.25, fill_radius_m: 0.4, n_points_min: 4 }
    }
}

/// Points that make no footprint.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum OccupancyError {
    /// Nothing of the object is (yet) known in the height band: not grounded, which is not the same as free.
    #[error("no surface of the object in the height band, {n_points} points in all")]
    Nothing {
        /// Points given.
        n_points: usize,
    },
    /// A point that is NaN or infinite.
    #[error("point {0} is not finite")]
    NotFinite(usize),
    /// Points too far apart for a grid.
    #[error(transparent)]
    Grid(#[from] GridError),
}

/// The cells that an object of these surface points covers, as its relation counts them, with nothing known
/// of who saw it. See [`footprint_seen_from`].
///
/// # Errors
/// [`OccupancyError`] when there is nothing, or something that is no number.
pub fn footprint(
    points_map: &[Point3],
    relation: Relation,
    band: HeightBand,
    closing: &Closing,
) -> Result<Grid<bool>, OccupancyError> {
    footprint_seen_from(points_map, relation, band, closing, None)
}

/// The cells that an object of these surface points covers, as its relation counts them.
///
/// With the place in `map` that it was seen from, two near faces of a box stand for the whole box, save
/// `beneath`, which is about what hangs over the floor.
///
/// `beneath` takes what is above the robot's height, with the object's own legs as far as they stand within
/// or next to that outline; every other relation takes all heights. Points on the floor are left out if
/// there are others: masks of things also hold what is seen between their legs. The grid is the smallest,
/// aligned to multiples of the resolution, that holds the footprint with a border. Points are in `map`.
///
/// # Errors
/// [`OccupancyError`] when there is nothing, or something that is no number.
pub fn footprint_seen_from(
    points_map: &[Point3],
    relation: Relation,
    band: HeightBand,
    closing: &Closing,
    seen_from_map: Option<Point2>,
) -> Result<Grid<bool>, OccupancyError> {
    if let Some(idx) = points_map.iter().position(|p| !p.coords.iter().all(|c| c.is_finite())) {
        return Err(OccupancyError::NotFinite(idx));
    }
    let counted = Counted::new(&standing(points_map, closing), closing.resolution_m, band)?
        .ok_or(OccupancyError::Nothing { n_points: 0 })?;
    let groups: Vec<Vec<Cell>> = groups(&counted.n_all.map(|n| *n > 0), closing.join_m)
        .into_iter()
        .filter(|group| counted.n_points(group) >= closing.n_points_min)
        .collect();
    let mut boxes: Vec<Rectangle> = Vec::new();
    let outlines = if relation == Relation::Beneath {
        beneath(&counted, groups, closing)?
    } else {
        let centres = |group: &Vec<Cell>| group.iter().map(|&c| counted.layout.centre(c)).collect::<Vec<_>>();
        if let Some(seen_from) = seen_from_map {
            let behind = |group| Rectangle::behind(&centres(group), seen_from, closing.resolution_m);
            boxes.extend(groups.iter().filter_map(behind));
        }
        groups
            .iter()
            .map(|group| Part::new(group, &counted.layout)?.outline(group, closing))
            .collect::<Result<_, _>>()?
    };
    let mut result = Grid::filled(holding(&counted.layout, &boxes)?, false);
    for outline in outlines {
        merge_into(&mut result, &outline);
    }
    for cell in result.layout().cells() {
        let centre = result.layout().centre(cell);
        if boxes.iter().any(|b| b.holds(centre)) {
            result.set(cell, true);
        }
    }
    if result.values().iter().any(|o| *o) {
        Ok(result)
    } else {
        Err(OccupancyError::Nothing { n_points: points_map.len() })
    }
}

/// The layout, or one that holds the boxes, too.
fn holding(layout: &Layout, boxes: &[Rectangle]) -> Result<Layout, GridError> {
    if boxes.is_empty() {
        return Ok(*layout);
    }
    let border = nalgebra::Vector2::repeat(N_BORDER * layout.resolution_m);
    let (mut low, mut high) = (layout.origin, layout.far_corner());
    for corner in boxes.iter().flat_map(Rectangle::corners) {
        (low, high) = (low.inf(&(corner - border)), high.sup(&(corner + border)));
    }
    Layout::covering(low, high, layout.resolution_m)
}

/// The points without those of the floor; all of them when the object itself lies flat.
fn standing(points: &[Point3], closing: &Closing) -> Vec<Point3> {
    let above: Vec<Point3> = points.iter().copied().filter(|p| p.z > FLOOR_HEIGHT_M).collect();
    if above.len() >= closing.n_points_min { above } else { points.to_vec() }
}

/// Free cells around the footprint.
const N_BORDER: f64 = 3.0;

/// Points counted per cell, all of them and those above the robot.
struct Counted {
    layout: Layout,
    n_all: Grid<u32>,
    n_high: Grid<u32>,
    /// Heights of the lowest and the highest point, metres; inside out where there is none.
    heights_m: Grid<(f64, f64)>,
}

impl Counted {
    fn new(points: &[Point3], resolution_m: f64, band: HeightBand) -> Result<Option<Self>, GridError> {
        let Some(first) = points.first() else { return Ok(None) };
        let (mut low, mut high) = (first.xy(), first.xy());
        for point in points {
            low = low.inf(&point.xy());
            high = high.sup(&point.xy());
        }
        let border = nalgebra::Vector2::repeat(N_BORDER * resolution_m);
        let layout = Layout::covering(low - border, high + border, resolution_m)?;
        let mut counted = Counted {
            layout,
            n_all: Grid::filled(layout, 0),
            n_high: Grid::filled(layout, 0),
            heights_m: Grid::filled(layout, (f64::INFINITY, f64::NEG_INFINITY)),
        };
        for point in points {
            let Some(cell) = layout.cell_at(point.xy()) else { continue };
            counted.n_all.set(cell, counted.n_all.get(cell) + 1);
            let (low_m, high_m) = *counted.heights_m.get(cell);
            counted.heights_m.set(cell, (low_m.min(point.z), high_m.max(point.z)));
            if point.z >= band.robot_height_m {
                counted.n_high.set(cell, counted.n_high.get(cell) + 1);
            }
        }
        Ok(Some(counted))
    }

    fn n_points(&self, group: &[Cell]) -> usize {
        group.iter().map(|&c| *self.n_all.get(c) as usize).sum()
    }

    fn has_high(&self, group: &[Cell]) -> bool {
        group.iter().any(|&c| *self.n_high.get(c) > 0)
    }
}

/// The corner of the grid that holds one object.
struct Part {
    /// The cell of the whole grid that is its (0, 0).
    first: Cell,
    layout: Layout,
}

impl Part {
    /// The smallest that holds all `cells`, of which there is at least one.
    fn new(cells: &[Cell], whole: &Layout) -> Result<Self, GridError> {
        let (mut first, mut last) = (Cell { col: usize::MAX, row: usize::MAX }, Cell { col: 0, row: 0 });
        for cell in cells {
            first = Cell { col: first.col.min(cell.col), row: first.row.min(cell.row) };
            last = Cell { col: last.col.max(cell.col), row: last.row.max(cell.row) };
        }
        let shape = Shape {
            n_cols: (last.col + 1).saturating_sub(first.col),
            n_rows: (last.row + 1).saturating_sub(first.row),
        };
        let half = nalgebra::Vector2::repeat(whole.resolution_m / 2.0);
        Ok(Part { first, layout: Layout::new(whole.centre(first) - half, whole.resolution_m, shape)? })
    }

    fn inside(&self, cell: Cell) -> Cell {
        Cell { col: cell.col - self.first.col, row: cell.row - self.first.row }
    }

    /// Cells of the whole grid, closed and filled, in the part's own.
    fn outline(&self, cells: &[Cell], closing: &Closing) -> Result<Grid<bool>, GridError> {
        let mut marked = Grid::filled(self.layout, false);
        for &cell in cells {
            marked.set(self.inside(cell), true);
        }
        Ok(without_holes(&closed(&marked, closing.fill_radius_m)?))
    }
}

/// Marks in `into` every cell that an occupied cell of `from` overlaps. Both in one frame; what lies outside
/// `into` is left out.
pub fn merge_into(into: &mut Grid<bool>, from: &Grid<bool>) {
    let half_m = from.layout().resolution_m / 2.0;
    // Cells that only share a border do not overlap.
    let reach = nalgebra::Vector2::repeat(half_m * (1.0 - 1e-6));
    for cell in from.layout().cells().filter(|&c| *from.get(c)) {
        let centre: Point2 = from.layout().centre(cell);
        mark_box(into, centre - reach, centre + reach);
    }
}

#[cfg(test)]
mod tests;
