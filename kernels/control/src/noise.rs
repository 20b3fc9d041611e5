//! The chance in the score: standard normal draws, reproducible from a seed and the number of the tick.

use crate::fast::sweep::padded;
use crate::fast::{Isa, normal};

/// Standard normal draws for the sampled sequences of one tick, shared by all its scores.
///
/// Lie as sweeps read them: round by round, step by step, sample by sample. A round is drawn when it is first
/// needed: most ticks are decided by full braking and need none.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    isa: Isa,
    key: u64,
    n_samples: usize,
    n_steps: usize,
    n_drawn: usize,
    /// Whether sample 0 of each round is the incumbent itself: its draws are zero.
    keeps_incumbent: bool,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Default for Noise {
    fn default() -> Self {
        Noise::on(Isa::detect())
    }
}

impl Noise {
    /// No draws yet.
    pub(crate) fn on(isa: Isa) -> Noise {
        let (first, second) = (Vec::new(), Vec::new());
        Noise { isa, key: 0, n_samples: 0, n_steps: 0, n_drawn: 0, keeps_incumbent: false, first, second }
    }

    /// Zero draws for sample 0 of each round.
    pub(crate) fn keeping_incumbents(self) -> Noise {
        Noise { keeps_incumbent: true, ..self }
    }

    /// Begins the draws of a tick: up to `n_rounds` of `n_samples` sequences of `n_steps` controls, the same for
    /// the same seed and tick.
    pub(crate) fn begin(
        &mut self,
        seed: u64,
        tick: u64,
        (n_rounds, n_samples): (usize, usize),
        n_steps: usize,
    ) {
        self.key = normal::key(seed, tick);
        (self.n_samples, self.n_steps, self.n_drawn) = (n_samples, n_steps, 0);
        let n = n_rounds * n_steps * padded(n_samples);
        self.first.resize(n, 0.0);
        self.second.resize(n, 0.0);
    }

    /// The instructions that it is drawn with.
    pub(crate) fn isa(&self) -> Isa {
        self.isa
    }

    /// Draws of one round for one step.
    pub(crate) fn n_lanes(&self) -> usize {
        padded(self.n_samples)
    }

    fn n_round(&self) -> usize {
        self.n_steps * self.n_lanes()
    }

    /// Sees to it that the first `n_rounds` are drawn.
    pub(crate) fn draw(&mut self, n_rounds: usize) {
        let n_round = self.n_round();
        while self.n_drawn < n_rounds && (self.n_drawn + 1) * n_round <= self.first.len() && n_round > 0 {
            let range = self.n_drawn * n_round..(self.n_drawn + 1) * n_round;
            let (first, second) = (&mut self.first[range.clone()], &mut self.second[range.clone()]);
            // Whole vectors; the rest of a step's room belongs to no sample.
            let (n_lanes, n) = (padded(self.n_samples), self.n_samples.next_multiple_of(self.isa.n_floats()));
            let steps = first.chunks_exact_mut(n_lanes).zip(second.chunks_exact_mut(n_lanes));
            for (step, (first, second)) in steps.enumerate() {
                let from = (range.start + step * n_lanes) as u32;
                normal::fill(self.isa, self.key, from, &mut first[..n], &mut second[..n]);
            }
            if self.keeps_incumbent {
                for step in 0..self.n_steps {
                    let at = step * padded(self.n_samples);
                    (first[at], second[at]) = (0.0, 0.0);
                }
            }
            self.n_drawn += 1;
        }
    }

    /// The draws of one round, drawn before: [`Noise::n_lanes`] for each step.
    pub(crate) fn round(&self, round: usize) -> [&[f32]; 2] {
        debug_assert!(round < self.n_drawn);
        let range = round * self.n_round()..(round + 1) * self.n_round();
        [&self.first[range.clone()], &self.second[range]]
    }

    /// One draw of a round.
    #[inline]
    pub(crate) fn pair(&self, round: usize, step: usize, sample: usize) -> (f64, f64) {
        let at = round * self.n_round() + step * self.n_lanes() + sample;
        (f64::from(self.first[at]), f64::from(self.second[at]))
    }

    /// One sequence, drawn before; they are counted through all rounds.
    pub(crate) fn sequence(&self, idx: usize) -> impl Iterator<Item = (f64, f64)> + Clone + '_ {
        let (round, sample) = (idx / self.n_samples, idx % self.n_samples);
        debug_assert!(round < self.n_drawn);
        (0..self.n_steps).map(move |step| self.pair(round, step, sample))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_standard_normal_and_the_same_for_the_same_seed_and_tick() {
        let draw = |seed, tick| {
            let mut noise = Noise::default();
            noise.begin(seed, tick, (5, 100), 20);
            noise.draw(2);
            noise.draw(500);
            noise
        };
        let noise = draw(3, 9);
        let sequence = |noise: &Noise| noise.sequence(117).collect::<Vec<_>>();
        assert_eq!(sequence(&noise), sequence(&draw(3, 9)));
        assert_ne!(sequence(&noise), sequence(&draw(3, 10)));
        assert_ne!(sequence(&noise), sequence(&draw(4, 9)));
        let draws: Vec<(f64, f64)> = (0..500).flat_map(|idx| noise.sequence(idx)).collect();
        let n = 2.0 * draws.len() as f64;
        let mean = draws.iter().map(|(a, b)| a + b).sum::<f64>() / n;
        let square = draws.iter().map(|(a, b)| a * a + b * b).sum::<f64>() / n;
        assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.05, "{mean} {square}");
    }

    #[test]
    fn an_incumbent_that_is_kept_has_no_draws() {
        let mut noise = Noise::default().keeping_incumbents();
        noise.begin(3, 9, (2, 7), 4);
        noise.draw(2);
        assert!((0..2).all(|round| noise.sequence(7 * round).all(|pair| pair == (0.0, 0.0))));
        assert!(noise.sequence(8).all(|pair| pair.0 != 0.0));
    }
}
