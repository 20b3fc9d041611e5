//! The shapes that a scene is made of, standing in `map`: upright prisms, upright cylinders, meshes.
//!
//! A solid gives its surface as triangles, for rays, and its slice between two heights as flat areas, for
//! ground truth. The two are told apart on purpose: slices of prisms and cylinders are exact, while rays
//! see a cylinder as a many-sided prism.

use std::f64::consts::TAU;

use geometry::{Point2, Point3, Pose2};

use crate::mesh::Mesh;
use crate::triangulate::{self, NotSimple};

/// A range of heights above the floor, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Lower end.
    pub bottom_m: f64,
    /// Upper end; may be infinite.
    pub top_m: f64,
}

impl Band {
    /// Every height.
    pub const ALL: Band = Band { bottom_m: f64::NEG_INFINITY, top_m: f64::INFINITY };

    /// What a robot of this height can bump into. Below 0.02 m lies what it drives over.
    #[must_use]
    pub fn of_hull(height_m: f64) -> Self {
        Band { bottom_m: 0.02, top_m: height_m }
    }

    /// What is above a robot of this height.
    #[must_use]
    pub fn above(height_m: f64) -> Self {
        Band { bottom_m: height_m, top_m: f64::INFINITY }
    }

    /// Whether something between these heights has more than a touch in common with the band.
    fn meets(&self, bottom_m: f64, top_m: f64) -> bool {
        top_m > self.bottom_m && bottom_m < self.top_m
    }
}

/// Where a shape's own frame stands in `map`: turned about the vertical only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The shape's frame, seen from above.
    pub map_from_shape: Pose2,
    /// Height of its base, metres.
    pub base_m: f64,
}

impl Placement {
    /// `map_from_part` of a part that is placed relative to this.
    #[must_use]
    pub fn then(&self, part: Placement) -> Self {
        Placement {
            map_from_shape: self.map_from_shape * part.map_from_shape,
            base_m: self.base_m + part.base_m,
        }
    }

    fn at(&self, point: Point3) -> Point3 {
        let flat = self.map_from_shape.transform(point.xy());
        Point3::new(flat.x, flat.y, self.base_m + point.z)
    }
}

/// One solid, in `map`.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// An outline, drawn up from `bottom_m` to `top_m`.
    Prism {
        /// The outline, counter-clockwise.
        corners: Vec<Point2>,
        /// The outline's inside, as indices into `corners`.
        triangles: Vec<[u32; 3]>,
        /// Height of the lower face, metres.
        bottom_m: f64,
        /// Height of the upper face, metres.
        top_m: f64,
    },
    /// A disc, drawn up from `bottom_m` to `top_m`.
    Cylinder {
        /// Its axis.
        centre: Point2,
        /// Its radius, metres.
        radius_m: f64,
        /// Height of the lower face, metres.
        bottom_m: f64,
        /// Height of the upper face, metres.
        top_m: f64,
    },
    /// Any surface.
    Mesh(Mesh),
}

/// A flat region of the floor's plane.
#[derive(Clone, Debug, PartialEq)]
pub enum Area {
    /// A simple polygon; one without area is the line that its corners draw.
    Polygon(Vec<Point2>),
    /// A disc.
    Disc {
        /// Its centre.
        centre: Point2,
        /// Its radius, metres.
        radius_m: f64,
    },
}

impl Solid {
    /// A box that stands centred on its placement; `size_m` along the placement's own axes.
    #[must_use]
    pub fn cuboid(at: Placement, size_m: [f64; 3]) -> Self {
        let [x_m, y_m, z_m] = size_m;
        let corner = |sx: f64, sy: f64| at.map_from_shape.transform(Point2::new(sx * x_m, sy * y_m));
        Solid::Prism {
            corners: vec![corner(-0.5, -0.5), corner(0.5, -0.5), corner(0.5, 0.5), corner(-0.5, 0.5)],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            bottom_m: at.base_m,
            top_m: at.base_m + z_m,
        }
    }

    /// A cylinder that stands on its placement.
    #[must_use]
    pub fn cylinder(at: Placement, radius_m: f64, height_m: f64) -> Self {
        Solid::Cylinder {
            centre: at.map_from_shape.position(),
            radius_m,
            bottom_m: at.base_m,
            top_m: at.base_m + height_m,
        }
    }

    /// A prism over `outline`, which is told in the placement's frame.
    ///
    /// # Errors
    /// [`NotSimple`] when the outline crosses itself or has no area.
    pub fn prism(at: Placement, outline: &[Point2], height_m: f64) -> Result<Self, NotSimple> {
        let mut corners: Vec<Point2> = outline.iter().map(|p| at.map_from_shape.transform(*p)).collect();
        let doubled_area: f64 = (0..corners.len())
            .map(|k| corners[k].coords.perp(&corners[(k + 1) % corners.len()].coords))
            .sum();
        if doubled_area < 0.0 {
            corners.reverse();
        }
        let triangles = triangulate::outline(&corners)?;
        Ok(Solid::Prism { corners, triangles, bottom_m: at.base_m, top_m: at.base_m + height_m })
    }

    /// A mesh, set down on its placement.
    #[must_use]
    pub fn mesh(at: Placement, mesh: Mesh) -> Self {
        let vertices = mesh.vertices.into_iter().map(|p| at.at(p)).collect();
        Solid::Mesh(Mesh { vertices, triangles: mesh.triangles })
    }

    /// The surface as triangles, corners in `map`.
    #[must_use]
    pub fn surface(&self) -> Vec<[Point3; 3]> {
        match self {
            Solid::Prism { corners, triangles, bottom_m, top_m } => {
                upright_surface(corners, triangles, *bottom_m, *top_m)
            }
            Solid::Cylinder { centre, radius_m, bottom_m, top_m } => {
                let corners = round_outline(*centre, *radius_m);
                let n = corners.len() as u32;
                let fan: Vec<[u32; 3]> = (1..n - 1).map(|k| [0, k, k + 1]).collect();
                upright_surface(&corners, &fan, *bottom_m, *top_m)
            }
            Solid::Mesh(mesh) => {
                mesh.triangles.iter().map(|t| t.map(|k| mesh.vertices[k as usize])).collect()
            }
        }
    }

    /// The floor areas that the solid covers between the heights of `band`, seen from above.
    ///
    /// A prism or cylinder gives one filled area. A mesh gives one area a triangle, cut to the band: what
    /// lies enclosed between its walls is not in them, [`Solid::encloses`] tells.
    #[must_use]
    pub fn slice(&self, band: Band) -> Vec<Area> {
        match self {
            Solid::Prism { corners, bottom_m, top_m, .. } if band.meets(*bottom_m, *top_m) => {
                vec![Area::Polygon(corners.clone())]
            }
            Solid::Cylinder { centre, radius_m, bottom_m, top_m } if band.meets(*bottom_m, *top_m) => {
                vec![Area::Disc { centre: *centre, radius_m: *radius_m }]
            }
            Solid::Mesh(_) => self.surface().into_iter().filter_map(|t| cut_to_band(&t, band)).collect(),
            _ => Vec::new(),
        }
    }

    /// Whether a mesh has `point` in its inside: lines along all six axes leave it an odd number of times.
    ///
    /// All six, because meshes that are not closed are common: a table top and a foot without thickness
    /// do not enclose what is between them. Prisms and cylinders answer no: their slices are filled
    /// already.
    #[must_use]
    pub fn encloses(&self, point: Point3) -> bool {
        let Solid::Mesh(mesh) = self else { return false };
        let mut is_odd = [[false; 2]; 3];
        for triangle in &mesh.triangles {
            let corners = triangle.map(|k| mesh.vertices[k as usize] - point);
            for (axis, sides) in is_odd.iter_mut().enumerate() {
                if let Some(hit_m) = axis_hit_m(&corners, axis) {
                    sides[usize::from(hit_m > 0.0)] ^= true;
                }
            }
        }
        is_odd.iter().flatten().all(|odd| *odd)
    }
}

/// Where a line through the origin along an axis meets a triangle, if it does; a border that two
/// triangles share counts for one of them.
fn axis_hit_m(corners: &[nalgebra::Vector3<f64>; 3], axis: usize) -> Option<f64> {
    let (across, along) = ((axis + 1) % 3, (axis + 2) % 3);
    let crosses = |a: &nalgebra::Vector3<f64>, b: &nalgebra::Vector3<f64>| {
        (a[along] > 0.0) != (b[along] > 0.0)
            && 0.0 < a[across] - a[along] / (b[along] - a[along]) * (b[across] - a[across])
    };
    let [a, b, c] = corners;
    if !(crosses(a, b) ^ crosses(b, c) ^ crosses(c, a)) {
        return None;
    }
    let normal = (b - a).cross(&(c - a));
    Some(normal.dot(a) / normal[axis])
}

/// Corners of a disc's outline whose mean radius is the disc's; sides of some 3 cm, at least 12.
fn round_outline(centre: Point2, radius_m: f64) -> Vec<Point2> {
    let n = ((TAU * radius_m / 0.03).ceil() as usize).clamp(12, 64);
    let half_rad = TAU / n as f64 / 2.0;
    let corner_m = radius_m * 2.0 / (1.0 + half_rad.cos());
    let at = |k: usize| {
        let (sin, cos) = (k as f64 / n as f64 * TAU).sin_cos();
        Point2::new(centre.x + corner_m * cos, centre.y + corner_m * sin)
    };
    (0..n).map(at).collect()
}

fn upright_surface(
    corners: &[Point2],
    triangles: &[[u32; 3]],
    bottom_m: f64,
    top_m: f64,
) -> Vec<[Point3; 3]> {
    let lift = |p: Point2, z: f64| Point3::new(p.x, p.y, z);
    let mut surface = Vec::with_capacity(2 * triangles.len() + 2 * corners.len());
    for triangle in triangles {
        let [a, b, c] = triangle.map(|k| corners[k as usize]);
        surface.push([lift(a, top_m), lift(b, top_m), lift(c, top_m)]);
        surface.push([lift(a, bottom_m), lift(c, bottom_m), lift(b, bottom_m)]);
    }
    for (k, a) in corners.iter().enumerate() {
        let b = corners[(k + 1) % corners.len()];
        surface.push([lift(*a, bottom_m), lift(b, bottom_m), lift(b, top_m)]);
        surface.push([lift(*a, bottom_m), lift(b, top_m), lift(*a, top_m)]);
    }
    surface
}

/// The part of a triangle within the band, seen from above; `None` when they have nothing in common.
fn cut_to_band(triangle: &[Point3; 3], band: Band) -> Option<Area> {
    let lowest_m = triangle.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    let highest_m = triangle.iter().map(|p| p.z).fold(f64::NEG_INFINITY, f64::max);
    // A level face exactly on the band's end belongs to what lies beyond it.
    if !band.meets(lowest_m, highest_m) {
        return None;
    }
    let above = cut(triangle, |p| p.z - band.bottom_m);
    let within = cut(&above, |p| band.top_m - p.z);
    (!within.is_empty()).then(|| Area::Polygon(within.iter().map(|p| p.xy()).collect()))
}

/// The part of a convex face where `height` is not below 0.
fn cut(face: &[Point3], height: impl Fn(&Point3) -> f64) -> Vec<Point3> {
    let mut kept = Vec::with_capacity(face.len() + 1);
    for (k, a) in face.iter().enumerate() {
        let b = &face[(k + 1) % face.len()];
        let (of_a, of_b) = (height(a), height(b));
        if of_a >= 0.0 {
            kept.push(*a);
        }
        if (of_a > 0.0 && of_b < 0.0) || (of_a < 0.0 && of_b > 0.0) {
            kept.push(a + (b - a) * (of_a / (of_a - of_b)));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Placement = Placement { map_from_shape: Pose2::IDENTITY, base_m: 0.5 };

    #[test]
    fn a_solid_is_in_a_slice_only_when_it_reaches_into_the_band() {
        let slab = Solid::cuboid(HERE, [1.0, 2.0, 0.1]);
        let has = |bottom_m, top_m| !slab.slice(Band { bottom_m, top_m }).is_empty();
        assert!(has(0.0, 0.55) && has(0.55, 0.56) && has(0.0, 9.0));
        assert!(!has(0.02, 0.5) && !has(0.6, 9.0));
    }

    #[test]
    fn a_triangle_is_cut_where_it_leaves_the_band() {
        let p = Point3::new;
        let ramp = [p(0.0, 0.0, 0.0), p(4.0, 0.0, 4.0), p(0.0, 2.0, 0.0)];
        let Some(Area::Polygon(corners)) = cut_to_band(&ramp, Band { bottom_m: 1.0, top_m: 2.0 }) else {
            panic!("nothing kept");
        };
        assert!(corners.iter().all(|c| (1.0..=2.0).contains(&c.x)));
        assert_eq!(corners.len(), 4);
    }

    #[test]
    fn a_closed_mesh_knows_its_inside_between_its_walls() {
        let surface = Solid::cuboid(HERE, [1.0, 1.0, 2.0]).surface();
        let vertices: Vec<Point3> = surface.iter().flatten().copied().collect();
        let triangles = (0..surface.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
        let closed = Solid::Mesh(Mesh { vertices, triangles });
        assert!(closed.encloses(Point3::new(0.1, 0.2, 1.0)));
        assert!(!closed.encloses(Point3::new(0.1, 0.2, 0.4)));
        assert!(!closed.encloses(Point3::new(0.1, 0.2, 2.6)));
        assert!(!closed.encloses(Point3::new(0.6, 0.2, 1.0)));
    }

    #[test]
    fn two_plates_without_thickness_enclose_nothing() {
        let plate = |z: f64| {
            let p = |x: f64, y: f64| Point3::new(x, y, z);
            [[p(-1.0, -1.0), p(1.0, -1.0), p(1.0, 1.0)], [p(-1.0, -1.0), p(1.0, 1.0), p(-1.0, 1.0)]]
        };
        let vertices = [plate(0.0), plate(1.0)].into_iter().flatten().flatten().collect();
        let open = Solid::Mesh(Mesh {
            vertices,
            triangles: (0..4).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect(),
        });
        assert!(!open.encloses(Point3::new(0.1, 0.2, 0.5)));
    }
}
