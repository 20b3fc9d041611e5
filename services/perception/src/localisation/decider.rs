//! What localisation makes of odometry and scans.

use std::time::Duration;

use geometry::{Pose2, Profile, Time};
use mapping::base_map::Scan as BaseScan;
use mapping::slam::Standing;
use mapping::{Grid, Occupancy};
use proto::{BaseMap, Header, Odometry, PoseEstimate, PoseQuality, Scan};

use crate::odometry_track::{Heard, NoPose, OdometryTrack};
use crate::wire::{grid_layout, occupancy_bytes};

use super::config::Settings;
use super::pose_source::PoseSource;

/// The base map is repeated this often.
const MAP_PERIOD: Duration = Duration::from_secs(1);
/// What is told while the pose is not known.
const LOST: &str = "lost: scans do not fit the map";
/// What is told while it is in doubt.
const UNCERTAIN: &str = "uncertain: scans fit the map worse than they did";
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
    track: OdometryTrack,
    source: PoseSource,
    /// A scan that odometry has not reached yet, and when it came.
    waiting: Option<(Time, Scan)>,
    newest_scan: Header,
    n_poses: u64,
    n_maps: u64,
    n_left_out: u64,
    last_left_out: String,
    map_sent: Option<Time>,
    taken_in: Option<Time>,
    standing: Standing,
    /// The last good pose of `odom` in `map`.
    told: Pose2,
    trouble: String,
}

impl Decider {
    /// Localisation at its start, without a saved map.
    #[must_use]
    pub fn new(settings: Settings, profile: &Profile) -> Self {
        Decider::with_map(settings, profile, None)
    }

    /// Localisation at its start; `saved` is the map that is needed to be found in one.
    #[must_use]
    pub fn with_map(settings: Settings, profile: &Profile, saved: Option<Grid<Occupancy>>) -> Self {
        Decider {
            track: OdometryTrack::new(settings.odometry_gap()),
            source: PoseSource::new(&settings, profile, saved),
            settings,
            waiting: None,
            newest_scan: Header::default(),
            n_poses: 0,
            n_maps: 0,
            n_left_out: 0,
            last_left_out: String::new(),
            map_sent: None,
            taken_in: None,
            standing: Standing::Good,
            told: Pose2::IDENTITY,
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
        let turn = BaseScan {
            ranges_m: &scan.ranges_m,
            angle_min_rad: scan.angle_min_rad,
            angle_increment_rad: scan.angle_step_rad,
            range_min_m: scan.range_m_min,
            range_max_m: scan.range_m_max,
            no_return_is_free: self.settings.no_return_is_free,
        };
        let estimate = match self.source.take_in(&turn, odom_from_base) {
            Ok(estimate) => estimate,
            Err(e) => {
                self.leave_out(e.to_string());
                return;
            }
        };
        self.newest_scan = scan.header;
        self.taken_in = Some(now);
        self.standing = estimate.standing;
        if estimate.is_new_map {
            // Told at once.
            self.map_sent = None;
        }
        let quality = match self.standing {
            Standing::Good => PoseQuality::Good,
            Standing::Uncertain => PoseQuality::Uncertain,
            Standing::Lost => PoseQuality::Lost,
        };
        // A pose that is not known, or in doubt, is not told: that is said with the last one that was good.
        if quality == PoseQuality::Good {
            self.told = estimate.map_from_odom;
        }
        self.n_poses += 1;
        outputs.push(Output::Pose(PoseEstimate {
            header: Header { seq: self.n_poses, ..scan.header },
            map_epoch: self.source.map_epoch(),
            map_from_odom: self.told,
            quality,
        }));
    }

    fn leave_out(&mut self, reason: String) {
        self.n_left_out += 1;
        self.last_left_out = reason;
    }

    fn send_map(&mut self, now: Time, outputs: &mut Vec<Output>) {
        let Some(map) = self.source.base_map().filter(|_| self.taken_in.is_some()) else { return };
        self.n_maps += 1;
        self.map_sent = Some(now);
        outputs.push(Output::BaseMap(BaseMap {
            header: Header { seq: self.n_maps, ..self.newest_scan },
            map_epoch: self.source.map_epoch(),
            layout: grid_layout(map.layout()),
            cells: occupancy_bytes(&map),
        }));
    }

    /// Says when scans stop being of use, and why.
    fn tell_trouble(&mut self, now: Time, outputs: &mut Vec<Output>) {
        let silence = now.since(self.taken_in.unwrap_or(Time::ZERO));
        let trouble = if silence < SILENCE_MAX {
            match self.standing {
                Standing::Good => String::new(),
                Standing::Uncertain => UNCERTAIN.to_owned(),
                Standing::Lost => LOST.to_owned(),
            }
        } else if self.last_left_out.is_empty() {
            "no scan".to_owned()
        } else {
            format!("no scan could be used: {}", self.last_left_out)
        };
        if silence < SILENCE_MAX {
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
