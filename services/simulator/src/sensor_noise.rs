//! What real sensors add to what is there: depth that scatters with distance, holes in it, ranges that
//! scatter. All of it is off by default, and all of it is drawn from a seed.

use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

/// How much the sensors err.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct SensorNoise {
    /// Standard deviation of depth, metres at 1 m; it grows with the square of the distance.
    pub depth_m_at_1_m: f64,
    /// Share of depth pixels that are missing.
    pub depth_dropout: f64,
    /// Standard deviation of LiDAR ranges, metres.
    pub range_m: f64,
}

/// The random numbers of one frame of one sensor: the same seed, stream and frame give the same draws.
#[must_use]
pub fn draws(seed: u64, stream: &str, frame: u64) -> Xoshiro256PlusPlus {
    // FNV-1a over all three: neighbouring frames share nothing.
    let bytes = seed.to_le_bytes().into_iter().chain(stream.bytes()).chain(frame.to_le_bytes());
    let state =
        bytes.fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    Xoshiro256PlusPlus::seed_from_u64(state)
}

/// A draw from the standard normal distribution (Box & Muller 1958).
fn normal(random: &mut impl Rng) -> f64 {
    let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
    radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
}

impl SensorNoise {
    /// Spoils a depth image, millimetres, in place; 0 stays 0.
    pub fn spoil_depth(&self, depth_mm: &mut [u16], random: &mut impl Rng) {
        if self.depth_m_at_1_m <= 0.0 && self.depth_dropout <= 0.0 {
            return;
        }
        for mm in depth_mm.iter_mut().filter(|mm| **mm > 0) {
            let depth_m = f64::from(*mm) / 1000.0;
            let spoilt_m = depth_m + normal(random) * self.depth_m_at_1_m * depth_m * depth_m;
            let dropped = random.random::<f64>() < self.depth_dropout;
            *mm = if dropped { 0 } else { (spoilt_m * 1000.0).round().clamp(1.0, 65535.0) as u16 };
        }
    }

    /// Spoils LiDAR ranges, metres, in place; what is out of reach stays so.
    pub fn spoil_ranges(&self, ranges_m: &mut [f32], random: &mut impl Rng) {
        if self.range_m <= 0.0 {
            return;
        }
        for range_m in ranges_m.iter_mut().filter(|r| r.is_finite()) {
            *range_m = (f64::from(*range_m) + normal(random) * self.range_m).max(0.0) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOISE: SensorNoise = SensorNoise { depth_m_at_1_m: 0.002, depth_dropout: 0.1, range_m: 0.01 };

    #[test]
    fn no_noise_changes_nothing() {
        let mut depth_mm = vec![0, 1, 1500, 65535];
        let mut ranges_m = vec![0.2, 3.0, f32::INFINITY];
        SensorNoise::default().spoil_depth(&mut depth_mm, &mut draws(1, "depth", 1));
        SensorNoise::default().spoil_ranges(&mut ranges_m, &mut draws(1, "scan", 1));
        assert_eq!((depth_mm, ranges_m), (vec![0, 1, 1500, 65535], vec![0.2, 3.0, f32::INFINITY]));
    }

    #[test]
    fn the_same_seed_gives_the_same_frame_and_the_next_frame_another() {
        let spoilt = |seed, frame| {
            let mut depth_mm = vec![3000; 500];
            NOISE.spoil_depth(&mut depth_mm, &mut draws(seed, "depth", frame));
            depth_mm
        };
        assert_eq!(spoilt(7, 1), spoilt(7, 1));
        assert_ne!(spoilt(7, 1), spoilt(7, 2));
        assert_ne!(spoilt(7, 1), spoilt(8, 1));
    }

    #[test]
    fn depth_scatters_with_the_square_of_the_distance_and_drops_out_as_often_as_told() {
        let n = 40_000;
        let check = |depth_m: f64| {
            let mut depth_mm = vec![(depth_m * 1000.0) as u16; n];
            NOISE.spoil_depth(&mut depth_mm, &mut draws(3, "depth", 5));
            let kept: Vec<f64> =
                depth_mm.iter().filter(|mm| **mm > 0).map(|mm| f64::from(*mm) / 1000.0).collect();
            let dropped = 1.0 - kept.len() as f64 / n as f64;
            let variance = kept.iter().map(|d| (d - depth_m).powi(2)).sum::<f64>() / kept.len() as f64;
            let wanted = NOISE.depth_m_at_1_m * depth_m * depth_m;
            assert!((dropped - 0.1).abs() < 0.01, "{dropped}");
            assert!((variance.sqrt() / wanted - 1.0).abs() < 0.05, "{} {wanted}", variance.sqrt());
        };
        check(2.0);
        check(4.0);
    }
}
