//! The oracle answers as models would.

use std::collections::{BTreeMap, BTreeSet};

use geometry::Profile;
use heedway_simulator::oracle_models::{Heat, ModelErrors, Oracle};
use heedway_simulator::raycast::{INSTANCE_OBJECTS, InstanceImage, RayCaster};
use heedway_simulator::scene::Scene;

use crate::bodies::shipped;

fn office() -> (Scene, InstanceImage) {
    let scene = shipped("office.json");
    let camera = Profile::sim().camera;
    let map_from_camera = scene.map_from_start.lifted(0.0) * camera.base_from_camera();
    let seen = RayCaster::new(&scene).unwrap().image(&map_from_camera, &camera.intrinsics, 6.0).seen;
    (scene, seen)
}

fn instance_of(scene: &Scene, id: &str) -> u16 {
    INSTANCE_OBJECTS + scene.objects.iter().position(|o| o.id == id).unwrap() as u16
}

fn phrases(list: &[&str]) -> Vec<String> {
    list.iter().map(|p| (*p).to_owned()).collect()
}

/// Mean heat of one map over the pixels of an instance, 0 to 1.
fn mean_heat(heat: &Heat, map: usize, seen: &InstanceImage, instance: u16) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (idx, _) in seen.instances.iter().enumerate().filter(|(_, i)| **i == instance) {
        let (u, v) = (idx as u32 % seen.width, idx as u32 / seen.width);
        let cell = (v * heat.height / seen.height) * heat.width + u * heat.width / seen.width;
        sum += f64::from(heat.values[map * (heat.width * heat.height) as usize + cell as usize]) / 255.0;
        n += 1.0;
    }
    assert!(n > 0.0, "the instance is in the picture");
    sum / n
}

#[test]
fn without_errors_segments_are_the_visible_instances_with_exact_borders() {
    let (scene, seen) = office();
    let panoptic = Oracle::new(&scene, ModelErrors::default(), 1).segments(&seen, 1);
    let mut instances_of_label: BTreeMap<u16, BTreeSet<u16>> = BTreeMap::new();
    for (label, instance) in panoptic.labels.iter().zip(&seen.instances) {
        instances_of_label.entry(*label).or_default().insert(*instance);
    }
    assert!(instances_of_label.values().all(|instances| instances.len() == 1), "one label, one instance");
    let visible: BTreeSet<u16> = seen.instances.iter().copied().filter(|i| *i != 0).collect();
    assert_eq!(usize::from(panoptic.n_segments), visible.len());
    let labels: BTreeSet<u16> = panoptic.labels.iter().copied().filter(|l| *l != 0).collect();
    assert_eq!(labels, (1..=panoptic.n_segments).collect());
}

#[test]
fn a_heat_map_is_coarse_and_hot_on_what_is_meant_only() {
    let (scene, seen) = office();
    let heat =
        Oracle::new(&scene, ModelErrors::default(), 1).heat(&seen, 1, &phrases(&["standing desk", "piano"]));
    assert_eq!((heat.width, heat.height, heat.values.len()), (88, 66, 2 * 88 * 66));
    let of = |map, id| mean_heat(&heat, map, &seen, instance_of(&scene, id));
    assert!(of(0, "standing-desk") > 0.5, "{}", of(0, "standing-desk"));
    assert!(of(0, "filing-cabinet") < 0.1 && of(0, "bookshelf") < 0.1);
    assert!(heat.values[88 * 66..].iter().all(|v| *v == 0), "no piano anywhere");
    // Blurred: the map has values between hot and cold.
    assert!(heat.values.iter().filter(|v| (20..235).contains(*v)).count() > 200);
}

#[test]
fn errors_come_at_their_rates_and_from_the_seed() {
    let (scene, seen) = office();
    let errors = ModelErrors { missed: 0.3, wrong: 0.2, split: 0.5 };
    let oracle = Oracle::new(&scene, errors, 9);
    let desk = instance_of(&scene, "standing-desk");
    let others: Vec<u16> =
        ["filing-cabinet", "bookshelf", "rug", "monitor-1", "monitor-2", "whiteboard", "water-cooler"]
            .iter()
            .map(|id| instance_of(&scene, id))
            .collect();
    let n = 200;
    let (mut n_missed, mut n_wrong, mut n_split) = (0, 0, 0);
    let plain = Oracle::new(&scene, ModelErrors::default(), 9).segments(&seen, 1).n_segments;
    for frame in 0..n {
        let heat = oracle.heat(&seen, frame, &phrases(&["standing desk"]));
        n_missed += u32::from(mean_heat(&heat, 0, &seen, desk) < 0.3);
        n_wrong += u32::from(others.iter().any(|i| mean_heat(&heat, 0, &seen, *i) > 0.4));
        n_split += u32::from(oracle.segments(&seen, frame).n_segments) - u32::from(plain);
    }
    let share = |count: u32| f64::from(count) / n as f64;
    assert!((share(n_missed) - 0.3).abs() < 0.1, "{n_missed}");
    // Some of the wrong ones are too small in the picture to be seen in the map.
    assert!((0.05..0.27).contains(&share(n_wrong)), "{n_wrong}");
    assert!((share(n_split) / f64::from(plain) - 0.5).abs() < 0.1, "{n_split}");
    let again = Oracle::new(&scene, errors, 9);
    assert_eq!(oracle.heat(&seen, 5, &phrases(&["desk"])), again.heat(&seen, 5, &phrases(&["desk"])));
    assert_eq!(oracle.segments(&seen, 5), again.segments(&seen, 5));
}
