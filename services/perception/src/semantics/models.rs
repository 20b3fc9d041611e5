//! The two model roles, and who plays them.
//!
//! [`OpenVocabulary`] says roughly where a phrase is, [`Panoptic`] says exactly what belongs together. Both
//! may be slow, wrong or gone; whatever they answer is checked against what was asked before it is used.

use std::future::Future;
use std::sync::Arc;

use proto::{HeatMaps, Segments};

use super::frame::Frame;

pub mod clipseg;
pub mod configured;
pub mod detector;
pub mod folder;
pub mod inventory;
pub mod manifest;
pub mod mask2former;
pub mod paired;
pub mod picture;
pub mod remote;
pub mod runtime;
pub mod sentence;
pub mod stuff;
pub mod vocabulary;
pub mod yolo;

/// Labels of the data set that models of the YOLO family are usually trained on, one a line.
pub const COCO: &str = include_str!("models/coco.txt");

/// Where in this image might these things be?
pub trait OpenVocabulary: Send + Sync + 'static {
    /// One coarse heat map a phrase, in order.
    fn heat_maps(
        &self,
        frame: &Frame,
        phrases: &[String],
    ) -> impl Future<Output = anyhow::Result<HeatMaps>> + Send;
}

/// Which segments make up this image?
pub trait Panoptic: Send + Sync + 'static {
    /// One label a pixel.
    fn segments(&self, frame: &Frame) -> impl Future<Output = anyhow::Result<Segments>> + Send;
}

/// One question to both models.
#[derive(Clone, Debug, PartialEq)]
pub struct Ask {
    /// Tells answers apart.
    pub id: u64,
    /// The frame they are to look at.
    pub frame: Arc<Frame>,
    /// What is looked for; at least one.
    pub phrases: Vec<String>,
}

/// What both models said of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer {
    /// One heat map a phrase.
    pub heat_maps: HeatMaps,
    /// The segments.
    pub segments: Segments,
    /// How each phrase was understood; empty when all were, as spoken.
    pub understood: Vec<Understood>,
}

/// How far a model understands a phrase.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub enum Understood {
    /// As it was spoken.
    #[default]
    Wholly,
    /// Its map shows more than was said. In words.
    InPart(String),
    /// Not at all: that its map is empty says nothing. In words.
    NotAtAll(String),
}

/// Both roles together.
pub trait Models: OpenVocabulary + Panoptic {
    /// Asks both at once.
    fn answer(&self, ask: &Ask) -> impl Future<Output = anyhow::Result<Box<Answer>>> + Send {
        async {
            let heat_maps = self.heat_maps(&ask.frame, &ask.phrases);
            let (heat_maps, segments) = tokio::try_join!(heat_maps, self.segments(&ask.frame))?;
            Ok(Box::new(Answer { heat_maps, segments, understood: Vec::new() }))
        }
    }
}

impl Answer {
    /// Checks that this is an answer to that question.
    ///
    /// # Errors
    /// In words: what was found and what was asked for.
    pub fn check(&self, ask: &Ask) -> Result<(), String> {
        let (heat_maps, segments, frame) = (&self.heat_maps, &self.segments, &ask.frame);
        for (role, seq) in [("heat maps", heat_maps.seq), ("segments", segments.seq)] {
            if seq != frame.seq {
                return Err(format!("{role} are of frame {seq}, must be of frame {}", frame.seq));
            }
        }
        if heat_maps.n_phrases as usize != ask.phrases.len() {
            let (found, wanted) = (heat_maps.n_phrases, ask.phrases.len());
            return Err(format!("{found} heat maps, must be {wanted}"));
        }
        let (width, height) = (frame.intrinsics.width, frame.intrinsics.height);
        if (segments.width, segments.height) != (width, height) {
            let (found_width, found_height) = (segments.width, segments.height);
            return Err(format!(
                "segments are {found_width}×{found_height} pixels, must be {width}×{height}"
            ));
        }
        Ok(())
    }

    /// The heat map of the `idx`-th phrase.
    ///
    /// # Errors
    /// In words, when there is none or it cannot be.
    pub fn heat_map(&self, idx: usize) -> Result<mapping::HeatMap, String> {
        let maps = &self.heat_maps;
        let n_cells = maps.width as usize * maps.height as usize;
        let values = maps.values.chunks_exact(n_cells.max(1)).nth(idx);
        let values = values.ok_or_else(|| format!("no heat map {idx}"))?;
        let shares = values.iter().map(|byte| f32::from(*byte) / 255.0).collect();
        mapping::HeatMap::new(maps.width, maps.height, shares).map_err(|e| e.to_string())
    }

    /// How the `idx`-th phrase was understood.
    #[must_use]
    pub fn understood(&self, idx: usize) -> Understood {
        self.understood.get(idx).cloned().unwrap_or_default()
    }

    /// The segments.
    ///
    /// # Errors
    /// In words, when they cannot be.
    pub fn segments(&self) -> Result<mapping::Segments, String> {
        let Segments { width, height, n_segments, .. } = self.segments;
        mapping::Segments::new(width, height, self.segments.labels(), n_segments).map_err(|e| e.to_string())
    }
}
