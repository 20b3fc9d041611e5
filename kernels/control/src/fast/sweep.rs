//! Many rollouts at once: a bound of what each keeps.
//!
//! Time outside, lanes inside: each loop over lanes is one that the compiler turns into vectors. Places are
//! counted in cells from the cell of the start, so that f32 is exact enough on any map. Sequences are sampled
//! here too, from an incumbent and the draws of the tick, and never stored. How a robot moves and what a margin
//! is worth is a [`Model`]'s business; the standard problem and the filter that drives each have one.

use super::isa::Work;
use super::lanes::{judge_lanes, near_lanes, place_lanes, room_lanes, step_lanes};
use super::merge::Merged;
use super::packed::RIDGE;

/// Lanes of one pass.
pub(super) const N: usize = 64;
/// Lanes are counted in whole vectors of so many.
pub(super) const N_VECTOR: usize = 16;
/// Lanes with room for whole vectors.
pub(crate) fn padded(n_samples: usize) -> usize {
    n_samples.next_multiple_of(N_VECTOR)
}

/// How one robot moves, lane by lane and without branches. Every function must be `#[inline(always)]`.
pub(crate) trait Model: Copy {
    /// Whether segments lose margin between their ends, and plans along their way; else only places count.
    const LOSES: bool;
    /// Whether the grid of words wraps around at 256 cells a side.
    const WRAPS: bool;
    /// What one step does to a lane.
    fn step<const FUSED: bool>(&self, speed_m_s: f32, turn_rad: f32, gain_m_s: f32) -> Step;
    /// The margins at a place in a cell, to what must be kept clear of and to the slow zone, of the halves of the
    /// cell's word; `quantum_m` is theirs.
    fn margins_m<const FUSED: bool>(
        &self,
        halves: (u32, u32),
        share: (f32, f32),
        quantum_m: [f32; 2],
    ) -> (f32, f32);
    /// What the two margins at a place are worth at a speed, metres.
    fn worth_m(&self, clear_m: f32, slow_m: f32, speed_m_s: f32) -> f32;
}

/// One step of one lane.
pub(crate) struct Step {
    /// Cells moved ahead, in the heading before the step.
    pub along: f32,
    /// Cells moved to the left of it.
    pub aside: f32,
    /// Cells of path.
    pub length: f32,
    /// Cosine and sine of the turn.
    pub turn_cos: f32,
    pub turn_sin: f32,
    /// Speed after the step.
    pub speed_m_s: f32,
    /// The most that the controls alone leave.
    pub bound_m: f32,
    /// What is lost on the segment, and what the tube grows by; both zero unless [`Model::LOSES`].
    pub loss_m: f32,
    pub growth_m: f32,
}

/// Where all lanes start; places in cells from the lower left corner of the start's cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct From {
    pub x: f32,
    pub y: f32,
    pub sin: f32,
    pub cos: f32,
    pub speed_m_s: f32,
    /// What is kept already, and the margin at the start.
    pub kept_m: f32,
    pub here_m: f32,
    pub tube_m: f32,
}

/// The grid of words under the lanes; what they mean is the model's business.
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
    /// Quanta of the words, metres.
    pub quantum_m: [f32; 2],
    /// Who to ask where layers cross.
    pub ridges: Option<&'a Merged>,
    /// Points to keep clear of, in cells from the lower left corner of the start's; only where segments lose.
    pub points: &'a [[f32; 2]],
    /// What the distance to them must exceed, and the side of a cell, metres.
    pub points_keep_m: f32,
    pub cell_m: f32,
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
    /// Steps of full straight braking after them, while a lane moves.
    pub n_tail: usize,
}

/// Rolls `n` lanes out; what each keeps goes to `kept_m`, to the rounding of f32 and of the words.
///
/// `FULL` finishes every rollout and reads the words at every step. Otherwise steps are skipped where the words
/// cannot matter, and a pass ends as soon as no lane keeps more than `floor_m`; its values then are bounds from
/// above that lie at or below `floor_m`.
pub(crate) struct Sweep<'a, M: Model, const FULL: bool> {
    pub model: M,
    pub ground: Ground<'a>,
    pub from: From,
    pub sampled: Sampled<'a>,
    pub n: usize,
    pub floor_m: f32,
    pub kept_m: &'a mut [f32],
}

impl<M: Model, const FULL: bool> Work for Sweep<'_, M, FULL> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Sweep { model, ground, from, sampled, n: n_all, floor_m, kept_m } = self;
        let Sampled { held, draws: [turn_draws, gain_draws], n_lanes, scale, limit, n_tail } = sampled;
        let n_steps = held.len();
        for first in (0..n_all).step_by(N) {
            let n = (n_all - first).min(N);
            let mut pass = Pass::at(from, n.next_multiple_of(N_VECTOR).min(N));
            for step in 0..n_steps + n_tail {
                let is_tail = step >= n_steps;
                let at = step.min(n_steps - 1) * n_lanes + first;
                let draws = [&turn_draws[at..at + pass.n], &gain_draws[at..at + pass.n]];
                let (held, scale) = if is_tail { ([0.0, -limit[1]], [0.0; 2]) } else { (held[step], scale) };
                pass.advance::<M, FUSED>(model, &ground, draws, held, scale, limit);
                if FULL {
                    pass.load(&ground, n);
                    if pass.judge::<M, FUSED>(model, &ground) != 0 {
                        pass.settle_ridges::<M>(model, &ground, n);
                    }
                    continue;
                }
                let state = pass.room::<M>(ground.slope_m, floor_m);
                if state & ALIVE == 0 || (is_tail && state & MOVING == 0) {
                    break;
                }
                if state & READS == 0 {
                    pass.here_m = [f32::INFINITY; N];
                    continue;
                }
                pass.load(&ground, n);
                if pass.judge::<M, FUSED>(model, &ground) != 0 {
                    pass.settle_ridges::<M>(model, &ground, n);
                }
            }
            kept_m[first..first + n].copy_from_slice(&pass.kept_m[..n]);
        }
    }
}

/// Some lane still keeps more than the floor.
pub(super) const ALIVE: u32 = 1;
/// Some such lane may be lowered by what the words say here.
pub(super) const READS: u32 = 2;
/// Some such lane moves.
pub(super) const MOVING: u32 = 4;

/// The lanes of one pass.
struct Pass {
    n: usize,
    x: [f32; N],
    y: [f32; N],
    sin: [f32; N],
    cos: [f32; N],
    speed_m_s: [f32; N],
    kept_m: [f32; N],
    /// The margin at the last place.
    here_m: [f32; N],
    tube_m: [f32; N],
    /// What the controls of this step leave, and what is lost on it.
    bound_m: [f32; N],
    lost_m: [f32; N],
    /// Cells moved in this step.
    moved: [f32; N],
    /// Neither margin can be below this, metres.
    room_m: [f32; N],
    share_x: [f32; N],
    share_y: [f32; N],
    cell_idx: [i32; N],
    /// The margin to the points.
    near_m: [f32; N],
    clear: [u32; N],
    slow: [u32; N],
    ridge: [u32; N],
}

impl Pass {
    #[inline(always)]
    fn at(from: From, n: usize) -> Pass {
        Pass {
            n,
            x: [from.x; N],
            y: [from.y; N],
            sin: [from.sin; N],
            cos: [from.cos; N],
            speed_m_s: [from.speed_m_s; N],
            kept_m: [from.kept_m; N],
            here_m: [from.here_m; N],
            tube_m: [from.tube_m; N],
            bound_m: [f32::INFINITY; N],
            lost_m: [0.0; N],
            moved: [0.0; N],
            room_m: [f32::NEG_INFINITY; N],
            share_x: [0.0; N],
            share_y: [0.0; N],
            cell_idx: [0; N],
            near_m: [f32::INFINITY; N],
            clear: [0; N],
            slow: [0; N],
            ridge: [0; N],
        }
    }

    /// One step of every lane, and where each is then.
    #[inline(always)]
    fn advance<M: Model, const FUSED: bool>(
        &mut self,
        model: M,
        ground: &Ground<'_>,
        draws: [&[f32]; 2],
        held: [f32; 2],
        scale: [f32; 2],
        limit: [f32; 2],
    ) {
        let n = self.n.min(N);
        step_lanes::<M, FUSED>(
            n,
            model,
            (draws, held, scale, limit),
            &mut self.x,
            &mut self.y,
            &mut self.sin,
            &mut self.cos,
            &mut self.speed_m_s,
            &mut self.bound_m,
            &mut self.lost_m,
            &mut self.tube_m,
            &mut self.moved,
        );
        place_lanes::<M>(
            n,
            ground,
            &mut self.share_x,
            &mut self.share_y,
            &mut self.cell_idx,
            &self.x,
            &self.y,
        );
    }

    /// Lowers what lanes keep to what their controls leave; what is to be done about the rest.
    #[inline(always)]
    fn room<M: Model>(&mut self, slope_m: f32, floor_m: f32) -> u32 {
        room_lanes::<M>(
            self.n.min(N),
            &mut self.room_m,
            &mut self.kept_m,
            &self.moved,
            &self.bound_m,
            &self.lost_m,
            slope_m,
            floor_m,
        )
    }

    /// Loads the words of every lane's cell.
    #[inline(always)]
    fn load(&mut self, ground: &Ground<'_>, n: usize) {
        let words = ground.words;
        let last = words.len() - 1;
        for lane in 0..n.min(N) {
            // Nothing is read beyond the grid, whatever is not a number.
            let word = words[self.cell_idx[lane] as usize & last];
            self.clear[lane] = word as u32;
            self.slow[lane] = (word >> 32) as u32;
        }
    }

    /// Lowers what lanes keep by the margins at their places; not 0 when some lie on a ridge that matters.
    #[inline(always)]
    fn judge<M: Model, const FUSED: bool>(&mut self, model: M, ground: &Ground<'_>) -> u32 {
        if M::LOSES && !ground.points.is_empty() {
            near_lanes::<FUSED>(self.n.min(N), ground, &mut self.near_m, &self.x, &self.y);
        }
        judge_lanes::<M, FUSED>(
            self.n.min(N),
            model,
            &mut self.kept_m,
            &mut self.here_m,
            &mut self.room_m,
            &mut self.ridge,
            &self.bound_m,
            &self.lost_m,
            &self.near_m,
            (&self.clear, &self.slow),
            &self.share_x,
            &self.share_y,
            &self.speed_m_s,
            ground.quantum_m,
        )
    }

    /// Where layers cross, the word is a lower bound only: those lanes ask the layers.
    #[inline(never)]
    fn settle_ridges<M: Model>(&mut self, model: M, ground: &Ground<'_>, n: usize) {
        let Some(ridges) = ground.ridges else { return };
        for lane in (0..n.min(N)).filter(|lane| self.ridge[*lane] != 0) {
            let (x, y) = (self.share_x[lane], self.share_y[lane]);
            let clear_m = ridges.ridge_m(self.cell_idx[lane] as usize, (x, y));
            let halves = (self.clear[lane], self.slow[lane]);
            let (_, slow_m) = model.margins_m::<false>(halves, (x, y), ground.quantum_m);
            let worth_m = model.worth_m(clear_m, slow_m, self.speed_m_s[lane]);
            self.kept_m[lane] = least(self.kept_m[lane], worth_m);
        }
    }
}

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
    u64::from(clear) | (u64::from(slow & !RIDGE) << 32)
}
