//! What was seen before it was asked for: a bounded store of frames from different places.
//!
//! A new rule is grounded on these at once. One frame stands for its surroundings: a newer one from about
//! the same place takes over when it is some seconds younger, so that a robot that stands and waits keeps
//! what it saw on its way.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use super::frame::Frame;

/// What is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframeLimits {
    /// A frame from farther than this from all others is kept, metres …
    pub distance_m: f64,
    /// … or turned by more than this, radians …
    pub angle_rad: f64,
    /// … or this much younger than the one it takes the place of.
    pub period: Duration,
    /// Most frames; the oldest give way.
    pub n_max: usize,
    /// Most memory; the oldest give way.
    pub n_bytes_max: usize,
}

/// The store, oldest first.
#[derive(Clone, Debug)]
pub struct Keyframes {
    limits: KeyframeLimits,
    frames: VecDeque<Arc<Frame>>,
}

impl Keyframes {
    /// An empty store.
    #[must_use]
    pub fn new(limits: KeyframeLimits) -> Self {
        Keyframes { limits, frames: VecDeque::new() }
    }

    /// The frames, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<Frame>> {
        self.frames.iter()
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.frames.clear();
    }

    /// Keeps a frame if it shows something the others do not; stamps must not go back.
    pub fn offer(&mut self, frame: &Arc<Frame>) {
        let limits = self.limits;
        let is_near = |kept: &Arc<Frame>| {
            let (moved_m, turned_rad) = frame.moved_since(kept);
            moved_m < limits.distance_m && turned_rad < limits.angle_rad
        };
        if let Some(idx) = self.frames.iter().position(is_near) {
            let kept_ns = self.frames.get(idx).map_or(0, |kept| kept.stamp_ns);
            if Duration::from_nanos(frame.stamp_ns.saturating_sub(kept_ns)) < limits.period {
                return;
            }
            self.frames.remove(idx);
        }
        self.frames.push_back(Arc::clone(frame));
        while self.frames.len() > limits.n_max || self.n_bytes() > limits.n_bytes_max {
            self.frames.pop_front();
        }
    }

    fn n_bytes(&self) -> usize {
        self.frames.iter().map(|frame| frame.n_bytes()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use geometry::{CameraIntrinsics, Pose2};

    const LIMITS: KeyframeLimits = KeyframeLimits {
        distance_m: 0.3,
        angle_rad: 0.35,
        period: Duration::from_secs(2),
        n_max: 5,
        n_bytes_max: 1000,
    };

    fn frame(stamp_s: f64, x_m: f64, n_bytes: usize) -> Arc<Frame> {
        let intrinsics = CameraIntrinsics { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        Arc::new(Frame {
            seq: 1,
            stamp_ns: (stamp_s * 1e9) as u64,
            intrinsics,
            rgb: vec![0; n_bytes],
            depth_mm: Vec::new(),
            odom_from_base: Pose2::new(x_m, 0.0, 0.0),
            odometry_run: 0,
            base_from_camera: None,
        })
    }

    #[track_caller]
    fn check(frames: &[Arc<Frame>], kept_s: &[f64]) {
        let mut store = Keyframes::new(LIMITS);
        frames.iter().for_each(|f| store.offer(f));
        let found_s: Vec<f64> = store.iter().map(|f| f.stamp_ns as f64 / 1e9).collect();
        assert_eq!(found_s, kept_s);
    }

    #[test]
    fn one_frame_is_kept_for_each_place() {
        check(&[frame(0.0, 0.0, 1), frame(0.2, 0.2, 1), frame(0.4, 0.4, 1)], &[0.0, 0.4]);
    }

    #[test]
    fn a_robot_that_waits_keeps_what_it_saw_on_its_way() {
        let mut frames = vec![frame(0.0, 0.0, 1), frame(1.0, 1.0, 1)];
        frames.extend((2..100).map(|k| frame(f64::from(k), 2.0, 1)));
        check(&frames, &[0.0, 1.0, 98.0]);
    }

    #[test]
    fn the_store_is_bounded_by_number_and_by_memory() {
        let many: Vec<_> = (0..9).map(|k| frame(f64::from(k), f64::from(k), 1)).collect();
        check(&many, &[4.0, 5.0, 6.0, 7.0, 8.0]);
        let large: Vec<_> = (0..9).map(|k| frame(f64::from(k), f64::from(k), 400)).collect();
        check(&large, &[7.0, 8.0]);
    }
}
