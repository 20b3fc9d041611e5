//! CARMEN logs: the laser lines of `FLASER` and `ROBOTLASER1`, checked.
//!
//! `FLASER` says neither field of view nor largest range. Its beams cover half a circle from −90°, as CARMEN
//! has it, unless the log's own scans close a full circle (the first beam and the last see the same), or the
//! caller says otherwise. Readings that repeat the log's largest value again and again are no returns.
//! A line that cannot be read is kept as what is wrong with it, so that line counts still agree.

use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::io::BufRead;

use anyhow::{Context, bail, ensure};
use geometry::Pose2;

/// Longest line, bytes.
const N_LINE_BYTES_MAX: usize = 1024 * 1024;
/// Most beams of a scan.
const N_BEAMS_MAX: usize = 20_000;
/// Most laser lines of a log: some 2 GB in memory.
const N_LASER_LINES_MAX: usize = 1_000_000;
/// Share of all readings that repeat the largest value, from which on that value means no return.
const PLATEAU_SHARE: f64 = 0.0005;
/// Readings within this share of the largest value repeat it.
const PLATEAU_WIDTH: f32 = 0.001;
/// A range that stands for a limit which the log does not give, metres.
const RANGE_MAX_M: f64 = 200.0;
/// First and last beam see the same when they differ by less than this share, ...
const CLOSED_SHARE: f32 = 0.1;
/// ... in more than this share of the scans.
const CLOSED_SCANS: f64 = 0.7;

/// One scan of a log.
#[derive(Clone, Debug, PartialEq)]
pub struct LaserScan {
    /// Its time, as written.
    pub stamp: String,
    /// Metres; NaN is no beam, anything beyond `range_max_m` is no return.
    pub ranges_m: Vec<f32>,
    /// Direction of the first beam, radians.
    pub angle_min_rad: f64,
    /// From one beam to the next, radians.
    pub angle_step_rad: f64,
    /// Farthest range that is a measurement, metres.
    pub range_max_m: f64,
    /// Pose of the laser that is stored with it: a reference, never an input; `None` when it is not finite.
    pub laser: Option<Pose2>,
    /// Pose of the robot that is stored with it: its odometry.
    pub odometry: Option<Pose2>,
}

/// A laser line.
#[derive(Clone, Debug, PartialEq)]
pub enum LaserLine {
    /// As it should be.
    Scan(LaserScan),
    /// As it should not be.
    Bad {
        /// Number of the line in the log, from 1.
        number: usize,
        /// What is wrong.
        reason: String,
    },
}

/// Reads all laser lines of a log. `fov_deg`, when given, is the field of view of `FLASER` lines.
///
/// # Errors
/// When the log cannot be read, is too long, or holds no laser line.
pub fn read(log: impl BufRead, fov_deg: Option<f64>) -> anyhow::Result<Vec<LaserLine>> {
    let mut lines = Vec::new();
    let mut is_flaser = Vec::new();
    for (idx, line) in log.split(b'\n').enumerate() {
        let line = line.with_context(|| format!("line {}", idx + 1))?;
        let kind = match () {
            () if line.starts_with(b"FLASER") => Kind::Flaser,
            () if line.starts_with(b"ROBOTLASER1") => Kind::RobotLaser,
            () => continue,
        };
        ensure!(lines.len() < N_LASER_LINES_MAX, "more than {N_LASER_LINES_MAX} laser lines");
        is_flaser.push(kind == Kind::Flaser);
        lines.push(match scan_of(&line, kind) {
            Ok(scan) => LaserLine::Scan(scan),
            Err(e) => LaserLine::Bad { number: idx + 1, reason: format!("{e:#}") },
        });
    }
    ensure!(!lines.is_empty(), "no line begins with FLASER or ROBOTLASER1");
    let (mut flasers, mut all): (Vec<&mut LaserScan>, Vec<&mut LaserScan>) = (Vec::new(), Vec::new());
    for (line, is_flaser) in lines.iter_mut().zip(is_flaser) {
        if let LaserLine::Scan(scan) = line {
            if is_flaser { flasers.push(scan) } else { all.push(scan) }
        }
    }
    lay_out_beams(&mut flasers, fov_deg);
    all.append(&mut flasers);
    cut_plateau(&mut all);
    Ok(lines)
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Flaser,
    RobotLaser,
}

/// Words of a line, taken one after the other.
struct Words<'a>(std::str::SplitAsciiWhitespace<'a>);

impl<'a> Words<'a> {
    fn word(&mut self, what: &str) -> anyhow::Result<&'a str> {
        self.0.next().with_context(|| format!("it ends before {what}"))
    }

    fn number(&mut self, what: &str) -> anyhow::Result<f64> {
        let word = self.word(what)?;
        word.parse().with_context(|| format!("{what} is {word:?}, no number"))
    }

    fn finite(&mut self, what: &str) -> anyhow::Result<f64> {
        let value = self.number(what)?;
        ensure!(value.is_finite(), "{what} is {value}");
        Ok(value)
    }

    fn count(&mut self, what: &str) -> anyhow::Result<usize> {
        let word = self.word(what)?;
        let n = word.parse().with_context(|| format!("{what} is {word:?}, no count"))?;
        ensure!(n <= N_BEAMS_MAX, "{what} is {n}, at most {N_BEAMS_MAX}");
        Ok(n)
    }

    fn pose(&mut self, what: &str) -> anyhow::Result<Option<Pose2>> {
        let (x_m, y_m, yaw_rad) = (self.number(what)?, self.number(what)?, self.number(what)?);
        let is_near = x_m.abs() < 1e6 && y_m.abs() < 1e6 && yaw_rad.abs() < 1e6;
        Ok(is_near.then(|| Pose2::new(x_m, y_m, yaw_rad)))
    }
}

fn scan_of(line: &[u8], kind: Kind) -> anyhow::Result<LaserScan> {
    ensure!(line.len() <= N_LINE_BYTES_MAX, "{} bytes, at most {N_LINE_BYTES_MAX}", line.len());
    let mut words = Words(std::str::from_utf8(line)?.split_ascii_whitespace());
    words.word("its name")?;
    let (mut angle_min_rad, mut angle_step_rad, mut range_max_m) = (-FRAC_PI_2, 0.0, RANGE_MAX_M);
    if kind == Kind::RobotLaser {
        words.number("laser_type")?;
        angle_min_rad = words.finite("start_angle")?;
        let fov_rad = words.finite("field_of_view")?;
        angle_step_rad = words.finite("angular_resolution")?;
        range_max_m = words.finite("maximum_range")?;
        words.number("accuracy")?;
        words.number("remission_mode")?;
        ensure!(
            angle_min_rad.abs() <= 2.0 * TAU && (0.0..=1.01 * TAU).contains(&fov_rad),
            "beams from {angle_min_rad} rad over {fov_rad} rad make no scan"
        );
        ensure!(range_max_m > 0.0, "maximum_range is {range_max_m}, must be above 0");
        range_max_m = range_max_m.min(RANGE_MAX_M);
        if angle_step_rad <= 0.0 || angle_step_rad > 1.0 {
            bail!("angular_resolution is {angle_step_rad} rad, must be 0 to 1");
        }
    }
    let n = words.count("num_readings")?;
    ensure!(n >= 2, "{n} beams make no scan");
    let ranges_m = (0..n).map(|_| Ok(words.number("a reading")? as f32)).collect::<anyhow::Result<_>>()?;
    if kind == Kind::RobotLaser {
        for _ in 0..words.count("num_remissions")? {
            words.word("a remission")?;
        }
    }
    let (laser, odometry) = (words.pose("its pose")?, words.pose("its odometry")?);
    if kind == Kind::RobotLaser {
        for what in ["tv", "rv", "forward_safety_dist", "side_safety_dist", "turn_axis"] {
            words.word(what)?;
        }
    }
    words.number("its stamp")?;
    Ok(LaserScan {
        stamp: stamp_of(line, kind, n)?,
        ranges_m,
        angle_min_rad,
        angle_step_rad,
        range_max_m,
        laser,
        odometry,
    })
}

/// The word with the stamp, as it is written.
fn stamp_of(line: &[u8], kind: Kind, n: usize) -> anyhow::Result<String> {
    let text = std::str::from_utf8(line)?;
    let mut words = text.split_ascii_whitespace();
    let at = match kind {
        Kind::Flaser => 2 + n + 6,
        Kind::RobotLaser => {
            let n_remissions: usize =
                words.clone().nth(9 + n).and_then(|w| w.parse().ok()).unwrap_or_default();
            9 + n + 1 + n_remissions + 6 + 5
        }
    };
    Ok(words.nth(at).unwrap_or_default().to_owned())
}

/// Gives `FLASER` scans their angles.
fn lay_out_beams(scans: &mut [&mut LaserScan], fov_deg: Option<f64>) {
    let mut closed: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    for scan in scans.iter() {
        let (Some(first), Some(last)) = (scan.ranges_m.first(), scan.ranges_m.last()) else { continue };
        let (n_closed, n_all) = closed.entry(scan.ranges_m.len()).or_default();
        *n_all += 1;
        *n_closed += usize::from((first - last).abs() <= CLOSED_SHARE * first.max(*last).max(0.1));
    }
    for scan in scans {
        let n = scan.ranges_m.len();
        let is_closed =
            closed.get(&n).is_some_and(|(n_closed, n_all)| *n_closed as f64 > CLOSED_SCANS * *n_all as f64);
        let fov_rad = fov_deg.map_or(if is_closed { TAU } else { PI }, f64::to_radians);
        // 181 or 361 beams reach both ends; of 180 or 360 the last is one step short.
        let n_steps = if n % 2 == 1 { n - 1 } else { n };
        scan.angle_min_rad = -fov_rad / 2.0;
        scan.angle_step_rad = fov_rad / n_steps as f64;
    }
}

/// Makes readings that repeat the largest value no returns.
fn cut_plateau(scans: &mut [&mut LaserScan]) {
    let finite = |scan: &LaserScan| scan.ranges_m.clone().into_iter().filter(|r| r.is_finite());
    let largest = scans.iter().flat_map(|scan| finite(scan)).fold(0.0, f32::max);
    let from = largest * (1.0 - PLATEAU_WIDTH);
    let (mut n_all, mut n_largest) = (0_usize, 0_usize);
    for range_m in scans.iter().flat_map(|scan| finite(scan)) {
        n_all += 1;
        n_largest += usize::from(range_m >= from);
    }
    let is_plateau = n_largest >= 3 && n_largest as f64 >= PLATEAU_SHARE * n_all as f64;
    for scan in scans {
        // A reading at the limit that the line gives is no return either.
        let given = scan.range_max_m * (1.0 - f64::from(PLATEAU_WIDTH));
        let seen = if is_plateau { f64::from(from) } else { f64::INFINITY };
        scan.range_max_m = given.min(seen).max(0.1);
    }
}

#[cfg(test)]
#[path = "carmen_tests.rs"]
mod tests;
