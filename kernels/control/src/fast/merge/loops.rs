//! The loops of a merge over the points of the lattice.
//!
//! Not here: in which order they run, and where layers cross (`merge`).

use super::super::isa::Work;
use super::super::packed::{AXIS_MAX, TWIST_MAX, packed};
use super::{MergeLayer, QUANTUM_M_MIN, Reach, SLACK_M};

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

/// The largest differences within a cell, and how far below zero the margins go, metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Steps {
    pub x_m: f32,
    pub y_m: f32,
    /// Of two corners that face each other.
    pub across_m: f32,
    /// Of a corner and the plane through the others.
    pub twist_m: f32,
    pub depth_m: f32,
}

impl Steps {
    /// Heeds another cell, of which the depth is known.
    pub(super) fn note(&mut self, [a, b, c, d]: &[f32; 4]) {
        self.x_m = self.x_m.max((b - a).abs()).max((d - c).abs());
        self.y_m = self.y_m.max((c - a).abs()).max((d - b).abs());
        self.across_m = self.across_m.max((d - a).abs()).max((c - b).abs());
        self.twist_m = self.twist_m.max((d - b - (c - a)).abs());
    }
}

/// The steps of all cells.
pub(super) struct Steepest<'a> {
    pub n_cols: usize,
    pub least_m: &'a [f32],
}

impl Work for Steepest<'_> {
    type Output = Steps;
    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Steps {
        let Steepest { n_cols, least_m } = self;
        let (mut largest, mut deepest) = ([0_i32; 4], 0_i32);
        // Of numbers that are not negative the bits are in order.
        let size = |value: f32| value.abs().to_bits() as i32;
        for margin_m in least_m {
            deepest = deepest.max(size(if *margin_m < 0.0 { *margin_m } else { 0.0 }));
        }
        for row in 0..least_m.len() / n_cols - 1 {
            let (lower, upper) = least_m[row * n_cols..(row + 2) * n_cols].split_at(n_cols);
            let n = n_cols - 1;
            let (a, b, c, d) = (&lower[..n], &lower[1..][..n], &upper[..n], &upper[1..][..n]);
            for col in 0..n {
                let (x, last_x) = (b[col] - a[col], d[col] - c[col]);
                let (y, last_y) = (c[col] - a[col], d[col] - b[col]);
                let (up, down) = (d[col] - a[col], c[col] - b[col]);
                largest[0] = largest[0].max(size(x)).max(size(last_x));
                largest[1] = largest[1].max(size(y)).max(size(last_y));
                largest[2] = largest[2].max(size(up)).max(size(down));
                largest[3] = largest[3].max(size(last_y - y));
            }
        }
        let [x_m, y_m, across_m, twist_m] = largest.map(|bits| f32::from_bits(bits as u32));
        Steps { x_m, y_m, across_m, twist_m, depth_m: f32::from_bits(deepest as u32) }
    }
}

/// How margins are counted in quanta.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    pub quantum_m: f32,
    pub lowest_m: f32,
    /// The most that the first corner of a word can be.
    base_max: i32,
    /// Said of cells that reach further up than words do: so much it is everywhere in them, and more does not matter.
    high: i32,
}

impl Scale {
    /// The finest for fields of such steps.
    pub(super) fn of(steps: &Steps, Reach { low_m, high_m, base_max }: Reach) -> Scale {
        let Steps { x_m, y_m, across_m, twist_m, depth_m } = *steps;
        let widest_m = across_m.max(x_m).max(y_m);
        // A cell that reaches further down is below what matters everywhere.
        let lowest_m = (-depth_m).max(low_m - widest_m) - 2.0 * SLACK_M;
        let quantum_m = (x_m.max(y_m) / AXIS_MAX)
            .max(twist_m / TWIST_MAX)
            .max((high_m + widest_m - lowest_m) / (base_max - 4) as f32)
            .max(QUANTUM_M_MIN);
        let scale = Scale { quantum_m, lowest_m, base_max, high: 0 };
        Scale { high: scale.quanta_of(high_m) + 2, ..scale }
    }

    /// A margin in whole quanta, rounded down.
    #[inline(always)]
    pub(super) fn quanta_of(&self, margin_m: f32) -> i32 {
        let quanta = (margin_m - (self.lowest_m + SLACK_M)) / self.quantum_m;
        // Not `floor`, which the baseline of x86-64 calls a function for.
        let towards_zero = quanta as i32;
        towards_zero.wrapping_sub(if towards_zero as f32 > quanta { 1 } else { 0 })
    }

    /// The word of a cell.
    #[inline(always)]
    pub(super) fn word(&self, [a, b, c, d]: [i32; 4]) -> u32 {
        let (least, most) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        let (lowest, highest) = (packed([0; 4]), packed([self.high; 4]));
        if most > self.base_max {
            highest
        } else if least < 0 {
            lowest
        } else {
            packed([a, b, c, d])
        }
    }
}

/// Margins in quanta.
pub(super) struct Quantise<'a> {
    pub least_m: &'a [f32],
    pub scale: Scale,
    pub quanta: &'a mut [i32],
}

impl Work for Quantise<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Quantise { least_m, scale, quanta } = self;
        for (to, margin_m) in quanta.iter_mut().zip(least_m) {
            *to = scale.quanta_of(*margin_m);
        }
    }
}

/// The words of a row of cells from the quanta of its two rows of points.
pub(super) struct Pack<'a> {
    pub quanta: &'a [i32],
    pub scale: Scale,
    pub words: &'a mut [u32],
}

impl Work for Pack<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Pack { quanta, scale, words } = self;
        let (lower, upper) = quanta.split_at(quanta.len() / 2);
        let n = words.len().min(lower.len() - 1).min(upper.len() - 1);
        let (a, b, c, d) = (&lower[..n], &lower[1..][..n], &upper[..n], &upper[1..][..n]);
        let words = &mut words[..n];
        for col in 0..n {
            words[col] = scale.word([a[col], b[col], c[col], d[col]]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::packed::{MARKED_BASE_MAX, unpacked};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn within_what_matters_a_word_says_at_most_the_margin_and_less_than_a_quantum_less(
            corner in -4.0..4.0_f32, x in -0.1..0.1_f32, y in -0.1..0.1_f32, twist in -0.1..0.1_f32,
            deepest in 0.1..3.0_f32, share_x in 0.0..=1.0_f32, share_y in 0.0..=1.0_f32,
        ) {
            let reach = Reach { low_m: -1.1, high_m: 1.0, base_max: MARKED_BASE_MAX };
            let corners = [corner, corner + x, corner + y, corner + x + y + twist];
            let mut steps = Steps { x_m: 0.1, y_m: 0.1, across_m: 0.1, twist_m: 0.0, depth_m: deepest };
            steps.note(&corners);
            steps.depth_m = corners.iter().fold(deepest, |depth_m, corner| depth_m.max(-corner));
            let scale = Scale::of(&steps, reach);
            let word = scale.word(corners.map(|corner| scale.quanta_of(corner)));
            let found = scale.quantum_m * unpacked::<false>(word, share_x, share_y) + scale.lowest_m;
            let lower = corners[0] + share_x * (corners[1] - corners[0]);
            let upper = corners[2] + share_x * (corners[3] - corners[2]);
            let exact = (lower + share_y * (upper - lower)).max(reach.low_m);
            prop_assert!(found <= exact + 1e-5, "{found} {exact}");
            let less = exact.min(reach.high_m) - scale.quantum_m - 2e-5;
            prop_assert!(found > less || exact <= reach.low_m, "{found} {exact}");
        }
    }
}
