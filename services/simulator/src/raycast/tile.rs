//! One tile of an image: the few triangles that its rays can meet, found once for all of them.
//!
//! Neighbouring rays meet the same triangles. So the hierarchy is asked once a tile, with the tile's
//! pyramid of rays, and each ray is then cast at the few that are left. The answer is that of casting
//! each ray at everything; it comes in half of the time.

use parry3d::math::Vector;
use parry3d::partitioning::BvhNode;
use parry3d::shape::TriMesh;

/// A triangle, told from the eye: what a ray from there needs to know.
struct Candidate {
    /// Normals of the planes through the eye and each edge: a ray inside all three meets the triangle.
    sides: [Vector; 3],
    /// Normal of the triangle, not of unit length.
    normal: Vector,
    /// Distance of the triangle's plane from the eye, times the length of the normal.
    offset: f32,
    triangle: u32,
}

/// The triangles that the rays of one tile can meet.
pub(super) struct Tile {
    candidates: Vec<Candidate>,
}

/// Where a ray meets the scene.
pub(super) struct Hit {
    /// In lengths of the ray's direction.
    pub(super) depth: f32,
    /// Which triangle.
    pub(super) triangle: u32,
    /// The triangle's normal, not of unit length, towards either side.
    pub(super) normal: Vector,
}

impl Tile {
    /// The tile whose rays leave `eye` between four `corners`, directions given in order around it.
    pub(super) fn new(surface: &TriMesh, eye: Vector, corners: [Vector; 4]) -> Self {
        let middle: Vector = corners.iter().copied().sum();
        let walls: [Vector; 4] = std::array::from_fn(|k| {
            let wall = corners[k].cross(corners[(k + 1) % 4]);
            if wall.dot(middle) < 0.0 { -wall } else { wall }
        });
        // A box is left out only when all of it lies beyond one wall of the pyramid.
        let may_meet = |node: &BvhNode| {
            let (low, high) = (node.mins() - eye, node.maxs() - eye);
            walls.iter().all(|wall| {
                let pick = |n: f32, low: f32, high: f32| n * if n > 0.0 { high } else { low };
                pick(wall.x, low.x, high.x) + pick(wall.y, low.y, high.y) + pick(wall.z, low.z, high.z)
                    >= -1e-4
            })
        };
        let candidate = |triangle: u32| {
            let corners = surface.triangle(triangle);
            let [a, b, c] = [corners.a - eye, corners.b - eye, corners.c - eye];
            let normal = (b - a).cross(c - a);
            Candidate { sides: [a.cross(b), b.cross(c), c.cross(a)], normal, offset: normal.dot(a), triangle }
        };
        let leaves = surface.bvh().leaves(may_meet);
        Tile { candidates: leaves.map(candidate).collect() }
    }

    /// The nearest triangle along `direction` and within `reach` lengths of it.
    pub(super) fn nearest(&self, direction: Vector, reach: f32) -> Option<Hit> {
        let mut best = None;
        let mut best_depth = reach;
        for candidate in &self.candidates {
            let [s, t, u] = candidate.sides.map(|side| side.dot(direction));
            // Faces are seen from both sides. A ray along an edge belongs to both triangles: no cracks.
            let inside = (s >= 0.0 && t >= 0.0 && u >= 0.0) || (s <= 0.0 && t <= 0.0 && u <= 0.0);
            if !inside {
                continue;
            }
            let depth = candidate.offset / candidate.normal.dot(direction);
            // Written so that the NaN of a triangle seen edge-on fails.
            if depth > 0.0 && depth < best_depth {
                best_depth = depth;
                best = Some(candidate);
            }
        }
        best.map(|c| Hit { depth: best_depth, triangle: c.triangle, normal: c.normal })
    }
}
