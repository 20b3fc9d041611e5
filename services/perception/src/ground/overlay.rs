//! Pictures of what was found: masks over each image, the regions' borders on its floor, and all from above.

use std::collections::BTreeMap;

use anyhow::Context;
use geometry::{Point2, Point3};
use image::{Rgb, RgbImage};
use mapping::projection::{DepthLimits, project};
use mapping::{DepthFrame, DepthImage};
use proto::{CellSet, ObjectMap};

use super::placing::Place;
use super::summary::Summary;
use super::{Options, overlay_file};
use crate::recording::Recording;
use crate::semantics::regions::phrases;
use crate::semantics::replay::Found;

/// Colours of rules, in turn; far apart, and visible on dark and bright.
const COLOURS: [[u8; 3]; 8] = [
    [230, 25, 75],
    [60, 180, 255],
    [60, 220, 75],
    [255, 200, 0],
    [200, 60, 240],
    [255, 130, 40],
    [0, 230, 210],
    [250, 130, 190],
];
/// A pixel of the view from above, metres.
const TOP_M: f64 = 0.025;
/// Most pixels along a side of it.
const N_TOP_MAX: u32 = 2000;
/// What is seen this far from the floor is drawn in the view from above, metres.
const DRAWN_M: std::ops::Range<f64> = 0.06..2.0;

/// The colour of the `idx`-th rule.
#[must_use]
pub fn colour(idx: usize) -> [u8; 3] {
    COLOURS[idx % COLOURS.len()]
}

/// Draws the masks of what was found over an image; returns the file's name.
///
/// # Errors
/// When the file cannot be written.
pub fn write_masks(
    recording: &Recording,
    options: &Options,
    number: u32,
    rgb: &[u8],
    found: &[Found],
) -> anyhow::Result<String> {
    let camera = recording.intrinsics();
    let image = RgbImage::from_raw(camera.width, camera.height, rgb.to_vec());
    let mut image = image.context("colour is not of the intrinsics' size")?;
    for (idx, rule) in options.rules.iter().enumerate() {
        for phrase in phrases(rule) {
            let Some(mask) = found.iter().find(|f| f.phrase == phrase).and_then(|f| f.mask.as_ref()) else {
                continue;
            };
            for (pixel, _) in image.pixels_mut().zip(mask.mask.bits()).filter(|(_, inside)| **inside) {
                blend(pixel, colour(idx), 0.5);
            }
        }
    }
    let file = overlay_file(&options.out, number);
    image.save(&file).with_context(|| file.display().to_string())?;
    Ok(file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default())
}

fn blend(pixel: &mut Rgb<u8>, colour: [u8; 3], share: f32) {
    for (value, wanted) in pixel.0.iter_mut().zip(colour) {
        *value = (f32::from(*value) * (1.0 - share) + f32::from(wanted) * share) as u8;
    }
}

/// Draws the regions' borders into every overlay, and all from above.
///
/// # Errors
/// When a file cannot be read or written.
pub fn draw_all(
    recording: &Recording,
    options: &Options,
    place: &Place,
    summary: &Summary,
    told: &BTreeMap<String, ObjectMap>,
) -> anyhow::Result<()> {
    let regions: Vec<(usize, &CellSet)> = options
        .rules
        .iter()
        .enumerate()
        .filter_map(|(idx, rule)| Some((idx, told.get(&rule.id)?.region.as_ref()?)))
        .collect();
    let mut seen_map: Vec<Point3> = Vec::new();
    let mut eyes: Vec<Point2> = Vec::new();
    for (frame, placed) in summary.frames.iter().zip(&place.frames) {
        let (Some(overlay), Ok(world_from_camera)) = (&frame.overlay, &placed.world_from_camera) else {
            continue;
        };
        let map_from_camera = place.map_from_world * world_from_camera;
        eyes.push(Point2::from(map_from_camera.translation.vector.xy()));
        let (depth_mm, _) = recording.read_images(placed.number)?;
        let camera = *recording.intrinsics();
        let depth = DepthImage::new(camera.width, camera.height, &depth_mm)?;
        let limits =
            DepthLimits { stride_px: 4, max_m: options.settings.depth_m_max, ..DepthLimits::default() };
        seen_map.extend(project(&DepthFrame::new(depth, camera, map_from_camera)?, None, &limits)?);
        let file = options.out.join(overlay);
        let mut image = image::open(&file).with_context(|| file.display().to_string())?.into_rgb8();
        for (idx, cells) in &regions {
            for point in border(cells) {
                let at_camera = map_from_camera.inverse() * Point3::new(point.x, point.y, 0.0);
                let Some((u, v)) = camera.project(at_camera) else { continue };
                dot(&mut image, u, v, 1, colour(*idx));
            }
        }
        image.save(&file).with_context(|| file.display().to_string())?;
    }
    let file = options.out.join("above.png");
    above(&seen_map, &eyes, &regions).save(&file).with_context(|| file.display().to_string())
}

/// Centres of the cells of a set that have a neighbour outside it.
fn border(cells: &CellSet) -> Vec<Point2> {
    let values = cells.unpack();
    let (n_cols, n_rows) = (i64::from(cells.layout.n_cols), i64::from(cells.layout.n_rows));
    let at = |col: i64, row: i64| {
        let inside = (0..n_cols).contains(&col) && (0..n_rows).contains(&row);
        inside && usize::try_from(row * n_cols + col).ok().and_then(|idx| values.get(idx)) == Some(&true)
    };
    let is_border = |col: i64, row: i64| {
        at(col, row) && ![(1, 0), (-1, 0), (0, 1), (0, -1)].into_iter().all(|(x, y)| at(col + x, row + y))
    };
    (0..n_rows)
        .flat_map(|row| (0..n_cols).map(move |col| (col, row)))
        .filter(|(col, row)| is_border(*col, *row))
        .map(|(col, row)| centre(cells, col, row))
        .collect()
}

fn centre(cells: &CellSet, col: i64, row: i64) -> Point2 {
    let layout = &cells.layout;
    let along = |k: i64| (k as f64 + 0.5) * layout.resolution_m;
    Point2::new(layout.origin_map.x + along(col), layout.origin_map.y + along(row))
}

fn dot(image: &mut RgbImage, u: f64, v: f64, reach: i64, colour: [u8; 3]) {
    for y in -reach..=reach {
        for x in -reach..=reach {
            let (col, row) = (u.round() as i64 + x, v.round() as i64 + y);
            if let (Ok(col), Ok(row)) = (u32::try_from(col), u32::try_from(row))
                && let Some(pixel) = image.get_pixel_mut_checked(col, row)
            {
                *pixel = Rgb(colour);
            }
        }
    }
}

/// What was seen, from above: grey by height, regions in their rule's colour, cameras black. Up is +x.
fn above(seen_map: &[Point3], eyes: &[Point2], regions: &[(usize, &CellSet)]) -> RgbImage {
    let drawn = seen_map.iter().filter(|p| DRAWN_M.contains(&p.z));
    let (mut low, mut high) = (Point2::new(-0.5, -0.5), Point2::new(0.5, 0.5));
    for point in drawn.clone().map(|p| Point2::from(p.coords.xy())).chain(eyes.iter().copied()) {
        (low, high) = (low.inf(&point), high.sup(&point));
    }
    let side = |from: f64, to: f64| (((to - from) / TOP_M) as u32 + 20).min(N_TOP_MAX);
    // The camera looks along +x: up in the picture, and +y, its left, to the left.
    let mut image = RgbImage::from_pixel(side(low.y, high.y), side(low.x, high.x), Rgb([255; 3]));
    let pixel = |p: Point2| ((high.y - p.y) / TOP_M + 10.0, (high.x - p.x) / TOP_M + 10.0);
    for point in drawn {
        let (u, v) = pixel(Point2::from(point.coords.xy()));
        let grey = (210.0 - 90.0 * point.z) as u8;
        dot(&mut image, u, v, 0, [grey; 3]);
    }
    for (idx, cells) in regions {
        let values = cells.unpack();
        let n_cols = i64::from(cells.layout.n_cols.max(1));
        for (at, _) in (0_i64..).zip(&values).filter(|(_, inside)| **inside) {
            let (u, v) = pixel(centre(cells, at % n_cols, at / n_cols));
            for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let (col, row) = (u as i64 + x, v as i64 + y);
                if let (Ok(col), Ok(row)) = (u32::try_from(col), u32::try_from(row))
                    && let Some(pixel) = image.get_pixel_mut_checked(col, row)
                {
                    blend(pixel, colour(*idx), 0.6);
                }
            }
        }
    }
    for eye in eyes {
        let (u, v) = pixel(*eye);
        dot(&mut image, u, v, 2, [0; 3]);
    }
    image
}
