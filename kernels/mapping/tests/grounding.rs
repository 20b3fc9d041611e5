//! From pictures to footprints: the whole chain against rendered scenes whose truth is known.

#[cfg(test)]
mod render;

#[cfg(test)]
mod tests {
    use geometry::{CameraIntrinsics, Point2, Pose2, Pose3};
    use mapping::floor_area::{FloorArea, FloorConfig, ObjectKind, object_kind};
    use mapping::morphology::groups;
    use mapping::obstacle_layer::{ObstacleConfig, ObstacleLayer};
    use mapping::occupancy::{Closing, HeightBand, Relation, footprint, footprint_seen_from};
    use mapping::projection::{DepthLimits, project};
    use mapping::tsdf::{Tsdf, TsdfConfig};
    use mapping::{Fusion, Grid, Layout, Mask, fuse};

    use crate::render::{Image, Scene, iou, looking};

    const THING: u16 = 3;
    const OTHER: u16 = 7;
    const BAND: HeightBand = HeightBand { robot_height_m: 0.45 };

    fn table_at() -> Pose2 {
        Pose2::new(0.3, 0.2, 0.3)
    }

    /// A table with a chair of another kind beside it.
    fn office() -> Scene {
        let mut scene = Scene::room();
        scene.add_table(THING, table_at(), [1.6, 0.8], 0.72);
        scene.add_chair(OTHER, Pose2::new(-1.6, 0.6, 1.0));
        scene
    }

    /// A drive of 4.4 m past the middle of the room, 1.8 m beside it, with the camera turned to it.
    fn drive(height_m: f64, down_rad: f64) -> impl Iterator<Item = Pose3> {
        (0..12).map(move |step| {
            let at = Point2::new(-2.6 + 0.4 * f64::from(step), -1.6 - 0.05 * f64::from(step));
            looking(at, height_m, Point2::new(0.3, 0.2), down_rad)
        })
    }

    /// Looks for what has this label in one image, as perception does.
    fn look(tsdf: &mut Tsdf, image: &Image, label: u16) {
        match fuse(&image.heat(label), &image.segments(), Fusion::default()) {
            Some(fused) => tsdf.integrate(&image.frame(), Some(&fused.mask)).unwrap(),
            None => tsdf.observe_absent(&image.frame()).unwrap(),
        };
    }

    fn empty() -> Tsdf {
        Tsdf::new(TsdfConfig::default()).unwrap()
    }

    fn found(tsdf: &Tsdf, relation: Relation) -> Grid<bool> {
        footprint(&tsdf.covered_points(), relation, BAND, &Closing::default()).unwrap()
    }

    /// A map for a failure's message: `#` right, `+` too much, `-` missing.
    fn drawn(found: &Grid<bool>, truth: impl Fn(Point2) -> bool) -> String {
        let mut text = String::new();
        for row in -20..36 {
            for col in -50..50 {
                let p = Point2::new(f64::from(col) * 0.05 + 0.025, f64::from(row) * 0.05 + 0.025);
                text.push(match (found.at(p) == Some(&true), truth(p)) {
                    (true, true) => '#',
                    (true, false) => '+',
                    (false, true) => '-',
                    (false, false) => '.',
                });
            }
            text.push('\n');
        }
        text
    }

    #[track_caller]
    fn check_beneath(scene: &Scene, camera: (f64, f64), noise_seed: Option<u64>, iou_min: f64) {
        let mut tsdf = empty();
        for (idx, pose) in drive(camera.0, camera.1).enumerate() {
            let image = scene.render(pose);
            let image = match noise_seed {
                Some(seed) => image.with_noise(seed + idx as u64),
                None => image,
            };
            look(&mut tsdf, &image, THING);
        }
        let found = found(&tsdf, Relation::Beneath);
        let truth = |p| scene.covers(THING, BAND.robot_height_m, p);
        let share = iou(&found, truth);
        assert!(share >= iou_min, "IoU {share:.3} < {iou_min}, {noise_seed:?}\n{}", drawn(&found, truth));
        // What is 10 cm off the table is not covered.
        for cell in found.layout().cells().filter(|&c| *found.get(c)) {
            let p = found.layout().centre(cell);
            let near = (-2..=2).any(|x| {
                (-2..=2).any(|y| truth(p + nalgebra::Vector2::new(f64::from(x), f64::from(y)) * 0.06))
            });
            assert!(near, "{p} is covered\n{}", drawn(&found, truth));
        }
    }

    #[test]
    fn beneath_a_table_is_covered_by_a_camera_above_it() {
        check_beneath(&office(), (1.1, 0.3), None, 0.85);
    }

    #[test]
    fn beneath_a_table_is_covered_by_a_camera_below_it() {
        check_beneath(&office(), (0.35, 0.0), None, 0.85);
    }

    #[test]
    fn beneath_a_table_is_covered_by_a_camera_at_the_height_of_its_top() {
        // All that is seen is the edge of a top that is thinner than a voxel, which a layer of voxels may miss.
        for height_m in [0.70, 0.71, 0.72, 0.73, 0.74] {
            let mut scene = Scene::room();
            scene.add_table(THING, table_at(), [1.6, 0.8], height_m);
            check_beneath(&scene, (height_m - 0.01, 0.0), None, 0.65);
            check_beneath(&scene, (height_m - 0.01, 0.0), Some(100), 0.65);
        }
    }

    #[test]
    fn a_table_is_covered_by_a_small_camera_far_below_its_top() {
        // A row of its pixels on the underside is as long as two voxels, and the last one is an edge. On each lattice of
        // voxels that there can be.
        let camera = CameraIntrinsics { width: 160, height: 120, fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5 };
        let mut shares = Vec::new();
        for (n_cm, aside_m) in [(72, 0.0), (73, 0.3), (74, 0.0), (75, 0.3), (74, 0.5), (73, 0.0)] {
            let mut scene = Scene::room();
            scene.add_table(THING, Pose2::new(1.0, aside_m, 0.0), [0.6, 1.2], 0.01 * f64::from(n_cm));
            let mut tsdf = empty();
            for step in 0..8 {
                let at = Point2::new(-1.4 + 0.1 * f64::from(step), 0.0);
                let image = scene.render_by(camera, looking(at, 0.4, Point2::new(1.0, 0.0), 0.0));
                let seen = image.labels.iter().map(|label| *label == THING).collect();
                let mask = Mask::new(camera.width, camera.height, seen).unwrap();
                tsdf.integrate(&image.frame(), Some(&mask)).unwrap();
            }
            let found = found(&tsdf, Relation::Near);
            let truth = |p| scene.covers(THING, 0.0, p);
            let share = iou(&found, truth);
            assert!(share > 0.7, "{n_cm} cm high: {share:.3}\n{}", drawn(&found, truth));
            shares.push(share);
        }
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        assert!(mean > 0.8, "{mean:.3} of {shares:.3?}");
    }

    #[test]
    fn beneath_a_table_is_covered_in_noise_from_above_and_below() {
        for seed in [1, 2] {
            check_beneath(&office(), (1.1, 0.3), Some(100 * seed), 0.75);
            check_beneath(&office(), (0.35, 0.0), Some(100 * seed), 0.75);
        }
    }

    #[test]
    fn beneath_a_standing_desk_is_covered() {
        let mut scene = Scene::room();
        scene.add_table(THING, Pose2::new(0.2, 0.4, -0.4), [1.4, 0.7], 1.05);
        check_beneath(&scene, (0.35, -0.1), None, 0.8);
    }

    #[test]
    fn three_chairs_are_three_footprints() {
        let mut scene = Scene::room();
        let chairs = [(-0.9, 0.3, 0.0), (0.2, 0.2, 1.2), (1.3, 0.4, 2.5)];
        for (idx, (x, y, yaw)) in chairs.into_iter().enumerate() {
            scene.add_chair(THING + idx as u16, Pose2::new(x, y, yaw));
        }
        let mut tsdf = empty();
        for pose in drive(0.8, 0.2) {
            // One phrase, hot on all three; three segments.
            let image = scene.render(pose);
            let heat = crate::render::coarse_heat(320, 240, |idx| image.labels[idx] >= THING);
            let fused = fuse(&heat, &image.segments(), Fusion::default()).unwrap();
            tsdf.integrate(&image.frame(), Some(&fused.mask)).unwrap();
        }
        let found = found(&tsdf, Relation::Near);
        let truth = |p| (0..3).any(|idx| scene.covers(THING + idx, 0.0, p));
        assert_eq!(groups(&found, 0.0).len(), 3, "\n{}", drawn(&found, truth));
        let share = iou(&found, truth);
        assert!(share > 0.6, "IoU {share:.3}\n{}", drawn(&found, truth));
        for (x, y, _) in chairs {
            assert_eq!(found.at(Point2::new(x, y)), Some(&true), "\n{}", drawn(&found, truth));
        }
    }

    #[test]
    fn a_chair_that_was_moved_is_only_where_it_is_now() {
        // Turned in many ways: what is seen of it, and what hides the rest, differs.
        for turn in 0..12 {
            let (was, is) = (Point2::new(-0.5, 0.3), Point2::new(1.2 - 0.05 * f64::from(turn % 4), 0.5));
            let yaw = 0.5 * f64::from(turn);
            let (mut before, mut after) = (Scene::room(), Scene::room());
            before.add_chair(THING, Pose2::new(was.x, was.y, 0.4 + yaw));
            after.add_chair(THING, Pose2::new(is.x, is.y, yaw));
            let mut tsdf = empty();
            for pose in drive(0.8, 0.2) {
                look(&mut tsdf, &before.render(pose), THING);
            }
            // Two frames a second, seen for three seconds.
            for pose in drive(0.8, 0.2).skip(3).take(6) {
                look(&mut tsdf, &after.render(pose), THING);
            }
            let (points, seen_from) = (tsdf.covered_points(), Point2::new(-0.4, -1.9));
            let found =
                footprint_seen_from(&points, Relation::Near, BAND, &Closing::default(), Some(seen_from))
                    .unwrap();
            let drawn = drawn(&found, |p| after.covers(THING, 0.0, p));
            assert_eq!(groups(&found, 0.0).len(), 1, "turned by {yaw}\n{drawn}");
            assert_ne!(found.at(was), Some(&true), "turned by {yaw}\n{drawn}");
            assert_eq!(found.at(is), Some(&true), "turned by {yaw}\n{drawn}");
        }
    }

    #[test]
    fn missed_and_wrong_masks_neither_lose_nor_invent_a_table() {
        let scene = office();
        let mut tsdf = empty();
        for (idx, pose) in drive(0.35, 0.0).chain(drive(1.1, 0.3)).enumerate() {
            let image = scene.render(pose);
            match idx % 10 {
                // The chair is taken for the table; then nothing is found.
                4 => look(&mut tsdf, &image, OTHER),
                7 => drop(tsdf.observe_absent(&image.frame()).unwrap()),
                _ => look(&mut tsdf, &image, THING),
            }
        }
        let found = found(&tsdf, Relation::Beneath);
        let truth = |p| scene.covers(THING, BAND.robot_height_m, p);
        let share = iou(&found, truth);
        assert!(share > 0.8, "IoU {share:.3}\n{}", drawn(&found, truth));
        assert_ne!(found.at(Point2::new(-1.6, 0.6)), Some(&true));
    }

    #[test]
    fn poses_that_are_a_little_off_do_not_carve_a_table_away() {
        let scene = office();
        let mut tsdf = empty();
        for (idx, pose) in drive(1.1, 0.3).chain(drive(0.35, 0.0)).enumerate() {
            let mut image = scene.render(pose);
            // Up to 2 cm and 0.6°, another way each time.
            let at = |period: usize| (idx % period) as f64 / (period - 1) as f64 * 2.0 - 1.0;
            let shift = nalgebra::Vector3::new(at(3), at(5), at(4)) * 0.02;
            let turn = nalgebra::Vector3::new(at(4), at(3), at(5)) * 0.01;
            image.map_from_camera *= Pose3::new(shift, turn);
            look(&mut tsdf, &image, THING);
        }
        let found = found(&tsdf, Relation::Beneath);
        let truth = |p| scene.covers(THING, BAND.robot_height_m, p);
        let share = iou(&found, truth);
        assert!(share > 0.75, "IoU {share:.3}\n{}", drawn(&found, truth));
    }

    #[test]
    fn a_rug_is_a_floor_area_and_lies_where_it_lies() {
        let mut scene = Scene::room();
        scene.add(THING, Pose2::new(0.3, 0.2, 0.5), [1.8, 1.2], 0.0, 0.005);
        scene.add_chair(OTHER, Pose2::new(0.3, 0.2, 1.0));
        let mut area = FloorArea::new(FloorConfig::default());
        for pose in drive(0.5, 0.25) {
            let image = scene.render(pose);
            let mask = fuse(&image.heat(THING), &image.segments(), Fusion::default()).unwrap().mask;
            let points = project(&image.frame(), Some(&mask), &DepthLimits::default()).unwrap();
            assert_eq!(object_kind(&points), ObjectKind::FloorArea);
            area.observe(&image.frame(), &mask).unwrap();
        }
        let found = area.footprint().unwrap();
        let truth = |p| scene.covers(THING, -1.0, p);
        let share = iou(&found, truth);
        assert!(share > 0.85, "IoU {share:.3}\n{}", drawn(&found, truth));
    }

    #[test]
    fn a_low_table_top_is_an_obstacle_and_a_high_one_is_not() {
        for (height_m, is_obstacle) in [(0.40, true), (0.72, false)] {
            let mut scene = Scene::room();
            scene.add_table(THING, table_at(), [1.6, 0.8], height_m);
            let config = ObstacleConfig::for_height(BAND.robot_height_m);
            // A quarter of the usual pixels: every one is used.
            let limits = DepthLimits { stride_px: 1, ..config.limits };
            let mut layer = ObstacleLayer::new(ObstacleConfig { limits, ..config });
            for (idx, pose) in drive(0.6, 0.15).enumerate() {
                layer.integrate(&scene.render(pose).with_noise(idx as u64).frame());
            }
            let layout = Layout::covering(Point2::new(-3.8, -3.8), Point2::new(3.8, 3.8), 0.05).unwrap();
            let found = layer.occupied(layout);
            let top = |p: Point2| {
                let p = table_at().inverse().transform(p);
                p.x.abs() < 0.8 && p.y.abs() < 0.4
            };
            let inside: Vec<_> = layout.cells().filter(|&c| top(layout.centre(c))).collect();
            let n = inside.iter().filter(|&&c| *found.get(c)).count();
            if is_obstacle {
                assert!(n * 10 >= inside.len() * 6, "{n} of {}\n{}", inside.len(), drawn(&found, top));
            } else {
                // The legs.
                assert!(n * 10 <= inside.len(), "{n} of {}\n{}", inside.len(), drawn(&found, top));
            }
            // Open floor, well off the table and the walls, stays free.
            for cell in layout.cells().filter(|&c| *found.get(c)) {
                let p = layout.centre(cell);
                let local = table_at().inverse().transform(p);
                let off_m = (local.x.abs() - 0.8).max(local.y.abs() - 0.4);
                assert!(off_m < 0.12 || p.x.abs() > 3.7 || p.y.abs() > 3.7, "{p}\n{}", drawn(&found, top));
            }
        }
    }
}
