//! The loops of a merge over the points of the lattice.
//!
//! Not here: in which order they run, and where layers cross (`merge`).

use super::super::isa::Work;
use super::super::packed::packed;
use super::{MergeLayer, SLACK_M};

/// Points of a layer that are merged together.
const N_POINTS_TOGETHER: usize = 4096;

/// The smallest margin at each point, whose it is, and each layer's smallest margin in each row.
pub(super) struct Smallest<'a> {
    pub n_cols: usize,
    pub layers: &'a [MergeLayer<'a>],
    pub least_m: &'a mut [f32],
    pub owners: &'a mut [u32],
    pub row_least_m: &'a mut [f32],
}

impl Work for Smallest<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Smallest { n_cols, layers, least_m, owners, row_least_m } = self;
        let n_rows = least_m.len() / n_cols;
        // Some rows of one layer after the other: what is read lies side by side, what is written stays in the cache.
        let n_together = (N_POINTS_TOGETHER / n_cols).max(1);
        for first in (0..n_rows).step_by(n_together) {
            for (layer_idx, layer) in layers.iter().enumerate() {
                for row in first..(first + n_together).min(n_rows) {
                    let range = row * n_cols..(row + 1) * n_cols;
                    let (least_m, owners) = (&mut least_m[range.clone()], &mut owners[range.clone()]);
                    row_least_m[layer_idx * n_rows + row] =
                        smallest_row(layer_idx as u32, &layer.values_m[range], layer.keep_m, least_m, owners);
                }
            }
        }
    }
}

#[inline(always)]
fn smallest_row(
    layer_idx: u32,
    values_m: &[f32],
    keep_m: f32,
    least_m: &mut [f32],
    owners: &mut [u32],
) -> f32 {
    let n = values_m.len().min(least_m.len()).min(owners.len());
    let (values_m, least_m, owners) = (&values_m[..n], &mut least_m[..n], &mut owners[..n]);
    // Order of floats as order of integers, which the compiler may reduce in any order.
    let mut smallest = i32::MAX;
    for col in 0..n {
        let margin_m = values_m[col] - keep_m;
        let is_less = margin_m < least_m[col];
        least_m[col] = if is_less { margin_m } else { least_m[col] };
        owners[col] = if is_less { layer_idx } else { owners[col] };
        let bits = margin_m.to_bits() as i32;
        let ordered = bits ^ ((bits >> 31) & 0x7FFF_FFFF);
        smallest = if ordered < smallest { ordered } else { smallest };
    }
    f32::from_bits((smallest ^ ((smallest >> 31) & 0x7FFF_FFFF)) as u32)
}

/// The largest differences along x, along y and across, and how far below zero the margins go, metres.
pub(super) struct Steepest<'a> {
    pub n_cols: usize,
    pub least_m: &'a [f32],
}

impl Work for Steepest<'_> {
    type Output = [f32; 4];
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [f32; 4] {
        let Steepest { n_cols, least_m } = self;
        let mut largest = [0_i32; 4];
        for row in 0..least_m.len() / n_cols - 1 {
            let (lower, upper) = least_m[row * n_cols..(row + 2) * n_cols].split_at(n_cols);
            let n = n_cols - 1;
            let (a, b, c, d) = (&lower[..n], &lower[1..][..n], &upper[..n], &upper[1..][..n]);
            for col in 0..n {
                // Of numbers that are not negative the bits are in order.
                let x = (b[col] - a[col]).abs().to_bits() as i32;
                let last_x = (d[col] - c[col]).abs().to_bits() as i32;
                let y = (c[col] - a[col]).abs().to_bits() as i32;
                let last_y = (d[col] - b[col]).abs().to_bits() as i32;
                let across = (d[col] - a[col]).abs().to_bits() as i32;
                let depth = if a[col] < 0.0 { -a[col] } else { 0.0 }.to_bits() as i32;
                largest[0] = largest[0].max(x).max(last_x);
                largest[1] = largest[1].max(y).max(last_y);
                largest[2] = largest[2].max(across);
                largest[3] = largest[3].max(depth);
            }
        }
        // The last row and column are corners of cells too: a step deeper covers them.
        let [x, y, across, depth] = largest.map(|bits| f32::from_bits(bits as u32));
        [x, y, across, depth + across.max(x).max(y)]
    }
}

/// A margin in whole quanta, rounded down.
#[inline(always)]
pub(super) fn quanta_of(margin_m: f32, quantum_m: f32) -> i32 {
    let quanta = (margin_m - SLACK_M) / quantum_m;
    // Not `floor`, which the baseline of x86-64 calls a function for.
    let towards_zero = quanta as i32;
    towards_zero.wrapping_sub(if towards_zero as f32 > quanta { 1 } else { 0 })
}

/// Margins in quanta.
pub(super) struct Quantise<'a> {
    pub least_m: &'a [f32],
    pub quantum_m: f32,
    pub quanta: &'a mut [i32],
}

impl Work for Quantise<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Quantise { least_m, quantum_m, quanta } = self;
        for (to, margin_m) in quanta.iter_mut().zip(least_m) {
            *to = quanta_of(*margin_m, quantum_m);
        }
    }
}

/// The words of a row of cells from the quanta of its two rows of points.
pub(super) struct Pack<'a> {
    pub quanta: &'a [i32],
    pub words: &'a mut [u32],
}

impl Work for Pack<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Pack { quanta, words } = self;
        let (lower, upper) = quanta.split_at(quanta.len() / 2);
        let n = words.len().min(lower.len() - 1).min(upper.len() - 1);
        let (a, b, c, d) = (&lower[..n], &lower[1..][..n], &upper[..n], &upper[1..][..n]);
        let words = &mut words[..n];
        for col in 0..n {
            words[col] = packed([a[col], b[col], c[col], d[col]], false);
        }
    }
}
