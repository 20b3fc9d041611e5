//! Who knows where `odom` lies in `map`, and what the map is.
//!
//! A source is shown each scan with the base's pose in `odom` and answers with `map_from_odom`. One takes
//! odometry at its word and draws what the scans see from there; one matches the scans against the map that
//! they make; one matches them against a saved map. Between scans the pose is carried on by odometry whichever
//! it is.

use geometry::{Pose2, Profile};
use mapping::base_map::{BaseMapError, BaseMapper, Scan};
use mapping::localise::Localiser;
use mapping::slam::{MotionConfig, Slam, SlamConfig, Standing};
use mapping::{Grid, Occupancy};

use super::config::{PoseBy, Settings};

/// What a source makes of one scan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// `odom` in `map`.
    pub map_from_odom: Pose2,
    /// How well it is known.
    pub standing: Standing,
    /// The map is another one than before: it should be told at once.
    pub is_new_map: bool,
}

/// A source of the pose, and of the base map that fits it.
pub struct PoseSource {
    kind: Kind,
    /// Counts changes of the map frame.
    map_epoch: u64,
    map_from_odom: Pose2,
    slam: SlamConfig,
    /// `odom_from_base` at the last scan.
    last_odom_from_base: Option<Pose2>,
}

enum Kind {
    /// Odometry is believed; its origin lies in the map where the configuration says.
    Odometry(Option<Box<BaseMapper>>),
    /// The first scan begins the map.
    Slam(Option<Box<Slam>>),
    /// A saved map, until the first scan tells where odometry is, and then the search in it.
    Saved(Option<Grid<Occupancy>>),
    Localise(Box<Localiser>),
}

impl PoseSource {
    /// The source that is configured; `saved` is the map that [`PoseBy::Localise`] needs.
    #[must_use]
    pub fn new(settings: &Settings, profile: &Profile, saved: Option<Grid<Occupancy>>) -> Self {
        let lidar = profile.lidar;
        PoseSource {
            kind: match settings.pose {
                PoseBy::Odometry => Kind::Odometry(None),
                PoseBy::Slam => Kind::Slam(None),
                PoseBy::Localise => Kind::Saved(saved),
            },
            map_epoch: settings.map_epoch,
            map_from_odom: settings.map_from_odom(),
            slam: SlamConfig {
                base_from_lidar: Pose2::new(lidar.x_m, lidar.y_m, lidar.yaw_rad),
                range_used_m: settings.range_used_m,
                base_map: settings.base_map(),
                radius_m: profile.radius_m,
                ..SlamConfig::default()
            },
            last_odom_from_base: None,
        }
    }

    /// Epoch of the map frame.
    #[must_use]
    pub fn map_epoch(&self) -> u64 {
        self.map_epoch
    }

    /// Takes in a scan from where odometry says that it was taken.
    ///
    /// # Errors
    /// [`BaseMapError`] when the scan cannot be, or there is no map to find it in.
    pub fn take_in(&mut self, scan: &Scan<'_>, odom_from_base: Pose2) -> Result<Estimate, BaseMapError> {
        let last_from_now = self.last_odom_from_base.map(|last| last.inverse() * odom_from_base);
        let guess = self.map_from_odom * odom_from_base;
        let (standing, is_new_map) = match &mut self.kind {
            Kind::Odometry(mapper) => {
                let (mapper, is_new) = drawn_from(mapper, &self.slam, guess)?;
                mapper.integrate(scan, guess * self.slam.base_from_lidar)?;
                (Standing::Good, is_new)
            }
            Kind::Slam(slam) => {
                let is_new = slam.is_none();
                let slam = match slam {
                    Some(slam) => slam,
                    none => none.insert(Box::new(Slam::new(self.slam, guess)?)),
                };
                let located = slam.step(scan, last_from_now)?;
                self.map_from_odom = located.map_from_base * odom_from_base.inverse();
                self.map_epoch += u64::from(located.has_jumped);
                (located.standing, is_new || located.has_jumped)
            }
            Kind::Saved(saved) => {
                let map = saved.take().ok_or(BaseMapError::Pose)?;
                let SlamConfig { base_from_lidar, range_used_m, .. } = self.slam;
                let motion = MotionConfig::default();
                let localiser = Localiser::new(map, base_from_lidar, range_used_m, motion, guess);
                self.kind = Kind::Localise(Box::new(localiser));
                self.last_odom_from_base = None;
                let found = self.take_in(scan, odom_from_base)?;
                return Ok(Estimate { is_new_map: true, ..found });
            }
            Kind::Localise(localiser) => {
                let found = localiser.step(scan, last_from_now)?;
                self.map_from_odom = found.map_from_base * odom_from_base.inverse();
                self.map_epoch += u64::from(found.has_jumped);
                (found.standing, found.has_jumped)
            }
        };
        self.last_odom_from_base = Some(odom_from_base);
        Ok(Estimate { map_from_odom: self.map_from_odom, standing, is_new_map })
    }

    /// The base map; `None` before the first scan.
    #[must_use]
    pub fn base_map(&self) -> Option<Grid<Occupancy>> {
        match &self.kind {
            Kind::Odometry(mapper) => mapper.as_ref().map(|mapper| mapper.occupancy()),
            Kind::Slam(slam) => slam.as_ref().map(|slam| slam.base_map().occupancy()),
            Kind::Saved(_) => None,
            Kind::Localise(localiser) => Some(localiser.occupancy().clone()),
        }
    }

    /// The base has begun anew, and its `odom` frame with it: nobody but the scans knows how the new one lies
    /// to the old. Where odometry is all there is, what was mapped before fits no more.
    pub fn restart(&mut self) {
        let map_from_base = self.last_odom_from_base.take().map(|last| self.map_from_odom * last);
        match &mut self.kind {
            Kind::Odometry(mapper) => {
                *mapper = None;
                self.map_epoch += 1;
            }
            // It counts from zero where it stands.
            _ => self.map_from_odom = map_from_base.unwrap_or(self.map_from_odom),
        }
    }
}

/// The map that odometry's scans are drawn into, a new one if there is none.
fn drawn_from<'a>(
    mapper: &'a mut Option<Box<BaseMapper>>,
    config: &SlamConfig,
    map_from_base: Pose2,
) -> Result<(&'a mut BaseMapper, bool), BaseMapError> {
    let is_new = mapper.is_none();
    let drawn = match mapper {
        Some(drawn) => drawn,
        none => {
            let mut drawn = BaseMapper::new(config.base_map, map_from_base.position())?;
            drawn.free_disc(map_from_base.position(), config.radius_m)?;
            none.insert(Box::new(drawn))
        }
    };
    Ok((drawn, is_new))
}
