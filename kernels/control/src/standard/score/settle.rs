//! Which of the samples that bounds leave is the best: exactly, and with as few rollouts as that takes.
//!
//! Not here: the bounds (`score`), one rollout (`exact`).

use super::super::exact::{Follow, N_TOGETHER, Start, Together};
use super::{NONE, Open, Scorer};

impl Scorer<'_> {
    /// Rolls out exactly those picked samples that may keep more than what is known; the first of equals is the
    /// next incumbent. `hinted` is a sample that is known, and what it keeps.
    ///
    /// Over as soon as one keeps `enough`; whoever keeps less than `rival` is left at that.
    pub(super) fn settle(
        &mut self,
        open: &mut Open,
        round: usize,
        hinted: Option<(f64, usize)>,
        (enough, rival): (f64, f64),
    ) {
        let Open { kept_m, lanes, incumbent, start, cap, exact, .. } = open;
        let (stop, round_from) = (cap.min(enough), (incumbent.as_slice(), round, &*start));
        // The most that a sample keeps, by its bound.
        let most_m = |sample: u32| cap.min(f64::from(kept_m[sample as usize]) + f64::from(self.error_m));
        let mut best = Found { value: *exact, sample: None };
        if let Some((value, sample)) = hinted {
            best = Found { value, sample: Some(sample) };
        }
        let (known, below) = (best.value, rival.next_down());
        if known < below {
            best = Found { value: below, sample: None };
        }
        // The most promising first: its exact value rules most of the others out.
        let most = |a: u32, b: u32| if kept_m[b as usize] > kept_m[a as usize] { b } else { a };
        let first = lanes.iter().copied().reduce(most);
        if let Some(first) = first.filter(|_| best.value < stop) {
            self.consider(round_from, &[first], most_m, &mut best);
            lanes.retain(|lane| *lane != first && most_m(*lane) >= best.value);
            for lanes in lanes.chunks(N_TOGETHER) {
                if best.value < stop {
                    self.consider(round_from, lanes, most_m, &mut best);
                }
            }
        }
        if let Some(sample) = best.sample {
            self.hints[round] = Some(sample);
            // Nobody asks for the last incumbent.
            if round + 1 < self.sampling.n_rounds {
                self.hold(open, round, sample);
            }
        } else if known < below {
            (open.low, open.high, open.exact) = (open.low.max(known), below, known);
            open.lanes.clear();
            return;
        }
        open.know(best.value);
    }

    /// Follows some samples exactly, few enough to be followed together; none keeps more than `most_m` of it.
    fn consider(
        &self,
        (incumbent, round, start): (&[[f64; 2]], usize, &Start),
        samples: &[u32],
        most_m: impl Fn(u32) -> f64,
        best: &mut Found,
    ) {
        let n_steps = incumbent.len();
        let one = |sample: u32, best: &mut Found| {
            let which = Some((round, sample as usize));
            if let Some(value) = self.kept((incumbent, start), which, most_m(sample), best.value) {
                best.take(value, sample as usize);
            }
        };
        if samples.len() <= N_ONE_BY_ONE {
            samples.iter().for_each(|sample| one(*sample, best));
            return;
        }
        let together = &mut Together::at(&self.field, start, samples.iter().map(|sample| most_m(*sample)));
        for first in (0..n_steps).step_by(N_STRIDE) {
            let (field, noise, floor) = (&self.field, &self.noise, best.value);
            let steps = first..(first + N_STRIDE).min(n_steps);
            self.isa.run(Follow { together, field, samples, incumbent, noise, round, steps, floor });
            // Who is ahead is followed to the end at once: that rules most of the others out.
            for _ in 0..N_ONE_BY_ONE {
                let Some(lane) = ahead(&together.kept, samples, best) else { return };
                if first + N_STRIDE < n_steps {
                    one(samples[lane], best);
                    together.kept[lane] = NONE;
                }
            }
        }
        for (value, sample) in together.kept.into_iter().zip(samples) {
            best.take(value, *sample as usize);
        }
    }
}

/// The first of those samples that may keep most, when it may keep more than the best.
fn ahead(kept: &[f64], samples: &[u32], best: &Found) -> Option<usize> {
    let may_be =
        samples.iter().zip(kept).enumerate().filter(|(_, (sample, kept))| best.is_beaten(**kept, **sample));
    may_be.reduce(|a, b| if b.1.1 > a.1.1 { b } else { a }).map(|(lane, _)| lane)
}

/// Steps after which it is looked at who is ahead.
const N_STRIDE: usize = 4;
/// So few samples are followed faster one by one.
const N_ONE_BY_ONE: usize = 2;

/// The best that is known exactly: what it keeps, and which sample it is; `None` is the incumbent.
struct Found {
    value: f64,
    sample: Option<usize>,
}

impl Found {
    /// Of equal values the first sample's counts, as in the oracle.
    fn is_beaten(&self, value: f64, sample: u32) -> bool {
        let is_before = self.sample.is_some_and(|best| (sample as usize) < best);
        value > self.value || (value == self.value && is_before)
    }

    fn take(&mut self, value: f64, sample: usize) {
        if self.is_beaten(value, sample as u32) {
            *self = Found { value, sample: Some(sample) };
        }
    }
}
