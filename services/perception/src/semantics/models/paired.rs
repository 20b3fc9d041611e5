//! CLIPSeg and Mask2Former together, from one export.

use std::path::Path;

use anyhow::Context;
use proto::{HeatMaps, Segments};

use super::Answer;
use super::clipseg::ClipSeg;
use super::manifest::Manifest;
use super::mask2former::Mask2Former;
use super::picture::picture;
use super::runtime::Runtime;
use crate::semantics::frame::Frame;

/// Both models, open.
pub struct Paired {
    heat: ClipSeg,
    panoptic: Mask2Former,
    /// Where the weights come from.
    pub weights: String,
}

impl Paired {
    /// Opens an export.
    ///
    /// # Errors
    /// When a file is missing, not the one that was exported, or of another shape.
    pub fn open(runtime: &Runtime, folder: &Path) -> anyhow::Result<Self> {
        let manifest = Manifest::read(folder)?;
        Ok(Paired {
            heat: ClipSeg::open(runtime, &manifest)?,
            panoptic: Mask2Former::open(runtime, &manifest)?,
            weights: manifest.weights,
        })
    }

    /// Both roles at once. Blocks for as long as the models work.
    ///
    /// # Errors
    /// When a model fails, or the image cannot be.
    pub fn answer(&self, frame: &Frame, phrases: &[String]) -> anyhow::Result<Answer> {
        let (width, height) = (frame.intrinsics.width, frame.intrinsics.height);
        let picture = picture(width, height, &frame.rgb)?;
        let heat = self.heat.heat(&picture, phrases)?;
        let found = self.panoptic.segments(&picture)?;
        let side = u32::try_from(heat.side).context("side of a heat map")?;
        let values = heat.values.iter().map(|share| (share * 255.0).round() as u8).collect();
        let n_phrases = u32::try_from(phrases.len()).context("number of phrases")?;
        let model = self.heat.name().to_owned();
        Ok(Answer {
            heat_maps: HeatMaps { seq: frame.seq, model, width: side, height: side, values, n_phrases },
            segments: Segments {
                seq: frame.seq,
                model: self.panoptic.name().to_owned(),
                width,
                height,
                n_segments: found.n_segments,
                labels_le: Segments::label_bytes(&found.labels),
            },
            understood: Vec::new(),
        })
    }
}
