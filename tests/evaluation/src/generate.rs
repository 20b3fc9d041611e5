//! Scenes from a seed: furnished rooms with a door, and fields of cylinders.
//!
//! A scene is written as the JSON that every scene is written in, so that a failure is replayed from a file. What is
//! drawn is thrown away until the checker finds its case worth playing; the number of the draw is part of
//! the name. Deliberately not here: playing.

use anyhow::bail;
use geometry::Profile;
use heedway_simulator::scene::{Hull, Scene};
use heedway_simulator::sensor_noise::draws;
use rand::RngExt;
use rand_xoshiro::Xoshiro256PlusPlus;
use serde_json::{Value, json};

use crate::check::Survey;

/// Most draws until a good one.
const N_DRAWS_MAX: u64 = 400;

/// What is generated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Sort {
    /// A furnished room, a wall with a door, a rule about one thing in it.
    Room,
    /// Cylinders at random, as in the BARN benchmark; one of them is to be kept away from.
    Cylinders,
}

/// The scene of a seed, with its text.
///
/// # Errors
/// When no draw is worth playing, or a draw cannot be read: then the generator is wrong.
pub fn scene(sort: Sort, seed: u64, profile: &Profile) -> anyhow::Result<(Scene, String)> {
    let hull = Hull { radius_m: profile.radius_m, height_m: profile.height_m };
    for draw in 0..N_DRAWS_MAX {
        let mut random = draws(seed, "generated scene", draw);
        let value = match sort {
            Sort::Room => room(&mut random, seed),
            Sort::Cylinders => cylinders(&mut random, seed),
        };
        let text = serde_json::to_string_pretty(&value)?;
        // What starts in collision is one of the draws that are thrown away.
        let Ok(scene) = Scene::parse("generated", &text, &|_| Err("no meshes".into()), hull) else {
            continue;
        };
        let survey = Survey::new(&scene, profile)?;
        let is_good = scene.cases.iter().all(|case| survey.check(case).refused.is_empty());
        if is_good && !scene.cases.is_empty() {
            return Ok((scene, text));
        }
    }
    bail!("seed {seed}: none of {N_DRAWS_MAX} draws is worth playing")
}

type Random = Xoshiro256PlusPlus;

fn within(random: &mut Random, low: f64, high: f64) -> f64 {
    // To the centimetre: what is written is what is played.
    ((low + (high - low) * random.random::<f64>()) * 100.0).round() / 100.0
}

fn pick<'a, T>(random: &mut Random, from: &'a [T]) -> Option<&'a T> {
    from.get((random.random::<f64>() * from.len() as f64) as usize)
}

/// Walls around a floor, 10 cm thick, 2.6 m high.
fn walls_around(width_m: f64, depth_m: f64) -> Vec<Value> {
    let wall = |x0: f64, y0: f64, x1: f64, y1: f64| wall_of([x0, y0, x1, y1]);
    vec![
        wall(-0.05, 0.0, -0.05, depth_m),
        wall(width_m + 0.05, 0.0, width_m + 0.05, depth_m),
        wall(-0.1, -0.05, width_m + 0.1, -0.05),
        wall(-0.1, depth_m + 0.05, width_m + 0.1, depth_m + 0.05),
    ]
}

fn wall_of([x0, y0, x1, y1]: [f64; 4]) -> Value {
    json!({ "x0": x0, "y0": y0, "x1": x1, "y1": y1, "height": 2.6, "thickness": 0.1 })
}

/// A table top on four legs, its middle at the origin.
fn table(width_m: f64, depth_m: f64, height_m: f64) -> Value {
    let (x, y) = (width_m / 2.0 - 0.05, depth_m / 2.0 - 0.05);
    let leg = |sx: f64, sy: f64| json!({ "shape": "box", "pose": [sx * x, sy * y, 0.0, 0.0], "size": [0.06, 0.06, height_m - 0.04] });
    json!([
        { "shape": "box", "pose": [0.0, 0.0, height_m - 0.04, 0.0], "size": [width_m, depth_m, 0.04] },
        leg(1.0, 1.0),
        leg(-1.0, 1.0),
        leg(-1.0, -1.0),
        leg(1.0, -1.0)
    ])
}

/// The thing that the rule is about, on the way, and the case.
fn subject(random: &mut Random, x_m: f64, y_m: f64) -> (Value, Value) {
    let word = pick(random, &["rug", "table", "vase", "crib", "puddle"]).copied().unwrap_or("rug");
    let flat = |label: &str, size: [f64; 2]| {
        json!({ "id": "subject", "label": label, "pose": [x_m, y_m, 0.0, 0.0], "size": [size[0], size[1], 0.0],
                "kind": "floor_area" })
    };
    let rule = |kind: &str, relation: &str, buffer_m: f64, limit: Option<f64>| {
        json!({ "type": kind, "relation": relation, "obj": word, "objects": ["subject"], "buffer_m": buffer_m,
                "vel_max": limit, "ang_vel_max": null })
    };
    let case = |kind: &str, say: String, rule: Value| json!({ "kind": kind, "say": say, "rules": [rule], "why_it_matters": "drawn from a seed" });
    match word {
        "table" => {
            let (width_m, depth_m) = (within(random, 0.8, 1.1), within(random, 1.3, 1.9));
            let parts = table(width_m, depth_m, within(random, 0.68, 0.95));
            let thing =
                json!({ "id": "subject", "label": "table", "pose": [x_m, y_m, 0.0, 0.0], "parts": parts });
            let say = "Don't go under the table".to_owned();
            (thing, case("spatial_relation", say, rule("exclusion", "beneath", 0.0, None)))
        }
        "vase" => {
            let buffer_m = within(random, 0.5, 0.8);
            let parts = json!([{ "shape": "cylinder", "size": [within(random, 0.12, 0.25), within(random, 0.5, 1.0)] }]);
            let thing =
                json!({ "id": "subject", "label": "vase", "pose": [x_m, y_m, 0.0, 0.0], "parts": parts });
            let say = format!("Keep {buffer_m} m away from the vase");
            (thing, case("exclusion_zone", say, rule("exclusion", "near", buffer_m, None)))
        }
        "crib" => {
            let thing = json!({ "id": "subject", "label": "crib", "pose": [x_m, y_m, 0.0, within(random, 0.0, 3.1)],
                                "size": [1.2, 0.65, 0.95] });
            let say = "Drive at most 0.5 m/s within 1 m of the crib".to_owned();
            (thing, case("pace", say, rule("kinematic", "near", 1.0, Some(0.5))))
        }
        _ => {
            let size = [within(random, 0.8, 1.8), within(random, 1.0, 2.0)];
            (
                flat(word, size),
                case("exclusion_zone", format!("Stay off the {word}"), rule("exclusion", "on", 0.0, None)),
            )
        }
    }
}

/// Furniture that stands about: label, plan, height; a table has legs.
const FURNITURE: [(&str, f64, f64, f64); 8] = [
    ("sofa", 2.0, 0.9, 0.8),
    ("bookshelf", 1.0, 0.32, 1.8),
    ("armchair", 0.85, 0.85, 0.85),
    ("chest", 0.9, 0.45, 0.7),
    ("stool", 0.4, 0.4, 0.62),
    ("plant", 0.5, 0.5, 1.3),
    ("desk", 1.4, 0.7, 0.74),
    ("box", 0.5, 0.4, 0.35),
];

fn room(random: &mut Random, seed: u64) -> Value {
    let (width_m, depth_m) = (within(random, 8.0, 11.0), within(random, 4.5, 7.0));
    let (door_x_m, door_y_m) = (within(random, 5.0, width_m - 2.0), within(random, 1.0, depth_m - 1.0));
    let half_m = within(random, 0.42, 0.49);
    let mut walls = walls_around(width_m, depth_m);
    walls.push(wall_of([door_x_m, 0.0, door_x_m, door_y_m - half_m]));
    walls.push(wall_of([door_x_m, door_y_m + half_m, door_x_m, depth_m]));
    let start_y_m = within(random, 1.0, depth_m - 1.0);
    let goal = [width_m - 0.8, within(random, 0.8, depth_m - 0.8)];
    // Somewhere on the straight line from the start to the door.
    let share = within(random, 0.45, 0.75);
    let subject_at = (0.9 + share * (door_x_m - 0.9), start_y_m + share * (door_y_m - start_y_m));
    let aside_m = within(random, -0.3, 0.3);
    let (thing, case) = subject(random, subject_at.0, subject_at.1 + aside_m);
    let mut objects = vec![thing];
    let n_objects = 4 + (random.random::<f64>() * 7.0) as usize;
    for idx in 0..n_objects {
        let Some((label, x_size_m, y_size_m, height_m)) = pick(random, &FURNITURE).copied() else { continue };
        let reach_m = f64::hypot(x_size_m, y_size_m) / 2.0;
        let at = [within(random, reach_m, width_m - reach_m), within(random, reach_m, depth_m - reach_m)];
        let is_near = |x: f64, y: f64, gap_m: f64| f64::hypot(at[0] - x, at[1] - y) < reach_m + gap_m;
        if is_near(0.9, start_y_m, 0.6)
            || is_near(goal[0], goal[1], 0.6)
            || is_near(door_x_m, door_y_m, 1.0)
            || is_near(subject_at.0, subject_at.1, 1.0)
        {
            continue;
        }
        let pose = [at[0], at[1], 0.0, within(random, 0.0, 3.1)];
        let mut thing = json!({ "id": format!("{label}-{idx}"), "label": label, "pose": pose });
        if label == "desk" {
            thing["parts"] = table(x_size_m, y_size_m, height_m);
        } else {
            thing["size"] = json!([x_size_m, y_size_m, height_m]);
        }
        objects.push(thing);
    }
    let yaw_rad = (subject_at.1 - start_y_m).atan2(subject_at.0 - 0.9);
    json!({
        "name": format!("room-{seed}"), "title": "A room drawn from a seed", "units": "m",
        "floor": { "polygon": [[0.0, 0.0], [width_m, 0.0], [width_m, depth_m], [0.0, depth_m]] },
        "walls": walls, "objects": objects, "cases": [case],
        "start": [0.9, start_y_m, (yaw_rad * 100.0).round() / 100.0], "goal": goal
    })
}

fn cylinders(random: &mut Random, seed: u64) -> Value {
    let (width_m, depth_m) = (10.0, 5.0);
    let (start, goal) = ([0.8, within(random, 1.0, 4.0)], [9.2, within(random, 1.0, 4.0)]);
    let mut placed: Vec<(f64, f64, f64)> = Vec::new();
    for _ in 0..120 {
        let (x, y, radius_m) =
            (within(random, 1.6, 8.4), within(random, 0.2, 4.8), within(random, 0.08, 0.3));
        let gap_m = |(a, b, other_m): &(f64, f64, f64)| f64::hypot(x - a, y - b) - radius_m - other_m;
        if placed.iter().all(|other| gap_m(other) > 0.85) {
            placed.push((x, y, radius_m));
        }
    }
    let middle = (width_m / 2.0, f64::midpoint(start[1], goal[1]));
    let to_middle = |&(x, y, _): &(f64, f64, f64)| f64::hypot(x - middle.0, y - middle.1);
    let nearest = placed.iter().enumerate().min_by(|a, b| to_middle(a.1).total_cmp(&to_middle(b.1)));
    let subject = nearest.map_or(0, |(idx, _)| idx);
    let objects: Vec<Value> = placed
        .iter()
        .enumerate()
        .map(|(idx, (x, y, radius_m))| {
            let label = if idx == subject { "barrel" } else { "post" };
            json!({ "id": format!("c{idx}"), "label": label, "pose": [x, y, 0.0, 0.0],
                    "parts": [{ "shape": "cylinder", "size": [radius_m, 1.2] }] })
        })
        .collect();
    let buffer_m = within(random, 0.45, 0.7);
    let rule = json!({ "type": "exclusion", "relation": "near", "obj": "barrel", "objects": [format!("c{subject}")],
                       "buffer_m": buffer_m, "vel_max": null, "ang_vel_max": null });
    json!({
        "name": format!("cylinders-{seed}"), "title": "Cylinders drawn from a seed", "units": "m",
        "floor": { "polygon": [[0.0, 0.0], [width_m, 0.0], [width_m, depth_m], [0.0, depth_m]] },
        "walls": walls_around(width_m, depth_m), "objects": objects,
        "cases": [{ "kind": "exclusion_zone", "say": format!("Keep {buffer_m} m away from the barrel"),
                    "rules": [rule], "why_it_matters": "drawn from a seed" }],
        "start": [start[0], start[1], 0.0], "goal": goal
    })
}
