//! What of a scene is drawn: the floor's border, and what stands on it, as seen from above.

use geometry::Point2;
use heedway_simulator::scene::{Object, Scene};
use heedway_simulator::solid::{Area, Band, Solid};

/// Corners of the polygon that a disc is drawn as.
const N_DISC_CORNERS: usize = 24;

/// One outline, closed.
pub type Outline = Vec<(f64, f64)>;

/// The border of the floor.
pub fn floor(scene: &Scene) -> Outline {
    closed(scene.floor.corners())
}

/// The outlines of one object's parts, at all heights.
pub fn object(object: &Object) -> Vec<Outline> {
    object.solids.iter().flat_map(|solid| solid.slice(Band::ALL)).map(|area| of_area(&area)).collect()
}

/// Whether the outlines of an object are its edges, and not the triangles of a mesh.
pub fn has_edges(object: &Object) -> bool {
    !object.solids.iter().any(|solid| matches!(solid, Solid::Mesh(_)))
}

/// Lower left and upper right corner of the floor.
pub fn bounds(scene: &Scene) -> (Point2, Point2) {
    let mut low = Point2::new(f64::INFINITY, f64::INFINITY);
    let mut high = Point2::new(f64::NEG_INFINITY, f64::NEG_INFINITY);
    for corner in scene.floor.corners() {
        low = Point2::new(low.x.min(corner.x), low.y.min(corner.y));
        high = Point2::new(high.x.max(corner.x), high.y.max(corner.y));
    }
    (low, high)
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
