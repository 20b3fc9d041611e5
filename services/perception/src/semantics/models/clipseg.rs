//! CLIPSeg in three parts: the image is encoded once a frame, a phrase once ever, and one small decoder draws the
//! heat maps of all phrases together.
//!
//! Exported whole, every phrase would pay for the image again. The parts are cut where the model itself joins
//! them (Lüddecke & Ecker, CVPR 2022). Not here: what is hot enough.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use anyhow::{anyhow, bail, ensure};
use image::RgbImage;
use tokenizers::Tokenizer;

use super::manifest::{ClipSegManifest, Manifest};
use super::picture::{Order, numbers, stretched};
use super::runtime::{Floats, Model, Numbers, Runtime};
use super::sentence::open_tokenizer;

/// Most phrases whose vectors are kept; when there are more, all are made anew.
const N_KEPT_MAX: usize = 1024;

/// The three parts, open.
pub struct ClipSeg {
    image: Model,
    text: Model,
    decoder: Model,
    tokenizer: Tokenizer,
    manifest: ClipSegManifest,
    kept: Mutex<HashMap<String, Vec<f32>>>,
}

/// Heat maps, one a phrase.
#[derive(Clone, Debug, PartialEq)]
pub struct Heat {
    /// Columns and rows of each.
    pub side: usize,
    /// Probability, 0 to 1; `phrases × side × side`.
    pub values: Vec<f32>,
}

impl ClipSeg {
    /// Opens what a manifest names.
    ///
    /// # Errors
    /// When a file is missing or not the one that was exported.
    pub fn open(runtime: &Runtime, manifest: &Manifest) -> anyhow::Result<Self> {
        let (tokenizer, _) = manifest.file("tokenizer")?;
        Ok(ClipSeg {
            image: manifest.open(runtime, "clipseg_image")?,
            text: manifest.open(runtime, "clipseg_text")?,
            decoder: manifest.open(runtime, "clipseg_decoder")?,
            tokenizer: open_tokenizer(&tokenizer)?,
            manifest: manifest.clipseg.clone(),
            kept: Mutex::default(),
        })
    }

    /// The file of the image encoder.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.image.name
    }

    /// The heat maps of phrases in an image.
    ///
    /// # Errors
    /// When a part fails or answers in another shape than it promised.
    pub fn heat(&self, picture: &RgbImage, phrases: &[String]) -> anyhow::Result<Heat> {
        let activations = self.activations(picture)?;
        let mut vectors = Vec::new();
        for phrase in phrases {
            vectors.extend(self.vector(phrase)?);
        }
        let n = phrases.len();
        ensure!(n > 0 && vectors.len() % n == 0, "{} numbers for {n} phrases", vectors.len());
        let mut inputs = vec![("conditional", vec![n, vectors.len() / n], Numbers::Floats(vectors))];
        for (port, floats) in self.image.outputs.iter().zip(activations) {
            inputs.push((&port.name, floats.shape, Numbers::Floats(floats.values)));
        }
        let outputs = self.decoder.run(inputs)?;
        let Some(logits) = outputs.into_iter().next() else {
            bail!("model {}: no output", self.decoder.name)
        };
        let side = self.manifest.side_px as usize;
        ensure!(
            logits.values.len() == n * side * side,
            "model {}: answered {:?}, must be [{n}, {side}, {side}]",
            self.decoder.name,
            logits.shape
        );
        let values = logits.values.iter().map(|logit| 1.0 / (1.0 + (-logit).exp())).collect();
        Ok(Heat { side, values })
    }

    fn activations(&self, picture: &RgbImage) -> anyhow::Result<Vec<Floats>> {
        let ClipSegManifest { side_px, mean, std, .. } = &self.manifest;
        let (gain, offset) = normalising(mean, std);
        let values = numbers(&stretched(picture, *side_px, *side_px), Order::Planes, gain, offset);
        let side = *side_px as usize;
        self.image.run(vec![("pixel_values", vec![1, 3, side, side], Numbers::Floats(values))])
    }

    /// The vector of a phrase; made once.
    fn vector(&self, phrase: &str) -> anyhow::Result<Vec<f32>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(vector) = kept.get(phrase) {
            return Ok(vector.clone());
        }
        let n = self.manifest.n_tokens;
        let encoding = self.tokenizer.encode(phrase, true).map_err(|e| anyhow!("phrase {phrase:?}: {e}"))?;
        let found = encoding.get_ids();
        let mut ids: Vec<i64> = found.iter().take(n).map(|id| i64::from(*id)).collect();
        // What is too long is cut before its end mark, which the model reads the meaning from.
        if let (true, Some(last), Some(end)) = (found.len() > n, ids.last_mut(), found.last()) {
            *last = i64::from(*end);
        }
        let mut mask = vec![1_i64; ids.len()];
        ids.resize(n, self.manifest.pad_id);
        mask.resize(n, 0);
        let outputs = self.text.run(vec![
            ("input_ids", vec![1, n], Numbers::Wholes(ids)),
            ("attention_mask", vec![1, n], Numbers::Wholes(mask)),
        ])?;
        let Some(vector) = outputs.into_iter().next().map(|o| o.values) else {
            bail!("model {}: no output", self.text.name)
        };
        if kept.len() >= N_KEPT_MAX {
            kept.clear();
        }
        kept.insert(phrase.to_owned(), vector.clone());
        Ok(vector)
    }
}

/// Gain and offset that take a value of 0 to 255 to `(value / 255 − mean) / std`.
#[must_use]
pub fn normalising(mean: &[f32; 3], std: &[f32; 3]) -> ([f32; 3], [f32; 3]) {
    let of = |f: &dyn Fn(f32, f32) -> f32| -> [f32; 3] {
        let [m0, m1, m2] = *mean;
        let [s0, s1, s2] = *std;
        [f(m0, s0), f(m1, s1), f(m2, s2)]
    };
    (of(&|_, s| 1.0 / (255.0 * s)), of(&|m, s| -m / s))
}
