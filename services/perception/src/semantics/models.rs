//! The two model roles, and who plays them.
//!
//! [`OpenVocabulary`] says roughly where a phrase is, [`Panoptic`] says exactly what belongs together. Both
//! may be slow, wrong or gone; whatever they answer is checked against what was asked before it is used.

use std::future::Future;
use std::sync::Arc;
use std::time::Duration;

use proto::{HeatMaps, HeatMapsRequest, ModelImage, Segments, SegmentsRequest, topics};
use service::Bus;

use super::frame::Frame;

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
}

/// Both roles together.
pub trait Models: OpenVocabulary + Panoptic {
    /// Asks both at once.
    fn answer(&self, ask: &Ask) -> impl Future<Output = anyhow::Result<Box<Answer>>> + Send {
        async {
            let heat_maps = self.heat_maps(&ask.frame, &ask.phrases);
            let (heat_maps, segments) = tokio::try_join!(heat_maps, self.segments(&ask.frame))?;
            Ok(Box::new(Answer { heat_maps, segments }))
        }
    }
}

impl<T: OpenVocabulary + Panoptic> Models for T {}

/// Models behind the bus: whoever answers there.
pub struct RemoteModels {
    bus: Bus,
    patience: Duration,
}

impl RemoteModels {
    /// Models that are given `patience` for an answer.
    #[must_use]
    pub fn new(bus: Bus, patience: Duration) -> Self {
        RemoteModels { bus, patience }
    }
}

fn image(frame: &Frame) -> ModelImage {
    ModelImage {
        seq: frame.seq,
        stamp_ns: frame.stamp_ns,
        width: frame.intrinsics.width,
        height: frame.intrinsics.height,
        rgb: frame.rgb.clone(),
    }
}

impl OpenVocabulary for RemoteModels {
    async fn heat_maps(&self, frame: &Frame, phrases: &[String]) -> anyhow::Result<HeatMaps> {
        let request = HeatMapsRequest { image: image(frame), phrases: phrases.to_vec() };
        self.bus.ask(&topics::HEAT_MAPS, &request, self.patience).await
    }
}

impl Panoptic for RemoteModels {
    async fn segments(&self, frame: &Frame) -> anyhow::Result<Segments> {
        self.bus.ask(&topics::SEGMENTS, &SegmentsRequest { image: image(frame) }, self.patience).await
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

    /// The segments.
    ///
    /// # Errors
    /// In words, when they cannot be.
    pub fn segments(&self) -> Result<mapping::Segments, String> {
        let Segments { width, height, n_segments, .. } = self.segments;
        mapping::Segments::new(width, height, self.segments.labels(), n_segments).map_err(|e| e.to_string())
    }
}
