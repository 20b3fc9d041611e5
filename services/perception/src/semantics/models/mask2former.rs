//! Mask2Former: every pixel to a segment with exact borders. The model answers with queries, each a class and a
//! mask; which of them become segments is decided here as the reference implementation does.
//!
//! (Cheng et al., CVPR 2022.) Not here: what the segments are called; heat maps choose among them.

use anyhow::{bail, ensure};
use image::RgbImage;

use super::clipseg::normalising;
use super::manifest::{Manifest, Mask2FormerManifest};
use super::picture::{Order, numbers, stretched};
use super::runtime::{Floats, Model, Numbers, Runtime};

/// Masks are brought to this size first, whatever the image's.
const SIDE: usize = 384;

/// The model, open.
pub struct Mask2Former {
    model: Model,
    manifest: Mask2FormerManifest,
}

/// The segments of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Panoptic {
    /// Number of segments.
    pub n_segments: u16,
    /// Of each pixel, row-major; 0 is none.
    pub labels: Vec<u16>,
    /// Class of each segment.
    pub classes: Vec<usize>,
}

impl Mask2Former {
    /// Opens what a manifest names.
    ///
    /// # Errors
    /// When the file is missing or not the one that was exported.
    pub fn open(runtime: &Runtime, manifest: &Manifest) -> anyhow::Result<Self> {
        let model = manifest.open(runtime, "mask2former")?;
        let n_classes = manifest.mask2former.labels.len() + 1;
        model
            .check(model.port(&model.outputs, "class_queries_logits")?, &[Some(1), None, Some(n_classes)])?;
        model.check(model.port(&model.outputs, "masks_queries_logits")?, &[Some(1), None, None, None])?;
        Ok(Mask2Former { model, manifest: manifest.mask2former.clone() })
    }

    /// The model's file.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.model.name
    }

    /// The segments of an image.
    ///
    /// # Errors
    /// When the model fails or answers in another shape than it promised.
    pub fn segments(&self, picture: &RgbImage) -> anyhow::Result<Panoptic> {
        let Mask2FormerManifest { width_px, height_px, mean, std, .. } = &self.manifest;
        let (gain, offset) = normalising(mean, std);
        let values = numbers(&stretched(picture, *width_px, *height_px), Order::Planes, gain, offset);
        let shape = vec![1, 3, *height_px as usize, *width_px as usize];
        let outputs = self.model.run(vec![("pixel_values", shape, Numbers::Floats(values))])?;
        let of = |name: &str| {
            let idx = self.model.outputs.iter().position(|port| port.name == name);
            idx.and_then(|idx| outputs.get(idx))
        };
        let (Some(classes), Some(masks)) = (of("class_queries_logits"), of("masks_queries_logits")) else {
            bail!("model {}: an output is missing", self.model.name)
        };
        panoptic(classes, masks, picture.dimensions(), &self.manifest)
    }
}

/// A query that is sure enough.
struct Query {
    class: usize,
    score: f32,
    /// Probability of each pixel of the image.
    mask: Vec<f32>,
}

/// From queries to segments, by the reference's rules: sure enough and of a class, each mask weighed by its
/// score, each pixel to the strongest, and no mask of which others cover too much.
fn panoptic(
    classes: &Floats,
    masks: &Floats,
    size: (u32, u32),
    rules: &Mask2FormerManifest,
) -> anyhow::Result<Panoptic> {
    let (&[_, n, n_classes], &[_, n_masks, rows, cols]) = (classes.shape.as_slice(), masks.shape.as_slice())
    else {
        bail!("queries of {:?} and {:?}", classes.shape, masks.shape)
    };
    ensure!(
        n == n_masks && n_classes == rules.labels.len() + 1 && rows > 0 && cols > 0,
        "queries of {:?} and {:?}, must be of {} classes and none",
        classes.shape,
        masks.shape,
        rules.labels.len()
    );
    let (width, height) = (size.0 as usize, size.1 as usize);
    let mut queries = Vec::new();
    for (scores, mask) in classes.values.chunks_exact(n_classes).zip(masks.values.chunks_exact(rows * cols)) {
        let (class, score) = softmax_best(scores);
        if class + 1 == n_classes || score <= rules.score_min {
            continue;
        }
        let mut square = resized(mask, (cols, rows), (SIDE, SIDE));
        square.iter_mut().for_each(|logit| *logit = 1.0 / (1.0 + (-*logit).exp()));
        let mut mask = resized(&square, (SIDE, SIDE), (width, height));
        mask.iter_mut().for_each(|share| *share *= score);
        queries.push(Query { class, score, mask });
    }
    // The strongest query of each pixel; the first of equals.
    let mut strongest = vec![(0_usize, f32::NEG_INFINITY); width * height];
    for (idx, query) in queries.iter().enumerate() {
        for (best, share) in strongest.iter_mut().zip(&query.mask).filter(|(best, share)| **share > best.1) {
            *best = (idx, *share);
        }
    }
    let mut n_won = vec![0_usize; queries.len()];
    if !queries.is_empty() {
        strongest.iter().for_each(|(idx, _)| n_won.iter_mut().skip(*idx).take(1).for_each(|n| *n += 1));
    }
    let mut segment_of = vec![0_u16; queries.len()];
    let mut found = Panoptic { n_segments: 0, labels: Vec::new(), classes: Vec::new() };
    for ((query, n_won), segment) in queries.iter().zip(n_won).zip(&mut segment_of) {
        debug_assert!(query.score > rules.score_min);
        let n_inside = query.mask.iter().filter(|share| **share >= rules.mask_min).count();
        if n_won > 0 && n_inside > 0 && n_won as f32 / n_inside as f32 > rules.overlap_min {
            found.n_segments += 1;
            *segment = found.n_segments;
            found.classes.push(query.class);
        }
    }
    found.labels = strongest.iter().map(|(idx, _)| segment_of.get(*idx).copied().unwrap_or(0)).collect();
    Ok(found)
}

/// The likeliest class and its probability.
fn softmax_best(logits: &[f32]) -> (usize, f32) {
    let best = logits.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    let Some((class, &most)) = best else { return (0, 0.0) };
    let sum: f32 = logits.iter().map(|logit| (logit - most).exp()).sum();
    (class, 1.0 / sum)
}

/// Bilinear to another (columns, rows), pixels as areas, no smoothing: as `align_corners=False` means.
fn resized(values: &[f32], from: (usize, usize), to: (usize, usize)) -> Vec<f32> {
    let taps = |n_from: usize, n_to: usize| -> Vec<(usize, usize, f32)> {
        let scale = n_from as f32 / n_to as f32;
        let tap = |k: usize| {
            let at = ((k as f32 + 0.5) * scale - 0.5).max(0.0);
            let first = (at as usize).min(n_from - 1);
            (first, (first + 1).min(n_from - 1), at - first as f32)
        };
        (0..n_to).map(tap).collect()
    };
    let (columns, rows) = (taps(from.0, to.0), taps(from.1, to.1));
    let at = |col: usize, row: usize| values.get(row * from.0 + col).copied().unwrap_or(0.0);
    let mut result = Vec::with_capacity(to.0 * to.1);
    for (top, bottom, down) in &rows {
        result.extend(columns.iter().map(|(left, right, across)| {
            let upper = at(*left, *top) * (1.0 - across) + at(*right, *top) * across;
            let lower = at(*left, *bottom) * (1.0 - across) + at(*right, *bottom) * across;
            upper * (1.0 - down) + lower * down
        }));
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Queries over an image of 4×4 masks: (class logits, constant mask logit on the left half, on the right).
    fn segments(queries: &[([f32; 3], f32, f32)]) -> Panoptic {
        let rules = Mask2FormerManifest {
            width_px: 32,
            height_px: 32,
            mean: [0.0; 3],
            std: [1.0; 3],
            labels: vec!["chair".into(), "table".into()],
            score_min: 0.5,
            mask_min: 0.5,
            overlap_min: 0.8,
        };
        let classes = queries.iter().flat_map(|q| q.0).collect();
        let masks = queries.iter().flat_map(|q| (0..4).flat_map(|_| [q.1, q.1, q.2, q.2])).collect();
        let n = queries.len();
        let classes = Floats { shape: vec![1, n, 3], values: classes };
        let masks = Floats { shape: vec![1, n, 4, 4], values: masks };
        panoptic(&classes, &masks, (8, 8), &rules).unwrap()
    }

    #[test]
    fn each_half_goes_to_the_query_that_claims_it() {
        let found = segments(&[([9.0, 0.0, 0.0], 8.0, -8.0), ([0.0, 9.0, 0.0], -8.0, 8.0)]);
        assert_eq!((found.n_segments, found.classes.as_slice()), (2, &[0, 1][..]));
        assert_eq!((found.labels[0], found.labels[7]), (1, 2));
        assert_eq!(found.labels.iter().filter(|l| **l == 1).count(), 32);
    }

    #[test]
    fn no_object_the_unsure_and_the_covered_make_no_segment() {
        // None, then unsure between both classes, then one that a surer one covers wholly.
        let found = segments(&[
            ([0.0, 0.0, 9.0], 8.0, 8.0),
            ([1.0, 1.0, 0.0], 8.0, 8.0),
            ([9.0, 0.0, 0.0], 8.0, 8.0),
            ([3.0, 0.0, 0.0], 8.0, 8.0),
        ]);
        assert_eq!((found.n_segments, found.classes.as_slice()), (1, &[0][..]));
        assert!(found.labels.iter().all(|label| *label == 1));
        let nothing = segments(&[([0.0, 0.0, 9.0], 8.0, 8.0)]);
        assert!(nothing.n_segments == 0 && nothing.labels.iter().all(|label| *label == 0));
    }
}
