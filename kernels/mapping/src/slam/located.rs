//! What a scan tells of the pose.

use geometry::Pose2;

use super::Standing;

/// A pose that moves with its sub-map when loops are closed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Anchor {
    pub(super) submap_idx: usize,
    pub(super) submap_from_base: Pose2,
    /// The scan that was kept last.
    pub(super) nth_kept: u64,
}

/// What one scan did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Located {
    /// The pose, as it is known now.
    pub map_from_base: Pose2,
    /// The same, to be asked for again later: see [`Slam::pose`](super::Slam::pose).
    pub anchor: Anchor,
    /// How well it is known.
    pub standing: Standing,
    /// The scan fits here, and so much worse than scans used to that it may have been taken elsewhere; until that is
    /// known it stands as [`Standing::Uncertain`].
    pub is_in_doubt: bool,
    /// Share of the scan that lies on the map's surfaces, 0 to 1.
    pub inlier_share: f64,
    /// The map moved under the robot, by a loop that was closed or a place that was found again: what was built
    /// on its old pose does not fit.
    pub has_jumped: bool,
}
