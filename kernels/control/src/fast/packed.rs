//! Four corners of a cell in one word: a quarter of the loads of a bilinear look-up.
//!
//! A word holds the lower left corner in 12 bits and how far the others lie above it in 6, 6 and 7, all in
//! whole *quanta*. Every corner is rounded down, and the interpolation is a convex sum of corners: the packed
//! value is never above the true one, and less than a quantum below. The top bit marks a *ridge*, a cell in
//! which merged layers cross: there the word holds a lower bound, and the layers have to be asked.

use super::isa::fused;

/// Bit 31: several layers cross in this cell, the word is a lower bound only.
pub(crate) const RIDGE: u32 = 1 << 31;
/// Largest difference of two neighbours along an axis, in quanta, with one spare for rounding.
pub(crate) const AXIS_MAX: f32 = 30.0;
/// Largest difference across a diagonal, in quanta.
pub(crate) const DIAGONAL_MAX: f32 = 62.0;
/// Largest and smallest value of the base corner, in quanta.
pub(crate) const BASE_MAX: i32 = 2047;

/// A cell's word from its corners (x, y), (x+1, y), (x, y+1), (x+1, y+1), in quanta rounded down.
#[inline(always)]
pub(crate) fn packed(corners: [i32; 4], is_ridge: bool) -> u32 {
    let clamped = |value: i32, low: i32, high: i32| {
        if value < low {
            low
        } else if value > high {
            high
        } else {
            value
        }
    };
    let base = clamped(corners[0], -BASE_MAX - 1, BASE_MAX);
    let x = clamped(corners[1].wrapping_sub(base), -32, 31);
    let y = clamped(corners[2].wrapping_sub(base), -32, 31);
    let xy = clamped(corners[3].wrapping_sub(base), -64, 63);
    let bits = ((base as u32 & 0xFFF) << 19) | ((x as u32 & 0x3F) << 13) | ((y as u32 & 0x3F) << 7);
    bits | (xy as u32 & 0x7F) | if is_ridge { RIDGE } else { 0 }
}

/// The value inside a cell, in quanta; `share_x` and `share_y` in 0 to 1.
#[inline(always)]
pub(crate) fn unpacked<const FUSED: bool>(word: u32, share_x: f32, share_y: f32) -> f32 {
    let base = ((word << 1) as i32) >> 20;
    let x = ((word << 13) as i32) >> 26;
    let y = ((word << 19) as i32) >> 26;
    let xy = ((word << 25) as i32) >> 25;
    // The profile checks plain subtractions for overflow, which would keep the loop from becoming vectors.
    let both = xy.wrapping_sub(x).wrapping_sub(y) as f32;
    let along_x = fused::<FUSED>(share_x, x as f32, base as f32);
    fused::<FUSED>(share_y, fused::<FUSED>(share_x, both, y as f32), along_x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_word_says_at_most_the_bilinear_value_and_less_than_a_quantum_less(
            base in -6.0..6.0_f32, x in -0.095..0.095_f32, y in -0.095..0.095_f32, xy in -0.01..0.01_f32,
            share_x in 0.0..=1.0_f32, share_y in 0.0..=1.0_f32, is_ridge: bool,
        ) {
            let quantum = 0.1 / AXIS_MAX;
            let corners = [base, base + x, base + y, base + x + y + xy];
            let word = packed(corners.map(|c| (c / quantum).floor() as i32), is_ridge);
            let found = quantum * unpacked::<false>(word, share_x, share_y);
            let lower = corners[0] + share_x * (corners[1] - corners[0]);
            let upper = corners[2] + share_x * (corners[3] - corners[2]);
            let exact = lower + share_y * (upper - lower);
            prop_assert!(found <= exact + 1e-5 && found > exact - quantum - 1e-5, "{found} {exact}");
            prop_assert_eq!(word & RIDGE != 0, is_ridge);
        }
    }
}
