//! Ground truth: how far the robot's disc really is from everything.
//!
//! Computed from the scene's own shapes, exactly, and from nothing that the robot has seen. A collision
//! is the disc against all that stands between 0.02 m and the robot's height, and against the outside of
//! the floor. A zone is measured to the projection of an object: of all of it, or (`beneath`) of what is
//! above the robot.

use geometry::{Point2, Polygon};

use crate::footprint::Footprint;
use crate::scene::{Hull, Kind, Scene};
use crate::solid::Band;

/// Distances are told up to here, metres, so that they stay numbers in every encoding.
const DISTANCE_M_MAX: f64 = 1e4;

/// The footprints of a scene, for one robot.
pub struct GroundTruth {
    hull: Hull,
    floor: Polygon,
    obstacles: Footprint,
    objects: Vec<ObjectFootprints>,
}

struct ObjectFootprints {
    id: String,
    any_height: Footprint,
    overhead: Footprint,
}

/// How far the hull is from one object's projection, metres, negative inside.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectGap {
    /// The object.
    pub id: String,
    /// To the projection of all of it.
    pub any_height_m: f64,
    /// To the projection of what is above the robot; `None` when nothing is.
    pub overhead_m: Option<f64>,
}

impl GroundTruth {
    /// The truth about a scene, for a robot of this size.
    #[must_use]
    pub fn new(scene: &Scene, hull: Hull) -> Self {
        let things = scene.objects.iter().filter(|o| o.kind == Kind::Thing);
        let solids: Vec<_> = scene.walls.iter().chain(things.flat_map(|o| &o.solids)).cloned().collect();
        let footprints = scene.objects.iter().map(|object| ObjectFootprints {
            id: object.id.clone(),
            any_height: Footprint::of(&object.solids, Band::ALL),
            overhead: Footprint::of(&object.solids, Band::above(hull.height_m)),
        });
        GroundTruth {
            hull,
            floor: scene.floor.clone(),
            obstacles: Footprint::of(&solids, Band::of_hull(hull.height_m)),
            objects: footprints.collect(),
        }
    }

    /// Distance from a point to the nearest obstacle or to the outside of the floor, metres, negative
    /// inside: the hull's clearance before its radius is taken off.
    #[must_use]
    pub fn obstacle_distance_m(&self, point_map: Point2) -> f64 {
        let inside_floor_m = -self.floor.signed_distance_m(point_map);
        self.obstacles.distance_m(point_map).min(inside_floor_m)
    }

    /// Hull to the nearest obstacle, metres; not above 0 in a collision.
    #[must_use]
    pub fn clearance_m(&self, centre_map: Point2) -> f64 {
        (self.obstacle_distance_m(centre_map) - self.hull.radius_m).clamp(-DISTANCE_M_MAX, DISTANCE_M_MAX)
    }

    /// The hull's distance to the projection of each object, in the scene's order.
    #[must_use]
    pub fn objects(&self, centre_map: Point2) -> Vec<ObjectGap> {
        let gap_m = |footprint: &Footprint| {
            (footprint.distance_m(centre_map) - self.hull.radius_m).clamp(-DISTANCE_M_MAX, DISTANCE_M_MAX)
        };
        let of_object = |object: &ObjectFootprints| ObjectGap {
            id: object.id.clone(),
            any_height_m: gap_m(&object.any_height),
            overhead_m: (!object.overhead.is_empty()).then(|| gap_m(&object.overhead)),
        };
        self.objects.iter().map(of_object).collect()
    }

    /// The hull that is judged.
    #[must_use]
    pub fn hull(&self) -> Hull {
        self.hull
    }
}
