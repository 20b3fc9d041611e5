//! The base map: what a 2D LiDAR has seen free and what it has seen stand, as log-odds in a growing grid.
//!
//! Poses come from outside. Within one scan each cell is counted once, and a cell that any beam hits is not
//! freed by another that grazes it, so that a wall seen along its length does not dissolve. What beams pass is
//! first gathered as bits and then counted, many cells at once.

mod odds;

use geometry::{Point2, Pose2};
use odds::Odds;

use crate::bits::{BitGrid, N_WORD};
use crate::grid::{Cell, Grid, GridError, Layout, Occupancy, Shape};
use crate::raster::mark_disc;

/// One turn of a LiDAR, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// Range of each beam, metres. NaN is no beam; 0 and anything beyond `range_max_m` is no return.
    pub ranges_m: &'a [f32],
    /// Direction of the first beam in the LiDAR's frame, radians.
    pub angle_min_rad: f64,
    /// From one beam to the next, radians.
    pub angle_increment_rad: f64,
    /// Nearest range that is a measurement, metres.
    pub range_min_m: f64,
    /// Farthest range that is a measurement, metres.
    pub range_max_m: f64,
    /// Whether a beam without return is known to have met nothing up to `range_max_m`. Black and glass give no
    /// return either: only for a LiDAR that tells them apart.
    pub no_return_is_free: bool,
}

impl Scan<'_> {
    /// Checks angles and limits.
    ///
    /// # Errors
    /// [`BaseMapError::Scan`] names them.
    pub fn check(&self) -> Result<(), BaseMapError> {
        let Scan { angle_min_rad, angle_increment_rad, range_min_m, range_max_m, .. } = *self;
        let ok = angle_min_rad.is_finite()
            && angle_increment_rad.is_finite()
            && range_min_m >= 0.0
            && range_max_m > range_min_m
            && range_max_m <= 1000.0;
        if ok {
            Ok(())
        } else {
            Err(BaseMapError::Scan { angle_min_rad, angle_increment_rad, range_min_m, range_max_m })
        }
    }
}

/// How the base map is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BaseMapConfig {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Log-odds that a hit adds.
    pub hit: f32,
    /// Log-odds that a beam passing through takes.
    pub free: f32,
    /// Log-odds stay within ± this: what has changed can be unlearned.
    pub log_odds_max: f32,
    /// Beams are followed at most this far, metres.
    pub range_used_m: f64,
}

impl Default for BaseMapConfig {
    /// 5 cm; a hit weighs as much as two passes; nine passes free what was surely occupied.
    fn default() -> Self {
        BaseMapConfig { resolution_m: 0.05, hit: 0.85, free: 0.4, log_odds_max: 3.5, range_used_m: 25.0 }
    }
}

/// A scan that the map does not take in; the map is as it was.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum BaseMapError {
    /// A pose that is NaN or infinite.
    #[error("pose of the lidar is not finite")]
    Pose,
    /// Angles or limits of a scan that cannot be.
    #[error(
        "scan with first angle {angle_min_rad} rad, increment {angle_increment_rad} rad, range {range_min_m} to {range_max_m} m"
    )]
    Scan {
        /// First angle, radians.
        angle_min_rad: f64,
        /// Increment, radians.
        angle_increment_rad: f64,
        /// Nearest range, metres.
        range_min_m: f64,
        /// Farthest range, metres.
        range_max_m: f64,
    },
    /// The map would become too large, or is configured impossibly.
    #[error(transparent)]
    Grid(#[from] GridError),
}

/// Cells by which a map grows at least, and share of its side: growing copies it.
const GROWTH_CELLS: f64 = 64.0;
const GROWTH_SHARE: f64 = 0.2;

/// Builds the base map in `map`.
#[derive(Clone, Debug)]
pub struct BaseMapper {
    config: BaseMapConfig,
    odds: Odds,
    /// In units of `odds`.
    log_odds: Grid<i16>,
    /// Cells that the beams of a scan pass; of no meaning between scans.
    passed: BitGrid,
}

impl BaseMapper {
    /// An unknown map around a point, growing as scans come.
    ///
    /// # Errors
    /// [`GridError`] when the resolution or the point is out of bounds.
    pub fn new(config: BaseMapConfig, around: Point2) -> Result<Self, GridError> {
        let half = nalgebra::Vector2::repeat(GROWTH_CELLS * config.resolution_m);
        let layout = Layout::covering(around - half, around + half, config.resolution_m)?;
        Ok(BaseMapper::on(layout, config))
    }

    /// An unknown map with the configuration and the room of this one.
    #[must_use]
    pub fn blank(&self) -> Self {
        BaseMapper::on(*self.layout(), self.config)
    }

    fn on(layout: Layout, config: BaseMapConfig) -> Self {
        BaseMapper {
            odds: Odds::new(&config),
            config,
            log_odds: Grid::filled(layout, 0),
            passed: BitGrid::default(),
        }
    }

    /// Where the map lies at present.
    #[must_use]
    pub fn layout(&self) -> &Layout {
        self.log_odds.layout()
    }

    /// The map as it stands: one hit makes a cell occupied, one pass free.
    #[must_use]
    pub fn occupancy(&self) -> Grid<Occupancy> {
        self.log_odds.map(|value| self.odds.occupancy(*value))
    }

    /// Frees every cell that the disc touches, unless something was seen to stand there: where the robot's hull
    /// is when it starts, nothing else can be, and no beam will ever show it.
    ///
    /// # Errors
    /// [`BaseMapError`] when the disc is not finite or the map would become too large.
    pub fn free_disc(&mut self, centre_map: Point2, radius_m: f64) -> Result<(), BaseMapError> {
        if !(centre_map.coords.iter().all(|c| c.is_finite()) && radius_m.is_finite()) {
            return Err(BaseMapError::Pose);
        }
        let reach = nalgebra::Vector2::repeat(radius_m.abs());
        self.grow(centre_map - reach, centre_map + reach)?;
        let mut disc = Grid::filled(*self.layout(), false);
        mark_disc(&mut disc, centre_map, radius_m);
        for (value, in_disc) in self.log_odds.values_mut().iter_mut().zip(disc.values()) {
            if *in_disc && self.odds.occupancy(*value) != Occupancy::Occupied {
                *value = (*value).min(self.odds.passed(0));
            }
        }
        Ok(())
    }

    /// Takes in one scan from `map_from_lidar`.
    ///
    /// # Errors
    /// [`BaseMapError`] when scan or pose cannot be, or the map would become too large.
    pub fn integrate(&mut self, scan: &Scan<'_>, map_from_lidar: Pose2) -> Result<(), BaseMapError> {
        if !map_from_lidar.is_finite() {
            return Err(BaseMapError::Pose);
        }
        scan.check()?;
        let beams = self.beams(scan, map_from_lidar);
        let eye = map_from_lidar.position();
        let (mut low, mut high) = (eye, eye);
        for beam in &beams {
            low = low.inf(&beam.end);
            high = high.sup(&beam.end);
        }
        self.grow(low, high)?;
        self.draw(eye, &beams);
        Ok(())
    }

    fn beams(&self, scan: &Scan<'_>, map_from_lidar: Pose2) -> Vec<Beam> {
        let reach_m = scan.range_max_m.min(self.config.range_used_m);
        let mut beams = Vec::with_capacity(scan.ranges_m.len());
        for (idx, &range_m) in scan.ranges_m.iter().enumerate() {
            let range_m = f64::from(range_m);
            let has_return = range_m >= scan.range_min_m && range_m <= scan.range_max_m && range_m > 0.0;
            let is_no_return = range_m > scan.range_max_m || range_m == 0.0;
            let is_clear = is_no_return && scan.no_return_is_free;
            if !(has_return || is_clear) {
                continue;
            }
            let length_m = if has_return { range_m.min(reach_m) } else { reach_m };
            let angle_rad = scan.angle_min_rad + idx as f64 * scan.angle_increment_rad;
            let end_lidar = Point2::new(length_m * angle_rad.cos(), length_m * angle_rad.sin());
            let is_hit = has_return && range_m <= reach_m;
            beams.push(Beam { end: map_from_lidar.transform(end_lidar), is_hit });
        }
        beams
    }

    /// Counts each cell that a beam passes or hits once. The map holds the eye and all ends.
    fn draw(&mut self, eye: Point2, beams: &[Beam]) {
        let layout = *self.layout();
        let in_cells = |p: Point2| Point2::from((p - layout.origin) / layout.resolution_m);
        let eye = in_cells(eye);
        let (mut low, mut high) = (eye, eye);
        for beam in beams {
            low = low.inf(&in_cells(beam.end));
            high = high.sup(&in_cells(beam.end));
        }
        // Bits are gathered for the part of the map that the scan shows.
        let (first_word, first_row) = (low.x as usize / N_WORD, low.y as usize);
        let corner = nalgebra::Vector2::new((first_word * N_WORD) as f64, first_row as f64);
        self.passed.reset(high.x as usize / N_WORD + 1 - first_word, high.y as usize + 1 - first_row);
        let mut last = None;
        let mut hits: Vec<Cell> = Vec::with_capacity(beams.len());
        for beam in beams {
            let Some(cell) = layout.cell_at(beam.end) else { continue };
            // Neighbours that end in one cell pass the same ones, all but.
            if last != Some(cell) {
                self.passed.pass(eye - corner, in_cells(beam.end) - corner);
                last = Some(cell);
            }
            if beam.is_hit {
                hits.push(cell);
            }
        }
        hits.sort_unstable_by_key(|cell| layout.index(*cell));
        hits.dedup();
        for cell in hits {
            self.passed.clear(cell.col - first_word * N_WORD, cell.row - first_row);
            let value = self.odds.hit(*self.log_odds.get(cell));
            self.log_odds.set(cell, value);
        }
        let n_cols = layout.shape.n_cols;
        for (nth, words) in self.passed.rows().enumerate() {
            let from = (first_row + nth) * n_cols + first_word * N_WORD;
            let cells = self.log_odds.values_mut().get_mut(from..).unwrap_or_default();
            self.odds.pass(cells, words);
        }
    }

    /// Makes the map hold a box, with room to spare.
    fn grow(&mut self, low: Point2, high: Point2) -> Result<(), GridError> {
        let old = *self.layout();
        let margin = nalgebra::Vector2::repeat(old.resolution_m);
        let (near, far) = (old.origin + margin, old.far_corner() - margin);
        if low.x >= near.x && low.y >= near.y && high.x <= far.x && high.y <= far.y {
            return Ok(());
        }
        // Whole chunks of cells, counted from the old origin, so that cells stay where they are.
        let longest = old.shape.n_cols.max(old.shape.n_rows) as f64;
        let chunk = GROWTH_CELLS * (GROWTH_SHARE * longest / GROWTH_CELLS).ceil();
        let chunk_m = chunk * old.resolution_m;
        let chunks = |over_m: f64| ((over_m / chunk_m).ceil().max(0.0) * chunk) as usize;
        let before = [chunks(near.x - low.x), chunks(near.y - low.y)];
        let after = [chunks(high.x - far.x), chunks(high.y - far.y)];
        let shape = Shape {
            n_cols: old.shape.n_cols + before[0] + after[0],
            n_rows: old.shape.n_rows + before[1] + after[1],
        };
        let off = nalgebra::Vector2::new(before[0] as f64, before[1] as f64) * old.resolution_m;
        let layout = Layout::new(old.origin - off, old.resolution_m, shape)?;
        self.log_odds = moved(&self.log_odds, layout, before);
        Ok(())
    }
}

/// One beam, in `map`.
struct Beam {
    end: Point2,
    is_hit: bool,
}

fn moved<T: Copy + Default>(old: &Grid<T>, layout: Layout, off: [usize; 2]) -> Grid<T> {
    let mut grown = Grid::filled(layout, T::default());
    let n = old.layout().shape.n_cols;
    for (row, values) in old.values().chunks_exact(n).enumerate() {
        let begin = (row + off[1]) * layout.shape.n_cols + off[0];
        grown.values_mut()[begin..begin + n].copy_from_slice(values);
    }
    grown
}

#[cfg(test)]
mod tests;
