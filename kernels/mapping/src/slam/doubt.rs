//! When a place that a scan fits is to be doubted: it fits worse than scans used to fit in this map.
//!
//! A robot that was carried into a corridor like the one it was in still fits there by half, and no share that is
//! asked of all robots in all maps tells it from one among people in a map that is old. What tells them apart is
//! how well scans fitted before, and whether they would fit better elsewhere: the first is kept here, the second
//! is for whoever asks.

/// What is usual before anything was seen: a robot that is set down at the wrong place must be doubted too.
/// Chosen: below what a map of this building gives (0.93 to 1 in generated and recorded ones).
const USUAL_AT_FIRST: f64 = 0.9;
/// A fit that is worse than usual by this much is doubted, or by ...
const FALL_MIN: f64 = 0.1;
/// ... so many mean deviations, whichever is more.
const FALL_DEVIATIONS: f64 = 4.0;
/// Weight of the newest fit.
const NEWEST: f64 = 0.1;
/// So many scans in a row must fit as usual, and there is no doubt any more.
const N_USUAL: u32 = 3;

/// How well scans used to fit, and whether they do now.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Doubt {
    usual: f64,
    deviation: f64,
    is_open: bool,
    /// Scans in a row that fitted as usual.
    n_usual: u32,
}

impl Default for Doubt {
    fn default() -> Self {
        Doubt { usual: USUAL_AT_FIRST, deviation: 0.0, is_open: false, n_usual: 0 }
    }
}

impl Doubt {
    /// The place is in doubt.
    pub(crate) fn is_open(&self) -> bool {
        self.is_open
    }

    /// Takes in how well a scan fits: of the points that say anything, the share that speaks for the place. `news` is
    /// the share that may be seen for the first time.
    pub(crate) fn hear(&mut self, share: f64, news: f64) {
        let fall_max = FALL_MIN.max(FALL_DEVIATIONS * self.deviation) + news;
        let is_usual = share >= self.usual - fall_max;
        self.n_usual = if is_usual { self.n_usual.saturating_add(1) } else { 0 };
        self.is_open = !is_usual || (self.is_open && self.n_usual < N_USUAL);
        if !self.is_open {
            let off = share - self.usual;
            self.usual += NEWEST * off;
            self.deviation += NEWEST * (off.abs() - self.deviation);
        }
    }

    /// There is no better place: what fits like this is usual from now on.
    pub(crate) fn dismiss(&mut self, share: f64) {
        *self = Doubt { usual: self.usual.min(share), ..Doubt::default() };
    }

    /// The robot was found elsewhere, where it fits.
    pub(crate) fn close(&mut self) {
        self.is_open = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(shares: &[f64]) -> Doubt {
        let mut doubt = Doubt::default();
        shares.iter().for_each(|share| doubt.hear(*share, 0.0));
        doubt
    }

    #[test]
    fn a_fit_is_doubted_by_what_was_usual_and_not_by_what_it_is() {
        assert!(!after(&[0.97; 50]).is_open());
        assert!(after(&[[0.97; 50].as_slice(), &[0.8]].concat()).is_open());
        // Where it goes up and down, 0.8 is nothing new.
        assert!(!after(&[[0.95, 0.83].repeat(30).as_slice(), &[0.8]].concat()).is_open());
        assert!(after(&[0.6]).is_open(), "set down at the wrong place");
    }

    #[test]
    fn what_may_be_new_is_no_reason_for_doubt() {
        let mut doubt = after(&[0.97; 50]);
        doubt.hear(0.7, 0.3);
        assert!(!doubt.is_open());
        doubt.hear(0.5, 0.3);
        assert!(doubt.is_open());
    }

    #[test]
    fn one_good_scan_ends_no_doubt_and_some_in_a_row_do() {
        let seen = [[0.97; 50].as_slice(), &[0.6, 0.97, 0.6, 0.97, 0.97]].concat();
        assert!(after(&seen).is_open());
        assert!(!after(&[seen.as_slice(), &[0.97]].concat()).is_open());
    }

    #[test]
    fn what_was_looked_into_is_doubted_again_only_when_it_gets_worse() {
        let mut doubt = after(&[0.97, 0.97, 0.7]);
        doubt.dismiss(0.7);
        doubt.hear(0.69, 0.0);
        assert!(!doubt.is_open());
        doubt.hear(0.5, 0.0);
        assert!(doubt.is_open());
    }
}
