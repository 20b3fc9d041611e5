//! Small scenes for the laws.

use heedway_simulator::scene::{Hull, Scene, SceneError};
use serde_json::{Value, json};

/// The paper's simulated robot.
pub const HULL: Hull = Hull { radius_m: 0.25, height_m: 0.45 };

/// A room of 6 × 5 m around (3, 2.5) without anything in it, start at (1, 1), goal at (5, 4).
pub fn room() -> Value {
    json!({
        "name": "room", "units": "m",
        "floor": {"polygon": [[0, 0], [6, 0], [6, 5], [0, 5]]},
        "objects": [], "start": [1, 1, 0], "goal": [5, 4]
    })
}

/// The room with these objects.
pub fn room_with(objects: Value) -> Scene {
    let mut value = room();
    value["objects"] = objects;
    parse(&value).unwrap()
}

/// A scene that names no meshes.
pub fn parse(value: &Value) -> Result<Scene, SceneError> {
    Scene::parse("room.json", &value.to_string(), &|path| Err(format!("{path}: no meshes here")), HULL)
}

/// A scene that is shipped.
pub fn shipped(name: &str) -> Scene {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
    Scene::load(&folder.join(name), HULL).unwrap()
}
