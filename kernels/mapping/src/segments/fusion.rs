//! From a coarse answer to a phrase and exact segments without names to one exact mask.
//!
//! The paper keeps segments whose intersection over union with the thresholded heat map is high; three chairs
//! that each are a third of it are then all lost. Ours asks for each segment what share of *it* the heat
//! covers, so that any number of objects may share one map, and background that the blurred border touches
//! stays out. What the segmenter split off finer than the heat map can show, a lone thin leg, is lost.

use super::{HeatMap, Segments};
use crate::image::Mask;

/// How a heat map chooses segments.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fusion {
    /// Ours: segments that the heat covers, as many as explain it.
    Coverage {
        /// A map that is nowhere this hot has not found the phrase.
        peak_min: f32,
        /// A pixel is hot above this share of the peak of its own hot spot: blurring keeps the border of a
        /// spot near half its height, however low a small object's peak has become.
        share_of_peak: f32,
        /// A segment belongs when at least this share of its pixels is hot.
        coverage_min: f32,
        /// A segment that only just misses `coverage_min` belongs when it reaches this and much of the heat
        /// would otherwise stay unexplained.
        coverage_weak: f32,
        /// The chosen segments must hold this share of the hot pixels.
        explained_min: f32,
    },
    /// The paper's: segments whose intersection over union with the whole hot area exceeds a threshold.
    PaperIou {
        /// The threshold.
        threshold: f32,
    },
}

impl Default for Fusion {
    /// Coverage. Chosen on rendered heat maps of 1/7 resolution, blurred by two cells (see the tests).
    fn default() -> Self {
        Fusion::Coverage {
            peak_min: 0.3,
            share_of_peak: 0.5,
            coverage_min: 0.5,
            coverage_weak: 0.3,
            explained_min: 0.25,
        }
    }
}

/// Heat above which the literal rule takes a pixel to be in the open-vocabulary mask; the paper gives none.
const PAPER_HEAT_MIN: f32 = 0.5;
/// Share of the heat that must be explained before weak segments stop being looked at.
const EXPLAINED_WELL: f32 = 0.7;

/// An exact mask for a phrase.
#[derive(Clone, Debug, PartialEq)]
pub struct FusedMask {
    /// The pixels, of the segments' size.
    pub mask: Mask,
    /// The segments it is made of, ascending.
    pub segments: Vec<u16>,
    /// 0 to 1: how hot, how well covered and how fully explained, multiplied.
    pub confidence: f32,
    /// Share of the hot pixels that the mask holds, 0 to 1.
    pub explained: f32,
}

/// The mask that the heat map and the segments agree on; `None` when the phrase is not in view.
///
/// Linear in the number of pixels.
#[must_use]
pub fn fuse(heat: &HeatMap, segments: &Segments, rule: Fusion) -> Option<FusedMask> {
    let peak = heat.values.iter().copied().fold(0.0, f32::max);
    let hot = match rule {
        Fusion::Coverage { peak_min, share_of_peak, .. } => {
            if peak < peak_min {
                return None;
            }
            // Below half the least peak there is only haze.
            let floor = peak_min * share_of_peak;
            let thresholds = local_thresholds(heat, floor, peak_min, share_of_peak);
            hot_pixels(heat, &thresholds, segments)
        }
        Fusion::PaperIou { .. } => hot_pixels(heat, &vec![PAPER_HEAT_MIN; heat.values.len()], segments),
    };
    let tally = Tally::of(&hot, segments);
    let chosen = match rule {
        Fusion::Coverage { coverage_min, coverage_weak, explained_min, .. } => {
            let chosen = tally.covered(coverage_min, coverage_weak);
            (tally.explained(&chosen) >= explained_min).then_some(chosen)?
        }
        Fusion::PaperIou { threshold } => tally.overlapping(threshold),
    };
    if chosen.is_empty() {
        return None;
    }
    let explained = tally.explained(&chosen);
    let confidence = (peak * tally.coverage_of(&chosen) * explained).clamp(0.0, 1.0);
    let mut is_chosen = vec![false; usize::from(segments.n_segments) + 1];
    for &segment in &chosen {
        is_chosen[usize::from(segment)] = true;
    }
    let bits = segments.labels.iter().map(|&label| is_chosen[usize::from(label)]).collect();
    let mask = Mask::new(segments.width, segments.height, bits).ok()?;
    Some(FusedMask { mask, segments: chosen, confidence, explained })
}

/// For each coarse cell the heat above which a pixel there is hot: a share of the peak of the connected
/// spot it belongs to. Cells of no spot, and spots that stay below `peak_min`, are never hot.
fn local_thresholds(heat: &HeatMap, floor: f32, peak_min: f32, share_of_peak: f32) -> Vec<f32> {
    let (width, height) = (heat.width as usize, heat.height as usize);
    let mut thresholds = vec![f32::INFINITY; heat.values.len()];
    let mut seen = vec![false; heat.values.len()];
    let mut spot = Vec::new();
    for start in 0..heat.values.len() {
        if seen[start] || heat.values[start] < floor {
            continue;
        }
        spot.clear();
        spot.push(start);
        seen[start] = true;
        let mut next = 0;
        while let Some(&at) = spot.get(next) {
            next += 1;
            let (col, row) = (at % width, at / width);
            let neighbours = [
                (col > 0).then(|| at - 1),
                (col + 1 < width).then(|| at + 1),
                (row > 0).then(|| at - width),
                (row + 1 < height).then(|| at + width),
            ];
            for neighbour in neighbours.into_iter().flatten() {
                if !seen[neighbour] && heat.values[neighbour] >= floor {
                    seen[neighbour] = true;
                    spot.push(neighbour);
                }
            }
        }
        let peak = spot.iter().map(|&at| heat.values[at]).fold(0.0, f32::max);
        if peak >= peak_min {
            for &at in &spot {
                thresholds[at] = (peak * share_of_peak).max(floor);
            }
        }
    }
    thresholds
}

/// Which pixels of the image are hot: bilinear heat against the threshold of the nearest coarse cell.
fn hot_pixels(heat: &HeatMap, thresholds: &[f32], segments: &Segments) -> Vec<bool> {
    let (columns, rows) =
        (Taps::along(segments.width, heat.width), Taps::along(segments.height, heat.height));
    let width = heat.width as usize;
    let mut hot = Vec::with_capacity(segments.labels.len());
    let mut blended = vec![0.0_f32; width];
    for y in &rows {
        let upper = &heat.values[y.first * width..(y.first + 1) * width];
        let lower = &heat.values[y.second * width..(y.second + 1) * width];
        for ((blended, &upper), &lower) in blended.iter_mut().zip(upper).zip(lower) {
            *blended = upper + y.share * (lower - upper);
        }
        let limits = &thresholds[y.nearest * width..(y.nearest + 1) * width];
        hot.extend(columns.iter().map(|x| {
            let value = blended[x.first] + x.share * (blended[x.second] - blended[x.first]);
            value >= limits[x.nearest]
        }));
    }
    hot
}

/// Between which two coarse cells a pixel lies along one axis; both cover the same extent.
struct Taps {
    first: usize,
    second: usize,
    nearest: usize,
    share: f32,
}

impl Taps {
    fn along(n_fine: u32, n_coarse: u32) -> Vec<Taps> {
        let last = n_coarse as usize - 1;
        let scale = n_coarse as f32 / n_fine as f32;
        let tap = |fine: u32| {
            let at = ((fine as f32 + 0.5) * scale - 0.5).clamp(0.0, last as f32);
            let first = at as usize;
            let nearest = ((at + 0.5) as usize).min(last);
            Taps { first, second: (first + 1).min(last), nearest, share: at - first as f32 }
        };
        (0..n_fine).map(tap).collect()
    }
}

/// Pixels and hot pixels of every segment; index 0 is what belongs to none.
struct Tally {
    n_pixels: Vec<u32>,
    n_hot: Vec<u32>,
    n_hot_all: u32,
}

impl Tally {
    fn of(hot: &[bool], segments: &Segments) -> Self {
        let n = usize::from(segments.n_segments) + 1;
        let (mut n_pixels, mut n_hot) = (vec![0; n], vec![0; n]);
        for (&label, &hot) in segments.labels.iter().zip(hot) {
            n_pixels[usize::from(label)] += 1;
            n_hot[usize::from(label)] += u32::from(hot);
        }
        let n_hot_all = n_hot.iter().sum();
        Tally { n_pixels, n_hot, n_hot_all }
    }

    fn coverage(&self, segment: u16) -> f32 {
        let idx = usize::from(segment);
        self.n_hot[idx] as f32 / self.n_pixels[idx].max(1) as f32
    }

    fn segments(&self) -> impl Iterator<Item = u16> + use<'_> {
        (1..self.n_pixels.len()).map(|idx| idx as u16)
    }

    /// The segments that are covered, and weaker ones, best first, while much heat is unexplained.
    fn covered(&self, coverage_min: f32, coverage_weak: f32) -> Vec<u16> {
        let mut chosen: Vec<u16> = self.segments().filter(|&s| self.coverage(s) >= coverage_min).collect();
        let mut weak: Vec<u16> = self
            .segments()
            .filter(|&s| self.coverage(s) < coverage_min && self.coverage(s) >= coverage_weak)
            .collect();
        weak.sort_by(|&a, &b| self.coverage(b).total_cmp(&self.coverage(a)));
        for segment in weak {
            if self.explained(&chosen) >= EXPLAINED_WELL {
                break;
            }
            chosen.push(segment);
        }
        chosen.sort_unstable();
        chosen
    }

    /// The paper's choice.
    fn overlapping(&self, threshold: f32) -> Vec<u16> {
        let iou = |segment: u16| {
            let idx = usize::from(segment);
            let union = self.n_pixels[idx] + self.n_hot_all - self.n_hot[idx];
            self.n_hot[idx] as f32 / union.max(1) as f32
        };
        self.segments().filter(|&s| iou(s) > threshold).collect()
    }

    /// Share of the hot pixels that lie in `chosen`.
    fn explained(&self, chosen: &[u16]) -> f32 {
        let n: u32 = chosen.iter().map(|&s| self.n_hot[usize::from(s)]).sum();
        n as f32 / self.n_hot_all.max(1) as f32
    }

    /// Share of the pixels of `chosen` that are hot.
    fn coverage_of(&self, chosen: &[u16]) -> f32 {
        let n_hot: u32 = chosen.iter().map(|&s| self.n_hot[usize::from(s)]).sum();
        let n_pixels: u32 = chosen.iter().map(|&s| self.n_pixels[usize::from(s)]).sum();
        n_hot as f32 / n_pixels.max(1) as f32
    }
}
