//! Log-odds of occupancy in 16 bits, and how passes and hits change them.
//!
//! A scan of a hall passes some hundred thousand cells: they are counted eight at a time, and the smaller they are
//! the less memory there is to go through. The unit is a 32 000th of the largest log-odds.

use super::BaseMapConfig;
use crate::bits::N_WORD;
use crate::grid::Occupancy;

/// Units that the largest log-odds are.
const N_UNITS: f32 = 32_000.0;
/// Log-odds beyond which a cell is decided.
const DECIDED: f32 = 0.1;
/// Cells that are counted at once.
const N_LANES: usize = 8;

/// For each byte of bits, all ones where a bit is set.
static LANES: [[i16; N_LANES]; 256] = {
    let mut lanes = [[0; N_LANES]; 256];
    let mut byte = 0;
    while byte < 256 {
        let mut bit = 0;
        while bit < N_LANES {
            lanes[byte][bit] = if byte >> bit & 1 == 1 { -1 } else { 0 };
            bit += 1;
        }
        byte += 1;
    }
    lanes
};

/// What a hit and a pass count, in units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Odds {
    hit: i16,
    free: i16,
    decided: i16,
}

impl Odds {
    pub(super) fn new(config: &BaseMapConfig) -> Self {
        // Casts saturate, and NaN is nothing.
        let units = |log_odds: f32| (log_odds / config.log_odds_max * N_UNITS).round() as i16;
        Odds { hit: units(config.hit), free: units(config.free), decided: units(DECIDED) }
    }

    /// What log-odds say.
    pub(super) fn occupancy(&self, log_odds: i16) -> Occupancy {
        if log_odds > self.decided {
            Occupancy::Occupied
        } else if log_odds < -self.decided {
            Occupancy::Free
        } else {
            Occupancy::Unknown
        }
    }

    /// Log-odds after a hit.
    pub(super) fn hit(&self, log_odds: i16) -> i16 {
        log_odds.saturating_add(self.hit).min(N_UNITS as i16)
    }

    /// Log-odds after a pass.
    #[inline]
    pub(super) fn passed(&self, log_odds: i16) -> i16 {
        log_odds.saturating_sub(self.free).max(-N_UNITS as i16)
    }

    /// Counts a pass of each cell whose bit is set. Cells beyond the last are left out.
    pub(super) fn pass(&self, cells: &mut [i16], words: &[u64]) {
        for (nth_word, &word) in words.iter().enumerate() {
            let mut left = word;
            while left != 0 {
                let nth_byte = left.trailing_zeros() as usize / N_LANES;
                let byte = (left >> (nth_byte * N_LANES)) as u8;
                left &= !(0xff << (nth_byte * N_LANES));
                let from = nth_word * N_WORD + nth_byte * N_LANES;
                let lanes = &LANES[usize::from(byte)];
                let Some(cells) = cells.get_mut(from..) else { return };
                if let Some(cells) = cells.first_chunk_mut::<N_LANES>() {
                    for (cell, lane) in cells.iter_mut().zip(lanes) {
                        *cell = cell.saturating_sub(self.free & lane).max(-N_UNITS as i16);
                    }
                } else {
                    for (cell, lane) in cells.iter_mut().zip(lanes) {
                        *cell = if *lane == 0 { *cell } else { self.passed(*cell) };
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn many_cells_are_counted_as_one_is(
            words in prop::collection::vec(any::<u64>(), 1..3),
            cells in prop::collection::vec(-32_000..=32_000_i16, 0..140),
        ) {
            let odds = Odds::new(&BaseMapConfig::default());
            let mut counted = cells.clone();
            odds.pass(&mut counted, &words);
            for (idx, (before, after)) in cells.iter().zip(&counted).enumerate() {
                let is_set = words.get(idx / N_WORD).is_some_and(|word| word >> (idx % N_WORD) & 1 == 1);
                prop_assert_eq!(*after, if is_set { odds.passed(*before) } else { *before });
            }
        }
    }

    #[test]
    fn a_hit_weighs_two_passes_and_nine_passes_free_what_was_surely_occupied() {
        let odds = Odds::new(&BaseMapConfig::default());
        let twice = odds.passed(odds.passed(odds.hit(0)));
        assert_eq!(odds.occupancy(twice), Occupancy::Unknown);
        let (mut surely, mut n_passes) = ((0..9).fold(0, |value, _| odds.hit(value)), 0);
        assert_eq!(surely, 32_000);
        while odds.occupancy(surely) != Occupancy::Free {
            surely = odds.passed(surely);
            n_passes += 1;
        }
        assert_eq!(n_passes, 10);
    }
}
