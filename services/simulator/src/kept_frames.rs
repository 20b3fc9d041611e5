//! The last instance images, by the frame they belong to: what questions to the models are answered from.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use proto::ModelImage;

use crate::raycast::InstanceImage;

/// Frames that are kept: three seconds at 5 Hz.
pub const N_FRAMES_KEPT: usize = 16;

/// The last instance images.
#[derive(Default)]
pub struct KeptFrames {
    frames: Mutex<VecDeque<Kept>>,
}

struct Kept {
    seq: u64,
    stamp_ns: u64,
    seen: Arc<InstanceImage>,
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
    pub fn keep(&self, seq: u64, stamp_ns: u64, seen: InstanceImage) {
        let mut frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        if frames.len() == N_FRAMES_KEPT {
            frames.pop_front();
        }
        frames.push_back(Kept { seq, stamp_ns, seen: Arc::new(seen) });
    }

    /// The instance image of the frame that a question is about.
    ///
    /// # Errors
    /// [`UnknownFrame`] names the frame.
    pub fn find(&self, image: &ModelImage) -> Result<Arc<InstanceImage>, UnknownFrame> {
        let (seq, stamp_ns) = (image.seq, image.stamp_ns);
        let frames = self.frames.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = frames.iter().find(|k| k.seq == seq && k.stamp_ns == stamp_ns);
        let seen = Arc::clone(&kept.ok_or(UnknownFrame::NotKept { seq, stamp_ns })?.seen);
        if (seen.width, seen.height) != (image.width, image.height) {
            let size = |width: u32, height: u32| format!("{width}×{height}");
            let (wanted, found) = (size(seen.width, seen.height), size(image.width, image.height));
            return Err(UnknownFrame::Size { seq, wanted, found });
        }
        Ok(seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn question(seq: u64, stamp_ns: u64, width: u32) -> ModelImage {
        ModelImage { seq, stamp_ns, width, height: 1, rgb: vec![0; 3 * width as usize] }
    }

    #[test]
    fn a_frame_is_found_by_number_and_stamp_until_sixteen_newer_ones_came() {
        let kept = KeptFrames::default();
        for seq in 1..=17_u16 {
            let seen = InstanceImage { width: 2, height: 1, instances: vec![seq; 2] };
            kept.keep(seq.into(), 100 + u64::from(seq), seen);
        }
        assert_eq!(kept.find(&question(2, 102, 2)).unwrap().instances, [2, 2]);
        let told = |q| kept.find(&q).unwrap_err().to_string();
        assert!(told(question(1, 101, 2)).contains("frame 1 "), "the oldest gave way");
        assert!(told(question(2, 103, 2)).contains("frame 2 with stamp 103"));
        assert!(told(question(2, 102, 3)).contains("2×1 pixels, the question's image has 3×1"));
    }
}
