//! What is too thin for voxels: where its pixels fell, remembered and forgotten as voxels are.
//!
//! One place for each cube of a voxel's side that something thin was seen in, at the mean of where that was: not on the
//! lattice, so that the ray which looks for it later meets it. Only footprints are made of them; the surface is not.

use geometry::{Point3, Pose3};
use rustc_hash::FxHashMap;

use super::strips::Strip;
use super::update::View;
use super::{TsdfConfig, WEIGHT_LEFT};
use crate::image::DepthFrame;

/// Most places held for each block that may be.
const PLACES_PER_BLOCK: usize = 4;

/// Where something thin was seen.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    point_map: Point3,
    weight: f32,
    /// Number of the last frame that showed it.
    frame: u64,
}

/// All places of one object, by the cube that each lies in.
#[derive(Clone, Default)]
pub(super) struct Thin {
    places: FxHashMap<[i32; 3], Place>,
}

impl Thin {
    /// Takes in the strips of a frame, of which `frame_number` is the number; returns how many found no room.
    pub(super) fn see(
        &mut self,
        strips: &[Strip],
        frame: &DepthFrame<'_>,
        frame_number: u64,
        config: &TsdfConfig,
    ) -> usize {
        let map_from_camera: &Pose3 = frame.map_from_camera();
        let n_max = config.n_blocks_max.saturating_mul(PLACES_PER_BLOCK);
        let mut n_refused = 0;
        for strip in strips {
            let depth_m = f64::from(strip.depth_mm) * 0.001;
            let seen_camera = frame.intrinsics().unproject(strip.col as f64, strip.row as f64, depth_m);
            let point_map = map_from_camera * seen_camera;
            let key = [0, 1, 2].map(|axis| (point_map[axis] / config.voxel_m).floor() as i32);
            if let Some(place) = self.places.get_mut(&key) {
                // One frame says a thing once.
                if place.frame != frame_number {
                    place.point_map += (point_map - place.point_map) / f64::from(place.weight + 1.0);
                    place.weight = (place.weight + 1.0).min(config.weight_max);
                    place.frame = frame_number;
                }
            } else if self.places.len() < n_max {
                self.places.insert(key, Place { point_map, weight: 1.0, frame: frame_number });
            } else {
                n_refused += 1;
            }
        }
        n_refused
    }

    /// Takes weight from places that a frame, of which `frame_number` is the number, looked through or saw something else
    /// at.
    pub(super) fn clear(&mut self, view: &View<'_>, frame_number: u64) {
        self.places.retain(|_, place| {
            if place.frame != frame_number {
                place.weight -= view.lost_at(&place.point_map);
            }
            place.weight > 0.0
        });
    }

    /// Multiplies every weight.
    pub(super) fn decay(&mut self, keep: f32) {
        self.places.retain(|_, place| {
            place.weight *= keep;
            place.weight >= WEIGHT_LEFT
        });
    }

    pub(super) fn forget(&mut self) {
        self.places.clear();
    }

    pub(super) fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// Points in `map` that have at least this weight, in no order.
    pub(super) fn points(&self, weight_min: f32) -> impl Iterator<Item = Point3> + '_ {
        self.places.values().filter(move |place| place.weight >= weight_min).map(|place| place.point_map)
    }

    /// All numbers, in order of place: for laws.
    #[cfg(test)]
    pub(super) fn numbers(&self) -> Vec<([i32; 3], [u64; 3], u32, u64)> {
        let mut all: Vec<_> = self
            .places
            .iter()
            .map(|(key, p)| (*key, p.point_map.coords.map(f64::to_bits).into(), p.weight.to_bits(), p.frame))
            .collect();
        all.sort_unstable();
        all
    }
}
