//! The chance in the score: standard normal draws, reproducible from a seed and the number of the tick.

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Standard normal draws for the sampled sequences of one tick, shared by all its scores.
#[derive(Clone, Debug, Default)]
pub(crate) struct Noise {
    draws: Vec<(f64, f64)>,
    n_steps: usize,
}

impl Noise {
    /// Draws for `n_sequences` of `n_steps` controls; the same for the same seed and tick.
    pub(crate) fn draw(&mut self, seed: u64, tick: u64, n_sequences: usize, n_steps: usize) {
        let mut chance = Xoshiro256PlusPlus::seed_from_u64(seed ^ tick.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        self.n_steps = n_steps;
        self.draws.clear();
        self.draws.extend((0..n_sequences * n_steps).map(|_| normal_pair(&mut chance)));
    }

    pub(crate) fn sequence(&self, idx: usize) -> &[(f64, f64)] {
        &self.draws[idx * self.n_steps..(idx + 1) * self.n_steps]
    }
}

/// Two independent standard normal draws (Box and Muller 1958).
fn normal_pair(chance: &mut Xoshiro256PlusPlus) -> (f64, f64) {
    let radius = (-2.0 * (1.0 - chance.random::<f64>()).ln()).sqrt();
    let (sin, cos) = (std::f64::consts::TAU * chance.random::<f64>()).sin_cos();
    (radius * cos, radius * sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_are_standard_normal_and_the_same_for_the_same_seed_and_tick() {
        let draw = |seed, tick| {
            let mut noise = Noise::default();
            noise.draw(seed, tick, 500, 20);
            noise
        };
        let noise = draw(3, 9);
        assert_eq!(noise.sequence(17), draw(3, 9).sequence(17));
        assert_ne!(noise.sequence(17), draw(3, 10).sequence(17));
        assert_ne!(noise.sequence(17), draw(4, 9).sequence(17));
        let n = 2.0 * noise.draws.len() as f64;
        let mean = noise.draws.iter().map(|(a, b)| a + b).sum::<f64>() / n;
        let square = noise.draws.iter().map(|(a, b)| a * a + b * b).sum::<f64>() / n;
        assert!(mean.abs() < 0.03 && (square - 1.0).abs() < 0.05, "{mean} {square}");
    }
}
