//! `heedway slam`: a recorded laser log through the mapping that the robot runs.
//!
//! Writes the map as PGM and YAML and where the laser was at each laser line, and says how long a scan took.
//! When the log holds poses they are compared with what was found, and are an input only as odometry and only
//! when asked for.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use geometry::Pose2;
use mapping::slam::Slam;

use carmen::LaserLine;
use mapped::Mapped;
use wheels::Drift;

mod carmen;
mod evaluation;
mod mapped;
mod report;
mod wheels;

/// Arguments of `heedway slam`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// A CARMEN log with FLASER or ROBOTLASER1 lines.
    #[arg(long, value_name = "LOG")]
    carmen: PathBuf,
    /// Where motion between scans is taken from.
    #[arg(long, value_enum)]
    odometry: Odometry,
    /// Writes PREFIX.pgm, PREFIX.yaml and PREFIX.trajectory.txt.
    #[arg(long, value_name = "PREFIX")]
    out: PathBuf,
    /// Field of view of FLASER lines, degrees, where the log's own scans do not tell.
    #[arg(long, value_name = "DEGREES")]
    fov: Option<f64>,
    /// Makes the log's odometry drift, to see what becomes of it: percent of the way, and degrees for each metre,
    /// as `5,2`.
    #[arg(long, value_name = "PERCENT,DEGREES", allow_hyphen_values = true)]
    drift: Option<Drift>,
}

/// Where motion between scans is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Odometry {
    /// The odometry in the log.
    Log,
    /// Nowhere: scans alone. No pose of the log is looked at.
    None,
}

/// Maps a log.
///
/// # Errors
/// When the log cannot be read or the results cannot be written.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    if arguments.fov.is_some_and(|fov| !(1.0..=360.0).contains(&fov)) {
        bail!("--fov is {:?} degrees, must be 1 to 360", arguments.fov);
    }
    if arguments.odometry == Odometry::None && arguments.drift.is_some() {
        bail!("--drift is of odometry, and --odometry none has none");
    }
    let shown = arguments.carmen.display().to_string();
    let log = BufReader::new(File::open(&arguments.carmen).with_context(|| shown.clone())?);
    let lines = carmen::read(log, arguments.fov).context(shown)?;
    let uses_odometry = arguments.odometry == Odometry::Log;
    let mut mapped = Mapped::new(uses_odometry, arguments.drift.unwrap_or_default())?;
    for line in &lines {
        mapped.take_in(line);
    }
    mapped.finish();
    let trajectory = mapped.trajectory();
    write_map(mapped.slam(), &arguments.out)?;
    write_trajectory(&lines, &trajectory, &arguments.out)?;
    report::tell(&mapped, &lines, &trajectory, &mut std::io::stdout().lock())?;
    Ok(ExitCode::SUCCESS)
}

fn with_ending(prefix: &Path, ending: &str) -> PathBuf {
    let mut name = prefix.as_os_str().to_owned();
    name.push(ending);
    PathBuf::from(name)
}

fn write_map(slam: &Slam, prefix: &Path) -> anyhow::Result<()> {
    let image = with_ending(prefix, ".pgm");
    let name = image.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    let (pgm, yaml) = mapping::map_file::encode(&slam.base_map().occupancy(), &name);
    std::fs::write(&image, pgm).with_context(|| image.display().to_string())?;
    let file = with_ending(prefix, ".yaml");
    std::fs::write(&file, yaml).with_context(|| file.display().to_string())
}

fn write_trajectory(lines: &[LaserLine], trajectory: &[Pose2], prefix: &Path) -> anyhow::Result<()> {
    let file = with_ending(prefix, ".trajectory.txt");
    let shown = || file.display().to_string();
    let mut out = BufWriter::new(File::create(&file).with_context(shown)?);
    let mut stamp = "0";
    for (line, pose) in lines.iter().zip(trajectory) {
        if let LaserLine::Scan(scan) = line {
            stamp = &scan.stamp;
        }
        writeln!(out, "{stamp} {:.6} {:.6} {:.6}", pose.x_m, pose.y_m, pose.yaw_rad).with_context(shown)?;
    }
    out.flush().with_context(shown)
}
