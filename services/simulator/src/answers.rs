//! The oracle's answers as messages: what a model host would send back for a frame.

use proto::{HeatMaps, ModelImage, Segments};

use crate::kept_frames::{KeptFrames, UnknownFrame};
use crate::oracle_models::{Heat, Oracle};

/// How the simulator signs its answers.
pub const MODEL_NAME: &str = "simulator-oracle";

/// One heat map a phrase. Only number, stamp and size of `image` are looked at.
///
/// # Errors
/// [`UnknownFrame`] names the frame that is not kept.
pub fn heat_maps(
    oracle: &Oracle,
    kept: &KeptFrames,
    image: &ModelImage,
    phrases: &[String],
) -> Result<HeatMaps, UnknownFrame> {
    let seen = kept.find(image)?;
    let Heat { width, height, values } = oracle.heat(&seen, image.seq, phrases);
    // A request has few phrases: its size on the wire is limited.
    let n_phrases = u32::try_from(phrases.len()).unwrap_or(u32::MAX);
    Ok(HeatMaps { seq: image.seq, model: MODEL_NAME.into(), width, height, values, n_phrases })
}

/// The panoptic segmentation. Only number, stamp and size of `image` are looked at.
///
/// # Errors
/// [`UnknownFrame`] names the frame that is not kept.
pub fn segments(oracle: &Oracle, kept: &KeptFrames, image: &ModelImage) -> Result<Segments, UnknownFrame> {
    let seen = kept.find(image)?;
    let panoptic = oracle.segments(&seen, image.seq);
    Ok(Segments {
        seq: image.seq,
        model: MODEL_NAME.into(),
        width: seen.width,
        height: seen.height,
        n_segments: panoptic.n_segments,
        labels_le: Segments::label_bytes(&panoptic.labels),
    })
}
