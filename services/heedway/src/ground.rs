//! `heedway ground`: recorded RGB-D and rules to overlays, occupancy and a summary, without a robot.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::ensure;
use clap::Args;
use geometry::Profile;
use heedway_perception::ground::{self, N_FRAMES_FEW};
use heedway_perception::recording::Recording;
use heedway_perception::semantics::Settings;
use heedway_perception::semantics::models::folder;

use crate::rules_file;

/// Arguments of `heedway ground`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Folder of the recording: `frame-NNNNNN.color.jpg`, `.depth.png`, `.pose.txt` and
    /// `camera-intrinsics.txt`; or `color_N.png`, `depth_N.pgm` and `pose.txt`.
    #[arg(long, value_name = "DIR")]
    rgbd: PathBuf,
    /// The rules: sentences, one a line; or rules as JSON, an array or one a line.
    #[arg(long, value_name = "FILE")]
    rules: PathBuf,
    /// Folder of the models: a YOLO segmentation and what goes with it, or an export of CLIPSeg and Mask2Former
    /// with its manifest. ONNX Runtime may lie there too.
    #[arg(long, value_name = "DIR")]
    models: PathBuf,
    /// Folder for what is found; made when it is not there.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Where things fall, in the recording's world; without it, the floor in view tells.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction)]
    gravity: Option<Direction>,
    /// The robot's profile; its height tells what is beneath. Without it, a TurtleBot 2.
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,
    /// Most frames that are looked at, evenly over the recording.
    #[arg(long, default_value_t = 40)]
    frames: usize,
    /// In so many frames an object must be seen where it is; without it, 1 when the recording has fewer than
    /// ten frames, else 2.
    #[arg(long)]
    agreeing: Option<u32>,
}

/// A direction as it is written on the command line.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Direction([f64; 3]);

fn direction(text: &str) -> Result<Direction, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|word| word.trim().parse::<f64>()).collect();
    let numbers: Option<[f64; 3]> = numbers.ok().and_then(|n| n.try_into().ok());
    numbers.map(Direction).ok_or_else(|| format!("{text:?} must be three numbers, as in 0,0,-1"))
}

/// Grounds the rules and prints a line for each.
///
/// # Errors
/// When an input cannot be read, the models cannot be opened, or no floor is in view.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let profile = match &arguments.profile {
        Some(file) => service::config::load_profile(file)?,
        None => Profile::turtlebot2(),
    };
    let read = rules_file::read(&arguments.rules, &profile)?;
    for (words, reason) in &read.refused {
        eprintln!("not a rule: {words:?}: {reason}");
    }
    ensure!(!read.rules.is_empty(), "{}: no rule is in it", arguments.rules.display());
    let n_frames = Recording::open(&arguments.rgbd, None)?.numbers().len().min(arguments.frames);
    let agreeing = arguments.agreeing.unwrap_or(if n_frames < N_FRAMES_FEW { 1 } else { 2 });
    let settings = Settings { n_masks_agreeing: agreeing, ..Settings::default() };
    service::Settings::check(&settings, &profile).map_err(|e| anyhow::anyhow!("{e}"))?;
    let options = ground::Options {
        rgbd: arguments.rgbd.clone(),
        out: arguments.out.clone(),
        rules: read.rules,
        gravity: arguments.gravity.map(|direction| direction.0),
        profile,
        settings,
        n_frames_max: arguments.frames,
    };
    let models = folder::open(&arguments.models)?;
    let summary = ground::run(&options, |frame, phrases| models.answer_now(frame, phrases))?;
    for frame in &summary.frames {
        if let Some(reason) = frame.left_out.as_ref().or(frame.trouble.as_ref()) {
            eprintln!("frame {}: {reason}", frame.number);
        }
    }
    for found in &summary.rules {
        let phrase = found.rule.phrase();
        let (n_parts, area_m2) = found.region.as_ref().map_or((0, 0.0), |r| (r.parts.len(), r.area_m2));
        let name = serde_json::to_value(found.grounding)?;
        let name = name.as_str().unwrap_or_default();
        say(&format!(
            "{} {phrase:?}: {name}, {n_parts} parts, {area_m2:.2} m²; {}",
            found.rule.id, found.remark
        ));
    }
    say(&format!("written to {}", arguments.out.display()));
    Ok(ExitCode::SUCCESS)
}

/// Output is this command's purpose.
#[allow(clippy::print_stdout, reason = "the command's result goes to standard output")]
fn say(line: &str) {
    println!("{}", line.trim_end_matches([' ', ';']));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_is_three_numbers() {
        assert_eq!(direction("0,-1, 0.5"), Ok(Direction([0.0, -1.0, 0.5])));
        for odd in ["", "1,2", "1,2,3,4", "down", "1,2,x"] {
            assert!(direction(odd).is_err_and(|words| words.contains("three numbers")), "{odd}");
        }
    }
}
