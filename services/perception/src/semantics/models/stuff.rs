//! Semantic segmentation: what each pixel shows, for floors, walls, doors and rugs, which are no objects.
//!
//! Takes an image `[1, h, w, 3]` or `[1, 3, h, w]` in −1 to 1 and gives scores of classes for each pixel; class
//! 0 is none. It cannot tell two rugs apart. Not here: which of its classes are believed (`vocabulary`).

use anyhow::{bail, ensure};
use image::RgbImage;

use super::picture::{Order, numbers, stretched};
use super::runtime::{Model, Numbers};

/// A semantic segmentation, open.
pub struct Stuff {
    model: Model,
    order: Order,
    width: u32,
    height: u32,
    /// By class; the first is none.
    labels: Vec<String>,
}

impl Stuff {
    /// Understands a model of these labels, the first of which is class 1.
    ///
    /// # Errors
    /// When it is no such model: says what was found.
    pub fn new(model: Model, labels: &[String]) -> anyhow::Result<Self> {
        let [input] = model.inputs.as_slice() else { bail!("model {}: not one input", model.name) };
        let sides: Vec<u32> = input.shape.iter().map(|s| u32::try_from(*s).unwrap_or(0)).collect();
        let (order, height, width) = match sides[..] {
            [_, 3, h, w] if h > 0 && w > 0 => (Order::Planes, h, w),
            [_, h, w, 3] if h > 0 && w > 0 => (Order::Pixels, h, w),
            _ => bail!(
                "model {}: `{}` is {:?}, must be an image [1, h, w, 3] or [1, 3, h, w]",
                model.name,
                input.name,
                input.shape
            ),
        };
        let n_classes = labels.len() + 1;
        let [output] = model.outputs.as_slice() else { bail!("model {}: not one output", model.name) };
        model.check(output, &[Some(1), None, None, Some(n_classes)])?;
        let all = std::iter::once(String::new()).chain(labels.iter().cloned()).collect();
        Ok(Stuff { model, order, width, height, labels: all })
    }

    /// Names of the classes, none first.
    #[must_use]
    pub fn labels(&self) -> &[String] {
        &self.labels
    }

    /// The class of each pixel of an image, row-major.
    ///
    /// # Errors
    /// When the model fails or answers in another shape than it promised.
    pub fn classes(&self, picture: &RgbImage) -> anyhow::Result<Vec<u16>> {
        let small = stretched(picture, self.width, self.height);
        let values = numbers(&small, self.order, [1.0 / 127.5; 3], [-1.0; 3]);
        let (w, h) = (self.width as usize, self.height as usize);
        let shape = match self.order {
            Order::Planes => vec![1, 3, h, w],
            Order::Pixels => vec![1, h, w, 3],
        };
        let Some(input) = self.model.inputs.first() else { bail!("model {}: no input", self.model.name) };
        let outputs = self.model.run(vec![(&input.name, shape, Numbers::Floats(values))])?;
        let Some(logits) = outputs.first() else { bail!("model {}: no output", self.model.name) };
        let [_, rows, cols, n_classes] = logits.shape[..] else {
            bail!("model {}: {} sides, must be 4", self.model.name, logits.shape.len())
        };
        ensure!(
            n_classes == self.labels.len() && rows > 0 && cols > 0,
            "model {}: {n_classes} classes, must be {}",
            self.model.name,
            self.labels.len()
        );
        let best: Vec<u16> = logits.values.chunks_exact(n_classes).map(argmax).collect();
        let (width, height) = (picture.width() as usize, picture.height() as usize);
        let nearest = |idx: usize, n: usize, n_from: usize| (2 * idx + 1) * n_from / (2 * n);
        let mut classes = Vec::with_capacity(width * height);
        for row in 0..height {
            let from = nearest(row, height, rows) * cols;
            classes.extend(
                (0..width).map(|col| best.get(from + nearest(col, width, cols)).copied().unwrap_or(0)),
            );
        }
        Ok(classes)
    }
}

fn argmax(scores: &[f32]) -> u16 {
    let best = scores.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    best.and_then(|(idx, _)| u16::try_from(idx).ok()).unwrap_or(0)
}
