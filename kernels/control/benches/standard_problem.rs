//! Times one step of the standard problem, in a scene made here: full, as shipped, one score, and the whole step of
//! the filter that drives a robot.

#![allow(missing_docs, reason = "the macros of criterion make undocumented functions")]

use std::time::Duration;

use control::standard::service::{Start, starts};
use control::standard::{Sampling, Scene, StandardFilter};
use control::{Filter, FilterConfig, Isa, Method};
use criterion::{Criterion, criterion_group, criterion_main};
use geometry::Profile;

const N_SIDE: usize = 200;

/// Boxes in a square room, two exclusions and a slow zone; robots that drive past them.
fn scene() -> Scene {
    let to_box = |x: f64, y: f64, [bx, by, half]: [f64; 3]| {
        let (dx, dy) = ((x - bx).abs() - half, (y - by).abs() - half);
        dx.max(0.0).hypot(dy.max(0.0)) + dx.max(dy).min(0.0)
    };
    let layer = |boxes: &[[f64; 3]]| {
        (0..N_SIDE * N_SIDE)
            .map(|idx| {
                let (x, y) = ((idx % N_SIDE) as f64 * 0.05, (idx / N_SIDE) as f64 * 0.05);
                boxes.iter().map(|of| to_box(x, y, *of)).fold(f64::INFINITY, f64::min) as f32
            })
            .collect()
    };
    let walls = [[2.0, 7.0, 0.3], [5.0, 5.0, 0.4], [8.0, 2.5, 0.25], [6.5, 8.0, 0.35]];
    let layers_m =
        vec![layer(&walls), layer(&[[3.0, 3.0, 0.3]]), layer(&[[7.5, 5.5, 0.2]]), layer(&[[4.0, 7.5, 0.4]])];
    let states = (0..64).map(|k| {
        let turn = f64::from(k) * 0.7;
        let speed_m_s = 0.2 + f64::from(k % 8) * 0.1;
        [
            5.0 + 1.5 * turn.cos(),
            5.0 + 1.5 * turn.sin(),
            turn * 1.7,
            speed_m_s,
            turn.sin() * 0.8,
            turn.cos() * 2.0,
        ]
    });
    let primitives = (0..25).map(|k| [f64::from(k % 5 - 2) / 2.0, f64::from(k / 5 - 2) * 1.5]);
    Scene { n_side: N_SIDE, layers_m, states: states.collect(), primitives: primitives.collect() }
}

fn standard_problem(criterion: &mut Criterion) {
    let scene = scene();
    let sampling = Sampling { n_samples: 50, n_rounds: 2, n_steps: 20, seed: 1 };
    for isa in Isa::available() {
        let mut filter = StandardFilter::new(isa, &scene, sampling);
        let mut tick = 0_u64;
        let mut next = |filter: &mut StandardFilter<'_>| {
            tick += 1;
            filter.begin(tick);
            scene.states[(tick as usize * 37) % scene.states.len()]
        };
        criterion.bench_function(&format!("smooth blending, full, {isa:?}"), |b| {
            b.iter(|| {
                let state = next(&mut filter);
                filter.full(state)
            });
        });
        criterion.bench_function(&format!("smooth blending, shipped, {isa:?}"), |b| {
            b.iter(|| {
                let state = next(&mut filter);
                filter.shipped(state)
            });
        });
        criterion.bench_function(&format!("least restrictive, shipped, {isa:?}"), |b| {
            b.iter(|| {
                let [x, y, yaw, v, ..] = next(&mut filter);
                filter.score([x, y, yaw, v], f64::INFINITY)
            });
        });
        criterion.bench_function(&format!("merge of the layers, {isa:?}"), |b| b.iter(|| filter.merge()));
    }
}

/// The whole step: live scan, certificate and words included; a filter for each state.
fn service(criterion: &mut Criterion) {
    let scene = scene();
    let profile = Profile::sim();
    let Ok(starts) = starts(&scene) else { return };
    for isa in Isa::available() {
        for method in [Method::SmoothBlending, Method::LeastRestrictive] {
            let config = FilterConfig { method, latency_s: 0.0, ..FilterConfig::for_profile(&profile) };
            let filter = |_: &Start| Filter::new(config.clone(), &profile).map(|filter| filter.on(isa));
            let Ok(mut filters) = starts.iter().map(filter).collect::<Result<Vec<Filter>, _>>() else {
                return;
            };
            let mut tick = 0_usize;
            criterion.bench_function(&format!("service, {method:?}, {isa:?}"), |b| {
                b.iter(|| {
                    tick += 1;
                    let idx = (tick * 37) % starts.len();
                    let Start { state, nominal, world } = &starts[idx];
                    filters[idx].step(Duration::from_millis(50), *state, *nominal, world)
                });
            });
        }
    }
}

criterion_group!(benches, standard_problem, service);
criterion_main!(benches);
