//! The lanes of one pass, and what is done to all of them in a step.
//!
//! Not here: the loops themselves (`lanes`), in which order they run and when a pass ends (`sweep`).

use super::lanes::{begin_lanes, judge_lanes, place_lanes, room_lanes, settle_lanes, step_lanes};
use super::{From, Ground, Model, N, least};

/// The lanes of one pass.
pub(super) struct Pass {
    pub n: usize,
    x: [f32; N],
    y: [f32; N],
    sin: [f32; N],
    cos: [f32; N],
    speed_m_s: [f32; N],
    pub kept_m: [f32; N],
    /// What the controls of this step leave.
    bound_m: [f32; N],
    /// Cells moved in this step.
    moved: [f32; N],
    /// Neither margin can be below this, metres.
    room_m: [f32; N],
    share_x: [f32; N],
    share_y: [f32; N],
    cell_idx: [i32; N],
    clear: [u32; N],
    slow: [u32; N],
    ridge: [u32; N],
    /// The second of the layers that cross, and the smallest of the others.
    second: [u32; N],
    others_m: [f32; N],
}

impl Pass {
    #[inline(always)]
    pub(super) fn at(from: From, n: usize) -> Pass {
        Pass {
            n,
            x: [from.x; N],
            y: [from.y; N],
            sin: [from.sin; N],
            cos: [from.cos; N],
            speed_m_s: [from.speed_m_s; N],
            kept_m: [from.kept_m; N],
            bound_m: [f32::INFINITY; N],
            moved: [0.0; N],
            room_m: [f32::NEG_INFINITY; N],
            share_x: [0.0; N],
            share_y: [0.0; N],
            cell_idx: [0; N],
            clear: [0; N],
            slow: [0; N],
            ridge: [0; N],
            second: [0; N],
            others_m: [f32::INFINITY; N],
        }
    }

    /// One step of every lane.
    #[inline(always)]
    pub(super) fn advance<M: Model, const FUSED: bool>(
        &mut self,
        model: M,
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
            &mut self.moved,
        );
    }

    /// What the first step leaves, after which all lanes are at the same place.
    #[inline(always)]
    pub(super) fn begin<M: Model>(&mut self, model: M, next_m: [f32; 2]) {
        let (kept_m, room_m) = (&mut self.kept_m, &mut self.room_m);
        begin_lanes(self.n.min(N), model, kept_m, room_m, &self.bound_m, &self.speed_m_s, next_m);
    }

    /// Where every lane is.
    #[inline(always)]
    pub(super) fn place(&mut self, ground: &Ground<'_>) {
        let n = self.n.min(N);
        place_lanes(n, ground, &mut self.share_x, &mut self.share_y, &mut self.cell_idx, &self.x, &self.y);
    }

    /// Lowers what lanes keep to what their controls leave; how many still keep more than the floor, and
    /// whether any of these may be lowered by what the words say here (not 0).
    #[inline(always)]
    pub(super) fn room(&mut self, slope_m: f32, floor_m: f32) -> (u32, u32) {
        room_lanes(
            self.n.min(N),
            &mut self.room_m,
            &mut self.kept_m,
            &self.moved,
            &self.bound_m,
            slope_m,
            floor_m,
        )
    }

    /// Loads the words of every lane's cell.
    #[inline(always)]
    pub(super) fn load(&mut self, ground: &Ground<'_>, n: usize) {
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
    pub(super) fn judge<M: Model, const FUSED: bool, const FULL: bool>(
        &mut self,
        model: M,
        ground: &Ground<'_>,
        floor_m: f32,
    ) -> u32 {
        judge_lanes::<M, FUSED, FULL>(
            self.n.min(N),
            model,
            &mut self.kept_m,
            &mut self.room_m,
            &mut self.ridge,
            (&self.bound_m, &self.moved),
            (&self.clear, &self.slow),
            &self.share_x,
            &self.share_y,
            &self.speed_m_s,
            ground,
            floor_m,
        )
    }

    /// Where layers cross, the word is a lower bound only: those lanes ask the layers, of which there are mostly two.
    #[inline(always)]
    pub(super) fn settle_ridges<M: Model, const FUSED: bool>(
        &mut self,
        model: M,
        ground: &Ground<'_>,
        n: usize,
    ) {
        let Some(ridges) = ground.ridges else { return };
        for lane in (0..n.min(N)).filter(|lane| self.ridge[*lane] != 0) {
            let words = ridges.ridge_words_of(self.cell_idx[lane] as usize);
            let [first, second, others @ ..] = words else { continue };
            (self.clear[lane], self.second[lane]) = (*first, *second);
            let (x, y) = (self.share_x[lane], self.share_y[lane]);
            let others_m = others.iter().map(|word| ground.clear_m::<FUSED>(*word, x, y));
            self.others_m[lane] = others_m.fold(f32::INFINITY, least);
        }
        settle_lanes::<M, FUSED>(
            self.n.min(N),
            model,
            &mut self.kept_m,
            &mut self.room_m,
            &self.ridge,
            ([&self.clear, &self.second], &self.others_m, &self.slow),
            &self.share_x,
            &self.share_y,
            &self.speed_m_s,
            ground,
        );
    }
}
