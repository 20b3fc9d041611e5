//! Models behind the bus: whoever answers there, a host with a GPU or the simulator.

use std::time::Duration;

use proto::{HeatMaps, HeatMapsRequest, ModelImage, Segments, SegmentsRequest, topics};
use service::Bus;

use super::{Models, OpenVocabulary, Panoptic};
use crate::semantics::frame::Frame;

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

impl Models for RemoteModels {}
