//! `heedway bench tsdf`: recorded RGB-D into the TSDF of one object, timed frame by frame.
//!
//! Reading and decoding are not timed, nor is making the mask, which comes from a model.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::Args;
use heedway_perception::recording::Recording;
use mapping::image::{DepthFrame, DepthImage, Mask};
use mapping::tsdf::{Tsdf, TsdfConfig};
use serde::Serialize;
use service::Clock;

use super::timing::Times;

/// Frames that a row is the median of: the folder's, spread over it at this step at most, again if there are fewer.
const N_FRAMES: usize = 30;
const STEP_MAX: usize = 10;
/// Rows and columns of the mask that covers a tenth of a 640×480 image, first and last.
const MASK_ROWS: (usize, usize) = (165, 314);
const MASK_COLS: (usize, usize) = (217, 421);
/// Truncation, voxels.
const TRUNCATION_VOXELS: f64 = 3.0;

/// Arguments of `heedway bench tsdf`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// A folder of recorded RGB-D.
    #[arg(long, value_name = "DIR")]
    rgbd: PathBuf,
    /// One JSON object a line instead of a table.
    #[arg(long)]
    json: bool,
    /// Also write the surface at 5 cm from whole frames without carving to this file, a point a line: x y z, metres.
    #[arg(long, value_name = "FILE")]
    surface: Option<PathBuf>,
}

/// What one row says.
#[derive(Serialize)]
struct Row {
    mode: &'static str,
    carve: bool,
    voxel_m: f64,
    median_ms: f64,
    mean_ms: f64,
    frames: usize,
    blocks: usize,
}

/// Times it.
///
/// # Errors
/// When the folder cannot be read.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let recording = Recording::open(&arguments.rgbd, None)?;
    let numbers = recording.numbers();
    let step = numbers.len().div_ceil(N_FRAMES).clamp(1, STEP_MAX);
    let chosen: Vec<u32> = numbers.iter().copied().step_by(step).take(N_FRAMES).collect();
    let frames = chosen.iter().map(|n| recording.read_depth(*n)).collect::<anyhow::Result<Vec<_>>>()?;
    if frames.is_empty() {
        bail!("{}: no frames", arguments.rgbd.display());
    }
    let camera = *recording.intrinsics();
    let (width, n_pixels) = (camera.width as usize, camera.n_pixels());
    let in_mask = |idx: usize| {
        let (row, col) = (idx / width, idx % width);
        (MASK_ROWS.0..=MASK_ROWS.1).contains(&row) && (MASK_COLS.0..=MASK_COLS.1).contains(&col)
    };
    let mask = Mask::new(camera.width, camera.height, (0..n_pixels).map(in_mask).collect())?;
    let clock = Clock::start();
    for voxel_m in [0.02, 0.05] {
        for (mode, mask) in [("full", None), ("mask10", Some(&mask))] {
            for carve in [false, true] {
                let mut tsdf = Tsdf::new(config(voxel_m, carve))?;
                let mut times = Times::default();
                while times.n() < N_FRAMES {
                    for frame in &frames {
                        let depth = DepthImage::new(camera.width, camera.height, &frame.depth_mm)?;
                        let frame = DepthFrame::new(depth, camera, frame.world_from_camera)?;
                        times.time(&clock, || tsdf.integrate(&frame, mask)).context(mode)?;
                    }
                }
                let is_compared = voxel_m > 0.03 && mask.is_none() && !carve;
                if let Some(file) = arguments.surface.as_ref().filter(|_| is_compared) {
                    write_surface(file, &tsdf)?;
                }
                tell(
                    arguments.json,
                    &Row {
                        mode,
                        carve,
                        voxel_m,
                        median_ms: times.median_ms(),
                        mean_ms: times.mean_ms(),
                        frames: times.n(),
                        blocks: tsdf.n_blocks(),
                    },
                )?;
            }
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes the points of a surface, one a line.
fn write_surface(file: &Path, tsdf: &Tsdf) -> anyhow::Result<()> {
    let lines =
        tsdf.surface_points().iter().map(|p| format!("{} {} {}\n", p.x, p.y, p.z)).collect::<String>();
    std::fs::write(file, lines).with_context(|| format!("write {}", file.display()))
}

fn config(voxel_m: f64, carve: bool) -> TsdfConfig {
    let product = TsdfConfig::default();
    TsdfConfig {
        voxel_m,
        truncation_m: TRUNCATION_VOXELS * voxel_m,
        carve_step: if carve { product.carve_step } else { 0.0 },
        absent_step: if carve { product.absent_step } else { 0.0 },
        n_blocks_max: 200_000,
        ..product
    }
}

#[allow(clippy::print_stdout, reason = "the table is what was asked for")]
fn tell(json: bool, row: &Row) -> anyhow::Result<()> {
    if json {
        println!("{}", serde_json::to_string(row)?);
    } else {
        let Row { mode, carve, voxel_m, median_ms, mean_ms, frames, blocks } = row;
        let carving = if *carve { "carving" } else { "no carving" };
        println!(
            "{voxel_m} m {mode:6} {carving:10}  median {median_ms:8.3} ms  mean {mean_ms:8.3} ms  {frames} frames  \
             {blocks} blocks"
        );
    }
    Ok(())
}
