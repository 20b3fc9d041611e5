//! What is thin and seen only at its edge is found however the voxels lie: table tops at the camera's own height, boards,
//! poles.

#[cfg(test)]
#[allow(dead_code, reason = "other tests use the rest")]
mod render;

#[cfg(test)]
mod tests {
    use geometry::{CameraIntrinsics, Point2, Point3, Pose2, Pose3};
    use mapping::Mask;
    use mapping::occupancy::{Closing, HeightBand, Relation, footprint};
    use mapping::tsdf::{Tsdf, TsdfConfig};

    use crate::render::{Image, Scene, iou, looking};

    const THING: u16 = 3;
    /// A band of a picture: what is seen of a top from its own height is in its middle.
    const BAND: CameraIntrinsics =
        CameraIntrinsics { width: 320, height: 40, fx: 290.0, fy: 290.0, cx: 159.5, cy: 19.5 };
    /// Length of the tops, metres.
    const LENGTH_M: f64 = 0.8;

    fn empty(voxel_m: f64) -> Tsdf {
        Tsdf::new(TsdfConfig { voxel_m, truncation_m: 3.0 * voxel_m, ..TsdfConfig::default() }).unwrap()
    }

    /// A board on nothing whose upper side is at a height and whose front is so far from the origin.
    fn board(ahead_m: f64, height_m: f64, thickness_m: f64) -> Scene {
        let mut scene = Scene::room();
        let at = Pose2::new(ahead_m + 0.3, 0.0, 0.0);
        scene.add(THING, at, [0.6, LENGTH_M], height_m - thickness_m, height_m);
        scene
    }

    /// What a camera at a height sees of a scene from a few places beside each other, moved by so much.
    fn views(scene: &Scene, n: u32, height_m: f64, shift: Point2) -> Vec<Image> {
        let at = |k: u32| Point2::new(shift.x, shift.y + 0.05 * f64::from(k));
        let to = |k: u32| at(k) + nalgebra::Vector2::new(1.0, -0.02 * f64::from(k));
        (0..n).map(|k| scene.render_by(BAND, looking(at(k), height_m, to(k), 0.0))).collect()
    }

    fn look(tsdf: &mut Tsdf, image: &Image, label: u16) {
        let seen = image.labels.iter().map(|l| *l == label).collect();
        let mask = Mask::new(image.camera.width, image.camera.height, seen).unwrap();
        tsdf.integrate(&image.frame(), Some(&mask)).unwrap();
    }

    /// Share of a board's front that points lie at, by pieces of 5 cm.
    fn share_of_front(points: &[Point3], ahead_m: f64, height_m: f64) -> f64 {
        let n = (LENGTH_M / 0.05) as i32;
        let is_found = |k: &i32| {
            let y = -LENGTH_M / 2.0 + 0.05 * (f64::from(*k) + 0.5);
            let near = |p: &&Point3| (p.x - ahead_m).hypot(p.y - y) < 0.08 && (p.z - height_m).abs() < 0.05;
            points.iter().find(near).is_some()
        };
        f64::from((0..n).filter(is_found).count() as u32) / f64::from(n)
    }

    #[test]
    fn the_front_of_a_top_at_the_cameras_height_is_found_whatever_its_height_thickness_and_distance() {
        let mut missed = Vec::new();
        let mut n_all = 0;
        for thickness_m in [0.015, 0.02, 0.03, 0.04] {
            for ahead_m in [1.0, 1.7, 2.5, 4.0] {
                for n_cm in [40, 41, 42, 43, 44, 45, 71, 72, 73] {
                    let height_m = 0.01 * f64::from(n_cm);
                    // Down the middle of its edge, or a little above and below.
                    let eye_m = height_m - thickness_m / 2.0 + 0.01 * f64::from(n_cm % 3 - 1);
                    // In a room twice as large, so that the wall is behind.
                    let scene = board(ahead_m - 2.0, height_m, thickness_m);
                    let views = views(&scene, 4, eye_m, Point2::new(-2.0, -0.1));
                    for voxel_m in [0.02, 0.03, 0.04, 0.05] {
                        let mut tsdf = empty(voxel_m);
                        views.iter().for_each(|image| look(&mut tsdf, image, THING));
                        let points = tsdf.covered_points();
                        let share = share_of_front(&points, ahead_m - 2.0, height_m - thickness_m / 2.0);
                        n_all += 1;
                        if share < 0.8 {
                            missed.push((thickness_m, ahead_m, n_cm, voxel_m, share));
                        }
                    }
                }
            }
        }
        assert!(missed.is_empty(), "{} of {n_all} missed: {missed:.3?}", missed.len());
    }

    #[test]
    fn a_thin_top_is_found_in_noise_and_only_where_it_is() {
        for n_cm in 40..46 {
            let height_m = 0.01 * f64::from(n_cm);
            let scene = board(0.5, height_m, 0.03);
            let mut tsdf = empty(0.04);
            for (seed, image) in
                views(&scene, 10, height_m - 0.01, Point2::new(-2.0, -0.25)).into_iter().enumerate()
            {
                look(&mut tsdf, &image.with_noise(seed as u64), THING);
            }
            let points = tsdf.covered_points();
            assert!(share_of_front(&points, 0.5, height_m - 0.015) > 0.8, "{n_cm} cm high");
            let is_off = |p: &&Point3| {
                p.x < 0.4 || p.x > 1.2 || p.y.abs() > LENGTH_M / 2.0 + 0.06 || (p.z - height_m).abs() > 0.08
            };
            assert_eq!(points.iter().find(is_off), None, "{n_cm} cm high");
        }
    }

    #[test]
    fn beneath_a_low_table_is_covered_at_every_height_of_its_top() {
        let table = Pose2::new(0.3, 0.2, 0.3);
        for n_cm in 40..46 {
            let height_m = 0.01 * f64::from(n_cm);
            let mut scene = Scene::room();
            scene.add_table(THING, table, [1.2, 0.6], height_m);
            let mut tsdf = empty(0.04);
            for step in 0..10 {
                let at = Point2::new(-1.9 + 0.4 * f64::from(step), -1.4 - 0.05 * f64::from(step));
                let image = scene.render(looking(at, 0.4, Point2::new(0.3, 0.2), 0.0));
                look(&mut tsdf, &image.with_noise(step as u64), THING);
            }
            let band = HeightBand { robot_height_m: 0.3 };
            let found =
                footprint(&tsdf.covered_points(), Relation::Beneath, band, &Closing::default()).unwrap();
            let share = iou(&found, |p| scene.covers(THING, band.robot_height_m, p));
            assert!(share >= 0.65, "{n_cm} cm high: IoU {share:.3}");
        }
    }

    #[test]
    fn a_thin_top_that_was_carried_off_is_forgotten_within_six_frames_and_is_kept_while_it_is_hidden() {
        for n_cm in 40..46 {
            let height_m = 0.01 * f64::from(n_cm);
            let eye_m = height_m - 0.01;
            let scene = board(0.0, height_m, 0.02);
            let mut tsdf = empty(0.04);
            for image in views(&scene, 20, eye_m, Point2::new(-2.0, -0.4)) {
                look(&mut tsdf, &image, THING);
            }
            let n_before = tsdf.covered_points().len();
            assert!(n_before > 10, "{n_cm} cm high");
            let mut hidden = scene.clone();
            hidden.add(9, Pose2::new(-1.0, 0.0, 0.0), [0.1, 3.0], 0.0, 2.0);
            for image in views(&hidden, 20, eye_m, Point2::new(-2.0, -0.4)) {
                look(&mut tsdf, &image, THING);
            }
            assert_eq!(tsdf.covered_points().len(), n_before, "{n_cm} cm high");
            for image in views(&Scene::room(), 6, eye_m, Point2::new(-2.0, -0.1)) {
                look(&mut tsdf, &image, THING);
            }
            assert_eq!(tsdf.covered_points(), vec![], "{n_cm} cm high");
            assert!(tsdf.is_empty());
        }
    }

    #[test]
    fn a_thin_top_that_is_seen_and_not_masked_loses_its_claim_and_one_wrong_mask_in_twenty_leaves_nothing() {
        let scene = board(0.0, 0.42, 0.02);
        let views = views(&scene, 5, 0.41, Point2::new(-2.0, -0.1));
        let mut tsdf = empty(0.04);
        (0..20).for_each(|n| look(&mut tsdf, &views[n % 5], THING));
        (0..6).for_each(|n| look(&mut tsdf, &views[n % 5], 9));
        assert_eq!(tsdf.covered_points(), vec![]);
        for n in 0..100 {
            look(&mut tsdf, &views[n % 5], if n % 20 == 0 { THING } else { 9 });
            assert_eq!(tsdf.covered_points(), vec![], "after frame {n}");
        }
    }

    #[test]
    fn poses_that_are_a_little_off_do_not_carve_a_thin_top_away() {
        for n_cm in 40..46 {
            let height_m = 0.01 * f64::from(n_cm);
            let scene = board(0.0, height_m, 0.03);
            let mut tsdf = empty(0.04);
            for (idx, mut image) in
                views(&scene, 16, height_m - 0.01, Point2::new(-2.0, -0.4)).into_iter().enumerate()
            {
                // Up to 2 cm and 0.6°, another way each time.
                let at = |period: usize| (idx % period) as f64 / (period - 1) as f64 * 2.0 - 1.0;
                let shift = nalgebra::Vector3::new(at(3), at(5), at(4)) * 0.02;
                let turn = nalgebra::Vector3::new(at(4), at(3), at(5)) * 0.01;
                image.map_from_camera *= Pose3::new(shift, turn);
                look(&mut tsdf, &image, THING);
            }
            let share = share_of_front(&tsdf.covered_points(), 0.0, height_m - 0.015);
            assert!(share > 0.8, "{n_cm} cm high: {share:.3}");
        }
    }

    #[test]
    fn a_thin_pole_is_found_wherever_it_stands() {
        for n_cm in 0..5 {
            let y = 0.01 * f64::from(n_cm);
            let mut scene = Scene::room();
            scene.add(THING, Pose2::new(0.0, y, 0.0), [0.015, 0.015], 0.0, 1.5);
            let mut tsdf = empty(0.04);
            for step in 0..4 {
                let at = Point2::new(-2.0 + 0.1 * f64::from(step), 0.0);
                look(&mut tsdf, &scene.render(looking(at, 0.6, Point2::new(0.0, y), 0.0)), THING);
            }
            let points = tsdf.covered_points();
            for n_dm in 3..10 {
                let z = 0.1 * f64::from(n_dm);
                let near = |p: &&Point3| p.x.hypot(p.y - y) < 0.06 && (p.z - z).abs() < 0.05;
                assert!(points.iter().find(near).is_some(), "at {y} m, nothing {z} m high");
            }
        }
    }

    #[test]
    fn the_rim_of_what_is_broad_adds_no_points_off_it() {
        // Pixels between a box and the wall, as a sensor makes them.
        let mut scene = Scene::room();
        scene.add(THING, Pose2::new(0.0, 0.0, 0.2), [0.5, 0.5], 0.0, 1.0);
        let mut tsdf = empty(0.04);
        for step in 0..8 {
            let at = Point2::new(-2.0, 0.1 * f64::from(step));
            let mut image = scene.render(looking(at, 0.6, Point2::new(0.0, 0.0), 0.0));
            let exact = image.depth_mm.clone();
            let width = image.camera.width as usize;
            for idx in width + 1..exact.len() - width - 1 {
                let around = [idx - 1, idx + 1, idx - width, idx + width].map(|at| u32::from(exact[at]));
                let farthest = around.into_iter().max().unwrap_or(0);
                if image.labels[idx] == THING && farthest > u32::from(exact[idx]) + 300 {
                    image.depth_mm[idx] = ((u32::from(exact[idx]) + farthest) / 2) as u16;
                }
            }
            look(&mut tsdf, &image, THING);
        }
        let is_off = |p: &&Point3| p.xy().coords.norm() > 0.25 * std::f64::consts::SQRT_2 + 0.06;
        assert_eq!(tsdf.covered_points().iter().find(is_off), None);
    }
}
