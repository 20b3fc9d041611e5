//! All that was seen of one phrase: a surface in space, or an area of floor, whichever it turns out to be.
//!
//! Each frame in which the phrase was found votes on whether it stands or lies. Until the votes are clear
//! both are gathered; then only what is needed.

use geometry::Point2;
use mapping::floor_area::{FloorArea, ObjectKind, object_kind};
use mapping::occupancy::{HeightBand, Hidden, OccupancyError, Relation, footprint_seen_from, with_hidden};
use mapping::projection::{DepthLimits, project};
use mapping::tsdf::{Tsdf, TsdfConfigError};
use mapping::{DepthFrame, Grid, ImageError, Mask, Occupancy};

use super::models::Understood;
use super::object_maps::MapConfig;

/// From this lead on only one of the two is gathered.
const CLEAR_LEAD: i32 = 3;
/// The lead never exceeds this, so that a wrong start can be unlearned.
const LEAD_MAX: i32 = 8;
/// Every how many-th pixel votes.
const VOTE_STRIDE_PX: usize = 4;

/// What was seen of one phrase.
pub struct Evidence {
    tsdf: Tsdf,
    floor: FloorArea,
    /// Votes for a thing less votes for an area.
    lead: i32,
    /// Masks without depth enough to vote: water, or out of range.
    n_undecided: u32,
    newest_ns: u64,
    is_full: bool,
    /// Sum of the places in `map` that it was seen from, metres, and their number.
    eyes: (nalgebra::Vector2<f64>, u32),
    /// How the models understand the phrase.
    pub understood: Understood,
}

impl Evidence {
    /// Nothing seen yet.
    ///
    /// # Errors
    /// When the configuration cannot work.
    pub fn new(config: &MapConfig) -> Result<Self, TsdfConfigError> {
        Ok(Evidence {
            tsdf: Tsdf::new(config.tsdf)?,
            floor: FloorArea::new(config.floor),
            lead: 0,
            n_undecided: 0,
            newest_ns: 0,
            is_full: false,
            eyes: (nalgebra::Vector2::zeros(), 0),
            understood: Understood::Wholly,
        })
    }

    /// Stamp of the newest frame that was looked at.
    #[must_use]
    pub fn newest_ns(&self) -> u64 {
        self.newest_ns
    }

    /// Whether space has run out: some of the object may be missing.
    #[must_use]
    pub fn is_full(&self) -> bool {
        self.is_full
    }

    /// Whether it is an area of floor.
    #[must_use]
    pub fn is_flat(&self) -> bool {
        self.lead < 0 || (self.lead == 0 && self.n_undecided > 0)
    }

    /// Takes in a frame in which the phrase was found in the mask, or, without one, nowhere.
    ///
    /// # Errors
    /// [`ImageError`] when the mask is not of the frame's size.
    pub fn observe(
        &mut self,
        frame: &DepthFrame<'_>,
        mask: Option<&Mask>,
        stamp_ns: u64,
    ) -> Result<(), ImageError> {
        self.newest_ns = self.newest_ns.max(stamp_ns);
        let Some(mask) = mask else { return self.observe_absent(frame) };
        let (sum, n_eyes) = self.eyes;
        let eye = frame.map_from_camera().translation.vector.xy();
        self.eyes = (sum + eye, n_eyes.saturating_add(1));
        let limits = DepthLimits { stride_px: VOTE_STRIDE_PX, ..self.tsdf.config().limits };
        match object_kind(&project(frame, Some(mask), &limits)?) {
            ObjectKind::Thing => self.lead = (self.lead + 1).min(LEAD_MAX),
            ObjectKind::FloorArea => self.lead = (self.lead - 1).max(-LEAD_MAX),
            ObjectKind::Unknown => self.n_undecided = self.n_undecided.saturating_add(1),
        }
        if self.lead > -CLEAR_LEAD {
            self.is_full = self.tsdf.integrate(frame, Some(mask))?.n_blocks_refused > 0;
        }
        if self.lead < CLEAR_LEAD {
            self.floor.observe(frame, mask)?;
        }
        Ok(())
    }

    fn observe_absent(&mut self, frame: &DepthFrame<'_>) -> Result<(), ImageError> {
        if !self.tsdf.is_empty() {
            self.tsdf.observe_absent(frame)?;
        }
        if self.floor.n_cells() > 0 {
            let (width, height) = (frame.depth().width(), frame.depth().height());
            let nothing = Mask::new(width, height, vec![false; width as usize * height as usize])?;
            self.floor.observe(frame, &nothing)?;
        }
        Ok(())
    }

    /// The cells it covers, as its relation counts them.
    ///
    /// With the LiDAR's `base`, ground behind a thing that nobody has seen to be free is its own, where it matters how
    /// near it is; sides begin at what was seen of it.
    ///
    /// # Errors
    /// [`OccupancyError`] when there is not (or no longer) enough to tell.
    pub fn footprint(
        &self,
        relation: Relation,
        band: HeightBand,
        config: &MapConfig,
        base: Option<(&Grid<Occupancy>, Hidden)>,
    ) -> Result<Grid<bool>, OccupancyError> {
        if !self.is_flat() {
            let (sum, n_eyes) = self.eyes;
            let seen_from = (n_eyes > 0).then(|| Point2::from(sum / f64::from(n_eyes)));
            let points = self.tsdf.covered_points();
            let seen = footprint_seen_from(&points, relation, band, &config.closing, seen_from)?;
            return match (relation, base, seen_from) {
                (Relation::Near | Relation::On, Some((base, hidden)), Some(seen_from)) => {
                    Ok(with_hidden(&seen, base, seen_from, config.closing.join_m, hidden)?)
                }
                _ => Ok(seen),
            };
        }
        if relation == Relation::Beneath {
            // Nothing can be under what lies on the floor.
            return Err(OccupancyError::Nothing { n_points: self.floor.n_cells() });
        }
        self.floor.footprint()
    }
}
