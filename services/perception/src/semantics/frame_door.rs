//! Where frames come in: each gets the pose that the base had at the frame's own stamp, or is left out.

use std::time::Duration;

use geometry::{Pose2, Time};
use proto::{Odometry, PoseEstimate, PoseQuality, RgbdFrame};

use super::frame::Frame;
use crate::odometry_track::{Heard, NoPose, OdometryTrack};

/// How long is waited, and what is believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DoorLimits {
    /// Odometry is interpolated over at most this.
    pub odometry_gap: Duration,
    /// A frame waits at most this long for odometry to get to its stamp.
    pub frame_wait: Duration,
    /// A pose of the map older than this, by stamp, does not place a frame.
    pub pose_age: Duration,
    /// Without a frame for this long there is trouble.
    pub silence: Duration,
}

/// What a message changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Nothing that was kept.
    None,
    /// The map frame is another one: what was mapped does not fit any more.
    Map,
    /// Odometry began anew, or its clock did: frames from before can no longer be placed or ordered.
    Odometry,
}

/// Odometry, pose and the frame that waits for them.
#[derive(Clone, Debug)]
pub struct FrameDoor {
    limits: DoorLimits,
    track: OdometryTrack,
    pose: Option<PoseEstimate>,
    /// Poses from before the base began anew do not place what was seen after.
    poses_from_ns: u64,
    map_epoch: Option<u64>,
    waiting: Option<(Time, Box<RgbdFrame>)>,
    newest_frame_ns: u64,
    posed: Option<Time>,
    reason: String,
    n_left_out: u64,
}

impl FrameDoor {
    /// A door that nothing has come through.
    #[must_use]
    pub fn new(limits: DoorLimits) -> Self {
        FrameDoor {
            limits,
            track: OdometryTrack::new(limits.odometry_gap),
            pose: None,
            poses_from_ns: 0,
            map_epoch: None,
            waiting: None,
            newest_frame_ns: 0,
            posed: None,
            reason: String::new(),
            n_left_out: 0,
        }
    }

    /// Sequence number of the odometry last heard.
    #[must_use]
    pub fn echo(&self) -> u64 {
        self.track.seq()
    }

    /// Stamp of the odometry last heard; 0 when none was.
    #[must_use]
    pub fn newest_ns(&self) -> u64 {
        self.track.newest_ns().unwrap_or(0)
    }

    /// Epoch of the map; `None` until a pose was heard.
    #[must_use]
    pub fn map_epoch(&self) -> Option<u64> {
        self.map_epoch
    }

    /// Frames that were left out since the start: no pose for their stamp, or another one came first.
    #[must_use]
    pub fn n_left_out(&self) -> u64 {
        self.n_left_out
    }

    /// Takes in odometry.
    pub fn odometry(&mut self, odometry: &Odometry) -> Change {
        let before_ns = self.track.newest_ns();
        let heard = self.track.push(odometry);
        let stamp_ns = odometry.header.stamp_ns;
        let was_set_back =
            heard == Heard::Continued && before_ns.is_some_and(|before_ns| stamp_ns <= before_ns);
        if heard != Heard::Restarted && !was_set_back {
            return Change::None;
        }
        self.pose = None;
        self.waiting = None;
        self.poses_from_ns = stamp_ns;
        // Stamps from before mean nothing by a clock that was set back.
        self.newest_frame_ns = 0;
        Change::Odometry
    }

    /// Takes in where odometry lies in the map.
    pub fn pose(&mut self, pose: PoseEstimate) -> Change {
        if pose.header.stamp_ns < self.poses_from_ns {
            return Change::None;
        }
        let epoch = pose.map_epoch;
        self.pose = Some(pose);
        match self.map_epoch.replace(epoch) {
            Some(before) if before != epoch => Change::Map,
            _ => Change::None,
        }
    }

    /// Takes in a frame; the one that waits gives way.
    pub fn frame(&mut self, now: Time, frame: Box<RgbdFrame>) {
        if frame.header.stamp_ns <= self.newest_frame_ns {
            self.leave_out("a frame's stamp went back".to_owned());
            return;
        }
        if self.waiting.is_some() {
            self.leave_out("a newer frame came before odometry did".to_owned());
        }
        self.waiting = Some((now, frame));
    }

    /// The frame that waits, once odometry has got to its stamp.
    pub fn take(&mut self, now: Time) -> Option<Frame> {
        let (came, frame) = self.waiting.take()?;
        match self.track.at(frame.header.stamp_ns) {
            Ok(odom_from_base) => {
                self.newest_frame_ns = frame.header.stamp_ns;
                self.posed = Some(now);
                self.reason.clear();
                Some(Frame::new(*frame, odom_from_base, self.track.run()))
            }
            Err(NoPose::NotYet) if now.since(came) < self.limits.frame_wait => {
                self.waiting = Some((came, frame));
                None
            }
            Err(NoPose::NotYet) => {
                self.leave_out("odometry does not get to a frame's stamp".to_owned());
                None
            }
            Err(NoPose::Never(reason)) => {
                self.leave_out(reason);
                None
            }
        }
    }

    /// The base in the map when a frame was taken.
    ///
    /// # Errors
    /// In words, when the pose of the map is not known, lost, too old, or of another run of the base.
    pub fn map_from_base(&self, frame: &Frame) -> Result<Pose2, String> {
        let pose = self.pose.as_ref().ok_or("no pose from localisation")?;
        match pose.quality {
            PoseQuality::Good => {}
            PoseQuality::Uncertain => return Err("localisation is uncertain".to_owned()),
            PoseQuality::Lost => return Err("localisation is lost".to_owned()),
        }
        if frame.odometry_run != self.track.run() {
            return Err("the base has begun anew since the frame was taken".to_owned());
        }
        // By the newest odometry: a keyframe may be old, the pose may not.
        let newest_ns = self.track.newest_ns().unwrap_or(frame.stamp_ns);
        let age = Duration::from_nanos(newest_ns.saturating_sub(pose.header.stamp_ns));
        if age > self.limits.pose_age {
            let limit_ms = self.limits.pose_age.as_millis();
            return Err(format!("pose from localisation is older than {limit_ms} ms"));
        }
        Ok(pose.map_from_odom * frame.odom_from_base)
    }

    /// Why no frame has come through for a while; empty when one has.
    #[must_use]
    pub fn trouble(&self, now: Time) -> String {
        let silence = now.since(self.posed.unwrap_or(Time::ZERO));
        if silence <= self.limits.silence {
            return String::new();
        }
        // No figure that grows: what is said is logged when it changes.
        let limit_s = self.limits.silence.as_secs_f64();
        if self.reason.is_empty() {
            format!("no camera frame for more than {limit_s} s")
        } else {
            format!("no usable camera frame for more than {limit_s} s: {}", self.reason)
        }
    }

    fn leave_out(&mut self, reason: String) {
        self.n_left_out += 1;
        self.reason = reason;
    }
}
