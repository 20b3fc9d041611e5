//! Times the standard problem.
#![allow(clippy::print_stdout, clippy::disallowed_methods, reason = "scratch")]
use control::Isa;
use control::standard::{Sampling, Scene, StandardFilter};
use std::time::Instant;

fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (dir, n, m, h) = (
        &a[1],
        a[2].parse::<usize>().unwrap(),
        a[3].parse::<usize>().unwrap(),
        a[4].parse::<usize>().unwrap(),
    );
    let read = |f: String| std::fs::read(format!("{dir}/{f}")).unwrap();
    let scene = Scene::from_raw(
        (n, m),
        &read(format!("sdf_{n}_{m}.f32")),
        &read(format!("states_{n}_{m}.f32")),
        &read("prims.f32".into()),
    )
    .unwrap();
    let which = std::env::var("ISA").ok();
    for isa in Isa::available().into_iter().filter(|i| which.as_ref().is_none_or(|w| w == i.name())) {
        let sampling = Sampling { n_samples: 50, n_rounds: 2, n_steps: h, seed: 1 };
        let t = Instant::now();
        let mut f = StandardFilter::new(isa, &scene, sampling);
        let mut merge = t.elapsed().as_secs_f64() * 1e6;
        for _ in 0..5 {
            let t = Instant::now();
            f.merge();
            merge = merge.min(t.elapsed().as_secs_f64() * 1e6);
        }
        {
            let starts = control::standard::service::starts(&scene).unwrap();
            let profile = geometry::Profile::sim();
            let config = control::FilterConfig {
                n_steps: h,
                latency_s: 0.0,
                ..control::FilterConfig::for_profile(&profile)
            };
            let mut filters: Vec<_> =
                starts.iter().map(|_| control::Filter::new(config.clone(), &profile).unwrap()).collect();
            let mut ts = Vec::new();
            let mut by = vec![f64::INFINITY; starts.len()];
            let mut actions = std::collections::BTreeMap::new();
            for rep in 0..std::env::var("REPS").map_or(40, |r| r.parse().unwrap()) {
                for k in 0..starts.len() {
                    let k = (k * 37 + rep) % starts.len();
                    let t = Instant::now();
                    let d = filters[k].step(
                        std::time::Duration::from_millis(50),
                        starts[k].state,
                        starts[k].nominal,
                        &starts[k].world,
                    );
                    let t = t.elapsed().as_secs_f64() * 1e6;
                    ts.push(t);
                    by[k] = by[k].min(t);
                    *actions.entry(format!("{:?}", d.action)).or_insert(0) += 1;
                }
            }
            ts.sort_by(f64::total_cmp);
            println!(
                "service mean={:.1} med={:.1} mean_min={:.1} max_min={:.1} {actions:?}",
                ts.iter().sum::<f64>() / ts.len() as f64,
                ts[ts.len() / 2],
                by.iter().sum::<f64>() / by.len() as f64,
                by.iter().fold(0.0_f64, |a, b| a.max(*b))
            );
        }
        let only = std::env::args().nth(5);
        if only.as_deref() == Some("service") {
            return;
        }
        let modes: Vec<String> =
            only.map_or(["full", "shipped", "one_full", "one"].map(String::from).to_vec(), |m| vec![m]);
        for mode in modes.iter().map(String::as_str) {
            let mut ts = Vec::new();
            let mut v = 0.0;
            let mut by_state = vec![f64::INFINITY; scene.states.len()];
            for rep in 0..40 {
                for k in 0..scene.states.len() {
                    let k = (k * 37 + rep) % scene.states.len();
                    let s = scene.states[k];
                    let t = Instant::now();
                    f.begin((rep * 64 + k) as u64);
                    v += match mode {
                        "full" => f.full(s).v_m,
                        "shipped" => f.shipped(s).v_m,
                        "one_full" => f.score_full([s[0], s[1], s[2], s[3]]),
                        _ => f.score([s[0], s[1], s[2], s[3]], f64::INFINITY),
                    };
                    let t = t.elapsed().as_secs_f64() * 1e6;
                    by_state[k] = by_state[k].min(t);
                    ts.push(t);
                }
            }
            ts.sort_by(f64::total_cmp);
            let mean: f64 = ts.iter().sum::<f64>() / ts.len() as f64;
            let q = |p: f64| ts[((ts.len() - 1) as f64 * p) as usize];
            println!(
                "{isa:?} {mode} n={n} m={m} h={h} mean={mean:.1} min={:.1} med={:.1} p99={:.1} max={:.1} mean_min={:.1} max_min={:.1} meanV={:.4} merge={merge:.0}",
                ts[0],
                q(0.5),
                q(0.99),
                q(1.0),
                by_state.iter().sum::<f64>() / by_state.len() as f64,
                by_state.iter().fold(0.0_f64, |a, b| a.max(*b)),
                v / ts.len() as f64
            );
        }
    }
}
