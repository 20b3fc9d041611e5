//! What an export of models holds: names, shapes, labels, hashes; checked before anything is opened.
//!
//! Written by `deploy/models/export.py`. A file that was swapped, cut short or exported anew without its
//! manifest is refused by name at start, not noticed by odd masks.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use serde::Deserialize;
use sha2::{Digest, Sha256};

use super::runtime::{Model, Runtime};

/// The manifest's file.
pub const FILE: &str = "manifest.json";
/// The layout that is read here.
const FORMAT: u32 = 1;
/// Largest manifest, bytes.
const N_BYTES_MAX: u64 = 1024 * 1024;

/// The whole.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Layout of this file.
    pub format: u32,
    /// Where the weights come from: names of models, or `random` and a seed.
    pub weights: String,
    /// `fp32` or `int8`.
    pub precision: String,
    /// The open-vocabulary model.
    pub clipseg: ClipSegManifest,
    /// The panoptic model.
    pub mask2former: Mask2FormerManifest,
    /// Every file that is needed.
    pub files: Vec<Entry>,
    #[serde(skip)]
    folder: PathBuf,
}

/// How CLIPSeg wants images and words.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipSegManifest {
    /// Side of the square image, pixels.
    pub side_px: u32,
    /// Mean of each channel, of 0 to 1.
    pub mean: [f32; 3],
    /// Deviation of each channel.
    pub std: [f32; 3],
    /// Tokens of a phrase, filled up to.
    pub n_tokens: usize,
    /// The token that fills up.
    pub pad_id: i64,
}

/// How Mask2Former wants images, and how its answer is read.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mask2FormerManifest {
    /// Width of the image, pixels.
    pub width_px: u32,
    /// Height of the image, pixels.
    pub height_px: u32,
    /// Mean of each channel, of 0 to 1.
    pub mean: [f32; 3],
    /// Deviation of each channel.
    pub std: [f32; 3],
    /// Names of the classes.
    pub labels: Vec<String>,
    /// Masks less sure than this are left out.
    pub score_min: f32,
    /// A pixel belongs to a mask from here on.
    pub mask_min: f32,
    /// A mask of which others cover more is left out: the share it must keep.
    pub overlap_min: f32,
}

/// One file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// What it is for: `clipseg_image`, `clipseg_text`, `clipseg_decoder`, `mask2former`, `tokenizer`.
    pub role: String,
    /// Its name, in the manifest's folder.
    pub file: String,
    /// SHA-256, hex.
    pub sha256: String,
    /// Sides of each input, −1 for any; in order.
    #[serde(default)]
    pub inputs: Vec<Sides>,
    /// Sides of each output.
    #[serde(default)]
    pub outputs: Vec<Sides>,
}

/// Sides of an input or output.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sides {
    /// Its name.
    pub name: String,
    /// Its sides, −1 for any.
    pub shape: Vec<i64>,
}

impl Manifest {
    /// Reads the manifest of a folder.
    ///
    /// # Errors
    /// When it is missing or of another layout; names it.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let file = folder.join(FILE);
        let shown = || file.display().to_string();
        let mut text = String::new();
        File::open(&file).and_then(|f| f.take(N_BYTES_MAX).read_to_string(&mut text)).with_context(shown)?;
        let mut manifest: Manifest = serde_json::from_str(&text).with_context(shown)?;
        ensure!(manifest.format == FORMAT, "{}: format {}, must be {FORMAT}", shown(), manifest.format);
        let sides = [manifest.clipseg.side_px, manifest.mask2former.width_px, manifest.mask2former.height_px];
        ensure!(
            sides.iter().all(|s| (16..=2048).contains(s)),
            "{}: sides {sides:?}, must be 16 to 2048",
            shown()
        );
        let deviations = manifest.clipseg.std.iter().chain(&manifest.mask2former.std);
        ensure!(deviations.clone().all(|s| *s > 0.0), "{}: std must be above 0", shown());
        folder.clone_into(&mut manifest.folder);
        Ok(manifest)
    }

    /// The file of a role, its hash checked.
    ///
    /// # Errors
    /// When there is none, or it is not the file that was exported.
    pub fn file(&self, role: &str) -> anyhow::Result<(PathBuf, &Entry)> {
        let Some(entry) = self.files.iter().find(|entry| entry.role == role) else {
            bail!("{}: no file for {role:?}", self.folder.join(FILE).display());
        };
        let is_plain = Path::new(&entry.file).components().count() == 1;
        ensure!(is_plain, "{}: {:?} is no plain name", self.folder.join(FILE).display(), entry.file);
        let path = self.folder.join(&entry.file);
        let found = sha256(&path)?;
        ensure!(
            found == entry.sha256.to_lowercase(),
            "{}: SHA-256 is {found}, the manifest says {}: export both anew",
            path.display(),
            entry.sha256
        );
        Ok((path, entry))
    }

    /// Opens the model of a role and checks its inputs and outputs.
    ///
    /// # Errors
    /// When it is missing, another file, or of another shape than the manifest says.
    pub fn open(&self, runtime: &Runtime, role: &str) -> anyhow::Result<Model> {
        let (path, entry) = self.file(role)?;
        let model = runtime.open(&path)?;
        for (ports, wanted) in [(&model.inputs, &entry.inputs), (&model.outputs, &entry.outputs)] {
            for sides in wanted {
                let port = model.port(ports, &sides.name)?;
                let wanted: Vec<Option<usize>> =
                    sides.shape.iter().map(|side| usize::try_from(*side).ok()).collect();
                model.check(port, &wanted)?;
            }
            ensure!(
                ports.len() == wanted.len(),
                "model {}: {} inputs or outputs, the manifest says {}",
                model.name,
                ports.len(),
                wanted.len()
            );
        }
        Ok(model)
    }
}

/// SHA-256 of a file, hex.
///
/// # Errors
/// When it cannot be read.
pub fn sha256(file: &Path) -> anyhow::Result<String> {
    let shown = || file.display().to_string();
    let mut opened = File::open(file).with_context(shown)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0_u8; 1 << 16];
    loop {
        let n = opened.read(&mut buffer).with_context(shown)?;
        if n == 0 {
            break;
        }
        hash.update(buffer.get(..n).unwrap_or_default());
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
