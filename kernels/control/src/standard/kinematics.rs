//! The sampled controls of a round, and what they alone say of their rollouts.

use super::*;
use crate::fast::isa::Work;

/// Lanes are counted in whole vectors of sixteen.
pub(crate) fn padded(n_samples: usize) -> usize {
    n_samples.next_multiple_of(16)
}

/// Turns (radians) and gains of speed (m/s) a step; `n_lanes` for each step, lane by lane.
#[derive(Debug, Default)]
pub(crate) struct Lanes {
    pub n_lanes: usize,
    pub turn_rad: Vec<f32>,
    pub gain_m_s: Vec<f32>,
}

impl Lanes {
    /// Room for sequences.
    pub(crate) fn resize(&mut self, n_lanes: usize, n_steps: usize) {
        self.n_lanes = n_lanes;
        self.turn_rad.resize(n_lanes * n_steps, 0.0);
        self.gain_m_s.resize(n_lanes * n_steps, 0.0);
    }
}

/// Perturbs an incumbent by the noise: `controls` = clamp(incumbent + noise), and the largest margin that each
/// lane's speeds and turn rates leave it, into `bounds`.
pub(crate) struct Perturb<'a> {
    /// Turn (rad) and gain (m/s) of each step.
    pub incumbent: &'a [[f32; 2]],
    pub speed_m_s: f32,
    /// Noise, scaled to turns and gains.
    pub noise: &'a Lanes,
    pub controls: &'a mut Lanes,
    pub bounds: &'a mut [f32],
    /// Speeds, one a lane: scratch.
    pub speeds: &'a mut [f32],
}

impl Work for Perturb<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Perturb { incumbent, speed_m_s, noise, controls, bounds, speeds } = self;
        let n = noise.n_lanes;
        let (bounds, speeds) = (&mut bounds[..n], &mut speeds[..n]);
        bounds.fill(f32::INFINITY);
        speeds.fill(speed_m_s);
        for (step, [turn, gain]) in incumbent.iter().enumerate() {
            let range = step * n..(step + 1) * n;
            let (turn_noise, gain_noise) = (&noise.turn_rad[range.clone()], &noise.gain_m_s[range.clone()]);
            let (turns, gains) = (&mut controls.turn_rad[range.clone()], &mut controls.gain_m_s[range]);
            perturb_step((*turn, *gain), (turn_noise, gain_noise), (turns, gains), bounds, speeds);
        }
    }
}

#[inline(always)]
fn perturb_step(
    (turn, gain): (f32, f32),
    (turn_noise, gain_noise): (&[f32], &[f32]),
    (turns, gains): (&mut [f32], &mut [f32]),
    bounds: &mut [f32],
    speeds: &mut [f32],
) {
    let n = bounds.len();
    let (turn_noise, gain_noise, speeds) = (&turn_noise[..n], &gain_noise[..n], &mut speeds[..n]);
    let (turns, gains) = (&mut turns[..n], &mut gains[..n]);
    for lane in 0..n {
        let turned = clamped(turn + turn_noise[lane], TURN_MAX);
        let gained = clamped(gain + gain_noise[lane], GAIN_MAX);
        turns[lane] = turned;
        gains[lane] = gained;
        let speed = speed_after(speeds[lane], gained);
        speeds[lane] = speed;
        bounds[lane] = least(bounds[lane], kinematic_margin(speed, turned));
    }
}

/// Largest turn in a step, radians.
pub(crate) const TURN_MAX: f32 = (YAW_RATE_RAD_S_MAX * STEP_S) as f32;
/// Largest gain of speed in a step, m/s.
pub(crate) const GAIN_MAX: f32 = (ACCEL_M_S2_MAX * STEP_S) as f32;

// As comparisons, not `f32::min`: one instruction each where NaN is not asked about.

/// The smaller of two.
#[inline(always)]
pub(crate) fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger of two.
#[inline(always)]
pub(crate) fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn clamped(value: f32, limit: f32) -> f32 {
    most(least(value, limit), -limit)
}

/// The speed after a gain.
#[inline(always)]
pub(crate) fn speed_after(speed_m_s: f32, gain_m_s: f32) -> f32 {
    most(least(speed_m_s + gain_m_s, SPEED_M_S_MAX as f32), 0.0)
}

/// The margin that a speed and a turn in a step leave to the limits everywhere.
#[inline(always)]
pub(crate) fn kinematic_margin(speed_m_s: f32, turn_rad: f32) -> f32 {
    least(
        SPEED_M_S_LIMIT as f32 - speed_m_s,
        YAW_RATE_RAD_S_LIMIT as f32 - turn_rad.abs() * (1.0 / STEP_S) as f32,
    )
}
