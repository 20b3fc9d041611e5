//! scratch
use control::Isa;
use control::standard::{Sampling, Scene, StandardFilter};
use std::time::Instant;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (n, m): (usize, usize) = (a[1].parse().unwrap(), a[2].parse().unwrap());
    let reps: usize = a[3].parse().unwrap();
    let isa = a.get(4).map_or(Isa::detect(), |v| Isa::named(v).unwrap());
    let modes = a.get(5).cloned().unwrap_or("fs1m".into());
    let d = "/tmp/bench/filter/scene";
    let rd = |p: String| std::fs::read(p).unwrap();
    let scene = Scene::from_raw(
        (n, m),
        &rd(format!("{d}/sdf_{n}_{m}.f32")),
        &rd(format!("{d}/states_{n}_{m}.f32")),
        &rd(format!("{d}/prims.f32")),
    )
    .unwrap();
    let s = Sampling {
        n_samples: a.get(6).map_or(50, |v| v.parse().unwrap()),
        n_rounds: 2,
        n_steps: a.get(7).map_or(20, |v| v.parse().unwrap()),
        seed: 1,
    };
    let mut f = StandardFilter::new(isa, &scene, s);
    for mode in modes.chars() {
        let mut all = vec![];
        let mut by: Vec<Vec<f64>> = vec![vec![]; scene.states.len()];
        let mut sum = 0.0;
        let mut choice = 0;
        for rep in 0..(if mode == 'm' { 1 } else { reps }) {
            for k in 0..(if mode == 'm' { reps.min(30) } else { scene.states.len() }) {
                let i = (k * 37 + rep * 11) % scene.states.len();
                let st = scene.states[i];
                if mode != 'm' {
                    f.begin((rep * 64 + k) as u64);
                }
                let t = Instant::now();
                match mode {
                    'f' => {
                        let c = f.full(st);
                        sum += c.v_m;
                        choice += c.primitive_idx;
                    }
                    's' => {
                        let c = f.shipped(st);
                        sum += c.v_m;
                        choice += c.primitive_idx;
                    }
                    '1' => sum += f.score_full([st[0], st[1], st[2], st[3]]),
                    'm' => f.merge(),
                    _ => {}
                }
                let us = t.elapsed().as_secs_f64() * 1e6;
                all.push(us);
                by[i].push(us);
            }
        }
        let worst = by
            .iter_mut()
            .map(|t| {
                t.sort_by(f64::total_cmp);
                t.get(t.len() / 2).copied().unwrap_or(0.0)
            })
            .fold(0.0, f64::max);
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        all.sort_by(f64::total_cmp);
        println!(
            "{mode} {n} {m} {isa:?} mean {mean:.2} median {:.2} p99 {:.1} worst {worst:.1} V {:.6} choice {choice}",
            all[all.len() / 2],
            all[all.len() * 99 / 100],
            sum / all.len() as f64
        );
    }
}
