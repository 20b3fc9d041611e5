//! Real RGB-D through semantics with real models: a dining room with a table, its chairs and an armchair.
//!
//! The recording and the models are not part of the product. Without them, or without ONNX Runtime, each test
//! says that it skipped. The places were measured in the recording's own depth, by hand, in `map`: it begins
//! under the first camera and looks where that looks (x ahead, y left).

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::path::{Path, PathBuf};

use geometry::Profile;
use heedway_perception::ground::summary::{RuleSummary, Summary};
use heedway_perception::ground::{Options, run};
use heedway_perception::semantics::Settings;
use heedway_perception::semantics::models::COCO;
use heedway_perception::semantics::models::configured::LocalModels;
use heedway_perception::semantics::models::folder::{library_for, yolo_in};
use heedway_perception::semantics::models::runtime::Runtime;
use heedway_perception::semantics::models::yolo::Yolo;
use proto::Grounding;
use rules::{Relation, Rule};

const RECORDING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/rgbd/dining-room");
const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/models");

/// Opens the real models; says why when it cannot.
fn models() -> Option<LocalModels> {
    let folder = Path::new(MODELS);
    if !folder.exists() || !Path::new(RECORDING).exists() {
        eprintln!("SKIPPED: no recording or no models on this machine");
        return None;
    }
    let library = library_for(folder);
    if library.library.as_os_str().is_empty() && std::env::var_os("ORT_DYLIB_PATH").is_none() {
        eprintln!("SKIPPED: no ONNX Runtime; set ORT_DYLIB_PATH to its library");
        return None;
    }
    Some(LocalModels::open_yolo(&library, &yolo_in(folder).unwrap()).unwrap())
}

fn rule(id: &str, relation: Relation, obj: &str, reference: &str) -> Rule {
    Rule { id: id.to_owned(), reference: reference.to_owned(), ..Rule::exclusion(relation, obj) }
}

fn ground(models: &LocalModels, rules: Vec<Rule>, n_frames_max: usize) -> (Summary, tempfile::TempDir) {
    let out = tempfile::tempdir().unwrap();
    let options = Options {
        rgbd: PathBuf::from(RECORDING),
        out: out.path().to_owned(),
        rules,
        gravity: None,
        profile: Profile::turtlebot2(),
        settings: Settings { n_masks_agreeing: 1, ..Settings::default() },
        n_frames_max,
    };
    let summary = run(&options, |frame, phrases| models.answer_now(frame, phrases)).unwrap();
    (summary, out)
}

/// Occupied cells of a rule's image as points in `map`.
fn occupied(rule: &RuleSummary, out: &Path) -> Vec<[f64; 2]> {
    let region = rule.region.as_ref().unwrap_or_else(|| panic!("{:?}: no region", rule.rule.obj));
    let image = std::fs::read(out.join(&region.pgm)).unwrap();
    let yaml = std::fs::read_to_string(out.join(&region.yaml)).unwrap();
    let numbers = |key: &str| -> Vec<f64> {
        let line = yaml.lines().find_map(|line| line.strip_prefix(key)).unwrap();
        line.trim_matches([' ', ':', '[', ']']).split(',').map(|n| n.trim().parse().unwrap()).collect()
    };
    let (resolution_m, origin) = (numbers("resolution")[0], numbers("origin"));
    let header = String::from_utf8_lossy(&image[..image.len().min(40)]).into_owned();
    let mut words = header.split_ascii_whitespace().skip(1);
    let mut side = || words.next().unwrap().parse::<usize>().unwrap();
    let (width, height) = (side(), side());
    let pixels = &image[image.len() - width * height..];
    let mut points = Vec::new();
    for (idx, _) in pixels.iter().enumerate().filter(|(_, value)| **value == 0) {
        let (col, row) = ((idx % width) as f64, (height - 1 - idx / width) as f64);
        points.push([origin[0] + (col + 0.5) * resolution_m, origin[1] + (row + 0.5) * resolution_m]);
    }
    points
}

/// Whether a disc around a place is covered by at least this share, of 10 cm squares.
fn covered(points: &[[f64; 2]], place: [f64; 2], radius_m: f64) -> f64 {
    let (mut n, mut n_covered) = (0, 0);
    let steps = (radius_m / 0.1).ceil() as i32;
    for (i, j) in (-steps..=steps).flat_map(|i| (-steps..=steps).map(move |j| (i, j))) {
        let (x, y) = (f64::from(i) * 0.1, f64::from(j) * 0.1);
        if x.hypot(y) > radius_m {
            continue;
        }
        n += 1;
        let is_near =
            |p: &&[f64; 2]| (p[0] - place[0] - x).abs() <= 0.05 && (p[1] - place[1] - y).abs() <= 0.05;
        n_covered += i32::from(points.iter().find(is_near).is_some());
    }
    f64::from(n_covered) / f64::from(n)
}

#[test]
fn the_table_and_the_chairs_of_a_real_room_are_found_where_they_are() {
    let Some(models) = models() else { return };
    let rules =
        vec![rule("s1", Relation::Beneath, "table", "table"), rule("s2", Relation::Near, "chair", "chairs")];
    let (summary, out) = ground(&models, rules, 40);
    // The camera was held at about 1.4 m and looked a little down.
    assert!((1.25..1.55).contains(&summary.floor.camera_height_m), "{:?}", summary.floor);
    assert!(summary.floor.up_world[1] < -0.9, "{:?}", summary.floor);
    assert!(summary.frames.iter().all(|f| f.left_out.is_none() && f.trouble.is_none()));
    let [table, chairs] = &summary.rules[..] else { panic!("two rules") };
    for found in [table, chairs] {
        assert_eq!(found.grounding, Grounding::Grounded, "{}", found.remark);
    }
    let (table, chairs) = (occupied(table, out.path()), occupied(chairs, out.path()));
    // The middle of the dining table, and the free carpet to its left, which the robot may use.
    assert!(covered(&table, [2.1, -0.4], 0.4) > 0.9, "{}", covered(&table, [2.1, -0.4], 0.4));
    assert!(covered(&table, [2.8, 0.9], 0.3) < 0.05, "{}", covered(&table, [2.8, 0.9], 0.3));
    // The three chairs on its left side, the armchair ahead; the carpet between, and the wall far left, not.
    for chair in [[1.35, -0.1], [1.9, 0.2], [2.55, 0.3], [4.6, 1.2]] {
        assert!(covered(&chairs, chair, 0.15) > 0.3, "{chair:?} {}", covered(&chairs, chair, 0.15));
    }
    for free in [[3.4, 0.9], [2.5, 1.2], [5.8, 2.4]] {
        assert!(covered(&chairs, free, 0.25) < 0.1, "{free:?} {}", covered(&chairs, free, 0.25));
    }
}

#[test]
fn one_frame_is_enough_and_what_no_model_knows_stays_ungrounded() {
    let Some(models) = models() else { return };
    let rules = vec![
        rule("s1", Relation::Beneath, "table", "table"),
        rule("s2", Relation::Near, "fire extinguisher", "fire extinguisher"),
        rule("s3", Relation::Near, "sofa", "red sofa"),
        rule("s4", Relation::Near, "dog", "dog"),
    ];
    let (summary, out) = ground(&models, rules, 1);
    assert_eq!(summary.frames.len(), 1);
    let [table, extinguisher, sofa, dog] = &summary.rules[..] else { panic!("four rules") };
    assert_eq!(table.grounding, Grounding::Grounded);
    assert!(covered(&occupied(table, out.path()), [2.1, -0.4], 0.4) > 0.9);
    assert_eq!((extinguisher.grounding, extinguisher.region.is_none()), (Grounding::Searching, true));
    assert!(extinguisher.remark.contains("know no"), "{}", extinguisher.remark);
    // The couch is behind the table in this frame, or not found; it is never said to be the red one.
    assert_ne!(sofa.grounding, Grounding::Grounded);
    assert_eq!((dog.grounding, dog.region.is_none()), (Grounding::Searching, true));
}

#[test]
fn a_smaller_member_of_the_family_with_other_shapes_sees_the_same_chairs() {
    if models().is_none() {
        return;
    }
    let runtime = Runtime::load(&library_for(Path::new(MODELS))).unwrap();
    let labels: Vec<String> = COCO.lines().map(str::to_owned).collect();
    let picture = image::open(Path::new(RECORDING).join("color_1.png")).unwrap().into_rgb8();
    let chairs = |file: &str| -> Vec<Vec<bool>> {
        let model = runtime.open(&Path::new(MODELS).join(file)).unwrap();
        let all = Yolo::new(model, labels.clone(), 0.4).unwrap().instances(&picture).unwrap();
        all.into_iter().filter(|i| labels[i.class_idx] == "chair").map(|i| i.mask).collect()
    };
    let (large, small) = (chairs("yolov7-seg-640x480-w8.onnx"), chairs("yolov8n-seg-w8.onnx"));
    assert!(large.len() >= 6 && small.len() >= 4, "{} and {}", large.len(), small.len());
    let iou = |a: &[bool], b: &[bool]| {
        let both = a.iter().zip(b).filter(|(a, b)| **a && **b).count() as f64;
        both / a.iter().zip(b).filter(|(a, b)| **a || **b).count().max(1) as f64
    };
    let n_same = small.iter().filter(|s| large.iter().any(|l| iou(s, l) > 0.6)).count();
    assert!(n_same >= 3, "{n_same} of {} chairs are the same", small.len());
}
