//! Messages of the network as messages of Foxglove's schemas.

use std::io::Cursor;

use anyhow::Context;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use geometry::{Pose2, Pose3};
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, Rgb};
use proto::{CellSet, GridLayout, RgbdFrame, Scan};
use serde_json::{Value, json};

/// Numbers of `foxglove.PackedElementField`.
const UINT8: u8 = 1;
const FLOAT32: u8 = 7;
/// `INFO` of `foxglove.Log`.
const INFO: u8 = 2;

/// A moment, nanoseconds since the Unix epoch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stamp(pub u64);

impl Stamp {
    fn value(self) -> Value {
        json!({ "sec": self.0 / 1_000_000_000, "nsec": self.0 % 1_000_000_000 })
    }
}

/// The colour image, as JPEG.
pub(super) fn colour(frame: &RgbdFrame) -> anyhow::Result<Value> {
    let (width, height) = (frame.intrinsics.width, frame.intrinsics.height);
    let image: ImageBuffer<Rgb<u8>, Vec<u8>> =
        ImageBuffer::from_raw(width, height, frame.rgb.clone()).context("colour of an odd size")?;
    picture(frame, &DynamicImage::ImageRgb8(image), ImageFormat::Jpeg, "jpeg")
}

/// The depth image, millimetres, as PNG of 16 bits.
pub(super) fn depth(frame: &RgbdFrame) -> anyhow::Result<Value> {
    let (width, height) = (frame.intrinsics.width, frame.intrinsics.height);
    let image: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_raw(width, height, frame.depth_mm()).context("depth of an odd size")?;
    picture(frame, &DynamicImage::ImageLuma16(image), ImageFormat::Png, "png")
}

fn picture(
    frame: &RgbdFrame,
    image: &DynamicImage,
    format: ImageFormat,
    word: &str,
) -> anyhow::Result<Value> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).context("compress an image")?;
    Ok(json!({
        "timestamp": Stamp(frame.header.stamp_ns).value(), "frame_id": "camera", "format": word,
        "data": STANDARD.encode(bytes.into_inner()),
    }))
}

/// The points of a depth image, every `stride_px`-th pixel, in `camera`.
pub(super) fn cloud(frame: &RgbdFrame, stride_px: u32) -> Value {
    let depth_mm = frame.depth_mm();
    let (width, camera) = (frame.intrinsics.width, &frame.intrinsics);
    let stride = stride_px.max(1) as usize;
    let rows = (0..camera.height).step_by(stride);
    let pixels = rows.flat_map(|row| (0..width).step_by(stride).map(move |column| (column, row)));
    let points = pixels.filter_map(|(column, row)| {
        let mm = *depth_mm.get((row * width + column) as usize)?;
        let point = camera.unproject(f64::from(column), f64::from(row), f64::from(mm) / 1000.0);
        (mm > 0).then_some([point.x, point.y, point.z])
    });
    points_message(Stamp(frame.header.stamp_ns), "camera", points)
}

/// The hits of a turn of the LiDAR, in `base`.
pub(super) fn scan(scan: &Scan, base_from_lidar: Pose2, z_m: f64) -> Value {
    let points = scan.ranges_m.iter().enumerate().filter(|(_, range_m)| range_m.is_finite());
    let points = points.map(|(k, range_m)| {
        let angle_rad = scan.angle_min_rad + scan.angle_step_rad * k as f64;
        let ahead =
            base_from_lidar * Pose2::new(0.0, 0.0, angle_rad) * Pose2::new(f64::from(*range_m), 0.0, 0.0);
        [ahead.x_m, ahead.y_m, z_m]
    });
    points_message(Stamp(scan.header.stamp_ns), "base", points)
}

fn points_message(stamp: Stamp, frame_id: &str, points: impl Iterator<Item = [f64; 3]>) -> Value {
    let bytes: Vec<u8> = points.flatten().flat_map(|m| (m as f32).to_le_bytes()).collect();
    let field = |name: &str, offset: u32| json!({ "name": name, "offset": offset, "type": FLOAT32 });
    json!({
        "timestamp": stamp.value(), "frame_id": frame_id, "pose": pose(Pose2::IDENTITY), "point_stride": 12,
        "fields": [field("x", 0), field("y", 4), field("z", 8)], "data": STANDARD.encode(bytes),
    })
}

/// A grid of bytes, in `map`.
pub(super) fn grid(stamp: Stamp, layout: &GridLayout, cells: &[u8]) -> Value {
    json!({
        "timestamp": stamp.value(), "frame_id": "map",
        "pose": pose(Pose2::new(layout.origin_map.x, layout.origin_map.y, 0.0)),
        "column_count": layout.n_cols, "cell_size": { "x": layout.resolution_m, "y": layout.resolution_m },
        "row_stride": layout.n_cols, "cell_stride": 1,
        "fields": [{ "name": "cell", "offset": 0, "type": UINT8 }], "data": STANDARD.encode(cells),
    })
}

/// A set of cells, 1 where it is set, in `map`.
pub(super) fn cell_set(stamp: Stamp, cells: &CellSet) -> Value {
    let bytes: Vec<u8> = cells.unpack().into_iter().map(u8::from).collect();
    grid(stamp, &cells.layout, &bytes)
}

/// A path of points, in `map`; each heads for the next.
pub(super) fn path(stamp: Stamp, points_map: &[[f64; 2]]) -> Value {
    let ahead = points_map.iter().skip(1).chain(points_map.last());
    let poses = points_map
        .iter()
        .zip(ahead)
        .map(|([x, y], [next_x, next_y])| pose(Pose2::new(*x, *y, (next_y - y).atan2(next_x - x))));
    json!({ "timestamp": stamp.value(), "frame_id": "map", "poses": poses.collect::<Vec<_>>() })
}

/// Where one frame lies in another, on the floor.
pub(super) fn transform(stamp: Stamp, parent: &str, child: &str, parent_from_child: Pose2) -> Value {
    let Value::Object(mut pose) = pose(parent_from_child) else { return Value::Null };
    json!({
        "timestamp": stamp.value(), "parent_frame_id": parent, "child_frame_id": child,
        "translation": pose.remove("position"), "rotation": pose.remove("orientation"),
    })
}

/// Where the camera sits.
pub(super) fn from_camera(stamp: Stamp, base_from_camera: &Pose3) -> Value {
    let (at, turn) = (base_from_camera.translation.vector, base_from_camera.rotation.coords);
    json!({
        "timestamp": stamp.value(), "parent_frame_id": "base", "child_frame_id": "camera",
        "translation": { "x": at.x, "y": at.y, "z": at.z },
        "rotation": { "x": turn.x, "y": turn.y, "z": turn.z, "w": turn.w },
    })
}

/// A line of text.
pub(super) fn log(stamp: Stamp, name: &str, words: &str) -> Value {
    json!({ "timestamp": stamp.value(), "level": INFO, "message": words, "name": name })
}

fn pose(pose: Pose2) -> Value {
    let half_rad = pose.yaw_rad / 2.0;
    json!({
        "position": { "x": pose.x_m, "y": pose.y_m, "z": 0.0 },
        "orientation": { "x": 0.0, "y": 0.0, "z": half_rad.sin(), "w": half_rad.cos() },
    })
}
