//! Areas of floor: rugs, pools, spills, a taped-off square. Flat, or without depth of their own.
//!
//! No depth is needed: the ray through each masked pixel is cut with the floor, z = 0 in `map`. A pixel whose
//! measured depth lies clearly in front of the floor shows something that stands there, and says nothing of
//! the floor behind it. Cells gather hits and lose them again when they are seen outside the mask.
//!
//! A camera on a low robot does not see the floor before its wheels: an area is driven past with a corner that was
//! never in the picture. So cells that were seen bare are remembered, and what was not seen at all counts
//! as part of the area within its convex outline and a little beyond its edge.

use geometry::{Point2, Point3, Polygon};
use nalgebra::Vector2;
use rustc_hash::{FxHashMap, FxHashSet};

use crate::grid::Grid;
use crate::image::{DepthFrame, ImageError, Mask};
use crate::morphology::{dilated, groups, padded};
use crate::occupancy::{Closing, HeightBand, OccupancyError, Relation, footprint};
use crate::raster::mark_polygon;
use crate::region::convex_hull;

/// Height above the floor up to which a point is floor, metres.
pub const FLOOR_HEIGHT_M: f64 = 0.03;
/// Share of points that may be higher than that: depth is noisy.
const HIGH_SHARE_MAX: f64 = 0.05;
/// Fewest points that decide.
const N_POINTS_DECIDING: usize = 20;

/// Whether an object stands or lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectKind {
    /// It has height: its surface is gathered in a TSDF.
    Thing,
    /// Flat: gathered as an area of floor.
    FloorArea,
    /// Too few points to tell: out of range, or water, which gives no depth.
    Unknown,
}

/// Tells a flat object from a standing one by its points in `map`.
#[must_use]
pub fn object_kind(points_map: &[Point3]) -> ObjectKind {
    if points_map.len() < N_POINTS_DECIDING {
        return ObjectKind::Unknown;
    }
    // Farther pixels are noisier, but also see the floor at a flatter angle: the height of a point on the
    // floor is off by a share of its error in depth only. So one height serves for all.
    let n_high = points_map.iter().filter(|p| p.z > FLOOR_HEIGHT_M).count();
    if n_high as f64 <= HIGH_SHARE_MAX * points_map.len() as f64 {
        ObjectKind::FloorArea
    } else {
        ObjectKind::Thing
    }
}

/// How an area of floor is gathered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorConfig {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Farthest floor that is used, metres along the optical axis: beyond, a pixel is many cells long.
    pub range_m: f64,
    /// A pixel is of the floor when its depth reaches the floor's to within this, metres, …
    pub slack_m: f64,
    /// … and this much more for each metre of depth squared.
    pub slack_per_m2: f64,
    /// A cell counts from this much evidence on; a hit is 1.
    pub evidence_min: f32,
    /// Evidence never exceeds this.
    pub evidence_max: f32,
    /// Evidence taken when a cell is seen outside the mask.
    pub miss_step: f32,
    /// Most cells held; beyond it new ones are refused and counted.
    pub n_cells_max: usize,
}

impl Default for FloorConfig {
    /// 5 cm, up to 5 m away, two frames that agree; 200 000 cells are 500 m².
    fn default() -> Self {
        FloorConfig {
            resolution_m: 0.05,
            range_m: 5.0,
            slack_m: 0.08,
            slack_per_m2: 0.01,
            evidence_min: 1.5,
            evidence_max: 8.0,
            miss_step: 1.0,
            n_cells_max: 200_000,
        }
    }
}

/// So far beyond its edge what was never seen counts as part of an area, metres: two cells of the usual size.
const UNSEEN_EDGE_M: f64 = 0.1;

/// One rule's area of floor, in `map`.
#[derive(Clone, Debug)]
pub struct FloorArea {
    config: FloorConfig,
    evidence: FxHashMap<[i32; 2], f32>,
    /// Cells near the area that were seen, and not in the mask.
    bare: FxHashSet<[i32; 2]>,
    n_refused: u64,
}

impl FloorArea {
    /// An empty area. A resolution outside 0.005 to 1 m is refused when the footprint is asked for.
    #[must_use]
    pub fn new(config: FloorConfig) -> Self {
        FloorArea { config, evidence: FxHashMap::default(), bare: FxHashSet::default(), n_refused: 0 }
    }

    /// Number of cells with evidence.
    #[must_use]
    pub fn n_cells(&self) -> usize {
        self.evidence.len()
    }

    /// How many cells were refused since the start because the limit was reached.
    #[must_use]
    pub fn n_refused(&self) -> u64 {
        self.n_refused
    }

    /// Takes in one frame and its mask; an empty mask is a frame in which the area was not found.
    ///
    /// # Errors
    /// [`ImageError::Size`] when the mask is not of the frame's size.
    pub fn observe(&mut self, frame: &DepthFrame<'_>, mask: &Mask) -> Result<(), ImageError> {
        frame.check_mask(mask)?;
        let config = self.config;
        let floor = FloorView::new(frame, mask, &config);
        // Cells held already: seen in the mask, seen outside it, or not seen.
        self.evidence.retain(|&key, evidence| {
            match floor.look(key) {
                Seen::Masked => *evidence = (*evidence + 1.0).min(config.evidence_max),
                Seen::Bare => *evidence -= config.miss_step,
                Seen::Not => {}
            }
            *evidence > 0.0
        });
        // New cells: all in the box around the mask's rays, so that none is missed between two far rows, and all
        // around the area, so that its edge is seen to be one.
        // A frame in which nothing was found may be a frame in which too little of it was to be seen: it takes
        // evidence away, and is no proof of bare floor.
        let Some(masked) = floor.masked_box() else { return Ok(()) };
        for (low, high) in [Some(masked), self.outskirts()].into_iter().flatten() {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    self.meet([x, y], &floor);
                }
            }
        }
        Ok(())
    }

    /// Takes in what a frame says of a cell that has no evidence yet.
    fn meet(&mut self, key: [i32; 2], floor: &FloorView<'_>) {
        if self.evidence.contains_key(&key) {
            return;
        }
        match floor.look(key) {
            Seen::Masked if self.evidence.len() < self.config.n_cells_max => {
                self.evidence.insert(key, 1.0);
                self.bare.remove(&key);
            }
            Seen::Masked => self.n_refused += 1,
            Seen::Bare if self.bare.len() < self.config.n_cells_max && floor.is_surely_bare(key) => {
                self.bare.insert(key);
            }
            Seen::Bare | Seen::Not => {}
        }
    }

    /// The box around all cells with evidence, and as far around it as the unseen may count as area.
    fn outskirts(&self) -> Option<([i32; 2], [i32; 2])> {
        let mut cells = self.evidence.keys();
        let first = *cells.next()?;
        let (low, high) = cells.fold((first, first), |(low, high), key| {
            ([low[0].min(key[0]), low[1].min(key[1])], [high[0].max(key[0]), high[1].max(key[1])])
        });
        let n_beyond = (UNSEEN_EDGE_M / self.config.resolution_m).ceil() as i32 + 1;
        let first = low.map(|k| k - n_beyond);
        let last = [0, 1].map(|axis| (high[axis] + n_beyond).min(first[axis].saturating_add(N_BOX_SIDE_MAX)));
        Some((first, last))
    }

    /// The area, closed and filled; with it what was never seen, within its convex outline (of each part that
    /// hangs together) and up to 0.1 m beyond its edge.
    ///
    /// # Errors
    /// [`OccupancyError`] when no cell has evidence enough, or the cells are too far apart for a grid.
    pub fn footprint(&self) -> Result<Grid<bool>, OccupancyError> {
        let resolution_m = self.config.resolution_m;
        let mut points: Vec<Point3> = self
            .evidence
            .iter()
            .filter(|(_, evidence)| **evidence >= self.config.evidence_min)
            .map(|(key, _)| {
                let [x, y] = key.map(|k| (f64::from(k) + 0.5) * resolution_m);
                Point3::new(x, y, 0.0)
            })
            .collect();
        // A hash map has no order of its own; the result must not depend on it.
        points.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
        let closing = Closing { resolution_m, fill_radius_m: 2.0 * resolution_m, ..Closing::default() };
        let seen = footprint(&points, Relation::On, HeightBand { robot_height_m: 0.0 }, &closing)?;
        let n_border = (UNSEEN_EDGE_M / seen.layout().resolution_m).ceil() as usize + 1;
        // An area too large for a border keeps what was seen of it.
        Ok(padded(&seen, n_border).map_or(seen, |wide| self.with_unseen(wide)))
    }

    fn with_unseen(&self, mut area: Grid<bool>) -> Grid<bool> {
        let layout = *area.layout();
        let half_m = layout.resolution_m / 2.0;
        let key = |at: Point2| [at.x, at.y].map(|v| (v / self.config.resolution_m).floor() as i32);
        let mut wider = dilated(&area, UNSEEN_EDGE_M);
        for group in groups(&area, 2.0 * layout.resolution_m) {
            let corners = group.iter().flat_map(|cell| {
                let centre = layout.centre(*cell);
                [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
                    .map(|(x, y)| centre + Vector2::new(x, y) * (half_m - 1e-6))
            });
            if let Ok(outline) = Polygon::new(convex_hull(corners.collect())) {
                mark_polygon(&mut wider, &outline);
            }
        }
        for cell in layout.cells().filter(|cell| *wider.get(*cell)) {
            if !self.bare.contains(&key(layout.centre(cell))) {
                area.set(cell, true);
            }
        }
        area
    }
}

/// What a frame says of a floor cell.
enum Seen {
    Masked,
    Bare,
    Not,
}

/// One frame and its mask, ready to be asked by floor cells.
struct FloorView<'a> {
    frame: &'a DepthFrame<'a>,
    mask: &'a Mask,
    config: &'a FloorConfig,
    camera_from_map: geometry::Pose3,
}

/// Most cells along one side of the box in which new ones are looked for.
const N_BOX_SIDE_MAX: i32 = 512;

impl<'a> FloorView<'a> {
    fn new(frame: &'a DepthFrame<'a>, mask: &'a Mask, config: &'a FloorConfig) -> Self {
        FloorView { frame, mask, config, camera_from_map: frame.map_from_camera().inverse() }
    }

    fn look(&self, key: [i32; 2]) -> Seen {
        let [x, y] = key.map(|k| (f64::from(k) + 0.5) * self.config.resolution_m);
        let at_camera = self.camera_from_map * Point3::new(x, y, 0.0);
        if at_camera.z > self.config.range_m {
            return Seen::Not;
        }
        let camera = self.frame.intrinsics();
        let Some((u, v)) = camera.project(at_camera) else { return Seen::Not };
        let (col, row) = ((u + 0.5).floor(), (v + 0.5).floor());
        let (width, height) = (f64::from(camera.width), f64::from(camera.height));
        if !(0.0..width).contains(&col) || !(0.0..height).contains(&row) {
            return Seen::Not;
        }
        let idx = row as usize * camera.width as usize + col as usize;
        if self.is_hidden(idx, at_camera.z) {
            return Seen::Not;
        }
        if self.mask.bits()[idx] { Seen::Masked } else { Seen::Bare }
    }

    /// Whether a cell that is seen bare is not next to the mask: from afar a pixel is longer than a cell, and the
    /// edge of an area is told to a pixel only.
    fn is_surely_bare(&self, key: [i32; 2]) -> bool {
        let [x, y] = key.map(|k| (f64::from(k) + 0.5) * self.config.resolution_m);
        let camera = self.frame.intrinsics();
        let at_camera = self.camera_from_map * Point3::new(x, y, 0.0);
        let Some((u, v)) = camera.project(at_camera) else { return false };
        let (width, height) = (i64::from(camera.width), i64::from(camera.height));
        let (col, row) = ((u + 0.5).floor() as i64, (v + 0.5).floor() as i64);
        (-1..=1).flat_map(|dv| (-1..=1).map(move |du| (col + du, row + dv))).all(|(col, row)| {
            let is_outside = !(0..width).contains(&col) || !(0..height).contains(&row);
            is_outside || !self.mask.bits()[(row * width + col) as usize]
        })
    }

    /// Whether something stands in front of the floor at a pixel. No depth, as over water, hides nothing.
    fn is_hidden(&self, idx: usize, floor_depth_m: f64) -> bool {
        let depth_m = f64::from(self.frame.depth().depth_mm()[idx]) / 1000.0;
        let slack_m = self.config.slack_m + self.config.slack_per_m2 * floor_depth_m * floor_depth_m;
        depth_m > 0.0 && depth_m < floor_depth_m - slack_m
    }

    /// The box of cells around where the mask's rays meet the floor; `None` when none does.
    fn masked_box(&self) -> Option<([i32; 2], [i32; 2])> {
        let (cols, rows) = self.mask.bounds()?;
        let camera = self.frame.intrinsics();
        let eye = self.frame.map_from_camera().translation.vector;
        let (mut low, mut high): (Option<Point2>, Option<Point2>) = (None, None);
        for row in rows {
            for col in cols.clone() {
                let idx = row * camera.width as usize + col;
                if !self.mask.bits()[idx] {
                    continue;
                }
                let ray_camera = camera.unproject(col as f64, row as f64, 1.0).coords;
                let ray_map = self.frame.map_from_camera().rotation * ray_camera;
                // Depth along the optical axis at which the ray meets z = 0.
                let depth_m = -eye.z / ray_map.z;
                if !(depth_m > 0.0 && depth_m <= self.config.range_m) || self.is_hidden(idx, depth_m) {
                    continue;
                }
                let hit = Point2::from((eye + ray_map * depth_m).xy());
                low = Some(low.map_or(hit, |l| l.inf(&hit)));
                high = Some(high.map_or(hit, |h| h.sup(&hit)));
            }
        }
        let cell = |v: f64| (v / self.config.resolution_m).floor() as i32;
        let (low, high) = (low?, high?);
        let (first, last) = ([cell(low.x) - 1, cell(low.y) - 1], [cell(high.x) + 1, cell(high.y) + 1]);
        Some((first, [0, 1].map(|axis| last[axis].min(first[axis].saturating_add(N_BOX_SIDE_MAX)))))
    }
}

#[cfg(test)]
mod tests;
