//! How a robot of the standard problem moves, and what its margins are worth: for the sweep.

use super::*;
use crate::fast::isa::fused;
use crate::fast::sweep::{Model, Step, least, most};

/// What f32 may add to or take from a margin along a rollout, metres: measured below 2e-6, taken twentyfold.
pub(crate) const ROUNDING_M: f32 = 4e-5;
/// Cells that a metre a second moves in a step.
const CELLS_PER_SPEED: f32 = (STEP_S / CELL_M) as f32;
/// Largest turn in a step, radians.
pub(crate) const TURN_MAX: f32 = (YAW_RATE_RAD_S_MAX * STEP_S) as f32;
/// Largest gain of speed in a step, m/s.
pub(crate) const GAIN_MAX: f32 = (ACCEL_M_S2_MAX * STEP_S) as f32;

/// Euler's step, and margins that mix metres with m/s.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Euler;

impl Model for Euler {
    #[inline(always)]
    fn step<const FUSED: bool>(&self, speed_m_s: f32, turn_rad: f32, gain_m_s: f32) -> Step {
        let cells = speed_m_s * CELLS_PER_SPEED;
        let square = turn_rad * turn_rad;
        let speed_m_s = most(least(speed_m_s + gain_m_s, SPEED_M_S_MAX as f32), 0.0);
        Step {
            along: cells,
            // Taylor; a step turns by 0.05 rad at most: error below 1e-10.
            turn_cos: fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 24.0, -0.5), 1.0),
            turn_sin: turn_rad * fused::<FUSED>(square, fused::<FUSED>(square, 1.0 / 120.0, -1.0 / 6.0), 1.0),
            speed_m_s,
            bound_m: least(
                SPEED_M_S_LIMIT as f32 - speed_m_s,
                YAW_RATE_RAD_S_LIMIT as f32 - turn_rad.abs() * (1.0 / STEP_S) as f32,
            ),
        }
    }

    #[inline(always)]
    fn worth_m(&self, clear_m: f32, slow_m: f32, speed_m_s: f32) -> f32 {
        least(clear_m, most(slow_m, SLOW_SPEED_M_S as f32 - speed_m_s))
    }
}
