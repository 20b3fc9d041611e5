//! Sentence embedding: how alike two phrases mean.
//!
//! A BERT-like model with its `tokenizer.json`; its vectors are pooled and of length 1, so that the cosine
//! of two is their product. Vectors are kept: phrases and labels come again and again.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use anyhow::{anyhow, bail, ensure};
use tokenizers::Tokenizer;

use super::runtime::{Model, Numbers};

/// Most tokens of a phrase; what is beyond is cut.
const N_TOKENS_MAX: usize = 64;
/// Most vectors kept; when there are more, all are made anew.
const N_KEPT_MAX: usize = 4096;

/// The model and its words.
pub struct Sentences {
    model: Model,
    tokenizer: Tokenizer,
    kept: Mutex<HashMap<String, Vec<f32>>>,
}

/// Reads a tokenizer's file.
///
/// # Errors
/// When it is missing or none, with its name.
pub fn open_tokenizer(file: &Path) -> anyhow::Result<Tokenizer> {
    ensure!(file.is_file(), "tokenizer {}: no such file", file.display());
    let mut tokenizer =
        Tokenizer::from_file(file).map_err(|e| anyhow!("tokenizer {}: {e}", file.display()))?;
    // A file may ask for filling up to a fixed length: no model here needs it.
    tokenizer.with_padding(None);
    Ok(tokenizer)
}

impl Sentences {
    /// Joins model and tokenizer.
    ///
    /// # Errors
    /// When the model is none of the kind: says what was found.
    pub fn new(model: Model, tokenizer: Tokenizer) -> anyhow::Result<Self> {
        for name in ["input_ids", "attention_mask"] {
            let port = model.port(&model.inputs, name)?;
            model.check(port, &[None, None])?;
            ensure!(port.is_whole, "model {}: `{name}` must hold whole numbers", model.name);
        }
        let output = model.port(&model.outputs, "sentence_embedding")?;
        ensure!(output.shape.len() == 2, "model {}: `sentence_embedding` must have 2 sides", model.name);
        Ok(Sentences { model, tokenizer, kept: Mutex::default() })
    }

    /// The vector of a phrase, of length 1.
    ///
    /// # Errors
    /// When the model fails.
    pub fn vector(&self, phrase: &str) -> anyhow::Result<Vec<f32>> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(vector) = kept.get(phrase) {
            return Ok(vector.clone());
        }
        let encoding = self.tokenizer.encode(phrase, true).map_err(|e| anyhow!("phrase {phrase:?}: {e}"))?;
        let ids: Vec<i64> = encoding.get_ids().iter().take(N_TOKENS_MAX).map(|id| i64::from(*id)).collect();
        let shape = vec![1, ids.len()];
        let mask = Numbers::Wholes(vec![1; ids.len()]);
        let outputs = self
            .model
            .run(vec![("input_ids", shape.clone(), Numbers::Wholes(ids)), ("attention_mask", shape, mask)])?;
        let idx = self.model.outputs.iter().position(|p| p.name == "sentence_embedding").unwrap_or(0);
        let Some(mut vector) = outputs.into_iter().nth(idx).map(|o| o.values) else {
            bail!("model {}: no output", self.model.name)
        };
        let length = vector.iter().map(|v| v * v).sum::<f32>().sqrt();
        ensure!(length > 0.0 && length.is_finite(), "model {}: a vector of length {length}", self.model.name);
        vector.iter_mut().for_each(|v| *v /= length);
        if kept.len() >= N_KEPT_MAX {
            kept.clear();
        }
        kept.insert(phrase.to_owned(), vector.clone());
        Ok(vector)
    }

    /// How alike two phrases mean: −1 to 1.
    ///
    /// # Errors
    /// When the model fails.
    pub fn cosine(&self, one: &str, other: &str) -> anyhow::Result<f32> {
        let (one, other) = (self.vector(one)?, self.vector(other)?);
        Ok(one.iter().zip(&other).map(|(a, b)| a * b).sum())
    }
}
