//! Models for a robot without a GPU: objects by a YOLO segmentation, floors and walls by a semantic one.
//!
//! Both roles come from one look at the image: the segments are what was detected, the heat map of a phrase
//! is the masks of the classes that it means. A phrase that means no class has an empty map, and the answer
//! says why. The last look is kept, because both roles ask about the same frame. Deliberately not here: a
//! guess at a phrase that no class fits.

use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context;
use image::RgbImage;
use proto::{HeatMaps, Segments};

use super::picture::picture;
use super::stuff::Stuff;
use super::vocabulary::{Meaning, Vocabulary};
use super::yolo::{Instance, Yolo};
use super::{Answer, Understood};
use crate::semantics::frame::Frame;

/// Largest side of a heat map, cells, as on the network.
const N_HEAT_SIDE_MAX: u32 = 1024;
/// Fewest pixels of a region of floor or wall that count, as a share of the image: smaller ones are noise.
const STUFF_SHARE_MIN: f32 = 0.002;

/// Both models and what their classes are called.
pub struct Detector {
    things: Yolo,
    stuff: Option<Stuff>,
    vocabulary: Vocabulary,
    seen: Mutex<Option<(u64, u64, Arc<Look>)>>,
}

/// What was seen in one frame.
struct Look {
    /// Usual class name and mask.
    regions: Vec<(String, Vec<bool>)>,
    /// Segment of each pixel, from 1.
    labels: Vec<u16>,
    n_segments: u16,
}

impl Detector {
    /// Joins models that are open.
    #[must_use]
    pub fn new(things: Yolo, stuff: Option<Stuff>, vocabulary: Vocabulary) -> Self {
        Detector { things, stuff, vocabulary, seen: Mutex::default() }
    }

    /// What the phrases mean to these models.
    ///
    /// # Errors
    /// When the sentence embedding fails.
    pub fn meaning(&self, phrase: &str) -> anyhow::Result<Meaning> {
        self.vocabulary.meaning(phrase)
    }

    /// Both roles at once. Blocks for as long as the models work.
    ///
    /// # Errors
    /// When a model fails, or the image cannot be.
    pub fn answer(&self, frame: &Frame, phrases: &[String]) -> anyhow::Result<Answer> {
        let look = self.look(frame)?;
        let mut understood = Vec::with_capacity(phrases.len());
        let mut meant = Vec::with_capacity(phrases.len());
        for phrase in phrases {
            let (classes, how) = match self.vocabulary.meaning(phrase)? {
                Meaning::Classes(classes) => (classes, Understood::Wholly),
                Meaning::MoreThanSaid(classes, words) => (classes, Understood::InPart(words)),
                Meaning::Nothing(words) => (Vec::new(), Understood::NotAtAll(words)),
            };
            meant.push(classes);
            understood.push(how);
        }
        let heat_maps = self.heat_maps(frame, &look, &meant);
        let segments = Segments {
            seq: frame.seq,
            model: self.things.name().to_owned(),
            width: frame.intrinsics.width,
            height: frame.intrinsics.height,
            n_segments: look.n_segments,
            labels_le: Segments::label_bytes(&look.labels),
        };
        Ok(Answer { heat_maps, segments, understood })
    }

    fn heat_maps(&self, frame: &Frame, look: &Look, meant: &[Vec<String>]) -> HeatMaps {
        let (width, height) = (frame.intrinsics.width, frame.intrinsics.height);
        let stride = width.max(height).div_ceil(N_HEAT_SIDE_MAX);
        let (cols, rows) = (width / stride, height / stride);
        let mut values = Vec::with_capacity(meant.len() * (cols * rows) as usize);
        for classes in meant {
            let masks: Vec<&Vec<bool>> = look
                .regions
                .iter()
                .filter(|(class, _)| classes.contains(class))
                .map(|(_, mask)| mask)
                .collect();
            for row in 0..rows {
                values.extend((0..cols).map(|col| {
                    let idx = (row * stride + stride / 2) as usize * width as usize
                        + (col * stride + stride / 2) as usize;
                    // Whether it was sure enough was decided when it was detected.
                    if masks.iter().any(|mask| mask.get(idx) == Some(&true)) { u8::MAX } else { 0 }
                }));
            }
        }
        let n_phrases = u32::try_from(meant.len()).unwrap_or(u32::MAX);
        HeatMaps {
            seq: frame.seq,
            model: self.things.name().to_owned(),
            width: cols,
            height: rows,
            values,
            n_phrases,
        }
    }

    fn look(&self, frame: &Frame) -> anyhow::Result<Arc<Look>> {
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((seq, stamp_ns, look)) = &*seen
            && (*seq, *stamp_ns) == (frame.seq, frame.stamp_ns)
        {
            return Ok(Arc::clone(look));
        }
        let picture = picture(frame.intrinsics.width, frame.intrinsics.height, &frame.rgb)?;
        let look = Arc::new(self.looked_at(&picture).context("look at an image")?);
        *seen = Some((frame.seq, frame.stamp_ns, Arc::clone(&look)));
        Ok(look)
    }

    fn looked_at(&self, picture: &RgbImage) -> anyhow::Result<Look> {
        let instances = self.things.instances(picture)?;
        let n_pixels = picture.width() as usize * picture.height() as usize;
        let mut labels = vec![0_u16; n_pixels];
        let mut regions = Vec::new();
        // The surest comes first and keeps its pixels.
        for Instance { class_idx, mask, .. } in instances {
            let label = u16::try_from(regions.len() + 1).unwrap_or(u16::MAX);
            paint(&mut labels, &mask, label);
            let class = self.things.labels().get(class_idx).map_or("", String::as_str);
            regions.push((self.vocabulary.usual(class), mask));
        }
        if let Some(stuff) = &self.stuff {
            let classes = stuff.classes(picture)?;
            for (class_idx, label) in stuff.labels().iter().enumerate() {
                let name = self.vocabulary.usual(label);
                if !self.vocabulary.is_believed(&name) {
                    continue;
                }
                // What an object covers is not the floor or wall behind it.
                let is_here = |(class, label): (&u16, &u16)| usize::from(*class) == class_idx && *label == 0;
                let mask: Vec<bool> = classes.iter().zip(&labels).map(is_here).collect();
                let n_here = mask.iter().filter(|b| **b).count();
                if n_here as f32 >= STUFF_SHARE_MIN * n_pixels as f32 {
                    paint(&mut labels, &mask, u16::try_from(regions.len() + 1).unwrap_or(u16::MAX));
                    regions.push((name, mask));
                }
            }
        }
        let n_segments = u16::try_from(regions.len()).unwrap_or(u16::MAX);
        Ok(Look { regions, labels, n_segments })
    }
}

/// Gives the pixels of a mask that belong to nothing yet to a segment.
fn paint(labels: &mut [u16], mask: &[bool], label: u16) {
    for (pixel, _) in labels.iter_mut().zip(mask).filter(|(pixel, inside)| **inside && **pixel == 0) {
        *pixel = label;
    }
}
