//! Recordings as they are and as they should not be.

use std::path::Path;

use super::*;

const MATRIX: &str = "0 -1 0 1.5\n1 0 0 -2\n0 0 1 0.25\n0 0 0 1\n";

fn depth_png(file: &Path, width: u32, height: u32, value: impl Fn(u32, u32) -> u16) {
    let image =
        image::ImageBuffer::<image::Luma<u16>, _>::from_fn(width, height, |x, y| image::Luma([value(x, y)]));
    image.save(file).unwrap();
}

/// Two frames of 6×4 pixels in the seven-scenes layout.
fn scenes() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("camera-intrinsics.txt"), "5 0 2.5\n0 6 1.5\n0 0 1\n").unwrap();
    for number in [3, 7] {
        depth_png(&at(&format!("frame-{number:06}.depth.png")), 6, 4, |x, y| match (x, y) {
            (0, 0) => u16::MAX,
            _ => (1000 + 10 * x + y) as u16,
        });
        image::RgbImage::from_fn(6, 4, |x, y| image::Rgb([x as u8, y as u8, 9]))
            .save(at(&format!("frame-{number:06}.color.png")))
            .unwrap();
        std::fs::write(at(&format!("frame-{number:06}.pose.txt")), MATRIX).unwrap();
    }
    folder
}

#[test]
fn a_seven_scenes_folder_is_read_as_it_was_written() {
    let folder = scenes();
    let recording = Recording::open(folder.path(), None).unwrap();
    assert_eq!((recording.naming(), recording.numbers()), (Naming::SevenScenes, &[3, 7][..]));
    assert_eq!((recording.intrinsics().fy, recording.intrinsics().cx), (6.0, 2.5));
    let frame = recording.read(7).unwrap();
    // The first pixel had none.
    assert_eq!(frame.depth.depth_mm[..3], [0, 1010, 1020]);
    assert_eq!(frame.depth.depth_mm[7], 1011);
    assert_eq!(frame.rgb[3 * 7..3 * 8], [1, 1, 9]);
    let ahead = frame.depth.world_from_camera * geometry::Point3::new(1.0, 0.0, 0.0);
    assert!((ahead - geometry::Point3::new(1.5, -1.0, 0.25)).norm() < 1e-9, "{ahead}");
}

#[test]
fn a_numbered_folder_is_read_with_the_poses_line_by_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for number in [1, 2, 10] {
        let mut pgm = b"P5\n# made here\n640 480\n65535\n".to_vec();
        pgm.extend((0..640 * 480).flat_map(|idx: u32| ((idx % 640 + number) as u16).to_be_bytes()));
        std::fs::write(at(&format!("depth_{number}.pgm")), pgm).unwrap();
    }
    std::fs::write(at("pose.txt"), "0 0 1 0 0 0 1\n0 0 2 0 0 0 1\n").unwrap();
    let recording = Recording::open(folder.path(), None).unwrap();
    assert_eq!(recording.numbers(), &[1, 2, 10]);
    assert_eq!(recording.intrinsics().fx, 518.0);
    let depth = recording.read_depth(2).unwrap();
    assert_eq!((depth.depth_mm[3], depth.world_from_camera.translation.z), (5, 2.0));
    // A pose gap: the line of the third frame is missing.
    let refused = format!("{:#}", recording.read_depth(10).unwrap_err());
    assert!(refused.contains("pose of frame 10 is missing"), "{refused}");
}

#[track_caller]
fn check_refused(folder: &Path, number: u32, words: &str) {
    let end = Recording::open(folder, None).and_then(|recording| recording.read(number).map(drop));
    let refused = format!("{:#}", end.unwrap_err());
    assert!(refused.contains(words), "{refused:?} does not say {words:?}");
}

#[test]
fn what_is_missing_or_impossible_is_named() {
    let empty = tempfile::tempdir().unwrap();
    check_refused(empty.path(), 0, "neither");
    check_refused(&empty.path().join("nowhere"), 0, "nowhere");

    let folder = scenes();
    let at = |name: &str| folder.path().join(name);
    check_refused(folder.path(), 4, "frame-000004");
    std::fs::write(at("frame-000003.pose.txt"), MATRIX.replace("0.25", "nan")).unwrap();
    check_refused(folder.path(), 3, "nan is not finite");
    std::fs::write(at("frame-000003.pose.txt"), MATRIX.replace("-1", "-1.1")).unwrap();
    check_refused(folder.path(), 3, "rotation of the pose is off by 0.210");
    std::fs::write(at("frame-000003.pose.txt"), "1 2 3").unwrap();
    check_refused(folder.path(), 3, "16 wanted");
    depth_png(&at("frame-000007.depth.png"), 5, 4, |_, _| 1);
    check_refused(folder.path(), 7, "5×4 pixels, must be 6×4");
    std::fs::write(at("frame-000007.depth.png"), b"\x89PNG\r\n").unwrap();
    check_refused(folder.path(), 7, "frame-000007.depth.png");
    std::fs::remove_file(at("camera-intrinsics.txt")).unwrap();
    check_refused(folder.path(), 3, "no intrinsics");
}

#[test]
fn depth_of_eight_bits_or_cut_short_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::write(at("pose.txt"), "").unwrap();
    std::fs::write(at("depth_1.pgm"), b"P5 2 2 255\n0000").unwrap();
    check_refused(folder.path(), 1, "depth is 16 bit");
    std::fs::write(at("depth_1.pgm"), b"P5 2 2 65535\n0000").unwrap();
    check_refused(folder.path(), 1, "4 bytes of pixels, 8 wanted");
}
