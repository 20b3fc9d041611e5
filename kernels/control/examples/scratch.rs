//! scratch
use control::standard::Scene;
use control::standard::service::starts;
use control::{Filter, FilterConfig, Method};
use geometry::Profile;
use std::time::{Duration, Instant};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let (n, m) = (a[1].parse().unwrap(), a[2].parse().unwrap());
    let reps: usize = a[3].parse().unwrap();
    let ns: usize = a.get(4).map_or(50, |v| v.parse().unwrap());
    let h: usize = a.get(5).map_or(20, |v| v.parse().unwrap());
    let d = "/tmp/bench/filter/scene";
    let rd = |p: String| std::fs::read(p).unwrap();
    let scene = Scene::from_raw(
        (n, m),
        &rd(format!("{d}/sdf_{n}_{m}.f32")),
        &rd(format!("{d}/states_{n}_{m}.f32")),
        &rd(format!("{d}/prims.f32")),
    )
    .unwrap();
    let starts = starts(&scene).unwrap();
    let profile = Profile::sim();
    let config = FilterConfig {
        method: Method::SmoothBlending,
        n_samples: ns,
        n_rounds: 2,
        n_steps: h,
        latency_s: 0.0,
        ..FilterConfig::for_profile(&profile)
    };
    let mut rows = vec![];
    let mut all = vec![];
    let mut filters: Vec<Filter> =
        starts.iter().map(|_| Filter::new(config.clone(), &profile).unwrap()).collect();
    let mut times: Vec<Vec<f64>> = vec![vec![]; starts.len()];
    let mut said = vec![String::new(); starts.len()];
    let mut acts: Vec<std::collections::BTreeMap<String, usize>> = vec![Default::default(); starts.len()];
    let only: Option<usize> = std::env::var("ONLY").ok().map(|v| v.parse().unwrap());
    for rep in 0..reps {
        for k in 0..starts.len() {
            let i = (k * 37 + rep * 11) % starts.len();
            if only.is_some_and(|o| o != i) {
                continue;
            }
            let s = &starts[i];
            let t = Instant::now();
            let dec = filters[i].step(Duration::from_millis(50), s.state, s.nominal, &s.world);
            let us = t.elapsed().as_secs_f64() * 1e6;
            times[i].push(us);
            all.push(us);
            *acts[i].entry(format!("{:?}", dec.action)).or_default() += 1;
            said[i] =
                format!("{:?} V {:.3} sent {:.3} {}", dec.command, dec.v_safe_m, dec.v_sent_m, dec.words);
        }
    }
    for i in 0..starts.len() {
        if times[i].is_empty() {
            continue;
        }
        times[i].sort_by(f64::total_cmp);
        rows.push((times[i][times[i].len() / 2], i));
    }
    rows.sort_by(|a, b| a.0.total_cmp(&b.0));
    if std::env::var("ROWS").is_ok() {
        for (us, i) in &rows {
            println!("{i:3} {us:8.1} {:?} {}", acts[*i], said[*i]);
        }
    }
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    all.sort_by(f64::total_cmp);
    println!(
        "mean {mean:.1} median {:.1} p99 {:.1} max-of-medians {:.1}",
        all[all.len() / 2],
        all[all.len() * 99 / 100],
        rows.last().unwrap().0
    );
}
