//! What localisation makes of odometry and scans.

use std::time::Duration;

use geometry::{Pose2, Profile, Time};
use mapping::base_map::{BaseMapError, BaseMapper, Scan as BaseScan};
use proto::{BaseMap, Header, Odometry, PoseEstimate, Scan};

use crate::odometry_track::{Heard, NoPose, OdometryTrack};
use crate::wire::{grid_layout, occupancy_bytes};

use super::config::Settings;
use super::pose_source::PoseSource;

/// The base map is repeated this often.
const MAP_PERIOD: Duration = Duration::from_secs(1);
/// No scan for this long is told.
const SILENCE_MAX: Duration = Duration::from_secs(1);

/// What reaches localisation.
#[derive(Clone, Debug)]
pub enum Input {
    /// Where the wheels say the base is.
    Odometry(Odometry),
    /// One turn of the LiDAR.
    Scan(Scan),
    /// Time has passed.
    Tick,
}

/// What localisation does.
#[derive(Clone, Debug, PartialEq)]
pub enum Output {
    /// Publish the pose.
    Pose(PoseEstimate),
    /// Publish the base map.
    BaseMap(BaseMap),
    /// Say what is wrong; empty when nothing is.
    Trouble(String),
}

/// Localisation, without the world around it.
pub struct Decider {
    settings: Settings,
    map_from: Mounts,
    track: OdometryTrack,
    source: PoseSource,
    mapper: Option<BaseMapper>,
    /// A scan that odometry has not reached yet, and when it came.
    waiting: Option<(Time, Scan)>,
    newest_scan: Header,
    n_poses: u64,
    n_maps: u64,
    n_left_out: u64,
    last_left_out: String,
    map_sent: Option<Time>,
    taken_in: Option<Time>,
    trouble: String,
}

/// What the profile says of the robot's body.
struct Mounts {
    base_from_lidar: Pose2,
    radius_m: f64,
}

impl Decider {
    /// Localisation at its start.
    #[must_use]
    pub fn new(settings: Settings, profile: &Profile) -> Self {
        let lidar = profile.lidar;
        let base_from_lidar = Pose2::new(lidar.x_m, lidar.y_m, lidar.yaw_rad);
        Decider {
            map_from: Mounts { base_from_lidar, radius_m: profile.radius_m },
            track: OdometryTrack::new(settings.odometry_gap()),
            source: PoseSource::Odometry {
                map_from_odom: settings.map_from_odom(),
                map_epoch: settings.map_epoch,
            },
            settings,
            mapper: None,
            waiting: None,
            newest_scan: Header::default(),
            n_poses: 0,
            n_maps: 0,
            n_left_out: 0,
            last_left_out: String::new(),
            map_sent: None,
            taken_in: None,
            trouble: String::new(),
        }
    }

    /// Scans that were left out since the start, for want of a pose or because they could not be.
    #[must_use]
    pub fn n_left_out(&self) -> u64 {
        self.n_left_out
    }

    /// Takes in one input.
    pub fn step(&mut self, now: Time, input: Input) -> Vec<Output> {
        let mut outputs = Vec::new();
        match input {
            Input::Odometry(odometry) => {
                if self.track.push(&odometry) == Heard::Restarted {
                    self.source.restart();
                    self.mapper = None;
                    self.waiting = None;
                }
            }
            Input::Scan(scan) => {
                if self.waiting.is_some() {
                    self.leave_out("a newer scan came before odometry did".into());
                }
                self.waiting = Some((now, scan));
            }
            Input::Tick => self.tell_trouble(now, &mut outputs),
        }
        self.take_in_waiting(now, &mut outputs);
        if self.map_sent.is_none_or(|sent| now.since(sent) >= MAP_PERIOD) {
            self.send_map(now, &mut outputs);
        }
        outputs
    }

    fn take_in_waiting(&mut self, now: Time, outputs: &mut Vec<Output>) {
        let Some((came, scan)) = self.waiting.take() else { return };
        // The beams of one turn are spread over its duration: the middle is nearest to all of them.
        let middle_ns = scan.header.stamp_ns.saturating_add((scan.duration_s * 0.5e9) as u64);
        match self.track.at(middle_ns) {
            Ok(odom_from_base) => self.take_in(now, &scan, odom_from_base, outputs),
            Err(NoPose::NotYet) if now.since(came) < self.settings.scan_wait() => {
                self.waiting = Some((came, scan));
            }
            Err(NoPose::NotYet) => self.leave_out("odometry does not get to its stamp".into()),
            Err(NoPose::Never(reason)) => self.leave_out(reason),
        }
    }

    fn take_in(&mut self, now: Time, scan: &Scan, odom_from_base: Pose2, outputs: &mut Vec<Output>) {
        let estimate = self.source.estimate();
        let map_from_base = estimate.map_from_odom * odom_from_base;
        if let Err(e) = self.map(scan, map_from_base) {
            self.leave_out(e.to_string());
            return;
        }
        self.newest_scan = scan.header;
        self.taken_in = Some(now);
        self.n_poses += 1;
        outputs.push(Output::Pose(PoseEstimate {
            header: Header { seq: self.n_poses, ..scan.header },
            map_epoch: estimate.map_epoch,
            map_from_odom: estimate.map_from_odom,
            quality: estimate.quality,
        }));
    }

    /// Draws a scan into the base map, a new one if there is none.
    fn map(&mut self, scan: &Scan, map_from_base: Pose2) -> Result<(), BaseMapError> {
        let mut mapper = match self.mapper.take() {
            Some(mapper) => mapper,
            None => {
                let mut mapper = BaseMapper::new(self.settings.base_map(), map_from_base.position())?;
                mapper.free_disc(map_from_base.position(), self.map_from.radius_m)?;
                // The first map is told at once.
                self.map_sent = None;
                mapper
            }
        };
        let turn = BaseScan {
            ranges_m: &scan.ranges_m,
            angle_min_rad: scan.angle_min_rad,
            angle_increment_rad: scan.angle_step_rad,
            range_min_m: scan.range_m_min,
            range_max_m: scan.range_m_max,
            no_return_is_free: self.settings.no_return_is_free,
        };
        let done = mapper.integrate(&turn, map_from_base * self.map_from.base_from_lidar);
        self.mapper = Some(mapper);
        done
    }

    fn leave_out(&mut self, reason: String) {
        self.n_left_out += 1;
        self.last_left_out = reason;
    }

    fn send_map(&mut self, now: Time, outputs: &mut Vec<Output>) {
        let Some(mapper) = self.mapper.as_ref().filter(|_| self.taken_in.is_some()) else { return };
        self.n_maps += 1;
        self.map_sent = Some(now);
        outputs.push(Output::BaseMap(BaseMap {
            header: Header { seq: self.n_maps, ..self.newest_scan },
            map_epoch: self.source.estimate().map_epoch,
            layout: grid_layout(mapper.layout()),
            cells: occupancy_bytes(&mapper.occupancy()),
        }));
    }

    /// Says when scans stop being of use, and why.
    fn tell_trouble(&mut self, now: Time, outputs: &mut Vec<Output>) {
        let silence = now.since(self.taken_in.unwrap_or(Time::ZERO));
        let trouble = if silence < SILENCE_MAX {
            String::new()
        } else if self.last_left_out.is_empty() {
            "no scan".to_owned()
        } else {
            format!("no scan could be used: {}", self.last_left_out)
        };
        if trouble.is_empty() {
            self.last_left_out.clear();
        }
        if trouble != self.trouble {
            self.trouble.clone_from(&trouble);
            outputs.push(Output::Trouble(trouble));
        }
    }
}

#[cfg(test)]
#[path = "decider_tests.rs"]
mod tests;
