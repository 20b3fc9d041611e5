//! What pictures of a scene are made of: the floor's border, what stands on it as seen from above, cells of grids.

use anyhow::anyhow;
use geometry::Point2;
use heedway_simulator::scene::{Object, Scene};
use heedway_simulator::solid::{Area, Band, Solid};
use plotters::style::FontStyle;
use proto::GridLayout;

/// Corners of the polygon that a disc is drawn as.
const N_DISC_CORNERS: usize = 24;

/// One outline, closed.
pub type Outline = Vec<(f64, f64)>;

/// The border of the floor.
#[must_use]
pub fn floor_outline(scene: &Scene) -> Outline {
    closed(scene.floor.corners())
}

/// The outlines of one object's parts, at all heights.
#[must_use]
pub fn object_outlines(object: &Object) -> Vec<Outline> {
    object.solids.iter().flat_map(solid_outlines).collect()
}

/// The outlines of one solid, at all heights.
#[must_use]
pub fn solid_outlines(solid: &Solid) -> Vec<Outline> {
    solid.slice(Band::ALL).iter().map(of_area).collect()
}

/// Whether the outlines of an object are its edges, and not the triangles of a mesh.
#[must_use]
pub fn has_edges(object: &Object) -> bool {
    !object.solids.iter().any(|solid| matches!(solid, Solid::Mesh(_)))
}

/// Lower left and upper right corner of the floor.
#[must_use]
pub fn bounds(scene: &Scene) -> (Point2, Point2) {
    let mut low = Point2::new(f64::INFINITY, f64::INFINITY);
    let mut high = Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY);
    for corner in scene.floor.corners() {
        low = Point2::new(low.x.min(corner.x), low.y.min(corner.y));
        high = Point2::new(high.x.max(corner.x), high.y.max(corner.y));
    }
    (low, high)
}

/// Lower left and upper right corner of a cell, by its place in row-major order.
#[must_use]
pub fn cell_box(layout: &GridLayout, idx: usize) -> [(f64, f64); 2] {
    let n_cols = (layout.n_cols as usize).max(1);
    let (col, row) = ((idx % n_cols) as f64, (idx / n_cols) as f64);
    let corner = |col: f64, row: f64| {
        (layout.origin_map.x + col * layout.resolution_m, layout.origin_map.y + row * layout.resolution_m)
    };
    [corner(col, row), corner(col + 1.0, row + 1.0)]
}

/// Makes the built-in font known to the drawing library; again does no harm.
///
/// # Errors
/// When it cannot be read.
pub fn use_fonts() -> anyhow::Result<()> {
    plotters::style::register_font("sans-serif", FontStyle::Normal, dejavu::sans::regular())
        .map_err(|_| anyhow!("the built-in font cannot be read"))
}

fn of_area(area: &Area) -> Outline {
    match area {
        Area::Polygon(corners) => closed(corners),
        Area::Disc { centre, radius_m } => {
            let corner = |idx: usize| {
                let (sin, cos) = (idx as f64 / N_DISC_CORNERS as f64 * std::f64::consts::TAU).sin_cos();
                Point2::new(centre.x + radius_m * cos, centre.y + radius_m * sin)
            };
            closed(&(0..N_DISC_CORNERS).map(corner).collect::<Vec<_>>())
        }
    }
}

fn closed(corners: &[Point2]) -> Outline {
    corners.iter().chain(corners.first()).map(|corner| (corner.x, corner.y)).collect()
}
