//! The fields of a standard problem, merged and packed: what must be kept clear of, and the slow zone.

use super::oracle::Pose;
use super::*;
use crate::fast::Isa;
use crate::fast::merge::{MergeLayer, Merged, Reach};
use crate::fast::packed::{BASE_MAX, MARKED_BASE_MAX, packed};
use crate::fast::sweep::{Ground, paired};

/// Nobody keeps more than this, metres: a turn rate of nothing leaves as much.
const KEPT_M_MAX: f32 = YAW_RATE_RAD_S_LIMIT as f32;
/// Nobody is so fast that a margin to the slow zone below this matters, metres.
const SLOW_M_MIN: f32 = (SLOW_SPEED_M_S - SPEED_M_S_MAX) as f32;

/// The merged fields; each cell's two words are one, so that one load brings both.
#[derive(Debug)]
pub(crate) struct Field<'s> {
    pub n_side: usize,
    /// For each cell the margin to what must be kept clear of, and to the slow zone; filled up to a power of two.
    words: Vec<u64>,
    clear_layers: Vec<MergeLayer<'s>>,
    slow_layers: Vec<MergeLayer<'s>>,
    pub clear: Merged,
    pub slow: Merged,
}

impl<'s> Field<'s> {
    /// Merges the layers of a scene.
    pub(crate) fn of(isa: Isa, scene: &'s Scene) -> Field<'s> {
        let n_side = scene.n_side;
        let (mut clear_layers, mut slow_layers) = (Vec::new(), Vec::new());
        for (idx, values_m) in scene.layers_m.iter().enumerate() {
            match idx {
                0 => clear_layers.push(MergeLayer { values_m, keep_m: RADIUS_M as f32 }),
                SLOW_LAYER => slow_layers.push(MergeLayer { values_m, keep_m: SLOW_BUFFER_M as f32 }),
                _ => clear_layers.push(MergeLayer { values_m, keep_m: BUFFER_M as f32 }),
            }
        }
        let mut words = vec![0; (n_side * n_side).next_power_of_two()];
        let reach = Reach { low_m: f32::NEG_INFINITY, high_m: KEPT_M_MAX, base_max: MARKED_BASE_MAX };
        let shape = (n_side, n_side);
        let clear = Merged::of(isa, shape, &clear_layers, reach, |idx, word| words[idx] = paired(word, 0));
        let slow = if slow_layers.is_empty() {
            // Without a slow zone everywhere is far from it.
            let far = paired(0, packed([BASE_MAX; 4]));
            words.iter_mut().for_each(|word| *word |= far);
            Merged::nothing()
        } else {
            let reach = Reach { low_m: SLOW_M_MIN, base_max: BASE_MAX, ..reach };
            Merged::of(isa, shape, &slow_layers, reach, |idx, word| words[idx] |= paired(0, word))
        };
        Field { n_side, words, clear_layers, slow_layers, clear, slow }
    }

    /// The ground under a sweep from a start.
    pub(crate) fn ground(&self, [x_m, y_m, ..]: Pose) -> (Ground<'_>, [f32; 2]) {
        let last = (self.n_side - 2) as f64;
        let (x, y) = (x_m / CELL_M, y_m / CELL_M);
        let (col, row) = (x.floor().clamp(0.0, last), y.floor().clamp(0.0, last));
        let high = self.n_side as f64 - 1.001;
        let ground = Ground {
            words: &self.words,
            first: [col as i32, row as i32],
            n_cols: self.n_side as i32,
            low: [-col as f32, -row as f32],
            high: [(high - col) as f32, (high - row) as f32],
            slope_m: self.clear.slope_m.max(self.slow.slope_m),
            quantum_m: [self.clear.quantum_m, self.slow.quantum_m],
            lowest_m: [self.clear.lowest_m, self.slow.lowest_m],
            ridges: Some(&self.clear),
        };
        (ground, [(x - col) as f32, (y - row) as f32])
    }

    /// The exact margin to what must be kept clear of, at a place in a cell, metres.
    #[inline]
    pub(crate) fn clear_m(&self, cell_idx: usize, place: (f64, f64)) -> f64 {
        self.clear.exact_m(&self.clear_layers, cell_idx, place).0
    }

    /// The exact margin to the slow zone, metres.
    #[inline]
    pub(crate) fn slow_m(&self, cell_idx: usize, place: (f64, f64)) -> f64 {
        if self.slow_layers.is_empty() {
            return f64::INFINITY;
        }
        self.slow.exact_m(&self.slow_layers, cell_idx, place).0
    }

    /// The cell of a place and where in it.
    #[inline]
    pub(crate) fn cell(&self, x_m: f64, y_m: f64) -> (usize, (f64, f64)) {
        let last = self.n_side as f64 - 1.001;
        let (x, y) = ((x_m / CELL_M).clamp(0.0, last), (y_m / CELL_M).clamp(0.0, last));
        let (col, row) = (x as usize, y as usize);
        (row * self.n_side + col, (x - col as f64, y - row as f64))
    }

    /// The exact spatial margin at a place and speed, metres.
    pub(crate) fn margin_m(&self, x_m: f64, y_m: f64, speed_m_s: f64) -> f64 {
        let (cell_idx, place) = self.cell(x_m, y_m);
        self.clear_m(cell_idx, place).min(self.slow_m(cell_idx, place).max(SLOW_SPEED_M_S - speed_m_s))
    }

    /// By how much packed margins may lie below the exact ones, metres.
    pub(crate) fn error_m(&self) -> f32 {
        let slow_m = if self.slow_layers.is_empty() { 0.0 } else { self.slow.error_m() };
        self.clear.error_m().max(slow_m)
    }

    /// The most that either margin changes over the length of a cell side, metres.
    pub(crate) fn slope_m(&self) -> f32 {
        self.clear.slope_m.max(self.slow.slope_m)
    }
}
