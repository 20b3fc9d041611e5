//! What depth sees within the robot's height and a 2D LiDAR does not: table tops, shelves, feet of chairs.
//!
//! A sparse column of height slices for each floor cell, each slice with its own evidence: points add to it, a
//! ray that passes through it to something farther takes from it. The floor stays out by a tolerance that
//! grows with depth squared, as the noise of such cameras does; what is above the robot stays out too.

use geometry::{Point2, Point3};
use rustc_hash::FxHashMap;

use crate::grid::{Grid, Layout};
use crate::image::DepthFrame;
use crate::projection::{DepthLimits, TrustedDepth};
use crate::raster::mark_box;

/// Height slices of a column.
const N_SLICES: usize = 16;

/// How obstacles are gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObstacleConfig {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Lowest point that is an obstacle, metres above the floor, at the camera …
    pub floor_clearance_m: f64,
    /// … and this much more for each metre of depth squared: three standard deviations of depth noise.
    pub floor_noise_per_m2: f64,
    /// Height of the robot with its margin, metres.
    pub height_m: f64,
    /// Fewest points over a cell, in one frame, that are a hit of the slices they lie in.
    pub n_points_min: u16,
    /// A slice counts from this much evidence on; a frame with hits adds 1.
    pub evidence_min: i8,
    /// Evidence never exceeds this.
    pub evidence_max: i8,
    /// Evidence taken by a frame that sees through the slice.
    pub clear_step: i8,
    /// Most cells held; beyond it new ones are refused and counted.
    pub n_cells_max: usize,
    /// Which depth is trusted, and how densely it is taken.
    pub limits: DepthLimits,
}

impl ObstacleConfig {
    /// For a robot of this height, 5 cm margin included: 5 cm cells, two frames make an obstacle, three of the
    /// other kind clear the surest one, up to 4 m away; 100 000 cells are 250 m².
    #[must_use]
    pub fn for_height(robot_height_m: f64) -> Self {
        ObstacleConfig {
            resolution_m: 0.05,
            floor_clearance_m: 0.03,
            floor_noise_per_m2: 0.006,
            height_m: robot_height_m + 0.05,
            n_points_min: 3,
            evidence_min: 2,
            evidence_max: 6,
            clear_step: 2,
            n_cells_max: 100_000,
            limits: DepthLimits { max_m: 4.0, ..DepthLimits::default() },
        }
    }
}

/// Obstacles within the robot's height, in `map`.
#[derive(Clone, Debug)]
pub struct ObstacleLayer {
    config: ObstacleConfig,
    columns: FxHashMap<[i32; 2], [i8; N_SLICES]>,
    n_refused: u64,
}

impl ObstacleLayer {
    /// Nothing seen yet.
    #[must_use]
    pub fn new(config: ObstacleConfig) -> Self {
        ObstacleLayer { config, columns: FxHashMap::default(), n_refused: 0 }
    }

    /// Number of cells with evidence.
    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.columns.len()
    }

    /// How many cells were refused since the start because the limit was reached.
    #[must_use]
    pub fn n_refused(&self) -> u64 {
        self.n_refused
    }

    /// Takes in one frame.
    pub fn integrate(&mut self, frame: &DepthFrame<'_>) {
        let hits = self.hits(frame);
        self.clear(frame, &hits);
        for (key, counts) in hits {
            let n_points = counts.iter().fold(0_u16, |sum, n| sum.saturating_add(*n));
            if n_points < self.config.n_points_min {
                continue;
            }
            if !self.columns.contains_key(&key) && self.columns.len() >= self.config.n_cells_max {
                self.n_refused += 1;
                continue;
            }
            let column = self.columns.entry(key).or_insert([0; N_SLICES]);
            for (evidence, count) in column.iter_mut().zip(counts) {
                if count > 0 {
                    *evidence = evidence.saturating_add(1).min(self.config.evidence_max);
                }
            }
        }
        self.columns.retain(|_, column| column.iter().any(|e| *e > 0));
    }

    /// The obstacles within `layout`.
    #[must_use]
    pub fn occupied(&self, layout: Layout) -> Grid<bool> {
        let mut result = Grid::filled(layout, false);
        let half = nalgebra::Vector2::repeat(self.config.resolution_m * 0.5 * (1.0 - 1e-6));
        for (key, column) in &self.columns {
            if column.iter().any(|e| *e >= self.config.evidence_min) {
                let [x, y] = key.map(|k| (f64::from(k) + 0.5) * self.config.resolution_m);
                let centre = Point2::new(x, y);
                mark_box(&mut result, centre - half, centre + half);
            }
        }
        result
    }

    fn slice_m(&self) -> f64 {
        self.config.height_m / N_SLICES as f64
    }

    /// Points of this frame in the band, by cell and slice.
    fn hits(&self, frame: &DepthFrame<'_>) -> FxHashMap<[i32; 2], [u16; N_SLICES]> {
        let trusted = TrustedDepth::new(frame, None, &self.config.limits);
        let mut hits: FxHashMap<[i32; 2], [u16; N_SLICES]> = FxHashMap::default();
        for (col, row) in trusted.pixels(self.config.limits.stride_px) {
            let Some(depth_m) = trusted.at(col, row).map(f64::from) else { continue };
            let at_map =
                frame.map_from_camera() * frame.intrinsics().unproject(col as f64, row as f64, depth_m);
            if at_map.z > self.floor_m(depth_m) && at_map.z < self.config.height_m {
                let key = [at_map.x, at_map.y].map(|c| (c / self.config.resolution_m).floor() as i32);
                let slice = ((at_map.z / self.slice_m()) as usize).min(N_SLICES - 1);
                let count = &mut hits.entry(key).or_insert([0; N_SLICES])[slice];
                *count = count.saturating_add(1);
            }
        }
        hits
    }

    /// Height up to which a point at this depth may be floor.
    fn floor_m(&self, depth_m: f64) -> f64 {
        self.config.floor_clearance_m + self.config.floor_noise_per_m2 * depth_m * depth_m
    }

    /// Takes evidence from slices that the frame sees through and that no point of it lies in.
    fn clear(&mut self, frame: &DepthFrame<'_>, hits: &FxHashMap<[i32; 2], [u16; N_SLICES]>) {
        let camera_from_map = frame.map_from_camera().inverse();
        let camera = *frame.intrinsics();
        let depth_mm = frame.depth().depth_mm();
        let (config, slice_m) = (self.config, self.slice_m());
        for (key, column) in &mut self.columns {
            let [x, y] = key.map(|k| (f64::from(k) + 0.5) * config.resolution_m);
            for (slice, evidence) in column.iter_mut().enumerate() {
                let is_hit = hits.get(key).is_some_and(|counts| counts[slice] > 0);
                if *evidence <= 0 || is_hit {
                    continue;
                }
                let centre_map = Point3::new(x, y, (slice as f64 + 0.5) * slice_m);
                let at_camera = camera_from_map * centre_map;
                let Some((u, v)) = camera.project(at_camera) else { continue };
                let (col, row) = ((u + 0.5).floor(), (v + 0.5).floor());
                let in_view = col >= 0.0
                    && row >= 0.0
                    && col < f64::from(camera.width)
                    && row < f64::from(camera.height);
                if !in_view || at_camera.z < config.limits.min_m {
                    continue;
                }
                let idx = row as usize * camera.width as usize + col as usize;
                let depth_m = f64::from(depth_mm[idx]) / 1000.0;
                let beyond_m = config.resolution_m + config.floor_noise_per_m2 * at_camera.z * at_camera.z;
                if depth_m > at_camera.z + beyond_m {
                    *evidence -= config.clear_step;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
