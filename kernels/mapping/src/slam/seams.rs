//! Where the map was torn: a new piece was begun because no scan fitted, and how it lies to the old is only
//! guessed.
//!
//! A few scans of the new piece say more than the one that did not fit: they are looked for together in what
//! was there before the tear, again and again while the new piece grows, until it is found.

use geometry::Pose2;

use super::graph::Constraint;
use super::loops::{self, Sureness};
use super::submap::Submap;
use crate::scan_match::{Prior, Window};

/// The new piece is looked for when it holds so many kept scans.
const TRIES_AT: [usize; 7] = [1, 2, 3, 5, 8, 13, 21];
/// How many sub-maps before the tear are looked into.
const N_BEFORE: usize = 2;
/// Farthest that is looked, metres and radians.
const SHIFT_MAX_M: f64 = 4.0;
const TURN_MAX_RAD: f64 = 2.4;
/// What is found must fit as well as this: metres of wall may lie in free space for no one.
const SURENESS: Sureness = Sureness { share_min: 0.75, told_min: 0.3, margin: 0.1 };

/// One tear.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seam {
    /// The last sub-map before it, and the first one after it.
    pub(super) old: usize,
    pub(super) new: usize,
    /// Deviations of the guess, metres and radians.
    pub(super) shift_m: f64,
    pub(super) turn_rad: f64,
    /// Scans kept since.
    n_kept: usize,
}

impl Seam {
    pub(super) fn new(old: usize, new: usize, shift_m: f64, turn_rad: f64) -> Self {
        Seam { old, new, shift_m, turn_rad, n_kept: 0 }
    }

    /// A scan was kept; true when it is time to look.
    pub(super) fn hear(&mut self) -> bool {
        self.n_kept += 1;
        TRIES_AT.contains(&self.n_kept)
    }

    /// Looks for the new piece in the old.
    pub(super) fn look(&self, submaps: &[Submap]) -> Option<Constraint> {
        let new = submaps.get(self.new)?;
        let window = Window {
            shift_m: (2.5 * self.shift_m).min(SHIFT_MAX_M),
            turn_rad: (2.5 * self.turn_rad).min(TURN_MAX_RAD),
        };
        for idx in (0..=self.old).rev().take(N_BEFORE) {
            let old = submaps.get(idx)?;
            let guess: Pose2 = old.map_from_submap.inverse() * new.map_from_submap;
            let prior = Prior { map_from_scan: guess, shift_m: self.shift_m, turn_rad: self.turn_rad };
            if let Some(found) = loops::find_piece(old, new, &prior, window, SURENESS) {
                return Some(Constraint::of_match(idx, self.new, &found));
            }
        }
        None
    }
}
