//! The standard problem, fast: the scores of a step as closely as its choice needs them.
//!
//! Not here: how a score is bounded (`score`), what it means (`oracle`).

use super::oracle::{Pose, after, chosen, is_enough, least_enough, off};
use super::score::{Goal, NONE, Open, Scorer};
use super::*;
use crate::fast::Isa;
use crate::standard::field::Field;

/// What a step decides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Choice {
    /// The score of the present state, metres (or the unit of the limit that binds).
    pub v_m: f64,
    /// The primitive chosen.
    pub primitive_idx: usize,
}

/// The standard problem made ready: fields merged, room for all that a step needs. Steps allocate nothing.
#[derive(Debug)]
pub struct StandardFilter<'s> {
    scene: &'s Scene,
    isa: Isa,
    scorer: Scorer<'s>,
    here: Open,
    /// The score after each primitive.
    next: Vec<Open>,
    order: Vec<usize>,
    values: Vec<f64>,
}

/// A score to the last bit.
const EXACT: Goal = Goal { enough: f64::INFINITY, rival: NONE, is_exact: true };

impl<'s> StandardFilter<'s> {
    /// Merges the fields of a scene and makes room.
    #[must_use]
    pub fn new(isa: Isa, scene: &'s Scene, sampling: Sampling) -> StandardFilter<'s> {
        // The incumbent is always evaluated.
        let sampling = Sampling { n_samples: sampling.n_samples.max(1), ..sampling };
        let scorer = Scorer::new(isa, scene, sampling);
        let n_primitives = scene.primitives.len();
        let mut filter = StandardFilter {
            scene,
            isa,
            here: scorer.open(),
            next: (0..n_primitives).map(|_| scorer.open()).collect(),
            scorer,
            order: Vec::with_capacity(n_primitives),
            values: vec![NONE; n_primitives],
        };
        filter.begin(0);
        filter
    }

    /// Merges the fields again, as when a map has changed.
    pub fn merge(&mut self) {
        self.scorer.field = Field::of(self.isa, self.scene);
    }

    /// Begins another step: its noise is drawn anew, when it is needed.
    pub fn begin(&mut self, tick: u64) {
        self.scorer.begin(tick);
    }

    /// The noise of a sample, for the oracle; of this step.
    pub fn noise(&mut self, round: usize, step: usize, sample: usize) -> (f64, f64) {
        self.scorer.noise.draw(round + 1);
        self.scorer.noise.pair(round, step, sample)
    }

    /// One smooth-blending step with every rollout of all scores finished.
    pub fn full(&mut self, state: [f64; 6]) -> Choice {
        let [x, y, yaw, v, rate, accel] = state;
        let start = [x, y, yaw, v];
        let here = self.score_full(start);
        let goal = Goal { enough: least_enough(here), is_exact: false, ..EXACT };
        for (open, primitive) in self.next.iter_mut().zip(&self.scene.primitives) {
            self.scorer.bound::<true>(open, after(start, *primitive), goal);
        }
        Choice { v_m: here, primitive_idx: self.chosen(here, [rate, accel]) }
    }

    /// One smooth-blending step with nothing computed that cannot change the choice.
    pub fn shipped(&mut self, state: [f64; 6]) -> Choice {
        let [x, y, yaw, v, rate, accel] = state;
        let start = [x, y, yaw, v];
        let here = self.score(start, f64::INFINITY);
        let primitives = &self.scene.primitives;
        self.order.clear();
        self.order.extend(0..primitives.len());
        let off = |idx: usize| off(primitives[idx], [rate, accel]);
        self.order.sort_unstable_by(|a, b| off(*a).total_cmp(&off(*b)).then(a.cmp(b)));
        // Nearest first: the first that keeps enough is the choice. Until then none does, and who keeps less than
        // another is not the choice either.
        let mut goal = Goal { enough: least_enough(here), is_exact: false, ..EXACT };
        for &idx in &self.order {
            let open = &mut self.next[idx];
            self.scorer.bound::<false>(open, after(start, primitives[idx]), goal);
            if is_enough(open.low, here) {
                return Choice { v_m: here, primitive_idx: idx };
            }
            goal.rival = goal.rival.max(open.low);
        }
        Choice { v_m: here, primitive_idx: self.chosen(here, [rate, accel]) }
    }

    /// The choice by the bounds of all scores, each of which is on one side of what is needed for sure.
    fn chosen(&mut self, here: f64, nominal: [f64; 2]) -> usize {
        for (value, open) in self.values.iter_mut().zip(&self.next) {
            *value = open.low;
        }
        if !self.values.iter().any(|value| is_enough(*value, here)) {
            // The largest score is asked for: those that may be it are computed to the last bit, the most
            // promising first.
            let mut most = self.values.iter().copied().fold(NONE, f64::max);
            while let Some(idx) = self.most_promising(most) {
                let open = &mut self.next[idx];
                if open.is_begun {
                    self.scorer.finish(open, most);
                } else {
                    let pose = open.start.pose;
                    self.scorer.bound::<false>(open, pose, Goal { rival: most, ..EXACT });
                }
                open.high = open.low;
                self.values[idx] = open.low;
                most = most.max(open.low);
            }
        }
        chosen(&self.values, here, &self.scene.primitives, nominal)
    }

    /// The score that is not exact yet and reaches highest, when it may be at least `most`.
    fn most_promising(&self, most: f64) -> Option<usize> {
        let open = self.next.iter().enumerate().filter(|(_, open)| open.low < open.high && open.high >= most);
        open.max_by(|a, b| a.1.high.total_cmp(&b.1.high)).map(|(idx, _)| idx)
    }

    /// The score of a state with every rollout finished, exactly.
    pub fn score_full(&mut self, start: Pose) -> f64 {
        self.scorer.bound::<true>(&mut self.here, start, EXACT);
        self.here.low
    }

    /// The score of a state, exactly; or, once it is known to be at least `enough`, some value from there on.
    pub fn score(&mut self, start: Pose, enough: f64) -> f64 {
        self.scorer.bound::<false>(&mut self.here, start, Goal { enough, ..EXACT });
        self.here.low
    }
}
