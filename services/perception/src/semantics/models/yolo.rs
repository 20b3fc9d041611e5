//! Instance segmentation by a model of the YOLO family: named objects, each with its mask.
//!
//! What the members share: one output with a row for each candidate (box, perhaps objectness, classes,
//! coefficients) and one with prototypes; a mask is the sigmoid of coefficients times prototypes, cut to the
//! box. What they differ in (order of sides, objectness, boxes in pixels or shares, row or column) is read
//! from the shapes. Suppression of doubles is done here. Not here: which phrase means which class.

use anyhow::{bail, ensure};
use image::RgbImage;

use super::picture::{Letterbox, Order, letterboxed, numbers};
use super::runtime::{Floats, Model, Numbers};

/// A candidate that overlaps a better one of its class by more than this is the same object.
const IOU_SAME: f32 = 0.6;
/// Most objects in one image.
const N_OBJECTS_MAX: usize = 200;
/// Boxes that are all smaller than this many pixels are shares of the image.
const SHARE_MAX: f32 = 2.0;

/// One object in an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Position of its class among the labels.
    pub class_idx: usize,
    /// How sure the model is, 0 to 1.
    pub score: f32,
    /// Which pixels of the image, row-major.
    pub mask: Vec<bool>,
}

/// A model of the family, open, its shapes understood.
pub struct Yolo {
    model: Model,
    layout: Layout,
    labels: Vec<String>,
    score_min: f32,
}

/// What the shapes say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    order: Order,
    width: u32,
    height: u32,
    n_classes: usize,
    has_objectness: bool,
    /// Each candidate's numbers lie together.
    is_by_candidate: bool,
    n_coefficients: usize,
    /// Prototypes come plane by plane.
    is_by_plane: bool,
    boxes_first: bool,
}

impl Yolo {
    /// Understands a model whose classes are `labels`; objects less sure than `score_min` are left out.
    ///
    /// # Errors
    /// When it is no model of the family, or has other classes: says what was found.
    pub fn new(model: Model, labels: Vec<String>, score_min: f32) -> anyhow::Result<Self> {
        let layout = layout(&model, labels.len())?;
        Ok(Yolo { model, layout, labels, score_min })
    }

    /// Names of the classes.
    #[must_use]
    pub fn labels(&self) -> &[String] {
        &self.labels
    }

    /// The file it came from.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.model.name
    }

    /// The objects of an image, best first.
    ///
    /// # Errors
    /// When the model fails or answers in another shape than it promised.
    pub fn instances(&self, picture: &RgbImage) -> anyhow::Result<Vec<Instance>> {
        let Layout { order, width, height, boxes_first, .. } = self.layout;
        let (boxed, place) = letterboxed(picture, width, height);
        let values = numbers(&boxed, order, [1.0 / 255.0; 3], [0.0; 3]);
        let (w, h) = (width as usize, height as usize);
        let shape = match order {
            Order::Planes => vec![1, 3, h, w],
            Order::Pixels => vec![1, h, w, 3],
        };
        let Some(input) = self.model.inputs.first() else { bail!("model {}: no input", self.name()) };
        let outputs = self.model.run(vec![(&input.name, shape, Numbers::Floats(values))])?;
        let [first, second] = outputs.as_slice() else { bail!("model {}: not two outputs", self.name()) };
        let (boxes, prototypes) = if boxes_first { (first, second) } else { (second, first) };
        let candidates = self.candidates(boxes)?;
        let protos = Prototypes::new(prototypes, &self.layout)?;
        let size = picture.dimensions();
        Ok(distinct(candidates)
            .into_iter()
            .map(|c| Instance {
                class_idx: c.class_idx,
                score: c.score,
                mask: protos.mask(&c, &self.layout, place, size),
            })
            .filter(|instance| instance.mask.iter().any(|b| *b))
            .collect())
    }

    fn candidates(&self, boxes: &Floats) -> anyhow::Result<Vec<Candidate>> {
        let layout = &self.layout;
        let n_features = layout.n_features();
        let n = boxes.values.len() / n_features;
        ensure!(
            n > 0 && boxes.values.len() == n * n_features,
            "model {}: {} numbers in boxes of {n_features} each",
            self.name(),
            boxes.values.len()
        );
        let at = |candidate: usize, feature: usize| {
            let idx = if layout.is_by_candidate {
                candidate * n_features + feature
            } else {
                feature * n + candidate
            };
            boxes.values.get(idx).copied().unwrap_or(0.0)
        };
        let is_share = (0..n).all(|c| at(c, 2) <= SHARE_MAX && at(c, 3) <= SHARE_MAX);
        let unit = if is_share { (layout.width as f32, layout.height as f32) } else { (1.0, 1.0) };
        let first_class = if layout.has_objectness { 5 } else { 4 };
        let mut candidates = Vec::new();
        for c in 0..n {
            let objectness = if layout.has_objectness { at(c, 4) } else { 1.0 };
            if objectness < self.score_min {
                continue;
            }
            let best = (0..layout.n_classes)
                .map(|k| (k, at(c, first_class + k)))
                .max_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or((0, 0.0));
            let score = objectness * best.1;
            let (x, y, w, h) = (at(c, 0) * unit.0, at(c, 1) * unit.1, at(c, 2) * unit.0, at(c, 3) * unit.1);
            // Written so that NaN is left out.
            if !(score >= self.score_min && w > 0.0 && h > 0.0 && (x + y).is_finite()) {
                continue;
            }
            let from = first_class + layout.n_classes;
            candidates.push(Candidate {
                class_idx: best.0,
                score,
                left: x - w / 2.0,
                top: y - h / 2.0,
                right: x + w / 2.0,
                bottom: y + h / 2.0,
                coefficients: (from..n_features).map(|k| at(c, k)).collect(),
            });
        }
        Ok(candidates)
    }
}

impl Layout {
    fn n_features(&self) -> usize {
        4 + usize::from(self.has_objectness) + self.n_classes + self.n_coefficients
    }
}

fn layout(model: &Model, n_classes: usize) -> anyhow::Result<Layout> {
    let shapes = || {
        let ports = model.inputs.iter().chain(&model.outputs);
        ports.map(|p| format!("`{}` {:?}", p.name, p.shape)).collect::<Vec<_>>().join(", ")
    };
    let odd = |what: &str| {
        anyhow::anyhow!(
            "model {}: {what}; must be a YOLO segmentation of {n_classes} classes: one image [1, 3, h, w] or \
             [1, h, w, 3] in, boxes [1, n, 4 or 5 + {n_classes} + m] and prototypes of m planes out; it has {}",
            model.name,
            shapes()
        )
    };
    let sides =
        |shape: &[i64]| -> Vec<usize> { shape.iter().map(|s| usize::try_from(*s).unwrap_or(0)).collect() };
    let [input] = model.inputs.as_slice() else { return Err(odd("not one input")) };
    let (order, height, width) = match sides(&input.shape).as_slice() {
        [_, 3, h, w] if *h > 0 && *w > 0 => (Order::Planes, *h, *w),
        [_, h, w, 3] if *h > 0 && *w > 0 => (Order::Pixels, *h, *w),
        _ => return Err(odd("no image goes in")),
    };
    let [first, second] = model.outputs.as_slice() else { return Err(odd("not two outputs")) };
    let boxes_first = first.shape.len() == 3;
    let (boxes, prototypes) = if boxes_first { (first, second) } else { (second, first) };
    let (boxes, prototypes) = (sides(&boxes.shape), sides(&prototypes.shape));
    let (&[_, a, b], &[_, p, _, r]) = (boxes.as_slice(), prototypes.as_slice()) else {
        return Err(odd("the outputs are not boxes and prototypes"));
    };
    // More candidates than numbers each; prototypes are wider than they are many.
    let (n_features, is_by_candidate) = if b < a { (b, true) } else { (a, false) };
    let (n_coefficients, is_by_plane) = if p < r { (p, true) } else { (r, false) };
    let rest = n_features.checked_sub(4 + n_classes + n_coefficients);
    let has_objectness = match rest {
        Some(0) => false,
        Some(1) => true,
        _ => return Err(odd("the numbers of a box do not add up")),
    };
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    Ok(Layout {
        order,
        width: side(width),
        height: side(height),
        n_classes,
        has_objectness,
        is_by_candidate,
        n_coefficients,
        is_by_plane,
        boxes_first,
    })
}

/// A box of the model's image, pixels, and what its mask is made of.
#[derive(Clone, Debug, PartialEq)]
struct Candidate {
    class_idx: usize,
    score: f32,
    left: f32,
    top: f32,
    right: f32,
    bottom: f32,
    coefficients: Vec<f32>,
}

impl Candidate {
    fn area(&self) -> f32 {
        (self.right - self.left) * (self.bottom - self.top)
    }

    fn iou(&self, other: &Candidate) -> f32 {
        let width = self.right.min(other.right) - self.left.max(other.left);
        let height = self.bottom.min(other.bottom) - self.top.max(other.top);
        let shared = width.max(0.0) * height.max(0.0);
        shared / (self.area() + other.area() - shared).max(f32::MIN_POSITIVE)
    }
}

/// The best candidate of each object, best first.
fn distinct(mut candidates: Vec<Candidate>) -> Vec<Candidate> {
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        if kept.len() == N_OBJECTS_MAX {
            break;
        }
        let is_double = |k: &Candidate| k.class_idx == candidate.class_idx && k.iou(&candidate) > IOU_SAME;
        if !kept.iter().any(is_double) {
            kept.push(candidate);
        }
    }
    kept
}

/// Planes that masks are mixed from.
struct Prototypes {
    width: usize,
    height: usize,
    /// Plane by plane.
    planes: Vec<Vec<f32>>,
}

impl Prototypes {
    fn new(floats: &Floats, layout: &Layout) -> anyhow::Result<Self> {
        let n = layout.n_coefficients;
        let [_, a, b, c] = floats.shape[..] else {
            bail!("prototypes of {} sides, must be 4", floats.shape.len())
        };
        let (n_found, height, width) = if layout.is_by_plane { (a, b, c) } else { (c, a, b) };
        let n_cells = height * width;
        ensure!(n_found == n && n_cells > 0, "prototypes are {:?}, must be of {n} planes", floats.shape);
        let planes = if layout.is_by_plane {
            floats.values.chunks_exact(n_cells).map(<[f32]>::to_vec).collect()
        } else {
            (0..n).map(|k| floats.values.iter().skip(k).step_by(n).copied().collect()).collect()
        };
        Ok(Prototypes { width, height, planes })
    }

    /// The mask of one candidate in the image of `size`, cut to its box.
    fn mask(&self, of: &Candidate, layout: &Layout, place: Letterbox, size: (u32, u32)) -> Vec<bool> {
        let (width, height) = (size.0 as usize, size.1 as usize);
        let mut logits = vec![0.0_f32; self.width * self.height];
        for (plane, coefficient) in self.planes.iter().zip(&of.coefficients) {
            logits.iter_mut().zip(plane).for_each(|(sum, value)| *sum += coefficient * value);
        }
        let mut mask = vec![false; width * height];
        let across = self.width as f32 / layout.width as f32;
        let down = self.height as f32 / layout.height as f32;
        for (row, pixels) in mask.chunks_exact_mut(width.max(1)).enumerate() {
            let y = (row as f32 + 0.5) * place.scale + place.top;
            if y < of.top || y > of.bottom {
                continue;
            }
            for (col, pixel) in pixels.iter_mut().enumerate() {
                let x = (col as f32 + 0.5) * place.scale + place.left;
                // Half of the sigmoid is where the sum is zero.
                *pixel =
                    (of.left..=of.right).contains(&x) && self.blended(&logits, x * across, y * down) > 0.0;
            }
        }
        mask
    }

    /// Bilinear between the centres of cells; `x`, `y` in cells from the corner.
    fn blended(&self, logits: &[f32], x: f32, y: f32) -> f32 {
        let clamped = |v: f32, n: usize| (v - 0.5).clamp(0.0, (n - 1) as f32);
        let (x, y) = (clamped(x, self.width), clamped(y, self.height));
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let at = |col: usize, row: usize| logits.get(row * self.width + col).copied().unwrap_or(0.0);
        let (share_x, share_y) = (x - left as f32, y - top as f32);
        let upper = at(left, top) + share_x * (at(right, top) - at(left, top));
        let lower = at(left, bottom) + share_x * (at(right, bottom) - at(left, bottom));
        upper + share_y * (lower - upper)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(class_idx: usize, score: f32, left: f32, right: f32) -> Candidate {
        let coefficients = vec![1.0, -0.5];
        Candidate { class_idx, score, left, top: 0.0, right, bottom: 10.0, coefficients }
    }

    #[test]
    fn doubles_of_one_class_are_one_object_and_neighbours_are_not() {
        let kept = distinct(vec![
            candidate(1, 0.5, 0.0, 10.0),
            candidate(1, 0.9, 1.0, 10.0),
            candidate(2, 0.4, 0.0, 10.0),
            candidate(1, 0.7, 6.0, 16.0),
        ]);
        let kept: Vec<(usize, f32)> = kept.iter().map(|c| (c.class_idx, c.score)).collect();
        assert_eq!(kept, [(1, 0.9), (1, 0.7), (2, 0.4)]);
    }

    #[test]
    fn a_mask_is_where_its_prototypes_say_and_ends_at_its_box() {
        let layout = Layout {
            order: Order::Planes,
            width: 16,
            height: 16,
            n_classes: 1,
            has_objectness: false,
            is_by_candidate: true,
            n_coefficients: 2,
            is_by_plane: true,
            boxes_first: true,
        };
        // The first plane is positive on the left half, the second is small everywhere.
        let plane: Vec<f32> = (0..16).map(|idx| if idx % 4 < 2 { 1.0 } else { -1.0 }).collect();
        let values = plane.into_iter().chain(vec![0.1; 16]).collect();
        let protos = Prototypes::new(&Floats { shape: vec![1, 2, 4, 4], values }, &layout).unwrap();
        let place = Letterbox { scale: 2.0, left: 0.0, top: 0.0 };
        let mask = protos.mask(&candidate(0, 0.9, 4.0, 16.0), &layout, place, (8, 8));
        let row: Vec<usize> = (0..8).filter(|col| mask[*col]).collect();
        // Of eight columns the left four are positive; the box begins at the third and ends at row five.
        assert_eq!(row, [2, 3]);
        assert_eq!((mask[4 * 8 + 2], mask[5 * 8 + 2]), (true, false));
    }

    #[test]
    fn prototypes_by_pixel_and_by_plane_are_the_same() {
        let layout = |is_by_plane| Layout {
            order: Order::Pixels,
            width: 8,
            height: 8,
            n_classes: 1,
            has_objectness: true,
            is_by_candidate: false,
            n_coefficients: 2,
            is_by_plane,
            boxes_first: true,
        };
        let by_plane =
            Floats { shape: vec![1, 2, 2, 2], values: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0] };
        let by_pixel =
            Floats { shape: vec![1, 2, 2, 2], values: vec![1.0, 5.0, 2.0, 6.0, 3.0, 7.0, 4.0, 8.0] };
        let one = Prototypes::new(&by_plane, &layout(true)).unwrap();
        assert_eq!(one.planes, Prototypes::new(&by_pixel, &layout(false)).unwrap().planes);
        let odd = Floats { shape: vec![1, 3, 2, 2], values: vec![0.0; 12] };
        assert!(Prototypes::new(&odd, &layout(true)).is_err());
    }
}
