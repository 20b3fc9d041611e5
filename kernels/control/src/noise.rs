//! The chance in the score: standard normal draws, reproducible from a seed and the number of the tick.

use crate::fast::rollouts::Draws;
use crate::fast::sweep::padded;
use crate::fast::{Isa, normal};

/// Standard normal draws for the sampled sequences of one tick, shared by all its scores.
///
/// Lie as sweeps read them: round by round, step by step, sample by sample. A step is drawn when it is first
/// needed: most ticks are decided by full braking and need none, and most rounds by their first steps.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    isa: Isa,
    key: u64,
    n_samples: usize,
    n_steps: usize,
    /// Steps drawn of each round.
    n_drawn: Vec<usize>,
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
        let n_drawn = Vec::new();
        Noise { isa, key: 0, n_samples: 0, n_steps: 0, n_drawn, keeps_incumbent: false, first, second }
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
        (self.n_samples, self.n_steps) = (n_samples, n_steps);
        self.n_drawn.clear();
        self.n_drawn.resize(n_rounds, 0);
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
        for round in 0..n_rounds.min(self.n_drawn.len()) {
            self.draw_steps(round, self.n_steps);
        }
    }

    /// Sees to it that the first `n_steps` of a round are drawn.
    fn draw_steps(&mut self, round: usize, n_steps: usize) {
        let (n_lanes, n_drawn) = (self.n_lanes(), self.n_drawn[round]);
        if n_drawn >= n_steps || self.n_samples == 0 {
            return;
        }
        let from = round * self.n_round();
        let range = from + n_drawn * n_lanes..from + n_steps * n_lanes;
        let (first, second) = (&mut self.first[range.clone()], &mut self.second[range.clone()]);
        // The rest of a step's room belongs to no sample.
        let rows = (self.n_samples, n_lanes);
        normal::fill(self.isa, self.key, range.start as u32, rows, [&mut *first, &mut *second]);
        if self.keeps_incumbent {
            let incumbents = first.iter_mut().step_by(n_lanes).zip(second.iter_mut().step_by(n_lanes));
            incumbents.for_each(|(first, second)| (*first, *second) = (0.0, 0.0));
        }
        self.n_drawn[round] = n_steps;
    }

    /// The draws of one round, step by step.
    pub(crate) fn steps_of(&mut self, round: usize) -> Round<'_> {
        Round { noise: self, round }
    }

    /// The draws of one round, drawn before: [`Noise::n_lanes`] for each step.
    pub(crate) fn round(&self, round: usize) -> [&[f32]; 2] {
        debug_assert!(self.n_drawn[round] == self.n_steps);
        let range = round * self.n_round()..(round + 1) * self.n_round();
        [&self.first[range.clone()], &self.second[range]]
    }

    /// One draw of a round, drawn before.
    #[inline(always)]
    pub(crate) fn pair(&self, round: usize, step: usize, sample: usize) -> (f64, f64) {
        let at = round * self.n_round() + step * self.n_lanes() + sample;
        (f64::from(self.first[at]), f64::from(self.second[at]))
    }

    /// One sequence; they are counted through all rounds. What was not drawn before is drawn for it alone.
    pub(crate) fn sequence(&self, idx: usize) -> impl Iterator<Item = (f64, f64)> + Clone + '_ {
        let (round, sample) = (idx / self.n_samples, idx % self.n_samples);
        let n_drawn = self.n_drawn[round];
        (0..self.n_steps).map(move |step| match step < n_drawn {
            true => self.pair(round, step, sample),
            false => self.pair_drawn_alone(round, step, sample),
        })
    }

    fn pair_drawn_alone(&self, round: usize, step: usize, sample: usize) -> (f64, f64) {
        if self.keeps_incumbent && sample == 0 {
            return (0.0, 0.0);
        }
        let (first, second) =
            normal::at(self.key, (round * self.n_round() + step * self.n_lanes() + sample) as u32);
        (f64::from(first), f64::from(second))
    }
}

/// The draws of one round, made step by step.
pub(crate) struct Round<'a> {
    noise: &'a mut Noise,
    round: usize,
}

impl Draws for Round<'_> {
    fn of_step(&mut self, step: usize) -> [&[f32]; 2] {
        let Round { noise, round } = self;
        noise.draw_steps(*round, step + 1);
        let from = *round * noise.n_round() + step * noise.n_lanes();
        let range = from..from + noise.n_lanes();
        [&noise.first[range.clone()], &noise.second[range]]
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
    fn a_sequence_is_the_same_whether_drawn_with_its_round_or_alone() {
        for mut noise in [Noise::default(), Noise::default().keeping_incumbents()] {
            noise.begin(3, 9, (3, 50), 20);
            let all = |noise: &Noise| (0..150).flat_map(|idx| noise.sequence(idx)).collect::<Vec<_>>();
            let alone = all(&noise);
            let _ = noise.steps_of(1).of_step(6);
            let partly = all(&noise);
            noise.draw(3);
            assert!(alone == all(&noise) && partly == alone);
        }
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
