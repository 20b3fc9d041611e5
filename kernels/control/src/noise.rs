//! The chance in the score: standard normal draws, reproducible from a seed and the number of the tick.

use crate::fast::{Isa, normal};

/// Standard normal draws for the sampled sequences of one tick, shared by all its scores.
///
/// Drawn when they are first needed: most ticks are decided by full braking and need none.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    isa: Isa,
    key: u64,
    n_steps: usize,
    n_drawn: usize,
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
        Noise { isa, key: 0, n_steps: 0, n_drawn: 0, first: Vec::new(), second: Vec::new() }
    }

    /// Begins the draws of a tick: up to `n_sequences` of `n_steps` controls, the same for the same seed and tick.
    pub(crate) fn begin(&mut self, seed: u64, tick: u64, n_sequences: usize, n_steps: usize) {
        self.key = normal::key(seed, tick);
        self.n_steps = n_steps;
        self.n_drawn = 0;
        self.first.resize(n_sequences * n_steps, 0.0);
        self.second.resize(n_sequences * n_steps, 0.0);
    }

    /// Sees to it that the first `n_sequences` are drawn.
    pub(crate) fn draw(&mut self, n_sequences: usize) {
        let n_wanted = (n_sequences * self.n_steps).min(self.first.len());
        if n_wanted > self.n_drawn {
            let range = self.n_drawn..n_wanted;
            let (first, second) = (&mut self.first[range.clone()], &mut self.second[range]);
            normal::fill(self.isa, self.key, self.n_drawn as u32, first, second);
            self.n_drawn = n_wanted;
        }
    }

    /// One sequence, drawn before.
    pub(crate) fn sequence(&self, idx: usize) -> impl Iterator<Item = (f64, f64)> + Clone + '_ {
        let range = idx * self.n_steps..(idx + 1) * self.n_steps;
        debug_assert!(range.end <= self.n_drawn);
        let pairs = self.first[range.clone()].iter().zip(&self.second[range]);
        pairs.map(|(first, second)| (f64::from(*first), f64::from(*second)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_standard_normal_and_the_same_for_the_same_seed_and_tick() {
        let draw = |seed, tick| {
            let mut noise = Noise::default();
            noise.begin(seed, tick, 500, 20);
            noise.draw(7);
            noise.draw(500);
            noise
        };
        let noise = draw(3, 9);
        let sequence = |noise: &Noise| noise.sequence(17).collect::<Vec<_>>();
        assert_eq!(sequence(&noise), sequence(&draw(3, 9)));
        assert_ne!(sequence(&noise), sequence(&draw(3, 10)));
        assert_ne!(sequence(&noise), sequence(&draw(4, 9)));
        let draws: Vec<(f64, f64)> = (0..500).flat_map(|idx| noise.sequence(idx)).collect();
        let n = 2.0 * draws.len() as f64;
        let mean = draws.iter().map(|(a, b)| a + b).sum::<f64>() / n;
        let square = draws.iter().map(|(a, b)| a * a + b * b).sum::<f64>() / n;
        assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.05, "{mean} {square}");
    }
}
