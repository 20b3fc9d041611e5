//! What was found in a recording, in numbers: `summary.json`.

use std::collections::BTreeMap;
use std::path::Path;

use mapping::morphology::groups;
use mapping::{Grid, Layout, Shape};
use proto::{CellSet, Grounding, ObjectMap};
use rules::Rule;
use serde::Serialize;

use super::placing::Place;
use super::{Options, occupancy_file};

/// Cells of one region with a gap up to this between them are of one part, metres.
const JOIN_M: f64 = 0.11;

/// The whole.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Folder of the recording.
    pub recording: String,
    /// Where the floor is.
    pub floor: FloorSummary,
    /// The robot whose height tells what is beneath, and that height, metres.
    pub robot: (String, f64),
    /// What a person should know; empty when nothing.
    pub remark: String,
    /// Each frame that was to be looked at.
    pub frames: Vec<FrameSummary>,
    /// Each rule.
    pub rules: Vec<RuleSummary>,
}

/// Where the floor is.
#[derive(Clone, Debug, Serialize)]
pub struct FloorSummary {
    /// Up, in the recording's world.
    pub up_world: [f64; 3],
    /// Height of the first camera above it, metres.
    pub camera_height_m: f64,
    /// Share of the surface in view that lies on it.
    pub share: f64,
    /// The recording's world in `map` (z up, floor at 0): four rows.
    pub map_from_world: [[f64; 4]; 4],
}

/// One frame.
#[derive(Clone, Debug, Default, Serialize)]
pub struct FrameSummary {
    /// Its number.
    pub number: u32,
    /// Why it was left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<String>,
    /// What went wrong with it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trouble: Option<String>,
    /// Time for models and maps together, milliseconds.
    pub ms: f64,
    /// Pixels of each phrase.
    pub pixels: BTreeMap<String, usize>,
    /// File with the masks.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub overlay: Option<String>,
}

/// One rule.
#[derive(Clone, Debug, Serialize)]
pub struct RuleSummary {
    /// The rule.
    pub rule: Rule,
    /// How far it got.
    pub grounding: Grounding,
    /// What a person should know.
    pub remark: String,
    /// Its region, without the buffer; absent when there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region: Option<RegionSummary>,
}

/// A region on the floor.
#[derive(Clone, Debug, Serialize)]
pub struct RegionSummary {
    /// File of the image.
    pub pgm: String,
    /// File that says where it lies.
    pub yaml: String,
    /// Area, square metres.
    pub area_m2: f64,
    /// Parts that do not touch, largest first.
    pub parts: Vec<Part>,
}

/// One part of a region.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Part {
    /// Mean of its cells in `map`, metres.
    pub centre_m: [f64; 2],
    /// Extent along x and y, metres.
    pub size_m: [f64; 2],
    /// Area, square metres.
    pub area_m2: f64,
}

impl Summary {
    /// Joins its parts.
    #[must_use]
    pub fn new(options: &Options, place: &Place, frames: Vec<FrameSummary>, rules: Vec<RuleSummary>) -> Self {
        let first = place.frames.iter().find_map(|f| f.world_from_camera.as_ref().ok());
        let height_m = |pose: &geometry::Pose3| (place.map_from_world * pose).translation.z;
        let m = place.map_from_world.to_homogeneous();
        let row = |r: usize| [m[(r, 0)], m[(r, 1)], m[(r, 2)], m[(r, 3)]];
        Summary {
            recording: options.rgbd.display().to_string(),
            floor: FloorSummary {
                up_world: place.floor.up.into_inner().into(),
                camera_height_m: first.map_or(0.0, height_m),
                share: place.floor.share,
                map_from_world: [row(0), row(1), row(2), row(3)],
            },
            robot: (options.profile.name.clone(), options.profile.height_m),
            remark: place.remark.clone(),
            frames,
            rules,
        }
    }
}

impl RuleSummary {
    /// What was told of a rule, its region written to files in `out`.
    ///
    /// # Errors
    /// When a file cannot be written.
    pub fn of(rule: &Rule, told: Option<&ObjectMap>, out: &Path) -> anyhow::Result<Self> {
        let needs = rule.needs_grounding();
        let silent = if needs { Grounding::Searching } else { Grounding::NotNeeded };
        let region = match told.and_then(|map| map.region.as_ref()) {
            Some(cells) => Some(RegionSummary::of(cells, out, &rule.id)?),
            None => None,
        };
        Ok(RuleSummary {
            rule: rule.clone(),
            grounding: told.map_or(silent, |map| map.grounding),
            remark: told.map(|map| map.remark.clone()).unwrap_or_default(),
            region,
        })
    }
}

impl RegionSummary {
    fn of(cells: &CellSet, out: &Path, name: &str) -> anyhow::Result<Self> {
        let (pgm, yaml) = occupancy_file::write(cells, out, name)?;
        let layout = &cells.layout;
        let shape = Shape { n_cols: layout.n_cols as usize, n_rows: layout.n_rows as usize };
        let layout = Layout::new(layout.origin_map, layout.resolution_m, shape)?;
        let grid = Grid::from_values(layout, cells.unpack())?;
        let cell_m2 = layout.resolution_m * layout.resolution_m;
        let mut parts: Vec<Part> = groups(&grid, JOIN_M)
            .into_iter()
            .map(|group| {
                let n = group.len().max(1) as f64;
                let centres = || group.iter().map(|c| layout.centre(*c).coords);
                let mean = centres().sum::<nalgebra::Vector2<f64>>() / n;
                let start = nalgebra::Vector2::repeat(f64::INFINITY);
                let (low, high) =
                    centres().fold((start, -start), |(low, high), c| (low.inf(&c), high.sup(&c)));
                let size = (high - low).add_scalar(layout.resolution_m);
                Part { centre_m: mean.into(), size_m: size.into(), area_m2: n * cell_m2 }
            })
            .collect();
        parts.sort_by(|a, b| b.area_m2.total_cmp(&a.area_m2));
        let area_m2 = parts.iter().map(|p| p.area_m2).sum();
        Ok(RegionSummary { pgm, yaml, area_m2, parts })
    }
}
