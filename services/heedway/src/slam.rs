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
use mapping::base_map::Scan;
use mapping::slam::{Anchor, Slam, SlamConfig, Standing};

use carmen::{LaserLine, LaserScan};
use evaluation::{RelativeErrors, quantile};

mod carmen;
mod evaluation;

/// Nearer readings are of the robot itself or of nothing, metres.
const RANGE_MIN_M: f64 = 0.05;
/// At most so many bad lines are named one by one.
const N_NAMED_MAX: usize = 10;
/// Without odometry so many scans in a row that do not fit mean that nothing ties what follows to what was.
const N_MISSES_MAX: u32 = 3;
/// Odometry cannot be right beyond this between two scans, metres: the log was cut or reset.
const LEAP_MAX_M: f64 = 20.0;
/// What a map is expected to keep over a length of way: metres of way, metres, degrees.
const LIMITS: [(f64, f64, f64); 2] = [(1.0, 0.05, 1.0), (10.0, 0.15, 2.0)];

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
    let shown = arguments.carmen.display().to_string();
    let log = BufReader::new(File::open(&arguments.carmen).with_context(|| shown.clone())?);
    let lines = carmen::read(log, arguments.fov).context(shown)?;
    let mut mapped = Mapped::new()?;
    for line in &lines {
        mapped.take_in(line, arguments.odometry);
    }
    mapped.slam.finish()?;
    let trajectory = mapped.trajectory();
    write_map(&mapped.slam, &arguments.out)?;
    write_trajectory(&lines, &trajectory, &arguments.out)?;
    mapped.tell(&lines, &trajectory, &mut std::io::stdout().lock())?;
    Ok(ExitCode::SUCCESS)
}

/// A log on its way through the map.
struct Mapped {
    clock: service::Clock,
    slam: Slam,
    /// Of each laser line; a bad one is where the one before it was.
    anchors: Vec<Option<Anchor>>,
    milliseconds: Vec<f64>,
    last_odometry: Option<Pose2>,
    base_from_laser: Option<Pose2>,
    n_uncertain: usize,
    n_misses: u32,
    n_lost: usize,
    n_bad: usize,
    n_refused: usize,
}

impl Mapped {
    fn new() -> anyhow::Result<Self> {
        Ok(Mapped {
            clock: service::Clock::start(),
            slam: Slam::new(SlamConfig::default(), Pose2::IDENTITY)?,
            anchors: Vec::new(),
            milliseconds: Vec::new(),
            last_odometry: None,
            base_from_laser: None,
            n_uncertain: 0,
            n_misses: 0,
            n_lost: 0,
            n_bad: 0,
            n_refused: 0,
        })
    }

    fn take_in(&mut self, line: &LaserLine, odometry: Odometry) {
        let last_anchor = self.anchors.last().copied().flatten();
        let LaserLine::Scan(scan) = line else {
            self.n_bad += 1;
            self.anchors.push(last_anchor);
            return;
        };
        let last_from_now = match odometry {
            Odometry::Log => self.odometry_since_last(scan),
            Odometry::None => None,
        };
        let begun = self.clock.now();
        let done = self.slam.step(&borrowed(scan), last_from_now);
        self.milliseconds.push(self.clock.now().since(begun).as_secs_f64() * 1e3);
        match done {
            Ok(located) => {
                self.n_uncertain += usize::from(located.standing == Standing::Uncertain);
                self.anchors.push(Some(located.anchor));
                self.n_misses = if located.standing == Standing::Good { 0 } else { self.n_misses + 1 };
                let is_guess = last_from_now.is_none() && self.n_misses >= N_MISSES_MAX;
                if located.standing == Standing::Lost || is_guess {
                    self.n_lost += 1;
                    self.n_misses = 0;
                    // Nobody is there to drive it back: what follows is mapped on its own.
                    self.slam.begin_anew();
                }
            }
            Err(_) => {
                self.n_refused += 1;
                self.anchors.push(last_anchor);
            }
        }
    }

    /// How the laser moved by the log's odometry, told from where it sits on the robot.
    fn odometry_since_last(&mut self, scan: &LaserScan) -> Option<Pose2> {
        let odometry = scan.odometry?;
        let base_from_laser = *self.base_from_laser.get_or_insert_with(|| mount_of(scan));
        let now = odometry * base_from_laser;
        let before = self.last_odometry.replace(now)?;
        let last_from_now = before.inverse() * now;
        (last_from_now.position().coords.norm() <= LEAP_MAX_M).then_some(last_from_now)
    }

    fn trajectory(&self) -> Vec<Pose2> {
        self.anchors.iter().map(|anchor| anchor.map_or(Pose2::IDENTITY, |a| self.slam.pose(&a))).collect()
    }

    fn tell(
        &mut self,
        lines: &[LaserLine],
        trajectory: &[Pose2],
        out: &mut impl Write,
    ) -> anyhow::Result<()> {
        let bad = lines.iter().filter_map(|line| match line {
            LaserLine::Bad { number, reason } => Some((number, reason)),
            LaserLine::Scan(_) => None,
        });
        for (number, reason) in bad.take(N_NAMED_MAX) {
            writeln!(out, "line {number} left out: {reason}")?;
        }
        let Mapped { n_bad, n_refused, n_uncertain, n_lost, .. } = self;
        writeln!(
            out,
            "laser lines: {}, malformed {n_bad}, refused {n_refused}, uncertain {n_uncertain}, lost {n_lost} times, \
             loops closed {}",
            lines.len(),
            self.slam.n_loops()
        )?;
        self.milliseconds.sort_by(f64::total_cmp);
        let ms = |share| quantile(&self.milliseconds, share);
        writeln!(
            out,
            "ms per scan: median {:.3}, p90 {:.3}, p99 {:.3}, max {:.3}",
            ms(0.5),
            ms(0.9),
            ms(0.99),
            ms(1.0)
        )?;
        let reference: Vec<Option<Pose2>> = lines
            .iter()
            .map(|line| match line {
                LaserLine::Scan(scan) => scan.laser,
                LaserLine::Bad { .. } => None,
            })
            .collect();
        let found: Vec<Option<Pose2>> = trajectory.iter().copied().map(Some).collect();
        for (length_m, shift_m, turn_deg) in LIMITS {
            let errors = RelativeErrors::of(&found, &reference, length_m, (shift_m, turn_deg));
            tell_errors(&errors, (shift_m, turn_deg), out)?;
        }
        Ok(())
    }
}

/// Says how far the found motion is off the log's own poses.
fn tell_errors(
    errors: &RelativeErrors,
    (limit_m, limit_deg): (f64, f64),
    out: &mut impl Write,
) -> anyhow::Result<()> {
    let n = errors.shift_m.len();
    if n == 0 {
        writeln!(out, "against the log's poses over {} m: no such way in the log", errors.length_m)?;
        return Ok(());
    }
    let (shift, turn) = (|q| quantile(&errors.shift_m, q), |q| quantile(&errors.turn_deg, q));
    writeln!(
        out,
        "against the log's poses over {} m ({n} stretches): median {:.3} m {:.2}°, p75 {:.3} m {:.2}°, p90 {:.3} m \
         {:.2}°, max {:.3} m {:.2}°; within {limit_m} m and {limit_deg}°: {:.1} %",
        errors.length_m,
        shift(0.5),
        turn(0.5),
        shift(0.75),
        turn(0.75),
        shift(0.9),
        turn(0.9),
        shift(1.0),
        turn(1.0),
        100.0 * errors.share_within
    )?;
    Ok(())
}

/// Where the laser sits on the robot, by the two poses of a line. A corrected log holds corrected and raw poses
/// that lie far apart: then it is not told, and taken to sit in the middle.
fn mount_of(scan: &LaserScan) -> Pose2 {
    let both = scan.laser.zip(scan.odometry).map(|(laser, robot)| robot.inverse() * laser);
    let near = |mount: &Pose2| mount.position().coords.norm() < 0.6 && mount.yaw_rad.abs() < 1e-3;
    both.filter(near).unwrap_or(Pose2::IDENTITY)
}

fn borrowed(scan: &LaserScan) -> Scan<'_> {
    Scan {
        ranges_m: &scan.ranges_m,
        angle_min_rad: scan.angle_min_rad,
        angle_increment_rad: scan.angle_step_rad,
        range_min_m: RANGE_MIN_M,
        range_max_m: scan.range_max_m,
        no_return_is_free: false,
    }
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
