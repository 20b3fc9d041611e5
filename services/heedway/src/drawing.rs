//! What pictures of a scene are made of: the floor's border, what stands on it as seen from above, cells of grids.

use anyhow::anyhow;
use geometry::Point2;
use heedway_simulator::scene::{Object, Scene};
use heedway_simulator::solid::{Area, Band, Solid};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use proto::GridLayout;

/// Corners of the polygon that a disc is drawn as.
const N_DISC_CORNERS: usize = 24;

/// One outline, closed.
pub type Outline = Vec<(f64, f64)>;

/// A chart of the floor, metres in `map`.
pub type Map<'a> = ChartContext<'a, BitMapBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// An empty chart of a floor with its axes, under a caption of so many pixels; `x` and `y` are what is shown, metres.
///
/// # Errors
/// When it cannot be drawn.
pub fn map<'a>(
    area: &DrawingArea<BitMapBackend<'a>, Shift>,
    (caption, caption_px): (&str, u32),
    (x, y): (std::ops::Range<f64>, std::ops::Range<f64>),
) -> anyhow::Result<Map<'a>> {
    let mut chart = ChartBuilder::on(area)
        .caption(caption, ("sans-serif", caption_px))
        .margin(12)
        .margin_right(18)
        .x_label_area_size(46)
        .y_label_area_size(56)
        .build_cartesian_2d(x, y)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_desc("x (m)")
        .y_desc("y (m)")
        .label_style(("sans-serif", 16))
        .axis_desc_style(("sans-serif", 17))
        .draw()?;
    Ok(chart)
}

/// Draws the floor's border and what stands on it.
///
/// # Errors
/// When it cannot be drawn.
pub fn draw_scene(chart: &mut Map<'_>, scene: &Scene) -> anyhow::Result<()> {
    chart.draw_series([PathElement::new(floor_outline(scene), BLACK.stroke_width(2))])?;
    for object in &scene.objects {
        let [r, g, b] = object.rgb.unwrap_or([150, 150, 150]);
        let parts = object_outlines(object);
        let fill = RGBColor(r, g, b).mix(0.30).filled();
        chart.draw_series(parts.iter().map(|part| Polygon::new(part.clone(), fill)))?;
        if has_edges(object) {
            let edge = RGBColor(r / 2, g / 2, b / 2).mix(0.8).stroke_width(1);
            chart.draw_series(parts.into_iter().map(|part| PathElement::new(part, edge)))?;
        }
    }
    Ok(())
}

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
