//! A scene: what stands where, where the robot starts and has to go, and what is said to it.
//!
//! One JSON file, with OBJ meshes beside it. It is checked once, here; what comes out stands in `map`
//! and is sound. Keys that are not known are kept and ignored. Every error names the file, the object
//! and the field. Deliberately not here: anything that moves or sees.

mod cases;
mod node;
mod objects;

use std::io::Read;
use std::path::Path;

use geometry::{Point2, Polygon, Pose2};
use serde_json::{Map, Value};

pub use cases::{Case, CaseRule};
pub(crate) use node::COORDINATE_M_MAX;
use node::Node;

use crate::footprint::Footprint;
use crate::mesh::Mesh;
use crate::solid::{Band, Placement, Solid};

/// Longest scene or mesh file, bytes.
pub const N_FILE_BYTES_MAX: u64 = 16 * 1024 * 1024;
/// Most objects in a scene.
pub const N_OBJECTS_MAX: usize = 2000;
/// Most walls in a scene.
pub const N_WALLS_MAX: usize = 2000;
/// Most triangles that all objects and walls of a scene may have together.
pub const N_TRIANGLES_MAX: usize = 200_000;
/// Height to which all that is outside the floor is solid, metres.
pub const OUTSIDE_HEIGHT_M: f64 = 3.0;

/// A scene that is sound, in `map`.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// Short name.
    pub name: String,
    /// Title for people.
    pub title: String,
    /// Where it comes from.
    pub source: String,
    /// What the file says about its frame.
    pub frame: String,
    /// The floor; all outside it is solid.
    pub floor: Polygon,
    /// Walls, as boxes around their centre lines.
    pub walls: Vec<Solid>,
    /// What stands and lies in it, in the file's order.
    pub objects: Vec<Object>,
    /// Where the robot starts.
    pub map_from_start: Pose2,
    /// Where it has to go.
    pub goal_map: Point2,
    /// What may be said in it, and what that means.
    pub cases: Vec<Case>,
    /// Keys that this program does not know.
    pub extra: Map<String, Value>,
}

/// Whether an object can be bumped into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// It stands there.
    Thing,
    /// A rug, a pool, a spill: flat, nothing to collide with.
    FloorArea,
}

/// One thing, or one area of the floor.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Its handle, unique in the scene.
    pub id: String,
    /// What people call it.
    pub label: String,
    /// Whether it can be bumped into.
    pub kind: Kind,
    /// Its colour, when the file gives one.
    pub rgb: Option<[u8; 3]>,
    /// Where it stands.
    pub placement: Placement,
    /// What it is made of, in `map`; never empty.
    pub solids: Vec<Solid>,
    /// Keys that this program does not know.
    pub extra: Map<String, Value>,
}

/// A scene that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SceneError {
    /// The file itself.
    #[error("scene {file}: {reason}")]
    File {
        /// The file.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// One field of it.
    #[error("scene {file}: {}{field}: {reason}", object.as_ref().map(|o| format!("object `{o}`: ")).unwrap_or_default())]
    Field {
        /// The file.
        file: String,
        /// Id of the object, or its place in the list while it has no id.
        object: Option<String>,
        /// Path of the field.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// The disc that has to find room at the start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hull {
    /// Radius, metres.
    pub radius_m: f64,
    /// Height, metres.
    pub height_m: f64,
}

/// Gives the text of a mesh file named in a scene; the error says what is wrong with it.
pub type MeshSource<'a> = &'a dyn Fn(&str) -> Result<String, String>;

impl Scene {
    /// The scene in a file, its meshes beside it.
    ///
    /// # Errors
    /// [`SceneError`] for whatever cannot be read, is out of range, or has the robot start in collision.
    pub fn load(path: &Path, hull: Hull) -> Result<Self, SceneError> {
        let file = path.display().to_string();
        let text = bounded_text(path).map_err(|reason| SceneError::File { file: file.clone(), reason })?;
        let folder = path.parent().unwrap_or(Path::new("."));
        Scene::parse(&file, &text, &|mesh| bounded_text(&folder.join(mesh)), hull)
    }

    /// The scene in a text; `file` is its name in errors.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn parse(file: &str, text: &str, meshes: MeshSource<'_>, hull: Hull) -> Result<Self, SceneError> {
        let of_file = |reason| SceneError::File { file: file.to_owned(), reason };
        if text.len() as u64 > N_FILE_BYTES_MAX {
            return Err(of_file(format!("has {} bytes, at most {N_FILE_BYTES_MAX}", text.len())));
        }
        let value: Value = serde_json::from_str(text).map_err(|e| of_file(format!("no valid JSON: {e}")))?;
        let root = Node::root(file, &value);
        if let Some(units) = root.find("units")?
            && units.text(20)? != "m"
        {
            return Err(units.fail(format_args!("is {}, must be \"m\"", units.value())));
        }
        let objects = objects::read(&root, meshes)?;
        let [x_m, y_m, yaw_rad] = root.get("start")?.coordinates()?;
        let [goal_x_m, goal_y_m] = root.get("goal")?.coordinates()?;
        let scene = Scene {
            name: root.text_or_empty("name")?,
            title: root.text_or_empty("title")?,
            source: root.text_or_empty("source")?,
            frame: root.text_or_empty("frame")?,
            floor: read_floor(&root)?,
            walls: root.items_of("walls", N_WALLS_MAX)?.iter().map(read_wall).collect::<Result<_, _>>()?,
            cases: cases::read(&root, &objects)?,
            objects,
            map_from_start: Pose2::new(x_m, y_m, yaw_rad),
            goal_map: Point2::new(goal_x_m, goal_y_m),
            extra: root.others(&[
                "name", "title", "source", "frame", "units", "floor", "walls", "objects", "start", "goal",
                "cases",
            ])?,
        };
        scene.check_start(&root.get("start")?, hull)?;
        Ok(scene)
    }

    fn check_start(&self, start: &Node<'_>, hull: Hull) -> Result<(), SceneError> {
        let at = self.map_from_start.position();
        let told = |gap_m: f64, what: &str| {
            let Hull { radius_m, height_m } = hull;
            let reason = format!(
                "the robot starts in collision with {what}: its centre is {gap_m:.3} m from it, its hull has \
                 a radius of {radius_m} m and a height of {height_m} m"
            );
            Err(start.fail(reason))
        };
        let inside_m = -self.floor.signed_distance_m(at);
        if inside_m <= hull.radius_m {
            return told(inside_m, "the outside of floor.polygon");
        }
        let band = Band::of_hull(hull.height_m);
        let gap_m = Footprint::of(&self.walls, band).distance_m(at);
        if gap_m <= hull.radius_m {
            return told(gap_m, "a wall");
        }
        for object in self.objects.iter().filter(|o| o.kind == Kind::Thing) {
            let gap_m = Footprint::of(&object.solids, band).distance_m(at);
            if gap_m <= hull.radius_m {
                return told(gap_m, &format!("object `{}`", object.id));
            }
        }
        Ok(())
    }

    /// The object with this id.
    #[must_use]
    pub fn object(&self, id: &str) -> Option<&Object> {
        self.objects.iter().find(|o| o.id == id)
    }
}

/// The text of a file of bounded length.
fn bounded_text(path: &Path) -> Result<String, String> {
    let fault = |e: std::io::Error| format!("{}: {e}", path.display());
    let mut bytes = Vec::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(N_FILE_BYTES_MAX + 1).read_to_end(&mut bytes))
        .map_err(fault)?;
    if bytes.len() as u64 > N_FILE_BYTES_MAX {
        return Err(format!("{}: has more than {N_FILE_BYTES_MAX} bytes", path.display()));
    }
    String::from_utf8(bytes).map_err(|e| format!("{}: not UTF-8: {e}", path.display()))
}

fn read_floor(root: &Node<'_>) -> Result<Polygon, SceneError> {
    let node = root.get("floor")?.get("polygon")?;
    let corners = read_outline(&node, 1000)?;
    // Cutting ears also finds an outline that crosses itself.
    crate::triangulate::outline(&corners).map_err(|e| node.fail(e))?;
    Polygon::new(corners).map_err(|e| node.fail(e))
}

/// A list of [x, y].
fn read_outline(node: &Node<'_>, n_max: usize) -> Result<Vec<Point2>, SceneError> {
    let corner = |n: &Node<'_>| n.coordinates::<2>().map(|[x, y]| Point2::new(x, y));
    node.items(n_max)?.iter().map(corner).collect()
}

fn read_wall(node: &Node<'_>) -> Result<Solid, SceneError> {
    let end = |key| node.get(key)?.coordinate();
    let (from, to) = (Point2::new(end("x0")?, end("y0")?), Point2::new(end("x1")?, end("y1")?));
    let height_m = node.get("height")?.number(0.0, 100.0)?;
    let thickness_m = node.get("thickness")?.number(0.0, 100.0)?;
    let along = to - from;
    if along.norm() < 1e-6 || height_m <= 0.0 {
        return Err(
            node.fail(format_args!("is {} m long and {height_m} m high, both must be above 0", along.norm()))
        );
    }
    let middle = nalgebra::center(&from, &to);
    let map_from_shape = Pose2::new(middle.x, middle.y, along.y.atan2(along.x));
    Ok(Solid::cuboid(Placement { map_from_shape, base_m: 0.0 }, [along.norm(), thickness_m, height_m]))
}

/// The mesh under `node`, a path relative to the scene.
fn read_mesh(node: &Node<'_>, meshes: MeshSource<'_>) -> Result<Mesh, SceneError> {
    let path = node.text(1000)?;
    if path.is_empty() || Path::new(&path).is_absolute() {
        return Err(node.fail(format_args!("is {path:?}, must be a path relative to the scene file")));
    }
    let text = meshes(&path).map_err(|reason| node.fail(format_args!("mesh cannot be read: {reason}")))?;
    crate::mesh::parse(&text).map_err(|e| node.fail(format_args!("mesh {path}: {e}")))
}
