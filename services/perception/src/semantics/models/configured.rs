//! Models that run in this process, opened as the configuration says, and who of them answers.
//!
//! Opening checks every file and shape at start: a robot does not find out on its first frame. Not here: how
//! each works.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, ensure};
use proto::{Invalid, codec::within};
use serde::{Deserialize, Serialize};

use super::detector::Detector;
use super::paired::Paired;
use super::runtime::{Runtime, RuntimeSettings};
use super::sentence::{Sentences, open_tokenizer};
use super::stuff::Stuff;
use super::vocabulary::Vocabulary;
use super::yolo::Yolo;
use super::{Answer, Ask, COCO};
use crate::semantics::frame::Frame;

/// Largest file of labels, bytes.
const N_LABEL_BYTES_MAX: u64 = 1024 * 1024;

/// Section `[semantics.yolo]`: objects, floors and walls, and the words for them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct YoloSettings {
    /// Instance segmentation of the YOLO family, ONNX.
    pub model: PathBuf,
    /// Names of its classes, one a line; empty: the 80 of COCO.
    pub labels: PathBuf,
    /// Objects less sure than this are left out, 0 to 1.
    pub score_min: f64,
    /// Semantic segmentation for floors, walls and rugs, ONNX; empty: none.
    pub stuff: PathBuf,
    /// Names of its classes from class 1 on, one a line.
    pub stuff_labels: PathBuf,
    /// Sentence embedding, ONNX; empty: only names and synonyms are understood.
    pub sentences: PathBuf,
    /// Its `tokenizer.json`.
    pub tokenizer: PathBuf,
    /// A word means the nearest known one from this cosine on.
    pub cosine_min: f64,
}

impl Default for YoloSettings {
    /// No files; objects from 0.3, words from 0.65 (sofa and couch have 0.86, carpet and rug 0.75).
    fn default() -> Self {
        YoloSettings {
            model: PathBuf::new(),
            labels: PathBuf::new(),
            score_min: 0.3,
            stuff: PathBuf::new(),
            stuff_labels: PathBuf::new(),
            sentences: PathBuf::new(),
            tokenizer: PathBuf::new(),
            cosine_min: 0.65,
        }
    }
}

impl YoloSettings {
    /// Checks what can be checked without opening files.
    ///
    /// # Errors
    /// [`Invalid`] names the key, the value and the limit.
    pub fn check(&self) -> Result<(), Invalid> {
        within("yolo.score_min", self.score_min, 0.01, 0.99)?;
        within("yolo.cosine_min", self.cosine_min, 0.3, 1.0)
    }

    /// The same, with paths that start at `folder`.
    #[must_use]
    pub fn within(mut self, folder: &Path) -> Self {
        let YoloSettings { model, labels, stuff, stuff_labels, sentences, tokenizer, .. } = &mut self;
        for path in [model, labels, stuff, stuff_labels, sentences, tokenizer] {
            if !path.as_os_str().is_empty() {
                *path = folder.join(&*path);
            }
        }
        self
    }
}

/// Section `[semantics.clipseg]`: what `deploy/models/export.py` wrote.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClipSegSettings {
    /// Folder of the export, with its `manifest.json`.
    pub folder: PathBuf,
}

/// Models of this process.
#[derive(Clone)]
pub enum LocalModels {
    /// By classes.
    Yolo(Arc<Detector>),
    /// By words.
    ClipSeg(Arc<Paired>),
}

impl LocalModels {
    /// Opens detector, segmentation and sentence embedding.
    ///
    /// # Errors
    /// Names the file that is missing or not what it should be, and what it should be.
    pub fn open_yolo(runtime: &RuntimeSettings, files: &YoloSettings) -> anyhow::Result<Self> {
        ensure!(
            !files.model.as_os_str().is_empty(),
            "no model: `model` in the section [semantics.yolo] is empty; `heedway models` tells where to get one"
        );
        let runtime = Runtime::load(runtime)?;
        let things = if is_empty(&files.labels) {
            COCO.lines().map(str::to_owned).collect()
        } else {
            labels(&files.labels)?
        };
        let things = Yolo::new(runtime.open(&files.model)?, things, files.score_min as f32)?;
        let stuff = if is_empty(&files.stuff) {
            None
        } else {
            Some(Stuff::new(runtime.open(&files.stuff)?, &labels(&files.stuff_labels)?)?)
        };
        let sentences = if is_empty(&files.sentences) {
            None
        } else {
            Some(Sentences::new(runtime.open(&files.sentences)?, open_tokenizer(&files.tokenizer)?)?)
        };
        let stuff_labels = stuff.as_ref().map_or(&[][..], |stuff| stuff.labels());
        let vocabulary = Vocabulary::new(things.labels(), stuff_labels, sentences, files.cosine_min as f32)?;
        Ok(LocalModels::Yolo(Arc::new(Detector::new(things, stuff, vocabulary))))
    }

    /// Opens CLIPSeg and Mask2Former.
    ///
    /// # Errors
    /// Names the file that is missing, not the one that was exported, or of another shape.
    pub fn open_clipseg(runtime: &RuntimeSettings, folder: &Path) -> anyhow::Result<Self> {
        ensure!(
            !folder.as_os_str().is_empty(),
            "no models: `folder` in the section [semantics.clipseg] is empty; `heedway models` tells where to get them"
        );
        Ok(LocalModels::ClipSeg(Arc::new(Paired::open(&Runtime::load(runtime)?, folder)?)))
    }

    /// Answers. Blocks for as long as the models work.
    ///
    /// # Errors
    /// When a model fails, or a phrase is empty.
    pub fn answer_now(&self, frame: &Frame, phrases: &[String]) -> anyhow::Result<Answer> {
        if let Some(odd) = phrases.iter().find(|phrase| phrase.trim().is_empty()) {
            anyhow::bail!("phrase {odd:?} is empty, must name a thing");
        }
        match self {
            LocalModels::Yolo(detector) => detector.answer(frame, phrases),
            LocalModels::ClipSeg(paired) => paired.answer(frame, phrases),
        }
    }

    /// Answers, off the caller's thread.
    ///
    /// # Errors
    /// As [`LocalModels::answer_now`].
    pub async fn answer(&self, ask: &Ask) -> anyhow::Result<Box<Answer>> {
        let (models, ask) = (self.clone(), ask.clone());
        let answer = tokio::task::spawn_blocking(move || models.answer_now(&ask.frame, &ask.phrases));
        Ok(Box::new(answer.await.context("the models' thread ended")??))
    }
}

fn is_empty(path: &Path) -> bool {
    path.as_os_str().is_empty()
}

/// Names of classes, one a line; a number and white space before a name are left out.
fn labels(file: &Path) -> anyhow::Result<Vec<String>> {
    let shown = || format!("labels {}", file.display());
    let n_bytes = std::fs::metadata(file).with_context(shown)?.len();
    ensure!(n_bytes <= N_LABEL_BYTES_MAX, "{}: {n_bytes} bytes, at most {N_LABEL_BYTES_MAX}", shown());
    let text = std::fs::read_to_string(file).with_context(shown)?;
    let name = |line: &str| match line.split_once('\t') {
        Some((number, name)) if number.trim().parse::<u32>().is_ok() => name.trim().to_owned(),
        _ => line.trim().to_owned(),
    };
    let names: Vec<String> = text.lines().filter(|line| !line.trim().is_empty()).map(name).collect();
    ensure!(!names.is_empty(), "{}: no name is in it", shown());
    Ok(names)
}
