//! Standard normal draws by the thousand, a microsecond for each thousand or two.
//!
//! Counter-based: a draw depends on a key and its place alone, so any part can be drawn without the rest. A
//! 32-bit mix of the place gives uniform numbers, Box and Muller (1958) makes them normal, with polynomials
//! in place of the logarithm and the sine. Within 1e-5 of the exact transform: sampling needs no more.

use super::isa::{Isa, Work};

/// The key of one tick's draws from a seed; `splitmix64`, Steele et al., OOPSLA 2014.
pub(crate) fn key(seed: u64, tick: u64) -> u64 {
    let mut z = seed ^ tick.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(0x1405_7B7E_F767_814F);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// The two draws of one place, as `fill` draws them.
pub(crate) fn at(key: u64, place: u32) -> (f32, f32) {
    drawn(key, place)
}

/// Fills `first` and `second` with independent standard normal draws, those of the places from `from` on: of each
/// `n_apart` places the first `n`, what lies between belongs to none.
pub(crate) fn fill(
    isa: Isa,
    key: u64,
    from: u32,
    (n, n_apart): (usize, usize),
    [first, second]: [&mut [f32]; 2],
) {
    isa.run(Fill { n_vector: isa.n_floats(), key, from, n, n_apart, first, second });
}

struct Fill<'a> {
    n_vector: usize,
    key: u64,
    from: u32,
    n: usize,
    n_apart: usize,
    first: &'a mut [f32],
    second: &'a mut [f32],
}

/// Draws made together where a row's last ones are no whole vector.
const N_REST: usize = 64;

impl Work for Fill<'_> {
    type Output = ();
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let Fill { n_vector, key, from, n, n_apart, first, second } = self;
        let n_apart = n_apart.max(1);
        // A single row is filled up to whole vectors.
        let is_single = first.len() <= n_apart;
        let n_whole = if is_single { n.next_multiple_of(n_vector) } else { n / n_vector * n_vector };
        for (row, (first, second)) in first.chunks_mut(n_apart).zip(second.chunks_mut(n_apart)).enumerate() {
            let from = from.wrapping_add((row * n_apart) as u32);
            let n = n_whole.min(first.len()).min(second.len());
            let (first, second) = (&mut first[..n], &mut second[..n]);
            for place in 0..n {
                (first[place], second[place]) = drawn(key, from.wrapping_add(place as u32));
            }
        }
        // The last ones of several rows are whole vectors together.
        let n_places = first.len().min(second.len());
        let mut rest = (0..n_places).step_by(n_apart).flat_map(|row| row + n_whole..(row + n).min(n_places));
        loop {
            let (mut places, mut n_rest) = ([0_u32; N_REST], 0_usize);
            for (to, place) in places.iter_mut().zip(&mut rest) {
                (*to, n_rest) = (place as u32, n_rest + 1);
            }
            if n_rest == 0 {
                break;
            }
            let mut draws = [[0.0; N_REST]; 2];
            let [first_draws, second_draws] = &mut draws;
            for k in 0..n_rest.next_multiple_of(n_vector).min(N_REST) {
                (first_draws[k], second_draws[k]) = drawn(key, from.wrapping_add(places[k]));
            }
            for (k, place) in places[..n_rest].iter().enumerate() {
                (first[*place as usize], second[*place as usize]) = (draws[0][k], draws[1][k]);
            }
        }
    }
}

#[inline(always)]
fn drawn(key: u64, place: u32) -> (f32, f32) {
    let (low, high) = (key as u32, (key >> 32) as u32);
    let a = mixed(mixed(place ^ low).wrapping_add(high));
    let b = mixed(mixed(place ^ high).wrapping_add(low ^ 0x9E37_79B9));
    // In (0, 1]: 24 bits and a half step.
    let share = ((a >> 8) as i32 as f32 + 0.5) * (1.0 / 16_777_216.0);
    let radius = (-2.0 * ln(share)).sqrt();
    // In [-½, ½): a signed fraction of a turn.
    let turn = (b as i32 >> 8) as f32 * (1.0 / 16_777_216.0);
    let (sin, cos) = sin_cos_of_turn(turn);
    (radius * cos, radius * sin)
}

/// A bijection of 32 bits without visible structure ("lowbias32", Wellons 2018).
#[inline(always)]
fn mixed(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7FEB_352D);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846C_A68B);
    x ^ (x >> 16)
}

/// Natural logarithm of a positive normal number, within 1e-6 (relative to 1 or the result).
#[inline(always)]
fn ln(x: f32) -> f32 {
    // x = m · 2^e with m in [√½, √2).
    let bits = x.to_bits().wrapping_sub(0x3F35_04F3);
    let exponent = (bits as i32 >> 23) as f32;
    let m = f32::from_bits((bits & 0x007F_FFFF).wrapping_add(0x3F35_04F3));
    // ln m = 2 artanh(z), z = (m − 1)/(m + 1), |z| ≤ 0.172: the series to z⁹.
    let z = (m - 1.0) / (m + 1.0);
    let square = z * z;
    let series = 2.0 + square * (2.0 / 3.0 + square * (0.4 + square * (2.0 / 7.0 + square * (2.0 / 9.0))));
    exponent * std::f32::consts::LN_2 + z * series
}

/// Sine and cosine of a fraction of a turn in [-½, ½], within 1e-5.
#[inline(always)]
fn sin_cos_of_turn(turn: f32) -> (f32, f32) {
    // Of the half angle, within a quarter turn either way, then doubled.
    let half = turn * std::f32::consts::PI;
    let square = half * half;
    let sin =
        half * series(square, [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0]);
    let cos = series(square, [-1.0 / 2.0, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0]);
    (2.0 * sin * cos, cos * cos - sin * sin)
}

/// 1 + c₀ x + c₁ x² + …, by Horner's rule.
#[inline(always)]
fn series(x: f32, [a, b, c, d, e]: [f32; 5]) -> f32 {
    1.0 + x * (a + x * (b + x * (c + x * (d + x * e))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn many(isa: Isa, key: u64, n: usize) -> (Vec<f32>, Vec<f32>) {
        let (mut a, mut b) = (vec![0.0; n], vec![0.0; n]);
        fill(isa, key, 0, (n, n), [&mut a, &mut b]);
        (a, b)
    }

    #[test]
    fn draws_are_standard_normal_and_independent() {
        let (a, b) = many(Isa::detect(), key(3, 9), 200_000);
        let n = a.len() as f64;
        let moment = |of: &dyn Fn(f64, f64) -> f64| {
            a.iter().zip(&b).map(|(a, b)| of(f64::from(*a), f64::from(*b))).sum::<f64>() / n
        };
        for (found, wanted) in [
            (moment(&|a, _| a), 0.0),
            (moment(&|_, b| b), 0.0),
            (moment(&|a, _| a * a), 1.0),
            (moment(&|_, b| b * b), 1.0),
            (moment(&|a, b| a * b), 0.0),
            (moment(&|a, _| a.powi(4)) / 3.0, 1.0),
            (moment(&|a, _| f64::from(a > 1.959_964)), 0.025),
            (moment(&|_, b| f64::from(b < -1.0)), 0.158_655),
        ] {
            assert!((found - wanted).abs() < 0.02 * (1.0_f64).min(wanted.abs() + 0.5), "{found} {wanted}");
        }
        let lagged = a.windows(2).map(|w| f64::from(w[0] * w[1])).sum::<f64>() / n;
        assert!(lagged.abs() < 0.01, "{lagged}");
    }

    #[test]
    fn every_instruction_set_draws_the_same_bits_and_other_keys_other_ones() {
        let wanted = many(Isa::detect(), key(3, 9), 1000);
        for isa in Isa::available() {
            assert_eq!(many(isa, key(3, 9), 1000), wanted, "{isa:?}");
        }
        let one_by_one: (Vec<f32>, Vec<f32>) = (0..1000).map(|place| at(key(3, 9), place)).unzip();
        assert_eq!(one_by_one, wanted);
        for isa in Isa::available() {
            let (mut a, mut b) = (vec![0.0; 1000], vec![0.0; 1000]);
            fill(isa, key(3, 9), 0, (43, 50), [&mut a, &mut b]);
            let is_drawn = |place: usize| place % 50 < 43;
            assert!((0..1000).all(|k| a[k] == if is_drawn(k) { wanted.0[k] } else { 0.0 }), "{isa:?}");
            assert!((0..1000).all(|k| b[k] == if is_drawn(k) { wanted.1[k] } else { 0.0 }), "{isa:?}");
        }
        assert_ne!(many(Isa::detect(), key(3, 10), 1000), wanted);
        assert_ne!(many(Isa::detect(), key(4, 9), 1000), wanted);
    }
}
