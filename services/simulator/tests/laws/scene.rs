//! Scenes are read as the format says, and what is wrong is told with file, object and field.

use geometry::Point2;
use heedway_simulator::scene::{Kind, Scene};
use heedway_simulator::truth::GroundTruth;
use rules::{Relation, RuleType};
use serde_json::{Value, json};

use crate::bodies::{HULL, parse, room, room_with, shipped};

/// Sets the value at a pointer such as `/objects/0/size` and tells what is said about the scene then.
#[track_caller]
fn check(pointer: &str, value: Value, wanted: &[&str]) {
    let mut scene = room();
    scene["objects"] = json!([
        {"id": "desk", "label": "desk", "pose": [3, 2.5, 0, 0], "size": [1, 1, 1]},
        {"id": "lamp", "label": "lamp", "pose": [5, 1, 0, 0], "parts": [
            {"shape": "cylinder", "size": [0.1, 1.5]},
            {"shape": "prism", "pose": [0, 0, 1.5, 0], "size": [1, 1, 0.3], "polygon": [[0, 0], [0.2, 0], [0, 0.2]]}]}
    ]);
    scene["walls"] = json!([{"x0": 0, "y0": 4, "x1": 2, "y1": 4, "height": 2, "thickness": 0.1}]);
    scene["cases"] = json!([{"kind": "k", "say": "Keep off", "rules": [
        {"type": "exclusion", "relation": "near", "obj": "desk", "objects": ["desk"], "buffer_m": 0.3}]}]);
    assert!(parse(&scene).is_ok(), "the scene is good before it is changed");
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    match scene.pointer_mut(parent).unwrap() {
        Value::Object(map) if value == json!("<gone>") => drop(map.remove(key).unwrap()),
        Value::Object(map) => drop(map.insert(key.to_owned(), value)),
        Value::Array(list) => list[key.parse::<usize>().unwrap()] = value,
        _ => unreachable!(),
    }
    let told = parse(&scene).expect_err("must be refused").to_string();
    for word in wanted.iter().chain(&["room.json"]) {
        assert!(told.contains(word), "{told:?} does not say {word:?}");
    }
}

#[test]
fn what_is_missing_is_named() {
    check("/floor", json!("<gone>"), &["`floor` is missing"]);
    check("/floor/polygon", json!("<gone>"), &["floor", "`polygon` is missing"]);
    check("/start", json!("<gone>"), &["`start` is missing"]);
    check("/goal", json!("<gone>"), &["`goal` is missing"]);
    check("/objects/0/id", json!("<gone>"), &["objects[0]", "`id` is missing"]);
    check("/objects/0/label", json!("<gone>"), &["object `desk`", "`label` is missing"]);
    check("/objects/0/pose", json!("<gone>"), &["object `desk`", "`pose` is missing"]);
    check("/objects/0/size", json!("<gone>"), &["object `desk`", "`size` is missing"]);
    check("/objects/1/parts/0/shape", json!("<gone>"), &["object `lamp`", "parts[0]", "`shape` is missing"]);
    check("/objects/1/parts/1/polygon", json!("<gone>"), &["parts[1]", "`polygon` is missing"]);
    check("/walls/0/thickness", json!("<gone>"), &["walls[0]", "`thickness` is missing"]);
    check("/cases/0/say", json!("<gone>"), &["cases[0]", "`say` is missing"]);
    check("/cases/0/rules/0/type", json!("<gone>"), &["cases[0].rules[0]", "`type` is missing"]);
}

#[test]
fn what_is_of_another_sort_is_named() {
    check("/units", json!("cm"), &["units", "\"cm\"", "must be \"m\""]);
    check("/objects", json!({}), &["objects", "is an object, must be a list"]);
    check("/objects/0", json!(7), &["objects[0]", "is a number, must be an object"]);
    check("/objects/0/label", json!(7), &["object `desk`: label", "is a number, must be text"]);
    check("/objects/0/label", json!(" "), &["object `desk`: label", "is empty"]);
    check("/objects/0/pose", json!([1, 2, 3]), &["object `desk`: pose", "has 3 numbers, must have 4"]);
    check("/objects/0/pose", json!([1, 2, 3, "a"]), &["pose[3]", "is text, must be a number"]);
    check("/objects/0/pose", json!([1, 2e6, 3, 0]), &["pose[1]", "is 2000000, must be within -1000 to 1000"]);
    check("/objects/0/kind", json!("rug"), &["object `desk`: kind", "\"rug\"", "floor_area"]);
    check("/objects/0/rgb", json!([1, 2]), &["object `desk`: rgb", "has 2 numbers"]);
    check("/objects/0/rgb", json!([1, 2, 300]), &["rgb[2]", "is 300, must be within 0 to 255"]);
    check("/objects/1/id", json!("desk"), &["objects[1].id", "another object has already"]);
    check(
        "/objects/1/parts/0/shape",
        json!("cone"),
        &["object `lamp`: parts[0].shape", "\"cone\"", "cylinder"],
    );
    check("/objects/1/parts", json!([]), &["object `lamp`: parts", "is empty"]);
    check("/start", json!([1, 1]), &["start", "has 2 numbers, must have 3"]);
    check("/cases/0/rules/0/type", json!("wish"), &["cases[0].rules[0].type", "wish"]);
    check("/cases/0/rules/0/relation", json!("atop"), &["rules[0].relation", "atop"]);
    check("/cases/0/rules/0/objects/0", json!("sofa"), &["rules[0].objects[0]", "\"sofa\"", "no object"]);
}

#[test]
fn shapes_that_enclose_nothing_are_named() {
    check("/objects/0/size", json!([0, 0, 1]), &["object `desk`: size", "not more than one of them 0"]);
    check("/objects/0/size", json!([1, -1, 1]), &["object `desk`: size", "-1"]);
    check("/objects/1/parts/0/size", json!([0, 1]), &["parts[0].size", "must be above 0"]);
    check("/objects/1/parts/1/size", json!([]), &["parts[1].size", "must end with the height"]);
    check("/objects/1/parts/1/polygon", json!([[0, 0], [1, 1]]), &["parts[1].polygon", "2 corners"]);
    let crossed = json!([[0, 0], [2, 2], [2, 0], [0, 1]]);
    check("/objects/1/parts/1/polygon", crossed.clone(), &["parts[1].polygon", "crosses itself"]);
    check("/floor/polygon", crossed, &["floor.polygon", "crosses itself"]);
    check("/walls/0/x1", json!(0), &["walls[0]", "0 m long"]);
}

#[test]
fn a_start_in_collision_names_what_it_collides_with() {
    check("/start", json!([3, 3.2, 0]), &["start", "collision", "object `desk`", "0.200 m", "0.25 m"]);
    check("/start", json!([3, 2.5, 0]), &["start", "object `desk`"]);
    check("/start", json!([0.2, 2, 0]), &["start", "outside of floor.polygon"]);
    check("/start", json!([9, 2, 0]), &["start", "outside of floor.polygon"]);
    check("/start", json!([1, 4.1, 0]), &["start", "a wall"]);
}

#[test]
fn a_start_inside_a_closed_mesh_is_in_collision_although_no_face_is_near() {
    let cube = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv -1 -1 2\nv 1 -1 2\nv 1 1 2\nv -1 1 2\n\
                f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
    let mut value = room();
    value["objects"] = json!([{"id": "cube", "label": "cube", "pose": [3, 2.5, 0, 0.3], "mesh": "cube.obj"}]);
    let read = |start: Value| {
        let mut value = value.clone();
        value["start"] = start;
        Scene::parse("room.json", &value.to_string(), &|_| Ok(cube.to_owned()), HULL)
    };
    assert!(read(json!([1, 1, 0])).is_ok());
    let told = read(json!([3, 2.5, 0])).unwrap_err().to_string();
    assert!(told.contains("collision with object `cube`"), "{told}");
}

#[test]
fn meshes_lie_beside_the_scene_and_what_is_wrong_with_them_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut value = room();
    value["objects"] = json!([{"id": "m", "label": "thing", "pose": [3, 2, 0.5, std::f64::consts::FRAC_PI_2],
        "mesh": "meshes/m.obj", "size": [9, 9, 9], "parts": []}]);
    let file = folder.path().join("scene.json");
    std::fs::write(&file, value.to_string()).unwrap();
    let load = || Scene::load(&file, HULL);
    let told = load().unwrap_err().to_string();
    for word in ["scene.json", "object `m`: mesh", "meshes/m.obj"] {
        assert!(told.contains(word), "{told}");
    }
    std::fs::create_dir(folder.path().join("meshes")).unwrap();
    let obj = folder.path().join("meshes/m.obj");
    std::fs::write(&obj, "v 0 0 0\nf 1 2 3\n").unwrap();
    assert!(load().unwrap_err().to_string().contains("m.obj: line 2"), "the mesh's own error");
    std::fs::write(&obj, [0xff, 0xfe, 0x00]).unwrap();
    assert!(load().unwrap_err().to_string().contains("not UTF-8"));
    std::fs::write(&obj, "v 0 0 0\nv 1 0 0\nv 1 0 1\nf 1 2 3\n").unwrap();
    let scene = load().unwrap();
    // Turned a quarter to the left: the mesh's x is the map's y.
    let surface = scene.objects[0].solids[0].surface();
    let tip = surface[0][2];
    assert!((tip - geometry::Point3::new(3.0, 3.0, 1.5)).norm() < 1e-9, "{tip}");
}

#[test]
fn files_that_are_no_scenes_are_named() {
    let told = Scene::load(std::path::Path::new("/nowhere/s.json"), HULL).unwrap_err().to_string();
    assert!(told.contains("/nowhere/s.json"), "{told}");
    let parse =
        |text: &str| Scene::parse("s.json", text, &|_| Err("none".into()), HULL).unwrap_err().to_string();
    assert!(parse("{").contains("s.json: no valid JSON"));
    assert!(parse("[]").contains("is a list, must be an object"));
    let long = format!("{{\"name\": \"{}\"}}", "x".repeat(17 * 1024 * 1024));
    assert!(parse(&long).contains("at most 16777216"));
    let mut value = room();
    value["objects"] = (0..2001).map(|k| json!({"id": k.to_string()})).collect();
    let told =
        Scene::parse("s.json", &value.to_string(), &|_| Err("none".into()), HULL).unwrap_err().to_string();
    assert!(told.contains("objects: has 2001 elements, at most 2000"), "{told}");
}

#[test]
fn a_scene_of_too_many_triangles_is_refused() {
    let mut obj = String::from("v 0 0 0\nv 1 0 0\nv 1 0 1\n");
    obj.push_str(&"f 1 2 3\n".repeat(120_000));
    let mut value = room();
    let object = |id: &str| json!({"id": id, "label": "heavy", "pose": [3, 2.5, 0, 0], "mesh": "m.obj"});
    value["objects"] = json!([object("a"), object("b")]);
    let told =
        Scene::parse("s.json", &value.to_string(), &|_| Ok(obj.clone()), HULL).unwrap_err().to_string();
    assert!(told.contains("object `b`") && told.contains("240000 triangles, at most 200000"), "{told}");
}

#[test]
fn unknown_keys_are_kept_and_ignored() {
    let mut value = room();
    value["license"] = json!("CC0");
    value["objects"] =
        json!([{"id": "a", "label": "box", "pose": [3, 3, 0, 0], "size": [1, 1, 1], "weight_kg": 3}]);
    value["cases"] = json!([{"say": "hi", "rules": [], "asked_by": "Ann"}]);
    let scene = parse(&value).unwrap();
    assert_eq!(scene.extra["license"], json!("CC0"));
    assert_eq!(scene.objects[0].extra["weight_kg"], json!(3));
    assert_eq!(scene.cases[0].extra["asked_by"], json!("Ann"));
}

#[test]
fn parts_stand_where_their_object_stands_turned_with_it() {
    let scene = room_with(json!([
        {"id": "a", "label": "arm", "kind": "thing", "pose": [3, 2, 0, std::f64::consts::FRAC_PI_2], "parts": [
            {"shape": "box", "pose": [1, 0, 0.1, 0], "size": [0.2, 0.4, 0.3]},
            {"shape": "prism", "pose": [0, 0, 0, 0], "size": [0.2], "polygon": [[0, 0], [0, 0.5], [0.5, 0]]}]}
    ]));
    let truth = GroundTruth::new(&scene, HULL);
    let on = |x, y| truth.clearance_m(Point2::new(x, y)) + 0.25;
    // The box is at (3, 3), its long side along x now.
    assert!(on(3.19, 3.0) < 0.0 && on(3.21, 3.0) > 0.0);
    assert!(on(3.0, 3.09) < 0.0 && on(3.0, 3.11) > 0.0);
    // The prism's corner (0, 0.5) is at (2.5, 2): wound clockwise in the file, and solid all the same.
    assert!(on(2.6, 2.05) < 0.0 && on(2.6, 2.45) > 0.0);
    assert_eq!(scene.objects[0].kind, Kind::Thing);
}

#[test]
fn cases_are_read_with_the_range_that_vague_words_may_take() {
    let scene = shipped("office.json");
    let hybrid = scene.cases.iter().find(|case| case.kind == "hybrid").unwrap();
    assert_eq!(hybrid.rules.len(), 2);
    assert_eq!(hybrid.rules[0].relation, Relation::Beneath);
    assert_eq!(hybrid.rules[1].rule_type, RuleType::Kinematic);
    assert_eq!(hybrid.rules[1].speed_m_s_max, Some(0.5));
    assert!(hybrid.rules[1].accept.as_ref().is_some_and(|range| range["vel_max"] == json!([0.15, 0.75])));
}
