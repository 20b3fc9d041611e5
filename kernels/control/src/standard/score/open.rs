//! The score of one state while it is worked at: its bounds, and which samples may be the best.
//!
//! Not here: how the bounds come about (`score`), which sample is the best (`settle`).

use super::super::exact::{Controls, Start};
use super::super::*;
use super::NONE;
use crate::fast::Isa;
use crate::fast::isa::Work;
use crate::fast::sweep::{most, padded};

/// The score of one state under work: its bounds, and what is left to settle.
#[derive(Debug)]
pub(crate) struct Open {
    pub low: f64,
    pub high: f64,
    pub start: Start,
    /// Whether more than the most that any sample can keep is known.
    pub is_begun: bool,
    pub(super) cap: f64,
    /// What the incumbent keeps, where that is known exactly; in the last round what the best known sample does.
    pub(super) exact: f64,
    pub(super) incumbent: Controls,
    pub(super) kept_m: Vec<f32>,
    /// Samples of the last round that can be the best and are not settled.
    pub(super) lanes: Vec<u32>,
}

impl Open {
    pub(super) fn new(sampling: Sampling) -> Open {
        let n_lanes = padded(sampling.n_samples);
        Open {
            low: NONE,
            high: NONE,
            start: Start { pose: [0.0; 4], sin: 0.0, cos: 1.0, next_m: [NONE; 2] },
            is_begun: false,
            cap: NONE,
            exact: NONE,
            incumbent: vec![[0.0; 2]; sampling.n_steps],
            kept_m: vec![0.0; n_lanes],
            lanes: Vec::with_capacity(n_lanes),
        }
    }

    pub(super) fn begin(&mut self, start: Start, cap: f64) {
        (self.start, self.cap, self.is_begun) = (start, cap, false);
        (self.low, self.high, self.exact) = (NONE, cap, NONE);
        self.incumbent.fill([0.0, -ACCEL_M_S2_MAX]);
        self.lanes.clear();
    }

    pub(super) fn know(&mut self, exact: f64) {
        (self.low, self.high, self.exact) = (exact, exact, exact);
        self.lanes.clear();
    }

    /// The largest of what samples were found to keep, as far as they were followed.
    pub(super) fn most_m(&self, n_samples: usize) -> f32 {
        let (blocks, rest) = self.open_m(n_samples).as_chunks::<N_BLOCK>();
        let mut most_m = [f32::NEG_INFINITY; N_BLOCK];
        for block in blocks {
            for (most_m, kept_m) in most_m.iter_mut().zip(block) {
                *most_m = most(*kept_m, *most_m);
            }
        }
        most_m.iter().chain(rest).copied().fold(f32::NEG_INFINITY, most)
    }

    /// Picks the samples that may keep at least `floor`; not the incumbent when it is known already.
    pub(super) fn pick(&mut self, isa: Isa, n_samples: usize, floor: f64, error_m: f32) {
        let floor = (floor as f32 - error_m).next_down();
        let mut lanes = std::mem::take(&mut self.lanes);
        lanes.resize(n_samples, 0);
        let n = isa.run(Pick {
            kept_m: self.open_m(n_samples),
            from: self.first_open() as u32,
            floor,
            lanes: &mut lanes,
        });
        lanes.truncate(n);
        self.lanes = lanes;
    }

    /// The first sample that is not known exactly.
    fn first_open(&self) -> usize {
        usize::from(self.exact > NONE)
    }

    fn open_m(&self, n_samples: usize) -> &[f32] {
        &self.kept_m[self.first_open()..n_samples]
    }
}

/// Samples looked at side by side.
const N_BLOCK: usize = 16;

/// Lists the lanes that keep more than the floor, counted from `from`; how many they are.
struct Pick<'a> {
    kept_m: &'a [f32],
    from: u32,
    floor: f32,
    lanes: &'a mut [u32],
}

impl Work for Pick<'_> {
    type Output = usize;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> usize {
        let Pick { kept_m, from, floor, lanes } = self;
        let mut n = 0;
        for (block, kept_m) in (0..).step_by(N_BLOCK).zip(kept_m.chunks(N_BLOCK)) {
            // In most there is nobody.
            if !kept_m.iter().fold(false, |any, kept_m| any | (*kept_m > floor)) {
                continue;
            }
            for (lane, kept_m) in (from + block..).zip(kept_m) {
                // Written whether picked or not, without a branch; who is not picked is written over.
                lanes[n] = lane;
                n += usize::from(*kept_m > floor);
            }
        }
        n
    }
}
