//! Looking for a lost robot all over a map, a part with each scan, and deciding only when all has been seen: the
//! first place that looks right may have a twin.

use geometry::Pose2;

use crate::scan_match::Candidate;

/// The best place must be better than any other by this much: places that look alike are none.
const MARGIN: f64 = 0.1;
/// Places nearer together than this are one, metres and radians: maps drift, and so do wheels meanwhile.
const SAME_SHIFT_M: f64 = 1.0;
const SAME_TURN_RAD: f64 = 0.35;
/// Most places that are kept.
const N_PLACES_MAX: usize = 64;

/// A place where the robot may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    /// Where it would be now.
    pub(crate) map_from_base: Pose2,
    /// What speaks for it, 1 at most.
    pub(crate) score: f64,
    /// Which part of the map it was found in.
    pub(crate) part: usize,
}

impl Place {
    fn is_other(&self, place: &Place) -> bool {
        let off = self.map_from_base.inverse() * place.map_from_base;
        off.position().coords.norm() > SAME_SHIFT_M || off.yaw_rad.abs() > SAME_TURN_RAD
    }

    /// Whether it is better than any other of places with the best first.
    fn stands_out(&self, places: &[Place]) -> bool {
        let other = places.iter().find(|place| self.is_other(place));
        self.score >= other.map_or(f64::NEG_INFINITY, |place| place.score) + MARGIN
    }
}

/// What a look at all parts of a map says of the place where the robot seems to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Verdict {
    /// Not all parts have been looked at.
    NotYet,
    /// No other place fits better.
    Here,
    /// One other place does, and stands out.
    There(Place),
    /// Several do.
    Unknown,
}

/// One look at all parts of a map.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sweep {
    places: Vec<Place>,
    n_looked: usize,
}

impl Sweep {
    /// The part that is to be looked at next, of so many.
    pub(crate) fn next_part(&self, n_parts: usize) -> usize {
        self.n_looked % n_parts.max(1)
    }

    /// The robot went on.
    pub(crate) fn carry(&mut self, last_from_now: Pose2) {
        for place in &mut self.places {
            place.map_from_base = place.map_from_base * last_from_now;
        }
    }

    /// Takes in what one part showed. `map_from_part` is where it lies.
    pub(crate) fn look(&mut self, part: usize, map_from_part: Pose2, found: &[Candidate]) {
        self.n_looked += 1;
        for candidate in found {
            let map_from_base = map_from_part * candidate.found.map_from_scan;
            self.places.push(Place { map_from_base, score: candidate.score, part });
        }
        self.places.sort_by(|a, b| b.score.total_cmp(&a.score));
        self.places.truncate(N_PLACES_MAX);
    }

    /// When all parts have been looked at: the one place that stands out, if any does; and all is forgotten.
    pub(crate) fn decide(&mut self, n_parts: usize) -> Option<Place> {
        if self.n_looked < n_parts {
            return None;
        }
        let sweep = std::mem::take(self);
        let best = *sweep.places.first()?;
        best.stands_out(&sweep.places).then_some(best)
    }

    /// When all parts have been looked at: whether the place `here`, where the robot seems to be, is the one;
    /// and all is forgotten.
    pub(crate) fn compare(&mut self, here: &Place, n_parts: usize) -> Verdict {
        if self.n_looked < n_parts {
            return Verdict::NotYet;
        }
        let mut places = std::mem::take(self).places;
        places.retain(|place| here.is_other(place));
        match places.first() {
            Some(best) if best.score >= here.score + MARGIN => {
                if best.stands_out(&places) {
                    Verdict::There(*best)
                } else {
                    Verdict::Unknown
                }
            }
            _ => Verdict::Here,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scan_match::{Evidence, Match};

    fn at(x_m: f64, score: f64) -> Candidate {
        let found = Match {
            map_from_scan: Pose2::new(x_m, 0.0, 0.0),
            inlier_share: 1.0,
            n_inliers: 100,
            information: nalgebra::Matrix3::identity(),
        };
        Candidate { found, evidence: Evidence::default(), score }
    }

    #[test]
    fn nothing_is_decided_before_all_parts_were_seen_and_twins_are_none() {
        let mut sweep = Sweep::default();
        sweep.look(sweep.next_part(2), Pose2::IDENTITY, &[at(1.0, 0.9), at(1.2, 0.88)]);
        assert_eq!(sweep.decide(2), None);
        assert_eq!(sweep.next_part(2), 1);
        sweep.carry(Pose2::new(0.5, 0.0, 0.0));
        sweep.look(1, Pose2::new(10.0, 0.0, 0.0), &[at(0.0, 0.5)]);
        let found = sweep.decide(2).unwrap();
        assert_eq!((found.map_from_base, found.part), (Pose2::new(1.5, 0.0, 0.0), 0));
        sweep.look(0, Pose2::IDENTITY, &[at(1.0, 0.9)]);
        sweep.look(1, Pose2::new(10.0, 0.0, 0.0), &[at(0.0, 0.85)]);
        assert_eq!(sweep.decide(2), None, "one of two twins was taken");
    }

    #[test]
    fn a_place_is_left_for_one_that_fits_better_and_for_none_of_twins() {
        let compared = |found: &[Candidate], here_score: f64| {
            let mut sweep = Sweep::default();
            sweep.look(0, Pose2::IDENTITY, found);
            let here = Place { map_from_base: Pose2::new(5.0, 0.0, 0.0), score: here_score, part: 0 };
            sweep.compare(&here, 1)
        };
        let there = Place { map_from_base: Pose2::new(1.0, 0.0, 0.0), score: 0.9, part: 0 };
        assert_eq!(compared(&[at(5.1, 0.95), at(1.0, 0.9)], 0.85), Verdict::Here);
        assert_eq!(compared(&[at(5.1, 0.5), at(1.0, 0.9)], 0.5), Verdict::There(there));
        assert_eq!(compared(&[at(1.0, 0.9), at(9.0, 0.85)], 0.5), Verdict::Unknown);
        assert_eq!(compared(&[], 0.5), Verdict::Here);
        assert_eq!(Sweep::default().compare(&there, 1), Verdict::NotYet);
    }
}
