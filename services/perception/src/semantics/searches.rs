//! What the models are asked next: which frame, and which phrases.
//!
//! Live frames are asked about every phrase. A phrase that is new is also asked of the keyframes from before
//! it was first asked live, oldest first and each at most once: two equal votes of one frame would
//! count as two frames that agree. Live frames and keyframes take turns.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::frame::Frame;
use super::keyframes::Keyframes;

/// The phrases that are searched for.
#[derive(Clone, Debug, Default)]
pub struct Searches {
    phrases: BTreeMap<String, Progress>,
    was_live: bool,
}

/// How far the past has been gone through for one phrase.
#[derive(Clone, Copy, Debug, Default)]
struct Progress {
    /// Keyframes up to this stamp are done.
    done_ns: Option<u64>,
    /// The stamp of the first live frame that was asked about it: the past ends there.
    live_ns: Option<u64>,
}

impl Progress {
    fn wants(&self, stamp_ns: u64) -> bool {
        self.done_ns.is_none_or(|done_ns| stamp_ns > done_ns)
            && self.live_ns.is_none_or(|live_ns| stamp_ns < live_ns)
    }
}

/// What to ask.
#[derive(Clone, Debug, PartialEq)]
pub struct Query {
    /// Of this frame.
    pub frame: Arc<Frame>,
    /// About these phrases.
    pub phrases: Vec<String>,
    /// Whether the frame is a live one.
    pub is_live: bool,
}

impl Searches {
    /// Searches for these from now on.
    pub fn set_phrases(&mut self, phrases: &BTreeSet<String>) {
        self.phrases.retain(|phrase, _| phrases.contains(phrase));
        for phrase in phrases {
            self.phrases.entry(phrase.clone()).or_default();
        }
    }

    /// Whether anything is searched for.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.phrases.is_empty()
    }

    /// Begins anew: what was found is worth nothing any more.
    pub fn restart(&mut self) {
        self.phrases.values_mut().for_each(|progress| *progress = Progress::default());
    }

    /// The next question, and that it is asked; `live` is the newest frame if it waits to be asked about, and
    /// without `keyframes` the past has to wait.
    pub fn next(&mut self, live: Option<&Arc<Frame>>, keyframes: Option<&Keyframes>) -> Option<Query> {
        if self.phrases.is_empty() {
            return None;
        }
        // A keyframe that is also the live one is asked about once, as the live one.
        let before_ns = live.map_or(u64::MAX, |frame| frame.stamp_ns);
        let wanted = |frame: &&Arc<Frame>| {
            frame.stamp_ns < before_ns && self.phrases.values().any(|p| p.wants(frame.stamp_ns))
        };
        let past = keyframes.and_then(|kept| kept.iter().find(wanted).cloned());
        let (frame, is_live) = match (live, past) {
            (Some(_), Some(past)) if self.was_live => (past, false),
            (Some(live), _) => (Arc::clone(live), true),
            (None, past) => (past?, false),
        };
        self.was_live = is_live;
        let mut phrases = Vec::new();
        for (phrase, progress) in &mut self.phrases {
            if is_live {
                progress.live_ns.get_or_insert(frame.stamp_ns);
            } else if progress.wants(frame.stamp_ns) {
                progress.done_ns = Some(frame.stamp_ns);
            } else {
                continue;
            }
            phrases.push(phrase.clone());
        }
        Some(Query { frame, phrases, is_live })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::semantics::keyframes::KeyframeLimits;
    use geometry::{CameraIntrinsics, Pose2};
    use std::time::Duration;

    fn frame(stamp_ns: u64) -> Arc<Frame> {
        let intrinsics = CameraIntrinsics { width: 1, height: 1, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        let odom_from_base = Pose2::new(stamp_ns as f64, 0.0, 0.0);
        let (rgb, depth_mm) = (vec![0; 3], vec![0]);
        Arc::new(Frame {
            seq: stamp_ns,
            stamp_ns,
            intrinsics,
            rgb,
            depth_mm,
            odom_from_base,
            odometry_run: 0,
            base_from_camera: None,
        })
    }

    fn keyframes(stamps_ns: &[u64]) -> Keyframes {
        let mut store = Keyframes::new(KeyframeLimits {
            distance_m: 0.3,
            angle_rad: 0.3,
            period: Duration::ZERO,
            n_max: 40,
            n_bytes_max: 1000,
        });
        stamps_ns.iter().for_each(|stamp_ns| store.offer(&frame(*stamp_ns)));
        store
    }

    fn words(phrases: &[&str]) -> BTreeSet<String> {
        phrases.iter().map(|p| (*p).to_owned()).collect()
    }

    fn asked(query: Option<Query>) -> Option<(u64, bool, Vec<String>)> {
        query.map(|q| (q.frame.stamp_ns, q.is_live, q.phrases))
    }

    #[test]
    fn a_new_phrase_is_looked_for_in_the_past_in_turn_with_the_present_and_once() {
        let mut searches = Searches::default();
        let store = keyframes(&[1, 2, 3]);
        assert_eq!(searches.next(Some(&frame(3)), Some(&store)), None);
        searches.set_phrases(&words(&["desk"]));
        let desk = vec!["desk".to_owned()];
        let mut next = |live: Option<u64>| asked(searches.next(live.map(frame).as_ref(), Some(&store)));
        assert_eq!(next(Some(3)), Some((3, true, desk.clone())));
        assert_eq!(next(Some(4)), Some((1, false, desk.clone())));
        assert_eq!(next(Some(4)), Some((4, true, desk.clone())));
        assert_eq!(next(None), Some((2, false, desk.clone())));
        // Keyframe 3 was the first live one, and is not asked about again.
        assert_eq!(next(None), None);
        assert_eq!(next(Some(5)), Some((5, true, desk)));
    }

    #[test]
    fn a_second_phrase_goes_through_the_past_alone() {
        let mut searches = Searches::default();
        let store = keyframes(&[1, 2]);
        searches.set_phrases(&words(&["desk"]));
        while searches.next(None, Some(&store)).is_some() {}
        searches.set_phrases(&words(&["desk", "rug"]));
        let rug = vec!["rug".to_owned()];
        assert_eq!(asked(searches.next(None, Some(&store))), Some((1, false, rug.clone())));
        assert_eq!(asked(searches.next(None, Some(&store))), Some((2, false, rug)));
        let both = vec!["desk".to_owned(), "rug".to_owned()];
        assert_eq!(asked(searches.next(Some(&frame(7)), Some(&store))), Some((7, true, both)));
    }

    #[test]
    fn after_a_restart_the_past_is_gone_through_anew() {
        let mut searches = Searches::default();
        let store = keyframes(&[1]);
        searches.set_phrases(&words(&["desk"]));
        assert!(searches.next(None, Some(&store)).is_some());
        assert!(searches.next(None, Some(&store)).is_none());
        searches.restart();
        assert!(searches.next(None, Some(&store)).is_some());
    }
}
