//! Many rollouts at once: a bound of what each keeps.
//!
//! Time outside, lanes inside: each loop over lanes is one that the compiler turns into vectors. Places are
//! counted in cells from the cell of the start, so that f32 is exact enough on any map. Sequences are sampled
//! here too, from an incumbent and the draws of the tick, and never stored. How a robot moves and what a margin
//! is worth is a [`Model`]'s business; the standard problem has the one there is.

use super::isa::{Work, fused};
use super::merge::Merged;
use super::packed::{RIDGE, unpacked};

mod lanes;
mod pass;

use pass::Pass;

/// Lanes of one pass.
const N: usize = 64;
/// Lanes are counted in whole vectors of so many.
const N_VECTOR: usize = 16;

/// Lanes with room for whole vectors.
pub(crate) fn padded(n_samples: usize) -> usize {
    n_samples.next_multiple_of(N_VECTOR)
}

/// How one robot moves, lane by lane and without branches. Every function must be `#[inline(always)]`.
pub(crate) trait Model: Copy {
    /// What one step does to a lane.
    fn step<const FUSED: bool>(&self, speed_m_s: f32, turn_rad: f32, gain_m_s: f32) -> Step;
    /// What the two margins at a place are worth at a speed, metres.
    fn worth_m(&self, clear_m: f32, slow_m: f32, speed_m_s: f32) -> f32;
}

/// One step of one lane.
pub(crate) struct Step {
    /// Cells moved, in the heading before the step.
    pub along: f32,
    /// Cosine and sine of the turn.
    pub turn_cos: f32,
    pub turn_sin: f32,
    /// Speed after the step.
    pub speed_m_s: f32,
    /// The most that the controls alone leave.
    pub bound_m: f32,
}

/// Where all lanes start; places in cells from the lower left corner of the start's cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct From {
    pub x: f32,
    pub y: f32,
    pub sin: f32,
    pub cos: f32,
    pub speed_m_s: f32,
    /// What is kept already, the place after the first step included: no control changes it.
    pub kept_m: f32,
    /// The two margins at that place, of which what the slow zone is worth is still to be judged.
    pub next_m: [f32; 2],
}

/// The grid of words under the lanes; the lower half of a word is the margin to what must be kept clear of, the
/// upper half that to the slow zone.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ground<'a> {
    /// As many as a power of two.
    pub words: &'a [u64],
    /// Column and row of the start's cell.
    pub first: [i32; 2],
    pub n_cols: i32,
    /// Places are held within these, in cells from the start's.
    pub low: [f32; 2],
    pub high: [f32; 2],
    /// The most that either margin changes over the length of a cell side, metres.
    pub slope_m: f32,
    /// Quanta of the two margins, and what they are counted from, metres.
    pub quantum_m: [f32; 2],
    pub lowest_m: [f32; 2],
    /// Who to ask where layers cross.
    pub ridges: Option<&'a Merged>,
}

impl Ground<'_> {
    /// What a word says of what must be kept clear of, marked or not, metres.
    #[inline(always)]
    fn clear_m<const FUSED: bool>(&self, word: u32, share_x: f32, share_y: f32) -> f32 {
        fused::<FUSED>(
            self.quantum_m[0],
            unpacked::<FUSED>(word & !RIDGE, share_x, share_y),
            self.lowest_m[0],
        )
    }

    /// What a word says of the slow zone, metres.
    #[inline(always)]
    fn slow_m<const FUSED: bool>(&self, word: u32, share_x: f32, share_y: f32) -> f32 {
        fused::<FUSED>(self.quantum_m[1], unpacked::<FUSED>(word, share_x, share_y), self.lowest_m[1])
    }
}

/// The sequences: clamp(incumbent + scale · draw), a step each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampled<'a> {
    /// Turn (radians) and gain (m/s) of each step.
    pub held: &'a [[f32; 2]],
    /// Draws of turns and of gains; `n_lanes` for each step, lane by lane.
    pub draws: [&'a [f32]; 2],
    pub n_lanes: usize,
    pub scale: [f32; 2],
    /// Largest turn (radians) and gain (m/s) of a step.
    pub limit: [f32; 2],
}

/// Rolls `n` lanes out; what each keeps goes to `kept_m`, to the rounding of f32 and of the words.
///
/// `FULL` finishes every rollout and reads the words at every step. Otherwise steps are skipped where the words
/// cannot matter, lanes that keep no more than `floor_m` are followed no further, and a pass ends as soon as only
/// a few keep more. What it returns is whether there were none: else the values above `floor_m` may be bounds
/// from above.
pub(crate) struct Sweep<'a, M: Model, const FULL: bool> {
    pub model: M,
    pub ground: Ground<'a>,
    pub from: From,
    pub sampled: Sampled<'a>,
    pub n: usize,
    /// Lanes of a vector.
    pub n_vector: usize,
    /// Lanes that are not to be followed, being known; theirs is negative infinity. None when `FULL`.
    pub known: [Option<usize>; 2],
    pub floor_m: f32,
    pub kept_m: &'a mut [f32],
}

impl<M: Model, const FULL: bool> Work for Sweep<'_, M, FULL> {
    type Output = bool;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> bool {
        let Sweep { model, ground, from, sampled, n: n_all, n_vector, known, floor_m, kept_m } = self;
        let mut is_complete = true;
        let Sampled { held, draws: [turn_draws, gain_draws], n_lanes, scale, limit } = sampled;
        for first in (0..n_all).step_by(N) {
            let n = (n_all - first).min(N);
            let mut pass = Pass::at(from, n.next_multiple_of(n_vector).min(N));
            if !FULL {
                pass.kept_m[n..].fill(f32::NEG_INFINITY);
                for lane in known.into_iter().flatten().filter(|lane| (first..first + n).contains(lane)) {
                    pass.kept_m[lane - first] = f32::NEG_INFINITY;
                }
            }
            for (step, held) in held.iter().enumerate() {
                let at = step * n_lanes + first;
                let draws = [&turn_draws[at..at + pass.n], &gain_draws[at..at + pass.n]];
                pass.advance::<M, FUSED>(model, draws, *held, scale, limit);
                if step == 0 {
                    pass.begin(model, from.next_m);
                    continue;
                }
                if !FULL {
                    let (n_alive, reads) = pass.room(ground.slope_m, floor_m);
                    if n_alive <= N_FEW {
                        is_complete &= n_alive == 0;
                        break;
                    }
                    if reads == 0 {
                        continue;
                    }
                }
                pass.place(&ground);
                pass.load(&ground, n);
                if pass.judge::<M, FUSED, FULL>(model, &ground, floor_m) != 0 {
                    pass.settle_ridges::<M, FUSED>(model, &ground, n);
                }
            }
            kept_m[first..first + n].copy_from_slice(&pass.kept_m[..n]);
        }
        is_complete
    }
}

/// So few lanes that matter are followed exactly in less time than a pass takes to its end.
const N_FEW: u32 = 3;

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

/// A word of two: what must be kept clear of, and the slow zone.
#[inline(always)]
pub(crate) fn paired(clear: u32, slow: u32) -> u64 {
    u64::from(clear) | (u64::from(slow) << 32)
}
