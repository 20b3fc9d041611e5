//! How long CLIPSeg takes, in its three parts and in one piece, for one rule and for several; and Mask2Former.
//!
//! `deploy/models/export.py --out DIR --random-weights --whole`, then
//! `cargo run --example clipseg_speed -- DIR/fp32` and the same with `DIR/int8`. `ORT_DYLIB_PATH` names ONNX
//! Runtime. Medians of ten, on two threads; phrases are encoded before, as on a robot.

use std::path::PathBuf;

use anyhow::Context;
use heedway_perception::semantics::models::clipseg::ClipSeg;
use heedway_perception::semantics::models::manifest::Manifest;
use heedway_perception::semantics::models::mask2former::Mask2Former;
use heedway_perception::semantics::models::runtime::{Numbers, Runtime, RuntimeSettings};
use image::RgbImage;
use service::Clock;

const N_RUNS: usize = 10;
const PHRASES: [&str; 5] = ["chair", "the red sofa", "table", "the crib", "rug by the window"];

#[allow(clippy::print_stdout, reason = "the figures go to standard output")]
fn main() -> anyhow::Result<()> {
    let folder = PathBuf::from(std::env::args().nth(1).context("a folder with a manifest is needed")?);
    let runtime = Runtime::load(&RuntimeSettings::default())?;
    let manifest = Manifest::read(&folder)?;
    let clipseg = ClipSeg::open(&runtime, &manifest)?;
    let mask2former = Mask2Former::open(&runtime, &manifest)?;
    let whole = runtime.open(&folder.join("clipseg-whole.onnx"))?;
    let picture = RgbImage::from_fn(640, 480, |x, y| image::Rgb([(x / 3) as u8, (y / 2) as u8, 90]));
    println!("{}, weights {}", manifest.precision, manifest.weights);
    let parts = |n: usize| {
        let phrases: Vec<String> = PHRASES.iter().take(n).map(|p| (*p).to_owned()).collect();
        median_ms(|| clipseg.heat(&picture, &phrases).map(drop))
    };
    let (one, three, five) = (parts(1)?, parts(3)?, parts(5)?);
    let (side, n_tokens) = (manifest.clipseg.side_px as usize, manifest.clipseg.n_tokens);
    let in_one_piece = median_ms(|| {
        // One image for each phrase, as the whole model wants it.
        let image = vec![0.1; 3 * 3 * side * side];
        let ids = Numbers::Wholes(vec![1; 3 * n_tokens]);
        let mask = Numbers::Wholes(vec![1; 3 * n_tokens]);
        let inputs = vec![
            ("pixel_values", vec![3, 3, side, side], Numbers::Floats(image)),
            ("input_ids", vec![3, n_tokens], ids),
            ("attention_mask", vec![3, n_tokens], mask),
        ];
        whole.run(inputs).map(drop)
    })?;
    let panoptic = median_ms(|| mask2former.segments(&picture).map(drop))?;
    println!(
        "parts: one rule {one:.0} ms, three {three:.0} ms, five {five:.0} ms: five / one = {:.2}",
        five / one
    );
    println!(
        "in one piece, three rules: {in_one_piece:.0} ms: parts / one piece = {:.2}",
        three / in_one_piece
    );
    println!("Mask2Former with its post-processing: {panoptic:.0} ms");
    Ok(())
}

fn median_ms(mut work: impl FnMut() -> anyhow::Result<()>) -> anyhow::Result<f64> {
    work()?;
    let clock = Clock::start();
    let mut all = Vec::with_capacity(N_RUNS);
    for _ in 0..N_RUNS {
        let since = clock.now();
        work()?;
        all.push(clock.now().since(since).as_secs_f64() * 1e3);
    }
    all.sort_by(f64::total_cmp);
    all.get(N_RUNS / 2).copied().context("no run")
}
