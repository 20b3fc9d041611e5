//! The fast standard filter against the oracle, in random scenes.

use rand::{RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;

use super::*;
use crate::fast::Isa;

/// Boxes on a square, their raw signed distances as the peers compute them: positive outside, negative inside,
/// a jump of two cells in between.
fn scene(seed: u64, n_side: usize, n_layers: usize, one_anywhere_in: usize) -> Scene {
    let mut chance = Xoshiro256PlusPlus::seed_from_u64(seed);
    let layers_m = (0..n_layers)
        .map(|layer| {
            let n_boxes = if layer == 0 { n_side * n_side / 4000 } else { 1 };
            let boxes: Vec<[f64; 4]> = (0..n_boxes)
                .map(|_| {
                    let side = n_side as f64;
                    [
                        chance.random_range(0.0..side),
                        chance.random_range(0.0..side),
                        chance.random_range(1.0..8.0),
                        chance.random_range(1.0..8.0),
                    ]
                })
                .collect();
            (0..n_side * n_side)
                .map(|idx| {
                    let (x, y) = ((idx % n_side) as f64, (idx / n_side) as f64);
                    let to_box = |[bx, by, hx, hy]: &[f64; 4]| {
                        let (dx, dy) = ((x - bx).abs() - hx, (y - by).abs() - hy);
                        dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0)
                    };
                    let cells = boxes
                        .iter()
                        .map(to_box)
                        .fold(f64::INFINITY, f64::min)
                        .min(x.min(y).min(n_side as f64 - 1.0 - x));
                    (if cells > 0.0 { cells + 0.5 } else { cells - 0.5 } * CELL_M) as f32
                })
                .collect()
        })
        .collect();
    let mut scene = Scene { n_side, layers_m, states: vec![], primitives: vec![] };
    while scene.states.len() < 24 {
        let place = |c: &mut Xoshiro256PlusPlus| c.random_range(0.6..n_side as f64 * CELL_M - 0.6);
        let (x, y) = (place(&mut chance), place(&mut chance));
        let state = [
            x,
            y,
            chance.random_range(-3.1..3.1),
            chance.random_range(0.0..1.2),
            chance.random_range(-0.8..0.8),
            chance.random_range(-2.0..2.0),
        ];
        // Some anywhere, in violation too.
        if scene.states.len().is_multiple_of(one_anywhere_in)
            || oracle::margin(&scene, [x, y, 0.0, 0.0], 0.0) > 0.0
        {
            scene.states.push(state);
        }
    }
    for rate in 0..5 {
        scene.primitives.extend((0..5).map(|accel| [f64::from(rate - 2) / 2.0, f64::from(accel - 2) * 1.5]));
    }
    scene
}

fn agrees(seed: u64, n_layers: usize, n_steps: usize, isa: Isa, one_anywhere_in: usize) {
    let scene = scene(seed, 120, n_layers, one_anywhere_in);
    let sampling = Sampling { n_samples: 50, n_rounds: 2, n_steps, seed };
    let mut fast = StandardFilter::new(isa, &scene, sampling);
    for (tick, state) in scene.states.iter().enumerate() {
        fast.begin(tick as u64);
        let noise: Vec<(f64, f64)> =
            (0..2 * n_steps * 50).map(|k| fast.noise(k / (n_steps * 50), k / 50 % n_steps, k % 50)).collect();
        let (here, next, choice) =
            oracle::step(&scene, &sampling, *state, &|r, s, k| noise[(r * n_steps + s) * 50 + k]);
        let [x, y, yaw, v, ..] = *state;
        let found = fast.score([x, y, yaw, v], f64::INFINITY);
        assert!((found - here).abs() < 1e-6, "{isa:?} seed {seed} state {tick}: {found} for {here}");
        for (primitive, wanted) in scene.primitives.iter().zip(&next) {
            let found = fast.score_full(oracle::after([x, y, yaw, v], *primitive));
            assert!((found - wanted).abs() < 1e-6, "{isa:?} seed {seed} state {tick}: {found} for {wanted}");
        }
        for found in [fast.full(*state), fast.shipped(*state)] {
            assert!((found.v_m - here).abs() < 1e-6, "{isa:?} seed {seed} state {tick}");
            assert_eq!(found.primitive_idx, choice, "{isa:?} seed {seed} state {tick}: {here} {next:?}");
        }
    }
}

#[test]
fn full_and_shipped_score_and_choose_as_the_oracle_does() {
    for seed in 0..6 {
        for n_layers in [1, 4, 12] {
            agrees(seed, n_layers, 20, Isa::detect(), 6);
        }
    }
}

#[test]
fn every_instruction_set_decides_the_same() {
    for isa in Isa::available() {
        agrees(17, 4, 20, isa, 6);
        agrees(18, 8, 40, isa, 6);
    }
}

#[test]
fn among_and_inside_of_zones_where_often_no_primitive_keeps_enough_the_choice_is_the_oracles() {
    for seed in 20..26 {
        agrees(seed, 24, 20, Isa::detect(), 1);
    }
}
