//! What is said of a log that was mapped.

use std::io::Write;

use geometry::Pose2;

use super::carmen::LaserLine;
use super::evaluation::{RelativeErrors, mean, quantile, root_mean_square};
use super::mapped::{Counts, Mapped};

/// At most so many bad lines are named one by one.
const N_NAMED_MAX: usize = 10;
/// What a map is expected to keep over a length of way: metres of way, metres, degrees.
const LIMITS: [(f64, f64, f64); 2] = [(1.0, 0.05, 1.0), (10.0, 0.15, 2.0)];

/// Says what became of the lines, how long scans took, and how far the found motion is off the log's own poses.
///
/// # Errors
/// When `out` refuses.
pub(super) fn tell(
    mapped: &Mapped,
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
    let Counts { n_bad, n_refused, n_uncertain, n_lost } = mapped.counts();
    let (n_mended, n_torn) = (n_lost - mapped.slam().n_torn().min(n_lost), mapped.slam().n_torn());
    writeln!(
        out,
        "laser lines: {}, malformed {n_bad}, refused {n_refused}, uncertain {n_uncertain}, lost {n_lost} times \
         ({n_mended} found again, {n_torn} not: there the map is torn), loops closed {}",
        lines.len(),
        mapped.slam().n_loops()
    )?;
    let n_not_drawn = mapped.slam().n_not_drawn();
    if n_not_drawn > 0 {
        writeln!(out, "scans not drawn: {n_not_drawn}, the map would have become too large")?;
    }
    let mut milliseconds = mapped.milliseconds().to_vec();
    milliseconds.sort_by(f64::total_cmp);
    let ms = |share| quantile(&milliseconds, share);
    writeln!(
        out,
        "ms per scan: median {:.3}, mean {:.3}, p90 {:.3}, p99 {:.3}, max {:.3}",
        ms(0.5),
        mean(&milliseconds),
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
    writeln!(out, "against the log's poses over {} m ({n} stretches):", errors.length_m)?;
    let (shift, turn) = (&errors.shift_m, &errors.turn_deg);
    for (name, share) in [("median", 0.5), ("p90", 0.9), ("p95", 0.95), ("max", 1.0)] {
        writeln!(out, "  {name} {:.3} m {:.2}°", quantile(shift, share), quantile(turn, share))?;
    }
    writeln!(out, "  mean {:.3} m {:.2}°", mean(shift), mean(turn))?;
    writeln!(out, "  root mean square {:.3} m {:.2}°", root_mean_square(shift), root_mean_square(turn))?;
    writeln!(out, "  within {limit_m} m and {limit_deg}°: {:.1} %", 100.0 * errors.share_within)?;
    Ok(())
}
