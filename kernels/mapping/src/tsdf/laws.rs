//! The update against the slow, obvious one: the same numbers in every voxel, by every instruction set.

use geometry::{CameraIntrinsics, Pose3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus as Draws;

use super::*;
use crate::image::DepthImage;
use crate::projection::DepthLimits;

const WIDTH: usize = 96;
const HEIGHT: usize = 72;

/// A recorded moment of a scene that was drawn by lot.
struct Moment {
    depth_mm: Vec<u16>,
    mask: Option<Mask>,
    map_from_camera: Pose3,
}

/// A wall and a slanted floor, boxes before them, depth that is missing, noisy and in steps as a camera's is.
fn moment(camera: &CameraIntrinsics, draws: &mut Draws) -> Moment {
    let (wall_m, slope) = (draws.random_range(1.5..5.5), draws.random_range(-0.6..1.2));
    let noise = if draws.random_bool(0.5) { draws.random_range(0.0..0.012) } else { 0.0 };
    let holes = draws.random_range(0.0..0.1) * f64::from(u8::from(draws.random_bool(0.5)));
    let mut boxes = Vec::new();
    for _ in 0..draws.random_range(0..4) {
        let (col, row) = (draws.random_range(0..WIDTH), draws.random_range(0..HEIGHT));
        let (n_cols, n_rows) = (draws.random_range(1..50), draws.random_range(1..50));
        boxes.push((
            col..col + n_cols,
            row..row + n_rows,
            draws.random_range(0.2..4.0),
            draws.random_range(-0.8..0.8),
        ));
    }
    let mut depth_mm = Vec::new();
    for idx in 0..WIDTH * HEIGHT {
        let (col, row) = (idx % WIDTH, idx / WIDTH);
        let ray = camera.unproject(col as f64, row as f64, 1.0);
        let mut depth_m = wall_m / (1.0 + slope * ray.y).max(0.2);
        for (cols, rows, at_m, slope) in &boxes {
            if cols.contains(&col) && rows.contains(&row) {
                depth_m = depth_m.min(at_m / (1.0_f64 + slope * ray.x).max(0.2));
            }
        }
        depth_m *= 1.0 + noise * draws.random_range(-1.0..1.0);
        let is_hole = draws.random_bool(holes);
        depth_mm.push(if is_hole { 0 } else { (depth_m * 1000.0).min(65_535.0) as u16 });
    }
    let turn = [0; 3].map(|_| draws.random_range(-0.2..0.2));
    let shift = [0; 3].map(|_| draws.random_range(-0.3..0.3));
    Moment { depth_mm, mask: mask(&boxes, draws), map_from_camera: Pose3::new(shift.into(), turn.into()) }
}

type Box = (std::ops::Range<usize>, std::ops::Range<usize>, f64, f64);

/// No mask; nothing; one box a little off; or a patch with holes.
fn mask(boxes: &[Box], draws: &mut Draws) -> Option<Mask> {
    let patch = (draws.random_range(0..WIDTH), draws.random_range(0..HEIGHT));
    let kind = draws.random_range(0..5);
    let bits = (0..WIDTH * HEIGHT).map(|idx| {
        let (col, row) = (idx % WIDTH, idx / WIDTH);
        match kind {
            1 => false,
            2 => boxes.first().is_some_and(|b| b.0.contains(&(col + 1)) && b.1.contains(&row)),
            3 => col >= patch.0 / 2 && row >= patch.1 / 2 && !draws.random_bool(0.02),
            _ => col.abs_diff(patch.0) < 30 && row.abs_diff(patch.1) < 25,
        }
    });
    let bits = bits.collect();
    if kind == 0 { None } else { Some(Mask::new(WIDTH as u32, HEIGHT as u32, bits).unwrap()) }
}

/// Every number of every block, as bits: what was never written too.
fn numbers(tsdf: &Tsdf) -> Vec<(BlockKey, u64, Vec<[u32; 2]>)> {
    let voxels = |block: &Voxels| {
        let both = block.sdf_m.iter().zip(&block.weight);
        both.map(|(sdf_m, weight)| [sdf_m.to_bits(), weight.to_bits()]).collect()
    };
    let blocks = tsdf.heads.iter().zip(&tsdf.blocks);
    blocks.map(|(head, block)| (head.key, head.frame, voxels(block))).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_instruction_set_gives_every_voxel_the_numbers_of_the_slow_obvious_update(
        seed in any::<u64>(), voxel_m in 0.02..0.12_f64, n_voxels in 2.0..5.0_f64,
        (carve_step, absent_step) in prop_oneof![Just((0.0, 0.0)), Just((3.0, 2.0)), Just((1.5, 0.0)), Just((0.0, 0.7))],
        focal in 50.0..160.0_f64, n_blocks_max in prop_oneof![Just(40), Just(20_000)], keep in 0.3..1.0_f32,
    ) {
        let mut draws = Draws::seed_from_u64(seed);
        let camera = CameraIntrinsics {
            width: WIDTH as u32, height: HEIGHT as u32,
            fx: focal, fy: focal * draws.random_range(0.9..1.1),
            cx: draws.random_range(40.0..55.0), cy: draws.random_range(30.0..42.0),
        };
        let config = TsdfConfig {
            voxel_m, truncation_m: voxel_m * n_voxels, carve_step, absent_step, n_blocks_max, ..TsdfConfig::default()
        };
        let mut slow = Tsdf::new(config).unwrap();
        let isas = Isa::available();
        let mut fast = vec![slow.clone(); isas.len()];
        let mut before = moment(&camera, &mut draws);
        for step in 0..5 {
            // The same scene seen once more, without its mask at times, or another one.
            let next = moment(&camera, &mut draws);
            if draws.random_bool(0.4) {
                before.map_from_camera = next.map_from_camera;
                before.mask = next.mask;
            } else {
                before = next;
            }
            let depth = DepthImage::new(camera.width, camera.height, &before.depth_mm).unwrap();
            let frame = DepthFrame::new(depth, camera, before.map_from_camera).unwrap();
            let done = reference::integrate(&mut slow, &frame, before.mask.as_ref());
            for (isa, fast) in isas.iter().zip(&mut fast) {
                let fast_done = fast.integrate_by(*isa, &frame, before.mask.as_ref()).unwrap();
                prop_assert_eq!(done, fast_done, "frame {} by {:?}", step, isa);
                prop_assert!(numbers(&slow) == numbers(fast), "frame {step} by {isa:?}");
                prop_assert_eq!(slow.thin.numbers(), fast.thin.numbers(), "frame {} by {:?}", step, isa);
            }
            if draws.random_bool(0.3) {
                slow.decay(keep);
                fast.iter_mut().for_each(|fast| fast.decay(keep));
            }
        }
    }
}

proptest! {
    #[test]
    fn what_is_seen_of_an_image_of_any_size_is_what_pixels_say_that_are_asked_one_by_one(
        seed in any::<u64>(), width in 3..90_u32, height in 3..20_u32, erode_px in 0..5_usize,
        edge_relative in prop_oneof![Just(0.01), Just(0.04), Just(0.3), Just(f64::INFINITY)],
    ) {
        let mut draws = Draws::seed_from_u64(seed);
        let n_px = (width * height) as usize;
        // Steps and slopes of all sizes, close to every limit.
        let (mut depth_mm, mut mm) = (Vec::with_capacity(n_px), 2000.0_f64);
        let step = draws.random_range(0.0..0.15);
        for _ in 0..n_px {
            mm *= 1.0 + draws.random_range(-step..=step);
            mm = if draws.random_bool(0.02) { draws.random_range(200.0..7000.0) } else { mm };
            depth_mm.push(if draws.random_bool(0.02) { 0 } else { mm as u16 });
        }
        let is_masked = draws.random_bool(0.8);
        let from = (draws.random_range(0..width), draws.random_range(0..height));
        let bits = (0..width * height).map(|at| {
            at % width >= from.0 / 2 && at / width >= from.1 / 2 && !draws.random_bool(0.03)
        });
        let mask = is_masked.then(|| Mask::new(width, height, bits.collect()).unwrap());
        let camera = CameraIntrinsics { width, height, fx: 50.0, fy: 50.0, cx: 1.0, cy: 1.0 };
        let depth = DepthImage::new(width, height, &depth_mm).unwrap();
        let frame = DepthFrame::new(depth, camera, Pose3::identity()).unwrap();
        let limits = DepthLimits { erode_px, edge_relative, ..DepthLimits::default() };
        let trusted = TrustedDepth::new(&frame, mask.as_ref(), &limits);
        for isa in Isa::available() {
            let mut seen = Seen::default();
            isa.run(Sift::new(&frame, &trusted, mask.as_ref().map(Mask::bits), &limits, &mut seen));
            for (col, row) in (0..height).flat_map(|row| (0..width).map(move |col| (col as usize, row as usize))) {
                let alone_mm = match trusted.at_in_mask(col, row) {
                    Some(_) => depth_mm[row * width as usize + col],
                    None => 0,
                };
                prop_assert_eq!(seen.at(col, row), alone_mm, "pixel {} {} by {:?}", col, row, isa);
            }
        }
    }
}
