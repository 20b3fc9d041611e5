//! Four corners of a cell in one word: a quarter of the loads of a bilinear look-up.
//!
//! A word holds the lower left corner in 10 or 11 bits, how far the neighbours along x and along y lie above it in 7
//! each, and the twist in 7: what the fourth corner lies above the plane through the others. All in whole *quanta*
//! above a lowest value. Every corner is rounded down, and the interpolation is a convex sum of corners: the packed
//! value is never above the true one, and less than a quantum below. Where the first corner has 10 bits, the top
//! bit marks a *ridge*, a cell in which merged layers cross: there the word holds a lower bound, and the layers have
//! to be asked.

use super::isa::fused;

/// Bit 31: several layers cross in this cell, the word is a lower bound only.
pub(crate) const RIDGE: u32 = 1 << 31;
/// Largest difference of two neighbours along an axis, in quanta, with one spare for rounding.
pub(crate) const AXIS_MAX: f32 = 62.0;
/// Largest twist, in quanta, with three spare for rounding.
pub(crate) const TWIST_MAX: f32 = 60.0;
/// Largest value of the first corner, in quanta, where words have no room for a mark, and where they have.
pub(crate) const BASE_MAX: i32 = 2047;
pub(crate) const MARKED_BASE_MAX: i32 = 1023;
/// What differences are raised by, to be positive.
const RAISED: i32 = 64;

/// A cell's word from its corners (x, y), (x+1, y), (x, y+1), (x+1, y+1), in quanta above the lowest value, rounded
/// down. They are within what a word can hold.
#[inline(always)]
pub(crate) fn packed([corner, right, above, across]: [i32; 4]) -> u32 {
    let (x, y) = (right.wrapping_sub(corner), above.wrapping_sub(corner));
    let twist = across.wrapping_sub(above).wrapping_sub(x);
    let seven_bits = |difference: i32| difference.wrapping_add(RAISED) as u32 & 0x7F;
    (corner as u32) << 21 | seven_bits(x) << 14 | seven_bits(y) << 7 | seven_bits(twist)
}

/// The value inside a cell, in quanta above the lowest, of a word without its mark; `share_x` and `share_y` in 0 to 1.
#[inline(always)]
pub(crate) fn unpacked<const FUSED: bool>(word: u32, share_x: f32, share_y: f32) -> f32 {
    // Bits of a word as the last ones of a number of that many: no shifts, no conversion.
    let difference =
        |mask: u32, number: f32| f32::from_bits((word & mask) | number.to_bits()) - (number + RAISED as f32);
    let base = (word >> 21) as i32 as f32;
    let x = difference(0x7F << 14, (1 << 9) as f32);
    let y = difference(0x7F << 7, (1 << 16) as f32);
    let twist = difference(0x7F, (1 << 23) as f32);
    fused::<FUSED>(share_y, fused::<FUSED>(share_x, twist, y), fused::<FUSED>(share_x, x, base))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_word_says_at_most_the_bilinear_value_and_less_than_a_quantum_less(
            base in 0.2..1.5_f32, x in -0.099..0.099_f32, y in -0.099..0.099_f32, twist in -0.09..0.09_f32,
            share_x in 0.0..=1.0_f32, share_y in 0.0..=1.0_f32, is_ridge: bool,
        ) {
            let quantum = 0.1 / AXIS_MAX;
            let corners = [base, base + x, base + y, base + x + y + twist];
            let bits = packed(corners.map(|c| (c / quantum).floor() as i32));
            let word = if is_ridge { bits | RIDGE } else { bits };
            let found = quantum * unpacked::<false>(word & !RIDGE, share_x, share_y);
            let lower = corners[0] + share_x * (corners[1] - corners[0]);
            let upper = corners[2] + share_x * (corners[3] - corners[2]);
            let exact = lower + share_y * (upper - lower);
            prop_assert!(found <= exact + 1e-5 && found > exact - quantum - 1e-5, "{found} {exact}");
            prop_assert_eq!(word & RIDGE != 0, is_ridge);
        }
    }
}
