//! `heedway bench filter`: the standard problem from its raw files, timed, one row a line.
//!
//! How to reproduce the comparison with other implementations is in `docs/benchmarks.md`. Not here: the
//! problem itself (`control::standard`).

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::Args;
use control::standard::service::{Start, starts};
use control::standard::{Sampling, Scene, StandardFilter};
use control::{Filter, FilterConfig, Isa, Method};
use geometry::Profile;
use serde::Serialize;
use service::Clock;

/// Passes over all states that a row takes at least, and at most.
const N_PASSES: (usize, usize) = (5, 60);
/// No further pass begins after this.
const ROW_TIME_MAX: Duration = Duration::from_secs(2);
/// Merges that the row of the merge is the median of.
const N_MERGES: usize = 15;
/// Time between ticks that the service's step is told.
const TICK: Duration = Duration::from_millis(50);

/// Arguments of `heedway bench filter`.
#[derive(Args, Debug)]
pub struct Arguments {
    /// Folder with `sdf_{n}_{M}.f32`, `states_{n}_{M}.f32` and `prims.f32`.
    #[arg(long)]
    scene: PathBuf,
    /// Sequences sampled in a round.
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    n: u32,
    /// Rounds.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=20))]
    r: u32,
    /// Steps of a rollout.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=400))]
    h: u32,
    /// Only grids of this many points a side.
    #[arg(long)]
    grid: Option<usize>,
    /// Only files of this many layers.
    #[arg(long)]
    layers: Option<usize>,
    /// These instructions instead of the widest that the processor has: avx512, avx2, neon, scalar.
    #[arg(long)]
    isa: Option<String>,
    /// Other states than those beside the fields.
    #[arg(long)]
    states: Option<PathBuf>,
    /// Seed of the noise and of the order of states.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object a line instead of a table.
    #[arg(long)]
    json: bool,
}

/// One row. Times in microseconds; `max_us` is the slowest state's median over the passes, which a machine
/// that does other things beside does not blur. The row of the merge has no score: its `mean_v` is 0.
#[derive(Clone, Debug, Serialize)]
struct Row {
    variant: &'static str,
    mode: &'static str,
    isa: &'static str,
    n: u32,
    r: u32,
    h: u32,
    layers: usize,
    grid: usize,
    mean_us: f64,
    median_us: f64,
    p99_us: f64,
    max_us: f64,
    mean_v: f64,
    steps_per_s: f64,
}

/// Times the filter.
///
/// # Errors
/// When there is no file that fits, or one is not what it should be.
pub fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let isa = match &arguments.isa {
        None => Isa::detect(),
        Some(name) => Isa::named(name)
            .with_context(|| format!("--isa {name}: this processor has {:?}", Isa::available()))?,
    };
    let sizes = sizes(arguments)?;
    let mut out = std::io::stdout().lock();
    if !arguments.json {
        writeln!(out, "{}", header())?;
    }
    for (grid, layers) in sizes {
        let scene = load(arguments, grid, layers)?;
        time_scene(arguments, isa, &scene, &mut |row: Row| {
            let line = if arguments.json { serde_json::to_string(&row)? } else { table_line(&row) };
            writeln!(out, "{line}")?;
            Ok(())
        })?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The sizes of the files in the folder that were asked for, small ones first.
fn sizes(arguments: &Arguments) -> anyhow::Result<Vec<(usize, usize)>> {
    let folder = &arguments.scene;
    let entries = std::fs::read_dir(folder).with_context(|| format!("open {}", folder.display()))?;
    let mut sizes = Vec::new();
    for entry in entries {
        let name = entry.with_context(|| format!("list {}", folder.display()))?.file_name();
        let of_name = |name: &str| {
            let (grid, layers) = name.strip_prefix("sdf_")?.strip_suffix(".f32")?.split_once('_')?;
            Some((grid.parse().ok()?, layers.parse().ok()?))
        };
        sizes.extend(name.to_str().and_then(of_name));
    }
    sizes.retain(|(grid, layers)| {
        arguments.grid.is_none_or(|wanted| wanted == *grid)
            && arguments.layers.is_none_or(|wanted| wanted == *layers)
    });
    if sizes.is_empty() {
        bail!("no file sdf_{{n}}_{{M}}.f32 in {} is of the grid and layers asked for", folder.display());
    }
    sizes.sort_unstable();
    Ok(sizes)
}

fn load(arguments: &Arguments, grid: usize, layers: usize) -> anyhow::Result<Scene> {
    let read = |path: &Path| std::fs::read(path).with_context(|| format!("read {}", path.display()));
    let folder = &arguments.scene;
    let sdf = read(&folder.join(format!("sdf_{grid}_{layers}.f32")))?;
    let beside = folder.join(format!("states_{grid}_{layers}.f32"));
    let states = read(arguments.states.as_deref().unwrap_or(&beside))?;
    let primitives = read(&folder.join("prims.f32"))?;
    Scene::from_raw((grid, layers), &sdf, &states, &primitives)
        .with_context(|| format!("scene of {grid} points a side and {layers} layers"))
}

fn time_scene(
    arguments: &Arguments,
    isa: Isa,
    scene: &Scene,
    tell: &mut dyn FnMut(Row) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let Arguments { n, r, h, seed, .. } = *arguments;
    let sampling = Sampling { n_samples: n as usize, n_rounds: r as usize, n_steps: h as usize, seed };
    let blank = Row {
        variant: "layer_merge",
        mode: "full",
        isa: isa.name(),
        n,
        r,
        h,
        layers: scene.layers_m.len(),
        grid: scene.n_side,
        mean_us: 0.0,
        median_us: 0.0,
        p99_us: 0.0,
        max_us: 0.0,
        mean_v: 0.0,
        steps_per_s: 0.0,
    };
    let row = |variant, mode| Row { variant, mode, ..blank.clone() };

    let mut filter = StandardFilter::new(isa, scene, sampling);
    let merges = timed(1, N_MERGES, seed, |_, _| {
        filter.merge();
        0.0
    });
    tell(merges.into_row(row("layer_merge", "full")))?;

    let n_states = scene.states.len();
    let start = |idx: usize| {
        let [x, y, yaw, v, ..] = scene.states[idx];
        [x, y, yaw, v]
    };
    let mut standard = |step: &mut dyn FnMut(&mut StandardFilter<'_>, usize) -> f64| {
        timed(n_states, N_PASSES.1, seed, |tick, idx| {
            filter.begin(tick);
            step(&mut filter, idx)
        })
    };
    let full = standard(&mut |filter, idx| filter.full(scene.states[idx]).v_m);
    tell(full.into_row(row("smooth_blending", "full")))?;
    let shipped = standard(&mut |filter, idx| filter.shipped(scene.states[idx]).v_m);
    tell(shipped.into_row(row("smooth_blending", "shipped")))?;
    let full = standard(&mut |filter, idx| filter.score_full(start(idx)));
    tell(full.into_row(row("least_restrictive", "full")))?;
    let shipped = standard(&mut |filter, idx| filter.score(start(idx), f64::INFINITY));
    tell(shipped.into_row(row("least_restrictive", "shipped")))?;

    let starts = starts(scene).context("fields of the scene")?;
    for (variant, method) in
        [("smooth_blending", Method::SmoothBlending), ("least_restrictive", Method::LeastRestrictive)]
    {
        let times = time_service(isa, &starts, sampling, method)?;
        tell(times.into_row(row(variant, "service")))?;
    }
    Ok(())
}

/// The whole step of the filter that drives a robot, a filter for each state as if it came from there.
fn time_service(isa: Isa, starts: &[Start], sampling: Sampling, method: Method) -> anyhow::Result<Times> {
    let profile = Profile::sim();
    let Sampling { n_samples, n_rounds, n_steps, seed } = sampling;
    let config = FilterConfig {
        method,
        n_samples,
        n_rounds,
        n_steps,
        seed,
        latency_s: 0.0,
        ..FilterConfig::for_profile(&profile)
    };
    let filter = || Filter::new(config.clone(), &profile).map(|filter| filter.on(isa));
    let mut filters = starts.iter().map(|_| filter()).collect::<Result<Vec<_>, _>>()?;
    Ok(timed(starts.len(), N_PASSES.1, seed, |_, idx| {
        let Start { state, nominal, world } = &starts[idx];
        filters[idx].step(TICK, *state, *nominal, world).v_safe_m
    }))
}

/// The times of many steps.
struct Times {
    all_us: Vec<f64>,
    /// Each state's.
    by_state_us: Vec<Vec<f64>>,
    mean_v: f64,
}

/// Times `step(tick, state)` over all states in random order, several passes.
fn timed(n_states: usize, n_passes: usize, seed: u64, mut step: impl FnMut(u64, usize) -> f64) -> Times {
    let clock = Clock::start();
    let mut times = Times { all_us: Vec::new(), by_state_us: vec![Vec::new(); n_states], mean_v: 0.0 };
    let mut order: Vec<usize> = (0..n_states).collect();
    let mut chance = seed;
    let begun = clock.now();
    for pass in 0..n_passes {
        if pass >= N_PASSES.0 && clock.now().since(begun) > ROW_TIME_MAX {
            break;
        }
        shuffle(&mut order, &mut chance);
        for idx in &order {
            let before = clock.now();
            let v = step(times.all_us.len() as u64, *idx);
            let took_us = clock.now().since(before).as_secs_f64() * 1e6;
            times.all_us.push(took_us);
            times.by_state_us[*idx].push(took_us);
            times.mean_v += v;
        }
    }
    times.mean_v /= times.all_us.len() as f64;
    times
}

impl Times {
    fn into_row(mut self, row: Row) -> Row {
        let mean_us = self.all_us.iter().sum::<f64>() / self.all_us.len() as f64;
        let slowest_us = self.by_state_us.iter_mut().map(|times| quantile(times, 0.5)).fold(0.0, f64::max);
        Row {
            mean_us,
            median_us: quantile(&mut self.all_us, 0.5),
            p99_us: quantile(&mut self.all_us, 0.99),
            max_us: slowest_us,
            mean_v: self.mean_v,
            steps_per_s: 1e6 / mean_us,
            ..row
        }
    }
}

fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let idx = (share * (values.len() as f64 - 1.0)).round().max(0.0) as usize;
    values.get(idx).copied().unwrap_or(0.0)
}

/// Fisher and Yates, with the numbers of `splitmix64`.
fn shuffle(order: &mut [usize], chance: &mut u64) {
    for last in (1..order.len()).rev() {
        *chance = chance.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = *chance;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        order.swap(last, ((z ^ (z >> 31)) % (last as u64 + 1)) as usize);
    }
}

fn header() -> String {
    format!(
        "{:<18} {:<8} {:<7} {:>5} {:>3} {:>3} {:>6} {:>5} {:>9} {:>9} {:>9} {:>9} {:>8}",
        "variant",
        "mode",
        "isa",
        "n",
        "r",
        "h",
        "layers",
        "grid",
        "mean µs",
        "median",
        "p99",
        "max",
        "mean V"
    )
}

fn table_line(row: &Row) -> String {
    let Row { variant, mode, isa, n, r, h, layers, grid, mean_us, median_us, p99_us, max_us, mean_v, .. } =
        row;
    format!(
        "{variant:<18} {mode:<8} {isa:<7} {n:>5} {r:>3} {h:>3} {layers:>6} {grid:>5} {mean_us:>9.1} \
         {median_us:>9.1} {p99_us:>9.1} {max_us:>9.1} {mean_v:>8.4}"
    )
}
