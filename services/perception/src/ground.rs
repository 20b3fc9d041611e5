//! Recorded RGB-D through semantics, and what it found as files: overlays, occupancy, a summary.
//!
//! For looking at what a robot would make of a room, and for tests on real images. The way of a frame is that
//! of the robot ([`crate::semantics`]); only poses come from the recording instead of localisation, and *up*
//! from the floor in view, or from the caller. Not here: parsing words, opening models.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use geometry::Profile;
use rules::Rule;
use service::Clock;

use crate::recording::Recording;
use crate::semantics::Settings;
use crate::semantics::frame::Frame;
use crate::semantics::models::Answer;
use crate::semantics::regions::phrases;
use crate::semantics::replay::{Looked, Replay};

pub mod occupancy_file;
pub mod overlay;
pub mod placing;
pub mod summary;

use placing::{Place, Placed};
use summary::{FrameSummary, RuleSummary, Summary};

/// A recording of fewer frames than this shows most things once or twice: one mask is then enough.
pub const N_FRAMES_FEW: usize = 10;
/// Between two frames, by the clock that semantics is given, nanoseconds.
const STEP_NS: u64 = 1_000_000_000;

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Options {
    /// Folder of the recording.
    pub rgbd: PathBuf,
    /// Folder that files are written to; made when it is not there.
    pub out: PathBuf,
    /// What is looked for.
    pub rules: Vec<Rule>,
    /// Where things fall, in the recording's world; the floor in view tells when absent.
    pub gravity: Option<[f64; 3]>,
    /// The robot: its height tells what is beneath.
    pub profile: Profile,
    /// How semantics works.
    pub settings: Settings,
    /// Most frames that are looked at, evenly over the recording.
    pub n_frames_max: usize,
}

/// Runs a recording through semantics and writes what was found.
///
/// # Errors
/// When the recording cannot be read at all, no floor can be found, or a file cannot be written. A frame that
/// cannot be used is left out and named in the summary.
pub fn run<M>(options: &Options, models: M) -> anyhow::Result<Summary>
where
    M: Fn(&Frame, &[String]) -> anyhow::Result<Answer>,
{
    ensure!(options.n_frames_max > 0, "most frames is 0, must be at least 1");
    let recording = Recording::open(&options.rgbd, None)?;
    let place = Place::of(&recording, options)?;
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let rules: Vec<Rule> = options.rules.iter().map(anchored).collect();
    let mut replay = Replay::new(&options.settings, &options.profile, rules.clone(), models)?;
    let mut frames = Vec::new();
    for (idx, placed) in (0_u64..).zip(&place.frames) {
        frames.push(look(&recording, options, &place, placed, (idx + 1) * STEP_NS, &mut replay));
    }
    let told = replay.told();
    let mut found = Vec::new();
    for rule in &rules {
        found.push(RuleSummary::of(rule, told.get(&rule.id), &options.out)?);
    }
    let summary = Summary::new(options, &place, frames, found);
    overlay::draw_all(&recording, options, &place, &summary, told)?;
    let file = options.out.join("summary.json");
    let text = serde_json::to_string_pretty(&summary)?;
    std::fs::write(&file, text).with_context(|| file.display().to_string())?;
    Ok(summary)
}

/// A rule that needs to know where the robot stood when it was said was said where the first frame was taken,
/// which is where `map` begins.
fn anchored(rule: &Rule) -> Rule {
    let anchor = rule.anchor.or_else(|| rule.relation.needs_anchor().then_some([0.0; 3]));
    Rule { anchor, ..rule.clone() }
}

/// Shows semantics one frame and draws what it found there.
fn look<M>(
    recording: &Recording,
    options: &Options,
    place: &Place,
    placed: &Placed,
    stamp_ns: u64,
    replay: &mut Replay<M>,
) -> FrameSummary
where
    M: Fn(&Frame, &[String]) -> anyhow::Result<Answer>,
{
    let mut summary = FrameSummary { number: placed.number, ..FrameSummary::default() };
    let shown = placed.world_from_camera.as_ref().map_err(Clone::clone).and_then(|world_from_camera| {
        let (depth_mm, rgb) = recording.read_images(placed.number).map_err(|e| format!("{e:#}"))?;
        let map_from_camera = place.map_from_world * world_from_camera;
        let (odom_from_base, base_from_camera) = placing::base_of(&map_from_camera);
        Ok(Frame {
            seq: u64::from(placed.number) + 1,
            stamp_ns,
            intrinsics: *recording.intrinsics(),
            rgb,
            depth_mm,
            odom_from_base,
            odometry_run: 0,
            base_from_camera: Some(base_from_camera),
        })
    });
    let frame = match shown {
        Ok(frame) => frame,
        Err(reason) => {
            summary.left_out = Some(reason);
            return summary;
        }
    };
    let rgb = frame.rgb.clone();
    let clock = Clock::start();
    let since = clock.now();
    let Looked { found, trouble } = replay.show(frame);
    summary.ms = clock.now().since(since).as_secs_f64() * 1e3;
    if !trouble.is_empty() {
        summary.trouble = Some(trouble);
    }
    for rule in &options.rules {
        for phrase in phrases(rule) {
            let mask = found.iter().find(|f| f.phrase == phrase).and_then(|f| f.mask.as_ref());
            summary.pixels.insert(phrase.to_owned(), mask.map_or(0, |mask| mask.mask.n_set()));
        }
    }
    summary.overlay = overlay::write_masks(recording, options, placed.number, &rgb, &found).map_or_else(
        |e| {
            summary.trouble = Some(format!("{e:#}"));
            None
        },
        Some,
    );
    summary
}

/// The file of one frame's overlay.
#[must_use]
pub fn overlay_file(out: &Path, number: u32) -> PathBuf {
    out.join(format!("frame-{number:06}.overlay.png"))
}
