//! CLIPSeg and Mask2Former here against the reference implementation: the same seeded random weights, the same
//! image, post-processing included.
//!
//! `deploy/models/export.py --out DIR --random-weights --tiny --parity` writes the models and what PyPI's
//! `transformers` says of one image; the variable `HEEDWAY_PARITY` names DIR. Without it, or without ONNX
//! Runtime, the test says that it skipped.
//!
//! Tolerances: images are resized by another library that rounds otherwise (one level of 255 at most), which
//! random weights pass on, steeply at some places; so heat may differ by 0.05 at most and 0.001 on average, and
//! one pixel in 200 may go to another segment.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

use std::path::{Path, PathBuf};

use heedway_perception::semantics::models::clipseg::ClipSeg;
use heedway_perception::semantics::models::manifest::Manifest;
use heedway_perception::semantics::models::mask2former::Mask2Former;
use heedway_perception::semantics::models::runtime::{Runtime, RuntimeSettings};

fn export() -> Option<(Runtime, PathBuf)> {
    let Some(folder) = std::env::var_os("HEEDWAY_PARITY").map(PathBuf::from) else {
        eprintln!("SKIPPED: HEEDWAY_PARITY names no export");
        return None;
    };
    if std::env::var_os("ORT_DYLIB_PATH").is_none() {
        eprintln!("SKIPPED: no ONNX Runtime; set ORT_DYLIB_PATH to its library");
        return None;
    }
    Some((Runtime::load(&RuntimeSettings::default()).unwrap(), folder))
}

fn floats(file: &Path) -> Vec<f32> {
    std::fs::read(file).unwrap().chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
}

#[derive(serde::Deserialize)]
struct Reference {
    phrases: Vec<String>,
    classes: Vec<usize>,
}

fn reference(folder: &Path) -> (Reference, image::RgbImage) {
    let text = std::fs::read_to_string(folder.join("fp32/parity.json")).unwrap();
    let picture = image::open(folder.join("fp32/parity.png")).unwrap().into_rgb8();
    (serde_json::from_str(&text).unwrap(), picture)
}

#[test]
fn heat_maps_are_those_of_the_reference() {
    let Some((runtime, folder)) = export() else { return };
    let (reference, picture) = reference(&folder);
    let wanted = floats(&folder.join("fp32/parity-heat.f32"));
    // The whole range is used, and phrases differ: equal noise would prove nothing.
    let (low, high) = wanted.iter().fold((f32::MAX, f32::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    assert!(high - low > 0.01, "{low} to {high}");
    let clipseg = ClipSeg::open(&runtime, &Manifest::read(&folder.join("fp32")).unwrap()).unwrap();
    let found = clipseg.heat(&picture, &reference.phrases).unwrap();
    assert_eq!(found.values.len(), wanted.len());
    let apart: Vec<f32> = found.values.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).collect();
    let most = apart.iter().copied().fold(0.0, f32::max);
    let mean = apart.iter().sum::<f32>() / apart.len() as f32;
    eprintln!("heat maps differ by {most:.5} at most, {mean:.6} on average, in {low:.3} to {high:.3}");
    assert!(most <= 0.05 && mean <= 0.001, "{most} at most, {mean} on average");
    // One phrase alone is the same as among others, the second time too.
    let alone = clipseg.heat(&picture, &reference.phrases[1..2]).unwrap();
    let among = &found.values[alone.values.len()..2 * alone.values.len()];
    assert!(alone.values.iter().zip(among).all(|(a, b)| (a - b).abs() < 1e-4));
}

#[test]
fn segments_are_those_of_the_reference() {
    let Some((runtime, folder)) = export() else { return };
    let (reference, picture) = reference(&folder);
    let wanted = std::fs::read(folder.join("fp32/parity-segments.i32")).unwrap();
    let wanted: Vec<i32> =
        wanted.chunks_exact(4).map(|b| i32::from_le_bytes(b.try_into().unwrap())).collect();
    assert!(reference.classes.len() > 1, "one segment proves nothing: {:?}", reference.classes);
    let model = Mask2Former::open(&runtime, &Manifest::read(&folder.join("fp32")).unwrap()).unwrap();
    let found = model.segments(&picture).unwrap();
    assert_eq!(found.classes, reference.classes);
    let n_other = found.labels.iter().zip(&wanted).filter(|(a, b)| i32::from(**a) != **b).count();
    eprintln!("{} segments; {n_other} of {} pixels differ", found.n_segments, wanted.len());
    assert!(n_other * 200 <= wanted.len(), "{n_other} of {} pixels differ", wanted.len());
}

#[test]
fn a_file_that_was_swapped_is_named_at_start() {
    let Some((runtime, folder)) = export() else { return };
    let copy = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(folder.join("fp32")).unwrap().flatten() {
        std::fs::copy(entry.path(), copy.path().join(entry.file_name())).unwrap();
    }
    std::fs::copy(copy.path().join("clipseg-text.onnx"), copy.path().join("clipseg-image.onnx")).unwrap();
    let manifest = Manifest::read(copy.path()).unwrap();
    let error = format!("{:#}", ClipSeg::open(&runtime, &manifest).err().unwrap());
    assert!(error.contains("clipseg-image.onnx") && error.contains("SHA-256"), "{error}");
    // With its hash put right, the shapes still give it away.
    let file = copy.path().join("manifest.json");
    let text = std::fs::read_to_string(&file).unwrap();
    let hash = |role: &str| manifest.files.iter().find(|e| e.role == role).unwrap().sha256.clone();
    std::fs::write(&file, text.replace(&hash("clipseg_image"), &hash("clipseg_text"))).unwrap();
    let error =
        format!("{:#}", ClipSeg::open(&runtime, &Manifest::read(copy.path()).unwrap()).err().unwrap());
    assert!(error.contains("pixel_values"), "{error}");
}
