//! Models by their files' names in one folder, for commands that are given a folder and no configuration.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use super::configured::{LocalModels, YoloSettings};
use super::manifest;
use super::runtime::{LIBRARY_VARIABLE, RuntimeSettings};

/// Folders that the library is looked for in, after the models' own and the variable.
const LIBRARY_FOLDERS: [&str; 5] = [
    "/usr/local/lib",
    "/usr/lib",
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/opt/onnxruntime/lib",
];

/// The files in a folder, by name.
struct Names {
    folder: PathBuf,
    names: Vec<String>,
}

impl Names {
    fn of(folder: &Path) -> anyhow::Result<Self> {
        let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
        let mut names: Vec<String> =
            entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        Ok(Names { folder: folder.to_owned(), names })
    }

    /// The first file, of those whose names hold all of `parts` and end so, that comes first in `preferred`.
    fn find(&self, parts: &[&str], end: &str, preferred: &[&str]) -> Option<PathBuf> {
        let fits = |name: &&String| {
            let lower = name.to_lowercase();
            lower.ends_with(end) && parts.iter().all(|part| lower.contains(part))
        };
        let rank = |name: &&String| {
            let lower = name.to_lowercase();
            preferred.iter().position(|part| lower.contains(part)).unwrap_or(preferred.len())
        };
        self.names.iter().filter(fits).min_by_key(rank).map(|name| self.folder.join(name))
    }
}

/// Opens the models of a folder: an export of CLIPSeg and Mask2Former when it holds a manifest, else those of
/// `yolo`.
///
/// # Errors
/// When neither is there, or something is missing or not what it should be.
pub fn open(folder: &Path) -> anyhow::Result<LocalModels> {
    let library = library_for(folder);
    if folder.join(manifest::FILE).exists() {
        return LocalModels::open_clipseg(&library, folder);
    }
    LocalModels::open_yolo(&library, &yolo_in(folder)?)
}

/// The models of `yolo` in a folder: `yolo*seg*.onnx` (version 7 before others: it has the best masks),
/// `*ade20k*.onnx` with `*ade20k*.txt`, `*minilm*.onnx` with `*tokenizer.json`.
///
/// # Errors
/// When there is no segmentation, or one half of a pair is missing; says what was looked for.
pub fn yolo_in(folder: &Path) -> anyhow::Result<YoloSettings> {
    let names = Names::of(folder)?;
    let shown = folder.display();
    let Some(model) = names.find(&["yolo", "seg"], ".onnx", &["yolov7", "yolov9", "yolo11", "yolov8"]) else {
        bail!("{shown}: no `yolo*seg*.onnx` is in it");
    };
    let mut found = YoloSettings { model, ..YoloSettings::default() };
    if let Some(stuff) = names.find(&["ade20k"], ".onnx", &[]) {
        let labels = names.find(&["ade20k"], ".txt", &[]);
        found.stuff_labels =
            labels.with_context(|| format!("{shown}: {} has no labels `*ade20k*.txt`", stuff.display()))?;
        found.stuff = stuff;
    }
    if let Some(sentences) = names.find(&["minilm"], ".onnx", &[]) {
        let tokenizer = names.find(&["tokenizer"], ".json", &["minilm"]);
        found.tokenizer = tokenizer
            .with_context(|| format!("{shown}: {} has no `*tokenizer.json`", sentences.display()))?;
        found.sentences = sentences;
    }
    Ok(found)
}

/// The library: in the folder, where `ORT_DYLIB_PATH` says, or where systems keep theirs. What is not found
/// is left to the loader, which says how to get it.
#[must_use]
pub fn library_for(folder: &Path) -> RuntimeSettings {
    let in_folder = |folder: &Path| Names::of(folder).ok()?.find(&["libonnxruntime.so"], "", &[]);
    let mut settings = RuntimeSettings::default();
    let found = in_folder(folder).or_else(|| {
        if std::env::var_os(LIBRARY_VARIABLE).is_some() {
            return None;
        }
        LIBRARY_FOLDERS.iter().find_map(|folder| in_folder(Path::new(folder)))
    });
    if let Some(library) = found {
        settings.library = library;
    }
    settings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_found_by_name_and_half_pairs_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str| std::fs::write(folder.path().join(name), "").unwrap();
        let refused = |words: &str| {
            let error = yolo_in(folder.path()).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        };
        refused("no `yolo*seg*.onnx`");
        make("yolov8n-seg.onnx");
        make("YOLOv7-seg-640x480.onnx");
        assert!(yolo_in(folder.path()).unwrap().model.ends_with("YOLOv7-seg-640x480.onnx"));
        make("deeplab-ade20k.onnx");
        refused("no labels");
        make("ade20k_labels.txt");
        make("all-minilm-l6.onnx");
        refused("no `*tokenizer.json`");
        make("all-minilm-l6.tokenizer.json");
        let found = yolo_in(folder.path()).unwrap();
        assert!(
            found.stuff_labels.ends_with("ade20k_labels.txt")
                && found.sentences.ends_with("all-minilm-l6.onnx")
        );
        make("libonnxruntime.so.1.24.1");
        assert!(library_for(folder.path()).library.ends_with("libonnxruntime.so.1.24.1"));
    }
}
