//! The last instance images, by the frame they belong to: what questions to the models are answered from.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use proto::ModelImage;

use crate::raycast::InstanceImage;

/// Frames that are kept: two minutes at 5 Hz, so that a rule can be grounded on what was seen before it was
/// said. They are kept as runs of equal pixels, some tens of kilobytes each.
pub const N_FRAMES_KEPT: usize = 600;

/// The last instance images.
#[derive(Default)]
pub struct KeptFrames {
    frames: Mutex<VecDeque<Kept>>,
}

struct Kept {
    seq: u64,
    stamp_ns: u64,
    width: u32,
    height: u32,
    /// (instance, number of pixels in a row), row-major.
    runs: Vec<(u16, u32)>,
}

impl Kept {
    fn new(seq: u64, stamp_ns: u64, seen: &InstanceImage) -> Self {
        let run = |same: &[u16]| Some((*same.first()?, u32::try_from(same.len()).ok()?));
        let runs = seen.instances.chunk_by(|a, b| a == b).filter_map(run).collect();
        Kept { seq, stamp_ns, width: seen.width, height: seen.height, runs }
    }

    fn image(&self) -> InstanceImage {
        let pixels = |&(instance, n): &(u16, u32)| std::iter::repeat_n(instance, n as usize);
        InstanceImage {
            width: self.width,
            height: self.height,
            instances: self.runs.iter().flat_map(pixels).collect(),
        }
    }
}

/// A question about a frame that cannot be answered.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnknownFrame {
    /// It was never made, or is too long ago.
    #[error("frame {seq} with stamp {stamp_ns} is not known, only the last {N_FRAMES_KEPT} are kept")]
    NotKept {
        /// The frame asked about.
        seq: u64,
        /// Its stamp.
        stamp_ns: u64,
    },
    /// It has another size than the image that came with the question.
    #[error("frame {seq} has {wanted} pixels, the question's image has {found}")]
    Size {
        /// The frame asked about.
        seq: u64,
        /// Width × height of the frame.
        wanted: String,
        /// Width × height in the question.
        found: String,
    },
}

impl KeptFrames {
    /// Keeps an image; the oldest gives way.
    pub fn keep(&self, seq: u64, stamp_ns: u64, seen: &InstanceImage) {
        let kept = Kept::new(seq, stamp_ns, seen);
        let mut frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        if frames.len() == N_FRAMES_KEPT {
            frames.pop_front();
        }
        frames.push_back(kept);
    }

    /// The instance image of the frame that a question is about.
    ///
    /// # Errors
    /// [`UnknownFrame`] names the frame.
    pub fn find(&self, image: &ModelImage) -> Result<InstanceImage, UnknownFrame> {
        let (seq, stamp_ns) = (image.seq, image.stamp_ns);
        let frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = frames.iter().find(|k| k.seq == seq && k.stamp_ns == stamp_ns);
        let seen = kept.ok_or(UnknownFrame::NotKept { seq, stamp_ns })?;
        if (seen.width, seen.height) != (image.width, image.height) {
            let size = |width: u32, height: u32| format!("{width}×{height}");
            let (wanted, found) = (size(seen.width, seen.height), size(image.width, image.height));
            return Err(UnknownFrame::Size { seq, wanted, found });
        }
        Ok(seen.image())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn question(seq: u64, stamp_ns: u64, width: u32) -> ModelImage {
        ModelImage { seq, stamp_ns, width, height: 1, rgb: vec![0; 3 * width as usize] }
    }

    #[test]
    fn a_frame_is_found_by_number_and_stamp_until_it_gives_way_to_newer_ones() {
        let kept = KeptFrames::default();
        for seq in 1..=u16::try_from(N_FRAMES_KEPT + 1).unwrap() {
            let seen = InstanceImage { width: 3, height: 1, instances: vec![seq, seq, 0] };
            kept.keep(seq.into(), 100 + u64::from(seq), &seen);
        }
        assert_eq!(kept.find(&question(2, 102, 3)).unwrap().instances, [2, 2, 0]);
        let told = |q| kept.find(&q).unwrap_err().to_string();
        assert!(told(question(1, 101, 3)).contains("frame 1 "), "the oldest gave way");
        assert!(told(question(2, 103, 3)).contains("frame 2 with stamp 103"));
        assert!(told(question(2, 102, 2)).contains("3×1 pixels, the question's image has 2×1"));
    }
}
